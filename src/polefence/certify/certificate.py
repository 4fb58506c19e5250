"""Certificates: everything a claim about poles rests on, as a frozen value and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import DesignFileError, InputError, NotProvedError, PlantError
from polefence.base.explained import explained_fields
from polefence.base.frozen import Frozen
from polefence.certify.counterexample import counterexample
from polefence.certify.exact import holds
from polefence.certify.measured import dual_plant
from polefence.law.laws import Law, law_of
from polefence.plant.cars import Car
from polefence.plant.exact import bare_plant, file_plant
from polefence.plant.family import SamplesOf, UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.parts import node
from polefence.plant.polynomial import Domain
from polefence.plant.samples import claim_of_samples
from polefence.plant.system import Array
from polefence.plant.vehicle import Vehicle
from polefence.proof import laws
from polefence.proof import plant as files
from polefence.proof.between import Clock
from polefence.proof.claims.base import Claim, Verdict, prove, undecided
from polefence.proof.claims.clipped import Clipped
from polefence.proof.claims.observer import Observer
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.samples import Samples
from polefence.proof.document import Document, loads
from polefence.proof.laws import read_law
from polefence.proof.matrices import Rationals
from polefence.proof.reading import Table, is_double
from polefence.proof.remainder import Rows
from polefence.proof.short import Short
from polefence.proof.text import number_text, region_text
from polefence.proof.work import FormatError, WorkError, counted
from polefence.region.regions import Region, region_of


@dataclass(frozen=True)
class Check(Short):
    """The answer to a claim.

    Attributes
    ----------
    answer : str
        "proved", "refuted" (``alpha`` is an exact counterexample) or "undecided".
    reason : str
    alpha : tuple of Fraction, optional
        A point of the simplex at which a pole does not lie in the region.
    claims : tuple of str
        What the answer is about, a line each, rounded so that it says no more.
    verdicts : tuple of Verdict
        Of each claim of a file as far as they were looked at: its count, the place that fails.
    """

    answer: str
    reason: str
    alpha: tuple[Fraction, ...] | None = None
    claims: tuple[str, ...] = ()
    verdicts: tuple[Verdict, ...] = ()

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    def __str__(self) -> str:
        said = [self.answer, "; ".join(self.claims), self.reason]
        return ": ".join(text for text in said if text)


@dataclass(frozen=True, eq=False)
class Certificate(Short):
    """A claim "this law keeps all poles of this plant in this region", with its evidence.

    Parameters
    ----------
    plant : UncertainPlant
    region : Region
    method : str
        "quadratic", "slack", "scheduled" or "lyapunov".
    law : Law
        For "scheduled" its W, Z are the evidence.
    evidence : mapping
        quadratic: ``W`` (n, n); slack: ``P`` (count, n, n) and ``G`` (n, n), and where they are not
        those of Lemma 2 ``degree``, ``elevation``, ``on``, ``epsilon``; scheduled: ``tau`` and
        ``elevation``; lyapunov: ``on``, and ``parts``, for each part of the region ``X``,
        ``degree``, ``elevation``, and for a scheduled law ``multiple``; or ``cells``, parts of the
        box with ``low``, ``high`` and these each.
    observed : UncertainPlant, optional
        The plant whose dual ``plant`` is, where the law is -L' of an observer: no law of a plant.
    """

    plant: UncertainPlant
    region: Region
    method: str
    law: Law
    evidence: Mapping[str, Any]
    observed: UncertainPlant | None = None

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", Frozen(self.evidence))

    @property
    def observer(self) -> bool:
        """Whether the law is that of an observer."""
        return self.observed is not None

    @property
    def in_parts(self) -> bool:
        """Whether it proves a part of the region in parts of the box, each with its own."""
        return any("cells" in part for part in self.evidence.get("parts", ()))

    @property
    def domain(self) -> Domain:
        """Where its polynomials live: the law's own, of one gain what the evidence says."""
        if self.law.K is None:
            return self.law.domain
        return Domain.of(str(self.evidence.get("on", "simplex")), len(self.plant.vertices))

    @property
    def at_rest(self) -> Certificate:
        """The same for parameters that do not move: of the poles, and of no motion."""
        return replace(self, plant=self.plant.at_rest) if self.plant.moving else self

    def claim(self) -> Poles:
        """Return the claim in exact rationals: that of the design file, a float being a rational.

        Raises
        ------
        PlantError
            If the checker does not take such a claim.
        """
        return self._claim

    @cached_property
    def _claim(self) -> Poles:
        plant = file_plant(self.plant) if self.law.names_signals else bare_plant(self.plant)
        plant = with_nodes(plant, self.plant, self._inner_points)
        try:
            law, on = read_law(Table.of(self.law.document(), "law"), plant)
            head = {"region": self.region.document(), "method": self.method}
            table = Table.of(head | {"evidence": _plain_data(self.evidence)})
            claim = Poles.read_part(table, plant, law, plant.domain(on) if on else "")
            table.done()
            return claim
        except FormatError as error:
            raise PlantError(f"{self.plant.name}: {error}") from error

    @property
    def _inner_points(self) -> set[tuple[Fraction, ...]]:
        """Nodes of the parts of the box that are not its corners."""
        boxes = (cell for part in self.evidence.get("parts", ()) for cell in part.get("cells", ()))
        ends = ((list(map(Fraction, box[key])) for key in ("low", "high")) for box in boxes)
        places = (
            point
            for low, high in ends
            for point in files.lattice(low, high, self.plant.parts_degree)
        )
        return {point for point in places if set(point) - {0, 1}}

    def prove(self) -> Verdict:
        """Decide in exact arithmetic whether the evidence proves the claim.

        What would be more work than the checker does is "undecided".
        """
        return self._verdict

    @cached_property
    def _verdict(self) -> Verdict:
        try:
            return prove(self.claim())
        except WorkError as error:
            return undecided(str(error))
        except FormatError as error:
            raise PlantError(f"{self.plant.name}: {error}") from error

    def check(self) -> Check:
        """Return what `prove` says, in words; where it is not proved, look for a counterexample."""
        claim, verdict = self.claim(), self.prove()
        return _said(claim, verdict) if verdict.proved else check_claim(claim)

    def require_checkable(self, claims: Sequence[Claim] = ()) -> None:
        """Refuse to call proved what `check` of the file would not prove.

        Parameters
        ----------
        claims : sequence of Claim
            What `prove` proved of the same law besides.

        Raises
        ------
        NotProvedError
            Saying why not.
        """
        verdict, claim = self.prove(), self.claim()
        try:
            if not verdict.proved:
                raise FormatError(verdict.reason)
            remainder = self.plant.remainder
            named = self.plant if self.observed is None else self.observed
            sampled = remainder is not None and remainder.source is None
            if sampled and remainder is not None and remainder.curve and named.sampling is None:
                return  # what its samples are of is not known here: there is no file of it alone
            self.file((claim, *claims)).require_checkable((claim, *claims))
        except FormatError as error:
            raise NotProvedError(f"not proved: its file is not proved: {error}") from error

    def holds(self) -> bool:
        """Whether the evidence proves the claim: as `prove`, by the compiled prover first."""
        known = holds(self)
        return self.prove().proved if known is None else known

    def file(self, claims: Sequence[Claim] | None = None) -> Document:
        """Return the file of claims about this plant and law: by default of the certificate's."""
        # other claims need the law alone; they may be for constant parameters
        claim_of_law = self.claim() if claims is None else self.at_rest.claim()
        if self.observed is not None:
            plant, observer = file_plant(self.observed), Observer(claim_of_law, self.plant.inputs)
            claims = (observer,)
            if self.observed.sampling is not None:
                claims = (observer, _samples(self.observed))
            return Document(plant, None, claims, polefence=VERSION)
        asked = (claim_of_law,) if claims is None else tuple(claims)
        points = {point for claim in asked for point in claim.inner_points}
        plant = with_nodes(file_plant(self.plant), self.plant, points)
        if self.plant.sampling is not None:
            asked = (*asked, replace(claim_of_samples(self.plant), plant=plant))
        return Document(plant, claim_of_law.law, asked, claim_of_law.on, polefence=VERSION)

    def document(self) -> dict[str, Any]:
        """Return the design file as plain data for JSON."""
        return self.file().write()

    def dumps(self) -> str:
        """Return the text of the design file."""
        return self.file().dumps()

    @classmethod
    def loads(cls, text: str) -> Certificate:
        """Read the text of a design file; proves nothing.

        Raises
        ------
        DesignFileError
            If the text is no file of a design, or of another version, or its shapes do not fit.
        """
        try:
            return cls.of(loads(text))
        except (FormatError, InputError) as error:
            raise DesignFileError(str(error)) from error

    @classmethod
    def of(cls, document: Document) -> Certificate:
        """Return the design that a file holds: its first claim about a region, or an observer's.

        Raises
        ------
        DesignFileError
            If there is none.
        """
        observer: Observer | None = document.first(Observer)
        claim: Poles | None = document.first(Poles)
        plant, observed = plant_of(document.plant), None
        samples: Samples | None = document.first(Samples)
        if samples is not None:
            origin = sampling_of(samples, plant, document.plant.vehicle)
            plant = replace(plant, sampling=replace(origin, clock=_clock_of(document)))
        if claim is None and observer is not None:
            claim, observed = observer.dual, plant
            C = tuple(tuple(map(tuple, matrix)) for matrix in observer.C)
            plant = dual_plant(plant, C, observer.measured)
        if claim is None and document.first(Clipped) is not None:
            raise DesignFileError(
                "a law of controllable dampers, about no region; simulate, export and check take "
                "it, and concepts compares it with others"
            )
        if claim is None:
            raise DesignFileError("none of its claims is about a region; name the file of a design")
        region = region_of([(part.kind, part.numbers) for part in claim.region])
        law = law_of(claim.law, plant, claim.sizes)
        return cls(plant, region, claim.method, law, _evidence(claim), observed)


