"""The command line: parse, call, print. Exit 0 proved or done, 1 not proved, 2 bad input."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from decimal import Decimal, InvalidOperation
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

from polefence.base import VERSION
from polefence.base.errors import (
    InputError,
    MissingExtraError,
    NotProvedError,
    PolefenceError,
    UncontrollableError,
    shown,
    suggest,
)
from polefence.cli import completion
from polefence.cli.help import GROUPS, Formatter, examples, listing
from polefence.cli.interrupt import cut_off
from polefence.cli.output import NOT_PROVED, PROVED, streams
from polefence.cli.terminal import say, shown_progress
from polefence.lmi.solve.engine import engine

BAD_INPUT, INTERRUPTED = 2, 130

Command = tuple[Callable[[Any], int], Callable[[argparse.ArgumentParser], None]]
COMMANDS = tuple(name for names in GROUPS.values() for name in names)
ELSEWHERE = {"verify": "analyse"}  # commands that share the module of another


def command(name: str) -> Command:
    """Return what runs a command, and what declares its options: its module is imported."""
    own = name.replace("-", "_")
    module = import_module(f"polefence.cli.{ELSEWHERE.get(name, own)}")
    return getattr(module, f"{own}_command"), module.add_arguments


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    parser = _parser(words[:1])
    completion.complete(parser)
    options = parser.parse_args(_negative_numbers(words))
    try:
        shown = shown_progress(not options.quiet)
        with shown, cut_off(partial(_cut_off, options)), streams(options):
            status: int = options.run(options)
        sys.stdout.flush()
        return status
    except NotProvedError as answer:
        say(_one_line(answer), file=sys.stderr)
        return NOT_PROVED
    except UncontrollableError as error:
        where = f"{options.spec}: " if hasattr(options, "spec") else ""
        say(f"polefence: {where}{_one_line(error)}", file=sys.stderr)
        return BAD_INPUT
    except (InputError, MissingExtraError) as error:
        say(f"polefence: {_one_line(error)}", file=sys.stderr)
        return BAD_INPUT
    except PolefenceError as error:
        say(f"polefence: {_one_line(error)}", file=sys.stderr)
        return NOT_PROVED
    except KeyboardInterrupt:
        # a second Ctrl-C while Python ends would turn the status into that of a killed process
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _say_interrupted(options)
        return INTERRUPTED
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PROVED
    except OSError as error:
        say(f"polefence: cannot write the output: {error.strerror}", file=sys.stderr)
        return BAD_INPUT


def _cut_off(options: Any) -> None:
    """End the process, in the middle of whatever it does."""
    _say_interrupted(options)
    os._exit(INTERRUPTED)


def _say_interrupted(options: Any) -> None:
    keeps = getattr(options, "json", None) or getattr(options, "output", None)
    keeps = keeps and hasattr(options, "resume")
    kept = "; finished rows are kept, --resume goes on" if keeps else ""
    say(f"polefence: interrupted{kept}", file=sys.stderr)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _negative_numbers(arguments: Sequence[str]) -> list[str]:
    """Write -4e1 as -40, and -5/(s+1) behind a space: argparse takes them for options."""
    return [_plain(word) if word.startswith("-") else word for word in arguments]


def _plain(word: str) -> str:
    if re.fullmatch(r"-[-+*/().^0-9eEsz]*[*/(][-+*/().^0-9eEsz]*", word):
        return f" {word}"
    try:
        number = Decimal(word)
    except InvalidOperation:
        return word
    return format(number, "f") if number.is_finite() and abs(number.adjusted()) < 400 else word


class _Parser(argparse.ArgumentParser):
    """Errors of usage in one line."""

    def error(self, message: str) -> NoReturn:
        unknown = re.match(r"argument COMMAND: invalid choice: '(.*?)' \(choose", message)
        if unknown is not None:
            message = f"no command {shown(unknown[1])}; {suggest(unknown[1], COMMANDS)}"
        say(f"{self.prog}: {message}; see: {self.prog} --help", file=sys.stderr)
        self.exit(BAD_INPUT)


def _parser(first: Sequence[str] = ()) -> argparse.ArgumentParser:
    """Return the parser, of one command alone where that is the first word."""
    names = [name for name in first if name in COMMANDS] or COMMANDS
    commands = {name: command(name) for name in names}
    texts = {name: str(run.__doc__) for name, (run, _) in commands.items()}
    parser = _Parser(
        prog="polefence",
        usage="polefence [--help] [--version] COMMAND ...",
        description="Feedback that keeps every closed-loop pole in a region for all values of the "
        f"uncertain\nparameters, proved in exact arithmetic.\n\n{listing(texts)}",
        epilog="polefence COMMAND --help lists the options of a command, with examples.\n"
        "exit status: 0 proved or done, 1 not proved, 2 bad input or usage.",
        formatter_class=Formatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action="version", version=f"polefence {VERSION}, engine: {engine()}"
    )
    listed = parser.add_subparsers(
        metavar="COMMAND", required=True, help=argparse.SUPPRESS, prog="polefence"
    )

    for name, (run, add_arguments) in commands.items():
        sub = listed.add_parser(
            name,
            help=texts[name],
            description=texts[name],
            epilog=examples(name),
            formatter_class=Formatter,
            allow_abbrev=False,
        )
        sub.set_defaults(run=run)
        add_arguments(sub)
        sub.add_argument(
            "--quiet", action="store_true", help="print errors alone; the exit status is the answer"
        )
    return parser


if __name__ == "__main__":
    sys.exit(main())
