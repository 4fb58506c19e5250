"""Peak of a signal, from rest, under disturbances that are bounded at all times."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.requirements.followed import times_of, unfollowed
from polefence.requirements.slopes import Loops, Slopes, Turned
from polefence.requirements.specification import Specification, disturbance
from polefence.response.closed import close
from polefence.response.modes import Modes, moved_modes

EVEN, TURN = 400, 12  # times at which a response is looked at for changes of its sign
TRUE = 1e-9  # of a matrix: what its modes may leave of it
CLOSER = 4  # steps of Newton's method to where a response changes its sign
NEAR = 1e-4  # of the larger one's size: poles whose divided differences are slopes


@dataclass(frozen=True)
class PeakToPeak(Specification):
    """The largest value of a signal, from rest, for disturbances that are bounded at all times.

    Attributes
    ----------
    disturbances : sequence of str, or mapping of str to float, optional
        Those that act, and how large each is at most; all, each at most one, unless said.
    """

    kind = "peak to peak"
    keys = ("disturbances",)
    direct = True
    power = 1

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without a disturbance, or of which none is proved."""
        disturbance(plant)
        self.require_late(plant)
        self.scales(plant)
        if why := unfollowed(plant):
            raise InputError(f"{self.title}: peaks of bounded disturbances are not proved {why}")

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.PeakToPeak:
        """Return the claim, which is not followed yet."""
        scales = tuple(map(Fraction, self.scales(plant)))
        return proof.PeakToPeak(subject, self.exact_outputs(plant), level, scales=scales)

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has it."""
        return f"{self.title}: no LMI has it; leave out the method, so that a law is tuned"

    def slopes(self, loops: Loops) -> Slopes:
        """Return the integrals of responses to impulses, without signs, with their slopes."""
        count = len(loops.A)
        every = [_Responses.of(loops, k) for k in range(count)]

        def turned() -> list[Turned]:
            parts = [one.turned() for one in every]
            dA, dC, dE = (np.stack([part[i] for part in parts]) for i in range(3))
            return [Turned(dA, dC, dE, np.sign(loops.F))]

        return Slopes(np.array([one.value for one in every]), np.arange(count), turned)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return it at points alpha; infinite of a loop that is not stable."""
        closed = close(plant, law, alpha)
        channel = self.channel(delta_form(plant), alpha)
        loops = channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)
        stable = np.all(loops.modes.poles.real < 0, axis=1)
        return np.array(
            [_Responses.of(loops, k).value if stable[k] else np.inf for k in range(len(alpha))]
        )


@dataclass(frozen=True, eq=False)
class _Responses:
    """h(t) = sum of c_m b_m exp(p_m t) of one loop, of each disturbance; between which times > 0.

    Attributes
    ----------
    poles, right, left
        p, V and its inverse.
    b, c : (n, q) and (n,) complex arrays
    changes : list of arrays
        From zero on, the times from which each h has another sign.
    signs : list of arrays
        From each of these times on.
    through : (q,) array
    """

    poles: Any
    right: Any
    left: Any
    b: Any
    c: Any
    changes: list[Array]
    signs: list[Array]
    through: Array

    @classmethod
    def of(cls, loops: Loops, k: int) -> _Responses:
        """Return those of the k-th loop, which is stable."""
        modes, E, C = loops.modes, loops.E[k], loops.C[k][0]
        A, poles, right, left = modes.A[k], modes.poles[k], modes.right[k], modes.left[k]
        if not np.abs((right * poles) @ left - A).max() <= TRUE * np.abs(A).max():
            poles, right, left = (part[0] for part in moved_modes(A[None]))
        b, c = left @ E, C @ right
        t = times_of(poles, EVEN, TURN)
        waves = np.exp(np.multiply.outer(t, poles))
        each = [_signs(t, waves, poles, c * column) for column in b.T]
        changes, signs = ([one[i] for one in each] for i in (0, 1))
        return cls(poles, right, left, b, c, changes, signs, loops.F[k][0])

    @property
    def value(self) -> float:
        """The integrals of |h|, and |F|."""
        integrals = [
            (self.c * column * self._weights(self.poles, i)[0]).sum().real
            for i, column in enumerate(self.b.T)
        ]
        return float(sum(integrals) + np.abs(self.through).sum())

    def _weights(self, poles: Any, i: int) -> tuple[Any, Any]:
        """Return the integral of sign(h) exp(p t), h the i-th, and its slope in p."""
        t, sign = self.changes[i], self.signs[i]
        jumps = np.diff(sign, prepend=0.0)  # of the sign, at times t; exp(p t) fades
        waves = np.exp(np.multiply.outer(poles, t))
        total = -(waves * jumps).sum(axis=-1) / poles
        return total, -(waves * (jumps * t)).sum(axis=-1) / poles - total / poles

    def turned(self) -> tuple[Array, Array, Array]:
        """Return slopes with respect to A, C and E."""
        n = len(self.poles)
        dA, dC, dE = np.zeros((n, n)), np.zeros(n), np.zeros((n, len(self.through)))
        p, q = self.poles[:, None], self.poles[None, :]
        apart = p - q
        near = np.abs(apart) < NEAR * np.maximum(np.abs(p), np.abs(q))
        for i, column in enumerate(self.b.T):
            weights, _ = self._weights(self.poles, i)
            _, middle = self._weights((p + q) / 2, i)
            rises = (weights[:, None] - weights) / np.where(near, 1.0, apart)
            both = self.c[:, None] * np.where(near, middle, rises) * column
            dA += (self.left.T @ both @ self.right.T).real
            dC += (self.right @ (weights * column)).real
            dE[:, i] = ((self.c * weights) @ self.left).real
        return dA, dC[None], dE


def _signs(t: Array, waves: Any, poles: Any, weights: Any) -> tuple[Array, Array]:
    """Return zero and the times at which h changes its sign, and the sign from each on."""
    h = (waves @ weights).real
    kept = np.flatnonzero(h)
    if not len(kept):
        return np.zeros(1), np.zeros(1)
    own = np.sign(h[kept])
    at = np.flatnonzero(own[1:] != own[:-1])
    low, high = t[kept[at]], t[kept[at + 1]]
    ahead, behind = h[kept[at]], h[kept[at + 1]]
    change = low + (high - low) * ahead / (ahead - behind)
    for _ in range(CLOSER):
        terms = np.exp(np.multiply.outer(change, poles)) * weights
        slope = (terms @ poles).real
        moved = change - terms.sum(axis=1).real / np.where(slope, slope, 1.0)
        change = np.where((low < moved) & (moved < high) & (slope != 0), moved, change)
    return np.concatenate([[0.0], change]), np.concatenate([own[:1], own[at + 1]])
