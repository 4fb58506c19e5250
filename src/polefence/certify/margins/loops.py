"""Loops in floats, for the searches of margins: their inequalities on pieces, by interpolation.

A polynomial is known by its values at as many points as it has coefficients. So each inequality is
evaluated at points of each piece, from A(alpha), B(alpha), W(alpha) and Z(alpha) alone, and its
Bernstein coefficients follow by one matrix. This shares nothing with the exact proof.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.design import Design
from polefence.certify.evaluation import Lyapunov, lyapunovs
from polefence.law.coordinates import Coordinates
from polefence.plant.parts import inside
from polefence.plant.polynomial import Domain, Polynomial, bernstein, binomial, elevated, times
from polefence.plant.system import Array
from polefence.region.regions import Pair, Region


@dataclass(frozen=True, eq=False)
class Points:
    """Points of each piece, (cells, points): where the plant is, where the law thinks it is.

    ``factor`` makes polynomials of what is affine in 1/p; ``coefficients`` (points, points) turns
    values into Bernstein coefficients.
    """

    plant: Array
    law: Array
    factor: Array
    coefficients: Array

    @property
    def one(self) -> Array:
        """The coefficients of 1, (cells, coefficients)."""
        return np.asarray(self.factor @ self.coefficients.T)


@dataclass(frozen=True, eq=False)
class Balanced:
    """A design in state coordinates in which W is near to the identity.

    ``T`` are those coordinates: x = T y. ``domain`` is where the law's alpha lives, ``q`` the
    number of parameters. ``elevation`` is that of the evidence of a law that was given,
    ``constant`` whether W is the same everywhere. ``curve`` are the Bernstein coefficients of what
    is added to [A, B] between the vertices, of ``plant_degree``; ``spread`` is what a remainder
    asks for.
    """

    A: Array
    B: Array
    W: Array
    Z: Array
    T: Array
    degree: int
    domain: Domain
    q: int
    pairs: tuple[Pair, ...]
    disks: bool
    elevation: int | None = None
    constant: bool = False
    curve: Array | None = None
    plant_degree: int = 1
    spread: Spread | None = None
    corners: Array | None = None

    @property
    def degrees(self) -> tuple[int, int]:
        """The degrees of the law's matrices and of the plant's."""
        return self.degree, self.plant_degree

    @property
    def sizes(self) -> tuple[int, ...]:
        """The corners of each simplex of the plant's own coordinates."""
        return (2,) * self.q or (len(self.A),)

    def plant(self, alpha: Array) -> tuple[Array, Array]:
        """Return A and B at points alpha (..., N)."""
        A, B = np.tensordot(alpha, self.A, 1), np.tensordot(alpha, self.B, 1)
        if self.curve is None:
            return A, B
        basis = Domain(self.sizes).basis(alpha, self.plant_degree)
        more = np.tensordot(basis, self.curve, 1)
        n = A.shape[-1]
        return A + more[..., :n], B + more[..., n:]

    def law(self, alpha: Array) -> tuple[Array, Array]:
        """Return W and Z at points alpha (..., N)."""
        basis = (
            self.domain.basis(alpha, self.degree) if self.degree else np.ones_like(alpha[..., :1])
        )
        return np.tensordot(basis, self.W, 1), np.tensordot(basis, self.Z, 1)

    def loop(self, points: Points) -> tuple[Array, Array, Array]:
        """Return the coefficients of X and N, (cells, coefficients, n, n), and of B."""
        (A, B), (W, Z) = self.plant(points.plant), self.law(points.law)
        X, N, B = (_coefficients(points, values) for values in (W, A @ W + B @ Z, B))
        return X, N, B

    def raised(self, elevation: int) -> tuple[Array, Array, Array]:
        """Return the coefficients of X, N and B on the law's own domain, of one degree."""
        domain, d, n = self.domain, self.plant_degree, self.W.shape[-1]
        total = self.degree + d + elevation
        AB, W = np.concatenate([self.A, self.B], 2), np.concatenate([self.W, self.Z], 1)
        plant = elevated(bernstein(domain, AB, 1), domain, d - 1)
        if self.curve is not None:
            curve = bernstein(domain, self.curve, d)
            plant = {e: P + curve[e] for e, P in plant.items()}
        terms = (
            (bernstein(domain, self.W, self.degree), elevation + d),
            (times(plant, bernstein(domain, W, self.degree)), elevation),
            ({e: P[:, n:] for e, P in plant.items()}, total - d),
        )
        X, N, B = (_stacked(elevated(P, domain, power), domain, total)[None] for P, power in terms)
        return X, N, B

    def seen(self, C: Array, elevation: int) -> Array:
        """Return the coefficients of X C', C (N, r, n) at the vertices, as `raised` has X."""
        domain, d = self.domain, self.plant_degree
        C = C if self.corners is None else np.tensordot(self.corners, C, 1)
        moved = bernstein(domain, np.swapaxes(C @ self.T, 1, 2), 1)
        signals = times(bernstein(domain, self.W, self.degree), moved)
        signals = elevated(signals, domain, elevation + d - 1)
        return _stacked(signals, domain, self.degree + d + elevation)

    def lost(self, M: Array, cover: float = 1.0) -> Array:
        """Return what a remainder takes of the inequality of one L, M, for a multiple of Omega."""
        if self.spread is None:
            return np.zeros((1, 1))
        M1, M2 = factors(M)
        H, omega = self.spread.H, self.spread.omega
        return kron(M1 @ M1.T, H @ H.T) + kron(M2.T @ M2, cover * omega)

    def covered(self, elevation: int) -> tuple[Array, Array]:
        """Return the coefficients of X, and of the rows of V that a remainder is times."""
        if self.spread is None:
            raise InputError("the plant has no remainder")
        domain = self.domain
        rows = np.concatenate([self.W, self.spread.states @ self.W, self.spread.inputs @ self.Z], 1)
        raised = elevated(bernstein(domain, rows, self.degree), domain, elevation)
        stacked = _stacked(raised, domain, self.degree + elevation)
        return stacked[:, : self.W.shape[1]], stacked[:, self.W.shape[1] :]


