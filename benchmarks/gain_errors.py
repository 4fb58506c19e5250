"""How far each gain of random laws may be off: proved, and where it breaks.

Run: python benchmarks/gain_errors.py [count] [seed]

Plants have two to five states, one or two parameters of +-20 % in rows of A, one or two inputs;
some are lightly damped. Laws are regulators of all states with some gains left out, and regulators
with observers: laws with states of their own. Where it breaks is looked for by another way than the
project's own: signs of errors at random, then one flipped after another, at the vertices.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from scipy.linalg import solve_continuous_are

from polefence import FixedGain, HalfPlane, UncertainPlant, analyse
from polefence.certify.margins import gain_error
from polefence.plant.larger import with_states
from polefence.plant.parameters import Parameter

STARTS, BISECTIONS, MOST = 40, 22, 10.0


def random_plant(rng):
    n, m, q = rng.integers(2, 6), rng.integers(1, 3), rng.integers(1, 3)
    A = rng.normal(size=(n, n))
    if rng.random() < 0.4:  # lightly damped modes
        A = np.zeros((n, n))
        for k in range(0, n - 1, 2):
            w = rng.uniform(0.5, 8)
            A[k : k + 2, k : k + 2] = [[0, 1], [-(w**2), -2 * rng.uniform(0.01, 0.1) * w]]
        if n % 2:
            A[-1, -1] = -rng.uniform(0.2, 3)
        A += 0.1 * rng.normal(size=(n, n))
    B = rng.normal(size=(n, m))
    rows = rng.choice(n, size=q, replace=False)

    def matrices(**values):
        own = A.tolist()
        for row, value in zip(rows, values.values(), strict=True):
            own[row] = [entry * value for entry in own[row]]
        return own, B.tolist()

    bounds = [Parameter(f"p{k}", 0.8, 1.2) for k in range(q)]
    return UncertainPlant.from_function(matrices, bounds), A, B


def regulator(A, B, weight):
    P = solve_continuous_are(A, B, np.eye(len(A)), weight * np.eye(B.shape[1]))
    return -B.T @ P / weight


def random_law(rng, plant, A, B):
    """Return the plant, with the law's states, and the law."""
    n, m = B.shape
    K = regulator(A, B, 10 ** rng.uniform(-1, 1))
    if rng.random() < 0.5:
        K = K * (rng.random(K.shape) < 0.8)
        return plant, FixedGain(K)
    C = np.eye(n)[rng.choice(n, size=rng.integers(1, n + 1), replace=False)]
    L = -regulator(A.T, C.T, 10 ** rng.uniform(-1, 1)).T
    whole = np.block([[np.zeros((m, n)), K], [L @ C, A + B @ K - L @ C]])
    return with_states(plant, n), FixedGain(whole)


def worst(plant, K, sizes, e, signs):
    gains = K + e * signs * sizes
    each = plant.A[:, None] + plant.B[:, None] @ gains
    return np.linalg.eigvals(each).real.max(axis=(0, 2))


def breaks_at(rng, plant, K, sizes):
    """Return the least error, of these starts, at which a pole at a vertex is not stable."""
    off, least = np.argwhere(sizes > 0), MOST
    for start in range(STARTS):
        signs = (
            rng.choice([-1.0, 1.0], size=K.shape) if start > 1 else np.full(K.shape, 1 - 2 * start)
        )
        here = min(least, MOST)
        for _ in range(3):
            flips = np.repeat(signs[None], len(off) + 1, axis=0).astype(float)
            flips[np.arange(len(off)), off[:, 0], off[:, 1]] *= -1
            found = worst(plant, K, sizes, here, flips)
            best = int(found.argmax())
            if best == len(off) or found[best] <= found[-1]:
                break
            signs = flips[best]
        low, high = 0.0, here
        if worst(plant, K, sizes, high, signs[None])[0] <= 0:
            continue
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            kept = worst(plant, K, sizes, middle, signs[None])[0] <= 0
            low, high = (middle, high) if kept else (low, middle)
        least = min(least, high)
    return least


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    ratios, times = [], []
    while len(ratios) < count:
        plant, A, B = random_plant(rng)
        whole, law = random_law(rng, plant, A, B)
        answer = analyse(whole, law, HalfPlane(0))
        if not answer.proved:
            continue
        start = time.process_time()
        margins = [gain_error(answer.design)]
        if whole.shape[0] > plant.shape[0]:
            margins.append(gain_error(answer.design, own_states=True))
        times.append(time.process_time() - start)
        K, m = law.K, B.shape[1]
        for margin, rows in zip(margins, (slice(0, m), slice(m, None)), strict=False):
            sizes = np.zeros_like(K)
            sizes[rows] = np.abs(K[rows])
            broken = min(breaks_at(rng, whole, K, sizes), margin.upper or MOST)
            ratio = broken / margin.value if margin.value else np.inf
            ratios.append(ratio)
            print(
                f"n {whole.shape[0]:2d} m {m} {'own' if rows.start else 'u  '} proved "
                f"{margin.value:.4f} breaks {broken:.4f} ({margin.upper or np.nan:.4f}) "
                f"ratio {ratio:.2f} {times[-1]:.1f} s",
                flush=True,
            )
    r = np.array(ratios)
    print(
        f"ratio: median {np.median(r):.2f}, 90 % {np.quantile(r, 0.9):.2f}, largest {r.max():.2f}"
    )
    print(f"within 3: {np.mean(r <= 3):.3f} of {len(r)}; slowest {max(times):.1f} s")


if __name__ == "__main__":
    main()
