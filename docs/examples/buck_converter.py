"""A buck converter: source and load uncertain; poles proved, load steps; figure.

``python docs/examples/buck_converter.py [FOLDER]`` prints the page's numbers and writes
buck-converter.png into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import polefence as pf
from polefence.base.files import write_bytes
from polefence.plant.spec import loads
from polefence.show.plots import new_figure, render

REGION = "half_plane(300) & sector(0.6) & disk(-40000, 40000)"
SPEC = """
name = "buck converter"
states = ["inductor current [A]", "output voltage [V]", "integral of voltage error [V s]"]
inputs = ["duty cycle"]
disturbances = ["load current [A]"]

[parameter.source]
range = [10, 14]
unit = "V"

[parameter.load]
range = [2, 20]
unit = "ohm"
through = "1/load"

[constants]
L = 100e-6     # H
C = 220e-6     # F

[matrices]
A = [[0, "-1/L", 0], ["1/C", "-1/(load*C)", 0], [0, 1, 0]]
B = [["source/L"], [0], [0]]
E = [[0], ["-1/C"], [0]]
"""


def designed():
    """One gain for every source and load, and the output impedance that it is proved to keep."""
    plant, region = loads(SPEC), pf.parse_region(REGION)
    design = pf.place(plant, region, "quadratic")
    limit = pf.parse_specification("gain of output voltage <= 0.5")
    return design, pf.analyse(plant, design.law, region, limits=[limit]).bounds[0]


def random_plants(design, count):
    """Closed loops A + B K and E of random sources and loads."""
    random, plant = np.random.default_rng(0), design.plant
    for _ in range(count):
        alpha = plant.alpha(source=random.uniform(10, 14), load=random.uniform(2, 20))
        A, B = plant.at(alpha)
        yield A + B @ design.law.gain(alpha), np.tensordot(alpha, [v.E for v in plant.vertices], 1)


def impedances(design, count=40):
    """Output impedance over frequency [rad/s] of random sources and loads [ohm]."""
    w = np.geomspace(1e2, 1e6, 200)
    loops = (
        [np.linalg.solve(1j * own * np.eye(3) - A, E)[1, 0] for own in w]
        for A, E in random_plants(design, count)
    )
    return w, np.abs(np.array(list(loops)))


def dips(design, count=40):
    """Output voltage after a step of 1 A of load current, at random sources and loads [V]."""
    step, number, found = 1e-5, 250, []
    for A, E in random_plants(design, count):
        whole = np.zeros((4, 4))
        whole[:3, :3], whole[:3, 3:] = A * step, E * step
        once, x, volts = expm(whole), np.array([0, 0, 0, 1.0]), []
        for _ in range(number):
            volts.append(x[1])
            x = once @ x
        found.append(volts)
    return step * np.arange(number), np.array(found)


def draw(design, bound, folder):
    """Draw load steps and output impedances, with what is proved of these."""
    figure, (left, right) = new_figure(2, 9.5, 3.4)
    time, volts = dips(design)
    left.plot(1e3 * time, volts.T, color="#2166ac", lw=0.7)
    left.set(xlabel="time [ms]", ylabel="output voltage [V]", title="load step of 1 A")
    left.margins(x=0)
    w, ohms = impedances(design)
    right.loglog(w / (2 * np.pi), ohms.T, color="#2166ac", lw=0.7)
    right.axhline(bound.bound.level, color="#b2182b", ls="--", label="proved for every plant")
    right.set(xlabel="frequency [Hz]", ylabel="[ohm]", title="output impedance")
    right.legend(fontsize=8.5)
    write_bytes(Path(folder) / "buck-converter.png", render(figure, "png"))


if __name__ == "__main__":
    design, bound = designed()
    print("K =", design.law.K)
    level = bound.bound.level
    print(f"output impedance: {level:.4f} ohm proved, {bound.worst:.4f} sampled, {bound.values}")
    _, volts = dips(design)
    print(f"load step of 1 A: {volts.min():.3f} V")
    draw(design, bound, sys.argv[1] if len(sys.argv) > 1 else ".")
