"""The search for a law: its task, for shares of a region, within limits asked for and implied.

One W(alpha) for everything is conservative, so that neither the whole region nor the widest limits
give the best law. Each law that is found is judged as it is: by samples first, then by proofs of
region and limits. Limits on the inputs at what the best law needs, and somewhat more, exclude no
law that is better for it; they keep the next ones from being bought with effort.

Where nothing limits the law, what is minimised falls, or comes closer to its infimum, as gains grow
without bound. Poles that are bounded make the question one whose optimum is attained; a point some
way off the edge has a proof. Each step is the start of the next.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, pairwise

import numpy as np

from polefence.base.errors import InputError, NotProvedError, RegionError, SolverError
from polefence.certify.bounds import (
    Bound,
    Known,
    agreed_bound,
    best_bound,
    kept_bound,
    known_bound,
    own_evidence,
    sampled,
    with_held,
)
from polefence.certify.candidates import Deadline, edge
from polefence.certify.certificate import Certificate
from polefence.certify.counterexample import counterexample
from polefence.certify.evidence import certificate_of, placeholder
from polefence.certify.given import analysed
from polefence.law.laws import FixedGain, Law, ScheduledGain, right_divide
from polefence.lmi.conditions.methods import Method, options
from polefence.lmi.conditions.saturation import held_name
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve.interior_point import TOLERANCE
from polefence.lmi.solve.performance import Problem, least
from polefence.lmi.solve.scaling import Scaling, balanced
from polefence.lmi.solve.search import Reached, coefficients, singular_is_failure
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.lmi.solve.starts import regulators
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.outputs import inputs
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.region.regions import HalfPlane, Region, Sector, bounded, stable
from polefence.requirements.gain_norm import as_norms
from polefence.requirements.specification import Specification
from polefence.response.closed import close

INSIDE = 0.95  # how far inside the region the search begins
KEPT = 1 - 1e-5  # share of a limit that a design keeps, so that the proof has something to spare
AGREED = 1e-5  # how close two ends of one question are, as a share
ENDS = 2  # that are compared where they depend on the start
ROUGH = 0.1  # gap at which one gain is a start: well off the edge of everything
ROUNDED = 1e-9  # of the fastest pole: what rounding may move a pole by
SPEED = 100.0  # times the plant's own rates, where nothing else bounds the first law's

ROUNDS, FINEST = 5, 1 / 64  # of designs for shares of the region's parts; step of such a share
FINE = 2e-4  # a law outside the region that is better by less shows that nothing is to be gained
STEPS, BACK = 8, (1 / 32, 1 / 4)  # halvings between two laws; how far inside a proof is tried
SAMPLES = 200  # at which a law is judged before anything is proved of it
# Of designs for shares, by each method: after so much no further one is begun [multiplications, as
# iterations times cubes of the number of unknowns].
MOST_WORK = 2.5e11
SLIGHT = 1e-6  # a law that is better by less is not looked at further
WORTH = 2e-4  # the same of a round of implied limits
FINELY = 14  # halvings of a regulator's weight
SLOW = (1.0, 2.0, 4.0)  # times the plant's own speed
BAND, BANDS = 10.0, 8  # powers of two of the plant's own speed, and how many bands are tried
# Implied limits over what the best law needs, and how often each is taken from the law it led to.
ROOM, AGAIN = (2.0, 1.0), 3
BINDS = 1e-6  # by which implied limits raise a design's level at least, if they matter to it
COSTS = 0.01  # by which they raise the best law's worst sample at most, if they are to lead further
CALM = 10.0  # implied limits over what a law needs that nothing limited, for nearly what it reaches
# A law whose samples stay below this share of a limit is far from it; by which powers of two such
# limits are widened, and how many widths are tried.
FAR_FROM, WIDEST, WIDTHS = 0.9, 8.0, 5

Shares = tuple[float, ...]

SPEEDS = (1e1, 1e2, 1e3, 1e4)  # of poles, times the plant's own fastest
FASTEST = 1e5  # a law of faster poles is no law to be built
GAP = 1e-3  # how far from the optimum the search ends, relative to it
GAPS = (1e-3, 5e-3, 2e-2, 5e-2, 0.2)  # the same, where the region itself bounds the poles
CLOSE = 0.01  # a step that comes as near to the infimum as this share is near enough
FAR = 1.0  # a step that is farther is no answer
FALL = 2.0  # from step to step, of what falls without end


@dataclass(frozen=True, eq=False)
class Task:
    """Requirements and a region, with one Lyapunov matrix for everything."""

    plant: UncertainPlant
    minimise: Specification | None
    limits: tuple[Specification, ...]
    region: Region
    method: Method
    # the plant and the limits as they were asked for, before a law had states
    asked: tuple[UncertainPlant, tuple[Specification, ...]] | None = None
    # the parts of the region in words, as they were asked for
    words: tuple[str, ...] = ()

    @property
    def parts(self) -> dict[Region, str]:
        """The parts of the region, and each in words."""
        own = self.region.parts
        return dict(zip(own, self.words or map(str, own), strict=True))

    @property
    def domain(self) -> Domain:
        """The domain of alpha."""
        return Domain.of(options(self.method).on, len(self.plant.vertices))

    def as_noise(self, bandwidth: float) -> Task:
        """Return the task for rms values in place of gains: what one is small of, the other is too.

        A signal of gain g has, of white noise, an rms of about g times the root of the bandwidth it
        follows the noise in [rad/s].
        """
        limits = tuple(own.as_noise(bandwidth) for own in self.limits)
        least = self.minimise and self.minimise.as_noise(bandwidth)
        return replace(self, minimise=least, limits=limits)

    def question(self, region: Region | None) -> Problem:
        """Return the condition with one Lyapunov matrix for everything, signals without weights.

        With the filters' states the law that it gives would be one of these too.
        """
        o, plant = options(self.method), self.plant
        asked: list[tuple[Specification, float | None]]
        asked = [(s, None) for s in self.limits if s.of_signal]
        if self.minimise is not None and self.minimise.of_signal:
            asked.append((self.minimise, 1.0))
        found = ((s, s.unweighted().condition(plant, self.domain, unit)) for s, unit in asked)
        pairs = [(source, replace(output, name=s.title)) for s, (source, output) in found]
        pairs = [(s, replace(o, level=o.level * KEPT if o.fixed else o.level)) for s, o in pairs]
        sources = {source.name: source for source, _ in pairs}
        outputs = tuple(output for _, output in pairs)
        degree, elevation = int(o.degree), o.elevation
        values = tuple(sources.values())
        norms = as_norms(plant, self.limits, self.minimise)
        form = self.domain, degree, elevation, norms, float(plant.step), Motion.of(plant)
        return Problem(plant.A, plant.B, values, outputs, region, *form)

    @singular_is_failure()
    def reached(
        self,
        region: Region | None,
        tolerance: float = TOLERANCE,
        near: Reached | None = None,
        sure: bool = True,
    ) -> Reached:
        """Search for the law.

        Without bounds on the law itself the question is convex: an end whose duals say so, or that
        two searches come to, will do. With them it depends on the start: the best of a few is
        returned.

        Parameters
        ----------
        region : Region, optional
        tolerance : float
            Of the gap at which the search ends, relative to what is minimised.
        near : Reached, optional
            A point of this method and a narrower region, to start from.
        sure : bool
            Whether an end whose duals say nothing is compared with another.

        Raises
        ------
        SolverError
            If there is none, or nowhere to start.
        """
        scaling = balanced(self.plant.A, self.plant.B, typical_rate(self.plant.A))
        question = self.question(region)
        best: Reached | None = None
        held, ends = False, 0
        failure = SolverError("nowhere to start from")
        starts = self._starts(question, region, scaling)
        if near is not None:
            starts = chain([(near.values, near.t)], starts)
        for start, t in starts:
            try:
                found = least(question, start, scaling, tolerance, t)
            except SolverError as error:
                failure = error
                continue
            again = best is not None and best.converged and found.r >= best.r * (1 - AGREED)
            holds = self._holds(found, region)
            if best is None or (holds, -found.r) > (held, -best.r):
                best, held = found, holds
            if not holds:  # its r is of a W that doubles do not hold
                continue
            ends += 1
            ended = found.converged and not question.norms
            loose = not sure or tolerance > AGREED
            ended = ended and (again or loose or found.residual() <= AGREED)
            if self.minimise is None or ended or (question.norms and ends == ENDS):
                break
        if best is None:
            raise failure
        return best

    def _holds(self, found: Reached, region: Region | None) -> bool:
        """Whether the law of a point, as doubles have it, keeps the poles where its W puts them.

        Where the signals do not bound W it grows until its smallest directions are lost in
        rounding; the law that Z W^-1 then is in doubles is another.
        """
        try:
            law = self.law(found)
            loops = close(self.plant, law, np.eye(len(self.plant.vertices)), disturbed=False)
            poles = loops.poles()
        except (SolverError, InputError, np.linalg.LinAlgError):
            return False
        kept = region or stable(float(self.plant.step))
        return bool(np.all(kept.distance(poles) < ROUNDED * np.abs(poles).max()))

    def _starts(
        self, question: Problem, region: Region | None, scaling: Scaling
    ) -> Iterator[tuple[dict[str, Array], dict[str, float]]]:
        """Yield W and Z to start from, and what of W is a Lyapunov matrix, where that is known."""
        if int(options(self.method).degree):
            # what one gain reaches a scheduled law reaches too
            with suppress(SolverError):
                one = replace(self, method="quadratic").reached(region, ROUGH)
                yield self._as_scheduled(one.values), one.t
        else:
            for values in regulators(question, scaling):
                yield values, {}
        kept = region or stable(float(self.plant.step))
        for inside in dict.fromkeys((kept, bounded(kept, SPEED * typical_rate(self.plant.A)))):
            with suppress(SolverError):
                yield self._start(inside), {}

    def _as_scheduled(self, values: dict[str, Array]) -> dict[str, Array]:
        """Return one W and Z as those of a degree: all coefficients are equal."""
        count = self.domain.count(int(options(self.method).degree))
        return numbered("W", [values["W1"]] * count) | numbered("Z", [values["Z1"]] * count)

    def _start(self, inside: Region) -> dict[str, Array]:
        """Return W and Z of a law that keeps a region."""
        plant, goal, motion = self.plant, Around(inside), Motion.of(self.plant)
        start = smallest(plant.A, plant.B, goal, self.method, enough=INSIDE, motion=motion)
        if start.r >= 1:
            raise SolverError(f"no law of this method keeps {inside}")
        W, Z = coefficients(start.values, "W"), coefficients(start.values, "Z")
        return numbered("W", W) | numbered("Z", Z)

    @singular_is_failure()
    def law(self, found: Reached) -> Law:
        """Return the law of a point.

        Raises
        ------
        SolverError
            If W is singular in floats, or the law's numbers are none that doubles hold.
        """
        degree = int(options(self.method).degree)
        W, Z = coefficients(found.values, "W"), coefficients(found.values, "Z")
        try:
            if not degree:
                return FixedGain(right_divide(Z, W)[0])
            return ScheduledGain(W, Z, self.plant.parameters, degree, self.domain.sizes)
        except InputError as error:
            raise SolverError(str(error)) from error


def among(own: Specification, limits: Iterable[Specification]) -> bool:
    """Whether one is among others."""
    return any(own is each for each in limits)


def _widened(
    limits: Iterable[Specification], far: Sequence[Specification], times: float
) -> Iterator[Specification]:
    """Yield limits, some of them wider; none of those where they are infinite."""
    for own in limits:
        if not among(own, far):
            yield own
        elif np.isfinite(times):
            yield replace(own, at_most=(own.at_most or 0.0) * times)


def numbered(name: str, coefficients: Iterable[Array]) -> dict[str, Array]:
    """Return matrices under the names that a condition's variables have: W1, W2 and so on."""
    return {f"{name}{k}": matrix for k, matrix in enumerate(coefficients, 1)}


