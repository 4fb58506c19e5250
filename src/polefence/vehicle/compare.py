"""Laws on the same road, for ever: comfort, road holding, travel, force and power over a family.

All numbers are those of stationary covariances, of the loop in series with the weighting Wk of
ISO 2631-1: no simulation, no seed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, UncontrollableError, suggest
from polefence.base.explained import explained
from polefence.base.progress import counted
from polefence.certify.design import Design
from polefence.law.laws import check_alpha
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.card import card
from polefence.plant.family import SamplesOf, UncertainPlant
from polefence.plant.outputs import Output, inputs, output_matrices, states
from polefence.plant.points import edges, sample, values_at
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.proof.text import milliseconds_text, visible
from polefence.region.regions import Disk
from polefence.requirements.weights import filter_of
from polefence.response.closed import Loops, close, point_text
from polefence.response.discrete import zero_order_hold
from polefence.response.stationary import (
    covariance,
    filtered_variance,
    growth,
    needed,
    unstable,
    velocity_density,
)
from polefence.response.weighting import WK
from polefence.search.place import place
from polefence.vehicle.reference_laws import lqr, skyhook
from polefence.vehicle.suspensions import Suspensions, in_continuous_time, is_car, suspensions

NAMES = ("passive", "skyhook", "lqr", *METHODS)

# Of each law at each point; rms unless said otherwise. Accelerations are those of each seat, the
# others those of each wheel. Power is of the actuators, into the car: the mean, and the mean of
# what is positive of it, for actuators that cannot take any back; summed over the suspensions.
FELT = (("weighted acceleration", "m/s2"), ("acceleration", "m/s2"))
AT_WHEELS = (
    ("tyre deflection", "m"),
    ("tyre load variation", "N"),
    ("suspension travel", "m"),
    ("actuator force", "N"),
)
POWERS = (("mean power", "W"), ("mean power drawn", "W"))
QUANTITIES = (*FELT, *AT_WHEELS, *POWERS)  # of a quarter car


@dataclass(frozen=True)
class Quantity(Short):
    """A column of a comparison.

    Attributes
    ----------
    place : str
        The seat or the wheel; empty text where there is but one, or of all together.
    what, unit : str
        One of `QUANTITIES`.
    """

    place: str
    what: str
    unit: str

    @property
    def name(self) -> str:
        """Place and quantity, as in "front tyre deflection"."""
        return f"{self.place} {self.what}".strip()


@dataclass(frozen=True)
class NoLaw(Short):
    """The reason why there is no law of a name."""

    reason: str


@explained
def compare(
    plant: UncertainPlant,
    laws: Mapping[str, Any],
    road: str = "C",
    speed: float = 20.0,
    alpha: Any = None,
) -> Comparison:
    """Compare laws by their stationary response to a random road.

    Parameters
    ----------
    plant : UncertainPlant
        A car, or its samples: then everything is that at the samples, and a filter of comfort holds
        its input in between.
    laws : mapping of str to law
        None (passive), a law, a design, a table of gains or an (m, n) array; or `NoLaw`. A design
        of the same car at another sample time, or whose law has states of its own, is compared
        with the plant that it is about.
    road : str
        Class of ISO 8608, "A" to "H", its geometric mean.
    speed : float
        [m/s]
    alpha : (count, N) array, optional
        Points of the family; by default its `points`.

    Returns
    -------
    Comparison
        Of its ``quantities``. A law that leaves a loop unstable at a point is among ``left_out``.

    Raises
    ------
    InputError
        If the plant is no car or has no road, no law is left to compare, or an argument cannot be
        used.
    """
    ridden = _Ridden.of(plant)
    density, N = velocity_density(road, speed), len(plant.vertices)
    measured, left_out = dict[str, Array](), dict[str, str]()
    alpha = points(plant) if alpha is None else check_alpha(np.atleast_2d(alpha), N)
    periods = dict[str, Fraction]()
    for name, law in counted(laws.items(), "law"):
        about = ridden
        if (seen := plant_of(plant, law)) is not plant:
            about, periods[name] = _Ridden.of(seen), seen.period
        quantities = law.reason if isinstance(law, NoLaw) else about.values(law, alpha, density)
        if isinstance(quantities, str):
            left_out[name] = quantities
        else:
            measured[name] = quantities
    if not measured:
        why = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise InputError(
            f"no law is left to compare ({why or 'none was given'}); give one that keeps the "
            "whole family stable"
        )
    values = np.stack(list(measured.values()))
    asked, names = (plant, str(road).upper(), speed, alpha), tuple(measured)
    others = {name: T for name, T in periods.items() if name in names and plant.period != T}
    return Comparison(*asked, names, values, left_out, ridden.quantities, others)


def plant_of(plant: UncertainPlant, law: Any) -> UncertainPlant:
    """Return the plant that a law is of: that of a design of the same car, where it is another.

    A design at a sample time, and one whose law has states of its own, have a plant with more
    states behind those of the car.
    """
    if not isinstance(law, Design):
        return plant
    other = law.plant
    if other.period == plant.period and other.shape == plant.shape:
        return plant
    alike = is_car(other) and _same(in_continuous_time(plant), in_continuous_time(other))
    return other if alike else plant


def _same(one: UncertainPlant, other: UncertainPlant) -> bool:
    """Whether two plants are one car, but for further states and inputs at the end of either."""
    ranges = [[(p.name, p.low, p.high, p.through) for p in car.parameters] for car in (one, other)]
    (n, m), (k, r) = one.shape, other.shape
    rows, columns = min(n, k), min(m, r)

    def blocks(plant: UncertainPlant) -> list[Any]:
        return [
            [(a[:rows], b[:columns]) for a, b in zip(v.exact_A, v.exact_B, strict=True)][:rows]
            for v in plant.vertices
        ]

    return ranges[0] == ranges[1] and blocks(one) == blocks(other)


@explained
def points(plant: UncertainPlant) -> Array:
    """Return corners, edges and a seeded sample of a family as alpha (count, N).

    Where the plant has parameters, of their box: products of weights. Half of the sample is
    uniform in the weights of each scheduling variable, half is pressed towards their ends.
    """
    N = len(plant.vertices)
    domain = Domain.of("box" if plant.parameters else "simplex", N)
    between = edges(domain)[N:] if plant.parameters else np.zeros((0, N))
    return domain.alpha(np.vstack([sample(domain), between]))


@explained
def standard_laws(
    plant: UncertainPlant,
    disk: tuple[float, float] = (-40.0, 36.0),
    names: tuple[str, ...] = NAMES,
) -> dict[str, Any]:
    """Return the reference laws by name.

    The proved ones are all designed for the one disk, which all three methods reach for the
    quarter cars of the package: they then promise the same, and differ in how they keep it. Each
    at its own tightest disk would ask most of the method that can do most.

    Parameters
    ----------
    disk : (float, float)
        Centre and radius [1/s].
    names : tuple of str
        Some of `NAMES`.

    Raises
    ------
    InputError
        If the plant is no car, a name is unknown, or the disk is none. A method that gives
        no proof raises nothing: its law is a `NoLaw`.
    """
    laws = dict[str, Any]()
    for name in names:
        if name not in NAMES:
            raise InputError(f"no law {name!r}; {suggest(name, NAMES)}")
        laws[name] = _law(plant, name, disk)
    return laws


def _law(plant: UncertainPlant, name: str, disk: tuple[float, float]) -> Any:
    if name == "passive":
        return None
    if name not in METHODS:
        return skyhook(plant) if name == "skyhook" else lqr(plant)
    try:
        return place(plant, Disk(*disk), name)
    except (NotProvedError, UncontrollableError) as answer:
        return NoLaw(str(answer))


@dataclass(frozen=True, eq=False)
class _Ridden:
    """A plant with the signals by which its ride is judged.

    Attributes
    ----------
    known : Suspensions
        Of the plant in continuous time.
    force : tuple of Output
        What acts: of inputs that are late the states that they are by then.
    later : tuple of Output
        What acts at the end of a sample where inputs change within it, else none.
    """

    plant: UncertainPlant
    known: Suspensions
    force: tuple[Output, ...]
    later: tuple[Output, ...]

    @classmethod
    def of(cls, plant: UncertainPlant) -> _Ridden:
        car = in_continuous_time(plant)
        known = suspensions(car)
        if not known.roads:
            raise InputError(f"{plant.name} has no E, so no road enters; give E in its spec")
        late = 0 if plant.sampling is None else plant.sampling.delay
        splits = plant.sampling is not None and bool(plant.sampling.early)
        (n, m), every = car.shape, (states(plant), inputs(plant))

        def acting(late: int) -> tuple[Output, ...]:
            return tuple(
                plant.signal(signal.name)
                if lag is not None
                else every[0][n + (late - 1) * m + number]
                if late
                else every[1][number]
                for signal, number, lag in zip(known.force, known.inputs, known.lags, strict=True)
            )

        return cls(plant, known, acting(late), acting(late - 1) if splits else ())

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The columns of `values`."""
        known = self.known
        felt = (Quantity(seat, *one) for one in FELT for seat in known.felt)
        wheels = (Quantity(wheel, *one) for one in AT_WHEELS for wheel in known.names)
        return (*felt, *wheels, *(Quantity("", *one) for one in POWERS))

    @property
    def signals(self) -> tuple[Output, ...]:
        """Of the plant: those that are felt, then deflections of tyres and suspensions."""
        known = self.known
        asked = (*known.felt.values(), *known.tyre, *known.travel)
        return tuple(self.plant.signal(signal.name) for signal in asked)

    def values(self, law: Any, alpha: Array, density: float) -> Array | str:
        """Return the quantities at all points, (count, quantities); or why there are none."""
        plant, known = self.plant, self.known
        loops, seats, k = close(plant, law, alpha), len(known.felt), len(known.names)
        psd = np.where(plant.physical, 0.0, 1.0)
        psd[list(known.roads)] = density
        asked = (*self.signals, *self.force, *self.later)
        C, F = output_matrices(plant, asked, loops.alpha, loops.K, loops.passed)
        if np.any(F * psd):
            raise InputError(f"{plant.name}: the road reaches the acceleration unfiltered; check E")
        first = len(self.signals)
        shares, meanwhile = zip(*self.over_a_step(loops, C[:, first:]), strict=True)
        C = np.concatenate([C[:, : first + k], *meanwhile], axis=1)
        keep = needed(C, loops.closed)
        A, E, C = loops.closed[:, keep][:, :, keep], loops.E[:, keep], C[:, :, keep]
        bad = unstable(A, loops.step)
        if len(bad):
            pole = float(growth(np.linalg.eigvals(A[bad[0]]), loops.step).max())
            return f"unstable: a pole at {pole:.3g} 1/s at {point_text(plant, loops.alpha[bad[0]])}"
        X = covariance(A, E, psd, loops.step)
        variance = np.einsum("cpn,cnm,cpm->cp", C, X, C, optimize=True)
        rms = np.sqrt(np.maximum(variance, 0.0))
        weighting = _comfort(plant)
        weighted = filtered_variance(A, X, C[:, :seats], weighting, loops.step)
        tyre, travel, force = (rms[:, seats + i * k : seats + (i + 1) * k] for i in range(3))
        power, drawn = np.zeros(len(C)), np.zeros(len(C))
        for i, share in enumerate(shares):
            held, moved = (slice(j, j + k) for j in (first + (2 * i + p + 1) * k for p in (0, 1)))
            mean = np.einsum("cpn,cnm,cpm->cp", C[:, held], X, C[:, moved], optimize=True)
            power += share * mean.sum(axis=1)
            drawn += share * _drawn(mean, rms[:, held] * rms[:, moved]).sum(axis=1)
        load = known.corners(loops.alpha).tyre * tyre
        columns = (np.sqrt(np.maximum(weighted, 0.0)), rms[:, :seats], tyre, load, travel, force)
        return np.column_stack([*columns, power, drawn])

    def over_a_step(self, loops: Loops, forces: Array) -> Iterator[tuple[float, Array]]:
        """Yield shares of a step with the rows of the forces, then of their velocities, in each.

        Velocities are those of body and wheel apart. At samples all are means over the share, so
        that their products are the power: a held force stays, one behind an actuator is half way
        between its values at the ends. A step has two shares where held forces change within it.
        """
        k, moved = len(self.known.names), self.known.compression
        lags = np.array([lag is not None for lag in self.known.lags])[:, None]
        force, T = forces[:, :k], loops.step
        apart = np.zeros((k, self.plant.shape[0]))
        apart[:, : moved.shape[1]] = -moved
        whole, change = apart @ loops.closed, T * (force @ loops.closed)
        sampling = self.plant.sampling
        if sampling is None or not sampling.early:
            yield 1.0, np.concatenate([force + lags * change / 2, whole], axis=1)
            return
        share, step = 1 - float(sampling.early), _until_change(loops, sampling)
        before, changed = apart @ step / (share * T), force @ step
        yield share, np.concatenate([force + lags * changed / 2, before], axis=1)
        after = (whole - share * before) / (1 - share)
        last = np.where(lags, force + (changed + change) / 2, forces[:, k:])
        yield 1 - share, np.concatenate([last, after], axis=1)


