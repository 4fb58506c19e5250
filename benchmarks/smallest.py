"""The smallest radius: bisection over CVXPY against the direct search, with and without proof.

python benchmarks/smallest.py --section all
python benchmarks/smallest.py --section one --quick

The peer is what one writes without polefence: the condition in CVXPY, compiled once for each plant
and method with the radius as a parameter (DPP), the margin maximised, and the radius bisected to
1e-4 of itself, over Clarabel; for the quarter car also over SCS and CVXOPT. Its data are balanced
as polefence balances them. Ours are `smallest` on both engines and `smallest_disk`, which
also proves the radius and a lower bound in exact arithmetic; the peer proves nothing. All run in
one process on one thread, turn by turn. Times are medians of wall-clock times; the peer's include
building its problem once, and what Clarabel reports of its own time stands beside them: no other
modelling layer could be faster than that. Ours keep a condition's layout from the first plant of a
shape on; what the first one takes is given too. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"
os.environ["RAYON_NUM_THREADS"] = "1"

import argparse
import gc
import platform
import signal
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from itertools import combinations, permutations
from statistics import median
from typing import Any
from unittest.mock import patch

import cvxpy as cp
import numpy as np

import polefence
from polefence import METHODS, UncertainPlant
from polefence.base.errors import PolefenceError
from polefence.examples import family
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import search
from polefence.lmi.solve import stacked as stacked_module
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import Reached
from polefence.lmi.solve.smallest import smallest
from polefence.lmi.solve.stacked import Stacked
from polefence.plant.system import Array
from polefence.search.by_lmi import smallest_disk

TOLERANCE = 1e-4  # of the bracket, relative to its upper end
TOP = 1.25  # first upper end, in units of sigma
NEAR_TOP = 0.8  # a lower end so near an upper end never solved for: solve there, and widen
WIDENINGS = 12
WRONG = 1e-3  # a radius off by more than this share is called wrong
CARS = ("quarter-car-physical", "quarter-car-as-printed")
SIGMA = 40.0
SEEDS = 5
# (vertices, states) of the growth section
BY_VERTICES = ((2, 5), (4, 5), (8, 5), (16, 5))
BY_STATES = ((8, 3), (8, 5), (8, 8), (8, 10))
TOLERANCES = ("tol_gap_abs", "tol_gap_rel", "tol_feas")
# label, CVXPY's name, options; CVXPY's own settings unless the label says otherwise
OTHERS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("Clarabel, 1e-12", "CLARABEL", dict.fromkeys(TOLERANCES, 1e-12)),
    ("SCS", "SCS", {}),
    ("SCS, eps 1e-8", "SCS", {"eps": 1e-8, "max_iters": 200_000}),
    ("CVXOPT", "CVXOPT", {}),
)


class TooSlowError(Exception):
    """The time for one run is up."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise TooSlowError in the body once the time is up (and the solver is back in Python)."""

    def ring(number: int, frame: object) -> None:  # noqa: ARG001
        raise TooSlowError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


# --- the peer ------------------------------------------------------------------------------------


@dataclass
class Question:
    """A condition as a CVXPY problem; it is met at the radius r if its largest margin t > 0."""

    problem: cp.Problem
    r: cp.Parameter
    t: cp.Variable


def question(A: Array, B: Array, sigma: float, method: str) -> Question:
    """Build the problem for vertices A (N, n, n), B (N, n, m) and centre -sigma."""
    N, n, m = B.shape
    r, t = cp.Parameter(nonneg=True), cp.Variable()
    constraints = []

    def disk(D: Any, M: Any, right: Any = None) -> None:
        corner = r * (D if right is None else right)
        constraints.append(cp.bmat([[r * D, M], [M.T, corner]]) >> t * np.eye(2 * n))

    def symmetric() -> cp.Variable:
        return cp.Variable((n, n), symmetric=True)

    def product(j: int, X: Any, Z: Any) -> Any:
        return A[j] @ X + B[j] @ Z + sigma * X

    if method == "quadratic":
        W = [symmetric()]
        Z = cp.Variable((m, n))
        for j in range(N):
            disk(W[0], product(j, W[0], Z))
    elif method == "slack":
        W = [symmetric() for _ in range(N)]
        G, L = cp.Variable((n, n)), cp.Variable((m, n))
        for j in range(N):
            disk(W[j], product(j, G, L), G + G.T - W[j])
    else:
        W = [symmetric() for _ in range(N)]
        Zs = [cp.Variable((m, n)) for _ in range(N)]
        M = [[product(j, W[k], Zs[k]) for k in range(N)] for j in range(N)]
        for j in range(N):
            disk(W[j], M[j][j])
        for j, k in permutations(range(N), 2):
            disk(2 * W[j] + W[k], M[j][j] + M[j][k] + M[k][j])
        for triple in combinations(range(N), 3):
            mixed = sum(M[p][q] for p, q in permutations(triple, 2))
            disk(2 * sum(W[p] for p in triple), mixed)
    constraints.append(sum(cp.trace(X) for X in W) == 1)
    return Question(cp.Problem(cp.Maximize(t), constraints), r, t)


