"""The loop that a computer closes: its poles over a sample of the family, its decay proved.

A decay is searched in floats, of the loop as a family in discrete time, and proved exactly: see
`polefence.proof.claims.sampled` for its states and inputs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.base.explained import explained
from polefence.base.progress import stage
from polefence.certify.candidates import edge
from polefence.certify.certificate import Check, in_floats
from polefence.certify.design import Design
from polefence.certify.evidence import certificate_of, evidence_of, forms
from polefence.certify.margins.bordered import largest_bordered
from polefence.certify.margins.claims import above
from polefence.certify.margins.loops import are_positive, balanced, region_block
from polefence.export.memory import kept, late_inputs
from polefence.export.program import exactly
from polefence.law.laws import (
    Law,
    check_alpha,
    given_law,
)
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.loops import loop_of
from polefence.lmi.solve.lyapunov import least
from polefence.lmi.solve.starts import start_matrix
from polefence.plant.exact import ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.points import edges, inside, values_at
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import Rounded, rounding_error
from polefence.proof.claims.sampled import MAX_TERMS, Off, Sampled, loop_claim
from polefence.proof.claims.steps import gain_error, held_size, step_error
from polefence.proof.laws import Evidence
from polefence.proof.short import Short
from polefence.proof.work import FormatError
from polefence.region.regions import Disk
from polefence.region.text import digits_down
from polefence.response.discrete import zero_order_hold

POINTS = 10_000  # random ones
SCANNED = 300  # of the scan over sample times
SHORTEST, LONGEST, PER_DECADE = 1e-5, 1e2, 16  # sample times tried, over the fastest pole's time
TIME_HALVINGS = 10
SHORTER = 0.99
TINY = 1e-300
SOONEST = 1e-9  # of the loop's fastest time: no sample time is shorter

Test = Callable[[float, Array], bool]

CENTRAL = 0.5  # of the sampled decay: evidence that proves no more is further from singular
# Degree and elevation of the Lyapunov polynomials tried, by the law's degree; the first one for the
# coordinates. A cross term of state and delayed input goes with K(alpha): of the law's degree.
LADDER = {0: ((1, 0), (0, 0), (1, 0), (2, 0)), 1: ((1, 0), (1, 0), (2, 0), (2, 1))}
ENOUGH = 0.9  # of the sampled decay: no more is looked for beyond
# Shares of the sampled decay at which the search stops, well within the inequalities: the evidence
# at its end is nearly singular, and what it tolerates a matter of rounding.
AIMS = (0.98, 0.95, 0.9, 0.8, 0.6, 0.4)
HALVINGS = 8
RETREATS = (1.0, 0.98, 0.9, 0.7, 0.4)
ROOM = 1.1  # of what evidence must tolerate in floats over what is needed
LEAST = 2.0**-20  # weight of the rows of v where the gain is not off
RADIUS_BITS = 14  # of 1 - radius
EVIDENCE_BITS = 26  # short numbers make short proofs
TAIL = 1e-3  # terms left out of the series, over the error
DIGITS = 4  # of the decay rate
BOUND = 1e-3  # by which bounds on the law are wider than floats say

STEP_POINTS = 200  # at which the error of the steps is looked at
BITS = 12  # of the coordinates: short numbers make short proofs
FINE = 10  # bits by which the steps are finer than their error

# Bernstein coefficients of X, N and B, see `polefence.certify.margins.loops`; coordinates.
Proof = tuple[tuple[Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class SampledPoles(Short):
    """Poles of a sampled loop.

    Attributes
    ----------
    equivalent : (..., n) array
        s = log(z) / sample_time of the n largest |z| [1/s]: where poles in continuous time have the
        same motion at the samples.
    z : (..., n) array, or (..., n + m) with a delay
        All of them, the largest first. The delay's own are near zero while samples are short, one
        for each of the inputs that are late.
    """

    equivalent: Array
    z: Array


def sampled_poles(design: Design, alpha: Array, sample_time: float, delay: int = 1) -> SampledPoles:
    """Return the poles of the loop as a computer closes it every ``sample_time``.

    The input is held between samples (zero-order hold); with ``delay`` = 1 it is u[k] = K x[k-1],
    as where the law is computed during the step. States that the law keeps itself are stepped by
    their rates at once.

    Parameters
    ----------
    design : Design
        Of a plant in continuous time.
    alpha : (..., N) array
    sample_time : float
        [s]
    delay : int
        0 or 1 samples.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, the sample time not positive, or so long that the
        plant outgrows floating point in one.
    """
    time = require_usable(design, sample_time, delay)
    alpha = check_alpha(alpha, len(design.plant.vertices))
    z = _eigenvalues(stepped(design, alpha, time, delay))
    return SampledPoles(_equivalent(z, design.plant.shape[0], time), z)


def require_usable(design: Design, sample_time: Any, delay: int) -> float:
    """Return the sample time as a float.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the numbers cannot be used.
    """
    require_continuous(design, delay)
    try:
        value = float(sample_time)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(f"sample_time = {sample_time!r} must be a positive number of seconds")
    fastest = float(np.abs(design.poles(np.eye(len(design.plant.vertices)))).max())
    if value * fastest < SOONEST:
        raise InputError(
            f"sample_time = {value:g} s is too short for floating point: the "
            f"loop's fastest pole is at {fastest:.3g} 1/s"
        )
    return value


def require_continuous(design: Design, delay: int) -> None:
    """Refuse discrete-time plants, whose law is sampled by design, and unknown delays."""
    time = design.plant.sample_time
    if time is not None:
        raise InputError(
            f"{design.plant.name} is a discrete-time plant: its law runs every {float(time):g} s, "
            "without delay, and the region is proved for just that"
        )
    if delay not in (0, 1) or isinstance(delay, bool):
        raise InputError(f"delay = {delay!r} must be 0 or 1, in samples")


def stepped(design: Design, alpha: Array, sample_time: float, delay: int) -> Array:
    """Return the matrices from one sample to the next, (..., n, n), or with a delay n + m.

    Without delay x+ = (F + G K) x. With a delay of one sample the state is (x, u):
    x+ = F x + G u, u+ = K x. The rates of the law's own states act without it.
    """
    n, late, K = design.plant.shape[0], late_inputs(design, delay), design.law.gain(alpha)
    F, G = zero_order_hold(*design.plant.at(alpha), sample_time)
    if late < G.shape[-1]:
        F = np.asarray(F + G[..., late:] @ K[..., late:, :])
    if not late:
        return F
    whole = np.zeros((*F.shape[:-2], n + late, n + late))
    whole[..., :n, :n], whole[..., :n, n:], whole[..., n:, :n] = F, G[..., :late], K[..., :late, :]
    return whole


def _domain(plant: UncertainPlant, design: Design) -> Domain:
    """Return where alpha lives: on the box of the parameters where there are any."""
    if plant.parameters:
        return Domain.of("box", len(plant.vertices))
    return Domain(design.certificate.claim().sizes)


def cloud(design: Design, count: int) -> Array:
    """Return vertices, points of the edges and ``count`` random points alpha, (points, N)."""
    domain = _domain(design.plant, design)
    return domain.alpha(np.vstack([edges(domain), inside(domain, count)]))


def _eigenvalues(matrices: Array) -> Array:
    """Return eigenvalues, the largest first."""
    if not np.all(np.isfinite(matrices)):
        raise InputError("the plant outgrows floating point in one sample; take a shorter one")
    z = np.linalg.eigvals(matrices).astype(complex)
    return np.asarray(np.take_along_axis(z, np.argsort(-np.abs(z), axis=-1), axis=-1))


def _equivalent(z: Array, n: int, time: float) -> Array:
    slow = z[..., :n]
    return np.asarray(np.log(np.where(np.abs(slow) < TINY, TINY, slow)) / time)


@dataclass(frozen=True, eq=False)
class SamplingEffect(Short):
    """Poles of the sampled loop against a design's region, over a sample of the family.

    Attributes
    ----------
    sample_time : float
        [s]
    delay : int
        In samples.
    inside : bool
        Whether all equivalent poles lie in the region, at every point looked at.
    stable : bool
        Whether all |z| < 1, likewise.
    distance : float
        The largest distance of an equivalent pole from the region, negative inside [1/s].
    alpha : (N,) array
        Where that is.
    values : dict or None
        The parameters there; None for a plant without any.
    decay : float
        -log|z| / sample_time of the slowest pole of all [1/s].
    points : int
        How many alpha were looked at.
    """

    sample_time: float
    delay: int
    inside: bool
    stable: bool
    distance: float
    alpha: Array
    values: dict[str, float] | None
    decay: float
    points: int


@explained
@stage("poles of the sampled loop")
def sampling_effect(design: Design, sample_time: float, delay: int = 1) -> SamplingEffect:
    """Look where the poles of the sampled loop lie: at vertices, on edges and at random points.

    See `sampled_poles` for the loop, its parameters and errors. A sample proves nothing; for the
    decay rate see `polefence.export.sampled.prove_decay`.
    """
    time = require_usable(design, sample_time, delay)
    alphas = cloud(design, POINTS)
    poles = sampled_poles(design, alphas, time, delay)
    distance = design.region.distance(poles.equivalent).max(axis=-1)
    worst = int(np.argmax(distance))
    size = float(np.abs(poles.z).max())
    alpha = alphas[worst].copy()
    alpha.flags.writeable = False
    return SamplingEffect(
        time,
        delay,
        bool(distance[worst] < 0),
        size < 1,
        float(distance[worst]),
        alpha,
        values_at(design.plant, alpha.tolist()),
        -float(np.log(max(size, TINY))) / time,
        len(alphas),
    )


@dataclass(frozen=True)
class LargestSampleTime(Short):
    """Longest sample times, found by trial over a sample of the family.

    Attributes
    ----------
    delay : int
    region : float
        At every sample time tried up to this one the equivalent poles lie in the region; zero where
        they do not even at the shortest [s].
    stable : float
        Likewise, all |z| < 1 [s].
    longest : float
        The longest sample time tried: what equals it may be longer still [s].
    """

    delay: int
    region: float
    stable: float
    longest: float


@explained
@stage("largest sample time")
def largest_sample_time(design: Design, delay: int = 1) -> LargestSampleTime:
    """Return up to which sample time the region, and stability, hold.

    Sample times are tried upwards on a logarithmic grid, at vertices, edges and a few hundred
    random points, until one fails, then by bisection; what is found is tried at as many points as
    `sampling_effect` looks at, and shortened until it holds there. What fails between two sample
    times tried is not seen.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the delay neither 0 nor 1.
    """
    require_continuous(design, delay)
    few, many = cloud(design, SCANNED), cloud(design, POINTS)
    fastest = float(np.abs(design.poles(few)).max())
    unit = 1 / fastest if fastest else 1.0
    decades = np.log10(LONGEST / SHORTEST)
    grid = unit * np.geomspace(SHORTEST, LONGEST, round(PER_DECADE * decades) + 1)
    region, stable = (
        _largest(partial(test, design, delay), grid, few, many) for test in (_is_inside, _is_stable)
    )
    return LargestSampleTime(delay, region, stable, float(grid[-1]))


def _largest(holds: Test, grid: Array, few: Array, many: Array) -> float:
    fails = next((k for k, time in enumerate(grid) if not holds(time, few)), len(grid))
    if fails == 0:
        return 0.0
    low = float(grid[fails - 1])
    if fails < len(grid):
        high = float(grid[fails])
        low, _ = edge(lambda time: holds(time, few), low, high, TIME_HALVINGS, geometric=True)
    while low >= grid[0] and not holds(low, many):  # more points may fail earlier
        low *= SHORTER
    return low if low >= grid[0] else 0.0


def _is_inside(design: Design, delay: int, time: float, alphas: Array) -> bool:
    z = _finite(stepped(design, alphas, time, delay))
    if z is None:
        return False
    return bool(design.region.contains(_equivalent(z, design.plant.shape[0], time)))


def _is_stable(design: Design, delay: int, time: float, alphas: Array) -> bool:
    z = _finite(stepped(design, alphas, time, delay))
    return z is not None and bool(np.abs(z).max() < 1)


def _finite(matrices: Array) -> Array | None:
    return _eigenvalues(matrices) if np.all(np.isfinite(matrices)) else None


@dataclass(frozen=True, eq=False)
class SampledProof(Short):
    """Proof of the decay of a loop closed by samples.

    Attributes
    ----------
    sample_time : float
        [s]
    delay : int
        In samples.
    decay : float
        For every parameter value all poles of the sampled loop have |z| < exp(-decay sample_time):
        every motion dies out at least as fast as exp(-decay t) [1/s]; zero where nothing is proved.
    sampled : float
        The slowest decay found at many parameter values, an upper bound on what can be proved
        [1/s]; not positive where the loop is not stable.
    claim : Sampled, optional
        What was proved; None where nothing is.
    reason : str
        Why not; empty where it is proved.
    seconds : float
        Taken to find and prove it [s].
    """

    sample_time: float
    delay: int
    decay: float
    sampled: float
    claim: Sampled | None
    reason: str
    seconds: float

    @property
    def proved(self) -> bool:
        """Whether a positive decay rate is proved."""
        return self.claim is not None

    def check(self) -> Check:
        """Prove the claim afresh, in exact arithmetic."""
        if self.claim is None:
            return Check("undecided", self.reason)
        verdict = prove(self.claim)
        return Check("proved" if verdict.proved else "undecided", verdict.reason)


@explained
@stage("decay of the sampled loop")
def prove_decay(
    design: Design, sample_time: float, delay: int = 1, off: Off | None = None
) -> SampledProof:
    """Prove how fast the loop decays that a computer closes every ``sample_time``.

    The input is held between samples; with ``delay`` = 1 it is u[k] = K x[k-1]. The proof is exact,
    for every parameter value, or every alpha of a plant without parameters; the rate is the largest
    that was found, not the largest there is.

    Parameters
    ----------
    design : Design
        Of a plant in continuous time.
    sample_time : float
        [s]
    delay : int
        0 or 1 samples.
    off : Off, optional
        An error of the gain to be tolerated besides, such as that of rounding: `off_by_rounding`.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the sample time not positive.
    """
    start = time.perf_counter()
    seconds = require_usable(design, sample_time, delay)
    slowest = sampling_effect(design, seconds, delay).decay
    claim, reason = None, "the sampled loop is not stable for all parameter values"
    if slowest > 0:
        search = _Search(design, seconds, delay, slowest, off)
        claim, reason = search.run()
    decay = float(claim.decay) if claim else 0.0
    taken = time.perf_counter() - start
    return SampledProof(seconds, delay, decay, slowest, claim, reason, taken)


def off_by_rounding(claim: Rounded) -> Off:
    """Return the error of the gain by the code's rounding, for `prove_decay`."""
    error = above(float(rounding_error(claim)))
    return Off(error, claim.gain.rows, claim.gain.right)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A decay rate that evidence proves in floats, with the claim's other numbers."""

    share: float
    evidence: dict[str, Any]
    proof: Proof | None
    blank: Sampled
    needed: float


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for a proof of the decay rate of a loop whose slowest sampled pole is known."""

    design: Design
    sample_time: float
    delay: int
    slowest: float
    off: Off | None

    def run(self) -> tuple[Sampled | None, str]:
        """Return a claim that is proved; or None, and why not."""
        try:
            family = self._family()
            best = max(self._candidates(family), key=lambda one: one.share, default=None)
        except (SolverError, np.linalg.LinAlgError, FormatError, InputError) as problem:
            return None, f"no proof was found: {problem}"
        if best is None or best.share <= 0:
            return None, "no Lyapunov polynomial was found that leaves room for the error between"
        reason = "the room found in floats is not there"
        for retreat in RETREATS:
            claim = self._claim(family, best, best.share * retreat)
            if claim is None:
                continue
            try:
                verdict = prove(claim)
            except FormatError as problem:
                return None, f"not proved: {problem}"
            if verdict.proved:
                return claim, ""
            reason = verdict.reason
        return None, f"not proved: {reason}"

    def _family(self) -> Family:
        """Return the loop in coordinates of its own Lyapunov polynomial."""
        first = self._in(first_coordinates(self.design))
        enough = math.exp(-CENTRAL * self.slowest * self.sample_time)
        form = self._forms()[0]
        polynomial = least(loop_of(first.plant, first.law), Disks(0.0), *form, enough=enough)
        return self._in(next_coordinates(first, evidence_of(polynomial, form)))

    def _forms(self) -> tuple[tuple[int, int], ...]:
        law = self.design.law
        return LADDER.get(law.degree, ((law.degree, 0), (law.degree, 0)))

    def _in(self, coordinates: Coordinates) -> Family:
        return family_of(self.design, self.sample_time, self.delay, coordinates)

    def _candidates(self, family: Family) -> Iterator[_Candidate]:
        """Yield the best of one degree after another, until one is good enough."""
        blank = self._blank(family)
        sizes = loop_claim(blank).subject.design.sizes
        needed = float(step_error(blank, sizes))
        blank = self._weighted(blank, needed)
        if not self.delay:
            blank = _with_bounds(blank, family)
        needed *= float(held_size(blank))
        needed = math.hypot(needed, float(gain_error(blank)))
        allowed = set(forms(family.plant, family.law))
        for form in self._forms()[1:]:
            if form not in allowed:
                return
            for evidence in self._evidence(family, form):
                proof = family.proof(evidence)
                share = self._share(family, blank, proof, needed)
                yield _Candidate(share, evidence, proof, blank, needed)
                if share >= ENOUGH:
                    return

    def _evidence(self, family: Family, form: tuple[int, int]) -> Iterator[dict[str, Any]]:
        """Yield Lyapunov polynomials of one degree, each for less decay than the one before."""
        loop = loop_of(family.plant, family.law)
        for aim in AIMS:
            radius = math.exp(-aim * self.slowest * self.sample_time)
            with suppress(SolverError):
                polynomial = least(loop, Disks(0.0), *form, enough=radius)
                yield _short_evidence(evidence_of(polynomial, form))

    def _blank(self, family: Family) -> Sampled:
        """Return a claim of no error, for what of it the bounds need."""
        coordinates, claim = family.coordinates, self.design.certificate.claim()
        return Sampled(
            design=claim,
            ranges=ranges_of(self.design.plant),
            sample_time=Fraction(self.sample_time),
            delay=self.delay,
            decay=Fraction(0),
            radius=Fraction(0),
            T=exactly(coordinates.T),
            scale=tuple(Fraction(float(s)) for s in coordinates.scale),
            steps=tuple(exactly(step) for step in family.steps),
            terms=_terms(family),
            evidence=Evidence([]),
            error=Fraction(0),
            mu=Fraction(0),
            weight=Fraction(LEAST),
            off=self.off,
            prompt=kept(self.design) * self.delay,
        )

    def _weighted(self, blank: Sampled, needed: float) -> Sampled:
        """Give the rows of v the weight that makes both errors alike."""
        error = float(gain_error(blank)) * LEAST
        return replace(blank, weight=above(error / needed)) if error > LEAST * needed else blank

    def _share(self, family: Family, blank: Sampled, proof: Proof | None, needed: float) -> float:
        """Return the largest share of the sampled decay that leaves room for the error."""

        def leaves_room(share: float) -> bool:
            radius = math.exp(-self.slowest * share * self.sample_time)
            return family.tolerated(proof, radius, _rows(blank))[0] >= ROOM * needed

        return edge(leaves_room, 0.0, 1.0, HALVINGS)[0]

    def _claim(self, family: Family, candidate: _Candidate, share: float) -> Sampled | None:
        decay = Fraction(digits_down(share * self.slowest, DIGITS))
        radius = _radius(decay, Fraction(self.sample_time))
        largest, mu = family.tolerated(candidate.proof, float(radius), _rows(candidate.blank))
        if largest <= candidate.needed:
            return None
        error = math.sqrt(largest * candidate.needed)
        return replace(
            candidate.blank,
            decay=decay,
            radius=radius,
            evidence=_exact_evidence(candidate.evidence),
            error=above(error),
            mu=above(mu * error / largest),
        )


def _rows(blank: Sampled) -> Array:
    rows = blank.off.rows if blank.off else blank.scale
    pairs = zip(rows, blank.scale, strict=True)
    return np.array([float(blank.weight * row / s) for row, s in pairs])


def _terms(family: Family) -> int:
    """Return how many terms of the exponential make it far more exact than needed."""
    size, term = family.rate * family.sample_time, 1.0
    for p in range(1, MAX_TERMS + 1):
        term *= size / p
        rest = term * size / (p + 1)
        if 2 * size < p + 2 and 2 * rest <= TAIL * family.error:
            return p
    raise FormatError("the samples are too long for the plant's rates")


def _with_bounds(blank: Sampled, family: Family) -> Sampled:
    """Add bounds on the law in the claim's coordinates."""
    law, coordinates = family.design.law, family.coordinates
    if law.W is None:
        return blank
    Z = law.form[:, len(coordinates.T) :]
    W, Z = coordinates.T @ law.W @ coordinates.T.T, Z @ coordinates.T.T / coordinates.scale[:, None]
    smallest = float(np.linalg.eigvalsh((W + W.swapaxes(1, 2)) / 2).min())
    if smallest <= 0:
        raise FormatError("W of the law is not proved to be positive definite by its coefficients")
    energy = float(np.linalg.eigvalsh(Z @ np.linalg.solve(W, Z.swapaxes(1, 2))).max())
    low, high = smallest * (1 - BOUND), max(energy, LEAST) * (1 + BOUND)
    return replace(blank, smallest=above(low), energy=above(high))


