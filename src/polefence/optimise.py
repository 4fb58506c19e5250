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
from typing import Any

import numpy as np

from polefence.analysis import analyse
from polefence.augmented import with_weights, without_feedback
from polefence.checks import require_domain, require_region, require_type
from polefence.conditions.methods import Method, Scheduled, method_label, options
from polefence.conditions.target import Around
from polefence.design import Design
from polefence.errors import InputError, NotProvedError, SolverError
from polefence.gain_norm import as_norms, is_signal
from polefence.law import FixedGain, Law, ScheduledGain, right_divide
from polefence.performance import Bound, best_bound, kept_bound
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.polynomial import Domain
from polefence.proof.certificate import Certificate
from polefence.refutation import Refutation, refute_limits
from polefence.region import HalfPlane, Region, Sector
from polefence.solve.performance import Question, Reached, least
from polefence.solve.radius import smallest, typical_rate
from polefence.solve.scaling import balanced
from polefence.specification import Rms, Specification, output_of
from polefence.speed import bounded

INSIDE = 0.95  # how far inside the region the search begins
SPEED = 100.0  # times the plant's own rates, where nothing else bounds the first law's
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
    plant.require_controllable()
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
) -> _Task:
    """Return the task; what is minimised comes last of the specifications."""
    if not minimised:
        return _Task(plant, None, asked_for, region, method)
    return _Task(plant, asked_for[-1], asked_for[:-1], region, method)


def _weighted(task: _Task, bare: _Task, deadline: float) -> Optimised:
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


@dataclass(frozen=True, eq=False)
class _Task:
    plant: UncertainPlant
    minimise: Specification | None
    limits: tuple[Specification, ...]
    region: Region
    method: Method
    # the plant without filters, and the limits as they were asked for
    asked: tuple[UncertainPlant, tuple[Specification, ...]] | None = None

    @property
    def domain(self) -> Domain:
        return Domain.of(options(self.method).on, len(self.plant.vertices))

    def question(self, region: Region | None) -> Question:
        """Return the condition with one Lyapunov matrix for everything."""
        o, plant = options(self.method), self.plant
        pairs = [output_of(plant, self.domain, s) for s in self.limits if is_signal(s)]
        if self.minimise is not None and is_signal(self.minimise):
            pairs.append(output_of(plant, self.domain, self.minimise, 1.0))
        sources = {source.name: source for source, _ in pairs}
        outputs = tuple(output for _, output in pairs)
        degree, elevation = int(o.degree), o.elevation
        values = tuple(sources.values())
        norms = as_norms(plant, self.limits, self.minimise)
        form = self.domain, degree, elevation, norms
        return Question(plant.A, plant.B, values, outputs, region, *form)

    def reached(self, region: Region | None) -> Reached:
        """Search for the law.

        Raises
        ------
        SolverError
            If there is none, or nowhere to start.
        """
        plant, rate = self.plant, typical_rate(self.plant.A)
        scaling, question = balanced(plant.A, plant.B, rate), self.question(region)
        kept, failure = region or HalfPlane(0), SolverError("nowhere to start from")
        for inside in dict.fromkeys((kept, bounded(kept, SPEED * rate))):
            try:
                return least(question, self._start(inside), scaling)
            except SolverError as error:
                failure = error
        raise failure

    def _start(self, inside: Region) -> dict[str, Array]:
        """Return W and Z of a law that keeps a region."""
        start = smallest(self.plant.A, self.plant.B, Around(inside), self.method, enough=INSIDE)
        if start.radius >= 1:
            raise SolverError(f"no law of this method keeps {inside}")
        values = start.values
        if not int(options(self.method).degree):
            values = {"W1": values["W"], "Z1": values["Z"]}
        return {k: v for k, v in values.items() if k[0] in "WZ"}

    def law(self, found: Reached) -> Law:
        """Return the law of a point."""
        degree = int(options(self.method).degree)
        count = self.domain.count(degree)
        W, Z = (np.stack([found.values[f"{x}{k + 1}"] for k in range(count)]) for x in "WZ")
        if not degree:
            return FixedGain(right_divide(Z, W)[0])
        return ScheduledGain(W, Z, self.plant.parameters, degree, self.domain.sizes)


