"""Plants of several kinds, and every command that takes a design of each.

Another car than those shown, a winch and a boost converter: all states or sensors, one gain, a
scheduled law or states of its own, in continuous time or at samples, hardware, a weight, a
parameter that moves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from polefence.examples import spec_text

# Of the shown van, as of every quarter car: its signals, and its equations in m1, m2, k, kt and c.
SIGNALS, EQUATIONS = re.search(
    r"(states = .*?)\[constants\].*?(\[matrices\].*?)\[actuator", spec_text("van"), re.DOTALL
).groups()
CAR = f"""name = "city car, front corner"
{SIGNALS}[constants]
m2 = 34
k = 17000
c = 1150
[parameter.m1]
range = [235, 340]
unit = "kg"
through = "1/m1"
[parameter.kt]
range = [165000, 205000]
unit = "N/m"
{EQUATIONS}[road]
class = "C"
speed = 15
[[specification]]
kind = "rms"
signal = "sprung-mass acceleration"
minimise = true
[[specification]]
kind = "rms"
signal = "actuator force"
at_most = 450
"""
CAR_SENSORS = """[actuator."actuator force"]
bandwidth = 35
[sensor."suspension deflection"]
bandwidth = 90
noise = 0.0005
[sensor."sprung-mass acceleration"]
bandwidth = 90
noise = 0.05
[law]
measured = ["measured suspension deflection", "measured sprung-mass acceleration"]
schedule = []
order = 1
"""

WINCH = """name = "winch"
states = ["rope force [kN]", "drum speed [rad/s]", "load speed [m/s]"]
inputs = ["motor torque [kN m]"]
disturbances = ["gust [kN]"]
[constants]
J = 0.4
R = 0.25
b = 0.15
d = 0.02
[parameter.m]
label = "load"
range = [0.6, 1.1]
unit = "t"
through = "1/m"
[parameter.k]
label = "rope stiffness"
range = [40, 60]
unit = "kN/m"
[matrices]
A = [
    [0, "k*R", "-k"],
    ["-R/J", "-b/J", 0],
    ["1/m", 0, "-d/m"],
]
B = [[0], ["1/J"], [0]]
E = [[0], [0], ["1/m"]]
[[specification]]
kind = "rms"
signal = "load speed"
minimise = true
density = 0.05
[[specification]]
kind = "rms"
signal = "motor torque"
at_most = 0.4
density = 0.05
"""
WINCH_SENSORS = """[sensor."drum speed"]
bandwidth = 60
noise = 0.001
[law]
measured = ["drum speed", "rope force"]
schedule = []
order = 1
"""

CONVERTER = """name = "boost converter"
states = ["inductor current [A]", "output voltage [V]"]
inputs = ["duty cycle [-]"]
disturbances = ["source [V]"]
[constants]
L = 0.0003
C = 0.0004
r = 0.05
[parameter.g]
label = "load"
range = [0.05, 0.25]
unit = "S"
[parameter.off]
label = "share of a period with the switch open"
range = [0.4, 0.6]
unit = "-"
[matrices]
A = [["-r/L", "-off/L"], ["off/C", "-g/C"]]
B = [["24/L"], ["-4/C"]]
E = [["1/L"], [0]]
[[specification]]
kind = "rms"
signal = "output voltage"
minimise = true
density = 0.00002
[[specification]]
kind = "rms"
signal = "duty cycle"
at_most = 0.02
density = 0.00002
"""
CONVERTER_SENSORS = """[actuator."duty cycle"]
bandwidth = 3000
[law]
measured = ["output voltage"]
schedule = []
order = 1
"""


@dataclass(frozen=True)
class Plant:
    """A spec, what is added for sensors and states of the law, and its sample time [s]."""

    name: str
    spec: str
    sensors: str
    T: float
    moving: tuple[str, str]  # a line of the spec, and that with a rate
    step: str = ""  # of a drive, where there is no road

    @property
    def road(self) -> bool:
        """Whether it is a car."""
        return not self.step

    def designs(self) -> Iterator[Design]:
        """Yield designs of every kind."""
        late = ("--sample-time", f"{self.T:g}", "--delay", "1")
        one = ("--schedule", "none")
        with_sensors = self.spec + self.sensors
        yield Design(self, "scheduled", self.spec)
        yield Design(self, "one gain", self.spec, one)
        yield Design(self, "scheduled, late", self.spec, late)
        yield Design(self, "one gain, late", self.spec, one + late)
        yield Design(self, "sensors", with_sensors)
        yield Design(self, "sensors, late", with_sensors, late)
        yield Design(self, "moving", self.spec.replace(*self.moving), one)
        yield Design(self, "sensors, moving", with_sensors.replace(*self.moving))
        if self.road:
            signal = 'signal = "sprung-mass acceleration"'
            yield Design(
                self, "sensors, Wk", with_sensors.replace(signal, signal + '\nweight = "Wk"')
            )


@dataclass(frozen=True)
class Design:
    """A spec and how a law is sought."""

    plant: Plant
    name: str
    spec: str
    options: tuple[str, ...] = ()

    def commands(self, spec: str, folder: str) -> Iterator[tuple[str, ...]]:
        """Yield what is asked for, the law first, of a spec's file and the design's folder."""
        yield "optimise", spec, *self.options, "-o", folder
        yield "check", folder, "--spec", spec
        yield "service", folder
        if "--sample-time" not in self.options:  # which takes half a minute
            yield "robust", spec, "--law", folder
        drive = (
            ("--road", "C", "--speed", "15") if self.plant.road else ("--step-in", self.plant.step)
        )
        yield "simulate", folder, *drive, "-o", f"{folder}/drive.csv"
        yield "report", folder, "-o", f"{folder}/report.html"
        if self.plant.road:
            yield "compare", folder
        often = "--sample-time", f"{self.plant.T / 4:g}"  # a law of continuous time
        sampled = () if "--sample-time" in self.options else often
        yield "export", folder, "--float", "32", *sampled, "-o", f"{folder}/code"


PLANTS = (
    Plant(
        "city car",
        CAR,
        CAR_SENSORS,
        0.002,
        ('unit = "kg"', 'unit = "kg"\nrate = [-20, 20]'),
    ),
    Plant(
        "winch",
        WINCH,
        WINCH_SENSORS,
        0.01,
        ('unit = "t"', 'unit = "t"\nrate = [-0.1, 0.1]'),
        "gust=0.2",
    ),
    Plant(
        "converter",
        CONVERTER,
        CONVERTER_SENSORS,
        2e-5,
        ('unit = "S"', 'unit = "S"\nrate = [-20, 20]'),
        "source=1",
    ),
)
