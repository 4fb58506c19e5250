"""A quarter car: how far each method goes as the load becomes less certain; figure.

``python docs/examples/quarter_car.py [FOLDER]`` prints the page's numbers and writes
quarter-car.png into the folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.plant.spec import loads

CENTRE = -40
METHODS = {
    "quadratic": ("one gain, one Lyapunov matrix", "#b2182b"),
    "slack": ("one gain, slack variable", "#e08214"),
    "scheduled": ("gain scheduled on load and age", "#2166ac"),
}
PERCENT = (1, 10, 20, 30, 40)


def car(percent):
    """The car of Table 1 of Leite and Peres, with its load uncertain by so many per cent."""
    text = pf.examples.spec_text("quarter-car-physical")
    low, high = 288.9 * (1 - percent / 100), 288.9 * (1 + percent / 100)
    return loads(text.replace("[231.12, 346.68]", f"[{low:.3f}, {high:.3f}]"))


def radii():
    """The smallest disk of each method at each range of the load, proved."""
    return {
        percent: {
            name: pf.tightest(car(percent), of="disk", centre=CENTRE, method=name)
            for name in METHODS
        }
        for percent in PERCENT
    }


def draw(found, folder):
    """Draw the radii, and the poles at 20 % of two methods."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 4.0)
    for marker, (name, (label, colour)) in zip("osd", METHODS.items(), strict=True):
        own = [found[percent][name].region.radius for percent in PERCENT]
        left.plot(PERCENT, own, marker=marker, color=colour, label=label)
    left.set(xlabel="uncertainty of the load [%]", ylabel="radius of the disk [1/s]")
    left.set_title("smallest proved disk at -40 1/s")
    left.legend(fontsize=8.5)
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    alpha = np.random.default_rng(0).dirichlet(np.ones(4) / 2, 3000)
    for name in ("quadratic", "scheduled"):
        colour = METHODS[name][1]
        design = found[20][name]
        poles = design.poles(alpha).ravel()
        edge = CENTRE + float(design.region.radius) * turn
        right.plot(poles.real, poles.imag, ".", ms=1, color=colour, rasterized=True)
        right.plot(edge.real, edge.imag, color=colour, lw=1.2)
    right.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]", aspect="equal")
    right.set_title("poles at 20 %, each with its disk")
    Path(folder, "quarter-car.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Search, print and draw."""
    found = radii()
    print("load   quadratic     slack  scheduled")
    for percent, own in found.items():
        numbers = " ".join(f"{float(own[name].region.radius):10.3f}" for name in METHODS)
        print(f"{percent:3d} % {numbers}")
    draw(found, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
