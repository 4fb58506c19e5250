"""Suspension concepts side by side: what is proved of each for every load, and what drives have.

All have one rms to keep low: acceleration, tyre deflection and whatever else, each times a weight.
From a fixed damper, by dampers that a logic sets, to a force that knows every state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import accumulate

import numpy as np

from polefence.base.errors import InputError, NotProvedError
from polefence.base.explained import explained
from polefence.base.processors import small_matrices
from polefence.base.progress import counted
from polefence.certify.bounds import best_bound
from polefence.certify.refutation import lowest
from polefence.law.laws import FixedGain, Law
from polefence.law.structure import Structure
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states, sensors, with_states
from polefence.plant.outputs import Output, choose, rows_at, stacked, states
from polefence.plant.points import seeded
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.region.regions import Disk
from polefence.requirements.named import by_name
from polefence.requirements.rms import Rms
from polefence.response.closed import close
from polefence.response.weighting import Stages
from polefence.search.optimise import Optimised, optimise
from polefence.search.semi_active import QUICK, DamperQuestion
from polefence.vehicle.driving.drive import drive
from polefence.vehicle.driving.parts import Hardware
from polefence.vehicle.excitation import disturbed
from polefence.vehicle.reference_laws import nominal
from polefence.vehicle.suspensions import Suspensions, suspensions

ROADS, SECONDS, STEP = 10, 100.0, 1e-3
DRIVEN = Disk(-1 / (2 * STEP), 1 / (2 * STEP))  # poles that drives can follow
# Of the largest cost of a state, what any costs where none would leave a drift. A car whose travel
# costs nothing has its LQG proved at 0.88937, and a pole at -0.006 1/s, with 1e-12; at 0.88986, and
# at -0.2, with this; at 0.918, and at -0.7, with 1e-4.
SLIGHT = 1e-6
# Unknowns of bounds with bent dampers. Of the shown car degree 4 has 2,520 and takes 5 s, degree 6
# three times as many and a minute.
BENT = 3000
LEAST = 1e-3  # of the largest, what forces cost a regulator in any direction
# Of a Kalman filter's sensors, white from sample to sample at 1 kHz, rms by unit.
NOISE = {"m": 5e-4, "m/s": 5e-3, "m/s2": 0.05, "rad": 5e-4, "rad/s": 5e-3}


@dataclass(frozen=True, eq=False)
class Concept(Short):
    """A suspension and its law.

    Attributes
    ----------
    name : str
    sensors : tuple of str
        What the law measures.
    plant : UncertainPlant
        With the law's own states behind it.
    law : Law
        What is demanded.
    dampers : tuple of Damper
        That give what is demanded as far as they can; none where forces do.
    level : float, optional
        The rms is at most this for every value of the parameters; None where nothing is proved.
    reason : str
        Why not, and what to change; empty where it is not known.
    """

    name: str
    sensors: tuple[str, ...]
    plant: UncertainPlant
    law: Law
    dampers: tuple[Damper, ...]
    level: float | None
    reason: str = ""

    @property
    def gain(self) -> float:
        """The largest number in the gain of a force, over the corners of the family."""
        forces = self.plant.shape[1] - own_states(self.plant)
        corners = np.eye(len(self.plant.vertices))
        K = close(self.plant, self.law, corners, disturbed=False).K
        return float(np.abs(K[:, :forces]).max())


@dataclass(frozen=True)
class Ridden(Short):
    """Rms values of a concept in drives: the worst load, each averaged over the roads.

    Of a car on several wheels those of the seat, the wheel and the actuator where they are largest.

    All are nan where a drive ran away, or the law is too fast for the step of a drive.

    Attributes
    ----------
    cost : float
        Of what is kept low.
    error : float
        Its standard error.
    acceleration : float
        Of the sprung mass, or of a seat [m/s2].
    tyre : float
        Variation of the tyre's force [N].
    travel : float
        [m]
    force : float
        Of damper or actuator [N].
    power : float
        Mean of what is positive of the power into the car, summed over the suspensions [W].
    """

    cost: float
    error: float
    acceleration: float
    tyre: float
    travel: float
    force: float
    power: float


@dataclass(frozen=True, eq=False)
class Concepts(Short):
    """Concepts: proved bounds, values in drives, and proved lower bounds for any law.

    Attributes
    ----------
    specification : Rms
        What is kept low.
    rows : tuple of (Concept, Ridden)
    semi_active, active : float, optional
        No semi-active law, and none at all, goes below it; None where nothing was proved.
    loads : int
        Values of the parameters that were driven.
    """

    plant: UncertainPlant
    specification: Rms
    rows: tuple[tuple[Concept, Ridden], ...]
    semi_active: float | None
    active: float | None
    loads: int


@explained
@small_matrices()
def concepts(
    plant: UncertainPlant,
    specification: Rms,
    dampers: Sequence[Damper],
    measured: Sequence[str] | None = None,
) -> Concepts:
    """Design seven suspensions for one rms, prove it for every load, and drive them.

    The best fixed damper; a skyhook, ADD and the law of `semi_active` for dampers; LQG, an
    active law by the same sensors and one by all states, for forces in place of the dampers.

    Parameters
    ----------
    plant : UncertainPlant
        A car without its controllable dampers, in continuous time.
    specification : Rms
        Of one signal or a vector, with a force in it.
    dampers : sequence of Damper
        One for each input.
    measured : sequence of str, optional
        By LQG and one active law; by default what the plant's sensors say; without sensors each
        suspension's deflection and the velocity of the body above it, which an accelerometer tells.

    Raises
    ------
    InputError
        If the plant is no car, or something does not fit.
    NotProvedError
        If no dampers that stay keep every vertex stable.
    """
    plant, (asked,) = by_name(plant, (specification,))
    known = suspensions(plant)
    plant, body = _with_velocities(plant, known)
    sensed = tuple(measured or sensors(plant) or (*(y.name for y in known.travel), *body))
    task = _Task(plant, asked, tuple(dampers), known, sensed, body)
    active, others = task.below(()), task.below(task.dampers)
    if active is not None:  # what no law has, no semi-active one has
        others = active if others is None else max(active, others)
    designed = counted(list(task.concepts()), "concept")
    rows = tuple((one, task.driven(one)) for one in designed)
    return Concepts(plant, specification, rows, others, active, len(task.loads))


def _with_velocities(
    plant: UncertainPlant, known: Suspensions
) -> tuple[UncertainPlant, tuple[str, ...]]:
    """Return a plant with the body's velocity above each wheel as a signal, and their names."""
    names = [state.name for state in states(plant)]
    outputs, chosen = list(plant.outputs), list[str]()
    for wheel, row in zip(known.names, known.body, strict=True):
        (first, *others) = np.flatnonzero(row).tolist()
        if not others and row[first] == 1:  # a state says it
            chosen.append(names[first])
            continue
        chosen.append(f"{wheel} body velocity")
        if chosen[-1] not in [signal.name for signal in plant.signals]:
            outputs.append(Output(chosen[-1], "m/s", C=row))
    return replace(plant, outputs=tuple(outputs)), tuple(chosen)


