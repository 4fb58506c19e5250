"""Larger plants: actuators, sensors, filters and the states of a law as states of the plant."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import (
    Output,
    disturbances,
    inputs,
    padded,
    pick,
    split,
    states,
    with_inputs,
)
from polefence.plant.parameters import exact
from polefence.plant.system import Exact, System
from polefence.proof.laws import OWN
from polefence.proof.matrices import ONE, ZERO
from polefence.proof.plant import WITHOUT
from polefence.proof.remainder import Remainder, Rows, Source

MOST_STATES, MOST_GIVEN = 20, 40  # bounds on the order of a law that is sought, or given
# Prefixes of the names of its states and signals.
LAW, INTEGRAL, FILTER = OWN
DERIVATIVE = "pid derivative of "
DEMAND, MEASURED = "demand of ", "measured "  # of an actuator's input; of a sensor's state
LATE_SIGNAL = "late "  # of a signal with a dead time


def as_read(name: str) -> tuple[str, ...]:
    """Return the names by which a law may read a signal: less its inputs, or by its sensor."""
    return name, f"{name}{WITHOUT}", f"{MEASURED}{name}", name.removeprefix(MEASURED)


def with_dynamics(
    plant: UncertainPlant, signals: Sequence[Output], a: Exact, b: Exact, labels: Sequence[str]
) -> UncertainPlant:
    """Return the plant with states z appended, z' = a z + b y, or z(t + T) in discrete time.

    Parameters
    ----------
    signals : sequence of Output
        y; inputs and disturbances may pass straight into them.
    a : (k, k) rationals
    b : (k, len(signals)) rationals
    labels : k names, with units
    """
    k, vertices = len(a), []
    rows_of = [signal.exact(plant) for signal in signals]
    for j, vertex in enumerate(plant.vertices):
        C, D, F = ([rows[letter][j] for rows in rows_of] for letter in range(3))
        A = [*((*row, *(ZERO,) * k) for row in vertex.exact_A)]
        A += [(*left, *right) for left, right in zip(_product(b, C), a, strict=True)]
        B = (*vertex.exact_B, *_product(b, D))
        E = None if vertex.exact_E is None else (*vertex.exact_E, *_product(b, F))
        vertices.append(System(tuple(A), B, E, vertex.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        states=(*labels_of(states(plant)), *labels),
        outputs=tuple(padded(output, k, plant.shape[0]) for output in plant.outputs),
        remainder=_beside(plant, signals, b),
    )


def _beside(plant: UncertainPlant, signals: Sequence[Output], b: Exact) -> Remainder | None:
    """Return the remainder of the plant with states appended that follow b times signals."""
    (n, m), k = plant.shape, len(b)
    remainder = plant.remainder and plant.remainder.padded(n, m, k)
    if plant.functions is None or not any(signal.near for signal in signals):
        return remainder
    width = n + k + m + plant.disturbance_count
    blank: Rows = ((ZERO,) * width,) * (n + k)
    count = len(plant.functions.trees)
    source = remainder and remainder.source
    known = source.directions if source else (blank,) * count
    wide = [padded(signal, k, n).near for signal in signals]
    following = []
    for j, M in enumerate(known):
        rows = [near.source.directions[j][0] if near and near.source else blank[0] for near in wide]
        following.append((*M[:n], *_product(b, rows)))
    return Source(plant.functions, tuple(following)).on_box


@explained
def with_actuator(
    plant: UncertainPlant, name: str, bandwidth: Any, order: int = 1, damping: Any = None
) -> UncertainPlant:
    """Return the plant with an actuator: the input becomes a state, and u demands it.

    With w = 2 pi bandwidth a force f follows its demand u by f' = w (u - f), or, of order 2, by
    f'' = w^2 (u - f) - 2 damping w f'. The state has the input's name and unit.

    Parameters
    ----------
    name : str
        Of the input.
    bandwidth : number
        [Hz]; for order 2 the natural frequency.
    order : 1 or 2
    damping : number, optional
        Damping ratio of an actuator of order 2; 0.7071 by default.

    Raises
    ------
    InputError
        If there is no input of this name, or a number is out of range.
    """
    where = f"actuator of {name!r}"
    i, actuated = _input(plant, name, where)
    w = _rate(bandwidth, where)
    if order not in (1, 2) or isinstance(order, bool):
        raise InputError(f"{where}: order = {shown(order)} must be 1 or 2")
    if order == 1 and damping is not None:
        raise InputError(f"{where}: damping belongs to order = 2; leave it out")
    order = int(order)
    ratio = Fraction("0.7071") if damping is None else _positive(damping, f"{where}: damping")
    a: Exact = ((-w,),)
    labels = [actuated.label]
    if order == 2:
        square = _rounded(float(w) ** 2)
        a = ((ZERO, ONE), (-square, -_rounded(2 * float(ratio * w))))
        labels.append(f"rate of {actuated.name} [{actuated.unit or 1}/s]")
    _require_continuous(plant, where)
    return _before(plant, i, a, -a[-1][0], labels)


def _before(
    plant: UncertainPlant, i: int, a: Exact, gain: Fraction, labels: Sequence[str]
) -> UncertainPlant:
    """Return the plant with dynamics before input i: z' = a z + (0, ..., gain) u, and z1 acts.

    In discrete time z(t + T) is in place of z'. The labels are of z, the first that of the input.
    """
    (n, m), order = plant.shape, len(a)
    require_new(plant, labels[1:])
    more, vertices = (ZERO,) * (order - 1), []
    for vertex in plant.vertices:
        force = [row[i] for row in vertex.exact_B]
        A = [(*row, x, *more) for row, x in zip(vertex.exact_A, force, strict=True)]
        A += [(*(ZERO,) * n, *row) for row in a]
        B = [(*row[:i], ZERO, *row[i + 1 :]) for row in vertex.exact_B]
        B += [_unit(m, i, gain if k == order - 1 else ZERO) for k in range(order)]
        E = vertex.exact_E
        E = None if E is None else (*E, *((ZERO,) * len(E[0]),) * order)
        vertices.append(System(tuple(A), tuple(B), E, vertex.name))
    demands = [f"{DEMAND}{u.label}" if j == i else u.label for j, u in enumerate(inputs(plant))]
    return replace(
        plant,
        vertices=tuple(vertices),
        states=(*labels_of(states(plant)), *labels),
        inputs=tuple(demands),
        outputs=tuple(_behind(plant, output, i, order) for output in plant.outputs),
        remainder=plant.remainder
        and plant.remainder.padded(n, m, order).mapped(lambda M: _moved(M, n + order + i, n)),
    )


def _moved(M: Rows, column: int, to: int) -> Rows:
    """Return rows with one column in place of another, and zeros in its own."""
    return tuple(
        tuple(row[column] if j == to else ZERO if j == column else x for j, x in enumerate(row))
        for row in M
    )


def _behind(plant: UncertainPlant, output: Output, i: int, order: int) -> Output:
    """Move an output's coefficient of input i to the first added state."""
    C, D, _ = output.exact(plant)
    more, n = (ZERO,) * (order - 1), plant.shape[0]
    near = padded(output, order, n).near
    return replace(
        output,
        C=[(*c, d[i], *more) for c, d in zip(C, D, strict=True)],
        D=[(*d[:i], ZERO, *d[i + 1 :]) for d in D],
        near=near and near.mapped(lambda M: _moved(M, n + order + i, n)),
    )


