"""Counterexamples: alphas whose poles leave a region, found in floats, confirmed exactly."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np

from polefence.base.errors import PlantError
from polefence.law.laws import right_divide
from polefence.plant.controllability import fixed_modes
from polefence.plant.family import UncertainPlant
from polefence.plant.points import SEED, exact_alpha, sample
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import matrices, roots, work
from polefence.proof.claims.poles import Poles
from polefence.proof.matrices import Rationals, mix
from polefence.proof.regions import Ellipse, Part, Side, parts_of
from polefence.proof.roots import Outside
from polefence.region.regions import Region, region_of

Measure = Callable[[Any], Array]

CHUNK = 2000
STARTS = 4
FEW = 8  # states, of which a characteristic polynomial takes 1 ms
TIE = 1e-9  # share by which measures differ that rounding does not explain


def counterexample(claim: Poles) -> list[Fraction] | None:
    """Return an alpha at which a pole does not lie in the region, or None if none was found.

    A float search over corners, edges and a seeded sample, refined around the worst points; the
    alpha returned was confirmed in exact arithmetic.
    """
    region = region_of([(part.kind, part.numbers) for part in claim.region])
    for point, worst in worst_points(claim, lambda poles: region.distance(poles).max(axis=-1)):
        if worst < -1e-6 * region.size:
            continue
        alpha = exact_alpha(point, claim.sizes, _fine)
        with suppress(work.FormatError):  # more work than is done here: undecided
            if refutes(claim, alpha):
                return alpha
    return None


def refutes(claim: Poles, alpha: list[Fraction]) -> bool:
    """Whether a pole at alpha is proved not to lie in the region."""
    return leaves(claim.fraction_at(alpha), claim.region, claim.off_at(alpha))


def worst_points(claim: Poles, measure: Measure) -> Iterator[tuple[Array, float]]:
    """Yield points of the domain where a measure of the poles is large, and its value, in floats.

    Parameters
    ----------
    measure : callable
        Of poles (..., n), the larger the worse; infinite where the law has no value.
    """
    domain = Domain(claim.sizes)
    family = _Family(claim, domain, measure)
    points = sample(domain, len(claim.A[0]))
    values = np.concatenate(
        [family.values(points[k : k + CHUNK]) for k in range(0, len(points), CHUNK)]
    )
    # of those that only rounding tells apart the first, not the one that it favours
    top = float(values.max())
    tied = values >= (top - TIE * abs(top) if np.isfinite(top) else top)
    for index in np.argsort(-np.where(tied, top, values), kind="stable")[:STARTS]:
        yield _climb(family, points[index], float(values[index]))


def first_worst(points: Iterable[tuple[Array, float]]) -> tuple[Array, float]:
    """Return the first of points whose measure is the largest, but for rounding."""
    measured = list(points)
    top = max(worst for _, worst in measured)
    least = top - TIE * abs(top) if np.isfinite(top) else top
    return next((point, worst) for point, worst in measured if worst >= least)


def unplaceable(plant: UncertainPlant, region: Region, on: str) -> str | None:
    """Say at which alpha no gain whatever keeps all poles in the region, None if none was found.

    There the plant is uncontrollable and a mode that no gain moves does not lie in the region, both
    in exact arithmetic. Looks at corners, at the middles between them, and at simple fractions near
    the points where a float search finds the plant nearest to uncontrollable.
    """
    domain = Domain.of(on, len(plant.vertices))
    points = sample(domain, plant.shape[0])
    alphas = domain.alpha(points)
    A, B = plant.at(alphas)
    nearest = np.argsort(_controllability(A, B))[:STARTS]
    corners = domain.monomials(1)
    tried = [_simple(np.array(c, dtype=float), domain.sizes) for c in corners]
    tried += [
        _simple((np.array(c, dtype=float) + np.array(d, dtype=float)) / 2, domain.sizes)
        for c, d in combinations(corners[:16], 2)
    ]
    tried += [_simple(points[i], domain.sizes, limit) for i in nearest for limit in (2, 4, 10, 100)]
    parts = parts_of(region.document())
    n, m = plant.shape
    for alpha in tried[: int(4e6 / (n * (n + m) * len(plant.vertices)))]:
        matrices = ([getattr(v, f"exact_{x}") for v in plant.vertices] for x in "AB")
        A_, B_ = (tuple(map(tuple, mix(alpha, list(M)))) for M in matrices)
        with suppress(PlantError, work.FormatError), work.counted():
            fixed = fixed_modes(A_, B_)
            if not fixed.count or roots.roots_inside(list(fixed.polynomial), parts, fixed.whole):
                continue
            weights = ", ".join(str(a) for a in alpha)
            return f"at alpha = ({weights}) a pole outside {region} cannot be moved by any gain"
    return None


def _controllability(A: Array, B: Array) -> Array:
    """Return the least singular value of [B, AB, ...], columns scaled, at each point."""
    scale = np.maximum(np.linalg.norm(A, axis=(1, 2)), np.finfo(float).tiny)[:, None, None]
    columns = [B]
    for _ in range(A.shape[-1] - 1):
        columns.append(A @ columns[-1] / scale)
    return np.asarray(np.linalg.svd(np.concatenate(columns, axis=2), compute_uv=False)[:, -1])


def _simple(coordinates: Array, sizes: tuple[int, ...], limit: int = 2) -> list[Fraction]:
    """Return alpha at fractions of a small denominator near a point."""
    return exact_alpha(coordinates, sizes, lambda c: Fraction(c).limit_denominator(limit))


def _fine(value: float) -> Fraction:
    return Fraction(round(value * 2**30), 2**30)


class _Family:
    """The claim's closed loops as floats, and a measure of their poles."""

    def __init__(self, claim: Poles, domain: Domain, measure: Measure) -> None:
        self.A, self.B = (np.array(M, dtype=float) for M in (claim.A, claim.B))
        near = claim.remainder
        self.curve = np.array(() if near is None else near.curve, dtype=float)
        self.degree = 1 if near is None else near.degree
        self.domain, self.law, self.measure = domain, claim.law, measure
        law = claim.law
        self.K = None if law.K is None else np.array(law.K, dtype=float)
        self.C = np.array(law.C, dtype=float) if law.C else None
        if self.K is None:
            self.W, self.Z = (np.array(M, dtype=float) for M in (law.W, law.Z))

    def values(self, coordinates: Array) -> Array:
        alpha = self.domain.alpha(coordinates)
        A, B = np.tensordot(alpha, self.A, 1), np.tensordot(alpha, self.B, 1)
        if len(self.curve):
            more = np.tensordot(self.domain.basis(alpha, self.degree), self.curve, 1)
            n, m = B.shape[-2:]
            A, B = A + more[..., :n], B + more[..., n : n + m]
        try:
            poles = np.linalg.eigvals(A + B @ self._gains(coordinates, alpha))
        except np.linalg.LinAlgError:  # a law that is singular somewhere: look point by point
            if len(coordinates) == 1:
                return np.array([np.inf])
            return np.concatenate([self.values(a[None]) for a in coordinates])
        return np.asarray(self.measure(poles))

    def _gains(self, coordinates: Array, alpha: Array) -> Array:
        powers = self.law.powers
        if powers and self.K is not None:
            c = coordinates
            if len(powers[0]) != c.shape[-1]:
                c = c[..., 1::2] - c[..., ::2]
            K = np.tensordot(np.prod(c[..., None, :] ** np.array(powers), axis=-1), self.K, 1)
            return np.asarray(K if self.C is None else K @ np.tensordot(alpha, self.C, 1))
        if self.K is not None:
            return np.asarray(self.K[0])
        basis = self.domain.basis(alpha, self.law.degree)
        return right_divide(np.tensordot(basis, self.Z, 1), np.tensordot(basis, self.W, 1))


