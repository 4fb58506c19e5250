"""Free motions: what a signal does from an initial state, or after an impulse, until it is zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.measured import MeasuredResponse
from polefence.proof.claims.signal import Subject
from polefence.proof.matrices import ONE
from polefence.proof.plant import Output, Plant
from polefence.proof.polynomials import Polynomial, constant
from polefence.proof.reading import Table, plain
from polefence.proof.text import points_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class InitialResponse(MeasuredResponse):
    """A measure of y from the state ``start``, without disturbances, is at most ``level``."""

    kind: ClassVar[str] = "initial"
    driven: ClassVar[bool] = False
    direct: ClassVar[bool] = False

    start: tuple[Fraction, ...] = field(default=(), kw_only=True)

    @classmethod
    def read_extra(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read the state, too."""
        own = super().read_extra(table, subject, outputs)
        return own | {"start": table.numbers("start", subject.n)}

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        return {"start": plain(self.start)} | super().write_extra()

    def require_extra(self) -> None:
        """Refuse a state of another plant, too."""
        super().require_extra()
        if len(self.start) != self.subject.n:
            raise FormatError(f"start must hold {self.subject.n} numbers")

    @property
    def acting(self) -> Sequence[int]:
        """No disturbance."""
        return ()

    @property
    def begun(self) -> Polynomial:
        """The state."""
        return constant([[x] for x in self.start], self.subject.sizes)

    @property
    def after(self) -> str:
        """The state, in numbers."""
        return f"from {points_text([self.start])}"

    def acting_words(self, plant: Plant) -> str:  # noqa: ARG002
        """None."""
        return ""


@dataclass(frozen=True)
class ImpulseResponse(MeasuredResponse):
    """A measure of y after impulses of the disturbances, each of its scale, from rest."""

    kind: ClassVar[str] = "impulse"
    direct: ClassVar[bool] = False
    after: ClassVar[str] = "after an impulse"

    @property
    def begun(self) -> Polynomial:
        """What all impulses at once leave."""
        every = constant([[ONE]] * self.subject.q, self.subject.sizes)
        return self.subject.driving(self.scales, self.subject.sizes) * every
