"""Motions that are followed exactly: in what parts of the box, and in what norms, floats choose."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby, product
from typing import Any, Self, TypeVar

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.followed import Followed, Run
from polefence.proof.laws import Evidence, Piece, Point
from polefence.proof.matrices import Rationals
from polefence.proof.response import Centred
from polefence.response.discrete import balancing

NORMS = ((0, 0), (2, 0), (2, 2), (4, 0))  # degrees of Q, and how much higher inequalities are
CHECKED = 5  # of nodes at which errors are looked at
RATE = 0.6  # of the slowest decay, with which errors are proved to fade
TERMS = 12
REACH = 1.3
BITS = 30
FEW = 24  # bits of a level
SMALLEST = Fraction(1, 64)  # of a parameter's range

OneClaim = TypeVar("OneClaim", bound=Followed)


def corners(count: int) -> tuple[Point, Point]:
    """Return the lowest and the highest corner of the whole box."""
    return (Fraction(0),) * count, (Fraction(1),) * count


def of_part(blank: OneClaim, low: Point, high: Point) -> OneClaim:
    """Return the claim about a part of the box, which nothing proves yet."""
    if all(x == 0 for x in low) and all(x == 1 for x in high):
        return blank
    return blank.part(Piece(low, high, blank.subject.evidence), None)


def small(low: Point, high: Point) -> bool:
    """Whether a part is so small that no smaller one is tried."""
    return max((b - a for a, b in zip(low, high, strict=True)), default=Fraction(0)) < SMALLEST


def halves(low: Point, high: Point, k: int) -> list[tuple[Point, Point]]:
    """Return the halves of a part across its k-th parameter."""
    middle = (low[k] + high[k]) / 2
    return [
        (low, (*high[:k], middle, *high[k + 1 :])),
        ((*low[:k], middle, *low[k + 1 :]), high),
    ]


@dataclass(frozen=True, eq=False)
class Floats:
    """The loop of one part, in floats, in its middle and at its corners."""

    claim: Followed
    run: Run
    domain: Domain
    A: Array  # (1 + corners, n, n)
    b: Array  # (1 + corners, n, drives)
    x0: Array
    C: Array
    F: Array  # (1 + corners,), of what stays

    @classmethod
    def of(cls, claim: Any) -> Self:
        """Return it."""
        run, domain = claim.run, Domain(claim.subject.sizes)
        middle = np.concatenate([np.full(size, 1 / size) for size in domain.sizes])
        at = np.concatenate([middle[None], domain.coordinates(np.eye(domain.corners))])
        A, C = loops(run, domain, at)
        none = np.zeros((*A.shape[:2], len(run.drives)))
        b = values(run.b, domain, at) if run.b.terms else none
        x0 = values(run.x0, domain, at)[:, :, 0] if run.x0.terms else none[:, :, 0]
        stays = np.array([not drive.rests for drive in run.drives], dtype=float)
        F = np.zeros(len(at)) if run.F is None else values(run.F, domain, at)[:, 0] @ stays
        return cls(claim, run, domain, A, b, x0, C[:, 0], F)

    def moved(self) -> list[float]:
        """Return by how much each parameter moves A, beside its size."""
        count = len(self.domain.sizes)
        signs = np.array(list(product((-1, 1), repeat=count)))
        scale = np.abs(self.A[0]).max(axis=0) + 1e-300
        return [
            float(np.linalg.norm((signs[:, k, None, None] * self.A[1:]).mean(axis=0) / scale))
            for k in range(count)
        ]

    def fading(self) -> Iterator[tuple[Evidence, float, float]]:
        """Yield norms in which errors fade everywhere, with beta and kappa."""
        domain = self.domain
        at = domain.nodes(CHECKED)
        A, C = loops(self.run, domain, domain.coordinates(at))
        d = balancing(np.concatenate([self.A, A]))
        middle, A, C = self.A[:1] / d[:, None] * d, A / d[:, None] * d, C[:, 0] * d
        rate = -RATE * np.linalg.eigvals(np.concatenate([middle, A])).real.max()
        if rate <= 0:
            return
        weight = _weight(middle[0], A, rate)
        for degree, elevation in NORMS:
            nodes = domain.nodes(degree)
            own = loops(self.run, domain, domain.coordinates(nodes))[0] / d[:, None] * d
            eye = rate * np.eye(len(d))
            Q = np.array([solve_continuous_lyapunov((M + eye).T, -weight) for M in own])
            coefficients = domain.interpolated((Q + np.swapaxes(Q, 1, 2)) / 2, degree)
            Q = np.tensordot(domain.basis(at, degree), coefficients, 1)
            falling = np.swapaxes(A, 1, 2) @ Q + Q @ A + 2 * rate * Q
            if np.linalg.eigvalsh(falling).max() >= 0 or np.linalg.eigvalsh(Q).min() <= 0:
                continue
            squares = np.einsum("ki,kij,kj->k", C, np.linalg.inv(Q), C)
            X = [rationals(M / d[:, None] / d) for M in coefficients]
            evidence = Evidence(X, degree, elevation, dual=True)
            yield evidence, rate, REACH * float(np.sqrt(squares.max()))


def tau(A: Array, h: float) -> Array:
    """Return the inverse of c -> coefficients of X' - h / 2 A X, and X(-1), of each A."""
    count, n, _ = A.shape
    m = TERMS
    whole = np.zeros((count, m + 1, n, m + 1, n))
    eye = np.eye(n)
    for j in range(m):
        for p in range(j + 1, m + 1, 2):
            whole[:, j, :, p] = (p if j == 0 else 2 * p) * eye
        whole[:, j, :, j] = -h / 2 * A
    for p in range(m + 1):
        whole[:, m, :, p] = (-1) ** p * eye
    return np.asarray(np.linalg.inv(whole.reshape(count, n * (m + 1), n * (m + 1))))


