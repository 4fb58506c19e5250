"""Limits that no law keeps at once: found in floats, proved exactly; of others, a smallest set.

At one vertex the least weighted sum of mean squares over all laws is that of the linear-quadratic
regulator, sum a_i E[y_i^2] >= S tr E'P E with P from a Riccati equation. It is concave in the
weights a; its largest value over that of the limits themselves is the square of the factor by which
every law exceeds one of the limits (Boyd & Barratt 1991, on weights of several mean squares).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, SolverError, require_type
from polefence.design.requirements.rms import Rms
from polefence.design.requirements.specification import Specification, disturbance, limit_text, rows
from polefence.design.signals.augmented import with_weights
from polefence.design.signals.task import Task
from polefence.lmi.conditions.methods import method_label
from polefence.lmi.solve.regulator import Regular, Regulated, heaviest, regular
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Output
from polefence.proof.refutation import RmsLimit, RmsRefutation, prove_refutation
from polefence.proof.text import number_text
from polefence.proof.work import FormatError
from polefence.region.regions import Region
from polefence.region.text import digits_down

# Decay taken off the plant, of its own rates, so that P proves the inequality with a margin; and
# as a share of that what is taken off the cost, for directions that no output sees.
MARGINS = tuple((10.0**k, share) for share in (0.0, 1.0) for k in range(-9, -2))
SEARCH = 1e-6  # the same in the search for weights
SHORT = 1e-9  # below what P stands for, the factor that is claimed


@dataclass(frozen=True, eq=False)
class Refutation:
    """At a vertex of the family no law keeps the limits at once; proved in exact arithmetic.

    Attributes
    ----------
    plant : UncertainPlant
    specifications : tuple of Rms
        The limits.
    claim : RmsRefutation
        With its evidence, for `polefence.proof.refutation.prove_refutation`.
    reason : str
        What was proved.
    """

    plant: UncertainPlant
    specifications: tuple[Rms, ...]
    claim: RmsRefutation
    reason: str

    @property
    def vertex(self) -> int:
        """Of the plant, counted from zero."""
        return self.claim.vertex

    @property
    def factor(self) -> float:
        """No law keeps so many times each limit either."""
        return float(self.claim.factor)

    @property
    def where(self) -> str:
        """The vertex in words, with the parameters' values."""
        last = len(self.plant.parameters) - 1
        values = [
            f"{p.name} = {number_text(p.high if self.vertex >> (last - k) & 1 else p.low)} {p.unit}"
            for k, p in enumerate(self.plant.parameters)
        ]
        named = ", ".join(value.strip() for value in values)
        return f"vertex {self.vertex + 1}" + (f" ({named})" if named else "")

    def __str__(self) -> str:
        named = "; ".join(
            limit_text(s) + f" with weight {s.weight}" * bool(s.weight) for s in self.specifications
        )
        these, them = ("this", "it") if len(self.specifications) == 1 else ("these at once", "each")
        return (
            f"refuted: at {self.where} no law keeps {these}, nor {digits_down(self.factor)} times "
            f"{them}: {named}"
        )


