"""The quarter car at a sample time: proved decay and ride, designed at it or sampled after; figure.

``python docs/examples/sample_time.py [FOLDER]`` prints the page's numbers and writes
sample-time.png into the folder, by default here. It takes a few minutes.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.export.sampled import prove_decay

TIMES = (0.001, 0.005, 0.02)  # s: 1 kHz, 200 Hz, 50 Hz
DELAY = 1  # the law is computed during a step
SPEC = Path(pf.examples.__file__).with_name("quarter-car-ride.toml")


def decays(plant=None):
    """For each time the decay rate [1/s] of a law designed at it, and of one sampled after."""
    plant = pf.examples.family("quarter-car-physical") if plant is None else plant
    continuous = pf.place(plant, pf.HalfPlane(5) & pf.Sector(0.3), "quadratic")
    for T in TIMES:
        own = pf.tightest(pf.at_sample_time(plant, T, DELAY), 0.0, "quadratic")
        after = prove_decay(continuous, T, DELAY)
        yield T, -np.log(own.region.radius) / T, after.decay


def rides(plant=None):
    """For each time the least rms of the body's acceleration [m/s2], the car's limits kept."""
    plant = pf.load(SPEC) if plant is None else plant
    least, limits = pf.load_specifications(SPEC)
    yield 0.0, pf.optimise(plant, least, limits).bounds[0].level
    for T in TIMES:
        try:
            done = pf.optimise(pf.at_sample_time(plant, T, DELAY), least, limits)
        except pf.NotProvedError:
            yield T, None
        else:
            yield T, done.bounds[0].level


def main(folder="."):
    """Design, print and draw."""
    figure, axes = pf.plots.new_figure(2, 8.4, 3.6)
    found = list(decays())
    for T, own, after in found:
        print(f"{1000 * T:g} ms: decay {own:.2f} 1/s designed at it, {after:.2f} 1/s sampled after")
    times = [1000 * T for T, *_ in found]
    axes[0].semilogx(times, [own for _, own, _ in found], "o-", label="designed at the sample time")
    axes[0].semilogx(times, [after for *_, after in found], "s--", label="continuous law, sampled")
    axes[0].set(xlabel="sample time [ms]", ylabel="decay rate, proved [1/s]", ylim=(0, None))
    (_, best), *known = rides()
    print(f"continuous: {best:.4f} m/s2")
    for T, level in known:
        print(f"{1000 * T:g} ms: {'not proved' if level is None else f'{level:.4f} m/s2'}")
    own = [(1000 * T, level) for T, level in known if level is not None]
    axes[1].semilogx(*zip(*own, strict=True), "o-", label="designed at the sample time")
    axes[1].axhline(best, color="0.4", ls=":", label="continuous time")
    axes[1].set(xlabel="sample time [ms]", ylabel="body acceleration, rms, proved [m/s²]")
    for ax in axes:
        ax.legend(fontsize=8.5)
    Path(folder, "sample-time.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
