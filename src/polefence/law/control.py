"""Plants and laws to and from python-control; needs the extra ``polefence[control]``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from polefence.base.errors import (
    InputError,
    MissingExtraError,
    ParameterValueError,
    PlantError,
    shown,
    suggest,
)
from polefence.base.explained import explained
from polefence.law.laws import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, rows_at, split, states
from polefence.plant.system import Array, System, floats
from polefence.plant.transfer import quotient, realised
from polefence.proof.text import plural

_NUMBERED = re.compile(r"(sys|[xuy])\[\d+\]")  # what python-control calls that which has no name

GIVEN = ("parameters", "alpha")


def _control() -> Any:
    try:
        import control
    except ImportError as error:
        raise MissingExtraError(
            "python-control is not installed; pip install 'polefence[control]'"
        ) from error
    return control


@explained
def from_control(
    systems: Any,
    disturbances: int | str | Sequence[str] = 0,
    name: str = "",
    *,
    controls: int | str | Sequence[str] | None = None,
    measured: int | str | Sequence[str] = 0,
) -> UncertainPlant:
    """Return the polytope whose vertices are python-control ``StateSpace`` systems.

    A generalised plant, from [w; u] to [z; y] as ``hinfsyn`` has it, is
    ``from_control(P, controls=nu, measured=ny)``.

    Parameters
    ----------
    systems : control.StateSpace, TransferFunction, or sequence of StateSpace
        One, or one a vertex: all of one shape, in continuous time or of one sample time. States and
        inputs keep the names that they were given, and so do the outputs y = C x + D u + F w; those
        that are one state or one input, or nothing at all, are left out. A transfer function is
        realised with as few states as it has.
    disturbances : int or sequence of str
        Which inputs are disturbances (columns of E) rather than controls: how many of the last
        ones, or their names, wherever they are among the inputs.
    name : str
        Of the plant; by default that of the first system, where it was given one.
    controls : int or sequence of str, optional
        In place of ``disturbances``, which inputs are controls: how many of the last ones, or
        their names; all others are disturbances.
    measured : int or sequence of str
        Which outputs a law is to measure: how many of the last ones, or their names. All outputs
        are kept then, one state or input too. Where python-control has only numbered them they
        have the names y1, y2 and so on, and those that are not measured z1, z2 and so on.

    Raises
    ------
    PlantError
        If a system is of another kind, of another time or other names than the first, has no
        input or output of a name that is given, or no control input is left.
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    try:
        given = [systems] if isinstance(systems, control.InputOutputSystem) else list(systems)
    except TypeError as error:
        raise PlantError(
            f"systems must be a control.StateSpace, or a list of them; got {shown(systems)}"
        ) from error
    if not given:
        raise PlantError("a plant needs at least one vertex")
    if len(given) == 1 and isinstance(given[0], control.TransferFunction):
        given = [_realised(control, given[0])]
    for j, system in enumerate(given):
        _require_vertex(control, system, given[0], f"system {j + 1}")
    first = given[0]
    us, others = _columns(first, disturbances, controls)
    ys = _chosen(first.output_labels, measured, "measured", "output")
    labels = _names(first.input_labels)
    plant = UncertainPlant.from_vertices(
        [s.A for s in given],
        [s.B[:, us] for s in given],
        [s.B[:, others] for s in given] if others else None,
        name=name or _own([first.name], "plant"),
        states=_names(first.state_labels),
        inputs=_some(labels, us),
        disturbances=_some(labels, others),
        sample_time=first.dt or None,
    )
    return replace(plant, outputs=tuple(_outputs(plant, given, us, others, ys)))


def _realised(control: Any, system: Any) -> Any:
    """Return a transfer function as a ``StateSpace`` with the same names."""
    rows = [
        [quotient(top, bottom, "systems") for top, bottom in zip(tops, bottoms, strict=True)]
        for tops, bottoms in zip(system.num, system.den, strict=True)
    ]
    matrices = [np.array([[float(x) for x in row] for row in M]) for M in realised(rows, "systems")]
    labels = {"inputs": system.input_labels, "outputs": system.output_labels}
    return control.ss(*matrices, system.dt, name=system.name, **labels)


def _chosen(
    labels: Sequence[str], which: int | str | Sequence[str], key: str, what: str
) -> list[int]:
    """Return places of the last signals, by their number, or of named ones."""
    if isinstance(which, int | np.integer):
        if not 0 <= which <= len(labels):
            raise PlantError(
                f"{key} = {which} of {plural(len(labels), what)}; give how many of the last ones, "
                "or their names"
            )
        return list(range(len(labels) - which, len(labels)))
    names, known = [which] if isinstance(which, str) else list(which), list(labels)
    for name in names:
        if name not in known:
            raise PlantError(f"{key}: no {what} {name!r}; {suggest(str(name), known)}")
    return [known.index(name) for name in dict.fromkeys(names)]


