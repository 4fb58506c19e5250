"""Certificates: everything a claim about poles rests on, as a frozen value and as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np

from polefence.errors import DesignFileError, InputError, PlantError
from polefence.law import FixedGain, Law, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array, Exact
from polefence.proof import exact
from polefence.proof.refute import counterexample
from polefence.region import Disk


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
    """

    answer: str
    reason: str
    alpha: tuple[Fraction, ...] | None = None

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    def __str__(self) -> str:
        return f"{self.answer}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Certificate:
    """A claim "this law keeps all poles of this plant in this disk", with its evidence.

    Parameters
    ----------
    plant : UncertainPlant
    region : Disk
    method : str
        "quadratic", "slack" or "scheduled".
    law : FixedGain or ScheduledGain
        For "scheduled" its W, Z are the evidence.
    evidence : mapping
        quadratic: ``W`` (n, n); slack: ``P`` (N, n, n) and ``G`` (n, n); scheduled: ``tau``.
    """

    plant: UncertainPlant
    region: Disk
    method: str
    law: Law
    evidence: Mapping[str, Array]

    def __post_init__(self) -> None:
        object.__setattr__(self, "evidence", MappingProxyType(dict(self.evidence)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy does not travel between processes.
        return Certificate, (self.plant, self.region, self.method, self.law, dict(self.evidence))

    def claim(self) -> exact.Claim:
        """Return the claim in exact rationals; a float is the rational it is."""
        A = [[list(row) for row in v.exact_A] for v in self.plant.vertices]
        B = [[list(row) for row in v.exact_B] for v in self.plant.vertices]
        sigma, r = Fraction(-self.region.centre), Fraction(self.region.radius)
        e = self.evidence
        if isinstance(self.law, ScheduledGain):
            W, Z = _rationals(self.law.W), _rationals(self.law.Z)
            tau = Fraction(float(e["tau"]))
            return exact.Claim(self.method, A, B, sigma, r, X=W, Z=Z, tau=tau)
        K = _rationals(self.law.K[None])[0]
        if self.method == "quadratic":
            return exact.Claim(self.method, A, B, sigma, r, X=_rationals(e["W"][None]), K=K)
        G = _rationals(e["G"][None])[0]
        return exact.Claim(self.method, A, B, sigma, r, X=_rationals(e["P"]), K=K, G=G)

    def prove(self) -> exact.Verdict:
        """Decide in exact arithmetic whether the evidence proves the claim.

        Raises
        ------
        PlantError
            If there are more inequalities than the checker takes on.
        """
        try:
            return exact.prove(self.claim())
        except exact.FormatError as error:
            raise PlantError(f"{self.plant.name}: {error}") from error

    def document(self) -> dict[str, Any]:
        """Return the design file as plain data for JSON."""
        if isinstance(self.law, ScheduledGain):
            law = {"kind": "scheduled", "W": self.law.W.tolist(), "Z": self.law.Z.tolist()}
        else:
            law = {"kind": "fixed", "K": self.law.K.tolist()}
        return {
            "format": exact.FORMAT,
            "version": exact.VERSION,
            "plant": _plant_document(self.plant),
            "region": {"kind": "disk", "centre": self.region.centre, "radius": self.region.radius},
            "method": self.method,
            "law": law,
            "certificate": {k: np.asarray(v).tolist() for k, v in self.evidence.items()},
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
            claim, document = exact.read(text)
            plant = _plant(document["plant"])
            region = Disk(float(-claim.sigma), float(claim.r))
            law: Law
            if claim.Z is not None:
                law = ScheduledGain(_floats(claim.X), _floats(claim.Z), plant.parameters)
                evidence = {"tau": np.array(float(claim.tau))}
            else:
                law = FixedGain(_floats([claim.K or []])[0])
                if claim.G is None:
                    evidence = {"W": _floats(claim.X)[0]}
                else:
                    evidence = {"P": _floats(claim.X), "G": _floats([claim.G])[0]}
        except (exact.FormatError, InputError) as error:
            raise DesignFileError(str(error)) from error
        return cls(plant, region, claim.method, law, evidence)


def check_claim(claim: exact.Claim) -> Check:
    """Prove a claim, refute it by an exact counterexample, or leave it undecided."""
    verdict = exact.prove(claim)
    if verdict.proved:
        return Check("proved", verdict.reason)
    alpha = counterexample(claim)
    if alpha is not None:
        weights = ", ".join(f"{float(a):.4g}" for a in alpha)
        return Check("refuted", f"at alpha = ({weights}) a pole is not in the disk", tuple(alpha))
    return Check("undecided", f"{verdict.reason}, but no counterexample was found either")


def _rationals(matrices: Array) -> list[exact.Rationals]:
    return [[[Fraction(e) for e in row] for row in matrix] for matrix in matrices.tolist()]


def _floats(matrices: list[exact.Rationals]) -> Array:
    return np.array([[[float(e) for e in row] for row in matrix] for matrix in matrices])


def _plant_document(plant: UncertainPlant) -> dict[str, Any]:
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
    return {
        "name": plant.name,
        "states": list(plant.states),
        "inputs": list(plant.inputs),
        "disturbances": list(plant.disturbances),
        "parameters": parameters,
        "vertices": vertices,
    }


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


def _plant(data: dict[str, Any]) -> UncertainPlant:
    try:
        parameters = tuple(_parameter(p) for p in data["parameters"])
        As, Bs = ([v[key] for v in data["vertices"]] for key in "AB")
        Es = [v["E"] for v in data["vertices"]] if "E" in data["vertices"][0] else None
        names = {key: tuple(data[key]) for key in ("states", "inputs", "disturbances")}
        plant = UncertainPlant.from_vertices(As, Bs, Es, name=str(data["name"]), **names)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise DesignFileError(f"plant is malformed: {error}") from error
    return replace(plant, parameters=parameters)


def _parameter(data: dict[str, Any]) -> Parameter:
    low, high = (exact.read_number(b, "parameter range") for b in data["range"])
    return Parameter(data["name"], low, high, data["unit"], data["through"])
