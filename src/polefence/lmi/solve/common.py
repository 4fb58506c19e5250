"""One Q for loops that follow one another in any order: where Q - F_i'Q F_i - M_i > 0 for all i.

x+ = F_i x + w, the noise w of covariance W, costs x'M_i x in each step; i is anything each time.
With such a Q no order costs more than <W, Q> a step in the mean. The least <W, Q> is the limit of

    <W, Q> - mu sum_i log det S_i,   S_i = Q - F_i'Q F_i - M_i

for small mu: its centre is an analytic function of everything that it is of. So it may be
interpolated between points of a family, and has slopes. With P_i = mu S_i^-1 it is where
W = sum_i (P_i - F_i P_i F_i'), and <W, Q> then exceeds the least by no more than mu times the
number of rows of all S_i. Newton's method finds it. All is in units in which the covariance is I
where each i is as likely as any other and independent of those before, and in which its cost is 1:
where that has none there is no Q.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.plant.system import Array

FIRST, MOST = 60, 120  # steps to where there is a Q, and from there to the centre
LOWER = 0.1  # what mu is lowered by once Newton's decrement is that small
NEAR, CENTRED = 0.3, 1e-7
SHORT = 0.9  # of the longest step that leaves every S_i positive definite
GROWN = 9.0  # of its size, by what Q grows at most in one step on the way there
SHIFT = 1e-10  # there of a scaled diagonal: of one loop Q and t move together, S does not
NONE = 1e-10  # of mu, at which there is taken to be no Q
LARGE = 4e6  # numbers in the matrices of one batch of points


@dataclass(frozen=True, eq=False)
class Common:
    """Centres at ``count`` points: those of ``found`` alone have one.

    Attributes
    ----------
    found : (count,) array of bool
    Q : (count, n, n) array
    F : (count, k, n, n) array
    M : (count, k, n, n) array
    W : (count, n, n) array
    gap : float
        By how much <W, Q> may exceed the least one, as a share of the base.
    base : (count,) array
        The cost where each i is as likely as any other, independent of those before.
    """

    found: Any
    Q: Array
    F: Array
    M: Array
    W: Array
    gap: float
    base: Array

    @property
    def cost(self) -> Array:
        """<W, Q> at each point; infinite where there is none."""
        return np.where(self.found, np.einsum("pij,pij->p", self.W, self.Q), np.inf)

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Slopes of the cost with respect to F and M, (count, k, n, n) each."""
        slopes = [np.zeros_like(self.F), np.zeros_like(self.M)]
        for some in _batches(np.flatnonzero(self.found), *self.F.shape[1:3]):
            with np.errstate(all="ignore"):
                units = _Units.of(self.F[some], self.M[some], self.W[some])
                found = _slopes(units, units.inward(self.Q[some]), self.gap)
            for whole, part in zip(slopes, found, strict=True):
                whole[some] = part
        return slopes[0], slopes[1]


def common(F: Array, M: Array, W: Array, gap: float) -> Common:
    """Return the centres of loops F, their costs M and noise W: see `Common`."""
    found, Q, base = np.zeros(len(F), dtype=bool), np.zeros_like(W), np.zeros(len(F))
    with np.errstate(all="ignore"):
        for some in _batches(np.arange(len(F)), *F.shape[1:3]):
            units = _Units.of(F[some], M[some], W[some])
            good, centre = _centres(units, gap)
            found[some], Q[some], base[some] = good, units.outward(centre), units.base
    return Common(found, Q, F, M, W, gap, base)


def _batches(points: Any, k: int, n: int) -> list[Any]:
    """Return points in batches, of each of which the matrices fit."""
    each = max(1, int(LARGE / (k * n**4)))
    return [points[i : i + each] for i in range(0, len(points), each)]


