"""Laws of a controllable damper beside what no logic goes below: drives, limits, and a figure.

    python benchmarks/semi_active.py [FIGURE]

The car of Table 1 on a class C road at 20 m/s, c from 300 to 3000 N s/m; cost is the root of the
mean square of acceleration + rho times that of the tyre's deflection. Every law gives of a force
what the damper can, set anew each millisecond: skyhook of -c_sky times the body's velocity, the
best c_sky for each rho; ADD of the spring's force, against it, so that the body is not accelerated;
SH-ADD of one or the other, where the acceleration passes 2 pi 1.9 Hz times the velocity (Savaresi &
Spelta 2007); clipped LQ of the regulator's force. Two-state versions, which go from bound to bound,
chatter and do worse in this cost.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are

import polefence as pf
from polefence.plant.system import Array
from polefence.vehicle import SIGNALS, Damper, quarter_car, velocity_density

LOW, HIGH, DENSITY = 300.0, 3000.0, velocity_density("C", 20)
DAMPER = Damper("actuator force", "suspension deflection", 300, 3000)
RHOS = [1e3, 2e3, 4e3, 8e3, 1.5e4, 2.5e4, 4e4, 6e4, 1e5]
SKYHOOK, ADD = np.array([0.0, 0, -1, 0]), np.array([-10000.0, 0, 0, 0])
DAMPINGS = (500.0, 1000.0, 2000.0, 4000.0)
CROSSOVER = 2 * np.pi * 1.9
STEP, SECONDS, ROADS = 1e-3, 30.0, 300

Law = Callable[[Array, Array], Array]


def car() -> pf.UncertainPlant:
    """Return the car without its damper, four states."""
    A, B, E = quarter_car(Fraction("288.9"), Fraction("28.58"), 10000, 155900, 0)
    names: dict[str, Any] = SIGNALS | {"states": SIGNALS["states"][:4]}
    return pf.UncertainPlant.from_vertices([[row[:4] for row in A[:4]]], [B[:4]], [E[:4]], **names)


def cost(plant: pf.UncertainPlant, rho: float) -> pf.Rms:
    """Return the limit that the two signals' weighted sum of squares is."""
    tyre = plant.signal("tyre deflection")
    share = pf.response.weighted_sum("tyre", "m", [(rho**0.5, tyre)])
    return pf.Rms(["sprung-mass acceleration", share], 1e-3, DENSITY)


def clipped(K: Array) -> Law:
    """Return the coefficients that come nearest to a demand K x."""

    def settings(x: Array, _: Array) -> Array:
        v, u = x[:, 3] - x[:, 2], x @ K
        c = np.divide(u, v, out=np.full(v.shape, LOW), where=v != 0)
        return np.asarray(np.clip(c, LOW, HIGH))

    return settings


def mixed(c_sky: float) -> Law:
    """Return skyhook's coefficients where the acceleration is low for the velocity, else ADD's."""
    sky, add = clipped(c_sky * SKYHOOK), clipped(ADD)

    def settings(x: Array, acceleration: Array) -> Array:
        slow = acceleration**2 <= (CROSSOVER * x[:, 2]) ** 2
        return np.where(slow, sky(x, acceleration), add(x, acceleration))

    return settings


