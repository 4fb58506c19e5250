"""Lyapunov polynomials of a loop with a dead time, by interpolation: no LMI is solved.

With delta in [-1, 1] the loop is A + delta h e', C + delta d e', E + delta h f' and F + delta d f'.
A constant X bounds what noise reaches, for every delta of any rate, just where with a number lambda

    A X + X A' + E E' + lambda h h' + X e e'X / lambda <= 0

(Petersen, 1987). The least X of a lambda solves a Riccati equation. So does the least Q of a gain,
in the dual form, with h beside E. One lambda is sought for all nodes: the one with which the worst
of them has the least level. The polynomial that has these values at nodes misses the inequality; a
constant R, added to E E', makes up for that, as in `along_motions`. A limit of a van with 11 states
and three parameters takes 5 to 8 s, in 5 to 8 parts of the box, where an LMI took 107 s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from polefence.lmi.solve.dual_problem import Dual, DualProblem
from polefence.lmi.solve.gramians import OVER, ROUNDS, SMALL, majorant, root
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array

# Of lambda beside its first guess: where the best is sought, and how near.
SPAN, STEPS = 4, 6  # decades
GOLDEN = (3 - 5**0.5) / 2
START = 1e-6  # of R, as a share of what the slowest mode adds to each state
# R is to cost little of the output, and some of what is late: shares of the latter, one by one.
SHARES = (1e-6, 1e-4, 1e-2)
MET = 1e-6  # what a Riccati equation may be off by, relatively
NEAR = 5e-3  # above the worst sample: no other share is tried then
LEAST = 1e-12  # of the largest variance: what a state is taken to have at least
GAINS = (1.003, 1.01, 1.03, 1.1, 1.3, 2.0, 5.0)  # times the worst sample: what is tried of a gain


@dataclass(frozen=True, eq=False)
class _Node:
    """A loop: A, E, C and F at delta = 0, and what stands with it, [h; d] [e, f]'."""

    A: Array
    E: Array
    C: Array
    F: Array
    h: Array
    d: Array
    e: Array
    f: Array

    @classmethod
    def of(cls, low: Sequence[Array], high: Sequence[Array]) -> _Node:
        """Return it from A, C, E and F at both ends of delta."""
        (A, C, E, F), moved = (
            [(x + sign * y) / 2 for x, y in zip(high, low, strict=True)] for sign in (1, -1)
        )
        n = len(A)
        U, s, V = np.linalg.svd(np.block([[moved[0], moved[2]], [moved[1], moved[3]]]))
        left, right = U[:, 0] * np.sqrt(s[0]), V[0] * np.sqrt(s[0])
        return cls(A, E, C, F, left[:n], left[n:], right[:n], right[n:])

    @property
    def slowest(self) -> float:
        """The rate of its slowest mode."""
        return float(np.abs(np.linalg.eigvals(self.A).real).min())

    def least(self, times: float, R: Array, level: float) -> Array | None:
        """Return the least Q for a lambda, of a gain; None where there is none."""
        B, V = np.column_stack([self.h, self.E]), np.column_stack([self.d, self.F])
        G = np.concatenate([[0.0], self.f])[None]
        inner = V.T @ V / level + times * G.T @ G
        inner -= np.diag([times, *[level] * self.E.shape[1]])
        if np.linalg.eigvalsh(inner).max() >= 0:
            return None
        weight = self.C.T @ self.C / level + times * np.outer(self.e, self.e) + R
        return solved(self.A, B, weight, inner, self.C.T @ V / level + times * self.e[:, None] @ G)

    def reached(self, times: float, R: Array) -> Array | None:
        """Return the least X of A X + X A' + lambda h h' + X e e'X / lambda + R = 0."""
        inner = np.array([[-times]])
        return solved(self.A.T, self.e[:, None], times * np.outer(self.h, self.h) + R, inner)


