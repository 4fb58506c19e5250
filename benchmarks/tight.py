"""How near proved bounds of given loops come to the worst case, on random plants.

python benchmarks/tight.py --count 108 --kind gain
python benchmarks/tight.py --count 109 --kind rms

A plant has two to eight states; its A has random poles, of every third plant lightly damped ones
(damping ratio 0.01 to 0.1), in random coordinates. One to three parameters multiply one row of A
each, by 0.8 to 1.2. Plants that are not stable everywhere are left out. The bound is on one output
from one disturbance, of the loop as it is (K = 0). The worst case is the largest of 2,000 points
and all vertices, from the best of which a local search goes on; it is a lower limit of the truth,
so proved / worst is at least as good as what is printed. Prints the distribution, and with --each a
row for each plant.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import time
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import minimize

from polefence import FixedGain, Gain, Parameter, Rms, UncertainPlant
from polefence.base.errors import PolefenceError
from polefence.certify.bounds import best_bound, sampled
from polefence.law.laws import Law

DENSITY = 2.0  # one-sided: noise of intensity one
STARTS = 3
LIMITS = (1.0001, 1.001, 1.01, 1.05)


def plant_of(seed: int) -> UncertainPlant | None:
    """Return a random plant, None where it is not stable everywhere."""
    rng = np.random.default_rng(seed)
    n, count = int(rng.integers(2, 9)), int(rng.integers(1, 4))
    A = np.zeros((n, n))
    for i in range(0, n - 1, 2):
        zeta = rng.uniform(0.01, 0.1) if seed % 3 == 0 else rng.uniform(0.1, 0.9)
        w = 10 ** rng.uniform(-0.7, 1.0)
        A[i : i + 2, i : i + 2] = [[0, w], [-w, -2 * zeta * w]]
    if n % 2:
        A[-1, -1] = -(10 ** rng.uniform(-0.7, 1.0))
    T = rng.standard_normal((n, n))
    A = np.linalg.solve(T, A @ T)
    rows = rng.permutation(n)[: min(count, n)]
    E, C = rng.standard_normal((n, 1)), rng.standard_normal((1, n))
    names = [f"p{k}" for k in range(len(rows))]
    vertices = []
    for corner in product((0.8, 1.2), repeat=len(rows)):
        own = A.copy()
        own[rows] *= np.array(corner)[:, None]
        vertices.append(own)
    grid = np.array(list(product(np.linspace(0.8, 1.2, 5), repeat=len(rows))))
    scaled = np.repeat(A[None], len(grid), axis=0)
    scaled[:, rows] *= grid[:, :, None]
    if np.linalg.eigvals(scaled).real.max() > -1e-3:
        return None
    entries = [[repr(float(x)) for x in row] for row in A]
    for name, row in zip(names, rows, strict=True):
        entries[row] = [f"{name}*({x})" for x in entries[row]]
    return UncertainPlant.from_expressions(
        parameters=[Parameter(name, 0.8, 1.2) for name in names],
        A=entries,
        B=[["0"]] * (n - 1) + [["1"]],
        E=[[repr(float(x))] for x in E[:, 0]],
        outputs={"y": {"C": [float(x) for x in C[0]]}},
        name=f"plant {seed}",
    )


def worst_of(plant: UncertainPlant, law: Law, asked: Any, points: int = 2000) -> float:
    """Return the worst value that is found."""
    rng, count = np.random.default_rng(0), len(plant.parameters)
    corners = np.array(list(product((0.0, 1.0), repeat=count)))
    at = np.vstack([corners, rng.random((points, count))])

    def alpha(t: Any) -> Any:
        t = np.clip(np.atleast_2d(t), 0, 1)
        return plant.domain.alpha(np.stack([1 - t, t], axis=-1).reshape(len(t), -1))

    values = sampled(plant, law, asked, alpha(at)).values
    best = float(values.max())
    for start in at[np.argsort(-values)[:STARTS]]:
        for _ in range(2):  # from where it ended: a simplex may end early
            found = minimize(
                lambda t: -sampled(plant, law, asked, alpha(t)).worst,
                start,
                method="Nelder-Mead",
                bounds=[(0, 1)] * count,
                options={"xatol": 1e-5, "fatol": 0},
            )
            start, best = found.x, max(best, -float(found.fun))
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--kind", choices=("gain", "rms"), default="gain")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--each", action="store_true")
    options = parser.parse_args()
    asked = Gain("y") if options.kind == "gain" else Rms("y", density=DENSITY)
    ratios, times, seed = [], [], options.first
    while len(ratios) < options.count:
        plant = plant_of(seed)
        seed += 1
        if plant is None:
            continue
        law = FixedGain(np.zeros((1, plant.shape[0])))
        start = time.process_time()
        try:
            bound = best_bound(plant, law, asked)
        except PolefenceError as error:
            bound = None
            print(seed - 1, error)
        times.append(time.process_time() - start)
        ratios.append(np.inf if bound is None else bound.level / worst_of(plant, law, asked))
        if options.each:
            n, N = plant.shape[0], len(plant.parameters)
            print(
                f"{seed - 1:5d} n={n} parameters={N} {ratios[-1]:.6f} {times[-1]:.2f} s", flush=True
            )
    found, took = np.array(ratios), np.array(times)
    print(f"{len(found)} plants, {options.kind}: proved / worst")
    print(f"  least {found.min():.6f}, median {np.median(found):.6f}, largest {found.max():.6f}")
    for limit in LIMITS:
        print(f"  within {limit}: {np.count_nonzero(found <= limit)}")
    print(f"  CPU time: median {np.median(took):.2f} s, largest {took.max():.2f} s")


if __name__ == "__main__":
    main()
