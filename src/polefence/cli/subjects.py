"""What a command is about, a spec or a design: told apart, and read, in one way."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from polefence.base.errors import InputError
from polefence.certify.certificate import plant_of
from polefence.certify.design import (
    FILE_NAME,
    OF_DAMPERS,
    Design,
    is_proof_file,
    read_document,
)
from polefence.law.structure import load_structure
from polefence.plant.cars import Car
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import (
    FILTER,
    INTEGRAL,
    own_states,
    with_rates_as_inputs,
    with_states,
)
from polefence.plant.outputs import states
from polefence.plant.spec import load, load_dampers
from polefence.proof.claims.clipped import Clipped
from polefence.proof.document import Document


@dataclass(frozen=True, eq=False)
class Subject:
    """A plant, with what its spec says of it, or the design that it is read from.

    Attributes
    ----------
    source : str
        The path, for messages.
    plant : UncertainPlant
    design : Design, optional
        Where the path names one; nothing is proved of it yet.
    dampers : tuple of Damper
        The controllable ones of the spec, or of the law that it is read from.
    clipped : Document, optional
        The file of a law of controllable dampers, where the path names one.
    """

    source: str
    plant: UncertainPlant
    design: Design | None = None
    dampers: tuple[Damper, ...] = ()
    clipped: Document | None = None

    @property
    def car(self) -> Car | None:
        """The car on two or four wheels that the plant is; a quarter car is none."""
        return self.plant.car

    def require_road(self, remedy: str) -> None:
        """Refuse a plant that no road moves.

        Parameters
        ----------
        remedy : str
            What the command offers besides a table in the spec.

        Raises
        ------
        InputError
            If it is not described as a vehicle.
        """
        if self.plant.vehicle is None and self.car is None:
            raise InputError(
                f"{self.plant.name} is not described as a vehicle, and a road needs one; add a "
                f"table [vehicle] or [car] to its spec{remedy}"
            )


def is_design(path: Path) -> bool:
    """Whether a path is a file of claims, or a folder, which then has to hold a design."""
    return path.is_dir() or is_proof_file(path)


def claims_file(path: Path) -> Path | None:
    """Return the file of claims that a path is, or a folder's design or law; None of others."""
    inside = (path / name for name in (FILE_NAME, OF_DAMPERS))
    path = next((own for own in inside if own.is_file()), path)
    return path if is_proof_file(path) else None


def read_spec(source: str) -> Subject:
    """Read a spec.

    Raises
    ------
    SpecError
        If it cannot be read.
    """
    plant = load(source)
    return Subject(source, plant, None, load_dampers(source))


def read_subject(source: str) -> Subject:
    """Read a spec, or a design or a law of dampers with its plant; of neither is anything proved.

    Raises
    ------
    InputError
        If it is neither.
    """
    path = Path(source)
    if not is_design(path) and path.suffix != ".json":
        return read_spec(source)
    claims = claims_file(path)
    document = None if claims is None else read_document(claims)
    clipped = None if document is None else document.first(Clipped)
    if document is not None and clipped is not None:
        plant = plant_of(document.plant)
        dampers = tuple(Damper.named(plant, own) for own in clipped.dampers)
        return Subject(source, plant, None, dampers, document)
    design = Design.read(path, document=document)
    return Subject(source, design.plant, design)


def with_law_of(plant: UncertainPlant, claimed: UncertainPlant, spec: str) -> UncertainPlant:
    """Return the plant of a spec with the states of the law of a file's plant, if it has any."""
    more = own_states(claimed)
    if not any(state.name.startswith((INTEGRAL, FILTER)) for state in states(claimed)):
        return plant if own_states(plant) else with_states(plant, more)
    structure = load_structure(spec)
    if structure is None or not structure.kind:
        return plant
    larger = structure.extended(plant)[0]
    return with_rates_as_inputs(larger, more) if more else larger
