"""Questions of a study: what is asked of each variant, and what is answered."""

from __future__ import annotations

import itertools
import math
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar

from polefence.base.errors import (
    InputError,
    NotProvedError,
    PolefenceError,
    SpecError,
    shown,
    suggest,
)
from polefence.base.processors import small_matrices
from polefence.certify.bounds import bounds_file, kept_bound, sampled
from polefence.certify.certificate import Certificate
from polefence.certify.checks import in_time_of, stable_region
from polefence.certify.design import Design
from polefence.certify.given import analyse
from polefence.certify.margins import Margin, estimation_error, gain_error, parameter_rate
from polefence.certify.margins.each_gain import Gains
from polefence.certify.margins.service import KINDS as MARGINS
from polefence.fleet.claimed import bounds, fault_of, is_inside
from polefence.fleet.form import Form
from polefence.law.laws import FixedGain, Law
from polefence.law.structure import MAX_DEGREE, Structure, load_structure
from polefence.lmi.conditions.methods import METHODS, Method, Scheduled, Slack, method_name, normal
from polefence.plant.expression import decimal_text
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.plant.weights import measurable
from polefence.proof.claims.each_gain import EachGain
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.claims.margins import MarginClaim
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rate import Rate
from polefence.proof.document import Document
from polefence.proof.regions import Part, parts_of, write_region
from polefence.proof.short import Short
from polefence.proof.text import unit_text
from polefence.region.regions import HalfPlane, Region, Sector
from polefence.region.text import load_region, parse_region
from polefence.requirements.asked import wanted
from polefence.requirements.specification import Specification
from polefence.requirements.text import load_specifications
from polefence.response.stationary import velocity_density
from polefence.search import many
from polefence.search.driver import NUMBERS, require_kind
from polefence.search.optimise import Optimised, optimise
from polefence.vehicle.compare import NAMES, QUANTITIES, NoLaw, compare, standard_laws

PROVED, NOT_PROVED, ERROR, LOST = "proved", "not proved", "error", "lost"
SAMPLED = "sampled"
GOOD = (PROVED, SAMPLED)
DIED = "the process that worked on it died each time: out of memory, or a bug"
KINDS = {"gain": EachGain.kind, "estimate": Estimate.kind, "rate": Rate.kind}


@dataclass(frozen=True)
class Answer(Short):
    """The answer about one variant.

    Attributes
    ----------
    status : str
        "proved"; "sampled", of which nothing is proved; "not proved"; "error": the question makes
        no sense for this variant; "lost": the process that worked on it died.
    bound, least, worst : float, optional
        What is proved; what is proved to be out of the method's reach; the worst sample.
    unit : str
    claim, reason : str
        What is proved, in words; why nothing is.
    seconds : float
        A share of the time that its group took.
    document : str, optional
        The file of claims, which proves it.
    """

    status: str
    bound: float | None = None
    least: float | None = None
    worst: float | None = None
    unit: str = ""
    claim: str = ""
    reason: str = ""
    seconds: float = 0.0
    document: str | None = None


