"""Comparisons against other ways to the same numbers, an energy balance, and known laws."""

import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from polefence import Disk, InputError, Scheduled, place
from polefence.plant.outputs import Output
from polefence.plant.points import values_at
from polefence.response.bands import quadrature, stationary_ride
from polefence.response.closed import close
from polefence.response.linear import frequency
from polefence.response.stationary import stationary, velocity_psd
from polefence.vehicle.compare import NAMES, QUANTITIES, NoLaw, compare, points, standard_laws
from polefence.vehicle.vehicle import masses, require_ride

module = import_module("polefence.vehicle.compare")  # the package has the function

ROAD = velocity_psd(256e-6, 20)  # class C at 20 m/s


@pytest.fixture(scope="module")
def laws(physical):
    return standard_laws(physical)


@pytest.fixture(scope="module")
def found(physical, laws):
    return compare(physical, laws, alpha=points(physical)[::40])


def column(found, law, quantity):
    names = [name for name, _ in QUANTITIES]
    return found.values[found.laws.index(law), :, names.index(quantity)]


def test_all_six_laws_are_there_and_three_are_proved(physical, laws, found):
    assert found.laws == tuple(laws) == NAMES
    assert found.left_out == {}
    for name in ("quadratic", "slack", "scheduled"):
        assert laws[name].proved
        assert laws[name].region == Disk(-40, 36)
        assert laws[name].method == name


@pytest.mark.parametrize("law", ["passive", "lqr", "scheduled"])
def test_rms_values_are_those_of_the_stationary_answers(physical, laws, found, law):
    known = require_ride(physical)
    direct = stationary(physical, laws[law], found.alpha, ROAD, known.signals)
    for quantity, name in (
        ("acceleration", "sprung-mass acceleration"),
        ("tyre deflection", "tyre deflection"),
        ("tyre load variation", "tyre force variation"),
        ("suspension travel", "suspension deflection"),
        ("actuator force", "actuator force"),
    ):
        assert np.allclose(column(found, law, quantity), direct.of(name), rtol=1e-9)


@pytest.mark.parametrize("law", ["passive", "skyhook", "slack"])
def test_the_weighting_is_that_over_frequency(physical, laws, found, law):
    some, (f, _) = found.alpha[:6], quadrature()
    gain = frequency(physical, laws[law], some, f, [require_ride(physical).acceleration]).gain
    theirs = stationary_ride(gain[..., 0, 0], ROAD).weighted_rms
    assert np.allclose(column(found, law, "weighted acceleration")[:6], theirs, rtol=1e-9)


@pytest.mark.parametrize("law", NAMES)
def test_power_is_what_the_damper_does_not_take(physical, laws, found, law):
    """The road brings kt psd / 4, whatever the law; the damper takes c E v^2; the rest is ours."""
    known = require_ride(physical)
    car = masses(physical, known, found.alpha)
    apart = Output("apart", "m/s", C=[0, 0, 1, -1, 0])
    v = stationary(physical, laws[law], found.alpha, ROAD, [apart]).rms[:, 0]
    brought = car.kt * ROAD / 4
    mean = column(found, law, "mean power")
    assert np.allclose(mean, car.c * v**2 - brought, rtol=0, atol=1e-8 * brought.max())
    drawn = column(found, law, "mean power drawn")
    assert np.all(drawn >= np.maximum(mean, 0))
    assert np.all(drawn <= np.maximum(mean, 0) + v * column(found, law, "actuator force"))


@pytest.mark.parametrize("r", [-1.0, -0.97, -0.3, 0.0, 0.6, 1.0])
def test_power_drawn_is_the_mean_of_the_positive_part(r):
    theta = (np.arange(200_000) + 0.5) * (2 * np.pi / 200_000)  # of two independent normals
    product = np.cos(theta) * (r * np.cos(theta) + np.sqrt(1 - r * r) * np.sin(theta))
    mean = 2 * np.maximum(product, 0).mean()  # the mean square of their radius is 2
    drawn = module._drawn(np.array([r * 6.0]), np.array([6.0]))[0]
    assert drawn == pytest.approx(6 * mean, abs=1e-8)
    assert module._drawn(np.zeros(1), np.zeros(1)) == 0


def test_rows_are_worst_best_median_and_spread_of_the_points(physical, found):
    assert len(found.rows) == len(QUANTITIES) * len(NAMES)
    for row in found.rows:
        own = column(found, row.law, row.quantity)
        assert (row.worst, row.best, row.median) == (own.max(), own.min(), np.median(own))
        assert row.spread == row.worst - row.best >= 0
        at = found.alpha.tolist().index(list(row.alpha))
        assert own[at] == row.worst
        assert np.allclose(physical.alpha(**row.values), row.alpha, atol=1e-9)
    assert found.row("lqr", "mean power").unit == "W"
    with pytest.raises(InputError, match=r"did you mean 'lqr: mean power'"):
        found.row("lqr", "mean pwer")


def test_the_worst_of_a_known_law_is_where_physics_says(physical):
    """Light and stiff is roughest to ride in, heavy and soft travels most."""
    found = compare(physical, {"passive": None})
    worst = found.row("passive")
    assert worst.values == {"m1": pytest.approx(231.12), "beta": 10}
    assert found.row("passive", "suspension travel").values["m1"] == pytest.approx(346.68)
    assert found.row("passive", "acceleration").worst == pytest.approx(1.36, abs=0.005)
    assert found.row("passive", "acceleration").best == pytest.approx(0.77, abs=0.005)
    force = found.row("passive", "actuator force")
    assert force.worst == force.spread == 0


