"""A plant described as a quarter car; the laws that designs are compared with."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import Parameter, UncertainPlant
from polefence.base.errors import InputError, PlantError
from polefence.examples import family
from polefence.plant.outputs import Output, output_matrices
from polefence.plant.vehicle import Vehicle
from polefence.vehicle.reference_laws import Sizes, lqr, nominal, passive, skyhook
from polefence.vehicle.vehicle import SIGNALS, masses, quarter_car, require_ride, ride

CAR = {"m1": 300.0, "m2": 30.0, "k": 15000.0, "kt": 160000.0, "c": 1200.0}


def shuffled() -> UncertainPlant:
    """A user's car: states in another order and other spelling, none of the integral."""
    A, B, E = (np.array(M, dtype=float) for M in quarter_car(**CAR))
    order = [3, 0, 2, 1]
    return UncertainPlant.from_vertices(
        [A[np.ix_(order, order)]],
        [B[order]],
        [E[order]],
        states=(
            "Unsprung mass velocity [m/s]",
            "suspension deflection [m]",
            "Sprung-Mass Velocity [m/s]",
            "tire deflection [m]",
        ),
        name="mine",
        vehicle=Vehicle(
            tyre_deflection="tire deflection",
            sprung_velocity="Sprung-Mass Velocity",
            unsprung_velocity="Unsprung mass velocity",
            force="u1",
            road="w1",
        ),
    )


def test_signals_are_those_of_the_physics():
    plant = shuffled()
    found = ride(plant)
    assert [s.label for s in found.signals] == [
        "suspension deflection [m]",
        "tire deflection [m]",
        "sprung-mass acceleration [m/s2]",
        "unsprung-mass acceleration [m/s2]",
        "u1",
        "tyre force variation [N]",
    ]
    x = np.array([0.3, 0.02, -0.1, 0.004])  # unsprung, suspension, sprung, tyre
    K = np.array([[1.0, -2000.0, 30.0, 4.0]])
    C, D = output_matrices(plant, found.signals, np.ones(1), K)
    u = float((K @ x)[0])
    damper = CAR["c"] * (x[0] - x[2])
    up = CAR["k"] * x[1] + damper + u
    expected = [
        x[1],
        x[3],
        up / CAR["m1"],
        (CAR["kt"] * x[3] - up) / CAR["m2"],
        u,
        CAR["kt"] * x[3],
    ]
    assert C @ x == pytest.approx(expected, rel=1e-12)
    assert not D.any()


@pytest.mark.parametrize("name", ["quarter-car-physical", "quarter-car-as-printed"])
def test_families_that_ship_are_known(name):
    plant = family(name)
    found = ride(plant)
    assert found.tyre_force == Output("tyre force variation", "N", C=[0, 155900, 0, 0, 0])
    assert found.places == (0, 1, 2, 3)
    car = masses(plant, found, np.eye(4))
    assert car.m1 == pytest.approx([231.12, 231.12, 346.68, 346.68])
    assert car.m2 == pytest.approx(np.full(4, 28.58))
    low, high = (8000, 12000) if "physical" in name else (231.12, 346.68)
    assert car.k == pytest.approx([low, high, low, high])


def test_masses_are_those_that_made_the_matrices():
    plant = shuffled()
    car = masses(plant, ride(plant), np.ones(1))
    for name, value in CAR.items():
        assert float(getattr(car, name)) == pytest.approx(value, rel=1e-12)


def test_tyre_force_is_missing_where_kt_is_uncertain():
    kt = Parameter("kt", 100000, 200000, "N/m")
    plant = UncertainPlant.from_function(
        lambda kt: quarter_car(300, 30, 15000, kt, 1200), [kt], **SIGNALS
    )
    found = ride(plant)
    assert found.tyre_force is None
    assert len(found.signals) == 5


def test_nothing_is_recognised_by_its_names(physical, make_random):
    assert ride(replace(physical, vehicle=None)) is None
    with pytest.raises(
        InputError, match=r"not described as a quarter car; add a table \[vehicle\]"
    ):
        require_ride(make_random(1, 3, 1, 2))
    with pytest.raises(InputError, match=r"no signal 'tyre force variation': .* \[vehicle\]"):
        replace(physical, vehicle=None).signal("tyre force variation")


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        (Vehicle(force="pull"), "force: no input 'pull'; known: actuator force"),
        (Vehicle(road="wind"), "road: no disturbance 'wind'"),
        (Vehicle(sprung_velocity="roll"), "sprung_velocity: no state 'roll'"),
        (Vehicle(suspension_positive="extension"), r"vertex 1: A\[1\]\[3\] = -1, that"),
        (Vehicle(tyre_positive="extension"), r"vertex 1: A\[2\]\[4\] = -1, that"),
    ],
)
def test_a_description_that_does_not_fit_is_refused(physical, vehicle, message):
    with pytest.raises(PlantError, match=f"vehicle: {message}") as caught:
        replace(physical, vehicle=vehicle)
    assert "\n" not in str(caught.value)


def test_senses_are_words():
    with pytest.raises(PlantError, match="tyre_positive = 'up' is unknown"):
        Vehicle(tyre_positive="up")


