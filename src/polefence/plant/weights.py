"""Weights and references: transfer functions behind signals, or before disturbances.

A weight of an output or an input has states that follow it, and what comes out is a further output.
A weight of a disturbance stands before it: the plant is driven by what comes out, and the
disturbance is what goes in. Either way nothing else of the plant is changed.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, shown, suggest
from polefence.base.explained import explained
from polefence.plant.controllability import modes_text
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import (
    beside_disturbance,
    require_new,
    with_disturbance,
    with_dynamics,
)
from polefence.plant.outputs import Output, disturbances, padded, split, states, weighted_sum
from polefence.plant.parameters import exact
from polefence.plant.system import Exact, System, as_array
from polefence.plant.tracks import STATE as OF_ROAD
from polefence.plant.transfer import (
    Quotient,
    number,
    of_roots,
    quotient,
    read_quotient,
    realised,
)
from polefence.proof.filters import Entering, Filter, Filters
from polefence.proof.matrices import LONGEST, ONE, ZERO, common_denominator, whole_numbers
from polefence.proof.plant import OF_WEIGHT
from polefence.proof.regions import Disk, HalfPlane
from polefence.proof.roots import characteristic, roots_inside

WEIGHTED, ERROR = "weighted ", "error of "
FORMS = (
    ("transfer",),
    ("numerator", "denominator"),
    ("zeros", "poles", "gain"),
    ("makeweight",),
)
_NUMBER = r"\s*([0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]{1,3})?|\.[0-9]+)\s*"
_CALL = re.compile(rf"\s*makeweight\({_NUMBER},{_NUMBER},{_NUMBER}\)\s*")
KEYS = tuple(key for form in FORMS for key in form)
_WANTED = (
    'transfer = "(s + 50)/(s + 500)", or numerator and denominator, or zeros, poles and gain, or '
    "makeweight = [DC, CROSSOVER, HF]"
)


@explained
def with_weight(plant: UncertainPlant, signal: str, weight: Any, name: str = "") -> UncertainPlant:
    """Return the plant with a weight W: "weighted SIGNAL" is an output, W times the signal.

    A disturbance's weight stands before it: "weighted SIGNAL" acts on the plant in its place, and
    the disturbance, of the same name, is what W makes that of.

    Parameters
    ----------
    signal : str
        Name of an output, a state, an input or a disturbance.
    weight : str, mapping, or system
        W: a text such as "(s + 50)/(s + 500)", in z of a plant in discrete time, parsed exactly and
        never executed; or "makeweight(0.4, 15, 3)". Or a mapping with the keys ``numerator`` and
        ``denominator``, or ``zeros``, ``poles`` and ``gain``, or ``makeweight``: [dc, crossover,
        hf], the gains at zero and at infinity, and where it is one [rad/s], or [where, gain].
        Or a ``TransferFunction`` of python-control.
    name : str, optional
        Of the weighted signal, with its unit.

    Raises
    ------
    InputError
        If there is no such signal, W is improper, or has a pole that no law moves and that is not
        stable.
    """
    where = f"weight of {signal!r}"
    _require_unsampled(plant, where)
    word, own = split(str(signal))[0], [d.name for d in disturbances(plant)]
    is_signal = word in [known.name for known in plant.signals]
    if is_signal and word in own:
        raise InputError(f"{where}: a signal and a disturbance have this name; rename one")
    made = _Weight.read(plant, weight, where)
    label, unit = split(name) if name else (f"{WEIGHTED}{word}", "")
    labels = [f"{OF_WEIGHT}{i + 1} of {label if name else word}" for i in range(len(made.A))]
    require_new(plant, (label, *labels))
    if word in own:
        roads = () if plant.car is None else plant.car.places
        if word in roads or (plant.vehicle is not None and word == plant.vehicle.road):
            raise InputError(
                f"{where}: the road under a car is white velocity; weigh what it moves, or give "
                "the car by its matrices, without [vehicle]"
            )
        made.require_stable(plant, f"{where}, which no law moves")
        return _before(plant, own.index(word), made, labels, (label, unit))
    try:
        y = plant.signal(word)
    except InputError as error:
        near = suggest(word, [*own, *(known.name for known in plant.signals)])
        raise InputError(f"{where}: no signal or disturbance {word!r}; {near}") from error
    made.require_stable(plant, where, integrators=True)
    n, k = plant.shape[0], len(labels)
    larger = with_dynamics(plant, (y,), made.A, made.B, labels) if k else plant
    terms = [(made.D[0][0], padded(y, k, n)), *zip(made.C[0], states(larger)[n:], strict=True)]
    weighted = weighted_sum(label, unit or y.unit, [(x, term) for x, term in terms if x])
    return replace(larger, outputs=(*larger.outputs, weighted))


@explained
def with_reference(plant: UncertainPlant, name: str, signal: str | Sequence[str]) -> UncertainPlant:
    """Return the plant with a reference: a disturbance, and "error of SIGNAL", it less the signal.

    Parameters
    ----------
    name : str
        Of the disturbance.
    signal : str, or sequence of str
        What is to follow it: a state, an output or an input. Of several each has its own error: a
        position, say, and what a sensor says of it.

    Raises
    ------
    InputError
        If there is no such signal, or one has the name already.
    """
    where = f"reference {name!r}"
    _require_unsampled(plant, where)
    names = [signal] if isinstance(signal, str) else list(signal)
    if not names:
        raise InputError(f"{where}: no signal; name what is to follow it")
    try:
        followed = [plant.signal(split(str(word))[0]) for word in names]
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    word, unit = split(str(name))
    require_new(plant, [word, *(f"{ERROR}{y.name}" for y in followed)])
    unit = unit or followed[0].unit
    label = f"{word} [{unit}]" if unit else word
    larger = with_disturbance(plant, label, (ZERO,) * plant.shape[0])
    last = Output(word, unit, F=[*(ZERO,) * plant.disturbance_count, ONE])
    errors = []
    for y in followed:
        terms = [(ONE, last), (-ONE, beside_disturbance(y))]
        errors.append(weighted_sum(f"{ERROR}{y.name}", y.unit, terms))
    return replace(larger, outputs=(*larger.outputs, *errors))


def measurable(plant: UncertainPlant) -> tuple[str, ...]:
    """Return the names of the states that a law may measure.

    Not a road's, nor a weight's, nor those that stand for a dead time.
    """
    late = () if plant.dead_time is None else plant.dead_time[1].states
    known = (x.name for i, x in enumerate(states(plant)) if i not in late)
    return tuple(name for name in known if not name.startswith((OF_ROAD, OF_WEIGHT)))


def weights_poles(plant: UncertainPlant) -> dict[str, Any]:
    """Return the poles of each weight by what its states are called after."""
    own = dict[str, list[int]]()
    for i, state in enumerate(states(plant)):
        if state.name.startswith(OF_WEIGHT):
            own.setdefault(state.name.split(" of ", 1)[-1], []).append(i)
    A = plant.vertices[0].A
    return {name: np.linalg.eigvals(A[np.ix_(rows, rows)]) for name, rows in own.items()}


@dataclass(frozen=True)
class _Weight:
    """z' = A z + B y, W y = C z + D y."""

    A: Exact
    B: Exact
    C: Exact
    D: Exact

    @classmethod
    def read(cls, plant: UncertainPlant, given: Any, where: str) -> _Weight:
        top, bottom = _quotient(_fields(given, where), plant.period, where)
        if not top:
            raise InputError(f"{where} is zero; give it a gain")
        return cls(*realised([[(top, bottom)]], where))

    def require_stable(
        self, plant: UncertainPlant, where: str, *, integrators: bool = False
    ) -> None:
        """Refuse poles that are not stable; integrators may be, where a law can measure them."""
        if not self.A:
            return
        discrete = plant.period > 0
        rows = [list(row) for row in self.A]
        whole = common_denominator([rows], LONGEST)
        polynomial = characteristic(whole_numbers(rows, whole))
        root = whole if discrete else 0
        while integrators and len(polynomial) > 1 and not _at(polynomial, root):
            polynomial = _without(polynomial, root)
        part = Disk(ZERO, ONE) if discrete else HalfPlane(ZERO)
        if len(polynomial) == 1 or roots_inside(polynomial, (part,), whole):
            return
        poles = np.linalg.eigvals(as_array(self.A)).astype(complex)
        outside = poles[(abs(poles) if discrete else poles.real + 1) >= 1 - 1e-9]
        raise InputError(
            f"{where}: the pole {modes_text(outside if len(outside) else poles)} is not stable; "
            f"move it {'into the unit circle' if discrete else 'to the left of the axis'}"
        )


