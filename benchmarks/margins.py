"""A disk margin proved for a whole family, beside python-control's at 1,000 plants of it.

python benchmarks/margins.py [--plants 1000]

Prints the margin that is proved for all values of the parameters, the least of so many plants in
floats on a grid of 400 frequencies, seconds of both and their ratio.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import control
import numpy as np

import polefence as pf
from polefence.certify.bounds import best_bound
from polefence.examples import spec_path, spec_text
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.requirements.text import load_specifications

CASES = ("quarter-car-ride", "van", "half-car")


def designed(name: str) -> Any:
    """Return the law of an example; of the van a gain of its two sensors."""
    plant = loads(spec_text(name))
    least, limits = load_specifications(spec_path(name))
    structure = pf.Structure(schedule=())
    if name == "van":
        measured = ("measured suspension deflection", "measured sprung-mass acceleration")
        structure = pf.Structure(measured=measured, schedule=())
    return pf.optimise(plant, least, limits, structure=structure)


def least_of(plant: Any, law: Any, loop: int, alphas: Any) -> float:
    """Return the least disk margin of these plants by python-control."""
    w, least = np.geomspace(0.01, 1e4, 400), np.inf
    for alpha in alphas:
        A, B = plant.at(alpha)
        K = np.atleast_2d(law.gain(alpha))
        b, k = B[:, loop : loop + 1], K[loop : loop + 1]
        opened = control.ss(A + B @ K - b @ k, b, -k, 0)
        least = min(least, float(control.disk_margins(opened, w)[0]))
    return least


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=1000)
    count = parser.parse_args().plants
    print(f"{'':18}{'proved':>10}{'s':>8}{f'least of {count}':>16}{'s':>8}{'ratio':>8}")
    for name in CASES:
        done = designed(name)
        plant, law = done.plant, done.law
        loop = plant.inputs[0].partition(" [")[0]
        start = time.perf_counter()
        bound = best_bound(plant, law, pf.DiskMargin(loop))
        middle = time.perf_counter()
        floats = least_of(plant, law, 0, seeded(plant, count))
        proof, grid = middle - start, time.perf_counter() - middle
        proved = "-" if bound is None else f"{bound.number:.5f}"
        print(f"{name:18}{proved:>10}{proof:8.2f}{floats:16.5f}{grid:8.2f}{grid / proof:8.1f}")


if __name__ == "__main__":
    main()
