"""A table of structures of laws: the least bound of each order, degree and set of sensors, proved.

A richer structure has all laws of a poorer one: a law of fewer states has states more there that
are not used, one of a lower degree terms of zero, one of fewer signals gains of zero. So each row's
search begins at the laws of the rows below it, and where it ends at a worse law, theirs is the
answer: no row is worse than one below it.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import InputError, PolefenceError, require_type
from polefence.base.explained import explained
from polefence.base.files import make_folder, read_text, write_documents, write_text
from polefence.base.progress import stage
from polefence.certify.bounds import bounds_file
from polefence.certify.certificate import Certificate
from polefence.certify.checks import in_time_of, require_moderate, require_movable, stable_region
from polefence.certify.design import FILE_NAME as DESIGN
from polefence.certify.design import Design
from polefence.certify.refutation import Refutation
from polefence.law.laws import Law
from polefence.law.structure import MOST_STRUCTURES, Structure
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.proof import reading, work
from polefence.proof.claims.decay import Decay
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.document import Document, from_plain
from polefence.proof.short import Short
from polefence.proof.text import plural
from polefence.region.regions import Region
from polefence.requirements.named import by_name
from polefence.requirements.specification import Specification
from polefence.search.optimise import (
    Chain,
    Optimised,
    limit_of_any_law,
    optimise_in,
    structured,
)
from polefence.search.rows import Key, Row, Run, plant_summary
from polefence.search.task import Task
from polefence.search.tradeoff import SAMPLES, label_of, of_plant, proves, worst_of

MOST_TOLD = 4  # rows that are said to be better than the one that is recommended
ENOUGH = 0.01  # above the best bound, as a share of it: a simpler law is recommended
FILE_NAME = "structures.json"


@explained
def structures(
    plant: UncertainPlant,
    minimise: Specification,
    subject_to: Sequence[Specification] = (),
    region: Region | None = None,
    structure: Structure | None = None,
    *,
    orders: Sequence[int] | None = None,
    degrees: Sequence[int] | None = None,
    measured: Sequence[Sequence[str] | None] | None = None,
    path: Path | None = None,
    resume: bool = False,
    on_row: Callable[[Row], None] | None = None,
) -> Structures:
    """Return the least proved bound on one signal for each structure of the law.

    Parameters
    ----------
    plant, minimise, subject_to, region
        As `optimise` takes them.
    structure : Structure, optional
        What all laws have; all states by default.
    orders, degrees : sequence of int, optional
        In place of the structure's.
    measured : sequence of sequences of str, optional
        Sets of signals, each in place of the structure's; None: all states.
    path : Path, optional
        A JSON file that is kept up to date after every row.
    resume : bool
        Keep the proved rows that are in the file already.
    on_row : callable, optional
        Called with each row as it is finished.

    Returns
    -------
    Structures
        A row for each order, degree and set of signals; one that has no law says why, and stops
        nothing.

    Raises
    ------
    InputError
        If there are too many, one does not fit the plant, or the file is of something else.
    """
    asked = asked_of(
        plant,
        minimise,
        subject_to,
        region,
        structure,
        orders=orders,
        degrees=degrees,
        measured=measured,
    )
    run = Run(path=path, resume=resume, on_row=on_row)
    order = [asked.key(k) for k in range(len(asked.structures))]
    done = finished(path, asked) if resume and path is not None else {}
    chains = dict[Structure, Chain]()

    def fresh() -> Iterator[tuple[Key, Row, Row]]:
        for k, one in enumerate(asked.structures):
            if asked.key(k) not in done:
                alike = replace(one, order=0)
                orders = [s.order for s in asked.structures if replace(s, order=0) == alike]
                chain = chains.setdefault(alike, Chain(orders))
                chain.below = asked.below(k, done)
                row = asked.least(_row_of(asked, k, chain), done)
                yield asked.key(k), row, row

    run.complete(done, order, fresh(), lambda path, rows: write_rows(path, asked, rows))
    return Structures(asked, tuple(done[key] for key in order))


def asked_of(
    plant: UncertainPlant,
    minimise: Specification,
    subject_to: Sequence[Specification] = (),
    region: Region | None = None,
    structure: Structure | None = None,
    *,
    orders: Sequence[int] | None = None,
    degrees: Sequence[int] | None = None,
    measured: Sequence[Sequence[str] | None] | None = None,
) -> AskedStructures:
    """Return the question of `structures`, which fits the plant.

    Raises
    ------
    InputError
        If it does not.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_moderate(plant)
    require_type(minimise, Specification, "minimise", "for example Rms('force')")
    for limit in subject_to:
        require_type(limit, Specification, "subject_to", "for example Rms('force', at_most=700)")
    plant, asked_for = by_name(plant, (replace(minimise, at_most=None), *subject_to))
    region = stable_region(plant) if region is None else in_time_of(plant, region)
    structure = Structure() if structure is None else structure
    every = _structures(structure, orders, degrees, measured)
    asked = AskedStructures(plant, asked_for[0], asked_for[1:], region, every)
    for one in (minimise, *subject_to):
        one.require_fit(plant)
    require_movable(plant, region)
    for richer in every:
        richer.require_fit(plant)
    return asked


