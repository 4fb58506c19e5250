"""Limits that no law keeps at once: found in floats, proved exactly; of others, a smallest set.

At one vertex the least weighted sum of mean squares over all laws is that of the linear-quadratic
regulator, sum a_i E[y_i^2] >= S tr E'P E with P from a Riccati equation. It is concave in the
weights a; its largest value over that of the limits themselves is the square of the factor by which
every law exceeds one of the limits (Boyd & Barratt 1991, on weights of several mean squares).
The regulator is that of a plant of fewer states, see `polefence.certify.regular`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import InputError, SolverError, require_type
from polefence.base.explained import explained
from polefence.base.renamed import write_in
from polefence.certify.least_gain import Question
from polefence.certify.regular import Regular, dot, lifted, regular
from polefence.lmi.conditions.pencil import Index
from polefence.plant.dampers import Damper
from polefence.plant.exact import file_plant
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.gain_conflict import GainLimit, GainRefutation
from polefence.proof.claims.refutation import RmsLimit, RmsRefutation
from polefence.proof.dampers import SemiActive
from polefence.proof.document import Document
from polefence.proof.matrices import Rationals, identity
from polefence.proof.short import Short
from polefence.proof.text import number_text
from polefence.proof.work import FormatError
from polefence.region.text import digits_down
from polefence.requirements.gain import ALL_TIMES, Gain
from polefence.requirements.rms import Rms
from polefence.requirements.specification import Specification, disturbance, limit_text
from polefence.requirements.weights import with_weights

# Decay taken off the plant, of its own rates, so that P proves the inequality with a margin; and
# as a share of that what is taken off the cost, for directions that no output sees.
MARGINS = tuple((10.0 ** (k / 2), share) for share in (0.0, 1.0) for k in range(-18, -5))

_ZERO = Fraction(0)
DECAY = 1e-6  # the same, of the plant's rates, while weights are sought
CLOSE = 1e-6  # of a dual function's value, how near its highest is known
MOST_STATES = 30  # of a plant: with 50 a limit takes a minute
FEW = 4  # vertices at which the best weights are sought
LITTLE = 1e-4  # of a level, which is no matter; and of weights
LEAST_GAIN = 1e-6  # of what some law has, beside which there is no limit
LEAST_WEIGHT = 1e-5  # of a limit that counts, beside one of what is minimised

FILE_NAME = "limit.json"


@dataclass(frozen=True, eq=False)
class Refutation(Short):
    """At a vertex of the family no law keeps the limits at once; proved in exact arithmetic.

    Attributes
    ----------
    plant : UncertainPlant
    specifications : tuple of Rms or of Gain
        The limits.
    claim : RmsRefutation or GainRefutation
        With its evidence, for `polefence.proof.claims.base.prove`.
    reason : str
        What was proved.
    """

    plant: UncertainPlant
    specifications: tuple[Rms, ...] | tuple[Gain, ...]
    claim: RmsRefutation | GainRefutation
    reason: str

    @property
    def vertex(self) -> int:
        """Of the plant, counted from zero."""
        return self.claim.vertex

    @property
    def factor(self) -> float:
        """No law keeps so many times each limit either."""
        return float(self.claim.factor)

    @property
    def where(self) -> str:
        """The vertex in words, with the parameters' values."""
        last = len(self.plant.parameters) - 1
        values = [
            f"{p.name} = {number_text(p.high if self.vertex >> (last - k) & 1 else p.low)} {p.unit}"
            for k, p in enumerate(self.plant.parameters)
        ]
        named = ", ".join(value.strip() for value in values)
        return f"vertex {self.vertex + 1}" + (f" ({named})" if named else "")

    def file(self) -> Document:
        """Return it as a file of claims, of the plant with the filters of weighted limits."""
        plant = with_weights(self.plant, self.specifications)[0]
        return Document(file_plant(plant), None, (self.claim,), polefence=VERSION)

    def save(self, directory: str | Path) -> Path:
        """Write ``limit.json`` into a folder, made if need be; return its path.

        Raises
        ------
        OutputError
            If the folder cannot be written.
        """
        return write_in(directory, FILE_NAME, self.file().dumps())

    def __str__(self) -> str:
        named = "; ".join(map(limit_text, self.specifications))
        these, them = ("this", "it") if len(self.specifications) == 1 else ("these at once", "each")
        return (
            f"refuted: at {self.where} no {self.claim.of_laws} keeps {these}, nor "
            f"{digits_down(self.factor)} times {them}: {named}"
        )