def _radius(decay: Fraction, sample_time: Fraction) -> Fraction:
    """Return a short number a little below exp(-decay sample_time)."""
    rest = -math.expm1(-float(decay * sample_time))
    _, exponent = math.frexp(rest)
    unit = Fraction(2) ** (exponent - RADIUS_BITS)
    return 1 - math.ceil(Fraction(rest) / unit * (1 + Fraction(1, 2**40))) * unit


def _short_evidence(evidence: dict[str, Any]) -> dict[str, Any]:
    """Round a Lyapunov polynomial to a multiple of a power of two, symmetric."""
    X = in_floats(evidence["X"])
    multiple = np.asarray(evidence.get("multiple", np.zeros(0)))
    _, exponent = np.frexp(max(np.abs(X).max(), np.abs(multiple).max(initial=0.0)))
    unit = 2.0 ** (int(exponent) - EVIDENCE_BITS)
    short = evidence | {"X": np.round((X + X.swapaxes(1, 2)) / 2 / unit) * unit}
    return short | ({"multiple": np.round(multiple / unit) * unit} if multiple.size else {})


def _exact_evidence(evidence: dict[str, Any]) -> Evidence:
    multiple = tuple(Fraction(float(v)) for v in evidence.get("multiple", ()))
    X = [exactly(x) for x in evidence["X"]]
    return Evidence(X, evidence["degree"], evidence["elevation"], multiple)


