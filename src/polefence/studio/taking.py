"""What is taken away: the session, the design with its proof, a report, and code."""

from __future__ import annotations

from pathlib import Path

from polefence.base.errors import InputError, NotProvedError, OutputError
from polefence.base.files import begins_with, make_folder, write_documents, write_text
from polefence.certify.design import FILE_NAME
from polefence.export import export_c99
from polefence.show.report import MARK, html_report
from polefence.studio.answers import Answer
from polefence.studio.session import DESIGN, Session
from polefence.studio.state import State
from polefence.studio.subject import Subject

REPORT, CODE = "report.html", "code"  # in the folder


def save(folder: Path, subject: Subject, state: State, answer: Answer | None) -> list[Path]:
    """Write the session, and the design where all that it claims is proved; an older one stays.

    Raises
    ------
    InputError
        If a file cannot be written, or is another's.
    """
    design = []
    if answer is not None and answer.proved and answer.result is not None:
        documents = {FILE_NAME: answer.result.document.dumps()}
        design = write_documents(_own(folder / DESIGN), documents)
    else:
        state = state.asking()  # what is given has no file there
    return [Session.of(subject, state).save(folder), *design]


def report(folder: Path, state: State, answer: Answer) -> list[Path]:
    """Write one HTML page about a law that is proved.

    Raises
    ------
    InputError
        If it cannot be written.
    NotProvedError
        If the law is not proved.
    """
    if answer.result is None or answer.check is None or not answer.proved:
        raise NotProvedError("no report: the law is not proved")
    words = state.road.split()
    road = words[1] if words[0] == "class" else "C"
    text = html_report(answer.result.design, road, state.speed, answer.result.document)
    path = make_folder(folder) / REPORT
    if path.is_symlink() or (path.exists() and not begins_with(path, MARK)):
        raise InputError(f"{path}: is not a report; move it away")
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
    if answer.result is None or not answer.proved:
        raise NotProvedError("no code: the law is not proved")
    return list(export_c99(answer.result.design).save(_own(folder / CODE)))


def _own(folder: Path) -> Path:
    """Return a folder that is no link."""
    if folder.is_symlink():
        raise OutputError(
            f"{folder}: is a symbolic link, and links are not written through; move it away"
        )
    return folder