@explained
def refute_limits(
    plant: UncertainPlant, specifications: Sequence[Specification], dampers: Sequence[Damper] = ()
) -> Refutation | None:
    """Return the proof that no law keeps limits at once, None if none was found.

    Limits on rms values, or limits on gains; one of each kind that are in conflict are not refuted.
    Looks at each vertex of the family by itself, where a scheduled law is one gain: limits that are
    in conflict for another reason are not refuted here.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E.
    specifications : sequence of Specification
        Limits; what is no `Rms` or `Gain` with its ``at_most`` is left out, and so is
        `RelativeRms`. Those of a kind with the same disturbances are looked at together.
    dampers : sequence of Damper
        Inputs that are forces of controllable dampers: no law means no logic that chooses their
        coefficients, and any forces at the other inputs.

    Returns
    -------
    Refutation or None
        It holds for every stabilising law, also one with states of its own, one that is not linear
        and one that is told the parameters, as long as it does not know the noise to come.

    Raises
    ------
    InputError
        If a specification does not fit the plant, or the plant is in discrete time.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    if plant.period:
        raise InputError(f"{plant.name} is in discrete time; limits are refuted in continuous time")
    for limit in specifications:
        require_type(limit, Specification, "specifications", "for example Rms('force', 700)")
    asked = [
        s for s in specifications if isinstance(s, Rms) and s.limits_rms and s.at_most is not None
    ]
    for chosen in dict.fromkeys(s.scales(plant) for s in asked):
        together = tuple(s for s in asked if s.scales(plant) == chosen)
        refutation = _refuted_together(plant, together, tuple(dampers))
        if refutation is not None:
            return refutation
    return None if dampers else _gains_refuted(plant, specifications)


def lowest(
    plant: UncertainPlant, specification: Rms, near: float, dampers: Sequence[Damper] = ()
) -> tuple[Refutation, float] | None:
    """Return the proof that no law goes below a level, and the level; None if none was found.

    Parameters
    ----------
    near : float
        What a law keeps.
    dampers : sequence of Damper
        As `refute_limits` takes them.

    Raises
    ------
    InputError
        As `refute_limits` does.
    """
    tiny = 1e-3 * near  # every law exceeds it
    refutation = refute_limits(plant, [replace(specification, at_most=tiny)], dampers)
    return None if refutation is None else (refutation, tiny * refutation.factor)


def least_of_any(
    plant: UncertainPlant, minimise: Specification, limits: Sequence[Specification], near: float
) -> Refutation | None:
    """Return the proof that no law within limits goes below a level; None if none was found.

    The level is the ``at_most`` of the first of its specifications; behind it stand the limits that
    count. Those that are not on an rms, or where a gain is minimised on a gain, with the same
    disturbances are left out: without them there are more laws.

    Parameters
    ----------
    near : float
        What some law within the limits keeps.

    Returns
    -------
    Refutation or None
        It holds for the laws of `refute_limits`: of any order, whatever they measure. None of a
        plant in discrete time, with a dead time, with functions of its parameters or of more than
        30 states, and where something else than an rms or a gain is minimised.
    """
    exact = plant.remainder is None and plant.dead_time is None and not plant.period
    if not (exact and plant.shape[0] <= MOST_STATES and near > 0):
        return None
    if isinstance(minimise, Gain):
        return _least_gain(plant, minimise, limits, near)
    if not (isinstance(minimise, Rms) and minimise.limits_rms):
        return None
    chosen = minimise.scales(plant)
    known = (s for s in limits if isinstance(s, Rms) and s.limits_rms and s.at_most)
    asked = [replace(minimise, at_most=near), *(s for s in known if s.scales(plant) == chosen)]
    larger, bare = with_weights(plant, asked)
    disturbance(larger)
    rms = [
        RmsLimit(s.exact_outputs(larger), Fraction(w.at_most or 0.0), Fraction(w.density) / 2)
        for w, s in zip(asked, bare, strict=True)
    ]
    if any(output.F for limit in rms for output in limit.outputs):
        return None
    question = Within(larger, tuple(rms), tuple(map(Fraction, asked[0].scales(larger))))
    found = question.proved()
    if found is None:
        return None
    claim, reason = found
    first, *others = claim.limits
    kept = [asked[rms.index(limit)] for limit in others]
    level = float(first.level)
    refutation = Refutation(plant, (replace(minimise, at_most=level), *kept), claim, reason)
    # weights are sought in units of the limits: near the least they are those that count
    nearer = least_of_any(plant, minimise, limits, level) if level < near / 2 else None
    return nearer or refutation


def _least_gain(
    plant: UncertainPlant, minimise: Gain, limits: Sequence[Specification], near: float
) -> Refutation | None:
    """Return the proof that no law within limits has a gain below a level, not far below ``near``.

    It holds for every law for which states and inputs have no more than some multiple of the energy
    of the disturbances.
    """
    if not _gains([minimise]):
        return None
    chosen = minimise.scales(plant)
    asked = [replace(minimise, at_most=near), *_gains(s for s in limits if s.at_most)]
    asked = [s for s in asked if s.scales(plant) == chosen]
    question = _of_gains(plant, asked)
    claim = question.least()
    if claim is None or float(claim.limits[0].level) < LEAST_GAIN * near:
        return None
    verdict = _proved(claim)
    kept = [asked[question.limits.index(limit)] for limit in claim.limits[1:]]
    found = (replace(minimise, at_most=float(claim.limits[0].level)), *kept)
    return None if verdict is None else Refutation(plant, found, claim, verdict.reason)


def _gains(specifications: Iterable[Specification]) -> list[Gain]:
    """Return those that are on gains at all times, of all frequencies."""
    gains = (s for s in specifications if isinstance(s, Gain) and s.band is None)
    return [s for s in gains if s.at == ALL_TIMES]


def _of_gains(plant: UncertainPlant, asked: Sequence[Gain]) -> Question:
    """Return the question of gains from the same disturbances."""
    disturbance(plant)
    bounded = tuple(GainLimit(s.exact_outputs(plant), Fraction(s.at_most or 0.0)) for s in asked)
    return Question(plant, bounded, tuple(map(Fraction, asked[0].scales(plant))))


def _gains_refuted(plant: UncertainPlant, limits: Sequence[Specification]) -> Refutation | None:
    """Return the proof that no law keeps limits on gains for the same disturbances."""
    gains = _gains(s for s in limits if s.at_most is not None)
    exact = plant.remainder is None and plant.dead_time is None
    if not exact or plant.shape[0] > MOST_STATES:
        return None
    for chosen in dict.fromkeys(s.scales(plant) for s in gains):
        together = tuple(s for s in gains if s.scales(plant) == chosen)
        with suppress(np.linalg.LinAlgError):
            claim = _of_gains(plant, together).refuted()
            verdict = None if claim is None else _proved(claim)
            if claim is not None and verdict is not None:
                return Refutation(plant, together, claim, verdict.reason)
    return None


@dataclass(frozen=True, eq=False)
class Within(Short):
    """The least of one rms that any law has within limits on others.

    With a_0 = 1 for what is minimised, its mean square is at least S (tr E'P E - sum a_i g_i^2 /
    S_i) for every a: the dual function of the limits g, concave in a.

    Attributes
    ----------
    plant : UncertainPlant
    limits : tuple of RmsLimit
        The first is what is minimised, at a level near the least.
    scales : tuple of Fraction
    """

    plant: UncertainPlant
    limits: tuple[RmsLimit, ...]
    scales: tuple[Fraction, ...]

    def proved(self) -> tuple[RmsRefutation, str] | None:
        """Return the claim of the highest level of any vertex that is proved, and what was."""
        best = sorted(self._vertices(), key=lambda found: -round(found[0], 6))
        for square, j, weights in best[:1]:
            counts = [0, *(k for k, a in enumerate(weights) if k and a > LEAST_WEIGHT)]
            few = replace(self, limits=tuple(self.limits[k] for k in counts))
            level = float(self.limits[0].level) * np.sqrt(square)
            # how much room rounding takes depends on the weights: none of little is often better
            tried = [(few, weights[counts]), (self, weights), (self, np.maximum(weights, LITTLE))]
            known = list[tuple[RmsRefutation, str]]()
            for question, chosen in tried:
                found = question._proved_at(j, chosen)
                known += [] if found is None else [found]
                if found is not None and found[0].limits[0].level > level * (1 - LITTLE):
                    break
            return max(known, key=lambda found: found[0].limits[0].level, default=None)
        return None

    def _vertices(self) -> Iterator[tuple[float, int, Array]]:
        """Yield squares of levels, over that of the first limit, vertices, and the weights.

        Of many vertices the best few with the weights of one of them.
        """
        N, looked = len(self.plant.vertices), list[tuple[float, int, Regulated]]()
        start: Array | None = None
        for j in range(N):
            floats = self._floats(j)
            if floats is None:
                continue
            if start is None or N <= FEW:
                square, weights = dual_best(floats, DECAY * _rate(floats.A))
                if square > 0:
                    start = weights
                    yield square, j, weights
                continue
            looked.append((_dual(floats, start, DECAY * _rate(floats.A))[0], j, floats))
        for _, j, floats in sorted(looked, key=lambda found: -round(found[0], 6))[:FEW]:
            square, weights = dual_best(floats, DECAY * _rate(floats.A), start)
            if square > 0:
                yield square, j, weights

    def _floats(self, j: int) -> Regulated | None:
        exact = _regular_at(self.plant, self.limits, self.scales, j)
        return None if exact is None else self._regulated(exact, j)

    def _regulated(self, exact: Regular, j: int) -> Regulated:
        return _regulated(exact, _units(self.limits), _owner(self.limits), (), j)

    def _proved_at(self, j: int, weights: Array) -> tuple[RmsRefutation, str] | None:
        """Return the claim of a vertex, with the largest P that is proved."""
        exact = _regular_at(self.plant, self.limits, self.scales, j)
        if exact is None:
            return None
        A, B, E = _exact(self.plant)
        (first, *others), unit = self.limits, _units(self.limits)
        own, *rest = (Fraction(a) for a in (weights * unit**2).tolist())
        used = sum((a * y.level**2 / y.intensity for a, y in zip(rest, others, strict=True)), _ZERO)
        for P_reduced in _matrices(self._regulated(exact, j), weights):
            square = first.intensity * (_driven(exact, P_reduced) - used) / own
            if square <= 0:
                continue
            level = Fraction(float(np.sqrt(float(square))) * (1 - 1e-9))
            limits = (replace(first, level=level), *others)
            P = lifted(P_reduced, exact.T)
            claim = RmsRefutation(A, B, E, limits, j, (own, *rest), P, scales=self.scales)
            verdict = _proved(claim)
            if verdict is not None:
                return claim, verdict.reason
        return None


def _driven(plant: Regular, P: Rationals) -> Fraction:
    """Return tr E'P E."""
    columns = zip(*plant.E, strict=True)
    return sum((dot(e, [dot(row, e) for row in P]) for e in columns), _ZERO)


