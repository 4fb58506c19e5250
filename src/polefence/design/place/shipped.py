"""Law and evidence in the numbers that ship, from a point that a search found; their proof."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from polefence.base.errors import SolverError
from polefence.design.certificate import Certificate
from polefence.design.design import Design
from polefence.design.search import preferred
from polefence.law.laws import FixedGain, ScheduledGain, right_divide
from polefence.lmi.conditions.methods import Method, Slack, method_name, normal, options
from polefence.lmi.solve.search import Reached, coefficients
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.region.regions import Disk, Region


def proved_at(
    plant: UncertainPlant, region: Region, method: Method, found: Reached
) -> Design | None:
    """Return the design of a point for a region, None where it is not proved."""
    try:
        design = Design(rounded(plant, region, method, found))
    except SolverError:
        return None
    return design if design.certificate.prove().proved else None


def runnable(
    designs: Iterable[Design | None], value: Callable[[Design], float], sign: int = 1
) -> Design | None:
    """Return the first design whose law doubles can run, where there is none the first of all.

    A smaller value of the latter, times the sign, is kept as what doubles cannot run.
    """
    design, sharpest = preferred(designs, attrgetter("runs"))
    if design is None or sharpest is None or sign * value(sharpest) >= sign * value(design):
        return design
    return replace(design, unrunnable=value(sharpest))


def rounded(plant: UncertainPlant, region: Region, method: Method, found: Reached) -> Certificate:
    """Round a point to the law and evidence that ship; the proof is about these very numbers.

    Raises
    ------
    SolverError
        If a Lyapunov or slack matrix is singular in floats.
    """
    name = method_name(method)
    try:
        law, evidence = _LAWS[name](plant, region, method, found)
    except np.linalg.LinAlgError as error:
        raise SolverError("a Lyapunov matrix is numerically singular") from error
    return Certificate(plant, region, name, law, evidence)


def _quadratic(*args: Any) -> tuple[FixedGain, dict[str, Any]]:
    values = args[3].values
    return FixedGain(right_divide(values["Z"], values["W"])), {"W": values["W"]}


def _scheduled(
    plant: UncertainPlant, _: Region, method: Method, found: Reached
) -> tuple[ScheduledGain, dict[str, Any]]:
    o, values = options(method), found.values
    degree, domain = int(o.degree), Domain.of(o.on, len(plant.vertices))
    W, Z = coefficients(values, "W"), coefficients(values, "Z")
    evidence: dict[str, Any] = {"tau": np.array(values["tau"].item() if "tau" in values else 0.0)}
    if o.elevation != 1:
        evidence["elevation"] = o.elevation
    return ScheduledGain(W, Z, plant.parameters, degree, domain.sizes), evidence


def _slack(
    _: UncertainPlant, region: Region, method: Method, found: Reached
) -> tuple[FixedGain, dict[str, Any]]:
    method, values = normal(method), found.values
    o = method if isinstance(method, Slack) else Slack()
    evidence: dict[str, Any] = {"P": coefficients(values, "P"), "G": values["G"]}
    if isinstance(method, Slack):
        evidence |= {"degree": o.degree, "elevation": o.elevation, "on": o.on}
    if not isinstance(region, Disk):
        # e is in units of the search's own time
        evidence["epsilon"] = o.epsilon / found.rate
    return FixedGain(right_divide(values["L"], values["G"])), evidence


_Evidence = dict[str, Any]
_LAWS: dict[str, Callable[..., tuple[FixedGain | ScheduledGain, _Evidence]]] = {
    "quadratic": _quadratic,
    "scheduled": _scheduled,
    "slack": _slack,
}


def radius_of(design: Design) -> float:
    """Return the radius of a design's disk."""
    return float(getattr(design.region, "radius", math.inf))
