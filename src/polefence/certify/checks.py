"""Checks of a question about a plant: methods, domains, regions and centres that fit it."""

from __future__ import annotations

from collections.abc import Collection

from polefence.base.errors import InputError, RegionError, UncontrollableError
from polefence.lmi.conditions.methods import (
    MOST_BLOCKS,
    Method,
    Slack,
    blocks,
    is_searchable,
    method_label,
    method_name,
    normal,
    options,
    step_work,
)
from polefence.lmi.solve.lyapunov import MOST_STATES
from polefence.plant.controllability import FixedModes, modes_text
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.polynomial import Domain
from polefence.plant.weights import weights_poles
from polefence.proof import matrices, roots, work
from polefence.proof.plant import OF_WEIGHT
from polefence.proof.reading import MAX_SIZE
from polefence.proof.regions import parts_of
from polefence.proof.text import digits_down
from polefence.region.regions import Disk, HalfPlane, Region, astray, check_centre, stable
from polefence.region.z_plane import z_plane

# Multiplications of one step of a search for a law with specifications.
MOST_OPTIMISED_STEP = 1.5e10


def require_moderate(plant: UncertainPlant) -> None:
    """Refuse plants for which no law is sought, before anything is begun.

    Raises
    ------
    InputError
        Naming the number of states.
    """
    n = plant.shape[0]
    if n > MOST_STATES:
        raise InputError(
            f"{plant.name}: {n} states; laws are sought for at most {MOST_STATES}. Reduce the "
            f"model, and analyse its law with the whole plant: analyse takes up to {MAX_SIZE}"
        )


def require_domain(plant: UncertainPlant, method: Method) -> None:
    """Refuse methods that there are not, and boxes where the plant has no parameters.

    Raises
    ------
    InputError
        Naming what is wrong.
    """
    method_name(method)
    if options(method).on == "box" and not plant.parameters:
        raise InputError(
            f"on = 'box' needs parameters; {plant.name} is given by its vertices, use on='simplex'"
        )


def is_checkable(plant: UncertainPlant, method: Method, parts: int = 1) -> bool:
    """Whether search and exact checker take on as many inequalities as the method has."""
    if not is_searchable(plant, method):
        return False
    size = 2 * plant.shape[0] * (2 if method_name(method) == "slack" else 1)
    return matrices.least_work(blocks(plant, method) * parts, size) <= work.MAX_WORK


def require_checkable(plant: UncertainPlant, method: Method, parts: int = 1) -> None:
    """Refuse what would never be proved, before it is searched for.

    Raises
    ------
    InputError
        Naming the number of inequalities.
    """
    if not is_checkable(plant, method, parts):
        raise InputError(
            f"{plant.name}, {method_label(method)}: {blocks(plant, method)} inequalities in "
            f"{plant.shape[0]} states are too many to search and prove; "
            f"{_remedy(plant, method)}"
        )


def is_optimisable(plant: UncertainPlant, method: Method, count: int) -> bool:
    """Whether a law for so many specifications is looked for by the method's inequalities.

    Each specification adds about as much to a step as the region, and there are some hundreds.
    """
    several = blocks(plant, method) * (count + 1) <= MOST_BLOCKS
    return several and step_work(plant, method) * (count + 1) <= MOST_OPTIMISED_STEP


def require_optimisable(plant: UncertainPlant, method: Method, count: int) -> None:
    """Refuse what would take hours to optimise, before it is begun.

    Raises
    ------
    InputError
        Naming the number of inequalities.
    """
    if not is_optimisable(plant, method, count):
        raise InputError(
            f"{plant.name}, {method_label(method)}: {blocks(plant, method) * (count + 1)} "
            f"inequalities in {plant.shape[0]} states, for {count} specifications and the region, "
            f"are too many to optimise; {_remedy(plant, method)}; a tuned law needs none of them: "
            "leave the method out"
        )