class _Task:
    def __init__(
        self,
        plant: UncertainPlant,
        specification: Rms,
        dampers: tuple[Damper, ...],
        known: Suspensions,
        measured: tuple[str, ...],
        body: tuple[str, ...] = (),
    ) -> None:
        self.plant, self.specification, self.dampers = plant, specification, dampers
        self.known, self.measured, self.body = known, measured, body
        _, *through = stacked(plant, choose(plant, measured))
        for M, what in zip(through, ("force", "disturbance"), strict=True):
            if M.any():
                raise InputError(f"measured: a {what} passes straight into {', '.join(measured)}")
        for signal in choose(plant, measured):
            if signal.unit not in NOISE:
                raise InputError(
                    f"measured: {signal.name}: no sensor is known for {signal.unit or '1'}"
                )
        self.question = DamperQuestion.of(plant, specification, dampers)
        self.others = self.question.unproved
        in_order = (one.of(plant).rate[0][0] for one in self.others.dampers)
        self.rates = np.array([[float(x) for x in rate] for rate in in_order])
        # the corners, and others at random
        self.loads = seeded(plant, max(8, len(plant.vertices)))
        self.physics = known.corners(nominal(plant))

    def concepts(self) -> Iterator[Concept]:
        """Design all."""
        names = tuple(state.name for state in states(self.plant))
        deflections = tuple(signal.name for signal in self.known.travel)
        rates = tuple(f"rate of {name}" for name in deflections)
        yield self.passive()
        yield self.clipped("skyhook", (*self.body, *rates), self.skyhook())
        yield self.clipped("ADD", (*deflections, *rates), self.against_the_spring())
        if self.others.K is not None:
            yield self.clipped("semi-active", names, self.others.K)
        larger, law = self.lqg()
        yield Concept("LQG", self.measured, larger, law, (), self.proved(larger, law))
        for name, few in (("active, few sensors", self.measured), ("active, all states", None)):
            done = self.active(few)
            yield Concept(name, few or names, done.plant, done.law, (), done.bounds[0].level)

    def active(self, measured: tuple[str, ...] | None) -> Optimised:
        """Return the law of forces, sought once more within `DRIVEN` where it is too fast to drive.

        Forces of several suspensions that cancel out in every signal cost nothing, however large.
        """
        structure = Structure(measured=measured)
        done = optimise(self.plant, self.specification, structure=structure)
        loops = close(done.plant, done.law, self.loads, disturbed=False)
        if np.abs(loops.poles()).max() * STEP > 1:
            with suppress(NotProvedError):
                return optimise(self.plant, self.specification, region=DRIVEN, structure=structure)
        return done

    def proved(self, plant: UncertainPlant, law: Law) -> float | None:
        """Return the proved bound of a law of forces."""
        bound = best_bound(plant, law, self.specification)
        return None if bound is None else bound.level

    def passive(self) -> Concept:
        """Return the best dampers that stay: lines are a gain, curves that are bent their own."""
        c = np.array(self.others.coefficients)
        stays = FixedGain(c[:, None] * self.rates)
        if self.question.even:
            return Concept("passive", (), self.plant, stays, (), self.proved(self.plant, stays))
        pairs = zip(self.others.dampers, self.others.staying, strict=True)
        curves = tuple(replace(damper, low=curve, high=curve) for damper, curve in pairs)
        question = DamperQuestion.of(self.plant, self.specification, curves)
        return self.clipped("passive", (), stays.K, question)

    def clipped(
        self, name: str, sensors: tuple[str, ...], K: Array, question: DamperQuestion | None = None
    ) -> Concept:
        """Return the concept of a dampers' demand, clipped, with its proved bound."""
        level, reason, question = None, "", question or self.question
        try:
            level = question.law(K=K, quick=QUICK if question.even else BENT).level
        except NotProvedError as error:
            reason = str(error)
        return Concept(name, sensors, self.plant, FixedGain(K), question.dampers, level, reason)

    def skyhook(self) -> Array:
        """Return the skyhook that has the least rms in drives, all corners at one share."""
        critical = 2 * np.sqrt(self.physics.spring * self.physics.mass)
        driven = []
        for share in np.geomspace(0.1, 4.0, 9).tolist():
            K = self.forces(-share * critical[:, None] * self.known.body)
            driven.append((self._roads(self.plant, FixedGain(K), self.dampers, 1)[0].max(), K))
        return min(driven, key=lambda pair: pair[0])[1]

    def against_the_spring(self) -> Array:
        """Return the demand of ADD: the negative of the springs' forces."""
        return self.forces(-self.physics.spring[:, None] * self.known.compression)

    def forces(self, rows: Array) -> Array:
        """Return the gain of which the suspensions' forces are rows."""
        K = np.zeros(self.plant.shape[::-1])
        K[list(self.known.inputs)] = rows
        return K

    def lqg(self) -> tuple[UncertainPlant, FixedGain]:
        """Return the regulator of the nominal car with a Kalman filter, and the plant with it.

        It is for the signals without weights: behind one a force costs nothing at once. So do
        forces of several suspensions that cancel out in every signal: they cost at least a share.
        """
        from scipy.linalg import solve_continuous_are

        plant, spec, alpha = self.plant, self.specification.unweighted(), nominal(self.plant)
        A, B = plant.at(alpha)
        C, D, _ = rows_at(plant, spec.outputs(plant), alpha)
        E = np.tensordot(alpha, spec.entering(plant), 1) * (spec.density / 2) ** 0.5
        signals = choose(plant, self.measured)
        seen = rows_at(plant, signals, alpha)[0]
        noise = np.array([NOISE[signal.unit] ** 2 * 1e-3 for signal in signals])
        # a force costs one: sensors' states spoil the equation where it costs little
        C, D = (M / (np.linalg.norm(D, 2) or 1.0) for M in (C, D))
        R = _at_least(D.T @ D, LEAST)
        try:
            P = _regulator(A, B, C, D, R)
            # of noise of one the equation is solved where other units spoil it
            even = (seen / np.sqrt(noise)[:, None]).T
            X = solve_continuous_are(A.T, even, E @ E.T, np.eye(len(noise)))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise InputError(
                f"{plant.name}: no LQG by {' and '.join(self.measured)}: {error}"
            ) from error
        K = -np.linalg.solve(R, B.T @ P + D.T @ C)
        filtered = X @ seen.T / noise
        both = np.block([[np.zeros(K.shape), K], [filtered @ seen, A + B @ K - filtered @ seen]])
        return with_states(plant, len(A)), FixedGain(both)

    def below(self, dampers: tuple[Damper, ...]) -> float | None:
        """Return the lower bound for any logic of these dampers, or any law of forces."""
        bound = lowest(self.plant, self.specification, self.others.passive, dampers)
        return None if bound is None else bound[1]

    def driven(self, one: Concept) -> Ridden:
        """Drive a concept; a law with poles too fast for the drives' step is not driven."""
        try:
            squares = self._roads(one.plant, one.law, one.dampers, ROADS)
        except InputError:
            return Ridden(*(np.nan,) * len(fields(Ridden)))
        rms = np.sqrt(squares[0])
        worst = int(np.argmax(rms.mean(axis=1)))
        error = float(rms[worst].std(ddof=1) / np.sqrt(ROADS))
        means = squares.mean(axis=2).max(axis=1)
        cost, *parts = np.split(means[:-1], self._ends)
        acceleration, tyre, travel, force = (float(np.sqrt(part.max())) for part in parts)
        level = float(np.sqrt(cost[0]))
        return Ridden(level, error, acceleration, tyre, travel, force, float(means[-1]))

    @property
    def _ends(self) -> list[int]:
        """Where in the quantities of a road those of seats, tyres, travel and forces begin."""
        k = len(self.known.names)
        return list(accumulate([1, len(self.known.felt), k, k]))

    def _roads(
        self, plant: UncertainPlant, law: Law, dampers: tuple[Damper, ...], count: int
    ) -> Array:
        """Return mean squares, and the power, by load and road: (quantities, loads, roads)."""
        return np.stack([self._road(plant, law, dampers, k) for k in range(count)], axis=-1)

    def _road(
        self, plant: UncertainPlant, law: Law, dampers: tuple[Damper, ...], seed: int
    ) -> Array:
        spec, known = self.specification, self.known
        random, steps = np.random.default_rng(seed), round(SECONDS / STEP)
        w = random.standard_normal((steps, self.plant.disturbance_count))
        w *= np.sqrt(spec.density / 2 / STEP * spec.squares(self.plant))
        moved = disturbed(plant, w, STEP, hold="held")
        driven = drive(plant, law, moved, self.loads, Hardware(dampers=dampers))
        cost = [signal.name for signal in spec.outputs(self.plant)]
        felt = (known.felt.values(), known.tyre, known.travel, known.force)
        shown = [signal.name for signals in felt for signal in signals]
        # settled 5 s from rest
        asked, begin = list(dict.fromkeys([*cost, *shown])), round(5.0 / STEP)
        values = driven.response(asked).values
        place = {name: i for i, name in enumerate(asked)}
        squares = np.mean(values[:, begin:, [place[name] for name in shown]] ** 2, axis=1)
        _, tyres, after, _ = self._ends
        squares[:, tyres - 1 : after - 1] *= known.corners(self.loads).tyre ** 2
        v = driven.states[:, begin:, : self.rates.shape[1]] @ self.rates.T
        into = -driven.applied[:, begin:, : len(self.rates)] * v
        power = np.maximum(into, 0.0).mean(axis=1).sum(axis=1)
        pairs = zip(cost, spec.filters, strict=True)
        whole = sum(
            _mean_square(values[..., place[name]], filter_, begin) for name, filter_ in pairs
        )
        return np.vstack([whole, *squares.T, power])


