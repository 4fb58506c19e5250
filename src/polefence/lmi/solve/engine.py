"""Choice of the interior points: the compiled kernel where it was built, else NumPy's reference."""

from __future__ import annotations

import numpy as np

from polefence.base.effort import spend
from polefence.base.explained import explained
from polefence.base.kernel import kernel
from polefence.base.processors import spare_processors
from polefence.base.progress import stage
from polefence.lmi.solve import inside as first
from polefence.lmi.solve import interior_point as reference
from polefence.lmi.solve.interior_point import Outcome
from polefence.lmi.solve.stacked import Stacked
from polefence.plant.system import Array

ENGINES = ("compiled", "numpy")


@explained
def engine() -> str:
    """Say which engine computes smallest radii here.

    Returns
    -------
    str
        "compiled (AVX2)", "compiled (baseline)" or "numpy". Radii agree to 1e-6.
    """
    built = kernel()
    return "numpy" if built is None else f"compiled ({built.instructions()})"


def inside(
    stacked: Stacked, x: Array, most: Array | None = None, engine: str | None = None
) -> tuple[float, float] | None:
    """Return a share and an r at which F(x + share most, r) is positive definite, None without one.

    As `polefence.lmi.solve.inside.inside` does; ``engine`` is that of `run`.
    """
    built = kernel()
    if engine == "numpy" or built is None:
        return first.inside(stacked, x, most)
    point: tuple[float, float] | None = built.inside(
        stacked.unknowns, stacked.entries, stacked.arrays, x, most
    )
    return point


@stage("search")
def run(
    stacked: Stacked,
    x: Array,
    r: float,
    enough: float = 0.0,
    tolerance: float = reference.TOLERANCE,
    engine: str | None = None,
    central: bool = False,
) -> Outcome:
    """Run the interior point from F(x, r) > 0 until it converges, or r is at most ``enough``.

    Parameters
    ----------
    tolerance : float
        Of the gap, relative to r.
    engine : str, optional
        "compiled" or "numpy"; by default the compiled one where there is one.
    central : bool
        As of `polefence.lmi.solve.interior_point.run`.

    Raises
    ------
    numpy.linalg.LinAlgError
        If F(x, r) is not positive definite.
    """
    outcome = _run(stacked, x, r, enough, tolerance, engine, central)
    # measured: 0.7 to 2.2 times what a round took, of 36 to 576 unknowns and 64 to 2400 rows
    unknowns = stacked.unknowns
    spend(outcome.iterations * unknowns * (20 * stacked.order + unknowns**2 / 50))
    return outcome


def _run(
    stacked: Stacked,
    x: Array,
    r: float,
    enough: float,
    tolerance: float,
    engine: str | None,
    central: bool,
) -> Outcome:
    """Return what `run` does, by one engine or the other."""
    built = kernel()
    if engine == "numpy" or built is None:
        return reference.run(stacked, x, r, enough, tolerance, central)
    reference.tell(0)
    started, x, r, Y, gap, iterations, converged, trail = built.run(
        stacked.unknowns,
        stacked.entries,
        stacked.arrays,
        x,
        r,
        tolerance,
        enough,
        reference.ORDER,
        reference.MAX_ITERATIONS,
        spare_processors(),
        central=central,
        told=reference.tell,
    )
    if not started:
        raise np.linalg.LinAlgError("the start is not interior")
    return Outcome(x, r, stacked.split(Y), gap, iterations, converged, trail)