def test_the_force_among_several_inputs_goes_by_its_name():
    A, B, E = (np.array(M, dtype=float) for M in quarter_car(**CAR))
    wide = np.hstack([np.eye(5)[:, [4]], B])
    changes = {"inputs": ("trim", "damper force [N]"), "vehicle": Vehicle(force="damper force")}
    plant = UncertainPlant.from_vertices([A], [wide], [E], **SIGNALS | changes)
    assert ride(plant).input == 1
    assert ride(plant).force.label == "damper force [N]"


def test_a_force_of_the_other_sign_is_refused():
    A, B, E = (np.array(M, dtype=float) for M in quarter_car(**CAR))
    with pytest.raises(PlantError, match="the force acts up on the sprung mass; change its sign"):
        UncertainPlant.from_vertices([A], [-B], [E], **SIGNALS)


@pytest.mark.parametrize(
    ("place", "factor", "message"),
    [
        ((3, 0), 1.02, "spring and damper push both masses alike"),
        ((3, 2), 1.02, "spring and damper push both masses alike"),
        ((2, 3), 1.02, "spring and damper push both masses alike"),
        ((3, 0), 1.009, None),  # digits rounded
        ((3, 3), 1.2, None),  # a tyre with damping
    ],
)
def test_forces_between_the_masses_are_equal_and_opposite(place, factor, message):
    A, B, E = (np.array(M, dtype=float) for M in quarter_car(**CAR))
    A[place] *= factor
    if message is None:
        assert ride(UncertainPlant.from_vertices([A], [B], [E], **SIGNALS)).signals
        return
    with pytest.raises(PlantError, match=message):
        UncertainPlant.from_vertices([A], [B], [E], **SIGNALS)


def test_the_tyre_does_not_push_the_sprung_mass():
    A, B, E = (np.array(M, dtype=float) for M in quarter_car(**CAR))
    A[2, 1] = 1.0
    with pytest.raises(PlantError, match=r"A\[3\]\[2\] = 1 must be 0"):
        UncertainPlant.from_vertices([A], [B], [E], **SIGNALS)


def test_passive_is_nothing(physical):
    assert not passive(physical).K.any()
    assert passive(physical).K.shape == (1, 5)


def test_skyhook_damps_the_sprung_mass(physical):
    alpha = nominal(physical)
    A, B = physical.at(alpha)
    law = skyhook(physical, 1500)
    extra = (B @ law.K)[2]
    assert extra == pytest.approx([0, 0, -1500 / 288.9, 0, 0])
    slow = np.sort_complex(np.linalg.eigvals(A)[np.abs(np.linalg.eigvals(A)) > 1e-9])[-2:]
    damped = np.linalg.eigvals(A + B @ law.K)
    body = damped[(np.abs(damped) > 1e-9) & (np.abs(damped) < 30)]
    assert np.max(body.real) < np.max(slow.real) - 1
    assert skyhook(physical).K[0, 2] == pytest.approx(-1.4 * math.sqrt(10000 * 288.9))


def quadratic_cost(plant, K, sizes):
    """Trace of the cost over unit impulses in the four states, by a Lyapunov equation."""
    A, B = plant.at(nominal(plant))
    A, B, K = A[:4, :4], B[:4], K[:, :4]
    closed = A + B @ K
    outputs = [
        closed[2] / sizes.acceleration,
        np.eye(4)[0] / sizes.travel,
        np.eye(4)[1] / sizes.tyre,
        K[0] / sizes.force,
    ]
    C = np.stack(outputs)
    return np.trace(solve_continuous_lyapunov(closed.T, -C.T @ C))


@pytest.mark.parametrize("sizes", [Sizes(), Sizes(0.5, 0.05, 0.01, 300.0)])
def test_no_gain_nearby_costs_less_than_the_regulator(physical, sizes):
    law = lqr(physical, sizes)
    least = quadratic_cost(physical, law.K, sizes)
    assert law.K[0, 4] == 0
    random = np.random.default_rng(0)
    for _ in range(20):
        other = law.K * (1 + 0.02 * random.normal(size=(1, 5)))
        assert quadratic_cost(physical, other, sizes) > least * (1 - 1e-9)
    assert quadratic_cost(physical, 1.1 * law.K, sizes) > least * (1 + 1e-6)
    assert quadratic_cost(physical, 0.9 * law.K, sizes) > least * (1 + 1e-6)


def test_a_regulator_of_the_integral_moves_its_pole(physical):
    law = lqr(physical, Sizes(integral=0.05))
    A, B = physical.at(nominal(physical))
    assert np.linalg.eigvals(A + B @ law.K).real.max() < -0.1
    with pytest.raises(InputError, match="no state that is the integral"):
        lqr(shuffled(), Sizes(integral=0.05))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda plant: Sizes(travel=0), "size of travel = 0"),
        (lambda plant: Sizes(force=math.inf), "size of force"),
        (lambda plant: skyhook(plant, -1), "skyhook damping = -1"),
    ],
)
def test_bad_values_are_refused(physical, call, message):
    with pytest.raises(InputError, match=message) as caught:
        call(physical)
    assert "\n" not in str(caught.value)
