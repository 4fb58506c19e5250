"""Poles of a car while load and age change, with a nominal law and with a proved one; animation.

``python docs/examples/moving_poles.py [FOLDER]`` writes moving-poles.gif and its first frame,
moving-poles.png, into the folder, by default here. It takes some seconds.
"""

import io
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

import polefence as pf
from polefence.base.files import write_bytes
from polefence.show.plots import new_figure, render

DISK = pf.Disk(-40, 31)
FRAMES = 80
BETWEEN = 8  # points of the way from one frame to the next
HOLD, STEP = 4000, 90  # ms, of the first frame, which shows the whole way, and of every other
SIZE = (1000, 440)  # pixels
INSIDE, OUTSIDE = "#2166ac", "#d6301d"
TITLES = ("gain for the nominal car", "scheduled gain, proved for every car")
CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]


def way(plant, count):
    """Load and age at so many moments: along the edge of their box, then across it."""
    corners = np.array(CORNERS)
    ends = np.cumsum([0, *(np.hypot(*(b - a)) for a, b in pairwise(corners))])
    at = np.linspace(0, ends[-1], count)
    middles = [float(own.low + own.high) / 2 for own in plant.parameters]
    halves = [float(own.high - own.low) / 2 for own in plant.parameters]
    share = np.array([np.interp(at, ends, own) for own in corners.T])
    return np.clip(
        middles + halves * share.T, np.subtract(middles, halves), np.add(middles, halves)
    )


def weights(plant, values):
    """Alpha at a row of values."""
    names = [own.name for own in plant.parameters]
    return plant.alpha(**dict(zip(names, map(float, values), strict=True)), clamp=True)


def poles(plant, values):
    """Poles at each row of values: with the nominal car's gain, and with the proved law."""
    middle = weights(plant, (values.min(axis=0) + values.max(axis=0)) / 2)
    A, B = plant.at(middle)
    fixed = pf.place(pf.UncertainPlant.from_vertices([A], [B]), DISK, "quadratic").law.K
    law = pf.place(plant, DISK, "scheduled").law
    alpha = np.array([weights(plant, own) for own in values])
    A, B = plant.at(alpha)
    return [np.linalg.eigvals(A + B @ K) for K in (fixed, law.gain(alpha))]


def frame(values, found, now):
    """The picture at one moment; of None that of the whole way."""
    figure, axes = new_figure(3, 10.0, 4.4, width_ratios=[1, 1, 0.62])
    figure.suptitle("closed-loop poles of a quarter car while its load and its age change")
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    edge = DISK.centre + float(DISK.radius) * turn
    last = len(values) if now is None else now + 1
    for ax, title, own in zip(axes, TITLES, found, strict=False):
        ax.set_facecolor("0.94")
        ax.fill(edge.real, edge.imag, color="white", zorder=0)
        ax.plot(edge.real, edge.imag, color="black", lw=1.3)
        outside = DISK.distance(own) > 0
        for which, colour in ((~outside, INSIDE), (outside, OUTSIDE)):
            past = own[:last][which[:last]]
            ax.plot(past.real, past.imag, ".", ms=2, color=colour)
            if now is not None:
                here = own[now][which[now]]
                ax.plot(here.real, here.imag, "o", ms=7, color=colour)
        ax.axvline(0, color="0.3", lw=0.8)
        ax.set(xlim=(-82, 8), ylim=(-48, 48), aspect="equal", xlabel="real part [1/s]")
        ax.set_title(title)
    axes[0].set_ylabel("imaginary part [rad/s]")
    box = axes[2]
    box.plot(*values.T, color="0.75", lw=1.2)
    if now is not None:
        box.plot(*values[now], "o", ms=8, color="black")
    box.set(xlabel="load [kg]", ylabel="age", title="where in the ranges")
    drawn = Image.open(io.BytesIO(render(figure, "png"))).convert("RGB")
    return drawn.resize(SIZE, Image.Resampling.LANCZOS)


def main(folder=".", frames=FRAMES):
    """Draw all frames."""
    plant = pf.examples.family("quarter-car-physical")
    values = way(plant, BETWEEN * frames)
    found = poles(plant, values)
    moments = [None, *range(0, len(values), BETWEEN)]
    pictures = [frame(values, found, now) for now in moments]
    # one palette, so that a frame is what has changed
    colours = pictures[frames // 2].quantize(64, Image.Quantize.FASTOCTREE)
    drawn = [own.quantize(palette=colours, dither=Image.Dither.NONE) for own in pictures]
    file = io.BytesIO()
    times = [HOLD, *[STEP] * frames]
    drawn[0].save(file, "GIF", save_all=True, append_images=drawn[1:], duration=times, loop=0)
    write_bytes(Path(folder, "moving-poles.gif"), file.getvalue())
    file = io.BytesIO()
    drawn[0].save(file, "PNG", optimize=True)
    write_bytes(Path(folder, "moving-poles.png"), file.getvalue())


if __name__ == "__main__":
    main(*sys.argv[1:2])
