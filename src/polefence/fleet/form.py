"""The form of a file's law, against the structure or the method that was asked for.

A law is of a structure where it lies within it: it may measure less, depend on fewer parameters,
or be of a lower degree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import combinations, product
from math import inf, prod

from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import states
from polefence.proof.document import Document
from polefence.proof.laws import Law
from polefence.proof.matrices import identity
from polefence.proof.short import Short
from polefence.search.tune.tuner import KEPT

FINE = tuple(Fraction(k, 4) for k in range(-4, 5))  # of a coordinate in [-1, 1]

Rows = tuple[tuple[Fraction, ...], ...]  # a signal's, one a vertex
Terms = dict[tuple[int, ...], Fraction]  # of an entry of a law, by exponent


@dataclass(frozen=True)
class Form(Short):
    """What a law may be.

    Attributes
    ----------
    plant : UncertainPlant
        Of which the law is a gain, the law's own states among its states.
    structure : Structure
        Of that gain.
    rational : bool
        Whether the law may be a quotient Z(alpha) W(alpha)^-1 too, as methods give.
    """

    plant: UncertainPlant
    structure: Structure
    rational: bool = False

    def fault(self, document: Document) -> str:
        """Return how a file's law leaves this form; empty if it does not."""
        law = document.law
        if not isinstance(law, Law):
            return "its file has no law of that form"
        if law.scheduled:
            if not self.rational:
                return "its law is a quotient, not of the structure that was asked for"
            return self._of_degree(law.degree)
        gain = _Gain.of(law, self.plant)
        return self._of_parameters(gain) or self._of_signals(gain)

    def _of_degree(self, degree: int) -> str:
        several = len(self.plant.vertices) > 1
        most = 0 if self.structure.schedule == () else self.structure.degree
        if degree <= most or not several:
            return ""
        return f"its law is of degree {degree}, not of {most} at most"

    def _of_parameters(self, gain: _Gain) -> str:
        """Return the fault of a law that depends on another parameter or has a higher degree."""
        chosen = self.structure.schedule
        others = () if chosen is None else [name for name in gain.depends if name not in chosen]
        if others and self.plant.parameters:
            return f"its law depends on {', '.join(others)}"
        return self._of_degree(gain.degree)

    def _of_signals(self, gain: _Gain) -> str:
        """Return the fault of a law that measures other signals, or of its gains."""
        asked, structure = self.structure.outputs(self.plant), self.structure
        rows = [tuple(map(tuple, signal.exact(self.plant)[0])) for signal in asked]
        free = structure == Structure(schedule=structure.schedule, degree=structure.degree)
        entries = dict[tuple[int, int], Terms]()
        places = dict[int, tuple[int, ...]]()
        for j, (name, C) in enumerate(zip(gain.names, gain.rows, strict=True)):
            column = {i: terms for i in range(gain.inputs) if (terms := gain.entry(i, j))}
            same = tuple(k for k, other in enumerate(rows) if other == C)
            if not column or (free and len(set(C)) == 1):
                continue
            if not same:
                return f"its law measures {name}"
            first = same[0]
            places[first] = same
            for i, terms in column.items():
                entries[i, first] = _sum(entries.get((i, first), {}), terms)
        return self._of_entries(gain, entries, places)

    def _of_entries(
        self,
        gain: _Gain,
        entries: dict[tuple[int, int], Terms],
        places: dict[int, tuple[int, ...]],
    ) -> str:
        """Return the fault of an entry that is too large or off the pattern.

        Of signals that are one and the same the gains are known by their sum alone.
        """
        most, pattern = self.structure.largest(self.plant).tolist(), self.structure.pattern
        for (i, first), terms in entries.items():
            same = places[first]
            limit = sum(most[i][k] for k in same)
            if limit < inf and gain.reaches(terms, Fraction(limit) * (1 + Fraction(KEPT))):
                return f"a gain of its law exceeds {limit:g}"
            if pattern is not None and all(pattern[i][k] == "0" for k in same):
                return "its law is not of the pattern that was asked for"
        several = {k for same in places.values() if len(same) > 1 for k in same}
        known = dict[str, Terms]()
        for i, row in enumerate(pattern or ()):
            for k, label in enumerate(row):
                terms = entries.get((i, k), {})
                if label != "0" and k not in several and known.setdefault(label, terms) != terms:
                    return "its law is not of the pattern that was asked for"
        return ""