@dataclass(frozen=True, eq=False)
class Origin:
    """Origin of a law: the task of its design, and the point that was found."""

    task: Task
    found: Reached

    def known(self, law: Law, own: Specification) -> Known | None:
        """Return what the design itself says of a signal; None where that is nothing."""
        if not own.of_signal or any(own.filters):
            return None
        source = own.condition(self.task.plant, self.task.domain, 1.0)[0]
        t = self.found.t.get(f"t {source.name}", 0.0)
        if not t > 0 or (own.at_most is None and self.task.minimise is not own):
            return None
        W = coefficients(self.found.values, "W")
        evidence, prefix = own_evidence(law, W, t), held_name(own.title)
        if any(name.startswith(prefix) for name in self.found.values):
            held = coefficients(self.found.values, prefix)
            evidence = with_held(evidence, held / t, int(options(self.task.method).degree))
        return evidence, own.at_most or level_of(self.task, self.found)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law with proofs of the region and of all limits.

    Attributes
    ----------
    certificate : Certificate
    limits : tuple of Bound
    designed : Region, optional
        What of the region was asked of the design; None where stability alone was.
    estimate : float
        The worst sampled value of what is minimised; zero where nothing is.
    origin : Origin, optional
        Of a law that was found, not given.
    """

    certificate: Certificate
    limits: tuple[Bound, ...]
    designed: Region | None
    estimate: float
    origin: Origin | None = None

    def known(self, own: Specification) -> Known | None:
        """Return what the law's own design says of a signal, if anything."""
        return None if self.origin is None else self.origin.known(self.certificate.law, own)


