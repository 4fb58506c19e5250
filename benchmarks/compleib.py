"""Static output feedback on the plants of COMPleib: H2 and H-infinity norms, tuned and proved.

python benchmarks/compleib.py --plants DIR --results rows.json

DIR holds a file a plant, NAME.mat or NAME.npz, with the matrices that the library's own function
`[A,B1,B,C1,C,D11,D12,D21] = COMPleib(NAME)` returns: x' = A x + B1 w + B u,
z = C1 x + D11 w + D12 u, y = C x + D21 w. The library is at www.compleib.de; its data are not part
of this package. Plants are left out, by name, where D21 is not zero (a disturbance that passes
straight into what is measured would pass on into u), where nothing disturbs (B1 is zero), and where
there are more states than ``--states``.

With ``--orders`` laws of those orders are searched too, of plants as they are, and each norm stands
beside that of a direct search, as HIFOO has it (Burke, Henrion, Lewis & Overton, 2006): BFGS with a
weak Wolfe line search and exact slopes, first of the rightmost pole, then of the norm, from ten
starts, zero and random ones, on a fine grid of frequencies. It proves nothing.
Poles of `optimise` may be 10,000 times as fast as the plant's here.

    python benchmarks/compleib.py --plants DIR --orders 0 1 2 --only AC17

Each plant is taken as it is, and with two uncertain parameters: the two entries of A of largest
magnitude (the first of equals, row by row) are each multiplied by a factor in [0.9, 1.1]. One gain
u = K y is tuned for the least worst norm from w to z, and the norm is proved; "above" is the bound
over the worst sample, less one: samples prove nothing, so the truth lies between. Each plant runs
in a process of its own, on one thread; with ``--results`` a run that was ended goes on where it
was. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from direct import bfgs
from scipy.linalg import solve_continuous_lyapunov

from polefence import (
    Disk,
    Gain,
    HalfPlane,
    Parameter,
    PolefenceError,
    Rms,
    Specification,
    Structure,
    UncertainPlant,
    optimise,
)
from polefence.certify.bounds import sampled
from polefence.plant.outputs import Output
from polefence.plant.system import System
from polefence.response.modes import Modes
from polefence.response.peaks import peaks

KEYS = ("A", "B1", "B", "C1", "C", "D11", "D12", "D21")
SPREAD = Fraction(1, 10)
H2_DENSITY = 2.0  # one-sided, of white noise of intensity one
NORMS = ("H2", "Hinf")
FAMILIES = {"single": "One vertex", "uncertain": "Two entries of A uncertain by 10 %"}

STARTS, SEED, STEPS = 10, 47, (200, 1500)  # of the direct search; steps to a stable loop, and on
FAST = 1e4  # times the plant's fastest pole, what both allow the loop's
AGREES = 1e-4  # of the squares of an H2 norm by both Gramians
WAVES = np.geomspace(1e-3, 1e3, 300)  # of its frequencies, in shares of the rates of poles

Matrices = dict[str, Any]
Values = np.ndarray[Any, Any]


def read(path: Path) -> Matrices:
    """Return the matrices of a file."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as data:
            return {key: np.atleast_2d(data[key]).astype(float) for key in KEYS}
    from scipy.io import loadmat

    data = loadmat(path)
    return {key: np.atleast_2d(data[key]).astype(float) for key in KEYS}


def family(name: str, own: Matrices, uncertain: bool) -> UncertainPlant:
    """Return the plant, its entries of largest magnitude multiplied by factors where uncertain."""
    A = [[Fraction(a) for a in row] for row in own["A"].tolist()]
    places, parameters = [], list[Parameter]()
    if uncertain:
        order = np.argsort(-np.abs(own["A"]), axis=None, kind="stable")[:2]
        places = [divmod(int(k), len(A)) for k in order]
        parameters = [Parameter(f"f{k + 1}", 1 - SPREAD, 1 + SPREAD) for k in range(2)]
    vertices = []
    for corner in np.ndindex((2,) * len(places)):
        M = [list(row) for row in A]
        for (i, j), high in zip(places, corner, strict=True):
            M[i][j] *= 1 + SPREAD if high else 1 - SPREAD
        vertices.append(System(tuple(map(tuple, M)), own["B"].tolist(), own["B1"].tolist()))
    rows = zip(own["C1"].tolist(), own["D12"].tolist(), own["D11"].tolist(), strict=True)
    z = [Output(f"z{k + 1}", C=C, D=D, F=F) for k, (C, D, F) in enumerate(rows) if any(C + D + F)]
    y = [Output(f"y{k + 1}", C=C) for k, C in enumerate(own["C"].tolist()) if any(C)]
    return UncertainPlant(tuple(vertices), tuple(parameters), name, outputs=(*z, *y))


