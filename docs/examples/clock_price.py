"""What a clock that is not perfect costs the van, whose law has no states of its own; figure.

``python docs/examples/clock_price.py [FOLDER]`` prints the page's table and writes clock-price.png
into the folder, by default here. It takes half an hour. First it prints by how much some
periods in turn make the loop of the spec's own law grow, that for a perfect clock.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import expm

import polefence as pf
from polefence.response.between import held_of
from polefence.response.closed import close

SPEC = Path(pf.examples.__file__).with_name("van.toml")
T = 0.002  # s
# Share by which periods jitter, samples lost in a row.
CLOCKS = ((0, 0), (0.05, 0), (0.1, 0), (0.2, 0), (0, 1), (0.2, 1))
ROW = "{:g} % of jitter, {} lost: {:.4f} proved in any order, {:.4f} worst of constant periods"


TURNS = ((1.6,), (4.8,), (4.8, 4.8, 1.6))  # ms


def perfect():
    """The spec's own law for a perfect clock."""
    seen = pf.at_sample_time(pf.load(SPEC), T)
    return pf.optimise(seen, *pf.load_specifications(SPEC), structure=pf.load_structure(SPEC))


def growth(done, turn):
    """The largest growth of a loop at a corner over these periods in turn [ms]."""
    corners, held = np.eye(len(done.plant.vertices)), held_of(done.plant)
    loops, largest = close(done.plant, done.law, corners), 0.0
    for k in range(len(corners)):
        A, B = (np.array(M[k], dtype=float) for M in (held.A, held.B))
        (n, m), moved = B.shape, np.eye(done.plant.shape[0])
        N = np.block([[A, B], [np.zeros((m, n + m))]])
        for length in turn:
            step = np.eye(len(moved)) + T * loops.closed[k]
            F = expm(N * length / 1000)[:n]
            step[:n] = F[:, n:] @ loops.K[k][:m]
            step[:n, :n] += F[:, :n]
            moved = step @ moved
        largest = max(largest, np.abs(np.linalg.eigvals(moved)).max())
    return largest


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
    done = perfect()
    for turn in TURNS:
        print(f"periods of {turn} ms in turn: growth {growth(done, turn):.4f}", flush=True)
    rows = []
    for jitter, lost in CLOCKS:
        rows.append((lost, 100 * jitter, *priced(jitter, lost)))
        print(ROW.format(100 * jitter, lost, *rows[-1][2:]), flush=True)
    draw(rows, folder)


def draw(rows, folder):
    """Write the figure: what is proved in any order, and what constant periods have."""
    figure, axes = pf.plots.new_figure(1, 5.2, 3.4)
    ax = np.atleast_1d(axes)[0]
    for lost, (colour, name) in enumerate((("C0", "none lost"), ("C3", "one sample lost"))):
        _, jitter, proved, constant = zip(*(row for row in rows if row[0] == lost), strict=True)
        ax.plot(jitter, proved, "o-", color=colour, label=f"{name}: in any order, proved")
        ax.plot(jitter, constant, "s--", color=colour, mfc="w", label="worst of constant periods")
    ticks = sorted({row[1] for row in rows})
    ax.set_xticks(ticks, [f"±{x:g}" for x in ticks])
    ax.set_ylim(0.85, 1.1)
    ax.set(xlabel="period off by up to [%]", ylabel="body acceleration, rms [m/s²]")
    ax.legend(fontsize=8, loc="upper left")
    Path(folder, "clock-price.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
