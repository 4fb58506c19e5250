"""Responses that are followed exactly: in what parts of the box, and how, floats choose."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np

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
)
from polefence.law.law import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.followed import Following
from polefence.proof.claims.measured import MeasuredResponse
from polefence.proof.laws import Evidence, Piece, Point
from polefence.proof.matrices import identity
from polefence.proof.response import norms
from polefence.proof.work import MAX_WORK, Count, FormatError, counted
from polefence.requirements.measured import TIMES, Measured
from polefence.requirements.specification import claim_of

SAMPLES = 30
STEPS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # by what share a level is above the worst sample
NOTHING = 1e-6  # an overshoot of none, as a share
BEGIN = 2.0  # of the fastest mode's time, the first step
OFF, LONGER = 1e-7, 1e-4  # of what is allowed, a residual; of that, for which steps are longer
SPREAD = 2.0  # of sizes of coefficients beside values at corners
DEGREES = (4, 7)  # of the parameters, tried in turn before a part is split
MORE = 1e6
IN_A_TURN = Fraction(1, 4)  # of what drives the loop, the first step: it is then off by 1e-11
FINE = 60  # bits of what drives the loop, of which floats keep 53
SHARE = 0.3  # of what is allowed after the last step
MOST_STEPS, MOST_PARTS = 4000, 256
# Work on the parts that are tried for one limit, and for each level of a bound. Where a part fails
# after half of it, none is split any more: a minute for a limit. Of 21 measures of random families
# with up to six states and three parameters every level that is proved takes at most 2e9.
SOUGHT = 10 * MAX_WORK
SOUGHT_EACH = SOUGHT // 5

Proved = tuple[MeasuredResponse, Verdict]


def kept(plant: UncertainPlant, law: Law, asked: Measured) -> Proved | None:
    """Return the claim that a limit is kept, and its proof; None where there is none."""
    if asked.at_most is None or not _sampled(plant, law, asked) <= asked.at_most:
        return None
    with stage(f"limit on {asked.title}"):
        return _proved(plant, law, asked, asked.at_most, SOUGHT)


def least(plant: UncertainPlant, law: Law, asked: Measured) -> Proved | None:
    """Return the claim of the least level that was proved, and its proof; None of none."""
    worst = _sampled(plant, law, asked)
    if not np.isfinite(worst):
        return None
    with stage(f"bound on {asked.title}"):
        for share in STEPS:
            level = max(worst, NOTHING if asked.relative else 0.0) * (1 + share)
            if asked.measure in ("overshoot", "undershoot"):
                level = max(level, share)
            found = _proved(plant, law, asked, above(level), SOUGHT_EACH)
            if found is not None:
                return found
    return None


def _sampled(plant: UncertainPlant, law: Law, asked: Measured) -> float:
    alpha = seeded(plant, len(plant.vertices) + SAMPLES)
    return float(asked.values(plant, law, alpha).max())


def _proved(
    plant: UncertainPlant, law: Law, asked: Measured, level: float, work: int
) -> Proved | None:
    """Return the claim of a level, and its proof, with so much work on its parts."""
    on = law.domain_of(plant).on
    evidence = Evidence([identity(plant.shape[0])])
    blank = claim_of(plant, law.exact, on, asked, evidence, Fraction(level))
    if not isinstance(blank, MeasuredResponse):
        return None
    parts = list[tuple[Piece, Following]]()
    with suppress(FormatError), counted(work) as count:
        parts = _in_parts(blank, count)
    if not parts:
        return None
    evidence = parts[0][0].evidence
    if len(parts) > 1:
        evidence = Evidence([], cells=tuple(piece for piece, _ in parts), dual=True)
    subject = replace(blank.subject, evidence=evidence)
    claim = replace(blank, subject=subject, following=tuple(own for _, own in parts))
    with suppress(FormatError), counted(claim.allowed):
        verdict = prove(claim)
        return (claim, verdict) if verdict.proved else None
    return None


def _in_parts(blank: MeasuredResponse, work: Count) -> list[tuple[Piece, Following]]:
    """Return what proves every part of the box; nothing where that was not found."""
    sizes = blank.subject.sizes
    box = set(sizes) == {2}
    parts, waiting = list[tuple[Piece, Following]](), [corners(len(sizes) if box else 0)]
    while waiting:
        low, high = waiting.pop()
        found = _part(blank, low, high)
        if found is not None:
            parts.append(found)
            continue
        many = len(parts) + len(waiting) + 2 > MOST_PARTS
        if not box or many or small(low, high) or 2 * work.spent > work.most:
            return []
        moved = Floats.of(of_part(blank, low, high)).moved()
        waiting += halves(low, high, int(np.argmax(moved)))
    return parts


def _part(blank: MeasuredResponse, low: Point, high: Point) -> tuple[Piece, Following] | None:
    """Return what proves one part; None where nothing was found."""
    inner = of_part(blank, low, high)
    loop = _Floats.of(inner)
    for evidence, rate, reach in loop.fading():
        subject = replace(inner.subject, evidence=evidence)
        for degree in DEGREES:
            following = loop.followed(evidence, rate, reach, degree)
            if following is None:
                return None
            claim = replace(inner, subject=subject, following=(following,))
            with suppress(FormatError), counted(claim.allowed):
                claim.require()
                if not claim.fades().proved:
                    break
                if not claim.missed():
                    return Piece(low, high, evidence), following
    return None


class _Floats(Floats):
    """The loop of one part, and what is followed of it."""

    claim: MeasuredResponse

    def followed(
        self, evidence: Evidence, rate: float, reach: float, degree: int
    ) -> Following | None:
        """Return a series of so high a degree; None where too little is allowed, or none ends."""
        rest = np.array([not drive.rests for drive in self.run.drives], dtype=float)
        ends = -np.linalg.solve(self.A, (self.b @ rest)[..., None])[..., 0]
        final = np.einsum("ki,ki->k", self.C, ends) + self.F
        allowed = self._allowed(final)
        if allowed <= 0:
            return None
        fast = float(np.abs(np.linalg.eigvals(self.A)).max())
        weights = np.array([float(x) for x in norms(evidence.X)])
        planned = self._planned(fast, np.asarray(ends), weights, reach, allowed)
        if planned is None:
            return None
        unit, lengths = planned
        steps = sum(count for _, count in lengths)
        size = reach * weights.sum() * TERMS * (degree + 1) * steps * MORE / allowed
        bits = max(BITS, math.ceil(math.log2(size)))
        return Following(unit, lengths, TERMS, degree, bits, short(rate), short(reach))

    def _allowed(self, final: Array) -> float:
        """Return how far the signal may be from its final value after the last step."""
        level, size = float(self.claim.level), np.abs(final)
        match self.claim.measure:
            case "peak":
                return float((level - size).min())
            case "overshoot":
                return float(level * size.min())
            case "undershoot":
                return float((1 + level) * size.min())
            case "settling":
                return float(self.claim.band) * (float(size.min()) if self.claim.has_final else 1.0)
            case "envelope" if self.claim.envelope is not None:
                _, lower, upper = map(float, self.claim.envelope.points[-1])
                return float((level * (upper - lower) / 2 - abs(final - (upper + lower) / 2)).min())
            case _:
                return float(size.min())

    def _planned(
        self, fast: float, ends: Array, weights: Array, reach: float, allowed: float
    ) -> tuple[Fraction, tuple[tuple[int, int], ...]] | None:
        """Return a unit, and steps as long as the tau method bears, until little is left."""
        turns = [drive.turn * IN_A_TURN for drive in self.run.drives if drive.turn]
        most = min([power(BEGIN / fast), *turns])
        unit, ends_at = self._unit(most)
        at, x = 0, self.x0
        # in units, powers of two: as long as steps may be, and shorter where one has to end
        lengths, longest = list[int](), 1 << math.floor(most / unit).bit_length() - 1
        inverses: dict[int, Array] = {}
        while len(lengths) < MOST_STEPS:
            left = SPREAD * reach * (np.abs(x - ends) @ weights).max()
            if not ends_at and (left < SHARE * allowed or self._short_of_it(at)):
                return unit, runs(lengths or [1])
            length = longest
            if ends_at:
                length = min(length, 1 << (ends_at[0] - at).bit_length() - 1)
            while True:
                if length not in inverses:
                    inverses[length] = tau(self.A, float(length * unit))
                b, beside = self._driven(at, at + length, unit, weights)
                c = followed(inverses[length], x, b, float(length * unit))
                left_over = np.abs(self.A @ c[:, -1, :, None])[..., 0] @ weights
                off = reach * (float(left_over.max()) * float(length * unit) + beside)
                if off < OFF * allowed or length == 1:
                    break
                length = longest = length // 2
            x = c.sum(axis=1)
            lengths.append(length)
            at += length
            ends_at = ends_at[ends_at[:1] == [at] :]
            if off < OFF * allowed * LONGER and length == longest:
                longest *= 2
        return None

    def _driven(self, begin: int, end: int, unit: Fraction, weights: Array) -> tuple[Array, float]:
        """Return b w of T_0 on for a step between times in units, and what w is off there.

        Returns
        -------
        b : (count, n, terms) array
        off : float
            In the norm with these weights (n,), over the step.
        """
        first, last = begin * unit, end * unit
        found = [drive.on(first, last, TERMS - 1, FINE) for drive in self.run.drives]
        waves = np.zeros((len(found), max(1, *(len(w) for w, _ in found))))
        for own, (w, _) in zip(waves, found, strict=True):
            own[: len(w)] = np.array(w, dtype=float) / 2.0**FINE
        size = np.abs(self.b).max(axis=0).T @ weights
        off = float(size @ [float(own) for _, own in found]) * float(last - first)
        return np.asarray(self.b @ waves), off

    def _unit(self, most: Fraction) -> tuple[Fraction, list[int]]:
        """Return a unit, at most so long, of which every time is a multiple at which a step ends.

        With these, in units.
        """
        claim = self.claim
        times = [t for drive in self.run.drives for t in drive.changes if t]
        if claim.measure in TIMES:
            times.append(claim.level)
        elif claim.envelope is not None:
            times += [t for t in claim.envelope.times if t]
        if not times:
            return most, []
        whole = math.lcm(*(t.denominator for t in times))
        common = Fraction(math.gcd(*(int(t * whole) for t in times)), whole)
        unit = common / 2 ** max(0, math.ceil(math.log2(float(common / most))))
        return unit, sorted({round(t / unit) for t in times})

    def _short_of_it(self, at: int) -> bool:
        """Whether nothing is asked after so many units: of a final value, or of a rise."""
        return self.claim.measure == "final" or (self.claim.measure == "rise" and at > 0)