def refute_limits(
    plant: UncertainPlant, specifications: Sequence[Specification]
) -> Refutation | None:
    """Return the proof that no law keeps limits on rms values at once, None if none was found.

    Looks at each vertex of the family by itself, where a scheduled law is one gain: limits that are
    in conflict for another reason are not refuted here.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E.
    specifications : sequence of Specification
        Limits; what is no `Rms` with its ``at_most`` is left out, and so is `RelativeRms`.

    Returns
    -------
    Refutation or None
        It holds for every stabilising law, also one with states of its own, one that is not linear
        and one that is told the parameters, as long as it does not know the noise to come.

    Raises
    ------
    InputError
        If a specification does not fit the plant, or the plant is in discrete time.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    if plant.sample_time is not None:
        raise InputError(f"{plant.name} is in discrete time; specifications are of continuous time")
    for own in specifications:
        require_type(own, Specification, "specifications", "for example Rms('force', 700)")
    asked = tuple(s for s in specifications if type(s) is Rms and s.at_most is not None)
    if not asked:
        return None
    larger, bare = with_weights(plant, asked)
    disturbance(larger)
    limits = tuple(
        RmsLimit(
            Output(*rows(larger, s.output(larger)), own.name),
            Fraction(own.at_most or 0.0),
            Fraction(own.density) / 2,
        )
        for own, s in zip(asked, bare, strict=True)
        if isinstance(s, Rms)
    )
    for claim in _claims(larger, limits):
        try:
            verdict = prove_refutation(claim)
        except FormatError:
            continue
        if verdict.proved:
            return Refutation(plant, asked, claim, verdict.reason)
    return None


def _claims(plant: UncertainPlant, limits: tuple[RmsLimit, ...]) -> Iterator[RmsRefutation]:
    """Yield claims to prove, from the vertex where the limits are furthest apart."""
    A, B, E = (
        [[list(row) for row in M] for M in matrices if M is not None]
        for matrices in (
            [v.exact_A for v in plant.vertices],
            [v.exact_B for v in plant.vertices],
            [v.exact_E for v in plant.vertices],
        )
    )
    # the noise goes into the outputs; each is over its limit
    unit = np.sqrt([float(limit.intensity) / float(limit.level) ** 2 for limit in limits])
    found: list[tuple[float, int, Array, Regular, Regulated]] = []
    for j in range(len(A)):
        C, D = ([row for y in limits for row in getattr(y.output, k)[j]] for k in "CD")
        exact = regular(A[j], B[j], E[j], C, D)
        if exact is None:
            continue
        floats = _regulated(exact, unit)
        weights, cost = heaviest(floats, SEARCH * _rate(floats.A))
        if cost > 1:
            found.append((cost, j, weights, exact, floats))
    for _, j, weights, exact, floats in sorted(found, key=lambda each: -round(each[0], 5)):
        scaled = tuple(Fraction(x) for x in (weights * unit**2).tolist())
        allowed = sum(a * y.level**2 / y.intensity for a, y in zip(scaled, limits, strict=True))
        for own in _matrices(floats, weights):
            factor = _factor(exact, own, allowed)
            if factor >= 1:
                P = _lifted(own, exact.T)
                yield RmsRefutation(A, B, E, limits, j, scaled, P, factor)


def _regulated(exact: Regular, unit: Array) -> Regulated:
    A, B, E, C, D = (
        np.array([[float(x) for x in row] for row in M])
        for M in (exact.A, exact.B, exact.E, exact.C, exact.D)
    )
    return Regulated(A, B, E, unit[:, None] * C, unit[:, None] * D)


def _rate(A: Array) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max()) or 1.0


def _matrices(plant: Regulated, weights: Array) -> Iterator[Rationals]:
    """Yield P from the largest down."""
    rate = _rate(plant.A)
    for decay, share in MARGINS:
        try:
            P = plant.riccati(weights, decay * rate)
            if share:
                less = share * decay * rate * np.diag(np.maximum(np.diag(P), 0.0))
                P = plant.riccati(weights, decay * rate, less)
        except SolverError:
            continue
        yield [[Fraction(x) for x in row] for row in P.tolist()]


def _factor(plant: Regular, P: Rationals, allowed: Fraction | int) -> Fraction:
    """Return what the limits may be multiplied by, a little less than P proves."""
    E = np.array([[float(x) for x in row] for row in plant.E])
    least = float(np.trace(E.T @ np.array(P, dtype=float) @ E))
    if not (least > 0 and allowed > 0):
        return Fraction(0)
    return Fraction(float(np.sqrt(least / float(allowed))) * (1 - SHORT))


def _lifted(P: Rationals, T: Rationals) -> Rationals:
    """Return T'P T."""
    columns = list(zip(*T, strict=True))
    half = [[_dot(row, column) for column in columns] for row in P]
    return [[_dot(left, right) for right in zip(*half, strict=True)] for left in columns]


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def refusal(task: Task, reasons: Sequence[str]) -> NotProvedError:
    """Return why there is no design: refuted limits, a smallest set in conflict, or a reason."""
    label = method_label(task.method)
    conflict = _conflict(task)
    if conflict:
        refutation = _refuted(task, conflict)
        if refutation is not None:
            return NotProvedError(str(refutation), refutation=refutation)
        named = [str(p) if isinstance(p, Region) else limit_text(p) for p in conflict]
        return NotProvedError(
            f"not proved: {label} finds no law for these together, and one for any of them left "
            f"out: {'; '.join(named)}"
        )
    why = (
        reasons[0] if reasons else "a bound or the region was not proved of the law that was found"
    )
    named = [limit_text(s) for s in task.limits if s.at_most]
    return NotProvedError(
        f"not proved: {label}, {task.region}, {'; '.join(named) or 'no limits'}: {why}"
    )


def _refuted(task: Task, conflict: Sequence[Any]) -> Refutation | None:
    """Return the proof that no law keeps the limits in conflict, or a smallest set of all limits.

    What is in conflict for the search may have a part of the region in it, and some of the limits
    be in conflict without it.
    """
    if task.asked is None:
        return None
    plant, limits = task.asked
    own = [a for a, s in zip(limits, task.limits, strict=True) if any(s is p for p in conflict)]
    if len(own) == len(conflict) and (found := refute_limits(plant, own)) is not None:
        return found
    found = refute_limits(plant, limits)
    if found is not None:
        for each in found.specifications:
            fewer = [s for s in found.specifications if s is not each]
            found = refute_limits(plant, fewer) or found
    return found


def _conflict(task: Task) -> list[Any]:
    """Return a smallest set of limits and parts of the region that the search finds no law for."""
    if _feasible(task, task.limits, task.region):
        return []
    parts: list[Any] = [*task.limits, *task.region.parts]
    for own in list(parts):
        fewer = [p for p in parts if p is not own]
        if not _feasible(task, *_split(fewer)):
            parts = fewer
    return parts


def _split(parts: Sequence[Any]) -> tuple[tuple[Specification, ...], Region | None]:
    region: Region | None = None
    for part in parts:
        if isinstance(part, Region):
            region = part if region is None else region & part
    return tuple(p for p in parts if isinstance(p, Specification)), region


def _feasible(task: Task, limits: tuple[Specification, ...], region: Region | None) -> bool:
    try:
        replace(task, limits=limits).reached(region)
    except SolverError:
        return False
    return True
