"""One linear time-invariant plant, x' = A x + B u + E w, held exactly and seen as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError, PlantError, shown
from polefence.base.explained import explained_fields
from polefence.plant.controllability import FixedModes, fixed_modes
from polefence.plant.parameters import exact, is_plain
from polefence.proof.reading import MAX_SIZE
from polefence.proof.short import Short

Array = npt.NDArray[np.float64]
Exact = tuple[tuple[Fraction, ...], ...]


def read_matrix(rows: Any, what: str) -> Exact:
    """Return a matrix of exact rationals from nested sequences or an array.

    Raises
    ------
    PlantError
        If it is not a matrix: ragged, empty, or with an entry that is not a finite number.
    """
    try:
        table = [list(row) for row in rows]
    except TypeError as error:
        raise PlantError(f"{what} must be a list of rows") from error
    if not table or not table[0]:
        raise PlantError(f"{what} is empty; give at least one row and one column")
    for i, row in enumerate(table):
        if len(row) != len(table[0]):
            raise PlantError(
                f"{what} is ragged: row {i + 1} has {len(row)} entries, row 1 has {len(table[0])}"
            )
    return tuple(
        tuple(
            entry if is_plain(entry) else exact(entry, f"{what}[{i + 1}][{j + 1}]")
            for j, entry in enumerate(row)
        )
        for i, row in enumerate(table)
    )


def floats(value: Any, what: str) -> Array:
    """Return numbers as an array of floats.

    Raises
    ------
    InputError
        If they are no numbers, or lists of several lengths.
    """
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{what} must be numbers, in nested lists of one shape or an array; got {shown(value)}"
        ) from error


def as_array(matrix: Exact) -> Array:
    """Return the nearest read-only float array."""
    # float(entry) takes three times as long
    array = np.array([[entry.numerator / entry.denominator for entry in row] for row in matrix])
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class System(Short):
    """x' = A x + B u + E w with exact rational entries.

    Parameters
    ----------
    exact_A : (n, n) rationals
    exact_B : (n, m) rationals
    exact_E : (n, q) rationals, optional
        How the disturbance w enters.
    name : str
        For messages ("vertex 3").

    Raises
    ------
    PlantError
        If the shapes do not fit, or B is zero.
    """

    exact_A: Exact
    exact_B: Exact
    exact_E: Exact | None = None
    name: str = "system"

    @explained_fields
    def __post_init__(self) -> None:
        A = read_matrix(self.exact_A, f"{self.name}: A")
        B = read_matrix(self.exact_B, f"{self.name}: B")
        E = None if self.exact_E is None else read_matrix(self.exact_E, f"{self.name}: E")
        n = len(A)
        if len(A[0]) != n:
            raise PlantError(f"{self.name}: A is {n} x {len(A[0])}; it must be square")
        if n > MAX_SIZE:
            raise PlantError(f"{self.name}: A has {n} states; at most {MAX_SIZE} are supported")
        for letter, matrix in (("B", B), ("E", E)):
            if matrix is not None and len(matrix) != n:
                raise PlantError(
                    f"{self.name}: {letter} has {len(matrix)} rows; A has {n}, they must agree"
                )
        if not any(any(row) for row in B):
            raise PlantError(f"{self.name}: B is zero; no input acts on the plant")
        object.__setattr__(self, "exact_A", A)
        object.__setattr__(self, "exact_B", B)
        object.__setattr__(self, "exact_E", E)

    @cached_property
    def A(self) -> Array:
        """State matrix, (n, n)."""
        return as_array(self.exact_A)

    @cached_property
    def B(self) -> Array:
        """Input matrix, (n, m)."""
        return as_array(self.exact_B)

    @cached_property
    def E(self) -> Array | None:
        """Disturbance matrix, (n, q), where given."""
        return None if self.exact_E is None else as_array(self.exact_E)

    def __repr__(self) -> str:
        n, m = self.shape
        return f"<System {self.name!r}: {n} states, {m} inputs>"

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of states and inputs (n, m)."""
        return len(self.exact_A), len(self.exact_B[0])

    @cached_property
    def fixed(self) -> FixedModes:
        """Modes that no input moves; none if (A, B) is controllable.

        Raises
        ------
        PlantError
            If there are some, and the entries are too long to say which.
        """
        try:
            return fixed_modes(self.exact_A, self.exact_B)
        except PlantError as error:
            raise PlantError(f"{self.name}: {error}") from error
