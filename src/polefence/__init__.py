"""State feedback that keeps all poles in a region for all uncertain parameters, proved."""

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
from polefence.base.version import VERSION
from polefence.design.certificate import Certificate, Check
from polefence.design.design import Design, check
from polefence.design.given.analysis import analyse
from polefence.design.given.reach import worst_case
from polefence.design.margins import in_service
from polefence.design.observer import observe
from polefence.design.place.limits import Limit, limits
from polefence.design.place.placement import place
from polefence.design.place.smallest import tightest
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.law.table import GainTable
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
)
from polefence.region.text import parse_region

__version__ = VERSION

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
