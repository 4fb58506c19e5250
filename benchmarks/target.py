"""Exported code on an emulated Cortex-M4F: executed instructions, bytes of code and of stack.

python benchmarks/target.py

Needs arm-none-eabi-gcc with newlib, and qemu-system-arm. Laws of the quarter car, Table 1 uncertain
by 20 %: five states, one input, four vertices; "polynomial" is affine in the parameters, of three
signals. An update is counted from its first instruction to
its return, for random inputs inside the set: by the emulator's clock of 1 ns an instruction, with
what the compiler's library executes for float64. Instructions are not cycles: "cycles at most" adds
up what is published of each instruction that was executed (`tests/support/cycles.py`). "stated" is
the sum of what the compiler says of all functions of the law's file, "used" what an update leaves
of a pattern on the stack, with the library's part. The largest error is over 100,000 random inputs,
relative to sum |K| |x|, of the code on the target; "law" is that against `gain` in doubles,
"corrected" against the gain corrected by its residual in longer numbers. Prints Markdown.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from polefence import Disk, Scheduled, place
from polefence.examples import family
from support.cortex import Export, export, missing_tools
from support.polynomials import design

LEVELS = ("-O2", "-O3")
# law, given, bits
CASES = (
    ("degree 1", "parameters", 32),
    ("degree 1", "parameters", 64),
    ("degree 1", "alpha", 32),
    ("degree 1", "alpha", 64),
    ("degree 2, box", "parameters", 32),
    ("degree 2, box", "alpha", 32),
    ("polynomial", "parameters", 32),
    ("fixed", "parameters", 32),
    ("fixed", "parameters", 64),
)


def cost(made: Export, level: str, inputs: int) -> list[str]:
    counts, used = made.counted(level, inputs)
    low, high = counts.min(), counts.max()
    span = f"{low:,}" if low == high else f"{low:,} to {high:,}"
    cycles = f"{made.cycles(level, inputs):,}" if made.program.number.bits == 32 else ""
    return [level, span, cycles, f"{made.size(level):,}", str(made.stack(level)), str(used)]


def errors(made: Export, count: int) -> list[str]:
    target = made.answers(made.target("many.c", f"-DCOUNT={count}U"), count, "target")
    host = made.answers(made.host("many.c", f"-DCOUNT={count}U"), count, "host")
    corrected, plain = made.errors(target)
    same = "yes" if host.tobytes() == target.tobytes() else "NO"
    return [f"{plain:.1e}", f"{corrected:.1e}", same]


def print_table(head: list[str], rows: list[list[str]], words: int) -> None:
    print(f"| {' | '.join(head)} |")
    print("|" + "---|" * words + "--:|" * (len(head) - words))
    for row in rows:
        print(f"| {' | '.join(row)} |")
    print(flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=20, help="counted for each law and level")
    parser.add_argument("--errors", type=int, default=100_000, help="compared with Python")
    options = parser.parse_args()
    if missing_tools():
        parser.error(f"not installed: {', '.join(missing_tools())}")
    plant = family("quarter-car-physical")
    designs = {
        "degree 1": place(plant, Disk(-40, 31), "scheduled"),
        "degree 2, box": place(plant, Disk(-40, 31), Scheduled(degree=2, on="box")),
        "polynomial": design("measured"),
        "fixed": place(plant, Disk(-40, 35), "quadratic"),
    }
    costs, accuracy = [], []
    with tempfile.TemporaryDirectory() as folder:
        for k, (kind, given, bits) in enumerate(CASES):
            made = export(designs[kind], bits, Path(folder) / str(k), given)
            label = [kind, given if kind != "fixed" else "nothing", f"float{bits}"]
            costs += [[*label, *cost(made, level, options.inputs)] for level in LEVELS]
            accuracy.append([*label, *errors(made, options.errors)])
    head = ["law", "given", "format"]
    numbers = [
        "instructions",
        "cycles at most",
        "code and constants [B]",
        "stack stated [B]",
        "stack used [B]",
    ]
    print_table([*head, "", *numbers], costs, 4)
    print_table([*head, "error, law", "error, corrected", "bits as on host"], accuracy, 3)


if __name__ == "__main__":
    main()
