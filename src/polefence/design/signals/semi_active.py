"""A law for controllable dampers and what is proved of it: a demand K x, cut off to their bounds.

Of all dampers that stay as they are the best one has c0 and u = c0 v, and P of its Lyapunov
equation tells what is still to come from a state. The rate z'z + 2 x'P (A x + B u) is lowest for
another u; cut off to what the dampers can give, that costs on average no more than c0, which a
quadratic V proves. One of a higher degree proves more: it is told by the moments of the times that
the dampers spend at their bounds and in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import product as cartesian
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import InputError, NotProvedError, SolverError, require_type
from polefence.base.explained import explained
from polefence.base.files import write_text
from polefence.base.processors import small_matrices
from polefence.design.certificate import file_plant
from polefence.design.requirements.rms import Rms
from polefence.law.laws import FixedGain
from polefence.lmi.solve.moments import Mean, Piece, Problem, inside
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import states
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import GIVEN, Clipped, Squares, pieces_of
from polefence.proof.claims.refutation import RmsLimit
from polefence.proof.dampers import SemiActive
from polefence.proof.document import Document
from polefence.proof.matrices import Rationals
from polefence.proof.short import Short
from polefence.proof.squares import count_of
from polefence.region.text import digits_up

# How near its end the search comes: what is on the very edge may not survive its rounding.
NEAR = (1e-5, 1e-4, 1e-3)
ABOVE = 1e-7  # what was found in floats, the level that is claimed
DEGREES = (6, 4, 2)
MOST = 2000  # moments that are searched for
STEPS, DIGITS = 60, 3  # of a fixed damper: tried from bound to bound; kept
OWN = 2  # matrices of a piece: of the odd monomials, and of the even ones
LEAST = 1e-3  # of the largest, what a force costs at least
UNREACHED = 1e-12  # of the largest variance of a state, in balanced units


@dataclass(frozen=True, eq=False)
class SemiActiveLaw(Short):
    """A demand for controllable dampers, and the rms that is proved of it for every value.

    Attributes
    ----------
    plant : UncertainPlant
    specification : Rms
    dampers : tuple of Damper
        One for each input.
    K : (m, n) array
        What is demanded, K x; the forces are this as far as the dampers can give it.
    level : float
        The rms is at most this.
    coefficients : tuple of float
        Of the best dampers that stay as they are.
    passive : float
        The worst rms with these, at the vertices; to compare with, not proved.
    claim : Clipped
        With its evidence.
    reason : str
        What was proved.
    """

    plant: UncertainPlant
    specification: Rms
    dampers: tuple[Damper, ...]
    K: Array
    level: float
    coefficients: tuple[float, ...]
    passive: float
    claim: Clipped
    reason: str

    @property
    def degree(self) -> int:
        """Of the polynomial that proves it."""
        return self.claim.degree

    def file(self) -> Document:
        """Return it as a file of claims."""
        return Document(file_plant(self.plant), None, (self.claim,), polefence=VERSION)

    def save(self, path: str | Path) -> Path:
        """Write a file that `polefence check` proves; return its path."""
        write_text(Path(path), self.file().dumps())
        return Path(path)

    def __str__(self) -> str:
        stays = ", ".join(f"{c:g}" for c in self.coefficients)
        return (
            f"proved: {self.specification.title} <= {digits_up(self.level)}; of dampers that "
            f"stay, c = {stays} is best, with {self.passive:.6g}"
        )


@explained
@small_matrices()
def semi_active(
    plant: UncertainPlant,
    specification: Rms,
    dampers: Sequence[Damper],
    degree: int | None = None,
    K: Any = None,
) -> SemiActiveLaw:
    """Return a law for controllable dampers, with a proved bound on an rms.

    It costs on average no more than the best dampers that stay as they are, one for each force.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E, the same for all values of the parameters.
    specification : Rms
        Of one signal or a vector, not weighted; its ``at_most`` is not asked for.
    dampers : sequence of Damper
        One for each input, with ``low`` above zero.
    degree : int, optional
        2, 4, 6 or 8, of the polynomial that proves the bound; by default the highest up to 6 for
        which the search is quick. The higher, the lower the bound.
    K : (m, n) array, optional
        What is demanded, rounded to 32 bits, such as a skyhook's force; by default the law's own.

    Returns
    -------
    SemiActiveLaw

    Raises
    ------
    InputError
        If dampers, specification and plant do not fit.
    NotProvedError
        If no bound was proved.
    """
    problem = _Question.of(plant, specification, dampers)
    given = None if K is None else FixedGain(K).K
    if given is not None and given.shape != plant.shape[::-1]:
        m, n = plant.shape[::-1]
        raise InputError(f"K is {given.shape[0]} x {given.shape[1]}, not {m} x {n}")
    for own in DEGREES if degree is None else (_even(degree),):
        if degree is None and problem.moments(own) > MOST and own > DEGREES[-1]:
            continue
        found = problem.proved(own, given)
        if found is not None:
            return found
    raise NotProvedError(f"{plant.name}: no bound on {specification.title} was proved")


def _even(degree: int) -> int:
    if degree not in (2, 4, 6, 8):
        raise InputError(f"degree = {degree!r} must be 2, 4, 6 or 8")
    return degree


@dataclass(frozen=True, eq=False)
class _Question:
    """The plant in floats, E with the noise in it, and the law."""

    plant: UncertainPlant
    specification: Rms
    dampers: tuple[Damper, ...]
    exact: tuple[SemiActive, ...]
    A: Array
    B: Array
    E: Array
    C: Array
    D: Array
    rates: Array

    @classmethod
    def of(cls, plant: UncertainPlant, specification: Rms, dampers: Sequence[Damper]) -> _Question:
        """Return the question.

        Raises
        ------
        InputError
            If something does not fit.
        """
        require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
        require_type(specification, Rms, "specification", "for example Rms('acceleration')")
        if plant.sample_time is not None:
            raise InputError(f"{plant.name} is in discrete time; dampers are of continuous time")
        if specification.weight is not None:
            raise InputError(
                f"weight = {specification.weight!r}: of semi-active laws bounds are proved without "
                "weights only; leave it out"
            )
        specification.require_fit(plant)
        pairs = sorted(((own.of(plant), own) for own in dampers), key=lambda pair: pair[0].number)
        exact = tuple(own for own, _ in pairs)
        if [own.number for own in exact] != list(range(plant.shape[1])):
            raise InputError(f"{plant.name}: give one damper for each of {plant.shape[1]} inputs")
        for _, damper in pairs:
            if not damper.low > 0:
                raise InputError(
                    f"damper {damper.force}: low = 0; a bound is proved with low above zero only"
                )
        E = specification.entering(plant) * (specification.density / 2) ** 0.5
        if np.ptp(E, axis=0).any() or any(own.rate[0] != r for own in exact for r in own.rate):
            raise InputError(
                f"{plant.name}: how the disturbance enters, or a damper's rate, changes with a "
                "parameter; a bound is proved where neither does"
            )
        outputs = specification.exact_outputs(plant)
        C, D = (
            np.array([[_row(getattr(y, k)[j]) for y in outputs] for j in range(len(plant.A))])
            for k in "CD"
        )
        rates = np.array([_row(own.rate[0]) for own in exact])
        named = tuple(damper for _, damper in pairs)
        return cls(plant, specification, named, exact, plant.A, plant.B, E[0], C, D, rates)

    @property
    def bounds(self) -> Array:
        """Lower and upper bounds of the coefficients."""
        return np.array([[float(d.low), float(d.high)] for d in self.dampers])

    def moments(self, degree: int) -> int:
        """Return about how many unknowns there are."""
        return len(pieces_of(len(self.A), len(self.dampers))) * count_of(self.A.shape[1], degree)

    def loop(self, j: int, gain: Array) -> tuple[Array, Array]:
        """Return A and C of a closed loop at a vertex."""
        return self.A[j] + self.B[j] @ gain, self.C[j] + self.D[j] @ gain

    def rms(self, c: Array) -> float:
        """Return the worst rms with these coefficients, infinite where one is not stable."""
        from scipy.linalg import solve_continuous_lyapunov

        worst = 0.0
        for j in range(len(self.A)):
            A, C = self.loop(j, c[:, None] * self.rates)
            if np.linalg.eigvals(A).real.max() >= 0:
                return np.inf
            X = solve_continuous_lyapunov(A, -self.E @ self.E.T)
            worst = max(worst, float(np.trace(C @ X @ C.T)))
        return float(np.sqrt(worst))

    @cached_property
    def best(self) -> Array:
        """The coefficients of the best dampers that stay, to a few digits.

        One after the other from bound to bound, until none changes.
        """
        bounds = self.bounds
        c = np.sqrt(bounds[:, 0] * bounds[:, 1])
        for _ in range(10):
            last = c.copy()
            for k, (low, high) in enumerate(bounds):
                each = [float(f"{x:.{DIGITS}g}") for x in np.geomspace(low, high, STEPS)]
                tried = [c.copy() for _ in each]
                for own, x in zip(tried, each, strict=True):
                    own[k] = min(max(x, low), high)
                values = [round(self.rms(own), 12) for own in tried]
                c = tried[int(np.argmin(values))]
            if np.array_equal(c, last):
                break
        return c

    @cached_property
    def passive(self) -> float:
        """The worst rms with the best dampers that stay.

        Raises
        ------
        NotProvedError
            If none keeps every vertex stable.
        """
        found = self.rms(self.best)
        if not np.isfinite(found):
            raise NotProvedError(
                f"{self.plant.name}: no dampers that stay, between their bounds, keep it stable "
                "for every value; nothing is proved of those that change"
            )
        return found

    @cached_property
    def demand(self) -> Array:
        """K of the law's own, from the mean of the vertices with the best dampers that stay.

        z'z + 2 x'P (A x + B u) is at most its value and slope at u0 = c v, and (u - u0)'R0 (u - u0)
        with a diagonal R0: of this each force by itself is the least.
        """
        from scipy.linalg import solve_continuous_lyapunov

        A, B, C, D = (np.mean(M, axis=0) for M in (self.A, self.B, self.C, self.D))
        u0 = self.best[:, None] * self.rates
        loop, out = A + B @ u0, C + D @ u0
        P = solve_continuous_lyapunov(loop.T, -out.T @ out)
        R = D.T @ D
        R0 = np.abs(R).sum(axis=1)
        if not R0.any():
            raise InputError(
                f"{self.specification.title}: has no force in it; add an acceleration, or a force"
            )
        R0 = np.maximum(R0, LEAST * R0.max())
        return np.asarray(u0 - (R @ u0 + B.T @ P + D.T @ C) / R0[:, None])

    @cached_property
    def mean(self) -> Array:
        """A with the best dampers that stay, the mean of the vertices."""
        gain = self.best[:, None] * self.rates
        return np.asarray(np.mean([self.loop(j, gain)[0] for j in range(len(self.A))], axis=0))

    @cached_property
    def units(self) -> Array:
        """What each state has of its rms, in powers of two: the evidence stays short in them.

        Raises
        ------
        NotProvedError
            If the disturbance does not reach a state.
        """
        from scipy.linalg import matrix_balance, solve_continuous_lyapunov

        balanced, (scale, _) = matrix_balance(self.mean, permute=False, separate=True)
        E = self.E / scale[:, None]
        X = np.diag(solve_continuous_lyapunov(balanced, -E @ E.T))
        for own, variance in zip(states(self.plant), X, strict=True):
            if not variance > UNREACHED * X.max():
                raise NotProvedError(
                    f"{self.plant.name}: no disturbance reaches {own.name}; of such plants no "
                    "bound is proved"
                )
        return np.asarray(2.0 ** np.round(np.log2(np.sqrt(X) * scale)), dtype=np.float64)

    def proved(self, degree: int, given: Array | None = None) -> SemiActiveLaw | None:
        """Return the law with what is proved of it by this degree, None if nothing is."""
        passive = self.passive  # first of all: without it there is nothing to be better than
        # numbers of 32 bits, so that what is proved is what a microprocessor has
        K = np.asarray(self.demand if given is None else given, dtype=np.float32).astype(float)
        each = pieces_of(len(self.A), len(self.dampers))
        pieces = [self.piece(pair, choice, K) for pair, choice in each]
        problem = Problem([own for own, _ in pieces], degree)
        for tolerance in NEAR:
            with suppress(SolverError, np.linalg.LinAlgError):
                mean = problem.solved(tolerance)
                level = passive * float(np.sqrt(mean.level)) * (1 + ABOVE)
                claim = self.claim(K, level, degree, mean, [sizes for _, sizes in pieces])
                verdict = prove(claim)
                if verdict.proved:
                    asked = (self.plant, self.specification, self.dampers)
                    stays = (tuple(self.best.tolist()), passive)
                    return SemiActiveLaw(*asked, K, level, *stays, claim, verdict.reason)
        return None

    def claim(
        self,
        K: Array,
        level: float,
        degree: int,
        mean: Mean,
        sizes: list[list[float]],
    ) -> Clipped:
        """Return the claim with its evidence."""
        plant, spec = file_plant(self.plant), self.specification
        outputs, intensity = spec.exact_outputs(self.plant), Fraction(spec.density) / 2
        return Clipped(
            plant.A,
            plant.B,
            plant.E,
            RmsLimit(outputs, Fraction(level), intensity),
            self.exact,
            _rationals(K),
            degree,
            tuple(_rationals([self.units])[0]),
            _rationals(self.common),
            tuple(map(tuple, _rationals(mean.V))),
            tuple(_squares(own, each) for own, each in zip(mean.grams, sizes, strict=True)),
            tuple(map(Fraction, spec.scales(self.plant))),
        )

    def piece(
        self, pair: tuple[int, int], choice: tuple[int, ...], K: Array
    ) -> tuple[Piece, list[float]]:
        """Return a piece in units, its cost over the square of the passive's, its forms' sizes."""
        (j, k), S, back = pair, np.diag(self.units), np.diag(1 / self.units)
        gain, forms, sizes = list[Array](), list[Array](), list[float]()
        for row, v, (low, high), what in zip(K, self.rates, self.bounds, choice, strict=True):
            gain.append((row, low * v, high * v)[what])
            above, below = row - low * v, row - high * v
            a, b = ((-above, below), (-above, v), (below, v))[what]
            form = S @ (np.outer(a, b) + np.outer(b, a)) @ S / 2
            sizes.append(float(np.abs(form).max()))
            forms.append(form / sizes[-1])
        loops = [self.loop(i, np.array(gain)) for i in pair]
        C, other = (out @ S / self.passive for _, out in loops)
        number = 1 if j == k else 2
        Q = number * (C.T @ other + other.T @ C) / 2
        motions = [(i, back @ A @ S) for i, (A, _) in zip((k, j), loops, strict=True)][:number]
        own = (number, tuple(motions), back @ self.E, Q, tuple(forms), GIVEN not in choice)
        return Piece(*own), sizes

    @cached_property
    def common(self) -> Array:
        """X > 0 with X A + A'X < 0 whatever the dampers do, found from a loop's own."""
        from scipy.linalg import solve_continuous_lyapunov

        S, back, n = np.diag(self.units), np.diag(1 / self.units), len(self.units)
        basis = list[Array]()
        for i in range(n):
            for k in range(i + 1):
                own = np.zeros((n, n))
                own[i, k] = own[k, i] = 1.0
                basis.append(own)
        F = [np.array(basis)]
        for j in range(len(self.A)):
            for c in cartesian(*self.bounds):
                loop = back @ self.loop(j, np.array(c)[:, None] * self.rates)[0] @ S
                F.append(np.array([-(own @ loop + loop.T @ own) for own in basis]))
        X = solve_continuous_lyapunov((back @ self.mean @ S).T, -np.eye(n))
        x = np.array([X[i, k] for i in range(n) for k in range(i + 1)])
        trace = np.array([np.trace(own) for own in basis])[:, None, None]
        found = inside([(0, f) for f in F], x, trace, np.zeros((0, len(x))))
        return np.asarray(back @ np.tensordot(found, F[0], 1) @ back)


def _row(row: Rationals) -> list[float]:
    return [float(x) for x in row[0]]


def _rationals(matrix: Any) -> Rationals:
    return [[Fraction(float(x)) for x in row] for row in matrix]


def _squares(grams: Sequence[Array], sizes: Sequence[float]) -> Squares:
    """Return the matrices of a piece as a claim has them, of forms as they are."""
    each = (len(grams) - OWN) // len(sizes)
    starts = [OWN + k * each for k in range(len(sizes))]
    H = [
        tuple(_rationals(G / size) for G in grams[start : start + each])
        for start, size in zip(starts, sizes, strict=True)
    ]
    return Squares(tuple(map(_rationals, grams[:OWN])), tuple(H))
