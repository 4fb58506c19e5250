"""Free numbers of a law: from numbers to gains at points, and slopes the way back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.law.laws import FixedGain, Law, PolynomialGain
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import as_read, law_states, own_states
from polefence.plant.points import inside
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.plant import WITHOUT
from polefence.requirements.slopes import Acting, Channel
from polefence.search.tune.coordinates import coordinates

FEW = 40  # points at which laws are compared, and starts fitted


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The free numbers theta of a structure, in units that are typical of the plant.

    Attributes
    ----------
    plant : UncertainPlant
    structure : Structure
    states, inputs : (n,), (m,) arrays
        Typical sizes.
    """

    plant: UncertainPlant
    structure: Structure
    states: Array
    inputs: Array

    @cached_property
    def rows(self) -> Array:
        """C of what is measured at the vertices, (N, r, n) or (1, r, n), states in their sizes."""
        return self.structure.rows(self.plant) * self.states

    @cached_property
    def passing_rows(self) -> Array | None:
        """F of what is measured, as rows of C; None where no disturbance passes into it."""
        return self.structure.passing_rows(self.plant)

    @cached_property
    def through(self) -> Array | None:
        """D of what is measured without inputs, as rows of C; None where there is none such."""
        measured = [signal.name for signal in self.structure.outputs(self.plant)]
        if not any(name.endswith(WITHOUT) for name in measured):
            return None
        wholes = [self.plant.signal(name.removesuffix(WITHOUT)) for name in measured]
        return np.stack([whole.arrays(self.plant)[1] for whole in wholes], axis=1)

    def read(self, name: str) -> int:
        """Return the number of what is measured by that name, behind its sensor or not.

        Raises
        ------
        InputError
            If it is not measured.
        """
        names = [signal.name for signal in self.structure.outputs(self.plant)]
        for alias in as_read(name):
            if alias in names:
                return names.index(alias)
        raise InputError(
            f"no loop at {name!r}: it is no input, and the law does not measure it; "
            f"{suggest(name, names)}"
        )

    @cached_property
    def signals(self) -> Array:
        """Typical sizes of what is measured, (r,)."""
        sizes = np.sqrt((self.rows**2).sum(axis=2)).max(axis=0)
        return np.asarray(np.where(sizes > 0, sizes, 1.0))

    @cached_property
    def blank(self) -> PolynomialGain:
        """The law of zeros."""
        return self._law(np.zeros(self.size))

    @cached_property
    def pattern(self) -> Array:
        """What one of each number adds to each entry of K, (m r, numbers)."""
        free = self.structure.free(self.plant).ravel()
        entry = (self.inputs[:, None] / self.signals).ravel()
        units = np.zeros((len(free), int(free.max()) + 1))
        for k in range(units.shape[1]):
            units[free == k, k] = np.exp(np.log(entry[free == k]).mean())
        return units

    @cached_property
    def largest(self) -> Array:
        """What the magnitude of each entry of K may be, (m, r)."""
        return self.structure.largest(self.plant)

    @cached_property
    def terms(self) -> int:
        """Number of the law's terms."""
        return len(self.structure.powers(self.plant))

    @cached_property
    def order(self) -> int:
        """Number of the law's own states: the last of what is measured, their rates last inputs."""
        count = own_states(self.plant)
        if not count or self.structure.measured is None:
            return count
        return count if self.structure.measured[-count:] == law_states(count) else 0

    def balanced(self, theta: Array) -> Array:
        """Return the same law with its own states in coordinates in which its gain is least.

        There numbers of a law are of one size, and so are the steps that a search may take.
        """
        k, count = self.order, len(self.plant.vertices)
        if not k:
            return theta
        domain = Domain.of("box" if self.plant.parameters else "simplex", count)
        terms = self.blank.terms(domain.alpha(inside(domain, FEW)))
        sizes = self.inputs.copy()  # rates of its states of one size for all: they turn together
        sizes[-k:] = self.signals[-k:] * np.exp(np.log(sizes[-k:] / self.signals[-k:]).mean())
        weight = self.signals / sizes[:, None]
        coefficients = self.coefficients(theta) * weight
        T = coordinates(np.tensordot(terms, coefficients, 1), k)
        right, left = np.eye(len(self.signals)), np.eye(len(self.inputs))
        right[-k:, -k:], left[-k:, -k:] = T, np.linalg.inv(T)
        other = (left @ coefficients @ right / weight).reshape(self.terms, -1)
        return np.asarray(np.linalg.lstsq(self.pattern, other.T, rcond=None)[0].T.ravel())

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return self.terms * int(self.pattern.shape[1])

    def coefficients(self, theta: Array) -> Array:
        """Return the gains of the terms, (terms, m, r)."""
        flat = theta.reshape(self.terms, -1) @ self.pattern.T
        return np.asarray(flat.reshape(self.terms, len(self.inputs), len(self.signals)))

    def _law(self, theta: Array) -> PolynomialGain:
        return self.structure.law(self.plant, self.coefficients(theta))

    def law(self, theta: Array) -> Law:
        """Return the law of these numbers: one gain of plain states as a `FixedGain`."""
        law = self._law(theta)
        rows = law.C[0]
        plain = np.all(np.isin(rows, (0, 1))) and np.all(rows.sum(axis=1) == 1)
        plain_states = law.constant and plain and not law.passes
        return FixedGain(law.gains[0] @ rows) if plain_states else law

    def at(self, alpha: Array) -> At:
        """Return what these numbers are at points alpha (count, N)."""

        def rows_at(rows: Array) -> Array:
            weights = alpha if len(rows) > 1 else np.ones((len(alpha), 1))
            return np.tensordot(weights, rows, 1)

        F, D = (
            None if rows is None else rows_at(rows) for rows in (self.passing_rows, self.through)
        )
        return At(self, self.blank.terms(alpha), rows_at(self.rows), F, D)