def _dual(plant: Regulated, weights: Array, decay: float) -> tuple[float, Array]:
    """Return the dual function's value, over the square of the first limit, and its slopes."""
    slower = replace(plant, A=plant.A - decay * np.eye(len(plant.A)))
    try:
        P = slower.riccati(weights)
        slopes = slower.mean_squares(weights, P)
    except (SolverError, np.linalg.LinAlgError):
        return -np.inf, np.zeros(0)
    return slower.cost(P) - float(weights[1:].sum()), slopes


def dual_best(plant: Regulated, decay: float, start: Array | None = None) -> tuple[float, Array]:
    """Return the largest value of the dual function of the limits, and their weights; 0 if none.

    The first weight is one. Cutting planes as in `heaviest`.
    """
    count, reach = int(plant.limit.max()) + 1, 4.0
    weights = best = np.ones(count) if start is None else start
    most, cuts = 0.0, list[Array]()
    for _ in range(60 if count > 1 else 1):
        value, slopes = _dual(plant, weights, decay)
        if not len(slopes):
            reach = np.sqrt(reach)
        else:
            cuts.append(slopes)
            if value > most or len(cuts) == 1:
                best, most = weights, value
        if not cuts:
            break
        weights, bound = _highest_dual(np.array(cuts), best, reach)
        if not bound > most + CLOSE * abs(most):
            break
    return max(most, 0.0), best


