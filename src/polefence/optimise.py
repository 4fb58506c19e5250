"""A law for specifications: one signal small, others within limits, all poles in a region; proved.

One W(alpha) for everything is conservative. So the law is designed with one, for a region that may
be relaxed; what it keeps is then proved for the law as it is, each bound with a Lyapunov polynomial
of its own, and the region with one for each of its parts.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from polefence.analysis import analyse
from polefence.augmented import with_weights, without_feedback
from polefence.checks import require_domain, require_movable, require_region, require_type
from polefence.conditions.methods import Method, Scheduled, options
from polefence.conflict import refusal
from polefence.design import Design
from polefence.design_task import Task
from polefence.errors import InputError, NotProvedError, SolverError
from polefence.gain_norm import is_signal
from polefence.law import FixedGain, Law
from polefence.performance import Bound, Known, best_bound, kept_bound, own_evidence
from polefence.plant.family import UncertainPlant
from polefence.proof.certificate import Certificate
from polefence.region import HalfPlane, Region, Sector
from polefence.retreat import (
    CLOSE,
    FAR,
    Retreat,
    Step,
    is_falling,
    is_too_fast,
    level_of,
    steps,
    unbounded,
)
from polefence.sampled_bounds import agreed_bound
from polefence.solve.performance import Reached
from polefence.solve.singular import singular_is_failure
from polefence.specification import Rms, Specification, output_of

ENOUGH = 5.0  # for the proof of a region [s], after which no higher degree is begun
POOR = 0.05  # a bound that is proved so far above the design's own is of a law gone wrong
HALVINGS = 5  # of the share of the region that the design keeps


@dataclass(frozen=True, eq=False, repr=False)
class Optimised:
    """A law with a proof of its region, and of every specification.

    Attributes
    ----------
    design : Design
        Law, region and its certificate.
    bounds : tuple of Bound
        The one that was minimised first, where one was.
    shared : float
        What one Lyapunov matrix for everything proves of it, for the region as it is; infinite
        where that proves nothing, zero where nothing was minimised.
    share : float
        Of the region, what the design kept; 1 is all of it.
    retreat : Retreat, optional
        How far the law stands from an infimum that none attains, or none that can be proved.
    """

    design: Design
    bounds: tuple[Bound, ...]
    shared: float
    share: float
    retreat: Retreat | None = None

    def __repr__(self) -> str:
        return f"<Optimised {self.plant.name!r}: {'; '.join(map(str, self.bounds))}>"

    @property
    def plant(self) -> UncertainPlant:
        """The plant family."""
        return self.design.plant

    @property
    def law(self) -> Law:
        """The control law."""
        return self.design.law

    def bound(self, name: str) -> Bound:
        """Return the bound on the signal of that name.

        Raises
        ------
        InputError
            If there is none.
        """
        for own in self.bounds:
            if own.specification.name == name:
                return own
        raise InputError(f"no specification of {name!r}")


def optimise(
    plant: UncertainPlant,
    minimise: Specification | None,
    subject_to: Sequence[Specification] = (),
    region: Region | None = None,
    method: Method | None = None,
    budget: float = 60.0,
) -> Optimised:
    """Design the law with the smallest worst case of one signal, within limits on others.

    Parameters
    ----------
    plant : UncertainPlant
        With a disturbance, E.
    minimise : Specification or None
        `Rms`, `RelativeRms`, `EnergyPeak`, `InitialPeak`, `Gain` or `GainNorm`; None: any law
        within the limits will do.
    subject_to : sequence of Specification
        Each with its ``at_most``.
    region : Region, optional
        For the poles; stability by default.
    method : str or Scheduled, optional
        "quadratic" (one gain) or `Scheduled`; by default of degree 1 and elevation 0, on the box
        where the plant has parameters.
    budget : float
        Time after which no further share of the region is tried [s].

    Returns
    -------
    Optimised
        Everything in it is proved. Where a specification has a weight its plant has the filter's
        states; the law feeds them back only where that is better.

    Raises
    ------
    NotProvedError
        If the limits or the region are not proved. The message names the specifications that are in
        conflict for this method; where it says "refuted" no law keeps them, and the error's
        ``refutation`` is the proof; where it says "unbounded" what is minimised falls without end
        as the law grows.
    InputError
        If a specification does not fit the plant.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    if minimise is None and not subject_to:
        raise InputError("nothing to minimise and no limits: polefence.place is for regions alone")
    if minimise is not None:
        require_type(minimise, Specification, "minimise", "for example Rms('force')")
    method = method or Scheduled(1, 0, "box" if plant.parameters else "simplex")
    _require_method(plant, method)
    if len(plant.vertices) == 1:  # one gain is every law
        method = "quadratic"
    if plant.sample_time is not None:
        raise InputError(f"{plant.name} is in discrete time; specifications are of continuous time")
    asked = HalfPlane(0) if region is None else region
    require_region(plant, asked)
    for own in subject_to:
        require_type(own, Specification, "subject_to", "for example Rms('force', at_most=700)")
        if own.at_most is None:
            raise InputError(f"the limit of {own.name!r} is missing; give at_most")
    require_movable(plant, asked)
    asked_for = subject_to if minimise is None else (*subject_to, minimise)
    deadline = time.perf_counter() + budget
    larger, found = with_weights(plant, tuple(asked_for))
    task = replace(
        _task(larger, found, minimise is not None, asked, method), asked=(plant, tuple(subject_to))
    )
    if larger is plant:
        return _settled(task, deadline)
    bare = tuple(replace(s, weight=None) if isinstance(s, Rms) else s for s in asked_for)
    return _weighted(task, _task(plant, bare, minimise is not None, asked, method), deadline)