@dataclass(frozen=True, eq=False)
class _Units:
    """Loops, costs and noise in units: x = T y, Q = base T^-T Q T^-1."""

    F: Array
    M: Array
    W: Array
    T: Array
    base: Array
    known: Any

    @classmethod
    def of(cls, F: Array, M: Array, W: Array) -> _Units:
        """Return them with the units of each point; those that have none are not ``known``."""
        n = F.shape[-1]
        mean = _kron(F, F).mean(axis=1)
        X = _solved(np.eye(n * n) - mean, W.reshape(len(W), -1)).reshape(W.shape)
        X = (X + _turned(X)) / 2
        size = np.sqrt(np.maximum(np.einsum("pii->pi", X), 0.0))
        some = size.max(axis=1) > 0
        size = np.where(size > 0, size, np.maximum(size.max(axis=1, keepdims=True), 1e-300))
        scaled = _finite(X / size[:, :, None] / size[:, None, :])
        values, V = np.linalg.eigh(scaled)
        known = some & (values.min(axis=1) > -1e-9) & np.all(np.isfinite(X), axis=(1, 2))
        values = np.maximum(values, 1e-12 * values.max(axis=1, keepdims=True))
        T = size[:, :, None] * V * np.sqrt(values)[:, None, :]
        T = np.where(known[:, None, None], T, np.eye(n))
        base = np.maximum(np.einsum("pij,pij->p", M.mean(axis=1), X), 1e-300)
        inverse = np.linalg.inv(T)
        M = _turned(T)[:, None] @ M @ T[:, None] / base[:, None, None, None]
        W = inverse @ W @ _turned(inverse)
        return cls(inverse[:, None] @ F @ T[:, None], M, W, T, base, known)

    def outward(self, Q: Array) -> Array:
        """Return Q of the units in the states' own."""
        inverse = np.linalg.inv(self.T)
        whole = self.base[:, None, None] * _turned(inverse) @ Q @ inverse
        return np.asarray((whole + _turned(whole)) / 2)

    def inward(self, Q: Array) -> Array:
        """Return Q of the states in units."""
        return np.asarray(_turned(self.T) @ Q @ self.T / self.base[:, None, None])

    def left(self, Q: Array) -> Array:
        """Return Q - F_i'Q F_i of each loop."""
        return np.asarray(Q[:, None] - _turned(self.F) @ Q[:, None] @ self.F)

    def adjoint(self, P: Array) -> Array:
        """Return the sum of P_i - F_i P_i F_i'."""
        return np.asarray((P - self.F @ P @ _turned(self.F)).sum(axis=1))

    def hessian(self, P: Array) -> Array:
        """Return that of -sum_i log det S_i, with P_i = S_i^-1, in entries on and above diagonals.

        It is the sum of L_i'(P_i x P_i) L_i, where L_i = I - F_i' x F_i'.
        """
        F, up = self.F, _turned(self.F)
        PF, FP = P @ up, F @ P
        n = P.shape[-1]
        i, j = _upper(n)
        rows, columns = i[:, None], j[:, None]
        places = [rows * n + i, columns * n + j, rows * n + j, columns * n + i]
        H: Any = 0.0
        for sign, X in ((1.0, P), (-1.0, PF), (-1.0, FP), (1.0, FP @ up)):
            flat = X.reshape(*X.shape[:2], n * n)
            a, b, c, d = (flat[..., place] for place in places)
            H = H + sign * (a * b + c * d).sum(axis=1)
        weights = np.where(i == j, 0.5, 1.0)
        return np.asarray(2 * weights[:, None] * weights * H)


def _centres(units: _Units, gap: float) -> tuple[Any, Array]:
    """Return which points have a centre, and these."""
    good, Q = _first(units)
    n, k = units.F.shape[-1], units.F.shape[1]
    least = gap / (n * k)
    mu = np.maximum(np.einsum("pij,pij->p", units.W, Q) / (n * k), least)
    ended = ~good
    for _ in range(MOST):
        if np.all(ended):
            break
        S = units.left(Q) - units.M
        R = _root(S)
        P = R @ _turned(R)
        g = _vector(units.W / mu[:, None, None] - units.adjoint(P))
        step, decrement = _newton(units.hessian(P), g)
        dQ = _matrix(step, n)
        a = _longest(R, units.left(dQ), decrement)
        a, broken = np.where(ended, 0.0, a), ~np.isfinite(decrement)
        Q = np.where(broken[:, None, None], Q, Q + a[:, None, None] * _finite(dQ))
        last = mu <= least
        good, ended = good & ~(broken & ~ended), ended | broken | (last & (decrement < CENTRED))
        mu = np.where(decrement < NEAR, np.maximum(mu * LOWER, least), mu)
    return good & ended, Q