def _highest_dual(cuts: Array, centre: Array, reach: float) -> tuple[Array, float]:
    """Return weights of the largest t - sum of the others with t <= cuts @ weights, and that."""
    from scipy.optimize import linprog

    size = np.abs(cuts).max()
    if not size > 0:  # some law makes nothing of what is minimised
        return centre, -np.inf
    bounds = [(max(1e-7, x / reach), x * reach) for x in centre[1:]]
    optimum = linprog(
        np.append(np.ones(len(centre) - 1), -1.0) / size,
        np.hstack([-cuts[:, 1:], np.ones((len(cuts), 1))]) / size,
        cuts[:, 0] / size,
        bounds=[*bounds, (None, None)],
    )
    if not optimum.success or optimum.x is None:
        return centre, -np.inf
    return np.append(1.0, optimum.x[:-1]), -float(optimum.fun or 0.0) * size


def _refuted_together(
    plant: UncertainPlant, asked: tuple[Rms, ...], dampers: tuple[Damper, ...]
) -> Refutation | None:
    """Return the proof that no law keeps limits for the same disturbances."""
    larger, bare = with_weights(plant, asked)
    disturbance(larger)
    limits = tuple(
        RmsLimit(
            s.exact_outputs(larger), Fraction(limit.at_most or 0.0), Fraction(limit.density) / 2
        )
        for limit, s in zip(asked, bare, strict=True)
    )
    semi_active = tuple(damper.of(larger) for damper in dampers)
    for claim in _claims(larger, limits, asked[0].scales(larger), semi_active):
        verdict = _proved(claim)
        if verdict is not None:
            return Refutation(plant, asked, claim, verdict.reason)
    return None


