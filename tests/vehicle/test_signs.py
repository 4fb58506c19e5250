"""The same car with either sign of each deflection: nothing but these signs may differ."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from polefence import FixedGain, UncertainPlant
from polefence.base.errors import PlantError
from polefence.examples import family, spec_text
from polefence.plant.spec import loads
from polefence.plant.vehicle import Vehicle
from polefence.vehicle.compare import compare, standard_laws
from polefence.vehicle.driving.drive import Setup, run
from polefence.vehicle.driving.parts import BumpStops, Estimated, Jump
from polefence.vehicle.excitation import on_road
from polefence.vehicle.reference_laws import Sizes, lqr, skyhook
from polefence.vehicle.roads import kerb
from polefence.vehicle.vehicle import masses, ride
from support.commands import ran
from support.drives import drive

SENSES = [s for s in product((1, -1), repeat=2) if s != (1, 1)]
TEXTBOOK = (
    spec_text("quarter-car-ride")
    .replace("[0, 0, -1, 1]", "[0, 0, 1, -1]")
    .replace("[0, 0, 0, -1]", "[0, 0, 0, 1]")
    .replace('["k/m1", 0,', '["-k/m1", 0,')
    .replace('["-k/m2", "kt/m2",', '["k/m2", "-kt/m2",')
    .replace("E = [[0], [1],", "E = [[0], [-1],")
    .replace(
        'model = "quarter car"',
        'model = "quarter car"\nsuspension_positive = "extension"\ntyre_positive = "extension"',
    )
)


def turned(plant, *signs):
    """The plant in the state diag(signs) x, exactly."""

    def times(M, right=None):
        left = [*signs, *[1] * (len(M) - len(signs))]
        right = left if right is None else right
        return [
            [s * t * x for t, x in zip(right, row, strict=True)]
            for s, row in zip(left, M, strict=True)
        ]

    vertices = [
        replace(
            v,
            exact_A=times(v.exact_A),
            exact_B=times(v.exact_B, [1] * len(v.exact_B[0])),
            exact_E=times(v.exact_E, [1] * len(v.exact_E[0])),
        )
        for v in plant.vertices
    ]
    first, second = ("compression" if sign > 0 else "extension" for sign in signs[:2])
    vehicle = Vehicle(suspension_positive=first, tyre_positive=second)
    return replace(plant, vertices=tuple(vertices), vehicle=vehicle)


@pytest.fixture(params=SENSES, ids=str)
def signs(request):
    return request.param


@pytest.fixture
def car():
    return family("quarter-car-ride")


def test_the_signs_are_those_that_were_said(car, signs):
    ours = turned(car, *signs)
    assert ride(car).sense == (1, 1)
    assert ride(ours).sense == signs
    assert ((0, signs[1] * 155900, 0, 0),) == ride(ours).tyre_force.C
    theirs, found = (masses(p, ride(p), np.eye(4)) for p in (car, ours))
    for name in ("m1", "m2", "k", "c", "kt"):
        assert np.array_equal(getattr(found, name), getattr(theirs, name))


def test_laws_are_the_same_forces(car, signs):
    ours, S = turned(car, *signs), np.diag([*signs, 1, 1])
    assert np.array_equal(skyhook(ours).K, skyhook(car).K)
    found = lqr(ours).K
    assert found == pytest.approx(lqr(car).K @ S, rel=1e-9)
    whole = family("quarter-car-physical")
    turned_whole = turned(whole, *signs, 1, 1, signs[0])
    sizes = Sizes(integral=0.01)
    mirror = np.diag([*signs, 1, 1, signs[0]])
    found = lqr(turned_whole, sizes).K
    assert found == pytest.approx(lqr(whole, sizes).K @ mirror, rel=1e-9)


def test_the_road_feels_the_same(car, signs):
    ours = turned(car, *signs)
    names = ("passive", "skyhook", "lqr")
    mine = compare(ours, standard_laws(ours, names=names))
    theirs = compare(car, standard_laws(car, names=names))
    assert mine.values == pytest.approx(theirs.values, rel=1e-9)


def test_stops_push_inwards_and_the_estimator_learns_the_same(car, signs):
    ours, S = turned(car, *signs), np.array([*signs, 1, 1])
    K = lqr(car).K
    given = {
        "road": kerb(0.12, before=0.5, after=20), "speed": 5.0, "duration": 1.0,
        "stops": BumpStops(0.02, 0.03, damping=500.0), "scheduling": Estimated(),
        "parameters": {"m1": Jump(0.3, 240, 330), "beta": 4},
    }  # fmt: skip
    theirs = drive(car, FixedGain(K), **given)
    mine = drive(ours, FixedGain(K * S), **given)
    assert theirs.stop_force.max() > 1000  # bump
    assert theirs.stop_force.min() < -100  # rebound
    assert np.abs(theirs.states).max() < 10
    assert mine.stop_force == pytest.approx(theirs.stop_force, rel=1e-6, abs=1e-6)
    assert mine.states * S == pytest.approx(theirs.states, rel=1e-6, abs=1e-9)
    assert mine.used == pytest.approx(theirs.used, rel=1e-6)
    assert [e.text for e in mine.events] == [e.text for e in theirs.events]


def test_the_tyre_leaves_the_road_at_the_same_instants(car, signs):
    def events(plant):
        setup = Setup(plant, on_road(plant, kerb(0.12, before=0.5, after=20), 5.0, 1e-3, 1.0))
        return [str(event) for event in run(setup, None).events]

    found = events(car)
    assert "the tyre leaves the road" in found[0]
    assert events(turned(car, *signs)) == found


@pytest.mark.parametrize(
    ("old", "new", "entry"),
    [
        ("[0, 0, -1, 1]", "[0, 0, 1, 1]", "A[1][3] = 1, that of a quarter car is -1"),
        ("[0, 0, -1, 1]", "[0, 0, -1000, 1000]", "A[1][3] = -1000"),
        ("[0, 0, -1, 1]", "[0.1, 0, -1, 1]", "A[1][1] = 0.1"),
        ("B = [[0],", "B = [[1],", "B[1][1] = 1"),
        ("E = [[0],", "E = [[1],", "E[1][1] = 1"),
        ("[0, 0, 0, -1]", "[0, 0, 0, 1]", "A[2][4] = 1"),
        ("[0, 0, 0, -1]", "[0, 0, 1, -1]", "A[2][3] = 1"),
        ("E = [[0], [1]", "E = [[0], [-1]", "E[2][1] = -1, that of a quarter car is 1"),
        ("E = [[0], [1]", "E = [[0], [0]", "E[2][1] = 0"),
        ("E = [[0], [1]", "E = [[0], [0.045]", "E[2][1] = 0.045"),
    ],
)
def test_other_kinematics_are_no_quarter_car(old, new, entry):
    with pytest.raises(PlantError, match="vehicle: vertex 1: " + re.escape(entry)) as refusal:
        loads(spec_text("quarter-car-ride").replace(old, new), "car.toml")
    assert "\n" not in str(refusal.value)


def test_a_sampled_car_has_no_ride(car):
    A, B = (np.eye(4) + 0.001 * car.at([1, 0, 0, 0])[0], car.at([1, 0, 0, 0])[1])
    given = {"states": car.states, "inputs": car.inputs, "vehicle": Vehicle()}
    with pytest.raises(PlantError, match="the equations of a car are in continuous time"):
        UncertainPlant.from_vertices([A], [B], **given, sample_time=0.001)


def test_the_commands_take_the_textbook_sign(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(TEXTBOOK)
    words = ["simulate", "car.toml", "--law", "skyhook", "--kerb", "0.1", "--speed", "5"]
    said = ran(capsys, *words, "--travel-limit", "0.02", "--duration", "1")
    assert "stop hit" in said
    assert "nan" not in said
    assert "runs away" not in said
