"""Infima that no law attains: a law close by is proved, and what else would go further is said."""

from dataclasses import replace

import numpy as np
import pytest

from polefence import FixedGain, HalfPlane, NotProvedError, Parameter, Structure, UncertainPlant
from polefence.certify.bounds import agreed_bound, best_bound, sampled
from polefence.cli.optimise import Row, require_agreement
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms
from polefence.search import optimise as searched
from polefence.search.optimise import optimise
from polefence.search.task import Missing
from support.commands import ran
from support.specs import TWO_STATES

SERVO = """
name = "servo"
states = ["angle [rad]", "speed [rad/s]"]
inputs = ["voltage [V]"]
disturbances = ["load [N m]"]
[parameter.J]
range = [0.8, 1.2]
through = "1/J"
[matrices]
A = [[0, 1], [0, "-1/J"]]
B = [[0], ["1/J"]]
E = [[0], ["1/J"]]
"""


def servo():
    J, b = Parameter("J", 0.8, 1.2, through="1/J"), Parameter("b", 0.5, 1.5)
    A, B = [["0", "1"], ["0", "-b/J"]], [["0"], ["1/J"]]
    return UncertainPlant.from_expressions([J, b], A, B, B)


@pytest.mark.parametrize("own", [Gain("x1"), Rms("x1", density=1e-6)])
@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_what_falls_without_end_stops_at_a_bound_of_the_search(own, method):
    done = optimise(servo(), own, method=method)
    assert "poles of at most" in done.bounded_by
    assert done.bounds[0].level >= sampled(done.plant, done.law, own).worst * (1 - 1e-9)


def test_a_limit_makes_it_bounded(hasty):
    done = optimise(servo(), Gain("x1"), [Gain("u1", at_most=2)], method="quadratic")
    # at rest the spring of the law holds the load: 1 / k, and |u| <= 2 |w| leaves k finite
    worst = sampled(done.plant, done.law, Gain("x1")).worst
    assert worst <= done.bounds[0].level * (1 + 1e-9)


def test_a_law_that_stops_at_a_bound_says_what_to_limit(tmp_path, capsys):
    (tmp_path / "servo.toml").write_text(SERVO)
    words = ["optimise", str(tmp_path / "servo.toml"), "--minimise", "gain of angle"]
    said = ran(capsys, *words, "--method", "quadratic")
    assert "stopped the gain from growing: limit an input or the gain" in said


def test_a_law_near_an_infimum_is_proved():
    # x1' = x2 + w, x2' = u and y = x1 - x2 give y = (1 - s) x1 + w: at s = 1 that is w, whatever
    # the law, so that 1 is the infimum (maximum principle); only faster and faster laws come near.
    A, B, E = [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0], [0.0]]
    plant = UncertainPlant.from_vertices([A], [B], [E])
    y = Output("y", C=[1, -1])
    done = optimise(plant, Gain(y), method="scheduled")
    assert done.bounds[0].level * (1 + 1e-6) >= 1
    assert done.bounds[0].level <= 1.02
    worst = sampled(plant, done.law, Gain(y)).worst
    assert worst <= done.bounds[0].level * (1 + 1e-6)


def test_a_bound_is_never_below_what_is_sampled():
    plant = UncertainPlant.from_vertices([[[0.0, 1.0], [0.0, 0.0]]], [[[0], [1]]], [[[0], [1]]])
    law, own = FixedGain(np.array([[-1.0, -1.0]])), Gain("x1")
    bound = best_bound(plant, law, own)
    assert agreed_bound(plant, law, bound) is bound
    # within rounding it is raised, and proved again
    low = replace(bound, level=bound.level * 0.999)
    assert sampled(plant, law, own).worst <= agreed_bound(plant, law, low).level
    # a bound far below is of another law
    assert agreed_bound(plant, law, replace(bound, level=bound.level / 2)) is None
    assert agreed_bound(plant, FixedGain(np.array([[1.0, -1.0]])), bound) is None  # unstable
    rows = [Row(replace(bound, level=bound.level / 2), "", sampled(plant, law, own), None)]
    with pytest.raises(NotProvedError, match="this law cannot run in doubles"):
        require_agreement(rows)


def test_of_one_vertex_the_law_is_one_gain():
    plant = UncertainPlant.from_vertices([[[0.0, 1.0], [0.0, 0.0]]], [[[0], [1]]], [[[0], [1]]])
    done = optimise(plant, Rms("x1"), [Rms("u1", at_most=1)], HalfPlane(0.1), method="scheduled")
    assert isinstance(done.law, FixedGain)
    assert np.array_equal(seeded(plant, 3), [[1.0]])


def without_proofs(monkeypatch, name):
    """No law that makes a signal least has a proof."""
    candidates = searched.tuned_candidates

    def some(task, *rest):
        if task.minimise is not None and task.minimise.name != name:
            yield from candidates(task, *rest)

    monkeypatch.setattr(searched, "tuned_candidates", some)


def test_where_a_limit_can_be_kept_that_law_is_the_answer(monkeypatch):
    without_proofs(monkeypatch, "x")
    limit = Rms("force", at_most=1.0)
    done = optimise(loads(TWO_STATES), Rms("x"), [limit], structure=Structure(("x",), schedule=()))
    assert done.bound("force").level <= 1.0
    assert sampled(done.plant, done.law, Rms("x")).worst <= done.bound("x").level


def test_a_limit_that_can_be_kept_is_not_said_to_be_in_the_way(monkeypatch):
    without_proofs(monkeypatch, "x")
    monkeypatch.setattr(searched, "candidate", lambda *_: Missing.LIMIT)
    limits = [Rms("force", at_most=1.0), Rms("v", at_most=0.5)]
    with pytest.raises(NotProvedError) as refused:
        optimise(loads(TWO_STATES), Rms("x"), limits, structure=Structure(("x",), schedule=()))
    assert "rms of force" not in str(refused.value).split("refutation;")[1]
