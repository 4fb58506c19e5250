"""Limits on entries of a law: kept by what is tuned, and worth nothing where they do not bind."""

import numpy as np
import pytest

from polefence import Structure
from polefence.plant.spec import loads
from polefence.search.tune.tuner import tune
from support.specs import TWO_STATES, rms


@pytest.fixture(scope="module")
def plant():
    return loads(TWO_STATES)


def best(plant, structure):
    larger, own = structure.extended(plant)
    found = tune(larger, own, rms("x"))[0]
    assert found.kept
    return found.level, np.asarray(found.law.K)


def test_each_entry_keeps_its_own(plant):
    level, K = best(plant, Structure(schedule=(), largest_gain=[[2, 5]]))
    assert np.all(np.abs(K) <= [[2, 5]])
    # both damping and stiffness help, so both are used
    assert np.all(np.abs(K) >= [[1.9, 4.8]])
    wider, _ = best(plant, Structure(schedule=(), largest_gain=5))
    assert wider < level


def test_of_a_law_with_states_the_direct_part_alone_is_limited(plant):
    limited = Structure(("x",), schedule=(), largest_gain=0.5, order=1)
    level, K = best(plant, limited)
    assert np.abs(K[0, 0]) <= 0.5
    alone, _ = best(plant, Structure(("x",), schedule=(), largest_gain=0.5))
    assert level < 0.9 * alone  # a state gives damping, which the deflection alone does not
    assert np.abs(K[:, 2:]).max() > 0.5
