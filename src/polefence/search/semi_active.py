"""A law for controllable dampers and what is proved of it: a demand K x, cut off to their bounds.

Of all dampers that stay as they are the best one has c0 and u = c0 v, and P of its Lyapunov
equation tells what is still to come from a state. The rate z'z + 2 x'P (A x + B u) is lowest for
another u; cut off to what the dampers can give, that costs on average no more than c0, which a
quadratic V proves. One of a higher degree proves more: it is told by the moments of the times that
the dampers spend at their bounds and in between.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations
from itertools import product as cartesian
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import InputError, NotProvedError, SolverError, require_type
from polefence.base.explained import explained
from polefence.base.processors import small_matrices
from polefence.base.renamed import write_in
from polefence.certify.design import OF_DAMPERS
from polefence.law.laws import FixedGain
from polefence.lmi.solve.moments import Piece, Problem, Visits, inside
from polefence.lmi.solve.quadratic_means import Force, Open, least_mean
from polefence.plant.dampers import Damper
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, choose, states
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import (
    MAX_PIECES,
    Case,
    Clipped,
    Group,
    Squares,
    cases_of,
    groups_of,
    pieces_of,
)
from polefence.proof.claims.refutation import RmsLimit
from polefence.proof.dampers import Curve, SemiActive
from polefence.proof.document import Document
from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import Sizes
from polefence.proof.sectors import GIVEN, Sector, regions_of
from polefence.proof.short import Short
from polefence.proof.squares import count_of, known
from polefence.proof.work import FormatError
from polefence.region.text import digits_up
from polefence.requirements.rms import Rms
from polefence.requirements.weights import with_weights
from polefence.search.damper_motion import ClippedMotion

# How near its end the search comes: what is on the very edge may not survive its rounding.
NEAR = (1e-5, 1e-4, 1e-3)
NEAR_BENT = (1e-2, 3e-2)  # where curves are bent; nearer the exact check mostly failed
DEGREES = (6, 4, 2)
# Unknowns of a degree above 2: what is tried by default, and what is tried at all. (Two dampers of
# a half car, straight, have 9,909 of degree 4 and take 76 s; bent four times, 213,840.)
QUICK, MOST = 8000, 30000
FILE_NAME = OF_DAMPERS
# Of a demand by few signals: the shares of it that are tried, and how near the least bound is good.
SHARES, NEARLY = (1.0, 0.5, 0.25, 0.125, 0.0), 1.02


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
        Of the best dampers that stay as they are; of curves that are bent, see `Unproved`.
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
        """Return it as a file of claims, of the plant with the filters of a weighted rms."""
        plant, _ = with_weights(self.plant, (self.specification,))
        return Document(file_plant(plant), None, (self.claim,), polefence=VERSION)

    def save(self, directory: str | Path) -> Path:
        """Write ``law.json`` into a folder, made if need be; return its path.

        Raises
        ------
        OutputError
            If the folder cannot be written.
        """
        return write_in(directory, FILE_NAME, self.file().dumps())

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
    measured: Sequence[Output | str] | None = None,
) -> SemiActiveLaw:
    """Return a law for controllable dampers, with a proved bound on an rms.

    The bound holds for all values of the parameters. The loop is stable whatever the dampers do
    between their bounds. The best dampers that stay as they are, one for each force, may be as
    good: their rms is ``passive`` of what is returned.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E, the same for all values of the parameters, which do not move.
    specification : Rms
        Of one signal or a vector, weighted or not; its ``at_most`` is not asked for.
    dampers : sequence of Damper
        One for each input; at their lower bounds the loop is stable.
    degree : int, optional
        2, 4, 6 or 8, of the polynomial that proves the bound; by default the highest up to 6 for
        which the search is quick. The higher, the lower the bound.
    K : (m, n) array, optional
        What is demanded, rounded to 32 bits, such as a skyhook's force; by default the law's own.
    measured : sequence of Output or str, optional
        States, or outputs that are sums of states, of which the law's own K is made, and of the
        rates of the dampers; by default all states.

    Returns
    -------
    SemiActiveLaw

    Raises
    ------
    InputError
        If dampers, specification and plant do not fit.
    NotProvedError
        If no bound was proved, saying why and what to change.
    """
    return DamperQuestion.of(plant, specification, dampers, measured).law(degree, K)


@dataclass(frozen=True, eq=False)
class Unproved:
    """What needs no proof: the best dampers that stay as they are, one for each input; a demand.

    Attributes
    ----------
    dampers : tuple of Damper
        In the order of the inputs.
    coefficients : tuple of float
        Of the best dampers that stay. With bent curves a damper that stays is a mean of both, as
        far from the lower one as this is from the least coefficient, on the way to the largest.
    passive : float
        The worst rms with these, at the vertices; with bent curves that of a Gaussian motion,
        with the line in place of the curve that is nearest to it in the mean square.
    K : (m, n) array or None
        What the law of `semi_active` demands; None where no signal has a force in it.
    staying : tuple of Curve
        What the best dampers that stay give.
    """

    dampers: tuple[Damper, ...]
    coefficients: tuple[float, ...]
    passive: float
    K: Array | None
    staying: tuple[Curve, ...]


@small_matrices()
def unproved(
    plant: UncertainPlant,
    specification: Rms,
    dampers: Sequence[Damper],
    measured: Sequence[Output | str] | None = None,
) -> Unproved:
    """Return the best dampers that stay as they are, and what the law of `semi_active` demands.

    Raises
    ------
    InputError
        If dampers, specification and plant do not fit.
    NotProvedError
        If no dampers keep every vertex stable.
    """
    return DamperQuestion.of(plant, specification, dampers, measured).unproved


def _even(degree: int) -> int:
    if degree not in (2, 4, 6, 8):
        raise InputError(f"degree = {degree!r} must be 2, 4, 6 or 8")
    return degree


@dataclass(frozen=True, eq=False)
class _Evidence:
    """A bound over the square of the passive rms, V of each vertex, and what proves it."""

    level: float
    V: Array
    pieces: tuple[Squares, ...] = ()
    sectors: tuple[Sector, ...] = ()


@dataclass(frozen=True, eq=False)
class DamperQuestion:
    """The plant in floats, E with the noise in it, and the law.

    ``larger`` is the plant with the filters of a weighted specification, ``bare`` that of the
    filtered signals; the arrays are of these. ``seen`` has the signals that the law knows, by the
    plant's states.
    """

    plant: UncertainPlant
    specification: Rms
    larger: UncertainPlant
    bare: Rms
    dampers: tuple[Damper, ...]
    exact: tuple[SemiActive, ...]
    A: Array
    B: Array
    E: Array
    C: Array
    D: Array
    rates: Array
    seen: Array

    @classmethod
    def of(
        cls,
        plant: UncertainPlant,
        specification: Rms,
        dampers: Sequence[Damper],
        measured: Sequence[Output | str] | None = None,
    ) -> DamperQuestion:
        """Return the question.

        Raises
        ------
        InputError
            If something does not fit.
        """
        require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
        require_type(specification, Rms, "specification", "for example Rms('acceleration')")
        if plant.sample_time is not None:
            raise InputError(
                f"{plant.name} is in discrete time; controllable dampers need continuous time"
            )
        specification.require_fit(plant)
        larger, filtered = with_weights(plant, (specification,))
        bare = next(signal for signal in filtered if isinstance(signal, Rms))
        pairs = sorted(
            ((damper.of(larger), damper) for damper in dampers), key=lambda pair: pair[0].number
        )
        exact = tuple(damper for damper, _ in pairs)
        if [damper.number for damper in exact] != list(range(plant.shape[1])):
            raise InputError(f"{plant.name}: give one damper for each of {plant.shape[1]} inputs")
        E = bare.entering(larger) * (bare.density / 2) ** 0.5
        outputs, N = bare.exact_outputs(larger), len(plant.A)
        C, D = (
            np.array([[_row(getattr(y, k)[j]) for y in outputs] for j in range(N)]) for k in "CD"
        )
        rates = np.array([[_row(damper.rate[j]) for damper in exact] for j in range(N)])
        seen = np.eye(plant.shape[0])
        if measured is not None:
            seen = np.vstack([_sums_of_states(plant, measured), rates[0][:, : plant.shape[0]]])
        asked = (plant, specification, larger, bare, tuple(damper for _, damper in pairs))
        return cls(*asked, exact, larger.A, larger.B, E, C, D, rates, seen)

    @property
    def unproved(self) -> Unproved:
        """What needs no proof.

        Raises
        ------
        NotProvedError
            If no dampers keep every vertex stable.
        """
        passive, K = self.passive, None
        with suppress(NotProvedError):
            K = self.rounded
        shares = (self.best - self.bounds[:, 0]) / np.ptp(self.bounds, axis=1)
        staying = tuple(
            damper.between(Fraction(f"{share:.4f}"))
            for damper, share in zip(self.exact, shares, strict=True)
        )
        return Unproved(self.dampers, tuple(self.best.tolist()), passive, K, staying)

    def law(self, degree: int | None = None, K: Any = None, quick: int = QUICK) -> SemiActiveLaw:
        """Return the law of `semi_active`, by default of no more unknowns than are quick.

        Raises
        ------
        InputError
            If K does not fit.
        NotProvedError
            If no bound was proved, saying why and what to change.
        """
        self.require_provable()
        given = None if K is None else FixedGain(K).K
        if given is not None and given.shape != self.plant.shape[::-1]:
            m, n = self.plant.shape[::-1]
            raise InputError(f"K is {given.shape[0]} x {given.shape[1]}, not {m} x {n}")
        few = [even for even in DEGREES if even == DEGREES[-1] or self.moments(even) <= quick]
        tried = few if degree is None else [_even(degree)]
        for even in tried:
            if even > DEGREES[-1]:
                self.require_bearable(even)
            law = self.proved(even, given)
            if law is not None:
                return law
        degrees = " or ".join(map(str, tried))
        raise self.refusal(f"no polynomial of degree {degrees} was found that does", self.narrower)

    def require_provable(self) -> None:
        """Refuse what no bound is proved of.

        Raises
        ------
        NotProvedError
            Saying why, and what to change.
        """
        if moving := [p.name for p in self.plant.parameters if p.rate is not None]:
            raise self.refusal(
                f"{' and '.join(moving)} moves; bounds are proved for constant parameters",
                "leave out the rate",
            )
        if np.ptp(self.E, axis=0).any() or np.ptp(self.rates, axis=0).any():
            raise self.refusal(
                "how the disturbance enters, or a damper's rate, changes with a parameter",
                "choose states so that they do not",
            )
        _ = self.passive  # without it there is nothing to be better than
        for j, loop in enumerate(self.loops(self.bounds[:, 0])):
            if np.linalg.eigvals(loop).real.max() >= 0:
                ends = zip(self.dampers, self.bounds, strict=True)
                lows = " and ".join(f"{damper.force} = {low:g} v" for damper, (low, _) in ends)
                raise self.refusal(
                    f"with all dampers at their lower bounds, {lows}, vertex {j + 1} is not stable",
                    f"raise the lower bound of damper {self.dampers[0].force}",
                )

    def require_bearable(self, degree: int) -> None:
        """Refuse a degree above 2 for which there is too much to search, or to check.

        Raises
        ------
        NotProvedError
            Saying how much, and what to change.
        """
        pieces, moments = self.pieces, self.moments(degree)
        if pieces > MAX_PIECES or moments > MOST:
            raise self.refusal(
                f"degree {degree} has {pieces:,} pieces and about {moments:,} unknowns, of "
                f"{MAX_PIECES:,} and {MOST:,} at most",
                "take degree 2, which has no pieces, or give fewer points",
            )

    def refusal(self, why: str, remedy: str) -> NotProvedError:
        """Return that no bound is proved, why, and what to change."""
        title = self.specification.title
        return NotProvedError(f"{self.plant.name}: no bound on {title} is proved: {why}; {remedy}")

    @property
    def narrower(self) -> str:
        """What to change where the search fails."""
        wide = max(self.plant.parameters, key=_width, default=None)
        names = f"narrow the range of {wide.name}, or " if wide is not None else ""
        return f"{names}raise the lower bound of damper {self.dampers[0].force}"

    @cached_property
    def bounds(self) -> Array:
        """The least and the largest coefficients."""
        return np.array([[float(c) for c in damper.ends] for damper in self.exact])

    @property
    def even(self) -> bool:
        """Whether the motion and its mirror image are alike."""
        return all(damper.straight for damper in self.exact)

    def moments(self, degree: int) -> int:
        """Return about how many unknowns there are."""
        return self.pieces * count_of(self.A.shape[1], degree, self.even)

    @property
    def pieces(self) -> int:
        """Return in how many the motion is proved."""
        cases = prod(damper.case_count for damper in self.exact)
        return len(groups_of(self.sizes)) * cases

    @property
    def sizes(self) -> Sizes:
        """Corners of each simplex of alpha."""
        return file_plant(self.plant).sizes

    def stays(self, j: int, c: Array) -> Array:
        """Return the gain of dampers that stay at a vertex, from coefficients.

        Of bent curves it is that of the lines nearest to them in the mean square, for the Gaussian
        motion with these lines: their slopes in the mean (Stein).
        """
        slopes = c
        for _ in range(0 if self.even else 30):
            A, _ = self.loop(j, slopes[:, None] * self.rates[j])
            if np.linalg.eigvals(A).real.max() >= 0:
                break
            X = _lyapunov(A, -self.E[j] @ self.E[j].T)
            spread = np.sqrt(np.einsum("ki,ij,kj->k", self.rates[j], X, self.rates[j]))
            last, slopes = slopes, self.mean_slopes(c, spread)
            if np.allclose(last, slopes, rtol=1e-6, atol=0):
                break
        return np.asarray(slopes[:, None] * self.rates[j])

    @cached_property
    def ranges(self) -> list[tuple[Array, Array, Array]]:
        """Each damper's ends of the ranges of its rate, and the slopes of both curves in them."""
        found = []
        for damper in self.exact:
            ends = [
                -np.inf,
                *(float(end) for _, end in damper.parts[:-1] if end is not None),
                np.inf,
            ]
            lines = [damper.lines(part) for part in damper.parts]
            low, high = (np.array([own[k][0] for own in lines], float) for k in (0, 1))
            found.append((np.array(ends), low, high))
        return found

    def mean_slopes(self, c: Array, spread: Array) -> Array:
        """Return the curves' slopes in the mean, for Gaussian rates of a spread."""
        from scipy.special import ndtr

        shares = (c - self.bounds[:, 0]) / (self.bounds[:, 1] - self.bounds[:, 0])
        within = (
            np.diff(ndtr(ends / sigma))
            for (ends, *_), sigma in zip(self.ranges, spread, strict=True)
        )
        return np.array(
            [
                part @ (low + share * (high - low))
                for part, (_, low, high), share in zip(within, self.ranges, shares, strict=True)
            ]
        )

    def loops(self, c: Array) -> list[Array]:
        """Return A of the loops with forces of these coefficients times the rates."""
        return [self.loop(j, c[:, None] * self.rates[j])[0] for j in range(len(self.A))]

    @cached_property
    def kept(self) -> list[Array]:
        """A of the loops with the best dampers that stay."""
        return [self.loop(j, self.stays(j, self.best))[0] for j in range(len(self.A))]

    def loop(self, j: int, gain: Array) -> tuple[Array, Array]:
        """Return A and C of a closed loop at a vertex."""
        return self.A[j] + self.B[j] @ gain, self.C[j] + self.D[j] @ gain

    def each_rms(self, c: Array) -> list[float]:
        """Return the rms with these coefficients at every vertex, infinite where not stable."""
        values = [self.rms_at(j, c) for j in range(len(self.A))]
        return values if np.all(np.isfinite(values)) else [np.inf] * len(values)

    def rms_at(self, j: int, c: Array) -> float:
        """Return the rms with these coefficients at a vertex, infinite where it is not stable."""
        A, C = self.loop(j, self.stays(j, c))
        if np.linalg.eigvals(A).real.max() >= 0:
            return float(np.inf)
        X = _lyapunov(A, -self.E[j] @ self.E[j].T)
        return float(np.sqrt(np.trace(C @ X @ C.T)))

    def rms(self, c: Array) -> float:
        """Return the worst rms with these coefficients, infinite where one is not stable."""
        return max(self.each_rms(c))

    @cached_property
    def hardest(self) -> int:
        """The vertex where the best dampers that stay have the largest rms."""
        values = self.each_rms(self.best)
        # others that are so near are as large: the first counts
        return next(j for j, value in enumerate(values) if value > (1 - 1e-9) * max(values))

    @cached_property
    def best(self) -> Array:
        """The coefficients of the best dampers that stay, to a few digits.

        One after the other from bound to bound, until none changes.
        """
        # of a damper from zero on, a geometric row needs another start
        bounds = [(low, high, max(low, 1e-3 * high)) for low, high in self.bounds]
        c = np.array([np.sqrt(start * high) for _, high, start in bounds])
        for _ in range(10):
            last = c.copy()
            for k, (low, high, start) in enumerate(bounds):
                grid = [float(f"{x:.3g}") for x in np.geomspace(start, high, 60)]
                grid = grid if low == start else [low, *grid]
                tried = [c.copy() for _ in grid]
                for candidate, x in zip(tried, grid, strict=True):
                    candidate[k] = min(max(x, low), high)
                c = tried[self._lowest(tried)]
            if np.array_equal(c, last):
                break
        return c

    def _lowest(self, tried: Sequence[Array]) -> int:
        """Return the number of the first coefficients with the least of the worst rms.

        Of others only as many vertices are asked as show that they have more.
        """
        least, best = np.inf, 0
        order = list(range(len(self.A)))
        for k, c in enumerate(tried):
            worst = 0.0
            for j in list(order):
                worst = max(worst, round(self.rms_at(j, c), 12))
                if worst >= least:
                    order.remove(j)
                    order.insert(0, j)  # likely the worst of the next ones too
                    break
            else:
                least, best = worst, k
        return best

    @cached_property
    def passive(self) -> float:
        """The worst rms with the best dampers that stay.

        Raises
        ------
        NotProvedError
            If none keeps every vertex stable.
        """
        value = self.rms(self.best)
        if not np.isfinite(value):
            raise NotProvedError(
                f"{self.plant.name}: no dampers that stay, between their bounds, keep it stable "
                "for every value; nothing is proved of those that change"
            )
        return value

    @cached_property
    def demand(self) -> Array:
        """K of the law's own, from the vertex where the best dampers that stay cost most.

        There it costs no more than they do. (Of 17 cars with loads of 20 % to 100 %, tyres
        uncertain or not, its bound is up to 3 % below that of one from the mean of the vertices.)

        z'z + 2 x'P (A x + B u) is at most its value and slope at u0 = c v, and (u - u0)'R0 (u - u0)
        with a diagonal R0: of this each force by itself is the least. Behind a filter a force does
        not show, R is zero: R0 is that of the signals before their filters, which hold it where it
        is felt most. What is asked of a state that the law does not know, such as a filter's, is
        asked of its mean, given what it knows. (Of three cars with Wk this is in drives within
        0.2 % of the demand with the filter's states, or better, and proves 0.3 % to 0.7 % less.)
        """
        A, B, C, D = (M[self.hardest] for M in (self.A, self.B, self.C, self.D))
        u0 = self.stays(self.hardest, self.best)
        loop, out, E = A + B @ u0, C + D @ u0, self.E[self.hardest]
        P = _lyapunov(loop.T, -out.T @ out)
        R, R0 = D.T @ D, np.abs(self.shown.T @ self.shown).sum(axis=1)
        if not R0.any():
            raise self.refusal("it has no force in it", "add an acceleration, or a force")
        R0 = np.maximum(R0, 1e-3 * R0.max())
        K = u0 - (R @ u0 + B.T @ P + D.T @ C) / R0[:, None]
        X = _lyapunov(loop, -E @ E.T)
        seen = np.pad(self.seen, ((0, 0), (0, len(A) - self.seen.shape[1])))
        both = seen @ X @ seen.T  # singular where one of them is a sum of others
        return np.asarray(K @ X @ seen.T @ np.linalg.pinv(both, 1e-12, hermitian=True) @ self.seen)

    @cached_property
    def rounded(self) -> Array:
        """K of the law's own in 32 bits, so that what is proved is what a microprocessor has.

        A law that does not know all states may ask for what harms: of its difference to the best
        dampers that stay it takes the largest share with a quadratic bound near the least. (A
        quarter car whose deflection alone is measured has 1.43 proved of the whole demand.)
        """
        whole, n = self.demand, self.plant.shape[0]
        if np.linalg.matrix_rank(self.seen) == n:
            return _in_32_bits(whole)
        stays = self.stays(self.hardest, self.best)[:, :n]
        tried, levels = [_in_32_bits(stays + share * (whole - stays)) for share in SHARES], []
        for K in tried:
            levels.append(np.inf)
            with suppress(SolverError):
                levels[-1] = self.quadratic(self.padded(K))(NEAR[-1]).level
        return next(K for K, g in zip(tried, levels, strict=True) if g <= NEARLY**2 * min(levels))

    def padded(self, K: Array) -> Array:
        """Return K of all states, those of filters too, which stay out."""
        return np.pad(K, ((0, 0), (0, len(self.units) - K.shape[1])))

    @property
    def shown(self) -> Array:
        """How forces show in the signals before their filters, at the hardest vertex."""
        signals = self.specification.outputs(self.plant)
        return np.array([signal.arrays(self.plant)[1][self.hardest] for signal in signals])

    @cached_property
    def mean(self) -> Array:
        """A with the best dampers that stay, the mean of the vertices."""
        return np.asarray(np.mean(self.kept, axis=0))

    @cached_property
    def units(self) -> Array:
        """What each state has of its rms, in powers of two: the evidence stays short in them.

        Raises
        ------
        NotProvedError
            If the disturbance does not reach a state.
        """
        from scipy.linalg import matrix_balance

        balanced, (scale, _) = matrix_balance(self.mean, permute=False, separate=True)
        E = self.E[0] / scale[:, None]
        X = np.diag(_lyapunov(balanced, -E @ E.T))
        for state, variance in zip(states(self.larger), X, strict=True):
            if not variance > 1e-12 * X.max():
                raise self.refusal(
                    f"no disturbance reaches {state.name}", "leave that state out of the plant"
                )
        return _powers(np.sqrt(X) * scale)

    @property
    def motion(self) -> Array:
        """Covariance of the states in units, with the best dampers that stay."""
        back = 1 / self.units
        E = back[:, None] * self.E[0]
        return _lyapunov(back[:, None] * self.mean * self.units, -E @ E.T)

    def proved(self, degree: int, given: Array | None = None) -> SemiActiveLaw | None:
        """Return the law with what is proved of it by this degree, None if nothing is."""
        passive, X = self.passive, self.common  # first of all: quick, and the others need them
        gains = self.rounded if given is None else _in_32_bits(given)
        K = self.padded(gains)
        quadratic = degree == DEGREES[-1]
        search = self.quadratic(K) if quadratic else self.polynomial(K, degree)
        for tolerance in NEAR if self.even or quadratic else NEAR_BENT:
            with suppress(SolverError, FormatError, np.linalg.LinAlgError):
                found = search(tolerance)
                level = passive * float(np.sqrt(found.level)) * (1 + 1e-7)
                claim = self.claim(K, X, level, degree, found)
                verdict = prove(claim)
                if verdict.proved:
                    asked = (self.plant, self.specification, self.dampers)
                    stays = (tuple(self.best.tolist()), passive)
                    return SemiActiveLaw(*asked, gains, level, *stays, claim, verdict.reason)
        return None

    def polynomial(self, K: Array, degree: int) -> Callable[[float], _Evidence]:
        """Return the search for a polynomial with what it fulfils in each piece."""
        pairs = zip(_rationals(K), self.exact, strict=True)
        cases = [cases_of(row, damper) for row, damper in pairs]
        choices = pieces_of(self.sizes, list(map(len, cases)))
        pieces = [
            self.piece(group, [own[k] for own, k in zip(cases, choice, strict=True)])
            for group, choice in choices
        ]
        visits = list[Visits]() if self.even else self.motion_of(cases).visits(degree)
        problem = Problem([piece for piece, _ in pieces], degree, self.even, visits)

        def searched(tolerance: float) -> _Evidence:
            mean = problem.solved(tolerance)
            squares = tuple(
                _squares(matrices, size, 1 + self.even)
                for matrices, (_, size) in zip(mean.grams, pieces, strict=True)
            )
            return _Evidence(mean.level, mean.V, pieces=squares)

        return searched

    def quadratic(self, K: Array) -> Callable[[float], _Evidence]:
        """Return the search for quadratic functions with forms of each damper's demand and force.

        Demands and forces are in units of what the best dampers that stay have, rates of theirs.
        """
        S, back, (m, n) = np.diag(self.units), np.diag(1 / self.units), K.shape
        rates = self.rates[0] * self.units
        v = _powers(np.sqrt(np.einsum("ki,ij,kj->k", rates, self.motion, rates)))
        u, forces, norms = _powers(v * self.best), list[Force](), list[list[Array]]()
        for k, damper in enumerate(self.exact):
            place, size = np.zeros((4, n + m + 1)), np.array([u[k], v[k], 1.0])
            place[0, :n], place[1, :n] = K[k] * self.units / u[k], rates[k] / v[k]
            place[2, n + k] = place[3, -1] = 1.0
            regions = [
                (np.array(region.force, float) * size / u[k], np.array(region.lines, float) * size)
                for region in regions_of(damper)
            ]
            norms.append([_powers(np.abs(lines).max(axis=1)) for _, lines in regions])
            each = zip(regions, norms[-1], strict=True)
            scaled = [(force, tuple(lines / norm[:, None])) for (force, lines), norm in each]
            forces.append(Force(place, tuple(scaled)))
        zero = [np.zeros((len(M[0]), 1)) for M in (self.A, self.C)]
        vertices = zip(self.A, self.B, self.C, self.D, strict=True)
        rows = [
            (np.hstack([back @ A @ S, back @ B * u, zero[0]]), np.hstack([C @ S, D * u, zero[1]]))
            for A, B, C, D in vertices
        ]
        question = Open(
            [moved for moved, _ in rows],
            [signals / self.passive for _, signals in rows],
            back @ self.E[0],
            groups_of(self.sizes),
            forces,
        )
        start = [S @ X @ S for X in self.common]

        def searched(tolerance: float) -> _Evidence:
            found, sectors = least_mean(question, start, self.even, tolerance), list[Sector]()
            for k, (form, shares) in enumerate(zip(found.forms, found.shares, strict=True)):
                scale = 1 / np.array([u[k], v[k], u[k], 1.0])
                raw = [
                    share / np.prod(list(combinations(norm, 2)), axis=1)
                    for share, norm in zip(shares, norms[k], strict=True)
                ]
                own = tuple(tuple(map(Fraction, share.tolist())) for share in raw)
                sectors.append(Sector(_rationals(scale[:, None] * form * scale), own))
            V = [_coefficients(both, known(n, 2, self.even)[1:]) for both in found.V]
            return _Evidence(found.level, np.array(V), sectors=tuple(sectors))

        return searched

    def motion_of(self, cases: Sequence[Sequence[Case]]) -> ClippedMotion:
        """Return the motion with dampers cut off to their bounds, in units."""
        back = 1 / self.units
        poles = [np.linalg.eigvals(loop) for c in self.bounds.T for loop in self.loops(c)]
        return ClippedMotion(
            back[:, None] * self.A * self.units,
            back[:, None] * self.B,
            back[:, None] * self.E[0],
            self.motion,
            self.rates[0] * self.units,
            self.exact,
            cases,
            self.units,
            groups_of(self.sizes),
            max(float(np.abs(own).max()) for own in poles),
            min(float(-np.linalg.eigvals(loop).real.max()) for loop in self.kept),
        )

    def claim(
        self,
        K: Array,
        X: Sequence[Array],
        level: float,
        degree: int,
        found: _Evidence,
    ) -> Clipped:
        """Return the claim with its evidence."""
        plant, spec = file_plant(self.larger), self.bare
        outputs, intensity = spec.exact_outputs(self.larger), Fraction(spec.density) / 2
        return Clipped(
            plant.A,
            plant.B,
            plant.E,
            RmsLimit(outputs, Fraction(level), intensity),
            self.exact,
            _rationals(K),
            degree,
            tuple(_rationals([self.units])[0]),
            [_rationals(matrix) for matrix in X],
            tuple(map(tuple, _rationals(found.V))),
            found.pieces,
            tuple(map(Fraction, spec.scales(self.larger))),
            self.sizes,
            found.sectors,
        )

    def piece(self, group: Group, cases: Sequence[Case]) -> tuple[Piece, list[float]]:
        """Return a piece in units, its cost over the square of the passive's, its forms' sizes."""
        back, S = np.diag(1 / self.units), np.diag([*self.units, 1.0])
        forms, sizes = list[Array](), list[float]()
        for case in cases:
            for exact in case.forms:
                form = S @ np.array(exact, float) @ S
                sizes.append(float(np.abs(form).max()))
                forms.append(form / sizes[-1])
        forces = np.array([case.force for case in cases], float)
        loops = [
            tuple(np.pad(M, ((0, 0), (0, 1))) + P @ forces for M, P in pairs)
            for pairs in zip(
                zip(self.A, self.B, strict=True), zip(self.C, self.D, strict=True), strict=True
            )
        ]
        outs = [out @ S / self.passive for _, out in loops]
        Q = np.sum([outs[j].T @ outs[k] for j, k in group], axis=0)
        motions = tuple((j, back @ loops[k][0] @ S) for j, k in group)
        terms = (len(group), motions, back @ self.E[0], (Q + Q.T) / 2, tuple(forms))
        return Piece(*terms, all(case.what != GIVEN for case in cases)), sizes

    @cached_property
    def common(self) -> list[Array]:
        """X > 0 for each vertex, affine in alpha, with X A + A'X < 0 whatever the dampers do.

        Found from those of the loops with the best dampers that stay.
        """
        S, back, n, N = np.diag(self.units), np.diag(1 / self.units), len(self.units), len(self.A)
        rows, columns = np.tril_indices(n)
        basis = np.zeros((len(rows), n, n))
        basis[range(len(rows)), rows, columns] = basis[range(len(rows)), columns, rows] = 1.0
        count = len(basis)
        F = list[Array]()
        for j in range(N):
            F.append(np.zeros((N * count, n, n)))
            F[-1][j * count : (j + 1) * count] = basis
        for c in cartesian(*self.bounds):
            loops = [back @ loop @ S for loop in self.loops(np.array(c))]
            for group in groups_of(self.sizes):
                F.append(np.zeros((N * count, n, n)))
                for j, k in group:
                    XA = basis @ loops[k]
                    F[-1][j * count : (j + 1) * count] -= XA + XA.swapaxes(1, 2)
        x = [_lyapunov((back @ loop @ S).T, -np.eye(n))[rows, columns] for loop in self.kept]
        trace = np.tile(np.trace(basis, axis1=1, axis2=2), N)[:, None, None]
        try:
            solution = inside(
                [(0, f) for f in F], np.concatenate(x), trace, np.zeros((0, N * count))
            )
        except SolverError as error:
            raise self.refusal(
                "no quadratic function was found that falls whatever the dampers do", self.narrower
            ) from error
        vectors = np.split(solution, N)
        return [back @ np.tensordot(vector, basis, 1) @ back for vector in vectors]


