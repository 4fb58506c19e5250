"""Drives of many cars in the compiled kernel, beside NumPy for all cars at once and SciPy for one.

    python benchmarks/drives.py

100 quarter cars of random load and age go 20 s over a class C road at 20 m/s, 20,000 steps of 1 ms,
under a regulator. The times are of whole drives: motion, rates, forces, events. NumPy is what a
package without the kernel runs: the same steps of Runge-Kutta. SciPy's `solve_ivp` (RK45, its
default tolerances, no step longer than 5 ms) follows one car after the other, of which there are
three, and records the states alone; its time is by car. It has no sampled controller. All take
turns; every time is the median of three. Prints Markdown.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from polefence.examples import family
from polefence.vehicle import (
    Actuator,
    BumpStops,
    Damper,
    Hardware,
    Jump,
    Sampling,
    Sine,
    drive,
    lqr,
    on_road,
    random_road,
)
from polefence.vehicle.driving import compiled
from polefence.vehicle.driving import drive as driving

CARS, ALONE, TURNS = 100, 3, 3
SECONDS, SPEED, STEP = 20.0, 20.0, 1e-3
LIMIT, STOPS = 300.0, BumpStops(0.02, 0.02)
PLANT = family("quarter-car-physical")
ROAD = on_road(PLANT, random_road("C", SPEED * (SECONDS + 1), seed=3), SPEED, STEP, SECONDS)
LAW = lqr(PLANT)
HARDWARE = {
    "no limits": Hardware(),
    "limit and stops": Hardware(actuator=Actuator(limit=LIMIT), stops=STOPS),
    "lag, limit and stops": Hardware(actuator=Actuator(20.0, LIMIT), stops=STOPS),
    "sampled each 5 ms, limit and stops": Hardware(
        sampling=Sampling(0.005), actuator=Actuator(limit=LIMIT), stops=STOPS
    ),
    "a damper of 300 to 3000 N s/m, stops": Hardware(
        dampers=(Damper("actuator force", "suspension deflection", 300, 3000),), stops=STOPS
    ),
}


def cars(moving: bool) -> list[dict[str, Any]]:
    """Return parameters, in one car as in the other."""
    source = np.random.default_rng(0)
    low, high = (
        np.array([float(getattr(p, k)) for p in PLANT.parameters]) for k in ("low", "high")
    )
    values = low + (high - low) * source.random((CARS, len(low)))
    names = [p.name for p in PLANT.parameters]
    found: list[dict[str, Any]] = [dict(zip(names, row.tolist(), strict=True)) for row in values]
    for own in found if moving else []:
        own |= {"m1": Jump(8.0, own["m1"], float(high[0])), "beta": Sine(0, 9, 0.2)}
    return found


def alone(parameters: dict[str, float], hardware: Hardware) -> None:
    """Follow one car by SciPy."""
    A, B = PLANT.at(PLANT.alpha(**parameters))
    E, K, w = PLANT.vertices[0].E, LAW.K, np.asarray(ROAD.w)
    assert E is not None
    parts, n = hardware.actuator, len(A)

    def slope(t: float, z: Any) -> Any:
        u = K @ z[:n]
        for _ in hardware.dampers:
            v = z[3] - z[2]
            one, other = 300 * v, 3000 * v
            u = np.clip(u, min(one, other), max(one, other))
        u = parts.limited(u)
        given = z[n:] if parts.rate else u
        dz = A @ z[:n] + B @ given + E[:, 0] * w[min(int(t / STEP), len(w) - 1), 0]
        if hardware.stops is not None:
            dz = dz + B[:, 0] * hardware.stops.force(z[0], dz[0])
        return np.concatenate([dz, parts.rate * (u - given)]) if parts.rate else dz

    start = np.zeros(n + bool(parts.rate))
    done = solve_ivp(slope, (0, SECONDS), start, t_eval=ROAD.times, max_step=5 * STEP)
    if not done.success:
        raise RuntimeError(done.message)


def seconds(work: Callable[[], Any]) -> float:
    """Return how long it takes."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def numpy_drive(given: list[dict[str, Any]], hardware: Hardware) -> None:
    """Drive without the kernel."""
    own = driving.compiled
    driving.compiled = lambda: None
    try:
        drive(PLANT, LAW, ROAD, given, hardware)
    finally:
        driving.compiled = own


def main() -> int:
    """Print the table."""
    if compiled.compiled() is None:
        print("built without a compiler: there is no kernel to measure", file=sys.stderr)
        return 1
    print(f"{CARS} cars, {SECONDS:g} s in steps of {STEP:g} s; seconds, medians of {TURNS}\n")
    print("| | kernel | NumPy | NumPy : kernel | SciPy, one car | SciPy : kernel, by car |")
    print("|---|---|---|---|---|---|")
    for name, hardware in [*HARDWARE.items(), ("load steps, ageing, limit and stops", None)]:
        parts = hardware or HARDWARE["limit and stops"]
        given = cars(hardware is None)
        own, twin, peer = list[float](), list[float](), list[float]()
        for turn in range(TURNS):
            own.append(seconds(lambda: drive(PLANT, LAW, ROAD, given, parts)))  # noqa: B023
            twin.append(seconds(lambda: numpy_drive(given, parts)))  # noqa: B023
            if hardware is not None and parts.sampling is None:
                peer.append(seconds(lambda: alone(given[turn % ALONE], parts)))  # noqa: B023
        mine, theirs = statistics.median(own), statistics.median(twin)
        row = f"| {name} | {mine:.2f} | {theirs:.2f} | {theirs / mine:.1f} |"
        if peer:
            each = statistics.median(peer)
            print(f"{row} {each:.2f} | {each * CARS / mine:.0f} |", flush=True)
        else:
            print(f"{row} - | - |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
