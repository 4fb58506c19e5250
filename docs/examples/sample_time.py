"""The quarter car at a sample time: proved decay and ride, designed at it or sampled after; figure.

``python docs/examples/sample_time.py [FOLDER]`` prints the page's numbers and writes
sample-time.png into the folder, by default here. It takes a few minutes.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

import polefence as pf

TIMES = (0.001, 0.005, 0.02)  # s: 1 kHz, 200 Hz, 50 Hz
DELAY = 1  # the law is computed during a step
POINTS = 50  # within a sample
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

    With it what the same law has between samples too, on a road that is not held.
    """
    plant = pf.load(SPEC) if plant is None else plant
    least, limits = pf.load_specifications(SPEC)
    yield 0.0, pf.optimise(plant, least, limits).bounds[0].level, None
    for T in TIMES:
        seen = pf.at_sample_time(plant, T, DELAY)
        done = pf.optimise(seen, least, limits)
        yield T, done.bounds[0].level, between(plant, done.law, least, T)


def between(plant, law, least, T):
    """The rms in continuous time, white noise in between, at the worst vertex: not proved.

    By covariances: of the states at samples, and from there on within a sample.
    """
    n, worst = plant.shape[0], 0.0
    signal = plant.signal(least.name)
    C, D, _ = (np.array(rows, float) for rows in signal.exact(plant))
    for k, vertex in enumerate(plant.vertices):
        S = least.density / 2 * vertex.E @ vertex.E.T
        A = np.block([[vertex.A, vertex.B], [np.zeros((1, n + 1))]])
        noise = np.zeros((n + 1, n + 1))
        noise[:n, :n] = S
        step, moved = held(A, noise, T)
        K = law.gain(np.eye(len(plant.vertices))[k])
        closed = step.copy()
        closed[n:] = K
        P = solve_discrete_lyapunov(closed, moved, "bilinear")
        row, total = np.append(C[k], D[k]), 0.0
        for tau in (np.arange(POINTS) + 0.5) * T / POINTS:
            F, Q = held(A, noise, tau)
            total += row @ (F @ P @ F.T + Q) @ row / POINTS
        worst = max(worst, total**0.5)
    return worst


def held(A, noise, time):
    """The exponential, and the covariance that white noise leaves after a time (Van Loan, 1978)."""
    n = len(A)
    both = expm(np.block([[-A, noise], [np.zeros((n, n)), A.T]]) * time)
    F = both[n:, n:].T
    return F, F @ both[:n, n:]


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
    for T, level, whole in known:
        print(f"{1000 * T:g} ms: {level:.4f} m/s2 proved at samples, {whole:.4f} m/s2 between them")
    axes[1].axhline(best, color="0.4", ls=":", label="continuous time, proved")
    levels, wholes = zip(*((level, whole) for _, level, whole in known), strict=True)
    axes[1].semilogx(times, levels, "o-", label="at samples, proved")
    axes[1].semilogx(times, wholes, "^--", label="between samples too, not proved")
    axes[1].set(xlabel="sample time [ms]", ylabel="body acceleration, rms [m/s²]")
    axes[0].set_ylim(0, 30)
    for ax in axes:
        ax.set_xticks(times, [f"{T:g}" for T in times])
        ax.minorticks_off()
        ax.legend(fontsize=8.5)
    Path(folder, "sample-time.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
