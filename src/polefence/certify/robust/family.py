"""A plant and a law with the ranges of some parameters grown about their centres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np

from polefence.base.errors import InputError, PlantError
from polefence.law.law import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.grown import Ends, at_ends, grown, resized, weights_of_ends
from polefence.plant.outputs import Output, padded, with_inputs
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array, System
from polefence.proof.matrices import Rationals
from polefence.proof.work import FormatError
from polefence.requirements.disk_margin import DiskMargin
from polefence.requirements.specification import Specification
from polefence.response.samples import sampled

CAP = Fraction(1000)  # the largest factor that is asked about
NEAR_END = Fraction(1, 10**4)  # share of a factor by which it stays before zero
DIGITS = 7  # of a factor


@dataclass(frozen=True, eq=False)
class Family:
    """A plant and a law on ranges that are some factors times as wide."""

    plant: UncertainPlant
    law: Law
    factors: Mapping[str, Fraction]

    def values(self, limit: Specification, alpha: Array) -> Array:
        """Return what a limit is about at points alpha, in floats: 1 over it of a margin.

        Of several loops at most: they are weighed once for the family.
        """
        if not is_disk(limit):
            return limit.values(self.plant, self.law, alpha)
        if limit.title not in self._posed:  # of several loops that takes as long as 1000 points
            self._posed[limit.title] = limit.posed(self.plant, self.law)
        plant, law, posed = self._posed[limit.title]
        return posed.values(plant, law, alpha)

    @cached_property
    def _posed(self) -> dict[str, tuple[UncertainPlant, Law, Specification]]:
        return {}


@dataclass(frozen=True, eq=False)
class Growth:
    """A plant and a law whose ranges grow.

    Attributes
    ----------
    plant : UncertainPlant
        With its own ranges.
    law : Law
    """

    plant: UncertainPlant
    law: Law

    def __post_init__(self) -> None:
        """Refuse what cannot grow.

        Raises
        ------
        InputError
            Saying why not.
        """
        plant, law = self.plant, self.law
        if not plant.parameters and len(plant.vertices) > 1:
            raise InputError(
                f"{plant.name} is given by vertices, without parameters whose ranges could grow; "
                "give [parameter.NAME] tables"
            )
        if plant.parameters and not self.names:
            raise InputError(f"{plant.name} has no parameter but those of its dead time")
        if plant.sampling is None and plant.remainder is not None and plant.functions is None:
            raise InputError(f"{plant.name}: what its samples are of is not known; give its spec")
        of_box = law.in_parts or (law.W is not None and set(law.domain.sizes) == {2})
        if plant.parameters and not of_box:
            raise InputError(
                "the law is one in the weights of the vertices, which says nothing beyond the "
                "ranges; give one that is a polynomial of the parameters on their box"
            )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters that grow: all but what stands for a dead time."""
        late = self.plant.dead_time
        out = set[str]() if late is None else {self.plant.parameters[late[0]].name, late[1].time}
        return tuple(p.name for p in self.plant.parameters if p.name not in out)

    @cached_property
    def _known(self) -> dict[tuple[tuple[str, Fraction], ...], Family]:
        return {}

    def parameter(self, name: str) -> Parameter:
        """Return a parameter with its own range."""
        return next(p for p in self.plant.parameters if p.name == name)

    def ends(self, factors: Mapping[str, Fraction]) -> Ends:
        """Return the ranges of the parameters that are so many times as wide."""
        found = dict[str, tuple[Fraction, Fraction]]()
        for name, factor in factors.items():
            if factor != 1:
                centre, half = centre_of(self.parameter(name))
                found[name] = (centre - factor * half, centre + factor * half)
        return found

    def at(self, factors: Mapping[str, Fraction]) -> Family:
        """Return the family that is so many times as wide in some parameters.

        Raises
        ------
        InputError
            If the plant, or the law, does not exist there.
        """
        key = tuple(sorted(factors.items()))
        if key not in self._known:
            ends = self.ends(factors)
            if not ends:
                self._known[key] = Family(self.plant, self.law, factors)
            else:
                try:
                    plant = _grown(self.plant, ends)
                    law = self.law.inside(
                        plant, *weights_of_ends(self.plant.parameters, plant.parameters)
                    )
                except FormatError as error:
                    raise PlantError(str(error)) from error
                self._known[key] = Family(plant, law, factors)
        return self._known[key]

    def end(self, names: Sequence[str]) -> tuple[Fraction, str]:
        """Return the factor at which a parameter reaches zero that must not, and a sentence.

        That of `CAP`, and nothing, where none does before.
        """
        least, said = CAP, ""
        for name in names:
            p = self.parameter(name)
            centre, half = centre_of(p)
            if p.inverted and abs(centre) / half < least:
                least = abs(centre) / half
                said = f"until {name} = 0, where the plant does not exist"
        return least, said

    def values(
        self, factors: Mapping[str, Fraction], shares: Mapping[str, Fraction]
    ) -> dict[str, Fraction]:
        """Return values of the parameters at shares of the half-widths, from -1 to 1."""
        found = dict[str, Fraction]()
        for p in self.plant.parameters:
            centre, half = centre_of(p)
            found[p.name] = centre + factors.get(p.name, Fraction(1)) * half * shares[p.name]
        return found