def solved(A: Array, B: Array, weight: Array, inner: Array, S: Array | None = None) -> Array | None:
    """Return the stabilising solution of A'Q + Q A - (Q B + S) inner^-1 (.)' + weight = 0.

    None where there is none that is positive. It is that of the stable modes of the Hamiltonian
    matrix: where modes are on the imaginary axis there is none, and the equation is not met.
    """
    n = len(A)
    size = np.sqrt(np.maximum(np.diag(weight), np.diag(weight).max() * LEAST))
    A, B, weight = A * size[:, None] / size, B * size[:, None], weight / np.outer(size, size)
    S = np.zeros_like(B) if S is None else S / size[:, None]
    gain = np.linalg.solve(inner, np.hstack([B.T, S.T]))
    moved, rest = A - B @ gain[:, n:], weight - S @ gain[:, n:]
    values, V = np.linalg.eig(np.block([[moved, -B @ gain[:, :n]], [-rest, -moved.T]]))
    stable = V[:, values.real < 0]
    if stable.shape[1] != n:
        return None
    try:
        Q = np.linalg.solve(stable[:n].T, stable[n:].T).T.real
    except np.linalg.LinAlgError:
        return None
    Q = (Q + Q.T) / 2
    both, side = Q @ A, Q @ B + S
    left = both + both.T - side @ np.linalg.solve(inner, side.T) + weight
    if not np.abs(left).max() < MET * np.abs(both).max():  # nor where it is no number
        return None
    Q = Q * np.outer(size, size)
    size = np.sqrt(np.maximum(np.diag(Q), 0))
    scaled = Q / np.outer(np.where(size > 0, size, 1), np.where(size > 0, size, 1))
    return np.asarray(Q) if np.linalg.eigvalsh(scaled).min() >= -SMALL else None