@dataclass(frozen=True, eq=False)
class Coordinates(Short):
    """y = T x, u = diag(scale) v; short numbers."""

    T: Array
    scale: Array


@dataclass(frozen=True, eq=False)
class Family(Short):
    """The loop, with short numbers for the vertices' steps [F, G], (N, n, n + m).

    ``error`` is how far their combinations are from the plant's step, as a sample shows it.
    """

    design: Design
    sample_time: float
    delay: int
    coordinates: Coordinates
    steps: Array
    error: float
    plant: UncertainPlant
    law: Law

    @property
    def late(self) -> int:
        """How many inputs, the first ones, act a step late."""
        return late_inputs(self.design, self.delay)

    @property
    def rate(self) -> float:
        """The largest Frobenius norm of [A, B] in these coordinates [1/s]."""
        return float(np.linalg.norm(_rates(self.design, self.coordinates), axis=(1, 2)).max())

    def proof(self, evidence: dict[str, Any]) -> Proof | None:
        """Return the rounded evidence and T; None where it is no Lyapunov matrix."""
        certificate = certificate_of(self.plant, self.law, Disk(0.0, 1.0), [evidence])
        with suppress(InputError):
            (scaled,) = balanced(Design(certificate), certificate.region)
            return scaled.raised(evidence["elevation"]), scaled.T
        return None

    def tolerated(self, proof: Proof | None, radius: float, weight: Array) -> tuple[float, float]:
        """Return the largest error of the steps that is proved in floats, and its mu.

        Zero where not even the poles are proved to lie in the disk. ``weight`` (m,) has the rows
        of v.
        """
        if proof is None:
            return 0.0, 1.0
        (X, N, B), T = proof
        ((L, M),) = Disk(0.0, radius).pairs()
        F, rows = region_block((L, M), X, N), np.append(weight, np.ones(self.steps.shape[1]))
        with np.errstate(invalid="ignore", divide="ignore"), suppress(np.linalg.LinAlgError):
            if are_positive(F):
                error, mu = largest_bordered(F, M, B * rows, X @ T.T)
                if error > 0:
                    return error, mu
        return 0.0, 1.0


