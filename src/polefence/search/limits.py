"""Limits of methods: the smallest disk for many centres, as rows; kept in a file, resumed."""

from __future__ import annotations

import json
import math
import re
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from concurrent.futures import Executor
from dataclasses import InitVar, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from polefence.base import VERSION, workers
from polefence.base.errors import InputError, NotProvedError
from polefence.base.explained import explained
from polefence.base.files import read_text, write_text
from polefence.base.progress import stage
from polefence.base.renamed import warn_renamed, with_old_keys, without_old_keys
from polefence.certify.certificate import Certificate
from polefence.certify.checks import (
    require_checkable,
    require_domain,
    require_movable,
    usable_centre,
)
from polefence.certify.design import Design
from polefence.lmi.conditions.methods import (
    METHODS,
    Method,
    Scheduled,
    Slack,
    fitting,
    method_label,
)
from polefence.plant.card import card
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.proof import document, work
from polefence.proof.claims.poles import Poles
from polefence.proof.reading import MAX_BYTES, parse
from polefence.proof.short import Short
from polefence.region.regions import Disk
from polefence.search import by_lmi
from polefence.search.by_lmi import radius_of
from polefence.search.driver import Kind
from polefence.search.rows import Key, Row, Run, RunOptions, plant_summary

# What a row keeps of its design: with the plant, its centre and its radius all that proves it.
PROOF = ("method", "evidence")

# As `method_label` writes them: "slack", "scheduled(2, 1, box)".
LABEL = re.compile(rf"({'|'.join(METHODS)})(\(\d, \d(, box)?\))?")

READING = 80  # operations for each number of the plant, which is read for each row

Task = tuple[int, float, Method]


@dataclass(frozen=True, eq=False)
class Limit(Short):
    """One row of a sweep.

    Attributes
    ----------
    centre : float
        [1/s], negative.
    method : str
        As `method_label` writes it: "slack", or "scheduled(2, 1, box)".
    radius : float or None
        The smallest proved radius [1/s]; None where nothing was proved.
    answer : str
        "proved" or "undecided".
    lower : float or None
        A radius [1/s] proved to be out of the method's reach; None where none was proved.
    unrunnable : float or None
        A smaller radius, proved of a law that doubles cannot evaluate; None where there is none.
    seconds : float
    design : Design or None
        The law of ``radius``; no entry of the row, as `dataclasses.asdict` and pandas see it.
    """

    centre: float
    method: str
    radius: float | None
    answer: str
    seconds: float
    lower: float | None = None
    found: InitVar[Design | None] = None
    unrunnable: float | None = None

    def __post_init__(self, design: Design | None) -> None:
        # no field: rows are plain values, and a design is a plant, a law and a proof
        object.__setattr__(self, "_design", design)

    @property
    def design(self) -> Design | None:
        """The law of ``radius``, with its proof; None where nothing was proved."""
        design: Design | None = vars(self)["_design"]
        return design

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        texts = (
            (key, "" if value is None else f"{value:.6g}")
            for key, value in (("radius", self.radius), ("not below", self.lower))
        )
        return card(self.method, [("centre", f"{self.centre:g}"), ("answer", self.answer), *texts])

    @property
    def runs(self) -> bool:
        """Whether doubles can evaluate the law of ``radius``."""
        return self.design is not None and self.design.runs

    @property
    def proved(self) -> bool:
        """Whether a radius is proved."""
        return self.answer == "proved"

    @property
    def status(self) -> str:
        """The old name of ``answer``."""
        warn_renamed("Limit.status", "Limit.answer")
        return self.answer

    @property
    def words(self) -> str:
        """The row in a few words."""
        return f"centre {self.centre:g} {self.method}: {self.answer}"

    @property
    def ratio(self) -> float | None:
        """Return d / sigma in percent, the ordinate of figures 3 and 4 of the paper."""
        return 100 * (1 + self.radius / self.centre) if self.radius and self.centre < 0 else None

    def as_row(self, gain: bool = False) -> dict[str, Any]:
        """Return the row as plain data, with its law where wanted."""
        row: dict[str, Any] = {
            key: getattr(self, key)
            for key in ("centre", "method", "radius", "lower", "answer", "seconds")
        }
        row |= {"runs": self.runs, "unrunnable": self.unrunnable}
        if gain:
            row["law"] = None if self.design is None else self.design.certificate.document()["law"]
        return row


@explained
def limits(
    plant: UncertainPlant,
    centres: Iterable[float] | float,
    methods: Sequence[Method] | Method = METHODS,
    executor: Executor | None = None,
    on_row: Callable[[Limit], None] | None = None,
    bounds: bool = True,
) -> list[Limit]:
    """Return the smallest proved disk for every centre and method, in that order.

    Parameters
    ----------
    plant : UncertainPlant
    centres : float or iterable of float
        Real coordinates, negative [1/s].
    methods : str or Scheduled, or a sequence of them
    executor : concurrent.futures.Executor, optional
        Where to run; without one, here and one after the other.
    on_row : callable, optional
        Called with each row as it is finished, so that an interrupted sweep loses none.
    bounds : bool
        Whether to prove lower bounds too, which takes longer than all the rest.

    Raises
    ------
    InputError
        If a centre or method is unusable, or a vertex has an unstable pole that no gain moves. A
        row that fails otherwise is "undecided" and never stops the sweep.
    """
    if isinstance(methods, str | Scheduled | Slack):
        methods = (methods,)
    if not isinstance(centres, Iterable):
        centres = (centres,)
    methods = [fitting(plant, method) for method in methods]
    tasks = [(usable_centre(plant, c), m) for c in centres for m in methods]
    rows: dict[int, Limit] = {}
    for index, row in as_finished(plant, tasks, executor, bounds):
        rows[index] = row
        if on_row is not None:
            on_row(row)
    return [rows[index] for index in range(len(tasks))]


