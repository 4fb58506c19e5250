"""Two classic problems, by the order of the law: what is proved, and how long it takes.

python benchmarks/classics.py --orders 0 2 4

The two masses of Wie and Bernstein (`two-masses`: the largest decay rate, one position measured),
and the active suspension of MathWorks' example (`active-suspension`: the least gain of the
deflection, two sensors). Prints Markdown.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from polefence import (
    NotProvedError,
    load,
    load_region,
    load_specifications,
    load_structure,
    optimise,
    tightest,
)
from polefence.examples import spec_path


def masses(order: int) -> str:
    """Return the decay rate that is proved of the two masses."""
    spec = spec_path("two-masses")
    structure = replace(load_structure(spec), order=order)
    design = tightest(load(spec), of="half_plane", structure=structure)
    return f"decay rate {design.region.parts[0].decay:.4f} 1/s"


def suspension(order: int) -> str:
    """Return the gains that are proved of the suspension."""
    spec = spec_path("active-suspension")
    structure = replace(load_structure(spec), order=order)
    least, limits = load_specifications(spec)
    done = optimise(load(spec), least, limits, load_region(spec), structure=structure)
    return ", ".join(f"{own.specification.title} {own.level:.4f}" for own in done.bounds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    orders = parser.parse_args().orders
    print("| problem | order | proved | time [s] |")
    print("|---|---|---|---|")
    for name, answer in (("two masses", masses), ("active suspension", suspension)):
        for order in orders:
            start = time.perf_counter()
            try:
                said = answer(order)
            except NotProvedError as error:
                said = str(error).split(";")[0]
            print(f"| {name} | {order} | {said} | {time.perf_counter() - start:.0f} |", flush=True)


if __name__ == "__main__":
    main()
