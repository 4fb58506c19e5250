"""The public names of `polefence` and where they are: `__init__.py` loads what is asked for."""

from polefence import (
    data as data,
    examples as examples,
    export as export,
    fleet as fleet,
    response as response,
    vehicle as vehicle,
)
from polefence.base.errors import (
    DesignFileError as DesignFileError,
    InputError as InputError,
    MissingExtraError as MissingExtraError,
    MultiAffinityError as MultiAffinityError,
    NotProvedError as NotProvedError,
    OutputError as OutputError,
    ParameterValueError as ParameterValueError,
    PlantError as PlantError,
    PolefenceError as PolefenceError,
    RegionError as RegionError,
    SolverError as SolverError,
    SpecError as SpecError,
    UncontrollableError as UncontrollableError,
    UnobservableError as UnobservableError,
)
from polefence.base.workers import processes as processes
from polefence.certify.at_samples import at_samples as at_samples
from polefence.certify.bounds import Bound as Bound
from polefence.certify.certificate import Certificate as Certificate, Check as Check
from polefence.certify.design import Design as Design, check as check
from polefence.certify.given import (
    Analysis as Analysis,
    WorstCase as WorstCase,
    analyse as analyse,
    worst_case as worst_case,
)
from polefence.certify.margins import (
    Margin as Margin,
    Margins as Margins,
    estimation_error as estimation_error,
    gain_error as gain_error,
    in_service as in_service,
    parameter_rate as parameter_rate,
)
from polefence.certify.promised import (
    GivenLyapunov as GivenLyapunov,
    VerifiedBound as VerifiedBound,
)
from polefence.certify.progress import progress as progress
from polefence.certify.refutation import Refutation as Refutation, refute_limits as refute_limits
from polefence.certify.robust import (
    Attained as Attained,
    Reach as Reach,
    Robustness as Robustness,
    robust as robust,
)
from polefence.certify.running import Running as Running, running as running
from polefence.certify.table import TableAnalysis as TableAnalysis
from polefence.data.fit import identify as identify
from polefence.data.identified import Identified as Identified
from polefence.fleet.run import study as study
from polefence.law.compensator import Compensator as Compensator
from polefence.law.control import from_control as from_control, to_control as to_control
from polefence.law.coordinates import Coordinates as Coordinates
from polefence.law.laws import (
    FixedGain as FixedGain,
    GainTable as GainTable,
    Law as Law,
    PolynomialGain as PolynomialGain,
    ScheduledGain as ScheduledGain,
)
from polefence.law.structure import Structure as Structure, load_structure as load_structure
from polefence.lmi import conditions as conditions
from polefence.lmi.conditions.methods import (
    METHODS as METHODS,
    Scheduled as Scheduled,
    Slack as Slack,
    build as build,
)
from polefence.lmi.solve.engine import engine as engine
from polefence.plant.controllability import FixedModes as FixedModes
from polefence.plant.dead_time import with_dead_time as with_dead_time
from polefence.plant.family import SamplesOf as SamplesOf, UncertainPlant as UncertainPlant
from polefence.plant.larger import with_actuator as with_actuator, with_sensor as with_sensor
from polefence.plant.linearise import Linearised as Linearised, linearise as linearise
from polefence.plant.parameters import Parameter as Parameter
from polefence.plant.polynomial import Domain as Domain
from polefence.plant.spec import load as load
from polefence.plant.surface import Surface as Surface
from polefence.plant.system import System as System
from polefence.plant.vehicle import Vehicle as Vehicle
from polefence.plant.weights import with_reference as with_reference, with_weight as with_weight
from polefence.region.regions import (
    Disk as Disk,
    Ellipse as Ellipse,
    HalfPlane as HalfPlane,
    HorizontalStrip as HorizontalStrip,
    Intersection as Intersection,
    Region as Region,
    Sector as Sector,
    VerticalStrip as VerticalStrip,
    Wedge as Wedge,
)
from polefence.region.text import load_region as load_region, parse_region as parse_region
from polefence.region.z_plane import z_plane as z_plane
from polefence.requirements.bump import BumpMeasure as BumpMeasure
from polefence.requirements.delay_margin import DelayMargin as DelayMargin
from polefence.requirements.disk_margin import DiskMargin as DiskMargin
from polefence.requirements.disk_margin import Unmodelled as Unmodelled
from polefence.requirements.energy_peak import EnergyPeak as EnergyPeak
from polefence.requirements.factor_margin import GainMargin as GainMargin
from polefence.requirements.factor_margin import PhaseMargin as PhaseMargin
from polefence.requirements.free import ImpulseMeasure as ImpulseMeasure
from polefence.requirements.free import InitialMeasure as InitialMeasure
from polefence.requirements.gain import Gain as Gain
from polefence.requirements.gain_norm import GainNorm as GainNorm
from polefence.requirements.initial_peak import InitialPeak as InitialPeak
from polefence.requirements.peak_to_peak import PeakToPeak as PeakToPeak
from polefence.requirements.relative_rms import RelativeRms as RelativeRms
from polefence.requirements.rms import Rms as Rms
from polefence.requirements.saturation import Saturation as Saturation
from polefence.requirements.specification import Specification as Specification
from polefence.requirements.text import (
    RoadSpectrum as RoadSpectrum,
    load_specifications as load_specifications,
    parse_specification as parse_specification,
)
from polefence.requirements.sector import SectorBound as SectorBound
from polefence.requirements.step import StepMeasure as StepMeasure
from polefence.requirements.worst_gain import WorstCaseGain as WorstCaseGain
from polefence.response.control import closed_loops as closed_loops
from polefence.response.samples import at_sample_time as at_sample_time
from polefence.search import many as many
from polefence.search.effort import Closer as Closer
from polefence.search.limits import Limit as Limit, limits as limits
from polefence.search.observer import (
    Observer as Observer,
    OutputFeedback as OutputFeedback,
    observe as observe,
)
from polefence.search.optimise import Optimised as Optimised, optimise as optimise
from polefence.search.place import place as place, tightest as tightest
from polefence.search.rows import RunOptions as RunOptions
from polefence.search.semi_active import SemiActiveLaw as SemiActiveLaw, semi_active as semi_active
from polefence.search.structures import (
    AskedStructures as AskedStructures,
    Structures as Structures,
    structures as structures,
)
from polefence.search.tradeoff import Asked as Asked, Front as Front, tradeoff as tradeoff
from polefence.show import plots as plots

__version__: str
__all__: list[str]
