"""What a plant was fitted to, and how far it is from that: no proof reads it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

from polefence.proof.reading import Table
from polefence.proof.short import Short
from polefence.proof.text import digits_up, plural
from polefence.proof.work import FormatError

MOST_FILES = 1000
MOST_SAMPLES = 10**12
MOST_OUTPUTS = 1000
TIME: Literal["time"] = "time"
FREQUENCY: Literal["frequency"] = "frequency"


@dataclass(frozen=True)
class Misfit(Short):
    """How far a plant is from what was measured, as shares of that.

    Attributes
    ----------
    rms : float
        Of the difference.
    largest : float
        Difference.
    """

    rms: float
    largest: float

    @property
    def text(self) -> str:
        """It in words, rounded up."""
        return f"{percent(self.rms)} rms, {percent(self.largest)} at most"

    @classmethod
    def read(cls, table: Table) -> Misfit:
        """Read it.

        Raises
        ------
        FormatError
        """
        values = {key: float(table.number(key)) for key in ("rms", "largest")}
        for key, value in values.items():
            if value < 0:
                raise FormatError(f"{table.path(key)} must not be negative")
        return cls(**values)

    def write(self) -> dict[str, float]:
        """Return what `read` reads."""
        return {"rms": self.rms, "largest": self.largest}


@dataclass(frozen=True)
class Data(Short):
    """Measurements to which a plant was fitted, and what it misses them by.

    Attributes
    ----------
    kind : str
        "time" or "frequency": responses in time, or frequency responses.
    files : tuple of str
        Names of the measurements.
    samples : int
        How many instants or frequencies they have together.
    all : Misfit
        Of all measurements and outputs.
    outputs : tuple of (str, Misfit)
        Of each output, by its name.
    place : str
        Where the largest difference is.
    left_out : Misfit, optional
        Of measurements that were each left out of the fit in turn.
    """

    kind: Literal["time", "frequency"]
    files: tuple[str, ...]
    samples: int
    all: Misfit
    outputs: tuple[tuple[str, Misfit], ...]
    place: str = ""
    left_out: Misfit | None = None

    @property
    def note(self) -> str:
        """What is not proved, in a line."""
        what = "frequency response" if self.kind == FREQUENCY else "response"
        where = f" ({self.place})" if self.place else ""
        beyond = "" if self.left_out is None else f"; one left out of the fit, {self.left_out.text}"
        return (
            "unproved, from data: that the plant is in the family, which misses "
            f"{plural(len(self.files), f'measured {what}')} by {self.all.text}{where}{beyond}"
        )

    @classmethod
    def read(cls, table: Table) -> Data:
        """Read it.

        Raises
        ------
        FormatError
        """
        below = table.table("outputs")
        if not 1 <= len(below.entries) <= MOST_OUTPUTS:
            raise FormatError(f"{below.where} must name 1 to {MOST_OUTPUTS} outputs")
        files = table.texts("files")
        if not 1 <= len(files) <= MOST_FILES:
            raise FormatError(f"{table.path('files')} must name 1 to {MOST_FILES} measurements")
        return cls(
            FREQUENCY if table.word("kind", (TIME, FREQUENCY)) == FREQUENCY else TIME,
            files,
            table.whole("samples", None, MOST_SAMPLES, 1),
            Misfit.read(table.table("all")),
            tuple((name, Misfit.read(below.table(name))) for name in below.entries),
            table.text("place", ""),
            Misfit.read(table.table("left_out")) if "left_out" in table else None,
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind, "files": list(self.files)}
        table |= {"samples": self.samples, "all": self.all.write()}
        table |= {"place": self.place} if self.place else {}
        table |= {} if self.left_out is None else {"left_out": self.left_out.write()}
        return table | {"outputs": {name: own.write() for name, own in self.outputs}}


def percent(share: float) -> str:
    """Return a share in per cent, rounded up."""
    return f"{float(digits_up(100 * Fraction(repr(share)), 2)):g} %"
