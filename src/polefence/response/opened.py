"""Closed loops of a family opened at one place: at an input, or at a signal that the law reads.

With a push d added where the loop is opened, S is the transfer function from d to what is there
with d in it. L = 1/S - 1 goes once round the loop, of negative feedback: the poles solve 1 + L = 0.
All other loops stay closed. What the law knows of its own demands, it knows without the push: those
on their way at a sample time, an observer's, and what it takes off a signal into which inputs pass.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained
from polefence.law.compensator import beside
from polefence.law.laws import check_alpha
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import DEMAND, DERIVATIVE, FILTER, INTEGRAL, MEASURED, own_states
from polefence.plant.outputs import Output, Signal, inputs, rows_at, split, states
from polefence.plant.points import seeded
from polefence.plant.system import Array, floats
from polefence.plant.weights import measurable
from polefence.proof.laws import OWN
from polefence.proof.plant import WITHOUT
from polefence.proof.short import Short
from polefence.response.closed import close
from polefence.response.discrete import BUFFER
from polefence.response.grid import frequencies
from polefence.response.modes import Modes
from polefence.response.peaks import response

POINTS = 250  # of a family beside its vertices
_LATE = re.compile(r"^(.*), \d+ samples? late$")

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Place(Signal):
    """Where a loop can be opened: ``kind`` is "input", or "measured" of what the law reads."""

    kind: str = "input"


@dataclass(frozen=True, eq=False)
class Opened(Short):
    """A closed loop and where it is opened: S = C (s - A)^-1 E + F, in discrete time s = (z - 1)/T.

    Attributes
    ----------
    plant : UncertainPlant
    place : Place
    alpha : (count, N) array
        Points of the family.
    A : (count, n, n) array
        The closed loop's, in discrete time of its delta form; E (count, n, 1), C (count, 1, n) and
        F (count, 1, 1) are likewise.
    """

    plant: UncertainPlant
    place: Place
    alpha: Array
    A: Array
    E: Array
    C: Array
    F: Array

    @property
    def step(self) -> float:
        """The sample time [s]; zero in continuous time."""
        return float(self.plant.period)

    @property
    def closed(self) -> Array:
        """The closed loop's matrices, (count, n, n)."""
        return self.A

    def poles(self) -> Array:
        """Closed-loop poles, (count, n) complex; (z - 1) / T of a delta form."""
        return np.asarray(np.linalg.eigvals(self.A))

    @property
    def modes(self) -> Modes:
        """Poles and eigenvectors of the closed loops."""
        return Modes(self.A, self.step)

    def take(self, rows: Any) -> Opened:
        """Return it at some of its points."""
        own = (getattr(self, key)[rows] for key in ("alpha", "A", "E", "C", "F"))
        return Opened(self.plant, self.place, *own)

    @explained
    def loop(self, frequency: Any) -> Complex:
        """Return L, (count, F), at frequencies [Hz]; infinite at a pole of it."""
        R = self._round(frequency)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(-R / (1 + R))

    @explained
    def sensitivity(self, frequency: Any) -> Complex:
        """Return S = 1 / (1 + L), (count, F), at frequencies [Hz]."""
        return 1 + self._round(frequency)

    def _round(self, frequency: Any) -> Complex:
        """Return S - 1, which is small where L is, and has its digits there."""
        hertz = frequencies(self, frequency)
        w, T = 2 * np.pi * hertz, self.step
        s = (np.exp(1j * w * T) - 1) / T if T else 1j * w
        count, n = self.A.shape[:2]
        R = np.empty((count, len(s)), dtype=complex)
        some = max(1, BUFFER // (16 * len(s) * n * n))
        for first in range(0, count, some):
            part = slice(first, first + some)
            own = self.A[part], self.E[part], self.C[part], self.F[part] - 1
            R[part] = response(*own, np.broadcast_to(s, (len(own[0]), len(s))))[..., 0, 0]
        return R


@explained
def places(plant: UncertainPlant, law: Any) -> tuple[Place, ...]:
    """Return where loops can be opened: every input, then every signal that the law reads.

    Parameters
    ----------
    law : Law, Design, GainTable, Compensator, OutputFeedback or (m, n) array

    Raises
    ------
    InputError
        If the law does not fit the plant.
    """
    if hasattr(law, "observer"):
        return _places_of_feedback(law)
    plant, law = beside(plant, law)
    return _inputs(plant) + tuple(Place(y.name, y.unit, "measured") for y in _read(plant, law))


@explained
def family_points(plant: UncertainPlant, count: int = POINTS) -> Array:
    """Return the vertices of a family, its middle and seeded points of it, as alpha (points, N).

    What the states of a dead time leave out of it, the parameter "delta", is zero there: the loop
    is that of the approximation alone, not of all that it stands for.

    Parameters
    ----------
    count : int
        Of points beside the vertices and the middle.
    """
    N = len(plant.vertices)
    alpha = seeded(plant, count + N)
    if N > 1:
        alpha = np.insert(alpha, N, 1 / N, axis=0)
    if plant.dead_time is None:
        return alpha
    f, q = plant.dead_time[0], len(plant.parameters)
    box = alpha.reshape(len(alpha), 2**f, 2, 2 ** (q - f - 1))
    middle = np.broadcast_to(box.sum(axis=2, keepdims=True) / 2, box.shape)
    return np.unique(middle.reshape(alpha.shape), axis=0)


@explained
def opened(plant: UncertainPlant, law: Any, loop: str | None = None, alpha: Any = None) -> Opened:
    """Open a closed loop at one place, all others stay closed.

    Parameters
    ----------
    law : Law, Design, GainTable, Compensator, OutputFeedback or (m, n) array
        With states of its own too, in continuous or in discrete time, as the plant is.
    loop : str, optional
        Name of an input, which the loop is opened before, or of a measured signal, which the law
        reads; the first input by default. See `places`. Of a signal with an actuator or a sensor
        its own name will do.
    alpha : (count, N) or (N,) array, optional
        Points of the family; by default its vertices and others, see `family_points`.

    Raises
    ------
    InputError
        If there is no such loop, the law does not fit the plant, or the loop is not well-posed.
    """
    alpha = family_points(plant) if alpha is None else np.atleast_2d(floats(alpha, "alpha"))
    alpha = check_alpha(alpha, len(plant.vertices))
    place = _chosen(plant, places(plant, law), loop)
    if hasattr(law, "observer"):
        plant = law.observer.plant
        matrices = _of_feedback(law, place, alpha)
    else:
        plant, law = beside(plant, law)
        found = _at_input if place.kind == "input" else _at_signal
        matrices = found(delta_form(plant), law, place, alpha)
    return Opened(plant, place, alpha, *matrices)


def _chosen(plant: UncertainPlant, known: Sequence[Place], loop: str | None) -> Place:
    if loop is None:
        return known[0]
    name = split(str(loop))[0]
    for alias in (name, f"{DEMAND}{name}", f"{MEASURED}{name}"):
        for place in known:
            if place.name == alias:
                return place
    hint = suggest(name, [place.name for place in known])
    raise InputError(
        f"no loop {name!r} of {plant.name}: give an input, or what is measured; {hint}"
    )


def _inputs(plant: UncertainPlant) -> tuple[Place, ...]:
    """Return the inputs, but for the rates of the law's own states."""
    signals = inputs(plant)[: plant.shape[1] - own_states(plant)]
    return tuple(Place(u.name, u.unit) for u in signals)


def _read(plant: UncertainPlant, law: Any) -> list[Output]:
    """Return the signals that a law reads: no states of its own, and no demands on their way.

    A signal without what inputs pass into it stands for the whole signal, which a sensor says.
    """
    measured = getattr(law, "measured", ())
    if not measured:
        known = measurable(plant)
        K = np.asarray(law.over(delta_form(plant), np.eye(len(plant.vertices))))
        used = np.flatnonzero(K.any(axis=(0, 1))).tolist()
        measured = [x for j, x in enumerate(states(plant)) if j in used and x.name in known]
    own = (*OWN, DERIVATIVE)
    kept = [y for y in measured if not (y.name.startswith(own) or _LATE.match(y.name))]
    return [plant.signal(y.name.removesuffix(WITHOUT)) for y in kept]


def _at_input(plant: UncertainPlant, law: Any, place: Place, alpha: Array) -> tuple[Array, ...]:
    """Return A, E, C and F where input i is u + d, of which the law knows its own u."""
    loops = close(plant, law, alpha, disturbed=False)
    i = [u.name for u in inputs(plant)].index(place.name)
    A, E, K = loops.closed, loops.B[:, :, i : i + 1], loops.K
    known = _passed(plant, law, alpha)[:, :, i : i + 1]
    E = E + loops.B @ known
    late = [k for k, x in enumerate(states(plant)) if _is_late(x.name, place.name)]
    F = 1 + known[:, i : i + 1]
    C = K[:, i : i + 1]
    if not K[:, :, late].any():
        return A, E, C, F
    # Of demands on their way the law remembers its own: their difference from what is on its way
    # moves by d alone.
    apart = loops.A[:, late][:, :, late]
    none = np.zeros((len(A), len(late), A.shape[-1]))
    A = np.block([[A, -loops.B @ K[:, :, late]], [none, apart]])
    E = np.concatenate([E, loops.B[:, late, i : i + 1]], axis=1)
    return A, E, np.concatenate([C, -C[:, :, late]], axis=2), F


def _is_late(name: str, of: str) -> bool:
    match = _LATE.match(name)
    return match is not None and match[1] == of


def _passed(plant: UncertainPlant, law: Any, alpha: Array) -> Array:
    """Return K D, (count, m, m): what the law takes off signals, pushed inputs not in it."""
    m = plant.shape[1]
    K = np.zeros((len(alpha), m, m))
    for j, y in enumerate(getattr(law, "measured", ())):
        if y.name.endswith(WITHOUT):
            D = rows_at(plant, [plant.signal(y.name.removesuffix(WITHOUT))], alpha)[1]
            K = K + law.own_gain(alpha)[..., :, j : j + 1] @ D
    return K


def _at_signal(plant: UncertainPlant, law: Any, place: Place, alpha: Array) -> tuple[Array, ...]:
    """Return A, E, C and F where the law reads y + d."""
    loops = close(plant, law, alpha, disturbed=False)
    signal = plant.signal(place.name)
    names = [y.name for y in getattr(law, "measured", ()) or states(plant)]
    own = np.asarray(law.own_gain(alpha)) if getattr(law, "measured", ()) else loops.K
    j = names.index(place.name if place.name in names else place.name + WITHOUT)
    E, gain = np.zeros((len(alpha), plant.shape[0], 1)), own[..., :, j : j + 1]
    known = [x.name for x in states(plant)]
    if f"{INTEGRAL}{place.name}" in names and not own_states(plant):
        # A PID's integral and filter read the signal too.
        derivative = f"{DERIVATIVE}{place.name}"
        E[:, known.index(f"{INTEGRAL}{place.name}")] = 1
        if derivative in names:
            k = known.index(f"{FILTER}{place.name}")
            rate = -float(plant.signal(derivative).C[0][k])
            E[:, k] = rate
            gain = gain + rate * own[..., :, names.index(derivative)][..., None]
    gain = np.broadcast_to(gain, (len(alpha), *gain.shape[-2:]))
    C, D, _ = rows_at(plant, [signal], alpha)
    F = 1 + D @ gain
    if not F.all():
        raise InputError(
            f"the loop at {place.name!r} is not well-posed: opened there, it is one of an infinite "
            "gain; open it at an input"
        )
    return loops.closed, E + loops.B @ gain, C + D @ loops.K, F


def _places_of_feedback(law: Any) -> tuple[Place, ...]:
    count = law.observer.C.shape[1]
    named = law.observer.design.plant.inputs or [f"y{j + 1}" for j in range(count)]
    read = (Place(*split(label), "measured") for label in named)
    return (*_inputs(law.observer.plant), *read)


def _of_feedback(law: Any, place: Place, alpha: Array) -> tuple[Array, ...]:
    """Return A, E, C and F of observer-based feedback: x^ is of the law's own demands."""
    plant = law.observer.plant
    _, Bc, Cc = law.compensator(alpha)
    A, B = law.closed_loop(alpha), plant.at(alpha)[1]
    n, count = plant.shape[0], len(alpha)
    if place.kind == "input":
        i = [u.name for u in inputs(plant)].index(place.name)
        E = np.concatenate([B[:, :, i : i + 1], np.zeros((count, n, 1))], axis=1)
        C = np.concatenate([np.zeros((count, 1, n)), Cc[:, i : i + 1]], axis=2)
    else:
        j = [p.name for p in _places_of_feedback(law) if p.kind == "measured"].index(place.name)
        E = np.concatenate([np.zeros((count, n, 1)), Bc[:, :, j : j + 1]], axis=1)
        seen = np.tensordot(alpha, law.observer.C, 1)[:, j : j + 1]
        C = np.concatenate([seen, np.zeros((count, 1, n))], axis=2)
    T = float(plant.period)
    if plant.sample_time is not None:
        A, E = (A - np.eye(2 * n)) / T, E / T
    return A, E, C, np.ones((count, 1, 1))
