"""An F4-E at four flight conditions: how much damping each set of sensors can prove; figure.

``python docs/examples/f4e.py [FOLDER]`` prints the page's numbers and writes f4e.png into the
folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

WITHIN = pf.parse_region("half_plane(0.5) & disk(-40, 40)")
STRUCTURES = {
    "all three states, one gain": None,
    "gyro, one gain": pf.Structure(measured=["pitch rate"], schedule=()),
    "gyro, order 1": pf.Structure(measured=["pitch rate"], schedule=(), order=1),
}
CONDITIONS = ("Mach 0.5, 5000 ft", "Mach 0.85, 5000 ft", "Mach 0.9, 35000 ft", "Mach 1.5, 35000 ft")
COLOURS = ("#b2182b", "#e08214", "#2166ac", "0.3")


def designs():
    """The law of the largest damping ratio that is proved, for each set of sensors."""
    plant = pf.examples.family("f4e")
    return {
        name: pf.tightest(plant, of="sector", within=WITHIN, structure=structure)
        if structure
        else pf.tightest(plant, of="sector", within=WITHIN, method="quadratic")
        for name, structure in STRUCTURES.items()
    }


def released(design):
    """Pitch rate over time at each condition, from a rate of 1 rad/s; the law begins at rest."""
    plant, time = design.plant, 2e-3 * np.arange(1000)
    start = np.eye(plant.shape[0])[1]
    return pf.response.simulate(plant, design, np.eye(4), None, time, ["pitch rate"], start=start)


def draw(design, folder):
    """Draw the poles without and with a law, and the pitch rate after a disturbance."""
    figure, (left, middle, right) = pf.plots.new_figure(3, 11.0, 3.9)
    plain = pf.examples.family("f4e")
    alpha = np.random.default_rng(0).dirichlet(np.ones(4) / 2, 4000)
    for ax, cloud, corners in (
        (left, np.linalg.eigvals(plain.at(alpha)[0]), np.linalg.eigvals(plain.A)),
        (middle, design.poles(alpha), design.poles(np.eye(4))),
    ):
        ax.plot(cloud.real.ravel(), cloud.imag.ravel(), ".", ms=1, color="0.7", rasterized=True)
        for poles, colour, name in zip(corners, COLOURS, CONDITIONS, strict=True):
            ax.plot(poles.real, poles.imag, "s", mfc="none", mew=1.4, color=colour, label=name)
        ax.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
        ax.axvline(0, color="0.3", lw=0.8)
    left.set(title="no control", ylim=(-9, 9))
    pf.plots.draw_region(middle, design.region, (-42.0, 4.0, 23.0))
    middle.set_title("gyro, order 1")
    found = released(design)
    for own, colour, name in zip(found.values, COLOURS, CONDITIONS, strict=True):
        right.plot(found.time, own, color=colour, label=name)
    right.set(title="gyro, order 1", xlabel="time [s]", ylabel="pitch rate [rad/s]")
    right.legend(fontsize=8.5)
    right.margins(x=0)
    Path(folder, "f4e.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Design, print and draw."""
    fastest = np.linalg.eigvals(pf.examples.family("f4e").A).real.max(axis=1)
    for name, pole in zip(CONDITIONS, fastest, strict=True):
        print(f"{name}, no control: rightmost pole {pole:.2f} 1/s")
    found = designs()
    for name, design in found.items():
        ratio = float(design.region.parts[0].damping)
        print(f"{name}: damping ratio {np.floor(1000 * ratio) / 1000:.3f} proved")
    draw(found["gyro, order 1"], folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