def followed(inverse: Array, x: Array, b: Array, h: float) -> Array:
    """Return c (count, m + 1, n) from x (count, n), b of T_0 on (count, n, up to m)."""
    count, n = x.shape
    right = np.zeros((count, TERMS + 1, n))
    right[:, : b.shape[2]], right[:, -1] = h / 2 * np.swapaxes(b, 1, 2), x
    found = inverse @ right.reshape(count, -1, 1)
    return np.asarray(found.reshape(count, TERMS + 1, n))


def runs(lengths: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Return lengths as pairs of a length and how many of it follow one another."""
    return tuple((length, len(list(same))) for length, same in groupby(lengths))


def power(value: float) -> Fraction:
    """Return the greatest power of two that is no more."""
    return Fraction(2) ** math.floor(math.log2(value))


def _weight(middle: Array, A: Array, rate: float) -> Array:
    """Return what Q is to fall by: modes in the middle, weighed so that what moves them is even."""
    poles, V = np.linalg.eig(middle)
    left = np.linalg.inv(V)
    moved = np.abs(left @ (A - middle) @ V).max(axis=0)
    room = np.maximum(-poles.real - rate, 1e-3 * np.abs(poles))
    moved = moved / np.sqrt(room)[:, None] / np.sqrt(room)
    pairs = np.abs(poles[:, None] - poles.conj()).argmin(axis=1)
    moved = np.maximum(moved, moved[pairs][:, pairs])  # alike for both of a pair
    moved = moved + 1e-9 * max(float(moved.max()), 1e-300)
    left = left / balancing(moved[None])[:, None]
    return np.asarray((left.conj().T @ left).real)


def loops(run: Run, domain: Domain, coordinates: Array) -> tuple[Array, Array]:
    """Return A and C of the loop, also of a law Z W^-1, at coordinates."""
    A, C = (values(P, domain, coordinates) for P in (run.A, run.C))
    if run.W is None:
        return A, C
    back = np.linalg.inv(values(run.W, domain, coordinates))
    return A @ back, C @ back


def values(P: Centred, domain: Domain, coordinates: Array) -> Array:
    """Return the values of a polynomial in g at coordinates (count, sum of corners)."""
    g, first = list[Array](), 0
    for size in domain.sizes:
        g += [coordinates[:, first + j] - 1 / size for j in range(1, size)]
        first += size
    total: Array = np.zeros(())
    for e, M in P.terms.items():
        scale = np.prod([x**power for x, power in zip(g, e, strict=True)], axis=0)
        exact = np.array([[float(Fraction(x, P.whole)) for x in row] for row in M])
        total = total + np.broadcast_to(scale, len(coordinates))[:, None, None] * exact
    return np.asarray(total)


def above(level: float) -> float:
    """Return a number of few bits that is not less, of which steps are parts."""
    share, power = math.frexp(level)
    return math.ldexp(math.ceil(share * 2**FEW), power - FEW)


def short(value: float) -> Fraction:
    """Return nearly the number, of few bits."""
    share, power = math.frexp(value)
    return Fraction(math.ldexp(round(share * 2**BITS), power - BITS))


def rationals(M: Array) -> Rationals:
    """Return nearly the matrix, of few bits."""
    return [[short(float(x)) for x in row] for row in M]
