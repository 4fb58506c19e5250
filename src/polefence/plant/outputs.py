"""Outputs of a plant, y = C x + D u + F w: states and inputs, and those that it names itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError, PlantError, suggest
from polefence.base.explained import explained, explained_fields
from polefence.plant.parameters import check_label
from polefence.plant.system import Array, Exact, read_matrix
from polefence.proof.short import Short

if TYPE_CHECKING:
    from polefence.plant.family import UncertainPlant

_UNIT = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\]]*)\]$")
IDENTICAL = 1e-10  # of numbers next to the largest of their column
_RATES = {"m": "m/s", "m/s": "m/s2", "rad": "rad/s", "rad/s": "rad/s2", "m s": "m"}

Rows = tuple[tuple[Fraction, ...], ...]


def split(label: str) -> tuple[str, str]:
    """Return name and unit of "name [unit]"; the unit is empty where none is given."""
    found = _UNIT.match(label.strip())
    return (found["name"], found["unit"]) if found else (label.strip(), "")


@dataclass(frozen=True)
class Signal(Short):
    """A name and a unit."""

    name: str
    unit: str = ""

    @property
    def label(self) -> str:
        """Name and unit, as an axis has them."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Output(Signal):
    """y = C x + D u + F w, with rows that are affine in the weights of the vertices.

    Parameters
    ----------
    name, unit : str
    C, D, F : row or rows of float, optional
        One row for all vertices, or one a vertex; zero where left out. Strings and Fractions are
        exact, a float is its binary value. Held as tuples of rows: none where they are zero, one
        where they are all the same.

    Raises
    ------
    PlantError
        If a row holds no finite numbers, rows differ in length, or all are zero.
    """

    C: Any = ()
    D: Any = ()
    F: Any = ()

    @explained_fields
    def __post_init__(self) -> None:
        check_label(self.name, "name of an output")
        check_label(self.unit, f"output {self.name!r}: unit")
        for key in "CDF":
            rows = _read(getattr(self, key), f"output {self.name!r}: {key}")
            object.__setattr__(self, key, rows)
        if not (self.C or self.D or self.F):
            raise PlantError(f"output {self.name!r} is zero; give a row C, D or F")

    def exact(self, plant: UncertainPlant) -> tuple[Rows, Rows, Rows]:
        """Return C, D and F, one row a vertex of the plant.

        Raises
        ------
        InputError
            If the rows do not fit the plant.
        """
        N, (n, m), q = len(plant.vertices), plant.shape, plant.disturbance_count
        C, D, F = (self._spread(key, N, width) for key, width in (("C", n), ("D", m), ("F", q)))
        return C, D, F

    def _spread(self, key: str, count: int, width: int) -> Rows:
        rows: Rows = getattr(self, key) or ((Fraction(0),) * width,)
        if len(rows[0]) != width:
            raise InputError(
                f"output {self.name!r}: {key} has {len(rows[0])} columns; the plant has {width}"
            )
        if len(rows) not in (1, count):
            raise InputError(
                f"output {self.name!r}: {key} has {len(rows)} rows; give one, or {count}: one per "
                "vertex"
            )
        return rows * count if len(rows) == 1 else rows

    def arrays(self, plant: UncertainPlant) -> tuple[Array, Array, Array]:
        """Return C (N, n), D (N, m) and F (N, q) as arrays."""
        C, D, F = (_floats(rows) for rows in self.exact(plant))
        return C, D, F


def _read(value: Any, what: str) -> Rows:
    """Return rows of rationals from a row or rows: () for zeros, one row where all are the same."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise PlantError(f"{what} must be a row of numbers, or one per vertex")
    rows = list(value)
    if not rows:
        return ()
    if not isinstance(rows[0], Iterable) or isinstance(rows[0], str):
        rows = [rows]
    found = read_matrix(rows, what)
    if not any(map(any, found)):
        return ()
    return found[:1] if all(row == found[0] for row in found) else found


def _floats(rows: Rows) -> Array:
    return np.array([[float(x) for x in row] for row in rows]).reshape(len(rows), -1)


@explained
def weighted_sum(name: str, unit: str, terms: Iterable[tuple[Any, Output]]) -> Output:
    """Return the sum of outputs times numbers."""
    terms = [(Fraction(weight), output) for weight, output in terms]
    return Output(name, unit, **{key: _summed(terms, key) for key in "CDF"})


def _summed(terms: Sequence[tuple[Fraction, Output]], key: str) -> Rows:
    found: Rows = ()
    for weight, output in terms:
        own = tuple(tuple(weight * x for x in row) for row in getattr(output, key))
        if found and own:
            count = max(len(found), len(own))
            pairs = (rows * count if len(rows) == 1 else rows for rows in (found, own))
            found = tuple(
                tuple(a + b for a, b in zip(*both, strict=True))
                for both in zip(*pairs, strict=True)
            )
        else:
            found = found or own
    return found


def padded(output: Output, more: int) -> Output:
    """Return an output of a plant that has more states behind its own."""
    zeros = (Fraction(0),) * more
    return replace(output, C=tuple((*row, *zeros) for row in output.C))


@explained
def states(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return an output for every state, named as the plant names it, else x1, x2, ..."""
    return _plain(tuple(plant.states), "x", plant.shape[0], "C")


