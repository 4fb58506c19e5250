"""``polefence studio``: a page in the browser in which a region is moved, and every car is seen."""

from __future__ import annotations

import argparse
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polefence.base.errors import InputError, MissingExtraError
from polefence.base.files import check_target
from polefence.certify.checks import in_time_of, require_region
from polefence.cli.output import PROVED
from polefence.cli.subjects import is_design
from polefence.cli.terminal import say
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.spec import dumps, loads
from polefence.region.text import load_region, parse_region

if TYPE_CHECKING:
    from polefence.studio import State, Subject

MOST_PORT = 65535


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `studio`."""
    parser.add_argument(
        "subject",
        type=Path,
        metavar="FILE",
        help="a TOML spec, a design, or a session that was saved",
    )
    parser.add_argument(
        "--region", metavar="TEXT", help="to begin with; default: that of the file, or an example"
    )
    parser.add_argument(
        "--port", type=int, default=0, metavar="N", help="default: one that is free"
    )
    parser.add_argument("--no-browser", action="store_true", help="print the address alone")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("studio"),
        metavar="DIR",
        help="where the first page saves, others beside it; default: studio",
    )


def studio_command(options: Any) -> int:
    """Open a page in which the region is dragged, every car's poles are seen, and all is proved."""
    if not 0 <= options.port <= MOST_PORT:
        raise InputError(f"--port = {options.port} must be from 0 to {MOST_PORT}")
    if find_spec("panel") is None:
        raise MissingExtraError(
            "the studio needs Panel, which is not installed; pip install 'polefence[studio]'"
        )
    from polefence.studio import SESSION, serve, settled

    check_target(options.output / SESSION)
    opened = options.subject if options.subject.name == SESSION else None
    subject, state = _opened(options)
    require_region(subject.plant, state.region)
    more = options.port, not options.no_browser, _ready
    serve(subject, state, options.output, *more, opened=opened)
    if not settled(0.5):  # what is in the kernel hears of nothing
        sys.stdout.flush()
        os._exit(PROVED)
    return PROVED


def _ready(address: str) -> None:
    say(f"studio: {address}", "whoever has this address can use it; Ctrl-C ends it")


def _opened(options: Any) -> tuple[Subject, State]:
    """Read a spec, a design or a session."""
    from polefence.studio import Session, State, Subject, first_region, is_session, put_spec

    path = options.subject
    region = None if options.region is None else parse_region(options.region)
    if is_design(path):
        subject, state = _design(path, options.output)
    elif is_session(path):
        session = Session.read(path)
        loads(session.text, f"{path}: spec")  # nothing is written of what makes no sense
        subject = Subject.read(put_spec(options.output, session.text))
        state = session.state(subject, path)
    else:
        subject = Subject.read(path)
        region = region or load_region(path) or first_region(subject)
        return subject, State.first(subject, in_time_of(subject.plant, region))
    if region is None:
        return subject, state
    return subject, state.asking(region=in_time_of(subject.plant, region))


def _design(path: Path, folder: Path) -> tuple[Subject, State]:
    """Read a design: its law is looked at first."""
    from polefence.studio import Found, State, Subject, put_spec

    design = Found.read(path).design
    subject = Subject.read(put_spec(folder, dumps(design.plant)))
    method = METHODS[0] if design.law.K is not None else METHODS[-1]
    state = State.first(subject, design.region, method=method, given=str(path))
    return subject, state.asking(measured=subject.measured_by(design), given=str(path))
