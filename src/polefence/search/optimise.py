"""A law for specifications: one signal small, others within limits, all poles in a region; proved.

One W(alpha) for everything is conservative: it pays for the region and for each limit, whether that
bounds the law or not. So its law is one start of a search in the numbers of laws as free; what that
ends at is proved as it is, each bound and each part of the region with a Lyapunov polynomial of its
own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from polefence.base.effort import MOST_PROVING, MOST_WORK, bounded, ended
from polefence.base.errors import (
    InputError,
    NotProvedError,
    PolefenceError,
    SolverError,
    require_type,
)
from polefence.base.explained import explained
from polefence.base.processors import small_matrices
from polefence.base.progress import stage
from polefence.certify.bounds import Bound, agreed_bound, best_bound, save
from polefence.certify.candidates import Deadline
from polefence.certify.checks import (
    in_time_of,
    is_optimisable,
    is_stability,
    require_domain,
    require_moderate,
    require_movable,
    require_optimisable,
    require_region,
    stable_region,
)
from polefence.certify.decays import proved_decay
from polefence.certify.design import Design
from polefence.certify.measured import require_detectable
from polefence.certify.refutation import Refutation, least_of_any
from polefence.law.laws import Law
from polefence.law.structure import Structure
from polefence.lmi.conditions.methods import Method, Scheduled, options
from polefence.lmi.solve.search import singular_is_failure
from polefence.plant.card import card
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.weights import measurable
from polefence.proof.claims.decay import Decay
from polefence.proof.claims.gain_norm import BoundClaim
from polefence.proof.short import Short
from polefence.region.regions import Region, stable
from polefence.region.z_plane import delta_plane
from polefence.requirements.named import by_name
from polefence.requirements.specification import Specification
from polefence.search.conflict import refusal, refuted
from polefence.search.effort import Closer, calmer, gain_of, is_too_fast, least
from polefence.search.proper import proper, whitened
from polefence.search.structured import as_sampled
from polefence.search.task import Candidate, Missing, Task, candidate, level_of, together
from polefence.search.tune.tuner import Tuned
from polefence.search.tune.worth import NEAR, up_to
from polefence.search.tuned import Orders, embedded, orders_below, tuned_candidates


@dataclass(frozen=True, eq=False, repr=False)
class Optimised(Short):
    """A law with a proof of its region, and of every specification.

    Attributes
    ----------
    design : Design
        Law, region and its certificate.
    bounds : tuple of Bound
        The one that was minimised first, where one was.
    shared : float
        What is proved, in exact arithmetic, with one Lyapunov matrix for everything, of a law
        that was found for the region as it is; infinite where nothing is, zero where nothing was
        minimised.
    designed : Region
        What was asked of the design.
    cut : str
        Why the search was cut before its end; empty where it was not.
    structure : Structure, optional
        Of a law that was tuned; None of one that an LMI gave.
    bounded_by : str
        What stopped the gain of a tuned law from growing further; empty where nothing had to.
    closer : Closer, optional
        What a law would cost whose bound is less by a thousandth at most, where one was found.
    decay : Decay, optional
        How fast the loop decays for periods in any order, as `Analysis` has it.
    question : tuple, optional
        The plant without states of a law, what was minimised, and the limits.
    """

    design: Design
    bounds: tuple[Bound, ...]
    shared: float
    designed: Region
    cut: str = ""
    structure: Structure | None = None
    bounded_by: str = ""
    closer: Closer | None = None
    decay: Decay | None = None
    question: tuple[UncertainPlant, Specification | None, tuple[Specification, ...]] | None = None

    def __repr__(self) -> str:
        return f"<Optimised {self.plant.name!r}: {'; '.join(map(str, self.bounds))}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        bounds = [("proved", str(bound)) for bound in self.bounds]
        rows = [*bounds, ("poles", f"proved: in {self.design.region}")]
        return card(self.plant.name, rows, self.design.plot().small)

    @property
    def plant(self) -> UncertainPlant:
        """The plant family."""
        return self.design.plant

    @property
    def law(self) -> Law:
        """The control law."""
        return self.design.law

    @property
    def claims(self) -> tuple[BoundClaim, ...]:
        """What is claimed beside the region: each bound, and the decay."""
        decay = () if self.decay is None else (self.decay,)
        return (*(bound.claim for bound in self.bounds), *decay)

    @cached_property
    def limit_of_any_law(self) -> Refutation | None:
        """What no law goes below, proved at one vertex of the family; None where that is not known.

        The first of its ``specifications`` has it as ``at_most``, of laws within the others, of any
        order, whatever they measure but, of an rms, white noise itself. Known where an rms or a
        gain is minimised of a plant of up to 30 states without functions of its parameters and dead
        times, in continuous time or, of samples, behind them. Looked for when it is first asked
        for.
        """
        if self.question is None:
            return None
        plant, minimise, limits = self.question
        if minimise is None or (minimise.limits_rms and self.law.passes):
            return None  # the law may cancel white noise as it comes
        return limit_of_any_law(plant, minimise, limits, self.bounds[0].level)

    def bound(self, name: str) -> Bound:
        """Return the bound on the signal of that name.

        Raises
        ------
        InputError
            If there is none.
        """
        for bound in self.bounds:
            if bound.specification.name == name:
                return bound
        raise InputError(f"no specification of {name!r}")

    def save(self, directory: str | Path) -> Path:
        """Write ``design.json``, with region and bounds, into a folder; return its path.

        The folder is made if need be. The numbers are those that were proved: a double as it is,
        any other rational as "p/q". What no law goes below is a file of its own, see
        `Refutation.save`.

        Raises
        ------
        OutputError
            If the folder cannot be written.
        """
        return save(self.design.certificate, self.claims, directory)


def limit_of_any_law(
    plant: UncertainPlant, minimise: Specification, limits: Sequence[Specification], level: float
) -> Refutation | None:
    """Return what no law within limits goes below, as `Optimised.limit_of_any_law` has it.

    Parameters
    ----------
    level : float
        That some law is proved to keep.
    """
    if plant.sampling is not None:
        plant = plant.sampling.plant  # whose laws those of samples are
    from scipy import linalg  # whose BLAS is there before it is to have one thread

    with small_matrices(), suppress(PolefenceError, linalg.LinAlgError):
        return least_of_any(plant, minimise, limits, level)
    return None


@dataclass(eq=False)
class Chain:
    """Laws of growing order of one structure, each searched once, whatever asks for them.

    Attributes
    ----------
    orders : sequence of int
        That are asked for, one after the other.
    below : sequence of pairs of Structure and Law
        Laws of poorer structures, from which the next search begins too.
    searches : Orders, optional
        What has been searched.
    """

    orders: Sequence[int]
    below: Sequence[tuple[Structure, Law]] = ()
    searches: Orders | None = None

    def of(self, task: Task, structure: Structure) -> tuple[Orders, int]:
        """Return the searches, and the number of a structure's order."""
        if self.searches is None:
            highest = replace(structure, order=max(self.orders))
            orders = sorted({*orders_below(highest), *self.orders})
            problems = [structured(task, replace(structure, order=k)) for k in orders]
            self.searches = Orders(task, highest, problems, orders, MOST_WORK)
        k = self.searches.orders.index(structure.order)
        laws = embedded(task.plant, self.searches.problems[k], structure.order, self.below)
        self.searches.known[k] = laws
        return self.searches, k