@dataclass(frozen=True, eq=False)
class Late:
    """Loops of a family whose number ``number`` of the parameters stands for a dead time."""

    problem: DualProblem
    number: int

    @property
    def domain(self) -> Domain:
        """The box of all other parameters."""
        sizes = list(self.problem.domain.sizes)
        del sizes[self.number]
        return Domain(tuple(sizes) or (1,))

    def ends(self, alpha: Array) -> list[Array]:
        """Return points of the whole box with delta at -1 and at 1."""
        count = len(self.problem.domain.sizes)
        table = alpha.reshape(len(alpha), *(2,) * (count - 1))
        ends = (
            np.stack([one * table, (1 - one) * table], axis=self.number + 1) for one in (1.0, 0.0)
        )
        return [end.reshape(len(alpha), -1) for end in ends]

    def nodes(self, degree: int) -> list[_Node]:
        """Return the loops at the nodes of a degree."""
        low, high = (self.problem.closed(at) for at in self.ends(self.domain.nodes(degree)))
        rows = zip(zip(*low, strict=True), zip(*high, strict=True), strict=True)
        return [_Node.of(*pair) for pair in rows]

    @cached_property
    def middle(self) -> _Node:
        """The loop at the middle of the box."""
        return self.nodes(0)[0]

    def whole(self, Q: Array, degree: int) -> Array:
        """Return coefficients on the whole box of a polynomial that does not depend on delta."""
        if self.domain.corners == 1:
            return Q
        own, f = {e: k for k, e in enumerate(self.domain.monomials(degree))}, 2 * self.number
        every = self.problem.domain.monomials(degree)
        return Q[[own[(*e[:f], *e[f + 2 :])] for e in every]]


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for R at one degree.

    Attributes
    ----------
    least : callable
        From a node, lambda and R to the least Q.
    missed : callable
        From Q to how much each coefficient of the inequality is violated.
    cost : callable
        From a node and Q to what is to be small.
    times : float
        A first guess of lambda.
    inverse : (n, n) array
        Of coordinates in which R costs alike in all directions.
    """

    late: Late
    degree: int
    least: Callable[[_Node, float, Array], Array | None]
    missed: Callable[[Array], Array]
    cost: Callable[[_Node, Array], float]
    times: float
    inverse: Array

    @cached_property
    def nodes(self) -> list[_Node]:
        """Loops at nodes."""
        return self.late.nodes(self.degree)

    def best(self, R: Array, guess: float, decades: int) -> float | None:
        """Return the best lambda for all nodes; None where none so near a guess will do."""

        def cost(x: float) -> float:
            worst = 0.0
            for node in self.nodes:
                Q = self.least(node, guess * 10**x, R)
                worst = np.inf if Q is None else max(worst, self.cost(node, Q))
                if worst == np.inf:
                    break
            return worst

        if not np.isfinite(guess) or guess <= 0:
            return None
        tried = np.linspace(-decades, decades, 6 * decades + 1)
        costs = [cost(x) for x in tried]
        k = int(np.argmin(costs))
        if not np.isfinite(costs[k]):
            return None
        low, high = tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)]
        for _ in range(STEPS):
            a, b = low + (high - low) * GOLDEN, high - (high - low) * GOLDEN
            at_a = cost(a)
            if np.isfinite(at_a) and at_a <= cost(b):
                high = b
            else:  # too small a lambda has no X
                low = a
        middle = (low + high) / 2
        return float(guess * 10 ** (middle if cost(middle) <= costs[k] else tried[k]))

    def polynomial(self, R: Array) -> Array | None:
        """Return coefficients without one that is violated, None where none is found."""
        times = self.best(R, self.times, SPAN)
        T, over = np.linalg.inv(self.inverse), OVER
        for _ in range(ROUNDS):
            if times is None:
                return None
            values = [self.least(node, times, R) for node in self.nodes]
            found = [Q for Q in values if Q is not None]
            if len(found) < len(values):
                return None
            Q = self.late.domain.interpolated(np.stack(found), self.degree)
            missed = self.inverse @ self.missed(Q) @ self.inverse.T
            worst = float(np.linalg.eigvalsh(missed).max())
            if worst < 0:
                return Q
            more = over * majorant(missed) + 1e-3 * worst * np.eye(len(T))
            R, over = R + T @ more @ T.T, over * OVER
            times = self.best(R, times, 2)  # more noise takes more of it
        return None


@dataclass(frozen=True, eq=False)
class LateSearch:
    """The search for X of a noise, or Q of a gain, of one degree, on a part of the box or all."""

    problem: DualProblem
    degree: int

    @cached_property
    def late(self) -> Late:
        """The loops."""
        known = self.problem.plant.dead_time
        return Late(self.problem, known[0] if known else 0)

    @property
    def nearest(self) -> float:
        """The least level that is proved at each of the corners: none of the family is lower.

        Zero where none is found.
        """
        late = self.late
        nodes = late.nodes(1) if late.domain.corners > 1 else late.nodes(0)
        levels = [_alone(node, self.problem.gain) for node in nodes]
        return max((level for level in levels if level is not None), default=0.0)

    def least(self, worst: float) -> Dual | None:
        """Return one as near the worst sample as there is."""
        if not self.problem.gain:
            return _of_noise(self.late, self.degree, worst * (1 + NEAR))
        found = (_of_gain(self.late, self.degree, worst * times) for times in GAINS)
        return next((dual for dual in found if dual is not None), None)

    def proving(self, level: float) -> Dual | None:
        """Return one that proves a level."""
        if self.problem.gain:
            return _of_gain(self.late, self.degree, level)
        return _of_noise(self.late, self.degree, level)


def _alone(node: _Node, gain: bool) -> float | None:
    """Return the least level that is proved of one loop; None where none is found."""
    observed, covariance = _gramians(node)
    none = np.zeros_like(node.A)
    tried = 10.0 ** np.linspace(-SPAN, SPAN, 12 * SPAN + 1)
    if not gain:
        first = _balance(node, observed, covariance)
        found = (node.reached(first * x, node.E @ node.E.T) for x in tried)
        squares = [float(np.trace(node.C @ X @ node.C.T)) for X in found if X is not None]
        return float(np.sqrt(min(squares))) if squares else None
    low = high = float(np.sqrt(np.trace(node.E.T @ observed @ node.E) / node.slowest))
    first = _balance_of_gain(node, observed, covariance)

    def holds(level: float) -> bool:
        return any(node.least(first * x / level, none, level) is not None for x in tried)

    for _ in range(40):
        if holds(high):
            break
        high *= 2
    else:
        return None
    low = high / 2
    while holds(low) and low > 1e-9 * high:
        low /= 2
    high = 2 * low
    for _ in range(14):
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _balance(node: _Node, observed: Array, covariance: Array) -> float:
    """Return the lambda of which both terms add as much to the output of a noise."""
    seen = covariance @ node.e
    return float(np.sqrt((seen @ observed @ seen) / (node.h @ observed @ node.h)))


def _balance_of_gain(node: _Node, observed: Array, covariance: Array) -> float:
    """Return the same of a gain, times its level."""
    seen = observed @ node.h
    return float(np.sqrt((seen @ covariance @ seen) / (node.e @ covariance @ node.e)))


def _of_noise(late: Late, degree: int, enough: float) -> Dual | None:
    """Return X whose C X C' is near the least, or that proves a level that is enough."""
    problem, domain = late.problem, late.domain
    total = max(degree + problem.rows, 2 * problem.driving_degree)
    at = domain.nodes(total)
    basis = domain.basis(at, degree)
    loops = [problem.closed(end) for end in late.ends(at)]

    def missed(X: Array) -> Array:
        values = np.tensordot(basis, X, 1)
        return np.concatenate([_growth(domain, A, values, E, total) for A, _, E, _ in loops])

    def least(node: _Node, x: float, R: Array) -> Array | None:
        return node.reached(x, node.E @ node.E.T + R)

    middle = late.middle
    observed, covariance = _gramians(middle)
    times = _balance(middle, observed, covariance)
    moved = times * _lyapunov(middle.A.T, np.outer(middle.e, middle.e))

    def cost(node: _Node, X: Array) -> float:
        return float(np.trace(node.C @ X @ node.C.T))

    usual = START * middle.slowest * _diagonal(covariance)
    Y, best = loops[0][1], None
    for share in SHARES:
        inverse = root(observed + share * moved).T
        X = _Search(late, degree, least, missed, cost, times, inverse).polynomial(usual)
        if X is None:
            continue
        rows = domain.interpolated(Y @ np.tensordot(basis, X, 1), total)
        raised = domain.interpolated(np.tensordot(basis, X, 1), total)
        if np.linalg.eigvalsh(raised).min() <= 0:
            continue
        behind = np.linalg.solve(raised, rows.swapaxes(-1, -2)).swapaxes(-1, -2)
        level = float(np.sqrt((rows * behind).sum((1, 2)).max()))
        if best is None or level < best.level:
            best = Dual(late.whole(X, degree), degree, level, reached=True)
        if best.level < enough:
            break
    return best


