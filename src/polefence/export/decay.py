"""The code's law in the loop that a computer closes: its decay proved, rounding included.

The plant at its samples is a plant in discrete time, and the law one of its states: see
`polefence.certify.at_samples`. What is proved of both is the ordinary claim about the rounding of
code, of a disk around zero. Inputs on their way are states there whose gain is zero: the code that
the claim is about reads them, and is otherwise the one exported. Zeros that it adds are exact.

No disk is kept that a sample of the family leaves. So disks a little larger than its are tried, by
shares of its decay: in floats first, of Lyapunov polynomials of growing degree, then exactly. Where
samples are known at nodes, the polynomials are those of parts of the box, of a disk between.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.base.explained import explained
from polefence.base.progress import stage
from polefence.certify.at_samples import at_samples
from polefence.certify.candidates import Deadline
from polefence.certify.certificate import Check
from polefence.certify.design import Design
from polefence.certify.evidence import (
    Search,
    certificate_of,
    forms,
    placeholder,
    whole_evidence,
)
from polefence.certify.margins.bordered import GainQuestion
from polefence.certify.margins.claims import Reached
from polefence.export.guarantee import Guarantee, Rounding, roundings
from polefence.export.memory import kept
from polefence.export.program import (
    Fixed,
    Polynomial,
    Program,
    amid,
    code_law,
    number,
    with_memory,
)
from polefence.export.program import program as program_of
from polefence.export.sampled import require_usable, sampling_effect
from polefence.export.words import with_late
from polefence.law.laws import Law
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.loops import loop_of
from polefence.lmi.solve.lyapunov import least
from polefence.plant.family import UncertainPlant
from polefence.proof.document import Document
from polefence.proof.short import Short
from polefence.proof.work import FormatError
from polefence.region.regions import Disk

# Shares of the decay found at many parameter values that a proof may fall short by; the largest
# that ends the search, and the one that ends it before the higher degrees, of which the searches
# take ten times as long. With the rounding of float32 laws of nine plants fell short by 0.1 %.
SHORT_BY = (1e-4, 3e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1, 0.2, 0.4, 0.8)
AIM = 5e-4  # share of it at which Lyapunov polynomials are looked for
# The same of those in parts of the box, where the whole box has none. The van's law of order 2 is
# proved up to 99 % of the longest stable sample time, in 10 to 38 s; by a first share of 0.1 it
# takes 37 s at 65 %, and more work than is checked at 95 %.
IN_PARTS = (0.4, 0.8)


@dataclass(frozen=True, eq=False)
class SampledProof(Short):
    """Proof of the decay of a loop closed by samples.

    Attributes
    ----------
    sample_time : float
        [s]
    delay : int
        In samples.
    decay : float
        For every parameter value all poles of the sampled loop have |z| < exp(-decay sample_time):
        every motion dies out at least as fast as exp(-decay t) [1/s]; zero where nothing is proved.
    sampled : float
        The slowest decay found at many parameter values, an upper bound on what can be proved
        [1/s]; not positive where the loop is not stable.
    rounded : Guarantee, optional
        What is proved of the code: its design is the plant at its samples, the law of their states
        and the disk. None where nothing is.
    reason : str
        Why not; empty where it is proved.
    seconds : float
        Taken to find and prove it [s].
    """

    sample_time: float
    delay: int
    decay: float
    sampled: float
    rounded: Guarantee | None
    reason: str
    seconds: float

    @property
    def proved(self) -> bool:
        """Whether a positive decay rate is proved."""
        return self.rounded is not None

    def check(self) -> Check:
        """Prove the claim afresh, in exact arithmetic."""
        return Check("undecided", self.reason) if self.rounded is None else self.rounded.check()

    def file(self) -> Document:
        """Return what is proved, as a file of claims.

        Raises
        ------
        InputError
            If nothing is.
        """
        if self.rounded is None:
            raise InputError(f"nothing is proved of the sampled loop: {self.reason}")
        return file_of(self.rounded)


def file_of(rounded: Guarantee) -> Document:
    """Return what is proved of the code in a sampled loop as a file of claims."""
    claims = [] if rounded.claim is None else [rounded.claim]
    return rounded.design.certificate.file(claims)


@explained
@stage("decay of the sampled loop")
def prove_decay(
    design: Design, sample_time: float, delay: int = 1, program: Program | None = None
) -> SampledProof:
    """Prove how fast the loop decays that a computer closes every ``sample_time``.

    The input is held between samples; with ``delay`` = 1 it is u[k] = K x[k-1]. The proof is exact,
    for every parameter value, or every alpha of a plant without parameters; the rate is the largest
    that was found, not the largest there is.

    Parameters
    ----------
    design : Design
        Of a plant in continuous time.
    sample_time : float
        [s]
    delay : int
        0 or 1 samples.
    program : Program, optional
        The law as code computes it, whose rounding is in the proof; by default in doubles.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the sample time not positive.
    """
    start = time.perf_counter()
    seconds = require_usable(design, sample_time, delay)
    slowest = sampling_effect(design, seconds, delay).decay
    if program is None:
        order, parameters = kept(design), design.plant.parameters
        program = program_of(code_law(design.law), parameters, number(64))
        program = with_memory(amid(program, code_law(design.law)), order, seconds)
    rounded, reason = None, "the sampled loop is not stable for all parameter values"
    if slowest > 0:
        rounded, reason = _proved(design, seconds, delay, slowest, program)
    decay = 0.0 if rounded is None else _decay(rounded.design)
    return SampledProof(
        seconds, delay, decay, slowest, rounded, reason, time.perf_counter() - start
    )


def _proved(
    design: Design, sample_time: float, delay: int, slowest: float, program: Program
) -> tuple[Guarantee | None, str]:
    """Return what is proved of the least disk; or None, and why not."""
    try:
        finest = design.plant.at_rest, code_law(design.law), sample_time, delay, 1e-5
        plant, law = at_samples(*finest)
        wide = _wider(program, law, design, plant.shape[0])
        unit = Design(certificate_of(plant, law, Disk(0.0, 1.0), [placeholder(plant, law)]))
        errors, tried = roundings(unit, wide), () if plant.bent else tuple(forms(plant, law))
    except (InputError, FormatError) as problem:
        return None, f"no proof was found: {problem}"
    return _Search(plant, law, slowest * sample_time, errors, tried).run()


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the least disk that is proved of a loop whose decay in a sample is known."""

    plant: UncertainPlant
    law: Law
    decay: float
    roundings: tuple[Rounding, ...]
    forms: tuple[tuple[int, int], ...]

    def run(self) -> tuple[Guarantee | None, str]:
        """Return what is proved; or None, and why not."""
        place, best = self._best()
        if best is None:
            return None, "no Lyapunov polynomial was found that leaves room for the code's rounding"
        reason = ""
        for short in SHORT_BY[place:]:
            rounded = best.proved(short)
            reason = rounded.reason or _unchecked(rounded)
            if not reason:
                return rounded, ""
        return None, f"not proved: {reason}"

    def _best(self) -> tuple[int, _Borne | None]:
        """Return the least place in `SHORT_BY` that floats bear, and by which polynomial."""
        place, best = len(SHORT_BY), None
        for form in self.forms:
            for evidence in self._candidates(form):
                found = self._borne(evidence)
                better = found.place(place)
                if better < place:
                    place, best = better, found
                if place < len(SHORT_BY) and SHORT_BY[place] <= 1e-3:
                    return place, best
            if form == (1, 1) and place < len(SHORT_BY) and SHORT_BY[place] <= 0.03:
                break
        for short in () if best else IN_PARTS:
            parts = self._in_parts(Disk(0.0, self._radius(short)))
            if parts is not None:
                found = self._borne(parts)
                return found.place(SHORT_BY.index(short)), found
        return place, best

    def _in_parts(self, region: Disk) -> dict[str, Any] | None:
        """Return evidence in parts of the box, in each of which rounding is borne in floats."""

        def holds(plant: UncertainPlant, law: Law, evidence: dict[str, Any]) -> bool:
            design = Design(certificate_of(plant, law, region, [evidence]))
            pairs = ((rounding, rounding.question(design)) for rounding in self.roundings)
            return any(q is not None and rounding.borne(q) is not None for rounding, q in pairs)

        return Search(self.plant, self.law, region, Deadline(None)).in_parts(holds)

    def _candidates(self, form: tuple[int, int]) -> Iterator[dict[str, Any]]:
        """Yield Lyapunov polynomials of one degree: as far as it reaches, and inside of that."""
        loop, short = loop_of(self.plant, self.law), AIM
        for times in (1.0, 2.0):
            with suppress(SolverError, np.linalg.LinAlgError):
                polynomial = least(loop, Disks(0.0), *form, enough=self._radius(short * times))
                yield whole_evidence(self.plant, self.law, polynomial, form)
                short = 1 + math.log(polynomial.r) / self.decay
                if short <= AIM:
                    return

    def _borne(self, evidence: dict[str, Any]) -> _Borne:
        """Return what a Lyapunov polynomial bears."""

        def design(short: float) -> Design:
            region = Disk(0.0, self._radius(short))
            return Design(certificate_of(self.plant, self.law, region, [evidence]))

        whole = design(0.0)
        questions = ((rounding, rounding.question(whole)) for rounding in self.roundings)
        return _Borne(
            design, tuple((one, question) for one, question in questions if question is not None)
        )

    def _radius(self, short: float) -> float:
        return math.exp(-(1 - min(short, 1.0)) * self.decay)


