"""Outputs of a plant, y = C x + D u + F w: its states, its inputs and its named outputs."""

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
from polefence.plant.evaluated import beyond
from polefence.plant.parameters import check_label
from polefence.plant.system import Array, Exact, read_matrix
from polefence.proof.matrices import mix
from polefence.proof.plant import RATE, WITHOUT
from polefence.proof.remainder import Remainder, Source
from polefence.proof.short import Short

if TYPE_CHECKING:
    from polefence.plant.family import UncertainPlant

_UNIT = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\]]*)\]$")
LATE = ", 1 sample late"  # ends the name of an input on its way
IDENTICAL = 1e-10  # relative to the largest entry of a column: smaller differences are rounding
_RATES = {"m": "m/s", "m/s": "m/s2", "rad": "rad/s", "rad/s": "rad/s2", "m s": "m"}

Rows = tuple[tuple[Fraction, ...], ...]


def split(label: str) -> tuple[str, str]:
    """Return name and unit of "name [unit]"; the unit is empty where none is given."""
    match = _UNIT.match(label.strip())
    return (match["name"], match["unit"]) if match else (label.strip(), "")


@dataclass(frozen=True)
class Signal(Short):
    """A name and a unit."""

    name: str
    unit: str = ""

    @property
    def label(self) -> str:
        """Name and unit, as printed on an axis."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Output(Signal):
    """y = C x + D u + F w, with rows that are affine in the weights of the vertices.

    Parameters
    ----------
    name, unit : str
    C, D, F : row or rows of float, optional
        One row for all vertices, or one per vertex; zero where left out. Strings and Fractions
        are exact, a float is its binary value. They are stored as tuples of rows: an empty tuple
        if all are zero, one row if all are the same.
    near : Remainder, optional
        Where functions of the parameters are among the entries of [C, D, F]: what is added to the
        combination of the vertices, and what that is off by.

    Raises
    ------
    PlantError
        If a number is not finite, rows differ in length, or all are zero.
    """

    C: Any = ()
    D: Any = ()
    F: Any = ()
    near: Remainder | None = None

    @explained_fields
    def __post_init__(self) -> None:
        check_label(self.name, "name of an output")
        check_label(self.unit, f"output {self.name!r}: unit")
        for key in "CDF":
            rows = _read(getattr(self, key), f"output {self.name!r}: {key}")
            object.__setattr__(self, key, rows)
        if not (self.C or self.D or self.F or self.near):
            raise PlantError(f"output {self.name!r} is zero; give a row C, D or F")

    def exact(self, plant: UncertainPlant) -> tuple[Rows, Rows, Rows]:
        """Return C, D and F, one row per vertex of the plant.

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
    """Return rows of rationals: an empty tuple for zeros, one row if all are the same."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise PlantError(f"{what} must be a row of numbers, or one per vertex")
    rows = list(value)
    if not rows:
        return ()
    if not isinstance(rows[0], Iterable) or isinstance(rows[0], str):
        rows = [rows]
    matrix = read_matrix(rows, what)
    if not any(map(any, matrix)):
        return ()
    return matrix[:1] if all(row == matrix[0] for row in matrix) else matrix


def _floats(rows: Rows) -> Array:
    return np.array([[float(x) for x in row] for row in rows]).reshape(len(rows), -1)


@explained
def weighted_sum(name: str, unit: str, terms: Iterable[tuple[Any, Output]]) -> Output:
    """Return the sum of outputs times numbers."""
    terms = [(Fraction(weight), output) for weight, output in terms]
    C, D, F = (_summed(terms, key) for key in "CDF")
    return Output(name, unit, C, D, F, together([(x, output.near) for x, output in terms]))


def together(terms: Sequence[tuple[Fraction, Remainder | None]]) -> Remainder | None:
    """Return what functions of the parameters add to a sum of rows, each times a number."""
    sources = [(weight, near.source) for weight, near in terms if near and near.source]
    if not sources:
        return None
    weights = [weight for weight, _ in sources]
    total = tuple(
        tuple(map(tuple, mix(weights, [list(map(list, M)) for M in matrices])))
        for matrices in zip(*(source.directions for _, source in sources), strict=True)
    )
    return Source(sources[0][1].functions, total).on_box


def _summed(terms: Sequence[tuple[Fraction, Output]], key: str) -> Rows:
    total: Rows = ()
    for weight, output in terms:
        weighted = tuple(tuple(weight * x for x in row) for row in getattr(output, key))
        if total and weighted:
            count = max(len(total), len(weighted))
            pairs = (rows * count if len(rows) == 1 else rows for rows in (total, weighted))
            total = tuple(
                tuple(a + b for a, b in zip(*both, strict=True))
                for both in zip(*pairs, strict=True)
            )
        else:
            total = total or weighted
    return total


def padded(output: Output, more: int, n: int = 0) -> Output:
    """Return the output for the plant of n states with ``more`` appended."""
    zeros = (Fraction(0),) * more
    near = output.near and output.near.mapped(
        lambda M: tuple((*row[:n], *zeros, *row[n:]) for row in M)
    )
    return replace(output, C=tuple((*row, *zeros) for row in output.C), near=near)


def with_inputs(output: Output, shape: tuple[int, int], more: int) -> Output:
    """Return the output for the plant of that shape with ``more`` inputs appended."""
    zeros, k = (Fraction(0),) * more, sum(shape)
    near = output.near and output.near.mapped(
        lambda M: tuple((*row[:k], *zeros, *row[k:]) for row in M)
    )
    return replace(output, D=tuple((*row, *zeros) for row in output.D), near=near)


@explained
def states(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return an output for every state, named as the plant names it, else x1, x2, ..."""
    return _plain(tuple(plant.states), "x", plant.shape[0], "C")


