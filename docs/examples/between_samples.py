"""The van's law at sample times, late, with jitter and a lost sample: proved beside drives; figure.

``python docs/examples/between_samples.py [FOLDER]`` prints the page's table and writes
between-samples.png into the folder, by default here. It takes half an hour.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import polefence as pf
from polefence.response.between import held_of
from polefence.response.closed import close
from polefence.response.stationary import lyapunov

SPEC = Path(pf.examples.__file__).with_name("van.toml")
TIMES = (0.0005, 0.001, 0.002, 0.005, 0.01)  # s
CLOCKS = ({}, {"jitter": 0.2}, {"lost": 1})  # at 2 ms, one sample late
ROW = "{}: {:.4f} proved, {:.4f} driven, its standard deviation {:.4f}"
DRIVES, SECONDS = 1000, 30.0  # a drive
PART = 0.0005  # s, of a period that is looked at


def design(T=None, delay=0, **clock):
    """The law of the spec's structure at a sample time, or in continuous time, as proved."""
    plant, structure = pf.load(SPEC), pf.load_structure(SPEC)
    least, limits = pf.load_specifications(SPEC)
    seen = plant if T is None else pf.at_sample_time(plant, T, delay, **clock)
    return least, pf.optimise(seen, least, limits, structure=structure)


def drives(least, done, rng, lengths=(1.0,)):
    """The rms of what is minimised over many drives at its worst corner, periods drawn of these.

    With it its standard deviation.
    """
    plant, corners = done.plant, np.eye(len(done.plant.vertices))
    worst = int(np.argmax(least.values(plant, done.law, corners)))
    held, at = held_of(plant), corners[worst : worst + 1]
    loop, T = close(plant, done.law, at), float(plant.sample_time)
    A, B, E = (np.array(M[worst], dtype=float) for M in (held.A, held.B, held.E))
    n, m = B.shape
    parts = max(4, 2 * round(T / PART / 2))
    first = n + (held.delay - 1) * m
    C, D = (np.array(y, float)[worst] for y in least.outputs(plant)[0].exact(plant)[:2])
    K, moves = loop.K[0], np.eye(plant.shape[0]) + T * loop.closed[0]
    E = E * (least.density / 2 * least.squares(plant)) ** 0.5
    known = {length: parts_of(A, B, E, T * length / parts) for length in set(lengths)}
    added = np.zeros_like(loop.closed)  # about what a period adds: where drives begin
    added[0, :n, :n] = E @ E.T
    P = lyapunov(loop.closed, added, T)[0]
    x = root(P) @ rng.normal(size=(len(P), DRIVES))
    total, size = np.zeros(DRIVES), 0.0
    for _ in range(int(SECONDS / T)):
        u = K @ x
        acting = x[first : first + m] if held.delay else u[:m]
        following, moved = moves @ x, x[:n].copy()
        length = lengths[0] if len(lengths) == 1 else rng.choice(lengths)
        F, G, W = known[length]
        whole = x.copy()
        for k in range(parts + 1):
            whole[:n] = moved
            share = (1 if k in (0, parts) else 4 if k % 2 else 2) / 3  # Simpson's rule
            total += share * length * (C @ whole + D @ u) ** 2
            if k < parts:
                moved = F @ moved + G @ acting + W @ rng.normal(size=(n, DRIVES))
        size += length * parts
        x = following
        x[:n] = moved
    rms = (total.mean() / size) ** 0.5
    return rms, rms * total.std() / total.mean() / 2 / DRIVES**0.5


def parts_of(A, B, E, time):
    """What a part of a period does: the states, what is held, and a root of the noise added."""
    n, m = B.shape
    F = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)
    both = expm(np.block([[-A, E @ E.T], [np.zeros((n, n)), A.T]]) * time)
    return F[:n, :n], F[:n, n:], root(both[n:, n:].T @ both[:n, n:])


def root(P):
    """L with L L' = P, where rounding may have left negative eigenvalues."""
    values, V = np.linalg.eigh((P + P.T) / 2)
    return V * np.sqrt(np.maximum(values, 0.0))


def main(folder="."):
    """Design, drive, print and draw."""
    rng = np.random.default_rng(1)
    _, done = design()
    limit = done.bounds[0].level
    print(f"continuous time: {limit:.4f} m/s2 proved", flush=True)
    figure, axes = pf.plots.new_figure(2, 8.4, 3.6)
    axes[0].axhline(limit, color="0.4", ls=":", label="continuous time, proved")
    for delay, marker in ((0, "o"), (1, "s")):
        rows = []
        for T in TIMES:
            least, done = design(T, delay)
            rows.append((1000 * T, done.bounds[0].level, *drives(least, done, rng)))
            print(ROW.format(f"{1000 * T:g} ms, {delay} late", *rows[-1][1:]), flush=True)
        times, proved, driven, _ = zip(*rows, strict=True)
        name = f"{delay} sample late" if delay else "not late"
        axes[0].semilogx(times, proved, marker + "-", label=f"{name}, proved")
        axes[0].semilogx(times, driven, marker, mfc="none", label=f"{name}, 1,000 drives")
    axes[0].set_xticks(times, [f"{T:g}" for T in times])
    axes[0].minorticks_off()
    axes[0].set(xlabel="sample time [ms]", ylabel="body acceleration, rms [m/s²]")
    axes[0].legend(fontsize=8.5)
    bars = []
    for clock in CLOCKS:
        least, done = design(0.002, 1, **clock)
        ends = [
            1 - clock.get("jitter", 0),
            (1 + clock.get("lost", 0)) * (1 + clock.get("jitter", 0)),
        ]
        lengths = (1.0,) if not clock else tuple(np.linspace(*ends, 9))
        name = ", ".join(f"{key} {value:g}" for key, value in clock.items()) or "perfect"
        bars.append((name, done.bounds[0].level, *drives(least, done, rng, lengths)))
        print(ROW.format(f"2 ms, 1 late, clock {name}", *bars[-1][1:]), flush=True)
    names, proved, driven, _ = zip(*bars, strict=True)
    places = np.arange(len(bars))
    axes[1].bar(places - 0.2, proved, 0.4, label="proved, periods in any order")
    axes[1].bar(places + 0.2, driven, 0.4, label="1,000 drives, periods at random")
    axes[1].set_xticks(places, names)
    axes[1].set(xlabel="clock, at 2 ms and one sample late", ylim=(0.6, None))
    axes[1].legend(fontsize=8.5)
    Path(folder, "between-samples.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
