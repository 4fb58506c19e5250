"""A plant of fewer states that a regulator can be computed for, exactly.

Inputs that no output shows cost nothing. What they move at once is as good as an input itself: with
B2 their columns and T B2 = 0, y = T x and x = Y y + B2 v,

    y' = T A Y y + T A B2 v + T B1 u1 + T E w.

Repeated until no input is left that no output shows. Then motions along which some u = F x keeps
all outputs zero cost nothing either, and those that neither grow nor fade, the zeros at s = 0, have
no regulator: with T zero along them, y = T x has A + B F and C + D F. No law of the plant does
better than the best of this one, and for a P of this one the inequality holds with T'P T of the
plant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import SolverError
from polefence.plant.system import Array

Rationals = list[list[Fraction]]

_ZERO, _ONE = Fraction(0), Fraction(1)


@dataclass(frozen=True)
class Regular:
    """x' = A x + B u + E w, y = C x + D u with D of full column rank, x = T times the plant's."""

    A: Rationals
    B: Rationals
    E: Rationals
    C: Rationals
    D: Rationals
    T: Rationals


def regular(A: Rationals, B: Rationals, E: Rationals, C: Rationals, D: Rationals) -> Regular | None:
    """Return the plant of fewer states; None if no state or input is left."""
    plant = Regular(A, B, E, C, D, _eye(len(A)))
    while hidden := _null_space(plant.D):
        found = _without_inputs(plant, hidden)
        if found is None:
            return None
        plant = found
    return _without_zeros(plant)


def _without_inputs(plant: Regular, hidden: Rationals) -> Regular | None:
    """Return the plant with what hidden inputs move as inputs in their place."""
    n, (_, shown) = len(plant.A), _reduced(plant.D)
    G, pivots = _reduced(_transposed(_product(plant.B, _transposed(hidden))))
    if len(pivots) == n or not (pivots or shown):
        return None
    T, Y = _quotient(G, pivots, n)
    V = [[g[i] for g in G] for i in range(n)]
    moved = [
        [*a, *(b[j] for j in shown)] for a, b in zip(_product(plant.A, V), plant.B, strict=True)
    ]
    seen = [
        [*c, *(d[j] for j in shown)] for c, d in zip(_product(plant.C, V), plant.D, strict=True)
    ]
    A, C = _product(T, _product(plant.A, Y)), _product(plant.C, Y)
    return Regular(A, _product(T, moved), _product(T, plant.E), C, seen, _product(T, plant.T))


def _without_zeros(plant: Regular) -> Regular | None:
    """Return the plant without the motions of zeros at s = 0."""
    n, m = len(plant.A), len(plant.B[0])
    DT = _transposed(plant.D)
    both = [[*a, *b] for a, b in zip(_product(DT, plant.D), _product(DT, plant.C), strict=True)]
    F = [[-x for x in row[m:]] for row in _reduced(both)[0]]
    A, C = _sum(plant.A, _product(plant.B, F)), _sum(plant.C, _product(plant.D, F))
    seen, power = _settled(_reduced(C)[0], A, C), _settled(_reduced(A)[0], A, [])
    G, pivots = _reduced(_null_space([*seen, *power]) if seen or power else _eye(n))
    if not pivots:
        return plant
    if len(pivots) == n:
        return None
    T, Y = _quotient(G, pivots, n)
    return Regular(
        _product(T, _product(A, Y)),
        _product(T, plant.B),
        _product(T, plant.E),
        _product(C, Y),
        plant.D,
        _product(T, plant.T),
    )


def _settled(rows: Rationals, A: Rationals, first: Rationals) -> Rationals:
    """Return ``first`` and rows times A, reduced, again and again until their number stays."""
    while rows and len(rows) < len(A):
        more = _reduced([*first, *_product(rows, A)])[0]
        if len(more) == len(rows):
            break
        rows = more
    return rows


def _quotient(G: Rationals, pivots: list[int], n: int) -> tuple[Rationals, Rationals]:
    """Return T with T g = 0 for the rows g of a reduced basis, and Y with T Y = I."""
    others = [q for q in range(n) if q not in pivots]
    T = [[_ONE * (q == j) for j in range(n)] for q in others]
    for row, q in zip(T, others, strict=True):
        for g, p in zip(G, pivots, strict=True):
            row[p] -= g[q]
    return T, [[_ONE * (i == q) for q in others] for i in range(n)]


def _eye(n: int) -> Rationals:
    return [[_ONE * (i == j) for j in range(n)] for i in range(n)]


def _transposed(matrix: Rationals) -> Rationals:
    return [list(row) for row in zip(*matrix, strict=True)]


def _product(a: Rationals, b: Rationals) -> Rationals:
    columns = list(zip(*b, strict=True))
    return [[_dot(row, column) for column in columns] for row in a]


def _sum(a: Rationals, b: Rationals) -> Rationals:
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), _ZERO)


def _reduced(matrix: Rationals) -> tuple[Rationals, list[int]]:
    """Return the reduced row echelon form without rows of zeros, and its pivots' columns."""
    rows, done, pivots = [row[:] for row in matrix], list[list[Fraction]](), list[int]()
    for j in range(len(matrix[0]) if matrix else 0):
        k = next((k for k, row in enumerate(rows) if row[j]), None)
        if k is None:
            continue
        first = rows.pop(k)
        first = [x / first[j] for x in first]
        rows, done = (
            [[x - row[j] * f for x, f in zip(row, first, strict=True)] for row in each]
            for each in (rows, done)
        )
        done.append(first)
        pivots.append(j)
    return done, pivots


