"""Laws of an LMI: for a region, or for the smallest of a kind that a method reaches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, SolverError
from polefence.base.progress import stage
from polefence.certify.candidates import Deadline, gallop
from polefence.certify.certificate import Certificate
from polefence.certify.checks import (
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
    bounded,
    damping_of,
)
from polefence.region.text import digits_up
from polefence.search.driver import Kind, Source, placed

# Degree and elevation that "auto" tries, while there are at most so many unknowns.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1), (4, 0), (4, 1), (5, 1))

# How far above the r that a point reaches in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4)

# How many times the plant's own rates poles may be fast, where nothing else bounds them.
SPEED = 100.0

LEAST, MOST = 1e-8, 1 - 1e-9  # damping ratios

_Evidence = dict[str, Any]


def source(plant: UncertainPlant, method: Method, region: Region, central: bool = False) -> Source:
    """Return the laws of a method for a region, each proved by the matrices of its own point.

    Parameters
    ----------
    central : bool
        Whether the first law of a disk is that of its centre, as far from all edges as can be: what
        a remainder leaves to prove is not to hang on where a search stops.

    Raises
    ------
    PolefenceError
        If plant, method and region do not fit.
    """
    require_domain(plant, method)
    method = fitting(plant, method)
    require_region(plant, region, method)
    require_movable(plant, region)
    require_checkable(plant, method, len(region.parts))

    def laws(inside: Region) -> Iterator[Certificate]:
        if inside.circle is None:
            return laws_in(plant, inside, method)
        return _laws_in_disk(plant, inside, method, central)

    return Source(plant, laws, proved, lambda region: _refusal(method, region))


def proved(certificate: Certificate, region: Region) -> Design | None:
    """Return the design of a point's law for a region, None where its matrices do not prove it."""
    claimed = replace(certificate, region=region)
    return Design(claimed) if claimed.holds() else None


def _laws_in_disk(
    plant: UncertainPlant, disk: Region, method: Method, central: bool
) -> Iterator[Certificate]:
    """Yield the law of a point inside a disk, and of the smallest disk of the same centre."""
    centre, radius = disk.circle or (0.0, 0.0)
    with suppress(SolverError):
        goal = Disks(centre)
        point = smallest(plant.A, plant.B, goal, method, enough=radius, central=central)
        if point.r <= radius:
            yield rounded(plant, disk, method, point)
    best = smallest_disk(plant, centre, method)[0]
    if radius_of(best) > radius:
        raise _refusal(method, disk, best)
    yield best.certificate


def laws_in(
    plant: UncertainPlant,
    region: Region,
    method: Method,
    patches: tuple[Patch, ...] = (),
    refusal: NotProvedError | None = None,
) -> Iterator[Certificate]:
    """Yield laws that keep a region, of slow poles and well inside it first.

    Parameters
    ----------
    patches : tuple of Patch
        Where the law is given estimates of the parameters.
    refusal : NotProvedError, optional
        What is said where there is none.

    Raises
    ------
    NotProvedError
        If there is none.
    """
    failure: SolverError | None = None
    points = list[Reached]()
    rate = max(region.scale, typical_rate(plant.A))
    speeds = [s * rate for s in (10.0, 100.0, 1000.0) if s * rate < 1e99]
    if region.bounds_speed:
        speeds = []
    for searched in (*(bounded(region, speed) for speed in speeds), region):
        for enough in (0.98, 0.0):  # well inside first, then as far as the search goes
            try:
                goal = Around(searched)
                point = _smallest(plant, goal, method, enough=enough, patches=patches)
            except SolverError as error:
                failure = error
                break
            points.append(point)
            if point.r < 1:
                with suppress(SolverError):
                    yield rounded(plant, region, method, point)
            elif point.converged:
                break
    if failure is not None and not points:
        raise NotProvedError(f"undecided: {method_label(method)}: {failure}") from failure
    if all(point.r >= 1 for point in points):
        raise refusal or _refusal(method, region)


def unproved(plant: UncertainPlant, method: Method, region: Region) -> Design:
    """Return the law that comes nearest to keeping a region, where no proof came of it.

    Raises
    ------
    SolverError
        If there is none in floats.
    """
    method = fitting(plant, method)
    if region.circle is not None:
        best = smallest_disk(plant, region.circle[0], method)[0].certificate
        return Design(replace(best, region=region), proved=False)
    return Design(
        rounded(plant, region, method, _smallest(plant, Around(region), method)), proved=False
    )


