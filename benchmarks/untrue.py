"""Changed files of claims: is any accepted by `check` though samples contradict it?

python benchmarks/untrue.py --files 300

Of each proof file of `tests/support/every_file.py`, and of larger plants with hardware, weights,
samples and moving parameters, so many files are made: numbers, matrices, keys and parts are changed
(`tests/support/untrue.py`). What `check` accepts is held against eigenvalues, Lyapunov equations
and simulations at corners and at random parameters, in floats (`tests/support/truths.py`). Prints
Markdown; a file that is accepted and false is written to the working folder, and the exit status
is then 1.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.every_file import BOTH, DISCRETE, LAG, SPEC, quiet, write_every_file
from support.untrue import Run

TWO = SPEC.replace("[constants]\nc = 1\n", "").replace(
    "[definitions]", '[parameter.c]\nrange = [0.5, 1.5]\nunit = "N s/m"\n[definitions]'
).replace('through = "k"\n', "")  # fmt: skip
MASS = """name = "mass"
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
[parameter.m]
range = [1, 2]
unit = "kg"
through = "1/m"
[parameter.c]
range = [0.5, 1.5]
unit = "N/m"
[matrices]
A = [[0, 1], ["-c/m", "-1/m"]]
B = [[0], ["1/m"]]
E = [[0], [1]]
"""
HARDWARE = (
    SPEC.replace('region = "disk(-3, 2.5)"\n', "")
    + "[actuator.u]\nbandwidth = 3\n[sensor.x]\nbandwidth = 5\nnoise = 0.01\n"
)
CART = """name = "cart"
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
[parameter.m]
range = [1, 1.2]
unit = "kg"
through = "1/m"
[parameter.c]
range = [3, 3.5]
unit = "N/m"
[parameter.d]
range = [0.5, 0.7]
unit = "N s/m"
[matrices]
A = [[0, 1], ["-c/m", "-d/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
[sensor.x]
bandwidth = 8
noise = 0.001
"""
MOTOR = (
    LAG
    + """[actuator.u]
bandwidth = 2
[[specification]]
kind = "saturation"
signal = "rate of u"
at_most = 100
points = [[1, 0]]
"""
)
PID = (
    LAG.replace("at_most = 5", "minimise = true")
    + """[law]
measured = ["x"]
kind = "pid"
derivative_bandwidth = 0.5
pattern = [["p", "i", 0]]
largest_gain = 6
schedule = []
[[specification]]
kind = "saturation"
signal = "u"
at_most = 1.6
points = [[1]]
"""
)
SPECS = {
    "both": BOTH,
    "cart": CART,
    "motor": MOTOR,
    "pid": PID,
    "plain": SPEC,
    "two": TWO,
    "mass": MASS,
    "hardware": HARDWARE,
    "steps": DISCRETE.replace('unit = "N/m"', 'unit = "N/m"\nrate = [-1, 2]'),
    "moving": MASS.replace('"1/m"\n[', '"1/m"\nrate = [-0.5, 0.5]\n[').replace(
        'unit = "N/m"', 'unit = "N/m"\nrate = "any"'
    ),
}
LIMITS = "--minimise|rms of x with density 1|--limit|rms of u <= 60 with density 1|"
GAIN, ENERGY = "--limit|gain of v <= 10|", "--limit|energy peak of v <= 20 with norm 1|"
CUT = "--limit|saturation of u <= 5 with norm 1|"
LATE = "--region|disk(0, 1)|--delay|1|--measured|x,v|--sample-time|"
NODES = (
    "--minimise|rms of x with density 1|--region|disk(0, 1)|--measured|measured x|--sample-time|0.1"
)
WEIGHT = "--minimise|rms of x with density 1 with weight Wk|--limit|rms of u <= 50 with density 1|"
HALF = "--region|disk(0, 1)|--sample-time|0.1|--delay|0.5"
COMMANDS = (
    f"optimise|plain.toml|{LIMITS}{GAIN}{HALF}|-o|half",
    f"optimise|two.toml|{LIMITS}{GAIN}{LATE}0.1|--delay|1.3|--schedule|none|-o|two-more",
    f"optimise|cart.toml|{NODES}|--delay|1.3|--schedule|none|-o|nodes-more",
    f"verify|both.toml|--gain|[[-3, 0, 0]]|{HALF}|--delay|1.3|-o|limits-more",
    "verify|motor.toml|--gain|[[-5, -0.5]]|--region|half_plane(0.1)|-o|rate-limit",
    "optimise|pid.toml|--region|half_plane(0.1)|-o|windup",
    f"optimise|pid.toml|{HALF}|--sample-time|0.05|-o|windup-half",
    "export|half|-o|half-code",
    "service|two-more|-o|two-more-service",
    f"optimise|cart.toml|{NODES}|--delay|1|--order|1|--schedule|none|-o|nodes",
    f"optimise|cart.toml|{NODES}|-o|nodes-scheduled",
    f"optimise|hardware.toml|--measured|measured x|--schedule|none|--order|1|{LIMITS}{GAIN}-o|"
    "order",
    f"optimise|hardware.toml|--measured|measured x,u|{LIMITS}{GAIN}-o|hardware",
    f"optimise|plain.toml|{WEIGHT}--measured|x,v|-o|weight",
    f"optimise|plain.toml|{WEIGHT}{LATE}0.05|--schedule|none|-o|weight-late",
    f"optimise|two.toml|{LIMITS}{GAIN}{LATE}0.1|-o|two-late",
    f"optimise|plain.toml|{LIMITS}{LATE}0.05|--schedule|none|--jitter|0.1|-o|clock",
    f"optimise|plain.toml|{LIMITS}{HALF}|--schedule|none|--jitter|0.1|-o|clock-half",
    f"optimise|plain.toml|{LIMITS}{LATE}0.05|--schedule|none|--lost|1|-o|clock-lost",
    f"optimise|plain.toml|{LIMITS}{HALF}|--schedule|none|--jitter|0.1|--lost|1|-o|clock-both",
    f"optimise|two.toml|{LIMITS}{CUT}--region|disk(0, 1)|--sample-time|0.1|-o|saturation-late",
    f"optimise|mass.toml|{LIMITS}{GAIN}-o|mass",
    f"optimise|steps.toml|{LIMITS}{GAIN}{ENERGY}--region|disk(0, 0.99)|-o|steps",
    f"optimise|moving.toml|{LIMITS}{GAIN}{ENERGY}{CUT}--region|half_plane(0.1)|-o|moving",
    "design|mass.toml|--disk|-3|2.7|--method|scheduled|--degree|2|-o|degree",
    "design|mass.toml|--region|disk(-3, 2.8) & half_plane(0.2) & sector(0.4)|--method|slack"
    "|-o|slack",
    "design|two.toml|--region|ellipse(-3, 2.5, 2) & vertical_strip(-6, -0.3) & horizontal_strip(3)"
    "|--method|scheduled|-o|strips",
    "design|two.toml|--region|wedge(-0.2, 2) & disk(-3, 2.9)|-o|wedge",
    "observe|two.toml|--measured|x|--disk|-4|3.5|-o|observer",
    "export|degree|--sample-time|0.001|--float|32|-o|degree-code",
    "export|two-late|-o|two-late-code",
    "service|degree|-o|degree-service",
    "service|hardware|-o|hardware-service",
    "service|order|-o|order-service",
    "service|two-late|-o|two-late-service",
    "design|car.toml|--disk|-40|31|--method|scheduled|-o|car",
    "service|car|-o|car-service",
    "semi-active|semi.toml|-o|semi",
    "optimise|active.toml|-o|active",
)  # fmt: skip
EXAMPLES = {
    "car": "quarter-car-physical",
    "semi": "semi-active",
    "active": "active-suspension",
}


def write_more(made: Path) -> None:
    """Write the files of larger plants into the working folder."""
    for name, text in SPECS.items():
        (made / f"{name}.toml").write_text(text)
    for name, example in EXAMPLES.items():
        (made / f"{name}.toml").write_text(quiet(["example", example])[1])
    for line in COMMANDS:
        status, _, err = quiet(line.split("|"))
        if status:
            raise SystemExit(f"{line}: {err}")


def read_all(folder: Path) -> dict[str, Any]:
    """Return every file of claims below a folder, by its path."""
    found = {}
    for path in sorted(folder.rglob("*.json")):
        document = json.loads(path.read_text())
        if isinstance(document, dict) and document.get("format") == "polefence-proof":
            found[str(path.relative_to(folder.parent))] = document
    return found


def originals() -> dict[str, Any]:
    """Return one file of every kind, and those of larger plants."""
    here, found = Path.cwd(), dict[str, Any]()
    with tempfile.TemporaryDirectory() as made:
        for name, write in (("small", write_every_file), ("larger", write_more)):
            folder = Path(made) / name
            folder.mkdir()
            os.chdir(folder)
            write(folder)
            found |= read_all(folder)
        os.chdir(here)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path, help="of proof files; default: our own")
    parser.add_argument("--files", type=int, default=300, help="changed files of each")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each, at most")
    parser.add_argument("--seed", type=int, default=0)
    own = parser.parse_args()
    documents = dict[str, Any]()
    for folder in own.folders:
        documents |= read_all(folder.resolve())
    run, kinds = Run(documents or originals()), dict[str, Counter[str]]()
    for name, document in run.documents.items():
        count = run.of(name, own.files, own.seconds, own.seed)
        print(row(name, count), file=sys.stderr, flush=True)
        for kind in {claim["kind"] for claim in document["claims"]}:
            kinds.setdefault(kind, Counter()).update(count)
    print("| files with a claim | changed | refused | accepted | not judged | false |")
    print("|---|--:|--:|--:|--:|--:|")
    for kind in sorted(kinds):
        print(row(kind, kinds[kind]))
    print(row(f"all, of {len(run.documents)}", sum(run.counts.values(), Counter())))
    for k, (why, document) in enumerate(run.faults):
        path = Path(f"untrue-{k + 1}.json")
        path.write_text(json.dumps(document, indent=1))
        print(f"{path}: {why}")
    return 1 if run.faults else 0


def row(name: str, count: Counter[str]) -> str:
    """Return a row of the table."""
    keys = ("files", "refused", "accepted", "not judged", "false")
    return f"| {name} | {' | '.join(str(count[key]) for key in keys)} |"


if __name__ == "__main__":
    sys.exit(main())
