"""``polefence completion``: what a shell needs to complete commands, options and files."""

from __future__ import annotations

import argparse
import os
from typing import Any

from polefence.cli.output import PROVED

SHELLS = ("bash", "zsh", "fish")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `completion`."""
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help=", ".join(SHELLS))


def completion_command(options: Any) -> int:
    """Print what makes bash, zsh or fish complete polefence's words."""
    from argcomplete.shell_integration import shellcode  # deferred: nothing else needs it

    print(shellcode(["polefence"], shell=options.shell))  # noqa: T201  as it is, for a shell
    return PROVED


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks what may follow, and end; do nothing otherwise."""
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what may follow
        import argcomplete  # deferred: nothing else needs it

        argcomplete.autocomplete(parser, always_complete_options=False)
