"""COMPleib: one of its helicopters over all airspeeds, and a survey of the others; figure.

``python docs/examples/compleib.py [FOLDER]`` prints the page's numbers and writes compleib.png into
the folder, by default here. It takes some seconds. The survey is read from docs/performance.md,
where `benchmarks/compleib.py` printed it.
"""

import re
import sys
from pathlib import Path

import numpy as np

import polefence as pf
from polefence.plant.spec import loads

KNOTS = {60: (0.06635, 0.1198, 0.9775), 135: (0.3681, 1.42, 3.5446), 170: (0.5047, 2.526, 5.112)}
SPEC = """
name = "helicopter"
states = ["forward speed [kn]", "vertical speed [kn]", "pitch rate [deg/s]", "pitch [deg]"]
inputs = ["collective", "cyclic"]
"""
VERTEX = """
[[vertex]]
A = [
    [-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208],
    [0.1002, {}, -0.707, {}], [0, 0, 1, 0],
]
B = [[0.4422, 0.1761], [{}, -7.5922], [-5.52, 4.49], [0, 0]]
"""
ROW = re.compile(r"^\| (\w+) \| (\d+), (\d+), (\d+) \|(.*)\|$", re.MULTILINE)


def helicopter():
    """HE1 of COMPleib at 60, 135 and 170 knots, and all between."""
    return loads(SPEC + "".join(VERTEX.format(*own) for own in KNOTS.values()))


def survey():
    """Name, states, and the norms H2, H-infinity, of one plant and of the family, per plant."""
    text = (Path(__file__).parents[1] / "performance.md").read_text()
    for name, states, *_, cells in ROW.findall(text):
        numbers = [cell.strip().rstrip("*") for cell in cells.split("|")]
        if all(re.match(r"[\d.e+-]*\d$", own) for own in numbers):
            yield name, int(states), np.array(numbers, dtype=float)


def draw(plant, design, folder):
    """Draw the helicopter's poles, and what an uncertainty of 10 % costs each plant."""
    figure, (left, right) = pf.plots.new_figure(2, 10.5, 4.2)
    alpha = np.random.default_rng(0).dirichlet(np.ones(3) / 2, 4000)
    before, after = np.linalg.eigvals(plant.at(alpha)[0]), design.poles(alpha)
    left.plot(before.real.ravel(), before.imag.ravel(), ".", ms=1.5, color="0.6", rasterized=True)
    left.plot(after.real.ravel(), after.imag.ravel(), ".", ms=1.5, color="#2166ac", rasterized=True)
    left.plot([], [], "s", color="0.6", label="no control")
    left.plot([], [], "s", color="#2166ac", label="vertical speed fed back")
    left.axvline(0, color="0.3", lw=0.8)
    left.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]", xlim=(-3, 1.2))
    left.set_title("HE1 from 60 to 170 knots")
    left.legend(fontsize=8.5, loc="lower left")
    rows = [own for own in survey() if own[2].min() > 1e-6]
    rows.sort(key=lambda own: own[2][3] / own[2][1])
    for i, (_, _, (h2, hinf, h2_family, hinf_family)) in enumerate(rows):
        right.plot(i, h2_family / h2, "o", color="#b2182b", ms=4)
        right.plot(i, hinf_family / hinf, "s", color="#2166ac", ms=4)
    right.plot([], [], "o", color="#b2182b", label="H2")
    right.plot([], [], "s", color="#2166ac", label="H∞")
    right.axhline(1, color="0.3", lw=0.8)
    right.set(
        ylabel="norm of the family, over that of one", title="a gain for 10 % beside a gain for one"
    )
    right.set_xticks(range(len(rows)), [name for name, *_ in rows], rotation=90, fontsize=7.5)
    right.legend(fontsize=8.5)
    Path(folder, "compleib.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Design, print and draw."""
    plant = helicopter()
    for knots, poles in zip(KNOTS, np.linalg.eigvals(plant.A), strict=True):
        print(f"{knots} knots, no control: rightmost pole {poles.real.max():.4f} 1/s")
    within = pf.parse_region("disk(-30, 30)")
    structure = pf.Structure(measured=["vertical speed"], schedule=())
    design = pf.tightest(plant, of="half_plane", within=within, structure=structure)
    rate = float(design.region.parts[0].decay)
    print(f"vertical speed fed back: decay rate {np.floor(1e4 * rate) / 1e4:.4f} 1/s proved")
    rows = list(survey())
    print(f"{len(rows)} plants of {min(r[1] for r in rows)} to {max(r[1] for r in rows)} states")
    draw(plant, design, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
