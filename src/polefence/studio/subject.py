"""What a studio is about: a spec, with all that it says, and how it is called in commands."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from polefence.base.errors import InputError
from polefence.base.files import read_text
from polefence.certify.design import Design
from polefence.law.structure import Structure, load_structure
from polefence.plant.cars import Car
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import split
from polefence.plant.spec import MAX_BYTES, load_car, load_dampers, loads
from polefence.plant.weights import measurable
from polefence.proof.short import Short
from polefence.requirements.asked import COMFORT, wanted
from polefence.requirements.rms import Rms
from polefence.requirements.specification import Specification
from polefence.requirements.text import RoadSpectrum, load_specifications, spec_road


@dataclass(frozen=True, eq=False)
class Wanted(Short):
    """The ride that is asked for.

    Attributes
    ----------
    least : Specification
        What is minimised.
    limits : tuple of Specification
        What is kept.
    words : tuple of str
        Options of the command line that say so where the spec does not.
    """

    least: Specification
    limits: tuple[Specification, ...]
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Subject(Short):
    """A spec.

    Attributes
    ----------
    name : str
        Of the file, in commands.
    text : str
    plant : UncertainPlant
    car : Car, optional
        On several wheels.
    dampers : tuple of Damper
        Controllable ones.
    structure : Structure, optional
        What the spec says of its law.
    wanted : Wanted, optional
        What the spec asks of the ride; of a quarter car on a road its comfort.
    """

    name: str
    text: str
    plant: UncertainPlant
    car: Car | None = None
    dampers: tuple[Damper, ...] = ()
    structure: Structure | None = None
    wanted: Wanted | None = None

    @classmethod
    def read(cls, path: Path) -> Subject:
        """Read a spec.

        Raises
        ------
        InputError
            In one line with file, key, value and remedy.
        """
        text = read_text(path, MAX_BYTES, InputError)
        plant = loads(text, str(path))
        structure = load_structure(path)
        if structure is not None:
            structure.require_fit(plant)
        car, dampers = load_car(path), load_dampers(path)
        return cls(str(path), text, plant, car, dampers, structure, _wanted(plant, path))

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Names of what a law can measure: states but those of roads and weights, and outputs."""
        names = list(measurable(self.plant))
        outputs = [y.name for y in self.plant.outputs if y.C and not y.D]
        known = () if self.structure is None else self.structure.measured or ()
        for name in (*(split(state)[0] for state in known), *outputs):
            if name not in names and len(names) < 24:
                names.append(name)
        return tuple(names)

    @cached_property
    def measured(self) -> tuple[str, ...]:
        """Names of what the law of the spec measures."""
        if self.structure is not None and self.structure.measured is not None:
            return tuple(split(name)[0] for name in self.structure.measured)
        return measurable(self.plant)

    def measured_by(self, design: Design) -> tuple[str, ...]:
        """Return the names of what the law of a design measures, of those that are known."""
        law, vertices = design.law, np.eye(len(self.plant.vertices))
        names = measurable(self.plant)
        if law.measured:
            names = tuple(signal.name for signal in law.measured)
        used = np.any([law.gain(alpha) for alpha in vertices], axis=(0, 1))
        known = {name for name, some in zip(names, used, strict=False) if some}
        return tuple(name for name in self.signals if name in known) or self.measured

    @cached_property
    def overs(self) -> tuple[Specification, ...]:
        """What a trade-off can be over: the limits, those on inputs first; else inputs."""
        if self.wanted is None:
            return ()
        inputs = {split(label)[0] for label in self.plant.inputs}
        swept = (limit for limit in self.wanted.limits if limit.of_signal)
        limits = [limit for limit in swept if not limit.is_margin]
        if limits:
            return tuple(sorted(limits, key=lambda limit: limit.name not in inputs))
        density = self.wanted.least.noise_density or 1.0
        return tuple(Rms(split(label)[0], density=density) for label in self.plant.inputs)


def _wanted(plant: UncertainPlant, path: Path) -> Wanted | None:
    """Return what a spec asks of the ride, None where nothing is to be minimised."""
    if load_specifications(path)[0] is not None:
        least, limits = wanted(plant, path)
        return None if least is None else Wanted(least, limits)
    if plant.vehicle is None or not plant.disturbance_count:
        return None
    words: tuple[str, ...] = ("--minimise", COMFORT)
    road = None
    if spec_road(path) is None:
        # a quarter car that names no road rides on class C at 20 m/s
        road = RoadSpectrum("C", 20.0)
        words = ("--road", "C", "--speed", "20", *words)
    least, limits = wanted(plant, path, COMFORT, (), road)
    return None if least is None else Wanted(least, limits, words)
