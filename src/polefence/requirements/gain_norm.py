"""A limit on the size of the law itself: the spectral norm of its gain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Self

import numpy as np

from polefence.base.errors import InputError, SpecError, shown
from polefence.base.explained import explained_fields
from polefence.law.laws import Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.conditions.gain_norm import Norm
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, Signal
from polefence.plant.polynomial import Domain, bernstein, binomial, elevated, times
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.requirements.slopes import Channel, Loops, Slopes, Turned
from polefence.requirements.specification import Row, Specification, is_number, number
from polefence.response.closed import gains


@dataclass(frozen=True)
class GainNorm(Specification):
    """The largest singular value of diag(rows)^-1 K(alpha) diag(columns).

    With x and u in units of columns and rows, |u| is at most this times |x|, whatever the state.

    Attributes
    ----------
    at_most : float, optional
        A number without unit, of such units.
    rows : tuple of float, optional
        What one unit of each input is [the input's unit]; ones by default.
    columns : tuple of float, optional
        What one unit of each state is [the state's unit]; ones by default.

    Raises
    ------
    InputError
        If the limit or a unit is no positive number.
    """

    signal: str | Output | Signal | Sequence[str | Output] = field(
        default_factory=lambda: Signal(proof.LAW, ""), init=False
    )
    at_most: float | None = None
    rows: tuple[float, ...] | None = None
    columns: tuple[float, ...] | None = None
    kind = "gain norm"
    keys = ("rows", "columns")
    of_signal = False

    @explained_fields
    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("rows", "columns"):
            value = getattr(self, key)
            if value is None:
                continue
            numbers = tuple(value) if np.ndim(value) == 1 else ()
            if not numbers or not all(is_number(x) and x > 0 for x in numbers):
                raise InputError(f"{key} = {value!r} of the gain norm must be positive numbers")
            object.__setattr__(self, key, numbers)

    @classmethod
    def read(cls, row: Row) -> Self:
        """Return what a row says."""
        units = {key: _numbers(row.table[key], key) for key in cls.keys if key in row.table}
        return cls(at_most=row.given().get("at_most"), **units)

    def extended(self, n: int, more: int) -> GainNorm:
        """Return it with units of one for the further states."""
        if self.columns is None or len(self.columns) != n:
            return self
        return replace(self, columns=(*self.columns, *(1.0,) * more))

    def in_units_of(self, other: Specification) -> GainNorm:
        """Return the norm in the other's rows and columns."""
        units = {key: getattr(other, key) for key in self.keys}
        return replace(self, **units)

    def unit(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Return none: it is a number of such units."""
        return ""

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse units that are more or fewer than the plant's inputs and states."""
        self.require_late(plant)
        self.units(plant)

    def units(self, plant: UncertainPlant) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return rows and columns, one number an input and one a state.

        Raises
        ------
        InputError
            If there are more or fewer.
        """
        n, m = plant.shape
        units = []
        for key, given, count in (("rows", self.rows, m), ("columns", self.columns, n)):
            if given is not None and len(given) != count:
                raise InputError(
                    f"{key} of the gain norm holds {len(given)} numbers; {plant.name} needs {count}"
                )
            units.append(given or (1.0,) * count)
        return units[0], units[1]

    def source(
        self,
        plant: UncertainPlant,  # noqa: ARG002
        domain: Domain,  # noqa: ARG002
        law: Law | None = None,  # noqa: ARG002
    ) -> conditions.Source:
        """Return nothing: no signal moves.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError("the gain norm takes no signal")

    def passed(self, plant: UncertainPlant, F: Array) -> Array:  # noqa: ARG002
        """Return zero: no signal moves."""
        return np.zeros_like(F)

    def law_norm(self, plant: UncertainPlant, unit: float | None = None) -> Norm:
        """Return the bound as a condition has it; with a ``unit`` it is not fixed."""
        rows, columns = self.units(plant)
        C, R = (np.diag(1 / np.array(scales)) for scales in (columns, rows))
        if unit is not None:
            return Norm(self.kind, C, R, unit, False)
        # 1e-4 of the limit is left to the proof
        return Norm(self.kind, C, R, (self.at_most or 1.0) * (1 - 1e-4))

    def claim(
        self,
        subject: proof.Subject,
        level: Fraction,
        plant: UncertainPlant,
    ) -> proof.BoundClaim:
        """Return the claim about the gain's norm."""
        rows, columns = (tuple(map(Fraction, scales)) for scales in self.units(plant))
        alone = replace(subject, step=Fraction(0), remainder=None, motion=(), change=None)
        return proof.GainNorm(alone, level, rows, columns)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the norm by the singular values of the gains."""
        return self.norms(plant, gains(plant, law, alpha))

    def norms(self, plant: UncertainPlant, K: Array) -> Array:
        """Return the norms of gains (..., m, n), in floats."""
        rows, columns = (np.array(scales) for scales in self.units(plant))
        return np.asarray(np.linalg.norm(K * columns / rows[:, None], 2, axis=(-2, -1)))

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with z = diag(rows)^-1 u, and x = diag(columns) w."""
        rows, columns = (np.array(scales) for scales in self.units(plant))
        n, m = plant.shape
        moved = np.diag(columns), np.zeros((m, n)), np.diag(1 / rows), np.zeros((m, n))
        E, C, D, F = (np.broadcast_to(M, (len(alpha), *M.shape)) for M in moved)
        return Channel(*plant.at(alpha), E, C, D, F)

    def slopes(self, loops: Loops) -> Slopes:
        """Return the norm with its slopes: all singular values near the largest."""
        u, values, vt = np.linalg.svd(loops.C @ loops.E, full_matrices=False)
        # slopes of the singular values within 20 % of the largest
        points, some = np.nonzero(values >= 0.8 * values[:, :1])

        def turned() -> list[Turned]:
            left, right = u[points, :, some], (loops.E[points] @ vt[points, some, :, None])[..., 0]
            dA = np.zeros_like(loops.A[points])
            return [Turned(dA, left[:, :, None] * right[:, None, :])]

        return Slopes(values[points, some], points, turned)


def levels(plant: UncertainPlant, law: Law, norm: GainNorm) -> Iterator[tuple[float, int]]:
    """Yield the bounds on a law in floats, each with its elevation."""
    if law.K is not None:
        yield float(norm.norms(plant, law.K)), 0
        return
    domain, degree, n = law.domain, law.degree, plant.shape[0]
    rows, columns = (np.array(scales) for scales in norm.units(plant))
    H, Z = law.form[:, :n] / columns[:, None], law.form[:, n:] / rows[:, None]
    right = np.linalg.inv(H.mean(axis=0))
    P, Q = (bernstein(domain, M @ right, degree) for M in (H, Z))
    square = times({e: p.T for e, p in P.items()}, P)
    for elevation in (0, 1, 2, 4, 8, 16):
        total = 2 * degree + elevation
        if elevation and domain.count(total) > 3000:
            return
        raised, below = elevated(square, domain, elevation), elevated(Q, domain, total - degree)
        worst = max(_least(raised[e], below[e], binomial(domain.sizes, e)) for e in raised)
        yield float(np.sqrt(worst)), elevation


def by_multiples(plant: UncertainPlant, law: Law, norm: GainNorm) -> tuple[float, Array] | None:
    """Return the bound on a scheduled law by multipliers s in floats, and s; None without one.

    W is above s diag(columns)^2. That costs up to the root of how far W is from a multiple of it,
    and asks for no more of a W that varies much.
    """
    if law.W is None:
        return None
    rows, columns = (np.array(scales) for scales in norm.units(plant))
    W, V = law.W / columns[:, None] / columns, law.form[:, len(columns) :] / rows[:, None] / columns
    s = (1 - 1e-3) * np.linalg.eigvalsh(W).min(axis=1)  # room for the proof that W is above s
    if not s.min() > 0:
        return None
    square = V @ np.linalg.solve(W, np.swapaxes(V, 1, 2))
    return float(np.sqrt((np.linalg.norm(square, 2, axis=(1, 2)) / s).max())), s


def _least(square: Array, below: Array, weight: int) -> float:
    """Return the least g^2 of [ square, below' ; below, weight g^2 I ] >= 0."""
    try:
        half = np.linalg.solve(np.linalg.cholesky(square), below.T)
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.linalg.norm(half, 2)) ** 2 / weight


def as_norms(
    plant: UncertainPlant, limits: tuple[Specification, ...], minimise: Specification | None
) -> tuple[Norm, ...]:
    """Return the bounds on the law that are asked for."""
    norms = [limit.law_norm(plant) for limit in limits]
    norms += [] if minimise is None else [minimise.law_norm(plant, 1.0)]
    # variables are known by name
    return tuple(_named(norm, k) for k, norm in enumerate(norm for norm in norms if norm))


def _named(norm: Norm, k: int) -> Norm:
    return Norm(f"{norm.name} {k + 1}", norm.C, norm.R, norm.level, norm.fixed)


def _numbers(value: Any, where: str) -> tuple[float, ...]:
    if not isinstance(value, list):
        raise SpecError(f"{where} = {shown(value)} must be a list of numbers, [...]")
    return tuple(number(x, where) for x in value)
