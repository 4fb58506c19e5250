"""The least bound on a signal that a Lyapunov polynomial proves of a law that is given."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.performance import Output, Source, Through, given, unit_of
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.covariance import covariance, intensity
from polefence.lmi.solve.engine import run
from polefence.lmi.solve.lyapunov import Proof, factor, least, start_matrix, sum_of
from polefence.lmi.solve.performance import ROUNDS, WIDE, interior
from polefence.lmi.solve.scaling import power_of_two
from polefence.lmi.solve.singular import singular_is_failure
from polefence.lmi.solve.smallest import TOLERANCE
from polefence.lmi.solve.stacked import stack
from polefence.plant.system import Array
from polefence.region.regions import HalfPlane


@dataclass(frozen=True, eq=False, kw_only=True)
class Point(Proof):
    """Where a search ended; Q is ``left`` times ``scaled`` times its transpose, to rounding.

    Attributes
    ----------
    left : (n, n) array
    scaled : (count, n, n) array
        In the search's own coordinates, in which they are well conditioned.
    """

    left: Array
    scaled: Array


def work(loop: Loop, source: Source, degree: int, elevation: int) -> float:
    """Return about how many multiplications an iteration of the search takes."""
    n, domain = len(next(iter(loop.E.values()))), loop.domain
    size = n + 1 + (source.E.shape[2] if isinstance(source, Through) else 0)
    # each exponent has one inequality for what moves the loop, and one for its output
    blocks = 2 * domain.count(loop.degree + degree + elevation)
    unknowns = domain.count(degree) * (n * (n + 1) // 2 + (loop.R is not None))
    return float(blocks * (size * unknowns) ** 2)


def least_given(
    loop: Loop,
    source: Source,
    output: Output,
    degree: int,
    elevation: int,
    tolerance: float = TOLERANCE,
) -> Proof:
    """Minimise the bound that a Lyapunov polynomial of a given loop proves for one output.

    Parameters
    ----------
    loop : Loop
        Its C has the output's row below those of the dynamics.

    Returns
    -------
    Proof
        ``r`` is the square of the bound over the output's level; of a gain the bound over it.

    Raises
    ------
    SolverError
        If there is no point to start from: the loop is not stable, or has no Lyapunov polynomial of
        this degree; or if floats cannot carry it.
    """
    return points_given(loop, source, output, degree, elevation, tolerance)[0]


@singular_is_failure()
def points_given(
    loop: Loop,
    source: Source,
    output: Output,
    degree: int,
    elevation: int,
    tolerance: float = TOLERANCE,
    near: Proof | None = None,
) -> list[Point]:
    """Return where searches in several coordinates ended, the least r first.

    One that is not the least may still be the one whose exact proof survives rounding. The first to
    converge is the last that is tried.

    Parameters
    ----------
    near : Proof, optional
        A point of this degree, to take the coordinates from.

    Raises
    ------
    SolverError
        As `least_given` does.
    """
    n = len(next(iter(loop.E.values())))
    E, C = sum_of(loop.E), sum_of(loop.C)[:n]
    middle = np.asarray(np.linalg.solve(E.T, C.T).T, dtype=float)
    rate = float(power_of_two(np.abs(np.linalg.eigvals(middle)).max()))
    form, points = (degree, elevation), list[Point]()
    for X in _coordinates(middle / rate, loop, source, near):
        with suppress(np.linalg.LinAlgError):
            found, converged = _rounds(loop, source, output, form, X, rate, tolerance)
            points += [] if found is None or not found.r > 0 else [found]
            if converged:
                break
    if not points:
        raise SolverError("no Lyapunov matrix to start from")
    return sorted(points, key=lambda found: found.r)


def _coordinates(middle: Array, loop: Loop, source: Source, near: Proof | None) -> Iterator[Array]:
    """Yield Lyapunov matrices, each to be tried as the identity where the last is not enough."""
    if loop.R is not None:
        yield sum_of(loop.R)
    elif near is not None:
        yield near.Q.mean(axis=0)
    else:
        own, plain = covariance(middle, intensity(source, loop.domain)), start_matrix(middle)
        first = (plain, own) if isinstance(source, Through) else (own, plain)
        yield from (X for X in (*first, covariance(middle)) if X is not None)


def _rounds(
    loop: Loop,
    source: Source,
    output: Output,
    form: tuple[int, int],
    X: Array,
    rate: float,
    tolerance: float,
) -> tuple[Point | None, bool]:
    """Return what is found from coordinates in which X is the identity; whether it converged."""
    found: Point | None = None
    converged = False
    for _ in range(ROUNDS):
        again = _run(loop, source, output, form, factor(X), rate, found, tolerance)
        if again is None or (found is not None and again[0].r >= found.r * (1 - 1e-7)):
            break
        found, converged = again
        if converged or loop.R is not None:
            break
        X = found.Q.mean(axis=0)
    return found, converged


def _run(
    loop: Loop,
    source: Source,
    output: Output,
    form: tuple[int, int],
    T: Array,
    rate: float,
    near: Proof | None,
    tolerance: float,
) -> tuple[Point, bool] | None:
    inverse = np.asarray(np.linalg.inv(T), dtype=float)
    pencil = given(_changed(loop, T, rate), source.changed(inverse, rate), output, *form)
    stacked, count = stack(pencil), loop.domain.count(form[0])
    for Q, s in _starts(loop, T, form, near):
        values = {f"Q{k + 1}": Q[k % len(Q)] for k in range(count)}
        if loop.R is not None:
            values |= {f"s{k + 1}": s[k % len(s)].reshape(1, 1) for k in range(count)}
        x, r = interior(pencil, stacked, values, {})
        if x is None:
            continue
        try:
            outcome = run(stacked, x, WIDE * r, 0.0, tolerance)
        except np.linalg.LinAlgError:
            continue
        if not (np.isfinite(outcome.r) and np.all(np.isfinite(outcome.x))):
            continue
        back = pencil.unpack(outcome.x)
        t = back[f"t {source.name}"].item() / unit_of(source, rate)
        scaled = np.stack([back[f"Q{k + 1}"] / t for k in range(count)])
        Qs = np.stack([loop.restored(Q, T) for Q in scaled])
        multiple = None
        if loop.R is not None:
            multiple = np.array([back[f"s{k + 1}"].item() / t for k in range(count)])
        left = T if loop.R is None else inverse.T
        point = Point(outcome.r, Qs, multiple, left=left, scaled=scaled)
        return point, outcome.converged
    return None


def _starts(
    loop: Loop, T: Array, form: tuple[int, int], near: Proof | None
) -> Iterator[tuple[Array, Array]]:
    """Yield points Q, multiple: the last one; the law's own W; one that proves stability."""
    n = len(T)
    inverse = np.asarray(np.linalg.inv(T) if loop.R is None else T.T, dtype=float)
    if near is not None:
        yield _moved(near, inverse)
    if loop.R is not None:
        yield np.zeros((1, n, n)), np.ones(1)
    else:
        yield np.eye(n)[None], np.zeros(1)
    with suppress(SolverError):
        plain = Loop(loop.E, {e: p[:n] for e, p in loop.C.items()}, loop.domain, loop.R)
        stable = least(plain, Around(HalfPlane(0)), *form, enough=0.98)
        if stable.r < 1:
            yield _moved(stable, inverse)


def _moved(found: Proof, inverse: Array) -> tuple[Array, Array]:
    Q = inverse @ found.Q @ inverse.T
    return Q, np.zeros(1) if found.multiple is None else found.multiple


def _changed(loop: Loop, T: Array, rate: float) -> Loop:
    """Return the loop in coordinates x = T x_s; outputs stay as they are."""
    n = len(T)
    inverse = np.linalg.inv(T)
    right = T if loop.R is None else inverse.T
    E = {e: inverse @ p @ right for e, p in loop.E.items()}
    C = {e: np.vstack([inverse @ p[:n] / rate, p[n:]]) @ right for e, p in loop.C.items()}
    R = loop.R and {e: inverse @ p @ inverse.T for e, p in loop.R.items()}
    return Loop(E, C, loop.domain, R)
