"""A servo's load angle estimated from its motor's encoder, for every load: designs and figure.

``python docs/examples/observer.py [FOLDER]`` writes observer.png into the folder, by default here.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import polefence as pf
from polefence.base.files import write_bytes

FEEDBACK, OBSERVER = pf.Disk(-6, 5), pf.Disk(-20, 14)
LOADS = {12.5: ":", 25: "--", 50: "-"}  # kg m^2: line style
TWIST = 0.05  # rad: the load's angle at first, the shaft being twisted by 64 N m
SECONDS = np.linspace(0, 0.8, 401)


def designs():
    """Return the state feedback and the observer, both proved."""
    servo = pf.examples.family("servo")
    feedback = pf.place(servo, FEEDBACK, "scheduled")
    return feedback, pf.observe(servo, ["motor angle"], OBSERVER, "scheduled")


def mistaken(feedback, observer, true, assumed):
    """Return the poles where the load is one and the compensator is told another."""
    plant = observer.plant
    A, B = plant.at(plant.alpha(JL=true))
    Ac, Bc, Cc = observer.feedback(feedback).compensator(plant.alpha(JL=assumed))
    return np.linalg.eigvals(np.block([[A, B @ Cc], [Bc @ observer.C[0], Ac]]))


def twist_error(feedback, observer, load):
    """Return the error of the estimated load angle over SECONDS [rad], the estimate begun at 0."""
    loop = observer.feedback(feedback).closed_loop(observer.plant.alpha(JL=load))
    start = np.eye(8)[0] * TWIST
    states = np.array([expm(loop * t) @ start for t in SECONDS])
    return states[:, 0] - states[:, 4]


def draw(feedback, observer):
    """Return the figure: poles over all loads, and the error's decay for three of them."""
    figure, (left, right) = pf.plots.new_figure(2, 9.6, 4.4)
    loads = 1 / np.linspace(1 / 50, 1 / 12.5, 400)
    alpha = np.array([observer.plant.alpha(JL=load) for load in loads])
    kinds = (
        ("state feedback", feedback.poles(alpha), FEEDBACK, ".", "#b2182b", "-"),
        ("observer", observer.poles(alpha), OBSERVER, "x", "#2166ac", "--"),
    )
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 361))
    for name, poles, disk, marker, colour, line in kinds:
        z = poles[::10].ravel()
        left.plot(z.real, z.imag, marker, ms=4.5, color=colour, label=f"poles, {name}")
        edge = disk.centre + disk.radius * turn
        left.plot(edge.real, edge.imag, line, color=colour, lw=1.3, label=str(disk))
    left.axvline(0, color="0.3", lw=0.8)
    left.set_aspect("equal")
    left.set_xlabel("real part [1/s]")
    left.set_ylabel("imaginary part [rad/s]")
    left.set_title("poles, load inertia 12.5 to 50 kg m²")
    for load, style in LOADS.items():
        error = 1000 * twist_error(feedback, observer, load)
        right.plot(SECONDS, error, style, color="black", lw=1.6, label=f"load {load:g} kg m²")
    right.set_xlabel("time [s]")
    right.set_ylabel("load angle less its estimate [mrad]")
    right.set_title(f"error of the estimate, {1000 * TWIST:g} mrad at first")
    right.set_xlim(0, SECONDS[-1])
    for ax, columns in ((left, 2), (right, 3)):
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize=8.5, ncols=columns)
    return figure


def main(folder="."):
    """Design, print what the page says, and draw."""
    feedback, observer = designs()
    loop = observer.feedback(feedback)
    alpha = [observer.plant.alpha(JL=load) for load in np.linspace(12.5, 50, 200)]
    print(f"{feedback!r}\n{observer!r}")
    print(f"separation over 200 loads: {loop.separation(alpha):.1g}")
    rightmost = max(mistaken(feedback, observer, 50, 25).real)
    print(f"load 50, taken for 25: rightmost pole {rightmost:+.2f} 1/s")
    path = Path(folder) / "observer.png"
    write_bytes(path, pf.plots.render(draw(feedback, observer), "png"))
    print(f"written: {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