@dataclass(frozen=True, eq=False)
class _Borne:
    """Disks in which one Lyapunov polynomial bears the rounding of the code.

    ``design`` is that of a share of the decay given up; ``questions`` has the rounding in each of
    the scales tried, with what is tolerated in these.
    """

    design: Callable[[float], Design]
    questions: tuple[tuple[Rounding, GainQuestion], ...]

    def place(self, below: int) -> int:
        """Return the least place in `SHORT_BY` that floats bear, up to this one, by bisection."""
        low, high = 0, below
        while low < high:
            middle = (low + high) // 2
            borne = next(self._borne(self.design(SHORT_BY[middle])), None)
            low, high = (middle + 1, high) if borne is None else (low, middle)
        return low

    def proved(self, short: float) -> Guarantee:
        """Return what is proved in the first scales that bear it."""
        design = self.design(short)
        rounded = Guarantee(design, math.inf, 0.0, None, "rounding may be more than is tolerated")
        for rounding, question, reached in self._borne(design):
            rounded = rounding.proved(design, question, reached)
            if rounded.proved:
                break
        return rounded

    def _borne(self, design: Design) -> Iterator[tuple[Rounding, GainQuestion, Reached]]:
        for rounding, question in self.questions:
            own = question.of(design.region)
            reached = rounding.borne(own)
            if reached is not None:
                yield rounding, own, reached