@dataclass(frozen=True, eq=False)
class Point:
    """A law with what samples say of it.

    Attributes
    ----------
    origin : Origin
    law : Law
    shares : tuple of float
        Of the region's parts, that were asked of the design.
    estimate : float
    lost : tuple of int
        Parts of the whole region that a sampled pole is outside of.
    """

    origin: Origin
    law: Law
    shares: Shares
    estimate: float
    lost: tuple[int, ...]


class Search:
    """State of a search.

    Attributes
    ----------
    candidates : list of Candidate
    reasons : list of str
        Why designs failed.
    whole : Reached or None
        The point for the whole region within the limits as they were asked.
    """

    def __init__(
        self,
        task: Task,
        deadline: Deadline,
        proved: bool = False,
        refute: Callable[[], None] = lambda: None,
    ) -> None:
        self.task, self.deadline = task, deadline
        self.refute = refute  # ends a search, by an error, that no law can be found in
        self.proved = proved  # whether the bound on what is minimised must have a proof at once
        self.candidates, self.reasons = list[Candidate](), list[str]()
        self.whole: Reached | None = None
        self.point: Point | None = None  # of the best law
        # the best law of a search for shares, not proved yet, and the designs of that search
        self.waiting: Point | None = None
        self.designs = dict[Shares, Point | None]()
        self.floor = np.inf  # the least estimate of any law, within the region or not
        self.calm: tuple[Specification, ...] = ()  # limits on inputs that nothing else limits
        self.spent = Counter[Method]()  # work of designs
        # shares of the region that were enough, and the level of a design for none of it
        self.kept, self.free = self._ones, 0.0
        self.design = task  # without limits that cost one W much and bound no law
        self.alpha = self.places = seeded(task.plant, SAMPLES)

    def run(self) -> None:
        """Search until nothing more is gained."""
        self._slow()
        self._shares(self.task)
        if int(options(self.task.method).degree):
            self._shares(replace(self.design, method="quadratic"))
        self._regulators()
        self._noise()
        if not self.candidates:
            self._one_by_one()
        if self.task.minimise is not None:
            self._implied()

    def _regulators(self) -> None:
        """Judge the regulators that searches begin from: doubles may have lost one on the way."""
        if self._ended:
            return
        task, plant = replace(self.task, method="quadratic"), self.task.plant
        scaling = balanced(plant.A, plant.B, typical_rate(plant.A))
        with suppress(SolverError), singular_is_failure():
            for values in regulators(task.question(task.region), scaling, FINELY):
                start = Reached(r=np.inf, values=values)
                own = self._point(task, self._ones, start)
                if own is not None and not own.lost:
                    self._improves(own)

    @property
    def best(self) -> float:
        """The least estimate of a law that is proved, or waits for its proof."""
        waiting = np.inf if self.waiting is None else self.waiting.estimate
        return min([waiting, *(own.estimate for own in self.candidates)])

    def _slow(self) -> None:
        """Begin the search of a small gain where poles are slow: from fast ones it stays large."""
        task = self.task
        if task.minimise is None or task.minimise.of_signal or task.region.bounds_speed:
            return
        own = max(own_speed(task.plant), task.region.scale)
        for times in SLOW:
            if self.deadline.passed:
                return
            with suppress(SolverError, RegionError):  # so slow nothing is in the region
                slow = replace(task, region=bounded(task.region, times * own))
                found = slow.reached(slow.region)
                # of a smaller region the point is one for the whole
                self.whole = found if level_of(task, found) <= self.shared else self.whole
                point = self._point(slow, self._ones, found)
                if point is not None and not point.lost:
                    self._improves(point)

    def _shares(self, task: Task) -> None:
        """Try the region as it is, none of it, and shares between that turn out to be kept."""
        own = task is self.task
        if own or self.task.minimise is None:
            point = self._attempt(task, self._ones)
            if self.task.minimise is not None and point is not None:
                task = self.design = self._loosened(task, point)
            if relaxed(task.region, self._zeros) == task.region:
                return
        kept = self._halved(task, self._ones)
        self.kept = kept if own else self.kept
        if own and task is not self.task:
            # what kept a limit within the whole region may lose it within a share
            self._halved(self.task, self._ones)

    def _loosened(self, task: Task, point: Point) -> Task:
        """Return the task without limits that its law is far from, or with wider ones.

        One W pays for each limit, whether that bounds the law or not. Left out, or as wide as they
        may be, they are still kept by the law that is found, as samples have it.
        """
        level = level_of(task, point.origin.found)
        far = [own for own in task.limits if self._share(point.law, own) < FAR_FROM]
        # those on the law itself come first: with them the question is not convex
        for some in ([own for own in far if not own.of_signal], far):
            asked = [own for own in some if among(own, task.limits)]
            if asked and self.task.minimise is not None:
                task = self._wider(task, asked, level)
        return task

    def _wider(self, task: Task, far: Sequence[Specification], level: float) -> Task:
        """Return the task with some limits as wide as its law keeps them even so."""
        asked, best, costly = self.task.limits, task, False

        def breaks(power: float) -> bool:
            nonlocal best, costly
            if self.deadline.passed or self._is_long(task):
                return True
            wider = replace(task, limits=tuple(_widened(task.limits, far, 2.0**power)))
            own = self._designed(wider, self._ones)
            found = np.inf if own is None else level_of(wider, own.origin.found)
            costly = costly or own is None or not found >= level * (1 - WORTH)
            if own is None or any(self._share(own.law, each) > 1 for each in asked):
                return True
            if found <= level * (1 + WORTH):  # as if what bounds no law were not asked
                best = wider
                self._settled(own)
            return False

        if breaks(np.inf) and costly:
            edge(lambda power: breaks(-power), -WIDEST, 0.0, WIDTHS)
        return best

    def _share(self, law: Law, limit: Specification) -> float:
        """Return the worst sample of what is limited, as a share of its limit."""
        return self._worst(law, limit) / (limit.at_most or 1.0)

    def _halved(self, task: Task, kept: Shares, again: Shares = ()) -> Shares:
        """Look for the least shares of the region's parts that a law of the whole region keeps.

        Each part has its own: what a law loses of one says nothing of the others. ``kept`` are
        shares that are enough, to begin with. ``again`` are those of the best law, of a search
        within implied limits; it ends where these change nothing, or cost too much.
        """
        self.designs.clear()
        found, outside = self._bisected(task, kept, again, wait=True)
        waiting = self.waiting
        if not self._between(outside, waiting or self.point) and waiting is not None:
            self.waiting = None
            if not self._improves(waiting):
                self.designs[waiting.shares] = self._unproved(waiting)
                found, outside = self._bisected(task, kept, again, wait=False)
                self._between(outside, self.point)
        self.waiting = None
        return found

    def _bisected(
        self, task: Task, kept: Shares, again: Shares, wait: bool
    ) -> tuple[Shares, Point | None]:
        """Return shares that are enough, and a law outside the region to go back from.

        Where there is a law already, proofs can ``wait``: of the laws that sample within the region
        each is better than the last, and mostly only the proof of the best is needed.
        """
        low, high, shares = [*self._zeros], [*kept], self._zeros
        outside: Point | None = None
        for number in range(ROUNDS):
            if self._ended:
                return tuple(high), None
            if self._is_long(task):
                break
            if shares not in self.designs:
                self.designs[shares] = self._designed(task, shares)
            own = self.designs[shares]
            if own is not None and wait and self.candidates:
                self.waiting = own if self._is_to_prove(own) else self.waiting
            elif own is not None:
                own = self.designs[shares] = self._settled(own)
            if own is not None and not number and task is self.design:
                self.free = level_of(task, own.origin.found)
            if own is not None and again and self._is_idle(own, number):
                return tuple(high), None
            lost = own.lost if own is not None else ()
            if own is not None and lost:
                outside = own
                if self._is_slight(own):
                    break
            for k, share in enumerate(shares):
                if k in lost:
                    low[k], high[k] = share, high[k] if high[k] > share else 1.0
                else:
                    high[k] = share
            before, shares = shares, tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
            if again and lost and not number:
                shares = again
            if max(abs(a - b) for a, b in zip(shares, before, strict=True)) < FINEST:
                break
        return tuple(high), outside

    def _is_idle(self, own: Point, number: int) -> bool:
        """Whether a design within implied limits shows that they change nothing, or cost too much.

        Of none of the region first, then of as much of it as the best one.
        """
        if not number:
            return level_of(self.task, own.origin.found) <= self.free * (1 + BINDS)
        return number == 1 and own.estimate > self.best * (1 + COSTS)

    @staticmethod
    def _unknowns(task: Task) -> int:
        """Return the number of unknowns of a design."""
        n, m = task.plant.shape
        return task.domain.count(int(options(task.method).degree)) * (n * (n + 1) // 2 + m * n)

    def _is_long(self, task: Task) -> bool:
        """Whether a further design for shares takes more work than the others are worth."""
        return bool(self.candidates) and self.spent[task.method] > MOST_WORK

    @property
    def _ended(self) -> bool:
        """Whether nothing more is to be found: one law that is kept will do, or time is up."""
        return self.deadline.passed or (self.task.minimise is None and bool(self.candidates))

    def _between(self, outside: Point | None, best: Point | None) -> bool:
        """Try laws between one that loses the region and the best: they keep the limits too."""
        if outside is None or best is None or not outside.lost or self._is_slight(outside):
            return False

        def loses(share: float) -> bool:
            own = self._mixed(outside, best, share)
            with suppress(SolverError, InputError, np.linalg.LinAlgError):
                return own is None or bool(self._lost(own.task.law(own.found)))
            return True

        for back in BACK:
            _, high = edge(loses, 0.0, 1.0, STEPS)
            own = self._mixed(outside, best, high + back * (1 - high))
            shares = tuple(map(min, outside.shares, best.shares))
            point = None if own is None else self._point(own.task, shares, own.found)
            if point is None or point.lost:
                return False
            if self._improves(point):
                return True
        return False

    def _mixed(self, outside: Point, best: Point, share: float) -> Origin | None:
        """Return a point on the line from one to another; None where it is no law."""
        task = replace(self.task, method=best.origin.task.method)
        if outside.origin.task.method != task.method:
            return None
        found = mixed(task, outside.origin.found, best.origin.found, share)
        return None if found is None else Origin(task, found)

    def _attempt(self, task: Task, shares: Shares) -> Point | None:
        """Design for shares of the region's parts; prove what is better. None where no law is."""
        own = self._designed(task, shares)
        return None if own is None else self._settled(own)

    def _designed(self, task: Task, shares: Shares) -> Point | None:
        """Design for shares of the region's parts; None where no law is."""
        region = relaxed(task.region, shares)
        asked = task.limits is self.task.limits or task.limits is self.design.limits
        within = replace(task, limits=(*task.limits, *self.calm)) if asked else task
        try:
            found = within.reached(region, sure=shares == self._ones)
        except SolverError as error:
            self.reasons.append(str(error))
            if len(self.reasons) == 1:
                self.refute()
            return None
        self.spent[task.method] += found.iterations * self._unknowns(task) ** 3
        if asked and not self.calm and self._is_wild(task, found):
            self.calm = self._calming(task, region, found)
            if self.calm:
                return self._designed(task, shares)
        if self._is_whole(task) and region == task.region:
            self.whole = found if level_of(task, found) <= self.shared else self.whole
        return self._point(within, shares, found)

    def _is_whole(self, task: Task) -> bool:
        """Whether a task has all that was asked of signals: limits on the law itself need no W."""
        own = self.task
        every = all(among(limit, task.limits) for limit in own.limits if limit.of_signal)
        return every and task.minimise is own.minimise and task.method == own.method

    def _is_to_prove(self, own: Point) -> bool:
        """Whether samples say that a law keeps the region and is the best."""
        return not own.lost and self._is_better(own)

    def _settled(self, own: Point) -> Point:
        """Return a point after its proof, if it is to have one."""
        return self._unproved(own) if self._is_to_prove(own) and not self._improves(own) else own

    def _unproved(self, own: Point) -> Point:
        """Return a point without a proof: more of everything is asked for, or what a place says."""
        return replace(own, lost=self._lost(own.law) or tuple(range(len(own.shares))))

    def _is_wild(self, task: Task, found: Reached) -> bool:
        """Whether nothing but floats bounded a law."""
        try:
            return is_too_fast(task.plant, task.law(found))
        except (SolverError, InputError, np.linalg.LinAlgError):
            return True

    def _calming(
        self, task: Task, region: Region | None, found: Reached
    ) -> tuple[Specification, ...]:
        """Return limits on the inputs, well above the least with which nearly as much is reached.

        None where the law of least effort is still too fast.
        """
        own, plant = task.minimise, task.plant
        if own is None or not own.of_signal or not (own.vector or plant.shape[1] == 1):
            return ()
        size = np.diag(balanced(plant.A, plant.B, typical_rate(plant.A)).S)
        effort = tuple(
            replace(signal, D=[[d / size[k] for d in signal.D[0]]])
            for k, signal in enumerate(inputs(plant))
        )
        own = own.unweighted()
        least = replace(own.absolute(), signal=effort if len(effort) > 1 else effort[0])
        for share in (WORTH, CLOSE):
            kept = replace(own, at_most=level_of(task, found) * (1 + share))
            calmer = replace(task, minimise=least, limits=(*task.limits, kept))
            with suppress(SolverError, InputError):
                again = calmer.reached(region, GAP)
                if not self._is_wild(calmer, again):
                    return self._inputs(calmer.law(again), CALM)
        return ()

    def _point(self, task: Task, shares: Shares, found: Reached) -> Point | None:
        """Return a point with what samples say of its law; None where doubles hold none."""
        try:
            law = task.law(found)
        except SolverError as error:
            self.reasons.append(str(error))
            return None
        estimate = self._estimate(law)
        self.floor = min(self.floor, estimate)
        if task.minimise is self.task.minimise:  # doubles may lose what W promises
            self.floor = min(self.floor, level_of(task, found))
        try:
            lost = self._lost(law)
        except (InputError, np.linalg.LinAlgError):
            lost = tuple(range(len(task.region.parts)))
        return Point(Origin(task, found), law, shares, estimate, lost)

    def _is_better(self, own: Point) -> bool:
        """Whether a law samples better than the best, by what is worth a proof."""
        return not self.candidates or own.estimate < self.best * (1 - SLIGHT)

    def _improves(self, own: Point) -> bool:
        """Prove a law that samples better than the best, and take it; whether it was taken."""
        if not self._is_better(own):
            return False
        region = relaxed(self.task.region, own.shares)
        if region != self.task.region and self._leaves(own.law):
            return False
        # one that only parts of the box prove is looked at where there is no other
        alone = not self.candidates
        found = candidate(self.task, own.law, region, own.origin, own.estimate, alone)
        if found is None or not self._has_bound(found):
            return False
        self.point = own
        self.candidates.append(found)
        return True

    def _leaves(self, law: Law) -> bool:
        """Whether a place is found where a pole leaves the region; laws to come are sampled there.

        Laws between one that keeps the region and one that does not are mostly next to its edge.
        """
        plant, region = self.task.plant, self.task.region
        evidence = [placeholder(plant, law)] * len(region.parts)
        alpha: list[Fraction] | None = None
        with suppress(SolverError), singular_is_failure():
            alpha = counterexample(certificate_of(plant, law, region, evidence).claim())
        if alpha is None:
            return False
        self.places = np.vstack([self.places, np.array(alpha, dtype=float)])
        return True

    def _is_slight(self, own: Point) -> bool:
        """Whether a law that loses the region is hardly better than the best that keeps it."""
        return bool(self.candidates) and not own.estimate < self.best * (1 - FINE)

    def _lost(self, law: Law) -> tuple[int, ...]:
        """Return which parts of the region a pole is outside of, at samples."""
        poles = close(self.task.plant, law, self.places, disturbed=False).poles()
        parts = enumerate(self.task.region.parts)
        slight = ROUNDED * np.abs(poles).max()  # proofs decide
        return tuple(k for k, part in parts if not np.all(part.distance(poles) < slight))

    def _has_bound(self, own: Candidate) -> bool:
        least = self.task.minimise
        if least is None or not self.proved:
            return True
        law = own.certificate.law
        with suppress(SolverError), singular_is_failure():
            return best_bound(self.task.plant, law, least, own.known(least)) is not None
        return False

    @property
    def shared(self) -> float:
        """The bound that one W(alpha) proves for the whole region, infinite where there is none."""
        if self.task.minimise is None:
            return 0.0
        return np.inf if self.whole is None else level_of(self.task, self.whole)

    def _estimate(self, law: Law) -> float:
        own = self.task.minimise
        return 0.0 if own is None else self._worst(law, own)

    def _worst(self, law: Law, own: Specification) -> float:
        try:
            worst = sampled(self.task.plant, law, own, self.alpha).worst
        except (InputError, np.linalg.LinAlgError):
            return np.inf
        return worst if np.isfinite(worst) else np.inf

    def _noise(self) -> None:
        """Try laws for rms values in place of gains: one W for gains at once is far above them.

        The wider the band in which the limited signals may follow noise, the less is left of what
        is minimised: the widest in which samples keep the limits is looked for.
        """
        task = self.design
        if task.minimise is None or task.minimise.power != 1:
            return
        own = max(own_speed(task.plant), task.region.scale)
        one = replace(task, method="quadratic")
        limited = any(limit.power == 1 for limit in task.limits)

        def kept(power: float) -> bool:
            # in too narrow a band no law keeps the limits
            noisy = one.as_noise(own * 2.0**power)
            return self.deadline.passed or self._follows(noisy) is not False

        low, _ = edge(kept, -BAND, BAND, BANDS if limited else 1)
        if int(options(task.method).degree) and not self.deadline.passed:
            self._follows(task.as_noise(own * 2.0**low))

    def _follows(self, noisy: Task) -> bool | None:
        """Try the law of a band: whether its limits are kept; None where there is no law."""
        floor, found = self.floor, None
        with suppress(SolverError, InputError):  # noise itself is in the signal
            found = noisy.reached(self.task.region)
        own = None if found is None else self._point(noisy, self._ones, found)
        if own is None:
            return None
        if own.lost or not self._keeps_limits(own.law):
            self.floor = floor
            return False
        return self._improves(own) or not own.estimate < self.best

    @property
    def _ones(self) -> Shares:
        """Shares of the region as it is."""
        return (1.0,) * len(self.task.region.parts)

    @property
    def _zeros(self) -> Shares:
        """Shares of none of it."""
        return (0.0,) * len(self.task.region.parts)

    def _keeps_limits(self, law: Law) -> bool:
        """Whether samples keep the limits."""
        limits = self.task.limits
        return all(self._worst(law, own) <= (own.at_most or 0.0) for own in limits)

    def _one_by_one(self) -> None:
        """Minimise each of the limits within the others: that may lead where all at once do not."""
        for own in self.task.limits:
            others = tuple(s for s in self.task.limits if s is not own)
            least = replace(self.task, minimise=replace(own, at_most=None), limits=others)
            for share in (1.0, 0.0):
                self._attempt(least, (share,) * len(self.task.region.parts))
                if self.candidates or self.deadline.passed:
                    return

    def _implied(self) -> None:
        """Design again within limits on the inputs, about what the best law needs."""
        for room in ROOM:
            for _ in range(AGAIN):
                before = self.best
                # where the region costs nothing there is nothing to be gained
                over = self.deadline.passed or self._is_long(self.task)
                if over or not self.floor * (1 + WORTH) < before < np.inf:
                    return
                more = self._inputs(self._best_law, room)
                if not more:
                    return
                shares = self._ones if self.point is None else self.point.shares
                within = replace(self.design, limits=(*self.design.limits, *more))
                self._halved(within, self.kept, shares)
                if not self.best < before * (1 - WORTH):
                    break

    @property
    def _best_law(self) -> Law | None:
        """The law of the least estimate."""
        best = [own for own in self.candidates if own.estimate <= self.best]
        return best[-1].certificate.law if best else None

    def _inputs(self, law: Law | None, room: float) -> tuple[Specification, ...]:
        """Return limits on the inputs, of the kind of what is minimised, about a law's."""
        own = self.task.minimise
        if own is None or law is None or not own.of_signal:
            return ()
        own, found = own.absolute().unweighted(), []  # without control an input has no rms
        for signal in inputs(self.task.plant):
            like = own.of(replace(signal, name=f"{signal.name}, implied"))
            worst = self._worst(law, like)
            if 0 < worst < np.inf:
                found.append(replace(like, at_most=room * worst))
        return tuple(found)


def candidate(
    task: Task,
    law: Law,
    designed: Region | None,
    origin: Origin | None = None,
    estimate: float = 0.0,
    halved: bool = True,
) -> Candidate | None:
    """Return proofs of the region and of the limits of a task; None where there is not each.

    With ``halved`` the region is proved in parts of the box too, where it is not on the whole.
    """
    limits: list[Bound] = []
    with suppress(SolverError), singular_is_failure():
        certificate = _region(task, law, designed, origin, halved)
        if certificate is None:
            return None
        own = Candidate(certificate, (), designed, estimate, origin)
        for limit in task.limits:
            # of the certificate's law: its alpha may live on another domain than the search's
            bound = kept_bound(task.plant, certificate.law, limit, own.known(limit))
            # of a law that doubles cannot evaluate a proof is of no use
            if bound is None or agreed_bound(task.plant, certificate.law, bound) is None:
                return None
            limits.append(bound)
        return replace(own, limits=tuple(limits))
    return None


def mixed(task: Task, one: Reached, other: Reached, share: float) -> Reached | None:
    """Return a point between two of one question: all of them make a convex cone.

    None where nothing says how large one is beside the other.
    """
    names = [f"t {source.name}" for source in task.question(None).sources]
    if not names or not (one.t.get(names[-1], 0.0) > 0 and other.t.get(names[-1], 0.0) > 0):
        return None
    a, b = (1 - share) / one.t[names[-1]], share / other.t[names[-1]]
    pairs = ((key, X, other.values.get(key)) for key, X in one.values.items())
    values = {key: a * X + b * Y for key, X, Y in pairs if Y is not None}
    t = {key: a * one.t[key] + b * other.t[key] for key in names if key in one.t and key in other.t}
    r = (1 - share) * one.r + share * other.r
    return Reached(r=r, values=values, t=t, converged=True)


def relaxed(region: Region, shares: Shares) -> Region | None:
    """Return a region with shares of its parts' decay and damping; None for none of it."""
    kept: Region | None = None
    for part, share in zip(region.parts, shares, strict=True):
        own: Region = part
        if isinstance(part, HalfPlane) and share < 1:
            own = HalfPlane(part.decay * share if part.decay > 0 else part.decay)
        elif isinstance(part, Sector) and share < 1:
            if not share:
                continue
            own = Sector(part.damping * share)
        kept = own if kept is None else kept & own
    return kept


def _region(
    task: Task, law: Law, designed: Region | None, origin: Origin | None, halved: bool
) -> Certificate | None:
    """Prove the region with the law's own W where it was asked of it, else as of a given law."""
    if designed == task.region and origin is not None:
        own = _own_region(task, law, origin)
        if own is not None:
            return own
    looked = origin is not None and designed != task.region
    answer = analysed(task.plant, law, task.region, Deadline(None), halved, looked)
    return answer.certificate if answer.proved else None


def _own_region(task: Task, law: Law, origin: Origin) -> Certificate | None:
    """Prove the region with the law's own W; None where that is no proof."""
    elevation = options(origin.task.method).elevation
    name, evidence = "scheduled", {"tau": np.array(0.0), "elevation": elevation}
    if law.W is None:
        name, evidence = "quadratic", {"W": origin.found.values["W1"]}
    own = Certificate(task.plant, task.region, name, law, evidence)
    return own if own.holds() else None


def together(task: Task, law: Law, origin: Origin) -> tuple[Certificate, tuple[Bound, ...]] | None:
    """Prove region, what is minimised and all limits with the law's own W alone.

    Returns
    -------
    pair of Certificate and bounds, optional
        What is minimised comes first; None where the one W does not prove each of them.
    """
    asked = () if task.minimise is None else (task.minimise,)
    found: list[Bound] = []
    with suppress(SolverError), singular_is_failure():
        certificate = _own_region(task, law, origin)
        if certificate is None:
            return None
        for own in (*asked, *task.limits):
            bound = _alone(task, law, own, origin)
            agreed = None if bound is None else agreed_bound(task.plant, law, bound)
            if agreed is None:
                return None
            found.append(agreed)
        return certificate, tuple(found)
    return None


def _alone(task: Task, law: Law, own: Specification, origin: Origin) -> Bound | None:
    """Prove one specification with the law's own W; a bound on the law itself needs none."""
    if not own.of_signal:
        prove = best_bound if own.at_most is None else kept_bound
        return prove(task.plant, law, own)
    known = origin.known(law, own)
    return None if known is None else known_bound(task.plant, law, own, known)


@dataclass(frozen=True, eq=False)
class Step:
    """A law for poles that are bounded.

    Attributes
    ----------
    speed : float
        The largest magnitude of poles that was allowed [1/s].
    found : Reached
    level : float
        Of what is minimised, as one Lyapunov matrix for everything has it; zero where nothing is.
    """

    speed: float
    found: Reached
    level: float


@dataclass(frozen=True)
class Retreat(Short):
    """Distance of a law from an infimum.

    Attributes
    ----------
    speed : float
        The largest magnitude of poles that the design allowed [1/s]; infinite where it is the
        region that bounds it.
    level, least : float
        What the search found with one Lyapunov matrix for everything, in floats: at the step that
        was taken, and the least without a bound on the poles, or at any step.
    """

    speed: float
    level: float
    least: float

    @property
    def share(self) -> float:
        """Height of the step above the least, as a share of it."""
        return self.level / self.least - 1


def level_of(task: Task, found: Reached) -> float:
    """Return the bound on what is minimised that a point has in floats; zero where nothing is."""
    if task.minimise is None:
        return 0.0
    return task.minimise.level(found.r)


def own_speed(plant: UncertainPlant) -> float:
    """Return the largest magnitude of the vertices' poles without a law [1/s]; one if all are 0."""
    return float(np.abs(np.linalg.eigvals(plant.A)).max()) or 1.0


def is_too_fast(plant: UncertainPlant, law: Law) -> bool:
    """Whether poles at the vertices are so fast that nothing but floats bounded them."""
    poles = close(plant, law, np.eye(len(plant.vertices)), disturbed=False).poles()
    return bool(np.abs(poles).max() > FASTEST * own_speed(plant))


def steps(task: Task) -> Iterator[Step]:
    """Yield laws for faster and faster poles; farther and farther from the edge of a region."""
    if task.region.bounds_speed:
        for gap in GAPS:
            try:
                found = task.reached(task.region, gap)
            except SolverError:
                continue
            yield Step(np.inf, found, level_of(task, found))
        return
    near: Reached | None = None
    own = max(own_speed(task.plant), task.region.scale)
    for factor in SPEEDS:
        try:
            near = task.reached(bounded(task.region, factor * own), GAP, near)
        except (SolverError, RegionError):
            continue
        yield Step(factor * own, near, level_of(task, near))


def is_falling(taken: Sequence[Step]) -> bool:
    """Whether what is minimised falls without end as poles are allowed to be faster."""
    return len(taken) > 1 and all(a.level > FALL * b.level for a, b in pairwise(taken))


def unbounded(task: Task, taken: Sequence[Step]) -> NotProvedError:
    """Return that no law is best, and what would make one so."""
    own = task.minimise
    what = "" if own is None else own.title
    levels = ", ".join(f"{step.level:.3g} for poles up to {step.speed:.2g} 1/s" for step in taken)
    return NotProvedError(
        f"unbounded: {what} falls without end as the law grows ({levels}); limit the gain, the "
        "input or the actuator: add a limit on the gain norm, on the rms or gain of an input, or a "
        "region that bounds the poles, such as a disk"
    )
