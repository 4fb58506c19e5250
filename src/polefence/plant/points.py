"""Points of a family: parameter values at weights of the vertices."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import prod
from typing import Any

from polefence.plant.family import UncertainPlant
from polefence.plant.names import unit_text


def values_at(plant: UncertainPlant, alpha: Sequence[Any]) -> dict[str, float] | None:
    """Return the parameters' values at alpha; None where none have this alpha.

    That is where the plant has no parameters, or alpha is no product of their weights.
    """
    count = len(plant.parameters)
    high = [
        sum((Fraction(a) for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        for bit in reversed(range(count))
    ]
    for j, a in enumerate(alpha):
        bits = zip(high, reversed(range(count)), strict=True)
        weight = prod((w if j >> bit & 1 else 1 - w for w, bit in bits), start=Fraction(1))
        if not count or abs(weight - Fraction(a)) > Fraction(1, 10**9):
            return None
    found = {}
    for p, w in zip(plant.parameters, high, strict=True):
        low, top = p.scheduling(p.low), p.scheduling(p.high)
        found[p.name] = float(p.scheduling(low + w * (top - low)))
    return found


def values_text(plant: UncertainPlant, values: dict[str, float]) -> str:
    """Print parameter values with their units."""
    units = {p.name: unit_text(p.unit) for p in plant.parameters}
    return ", ".join(f"{name} = {v:.6g} {units[name]}".rstrip() for name, v in values.items())