def first_coordinates(design: Design) -> Coordinates:
    """Return coordinates of the loop at the middle of the family."""
    middle = np.full((1, len(design.plant.vertices)), 1 / len(design.plant.vertices))
    A, B = (matrices[0] for matrices in design.plant.at(middle))
    K = design.law.gain(middle)[0]
    closed = A + B @ K
    size = float(np.abs(np.linalg.eigvals(closed)).max()) or 1.0
    T = _whitening(start_matrix(closed / size))
    T = _evened(design.law, T)
    return _rounded(T, _size_of_gain(K, T))


def next_coordinates(family: Family, evidence: Mapping[str, Any]) -> Coordinates:
    """Return coordinates in which the Lyapunov matrix at the middle is near to the identity."""
    n, coordinates = family.steps.shape[1], family.coordinates
    X, law = _middle(family, evidence), family.design.law
    before = _whitening(X[:n, :n]) @ coordinates.T
    T, late = _evened(law, before), family.late
    scale = coordinates.scale[:late] * np.sqrt(np.diag(X)[n:]) * before[0, 0] / T[0, 0]
    if late < len(coordinates.scale):
        more = _size_of_gain(law.gain(np.eye(len(family.steps))), T)[late:]
        scale = np.concatenate([scale, more])
    return _rounded(T, scale)


