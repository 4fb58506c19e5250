"""Peak of a signal, from rest, under disturbances of bounded energy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.between import Held
from polefence.requirements.held import PRINTED, SEARCHED, at_times
from polefence.requirements.slopes import Channel, Loops, Slopes, of_largest, of_noise
from polefence.requirements.specification import Row, Specification, is_number
from polefence.response.between import held_evenly
from polefence.response.closed import close
from polefence.response.modes import Modes
from polefence.response.stationary import stationary


@dataclass(frozen=True)
class EnergyPeak(Specification):
    """The largest value of a signal, from rest, for disturbances of bounded energy.

    Attributes
    ----------
    norm : float
        Root of the integral of w^2 over all time [the disturbance's unit times s^0.5].
    """

    norm: float = 1.0
    kind = "energy peak"
    keys = ("norm", "disturbances")
    late_as: ClassVar[str | None] = proof.EnergyPeak.late_as
    at_all_times: ClassVar[bool] = True  # of samples: between them too

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.norm) and self.norm > 0):
            raise InputError(f"norm = {self.norm!r} must be a positive number")

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        return cls(row.table["signal"], **row.given("norm"))

    def source(
        self, plant: UncertainPlant, domain: Domain, law: Law | None = None
    ) -> conditions.Source:
        """Return disturbances of unit norm as noise: they ask the same of X."""
        E, degree = self.driving(plant, law)
        return conditions.noise(f"energy{self.scales(plant) or ''}", domain, E, 1.0, degree)

    @property
    def driven_by(self) -> float:
        """The norm: X of its claim is of disturbances of norm one."""
        return self.norm

    def held(self, plant: UncertainPlant) -> Held | None:
        """Return what is held between samples, where the peak is that at all times."""
        return held_evenly(plant, self.outputs(plant)) if self.at_all_times else None

    def has_primal(self, plant: UncertainPlant) -> bool:
        """Not of what goes on between samples: the search for what is reached solves no LMI."""
        return self.held(plant) is None

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the closed loops of the dual form, or those between samples."""
        problem, held = self._dual(plant, law, self.norm), self.held(plant)
        if held is None:
            return problem
        return replace(problem, storing=self._storing(plant, held, self.norm))

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the peak."""
        scales, norm = tuple(map(Fraction, self.scales(plant))), Fraction(self.norm)
        outputs, held = self.exact_outputs(plant), self.held(plant)
        return proof.EnergyPeak(subject, outputs, level, norm, scales=scales, held=held)

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,
        unit: float | None = None,
        law: Law | None = None,
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return it as in the claim: a disturbance of unit norm, and the output times the norm."""
        source, output = super().condition(plant, domain, unit, law)
        return source, replace(output, C=self.norm * output.C, D=self.norm * output.D)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the norm times the root of c P c', P the controllability Gramian.

        Between samples the largest of it at times of a period.
        """
        held = self.held(plant)
        if held is None:
            return self._of_samples(plant, law, alpha)
        stationary(plant, law, alpha, 0.0, self.outputs(plant))  # refuses what is not stable
        channel, closed = self._between(plant, held, alpha, PRINTED), close(plant, law, alpha)
        A = channel.A + channel.B @ closed.K
        loops = channel.closed(closed.K, Modes(A, closed.step))
        CX = loops.C @ loops.covariance
        squares = ((CX * loops.C).sum(axis=2) + loops.more).max(axis=1)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    def at_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array | None:
        """Return the peak at samples of held disturbances; else None."""
        return None if self.held(plant) is None else self._of_samples(plant, law, alpha)

    def _of_samples(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        psd = 2 * self.norm**2 * self.squares(plant)
        response = stationary(plant, law, alpha, psd, self.outputs(plant))
        return np.array(response.rms[:, 0])

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with disturbances of unit norm; between samples with the signal at times."""
        held = self.held(plant)
        if held is not None:
            return self._between(plant, held, alpha, SEARCHED)
        channel = super().channel(plant, alpha)
        return channel.louder(self.norm)

    def _between(self, plant: UncertainPlant, held: Held, alpha: Array, times: int) -> Channel:
        """Return the channel of the signal at so many times of each part of a period."""
        plant = delta_form(plant)
        channel, storing = super().channel(plant, alpha), self._storing(plant, held, self.norm)
        return at_times(channel, storing, alpha, float(plant.period), times)

    def is_of_noise(self, channel: Channel) -> bool:
        """Whether `slopes` are those of noise: not of the times between samples."""
        return not np.ndim(channel.more)

    def slopes(self, loops: Loops) -> Slopes:
        """Return the peak with its slopes, at the times of a period that are worst."""
        return of_largest(loops) if np.ndim(loops.more) else of_noise(loops)
