"""How a plant behaves under a law: responses, roads, comfort, drives, estimates, comparisons.

Values are in SI units, arrays (alpha, time or frequency, signal). `polefence` itself does not
import this package. The functions `stationary`, `comfort`, `drive`, `estimate` and `compare` are
named as the modules that they are in: here the name is the function.
"""

from polefence.response.bands import (
    MOTION,
    RIDE,
    Bands,
    StationaryRide,
    quadrature,
    stationary_ride,
    thirds,
)
from polefence.response.comfort import Comfort, comfort, running_rms
from polefence.response.compare import NoLaw, compare, points, standard_laws
from polefence.response.comparison import Comparison, Row
from polefence.response.drive import drive
from polefence.response.driving.events import Event
from polefence.response.driving.parts import (
    Actuator,
    BumpStops,
    Estimated,
    Jump,
    Measured,
    Ramp,
    Sampling,
    Sensors,
    Sine,
)
from polefence.response.driving.result import Drive
from polefence.response.estimate import Estimate, estimate
from polefence.response.iso8608 import (
    displacement_density,
    random_road,
    roughness,
    velocity_density,
)
from polefence.response.labels import comfort_reading, dose_reading, health_reading
from polefence.response.linear import frequency, impulse, simulate, step
from polefence.response.obstacles import bump, kerb, pothole
from polefence.response.profile import measured_road
from polefence.response.recursion import Tuning
from polefence.response.reference_laws import Sizes, lqr, nominal, passive, skyhook
from polefence.response.result import Frequency, Response
from polefence.response.road import Road
from polefence.response.signals import Signal, inputs, rate_of, states
from polefence.response.stationary import Stationary, stationary, velocity_psd
from polefence.response.vehicle import Masses, Ride, masses, ride
from polefence.response.weighting import WF, WK, Weighting

__all__ = [
    "MOTION",
    "RIDE",
    "WF",
    "WK",
    "Actuator",
    "Bands",
    "BumpStops",
    "Comfort",
    "Comparison",
    "Drive",
    "Estimate",
    "Estimated",
    "Event",
    "Frequency",
    "Jump",
    "Masses",
    "Measured",
    "NoLaw",
    "Ramp",
    "Response",
    "Ride",
    "Road",
    "Row",
    "Sampling",
    "Sensors",
    "Signal",
    "Sine",
    "Sizes",
    "Stationary",
    "StationaryRide",
    "Tuning",
    "Weighting",
    "bump",
    "comfort",
    "comfort_reading",
    "compare",
    "displacement_density",
    "dose_reading",
    "drive",
    "estimate",
    "frequency",
    "health_reading",
    "impulse",
    "inputs",
    "kerb",
    "lqr",
    "masses",
    "measured_road",
    "nominal",
    "passive",
    "points",
    "pothole",
    "quadrature",
    "random_road",
    "rate_of",
    "ride",
    "roughness",
    "running_rms",
    "simulate",
    "skyhook",
    "standard_laws",
    "states",
    "stationary",
    "stationary_ride",
    "step",
    "thirds",
    "velocity_density",
    "velocity_psd",
]