def _evened(law: Law, T: Array) -> Array:
    """Return a multiple of T for which T W T' has the identity's size."""
    if law.W is None:
        return T
    W = T @ law.W @ T.T
    return np.asarray(T * np.sqrt(len(T) / np.trace(W.mean(axis=0))))


def _size_of_gain(K: Array, T: Array) -> Array:
    """Return what makes the rows of the gains K T^-1 one at most."""
    size = np.linalg.norm(K @ np.linalg.inv(T), axis=-1).reshape(-1, K.shape[-2]).max(axis=0)
    return np.where(size > 0, size, 1.0)


def family_of(design: Design, sample_time: float, delay: int, coordinates: Coordinates) -> Family:
    """Return the loop in these coordinates."""
    n, _ = design.plant.shape
    steps = _steps(_rates(design, coordinates), n, sample_time)
    alphas = cloud(design, STEP_POINTS)
    between = np.tensordot(alphas, _rates(design, coordinates), 1)
    off = _steps(between, n, sample_time) - np.tensordot(alphas, steps, 1)
    # their errors have signs: moving all vertices by half of the largest halves it
    shift = (off.max(axis=0) + off.min(axis=0)) / 2
    error = float(np.linalg.norm(off - shift, axis=(1, 2)).max())
    unit = 2.0 ** (math.floor(math.log2(max(error, 1e-12))) - FINE)
    steps = np.round((steps + shift) / unit) * unit
    plant = _plant(design, steps, late_inputs(design, delay), sample_time)
    law = given_law(plant, _law(design, plant, coordinates))
    return Family(design, sample_time, delay, coordinates, steps, error, plant, law)


