"""The ride car's laws: tuned and proved, beside SLSQP with finite differences, and beside LMIs.

python benchmarks/tuned.py --repeats 3

`quarter-car-ride` on class C at 20 m/s with its limits, decay rate 1 1/s and damping ratio 0.15:
the worst rms of the sprung mass's acceleration. "Tuned" is `optimise` with a structure, search and
proof together. SLSQP, of SciPy, has the same unknowns: the entries of each term's gain in their
typical sizes, and the level as one more; constraints are the level, the limits and the poles' place
at the vertices, from Lyapunov equations and eigenvalues in NumPy, its derivatives finite
differences. It starts at LQR gains of rising weight, and its best result is taken; it proves
nothing, so that its level is the worst of 10,000 samples, as "sampled" is of the others, and
"keeps" says whether limits and region hold at them to 1e-3. The LMI is `optimise` with a method.
All in one process on one thread, turn by turn; times are medians. Prints Markdown.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = "1"

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are
from scipy.optimize import minimize

import polefence as pf
from polefence import HalfPlane, NotProvedError, Sector, Structure, load, load_specifications
from polefence.certify.bounds import sampled
from polefence.examples import spec_path
from polefence.law.laws import Law, PolynomialGain
from polefence.plant.points import seeded
from polefence.requirements.specification import Specification

CAR = HalfPlane(1) & Sector(0.15)
THREE = ("suspension deflection", "sprung-mass velocity", "unsprung-mass velocity")
# The structure, and the method of an LMI for laws of that kind, where it has them.
ROWS: dict[str, tuple[Structure, str | None]] = {
    "one gain, four states": (Structure(schedule=()), "quadratic"),
    "one gain, no tyre deflection": (Structure(measured=THREE, schedule=()), None),
    "affine, four states": (Structure(), "scheduled"),
    "affine, no tyre deflection": (Structure(measured=THREE), None),
}
WEIGHTS = (1e-8, 1e-7, 1e-6, 1e-5)  # of the force, in the regulators that SLSQP starts from
SAMPLES, SLACK = 10_000, 1e-3

Values = np.ndarray[Any, Any]


class Peer:
    """The question as one would hand it to a general optimiser."""

    def __init__(
        self,
        plant: pf.UncertainPlant,
        structure: Structure,
        least: Specification,
        limits: tuple[Specification, ...],
    ) -> None:
        self.plant, self.structure = plant, structure
        self.asked = (least, *limits)
        self.rows = structure.rows(plant)[0]
        self.terms = len(structure.powers(plant))
        self.A, self.B = plant.at(np.eye(len(plant.vertices)))
        self.E = np.stack([np.array(v.E, dtype=float) for v in plant.vertices])
        signals = [plant.signal(own.name).arrays(plant) for own in self.asked]
        self.C, self.D = (np.stack([s[k] for s in signals], axis=1) for k in (0, 1))
        self.powers = structure.law(plant, np.zeros((self.terms, 1, len(self.rows)))).terms(
            np.eye(len(plant.vertices))
        )

    def law(self, theta: Values) -> PolynomialGain:
        return self.structure.law(self.plant, theta.reshape(self.terms, 1, -1))

    def values(self, theta: Values) -> tuple[Values, Values]:
        """Return the rms values (vertices, signals), and how far poles lie within the region."""
        K = np.tensordot(self.powers, theta.reshape(self.terms, 1, -1), 1) @ self.rows
        closed = self.A + self.B @ K
        poles, right = np.linalg.eig(closed)
        left = np.linalg.inv(right)
        W = left @ self.E
        W = W @ np.swapaxes(W, 1, 2).conj()
        X = (right @ (-W / (poles[:, :, None] + poles[:, None, :].conj()))) @ np.swapaxes(
            right, 1, 2
        ).conj()
        y = self.C + self.D @ K
        squares = np.einsum("vsi,vij,vsj->vs", y, X.real, y)
        density = self.asked[0].density  # type: ignore[attr-defined]
        return np.sqrt(np.maximum(squares, 0) * density / 2), -CAR.distance(poles)

    def best(self) -> Law | None:
        """Return the best law of all starts that keeps everything at the vertices."""
        found = [own for weight in WEIGHTS for own in self._from(weight)]
        return min(found, key=lambda own: own[0])[1] if found else None

    def _from(self, weight: float) -> list[tuple[float, Law]]:
        A, B = self.A.mean(axis=0), self.B.mean(axis=0)
        Q = self.C[:, 0].mean(axis=0)
        Q = np.outer(Q, Q) + 1e-3 * np.eye(len(A))
        K = -np.linalg.solve([[weight]], B.T @ solve_continuous_are(A, B, Q, [[weight]]))
        start = np.zeros((self.terms, len(self.rows)))
        start[0] = np.linalg.lstsq(self.rows.T, K[0], rcond=None)[0]
        sizes = np.tile(np.maximum(np.abs(start[0]), 1.0), self.terms)
        limits = np.array([own.at_most for own in self.asked[1:]])

        def kept(z: Values) -> Values:
            values, inside = self.values(z[:-1] * sizes)
            level = z[-1] - values[:, 0]
            return np.concatenate([level, (1 - values[:, 1:] / limits).ravel(), inside.ravel()])

        first = start.ravel() / sizes
        z0 = np.append(first, self.values(first * sizes)[0][:, 0].max())
        done = minimize(
            lambda z: z[-1],
            z0,
            method="SLSQP",
            constraints={"type": "ineq", "fun": kept},
            options={"maxiter": 500, "ftol": 1e-8},
        )
        if not np.all(np.isfinite(done.x)) or kept(done.x).min() < -SLACK:
            return []
        return [(float(done.x[-1]), self.law(done.x[:-1] * sizes))]


def said(
    plant: pf.UncertainPlant,
    law: Law | None,
    least: Specification,
    limits: tuple[Specification, ...],
) -> list[str]:
    """Return the worst sample, whether samples keep limits and region, and the largest gain."""
    if law is None:
        return ["-", "-", "-"]
    alpha = seeded(plant, SAMPLES)
    A, B = plant.at(alpha)
    inside = CAR.distance(np.linalg.eigvals(A + B @ law.gain(alpha))).max() < SLACK
    kept = inside and all(
        sampled(plant, law, own, alpha).worst <= (own.at_most or 0) * (1 + SLACK) for own in limits
    )
    largest = np.abs(law.gain(alpha)).max()
    worst = sampled(plant, law, least, alpha).worst
    return [f"{worst:.5f}", "yes" if kept else "NO", f"{largest:.3g}"]


def timed(action: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        try:
            done = action()
        except NotProvedError:
            done = None
        times.append(time.perf_counter() - start)
    return done, statistics.median(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    path = spec_path("quarter-car-ride")
    plant = load(path)
    least, limits = load_specifications(path)
    if least is None:
        parser.error("the example minimises nothing")
    least, limits = replace(least, at_most=None), tuple(limits)
    print("| law | route | proved [m/s2] | sampled | keeps | largest K | time [s] | over tuned |")
    print("|---|---|--:|--:|---|--:|--:|--:|")
    for name, (structure, method) in ROWS.items():
        routes: dict[str, Callable[[], Any]] = {
            "tuned, proved": lambda s=structure: pf.optimise(
                plant, least, limits, CAR, structure=s
            ),
            "SLSQP, not proved": Peer(plant, structure, least, limits).best,
        }
        if method is not None:
            routes["LMI, proved"] = lambda m=method: pf.optimise(plant, least, limits, CAR, m)
        base = 0.0
        for route, action in routes.items():
            done, seconds = timed(action, options.repeats)
            base = base or seconds
            proved = f"{done.bounds[0].level:.5f}" if hasattr(done, "bounds") else "-"
            law = done.law if hasattr(done, "bounds") else done
            row = [name, route, proved, *said(plant, law, least, limits)]
            print(f"| {' | '.join(row)} | {seconds:.1f} | {seconds / base:.2g} |", flush=True)


if __name__ == "__main__":
    main()
