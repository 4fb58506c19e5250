"""Files of a design and of what is proved of its signals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from polefence.base.errors import InputError, NotProvedError
from polefence.base.files import write_documents
from polefence.design.certificate import Certificate
from polefence.design.design import FILE_NAME, check
from polefence.proof.claims import BoundClaim
from polefence.proof.document import Document
from polefence.proof.work import FormatError


def save(certificate: Certificate, claims: Sequence[BoundClaim], directory: str | Path) -> Path:
    """Write ``design.json``, with the bounds, into a folder, made if need be; return its path.

    The numbers are those that were proved: a double as it is, any other rational as "p/q".

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    try:
        text = bounds_file(certificate, claims).dumps()
    except FormatError as error:
        raise InputError(str(error)) from error
    return write_documents(Path(directory), {FILE_NAME: text})[0]


def bounds_file(certificate: Certificate, claims: Sequence[BoundClaim]) -> Document:
    """Return the file of a design's region, and of bounds on its signals."""
    return certificate.file([certificate.claim(), *claims])


def statements(path: str | Path) -> tuple[str, ...]:
    """Return what a design's file claims besides its region, a line each; proved afresh.

    Raises
    ------
    DesignFileError
        If the file cannot be read.
    NotProvedError
        If it is not proved.
    """
    answer = check(path)
    if not answer.proved:
        raise NotProvedError(f"{path}: {answer}")
    return answer.claims[1:]
