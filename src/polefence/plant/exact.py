"""A plant in exact numbers, as files and their proofs have it."""

from __future__ import annotations

from dataclasses import asdict, replace
from fractions import Fraction

from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.proof import plant as exact
from polefence.proof.plant import Plant
from polefence.proof.ranges import Range

Matrices = list[list[list[Fraction]]]  # of each vertex; none of a key that the plant has not


def bare_plant(plant: UncertainPlant) -> Plant:
    """Return a plant without its names and outputs."""
    A, B, E = matrices_of(plant)
    return Plant(
        A,
        B,
        E,
        ranges_of(plant),
        sample_time=plant.sample_time,
        remainder=plant.remainder,
        functions=plant.functions,
    )


def matrices_of(plant: UncertainPlant) -> tuple[Matrices, Matrices, Matrices]:
    """Return A, B and E at the vertices."""
    A, B, E = (
        [list(map(list, M)) for v in plant.vertices if (M := getattr(v, key)) is not None]
        for key in ("exact_A", "exact_B", "exact_E")
    )
    return A, B, E


def ranges_of(plant: UncertainPlant) -> tuple[Range, ...]:
    """Return the parameters of a plant."""
    return tuple(
        Range(p.low, p.high, p.inverted, p.name, p.unit, p.label, p.rate, p.dead_time)
        for p in plant.parameters
    )


def file_plant(plant: UncertainPlant) -> Plant:
    """Return a plant as files have it, with its names; of samples, the car that is sampled."""
    vehicle = plant.vehicle if plant.sampling is None else plant.sampling.plant.vehicle
    described = None if vehicle is None else asdict(vehicle)
    if plant.car is not None:
        described = plant.car.document()
    return replace(
        bare_plant(plant),
        name=plant.name,
        states=tuple(plant.states),
        inputs=tuple(plant.inputs),
        disturbances=tuple(plant.disturbances),
        outputs=tuple(_file_output(plant, output) for output in plant.every_output),
        vehicle=described,
        noise=plant.noise,
        data=plant.data,
    )


def _file_output(plant: UncertainPlant, output: Output) -> exact.Output:
    C, D, F = ([[list(row)] for row in rows] for rows in output.exact(plant))
    driven = tuple(F) if any(any(f[0]) for f in F) else ()
    return exact.Output(C, D, output.name, driven, output.unit, output.near)
