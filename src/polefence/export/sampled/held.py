"""A law run by samples: the loop at the sampling instants, at many parameter values at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.points import edges, inside
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import placement
from polefence.response.discrete import held

SHORTEST = 1e-9  # of the loop's fastest time


def require_usable(design: Design, sample_time: Any, delay: int) -> float:
    """Return the sample time as a float.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the numbers cannot be used.
    """
    require_continuous(design, delay)
    try:
        value = float(sample_time)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(f"sample_time = {sample_time!r} must be a positive number of seconds")
    fastest = float(np.abs(design.poles(np.eye(len(design.plant.vertices)))).max())
    if value * fastest < SHORTEST:
        raise InputError(
            f"sample_time = {value:g} s is too short to be told from none in floating point: the "
            f"loop's fastest pole is at {fastest:.3g} 1/s"
        )
    return value


def require_continuous(design: Design, delay: int) -> None:
    """Refuse discrete-time plants, whose law is sampled by design, and unknown delays."""
    time = design.plant.sample_time
    if time is not None:
        raise InputError(
            f"{design.plant.name} is a discrete-time plant: its law runs every {float(time):g} s, "
            "without delay, and the region is proved for just that"
        )
    if delay not in (0, 1) or isinstance(delay, bool):
        raise InputError(f"delay = {delay!r} must be 0 or 1, in samples")


def stepped(design: Design, alpha: Array, sample_time: float, delay: int) -> Array:
    """Return the matrices from one sample to the next, (..., n, n), or with a delay n + m.

    Without delay x+ = (F + G K) x. With a delay of one sample the state is (x, u):
    x+ = F x + G u, u+ = K x.
    """
    (n, m), K = design.plant.shape, design.law.gain(alpha)
    F, G = held(*design.plant.at(alpha), sample_time)
    if not delay:
        return np.asarray(F + G @ K)
    whole = np.zeros((*F.shape[:-2], n + m, n + m))
    whole[..., :n, :n], whole[..., :n, n:], whole[..., n:, :n] = F, G, K
    return whole


def domain_of(plant: UncertainPlant, design: Design) -> Domain:
    """Return where alpha lives: on the box of the parameters where there are any."""
    if plant.parameters:
        return Domain.of("box", len(plant.vertices))
    return Domain(placement.simplices(design.certificate.claim()))


def cloud(design: Design, count: int) -> Array:
    """Return vertices, points of the edges and ``count`` random points alpha, (points, N)."""
    domain = domain_of(design.plant, design)
    return domain.alpha(np.vstack([edges(domain), inside(domain, count)]))
