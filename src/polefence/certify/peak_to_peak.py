"""Integrals of responses to impulses, bounded exactly: in what parts of the box floats choose."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import InputError
from polefence.base.progress import stage
from polefence.certify.followed import (
    BITS,
    TERMS,
    Floats,
    above,
    corners,
    followed,
    halves,
    of_part,
    power,
    runs,
    short,
    small,
    tau,
    values,
)
from polefence.certify.foreseen import Foreseen
from polefence.law.law import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.followed import Following
from polefence.proof.claims.peak_to_peak import PeakToPeak
from polefence.proof.laws import Evidence, Piece, Point
from polefence.proof.matrices import identity
from polefence.proof.response import Centred, norms
from polefence.proof.work import MAX_WORK, Count, FormatError, counted
from polefence.requirements import peak_to_peak as requirements
from polefence.requirements.specification import claim_of

SAMPLES = 30
GOALS = (0.015, 0.1)  # by what share a level is above the worst sample
BEGIN = 2.0  # of the fastest mode's time, the first step
OFF, LONGER = 1e-5, 1e-4  # of a level, what residuals leave of it; of that, for longer steps
SPREAD = 2.0  # of sizes of coefficients beside values at corners
LEFT = 1e-3  # of a level, after the last step
DEGREES = (4, 7)  # of the parameters, tried in turn before a part is split
MUCH = 0.3  # of what a level lacks: that much of what is off asks for a higher degree
WARY = 1.2  # times what is foreseen to be off, which is a little more
MORE = 1e6
MOST_STEPS, MOST_PARTS = 4000, 64
SOUGHT = 10 * MAX_WORK  # on the parts that are tried for one level

Proved = tuple[PeakToPeak, Verdict]


@dataclass(frozen=True)
class _Part:
    """What proves one part of the box, and the level that it will prove."""

    piece: Piece
    following: Following
    level: float


def kept(plant: UncertainPlant, law: Law, asked: requirements.PeakToPeak) -> Proved | None:
    """Return the claim that a limit is kept, and its proof; None where there is none."""
    _require_polynomial(law, asked)
    if asked.at_most is None or not _sampled(plant, law, asked) <= asked.at_most:
        return None
    with stage(f"limit on {asked.title}"):
        return _proved(plant, law, asked, asked.at_most, True)


def _require_polynomial(law: Law, asked: requirements.PeakToPeak) -> None:
    if law.W is not None:
        raise InputError(
            f"{asked.title}: bounded disturbances are not proved of a law Z W^-1; run "
            "'polefence optimise' without --method: it tunes a polynomial law for this requirement"
        )


def least(plant: UncertainPlant, law: Law, asked: requirements.PeakToPeak) -> Proved | None:
    """Return the claim of the least level that was proved, and its proof; None of none."""
    _require_polynomial(law, asked)
    worst = _sampled(plant, law, asked)
    if not np.isfinite(worst):
        return None
    with stage(f"bound on {asked.title}"):
        tried = (_proved(plant, law, asked, worst * (1 + goal), False) for goal in GOALS)
        return next((found for found in tried if found is not None), None)


def _sampled(plant: UncertainPlant, law: Law, asked: requirements.PeakToPeak) -> float:
    alpha = seeded(plant, len(plant.vertices) + SAMPLES)
    return float(asked.values(plant, law, alpha).max())


def _proved(
    plant: UncertainPlant, law: Law, asked: requirements.PeakToPeak, goal: float, is_limit: bool
) -> Proved | None:
    """Return the claim of a limit, or of the least level found once the goal is reached."""
    on = law.domain_of(plant).on
    evidence = Evidence([identity(plant.shape[0])])
    blank = claim_of(plant, law.exact, on, asked, evidence, Fraction(goal))
    if not isinstance(blank, PeakToPeak):
        return None
    parts = list[_Part]()
    with suppress(FormatError), counted(SOUGHT) as count:
        parts = _in_parts(blank, count, is_limit)
    if not parts:
        return None
    evidence = parts[0].piece.evidence
    if len(parts) > 1:
        evidence = Evidence([], cells=tuple(part.piece for part in parts), dual=True)
    level = blank.level if is_limit else Fraction(above(max(part.level for part in parts)))
    subject = replace(blank.subject, evidence=evidence)
    following = tuple(part.following for part in parts)
    claim = replace(blank, subject=subject, level=level, following=following)
    with suppress(FormatError), counted(claim.allowed):
        verdict = prove(claim)
        return (claim, verdict) if verdict.proved else None
    return None


@dataclass(frozen=True)
class _Foreseen:
    """A part of the box, and which level of what degree is foreseen for it."""

    low: Point
    high: Point
    level: float
    degree: int


def _in_parts(blank: PeakToPeak, work: Count, is_limit: bool) -> list[_Part]:
    """Return what proves every part of the box; nothing where that was not found.

    Of no limit with the higher levels of parts that there was no more work for.
    """
    sizes, goal = blank.subject.sizes, float(blank.level)
    box = set(sizes) == {2}
    parts, waiting = list[_Part](), [_foreseen(blank, *corners(len(sizes) if box else 0))]
    while waiting:
        part = waiting.pop()
        found = _fading(blank, part) if part.level <= goal else None
        if found is not None and found.level <= goal:
            parts.append(found)
            continue
        many = len(parts) + len(waiting) + 2 > MOST_PARTS
        if box and not many and not small(part.low, part.high) and 2 * work.spent < work.most:
            waiting += _halves(blank, part)
            continue
        found = found if is_limit else found or _fading(blank, part)
        if found is None:
            return []
        parts.append(found)
    return parts


def _halves(blank: PeakToPeak, part: _Foreseen) -> list[_Foreseen]:
    """Return the halves of a part across the parameter that leaves the lowest levels."""
    every = [
        [_foreseen(blank, *half) for half in halves(part.low, part.high, k)]
        for k in range(len(part.low))
    ]
    if all(np.isinf(max(half.level for half in pair)) for pair in every):
        moved = Floats.of(of_part(blank, part.low, part.high)).moved()
        return every[int(np.argmax(moved))]
    return min(every, key=lambda pair: max(half.level for half in pair))


def _foreseen(blank: PeakToPeak, low: Point, high: Point) -> _Foreseen:
    """Return what floats say of a part, whose level is infinite where they find no proof."""
    inner = of_part(blank, low, high)
    loop, goal = _Floats.of(inner), float(blank.level)
    best = _Foreseen(low, high, np.inf, DEGREES[0])
    for evidence, rate, reach in loop.fading():
        for degree in DEGREES:
            following = loop.followed(evidence, rate, reach, degree)
            if following is None:
                break
            with np.errstate(over="ignore", invalid="ignore"):  # too large a part
                size, off = Foreseen.of(inner).bound(following, evidence.X)
            level = size + WARY * off
            if level < best.level:
                best = _Foreseen(low, high, level, degree)
            if level <= goal or WARY * off < MUCH * (level - goal):
                break
        break
    return best


def _fading(blank: PeakToPeak, part: _Foreseen) -> _Part | None:
    """Return what proves a part, as far as errors are proved to fade; None where nothing does."""
    inner = of_part(blank, part.low, part.high)
    loop = _Floats.of(inner)
    for evidence, rate, reach in loop.fading():
        following = loop.followed(evidence, rate, reach, part.degree)
        if following is None:
            return None
        subject = replace(inner.subject, evidence=evidence)
        claim = replace(inner, subject=subject, following=(following,))
        with suppress(FormatError), counted(claim.allowed):
            claim.require()
            if claim.fades().proved:
                size, off = Foreseen.of(inner).bound(following, evidence.X)
                return _Part(Piece(part.low, part.high, evidence), following, size + WARY * off)
    return None


class _Floats(Floats):
    """The loop of one part, and what is followed of it."""

    claim: PeakToPeak

    def followed(
        self, evidence: Evidence, rate: float, reach: float, degree: int
    ) -> Following | None:
        """Return a series of so high a degree; None where none ends."""
        fast = float(np.abs(np.linalg.eigvals(self.A)).max())
        weights = np.array([float(x) for x in norms(evidence.X)])
        planned = self._planned(fast, weights, rate, reach)
        if planned is None:
            return None
        unit, lengths = planned
        steps = sum(count for _, count in lengths)
        level = float(self.claim.level) * rate
        size = reach * weights.sum() * TERMS * (degree + 1) * steps * MORE / level
        bits = max(BITS, math.ceil(math.log2(size)))
        return Following(unit, lengths, TERMS, degree, bits, short(rate), short(reach))

    def _planned(
        self, fast: float, weights: Array, rate: float, reach: float
    ) -> tuple[Fraction, tuple[tuple[int, int], ...]] | None:
        """Return a unit, and steps as long as the tau method bears, until little is left."""
        unit, level = power(BEGIN / fast), float(self.claim.level)
        x, none = self._starts(), np.zeros((*self.A.shape[:2], 1))
        lengths, length = list[int](), 1
        inverses: dict[int, Array] = {}
        while len(lengths) < MOST_STEPS:
            left = SPREAD * reach * (np.abs(x) @ weights).sum(axis=0).max() / rate
            if left < LEFT * level and lengths:
                return unit, runs(lengths)
            while True:
                h = float(length * unit)
                if length not in inverses:
                    inverses[length] = tau(self.A, h)
                c = np.array([followed(inverses[length], own, none, h) for own in x])
                left_over = np.abs(self.A @ c[:, :, -1, :, None])[..., 0] @ weights
                off = reach * float(left_over.sum(axis=0).max()) / rate
                if off < OFF * level or length == 1:
                    break
                length //= 2
            x = c.sum(axis=2)
            lengths.append(length)
            if off < OFF * level * LONGER:
                length *= 2
        return None

    def _starts(self) -> Array:
        """Return the states after impulses of the disturbances, (q, 1 + corners, n)."""
        subject = self.claim.subject
        E = subject.driving(self.claim.scales, subject.sizes)
        middle = np.concatenate([np.full(size, 1 / size) for size in self.domain.sizes])
        at = np.concatenate([middle[None], self.domain.coordinates(np.eye(self.domain.corners))])
        return np.moveaxis(values(Centred.of(E), self.domain, at), 2, 0)