def _task(
    plant: UncertainPlant,
    asked_for: tuple[Specification, ...],
    minimised: bool,
    region: Region,
    method: Method,
) -> Task:
    """Return the task; what is minimised comes last of the specifications."""
    if not minimised:
        return Task(plant, None, asked_for, region, method)
    return Task(plant, asked_for[-1], asked_for[:-1], region, method)


def _weighted(task: Task, bare: Task, deadline: float) -> Optimised:
    """Return the better of a law with the filters' states, and one without, for bare signals."""
    simple: Optimised | None = None
    with suppress(NotProvedError):
        found = _settled(bare, deadline)
        simple = _kept(task, without_feedback(found.law, task.plant), found.share)
    if simple is not None and time.perf_counter() > deadline:
        return simple
    try:
        best = _settled(task, deadline)
    except NotProvedError:
        if simple is None:
            raise
        return simple
    if simple is None or (task.minimise and best.bounds[0].level < simple.bounds[0].level):
        return best
    return replace(simple, shared=best.shared)


def _require_method(plant: UncertainPlant, method: Method) -> None:
    require_domain(plant, method)
    o = options(method)
    if not isinstance(o, Scheduled) or o.degree == "auto" or o.right_hand_sides:
        raise InputError("optimise goes with 'quadratic' and Scheduled(degree, elevation, on)")


def _settled(task: Task, deadline: float) -> Optimised:
    """Return the best law; one of slower poles where that is not proved, or is none to be built."""
    best, failure = None, None
    try:
        best = _best(task, deadline)
    except NotProvedError as error:
        failure = error
        if error.refutation is not None:
            raise
    fast = best is not None and is_too_fast(task.plant, best.law)
    if best is not None and not fast and not _is_poor(best):
        return best
    least = _least(task) if best is None else best.shared
    if failure is not None and task.limits and not np.isfinite(least):
        raise failure  # no law keeps the limits, or none was found
    taken, found = _stepped_back(task, least)
    if found is not None and (best is None or fast or _level(found) < _level(best)):
        return found
    if is_falling(taken) and (best is None or fast):
        raise unbounded(task, taken) from failure
    if best is None:
        raise failure or NotProvedError("not proved")
    return best


def _least(task: Task) -> float:
    """Return what is found in floats, proved or not; infinite where there is none."""
    try:
        return level_of(task, task.reached(task.region))
    except SolverError:
        return np.inf


def _stepped_back(task: Task, least: float) -> tuple[list[Step], Optimised | None]:
    """Return steps back, and the nearest to the least level that is proved, if it is near."""
    taken = list[Step]()
    for step in steps(task):
        taken.append(step)
        # without anything to minimise the first that is proved will do
        if step.level <= least * (1 + CLOSE) and (
            task.minimise is not None or _proved(task, step.found, 1.0) is not None
        ):
            break
    least = min([least, *(step.level for step in taken)])
    best: Optimised | None = None
    for step in sorted(taken, key=lambda step: step.level):
        found = _proved(task, step.found, 1.0) if step.level <= least * (1 + FAR) else None
        if found is not None and (best is None or _level(found) < _level(best)):
            retreat = Retreat(step.speed, step.level, least)
            best = replace(found, shared=step.level, retreat=retreat)
        if best is not None and not _is_poor(best):
            break
    if best is not None and task.minimise is not None and _level(best) > least * (1 + FAR):
        return taken, None
    return taken, best


def _level(own: Optimised) -> float:
    """Return the first bound, that of what is minimised where something is."""
    return own.bounds[0].level


def _is_poor(own: Optimised) -> bool:
    """Whether what is proved of the law is far above what its design says."""
    minimised = own.bounds[0].specification.at_most is None
    return minimised and own.bounds[0].level > own.shared * (1 + POOR)


