"""Certificates: everything a claim about poles rests on, as a frozen value and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np

from polefence.base.errors import DesignFileError, InputError, PlantError
from polefence.design.counterexample import counterexample
from polefence.design.statement import number_text, poles_text
from polefence.law.laws import FixedGain, Law, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array, Exact
from polefence.plant.vehicle import Vehicle
from polefence.proof import placement, reading, work
from polefence.proof.matrices import Rationals
from polefence.region.regions import Region, region_of


@dataclass(frozen=True)
class Check:
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
    """

    answer: str
    reason: str
    alpha: tuple[Fraction, ...] | None = None
    claims: tuple[str, ...] = ()

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    def __str__(self) -> str:
        said = [self.answer, "; ".join(self.claims), self.reason]
        return ": ".join(text for text in said if text)


@dataclass(frozen=True, eq=False)
class Certificate:
    """A claim "this law keeps all poles of this plant in this region", with its evidence.

    Parameters
    ----------
    plant : UncertainPlant
    region : Region
    method : str
        "quadratic", "slack", "scheduled" or "lyapunov".
    law : FixedGain or ScheduledGain
        For "scheduled" its W, Z are the evidence.
    evidence : mapping
        quadratic: ``W`` (n, n); slack: ``P`` (count, n, n) and ``G`` (n, n), and where they are not
        those of Lemma 2 ``degree``, ``elevation``, ``on``, ``epsilon``; scheduled: ``tau`` and
        ``elevation``; lyapunov: ``on``, and ``parts``, for each part of the region ``X``,
        ``degree``, ``elevation``, and for a scheduled law ``multiple``.
    observer : bool
        Whether the plant is the dual of one that is observed, and the law -L': no law of a plant.
    """

    plant: UncertainPlant
    region: Region
    method: str
    law: Law
    evidence: Mapping[str, Any]
    observer: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy does not travel between processes.
        own = self.plant, self.region, self.method, self.law, dict(self.evidence), self.observer
        return Certificate, own

    def claim(self) -> placement.Claim:
        """Return the claim in exact rationals: that of the design file, a float being a rational.

        Raises
        ------
        PlantError
            If the checker does not take such a claim.
        """
        A = [[list(row) for row in v.exact_A] for v in self.plant.vertices]
        B = [[list(row) for row in v.exact_B] for v in self.plant.vertices]
        try:
            claim = placement.claim_of(self._claimed(), A, B)
            placement.require_box(claim, self.plant.parameters)
            return claim
        except work.FormatError as error:
            raise PlantError(f"{self.plant.name}: {error}") from error

    def prove(self) -> placement.Verdict:
        """Decide in exact arithmetic whether the evidence proves the claim.

        Raises
        ------
        PlantError
            If there are more inequalities than the checker takes on.
        """
        try:
            return placement.prove(self.claim())
        except work.FormatError as error:
            raise PlantError(f"{self.plant.name}: {error}") from error

    def document(self) -> dict[str, Any]:
        """Return the design file as plain data for JSON."""
        head = {"format": placement.FORMAT, "version": placement.VERSION}
        mark = {"observer": True} if self.observer else {}
        return head | mark | {"plant": plant_document(self.plant)} | self._claimed()

    def _claimed(self) -> dict[str, Any]:
        if isinstance(self.law, ScheduledGain):
            law = {"kind": "scheduled", "W": self.law.W.tolist(), "Z": self.law.Z.tolist()}
            if self.law.degree != 1:
                law["degree"] = self.law.degree
            if len(self.law.sizes) > 1:
                law["on"] = "box"
        else:
            law = {"kind": "fixed", "K": self.law.K.tolist()}
        return {
            "region": self.region.document(),
            "method": self.method,
            "law": law,
            "certificate": _plain_data(self.evidence),
        }

    def dumps(self) -> str:
        """Return the text of the design file."""
        return json.dumps(self.document(), indent=1, allow_nan=False) + "\n"

    @classmethod
    def loads(cls, text: str) -> Certificate:
        """Read the text of a design file; proves nothing.

        Raises
        ------
        DesignFileError
            If the text is no design file of this version, or its shapes do not fit.
        """
        try:
            claim, document = placement.read(text)
            plant = plant_from(document["plant"])
            region = region_of([(part.kind, part.numbers) for part in claim.region])
            law: Law
            if claim.law.K is not None:
                law = FixedGain(_floats(claim.law.K)[0])
            else:
                W, Z = _floats(claim.law.W or []), _floats(claim.law.Z or [])
                sizes = placement.simplices(claim)
                law = ScheduledGain(W, Z, plant.parameters, claim.law.degree, sizes)
            evidence = _evidence(claim, document["certificate"])
            observer = document.get("observer", False)
            if type(observer) is not bool:
                raise DesignFileError("observer must be true or false")
        except (work.FormatError, InputError) as error:
            raise DesignFileError(str(error)) from error
        return cls(plant, region, claim.method, law, evidence, observer)