@dataclass
class Peer:
    """What a bisection came to.

    Attributes
    ----------
    radius : float or None
        None where it did not finish.
    seconds, in_solver : float
        In all, and what the solver itself reports.
    solves, doubtful : int
        The latter failed, or are inaccurate in CVXPY's words.
    note : str
        Why there is no radius.
    """

    radius: float | None = None
    seconds: float = 0.0
    in_solver: float = 0.0
    solves: int = 0
    doubtful: int = 0
    note: str = ""

    def feasible(self, asked: Question, r: float, solver: str, options: dict[str, Any]) -> bool:
        """Answer one question; a solve that fails counts as no."""
        asked.r.value = r
        self.solves += 1
        try:
            asked.problem.solve(solver=solver, **options)
        except cp.SolverError:
            self.doubtful += 1
            return False
        self.in_solver += asked.problem.solver_stats.solve_time or 0.0
        self.doubtful += asked.problem.status != cp.OPTIMAL
        return asked.t.value is not None and bool(asked.t.value > 0)

    def bisect(
        self, A: Array, B: Array, sigma: float, method: str, solver: str, options: dict[str, Any]
    ) -> float:
        """Return the least radius found feasible."""
        scaling = balanced(A, B, sigma)
        scaled = sigma / scaling.rate
        asked = question(*scaling.apply(A, B), scaled, method)
        low, high, known, widened = 0.0, TOP * scaled, False, 0
        while high - low > TOLERANCE * high and high > TOLERANCE * scaled:
            at_top = not known and low >= NEAR_TOP * high
            middle = high if at_top else (low + high) / 2
            if self.feasible(asked, middle, solver, options):
                high, known = middle, True
            else:
                low = middle
            if low == high:
                if known or widened == WIDENINGS:
                    break
                high, widened = 2 * high, widened + 1
        if not known:
            raise cp.SolverError("no radius found feasible")
        return high * scaling.rate


def run_peer(
    A: Array,
    B: Array,
    sigma: float,
    method: str,
    limit: float,
    solver: str = "CLARABEL",
    options: dict[str, Any] | None = None,
) -> Peer:
    """Time one bisection, the building of its problem included."""
    with uncollected():
        return _run_peer(A, B, sigma, method, limit, solver, options)


def _run_peer(
    A: Array,
    B: Array,
    sigma: float,
    method: str,
    limit: float,
    solver: str,
    options: dict[str, Any] | None,
) -> Peer:
    peer, start = Peer(), time.perf_counter()
    extra = {"CLARABEL": {"time_limit": limit}, "SCS": {"time_limit_secs": limit}}.get(solver, {})
    try:
        with limited(limit):
            peer.radius = peer.bisect(A, B, sigma, method, solver, extra | (options or {}))
    except TooSlowError:
        peer.note = f"> {limit:g} s"
    except (cp.SolverError, ArithmeticError, ValueError) as error:
        peer.note = f"failed: {str(error).splitlines()[0][:40]}"
    peer.seconds = time.perf_counter() - start
    return peer


# --- output --------------------------------------------------------------------------------------


def say(text: str = "") -> None:
    """Print at once, so that a long run can be followed."""
    print(text, flush=True)


def heading(title: str, *columns: str) -> None:
    """Begin a table."""
    say(f"\n{title}\n")
    row(*columns)
    row(*["---"] * len(columns))


def row(*cells: object) -> None:
    """Print a line of a table."""
    say("| " + " | ".join(str(cell) for cell in cells) + " |")


def ms(seconds: float | None) -> str:
    """Milliseconds to three digits."""
    if seconds is None:
        return "-"
    value = 1e3 * seconds
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def times(peer: float | None, ours: float) -> str:
    """How many times as fast."""
    return "-" if peer is None else f"{peer / ours:.3g}"


