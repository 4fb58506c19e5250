"""A comparison of laws over a family, as values, plain data and text."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at
from polefence.plant.system import Array
from polefence.proof.text import visible
from polefence.response.closed import point_text

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


ROUNDING = 1e-9


@dataclass(frozen=True)
class Row:
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
class Comparison:
    """What laws make of one road, over a family.

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
        known = {f"{row.law}: {row.quantity}": row for row in self.rows}
        found = known.get(f"{law}: {quantity}")
        if found is None:
            raise InputError(f"no {quantity!r} of {law!r}; {suggest(f'{law}: {quantity}', known)}")
        return found

    def _row(self, i: int, k: int) -> Row:
        own = self.values[i, :, k]
        at = self.alpha[int(np.argmax(own))].tolist()
        worst, best = float(own.max()), float(own.min())
        return Row(
            self.laws[i], *QUANTITIES[k], worst, best, float(np.median(own)), worst - best,
            values_at(self.plant, at), tuple(at),
        )  # fmt: skip

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
        if row.spread <= ROUNDING * abs(row.worst):  # as bad everywhere
            return line
        return f"{line}  {point_text(self.plant, np.array(row.alpha))}"
