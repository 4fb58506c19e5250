"""The published active suspension: gains that are proved, with and without its unmodelled actuator.

python benchmarks/published_suspension.py

Of comfort, balanced and handling each: one car, the same and its whole unmodelled actuator, and
with a body of 300 kg +-20 % too. Prints the gain that is proved, and what `hinfsyn` has of order 8.
Then the balanced gain with the worst of the unmodelled actuators, of a law that is tuned for it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import polefence as pf
from polefence.certify.bounds import best_bound
from polefence.examples import spec_text
from polefence.law.structure import load_structure
from polefence.plant.points import seeded
from polefence.requirements.text import load_specifications

NAME = "active-suspension-robust"
PUBLISHED = {"comfort": 0.9405, "balanced": 0.6727, "handling": 0.8892}
WEIGHTS = {"comfort": ("0.01", "0.99", 1), "balanced": ("0.5", "0.5", 1)}
WEIGHTS |= {"handling": ("0.99", "0.01", 3)}


def spec(goal: str, family: bool, unmodelled: bool) -> str:
    """Return the text of the spec of a goal."""
    travel, comfort, order = WEIGHTS[goal]
    text = spec_text(NAME).replace("0.5/(0.04", f"{travel}/(0.04")
    text = text.replace("0.5/(0.4*", f"{comfort}/(0.4*").replace("order = 1", f"order = {order}")
    if not family:
        text = text.replace("range = [240, 360]", "range = [299.9999, 300]")
    return text if unmodelled else text.rpartition("[[specification]]")[0]


def worst(beta: str = "1", time_invariant: str = "false") -> str:
    """Return the text of the spec of the balanced gain with the worst unmodelled actuator.

    For the weight over beta: the gain is at most beta where mu is.
    """
    text = spec("balanced", family=False, unmodelled=False).replace("order = 1", "order = 2")
    weight = f"(3*s + 18.5164019954)/({beta}*(s + 46.2910049886))"  # makeweight(0.4, 15, 3)
    dynamics = f'inputs = ["force demand"]\nweight = "{weight}"\n'
    dynamics += f"time_invariant = {time_invariant}\n"
    return text.replace('kind = "gain"\n', f'kind = "worst-case gain"\n{dynamics}')


def designed(text: str) -> tuple[Any, pf.Specification]:
    """Return the law that is found for a spec, with its bounds, and what is minimised."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "spec.toml")
        path.write_text(text)
        least, limits = load_specifications(path)
        done = pf.optimise(pf.load(path), least, limits, structure=load_structure(path))
        return done, least


def proved(text: str) -> float:
    """Return the gain that is proved of the law that is found."""
    return float(designed(text)[0].bounds[0].level)


def main() -> None:
    """Print a table."""
    print(f"{'':10}{'one car':>10}{'unmodelled':>12}{'and mass':>10}{'hinfsyn':>10}")
    for goal, known in PUBLISHED.items():
        levels = [
            proved(spec(goal, *kind)) for kind in ((False, False), (False, True), (True, True))
        ]
        print(f"{goal:10}{levels[0]:10.6f}{levels[1]:12.6f}{levels[2]:10.6f}{known:10.4f}")
    tuned, asked = designed(worst())
    invariant, of_invariant = designed(worst(time_invariant="true"))
    balanced = designed(spec("balanced", family=False, unmodelled=True))[0]
    print("balanced, with the worst unmodelled actuator: proved, and the worst that is found")
    for name, done, own in (
        ("stable with all", balanced, asked),
        ("tuned for it", tuned, asked),
        ("of invariant dynamics", invariant, of_invariant),
    ):
        bound = best_bound(done.plant, done.law, own)
        alpha = seeded(done.plant, 100)
        reached = own.values(done.plant, done.law, alpha).max()
        level = "none" if bound is None else f"{bound.level:.6g}"
        print(f"{name:24}{level:>12}{reached:12.6g}")
    print("balanced, for the weight over 0.92: proved; at most 0.92 where mu is")
    print(f"{'of invariant dynamics':24}{proved(worst('0.92', 'true')):>12.6g}")


if __name__ == "__main__":
    main()
