"""Result of a search: a point of a condition, in the plant's own coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Dual:
    """Dual matrices of a condition's disk blocks, about as good as the point they came with.

    Attributes
    ----------
    Y : (blocks, 2 n, 2 n) array
        In the order of the pencil's blocks, in coordinates x = T x_s.
    T : (n, n) array
    """

    Y: Array
    T: Array

    def matrices(self) -> Array:
        """Return them in the plant's coordinates."""
        C = np.kron(np.eye(2), np.linalg.inv(self.T))
        return np.asarray(C.T @ self.Y @ C)


@dataclass(frozen=True, eq=False)
class Found:
    """A point that meets a condition at ``radius``, to float rounding.

    Attributes
    ----------
    radius : float
        [1/s]
    values : dict of arrays
        The condition's matrices, original coordinates.
    dual : Dual, optional
        Evidence that no radius much smaller is feasible.
    converged : bool
        Whether the search came to its end rather than to its limits.
    iterations : int
    rate : float
        Unit of the search's rates [1/s].
    """

    radius: float
    values: dict[str, Array]
    dual: Dual | None = None
    converged: bool = False
    iterations: int = 0
    rate: float = 1.0


def lyapunov_mean(values: dict[str, Array]) -> Array:
    """Return the mean of a condition's Lyapunov matrices."""
    return np.asarray(np.mean([X for name, X in values.items() if name[0] in "WP"], axis=0))
