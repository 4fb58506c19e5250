"""Margins one by one: of the estimates, of the gain, of the rates; how far each goes in floats.

`gain_claim` is the gain's in given directions: rounding a law and sampling its reference in tables
put an error on the gain that is known to be small; its rows and columns are known too. So an error
far below the largest is enough, and is proved where the proof has most room.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, permutations, product
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.certify.candidates import edge, rising
from polefence.certify.design import Design
from polefence.certify.margins.claims import (
    BOX,
    GAIN,
    SIMPLEX,
    Balanced,
    Ladder,
    Points,
    Reached,
    above,
    alpha_of,
    are_positive,
    balanced,
    below,
    claimed_design,
    climb,
    count_monomials,
    count_whole,
    factors,
    holds,
    kron,
    largest_step,
    lattice,
    region_block,
    subject_of,
    whole_points,
)
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.rate import Rate
from polefence.proof.remainder import SHARE
from polefence.region.regions import Pair

LEAST_ERROR, PRECISION = (
    1e-6,
    1e-3,
)  # of the search: the smallest share of a range, its relative error
HALVINGS = 20  # at most, of what a quarter more breaks

GIVEN = ((1, 0), (1, 1), (1, 2))  # pieces and elevation that are tried of a law that was given
COVERS = (1.0, 1.1, 1.5, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4)  # times Omega
ROUNDS = 30  # of the golden section for each mu
WIDTH = 9.0  # decades of mu that it looks at

FINEST = 4  # finenesses that are tried
LEAST = 2.0**-80  # of the largest error: what is smaller is proved as this
ROOM = 10  # times what is needed: so much makes a coarser proof, which is shorter, as good

FASTEST = 1e9  # rate that is asked for, in ranges per second


def estimate_holds(design: Balanced, points: Points) -> bool:
    """Whether all coefficients are positive definite in floats."""
    X, N, _ = design.loop(points)
    if not design.disks and not are_positive(X):
        return False
    one = points.one[..., None, None]
    return all(
        are_positive(region_block(pair, X, N) - one * design.lost(pair[1])) for pair in design.pairs
    )


def count_blocks(design: Balanced, errors: Sequence[float], pieces: int, elevation: int) -> float:
    """Return how many inequalities there are at most."""
    size = design.degree, design.plant_degree
    return count_pairs(design.sizes, size, design.q, errors, pieces, elevation) * len(design.pairs)


def count_pairs(
    sizes: tuple[int, ...],
    degrees: tuple[int, int],
    q: int,
    errors: Sequence[float],
    pieces: int,
    elevation: int,
) -> float:
    """Return how many there are for each L, M, of X and of [A, B] of these degrees."""
    own, d = degrees
    degree = own + d + elevation
    if not q:
        if d == 1:
            return sizes[0] * count_monomials(sizes * 2, (degree, own))
        return count_monomials(sizes * 3, (degree, own, d))
    moved = sum(map(bool, errors)) if d > 1 else 0
    each = count_monomials((2,) * (q + moved), (degree,) * q + (d,) * moved)
    most = pieces + 2 if moved else 2 * (pieces + 1)
    return each * math.prod(most if error else pieces for error in errors)


def points_of(
    design: Balanced,
    parameters: Sequence[Parameter],
    errors: Sequence[float],
    pieces: int,
    elevation: int,
) -> Points:
    """Return points of the pieces on which p is affine in its estimate, for all signs."""
    d = design.plant_degree
    degree = design.degree + d + elevation
    if not parameters:
        return _mislaid(design, errors[0], degree)
    moved = [f for f, error in enumerate(errors) if error and d > 1]
    sizes, degrees = (2,) * (design.q + len(moved)), (degree,) * design.q + (d,) * len(moved)
    nodes, coefficients = lattice(sizes, degrees)
    segments = [_segments(*each, pieces, d > 1) for each in zip(parameters, errors, strict=True)]
    cells = np.array(list(product(*segments)))[:, None]  # (cells, 1, parameters, side, low or high)
    along = nodes[:, 1::2]
    values = cells[..., 0] + along[:, : design.q, None] * (cells[..., 1] - cells[..., 0])
    own, estimated, across = values[..., 0], values[..., 2], np.zeros((len(nodes), design.q))
    across[:, moved] = along[:, design.q :]
    own = own + across * (values[..., 1] - own)
    shares, factor = [np.empty_like(own), np.empty_like(own)], np.ones(own.shape[:2])
    for f, parameter in enumerate(parameters):
        ends = [float(parameter.scheduling(end)) for end in (parameter.low, parameter.high)]
        for share, p in zip(shares, (own[..., f], estimated[..., f]), strict=True):
            share[..., f] = ((1 / p if parameter.inverted else p) - ends[0]) / (ends[1] - ends[0])
        if parameter.inverted:
            p, q = own[..., f], estimated[..., f]
            factor = factor * np.abs(p) ** d * np.abs(q) ** design.degree
    plant, law = map(alpha_of, shares)
    return Points(plant, law, factor, coefficients)


def _segments(parameter: Parameter, error: float, pieces: int, both: bool) -> list[Array]:
    """Return the ends of the least p, the largest, and the estimate, for each piece.

    For one sign of the error after the other the two are the same, unless ``both`` count at once.
    """
    low, high = float(parameter.low), float(parameter.high)
    found = []
    for signs in ((-1, 1),) if both else ((-1, -1), (1, 1)) if error else ((0, 0),):
        bends = {low + error if sign < 0 else high - error for sign in signs}
        cuts = {*np.linspace(low, high, pieces + 1), *(b for b in bends if low < b < high)}
        for ends in pairwise(sorted(cuts)):
            own = [np.clip(np.array(ends) + sign * error, low, high) for sign in signs]
            found.append(np.array([*own, ends]))
    return found


def _mislaid(design: Balanced, share: float, degree: int) -> Points:
    N, d = len(design.A), design.plant_degree
    degrees = (degree, design.degree) if d == 1 else (degree, design.degree, d)
    nodes, coefficients = lattice((N,) * len(degrees), degrees)
    kept = (1 - share) * nodes[:, :N]
    towards = np.eye(N)[:, None, :] if d == 1 else nodes[None, :, 2 * N :]
    plant = kept[None] + share * towards
    law = np.broadcast_to(kept + share * nodes[:, N : 2 * N], plant.shape)
    return Points(plant, law, np.ones(plant.shape[:2]), coefficients)


@dataclass(frozen=True, eq=False)
class EstimateQuestion:
    """Error of the estimates of parameters, together, as a share of a span of each."""

    loops: tuple[Balanced, ...]
    parameters: tuple[Parameter, ...]
    span: tuple[Fraction, ...]

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried."""
        return BOX if self.parameters else SIMPLEX

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        errors = self._errors(1.0)
        return sum(count_blocks(own, errors, pieces, elevation) for own in self.loops)

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest share in [0, 1] that is proved in floats; -1 where not even 0 is."""
        share = min(self._largest(own, pieces, elevation) for own in self.loops)
        return Reached(share, pieces, elevation)

    def claim(self, subject: Subject, reached: Reached) -> Estimate:
        """Return the claim of a share, or a little less."""
        t = reached.value
        errors = (s if t == 1 else min(below(t * float(s)), s) for s in self.span)
        return Estimate(subject, tuple(errors))

    def _errors(self, share: float) -> list[float]:
        return [share * float(s) for s in self.span]

    def _largest(self, loop: Balanced, pieces: int, elevation: int) -> float:
        def proved(t: float) -> bool:
            points = points_of(loop, self.parameters, self._errors(t), pieces, elevation)
            return estimate_holds(loop, points)

        if proved(1.0):
            return 1.0
        high = 1.0
        while high > LEAST_ERROR:
            if proved(high / 4):
                return edge(proved, high / 4, high, HALVINGS, close=PRECISION)[0]
            high /= 4
        return 0.0 if proved(0.0) else -1.0


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales of an error of the gain: K is off by error * diag(rows) D diag(columns).

    Or by error * diag(rows) D columns, where columns is a matrix.
    """

    rows: Array
    columns: Array

    def across(self, T: Array) -> Array:
        """Return diag(columns) T, or columns T, transposed."""
        if self.columns.ndim == 1:
            return np.asarray(T.T * self.columns)
        return np.asarray((self.columns @ T).T)


