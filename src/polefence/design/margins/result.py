"""Margins as values: one with its claim; all of a design's."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from polefence.base.files import write_documents
from polefence.design.design import Design
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.margins import MarginClaim
from polefence.proof.document import Document
from polefence.region.regions import Region
from polefence.region.text import digits_down, digits_up

SUBJECTS = {
    "estimate": "error of the estimate",
    "gain": "error of the gain",
    "rate": "rate of change",
}


@dataclass(frozen=True, eq=False, repr=False)
class Margin:
    """How much of one thing may go wrong.

    Attributes
    ----------
    kind : str
        "estimate", "gain" or "rate".
    parameter : str
        The parameter meant, the others exact or constant; "" for all at once, and for the gain.
    value : float
        What is proved, in ``unit``; zero where nothing is; infinite for any rate whatever.
    unit : str
    upper : float, optional
        An error at which a pole does leave the region, in exact arithmetic; None where none was
        found. For rates, none is looked for.
    example : str
        Where it does.
    claim : Estimate, GainError or Rate of `polefence.proof.claims`, optional
        What was proved; None where nothing was.
    design : Design, optional
        The one that the claim is of: for a law whose own proof does not serve, the same law, proved
        again.
    """

    kind: str
    parameter: str
    value: float
    unit: str
    upper: float | None = None
    example: str = ""
    claim: MarginClaim | None = None
    design: Design | None = None

    def __repr__(self) -> str:
        return f"<Margin {self}>"

    @property
    def proved(self) -> bool:
        """Whether a value is proved."""
        return self.claim is not None

    @property
    def status(self) -> str:
        """Say "proved" or "undecided"."""
        return "proved" if self.proved else "undecided"

    @property
    def name(self) -> str:
        """A short name, that of the file: "estimate-m1", "gain"."""
        return f"{self.kind}-{self.parameter}" if self.parameter else self.kind

    @property
    def subject(self) -> str:
        """What it is about, for people."""
        what = SUBJECTS[self.kind]
        if self.kind == "gain":
            return what
        return f"{what}, {self.parameter or 'all at once'}"

    def __str__(self) -> str:
        upper = "" if self.upper is None else f", breaks at {digits_up(self.upper, 4)}"
        return f"{self.subject}: {self.text} {self.unit}".rstrip() + upper

    @property
    def text(self) -> str:
        """The value, rounded down so that it stays true as printed."""
        if math.isinf(self.value):
            return "any"
        if isinstance(self.claim, Estimate) and self.parameter:
            return digits_down(max(self.claim.errors), 4)  # exactly: an interval's width, 0.2
        return digits_down(self.value, 4) if self.value > 0 else ("0" if self.proved else "-")


@dataclass(frozen=True, eq=False, repr=False)
class Margins:
    """How much may go wrong while all poles stay in the region; iterates over its margins.

    Attributes
    ----------
    design : Design
    region : Region
        What is kept: the design's own region, or the one asked for.
    decay : float
        What the rates of change leave of exponential stability [1/s].
    margins : tuple of Margin
    """

    design: Design
    region: Region
    decay: float
    margins: tuple[Margin, ...]

    def __repr__(self) -> str:
        return (
            f"<Margins of {self.design.plant.name!r} in {self.region}: {len(self.margins)} margins>"
        )

    def __str__(self) -> str:
        return "\n".join(str(margin) for margin in self.margins)

    def __iter__(self) -> Iterator[Margin]:
        return iter(self.margins)

    def __getitem__(self, name: str) -> Margin:
        """Return the margin of a name, as "estimate-m1"."""
        return next(m for m in self.margins if m.name == name)

    @property
    def proved(self) -> bool:
        """Whether every margin is proved."""
        return all(margin.proved for margin in self.margins)

    def file(self, margin: Margin) -> Document:
        """Return the file of a margin that is proved."""
        design = margin.design or self.design
        return design.certificate.file([margin.claim] if margin.claim else [])

    def save(self, directory: str | Path) -> list[Path]:
        """Write one file for each proved margin into a folder; return their paths.

        Raises
        ------
        OutputError
            If the folder cannot be written; nothing is left half-written.
        """
        documents = {
            f"{margin.name}.json": self.file(margin).dumps()
            for margin in self.margins
            if margin.proved
        }
        return write_documents(Path(directory), documents)
