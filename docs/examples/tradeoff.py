"""Comfort against road holding of a quarter car, with one gain and with scheduled gains; figure.

``python docs/examples/tradeoff.py [FOLDER]`` writes tradeoff.png into the folder, by default here.
"""

import sys
from pathlib import Path

import polefence as pf
from polefence.base.files import write_bytes
from polefence.base.workers import processes
from polefence.design.signals.specification import Rms
from polefence.design.signals.tradeoff import tradeoff
from polefence.examples import family
from polefence.show.plots.plots import render
from polefence.show.plots.tradeoff import front_figure
from polefence.vehicle import velocity_density

DENSITY = velocity_density("C", 20)  # road of class C at 20 m/s
COMFORT = Rms("sprung-mass acceleration", density=DENSITY)
HOLDING = Rms("tyre deflection", density=DENSITY)
LIMITS = (
    Rms("actuator force", at_most=300, density=DENSITY),
    Rms("suspension deflection", at_most=0.027, density=DENSITY),
)
VALUES = [0.0042, 0.0044, 0.0046, 0.0048, 0.005, 0.0052, 0.0054, 0.0056]
METHODS = ("quadratic", pf.Scheduled(1, 0, on="box"))


def front(values=VALUES, methods=METHODS, executor=None):
    """Return the trade-off over limits on the tyre's deflection."""
    plant = family("quarter-car-ride")
    return tradeoff(plant, COMFORT, HOLDING, values, LIMITS, methods=methods, executor=executor)


def main(folder="."):
    """Sweep, print and draw."""
    with processes() as executor:
        found = front(executor=executor)
    for row in found.rows:
        print(f"{1e3 * row['value']:.1f} mm  {row['method']:<20} {row['proved']:.5f} m/s2")
    write_bytes(Path(folder) / "tradeoff.png", render(front_figure(found), "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
