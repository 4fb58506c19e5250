"""A law on a microprocessor: C99, FMU, MATLAB; what rounding and sampling leave of the claim."""

from polefence.export.decay import SampledProof
from polefence.export.documents import check_guarantee
from polefence.export.exported import Exported, export_c99, with_board, with_fmus
from polefence.export.guarantee import Guarantee
from polefence.export.held import FixedCode, FloatCode
from polefence.export.observer import SampledLoop
from polefence.export.program import Program
from polefence.export.sampled import LargestSampleTime, SamplingEffect
from polefence.export.sources import Texts
from polefence.export.timing import Timing
from polefence.response.discrete import Sampling

__all__ = [
    "Exported",
    "FixedCode",
    "FloatCode",
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
    "with_board",
    "with_fmus",
]