def test_twice_the_speed_is_twice_the_power(physical, laws):
    some = np.eye(4)
    slow, fast = (compare(physical, {"s": laws["slack"]}, "B", v, some) for v in (10.0, 20.0))
    ratio = fast.values / slow.values
    assert np.allclose(ratio[..., :6], np.sqrt(2))
    assert np.allclose(ratio[..., 6:], 2)
    rough = compare(physical, {"s": laws["slack"]}, "c", 10.0, some)
    assert np.allclose(rough.values[..., :6], 2 * slow.values[..., :6])
    assert rough.road == "C"


def test_points_are_of_the_box(physical):
    found = points(physical)
    assert len(found) > 2000
    assert set(map(tuple, np.eye(4))) <= set(map(tuple, found))
    for alpha in found[::50]:
        assert values_at(physical, alpha.tolist()) is not None
    # Along every edge nine between the corners: one parameter at a bound, the other inside.
    ends = {"m1": (231.12, 346.68), "beta": (-10, 10)}
    values = [values_at(physical, alpha.tolist()) for alpha in found[-36:]]
    at_end = [tuple(name for name in ends if np.isclose(v[name], ends[name]).any()) for v in values]
    assert at_end.count(("m1",)) == at_end.count(("beta",)) == 18


def test_points_of_a_plant_without_parameters_are_of_the_simplex(physical):
    found = points(replace(physical, parameters=()))
    off = [a for a in found if values_at(physical, a.tolist()) is None]
    assert len(off) > 1000
    assert np.allclose(found.sum(axis=1), 1)
    row = compare(replace(physical, parameters=()), {"passive": None}, alpha=found[:50]).rows[0]
    assert row.values is None
    assert sum(row.alpha) == pytest.approx(1)


def test_a_law_that_is_unstable_somewhere_is_listed_with_the_place(physical, found):
    """Unstable at the light end only."""
    K = np.zeros((1, 5))
    K[0, 2] = 2200.0  # of negative damping: c is 680 to 1020
    growth = close(physical, K, found.alpha).poles().real.max(axis=1)
    assert growth.max() > 0
    mixed = compare(physical, {"passive": None, "bad": K}, alpha=found.alpha)
    assert mixed.laws == ("passive",)
    assert mixed.left_out["bad"].startswith("unstable: a pole at ")
    assert "m1 = " in mixed.left_out["bad"]
    assert "bad: unstable" in str(mixed)
    with pytest.raises(InputError, match=r"no law is left to compare \(bad: unstable: a pole at"):
        compare(physical, {"bad": K})


def test_a_method_without_a_proof_is_listed_not_hidden(physical):
    laws = standard_laws(physical, (-40, 31), ("passive", "quadratic", "scheduled"))
    assert isinstance(laws["quadratic"], NoLaw)
    found = compare(physical, laws, alpha=np.eye(4))
    assert found.laws == ("passive", "scheduled")
    assert found.left_out["quadratic"].startswith("refuted for quadratic")
    assert "quadratic: refuted for quadratic" in str(found)
    document = json.loads(json.dumps(found.document(), allow_nan=False))
    assert document["left out"].keys() == {"quadratic"}
    assert len(document["rows"]) == 2 * len(QUANTITIES)
    assert document["rows"][0] == json.loads(json.dumps(found.rows[0].__dict__))


def test_the_table_has_a_line_for_every_row(found):
    lines = str(found).splitlines()
    assert lines[0].startswith("quarter car, physical: road of class C (ISO 8608) at 20 m/s")
    assert len(lines) == 1 + len(QUANTITIES) * (2 + len(NAMES))
    (line,) = [line for line in lines[3:9] if line.startswith("  scheduled ")]
    row = found.row("scheduled")
    numbers = [f"{v:.4g}" for v in (row.worst, row.best, row.median, row.spread)]
    assert line.split()[1:5] == numbers
    assert line.split("  ")[-1].startswith("m1 = ")


def test_a_scheduled_law_of_any_degree_and_a_matrix(physical, laws):
    design = place(physical, Disk(-40, 31), Scheduled(2, 1, "box"))
    K = laws["slack"].law.K
    found = compare(physical, {"box": design, "matrix": K, "slack": laws["slack"]}, alpha=np.eye(4))
    assert np.array_equal(found.values[1], found.values[2])
    assert not np.allclose(found.values[0], found.values[2])


def test_bad_input(physical, make_random, laws):
    for arguments, message in (
        ({"road": "Z"}, "no road class 'Z'"),
        ({"speed": 0}, r"speed \[m/s\] = 0; give a number above zero"),
        ({"alpha": [[0.5, 0.5, 0.5, 0]]}, "off the simplex"),
        ({"alpha": [0.5, 0.5]}, "alpha must be 4"),
    ):
        with pytest.raises(InputError, match=message):
            compare(physical, {"passive": None}, **arguments)
    with pytest.raises(InputError, match="none was given"):
        compare(physical, {})
    with pytest.raises(InputError, match="not described as a car"):
        compare(make_random(3, 2, 1, 2), {"passive": None})
    with pytest.raises(InputError, match="no law 'skyhok'; did you mean 'skyhook'"):
        standard_laws(physical, names=("skyhok",))
    with pytest.raises(InputError, match="2 x 5; quarter car, physical needs 1 x 5"):
        compare(physical, {"two": np.zeros((2, 5))})
