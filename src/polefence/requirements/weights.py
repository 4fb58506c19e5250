"""Weightings behind signals: the larger plant in which a weighted signal is an output.

This is the one place where filters enlarge a plant. Nothing acts on their states, no law feeds them
back, and what is designed, driven and exported is the plant without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from operator import mul
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError
from polefence.law.laws import GainTable, Law, PolynomialGain, given_law
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import with_dynamics
from polefence.plant.outputs import Output, padded
from polefence.plant.system import Exact
from polefence.plant.weights import driven_through, seen_through
from polefence.proof.filters import Filter, Filters, states_of
from polefence.proof.matrices import Integers, Rationals, plus, transposed
from polefence.response.weighting import WD, WE, WF, WK, BandFilter, Stages, Weighting, in_series

if TYPE_CHECKING:
    from polefence.requirements.specification import Specification

WEIGHTS: Mapping[str, Weighting] = MappingProxyType({"Wk": WK, "Wd": WD, "We": WE, "Wf": WF})


@dataclass(frozen=True, eq=False)
class Behind:
    """A requirement without weights, of the plant with its filters, and the law of that plant.

    Attributes
    ----------
    plant : UncertainPlant
        Its last states are the filters', its last outputs what comes out of them.
    law : Law, GainTable or None
        That leaves the filters alone.
    specification : Specification
    """

    plant: UncertainPlant
    law: Any
    specification: Specification


def behind(plant: UncertainPlant, law: Any, specification: Specification) -> Behind:
    """Return the requirement on the plant with its filters, unchanged if it has none."""
    if any(specification.before):
        plant, law, specification = _driven(plant, law, specification)
    if not any(specification.filters):
        return Behind(plant, law, specification)
    larger, (requirement,) = with_weights(plant, (specification,))
    larger = specification.arriving(larger, plant.shape[0])
    return Behind(larger, wider(law, plant, larger), requirement)


def _driven(
    plant: UncertainPlant, law: Any, specification: Specification
) -> tuple[UncertainPlant, Any, Specification]:
    """Return the plant with the filters that a requirement has before disturbances."""
    T = plant.sample_time or Fraction(0)
    filters = tuple(one and one.in_z(T) for one in specification.before)
    labels = [f"before disturbance {i + 1}" for i in range(states_of(filters))]
    larger = driven_through(plant, filters, labels)
    outputs = [seen_through(y, plant, filters) for y in specification.outputs(plant)]
    wide = wider(law, plant, larger)
    if isinstance(law, PolynomialGain) and law.passes:
        measured = tuple(seen_through(y, plant, filters) for y in law.measured)
        wide = replace(wide, measured=measured)
    signal = outputs if len(outputs) > 1 else outputs[0]
    larger = replace(larger, driven_by=_driven_by(plant.shape[0], filters))
    return larger, wide, replace(specification, signal=signal)


def _driven_by(n: int, filters: Filters) -> tuple[tuple[int, int, Fraction], ...]:
    """Return the states of filters before disturbances: which, before which, how many times."""
    found = list[tuple[int, int, Fraction]]()
    for k, applied in enumerate(filters):
        for c in () if applied is None else applied.c[0]:
            found.append((n + len(found), k, c))
    return tuple(found)


def with_weights(
    plant: UncertainPlant, specifications: Sequence[Specification]
) -> tuple[UncertainPlant, tuple[Specification, ...]]:
    """Return the plant with the filters that specifications ask for, and those without weights.

    What comes out of a filter is an output of the larger plant, called "SIGNAL, WEIGHT": it goes
    along wherever that plant is enlarged further.

    Raises
    ------
    InputError
        If the plant has no such signal, or has one of the name that the weighted one would have.
    """
    made: dict[tuple[str, Stages | Shape], str] = {}
    bare, n = plant, plant.shape[0]
    for specification in specifications:
        for signal, weighting in _pairs(bare, specification):
            if weighting is not None and (signal.name, weighting) not in made:
                wide = padded(signal, plant.shape[0] - n, n)
                plant, made[signal.name, weighting] = _with_filter(plant, wide, weighting)
    without: list[Specification] = []
    more = plant.shape[0] - n
    for specification in specifications:
        pairs = _pairs(bare, specification)
        if pairs:
            specification = specification.filtered(
                [
                    padded(y, more, n) if weight is None else made[y.name, weight]
                    for y, weight in pairs
                ]
            )
        else:
            specification = specification.extended(n, more) if more else specification
        without.append(specification)
    return plant, tuple(without)


def filters_of(plant: UncertainPlant, specification: Specification) -> Filters:
    """Return the filter of each entry for the claim, empty where no entry has one."""
    filters = specification.filters
    if not any(filters):
        return ()
    return tuple(None if weight is None else filter_of(weight, plant.period) for weight in filters)


@dataclass(frozen=True)
class Shape:
    """A filter that is not one of the standard's.

    Attributes
    ----------
    filter : Filter
    in_z : bool
        Whether it is of samples, z(t + T) in the place of z'; else as a claim has it.
    """

    filter: Filter
    in_z: bool = field(default=False, kw_only=True)

    def at(self, T: Fraction) -> Filter:
        """Return the filter at a sample time, in its delta form; zero in continuous time.

        Raises
        ------
        InputError
            If it is of samples, and there are none.
        """
        if not self.in_z:
            return self.filter
        if not T:
            raise InputError(f"weight {self.name}: it is in z, and the plant in continuous time")
        own = self.filter
        a = [[(x - (i == j)) / T for j, x in enumerate(row)] for i, row in enumerate(own.a)]
        return replace(own, a=a, b=[[x / T for x in row] for row in own.b])

    def __hash__(self) -> int:
        return hash(self.filter.name)

    @property
    def name(self) -> str:
        """Its name."""
        return self.filter.name


def filter_of(weighting: Stages | Shape, T: Fraction) -> Filter:
    """Return a filter as a claim has it: at a sample time of a held signal, in its delta form.

    Parameters
    ----------
    T : Fraction
        The sample time [s]; zero in continuous time.
    """
    return weighting.at(T) if isinstance(weighting, Shape) else _standard(weighting, T)


def named(name: str) -> Stages | None:
    """Return the filter of a name, as claims have them; None where there is no such filter."""
    try:
        return in_series(parts(name))
    except InputError:
        return None


def parts(name: str) -> list[Weighting | BandFilter]:
    """Return the filters that one of a name has in series.

    Raises
    ------
    InputError
        If there is no such filter.
    """
    found = [WEIGHTS.get(part) or BandFilter.named(part) for part in name.split(", ")]
    known = [part for part in found if part is not None]
    if len(known) < len(found):
        raise InputError(f"there is no filter {name!r}")
    return known


@lru_cache(maxsize=64)
def _standard(weighting: Stages, T: Fraction) -> Filter:
    A, B, C, _ = weighting.state_space()  # the low-pass leaves no direct way through
    if not T:
        return Filter(_exact(A), _exact(B), _exact(C), weighting.name)
    rows = _held(_exact(A), _exact(B), T)
    a = [[(x - (i == j)) / T for j, x in enumerate(row[:-1])] for i, row in enumerate(rows)]
    return Filter(a, [[row[-1] / T] for row in rows], _exact(C), weighting.name)


def _held(a: Rationals, b: Rationals, T: Fraction) -> Rationals:
    """Return [Phi, Gamma] of a filter whose one input is held for T, rounded to doubles.

    In whole numbers, for files claim these numbers: floats differ in last bits by the machine.
    """
    M = [[T * x for x in (*row, *row_b)] for row, row_b in zip(a, b, strict=True)]
    M.append([Fraction(0)] * len(M[0]))
    norm, halvings = max(sum(map(abs, row), Fraction(0)) for row in M), 0
    while norm > Fraction(1, 2):
        norm, halvings = norm / 2, halvings + 1
    unit = 1 << 192
    X = [[round(x * unit / 2**halvings) for x in row] for row in M]
    term = total = [[unit * (i == j) for j in range(len(M))] for i in range(len(M))]
    for k in range(1, 42):  # of a norm of 1/2: (1/2)^42 / 42! is below 2^-192
        term = _shortened(term, X, unit * k)
        total = plus(total, term)
    for _ in range(halvings):
        total = _shortened(total, total, unit)
    return [[Fraction(x / unit) for x in row] for row in total[:-1]]


def _shortened(P: Integers, Q: Integers, unit: int) -> Integers:
    """Return the product of two matrices over a number."""
    columns = transposed(Q)
    return [[sum(map(mul, row, column)) // unit for column in columns] for row in P]


def _with_filter(
    plant: UncertainPlant, signal: Output, weighting: Stages
) -> tuple[UncertainPlant, str]:
    """Return the plant with a filter on a signal, and the name of what comes out of it."""
    form = filter_of(weighting, plant.period)
    in_z = form.in_z(plant.sample_time or Fraction(0))  # the plant is not in its delta form
    a, b = in_z.a, in_z.b
    label = f"{signal.name}, {weighting.name}"
    if label in [known.name for known in plant.signals]:
        raise InputError(f"{plant.name} has a signal {label!r} already; rename it")
    labels = [f"{label} state {i + 1}" for i in range(form.states)]
    larger = with_dynamics(plant, (signal,), _tuples(a), _tuples(b), labels) if a else plant
    straight = [[[form.d * x for x in row] for row in rows] for rows in signal.exact(plant)]
    C, D, F = straight
    F = F if plant.disturbance_count else []
    weighted = Output(label, signal.unit, C=[[*row, *form.c[0]] for row in C], D=D, F=F)
    return replace(larger, outputs=(*larger.outputs, weighted)), label


def _pairs(plant: UncertainPlant, specification: Specification) -> list[tuple[Output, Any]]:
    """Return the outputs with their filters, nothing where none has one."""
    filters = specification.filters
    return list(zip(specification.outputs(plant), filters, strict=True)) if any(filters) else []


def wider(law: Any, plant: UncertainPlant, larger: UncertainPlant) -> Any:
    """Return a law of a plant as one of a larger plant, whose further states are not fed back.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
    """
    more = larger.shape[0] - plant.shape[0]
    if law is None or not more:
        return law
    if isinstance(law, GainTable):
        return law.with_states(more)
    given = law.as_law() if hasattr(law, "as_law") else law
    checked = given_law(plant, given)
    # a scheduled law's alpha stays where it lives
    return (given if isinstance(given, Law) else checked).with_states(more)


def _exact(matrix: Any) -> Rationals:
    return [[Fraction(float(x)) for x in row] for row in np.atleast_2d(matrix)]


def _tuples(matrix: Any) -> Exact:
    return tuple(map(tuple, matrix))