def _lyapunov(A: Any, Q: Any) -> Array:
    """Return X with A X + X A' = Q."""
    from scipy.linalg import solve_continuous_lyapunov

    return np.asarray(solve_continuous_lyapunov(A, Q), dtype=np.float64)


def _in_32_bits(K: Array) -> Array:
    return np.asarray(K, np.float32).astype(float)


def _powers(values: Array) -> Array:
    """Return the powers of two next to them."""
    return np.asarray(2.0 ** np.round(np.log2(values)), dtype=np.float64)


def _coefficients(both: Array, monomials: Sequence[Sequence[int]]) -> list[float]:
    """Return those of x'P x + 2 p'x, of (P, p) as one matrix by (x, 1)."""
    last = len(both) - 1
    places = [[i for i, power in enumerate(e) for _ in range(power)] for e in monomials]
    pairs = [(own[0], own[1] if len(own) == 2 else last) for own in places]
    return [float(both[i, k]) * (1 if i == k else 2) for i, k in pairs]


def _sums_of_states(plant: UncertainPlant, measured: Sequence[Output | str]) -> Array:
    """Return signals by the states.

    Raises
    ------
    InputError
        If one is no fixed sum of states.
    """
    rows = list[Array]()
    for signal in choose(plant, measured):
        C, D, F = signal.arrays(plant)
        if np.ptp(C, axis=0).any() or D.any() or F.any():
            raise InputError(
                f"measured: {signal.name} is not a fixed sum of states, which a law of "
                "controllable dampers needs; name velocities or deflections"
            )
        rows.append(C[0])
    return np.array(rows)


def _width(parameter: Parameter) -> float:
    """Return how wide a range is beside its larger end."""
    return float((parameter.high - parameter.low) / max(abs(parameter.high), abs(parameter.low)))


def _row(row: Rationals) -> list[float]:
    return [float(x) for x in row[0]]


def _rationals(matrix: Any) -> Rationals:
    return [[Fraction(float(x)) for x in row] for row in matrix]


def _squares(grams: Sequence[Array], sizes: Sequence[float], own: int) -> Squares:
    """Return a piece's matrices as a claim has them: ``own`` first, then those of its forms."""
    count = (len(grams) - own) // len(sizes)
    starts = [own + k * count for k in range(len(sizes))]
    H = [
        tuple(_rationals(G / size) for G in grams[start : start + count])
        for start, size in zip(starts, sizes, strict=True)
    ]
    return Squares(tuple(map(_rationals, grams[:own])), tuple(H))