def fastest(own: Matrices) -> float:
    """Return the magnitude of the plant's fastest pole, one at least."""
    return max(1.0, float(np.abs(np.linalg.eigvals(own["A"])).max()))


def norm(plant: UncertainPlant, which: str) -> Specification:
    """Return the norm from w to z."""
    z = tuple(own.name for own in plant.outputs if own.name.startswith("z"))
    return Rms(z, density=H2_DENSITY) if which == "H2" else Gain(z)


class Direct:
    """The question as one would hand it to a general optimiser: all numbers of a law at once."""

    def __init__(self, own: Matrices, which: str, order: int) -> None:
        n, k = len(own["A"]), order
        wide = {key: own[key] for key in KEYS}
        self.A, self.E = np.pad(wide["A"], (0, k)), np.pad(wide["B1"], ((0, k), (0, 0)))
        self.B, self.C = np.pad(wide["B"], (0, k)), np.pad(wide["C"], (0, k))
        self.B[n:, self.B.shape[1] - k :] = self.C[len(self.C) - k :, n:] = np.eye(k)
        self.Z, self.F = np.pad(wide["C1"], ((0, 0), (0, k))), wide["D11"]
        self.D = np.pad(wide["D12"], ((0, 0), (0, k)))
        self.shape, self.which = (self.B.shape[1], len(self.C)), which
        self.fastest = FAST * fastest(own)

    def abscissa(self, theta: Values) -> tuple[float, Values]:
        """Return the real part of the rightmost pole, and its slopes."""
        A = self.A + self.B @ theta.reshape(self.shape) @ self.C
        if not np.all(np.isfinite(A)) or np.abs(A).max() > 1e12:
            return np.inf, theta
        poles, V = np.linalg.eig(A)
        k = int(poles.real.argmax())
        try:
            left = np.linalg.inv(V)[k]
        except np.linalg.LinAlgError:
            return np.inf, theta
        slope = np.outer(left @ self.B, self.C @ V[:, k]).real
        return float(poles[k].real), slope.ravel()

    def norm(self, theta: Values) -> tuple[float, Values]:
        """Return the norm from w to z, and its slopes; infinite where the loop is not stable."""
        K = theta.reshape(self.shape)
        A = self.A + self.B @ K @ self.C
        if not np.all(np.isfinite(A)) or np.abs(A).max() > 1e12:
            return np.inf, theta
        poles, V = np.linalg.eig(A)
        if not poles.real.max() < -1e-9 or np.abs(poles).max() > self.fastest:
            return np.inf, theta
        Z = self.Z + self.D @ K @ self.C
        try:
            U = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            return np.inf, theta
        if self.which == "H2":
            P = solve_continuous_lyapunov(A, -self.E @ self.E.T)
            Q = solve_continuous_lyapunov(A.T, -Z.T @ Z)
            square, dual = np.trace(Z @ P @ Z.T), np.trace(self.E.T @ Q @ self.E)
            if not (square > 0 and abs(dual - square) < AGREES * square):  # rounding is all it is
                return np.inf, theta
            level = np.sqrt(float(square))
            return level, ((self.B.T @ Q + self.D.T @ Z) @ P @ self.C.T / level).ravel()
        w = self._highest(poles, Z @ V, U @ self.E)
        R = np.linalg.inv(1j * w * np.eye(len(A)) - A)
        u, s, v = np.linalg.svd(Z @ R @ self.E + self.F)
        left = u[:, 0].conj() @ (Z @ R @ self.B + self.D)
        slope = np.outer(left, self.C @ R @ self.E @ v[0].conj()).real
        return float(s[0]), slope.ravel()

    def _highest(self, poles: Values, c: Values, b: Values) -> float:
        """Return the frequency of the largest singular value: from a grid, finer and finer."""
        rates = np.concatenate([np.abs(poles), np.abs(poles.imag)])
        middle = np.exp(np.log(np.maximum(np.abs(poles), 1e-12)).mean())
        w = np.sort(np.concatenate([[0.0], middle * WAVES, rates]))
        low, high = 0.0, w[-1]
        for _ in range(6):
            G = (c[None] / (1j * w[:, None, None] - poles)) @ b + self.F
            k = int(np.linalg.norm(G, 2, axis=(1, 2)).argmax())
            best, low, high = w[k], w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)]
            w = np.sort(np.append(np.linspace(low, high, 21), best))
        return float(best)

    def search(self) -> float:
        """Return the least norm of all starts."""
        random, size = np.random.default_rng(SEED), int(np.prod(self.shape))
        starts = [np.zeros(size), *random.standard_normal((STARTS - 1, size))]
        found = []
        for theta in starts:
            if not self.abscissa(theta)[0] < 0:
                theta = bfgs(self.abscissa, theta, STEPS[0])[1]
            if self.norm(theta)[0] < np.inf:
                found.append(bfgs(self.norm, theta, STEPS[1]))
        found.sort(key=lambda own: own[0])
        best = [bfgs(self.norm, own[1], STEPS[1])[1] for own in found[:3]]  # curvature anew
        return min(map(self.true, best), default=np.inf)

    def true(self, theta: Values) -> float:
        """Return the norm, that of H-infinity where a Hamiltonian says that it is."""
        if self.which == "H2":
            return self.norm(theta)[0]
        K = theta.reshape(self.shape)
        A, Z = self.A + self.B @ K @ self.C, self.Z + self.D @ K @ self.C
        return float(peaks(Modes(A[None]), self.E[None], Z[None], self.F[None])[2].max())


