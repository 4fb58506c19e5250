"""The largest decay rate or damping ratio that a method reaches, within a fixed region."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from polefence.base.errors import InputError, NotProvedError, SolverError
from polefence.base.types import require_type
from polefence.design.checks import require_movable, require_region
from polefence.design.design import Design
from polefence.design.rounding import proved_at
from polefence.lmi.conditions.methods import Method, Slack, degree_hint, method_label, options
from polefence.lmi.conditions.target import FASTEST, Around, Decays, Goal, Sectors
from polefence.lmi.solve.radius import smallest, typical_rate
from polefence.plant.family import UncertainPlant
from polefence.region.regions import HalfPlane, Region, Sector, damping_of
from polefence.region.speed import bounded

# How far above the r that a point reaches in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4)

# How far inside a region a point is looked for, as a share of its size.
INSIDE = 0.98

# How many times the plant's own rates poles may be fast, where nothing else bounds them.
SPEED = 100.0

# How close the search goes. Nearer to the optimum a Lyapunov matrix may be too ill-conditioned to
# be proved in doubles.
TOLERANCES = (1e-10, 1e-8, 1e-6)

# Where that fails: values tried, and how far apart the last two may be, relative to them.
ATTEMPTS, CLOSE = 24, 1e-3

LEAST, MOST = 1e-8, 1 - 1e-9  # damping ratios


def largest(plant: UncertainPlant, of: str, method: Method, within: Region | None) -> Design:
    """Return the design of the largest decay rate ("half_plane") or damping ratio ("sector").

    With nothing to bound the poles' speed a high gain may do ever better, and no optimum be
    attained. So where ``within`` does not bound it, a disk that reaches to `SPEED` times the
    plant's rates does. Should the direct search fail, values are tried from region to region.

    Raises
    ------
    NotProvedError
        If nothing was proved.
    InputError
        If the method has no such question, or the region does not fit the plant's time.
    """
    if isinstance(options(method), Slack):
        raise InputError(f"of = {of!r} goes with the methods quadratic and scheduled")
    if within is not None:
        require_type(within, Region, "within", "for example polefence.Disk(-40, 39)")
    require_region(plant, HalfPlane(0) if within is None else HalfPlane(0) & within, method)
    require_movable(plant, within)
    within = bounded(within, SPEED * typical_rate(plant.A))
    question = (_decay if of == "half_plane" else _damping)(within)
    design = _direct(plant, method, question)
    if design is None:
        design = _grown(plant, method, question)
    elif not design.runs:
        grown = _grown(plant, method, question, running=True)
        design = design if grown is None else replace(grown, unrunnable=_value(design))
    if design is None:
        wanted = "decay rate" if of == "half_plane" else "damping ratio"
        raise NotProvedError(
            f"not proved: {method_label(method)} gives no proof of a {wanted} from "
            f"{question.low:g} up within {within}; try a wider region{degree_hint(method)}"
        )
    return design


@dataclass(frozen=True, eq=False)
class _Question:
    """A value that is to be large.

    Attributes
    ----------
    region : callable
        Value to region.
    goal : Goal
        What the direct search minimises.
    value : callable
        Of an r and a relative step back, the value.
    low, high : float
        Where to look for values.
    first : float
        The first value that is tried.
    base : Region
        Where a point must lie from which the direct search can start.
    """

    region: Callable[[float], Region]
    goal: Goal
    value: Callable[[float, float], float]
    low: float
    high: float
    first: float
    base: Region


def _decay(within: Region) -> _Question:
    size = within.scale
    fastest = FASTEST * size

    def value(r: float, step: float) -> float:
        decay = fastest - r * (1 + step)
        return decay - step * abs(decay)

    return _Question(
        lambda a: HalfPlane(a) & within,
        Decays(fastest, within),
        value,
        -size,
        fastest,
        size / 4,
        within,
    )


def _damping(within: Region) -> _Question:
    return _Question(
        lambda zeta: Sector(zeta) & within,
        Sectors(within.scale, within),
        lambda r, step: min(max(damping_of(r * (1 + step)), LEAST), MOST),
        LEAST,
        MOST,
        0.1,
        HalfPlane(0) & within,
    )


def _value(design: Design) -> float:
    """Return the decay rate or damping ratio of a design."""
    first = design.region.parts[0]
    return float(first.decay if isinstance(first, HalfPlane) else first.numbers["damping"])


def _direct(plant: UncertainPlant, method: Method, question: _Question) -> Design | None:
    """Search for the least r; None unless the search comes to its end and is proved there."""
    with suppress(SolverError):
        start = smallest(plant.A, plant.B, Around(question.base), method, enough=INSIDE)
        if start.radius >= 1:
            return None
        near, first = replace(start, radius=0.0), None
        for tolerance in TOLERANCES:
            found = smallest(plant.A, plant.B, question.goal, method, near, tolerance=tolerance)
            if not found.converged:
                return first
            for step in (*STEPS, 1e-3):
                region = question.region(question.value(found.radius, step))
                design = proved_at(plant, region, method, found)
                if design is not None and design.runs:
                    return design if first is None else replace(design, unrunnable=_value(first))
                first = first or design
        return first
    return None


def _grown(
    plant: UncertainPlant, method: Method, question: _Question, running: bool = False
) -> Design | None:
    """Double the value while its region is proved, then halve the bracket.

    ``running`` asks for laws that doubles can evaluate besides.
    """
    low, high, value, best = question.low, question.high, question.first, None
    bracketed = False
    for _ in range(ATTEMPTS):
        design = _attempt(plant, method, question.region(value))
        if design is None or (running and not design.runs):
            high, bracketed = value, True
        else:
            low, best = value, design
            if value >= question.high:
                break
        value = (low + high) / 2 if bracketed else min(2 * value, question.high)
        if bracketed and high - low <= CLOSE * abs(high):
            break
    return best


def _attempt(plant: UncertainPlant, method: Method, region: Region) -> Design | None:
    with suppress(SolverError):
        found = smallest(plant.A, plant.B, Around(region), method, enough=INSIDE)
        return proved_at(plant, region, method, found) if found.radius < 1 else None
    return None