@explained
def inputs(plant: UncertainPlant) -> tuple[Output, ...]:
    """Return an output for every input, named as the plant names it, else u1, u2, ..."""
    return _plain(tuple(plant.inputs), "u", plant.shape[1], "D")


@lru_cache(maxsize=256)  # called often for one plant, and for plants with the same names
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
    """Return the rate of change of a state, such as the acceleration [m/s2] from a velocity.

    Raises
    ------
    InputError
        If there is no such state.
    """
    known = states(plant)
    signal = pick(known, state)
    i = known.index(signal)
    return Output(name or RATE + signal.name, unit or _rate_unit(signal), *rate_rows(plant, i))


def _rate_unit(signal: Signal) -> str:
    return _RATES.get(signal.unit) or f"{signal.unit or 1}/s"


def rate_rows(plant: UncertainPlant, state: int) -> tuple[Exact, Exact, Exact]:
    """Return rows C, D, F of a state's rate, one per vertex: the state's rows of A, B and E.

    In discrete time the rate is the change in a sample over its time.
    """
    A, B = (tuple(getattr(v, key)[state] for v in plant.vertices) for key in ("exact_A", "exact_B"))
    E = tuple(v.exact_E[state] for v in plant.vertices if v.exact_E is not None)
    T = plant.sample_time
    if T is None:
        return A, B, E
    A = tuple((*row[:state], row[state] - 1, *row[state + 1 :]) for row in A)
    A, B, E = (tuple(tuple(x / T for x in row) for row in M) for M in (A, B, E))
    return A, B, E


def without_inputs(plant: UncertainPlant, name: str) -> Output | None:
    """Return "NAME without inputs", C x + F w of a signal C x + D u + F w; None of another name.

    Raises
    ------
    InputError
        If there is no such signal, or nothing is left of it.
    """
    if not name.endswith(WITHOUT):
        return None
    whole = plant.signal(name.removesuffix(WITHOUT))
    if whole.near is not None:
        raise InputError(
            f"no signal {name!r}: {whole.name!r} holds functions of the parameters; give it "
            f'[sensor."{whole.name}"], and measure "measured {whole.name}"'
        )
    if not (whole.C or whole.F):
        raise InputError(f"no signal {name!r}: {whole.name!r} is inputs alone")
    return replace(whole, name=name, D=())


def rate_named(plant: UncertainPlant, name: str) -> Output | None:
    """Return the signal "rate of NAME" of a state, or of an input at a sample time.

    The rate of an input is that of the state that it is a sample later. None of another name.

    Raises
    ------
    InputError
        If the state's change is known only near, or an input has no rate.
    """
    own = name.removeprefix(RATE)
    known = [state.name for state in states(plant)]
    if own == name or own not in [*known, *(signal.name for signal in inputs(plant))]:
        return None
    if own not in known:
        state = own + LATE
        if state not in known:
            raise InputError(f"no signal {name!r}: {_no_rate(plant, own)}")
        signal = inputs(plant)[[signal.name for signal in inputs(plant)].index(own)]
        return rate_of(plant, state, name, _rate_unit(signal))
    near, i = plant.remainder, known.index(own)
    if near is not None and near.moves(i):
        raise InputError(
            f"no signal {name!r}: between its samples {own} is known only near; name the rate of "
            "an input"
        )
    return rate_of(plant, own, name)


