"""Gain from the disturbances to a signal in L2: its H-infinity norm, of all or of a band."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

import numpy as np

from polefence.base.errors import InputError, shown
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.bands import Band
from polefence.proof.between import Held
from polefence.requirements.frequencies import (
    frequencies,
    require_below_half_the_rate,
    with_band,
)
from polefence.requirements.slopes import Channel, Loops, Slopes, Turned
from polefence.requirements.specification import Row, Specification
from polefence.response.between import held_evenly
from polefence.response.closed import Loops as ClosedLoops
from polefence.response.closed import close
from polefence.response.modes import Modes
from polefence.response.peaks import Band as Ends
from polefence.response.peaks import largest, on_grid, peaks, response
from polefence.response.stationary import needed, stationary

ALL_TIMES, SAMPLES = "all times", "samples"


@dataclass(frozen=True)
class Gain(Specification):
    """The L2 gain (H-infinity norm) from the disturbances to a signal, or to a vector of them.

    Attributes
    ----------
    at : str
        Of a plant that is sampled: "all times", or "samples". At samples disturbances are held
        between them, as a command is that a computer gives, and the signal is that at samples. Any
        other plant has one gain.
    band : pair of float, optional
        Lowest and highest frequency [Hz]: the gain is then the largest singular value of the
        transfer function at these and between them. All frequencies by default.
    """

    at: str = ALL_TIMES
    band: Any = field(default=None, kw_only=True)
    kind = "gain"
    keys: ClassVar[tuple[str, ...]] = ("disturbances", "at", "band")
    vector = True
    power = 1
    direct = True
    late_as = proof.Gain.late_as

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if self.at not in (ALL_TIMES, SAMPLES):
            raise InputError(f'at = {shown(self.at)} must be "{SAMPLES}" or "{ALL_TIMES}"')
        if self.band is not None:
            self._settle("band", frequencies(self.band))

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        own = {key: row.table[key] for key in ("at", "band") if key in row.table}
        return cls(row.table["signal"], **row.given(), **own)

    @property
    def title(self) -> str:
        """Kind, signal, chosen disturbances, whether at samples, and the band, as a line has it."""
        text = super().title if self.at == ALL_TIMES else f"{super().title} with at {self.at}"
        return with_band(text, self.band)

    @property
    def by_transfer_alone(self) -> bool:
        """Whether it is of a band."""
        return self.band is not None

    @property
    def exact_band(self) -> Band | None:
        """The band as a claim has it."""
        return None if self.band is None else Band(*map(Fraction, self.band))

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant of which no gain in the band is proved, too."""
        super().require_fit(plant)
        if self.band is None:
            return
        if plant.dead_time is not None:
            raise InputError(
                f"{self.title}: with a dead time no gain in a band is proved; leave out the band"
            )
        if plant.moving:
            raise InputError(
                f"{self.title}: {plant.moving[0].name} moves, and a frequency response needs "
                "constant parameters; leave out its rate, or the band"
            )
        if self.held(plant) is not None:
            raise InputError(
                f"{self.title}: between samples there is no frequency response; leave out the "
                "band, or the sample time"
            )
        if plant.remainder is not None:
            raise InputError(
                f"{self.title}: samples, and functions of parameters, have a remainder, with which "
                "no gain in a band is proved; leave out the band"
            )
        if len(plant.vertices) > 2 and not plant.parameters:
            raise InputError(
                f"{self.title}: a gain in a band is proved for parameters of a box; give "
                "[parameters] in place of the vertices, or leave out the band"
            )
        require_below_half_the_rate(self.title, self.band, plant)

    def beyond_lmi(self, plant: UncertainPlant) -> str:
        """Say that none has a band."""
        if self.band is None:
            return super().beyond_lmi(plant)
        return f"{self.title}: no LMI has its band; leave out the method, so that a law is tuned"

    def ends(self, step: float) -> Ends | None:
        """Return the band's ends as `peaks` has them [rad/s]; None without a band."""
        if self.band is None:
            return None
        if not step:
            return 2 * math.pi * self.band[0], 2 * math.pi * self.band[1]
        low, high = (min(math.pi * f * step, math.pi / 2) for f in self.band)
        return 2 * math.tan(low) / step, 2 * math.tan(high) / step

    def unit(self, plant: UncertainPlant) -> str:
        """Return the signal's unit per unit of the disturbances."""
        known = disturbances(plant)
        acting = self.scales(plant) or (1.0,) * len(known)
        units = {signal.unit for signal, scale in zip(known, acting, strict=True) if scale}
        per = units.pop() if len(units) == 1 else ""
        return f"{super().unit(plant) or 1} per {per or 'unit'}"

    def source(
        self,
        plant: UncertainPlant,
        domain: Domain,  # noqa: ARG002
        law: Law | None = None,
    ) -> conditions.Source:
        """Return the way the disturbances enter."""
        return conditions.Through(f"gain{self.scales(plant) or ''}", *self.driving(plant, law))

    def held(self, plant: UncertainPlant) -> Held | None:
        """Return what is held between samples, where the gain is that at all times."""
        return held_evenly(plant, self.outputs(plant)) if self.at == ALL_TIMES else None

    def require_samples(self, plant: UncertainPlant, F: Array | None) -> None:
        """Take what passes into a law's signals where disturbances are held; else refuse it."""
        if self.at == SAMPLES:
            return
        try:
            super().require_samples(plant, F)
        except InputError as error:
            raise InputError(
                f"{error}, or the disturbance a [[weight]] such as 1/(s/30 + 1); or ask for it "
                f'at = "{SAMPLES}", of disturbances that are held'
            ) from error

    def easier(self, plant: UncertainPlant) -> str:
        """Say that commands may be held; samples take faster ones for slow ones."""
        if self.held(plant) is None:
            return ""
        return (
            f"{self.title} counts disturbances faster than the samples, which no law tells from "
            f'slow ones: where they are held, ask for it at = "{SAMPLES}"'
        )

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the closed loops of the dual form; None in a band, where there is none."""
        if self.band is not None:
            return None
        problem, held = self._dual(plant, law, 1.0, gain=True), self.held(plant)
        if held is None:
            return problem
        return replace(problem, storing=self._storing(plant, held))

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the gain."""
        scales = tuple(map(Fraction, self.scales(plant)))
        outputs, held = self.exact_outputs(plant), self.held(plant)
        return proof.Gain(subject, outputs, level, scales=scales, held=held, band=self.exact_band)

    def has_primal(self, plant: UncertainPlant) -> bool:
        """Not of what goes on between samples, whose S is that of the dual; nor of a band."""
        return self.held(plant) is None and self.band is None

    def at_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array | None:
        """Return the gain at samples of held disturbances; else None."""
        if self.held(plant) is None:
            return None
        return self._of(super().channel(delta_form(plant), alpha), close(plant, law, alpha))

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with disturbances that are held for parts of a period only."""
        channel, held = super().channel(plant, alpha), self.held(plant)
        if held is None:
            return channel
        n = plant.shape[0]
        E, shown, F = self._storing(plant, held).lifted(alpha, float(plant.period))
        return replace(channel, E=E[:, :n], C=shown[..., :n], D=shown[..., n:], F=F)

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,
        unit: float | None = None,
        law: Law | None = None,
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return the condition with the direct feedthrough of the disturbance."""
        source, output = super().condition(plant, domain, unit, law)
        F, degree = self.through(plant, law)
        return source, replace(output, F=F, F_degree=degree)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the gain on a grid of frequencies, and exactly at the worst points."""
        stationary(plant, law, alpha, 0.0, self.outputs(plant))  # refuses what is not stable
        return self._of(self.channel(delta_form(plant), alpha), close(plant, law, alpha))

    def worst_frequency(self, plant: UncertainPlant, law: Any, alpha: Array) -> float | None:
        """Return where it is worst at a point (N,) [rad/s]."""
        channel = self.channel(delta_form(plant), alpha[None])
        closed = close(plant, law, alpha[None])
        loops = channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)
        ends = self.ends(loops.modes.step)
        _, w, height = peaks(loops.modes, loops.E, loops.C, loops.F, ends)
        return sampled_frequency(float(w[height.argmax()]), closed.step)

    def _of(self, channel: Channel, closed: ClosedLoops) -> Array:
        loops = channel.closed(closed.K, Modes(closed.closed, closed.step), closed.passed)
        # states of a law without control are integrators, on which no signal depends
        some = needed(loops.C, loops.A)
        if not len(some):
            return largest(loops.F)
        modes = Modes(loops.A[:, some][:, :, some], closed.step)
        E, C, ends = loops.E[:, some], loops.C[..., some], self.ends(closed.step)
        values = on_grid(modes, E, C, loops.F, ends)
        worst = np.argsort(-values)[:20]  # points of the grid
        modes = Modes(modes.A[worst], closed.step)
        points, _, height = peaks(modes, E[worst], C[worst], loops.F[worst], ends)
        np.maximum.at(values, worst[points], height)
        return values

    def slopes(self, loops: Loops) -> Slopes:
        """Return peaks of the largest singular value with their slopes."""
        found = Highest.of(loops, ends=self.ends(loops.modes.step))
        return Slopes(found.values, found.points, lambda: [found.turned()])


def sampled_frequency(w: float, step: float) -> float | None:
    """Return the frequency of a sine whose samples have w of the bilinear transform."""
    if not np.isfinite(w):
        return None
    return 2 * float(np.arctan(w * step / 2)) / step if step else w


@dataclass(frozen=True, eq=False)
class Highest:
    """Singular values within 30 % of the largest at a peak, a row each.

    Attributes
    ----------
    values, points : (rows,) arrays
        And the number of the loop that each is of.
    u, v : (rows, p), (rows, q) arrays
        Its vectors: G v = values u.
    s : (rows,) array
        Where the peak is [1/s].
    A, E, C : (rows, ., .) arrays
    out, into : (rows, p), (rows, q) arrays
        What outputs and disturbances are multiplied by: G is diag(out) G0 diag(into).
    """

    values: Array
    points: Any
    u: Any
    v: Any
    s: Any
    A: Array
    E: Array
    C: Array
    out: Any = 1.0
    into: Any = 1.0

    @classmethod
    def of(
        cls,
        loops: Loops,
        known: tuple[Array, Array] | None = None,
        sides: tuple[Any, Any] | None = None,
        ends: Ends | None = None,
    ) -> Self:
        """Return those of the peaks of loops, or of peaks that are known: their loops and w.

        Of peaks that are known, with what outputs and disturbances are multiplied by at each; of
        others those between the ends of a band, where there is one.
        """
        A, E, C, F = loops.A, loops.E, loops.C, loops.F
        step = loops.modes.step
        points, w = known or peaks(loops.modes, E, C, F, ends)[:2]
        s = 1j * w / (1 - 0.5j * w * step)
        A, E, C, F = (M[points] for M in (A, E, C, F))
        G = response(A, E, C, F, s[:, None])[:, 0]
        out, into = sides or (np.ones(G.shape[:2]), np.ones(G.shape[::2]))
        if sides:
            G = out[:, :, None] * G * into[:, None]
        u, values, vt = np.linalg.svd(G, full_matrices=False)
        some, which = np.nonzero(values >= 0.7 * values[:, :1])
        u, v, values = u[some, :, which], vt[some, which].conj(), values[some, which]
        points, s, A, E, C, out, into = (x[some] for x in (points, s, A, E, C, out, into))
        return cls(values, points, u, v, s, A, E, C, out, into)

    def turned(self) -> Turned:
        """Return the slopes of the values with respect to the loops."""
        s, A, E, C = self.s, self.A, self.E, self.C
        u, v = np.conj(self.out) * self.u, self.into * self.v
        away = s[:, None, None] * np.eye(A.shape[-1]) - A
        right = np.linalg.solve(away, E @ v[:, :, None])[:, None, :, 0]
        back, seen = np.swapaxes(away.conj(), 1, 2), np.swapaxes(C, 1, 2) @ u[:, :, None]
        left = np.linalg.solve(back, seen)
        seen, driven = u.conj()[:, :, None], v[:, None]
        from_state, from_w = left.conj(), (left.conj() * driven).real
        return Turned((from_state * right).real, (seen * right).real, from_w, (seen * driven).real)