def _climb(family: _Family, point: Array, worst: float) -> tuple[Array, float]:
    """Seeded random search with a shrinking step, on each simplex."""
    random = np.random.default_rng(SEED)
    cuts = np.cumsum(family.domain.sizes)[:-1]
    step = 0.2
    # what one climb may cost, in cubes of the number of states
    rounds = min(40, int(2e7 / (16 * family.A.shape[-1] ** 3)))
    for _ in range(rounds if family.A.shape[0] > 1 else 0):
        moved = []
        for simplex in np.split(point, cuts):
            mates = random.dirichlet(np.full(simplex.size, 0.5), 16)
            trial = simplex + step * random.choice([-1.0, 1.0], (16, 1)) * (mates - simplex)
            trial = np.clip(trial, 0, None)
            moved.append(trial / trial.sum(axis=1, keepdims=True))
        trials = np.hstack(moved)
        values = family.values(trials)
        best = int(np.argmax(values))
        if values[best] > worst + TIE * abs(worst):
            point, worst = trials[best], float(values[best])
        else:
            step *= 0.7
    return point, worst


# --- evidence that one pole is outside -----------------------------------------------------------


def leaves(
    loop: tuple[Rationals, Rationals], region: tuple[Part, ...], off: Fraction = Fraction(0)
) -> bool:
    """Whether a pole of N W^-1, ``loop`` holding N and W, is proved not to lie in the region.

    Entries of N may be ``off`` by so much.

    By a matrix P that floats find (`roots.Outside`), in more work where the loop is large; where
    that fails, as for a pole on the boundary, and of few states, by the characteristic polynomial.
    A W that is singular keeps no pole. Of an ellipse the polynomial decides by a polygon about it.

    Raises
    ------
    FormatError
        If that is more work than is done here.
    """
    if len(loop[0]) <= FEW and not off and not any(isinstance(part, Ellipse) for part in region):
        with suppress(work.FormatError), work.counted():
            closed = matrices.right_divide(*loop)
            return closed is None or not roots.all_inside(closed, region)
    large = len(loop[0]) > work.LARGE
    with work.counted(work.MAX_IN_PARTS if large else None):
        if shown(loop, region, off) is not None:
            return True
    if off:
        return False
    with work.counted():
        closed = matrices.right_divide(*loop)
        return closed is None or not roots.all_inside(closed, region)