@explained
def inputs(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return an output for every input, named as the plant names it, else u1, u2, ..."""
    return _plain(tuple(plant.inputs), "u", plant.shape[1], "D")


@lru_cache(maxsize=256)  # asked again and again of one plant, and of many that have the same names
def _plain(labels: tuple[str, ...], letter: str, count: int, key: str) -> tuple[Output, ...]:
    labels = labels or tuple(f"{letter}{i + 1}" for i in range(count))
    rows = ([int(i == j) for j in range(count)] for i in range(count))
    return tuple(
        Output(*split(label), row) if key == "C" else Output(*split(label), D=row)
        for label, row in zip(labels, rows, strict=True)
    )


def disturbances(plant: UncertainPlant) -> tuple[Signal, ...]:
    """Return a signal for every disturbance, named as the plant names it, else w1, w2, ..."""
    count = plant.disturbance_count
    labels = plant.disturbances or [f"w{i + 1}" for i in range(count)]
    return tuple(Signal(*split(label)) for label in labels)


@explained
def rate_of(plant: UncertainPlant, state: str, name: str = "", unit: str = "") -> Output:
    """Return the rate of change of a state: of a velocity in m/s, the acceleration in m/s2.

    Raises
    ------
    InputError
        If there is no such state.
    """
    known = states(plant)
    own = pick(known, state)
    i = known.index(own)
    unit = unit or _RATES.get(own.unit) or f"{own.unit or 1}/s"
    return Output(name or f"rate of {own.name}", unit, *rate_rows(plant, i))


def rate_rows(plant: UncertainPlant, state: int) -> tuple[Exact, Exact, Exact]:
    """Return rows C, D, F of the rate of change of a state, one a vertex: those of A, B, E."""
    A, B = (tuple(getattr(v, key)[state] for v in plant.vertices) for key in ("exact_A", "exact_B"))
    E = tuple(v.exact_E[state] for v in plant.vertices if v.exact_E is not None)
    return A, B, E


def rates_in(plant: UncertainPlant, output: Output) -> Array | None:
    """Return r (n,) of an output that is r dx/dt, identically for all parameters; None if none is.

    Such are accelerations of points of a body, as they are and in shares of a limit.
    """
    E = [own.E for own in plant.vertices if own.E is not None]
    each = [plant.A, plant.B, *([np.stack(E)] if E else [])]
    rates = np.concatenate(each, axis=2).swapaxes(0, 1).reshape(plant.shape[0], -1)
    own = np.concatenate(output.arrays(plant)[: len(each)], axis=1).ravel()
    size = np.maximum(np.abs(rates).max(axis=0), np.abs(own))
    used = size > 0
    if not own.any():
        return None
    rates, own = rates[:, used] / size[used], own[used] / size[used]
    found = np.linalg.lstsq(rates.T, own, rcond=None)[0]
    found = np.where(np.abs(found) > IDENTICAL * np.abs(found).max(), found, 0.0)
    found = np.array([float(f"{r:.12g}") for r in found])  # of one rate, that rate to the last bit
    return found if np.abs(found @ rates - own).max() <= IDENTICAL else None


def pick(known: Sequence[Output], name: str) -> Output:
    """Return the output of that name, of outputs of one name the first.

    Raises
    ------
    InputError
        If there is none.
    """
    for output in known:
        if output.name == name:
            return output
    raise InputError(f"no signal {name!r}; {suggest(name, dict.fromkeys(s.name for s in known))}")


def choose(
    plant: UncertainPlant, signals: Sequence[Output | str] | None = None
) -> tuple[Output, ...]:
    """Return outputs, those given as names found among the plant's signals.

    Parameters
    ----------
    signals : sequence of Output or str, optional
        All states and inputs by default.

    Raises
    ------
    InputError
        If there is no signal of a name, none at all, or two of one name.
    """
    if signals is None:
        return (*states(plant), *inputs(plant))
    if isinstance(signals, str | Output):
        signals = (signals,)
    known = plant.signals
    found = tuple(s if isinstance(s, Output) else pick(known, str(s)) for s in signals)
    names = [s.name for s in found]
    twice = [name for name in names if names.count(name) > 1]
    if twice or not found:
        raise InputError(f"signal {twice[0]!r} is asked twice" if twice else "no signal is asked")
    return found


def output_matrices(
    plant: UncertainPlant, outputs: Sequence[Output], alpha: Array, K: Array
) -> tuple[Array, Array]:
    """Return C + D K (..., p, n) and F (..., p, q) of outputs in closed loops u = K x.

    Parameters
    ----------
    alpha : (..., N) array
    K : (..., m, n) array
    """
    C, D, F = (np.tensordot(alpha, M, 1) for M in stacked(plant, outputs))
    return C + D @ K, F


def stacked(plant: UncertainPlant, outputs: Sequence[Output]) -> tuple[Array, Array, Array]:
    """Return C (N, p, n), D (N, p, m) and F (N, p, q) of outputs at the vertices."""
    C, D, F = (
        np.stack(own, axis=1)
        for own in zip(*(output.arrays(plant) for output in outputs), strict=True)
    )
    return C, D, F