def is_disk(limit: Specification) -> TypeGuard[DiskMargin]:
    """Whether a limit is a disk margin, or of unmodelled dynamics."""
    return isinstance(limit, DiskMargin) and limit.by_gain


def centre_of(parameter: Parameter) -> tuple[Fraction, Fraction]:
    """Return the centre and the half-width of a range."""
    return (parameter.low + parameter.high) / 2, (parameter.high - parameter.low) / 2


def short(factor: Fraction | float, up: bool) -> Fraction:
    """Return a factor in `DIGITS` digits, up or down."""
    exact = Fraction(factor)
    if not exact:
        return exact
    places = DIGITS - 1
    size = exact
    while size >= 10:
        size, places = size / 10, places - 1
    while size < 1:
        size, places = size * 10, places + 1
    unit = Fraction(10) ** -places
    return (-((-exact) // unit) if up else exact // unit) * unit


def _grown(plant: UncertainPlant, ends: Ends) -> UncertainPlant:
    """Return the plant on other ranges; one at samples is sampled afresh."""
    if plant.sampling is None:
        return grown(plant, ends)
    origin = plant.sampling
    settings: dict[str, Any] = {}
    if origin.clock is not None:
        jitter = 1 - origin.clock.least
        lost = origin.clock.most / (1 + jitter) - 1
        settings = {"jitter": jitter, "lost": int(lost)}
    fresh = sampled(grown(origin.plant, ends), plant.period, origin.late, **settings)
    return _beside(plant, fresh, ends)


def _beside(plant: UncertainPlant, fresh: UncertainPlant, ends: Ends) -> UncertainPlant:
    """Return fresh samples with what a plant has beside its own: the states of a law, say."""
    if fresh.shape == plant.shape and fresh.outputs == plant.outputs:
        return fresh
    parameters = resized(plant.parameters, ends)
    low, high = weights_of_ends(plant.parameters, parameters)
    (n, m), (n0, m0), q = plant.shape, fresh.shape, plant.disturbance_count
    if plant.remainder is not None and any(map(any, plant.remainder.entries[n0:])):
        raise PlantError(
            f"{plant.name}: states beside its samples follow functions of the parameters, which "
            "are not known beyond the ranges"
        )
    kept = {
        key: at_ends([list(map(list, getattr(v, key))) for v in plant.vertices], low, high)
        for key in ("exact_A", "exact_B", *(("exact_E",) if q else ()))
    }
    vertices = []
    for k, vertex in enumerate(fresh.vertices):
        A, B = (kept[key][k] for key in ("exact_A", "exact_B"))
        _put(A, vertex.exact_A)
        _put(B, vertex.exact_B)
        E: Rationals | None = kept["exact_E"][k] if q else None
        if E is not None and vertex.exact_E is not None:
            _put(E, vertex.exact_E)
        driven = None if E is None else tuple(map(tuple, E))
        vertices.append(System(tuple(map(tuple, A)), tuple(map(tuple, B)), driven, vertex.name))
    outputs = tuple(_on_corners(plant, y, low, high, fresh) for y in plant.outputs)
    return replace(
        plant,
        vertices=tuple(vertices),
        parameters=parameters,
        outputs=outputs,
        remainder=fresh.remainder and fresh.remainder.padded(n0, m0, n - n0, m - m0),
        sampling=fresh.sampling,
        functions=fresh.functions,
        car=None,
    )


def _put(matrix: Rationals, block: Any) -> None:
    for row, values in zip(matrix, block, strict=False):
        row[: len(values)] = values


def _on_corners(
    plant: UncertainPlant,
    output: Output,
    low: tuple[Fraction, ...],
    high: tuple[Fraction, ...],
    fresh: UncertainPlant,
) -> Output:
    """Return an output on other ranges: that of the samples where it is one of theirs."""
    if output.near is not None:
        own = next((y for y in fresh.outputs if y.name == output.name), None)
        if own is None:
            raise PlantError(f"output {output.name!r} is a function of the parameters")
        (n, m), (n0, m0) = plant.shape, fresh.shape
        return with_inputs(padded(own, n - n0, n0), (n, m0), m - m0)
    rows = [at_ends([[list(row)] for row in M], low, high) for M in output.exact(plant)]
    C, D, F = (tuple(tuple(row) for (row,) in M) for M in rows)
    return replace(output, C=C, D=D, F=F if plant.disturbance_count else ())


def loops_of(plant: UncertainPlant, law: Law, alpha: Array) -> Array:
    """Return closed loops at points alpha (count, N)."""
    A, B = plant.at(alpha)
    return np.asarray(A + B @ law.over(plant, alpha))
