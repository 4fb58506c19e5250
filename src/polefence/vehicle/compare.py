"""Laws on the same road, for ever: comfort, road holding, travel, force and power over a family.

All numbers are those of stationary covariances, of the loop in series with the weighting Wk of
ISO 2631-1: no simulation, no seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError, UncontrollableError, suggest
from polefence.base.explained import explained
from polefence.base.progress import counted
from polefence.law.laws import check_alpha
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import output_matrices, states, weighted_sum
from polefence.plant.points import edges, sample, values_at
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.proof.text import visible
from polefence.region.regions import Disk
from polefence.response.closed import close, point_text
from polefence.response.stationary import covariance, needed, unstable, velocity_density
from polefence.response.weighting import WK
from polefence.search.place import place
from polefence.vehicle.reference_laws import lqr, skyhook
from polefence.vehicle.vehicle import masses, require_ride

NAMES = ("passive", "skyhook", "lqr", *METHODS)

# Of each law at each point; rms unless said otherwise. Power is of the actuator, into the car: the
# mean, and the mean of what is positive of it, for an actuator that cannot take any back.
QUANTITIES = (
    ("weighted acceleration", "m/s2"),
    ("acceleration", "m/s2"),
    ("tyre deflection", "m"),
    ("tyre load variation", "N"),
    ("suspension travel", "m"),
    ("actuator force", "N"),
    ("mean power", "W"),
    ("mean power drawn", "W"),
)


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
        A quarter car.
    laws : mapping of str to law
        None (passive), a law, a design, a table of gains or an (m, n) array; or `NoLaw`.
    road : str
        Class of ISO 8608, "A" to "H", its geometric mean.
    speed : float
        [m/s]
    alpha : (count, N) array, optional
        Points of the family; by default its `points`.

    Returns
    -------
    Comparison
        Of the `QUANTITIES`. A law that leaves a loop unstable at a point is among ``left_out``.

    Raises
    ------
    InputError
        If the plant is no quarter car or its road no single velocity, no law is left to compare,
        or an argument cannot be used.
    """
    require_ride(plant)
    density, N = velocity_density(road, speed), len(plant.vertices)
    measured, left_out = dict[str, Array](), dict[str, str]()
    alpha = points(plant) if alpha is None else check_alpha(np.atleast_2d(alpha), N)
    for name, law in counted(laws.items(), "law"):
        quantities = (
            law.reason if isinstance(law, NoLaw) else _quantities(plant, law, alpha, density)
        )
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
    return Comparison(plant, str(road).upper(), speed, alpha, tuple(measured), values, left_out)


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
        If the plant is no quarter car, a name is unknown, or the disk is none. A method that gives
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


def _quantities(plant: UncertainPlant, law: Any, alpha: Array, density: float) -> Array | str:
    """Return the quantities at all points, (count, quantities); or why there are none."""
    known, loops = require_ride(plant), close(plant, law, alpha)
    if sum(plant.physical) != 1:
        raise InputError(f"{plant.name} has {sum(plant.physical)} disturbances; a road is one")
    psd = np.where(plant.physical, density, 1.0)
    first, second = known.places[2:]
    velocities = states(plant)
    relative = weighted_sum(
        "velocity apart", "m/s", [(1, velocities[first]), (-1, velocities[second])]
    )
    asked = (known.acceleration, known.tyre, known.travel, known.force, relative)
    C, F = output_matrices(plant, asked, loops.alpha, loops.K)
    if np.any(F):
        raise InputError(f"{plant.name}: the road reaches the acceleration unfiltered; check E")
    keep = needed(C, loops.closed)
    A, E, C = loops.closed[:, keep][:, :, keep], loops.E[:, keep], C[:, :, keep]
    bad = unstable(A)
    if len(bad):
        pole = float(np.linalg.eigvals(A[bad[0]]).real.max())
        return f"unstable: a pole at {pole:.3g} 1/s at {point_text(plant, loops.alpha[bad[0]])}"
    C, X = _weighted(A, E, C, psd)
    R = np.einsum("cpn,cnm,cqm->cpq", C, X, C, optimize=True)
    rms = np.sqrt(np.maximum(np.diagonal(R, axis1=1, axis2=2), 0.0))
    weighted, acceleration, tyre, travel, force, apart = rms.T
    load = masses(plant, known, loops.alpha).kt * tyre
    power = R[:, 4, 5]
    drawn = _drawn(power, force * apart)
    columns = (weighted, acceleration, tyre, load, travel, force, power, drawn)
    return np.stack(columns, axis=1)