def _refusal(method: Method, region: Region, best: Design | None = None) -> NotProvedError:
    """Return why a region is not proved, with the smallest disk of its centre where it has one."""
    label = method_label(method)
    if best is None:
        return NotProvedError(
            f"not proved: {label} gives no proof for {region}; try a wider region, "
            f"fewer parts{degree_hint(method)}; a tuned law ([law] in the spec) may reach further"
        )
    reached = (
        f"the smallest radius found there is {digits_up(radius_of(best))} (proved)"
        if best.proved
        else "no radius was proved there"
    )
    if best.lower is not None and best.lower >= region.size:
        answer = f"refuted for {label}: its inequalities have no solution for {region}"
    else:
        answer = f"not proved: {label} gives no proof for {region}"
    said = f"{answer}; {reached}; try a larger disk or another method"
    return NotProvedError(said, best if best.proved else None)


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
    problem, motion = (plant.A, plant.B, goal, method, near, enough), Motion.of(plant)
    return smallest(*problem, tolerance=tolerance, motion=motion, patches=patches)


def climb(
    plant: UncertainPlant,
    region: Region,
    method: Scheduled,
    place: Callable[[Method], Design],
) -> Design:
    """Raise degree and elevation until the region is proved, refuted, or too much work.

    Raises
    ------
    NotProvedError
        If it is not proved; its ``best`` is the smallest disk that is.
    """
    tried, why = list[str](), "the last that is tried"
    deadline = Deadline(method.budget)
    best: Design | None = None
    refuted = unplaceable(plant, region, method.on)
    if refuted is not None:
        raise NotProvedError(f"refuted: {refuted}")
    for degree, elevation in LADDER:
        step = Scheduled(degree, elevation, method.on)
        if tried and deadline.passed:
            why = str(deadline)
            break
        checkable = is_checkable(plant, step, len(region.parts))
        if not checkable or (tried and _unknowns(plant, step) > 1500):
            why = (
                "a higher degree is too much to check"
                if tried
                else "this plant is too large to check"
            )
            break
        tried.append(f"({degree}, {elevation})")
        try:
            return place(step)
        except NotProvedError as answer:
            designs = [design for design in (best, answer.best) if design is not None]
            best = min(designs, key=radius_of, default=None)
    reached = f"; the smallest radius proved is {digits_up(radius_of(best))}" if best else ""
    raise NotProvedError(
        f"undecided: not proved for {region} with degree and elevation {', '.join(tried)}; {why}"
        f"{reached}",
        best,
    )


