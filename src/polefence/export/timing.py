"""All that is said of the loop that a computer closes: sampled, and proved in ``sampled.json``.

That file, beside ``guarantee.json``, is about the same code: see `polefence.export.decay`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from polefence.base.errors import InputError
from polefence.certify.design import Design
from polefence.export.decay import SampledProof, decay_of, prove_decay
from polefence.export.observer import SampledLoop, judge_sampled_loop
from polefence.export.program import Program
from polefence.export.sampled import (
    LargestSampleTime,
    SamplingEffect,
    largest_sample_time,
    sampling_effect,
)
from polefence.proof.claims.rounding import Code, Rounded
from polefence.proof.claims.samples import Samples
from polefence.proof.document import Document
from polefence.proof.matrices import Rationals
from polefence.proof.short import Short
from polefence.proof.text import late_text, milliseconds_text
from polefence.region.text import digits_down
from polefence.response.discrete import Sampling
from polefence.search.observer import Observer


def decay_in(document: Document, claim: Rounded) -> tuple[Samples, float]:
    """Return what ``sampled.json`` is about, the samples of a plant, and the decay rate [1/s].

    Raises
    ------
    InputError
        If it is not about this code in a loop with the samples of its plant.
    """
    samples, held = document.first(Samples), document.first(Rounded)
    if samples is None or held is None:
        raise InputError("claims of the samples and of the code's rounding are missing")
    if not _same_plant(samples, claim):
        raise InputError("its plant is not the samples of the plant of guarantee.json")
    if not _same_code(held, claim, samples):
        raise InputError("its law is not the code's")
    region = held.gain.subject.design.region
    if len(region) != 1 or (region[0].kind, region[0].numbers[0]) != ("disk", 0):
        raise InputError("its region must be a disk around zero")
    return samples, decay_of(region[0].numbers[1], document.plant.step)


def _same_plant(samples: Samples, claim: Rounded) -> bool:
    """Whether the samples are those of the plant, without the states that the code keeps."""
    design, memory = claim.gain.subject.design, claim.code.memory
    kept = memory.states if memory else 0
    n, m = len(design.A[0]) - kept, len(design.B[0][0]) - kept
    A, B = ([[row[:k] for row in M[:n]] for M in Ms] for Ms, k in ((design.A, n), (design.B, m)))
    # the decay is proved for constant parameters, whatever the region's proof is for
    ranges = tuple(replace(parameter, rate=None) for parameter in claim.gain.subject.ranges)
    same = (samples.A, samples.B, samples.plant.ranges) == (A, B, ranges)
    whole = samples.delay in (0, 1) and not samples.early
    return same and whole and samples.plant.n == n + kept + samples.delay * m


def _same_code(held: Rounded, claim: Rounded, samples: Samples) -> bool:
    """Whether one code is the other, but that it reads inputs on their way with gains of zero."""
    code, plain, n, late = held.code, claim.code, samples.n, samples.width - samples.n
    laws = [rounded.gain.subject.design.law for rounded in (held, claim)]
    sizes = [rounded.gain.subject.design.sizes for rounded in (held, claim)]
    told = [(law.degree, law.powers, law.measured) for law in laws]
    if (code.bits, code.shares, _scales(code)) != (plain.bits, plain.shares, _scales(plain)):
        return False
    if code.G != plain.G:
        return False
    # at products of the parameters' weights a law of degree one is the same on box and simplex
    alike = plain.K is not None or (plain.T is not None and told[0][0] == 1)
    if told[0] != told[1] or (sizes[0] != sizes[1] and not alike):
        return False
    kept = [memory and (memory.states, memory.step) for memory in (code.memory, plain.memory)]
    time = samples.plant.step if plain.memory is None else plain.memory.sample_time
    if kept[0] != kept[1] or float(time) != float(samples.plant.step):
        return False
    signals = [() if one.scales is None else one.scales.signals for one in (code, plain)]
    if laws[1].C:  # of signals that are measured
        if signals[0] != signals[1]:
            return False
        same = len(laws[0].C) == len(laws[1].C)
        pairs = zip(laws[0].C, laws[1].C, strict=False)
        same = same and all(list(C) == _spread(D, n, late) for C, D in pairs)
        return same and (code.K, code.terms) == (plain.K, plain.terms)
    spread = (*signals[1][:n], *[0] * late, *signals[1][n:]) if signals[1] else ()
    if laws[0].C or signals[0] != spread:
        return False
    if plain.T is None:
        K = None if plain.K is None else _spread(plain.K, n, late)
        return (code.K, list(code.terms)) == (K, [_spread(k, n, late) for k in plain.terms])
    columns = [() if one.scales is None else one.scales.columns for one in (code, plain)]
    if columns[0][:n] != columns[1]:
        return False
    squares = [(code.T or [], plain.T), *zip(code.W, plain.W, strict=True)]
    apart = all(_is_apart(wide, narrow) for wide, narrow in squares)
    L = None if plain.L is None else _spread(plain.L, n, late)
    return apart and code.L == L and list(code.Z) == [_spread(z, n, late) for z in plain.Z]


def _scales(code: Code) -> tuple[tuple[int, ...], ...]:
    """Return the exponents of fixed-point code, but those of signals and of columns of T."""
    fixed = code.scales
    if fixed is None:
        return ()
    others = fixed.beyond, fixed.recovering
    return fixed.given, fixed.rows, fixed.answers, fixed.solving, *others


def _spread(matrix: Sequence[Sequence[Fraction]], n: int, late: int) -> Rationals:
    """Return a matrix with columns of zeros behind n."""
    return [[*row[:n], *[Fraction(0)] * late, *row[n:]] for row in matrix]


def _is_apart(wide: Rationals, narrow: Rationals) -> bool:
    """Whether a square matrix is another, and something else without a part in it."""
    n = len(narrow)
    inside = [row[:n] for row in wide[:n]] == narrow
    return (
        inside and not any(any(r[n:]) for r in wide[:n]) and not any(any(r[:n]) for r in wide[n:])
    )


# --- all that is found at a sample time ----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Timing(Short):
    """The loop as a computer closes it, sampled over the family and proved.

    Attributes
    ----------
    sampling : SamplingEffect
        Where its poles lie, at sampled parameters.
    proof : SampledProof
        How fast it decays at least, for all parameters.
    largest : LargestSampleTime
        Up to which sample times region and stability hold, found by trial.
    with_observer : SampledLoop, optional
        The loop that an observer closes, at sampled parameters.
    """

    sampling: SamplingEffect
    proof: SampledProof
    largest: LargestSampleTime
    with_observer: SampledLoop | None = None

    @property
    def proved(self) -> bool:
        """Whether a decay rate is proved, and a loop with an observer was found stable."""
        return self.proof.proved and (self.with_observer is None or self.with_observer.stable)

    @property
    def reason(self) -> str:
        """Why it is not proved."""
        time = f"run every {milliseconds_text(Fraction(self.sampling.sample_time))} ms{self.late}"
        if not self.proof.proved:
            longest = milliseconds(self.largest.stable)
            options = f"--sample-time {self.sampling.sample_time:g}"
            options += f" --delay {self.sampling.delay}"
            return (
                f"{time}: {self.proof.reason}; it was found stable up to {longest}; take a shorter "
                f"--sample-time, or design a law for this one: polefence optimise SPEC {options}"
            )
        return f"{time}, the loop with the observer is not stable; choose a shorter --sample-time"

    @property
    def late(self) -> str:
        """Say in words how late u is."""
        return ", u one step late" if self.sampling.delay else ""


def milliseconds(time: float) -> str:
    """Return a time found by trial, rounded down."""
    return f"{digits_down(1e3 * time, 3)} ms" if time > 0 else "no sample time tried"


def require_timing(design: Design, sampling: Sampling) -> None:
    """Refuse a sample time, or a delay, that code of a design cannot have.

    Raises
    ------
    InputError
    """
    if design.plant.sample_time is not None:
        raise InputError(
            "the plant is in discrete time: its own sample time holds; leave the sample time out"
        )
    late = sampling.lateness
    if late.samples not in (0, 1):
        raise InputError(
            f"inputs {late_text(late.samples)}: the code of a law of continuous time acts 0 or 1 "
            "sample late; design the law at the sample time for another delay"
        )


def timing(
    design: Design, sampling: Sampling, program: Program, observer: Observer | None
) -> Timing:
    """Judge the loop that a computer closes at its samples, rounding included.

    Raises
    ------
    InputError
        If the plant is in discrete time, or the sample time cannot be used.
    """
    require_timing(design, sampling)
    sample_time, delay = sampling.period, sampling.lateness.whole
    beside = (
        None if observer is None else judge_sampled_loop(design, observer, sample_time, delay=delay)
    )
    proof = prove_decay(design, sample_time, delay, program)
    seen, largest = sampling_effect(design, sample_time, delay), largest_sample_time(design, delay)
    return Timing(seen, proof, largest, beside)
