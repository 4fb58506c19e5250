"""What no law's gain goes below, and gains that no law has at once: found, for exact proofs.

Of Z in `polefence.proof.claims.gain_conflict` let Z = M Y M', M a basis of what has M'[B; D] = 0:
of states and of outputs that inputs do not move. With M' = [I, Q], M'[A; C] = R and Y > 0,

    maximise  tr [E; F]'Z [E; F] - sum g_i^2 b_i / p_i   subject to   b_0 = 1,   N + N' >= 0

is convex for given shares p; its value times p_0 is the square of a gain that no law within limits
g_i on others goes below. With the sum over all limits equal to 1 in place of b_0, the value is the
square of a factor by which no law keeps them all. In between shares are those that are best for the
Z there is, p_i = g_i sqrt(b_i) of their sum. Solved by a barrier method in the coordinates in which
the matrices are identities at each step; every iterate has Y > 0 and N + N' > 0, so what floats end
at is proved in rationals as it is.

Y starts from a filter that sees all states through the other outputs, backwards in time. There is
none where some motions stay unseen for some u and do not grow: the zeros. These are taken off.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import SolverError
from polefence.certify.regular import (
    Regular,
    null_space,
    product,
    regular,
    transposed,
    without_zeros,
)
from polefence.lmi.conditions.pencil import Index
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.gain_conflict import GainLimit, GainRefutation
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Output
from polefence.proof.short import Short
from polefence.proof.work import FormatError

_ZERO = Fraction(0)
ROUGH = 3e-2  # of a squared gain, how near its largest is known
FINE = (1e-6, 1e-5, 1e-4, 1e-3, ROUGH)  # the same, until there is a proof
GROWTH = 8.0  # of the barrier's weight, from one centre to the next
CENTRED = 0.1  # Newton's decrement
MOST_STEPS = 200
LOST = 1e3  # of its order, a decrement that is none
FAR = 5  # steps to the first centre
NEGLIGIBLE = 1e-6  # of a gain, which is none
FEW = 4  # vertices that are looked at closely
FIRST_SHARES = (0.5, 0.9, 0.1)  # of what is minimised
LEAST_SHARE = 1e-6
ROUNDS = 12  # of shares
BETTER = 1e-5  # of a level, for which shares are sought on
SMALL = Fraction(1, 10**4)  # of a level, which is no matter
ROUNDING = 1e-12  # of a level


@dataclass(frozen=True, eq=False)
class Question(Short):
    """Limits on gains: the least of the first that any law has within the others, or a conflict.

    Attributes
    ----------
    plant : UncertainPlant
    limits : tuple of GainLimit
        Levels above zero; of what is minimised what some law keeps.
    scales : tuple of Fraction
    """

    plant: UncertainPlant
    limits: tuple[GainLimit, ...]
    scales: tuple[Fraction, ...]

    def least(self) -> GainRefutation | None:
        """Return the claim of the highest level of the first limit at any vertex, None if zero."""
        best = self._best(least=True)
        return None if best is None else self._of_fewest(best)

    def refuted(self) -> GainRefutation | None:
        """Return the claim that no law keeps all of the limits, times the largest factor."""
        best = self._best(least=False)
        return None if best is None or best.factor < 1 else best

    def _best(self, least: bool) -> GainRefutation | None:
        rough = list[tuple[float, int]]()
        for j in range(len(self.plant.vertices)):
            found = self._at(j, ROUGH, least)
            if found is not None:
                rough.append((-round(_height(found), 12), j))
        highest = min(rough, default=(0.0, 0))[0] * (1 - ROUGH)
        near = [j for height, j in sorted(rough)[:FEW] if height <= highest]
        known = (self._proved_at(j, least) for j in near)
        return max((found for found in known if found), key=_height, default=None)

    def _proved_at(self, j: int, least: bool) -> GainRefutation | None:
        """Return the claim of a vertex that is as near to its best as rounding leaves it proved."""
        for gap in FINE:
            claim = self._at(j, gap, least)
            with suppress(FormatError):
                if claim is not None and prove(claim).proved:
                    return claim
        return None

    def _of_fewest(self, claim: GainRefutation) -> GainRefutation:
        """Return a claim without the limits that hardly raise its level."""
        for limit in claim.limits[1:]:
            fewer = replace(self, limits=tuple(y for y in claim.limits if y is not limit))
            found = fewer._proved_at(claim.vertex, least=True)
            if found is not None and found.limits[0].level > claim.limits[0].level * (1 - SMALL):
                return fewer._of_fewest(found)
        return claim

    def _at(self, j: int, gap: float, least: bool) -> GainRefutation | None:
        """Return the claim of a vertex, as near to its best as the gap."""
        reduced, count = self._regular(j), len(self.limits)
        form = None if reduced is None else self._form(j, reduced)
        if reduced is None or form is None:
            return None
        levels = np.array([float(limit.level) for limit in self.limits])
        sought = np.arange(count) < (1 if least else count)  # limits whose levels are to grow
        best, found = 0.0, list[tuple[Array, Array]]()
        for first in FIRST_SHARES if count > 1 else (1.0,):
            shares = np.append(first, np.full(count - 1, (1 - first) / max(count - 1, 1)))
            for _ in range(ROUNDS if count > 1 else 1):
                Y = form.best(levels**2 / shares * sought, levels**2 / shares * ~sought, gap)
                if Y is None:
                    break
                parts = levels * np.sqrt(form.parts(Y))
                times = (np.sqrt(form.driven(Y)) - parts[~sought].sum()) / parts[sought].sum()
                if not times > best * (1 + BETTER):
                    break
                shares = np.where(sought, times, 1.0) * parts
                shares = np.maximum(shares / shares.sum(), LEAST_SHARE)
                shares, best = shares / shares.sum(), times
                found.append((Y, shares))
            if found:
                return self._claim(j, reduced, form, *found[-1], least)
        return None

    def _regular(self, j: int) -> Regular | None:
        """Return a vertex of fewer states; None if nothing of it is left."""
        v = self.plant.vertices[j]
        A, B, E = ([list(row) for row in M or ()] for M in (v.exact_A, v.exact_B, v.exact_E))
        C, D = ([row for y in self._outputs for row in getattr(y, key)[j]] for key in "CD")
        found = regular(A, B, self._scaled(E), C, D)
        return None if found is None else without_zeros(found, every=True)

    @property
    def _outputs(self) -> list[Output]:
        return [output for limit in self.limits for output in limit.outputs]

    def _scaled(self, rows: Rationals) -> Rationals:
        if not self.scales:
            return rows
        return [[x * s for x, s in zip(row, self.scales, strict=True)] for row in rows]

    def _form(self, j: int, plant: Regular) -> Form | None:
        """Return what Z is made of; None if there is no Z > 0."""
        n, none = len(plant.A), [_ZERO] * len(plant.E[0])
        F = self._scaled([list(y.F[j][0]) if y.F else none for y in self._outputs])
        basis = null_space(transposed([*plant.D, *plant.B]))  # of outputs first: D has full rank
        M = [[*row[-n:], *row[:-n]] for row in basis]
        R, G = (floats(product(M, rows)) for rows in ([*plant.A, *plant.C], [*plant.E, *F]))
        sizes = [len(limit.outputs) for limit in self.limits]
        owner = np.repeat(np.arange(len(sizes)), sizes)
        try:
            return Form.of(M, floats(M), R, G, owner)
        except (SolverError, np.linalg.LinAlgError):
            return None

    def _claim(
        self, j: int, plant: Regular, form: Form, Y: Array, shares: Array, least: bool
    ) -> GainRefutation | None:
        """Return the claim of Y at the highest level that it proves."""
        M, T = form.M, plant.T
        middle = [list(map(Fraction, row)) for row in ((Y + Y.T) / 2).tolist()]
        lift = [[*product([row[: len(T)]], T)[0], *row[len(T) :]] for row in M]
        Z = product(transposed(lift), product(middle, lift))
        v = self.plant.vertices
        A, B, E = (
            [[list(row) for row in M or ()] for M in matrices]
            for matrices in (
                [x.exact_A for x in v],
                [x.exact_B for x in v],
                [x.exact_E for x in v],
            )
        )
        # rounded down, their sum is not more than 1
        exact = tuple(Fraction(x * (1 - ROUNDING)) for x in shares.tolist())
        claim = GainRefutation(A, B, E, self.limits, j, exact, Z, scales=self.scales)
        first, *others = self.limits
        none = tuple(replace(y, level=_ZERO) for y in others)
        used = claim.allowed_by((replace(first, level=_ZERO), *others)) if least else _ZERO
        unit = claim.allowed_by((first, *none) if least else self.limits)
        square = (claim.driven - used) / unit if unit else _ZERO
        if square <= 0:
            return None
        times = Fraction(float(np.sqrt(float(square))) * (1 - ROUNDING))
        if not least:
            return replace(claim, factor=times)
        return replace(claim, limits=(replace(first, level=first.level * times), *others))


def _height(claim: GainRefutation) -> float:
    """Return what is to be large: the factor and the first level."""
    return float(claim.factor * claim.limits[0].level)


def floats(rows: Rationals) -> Array:
    """Return an array."""
    return np.array([[float(x) for x in row] for row in rows])


@dataclass(frozen=True, eq=False)
class Form(Short):
    """Z = M Y M' of one vertex, and the maximum over Y, of k rows.

    Attributes
    ----------
    M : rationals
        M', a row for each of Y.
    seen : (k, p) array
        Its columns of outputs.
    N, R : (n, k), (k, n) arrays
        N + N' = N Y R + R'Y N'.
    G : (k, q) array
        tr G'Y G is the energy of disturbances.
    owner : (p,) array of int
        The number of its limit for each output.
    start : (k, k) array
    """

    M: Rationals
    seen: Array
    N: Array
    R: Array
    G: Array
    owner: Index
    start: Array

    @classmethod
    def of(cls, M: Rationals, both: Array, R: Array, G: Array, owner: Index) -> Form:
        """Return it with a first Y, of a filter backwards in time.

        Raises
        ------
        SolverError, numpy.linalg.LinAlgError
            If there is none.
        """
        from scipy.linalg import solve_continuous_are

        n = R.shape[1]
        N, seen, free = both[:, :n].T, both[:, n:], len(both) - n
        C, A = R[:free], R[free:]
        rate = np.linalg.norm(A) or 1.0
        unit = np.linalg.norm(C) or 1.0
        C = np.vstack([C / unit, np.zeros((1, n))])
        try:
            X = solve_continuous_are(-A.T, C.T * np.sqrt(rate), rate * np.eye(n), np.eye(free + 1))
        except ValueError as error:
            raise SolverError(f"no filter: {error}") from error
        S = np.linalg.inv((X + X.T) / 2)
        beside = 0.5 * rate / unit * C[:-1]
        first = 2 * beside @ np.linalg.solve(S, beside.T)
        size = np.trace(first) / max(free, 1) or 1.0
        Y = np.block([[first + 0.1 * size * np.eye(free), beside], [beside.T, S]])
        return cls(M, seen, N, R, G, owner, (Y + Y.T) / 2)

    def driven(self, Y: Array) -> float:
        """Return tr G'Y G."""
        return float(np.sum(self.G * (Y @ self.G)))

    def parts(self, Y: Array) -> Array:
        """Return the b of each limit."""
        squares = np.einsum("ki,kl,li->i", self.seen, Y, self.seen)
        return np.asarray(np.bincount(self.owner, np.maximum(squares, 0.0)), dtype=float)

    def best(self, over: Array, less: Array, gap: float) -> Array | None:
        """Return Y of the largest (a - sum less b) / sum over b; None where that is zero.

        Parameters
        ----------
        over, less : arrays
            A weight for each limit.
        """
        unit, rest = ((self.seen * weights[self.owner]) @ self.seen.T for weights in (over, less))
        gained = self.G @ self.G.T - rest
        size = float(np.sum(unit * self.start))
        if not size > 0:
            return None
        Y, order = self.start / size, len(self.start) + len(self.N)
        t = order / (abs(float(np.sum(gained * Y))) + self.driven(Y) or 1.0)
        away, centred, most, best = 0, False, 0.0, None
        for _ in range(MOST_STEPS):
            Y = Y / np.sum(unit * Y)
            value = float(np.sum(gained * Y))
            try:
                step, decrement = self._step(Y, t, gained, unit)
            except np.linalg.LinAlgError:
                break  # no digits are left
            if value > most:
                most, best = value, Y
            if decrement > LOST * order and centred:
                break
            Y, away = Y + step, away + 1
            if decrement > CENTRED:
                if away > FAR and not centred:  # this centre is far away: first a nearer one
                    t, away = t / GROWTH, 0
                continue
            centred, off = True, 2 * order / t
            if value + off <= 0 or off < NEGLIGIBLE**2 * self.driven(Y):
                return None
            if off <= gap * value:
                break
            t *= GROWTH
        return best

    def _step(self, Y: Array, t: float, gained: Array, unit: Array) -> tuple[Array, float]:
        """Return Newton's step to the centre, of the best length, and its decrement."""
        k, half = len(Y), self.N @ Y @ self.R
        L, T = np.linalg.cholesky(Y), np.linalg.cholesky(half + half.T)
        P, R = np.linalg.solve(T, self.N @ L), np.linalg.solve(T, self.R.T @ L).T
        row, column = np.triu_indices(k)
        alone = row == column
        times = np.where(alone, 0.5, np.sqrt(0.5))[:, None, None]
        moved = np.einsum("ac,cb->cab", P[:, row], R[column])
        moved = times * (moved + np.einsum("ac,cb->cab", P[:, column], R[row]))
        moved = moved + np.swapaxes(moved, 1, 2)
        flat = moved.reshape(len(row), -1)
        root = np.where(alone, 1.0, np.sqrt(2.0))
        grown, u = (root * (L.T @ S @ L)[row, column] for S in (gained, unit))
        slope = t * grown + alone + np.einsum("caa->c", moved)
        H = np.eye(len(row)) + flat @ flat.T
        a, b = np.linalg.solve(H, np.column_stack([slope, u])).T
        d = a - b * (u @ a) / (u @ b)
        if not np.isfinite(d).all():
            raise np.linalg.LinAlgError("a step that is not finite")
        decrement = float(np.sqrt(d @ H @ d))
        D = np.zeros((k, k))
        D[row, column] = d / root
        D = D + np.triu(D, 1).T
        spectrum = np.append(np.linalg.eigvalsh(D), np.linalg.eigvalsh(np.tensordot(d, moved, 1)))
        return _longest(spectrum, t * float(grown @ d)) * (L @ D @ L.T), decrement


def _longest(spectrum: Array, slope: float) -> float:
    """Return the maximum of slope x + sum log(1 + spectrum x) on x >= 0, within its domain."""
    least = spectrum.min()
    end = 1 / max(-least, 1e-300)
    x = 0.0
    for _ in range(30):
        rates = spectrum / (1 + x * spectrum)
        first, second = slope + rates.sum(), -(rates**2).sum()
        if not first > 0 or not second < 0:
            break
        further = min(x - first / second, x + 0.9 * (end - x))
        if further - x <= 1e-3 * x:
            x = further
            break
        x = further
    return x
