"""State feedback that keeps all poles in a region for all uncertain parameters, proved."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from polefence.base import VERSION
from polefence.base.errors import (
    DesignFileError,
    InputError,
    MultiAffinityError,
    NotProvedError,
    OutputError,
    PlantError,
    PolefenceError,
    SpecError,
    UncontrollableError,
)
from polefence.certify.certificate import Certificate, Check
from polefence.certify.design import Design, check
from polefence.law.laws import FixedGain, GainTable, PolynomialGain, ScheduledGain
from polefence.lmi.conditions.methods import METHODS, Scheduled, Slack, build
from polefence.lmi.solve.engine import engine
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.spec import load
from polefence.plant.system import System
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    Wedge,
)
from polefence.region.text import parse_region
from polefence.region.z_plane import z_plane

__version__ = VERSION

if TYPE_CHECKING:
    from polefence import examples, export, fleet, response, vehicle
    from polefence.base.workers import processes
    from polefence.certify.given import analyse, worst_case
    from polefence.certify.margins import estimation_error, gain_error, in_service, parameter_rate
    from polefence.certify.progress import progress
    from polefence.certify.refutation import refute_limits
    from polefence.certify.verify import Verified, verify
    from polefence.fleet.run import study
    from polefence.law.control import from_control, to_control
    from polefence.law.structure import Structure, load_structure
    from polefence.plant.larger import with_actuator, with_sensor
    from polefence.plant.linearise import Linearised, linearise
    from polefence.region.text import load_region
    from polefence.requirements.energy_peak import EnergyPeak
    from polefence.requirements.gain import Gain
    from polefence.requirements.gain_norm import GainNorm
    from polefence.requirements.initial_peak import InitialPeak
    from polefence.requirements.relative_rms import RelativeRms
    from polefence.requirements.rms import Rms
    from polefence.requirements.saturation import Saturation
    from polefence.requirements.specification import Specification
    from polefence.requirements.text import load_specifications, parse_specification
    from polefence.response.control import closed_loops
    from polefence.response.samples import at_sample_time
    from polefence.search import many
    from polefence.search.limits import Limit, limits
    from polefence.search.observer import observe
    from polefence.search.optimise import Optimised, optimise
    from polefence.search.placed import place, tightest
    from polefence.search.semi_active import semi_active
    from polefence.search.tradeoff import tradeoff
    from polefence.show import plots

# Loaded when they are first asked for, so that the rest is there at once.
_LATER = {
    "at_sample_time": "polefence.response.samples",
    "analyse": "polefence.certify.given",
    "worst_case": "polefence.certify.given",
    "place": "polefence.search.placed",
    "tightest": "polefence.search.placed",
    "Limit": "polefence.search.limits",
    "limits": "polefence.search.limits",
    "estimation_error": "polefence.certify.margins",
    "gain_error": "polefence.certify.margins",
    "in_service": "polefence.certify.margins",
    "parameter_rate": "polefence.certify.margins",
    "observe": "polefence.search.observer",
    "processes": "polefence.base.workers",
    "progress": "polefence.certify.progress",
    "GainNorm": "polefence.requirements.gain_norm",
    "Optimised": "polefence.search.optimise",
    "optimise": "polefence.search.optimise",
    "refute_limits": "polefence.certify.refutation",
    "semi_active": "polefence.search.semi_active",
    "EnergyPeak": "polefence.requirements.energy_peak",
    "Gain": "polefence.requirements.gain",
    "InitialPeak": "polefence.requirements.initial_peak",
    "RelativeRms": "polefence.requirements.relative_rms",
    "Rms": "polefence.requirements.rms",
    "Saturation": "polefence.requirements.saturation",
    "Specification": "polefence.requirements.specification",
    "load_specifications": "polefence.requirements.text",
    "parse_specification": "polefence.requirements.text",
    "tradeoff": "polefence.search.tradeoff",
    "Verified": "polefence.certify.verify",
    "verify": "polefence.certify.verify",
    "study": "polefence.fleet.run",
    "from_control": "polefence.law.control",
    "to_control": "polefence.law.control",
    "Structure": "polefence.law.structure",
    "load_structure": "polefence.law.structure",
    "Linearised": "polefence.plant.linearise",
    "linearise": "polefence.plant.linearise",
    "with_actuator": "polefence.plant.larger",
    "with_sensor": "polefence.plant.larger",
    "load_region": "polefence.region.text",
    "closed_loops": "polefence.response.control",
}
_ROOMS = {
    "examples": "polefence.examples",
    "export": "polefence.export",
    "fleet": "polefence.fleet",
    "many": "polefence.search.many",
    "plots": "polefence.show.plots",
    "response": "polefence.response",
    "vehicle": "polefence.vehicle",
}

__all__ = [
    "METHODS",
    "Certificate",
    "Check",
    "Design",
    "DesignFileError",
    "Disk",
    "Ellipse",
    "EnergyPeak",
    "FixedGain",
    "Gain",
    "GainNorm",
    "GainTable",
    "HalfPlane",
    "HorizontalStrip",
    "InitialPeak",
    "InputError",
    "Limit",
    "Linearised",
    "MultiAffinityError",
    "NotProvedError",
    "Optimised",
    "OutputError",
    "Parameter",
    "PlantError",
    "PolefenceError",
    "PolynomialGain",
    "RelativeRms",
    "Rms",
    "Saturation",
    "Scheduled",
    "ScheduledGain",
    "Sector",
    "Slack",
    "SpecError",
    "Specification",
    "Structure",
    "System",
    "UncertainPlant",
    "UncontrollableError",
    "Verified",
    "VerticalStrip",
    "Wedge",
    "analyse",
    "at_sample_time",
    "build",
    "check",
    "closed_loops",
    "engine",
    "estimation_error",
    "examples",
    "export",
    "fleet",
    "from_control",
    "gain_error",
    "in_service",
    "limits",
    "linearise",
    "load",
    "load_region",
    "load_specifications",
    "load_structure",
    "many",
    "observe",
    "optimise",
    "parameter_rate",
    "parse_region",
    "parse_specification",
    "place",
    "plots",
    "processes",
    "progress",
    "refute_limits",
    "response",
    "semi_active",
    "study",
    "tightest",
    "to_control",
    "tradeoff",
    "vehicle",
    "verify",
    "with_actuator",
    "with_sensor",
    "worst_case",
    "z_plane",
]


def __getattr__(name: str) -> Any:
    """Load what is asked for."""
    if name in _ROOMS:
        return import_module(_ROOMS[name])
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module 'polefence' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Name what there is, loaded or not, and nothing that is only imported here."""
    return sorted(__all__)
