"""Peak of a signal, from rest, under disturbances of bounded energy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Self

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.requirements.slopes import Channel, Loops, Slopes, of_noise
from polefence.requirements.specification import Row, Specification, is_number
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

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        if not (is_number(self.norm) and self.norm > 0):
            raise InputError(f"norm = {self.norm!r} must be a positive number")

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        return cls(row.table["signal"], **row.given("norm"))

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:
        """Return disturbances of unit norm as noise: they ask the same of X."""
        E, degree = self.driving(plant)
        return conditions.noise(f"energy{self.scales(plant) or ''}", domain, E, 1.0, degree)

    @property
    def driven_by(self) -> float:
        """The norm: X of its claim is of disturbances of norm one."""
        return self.norm

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the closed loops of the dual form."""
        return self._dual(plant, law, self.norm)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the peak."""
        scales = tuple(map(Fraction, self.scales(plant)))
        outputs = self.exact_outputs(plant)
        return proof.EnergyPeak(subject, outputs, level, Fraction(self.norm), scales=scales)

    def condition(
        self, plant: UncertainPlant, domain: Domain, unit: float | None = None
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return it as in the claim: a disturbance of unit norm, and the output times the norm."""
        source, output = super().condition(plant, domain, unit)
        return source, replace(output, C=self.norm * output.C, D=self.norm * output.D)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the norm times the root of c P c', P the controllability Gramian."""
        psd = 2 * self.norm**2 * self.squares(plant)
        response = stationary(plant, law, alpha, psd, self.outputs(plant))
        return np.array(response.rms[:, 0])

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with disturbances of unit norm."""
        channel = super().channel(plant, alpha)
        return replace(channel, E=self.norm * channel.E)

    def slopes(self, loops: Loops) -> Slopes:
        """Return the peak with its slopes."""
        return of_noise(loops)