@dataclass(frozen=True, eq=False)
class Spread:
    """What a remainder asks for, in balanced coordinates: H, Omega, and the rows of V.

    V is ``states`` X above ``inputs`` K X.
    """

    H: Array
    omega: Array
    states: Array
    inputs: Array

    @classmethod
    def of(cls, remainder: Mapping[str, Any], T: Array, m: int) -> Spread:
        """Return it for coordinates y, x = T y, and m inputs."""
        n, back = len(T), np.linalg.inv(T)
        omega, rows, columns = (np.asarray(remainder[key]) for key in ("omega", "rows", "columns"))
        sides = columns[:n, None] * T, np.diag(columns[n : n + m])
        return cls(back * rows, back @ omega @ back.T, *sides)


def balanced(design: Design, region: Region) -> tuple[Balanced, ...]:
    """Return a design and a region in balanced coordinates.

    One value for all parts of the region; of a law that was given (method "lyapunov") one each,
    with that part's Lyapunov polynomial, and one each part of the box that has its own.

    Raises
    ------
    InputError
        For designs of the method "slack", which have no Lyapunov matrix of that kind.
    """
    if design.method == "slack":
        raise InputError("nothing is proved for service from a design of method 'slack'")
    pieces = list(lyapunovs(design.certificate))
    if design.method == "lyapunov":
        return tuple(_balanced(design, lyapunov, part) for part, lyapunov in pieces)
    return (_balanced(design, pieces[0][1], region),)