@explained
@small_matrices()
def optimise(
    plant: UncertainPlant,
    minimise: Specification | None,
    subject_to: Sequence[Specification] = (),
    region: Region | None = None,
    method: Method | None = None,
    budget: float | None = None,
    structure: Structure | None = None,
    *,
    fewer_states: bool = True,
    bears: Callable[[Design], bool] | None = None,
) -> Optimised:
    """Design the law with the smallest worst case of one signal, within limits on others.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E.
    minimise : Specification or None
        Of any kind of `polefence.requirements`; None: any law within the limits will do.
    subject_to : sequence of Specification
        Each with its ``at_most``.
    region : Region, optional
        For the poles; stability by default.
    method : str or Scheduled, optional
        How free the law is: "quadratic" is one gain, "scheduled" is `Scheduled` of degree 1 and
        elevation 0, on the box where the plant has parameters. The answer is the better of the law
        of that method's LMI and a polynomial of its degree in the parameters, which is tuned.
        "scheduled" by default; the tuned one alone where its LMI is too large.
    budget : float, optional
        Time after which no further law is looked for [s]; the answer then says so in its ``cut``.
        Without one the same question has the same answer on every machine, however slow.
    structure : Structure, optional
        What the law may measure, what schedules it, its degree and free numbers: it is tuned.
        Of a plant with tracks or weights a law of its other states is, unless told otherwise.
        Where it has states of its own the answer's plant has them too.
    fewer_states : bool
        Whether a law of a lower order is returned where that is as good to a thousandth.
    bears : callable, optional
        Whether a design of which all is proved may be returned: where one is not, poles farther
        inside the region are searched. `polefence.export.FloatCode` is one.

    Returns
    -------
    Optimised
        Everything in it is proved.

    Raises
    ------
    NotProvedError
        If the limits or the region are not proved. The message names the specifications that are in
        conflict for this method; where it says "refuted" no law keeps them, and the error's
        ``refutation`` is the proof.
    InputError
        If a specification does not fit the plant.
    """
    question = minimise, subject_to, region, method, budget, structure
    return _answered(plant, *question, fewer_states, bears, None)


