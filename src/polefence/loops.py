"""Laws that are given, closed around a plant: as polynomials to analyse, and claims to prove."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from math import prod
from typing import Any

import numpy as np

from polefence.checks import require_type
from polefence.conditions.lyapunov import Loop
from polefence.design import Design, require_kind
from polefence.errors import InputError
from polefence.law import FixedGain, Law, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.names import unit_text
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.polynomial import Domain, bernstein, elevated, times
from polefence.proof import exact
from polefence.proof.certificate import Certificate
from polefence.region import Region
from polefence.solve.given import Proof

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
# What a step of the search may cost, beyond the first form [multiplications].
MOST_WORK = 1e10


def given_law(plant: UncertainPlant, law: Any) -> Law:
    """Return a law in any of the forms that users have it in, checked against the plant.

    Where alpha comes from parameters, a scheduled law of degree 1 on the simplex is returned as
    one on their box: there it is the same law, and the box is what matters.

    Raises
    ------
    InputError
        If it is none, or does not fit.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    if isinstance(law, Design):
        require_kind(law.certificate)
        law = law.law
    if not isinstance(law, FixedGain | ScheduledGain):
        law = FixedGain(_matrix(plant, law))
    n, m = plant.shape
    shape = law.K.shape if isinstance(law, FixedGain) else law.Z.shape[1:]
    if shape != (m, n):
        raise InputError(f"the gain is {shape[0]} x {shape[1]}; {plant.name} needs {m} x {n}")
    return law if isinstance(law, FixedGain) else _scheduled(plant, law)


def _matrix(plant: UncertainPlant, law: Any) -> Any:
    if hasattr(law, "nstates"):  # of python-control
        if law.nstates or not hasattr(law, "D"):
            raise InputError(
                "the controller is a dynamic system; give a static gain, u = K x, and put states "
                "of the controller, such as integrals, into the plant"
            )
        law = law.D
    try:
        K = np.asarray(law, dtype=float)
    except (TypeError, ValueError, OverflowError):
        K = np.zeros(0)
    if K.ndim != 2 or not np.all(np.isfinite(K)):
        n, m = plant.shape
        raise InputError(f"the gain must be {m} x {n} finite numbers, a list of rows: [[...]]")
    return K


def _scheduled(plant: UncertainPlant, law: ScheduledGain) -> ScheduledGain:
    N = len(plant.vertices)
    if law.domain.corners != N:
        raise InputError(f"the law has {law.domain.corners} vertices; {plant.name} has {N}")
    theirs, ours = (_ranges(each.parameters) for each in (law, plant))
    if theirs and ours and theirs != ours:
        raise InputError(f"the law's parameters, or their ranges, are not those of {plant.name}")
    if ours and law.degree == 1:
        return replace(law, sizes=Domain.of("box", N).sizes)
    return law


def _ranges(parameters: Sequence[Parameter]) -> list[tuple[str, Fraction, Fraction, str]]:
    return [(p.name, p.low, p.high, p.through) for p in parameters]


def domain_of(plant: UncertainPlant, law: Law) -> Domain:
    """Return where a claim is made: the law's own domain; the box where there are parameters."""
    if isinstance(law, ScheduledGain):
        return law.domain
    return Domain.of("box" if plant.parameters else "simplex", len(plant.vertices))


def loop_of(plant: UncertainPlant, law: Law) -> Loop:
    """Return the closed loop as a quotient of polynomials."""
    return _loop(plant, law, np.concatenate([plant.A, plant.B], axis=2))


def loop_with(plant: UncertainPlant, law: Law, C: Array, D: Array) -> Loop:
    """Return the closed loop with the rows of y = C x + D u, (N, p, n) and (N, p, m), below it."""
    rows = [np.concatenate([plant.A, C], axis=1), np.concatenate([plant.B, D], axis=1)]
    return _loop(plant, law, np.concatenate(rows, axis=2))


