"""The van's law at sample times, late or not: an rms proved at all times, beside drives; figure.

``python docs/examples/between_samples.py [FOLDER]`` prints the page's table and writes
between-samples.png into the folder, by default here. It takes ten minutes.
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
ROW = "{}: {:.4f} proved, {:.4f} driven, its standard deviation {:.4f}"
DRIVES, SECONDS = 1000, 30.0  # a drive
PART = 0.0005  # s, of a period that is looked at
LATE = {0: "not late", 0.5: "half a sample late", 1: "one sample late"}


def design(T=None, delay=0):
    """The law of the spec's structure at a sample time, or in continuous time, as proved."""
    plant, structure = pf.load(SPEC), pf.load_structure(SPEC)
    least, limits = pf.load_specifications(SPEC)
    seen = plant if T is None else pf.at_sample_time(plant, T, delay)
    return least, pf.optimise(seen, least, limits, structure=structure)


def drives(least, done, rng):
    """The rms of what is minimised over many drives at its worst corner.

    With it its standard deviation.
    """
    plant, corners = done.plant, np.eye(len(done.plant.vertices))
    worst = int(np.argmax(least.values(plant, done.law, corners)))
    held, at = held_of(plant), corners[worst : worst + 1]
    loop, T = close(plant, done.law, at), float(plant.sample_time)
    A, B, E = (np.array(M[worst], dtype=float) for M in (held.A, held.B, held.E))
    n, m = B.shape
    parts = max(4, 2 * round(T / PART / 2))
    late = (held.delay - held.early) * parts  # parts of a period, after which its own input acts
    C, D = (np.array(y, float)[worst] for y in least.outputs(plant)[0].exact(plant)[:2])
    K, moves = loop.K[0], np.eye(plant.shape[0]) + T * loop.closed[0]
    E = E * (least.density / 2 * least.squares(plant)) ** 0.5
    F, G, W = parts_of(A, B, E, T / parts)
    added = np.zeros_like(loop.closed)  # about what a period adds: where drives begin
    added[0, :n, :n] = E @ E.T
    P = lyapunov(loop.closed, added, T)[0]
    x = root(P) @ rng.normal(size=(len(P), DRIVES))
    total, size = np.zeros(DRIVES), 0.0
    for _ in range(int(SECONDS / T)):
        u = K @ x
        following, moved = moves @ x, x[:n].copy()
        whole = x.copy()
        for k in range(parts + 1):
            whole[:n] = moved
            share = (1 if k in (0, parts) else 4 if k % 2 else 2) / 3  # Simpson's rule
            total += share * (C @ whole + D @ u) ** 2
            if k < parts:
                acting = u[:m] if k >= late else x[n : n + m]
                moved = F @ moved + G @ acting + W @ rng.normal(size=(n, DRIVES))
        size += parts
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
    rows = {}
    for delay in LATE:
        for T in TIMES:
            least, done = design(T, delay)
            rows[delay, T] = (done.bounds[0].level, *drives(least, done, rng))
            print(ROW.format(f"{1000 * T:g} ms, {delay} late", *rows[delay, T]), flush=True)
    draw(limit, rows, folder)


def draw(limit, rows, folder):
    """Write the figure: what is proved in continuous time, and each law's bound and drives."""
    figure, axes = pf.plots.new_figure(1, 5.6, 3.6)
    ax = np.atleast_1d(axes)[0]
    ax.axhline(limit, color="0.4", ls=":", label="continuous time, proved")
    for delay, name in LATE.items():
        proved, driven, _ = zip(*(rows[delay, T] for T in TIMES), strict=True)
        (line,) = ax.semilogx(TIMES, proved, "-", label=f"{name}, proved at all times")
        ax.semilogx(TIMES, driven, "o", color=line.get_color(), label=f"{name}, 1,000 drives")
    ax.set_xticks(TIMES, [f"{1000 * T:g}" for T in TIMES])
    ax.minorticks_off()
    ax.set(xlabel="sample time [ms]", ylabel="body acceleration, rms [m/s²]")
    ax.legend(fontsize=8.5)
    Path(folder, "between-samples.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