@explained
@small_matrices()
def optimise_in(
    chain: Chain,
    plant: UncertainPlant,
    minimise: Specification | None,
    subject_to: Sequence[Specification],
    region: Region | None,
    structure: Structure,
) -> Optimised:
    """Return what `optimise` does, of a structure among others of which something is known."""
    question = minimise, subject_to, region, None, None, structure
    return _answered(plant, *question, False, None, chain)


def _answered(
    plant: UncertainPlant,
    minimise: Specification | None,
    subject_to: Sequence[Specification],
    *how: Any,
) -> Optimised:
    done = _optimised(plant, minimise, subject_to, *how)
    decay = proved_decay(done.plant, done.law, done.bounds)
    done = replace(done, decay=decay, question=(plant, minimise, tuple(subject_to)))
    done.design.certificate.require_checkable(done.claims)
    return done


def _optimised(
    plant: UncertainPlant,
    minimise: Specification | None,
    subject_to: Sequence[Specification],
    region: Region | None,
    method: Method | None,
    budget: float | None,
    structure: Structure | None,
    fewer_states: bool,
    bears: Callable[[Design], bool] | None,
    chain: Chain | None,
) -> Optimised:
    """Return what `optimise` does, before it is known that its file is proved."""
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    require_moderate(plant)
    if minimise is None and not subject_to:
        raise InputError("nothing to minimise and no limits: polefence.place is for regions alone")
    if minimise is not None:
        require_type(minimise, Specification, "minimise", "for example Rms('force')")
    for limit in subject_to:
        require_type(limit, Specification, "subject_to", "for example Rms('force', at_most=700)")
        if limit.at_most is None:
            raise InputError(f"the limit of {limit.name!r} is missing; give at_most")
    plant, limits = by_name(plant, subject_to)
    if minimise is not None:
        plant, (minimise,) = by_name(plant, (minimise,))
        minimise.require_fit(plant)
    for limit in limits:
        limit.require_fit(plant)
    if structure is not None and method is not None:
        raise InputError("a method and a structure exclude each other; leave one out")
    known = measurable(plant)
    wanted = limits if minimise is None else (minimise, *limits)
    for one in wanted:
        known = one.readable(plant, known)
    if structure is None and method is None and len(known) < plant.shape[0]:
        structure = Structure(measured=known)  # those of a road and of weights are for no law
    either = structure is None and method is None
    beyond_lmi = next(filter(None, (one.beyond_lmi(plant) for one in wanted)), "")
    if beyond_lmi and structure is None and not either:
        raise InputError(beyond_lmi)
    method = method_for(plant, method)
    _require_method(plant, method)
    if len(plant.vertices) == 1:  # one gain is every law
        method = "quadratic"
    asked = stable_region(plant) if region is None else in_time_of(plant, region)
    require_region(plant, asked)
    require_movable(plant, asked)
    if structure is not None:
        structure.require_fit(plant)
        structure = proper(structure, plant, wanted)
        if minimise is not None and len(minimise.tuned(1.0)) > 1:
            raise InputError(
                f"{minimise.title}: with a structure, minimise it for one input; limit the others"
            )
    deadline, count = Deadline(budget), len(limits) + (minimise is not None)
    words = _in_words(plant, region, asked)
    # what is searched is in differences where the plant is in discrete time
    T, inside, plant = plant.sample_time, asked, delta_form(plant)
    if T is not None:
        inside = delta_plane(asked, T)
    task = Task(plant, minimise, limits, inside, method, (plant, limits), words, bears)
    if either and (beyond_lmi or not is_optimisable(plant, method, count)):
        structure = Structure()  # a law that is tuned needs no inequalities to be found
    if structure is not None and chain is not None:
        return _as_sampled(_of_chain(task, structure, chain), asked)
    if structure is not None:
        return _as_sampled(_tuned(task, structure, fewer_states), asked)
    require_optimisable(plant, method, count)
    return _as_sampled(_of_a_kind(task, deadline), asked)


