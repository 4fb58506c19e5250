"""Responses and pole sets of a family, against the loops that one would write with SciPy and NumPy.

python benchmarks/responses.py
python benchmarks/responses.py --points 50 --matrices 20000

The physical quarter car under a gain scheduled on load and age, disk (-40, 31), at random points of
its parameter box. The peer calls scipy.signal or numpy.linalg for one point after the other: the
same points, samples, signals and disturbance, results kept in an array. Both start from plant, law
and points, and close the loops themselves, except in the rows that say otherwise. Every point is
run, nothing is scaled up. The two take turns: the peer's points are cut into as many parts as ours
has runs; its time is the sum over its parts, ours the median of its runs, with the slowest beside
it. BLAS has one thread. Memory is the peak of a process of its own, less what it has after its
imports. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import platform
import resource
import statistics
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing import get_context
from typing import Any

import numpy as np
import scipy.linalg
import scipy.signal

from polefence import Disk, place
from polefence.examples import family
from polefence.response.closed import close
from polefence.response.linear import frequency, simulate, step
from polefence.response.stationary import stationary, velocity_psd
from polefence.vehicle.vehicle import ride

RATE = 1000.0  # Hz
SECONDS = 60.0
RUNS = 5
PSD = velocity_psd(256e-6, 20)  # class C at 20 m/s

PLANT = family("quarter-car-physical")
SIGNALS = ride(PLANT).signals
E = PLANT.vertices[0].E
KT = 155_900.0


@dataclass(frozen=True)
class Case:
    """What is run: for our batch and for a part of the peer's points."""

    label: str
    ours: Callable[[], Any]
    peer: Callable[[slice], Any]
    count: int


def box(count: int) -> np.ndarray:
    """Return random points of the parameter box, as alpha."""
    a, b = np.random.default_rng(1).random((2, count))
    return np.stack([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b], axis=1)


