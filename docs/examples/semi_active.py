"""A controllable damper: what a law keeps, what a fixed one does, what no logic can do; figure.

``python docs/examples/semi_active.py [FOLDER]`` prints the page's numbers and writes
controllable-damper.png into the folder, by default here. It takes some seconds.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.plant.spec import load_dampers, loads

SPEC = pf.examples.spec_text("semi-active")
(DAMPER,) = load_dampers(pf.examples.spec_path("semi-active"))
MASSES = (288.9, 308.9, 328.9, 348.9, 368.9, 388.9)  # of the body with its load [kg]
ROADS, SECONDS, STEP = 10, 100, 1e-3


def fixed(plant, least, coefficient):
    """Rms with a fixed damper, at each mass [m/s2]."""
    K = [[0, 0, -coefficient, coefficient]]  # of the velocities of body and wheel
    alpha = [plant.alpha(m1=m) for m in MASSES]
    rms = pf.response.stationary(plant, K, alpha, least.density, list(least.signal)).rms
    return np.linalg.norm(rms, axis=1)


def driven(plant, law, least, seed):
    """One road of white velocity, the same for all masses."""
    count = round(SECONDS / STEP)
    w = np.random.default_rng(seed).standard_normal(count) * np.sqrt(least.density / (2 * STEP))
    road = pf.vehicle.disturbed(plant, w, STEP, hold="held")
    hardware = pf.vehicle.Hardware(dampers=[DAMPER])
    return pf.vehicle.drive(plant, law.K, road, [{"m1": m} for m in MASSES], hardware)


def floors(least):
    """What no logic of the damper goes below, at each mass [m/s2]."""
    limit = replace(least, at_most=1e-3)  # every law exceeds it; a parameter has some range
    cars = (loads(SPEC.replace("[288.9, 388.9]", f"[{m}, {m + 0.01}]")) for m in MASSES)
    return np.array([1e-3 * pf.refute_limits(car, [limit], [DAMPER]).factor for car in cars])


def draw(levels, proved, drive, folder):
    """Draw the levels over the mass, and force over velocity of a drive."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 3.8)
    left.axhline(proved, color="#b2182b", ls="--", label="law, proved for every load")
    styles = {
        "best fixed damper": ("s-", "#e08214"),
        "law, in drives": ("o-", "#2166ac"),
        "no logic goes below": (":", "black"),
    }
    for name, (style, colour) in styles.items():
        left.plot(MASSES, levels[name], style, color=colour, ms=4, label=name)
    left.set(xlabel="mass of the body with its load [kg]", ylabel="rms [m/s²]", ylim=(0.6, 1.32))
    left.set_title("acceleration and tyre deflection, weighted")
    left.legend(fontsize=8.5)
    found = drive.response(["sprung-mass velocity", "unsprung-mass velocity", "damper force"])
    body, wheel, force = found.values[0, ::23].T
    right.plot(wheel - body, force / 1e3, ".", ms=2, color="#2166ac", label="law")
    v = np.array([-1.0, 1.0]) * np.abs(wheel - body).max()
    for c, style in ((DAMPER.low, ":"), (DAMPER.high, "--")):
        label = f"{float(c):.0f} N s/m"
        right.plot(v, float(c) * v / 1e3, style, color="0.3", lw=1.2, label=label)
    most = 1.15 * np.abs(force).max() / 1e3
    right.set(xlabel="rate of compression [m/s]", ylabel="damper's force [kN]", ylim=(-most, most))
    right.set_title("a drive, lightest car")
    right.legend(fontsize=8.5, loc="lower right", markerscale=4)
    Path(folder, "controllable-damper.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Find the law, prove, drive, print and draw."""
    plant = loads(SPEC)
    least, _ = pf.load_specifications(pf.examples.spec_path("semi-active"))
    law = pf.semi_active(plant, least, [DAMPER])
    drives = [driven(plant, law, least, seed) for seed in range(ROADS)]
    squares = [(own.response(list(least.signal)).values ** 2).sum(axis=2) for own in drives]
    levels = {
        "best fixed damper": fixed(plant, least, law.coefficients[0]),
        "law, in drives": np.sqrt(np.mean(squares, axis=(0, 2))),
        "no logic goes below": floors(least),
    }
    print(f"best fixed damper: {law.coefficients[0]:.0f} N s/m")
    print(f"law: at most {law.level:.3f} m/s2, proved for every load")
    print("mass [kg]          " + " ".join(f"{m:7.1f}" for m in MASSES))
    for name, own in levels.items():
        print(f"{name:19}" + " ".join(f"{x:7.3f}" for x in own))
    draw(levels, law.level, drives[0], folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
