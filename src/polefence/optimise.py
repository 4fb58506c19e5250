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
from polefence.law import FixedGain, Law
from polefence.performance import Bound, best_bound, kept_bound
from polefence.plant.family import UncertainPlant
from polefence.proof.certificate import Certificate
from polefence.region import HalfPlane, Region, Sector
from polefence.solve.performance import Reached
from polefence.specification import Rms, Specification

ENOUGH = 5.0  # for the proof of a region [s], after which no higher degree is begun
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
    """

    design: Design
    bounds: tuple[Bound, ...]
    shared: float
    share: float

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
        ``refutation`` is the proof.
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
        return _best(task, deadline)
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
        found = _best(bare, deadline)
        simple = _kept(task, without_feedback(found.law, task.plant), found.share)
    if simple is not None and time.perf_counter() > deadline:
        return simple
    try:
        best = _best(task, deadline)
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
    return _level(task, found), _proved(task, found, share)


def _level(task: Task, found: Reached) -> float:
    if task.minimise is None:
        return 0.0
    power = 1.0 if task.minimise.kind == "gain" else 0.5
    return float(found.r**power)


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
    law = task.law(found)
    certificate = _region(task, found, law, share)
    return None if certificate is None else _bounded(task, certificate, share)


def _kept(task: Task, law: Law, share: float) -> Optimised | None:
    """Prove everything of a law that was designed otherwise; None where something is not."""
    answer = analyse(task.plant, law, task.region, budget=ENOUGH)
    if not answer.proved or answer.certificate is None:
        return None
    return _bounded(task, answer.certificate, share)


def _bounded(task: Task, certificate: Certificate, share: float) -> Optimised | None:
    """Prove the bounds of the certificate's law, where alpha lives there; None where one is not."""
    law = certificate.law
    limits = [kept_bound(task.plant, law, s) for s in task.limits]
    if any(bound is None for bound in limits):
        return None
    bounds = tuple(b for b in limits if b is not None)
    if task.minimise is not None:
        first = best_bound(task.plant, law, task.minimise)
        if first is None:
            return None
        bounds = (first, *bounds)
    return Optimised(Design(certificate), bounds, np.inf, share)


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
