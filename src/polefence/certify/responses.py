"""Step responses that are followed exactly: in what parts of the box, and how, floats choose."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import groupby, product

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from polefence.base.progress import stage
from polefence.law.law import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.followed import Following
from polefence.proof.claims.step import RELATIVE, Run, StepResponse
from polefence.proof.laws import Evidence, Piece, Point
from polefence.proof.matrices import Rationals, identity
from polefence.proof.response import Centred, norms
from polefence.proof.work import MAX_WORK, Count, FormatError, counted
from polefence.requirements.specification import claim_of
from polefence.requirements.step import TIMES, StepMeasure
from polefence.response.discrete import balancing

SAMPLES = 30
STEPS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # by what share a level is above the worst sample
NOTHING = 1e-6  # an overshoot of none, as a share
NORMS = ((0, 0), (2, 0), (2, 2), (4, 0))  # degrees of Q, and how much higher inequalities are
CHECKED = 5  # of nodes at which errors are looked at
RATE = 0.6  # of the slowest decay, with which errors are proved to fade
BEGIN = 2.0  # of the fastest mode's time, the first step
TERMS = 12
OFF, LONGER = 1e-7, 1e-4  # of what is allowed, a residual; of that, for which steps are longer
SPREAD = 2.0  # of sizes of coefficients beside values at corners
DEGREES = (4, 7)  # of the parameters, tried in turn before a part is split
REACH = 1.3
BITS, MORE = 30, 1e6
FEW = 24  # bits of a level
SHARE = 0.3  # of what is allowed after the last step
MOST_STEPS, MOST_PARTS = 4000, 256
SMALLEST = Fraction(1, 64)  # of a parameter's range
# Work on the parts that are tried for one limit, and for each level of a bound. Where a part fails
# after half of it, none is split any more: a minute for a limit. Of 21 measures of random families
# with up to six states and three parameters every level that is proved takes at most 2e9.
SOUGHT = 10 * MAX_WORK
SOUGHT_EACH = SOUGHT // 5

Proved = tuple[StepResponse, Verdict]


def kept(plant: UncertainPlant, law: Law, asked: StepMeasure) -> Proved | None:
    """Return the claim that a limit is kept, and its proof; None where there is none."""
    if asked.at_most is None or not _sampled(plant, law, asked) <= asked.at_most:
        return None
    with stage(f"limit on {asked.title}"):
        return _proved(plant, law, asked, asked.at_most, SOUGHT)


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
            found = _proved(plant, law, asked, _above(level), SOUGHT_EACH)
            if found is not None:
                return found
    return None


def _sampled(plant: UncertainPlant, law: Law, asked: StepMeasure) -> float:
    alpha = seeded(plant, len(plant.vertices) + SAMPLES)
    return float(asked.values(plant, law, alpha).max())


def _proved(
    plant: UncertainPlant, law: Law, asked: StepMeasure, level: float, work: int
) -> Proved | None:
    """Return the claim of a level, and its proof, with so much work on its parts."""
    on = law.domain_of(plant).on
    evidence = Evidence([identity(plant.shape[0])])
    blank = claim_of(plant, law.exact, on, asked, evidence, Fraction(level))
    if not isinstance(blank, StepResponse):
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


def _in_parts(blank: StepResponse, work: Count) -> list[tuple[Piece, Following]]:
    """Return what proves every part of the box; nothing where that was not found."""
    sizes = blank.subject.sizes
    box = set(sizes) == {2}
    parts, waiting = list[tuple[Piece, Following]](), [_corners(len(sizes) if box else 0)]
    while waiting:
        low, high = waiting.pop()
        found = _part(blank, low, high)
        if found is not None:
            parts.append(found)
            continue
        many = len(parts) + len(waiting) + 2 > MOST_PARTS
        if not box or many or _small(low, high) or 2 * work.spent > work.most:
            return []
        waiting += _halves(blank, low, high)
    return parts


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
                if not claim.run.fault():
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
    run: Run
    domain: Domain
    A: Array  # (1 + corners, n, n)
    b: Array  # (1 + corners, n)
    C: Array
    F: Array

    @classmethod
    def of(cls, claim: StepResponse) -> _Floats:
        """Return it."""
        run, domain = claim.run, Domain(claim.subject.sizes)
        middle = np.concatenate([np.full(size, 1 / size) for size in domain.sizes])
        at = np.concatenate([middle[None], domain.coordinates(np.eye(domain.corners))])
        A, b, C = (_values(P, domain, at) for P in (run.A, run.b, run.C))
        F = np.zeros(len(at)) if run.F is None else _values(run.F, domain, at)[:, 0, 0]
        return cls(claim, run, domain, A, b[:, :, 0], C[:, 0], F)

    def moved(self) -> list[float]:
        """Return by how much each parameter moves A, beside its size."""
        count = len(self.domain.sizes)
        signs = np.array(list(product((-1, 1), repeat=count)))
        scale = np.abs(self.A[0]).max(axis=0) + 1e-300
        return [
            float(np.linalg.norm((signs[:, k, None, None] * self.A[1:]).mean(axis=0) / scale))
            for k in range(count)
        ]

    def fading(self) -> Iterator[tuple[Evidence, float, float]]:
        """Yield norms in which errors fade everywhere, with beta and kappa."""
        domain = self.domain
        at = domain.nodes(CHECKED)
        A, C = (_values(P, domain, domain.coordinates(at)) for P in (self.run.A, self.run.C))
        d = balancing(np.concatenate([self.A, A]))
        middle, A, C = self.A[:1] / d[:, None] * d, A / d[:, None] * d, C[:, 0] * d
        rate = -RATE * np.linalg.eigvals(np.concatenate([middle, A])).real.max()
        if rate <= 0:
            return
        weight = _weight(middle[0], A, rate)
        for degree, elevation in NORMS:
            nodes = domain.nodes(degree)
            own = _values(self.run.A, domain, domain.coordinates(nodes)) / d[:, None] * d
            eye = rate * np.eye(len(d))
            Q = np.array([solve_continuous_lyapunov((M + eye).T, -weight) for M in own])
            coefficients = domain.interpolated((Q + np.swapaxes(Q, 1, 2)) / 2, degree)
            Q = np.tensordot(domain.basis(at, degree), coefficients, 1)
            falling = np.swapaxes(A, 1, 2) @ Q + Q @ A + 2 * rate * Q
            if np.linalg.eigvalsh(falling).max() >= 0 or np.linalg.eigvalsh(Q).min() <= 0:
                continue
            squares = np.einsum("ki,kij,kj->k", C, np.linalg.inv(Q), C)
            X = [_rationals(M / d[:, None] / d) for M in coefficients]
            evidence = Evidence(X, degree, elevation, dual=True)
            yield evidence, rate, REACH * float(np.sqrt(squares.max()))

    def followed(
        self, evidence: Evidence, rate: float, reach: float, degree: int
    ) -> Following | None:
        """Return a series of so high a degree; None where too little is allowed, or none ends."""
        ends = -np.linalg.solve(self.A, self.b[..., None])[..., 0]
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
        return Following(unit, lengths, TERMS, degree, bits, _short(rate), _short(reach))

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
        self, fast: float, ends: Array, weights: Array, reach: float, allowed: float
    ) -> tuple[Fraction, tuple[tuple[int, int], ...]] | None:
        """Return a unit, and steps as long as the tau method bears, until little is left."""
        claim = self.claim
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
                return unit, _runs(lengths or [1])
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


def _weight(middle: Array, A: Array, rate: float) -> Array:
    """Return what Q is to fall by: modes in the middle, weighed so that what moves them is even."""
    poles, V = np.linalg.eig(middle)
    left = np.linalg.inv(V)
    moved = np.abs(left @ (A - middle) @ V).max(axis=0)
    room = np.maximum(-poles.real - rate, 1e-3 * np.abs(poles))
    moved = moved / np.sqrt(room)[:, None] / np.sqrt(room)
    pairs = np.abs(poles[:, None] - poles.conj()).argmin(axis=1)
    moved = np.maximum(moved, moved[pairs][:, pairs])  # alike for both of a pair
    moved = moved + 1e-9 * max(float(moved.max()), 1e-300)
    left = left / balancing(moved[None])[:, None]
    return np.asarray((left.conj().T @ left).real)


def _values(P: Centred, domain: Domain, coordinates: Array) -> Array:
    """Return the values of a polynomial in g at coordinates (count, sum of corners)."""
    g, first = list[Array](), 0
    for size in domain.sizes:
        g += [coordinates[:, first + j] - 1 / size for j in range(1, size)]
        first += size
    total: Array = np.zeros(())
    for e, M in P.terms.items():
        scale = np.prod([x**power for x, power in zip(g, e, strict=True)], axis=0)
        exact = np.array([[float(Fraction(x, P.whole)) for x in row] for row in M])
        total = total + np.broadcast_to(scale, len(coordinates))[:, None, None] * exact
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