def _rates(design: Design, coordinates: Coordinates) -> Array:
    """Return [A, B] of all vertices in these coordinates."""
    T, plant = coordinates.T, design.plant
    B = T @ plant.B * coordinates.scale
    return np.concatenate([T @ plant.A @ np.linalg.inv(T), B], axis=2)


def _steps(rates: Array, n: int, sample_time: float) -> Array:
    return np.concatenate(zero_order_hold(rates[..., :n], rates[..., n:], sample_time), axis=-1)


def _plant(design: Design, steps: Array, late: int, sample_time: float) -> UncertainPlant:
    (n, m), N = design.plant.shape, len(steps)
    A = np.zeros((N, n + late, n + late))
    B = np.zeros((N, n + late, m + n))
    A[:, :n], B[:, :n, late:m] = steps[..., : n + late], steps[..., n + late :]
    B[:, :n, m:], B[:, n:, :late] = np.eye(n), np.eye(late)
    plant = UncertainPlant.from_vertices(list(A), list(B), sample_time=Fraction(sample_time))
    return replace(plant, parameters=design.plant.parameters)


def _law(design: Design, plant: UncertainPlant, coordinates: Coordinates) -> Law:
    n = design.plant.shape[0]
    more = {"states": plant.shape[0] - n, "inputs": n}
    return design.law.moved(coordinates.T, coordinates.scale, **more)