@dataclass(frozen=True)
class Question(Short):
    """What is asked of every variant.

    Attributes
    ----------
    name : str
        For rows.
    """

    name: str

    kind: ClassVar[str]
    together: ClassVar[bool] = False  # whether it is one question about all variants
    group: ClassVar[int] = 1  # variants that are worked out together

    @classmethod
    def read(cls, name: str, table: Mapping[str, Any], where: str) -> Question:
        """Return what a table of a study says.

        Raises
        ------
        SpecError
            Naming key, value and remedy.
        """
        known = {field.name: field for field in fields(cls) if field.name != "name"}
        for key in table:
            if key not in known:
                raise SpecError(f"{where}: unknown key {shown(key)}; {suggest(key, known)}")
        try:
            return cls(name, **{key: _plain(value) for key, value in table.items()})
        except (InputError, TypeError) as error:
            raise SpecError(f"{where}: {error}") from error

    def table(self) -> dict[str, Any]:
        """Return it as `read_questions` reads it."""
        chosen: dict[str, Any] = {"ask": self.kind, "name": self.name}
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            if value != field.default:
                chosen[field.name] = list(value) if isinstance(value, tuple) else value
        return chosen

    @property
    def words(self) -> str:
        """The question with its options."""
        options = [f"{key} = {x}" for key, x in self.table().items() if key not in ("ask", "name")]
        return ", ".join([self.kind, *options])

    def plant(self, spec: str, states: int) -> UncertainPlant:  # noqa: ARG002
        """Return the plant that a file about a variant must have, with this number of states.

        States beyond the variant's are those of the law, where the question allows any.
        """
        return loads(spec, "variant")

    def fault(self, document: Document, spec: str) -> str:  # noqa: ARG002
        """Say in which way a file of claims answers another question; "" if it answers this one."""
        return ""

    def form(self, spec: str, states: int) -> Form:
        """Return the form of laws that is allowed in a file with this number of states."""
        raise NotImplementedError

    def is_bounded(self, spec: str) -> bool:  # noqa: ARG002
        """Whether a proved answer has a bound."""
        return False

    def unit(self, document: Document, spec: str) -> str:  # noqa: ARG002
        """Return the unit of a bound."""
        return ""

    def least(self, spec: str) -> float | None:  # noqa: ARG002
        """Return the level that is proved to be out of reach, proved again; None without one."""
        return None

    def worst(self, document: Document, spec: str) -> float | None:  # noqa: ARG002
        """Return the worst sample of a file's law, taken again; None if the question has none."""
        return None

    @property
    def largest(self) -> bool:
        """Whether a larger bound is better."""
        return False

    def proves(self, document: Document, spec: str, bound: float) -> bool:  # noqa: ARG002
        """Whether a file of claims, which answers the question, proves this bound."""
        return False

    @small_matrices()  # as workers have it, whose rows are the same to the last bit
    def answers(self, specs: Sequence[str]) -> list[Answer]:
        """Return an answer for each of the variants' specs; an error of one leaves the others."""
        begin = time.perf_counter()
        plants = [_or_error(lambda text=text: loads(text, "variant")) for text in specs]
        known = [k for k, plant in enumerate(plants) if isinstance(plant, UncertainPlant)]
        answers: dict[int, Answer] = {
            k: _failed(error) for k, error in enumerate(plants) if isinstance(error, PolefenceError)
        }
        answered = self._answered([plants[k] for k in known], [specs[k] for k in known])
        seconds = (time.perf_counter() - begin) / len(specs)
        answers |= dict(zip(known, answered, strict=True))
        return [replace(answers[k], seconds=seconds) for k in range(len(specs))]

    def _answered(self, plants: list[Any], specs: list[str]) -> list[Answer]:
        raise NotImplementedError


@dataclass(frozen=True)
class _OfMethod(Question):
    method: str = "scheduled"
    degree: int | None = None
    elevation: int | None = None
    on: str | None = None

    def __post_init__(self) -> None:
        _ = self.options

    @property
    def options(self) -> Method:
        """The method with its options."""
        method_name(self.method)
        options = ("degree", "elevation", "on")
        given = {key: x for key in options if (x := getattr(self, key)) is not None}
        if not given:
            return self.method
        if self.method == "quadratic":
            raise InputError(
                f"{next(iter(given))} belongs to scheduled and slack, not to quadratic"
            )
        return Slack(**given) if self.method == "slack" else Scheduled(**given)

    def form(self, spec: str, states: int) -> Form:  # noqa: ARG002
        """Return one gain, or for a scheduled law its degree."""
        return _of_method(loads(spec), self.options)


@dataclass(frozen=True)
class Place(_OfMethod):
    """A law that keeps all poles in a region."""

    region: str = ""
    kind = "design"
    group = 16

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.region:
            raise InputError('region is missing; write region = "disk(-40, 31)"')
        parse_region(self.region)

    def _asked(self, spec: str) -> Region:
        return in_time_of(loads(spec), parse_region(self.region))

    def fault(self, document: Document, spec: str) -> str:
        """Say that the file is about another region."""
        return fault_of(document, loads(spec), self._asked(spec), ())

    def _answered(self, plants: list[Any], specs: list[str]) -> list[Answer]:  # noqa: ARG002
        designs = many.place(plants, parse_region(self.region), self.options)
        return [
            _failed(design) if isinstance(design, PolefenceError) else _of_design(design)
            for design in designs
        ]


