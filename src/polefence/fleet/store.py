"""Results of a study in a folder: a Parquet data set, proof files beside it, one client at a time.

RESULTS/study.json       what was asked, and its digest
RESULTS/rows/*.parquet   rows, each file whole from the start; any reader takes the folder
RESULTS/proofs/ab/....json   files of claims, each named by its SHA-256
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from polefence.base import VERSION
from polefence.base.errors import DesignFileError, OutputError
from polefence.base.files import make_folder, read_bytes, read_text, write_bytes
from polefence.base.parquet import arrow, read_table, table_bytes
from polefence.fleet.questions import SAMPLED, Answer
from polefence.fleet.study import Study
from polefence.lmi.solve.engine import engine

STUDY, ROWS, PROOFS, LOCK = "study.json", "rows", "proofs", "lock"
FORMAT = "polefence study"
REMEDY = "pip install 'polefence[parquet]'"
MAX_BYTES = 1_000_000_000
TEXTS = ("label", "question", "ask", "status", "unit", "claim", "reason")
NUMBERS = ("bound", "least", "worst", "seconds")
MARKS = ("law", "version", "engine", "proof", "digest")

Row = dict[str, Any]


def digest_of(row: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a row's other columns."""
    columns = {key: value for key, value in row.items() if key != "digest"}
    return hashlib.sha256(json.dumps(columns, sort_keys=True).encode()).hexdigest()


class Store:
    """A folder of results.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def about(self) -> dict[str, Any]:
        """What was asked, as `Study.document` has it.

        Raises
        ------
        DesignFileError
            If the folder is none of a study.
        """
        path = self.folder / STUDY
        try:
            about = json.loads(read_text(path, MAX_BYTES, DesignFileError))
        except ValueError as error:
            raise DesignFileError(f"{path}: no JSON: {error}") from error
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise DesignFileError(
                f"{path}: not the results of a study; name the folder that study -o wrote"
            )
        return about

    def begin(self, study: Study, resume: bool) -> None:
        """Make the folder, or find that it is of this study.

        Raises
        ------
        OutputError
            If there are results already, and they are not to be resumed, or of another study.
        """
        arrow(REMEDY)
        if (self.folder / STUDY).exists():
            if self.about["digest"] != study.digest:
                raise OutputError(
                    f"{self.folder}: results of another study, or of this one before it changed; "
                    "name another folder"
                )
            if not resume:
                raise OutputError(f"{self.folder}: has results of this study; go on by --resume")
            return
        others = [
            entry.name for entry in self.folder.iterdir() if entry.name not in (LOCK, ROWS, PROOFS)
        ]
        if others:
            raise OutputError(
                f"{self.folder}: has {min(others)}, but no results of a study; name another folder"
            )
        make_folder(self.folder / ROWS)
        make_folder(self.folder / PROOFS)
        table = {"format": FORMAT, "digest": study.digest} | study.document()
        write_bytes(self.folder / STUDY, (json.dumps(table, indent=1) + "\n").encode())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep others out while rows are added; the system lets go when this process ends.

        Raises
        ------
        OutputError
            If another process has it.
        """
        make_folder(self.folder)
        with (self.folder / LOCK).open("a+b") as file:
            try:
                _lock(file.fileno())
            except OSError as error:
                raise OutputError(
                    f"{self.folder}: another process is adding rows to it; wait for its end, or "
                    "name another folder"
                ) from error
            yield

    def add(self, study: Study, question: int, answers: Mapping[int, Answer]) -> list[Row]:
        """Write the answers to one question, all of them or none; return their rows.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        rows = []
        for number, answer in answers.items():
            proof = ""
            if answer.document is not None:
                content = answer.document.encode("utf-8", "backslashreplace")
                proof = hashlib.sha256(content).hexdigest()
                path = self.proof(proof)
                if not path.exists():
                    path.parent.mkdir(exist_ok=True)
                    write_bytes(path, content)
            rows.append(row_of(study, question, number, answer, proof))
        content = _table(rows, study.variants.names)
        name = hashlib.sha256(content).hexdigest()[:20]
        write_bytes(self.folder / ROWS / f"{name}.parquet", content)
        return rows

    def proof(self, digest: str) -> Path:
        """Return where the file of claims of that digest is."""
        return self.folder / PROOFS / digest[:2] / f"{digest}.json"

    def rows(self) -> Iterator[Row]:
        """Yield all rows, file by file.

        Raises
        ------
        DesignFileError
            If a file cannot be read.
        """
        for path in sorted((self.folder / ROWS).glob("*.parquet")):
            yield from _read(path)

    def done(self) -> frozenset[tuple[int, str]]:
        """Return which rows there are: variant and question."""
        return frozenset((row["variant"], row["question"]) for row in self.rows())


def law_of(document: str | bytes) -> str:
    """Return an identifier of a file's law: the start of its SHA-256."""
    law = json.dumps(json.loads(document).get("law"), sort_keys=True)
    return hashlib.sha256(law.encode()).hexdigest()[:12]


def value_of(row: Row) -> float | None:
    """Return the value of a row: its bound, or the worst sample where nothing is proved."""
    value: float | None = row["worst"] if row["status"] == SAMPLED else row["bound"]
    return value


def alike(rows: Sequence[Row]) -> list[tuple[Row, int]]:
    """Return the first of rows whose reasons differ in numbers alone, and how many there are."""
    first, counts = dict[tuple[str, ...], Row](), Counter[tuple[str, ...]]()
    for row in sorted(rows, key=lambda row: row["variant"]):
        reason = re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", row["reason"])  # but for its numbers
        key = row["question"], row["status"], reason
        first.setdefault(key, row)
        counts[key] += 1
    return [(first[key], count) for key, count in counts.most_common()]


def row_of(study: Study, question: int, number: int, answer: Answer, proof: str) -> Row:
    """Return a row, with the numbers that the variant changes."""
    asked = study.questions[question]
    row: Row = {"variant": number, "label": study.variants.label(number)}
    row |= {"question": asked.name, "ask": asked.kind}
    row |= {key: getattr(answer, key) for key in ("status", "unit", "claim", "reason", *NUMBERS)}
    row["law"] = "" if answer.document is None else law_of(answer.document)
    row |= {"version": VERSION, "engine": engine(), "proof": proof}
    values = study.variants.values(number)
    for name in study.variants.names:
        row[name] = float(values[name]) if name in values else None
    return row | {"digest": digest_of(row)}


def _table(rows: Sequence[Row], names: Sequence[str]) -> bytes:
    pa = arrow(REMEDY)
    kinds = {"variant": pa.int64()}
    kinds |= dict.fromkeys((*TEXTS, *MARKS), pa.string())
    kinds |= dict.fromkeys((*NUMBERS, *names), pa.float64())
    columns = ("variant", *TEXTS, *NUMBERS, *MARKS, *names)
    schema = pa.schema([(key, kinds[key]) for key in columns])
    return table_bytes(pa.Table.from_pylist(list(rows), schema), REMEDY)


def _read(path: Path) -> list[Row]:
    content = read_bytes(path, MAX_BYTES, DesignFileError)
    table = read_table(content, str(path), REMEDY, DesignFileError)
    if not {"variant", "question", "digest", "proof"} <= set(table.column_names):
        raise DesignFileError(f"{path}: not rows of a study")
    rows: list[Row] = table.to_pylist()
    return rows


def _lock(handle: int) -> None:
    """Take the lock of an open file, or raise OSError."""
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
