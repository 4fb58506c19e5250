"""What a bound in the dual form is about: closed loops of a family, at points of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.law.laws import Law, right_divide
from polefence.lmi.solve.loops import loop_degree
from polefence.plant.boxes import Box, widest
from polefence.plant.evaluated import beyond
from polefence.plant.family import UncertainPlant
from polefence.plant.parts import Point, inside, off_along
from polefence.plant.polynomial import Domain, Polynomial, degree_of, values
from polefence.plant.system import Array
from polefence.proof.between import Clock, Period, Step
from polefence.proof.claims.signal import OUTPUTS_SHARE
from polefence.proof.polynomials import Polynomial as ExactPolynomial
from polefence.proof.polynomials import monomials_of, multinomial
from polefence.proof.remainder import Remainder
from polefence.response.between import factor
from polefence.response.held import Storing
from polefence.response.stationary import growth

ENDS = Domain((2,))  # of the lengths of a period


@dataclass(frozen=True, eq=False)
class Dual:
    """Bernstein coefficients of Q (count, n, n), of a degree, and the level that it proves.

    ``cover`` is what a plant with a remainder asks for besides; ``storage`` what Q is between
    samples: ends of stretches, and coefficients (count, times, k, k) of each; ``inverse`` says of
    which form these are. ``reached``: Q is no dual one, but X of what is reached at samples.
    """

    Q: Array
    degree: int
    level: float
    cover: Cover | None = None
    storage: tuple[tuple[float, Array], ...] = ()
    inverse: bool = False
    reached: bool = False


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
        Times the length.
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
        """Return what moves, factors of theta M and V, L'L and L L', and c at points."""
        corners = alpha.reshape(len(alpha), -1, 2)
        plain = self.domain.basis(corners.sum(axis=2), self.degrees[0])
        basis = beside(plain, ENDS.basis(corners.sum(axis=1), self.degrees[1]))
        moved, M, V, c = (np.tensordot(basis, P, 1) for P in (self.moved, self.M, self.V, self.c))
        theta = corners.sum(axis=1) @ self.lengths
        noise = factor(V) / np.sqrt(theta)[:, None, None]
        return moved, np.swapaxes(factor(M), 1, 2), noise, c[:, 0, 0] / theta


def _ticks(step: Step, domain: Domain) -> Ticks:
    mean = step.whole
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


# Multiplications of all Newton steps of a round at one node, as a share of n^6: a round of 8 nodes
# of a van with 7 states took 0.4 s.
NEWTON = 10.0


@dataclass(frozen=True, eq=False)
class Starts:
    """Initial states at a sample: ``points`` (n, count); X0 of an ``ellipsoid``, (n, n)."""

    points: Array
    ellipsoid: Array | None = None


@dataclass(frozen=True, eq=False)
class DualProblem:
    """Closed loops of a family, with outputs and disturbances: what a bound is about.

    Attributes
    ----------
    plant : UncertainPlant
    law : Law
    C, D, E, F : arrays (N, ., .)
        At the vertices, disturbances scaled. What passes through the law comes to E and F.
    acting : (q,) array
        How many times each disturbance acts.
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
    storing : Storing, optional
        Of a gain, or a peak, that is bounded between samples too; the same holds.
    starts : Starts, optional
        Of a peak between samples, where it is one from initial states without disturbances.
    near : tuple of Remainder, optional
        Of the outputs, where functions of the parameters are among their entries.
    at_points : bool
        Whether loops are asked for at points alone: outputs are then these functions themselves.
    errors : bool
        Whether on a part of the box polynomials stand for functions with what they are off by.
    decay : float
        Rate by which all states are to fall over periods of any length besides [1/s].
    """

    plant: UncertainPlant
    law: Law
    C: Array
    D: Array
    E: Array
    F: Array
    acting: Array
    gain: bool = False
    share: Polynomial | None = None
    box: Box | None = None
    between: bool = False
    means: OverPeriod | None = None
    storing: Storing | None = None
    starts: Starts | None = None
    decay: float = 0.0
    near: tuple[Remainder | None, ...] = ()
    at_points: bool = False
    errors: bool = True

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
        return self.acting

    @property
    def clocked(self) -> bool:
        """Whether it is about periods of any length."""
        return self.means is not None and self.means.clock is not None

    @property
    def jittered(self) -> bool:
        """Whether a period may be of any length between two."""
        clock = None if self.means is None else self.means.clock
        return clock is not None and clock.jitters

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
    def driving_degree(self) -> int:
        """Degree of E of the loop."""
        own = self.plant.curve_degree if np.ptp(self.E, axis=0).any() else 0
        passed = self.law.passing_degree + self.plant.curve_degree if self.law.passes else 0
        return max(own, passed)

    def passing(self, alpha: Array) -> Array | None:
        """Return what passes from disturbances to inputs at points of the part; None: nothing."""
        if self.box is not None:
            alpha = self.box.alpha(self.domain, alpha)
        return self.law.passing(alpha)

    @property
    def passes(self) -> bool:
        """Whether disturbances pass straight into the outputs of the loop."""
        return bool(np.any(self.F)) or (self.law.passes and bool(np.any(self.D)))

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
        low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
        return self.within(box, low, high)

    def within(self, box: Box, low: Point, high: Point) -> DualProblem:
        """Return the same on a part whose ends are known exactly, and to doubles as a box."""
        means = self.means and self.means.inside(box, self.domain)
        storing = self.storing and self.storing.inside(box, self.domain)
        if not self.plant.bent:
            return replace(self, box=box, means=means, storing=storing)
        plant = inside(self.plant, low, high)
        alpha = box.alpha(self.domain, self.domain.nodes(1))
        C, D, F = (np.tensordot(alpha, M, 1) for M in (self.C, self.D, self.F))
        for k, known in enumerate(self.near):
            if known is not None:
                rows = known.added(low, high, (*self.plant.shape, F.shape[-1]))
                scales = (1.0, 1.0, self.scales)
                for M, more, scale in zip((C, D, F), rows, scales, strict=True):
                    M[:, k] += np.array(more, dtype=float).reshape(len(M), -1) * scale
        near = tuple(known and known.inside(low, high) for known in self.near)
        E = np.stack([v.E for v in plant.vertices if v.E is not None]) * self.scales
        law = self.law.inside(plant, low, high)
        if not self.errors:
            plant = replace(plant, remainder=plant.remainder and _exact(plant.remainder))
            near = tuple(known and _exact(known) for known in near)
        problem = replace(self, plant=plant, law=law, C=C, D=D, E=E, F=F, near=near)
        return replace(problem, between=True, means=means, storing=storing)

    def work(self, degree: int) -> float:
        """Return about how many multiplications a round takes for Q of a degree."""
        n, count = self.plant.shape[0], self.domain.count(self.degree + degree)
        steps = 0.0 if self.starts is None else NEWTON * self.domain.count(degree) * n**6
        return float(count) ** 2 * n**2 + count * (2 * n) ** 3 * 10 + steps

    @property
    def widest(self) -> int:
        """Number of the parameter along which the closed loop changes most, in its part.

        None of one that stands for a dead time: X is the same for all its values.
        """
        late = self.plant.dead_time
        return widest(
            self.domain,
            lambda alpha: self.closed(alpha)[0],
            lambda poles: -growth(poles, self.step),
            None if self.box is None else self._off_along(self.box),
            () if late is None else late[:1],
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
        bends = np.array(period.bends, dtype=float) / float(period.step)
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
        C, D, F = self._outputs(alpha)
        curved = self.plant.curve_degree > 1
        E = self.plant.driven(alpha) * self.scales if curved else np.tensordot(alpha, self.E, 1)
        passing = self.law.passing(alpha)
        if passing is not None:
            E, F = E + B @ passing * self.acting, F + D @ passing * self.acting
        W, Z = self.law.parts(alpha)
        if self.means is None or self.means.M is None:
            return W, A @ W + B @ Z, C @ W + D @ Z, E, F
        energy, noise, _ = self.means.at(self.domain, here)
        Y = energy @ np.concatenate([W, Z], axis=1)[:, self.means.chosen]
        E = np.zeros((len(W), W.shape[1], noise.shape[-1]))
        E[:, : noise.shape[1]] = noise
        return W, A @ W + B @ Z, Y, E, np.zeros((len(W), Y.shape[1], E.shape[2]))

    def _outputs(self, alpha: Array) -> tuple[Array, Array, Array]:
        """Return C, D and F at points, with what functions of the parameters add to them.

        What these are off by are outputs behind the others: see `SignalClaim.widened`.
        """
        C, D, F = (np.tensordot(alpha, M, 1) for M in (self.C, self.D, self.F))
        off = [known.entries[0] for known in self.near if known is not None]
        if not off:
            return C, D, F
        n, m = self.plant.shape
        for k, known in enumerate(self.near):
            if known is None:
                continue
            if self.at_points and known.source is not None:
                weights, matrices = beyond(known.source.functions, alpha), known.source.directions
            else:
                weights, matrices = self.domain.basis(alpha, known.degree), known.curve
            if matrices:
                row = np.tensordot(weights, np.array(matrices, dtype=float), 1)[:, 0]
                C[:, k] += row[:, :n]
                D[:, k] += row[:, n : n + m]
                F[:, k] += row[:, n + m :] * self.scales
        if self.at_points or not any(map(any, off)):
            return C, D, F
        squares = np.square(np.array(off, dtype=float)).sum(axis=0)
        share = self._share
        sizes = np.sqrt((1 + 1 / share) * np.count_nonzero(squares) * squares)
        behind = np.broadcast_to(
            np.diag(sizes)[sizes > 0], (len(alpha), (sizes > 0).sum(), len(sizes))
        )
        scaled = np.concatenate([np.ones(n + m), self.scales])
        more = np.split(behind * scaled, [n, n + m], axis=-1)
        grown = (np.sqrt(1 + share) * M for M in (C, D, F))
        C, D, F = (np.concatenate(pair, axis=1) for pair in zip(grown, more, strict=True))
        return C, D, F

    @property
    def _share(self) -> float:
        """As `outputs_share` of the claim has it."""
        rows = np.abs(np.concatenate([self.C, self.D], axis=2)).max(axis=0)
        ratios = [float(OUTPUTS_SHARE)]
        for row, known in zip(rows, self.near, strict=False):
            if known is not None:
                off = np.array(known.entries[0], dtype=float)[: len(row)]
                ratios += (off[row > 0] / row[row > 0]).tolist()
        return float(min(2.0 ** np.ceil(np.log2(max(ratios))), 1.0))

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


def _exact(remainder: Remainder) -> Remainder:
    """Return it as if nothing were off."""
    none = tuple(tuple(Fraction(0) for _ in row) for row in remainder.entries)
    return replace(remainder, entries=none)


def beside(alpha: Array, ends: Array) -> Array:
    """Return weights of the corners of a box with one more parameter."""
    return np.asarray((alpha[:, :, None] * ends[:, None, :]).reshape(len(alpha), -1))


def _longest(alpha: Array) -> Array:
    """Return weights of points with the longest period."""
    return beside(alpha, np.tile((0.0, 1.0), (len(alpha), 1)))