def beside(path: str, order: int) -> dict[str, Any]:
    """Return for each norm what is proved and what a direct search finds, with times."""
    own = read(Path(path))
    plant = family(Path(path).stem, own, False)
    measured = tuple(each.name for each in plant.outputs if each.name.startswith("y"))
    found: dict[str, Any] = {}
    for which in NORMS:
        if which == "H2" and np.any(own["D11"]):
            continue
        start = time.process_time()
        theirs = Direct(own, which, order).search()
        middle = time.process_time()
        structure = Structure(measured=measured, schedule=(), order=order)
        region = HalfPlane(0) & Disk(0, FAST * fastest(own))
        try:
            level = optimise(plant, norm(plant, which), (), region, structure=structure)
            level = level.bounds[0].level
        except PolefenceError:
            level = np.inf
        took = time.process_time() - middle
        found[which] = [level, theirs, took, middle - start]
    return found


def orders(paths: dict[str, Path], options: argparse.Namespace, done: dict[str, Any]) -> None:
    """Print a table of laws of some orders beside those of a direct search."""
    print("| plant | order | norm | proved | direct | over direct | s | direct, s |")
    print("|---|--:|---|--:|--:|--:|--:|--:|")
    for order in options.orders:
        for name, path in paths.items():
            key = f"{name} order {order}"
            if key not in done:
                with ProcessPoolExecutor(1) as pool:
                    done[key] = pool.submit(beside, str(path), order).result()
                if options.results:
                    options.results.write_text(json.dumps(done, indent=1))
            for which, (level, theirs, took, long) in done[key].items():
                cells = [f"{level:.5g}", f"{theirs:.5g}", f"{level / theirs:.4f}"]
                print(
                    f"| {' | '.join([name, str(order), which, *cells])} | {took:.1f} | {long:.1f} |"
                )
    every = [own for key, rows in done.items() if " order " in key for own in rows.values()]
    ratios = [long / took for _, _, took, long in every]
    print(f"\nMedian of their time over ours: {np.median(ratios):.1f}, of {len(ratios)}.")


