"""The coefficients of a black box: polynomials in the parameters, in a form that has no more.

Pseudo-canonical (Ljung, System Identification, appendix 4A): each output begins a chain of
integrators, the last row of each chain is free, and so is B; an output without a chain has a free
row of C instead. That is n (p + m) numbers for n states, the least that there may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from polefence.data.local import Model, Signals
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array

SINGULAR = 1e12  # condition of the states of a form


@dataclass(frozen=True)
class Basis:
    """Monomials of the parameters' scheduling variables, each from -1 to 1 over its range."""

    parameters: tuple[Parameter, ...]
    degree: int

    @property
    def powers(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the parameters in each monomial: () of one, (0, 0) of the first's square."""
        count = range(len(self.parameters))
        return tuple(
            powers
            for degree in range(self.degree + 1)
            for powers in combinations_with_replacement(count, degree)
        )

    def at(self, values: Mapping[str, float]) -> Array:
        """Return the monomials at values of the parameters."""
        z = [self.share(p, values[p.name]) for p in self.parameters]
        return np.array([np.prod([z[k] for k in powers]) for powers in self.powers])

    @staticmethod
    def ends(p: Parameter) -> tuple[float, float]:
        """Return the middle and half the width of the range of its scheduling variable."""
        low, high = sorted(float(p.scheduling(end)) for end in (p.low, p.high))
        return (low + high) / 2, (high - low) / 2

    def share(self, p: Parameter, value: float) -> float:
        """Return where a value is in its range, from -1 to 1."""
        middle, half = self.ends(p)
        return ((1 / value if p.inverted else value) - middle) / half


@dataclass(frozen=True)
class Shape:
    """Which entries are free.

    Attributes
    ----------
    signals : Signals
    chains : tuple of int
        How many states each output has a chain of.
    rate : float
        Of all integrators [1/s]: states are of like size.
    """

    signals: Signals
    chains: tuple[int, ...]
    rate: float

    @property
    def firsts(self) -> tuple[int, ...]:
        """The state that each chain begins with."""
        return tuple(int(k) for k in np.cumsum([0, *self.chains[:-1]]))

    @property
    def places(self) -> tuple[tuple[str, int, int], ...]:
        """The free entries: matrix, row and column."""
        return tuple(self._places())

    def _places(self) -> Iterator[tuple[str, int, int]]:
        n, m = self.signals.order, len(self.signals.inputs)
        for first, length in zip(self.firsts, self.chains, strict=True):
            if length:
                yield from (("A", first + length - 1, k) for k in range(n))
        yield from (("B", i, j) for i in range(n) for j in range(m))
        for i, length in enumerate(self.chains):
            if not length:
                yield from (("C", i, k) for k in range(n))
            yield from (("D", i, int(j)) for j in np.flatnonzero(self.signals.direct[i]))

    @property
    def fixed(self) -> dict[str, Array]:
        """The matrices without what is free."""
        n, m, p = self.signals.order, len(self.signals.inputs), len(self.signals.outputs)
        A, C = np.zeros((n, n)), np.zeros((p, n))
        for i, (first, length) in enumerate(zip(self.firsts, self.chains, strict=True)):
            for k in range(first, first + length - 1):
                A[k, k + 1] = self.rate
            if length:
                C[i, first] = 1
        return {"A": A, "B": np.zeros((n, m)), "C": C, "D": np.zeros((p, m))}

    def model(self, entries: Array) -> Model:
        """Return the model with these values of the free entries."""
        matrices = self.fixed
        for (letter, i, j), value in zip(self.places, entries, strict=True):
            matrices[letter][i, j] = value
        return Model(**matrices)

    def entries(self, model: Model) -> Array | None:
        """Return the free entries of a model in this form; None where it has none."""
        rows = list[Array]()
        for i, length in enumerate(self.chains):
            row = model.C[i]
            for _ in range(length):
                rows.append(row)
                row = row @ model.A / self.rate
        T = np.array(rows)
        if not np.isfinite(T).all() or np.linalg.cond(T) > SINGULAR:
            return None
        inverse = np.linalg.inv(T)
        whole = {
            "A": (T @ model.A @ inverse).real,
            "B": (T @ model.B).real,
            "C": (model.C @ inverse).real,
            "D": model.D,
        }
        return np.array([whole[letter][i, j] for letter, i, j in self.places])


def chains_of(order: int, outputs: int) -> Iterator[tuple[int, ...]]:
    """Yield chains that are tried: even ones, and one of all states for each output."""
    share, rest = divmod(order, outputs)
    even = tuple(share + (i < rest) for i in range(outputs))
    yield even
    for i in range(outputs):
        alone = tuple(order * (i == k) for k in range(outputs))
        if alone != even:
            yield alone


def spread(basis: Basis, points: Sequence[Mapping[str, float]], entries: Array) -> Array:
    """Return the coefficients (entries, monomials) nearest to entries (points, entries)."""
    M = np.array([basis.at(point) for point in points])
    return np.asarray(np.linalg.lstsq(M, entries, rcond=None)[0].T)