@dataclass(frozen=True, eq=False)
class GainQuestion:
    """Error of the gain in the directions that scales give."""

    loops: tuple[Balanced, ...]
    scales: Scales
    ladder: Ladder

    @classmethod
    def of(
        cls, loops: tuple[Balanced, ...], scales: Scales, most: int | None = None
    ) -> GainQuestion:
        """Return the question for a design's loops, of at most so many finenesses."""
        given = loops[0].elevation is not None
        ladder = GIVEN if given else BOX if loops[0].q else SIMPLEX
        return cls(loops, scales, ladder[:most])

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        return sum(
            count_whole(own, pieces, elevation)
            if own.elevation is None
            else 2.0 * own.domain.count(own.degree + own.plant_degree + own.elevation + elevation)
            for own in self.loops
        )

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest error that is proved in floats, -1 where none is."""
        loops = [
            own.loop(whole_points(own, pieces, elevation))
            if own.elevation is None
            else own.raised(own.elevation + elevation)
            for own in self.loops
        ]
        if all(own.spread is None for own in self.loops):
            return self._reach(loops, pieces, elevation)
        each = (self._reach(loops, pieces, elevation, cover) for cover in COVERS)
        return max(rising(each, lambda own: own.value, GAIN), key=lambda own: own.value)

    def _reach(
        self,
        loops: Sequence[tuple[Array, Array, Array]],
        pieces: int,
        elevation: int,
        cover: float = 1.0,
    ) -> Reached:
        """Return it for so many times Omega."""
        found, most = list[tuple[float, float]](), math.inf
        for own, loop in zip(self.loops, loops, strict=True):
            lost = [own.lost(M, cover) for _, M in own.pairs]
            each = largest_of(own.pairs, not own.disks, loop, own.T, self.scales, lost)
            if not each:
                return Reached(-1.0, pieces, elevation)
            found += each
            if own.spread is not None:
                raised = (own.elevation or 0) + elevation
                most = min(most, _covered(own, raised, self.scales, cover))
        least = min(error for error, _ in found)
        return Reached(min(least, most), pieces, elevation, tuple(found), cover)

    def claim(self, subject: Subject, reached: Reached) -> GainError:
        """Return the claim of an error, or a little less."""
        mu = tuple(below(own) for _, own in reached.each)
        return self.with_mu(subject, below(reached.value), mu)

    def with_mu(self, subject: Subject, error: Fraction, mu: tuple[Fraction, ...]) -> GainError:
        """Return the claim of an error and multipliers."""
        rows, columns = self.scales.rows.tolist(), self.scales.columns.tolist()
        right = (tuple(map(Fraction, c)) if isinstance(c, list) else Fraction(c) for c in columns)
        return GainError(subject, error, tuple(map(Fraction, rows)), tuple(right), mu)


def largest_of(
    pairs: Sequence[Pair],
    bounded: bool,
    loop: tuple[Array, Array, Array],
    T: Array,
    scales: Scales,
    lost: Sequence[Array] = (),
) -> list[tuple[float, float]]:
    """Return for each L, M the largest error proved in floats, and its mu; empty where none is.

    ``loop`` has the coefficients of X, N and B in coordinates y, x = T y; ``bounded`` says that
    X > 0 is asked for besides; ``lost`` is what a remainder takes of each inequality.
    """
    X, N, B = loop
    if bounded and not are_positive(X):
        return []
    left, right = B * scales.rows, X @ scales.across(T)
    found = []
    for number, (L, M) in enumerate(pairs):
        F = region_block((L, M), X, N) - (lost[number] if lost else 0.0)
        if not are_positive(F):
            return []
        found.append(largest_bordered(F, M, left, right))
    return found


def largest_bordered(F: Array, M: Array, left: Array, right: Array) -> tuple[float, float]:
    """Return the largest error for one L, M, and its mu.

    For a given mu it is a generalised eigenvalue of
    [ F, mu M1 (x) B S, 0 ; *, mu I, 0 ; 0, 0, mu I ] and [ 0, 0, M2' (x) W T ; 0, 0, 0 ; *, 0, 0 ],
    and concave in mu.
    """
    M1, M2 = factors(M)
    E, H = kron(M1, left), kron(M2.T, right)
    d, inner = F.shape[-1], F.shape[-1] + E.shape[-1]
    whole = inner + H.shape[-1]
    base, slope = (np.zeros((*F.shape[:-2], whole, whole)) for _ in range(2))
    base[..., :d, :d] = F
    slope[..., :d, inner:], slope[..., inner:, :d] = H, H.swapaxes(-1, -2)
    diagonal = range(d, whole)

    def error(log_mu: float) -> float:
        root = math.exp(log_mu / 2)  # the border's rows over root(mu): the same signs
        base[..., :d, d:inner], base[..., d:inner, :d] = root * E, root * E.swapaxes(-1, -2)
        base[..., diagonal, diagonal] = 1.0
        return largest_step(base, slope / root)

    size = float(np.linalg.norm(E, axis=(-2, -1)).max()) ** 2
    top = math.log(float(np.linalg.eigvalsh(F).max()) / size) if size else 0.0
    best = _golden(error, top - WIDTH * math.log(10), top + math.log(10))
    return error(best), math.exp(best)


def _covered(own: Balanced, elevation: int, scales: Scales, cover: float) -> float:
    """Return the largest error up to which Omega, so many times, is more than V'V."""
    spread = own.spread
    if spread is None:
        return math.inf
    X, V = own.covered(elevation)
    n, w = X.shape[-1], V.shape[-2]
    D = np.concatenate([np.zeros(n), np.diag(spread.inputs) * scales.rows])
    nu = float(SHARE) / max(float(D.max()) ** 2, np.finfo(float).tiny)
    base, slope = (np.zeros((len(X), n + w + n, n + w + n)) for _ in range(2))
    base[:, :n, :n], base[:, n : n + w, n : n + w] = cover * spread.omega, np.eye(w)
    base[:, n : n + w, :n], base[:, :n, n : n + w] = V, V.swapaxes(1, 2)
    base[:, n : n + w, n : n + w] -= np.diag(nu * D**2)
    base[:, n + w :, n + w :] = nu * np.eye(n)
    right = X @ scales.across(own.T)
    slope[:, :n, n + w :], slope[:, n + w :, :n] = right, right.swapaxes(1, 2)
    return largest_step(base, slope)


def _golden(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function that rises, then falls, is largest."""
    ratio = (math.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = function(a), function(b)
    for _ in range(ROUNDS):
        if at_a >= at_b:  # where neither holds, mu is too large
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = function(b)
    return (low + high) / 2


@explained
def gain_claim(
    design: Design, rows: Array, columns: Array, needed: float
) -> tuple[float, GainError | None]:
    """Return how far the gain may be off for these rows and columns, and a proof of so much.

    All poles of A + B (K + error S D T) lie in the design's region for all D of norm at most one,
    S and T the diagonal matrices of ``rows`` and ``columns`` (Petersen 1987). Every method has it.

    Parameters
    ----------
    rows : (m,) array
        Positive.
    columns : (n,) or (n, n) array
        Positive; or T itself, any matrix.
    needed : float
        The error that must be proved, zero or more.

    Returns
    -------
    largest : float
        The largest error found in floats; zero where none is.
    claim : Gain or None
        What is proved: ``error`` is at least ``needed``, and larger where there is room. Its
        design is `claimed_design`. None where nothing was proved.

    Raises
    ------
    InputError
        If rows and columns are not positive numbers, one an input and one a state, nor columns a
        matrix; or ``needed`` is no number of zero or more.
    """
    n, m = design.plant.shape
    scales = Scales(_positive(rows, m, "rows"), _columns(columns, n))
    if not 0 <= needed < math.inf:
        raise InputError(f"needed = {needed!r} must be a number of zero or more")
    own = claimed_design(design)
    if own is None:
        return 0.0, None
    question = GainQuestion.of(balanced(own, own.region), scales, FINEST)
    found = [reached for reached in climb(question) if reached.value > 0]
    largest = found[-1].value if found else 0.0
    for reached in found:
        if reached is not found[-1] and reached.value < ROOM * max(needed, LEAST * largest):
            continue
        subject = subject_of(own, own.region, reached)
        for error in _targets(needed, reached.value):
            claim = _claim(question, subject, reached, error)
            if holds(claim):
                return largest, claim
    return largest, None


def _positive(values: Any, count: int, what: str) -> Array:
    array = np.asarray(values, dtype=float)
    if array.shape != (count,) or not np.all(np.isfinite(array) & (array > 0)):
        raise InputError(f"{what} = {values!r} must be {count} positive numbers")
    return array


def _columns(values: Any, n: int) -> Array:
    array = np.asarray(values, dtype=float)
    if array.ndim < 2:
        return _positive(values, n, "columns")
    if array.shape != (n, n) or not np.all(np.isfinite(array)) or not array.any():
        raise InputError(f"columns: a matrix must be {n} x {n}, of finite numbers, not all zero")
    return array


def _targets(needed: float, largest: float) -> Iterator[Fraction]:
    """Yield errors to prove, from ``needed`` up; first where there is room on both sides."""
    least = max(needed, largest * LEAST)
    if least < largest:
        yield above(math.sqrt(least * largest))
    # the search in floats stops a little short
    if least <= largest * (1 + GAIN):
        yield above(least)


def _claim(
    question: GainQuestion, subject: Subject, reached: Reached, error: Fraction
) -> GainError:
    """Return the claim, with mu that leaves the most room.

    F - mu E E' - error^2 H H' / mu is positive definite at the largest error for its mu. With both
    times a share s < 1, F - s (...) is left: mu belongs to the error in proportion.
    """
    mu = tuple(above(own * float(error) / largest) for largest, own in reached.each)
    return question.with_mu(subject, error, mu)


@dataclass(frozen=True, eq=False)
class RateQuestion:
    """Rate of the parameters, together, as a share of a span of each a second.

    ``part`` is the part of the region whose Lyapunov polynomial the loop has.
    """

    loop: Balanced
    part: int
    parameters: tuple[Parameter, ...]
    span: tuple[Fraction, ...]
    decay: float

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried."""
        return BOX if self.parameters else SIMPLEX

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        N = len(self.loop.A)
        signs = 2 ** sum(s > 0 for s in self.span) if self.parameters else N * (N - 1)
        return count_whole(self.loop, pieces, elevation) * signs

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest rate proved in floats: -1 where not even 0 is, infinite if any is."""
        loop, points = self.loop, whole_points(self.loop, pieces, elevation)
        X, N, _ = loop.loop(points)
        still = -(N + N.swapaxes(-1, -2) + 2 * self.decay * X)
        if not (are_positive(X) and are_positive(still)):
            return Reached(-1.0, pieces, elevation)
        slopes = _slopes(loop, points, self.parameters, [float(s) for s in self.span])
        found = min((largest_step(still, slope) for slope in slopes), default=np.inf)
        # where all W are equal but for rounding, no rate is too large in floats
        return Reached(found if loop.constant else min(found, FASTEST), pieces, elevation)

    def claim(self, subject: Subject, reached: Reached) -> Rate:
        """Return the claim of a rate, or a little less."""
        t, decay = reached.value, Fraction(self.decay)
        rates = None if math.isinf(t) else tuple(below(t * float(s)) for s in self.span)
        return Rate(subject, decay, rates, self.part)


def _slopes(
    design: Balanced, points: Points, parameters: Sequence[Parameter], unit: Sequence[float]
) -> list[Array]:
    """Return the coefficients of dW/dt at every extreme of the rates ``unit``."""
    if design.constant:
        return []
    if parameters:
        share = Domain(design.sizes).coordinates(points.law)[..., 1::2]
        each = [
            _moved(design, share, f, parameter, rate)
            for f, (parameter, rate) in enumerate(zip(parameters, unit, strict=True))
        ]
        signs = [np.array(s) for s in product(*((-1, 1) if rate else (0,) for rate in unit))]
    else:
        corners = np.eye(len(design.A))
        each = [_derivative(design, points.law, unit[0] * corner) for corner in corners]
        signs = [to - off for to, off in permutations(corners, 2)]
    values = np.stack(each)
    return [
        np.einsum("ij,cjab->ciab", points.coefficients, np.tensordot(sign, values, 1))
        for sign in signs
    ]


def _moved(design: Balanced, share: Array, f: int, parameter: Parameter, rate: float) -> Array:
    """Return dW/dt where one parameter rises at a rate, at shares of its scheduling variable."""
    low, high = (float(parameter.scheduling(end)) for end in (parameter.low, parameter.high))
    s = low + share[..., f] * (high - low)
    speed = rate / (high - low) * (s**2 if parameter.inverted else np.ones_like(s))
    low_end, high_end = share.copy(), share.copy()
    low_end[..., f], high_end[..., f] = 0, 1
    direction = alpha_of(high_end) - alpha_of(low_end)
    return np.asarray(speed[..., None, None] * _derivative(design, alpha_of(share), direction))


def _derivative(design: Balanced, alpha: Array, direction: Array) -> Array:
    """Return dW in a direction of alpha, from as many values as determine W's polynomial."""
    half = (design.degree + 1) // 2
    steps = np.arange(-half, half + 1)
    powers = np.vander(steps, increasing=True).T.astype(float)
    weights = np.linalg.solve(powers, np.eye(len(steps))[1])
    total = np.zeros((*alpha.shape[:-1], *design.T.shape))
    for k, weight in zip(steps, weights, strict=True):
        total = total + weight * design.law(alpha + k * direction)[0]
    return total