@dataclass(frozen=True)
class Tightest(_OfMethod):
    """The smallest disk about a centre, the largest decay rate or damping ratio."""

    centre: float | None = None
    of: str = "disk"
    within: str = ""
    kind = "tightest"
    group = 16

    def __post_init__(self) -> None:
        super().__post_init__()
        require_kind(self.of)
        if (self.of == "disk") != (self.centre is not None):
            raise InputError(
                "centre is missing; write centre = -40"
                if self.centre is None
                else f"centre belongs to a disk; of = {self.of!r} has none"
            )
        if self.within:
            parse_region(self.within, alone=False)

    @property
    def largest(self) -> bool:
        """Whether it is a decay rate or a damping ratio, not a radius."""
        return self.of != "disk"

    def fault(self, document: Document, spec: str) -> str:
        """Say that the file's region is of another kind, or not within the one that was asked."""
        if not self._parts(document) and not self._by_image(spec):
            return f"its file has no such {self.of}"
        poles, within = document.first(Poles), self._within
        kept = within is None or set(parts_of(within.document())) <= set(poles.region)
        return "" if kept else f"its file is not about poles within {self.within}"

    def is_bounded(self, spec: str) -> bool:  # noqa: ARG002
        """Return True: the size of the region."""
        return True

    def unit(self, document: Document, spec: str) -> str:  # noqa: ARG002
        """Return 1/s, or "" for a damping ratio."""
        return "" if self.of == "sector" else "1/s"

    def least(self, spec: str) -> float | None:
        """Return the radius that is out of the method's reach."""
        return self.answers([spec])[0].least

    def proves(self, document: Document, spec: str, bound: float) -> bool:
        """Whether the region has this size; in discrete time, whether it lies inside its image."""
        if self._by_image(spec):
            poles = document.first(Poles)
            with suppress(PolefenceError):  # no region has such a bound
                asked = HalfPlane(bound) if self.of == "half_plane" else Sector(bound)
                return poles is not None and is_inside(poles.region, in_time_of(loads(spec), asked))
            return False
        return any(getattr(part, NUMBERS[self.of]) == bound for part in self._parts(document))

    def _by_image(self, spec: str) -> bool:
        """Whether a file has, instead of the region that is asked for, its image in the z-plane."""
        return self.largest and loads(spec).sample_time is not None

    @property
    def _within(self) -> Region | None:
        return parse_region(self.within, alone=False) if self.within else None

    def _parts(self, document: Document) -> list[Part]:
        poles = document.first(Poles)
        return [
            part
            for part in (() if poles is None else poles.region)
            if part.kind == self.of and (part.circle is None or part.circle[0] == self.centre)
        ]

    def _answered(self, plants: list[Any], specs: list[str]) -> list[Answer]:  # noqa: ARG002
        kind, within = self.of, self._within
        designs = many.tightest(plants, self.centre, self.options, of=kind, within=within)
        return [
            _failed(design) if isinstance(design, PolefenceError) else _of_design(design, self.of)
            for design in designs
        ]


