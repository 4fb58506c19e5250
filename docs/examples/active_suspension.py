"""Active suspension with an uncertain actuator: what samples show and what is proved; figure.

``python docs/examples/active_suspension.py [FOLDER]`` prints the page's numbers and writes
active-suspension.png into the folder, by default here. It takes about half a minute.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.base.files import write_bytes
from polefence.examples import spec_path
from polefence.show.plots import new_figure, render
from polefence.vehicle import bump, drive, on_road

SPEC = spec_path("active-suspension-ride")
ROAD = bump(0.05, 2.5, before=1.0, after=15.0)  # 5 cm, at 10 m/s a quarter of a second
SIGNALS = ["sprung-mass acceleration", "suspension deflection", "tyre deflection"]


def design(order):
    """Return the law with so many states."""
    least, limits = pf.load_specifications(SPEC)
    structure = replace(pf.load_structure(SPEC), order=order)
    plant, region = pf.load(SPEC), pf.load_region(SPEC)
    return pf.optimise(plant, least, limits, region, structure=structure)


def random_actuators(plant, count):
    """Return as many at random, as weights of the vertices."""
    random = np.random.default_rng(0)
    gain, rate = random.uniform(0.6, 1.4, count), random.uniform(30, 120, count)
    return np.array([plant.alpha(gain=g, rate=r) for g, r in zip(gain, rate, strict=True)])


def sampled(done, count):
    """Return the worst rms of the acceleration of so many random actuators."""
    alpha = random_actuators(done.plant, count)
    return done.bounds[0].specification.values(done.plant, done.law, alpha).max()


def draw(done, folder):
    """Draw twenty cars over the bump, and the passive one."""
    alpha = random_actuators(done.plant, 20)
    road = on_road(done.plant, ROAD, 10.0, 1e-3, 1.5)
    own = drive(done.plant, done.law, road, alpha).response(SIGNALS)
    passive = drive(done.plant, None, road, alpha[:1]).response(SIGNALS)
    figure, axes = new_figure(3, 10.5, 3.1)
    for ax, signal, values, without in zip(
        axes, own.signals, own.values.T, passive.values.T, strict=True
    ):
        ax.plot(own.time, without[:, 0], color="0.55", lw=1.6, label="passive")
        ax.plot(own.time, values, color="#2166ac", lw=0.7)
        ax.set(xlabel="time [s]", ylabel=signal.label)
        ax.margins(x=0)
    axes[0].plot([], [], color="#2166ac", lw=0.9, label="law of order 1, 20 actuators")
    axes[0].legend(fontsize=8.5)
    write_bytes(Path(folder) / "active-suspension.png", render(figure, "png"))


if __name__ == "__main__":
    for order in (0, 1):
        found = design(order)
        shown = ", ".join(f"worst of {n}: {sampled(found, n):.4f}" for n in (20, 10_000))
        print(f"order {order}: {shown}, proved {found.bounds[0].level:.4f} m/s2")
    draw(found, sys.argv[1] if len(sys.argv) > 1 else ".")
