"""Delay margins: a loop stays stable if an input is late, by any constant time up to a margin.

Late by t, u becomes exp(-s t) u = (1 + delta W) u. With x = w t and b^2 >= 12,

    |exp(-j x) - 1|^2 = 2 - 2 cos x <= x^2 / (1 + x^2 / b^2),

so delta is stable and of gain at most one for W = t s / (1 + t s / b), and for every shorter time
with the same W: its size grows with t. The loop is stable if the gain of W T is below one (small
gain theorem), T the complementary sensitivity: if that of W / t T is below 1 / t, the ``level``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.disk_margin import DiskMargin, Loops
from polefence.proof.claims.signal import Subject
from polefence.proof.filters import Filter, Filters
from polefence.proof.plant import Plant
from polefence.proof.reading import Table
from polefence.proof.text import digits_down
from polefence.proof.work import FormatError

CORNER = Fraction(34642, 10000)  # b: its square is 12.0007


def late_by(time: Fraction) -> Filter:
    """Return W / t of a time [s]: s over 1 + t s / b."""
    rate = CORNER / time
    return Filter([[-rate]], [[rate]], [[-rate]], "late", rate)


@dataclass(frozen=True)
class DelayMargin(DiskMargin):
    """The gain of W / t T at an input is less than ``level``, 1 / t."""

    kind: ClassVar[str] = "delay margin"

    @classmethod
    def of(
        cls,
        subject: Subject,
        loops: Loops,
        level: Fraction,
        filters: Filters = (),
        *,
        invariant: bool = False,
    ) -> Self:
        """Return the claim, behind the filter of its own level."""
        own = filters or ((late_by(1 / level),) if level > 0 else ())
        return super().of(subject, loops, level, own, invariant=invariant)

    @classmethod
    def filters_of(cls, table: Table, count: int) -> Filters:
        """Return the filter of a file's level."""
        level = table.number("level")
        if level <= 0 or count != 1:
            raise FormatError(f"{table.path('level')} must be positive, and of one loop")
        return (late_by(1 / level),)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads: the filter follows from the level."""
        table = super().write()
        table.pop("filters", None)
        return table

    def require_extra(self) -> None:
        """Refuse another skew, and loops that are not one input."""
        super().require_extra()
        loops = self.loops
        if loops.skew != -1 or len(loops.inputs) != 1 or loops.count > 1:
            raise FormatError("skew must be -1, of one loop at an input: what is late is all of it")

    def require(self) -> None:
        """Refuse samples and another filter; then as any other claim."""
        if self.subject.step:
            raise FormatError("a delay margin is of loops in continuous time")
        # the loop in series with its filter has none
        if self.filters and (self.level <= 0 or self.filters != (late_by(1 / self.level),)):
            raise FormatError("filters: a delay margin has that of its level")
        super().require()

    def named(self, plant: Plant) -> str:
        """Say of which loop it is."""
        return f"{self.kind} {self.loops_text(plant)}"

    @property
    def worst_text(self) -> str:
        """Say how large the margin is at least, rounded down."""
        return f"at least {digits_down(1 / self.level)} s"

    def statement(self, plant: Plant) -> str:
        """Say how late the input may be."""
        return f"{self.named(plant)} >= {digits_down(1 / self.level)} s, on the {self.subject.on}"
