"""Controllable dampers: forces that are a multiple of a deflection's rate, chosen as one likes."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import inputs, pick
from polefence.plant.parameters import exact
from polefence.proof.dampers import SemiActive
from polefence.proof.matrices import Rationals, product
from polefence.proof.short import Short


@dataclass(frozen=True)
class Damper(Short):
    """A damper whose coefficient any logic may choose, at any time, between two bounds.

    Its force u = c v is the plant's input, v the rate of a deflection; the plant's matrices are
    those without it.

    Parameters
    ----------
    force : str
        The input: of a car up on the body [N].
    deflection : str
        A state or an output, positive in compression where the force is up on the body [m].
    low, high : number
        Bounds on c [N s/m], low below high.

    Raises
    ------
    PlantError
        If a bound is no number.
    InputError
        If low is negative, or not below high.
    """

    force: str
    deflection: str
    low: Any
    high: Any

    @explained_fields
    def __post_init__(self) -> None:
        for key in ("low", "high"):
            what = f"damper {self.force}: {key}"
            object.__setattr__(self, key, exact(getattr(self, key), what))
        if not 0 <= self.low < self.high:
            raise InputError(
                f"damper {self.force}: low = {float(self.low):g} and high = {float(self.high):g} "
                "must be zero or more, and low below high"
            )

    def of(self, plant: UncertainPlant) -> SemiActive:
        """Return it with the rows of the deflection's rate at every vertex.

        Raises
        ------
        InputError
            If there is no such input or deflection, or if the rate is no function of the state
            alone.
        """
        names = [signal.name for signal in inputs(plant)]
        number = names.index(pick(inputs(plant), self.force).name)
        C, D, F = pick(plant.signals, self.deflection).exact(plant)
        if len({tuple(row) for row in C}) != 1 or any(map(any, (*D, *F))):
            raise InputError(
                f"damper {self.force}: {self.deflection} is not a fixed "
                "sum of states; name one that is"
            )
        rate: list[Rationals] = []
        for row, vertex in zip(C, plant.vertices, strict=True):
            rows = [list(row)]
            rate.append(product(rows, [list(r) for r in vertex.exact_A]))
            entering = [vertex.exact_B, *([vertex.exact_E] if vertex.exact_E else [])]
            if any(any(product(rows, [list(r) for r in M])[0]) for M in entering):
                raise InputError(
                    f"damper {self.force}: an input or a disturbance passes straight into the rate "
                    f"of {self.deflection}; name a deflection between two masses"
                )
        return SemiActive(number, rate, Fraction(self.low), Fraction(self.high))
