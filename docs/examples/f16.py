"""An F-16's short period: a gain for one flight condition, and one for all of them; figure.

``python docs/examples/f16.py [FOLDER]`` prints the page's numbers and writes f16.png into the
folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.signal import place_poles

import polefence as pf

REGION = pf.parse_region("half_plane(6) & sector(0.7) & disk(-13, 11)")
NOMINAL = {"Q": 14.364, "V": 153.0}  # dynamic pressure [kPa], airspeed [m/s]


def placed(plant):
    """The gain that places the poles at one flight condition, well inside the region."""
    A, B = plant.at(plant.alpha(**NOMINAL))
    return pf.FixedGain(-place_poles(A, B, [-9 + 5j, -9 - 5j, -16]).gain_matrix)


def conditions(plant, count):
    """Flight conditions at random, as weights of the vertices."""
    random = np.random.default_rng(0)
    Q, V = random.uniform(10.5, 18.5, count), random.uniform(130, 225, count)
    return np.array([plant.alpha(Q=q, V=v) for q, v in zip(Q, V, strict=True)])


def gusts(plant, law, alpha):
    """Angle of attack [degrees] over time after a gust of 1 degree, at each condition."""
    time, gust = 2e-3 * np.arange(500), [1, 0, 0]
    signals = ["angle of attack"]  # linear: of degrees come degrees
    return pf.response.simulate(plant, law, alpha, None, time, signals, start=gust)


def draw(plant, laws, folder):
    """Draw poles and gusts with each law."""
    figure, axes = pf.plots.new_figure(3, 11.0, 3.8)
    alpha, colours = conditions(plant, 2000), ("#b2182b", "#2166ac")
    A, B = plant.at(alpha)
    for ax, colour, (name, law) in zip(axes, colours, laws.items(), strict=False):
        poles = np.linalg.eigvals(A + B @ np.array([law.gain(own) for own in alpha])).ravel()
        pf.plots.draw_region(ax, REGION, (-26.0, 1.0, 14.0))
        ax.plot(poles.real, poles.imag, ".", ms=1.5, color=colour, rasterized=True)
        ax.set(title=name, xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
        found = gusts(plant, law, alpha[:40])
        axes[2].plot(found.time, found.values[:, :, 0].T, color=colour, lw=0.7)
    axes[2].set(title="both", xlabel="time [s]", ylabel="angle of attack [degrees]")
    axes[2].margins(x=0)
    Path(folder, "f16.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Analyse, design, print and draw."""
    plant = pf.examples.family("f16")
    one = placed(plant)
    print("poles placed at one condition:", pf.analyse(plant, one, REGION).reason)
    print("one gain, quadratic:", end=" ")
    try:
        pf.place(plant, REGION, "quadratic")
    except pf.NotProvedError as error:
        print(error)
    design = pf.place(plant, REGION, "scheduled")
    print(f"scheduled: proved, {design.certificate.prove().count} inequalities")
    draw(plant, {"placed at one condition": one, "scheduled, proved": design.law}, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
