"""Margins in service: wrong estimates, a wrong gain, moving parameters; proved."""

from polefence.design.margins.result import Margin, Service
from polefence.design.margins.search import estimation_error, gain_error, in_service, parameter_rate

__all__ = [
    "Margin",
    "Service",
    "estimation_error",
    "gain_error",
    "in_service",
    "parameter_rate",
]
