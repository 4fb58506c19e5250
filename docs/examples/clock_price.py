"""What a clock that is not perfect costs the van, whose law has no states of its own; figure.

``python docs/examples/clock_price.py [FOLDER]`` prints the page's table and writes clock-price.png
into the folder, by default here. It takes a quarter of an hour.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import polefence as pf

SPEC = Path(pf.examples.__file__).with_name("van.toml")
T = 0.002  # s
CLOCKS = ((0, 0), (0.05, 0), (0.1, 0), (0.2, 0))  # share by which periods jitter, samples lost
ROW = "{:g} % of jitter, {} lost: {:.4f} proved in any order, {:.4f} worst of constant periods"


def priced(jitter, lost):
    """The level that is proved, and the worst that samples of the family have."""
    plant, least = pf.load(SPEC), pf.load_specifications(SPEC)
    structure = replace(pf.load_structure(SPEC), order=0)
    seen = pf.at_sample_time(plant, T, jitter=jitter, lost=lost)
    done = pf.optimise(seen, *least, structure=structure)
    bound = done.bounds[0]
    return bound.level, bound.specification.values(seen, done.law, np.eye(8)).max()


def main(folder="."):
    """Design, print and draw."""
    rows = []
    for jitter, lost in CLOCKS:
        rows.append((100 * jitter, *priced(jitter, lost)))
        print(ROW.format(rows[-1][0], lost, *rows[-1][1:]), flush=True)
    draw(rows, folder)


def draw(rows, folder):
    """Write the figure: what is proved in any order, and what constant periods have."""
    figure, axes = pf.plots.new_figure(1, 5.2, 3.2)
    ax = np.atleast_1d(axes)[0]
    jitter, proved, constant = zip(*rows, strict=True)
    ax.plot(jitter, proved, "o-", label="proved for periods in any order")
    ax.plot(jitter, constant, "s--", label="worst of constant periods")
    ax.set_xticks(jitter, [f"±{x:g}" for x in jitter])
    ax.set_ylim(bottom=0.85)
    ax.set(xlabel="period off by up to [%]", ylabel="body acceleration, rms [m/s²]")
    ax.legend(fontsize=9)
    Path(folder, "clock-price.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
