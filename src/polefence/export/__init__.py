"""A law on a microprocessor: C99, FMU, MATLAB; what rounding and sampling leave of the claim."""

from polefence.export.documents import check_guarantee
from polefence.export.exported import Exported, export_c99, with_fmus
from polefence.export.guarantee import Guarantee
from polefence.response.discrete import Sampling

__all__ = [
    "Exported",
    "Guarantee",
    "Sampling",
    "check_guarantee",
    "export_c99",
    "with_fmus",
]
