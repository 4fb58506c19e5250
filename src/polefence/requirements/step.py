"""Step responses: how large, how fast and how calm a signal is after a constant disturbance."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.requirements.measured import TINY, Measured, Near, Response
from polefence.requirements.specification import disturbance


@dataclass(frozen=True)
class StepMeasure(Measured):
    """A measure of a signal's response to a constant disturbance, from rest.

    Attributes
    ----------
    measure : str
        "peak", the largest absolute value; "overshoot" and "undershoot", shares of the final value;
        "settling", the time after which the signal stays within ``band`` of its final value [s];
        "rise", a time by which it has come so near [s]; "final", the final absolute value;
        "envelope", how many times as wide as it is an ``envelope`` must be.
    band : float, optional
        A share of the final value: 0.02 of a settling time, 0.1 of a rise time.
    envelope : sequence of (float, float, float), optional
        Times [s], lower and upper numbers between which the signal is to stay: linear between the
        times, the last for ever after.
    disturbances : sequence of str, or mapping of str to float, optional
        Those that step, each by so much; all by one unless said.
    """

    kind = "step"
    direct = True
    claimed = proof.StepResponse
    bands: ClassVar[Any] = MappingProxyType({"settling": 0.02, "rise": 0.1})  # of the final value

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without a disturbance, or of which none is proved."""
        disturbance(plant)
        self.scales(plant)
        super().require_fit(plant)

    def near(self, **own: Any) -> StepNearness:
        """Return how near the signal is from a time on."""
        return StepNearness(**own)

    def active(self, response: Response) -> Array:
        """Return the times that count."""
        sign = np.sign(response.final)
        match self.measure:
            case "overshoot":
                return response.highest(sign * response.y)
            case "undershoot":
                return response.highest(-sign * response.y)
            case _:
                return super().active(response)

    def measures(self, t: Array, y: Array, final: Array) -> tuple[Array, Array, Array]:
        """Return the measure of y at times, and its slopes to y and to the final value."""
        sign, size = np.sign(final), np.maximum(np.abs(final), TINY)
        match self.measure:
            case "final":
                return size, np.zeros(len(y)), sign
            case "overshoot" | "undershoot":
                s = sign if self.measure == "overshoot" else -sign
                less = 1.0 if self.measure == "overshoot" else 0.0
                return s * y / size - less, s / size, -s * y * sign / size**2
            case _:
                return super().measures(t, y, final)

    def measured(self, response: Response) -> float:
        """Return what is asked of a response, infinite where there is none."""
        size, sign = abs(response.final), np.sign(response.final)
        if self.relative and not size:
            return np.inf
        match self.measure:
            case "final":
                return size
            case "overshoot":
                return max(response.most(sign) / size - 1, 0.0)
            case "undershoot":
                return max(response.most(-sign) / size, 0.0)
            case "rise":
                return response.first((1 - (self.band or 0.0)) * size - sign * response.y)
            case _:
                return super().measured(response)


@dataclass(frozen=True)
class StepNearness(Near, StepMeasure):
    """How near a signal is to its final value from a time on: at most one where it is in the band.

    Of a rise, how much it lacks at that time.
    """

    def active(self, response: Response) -> Array:
        """Return the time itself, and the times after it that count."""
        return np.array([self.time]) if self.measure == "rise" else super().active(response)

    def measures(self, t: Array, y: Array, final: Array) -> tuple[Array, Array, Array]:
        """Return it, and its slopes."""
        sign, size, band = np.sign(final), np.maximum(np.abs(final), TINY), self.band or 0.0
        if self.measure == "rise":
            return 2 - band - sign * y / size, -sign / size, sign * y * sign / size**2
        over, s, _ = super().measures(t, y, final)
        return over / size, s / size, -s / size - over * sign / size**2
