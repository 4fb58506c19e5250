"""Every command on designs of every kind: another car, a winch and a converter.

python benchmarks/compose.py [--only TEXT] [--seconds 200]

Prints Markdown: a row a design, a column a command, with its time, or why there is no answer. The
plants are those of `tests/support/every_command.py`. The exit status is 1 where one is refused.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.every_command import PLANTS, Design


def answered(words: tuple[str, ...], seconds: float) -> tuple[str, str]:
    """Return the time that a command took, or "no", and the last line that it said."""
    command = [sys.executable, "-m", "polefence", *words]
    start = time.perf_counter()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        return "no", f"no answer in {seconds:g} s"
    took = f"{time.perf_counter() - start:.1f} s"
    said = (done.stderr or done.stdout).strip().splitlines()
    return ("no", said[-1] if said else "") if done.returncode else (took, "")


def row(design: Design, folder: Path, seconds: float) -> list[str]:
    """Print the row of a design; return why commands had no answer."""
    spec, refusals, cells = folder / "plant.toml", list[str](), list[str]()
    spec.write_text(design.spec)
    for words in design.commands(str(spec), str(folder / "design")):
        cell, why = answered(words, seconds)
        cells.append(f"{words[0]} {cell}")
        refusals += [f"{design.plant.name}, {design.name}, {words[0]}: {why}"] if why else []
        if why and words[0] == "optimise":
            break
    print(f"| {design.plant.name} | {design.name} | {', '.join(cells)} |", flush=True)
    return refusals


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--seconds", type=float, default=200.0)
    asked = parser.parse_args()
    refusals = list[str]()
    print("| plant | design | commands |\n|---|---|---|")
    for plant in PLANTS:
        for design in plant.designs():
            if asked.only in f"{plant.name}, {design.name}":
                with tempfile.TemporaryDirectory() as folder:
                    refusals += row(design, Path(folder), asked.seconds)
    print("\n" + "\n".join(refusals))
    return 1 if refusals else 0


if __name__ == "__main__":
    sys.exit(main())
