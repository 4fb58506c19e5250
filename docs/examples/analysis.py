"""Gains that are given: published ones, a table on a car, and an aircraft's; answers and figures.

``python docs/examples/analysis.py [FOLDER]`` writes analysis-table.png, analysis-f4e.png and the
table of gains, car-gains.json, into the folder, by default here.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_are

import polefence as pf
from polefence.base.files import write_bytes, write_text
from polefence.region.text import digits_down, digits_up

# Leite & Peres (2005): fixed gains for disks about -40, by Lemma 1 and Lemma 2
PUBLISHED = {
    33.7: [[51590, 59600, -5060, 2550, 175300]],
    33.6: [[52930, 59680, -5150, 2560, 181210]],
}
WISHES = pf.HalfPlane(4.6), pf.HalfPlane(5) & pf.Sector(0.205)
FLIGHT = pf.HalfPlane(1) & pf.Sector(0.7)
CONDITIONS = "Mach 0.5, 5000 ft", "Mach 0.85, 5000 ft", "Mach 0.9, 35000 ft", "Mach 1.5, 35000 ft"


def lqr(A, B, Q, R):
    """Return the K of u = K x that minimises the integral of x'Qx + u'Ru; minus that of `lqr`."""
    return -np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))


def published():
    """Return what the paper's fixed gains do on the physical car: analyses at the paper's disks."""
    car = pf.examples.family("quarter-car-physical")
    return [pf.analyse(car, K, pf.Disk(-40, r)) for r, K in PUBLISHED.items()]


def table(car):
    """Return the table of LQR gains at 5 x 5 knots of load and age."""
    grid = {p.name: np.linspace(float(p.low), float(p.high), 5) for p in car.parameters}
    Q, R = 10 * np.diag([1e4, 1e3, 1, 1, 1e6]), np.array([[1e-4]])
    gains = [
        [lqr(*car.at(car.alpha(m1=m1, beta=beta)), Q, R) for beta in grid["beta"]]
        for m1 in grid["m1"]
    ]
    return pf.GainTable(car.parameters, grid, gains)


def tables():
    """Return the analyses of the table for both wishes."""
    car = pf.examples.family("quarter-car-physical")
    return [pf.analyse(car, table(car), wish) for wish in WISHES]


def plain(found):
    """Return the analysed table as the command line reads one."""
    grid = {name: [float(v) for v in knots] for name, knots in found.table.grid.items()}
    return json.dumps({"grid": grid, "gains": found.table.gains.tolist()})


def flights():
    """Return the aircraft, and for each flight condition the gain designed there, to 4 decimals."""
    plant = pf.examples.family("f4e")
    Q, R = np.diag([1e-3, 1, 0]), np.eye(1)
    return plant, [np.round(lqr(v.A, v.B, Q, R), 4) for v in plant.vertices]


def draw(plant, gains):
    """Return the figure of the aircraft's poles over the envelope, for two of the gains."""
    alpha = np.random.default_rng(1).dirichlet(np.full(4, 0.5), 1500)
    panels = {}
    for k in (0, 3):
        law = pf.FixedGain(gains[k])
        clouds = []
        for points in (alpha, np.eye(4)):
            A, B = plant.at(points)
            clouds.append(np.linalg.eigvals(A + B @ law.gain(points)))
        panels[f"LQR gain of {CONDITIONS[k]}"] = tuple(clouds)
    return pf.plots.poles_figure(panels, FLIGHT)


def main(folder="."):
    """Analyse, print what the page says, and draw."""
    for answer in published():
        print(f"{answer.answer}: {answer.reason}")
    whole, part = tables()
    for found in (whole, part):
        print(f"{found.region}: {found.summary}")
    plant, gains = flights()
    for name, K in zip(CONDITIONS, gains, strict=True):
        decay, damping = (pf.worst_case(plant, K, of) for of in ("half_plane", "sector"))
        proved = [digits_down(decay.region.decay, 4)]
        proved.append(digits_down(damping.region.damping, 4) if damping.region else "none")
        sampled = [digits_up(worst.bound, 4) for worst in (decay, damping)]
        print(f"{name}: K = {K.tolist()}, proved {proved}, sampled {sampled}")
        print(f"  {pf.analyse(plant, K, FLIGHT)}")
    write_text(Path(folder) / "car-gains.json", plain(whole))
    for name, figure in (("table", pf.plots.table_figure(part)), ("f4e", draw(plant, gains))):
        path = Path(folder) / f"analysis-{name}.png"
        write_bytes(path, pf.plots.render(figure, "png"))
        print(f"written: {path}")


if __name__ == "__main__":
    main(*sys.argv[1:])
