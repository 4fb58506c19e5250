"""What commands write: files, JSON, figures, and the order in which these are named."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, redirect_stdout
from contextvars import ContextVar
from itertools import count
from pathlib import Path
from typing import Any, TextIO

from polefence.base.beside import collected
from polefence.base.errors import InputError, NotProvedError
from polefence.base.files import check_document, check_target, make_folder, write_bytes, write_text
from polefence.base.progress import stage
from polefence.base.renamed import with_old_keys
from polefence.certify.design import Design
from polefence.cli.lines import gains_of, law_lines, words_of
from polefence.cli.terminal import aside, say
from polefence.proof.text import plural

PROVED, NOT_PROVED = 0, 1
STANDARD = Path("-")  # as a file: standard output
_standard: ContextVar[TextIO | None] = ContextVar("standard output", default=None)
_saved: ContextVar[list[str] | None] = ContextVar("files that were written", default=None)


@contextmanager
def streams(options: Any) -> Iterator[None]:
    """Keep standard output for the JSON of ``--json -``, text going to stderr; drop it if quiet.

    What is to be said beside the answers comes after them, and files that were written at the end.
    """
    token, names = _standard.set(sys.stdout), list[str]()
    listed = _saved.set(names)
    with ExitStack() as stack:
        if getattr(options, "quiet", False):
            nowhere = stack.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
            stack.enter_context(redirect_stdout(nowhere))
        elif getattr(options, "json", None) == STANDARD:
            stack.enter_context(redirect_stdout(sys.stderr))
        notes = stack.enter_context(collected())
        try:
            yield
            say(*notes)
        except NotProvedError:  # an answer too
            say(*notes)
            raise
        finally:
            _standard.reset(token)
            _saved.reset(listed)
            say(*(f"saved: {name}" for name in names))


def saved(*paths: object) -> None:
    """Have files that were written named when the command has said all else."""
    names = _saved.get()
    if names is not None:
        names += [name for name in map(str, paths) if name not in names]


def check_results(options: Any, *names: str) -> None:
    """Refuse results that cannot be written, or that overwrite one another, before any work.

    Parameters
    ----------
    options
        With any of ``output``, ``json`` and ``plot``.
    *names
        Of the documents that go into the folder ``output``; without any it is a file.
    """
    output, summary, figure = (getattr(options, key, None) for key in ("output", "json", "plot"))
    if figure is not None and figure.suffix not in (".png", ".svg", ".pdf"):
        raise InputError(f"{figure}: a figure ends in .png, .svg or .pdf")
    documents = [] if output is None else [output / name for name in names]
    for path in documents:
        check_document(path)
    files = (summary, figure) if names else (output, summary, figure)
    targets = [*documents, *(path for path in files if path not in (None, STANDARD))]
    for path in targets:
        check_target(path)
    if len({path.absolute() for path in targets}) < len(targets):
        raise InputError(f"{targets[0]}: named for two results; name another file")


def report(design: Design, lines: list[str], summary: Mapping[str, Any], options: Any) -> None:
    """Save a design, its summary and its figure where the options say so; print lines and gains.

    Files first: nobody need read the output to its end.
    """
    if options.output is not None:
        saved(design.save(options.output))
    if options.json is not None:
        write_json(options.json, {**summary, "gains": gains_of(design.law), **words_of(design.law)})
    if options.plot is not None:
        write_poles(options.plot, design)
    note = [design.note] if design.note else []
    say(*lines, *note, *law_lines(design.law), verdict="proved")


def write_poles(path: Path, design: Design, title: str = "") -> None:
    """Draw the poles of a design over its family, and its region."""
    from polefence.show.plots import poles_figure, sampled

    plant = design.plant
    cloud = {title or plant.name: sampled(design)}
    write_figure(path, poles_figure(cloud, design.region, discrete=plant.sample_time is not None))


def write_figure(path: Path, figure: Any) -> None:
    """Write a figure in the format that its name asks for."""
    from polefence.show.plots import render

    make_folder(path.parent)
    write_bytes(path, render(figure, path.suffix[1:]))
    saved(path)


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write plain data, to standard output where the path is -."""
    text = json.dumps(with_old_keys(document), indent=1, allow_nan=False) + "\n"
    if path == STANDARD:
        stream = _standard.get() or sys.stdout
        with aside():
            stream.write(text)
            stream.flush()
        return
    make_folder(path.parent)
    write_text(path, text)
    saved(path)


@contextmanager
def finished_rows(total: int) -> Iterator[Callable[[str], None]]:
    """Show how many rows of a sweep are finished; takes the words of each as it is."""
    done = count(1)
    with stage(f"0 of {plural(total, 'row')}") as progress:
        yield lambda last: progress.now(f"{next(done)} of {plural(total, 'row')}, the last {last}")
