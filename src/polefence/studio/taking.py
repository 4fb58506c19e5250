"""What is taken away: the session, the design with its proof, a report, and code."""

from __future__ import annotations

from pathlib import Path

from polefence.base.errors import InputError, NotProvedError
from polefence.base.files import DOCUMENT, begins_with, make_folder, write_documents, write_text
from polefence.design.design import FILE_NAME
from polefence.export import export_c99
from polefence.show.report import html_report
from polefence.studio.answers import Answer
from polefence.studio.session import Session
from polefence.studio.state import State
from polefence.studio.subject import Subject

DESIGN, REPORT, CODE = "design", "report.html", "code"  # in the folder
MARK = b"<!DOCTYPE html>"


def save(folder: Path, subject: Subject, state: State, answer: Answer | None) -> list[Path]:
    """Write the session, and the design where all that it claims is proved; an older one goes.

    Raises
    ------
    InputError
        If a file cannot be written, or is another's.
    """
    saved = [Session.of(subject, state).save(folder)]
    if answer is not None and answer.proved and answer.found is not None:
        documents = {FILE_NAME: answer.found.document.dumps()}
        return [*saved, *write_documents(folder / DESIGN, documents)]
    own = folder / DESIGN / FILE_NAME
    if begins_with(own, DOCUMENT):
        own.unlink()
    return saved


def report(folder: Path, state: State, answer: Answer) -> list[Path]:
    """Write one HTML page about a law that is proved.

    Raises
    ------
    InputError
        If it cannot be written.
    NotProvedError
        If the law is not proved.
    """
    if answer.found is None or answer.check is None or not answer.proved:
        raise NotProvedError("no report: the law is not proved")
    words = state.road.split()
    road = words[1] if words[0] == "class" else "C"
    text = html_report(answer.found.design, road, state.speed, answer.check.claims[1:])
    path = make_folder(folder) / REPORT
    if path.is_symlink() or (path.exists() and not begins_with(path, MARK)):
        raise InputError(f"{path}: is no report; move it away")
    write_text(path, text)
    return [path]


def code(folder: Path, answer: Answer) -> list[Path]:
    """Write a law that is proved as C99, with what is proved of its rounding.

    Raises
    ------
    InputError
        If it cannot be written, or the law not exported.
    NotProvedError
        If the law is not proved.
    """
    if answer.found is None or not answer.proved:
        raise NotProvedError("no code: the law is not proved")
    return list(export_c99(answer.found.design).save(folder / CODE))