def _unchecked(rounded: Guarantee) -> str:
    """Say why `check` would not prove a claim in its file, "" where it would."""
    claims = [] if rounded.claim is None else [rounded.claim]
    try:
        file_of(rounded).require_checkable(claims)
    except FormatError as problem:
        return str(problem)
    return ""


def _wider(program: Program, law: Law, design: Design, width: int) -> Program:
    """Return code that reads the inputs on their way too, with gains of zero."""
    n, late = design.plant.shape[0] - kept(design), width - design.plant.shape[0]
    if not late:
        return program
    if isinstance(program, Fixed | Polynomial) and program.measured:
        return program
    program = with_late(program, n, late)
    if isinstance(program, Fixed):
        return replace(program, K=np.insert(program.K, [n] * late, 0.0, axis=1))
    if isinstance(program, Polynomial):
        return replace(program, gains=np.insert(program.gains, [n] * late, 0.0, axis=2))
    added, width = np.arange(n, n + late), n + late
    T, W = np.zeros((width, width)), np.zeros((len(program.W), width, width))
    T[:n, :n], W[:, :n, :n] = program.T, program.W
    # powers of two, the same at all coefficients: see `at_samples`
    energy = law.form[0][added, added]
    half, scales = np.log2(energy) / 2, program.scales
    # integers have room up to one
    exponents = np.floor(half) if scales is None else np.ceil(half)
    if scales is not None:
        columns = (*scales.columns[:n], *(int(e) for e in exponents))
        program = replace(program, scales=replace(scales, columns=columns))
    scale = 2.0**-exponents
    T[added, added], W[:, added, added] = scale, energy * scale**2
    L = None if program.L is None else np.insert(program.L, [n] * late, 0.0, axis=1)
    return replace(program, T=T, W=W, Z=np.insert(program.Z, [n] * late, 0.0, axis=2), L=L)


def decay_of(radius: Fraction, sample_time: Fraction) -> float:
    """Return a little less than -log(radius) / sample_time [1/s]."""
    # in floats: no larger than the one proved
    return -math.log1p(-float(1 - radius)) / float(sample_time) * (1 - 1e-12)


def _decay(held: Design) -> float:
    """Return the decay rate of a disk at samples [1/s]."""
    (disk,) = held.certificate.claim().region
    return decay_of(disk.numbers[1], Fraction(held.plant.sample_time or 0))
