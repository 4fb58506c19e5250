"""Drives as most tests ask for them: in one call."""

from dataclasses import replace
from typing import Any

import numpy as np

from polefence.vehicle import Drive, Hardware, Road, disturbed, on_road
from polefence.vehicle import drive as follow


def drive(
    plant: Any,
    law: Any,
    road: Any = None,
    *,
    speed: float | None = None,
    start: Any = None,
    step: float = 1e-3,
    duration: float | None = None,
    hold: str = "linear",
    **options: Any,
) -> Drive:
    """Drive over a road at a speed, or under a disturbance; options are of hardware and drive."""
    if isinstance(road, Road):
        excitation = on_road(plant, road, speed, step, duration)
        if start is not None:
            excitation = replace(excitation, start=np.asarray(start, dtype=float))
    else:
        excitation = disturbed(plant, road, step, duration, hold, start)
    keys = ("scheduling", "sampling", "actuator", "stops", "gravity")
    parts = {key: options[key] for key in keys if options.get(key) is not None}
    rest = {key: value for key, value in options.items() if key not in keys}
    return follow(plant, law, excitation, hardware=Hardware(**parts), **rest)
