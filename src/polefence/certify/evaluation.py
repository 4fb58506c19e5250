"""Evaluation of a law in doubles: the share of the room in its region that rounding takes.

A proof is about K(alpha) as a real number. Doubles evaluate it with rounding errors, and where the
Lyapunov matrix X(alpha) is nearly singular, errors of the last digit move poles out of the region.
In coordinates in which X(alpha) is the identity, the loop A_c has room while

    F = -(L (x) I + M (x) A_c + M' (x) A_c') > 0,

to which is added what poles computed in doubles may lie outside in any case, `TOLERANCE` of the
region's size. An error D of the loop takes the share |F^-1/2 (M (x) D + M' (x) D') F^-1/2| of it.
D is judged by its root mean square to first order, for independent errors of half a unit in the
last place of every number that the evaluation has: those of W, Z, T and K, see `ScheduledGain`; of
one gain those of K. This is smooth in the numbers: unlike an error found once, the same on every
machine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from polefence.certify.certificate import Certificate, in_floats
from polefence.law.coordinates import Coordinates
from polefence.law.laws import right_divide
from polefence.lmi.solve.scaling import summed, transposed
from polefence.plant.boxes import Box
from polefence.plant.family import UncertainPlant
from polefence.plant.parts import inside
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.region.regions import Pair, Region

UNIT = 2.0**-53
SAFETY = 2.0  # times the root mean square is what must find room
TOLERANCE = 1e-4

# A cheap bound of the share that says enough, and the least eigenvalue of a matrix of unit diagonal
# that is inverted for it.
SURE, INVERTIBLE = 0.5, 1e-8


def rounding_share(certificate: Certificate) -> float:
    """Return the share of the room that rounding takes, the largest of corners and points between.

    Up to one the law, evaluated in doubles, keeps the poles in the region there, to within
    `TOLERANCE` of its size. Infinite where the certificate leaves no room in doubles.
    """
    worst = 0.0
    places = _places(certificate.domain)
    with np.errstate(all="ignore"):
        for region, lyapunov in lyapunovs(certificate):
            try:
                loops = _Loops.of(certificate, lyapunov, places)
                for pair in region.pairs():
                    worst = max(worst, float(loops.shares(pair, region).max()))
            except np.linalg.LinAlgError:
                return math.inf
    return worst


def surely_runs(certificate: Certificate) -> bool:
    """Whether the share of a certificate that is proved is below one by a bound that is cheap.

    Where X(alpha) = I the proof leaves F >= 0, and so `TOLERANCE` of the region's size at least:
    with tr M M' and the number of columns of M that are not zero, that bounds what F^-1 does. The
    rest are traces in the plant's own coordinates, for Lyapunov matrices that floats invert well.
    """
    with np.errstate(all="ignore"):
        for region, lyapunov in lyapunovs(certificate):
            if lyapunov.box is not None or lyapunov.multiple is not None:
                return False
            try:
                spread = _spread(certificate, lyapunov)
            except np.linalg.LinAlgError:
                return False
            if not _leaves_room(region, spread):
                return False
    return True


def _leaves_room(region: Region, spread: float) -> bool:
    for _, M in region.pairs():
        factor = math.sqrt(float((M * M).sum()) * np.count_nonzero(M.any(axis=0)))
        if not 2 * SAFETY * UNIT * factor * spread / (TOLERANCE * region.size) <= SURE:
            return False
    return True


def _spread(certificate: Certificate, lyapunov: Lyapunov) -> float:
    """Return the root of the terms' squares where F^-1 = I, infinite where floats may not do."""
    law, domain, X = certificate.law, certificate.domain, lyapunov.X
    places = _places(domain)
    if lyapunov.degree:  # else it is the same everywhere: one for all places
        X = summed(domain.basis(places, lyapunov.degree), X)
    diagonal = np.diagonal(X, axis1=-2, axis2=-1)
    scale = np.sqrt(diagonal)
    even = X / (scale[..., :, None] * scale[..., None, :])
    if not np.linalg.eigvalsh(even).min() > INVERTIBLE:
        return math.inf
    B = summed(places, certificate.plant.B) / scale[..., None]
    inputs = transposed(B) @ np.linalg.solve(even, B)  # B' X^-1 B
    column = np.diagonal(inputs, axis1=-2, axis2=-1)
    if law.K is not None:
        square = (column @ law.K**2 * diagonal).sum(axis=-1)
    elif law.W is not None:
        W, Z = np.split(law.form, [X.shape[-1]], axis=-2)
        mean = W.mean(axis=0)
        size = np.sqrt(np.diag(mean))
        T = np.linalg.inv(np.linalg.cholesky(mean / np.outer(size, size))) / size
        W = T @ X @ T.T
        Z = summed(domain.basis(places, law.degree), Z) @ T.T
        right = np.linalg.inv(W)
        K = Z @ right
        moved = (K * (inputs @ K)).sum(axis=-2)
        terms = (moved, W, right), (column, Z, right), (moved, T, X), (column, K @ T, X)
        square = np.sum([_weighed(*term) for term in terms], axis=0)
    else:
        return math.inf
    return math.sqrt(square.max())


