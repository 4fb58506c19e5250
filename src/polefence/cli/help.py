"""What `polefence --help` lists, in groups; and an example of each command."""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Mapping

NAMES = 14  # columns of the names of commands

# Every command once, in the order in which they are listed.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "begin": ("example", "identify", "studio"),
    "design a law": (
        "design", "tightest", "limits", "optimise", "tradeoff", "observe", "semi-active",
    ),
    "verify one": ("analyse", "verify", "robust", "service", "loops", "check"),
    "see how it rides": ("simulate", "compare", "concepts", "report"),
    "many variants": ("study",),
    "put it to use": ("export",),
    "and": ("paper", "completion"),
}  # fmt: skip

EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "identify": ("polefence identify measurements.toml -o family.toml --plot fit.png",),
    "limits": (
        "polefence limits car.toml --centre -40",
        "polefence limits car.toml --centres -60 -20 41 --json limits.json --plot limits.png",
    ),
    "design": (
        "polefence design car.toml --disk -40 31 -o car --plot poles.png",
        "polefence design car.toml --region 'half_plane(4) & sector(0.5)' --method quadratic",
    ),
    "tightest": ("polefence tightest car.toml --of disk --centre -40",),
    "observe": (
        "polefence example servo > servo.toml",
        "polefence observe servo.toml --measured 'motor angle' --disk -20 14 -o observer",
    ),
    "optimise": (
        "polefence example quarter-car-ride > ride.toml",
        "polefence optimise ride.toml -o ride",
        "polefence optimise ride.toml --limit 'rms of actuator force <= 500'",
        "polefence optimise active.toml --order 0..4 -o table",
    ),
    "tradeoff": (
        "polefence tradeoff ride.toml --over 'rms of actuator force' --values 300 1200 8",
    ),
    "semi-active": ("polefence semi-active semi-active.toml -o dampers",),
    "service": ("polefence service car -o margins",),
    "loops": (
        "polefence loops car",
        "polefence loops car --loop 'actuator force' --plot loop.png",
    ),
    "analyse": (
        "polefence analyse car.toml --gain gain.json --region 'half_plane(1)'",
        "polefence analyse car.toml --gain '[1e4 2e4 0 0 1e5]' --of disk --centre -40",
    ),
    "verify": (
        "polefence verify mine.mat --minus --region 'half_plane(1)'",
        "polefence verify car.toml --gain theirs.mat --limit 'gain of suspension deflection <= 1'",
    ),
    "robust": (
        "polefence robust car.toml --law car",
        "polefence robust car.toml --gain none --limit 'gain of suspension deflection <= 1'",
    ),
    "simulate": (
        "polefence simulate car --road C --speed 20 --plot drive.png",
        "polefence simulate car.toml --law passive --bump 0.05 2.5 --speed 10",
    ),
    "compare": ("polefence compare car.toml --law passive --law skyhook --law car",),
    "concepts": ("polefence concepts semi-active.toml",),
    "studio": ("polefence studio car.toml --region 'disk(-40, 31)'",),
    "study": (
        "polefence study study.toml --estimate",
        "polefence study study.toml -o results --resume",
        "polefence study results --best tightest",
    ),
    "report": ("polefence report car -o car.html",),
    "export": ("polefence export car -o code", "polefence export car --lang mat -o matlab"),
    "check": ("polefence check car --spec car.toml",),
    "paper": ("polefence paper -o paper-results",),
    "example": ("polefence example quarter-car-physical > car.toml",),
    "completion": ("polefence completion bash >> ~/.bashrc",),
}


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Help of at most 100 columns, whose examples stay lines."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=columns() - 2)


def columns() -> int:
    """Return the columns of help: those of the terminal, at most 100."""
    return min(shutil.get_terminal_size().columns, 100)


def listing(texts: Mapping[str, str]) -> str:
    """Return commands with what they do, {name: text}, in their groups."""
    lines = list[str]()
    for group, names in GROUPS.items():
        lines.append(f"{group}:")
        for name in filter(texts.__contains__, names):
            filled = textwrap.wrap(texts[name], max(columns() - NAMES - 4, 20))
            heads = [f"  {name:<{NAMES}}", *[" " * (NAMES + 2)] * (len(filled) - 1)]
            lines += [head + text for head, text in zip(heads, filled, strict=True)]
        lines.append("")
    return "\n".join(lines)


def examples(name: str) -> str:
    """Return the examples of a command, a line each."""
    return "\n".join(["examples:", *(f"  {line}" for line in EXAMPLES.get(name, ()))])