def _in_words(plant: UncertainPlant, region: Region | None, asked: Region) -> tuple[str, ...]:
    """Return the parts of the region in the plant's time in words, as they were asked for."""
    if is_stability(plant, asked):
        return ("stability",)
    designed = asked if region is None else region
    same = len(designed.parts) == len(asked.parts)
    return tuple(map(str, designed.parts if same else asked.parts))


def _as_sampled(done: Optimised, region: Region) -> Optimised:
    """Return a law that was found in differences as one of the plant in discrete time, proved."""
    if not done.plant.step:
        return done
    return replace(done, design=as_sampled(done.design, region), designed=region)


def structure_of(method: Method) -> Structure:
    """Return the structure of a law that is tuned, as free as a law of a method."""
    degree = int(options(method).degree)
    return Structure(degree=degree) if degree else Structure(schedule=())


def _of_a_kind(task: Task, deadline: Deadline) -> Optimised:
    """Return the better of the LMI's law, and of one as free that is tuned from that on.

    Raises
    ------
    NotProvedError
        If there is none: what is refuted, or in conflict.
    """
    with stage("law by an LMI"):
        law, given, reason = _of_lmi(task)
        if given is None and law is not None and task.minimise is None:
            given = _bounded(task, candidate(task, law))
    if given is not None and (task.minimise is None or deadline.passed):
        return replace(given, cut=_cut(deadline))
    tuned: Optimised | None = None
    with suppress(InputError), bounded(MOST_WORK) as effort:
        starts = [*([] if law is None else [law]), *_of_stability(task)]
        tuned = _best_tuned(*structured(task, structure_of(task.method)), starts)
    if given is None and tuned is None and law is not None and task.minimise is not None:
        given = _bounded(task, candidate(task, law))
    every = [done for done in (given, tuned) if done is not None]
    if not every:
        raise refusal(task, reason)
    cut = str(effort) if effort.ended else ""
    return replace(_least(*every), shared=every[0].shared, cut=cut)


