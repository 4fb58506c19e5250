"""Dual Lyapunov polynomials of a loop that is given, by interpolation: no LMI is solved.

At each point of a family the least Q of A'Q + Q A + C'C <= 0 is the observability Gramian, an
analytic function of the point: the polynomial that has its values at nodes misses the equation by
what falls off geometrically with its degree. A constant R, added to C'C, makes up for what it
misses: the smallest, as the bound tells sizes, of which no coefficient of the inequality is
negative. What is bounded then exceeds the truth by about what the interpolation misses.

The bound is one number for all points. Where less is true Q may be larger: it is scaled until it
tells about the same everywhere, and varies less. Of a gain Q is the solution of a Riccati equation,
at each point of a level of its own, between the gain there and the one level that is claimed, at
which it then proves more than it needs. Next to the gain itself the solution is an analytic
function of the point, as long as the frequency of the gain is; at one level for all points it has a
branch point just outside the family, where the gain comes to exceed that. Of some shares of the way
between, the best is taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from polefence.base.effort import ended, spend
from polefence.law.laws import Law, right_divide
from polefence.lmi.solve.common import Common, common
from polefence.lmi.solve.loops import loop_degree
from polefence.plant.boxes import MOST_BENT, MOST_PARTS, Box, Point, divided, widest
from polefence.plant.family import UncertainPlant
from polefence.plant.parts import inside, off_along
from polefence.plant.polynomial import Domain, Polynomial, degree_of, values
from polefence.plant.system import Array
from polefence.proof.between import ONE, Clock, Period, Step
from polefence.proof.polynomials import Polynomial as ExactPolynomial
from polefence.proof.polynomials import monomials_of, multinomial
from polefence.proof.remainder import SHARE
from polefence.response.between import factor
from polefence.response.modes import Modes, even_modes, of_modes
from polefence.response.stationary import bilinear, growth

ROUNDS = 8  # in which R grows
OVER = 1.3  # times what is missed, since R moves what is missed
ROOM = 1e-7  # of the bound's square, for rounding
MOST = 3e8  # of the work on one polynomial [multiplications]
# The same on a part of the box, and on all parts. Degree 4 for 16 states and three parameters is
# 1.1e9 and takes 0.3 s; degree 2 in six parameters is more, and minutes for a few parts.
MOST_IN_PART, MOST_IN_PARTS = 1.2e9, 4e10
DEGREES, BENT, IN_ANY_ORDER = (2, 4), (1, 2), (1,)  # on parts of the box; of samples between nodes
LOWEST = 0.03  # of a level, what a point's own is at least
SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the way from what is least to what is claimed
BARELY = 1e-5  # by which a point's own level exceeds the least there
COVERED, TINY = 1.0001, 1e-300  # of rows and columns that cover a remainder
# Of all modes', what each is taken to cost: a van's limit at 10 ms takes 8 parts; with 1e-1 10,
# with 1e-2 9, with 1e-5 10.
LEAST_COST = 1e-3
_ENDS = Domain((2,))
MOST_OVER_CLOCK = 64  # parts: what takes more is missed along the length of a period
NARROW, WIDEST = 2e-3, 1.0  # gaps of centres; a level is then 0.1 % above the least
GAPS = (2e-3, 2e-2, 0.2)  # where no level is asked for
WIDER = (0.5, 0.1)  # of what is between the least and a level, the gap of a centre
SMALL = 1e-7  # of the largest, what a direction is taken to be moved at least


@dataclass(frozen=True, eq=False)
class Dual:
    """Bernstein coefficients of Q (count, n, n), of a degree, and the level that it proves.

    ``cover`` is what a plant with a remainder asks for besides.
    """

    Q: Array
    degree: int
    level: float
    cover: Cover | None = None


@dataclass(frozen=True, eq=False)
class Cover:
    """Rows (n,) and columns (n + m + q,) that cover a remainder, and kappa: see the proof."""

    rows: Array
    columns: Array
    kappa: float


@dataclass(frozen=True, eq=False)
class OverPeriod:
    """What has a mean over a period in place of a value at samples: see `proof.between`.

    Attributes
    ----------
    period : Period
        In exact rationals, on the whole box.
    chosen : list of int
        Which of [x; u] the means are of.
    M, V, c : (count, ., .) arrays, optional
        Bernstein coefficients of upper bounds on a part of the box.
    degree : int
    """

    period: Period
    chosen: list[int]
    M: Array | None = None
    V: Array | None = None
    c: Array | None = None
    degree: int = 0
    clock: Clock | None = None
    ticks: tuple[Ticks, ...] = ()

    def inside(self, box: Box, domain: Domain) -> OverPeriod:
        """Return the bounds on a part of the box."""
        low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
        sizes = tuple(domain.sizes)
        if self.clock is not None:
            wide = (*sizes, 2)
            steps = (
                self.period.between(ends).step_on(low, high, wide) for ends in self.clock.lengths
            )
            return replace(self, ticks=tuple(_ticks(step, domain) for step in steps))
        mean = self.period.on_part(low, high, sizes)
        degree = max(max(P.degrees, default=0) for P in (mean.M, mean.V, mean.c))
        M, V, c = (_coefficients(P, degree) for P in (mean.M, mean.V, mean.c))
        return replace(self, M=M, V=V, c=c, degree=degree)

    def at(self, domain: Domain, alpha: Array) -> tuple[Array, Array, Array]:
        """Return factors of M and V, L'L and L L', and c at points of the part."""
        basis = domain.basis(alpha, self.degree)
        M, V, c = (np.tensordot(basis, P, 1) for P in (self.M, self.V, self.c) if P is not None)
        return np.swapaxes(factor(M), 1, 2), factor(V), c[:, 0, 0]


@dataclass(frozen=True, eq=False)
class Ticks:
    """Periods of any length between two: Bernstein coefficients on the box with one more parameter.

    Attributes
    ----------
    domain : Domain
        Of the parameters.
    lengths : pair of float
        The shortest and the longest, in periods.
    moved : (count, n, k) array
        (exp(N theta T) - 1) / T of what `OverPeriod.chosen` are, in a degree.
    off : (n, k) array
        What its entries are off by.
    M, V, c : (count, ., .) arrays
    degrees : pair of int
        Of all of them, in the parameters and in the length.
    plain : tuple of int
        In the parameters alone: of what moves, of M, of V and of c.
    """

    domain: Domain
    lengths: tuple[float, float]
    moved: Array
    off: Array
    M: Array
    V: Array
    c: Array
    degrees: tuple[int, int]
    plain: tuple[int, int, int, int]

    @property
    def theta(self) -> float:
        """The length in the middle."""
        return sum(self.lengths) / 2

    def at(self, alpha: Array) -> tuple[Array, Array, Array, Array]:
        """Return what moves, factors of M and V, L'L and L L', and c at points."""
        corners = alpha.reshape(len(alpha), -1, 2)
        plain = self.domain.basis(corners.sum(axis=2), self.degrees[0])
        basis = _beside(plain, _ENDS.basis(corners.sum(axis=1), self.degrees[1]))
        moved, M, V, c = (np.tensordot(basis, P, 1) for P in (self.moved, self.M, self.V, self.c))
        return moved, np.swapaxes(factor(M), 1, 2), factor(V), c[:, 0, 0]


def _ticks(step: Step, domain: Domain) -> Ticks:
    mean = step.mean
    every = (step.moved, mean.M, mean.V, mean.c)
    of_moved, of_M, of_V, of_c = (max(P.degrees[:-1], default=0) for P in every)
    plain = of_moved, of_M, of_V, of_c
    along = max(P.degrees[-1] for P in every)
    degrees = (*(max(plain),) * (len(step.theta.sizes) - 1), along)
    theta = _coefficients(step.theta, 1)
    ends = float(theta.min()), float(theta.max())
    off = np.array([[float(x) for x in row] for row in step.off])
    moved, M, V, c = (_coefficients(P, degrees) for P in every)
    return Ticks(domain, ends, moved, off, M, V, c, (max(plain), along), plain)


def _coefficients(P: ExactPolynomial, degrees: int | tuple[int, ...]) -> Array:
    """Return Bernstein coefficients of these degrees in each simplex."""
    degrees = (degrees,) * len(P.sizes) if isinstance(degrees, int) else degrees
    raised = P.raised(degrees)
    none = np.zeros(P.shape)
    return np.array(
        [
            np.array([[x / (raised.whole * multinomial(e, P.sizes)) for x in row] for row in terms])
            if (terms := raised.terms.get(e))
            else none
            for e in monomials_of(P.sizes, degrees)
        ]
    )


@dataclass(frozen=True, eq=False)
class DualProblem:
    """Closed loops of a family, with outputs and disturbances: what a bound is about.

    Attributes
    ----------
    plant : UncertainPlant
    law : Law
    C, D, E, F : arrays (N, ., .)
        At the vertices, disturbances scaled.
    gain : bool
        Whether the bound is the gain from them, else the root of tr E'QE.
    share : Polynomial, optional
        Of the box, what the bound's square is a share of; one by default.
    box : Box, optional
        The part of the box that it is about.
    between : bool
        Whether the loops are samples at the corners of a part, interpolated between them.
    means : OverPeriod, optional
        Of what is bounded between samples too; C, D, E and F then tell only of the samples.
    """

    plant: UncertainPlant
    law: Law
    C: Array
    D: Array
    E: Array
    F: Array
    gain: bool = False
    share: Polynomial | None = None
    box: Box | None = None
    between: bool = False
    means: OverPeriod | None = None

    @property
    def domain(self) -> Domain:
        """Where alpha lives."""
        return self.law.domain_of(self.plant)

    @property
    def step(self) -> float:
        """Of a delta form [s]; zero in continuous time."""
        return float(self.plant.step)

    @property
    def scales(self) -> Array:
        """How many times each disturbance acts, (q,)."""
        if self.means is not None:  # what it is off by is in the means
            return np.zeros(self.E.shape[-1])
        E = np.stack([v.E for v in self.plant.vertices if v.E is not None])
        sizes, entering = (np.abs(M).max(axis=(0, 1)) for M in (self.E, E))
        return np.asarray(sizes / np.where(entering > 0, entering, 1.0))

    @property
    def clocked(self) -> bool:
        """Whether it is about periods of any length."""
        return self.means is not None and self.means.clock is not None

    @property
    def ticking(self) -> bool:
        """Whether it is about a part of the box, with periods of any length."""
        return self.means is not None and bool(self.means.ticks)

    @property
    def rows(self) -> int:
        """Degree of A W + B Z, and at most that of C W + D Z."""
        return loop_degree(self.plant, self.law)

    @property
    def left(self) -> int:
        """Degree of W, by which all is multiplied from the left."""
        return self.law.denominator_degree

    @property
    def degree(self) -> int:
        """Degree of what is multiplied with Q."""
        return self.left + self.rows

    @property
    def share_degree(self) -> int:
        """Degree of that polynomial."""
        return 0 if self.share is None else degree_of(self.share, self.domain)

    def shares(self, alpha: Array) -> Array:
        """Return the reference variance of a bound's square at points."""
        if self.share is None:
            return np.ones(len(alpha))
        return values(self.share, self.domain, alpha)[:, 0, 0]

    def inside(self, box: Box) -> DualProblem:
        """Return the problem on a part of the box; of samples with their corners there."""
        means = self.means and self.means.inside(box, self.domain)
        if not self.plant.bent:
            return replace(self, box=box, means=means)
        low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
        plant = inside(self.plant, low, high)
        alpha = box.alpha(self.domain, self.domain.nodes(1))
        C, D, F = (np.tensordot(alpha, M, 1) for M in (self.C, self.D, self.F))
        E = np.stack([v.E for v in plant.vertices if v.E is not None]) * self.scales
        law = self.law.inside(plant, low, high)
        problem = replace(self, plant=plant, law=law, C=C, D=D, E=E, F=F)
        return replace(problem, between=True, means=means)

    def work(self, degree: int) -> float:
        """Return about how many multiplications a round takes for Q of a degree."""
        n, count = self.plant.shape[0], self.domain.count(self.degree + degree)
        return float(count) ** 2 * n**2 + count * (2 * n) ** 3 * 10

    @property
    def widest(self) -> int:
        """Number of the parameter along which the closed loop changes most, in its part."""
        return widest(
            self.domain,
            lambda alpha: self.closed(alpha)[0],
            lambda poles: -growth(poles, self.step),
            None if self.box is None else self._off_along(self.box),
        )

    def _off_along(self, box: Box) -> Array | None:
        """Return what entries of the closed loop on a part are off by along each parameter."""
        means = self.means
        if means is None or means.clock is None:
            return off_along(self.plant, self.law.gain, box)
        period, (n, m) = means.period.between(means.clock.lengths[-1]), self.plant.shape
        units = np.array(period.units, dtype=float)
        sides = np.subtract(box.high, box.low)
        off = np.zeros((len(sides), n, n + m))
        bends = np.array(period.bends, dtype=float) / ONE / float(period.step)
        off[:, : period.n, means.chosen] = bends * units[: period.n, None] / units
        off *= sides[:, None, None] ** 2
        K = self.law.gain(
            box.alpha(self.domain, np.full(self.domain.corners, 1 / self.domain.corners))
        )
        return np.asarray(off[..., :n] + off[..., n:] @ np.abs(K))

    def form(self, alpha: Array) -> Array:
        """Return [W; Z], or [I; K], at points."""
        if self.box is not None:
            alpha = self.box.alpha(self.domain, alpha)
        return np.concatenate(self.law.parts(alpha), axis=1)

    def at(self, alpha: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return W (I but of scheduled laws), A W + B Z, C W + D Z, E and F at points.

        Of a part of the box alpha are weights of its own corners.
        """
        here = alpha
        if self.means is not None and self.means.ticks:
            return self.ticked(self.means.ticks[-1], _longest(alpha))[:5]
        if self.box is not None:
            alpha = self.box.alpha(self.domain, alpha)
        A, B = self.plant.at(alpha)
        C, D, F = (np.tensordot(alpha, M, 1) for M in (self.C, self.D, self.F))
        curved = self.plant.curve_degree > 1
        E = self.plant.driven(alpha) * self.scales if curved else np.tensordot(alpha, self.E, 1)
        W, Z = self.law.parts(alpha)
        if self.means is None or self.means.M is None:
            return W, A @ W + B @ Z, C @ W + D @ Z, E, F
        energy, noise, _ = self.means.at(self.domain, here)
        Y = energy @ np.concatenate([W, Z], axis=1)[:, self.means.chosen]
        E = np.zeros((len(W), W.shape[1], noise.shape[-1]))
        E[:, : noise.shape[1]] = noise
        return W, A @ W + B @ Z, Y, E, np.zeros((len(W), Y.shape[1], E.shape[2]))

    def ticked(self, ticks: Ticks, alpha: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Return what `at` does, and what no law changes, for periods of any length.

        Parameters
        ----------
        alpha : (count, N) array
            Weights of the corners of the part of the box with the period.
        """
        own = alpha.reshape(len(alpha), -1, 2).sum(axis=2)
        at = own if self.box is None or self.between else self.box.alpha(self.domain, own)
        A, B = self.plant.at(at)
        moved, energy, noise, more = ticks.at(alpha)
        first, n = moved.shape[1], A.shape[1]
        AB = np.concatenate([A, B], axis=2)
        AB[:, :first] = 0.0
        chosen = [] if self.means is None else self.means.chosen
        AB[:, :first, chosen] = moved
        form = self.form(own)
        W, Y = form[:, :n], energy @ form[:, chosen]
        E = np.zeros((len(own), n, noise.shape[-1]))
        E[:, : noise.shape[1]] = noise
        return W, AB @ form, Y, E, np.zeros((len(own), Y.shape[1], E.shape[2])), more

    def entries(self, ticks: Ticks | None) -> Array | None:
        """Return what each entry of [A, B, E] may be off by."""
        remainder = self.plant.remainder
        if remainder is None:
            return None
        entries = np.array(remainder.entries, dtype=float)
        if ticks is not None and self.means is not None:
            entries[: len(ticks.off)] = 0.0
            entries[: len(ticks.off), self.means.chosen] = ticks.off
        return entries

    def more(self, alpha: Array) -> Array:
        """Return what no law changes of the bound's square, at points of the part."""
        if self.means is not None and self.means.ticks:  # as `at`
            return self.ticked(self.means.ticks[-1], _longest(alpha))[5]
        if self.means is None or self.means.c is None:
            return np.zeros(len(alpha))
        return self.means.at(self.domain, alpha)[2]

    def closed(self, alpha: Array) -> tuple[Array, Array, Array, Array]:
        """Return A + B K, C + D K, E and F at points."""
        W, N, Y, E, F = self.at(alpha)
        if self.law.W is None:
            return N, Y, E, F
        return right_divide(N, W), right_divide(Y, W), E, F


def _beside(alpha: Array, ends: Array) -> Array:
    """Return weights of the corners of a box with one more parameter."""
    return np.asarray((alpha[:, :, None] * ends[:, None, :]).reshape(len(alpha), -1))


def _longest(alpha: Array) -> Array:
    """Return weights of points with the longest period."""
    return _beside(alpha, np.tile((0.0, 1.0), (len(alpha), 1)))


def riccati(A: Array, S: Array, Q: Array) -> Array | None:
    """Return the stabilising X of A'X + X A + X S X + Q = 0, batched; None where there is none."""
    n = A.shape[-1]
    values, V = np.linalg.eig(_hamiltonian(A, S, Q))
    if not np.all((values.real < 0).sum(axis=-1) == n):
        return None
    order = np.argsort(values.real, axis=-1)[..., :n]
    stable = np.take_along_axis(V, order[..., None, :], axis=-1)
    X = np.linalg.solve(stable[..., :n, :].swapaxes(-1, -2), stable[..., n:, :].swapaxes(-1, -2))
    real = X.swapaxes(-1, -2).real
    return np.asarray((real + real.swapaxes(-1, -2)) / 2)


def has_stabilising(A: Array, S: Array, Q: Array) -> Array:
    """Whether there is a stabilising solution, of each of a batch: no root on that axis."""
    values = np.linalg.eigvals(_hamiltonian(A, S, Q))
    # a root of 1e-7 of the largest is taken for the axis
    return np.asarray(np.abs(values.real).min(-1) > 1e-7 * np.abs(values).max(-1))


def _hamiltonian(A: Array, S: Array, Q: Array) -> Array:
    top = np.concatenate([A, S], axis=-1)
    return np.concatenate([top, np.concatenate([-Q, -A.swapaxes(-1, -2)], axis=-1)], axis=-2)


def duals(problem: DualProblem, worst: float, near: float = 1e-3, most: int = 4) -> Iterator[Dual]:
    """Yield dual polynomials of rising degree until one proves a level near the worst sample.

    Parameters
    ----------
    worst : float
        What is bounded, at the worst point known.
    near : float
        How far above it a level ends the climb, as a share.
    most : int
        The highest degree.
    """
    first = int(problem.domain.corners > 1)
    if first and problem.clocked:  # parts of the box take less
        return
    if problem.means is not None:
        whole = problem.means.inside(Box.whole(problem.domain), problem.domain)
        problem = replace(problem, means=whole)
    for degree in range(first, most + 1 if first else 1):
        if problem.work(degree) * ROUNDS > MOST and degree > first:
            return
        dual: Dual | None = None
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            dual = _of(problem, degree).least(worst)
        if dual is not None:
            yield dual
            if dual.level <= worst * (1 + near):
                return


@dataclass(frozen=True, eq=False)
class Part:
    """A dual polynomial on a part of the box; ``low`` and ``high`` are weights of upper ends."""

    low: Point
    high: Point
    dual: Dual


Known = dict[tuple[Box, int], Dual | None]  # what was found in a part, of a degree


def in_parts(
    problem: DualProblem, level: float, most: int | None = None, known: Known | None = None
) -> list[Part] | None:
    """Return a partition of the box with a dual polynomial that proves the level on each part.

    A part on which none does is halved along the parameter along which the loop changes most.

    Parameters
    ----------
    most : int
        How many parts there may be; None is returned where that is not enough.
    known : dict, optional
        What was found for lower levels of the problem; what is found now is added.
    """
    known = {} if known is None else known
    most = most or (MOST_BENT if problem.plant.bent else MOST_PARTS)
    if problem.clocked:
        most = min(most, MOST_OVER_CLOCK)
    by_level = problem.gain or problem.plant.remainder is not None
    if not problem.law.divisible(problem.plant) or problem.share is not None:
        return None
    whole = Box.whole(problem.domain)
    first = problem.inside(whole)
    tried: tuple[int, ...] = BENT if problem.plant.bent else DEGREES
    if problem.clocked:  # where one is not enough, parts take less than a higher one
        tried = IN_ANY_ORDER
    work = {degree: first.work(degree) * ROUNDS for degree in tried}
    degrees = [d for d in work if work[d] <= MOST_IN_PART]
    if not degrees:
        return None

    done = 0.0

    def proving(box: Box) -> Dual | None:
        nonlocal done
        for degree in degrees:
            dual = known.get((box, degree))
            # of a gain alone it hangs on the level whether there is one
            if dual is None and (by_level or (box, degree) not in known):
                dual = next(_duals(problem.inside(box), level, [degree]), None)
                known[box, degree] = dual
                done += work[degree]
                spend(0.3 * work[degree])  # measured: 0.3 operations a multiplication
            if dual is not None and dual.level < level:
                return dual
        return None

    def along(box: Box) -> int | None:
        late = done > MOST_IN_PARTS or ended()
        return None if late else replace(problem, box=box).widest

    parts = divided([whole], proving, along, most)
    return None if parts is None else [Part(box.low, box.high, dual) for box, dual in parts]


def _duals(problem: DualProblem, level: float, degrees: Sequence[int]) -> Iterator[Dual]:
    """Yield dual polynomials of some degrees on a part, for a gain at the level itself."""
    for degree in degrees:
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            dual = _of(problem, degree).proving(level)
            if dual is not None:
                yield dual


@dataclass(frozen=True, eq=False)
class _Interpolation:
    """The search for R at one degree of Q."""

    problem: DualProblem
    degree: int

    @cached_property
    def nodes(self) -> tuple[Array, Array, Array, Array]:
        """The closed loops at the nodes of Q."""
        return self.problem.closed(self.problem.domain.nodes(self.degree))

    @cached_property
    def modes(self) -> Modes:
        """Their modes."""
        return Modes(self.nodes[0], self.problem.step)

    @cached_property
    def raised(self) -> tuple[Array, tuple[Array, Array, Array, Array, Array]]:
        """The values of the Bernstein polynomials of Q, and the loops, at the product's nodes."""
        domain = self.problem.domain
        at = domain.nodes(self.total)
        return domain.basis(at, self.degree), self.problem.at(at)

    @cached_property
    def bounded(self) -> tuple[int, Array, Array, Array, Array]:
        """Of what is a share: its degree; Q's basis and E at its nodes; its coefficients; more."""
        problem, domain, degree = self.problem, self.problem.domain, self.total
        if problem.share is not None:
            varies = bool(np.ptp(problem.E, axis=0).any())
            degree = max(
                problem.share_degree, self.degree + 2 * varies * problem.plant.curve_degree
            )
        at = domain.nodes(degree)
        shares = domain.interpolated(problem.shares(at), degree)
        more = problem.more(at)
        return degree, domain.basis(at, self.degree), problem.at(at)[3], shares, more

    @cached_property
    def units(self) -> Array:
        """T in which the mean covariance of the state is about the identity, X = T T'."""
        X = self.modes.covariance(self.nodes[2]).mean(axis=0)
        size = np.sqrt(np.maximum(np.diag(X), 0))
        size = np.where(size > 0, size, size.max() or 1.0)
        values, V = np.linalg.eigh(X / np.outer(size, size))
        values = np.maximum(values, SMALL * max(values.max(), SMALL))
        return np.asarray(size[:, None] * V * np.sqrt(values))

    def least(self, worst: float) -> Dual | None:
        """Return the dual, for a gain at the first level that has one."""
        if not self.problem.gain:
            return self._grown(None)
        # above the worst sample
        grown = (self._grown(worst * (1 + above)) for above in (1e-4, 1e-3, 5e-3, 2e-2, 0.1))
        return next((dual for dual in grown if dual is not None), None)

    def proving(self, level: float) -> Dual | None:
        """Return the dual below the level, for a gain somewhat below it."""
        if self.problem.gain:
            return self._grown(level * (1 - ROOM))
        dual = self._even(level) if self.problem.between and level < np.inf else None
        curved = self.problem.plant.curve_degree > 1 or self.problem.ticking
        if dual is None and (not self.problem.between or curved):
            return self._grown(None)
        return dual

    def _even(self, level: float) -> Dual | None:
        """Return the dual whose R makes up for what Gramians miss, and then is even over all modes.

        Q = Q_0 + Q_R + r Q_S. Of R each mode has a share of its own: it exceeds what Q_0 misses.
        S is that of which Q_S is the sum of w w* over the left eigenvectors w in the middle: what
        is missed further may be the same share of each. Where R alone costs more than the level
        allows the part is too large.

        What Q_0 misses is mostly that of one slow pole, which costs next to nothing. With S alone
        a limit of twice the worst case took 26 parts for a van's law of order 2 at 10 ms, with R
        it takes 8, and another limit 40 where 400 were not enough.
        """
        domain = self.problem.domain
        closed, Y, *_ = self.nodes
        at_middle = self.problem.closed(np.full((1, domain.corners), 1 / domain.corners))
        modes = even_modes(at_middle[0][0].T, self.problem.step)
        if modes is None:
            return None
        least = self.modes.observed(Y.swapaxes(-1, -2) @ Y)
        whole = (level * (1 - ROOM)) ** 2 - self._largest(least, self._more_at_nodes)
        if whole <= 0:
            return None
        missed, _ = self._missed(domain.interpolated(least, self.degree), None)
        V, inside = modes
        R = of_modes(V, inside * made_up(missed, V, inside, at_middle[2][0]))
        S = of_modes(V, inside)
        first, more = (self.modes.observed(0 * closed + M) for M in (R, S))
        of_first, of_more = self._largest(first), self._largest(more)
        for share in (0.9, 0.5, 0.1):  # of what is between the least and the level
            room = share * whole - of_first
            if room <= 0 or of_more <= 0:
                return None
            r = room / of_more
            Q = domain.interpolated(least + first + r * more, self.degree)
            T = np.linalg.inv(np.linalg.cholesky(R + r * S))
            cover = self._cover(Q, None, T.T)
            missed, bound = self._missed(Q, None, cover)
            if bound < level and np.linalg.eigvalsh(T @ missed @ T.T).max() < 0:
                return Dual(Q, self.degree, bound, cover)
        return None

    def _largest(self, Q: Array, more: Array | float = 0.0) -> float:
        """Return the largest tr E'QE at the nodes, with what is added to it."""
        E = self.nodes[2]
        return float((np.einsum("pik,pij,pjk->p", E, Q, E) + more).max())

    @cached_property
    def _more_at_nodes(self) -> Array:
        return self.problem.more(self.problem.domain.nodes(self.degree))

    def _grown(self, level: float | None) -> Dual | None:
        """Let R grow until every coefficient is positive; None if it does not end."""
        T, n, cover = self.units, len(self.units), None
        inverse, R, over = np.linalg.inv(T), np.zeros((n, n)), OVER
        share, unit = SHARES[0], float(self.problem.shares(self.problem.domain.nodes(0))[0])
        least: Array = np.zeros(len(self.nodes[0]))
        if self.problem.plant.remainder is not None:  # what is not observed must cost a little
            R = 1e-6 * self._size(level) ** 2 * unit * inverse.T @ inverse
        for k in range(ROUNDS):
            if level is not None:
                higher = self._least(R, level, least)
                if higher is None:
                    return None
                least = higher
            share = share if k else self._share(level, least)
            Q = self._solutions(R, level, least, share)
            if Q is None:
                return None
            if self.problem.plant.remainder is not None:
                cover = self._cover(Q, cover)
            missed, bound = self._missed(Q, level, cover)
            missed = T.T @ missed @ T
            if np.linalg.eigvalsh(missed).max() < 0 < np.linalg.eigvalsh(T.T @ Q[0] @ T).min():
                return Dual(Q, self.degree, bound, cover)
            room = ROOM * bound**2 * unit
            more, over = over * majorant(missed) + room * np.eye(n), over * OVER
            R = R + inverse.T @ more @ inverse
        return None

    def _size(self, level: float | None) -> float:
        """Return an estimate of the bound."""
        if level is not None:
            return level
        _, Y, E, _ = self.nodes
        Q = self.modes.observed(Y.swapaxes(-1, -2) @ Y)
        return float(np.sqrt(np.einsum("pik,pij,pjk->p", E, Q, E).max()))

    def _solutions(self, R: Array, level: float | None, least: Array, share: float) -> Array | None:
        """Return Bernstein coefficients of solutions at a level a share above the least one."""
        Q: Array | None
        if level is None:
            _, Y, E, _ = self.nodes
            Q = self.modes.observed(Y.swapaxes(-1, -2) @ Y + R)
            at = self.problem.domain.nodes(self.degree)
            squares = np.einsum("pik,pij,pjk->p", E, Q, E) / self.problem.shares(at)
            more = self._more_at_nodes
            top = float((squares + more).max())
            if top > 0:
                wanted = np.maximum(top - more, squares)
                Q *= (wanted / np.maximum(squares, LOWEST**2 * top))[:, None, None] ** (1 - share)
        else:
            levels = np.minimum(least * (1 + BARELY), level)
            Q = riccati(*self._equations(R, levels ** (1 - share) * level**share))
        if Q is None or not np.all(np.isfinite(Q)):
            return None
        return self.problem.domain.interpolated(Q, self.degree)

    def _share(self, level: float | None, least: Array) -> float:
        """Return the share with which the least is missed before there is an R."""
        T, zero, sizes = self.units, np.zeros_like(self.units), []
        for share in SHARES:
            Q = self._solutions(zero, level, least, share)
            missed = None if Q is None else T.T @ self._missed(Q, level)[0] @ T
            sizes.append(np.inf if missed is None else float(np.trace(majorant(missed))))
        return SHARES[int(np.argmin(sizes))]

    def _equations(self, R: Array, levels: Array) -> tuple[Array, Array, Array]:
        """Return A, S and Q of the Riccati equations of levels at the nodes."""
        A, Y, E, F = self._with_outputs(R, levels)
        R = np.zeros_like(R) if self.problem.step else R
        a, b, c = _inverse(levels[:, None, None], F)
        return A + E @ b @ Y, E @ a @ E.swapaxes(-1, -2), Y.swapaxes(-1, -2) @ c @ Y + R

    def _with_outputs(self, R: Array, levels: Array) -> tuple[Array, Array, Array, Array]:
        """Return A, C, E and F of the nodes; of a delta form with R as further outputs.

        They are then those of its bilinear transform, of which the Riccati equation has the same
        solution.
        """
        A, Y, E, F = self.nodes
        step = self.problem.step
        if not step:
            return A, Y, E, F
        Y = np.concatenate([Y, np.sqrt(levels)[:, None, None] * _root(R)], axis=1)
        A, inverse = bilinear(A, step)
        F = _above_zeros(F, len(R)) - step / 2 * Y @ inverse @ E
        return A, Y @ inverse, inverse @ E, F

    def _least(self, R: Array, level: float, low: Array) -> Array | None:
        """Return the least levels at which there are solutions at the nodes, with R.

        None where one is above the level; ``low`` are known to be no more.
        """
        F = self._with_outputs(R, np.full(len(self.nodes[0]), level))[3]
        straight = np.linalg.norm(F, 2, axis=(-2, -1)) * (1 + BARELY)
        low, high = np.maximum(np.maximum(low, LOWEST * level), straight), np.full(len(F), level)
        if low.max() > level or not np.all(has_stabilising(*self._equations(R, high))):
            return None
        # the search begins this close above the last least level
        middle = np.minimum(low * (1 + 1e-3), level)
        while np.any(low < high / (1 + BARELY / 2)):
            there = has_stabilising(*self._equations(R, middle))
            low, high = np.where(there, low, middle), np.where(there, middle, high)
            middle = np.sqrt(low * high)
        return high

    def _cover(self, Q: Array, known: Cover | None, units: Array | None = None) -> Cover:
        """Return what covers the remainder at about the least cost, with a kappa that holds.

        ``units`` are those in which what is missed is judged; by default those of the states.
        """
        units = self.units if units is None else units
        rows, columns = (known.rows, known.columns) if known else self._cheapest(Q, units)
        H = np.diag(rows)
        kappa = float(np.linalg.eigvalsh(H @ Q @ H).max()) * OVER
        return Cover(rows, columns, max(kappa, TINY))

    def _cheapest(self, Q: Array, units: Array) -> tuple[Array, Array]:
        """Return rows and columns that cover the remainder at about the least cost in units."""
        remainder = self.problem.plant.remainder
        entries = () if remainder is None else remainder.entries
        basis, (W, N, *_) = self.raised
        P = (W + self.problem.step * N).swapaxes(-1, -2) @ np.tensordot(basis, Q, 1)
        V = self.problem.form(self.problem.domain.nodes(self.total))
        a = np.square(units.T @ P).sum(axis=-2).max(axis=0)
        b = np.square(V @ units).sum(axis=-1).max(axis=0)
        return cheapest(np.array(entries, dtype=float), a, b)

    def _driving(self, cover: Cover) -> Array:
        """Return the columns of the disturbances as they are scaled."""
        known = sum(self.problem.plant.shape)
        return np.asarray(cover.columns[known:] * self.problem.scales)

    def _cost(self, Q: Array, both: Array, cover: Cover) -> tuple[Array, Array]:
        """Return what a remainder adds to the inequality at points, and the border's P H."""
        _, (W, N, *_) = self.raised
        step, n = self.problem.step, Q.shape[-1]
        V = self.problem.form(self.problem.domain.nodes(self.total))
        V = cover.columns[: V.shape[1], None] * V
        P = (W + step * N).swapaxes(-1, -2) @ Q
        loss = (1 + step * cover.kappa) * V.swapaxes(-1, -2) @ V
        return both + loss, P * cover.rows[:n]

    def _missed(
        self, coefficients: Array, level: float | None, cover: Cover | None = None
    ) -> tuple[Array, float]:
        """Return the violation of the inequality by each coefficient, and the bound."""
        basis, (W, N, Y, E, F) = self.raised
        Q, step = np.tensordot(basis, coefficients, 1), self.problem.step
        WQ = W @ Q
        both, Yt = WQ @ N, Y.swapaxes(-1, -2)
        both = both + both.swapaxes(-1, -2)
        if step:
            both = both + step * N.swapaxes(-1, -2) @ Q @ N
        border: Array | None = None
        if cover is not None:
            both, border = self._cost(Q, both, cover)
        if level is None:
            bound = float(np.sqrt(max(self._ratios(coefficients).max(), 0.0)))
            if cover is not None:
                bound = self._more(bound, cover)
            missed = self._bernstein(both + Yt @ Y)
            if border is not None:
                PH = self._bernstein(border)
                missed = missed + PH @ PH.swapaxes(-1, -2)
        elif step:
            bound, QE = level, step * Q @ E
            U = WQ @ E + N.swapaxes(-1, -2) @ QE
            missed = self._above_step(level, both, U, QE, border, cover)
        elif not np.any(F):
            bound, QE = level, WQ @ E
            missed = self._bernstein(both + (Yt @ Y + QE @ QE.swapaxes(-1, -2)) / level)
        else:
            bound, (N, QE, Y, F) = level, map(self._bernstein, (both, WQ @ E, Y, F))
            a, b, c = _inverse(level, F)
            cross, Yt = QE @ b @ Y, Y.swapaxes(-1, -2)
            missed = N + QE @ a @ QE.swapaxes(-1, -2) + cross + cross.swapaxes(-1, -2) + Yt @ c @ Y
        if self.problem.law.W is not None:
            middle = np.linalg.inv(W.mean(axis=0))
            missed = middle.T @ missed @ middle
        return missed, bound

    def _more(self, bound: float, cover: Cover) -> float:
        """Return the bound with the remainder of the disturbances added."""
        share, driving = float(SHARE), self._driving(cover)
        if not np.any(driving):
            return bound
        more = (1 + 1 / share) * cover.kappa * float(np.sum(driving**2))
        return float(np.sqrt((1 + share) * bound**2 + more))

    def _above_step(
        self,
        level: float,
        both: Array,
        U: Array,
        QE: Array,
        border: Array | None,
        cover: Cover | None,
    ) -> Array:
        """Return the violation of the delta form's lemma by each coefficient; see `proof.Gain`."""
        _, (_, _, Y, E, F) = self.raised
        q = E.shape[-1]
        corner = level * np.eye(q) - E.swapaxes(-1, -2) @ QE
        if cover is not None and border is not None:
            share = 1 + self.problem.step * cover.kappa
            corner = corner - share * np.diag(self._driving(cover) ** 2)
            below = QE.swapaxes(-1, -2) * cover.rows
            whole = np.concatenate([border, below], -2)
            whole = self._bernstein(whole)
            squares = whole @ whole.swapaxes(-1, -2)
            n = both.shape[-1]
            both, U, corner = map(self._bernstein, (both, U, corner))
            both, U, corner = (
                both + squares[:, :n, :n],
                U + squares[:, :n, n:],
                corner - squares[:, n:, n:],
            )
            Y, F = map(self._bernstein, (Y, F))
            return self._complement(level, both, U, corner, Y, F)
        both, U, Y, F, corner = map(self._bernstein, (both, U, Y, F, corner))
        return self._complement(level, both, U, corner, Y, F)

    @staticmethod
    def _complement(
        level: float, both: Array, U: Array, corner: Array, Y: Array, F: Array
    ) -> Array:
        """Return both + [U, Y'] [ corner, -F'; -F, level I ]^-1 [U, Y']'."""
        p = Y.shape[-2]
        below = np.concatenate([-F, np.broadcast_to(level * np.eye(p), (len(F), p, p))], -1)
        beside = np.concatenate([corner, -F.swapaxes(-1, -2)], -1)
        middle = np.concatenate([beside, below], -2)
        left = np.concatenate([U, Y.swapaxes(-1, -2)], -1)
        if np.linalg.eigvalsh(middle).min() <= 0:
            raise np.linalg.LinAlgError("the level is below the way straight through")
        return np.asarray(both + left @ np.linalg.solve(middle, left.swapaxes(-1, -2)))

    def _ratios(self, Q: Array) -> Array:
        """Return the ratios of the coefficients of tr E'QE to those of the reference variance.

        Infinite where the latter are not all positive.
        """
        degree, basis, E, shares, more = self.bounded
        squares = np.einsum("pik,pij,pjk->p", E, np.tensordot(basis, Q, 1), E) + more
        coefficients = self.problem.domain.interpolated(squares, degree)
        return coefficients / shares if shares.min() > 0 else np.full_like(coefficients, np.inf)

    def _bernstein(self, values: Array) -> Array:
        return self.problem.domain.interpolated(values, self.total)

    @property
    def total(self) -> int:
        """Degree of the inequality."""
        problem = self.problem
        squares = [2 * problem.rows]
        if problem.step:
            squares.append(self.degree + 2 * problem.rows)
        elif problem.gain and not np.any(problem.F):
            varies = bool(np.ptp(problem.E, axis=0).any())
            from_E = varies * problem.plant.curve_degree
            squares.append(2 * (self.degree + problem.left + from_E))
        return max(self.degree + problem.degree, *squares)


def _of(problem: DualProblem, degree: int) -> _Interpolation:
    """Return the search for R, over a clock where the samples have one."""
    if problem.ticking:
        return _OverClock(problem, degree)
    return _Interpolation(problem, degree)


@dataclass(frozen=True, eq=False)
class _OverClock(_Interpolation):
    """The search for R where Q has to do for periods of any length.

    At a node Q is the centre of those that do for the shortest and the longest period of each part
    of the clock: see `polefence.lmi.solve.common`. R makes up for what that misses.
    """

    gap: float = NARROW

    @cached_property
    def parts(self) -> list[Ticks]:
        """The parts of the periods."""
        return [] if self.problem.means is None else list(self.problem.means.ticks)

    @property
    def along(self) -> int:
        """Degree of what moves in the length of a period."""
        return max(ticks.degrees[1] for ticks in self.parts)

    def plain(self, k: int) -> int:
        """Degree in the parameters of what moves, of M, of V or of c."""
        return max(ticks.plain[k] for ticks in self.parts)

    @property
    def degrees(self) -> tuple[int, int]:
        """Of the inequality, in the parameters and in the length of a period."""
        law = self.problem.law
        rows = self.plain(0) + law.degree
        plain = max(self.degree + self.problem.left + rows, self.degree + 2 * rows)
        return max(plain, self.plain(1) + 2 * law.degree), 2 * self.along

    @property
    def degrees_of_noise(self) -> tuple[int, int]:
        """The same of what the noise adds."""
        return max(self.degree + self.plain(2), self.plain(3)), self.along

    @cached_property
    def looped(self) -> list[tuple[Array, Array, tuple[Array, ...]]]:
        """For each the weights, Q's basis and the loops at the nodes of the inequality."""
        return [self._at(ticks, self.degrees) for ticks in self.parts]

    @cached_property
    def driven(self) -> list[tuple[Array, Array, tuple[Array, ...]]]:
        """The same at those of what the noise adds."""
        return [self._at(ticks, self.degrees_of_noise) for ticks in self.parts]

    def _at(self, ticks: Ticks, degrees: tuple[int, int]) -> tuple[Array, Array, tuple[Array, ...]]:
        plain, theta = self.problem.domain.nodes(degrees[0]), _ENDS.nodes(degrees[1])
        alpha = _grid(plain, theta)
        own = np.repeat(plain, len(theta), axis=0)
        basis = self.problem.domain.basis(own, self.degree)
        return own, basis, self.problem.ticked(ticks, alpha)

    def _coefficients(self, values: Array, degrees: tuple[int, int]) -> Array:
        """Return Bernstein coefficients of what has these values at the nodes."""
        plain, count = self.problem.domain, degrees[1] + 1
        table = values.reshape(-1, count, *values.shape[1:])
        table = plain.interpolated(table, degrees[0])
        turned = _ENDS.interpolated(np.swapaxes(table, 0, 1), degrees[1])
        return np.asarray(np.swapaxes(turned, 0, 1).reshape(values.shape))

    def least(self, worst: float) -> Dual | None:  # noqa: ARG002
        """Return the least dual of some gaps: what is missed asks for one of its own."""
        some = (replace(self, gap=gap)._grown(None) for gap in GAPS)
        return min(filter(None, some), key=attrgetter("level"), default=None)

    def proving(self, level: float) -> Dual | None:
        """Return the dual below the level: of what is between the least and it, Q takes a share."""
        narrow = self._centres(np.zeros_like(self.units))
        if narrow is None:
            return None
        more = max(float(ticks.c.max()) for ticks in self.parts)
        whole = (level * (1 - ROOM)) ** 2 - float(narrow.cost.max()) - more
        for share in WIDER:
            if whole <= 0:
                return None
            gap = share * whole / float(narrow.base.max())
            dual = replace(self, gap=min(max(gap, NARROW), WIDEST))._grown(None)
            if dual is not None and dual.level < level:
                return dual
        return None

    def _centres(self, R: Array) -> Common | None:
        """Return the centres at the nodes of Q, None where one has none."""
        F, M, W, times = self.ends
        step, longest = self.problem.step, times[-1]
        # a short period makes up for less
        costs = M + step * (times / longest)[:, None, None] * R
        found = common(F, costs, W, self.gap)
        return found if np.all(found.found) else None

    @cached_property
    def ends(self) -> tuple[Array, Array, Array, Array]:
        """Loops and costs of the shortest and longest periods at the nodes, noise; lengths."""
        problem = self.problem
        nodes = problem.domain.nodes(self.degree)
        every, noise, times = list[tuple[Array, Array]](), list[Array](), list[float]()
        for number, ticks in enumerate(self.parts):
            # where a part ends the next begins
            for end, time in list(zip(np.eye(2), ticks.lengths, strict=True))[int(number > 0) :]:
                alpha = _beside(nodes, np.tile(end, (len(nodes), 1)))
                W, N, Y, E, *_ = problem.ticked(ticks, alpha)
                if problem.law.W is not None:
                    N, Y = right_divide(N, W), right_divide(Y, W)
                F = np.eye(N.shape[-1]) + problem.step * N
                every.append((F, problem.step * Y.swapaxes(-1, -2) @ Y))
                noise.append(E @ E.swapaxes(-1, -2))
                times.append(time)
        F, M = (np.stack(each, axis=1) for each in zip(*every, strict=True))
        return F, M, np.mean(noise, axis=0), np.array(times)

    def _solutions(
        self,
        R: Array,
        level: float | None,
        least: Array,  # noqa: ARG002
        share: float,  # noqa: ARG002
    ) -> Array | None:
        centres = self._centres(R) if level is None else None
        if centres is None:
            return None
        return self.problem.domain.interpolated(centres.Q, self.degree)

    def _share(self, level: float | None, least: Array) -> float:  # noqa: ARG002
        return SHARES[0]

    def _cheapest(self, Q: Array, units: Array) -> tuple[Array, Array]:
        entries, sizes = list[Array](), list[tuple[Array, Array]]()
        for ticks, (own, basis, (W, N, *_)) in zip(self.parts, self.looped, strict=True):
            known = self.problem.entries(ticks)
            entries += [] if known is None else [known]
            P = (W + self.problem.step * N).swapaxes(-1, -2) @ np.tensordot(basis, Q, 1)
            V = self.problem.form(own)
            a = np.square(units.T @ P).sum(axis=-2).max(axis=0)
            sizes.append((a, np.square(V @ units).sum(axis=-1).max(axis=0)))
        a, b = (np.max(each, axis=0) for each in zip(*sizes, strict=True))
        return cheapest(np.max(entries, axis=0), a, b)

    def _missed(
        self, coefficients: Array, level: float | None, cover: Cover | None = None
    ) -> tuple[Array, float]:
        if level is not None:
            raise np.linalg.LinAlgError("a gain has no periods of any length")
        step, every, longest = self.problem.step, list[Array](), self.parts[-1].theta
        degrees = self.degrees
        for ticks, (own, basis, (W, N, Y, *_)) in zip(self.parts, self.looped, strict=True):
            Q = np.tensordot(basis, coefficients, 1)
            P = (W + step * N).swapaxes(-1, -2) @ Q
            both = W @ Q @ N
            both = both + both.swapaxes(-1, -2) + step * N.swapaxes(-1, -2) @ Q @ N
            both = both + Y.swapaxes(-1, -2) @ Y
            if cover is not None:
                form = self.problem.form(own)
                V = cover.columns[: form.shape[1], None] * form
                both = both + (1 + step * cover.kappa) * V.swapaxes(-1, -2) @ V
            missed = self._coefficients(both, degrees)
            if cover is not None:
                PH = self._coefficients(P * cover.rows[: P.shape[-1]], degrees)
                missed = missed + PH @ PH.swapaxes(-1, -2)
            if self.problem.law.W is not None:
                middle = np.linalg.inv(W.mean(axis=0))
                missed = middle.T @ missed @ middle
            # a short period makes up for less
            every.append(missed * (longest / ticks.theta))
        bound = float(np.sqrt(max(self._ratios(coefficients).max(), 0.0)))
        return np.concatenate(every), bound

    def _ratios(self, Q: Array) -> Array:
        every = list[Array]()
        for _, basis, (_, _, _, E, _, more) in self.driven:
            squares = np.einsum("pik,pij,pjk->p", E, np.tensordot(basis, Q, 1), E) + more
            every.append(self._coefficients(squares, self.degrees_of_noise))
        return np.concatenate(every)


def _grid(plain: Array, theta: Array) -> Array:
    """Return weights of the corners of the box with the period, at every pair of nodes."""
    one = np.repeat(plain, len(theta), axis=0)
    other = np.tile(theta, (len(plain), 1))
    return _beside(one, other)


def made_up(missed: Array, V: Any, inside: Array, E: Array) -> Array:
    """Return shares of modes that make up for what is missed, at about the least cost.

    In modes it is M. A diagonal t with t_i = sum_j |M_ij| y_j / y_i exceeds M for any y > 0, and
    where a mode costs c_i, sum c_i t_i is least with y_i = c_i^(1/2).

    Parameters
    ----------
    missed : (count, n, n) array
    V : (n, n) array
        Modes w as columns.
    inside : (n,) array
        What of w w* a mode's share is.
    E : (n, q) array
        w w* costs |E'w|^2.
    """
    P = np.linalg.inv(V).conj().T / np.sqrt(inside)
    M = np.abs(P.conj().T @ missed @ P)
    cost = np.square(np.abs(V.conj().T @ E)).sum(axis=1)
    y = np.sqrt(cost + LEAST_COST * cost.sum())
    return np.asarray(((M @ y) / y).max(axis=0))


def _root(R: Array) -> Array:
    """Return a root of R without negative eigenvalues, root' root = R."""
    values, V = np.linalg.eigh(R)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * V.T)


