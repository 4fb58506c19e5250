"""The command line: parse, call, print. Exit 0 proved or done, 1 not proved, 2 bad input."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, NoReturn

from polefence import __version__, commands, engine
from polefence.conditions.methods import METHODS
from polefence.errors import InputError, MissingExtraError, NotProvedError, PolefenceError

PROVED, NOT_PROVED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = _parser()
    options = parser.parse_args(_negative_numbers(sys.argv[1:] if arguments is None else arguments))
    try:
        status: int = options.run(options)
        sys.stdout.flush()
        return status
    except NotProvedError as answer:
        print(answer, file=sys.stderr)
        return NOT_PROVED
    except (InputError, MissingExtraError) as error:
        print(f"polefence: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except PolefenceError as error:
        print(f"polefence: {error}", file=sys.stderr)
        return NOT_PROVED
    except KeyboardInterrupt:
        keeps = getattr(options, "json", None) or getattr(options, "output", None)
        keeps = keeps and hasattr(options, "resume")
        kept = "; finished rows are kept, --resume goes on" if keeps else ""
        print(f"polefence: interrupted{kept}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PROVED
    except OSError as error:
        print(f"polefence: cannot write the output: {error.strerror}", file=sys.stderr)
        return BAD_INPUT


def _negative_numbers(arguments: Sequence[str]) -> list[str]:
    """Write -4e1 as -40: argparse takes plain negative numbers only."""
    return [_plain(word) if word.startswith("-") else word for word in arguments]


def _plain(word: str) -> str:
    try:
        number = Decimal(word)
    except InvalidOperation:
        return word
    return format(number, "f") if number.is_finite() and abs(number.adjusted()) < 400 else word


class _Parser(argparse.ArgumentParser):
    """Errors of usage in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}; see: {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="polefence",
        description="State feedback that keeps every closed-loop pole in a region for all values "
        "of the uncertain parameters, proved in exact arithmetic.",
        epilog="exit status: 0 proved or done, 1 not proved, 2 bad input or usage. "
        "CENTRE is the real coordinate, negative on the left (-40).",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action="version", version=f"polefence {__version__}, engine: {engine()}"
    )
    listed = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(name: str, run: Callable[[Any], int]) -> argparse.ArgumentParser:
        text = run.__doc__
        sub = listed.add_parser(name, help=text, description=text, allow_abbrev=False)
        sub.set_defaults(run=run)
        return sub

    sub = command("limits", commands.limits_command)
    _spec_argument(sub)
    sub.add_argument(
        "--centre",
        "--center",
        type=float,
        action="append",
        default=[],
        metavar="CENTRE",
        help="real coordinate of the disk's centre; repeat for more",
    )
    sub.add_argument(
        "--centres",
        "--centers",
        type=float,
        nargs=3,
        metavar=("FROM", "TO", "COUNT"),
        help="evenly spaced centres, for example -5 -100 60",
    )
    sub.add_argument(
        "--method", action="append", choices=METHODS, help="repeat for more; default: all three"
    )
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the rows, kept up to date")
    sub.add_argument("--plot", type=Path, metavar="FILE", help="draw d/sigma (.png, .svg, .pdf)")
    sub.add_argument("--gain", action="store_true", help="put each row's law into the JSON")
    _sweep_arguments(sub)

    sub = command("design", commands.design_command)
    _spec_argument(sub)
    sub.add_argument("--disk", type=float, nargs=2, required=True, metavar=("CENTRE", "RADIUS"))
    sub.add_argument("--method", choices=METHODS, default="scheduled", help="default: scheduled")
    sub.add_argument(
        "--right-hand-sides",
        action="store_true",
        help="scheduled: keep the right-hand sides of the paper's (15)-(17)",
    )
    sub.add_argument("-o", "--output", type=Path, metavar="DIR", help="write DIR/design.json")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write a summary")

    sub = command("check", commands.check_command)
    sub.add_argument("file", type=Path, metavar="FILE", help="design.json, or the folder with it")
    sub.add_argument("--spec", metavar="SPEC", help="also require that it is about this plant")
    sub.add_argument("--json", type=Path, metavar="FILE", help="write the answer")

    sub = command("paper", commands.paper_command)
    sub.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("paper-results"),
        metavar="DIR",
        help="default: %(default)s",
    )
    _sweep_arguments(sub)

    sub = command("example", commands.example_command)
    sub.add_argument("name", nargs="?", metavar="NAME", help="without it: list the names")
    return parser


def _spec_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", metavar="SPEC", help="a TOML spec (see: polefence example)")


def _sweep_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--jobs", type=int, metavar="N", help="processes; default: one a processor")
    parser.add_argument("--resume", action="store_true", help="keep rows of an interrupted run")


if __name__ == "__main__":
    sys.exit(main())
