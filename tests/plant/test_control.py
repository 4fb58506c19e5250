"""python-control plants, there and back."""

from __future__ import annotations

import control
import numpy as np
import pytest

from polefence import PlantError
from polefence.plant.control import from_control, to_control


def test_round_trip_keeps_matrices_and_names(physical):
    systems = [to_control(vertex) for vertex in physical.vertices]
    back = from_control(systems, disturbances=1)
    assert np.array_equal(back.A, physical.A)
    assert np.array_equal(back.B, physical.B)
    assert np.array_equal(back.vertices[0].E, physical.vertices[0].E)
    assert len(back.inputs) == len(back.disturbances) == 1


def test_discrete_time_and_transfer_functions_are_refused():
    discrete = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    for system in (discrete, control.tf([1], [1, 1])):
        with pytest.raises(PlantError, match="continuous-time StateSpace"):
            from_control([system])


def test_no_input_left_is_refused():
    system = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(PlantError, match="no control input"):
        from_control([system], disturbances=1)