def _above_zeros(F: Array, rows: int) -> Array:
    """Return F with rows of zeros below."""
    return np.concatenate([F, np.zeros((len(F), rows, F.shape[-1]))], axis=1)


def _inverse(level: Array | float, F: Array) -> tuple[Array, Array, Array]:
    """Return the blocks a, b, c of the inverse of [g I, -F'; -F, g I]."""
    Ft = F.swapaxes(-1, -2)
    a = np.linalg.inv(level * np.eye(F.shape[-1]) - Ft @ F / level)
    c = np.linalg.inv(level * np.eye(F.shape[-2]) - F @ Ft / level)
    return np.asarray(a), np.asarray(a @ Ft / level), np.asarray(c)


def cheapest(entries: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Return rows and columns that cover a remainder, of about the least cost.

    Of u and v, their squares, with sum R_ij^2 / (u_i v_j) <= 1 those are looked for that make
    (a'u) (b'v) least, one after the other.

    Parameters
    ----------
    entries : (n, n + m + q) array
        R.
    a, b : (n,), (n + m,) arrays
        What H H' and V'V cost; disturbances are taken to cost what they move.
    """
    squares, known = entries**2, len(b)
    if not entries.any():
        return np.zeros(len(entries)), np.zeros(entries.shape[1])
    driven = squares[:, known:].T @ a
    least = float(((squares[:, :known].T @ a) * b).max()) or TINY
    b = np.concatenate([b, np.where(driven > 0, least / np.where(driven > 0, driven, 1.0), 1.0)])
    v = 1 / np.maximum(b, TINY)
    for _ in range(40):
        u = _least(squares @ (1 / v), a)
        v = _least(squares.T @ (1 / np.where(u > 0, u, np.inf)), b)
        v = np.where(v > 0, v, np.inf)
    v = np.where(np.isfinite(v), v, 0.0)
    even = np.sqrt(float(b @ v) / max(float(a @ u), TINY))
    return COVERED * np.sqrt(u * even), COVERED * np.sqrt(v / even)


def _least(s: Array, a: Array) -> Array:
    """Return the u with sum s_i / u_i = 1 that makes a'u least."""
    root = np.sqrt(s * a)
    return np.asarray(np.sqrt(s / np.maximum(a, TINY)) * root.sum())


def majorant(matrices: Array) -> Array:
    """Return a Loewner upper bound of the matrices, of nearly the least trace."""
    left = (matrices + matrices.swapaxes(-1, -2)) / 2
    R, sizes = np.zeros(matrices.shape[-2:]), _above(left).sum(axis=-1)
    left = left[np.argsort(-sizes)[: np.count_nonzero(sizes)]]
    for matrix in left:
        if not _positive(R - matrix):
            values, V = np.linalg.eigh(matrix - R)
            R = R + (V * np.maximum(values, 0)) @ V.T
    return R


def _positive(M: Array) -> bool:
    """Whether a symmetric matrix is positive definite; a fifth of the time of its eigenvalues."""
    try:
        np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        return False
    return True


def _above(matrices: Array) -> Array:
    """Eigenvalues of symmetric matrices, or zero where one is negative."""
    return np.asarray(np.maximum(np.linalg.eigvalsh(matrices), 0))