def shape_of(weight: Any, what: str, *, constant: bool = False, in_z: bool = False) -> Filter:
    """Return a weight as a filter, named by what was written.

    Parameters
    ----------
    constant : bool
        Whether it may be a number.
    in_z : bool
        Whether it is of samples.

    Raises
    ------
    InputError
        If it is none, improper, constant where it may not be, or not stable.
    """
    where = f"weight of {what}"
    name = weight if isinstance(weight, str) else json.dumps(dict(weight), default=str)
    plain = UncertainPlant.from_vertices([[[-1]]], [[[1]]], sample_time=1 if in_z else None)
    made = _Weight.read(plain, weight, where)
    made.require_stable(plain, where)
    if not made.A and not constant:
        raise InputError(f"{where} is constant; ask for a disk margin with sigma = -1")
    a, b, c = (list(map(list, M)) for M in (made.A, made.B, made.C if made.A else ((),)))
    return Filter(a, b, c, name, made.D[0][0])


def _at(polynomial: list[int], root: int) -> int:
    value = 0
    for coefficient in polynomial:
        value = value * root + coefficient
    return value


def _without(polynomial: list[int], root: int) -> list[int]:
    """Return the polynomial over (z - root)."""
    rest = [polynomial[0]]
    for coefficient in polynomial[1:-1]:
        rest.append(coefficient + root * rest[-1])
    return rest


