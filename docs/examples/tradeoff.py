"""Comfort against road holding of a quarter car, with one gain and with scheduled gains; figure.

``python docs/examples/tradeoff.py [FOLDER]`` writes tradeoff.png into the folder, by default here.
"""

import sys
from pathlib import Path

import polefence as pf
from polefence.base.files import write_bytes

DENSITY = pf.vehicle.velocity_density("C", 20)  # road of class C at 20 m/s
COMFORT = pf.Rms("sprung-mass acceleration", density=DENSITY)
HOLDING = pf.Rms("tyre deflection", density=DENSITY)
LIMITS = (
    pf.Rms("actuator force", at_most=300, density=DENSITY),
    pf.Rms("suspension deflection", at_most=0.027, density=DENSITY),
)
VALUES = [0.0042, 0.0044, 0.0046, 0.0048, 0.005, 0.0052, 0.0054, 0.0056]
METHODS = ("quadratic", pf.Scheduled(1, 0, on="box"))


def front(values=VALUES, methods=METHODS, executor=None):
    """Return the trade-off over limits on the tyre's deflection."""
    plant = pf.examples.family("quarter-car-ride")
    found = pf.tradeoff(plant, COMFORT, HOLDING, values, LIMITS, methods=methods, executor=executor)
    return pf.vehicle.beside_reference_laws(found)


def main(folder="."):
    """Sweep, print and draw."""
    with pf.processes() as executor:
        found = front(executor=executor)
    for row in found.rows:
        print(f"{1e3 * row['value']:.1f} mm  {row['method']:<20} {row['proved']:.5f} m/s2")
    write_bytes(Path(folder) / "tradeoff.png", pf.plots.render(pf.plots.front_figure(found), "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
