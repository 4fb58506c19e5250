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
from polefence.design.certificate import Certificate, Check
from polefence.design.design import Design, check
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
    from polefence.design import many
    from polefence.design.given import analyse, worst_case
    from polefence.design.limits import Limit, limits
    from polefence.design.margins import estimation_error, gain_error, in_service, parameter_rate
    from polefence.design.observer import observe
    from polefence.design.progress import progress
    from polefence.design.requirements.energy_peak import EnergyPeak
    from polefence.design.requirements.gain import Gain
    from polefence.design.requirements.gain_norm import GainNorm
    from polefence.design.requirements.initial_peak import InitialPeak
    from polefence.design.requirements.relative_rms import RelativeRms
    from polefence.design.requirements.rms import Rms
    from polefence.design.requirements.saturation import Saturation
    from polefence.design.requirements.specification import Specification
    from polefence.design.requirements.text import load_specifications, parse_specification
    from polefence.design.signals.optimise import Optimised, optimise
    from polefence.design.signals.placed import place, tightest
    from polefence.design.signals.refutation import refute_limits
    from polefence.design.signals.semi_active import semi_active
    from polefence.design.signals.tradeoff import tradeoff
    from polefence.design.verify import Verified, verify
    from polefence.fleet.run import study
    from polefence.law.control import from_control, to_control
    from polefence.law.structure import Structure, load_structure
    from polefence.plant.larger import with_actuator, with_sensor
    from polefence.plant.linearise import Linearised, linearise
    from polefence.region.text import load_region
    from polefence.response.control import closed_loops
    from polefence.response.samples import at_sample_time
    from polefence.show import plots

# Loaded when they are first asked for, so that the rest is there at once.
_LATER = {
    "at_sample_time": "polefence.response.samples",
    "analyse": "polefence.design.given",
    "worst_case": "polefence.design.given",
    "place": "polefence.design.signals.placed",
    "tightest": "polefence.design.signals.placed",
    "Limit": "polefence.design.limits",
    "limits": "polefence.design.limits",
    "estimation_error": "polefence.design.margins",
    "gain_error": "polefence.design.margins",
    "in_service": "polefence.design.margins",
    "parameter_rate": "polefence.design.margins",
    "observe": "polefence.design.observer",
    "processes": "polefence.base.workers",
    "progress": "polefence.design.progress",
    "GainNorm": "polefence.design.requirements.gain_norm",
    "Optimised": "polefence.design.signals.optimise",
    "optimise": "polefence.design.signals.optimise",
    "refute_limits": "polefence.design.signals.refutation",
    "semi_active": "polefence.design.signals.semi_active",
    "EnergyPeak": "polefence.design.requirements.energy_peak",
    "Gain": "polefence.design.requirements.gain",
    "InitialPeak": "polefence.design.requirements.initial_peak",
    "RelativeRms": "polefence.design.requirements.relative_rms",
    "Rms": "polefence.design.requirements.rms",
    "Saturation": "polefence.design.requirements.saturation",
    "Specification": "polefence.design.requirements.specification",
    "load_specifications": "polefence.design.requirements.text",
    "parse_specification": "polefence.design.requirements.text",
    "tradeoff": "polefence.design.signals.tradeoff",
    "Verified": "polefence.design.verify",
    "verify": "polefence.design.verify",
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
    "many": "polefence.design.many",
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
