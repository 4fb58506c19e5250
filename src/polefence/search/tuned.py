"""Laws of a structure that are searched directly, then proved as any law that is given.

A law at the edge of its limits has no proof: they are asked for somewhat tighter, and tighter still
where the law that is found has none. Of an input that is cut off, the search limits the peak that
it would have otherwise, to less and less. What is proved are limits and region as asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.effort import MOST_WORK, bounded, ended
from polefence.certify.bounds import sampled
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.region.regions import HalfPlane, Region, stable
from polefence.requirements.specification import Specification
from polefence.search.task import Candidate, Missing, Task, candidate, withstands_rounding
from polefence.search.tune.dynamic import beside_filters, filtered, observers
from polefence.search.tune.tuner import Tuned, rough, tune
from polefence.search.tune.worth import NEAR, promising

# How much tighter limits and region are asked for than they are to be proved, one after the other.
# The shown car loses 1.4 times the share: 1.02079 with 2e-5, 1.02147 with 5e-4.
TIGHTER = (2e-5, 5e-4, 3e-3, 2e-2)
# Then, where nothing is proved: proofs of limits may be that loose; and where parameters move, as
# the search looks at loops at rest.
FARTHER = (8e-2, 0.25)
FOR_STATES = 2  # which share gives a law's own states room for proofs
# The same of limits that one Q proves for periods of any length: of a van at 2 ms, 20 % more or
# less, one took more than 20 parts of the box with the share before.
FOR_CLOCKS = 3
# Periods from which on it is the next share, where they jitter: of a van at 2 ms with 20 % and a
# lost sample one had no proof in 64 parts with the same share, with the next it takes 7.
LONG = 2
LEAST_WIDER = 1 / 16  # of a clock's jitter, what a law that bears less of it is asked to bear next
SHARES = (*TIGHTER, *FARTHER)
# Of what an input that is cut off would go to, in the search after one whose law has no proof. The
# least rms of a pendulum's one gain is 0.0168 with it, 0.0201 with 4, 2 and 1 times the limit.
LESS = 0.75
BEGINNING = 4.0  # times its limit, in laws to start from
MOST = 3  # laws of one search that proofs are looked for
# Of the work of a search, that on laws with states to start from: unbounded they took two thirds of
# it for a full car with eight sensors; with 5 % still 12 s of 130.
MOST_STARTS = 0.02
EACH = 6  # orders that are searched one after the other; of a higher one these and the last


def tuned_candidates(
    task: Task,
    structure: Structure,
    starts: Sequence[Law] = (),
    known: Sequence[Tuned] = (),
    wanted: Callable[[Tuned], float] = lambda _: np.inf,
) -> Iterator[tuple[Candidate, Tuned, float]]:
    """Yield laws with proofs of region and limits, found for tighter and tighter requirements.

    With each comes what its search says of it, and the least level that its search found.

    Parameters
    ----------
    known : sequence of Tuned
        What the first search has found, where it is done.
    wanted : callable
        From what a search found to the level below which its law is wanted: one that is no better
        at rest is not looked at.
    """
    asked_for = (*task.limits, *([task.minimise] if task.minimise else ()))
    cut_off = any(specification.cut_off(task.plant) for specification in asked_for)
    some, times = False, np.inf if cut_off else 1.0
    while times:
        best: Tuned | None = None
        room, lost, fragile = Room.first(task.plant), 0, list[tuple[Tuned, float]]()
        while room.region < len(SHARES) and room.limits < len(SHARES):
            if ended() and not known:  # what is found is looked at whatever it took to find
                break
            if max(room.region, room.limits) >= len(TIGHTER) and some and not task.plant.moving:
                break
            candidates = [] if cut_off else list(known)
            candidates = candidates or _searched(task, structure, room, times, starts)
            known = ()
            best = best or next((tuned for tuned in candidates if tuned.kept), None)
            lost += not any(tuned.kept for tuned in candidates)
            if lost > 1:  # what is tighter is no easier, and the second began where the first ended
                break
            missing: Missing | None = None
            for number, tuned in enumerate(_promising(candidates)):
                if number and ended():
                    break
                # descents end so near one another
                if task.minimise is not None and tuned.level >= wanted(tuned) * (1 - 1e-5):
                    if number or cut_off:
                        break
                    return  # nor is one for tighter limits
                if not withstands_rounding(task, tuned.law):
                    fragile.append((tuned, candidates[0].level))
                    missing = missing or Missing.REGION
                    continue
                law = candidate(task, tuned.law)
                if isinstance(law, Missing):
                    missing = missing or law
                    continue
                some = True
                yield law, tuned, candidates[0].level
            starts = (*starts, *(tuned.law for tuned in candidates[:1]))
            after = room.after(missing, task.plant)
            if after.region == room.region and not _asked(task, room, times)[1]:
                break  # the same again: what no limit that is asked for stands for is not proved
            room = after
        for tuned, level in () if some else fragile:
            law = candidate(task, tuned.law)
            if not isinstance(law, Missing):
                some = True
                yield law, tuned, level
        times = _less_far(task, times, best)


def _less_far(task: Task, times: float, best: Tuned | None) -> float:
    """Return how far beyond its limit an input that is cut off may go in the next search.

    Parameters
    ----------
    times : float
        Of its limit, in the last search.
    best : Tuned, optional
        The law that it found; without one there is no next, and zero is returned.
    """
    if best is None or times <= 1:
        return 0.0
    if times == np.inf:
        asked = [limit for limit in task.limits if limit.cut_off(task.plant)]
        alpha = np.eye(len(task.plant.vertices))
        times = max(
            (
                float(sampled(task.plant, best.law, peak, alpha).worst / peak.at_most)
                for limit in asked
                for peak in limit.tuned(1.0)
                if peak.at_most
            ),
            default=0.0,
        )
    return max(1.0, LESS * times) if times > 1 else 0.0


@dataclass(frozen=True)
class Room:
    """How much tighter the region and the limits are asked for: which of the shares."""

    region: int = 0
    limits: int = 0

    @classmethod
    def first(cls, plant: UncertainPlant) -> Room:
        """Return the first: the rounding of code in float32 takes some of the region's room.

        With the first share a law of states of its own left it a seventh of what it takes at 1 ms;
        with the second four times as much, and the shown rides cost the same to 1e-5.

        A remainder costs limits 2e-4 to 2e-3 on the van at 2 ms. One polynomial of all samples has
        proofs with the second share: the shown active suspension at 2 ms costs 0.16 % more with the
        third. Of samples between nodes proofs of limits take fewer parts with the third: of a van
        at 2 ms two thirds of the time, of a full car with eight sensors at 5 ms 4 parts for 32. Of
        their laws without states one costs 0.1 % more, the other 1.7 % less; the van's of order 2
        costs 0.3 % less.

        A law's own state lets a pole come as near the edge as is asked for, at one corner: the
        nearer, the more parts of the box take the proofs of samples between nodes. The van's poles
        at 2 ms are proved in 244 parts where they decay by 8e-4 1/s, 13 by 0.046 (the second
        share), 4 by 0.28 (the third), its limits in 16 and 5; the level is 0.7890 and 0.7885. The
        shown active suspension at 2 ms, whose samples are of one polynomial, bears 0.9 of what
        float32 takes with the second share, and all of it with the third; its level is 1.11731 with
        both.
        """
        slow = plant.period > 0 and own_states(plant) > 0
        limits = 0 if plant.remainder is None else 2 if plant.bent else 1
        clock = None if plant.sampling is None else plant.sampling.clock
        if clock is not None:
            limits = FOR_CLOCKS + (clock.jitters and clock.most >= LONG)
        return cls(FOR_STATES if slow else 1, limits)

    def after(self, missing: Missing | None, plant: UncertainPlant) -> Room:
        """Return more room for what the best law had no proof of; for both where it had all.

        Limits may have none for a slow pole of the law's own. A quarter car of five parameters with
        two sensors, order 2, had no proof of 30 mm for a deflection of 17 mm with the first shares
        of its region, and has a law of 0.744 m/s2 with the next.
        """
        slow = own_states(plant) > 0 and self.region < FOR_STATES
        return Room(
            self.region + (missing is not Missing.LIMIT or slow),
            self.limits + (missing is not Missing.REGION),
        )


def _searched(
    task: Task, structure: Structure, room: Room, times: float, starts: Sequence[Law]
) -> list[Tuned]:
    """Return what a search finds, with poles as fast as proofs need them where it can have them."""
    least, limits, plain = _asked(task, room, times)
    region = plain
    if room.region:  # a pole at the very edge of stability had no proof
        region = _asked(task, room, times, typical_rate(task.plant.A))[2]
    candidates = list[Tuned]()
    for wanted in dict.fromkeys(filter(None, (_faster(task.plant, region), region, plain))):
        candidates = _by_clocks(task.plant, structure, (least, limits, wanted), starts)
        if any(tuned.kept for tuned in candidates):
            break
    return candidates


def _by_clocks(
    plant: UncertainPlant,
    structure: Structure,
    asked: tuple[Specification | None, tuple[Specification, ...], Region],
    starts: Sequence[Law],
) -> list[Tuned]:
    """Return what a search finds; of a clock that jitters, for more and more of that.

    Most laws have no Q for all periods; those for a perfect clock, or for less jitter, lead there.
    """
    sampling = plant.sampling
    if sampling is None or sampling.clock is None:
        return tune(plant, structure, *asked, starts)

    def bearing(share: float, known: Sequence[Law]) -> list[Tuned]:
        clock = sampling.clock.some(Fraction(share)) if sampling.clock else None
        some = replace(plant, sampling=replace(sampling, clock=clock))
        return tune(some, structure, *asked, known, alone=share > 0)

    found = bearing(1.0, starts) if starts else []
    if any(tuned.kept for tuned in found):
        return found
    found = bearing(0.0, starts)
    borne, wider = 0.0, 1.0
    while borne < 1 and any(tuned.kept for tuned in found):
        share = min(1.0, borne + wider)
        more = bearing(share, [tuned.law for tuned in found if tuned.kept][:MOST])
        if any(tuned.kept for tuned in more):
            found, borne = more, share
        elif wider <= LEAST_WIDER:
            break
        else:
            wider /= 2
    return found if borne == 1 else []


def _faster(plant: UncertainPlant, region: Region) -> Region | None:
    """Return a region of poles that are faster than parameters move, None where none does.

    A search looks at loops at rest. What it says of a mode that is slower than the parameters has
    no proof, and no meaning, while they move.
    """
    speeds = [
        float(max(map(abs, parameter.rate)) / (parameter.high - parameter.low))
        for parameter in plant.moving
        if isinstance(parameter.rate, tuple)
    ]
    if not speeds or plant.period:
        return None
    return region & HalfPlane(max(speeds))


def _promising(candidates: Sequence[Tuned]) -> Iterator[Tuned]:
    kept = [tuned for tuned in candidates if tuned.kept]
    for tuned in kept[:MOST]:
        if tuned.level <= promising(kept[0].level):
            yield tuned


def orders_below(structure: Structure) -> list[int]:
    """Return the orders of searches up to one: each from the first on, of high ones the last alone.

    The first is zero, or one for laws that are strictly proper.
    """
    order, pattern = structure.order, structure.pattern
    free = pattern is None or any(entry != "0" for row in pattern for entry in row)
    below = range(0 if free else 1, min(order, EACH) + 1)
    return [*below, *([order] if order > EACH else [])] or [order]


class Orders:
    """Laws of growing order, each search beginning at the laws of the order before.

    These have states more there that are not used, so that no order is worse than one below it.

    Parameters
    ----------
    bare : Task
        Of the plant without the law's own states.
    structure : Structure
        With the highest order.
    problems : sequence of pairs of Task and Structure
        For each of the orders: of the larger plant, and of the law's gain there.
    orders : sequence of int, optional
        By default `orders_below`.
    most : float, optional
        The work of each order's search; by default they share that of one.

    Attributes
    ----------
    cut : bool
        Whether the search of an order stopped at its share of the work.
    """

    def __init__(
        self,
        bare: Task,
        structure: Structure,
        problems: Sequence[tuple[Task, Structure]],
        orders: Sequence[int] | None = None,
        most: float | None = None,
    ) -> None:
        self.bare, self.structure, self.problems = bare, structure, problems
        self.orders = orders_below(structure) if orders is None else list(orders)
        self.most = MOST_WORK / len(self.orders) if most is None else most
        self.cut = False
        self.known = dict[int, list[Law]]()  # laws to start from besides
        self._tuned = dict[int, list[Tuned]]()
        self._starts = dict[int, list[Law]]()

    def tuned(self, k: int) -> list[Tuned]:
        """Return what searches of the k-th order find for tighter limits, the best first."""
        if k not in self._tuned:
            starts = self.starts(k)  # of the orders below first
            with bounded(self.most) as effort:
                candidates = _tuned(*self.problems[k], starts)
            self.cut = self.cut or effort.ended
            self._tuned[k] = [tuned for tuned in candidates if tuned.kept]
        return self._tuned[k]

    @property
    def least(self) -> float:
        """The least level of any order; infinite where no law was found that keeps everything."""
        every = [tuned.level for k in range(len(self.problems)) for tuned in self.tuned(k)]
        return min(every, default=np.inf)

    @property
    def promising(self) -> Iterator[int]:
        """Orders that proofs are looked for: the lowest that is as good as any, then from the top.

        From the lowest on where nothing is minimised. Of orders below the last those alone that
        have a law.
        """
        last = len(self.problems) - 1
        orders = (k for k in range(last + 1) if k == last or self.tuned(k))
        if self.problems[0][0].minimise is None:
            yield from orders
            return
        every = list(orders)
        near = self.least + NEAR * abs(self.least)
        first = next(
            (k for k in every if any(tuned.level <= near for tuned in self.tuned(k))), None
        )
        yield from [] if first is None else [first]
        yield from (k for k in reversed(every) if k != first)

    def starts(self, k: int) -> list[Law]:
        """Return laws of the k-th order to start from: of one below, known, filters, observers."""
        if not self.orders[k]:
            return self.known.get(k, [])
        if k not in self._starts:
            known = list[Law]()
            if k:
                (task, _), (before, gain) = self.problems[k], self.problems[k - 1]
                laws = (
                    beside_filters(tuned.law, before.plant, task.plant, gain, task.region)
                    for tuned in self.tuned(k - 1)
                )
                known = [law for law in laws if law is not None]
            structure = replace(self.structure, order=self.orders[k])
            beside = self.known.get(k, [])
            self._starts[k] = [*known, *beside, *_with_states(self.bare, structure)]
        return self._starts[k]


def _tuned(task: Task, structure: Structure, starts: Sequence[Law]) -> list[Tuned]:
    """Return what searches of each degree find, from the lowest on; the best first."""
    candidates = list[Tuned]()
    for lower in (*lower_degrees(task.plant, structure), structure):
        known = (*starts, *(tuned.law for tuned in candidates[:1] if tuned.kept))
        more = _searched(task, lower, Room.first(task.plant), BEGINNING, known)
        candidates = sorted(
            [*candidates, *more[:MOST]], key=lambda tuned: (not tuned.kept, tuned.level)
        )
    return candidates[:MOST]


def embedded(
    plant: UncertainPlant,
    problem: tuple[Task, Structure],
    order: int,
    below: Sequence[tuple[Structure, Law]],
) -> list[Law]:
    """Return laws of poorer structures as ones of an order: a lower one's has filters beside it.

    Parameters
    ----------
    plant : UncertainPlant
        Without the law's own states.
    problem : pair of Task and Structure
        Of the plant with them, and of the law's gain there.
    """
    laws = list[Law]()
    for poorer, law in below:
        if poorer.order == order:
            laws.append(law)
            continue
        before, gain = poorer.extended(plant)
        wider = beside_filters(law, before, problem[0].plant, gain, problem[0].region)
        laws += [] if wider is None else [wider]
    return laws


def lower_degrees(plant: UncertainPlant, structure: Structure) -> Iterator[Structure]:
    """Yield a structure with lower degrees, from one gain on."""
    if structure.degree and structure.schedule != () and len(plant.vertices) > 1:
        yield replace(structure, schedule=())
        yield from (replace(structure, degree=k) for k in range(1, structure.degree))


def _with_states(task: Task, structure: Structure) -> Iterator[Law]:
    """Yield laws of an order, of limits that are somewhat tighter: to start from."""
    plant = task.plant
    asked = _asked(task, Room.first(task.plant), BEGINNING)
    least, limits, region = asked
    with bounded(MOST_WORK * MOST_STARTS):
        if structure.order == 1:  # of more states the laws of the order below are no worse
            yield from filtered(plant, structure, *asked)
        whole = rough(plant, Structure(schedule=()), *asked)
    wanted = list(limits)
    if least is not None:
        most = None if whole is None else whole.level
        wanted.append(replace(least, at_most=most))
    known = () if whole is None else (whole.law,)
    yield from observers(plant, structure, wanted, region, known)


def _asked(
    task: Task, room: Room, times: float, rate: float = 0.0
) -> tuple[Specification | None, tuple[Specification, ...], Region]:
    """Return what is minimised in a search, its limits and its region, somewhat tighter.

    Where that is stability, poles decay by the same share of a rate.
    """
    least = None if task.minimise is None else next(iter(task.minimise.tuned(1.0)))
    limits = tuple(
        specification
        if specification.at_most is None
        else replace(specification, at_most=specification.at_most * (1 - SHARES[room.limits]))
        for limit in (*task.limits, *(least.presumed if least else ()))
        for specification in limit.tuned(times)
    )
    edge = stable(float(task.plant.step))
    return least, limits, task.region.tighter(SHARES[room.region], edge, rate)