def _null_space(matrix: Rationals) -> Rationals:
    """Return a basis, as rows."""
    rows, pivots = _reduced(matrix)
    width = len(matrix[0])
    basis = []
    for j in (j for j in range(width) if j not in pivots):
        vector = [_ONE * (i == j) for i in range(width)]
        for row, p in zip(rows, pivots, strict=True):
            vector[p] = -row[j]
        basis.append(vector)
    return basis


LEAST = 1e-7  # of a weight, of their sum: without any the control may be free
CLOSE = 1e-7  # to the largest value, at which the search ends
ROUNDS = 60
REACH = 4.0  # times a weight or a share of it, from one round to the next
TINY = 1e-11  # of the loop's norm: a pole nearer to the imaginary axis is on it


@dataclass(frozen=True, eq=False)
class Regulated:
    """Arrays A, B, E of a plant, and C, D of its outputs, each over the limit on its rms."""

    A: Array
    B: Array
    E: Array
    C: Array
    D: Array

    def riccati(self, weights: Array, decay: float = 0.0, less: Array | None = None) -> Array:
        """Return P of the regulator, for the plant with this much more decay, less so much cost.

        Raises
        ------
        SolverError
            If there is none.
        """
        from scipy.linalg import solve_continuous_are

        A = self.A - decay * np.eye(len(self.A))
        root = np.sqrt(weights)[:, None]
        C, D = root * self.C, root * self.D
        Q = C.T @ C if less is None else C.T @ C - less
        try:
            with np.errstate(all="ignore"):
                P = solve_continuous_are(A, self.B, Q, D.T @ D, s=C.T @ D)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise SolverError(f"no regulator: {error}") from error
        if not np.isfinite(P).all():
            raise SolverError("no regulator: its matrix is not finite")
        return np.asarray((P + P.T) / 2)

    def cost(self, P: Array) -> float:
        """Return the least sum of the outputs' mean squares that P stands for."""
        return float(np.trace(self.E.T @ P @ self.E))

    def mean_squares(self, weights: Array, P: Array) -> Array:
        """Return those of the outputs under the regulator.

        Raises
        ------
        SolverError
            If its loop is not stable.
        """
        from scipy.linalg import solve_continuous_lyapunov

        D = weights[:, None] * self.D
        K = -np.linalg.solve(self.D.T @ D, self.B.T @ P + D.T @ self.C)
        loop = self.A + self.B @ K
        poles = np.linalg.eigvals(loop)
        if poles.real.max() >= -TINY * np.linalg.norm(loop):
            raise SolverError("the regulator leaves a pole on the imaginary axis")
        X = solve_continuous_lyapunov(loop, -self.E @ self.E.T)
        Y = self.C + self.D @ K
        return np.asarray(np.maximum(np.einsum("ij,jk,ik->i", Y, X, Y), 0.0))


def heaviest(plant: Regulated, decay: float) -> tuple[Array, float]:
    """Return the weights of sum 1 for which the regulator costs most, and how much; 0 if nothing.

    The cost is concave in the weights and its slopes are the mean squares: cutting planes, each an
    upper bound everywhere, within a factor of the best weights so far.
    """
    count, reach = len(plant.C), REACH
    slower = replace(plant, A=plant.A - decay * np.eye(len(plant.A)))
    weights = best = np.full(count, 1 / count)
    most, cuts = 0.0, list[Array]()
    for _ in range(ROUNDS):
        try:
            P = slower.riccati(weights)
            value, slopes = slower.cost(P), slower.mean_squares(weights, P)
        except (SolverError, np.linalg.LinAlgError):
            reach = np.sqrt(reach)
        else:
            cuts.append(slopes)
            if value > most:
                best, most = weights, value
        if most <= 0:
            break
        weights, bound = _highest(np.array(cuts) / most, best, reach)
        if not bound > 1 + CLOSE:
            break
    return best, most


def _highest(cuts: Array, centre: Array, reach: float) -> tuple[Array, float]:
    """Return the weights of the largest t with t <= cuts @ weights, and t; 0 if not found."""
    from scipy.optimize import linprog

    count = len(centre)
    bounds = [(max(LEAST, x / reach), min(1.0, x * reach)) for x in centre]
    found = linprog(
        np.append(np.zeros(count), -1.0),
        np.hstack([-cuts, np.ones((len(cuts), 1))]),
        np.zeros(len(cuts)),
        np.append(np.ones(count), 0.0)[None],
        [1.0],
        [*bounds, (None, None)],
    )
    if not found.success or found.x is None:
        return centre, 0.0
    return np.asarray(found.x[:-1]), float(found.x[-1])
