"""How time and memory grow with states, vertices and masses in a chain; a full car.

python benchmarks/scale.py
python benchmarks/scale.py --section chains

Random plants: A and B affine in parameters that change each entry by up to a tenth of its spread;
centre -5. Chains of 2 to 10 masses are pushed weakly at both ends (`families.masses`), at centres
-10 and -40. The full car has 14 states (heave, pitch, roll and four wheels), four forces, and
uncertain are its body's mass and the springs in front and behind: eight vertices. "ride" asks for
its least rms of heave acceleration on a class C road at 20 m/s, with the region of "car" and each
tyre within 4.7 mm, each force within 500 N.

Each row runs in a process of its own, once, BLAS on one thread, searches of 600 unknowns and more
on all processors: "search" is the time of the search for the smallest disk, "answer" that of
`tightest` or `place` as a whole, with the lower bound and the proof by the second prover where it
has one, "check" that of the checker alone; "memory" is the process's peak. "Of each other" is the
exponent of growth of the answer's time between two rows of a method that follow each other.
Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import math
import resource
import sys
import time
from multiprocessing import get_context

import numpy as np
from families import masses

from polefence import (
    HalfPlane,
    Parameter,
    PolefenceError,
    Scheduled,
    Sector,
    UncertainPlant,
    check,
    engine,
    place,
    tightest,
)
from polefence.base.processors import processors
from polefence.lmi.conditions.methods import Method, method_label
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.smallest import smallest
from polefence.region.regions import Region
from polefence.requirements.rms import Rms
from polefence.response.stationary import velocity_psd
from polefence.search.optimise import optimise

BOX = Scheduled(1, 0, "box")
STATES = (4, 8, 12, 16, 20, 28, 40)
PARAMETERS = (1, 2, 3, 4, 5, 6)
METHODS: tuple[Method, ...] = ("quadratic", "slack", "scheduled", BOX)
CORNERS = ("front left", "front right", "rear left", "rear right")
CAR = HalfPlane(1) & Sector("0.1")


def random_plant(states: int, inputs: int, count: int) -> UncertainPlant:
    """Return a plant of so many states, inputs and parameters."""
    random = np.random.default_rng([7, states, count])
    parameters = tuple(Parameter(f"p{k + 1}", "-1", "1") for k in range(count))

    def affine(rows: int, columns: int, size: float) -> list[list[str]]:
        middle = size * random.standard_normal((rows, columns))
        parts = 0.1 * size / count * random.standard_normal((count, rows, columns))
        return [
            [
                " + ".join([f"{middle[i, j]:.6f}"]
                           + [f"({parts[k, i, j]:.6f})*p{k + 1}" for k in range(count)])
                for j in range(columns)
            ]
            for i in range(rows)
        ]  # fmt: skip

    A, B = affine(states, states, states**-0.5), affine(states, inputs, 1.0)
    return UncertainPlant.from_expressions(parameters, A, B, name=f"{states} states")


def full_car() -> UncertainPlant:
    """Return a car of seven degrees of freedom: heave, pitch, roll, four wheels; SI units.

    Heights are those over the plane that the road has under the car; its heave, pitch and roll are
    as large as those of four tracks that have nothing to do with each other.
    """
    m = Parameter("m", "1200", "1600", "kg", "1/m")
    springs = Parameter("kf", "16000", "24000", "N/m"), Parameter("kr", "14400", "21600", "N/m")
    constants = {"Iy": 2200, "Ix": 500, "mu": 40, "kt": 190000, "cf": 1500, "cr": 1400}
    lever = [("1.2", "0.75"), ("1.2", "-0.75"), ("-1.5", "0.75"), ("-1.5", "-0.75")]
    corners = [[1, f"-({x})", f"{y}"] for x, y in lever]  # height of a corner over z, pitch, roll
    inertia = ["m", "Iy", "Ix"]
    A = [["0"] * 14 for _ in range(14)]
    B = [["0"] * 4 for _ in range(14)]
    for i in range(7):
        A[i][7 + i] = "1"
    for w, corner in enumerate(corners):
        k, c = ("kf", "cf") if w < 2 else ("kr", "cr")
        wheel = 10 + w
        for i, arm in enumerate(corner):
            row = 7 + i
            for j, other in enumerate(corner):
                for column, rate in ((j, k), (7 + j, c)):
                    A[row][column] += f" - ({arm})*({other})*{rate}/{inertia[i]}"
            for column, rate in ((3 + w, k), (wheel, c)):
                A[row][column] += f" + ({arm})*{rate}/{inertia[i]}"
            B[row][w] = f"({arm})/{inertia[i]}"
        for j, other in enumerate(corner):
            for column, rate in ((j, k), (7 + j, c)):
                A[wheel][column] += f" + ({other})*{rate}/mu"
        A[wheel][3 + w] += f" - ({k} + kt)/mu"
        A[wheel][wheel] += f" - {c}/mu"
        B[wheel][w] = "-1/mu"
    roads = [["-0.5", "0", "0"], ["0", "-0.37", "0"], ["0", "0", "-0.67"]]
    wheels = [[f"-0.5*({a})", f"-0.37*({b})", f"-0.67*({c})"] for a, b, c in corners]
    return UncertainPlant.from_expressions(
        (m, *springs),
        A,
        B,
        [*roads, *wheels, *[["0"] * 3] * 7],
        constants,
        outputs={"heave acceleration [m/s2]": {"C": A[7], "D": B[7]}},
        name="full car",
        states=[*_named("", "m", "rad"), *_named(" rate", "m/s", "rad/s")],
        inputs=[f"{corner} force [N]" for corner in CORNERS],
        disturbances=[f"road {way} [m/s]" for way in ("heave", "pitch", "roll")],
    )


def _named(what: str, height: str, angle: str) -> list[str]:
    """Return names of the heights, or of their rates."""
    body = [f"heave{what} [{height}]", f"pitch{what} [{angle}]", f"roll{what} [{angle}]"]
    return [*body, *(f"{corner} tyre{what} [{height}]" for corner in CORNERS)]


def plant_of(key: tuple[str, int, int]) -> UncertainPlant:
    kind, states, count = key
    if kind == "masses":
        return masses(count)
    return full_car() if kind == "car" else random_plant(states, 2, count)


def measured(key: tuple[str, int, int], goal: float | Region, method: Method) -> list[str]:
    """Return the cells of a row, the seconds of the answer first."""
    plant = plant_of(key)
    N, n, m = plant.B.shape
    row = [plant.name, method_label(method), str(n), str(m), str(N)]
    begin = time.perf_counter()
    found, searched = None, math.nan
    try:
        if isinstance(goal, float):
            found = smallest(plant.A, plant.B, Disks(goal), method)
            searched = time.perf_counter() - begin
            begin = time.perf_counter()
            design = tightest(plant, goal, method)
        else:
            design = place(plant, goal, method)
    except PolefenceError as error:
        return ["nan", *row, str(error)[:60], "", "", "", "", ""]
    answered = time.perf_counter() - begin
    begin = time.perf_counter()
    proved = check(design).proved
    checked = time.perf_counter() - begin
    reached = f"{design.region.radius:.5f}" if isinstance(goal, float) else str(goal)
    cells = [reached if proved else "NOT PROVED", str(found.iterations) if found else ""]
    seconds = [f"{value:.2f}" for value in (searched, answered, checked)]
    return [str(answered), *row, *cells, *seconds, f"{peak():.0f}"]


def peak() -> float:
    """Return the most memory that this process has had [MiB]."""
    # kibibytes, but bytes on macOS
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def ridden(method: Method) -> list[str]:
    """Return the cells of a row of the full car's ride."""
    density = velocity_psd(256e-6, 20.0)
    limits = [Rms(f"{corner} tyre", 4.7e-3, density) for corner in CORNERS]
    limits += [Rms(f"{corner} force", 500.0, density) for corner in CORNERS]
    plant, comfort = full_car(), Rms("heave acceleration", None, density)
    begin, work = time.perf_counter(), time.process_time()
    found = optimise(plant, comfort, limits, CAR, method)
    seconds = time.perf_counter() - begin, time.process_time() - work
    level = f"{found.bounds[0].level:.5f}", f"{found.shared:.5f}"
    return [method_label(method), *level, *(f"{s:.1f}" for s in seconds), f"{peak():.0f}"]


