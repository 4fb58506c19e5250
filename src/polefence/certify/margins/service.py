"""Margins in service: the largest errors and rates that are proved, and errors that do break."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.base.files import write_documents
from polefence.base.progress import counted, stage
from polefence.base.renamed import warn_renamed
from polefence.certify.checks import in_time_of, require_region
from polefence.certify.design import Design, require_kind
from polefence.certify.given import analyse
from polefence.certify.margins.breaks import Break, estimate_break, gain_break
from polefence.certify.margins.claims import (
    MOST,
    Question,
    at_rest,
    claimed_design,
    climb,
    firmer,
    proved,
)
from polefence.certify.margins.each_gain import Gains, each_gain_claim
from polefence.certify.margins.estimate import EstimateQuestion
from polefence.certify.margins.loops import Balanced, balanced
from polefence.certify.margins.rate import RateQuestion
from polefence.plant.card import card
from polefence.plant.parameters import Parameter
from polefence.proof.claims.margins import MarginClaim
from polefence.proof.document import Document
from polefence.proof.short import Short
from polefence.proof.text import rate_text, unit_text
from polefence.region.regions import Region
from polefence.region.text import digits_down, digits_up

OF_STATES = "law states"

# Of all ranges at once, or of that in a second, that is next to no room. Laws scheduled for signals
# and stability alone had 0 to 1e-7 by their own matrices (a van, a half car), 0.025 to 0.038 by
# those of a smaller region.
LITTLE = 1e-3

_Span = tuple[str, str | None, tuple[Fraction, ...]]  # name, unit, and how much counts as one


@dataclass(frozen=True)
class Kind:
    """A kind of margin in words: what is off, and the units of all at once.

    ``of_ranges`` is the unit where there are parameters, ``bare`` without; ``per_second`` says that
    the unit of one is a parameter's a second.
    """

    words: str
    of_ranges: str
    bare: str
    per_second: bool = False

    def unit(self, of_one: str | None, ranged: bool, endless: bool = False) -> str:
        """Return the unit of a margin of one parameter, whose own is given, or of all at once.

        Parameters
        ----------
        ranged : bool
            Whether there are parameters.
        endless : bool
            Whether any value whatever is proved.
        """
        if of_one is not None:
            return rate_text(of_one) if self.per_second else of_one
        return "" if endless else self.of_ranges if ranged else self.bare


KINDS = {
    "estimate": Kind("error of the estimate", "of each range", "of the weight"),
    "gain": Kind("error of each gain", "of its size", "of its size"),
    "rate": Kind("rate of change", "ranges/s", "1/s", per_second=True),
}


@dataclass(frozen=True, eq=False)
class _Task:
    """A design, the region to be kept, and what of both every claim needs.

    ``subject`` is the design that claims are made of, None where there is none; ``loops`` has
    one for each of its Lyapunov polynomials.
    """

    design: Design
    region: Region
    subject: Design | None

    @cached_property
    def loops(self) -> tuple[Balanced, ...]:
        return () if self.subject is None else balanced(self.subject, self.region)

    @property
    def in_parts(self) -> bool:
        """Whether the region is proved in parts of the box, and not on all of it at once."""
        return self.subject is not None and self.subject.certificate.in_parts

    @property
    def whole(self) -> _Task:
        """The same for claims that need one Lyapunov polynomial of all of the box."""
        return replace(self, subject=None) if self.in_parts else self

    @cached_property
    def firmer(self) -> tuple[_Task, ...]:
        """The same with the matrices of smaller regions, which are sought once for all margins."""
        others = firmer(self.design, self.region)
        return tuple(replace(self, subject=other).whole for other in others)

    @cached_property
    def flat(self) -> _Task:
        """The same of a plant whose curve is part of its remainder: inequalities are far fewer."""
        plant, subject = self.design.plant, None
        if plant.remainder is None or not plant.remainder.curve:
            return self
        wider = replace(plant, remainder=plant.remainder.flat)
        certificate = analyse(wider.at_rest, self.design.law, self.region).certificate
        if certificate is not None:
            subject = at_rest(certificate, wider)
        return replace(self, subject=subject).whole

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.design.plant.parameters

    @property
    def fixed(self) -> bool:
        return self.design.law.fixed or not self.design.law.degree

    def spans(self) -> Iterator[_Span]:
        """Yield name, unit and span: of each parameter alone, and of all at once."""
        spans = [p.high - p.low for p in self.parameters]
        for f, p in enumerate(self.parameters):
            alone = tuple(s if f == g else Fraction(0) for g, s in enumerate(spans))
            yield p.name, unit_text(p.unit), alone
        if len(spans) != 1:
            yield "", None, tuple(spans) or (Fraction(1),)

    def proved(self, question: Question) -> MarginClaim | None:
        """Return the claim of what is proved, if anything is."""
        return None if self.subject is None else proved(question, self.subject, self.region)

    def margin(
        self,
        kind: str,
        name: str,
        claim: MarginClaim | None,
        *,
        unit: str | None = None,
        breaking: Callable[[float], Break | None] = lambda _: None,
        span: float = 1.0,
        design: Design | None = None,
    ) -> Margin:
        """Return the margin that a claim proves, with what breaks it: an error in spans."""
        proved = Fraction(0) if claim is None else claim.value(name)
        value = math.inf if proved is None else _down(proved)
        unit = KINDS[kind].unit(unit, bool(self.parameters), math.isinf(value))
        broken = breaking(value / span)
        upper, example = (broken.value * span, broken.example) if broken else (None, "")
        return Margin(kind, name, value, unit, upper, example, claim, design or self.subject)


def _roomier(task: _Task, questions: Callable[[_Task], Iterable[Question]]) -> _Task:
    """Return the task with the matrices of a smaller region where its own leave next to no room."""

    def room(one: _Task) -> float:
        if one.subject is None:
            return 0.0
        first = (next(climb(question), None) for question in questions(one))
        return max((reached.value for reached in first if reached is not None), default=0.0)

    return task if room(task) >= LITTLE else max((task, *task.firmer), key=room)


def _down(value: Fraction) -> float:
    """Return the nearest float that is not above."""
    near = float(value)
    return near if Fraction(near) <= value else math.nextafter(near, 0)


def require_service(design: Design, decay: float = 0.0, region: Region | None = None) -> Region:
    """Refuse what cannot be asked of a design in service, before any work; return what is kept.

    Raises
    ------
    InputError
        As `in_service` raises.
    """
    if not isinstance(design, Design):
        raise InputError(
            f"design must be a Design, not {type(design).__name__}; polefence.place returns one"
        )
    require_kind(design.certificate)
    design.plant.require_on_time(
        "of which no margins are proved",
        "design at a sample time, which takes it in",
    )
    kept = design.region if region is None else region
    if not isinstance(kept, Region):
        raise InputError(
            f"region = {region!r} is not a region; use for example polefence.Disk(-40, 31)"
        )
    kept = in_time_of(design.plant, kept)
    require_region(design.plant, kept)
    if not (isinstance(decay, int | float) and 0 <= decay < 1e100):
        raise InputError(f"decay = {decay!r} must be a rate of zero or more [1/s]")
    if decay and design.plant.sample_time is not None:
        raise InputError(
            f"decay = {decay:g}: {design.plant.name} is in discrete time, where no rates of change "
            "are proved; leave it out"
        )
    return kept


def _task(design: Design, region: Region | None, decay: float = 0.0) -> _Task:
    kept = require_service(design, decay, region)
    return _Task(design, kept, claimed_design(design, kept))


@explained
def in_service(design: Design, decay: float = 0.0, *, region: Region | None = None) -> Margins:
    """Return how much may go wrong in service while the poles stay in the region, proved.

    Parameters
    ----------
    design : Design
        Of any method. Of "slack", and of "lyapunov" where another region is kept, the law is first
        proved again with Lyapunov polynomials.
    decay : float
        What rates of change must leave of exponential stability [1/s].
    region : Region, optional
        What is to be kept; the design's own region without it. ``HalfPlane(0)`` asks for
        stability.

    Returns
    -------
    Margins
        Its margins: `estimation_error`, `gain_error` and `parameter_rate`. Where nothing is proved
        a margin is "undecided", its value zero.

    Raises
    ------
    InputError
        If the design or the region is none, or the design is an observer's.
    """
    task = _task(design, region, decay)
    still = task if task.region == design.region else _task(design, None)
    margins = (*_estimates(task), *_gains(task), *_rates(still, decay))
    return Margins(design, task.region, decay, margins)


@explained
def estimation_error(design: Design, *, region: Region | None = None) -> tuple[Margin, ...]:
    """Return how far the parameters that the law is given may be off.

    Returns
    -------
    tuple of Margin
        For each parameter with all others exact, in its own unit, and for all at once as a share of
        each range. Without parameters: the share of weight that alpha may mislay (half the sum of
        |alpha_j - estimate_j|). For one gain there are none: it needs no estimate.

    Raises
    ------
    InputError
        If the design or the region is none, or the design is an observer's.
    """
    return _estimates(_task(design, region))


@explained
def gain_error(design: Design, *, region: Region | None = None, own_states: bool = False) -> Margin:
    """Return how far each gain may be off, all at once, as a share of its size.

    K(alpha) + Delta, of what the law measures or of all states, keeps the poles in the region for
    every Delta of |Delta_ij| <= value * k_ij, k_ij the largest |K_ij| at the corners: gains that
    are zero are exact. ``claim.sizes`` has the k_ij.

    Parameters
    ----------
    own_states : bool
        Not the gains of the inputs but those of the rates of the law's own states, its A_c and
        B_c. Either takes the others as exact.

    Raises
    ------
    InputError
        If the design or the region is none, or the design is an observer's.
    """
    task = _task(design, region)
    return _gain(task, OF_STATES if own_states else "", Gains.of(task.design, own_states))


@stage(KINDS["gain"].words)
def _gains(task: _Task) -> tuple[Margin, ...]:
    of_states = Gains.of(task.design, of_states=True)
    of_inputs = _gain(task, "", Gains.of(task.design))
    return (of_inputs, _gain(task, OF_STATES, of_states)) if of_states.some else (of_inputs,)


def _gain(task: _Task, name: str, gains: Gains) -> Margin:
    if not gains.some:
        return task.margin("gain", name, None)
    claim, design = each_gain_claim(task.design, task.region, gains) or (None, task.subject)

    def breaking(least: float) -> Break | None:
        return gain_break(task.design, task.region, gains, least)

    return task.margin("gain", name, claim, breaking=breaking, design=design)


@explained
def parameter_rate(design: Design, decay: float = 0.0) -> tuple[Margin, ...]:
    """Return how fast the parameters may change, the law following them without error.

    For every trajectory of the parameters within these rates the loop is exponentially stable: the
    norm of x(t) is at most c exp(-decay t) times that of x(0), by V = x' W^-1 x. This is about the
    motion, not about the poles of frozen plants.

    Parameters
    ----------
    decay : float
        [1/s], zero or more.

    Returns
    -------
    tuple of Margin
        For each parameter while the others are constant, in its own unit per second, and for all at
        once in ranges per second. Without parameters: half the sum of abs(d alpha_j / dt) [1/s].
        For one gain "any": no rate is too large. None for plants in discrete time.

    Raises
    ------
    InputError
        If the decay rate is negative, or the design none.
    """
    return _rates(_task(design, None, decay), decay)


def _rates(task: _Task, decay: float) -> tuple[Margin, ...]:
    task = task.whole
    if task.design.plant.sample_time is not None:
        return ()
    together: _Span = ("", None, tuple(p.high - p.low for p in task.parameters) or (Fraction(1),))
    if any(loop.constant for loop in task.loops):  # no rate is too large
        joint = _rate(task, decay, *together)
        if math.isinf(joint.value):
            return (joint,)
    task = _roomier(task, lambda one: _of_parts(one, together[2], decay))
    spans = [together] if task.fixed and not task.loops else list(task.spans())
    return tuple(_rate(task, decay, *span) for span in counted(spans, KINDS["rate"].words))


def _rate(
    task: _Task, decay: float, name: str, unit: str | None, span: tuple[Fraction, ...]
) -> Margin:
    """Return the largest rate that the Lyapunov polynomial of any part of the region proves."""
    claims = [task.proved(question) for question in _of_parts(task, span, decay)]

    def value(claim: MarginClaim) -> float:
        rate = claim.value(name)
        return math.inf if rate is None else float(rate)

    best = max((claim for claim in claims if claim is not None), key=value, default=None)
    return task.margin("rate", name, best, unit=unit)


def _of_parts(task: _Task, span: tuple[Fraction, ...], decay: float) -> Iterator[RateQuestion]:
    """Yield the question of a rate by the Lyapunov polynomial of each part of the region."""
    for part, loop in enumerate(task.loops):
        yield RateQuestion(loop, part, task.parameters, span, decay)


def _estimates(task: _Task) -> tuple[Margin, ...]:
    spans = [] if task.fixed else list(task.spans())
    if not spans:
        return ()
    joint_span = spans[-1][2]
    whole = _roomier(
        task.whole, lambda one: [EstimateQuestion(one.loops, one.parameters, joint_span)]
    )
    margins = [_estimate(whole, *span) for span in counted(spans, KINDS["estimate"].words)]
    if len(margins) < 2:
        return tuple(margins)
    *single, joint = margins  # what breaks by one alone breaks by all at once
    for margin, (_, _, span) in zip(single, spans, strict=False):
        share = None if margin.upper is None else margin.upper / float(max(span))
        if share is not None and (joint.upper is None or share < joint.upper):
            joint = replace(joint, upper=share, example=margin.example)
    return (*single, joint)


def _estimate(task: _Task, name: str, unit: str | None, span: tuple[Fraction, ...]) -> Margin:
    question = EstimateQuestion(task.loops, task.parameters, span)
    if question.count(*question.ladder[0]) > MOST:
        task = task.flat
        question = EstimateQuestion(task.loops, task.parameters, span)
    claim = task.proved(question)

    def breaking(least: float) -> Break | None:
        return estimate_break(task.design, task.region, span, least)

    width = float(max(span)) if name else 1.0
    return task.margin("estimate", name, claim, unit=unit, breaking=breaking, span=width)


@dataclass(frozen=True, eq=False, repr=False)
class Margin(Short):
    """Largest tolerated error of one kind.

    Attributes
    ----------
    kind : str
        "estimate", "gain" or "rate".
    parameter : str
        The parameter meant, the others exact or constant; "" for all at once, and for the gains of
        the inputs; "law states" for those of the rates of the law's own states.
    value : float
        What is proved, in ``unit``; zero where nothing is; infinite for any rate whatever.
    unit : str
    upper : float, optional
        An error at which a pole does leave the region, in exact arithmetic; None where none was
        found. For rates, none is looked for.
    example : str
        Where it does.
    claim : Estimate, EachGain or Rate of `polefence.proof.claims`, optional
        What was proved; None where nothing was.
    design : Design, optional
        The one that the claim is of: for a law whose own proof does not serve, the same law, proved
        again.
    """

    kind: str
    parameter: str
    value: float
    unit: str
    upper: float | None = None
    example: str = ""
    claim: MarginClaim | None = None
    design: Design | None = None

    def file(self, design: Design) -> Document:
        """Return the file of what is proved of a design."""
        claimed = self.design or design
        return claimed.certificate.file([self.claim] if self.claim else [])

    def __repr__(self) -> str:
        return f"<Margin {self}>"

    @property
    def proved(self) -> bool:
        """Whether a value is proved."""
        return self.claim is not None

    @property
    def answer(self) -> str:
        """Say "proved" or "undecided"."""
        return "proved" if self.proved else "undecided"

    @property
    def status(self) -> str:
        """The old name of ``answer``."""
        warn_renamed("Margin.status", "Margin.answer")
        return self.answer

    @property
    def name(self) -> str:
        """A short name, that of the file: "estimate-m1", "gain"."""
        return f"{self.kind}-{self.parameter.replace(' ', '-')}" if self.parameter else self.kind

    @property
    def subject(self) -> str:
        """Its name, for people."""
        what = KINDS[self.kind].words
        if self.kind == "gain":
            return f"{what}, {self.parameter}" if self.parameter else what
        return f"{what}, {self.parameter or 'all at once'}"

    def __str__(self) -> str:
        upper = "" if self.upper is None else f", breaks at {digits_up(self.upper, 4)}"
        return f"{self.subject}: {self.text} {self.unit}".rstrip() + upper

    @property
    def text(self) -> str:
        """The value, rounded down so that it stays true as printed."""
        if self.claim is None:
            return "-"
        exact = self.claim.value(self.parameter)  # an interval's width, 0.2, is not a float
        return "any" if exact is None else digits_down(exact, 4) if exact else "0"


@dataclass(frozen=True, eq=False, repr=False)
class Margins(Short):
    """Tolerated errors: all poles stay in the region; iterates over its margins.

    Attributes
    ----------
    design : Design
    region : Region
        What is kept: the design's own region, or the one asked for.
    decay : float
        What the rates of change leave of exponential stability [1/s].
    margins : tuple of Margin
    """

    design: Design
    region: Region
    decay: float
    margins: tuple[Margin, ...]

    def __repr__(self) -> str:
        return (
            f"<Margins of {self.design.plant.name!r} in {self.region}: {len(self.margins)} margins>"
        )

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        rows = ((one.subject, f"{one.text} {one.unit}, {one.answer}") for one in self.margins)
        return card(f"margins of {self.design.plant.name}", rows)

    def __str__(self) -> str:
        return "\n".join(str(margin) for margin in self.margins)

    def __iter__(self) -> Iterator[Margin]:
        return iter(self.margins)

    def __getitem__(self, name: str) -> Margin:
        """Return the margin of a name, as "estimate-m1"."""
        return next(m for m in self.margins if m.name == name)

    @property
    def proved(self) -> bool:
        """Whether every margin is proved."""
        return all(margin.proved for margin in self.margins)

    def file(self, margin: Margin) -> Document:
        """Return the file of a margin that is proved."""
        return margin.file(self.design)

    def save(self, directory: str | Path) -> list[Path]:
        """Write one file for each proved margin into a folder; return their paths.

        Raises
        ------
        OutputError
            If the folder cannot be written; nothing is left half-written.
        """
        documents = {
            f"{margin.name}.json": self.file(margin).dumps()
            for margin in self.margins
            if margin.proved
        }
        return write_documents(Path(directory), documents)
