"""What may be asked of a plant: methods, domains, regions and centres that fit it."""

from __future__ import annotations

from polefence.conditions.methods import Method, method_name, options
from polefence.errors import InputError, RegionError
from polefence.plant.family import UncertainPlant
from polefence.region import Disk, Region, check_centre


def require_type(value: object, kind: type, name: str, remedy: str) -> None:
    """Refuse a value of another type, with a remedy."""
    if not isinstance(value, kind):
        given = type(value).__name__
        raise InputError(f"{name} must be of type {kind.__name__}, not {given}; {remedy}")


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


def require_region(plant: UncertainPlant, region: Region) -> None:
    """Refuse regions of the other kind of time."""
    disks = [part for part in region.parts if isinstance(part, Disk)]
    if plant.sample_time is None:
        for disk in disks:
            check_centre(disk.centre)
    elif len(disks) < len(region.parts) or not all(disk.discrete for disk in disks):
        raise RegionError(
            f"{region}: {plant.name} is a discrete-time plant; give a disk inside the unit circle, "
            "for example disk(0.5, 0.4)"
        )


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
