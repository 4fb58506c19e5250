"""Twelve cars: what each can do, and how few laws keep them all, by a study; figure.

``python docs/examples/fleet.py [FOLDER]`` prints the page's numbers and writes fleet.png into the
folder, by default here; the study's results go to a temporary folder. It takes some seconds.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import polefence as pf

CAR = """
name = "quarter car"
states = [
    "suspension deflection [m]", "tyre deflection [m]", "body velocity [m/s]",
    "wheel velocity [m/s]",
]
inputs = ["actuator force [N]"]

[constants]
m2 = 28.58      # kg, wheel
kt = 155900     # N/m, tyre
k = 10000       # N/m, spring
c = 850         # N s/m, damper

[parameter.m1]  # body with its load
range = [231.12, 346.68]
unit = "kg"
through = "1/m1"

[matrices]
A = [
    [0, 0, -1, 1],
    [0, 0, 0, -1],
    ["k/m1", 0, "-c/m1", "c/m1"],
    ["-k/m2", "kt/m2", "c/m2", "-c/m2"],
]
B = [[0], [0], ["1/m1"], ["-1/m2"]]
"""
STUDY = """
name = "twelve cars"
base = "car.toml"

[variants]
grid = {kt = [110000, 120000, 130000, 230000, 240000, 250000], m2 = [25, 35]}

[[question]]                # what can each do?
ask = "tightest"
centre = -40

[[question]]                # as few gains as possible, one of which keeps each car
ask = "cover"
region = "disk(-40, 38.5)"
"""
REGION = pf.parse_region("disk(-40, 38.5)")
STYLES = (("o", "#2166ac"), ("s", "#b2182b"), ("^", "#e08214"), ("v", "0.4"))


def answers(folder):
    """Rows of the study, by question and variant, and the laws that are shared."""
    folder.joinpath("car.toml").write_text(CAR)
    folder.joinpath("study.toml").write_text(STUDY)
    rows, laws = {"tightest": {}, "cover": {}}, {}
    with ThreadPoolExecutor(1) as pool:  # in this process; by default one for each processor
        workers = pf.fleet.given(pool)
        for row in pf.study(folder / "study.toml", folder / "results", workers=workers):
            rows[row["question"]][row["variant"]] = row
    for row in rows["cover"].values():
        proof = folder / "results" / "proofs" / row["proof"][:2] / f"{row['proof']}.json"
        laws.setdefault(row["law"], []).append((row, pf.Design.load(proof)))
    return rows, sorted(laws.values(), key=lambda own: own[0][0]["variant"])


def draw(rows, laws, folder):
    """Draw the least radii, and the poles of all cars with the law of each."""
    figure, (left, right) = pf.plots.new_figure(2, 9.5, 4.0)
    for number, (own, (marker, colour)) in enumerate(zip(laws, STYLES, strict=False), 1):
        kept = [rows["tightest"][row["variant"]] for row, _ in own]
        for m2, face in ((25, colour), (35, "white")):
            some = [row for row in kept if row["m2"] == m2]
            left.plot(
                [row["kt"] / 1e3 for row in some], [row["bound"] for row in some], marker,
                color=colour, mfc=face, label=f"wheel of {m2} kg, kept by law {number}",
            )  # fmt: skip
        alpha = np.linspace([1, 0], [0, 1], 60)
        poles = np.concatenate([design.poles(alpha).ravel() for _, design in own])
        right.plot(poles.real, poles.imag, ".", ms=2, color=colour, label=f"law {number}")
    edge = -40 + 38.5 * np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    right.plot(edge.real, edge.imag, color="black", lw=1.2)
    left.set(xlabel="stiffness of the tyre [kN/m]", ylabel="radius [1/s]")
    left.set_title("smallest proved disk at -40 1/s")
    left.legend(fontsize=8.5, loc="upper right")
    right.set(
        xlabel="real part [1/s]", ylabel="imaginary part [1/s]", aspect="equal", ylim=(-44, 56)
    )
    right.set_title("poles with the shared laws")
    right.legend(fontsize=8.5, markerscale=4, loc="upper center", ncols=2)
    Path(folder, "fleet.png").write_bytes(pf.plots.render(figure, "png"))


def main(folder="."):
    """Ask, print and draw."""
    with TemporaryDirectory() as own:
        rows, laws = answers(Path(own))
    radii = [row["bound"] for row in rows["tightest"].values()]
    print(f"a law for each car: radius {min(radii):.2f} to {max(radii):.2f} 1/s, proved")
    print(f"{REGION} for all {len(radii)} cars: {len(laws)} laws")
    for number, own in enumerate(laws, 1):
        stiffness = sorted({row["kt"] / 1e3 for row, _ in own})
        shown = ", ".join(f"{kt:.0f}" for kt in stiffness)
        print(f"law {number}: {len(own)} cars, tyres of {shown} kN/m")
    draw(rows, laws, folder)


if __name__ == "__main__":
    main(*sys.argv[1:])