def _of_lmi(task: Task) -> tuple[Law | None, Optimised | None, str]:
    """Return the law that one Lyapunov matrix for everything gives, and with its proofs.

    In place of one too fast to be built one of a smaller gain. Where there is none, why; there are
    no proofs where that one matrix gives none.
    """
    try:
        point = task.reached(task.region)
        law = task.law(point)
    except SolverError as error:
        _refute(task)
        return None, None, str(error)
    if is_too_fast(task.plant, law):
        calm = calmer(task, point)
        given = None if calm is None else _bounded(task, candidate(task, calm))
        if calm is None or given is None:
            return None, None, ""
        gain, smaller = (gain_of(task.plant, choice) for choice in (law, calm))
        return calm, replace(given, closer=Closer(level_of(task, point), gain, smaller)), ""
    proofs = together(task, law, point)
    if proofs is None:
        return law, None, ""
    certificate, bounds = proofs
    shared = 0.0 if task.minimise is None else bounds[0].level
    return law, Optimised(Design(certificate), bounds, shared, task.region), ""


def _of_stability(task: Task) -> Iterator[Law]:
    """Yield the LMI's law for stability alone: one matrix pays for the region, poles may not.

    A half car's least is 0.1 % lower from it on, or 3 % where a search ends elsewhere.
    """
    with suppress(SolverError):
        if task.minimise is not None and task.region != stable(float(task.plant.step)):
            yield task.law(task.reached(None))


def _refute(task: Task) -> None:
    refutation = refuted(task) if task.limits else None
    if refutation is not None:
        raise NotProvedError(str(refutation), refutation=refutation)


def _cut(deadline: Deadline) -> str:
    """Return why the search ended before its end, if it did."""
    return str(deadline) if deadline.passed else ""


def _tuned(task: Task, structure: Structure, fewer: bool) -> Optimised:
    """Return the best law of a structure that is proved; with ``fewer`` of the states it needs.

    Raises
    ------
    NotProvedError
        If there is none. It says which limits could be kept, proved of a law each.
    """
    orders = orders_below(structure)
    with bounded(MOST_WORK) as effort:
        problems = [structured(task, replace(structure, order=k)) for k in orders]
        searches = Orders(task, structure, problems)
        last = len(orders) - 1
        known = searches.tuned(last) if last else ()
    with bounded(MOST_PROVING) as proving:  # whatever the searches of all orders took
        if last and fewer:
            best = _best_order(searches)
        else:
            best = _best_tuned(*searches.problems[-1], searches.starts(last), known)
    cut = str(effort) if searches.cut else str(proving) if proving.ended else ""
    if best is not None:
        return replace(best, cut=cut)
    reason = "not proved: no law of this structure was found that is proved to keep the region"
    slow = _slower_than_late_samples(task)
    asked = (*([task.minimise] if task.minimise else ()), *task.limits)
    easier = next(filter(None, (one.easier(task.plant) for one in asked)), "")
    if slow or not task.limits:
        raise NotProvedError("; ".join(filter(None, (reason, slow, easier, cut))))
    if not whitened(structure, task.plant):
        _refute(task)
    near, (larger, gain) = list[str](), searches.problems[-1]
    with bounded(MOST_WORK * 0.25) as looked:
        for limit, done in _attainable(larger, gain, searches.starts(last)):
            if _level(done) > (limit.at_most or 0.0):
                near.append(str(done.bounds[0]))
                continue
            # a law of which all limits are proved after all, if none that makes the least less
            kept = _bounded(larger, candidate(larger, done.law))
            if kept is not None:
                return replace(kept, structure=gain, cut=cut)
    advice = "dropping any single limit does not help either"
    if looked.ended:
        advice = "the search with one of them left out stopped at its bound of work"
    if near:
        advice = f"with {' or '.join(near)}, the other limits as they are, there is one"
    advice += f"; {easier}" if easier else ""
    if cut:
        advice += f"; {cut}: let it measure more, schedule it on less, or take a lower order"
    raise NotProvedError(f"{reason} and the limits; this is not a refutation; {advice}")


