"""Plants and laws as commands name them: a spec, a design, a word, a gain; and what is proved."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, UncontrollableError, suggest
from polefence.certify.design import FILE_NAME, Design, read_document
from polefence.cli.given import is_written, read_gain
from polefence.cli.options import structure_of
from polefence.cli.subjects import Subject, claims_file, is_design
from polefence.law.laws import given_law
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import Clipped
from polefence.proof.claims.samples import Samples
from polefence.proof.plant import Plant
from polefence.proof.text import milliseconds_text
from polefence.region.text import digits_up, load_region
from polefence.requirements.asked import wanted
from polefence.requirements.text import load_specifications

WORDS = ("passive", "skyhook", "lqr")
OWN = "law of the spec"


@dataclass(frozen=True, eq=False)
class Named:
    """A law by its name.

    Attributes
    ----------
    name : str
    law : None, Law, Design, GainTable or NoLaw
        Of a design nothing need be proved yet.
    judged : callable
        Proves what is claimed of the law and returns `design` and `proved`: it takes a while, so
        it is called when one of them is asked for.
    dampers : bool
        Whether the law demands what controllable dampers give as far as they can.
    """

    name: str
    law: Any
    judged: Callable[[], tuple[Design | None, str]] = lambda: (None, "nothing")
    dampers: bool = False

    @cached_property
    def _judged(self) -> tuple[Design | None, str]:
        return self.judged()

    @property
    def design(self) -> Design | None:
        """Where the law is one, and proved for the very plant that is looked at."""
        return self._judged[0]

    @property
    def proved(self) -> str:
        """What is, in words."""
        return self._judged[1]


def law_of(subject: Subject) -> Named | None:
    """Return the law of a subject that is a design."""
    clipped = None if subject.clipped is None else subject.clipped.first(Clipped)
    if clipped is not None:
        return _of_dampers(subject.plant, clipped, Path(subject.source))
    if subject.design is None:
        return None
    return of_design(subject.plant, subject.design, Path(subject.source))


def law_of_spec(plant: UncertainPlant, spec: str) -> tuple[UncertainPlant, Named | None]:
    """Design the law that a spec asks for, as `optimise` does, or as `design`; None of nothing.

    The plant comes back with the states that such a law has. Where none is proved, it is a `NoLaw`
    that says why.
    """
    from polefence.search.optimise import optimise
    from polefence.search.place import place
    from polefence.vehicle.compare import NoLaw

    (least, limits), region = load_specifications(spec), load_region(spec)
    structure = structure_of(plant, argparse.Namespace(spec=spec))
    try:
        if least is not None or limits:
            least, limits = wanted(plant, spec)
            design = optimise(plant, least, limits, region, structure=structure).design
        elif region is not None:
            design = place(plant, region, structure=structure)
        else:
            return plant, None
    except (NotProvedError, UncontrollableError) as answer:
        return plant, Named(OWN, NoLaw(str(answer)))
    return design.plant, of_design(design.plant, design, Path(OWN))


def read_law(plant: UncertainPlant, what: str) -> Named:
    """Read a law: one of `WORDS`, a design, a table of gains, or a matrix as JSON.

    Raises
    ------
    InputError
        If it is none of these, or does not fit the plant.
    """
    if what in WORDS:
        from polefence.vehicle.compare import standard_laws

        return Named(what, standard_laws(plant, names=(what,))[what])
    if is_written(what):
        return Named("gain", read_gain(plant, what, option="--law"))
    path = Path(what)
    if not path.exists():
        raise InputError(f"no law and no file {what!r}; {suggest(what, WORDS)}")
    claims = claims_file(path)
    clipped = None if claims is None else read_document(claims).first(Clipped)
    if clipped is not None:
        return _of_dampers(plant, clipped, path)
    if is_design(path):
        design = Design.read(path)
        given_law(plant, design)
        return of_design(plant, design, path)
    return Named(_stem(path), read_gain(plant, what, option="--law"))


def at_samples_of(plant: UncertainPlant, what: str) -> Design | None:
    """Return a design at a sample time, where the plant is in continuous time; else None."""
    if what in WORDS or plant.sample_time is not None or is_written(what):
        return None
    path = claims_file(Path(what))
    if path is None or read_document(path).first(Samples) is None:
        return None
    return Design.read(path)


def distinct(laws: Sequence[Named]) -> list[Named]:
    """Return laws with a number behind every name that has been there before."""
    named = list[Named]()
    for law in laws:
        count = sum(other.name == law.name for other in laws[: len(named)])
        name = f"{law.name} ({count + 1})" if count else law.name
        named.append(replace(law, name=name))
    return named


def of_design(plant: UncertainPlant, design: Design, path: Path) -> Named:
    """Return a design as a law, and what is proved of it where its proof is about the plant."""
    return Named(_stem(path), design, partial(_judged, plant, design, path))


def _judged(plant: UncertainPlant, design: Design, path: Path) -> tuple[Design | None, str]:
    """Return a design, where it is proved and about the plant, and what is proved of it."""
    T, seen = design.plant.sample_time, design.plant.sampling
    about = design.plant if seen is None or plant.sample_time is not None else seen.plant
    if _identity(about) != _identity(plant):
        return None, "nothing: its proof is about another plant"
    design = design.afresh(path, allow_unproved=True)
    if not design.proved:
        return None, "nothing: the proof in its file fails"
    when = (
        ""
        if about is design.plant or T is None
        else f" at samples every {milliseconds_text(T)} ms,"
    )
    proved = f"all poles in {design.region},{when} for every constant value of the parameters"
    proved += f"; but {design.note.removeprefix('note: ')}" if design.note else ""
    return design, proved


def _of_dampers(plant: UncertainPlant, claim: Clipped, path: Path) -> Named:
    """Return the demand of a law for controllable dampers, which the plant's dampers give."""
    n = plant.shape[0]
    K = np.array([[float(x) for x in row[:n]] for row in claim.K])
    behind = [x for row in claim.K for x in row[n:]]  # the states of filters, which stay out
    if K.shape != plant.shape[::-1] or any(behind):
        shape = f"{len(claim.K)} x {len(claim.K[0])}"
        raise InputError(f"{path}: a gain of {shape} does not fit {plant.name}")
    return Named(path.stem, K, partial(_judged_dampers, plant, claim), dampers=True)


