"""A pendulum whose motor ends at 20 Nm: laws with and without cutting off, and the states caught.

``python docs/examples/input_limits.py [FOLDER]`` prints the page's numbers and writes
input-limits.png into the folder, by default here. It takes about half a minute.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.certify.bounds import best_bound

LIMIT = 20.0  # Nm
SHAPE = np.diag([1.0, 2.0])  # half-axes: rad, rad/s
REGION = pf.Disk(-6, 6)
GIVEN = pf.FixedGain(np.array([[-30.0, -10.0]]))  # drawn: one that no search has found


def balance():
    """An inverted pendulum of unknown inertia J, that falls at a rate of root w2."""

    def matrices(J, w2):
        return [[0, 1], [w2, 0]], [[0], [1 / J]], [[0], [1 / J]]

    parameters = [
        pf.Parameter("J", 1, 2, "kg m2", through="1/J"),
        pf.Parameter("w2", 4, 6, "1/s2"),
    ]
    names = {
        "states": ("angle [rad]", "rate [rad/s]"),
        "inputs": ("torque [Nm]",),
        "disturbances": ("gust [Nm]",),
    }
    return pf.UncertainPlant.from_function(matrices, parameters, name="balance", **names)


def designed(kind, plant=None):
    """The least rms of the angle, caught from 0.75 rad: Saturation, or InitialPeak without it."""
    plant = balance() if plant is None else plant
    limit = kind("torque", LIMIT, points=[(0.75, 0.0)])
    return pf.optimise(plant, pf.Rms("angle", density=2.0), [limit], REGION)


def caught(kind, law, plant=None):
    """How many times the ellipse of the shape is proved to be caught within the limit."""
    plant = balance() if plant is None else plant
    asked = kind("torque", ellipsoid=(SHAPE**2).tolist())
    return LIMIT / best_bound(plant, law, asked).level


def comes_to_rest(plant, law, alpha, x):
    """Which states (count, 2) a simulated loop comes to rest from."""
    A, B = (M[0] for M in plant.at(alpha[None]))
    K, dt = np.atleast_2d(law.gain(alpha)), 0.01
    for _ in range(1500):
        u = np.clip(x @ K.T, -LIMIT, LIMIT)
        x = np.clip(x + dt * (x @ A.T + u @ B.T), -1e6, 1e6)
    return np.abs(x).max(axis=1) < 0.1


def main(folder="."):
    """Design, print and draw."""
    plant, t = balance(), np.linspace(0, 2 * np.pi, 400)
    cut, linear = designed(pf.Saturation, plant), designed(pf.InitialPeak, plant)
    print(f"rms of the angle: {cut.bounds[0].level:.4f} rad, {linear.bounds[0].level:.4f} rad")
    figure, axes = pf.plots.new_figure(1, 5.6, 4.0)
    ax = np.atleast_1d(axes)[0]
    x, y = np.meshgrid(np.linspace(-2.2, 2.2, 221), np.linspace(-5, 5, 221))
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    rest = np.ones(len(grid), dtype=bool)
    for alpha in np.eye(len(plant.vertices)):
        rest &= comes_to_rest(plant, GIVEN, alpha, grid)
    ax.contourf(x, y, rest.reshape(x.shape), levels=[0.5, 1.5], colors=["0.88"])
    for kind, label, style in (
        (pf.Saturation, "cut off at 20 Nm, proved", "C0-"),
        (pf.InitialPeak, "never above 20 Nm, proved", "C3--"),
    ):
        size = caught(kind, GIVEN, plant)
        print(f"{label}: {size:.4f} times")
        ax.plot(*(size * SHAPE @ [np.cos(t), np.sin(t)]), style, label=label)
    ax.fill([], [], color="0.88", label="simulated at the vertices")
    ax.set(xlabel="angle [rad]", ylabel="rate [rad/s]", xlim=(-2.2, 2.2), ylim=(-5, 5))
    ax.legend(fontsize=8.5, loc="upper right")
    Path(folder, "input-limits.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