def _at_least(R: Array, share: float) -> Array:
    """Return a symmetric matrix with no eigenvalue below a share of its largest."""
    values, turn = np.linalg.eigh(R)
    return np.asarray((turn * np.maximum(values, share * values[-1])) @ turn.T)


def _regulator(A: Array, B: Array, C: Array, D: Array, R: Array) -> Array:
    """Return the stabilising solution of a regulator's Riccati equation.

    What costs nothing may drift: where that leaves a pole at the edge, all states cost a little.

    Raises
    ------
    numpy.linalg.LinAlgError
        If there is none.
    """
    from scipy.linalg import solve_continuous_are

    slight = SLIGHT * np.linalg.norm(C, 2) ** 2 * np.eye(len(A))
    # without the cross term, which spoils it: u = v - R^-1 D'C x
    shift = np.linalg.solve(R, D.T @ C)
    moved, cost = A - B @ shift, C.T @ C - C.T @ D @ shift
    for Q in (cost, cost + slight):
        with suppress(np.linalg.LinAlgError, ValueError):
            P: Array = np.asarray(solve_continuous_are(moved, B, (Q + Q.T) / 2, R), dtype=float)
            closed = A - B @ np.linalg.solve(R, B.T @ P + D.T @ C)
            if np.linalg.eigvals(closed).real.max() < 0:
                return P
    raise np.linalg.LinAlgError("the Riccati equation has no stabilising solution")


def _mean_square(records: Array, weight: Stages | None, begin: int) -> Array:
    """Return the mean squares of records (loads, times) behind a weighting, nan of lost drives."""
    if weight is not None:
        whole, bare = np.isfinite(records).all(axis=1), records
        records = np.full(bare.shape, np.nan)
        if whole.any():
            records[whole] = weight.apply(bare[whole], STEP)
    return np.asarray(np.mean(records[:, begin:] ** 2, axis=1))
