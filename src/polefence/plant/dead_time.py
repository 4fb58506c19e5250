"""Dead times of signals, as states of a larger plant and a parameter for what these leave out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, shown
from polefence.base.explained import explained
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import DEMAND, LATE_SIGNAL, labels_of, require_new
from polefence.plant.outputs import Output, inputs, pick, split, states
from polefence.plant.parameters import Parameter, exact
from polefence.plant.system import Exact, System
from polefence.proof.dead_time import LARGEST, ORDERS, Covering, DeadTime
from polefence.proof.matrices import ONE, ZERO
from polefence.proof.ranges import ANY
from polefence.proof.work import FormatError

DELTA, TIME = "delta", "dead_time"  # parameters: what states leave out; a dead time in an interval
ORDER = 4
# Of the delay margin of 1/s, with one loop, this floor costs less than 0.1 % at every order.
FLOOR = Fraction(1, 8)
USUAL = 8  # the decay rate for which the bound holds, by default: 1 over so many dead times
MARGIN = 1.001  # of the gain over what a grid of frequencies needs


@explained
def with_dead_time(
    plant: UncertainPlant, name: str, time: Any, order: int = ORDER, decay: Any = None
) -> UncertainPlant:
    """Return the plant in which a signal acts, or is measured, some time late.

    The dead time is a transfer function of so many states, and a parameter "delta" of any rate for
    all that it leaves out. What is proved for every delta holds for the dead time itself. An input
    acts late; a state or an output gets a signal "late NAME", which its sensor follows.

    Parameters
    ----------
    name : str
        Of an input, a state or an output.
    time : number, or two
        [s]; two are the ends of an interval, in which it is constant.
    order : int
        1 to 8: how many states.
    decay : number, optional
        [1/s]; the largest decay rate that can be proved, 1 / (8 time) by default. The faster, the
        more is left out.

    Raises
    ------
    InputError
        If there is no such signal, the plant is of a kind that has none, or a number is out of
        range.
    """
    where = f"dead time of {name!r}"
    _require_plant(plant, where)
    low, high = _ends(time, where)
    if isinstance(order, bool) or not isinstance(order, int) or not ORDERS[0] <= order <= ORDERS[1]:
        raise InputError(f"{where}: order = {shown(order)} must be {ORDERS[0]} to {ORDERS[1]}")
    rate = 1 / (USUAL * high) if decay is None else exact(decay, f"{where}: decay")
    if not 0 <= rate * high <= LARGEST:
        raise InputError(
            f"{where}: decay = {float(rate):g} must be 0 to {float(LARGEST / high):g} 1/s, "
            f"{LARGEST} over the dead time"
        )
    covering = covering_of(order, rate * high)
    signal, column = _signal(plant, split(str(name))[0], where)
    label, n = signal.name, plant.shape[0]
    dead_time = DeadTime(label, low, n, order, rate, covering.floor, covering.gain)
    parameters = plant.parameters
    if low < high:
        own = f"dead time of {label}"
        parameters = (*parameters, Parameter(TIME, low, high, "s", f"1/{TIME}", own))
        dead_time = replace(dead_time, time=TIME)
    what = f"what {order} states leave out of it"
    delta = Parameter(DELTA, -ONE, ONE, "", "", what, ANY, dead_time)
    ends = [(T, d) for T in ([low, high] if low < high else [low]) for d in (-ONE, ONE)]
    larger = _larger(plant, (signal, column), covering, ends)
    return replace(larger, parameters=(*parameters, delta))


def _require_plant(plant: UncertainPlant, where: str) -> None:
    if plant.period:
        raise InputError(
            f"{where}: {plant.name} is in discrete time; samples on their way are states of it, "
            "write them into its matrices"
        )
    if plant.moving:
        moving = plant.moving[0]
        had = "has a dead time already; add up those in series, one is provided for"
        why = had if moving.dead_time else f"{moving.name} moves; leave out its rate"
        raise InputError(f"{where}: {plant.name if moving.dead_time else 'parameter'} {why}")
    if plant.remainder is not None or plant.functions is not None:
        raise InputError(
            f"{where}: entries of {plant.name} are functions of the parameters that are not "
            "multi-affine; a dead time is provided for without them"
        )
    if len(plant.vertices) > 1 and not plant.parameters:
        raise InputError(f"{where}: {plant.name} has vertices, and no parameters; give parameters")


def _ends(time: Any, where: str) -> tuple[Fraction, Fraction]:
    several = isinstance(time, Sequence) and not isinstance(time, str)
    ends = list(time) if several else [time, time]
    if len(ends) != 2:
        raise InputError(f"{where}: time must be a number, or two: [shortest, longest]")
    low, high = (exact(end, f"{where}: time") for end in ends)
    if not 0 < low <= high:
        said = ", ".join(f"{float(end):g}" for end in (low, high))
        raise InputError(f"{where}: time = [{said}] must be positive, the smaller bound first")
    return low, high


def _signal(plant: UncertainPlant, name: str, where: str) -> tuple[Output, int | None]:
    """Return what is late, and the number of the input that it is."""
    known = inputs(plant)
    for i, signal in enumerate(known):
        if signal.name in (name, f"{DEMAND}{name}"):
            return signal, i
    try:
        return pick((*states(plant), *plant.every_output), name), None
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _larger(
    plant: UncertainPlant,
    late: tuple[Output, int | None],
    covering: Covering,
    ends: Sequence[tuple[Fraction, Fraction]],
) -> UncertainPlant:
    """Return the plant at every dead time and delta, without their parameters."""
    (signal, column), n, (F, g, c, b) = late, covering.order, covering.chain
    names = [f"dead time {k + 1} of {signal.name}" for k in range(n)]
    named = [] if column is not None else [f"{LATE_SIGNAL}{signal.name}"]
    require_new(plant, (*names, *named))
    rows = {y.name: y.exact(plant) for y in (signal, *plant.outputs)}
    vertices, found = list[System](), {key: list[list[Any]]() for key in (*rows, "")}
    for j, (vertex, (T, delta)) in enumerate(itertools.product(plant.vertices, ends)):
        old = j // len(ends)
        passed = [x + delta * y for x, y in zip(c, b, strict=True)]
        straight = delta * covering.gain

        entering = [ZERO if column is None else row[column] for row in vertex.exact_B]
        C, D, E = (key[old] for key in rows[signal.name])
        A = [(*row, *_times(h, passed)) for row, h in zip(vertex.exact_A, entering, strict=True)]
        B = [
            _put(row, column, straight * h) for row, h in zip(vertex.exact_B, entering, strict=True)
        ]
        A += [
            (*(x * y / T for x in C), *(x / T for x in line)) for line, y in zip(F, g, strict=True)
        ]
        B += [[x * y / T for x in D] for y in g]
        driven = vertex.exact_E
        if driven is not None:
            driven = (*driven, *(tuple(x * y / T for x in E) for y in g))
        vertices.append(System(tuple(A), tuple(map(tuple, B)), driven, f"vertex {j + 1}"))
        for y in plant.outputs:
            C_y, D_y, F_y = (key[old] for key in rows[y.name])
            h = ZERO if column is None else D_y[column]
            found[y.name].append([(*C_y, *_times(h, passed)), _put(D_y, column, straight * h), F_y])
        found[""].append(
            [(*(straight * x for x in C), *passed), *([straight * x for x in M] for M in (D, E))]
        )
    outputs = []
    kept = [(y.name, y.unit) for y in plant.outputs]
    for label, unit in (*kept, *((name, signal.unit) for name in named)):
        rows_C, rows_D, rows_F = zip(*found.get(label, found[""]), strict=True)
        outputs.append(Output(label, unit, rows_C, rows_D, rows_F))
    return replace(
        plant,
        vertices=tuple(vertices),
        parameters=(),
        states=(*labels_of(states(plant)), *names),
        outputs=tuple(outputs),
    )


def on_time(plant: UncertainPlant) -> tuple[UncertainPlant, Fraction]:
    """Return the plant whose input acts at once, and how late it does; zero without a dead time.

    Raises
    ------
    InputError
        Of a dead time that samples do not hold: in an interval, of a signal, of one input of many.
    """
    if plant.dead_time is None:
        return plant, ZERO
    number, dead_time = plant.dead_time
    where = f"dead time of {dead_time.signal!r}"
    if isinstance(dead_time.time, str):
        raise InputError(f"{where}: samples hold one time, not an interval; give a number")
    if [signal.name for signal in inputs(plant)] != [dead_time.signal]:
        raise InputError(
            f"{where}: samples hold that of the only input; leave out [dead_time], and delay the "
            "input by as much"
        )
    kept = [i for i in range(plant.shape[0]) if i not in dead_time.states]
    bit = 1 << (len(plant.parameters) - 1 - number)
    old = [j for j in range(len(plant.vertices)) if j & bit]  # those of delta = 1
    gain = dead_time.gain

    def rows(
        states: Sequence[Sequence[Fraction]], entering: Sequence[Sequence[Fraction]]
    ) -> tuple[Exact, Exact]:
        inner = tuple(tuple(row[i] for i in kept) for row in states)
        return inner, tuple(tuple(x / gain for x in row) for row in entering)

    vertices = []
    for number, j in enumerate(old, 1):
        vertex, E = plant.vertices[j], plant.vertices[j].exact_E
        A, B = rows([vertex.exact_A[i] for i in kept], [vertex.exact_B[i] for i in kept])
        driven = None if E is None else tuple(E[i] for i in kept)
        vertices.append(System(A, B, driven, f"vertex {number}"))
    outputs = []
    for y in plant.outputs:
        C, D, F = ([every[j] for j in old] for every in y.exact(plant))
        outputs.append(Output(y.name, y.unit, *rows(C, D), F if plant.disturbance_count else ()))
    parameters = tuple(p for p in plant.parameters if p.dead_time is None)
    less = replace(
        plant,
        vertices=tuple(vertices),
        parameters=parameters,
        states=tuple(labels_of(states(plant))[i] for i in kept),
        outputs=tuple(outputs),
    )
    return less, dead_time.time


def _times(factor: Fraction, row: Sequence[Fraction]) -> list[Fraction]:
    return [factor * x for x in row]


def _put(row: Sequence[Fraction], column: int | None, value: Fraction) -> list[Fraction]:
    """Return a row with a value in a column; None: as it is."""
    return [value if k == column else x for k, x in enumerate(row)]


def covering_of(order: int, shift: Fraction) -> Covering:
    """Return N, D and M of an order that cover a dead time, right of Re s = -shift.

    Raises
    ------
    InputError
        If none is found.
    """
    N, D = Covering(order, shift, FLOOR, ONE).pade
    # beyond the first frequencies, where differences of floats say nothing and little is left out
    w = np.linspace(order / 2, 40 * (order + 1), 4000 * order)
    s = -float(shift) + 1j * w
    left = np.abs(np.exp(-s) * _value(D, s) - _value(N, s))
    needed = float((left / np.abs(1j * w + float(FLOOR)) ** order).max() / float(D[-1]))
    gain = Fraction(math.ceil(needed * MARGIN * 1000), 1000)
    covering = Covering(order, shift, FLOOR, gain)
    if covering.is_sound:
        return covering
    raise InputError(
        f"no bound of order {order} for a decay of {float(shift):g} over the dead time"
    )


def _value(P: Sequence[Fraction], s: Any) -> Any:
    return sum(float(x) * s**k for k, x in enumerate(P))


def require_sound(plant: UncertainPlant) -> None:
    """Refuse a plant in which a dead time does not stand as its parameter says.

    Raises
    ------
    PlantError
    """
    if any(p.dead_time is not None for p in plant.parameters):
        try:
            _ = file_plant(plant).late
        except FormatError as error:
            raise PlantError(str(error)) from error
