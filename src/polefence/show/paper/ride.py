"""Figures 7 to 10 of Leite & Peres (2005): how the car under the scheduled gain responds.

The paper does not say on which road figure 10 was computed. Here it is an ISO 8608 class C road at
20 m/s; figures 7 to 9 need none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.design.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, states
from polefence.plant.points import edges, inside, sample
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.response import bands
from polefence.response.linear import frequency, impulse, step
from polefence.response.result import Frequency, Response
from polefence.response.stationary import velocity_density
from polefence.response.weighting import WF, WK
from polefence.show.paper.study import DISK
from polefence.show.paper.tables import number, table
from polefence.vehicle.vehicle import require_ride

CLASS, SPEED = "C", 20.0  # road class, [m/s]
DURATION, STEP = 1.5, 5e-4  # [s]
SAMPLES = 400
SHARES = (0.05, 0.02)
# Severe discomfort, 30 minutes, in the one-third octaves 0.1 to 0.63 Hz [m/s2]: ISO 2631-3:1985,
# since withdrawn, to which the paper's figure refers.
BOUNDARY = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.5, 2.15, 3.15])


@dataclass(frozen=True, eq=False)
class Ride:
    """The responses that figures 7 to 10 show, at points of a family.

    Attributes
    ----------
    step, impulse : Response
        To road velocity; four states and sprung-mass acceleration; of the impulse tyre deflection,
        sprung-mass velocity and acceleration.
    frequency : Frequency
        From road velocity to the four states.
    bands, passive_bands : tuple of (count, bands) array
        Rms of the sprung-mass acceleration weighted by Wk (1 to 80 Hz) and Wf (0.1 to 0.63 Hz) in
        each one-third octave [m/s2]; under the law and without one.
    rms, passive_rms : (count,) array
        The same over all frequencies, weighted by Wk [m/s2].
    """

    step: Response
    impulse: Response
    frequency: Frequency
    bands: tuple[Array, Array]
    passive_bands: tuple[Array, Array]
    rms: Array
    passive_rms: Array


def points(plant: UncertainPlant, count: int = SAMPLES) -> Array:
    """Return vertices, edges and a seeded sample: of the box where there are parameters."""
    N = len(plant.vertices)
    domain = Domain.of("box" if plant.parameters else "simplex", N)
    if plant.parameters:
        return domain.alpha(sample(domain)[: N + count])
    return np.vstack([edges(domain, 5), inside(domain, count)])


def ride_of(design: Design) -> Ride:
    """Compute everything that figures 7 to 10 show."""
    plant, alpha = design.plant, points(design.plant)
    known = require_ride(plant)
    signals = (*states(plant)[:4], known.acceleration)
    density = velocity_density(CLASS, SPEED)
    ours, passive = (
        bands.stationary_ride(_gain(plant, law, alpha, known.acceleration), density)
        for law in (design, None)
    )
    return Ride(
        step(plant, design, alpha, signals, duration=DURATION, step=STEP),
        impulse(plant, design, alpha, (*signals[1:3], signals[4]), duration=DURATION, step=STEP),
        frequency(plant, design, alpha, np.geomspace(0.05, 50, 300), signals[:4]),
        _weighted(ours),
        _weighted(passive),
        ours.weighted_rms,
        passive.weighted_rms,
    )


def _gain(plant: UncertainPlant, law: Any, alpha: Array, acceleration: Output) -> Array:
    nodes, _ = bands.quadrature()
    return frequency(plant, law, alpha, nodes, [acceleration]).gain[:, :, 0, 0]  # type: ignore[return-value]


def _weighted(found: bands.StationaryRide) -> tuple[Array, Array]:
    """Weight the bands by the filters' factors at their centres, as the standard does."""
    return (
        found.ride * np.abs(WK.gain(bands.RIDE.centre)),
        found.motion * np.abs(WF.gain(bands.MOTION.centre)),
    )


def summary(rides: Mapping[str, Ride]) -> dict[str, Any]:
    """Return what the paper states of these figures, beside what was computed, as plain data."""
    return {name: _summary(ride) for name, ride in rides.items()}


def _summary(ride: Ride) -> dict[str, Any]:
    names = [signal.name for signal in ride.step.signals]
    settling = {
        f"{100 * share:g} %": dict(
            zip(names, map(float, ride.step.settling(share).max(axis=0)), strict=True)
        )
        for share in SHARES
    }
    sickness = ride.bands[1] / BOUNDARY
    peaks = ride.step.peaks()[0]
    return {
        "points": len(ride.step.alpha),
        "longest settling time [s]": settling,
        "largest peak after a unit step": dict(
            zip(names, map(float, np.abs(peaks).max(axis=0)), strict=True)
        ),
        "road": f"class {CLASS} at {SPEED:g} m/s",
        "largest share of the severe discomfort boundary": float(sickness.max()),
        "weighted rms acceleration [m/s2]": [float(ride.rms.min()), float(ride.rms.max())],
        "weighted rms acceleration, passive [m/s2]": [
            float(ride.passive_rms.min()),
            float(ride.passive_rms.max()),
        ],
    }


def text(found: Mapping[str, Any], settled: float) -> str:
    """Set what the paper states of figures 7 and 10 beside what was computed, as Markdown."""
    times = [
        (name, f"{share} band", *(number(t) for t in row.values()))
        for name, own in found.items()
        for share, row in own["longest settling time [s]"].items()
    ]
    signals = next(iter(next(iter(found.values()))["longest settling time [s]"].values()))
    comfort = [
        (
            name,
            *(
                "{:.3g} to {:.3g}".format(*own[f"weighted rms acceleration{law} [m/s2]"])
                for law in ("", ", passive")
            ),
            f"{100 * own['largest share of the severe discomfort boundary']:.2g} %",
        )
        for name, own in found.items()
    ]
    verdicts = []
    for share in SHARES:
        band = f"{100 * share:g} %"
        longest = {
            n: max(own["longest settling time [s]"][band].values()) for n, own in found.items()
        }
        met = [name for name, value in longest.items() if value < settled]
        verdicts.append(f"With a band of {band} that holds on: {', '.join(met) or 'neither'}.")
    pole = DISK.centre + DISK.radius
    slowest = math.log(1 / min(SHARES)) / -pole
    rougher = all(
        own["weighted rms acceleration [m/s2]"][0]
        > own["weighted rms acceleration, passive [m/s2]"][1]
        for own in found.values()
    )
    return "\n\n".join(
        [
            f"Published: settling always below {settled:g} s (no band is given). Computed, the "
            "longest over the family, in seconds; the band is a share of the final value, or of "
            "the peak where the final value is zero:",
            table(("family", "", *signals), times),
            f"{' '.join(verdicts)} A pole as slow as the disk allows, {pole:g} 1/s, "
            f"alone takes {slowest:.2f} s to {100 * min(SHARES):g} %.",
            f"Published: far below the severe discomfort boundary. Computed on a class {CLASS} "
            f"road at {SPEED:g} m/s, sprung-mass acceleration in m/s2, weighted by Wk:",
            table(("family", "scheduled", "passive", "largest share of the boundary"), comfort),
            "The car rides rougher than without control: the disk asks for speed, not for comfort."
            if rougher
            else "On some cars of the family it rides smoother than without control.",
        ]
    )