def _of_gain(late: Late, degree: int, level: float) -> Dual | None:
    """Return Q that proves a gain."""
    problem, domain = late.problem, late.domain
    total = max(degree + problem.rows, 2 * problem.rows, 2 * (degree + problem.driving_degree))
    at = domain.nodes(total)
    basis = domain.basis(at, degree)
    loops = [problem.closed(end) for end in late.ends(at)]
    middle = late.middle
    observed, covariance = _gramians(middle)
    times = _balance_of_gain(middle, observed, covariance)
    moved = _lyapunov(middle.A, np.outer(middle.h, middle.h)) / times
    times /= level

    def missed(Q: Array) -> Array:
        values, found = np.tensordot(basis, Q, 1), list[Array]()
        for A, C, E, F in loops:
            inner = level * np.eye(E.shape[2]) - F.swapaxes(-1, -2) @ F / level
            side = values @ E + C.swapaxes(-1, -2) @ F / level
            lost = side @ np.linalg.solve(inner, side.swapaxes(-1, -2))
            half = values @ A
            both = half + half.swapaxes(-1, -2) + C.swapaxes(-1, -2) @ C / level
            found.append(domain.interpolated(both + lost, total))
        return np.concatenate(found)

    def cost(node: _Node, Q: Array) -> float:
        return float(np.trace(node.E.T @ Q @ node.E))

    def least(node: _Node, x: float, R: Array) -> Array | None:
        return node.least(x, R, level)

    usual = START * middle.slowest * _diagonal(observed) / level
    for share in SHARES:
        inverse = root(covariance + share * moved).T
        Q = _Search(late, degree, least, missed, cost, times, inverse).polynomial(usual)
        if Q is not None:
            return Dual(late.whole(Q, degree), degree, level)
    return None


def _diagonal(X: Array) -> Array:
    """Return the diagonal of a Gramian, of no state that is lost in rounding."""
    sizes = np.diag(X)
    return np.diag(np.maximum(sizes, LEAST * sizes.max()))


def _growth(domain: Domain, A: Array, X: Array, E: Array, total: int) -> Array:
    """Return the coefficients of A X + X A' + E E'."""
    half = A @ X
    values = half + half.swapaxes(-1, -2) + E @ E.swapaxes(-1, -2)
    return domain.interpolated(values, total)


def _lyapunov(A: Array, weight: Array) -> Array:
    """Return X of A X + X A' + weight = 0."""
    from scipy.linalg import solve_continuous_lyapunov  # deferred: slow to import

    return np.asarray(solve_continuous_lyapunov(A, -weight))


def _gramians(node: _Node) -> tuple[Array, Array]:
    """Return the observability Gramian, and the covariance of unit noise."""
    return _lyapunov(node.A.T, node.C.T @ node.C), _lyapunov(node.A, node.E @ node.E.T)