def closed_by_hand(law: Any, alpha: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return one closed loop with the ride's six signals, as scipy.signal takes it."""
    A, B = PLANT.at(alpha)
    K = law.gain(alpha)
    closed = A + B @ K
    C = np.zeros((6, 5))
    C[0, 0] = C[1, 1] = 1.0
    C[2], C[3], C[4] = closed[2], closed[3], K[0]
    C[5, 1] = KT
    return closed, E, C, np.zeros((6, 1))


def lsim_loop(law: Any, points: np.ndarray, w: np.ndarray) -> np.ndarray:
    t = np.arange(len(w)) / RATE
    found = np.empty((len(points), len(w), 6))
    for k, alpha in enumerate(points):
        found[k] = scipy.signal.lsim(closed_by_hand(law, alpha), w, t)[1]
    return found


def step_loop(law: Any, points: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.stack([scipy.signal.step(closed_by_hand(law, a), T=t)[1] for a in points])


def frequency_loop(law: Any, points: np.ndarray, f: np.ndarray) -> np.ndarray:
    found = np.empty((len(points), len(f), 6), dtype=complex)
    for k, alpha in enumerate(points):
        A, e, C, _ = closed_by_hand(law, alpha)
        for i, s in enumerate(2j * np.pi * f):
            found[k, i] = (C @ np.linalg.solve(s * np.eye(5) - A, e))[:, 0]
    return found


def stationary_loop(law: Any, points: np.ndarray) -> np.ndarray:
    found = np.empty((len(points), 6))
    for k, alpha in enumerate(points):
        A, e, C, _ = closed_by_hand(law, alpha)
        X = scipy.linalg.solve_continuous_lyapunov(A, -e @ e.T * PSD / 2)
        found[k] = np.sqrt(np.diag(C @ X @ C.T))
    return found


def pole_loop(law: Any, points: np.ndarray) -> np.ndarray:
    found = np.empty((len(points), 5), dtype=complex)
    for k, alpha in enumerate(points):
        A, B = PLANT.at(alpha)
        found[k] = np.linalg.eigvals(A + B @ law.gain(alpha))
    return found


def eigvals_loop(matrices: np.ndarray) -> np.ndarray:
    return np.array([np.linalg.eigvals(M) for M in matrices])


def two_threads(matrices: np.ndarray) -> np.ndarray:
    with ThreadPoolExecutor(2) as pool:
        return np.concatenate(list(pool.map(np.linalg.eigvals, np.array_split(matrices, 8))))


def road(count: int) -> np.ndarray:
    return np.random.default_rng(2).normal(scale=np.sqrt(PSD * RATE / 2), size=count)


def cases(law: Any, points: int, matrices: int) -> list[Case]:
    """Return what is timed."""
    alpha, cloud = box(points), box(matrices)
    w = road(round(SECONDS * RATE))
    t, f = np.arange(1001) / RATE, np.geomspace(0.1, 50, 400)
    M = close(PLANT, law, cloud).closed
    sets = f"{matrices:,} pole sets"
    return [
        Case(
            f"{points} x {SECONDS:g} s at {RATE / 1000:g} kHz, scipy.signal.lsim",
            lambda: simulate(PLANT, law, alpha, w, np.arange(len(w)) / RATE, SIGNALS).values,
            lambda part: lsim_loop(law, alpha[part], w),
            points,
        ),
        Case(
            f"{points} x 1 s step at {RATE / 1000:g} kHz, scipy.signal.step",
            lambda: step(PLANT, law, alpha, SIGNALS, None, 1.0, 1 / RATE).values,
            lambda part: step_loop(law, alpha[part], t),
            points,
        ),
        Case(
            f"{points} x 400 frequencies, numpy.linalg.solve",
            lambda: frequency(PLANT, law, alpha, f, SIGNALS).gain[..., 0],
            lambda part: frequency_loop(law, alpha[part], f),
            points,
        ),
        Case(
            f"{points} stationary rms, scipy.linalg.solve_continuous_lyapunov",
            lambda: stationary(PLANT, law, alpha, PSD, SIGNALS).rms,
            lambda part: stationary_loop(law, alpha[part]),
            points,
        ),
        Case(
            f"{sets} from alpha, numpy.linalg.eigvals",
            lambda: close(PLANT, law, cloud).poles(),
            lambda part: pole_loop(law, cloud[part]),
            matrices,
        ),
        Case(
            f"{sets} of closed loops given, numpy.linalg.eigvals",
            lambda: np.linalg.eigvals(M),
            lambda part: eigvals_loop(M[part]),
            matrices,
        ),
        Case(
            "the same, ours on two threads",
            lambda: two_threads(M),
            lambda part: eigvals_loop(M[part]),
            matrices,
        ),
    ]


def off(own: np.ndarray, part: slice, theirs: np.ndarray) -> float:
    """Return the largest difference as a share of each point's and signal's largest value."""
    own = own[part]
    if theirs.ndim == 2 and np.iscomplexobj(theirs):  # poles have no order
        own, theirs = (
            np.take_along_axis(x, np.lexsort((x.imag.round(5), x.real.round(5))), axis=-1)
            for x in (own, theirs)
        )
    axis = 1 if theirs.ndim == 3 else ()
    size = np.abs(theirs).max(axis=axis)
    return float((np.abs(own - theirs).max(axis=axis) / size).max())


def timed(case: Case) -> list[str]:
    """Return one row of the table."""
    ours, peer, worst = [], 0.0, 0.0
    edges = np.linspace(0, case.count, RUNS + 1).astype(int)
    for first, last in pairwise(edges):
        begin = time.perf_counter()
        own = case.ours()
        ours.append(time.perf_counter() - begin)
        part = slice(int(first), int(last))
        begin = time.perf_counter()
        theirs = case.peer(part)
        peer += time.perf_counter() - begin
        worst = max(worst, off(own, part, theirs))
        del own, theirs
    middle, slow = statistics.median(ours), max(ours)
    numbers = [f"{peer:.2f}", f"{middle:.3f}", f"{slow:.3f}"]
    return [case.label, *numbers, f"{peer / middle:.3g}", f"{peer / slow:.3g}", f"{worst:.0e}"]


def peak(K: Any, points: int, matrices: int, what: str) -> list[str]:
    """Return one row of the table of memory; runs in a process of its own."""
    alpha = box(matrices if what.startswith("poles") else points)
    w = road(round(SECONDS * RATE))
    before = _resident()
    own = {
        "simulate": lambda: simulate(PLANT, K, alpha, w, np.arange(len(w)) / RATE, SIGNALS).values,
        "lsim loop": lambda: lsim_loop(K, alpha[:10], w),
        "poles": lambda: close(PLANT, K, alpha).poles(),
        "poles loop": lambda: pole_loop(K, alpha),
    }[what]()
    label = f"{what}, 10 points" if what == "lsim loop" else what
    return [label, f"{own.nbytes / 1e6:.0f}", f"{(_resident() - before) / 1e6:.0f}"]


def _resident() -> float:
    # kibibytes, but bytes on macOS
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def table(head: list[str], rows: Any) -> None:
    print(f"| {' | '.join(head)} |")
    print(f"|---|{'--:|' * (len(head) - 1)}")
    for row in rows:
        print(f"| {' | '.join(row)} |", flush=True)
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--matrices", type=int, default=100_000)
    options = parser.parse_args()
    if min(options.points, options.matrices) < RUNS:
        parser.error(f"--points and --matrices must be at least {RUNS}")
    law = place(PLANT, Disk(-40, 31), "scheduled").law
    versions = (
        f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"
    )
    print(f"{os.cpu_count()} CPUs, BLAS on one thread; {versions}; medians of {RUNS} runs.\n")
    # Before the rest: a process starts with the peak of the one that started it.
    jobs = [(law, options.points, options.matrices, what) for what in PEAKS]
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        table(["what", "result [MB]", "peak [MB]"], (pool.apply(peak, job) for job in jobs))
    head = [
        "what, and the peer's function",
        "peer [s]",
        "ours [s]",
        "slowest [s]",
        "x",
        "x slowest",
    ]
    table(
        [*head, "differ by"],
        (timed(case) for case in cases(law, options.points, options.matrices)),
    )


PEAKS = ("simulate", "lsim loop", "poles", "poles loop")

if __name__ == "__main__":
    main()
