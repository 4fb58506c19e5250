"""Typical sizes that a search takes for its units."""

import numpy as np
import pytest

import polefence as pf
from polefence.search.tune.starts import typical


@pytest.mark.parametrize("push", [0.0, 1.0], ids=["left alone", "disturbed"])
@pytest.mark.parametrize("coupling", [0.0, 0.5], ids=["moves nothing", "moves another"])
def test_a_state_that_neither_inputs_nor_states_move_has_one_too(coupling, push):
    A = [[0, 1, 0], [-1, -0.2, coupling], [0, 0, -1e-3]]
    plant = pf.UncertainPlant.from_vertices([A], [[[0], [1], [0]]], [[[0], [1], [push]]])
    found = typical(plant, np.eye(3)).states
    assert found.min() >= 1e-4 * found.max()