def _weighted(A: Array, E: Array, C: Array, psd: Array) -> tuple[Array, Array]:
    """Return outputs and covariance of the loop with Wk behind the first of its outputs.

    The weighted output comes first, the others after it.
    """
    (count, n, _), (Aw, Bw, Cw, Dw) = E.shape, WK.state_space()
    size = n + len(Aw)
    both, into = np.zeros((count, size, size)), np.zeros((count, size, E.shape[-1]))
    both[:, :n, :n], both[:, n:, n:], both[:, n:, :n] = A, Aw, Bw @ C[:, :1]
    into[:, :n] = E
    rows = np.zeros((count, C.shape[1] + 1, size))
    rows[:, 1:, :n], rows[:, :1, :n], rows[:, :1, n:] = C, Dw @ C[:, :1], Cw
    return rows, covariance(both, into, psd)


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
        Every one of `QUANTITIES`, in its unit.
    left_out : dict of str to str
        Names of the other laws, and why nothing can be said of them.
    """

    plant: UncertainPlant
    road: str
    speed: float
    alpha: Array
    laws: tuple[str, ...]
    values: Array
    left_out: dict[str, str]

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(self.laws)} for {self.plant.name!r}>"

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """A row a quantity and law, quantities in their order, laws in that of `laws`."""
        return tuple(self._row(i, k) for k in range(len(QUANTITIES)) for i in range(len(self.laws)))

    def row(self, law: str, quantity: str = "weighted acceleration") -> Row:
        """Return one row.

        Raises
        ------
        InputError
            If there is none.
        """
        known = {f"{one.law}: {one.quantity}": one for one in self.rows}
        row = known.get(f"{law}: {quantity}")
        if row is None:
            raise InputError(f"no {quantity!r} of {law!r}; {suggest(f'{law}: {quantity}', known)}")
        return row

    def _row(self, i: int, k: int) -> Row:
        values = self.values[i, :, k]
        at = self.alpha[int(np.argmax(values))].tolist()
        worst, best = float(values.max()), float(values.min())
        return Row(
            self.laws[i], *QUANTITIES[k], worst, best, float(np.median(values)), worst - best,
            values_at(self.plant, at), tuple(at),
        )  # fmt: skip

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the rows as plain values, for `pandas.DataFrame`.

        Parameters where a law is worst are columns with their names.
        """
        plain = ("law", "quantity", "unit", "worst", "best", "median", "spread")
        return [{key: getattr(row, key) for key in plain} | (row.values or {}) for row in self.rows]

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        shown = [row for row in self.rows if row.quantity == QUANTITIES[0][0]]
        rows = [(row.law, f"worst {row.worst:.4g} {row.unit}") for row in shown]
        title = f"{QUANTITIES[0][0]}, road {self.road}, {self.speed:g} m/s"
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
        }

    def __str__(self) -> str:
        return "\n".join(map(visible, self.lines))

    @property
    def lines(self) -> list[str]:
        """A table in plain text, a block a quantity."""
        wide = max(34, 2 + max(len(law) for law in self.laws))
        lines = [
            f"{self.plant.name}: road of class {self.road} (ISO 8608) at {self.speed:g} m/s, "
            f"stationary; {len(self.alpha)} points of the family"
        ]
        for k, (name, unit) in enumerate(QUANTITIES):
            head = f"{name} [{unit}]" if unit == "W" else f"{name} rms [{unit}]"
            columns = "".join(f"{word:>10}" for word in ("worst", "best", "median", "spread"))
            lines += ["", f"{head:<{wide}}{columns}  worst at"]
            lines += [self._line(self._row(i, k), wide) for i in range(len(self.laws))]
        if self.left_out:
            lines += ["", *(f"{law}: {reason}" for law, reason in self.left_out.items())]
        return lines

    def _line(self, row: Row, wide: int) -> str:
        numbers = (row.worst, row.best, row.median, row.spread)
        line = f"  {row.law:<{wide - 2}}" + "".join(f"{value:>10.4g}" for value in numbers)
        if row.spread <= 1e-9 * abs(row.worst):  # as bad everywhere
            return line
        return f"{line}  {point_text(self.plant, np.array(row.alpha))}"
