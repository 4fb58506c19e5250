"""The same plant in other units, and more freedom: random plants, how far answers are apart.

python benchmarks/freedom.py --plants 10

Each plant is stable, of two to four states, one input, two parameters or one vertex; every third is
lightly damped. The rms of its first state is minimised within limits on the input and the second
state. Each pair of questions is one where the second answer is not to be worse than the first: a
sensor, an order, a degree or a parameter to schedule on more, a limit less, a limit that does not
bind, or other units of states, input and time, in which it is to be the same. Printed are the
proved levels of the second over those of the first, less one: median, worst, and how many are worse
by more than a thousandth. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"

import argparse
import statistics
import sys
import time
from collections import defaultdict
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

import polefence as pf
from polefence.certify.bounds import sampled
from polefence.plant.points import seeded

WORSE = 1e-3
UNITS = ((1e5, 1e-5, 1.0, 1e3), (1.0, 1e4, 1e-3, 1.0))  # of two states, the input, time
ONE = pf.Structure(schedule=())


def drawn(seed: int) -> tuple[list[Any], tuple[Any, ...]]:
    """Return A, B, E at the vertices, parameters p and q if there are four, and limits."""
    random = np.random.default_rng([46, seed])
    n, corners = 2 + seed % 3, [(0, 0)] if seed % 4 == 3 else list(product((-1, 1), repeat=2))
    A = random.standard_normal((n, n))
    if seed % 3 == 0:  # lightly damped
        A = A - A.T + 0.1 * random.standard_normal((n, n))
    more = 0.2 * random.standard_normal((2, n, n))
    each = np.array([A + a * more[0] + b * more[1] for a, b in corners])
    each = each - (np.linalg.eigvals(each).real.max() + 0.1) * np.eye(n)
    B, E = random.standard_normal((2, n, 1))
    return [each, B, E], (random.uniform(0.3, 1.2), random.uniform(1.0, 1.5))


def plant_of(matrices: list[Any], sizes: Any = 1.0, u: float = 1.0, t: float = 1.0) -> Any:
    """Return the plant with states, input and time in other units."""
    A, B, E = matrices
    d = np.ones(len(B)) * sizes
    A, B, E = A * d / d[:, None] * t, B / d[:, None] * u * t, E / d[:, None] * np.sqrt(t)
    if len(A) == 1:
        return pf.UncertainPlant.from_vertices(A, [B], [E])
    middle, p, q = A.mean(axis=0), (A[2] - A[0]) / 2, (A[1] - A[0]) / 2
    rows = [
        [f"{m!r} + {a!r}*p + {b!r}*q" for m, a, b in zip(*own, strict=True)]
        for own in zip(*(M.tolist() for M in (middle, p, q)), strict=True)
    ]
    return pf.UncertainPlant.from_expressions(
        [pf.Parameter(name, -1, 1) for name in "pq"],
        rows,
        B.tolist(),
        E.tolist(),
        states=tuple(f"x{k + 1}" for k in range(len(d))),
        inputs=("u1",),
    )


def asked(plant: Any, shares: tuple[float, float], d: Any = (1, 1), u: float = 1) -> Any:
    """Return what is minimised, and limits that a gain of zero keeps or nearly keeps."""
    nothing, alpha = pf.FixedGain(np.zeros((1, plant.shape[0]))), seeded(plant, 50)
    own = [pf.Rms(name, density=2.0) for name in ("x1", "x2")]
    x1, x2 = (sampled(plant, nothing, each, alpha).worst for each in own)
    force = pf.Rms("u1", shares[0] * x1 * d[0] / u, density=2.0)
    return own[0], [force, replace(own[1], at_most=shares[1] * x2)]


class Tally:
    def __init__(self) -> None:
        self.apart = defaultdict[str, list[float]](list)
        self.seconds = list[float]()
        self.failed = list[str]()

    def level(self, plant: Any, least: Any, limits: Any, **how: Any) -> float:
        start = time.process_time()
        try:
            return float(pf.optimise(plant, least, limits, **how).bounds[0].level)
        except pf.NotProvedError:
            return np.inf
        finally:
            self.seconds.append(time.process_time() - start)

    def add(self, kind: str, seed: int, less: float, more: float) -> None:
        if not np.isfinite(less):
            return
        if not np.isfinite(more):
            self.failed.append(f"{kind}: plant {seed} has no answer any more")
            return
        self.apart[kind].append(more / less - 1)
        print(f"{seed} {kind}: {less:.6g} -> {more:.6g}", file=sys.stderr, flush=True)

    def plant(self, seed: int) -> None:
        matrices, shares = drawn(seed)
        plant = plant_of(matrices)
        least, limits = asked(plant, shares)
        first = replace(ONE, measured=("x1",))

        def of(structure: pf.Structure, limits: Any = limits) -> float:
            return self.level(plant, least, limits, structure=structure)

        one, static = of(ONE), of(first)
        self.add("a sensor more", seed, static, one)
        self.add("a limit less", seed, one, of(ONE, limits[:1]))
        wide = [*limits, pf.GainNorm(1e9)]
        self.add("a limit that does not bind, tuned", seed, one, of(ONE, wide))
        orders = [static, *(of(replace(first, order=k)) for k in (1, 2))]
        for k in (1, 2):
            self.add(f"order {k} beside {k - 1}", seed, orders[k - 1], orders[k])
        if len(plant.vertices) > 1:
            p, both = of(pf.Structure(schedule=("p",))), of(pf.Structure())
            self.add("scheduled on one parameter", seed, one, p)
            self.add("scheduled on a second", seed, p, both)
        for method in ("quadratic", "scheduled")[: len(plant.vertices)]:
            own = self.level(plant, least, limits, method=method)
            free = self.level(plant, least, wide, method=method)
            self.add(f"a limit that does not bind, {method}", seed, own, free)
            self.units(method, seed, matrices, shares, own, {"method": method})
        self.units("tuned", seed, matrices, shares, one, {"structure": ONE})

    def units(self, name: str, seed: int, matrices: Any, shares: Any, own: float, how: Any) -> None:
        for a, b, u, t in UNITS:
            d = np.ones(len(matrices[1]))
            d[:2] = a, b
            plant = plant_of(matrices, d, u, t)
            least, limits = asked(plant, shares, d, u)
            self.add(f"other units, {name}", seed, own, self.level(plant, least, limits, **how) * a)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    options = parser.parse_args()
    tally = Tally()
    for seed in range(options.first, options.first + options.plants):
        tally.plant(seed)
    print("| second question | pairs | median | worst | worse by over 0.1 % |")
    print("|---|--:|--:|--:|--:|")
    for kind, apart in tally.apart.items():
        shown = [f"{100 * x:.3g} %" for x in (statistics.median(apart), max(apart))]
        count = sum(x > WORSE for x in apart)
        print(f"| {kind} | {len(apart)} | {' | '.join(shown)} | {count} |")
    print(f"\nNo answer any more: {len(tally.failed)}.", *tally.failed, sep="\n")
    print(f"\nCPU seconds: median {statistics.median(tally.seconds):.1f}, ", end="")
    print(f"most {max(tally.seconds):.1f}, of {len(tally.seconds)} answers.")


if __name__ == "__main__":
    main()
