"""Bounds on what goes on between samples, while inputs are held: of signals at all times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

from polefence.proof.between import Held
from polefence.proof.claims.base import Claim
from polefence.proof.claims.samples import Samples
from polefence.proof.claims.signal import SignalClaim, Subject
from polefence.proof.claims.storage import require_storage
from polefence.proof.laws import Piece
from polefence.proof.plant import Output, Plant
from polefence.proof.reading import Table
from polefence.proof.text import milliseconds_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class HeldClaim(SignalClaim):
    """A bound at samples; with ``held``, of which the plant is the samples, at all times."""

    needs_dual: ClassVar[bool] = True  # with what is held: the form of its evidence

    held: Held | None = field(default=None, kw_only=True)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read what is sampled."""
        return {"held": Held.read(table.table("held"))} if "held" in table else {}

    def write_extra(self) -> dict[str, Any]:
        """Return what is sampled."""
        return {} if self.held is None else {"held": self.held.write()}

    def require_extra(self) -> None:
        """Refuse what is sampled where it does not fit."""
        if self.held is None:
            return
        subject, evidence = self.subject, self.subject.evidence
        if subject.law.F:
            raise FormatError(
                "held: at samples a disturbance that passes straight into what is measured has no "
                "bounded value"
            )
        self.held.require(len(subject.A), subject.n, subject.m, subject.q, subject.sizes)
        if not subject.step or self.filters:
            raise FormatError("held: belongs to a sampled plant, and a signal without filters")
        if self.needs_dual and not (evidence.dual or evidence.cells):
            raise FormatError("held: what goes on between samples needs the dual form")

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:
        """Say that the plant is not the samples of what is held between them."""
        held = self.held
        if held is not None and not any(
            isinstance(other, Samples)
            and (other.A, other.B, other.E) == (held.A, held.B, held.E)
            and (other.delay, other.early) == (held.delay, held.early)
            for other in claims
        ):
            return "held: no claim says that the plant is the samples of this one"
        return super().fault_in(plant, claims)

    @property
    def time_text(self) -> str:
        """Between samples too, where it is so."""
        if self.held is None:
            return super().time_text
        step, clock = self.subject.step, self.held.clock
        times = milliseconds_text(step)
        if clock is not None:
            times = f"{clock.text(step)} in any order"
            if self.held.early:
                after = milliseconds_text((1 - self.held.early) * step)
                times += f", changed {after} ms after a sample"
            times += ", and the loop stable"
            return f", at all times, with inputs held for {times}"
        return f", at all times, with inputs held for {times} ms"


@dataclass(frozen=True)
class StoredClaim(HeldClaim):
    """A bound whose evidence at all times is a storage function, of the plant itself."""

    has_storage: ClassVar[bool] = True

    def require_extra(self) -> None:
        """Refuse what is sampled, or a storage function, where it does not fit."""
        super().require_extra()
        require_storage(self.subject, self.held)

    def inside(self, piece: Piece) -> Self:
        """Return the claim about a part of the box."""
        inner, held = super().inside(piece), self.held
        return inner if held is None else replace(inner, held=held.inside(piece.low, piece.high))

    def _require_remainder(self) -> None:
        """Refuse evidence that does not cover a remainder: a storage function needs none."""
        if self.held is None:
            super()._require_remainder()
