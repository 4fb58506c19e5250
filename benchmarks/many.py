"""Many plants in one call of `polefence.many`, against a loop of single calls.

python benchmarks/many.py
python benchmarks/many.py --plants 200 --section disks

Quarter cars are drawn wide (`benchmarks/families.py`), each with a centre of its own. Loop and call
take turns, a part of the plants at a time, each with plants that nobody has looked at before; what
they answer is compared. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import platform
import time
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
from families import quarter_car

import polefence as pf
from polefence import METHODS, Design, PolefenceError, UncertainPlant

TURN = 125  # plants a turn
REGION = pf.HalfPlane(1.0) & pf.Sector(0.2)
GAIN = pf.Structure(schedule=())

Answers = list[Any]


def in_a_loop(call: Callable[[Any], Any], tasks: list[Any]) -> Answers:
    """Return the answers one by one, errors among them."""
    answers = []
    for task in tasks:
        try:
            answers.append(call(task))
        except PolefenceError as error:
            answers.append(error)
    return answers


def compared(
    what: str,
    count: int,
    drawn: Callable[[int], Any],
    single: Callable[[Any], Any],
    together: Callable[[list[Any]], Answers],
) -> np.ndarray:
    """Print a row: times for each, their ratio, and how far answers are apart; return the times."""
    seconds, answers = np.zeros(2), (list[Any](), list[Any]())
    ways = (lambda tasks: in_a_loop(single, tasks), together)
    for first in range(0, count, TURN):
        for k, way in enumerate(ways):
            tasks = [drawn(seed) for seed in range(first, min(first + TURN, count))]
            begin = time.perf_counter()
            answers[k].extend(way(tasks))
            seconds[k] += time.perf_counter() - begin
    proved = [sum(getattr(own, "proved", False) for own in each) for each in answers]
    worst = max(map(apart, *answers), default=0.0)
    print(cells(what, count, seconds), f" {proved[0]} | {proved[1]} | {worst:.1e} |", flush=True)
    return seconds


def cells(what: str, count: int, seconds: np.ndarray) -> str:
    """Return what was done, times for each plant, and their ratio."""
    each = " | ".join(f"{1e3 * own / count:.3g}" for own in seconds)
    return f"| {what} | {count} | {each} | {seconds[0] / seconds[1]:.2f} |"


def apart(one: Any, other: Any) -> float:
    """Return how far two answers' radii and lower bounds are apart, relative to them."""
    if type(one) is not type(other):
        return float("inf")
    if not isinstance(one, Design) or not isinstance(one.region, pf.Disk):
        return 0.0
    pairs = (one.region.radius, other.region.radius), (one.lower or 0.0, other.lower or 0.0)
    return max(abs(a - b) / max(abs(a), abs(b), 1e-300) for a, b in pairs)


def disks(count: int) -> None:
    """Print smallest disks, proved from both sides, in threads of this process."""
    total = np.zeros(2)
    for method in METHODS:

        def single(task: Any, method: Any = method) -> Design:
            return pf.tightest(*task, method)

        def together(tasks: list[Any], method: Any = method) -> Answers:
            return pf.many.tightest(*zip(*tasks, strict=True), method)

        total += compared(f"smallest disk, {method}", count, quarter_car, single, together)
    print(cells("the three", count, total), " | | |")


def others(count: int, executor: Executor | None) -> None:
    """Print regions, laws that are tuned and proofs, in worker processes."""

    def plant(seed: int) -> UncertainPlant:
        return quarter_car(seed)[0]

    def place(own: UncertainPlant) -> Design:
        return pf.place(own, REGION)

    def tune(own: UncertainPlant) -> Design:
        return pf.place(own, REGION, structure=GAIN)

    def placed(plants: list[Any]) -> Answers:
        return pf.many.place(plants, REGION, executor=executor)

    def tuned(plants: list[Any]) -> Answers:
        return pf.many.place(plants, REGION, structure=GAIN, executor=executor)

    def checked(designs: list[Any]) -> Answers:
        return pf.many.check(designs, executor=executor)

    compared("region, scheduled", count, plant, place, placed)
    compared("region, one gain tuned", count // 4, plant, tune, tuned)
    found = pf.many.tightest(*zip(*map(quarter_car, range(count)), strict=True), "scheduled")
    proved = [own for own in found if isinstance(own, Design)]
    compared("proof by the checker", len(proved), proved.__getitem__, pf.check, checked)


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=1000)
    parser.add_argument("--section", choices=["all", "disks", "others"], default="all")
    options = parser.parse_args()
    print(
        f"One run of it, {os.cpu_count()} CPUs; Python {platform.python_version()}, "
        f"numpy {np.__version__}; polefence {pf.__version__}, engine {pf.engine()}.\n"
    )
    print("| what | plants | loop [ms] | together [ms] | x | proved, loop | together | apart |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for method in METHODS:  # what the first plant of a shape costs is no part of it
        pf.many.tightest([quarter_car(0)[0]], -40, method)
    if options.section != "others":
        disks(options.plants)
    if options.section != "disks":
        with pf.processes() as executor:
            others(options.plants // 5, executor)


if __name__ == "__main__":
    main()
