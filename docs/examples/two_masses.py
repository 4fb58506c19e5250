"""Two masses and a spring, one position measured: a law of order 2, proved; figure.

``python docs/examples/two_masses.py [FOLDER]`` prints the page's numbers and writes two-masses.png
into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

REGION = pf.parse_region("half_plane(0.1) & disk(-20, 20)")
STRUCTURE = pf.Structure(measured=["position 2"], schedule=(), order=2)


def loops(design, stiffness):
    """The closed loop, the law's states among its own, at each stiffness [N/m]."""
    for k in stiffness:
        alpha = design.plant.alpha(k=k)
        A, B = design.plant.at(alpha)
        yield A + B @ design.law.gain(alpha)


def pushed(design, stiffness):
    """Position of the second mass [m] after a push of 1 N s on it."""
    alpha = [design.plant.alpha(k=k) for k in stiffness]
    return pf.response.impulse(design.plant, design, alpha, ["position 2"], duration=25, step=0.01)


def draw(design, folder):
    """Draw poles over the stiffness, and pushes."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 3.8)
    stiffness = np.linspace(0.5, 2, 301)
    poles = np.array([np.linalg.eigvals(A) for A in loops(design, stiffness)])
    pf.plots.draw_region(left, REGION, (-1.5, 0.3, 2.6))
    shades = np.repeat(stiffness, poles.shape[1])
    dots = left.scatter(poles.real, poles.imag, c=shades, s=3, cmap="viridis", rasterized=True)
    figure.colorbar(dots, ax=left, label="stiffness [N/m]")
    left.axvline(0, color="0.3", lw=0.8)
    left.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
    found = pushed(design, np.linspace(0.5, 2, 16))
    for own, k in zip(found.values, np.linspace(0, 1, 16), strict=True):
        right.plot(found.time, own, color=dots.cmap(k), lw=0.9)
    right.set(xlabel="time [s]", ylabel="position of mass 2 [m]")
    right.margins(x=0)
    Path(folder, "two-masses.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Design, print and draw."""
    plant = pf.examples.family("two-masses")
    design = pf.place(plant, REGION, structure=STRUCTURE)
    print(f"proved: {design.certificate.prove().count} inequalities, poles in {design.region}")
    stiffness = np.linspace(0.5, 2, 3001)
    poles = np.array([np.linalg.eigvals(A).real.max() for A in loops(design, stiffness)])
    print("rightmost pole of 3001 springs inside:", bool(poles.max() < -0.1))
    draw(design, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