def off(peer: Peer, radius: float) -> str:
    """How far the peer's radius lies above ours, or why there is none."""
    if peer.radius is None:
        return peer.note
    share = peer.radius / radius - 1
    wrong = " WRONG" if abs(share) > WRONG else ""
    return f"{share:+.1e}{wrong}"


def header() -> None:
    """Say what runs where."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "cvxpy", "clarabel"))
    others = ", ".join(f"{name} {version(name)}" for name in ("scs", "cvxopt"))
    say(
        f"{os.cpu_count()} CPUs, one thread used; Python {platform.python_version()}, {versions}, "
        f"{others}; polefence {polefence.__version__}, engine {polefence.engine()}"
    )


# --- ours ----------------------------------------------------------------------------------------


def clock(task: Callable[[], Any]) -> tuple[float, Any]:
    """Return seconds and result."""
    with uncollected():
        start = time.perf_counter()
        result = task()
        return time.perf_counter() - start, result


@contextmanager
def uncollected() -> Iterator[None]:
    """Keep garbage collection, of others' objects mostly, out of the time, as timeit does."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


# --- one radius ----------------------------------------------------------------------------------


@dataclass
class Measured:
    """All runs on one plant with one method, in seconds, and their last answers."""

    peers: list[Peer]
    numpy: list[float]
    compiled: list[float]
    first: list[float]
    above: list[float]
    proved: list[float]
    found: Reached
    upper: float
    lower: float | None

    @property
    def peer(self) -> float | None:
        """Median of the peer's runs that finished."""
        done = [p.seconds for p in self.peers if p.radius is not None]
        return median(done) if done else None