@dataclass(frozen=True, eq=False)
class At:
    """The unknowns at points: gains and their slopes.

    Attributes
    ----------
    unknowns : Unknowns
    terms : (count, terms) array
    C : (count, r, n) array
        Of states in their sizes.
    F : (count, r, q) array, optional
        Where disturbances pass into what is measured.
    through : (count, r, m) array, optional
        What inputs pass into signals that are measured without them.
    """

    unknowns: Unknowns
    terms: Array
    C: Array
    F: Array | None = None
    through: Array | None = None

    def __getitem__(self, some: Any) -> At:
        F, D = (None if M is None else M[some] for M in (self.F, self.through))
        return At(self.unknowns, self.terms[some], self.C[some], F, D)

    def seen(self, reads: Sequence[str | int | Acting] = ()) -> tuple[Array, Array | None]:
        """Return C and F of what is measured; F is None where no disturbance passes.

        Parameters
        ----------
        reads : sequence of str, int or Acting, optional
            Of opened loops: what disturbances are, those of the plant's own among them.
        """
        if not reads:
            return self.C, self.F
        F = np.zeros((*self.C.shape[:2], len(reads)))
        for k, name in enumerate(reads):
            if isinstance(name, str):
                F[:, self.unknowns.read(name), k] = 1.0
            elif isinstance(name, Acting):
                F[:, :, k] = 0.0 if self.F is None else self.F[:, :, name.number]
            elif self.through is not None:
                F[:, :, k] = self.through[:, :, name]
        return self.C, F if np.any(F) else None

    def opened(self, channel: Channel) -> Channel:
        """Return a channel of loops with what the law's signals are there among what is shown."""
        C, D, F = (getattr(channel, key).copy() for key in "CDF")
        for k, name in enumerate(channel.reads):
            if isinstance(name, str):
                j = self.unknowns.read(name)
                C[:, k] = self.C[:, j]
                if self.through is not None:
                    D[:, k] = self.through[:, j]
                    for i, other in enumerate(channel.reads):
                        if isinstance(other, int):
                            F[:, k, i] = self.through[:, j, other]
        return replace(channel, C=C, D=D, F=F)

    def gains(self, theta: Array) -> Array:
        """Return K of what is measured, (count, m, r)."""
        return self.gains_of([theta])

    def gains_of(self, thetas: Sequence[Array]) -> Array:
        """Return K of what is measured of several laws, one after the other, (laws count, m, r)."""
        unknowns = self.unknowns
        flat = np.stack(thetas).reshape(len(thetas), unknowns.terms, -1) @ unknowns.pattern.T
        K = self.terms @ flat
        return np.asarray(K.reshape(-1, len(unknowns.inputs), len(unknowns.signals)))

    def of(self, law: Law, alpha: Array) -> Array:
        """Return the gain that a law has of what is measured, (count, m, r)."""
        own = [signal.name for signal in self.unknowns.blank.measured]
        if isinstance(law, PolynomialGain) and [y.name for y in law.measured] == own:
            return np.asarray(np.tensordot(law.terms(alpha), law.gains, 1))
        K = np.asarray(law.gain(alpha)) * self.unknowns.states
        pairs = zip(self.C, K, strict=True)
        return np.stack([np.linalg.lstsq(c.T, k.T, rcond=None)[0].T for c, k in pairs])

    def slopes(self, points: Any, dK: Array) -> Array:
        """Return slopes with respect to theta (rows, size) from those with respect to K."""
        flat = dK.reshape(len(dK), -1) @ self.unknowns.pattern
        return np.asarray((self.terms[points][:, :, None] * flat[:, None, :]).reshape(len(dK), -1))

    def nearest(self, laws: Sequence[Array], weights: Array) -> list[Array]:
        """Return of laws the theta whose gains are nearest to their gains of all states.

        Parameters
        ----------
        laws : sequence of (count, m, n) array
            Of states in their sizes.
        weights : (n, n) array
            The distance is that of the rows of K times this.
        """
        if not laws:
            return []
        size = self.unknowns.size
        gains = [self.gains(row) @ self.C @ weights for row in np.eye(size)]
        rows = np.stack(gains, axis=-1) / self.unknowns.inputs[:, None, None]
        right = [(K @ weights / self.unknowns.inputs[:, None]).ravel() for K in laws]
        rows = rows.reshape(-1, size)
        return list(np.linalg.lstsq(rows, np.stack(right, axis=1), rcond=1e-9)[0].T.copy())