def _until_change(loops: Loops, sampling: SamplesOf) -> Array:
    """Return what states change by in a step until the inputs that act do.

    Those of the plant that is sampled, under the inputs that act first; others stay.
    """
    (n, m), time = sampling.plant.shape, (1 - float(sampling.early)) * loops.step
    first = n + (sampling.delay - 1) * m
    F, G = zero_order_hold(*sampling.plant.at(loops.alpha), time)
    step = np.zeros_like(loops.closed)
    step[:, :n, :n], step[:, :n, first : first + m] = F - np.eye(n), G
    return step


def _when(T: Fraction) -> str:
    return f" at samples every {milliseconds_text(T)} ms" if T else ""


def _comfort(plant: UncertainPlant) -> tuple[Array, Array, Array]:
    """Return Wk, of a plant at a sample time in its delta form."""
    form = filter_of(WK, plant.period)
    a, b, c = (np.array(M, dtype=float) for M in (form.a, form.b, form.c))
    return a, b, c


def _drawn(mean: Array, sizes: Array) -> Array:
    """Return E max(f v, 0) of joint Gaussian f, v, from E f v and rms(f) rms(v).

    s (sqrt(1 - r^2) + r (pi - arccos r)) / pi, s the product of the rms, r the correlation.
    """
    share = np.divide(mean, sizes, out=np.zeros_like(mean), where=sizes > 0)
    r = np.clip(share, -1.0, 1.0)
    return np.asarray(sizes * (np.sqrt(1 - r * r) + r * (np.pi - np.arccos(r))) / np.pi)


