"""The loop that a computer closes: its poles over a sample of the family, its decay proved."""

from polefence.export.sampled.poles import (
    LargestSampleTime,
    Sampling,
    largest_sample_time,
    sampled_poles,
    sampling,
)
from polefence.export.sampled.proof import SampledProof, off_by_rounding, prove_decay

__all__ = [
    "LargestSampleTime",
    "SampledProof",
    "Sampling",
    "largest_sample_time",
    "off_by_rounding",
    "prove_decay",
    "sampled_poles",
    "sampling",
]