def _loop(plant: UncertainPlant, law: Law, rows: Array) -> Loop:
    n, domain = plant.shape[0], domain_of(plant, law)
    AB = bernstein(domain, rows, 1)
    if isinstance(law, FixedGain):
        eye = {(0,) * sum(domain.sizes): np.eye(n)}
        both = {(0,) * sum(domain.sizes): np.vstack([np.eye(n), law.K])}
        return Loop(elevated(eye, domain, 1), times(AB, both), domain)
    W = bernstein(domain, law.W, law.degree)
    both = bernstein(domain, np.concatenate([law.W, law.Z], axis=1), law.degree)
    return Loop(elevated(W, domain, 1), times(AB, both), domain, W)


def forms(plant: UncertainPlant, law: Law, parts: int = 1) -> Iterator[tuple[int, int]]:
    """Yield degree and elevation of the Lyapunov polynomials worth trying, the first whatever.

    Raises
    ------
    InputError
        If the plant is so large that the exact checker does not take even the first.
    """
    n, domain = plant.shape[0], domain_of(plant, law)
    own = 2 * law.degree if isinstance(law, ScheduledGain) else 0
    for degree, elevation in LADDER:
        blocks = domain.count(degree + 1 + own + elevation)
        unknowns = domain.count(degree) * n * (n + 1) // 2
        checked = exact.least_work(blocks * parts**2, 2 * n) <= exact.MAX_WORK
        if (degree, elevation) == LADDER[0]:
            if not checked:
                raise InputError(f"{plant.name}: {blocks} inequalities are more than is checked")
        elif not checked or blocks * unknowns**2 * (2 * n) ** 2 > MOST_WORK:
            return
        yield degree, elevation


def placeholder(plant: UncertainPlant, law: Law) -> dict[str, Any]:
    """Return evidence that has the shape of some, for a claim whose poles are to be looked at."""
    n, count = plant.shape[0], domain_of(plant, law).count(0)
    return {"X": np.tile(np.eye(n), (count, 1, 1)), "degree": 0, "elevation": 0}


def evidence_of(found: Proof, form: tuple[int, int]) -> dict[str, Any]:
    """Return what was found as a certificate has it."""
    evidence = {"X": found.Q, "degree": form[0], "elevation": form[1]}
    return evidence if found.multiple is None else evidence | {"multiple": found.multiple}


def certificate_of(
    plant: UncertainPlant, law: Law, region: Region, parts: Sequence[dict[str, Any]]
) -> Certificate:
    """Return the claim with its evidence, one for each part of the region."""
    evidence: dict[str, Any] = {"parts": tuple(parts)}
    if isinstance(law, FixedGain) and len(domain_of(plant, law).sizes) > 1:
        evidence["on"] = "box"
    return Certificate(plant, region, "lyapunov", law, evidence)


def values_at(plant: UncertainPlant, alpha: Sequence[Any]) -> dict[str, float] | None:
    """Return the parameters' values at alpha; None where none have this alpha.

    That is where the plant has no parameters, or alpha is no product of their weights.
    """
    count = len(plant.parameters)
    high = [
        sum((Fraction(a) for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        for bit in reversed(range(count))
    ]
    for j, a in enumerate(alpha):
        bits = zip(high, reversed(range(count)), strict=True)
        weight = prod((w if j >> bit & 1 else 1 - w for w, bit in bits), start=Fraction(1))
        if not count or abs(weight - Fraction(a)) > Fraction(1, 10**9):
            return None
    found = {}
    for p, w in zip(plant.parameters, high, strict=True):
        low, top = p.scheduling(p.low), p.scheduling(p.high)
        found[p.name] = float(p.scheduling(low + w * (top - low)))
    return found


def values_text(plant: UncertainPlant, values: dict[str, float]) -> str:
    """Print parameter values with their units."""
    units = {p.name: unit_text(p.unit) for p in plant.parameters}
    return ", ".join(f"{name} = {v:.6g} {units[name]}".rstrip() for name, v in values.items())