def _first(units: _Units) -> tuple[Any, Array]:
    """Return which points have a Q with all S_i > 0, and one of each.

    Of S_i + t I that t is lowered, until it is not needed.
    """
    count, k, n = units.F.shape[:3]
    most = np.linalg.eigvalsh(units.M).max(axis=(1, 2))
    Q = (2 * np.maximum(most, 1.0))[:, None, None] * np.eye(n)
    t = 1 - 2 * np.minimum(np.linalg.eigvalsh(units.left(Q) - units.M).min(axis=(1, 2)), 0.0)
    mu, eye = np.ones(count), np.eye(n)
    found, ended = np.zeros(count, dtype=bool), ~units.known
    for _ in range(FIRST):
        bare = units.left(Q) - units.M
        found = units.known & (np.linalg.eigvalsh(bare).min(axis=(1, 2)) > 0)
        ended = ended | found
        if np.all(ended):
            break
        S = bare + t[:, None, None, None] * eye
        R = _root(S)
        P = R @ _turned(R)
        squares = P @ P
        border = _vector(units.adjoint(squares))
        g = np.concatenate(
            [_vector(-units.adjoint(P)), (1 / mu - np.einsum("pkii->p", P))[:, None]], axis=1
        )
        H = np.zeros((count, len(g[0]), len(g[0])))
        H[:, :-1, :-1] = units.hessian(P)
        H[:, -1, :-1] = H[:, :-1, -1] = border
        H[:, -1, -1] = np.einsum("pkii->p", squares)
        step, decrement = _newton(H, g, SHIFT)
        dQ, dt = _matrix(step[:, :-1], n), step[:, -1]
        a = _longest(R, units.left(dQ) + dt[:, None, None, None] * eye, decrement)
        broken = ~np.isfinite(decrement)
        # where every order is stable Q may grow for ever: it is to grow no more than it has to
        more = np.abs(np.einsum("pii->p", _finite(dQ)))
        a = np.minimum(a, GROWN * np.einsum("pii->p", Q) / np.maximum(more, 1e-300))
        a = np.where(ended | broken, 0.0, a)
        Q, t = Q + a[:, None, None] * _finite(dQ), t + a * _finite(dt)
        ended = ended | broken | ((decrement < NEAR) & (mu * n * k < NONE * np.maximum(t, 1.0)))
        mu = np.where(decrement < NEAR, mu * LOWER, mu)
    return found, Q


def _slopes(units: _Units, Q: Array, gap: float) -> tuple[Array, Array]:
    """Return slopes of <W, Q> at centres with respect to F and M, in the states' own units.

    With Lambda = H^-1 W, of <Lambda, sum_i (P_i - F_i P_i F_i')>; and as mu is a share of the cost
    where orders are random, of that one.
    """
    n, k = units.F.shape[-1], units.F.shape[1]
    R = _root(units.left(Q) - units.M)
    P = R @ _turned(R)
    W = _vector(units.W)
    Lambda = _matrix(_solved(units.hessian(P), W), n)[:, None]
    Y = P @ (units.left(Lambda[:, 0])) @ P
    F, Qk = units.F, Q[:, None]
    dF = 2 * (Qk @ F @ Y - Lambda @ F @ P)
    dM = Y
    # more of mu: W / mu = sum_i (P_i - F_i P_i F_i') where H dQ = W / mu^2 dmu
    mu = gap / (n * k)
    rate = np.einsum("pi,pi->p", W, _vector_of(Lambda[:, 0])) / mu**2 * mu
    mean = _kron(F, F).mean(axis=1)
    observed = _solved(
        np.eye(n * n) - _turned(mean), units.M.mean(axis=1).reshape(len(Q), -1)
    ).reshape(Q.shape)
    X = _solved(np.eye(n * n) - mean, units.W.reshape(len(Q), -1)).reshape(Q.shape)
    share = rate[:, None, None, None]
    dF = dF + share * 2 / k * (observed[:, None] @ F @ X[:, None])
    dM = dM + share / k * X[:, None]
    inverse, T = np.linalg.inv(units.T)[:, None], units.T[:, None]
    # what is bounded is the base times that in units; and in these F is T^-1 F T
    base = units.base[:, None, None, None]
    return base * _turned(inverse) @ dF @ _turned(T), T @ dM @ _turned(T)


