"""A sweep kept in a JSON file, row by row, so that it can be interrupted and resumed."""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence, Set
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

from polefence.base.errors import InputError
from polefence.base.files import make_folder, read_text, write_text
from polefence.base.version import VERSION
from polefence.design.certificate import Certificate, file_plant
from polefence.design.design import Design
from polefence.design.place.limits import Limit, as_finished
from polefence.lmi.conditions.methods import METHODS, Method, method_label
from polefence.plant.family import UncertainPlant
from polefence.proof import document, work
from polefence.proof.claims.poles import Poles
from polefence.proof.reading import MAX_BYTES, parse
from polefence.region.regions import Disk

# What a row keeps of its design: with the plant, its centre and its radius all that proves it.
PROOF = ("method", "evidence")

# As `method_label` writes them: "slack", "scheduled(2, 1, box)".
LABEL = re.compile(rf"({'|'.join(METHODS)})(\(\d, \d(, box)?\))?")

AGAIN = 20  # times the least work, for a row that is proved again: of any law that was found
READING = 80  # operations for each number of the plant, which is read for each row

Row = dict[str, Any]
Key = tuple[float, str]


def plant_summary(plant: UncertainPlant) -> dict[str, Any]:
    """Return what identifies a plant in a result file."""
    n, m = plant.shape
    return {
        "name": plant.name,
        "states": n,
        "inputs": m,
        "vertices": len(plant.vertices),
        "digest": plant.digest,
    }


class RunOptions(TypedDict, total=False):
    """The fields of `Run` but its path, as keyword arguments."""

    executor: Executor | None
    resume: bool
    on_row: Callable[[Any], None] | None
    on_kept: Callable[[Row], None] | None


@dataclass(frozen=True, eq=False)
class Run:
    """How the rows of a sweep are computed and kept.

    Attributes
    ----------
    executor : concurrent.futures.Executor, optional
        Where to run; without one, here and one after the other.
    path : Path, optional
        A JSON file that is kept up to date after every row.
    resume : bool
        Keep the proved rows that are in the file already.
    on_row : callable, optional
        Called with each row as it is finished.
    on_kept : callable, optional
        Called with each row of the file that is kept.
    """

    executor: Executor | None = None
    path: Path | None = None
    resume: bool = False
    on_row: Callable[[Any], None] | None = None
    on_kept: Callable[[Row], None] | None = None

    def complete(
        self,
        done: dict[Key, Row],
        order: Sequence[Key],
        fresh: Iterable[tuple[Key, Row, Any]],
        write: Callable[[Path, list[Row]], None],
    ) -> None:
        """Add rows as they are finished, each written and told of before the next.

        They are written in their order, then any others that are done.
        """
        for key, row, told in fresh:
            done[key] = row
            self.keep(done, order, write)
            if self.on_row is not None:
                self.on_row(told)
        self.keep(done, order, write)

    def keep(
        self,
        done: dict[Key, Row],
        order: Sequence[Key],
        write: Callable[[Path, list[Row]], None],
    ) -> None:
        """Write the rows that are done, where there is a file."""
        if self.path is not None:
            make_folder(self.path.parent)
            write(self.path, [done[key] for key in dict.fromkeys((*order, *done)) if key in done])


def sweep(
    plant: UncertainPlant,
    centres: Sequence[float],
    methods: Sequence[Method],
    path: Path | None = None,
    gain: bool = False,
    **options: Unpack[RunOptions],
) -> list[Row]:
    """Return rows as `limits` has them, as plain data, keeping ``path`` up to date after every row.

    Each row has its ``proof`` besides: law, method and evidence as a design file has them.
    Methods of one label are one method. With ``resume``, rows already in the file are kept and not
    computed again: those whose proof holds, proved afresh. A ``lower`` of theirs is the file's,
    which ``lower_from_file`` says: it is not proved again. ``on_kept`` is called with each of them,
    ``on_row`` with each row that is computed, as soon as it is.

    Raises
    ------
    InputError
        If the file to resume from is unreadable, of another plant, by another version, or a row
        of it is not proved by what it holds.
    """
    named = {method_label(method): method for method in methods}
    order = [(c, label) for c in centres for label in named]
    run = Run(path=path, **options)
    done = _finished(path, plant, gain, set(order)) if path is not None and run.resume else {}
    if run.on_kept is not None:
        for row in done.values():
            run.on_kept(row)
    tasks = [(c, named[label]) for c, label in order if (c, label) not in done]
    fresh = (
        ((own.centre, own.method), own.as_row(gain) | {"proof": _proof(own.design)}, own)
        for _, own in as_finished(plant, tasks, run.executor)
    )

    run.complete(done, order, fresh, lambda path, rows: write_text(path, _dumps(plant, rows)))
    return [done[key] for key in order]


