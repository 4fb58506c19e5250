"""A lag of two parameters, and drives of it in one of both integrators."""

import numpy as np
import pytest

from polefence import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.vehicle import disturbed, drive
from polefence.vehicle.driving import compiled
from polefence.vehicle.driving import drive as driving

STEP, A, B = 1e-3, 1.2, 0.9  # of a drive [s], and its parameters
BOTH = pytest.mark.parametrize("kernel", [True, False])


def lag(state="x", force="u"):
    """x' = a x + b (u + w)."""
    return UncertainPlant.from_function(
        lambda a, b: ([[a]], [[b]], [[b]]),
        [Parameter("a", 0.8, 1.2), Parameter("b", 0.9, 1.1)],
        states=(state,),
        inputs=(force,),
        disturbances=("w",),
        name="lag",
    )


def driven(monkeypatch, kernel, plant, law, hardware, duration=6.0):
    """A drive from x = 1, with the compiled integrator or without."""
    if kernel and compiled.compiled() is None:
        pytest.skip("built without a compiler")
    start = np.zeros(plant.shape[0])
    start[0] = 1.0
    moved = disturbed(plant, None, STEP, duration, start=start)
    with monkeypatch.context() as patch:
        if not kernel:
            patch.setattr(driving, "compiled", lambda: None)
        return drive(plant, law, moved, {"a": A, "b": B}, hardware)
