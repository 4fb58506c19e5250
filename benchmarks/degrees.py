"""Degree, elevation and domain: the smallest proved radius, and what it costs in time and memory.

python benchmarks/degrees.py --repeats 3

Quarter cars at centre -40, and two masses with four uncertain parameters (16 vertices) at -1.5.
Each row runs in a process of its own, so that its peak memory is its own; "search" is the median
time of `tightest` (search, rounding, proof), "check" that of the proof made afresh, "memory" the
process's peak. Prints Markdown.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import time
from multiprocessing import get_context

from polefence import Parameter, PolefenceError, Scheduled, UncertainPlant, check, engine, tightest
from polefence.examples import family
from polefence.lmi.conditions.methods import Method, build, method_label


def two_masses() -> UncertainPlant:
    """Return two masses joined by a spring and a damper, a force on the first.

    The benchmark of Wie & Bernstein (1992) with damping: positions [m] and velocities [m/s] of both
    masses; uncertain are the first mass, spring, damper, and how much of the force arrives.
    """
    parameters = (
        Parameter("m1", "0.8", "1.2", "kg", "1/m1"),
        Parameter("k", "0.5", "2", "N/m"),
        Parameter("c", "0.01", "0.1", "N s/m"),
        Parameter("e", "0.8", "1"),
    )
    A = [
        [0, 0, 1, 0],
        [0, 0, 0, 1],
        ["-k/m1", "k/m1", "-c/m1", "c/m1"],
        ["k/m2", "-k/m2", "c/m2", "-c/m2"],
    ]
    B = [[0], [0], ["e/m1"], [0]]
    return UncertainPlant.from_expressions(
        parameters, A, B, constants={"m2": 1}, name="two masses, four parameters"
    )


SIMPLEX = [Scheduled(g, d) for g, d in ((1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0))]
BOX = [Scheduled(g, d, "box") for g, d in ((1, 0), (1, 1), (2, 0), (2, 1), (3, 0))]
# plant: its centre and what is tried on it
CASES: dict[str, tuple[float, list[Method]]] = {
    "quarter-car-as-printed": (-40.0, ["quadratic", "slack", *SIMPLEX]),
    "quarter-car-physical": (-40.0, ["quadratic", "slack", *BOX]),
    "two-masses": (
        -1.5,
        ["quadratic", "slack", Scheduled(1, 0), Scheduled(1, 1), *BOX[:3]],
    ),
}


def plant_of(name: str) -> UncertainPlant:
    return two_masses() if name == "two-masses" else family(name)


def measured(name: str, centre: float, method: Method, repeats: int) -> list[str]:
    """Return one row of the table."""
    plant = plant_of(name)
    pencil = build(method, plant.A, plant.B, -centre)
    label = method_label(method)
    label = f"{label[:-1]}, simplex)" if label.endswith(")") and "box" not in label else label
    row = [plant.name, label, str(len(pencil.blocks)), str(pencil.unknowns)]
    searches, checks = [], []
    for _ in range(repeats):
        begin = time.perf_counter()
        try:
            design = tightest(plant, centre, method)
        except PolefenceError as error:
            return [*row, str(error), "", "", ""]
        searches.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        proved = check(design).proved
        checks.append(time.perf_counter() - begin)
    radius = f"{design.region.radius:.4f}" if proved else "not proved"
    seconds = [f"{statistics.median(times):.2f}" for times in (searches, checks)]
    # kibibytes, but bytes on macOS
    unit = 2**20 if sys.platform == "darwin" else 2**10
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    return [*row, radius, *seconds, f"{peak:.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--plant", action="append", choices=CASES)
    options = parser.parse_args()
    print(f"engine: {engine()}\n")
    head = ["plant", "method", "blocks", "unknowns", "radius", "search [s]", "check [s]"]
    print(f"| {' | '.join([*head, 'memory [MiB]'])} |")
    print("|---|---|--:|--:|--:|--:|--:|--:|")
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for name in options.plant or CASES:
            centre, methods = CASES[name]
            for method in methods:
                row = pool.apply(measured, (name, centre, method, options.repeats))
                print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
