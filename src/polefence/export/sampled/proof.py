"""Decay of a sampled loop, proved for every parameter value."""

from __future__ import annotations

import time
from dataclasses import dataclass

from polefence.design.certificate import Check
from polefence.design.design import Design
from polefence.export.sampled.held import require_usable
from polefence.export.sampled.poles import sampling
from polefence.export.sampled.search import Search, above
from polefence.proof.rounding import Rounded, rounding_error
from polefence.proof.sampling import Off, Sampled, prove_sampling


@dataclass(frozen=True, eq=False)
class SampledProof:
    """What is proved of a loop closed by samples.

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
    claim : Sampled, optional
        What was proved; None where nothing is.
    reason : str
        Why not; empty where it is proved.
    seconds : float
        Taken to find and prove it [s].
    """

    sample_time: float
    delay: int
    decay: float
    sampled: float
    claim: Sampled | None
    reason: str
    seconds: float

    @property
    def proved(self) -> bool:
        """Whether a positive decay rate is proved."""
        return self.claim is not None

    def check(self) -> Check:
        """Prove the claim afresh, in exact arithmetic."""
        if self.claim is None:
            return Check("undecided", self.reason)
        verdict = prove_sampling(self.claim)
        return Check("proved" if verdict.proved else "undecided", verdict.reason)


def prove_decay(
    design: Design, sample_time: float, delay: int = 1, off: Off | None = None
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
    off : Off, optional
        An error of the gain to be tolerated besides, such as that of rounding: `off_by_rounding`.

    Raises
    ------
    InputError
        If the plant is a discrete-time one, or the sample time not positive.
    """
    start = time.perf_counter()
    seconds = require_usable(design, sample_time, delay)
    slowest = sampling(design, seconds, delay).decay
    claim, reason = None, "the sampled loop is not stable for all parameter values"
    if slowest > 0:
        search = Search(design, seconds, delay, slowest, off)
        claim, reason = search.run()
    decay = float(claim.decay) if claim else 0.0
    taken = time.perf_counter() - start
    return SampledProof(seconds, delay, decay, slowest, claim, reason, taken)


def off_by_rounding(claim: Rounded) -> Off:
    """Return what the code's rounding puts on the gain, for `prove_decay`."""
    error = above(float(rounding_error(claim)))
    return Off(error, claim.gain.rows, claim.gain.right)
