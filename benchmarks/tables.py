"""A van whose spring is a table of its load: laws at samples and while the load moves.

python benchmarks/tables.py

Two parameters, an actuator, two sensors, a law with one state. Prints the proved and the sampled
rms of the body's acceleration, in how many parts of the box its proof is, and seconds.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

SPEC = """
name = "van with a progressive spring"
states = [
    "suspension deflection [m]",
    "tyre deflection [m]",
    "sprung-mass velocity [m/s]",
    "unsprung-mass velocity [m/s]",
]
inputs = ["actuator force [N]"]
disturbances = ["road velocity [m/s]"]
[vehicle]
model = "quarter car"
[constants]
m2 = 48
c = 1400
[parameter.m1]
range = [280, 620]
unit = "kg"
through = "1/m1"
[parameter.kt]
range = [189000, 231000]
unit = "N/m"
[table.spring]
arguments = [280, 420, 620]
values = [18700, 20200, 25300]
[definitions]
k = "spring(m1)"
[matrices]
A = [
    [0, 0, -1, 1],
    [0, 0, 0, -1],
    ["k/m1", 0, "-c/m1", "c/m1"],
    ["-k/m2", "kt/m2", "c/m2", "-c/m2"],
]
B = [[0], [0], ["1/m1"], ["-1/m2"]]
E = [[0], [1], [0], [0]]
[actuator."actuator force"]
bandwidth = 40
[sensor."suspension deflection"]
bandwidth = 100
noise = 0.0005
[sensor."sprung-mass acceleration"]
bandwidth = 100
noise = 0.05
[road]
class = "C"
speed = 20
[law]
measured = ["measured suspension deflection", "measured sprung-mass acceleration"]
schedule = []
order = 1
[[specification]]
kind = "rms"
signal = "sprung-mass acceleration"
minimise = true
[[specification]]
kind = "rms"
signal = "suspension deflection"
at_most = 0.03
[[specification]]
kind = "rms"
signal = "actuator force"
at_most = 660
"""
CASES = {
    "at all times": (None, []),
    "5 ms": (None, ["--sample-time", "0.005"]),
    "2 ms, one sample late": (None, ["--sample-time", "0.002", "--delay", "1"]),
    "load moves by 20 kg/s": (20, []),
}


def tool(*words: str) -> None:
    """Run a command of polefence."""
    subprocess.run([sys.executable, "-m", "polefence", *words], check=True, capture_output=True)


def parts_of(claim: dict[str, Any]) -> int:
    """Return in how many parts of the box a claim is proved."""
    return len(claim["evidence"].get("cells", [None]))


def main() -> None:
    """Print a table."""
    print("case                    proved  sampled   ratio  parts of the rms' proofs  optimise [s]")
    for name, (rate, words) in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            spec, made, said = (Path(folder) / part for part in ("van.toml", "made", "said.json"))
            moving = "" if rate is None else f"\nrate = [-{rate}, {rate}]"
            spec.write_text(SPEC.replace('unit = "kg"', f'unit = "kg"{moving}'))
            start = time.perf_counter()
            tool("optimise", str(spec), *words, "-o", str(made), "--json", str(said))
            seconds = time.perf_counter() - start
            tool("check", str(made), "--spec", str(spec))
            claims = json.loads((made / "design.json").read_text())["claims"]
            parts = [parts_of(claim) for claim in claims if claim["kind"] == "rms"]
            row = next(r for r in json.loads(said.read_text())["bounds"] if r["limit"] is None)
        proved, sampled = float(row["proved"]), float(row["worst sampled"])
        print(
            f"{name:22}{proved:8.4f} {sampled:8.4f} {proved / sampled:7.4f}"
            f"  {', '.join(map(str, parts)):24}{seconds:14.1f}"
        )


if __name__ == "__main__":
    main()