@dataclass(frozen=True)
class _Gain:
    """A law without W: gains of signals, a term an exponent.

    ``alpha`` is whether exponents are of the vertices' weights, not of the parameters.
    """

    terms: dict[tuple[int, ...], list[list[Fraction]]]
    names: tuple[str, ...]
    rows: tuple[Rows, ...]
    inputs: int
    alpha: bool
    parameters: tuple[str, ...] = field(default=())

    @classmethod
    def of(cls, law: Law, plant: UncertainPlant) -> _Gain:
        parameters, count = tuple(p.name for p in plant.parameters), len(plant.vertices)
        gains = law.K or []
        powers = law.powers or ((0,) * (len(parameters) or count),)
        terms = dict(zip(powers, gains, strict=True))
        alpha = not parameters or len(powers[0]) != len(parameters)
        names = law.measured or tuple(state.name for state in states(plant))
        C = law.C or (identity(plant.shape[0]),) * count
        rows = tuple(
            tuple(tuple(map(Fraction, vertex[j])) for vertex in C) for j in range(len(names))
        )
        return cls(terms, names, rows, len(gains[0]), alpha, parameters)

    def entry(self, i: int, j: int) -> Terms:
        return {e: K[i][j] for e, K in self.terms.items() if K[i][j]}

    @property
    def _used(self) -> list[tuple[int, ...]]:
        return [e for e, K in self.terms.items() if any(map(any, K))]

    @property
    def depends(self) -> tuple[str, ...]:
        """Parameters that it depends on."""
        if self.alpha:
            return self.parameters if self.degree else ()
        return tuple(
            name for k, name in enumerate(self.parameters) if any(e[k] for e in self._used)
        )

    @property
    def degree(self) -> int:
        """Total degree in the parameters' coordinates, in alpha where there are none."""
        degree = max(map(sum, self._used), default=0)
        return degree * len(self.parameters) if self.alpha and self.parameters else degree

    def reaches(self, terms: Terms, most: Fraction) -> bool:
        """Whether an entry is larger: at corners, which is everywhere where it is multi-affine."""
        return any(
            abs(sum((x * _power(c, e) for e, x in terms.items()), start=Fraction(0))) > most
            for c in self._points(list(terms))
        )

    def _points(self, powers: list[tuple[int, ...]]) -> Iterator[tuple[Fraction, ...]]:
        count = len(powers[0])
        if self.alpha:
            corners = [tuple(map(Fraction, row)) for row in identity(count)]
            yield from corners
            pairs = combinations(corners, 2) if max(map(sum, powers)) > 1 else ()
            yield from (tuple((a + b) / 2 for a, b in zip(*two, strict=True)) for two in pairs)
            return
        ends = FINE[:: len(FINE) - 1]
        curved = [max(e[k] for e in powers) > 1 for k in range(count)]
        # the finest of these with at most 10,000 points
        for grid in (FINE, FINE[::4], ends):
            axes = [grid if curve else ends for curve in curved]
            if prod(map(len, axes)) <= 10_000 or grid is ends:
                yield from product(*axes)
                return


def _power(c: tuple[Fraction, ...], e: tuple[int, ...]) -> Fraction:
    return prod(map(pow, c, e), start=Fraction(1))


def _sum(one: Terms, other: Terms) -> Terms:
    total = {e: one.get(e, Fraction(0)) + other.get(e, Fraction(0)) for e in {*one, *other}}
    return {e: x for e, x in total.items() if x}
