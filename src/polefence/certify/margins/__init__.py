"""Margins in service: wrong estimates, a wrong gain, moving parameters; proved."""

from polefence.certify.margins.service import (
    Margin,
    Margins,
    estimation_error,
    gain_error,
    in_service,
    parameter_rate,
)

__all__ = [
    "Margin",
    "Margins",
    "estimation_error",
    "gain_error",
    "in_service",
    "parameter_rate",
]