def _structures(
    structure: Structure,
    orders: Sequence[int] | None,
    degrees: Sequence[int] | None,
    measured: Sequence[Sequence[str] | None] | None,
) -> tuple[Structure, ...]:
    """Return all of them, from the fewest signals, the lowest degree and order on.

    Raises
    ------
    InputError
        If there are too many.
    """
    signals = [structure.measured]
    if measured is not None:
        signals = [None if names is None else tuple(names) for names in measured]
    size = math.prod(len(x) for x in (signals, degrees or (0,), orders or (0,)))
    if not 1 <= size <= MOST_STRUCTURES:
        raise InputError(
            f"{size} structures: 1 to {MOST_STRUCTURES} can be asked for; name fewer orders, "
            "degrees or sets of signals"
        )
    if len(set(degrees or ())) > 1 and structure.schedule == ():
        raise InputError(
            "schedule is empty: a law of one gain has no degree; give one degree, or a schedule"
        )
    fewest = sorted(dict.fromkeys(signals), key=lambda names: math.inf if names is None else 0)
    fewest.sort(key=lambda names: math.inf if names is None else len(names))
    rows = product(
        fewest,
        sorted(set(degrees)) if degrees else [structure.degree],
        sorted(set(orders)) if orders else [structure.order],
    )
    return tuple(replace(structure, measured=m, degree=d, order=k) for m, d, k in rows)


