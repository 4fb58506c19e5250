"""Controllable dampers: inputs that are a rate times a coefficient between two bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.proof.claims.signal import require_shapes
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Plant
from polefence.proof.reading import MAX_SIZE, Table, plain, plain_rows
from polefence.proof.short import Short
from polefence.proof.text import number_text, output_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class SemiActive(Short):
    """An input that is c times a rate, c from ``low`` to ``high`` at any time.

    Attributes
    ----------
    number : int
        Of the input, counted from zero.
    rate : list of matrices
        Of one row, at every vertex: the rate by the state.
    low, high : Fraction
    """

    number: int
    rate: list[Rationals]
    low: Fraction
    high: Fraction

    def rows(self, vertex: int, m: int) -> tuple[list[Fraction], list[Fraction]]:
        """Return u - low v and u - high v by (x, u)."""
        rate, push = self.rate[vertex][0], [Fraction(int(k == self.number)) for k in range(m)]
        first, second = ([*(-c * x for x in rate), *push] for c in (self.low, self.high))
        return first, second

    def require(self, N: int, n: int, m: int) -> None:
        """Refuse what does not fit a plant.

        Raises
        ------
        FormatError
        """
        if type(self.number) is not int or not 0 <= self.number < m:
            raise FormatError(f"damper: input {self.number!r} is not one of 0 to {m - 1}")
        require_shapes(self.rate, N, 1, n, "rate")
        if self.low > self.high:
            raise FormatError("damper: low must not be above high")

    @property
    def numbers(self) -> list[Rationals]:
        """All that it is given by."""
        return [*self.rate, [[self.low, self.high]]]

    def write(self) -> dict[str, Any]:
        """Return it as a file has it."""
        rows = {"input": self.number + 1, "rate": plain_rows(self.rate)}
        return rows | {"low": plain(self.low), "high": plain(self.high)}

    @property
    def bounds_text(self) -> str:
        """Describe the bounds of the damper's force."""
        none = [[[Fraction(0)]]] * len(self.rate)
        low, high = number_text(self.low), number_text(self.high)
        return f"{low} to {high} times ({output_text(self.rate, none)})"

    @property
    def range_text(self) -> str:
        """Say which input it is, and between what."""
        return f"u{self.number + 1} from {self.bounds_text}"


def read_dampers(table: Table, plant: Plant) -> tuple[SemiActive, ...]:
    """Read the dampers of a claim, none where it has no such key."""
    rows = table.tables("dampers", MAX_SIZE) if "dampers" in table else []
    return tuple(
        SemiActive(
            row.whole("input", None, plant.m, 1) - 1,
            row.rows("rate", plant.n, len(plant.A)),
            row.number("low"),
            row.number("high"),
        )
        for row in rows
    )


def dampers_text(dampers: Sequence[SemiActive]) -> str:
    """Say between what their forces are."""
    return ", ".join(damper.range_text for damper in dampers)
