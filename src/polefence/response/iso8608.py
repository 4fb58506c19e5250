"""Densities of the roads of ISO 8608, by their classes."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.plant.system import Array
from polefence.response.stationary import velocity_psd

# ISO 8608: Gd(n0) [m3] at n0 = 0.1 cycles/m, geometric means of the classes; Gd falls as n^-2.
ROUGHNESS = {letter: 16e-6 * 4**i for i, letter in enumerate("ABCDEFGH")}
REFERENCE = 0.1


def roughness(road_class: str) -> float:
    """Return Gd(n0) [m3] of a class "A" to "H" of ISO 8608, its geometric mean.

    Raises
    ------
    InputError
        If there is no such class.
    """
    found = ROUGHNESS.get(str(road_class).upper())
    if found is None:
        raise InputError(f"no road class {road_class!r}; {suggest(str(road_class), ROUGHNESS)}")
    return float(found)


def displacement_density(road_class: str, n: Any) -> Array:
    """Return the one-sided density of height [m3] at spatial frequencies n [cycles/m]."""
    return np.asarray(roughness(road_class) * (np.asarray(n, dtype=float) / REFERENCE) ** -2)


def velocity_density(road_class: str, speed: float) -> float:
    """Return the one-sided, white density of road velocity at a speed [m2/s2 per Hz].

    That of `stationary.velocity_psd` for a class, from Gd(n) = Gd(n0) (n / n0)^-2 at n = f / v.
    Half of it is two-sided, as in the Lyapunov equation A X + X A' + E (density / 2) E' = 0.

    Raises
    ------
    InputError
        If there is no such class, or the speed [m/s] is not above zero.
    """
    return velocity_psd(roughness(road_class), speed, REFERENCE)
