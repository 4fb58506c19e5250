"""Delay margins: how late an input may be, by a constant time, before the loop is unstable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.delay_margin import late_by
from polefence.requirements.disk_margin import DiskMargin, place_of
from polefence.requirements.specification import Specification
from polefence.requirements.weights import Shape

SAMPLES = 200  # beside the vertices, near which a margin is looked for
ROUNDS = 30  # of the search for a level: 4 to 12 of loops with one resonance
LEAST = 1e-6  # of a level: no margin above 1e6 s is looked for


@dataclass(frozen=True)
class DelayMargin(DiskMargin):
    """The delay margin of a loop at an input: it is stable if that is late by any time up to it.

    Attributes
    ----------
    signal : str
        The input.
    at_most : float, optional
        Of 1 over the margin [1/s]; `least` takes the margin itself, in seconds.
    """

    kind = "delay margin"
    keys = ()  # type: ignore[assignment]
    vector: ClassVar[bool] = False
    by_gain: ClassVar[bool] = False
    claimed = proof.DelayMargin

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "sigma", -1.0)

    @property
    def title(self) -> str:
        """Kind and loop."""
        return f"{self.kind} of {self.name}"

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:  # type: ignore[override]
        """The filter of the limit."""
        if self.at_most is None:
            return ()
        return (Shape(late_by(1 / Fraction(self.at_most))),)

    def unit(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Return seconds."""
        return "s"

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a sampled plant, and what is no input."""
        for name in self.names:
            if place_of(plant, name, None)[0] != "input":
                raise InputError(f"{self.title}: {name!r} is no input; name one")
        self.require_late(plant)
        if plant.period:
            raise InputError(
                f"{self.title}: it is proved of loops in continuous time; leave out the sample "
                "time, or ask for a disk margin"
            )

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has its filter."""
        return f"{self.title}: no LMI has it; leave out the method, so that a law is tuned"

    def nearest(self, plant: UncertainPlant, law: Any) -> float | None:
        """Return the level at which the gain is the level, at samples.

        Its filter hardly depends on the level, so that it is soon found.
        """
        alpha = seeded(plant, len(plant.vertices) + SAMPLES)
        level = max(float(self.values(plant, law, alpha).max()), LEAST)
        for _ in range(ROUNDS):
            posed, beside, gain = replace(self, at_most=level).posed(plant, law)
            known, level = level, max(float(gain.values(posed, beside, alpha).max()), LEAST)
            if abs(level - known) <= 1e-6 * level:
                break
        return level

    def tuned(self, times: float) -> tuple[Specification, ...]:  # noqa: ARG002
        """Return itself.

        Raises
        ------
        InputError
            If it has no limit.
        """
        if self.at_most is None:
            raise InputError(
                f"{self.title}: a law is tuned for a limit; give at_least, and maximise another "
                "margin"
            )
        return (self,)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return 1 over the margin at points alpha, zero where there is no limit to it."""
        found = self.sampled(plant, law, alpha)
        with np.errstate(divide="ignore"):
            level = np.asarray(1 / found.delay.value)
        return np.where(found.stable, level, np.inf)