def _proved(claim: RmsRefutation | GainRefutation) -> Verdict | None:
    """Return the proof of a claim, None where it has none."""
    with suppress(FormatError):
        verdict = prove(claim)
        return verdict if verdict.proved else None
    return None


def _claims(
    plant: UncertainPlant,
    limits: tuple[RmsLimit, ...],
    scales: Sequence[float],
    dampers: tuple[SemiActive, ...],
) -> Iterator[RmsRefutation]:
    """Yield claims to prove, from the vertex where the limits are furthest apart."""
    A, B, E = _exact(plant)
    exact_scales = tuple(map(Fraction, scales))
    owner = _owner(limits)
    unit = _units(limits)
    vertices: list[tuple[float, int, Array, Regular, Regulated]] = []
    for j in range(len(A)):
        exact = _regular_at(plant, limits, exact_scales, j, reduced=not dampers)
        if exact is None:
            continue
        floats = _regulated(exact, unit, owner, dampers, j)
        weights, cost = heaviest(floats, DECAY * _rate(floats.A))
        if cost > 1:
            vertices.append((cost, j, weights, exact, floats))
    for _, j, weights, exact, floats in sorted(vertices, key=lambda vertex: -round(vertex[0], 5)):
        count = len(limits)
        scaled = tuple(Fraction(x) for x in (weights[:count] * unit**2).tolist())
        taus = zip(weights[count:].tolist(), floats.units, strict=True)
        multipliers = tuple(Fraction(tau) * Fraction(size) for tau, size in taus)
        allowed = sum(a * y.level**2 / y.intensity for a, y in zip(scaled, limits, strict=True))
        for P_reduced in _matrices(floats, weights):
            factor = _factor(exact, P_reduced, allowed)
            if factor >= 1:
                P = lifted(P_reduced, exact.T)
                evidence = (j, scaled, P, factor, dampers, multipliers, exact_scales)
                yield RmsRefutation(A, B, E, limits, *evidence)


def _exact(plant: UncertainPlant) -> tuple[list[Rationals], list[Rationals], list[Rationals]]:
    """Return A, B and E of each vertex."""
    A, B, E = (
        [[list(row) for row in M] for M in matrices if M is not None]
        for matrices in (
            [v.exact_A for v in plant.vertices],
            [v.exact_B for v in plant.vertices],
            [v.exact_E for v in plant.vertices],
        )
    )
    return A, B, E


def _owner(limits: Sequence[RmsLimit]) -> Index:
    """Return the number of its limit for each output."""
    return np.repeat(np.arange(len(limits)), [len(limit.outputs) for limit in limits])


def _units(limits: Sequence[RmsLimit]) -> Array:
    """Return what outputs are multiplied by: the noise goes into them, each is over its limit."""
    return np.sqrt([float(limit.intensity) / float(limit.level) ** 2 for limit in limits])


