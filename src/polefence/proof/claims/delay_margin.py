"""Delay margins: a loop stays stable if an input is late, by any constant time up to a margin.

Late by t, u becomes exp(-s t) u = (C + delta R) u with C and R of a cover, and a stable delta of
gain at most one: see `proof.covers`. So it is for every shorter time, with the same C and R. The
loop with C in the place of the delay is to be stable, and the gain from what is added there to R u
below one (small gain theorem): that to R u over t below 1 / t, the ``level``.

At samples delays are whole numbers of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.disk_margin import DiskMargin, Loops
from polefence.proof.claims.signal import Subject
from polefence.proof.covers import COVERS, Late, samples
from polefence.proof.filters import Filters
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Plant
from polefence.proof.reading import Table
from polefence.proof.text import digits_down, milliseconds_text
from polefence.proof.work import FormatError


def late_by(level: Fraction, step: Fraction, cover: int = 0) -> Late:
    """Return the states of an input that is late by up to 1 over a level [s]."""
    return COVERS[cover].late(1 / level, step)


@dataclass(frozen=True)
class DelayMargin(DiskMargin):
    """The gain of R / t at an input, in a loop with C, is less than ``level``, 1 / t.

    ``cover`` is the number of the disks.
    """

    kind: ClassVar[str] = "delay margin"

    cover: int = field(default=0, kw_only=True)

    @classmethod
    def of(
        cls,
        subject: Subject,
        loops: Loops,
        level: Fraction,
        filters: Filters = (),  # noqa: ARG003  # they follow from the level
        *,
        invariant: bool = False,
        cover: int = 0,
    ) -> Self:
        """Return the claim, behind the filter of its own level."""
        known = level > 0 and (not subject.step or samples(1 / level, subject.step))
        own = (late_by(level, subject.step, cover).filter(level),) if known else ()
        return replace(super().of(subject, loops, level, own, invariant=invariant), cover=cover)

    @classmethod
    def states_in(cls, table: Table, plant: Plant) -> int:
        """Return how many states the cover in a file has."""
        level = table.number("level")
        if level <= 0:
            raise FormatError(f"{table.path('level')} must be positive")
        if plant.step and not samples(1 / level, plant.step):
            raise FormatError(f"{table.path('level')}: the margin is shorter than a sample")
        return COVERS[cls._cover(table)].states

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read loops, cover, level and evidence."""
        return replace(super().read(table, plant, law, on), cover=cls._cover(table))._own

    @staticmethod
    def _cover(table: Table) -> int:
        return table.whole("cover", 1, len(COVERS), 1) - 1

    def write(self) -> dict[str, Any]:
        """Return what `read` reads: the filter follows from the level."""
        table = super().write()
        table.pop("filters", None)
        return table | ({"cover": self.cover + 1} if self.cover else {})

    @property
    def margin(self) -> Fraction:
        """The longest delay [s]; of samples a whole number of them."""
        step = self.subject.step
        return samples(1 / self.level, step) * step if step else 1 / self.level

    @property
    def series(self) -> Self:
        """The claim about the loop with what acts in the place of the input."""
        if not self.filters:
            return self
        late = late_by(self.level, self.subject.step, self.cover)
        subject = arriving(super().series.subject, self.subject.n, self.loops.inputs[0], late)
        return replace(super().series, subject=subject)

    def require_extra(self) -> None:
        """Refuse another skew, and loops that are not one input."""
        super().require_extra()
        loops = self.loops
        if loops.skew != -1 or len(loops.inputs) != 1 or loops.count > 1:
            raise FormatError("skew must be -1, of one loop at an input: what is late is all of it")
        if loops.leads or self.invariant:
            raise FormatError("invariant: a delay does not vary in time, and one loop has no lead")
        if self.level <= 0 or not self.margin:
            raise FormatError("level must be positive, and the margin a sample or more")
        if not 0 <= self.cover < len(COVERS):
            raise FormatError(f"cover must be 1 to {len(COVERS)}")
        if loops.through and self.cover:
            raise FormatError("cover: that of a law that measures what inputs pass into is 1")

    def require(self) -> None:
        """Refuse another filter than that of its level; then as any other claim."""
        # the loop in series with its filter has none
        if self.filters and self.filters != self._own.filters:
            raise FormatError("filters: a delay margin has that of its level")
        self.require_extra()
        super().require()

    @property
    def _own(self) -> Self:
        loops, invariant = self.loops, self.invariant
        return self.of(self.subject, loops, self.level, invariant=invariant, cover=self.cover)

    def named(self, plant: Plant) -> str:
        """Say of which loop it is."""
        return f"{self.kind} {self.loops_text(plant)}"

    @property
    def worst_text(self) -> str:
        """Say how large the margin is at least, rounded down."""
        return f"at least {digits_down(self.margin)} s"

    def statement(self, plant: Plant) -> str:
        """Say how late the input may be."""
        step = self.subject.step
        on = f", whole samples of {milliseconds_text(step)} ms" if step else ""
        return f"{self.named(plant)} >= {digits_down(self.margin)} s{on}, on the {self.subject.on}"


def arriving(subject: Subject, n: int, i: int, late: Late) -> Subject:
    """Return a loop, whose states from the n-th on are those of a late input, with what acts."""

    def moved(A: Rationals, B: Rationals) -> tuple[Rationals, Rationals]:
        size = len(A)
        rows = [[*a, *b] for a, b in zip(A, B, strict=True)]
        rows = [list(late.put(row, n, size + i)) if k < n else row for k, row in enumerate(rows)]
        return [row[:size] for row in rows], [row[size:] for row in rows]

    pairs = [moved(A, B) for A, B in zip(subject.A, subject.B, strict=True)]
    at = [replace(v, A=A, B=B) for v in subject.nodes for A, B in [moved(v.A, v.B)]]
    size = subject.n

    def changed(M: Sequence[Sequence[Fraction]]) -> tuple[tuple[Fraction, ...], ...]:
        return tuple(late.put(row, n, size + i) for row in M)

    return replace(
        subject,
        A=[A for A, _ in pairs],
        B=[B for _, B in pairs],
        remainder=subject.remainder and subject.remainder.mapped(changed),
        nodes=tuple(at),
    )
