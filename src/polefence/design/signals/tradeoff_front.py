"""Trade-off curve: one row a limit and method, with the law and all of its proofs."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from polefence.base import VERSION
from polefence.base.errors import InputError
from polefence.base.files import write_documents
from polefence.design.certificate import Certificate
from polefence.design.design import FILE_NAME, Design
from polefence.design.requirements.specification import Specification
from polefence.design.rows import Row, plant_summary
from polefence.lmi.conditions.methods import Method, method_label
from polefence.plant.family import UncertainPlant
from polefence.proof.document import Document, from_plain
from polefence.region.regions import Region

# Of a row whose law is taken over for another limit.
TAKEN = ("status", "proved", "sampled", "law_of", "performance")


@dataclass(frozen=True)
class Asked:
    """What a trade-off is about.

    Attributes
    ----------
    plant : UncertainPlant
        With the states of filters that specifications ask for.
    minimise, over : Specification
        Without limits.
    subject_to : tuple of Specification
    region : Region
    """

    plant: UncertainPlant
    minimise: Specification
    over: Specification
    subject_to: tuple[Specification, ...]
    region: Region

    def document(self) -> dict[str, Any]:
        """Return it as plain data, the plant by its digest."""
        return {
            "minimise": _plain(self.minimise),
            "over": _plain(self.over),
            "subject_to": [_plain(own) for own in self.subject_to],
            "region": self.region.document(),
        }


def _plain(own: Specification) -> dict[str, Any]:
    # through JSON and back, so that it equals what is read from a file
    found: dict[str, Any] = json.loads(json.dumps({"kind": own.kind} | asdict(own), default=repr))
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Front:
    """What is reached at each limit, with its law.

    Attributes
    ----------
    asked : Asked
        Plant, specifications and region.
    rows : tuple of dict
        One a value and method, as plain data: ``value``, the limit; ``method``, its label;
        ``status``, "proved" or "not proved"; ``proved``, the bound on what is minimised, and
        ``sampled``, the same law's worst at sampled parameters; ``bounds``, of ``over`` and the
        other specifications, each with ``specification``, ``at_most``, ``proved``, ``sampled``;
        ``law_of``, the limit that the law was found for: another one's law is taken where it
        keeps this limit, and the search for this one found a worse one, or none; ``own``, what
        that search itself proved; ``performance``, the law with all of its proofs, as a
        performance file has them; ``reason``, where the search found nothing; ``seconds``.
    references : tuple of dict
        Of laws that come with no proof, see `polefence.vehicle.beside_reference_laws`: ``name``,
        the worst at sampled parameters of ``over`` and ``minimise``, and ``keeps``, whether that of
        the other specifications is within their limits.
    """

    asked: Asked
    rows: tuple[Row, ...]
    references: tuple[Row, ...] = ()

    def __repr__(self) -> str:
        done = sum(row["status"] == "proved" for row in self.rows)
        return f"<Front of {self.asked.plant.name!r}: {done} of {len(self.rows)} rows proved>"

    @property
    def proved(self) -> bool:
        """Whether every row is."""
        return all(row["status"] == "proved" for row in self.rows)

    @property
    def methods(self) -> tuple[str, ...]:
        """Labels, in the order asked for."""
        return tuple(dict.fromkeys(row["method"] for row in self.rows))

    @property
    def labels(self) -> tuple[str, str]:
        """What is limited and what is minimised, with units, as axes have them."""
        over, least = (
            label_of(self.asked.plant, s) for s in (self.asked.over, self.asked.minimise)
        )
        return over, least

    def row(self, value: float, method: Method | str) -> Row:
        """Return the row of a limit and a method, or its label.

        Raises
        ------
        InputError
            If there is none.
        """
        label = method if method in self.methods else method_label(method)
        for row in self.rows:
            if row["value"] == value and row["method"] == label:
                return row
        raise InputError(f"no row of {label} at {value:g}")

    def design(self, value: float, method: Method | str) -> Design:
        """Return the law of a row with the proof of its region.

        Raises
        ------
        InputError
            If there is no such row, or it is not proved.
        """
        return Design(Certificate.of(self.file(value, method)))

    def save(self, value: float, method: Method | str, directory: str | Path) -> Path:
        """Write a row's ``design.json``, with its bounds, into a folder; return its path.

        Raises
        ------
        InputError
            If there is no such row, or it is not proved.
        OutputError
            If the folder cannot be written.
        """
        return write_documents(Path(directory), {FILE_NAME: self.file(value, method).dumps()})[0]

    def file(self, value: float, method: Method | str) -> Document:
        """Return the file of a row: the law, its region and its bounds.

        Raises
        ------
        InputError
            If there is no such row, or it is not proved.
        """
        row = self.row(value, method)
        if row["performance"] is None:
            raise InputError(f"nothing is proved at {value:g}: {row['reason']}")
        return from_plain(row["performance"])

    def document(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return head(self.asked) | {"references": list(self.references), "rows": list(self.rows)}


def monotone(rows: dict[tuple[float, str], Row]) -> dict[tuple[float, str], Row]:
    """Return rows by value and method, each with the best law of its method that keeps its limit.

    What a law keeps is proved, so that a law of any other limit will do; those of tighter ones
    always keep a looser one.
    """
    eased = dict(rows)
    for (value, label), row in rows.items():
        laws = [
            r
            for (_, other), r in rows.items()
            if other == label and r["proved"] is not None and r["bounds"][0]["proved"] <= value
        ]
        best = min(laws, key=lambda r: float(r["proved"]), default=row)
        if best["proved"] is not None and best["proved"] < (row["proved"] or math.inf):
            first, *others = best["bounds"]
            taken = {key: best[key] for key in TAKEN}
            eased[value, label] = row | taken | {"bounds": [first | {"at_most": value}, *others]}
    return eased


def head(asked: Asked) -> dict[str, Any]:
    """Return what stands above the rows."""
    return {
        "polefence": VERSION,
        "plant": plant_summary(asked.plant),
        "question": asked.document(),
    }


def label_of(plant: UncertainPlant, own: Specification) -> str:
    """Return kind, signal and unit of a specification."""
    unit = own.unit(plant)
    return f"{own.kind} of {own.name}" + (f" [{unit}]" if unit else "")
