"""Decay of a sampled loop, proved for every parameter value: searched in floats, then exactly."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.design.certificate import Check, ranges_of
from polefence.design.design import Design
from polefence.design.given.closed_loop import evidence_of, forms, loop_of
from polefence.design.margins.claims import above
from polefence.design.search import edge
from polefence.export.c99.program import exactly
from polefence.export.sampled.family import (
    Coordinates,
    Family,
    Proof,
    family_of,
    first_coordinates,
    next_coordinates,
)
from polefence.export.sampled.poles import require_usable, sampling
from polefence.law.laws import FixedGain
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.lyapunov import least
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import Rounded, rounding_error
from polefence.proof.claims.sampled import MAX_TERMS, Off, Sampled, loop_claim
from polefence.proof.claims.steps import gain_error, held_size, step_error
from polefence.proof.laws import Evidence
from polefence.proof.work import FormatError
from polefence.region.text import digits_down

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


@dataclass(frozen=True, eq=False)
class SampledProof:
    """What is proved of a loop closed by samples.

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
    slowest = sampling(design, seconds, delay).decay
    claim, reason = None, "the sampled loop is not stable for all parameter values"
    if slowest > 0:
        search = _Search(design, seconds, delay, slowest, off)
        claim, reason = search.run()
    decay = float(claim.decay) if claim else 0.0
    taken = time.perf_counter() - start
    return SampledProof(seconds, delay, decay, slowest, claim, reason, taken)


def off_by_rounding(claim: Rounded) -> Off:
    """Return what the code's rounding puts on the gain, for `prove_decay`."""
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
    """For a proof of the decay rate of a loop whose slowest pole, in a sample, is known."""

    design: Design
    sample_time: float
    delay: int
    slowest: float
    off: Off | None

    def run(self) -> tuple[Sampled | None, str]:
        """Return a claim that is proved; or None, and why not."""
        try:
            family = self._family()
            found = max(self._candidates(family), key=lambda each: each.share, default=None)
        except (SolverError, np.linalg.LinAlgError, FormatError, InputError) as problem:
            return None, f"no proof was found: {problem}"
        if found is None or found.share <= 0:
            return None, "no Lyapunov polynomial was found that leaves room for the error between"
        reason = "the room found in floats is not there"
        for retreat in RETREATS:
            claim = self._claim(family, found, found.share * retreat)
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
        found = least(loop_of(first.plant, first.law), Disks(0.0), *form, enough=enough)
        return self._in(next_coordinates(first, evidence_of(found, form)))

    def _forms(self) -> tuple[tuple[int, int], ...]:
        law = self.design.law
        degree = 0 if isinstance(law, FixedGain) else law.degree
        return LADDER.get(degree, ((degree, 0), (degree, 0)))

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
                found = least(loop, Disks(0.0), *form, enough=radius)
                yield _short_evidence(evidence_of(found, form))

    def _blank(self, family: Family) -> Sampled:
        """Return a claim of no error, for what of it the bounds need."""
        own, claim = family.coordinates, self.design.certificate.claim()
        return Sampled(
            design=claim,
            ranges=ranges_of(self.design.plant),
            sample_time=Fraction(self.sample_time),
            delay=self.delay,
            decay=Fraction(0),
            radius=Fraction(0),
            T=exactly(own.T),
            scale=tuple(Fraction(float(s)) for s in own.scale),
            steps=tuple(exactly(step) for step in family.steps),
            terms=_terms(family),
            evidence=Evidence([]),
            error=Fraction(0),
            mu=Fraction(0),
            weight=Fraction(LEAST),
            off=self.off,
        )

    def _weighted(self, blank: Sampled, needed: float) -> Sampled:
        """Give the rows of v the weight that makes both errors alike."""
        own = float(gain_error(blank)) * LEAST
        return replace(blank, weight=above(own / needed)) if own > LEAST * needed else blank

    def _share(self, family: Family, blank: Sampled, proof: Proof | None, needed: float) -> float:
        """Return the largest share of the sampled decay that leaves room for the error."""

        def leaves_room(share: float) -> bool:
            radius = math.exp(-self.slowest * share * self.sample_time)
            return family.tolerated(proof, radius, _rows(blank))[0] >= ROOM * needed

        return edge(leaves_room, 0.0, 1.0, HALVINGS)[0]

    def _claim(self, family: Family, found: _Candidate, share: float) -> Sampled | None:
        decay = Fraction(digits_down(share * self.slowest, DIGITS))
        radius = _radius(decay, Fraction(self.sample_time))
        largest, mu = family.tolerated(found.proof, float(radius), _rows(found.blank))
        if largest <= found.needed:
            return None
        error = math.sqrt(largest * found.needed)
        return replace(
            found.blank,
            decay=decay,
            radius=radius,
            evidence=_exact_evidence(found.evidence),
            error=above(error),
            mu=above(mu * error / largest),
        )


def _rows(blank: Sampled) -> Array:
    own = blank.off.rows if blank.off else blank.scale
    pairs = zip(own, blank.scale, strict=True)
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
    law, own = family.design.law, family.coordinates
    if isinstance(law, FixedGain):
        return blank
    W, Z = own.T @ law.W @ own.T.T, law.Z @ own.T.T / own.scale[:, None]
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
    X = np.asarray(evidence["X"])
    multiple = np.asarray(evidence.get("multiple", np.zeros(0)))
    _, exponent = np.frexp(max(np.abs(X).max(), np.abs(multiple).max(initial=0.0)))
    unit = 2.0 ** (int(exponent) - EVIDENCE_BITS)
    short = evidence | {"X": np.round((X + X.swapaxes(1, 2)) / 2 / unit) * unit}
    return short | ({"multiple": np.round(multiple / unit) * unit} if multiple.size else {})


def _exact_evidence(evidence: dict[str, Any]) -> Evidence:
    multiple = tuple(Fraction(float(v)) for v in evidence.get("multiple", ()))
    X = [exactly(x) for x in evidence["X"]]
    return Evidence(X, evidence["degree"], evidence["elevation"], multiple)
