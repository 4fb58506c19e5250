"""Laws of order 1 and 2 for oscillating plants of six states, beside a direct search.

python benchmarks/direct.py --plants 12
python benchmarks/direct.py --plants 60 --states 2 10 --order 1 --starts 20

Plants of even seed are masses between springs, one of which is uncertain by 20 %, their damping
ratios about 0.5 to 3 %; of odd seed A is skew, with entries of the normal distribution, a twentieth
of another such matrix beside it and a tenth of a third one as uncertainty, all poles left of -0.02.
One input, one disturbance, one parameter, one or two states measured. What is minimised is the
rms (seeds 0, 1, 4, 5 and so on) or the gain of [z, rho u], z a state, rho between 0.1 and 1.

The direct search has all numbers of the law as unknowns and the worst of five points of the
parameter as its objective, with exact slopes: BFGS with a weak Wolfe line search, as HANSO has it
(Lewis & Overton, 2013), from the laws of the order below and from random ones, then again from its
best ones at eleven points. It proves nothing: its level is the
worst of 101 points. Printed are the level that `optimise` proves and the worst sample of its law,
each over that level, and the processor's time. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"

import argparse
import sys
import time
from collections.abc import Callable
from itertools import count, islice
from typing import Any

import numpy as np

import polefence as pf
from polefence.certify.bounds import sampled
from polefence.plant.outputs import Output
from polefence.requirements.gain import Gain

Values = np.ndarray[Any, Any]
POINTS, FINE, SAMPLES = 5, 11, 101
RANDOM, BEST = {"rms": 150, "gain": 30}, 4  # starts, and those that are followed
STEPS, LONG = 400, 3000  # of BFGS
WAVES = np.geomspace(1e-3, 1e3, 400)
WORSE = 0.005


def drawn(seed: int, n: int = 6) -> tuple[pf.UncertainPlant, tuple[str, ...], float]:
    """Return a plant with outputs z and w = rho u, what is measured, and rho."""
    random = np.random.default_rng([47, seed])
    if seed % 2 == 0:
        count = n // 2
        n = 2 * count
        masses, springs = random.uniform(0.5, 2, count), random.uniform(0.5, 3, count + 1)
        own, each = random.integers(count + 1), []
        damping = 2 * random.uniform(0.005, 0.03) / np.sqrt(springs.mean() / masses.mean())
        for times in (0.8, 1.2):
            k = springs * np.where(np.arange(count + 1) == own, times, 1.0)
            K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
            K = K / masses[:, None]
            each.append(np.block([[np.zeros(K.shape), np.eye(count)], [-K, -damping * K]]))
        B, E = (np.eye(n)[count + random.integers(count)][:, None] for _ in range(2))
        z = f"x{1 + random.integers(count)}"
    else:
        A, more, turn = random.standard_normal((3, n, n))
        A = A - A.T + 0.05 * more
        each = [A - 0.1 * turn, A + 0.1 * turn]
        slowest = max(np.linalg.eigvals(own).real.max() for own in each)
        each = [own - (slowest + 0.02) * np.eye(n) for own in each]
        B, E = random.standard_normal((2, n, 1))
        z = f"x{1 + random.integers(n)}"
    seen = random.choice(n, 1 + int(random.integers(min(2, n))), replace=False)
    rho = float(np.exp(random.uniform(np.log(0.1), 0.0)))
    names = tuple(f"x{k + 1}" for k in range(n))
    row = [[float(name == z) for name in names]]
    outputs = (Output("z", "", C=row), Output("w", "", D=[[rho]]))
    plant = pf.UncertainPlant.from_vertices(
        each, [B] * 2, [E] * 2, states=names, inputs=("u",), outputs=outputs
    )
    return plant, tuple(names[k] for k in sorted(seen)), rho


class Direct:
    """The question as one would hand it to a general optimiser: all numbers of a law at once."""

    def __init__(self, plant: pf.UncertainPlant, seen: tuple[str, ...], order: int, kind: str):
        n, k = plant.shape[0], order
        C = np.eye(n)[[int(name[1:]) - 1 for name in seen]]
        z, w = plant.outputs
        self.A = np.pad(plant.A, ((0, 0), (0, k), (0, k)))
        self.B = np.zeros((n + k, 1 + k))
        self.B[:n, :1], self.B[n:, 1:] = plant.vertices[0].B, np.eye(k)
        self.C = np.zeros((len(C) + k, n + k))
        self.C[: len(C), :n], self.C[len(C) :, n:] = C, np.eye(k)
        self.E = np.pad(plant.vertices[0].E, ((0, k), (0, 0)))
        self.Z = np.zeros((2, n + k))
        self.Z[0, :n] = [float(x) for x in z.C[0]]
        self.D = np.zeros((2, 1 + k))
        self.D[1, 0] = float(w.D[0][0])
        self.shape, self.order, self.kind = (1 + k, len(C) + k), k, kind

    def worst(self, theta: Values, count: int) -> tuple[float, Values]:
        """Return the worst of some points, and its slopes; infinite where a loop is unstable."""
        share = np.linspace(0, 1, count)[:, None, None]
        K = theta.reshape(self.shape)
        A = (1 - share) * self.A[0] + share * self.A[1] + self.B @ K @ self.C
        if not np.all(np.isfinite(A)) or np.abs(A).max() > 1e6:
            return np.inf, theta
        poles, V = np.linalg.eig(A)
        if poles.real.max() > -1e-9:
            return np.inf, theta
        Z = self.Z + self.D @ K @ self.C
        try:
            U = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            return np.inf, theta
        if self.kind == "rms":
            sums = poles[:, :, None] + poles[:, None, :].conj()
            X = U @ self.E
            X = V @ (-(X @ X.conj().swapaxes(1, 2)) / sums) @ V.conj().swapaxes(1, 2)
            levels = np.sqrt(np.einsum("ij,ajk,ik->a", Z, X.real, Z))
            k = int(np.nanargmax(levels))
            Y = Z @ V[k]
            Q = U[k].conj().T @ (-(Y.conj().T @ Y) / sums[k].conj()) @ U[k]
            P, Q = X[k].real, Q.real
            slope = (self.B.T @ Q + self.D.T @ Z) @ P @ self.C.T / levels[k]
            return float(levels[k]), slope.ravel()
        return self._peak(poles, (Z @ V, U @ self.E), (A, Z))

    def _peak(self, poles: Values, modes: Any, loop: Any) -> tuple[float, Values]:
        (c, b), (A, Z) = modes, loop
        own = np.abs(poles.imag)
        best = 0.0, 0, 0.0
        for a in range(len(poles)):
            w = np.sort(np.concatenate([[0.0], WAVES, *(own[a] * f for f in (0.97, 1.0, 1.03))]))
            share = self._response(c[a], b[a], poles[a], w)
            for k in np.argsort(-share)[:3]:
                low, high = w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)]
                for _ in range(4):  # finer and finer
                    near = np.linspace(low, high, 21)
                    share_near = self._response(c[a], b[a], poles[a], near)
                    j = int(share_near.argmax())
                    low, high = near[max(j - 1, 0)], near[min(j + 1, 20)]
                if share_near[j] > best[0]:
                    best = float(share_near[j]), a, float(near[j])
        level, a, w = best
        R = np.linalg.inv(1j * w * np.eye(len(A[a])) - A[a])
        G = Z @ R @ self.E
        left = (G.conj().T / level) @ (Z @ R @ self.B + self.D)
        slope = np.real(left.T @ (self.C @ R @ self.E).T)
        return level, slope.ravel()

    @staticmethod
    def _response(c: Values, b: Values, poles: Values, w: Values) -> Values:
        G = (c[None] / (1j * w[:, None, None] - poles)) @ b
        return np.asarray(np.linalg.norm(G[:, :, 0], axis=1))

    def starts(self, random: Any, below: list[Values], most: int) -> list[Values]:
        """Return laws: those of the order below with a state more, and random ones."""
        m, r = self.shape
        k = self.order
        found = [np.zeros(m * r)] if not k else []
        for own in below:
            for pole in (0.3, 3.0):
                K = np.zeros((m, r))
                rows, columns = [*range(m - 1)], [*range(r - 1)]
                K[np.ix_(rows, columns)] = own.reshape(m - 1, r - 1)
                K[-1, 0], K[-1, -1] = pole, -pole
                found.append(K.ravel())
        while len(found) < most:
            K = random.standard_normal((m, r)) * np.exp(random.uniform(-3, 1))
            K[1:, r - k :] -= np.exp(random.uniform(-1, 1)) * np.eye(k)
            for _ in range(20):  # the plant is stable: some share of the law is
                if np.isfinite(self.worst(K.ravel(), POINTS)[0]):
                    break
                K[:1] /= 2
                K[1:, r - k :] -= 0.2 * np.eye(k)
            found.append(K.ravel())
        return [own for own in found if np.isfinite(self.worst(own, POINTS)[0])]

    def search(self, seed: int, below: list[Values], most: int | None = None) -> list[Values]:
        """Return the best laws of so many starts, the best first."""
        random = np.random.default_rng([48, seed, self.order])
        points = POINTS

        def f(theta: Values) -> tuple[float, Values]:
            return self.worst(theta, points)

        starts = self.starts(random, below, most or RANDOM[self.kind])
        found = [bfgs(f, theta, STEPS) for theta in starts]
        found.sort(key=lambda own: own[0])
        points, best = FINE, []
        for level, theta in found[:BEST]:
            for _ in range(3):  # curvature anew
                level, theta = bfgs(f, theta, LONG)
            best.append((level, theta))
        best.sort(key=lambda own: own[0])
        return [theta for _, theta in best]


def bfgs(f: Callable[[Values], Any], x: Values, steps: int) -> tuple[float, Values]:
    """Return the level and the point where BFGS with a weak Wolfe line search ends."""
    level, g = f(x)
    H = np.eye(len(x)) / max(1.0, float(np.linalg.norm(g)))
    for _ in range(steps):
        d = -H @ g
        slope = float(g @ d)
        if not slope < 0:
            H = np.eye(len(x)) / max(1.0, float(np.linalg.norm(g)))
            d = -H @ g
            slope = float(g @ d)
        low, high, t = 0.0, np.inf, 1.0
        there = None
        for _ in range(40):
            new, turned = f(x + t * d)
            if not new <= level + 1e-4 * t * slope:
                high = t
            else:
                there = new, turned, t
                if turned @ d >= 0.9 * slope:
                    break
                low = t
            t = (low + high) / 2 if np.isfinite(high) else 2 * t
        if there is None or level - there[0] < 1e-10 * abs(level):
            return (level, x) if there is None else (there[0], x + there[2] * d)
        s, y = there[2] * d, there[1] - g
        x, level, g = x + s, there[0], there[1]
        if (own := float(s @ y)) > 1e-14:
            V = np.eye(len(x)) - np.outer(s, y) / own
            H = V @ H @ V.T + np.outer(s, s) / own
    return level, x


def rows(seed: int, sizes: tuple[int, int], last: int, most: int | None) -> list[list[str]]:
    """Return a row for each order."""
    n = int(np.random.default_rng([49, seed]).integers(sizes[0], sizes[1] + 1))
    plant, seen, _ = drawn(seed, n)
    kind = "rms" if seed % 4 < 2 else "gain"
    least = pf.Rms(("z", "w"), density=2.0) if kind == "rms" else Gain(("z", "w"))
    below: list[Values] = Direct(plant, seen, 0, kind).search(seed, [], most)
    found = []
    for order in range(1, last + 1):
        start = time.process_time()
        direct = Direct(plant, seen, order, kind)
        below = direct.search(seed, below, most)
        middle = time.process_time()
        level = min(direct.worst(theta, SAMPLES)[0] for theta in below)
        structure = pf.Structure(measured=seen, schedule=(), order=order)
        row = [
            str(seed),
            kind,
            str(plant.shape[0]),
            str(len(seen)),
            str(order),
            f"{level:.5g}",
            f"{middle - start:.1f}",
        ]
        start = time.process_time()
        try:
            done = pf.optimise(plant, least, structure=structure)
        except pf.NotProvedError as error:
            found.append([*row, "", "", f"{time.process_time() - start:.1f}", str(error)[:60]])
            continue
        seconds = time.process_time() - start
        alpha = np.stack([np.linspace(0, 1, SAMPLES), 1 - np.linspace(0, 1, SAMPLES)], axis=1)
        bound = done.bounds[0]
        worst = sampled(done.plant, done.law, bound.specification, alpha).worst
        shares = [f"{x / level:.4f}" for x in (worst, bound.level)]
        found.append([*row, *shares, f"{seconds:.1f}", str(done.plant.shape[0] - plant.shape[0])])
        print(" | ".join(found[-1]), file=sys.stderr, flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--rms", action="store_true", help="of plants whose rms is minimised alone")
    parser.add_argument("--states", type=int, nargs=2, default=(6, 6), help="fewest and most")
    parser.add_argument("--order", type=int, default=2, help="highest order")
    parser.add_argument("--starts", type=int, help="of the direct search, each order")
    options = parser.parse_args()
    columns = (
        "seed, of, states, sensors, order, direct, CPU s, sampled / direct, proved / direct, CPU s"
    )
    print("|", " | ".join((*columns.split(", "), "order found")), "|")
    print("|--:|:--|" + "--:|" * 9)
    shares, times = list[float](), list[tuple[float, float]]()
    seeds = (k for k in count(options.first) if not options.rms or k % 4 < 2)
    for seed in islice(seeds, options.plants):
        for row in rows(seed, tuple(options.states), options.order, options.starts):
            print("|", " | ".join(row), "|", flush=True)
            shares.append(float(row[7] or np.inf))
            times.append((float(row[6]), float(row[9])))
    above = sum(x > 1 + WORSE for x in shares)
    theirs, ours = np.median(times, axis=0)
    print(f"\n{above} of {len(shares)} sampled more than {100 * WORSE:g} % above.")
    print(f"Median: {theirs:.1f} s the direct search, {ours:.1f} s search and proof.")


if __name__ == "__main__":
    main()
