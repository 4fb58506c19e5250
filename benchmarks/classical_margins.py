"""Gain, phase and delay margins of loops, proved for the whole family beside the worst sample.

python benchmarks/classical_margins.py

The table of docs/loops.md.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polefence as pf
from polefence.certify.bounds import best_bound
from polefence.examples import spec_text
from polefence.law.laws import given_law
from polefence.law.structure import load_structure
from polefence.plant.points import seeded
from polefence.requirements.text import load_specifications
from polefence.response.samples import at_sample_time

KINDS = (pf.GainMargin, pf.PhaseMargin, pf.DelayMargin)


def designed(text: str, *limits: Any) -> tuple[Any, Any]:
    """Return the plant and the law of a spec, within some limits besides."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "spec.toml")
        path.write_text(text)
        least, known = load_specifications(path)
        structure = load_structure(path)
        done = pf.optimise(pf.load(path), least, [*known, *limits], structure=structure)
        return done.plant, done.law


def loops() -> Iterator[tuple[str, Any, Any, str]]:
    """Yield loops: a name, a plant, a law and where the loop is opened."""
    one = pf.UncertainPlant.from_vertices([[[0, 1, 0], [0, 0, 1], [0, -2, -3]]], [[[0], [0], [1]]])
    yield "1/(s (s + 1) (s + 2))", one, given_law(one, [[-1.0, 0, 0]]), "u1"
    plant, law = designed(spec_text("active-suspension-robust"))
    yield "published suspension", plant, law, "force demand"
    asked = pf.GainMargin.least("actuator force", 2.0), pf.PhaseMargin.least("actuator force", 40.0)
    plant, law = designed(spec_text("quarter-car-ride"), *asked)
    yield "quarter car", plant, law, "actuator force"
    yield "quarter car, 5 ms", at_sample_time(plant, "0.005"), law, "actuator force"
    plant, law = designed(spec_text("van"), pf.GainMargin.least("actuator force", 1.5))
    yield "van", plant, law, "actuator force"


def main() -> None:
    """Print a table."""
    print(f"{'':22}" + "".join(f"{kind.kind!s:>15}{'sampled':>12}" for kind in KINDS))
    for name, plant, law, loop in loops():
        print(f"{name:22}", end="", flush=True)
        for kind in KINDS:
            asked = kind.least(loop)
            bound = best_bound(plant, law, asked)
            worst = asked.values(plant, law, seeded(plant, len(plant.vertices) + 2000)).max()
            proved = "none" if bound is None else asked.proved_text(bound.level)
            print(f"{proved:>15}{asked.sampled_text(float(worst)):>12}", end="", flush=True)
        print()


if __name__ == "__main__":
    main()
