"""A servo with a flexible shaft: what a move asks of shaft and motor, proved; figure.

``python docs/examples/servo.py [FOLDER]`` prints the page's numbers and writes servo.png into the
folder, by default here. It takes some seconds.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

MOVE = np.radians(15)
START = [[-MOVE, 0, -20 * MOVE, 0]]  # load and motor, behind the gear, at rest before the target
PEAKS = [
    pf.InitialPeak("shaft torque", at_most=10_000, points=START),
    pf.InitialPeak("armature voltage", at_most=10_000, points=START),
]
REGIONS = [f"half_plane(1) & sector(0.5) & disk(-{r}, {r})" for r in (20, 10)]
TORQUE, VOLTAGE = 78.5, 220  # what shaft and motor bear [N m], [V]


def laws():
    """A law for each region, and the peaks of a move that are proved of it."""
    servo = pf.examples.family("servo")
    for text in REGIONS:
        region = pf.parse_region(text)
        design = pf.place(servo, region, "quadratic")
        yield design, pf.analyse(servo, design.law, region, limits=PEAKS).bounds


def moves(design):
    """A move with forty random loads: load angle [rad], shaft torque [N m], voltage [V]."""
    plant, time = design.plant, 2e-3 * np.arange(1500)
    alpha = [plant.alpha(JL=JL) for JL in np.random.default_rng(0).uniform(12.5, 50, 40)]
    signals = ["load angle", "shaft torque", "armature voltage"]
    return pf.response.simulate(plant, design, alpha, None, time, signals, start=START[0])


def draw(found, peaks, folder):
    """Draw the moves, what shaft and motor bear, and what is proved."""
    figure, axes = pf.plots.new_figure(3, 10.5, 3.2)
    labels = ("load angle [degrees]", "shaft torque [N m]", "voltage [V]")
    angle, torque, voltage = found.values.T
    for ax, label, values in zip(
        axes, labels, (np.degrees(angle + MOVE), torque, voltage), strict=True
    ):
        ax.plot(found.time, values, color="#2166ac", lw=0.7)
        ax.set(xlabel="time [s]", ylabel=label)
        ax.margins(x=0)
    axes[0].axhline(np.degrees(MOVE), color="0.3", ls=":")
    for ax, own, level in zip(axes[1:], peaks, (TORQUE, VOLTAGE), strict=True):
        for sign in (1, -1):
            ax.axhline(sign * level, color="0.3", ls=":", label="limit" if sign > 0 else None)
            ax.axhline(
                sign * own.bound.level, color="#b2182b", ls="--",
                label="proved for every load" if sign > 0 else None,
            )  # fmt: skip
    axes[2].legend(fontsize=8.5, loc="center right", bbox_to_anchor=(1, 0.3))
    Path(folder, "servo.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Design, prove, print and draw."""
    for design, peaks in laws():
        found = moves(design)
        worst = np.abs(found.values).max(axis=(0, 1))[1:]
        print(f"{design.region}:")
        for own, unit, most in zip(peaks, ("N m", "V"), worst, strict=True):
            print(f"  {own.bound.level:.1f} {unit} proved, {most:.1f} {unit} in 40 moves")
        if peaks[0].bound.level <= TORQUE and peaks[1].bound.level <= VOLTAGE:
            break
    draw(found, peaks, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
