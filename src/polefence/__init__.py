"""State feedback that keeps all poles in a region for all uncertain parameters, proved."""

from polefence.analysis import analyse
from polefence.conditions.methods import METHODS, Scheduled, Slack, build
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
from polefence.gain_table import GainTable
from polefence.law import FixedGain, ScheduledGain
from polefence.limits import Limit, limits
from polefence.observer import observe
from polefence.placement import place
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.spec import load
from polefence.plant.system import System
from polefence.proof.certificate import Certificate, Check
from polefence.region import Disk, Ellipse, HalfPlane, HorizontalStrip, Sector, VerticalStrip
from polefence.region_text import parse_region
from polefence.service import in_service
from polefence.smallest_region import tightest
from polefence.solve.engine import engine
from polefence.worst import worst_case

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "Certificate",
    "Check",
    "Design",
    "DesignFileError",
    "Disk",
    "Ellipse",
    "FixedGain",
    "GainTable",
    "HalfPlane",
    "HorizontalStrip",
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
    "Sector",
    "Slack",
    "SpecError",
    "System",
    "UncertainPlant",
    "UncontrollableError",
    "VerticalStrip",
    "analyse",
    "build",
    "check",
    "engine",
    "in_service",
    "limits",
    "load",
    "observe",
    "parse_region",
    "place",
    "tightest",
    "worst_case",
]
