"""A second solver, Clarabel: the largest margin of a pencil at a given r.

Maximise t subject to r D(x) - M(x) >= t I in every block, with the sum of the traces of D(x) fixed.
Its status is evidence, not truth.
"""

from dataclasses import dataclass

import clarabel
import numpy as np
import scipy.sparse as sp

from polefence.lmi.conditions.pencil import Pencil, smat
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Margin:
    """A point x with its margin t, and whether the solver says it is optimal."""

    x: Array
    t: float
    optimal: bool


def largest_margin(pencil: Pencil, r: float) -> Margin:
    """Return the point of the largest margin at radius r."""
    sizes = [b.size for b in pencil.blocks]
    identity = np.concatenate([_svec_identity(size) for size in sizes])
    trace = identity @ pencil.D / sum(sizes)
    n = pencil.unknowns
    # Clarabel: minimise q'z with b - A z in the cone; z = (x, t).
    A = sp.vstack(
        [
            sp.hstack([sp.csr_array(trace[None, :]), sp.csr_array((1, 1))]),
            sp.hstack([pencil.M - r * pencil.D, sp.csr_array(identity[:, None])]),
        ],
        format="csc",
    )
    b = np.concatenate([[1.0], np.zeros(identity.size)])
    q = np.concatenate([np.zeros(n), [-1.0]])
    cones = [clarabel.ZeroConeT(1), *(clarabel.PSDTriangleConeT(size) for size in sizes)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    P = sp.csc_matrix((n + 1, n + 1))
    solution = clarabel.DefaultSolver(P, q, sp.csc_matrix(A), b, cones, settings).solve()
    z = np.array(solution.x)
    return Margin(z[:n], float(z[n]), str(solution.status) in ("Solved", "AlmostSolved"))


def _svec_identity(size: int) -> Array:
    columns = np.arange(1, size + 1)
    vector = np.zeros(size * (size + 1) // 2)
    vector[columns * (columns + 1) // 2 - 1] = 1.0
    return vector


def reach(pencil: Pencil, x: Array) -> float:
    """Largest generalised eigenvalue, the least r with r D(x) - M(x) >= 0; inf without D(x) > 0."""
    size = np.array([b.size for b in pencil.blocks])
    cuts = np.cumsum(size * (size + 1) // 2)[:-1]
    D, M = np.split(pencil.D @ x, cuts), np.split(pencil.M @ x, cuts)
    largest = 0.0
    for same in (np.flatnonzero(size == s) for s in set(size)):
        try:
            T = np.linalg.cholesky(smat(np.stack([D[i] for i in same])))
        except np.linalg.LinAlgError:
            return float("inf")
        half = np.linalg.solve(T, smat(np.stack([M[i] for i in same])))
        pulled = np.linalg.solve(T, half.transpose(0, 2, 1))
        largest = max(largest, float(np.linalg.eigvalsh(pulled).max()))
    return largest
