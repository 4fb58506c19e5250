"""Peak of a signal from initial states, or after impulses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Self

import numpy as np

from polefence.base.errors import InputError, SpecError
from polefence.design.requirements.specification import (
    Row,
    Specification,
    disturbance,
    is_number,
    number,
)
from polefence.lmi.conditions import performance as conditions
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.response.closed import close
from polefence.response.grid import MOST_CHOSEN
from polefence.response.linear import simulate
from polefence.response.stationary import STABLE, stationary

# Time followed, of the slowest pole's time constant; step, of the fastest's.
FOLLOWED, STEP = 5.0, 0.25
GROUP = 2_000_000  # samples at once


@dataclass(frozen=True)
class InitialPeak(Specification):
    """The largest value of a signal from given initial states, or after impulses.

    Attributes
    ----------
    points : tuple of tuple of float
        Initial states; with them their convex hull and their negatives.
    impulse : float
        Of the disturbance, at rest [its unit times s]; zero for none.
    ellipsoid : (n, n) nested tuple, optional
        X0, symmetric without negative eigenvalues, numbers or exact (Fraction): all initial states
        with x0' X0^-1 x0 <= 1. A diagonal X0 has the squares of the half-axes on it. A box is the
        hull of its corners: give them as ``points``.
    """

    points: tuple[tuple[float, ...], ...] = ()
    impulse: float = 0.0
    ellipsoid: tuple[tuple[float | Fraction, ...], ...] = ()
    kind = "initial peak"
    keys = ("points", "impulse", "ellipsoid", "disturbances")

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_square(self.name, self.ellipsoid)
        self._settle("ellipsoid", tuple(map(tuple, self.ellipsoid)))
        try:
            self._settle("points", tuple(map(tuple, self.points)))
        except TypeError as error:
            raise InputError(
                f"{self.name!r}: points must be a list of initial states, [[...], [...]]"
            ) from error
        if self.disturbances is not None and not self.impulse:
            raise InputError(
                f"{self.name!r}: disturbances are for an impulse; give one, or leave them out"
            )
        numbers = [
            self.impulse,
            *(x for own in (self.points, self.ellipsoid) for p in own for x in p),
        ]
        if not all(isinstance(x, Fraction) or is_number(x) for x in numbers) or not any(numbers):
            raise InputError(
                f"{self.name!r}: give points or an impulse, or an ellipsoid, finite numbers"
            )
        X0 = [[Fraction(x) for x in row] for row in self.ellipsoid]
        if [list(row) for row in zip(*X0, strict=True)] != X0 or not proof.is_semidefinite(X0):
            raise InputError(
                f"{self.name!r}: the ellipsoid must be symmetric, without negative eigenvalues"
            )

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        points = matrix(row, "points", "initial states", number)
        ellipsoid = matrix(row, "ellipsoid", "rows of a matrix", _exact)
        numbers = row.given("impulse")
        return cls(row.table["signal"], points=points, ellipsoid=ellipsoid, **numbers)

    def extended(self, n: int, more: int) -> InitialPeak:
        """Return it from initial states at which the further states are at rest."""
        zeros = (0.0,) * more
        points = tuple((*point, *zeros) if len(point) == n else point for point in self.points)
        X0 = self.ellipsoid
        if len(X0) == n:
            X0 = (*((*row, *zeros) for row in X0), *((0.0,) * (n + more),) * more)
        return replace(self, points=points, ellipsoid=X0)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant without the signal; one without disturbance takes no impulse."""
        self.outputs(plant)
        if self.impulse:
            disturbance(plant)
        self.scales(plant)

    def source(self, plant: UncertainPlant, domain: Domain) -> conditions.Source:  # noqa: ARG002
        """Return the initial states."""
        N, n = len(plant.vertices), plant.shape[0]
        if any(len(point) != n for point in self.points):
            raise InputError(f"{self.name!r}: an initial state has {n} numbers")
        if self.ellipsoid and len(self.ellipsoid) != n:
            raise InputError(f"{self.name!r}: the ellipsoid must be {n} x {n}")
        found = [np.tile(np.array(p, dtype=float)[:, None], (N, 1, 1)) for p in self.points]
        if self.impulse:
            E, acting = self.entering(plant), self._impulses(plant)
            found += [self.impulse * E[:, :, k : k + 1] for k in np.flatnonzero(acting)]
        X0 = np.array(self.ellipsoid, dtype=float) if self.ellipsoid else None
        own = self.points, self.impulse, self.ellipsoid, self.scales(plant)
        name = f"points {own!r}"  # a hash would take -1 for -2
        return conditions.Points(name, tuple(found), X0)

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the peak."""
        points = tuple(tuple(Fraction(x) for x in point) for point in self.points)
        impulses = tuple(map(Fraction, self._impulses(plant)))
        impulses = tuple(Fraction(self.impulse) * scale for scale in impulses)
        X0 = tuple(tuple(Fraction(x) for x in row) for row in self.ellipsoid)
        return proof.InitialPeak(subject, self.exact_outputs(plant), level, points, impulses, X0)

    def _impulses(self, plant: UncertainPlant) -> tuple[float, ...]:
        """Return how many times the impulse each disturbance has; nothing without an impulse."""
        if not self.impulse:
            return ()
        return self.scales(plant) or (1.0,) * plant.disturbance_count

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the peak by exact responses at close instants.

        From an ellipsoid X0 = L L' it is the root of the sum of squares from L's columns.
        """
        (signal,), own, acting = self.outputs(plant), self, self._impulses(plant)
        if not own.impulse and any(vertex.E is None for vertex in plant.vertices):
            plant = _moved_by_nothing(plant)
        loops = close(plant, law, alpha)
        count = len(loops.closed)
        starts = [np.tile(np.array(point, dtype=float), (count, 1)) for point in own.points]
        if own.impulse:
            starts += [own.impulse * s * loops.E[:, :, k] for k, s in enumerate(acting) if s]
        stationary(plant, law, alpha, 1.0, [signal])  # refuses what is not stable
        poles = loops.poles()
        fastest = np.abs(poles).max()
        slowest = np.where(-poles.real > STABLE * fastest, -poles.real, np.inf).min()
        steps = int(min(FOLLOWED / slowest * fastest / STEP + 1, MOST_CHOSEN))
        time, size = STEP / fastest * np.arange(steps), max(1, GROUP // steps)

        def squares(start: Array, part: slice) -> Array:
            one = simulate(plant, law, alpha[part], None, time, [signal], "held", start[part])
            return np.asarray(one.values[:, :, 0] ** 2)

        found = np.zeros(count)
        axes = [np.tile(axis, (count, 1)) for axis in _axes(own)]
        for first in range(0, count, size):
            part = slice(first, first + size)
            each = [squares(start, part) for start in starts]
            if axes:  # c e^At L L' e^A't c' of X0 = L L'
                each.append(np.sum([squares(axis, part) for axis in axes], axis=0))
            found[part] = np.max([y.max(axis=1) for y in each], axis=0)
        return np.sqrt(found)


def _require_square(name: str, ellipsoid: Any) -> None:
    try:
        widths = [len(row) for row in ellipsoid]
    except TypeError:
        widths = [-1]
    if any(width != len(widths) for width in widths):
        raise InputError(f"{name!r}: the ellipsoid must be a square matrix, [[...], [...]]")


def _exact(value: Any, where: str) -> Fraction:
    number(value, where)
    return Fraction(value)


def matrix(
    row: Row, key: str, what: str, read: Callable[[Any, str], Any]
) -> tuple[tuple[Any, ...], ...]:
    """Return a list of rows, none where it is not given.

    Raises
    ------
    SpecError
        If it is no list of lists of numbers.
    """
    value = row.table.get(key, [])
    if not isinstance(value, list) or not all(isinstance(point, list) for point in value):
        raise SpecError(f"{key} must be a list of {what}, [[...], [...]]")
    return tuple(tuple(read(x, key) for x in point) for point in value)


def _moved_by_nothing(plant: UncertainPlant) -> UncertainPlant:
    """Return the plant with a disturbance that does not enter: responses from states need none."""
    zero = tuple((Fraction(0),) for _ in range(plant.shape[0]))
    vertices = tuple(replace(vertex, exact_E=zero) for vertex in plant.vertices)
    return replace(plant, vertices=vertices, disturbances=(), outputs=(), vehicle=None)


def _axes(own: InitialPeak) -> Array:
    """Return the columns of L, X0 = L L', as rows."""
    if not own.ellipsoid:
        return np.zeros((0, 0))
    X0 = np.array(own.ellipsoid, dtype=float)
    # scaled before its eigenvalues are taken: states' units may lie decades apart
    scale = np.sqrt(np.where(np.diag(X0) > 0, np.diag(X0), 1.0))
    values, vectors = np.linalg.eigh(X0 / np.outer(scale, scale))
    return np.asarray((scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))).T)