def _evidence(claim: placement.Claim, table: dict[str, Any]) -> dict[str, Any]:
    """Return the evidence of a file: matrices in floats, words and whole numbers as they are."""
    first = claim.evidence[0]
    plain = {k: v for k, v in table.items() if k in ("degree", "elevation", "on")}
    if claim.method == "quadratic":
        return {"W": _floats(first.X)[0]}
    if claim.method == "scheduled":
        return plain | {"tau": np.array(float(first.tau))}
    if claim.method == "slack":
        epsilon = {"epsilon": float(first.epsilon)} if first.epsilon else {}
        return plain | epsilon | {"P": _floats(first.X), "G": _floats([first.G or []])[0]}
    parts = []
    for each in claim.evidence:
        part = {"X": _floats(each.X), "degree": each.degree, "elevation": each.elevation}
        multiple = {"multiple": np.array([float(v) for v in each.multiple])}
        parts.append(part | multiple if each.multiple else part)
    return plain | {"parts": tuple(parts)}


def _plain_data(value: Any) -> Any:
    """Return arrays as lists, mappings as tables."""
    if isinstance(value, Mapping):
        return {k: _plain_data(v) for k, v in value.items()}
    if isinstance(value, tuple):
        return [_plain_data(v) for v in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def check_claim(claim: placement.Claim) -> Check:
    """Prove a claim, refute it by an exact counterexample, or leave it undecided."""
    with work.counted():  # what the proof leaves of it, a counterexample may take
        return _decided(claim)


def _decided(claim: placement.Claim) -> Check:
    verdict, said = placement.prove(claim), (poles_text(claim),)
    if verdict.proved:
        return Check("proved", verdict.reason, claims=said)
    alpha = counterexample(claim)
    if alpha is not None:
        weights = ", ".join(map(number_text, alpha))
        reason = f"at alpha = ({weights}) a pole is not in the region"
        return Check("refuted", reason, tuple(alpha), said)
    reason = f"{verdict.reason}, but no counterexample was found either"
    return Check("undecided", reason, claims=said)


def _floats(matrices: list[Rationals]) -> Array:
    return np.array([[[float(e) for e in row] for row in matrix] for matrix in matrices])


def plant_document(plant: UncertainPlant) -> dict[str, Any]:
    """Return a plant as a design file has it."""
    parameters = [
        {
            "name": p.name,
            "range": [_plain(p.low), _plain(p.high)],
            "unit": p.unit,
            "through": p.through,
        }
        for p in plant.parameters
    ]
    vertices = []
    for vertex in plant.vertices:
        matrices = {"A": vertex.exact_A, "B": vertex.exact_B, "E": vertex.exact_E}
        vertices.append({k: _rows(M) for k, M in matrices.items() if M is not None})
    time = plant.sample_time
    return {
        "name": plant.name,
        **({} if time is None else {"sample_time": _plain(time)}),
        "states": list(plant.states),
        "inputs": list(plant.inputs),
        "disturbances": list(plant.disturbances),
        **_described(plant),
        "parameters": parameters,
        "vertices": vertices,
    }


def _described(plant: UncertainPlant) -> dict[str, Any]:
    """Return outputs and vehicle, where there are any."""
    found: dict[str, Any] = {}
    if plant.every_output:
        found["outputs"] = [
            {"name": own.name, "unit": own.unit}
            | {key: _rows(getattr(own, key)) for key in "CDF" if getattr(own, key)}
            for own in plant.every_output
        ]
    return found | ({} if plant.vehicle is None else {"vehicle": asdict(plant.vehicle)})


def _rows(matrix: Exact) -> list[list[Any]]:
    return [[_plain(entry) for entry in row] for row in matrix]


def _plain(value: Fraction) -> float | int | str:
    """A number where a double holds the value exactly, else the string "p/q"."""
    if value.denominator == 1 and abs(value.numerator) < 2**53:
        return value.numerator
    return float(value) if _is_double(value) else f"{value.numerator}/{value.denominator}"


def _is_double(value: Fraction) -> bool:
    try:
        return Fraction(float(value)) == value
    except OverflowError:
        return False


def plant_from(data: dict[str, Any]) -> UncertainPlant:
    """Return the plant of a design file.

    Raises
    ------
    DesignFileError
        If it is malformed.
    """
    try:
        parameters = tuple(_parameter(p) for p in data["parameters"])
        As, Bs = ([v[key] for v in data["vertices"]] for key in "AB")
        Es = [v["E"] for v in data["vertices"]] if "E" in data["vertices"][0] else None
        names: dict[str, Any] = {k: _labels(data, k) for k in ("states", "inputs", "disturbances")}
        if "sample_time" in data:
            names["sample_time"] = reading.read_number(data["sample_time"], "plant.sample_time")
        names["outputs"] = tuple(Output(**table) for table in data.get("outputs", ()))
        names["vehicle"] = Vehicle(**data["vehicle"]) if "vehicle" in data else None
        plant = UncertainPlant.from_vertices(As, Bs, Es, name=data["name"], **names)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise DesignFileError(f"plant is malformed: {error}") from error
    return replace(plant, parameters=parameters)


def _labels(data: dict[str, Any], key: str) -> tuple[Any, ...]:
    if not isinstance(data[key], list):
        raise TypeError(f"{key} must be a list of names")
    return tuple(data[key])


def _parameter(data: dict[str, Any]) -> Parameter:
    low, high = (reading.read_number(b, "parameter range") for b in data["range"])
    return Parameter(data["name"], low, high, data["unit"], data["through"])
