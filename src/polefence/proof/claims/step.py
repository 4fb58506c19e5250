"""Step responses: what a constant disturbance makes of a signal, from rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from polefence.proof.claims.measured import MeasuredResponse
from polefence.proof.matrices import ONE
from polefence.proof.polynomials import Polynomial, constant


@dataclass(frozen=True)
class StepResponse(MeasuredResponse):
    """A measure of y after a step of the disturbances, each of its scale, is at most ``level``."""

    kind: ClassVar[str] = "step"
    measures: ClassVar[tuple[str, ...]] = (
        "peak",
        "overshoot",
        "undershoot",
        "settling",
        "rise",
        "final",
        "envelope",
    )
    has_final: ClassVar[bool] = True
    after: ClassVar[str] = "after a step"

    @property
    def _every(self) -> Polynomial:
        """A column of ones: all disturbances at once."""
        return constant([[ONE]] * self.subject.q, self.subject.sizes)

    @property
    def driving(self) -> Polynomial:
        """The disturbances, as they act."""
        return self.subject.driving(self.scales, self.subject.sizes) * self._every

    @property
    def passing(self) -> Polynomial | None:
        """What the disturbances add to the output."""
        passing = self.subject.through(self.outputs, self.scales)
        return None if passing is None else passing * self._every
