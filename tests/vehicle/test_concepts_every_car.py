"""Suspension concepts of a car on two wheels: two quarter cars that do not feel each other."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from polefence import Rms, with_sensor
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.plant.cars import Body, Car, Wheel, car_family
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, weighted_sum
from polefence.response.stationary import stationary, velocity_density
from polefence.show.plots import concepts_figure
from polefence.vehicle.suspensions import suspensions
from polefence.vehicle.vehicle import SIGNALS, quarter_car

module = import_module("polefence.vehicle.concepts")

DENSITY = velocity_density("C", 20)
M1, M2, K, KT = 288.9, 28.58, 10000.0, 155900.0
ENDS = ("front", "rear")


def shares(plant, prefix):
    """Tyre deflection a hundred times and travel twenty times a metre."""
    known = {signal.name: signal for signal in plant.signals}
    return tuple(
        weighted_sum(f"{prefix}{name} share", "m/s2", [(size, known[f"{prefix}{name} deflection"])])
        for name, size in (("tyre", 100), ("suspension", 20))
    )


@pytest.fixture(scope="module")
def twice():
    a = 1.3
    parts = {"mass": M2, "spring": K, "damper": 0, "tyre": KT}
    wheels = [Wheel("front", x=a, **parts), Wheel("rear", x=-a, **parts)]
    car = Car(Body(2 * M1, 2 * M1 * a * a), wheels, {"f": (a, 0), "r": (-a, 0)})
    plant = replace(car_family(lambda: car, ()), car=car)
    more = [share for end in ENDS for share in shares(plant, f"{end} ")]
    return replace(plant, outputs=(*plant.outputs, *more))


@pytest.fixture(scope="module")
def quarter():
    A, B, E = (np.array(M, float)[:4] for M in quarter_car(M1, M2, K, KT, 0))
    names = SIGNALS | {"states": SIGNALS["states"][:4]}
    plant = UncertainPlant.from_vertices([A[:, :4]], [B], [E], **names)
    return replace(plant, outputs=shares(plant, ""))


def least(plant):
    names = [output.name for output in plant.every_output]
    felt = ["f acceleration", "r acceleration", "sprung-mass acceleration"]
    return Rms([name for name in names if name in felt or "share" in name], density=DENSITY)


def damper(wheel=""):
    force = f"{wheel} force" if wheel else "actuator force"
    return Damper(force, f"{wheel} suspension deflection".strip(), 300, 3000)


@pytest.fixture(scope="module")
def both(twice, quarter):
    """Concepts of the half car, dampers named from behind, and a task of one of its ends."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "ROADS", 2)
        patch.setattr(module, "SECONDS", 40.0)
        patch.setattr(module, "QUICK", 0)  # of degree 2: its bounds are no matter here
        half = module.concepts(twice, least(twice), [damper("rear"), damper("front")])
        sensed = ("suspension deflection", "sprung-mass velocity")
        known = suspensions(quarter)
        task = module._Task(quarter, least(quarter), (damper(),), known, sensed)
        yield half, task


def test_each_end_is_set_as_a_quarter_car(both, twice):
    half, task = both
    rows = {one.name: one for one, _ in half.rows}
    assert len(rows) == 7
    ends = suspensions(twice)
    c = np.array(task.others.coefficients)
    v = twice.shape[0] // 2
    rate = np.zeros((2, 8))  # wheel's velocity less the body's
    rate[:, v : v + 2], rate[:, v + 2 :] = -ends.body[:, v : v + 2], np.eye(2)
    assert np.allclose(rows["passive"].law.K, c[0] * rate, rtol=1e-9, atol=1e-9)
    assert np.allclose(rows["ADD"].law.K, -K * ends.compression, rtol=1e-9, atol=1e-6)
    critical = 2 * np.sqrt(K * M1)
    share = -rows["skyhook"].law.K @ np.linalg.pinv(ends.body)
    assert share == pytest.approx(np.eye(2) * share[0, 0], abs=1e-6)
    assert np.isclose(share[0, 0] / critical, np.geomspace(0.1, 4, 9), rtol=1e-6).any()
    assert rows["skyhook"].sensors[:2] == ("front body velocity", "rear body velocity")
    deflections = tuple(f"{end} suspension deflection" for end in ENDS)
    assert rows["LQG"].sensors == deflections + rows["skyhook"].sensors[:2]


def test_bounds_are_those_of_two_quarter_cars(both):
    half, task = both
    rows = {one.name: (one, ridden) for one, ridden in half.rows}
    alone = next(task.concepts())
    assert rows["passive"][0].level == pytest.approx(np.sqrt(2) * alone.level, rel=1e-3)
    larger, law = task.lqg()
    level = task.proved(larger, law)
    assert rows["LQG"][0].level == pytest.approx(np.sqrt(2) * level, rel=2e-3)
    assert half.active == pytest.approx(np.sqrt(2) * task.below(()), rel=1e-3)
    assert half.active <= half.semi_active <= rows["semi-active"][0].level
    best = rows["active, all states"][0].level
    assert half.active < best < 1.01 * half.active
    for one, ridden in rows.values():
        if one.level is not None:
            assert ridden.cost < one.level + 4 * ridden.error, one.name
        assert (ridden.power == 0) == (bool(one.dampers) or one.name == "passive"), one.name