def _of_chain(task: Task, structure: Structure, chain: Chain) -> Optimised:
    """Return the best law of a structure that is proved, of searches that others share.

    Raises
    ------
    NotProvedError
        If there is none.
    """
    searches, k = chain.of(task, structure)
    known = searches.tuned(k)
    with bounded(MOST_PROVING) as proving:
        best = _best_tuned(*searches.problems[k], searches.starts(k), known)
    cut = str(proving) if proving.ended else ""
    if best is None:
        reason = "not proved: no law of this structure was found that is proved to keep the region"
        limits = " and the limits; this is not a refutation" if task.limits else ""
        raise NotProvedError("; ".join(filter(None, (reason + limits, cut))))
    return replace(best, cut=cut)


def _slower_than_late_samples(task: Task) -> str:
    """Say that the region leaves out z = 0, where the pole of a late sample begins."""
    sampling, step = task.plant.sampling, float(task.plant.step)
    if sampling is None or not sampling.delay or task.region.contains([-1 / step]):
        return ""
    return (
        "an input that is late adds a pole at z = 0, which the region leaves out, and no such law "
        "moved it into the region for all parameters; ask without what bounds the speed of poles, "
        "such as a disk, or without the delay"
    )


def _best_order(orders: Orders) -> Optimised | None:
    """Return the best law that is proved, of the lowest order that is as good as any."""
    every = list[Optimised]()
    for k in orders.promising:
        known = orders.tuned(k)
        below = min(map(_level, every), default=np.inf) * (1 + NEAR)
        if known and known[0].level >= below:  # at rest and in samples: no proof is lower
            continue
        done = _best_tuned(*orders.problems[k], orders.starts(k), known, below)
        every += [] if done is None else [done]
        enough = orders.least * 1.05  # how far a proof is off is no matter of the order
        if done is not None and (orders.problems[k][0].minimise is None or _level(done) <= enough):
            break
    lowest = min(map(_level, every), default=0.0) * (1 + NEAR)
    some = [result for result in every if _level(result) <= lowest] or every
    return min(some, key=lambda result: result.plant.shape[0], default=None)


def _attainable(
    task: Task, structure: Structure, starts: Sequence[Law]
) -> Iterator[tuple[Specification, Optimised]]:
    """Yield each limit with the law that keeps all others, and of this bounds the least."""
    for limit in task.limits[:6]:
        if ended():
            return
        others = tuple(other for other in task.limits if other is not limit)
        done = _best_tuned(
            replace(task, minimise=replace(limit, at_most=None), limits=others), structure, starts
        )
        if done is not None:
            yield limit, done


def _best_tuned(
    task: Task,
    structure: Structure,
    starts: Sequence[Law],
    known: Sequence[Tuned] = (),
    below: float = np.inf,
) -> Optimised | None:
    """Return the best law of a structure that is proved, no worse than that of a lower degree.

    Parameters
    ----------
    known : sequence of Tuned
        What a search from lower degrees on has found.
    below : float
        Level that a law is to be better than: another one is proved for it.
    """
    every = list[Optimised]()
    most = np.inf
    if not known and structure.degree and structure.schedule != () and len(task.plant.vertices) > 1:
        lower = {"degree": structure.degree - 1} if structure.degree > 1 else {"schedule": ()}
        simpler = _best_tuned(task, replace(structure, **lower), starts)
        if simpler is not None:
            starts, most = (*starts, simpler.law), _level(simpler)
            every.append(simpler)
            if task.minimise is None:
                return simpler

    def proved() -> float:
        return min([below, *map(_level, every)])

    def wanted(tuned: Tuned) -> float:
        best = min(every, key=_level, default=None)
        if best is None or _level(best) >= below:
            return below
        return up_to(_level(best), gain_of(best.plant, best.law), tuned.size)

    for answer, tuned, lowest in tuned_candidates(task, structure, starts, known, wanted):
        done = _bounded(task, answer)
        if done is not None:
            done = replace(done, structure=structure, bounded_by=tuned.bounded_by)
            every.append(replace(done, closer=_closer(done, tuned)))
        # where a better law of the search has no proof, one within tighter limits may have one
        # a law proved so close to its worst sample needs no other: bounds are proved to within NEAR
        if every and (task.minimise is None or proved() <= lowest * (1 + 2 * NEAR)):
            break
    return _least(*every, most=most) if every else None