@dataclass(frozen=True)
class Service(Place):
    """How wrong a law's gain or estimates may be, and how fast parameters may move."""

    margin: str = "gain"
    decay: float = 0.0
    kind = "service"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.margin.partition("-")[0] not in KINDS:
            raise InputError(f"margin = {self.margin!r} is unknown; {suggest(self.margin, KINDS)}")

    @property
    def largest(self) -> bool:
        """Return True: a larger margin is better."""
        return True

    def fault(self, document: Document, spec: str) -> str:
        """Say that the file is about another margin or region, or a lower decay rate."""
        claim = document.first(MarginClaim)
        if claim is None or claim.kind != KINDS.get(self.margin.partition("-")[0]):
            return f"its file is about no {self.margin}"
        if isinstance(claim, Rate):
            slower = claim.decay < self.decay
            return f"its file is about a decay rate below {self.decay:g}" if slower else ""
        if isinstance(claim, EachGain) and not _error_of_gains(document, claim, self.margin):
            return "its file is about other gains of the law"
        same = write_region(claim.subject.design.region) == self._asked(spec).document()
        return "" if same else f"its file is not about {self.region}"

    def is_bounded(self, spec: str) -> bool:  # noqa: ARG002
        """Return True: the margin."""
        return True

    def unit(self, document: Document, spec: str) -> str:  # noqa: ARG002
        """Return the unit of the margin."""
        claim, (kind, _, name) = document.first(MarginClaim), self.margin.partition("-")
        known = {range_.name.replace(" ", "-"): range_.unit for range_ in claim.subject.ranges}
        endless = claim.value("") is None
        alone = unit_text(known[name]) if name in known else None
        return MARGINS[kind].unit(alone, bool(known), endless)

    def proves(self, document: Document, spec: str, bound: float) -> bool:  # noqa: ARG002
        """Whether the file proves at least this margin."""
        claim = document.first(MarginClaim)
        if isinstance(claim, EachGain):
            return bound <= _error_of_gains(document, claim, self.margin)
        name = self.margin.partition("-")[2]
        named = [r.name for r in claim.subject.ranges if r.name.replace(" ", "-") == name]
        value = claim.value(named[0] if named else name)
        return value is None or bound <= value

    def _answered(self, plants: list[Any], specs: list[str]) -> list[Answer]:  # noqa: ARG002
        designs = many.place(plants, parse_region(self.region), self.options)
        return [
            _failed(design) if isinstance(design, PolefenceError) else self._of(design)
            for design in designs
        ]

    def _of(self, design: Design) -> Answer:
        try:
            margins = self._of_kind(design)
            margin = next((other for other in margins if other.name == self.margin), None)
            if margin is None:
                names = [other.name for other in margins]
                raise InputError(
                    f"margin = {self.margin!r} is unknown; {suggest(self.margin, names)}"
                )
        except PolefenceError as error:
            return _failed(error)
        if not margin.proved:
            return Answer(NOT_PROVED, reason="no margin was proved")
        return _proved(margin.file(design), margin.value, None, None, margin.unit)

    def _of_kind(self, design: Design) -> tuple[Margin, ...]:
        kind = self.margin.partition("-")[0]
        if kind == "rate":
            return parameter_rate(design, self.decay)
        if kind == "gain":
            return gain_error(design), gain_error(design, own_states=True)
        return estimation_error(design)