def _balanced(design: Design, lyapunov: Lyapunov, region: Region) -> Balanced:
    """Return the value for a Lyapunov polynomial of the region."""
    law, plant, domain = design.law, design.plant, design.certificate.domain
    if lyapunov.box is not None and plant.remainder is not None:
        plant = inside(
            plant, *(tuple(map(Fraction, ends)) for ends in (lyapunov.box.low, lyapunov.box.high))
        )
    A, B, X, degree, first = plant.A, plant.B, lyapunov.X, lyapunov.degree, None
    N, (n, m) = len(A), plant.shape
    if plant.curve_degree > 1:
        A = np.concatenate([A, plant.curve[:, :, :n]])
        B = np.concatenate([B, plant.curve[:, :, n : n + m]])
    if lyapunov.box is not None and plant.remainder is None:
        A, B = plant.at(lyapunov.box.alpha(domain, np.eye(domain.corners)))
    if law.K is not None:
        KX: Array = law.K @ X
    elif law.W is None:
        form = bernstein(domain, law.form, law.degree)
        form = form if lyapunov.box is None else lyapunov.box.polynomial(form, domain)
        both = times(form, bernstein(domain, X, degree))
        degree += law.degree
        X, KX = np.split(_stacked(both, domain, degree), [plant.shape[0]], axis=1)
    elif lyapunov.multiple is None:
        KX = law.form[:, n:]
    else:
        # X = W V, K X = Z V with V = multiple + Q W, in the law's own coordinates first
        first, (W, Z) = law.coordinates, law.even
        w = bernstein(domain, W, law.degree)
        V = times(bernstein(domain, first.duals(X), degree), w)
        scalars = bernstein(domain, lyapunov.multiple[:, None, None] * np.eye(n), degree)
        for e, matrix in elevated(scalars, domain, law.degree).items():
            V[e] = V[e] + matrix
        both = times(bernstein(domain, np.concatenate([W, Z], axis=1), law.degree), V)
        degree += 2 * law.degree
        WZ = _stacked(both, domain, degree)
        X, KX = WZ[:, :n], WZ[:, n:]
        A, B = first.loops(A), first.inputs(B)
    second = Coordinates.whitening(X.mean(axis=0))
    if second is None:
        raise InputError("a Lyapunov matrix is not positive definite")
    X = second.forms(X)
    T = second.inverse if first is None else first.inverse @ second.inverse
    A, B = second.loops(A), second.inputs(B)
    return Balanced(
        A[:N],
        B[:N],
        (X + X.swapaxes(1, 2)) / 2,
        second.gains(KX),
        T,
        degree,
        domain,
        len(plant.parameters),
        region.pairs(),
        all(part.kind == "disk" for part in region.parts),
        lyapunov.elevation,
        not (lyapunov.degree if law.W is None else degree),
        np.concatenate([A[N:], B[N:]], axis=2) if plant.curve_degree > 1 else None,
        plant.curve_degree,
        None if lyapunov.remainder is None else Spread.of(lyapunov.remainder, T, m),
        None if lyapunov.box is None else lyapunov.box.alpha(domain, np.eye(domain.corners)),
    )


def _stacked(P: Polynomial, domain: Domain, degree: int) -> Array:
    """Return Bernstein coefficients."""
    return np.array([P[e] / binomial(domain.sizes, e) for e in domain.monomials(degree)])


def region_block(pair: Pair, X: Array, N: Array) -> Array:
    """Return -(L (x) X + M (x) N + M' (x) N'), batched."""
    L, M = pair
    return -(kron(L, X) + kron(M, N) + kron(M.T, N.swapaxes(-1, -2)))


def kron(L: Array, X: Array) -> Array:
    """Return the Kronecker product with the last two axes of X."""
    both = L[:, None, :, None] * X[..., None, :, None, :]
    return np.asarray(both.reshape(*X.shape[:-2], len(L) * X.shape[-2], L.shape[1] * X.shape[-1]))


def factors(M: Array) -> tuple[Array, Array]:
    """Return M1, M2 of full rank with M = M1 M2: M's columns that are not zero, and which.

    The parts of regions have no others.
    """
    kept = M.any(axis=0)
    return M[:, kept], np.eye(len(M))[kept]


