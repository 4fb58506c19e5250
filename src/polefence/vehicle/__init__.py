"""Cars: roads, comfort, drives, estimates, and laws compared.

`polefence` itself does not import this package. The functions `comfort`, `drive`, `estimate` and
`compare` are named as the modules that they are in: here the name is the function.
"""

from polefence.plant.cars import Bar, Body, Car, Wheel, car_family
from polefence.plant.dampers import Damper
from polefence.plant.spec import load_car, load_dampers
from polefence.plant.tracks import Tracks
from polefence.response.discrete import Sampling
from polefence.response.stationary import displacement_density, roughness, velocity_density
from polefence.vehicle.comfort import (
    Comfort,
    comfort,
    comfort_reading,
    dose_reading,
    health_reading,
    running_rms,
    vibration_total,
)
from polefence.vehicle.compare import (
    Comparison,
    NoLaw,
    Quantity,
    Row,
    compare,
    points,
    standard_laws,
)
from polefence.vehicle.concepts import Concept, Concepts, Ridden, concepts
from polefence.vehicle.driving.drive import drive
from polefence.vehicle.driving.parts import (
    Actuator,
    BumpStops,
    Estimated,
    Hardware,
    Jump,
    Measured,
    Ramp,
    Scheduling,
    Sensors,
    Sine,
)
from polefence.vehicle.driving.result import Drive, Event
from polefence.vehicle.estimate import Estimate, Tuning, estimate
from polefence.vehicle.excitation import (
    Excitation,
    disturbed,
    excited,
    on_road,
    on_wheels,
    recorded,
)
from polefence.vehicle.reference_laws import (
    Sizes,
    beside_reference_laws,
    lqr,
    nominal,
    passive,
    skyhook,
)
from polefence.vehicle.roads import (
    Road,
    both_sides,
    bump,
    grade,
    kerb,
    measured_road,
    pothole,
    random_road,
)
from polefence.vehicle.vehicle import SIGNALS, Masses, Ride, masses, quarter_car, ride

__all__ = [
    "SIGNALS",
    "Actuator",
    "Bar",
    "Body",
    "BumpStops",
    "Car",
    "Comfort",
    "Comparison",
    "Concept",
    "Concepts",
    "Damper",
    "Drive",
    "Estimate",
    "Estimated",
    "Event",
    "Excitation",
    "Hardware",
    "Jump",
    "Masses",
    "Measured",
    "NoLaw",
    "Quantity",
    "Ramp",
    "Ridden",
    "Ride",
    "Road",
    "Row",
    "Sampling",
    "Scheduling",
    "Sensors",
    "Sine",
    "Sizes",
    "Tracks",
    "Tuning",
    "Wheel",
    "beside_reference_laws",
    "both_sides",
    "bump",
    "car_family",
    "comfort",
    "comfort_reading",
    "compare",
    "concepts",
    "displacement_density",
    "disturbed",
    "dose_reading",
    "drive",
    "estimate",
    "excited",
    "grade",
    "health_reading",
    "kerb",
    "load_car",
    "load_dampers",
    "lqr",
    "masses",
    "measured_road",
    "nominal",
    "on_road",
    "on_wheels",
    "passive",
    "points",
    "pothole",
    "quarter_car",
    "random_road",
    "recorded",
    "ride",
    "roughness",
    "running_rms",
    "skyhook",
    "standard_laws",
    "velocity_density",
    "vibration_total",
]