@explained
def with_sensor(
    plant: UncertainPlant, name: str, bandwidth: Any = None, noise: Any = None
) -> UncertainPlant:
    """Return the plant with a sensor: a state "measured NAME" that follows the signal.

    x' = w (y + v - x) with w = 2 pi bandwidth, y the signal, late if it has a dead time, and v
    white noise. The noise is a
    disturbance "noise of NAME". It is scaled so that the one-sided density 1 gives the rms
    ``noise`` in the sensor's output.

    Parameters
    ----------
    name : str
        Of a state or an output; an input or a disturbance may pass straight into it.
    bandwidth : number
        [Hz]
    noise : number, optional
        Rms in the sensor's output while the signal is zero [the signal's unit].

    Raises
    ------
    InputError
        If there is no such signal, it has a sensor already, or a number is out of range.
    """
    where = f"sensor of {name!r}"
    known = (*states(plant), *plant.every_output)
    try:
        signal = pick(known, split(str(name))[0])
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    late = [output for output in plant.outputs if output.name == f"{LATE_SIGNAL}{signal.name}"]
    if bandwidth is None:
        why = "bandwidth is missing" if noise is None else "noise without a bandwidth has no rms"
        raise InputError(f"{where}: {why}; give bandwidth, in Hz")
    w = _rate(bandwidth, where)
    label = _labelled(f"{MEASURED}{signal.name}", signal.unit)
    if label in plant.states:
        raise InputError(f"{where}: {signal.name} has a sensor already; keep one")
    _require_continuous(plant, where)
    require_new(plant, (label,))
    larger = with_dynamics(plant, (*late, signal)[:1], ((-w,),), ((w,),), (label,))
    if noise is None:
        return larger
    # x' = -w x + e v, v of two-sided density 1/2, has the variance e^2 / (4 w)
    size = _positive(noise, f"{where}: noise")
    return _with_noise(larger, f"noise of {signal.name}", _rounded(2 * float(size) * math.sqrt(w)))


