"""A load step found by recursive least squares while the law drives by what they find: figure.

``python docs/examples/estimation.py [FOLDER]`` writes estimation.png into the folder, by default
here.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.base.files import write_bytes

SPEED, STEP, SECONDS, CHANGE = 20.0, 0.005, 12.0, 6.0  # m/s, s
COURSES = {"m1": pf.vehicle.Jump(CHANGE, 250, 330), "beta": 4.0}
HOW = pf.vehicle.Estimated(
    0.01, pf.vehicle.Tuning(memory=1.0, noise=0.1), pf.vehicle.Sensors(acceleration=0.1)
)
SETTLED = 4.0  # s after the start and after the load step


def estimated():
    """Return the drive, and the proved margins of the law's estimates."""
    plant = pf.examples.family("quarter-car-physical")
    law = pf.place(plant, pf.Disk(-40, 31), pf.Scheduled(1, 0, "box"))
    margins = pf.estimation_error(law)
    road = pf.vehicle.random_road("C", SPEED * SECONDS, seed=0)
    moved = pf.vehicle.on_road(plant, road, SPEED, STEP)
    hardware = pf.vehicle.Hardware(scheduling=HOW)
    return pf.vehicle.drive(plant, law, moved, COURSES, hardware, margins), margins


def settled(time):
    """Return the mask of the times at which the estimator has had its time."""
    after = np.where(time < CHANGE, time, time - CHANGE)
    return after >= SETTLED


def errors(found):
    """Return what the law took the parameters for less what they are, (time, 2)."""
    return found.used[0] - found.parameters[0]


def allowed(margins):
    """Return the error of each parameter that is proved for all at once, in its unit."""
    together = margins[-1].claim  # the others allow one parameter to be wrong, and no other
    return np.array([float(error) for error in together.errors])


def draw(found, margins):
    """Return the figure: both parameters over time, their estimates, and what is proved."""
    figure, axes = pf.plots.new_grid(2, 1, 7.2, 5.6, sharex=True)
    time, bounds = found.time, allowed(margins)
    for i, label in enumerate(("load m1 [kg]", "ageing beta [1]")):
        ax = axes[i, 0]
        true, used = found.parameters[0, :, i], found.used[0, :, i]
        ax.fill_between(
            time, 0, 1, where=~found.covered[0], color="0.85", lw=0,
            transform=ax.get_xaxis_transform(), label="not covered by the margins",
        )  # fmt: skip
        for sign in (-1, 1):
            name = "true ± proved margin" if sign > 0 else None
            ax.plot(time, true + sign * bounds[i], ":", color="black", lw=1.0, label=name)
        ax.plot(time, true, "--", color="black", lw=1.6, label="true")
        ax.plot(time, used, "-", color="#b2182b", lw=1.1, label="estimate that the law is told")
        ax.set_ylabel(label)
        ax.set_xlim(0, SECONDS)
    axes[1, 0].set_xlabel("time [s]")
    axes[0, 0].set_title("recursive least squares, class C at 20 m/s, load step at 6 s")
    axes[1, 0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), fontsize=8.5, ncols=2)
    return figure


def main(folder="."):
    """Drive, print what the page says, and draw."""
    found, margins = estimated()
    late = settled(found.time)
    off, bounds = errors(found)[late], allowed(margins)
    rms, inside = np.sqrt(np.mean(off**2, axis=0)), 100 * np.mean(np.abs(off) <= bounds, axis=0)
    for i, (name, unit) in enumerate((("m1", " kg"), ("beta", ""))):
        print(
            f"{name}: error {rms[i]:.1f}{unit} rms, proved {bounds[i]:.2g}{unit}, "
            f"inside {inside[i]:.0f} % of the time"
        )
    share = 100 * found.covered[0, late].mean()
    print(f"both, covered by the margins: {share:.0f} % of the time")
    print(found)
    path = Path(folder) / "estimation.png"
    write_bytes(path, pf.plots.render(draw(found, margins), "png"))
    print(f"written: {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