def _columns(
    system: Any,
    disturbances: int | str | Sequence[str],
    controls: int | str | Sequence[str] | None,
) -> tuple[list[int], list[int]]:
    """Return which inputs are controls, and which disturbances."""
    count, labels = system.ninputs, system.input_labels
    if controls is not None:
        if not isinstance(disturbances, int) or disturbances:
            raise PlantError("controls names the inputs already; leave out disturbances")
        us = _chosen(labels, controls, "controls", "input")
        if not us:
            raise PlantError("controls names no input; one at least must be a control")
        return us, [k for k in range(count) if k not in us]
    if isinstance(disturbances, int | np.integer) and not 0 <= disturbances < count:
        raise PlantError(
            f"disturbances = {disturbances} of {plural(count, 'input')} leaves no control "
            "input; give how many of the last ones are, or their names"
        )
    others = _chosen(labels, disturbances, "disturbances", "input")
    us = [k for k in range(count) if k not in others]
    if not us:
        raise PlantError("disturbances names every input; one at least must be a control")
    return us, others


def _some(labels: tuple[str, ...], columns: Sequence[int]) -> tuple[str, ...]:
    return tuple(labels[k] for k in columns) if labels else ()


def _outputs(
    plant: UncertainPlant,
    systems: Sequence[Any],
    controls: list[int],
    others: list[int],
    measured: list[int],
) -> Iterator[Output]:
    """Yield the systems' outputs, under their names; plain ones where some are measured."""
    known = {signal.name: signal for signal in plant.signals}
    plain = {(signal.C, signal.D, signal.F) for signal in plant.signals}
    counts = {True: 0, False: 0}  # of those that are measured, and of others
    for i, label in enumerate(systems[0].output_labels):
        blocks: dict[str, Any] = {"C": [s.C[i] for s in systems]}
        blocks["D"] = [s.D[i, controls] for s in systems]
        blocks["F"] = [s.D[i, others] for s in systems if others]
        own = i in measured
        counts[own] += 1
        if not any(np.any(row) for rows in blocks.values() for row in rows):
            if own:
                raise PlantError(f"output {label!r} is zero, and nothing to measure")
            continue
        numbered = f"{'y' if own else 'z'}{counts[own]}" if measured else r"output \1"
        name, unit = split(re.sub(r"^y\[(\d+)\]$", numbered, label))
        output = Output(name, unit, **blocks)
        rows = output.C, output.D, output.F
        if name in known and rows != (known[name].C, known[name].D, known[name].F):
            raise PlantError(f"output {name!r} has the name of a state or an input; rename it")
        if name not in known and (measured or rows not in plain):
            yield output


def _require_vertex(control: Any, system: Any, first: Any, where: str) -> None:
    if not isinstance(system, control.StateSpace):
        kind = type(system).__name__
        same = isinstance(system, control.TransferFunction)
        more = ", in the same states as the others" * same
        raise PlantError(f"{where} is a {kind}, not a StateSpace; control.ss() makes one{more}")
    if system.dt is True:
        raise PlantError(f"{where} is in discrete time without a sample time; give its dt [s]")
    if (system.dt or 0) != (first.dt or 0):
        raise PlantError(f"{where} has dt = {system.dt}, system 1 {first.dt}; they must agree")
    if system.nstates < 1:
        raise PlantError(f"{where} has no states, and so no poles")
    if system.ninputs != first.ninputs:
        raise PlantError(f"{where} has {system.ninputs} inputs, system 1 {first.ninputs}")
    if system.noutputs != first.noutputs:
        raise PlantError(f"{where} has {system.noutputs} outputs, system 1 {first.noutputs}")
    for key in ("state_labels", "input_labels", "output_labels"):
        names, others = getattr(system, key), getattr(first, key)
        if len(names) == len(others) and _names(names) and _names(names) != _names(others):
            raise PlantError(f"{where} names other signals than system 1: {', '.join(names)}")


def _names(labels: Sequence[str]) -> tuple[str, ...]:
    """Return names, none where python-control has only numbered the signals."""
    return () if all(map(_NUMBERED.fullmatch, labels)) else tuple(labels)


def _own(labels: Sequence[str], otherwise: str) -> str:
    return "".join(_names(labels)) or otherwise


