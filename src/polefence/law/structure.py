"""Structure of a law: what it measures, what schedules it, and which of its numbers are free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from polefence.base.errors import InputError, require_type, suggest
from polefence.law.laws import PolynomialGain
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, pick, states
from polefence.plant.system import Array

MAX_DEGREE, MAX_TERMS = 8, 500  # of a law in its parameters; of numbers that are free


@dataclass(frozen=True)
class Structure:
    """What a law u = K(p) y may be: y, the parameters in K, its degree in them, its free numbers.

    Parameters
    ----------
    measured : sequence of str, optional
        States or outputs that make y; all states by default.
    schedule : sequence of str, optional
        Parameters that K depends on; all by default, none for one gain.
    degree : int
        Total degree of K in the coordinates that the plant is multi-affine in.
    largest_gain : float, optional
        What no entry of K may exceed in magnitude [input unit / unit of the signal].
    pattern : sequence of sequence of str or 0, optional
        One row an input, one entry a signal: 0 where K is zero; entries of one name are equal.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    measured: tuple[str, ...] | None = None
    schedule: tuple[str, ...] | None = None
    degree: int = 1
    largest_gain: float | None = None
    pattern: tuple[tuple[str, ...], ...] | None = None

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
        if self.largest_gain is not None and not 0 < self.largest_gain < np.inf:
            raise InputError(f"largest_gain = {self.largest_gain!r} must be a positive number")
        if self.pattern is not None:
            rows = tuple(tuple(str(entry) for entry in row) for row in self.pattern)
            object.__setattr__(self, "pattern", rows)

    def outputs(self, plant: UncertainPlant) -> tuple[Output, ...]:
        """Return the signals that are measured.

        Raises
        ------
        InputError
            If there is none of a name, or an input or a disturbance passes straight into one.
        """
        if self.measured is None:
            return states(plant)
        found = []
        for name in self.measured:
            own = pick(plant.signals, name)
            if own.D or own.F:
                what = "an input" if own.D else "a disturbance"
                raise InputError(
                    f"measured: {what} passes straight into {name!r}; give its sensor or the "
                    "actuator a bandwidth, or measure another signal"
                )
            found.append(own)
        return tuple(found)

    def rows(self, plant: UncertainPlant) -> Array:
        """Return C of what is measured, (N, r, n), or (1, r, n) where it is the same everywhere."""
        C = np.stack([own.arrays(plant)[0] for own in self.outputs(plant)], axis=1)
        return C[:1] if np.all(C[0] == C) else C

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
            found = [e for e in product(range(least + 1), repeat=count) if sum(e) == least]
            return tuple(reversed(found))
        chosen = names if self.schedule is None else self.schedule
        each = [range(self.degree + 1) if name in chosen else range(1) for name in names]
        return tuple(sorted((e for e in product(*each) if sum(e) <= self.degree), key=_graded))

    def free(self, plant: UncertainPlant) -> Any:
        """Return for each entry of K (m, r) the number of its unknown, -1 where it is zero.

        Raises
        ------
        InputError
            If the pattern has another shape, or leaves nothing free.
        """
        m, r = plant.shape[1], len(self.outputs(plant))
        if self.pattern is None:
            return np.arange(m * r).reshape(m, r)
        if len(self.pattern) != m or any(len(row) != r for row in self.pattern):
            raise InputError(f"pattern must have {m} rows of {r} entries: inputs, and signals")
        labels = list(dict.fromkeys(e for row in self.pattern for e in row if e != "0"))
        if not labels:
            raise InputError("pattern: every entry is 0; leave one free")
        number = {"0": -1} | {label: k for k, label in enumerate(labels)}
        return np.array([[number[entry] for entry in row] for row in self.pattern])

    def law(self, plant: UncertainPlant, gains: Any) -> PolynomialGain:
        """Return the law of these gains (terms, m, r)."""
        measured = () if self.measured is None else self.outputs(plant)
        return PolynomialGain(self.powers(plant), gains, measured, plant.parameters)

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant that the structure does not fit.

        Raises
        ------
        InputError
            Saying what does not, and what to do.
        """
        require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
        count = len(self.powers(plant)) * int(self.free(plant).max() + 1)
        if count > MAX_TERMS:
            raise InputError(f"the law has {count} free numbers; at most {MAX_TERMS} are tuned")


def _graded(e: tuple[int, ...]) -> Any:
    return sum(e), tuple(-power for power in e)


def _names(value: Sequence[str], key: str) -> tuple[str, ...]:
    found = (value,) if isinstance(value, str) else tuple(value)
    if not all(isinstance(name, str) for name in found):
        raise InputError(f"{key} must be names; got {value!r}")
    twice = [name for name in found if found.count(name) > 1]
    if twice:
        raise InputError(f"{key}: {twice[0]!r} is there twice; give it once")
    return found