def _no_rate(plant: UncertainPlant, name: str) -> str:
    """Say why an input has no rate."""
    if plant.period:
        return f"{name} acts at once, and is not held a sample before; take a delay of 1 sample"
    return f'{name} moves at once; give it [actuator."{name}"], or a sample time and a delay'


def rates_in(plant: UncertainPlant, output: Output) -> Array | None:
    """Return r (n,) if the output is r dx/dt for all parameters, else None.

    Accelerations of points of a body are such outputs, also as a share of a limit.
    """
    E = [vertex.E for vertex in plant.vertices if vertex.E is not None]
    matrices = [plant.A, plant.B, *([np.stack(E)] if E else [])]
    rates = np.concatenate(matrices, axis=2).swapaxes(0, 1).reshape(plant.shape[0], -1)
    row = np.concatenate(output.arrays(plant)[: len(matrices)], axis=1).ravel()
    size = np.maximum(np.abs(rates).max(axis=0), np.abs(row))
    used = size > 0
    if not row.any():
        return None
    rates, row = rates[:, used] / size[used], row[used] / size[used]
    r = np.linalg.lstsq(rates.T, row, rcond=None)[0]
    r = np.where(np.abs(r) > IDENTICAL * np.abs(r).max(), r, 0.0)
    r = np.array([float(f"{r:.12g}") for r in r])  # so that a single rate is exact
    return r if np.abs(r @ rates - row).max() <= IDENTICAL else None


def pick(known: Sequence[Output], name: str) -> Output:
    """Return the first output of that name.

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
    """Return outputs; names are looked up among the plant's signals.

    Parameters
    ----------
    signals : sequence of Output or str, optional
        All states and inputs by default.

    Raises
    ------
    InputError
        If a name is unknown, a signal is asked for twice, or none is asked for.
    """
    if signals is None:
        return (*states(plant), *inputs(plant))
    if isinstance(signals, str | Output):
        signals = (signals,)
    known = plant.signals
    chosen = tuple(s if isinstance(s, Output) else pick(known, str(s)) for s in signals)
    names = [s.name for s in chosen]
    twice = [name for name in names if names.count(name) > 1]
    if twice or not chosen:
        raise InputError(f"signal {twice[0]!r} is asked twice" if twice else "no signal is asked")
    return chosen


def output_matrices(
    plant: UncertainPlant,
    outputs: Sequence[Output],
    alpha: Array,
    K: Array,
    passing: Array | None = None,
) -> tuple[Array, Array]:
    """Return C + D K (..., p, n) and F + D P (..., p, q) of outputs in loops u = K x + P w.

    Parameters
    ----------
    alpha : (..., N) array
    K : (..., m, n) array
    passing : (..., m, q) array, optional
        P; zero by default.
    """
    C, D, F = rows_at(plant, outputs, alpha)
    return C + D @ K, F if passing is None else F + D @ passing


def rows_at(
    plant: UncertainPlant, outputs: Sequence[Output], alpha: Array
) -> tuple[Array, Array, Array]:
    """Return C (..., p, n), D (..., p, m) and F (..., p, q) of outputs at points alpha."""
    C, D, F = (np.tensordot(alpha, M, 1) for M in stacked(plant, outputs))
    n, m = plant.shape
    for k, output in enumerate(outputs):
        if output.near is not None:
            if plant.functions is not None and output.near.source is not None:
                matrices, weights = output.near.source.directions, beyond(plant.functions, alpha)
            else:
                matrices = output.near.curve
                weights = plant.domain.basis(alpha, output.near.degree)
            if not matrices:
                continue
            row = np.tensordot(weights, np.array(matrices, dtype=float), 1)[..., 0, :]
            for M, more in zip((C, D, F), np.split(row, [n, n + m], axis=-1), strict=True):
                M[..., k, :] += more
    return C, D, F


def stacked(plant: UncertainPlant, outputs: Sequence[Output]) -> tuple[Array, Array, Array]:
    """Return C (N, p, n), D (N, p, m) and F (N, p, q) of outputs at the vertices."""
    C, D, F = (
        np.stack(matrices, axis=1)
        for matrices in zip(*(output.arrays(plant) for output in outputs), strict=True)
    )
    return C, D, F