def _remedy(plant: UncertainPlant, method: Method) -> str:
    """Say what a method of fewer inequalities would be."""
    o = options(method)
    remedies = []
    if plant.parameters and o.on != "box" and int(o.degree):
        remedies.append("ask for it on the box")
    if o.elevation:
        remedies.append("for elevation 0")
    if int(o.degree) > 1:
        remedies.append("for degree 1")
    if normal(method) != "quadratic":
        remedies.append("for the method quadratic")
    return f"{', '.join(remedies) or 'ask for'}{' or' if remedies else ''} fewer parameters"


def require_region(plant: UncertainPlant, region: Region, method: Method | None = None) -> None:
    """Refuse regions of the other kind of time, or that the method does not take."""
    if getattr(method, "right_hand_sides", False) and not region.circle:
        raise InputError(f"right_hand_sides belong to one disk, not to {region}; leave them out")
    if plant.moving and decays(plant, region) and method is not None:
        chosen = options(method)
        if isinstance(chosen, Slack):
            raise InputError(
                f"the method slack keeps no {region} while {plant.moving[0].name} moves; take "
                "quadratic or scheduled"
            )
        if int(chosen.degree if chosen.degree != "auto" else 1) and chosen.on != "box":
            Motion.of(plant).require(Domain.of(chosen.on, len(plant.vertices)))
    _require_late(plant, region, method)
    disks = [part for part in region.parts if part.circle]
    if plant.sample_time is None:
        part = astray(region)
        if part is not None:
            raise RegionError(
                f"{part}: centre = {part.numbers['centre']:g} is not in the left half-plane, and "
                f"{plant.name} is in continuous time; give a negative centre (-40), or add "
                "& half_plane(0)"
            )
    elif not disks or not all(disk.discrete for disk in disks):
        raise RegionError(
            f"{region}: {plant.name} is a discrete-time plant; give a disk in the unit disk, for "
            "example disk(0.5, 0.4), or disk(0, 1) for stability alone"
        )


def _require_late(plant: UncertainPlant, region: Region, method: Method | None) -> None:
    """Refuse regions in which the poles of a loop with a dead time cannot all be, and methods."""
    if plant.dead_time is None:
        return
    if method is not None and normal(method) != "quadratic":
        raise InputError(
            f"{plant.name} has a dead time, and a law of the method {method_name(method)} would "
            "depend on what stands for it; take quadratic, or a structure ([law])"
        )
    dead_time = plant.dead_time[1]
    if any(not isinstance(p, HalfPlane) or p.decay > dead_time.decay for p in region.parts):
        most = digits_down(dead_time.decay, 4)
        raise RegionError(
            f"{region}: with {dead_time.signal!r} late there are infinitely many poles; give "
            f"half_plane(a) with a at most {most} 1/s, the decay of its dead time"
        )


def decays(plant: UncertainPlant, region: Region) -> list[float]:
    """Return how fast motions decay, as its parts say: half-planes, or disks about 0 by a sample.

    Decay rates [1/s], in discrete time factors.
    """
    if plant.sample_time is None:
        return [part.decay for part in region.parts if isinstance(part, HalfPlane)]
    return [p.size for p in region.parts if p.circle and not p.circle[0]]


def in_time_of(plant: UncertainPlant, region: Region) -> Region:
    """Return a region as the poles of this plant have it: for discrete time in the z-plane.

    Raises
    ------
    RegionError
        If a part has no image there.
    """
    if plant.sample_time is None:
        return region
    try:
        return z_plane(region, plant.sample_time)
    except RegionError as problem:
        raise RegionError(f"{plant.name} is in discrete time: {problem}") from problem


def require_continuous(plant: UncertainPlant, of: str) -> None:
    """Refuse questions for the largest decay rate or damping ratio in discrete time.

    Raises
    ------
    InputError
        With the question to ask instead.
    """
    if plant.sample_time is not None:
        raise InputError(
            f"{plant.name} is in discrete time, where {of} has no direct search; ask for the "
            "smallest disk about 0: its radius r decays with -ln(r)/T"
        )


