"""Where a disturbance that stays leaves a plant, by hand calculation and by long simulation."""

import re

import numpy as np
import pytest

from polefence import Design, FixedGain, UncertainPlant
from polefence.base.errors import InputError
from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.plant.points import seeded
from polefence.response.linear import simulate
from polefence.vehicle.rest import held_words, rests
from support.commands import ran


def test_a_car_on_a_grade_stands_as_the_balance_of_forces_has_it():
    """At rest both masses rise with the road: k x1 + u = 0 with u = K1 x1 + K3 w + K4 w."""
    car, K = family("quarter-car-ride"), np.array([[-3000.0, -9000.0, -900.0, 150.0]])
    alpha = seeded(car, 300)
    k = [10000 + 200 * (-10 + 20 * (a[1] + a[3])) for a in alpha]
    x1 = np.array([-(K[0, 2] + K[0, 3]) / (each + K[0, 0]) for each in k])
    found = {rest.signal.name: rest for rest in rests(car, FixedGain(K), alpha)}
    own = found["suspension deflection"]
    assert (own.low, own.high) == pytest.approx((x1.min(), x1.max()), rel=1e-9)
    force = found["actuator force"]
    u = -np.array(k) * x1
    assert (force.low, force.high) == pytest.approx((u.min(), u.max()), rel=1e-9)
    tyre, body = found["tyre deflection"], found["sprung-mass velocity"]
    assert (tyre.low, tyre.high) == (0.0, 0.0)
    assert (body.low, body.high) == pytest.approx((1.0, 1.0))
    assert own.source.label == "road velocity [m/s]"
    assert "a grade of 5 % at 20 m/s" in held_words(car, own.source)


def test_what_is_left_is_where_a_long_simulation_ends():
    plant = UncertainPlant.from_vertices(
        [[[0, 1], [-2, -3]], [[0, 1], [-4, -3]]], [[[0], [1]]] * 2, [[[0, 1], [1, 0]]] * 2,
        disturbances=("push", "drift"),
    )  # fmt: skip
    K = [[-1.0, -0.5]]
    found = {(r.source.name, r.signal.name): r for r in rests(plant, K, np.eye(2))}
    for j, name in enumerate(("push", "drift")):
        w = np.zeros((4000, 2))
        w[:, j] = 1.0
        end = simulate(plant, K, np.eye(2), w, 0.01 * np.arange(len(w)), hold="held").values[:, -1]
        for i, signal in enumerate(("x1", "x2", "u1")):
            own = found[name, signal]
            assert own.low == pytest.approx(end[:, i].min(), abs=1e-9)
            assert own.high == pytest.approx(end[:, i].max(), abs=1e-9)


def test_an_integral_leaves_nothing_and_a_drifting_state_has_no_rest():
    car = family("quarter-car-level")
    alpha = seeded(car, 100)
    held = FixedGain([[-5000.0, -9000.0, -900.0, 150.0, 3000.0]])
    found = {rest.signal.name: rest for rest in rests(car, held, alpha)}
    assert found["suspension deflection"].size == 0
    assert found["integral of suspension deflection"].size > 0.1
    # without control the integral is no part of the car, and grows or stays as it was
    assert "integral of suspension deflection" not in {
        rest.signal.name for rest in rests(car, None, alpha)
    }


def test_a_plant_that_nothing_disturbs_is_refused(make_random):
    with pytest.raises(InputError):
        rests(make_random(1, 3, 1, 2), None, np.eye(2))


def test_optimise_and_report_warn_of_it(tmp_path, monkeypatch, capsys, lmi_alone):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ride.toml").write_text(spec_text("quarter-car-ride"))
    said = ran(capsys, "optimise", "ride.toml", "--method", "quadratic", "-o", "ride")
    (held,) = [line for line in said.splitlines() if "steady state" in line]
    assert "road velocity = 1 m/s (a grade of 5 % at 20 m/s)" in held
    low, high = re.search(r"suspension deflection (\S+) to (\S+) m", held).groups()
    design = Design.load(tmp_path / "ride")
    alpha = np.eye(len(design.plant.vertices))
    own = [rest for rest in rests(design.plant, design, alpha) if "suspension" in rest.signal.name]
    assert float(low) <= own[0].low * 1.001 < own[0].high * 1.001 <= float(high) * 1.002
    (note,) = [line for line in said.splitlines() if "note:" in line]
    assert "of the rms of suspension deflection and actuator force" in note
    assert main(["report", "ride"]) == 0
    page = (tmp_path / "ride" / "report.html").read_text()
    assert "(a grade of 5 % at 20 m/s)" in page
    assert f"{low} to {high}" in page


def test_a_state_that_goes_far_hides_no_signal():
    """A mass held by a spring of 1e-9 N/m: it ends 1e9 m off, and the spring's force is the push.

    The other mass, held well, ends where its own spring has it.
    """
    plant = UncertainPlant.from_vertices(
        [[[0, 1, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1], [0, 0, 0, -1]]],
        [[[0, 0], [1, 0], [0, 0], [0, 1]]], [[[0], [1], [0], [1]]],
        states=("far", "speed", "near", "rate"), inputs=("soft", "hard"), disturbances=("push",),
    )  # fmt: skip
    law = FixedGain([[-1e-9, -1, 0, 0], [0, 0, -50, -1]])
    found = {rest.signal.name: rest.low for rest in rests(plant, law, np.eye(1))}
    assert found["far"] == pytest.approx(1e9)
    assert (found["soft"], found["hard"]) == pytest.approx((-1, -1))
    assert found["near"] == pytest.approx(0.02)
    assert found["speed"] == found["rate"] == 0