def are_positive(blocks: Array) -> bool:
    """Whether all blocks (..., s, s) are clearly positive definite."""
    diagonal = np.diagonal(blocks, axis1=-2, axis2=-1)
    if not np.all(diagonal > 0):
        return False
    scale = 1 / np.sqrt(diagonal)
    even = blocks * scale[..., :, None] * scale[..., None, :]
    try:
        np.linalg.cholesky(even - 1e-9 * np.eye(blocks.shape[-1]))  # of blocks of unit diagonal
    except np.linalg.LinAlgError:
        return False
    return True


def largest_step(base: Array, slope: Array) -> float:
    """Return the largest t for which all base + t slope are positive definite, -1 where none is.

    ``base`` and ``slope`` broadcast to (..., s, s).
    """
    if not are_positive(base):
        return -1.0
    scale = 1 / np.sqrt(np.diagonal(base, axis1=-2, axis2=-1))
    even = scale[..., :, None] * scale[..., None, :]
    R = np.linalg.inv(np.linalg.cholesky(base * even))
    worst = -np.linalg.eigvalsh(R @ (slope * even) @ R.swapaxes(-1, -2)).min()
    return float(1 / worst) if worst > 0 else np.inf


def whole_points(design: Balanced, pieces: int, elevation: int) -> Points:
    """Return points of equal pieces of the scheduling variables' intervals, or of the simplex."""
    degree = sum(design.degrees) + elevation
    nodes, coefficients = lattice(design.sizes, (degree,) * len(design.sizes))
    if not design.q:
        alpha = nodes[None]
    else:
        edges = np.linspace(0, 1, pieces + 1)
        cells = np.array(list(product(range(pieces), repeat=design.q)))
        share = edges[cells][:, None] + nodes[None, :, 1::2] / pieces
        alpha = alpha_of(share)
    return Points(alpha, alpha, np.ones(alpha.shape[:2]), coefficients)


def count_whole(design: Balanced, pieces: int, elevation: int) -> float:
    """Return the number of coefficients at `whole_points`."""
    degree = sum(design.degrees) + elevation
    return float(pieces**design.q) * count_monomials(design.sizes, (degree,) * len(design.sizes))


def count_monomials(sizes: tuple[int, ...], degrees: tuple[int, ...]) -> float:
    """Return how many coefficients there are; infinite where they are too many for `lattice`."""
    pairs = zip(sizes, degrees, strict=True)
    count = float(math.prod(math.comb(size - 1 + degree, degree) for size, degree in pairs))
    return count if count <= 2500 else math.inf


def alpha_of(share: Array) -> Array:
    """Return alpha for the shares (..., q) of the way from each low corner to the high one."""
    coordinates = np.stack([1 - share, share], axis=-1).reshape(*share.shape[:-1], -1)
    return Domain((2,) * share.shape[-1]).alpha(coordinates)


@cache
def lattice(sizes: tuple[int, ...], degrees: tuple[int, ...]) -> tuple[Array, Array]:
    """Return points of a product of simplices, and what makes coefficients of values there."""
    nodes, inverse = np.zeros((1, 0)), np.ones((1, 1))
    for size, degree in zip(sizes, degrees, strict=True):
        domain = Domain((size,))
        grid = np.array(domain.monomials(degree), dtype=float) / max(degree, 1)
        grid = grid if degree else np.full((1, size), 1 / size)
        values = domain.basis(grid, degree) if degree else np.ones((1, 1))
        nodes = np.hstack([np.repeat(nodes, len(grid), axis=0), np.tile(grid, (len(nodes), 1))])
        inverse = np.kron(inverse, np.linalg.inv(values))
    return nodes, inverse


def _coefficients(points: Points, values: Array) -> Array:
    weighted = points.factor[..., None, None] * values
    return np.asarray(np.einsum("ij,cjab->ciab", points.coefficients, weighted))
