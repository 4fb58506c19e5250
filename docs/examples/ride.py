"""Laws for the ride of a quarter car, within limits and proved; the table of the page; figure.

``python docs/examples/ride.py [FOLDER]`` writes ride.png into the folder, by default here. The
table takes about a minute.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.base.files import write_bytes
from polefence.cli.optimise import figure_of, rows_of
from polefence.examples import spec_path
from polefence.region.text import digits_up
from polefence.response.closed import close

SPEC = spec_path("quarter-car-ride")
CAR = pf.HalfPlane(1) & pf.Sector(0.15)  # about what the passive car has
SERVO = pf.HalfPlane(2) & pf.Sector(0.3)
ROWS = (
    ("quadratic", None),
    ("quadratic", CAR),
    ("quadratic", SERVO),
    (None, None),
    (None, CAR),
    (None, pf.HalfPlane(1.5) & pf.Sector(0.2)),
    (None, SERVO),
)


def design(plant, region, method=None):
    """Return the law with the least acceleration within the spec's limits."""
    return pf.optimise(plant, *pf.load_specifications(SPEC), region, method)


def facts(done):
    """Return what the page says of a law: bound, shared bound, and measured at the sample."""
    first, *others = rows_of(done)
    share = first.with_law.values / first.passive.values
    poles = close(done.plant, done.law, first.with_law.alpha).poles()
    return {
        "proved": digits_up(done.bounds[0].level, 5),
        "shared": digits_up(done.shared, 5),
        "designed": str(done.designed),
        "sampled": first.with_law.worst,
        "of passive": (share.min(), share.max()),
        "decay": -poles.real.max(),
        "damping": (-poles.real / np.abs(poles)).min(),
        **{row.bound.specification.name: row.with_law.worst for row in others},
    }


def everywhere(plant):
    """Return the law with the least acceleration relative to the passive car's."""
    least, limits = pf.load_specifications(SPEC)
    relative = pf.RelativeRms(least.signal, density=least.density)
    return pf.optimise(plant, relative, limits)


def draw(done, folder):
    """Write the figure."""
    path = Path(folder) / "ride.png"
    write_bytes(path, pf.plots.render(figure_of(done, rows_of(done)), "png"))
    print(f"written: {path}")


def main(folder="."):
    """Design, print the page's table, and draw."""
    plant = pf.load(SPEC)
    poles = close(plant, None, np.eye(4)).poles()
    print("passive:", -poles.real.max(), (-poles.real / np.abs(poles)).min())
    for method, region in ROWS:
        done = design(plant, region, method)
        print(method or "default", region or "stable", facts(done), flush=True)
        if method is None and region == CAR:
            draw(done, folder)
    print("relative to the passive car:", everywhere(plant).bounds[0])


if __name__ == "__main__":
    main(*sys.argv[1:])