def _judged_dampers(plant: UncertainPlant, claim: Clipped) -> tuple[None, str]:
    """Say what is proved of a law of controllable dampers."""
    if not _is_within(file_plant(plant), claim):
        return None, "nothing: its proof is about another plant"
    if not prove(claim).proved:
        return None, "nothing: the proof in its file fails"
    level, named = digits_up(claim.limit.level), ", ".join(y.name for y in claim.limit.outputs)
    within = f"rms of [{named}] <= {level}"
    return None, f"{within}, for every constant value, with the dampers in its file"


def _is_within(bare: Plant, claim: Clipped) -> bool:
    """Whether a claim is about a plant, or about it with filters behind its signals."""
    n = bare.n
    first = ([row[:n] for row in M[:n]] for M in claim.A)
    behind = [x for M in claim.A for row in M[:n] for x in row[n:]]
    B, E = ([M[:n] for M in vertices] for vertices in (claim.B, claim.E))
    return (list(first), B, E) == (bare.A, bare.B, bare.E) and not any(behind)


def _identity(plant: UncertainPlant) -> tuple[Any, ...]:
    ranges = [(p.name, p.low, p.high, p.through) for p in plant.parameters]
    return plant.digest, plant.sample_time, ranges


def _stem(path: Path) -> str:
    """A design by its folder, if it is alone there."""
    folder = path if path.is_dir() else path.absolute().parent
    return folder.resolve().name if path.is_dir() or path.name == FILE_NAME else path.stem