@dataclass(frozen=True, eq=False)
class AskedStructures(Short):
    """Question of a table of structures.

    Attributes
    ----------
    plant : UncertainPlant
        Without states of a law.
    minimise : Specification
        Without a limit.
    subject_to : tuple of Specification
    region : Region
    structures : tuple of Structure
        One a row, poorer ones first.
    """

    plant: UncertainPlant
    minimise: Specification
    subject_to: tuple[Specification, ...]
    region: Region
    structures: tuple[Structure, ...]

    def key(self, k: int) -> Key:
        """Return the key of a row, counted from zero."""
        return float(k + 1), self.words(k)

    def words(self, k: int) -> str:
        """Return what is told of a structure: its order, its degree, its signals."""
        one = self.structures[k]
        signals = "all states" if one.measured is None else ", ".join(one.measured)
        return f"order {one.order}, degree {one.degree}, {signals}"

    def folder(self, k: int) -> str:
        """Return the name of a row's folder."""
        one, sets = self.structures[k], list(dict.fromkeys(s.measured for s in self.structures))
        name = f"order-{one.order}-degree-{one.degree}"
        return name + (f"-sensors-{sets.index(one.measured) + 1}" if len(sets) > 1 else "")

    def head(self, k: int) -> Row:
        """Return what a row says of its structure."""
        one = self.structures[k]
        signals = None if one.measured is None else list(one.measured)
        return {"row": k + 1, "order": one.order, "degree": one.degree, "measured": signals}

    def every_poorer(self, k: int) -> list[int]:
        """Return the rows whose laws are laws of one."""
        return [j for j in range(k) if _is_within(self.structures[j], self.structures[k])]

    def poorer(self, k: int) -> list[int]:
        """Return the nearest of these."""
        below = self.every_poorer(k)
        return [
            j
            for j in below
            if not any(i != j and _is_within(self.structures[j], self.structures[i]) for i in below)
        ]

    def below(self, k: int, done: dict[Key, Row]) -> tuple[tuple[Structure, Law], ...]:
        """Return the laws of poorer rows, each with the structure that it was found for."""
        laws = dict[int, Law]()
        for row in (done[self.key(j)] for j in self.poorer(k)):
            if row["performance"] is not None:
                number = row["law_of"] - 1
                laws[number] = of_plant(
                    Certificate.of(from_plain(row["performance"])), self.problem(number)[0].plant
                ).law
        return tuple((self.structures[j], law) for j, law in laws.items())

    def least(self, row: Row, done: dict[Key, Row]) -> Row:
        """Return a row with the best law of its own and those of poorer rows."""
        best = row
        for other in (done[self.key(j)] for j in self.poorer(row["row"] - 1)):
            better = other["level"] is not None
            if better and (best["level"] is None or other["level"] < best["level"]):
                best = other
        if best is row:
            return row
        own = ("row", "order", "degree", "measured", "own", "reason", "seconds")
        return best | {key: row[key] for key in own}

    def problem(self, k: int) -> tuple[Task, Structure]:
        """Return the task of the plant with the states of a row's law, and that of the gain."""
        task = Task(self.plant, self.minimise, self.subject_to, self.region, "quadratic")
        return structured(task, self.structures[k])

    def document(self) -> dict[str, Any]:
        """Return it as plain data, the plant by its digest."""

        def plain(specification: Specification) -> dict[str, Any]:
            return {"kind": specification.kind} | asdict(specification)

        document = {
            "minimise": plain(self.minimise),
            "subject_to": [plain(limit) for limit in self.subject_to],
            "region": self.region.document(),
            "structures": [asdict(one) for one in self.structures],
        }
        # through JSON and back, so that it equals what is read from a file
        read: dict[str, Any] = json.loads(json.dumps(document, default=reading.plain))
        return read


def _is_within(poorer: Structure, richer: Structure) -> bool:
    """Whether every law of a structure is one of another, of a table."""
    signals = richer.measured is None or (
        poorer.measured is not None and set(poorer.measured) <= set(richer.measured)
    )
    if poorer.measured != richer.measured and (
        poorer.pattern is not None or richer.pattern is not None
    ):
        signals = False
    return signals and poorer.degree <= richer.degree and poorer.order <= richer.order


def _row_of(asked: AskedStructures, k: int, chain: Chain) -> Row:
    """Return one row; whatever fails in it is its reason."""
    one, start = asked.structures[k], time.perf_counter()
    answer: Row
    try:
        with stage(asked.words(k)):
            question = asked.plant, asked.minimise, asked.subject_to, asked.region
            done = optimise_in(chain, *question, one)
            answer = _proved(asked, k, done)
    except PolefenceError as error:  # one row's failure is not the table's
        reason = " ".join(str(error).split()).removeprefix("not proved: ")
        nothing = dict.fromkeys(("proved", "level", "sampled", "numbers", "law_of", "own"))
        answer = {"answer": "undecided", **nothing, "bounds": [], "performance": None}
        answer |= {"reason": reason}
    return asked.head(k) | answer | {"seconds": time.perf_counter() - start}


def _proved(asked: AskedStructures, k: int, done: Optimised) -> Row:
    certificate, claims = done.design.certificate, done.claims
    certificate.require_checkable(claims)
    return proved_row(asked, k, certificate, claims)


