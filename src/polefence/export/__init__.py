"""A law on a microprocessor: C99, FMU, MATLAB; what rounding and sampling leave of the claim."""

from polefence.export.documents import check_guarantee
from polefence.export.exported import Exported, export_c99, with_fmus
from polefence.export.guarantee import Guarantee, Timing
from polefence.export.observer import SampledLoop
from polefence.export.program import Program
from polefence.export.sampled import LargestSampleTime, SampledProof, SamplingEffect
from polefence.export.sources import Texts
from polefence.response.discrete import Sampling

__all__ = [
    "Exported",
    "Guarantee",
    "LargestSampleTime",
    "Program",
    "SampledLoop",
    "SampledProof",
    "Sampling",
    "SamplingEffect",
    "Texts",
    "Timing",
    "check_guarantee",
    "export_c99",
    "with_fmus",
]