@dataclass(frozen=True)
class Optimise(Question):
    """The law with the least worst case of one signal, within limits on others."""

    minimise: str | None = None
    limits: tuple[str, ...] = ()
    region: str = ""
    method: str | None = None
    measured: tuple[str, ...] | None = None
    schedule: tuple[str, ...] | None = None
    degree: int | None = None
    order: int | None = None
    kind = "optimise"

    def __post_init__(self) -> None:
        if self.region:
            parse_region(self.region)
        if self.method is not None:
            method_name(self.method)

    def fault(self, document: Document, spec: str) -> str:
        """Say which limit the file lacks, or that it is about another region."""
        plant = self.plant(spec, document.plant.n)
        with _as_file(spec) as path:
            region = self._region(path)
        region = stable_region(plant) if region is None else in_time_of(plant, region)
        least, limits = self._extended(plant, spec)
        if least is not None and not bounds(document, plant, least):
            return f"its file has no bound on {least.title}"
        return fault_of(document, plant, region, limits)

    def proves(self, document: Document, spec: str, bound: float) -> bool:
        """Whether what is minimised has this bound."""
        plant = self.plant(spec, document.plant.n)
        least, _ = self._extended(plant, spec)
        claims = [] if least is None else bounds(document, plant, least)
        return any(claim.level == bound for claim in claims)

    def plant(self, spec: str, states: int) -> UncertainPlant:
        """Return the plant of a variant, with the states of the law appended."""
        return self.form(spec, states).plant

    def form(self, spec: str, states: int) -> Form:
        """Return the law's structure, or the form of the method's laws."""
        plant = super().plant(spec, states)
        with _as_file(spec) as path:
            structure = self._structure(path, plant)
        if structure is not None:
            if structure.order:  # a law of a lower order may be as good
                order = min(max(states - plant.shape[0], 0), structure.order)
                structure = replace(structure, order=order)
            return Form(*structure.extended(plant))
        known = measurable(plant)
        if self.method is None and len(known) < plant.shape[0]:
            return Form(plant, Structure(measured=known))
        return _of_method(plant, self.method or "scheduled")

    def is_bounded(self, spec: str) -> bool:
        """Whether something is minimised."""
        return self._extended(super().plant(spec, 0), spec)[0] is not None

    def unit(self, document: Document, spec: str) -> str:
        """Return the unit of what is minimised."""
        plant = self.plant(spec, document.plant.n)
        least, _ = self._extended(plant, spec)
        return "" if least is None else least.unit(plant)

    @small_matrices()
    def worst(self, document: Document, spec: str) -> float | None:
        """Return the worst sample of what is minimised."""
        plant = self.plant(spec, document.plant.n)
        least, _ = self._extended(plant, spec)
        return None if least is None else _worst(plant, Certificate.of(document).law, least)

    def _extended(
        self, plant: UncertainPlant, spec: str
    ) -> tuple[Specification | None, tuple[Specification, ...]]:
        """Return what is asked of a variant, for its plant with the states of the law."""
        variant = super().plant(spec, 0)
        with _as_file(spec) as path:
            least, limits = self._wanted(variant, path)
        n, more = variant.shape[0], plant.shape[0] - variant.shape[0]
        if not more:
            return least, limits
        return least and least.extended(n, more), tuple(s.extended(n, more) for s in limits)

    def _answered(self, plants: list[Any], specs: list[str]) -> list[Answer]:
        return [self._of(plant, text) for plant, text in zip(plants, specs, strict=True)]

    def _of(self, plant: UncertainPlant, text: str) -> Answer:
        try:
            with _as_file(text) as spec:
                least, limits = self._wanted(plant, spec)
                if least is not None and least.is_margin:
                    raise InputError(
                        f"{least.title}: a study asks for the least of a signal; give the margin a "
                        "limit"
                    )
                region = self._region(spec)
                structure = self._structure(spec, plant)
            done = optimise(plant, least, limits, region, self.method, structure=structure)
        except PolefenceError as error:
            return _failed(error)
        return _of_optimised(done)

    def _wanted(
        self, plant: UncertainPlant, spec: Path
    ) -> tuple[Specification | None, tuple[Specification, ...]]:
        return wanted(plant, spec, self.minimise, self.limits, options=("minimise", "limits"))

    def _region(self, spec: Path) -> Region | None:
        return parse_region(self.region) if self.region else load_region(spec)

    def _structure(self, spec: Path, plant: UncertainPlant) -> Structure | None:
        keys = ("measured", "schedule", "degree", "order")
        given = {key: x for key in keys if (x := getattr(self, key)) is not None}
        written = load_structure(spec)
        if self.method is not None or (written is None and not given):
            return None
        structure = replace(written or Structure(), **given)
        structure.require_fit(plant)
        return structure


@dataclass(frozen=True)
class Cover(Question):
    """A few gains: for every variant one that keeps it in a region and within limits."""

    region: str = ""
    limits: tuple[str, ...] = ()
    kind = "cover"
    together = True
    group = 16

    def __post_init__(self) -> None:
        if self.region:
            parse_region(self.region)

    def kept(self, spec: str) -> tuple[Region, tuple[Specification, ...]]:
        """Return the region and the limits of a variant."""
        with _as_file(spec) as path:
            region = parse_region(self.region) if self.region else load_region(path)
            least, limits = load_specifications(path)
            plant = loads(spec)
            if self.limits or least or limits:
                _, limits = wanted(plant, path, None, self.limits, options=("", "limits"))
        return stable_region(plant) if region is None else in_time_of(plant, region), limits

    def fault(self, document: Document, spec: str) -> str:
        """Say which limit the file lacks, or that it is about another region."""
        return fault_of(document, loads(spec), *self.kept(spec))

    def form(self, spec: str, states: int) -> Form:  # noqa: ARG002
        """Return one gain of all states."""
        return _of_method(loads(spec), "quadratic")

    @small_matrices()
    def proved(self, K: Any, spec: str) -> Answer:
        """Return what is proved about one variant with a gain."""
        begin = time.perf_counter()
        try:
            answer = self._proved(FixedGain(K), spec)
        except PolefenceError as error:
            answer = _failed(error)
        return replace(answer, seconds=time.perf_counter() - begin)

    def _proved(self, law: FixedGain, spec: str) -> Answer:
        region, limits = self.kept(spec)
        plant = loads(spec, "variant")
        answer = analyse(plant, law, region)
        if answer.certificate is None or not answer.proved:
            return Answer(NOT_PROVED, reason=answer.reason)
        claims = list[BoundClaim]()
        for limit in limits:
            bound = kept_bound(plant, answer.certificate.law, limit)
            if bound is None:
                return Answer(NOT_PROVED, reason=f"{limit.title} <= {limit.at_most:g}: no proof")
            claims.append(bound.claim)
        return _proved(bounds_file(answer.certificate, claims))