def _fields(given: Any, where: str) -> Mapping[str, Any]:
    """Return a weight's keys, those of one form."""
    if isinstance(given, str):
        return {"transfer": given}
    if hasattr(given, "num") and hasattr(given, "den"):
        if np.shape(given.num)[:2] != (1, 1):
            raise InputError(f"{where}: it has several inputs or outputs; give it one of each")
        return {"numerator": given.num[0][0], "denominator": given.den[0][0]}
    if not isinstance(given, Mapping):
        raise InputError(f"{where}: give {_WANTED}")
    forms = [form for form in FORMS if any(key in given for key in form)]
    if len(forms) != 1:
        there = " beside ".join(next(key for key in form if key in given) for form in forms)
        raise InputError(f"{where}: {there or 'no transfer function'}; give one, as {_WANTED}")
    for key in forms[0]:
        if key not in given:
            raise InputError(f"{where}: {key} is missing; give {', '.join(forms[0])}")
    for key in given:
        if key not in forms[0]:
            raise InputError(f"{where}: unknown key {shown(key)}; {suggest(str(key), KEYS)}")
    return given


def _quotient(fields: Mapping[str, Any], T: Fraction, where: str) -> Quotient:
    """Return a weight's numerator and denominator, in z at a sample time."""
    if "makeweight" in fields:
        return _first_order(fields["makeweight"], T, f"{where}: makeweight")
    if "numerator" in fields:
        return quotient(fields["numerator"], fields["denominator"], where)
    if "zeros" in fields:
        return of_roots(fields["zeros"], fields["poles"], fields["gain"], where)
    text = fields["transfer"]
    if isinstance(text, str) and (call := _CALL.fullmatch(text)):
        return _first_order([Fraction(x) for x in call.groups()], T, f"{where}: makeweight")
    read, letter = read_quotient(text, f"{where}: transfer")
    wanted = "z" if T else "s"
    if letter and letter != wanted:
        time = "discrete" if T else "continuous"
        raise InputError(
            f"{where}: transfer is in {letter}, and the plant in {time} time; write it in {wanted}"
        )
    return read


