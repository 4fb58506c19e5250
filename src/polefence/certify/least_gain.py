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
none where some motions stay unseen for some u and do not grow: the zeros. These are taken off, but
where all motions are such zeros at frequencies: see `Still`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import SolverError
from polefence.certify.regular import (
    Regular,
    dot,
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
FIRST_SHARES = (0.999, 0.99, 0.9, 0.8, 0.6, 0.3, 0.1)  # of what is minimised
LEAST_SHARE = 1e-6
ROUNDS = 12  # of shares
BETTER = 1e-5  # of a level, for which shares are sought on
SMALL = Fraction(1, 10**4)  # of a level, which is no matter
STILL = 1e-9  # of the fastest motion, a decay that is none
MIXED = 1e-6  # of motions of other frequencies, so that rounding leaves Z > 0
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
        form, count = self._form(j), len(self.limits)
        if form is None:
            return None
        levels = np.array([float(limit.level) for limit in self.limits])
        sought = np.arange(count) < (1 if least else count)  # limits whose levels are to grow
        best, found = 0.0, list[tuple[Array, Array]]()

        def better(shares: Array) -> bool:
            """Whether the best Z for these shares is better than what there is."""
            nonlocal best
            Y = form.best(levels**2 / shares * sought, levels**2 / shares * ~sought, gap)
            if Y is None:
                return False
            parts = levels * np.sqrt(form.parts(Y))
            times = (np.sqrt(form.driven(Y)) - parts[~sought].sum()) / parts[sought].sum()
            if not times > best * (1 + BETTER):
                return False
            shares = np.where(sought, times, 1.0) * parts
            shares = np.maximum(shares / shares.sum(), LEAST_SHARE)
            best = times
            found.append((Y, shares / shares.sum()))
            return True

        for first in FIRST_SHARES if count > 1 else (1.0,):
            better(np.append(first, np.full(count - 1, (1 - first) / max(count - 1, 1))))
        for _ in range(ROUNDS if count > 1 else 0):
            if not (found and better(found[-1][1])):
                break
        return self._claim(j, form, *found[-1], least) if found else None

    @property
    def _outputs(self) -> list[Output]:
        return [output for limit in self.limits for output in limit.outputs]

    def _scaled(self, rows: Rationals) -> Rationals:
        if not self.scales:
            return rows
        return [[x * s for x, s in zip(row, self.scales, strict=True)] for row in rows]

    def _form(self, j: int) -> Form | Still | None:
        """Return what Z is made of at a vertex; None if there is nothing known."""
        v = self.plant.vertices[j]
        A, B, E = ([list(row) for row in M or ()] for M in (v.exact_A, v.exact_B, v.exact_E))
        C, D = ([row for y in self._outputs for row in getattr(y, key)[j]] for key in "CD")
        plant = regular(A, B, self._scaled(E), C, D)
        if plant is None:
            return None
        M, R, G = self._parts(j, plant)
        free = len(R) - len(plant.A)
        if not any(map(any, R[:free])) and at_rest(floats(R[free:])):
            M, R, G = M[free:], R[free:], G[free:]
            return Still.of(_lifted(M, plant), floats(M), R, floats(G), self._owner)
        plant = without_zeros(plant, every=True)
        if plant is None:
            return None
        M, R, G = self._parts(j, plant)
        try:
            return Form.of(_lifted(M, plant), floats(M), floats(R), floats(G), self._owner)
        except (SolverError, np.linalg.LinAlgError):
            return None

    def _parts(self, j: int, plant: Regular) -> tuple[Rationals, Rationals, Rationals]:
        """Return M', R and M'[E; F] of a plant of fewer states."""
        n, none = len(plant.A), [_ZERO] * len(plant.E[0])
        F = self._scaled([list(y.F[j][0]) if y.F else none for y in self._outputs])
        basis = null_space(transposed([*plant.D, *plant.B]))  # of outputs first: D has full rank
        M = [[*row[-n:], *row[:-n]] for row in basis]
        return M, product(M, [*plant.A, *plant.C]), product(M, [*plant.E, *F])

    @property
    def _owner(self) -> Index:
        """The number of its limit for each output."""
        sizes = [len(limit.outputs) for limit in self.limits]
        return np.repeat(np.arange(len(sizes)), sizes)

    def _claim(
        self, j: int, form: Form | Still, Y: Array, shares: Array, least: bool
    ) -> GainRefutation | None:
        """Return the claim of Y at the highest level that it proves."""
        Z = product(transposed(form.M), product(form.exact(Y), form.M))
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


def _lifted(M: Rationals, plant: Regular) -> Rationals:
    """Return M' of a plant of fewer states as that of the plant it is of."""
    n = len(plant.A)
    return [[*product([row[:n]], plant.T)[0], *row[n:]] for row in M]


def at_rest(A: Array) -> bool:
    """Whether all motions of a square matrix neither grow nor fade."""
    values = np.linalg.eigvals(A)
    return bool(np.abs(values.real).max() < STILL * np.abs(values).max())


def floats(rows: Rationals) -> Array:
    """Return an array."""
    return np.array([[float(x) for x in row] for row in rows])


@dataclass(frozen=True, eq=False)
class Traces(Short):
    """Z = M Y M' of one vertex, and its traces."""

    M: Rationals
    seen: Array
    G: Array
    owner: Index

    def driven(self, Y: Array) -> float:
        """Return tr G'Y G."""
        return float(np.sum(self.G * (Y @ self.G)))

    def parts(self, Y: Array) -> Array:
        """Return the b of each limit."""
        squares = np.einsum("ki,kl,li->i", self.seen, Y, self.seen)
        return np.asarray(np.bincount(self.owner, np.maximum(squares, 0.0)), dtype=float)

    def forms(self, over: Array, less: Array) -> tuple[Array, Array]:
        """Return the forms of a less sum less b, and of sum over b."""
        unit, rest = ((self.seen * weights[self.owner]) @ self.seen.T for weights in (over, less))
        return self.G @ self.G.T - rest, unit


@dataclass(frozen=True, eq=False)
class Still(Traces):
    """Z where some input keeps every motion out of the outputs, and none grows or fades.

    They are frequencies at which no input changes what a disturbance does to the outputs, such as
    that of a wheel on an undamped tyre to the acceleration of a body. N + N' = 0, which rationals
    have where Y is a combination of solutions of Y R + R'Y = 0.

    Attributes
    ----------
    solutions : list of rationals
        A basis.
    modes : (., k, k) array
        Solutions of one frequency each.
    """

    solutions: list[Rationals]
    modes: Array

    @classmethod
    def of(cls, M: Rationals, both: Array, R: Rationals, G: Array, owner: Index) -> Still:
        """Return it with a basis of solutions."""
        n = len(R)
        pairs = [(i, k) for i in range(n) for k in range(i, n)]
        rows = {pair: [_ZERO] * len(pairs) for pair in pairs}
        for column, (i, k) in enumerate(pairs):
            for a, b in {(i, k), (k, i)}:  # of (Y R)_ac + (Y R)_ca, what Y_ab adds
                for c in range(n):
                    rows[min(a, c), max(a, c)][column] += R[b][c] * (2 if a == c else 1)
        solutions = []
        for vector in null_space(list(rows.values())):
            Y = [[_ZERO] * n for _ in range(n)]
            for (i, k), x in zip(pairs, vector, strict=True):
                Y[i][k] = Y[k][i] = x
            solutions.append(Y)
        vectors = np.linalg.eig(floats(R).T)[1].T
        modes = np.array([np.outer(v, v.conj()).real for v in vectors])
        return cls(M, both[:, n:], G, owner, solutions, modes)

    def best(self, over: Array, less: Array, gap: float) -> Array | None:
        """Return Y of one frequency, and a little of the others; None where that is zero."""
        gained, unit = self.forms(over, less)
        units = np.einsum("kij,ij->k", self.modes, unit)
        values = np.einsum("kij,ij->k", self.modes, gained)
        if not (units > 0).all() or values.max() <= 0:
            return None
        scaled = self.modes / units[:, None, None]
        return np.asarray(scaled[np.argmax(values / units)] + min(gap, MIXED) * scaled.sum(axis=0))

    def exact(self, Y: Array) -> Rationals:
        """Return the solution that is nearest."""
        basis = np.array([floats(S) for S in self.solutions]).reshape(len(self.solutions), -1)
        weights = np.linalg.lstsq(basis.T, Y.ravel(), rcond=None)[0]
        exact, places = list(map(Fraction, weights.tolist())), range(len(Y))
        entries = [[[S[i][k] for S in self.solutions] for k in places] for i in places]
        return [[dot(exact, entry) for entry in row] for row in entries]


@dataclass(frozen=True, eq=False)
class Form(Traces):
    """Z = M Y M' of one vertex, and the maximum over Y, of k rows.

    Attributes
    ----------
    M : rationals
        M', a row for each of Y, of the states and outputs of the plant.
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

    N: Array
    R: Array
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
        return cls(M, seen, G, owner, N, R, (Y + Y.T) / 2)

    def exact(self, Y: Array) -> Rationals:
        """Return Y as it is."""
        return [list(map(Fraction, row)) for row in ((Y + Y.T) / 2).tolist()]

    def best(self, over: Array, less: Array, gap: float) -> Array | None:
        """Return Y of the largest (a - sum less b) / sum over b; None where that is zero.

        Parameters
        ----------
        over, less : arrays
            A weight for each limit.
        """
        gained, unit = self.forms(over, less)
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
                with np.errstate(all="ignore"):
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
        decrement = float(np.sqrt(d @ H @ d))
        if not np.isfinite(decrement):
            raise np.linalg.LinAlgError("a step that is not finite")
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