@dataclass(frozen=True)
class Ride(Question):
    """How a law rides on a random road: the worst of one quantity over the family, sampled."""

    law: str = "passive"
    quantity: str = "weighted acceleration"
    road: str = "C"
    speed: float = 20.0
    disk: tuple[float, float] = (-40.0, 36.0)
    kind = "compare"

    def __post_init__(self) -> None:
        for key, known in (("law", NAMES), ("quantity", tuple(name for name, _ in QUANTITIES))):
            name = str(getattr(self, key))
            of_a_place = key == "quantity" and name.endswith(tuple(f" {one}" for one in known))
            if name not in known and not of_a_place:
                raise InputError(f"{key} = {name!r} is unknown; {suggest(name, known)}")
        velocity_density(self.road, self.speed)
        if not isinstance(self.disk, tuple) or len(self.disk) != 2:
            raise InputError(f"disk = {self.disk!r} must be [CENTRE, RADIUS]")
        parse_region("disk({!r}, {!r})".format(*self.disk))

    def _answered(self, plants: list[Any], specs: list[str]) -> list[Answer]:  # noqa: ARG002
        return [self._of(plant) for plant in plants]

    def _of(self, plant: UncertainPlant) -> Answer:
        try:
            laws = standard_laws(plant, self.disk, (self.law,))
            if isinstance(law := laws[self.law], NoLaw):
                return Answer(NOT_PROVED, reason=law.reason)
            compared = compare(plant, laws, self.road, self.speed)
            ridden = compared.row(self.law, self.quantity)
        except PolefenceError as error:
            return _failed(error)
        reason = f"the worst of {len(compared.alpha)} points of the family; nothing is proved"
        return Answer(SAMPLED, worst=ridden.worst, unit=ridden.unit, reason=reason)


QUESTIONS: dict[str, type[Question]] = {
    question.kind: question for question in (Place, Tightest, Service, Optimise, Cover, Ride)
}
LIMITS = "limits"  # asks for the tightest region of each method
MOST = 1000  # questions


def read_questions(tables: Any) -> tuple[Question, ...]:
    """Read the tables ``[[question]]`` of a study.

    Raises
    ------
    SpecError
        Naming key, value and remedy.
    """
    if (
        not isinstance(tables, list)
        or not all(isinstance(table, dict) for table in tables)
        or not tables
    ):
        raise SpecError('no question; write [[question]], ask = "tightest", centre = -40')
    questions = list[Question]()
    for k, table in enumerate(tables):
        where = f"question {k + 1}"
        for name, options in _questions(table, where):
            if name in [other.name for other in questions]:
                raise SpecError(f"{where}: two questions are called {name!r}; give each a name")
            questions.append(QUESTIONS[options.pop("ask")].read(name, options, where))
    return tuple(questions)


