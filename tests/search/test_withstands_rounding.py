"""A law whose rounding in float32 moves a pole out of the region is told from one that bears it."""

import numpy as np
import pytest

from polefence import optimise
from polefence.examples import spec_text
from polefence.law.laws import FixedGain
from polefence.law.structure import Structure
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import loads
from polefence.plant.system import System
from polefence.region.regions import HalfPlane
from polefence.requirements.rms import Rms
from polefence.search import tuned
from polefence.search.task import Task, withstands_rounding

CHAIN = UncertainPlant(
    (System(np.diag([1.0, 1.0], 1), np.eye(3)[:, 2:]),), name="three integrators"
)


def gain(poles):
    return FixedGain(-np.poly(poles)[:0:-1][None])


@pytest.mark.parametrize(
    ("poles", "bears"),
    [
        ((-1.0, -2.0, -3.0), True),
        ((-0.501, -0.501, -0.501), False),  # three that meet move by the third root of 2e-6
        ((-0.501, -1.0, -1.5), True),
    ],
)
def test_poles_that_meet_at_the_edge_do_not_bear_rounding(poles, bears):
    task = Task(CHAIN, None, (), HalfPlane(0.5), "quadratic")
    assert withstands_rounding(task, gain(poles)) == bears


def test_a_law_that_does_not_is_better_than_none(monkeypatch):
    monkeypatch.setattr(tuned, "withstands_rounding", lambda task, law: False)
    plant = loads(spec_text("semi-active"))
    done = optimise(plant, Rms("sprung-mass acceleration"), structure=Structure(schedule=()))
    assert done.bounds[0].level > 0
