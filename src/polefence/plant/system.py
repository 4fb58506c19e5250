"""One linear time-invariant plant, x' = A x + B u + E w, held exactly and seen as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.errors import PlantError, UncontrollableError
from polefence.plant.parameters import exact

Array = npt.NDArray[np.float64]
Exact = tuple[tuple[Fraction, ...], ...]

MAX_STATES = 60


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
        tuple(exact(entry, f"{what}[{i + 1}][{j + 1}]") for j, entry in enumerate(row))
        for i, row in enumerate(table)
    )


def as_array(matrix: Exact) -> Array:
    """Return the nearest read-only float array."""
    array = np.array([[float(entry) for entry in row] for row in matrix])
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class System:
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

    def __post_init__(self) -> None:
        A = read_matrix(self.exact_A, f"{self.name}: A")
        B = read_matrix(self.exact_B, f"{self.name}: B")
        E = None if self.exact_E is None else read_matrix(self.exact_E, f"{self.name}: E")
        n = len(A)
        if len(A[0]) != n:
            raise PlantError(f"{self.name}: A is {n} x {len(A[0])}; it must be square")
        if n > MAX_STATES:
            raise PlantError(f"{self.name}: A has {n} states; at most {MAX_STATES} are supported")
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

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of states and inputs (n, m)."""
        return len(self.exact_A), len(self.exact_B[0])

    def require_controllable(self) -> None:
        """Check the rank of [B, AB, ..., A^(n-1) B] exactly.

        Raises
        ------
        UncontrollableError
            If it is less than n.
        """
        n, _ = self.shape
        rank = controllable_dimension(self.exact_A, self.exact_B)
        if rank < n:
            raise UncontrollableError(
                f"{self.name} is uncontrollable: its inputs reach {rank} of {n} state dimensions, "
                "so some poles cannot be moved; remove those states or add an input"
            )


def controllable_dimension(A: Exact, B: Exact) -> int:
    """Dimension of the controllable subspace, in exact arithmetic."""
    return len(_controllable_basis(A, B))


def uncontrollable_part(A: Exact, B: Exact) -> list[list[Fraction]]:
    """Return the matrix whose eigenvalues no gain can move, 0 x 0 if there are none.

    A as it acts on the states modulo the controllable subspace, in exact arithmetic.
    """
    basis = _controllable_basis(A, B)
    pivots = [pivot for pivot, _ in basis]
    free = [i for i in range(len(A)) if i not in pivots]
    part = []
    for j in free:
        image = [A[i][j] for i in range(len(A))]
        part.append([_reduce(image, basis)[i] for i in free])
    return [list(row) for row in zip(*part, strict=True)]


def _controllable_basis(A: Exact, B: Exact) -> list[tuple[int, list[Fraction]]]:
    """Return an echelon basis of the controllable subspace: pivots and vectors."""
    n = len(A)
    basis: list[tuple[int, list[Fraction]]] = []
    queue = [list(column) for column in zip(*B, strict=True)]
    while queue and len(basis) < n:
        vector = queue.pop(0)
        reduced = _reduce(vector, basis)
        pivot = next((i for i, entry in enumerate(reduced) if entry), None)
        if pivot is None:
            continue
        normal = [entry / reduced[pivot] for entry in reduced]
        basis.append((pivot, normal))
        queue.append(
            [sum((a * v for a, v in zip(row, normal, strict=True) if a), Fraction(0)) for row in A]
        )
    return basis


def _reduce(vector: list[Fraction], basis: Sequence[tuple[int, list[Fraction]]]) -> list[Fraction]:
    for pivot, row in basis:
        factor = vector[pivot]
        if factor:
            vector = [v - factor * r for v, r in zip(vector, row, strict=True)]
    return vector