def measure(
    plant: UncertainPlant, sigma: float, method: str, ours: int, peers: int, limit: float
) -> Measured:
    """Run everything turn by turn; the peer in every few rounds."""
    A, B = plant.A, plant.B
    every = max(ours // peers, 1)
    for engine in ("numpy", "compiled"):
        smallest(A, B, Disks(-sigma), method, engine=engine)
    result = Measured([], [], [], [], [], [], Reached(r=0.0, values={}), 0.0, None)
    for k in range(ours):
        if k % every == 0 and len(result.peers) < peers:
            result.peers.append(run_peer(A, B, sigma, method, limit))
        result.numpy.append(clock(lambda: smallest(A, B, Disks(-sigma), method, engine="numpy"))[0])
        seconds, result.found = clock(
            lambda: smallest(A, B, Disks(-sigma), method, engine="compiled")
        )
        result.compiled.append(seconds)
        stacked_module._layout.cache_clear()
        run = clock(lambda: smallest(A, B, Disks(-sigma), method, engine="compiled"))
        result.first.append(run[0])
        above = clock(lambda: smallest_disk(plant, -sigma, method, bounds=False))
        result.above.append(above[0])
        seconds, (design, _) = clock(lambda: smallest_disk(plant, -sigma, method))
        result.proved.append(seconds)
        result.upper, result.lower = design.region.radius, design.lower
    return result


def one_radius(quick: bool, limit: float) -> None:
    """Print times and radii of single problems."""
    ours, peers = (3, 1) if quick else (21, 5)
    results = {
        (car, method): measure(family(car), SIGMA, method, ours, peers, limit)
        for car in CARS
        for method in METHODS
    }
    heading(
        f"### One radius (centre {-SIGMA:g}; medians of {ours} runs, of {peers} for CVXPY; "
        "x: times as fast as CVXPY)",
        *("plant", "method", "CVXPY + Clarabel [ms]", "of which Clarabel [ms]", "solves"),
        *(
            "NumPy [ms]",
            "x",
            "compiled [ms]",
            "x",
            "first of its shape [ms]",
            "x",
            "compiled, radius proved [ms]",
            "x",
            "compiled, both sides proved [ms]",
            "x",
        ),
        *("share of proofs", "iterations"),
    )
    for (car, method), r in results.items():
        quick_one, slow, full = median(r.compiled), median(r.numpy), median(r.proved)
        first, above = median(r.first), median(r.above)
        solver = median(p.in_solver for p in r.peers)
        row(
            *(car, method, ms(r.peer), ms(solver), r.peers[0].solves),
            *(ms(slow), times(r.peer, slow), ms(quick_one), times(r.peer, quick_one)),
            *(ms(first), times(r.peer, first)),
            *(ms(above), times(r.peer, above)),
            *(ms(full), times(r.peer, full), f"{1 - quick_one / full:.0%}", r.found.iterations),
        )
    heading(
        "Radii [1/s]: proved feasible, found, proved infeasible, and the peer's",
        *("plant", "method", "proved", "found", "proved out of reach", "gap"),
        *("CVXPY + Clarabel", "CVXPY / found - 1"),
    )
    for (car, method), r in results.items():
        lower = "none" if r.lower is None else f"{r.lower:.7g}"
        gap = "-" if r.lower is None else f"{1 - r.lower / r.upper:.1e}"
        peer = r.peers[0]
        reached = "-" if peer.radius is None else f"{peer.radius:.6g}"
        row(car, method, f"{r.upper:.7g}", f"{r.found.r:.7g}", lower, gap, reached,
            off(peer, r.found.r))  # fmt: skip
    other_peers(limit)


def other_peers(limit: float) -> None:
    """Print one run of each other solver on the physical quarter car."""
    heading(
        "CVXPY over other solvers or settings, physical quarter car, once (given up after "
        f"{limit:g} s)",
        *("method", "solver", "time [s]", "x compiled", "radius", "radius / found - 1"),
        *("solves", "failed or inaccurate"),
    )
    A, B = family(CARS[0]).A, family(CARS[0]).B
    for method in METHODS:
        turns = [clock(lambda: smallest(A, B, Disks(-SIGMA), method)) for _ in range(9)]  # noqa: B023
        seconds, found = median(t for t, _ in turns), turns[0][1]
        for label, solver, options in OTHERS:
            peer = run_peer(A, B, SIGMA, method, limit, solver, options)
            reached = "-" if peer.radius is None else f"{peer.radius:.6g}"
            row(
                *(method, label, f"{peer.seconds:.2f}"),
                *(times(peer.seconds if peer.radius else None, seconds), reached),
                *(off(peer, found.r), peer.solves, peer.doubtful),
            )


# --- a sweep -------------------------------------------------------------------------------------


def sweep(quick: bool, limit: float) -> None:
    """Print a sweep over centres, every row proved, against the peer on a sample of it."""
    plant = family(CARS[0])
    count, every = (12, 6) if quick else (60, 10)
    centres = [float(c) for c in np.linspace(-5, -100, count)]
    sample = centres[every // 2 :: every]
    polefence.limits(plant, centres[:1], METHODS)
    seconds: list[float] = []
    above: list[float] = []
    rows: list[polefence.Limit] = []
    peers: dict[tuple[float, str], Peer] = {}
    for method in METHODS:  # our sweep in full before each third of the peer's
        spent, rows = clock(lambda: polefence.limits(plant, centres, METHODS))
        seconds.append(spent)
        above.append(clock(lambda: polefence.limits(plant, centres, METHODS, bounds=False))[0])
        for c in sample:
            peers[c, method] = run_peer(plant.A, plant.B, -c, method, limit)
    ours, upper = median(seconds), median(above)
    done = [p for p in peers.values() if p.radius is not None]
    theirs = sum(p.seconds for p in peers.values()) * every
    bound = "" if len(done) == len(peers) else "at least "
    radius = {(r.centre, r.method): r.radius for r in rows}
    shares = [
        peer.radius / at - 1
        for key, peer in peers.items()
        if (at := radius[key]) is not None and peer.radius is not None
    ]
    heading(
        f"### Sweep (physical quarter car, {count} centres from -5 to -100, three methods)",
        *("", "radii proved", "both sides proved", "CVXPY + Clarabel, unproved"),
    )
    row("time [s]", f"{upper:.2f}", f"{ours:.2f}", f"{bound}{theirs:.1f}")
    sampled = f"every {every}th centre ({len(peers)} runs) x {every}"
    row("how", "`limits(..., bounds=False)`", "`limits`, median of 3", sampled)
    row("x", f"{bound}{theirs / upper:.3g}", f"{bound}{theirs / ours:.3g}", 1)
    solver = sum(p.in_solver for p in peers.values()) * every
    row("of which Clarabel itself [s]", "-", "-", f"{solver:.1f}")
    row("rows", len(rows), len(rows), f"{len(done)} of {len(peers)} finished")
    by_method(rows, peers)
    worst = max(shares, key=abs) if shares else float("nan")
    wrong = sum(abs(s) > WRONG for s in shares)
    say(
        f"\nThe peer's radius over ours - 1: worst {worst:+.1e}; {wrong} of {len(shares)} off by "
        f"more than {WRONG:g}; {sum(p.doubtful for p in peers.values())} of "
        f"{sum(p.solves for p in peers.values())} solves failed or inaccurate."
    )


def by_method(rows: Sequence[polefence.Limit], peers: dict[tuple[float, str], Peer]) -> None:
    """Print what was proved, and how tightly."""
    heading(
        "Rows by method (gap: 1 - lower / radius, over disks in the left half-plane)",
        *("method", "rows", "proved", "no lower bound", "radius >= sigma", "of these no lower"),
        *("median gap", "largest gap", "ours [ms/row]", "CVXPY [ms/row]"),
    )
    for method in METHODS:
        mine = [r for r in rows if r.method == method]
        proved = [r for r in mine if r.radius is not None]
        wide = [r for r in proved if r.radius is not None and r.radius >= -r.centre]
        gaps = [
            1 - r.lower / r.radius
            for r in proved
            if r.radius is not None and r.lower is not None and r.radius < -r.centre
        ]
        theirs = [p.seconds for (_, m), p in peers.items() if m == method]
        row(
            *(method, len(mine), len(proved), sum(r.lower is None for r in proved), len(wide)),
            sum(r.lower is None for r in wide),
            *(f"{median(gaps):.1e}", f"{max(gaps):.1e}") if gaps else ("-", "-"),
            *(ms(median(r.seconds for r in mine)), ms(median(theirs))),
        )


# --- growth --------------------------------------------------------------------------------------


def polytope(N: int, n: int, seed: int) -> tuple[Array, Array]:
    """Return vertices around a random pair, one input."""
    random = np.random.default_rng([N, n, seed])
    A0, B0 = random.standard_normal((n, n)), random.standard_normal((n, 1))
    A = A0 + 0.07 * random.standard_normal((N, n, n))
    return A, B0 + 0.07 * random.standard_normal((N, n, 1))


def growth(quick: bool, limit: float) -> None:
    """Print times by number of vertices and of states."""
    seeds = 2 if quick else SEEDS
    heading(
        f"### Growth (random polytopes, one input, sigma 5; medians over {seeds} seeds; NumPy "
        "and CVXPY once, on seed 0, given up after "
        f"{limit:g} s)",
        *("method", "N", "n", "iterations", "compiled [ms]", "[ms/iteration]"),
        *("seed 0: compiled [ms]", "NumPy [ms]", "CVXPY [ms]", "x compiled"),
        *("of which Clarabel [ms]", "x compiled", "CVXPY / found - 1"),
    )
    cases = list(dict.fromkeys(BY_VERTICES + BY_STATES))
    if quick:
        cases = [(2, 5), (4, 5), (8, 3)]
    for method in ("quadratic", "scheduled"):
        for N, n in cases:
            grow(method, N, n, seeds, limit)


def grow(method: str, N: int, n: int, seeds: int, limit: float) -> None:
    """Print the line of one size."""
    spent, iterations, failed = [], [], 0
    first: tuple[float, float] | None = None
    slow, peer = "-", Peer(note="-")
    for seed in range(seeds):
        A, B = polytope(N, n, seed)
        turns: list[float] = []
        try:
            for turn in range(3):
                seconds, found = clock(
                    lambda: smallest(A, B, Disks(-5.0), method, engine="compiled")  # noqa: B023
                )
                turns.append(seconds)
                if seed == turn == 0:
                    slow = timed_numpy(A, B, method, limit)
                    peer = run_peer(A, B, 5.0, method, limit)
        except PolefenceError:
            failed += 1
            continue
        spent.append(median(turns))
        iterations.append(found.iterations)
        if seed == 0:
            first = spent[0], found.r
    if not spent:
        row(method, N, n, f"{failed} failed", *["-"] * 9)
        return
    each = median(s / i for s, i in zip(spent, iterations, strict=True))
    their = peer.seconds if peer.radius is not None else None
    solver = peer.in_solver if peer.radius is not None else None
    row(
        *(method, N, n, f"{median(iterations):g}", ms(median(spent)), ms(each)),
        *(
            *(ms(first[0]), slow, ms(their), times(their, first[0])),
            *(ms(solver), times(solver, first[0]), off(peer, first[1])),
        )
        if first
        else ["-"] * 7,
    )


def timed_numpy(A: Array, B: Array, method: str, limit: float) -> str:
    """Time the NumPy engine once."""
    try:
        with limited(limit):
            seconds, _ = clock(lambda: smallest(A, B, Disks(-5.0), method, engine="numpy"))
    except TooSlowError:
        return f"> {1e3 * limit:g}"
    return ms(seconds)


# --- flops ---------------------------------------------------------------------------------------


def flops(stacked: Stacked) -> tuple[float, float]:
    """Count the flops of one H and of its Cholesky factor.

    H is summed over blocks and pairs of terms: four products of an entry of an (a c)-square matrix
    each, of a term with itself only the half.
    """
    products = 0
    for f in stacked.families:
        blocks = f.where.stop - f.where.start
        sizes = [t.D.shape[2] * t.R.shape[2] for t in f.terms]
        pairs = sum(p * q for p, q in combinations(sizes, 2)) + sum(p * p / 2 for p in sizes)
        products += blocks * 4 * pairs
    return 2 * products, stacked.unknowns**3 / 3


def kernel_runs(N: int, n: int, repeats: int) -> tuple[Stacked, list[float], int]:
    """Return the pencil of a scheduled problem, seconds per iteration of runs, and iterations."""
    A, B = polytope(N, n, 0)
    runs: list[tuple[Stacked, float, int]] = []
    inner = search.run

    def timed(stacked: Stacked, *args: Any) -> Any:
        seconds, outcome = clock(lambda: inner(stacked, *args))
        runs.append((stacked, seconds, outcome.iterations))
        return outcome

    with patch.object(search, "run", timed):
        for _ in range(repeats):
            smallest(A, B, Disks(-5.0), "scheduled", engine="compiled")
    most = max(stacked.unknowns for stacked, _, _ in runs)
    mine = [run for run in runs if run[0].unknowns == most and run[2] > 0]
    return mine[0][0], [seconds / count for _, seconds, count in mine], mine[0][2]


def matmul_rate(size: int, count: int, repeats: int) -> float:
    """Gflop/s of products of stacks of square matrices."""
    random = np.random.default_rng(0)
    shape = (count, size, size) if count > 1 else (size, size)
    X, Y, out = random.standard_normal(shape), random.standard_normal(shape), np.empty(shape)
    spent = [clock(lambda: np.matmul(X, Y, out=out))[0] for _ in range(repeats)]
    return 2e-9 * count * size**3 / median(spent)


def flop_count(quick: bool) -> None:
    """Print how near the machine's rate the kernel comes."""
    repeats = 3 if quick else 15
    heading(
        "### Flops (scheduled, compiled; the whole time of an iteration over the flops of H and "
        "its Cholesky factor alone, so a lower bound of the rate)",
        *("N", "n", "unknowns", "blocks", "iterations", "[ms/iteration]", "H [Mflop]"),
        *("Cholesky [Mflop]", "Gflop/s"),
    )
    for N, n in ((4, 5), (8, 10)):
        stacked, each, iterations = kernel_runs(N, n, repeats)
        assembly, cholesky = flops(stacked)
        seconds, blocks = median(each), sum(stacked.sizes.values())
        row(
            *(N, n, stacked.unknowns, blocks, iterations, ms(seconds), f"{assembly / 1e6:.3g}"),
            *(f"{cholesky / 1e6:.3g}", f"{1e-9 * (assembly + cholesky) / seconds:.3g}"),
        )
    heading("What `numpy.matmul` reaches here", "matrices", "Gflop/s")
    for size, count in ((10, 2000), (20, 2000), (256, 1)):
        row(f"{count} x {size} x {size}", f"{matmul_rate(size, count, 15 * repeats):.3g}")


def main() -> None:
    """Run the chosen sections."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    sections = ("one", "sweep", "growth", "flops")
    parser.add_argument("--section", choices=(*sections, "all"), default="all")
    parser.add_argument("--quick", action="store_true", help="fewer cases and runs: a minute")
    options = parser.parse_args()
    if not polefence.engine().startswith("compiled"):
        parser.exit(1, "polefence was installed without its compiled engine\n")
    warnings.filterwarnings("ignore", message="Solution may be inaccurate")
    limit = 5.0 if options.quick else 60.0
    header()
    run_peer(*polytope(2, 3, 0), 5.0, "quadratic", limit)  # CVXPY loads some of itself on first use
    for section, run in (("one", one_radius), ("sweep", sweep), ("growth", growth)):
        if options.section in (section, "all"):
            run(options.quick, limit)
    if options.section in ("flops", "growth", "all"):
        flop_count(options.quick)


if __name__ == "__main__":
    main()
