"""Structure of a law: what it measures, what schedules it, and which of its numbers are free.

A law with states of its own, or a PID, is a gain of a larger plant, of which they are states: see
`Structure.extended`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SpecError, require_type, shown, suggest
from polefence.base.explained import explained, explained_fields
from polefence.law.laws import PolynomialGain
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import LATE_SIGNAL, law_states, require_order, with_pid, with_states
from polefence.plant.outputs import Output, split, states
from polefence.plant.spec import law_table
from polefence.plant.system import Array
from polefence.proof.plant import WITHOUT
from polefence.proof.short import Short

MAX_DEGREE, MAX_TERMS = 8, 500  # of a law in its parameters; of numbers that are free
MOST_STRUCTURES = 24  # that one table compares


@dataclass(frozen=True)
class Structure(Short):
    """What a law u = K(p) y may be: y, the parameters in K, its degree in them, its free numbers.

    Parameters
    ----------
    measured : sequence of str, optional
        States or outputs that make y; all states by default.
    schedule : sequence of str, optional
        Parameters that K depends on; all by default, none for one gain.
    degree : int
        Total degree of K in the coordinates that the plant is multi-affine in.
    largest_gain : float, or sequence of sequence of float, optional
        What no entry of K may exceed in magnitude [input unit / unit of the signal]: one number, or
        one row an input.
    pattern : sequence of sequence of str or 0, optional
        One row an input, one entry a signal: 0 where K is zero; entries of one name are equal.
    order : int
        Number of the law's own states x_c: x_c' = A_c x_c + B_c y, u = C_c x_c + D_c y. Pattern and
        largest gain are those of D_c; the rest is free, and with a D_c of zeros the law is strictly
        proper.
    kind : "pid", optional
        u is a gain of y, of its integral and of its filtered derivative; ``pattern`` and rows of
        ``largest_gain`` have all signals first, then their integrals, then their derivatives.
    derivative_bandwidth : float, optional
        Of a PID's derivative [Hz].

    Raises
    ------
    InputError
        If a value is out of range.
    """

    measured: tuple[str, ...] | None = None
    schedule: tuple[str, ...] | None = None
    degree: int = 1
    largest_gain: float | tuple[tuple[float, ...], ...] | None = None
    pattern: tuple[tuple[str, ...], ...] | None = None
    order: int = 0
    kind: str | None = None
    derivative_bandwidth: float | None = None

    @explained_fields
    def __post_init__(self) -> None:
        for key in ("measured", "schedule"):
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, _names(value, key))
        if self.measured == ():
            raise InputError("measured is empty; name a state or an output, or leave it out")
        if isinstance(self.degree, bool) or not isinstance(self.degree, int):
            raise InputError(f"degree = {self.degree!r} must be a whole number")
        if not 0 <= self.degree <= MAX_DEGREE:
            raise InputError(f"degree = {self.degree} must be 0 to {MAX_DEGREE}")
        if self.largest_gain is not None:
            object.__setattr__(self, "largest_gain", _magnitudes(self.largest_gain))
        if self.pattern is not None:
            object.__setattr__(self, "pattern", _entries(self.pattern))
        require_order(self.order)
        self._check_kind()

    def _check_kind(self) -> None:
        if self.kind not in (None, "pid"):
            raise InputError(f"kind = {shown(self.kind)} is unknown; use 'pid', or leave it out")
        bandwidth = self.derivative_bandwidth
        if self.kind is None and bandwidth is not None:
            raise InputError("derivative_bandwidth belongs to kind = 'pid'; leave it out")
        if self.kind is not None and bandwidth is None:
            raise InputError("kind = 'pid' needs derivative_bandwidth, in Hz")
        if bandwidth is not None and not (_is_number(bandwidth) and 0 < bandwidth < np.inf):
            raise InputError(f"derivative_bandwidth = {bandwidth!r} must be a positive number")
        if self.kind is not None and self.order:
            raise InputError(f"order = {self.order}: a PID has a fixed order; leave order out")

    def extended(self, plant: UncertainPlant) -> tuple[UncertainPlant, Structure]:
        """Return the larger plant of which the law is a gain, and the structure of that gain.

        A PID's integrals and filters, or the law's own states, are states behind the plant's; the
        rates of the law's own states are inputs behind its inputs. All entries of A_c, B_c and C_c
        are free: a realisation with fewer numbers is tuned worse.

        Raises
        ------
        InputError
            If the structure does not fit the plant.
        """
        static = replace(self, order=0, kind=None, derivative_bandwidth=None)
        if self.kind is not None:
            larger, names = with_pid(plant, self.outputs(plant), self.derivative_bandwidth)
            return larger, replace(static, measured=names)
        if not self.order:
            return plant, self
        k, (m, r) = self.order, self._shape(plant)
        measured, pattern, most = self.measured, self.pattern, self.largest_gain
        if measured is not None:
            measured = (*measured, *law_states(k))
        if pattern is not None:
            rows = [[f"law [{i + 1}][{j + 1}]" for j in range(r + k)] for i in range(m + k)]
            pattern = tuple(
                (*(pattern[i] if i < m else row[:r]), *row[r:]) for i, row in enumerate(rows)
            )
        if most is not None:
            limits = np.full((m + k, r + k), np.inf)
            limits[:m, :r] = self.largest(plant)
            most = tuple(map(tuple, limits.tolist()))
        enlarged = replace(static, measured=measured, pattern=pattern, largest_gain=most)
        return with_states(plant, k), enlarged

    def outputs(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return the signals that are measured.

        Raises
        ------
        InputError
            If there is none of a name, or an input or a disturbance passes straight into one.
        """
        if self.measured is None:
            return states(plant)
        signals = []
        for name in self.measured:
            try:
                signal = plant.signal(split(name)[0])
            except InputError as error:
                raise InputError(f"measured: {error}") from error
            if signal.D:
                left = f"measure '{signal.name}{WITHOUT}', by code that takes its input off, or "
                left *= bool(signal.C or signal.F) and signal.near is None
                raise InputError(
                    f"measured: an input passes straight into {name!r}; {left}give its sensor or "
                    "the actuator a bandwidth"
                )
            if plant.is_late(signal.C) or plant.is_late(signal.F):
                own = signal.name.removeprefix(LATE_SIGNAL)
                raise InputError(
                    f"measured: {signal.name!r} is late, and has no sensor; give it "
                    f'[sensor."{own}"] with a bandwidth, and measure "measured {own}"'
                )
            if signal in signals:
                raise InputError(f"measured: {signal.name!r} is given twice; give it once")
            if signal.near is not None:
                raise InputError(
                    f"measured: {signal.name!r} holds functions of the parameters; give it "
                    f'[sensor."{signal.name}"], and measure "measured {signal.name}"'
                )
            signals.append(signal)
        if not any(signal.C for signal in signals):
            raise InputError("measured: only disturbances; measure a signal of the states too")
        return tuple(signals)

    def rows(self, plant: UncertainPlant) -> Array:
        """Return C of what is measured, (N, r, n), or (1, r, n) where it is the same everywhere."""
        C = np.stack([signal.arrays(plant)[0] for signal in self.outputs(plant)], axis=1)
        return C[:1] if np.all(C[0] == C) else C

    def passing_rows(self, plant: UncertainPlant) -> Array | None:
        """Return F of what is measured, as `rows` does C; None where no disturbance passes."""
        outputs = self.outputs(plant)
        if not any(signal.F for signal in outputs):
            return None
        F = np.stack([signal.arrays(plant)[2] for signal in outputs], axis=1)
        return F[:1] if np.all(F[0] == F) else F

    def powers(self, plant: UncertainPlant) -> tuple[tuple[int, ...], ...]:
        """Return the exponents of the law's terms: of the parameters' coordinates in [-1, 1].

        Of a plant without parameters: of the weights of its vertices, none for one gain.

        Raises
        ------
        InputError
            If the plant has no parameter of a name.
        """
        names = [p.name for p in plant.parameters]
        for name in self.schedule or ():
            if name not in names:
                raise InputError(f"schedule: no parameter {name!r}; {suggest(name, names)}")
        if not names:
            N, degree = len(plant.vertices), 0 if self.schedule == () else self.degree
            count, least = (N, degree) if N > 1 else (N, 0)
            affine = [e for e in product(range(least + 1), repeat=count) if sum(e) == least]
            return tuple(reversed(affine))
        stands = [p.name for p in plant.parameters if p.dead_time is not None]
        for name in self.schedule or ():
            if name in stands:
                raise InputError(
                    f"schedule: {name!r} stands for a dead time, no sensor knows it; leave it out"
                )
        free = [name for name in names if name not in stands]
        chosen = free if self.schedule is None else self.schedule
        ranges = [range(self.degree + 1) if name in chosen else range(1) for name in names]
        return tuple(sorted((e for e in product(*ranges) if sum(e) <= self.degree), key=_graded))

    def free(self, plant: UncertainPlant) -> Any:
        """Return for each entry of K (m, r) the number of its unknown, -1 where it is zero.

        Raises
        ------
        InputError
            If the pattern has another shape, or leaves nothing free.
        """
        m, r = self._shape(plant)
        if self.pattern is None:
            return np.arange(m * r).reshape(m, r)
        labels = list(dict.fromkeys(e for row in self.pattern for e in row if e != "0"))
        if not labels:
            raise InputError("pattern: every entry is 0; leave one free")
        number = {"0": -1} | {label: k for k, label in enumerate(labels)}
        return np.array([[number[entry] for entry in row] for row in self.pattern])

    def largest(self, plant: UncertainPlant) -> Array:
        """Return the limit on the magnitude of each entry of K (m, r), infinity without one.

        Raises
        ------
        InputError
            If the limits have another shape.
        """
        limit = np.inf if self.largest_gain is None else np.array(self.largest_gain, dtype=float)
        return np.array(np.broadcast_to(limit, self._shape(plant)))

    def _shape(self, plant: UncertainPlant) -> tuple[int, int]:
        """Return the numbers of inputs and signals; refuse rows that have others."""
        m, r = plant.shape[1], len(self.outputs(plant))
        for key in ("pattern", "largest_gain"):
            rows = getattr(self, key)
            if isinstance(rows, tuple) and (len(rows) != m or any(len(row) != r for row in rows)):
                raise InputError(
                    f"{key} must have {_count(m, 'row')} of {_count(r, 'entry')}: inputs, and "
                    "signals that are measured"
                )
        return m, r

    def law(self, plant: UncertainPlant, gains: Any) -> PolynomialGain:
        """Return the law of these gains (terms, m, r)."""
        measured = () if self.measured is None else self.outputs(plant)
        return PolynomialGain(self.powers(plant), gains, measured, plant.parameters)

    def words(self, plant: UncertainPlant) -> str:
        """Describe the law of a plant in words."""
        powers = self.powers(plant)
        names = [p.name for k, p in enumerate(plant.parameters) if any(e[k] for e in powers)] or [
            "alpha"
        ] * any(map(any, powers)) * (len(plant.vertices) > 1)
        form = "one gain"
        if names and self.degree:
            form = f"a gain of degree {self.degree} in {' and '.join(names)}"
        return f"{form} of {'all states' if self.measured is None else ', '.join(self.measured)}"

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant that the structure does not fit.

        Raises
        ------
        InputError
            Saying what does not, and what to do.
        """
        require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
        plant, structure = self.extended(plant)
        structure.largest(plant)
        count = len(structure.powers(plant)) * int(structure.free(plant).max() + 1)
        if count > MAX_TERMS:
            raise InputError(f"the law has {count} free numbers; at most {MAX_TERMS} are tuned")


@explained
def load_structure(path: str | Path) -> Structure | None:
    """Read the table ``[law]`` of a spec, None where it has none.

    Raises
    ------
    SpecError
        If the file cannot be read, or the table says something that cannot be used: one line with
        file, key, value and remedy.
    """
    table = law_table(path)
    try:
        return None if table is None else _structure(table)
    except InputError as error:
        raise SpecError(f"{path}: law: {error}") from error


def _structure(table: Mapping[str, Any]) -> Structure:
    known = [field.name for field in fields(Structure)]
    for key, value in table.items():
        if key not in known:
            raise SpecError(f"unknown key {key} = {shown(value)}; {suggest(key, known)}")
        if key in ("measured", "schedule") and not isinstance(value, list):
            raise SpecError(f'{key} = {shown(value)} must be a list of names, ["A", "B"]')
    return Structure(**{key: _plain(value) for key, value in table.items()})


def _plain(value: Any) -> Any:
    """Return exact numbers of a spec as floats."""
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return float(value) if isinstance(value, Fraction) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _magnitudes(value: Any) -> Any:
    """Return a limit, or rows of limits."""
    if _is_number(value):
        if not 0 < value < np.inf:
            raise InputError(f"largest_gain = {value!r} must be a positive number")
        return float(value)
    if not _is_rows(value) or not all(_is_number(x) and x > 0 for row in value for x in row):
        raise InputError(
            f"largest_gain = {shown(value)} must be a positive number, or rows of them"
        )
    return tuple(tuple(float(x) for x in row) for row in value)


def _entries(value: Any) -> tuple[tuple[str, ...], ...]:
    rows = [list(row) for row in value] if _is_rows(value) else [[None]]
    for entry in (entry for row in rows for entry in row):
        if not (isinstance(entry, str) or (_is_number(entry) and entry == 0)):
            raise InputError(
                'pattern must be rows of names and zeros, [["a", 0], [0, "a"]]; entries of one '
                "name are equal"
            )
    return tuple(tuple(e if isinstance(e, str) else "0" for e in row) for row in rows)


def _is_rows(value: Any) -> bool:
    def holds(entry: Any) -> bool:
        return isinstance(entry, Sequence) and not isinstance(entry, str)

    return holds(value) and all(map(holds, value))


def _count(number: int, word: str) -> str:
    many = f"{word[:-1]}ies" if word.endswith("y") else f"{word}s"
    return f"{number} {word if number == 1 else many}"


def _graded(e: tuple[int, ...]) -> Any:
    return sum(e), tuple(-power for power in e)


def _names(value: Sequence[str], key: str) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else tuple(value)
    if not all(isinstance(name, str) for name in names):
        raise InputError(f"{key} must be names; got {value!r}")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"{key}: {twice[0]!r} is given twice; give it once")
    return names
