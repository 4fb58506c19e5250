"""Random polytopes and quarter cars: is every radius proved, and does a second solver agree?

python benchmarks/agreement.py --plants 500 --clarabel 100

For each plant and method: the proved radius, the radius proved infeasible, and (for the first
``--clarabel`` plants of each kind) what Clarabel says 0.1 % above and below, in the coordinates of
the answer. Prints one line for each case that needs a look, and the totals.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
from families import polytope, quarter_car

from polefence import METHODS, PolefenceError, UncertainPlant
from polefence.lmi.conditions.methods import build
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import Reached, lyapunov_mean
from polefence.lmi.solve.smallest import FLOOR
from polefence.search.by_lmi import smallest_disk

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.margin import largest_margin

SIDE = 1e-3
CLEAR = 1e-7  # a margin that means something


def second_opinion(plant: UncertainPlant, centre: float, method: str, found: Reached) -> str:
    """Compare with Clarabel on both sides of the radius."""
    plain = balanced(plant.A, plant.B, -centre)
    scaling = plain.refined(lyapunov_mean(found.values))
    A, B = scaling.apply(plant.A, plant.B)
    pencil = build(method, A, B, -centre / scaling.rate)
    above, below = (
        largest_margin(pencil, found.r * side / scaling.rate) for side in (1 + SIDE, 1 - SIDE)
    )
    if above.t < -CLEAR and above.optimal:
        return "Clarabel: infeasible above"
    if below.t > CLEAR:
        return "Clarabel: feasible below"
    return "agree"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--clarabel", type=int, default=100)
    parser.add_argument("--method", action="append", choices=METHODS)
    options = parser.parse_args()
    for draw in (polytope, quarter_car):
        for method in options.method or METHODS:
            count, gaps, iterations, start = Counter(), [], [], time.perf_counter()
            for seed in range(options.first, options.first + options.plants):
                plant, centre = draw(seed)
                try:
                    design, found = smallest_disk(plant, centre, method)
                except PolefenceError as error:
                    count["undecided"] += 1
                    print(f"  {plant.name}: {type(error).__name__}: {error}"[:150], flush=True)
                    continue
                if not design.proved:
                    count["undecided"] += 1
                    print(f"  {plant.name}: found, not proved", flush=True)
                    continue
                count["proved"] += 1
                iterations.append(found.iterations)
                gap = 1 - design.lower / design.region.radius if design.lower else np.inf
                gaps.append(gap)
                if gap > 1e-5:
                    ratio = -design.region.radius / centre
                    print(
                        f"  {plant.name} {plant.A.shape}: radius {ratio:.3g} sigma, gap {gap:.1e}, "
                        f"{found.iterations} iterations, converged {found.converged}",
                        flush=True,
                    )
                # at its floor the search stops short of an infimum of zero
                sought = found.r > 2 * FLOOR * -centre
                if sought and seed - options.first < options.clarabel:
                    answer = second_opinion(plant, centre, method, found)
                    count[answer] += 1
                    if answer != "agree":
                        print(f"  {plant.name}: {answer}", flush=True)
            within = np.mean(np.array(gaps) <= 1e-5)
            print(
                f"{draw.__name__} {method}: {dict(count)}, gap <= 1e-5 in {within:.1%}, iterations "
                f"median {np.median(iterations):g}, 99 % {np.percentile(iterations, 99):g}, most "
                f"{max(iterations)}; {time.perf_counter() - start:.0f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