def implies_stability(plant: UncertainPlant, region: Region) -> bool:
    """Whether poles in a region that fits the plant's kind of time are stable ones."""
    if plant.sample_time is None:
        return region.stable
    return region.discrete


def example_centre(plant: UncertainPlant) -> str:
    """Return a centre that suits the plant's kind of time, for a message."""
    return "-40" if plant.sample_time is None else "0.5"


def example_region(plant: UncertainPlant) -> str:
    """Return a region that suits the plant's kind of time, for a message."""
    return "disk(-40, 31)" if plant.sample_time is None else "disk(0.5, 0.4)"


def require_movable(plant: UncertainPlant, region: Region | None = None) -> None:
    """Refuse plants with a mode that no input moves and that is not in the region.

    Parameters
    ----------
    region : Region, optional
        Where it is not given, what is stable for the plant's kind of time.

    Raises
    ------
    UncontrollableError
        Naming the first vertex, and the mode.
    """
    if plant.surely_controllable:
        return
    asked = stable_region(plant) if region is None else region
    for vertex in plant.vertices:
        outside = modes_outside(vertex.fixed, asked)
        if outside is not None:
            n, rank = vertex.shape[0], vertex.shape[0] - vertex.fixed.count
            weight = weight_outside(plant, asked)
            if weight is not None:
                raise UncontrollableError(
                    f"{plant.name}: {weight[1]}, and no gain moves it; widen the region, or move "
                    "the pole of the weight"
                )
            where, many = _where_not(plant, asked), "s" if vertex.fixed.count > 1 else ""
            raise UncontrollableError(
                f"{plant.name}, {vertex.name} is uncontrollable: its inputs reach {rank} of {n} "
                f"state dimensions, and no gain moves the pole{many} {outside}, {where}; widen the "
                "region, remove those states or add an input"
            )


def weight_outside(
    plant: UncertainPlant, region: Region, measured: Collection[str] = ()
) -> tuple[str, str] | None:
    """Return the name of a weight with a pole outside a region, and the pole in words; or None.

    Parameters
    ----------
    measured : collection of str
        States of weights that a law measures, and may move.
    """
    for name, poles in weights_poles(plant).items():
        outside = poles[region.distance(poles) >= -1e-9 * region.size]
        seen = any(x.startswith(OF_WEIGHT) and x.endswith(f" of {name}") for x in measured)
        if len(outside) and not seen:
            where = _where_not(plant, region)
            return name, f"the weight of {name!r} has the pole {modes_text(outside)}, {where}"
    return None


def _where_not(plant: UncertainPlant, region: Region) -> str:
    return "not stable" if is_stability(plant, region) else f"not in {region}"


def stable_region(plant: UncertainPlant) -> Region:
    """Return where the poles of stable loops lie."""
    return HalfPlane(0) if plant.sample_time is None else Disk(0, 1)


def is_stability(plant: UncertainPlant, region: Region) -> bool:
    """Whether a region is where the poles of stable loops lie, of a delta form too."""
    step = float(plant.step)
    return region == (stable(step) if step else stable_region(plant))


def modes_outside(fixed: FixedModes, region: Region) -> str | None:
    """Name fixed modes that are not in a region, None where all are, or too much work to tell."""
    if not fixed.count:
        return None
    parts = parts_of(region.document())
    try:
        with work.counted():
            if roots.roots_inside(list(fixed.polynomial), parts, fixed.whole):
                return None
    except work.FormatError:
        return None
    values = fixed.values
    outside = values[region.distance(values) >= -1e-9 * region.size]
    return modes_text(outside if len(outside) else values) or "of long digits"


def usable_centre(plant: UncertainPlant, centre: float) -> float:
    """Return the centre of disks for this plant as a float.

    Raises
    ------
    RegionError
        If it is not in the left half-plane, or for a discrete-time plant not in the unit circle.
    """
    if plant.sample_time is None:
        return check_centre(centre)
    if not Disk(centre, 1e-9).discrete:
        raise RegionError(f"centre = {centre:g} is not inside the unit circle; use one nearer to 0")
    return float(centre)
