"""The drive train of a wind turbine: a damper of its torsion, proved; figure.

``python docs/examples/wind_turbine.py [FOLDER]`` prints the page's numbers and writes
wind-turbine.png into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.plant.spec import loads

REGION = pf.parse_region("half_plane(0.1) & disk(-100, 100)")
LEAST = pf.parse_specification("gain of shaft torque")
LIMIT = pf.parse_specification("gain of damper demand <= 20")
SPEC = """
name = "drive train"
states = [
    "twist [mrad]", "rotor speed [rad/s]", "generator speed [rad/s]", "integral of speed [rad]",
    "damper torque [kN m]",
]
inputs = ["damper demand [kN m]"]
disturbances = ["wind torque [MN m]"]

[constants]
Jr = 38.759228      # 1e6 kg m2, rotor
Jg = 0.534116       # 1e3 kg m2, generator
N = 97              # gear ratio
D = 6.215           # MN m s/rad, damping of the shaft
b = 0.3507          # kN m s/rad, power over speed squared: 5.297 MW at 122.9 rad/s
J = 43.784725       # 1e6 kg m2, Jr + N^2 Jg
wn = 0.6            # rad/s, of the pitch loop
z = 0.7             # its damping ratio

[parameter.K]       # stiffness of the shaft, published: 0.867637
range = [0.694, 1.041]
unit = "MN m/mrad"

[parameter.g]       # of the pitch loop
range = [0.8, 1.2]

[matrices]
A = [
    [0, 1000, "-1000/N", 0, 0],
    ["-K/Jr", "-D/Jr", "D/(N*Jr) - g*2*z*wn*J/(N*Jr)", "-g*wn**2*J/(N*Jr)", 0],
    ["1000*K/(N*Jg)", "1000*D/(N*Jg)", "-1000*D/(N**2*Jg) + b/Jg", 0, "-1/Jg"],
    [0, 0, 1, 0, 0],
    [0, 0, 0, 0, -50],
]
B = [[0], [0], [0], [0], [50]]
E = [[0], ["1/Jr"], [0], [0], [0]]

[outputs]
"shaft torque [MN m]" = {C = ["K", "D", "-D/N", 0, 0]}
"""


def plants(plant, count=40):
    """Drive trains at random, as weights of the vertices."""
    random = np.random.default_rng(0)
    K, g = random.uniform(0.694, 1.041, count), random.uniform(0.8, 1.2, count)
    return np.array([plant.alpha(K=k, g=own) for k, own in zip(K, g, strict=True)])


def torques(plant, law, alpha):
    """Shaft torque [MN m] over time after a gust that adds 1 MN m for good."""
    time = 5e-3 * np.arange(2400)
    gust = np.ones_like(time)
    return pf.response.simulate(plant, law, alpha, gust, time, ["shaft torque"])


def draw(plant, law, folder):
    """Draw shaft torques without and with the damper."""
    figure, axes = pf.plots.new_figure(2, 9.5, 3.4, sharey=True)
    alpha = plants(plant, 12)
    for ax, own, colour, title in (
        (axes[0], None, "#b2182b", "no damper"),
        (axes[1], law, "#2166ac", "damper, proved"),
    ):
        found = torques(plant, own, alpha)
        ax.plot(found.time, found.values[:, :, 0].T, color=colour, lw=0.8)
        ax.set(xlabel="time [s]", title=title)
        ax.margins(x=0)
    axes[0].set_ylabel("shaft torque [MN m]")
    Path(folder, "wind-turbine.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Analyse, design, print and draw."""
    plant = loads(SPEC)
    print("no damper:", pf.analyse(plant, [[0] * 5], pf.HalfPlane(0)).reason)
    structure = pf.Structure(measured=["generator speed"], schedule=())
    done = pf.optimise(plant, LEAST, [LIMIT], REGION, structure=structure)
    print(f"damper: {done.law.K[0, 2]:.3f} kN m per rad/s of the generator, proved in {REGION}")
    for own in done.bounds:
        name = own.specification.name
        print(f"gain from wind torque to {name}: {own.level:.3f} proved")
    alpha = plants(plant)
    poles = [np.linalg.eigvals(A + B @ done.law.K) for A, B in map(plant.at, alpha)]
    ratio = min((-p.real / np.abs(p))[np.abs(p.imag) > 5].min() for p in poles)
    print(f"damping ratio of the torsion, least of 40 drive trains: {ratio:.3f}")
    draw(plant, done.law, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
