"""Controllable dampers: forces between two curves of a deflection's rate, chosen as one likes."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import inputs, pick
from polefence.plant.parameters import exact
from polefence.proof.dampers import MAX_POINTS, Curve, SemiActive
from polefence.proof.matrices import Rationals, product
from polefence.proof.short import Short


@dataclass(frozen=True)
class Damper(Short):
    """A damper whose force any logic may choose, at any time, between two curves of a rate.

    Its force is the plant's input, v the rate of a deflection; the plant's matrices are those
    without it. A number c stands for the line c v; points for what was measured, linear between
    them and going on beyond the last ones as they ended.

    Parameters
    ----------
    force : str
        The input: of a car up on the body [N].
    deflection : str
        A state or an output, positive in compression where the force is up on the body [m].
    low, high : number or sequence of pairs
        A coefficient [N s/m], or points of rate [m/s] and force [N], by ascending rates; where all
        rates are zero or more, rebound and compression are alike.

    Raises
    ------
    PlantError
        If something is no number.
    InputError
        If a force has not the sign of the rate, or low is not below high; a bent curve may be both,
        of a damper that is not controlled.
    """

    force: str
    deflection: str
    low: Any
    high: Any

    @explained_fields
    def __post_init__(self) -> None:
        for key in ("low", "high"):
            value = _bound(getattr(self, key), f"damper {self.force}: {key}")
            object.__setattr__(self, key, value)
        low, high = self.curves
        whole = SemiActive(0, [], low, high)
        # of one curve only a line has its place in the matrices
        if low.ratios[0] < 0 or not whole.nested or (low == high and whole.straight):
            raise InputError(
                f"damper {self.force}: low = {low.text} and high = {high.text} must be zero or "
                "more, and low below high"
                + ("" if whole.straight else ", in size, at every rate, also beyond the points")
            )

    @classmethod
    def named(cls, plant: UncertainPlant, own: SemiActive) -> Damper:
        """Return the damper of a plant that is the one of a claim, of the deflection by its rate.

        Raises
        ------
        InputError
            If the rate is that of no signal of the plant.
        """
        force = inputs(plant)[own.number].name
        for signal in plant.signals:
            with suppress(InputError):
                found = cls(force, signal.name, own.low, own.high)
                if found.of(plant).rate == own.rate:
                    return found
        raise InputError(
            f"{plant.name}: the rate of damper {force} is that of no signal of the plant; name its "
            "spec beside the law"
        )

    @property
    def curves(self) -> tuple[Curve, Curve]:
        """The lower and the upper curve."""
        low, high = (
            own if isinstance(own, Curve) else Curve.line(own) for own in (self.low, self.high)
        )
        return low, high

    @property
    def summary(self) -> dict[str, Any]:
        """What it gives, as a spec has it."""
        low, high = self.curves
        if isinstance(self.low, Curve) or isinstance(self.high, Curve):
            pairs = (("low", low), ("high", high))
            return {key: [[float(x) for x in p] for p in own.points] for key, own in pairs}
        return {"range": [float(self.low), float(self.high)]}

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
        return SemiActive(number, rate, *self.curves)


def _bound(value: Any, what: str) -> Fraction | Curve:
    """Return a coefficient, or the curve by points.

    Raises
    ------
    PlantError
        If something is no number.
    InputError
        If the points are no curve through zero.
    """
    if isinstance(value, Curve):
        return value
    if not isinstance(value, list | tuple | np.ndarray):
        return exact(value, what)
    points = list[tuple[Fraction, Fraction]]()
    for k, pair in enumerate(value):
        if not isinstance(pair, list | tuple | np.ndarray) or len(pair) != 2:
            raise InputError(f"{what}: point {k + 1} must be [rate in m/s, force in N]")
        v, F = (exact(x, f"{what}: point {k + 1}") for x in pair)
        points.append((v, F))
    if not any(v == 0 for v, _ in points):
        points = sorted([*points, (Fraction(0), Fraction(0))])
    if points[0][0] == 0:
        points = [*((-v, -F) for v, F in points[:0:-1]), *points]
    curve = Curve(tuple(points))
    if len(points) > MAX_POINTS:
        raise InputError(f"{what} has {len(points)} points; at most {MAX_POINTS} are possible")
    if fault := curve.fault():
        raise InputError(f"{what}: {fault}")
    return curve