def _regular_at(
    plant: UncertainPlant,
    limits: Sequence[RmsLimit],
    scales: Sequence[Fraction],
    j: int,
    reduced: bool = True,
) -> Regular | None:
    """Return a vertex, of fewer states where it is reduced; None if nothing of it is left."""
    v = plant.vertices[j]
    A, B, E = ([list(row) for row in M or ()] for M in (v.exact_A, v.exact_B, v.exact_E))
    if scales:
        E = [[x * s for x, s in zip(row, scales, strict=True)] for row in E]
    outputs = [output for limit in limits for output in limit.outputs]
    C, D = ([row for y in outputs for row in getattr(y, k)[j]] for k in "CD")
    if reduced:
        return regular(A, B, E, C, D)
    # a damper's force is never free, whatever outputs show
    return Regular(A, B, E, C, D, identity(len(A)))


def _product_of(damper: SemiActive, vertex: int, m: int) -> Array:
    """Return (u - low v)(u - high v) as a quadratic form of (x, u)."""
    first, second = (np.array([float(x) for x in row]) for row in damper.rows(vertex, m))
    return np.asarray((np.outer(first, second) + np.outer(second, first)) / 2)


def _regulated(
    exact: Regular, unit: Array, owner: Index, dampers: Sequence[SemiActive], vertex: int
) -> Regulated:
    A, B, E, C, D = (
        np.array([[float(x) for x in row] for row in M])
        for M in (exact.A, exact.B, exact.E, exact.C, exact.D)
    )
    C, D = unit[owner, None] * C, unit[owner, None] * D
    # the cost is positive without multipliers, and where they are small
    both, n = np.hstack([C, D]), len(A)
    units = [
        1e-3 * float(np.linalg.norm(both[:, n + damper.number]) or np.linalg.norm(both)) ** 2
        for damper in dampers
    ]
    products = [_product_of(damper, vertex, B.shape[1]) for damper in dampers]
    forms = tuple(size * form for size, form in zip(units, products, strict=True))
    return Regulated(A, B, E, C, D, owner, forms, tuple(units))


def _rate(A: Array) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max()) or 1.0