def proved_row(
    asked: AskedStructures, k: int, certificate: Certificate, claims: Sequence[BoundClaim]
) -> Row:
    """Return what a row says of a law: what is proved, and its worst at sampled parameters."""
    (task, _), law = asked.problem(k), certificate.law
    alpha = seeded(task.plant, SAMPLES)
    wanted = [*([task.minimise] if task.minimise else ()), *task.limits]
    levels = [float(claim.level) for claim in claims if not isinstance(claim, Decay)]
    worst = [worst_of(task.plant, law, one, alpha) for one in wanted]
    told = [
        (one.read_as(level), None if seen is None else one.read_as(seen))
        for one, level, seen in zip(wanted, levels, worst, strict=True)
    ]
    return {
        "answer": "proved",
        "proved": told[0][0],
        "level": levels[0],
        "sampled": told[0][1],
        "numbers": numbers_of(law),
        "law_of": k + 1,
        "own": told[0][0],
        "bounds": [
            {
                "specification": one.title,
                "at_most": one.limit,
                "proved": proved,
                "sampled": seen,
            }
            for one, (proved, seen) in zip(wanted[1:], told[1:], strict=True)
        ],
        "performance": bounds_file(certificate, claims).write(),
        "reason": None,
    }


def numbers_of(law: Law) -> int:
    """Return how many numbers of a law are not zero: what its code multiplies by in each sample."""
    return int(np.count_nonzero(np.asarray(law.gains if law.K is None else law.K)))


