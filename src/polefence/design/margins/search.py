"""The largest errors and rates that a design's own matrices prove, each with its exact proof."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

from polefence.base.errors import InputError
from polefence.design.checks import require_region
from polefence.design.design import Design, require_kind
from polefence.design.margins import estimate, gain, rate
from polefence.design.margins.breaks import estimate_break
from polefence.design.margins.directions import GIVEN, claimed_design
from polefence.design.margins.gain_breaks import gain_break
from polefence.design.margins.given_law import count_given, largest_given
from polefence.design.margins.inequalities import Balanced, balanced, count_whole
from polefence.design.margins.result import Margin, Service
from polefence.law.laws import FixedGain
from polefence.plant.names import rate_text, unit_text
from polefence.plant.parameters import Parameter
from polefence.proof import placement, work
from polefence.proof.service import (
    Estimate,
    Gain,
    Range,
    Rate,
    ServiceClaim,
    Subject,
    prove_service,
)
from polefence.region.regions import Region

# Pieces of each parameter's interval and elevation that are tried, while they gain something.
BOX, SIMPLEX = ((1, 0), (1, 1), (2, 0), (4, 0), (8, 0)), ((1, 0), (1, 1), (1, 2), (1, 3))
GAIN = 0.01
# Inequalities of one claim: above the first number no finer proof is tried, above the second none.
ENOUGH, MOST = 1500, 25_000
# What is proved of what the search reaches, until a proof succeeds.
RETREATS = (1.0, 0.999, 0.99, 0.95, 0.8, 0.5)
FASTEST = 1e9  # rate that is asked for, in ranges per second
BITS = 16  # of a margin: short numbers make short proofs

Evidence = tuple[float, ...]  # mu, of gains


@dataclass(frozen=True, eq=False)
class _Task:
    """A design, the region to be kept, and what of both every claim needs.

    ``subject`` is the design that claims are made of, None where there is none; ``balanced`` has
    one value for each of its Lyapunov polynomials.
    """

    design: Design
    region: Region
    subject: Design | None

    @cached_property
    def balanced(self) -> tuple[Balanced, ...]:
        return () if self.subject is None else balanced(self.subject, self.region)

    @cached_property
    def claim(self) -> placement.Claim:
        own = (self.subject or self.design).certificate.claim()
        return replace(own, region=placement.read_region(self.region.document()))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.design.plant.parameters

    @property
    def fixed(self) -> bool:
        law = self.design.law
        return isinstance(law, FixedGain) or not law.degree

    def subject_of(self, pieces: int, elevation: int) -> Subject:
        ranges = tuple(Range(p.low, p.high, p.inverted) for p in self.parameters)
        return Subject(self.claim, ranges, (pieces,) * len(ranges), elevation)

    def spans(self) -> Iterator[tuple[str, str, tuple[Fraction, ...]]]:
        """Yield name, unit and span: of each parameter alone, and of all at once."""
        spans = [p.high - p.low for p in self.parameters]
        for f, p in enumerate(self.parameters):
            own = tuple(s if f == g else Fraction(0) for g, s in enumerate(spans))
            yield p.name, unit_text(p.unit), own
        if len(spans) != 1:
            yield "", "", tuple(spans) or (Fraction(1),)

    def margin(self, kind: str, name: str, value: float, unit: str, **more: Any) -> Margin:
        return Margin(kind, name, value, unit, design=self.subject, **more)


def _task(design: Design, region: Region | None) -> _Task:
    if not isinstance(design, Design):
        raise InputError(
            f"design must be a Design, not {type(design).__name__}; polefence.place returns one"
        )
    require_kind(design.certificate)
    kept = design.region if region is None else region
    if not isinstance(kept, Region):
        raise InputError(f"region = {region!r} is no region; for example polefence.Disk(-40, 31)")
    require_region(design.plant, kept)
    return _Task(design, kept, claimed_design(design, kept))


def in_service(design: Design, decay: float = 0.0, *, region: Region | None = None) -> Service:
    """Return how much may go wrong in service while the poles stay in the region, proved.

    Parameters
    ----------
    design : Design
        Of any method. Of "slack", and of "lyapunov" where another region is kept, the law is first
        proved again with Lyapunov polynomials.
    decay : float
        What rates of change must leave of exponential stability [1/s].
    region : Region, optional
        What is to be kept; the design's own region without it. ``HalfPlane(0)`` asks for
        stability.

    Returns
    -------
    Service
        Its margins: `estimation_error`, `gain_error` and `parameter_rate`. Where nothing is proved
        a margin is "undecided", its value zero.

    Raises
    ------
    InputError
        If the design or the region is none, or the design is an observer's.
    """
    task = _task(design, region)
    still = task if task.region == design.region else _task(design, None)
    margins = (*_estimates(task), _gain(task), *_rates(still, decay))
    return Service(design, task.region, decay, margins)


def estimation_error(design: Design, *, region: Region | None = None) -> tuple[Margin, ...]:
    """Return how far the parameters that the law is given may be off.

    Returns
    -------
    tuple of Margin
        For each parameter with all others exact, in its own unit, and for all at once as a share of
        each range. Without parameters: the share of weight that alpha may mislay (half the sum of
        |alpha_j - estimate_j|). For one gain there are none: it needs no estimate.

    Raises
    ------
    InputError
        If the design or the region is none, or the design is an observer's.
    """
    return _estimates(_task(design, region))


def gain_error(design: Design, *, region: Region | None = None) -> Margin:
    """Return how far the gain may be off, relative to the largest entries of its columns.

    With k_j the largest absolute value in column j of K at the corners, K(alpha) + Delta keeps the
    poles in the region for every Delta = value * diag(rows) D diag(k), D of spectral norm at most
    one. ``rows`` is one for one input, else the largest share of any k_j that an input's row has;
    ``claim.rows`` and ``claim.columns`` have the numbers.

    Raises
    ------
    InputError
        If the design or the region is none, or the design is an observer's.
    """
    return _gain(_task(design, region))


def _gain(task: _Task) -> Margin:
    scales = gain.scales_of(task.design)
    rows, columns = (tuple(Fraction(float(v)) for v in x) for x in (scales.rows, scales.columns))
    given = task.subject is not None and task.subject.method == "lyapunov"

    def find(pieces: int, elevation: int) -> tuple[float, Evidence]:
        if given and task.subject is not None:
            each = largest_given(task.subject, scales, elevation)
        else:
            each = gain.largest_each(task.balanced[0], scales, pieces, elevation)
        if not each:
            return -1.0, ()
        return min(error for error, _ in each), tuple(mu for _, mu in each)

    def claim(subject: Subject, t: float, mu: Evidence) -> tuple[Gain, float]:
        error = _short(t)
        return Gain(subject, error, rows, columns, tuple(map(_short, mu))), float(error)

    def count(pieces: int, elevation: int) -> float:
        if given and task.subject is not None:
            return count_given(task.subject, elevation)
        return count_whole(task.balanced[0], pieces, elevation)

    proved, value = _proved(task, find, claim, count, GIVEN if given else None)
    found = gain_break(task.design, task.region, scales, value)
    upper, example = (found.value, found.example) if found else (None, "")
    more = {"upper": upper, "example": example, "claim": proved}
    return task.margin("gain", "", value, "of each column", **more)


def parameter_rate(design: Design, decay: float = 0.0) -> tuple[Margin, ...]:
    """Return how fast the parameters may change, the law following them without error.

    For every trajectory of the parameters within these rates the loop is exponentially stable: the
    norm of x(t) is at most c exp(-decay t) times that of x(0), by V = x' W^-1 x. This is about the
    motion, not about the poles of frozen plants.

    Parameters
    ----------
    decay : float
        [1/s], zero or more.

    Returns
    -------
    tuple of Margin
        For each parameter while the others are constant, in its own unit per second, and for all at
        once in ranges per second. Without parameters: half the sum of abs(d alpha_j / dt) [1/s].
        For one gain "any": no rate is too large. None for plants in discrete time.

    Raises
    ------
    InputError
        If the decay rate is negative, or the design none.
    """
    return _rates(_task(design, None), decay)


def _rates(task: _Task, decay: float) -> tuple[Margin, ...]:
    if not (isinstance(decay, int | float) and 0 <= decay < 1e100):
        raise InputError(f"decay = {decay!r} must be a rate of zero or more [1/s]")
    if task.design.plant.sample_time is not None:
        if decay:
            raise InputError(
                f"decay = {decay:g}: {task.design.plant.name} is in discrete time, where no rates "
                "of change are proved; leave it out"
            )
        return ()
    whole = [("", "", tuple(p.high - p.low for p in task.parameters) or (Fraction(1),))]
    if any(not own.degree for own in task.balanced):  # constant: no rate is too large
        found = _rate(task, decay, *whole[0])
        if math.isinf(found.value):
            return (found,)
    spans = whole if task.fixed and not task.balanced else task.spans()
    return tuple(_rate(task, decay, *each) for each in spans)


def _rate(task: _Task, decay: float, name: str, unit: str, span: tuple[Fraction, ...]) -> Margin:
    """Return the largest rate that the Lyapunov polynomial of any part of the region proves."""
    proved: ServiceClaim | None = None
    value = 0.0
    for part in range(len(task.balanced)):
        other, reached = _rate_of(task, part, decay, name, span)
        if other is not None and (proved is None or reached > value):
            proved, value = other, reached
    joint = "" if math.isinf(value) else "ranges/s" if task.parameters else "1/s"
    own = rate_text(unit) if name else joint
    return task.margin("rate", name, value, own, claim=proved)


def _rate_of(
    task: _Task, part: int, decay: float, name: str, span: tuple[Fraction, ...]
) -> tuple[ServiceClaim | None, float]:
    """Return what one Lyapunov polynomial proves."""
    floats, balanced_ = [float(s) for s in span], task.balanced[part]

    def find(pieces: int, elevation: int) -> tuple[float, Evidence]:
        found = rate.largest(balanced_, task.parameters, floats, decay, pieces, elevation)
        # where all W are equal but for rounding, no rate is too large in floats
        return min(found, FASTEST) if balanced_.degree else found, ()

    def claim(subject: Subject, t: float, _: Evidence) -> tuple[Rate, float]:
        if math.isinf(t):
            return Rate(subject, Fraction(decay), None, part), math.inf
        rates = tuple(_short(t * s) for s in floats)
        return Rate(subject, Fraction(decay), rates, part), _value(rates, span, name)

    def count(pieces: int, elevation: int) -> float:
        N = len(balanced_.A)
        signs = 2 ** sum(s > 0 for s in span) if task.parameters else N * (N - 1)
        return count_whole(balanced_, pieces, elevation) * signs

    return _proved(task, find, claim, count)


def _estimates(task: _Task) -> tuple[Margin, ...]:
    return () if task.fixed else tuple(_estimate(task, *each) for each in task.spans())


def _estimate(task: _Task, name: str, unit: str, span: tuple[Fraction, ...]) -> Margin:
    floats = [float(s) for s in span]

    def find(pieces: int, elevation: int) -> tuple[float, Evidence]:
        each = (
            estimate.largest(own, task.parameters, floats, pieces, elevation)
            for own in task.balanced
        )
        return min(each), ()

    def claim(subject: Subject, t: float, _: Evidence) -> tuple[Estimate, float]:
        shares = zip(floats, span, strict=True)
        errors = tuple(s if t == 1 else min(_short(t * f), s) for f, s in shares)
        return Estimate(subject, errors), _value(errors, span, name)

    def count(pieces: int, elevation: int) -> float:
        return sum(estimate.count_blocks(own, floats, pieces, elevation) for own in task.balanced)

    proved, value = _proved(task, find, claim, count)
    whole = max(floats) if name else 1.0
    found = estimate_break(task.design, task.region, span, value / whole)
    upper, example = (found.value * whole, found.example) if found else (None, "")
    joint = "of each range" if task.parameters else "of the weight"
    more = {"upper": upper, "example": example, "claim": proved}
    return task.margin("estimate", name, value, unit if name else joint, **more)


def _proved(
    task: _Task,
    find: Callable[[int, int], tuple[float, Evidence]],
    claim: Callable[[Subject, float, Evidence], tuple[ServiceClaim, float]],
    count: Callable[[int, int], float],
    ladder: tuple[tuple[int, int], ...] | None = None,
) -> tuple[ServiceClaim | None, float]:
    """Search at one fineness after another; prove the best, or a little less."""
    best: tuple[float, Evidence, Subject] | None = None
    if not task.balanced:
        return None, 0.0
    for fineness in ladder or (BOX if task.parameters else SIMPLEX):
        if count(*fineness) > (ENOUGH if best else MOST):
            break
        reached, evidence = find(*fineness)
        if best and reached <= best[0] * (1 + GAIN):
            break
        if reached >= 0:
            best = reached, evidence, task.subject_of(*fineness)
        if math.isinf(reached):
            break
    if best is None:
        return None, 0.0
    reached, evidence, subject = best
    for retreat in RETREATS:
        proved, value = claim(subject, reached * retreat, evidence)
        if _holds(proved):
            return proved, value
    return None, 0.0


def _holds(claim: ServiceClaim) -> bool:
    try:
        return prove_service(claim).proved
    except work.FormatError:  # more than the checker takes on
        return False


def _value(values: tuple[Fraction, ...], span: tuple[Fraction, ...], name: str) -> float:
    """Return the value of the one parameter, or the least share of a span; rounded down."""
    share = max(values) if name else min(v / s for v, s in zip(values, span, strict=True))
    value = float(share)
    return value if Fraction(value) <= share else math.nextafter(value, 0)


def _short(value: float) -> Fraction:
    """Return a number a little below, of few digits."""
    mantissa, exponent = math.frexp(value)
    return Fraction(math.floor(mantissa * 2**BITS)) * Fraction(2) ** (exponent - BITS)
