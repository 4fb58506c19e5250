"""The quarter car at a sample time: proved decay and ride, designed at it or sampled after; figure.

``python docs/examples/sample_time.py [FOLDER]`` prints the page's numbers and writes
sample-time.png into the folder, by default here. It takes a few minutes.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

TIMES = (0.001, 0.005, 0.02)  # s: 1 kHz, 200 Hz, 50 Hz
DELAY = 1  # the law is computed during a step
MOST, HALVINGS = 30.0, 10  # 1/s, above any rate of the page; to 0.03 1/s
SPEC = Path(pf.examples.__file__).with_name("quarter-car-ride.toml")


def decays(plant=None):
    """For each time the decay rate [1/s] of a law designed at it, and of one sampled after."""
    plant = pf.examples.family("quarter-car-physical") if plant is None else plant
    continuous = pf.place(plant, pf.HalfPlane(5) & pf.Sector(0.3), "quadratic")
    for T in TIMES:
        own = pf.tightest(pf.at_sample_time(plant, T, DELAY), 0.0, "quadratic")
        yield T, -np.log(own.region.radius) / T, kept(plant, continuous, T)


def kept(plant, law, T):
    """The largest decay rate [1/s] that is proved of a law of continuous time; zero if none."""
    seen, late = pf.at_samples(plant, law, T, DELAY)
    if not pf.analyse(seen, late, pf.Disk(0, 1)).proved:
        return 0.0
    low, high = 0.0, MOST
    for _ in range(HALVINGS):
        rate = (low + high) / 2
        proved = pf.analyse(seen, late, pf.Disk(0, float(np.exp(-rate * T)))).proved
        low, high = (rate, high) if proved else (low, rate)
    return low


def degrees(plant=None, T=0.02):
    """For each degree of the samples the largest entry of the remainder, and the decay rate."""
    plant = pf.examples.family("quarter-car-physical") if plant is None else plant
    for degree in (1, 2, 3, 4):
        seen = pf.at_sample_time(plant, T, DELAY, degree)
        size = max(float(x) for row in seen.remainder.entries for x in row)
        own = pf.tightest(seen, 0.0, "quadratic")
        yield degree, size, -np.log(own.region.radius) / T


def rides(plant=None):
    """For each time the least rms of the body's acceleration [m/s2], the car's limits kept.

    What is proved is the rms at all times. With it the worst that the same law has at samples.
    """
    plant = pf.load(SPEC) if plant is None else plant
    least, limits = pf.load_specifications(SPEC)
    yield 0.0, pf.optimise(plant, least, limits).bounds[0].level, None
    for T in TIMES:
        seen = pf.at_sample_time(plant, T, DELAY)
        done = pf.optimise(seen, least, limits)
        corners = np.eye(len(seen.vertices))
        yield T, done.bounds[0].level, least.at_samples(seen, done.law, corners).max()


def main(folder="."):
    """Design, print and draw."""
    figure, axes = pf.plots.new_figure(2, 8.4, 3.6)
    found = list(decays())
    for T, own, after in found:
        print(f"{1000 * T:g} ms: decay {own:.2f} 1/s designed at it, {after:.2f} 1/s sampled after")
    for degree, size, own in degrees():
        print(f"degree {degree}: remainder at most {size:.2g}, decay {own:.2f} 1/s")
    times = [1000 * T for T, *_ in found]
    axes[0].semilogx(times, [own for _, own, _ in found], "o-", label="designed at the sample time")
    axes[0].semilogx(times, [after for *_, after in found], "s--", label="continuous law, sampled")
    axes[0].set(xlabel="sample time [ms]", ylabel="decay rate, proved [1/s]")
    (_, best, _), *known = rides()
    print(f"continuous: {best:.4f} m/s2")
    for T, level, own in known:
        print(f"{1000 * T:g} ms: {level:.4f} m/s2 proved at all times, {own:.4f} m/s2 at samples")
    axes[1].axhline(best, color="0.4", ls=":", label="continuous time, proved")
    levels, alone = zip(*((level, own) for _, level, own in known), strict=True)
    axes[1].semilogx(times, levels, "o-", label="at all times, proved")
    axes[1].semilogx(times, alone, "^--", label="the same laws, at samples alone")
    axes[1].set(xlabel="sample time [ms]", ylabel="body acceleration, rms [m/s²]")
    axes[0].set_ylim(0, 30)
    for ax in axes:
        ax.set_xticks(times, [f"{T:g}" for T in times])
        ax.minorticks_off()
        ax.legend(fontsize=8.5)
    Path(folder, "sample-time.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
