"""How far above the worst case a bound is proved, by degree: dual polynomials beside those of LMIs.

python benchmarks/bounds.py --repeats 5

The one gain on three signals of docs/structures.md, on `quarter-car-ride`: the rms of the sprung
mass's acceleration. "Above" is the bound over the worst of 10,000 samples, less one; times are
medians of the search in floats and of the exact proof, which both forms need. Prints Markdown.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from polefence import FixedGain, engine, load, load_specifications
from polefence.certify.bounds import sampled
from polefence.examples import spec_path
from polefence.lmi.solve.duals import duals
from polefence.lmi.solve.loops import loop_with
from polefence.lmi.solve.lyapunov import least_given
from polefence.proof.claims.base import prove
from polefence.proof.laws import Evidence
from polefence.requirements.specification import claim_of

LAW = FixedGain([[187613, 0, -62489, -712.4]])
DEGREES = (1, 2, 3)
ABOVE = 1e-6  # the level at which evidence is proved, over that found in floats


def timed(action: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    """Return what an action does, and its median time [ms]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        found = action()
        times.append(1e3 * (time.perf_counter() - start))
    return found, statistics.median(times)


def main() -> None:
    """Print a row a degree and form."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    spec = spec_path("quarter-car-ride")
    plant, (own, _) = load(spec), load_specifications(spec)
    worst = sampled(plant, LAW, own).worst
    source, output = own.condition(plant, LAW.domain_of(plant), 1.0)
    loop = loop_with(plant, LAW, output.C, output.D)

    def dual(degree: int) -> tuple[float, Evidence]:
        found = list(duals(own.dual(plant, LAW), worst, 0.0, degree))[-1]
        return found.level, Evidence(_exact(found.Q), found.degree, dual=True)

    def lmi(degree: int) -> tuple[float, Evidence]:
        found = least_given(loop, source, output, degree, 0)
        return own.level(found.r), Evidence(_exact(found.Q), degree)

    print(f"engine {engine()}\n\n| form | degree | above | search [ms] | proof [ms] |")
    print("| --- | --- | --- | --- | --- |")
    for name, search in (("LMI", lmi), ("dual", dual)):
        for degree in DEGREES:
            (level, evidence), found = timed(lambda s=search, d=degree: s(d), repeats)
            at = Fraction(level * (1 + ABOVE))
            claim = claim_of(plant, LAW.exact, "box", own, evidence, at)
            verdict, proof = timed(lambda c=claim: prove(c), repeats)
            above = f"{100 * (level / worst - 1):.3g} %" if verdict.proved else "not proved"
            print(f"| {name} | {degree} | {above} | {found:.3g} | {proof:.3g} |")


def _exact(matrices: Any) -> list[Any]:
    return [[[Fraction(x) for x in row] for row in M.tolist()] for M in matrices]


if __name__ == "__main__":
    main()