def shown(
    loop: tuple[Rationals, Rationals], region: tuple[Part, ...], off: Fraction = Fraction(0)
) -> Outside | None:
    """Return evidence that proves a pole outside, None where floats find none."""
    known = evidence(loop, region)
    return next((by for by in known if roots.is_outside(loop, region, by, off)), None)


def evidence(loop: tuple[Rationals, Rationals], region: tuple[Part, ...]) -> Iterator[Outside]:
    """Yield evidence worth deciding that a pole is outside, of the one farthest outside."""
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov  # deferred: slow to import

    try:
        N, W = (np.array(M, dtype=float) for M in loop)
        A, (scale, _) = matrix_balance(right_divide(N, W), permute=False, separate=True)
        poles = np.linalg.eigvals(A)
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        return
    upper = [complex(z) for z in poles if z.imag >= 0]
    side, over = max(
        ((side, _over(side, z)) for z in upper for part in region for side in part.facing(z)),
        key=lambda pair: pair[1],
    )
    if not over > 0:
        return
    p, q, c = side
    turned = (float(p) - 1j * float(q)) * A if q else float(p) * A
    for beyond in _between(np.asarray(np.linalg.eigvals(turned).real - float(c))):
        line = c + Fraction(beyond)
        R = turned - float(line) * np.eye(len(A))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of poles nearly opposite: P is decided exactly
                P = solve_continuous_lyapunov(R.conj().T, -np.eye(len(A)))
        except (np.linalg.LinAlgError, ValueError):
            continue
        with np.errstate(over="ignore", invalid="ignore"):  # only finite numbers are evidence
            P = np.asarray((P + P.conj().T) / 2 / scale[:, None] / scale)
        if np.all(np.isfinite(P)):
            yield Outside(p, q, line, _rational(np.real(P)), _rational(np.imag(P)))


def _over(side: Side, z: complex) -> float:
    """Return how far z lies beyond p x + q y = c."""
    p, q, c = map(float, side)
    return (p * z.real + q * z.imag - c) / float(np.hypot(p, q))


def _between(values: Array) -> list[float]:
    """Return numbers from zero up, below the largest of the values, far from them all."""
    levels = np.unique(values)
    lower = np.concatenate([[-np.inf], levels[:-1]])
    gaps = []
    for low, high in zip(lower, levels, strict=True):
        if high > 0:
            middle = max(0.0, (low + high) / 2)
            gaps.append((min(middle - low, high - middle), middle))
    return [middle for _, middle in sorted(gaps, reverse=True)[:3]]


def _rational(matrix: Array) -> Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]