def _closer(done: Optimised, tuned: Tuned) -> Closer | None:
    """Return the law that a search made smaller, its level beside the proved one as in floats."""
    if tuned.larger is None or not tuned.level:
        return None
    law, level = tuned.larger
    gain, smaller = (gain_of(done.plant, choice) for choice in (law, done.law))
    return Closer(_level(done) * level / tuned.level, gain, smaller)


def structured(task: Task, structure: Structure) -> tuple[Task, Structure]:
    """Return the task for the plant of which the law is a gain, and that gain's structure."""
    plant = task.plant
    structure.require_fit(plant)
    require_detectable(plant, structure.outputs(plant), task.region)
    asked = (task.minimise, *task.limits) if task.minimise else task.limits
    larger, gain, extended = _with_own_states(structure, plant, asked)
    limits = extended[1:] if task.minimise else extended
    return replace(task, plant=larger, limits=limits, minimise=task.minimise and extended[0]), gain


def _with_own_states(
    structure: Structure, plant: UncertainPlant, asked: Sequence[Specification]
) -> tuple[UncertainPlant, Structure, tuple[Specification, ...]]:
    """Return the plant with the states of a law, its gain's structure, and what is asked of it."""
    larger, gain = structure.extended(plant)
    n, more = plant.shape[0], larger.shape[0] - plant.shape[0]
    return (
        larger,
        gain,
        tuple(
            specification.extended(n, more) if more else specification for specification in asked
        ),
    )


def method_for(plant: UncertainPlant, method: Method | None) -> Method:
    """Return the method that is meant where it is plain "scheduled", or none."""
    if method is None or method == "scheduled":
        return Scheduled(1, 0, "box" if plant.parameters else "simplex")
    return method


def _require_method(plant: UncertainPlant, method: Method) -> None:
    require_domain(plant, method)
    o = options(method)
    if not isinstance(o, Scheduled) or o.degree == "auto" or o.right_hand_sides:
        raise InputError(
            "optimise takes the methods 'quadratic' and Scheduled(degree, elevation, on)"
        )


def _level(done: Optimised) -> float:
    """Return the first bound, that of what is minimised where something is."""
    return done.bounds[0].level


def _least(*every: Optimised, most: float = np.inf) -> Optimised:
    """Return of the laws as good as the best the one that is taken; the only one if alone.

    Parameters
    ----------
    most : float
        Level that it must not exceed.
    """
    if len(every) == 1:
        return every[0]

    gains = [gain_of(done.plant, done.law) for done in every]
    known = [Closer(_level(done), gain, gain) for done, gain in zip(every, gains, strict=True)]
    k, closer = least(known, [done.closer for done in every if done.closer is not None], most)
    chosen = every[k]
    return replace(chosen, closer=closer)


def _bounded(task: Task, answer: Candidate | Missing) -> Optimised | None:
    """Prove the bound on what is minimised, where alpha lives there; None where there is none."""
    if isinstance(answer, Missing):
        return None
    if task.minimise is None:
        return Optimised(Design(answer.certificate), answer.limits, 0.0, task.region)
    first: Bound | None = None
    law = answer.certificate.law
    with suppress(SolverError), singular_is_failure():
        first = best_bound(task.plant, law, task.minimise)
        # of a law that doubles cannot evaluate a proof is of no use
        first = None if first is None else agreed_bound(task.plant, law, first)
    if first is None:
        return None
    return Optimised(Design(answer.certificate), (first, *answer.limits), np.inf, task.region)
