"""Claims of margins: one search for the largest that is proved, whatever is off, and its proof.

A kind of margin is a `Question`: how far floats reach at a fineness, and the claim of a value. A
search climbs from one fineness to the next while it gains; the exact proof decides, of a little
less where what floats say is too much.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Protocol

from polefence.base.explained import explained
from polefence.base.processors import small_matrices
from polefence.certify.candidates import Deadline, first, rising
from polefence.certify.certificate import Certificate
from polefence.certify.design import Design
from polefence.certify.given import analyse, analysed
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.delta import delta_form
from polefence.plant.exact import ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.proof import work
from polefence.proof.claims.base import prove
from polefence.proof.claims.margins import MarginClaim, Subject
from polefence.proof.laws import Evidence
from polefence.proof.regions import parts_of
from polefence.region.regions import Disk, HalfPlane, Region

# Pieces of each parameter's interval and elevation that are tried, while they gain something.
BOX, SIMPLEX = ((1, 0), (1, 1), (2, 0), (4, 0), (8, 0)), ((1, 0), (1, 1), (1, 2), (1, 3))
GAIN = 0.01
# Inequalities of one claim: above the first number no finer proof is tried, above the second none.
ENOUGH, MOST = 1500, 25_000
# What is proved of what the search reaches, until a proof succeeds: of 70 margins of 13 designs 68
# times all of it, twice the second share.
RETREATS = (1.0, 0.999, 0.995, 0.99, 0.97, 0.9, 0.7, 0.4)
BITS = 16  # of a margin: short numbers make short proofs
# How much smaller regions are whose matrices are tried, one after the other, where the design's own
# leave no room, and values of the parameters at which poles are to be in one twice as small. The
# ride study's law for stability bears 1.3e-5 of its gain's scale by its own, 4.67 by the first two.
FIRMER, POINTS = (0.1, 0.01, 1e-3), 100

Ladder = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Reached:
    """A value that is proved in floats, and how finely.

    ``largest`` has, of errors of the gain, the largest for each L, M of the region, with its mu;
    ``cover`` is how many times the design's Omega the claim has, where the plant has a remainder.
    """

    value: float
    pieces: int
    elevation: int
    largest: tuple[tuple[float, float], ...] = ()
    cover: float = 1.0


class Question(Protocol):
    """Search for the largest error or rate."""

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried."""

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest value that is proved in floats, below zero where none is."""

    def claim(self, subject: Subject, reached: Reached) -> MarginClaim:
        """Return the claim of a value, or a little less: numbers of few digits."""


def climb(question: Question) -> Iterator[Reached]:
    """Yield what is reached at one fineness after another, while it grows."""

    def every() -> Iterator[Reached]:
        best: Reached | None = None
        for fineness in question.ladder:
            if question.count(*fineness) > (ENOUGH if best else MOST):
                return
            reached = question.reach(*fineness)
            if best or reached.value >= 0:
                best = reached
                yield reached
            if math.isinf(reached.value):
                return

    return rising(every(), lambda reached: reached.value, GAIN)


def proved(question: Question, design: Design, region: Region) -> MarginClaim | None:
    """Return the claim of the largest value reached, or of a little less; None if none is proved.

    Parameters
    ----------
    design : Design
        The one that claims are made of, `claimed_design`.
    """
    reached = list(climb(question))
    return proved_at(question, reached[-1], design, region) if reached else None


def proved_at(
    question: Question, reached: Reached, design: Design, region: Region
) -> MarginClaim | None:
    """Return the claim of what was reached, or of a little less; None if none is proved."""
    subject = subject_of(design, region, reached)

    def attempt(share: float) -> MarginClaim | None:
        claim = question.claim(subject, replace(reached, value=reached.value * share))
        return claim if holds(claim) else None

    return first(map(attempt, RETREATS))


def subject_of(design: Design, region: Region, reached: Reached) -> Subject:
    """Return what a claim is about: a design and a region, and how finely it is proved."""
    whole = design.certificate.at_rest.claim()
    ranges = ranges_of(design.plant)
    claim = replace(whole, region=parts_of(region.document()))
    if reached.cover != 1:
        claim = replace(
            claim, evidence=tuple(_covering(proof, reached.cover) for proof in whole.evidence)
        )
    return Subject(claim, ranges, (reached.pieces,) * len(ranges), reached.elevation)


def _covering(evidence: Evidence, cover: float) -> Evidence:
    """Return evidence with a multiple of its Omega, in every part of the box."""
    cells = tuple(
        replace(piece, evidence=_covering(piece.evidence, cover)) for piece in evidence.cells
    )
    if evidence.spread is None:
        return replace(evidence, cells=cells)
    omega = [[value * Fraction(cover) for value in row] for row in evidence.spread.omega]
    return replace(evidence, cells=cells, spread=replace(evidence.spread, omega=omega))


def holds(claim: MarginClaim) -> bool:
    """Whether a claim is proved in exact arithmetic."""
    try:
        return prove(claim).proved
    except work.FormatError:  # more than the checker takes on
        return False


def below(value: float) -> Fraction:
    """Return a number a little below, of few digits."""
    mantissa, exponent = math.frexp(value)
    return Fraction(math.floor(mantissa * 2**BITS)) * Fraction(2) ** (exponent - BITS)


def above(value: float) -> Fraction:
    """Return a number that is not below, of few digits."""
    return -below(-value)


@explained
def claimed_design(design: Design, region: Region | None = None) -> Design | None:
    """Return the design that claims about a design in service are made of.

    That is itself. For the method "slack", whose proof is about one gain but has no one Lyapunov
    matrix, the same gain over the same region with Lyapunov polynomials; likewise for the method
    "lyapunov" and another region than its own. None where these do not prove it. As the claims are
    about constant parameters, so is what proves it.
    """
    kept = design.region if region is None else region
    methods = ("scheduled", "quadratic", *(("lyapunov",) if kept == design.region else ()))
    if design.method in methods:
        return design
    certificate = analyse(design.plant.at_rest, design.law, kept).certificate
    return None if certificate is None else at_rest(certificate, design.plant)


def firmer(design: Design, region: Region) -> Iterator[Design]:
    """Yield designs of the same law and of a region, whose matrices are those of smaller regions.

    Those of a region that a law keeps with much room may leave none for errors. Of a smaller region
    as little is tried as proved the region itself: where there is no such proof, of a law near its
    edge, `analyse` would try every degree, and hundreds of parts of the box, three times.
    """
    plant, like = design.plant.at_rest, design.certificate
    edge: Region = HalfPlane(0)
    rate = typical_rate(plant.A)
    if plant.sample_time is not None:
        edge, rate = Disk(0, 1), min(1.0, plant.period * typical_rate(delta_form(plant).A))
    poles = design.poles(seeded(plant, POINTS))
    for share in FIRMER:
        smaller, least = (region.tighter(part, edge, rate) for part in (share, 2 * share))
        if len(smaller.parts) != len(region.parts) or not least.contains(poles):
            continue
        with small_matrices():
            certificate = analysed(plant, design.law, smaller, Deadline(), like).certificate
        if certificate is not None:
            yield at_rest(replace(certificate, region=region), design.plant)


def at_rest(certificate: Certificate, plant: UncertainPlant) -> Design:
    """Return a design by evidence for constant parameters: where they move it is no proof."""
    return Design(replace(certificate, plant=plant), proved=not plant.moving)
