"""Random plants drawn wide, the same in every run: what the benchmarks and the tests share."""

from __future__ import annotations

import numpy as np

from polefence import UncertainPlant


def polytope(seed: int) -> tuple[UncertainPlant, float]:
    """Return vertices around a random pair (N 2-8, n 2-8, m 1-3) and a centre.

    A third each are unstructured, lightly damped (ratios 0.001 to 0.05), and unstable.
    """
    random = np.random.default_rng([1, seed])
    N, n, m = (int(random.integers(*bounds)) for bounds in ((2, 9), (2, 9), (1, 4)))
    A = random.standard_normal((n, n))
    kind = seed % 3
    if kind == 1:
        A = np.zeros((n, n))
        for k in range(n // 2):
            rate, ratio = random.uniform(1, 5), random.uniform(0.001, 0.05)
            A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = rate * np.array([[-ratio, 1], [-1, -ratio]])
        T = random.standard_normal((n, n)) + 2 * np.eye(n)
        A = T @ A @ np.linalg.inv(T)
    elif kind == 2:
        A = A + np.eye(n)
    B = random.standard_normal((n, m))
    spread = float(random.choice([0.02, 0.07, 0.15]))
    As = [A + spread * random.standard_normal((n, n)) for _ in range(N)]
    Bs = [B + spread * random.standard_normal((n, m)) for _ in range(N)]
    return UncertainPlant.from_vertices(As, Bs, name=f"polytope {seed}"), -random.uniform(2, 10)


def quarter_car(seed: int) -> tuple[UncertainPlant, float]:
    """Return a quarter car (sprung mass and ageing uncertain) and a centre from -3 to -150."""
    random = np.random.default_rng([2, seed])
    m1, m2 = random.uniform(150, 600), random.uniform(15, 80)
    k, c, kt = (10 ** random.uniform(*bounds) for bounds in ((3.5, 5), (2.3, 3.6), (4.7, 5.6)))
    load, age = random.uniform(0.02, 0.4, 2)
    As, Bs = [], []
    for mass in (m1 * (1 - load), m1 * (1 + load)):
        for factor in (1 - age, 1 + age):
            K, C = k * factor, c * factor
            As.append(
                [
                    [0, 0, -1, 1, 0],
                    [0, 0, 0, -1, 0],
                    [K / mass, 0, -C / mass, C / mass, 0],
                    [-K / m2, kt / m2, C / m2, -C / m2, 0],
                    [1, 0, 0, 0, 0],
                ]
            )
            Bs.append([[0], [0], [1 / mass], [-1 / m2], [0]])
    centre = -(10 ** random.uniform(np.log10(3), np.log10(150)))
    return UncertainPlant.from_vertices(As, Bs, name=f"quarter car {seed}"), float(centre)


def masses(count: int, spread: float = 0.2) -> UncertainPlant:
    """Return a chain of masses between springs, pushed weakly at both ends, in four vertices.

    One end is tied to a wall by an uncertain spring; the mass at the other end is uncertain.
    """
    As, Bs = [], []
    for spring in (1 - spread, 1 + spread):
        for load in (1 - spread, 1 + spread):
            ties = np.diag([spring] + [1.0] * (count - 1))
            stretch = np.eye(count) - np.eye(count, k=-1)
            weight = np.ones(count)
            weight[-1] = load
            K = stretch.T @ ties @ stretch / weight[:, None]
            ends = np.eye(count)[:, [0, -1]] / weight[:, None]
            As.append(np.block([[np.zeros_like(K), np.eye(count)], [-K, -0.02 * K]]))
            Bs.append(np.vstack([np.zeros((count, 2)), 0.1 * ends]))
    return UncertainPlant.from_vertices(As, Bs, name=f"{count} masses")
