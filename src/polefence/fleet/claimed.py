"""What a file of claims says, against what a question asks: number by number."""

from __future__ import annotations

from collections.abc import Sequence

from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.claims.poles import Poles
from polefence.proof.document import Document
from polefence.proof.laws import Evidence
from polefence.proof.regions import Part, parts_of, write_region
from polefence.region.regions import Region
from polefence.requirements.specification import Specification, claim_of


def is_about(document: Document, plant: UncertainPlant) -> bool:
    """Whether a file is about this plant: its numbers, its time, its parameters and its names."""
    return document.plant == file_plant(plant)


def bounds(document: Document, plant: UncertainPlant, asked: Specification) -> list[BoundClaim]:
    """Return a file's claims about exactly the signal of a specification, at any level.

    Signal, filters, disturbances and whatever else the kind has are those that are claimed of this
    plant: the same numbers, not the same names.
    """
    nothing = Evidence([], transfer=True)  # claims are compared without their evidence
    claims = list[BoundClaim]()
    for claim in document.claims:
        if isinstance(claim, BoundClaim) and claim.kind == asked.kind:
            law, on = claim.subject.law, claim.subject.on
            if claim_of(plant, law, on, asked, nothing, claim.level).bare == claim.bare:
                claims.append(claim)
    return claims


def is_inside(parts: Sequence[Part], region: Region) -> bool:
    """Whether the parts lie inside a region: each of its parts is one, or a disk around one."""

    def covers(whole: Part, part: Part) -> bool:
        if part.circle is not None and whole.circle is not None:
            return part.circle[0] == whole.circle[0] and part.circle[1] <= whole.circle[1]
        return part == whole

    return all(
        any(covers(whole, inner) for inner in parts) for whole in parts_of(region.document())
    )


def fault_of(
    document: Document, plant: UncertainPlant, region: Region, limits: Sequence[Specification]
) -> str:
    """Return the fault of a file: another region, or a missing limit; empty if there is none."""
    poles = document.first(Poles)
    if poles is None or write_region(poles.region) != region.document():
        return f"its file is not about {region}"
    for limit in limits:
        most = limit.at_most
        if most is None or not any(bound.level <= most for bound in bounds(document, plant, limit)):
            text = "" if most is None else f" {most:g}"
            return f"its file has no bound{text} on {limit.title}"
    return ""