def _turned(M: Any) -> Any:
    return np.swapaxes(M, -1, -2)


def _kron(X: Any, Y: Any) -> Any:
    """Return the products of Kronecker of matrices."""
    n = X.shape[-1]
    product = X[..., :, None, :, None] * Y[..., None, :, None, :]
    return product.reshape(*X.shape[:-2], n * n, n * n)


def _upper(n: int) -> tuple[Any, Any]:
    i, j = np.triu_indices(n)
    return i, j


def _vector(X: Array) -> Array:
    """Return what <X, .> is of symmetric matrices' entries on and above the diagonal."""
    i, j = _upper(X.shape[-1])
    return np.asarray(X[:, i, j] + X[:, j, i] * (i != j))


def _vector_of(X: Array) -> Array:
    """Return the entries of symmetric matrices on and above the diagonal."""
    i, j = _upper(X.shape[-1])
    return np.asarray(X[:, i, j])


def _matrix(x: Array, n: int) -> Array:
    """Return the symmetric matrices of such entries."""
    i, j = _upper(n)
    X = np.zeros((len(x), n, n))
    X[:, i, j] = X[:, j, i] = x
    return X


def _solved(H: Array, g: Array) -> Array:
    """Return H^-1 g of each point; not a number where it is singular."""
    try:
        return np.asarray(np.linalg.solve(H, g[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.stack([_one_solved(*pair) for pair in zip(H, g, strict=True)])


def _one_solved(H: Array, g: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(H, g))
    except np.linalg.LinAlgError:
        return np.full_like(g, np.nan)


def _root(S: Array) -> Array:
    """Return R with R'S R = I, so that S^-1 = R R'."""
    values, V = np.linalg.eigh(S)
    return np.asarray(V / np.sqrt(np.maximum(values, 1e-300))[..., None, :])


def _finite(X: Array) -> Array:
    return np.nan_to_num(X, nan=0.0, posinf=0.0, neginf=0.0)


def _newton(H: Array, g: Array, shift: float = 0.0) -> tuple[Array, Array]:
    """Return Newton's step and decrement at each point; H is scaled to a diagonal of ones."""
    size = np.sqrt(np.maximum(np.einsum("pii->pi", H), 1e-300))
    scaled = H / size[:, :, None] / size[:, None, :] + shift * np.eye(H.shape[-1])
    step = -_solved(scaled, g / size) / size
    decrement = -np.einsum("pi,pi->p", step, g)
    return step, np.where(decrement >= -1e-12, np.maximum(decrement, 0.0), np.nan)


def _longest(R: Array, dS: Array, decrement: Array) -> Array:
    """Return how much of a step is taken: all of it near the centre, else most of the way out."""
    moved = _turned(R) @ _finite(dS) @ R
    out = -np.linalg.eigvalsh((moved + _turned(moved)) / 2).min(axis=(1, 2))
    most = np.minimum(1.0, SHORT / np.maximum(out, 1e-300))
    damped = np.maximum(most / 2, most / (1 + np.sqrt(_finite(decrement))))
    return np.asarray(np.where(decrement < NEAR, most, damped))