def _questions(table: Mapping[str, Any], where: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the questions of a table: one for each value of an option that is a list of them."""
    ask, options = table.get("ask"), dict(table)
    if ask == LIMITS:
        options = {"method": list(METHODS), "name": ask} | options | {"ask": Tightest.kind}
    if options.get("ask") not in QUESTIONS:
        known = (LIMITS, *QUESTIONS)
        raise SpecError(f"{where}: ask = {shown(ask)} is unknown; {suggest(str(ask), known)}")
    name = options.pop("name", ask)
    if not isinstance(name, str) or not name.strip():
        raise SpecError(f"{where}: name = {shown(name)} must be text")
    single = [one.name for one in fields(QUESTIONS[options["ask"]]) if "tuple" not in str(one.type)]
    several = {key: x for key, x in options.items() if key in single and isinstance(x, list)}
    if math.prod(map(len, several.values())) > MOST:
        raise SpecError(f"{where}: more than {MOST} questions; give shorter lists")
    for key, values in several.items():
        if not values:
            raise SpecError(f"{where}: {key} = [] is empty; give one value, or several")
    for chosen in itertools.product(*several.values()):
        one = options | dict(zip(several, chosen, strict=True))
        yield " ".join([name, *map(_short, chosen)]), one


def _short(value: Any) -> str:
    return decimal_text(value) if isinstance(value, Fraction) else str(value)


def _plain(value: Any) -> Any:
    """Return numbers as floats and lists as tuples, as the API takes them."""
    if isinstance(value, list):
        return tuple(map(_plain, value))
    return float(value) if isinstance(value, Fraction) else value


def _or_error(make: Any) -> Any:
    try:
        return make()
    except PolefenceError as error:
        return error


def _failed(error: PolefenceError) -> Answer:
    status = NOT_PROVED if isinstance(error, NotProvedError) else ERROR
    return Answer(status, reason=" ".join(str(error).split()))


def _of_design(design: Design, of: str = "") -> Answer:
    """Return the answer of a design; with ``of`` its bound is that region's size."""
    bound, unit = None, ""
    for part in (design.region if design.asked is None else design.asked).parts:
        if of and part.kind == of:
            bound, unit = getattr(part, NUMBERS[of]), "" if of == "sector" else "1/s"
    return _proved(design.certificate.file(), bound, design.lower, None, unit)


def _of_optimised(done: Optimised) -> Answer:
    first = done.bounds[0] if done.bounds else None
    document = bounds_file(done.design.certificate, done.claims)
    if first is None or first.specification.at_most is not None:
        return _proved(document)
    worst = _worst(done.plant, done.law, first.specification)
    unit = first.specification.unit(done.plant)
    return _proved(document, first.level, None, worst, unit)


def _worst(plant: UncertainPlant, law: Law, specification: Specification) -> float:
    """Return the worst of the vertices and 200 points between."""
    alpha = seeded(plant, len(plant.vertices) + 200)
    return sampled(plant, law, specification, alpha).worst


def _of_method(plant: UncertainPlant, method: Method) -> Form:
    """Return the form of a method's laws: one gain of all states, or a polynomial of a degree."""
    known = normal(method)
    degree: int | str = 0
    if method_name(known) == "scheduled":
        degree = known.degree if isinstance(known, Scheduled) else Scheduled().degree
    return Form(plant, Structure(degree=MAX_DEGREE if degree == "auto" else int(degree)), True)


def _proved(
    document: Document,
    bound: float | None = None,
    least: float | None = None,
    worst: float | None = None,
    unit: str = "",
) -> Answer:
    claim = "; ".join(claimed.said(document.plant) for claimed in document.claims)
    return Answer(PROVED, bound, least, worst, unit, claim, document=document.dumps(None))


def _error_of_gains(document: Document, claim: EachGain, margin: str) -> Fraction:
    """Return the share of its size by which every gain of a law may be off; 0 for other sizes."""
    law = replace(document, claims=(claim.subject.design,))
    sizes = Gains.of(Design(Certificate.of(law)), of_states=margin != "gain").sizes
    shares = [
        claimed / Fraction(size)
        for claims, row in zip(claim.sizes, sizes.tolist(), strict=True)
        for claimed, size in zip(claims, row, strict=True)
        if size
    ]
    least = min(shares, default=Fraction(0))
    # two machines, each in floats, agree on a size to 1e-9 of it
    return claim.error * (1 if least >= 1 - 1e-9 else least)


@contextmanager
def _as_file(text: str) -> Iterator[Path]:
    """Yield a file with this text, for what reads specs from files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "variant.toml"
        path.write_text(text, encoding="utf-8")
        yield path