def _clock_of(document: Document) -> Clock | None:
    """Return the clock that claims of a file are for; None of one that is perfect."""
    held = (claim.held for claim in document.claims if isinstance(claim, Rms))
    return next((one.clock for one in held if one is not None and one.clock is not None), None)


def _samples(plant: UncertainPlant) -> Samples:
    """Return the claim that a plant is the samples of another, about the plant of the file."""
    return replace(claim_of_samples(plant), plant=file_plant(plant))


def with_nodes(
    written: files.Plant, plant: UncertainPlant, points: Iterable[tuple[Fraction, ...]]
) -> files.Plant:
    """Return a plant of a file with nodes inside the box; as it is where it needs none."""
    if not plant.noded:
        return written
    return replace(written, nodes=tuple(node(plant, point) for point in sorted(points)))


def _rationals(matrix: Array) -> Rationals:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]


def _evidence(claim: Poles) -> dict[str, Any]:
    """Return evidence in floats, words and whole numbers as they are."""
    first = claim.evidence[0]
    if claim.method == "quadratic":
        return {"W": _floats(first.X)[0]}
    if claim.method == "scheduled":
        elevation = {"elevation": first.elevation} if first.elevation != 1 else {}
        return elevation | {"tau": np.array(float(first.tau))}
    if claim.method == "slack":
        form = {"degree": first.degree, "elevation": first.elevation, "on": claim.on}
        evidence = form if form != {"degree": 1, "elevation": 0, "on": "simplex"} else {}
        evidence |= {"epsilon": float(first.epsilon)} if first.epsilon else {}
        return evidence | {"P": _floats(first.X), "G": _floats([first.G or []])[0]}
    parts = tuple(map(part_of, claim.evidence))
    return ({"on": claim.on} if claim.law.fixed else {}) | {"parts": parts}


