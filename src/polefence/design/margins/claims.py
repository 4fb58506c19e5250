"""Claims of margins: what a search reaches with finer and finer proofs, and the exact proofs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Protocol

from polefence.design.certificate import ranges_of
from polefence.design.design import Design
from polefence.design.given import analyse
from polefence.design.search import first, rising
from polefence.proof import work
from polefence.proof.claims.base import prove
from polefence.proof.claims.margins import MarginClaim, Subject
from polefence.proof.regions import parts_of
from polefence.region.regions import Region

# Pieces of each parameter's interval and elevation that are tried, while they gain something.
BOX, SIMPLEX = ((1, 0), (1, 1), (2, 0), (4, 0), (8, 0)), ((1, 0), (1, 1), (1, 2), (1, 3))
GAIN = 0.01
# Inequalities of one claim: above the first number no finer proof is tried, above the second none.
ENOUGH, MOST = 1500, 25_000
# What is proved of what the search reaches, until a proof succeeds.
RETREATS = (1.0, 0.999, 0.99, 0.95, 0.8, 0.5)
BITS = 16  # of a margin: short numbers make short proofs


@dataclass(frozen=True)
class Reached:
    """A value that is proved in floats, and how finely.

    ``each`` has, of errors of the gain, the largest for each L, M of the region, with its mu.
    """

    value: float
    pieces: int
    elevation: int
    each: tuple[tuple[float, float], ...] = ()


Ladder = tuple[tuple[int, int], ...]


class Question(Protocol):
    """How large an error or a rate may be."""

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
    if not reached:
        return None
    best = reached[-1]
    subject = subject_of(design, region, best)

    def attempt(share: float) -> MarginClaim | None:
        claim = question.claim(subject, replace(best, value=best.value * share))
        return claim if holds(claim) else None

    return first(map(attempt, RETREATS))


def subject_of(design: Design, region: Region, reached: Reached) -> Subject:
    """Return what a claim is about: a design and a region, and how finely it is proved."""
    own = design.certificate.claim()
    ranges = ranges_of(design.plant)
    claim = replace(own, region=parts_of(region.document()))
    return Subject(claim, ranges, (reached.pieces,) * len(ranges), reached.elevation)


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


def claimed_design(design: Design, region: Region | None = None) -> Design | None:
    """Return the design that claims about a design in service are made of.

    That is itself. For the method "slack", whose proof is about one gain but has no one Lyapunov
    matrix, the same gain over the same region with Lyapunov polynomials; likewise for the method
    "lyapunov" and another region than its own. None where these do not prove it.
    """
    kept = design.region if region is None else region
    own = ("scheduled", "quadratic", *(("lyapunov",) if kept == design.region else ()))
    if design.method in own:
        return design
    found = analyse(design.plant, design.law, kept)
    return found.design if found.proved else None
