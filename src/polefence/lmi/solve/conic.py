"""The adapter to Clarabel: the largest margin of a pencil at a fixed radius.

maximise t subject to r D(x) - M(x) >= t I in every block, sum of traces of D(x) fixed. The status
is evidence, not truth: callers recompute what they use from the point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.pencil import Pencil
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Margin:
    """A point x with its margin t, and whether the solver says it is optimal."""

    x: Array
    t: float
    optimal: bool


def largest_margin(pencil: Pencil, r: float, time_limit: float = 60.0) -> Margin:
    """Return the point of the largest margin at radius r.

    Raises
    ------
    SolverError
        If the solver raised, in whatever way, or gave no finite point.
    """
    # deferred: they take longer to import than the rest of the package
    import clarabel
    import scipy.sparse as sp
    from threadpoolctl import threadpool_limits

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
    settings.time_limit = time_limit
    try:
        with threadpool_limits(1):
            P = sp.csc_matrix((n + 1, n + 1))
            solution = clarabel.DefaultSolver(P, q, sp.csc_matrix(A), b, cones, settings).solve()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # a Rust panic is no Exception
        raise SolverError(f"Clarabel raised {type(error).__name__}: {error}") from error
    z = np.array(solution.x)
    if z.shape != (n + 1,) or not np.all(np.isfinite(z)):
        raise SolverError(f"Clarabel gave no point: {solution.status}")
    return Margin(z[:n], float(z[n]), str(solution.status) in ("Solved", "AlmostSolved"))


def _svec_identity(size: int) -> Array:
    columns = np.arange(1, size + 1)
    vector = np.zeros(size * (size + 1) // 2)
    vector[columns * (columns + 1) // 2 - 1] = 1.0
    return vector
