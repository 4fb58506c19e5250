"""The smallest radius of a condition, by bracketing with a conic solver, Clarabel.

Each solve is made in the coordinates of the best Lyapunov matrix so far: maximise t subject to
r D(x) - M(x) >= t I in every block, sum of traces of D(x) fixed. The status is evidence, not truth:
a point that the solver returns is judged by its own generalised eigenvalue, which usually lies well
below the radius that was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.base.errors import SolverError
from polefence.base.progress import stage
from polefence.lmi.conditions.methods import Method, Scheduled, build
from polefence.lmi.conditions.pencil import Pencil, smat
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.search import Reached, lyapunov_mean
from polefence.lmi.solve.starts import common_point, nominal_start, reachability
from polefence.plant.system import Array

TOLERANCE = 2e-5  # of the bracket, relative to the radius
FLOOR = 1e-3  # a radius of this share of sigma is as good as zero
MAX_SOLVES = 40
MAX_TRIES = 4  # at one radius, each in the coordinates the last one found
PROGRESS = 0.2  # share of the way to the radius that makes another try worth while
CONVINCING = 1e-4  # an infeasible margin must be this share of what good coordinates would give
NOISE = 2e-8  # margins below the solver's own accuracy say nothing


@dataclass(frozen=True, eq=False)
class Margin:
    """A point x with its margin t, and whether the solver says it is optimal."""

    x: Array
    t: float
    optimal: bool


def largest_margin(pencil: Pencil, r: float, time_limit: float = 60.0) -> Margin:
    """Return the point of the largest margin at radius r.

    Raises
    ------
    SolverError
        If the solver raised, in whatever way, or gave no finite point.
    """
    # deferred: they take longer to import than the rest of the package
    import clarabel
    import scipy.sparse as sp
    from threadpoolctl import threadpool_limits

    sizes = [b.size for b in pencil.blocks]
    identity = np.concatenate([_svec_identity(size) for size in sizes])
    trace = identity @ pencil.D / sum(sizes)
    n = pencil.unknowns
    # Clarabel: minimise q'z with b - A z in the cone; z = (x, t).
    A = sp.vstack(
        [
            sp.hstack([sp.csr_array(trace[None, :]), sp.csr_array((1, 1))]),
            sp.hstack([pencil.M - r * pencil.D, sp.csr_array(identity[:, None])]),
        ],
        format="csc",
    )
    b = np.concatenate([[1.0], np.zeros(identity.size)])
    q = np.concatenate([np.zeros(n), [-1.0]])
    cones = [clarabel.ZeroConeT(1), *(clarabel.PSDTriangleConeT(size) for size in sizes)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    try:
        with stage(f"second opinion, radius {r:.6g}"), threadpool_limits(1):
            P = sp.csc_matrix((n + 1, n + 1))
            solution = clarabel.DefaultSolver(P, q, sp.csc_matrix(A), b, cones, settings).solve()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # a Rust panic is no Exception
        raise SolverError(f"Clarabel raised {type(error).__name__}: {error}") from error
    z = np.array(solution.x)
    if z.shape != (n + 1,) or not np.all(np.isfinite(z)):
        raise SolverError(f"Clarabel gave no point: {solution.status}")
    return Margin(z[:n], float(z[n]), str(solution.status) in ("Solved", "AlmostSolved"))


def _svec_identity(size: int) -> Array:
    columns = np.arange(1, size + 1)
    vector = np.zeros(size * (size + 1) // 2)
    vector[columns * (columns + 1) // 2 - 1] = 1.0
    return vector


def smallest_radius(A: Array, B: Array, sigma: float, method: Method) -> Reached:
    """Bracket the least radius at which the condition is feasible.

    Parameters
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    sigma : float
        The centre is -sigma [1/s].
    method : str or Scheduled

    Raises
    ------
    SolverError
        If the solver answered none of the questions.
    """
    search = _Search(A, B, sigma, method)
    # A point of a narrower condition is a point of this one, and gives it good coordinates.
    if isinstance(method, Scheduled) and method.right_hand_sides:
        search.seed(smallest_radius(A, B, sigma, "scheduled"))
    elif method != "quadratic":
        search.seed(smallest_radius(A, B, sigma, "quadratic"))
    return _narrow(search)


def _narrow(search: _Search) -> Reached:
    # `low` was found infeasible; `soft` is where the solver failed, believed until the best point,
    # and with it the coordinates, have improved.
    low = soft = 0.0
    doubted = np.inf
    for step in range(MAX_SOLVES):
        high = search.best.r
        if high <= FLOOR * search.sigma:
            break
        if high <= low:  # the solver erred when it said infeasible
            low = soft = 0.0
        if high - max(low, soft) <= TOLERANCE * high:
            if soft <= low or high >= doubted * (1 - TOLERANCE):
                break
            soft = low
            continue
        floor = max(low, soft)
        target = search.target(floor, high) if step % 3 < 2 else (floor + high) / 2
        verdict = search.attempt(target)
        if verdict is None:
            soft, doubted = target, search.best.r
        elif not verdict:
            low = max(low, target)
    if not search.margins and search.best.r > FLOOR * search.sigma:
        raise SolverError("the solver answered no question")
    return search.best


class _Search:
    """The state of one search: best point, its coordinates, and the margins seen on either side."""

    def __init__(self, A: Array, B: Array, sigma: float, method: Method) -> None:
        self.A, self.B, self.sigma, self.method = A, B, sigma, method
        self.plain = balanced(A, B, sigma)
        start = nominal_start(A, B, sigma, self.plain)
        self.scaling = self._coordinates(start.W)
        self.reachable = self._coordinates(reachability(A, B, sigma, self.plain))
        self.variables = build(method, A, B, sigma).variables
        self.best = Reached(r=start.radius, values=start.values(self.variables))
        self.margins: list[tuple[float, float]] = []

    def seed(self, found: Reached) -> None:
        """Begin at a point of Lemma 1, or at one of this condition without its right-hand sides."""
        if found.r < self.best.r:
            W = lyapunov_mean(found.values)
            values = common_point(W, found.values.get("Z", W), self.variables) | found.values
            self.best = Reached(r=found.r, values={v.name: values[v.name] for v in self.variables})
            self.scaling = self._coordinates(W)

    def _coordinates(self, W: Array) -> Scaling:
        try:
            return self.plain.refined(W)
        except SolverError:
            return self.plain

    def target(self, low: float, high: float) -> float:
        """Next radius to ask: beside the secant's root of the margin, or the middle.

        Asking on the farther side of the root moves that end of the bracket to it.
        """
        middle = (low + high) / 2
        if len(self.margins) < 2:
            return middle
        (r0, t0), (r1, t1) = self.margins[-2:]
        if (t1 - t0) * (r1 - r0) <= 0:
            return middle
        root = r1 - t1 * (r1 - r0) / (t1 - t0)
        step = max(0.3 * TOLERANCE * high, 0.05 * abs(root - r1))
        target = root + step if high - root > root - low else root - step
        return float(target) if low < target < high else middle

    def attempt(self, radius: float) -> bool | None:
        """Look for a better point at a radius: found, infeasible, or (None) undecided."""
        for _ in range(MAX_TRIES):
            before = self.best.r
            verdict = self._attempt(radius, self.scaling)
            if verdict is not None:
                return verdict
            if before - self.best.r < PROGRESS * (before - radius):
                break  # better coordinates no longer help
        for scaling in (self.plain, self.reachable):
            verdict = self._attempt(radius, scaling)
            if verdict is not None:
                return verdict
        return None

    def _attempt(self, radius: float, scaling: Scaling) -> bool | None:
        try:
            A, B = scaling.apply(self.A, self.B)
            pencil = build(self.method, A, B, self.sigma / scaling.rate, scaling.unit)
            point = largest_margin(pencil, radius / scaling.rate)
            reached = scaling.rate * reach(pencil, point.x)
        except (SolverError, np.linalg.LinAlgError):
            return None
        self.margins.append((radius, point.t))
        if reached < self.best.r:
            values = scaling.restore(pencil.unpack(point.x), pencil.variables)
            self.best = Reached(r=reached, values=values)
            self.scaling = self._coordinates(lyapunov_mean(values))
        if reached <= radius:
            return True
        # In poor coordinates margins are tiny on both sides of the root, and prove nothing.
        doubt = max(NOISE, CONVINCING * (self.best.r - radius) / scaling.rate)
        return False if point.optimal and point.t < -doubt else None


def reach(pencil: Pencil, x: Array) -> float:
    """Largest generalised eigenvalue, the least r with r D(x) - M(x) >= 0; inf without D(x) > 0."""
    size = np.array([b.size for b in pencil.blocks])
    cuts = np.cumsum(size * (size + 1) // 2)[:-1]
    D, M = np.split(pencil.D @ x, cuts), np.split(pencil.M @ x, cuts)
    largest = 0.0
    for same in (np.flatnonzero(size == s) for s in set(size)):
        try:
            T = np.linalg.cholesky(smat(np.stack([D[i] for i in same])))
        except np.linalg.LinAlgError:
            return float("inf")
        half = np.linalg.solve(T, smat(np.stack([M[i] for i in same])))
        pulled = np.linalg.solve(T, half.transpose(0, 2, 1))
        largest = max(largest, float(np.linalg.eigvalsh(pulled).max()))
    return largest