def _first_order(given: Any, T: Fraction, where: str) -> Quotient:
    """Return (hf s + dc a)/(s + a), of a gain of one, or another, at a frequency [rad/s]."""
    if T:
        raise InputError(f"{where}: the plant is in discrete time; write transfer in z")
    if not isinstance(given, Sequence) or isinstance(given, str) or len(given) != 3:
        raise InputError(f"{where} must be [DC, CROSSOVER, HF], or [DC, [FREQUENCY, GAIN], HF]")
    at = given[1] if isinstance(given[1], Sequence) and not isinstance(given[1], str) else None
    if at is not None and len(at) != 2:
        raise InputError(f"{where}: {shown(at)} must be [FREQUENCY, GAIN]")
    w, level = (given[1], ONE) if at is None else at
    values = (exact(number(x, where), where) for x in (given[0], w, level, given[2]))
    dc, w, level, hf = values
    below, above = dc * dc - level * level, level * level - hf * hf
    if w <= 0 or below * above <= 0:
        raise InputError(
            f"{where}: its gain must rise or fall through {float(level):g} at a frequency above "
            f"zero, and goes from {float(dc):g} to {float(hf):g}"
        )
    a = Fraction(f"{float(w) * math.sqrt(float(above / below)):.12g}")
    return ([hf, dc * a] if hf else [dc * a]), [ONE, a]


def _before(
    plant: UncertainPlant, j: int, made: _Weight, labels: Sequence[str], named: tuple[str, str]
) -> UncertainPlant:
    """Return the plant with a weight before disturbance j: z' = A z + B v, and C z + D v acts."""
    (name, unit), own = named, disturbances(plant)
    a, b, c = (list(map(list, M)) for M in (made.A, made.B, made.C if made.A else ((),)))
    filter_j = Filter(a, b, c, name, made.D[0][0])
    filters = tuple(filter_j if i == j else None for i in range(len(own)))
    acting = Output(name, unit or own[j].unit, F=[int(i == j) for i in range(len(own))])
    return driven_through(replace(plant, outputs=(*plant.outputs, acting)), filters, labels)


def driven_through(
    plant: UncertainPlant, filters: Filters, labels: Sequence[str]
) -> UncertainPlant:
    """Return the plant with filters before its disturbances: one each, or none.

    Parameters
    ----------
    filters : tuple of Filter or None
        In z of a plant in discrete time.
    labels : sequence of str
        Of their states, which come behind those of the plant.
    """
    entering, vertices = Entering(*plant.shape, filters), []
    for v in plant.vertices:
        known = (list(map(list, M)) for M in (v.exact_A, v.exact_B, v.exact_E or ()))
        A, B, E = (tuple(map(tuple, M)) for M in entering.plant(*known))
        vertices.append(System(A, B, E, v.name))
    return replace(
        plant,
        vertices=tuple(vertices),
        states=(*(x.label for x in states(plant)), *labels),
        outputs=tuple(seen_through(y, plant, filters) for y in plant.outputs),
        remainder=plant.remainder and entering.remainder(plant.remainder),
    )


def seen_through(output: Output, plant: UncertainPlant, filters: Filters) -> Output:
    """Return an output of a plant as one of `driven_through` with these filters."""
    entering, (C, _, F) = Entering(*plant.shape, filters), output.exact(plant)
    seen, through = zip(*map(entering.row, C, F), strict=True)
    near = output.near and entering.near(output.near)
    return replace(output, C=seen, F=through, near=near)


def _require_unsampled(plant: UncertainPlant, where: str) -> None:
    bare = plant.remainder is not None and plant.remainder.source is None
    if plant.sampling is not None or plant.step or bare:
        raise InputError(
            f"{where}: {plant.name} is sampled already; add it to the plant in continuous time, "
            "and then sample that"
        )