def _unknowns(plant: UncertainPlant, method: Scheduled) -> int:
    (n, m), domain = plant.shape, Domain.of(method.on, len(plant.vertices))
    return domain.count(int(method.degree)) * (n * (n + 1) // 2 + m * n)


def tightest(
    plant: UncertainPlant, kind: Kind, method: Method, *, bounds: bool = True, proved: bool = True
) -> Design:
    """Return the smallest region of a kind that a method reaches.

    Parameters
    ----------
    bounds : bool
        Whether to look for the lower bound of a radius.
    proved : bool
        Whether to refuse a disk without a proof.

    Raises
    ------
    NotProvedError
        If none is proved.
    InputError
        If plant, method and kind do not fit.
    """
    require_domain(plant, method)
    if options(method).degree == "auto":
        raise InputError("degree = 'auto' is for place; give tightest a number")
    method = fitting(plant, method)
    require_checkable(plant, method)
    if kind.centre is None:
        return _largest(plant, kind, method)
    centre = usable_centre(plant, kind.centre)
    require_movable(plant)
    best, _ = smallest_disk(plant, centre, method, bounds)
    if proved and not best.proved:
        raise NotProvedError(
            f"undecided: {method_label(method)} at centre {centre:g} gave no point that could be "
            "proved; check the plant's units and try another centre"
        )
    return best


def smallest_disk(
    plant: UncertainPlant,
    centre: float,
    method: Method,
    bounds: bool = True,
) -> tuple[Design, Reached]:
    """Return the design of the smallest radius, ``proved`` or not, and its point."""
    where = f"{method_label(method)} at centre {centre:g}"
    try:
        point = smallest(plant.A, plant.B, Disks(centre), method)
        if plant.sample_time is not None and abs(centre) + point.r >= 1:
            raise NotProvedError(
                f"not proved: {where}: no disk within the unit circle, the smallest radius found "
                f"is {point.r:.6g}; {plant.name} is hardly controllable at this sample time"
            )
        design = Kind("disk", centre).runnable(_designs(plant, centre, method, point))
        if design is None:
            unproved = rounded(plant, Disk(centre, point.r), method, point)
            return Design(unproved, proved=False), point
    except SolverError as error:
        raise NotProvedError(f"undecided: {where}: {error}") from error
    lower = bound_of(plant, -centre, method, point) if bounds else None
    return replace(design, lower=lower), replace(point, trails=())


def _designs(
    plant: UncertainPlant, centre: float, method: Method, reached: Reached
) -> list[Design | None]:
    """Return designs in the order of their radii; the last is the first that runs, or nearly so.

    Rounding needs room: more of it a step outside the point found, or at a point on the way to it,
    each at its own radius.
    """
    nearest = proved_at(plant, Disk(centre, reached.r * (1 + STEPS[0])), method, reached)
    if nearest is not None and nearest.runs:  # mostly: what else there is need not be unpacked
        return [nearest]
    candidates = [(reached, step) for step in STEPS]
    candidates += [(point, STEPS[0]) for point in reached.path() if point.r > reached.r]
    candidates.sort(key=lambda candidate: candidate[0].r * (1 + candidate[1]))
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
def bound_of(plant: UncertainPlant, sigma: float, method: Method, point: Reached) -> float | None:
    """Return a lower bound, from a closer run where there is a gap, else from a looser one."""
    if not _is_bounded(method):
        return None
    return closer_bound(plant, sigma, method, point, _lower(plant, sigma, method, point))


def closer_bound(
    plant: UncertainPlant, sigma: float, method: Method, point: Reached, lower: float | None
) -> float | None:
    """Return the lower bound of a point, or that of another run where it leaves a gap."""
    if point.r > sigma or (lower is not None and lower > point.r * (1 - 9e-7)):
        return lower
    # the second ends farther inside, where the ends have no bound
    for near, tolerance in ((point, 1e-10), (None, 1e-6)):
        with suppress(SolverError):
            closer = smallest(plant.A, plant.B, Disks(-sigma), method, near, tolerance=tolerance)
            others = lower, _lower(plant, sigma, method, closer)
            lower = max((b for b in others if b), default=None)
        if lower is not None:
            break
    return lower


def _is_bounded(method: Method) -> bool:
    """Whether there are lower bounds for a method: for those of the paper."""
    rhs = isinstance(method, Scheduled) and method.right_hand_sides
    return rhs or isinstance(normal(method), str)


def _lower(plant: UncertainPlant, sigma: float, method: Method, point: Reached) -> float | None:
    """Return a radius proved infeasible for the method, None where no proof came of it."""
    rhs = isinstance(method, Scheduled) and method.right_hand_sides
    method = normal(method)
    if point.dual is None:
        return None
    name, Y = method_name(method), point.dual.matrices()
    close = lower_radius(plant, name, sigma, point.r, Y, rhs)
    # of disks that reach beyond stability rationals find next to nothing more
    if close is not None or (point.r > sigma and is_there()):
        return close
    A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    bound = lower_bound(name, A, B, Fraction(sigma), point.r, Y, rhs)
    return None if bound is None else float(bound.r)


# --- decay rate and damping ratio ----------------------------------------------------------------
def _largest(plant: UncertainPlant, kind: Kind, method: Method) -> Design:
    """Return the design of the largest decay rate ("half_plane") or damping ratio ("sector").

    With nothing to bound the poles' speed a high gain may do ever better, and no optimum be
    attained. So where ``within`` does not bound it, a disk that reaches to `SPEED` times the
    plant's rates does. Should the direct search fail, values are tried from region to region.
    """
    require_continuous(plant, kind.of)
    if isinstance(options(method), Slack):
        raise InputError(
            f"the method slack finds disks only; for a {kind.of} use quadratic or scheduled"
        )
    within = kind.within
    require_region(plant, HalfPlane(0) if within is None else HalfPlane(0) & within, method)
    require_movable(plant, within)
    within = bounded(within, SPEED * typical_rate(plant.A))
    kind = replace(kind, within=within)
    design = kind.runnable(_direct(plant, method, kind, within))
    if design is not None and design.runs:
        return design

    def attempt(region: Region) -> Design:
        candidate = placed(region, source(plant, method, region))
        if design is not None and not candidate.runs:
            raise NotProvedError("not proved of a law that doubles can run")
        return candidate

    low, high, first = LEAST, MOST, 0.1
    if kind.of == "half_plane":
        low, high, first = -within.scale, FASTEST * within.scale, within.scale / 4
    grown: Design | None = None
    with suppress(NotProvedError):
        grown = kind.climbed(attempt, low, high, first)
    best = kind.runnable((design, grown))
    if best is None:
        wanted = "decay rate" if kind.of == "half_plane" else "damping ratio"
        raise NotProvedError(
            f"not proved: {method_label(method)} gives no proof of a {wanted} from "
            f"{low:g} up within {within}; try a wider region{degree_hint(method)}"
        )
    return best


def _direct(
    plant: UncertainPlant, method: Method, kind: Kind, within: Region
) -> Iterator[Design | None]:
    """Yield what is proved about the least r, nearest first."""
    fastest = FASTEST * within.scale
    decays = kind.of == "half_plane"
    base = within if decays else HalfPlane(0) & within
    goal = Decays(fastest, within) if decays else Sectors(within.scale, within)
    with suppress(SolverError):
        start = _smallest(plant, Around(base), method, enough=0.98)
        if start.r >= 1:
            return
        near = replace(start, r=0.0)
        point = _smallest(plant, goal, method, near, tolerance=1e-10)
        if not point.converged:
            return
        for step in (*STEPS, 1e-3):
            r = point.r * (1 + step)
            value = kind.wider(fastest - r, step) if decays else damping_of(r)
            region = kind.region(value if decays else min(max(value, LEAST), MOST))
            yield proved_at(plant, region, method, point)


def proved_at(
    plant: UncertainPlant, region: Region, method: Method, point: Reached
) -> Design | None:
    """Return the design of a point for a region, None where it is not proved."""
    try:
        design = Design(rounded(plant, region, method, point))
    except SolverError:
        return None
    return design if design.certificate.holds() else None


def rounded(plant: UncertainPlant, region: Region, method: Method, point: Reached) -> Certificate:
    """Round a point to the law and evidence that ship; the proof is about these very numbers.

    Raises
    ------
    SolverError
        If a Lyapunov or slack matrix is singular in floats.
    """
    name = method_name(method)
    try:
        law, evidence = _LAWS[name](plant, region, method, point)
    except np.linalg.LinAlgError as error:
        raise SolverError("a Lyapunov matrix is numerically singular") from error
    return Certificate(plant, region, name, law, evidence)


def _quadratic(*args: Any) -> tuple[FixedGain, dict[str, Any]]:
    values = args[3].values
    return FixedGain(right_divide(values["Z"], values["W"])), {"W": values["W"]}


def _scheduled(
    plant: UncertainPlant, _: Region, method: Method, point: Reached
) -> tuple[ScheduledGain, dict[str, Any]]:
    o, values = options(method), point.values
    degree, domain = int(o.degree), Domain.of(o.on, len(plant.vertices))
    W, Z = coefficients(values, "W"), coefficients(values, "Z")
    evidence: dict[str, Any] = {"tau": np.array(values["tau"].item() if "tau" in values else 0.0)}
    if o.elevation != 1:
        evidence["elevation"] = o.elevation
    return ScheduledGain(W, Z, plant.parameters, degree, domain.sizes), evidence


def _slack(
    _: UncertainPlant, region: Region, method: Method, point: Reached
) -> tuple[FixedGain, dict[str, Any]]:
    method, values = normal(method), point.values
    o = method if isinstance(method, Slack) else Slack()
    evidence: dict[str, Any] = {"P": coefficients(values, "P"), "G": values["G"]}
    if isinstance(method, Slack):
        evidence |= {"degree": o.degree, "elevation": o.elevation, "on": o.on}
    if region.circle is None:
        # e is in units of the search's own time
        evidence["epsilon"] = o.epsilon / point.rate
    return FixedGain(right_divide(values["L"], values["G"])), evidence


_LAWS: dict[str, Callable[..., tuple[FixedGain | ScheduledGain, _Evidence]]] = {
    "quadratic": _quadratic,
    "scheduled": _scheduled,
    "slack": _slack,
}


def radius_of(design: Design) -> float:
    """Return the radius of a design's disk."""
    return float(getattr(design.region, "radius", math.inf))
