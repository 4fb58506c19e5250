"""Lyapunov polynomials of a loop that is given: the least r of a region, or of a signal's bound."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain

import numpy as np

from polefence.base.errors import SolverError
from polefence.lmi.conditions.lyapunov import Loop, fed, gain_of, given, sum_of
from polefence.lmi.conditions.pencil import Pencil
from polefence.lmi.conditions.performance import Demands, Output, Source, Through, unit_of
from polefence.lmi.conditions.saturation import GAIN, HELD
from polefence.lmi.conditions.target import Around, Goal, Target
from polefence.lmi.solve.interior_point import TOLERANCE, WIDE, Outcome
from polefence.lmi.solve.scaling import factor, power_of_two
from polefence.lmi.solve.search import (
    FLOOR,
    ROUNDS,
    Point,
    attempt,
    interior,
    rounds,
    singular_is_failure,
)
from polefence.lmi.solve.stacked import Stacked, stack
from polefence.lmi.solve.starts import covariance, start_matrix
from polefence.plant.boxes import equal
from polefence.plant.system import Array
from polefence.region.regions import Region, stable

MOST_STATES = 60  # of a loop for which LMIs are solved: an iteration takes about n^6


@dataclass(frozen=True, eq=False, kw_only=True)
class LyapunovPolynomial(Point):
    """Bernstein coefficients of a Lyapunov polynomial, in the original coordinates.

    Attributes
    ----------
    Q : (count, n, n) array
        To rounding ``left`` times ``scaled`` times the transpose of ``left``.
    multiple : (count,) array, optional
        For scheduled laws, see `polefence.lmi.conditions.lyapunov`.
    left : (n, n) array
    scaled : (count, n, n) array
        In the search's own coordinates, in which they are well conditioned.
    held : (count, m, n) array, optional
        Coefficients of H X, of ``held_degree``, where inputs are cut off.
    pieces : tuple of int
        Of each parameter's interval, in each of which it is one.
    anti_windup : (k, m) array, optional
        The gain that was sought, of the law's own states.
    """

    Q: Array
    multiple: Array | None
    left: Array
    scaled: Array
    held: Array | None = None
    held_degree: int = 0
    pieces: tuple[int, ...] = ()
    anti_windup: Array | None = None


WELL = 0.98  # r of a point that is well inside


def least(
    loop: Loop,
    goal: Goal,
    degree: int,
    elevation: int,
    enough: float = 0.0,
    tolerance: float = TOLERANCE,
    near: LyapunovPolynomial | None = None,
) -> LyapunovPolynomial:
    """Find the least r at which the loop has a Lyapunov polynomial of this degree.

    Parameters
    ----------
    near : LyapunovPolynomial, optional
        Of this degree and another goal, to start from.

    Raises
    ------
    SolverError
        If there is no point to start from: the loop's mean is not inside at any r.
    """
    middle = loop.middle
    size = max(float(np.abs(np.linalg.eigvals(middle)).max()), goal.scale, 1e-100)
    rate = float(power_of_two(np.array(size)))
    target = goal.target(rate).under(loop.motion.changed(rate))
    zero, one, eye = np.zeros(1), np.ones(1), np.eye(len(middle))[None]
    # beside a scheduled law's own W the identity is slight
    plain = [(eye, zero)] if loop.R is None else [(1e-6 * eye, one), (eye, zero)]
    search = _Search(
        loop,
        rate,
        (degree, elevation),
        lambda _: Demands(target, pieces=equal(loop.pieces)),
        lambda: iter(plain),
        tolerance,
        max(enough, FLOOR * (goal.scale if goal.rated else 1)),
        rate if goal.rated else 1.0,
    )
    reached = search.run(start_matrix(middle / rate) if loop.R is None else sum_of(loop.R), near)
    if reached is None:
        raise SolverError("no Lyapunov matrix to start from")
    return reached


def points_inside(
    loop: Loop, region: Region, form: tuple[int, int], enough: float = WELL
) -> Iterator[LyapunovPolynomial]:
    """Yield Lyapunov polynomials for a region: one inside it, of r enough; then the smallest r."""
    for wanted in (enough, 0.0):
        with suppress(SolverError):
            reached = least(loop, Around(region), *form, enough=wanted)
            if reached.r >= 1:
                return
            yield reached


def _inputs_of(demands: Demands) -> tuple[tuple[int, ...], int]:
    """Return the numbers of the inputs that are cut off, of how many."""
    pairs = ((output.held, output.D.shape[2]) for output in demands.outputs if output.held)
    return next(pairs, ((), 0))


def work(loop: Loop, source: Source, degree: int, elevation: int) -> float:
    """Return about how many multiplications an iteration of the search takes."""
    n, domain = len(next(iter(loop.E.values()))), loop.domain
    p = len(next(iter(loop.C.values()))) - n
    size = n + p + source.E.shape[2] if isinstance(source, Through) else 1 + p * n
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
    margin: float = 0.0,
    enough: float = 0.0,
) -> LyapunovPolynomial:
    """Minimise the bound that a Lyapunov polynomial of a given loop proves for one output.

    Parameters
    ----------
    loop : Loop
        Its C has the output's rows below those of the dynamics.
    margin : float
        By how much faster the state is to decay than it does [1/s], of `Noise` and `Points`.
    enough : float
        The r at which the search may end.

    Returns
    -------
    LyapunovPolynomial
        ``r`` is the square of the bound over the output's level; of a gain the bound over it.

    Raises
    ------
    SolverError
        If there is no point to start from: the loop is not stable, or has no Lyapunov polynomial of
        this degree; or if floats cannot carry it.
    """
    form = degree, elevation, tolerance
    return points_given(loop, source, output, *form, margin=margin, enough=enough)[0]


@singular_is_failure()
def points_given(
    loop: Loop,
    source: Source,
    output: Output,
    degree: int,
    elevation: int,
    tolerance: float = TOLERANCE,
    near: LyapunovPolynomial | None = None,
    margin: float = 0.0,
    enough: float = 0.0,
) -> list[LyapunovPolynomial]:
    """Return the results of searches in several coordinates, the least r first.

    One that is not the least may still be the one whose exact proof survives rounding. The first to
    converge is the last that is tried.

    Parameters
    ----------
    near : LyapunovPolynomial, optional
        A point of this degree, to take the coordinates from.
    margin, enough : float
        As `least_given` has them.

    Raises
    ------
    SolverError
        As `least_given` does.
    """
    middle, form = loop.middle, (degree, elevation)
    rate = float(power_of_two(np.abs(np.linalg.eigvals(middle)).max()))

    def demands(T: Array) -> Demands:
        moved = source.changed(np.asarray(np.linalg.inv(T), dtype=float), rate)
        shift, step = margin / rate, loop.step * rate
        target = Target((), motion=loop.motion.changed(rate))
        pieces = equal(loop.pieces)
        signal = output.changed(T, np.eye(output.D.shape[2]))
        return Demands(target, (moved,), (signal,), margin=shift, step=step, pieces=pieces)

    def starts() -> Iterator[Start]:
        n = len(middle)
        yield (np.zeros((1, n, n)), np.ones(1)) if loop.R else (np.eye(n)[None], np.zeros(1))
        with suppress(SolverError):
            within = Around(stable(loop.step))
            # a start has to be well within the region of stability
            reached = least(loop.without_outputs(), within, *form, enough=0.98)
            if reached.r < 1:
                yield reached

    search = _Search(loop, rate, form, demands, starts, tolerance, enough)
    points = list[LyapunovPolynomial]()
    for X in _coordinates(middle / rate, loop, source, near, loop.step * rate):
        reached = search.run(X)
        points += [] if reached is None or not reached.r > 0 else [reached]
        if reached is not None and (reached.converged or reached.r <= enough):
            break
    if not points:
        raise SolverError("no Lyapunov matrix to start from")
    return sorted(points, key=lambda point: point.r)


@singular_is_failure()
def kept_whatever(
    loop: Loop,
    sources: tuple[Through, ...],
    outputs: tuple[Output, ...],
    near: LyapunovPolynomial,
    form: tuple[int, int],
) -> LyapunovPolynomial:
    """Find the Lyapunov polynomial that keeps a part of a region under the largest feedback.

    Parameters
    ----------
    sources, outputs : tuple of Through and Output
        What the feedbacks go to, and from: one for each of the part's inequalities.
    near : LyapunovPolynomial
        Of the part, and of this form.

    Returns
    -------
    LyapunovPolynomial
        ``r`` is one over the norm that each may have.

    Raises
    ------
    SolverError
        If there is no point to start from.
    """
    rate = float(power_of_two(np.abs(np.linalg.eigvals(loop.middle)).max()))

    def demands(T: Array) -> Demands:
        inverse = np.asarray(np.linalg.inv(T), dtype=float)
        moved = tuple(source.changed(inverse, rate) for source in sources)
        return Demands(Target(()), moved, outputs, pieces=equal(loop.pieces))

    # the largest feedback to 1 %
    search = _Search(loop, rate, form, demands, lambda: iter(()), 1e-2)
    X = near.Q.mean(axis=0) if loop.R is None else sum_of(loop.R)
    reached = search.run(X, near)
    if reached is None:
        raise SolverError("no Lyapunov matrix to start from")
    return reached


def _coordinates(
    middle: Array, loop: Loop, source: Source, near: LyapunovPolynomial | None, step: float
) -> Iterator[Array]:
    """Yield Lyapunov matrices as coordinates for the search, in the order to be tried."""
    if loop.R is not None:
        yield sum_of(loop.R)
    elif near is not None:
        yield near.Q.mean(axis=0)
    else:
        driven = covariance(middle, source.intensity(loop.domain), step)
        plain = start_matrix(middle)
        first = (plain, driven) if isinstance(source, Through) else (driven, plain)
        yield from (X for X in (*first, covariance(middle, step=step)) if X is not None)


# Q and multiple in the coordinates of a run, or a polynomial in the original ones.
Start = tuple[Array, Array] | LyapunovPolynomial


@dataclass(frozen=True, eq=False)
class _Search:
    """A search for a Lyapunov polynomial of one form; ``demands`` are those in x = T x_s."""

    loop: Loop
    rate: float
    form: tuple[int, int]
    demands: Callable[[Array], Demands]
    starts: Callable[[], Iterator[Start]]
    tolerance: float
    enough: float = 0.0
    unit: float = 1.0

    def run(self, X: Array, near: LyapunovPolynomial | None = None) -> LyapunovPolynomial | None:
        """Run in rounds, at first from ``near`` or in coordinates in which X is the identity."""
        if len(X) > MOST_STATES:
            return None
        most = ROUNDS if self.loop.R is None else 1
        return rounds(lambda last: self._once(X, last or near), self.enough, most)

    def _once(self, X: Array, last: LyapunovPolynomial | None) -> LyapunovPolynomial | None:
        metric = X if last is None or self.loop.R else last.Q.mean(axis=0)
        with suppress(SolverError, np.linalg.LinAlgError):
            return self._in(factor(metric), last)
        return None

    def _in(self, T: Array, last: LyapunovPolynomial | None) -> LyapunovPolynomial | None:
        """Run from the first start that is one, in coordinates x = T x_s."""
        demands, count = self.demands(T), self.loop.domain.count(self.form[0])
        moved = self.loop.changed(T, self.rate)
        pencil = given(moved, demands, *self.form)
        stacked = stack(pencil)
        for start in chain([] if last is None else [last], self.starts()):
            Q, s = self._moved(start, T) if isinstance(start, LyapunovPolynomial) else start
            values = {f"Q{k + 1}": Q[k % len(Q)] for k in range(count)}
            values |= {f"s{k + 1}": s[k % len(s)].reshape(1, 1) for k in range(count)}
            names = [v.name for v in pencil.variables if v.name[0] == HELD]
            if names:  # at first what is cut off acts as it is
                matrices, more = (np.stack([M[k % len(M)] for k in range(count)]) for M in (Q, s))
                values |= dict(zip(names, fed(moved, matrices, more, self.form[0]), strict=True))
            x, r = self._begun(pencil, stacked, values)
            if x is None:
                continue
            outcome = attempt(stacked, x, WIDE * r, self.enough / self.unit, self.tolerance)
            if outcome is not None:
                return self._polynomial(outcome, pencil.unpack(outcome.x), demands, T)
        return None

    def _begun(
        self, pencil: Pencil, stacked: Stacked, values: dict[str, Array]
    ) -> tuple[Array | None, float]:
        """Return where a run begins; of an anti-windup gain at zero, S as large as it may be."""
        others = [v for v in pencil.variables if v.name.startswith(GAIN)]
        x, r = None, np.inf
        for size in (1.0, 1e-2, 1e-4, 1e-6) if others else (1.0,):
            more = {v.name: size * float(v.name != GAIN) * np.ones(v.shape) for v in others}
            x, r = interior(pencil, stacked, values | more, {})
            if x is not None:
                break
        return x, r

    def _moved(self, point: LyapunovPolynomial, T: Array) -> tuple[Array, Array]:
        inverse = np.asarray(np.linalg.inv(T) if self.loop.R is None else T.T, dtype=float)
        Q = inverse @ point.Q @ inverse.T
        return Q, np.zeros(1) if point.multiple is None else point.multiple

    def _polynomial(
        self, outcome: Outcome, values: dict[str, Array], demands: Demands, T: Array
    ) -> LyapunovPolynomial:
        scalars = (
            values[f"t {source.name}"].item() / unit_of(source, self.rate)
            for source in demands.sources
        )
        t, count = next(scalars, 1.0), self.loop.domain.count(self.form[0])
        scaled = np.stack([values[f"Q{k + 1}"] / t for k in range(count)])
        multiple = None
        if self.loop.R is not None:
            multiple = np.array([values[f"s{k + 1}"].item() / t for k in range(count)])
        names = sorted((name for name in values if name[0] == HELD), key=lambda n: int(n[1:]))
        held = np.stack([values[name] @ T.T / t for name in names]) if names else None
        return LyapunovPolynomial(
            r=self.unit * outcome.r,
            converged=outcome.converged,
            iterations=outcome.iterations,
            Q=np.stack([self.loop.restored(Q, T) for Q in scaled]),
            multiple=multiple,
            left=T if self.loop.R is None else np.asarray(np.linalg.inv(T), dtype=float).T,
            scaled=scaled,
            held=held,
            held_degree=self.loop.input_degree + self.form[0],
            pieces=self.loop.pieces,
            anti_windup=gain_of(values, *_inputs_of(demands)),
        )
