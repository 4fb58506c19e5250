"""A quarter car on a shaker at four loads: measured, identified, and its family drawn; figure.

``python docs/examples/from_data.py [FOLDER]`` writes the measurements, what is asked of them and
from-data.png into the folder, by default here. The measurements are made up, with noise of 1 %.
"""

import sys
from pathlib import Path

import numpy as np

import polefence as pf

MASSES = (290, 370, 450, 530)  # kg, on the spring
SIGNALS = (("deflection", "body velocity", "body acceleration"), ("force", "road velocity"))

MEASUREMENTS = """name = "quarter car on a shaker"
order = 4
inputs = ["force [N]"]
disturbances = ["road velocity [m/s]"]
outputs = ["deflection [m]", "body velocity [m/s]", "body acceleration [m/s2]"]
direct = ["body acceleration from force"]

[parameter.m1]
label = "sprung mass"
unit = "kg"
through = "1/m1"
""" + "".join(f'\n[[measurement]]\nfile = "{m}.csv"\nat = {{m1 = {m}}}\n' for m in MASSES)

ASKED = """
[actuator.force]
bandwidth = 60       # rad/s; measured up to 157 rad/s

[law]
measured = ["deflection", "body velocity"]
schedule = ["m1"]

[[specification]]
kind = "rms"
signal = "body acceleration"
density = 0.003      # of the road's velocity
minimise = true

[[specification]]
kind = "rms"
signal = "force"
density = 0.003
at_most = 400
"""

CAR = """name = "quarter car of springs and dampers"
states = ["deflection [m]", "tyre deflection [m]", "body velocity [m/s]", "wheel velocity [m/s]"]
inputs = ["force [N]"]
disturbances = ["road velocity [m/s]"]

[constants]
m2 = 36
kt = 170000

[parameter.m1]
range = [290, 530]
unit = "kg"
through = "1/m1"

[parameter.k]
range = [5000, 40000]
unit = "N/m"

[parameter.c]
range = [200, 5000]
unit = "N s/m"

[matrices]
A = [
    [0, 0, -1, 1],
    [0, 0, 0, -1],
    ["k/m1", 0, "-c/m1", "c/m1"],
    ["-k/m2", "kt/m2", "c/m2", "-c/m2"],
]
B = [[0], [0], ["1/m1"], ["-1/m2"]]
E = [[0], [1], [0], [0]]
"""
UNKNOWN = """spec = "car.toml"
unknown = ["k", "c"]
margin = 0.01
inputs = ["force", "road velocity"]
outputs = ["deflection", "body velocity"]
""" + "".join(f'\n[[measurement]]\nfile = "{m}.csv"\nat = {{m1 = {m}}}\n' for m in MASSES)


def measured(m1, source):
    """The text of a CSV file: frequency responses in 120 lines, each value off by 1 %."""
    m2, k, c, kt = 36, 17000, 1200, 170000
    A = np.array(
        [
            [0, 0, -1, 1],
            [0, 0, 0, -1],
            [k / m1, 0, -c / m1, c / m1],
            [-k / m2, kt / m2, c / m2, -c / m2],
        ]
    )
    B = np.array([[0, 0], [0, 1], [1 / m1, 0], [-1 / m2, 0]])
    C, D = np.array([[1, 0, 0, 0], [0, 0, 1, 0], A[2]]), np.array([[0, 0], [0, 0], B[2]])
    hertz = np.geomspace(0.5, 25, 120)
    G = np.array([C @ np.linalg.solve(2j * np.pi * f * np.eye(4) - A, B) + D for f in hertz])
    G *= 1 + 0.01 * (source.standard_normal(G.shape) + 1j * source.standard_normal(G.shape))
    head, columns = ["frequency [Hz]"], [hertz]
    for i, output in enumerate(SIGNALS[0]):
        for j, inside in enumerate(SIGNALS[1]):
            pair = f"{output} from {inside}"
            head += [f"magnitude of {pair}", f"phase of {pair} [deg]"]
            columns += [abs(G[:, i, j]), np.degrees(np.angle(G[:, i, j]))]
    lines = [",".join(f"{x:.5g}" for x in row) for row in np.array(columns).T]
    return "\n".join([",".join(head), *lines]) + "\n"


def files():
    """All files by their names."""
    source = np.random.default_rng(1)
    found = {f"{m}.csv": measured(m, source) for m in MASSES}
    found |= {"measurements.toml": MEASUREMENTS, "asked.toml": ASKED}
    return found | {"car.toml": CAR, "unknown.toml": UNKNOWN}


def main(folder):
    """Write the files; identify the family and draw it."""
    from polefence.show.fitted import fit_figure

    for name, text in files().items():
        (folder / name).write_text(text)
    found = pf.data.load_measurements(folder / "measurements.toml").answer()
    print(found)
    fit_figure(found).savefig(folder / "from-data.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
