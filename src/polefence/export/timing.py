"""Effect of a sample time, and of a delay of one step, on a design."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.design.observer import Observer
from polefence.export.guarantee import Guarantee
from polefence.export.sampled.observer_loop import SampledLoop, judge_sampled_loop
from polefence.export.sampled.poles import (
    LargestSampleTime,
    Sampling,
    largest_sample_time,
    sampling,
)
from polefence.export.sampled.proof import SampledProof, off_by_rounding, prove_decay
from polefence.proof.text import milliseconds_text
from polefence.region.text import digits_down


@dataclass(frozen=True, eq=False)
class Timing:
    """The loop as a computer closes it, sampled over the family and proved.

    Attributes
    ----------
    sampling : Sampling
        Where its poles lie, at sampled parameters.
    proof : SampledProof
        How fast it decays at least, for all parameters.
    largest : LargestSampleTime
        Up to which sample times region and stability hold, found by trial.
    with_observer : SampledLoop, optional
        The loop that an observer closes, at sampled parameters.
    """

    sampling: Sampling
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
            return f"{time}: {self.proof.reason}; it was found stable up to {longest}"
        return f"{time}, the loop with the observer is not stable; choose a shorter --sample-time"

    @property
    def late(self) -> str:
        """Say in words how late u is."""
        return ", u one step late" if self.sampling.delay else ""


def milliseconds(time: float) -> str:
    """Return a time found by trial, rounded down."""
    return f"{digits_down(1e3 * time, 3)} ms" if time > 0 else "no sample time tried"


def timing(
    design: Design, sample_time: float, delay: int, found: Guarantee, observer: Observer | None
) -> Timing:
    """Judge the loop that a computer closes every ``sample_time``, rounding included.

    Raises
    ------
    InputError
        If the plant is in discrete time, or sample time or delay cannot be used.
    """
    if design.plant.sample_time is not None:
        raise InputError("the plant is in discrete time: its own sample time holds; give none")
    beside = (
        None if observer is None else judge_sampled_loop(design, observer, sample_time, delay=delay)
    )
    off = None if found.claim is None else off_by_rounding(found.claim)
    proof = prove_decay(design, sample_time, delay, off)
    seen, largest = sampling(design, sample_time, delay), largest_sample_time(design, delay)
    return Timing(seen, proof, largest, beside)
