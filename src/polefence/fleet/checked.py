"""Results of a study proved afresh: each row against its file, that against the variant."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polefence.base.errors import DesignFileError, PolefenceError
from polefence.base.explained import explained
from polefence.base.files import read_bytes
from polefence.certify.design import check_document, read_document
from polefence.fleet.claimed import is_about
from polefence.fleet.questions import Question
from polefence.fleet.store import Row, Store, digest_of, law_of
from polefence.fleet.study import Study
from polefence.fleet.workers import Workers
from polefence.proof.document import Document
from polefence.proof.reading import MAX_BYTES
from polefence.proof.short import Short
from polefence.proof.work import FormatError

TOGETHER = 8  # rows that one task has
# Share of a sample, or of a radius that is out of reach, at which two machines agree on it: next to
# none of the gap between such a radius and the least one that is proved, 1e-7 of it.
SAME = 1 - 1e-8


@dataclass(frozen=True)
class Judged(Short):
    """A row and its fault, empty if there is none.

    Attributes
    ----------
    variant : int
    question : str
    fault : str
    """

    variant: int
    question: str
    fault: str


@dataclass(frozen=True)
class _Fresh:
    row: Row
    spec: str
    question: Question


@dataclass(frozen=True)
class _Rows:
    folder: Path
    rows: tuple[_Fresh, ...]


@explained
def judged(store: Store, workers: Workers) -> Iterator[Judged]:
    """Yield each row of a store, proved afresh.

    Raises
    ------
    DesignFileError
        If the store cannot be read.
    """
    study, seen = Study.of(store.about), set[tuple[Any, Any]]()
    questions = {question.name: question for question in study.questions}
    fresh = list[_Fresh]()
    for row in store.rows():
        key = row["variant"], row["question"]
        fault = _of_row(row, study) or ("is given twice" if key in seen else "")
        if not fault:
            fault = _of_question(row, questions.get(row["question"]))
        seen.add(key)
        if fault or not row["proof"]:
            yield Judged(*key, fault)
        else:
            fresh.append(_Fresh(row, study.spec(row["variant"]), questions[row["question"]]))
    parts = (fresh[k : k + TOGETHER] for k in range(0, len(fresh), TOGETHER))
    tasks = (_Rows(store.folder, tuple(part)) for part in parts)
    for batch, faults in workers.done(_faults, tasks):
        for one, fault in zip(batch.rows, faults or _lost(batch), strict=True):
            yield Judged(one.row["variant"], one.row["question"], fault)


def _lost(batch: _Rows) -> list[str]:
    return ["the process that proved it died"] * len(batch.rows)


def _of_row(row: Row, study: Study) -> str:
    """Say what is wrong with a row by itself."""
    if digest_of(row) != row["digest"]:
        return "is not as it was written: its digest differs"
    if not 0 <= row["variant"] < len(study.variants):
        return "is of no variant of the study"
    if row["label"] != study.variants.label(row["variant"]):
        return "has another label than the study"
    values = study.variants.values(row["variant"])
    for name in study.variants.names:
        if row[name] != (float(values[name]) if name in values else None):
            return f"has another {name} than the study"
    if (row["status"] == "proved") != bool(row["proof"]):
        return "says that it is proved, and names no proof" if not row["proof"] else "names a proof"
    return ""


def _of_question(row: Row, question: Question | None) -> str:
    """Return the fault of a row about another question, or with a bound but no proof."""
    if question is None:
        return "is of no question of the study"
    if row["ask"] != question.kind:
        return f"asks for {row['ask']}, its question for {question.kind}"
    if not row["proof"] and (row["bound"] is not None or row["least"] is not None):
        return "has a bound, and names no proof"
    return ""


def _faults(batch: _Rows) -> list[str]:
    return [_fault(Store(batch.folder), one) for one in batch.rows]


def _fault(store: Store, fresh: _Fresh) -> str:
    """Say what is wrong with a row's proof."""
    try:
        return _fault_of_proof(store.proof(fresh.row["proof"]), fresh)
    except (PolefenceError, FormatError) as error:
        return str(error)


def _fault_of_proof(path: Path, fresh: _Fresh) -> str:
    row, question, spec = fresh.row, fresh.question, fresh.spec
    content = read_bytes(path, MAX_BYTES, DesignFileError)
    if hashlib.sha256(content).hexdigest() != row["proof"]:
        return "its file of claims is not as it was written"
    document = read_document(path)
    if law_of(content) != row["law"]:
        return "names another law than its file"
    answer = check_document(document, path)
    if not answer.proved:
        return f"its claims are {answer.answer}: {answer.reason}"
    if "; ".join(answer.claims) != row["claim"]:
        return "claims another thing than its file"
    if not is_about(document, question.plant(spec, document.plant.n)):
        return "its file is about another plant"
    form = question.form(spec, document.plant.n)
    return (
        question.fault(document, spec) or form.fault(document) or _fault_of_numbers(document, fresh)
    )


def _fault_of_numbers(document: Document, fresh: _Fresh) -> str:
    """Say what is wrong with a row's numbers."""
    row, question, spec = fresh.row, fresh.question, fresh.spec
    bound, least, worst = row["bound"], row["least"], row["worst"]
    if bound is None and question.is_bounded(spec):
        return "has no bound"
    if bound is not None and not question.proves(document, spec, bound):
        return "its bound is none of its file"
    if row["unit"] != (unit := question.unit(document, spec)):
        return f"its unit is {row['unit']!r}, not {unit!r}"
    if worst is not None and not _agree(worst, question.worst(document, spec)):
        return "its worst sample is none of its file's law"
    if least is not None:
        sampled_least = question.least(spec)
        if sampled_least is None or bound is None or not least <= min(bound, sampled_least / SAME):
            return f"its least, {least:.6g}, was not proved out of reach again"
    return ""


def _agree(one: float, other: float | None) -> bool:
    """Whether two machines have the same sample."""
    return other is not None and min(one, other) >= max(one, other) * SAME
