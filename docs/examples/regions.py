"""Poles of an F-16's short period in a region, with one gain and with a scheduled gain; figure.

``python docs/examples/regions.py [FOLDER]`` writes regions.png into the folder, by default here.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.base.files import write_bytes
from polefence.examples import family, spec_path
from polefence.region.text import digits_down, digits_up
from polefence.show.plots import sampled

SPEC = spec_path("f16")
SPEED = pf.Sector(0.7) & pf.Disk(-13, 11)  # damped, and no faster than servo and sensors bear
METHODS = (
    "quadratic",
    "scheduled",
    pf.Scheduled(on="box"),
    pf.Scheduled(2, 1, on="box"),
)
DEGREES = ((0, 0), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0))
FAMILIES = (
    ("quarter-car-as-printed", "simplex"),
    ("quarter-car-physical", "simplex"),
    ("quarter-car-physical", "box"),
)


def disks():
    """Return the rows of the page's table: degree, elevation, smallest proved radii at -40."""
    columns = []
    for name, on in FAMILIES:
        methods = [pf.Scheduled(degree, elevation, on) for degree, elevation in DEGREES]
        columns.append(pf.limits(family(name), -40, methods, bounds=False))
    for (degree, elevation), rows in zip(DEGREES, zip(*columns, strict=True), strict=True):
        yield degree, elevation, *(digits_up(row.radius) for row in rows)


def fastest(plant, method):
    """Return the design of the largest decay rate that the method proves, within SPEED."""
    return pf.tightest(plant, method=method, of="half_plane", within=SPEED)


def decay(design):
    """Return the decay rate of a design, rounded down."""
    return digits_down(design.region.parts[0].decay, 4)


def open_loop(plant):
    """Return the rightmost open-loop pole of each vertex [1/s]."""
    return np.linalg.eigvals(plant.A).real.max(axis=1)


def main(folder="."):
    """Design, print what the page says, and draw."""
    plant, region = pf.load(SPEC), pf.load_region(SPEC)
    for row in disks():
        print("({}, {}): {} {} {}".format(*row))
    one_gain = fastest(plant, "quadratic")
    scheduled = pf.place(plant, region, "scheduled")
    print(f"{scheduled!r}")
    panels = {
        f"one gain, proved for decay {decay(one_gain)} 1/s": sampled(one_gain),
        "gain scheduled on Q and V, proved": sampled(scheduled),
    }
    path = Path(folder) / "regions.png"
    write_bytes(path, pf.plots.render(pf.plots.poles_figure(panels, region), "png"))
    print(f"written: {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
