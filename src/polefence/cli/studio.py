"""``polefence studio``: a page in the browser in which a region is moved, and every car is seen."""

from __future__ import annotations

import argparse
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polefence.base.errors import InputError, MissingExtraError
from polefence.base.files import make_folder, read_text
from polefence.cli.common import PROVED
from polefence.cli.terminal import say
from polefence.design.checks import require_region
from polefence.design.design import Design, is_proof_file
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.spec import MAX_BYTES, dumps, loads
from polefence.region.text import load_region, parse_region

if TYPE_CHECKING:
    from polefence.studio import Session

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
        help="where the page saves; default: studio",
    )


def studio_command(options: Any) -> int:
    """Open a page in which the region is dragged, every car's poles are seen, and all is proved."""
    if not 0 <= options.port <= MOST_PORT:
        raise InputError(f"--port = {options.port} must be from 0 to {MOST_PORT}")
    if find_spec("panel") is None:
        raise MissingExtraError(
            "the studio needs Panel, which is not installed; pip install 'polefence[studio]'"
        )
    from polefence.studio import serve

    session, name = _session(options)
    require_region(session.plant, session.state.region)
    folder = make_folder(options.output)
    serve(session, name, folder, options.port, not options.no_browser, _ready)
    return PROVED


def _ready(address: str) -> None:
    say(f"studio: {address}", "whoever has this address can use it; Ctrl-C ends it")


def _session(options: Any) -> tuple[Session, str]:
    """Read a spec, a design or a session; return it with how its spec is called in commands."""
    from polefence.studio import PLANT, Session, State, first_region, is_session, read_session

    path, name = options.subject, str(options.output / PLANT)
    region = None if options.region is None else parse_region(options.region)
    if path.is_dir() or is_proof_file(path):
        design = Design.load(path, allow_unproved=True)
        method = design.method if design.method in METHODS else METHODS[-1]
        state = State.first(design.plant, region or design.region, method)
        return Session(dumps(design.plant), design.plant, state), name
    if is_session(path):
        session = read_session(path)
        now = session.state if region is None else replace(session.state, region=region)
        return replace(session, state=now), name
    text = read_text(path, MAX_BYTES, InputError)
    plant = loads(text, str(path))
    region = region or load_region(path) or first_region(plant)
    return Session(text, plant, State.first(plant, region)), str(path)