def _weighed(columns: Array, matrix: Array, rows: Array) -> Array:
    """Return the sum of squares of a matrix, weighed by columns and by the diagonal of rows."""
    sums = (columns[..., None, :] @ matrix**2)[..., 0, :]
    return np.asarray((sums * np.diagonal(rows, axis1=-2, axis2=-1)).sum(axis=-1))


@lru_cache(maxsize=64)
def _places(domain: Domain) -> Array:
    """Return corners, the middle, and points between, as alpha."""
    random = np.random.default_rng(0)
    inner = [random.dirichlet(np.full(size, 0.7), 8) for size in domain.sizes]
    middle = np.concatenate([np.full(size, 1 / size) for size in domain.sizes])
    between = domain.alpha(np.vstack([middle, np.hstack(inner)]))
    places = np.vstack([np.eye(domain.corners)[:64], between])
    places.flags.writeable = False
    return places


@dataclass(frozen=True, eq=False)
class Lyapunov:
    """X(alpha) = X, or W (multiple + X W) of a law that was given: Bernstein coefficients.

    On ``box`` alone, in its own coordinates, where there is one. ``remainder`` has what a plant's
    asks for besides: omega, rows and columns.
    """

    X: Array
    degree: int
    multiple: Array | None = None
    elevation: int | None = None  # of the evidence of a law that was given
    box: Box | None = None
    remainder: Mapping[str, Any] | None = None


def lyapunovs(certificate: Certificate) -> Iterator[tuple[Region, Lyapunov]]:
    """Yield each part of the region, and of the box, with what proves it there."""
    law, evidence, parts = certificate.law, certificate.evidence, certificate.region.parts
    if certificate.method == "lyapunov":
        scheduled = law.W is not None
        for part, divided in zip(parts, evidence["parts"], strict=True):
            for cell in divided.get("cells", [divided]):
                degree, X = int(cell["degree"]), in_floats(cell["X"])
                multiple = np.asarray(cell.get("multiple", np.zeros(len(X)))) if scheduled else None
                box = None
                if "low" in cell:
                    box = Box(*(tuple(in_floats(cell[key]).tolist()) for key in ("low", "high")))
                more = multiple, int(cell["elevation"]), box, cell.get("remainder")
                yield part, Lyapunov(X, degree, *more)
        return
    if law.W is not None:
        lyapunov = Lyapunov(law.W, law.degree)
    elif certificate.method == "slack":
        lyapunov = Lyapunov(np.asarray(evidence["P"]), int(evidence.get("degree", 1)))
    else:
        lyapunov = Lyapunov(np.asarray(evidence["W"])[None], 0)
    for part in parts:
        yield part, lyapunov


Term = tuple[Array, Array, Array]  # D = left E right, entries of E as large as the second's