def _matrices(plant: Regulated, weights: Array) -> Iterator[Rationals]:
    """Yield P from the largest down."""
    rate = _rate(plant.A)
    if plant.forms:
        with suppress(SolverError):
            P = plant.riccati(weights)
            for decay, _ in MARGINS[: len(MARGINS) // 2]:
                less = decay * rate * np.diag(np.abs(np.diag(P)))
                solution = plant.riccati(weights, less=less)
                yield [[Fraction(x) for x in row] for row in solution.tolist()]
        return
    for decay, share in MARGINS:
        try:
            P = plant.riccati(weights, decay * rate)
            if share:
                less = share * decay * rate * np.diag(np.maximum(np.diag(P), 0.0))
                P = plant.riccati(weights, decay * rate, less)
        except SolverError:
            continue
        yield [[Fraction(x) for x in row] for row in P.tolist()]


def _factor(plant: Regular, P: Rationals, allowed: Fraction | int) -> Fraction:
    """Return what the limits may be multiplied by, a little less than P proves."""
    E = np.array([[float(x) for x in row] for row in plant.E])
    least = float(np.trace(E.T @ np.array(P, dtype=float) @ E))
    if not (least > 0 and allowed > 0):
        return Fraction(0)
    return Fraction(float(np.sqrt(least / float(allowed))) * (1 - 1e-9))


@dataclass(frozen=True, eq=False)
class Regulated(Short):
    """Arrays A, B, E of a plant, and C, D of its outputs, each over the limit on its rms.

    ``limit`` has the number of that limit for each row: a limit on a vector has more than one.
    ``forms`` are quadratic forms of (x, u) that are never positive, in units of ``units``; their
    weights, the multipliers, stand behind those of the limits.
    """

    A: Array
    B: Array
    E: Array
    C: Array
    D: Array
    limit: Index
    forms: tuple[Array, ...] = ()
    units: tuple[float, ...] = ()

    def weighted(self, weights: Array) -> tuple[Array, Array, Array]:
        """Return Q, N and R of the weighted sum of outputs and forms."""
        n, count = len(self.A), len(weights) - len(self.forms)
        root = np.sqrt(weights[:count])[self.limit, None]
        both = np.hstack([root * self.C, root * self.D])
        whole = both.T @ both
        for tau, form in zip(weights[count:], self.forms, strict=True):
            whole = whole + tau * form
        return whole[:n, :n], whole[:n, n:], whole[n:, n:]

    def riccati(self, weights: Array, decay: float = 0.0, less: Array | None = None) -> Array:
        """Return P of the regulator, for the plant with this much more decay, less so much cost.

        Raises
        ------
        SolverError
            If there is none.
        """
        from scipy.linalg import solve_continuous_are

        A = self.A - decay * np.eye(len(self.A))
        Q, N, R = self.weighted(weights)
        Q = Q if less is None else Q - less
        try:
            with np.errstate(all="ignore"):
                P = solve_continuous_are(A, self.B, Q, R, s=N)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise SolverError(f"no regulator: {error}") from error
        if not np.isfinite(P).all():
            raise SolverError("no regulator: its matrix is not finite")
        return np.asarray((P + P.T) / 2)

    def cost(self, P: Array) -> float:
        """Return the least sum of the outputs' mean squares that P stands for."""
        return float(np.trace(self.E.T @ P @ self.E))

    def mean_squares(self, weights: Array, P: Array) -> Array:
        """Return those of the outputs of each limit, and the forms' means, under the regulator.

        Raises
        ------
        SolverError
            If its loop is not stable.
        """
        from scipy.linalg import solve_continuous_lyapunov

        _, N, R = self.weighted(weights)
        K = -np.linalg.solve(R, self.B.T @ P + N.T)
        loop = self.A + self.B @ K
        poles = np.linalg.eigvals(loop)
        # a pole nearer to the imaginary axis is on it
        if poles.real.max() >= -1e-11 * np.linalg.norm(loop):
            raise SolverError("the regulator leaves a pole on the imaginary axis")
        X = solve_continuous_lyapunov(loop, -self.E @ self.E.T)
        Y = self.C + self.D @ K
        squares = np.maximum(np.einsum("ij,jk,ik->i", Y, X, Y), 0.0)
        loop = np.vstack([np.eye(len(X)), K])
        means = [float(np.sum(form * (loop @ X @ loop.T))) for form in self.forms]
        return np.concatenate([np.bincount(self.limit, squares), means])


def heaviest(plant: Regulated, decay: float) -> tuple[Array, float]:
    """Return the weights of sum 1 for which the regulator costs most, and how much; 0 if nothing.

    The cost is concave in the weights and its slopes are the mean squares: cutting planes, each an
    upper bound everywhere, within a factor of the best weights so far.
    """
    count, reach = int(plant.limit.max()) + 1, 4.0
    slower = replace(plant, A=plant.A - decay * np.eye(len(plant.A)))
    weights = best = _first(slower, count)
    most, cuts = 0.0, list[Array]()
    for _ in range(60):
        try:
            P = slower.riccati(weights)
            value, slopes = slower.cost(P), slower.mean_squares(weights, P)
        except (SolverError, np.linalg.LinAlgError):
            reach = np.sqrt(reach)
        else:
            cuts.append(slopes)
            if value > most:
                best, most = weights, value
        if most <= 0:
            break
        weights, bound = _highest(np.array(cuts) / most, best, reach, count)
        if not bound > 1 + 1e-7:
            break
    return best, most


def _first(plant: Regulated, count: int) -> Array:
    """Return equal weights, and the largest multipliers of the forms that leave a cost.

    A force that shows behind a filter only has no cost of its own to compare its multiplier with.
    """
    weights = np.append(np.full(count, 1 / count), np.ones(len(plant.forms)))
    for _ in range(12 if plant.forms else 0):
        with suppress(SolverError):
            if plant.cost(plant.riccati(weights)) > 0:
                break
        weights[count:] *= 0.1
    return weights


def _highest(cuts: Array, centre: Array, reach: float, count: int) -> tuple[Array, float]:
    """Return the weights of the largest t with t <= cuts @ weights, and t; 0 if not found.

    The first ``count`` are those of limits, of sum 1, the others multipliers.
    """
    from scipy.optimize import linprog

    # without any weight the control may be free
    bounds = [(max(1e-7, x / reach), min(1.0, x * reach)) for x in centre[:count]]
    bounds += [(x / reach, x * reach) for x in centre[count:]]
    optimum = linprog(
        np.append(np.zeros(len(centre)), -1.0),
        np.hstack([-cuts, np.ones((len(cuts), 1))]),
        np.zeros(len(cuts)),
        np.append(np.arange(len(centre)) < count, 0.0)[None],
        [1.0],
        [*bounds, (None, None)],
    )
    if not optimum.success or optimum.x is None:
        return centre, 0.0
    return np.asarray(optimum.x[:-1]), float(optimum.x[-1])