def row(path: str, uncertain: bool) -> dict[str, Any]:
    """Return what is found of a plant: bound, what it is above the worst sample, seconds."""
    own = read(Path(path))
    plant = family(Path(path).stem, own, uncertain)
    measured = tuple(each.name for each in plant.outputs if each.name.startswith("y"))
    found: dict[str, Any] = {}
    for which in NORMS:
        start = time.perf_counter()
        try:
            asked = norm(plant, which)
            best = optimise(plant, asked, structure=Structure(measured=measured, schedule=()))
            took, level = time.perf_counter() - start, best.bounds[0].level
            above = level / sampled(best.plant, best.law, asked).worst - 1
            found[which] = [level, above, took, bool(best.bounded_by)]
        except PolefenceError as error:
            found[which] = str(error)
    return found


def apart(path: Path, uncertain: bool) -> dict[str, Any]:
    """Return a row that is made in a process of its own."""
    with ProcessPoolExecutor(1) as pool:
        try:
            return pool.submit(row, str(path), uncertain).result()
        except Exception as error:  # also of a process that died: the table goes on
            return dict.fromkeys(NORMS, f"{type(error).__name__}: {error}")


def left_out(own: Matrices, states: int) -> str:
    """Return why a plant is left out; empty where it is not."""
    if np.any(own["D21"]):
        return "D21 not zero"
    if not np.any(own["B1"]):
        return "B1 zero"
    return f"More than {states} states" if len(own["A"]) > states else ""


def cells(found: Any) -> list[str]:
    """Return bound, what it is above samples [%], and seconds."""
    if isinstance(found, str):
        return ["-", "-", "-"]
    level, above, took, bounded = found
    return [f"{level:.5g}{'*' if bounded else ''}", f"{100 * above:.2g}", f"{took:.1f}"]


def main() -> None:
    """Print two tables, and what was left out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=Path, required=True, help="folder of NAME.mat, NAME.npz")
    parser.add_argument("--results", type=Path, help="file of rows that are done, and to add to")
    parser.add_argument("--states", type=int, default=12, help="most states of a plant")
    parser.add_argument("--only", action="append", help="name of a plant")
    parser.add_argument("--orders", type=int, nargs="+", help="of laws, beside a direct search")
    parser.add_argument("--family", action="append", choices=FAMILIES)
    options = parser.parse_args()
    paths = {p.stem: p for p in sorted(options.plants.iterdir()) if p.suffix in (".mat", ".npz")}
    data = {k: read(p) for k, p in paths.items() if not options.only or k in options.only}
    if not data:
        parser.error(f"no plants in {options.plants}")
    out = {name: why for name, own in data.items() if (why := left_out(own, options.states))}
    done = {}
    if options.results and options.results.exists():
        done = json.loads(options.results.read_text())
    if options.orders:
        orders({name: paths[name] for name in data if name not in out}, options, done)
        return
    for kind in options.family or FAMILIES:
        print(f"\n{FAMILIES[kind]}\n")
        print("| plant | n, m, r | H2 | above [%] | s | Hinf | above [%] | s |")
        print("|---|---|--:|--:|--:|--:|--:|--:|")
        for name in [k for k in data if k not in out]:
            key = f"{name} {kind}"
            if key not in done:
                done[key] = apart(paths[name], kind == "uncertain")
                if options.results:
                    options.results.write_text(json.dumps(done, indent=1))
            own = data[name]
            sizes = f"{len(own['A'])}, {own['B'].shape[1]}, {len(own['C'])}"
            found = [cell for which in NORMS for cell in cells(done[key][which])]
            print(f"| {' | '.join([name, sizes, *found])} |", flush=True)
            for which in NORMS:
                if isinstance(done[key][which], str):
                    print(f"{key} {which}: {done[key][which]}", file=sys.stderr)
    print("\n\\* what bounded the gain is the search's own bound on the speed of poles.\n")
    for why in dict.fromkeys(out.values()):
        print(f"{why}: {', '.join(name for name, own in out.items() if own == why)}.")


if __name__ == "__main__":
    main()