def as_finished(
    plant: UncertainPlant,
    tasks: Sequence[tuple[float, Method]],
    executor: Executor | None = None,
    bounds: bool = True,
) -> Iterator[tuple[int, Limit]]:
    """Yield each task's index and row as soon as it is done; see `limits`."""
    for centre, method in tasks:
        usable_centre(plant, centre)
        require_domain(plant, method)
        require_checkable(plant, method)
    plant.require_on_time("with which no disk is kept", "ask design for half_plane(a)")
    require_movable(plant)
    if plant.remainder is not None:
        raise InputError(
            f"{plant.name}: limits of a method are proved of combinations of vertices, and between "
            "these it is another function of the parameters; `polefence tightest` proves a disk"
        )
    work = partial(_row, plant, bounds=bounds)
    yield from workers.as_finished(executor, work, [(k, *task) for k, task in enumerate(tasks)])


def _row(plant: UncertainPlant, task: Task, bounds: bool) -> tuple[int, Limit]:
    number, centre, method = task
    name, start = method_label(method), time.perf_counter()
    with stage(f"centre {centre:g} {name}"):
        try:
            kind = Kind("disk", centre)
            design = by_lmi.tightest(plant, kind, method, bounds=bounds).checkable
        except NotProvedError:
            design = None
    seconds = time.perf_counter() - start
    if design is None:
        return number, Limit(centre, name, None, "undecided", seconds)
    ends = radius_of(design), "proved", seconds, design.lower, design, design.unrunnable
    return number, Limit(centre, name, *ends)


# --- rows kept in a file -------------------------------------------------------------------------


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
        ((limit.centre, limit.method), limit.as_row(gain) | {"proof": _proof(limit.design)}, limit)
        for _, limit in as_finished(plant, tasks, run.executor)
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
    text = json.dumps(with_old_keys(others), indent=1, allow_nan=False)
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
        rows = {(row["centre"], row["method"]): without_old_keys(row) for row in whole["rows"]}
        proved = [row for row in rows.values() if row["answer"] == "proved"]
        sound = all(_sound(row, plant) for row in proved)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: not a sweep to resume; remove it to start anew") from error
    if not sound:
        raise InputError(f"{path}: a row is damaged; remove the file to start anew")
    if digest != plant.digest:
        raise InputError(f"{path}: a sweep of another plant; remove it, or name another file")
    if version != VERSION:
        other = str(version)[:40]
        raise InputError(f"{path}: a sweep by polefence {other}; remove it to start anew")
    kept = {}
    with work.counted() as count:
        for row in proved:
            if row.get("proof") is not None:
                key = row["centre"], row["method"]
                kept[key] = _reproved(path, row, plant, gain, count if key in asked else None)
    return kept


def _reproved(
    path: Path, row: Row, plant: UncertainPlant, gain: bool, count: work.Count | None
) -> Row:
    """Prove a row of a file afresh, and return what of it is proved.

    To a count that is given the row adds what any claim may take.
    """
    where = f"{path}: the row of centre {row['centre']:g} and {row['method']}"
    (n, m), N = plant.shape, len(plant.vertices)
    reading = READING * N * n * (n + m)
    if count is not None:
        count.most += reading * work.cost(0) + work.MAX_WORK
    try:
        work.spend(reading, 0)
        region = Disk(row["centre"], row["radius"])
        proof, claim = row["proof"], {"kind": Poles.kind, "region": region.document()}
        claim |= {key: proof[key] for key in PROOF}
        head = {"format": document.FORMAT, "version": document.VERSION}
        parts = {"plant": file_plant(plant).write(), "law": proof["law"], "claims": [claim]}
        certificate = Certificate.of(document.from_plain(head | parts))
        design = Design(certificate)
        verdict = certificate.prove()
        holds = verdict.proved and design.label == row["method"]
    except KeyError as error:
        raise InputError(f"{where} holds no proof: {error} is missing; remove the file") from error
    except (ValueError, TypeError) as error:
        raise InputError(f"{where} holds no proof: {error}; remove the file") from error
    if not holds:
        why = "" if verdict.proved else f" ({verdict.reason})"
        raise InputError(
            f"{where} is not proved by what it holds{why}; remove the file to start anew"
        )
    limit = Limit(region.centre, row["method"], region.radius, "proved", row["seconds"])
    kept = replace(limit, lower=row.get("lower"), found=design).as_row(gain)
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
