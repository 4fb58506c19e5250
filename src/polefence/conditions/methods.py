"""The methods a user can name, and the pencil each builds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.conditions.pencil import Pencil
from polefence.conditions.quadratic import quadratic
from polefence.conditions.scheduled import scheduled
from polefence.conditions.slack import slack
from polefence.errors import InputError, suggest
from polefence.plant.system import Array

METHODS = ("quadratic", "slack", "scheduled")


@dataclass(frozen=True)
class Scheduled:
    """Theorem 1 and its options.

    Parameters
    ----------
    degree, elevation : int
        Degree of W(alpha), Z(alpha), and of the multiplier; (1, 1) is Theorem 1 and the only pair
        this version has.
    right_hand_sides : bool
        Keep the right-hand sides of the paper's (15)-(17).

    Raises
    ------
    InputError
        For any other degree or elevation.
    """

    degree: int = 1
    elevation: int = 1
    right_hand_sides: bool = False

    def __post_init__(self) -> None:
        if (self.degree, self.elevation) != (1, 1):
            raise InputError(
                f"Scheduled(degree={self.degree}, elevation={self.elevation}) is not available; "
                "this version has degree=1, elevation=1"
            )


Method = str | Scheduled


def method_name(method: Method) -> str:
    """Return the method's name, one of `METHODS`.

    Raises
    ------
    InputError
        If there is no such method.
    """
    name = "scheduled" if isinstance(method, Scheduled) else method
    if name not in METHODS:
        raise InputError(f"method = {name!r} is unknown; {suggest(str(name), METHODS)}")
    return name


def build(method: Method, A: Array, B: Array, sigma: float, unit: Array | None = None) -> Pencil:
    """Return the pencil of a method for vertices A (N, n, n), B (N, n, m) and centre -sigma.

    Parameters
    ----------
    unit : (n, n) array, optional
        The identity of the original coordinates as it reads in those of A; only the paper's
        right-hand sides need it.
    """
    name = method_name(method)
    if name == "quadratic":
        return quadratic(A, B, sigma)
    if name == "slack":
        return slack(A, B, sigma)
    wanted = isinstance(method, Scheduled) and method.right_hand_sides
    identity = np.eye(A.shape[1]) if unit is None else unit
    return scheduled(A, B, sigma, identity if wanted else None)