@dataclass(frozen=True, eq=False, repr=False)
class Structures(Short):
    """What laws of each structure have, and the laws.

    Attributes
    ----------
    asked : AskedStructures
        Plant, specifications, region and structures.
    rows : tuple of dict
        One a structure, poorer ones first, as plain data: ``row``, counted from one; ``order``,
        ``degree`` and ``measured``; ``answer``, "proved" or "undecided"; ``proved``, the bound on
        what is minimised, and ``sampled``, the same law's worst at sampled parameters; ``numbers``,
        how many of the law's are not zero; ``law_of``, the row whose law it is: that of a poorer
        one where the search for this one found none that is better, and what it found itself as
        ``own``; ``bounds``, of the limits; ``performance``, the law with all of its proofs;
        ``level``, the bound in the unit of its proof; ``reason``, where the search found nothing;
        ``seconds``.
    """

    asked: AskedStructures
    rows: tuple[Row, ...]

    def __repr__(self) -> str:
        done = sum(row["answer"] == "proved" for row in self.rows)
        return f"<Structures of {self.asked.plant.name!r}: {done} of {len(self.rows)} rows proved>"

    @property
    def proved(self) -> bool:
        """Whether every row is."""
        return all(row["answer"] == "proved" for row in self.rows)

    @property
    def label(self) -> str:
        """What is minimised, with its unit."""
        return label_of(self.asked.plant, self.asked.minimise)

    @property
    def best(self) -> Row | None:
        """The row of the least bound, None where none is proved."""
        known = [row for row in self.rows if row["level"] is not None]
        return min(known, key=lambda row: float(row["level"]), default=None)

    @cached_property
    def limit_of_any_law(self) -> Refutation | None:
        """What no law goes below, as `Optimised` has it."""
        best, asked = self.best, self.asked
        signals = (one.outputs(asked.plant) for one in asked.structures)
        if best is None:
            return None
        if asked.minimise.limits_rms and any(signal.F for every in signals for signal in every):
            return None  # a law may cancel white noise as it comes
        return limit_of_any_law(asked.plant, asked.minimise, asked.subject_to, best["level"])

    @property
    def recommended(self) -> Row | None:
        """The row of the fewest numbers, and the lowest order, within 1 % of the best bound."""
        best = self.best
        if best is None:
            return None
        most = best["level"] + ENOUGH * abs(best["level"])
        near = [row for row in self.rows if row["level"] is not None and row["level"] <= most]
        return min(near, key=lambda row: (row["numbers"], row["order"], row["row"]))

    @property
    def reason(self) -> str:
        """Why that row is recommended, in a sentence; empty where none is."""
        best, chosen = self.best, self.recommended
        if best is None or chosen is None:
            return ""
        richer = [row for row in self.rows if row["row"] > chosen["row"] and row["level"]]
        text = f"{self.words(chosen)}: "
        if chosen is best or chosen["level"] == best["level"]:
            others = "no other row is better" if len(self.rows) > 1 else "the only row"
            return text + f"the best, of {plural(chosen['numbers'], 'number')}; {others}"
        told = [row for row in richer if row["level"] < chosen["level"]]
        if len(told) > MOST_TOLD or best not in told:
            told = [best]
        gains = (
            f"{self.words(row)} is {100 * (1 - row['level'] / chosen['level']):.2g} % better, "
            f"of {row['numbers']}"
            for row in told
        )
        few = f"the fewest within {100 * ENOUGH:g} % of the best"
        return text + "; ".join([f"of {plural(chosen['numbers'], 'number')}, {few}", *gains])

    def words(self, row: Row) -> str:
        """Return what tells a row from the others."""
        every = self.asked.structures
        parts = []
        if len({one.order for one in every}) > 1:
            parts.append(f"order {row['order']}")
        if len({one.degree for one in every}) > 1:
            parts.append(f"degree {row['degree']}")
        if len({one.measured for one in every}) > 1:
            parts.append("all states" if row["measured"] is None else ", ".join(row["measured"]))
        return ", ".join(parts) or f"order {row['order']}"

    def row(
        self, order: int, degree: int | None = None, measured: Sequence[str] | None = None
    ) -> Row:
        """Return the first row of an order, and of a degree and signals where they are given.

        Raises
        ------
        InputError
            If there is none.
        """
        for row in self.rows:
            if row["order"] != order or (degree is not None and row["degree"] != degree):
                continue
            if measured is None or row["measured"] == list(measured):
                return row
        raise InputError(f"no row of order {order}")

    def file(self, row: Row) -> Document:
        """Return the file of a row: the law, its region and its bounds.

        Raises
        ------
        InputError
            If it is not proved.
        """
        if row["performance"] is None:
            raise InputError(f"nothing is proved of {self.words(row)}: {row['reason']}")
        return from_plain(row["performance"])

    def design(self, row: Row | None = None) -> Design:
        """Return the law of a row, that which is recommended by default, with its proofs.

        Raises
        ------
        InputError
            If it is not proved.
        """
        row = self.recommended if row is None else row
        if row is None:
            raise InputError(f"{self.asked.plant.name}: no row is proved")
        file = self.file(row)
        return Design(Certificate.of(file), more=file.claims[1:])

    def save(self, directory: str | Path) -> list[Path]:
        """Write ``design.json``, the recommended law, and ``structures.json`` into a folder.

        Each row's law has a folder of its own there. What no law goes below is in ``limit.json``.

        Raises
        ------
        OutputError
            If the folder cannot be written.
        """
        directory, chosen = Path(directory), self.recommended
        written = [path for row in self.rows if (path := save_row(self.asked, row, directory))]
        write_text(make_folder(directory) / FILE_NAME, _text(self.document()))
        if chosen is not None:
            text = self.file(chosen).dumps()
            written = [*write_documents(directory, {DESIGN: text}), *written]
        if self.limit_of_any_law is not None:
            written.append(self.limit_of_any_law.save(directory))
        return [*written, directory / FILE_NAME]

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the rows as plain values, for `pandas.DataFrame`: without laws and proofs."""
        return [
            {key: row[key] for key in row if key not in ("performance", "bounds")}
            | {
                f"{key} {bound['specification']}": bound[key]
                for bound in row["bounds"]
                for key in ("at_most", "proved", "sampled")
            }
            for row in self.rows
        ]

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        rows = [
            (self.words(row), "-" if row["proved"] is None else f"<= {row['proved']:.6g}")
            for row in self.rows
        ]
        return card(f"{self.label} of each structure", rows)

    def document(self) -> dict[str, Any]:
        """Return everything as plain data."""
        chosen = self.recommended
        return head(self.asked) | {
            "rows": list(self.rows),
            "recommended": None if chosen is None else chosen["row"],
            "why": self.reason,
        }


def head(asked: AskedStructures) -> dict[str, Any]:
    """Return what stands above the rows."""
    return {
        "polefence": VERSION,
        "plant": plant_summary(asked.plant),
        "question": asked.document(),
    }


def save_row(asked: AskedStructures, row: Row, directory: Path) -> Path | None:
    """Write the law of a row into its folder; return its path, None where none is proved."""
    if row["performance"] is None:
        return None
    folder = directory / asked.folder(row["row"] - 1)
    return write_documents(folder, {DESIGN: from_plain(row["performance"]).dumps()})[0]


def _text(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def write_rows(path: Path, asked: AskedStructures, rows: Sequence[Row]) -> None:
    """Write a table, whole or not at all."""
    make_folder(path.parent)
    document = head(asked) | {"rows": list(rows)}
    write_text(path, _text(document))


def finished(path: Path, asked: AskedStructures) -> dict[Key, Row]:
    """Return the proved rows of an earlier run, all proved afresh.

    Raises
    ------
    InputError
        If the file is unreadable, damaged, of another question, or by another version.
    """
    if not path.exists():
        return {}
    again = "remove the file to start anew, or name another folder"
    try:
        document = reading.parse(read_text(path, reading.MAX_BYTES, InputError))
        same = {key: document[key] for key in ("polefence", "plant", "question")} == head(asked)
        rows = list(document["rows"]) if same else []
        kept = dict[Key, Row]()
        with work.counted(work.MAX_FILE * (1 + min(len(rows), MOST_STRUCTURES))):
            for row in (row for row in rows if row["answer"] == "proved"):
                k = row["row"] - 1
                if type(k) is not int or not 0 <= k < len(asked.structures):
                    raise ValueError("a row that nobody asked for")
                kept[asked.key(k)] = _reproved(row, asked, k)
    except (ValueError, KeyError, TypeError, OverflowError, InputError) as error:
        raise InputError(f"{path}: no table of structures to resume; {again}") from error
    if not same:
        raise InputError(f"{path}: a table of another question or version; {again}")
    return kept


def _reproved(row: Row, asked: AskedStructures, k: int) -> Row:
    """Return what is proved of a row, its law sampled again.

    Raises
    ------
    ValueError
        If it is not what the row says.
    """
    number = row["law_of"] - 1
    if type(number) is not int or number not in (*asked.every_poorer(k), k):
        raise ValueError("the law of another structure")
    task, gain = asked.problem(number)
    document = from_plain(row["performance"])
    claims = [claim for claim in document.claims if isinstance(claim, BoundClaim)]
    bounds = [claim for claim in claims if not isinstance(claim, Decay)]
    certificate = of_plant(Certificate.of(document), task.plant)
    wanted = [*([task.minimise] if task.minimise else ()), *task.limits]
    told = [row["proved"], *(bound["proved"] for bound in row["bounds"])]
    levels = [None, *(limit.at_most for limit in asked.subject_to)]
    pairs = list(zip(wanted, told, levels, strict=True))
    if not _is_of(certificate.law, task.plant, gain) or not proves(
        task.plant, asked.region, certificate, bounds, pairs
    ):
        raise ValueError("a row is damaged")
    certificate.require_checkable(claims)  # with the decay of a clock that is not perfect
    seen = {key: row[key] for key in ("own", "seconds")}
    if not all(value is None or math.isfinite(value) for value in seen.values()):
        raise ValueError("a row is damaged")
    return asked.head(k) | proved_row(asked, number, certificate, claims) | seen


def _is_of(law: Law, plant: UncertainPlant, gain: Structure) -> bool:
    """Whether a law measures no more than a structure has, at the vertices."""
    C, every = gain.rows(plant), np.eye(len(plant.vertices))
    wide = np.broadcast_to(C, (len(every), *C.shape[1:]))
    for K, rows in zip(np.asarray(law.gain(every)), wide, strict=True):
        size = np.abs(K).max(axis=0)
        unit = np.where(size > 0, size, 1.0)
        rest = np.linalg.lstsq((rows / unit).T, (K / unit).T, rcond=None)[0]
        if np.abs((rows / unit).T @ rest - (K / unit).T).max() > 1e-6:
            return False
    return True
