"""Searches of a condition: an interior point to start from, a run, and again from where it ended.

The state coordinates decide how far floats carry: each run is made in those in which the Lyapunov
matrix of its start is the identity, and one that stalls goes on in the coordinates it has reached.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count, takewhile
from typing import TypeVar

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.pencil import Pencil, Variable
from polefence.lmi.solve.engine import inside, run
from polefence.lmi.solve.interior_point import TOLERANCE, Outcome
from polefence.lmi.solve.scaling import Scaling
from polefence.lmi.solve.stacked import Stacked
from polefence.plant.system import Array

ROUNDS = 8
FLOOR = 1e-4  # a radius of this share of the goal's scale is as good as zero


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
        n = len(self.T)
        C = np.zeros((2 * n, 2 * n))
        C[:n, :n] = C[n:, n:] = np.linalg.inv(self.T)
        return np.asarray(C.T @ self.Y @ C)


@dataclass(frozen=True, eq=False, kw_only=True)
class Point:
    """The end of a search.

    Attributes
    ----------
    r : float
        At which the condition holds, to float rounding; of disks the radius [1/s].
    converged : bool
        Whether the search came to its end rather than to its limits.
    iterations : int
    """

    r: float
    converged: bool = False
    iterations: int = 0


def _unknown() -> float:
    return np.inf


@dataclass(frozen=True, eq=False)
class Trail:
    """The iterates of a run, from its start to its end: r, and x in the run's coordinates.

    Of Lemma 1 as a start of another condition, ``variables`` are that one's.
    """

    r: Array
    x: Array
    pencil: Pencil
    scaling: Scaling
    variables: tuple[Variable, ...] = ()

    def points(self) -> Iterator[Reached]:
        """Yield the points, the last first."""
        for r, x in zip(self.r[::-1], self.x[::-1], strict=True):
            values = self.scaling.restore(self.pencil.unpack(x), self.pencil.variables)
            if self.variables:
                values = common_point(values["W"], values["Z"], self.variables)
            yield Reached(r=float(r), values=values, rate=self.scaling.rate)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reached(Point):
    """A point of a condition for a law that is sought, in the original coordinates.

    Attributes
    ----------
    values : dict of str to array
        The condition's matrices.
    t : dict of str to float
        For each source of motion: W / t is its Lyapunov matrix.
    dual : Dual, optional
        Evidence that no radius much smaller is feasible.
    rate : float
        Unit of the search's rates [1/s].
    trails : tuple of Trail
        How it was reached, the last run first.
    residual : callable
        Returns by how much of r its duals miss a lower bound near r, for unknowns no larger than
        here.
    """

    values: dict[str, Array]
    t: dict[str, float] = field(default_factory=dict)
    dual: Dual | None = None
    rate: float = 1.0
    trails: tuple[Trail, ...] = ()
    residual: Callable[[], float] = _unknown

    def path(self) -> list[Reached]:
        """Return the points on the way, the least r first: farther inside, rounding does less."""
        return sorted((p for trail in self.trails for p in trail.points()), key=lambda p: p.r)


def lyapunov_mean(values: dict[str, Array]) -> Array:
    """Return the mean of a condition's Lyapunov matrices, W or, of the slack one, P."""
    matrices = coefficients(values, "W")
    return np.asarray((matrices if len(matrices) else coefficients(values, "P")).mean(axis=0))


def common_point(W: Array, Z: Array, variables: tuple[Variable, ...]) -> dict[str, Array]:
    """Return a point of Lemma 1 as a point of any condition: W for every Lyapunov matrix and G."""
    tiny = np.array([[1e-12 * float(np.linalg.eigvalsh(W)[0])]])
    return {v.name: {"x": W, "u": Z}.get(v.rows, tiny) for v in variables}


def coefficients(values: dict[str, Array], name: str) -> Array:
    """Return a polynomial's Bernstein coefficients, (count, ., .): W alone, or W1, W2 and so on."""
    if name in values:
        return values[name][None]
    matrices = takewhile(
        lambda matrix: matrix is not None, (values.get(f"{name}{k}") for k in count(1))
    )
    return np.array(list(matrices))


P = TypeVar("P", bound=Point)


def rounds(
    once: Callable[[P | None], P | None],
    enough: float = 0.0,
    most: int = ROUNDS,
) -> P | None:
    """Run from the point that the last round reached until the gap closes or nothing is gained.

    Parameters
    ----------
    once : callable
        Takes the last point, None at first; returns the next, None if there is none.
    enough : float
        The r that ends the search.
    """
    best: P | None = None
    iterations = 0
    for _ in range(most):
        again = once(best)
        if again is None:
            break
        if best is not None and again.r >= best.r:
            best = replace(best, converged=best.converged or again.converged)
            break
        # a round that lowers r by no more than 1e-7 of it is the last
        worth = best is None or again.r < best.r * (1 - 1e-7)
        iterations += again.iterations
        best = again
        if best.converged or best.r <= enough or not worth:
            break
    return None if best is None else replace(best, iterations=iterations)


def attempt(
    stacked: Stacked,
    x: Array,
    r: float,
    enough: float = 0.0,
    tolerance: float = TOLERANCE,
    engine: str | None = None,
    widenings: int = 1,
    central: bool = False,
) -> Outcome | None:
    """Run the interior point; None where floats were lost, or F(x, r) is not positive definite.

    Parameters
    ----------
    widenings : int
        How often to try, each time at half as large an r again.
    central : bool
        As of `polefence.lmi.solve.interior_point.run`.

    Raises
    ------
    SolverError
        If there is not memory enough.
    """
    for _ in range(widenings):
        try:
            outcome = run(stacked, x, r, enough, tolerance, engine, central)
        except np.linalg.LinAlgError:
            r *= 1.5
        except MemoryError as error:
            raise SolverError("more inequalities than there is memory for") from error
        else:
            sound = np.isfinite(outcome.r) and np.all(np.isfinite(outcome.x))
            return outcome if sound else None
    return None


@contextmanager
def singular_is_failure() -> Iterator[None]:
    """Raise `SolverError` in place of NumPy's error of singular matrices; a decorator too.

    Raises
    ------
    SolverError
        If NumPy met a singular matrix, or numbers that are not finite.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SolverError(f"no answer in floats: {str(error).lower()}") from error


def interior(
    pencil: Pencil, stacked: Stacked, values: dict[str, Array], t: dict[str, float]
) -> tuple[Array | None, float]:
    """Return x and an r at which it is interior, with the largest scalars t that make it so."""
    names = [v.name for v in pencil.variables if v.name not in values]
    x = pencil.pack(values | {name: np.zeros((1, 1)) for name in names})
    most: Array | None = None
    if names:
        most = pencil.pack(
            {name: np.zeros_like(X) for name, X in values.items()}
            | {name: np.full((1, 1), t.get(name, 1.0)) for name in names}
        )
    point = inside(stacked, x, most)
    if point is None:
        return None, 0.0
    share, r = point
    return x if most is None else x + share * most, r
