"""How much may go wrong in service: wrong estimates, a wrong gain, moving parameters; proved."""

from polefence.service.files import check_service, is_service_file, service_plant
from polefence.service.margins import Margin, Service
from polefence.service.search import estimation_error, gain_error, in_service, parameter_rate

__all__ = [
    "Margin",
    "Service",
    "check_service",
    "estimation_error",
    "gain_error",
    "in_service",
    "is_service_file",
    "parameter_rate",
    "service_plant",
]
