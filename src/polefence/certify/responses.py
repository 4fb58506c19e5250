"""Step responses that are followed exactly: in what parts of the box, and how, floats choose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import groupby, product

import numpy as np

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
BEGIN = 2.0  # of the fastest mode's time, the first step
TERMS = 12
OFF, LONGER = 1e-7, 1e-4  # of what is allowed, a residual; of that, for which steps are longer
SPREAD = 2.0  # of sizes of coefficients beside values at corners
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
        fast = float(np.abs(every).max())
        planned = self._planned(fast, np.asarray(ends), Q, reach, allowed)
        if planned is None:
            return None
        unit, lengths = planned
        norm, steps = np.sqrt(np.diag(Q)).sum(), sum(count for _, count in lengths)
        size = reach * norm * TERMS * (degree + 1) * steps * MORE / allowed
        bits = max(BITS, math.ceil(math.log2(size)))
        own = unit, lengths, TERMS, degree, bits, _short(rate), _short(reach)
        return Evidence([_rationals(Q)], dual=True), Following(*own)

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

    def _planned(
        self, fast: float, ends: Array, Q: Array, reach: float, allowed: float
    ) -> tuple[Fraction, tuple[tuple[int, int], ...]] | None:
        """Return a unit, and steps as long as the tau method bears, until little is left."""
        claim, weights = self.claim, np.sqrt(np.diag(Q))
        level = claim.level if claim.measure in TIMES else Fraction(0)
        unit = _power(BEGIN / fast)
        if level:
            unit = level / 2 ** max(0, math.ceil(math.log2(float(level / unit))))
        goal, at = (0 if not level else round(level / unit)), 0
        x = np.zeros_like(self.b)
        lengths, length = list[int](), 1
        inverses: dict[int, Array] = {}
        while len(lengths) < MOST_STEPS:
            left = SPREAD * reach * (np.abs(x - ends) @ weights).max()
            if at >= goal and (left < SHARE * allowed or self._short_of_it(at)):
                return unit, _runs(lengths)
            if at < goal:
                length = min(length, 1 << (goal - at).bit_length() - 1)
            while True:
                if length not in inverses:
                    inverses[length] = _tau(self.A, float(length * unit))
                c = _followed(inverses[length], x, self.b, float(length * unit))
                left_over = np.abs(self.A @ c[:, -1, :, None])[..., 0] @ weights
                off = reach * float(left_over.max()) * float(length * unit)
                if off < OFF * allowed or length == 1:
                    break
                length //= 2
            x = c.sum(axis=1)
            lengths.append(length)
            at += length
            if off < OFF * allowed * LONGER:
                length *= 2
        return None

    def _short_of_it(self, at: int) -> bool:
        """Whether nothing is asked after so many units: of a final value, or of a rise."""
        return self.claim.measure == "final" or (self.claim.measure == "rise" and at > 0)


def _tau(A: Array, h: float) -> Array:
    """Return the inverse of c -> coefficients of X' - h / 2 A X, and X(-1), of each A."""
    count, n, _ = A.shape
    m = TERMS
    whole = np.zeros((count, m + 1, n, m + 1, n))
    eye = np.eye(n)
    for j in range(m):
        for p in range(j + 1, m + 1, 2):
            whole[:, j, :, p] = (p if j == 0 else 2 * p) * eye
        whole[:, j, :, j] = -h / 2 * A
    for p in range(m + 1):
        whole[:, m, :, p] = (-1) ** p * eye
    return np.asarray(np.linalg.inv(whole.reshape(count, n * (m + 1), n * (m + 1))))


def _followed(inverse: Array, x: Array, b: Array, h: float) -> Array:
    """Return c (count, m + 1, n) from x (count, n)."""
    count, n = x.shape
    right = np.zeros((count, TERMS + 1, n))
    right[:, 0], right[:, -1] = h / 2 * b, x
    found = inverse @ right.reshape(count, -1, 1)
    return np.asarray(found.reshape(count, TERMS + 1, n))


def _runs(lengths: Sequence[int]) -> tuple[tuple[int, int], ...]:
    return tuple((length, len(list(same))) for length, same in groupby(lengths))


def _power(value: float) -> Fraction:
    return Fraction(2) ** math.floor(math.log2(value))


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