def _dumps(plant: UncertainPlant, rows: list[Row]) -> str:
    """Return the file's text, each proof on a line of its own."""
    head = json.dumps({"polefence": VERSION, "plant": plant_summary(plant)}, indent=1)
    texts = ",\n".join(textwrap.indent(_row_text(row), "  ") for row in rows)
    return head[:-2] + ',\n "rows": [\n' + texts + "\n ]\n}\n"


def _row_text(row: Row) -> str:
    others = {key: value for key, value in row.items() if key != "proof"}
    text = json.dumps(others, indent=1, allow_nan=False)
    return text[:-2] + ',\n "proof": ' + json.dumps(row["proof"], allow_nan=False) + "\n}"


def _proof(design: Design | None) -> dict[str, Any] | None:
    """Return what proves a row again, beside the plant and its own centre and radius."""
    if design is None:
        return None
    written = design.certificate.document()
    (claim,) = written["claims"]
    return {"law": written["law"]} | {key: claim[key] for key in PROOF}


def _finished(path: Path, plant: UncertainPlant, gain: bool, asked: Set[Key]) -> dict[Key, Row]:
    """Return the rows of an earlier run by centre and method, all proved afresh.

    Under one count of the work, which has more for each row that is asked for.
    """
    if not path.exists():
        return {}
    try:
        whole = parse(read_text(path, MAX_BYTES, InputError))
        version, digest = whole["polefence"], whole["plant"]["digest"]
        rows = {(row["centre"], row["method"]): row for row in whole["rows"]}
        proved = [row for row in rows.values() if row["status"] == "proved"]
        sound = all(_sound(row, plant) for row in proved)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: no sweep to resume; remove it to start anew") from error
    if not sound:
        raise InputError(f"{path}: a row is damaged; remove the file to start anew")
    if digest != plant.digest:
        raise InputError(f"{path}: a sweep of another plant; remove it, or name another file")
    if version != VERSION:
        other = str(version)[:40]
        raise InputError(f"{path}: a sweep by polefence {other}; remove it to start anew")
    found = {}
    with work.counted() as count:
        for row in proved:
            if row.get("proof") is not None:
                key = row["centre"], row["method"]
                found[key] = _again(path, row, plant, gain, count if key in asked else None)
    return found


def _again(
    path: Path, row: Row, plant: UncertainPlant, gain: bool, count: work.Count | None
) -> Row:
    """Prove a row of a file afresh, and return what of it is proved.

    To a count that is given the row adds `AGAIN` times the least that its proof takes.
    """
    where = f"{path}: the row of centre {row['centre']:g} and {row['method']}"
    (n, m), N = plant.shape, len(plant.vertices)
    reading = READING * N * n * (n + m)
    if count is not None:
        count.most += reading * work.cost(0)
    try:
        work.spend(reading, 0)
        region = Disk(row["centre"], row["radius"])
        own, claim = row["proof"], {"kind": Poles.kind, "region": region.document()}
        claim |= {key: own[key] for key in PROOF}
        head = {"format": document.FORMAT, "version": document.VERSION}
        parts = {"plant": file_plant(plant).write(), "law": own["law"], "claims": [claim]}
        certificate = Certificate.of(document.from_plain(head | parts))
        design = Design(certificate)
        if count is not None:
            count.most += AGAIN * certificate.claim().least
        holds = certificate.prove().proved and design.label == row["method"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{where} holds no proof: {error}; remove the file") from error
    if not holds:
        raise InputError(f"{where} is not proved by what it holds; remove the file to start anew")
    found = Limit(region.centre, row["method"], region.radius, "proved", row["seconds"])
    kept = replace(found, lower=row.get("lower"), design=design).as_row(gain)
    mark = {} if kept["lower"] is None else {"lower_from_file": True}
    return kept | mark | {"proof": _proof(design)}


def _sound(row: Row, plant: UncertainPlant) -> bool:
    numbers = (row["centre"], row["radius"], row["seconds"])
    real = all(isinstance(x, float | int) and math.isfinite(x) for x in numbers)
    lower = row.get("lower")
    below = lower is None or (isinstance(lower, float) and 0 < lower <= row["radius"])
    named = LABEL.fullmatch(row["method"]) is not None
    left = row["centre"] < 0 or plant.sample_time is not None
    return real and below and named and left and row["radius"] > 0