@dataclass(frozen=True)
class Row(Short):
    """One quantity of one law over the family.

    Attributes
    ----------
    law, quantity, unit : str
    worst, best, median, spread : float
        Largest, smallest and middle of all points; worst less best.
    values : dict of str to float, or None
        Parameters where it is worst; None for a plant given by its vertices.
    alpha : tuple of float
        Of the same point.
    """

    law: str
    quantity: str
    unit: str
    worst: float
    best: float
    median: float
    spread: float
    values: dict[str, float] | None
    alpha: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Short):
    """Laws compared on one road, over a family.

    Attributes
    ----------
    plant : UncertainPlant
    road : str
        Class of ISO 8608.
    speed : float
        [m/s]
    alpha : (count, N) array
        The points.
    laws : tuple of str
        Those that were compared.
    values : (laws, count, quantities) array
        Every one of ``quantities``, in its unit.
    left_out : dict of str to str
        Names of the other laws, and why nothing can be said of them.
    quantities : tuple of Quantity
        Of each seat and each wheel.
    periods : dict of str to Fraction
        Sample times of laws that run at another one than the plant's [s]; zero in continuous time.
    """

    plant: UncertainPlant
    road: str
    speed: float
    alpha: Array
    laws: tuple[str, ...]
    values: Array
    left_out: dict[str, str]
    quantities: tuple[Quantity, ...]
    periods: dict[str, Fraction] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(self.laws)} for {self.plant.name!r}>"

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """A row a quantity and law, quantities in their order, laws in that of `laws`."""
        count = len(self.quantities)
        return tuple(self._row(i, k) for k in range(count) for i in range(len(self.laws)))

    def row(self, law: str, quantity: str = "weighted acceleration") -> Row:
        """Return one row: of a quantity without its seat or wheel that where it is worst.

        Raises
        ------
        InputError
            If there is none.
        """
        alike = [one.name for one in self.quantities if one.what == quantity]
        if alike:
            return max((self._named(law, name) for name in alike), key=lambda row: row.worst)
        return self._named(law, quantity)

    def _named(self, law: str, quantity: str) -> Row:
        known = {f"{one.law}: {one.quantity}": one for one in self.rows}
        row = known.get(f"{law}: {quantity}")
        if row is None:
            raise InputError(f"no {quantity!r} of {law!r}; {suggest(f'{law}: {quantity}', known)}")
        return row

    def _row(self, i: int, k: int) -> Row:
        values = self.values[i, :, k]
        at = self.alpha[int(np.argmax(values))].tolist()
        worst, best = float(values.max()), float(values.min())
        quantity = self.quantities[k]
        return Row(
            self.laws[i], quantity.name, quantity.unit, worst, best, float(np.median(values)),
            worst - best, values_at(self.plant, at), tuple(at),
        )  # fmt: skip

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the rows as plain values, for `pandas.DataFrame`.

        Parameters where a law is worst are columns with their names.
        """
        plain = ("law", "quantity", "unit", "worst", "best", "median", "spread")
        return [{key: getattr(row, key) for key in plain} | (row.values or {}) for row in self.rows]

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        shown = [self.row(law) for law in self.laws]
        rows = [(row.law, f"worst {row.worst:.4g} {row.unit}") for row in shown]
        title = f"{FELT[0][0]}, road {self.road}, {self.speed:g} m/s"
        return card(title, [*rows, *self.left_out.items()])

    def document(self) -> dict[str, Any]:
        """Return all rows as plain data."""
        return {
            "plant": self.plant.name,
            "digest": self.plant.digest,
            "road": self.road,
            "speed": self.speed,
            "points": len(self.alpha),
            "rows": [asdict(row) for row in self.rows],
            "left out": dict(self.left_out),
        } | ({} if self.plant.data is None else {"unproved": self.plant.data.note})

    def __str__(self) -> str:
        return "\n".join(map(visible, self.lines))

    @property
    def when(self) -> str:
        """Say that everything is that at samples, where it is; else empty."""
        T = self.plant.period
        return f",{_when(T)}" if T else ""

    @property
    def lines(self) -> list[str]:
        """A table in plain text, a block a quantity."""
        heads = [
            f"{one.name}{'' if one.unit == 'W' else ' rms'} [{one.unit}]" for one in self.quantities
        ]
        wide = max(34, *map(len, heads), 2 + max(len(law) for law in self.laws))
        lines = [
            f"{self.plant.name}: road of class {self.road} (ISO 8608) at {self.speed:g} m/s, "
            f"stationary{self.when}; {len(self.alpha)} points of the family"
        ]
        for k, head in enumerate(heads):
            columns = "".join(f"{word:>10}" for word in ("worst", "best", "median", "spread"))
            lines += ["", f"{head:<{wide}}{columns}  worst at"]
            lines += [self._line(self._row(i, k), wide) for i in range(len(self.laws))]
        if self.periods:
            pairs = self.periods.items()
            lines += ["", *(f"{law}:{_when(T) or ' in continuous time'}" for law, T in pairs)]
        if self.left_out:
            lines += ["", *(f"{law}: {reason}" for law, reason in self.left_out.items())]
        return lines

    def _line(self, row: Row, wide: int) -> str:
        numbers = (row.worst, row.best, row.median, row.spread)
        line = f"  {row.law:<{wide - 2}}" + "".join(f"{value:>10.4g}" for value in numbers)
        if row.spread <= 1e-9 * abs(row.worst):  # as bad everywhere
            return line
        return f"{line}  {point_text(self.plant, np.array(row.alpha))}"
