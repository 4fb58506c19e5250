"""State feedback that keeps all poles in a region for all uncertain parameters, proved."""

from polefence.conditions.methods import METHODS, Scheduled, build
from polefence.design import Design, check
from polefence.errors import (
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
from polefence.law import FixedGain, ScheduledGain
from polefence.limits import Limit, limits
from polefence.placement import place, tightest
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.spec import load
from polefence.plant.system import System
from polefence.proof.certificate import Certificate, Check
from polefence.region import Disk
from polefence.solve.engine import engine

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "Certificate",
    "Check",
    "Design",
    "DesignFileError",
    "Disk",
    "FixedGain",
    "InputError",
    "Limit",
    "MultiAffinityError",
    "NotProvedError",
    "OutputError",
    "Parameter",
    "PlantError",
    "PolefenceError",
    "Scheduled",
    "ScheduledGain",
    "SpecError",
    "System",
    "UncertainPlant",
    "UncontrollableError",
    "build",
    "check",
    "engine",
    "limits",
    "load",
    "place",
    "tightest",
]
