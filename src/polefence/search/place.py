"""Laws for a region: a given one, or the smallest of a kind that a method reaches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from operator import attrgetter
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, SolverError, require_type
from polefence.base.progress import stage
from polefence.certify.candidates import Deadline, gallop, preferred
from polefence.certify.certificate import Certificate
from polefence.certify.checks import (
    in_time_of,
    is_checkable,
    require_checkable,
    require_continuous,
    require_domain,
    require_movable,
    require_region,
    usable_centre,
)
from polefence.certify.counterexample import unplaceable
from polefence.certify.design import Design
from polefence.certify.lower_bound import is_there, lower_radius
from polefence.certify.repair import lower_bound
from polefence.law.laws import FixedGain, ScheduledGain, right_divide
from polefence.lmi.conditions.methods import (
    Method,
    Scheduled,
    Slack,
    degree_hint,
    fitting,
    method_label,
    method_name,
    normal,
    options,
)
from polefence.lmi.conditions.target import FASTEST, Around, Decays, Disks, Goal, Patch, Sectors
from polefence.lmi.solve.interior_point import TOLERANCE
from polefence.lmi.solve.search import Reached, coefficients
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.polynomial import Domain
from polefence.region.regions import (
    Disk,
    HalfPlane,
    Region,
    Sector,
    bounded,
    damping_of,
)
from polefence.region.text import digits_up

# How far inside a region a point is looked for first; then as far as the search goes.
WELL_INSIDE = (0.98, 0.0)

# Where nothing bounds the poles' speed: multiples of the rates of region and plant that bound it in
# the search, one after the other.
SPEEDS = (10.0, 100.0, 1000.0)
FASTEST_POLES = 1e99  # [1/s], of regions

# Degree and elevation that "auto" tries, while there are at most so many unknowns.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1), (4, 0), (4, 1), (5, 1))
MOST_UNKNOWNS = 1500

# How far above the r that a point reaches in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4)

# A lower bound farther off than this share of the radius is sought again, with this tolerance.
GAP, CLOSER = 9e-7, 1e-10
EARLIER = 1e-6  # tolerance of a run that ends farther inside, where the ends have no bound

# How far inside a region a point is looked for, as a share of its size.
INSIDE = 0.98

# How many times the plant's own rates poles may be fast, where nothing else bounds them.
SPEED = 100.0

# How close the search for decay rates and damping ratios goes. Nearer to the optimum a Lyapunov
# matrix may be too ill-conditioned to be proved in doubles.
TOLERANCES = (1e-10, 1e-8, 1e-6)

# Where that fails: values tried, and how far apart the last two may be, relative to them.
ATTEMPTS, CLOSE = 24, 1e-3

LEAST, MOST = 1e-8, 1 - 1e-9  # damping ratios

_Evidence = dict[str, Any]


def place(
    plant: UncertainPlant,
    region: Region,
    method: Method = "scheduled",
    allow_unproved: bool = False,
) -> Design:
    """Design a law that an LMI gives: `polefence.place` without a structure."""
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_domain(plant, method)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    region, method = in_time_of(plant, region), fitting(plant, method)
    require_region(plant, region, method)
    require_movable(plant, region)
    if isinstance(method, Scheduled) and method.degree == "auto":
        return _climb(plant, region, method)
    require_checkable(plant, method, len(region.parts))
    if region.circle is not None:
        return _in_disk(plant, Disk(*region.circle), method, allow_unproved)
    return _in_region(plant, region, method, allow_unproved)


def _in_disk(plant: UncertainPlant, disk: Disk, method: Method, allow_unproved: bool) -> Design:
    """Place the poles by a point inside a disk, or by the smallest disk of the same centre."""
    inside: Design | None = None
    with suppress(SolverError):
        found = smallest(plant.A, plant.B, Disks(disk.centre), method, enough=disk.radius)
        if found.r <= disk.radius:
            inside = proved_at(plant, disk, method, found)
    if inside is not None and inside.runs:
        return inside
    best = smallest_disk(plant, disk.centre, method)[0]
    wider = replace(best.certificate, region=disk)
    holds = radius_of(best) <= disk.radius and wider.holds()
    design = runnable((inside, Design(wider) if holds else None), radius_of)
    if design is not None:
        return design
    if allow_unproved:
        return Design(wider, proved=False)
    raise NotProvedError(_refusal(method, disk, best), best if best.proved else None)


def _refusal(method: Method, region: Disk, best: Design) -> str:
    reached = (
        f"the smallest radius found there is {digits_up(radius_of(best))} (proved)"
        if best.proved
        else "no radius was proved there"
    )
    label = method_label(method)
    if best.lower is not None and best.lower >= region.radius:
        answer = f"refuted for {label}: its inequalities have no solution for {region}"
    else:
        answer = f"not proved: {label} gives no proof for {region}"
    return f"{answer}; {reached}; try a larger disk or another method"


def _in_region(
    plant: UncertainPlant, region: Region, method: Method, allow_unproved: bool
) -> Design:
    """Place the poles in a region that is no single disk."""
    label, found = method_label(method), list[Reached]()
    points = points_in(plant, region, method, found)
    try:
        design = runnable((proved_at(plant, region, method, point) for point in points), radius_of)
    except SolverError as error:
        raise NotProvedError(f"undecided: {label}: {error}") from error
    if design is not None:
        return design
    if allow_unproved:
        return Design(rounded(plant, region, method, found[-1]), proved=False)
    raise NotProvedError(
        f"not proved: {label} gives no proof for {region}; try a wider region, "
        f"fewer parts{degree_hint(method)}; a tuned law ([law] in the spec) may reach further"
    )


def points_in(
    plant: UncertainPlant,
    region: Region,
    method: Method,
    found: list[Reached],
    patches: tuple[Patch, ...] = (),
) -> Iterator[Reached]:
    """Yield points of a region, of slow poles and well inside it first; ``found`` has all of them.

    Parameters
    ----------
    patches : tuple of Patch
        Where the law is given estimates of the parameters.

    Raises
    ------
    SolverError
        If there is none at all.
    """
    failure: SolverError | None = None
    rate = max(region.scale, typical_rate(plant.A))
    speeds = () if region.bounds_speed else [s * rate for s in SPEEDS if s * rate < FASTEST_POLES]
    for searched in (*(bounded(region, speed) for speed in speeds), region):
        for enough in WELL_INSIDE:
            try:
                goal = Around(searched)
                point = _smallest(plant, goal, method, enough=enough, patches=patches)
            except SolverError as error:
                failure = error
                break
            found.append(point)
            if point.r < 1:
                yield point
            elif point.converged:
                break
    if failure is not None and not found:
        raise failure


def _smallest(
    plant: UncertainPlant,
    goal: Goal,
    method: Method,
    near: Reached | None = None,
    enough: float = 0.0,
    tolerance: float = TOLERANCE,
    patches: tuple[Patch, ...] = (),
) -> Reached:
    """Return the least r of a goal, while the parameters move as the plant says."""
    own, motion = (plant.A, plant.B, goal, method, near, enough), Motion.of(plant)
    return smallest(*own, tolerance=tolerance, motion=motion, patches=patches)


def _climb(plant: UncertainPlant, region: Region, method: Scheduled) -> Design:
    """Raise degree and elevation until the region is proved, refuted, or too much work."""
    tried, why = list[str](), "the last that is tried"
    deadline = Deadline(method.budget)
    best: Design | None = None
    refuted = unplaceable(plant, region, method.on)
    if refuted is not None:
        raise NotProvedError(f"refuted: {refuted}")
    for degree, elevation in LADDER:
        step = Scheduled(degree, elevation, method.on)
        domain_count = _unknowns(plant, step)
        if tried and deadline.passed:
            why = str(deadline)
            break
        checkable = is_checkable(plant, step, len(region.parts))
        if not checkable or (tried and domain_count > MOST_UNKNOWNS):
            why = (
                "a higher degree is too much to check"
                if tried
                else "this plant is too large to check"
            )
            break
        tried.append(f"({degree}, {elevation})")
        try:
            return place(plant, region, step)
        except NotProvedError as answer:
            best = _better(best, answer.best)
    reached = f"; the smallest radius proved is {digits_up(radius_of(best))}" if best else ""
    raise NotProvedError(
        f"undecided: not proved for {region} with degree and elevation {', '.join(tried)}; {why}"
        f"{reached}",
        best,
    )


def _unknowns(plant: UncertainPlant, method: Scheduled) -> int:
    (n, m), domain = plant.shape, Domain.of(method.on, len(plant.vertices))
    return domain.count(int(method.degree)) * (n * (n + 1) // 2 + m * n)


def _better(best: Design | None, other: Design | None) -> Design | None:
    if best is None or other is None:
        return best or other
    return min(best, other, key=radius_of)


def tightest(
    plant: UncertainPlant,
    centre: float | None = None,
    method: Method = "scheduled",
    allow_unproved: bool = False,
    *,
    of: str = "disk",
    within: Region | None = None,
    bounds: bool = True,
) -> Design:
    """Design for the smallest region of an LMI: `polefence.tightest` without a structure."""
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_domain(plant, method)
    require_kind(of)
    if options(method).degree == "auto":
        raise InputError("degree = 'auto' is for place; give tightest a number")
    method = fitting(plant, method)
    require_checkable(plant, method)
    if of != "disk":
        if centre is not None:
            raise InputError(f"of = {of!r} has no centre; leave it out")
        return largest(plant, of, method, within)
    if centre is None or within is not None:
        raise InputError("the smallest disk needs a centre, and takes no region within")
    centre = usable_centre(plant, centre)
    require_movable(plant)
    best, _ = smallest_disk(plant, centre, method, bounds)
    if not best.proved and not allow_unproved:
        raise NotProvedError(
            f"undecided: {method_label(method)} at centre {centre:g} gave no point that could be "
            "proved; check the plant's units and try another centre"
        )
    return best


def require_kind(of: str) -> None:
    """Refuse what is no kind of region.

    Raises
    ------
    InputError
        If it is none.
    """
    if of not in ("disk", "half_plane", "sector"):
        raise InputError(f"of = {of!r} is unknown; use 'disk', 'half_plane' or 'sector'")


def smallest_disk(
    plant: UncertainPlant,
    centre: float,
    method: Method,
    bounds: bool = True,
) -> tuple[Design, Reached]:
    """Return the design of the smallest radius, ``proved`` or not, and its point."""
    where = f"{method_label(method)} at centre {centre:g}"
    try:
        found = smallest(plant.A, plant.B, Disks(centre), method)
        if plant.sample_time is not None and abs(centre) + found.r >= 1:
            raise NotProvedError(
                f"not proved: {where}: no disk within the unit circle, the smallest radius found "
                f"is {found.r:.6g}; {plant.name} is hardly controllable at this sample time"
            )
        design = runnable(_designs(plant, centre, method, found), radius_of)
        if design is None:
            unproved = rounded(plant, Disk(centre, found.r), method, found)
            return Design(unproved, proved=False), found
    except SolverError as error:
        raise NotProvedError(f"undecided: {where}: {error}") from error
    lower = bound_of(plant, -centre, method, found) if bounds else None
    return replace(design, lower=lower), replace(found, trails=())


def _designs(
    plant: UncertainPlant, centre: float, method: Method, found: Reached
) -> list[Design | None]:
    """Return designs in the order of their radii; the last is the first that runs, or nearly so.

    Rounding needs room: more of it a step outside the point found, or at a point on the way to it,
    each at its own radius.
    """
    nearest = proved_at(plant, Disk(centre, found.r * (1 + STEPS[0])), method, found)
    if nearest is not None and nearest.runs:  # mostly: what else there is need not be unpacked
        return [nearest]
    candidates = [(found, step) for step in STEPS]
    candidates += [(point, STEPS[0]) for point in found.path() if point.r > found.r]
    candidates.sort(key=lambda own: own[0].r * (1 + own[1]))
    designs: dict[int, Design | None] = {0: nearest}

    def runs(place: int) -> bool:
        if not place:
            return False
        point, step = candidates[place]
        design = proved_at(plant, Disk(centre, point.r * (1 + step)), method, point)
        designs[place] = design
        return design is not None and design.runs

    gallop(len(candidates), runs, close=len(STEPS))
    return [designs[place] for place in sorted(designs)]


@stage("lower bound")
def bound_of(plant: UncertainPlant, sigma: float, method: Method, found: Reached) -> float | None:
    """Return a lower bound, from a closer run where there is a gap, else from a looser one."""
    if not _is_bounded(method):
        return None
    return closer_bound(plant, sigma, method, found, _lower(plant, sigma, method, found))


def closer_bound(
    plant: UncertainPlant, sigma: float, method: Method, found: Reached, lower: float | None
) -> float | None:
    """Return the lower bound of a point, or that of another run where it leaves a gap."""
    if found.r > sigma or (lower is not None and lower > found.r * (1 - GAP)):
        return lower
    for near, tolerance in ((found, CLOSER), (None, EARLIER)):
        with suppress(SolverError):
            own = smallest(plant.A, plant.B, Disks(-sigma), method, near, tolerance=tolerance)
            others = lower, _lower(plant, sigma, method, own)
            lower = max((b for b in others if b), default=None)
        if lower is not None:
            break
    return lower


def _is_bounded(method: Method) -> bool:
    """Whether there are lower bounds for a method: for those of the paper."""
    rhs = isinstance(method, Scheduled) and method.right_hand_sides
    return rhs or isinstance(normal(method), str)


def _lower(plant: UncertainPlant, sigma: float, method: Method, found: Reached) -> float | None:
    """Return a radius proved infeasible for the method, None where no proof came of it."""
    rhs = isinstance(method, Scheduled) and method.right_hand_sides
    method = normal(method)
    if found.dual is None:
        return None
    name, Y = method_name(method), found.dual.matrices()
    close = lower_radius(plant, name, sigma, found.r, Y, rhs)
    # of disks that reach beyond stability rationals find next to nothing more
    if close is not None or (found.r > sigma and is_there()):
        return close
    A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    bound = lower_bound(name, A, B, Fraction(sigma), found.r, Y, rhs)
    return None if bound is None else float(bound.r)


# --- decay rate and damping ratio ----------------------------------------------------------------
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
    require_continuous(plant, of)
    if isinstance(options(method), Slack):
        raise InputError(
            f"the method slack finds disks only; for a {of} use quadratic or scheduled"
        )
    if within is not None:
        require_type(within, Region, "within", "for example polefence.Disk(-40, 39)")
    require_region(plant, HalfPlane(0) if within is None else HalfPlane(0) & within, method)
    require_movable(plant, within)
    within = bounded(within, SPEED * typical_rate(plant.A))
    question = (_decay if of == "half_plane" else _damping)(within)
    design = runnable(_direct(plant, method, question), _value, -1)
    if design is None or not design.runs:
        grown = _grown(plant, method, question, running=design is not None)
        design = runnable((design, grown), _value, -1)
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
    return next(iter(design.region.parts[0].numbers.values()))


def _direct(plant: UncertainPlant, method: Method, question: _Question) -> Iterator[Design | None]:
    """Yield what is proved about the least r, while the search comes to its end."""
    with suppress(SolverError):
        start = _smallest(plant, Around(question.base), method, enough=INSIDE)
        if start.r >= 1:
            return
        near = replace(start, r=0.0)
        for tolerance in TOLERANCES:
            found = _smallest(plant, question.goal, method, near, tolerance=tolerance)
            if not found.converged:
                return
            for step in (*STEPS, 1e-3):
                region = question.region(question.value(found.r, step))
                yield proved_at(plant, region, method, found)


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
        found = _smallest(plant, Around(region), method, enough=INSIDE)
        return proved_at(plant, region, method, found) if found.r < 1 else None
    return None


def proved_at(
    plant: UncertainPlant, region: Region, method: Method, found: Reached
) -> Design | None:
    """Return the design of a point for a region, None where it is not proved."""
    try:
        design = Design(rounded(plant, region, method, found))
    except SolverError:
        return None
    return design if design.certificate.holds() else None


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
    if region.circle is None:
        # e is in units of the search's own time
        evidence["epsilon"] = o.epsilon / found.rate
    return FixedGain(right_divide(values["L"], values["G"])), evidence


_LAWS: dict[str, Callable[..., tuple[FixedGain | ScheduledGain, _Evidence]]] = {
    "quadratic": _quadratic,
    "scheduled": _scheduled,
    "slack": _slack,
}


def radius_of(design: Design) -> float:
    """Return the radius of a design's disk."""
    return float(getattr(design.region, "radius", math.inf))