SECTIONS: dict[str, list[tuple[tuple[str, int, int], float | Region, Method]]] = {
    "chains": [
        (("masses", 0, count), centre, method)
        for centre in (-10.0, -40.0)
        for method in ("quadratic", "scheduled")
        for count in range(2, 11)
    ],
    "states": [(("random", n, 2), -5.0, method) for method in METHODS for n in STATES],
    "vertices": [(("random", 12, k), -5.0, method) for method in METHODS for k in PARAMETERS],
    "car": [
        (("car", 14, 3), goal, method) for goal in (CAR, -20.0) for method in ("scheduled", BOX)
    ],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--section", action="append", choices=[*SECTIONS, "ride"])
    options = parser.parse_args()
    print(f"engine: {engine()}, {processors()} processors")
    head = ["plant", "method", "n", "m", "N", "proved", "iterations", "search [s]", "answer [s]"]
    head += ["check [s]", "memory [MiB]", "of each other"]
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for section in options.section or [*SECTIONS, "ride"]:
            if section == "ride":
                ride = ["law", "proved [m/s2]", "one W(alpha) [m/s2]", "time [s]"]
                ride += ["processor time [s]", "memory [MiB]"]
                print(f"\n### ride\n\n| {' | '.join(ride)} |\n|{'---|' * len(ride)}", flush=True)
                for method in ("quadratic", BOX):
                    print(f"| {' | '.join(pool.apply(ridden, (method,)))} |", flush=True)
                continue
            print(f"\n### {section}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}", flush=True)
            last: tuple[str, float, float] | None = None
            for key, goal, method in SECTIONS[section]:
                seconds, *row = pool.apply(measured, (key, goal, method))
                size = float(row[4] if section == "vertices" else row[2])
                growth = ""
                if last and last[0] == f"{method}{goal}" and size > last[1]:
                    growth = f"{math.log(float(seconds) / last[2]) / math.log(size / last[1]):.1f}"
                last = f"{method}{goal}", size, float(seconds)
                print(f"| {' | '.join([*row, growth])} |", flush=True)


if __name__ == "__main__":
    main()
