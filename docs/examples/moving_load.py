"""The quarter car whose load moves: what proved comfort and decay cost at each rate; figure.

``python docs/examples/moving_load.py [FOLDER]`` prints the page's numbers and writes
moving-load.png into the folder, by default here. It takes about a minute.
"""

import sys
from dataclasses import replace
from pathlib import Path

import polefence as pf

RATES = (5, 50, 500, 5000)  # kg/s
WITHIN = pf.Disk(-150, 150)  # poles of a car are not faster
SPEC = Path(pf.examples.__file__).with_name("quarter-car-ride.toml")


def moving(plant, rate):
    """The plant whose load moves by at most so much [kg/s], "any", or not (None)."""
    own = (-rate, rate) if isinstance(rate, int) else rate
    load, *others = plant.parameters
    return replace(plant, parameters=(replace(load, rate=own), *others))


def rides(rates=(None, *RATES, "any")):
    """The least rms of the body's acceleration [m/s2] for each rate, the car's limits kept."""
    plant = pf.load(SPEC)
    least, limits = pf.load_specifications(SPEC)
    for rate in rates:
        yield pf.optimise(moving(plant, rate), least, limits).bounds[0].level


def decays(rates=(None, *RATES, "any")):
    """The largest decay rate [1/s] of the physical car for each rate."""
    plant = pf.examples.family("quarter-car-physical")
    for rate in rates:
        own = moving(plant, rate)
        method = pf.Scheduled(1, 1, "box")
        design = pf.tightest(own, method=method, of="half_plane", within=WITHIN)
        yield design.region.parts[0].decay


def main(folder="."):
    """Design, print and draw."""
    figure, axes = pf.plots.new_figure(2, 8.4, 3.6)
    comfort, decay = list(rides()), list(decays())
    print("rms of the body's acceleration [m/s2]:", *(f"{value:.5f}" for value in comfort))
    print("decay rate [1/s]:", *(f"{value:.3f}" for value in decay))
    price = [100 * (value / comfort[0] - 1) for value in comfort]
    for ax, (still, *known, anyhow) in zip(axes, (price, decay), strict=True):
        ax.axhline(anyhow, color="C3", ls="--", label="at any rate")
        ax.semilogx(RATES, known, "o-", label="at up to this rate")
        ax.axhline(still, color="0.4", ls=":", label="at rest")
        ax.set_xlabel("rate of the load [kg/s]")
        ax.legend(fontsize=8.5, loc="upper left" if ax is axes[0] else "lower left")
    axes[0].set(ylabel="rise of the proved acceleration [%]", ylim=(-0.02, 0.36))
    axes[1].set(ylabel="decay rate, proved [1/s]", ylim=(18, 29))
    Path(folder, "moving-load.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
