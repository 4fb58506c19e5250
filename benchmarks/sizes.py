"""How large a plant gets a law with a proof: sensors at four corners, and five parameters.

python benchmarks/sizes.py
python benchmarks/sizes.py --only "full car"

The full car is the shipped one (14 states, four forces, two parameters) with a deflection and an
acceleration measured at each corner, by sensors of 100 Hz with noise: 22 states. Its law keeps up
to four states of its own, in continuous time and at samples every 5 ms. The quarter car has five
parameters: both masses, spring, tyre and damper. Once all its states are measured, once two
sensors are, behind an actuator, for a law of order 2.

Each row asks `polefence optimise`, then `polefence check` of its file, in processes of their own
with BLAS on one thread. "Above worst" is what the proved level exceeds the worst of 10,000 samples
by. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from polefence.examples import spec_path

CORNERS = {
    "front left": (1.156, 0.6935),
    "front right": (1.156, -0.6935),
    "rear left": (-1.423, 0.682),
    "rear right": (-1.423, -0.682),
}
FIRST = "[[specification]]"
FIVE = """
[parameter.m2]
range = [42, 52]
unit = "kg"
through = "1/m2"

[parameter.c]
range = [900, 1300]
unit = "N s/m"
"""


def full_car(order: int) -> str:
    """Return the spec of a full car with eight sensors."""
    spec = spec_path("full-car").read_text()
    seats = "".join(f'"{name} mount" = {list(at)}\n' for name, at in CORNERS.items())
    spec = spec.replace("[car.seat]\n", f"[car.seat]\n{seats}")
    sensors, names = "", list[str]()
    for corner in CORNERS:
        for signal, noise in (("suspension deflection", 0.0005), ("mount acceleration", 0.05)):
            sensors += f'[sensor."{corner} {signal}"]\nbandwidth = 100\nnoise = {noise}\n\n'
            names.append(f"measured {corner} {signal}")
    law = f"[law]\nmeasured = {json.dumps(names)}\nschedule = []\norder = {order}\n\n"
    return spec.replace(FIRST, sensors + law + FIRST, 1)


def five_parameters(measured: bool) -> str:
    """Return the spec of a quarter car of five parameters: the shipped van's with two more."""
    spec = spec_path("van").read_text()
    lines = spec.splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith(("m2 =", "c ="))]
    spec = "".join(kept).replace("[constants]\n", "").replace("[matrices]", FIVE + "\n[matrices]")
    if not measured:
        first, last = spec.index("[actuator"), spec.index("[road]")
        law, end = spec.index("[law]"), spec.index(FIRST)
        spec = spec[:first] + spec[last:law] + spec[end:]
    return spec


ROWS = {
    "full car, 8 signals, order 0": (full_car(0), ()),
    "full car, 8 signals, order 4": (full_car(4), ()),
    "full car, 8 signals, order 0, 5 ms": (full_car(0), ("--sample-time", "0.005")),
    "full car, 8 signals, order 4, 5 ms": (full_car(4), ("--sample-time", "0.005")),
    "five parameters, all states": (five_parameters(False), ()),
    "five parameters, 2 sensors, order 2": (five_parameters(True), ()),
}


def timed(*words: str, cwd: str) -> float:
    """Run the program; return how long it took, infinite where it failed."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "polefence", *words],
        cwd=cwd,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        print(done.stderr.strip().splitlines()[-1:], file=sys.stderr)
        return float("inf")
    return time.perf_counter() - start


def row(name: str) -> str:
    """Return a row of the table."""
    spec, options = ROWS[name]
    with TemporaryDirectory() as folder:
        Path(folder, "car.toml").write_text(spec)
        words = ("optimise", "car.toml", "-o", "law", "--json", "law.json", *options)
        search, proof = timed(*words, cwd=folder), float("inf")
        if search < float("inf"):
            proof = timed("check", "law", cwd=folder)
        answer = Path(folder, "law.json")
        bound = json.loads(answer.read_text())["bounds"][0] if answer.exists() else {}
    level, worst = bound.get("proved", float("nan")), bound.get("worst sampled", float("nan"))
    return f"| {name} | {level:.4g} | {level / worst - 1:.1e} | {search:.0f} | {proof:.0f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="rows whose name has this in it")
    options = parser.parse_args()
    print("| plant and law | proved [m/s²] | above worst | optimise [s] | check [s] |")
    print("|---|--:|--:|--:|--:|", flush=True)
    for name in ROWS:
        if options.only in name:
            print(row(name), flush=True)


if __name__ == "__main__":
    main()