def _best(task: _Task, deadline: float) -> Optimised:
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
        raise _refusal(task, reasons)
    return replace(best, shared=shared)


def _attempt(task: _Task, share: float, reasons: list[str]) -> tuple[float, Optimised | None]:
    """Design for a share of the region; return the shared bound, infinite if none, and proofs."""
    try:
        found = task.reached(relaxed(task.region, share))
    except SolverError as error:
        reasons.append(str(error))
        return np.inf, None
    return _level(task, found), _proved(task, found, share)


def _level(task: _Task, found: Reached) -> float:
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


def _proved(task: _Task, found: Reached, share: float) -> Optimised | None:
    """Prove everything of a law that was found; None where something is not."""
    law = task.law(found)
    certificate = _region(task, found, law, share)
    return None if certificate is None else _bounded(task, law, certificate, share)


def _kept(task: _Task, law: Law, share: float) -> Optimised | None:
    """Prove everything of a law that was designed otherwise; None where something is not."""
    answer = analyse(task.plant, law, task.region, budget=ENOUGH)
    if not answer.proved or answer.certificate is None:
        return None
    return _bounded(task, law, answer.certificate, share)


def _bounded(task: _Task, law: Law, certificate: Certificate, share: float) -> Optimised | None:
    """Prove the bounds; None where one is not."""
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


def _region(task: _Task, found: Reached, law: Law, share: float) -> Certificate | None:
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


def _refusal(task: _Task, reasons: Sequence[str]) -> NotProvedError:
    label = method_label(task.method)
    conflict = _conflict(task)
    if conflict:
        refutation = _refuted(task, conflict)
        if refutation is not None:
            return NotProvedError(str(refutation), refutation=refutation)
        named = [str(p) if isinstance(p, Region) else _named(p) for p in conflict]
        return NotProvedError(
            f"not proved: {label} finds no law for these together, and one for any of them left "
            f"out: {'; '.join(named)}"
        )
    why = (
        reasons[0] if reasons else "a bound or the region was not proved of the law that was found"
    )
    named = [_named(s) for s in task.limits if s.at_most]
    return NotProvedError(
        f"not proved: {label}, {task.region}, {'; '.join(named) or 'no limits'}: {why}"
    )


def _named(own: Specification) -> str:
    return f"{own.kind} of {own.name} <= {own.at_most:g}"


def _refuted(task: _Task, conflict: Sequence[Any]) -> Refutation | None:
    """Return the proof that no law keeps the limits in conflict, or a smallest set of all limits.

    What is in conflict for the search may have a part of the region in it, and some of the limits
    be in conflict without it.
    """
    if task.asked is None:
        return None
    plant, limits = task.asked
    own = [a for a, s in zip(limits, task.limits, strict=True) if any(s is p for p in conflict)]
    if len(own) == len(conflict) and (found := refute_limits(plant, own)) is not None:
        return found
    found = refute_limits(plant, limits)
    if found is not None:
        for each in found.specifications:
            fewer = [s for s in found.specifications if s is not each]
            found = refute_limits(plant, fewer) or found
    return found


def _conflict(task: _Task) -> list[Any]:
    """Return a smallest set of limits and parts of the region that the search finds no law for."""
    if _feasible(task, task.limits, task.region):
        return []
    parts: list[Any] = [*task.limits, *task.region.parts]
    for own in list(parts):
        fewer = [p for p in parts if p is not own]
        if not _feasible(task, *_split(fewer)):
            parts = fewer
    return parts


def _split(parts: Sequence[Any]) -> tuple[tuple[Specification, ...], Region | None]:
    region: Region | None = None
    for part in parts:
        if isinstance(part, Region):
            region = part if region is None else region & part
    return tuple(p for p in parts if isinstance(p, Specification)), region


def _feasible(task: _Task, limits: tuple[Specification, ...], region: Region | None) -> bool:
    try:
        replace(task, limits=limits).reached(region)
    except SolverError:
        return False
    return True