def sensors(plant: UncertainPlant) -> tuple[str, ...]:
    """Return the names of the states that are what sensors say."""
    return tuple(state.name for state in states(plant) if state.name.startswith(MEASURED))


def sensed(plant: UncertainPlant, names: Iterable[str]) -> dict[str, str]:
    """Return what the sensors of these signals say, by the signals' names; of those without, none.

    A law that measures such a signal by its own name knows it free of lag and noise.
    """
    said = {name: f"{MEASURED}{split(name)[0]}" for name in names}
    return {name: state for name, state in said.items() if state in sensors(plant)}


def _with_noise(plant: UncertainPlant, label: str, size: Fraction) -> UncertainPlant:
    """Return the plant with noise that acts on its last state."""
    last = plant.shape[0] - 1
    larger = with_disturbance(plant, label, _unit(last + 1, last, size))
    return replace(larger, noise=(*plant.noise, label))


def with_disturbance(
    plant: UncertainPlant, label: str, column: Sequence[Fraction]
) -> UncertainPlant:
    """Return the plant with one more disturbance, of this column of E."""
    name = split(label)[0]
    if name in [known.name for known in disturbances(plant)]:
        raise InputError(f"{plant.name} has a disturbance {name!r} already; rename it")
    vertices = []
    for vertex in plant.vertices:
        rows = vertex.exact_E or ((),) * plant.shape[0]
        E = tuple((*row, x) for row, x in zip(rows, column, strict=True))
        vertices.append(System(vertex.exact_A, vertex.exact_B, E, vertex.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        disturbances=(*labels_of(disturbances(plant)), label),
        outputs=tuple(map(beside_disturbance, plant.outputs)),
        remainder=plant.remainder and plant.remainder.mapped(_wider),
    )


def beside_disturbance(output: Output) -> Output:
    """Return the output for the plant with one more disturbance."""
    near = output.near and output.near.mapped(_wider)
    return replace(output, F=_wider(output.F), near=near)


def _wider(M: Rows) -> Rows:
    return tuple((*row, ZERO) for row in M)


def with_states(plant: UncertainPlant, count: int) -> UncertainPlant:
    """Return the plant with states x_c of its law appended, x_c' = u_c with inputs u_c.

    A gain of the larger plant is a law of order ``count``: its blocks are A_c, B_c, C_c and D_c.
    In discrete time u_c = (x_c(t + T) - x_c(t)) / T, so that the blocks are those of the delta
    form.

    Parameters
    ----------
    count : int
        0 to `MOST_GIVEN`.

    Raises
    ------
    InputError
        If it is out of range, or a signal has the name of one of the states.
    """
    require_order(count, MOST_GIVEN)
    if not count:
        return plant
    labels = law_states(count)
    require_new(plant, (*labels, *law_rates(count)))
    vertices, (n, m), (stays, step) = [], plant.shape, _alone(plant)
    for vertex in plant.vertices:
        A = [(*row, *(ZERO,) * count) for row in vertex.exact_A]
        A += [_unit(n + count, n + i, stays) for i in range(count)]
        B = [(*row, *(ZERO,) * count) for row in vertex.exact_B]
        B += [_unit(m + count, m + i, step) for i in range(count)]
        E = vertex.exact_E
        E = None if E is None else (*E, *((ZERO,) * len(E[0]),) * count)
        vertices.append(System(tuple(A), tuple(B), E, vertex.name))
    outputs = (padded(y, count, n) for y in plant.outputs)
    return replace(
        plant,
        vertices=tuple(vertices),
        states=(*labels_of(states(plant)), *labels),
        inputs=(*labels_of(inputs(plant)), *law_rates(count)),
        outputs=tuple(with_inputs(y, (n + count, m), count) for y in outputs),
        remainder=plant.remainder and plant.remainder.padded(n, m, count, count),
    )


def with_rates_as_inputs(plant: UncertainPlant, count: int) -> UncertainPlant:
    """Return the plant with the rates of its last states as inputs, in place of their dynamics."""
    (n, m), (stays, step) = plant.shape, _alone(plant)
    more, vertices = (ZERO,) * count, []
    rates = (f"rate of {vertex.name}" for vertex in states(plant)[n - count :])
    for vertex in plant.vertices:
        A = (*vertex.exact_A[: n - count], *(_unit(n, n - count + i, stays) for i in range(count)))
        B = [(*row, *more) for row in vertex.exact_B[: n - count]]
        B += [_unit(m + count, m + i, step) for i in range(count)]
        E = vertex.exact_E  # what passes into the rates comes through the inputs then
        E = None if E is None else (*E[: n - count], *((ZERO,) * len(E[0]),) * count)
        vertices.append(System(A, tuple(B), E, vertex.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        inputs=(*labels_of(inputs(plant)), *rates),
        outputs=tuple(with_inputs(y, (n, m), count) for y in plant.outputs),
        remainder=plant.remainder and plant.remainder.padded(n, m, 0, count),
    )


def _alone(plant: UncertainPlant) -> tuple[Fraction, Fraction]:
    """Return A and B of one state x_c' = u_c, or x_c(t + T) = x_c + T u_c in discrete time."""
    return (ZERO, ONE) if plant.sample_time is None else (ONE, plant.sample_time)


def law_states(count: int) -> tuple[str, ...]:
    """Return the names of the states of a law."""
    return tuple(f"{LAW}{i + 1}" for i in range(count))


def law_rates(count: int) -> tuple[str, ...]:
    """Return the names of the inputs that are the rates of the states of a law."""
    return tuple(f"rate of {LAW}{i + 1}" for i in range(count))


def own_states(plant: UncertainPlant) -> int:
    """Return the number of last states that belong to a law, with their rates as last inputs.

    They are recognised by their names, and by the matrices of `with_states`: u_c alone moves x_c,
    and neither acts on anything else.
    """
    names = [state.name for state in states(plant)], [u.name for u in inputs(plant)]
    count = 0
    for state, rate in zip(*map(reversed, names), strict=False):
        if not state.startswith(OWN) or rate != f"rate of {state}":
            break
        count += 1
    n, m = plant.shape
    if not 0 < count < min(n, m):
        return 0
    stays, step = _alone(plant)
    return count if all(_apart(v, count, stays, step) for v in plant.vertices) else 0


def _apart(vertex: System, count: int, stays: Fraction, step: Fraction) -> bool:
    """Whether the last inputs are the rates of the last states, and neither acts on the rest."""
    (n, m), A, B = vertex.shape, vertex.exact_A, vertex.exact_B
    rows = [(A[i], B[i]) for i in range(n - count, n)]
    alone = all(
        tuple(a) == _unit(n, n - count + i, stays) and tuple(b) == _unit(m, m - count + i, step)
        for i, (a, b) in enumerate(rows)
    )
    others = zip(A[: n - count], B[: n - count], strict=True)
    driven = any(any(row) for row in (vertex.exact_E or ())[n - count :])
    return alone and not driven and not any(any(a[n - count :] + b[m - count :]) for a, b in others)


def require_order(count: Any, most: int = MOST_STATES) -> None:
    """Refuse an order of a law unless it is a whole number from 0 to ``most``."""
    if isinstance(count, bool) or not isinstance(count, int):
        raise InputError(f"order = {shown(count)} must be a whole number")
    if not 0 <= count <= most:
        raise InputError(f"order = {count} must be 0 to {most}")


def with_pid(
    plant: UncertainPlant, signals: Sequence[Output], bandwidth: Any
) -> tuple[UncertainPlant, tuple[str, ...]]:
    """Return the plant with integrals and filtered derivatives, and the names that a PID measures.

    The derivative is w (y - z) with z' = w (y - z), w = 2 pi bandwidth. In discrete time y is held
    over a sample: the integral then grows by T y, and z by (1 - exp(-w T)) (y - z). The derivative
    is this growth of z over T.

    Parameters
    ----------
    signals : sequence of Output
        No input passes into one.
    bandwidth : number
        [Hz]

    Returns
    -------
    plant : UncertainPlant
    names : tuple of str
        The signals, then their integrals, then their derivatives.

    Raises
    ------
    InputError
        If the bandwidth is not positive, in discrete time above half the samples' frequency, or a
        state has one of the names.
    """
    w, r, n = _filter_rate(plant, bandwidth), len(signals), plant.shape[0]
    stays, step = _alone(plant)
    integrating = tuple(_unit(r, i, step) for i in range(r))
    integrals = [_labelled(f"{INTEGRAL}{y.name}", f"{y.unit} s".strip()) for y in signals]
    filtered = [_labelled(f"{FILTER}{y.name}", y.unit) for y in signals]
    kept = [*(stays,) * r, *(stays - step * w,) * r]
    a = tuple(_unit(2 * r, i, value) for i, value in enumerate(kept))
    b = (*integrating, *(_unit(r, i, step * w) for i in range(r)))
    require_new(plant, (*integrals, *filtered))
    larger = with_dynamics(plant, signals, a, b, (*integrals, *filtered))
    derivatives = []
    for i, signal in enumerate(signals):
        C, _, F = signal.exact(plant)
        rows = [(*(w * x for x in row), *_unit(2 * r, r + i, -w)) for row in C]
        through = [[w * x for x in row] for row in F] if signal.F else ()
        unit = f"{signal.unit or 1}/s"
        derivatives.append(Output(f"{DERIVATIVE}{signal.name}", unit, rows, F=through))
    larger = replace(larger, outputs=(*larger.outputs, *derivatives))
    names = [signal.name for signal in signals]
    names += [state.name for state in states(larger)[n : n + r]]
    return larger, (*names, *(signal.name for signal in derivatives))


def _input(plant: UncertainPlant, name: str, where: str) -> tuple[int, Output]:
    known = inputs(plant)
    names = [signal.name for signal in known]
    word = split(str(name))[0]
    if word not in names:
        raise InputError(f"{where}: no input {word!r}; {suggest(word, names)}")
    return names.index(word), known[names.index(word)]


def _filter_rate(plant: UncertainPlant, bandwidth: Any) -> Fraction:
    """Return the rate of a filter of a bandwidth [1/s]: in discrete time (1 - exp(-w T)) / T."""
    where, T = "pid: derivative", plant.period
    w = _rate(bandwidth, where)
    if not T:
        return w
    if _positive(bandwidth, where) > 1 / (2 * T):
        raise InputError(
            f"{where}: bandwidth = {shown(bandwidth)} is above half the samples' frequency, "
            f"{float(1 / (2 * T)):g} Hz; give a lower one"
        )
    return _rounded(-math.expm1(-float(w * T)) / float(T))


def _require_continuous(plant: UncertainPlant, where: str) -> None:
    if plant.period:
        raise InputError(
            f"{where}: {plant.name} is in discrete time, actuators and sensors are of continuous "
            "time: write them into its matrices"
        )


def require_new(plant: UncertainPlant, labels: Sequence[str]) -> None:
    """Refuse labels of which the plant has a signal of the name already."""
    known = [signal.name for signal in (*states(plant), *inputs(plant), *plant.outputs)]
    for label in labels:
        if split(label)[0] in known:
            raise InputError(f"{plant.name} has a signal {split(label)[0]!r} already; rename it")


def _rate(bandwidth: Any, where: str) -> Fraction:
    """Return 2 pi times a bandwidth in Hz [rad/s]."""
    return _rounded(2 * math.pi * float(_positive(bandwidth, f"{where}: bandwidth")))


def _positive(value: Any, what: str) -> Fraction:
    number = exact(value, what)
    if number <= 0:
        raise InputError(f"{what} = {shown(value)} must be a positive number")
    return number


def _rounded(value: float) -> Fraction:
    return Fraction(f"{value:.12g}")


def _labelled(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def labels_of(signals: Sequence[Any]) -> tuple[str, ...]:
    """Return names and units of signals."""
    return tuple(signal.label for signal in signals)


def _unit(width: int, place: int, value: Fraction) -> tuple[Fraction, ...]:
    return tuple(value if j == place else ZERO for j in range(width))


def _product(b: Exact, rows: Sequence[Sequence[Fraction]]) -> Exact:
    """Return b times a matrix of rows."""
    columns = list(zip(*rows, strict=True))
    return tuple(
        tuple(sum((x * y for x, y in zip(row, column, strict=True)), ZERO) for column in columns)
        for row in b
    )