def driven(plant: pf.UncertainPlant, law: Law) -> tuple[float, float]:
    """Return the mean squares of acceleration and tyre deflection."""
    source = np.random.default_rng(7)
    A, B, E = plant.A[0], plant.B[0][:, 0], np.array(plant.vertices[0].exact_E, float)[:, 0]
    size = E * np.sqrt(DENSITY / 4 * STEP)
    x, acceleration, total = np.zeros((ROADS, 4)), np.zeros(ROADS), np.zeros(2)
    steps = int(SECONDS / STEP)
    for k in range(steps):
        x = x + source.standard_normal((ROADS, 1)) * size
        c = law(x, acceleration)

        def moved(x: Array, c: Array = c) -> Array:
            return np.asarray(x @ A.T + (c * (x[:, 3] - x[:, 2]))[:, None] * B)

        x = x + STEP * moved(x + STEP / 2 * moved(x))
        x = x + source.standard_normal((ROADS, 1)) * size
        acceleration = moved(x)[:, 2]
        if k >= steps // 6:
            total += np.mean(acceleration**2), np.mean(x[:, 1] ** 2)
    acc, tyre = total / (steps - steps // 6)
    return float(acc), float(tyre)


def regulator(plant: pf.UncertainPlant, rho: float) -> Array:
    """Return the gain of the linear-quadratic regulator of this cost, and 1/s^4 on the travel.

    Without that it lets the body go where it will.
    """
    A, B, eye = plant.A[0], plant.B[0], np.eye(4)
    C = np.vstack([A[2], rho**0.5 * eye[1], eye[0]])
    D = np.vstack([B[2], [0.0], [0.0]])
    R, N = D.T @ D, C.T @ D
    P = solve_continuous_are(A, B, C.T @ C, R, s=N)
    return np.asarray(-np.linalg.solve(R, B.T @ P + N.T)[0])


def rows() -> dict[str, list[float]]:
    """Return the root mean cost of every law, and both limits, at each rho."""
    plant, found = car(), dict[str, list[float]]()
    laws = {
        "skyhook": [clipped(c * SKYHOOK) for c in DAMPINGS],
        "ADD": [clipped(ADD)],
        "SH-ADD": [mixed(c) for c in DAMPINGS],
    }
    for name, each in laws.items():
        reached = [driven(plant, law) for law in each]
        found[name] = [
            min(float(np.sqrt(acc + rho * tyre)) for acc, tyre in reached) for rho in RHOS
        ]
    for rho in RHOS:
        asked = cost(plant, rho)
        ours = pf.semi_active(plant, asked, [DAMPER])
        for name, K in (("clipped LQ", regulator(plant, rho)), ("polefence", ours.K[0])):
            acc, tyre = driven(plant, clipped(K))
            found.setdefault(name, []).append(float(np.sqrt(acc + rho * tyre)))
        found.setdefault("best damper that stays", []).append(ours.passive)
        found.setdefault("polefence: proved at most", []).append(ours.level)
        for name, dampers in (("no semi-active law below", [DAMPER]), ("no law below", [])):
            limit = pf.refute_limits(plant, [asked], dampers)
            found.setdefault(name, []).append(1e-3 * limit.factor if limit else 0.0)
    return found


def draw(found: dict[str, list[float]], path: Path) -> None:
    """Draw all as ratios to the best damper that stays."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    base = np.array(found["best damper that stays"])
    styles = {
        "skyhook": ("tab:brown", ":", "x"), "ADD": ("tab:olive", ":", "s"),
        "SH-ADD": ("tab:purple", ":", "d"), "clipped LQ": ("tab:orange", "--", "v"),
        "polefence": ("tab:blue", "-", "o"), "polefence: proved at most": ("tab:blue", "--", ""),
        "no semi-active law below": ("black", "-", ""), "no law below": ("grey", "-.", ""),
    }  # fmt: skip
    for name, (colour, line, mark) in styles.items():
        axes.plot(RHOS, found[name] / base, color=colour, ls=line, marker=mark, ms=4, label=name)
    axes.axhline(1, color="tab:green", lw=1.2, label="best damper that stays")
    axes.set(xscale="log", xlim=(900, 1.1e5), ylim=(0.5, 1.4))
    axes.set_xlabel("weight of the tyre's deflection, rho [1/s$^4$]")
    axes.set_ylabel("cost over that of the best damper that stays")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, ncols=2, loc="upper left")
    figure.savefig(path, dpi=150)


def main() -> None:
    """Print the table; draw it where a file is named."""
    found = rows()
    print(f"{'rho [1/s4]':26}" + "".join(f"{rho:>9g}" for rho in RHOS))
    for name, values in found.items():
        print(f"{name:26}" + "".join(f"{value:9.3f}" for value in values))
    if len(sys.argv) > 1:
        draw(found, Path(sys.argv[1]))


if __name__ == "__main__":
    main()
