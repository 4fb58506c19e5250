"""Step responses that are followed exactly: in what parts of the box, and how, floats choose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product

import numpy as np
from scipy.linalg import expm

from polefence.base.progress import stage
from polefence.law.law import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.step import RELATIVE, Following, StepResponse
from polefence.proof.laws import Evidence, Piece, Point
from polefence.proof.matrices import Rationals, identity
from polefence.proof.response import Centred
from polefence.proof.work import FormatError, counted
from polefence.requirements.specification import claim_of
from polefence.requirements.step import TIMES, StepMeasure
from polefence.response.discrete import balancing

SAMPLES = 30
STEPS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # by what share a level is above the worst sample
NOTHING = 1e-6  # an overshoot of none, as a share
RATE = 0.6  # of the slowest decay, with which errors are proved to fade
TURN = 2.0  # of the fastest mode, in one step
TERMS = 22
DEGREES = (4, 8)  # of the parameters, tried in turn before a part is split
REACH = 1.02
BITS, MORE = 30, 1e6
FEW = 24  # bits of a level
SHARE = 0.3  # of what is allowed after the last step
MOST_STEPS, MOST_PARTS = 4000, 256
SMALLEST = Fraction(1, 64)  # of a parameter's range

Proved = tuple[StepResponse, Verdict]


def kept(plant: UncertainPlant, law: Law, asked: StepMeasure) -> Proved | None:
    """Return the claim that a limit is kept, and its proof; None where there is none."""
    if asked.at_most is None or not _sampled(plant, law, asked) <= asked.at_most:
        return None
    with stage(f"limit on {asked.title}"):
        return _proved(plant, law, asked, asked.at_most)


def least(plant: UncertainPlant, law: Law, asked: StepMeasure) -> Proved | None:
    """Return the claim of the least level that was proved, and its proof; None of none."""
    worst = _sampled(plant, law, asked)
    if not np.isfinite(worst):
        return None
    with stage(f"bound on {asked.title}"):
        for share in STEPS:
            level = max(worst, NOTHING if asked.measure in RELATIVE else 0.0) * (1 + share)
            if asked.measure in ("overshoot", "undershoot"):
                level = max(level, share)
            found = _proved(plant, law, asked, _above(level))
            if found is not None:
                return found
    return None


def _sampled(plant: UncertainPlant, law: Law, asked: StepMeasure) -> float:
    alpha = seeded(plant, len(plant.vertices) + SAMPLES)
    return float(asked.values(plant, law, alpha).max())


def _proved(plant: UncertainPlant, law: Law, asked: StepMeasure, level: float) -> Proved | None:
    on = law.domain_of(plant).on
    evidence = Evidence([identity(plant.shape[0])])
    blank = claim_of(plant, law.exact, on, asked, evidence, Fraction(level))
    if not isinstance(blank, StepResponse):
        return None
    sizes = blank.subject.sizes
    box = set(sizes) == {2}
    parts, waiting = list[tuple[Piece, Following]](), [_corners(len(sizes) if box else 0)]
    while waiting:
        low, high = waiting.pop()
        found = _part(blank, low, high)
        if found is not None:
            parts.append(found)
            continue
        if not box or len(parts) + len(waiting) + 2 > MOST_PARTS or _small(low, high):
            return None
        waiting += _halves(blank, low, high)
    evidence = parts[0][0].evidence
    if len(parts) > 1:
        evidence = Evidence([], cells=tuple(piece for piece, _ in parts), dual=True)
    subject = replace(blank.subject, evidence=evidence)
    claim = replace(blank, subject=subject, following=tuple(own for _, own in parts))
    with suppress(FormatError), counted(claim.allowed):
        verdict = prove(claim)
        return (claim, verdict) if verdict.proved else None
    return None


def _corners(count: int) -> tuple[Point, Point]:
    return (Fraction(0),) * count, (Fraction(1),) * count


def _of_part(blank: StepResponse, low: Point, high: Point) -> StepResponse:
    if all(x == 0 for x in low) and all(x == 1 for x in high):
        return blank
    return blank.part(Piece(low, high, blank.subject.evidence), None)


def _part(blank: StepResponse, low: Point, high: Point) -> tuple[Piece, Following] | None:
    """Return what proves one part; None where nothing was found."""
    inner = _of_part(blank, low, high)
    loop = _Floats.of(inner)
    for degree in DEGREES:
        chosen = loop.followed(degree)
        if chosen is None:
            return None
        evidence, following = chosen
        claim = replace(
            inner, subject=replace(inner.subject, evidence=evidence), following=(following,)
        )
        with suppress(FormatError), counted(claim.allowed):
            if prove(claim).proved:
                return Piece(low, high, evidence), following
    return None


def _small(low: Point, high: Point) -> bool:
    """Whether a part is so small that no smaller one is tried."""
    return max((b - a for a, b in zip(low, high, strict=True)), default=Fraction(0)) < SMALLEST


def _halves(blank: StepResponse, low: Point, high: Point) -> list[tuple[Point, Point]]:
    """Return the halves of a part across the parameter that moves the loop the most."""
    moved = _Floats.of(_of_part(blank, low, high)).moved()
    k = int(np.argmax(moved))
    middle = (low[k] + high[k]) / 2
    return [
        (low, (*high[:k], middle, *high[k + 1 :])),
        ((*low[:k], middle, *low[k + 1 :]), high),
    ]


@dataclass(frozen=True, eq=False)
class _Floats:
    """The loop of one part, in floats, in its middle and at its corners."""

    claim: StepResponse
    A: Array  # (1 + corners, n, n)
    b: Array  # (1 + corners, n)
    C: Array
    F: Array

    @classmethod
    def of(cls, claim: StepResponse) -> _Floats:
        """Return it."""
        run = claim.run
        most = [float(x) for x in run.follower_variables]
        points = [
            np.zeros(len(most)),
            *(np.array(s) * most for s in product((-1, 1), repeat=len(most))),
        ]
        A, b, C = (np.array([_value(P, g) for g in points]) for P in (run.A, run.b, run.C))
        F = np.zeros(len(points))
        if run.F is not None:
            F = np.array([_value(run.F, g)[0, 0] for g in points])
        return cls(claim, A, b[:, :, 0], C[:, 0], F)

    def moved(self) -> list[float]:
        """Return by how much each parameter moves A, beside its size."""
        count = int(math.log2(len(self.A) - 1))
        signs = np.array(list(product((-1, 1), repeat=count)))
        scale = np.abs(self.A[0]).max(axis=0) + 1e-300
        return [
            float(np.linalg.norm((signs[:, k, None, None] * self.A[1:]).mean(axis=0) / scale))
            for k in range(count)
        ]

    def followed(self, degree: int) -> tuple[Evidence, Following] | None:
        """Return a norm and a series of so high a degree; None where errors do not fade."""
        claim, n = self.claim, self.A.shape[1]
        d = balancing(self.A)
        balanced = self.A / d[:, None] * d
        every = np.linalg.eigvals(balanced)
        slow = -every.real.max()
        if slow <= 0:
            return None
        rate = RATE * slow
        Q = _norm(balanced, rate)
        falling = np.swapaxes(balanced, 1, 2) @ Q + Q @ balanced + 2 * rate * Q
        if np.linalg.eigvalsh(falling).max() >= 0:
            return None
        Q = Q / d[:, None] / d
        squares = np.einsum("ki,ij,kj->k", self.C, np.linalg.inv(Q), self.C)
        reach = REACH * float(np.sqrt(squares.max()))
        ends = -np.linalg.solve(self.A, self.b[..., None])[..., 0]
        final = np.einsum("ki,ki->k", self.C, ends) + self.F
        allowed = self._allowed(final)
        if allowed <= 0:
            return None
        h = TURN / np.abs(every).max()
        step = Fraction(h).limit_denominator(10**6)
        if claim.measure in TIMES:
            step = claim.level / max(1, math.ceil(float(claim.level) / h))
        steps = self._steps(np.asarray(ends), Q, reach, allowed, float(step))
        if steps is None:
            return None
        norm = np.sqrt(np.diag(Q)).sum()
        size = reach * norm * TERMS * (degree + 1) * steps * MORE / allowed
        bits = max(BITS, math.ceil(math.log2(size)))
        following = Following(step, steps, TERMS, degree, bits, _short(rate), _short(reach))
        return Evidence([_rationals(Q)], dual=True), following

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
                return float(self.claim.band) * float(size.min())
            case _:
                return float(size.min())

    def _steps(self, ends: Array, Q: Array, reach: float, allowed: float, h: float) -> int | None:
        """Return how many steps there are to be."""
        if self.claim.measure == "final":
            return 1
        if self.claim.measure == "rise":
            return round(float(self.claim.level) / h)
        weights, fewest = np.sqrt(np.diag(Q)), 1
        if self.claim.measure == "settling":
            fewest = round(float(self.claim.level) / h)
        left = ends
        over = expm(h * self.A)
        spread = 2.0  # of sizes of coefficients beside values at corners
        for k in range(1, MOST_STEPS):
            left = (over @ left[..., None])[..., 0]
            if k >= fewest and spread * reach * (np.abs(left) @ weights).max() < SHARE * allowed:
                return k
        return None


def _norm(A: Array, rate: float) -> Array:
    """Return Q of the modes in the middle, weighed so that what moves them at corners is even."""
    poles, V = np.linalg.eig(A[0])
    left = np.linalg.inv(V)
    moved = np.abs(left @ (A[1:] - A[0]) @ V).max(axis=0)
    room = np.sqrt(np.maximum(-poles.real - rate, 1e-3 * np.abs(poles)))
    moved = moved / room[:, None] / room
    pairs = np.abs(poles[:, None] - poles.conj()).argmin(axis=1)
    moved = np.maximum(moved, moved[pairs][:, pairs])  # alike for both of a pair
    moved = moved + 1e-9 * max(float(moved.max()), 1e-300)
    d = balancing(moved[None]) * room
    left = left / d[:, None]
    Q = (left.conj().T @ left).real
    return np.asarray((Q + Q.T) / 2)


def _value(P: Centred, g: Sequence[float] | Array) -> Array:
    total: Array = np.zeros(())
    for e, M in P.terms.items():
        scale = float(np.prod(np.power(g, e))) if len(e) else 1.0
        total = total + scale * np.array([[float(Fraction(x, P.whole)) for x in row] for row in M])
    return np.asarray(total)


def _above(level: float) -> float:
    """Return a number of few bits that is not less, of which steps are parts."""
    share, power = math.frexp(level)
    return math.ldexp(math.ceil(share * 2**FEW), power - FEW)


def _short(value: float) -> Fraction:
    share, power = math.frexp(value)
    return Fraction(math.ldexp(round(share * 2**BITS), power - BITS))


def _rationals(M: Array) -> Rationals:
    return [[_short(float(x)) for x in row] for row in M]
