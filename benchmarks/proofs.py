"""Times of proofs: the checker in Python's integers, and the compiled second prover, by size.

python benchmarks/proofs.py

Claims about a disk, of four vertices with random entries and two inputs, with evidence of full
doubles: one W and one gain (quadratic, 4 blocks), or one each a vertex (scheduled, 20 blocks). Both
provers decide the same claim, and one whose radius is too small besides, turn by turn in one
process. The lower bounds are those of random polytopes, by the kernel and by rationals. Prints
Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from statistics import median
from typing import Any

import numpy as np
from families import polytope
from scipy.linalg import solve_continuous_lyapunov

import polefence
from polefence import METHODS, Disk, UncertainPlant
from polefence.base.errors import PolefenceError
from polefence.certify import exact
from polefence.certify.certificate import Certificate
from polefence.certify.lower_bound import lower_radius
from polefence.certify.repair import lower_bound
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.smallest import smallest

SIZES, VERTICES, INPUTS, TURNS = (5, 8, 14, 24, 40), 4, 2, 5
SPREAD, CENTRE, RADIUS = 0.05, -2.0, 1.95
PLANTS = 20


def clock(task: Callable[[], Any]) -> tuple[float, Any]:
    """Return seconds and result."""
    start = time.perf_counter()
    result = task()
    return time.perf_counter() - start, result


def certificate(n: int, method: str) -> Certificate:
    """Loops near -2 under a small gain: a claim that holds, with evidence of full doubles."""
    random = np.random.default_rng(n)
    size = 0.3 / np.sqrt(n)
    middle = CENTRE * np.eye(n) + size * random.normal(size=(n, n))
    A = [middle + SPREAD * size * random.normal(size=(n, n)) for _ in range(VERTICES)]
    B = [random.normal(size=(n, INPUTS)) for _ in range(VERTICES)]
    plant = UncertainPlant.from_vertices(A, B)
    W = solve_continuous_lyapunov(middle, -np.eye(n))
    W = (W + W.T) / 2
    if method == "quadratic":
        law: Any = FixedGain(0.01 * size * random.normal(size=(INPUTS, n)))
        evidence: dict[str, Any] = {"W": W}
    else:
        each = [W * (1 + 0.01 * random.random()) for _ in range(VERTICES)]
        Z = 0.01 * size * random.normal(size=(VERTICES, INPUTS, n))
        law, evidence = ScheduledGain(np.array(each), Z, plant.parameters), {"tau": np.array(0.0)}
    return Certificate(plant, Disk(CENTRE, RADIUS), method, law, evidence)


def proofs() -> None:
    """Print times of both provers by size."""
    print("| n | method | blocks | checker [ms] | compiled [ms] | x | refuted: x |")
    print("|--:|---|--:|--:|--:|--:|--:|")
    for method in ("quadratic", "scheduled"):
        for n in SIZES:
            good = certificate(n, method)
            bad = replace(good, region=Disk(CENTRE, 0.01))
            times: dict[tuple[str, bool], list[float]] = {}
            for _ in range(TURNS):
                for wanted, own in ((True, good), (False, bad)):
                    fast, ours = clock(lambda: exact.holds(own))  # noqa: B023
                    slow, theirs = clock(lambda: own.prove().proved)  # noqa: B023
                    assert ours is theirs is wanted, (n, method, ours, theirs)
                    times.setdefault(("fast", wanted), []).append(fast)
                    times.setdefault(("slow", wanted), []).append(slow)
            t = {key: 1e3 * median(values) for key, values in times.items()}
            count = VERTICES if method == "quadratic" else 20
            cells = (n, method, count, f"{t['slow', True]:.3g}", f"{t['fast', True]:.3g}")
            ratios = (f"{t['slow', each] / t['fast', each]:.0f}" for each in (True, False))
            print("|", " | ".join(map(str, (*cells, *ratios))), "|")


def bounds() -> None:
    """Print how often a lower bound is proved by either, how near, and in what time."""
    print("\n| method | asked | compiled | rationals | rationals to 1e-6 | [ms] | [ms] |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for method in METHODS:
        ours, theirs, fast, slow = [], [], [], []
        for seed in range(PLANTS):
            plant, centre = polytope(seed)
            try:
                found = smallest(plant.A, plant.B, Disks(centre), method)
            except PolefenceError:
                continue
            if found.dual is None:
                continue
            Y, sigma = found.dual.matrices(), -centre
            seconds, r = clock(lambda: lower_radius(plant, method, sigma, found.r, Y))  # noqa: B023
            fast.append(1e3 * seconds)
            ours.append(r)
            A, B = ([[list(e) for e in M] for M in Ms] for Ms in exact_of(plant))
            seconds, claim = clock(
                lambda: lower_bound(method, A, B, Fraction(sigma), found.r, Y)  # noqa: B023
            )
            slow.append(1e3 * seconds)
            theirs.append(None if claim is None else float(claim.r) / found.r)
        near = sum(r is not None and r >= 1 - 1.1e-6 for r in theirs)
        some = [sum(r is not None for r in each) for each in (ours, theirs)]
        print(f"| {method} | {len(ours)} | {some[0]} | {some[1]} | {near} ", end="")
        print(f"| {median(fast):.2g} | {median(slow):.2g} |")


def exact_of(plant: UncertainPlant) -> tuple[Any, Any]:
    """Return the vertices' rationals."""
    return [v.exact_A for v in plant.vertices], [v.exact_B for v in plant.vertices]


if __name__ == "__main__":
    print(f"polefence {polefence.__version__}, engine {polefence.engine()}\n")
    proofs()
    bounds()
