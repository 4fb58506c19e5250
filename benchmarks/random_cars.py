"""How near the proof of a law comes to its worst car, for random cars with hardware.

python benchmarks/random_cars.py [--count 20] [--first 0]

A car has random sizes and ranges of load, spring and tyre, an actuator of 20 to 60 Hz, sensors of
the suspension's deflection and the body's acceleration with noise, and a law of order 1 or 2 that
minimises the rms of the acceleration on a road of class C. For each a law is designed in
continuous time, and one at a sample time of 1 to 5 ms, up to one sample late. Every bound that is
within a tenth of what limits it is compared with the worst case: the largest of all vertices and
10,000 points of the box, from the best of which a local search goes on. It is a lower limit of the
truth, so proved / worst is at least as good as what is printed.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tight import worst_of

import polefence as pf
from polefence.base.errors import NotProvedError

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.every_command import EQUATIONS, SIGNALS

SPEC = """
name = "car {seed}"
{SIGNALS}[constants]
m2 = {m2:.3g}
c = {c:.4g}
[parameter.m1]
range = [{light:.4g}, {laden:.4g}]
unit = "kg"
through = "1/m1"
[parameter.k]
range = [{soft:.5g}, {stiff:.5g}]
unit = "N/m"
[parameter.kt]
range = [{flat:.6g}, {hard:.6g}]
unit = "N/m"
{EQUATIONS}[actuator."actuator force"]
bandwidth = {actuator:.3g}
[sensor."suspension deflection"]
bandwidth = {sensor:.3g}
noise = {of_travel:.2g}
[sensor."sprung-mass acceleration"]
bandwidth = {sensor:.3g}
noise = {of_acceleration:.2g}
[road]
class = "C"
speed = 20
[law]
measured = ["measured suspension deflection", "measured sprung-mass acceleration"]
schedule = []
order = {order}
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
at_most = {force:.3g}
"""


def spec_of(seed: int) -> str:
    """Return a random car."""
    rng = np.random.default_rng(seed)
    light, k, kt = rng.uniform(200, 500), rng.uniform(15e3, 40e3), rng.uniform(130e3, 320e3)
    laden = light * rng.uniform(1.2, 2.0)
    k_off, kt_off = rng.uniform(0.03, 0.15), rng.uniform(0.03, 0.1)
    return SPEC.format(
        SIGNALS=SIGNALS,
        EQUATIONS=EQUATIONS,
        seed=seed,
        light=light,
        laden=laden,
        soft=k * (1 - k_off),
        stiff=k * (1 + k_off),
        flat=kt * (1 - kt_off),
        hard=kt * (1 + kt_off),
        m2=rng.uniform(25, 60),
        c=rng.uniform(800, 2000),
        actuator=rng.uniform(20, 60),
        sensor=rng.uniform(60, 150),
        of_travel=10 ** rng.uniform(-3.7, -3),
        of_acceleration=10 ** rng.uniform(-2, -1),
        order=rng.integers(1, 3),
        force=rng.uniform(0.8, 1.3) * laden,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    ratios: dict[str, list[float]] = {"continuous time": [], "at samples": []}
    for seed in range(options.first, options.first + options.count):
        rng = np.random.default_rng([seed, 1])
        T, delay = round(rng.uniform(1e-3, 5e-3), 4), int(rng.integers(0, 2))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "car.toml"
            path.write_text(spec_of(seed))
            plant, (least, limits) = pf.load(path), pf.load_specifications(path)
            structure = pf.load_structure(path)
        for kind, asked in (
            ("continuous time", plant),
            ("at samples", pf.at_sample_time(plant, T, delay)),
        ):
            start = time.process_time()
            try:
                done = pf.optimise(asked, least, limits, structure=structure)
            except NotProvedError as error:
                print(f"{seed:3d} {kind}: {error}", flush=True)
                continue
            took = time.process_time() - start
            found = list[float]()
            for bound in done.bounds:
                worst = worst_of(done.plant, done.law, bound.specification, 10_000)
                most = bound.specification.at_most
                if most is None or worst > 0.9 * most:
                    found.append(bound.level / worst)
            ratios[kind] += found
            words = f" at {1e3 * T:g} ms, {delay} late" if kind == "at samples" else ""
            said = " ".join(f"{ratio:.6f}" for ratio in found)
            print(f"{seed:3d} {kind}{words}: {said} ({took:.1f} s)", flush=True)
    for kind, each in ratios.items():
        if each:
            print(
                f"{kind}: {len(each)} bounds, proved / worst: least {min(each):.6f}, "
                f"mean {np.mean(each):.6f}, largest {max(each):.6f}"
            )


if __name__ == "__main__":
    main()