def test_what_is_shown_is_that_of_the_worst_place(both, twice):
    """Beside the covariance of the passive car; one road is that of every drive."""
    half, _ = both
    one, ridden = half.rows[0]
    known = suspensions(twice)
    each = (known.felt.values(), known.tyre, known.travel)
    sizes = [
        stationary(twice, one.law, [[1.0]], DENSITY, list(signals)).rms.max() for signals in each
    ]
    sizes[1] *= KT
    assert [ridden.acceleration, ridden.tyre, ridden.travel] == pytest.approx(sizes, rel=0.15)
    figure = concepts_figure(half)
    assert figure.axes[1].get_xlabel() == "acceleration, worst seat, rms [m/s2]"


def test_sensors_of_the_spec_are_what_is_measured(twice, monkeypatch):
    """By default; the body's velocities are signals only where nothing says more."""
    plant = with_sensor(twice, "front suspension deflection", 80, 0.0005)
    seen = list[tuple[str, ...]]()

    def stop(self, plant, specification, dampers, known, measured, body):
        seen.append(measured)
        raise InterruptedError

    monkeypatch.setattr(module._Task, "__init__", stop)
    for one in (plant, twice):
        with pytest.raises(InterruptedError):
            module.concepts(one, least(twice), [damper("front"), damper("rear")])
    assert seen[0] == ("measured front suspension deflection",)
    assert len(seen[1]) == 4


def test_a_regulator_takes_the_states_of_sensors(quarter, both):
    """It is that without them, where these cost nothing."""
    _, task = both
    plant = with_sensor(quarter, "suspension deflection", 80, 0.0005)
    plant = with_sensor(plant, "sprung-mass acceleration", 80, 0.05)
    seen = ("measured suspension deflection", "measured sprung-mass acceleration")
    own = module._Task(plant, task.specification, (damper(),), suspensions(plant), seen)
    _, law = own.lqg()
    _, alone = task.lqg()
    assert np.allclose(law.K[0, 6:10], alone.K[0, 4:], rtol=1e-4, atol=1e-2)
    assert np.allclose(law.K[0, 10:], 0, atol=1e-2)


def test_forces_that_cancel_out_cost_something():
    R = np.array([[4.0, 2.0], [2.0, 1.0]])
    values = np.linalg.eigvalsh(module._at_least(R, 1e-3))
    assert values == pytest.approx([5e-3, 5.0])
    assert module._at_least(np.array([[3.0]]), 1e-3) == pytest.approx(3.0)


def test_the_command_takes_a_half_car(both, tmp_path, capsys, monkeypatch):
    half, _ = both
    asked = list[object]()
    monkeypatch.setattr(module, "concepts", lambda *words: asked.append(words) or half)
    spec = tmp_path / "half.toml"
    dampers = (
        f'[damper."{end} force"]\ndeflection = "{end} suspension deflection"\nrange = [300, 2000]\n'
        for end in ENDS
    )
    spec.write_text(spec_text("half-car") + "\n" + "".join(dampers))
    assert main(["concepts", str(spec), "--json", str(tmp_path / "rows.json")]) == 0
    (words,) = asked
    assert [one.force for one in words[2]] == ["front force", "rear force"]
    out = capsys.readouterr().out
    assert "the worst seat, wheel, actuator; power: their sum" in out
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert [row["concept"] for row in rows] == [one.name for one, _ in half.rows]


def test_a_velocity_of_the_body_that_a_spec_names_is_kept(twice):
    named = Output("front body velocity", "m/s", C=suspensions(twice).body[0])
    plant, names = module._with_velocities(
        replace(twice, outputs=(*twice.outputs, named)), suspensions(twice)
    )
    assert names == ("front body velocity", "rear body velocity")
    assert len(plant.outputs) == len(twice.outputs) + 2


def test_a_regulator_holds_what_costs_nothing_and_drifts():
    """Of two rates one costs nothing: the Riccati equation alone leaves its pole at zero."""
    A, B = np.diag([0.0, -1.0]), np.ones((2, 1))
    C, D = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    P = module._regulator(A, B, C, D, D.T @ D)
    assert np.linalg.eigvals(A - B @ B.T @ P).real.max() < 0
    held = np.diag([1.0, 1.0])
    both = module._regulator(
        A, B, np.vstack([held, [[0.0, 0.0]]]), np.vstack([D * 0, [[1.0]]]), np.eye(1)
    )
    assert np.allclose(A.T @ both + both @ A - both @ B @ B.T @ both + held, 0, atol=1e-9)
