"""What is asked of a law: the requirements of a spec, with those of lines beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from polefence.base.errors import InputError, SpecError
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import disturbances
from polefence.plant.vehicle import ACCELERATION
from polefence.proof.text import quoted
from polefence.requirements.specification import Specification, disturbance
from polefence.requirements.text import (
    RoadSpectrum,
    load_specifications,
    parse_specification,
    with_wheels,
)

COMFORT = f"rms of {ACCELERATION}"  # what is minimised of a quarter car that asks for nothing


def wanted(
    plant: UncertainPlant,
    spec: str | Path,
    minimise: str | None = None,
    limits: Sequence[str] = (),
    road: RoadSpectrum | None = None,
    options: tuple[str, str] = ("--minimise", "--limit"),
) -> tuple[Specification | None, tuple[Specification, ...]]:
    """Return the requirement to minimise, if any, and the limits, of a spec and of these lines.

    Parameters
    ----------
    minimise : str, optional
        In place of what the spec minimises.
    limits : sequence of str
        Beside those of the spec, or in place of one on the same kind and signal.
    road : RoadSpectrum, optional
        In place of the spec's.
    options : tuple of two str
        What these lines are called in messages.

    Raises
    ------
    InputError
        Naming the specification that cannot be used.
    """
    of_least, of_limit = options
    least, written, road = _of_spec(plant, spec, road)
    every = (*written, *([least] if least else []))
    known = densities_of(every)
    if minimise is not None:
        least = in_units(_parsed(plant, minimise, of_least, road, known), written)
        if least.at_most is not None:
            raise InputError(f"{of_least} {minimise!r} has a limit; give it by {of_limit}")
    asked = dict[str, Specification]()
    for limit in written:
        if limit.title in asked:
            envelope = getattr(limit, "envelope", ())
            remedy = "write one envelope that lies in both" if envelope else "keep the lower one"
            raise SpecError(f"{spec}: two limits on {limit.title}; {remedy}")
        asked[limit.title] = limit
    given = set[str]()
    for text in limits:
        limit = in_units(_parsed(plant, text, of_limit, road, known), written)
        if limit.at_most is None:
            raise InputError(f"{of_limit} {text!r} has no limit; write for example {text!r} <= 1")
        if limit.title in given:
            raise InputError(f"{of_limit}: {limit.title} is given twice; give it once")
        given.add(limit.title)
        asked[limit.title] = limit
    if least is None and not asked:
        raise InputError(
            f"{spec}: nothing is asked; give {of_least} 'rms of SIGNAL' or {of_limit} 'rms of "
            "SIGNAL <= LIMIT', or write [[specification]] tables"
        )
    return least, tuple(asked.values())


def promised(
    plant: UncertainPlant, spec: str | Path, limits: Sequence[str], option: str
) -> tuple[Specification, ...]:
    """Return the requirements on a given law: these lines, or all of the spec's.

    Parameters
    ----------
    limits : sequence of str
        One without a limit asks for the least bound that can be proved, as ``minimise`` of the spec
        does.
    option : str
        What these lines are called in messages.

    Raises
    ------
    InputError
        Naming the specification that cannot be used.
    """
    least, written, road = _of_spec(plant, spec, None)
    every = (*written, *([least] if least else []))
    known = densities_of(every)
    if not limits:
        return every
    return tuple(in_units(_parsed(plant, text, option, road, known), written) for text in limits)


def _of_spec(
    plant: UncertainPlant, spec: str | Path, road: RoadSpectrum | None
) -> tuple[Specification | None, tuple[Specification, ...], RoadSpectrum | None]:
    """Return what a spec minimises, its limits, and the road that they are meant on."""
    least, written = load_specifications(spec, road)
    road = with_wheels(road, spec)
    if road is not None:
        _require_wheels(plant, spec, road)
        written = tuple(road.acting(limit, plant) for limit in written)
        least = None if least is None else road.acting(least, plant)
    written = tuple(_begun(limit, plant) for limit in written)
    least = least and _begun(least, plant)
    for requirement in (*written, *([least] if least else [])):
        _known(plant, requirement, str(spec), road)
    return least, written, road


def _require_wheels(plant: UncertainPlant, spec: str | Path, road: RoadSpectrum) -> None:
    """Refuse a road under unknown wheels."""
    disturbance(plant)
    for name in () if road.in_tracks else road.under:
        if name not in [w.name for w in disturbances(plant)]:
            raise SpecError(f"{spec}: road: under: {plant.name} has no disturbance {quoted(name)}")


def _begun(requirement: Specification, plant: UncertainPlant) -> Specification:
    """Return what a spec asks of a plant, at its sample time: no input is on its way at first."""
    if plant.sampling is None:
        return requirement
    n = plant.sampling.plant.shape[0]
    return requirement.extended(n, plant.shape[0] - n)


def densities_of(written: Sequence[Specification]) -> dict[str, float]:
    """Return the density by signal, as the spec's tables have it."""
    return {r.name: d for r in written if (d := r.noise_density) is not None}


def in_units(requirement: Specification, limits: Sequence[Specification]) -> Specification:
    """Return a gain norm of a line, which has no units, in those that the spec's limit has."""
    same = next((limit for limit in limits if limit.kind == requirement.kind), None)
    return requirement if same is None else requirement.in_units_of(same)


def _parsed(
    plant: UncertainPlant,
    text: str,
    option: str,
    road: RoadSpectrum | None,
    known: Mapping[str, float],
) -> Specification:
    try:
        requirement = parse_specification(text, road, known)
        requirement = requirement if road is None else road.acting(requirement, plant)
    except InputError as error:
        raise InputError(f"{option} {error}") from error
    _known(plant, requirement, f"{option} {text!r}", road)
    return requirement


def _known(
    plant: UncertainPlant, requirement: Specification, where: str, road: RoadSpectrum | None
) -> None:
    """Refuse an unknown signal, a plant without disturbances, and an ambiguous road."""
    try:
        requirement.require_fit(plant)
        if road is not None and requirement.noise_density == road.density:
            acting: Sequence[float] = plant.physical
            if requirement.disturbances is not None:
                acting = requirement.scales(plant) or (1.0,) * plant.disturbance_count
            pairs = zip(disturbances(plant), acting, strict=True)
            names = [w.name for w, acts in pairs if acts]
            if len(names) != 1 and not set(names) <= set(road.under):
                raise InputError(
                    f"{plant.name} has {len(names)} disturbances; a road is one; name those that "
                    "are roads, each by itself, by under = [NAMES] in [road], or give density, or "
                    "disturbances = [NAME] (on a line: from [NAME])"
                )
    except InputError as error:
        raise type(error)(f"{where}: {error}") from error