@dataclass(frozen=True, eq=False)
class _Loops:
    """Loops in coordinates in which X(alpha) = I at each point, and the terms of their errors.

    Attributes
    ----------
    closed : (places, n, n) array
        [1/s]
    terms : tuple of (left, matrix, right)
    """

    closed: Array
    terms: tuple[Term, ...]

    @classmethod
    def of(cls, certificate: Certificate, lyapunov: Lyapunov, places: Array) -> _Loops:
        law, plant, domain = certificate.law, certificate.plant, certificate.domain
        basis, box = domain.basis(places, lyapunov.degree), lyapunov.box
        near = None if plant.remainder is None else _near(plant, box, places)
        if box is not None:
            places = box.alpha(domain, places)
        if law.W is not None:
            coordinates = law.coordinates
            W, Z = (np.tensordot(law.domain.basis(places, law.degree), M, 1) for M in law.even)
            X = _scheduled(coordinates, lyapunov, basis, W)
            K: Array = right_divide(Z, W)
        else:
            coordinates = _middle(lyapunov.X)
            X = np.tensordot(basis, coordinates.forms(lyapunov.X), 1)
            gains = law.gain(places)
            K = coordinates.feedback(gains)
        if near is None:
            A = np.tensordot(places, coordinates.loops(plant.A), 1)
            B = np.tensordot(places, coordinates.inputs(plant.B), 1)
        else:
            A, B = coordinates.loops(near[0]), coordinates.inputs(near[1])
        C: Array = np.asarray(np.linalg.cholesky((X + X.swapaxes(-1, -2)) / 2), dtype=float)
        left: Array = np.asarray(np.linalg.solve(C, B), dtype=float)
        closed, back = np.linalg.solve(C, A) @ C + left @ K @ C, coordinates.inverse @ C
        if law.W is None:
            return cls(closed, ((left, gains, back),))
        right: Array = np.asarray(np.linalg.solve(W, C), dtype=float)
        T, moved = coordinates.T, left @ K
        terms = (moved, W, right), (left, Z, right), (moved, T, back), (left, K @ T, back)
        return cls(closed, terms)

    def shares(self, pair: Pair, region: Region) -> Array:
        """Return the share of the room of one L, M that rounding takes at each point."""
        (L, M), n = pair, self.closed.shape[-1]
        F = TOLERANCE * region.size * np.eye(len(L) * n) - np.kron(L, np.eye(n))
        F = F - np.array([np.kron(M, A) + np.kron(M.T, A.T) for A in self.closed])
        if not np.all(np.isfinite(F)) or not np.all(np.linalg.eigvalsh(F) > 0):
            return np.full(len(F), math.inf)
        inverse = np.linalg.inv(F).reshape(-1, len(L), n, len(L), n)
        # M = M1 M2: its columns that are not zero, and which those are
        kept = np.diag(M.any(axis=0).astype(float))
        weights = [np.einsum("ab,paibj->pij", form, inverse) for form in (M @ M.T, kept)]
        square = sum(_square(term, *weights) for term in self.terms)
        return np.asarray(2 * SAFETY * UNIT * np.sqrt(square))


def _near(plant: UncertainPlant, box: Box | None, places: Array) -> tuple[Array, Array]:
    """Return A and B at places of a part of the box, of a plant that is near a polynomial there."""
    if box is not None and plant.bent:
        plant = inside(plant, *(tuple(map(Fraction, ends)) for ends in (box.low, box.high)))
    elif box is not None:
        places = box.alpha(plant.domain, places)
    return plant.at(places)


def _square(term: Term, before: Array, behind: Array) -> Array:
    """Return the mean square of F^-1/2 (M (x) D) F^-1/2, in squares of units of the last place."""
    left, matrix, right = term
    columns = np.einsum("pia,pij,pja->pa", left, before, left)
    rows = np.einsum("pbi,pij,pbj->pb", right, behind, right)
    square = np.broadcast_to(matrix**2, (len(columns), *matrix.shape[-2:]))
    return np.asarray(np.einsum("pa,pab,pb->p", columns, square, rows))


def _middle(X: Array) -> Coordinates:
    coordinates = Coordinates.whitening(X.mean(axis=0))
    if coordinates is None:
        raise np.linalg.LinAlgError("a Lyapunov matrix is not positive definite")
    return coordinates


def _scheduled(coordinates: Coordinates, lyapunov: Lyapunov, basis: Array, W: Array) -> Array:
    """Return X(alpha) of a scheduled law in its own coordinates."""
    if lyapunov.multiple is None:
        return W
    Q = np.tensordot(basis, coordinates.duals(lyapunov.X), 1)
    scalar = np.tensordot(basis, lyapunov.multiple, 1)[:, None, None]
    return np.asarray(W @ (scalar * np.eye(W.shape[-1]) + Q @ W))
