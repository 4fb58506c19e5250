"""``polefence example``: the specs that ship with the package."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from polefence.cli.output import PROVED
from polefence.cli.terminal import say
from polefence.examples import SPECS, STUDIES, spec_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `example`."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="without it: list the names")


def example_command(options: Any) -> int:
    """Print a spec, or a study, that ships with polefence, to copy and edit."""
    if options.name is None:
        for name, text in (SPECS | STUDIES).items():
            say(f"{name:<24} {text}")
        say("copy one: polefence example quarter-car-physical > car.toml")
    else:
        sys.stdout.write(spec_text(options.name))
    return PROVED