def _middle(family: Family, evidence: Mapping[str, Any]) -> Array:
    """Return the Lyapunov matrix at the middle."""
    law = family.law
    where = law.domain_of(family.plant)
    alpha = np.full(where.corners, 1 / where.corners)
    basis = where.basis(alpha, evidence["degree"])
    Q = np.tensordot(basis, in_floats(evidence["X"]), 1)
    if law.W is None:
        return np.asarray(Q)
    W = np.tensordot(where.basis(alpha, law.degree), law.W, 1)
    X = W @ (basis @ np.asarray(evidence["multiple"]) * np.eye(len(W)) + Q @ W)
    return np.asarray((X + X.T) / 2)


def _whitening(X: Array) -> Array:
    """Return a lower triangular T with T X T' = I."""
    scale = np.sqrt(np.diag(X))
    factor = np.linalg.cholesky(X / np.outer(scale, scale))
    return np.asarray(np.tril(np.linalg.inv(factor)) / scale)


def _rounded(T: Array, scale: Array) -> Coordinates:
    """Return short numbers, and powers of two."""
    mantissa, exponent = np.frexp(T)
    short = np.ldexp(np.round(mantissa * 2.0**BITS), exponent - BITS)
    return Coordinates(np.asarray(short), np.asarray(2.0 ** np.round(np.log2(scale))))
