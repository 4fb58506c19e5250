"""Laws that are given estimates of the parameters: designed for errors of these, and proved.

At each estimate q the inequalities are multi-affine in the scheduling variables of the parameters
p: p = q + e and q - e, cut off at the bounds, are enough. So a law for all p within e of q is one
for patches of pairs (p, q) at whose corners both are known. Of a parameter that acts by its inverse
a patch is only near the pairs; the proof, a claim of `polefence.proof.claims.estimate`, is exact.

Of a plant with a remainder the law is found for the combinations of the vertices, and proved for
the plant by the law's own W.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, suggest
from polefence.certify.certificate import Certificate
from polefence.certify.checks import (
    require_checkable,
    require_domain,
    require_movable,
    require_region,
)
from polefence.certify.design import Design
from polefence.certify.evidence import certificate_of, with_remainder
from polefence.certify.margins.claims import (
    BOX,
    MOST,
    Reached,
    holds,
    subject_of,
)
from polefence.certify.margins.estimate import (
    count_blocks,
    count_pairs,
    estimate_holds,
    points_of,
)
from polefence.certify.margins.loops import balanced
from polefence.lmi.conditions.methods import Method, Scheduled, Slack, method_label, options
from polefence.lmi.conditions.target import Patch
from polefence.plant.boxes import Box
from polefence.plant.exact import ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import exact
from polefence.plant.system import Array
from polefence.proof.claims.estimate import Estimate, segments
from polefence.region.regions import Region
from polefence.response.samples import at_sample_time
from polefence.search.by_lmi import laws_in, proved
from polefence.search.driver import Source


def sources(
    plant: UncertainPlant, region: Region, method: Method | None, errors: Mapping[str, Any]
) -> list[Source]:
    """Return laws for a region for all estimates that are off by so much, and a little more.

    What is proved has the claim of the errors among its ``more``.

    Parameters
    ----------
    errors : mapping
        Of each parameter's name to how far its estimate may be off, in its unit; others are known.

    Raises
    ------
    NotProvedError
        If a proof would be too large.
    InputError
        If a name or an error is none, or the method is none that schedules.
    """
    offsets = _errors(plant, errors)
    method = _boxed(method)
    require_domain(plant, method)
    require_region(plant, region, method)
    require_movable(plant, region)
    require_checkable(plant, method, len(region.parts))
    plant = _countable(plant, region, method, offsets)
    said = ", ".join(
        f"{p.name} off by {float(e):g}" for p, e in zip(plant.parameters, offsets, strict=True) if e
    )

    def laws(room: float, inside: Region) -> Iterator[Certificate]:
        wider = [
            min(Fraction(room) * e, p.high - p.low)
            for e, p in zip(offsets, plant.parameters, strict=True)
        ]
        return laws_in(plant.combinations, inside, method, patches(plant, wider), refusal(region))

    def certified(certificate: Certificate, region: Region) -> Design | None:
        design = _kept(plant, certificate, region)
        claim = None if design is None else _claim(design, offsets)
        return None if design is None or claim is None else replace(design, more=(claim,))

    def refusal(region: Region) -> NotProvedError:
        return NotProvedError(
            f"not proved: {method_label(method)} gives no proof for {region} with {said}; try "
            "smaller errors, a wider region, or one gain, which needs no estimates"
        )

    # laws for larger errors, until those that are asked for are proved
    return [Source(plant, partial(laws, room), certified, refusal) for room in (1.0, 1.05, 1.25)]


def _kept(plant: UncertainPlant, point: Certificate, region: Region) -> Design | None:
    """Return the design of a point, None where it is not proved: with X = W for a remainder."""
    if plant.remainder is None:
        return proved(point, region)
    n, shape = plant.shape[0], {"degree": 0, "elevation": point.evidence.get("elevation", 1)}
    with suppress(np.linalg.LinAlgError):
        plain = shape | {"X": np.zeros((1, n, n)), "multiple": np.ones(1)}
        evidence = with_remainder(plant, point.law, plain)
        certificate = certificate_of(plant, point.law, region, [evidence] * len(region.parts))
        return Design(certificate) if certificate.holds() else None
    return None


def _countable(
    plant: UncertainPlant, region: Region, method: Scheduled, errors: list[Fraction]
) -> UncertainPlant:
    """Return the plant, or its samples of a lower degree, of which a proof is not too large.

    Raises
    ------
    NotProvedError
        If there is none.
    """
    sizes, q = list(map(float, errors)), len(plant.parameters)
    while True:
        d = plant.curve_degree
        degrees = int(method.degree) * (1 if plant.remainder is None else 2), d
        per_pair = count_pairs((2,) * q, degrees, q, sizes, 1, method.elevation)
        count = per_pair * len(region.pairs())
        if count <= MOST:
            return plant
        if plant.sampling is None or d == 1:
            raise NotProvedError(
                f"undecided: {count:.0f} inequalities of pairs of parameters and estimates, more "
                f"than the {MOST} that are tried; name fewer errors, or ask for fewer parts of the "
                "region"
            )
        sampling = plant.sampling
        plant = at_sample_time(sampling.plant, plant.sample_time, sampling.late, d - 1)


def _boxed(method: Method | None) -> Scheduled:
    """Return a scheduled method on the box.

    Raises
    ------
    InputError
        If it schedules nothing, or asks for a search for a degree.
    """
    scheduled = Scheduled(1, 1, "box") if method in (None, "scheduled") else options(method or "")
    if isinstance(scheduled, Slack) or scheduled.degree == 0:
        raise InputError(
            "errors of estimates need a scheduled law of degree 1 or more, not "
            f"{method_label(method or '')}; one gain needs no estimates"
        )
    if scheduled.degree == "auto":
        raise InputError(
            "errors of estimates need a scheduled law of a fixed degree, 1 or more, not auto"
        )
    return (
        scheduled
        if scheduled.on == "box"
        else Scheduled(scheduled.degree, scheduled.elevation, "box")
    )


def _errors(plant: UncertainPlant, errors: Mapping[str, Any]) -> list[Fraction]:
    """Return an error a parameter, zero of those that are not named."""
    names = [p.name for p in plant.parameters]
    if not names:
        raise InputError(f"{plant.name} has no parameters that could be estimated")
    for name in errors:
        if name not in names:
            raise InputError(f"errors: no parameter {name!r}; {suggest(str(name), names)}")
    offsets = [exact(errors.get(name, 0), f"error of {name}") for name in names]
    for p, e in zip(plant.parameters, offsets, strict=True):
        if e < 0 or float(e) > float(p.high - p.low):
            raise InputError(
                f"error of {p.name} = {float(e):g} must be zero or more, at most the width of its "
                f"range, {float(p.high - p.low):g}"
            )
    if not any(offsets):
        raise InputError("errors: each is zero; leave them out")
    return [min(e, p.high - p.low) for p, e in zip(plant.parameters, offsets, strict=True)]


def patches(plant: UncertainPlant, errors: list[Fraction]) -> tuple[Patch, ...]:
    """Return pairs of parameters and estimates: on each side of the errors, up to the bounds."""
    sides = [
        [(_weights(parameter, p), _weights(parameter, q)) for (p,), q in segments(r, e, 1)]
        for parameter, r, e in zip(plant.parameters, ranges_of(plant), errors, strict=True)
    ]
    return tuple(_patches(sides))


def _patches(sides: list[list[tuple[Array, Array]]]) -> Iterator[Patch]:
    for chosen in product(*sides):
        whole: Array = np.ones((1, 1))
        for p, _ in chosen:
            whole = np.asarray(np.kron(whole, np.stack([1 - p, p], axis=1)), dtype=float)
        low, high = (tuple(float(q[end]) for _, q in chosen) for end in (0, 1))
        yield Patch(whole, Box(low, high))


def _weights(parameter: Any, ends: tuple[Fraction, Fraction]) -> Array:
    """Return the weights of a parameter's upper end at two values."""
    return np.array([float(parameter.weights(value)[1]) for value in ends])


def _claim(design: Design, errors: list[Fraction]) -> Estimate | None:
    """Return the claim that the errors are borne, None where no fineness proves it."""
    if design.law.fixed:
        return None
    loops, sizes = balanced(design, design.region), list(map(float, errors))
    for pieces, elevation in BOX:
        fineness = sizes, pieces, elevation
        if sum(count_blocks(loop, *fineness) for loop in loops) > MOST:
            return None
        points = (points_of(loop, design.plant.parameters, *fineness) for loop in loops)
        if not all(map(estimate_holds, loops, points)):  # in floats, which take no time
            continue
        subject = subject_of(design, design.region, Reached(1.0, pieces, elevation))
        claim = Estimate(subject, tuple(errors))
        if holds(claim):
            return claim
    return None
