"""Gain and phase margins: how far the gain, or the phase, of one loop alone may be off."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.delta import sampled_form
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.claims.factor_margin import GainMargin as GainClaim
from polefence.proof.claims.factor_margin import PhaseMargin as PhaseClaim
from polefence.proof.claims.factor_margin import Place, require_factors
from polefence.proof.laws import Law
from polefence.proof.text import exactly
from polefence.proof.work import FormatError
from polefence.requirements.disk_margin import DiskMargin, Posed
from polefence.requirements.margin import inverse
from polefence.requirements.specification import Specification
from polefence.response.loop_margins import LoopMargins

LARGEST_DISK = 2.0  # a balanced disk margin is less: at high frequencies nothing comes back


@dataclass(frozen=True)
class FactorMargin(DiskMargin):
    """A margin of one loop against one constant factor: what kinds of them have in common.

    A law is sought by the disk margin that implies it. What is proved of a law is the margin
    itself, as stability of a family with the factor in its loop.
    """

    keys = ()  # type: ignore[assignment]
    vector: ClassVar[bool] = False
    by_gain: ClassVar[bool] = False
    late_as: ClassVar[str | None] = None
    poles_claim: ClassVar[type[GainClaim]]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sigma:
            raise InputError(f"a {self.kind} has no sigma; leave it out")

    @property
    def disk(self) -> DiskMargin:
        """The disk margin that implies it."""
        return DiskMargin(self.signal, None if self.at_most is None else 1 / self.alpha)

    @property
    def alpha(self) -> float:
        """That disk margin's size."""
        raise NotImplementedError

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without the loop, or of which none is proved."""
        self.require_size()
        replace(self.disk, at_most=None).require_fit(plant)  # it may be more than that implies
        self.require_late(plant)
        if plant.functions is not None:
            self._refuse("a plant with functions of its parameters")
        if len(plant.vertices) > 1 and not plant.parameters:
            self._refuse("a plant that is given by its vertices")

    def require_late(self, plant: UncertainPlant, outputs: Any = ()) -> None:  # noqa: ARG002
        """Refuse a plant with a dead time."""
        if plant.dead_time is not None:
            self._refuse("a plant with a dead time")

    def _refuse(self, what: str) -> None:
        raise InputError(
            f"{self.title}: not available for {what}; ask for a disk margin, which implies it"
        )

    def require_size(self) -> None:
        """Refuse a limit that is no margin."""

    def posed(self, plant: UncertainPlant, law: Any) -> Posed:
        """Return the plant, the law and itself: no gain proves it."""
        return plant, law, self

    def tuned(self, times: float) -> tuple[Specification, ...]:  # noqa: ARG002
        """Return the disk margin.

        Raises
        ------
        InputError
            If no disk margin implies it.
        """
        if self.alpha >= LARGEST_DISK:
            raise InputError(
                f"{self.title} >= {exactly(self.limit or 0.0)}: a law is tuned for less than 90 deg"
            )
        return (self.disk,)

    def beyond_lmi(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Say that none has it."""
        return (
            f"{self.title}: an LMI has disk margins alone; leave out the method, so that a law is "
            "tuned"
        )

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return 1 over the margin at points alpha."""
        found = self.sampled(plant, law, alpha)
        level = np.maximum(self.level_of(found), 1 / self.most)  # beyond it is not looked
        return np.where(found.stable, level, np.inf)

    def level_of(self, found: LoopMargins) -> Array:
        """Return 1 over margins that were sampled."""
        raise NotImplementedError

    def level_below(self, worst: float, share: float) -> float:
        """Return a level whose margin is less than the worst by a share, in few digits."""
        return _short(self.none + (1 / worst - self.none) * (1 - share))

    none: ClassVar[float]  # of a loop without any
    most: ClassVar[float]  # that is looked for

    def of_law(self, plant: UncertainPlant, law: Law, level: Fraction) -> GainClaim:
        """Return the claim of a level about an exact law, without evidence.

        Raises
        ------
        InputError
            If no such margin is proved of the plant or the law.
        """
        known, loops = file_plant(plant), self.loops_of(plant, law)
        place = Place((*loops.inputs, *loops.measured)[0], bool(loops.measured))
        try:
            require_factors(known, law, place, self.title)
        except FormatError as error:
            raise InputError(str(error)) from error
        return self.poles_claim.of(known, law, place, level)

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim, without evidence: that is about poles, not about a signal."""
        return self.of_law(sampled_form(plant), subject.law, level)


@dataclass(frozen=True)
class GainMargin(FactorMargin):
    """The gain margin g of a loop: it stays stable if its gain is any constant from 1 / g to g.

    Attributes
    ----------
    signal : str
        The loop: an input, or a signal that the law measures.
    at_most : float, optional
        Of 1 over the margin; `least` takes the margin itself, 2 of 6 dB.
    """

    kind = "gain margin"
    poles_claim = GainClaim
    none, most = 1.0, 100.0

    @property
    def alpha(self) -> float:
        """Size of the balanced disk whose real factors are from 1 / g to g."""
        level = self.at_most or 1.0
        return 2 * (1 - level) / (1 + level)

    def require_size(self) -> None:
        """Refuse a factor that is not above one."""
        limit = self.limit
        if limit is not None and not 1 < limit < self.most:
            raise InputError(
                f"{self.title} >= {exactly(limit)}: it is a factor above 1 and below 100; write 2 "
                "for 6 dB"
            )

    def level_of(self, found: LoopMargins) -> Array:
        """Return the larger of the factor below 1, and of 1 over that above it."""
        return np.maximum(found.lower.value, 1 / found.upper.value)


@dataclass(frozen=True)
class PhaseMargin(FactorMargin):
    """The phase margin of a loop: it stays stable if its phase is off by up to that, constantly.

    Attributes
    ----------
    signal : str
        The loop: an input, or a signal that the law measures.
    at_most : float, optional
        Of 1 over the margin [1/deg]; `least` takes the margin itself, in degrees.
    """

    kind = "phase margin"
    poles_claim = PhaseClaim
    none, most = 0.0, 175.0

    @property
    def alpha(self) -> float:
        """Size of the balanced disk that holds all phases up to the margin."""
        return 2 * math.tan(math.radians(1 / (self.at_most or 1.0)) / 2)

    def require_size(self) -> None:
        """Refuse an angle that is out of range."""
        limit = self.limit
        if limit is not None and not 0 < limit < self.most:
            raise InputError(f"{self.title} >= {exactly(limit)}: write degrees, below 175")

    def unit(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Return degrees."""
        return "deg"

    @staticmethod
    def level_of_degrees(degrees: float) -> float:
        """Return a level whose margin is less than an angle, in few digits."""
        return _short(degrees * (1 - 1e-9))

    def level_of(self, found: LoopMargins) -> Array:
        """Return 1 over the phase."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / found.phase.value)


def _short(margin: float) -> float:
    """Return the level of a margin in few digits."""
    return inverse(Fraction(repr(math.floor(margin * 1e7) / 1e7)))