def _best(task: Task, deadline: float) -> Optimised:
    """Try the region as it is, none of it, and shares between that turn out to be kept."""
    reasons: list[str] = []
    shared, whole = _attempt(task, 1.0, reasons)
    loose = relaxed(task.region, 0.0)
    done = loose == task.region or (task.minimise is None and whole is not None)
    best = whole if done else _attempt(task, 0.0, reasons)[1]
    if best is None and loose != task.region:
        best, low, high = whole, 0.0, 1.0
        for _ in range(HALVINGS):
            if time.perf_counter() > deadline:
                break
            share = (low + high) / 2
            level, own = _attempt(task, share, reasons)
            if own is None and np.isfinite(level):
                low = share  # a law that does not keep the region: ask for more of it
                continue
            high = share
            if own is not None and (best is None or own.bounds[0].level < best.bounds[0].level):
                best = own
            if own is not None and task.minimise is None:
                break
    if best is None:
        raise refusal(task, reasons)
    return replace(best, shared=shared)


def _attempt(task: Task, share: float, reasons: list[str]) -> tuple[float, Optimised | None]:
    """Design for a share of the region; return the shared bound, infinite if none, and proofs."""
    try:
        found = task.reached(relaxed(task.region, share))
    except SolverError as error:
        reasons.append(str(error))
        return np.inf, None
    return level_of(task, found), _proved(task, found, share)


def relaxed(region: Region, share: float) -> Region | None:
    """Return a region with less decay and damping; None for none of it."""
    if share >= 1:
        return region
    kept: Region | None = None
    for part in region.parts:
        own: Region = part
        if isinstance(part, HalfPlane):
            own = HalfPlane(part.decay * share if part.decay > 0 else part.decay)
        elif isinstance(part, Sector):
            if not share:
                continue
            own = Sector(part.damping * share)
        kept = own if kept is None else kept & own
    return kept


def _proved(task: Task, found: Reached, share: float) -> Optimised | None:
    """Prove everything of a law that was found; None where something is not."""
    try:
        law = task.law(found)
    except (SolverError, InputError):  # its numbers are none that doubles hold
        return None
    with suppress(SolverError), singular_is_failure():
        certificate = _region(task, found, law, share)
        return None if certificate is None else _bounded(task, certificate, share, found)
    return None


def _kept(task: Task, law: Law, share: float) -> Optimised | None:
    """Prove everything of a law that was designed otherwise; None where something is not."""
    answer = analyse(task.plant, law, task.region, budget=ENOUGH)
    if not answer.proved or answer.certificate is None:
        return None
    return _bounded(task, answer.certificate, share)


def _bounded(
    task: Task, certificate: Certificate, share: float, found: Reached | None = None
) -> Optimised | None:
    """Prove the bounds of the certificate's law, where alpha lives there; None where one is not."""
    law = certificate.law
    limits = [kept_bound(task.plant, law, s, _known(task, found, law, s)) for s in task.limits]
    if any(bound is None for bound in limits):
        return None
    bounds = tuple(b for b in limits if b is not None)
    if task.minimise is not None:
        known = _known(task, found, law, task.minimise)
        first = best_bound(task.plant, law, task.minimise, known)
        if first is None:
            return None
        bounds = (first, *bounds)
    # of a law that doubles cannot evaluate a proof is of no use
    agreed = [agreed_bound(task.plant, law, bound) for bound in bounds]
    if any(bound is None for bound in agreed):
        return None
    own = tuple(b for b in agreed if b is not None)
    return Optimised(Design(certificate), own, np.inf, share)


def _known(task: Task, found: Reached | None, law: Law, own: Specification) -> Known | None:
    """Return what the design itself says of a signal; None for the norm of a gain."""
    if found is None or not is_signal(own):
        return None
    source = output_of(task.plant, task.domain, own, 1.0)[0]
    t = found.t.get(f"t {source.name}", 0.0)
    if not t > 0:
        return None
    W = np.stack([found.values[f"W{k + 1}"] for k in range(len(found.values) // 2)])
    return own_evidence(law, W, t), own.at_most or level_of(task, found)


def _region(task: Task, found: Reached, law: Law, share: float) -> Certificate | None:
    """Prove the region with the law's own W where it was asked of it, else as of a given law."""
    if share == 1:
        elevation = options(task.method).elevation
        name, evidence = "scheduled", {"tau": np.array(0.0), "elevation": elevation}
        if isinstance(law, FixedGain):
            name, evidence = "quadratic", {"W": found.values["W1"]}
        own = Certificate(task.plant, task.region, name, law, evidence)
        if own.prove().proved:
            return own
    answer = analyse(task.plant, law, task.region, budget=ENOUGH)
    return answer.certificate if answer.proved else None
