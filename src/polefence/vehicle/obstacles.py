"""Single obstacles on a level road: a bump, a pothole, a kerb."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from polefence.plant.system import Array
from polefence.response.weighting import positive
from polefence.vehicle.road import Road

# Pieces of a cosine bump: they leave it by less than 4e-5 of its height.
PIECES = 256


def bump(height: float, length: float, before: float = 1.0, after: float = 100.0) -> Road:
    """Return a cosine bump, h(x) = height / 2 (1 - cos(2 pi x / length)), on a level road.

    Parameters
    ----------
    height, length : float
        [m]; a negative height is a dip.
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a length is not above zero, or the height is not finite or zero.
    """
    length = positive(length, "length of the bump [m]")
    x = np.linspace(0, 1, PIECES + 1)
    own = _size(height, "height of the bump [m]") / 2 * (1 - np.cos(2 * np.pi * x))
    return _between_levels(x * length, own, before, after, "bump")


def pothole(
    depth: float, length: float, contact: float = 0.1, before: float = 1.0, after: float = 100.0
) -> Road:
    """Return a hole with upright walls as a tyre feels it: height averaged over the contact.

    Walls become ramps of the length of the contact; a hole shorter than the contact is not felt
    to its bottom.

    Parameters
    ----------
    depth, length : float
        [m], both above zero.
    contact : float
        Length of the tyre's contact with the road [m].
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a number is not above zero.
    """
    depth, length = positive(depth, "depth [m]"), positive(length, "length of the hole [m]")
    contact = positive(contact, "contact [m]")
    ramp, flat = min(contact, length), abs(length - contact)
    felt = depth * min(1.0, length / contact)
    x = np.cumsum([0.0, ramp, flat, ramp])
    heights = np.array([0.0, -felt, -felt, 0.0])
    keep = np.append(True, np.diff(x) > 0)  # a hole as long as the contact has no flat
    return _between_levels(x[keep], heights[keep], before, after, "pothole")


def kerb(height: float, contact: float = 0.1, before: float = 1.0, after: float = 100.0) -> Road:
    """Return a step of the road as a tyre feels it: a ramp of the length of its contact.

    Parameters
    ----------
    height : float
        [m]; negative downwards.
    contact : float
        Length of the tyre's contact with the road [m].
    before, after : float
        Level road before and after it [m].

    Raises
    ------
    InputError
        If a length is not above zero, or the height is not finite or zero.
    """
    contact = positive(contact, "contact [m]")
    heights = np.array([0.0, _size(height, "height of the kerb [m]")])
    return _between_levels(np.array([0.0, contact]), heights, before, after, "kerb")


def _between_levels(x: Array, height: Array, before: float, after: float, name: str) -> Road:
    before = positive(before, "road before [m]")
    after = positive(after, "road after [m]")
    distance = np.concatenate([[0.0], before + x, [before + x[-1] + after]])
    return Road(distance, np.concatenate([height[:1], height, height[-1:]]), name)


def _size(value: Any, what: str) -> float:
    return math.copysign(positive(abs(value), what), value)