def part_of(proof: laws.Evidence) -> dict[str, Any]:
    """Return the evidence for one part of a region."""
    if proof.cells:
        ends = [{"low": _row(piece.low), "high": _row(piece.high)} for piece in proof.cells]
        pairs = zip(ends, proof.cells, strict=True)
        return {"cells": tuple(box | part_of(piece.evidence) for box, piece in pairs)}
    part = {"X": _exactly(proof.X), "degree": proof.degree, "elevation": proof.elevation}
    if proof.pieces:
        part["pieces"] = proof.pieces
    if proof.multiple:
        part["multiple"] = np.array([float(v) for v in proof.multiple])
    if proof.spread is not None:
        keys = ("omega", "rows", "columns")
        part["remainder"] = {key: np.array(getattr(proof.spread, key), dtype=float) for key in keys}
    return part


def _plain_data(value: Any) -> Any:
    """Return arrays as lists, mappings as tables."""
    if isinstance(value, Mapping):
        return {k: _plain_data(v) for k, v in value.items()}
    if isinstance(value, tuple):
        return [_plain_data(v) for v in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def check_claim(claim: Poles) -> Check:
    """Prove a claim, refute it by an exact counterexample, or leave it undecided."""
    return _said(claim, *decide(claim))


def _said(claim: Poles, verdict: Verdict, alpha: tuple[Fraction, ...] | None = None) -> Check:
    said = f"poles in {region_text(claim.region)}, of A + B K with {claim.under}"
    return Check(verdict.answer, verdict.reason, alpha, (said,))


def decide(claim: Poles) -> tuple[Verdict, tuple[Fraction, ...] | None]:
    """Prove a claim, or refute it by an alpha, or leave it undecided."""
    with counted(claim.allowed):  # what the proof leaves of it, a counterexample may take
        verdict = prove(claim)
        alpha = None if verdict.proved else counterexample(claim)
    if verdict.proved:
        return verdict, None
    if alpha is None:
        reason = f"{verdict.reason}, but no counterexample was found either"
        return replace(verdict, reason=reason), None
    weights = ", ".join(map(number_text, alpha))
    reason = f"at alpha = ({weights}) a pole is not in the region"
    return replace(verdict, answer="refuted", reason=reason), tuple(alpha)


def _floats(matrices: list[Rationals]) -> Array:
    return np.array([[[float(e) for e in row] for row in matrix] for matrix in matrices])


def _row(values: Sequence[Fraction]) -> Array:
    """Return numbers in floats; as text "p/q" where floats do not hold them."""
    return np.asarray(_exactly([[list(values)]])[0, 0])


def _exactly(matrices: list[Rationals]) -> Array:
    """Return matrices in floats; as text "p/q" where floats do not hold them."""
    if all(is_double(e) for matrix in matrices for row in matrix for e in row):
        return _floats(matrices)
    rows = [[[str(e) for e in row] for row in matrix] for matrix in matrices]
    return np.array(rows, dtype=object)


def in_floats(matrices: Any) -> Array:
    """Return matrices of evidence in floats, also of entries that are text "p/q"."""
    entries = np.asarray(matrices)
    if entries.dtype != object:
        return entries
    return np.array([float(Fraction(e)) for e in entries.ravel()]).reshape(entries.shape)


def sampling_of(
    claim: Samples, plant: UncertainPlant, vehicle: dict[str, Any] | None = None
) -> SamplesOf:
    """Return what a plant of a file is the samples of.

    Parameters
    ----------
    vehicle : dict, optional
        Its description in the file, where it is a car.

    Raises
    ------
    DesignFileError
        If it is not that car.
    """
    n = claim.n
    source = claim.source
    functions = plant.functions if source is None else source.functions
    bare = UncertainPlant.from_vertices(
        claim.A,
        claim.B,
        claim.E or None,
        name=plant.name,
        states=plant.states[:n],
        inputs=plant.inputs[: claim.m],
        disturbances=plant.disturbances,
    )
    try:
        bare = replace(
            bare,
            parameters=plant.parameters,
            remainder=None if source is None else source.on_box,
            functions=functions,
            outputs=tuple(_not_late(plant, claim)),
            vehicle=_quarter_car(vehicle),
            car=plant.car,
            data=plant.data,
        )
    except InputError as error:
        raise DesignFileError(f"plant is malformed: {error}") from error
    return SamplesOf(bare, claim.delay, claim.terms, claim.units, early=claim.early)


def _not_late(plant: UncertainPlant, claim: Samples) -> Iterator[Output]:
    """Yield the outputs of what is sampled: their inputs are late in those of the samples."""
    n, m, width = claim.n, claim.m, claim.width
    for output in plant.every_output:
        C, D, F = output.exact(plant)
        if any(any(row[width:]) or any(row[n : width - m]) for row in C if claim.delay):
            continue
        if not claim.delay and any(any(row[n:]) for row in C):
            continue
        acting = [row[width - m : width] for row in C] if claim.delay else [row[:m] for row in D]
        F = F if claim.E else ()
        near = output.near and output.near.mapped(lambda M: _at_once(M, claim, plant.shape))
        yield Output(output.name, output.unit, [row[:n] for row in C], acting, F, near)


def _rows(matrices: Sequence[list[list[Fraction]]]) -> list[list[Fraction]]:
    return [row for (row,) in matrices]


def _at_once(M: Rows, claim: Samples, shape: tuple[int, int]) -> Rows:
    """Return rows of [C, D, F] of a plant whose inputs are not late."""
    n, m, width, known = claim.n, claim.m, claim.width, sum(shape)
    first = width - m if claim.delay else shape[0]
    return tuple((*row[:n], *row[first : first + m], *row[known:]) for row in M)


WHEELS = "wheels"  # what a car on two or four wheels has, and a quarter car has not


def _quarter_car(described: Any) -> Vehicle | None:
    """Return the quarter car that a file describes, None of others."""
    return None if described is None or WHEELS in described else Vehicle(**described)


def _car(described: Any) -> Car | None:
    """Return the car on two or four wheels that a file describes, None of others."""
    return Car.of(described) if described is not None and WHEELS in described else None


def plant_of(plant: files.Plant) -> UncertainPlant:
    """Return the plant of a file.

    Raises
    ------
    DesignFileError
        If its names or numbers make none.
    """
    try:
        outputs = tuple(
            Output(z.name, z.unit, _rows(z.C), _rows(z.D), _rows(z.F), z.near)
            for z in plant.outputs
        )
        family = UncertainPlant.from_vertices(
            plant.A,
            plant.B,
            plant.E or None,
            name=plant.name,
            states=plant.states,
            inputs=plant.inputs,
            disturbances=plant.disturbances,
            sample_time=plant.sample_time,
            outputs=outputs,
            vehicle=_quarter_car(plant.vehicle if plant.sample_time is None else None),
            noise=plant.noise,
            remainder=plant.remainder,
            functions=plant.functions,
            data=plant.data,
        )
        parameters = tuple(
            Parameter(
                p.name,
                p.low,
                p.high,
                p.unit,
                f"1/{p.name}" if p.inverted else p.name,
                p.label,
                p.rate,
                p.dead_time,
            )
            for p in plant.ranges
        )
        return replace(family, parameters=parameters, car=_car(plant.vehicle))
    except (TypeError, ValueError) as error:
        raise DesignFileError(f"plant is malformed: {error}") from error
