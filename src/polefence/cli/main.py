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
from polefence.cli import (
    analyse,
    check,
    compare,
    completion,
    concepts,
    design,
    example,
    export,
    identify,
    limits,
    loops,
    observe,
    optimise,
    paper,
    report,
    robust,
    semi_active,
    service,
    simulate,
    studio,
    study,
    tightest,
    tradeoff,
)
from polefence.cli.help import Formatter, examples, listing
from polefence.cli.interrupt import cut_off
from polefence.cli.output import NOT_PROVED, PROVED, streams
from polefence.cli.terminal import say, shown_progress
from polefence.lmi.solve.engine import engine

BAD_INPUT, INTERRUPTED = 2, 130

Command = tuple[str, Callable[[Any], int], Callable[[argparse.ArgumentParser], None]]
# Each module declares its own options; --help lists them as polefence.cli.help groups them.
COMMANDS: tuple[Command, ...] = (
    ("identify", identify.identify_command, identify.add_arguments),
    ("limits", limits.limits_command, limits.add_arguments),
    ("design", design.design_command, design.add_arguments),
    ("tightest", tightest.tightest_command, tightest.add_arguments),
    ("observe", observe.observe_command, observe.add_arguments),
    ("optimise", optimise.optimise_command, optimise.add_arguments),
    ("tradeoff", tradeoff.tradeoff_command, tradeoff.add_arguments),
    ("semi-active", semi_active.semi_active_command, semi_active.add_arguments),
    ("service", service.service_command, service.add_arguments),
    ("loops", loops.loops_command, loops.add_arguments),
    ("analyse", analyse.analyse_command, analyse.add_arguments),
    ("verify", analyse.verify_command, analyse.add_arguments),
    ("robust", robust.robust_command, robust.add_arguments),
    ("simulate", simulate.simulate_command, simulate.add_arguments),
    ("compare", compare.compare_command, compare.add_arguments),
    ("concepts", concepts.concepts_command, concepts.add_arguments),
    ("studio", studio.studio_command, studio.add_arguments),
    ("study", study.study_command, study.add_arguments),
    ("report", report.report_command, report.add_arguments),
    ("export", export.export_command, export.add_arguments),
    ("check", check.check_command, check.add_arguments),
    ("paper", paper.paper_command, paper.add_arguments),
    ("example", example.example_command, example.add_arguments),
    ("completion", completion.completion_command, completion.add_arguments),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = _parser()
    completion.complete(parser)
    options = parser.parse_args(_negative_numbers(sys.argv[1:] if arguments is None else arguments))
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
            message = (
                f"no command {shown(unknown[1])}; {suggest(unknown[1], [c[0] for c in COMMANDS])}"
            )
        say(f"{self.prog}: {message}; see: {self.prog} --help", file=sys.stderr)
        self.exit(BAD_INPUT)


def _parser() -> argparse.ArgumentParser:
    texts = {name: str(run.__doc__) for name, run, _ in COMMANDS}
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

    for name, run, add_arguments in COMMANDS:
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
