"""A mass on a spring whose force comes late: what is proved beside what is exact; figure.

``python docs/examples/dead_time.py [FOLDER]`` prints the page's table and writes dead-time.png into
the folder, by default here. It takes about a minute.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

TIMES = (0.01, 0.02, 0.05, 0.1, 0.2)  # s
SPEC = """
name = "mass on a spring"
states = ["position [m]", "velocity [m/s]"]
inputs = ["force [N]"]
disturbances = ["push [N]"]
region = "half_plane(0.1)"

[parameter.k]
range = [80, 120]
unit = "N/m"

[matrices]
A = [[0, 1], ["-k", -2]]
B = [[0], [1]]
E = [[0], [1]]

[dead_time.force]
time = 0.05

[law]
measured = ["position", "velocity"]
schedule = []

[[specification]]
kind = "rms"
signal = "position"
density = 1
minimise = true

[[specification]]
kind = "rms"
signal = "force"
density = 1
at_most = 5
"""


def exact(gains, time):
    """The rms of the position [m] with the exact dead time, at the worst of nine springs."""
    w = np.concatenate([np.linspace(0, 200, 100_001)[1:], np.geomspace(200, 1e5, 10_000)])
    s, width = 1j * w, np.gradient(w)
    worst = 0.0
    for k in np.linspace(80, 120, 9):
        loop = s * s + 2 * s + k - (gains[0] + gains[1] * s) * np.exp(-s * time)
        worst = max(worst, float(np.sqrt((abs(1 / loop) ** 2 * width).sum() / (2 * np.pi))))
    return worst


def designed(time, folder):
    """The least rms that is proved, and the law's gains, for a dead time."""
    path = Path(folder, "late.toml")
    path.write_text(SPEC.replace("time = 0.05", f"time = {time}"))
    plant = pf.load(path)
    least, limits = pf.load_specifications(path)
    region = pf.load_region(path)
    best = pf.optimise(plant, least, limits, region, structure=pf.load_structure(path))
    path.unlink()
    gain = best.design.law.gain(np.full(len(plant.vertices), 1 / len(plant.vertices)))
    return best.bounds[0].level, gain[0, :2]


def rows(folder, times=TIMES):
    """Dead time [s], proved and exact rms [m] of the best law for each."""
    for time in times:
        level, gains = designed(time, folder)
        yield time, level, exact(gains, time)


def main(folder="."):
    """Design, print and draw."""
    table = list(rows(folder))
    for time, level, truth in table:
        print(f"{1000 * time:.0f} ms: {level:.6f} m proved, {truth:.6f} m exact")
    figure, (ax,) = pf.plots.new_figure(1, 5.2, 3.4)
    ms = [1000 * time for time, *_ in table]
    ax.semilogx(
        ms, [1000 * truth for *_, truth in table], "s-", label="exact, worst of nine springs"
    )
    ax.semilogx(ms, [1000 * level for _, level, _ in table], "o--", label="proved for all")
    ax.set(xlabel="dead time of the force [ms]", ylabel="rms of the position [mm]")
    ax.set_ylim(bottom=0)
    ax.legend(loc="upper left")
    Path(folder, "dead-time.png").write_bytes(pf.plots.render(figure, "png"))


if __name__ == "__main__":
    main(*sys.argv[1:])