@explained
def to_control(plant: UncertainPlant | System, alpha: Any = None, outputs: bool = False) -> Any:
    """Return a plant, or one vertex of it, as a python-control ``StateSpace``.

    Parameters
    ----------
    plant : UncertainPlant or System
        A `System` has no names.
    alpha : sequence of N numbers, optional
        The point of the polytope, for example ``plant.alpha(m1=300, beta=2)``; may be left out
        where there is one vertex.
    outputs : bool
        Give the plant's outputs too, behind the states.

    Returns
    -------
    control.StateSpace
        Inputs [u, w], outputs the states, under the names that `Design.to_control` has too, so that
        the two interconnect by name.

    Raises
    ------
    ParameterValueError
        If alpha is missing or no point of the polytope.
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    if isinstance(plant, System):
        plant = UncertainPlant((plant,), name=plant.name)
    weights = _point(plant, alpha)
    A, B = plant.at(weights)
    if plant.vertices[0].E is not None:
        B = np.hstack([B, plant.driven(weights)])
    n, (x, u, w) = len(A), signal_names(plant)
    C, D = np.eye(n), np.zeros((n, B.shape[1]))
    more = plant.every_output if outputs else ()
    if more:
        added = np.concatenate(rows_at(plant, more, weights), axis=1)
        C, D = np.vstack([C, added[:, :n]]), np.vstack([D, added[:, n:]])
    names = (output.name for output in more)
    y = valid_names((*u, *w, *x, *names))[len(u) + len(w) :]
    labels: dict[str, Any] = {"states": x, "outputs": y, "inputs": [*u, *w]}
    dt = 0 if plant.sample_time is None else float(plant.sample_time)
    (name,) = valid_names([plant.name])
    return control.ss(A, B, C, D, dt, name=name, **labels)


def _point(plant: UncertainPlant, alpha: Any) -> Any:
    count = len(plant.vertices)
    if alpha is None and count > 1:
        raise ParameterValueError(f"{plant.name} has {count} vertices; give alpha, one weight each")
    weights = np.ones(1) if alpha is None else floats(alpha, "alpha")
    inside = weights.shape == (count,) and weights.min() >= 0 and abs(weights.sum() - 1) < 1e-9
    if not inside:
        raise ParameterValueError(f"alpha must be {count} weights, zero or more, that sum to one")
    return weights


def signal_names(
    plant: UncertainPlant, before: Sequence[str] = ()
) -> tuple[list[str], list[str], list[str]]:
    """Return names of states, inputs and disturbances for python-control, all different.

    Parameters
    ----------
    before : sequence of str
        Names that are taken already.
    """
    n, m = plant.shape
    E = plant.vertices[0].exact_E
    states = plant.states or [f"x{j + 1}" for j in range(n)]
    inputs = plant.inputs or [f"u{j + 1}" for j in range(m)]
    others = plant.disturbances or [f"w{j + 1}" for j in range(0 if E is None else len(E[0]))]
    names = valid_names((*before, *states, *inputs, *others))[len(before) :]
    return names[:n], names[n : n + m], names[n + m :]


def valid_names(names: Iterable[str]) -> list[str]:
    """Return names for python-control: without units, of letters, digits and _, no two the same."""
    valid: list[str] = []
    for name in names:
        plain = re.sub(r"\W+", "_", re.sub(r"\[[^\]]*\]", "", name), flags=re.ASCII).strip("_")
        plain = plain if plain and not plain[0].isdigit() else f"signal_{plain}".rstrip("_")
        candidate, count = plain, 1
        while candidate in valid:
            count += 1
            candidate = f"{plain}_{count}"
        valid.append(candidate)
    return valid


def law_to_control(
    plant: UncertainPlant, law: Law, given: str = "", name: str = "law", clamp: bool = True
) -> Any:
    """Return u = K(alpha) x as a system of python-control without states; see `Design.to_control`.

    Raises
    ------
    InputError
        If ``given`` is neither "parameters" nor "alpha", or the plant has no parameters.
    MissingExtraError
        If python-control is not installed.
    """
    control = _control()
    keys = _scheduled_by(plant, law, given)
    _, u, _ = signal_names(plant, keys)
    y = _measured_names(plant, law, keys)
    common = {
        "inputs": [*y, *keys],
        "outputs": u,
        "dt": 0 if plant.sample_time is None else float(plant.sample_time),
        "name": name,
    }
    if law.fixed:
        K = np.pad(law.own_gain(None), ((0, 0), (0, len(keys))))
        return control.ss([], [], [], K, **common)
    r, by_alpha = len(y), given == "alpha" or not plant.parameters

    def output(_t: float, _x: Array, signals: Any, _params: Any) -> Array:
        """Return u; the first inputs are x, or what is measured."""
        values = np.asarray(signals, dtype=float)
        alpha: Any = values[r:]
        if not by_alpha:
            alpha = plant.alpha(clamp=clamp, **dict(zip(keys, values[r:].tolist(), strict=True)))
        return np.asarray(law.own_gain(alpha, clamp) @ values[:r])

    return control.nlsys(None, output, **common)


def _measured_names(plant: UncertainPlant, law: Law, keys: Sequence[str]) -> list[str]:
    """Return names of what a law is given, those that `to_control` has for the plant's outputs."""
    x, u, w = signal_names(plant, keys)
    if not law.measured:
        return x
    others = [output.name for output in plant.every_output]
    before = (*keys, *u, *w, *x)
    names = [*x, *valid_names((*before, *others))[len(before) :]]
    known = dict(zip([*(state.name for state in states(plant)), *others], names, strict=True))
    return [known[signal.name] for signal in law.measured]


def _scheduled_by(plant: UncertainPlant, law: Law, given: str) -> list[str]:
    """Return the names of what schedules the law; of one gain only those that are asked for."""
    wanted = " or ".join(repr(g) for g in GIVEN) if plant.parameters else "'alpha'"
    if given not in ("", *GIVEN) or (given == "parameters" and not plant.parameters):
        raise InputError(f"given = {given!r} is not what {plant.name} has; use {wanted}")
    if law.fixed and not given:
        return []
    if given == "alpha" or not plant.parameters:
        return [f"alpha{j + 1}" for j in range(len(plant.vertices))]
    return [p.name for p in plant.parameters]
