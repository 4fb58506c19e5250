"""Structures of laws: what is measured and free, dynamic laws and PIDs, and what is refused."""

import math

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polefence import InputError, SpecError, Structure, UncertainPlant, load_structure, with_sensor
from polefence.examples import family, spec_text
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from support.specs import TWO_STATES

MEASURED = ("suspension deflection", "sprung-mass velocity")


@pytest.fixture(scope="module")
def car() -> UncertainPlant:
    return family("quarter-car-ride")


def test_a_plain_structure_is_its_own(car):
    own = Structure(MEASURED, degree=2)
    assert own.extended(car) == (car, own)
    assert own.largest(car).tolist() == [[math.inf, math.inf]]


@given(st.integers(0, 30), st.integers(1, 4), st.integers(0, 2))
@settings(max_examples=20, deadline=None)
def test_a_law_with_states_closes_as_in_python_control(seed, order, degree):
    """Its gain, read as A_c, B_c, C_c, D_c at a point, gives the poles of the interconnection."""
    random, own = np.random.default_rng(seed), Structure(MEASURED, degree=degree, order=order)
    car = family("quarter-car-ride")
    larger, static = own.extended(car)
    terms, r = len(static.powers(larger)), 2 + order
    law = static.law(larger, random.normal(size=(terms, 1 + order, r)))
    alpha = np.kron(*(np.array([1 - t, t]) for t in random.uniform(size=2)))
    K = np.tensordot(law.terms(alpha), law.gains, 1)
    A, B = car.at(alpha)
    C = np.eye(4)[[0, 2]]
    Dc, Cc, Bc, Ac = K[:1, :2], K[:1, 2:], K[1:, :2], K[1:, 2:]
    loop = control.feedback(
        control.ss(A, B, C, np.zeros((2, 1))), control.ss(Ac, Bc, Cc, Dc), sign=1
    )
    large_A, large_B = larger.at(alpha)
    found = np.poly(np.linalg.eigvals(large_A + large_B @ law.gain(alpha)))
    assert np.allclose(found, np.poly(loop.poles()), rtol=1e-7, atol=1e-6 * np.abs(found).max())


def test_pattern_and_largest_gain_are_of_the_direct_part(car):
    own = Structure(MEASURED, pattern=[["k", 0]], largest_gain=50, order=2)
    larger, static = own.extended(car)
    free = static.free(larger)
    assert free.shape == (3, 4)
    assert free[0, 1] == -1
    others = free[free >= 0]
    assert sorted(others.tolist()) == list(range(11))
    most = static.largest(larger)
    assert most[0, :2].tolist() == [50, 50]
    assert np.isinf(most[1:]).all()
    assert np.isinf(most[0, 2:]).all()
    assert static.measured == (*MEASURED, "law state 1", "law state 2")
    strictly = Structure(MEASURED, pattern=[[0, 0]], order=1).extended(car)
    assert (strictly[1].free(strictly[0])[0] == [-1, -1, 0]).all()


def test_entries_of_one_name_are_one_number(car):
    own = Structure(MEASURED, pattern=[["k", "k"]], order=1)
    larger, static = own.extended(car)
    assert static.free(larger).tolist() == [[0, 0, 1], [2, 3, 4]]


def test_all_states_are_measured_by_default_also_the_laws_own(car):
    larger, static = Structure(order=2, schedule=()).extended(car)
    assert static.measured is None
    assert static.free(larger).shape == (3, 6)
    assert static.powers(larger) == ((0, 0),)


@given(st.floats(-5, -0.5), st.floats(-5, -0.5), st.floats(-0.2, 0.2))
@settings(max_examples=20, deadline=None)
def test_a_pid_closes_as_its_transfer_function(p, i, d):
    plant = loads(TWO_STATES)
    own = Structure(("x",), schedule=(), kind="pid", derivative_bandwidth=2)
    larger, static = own.extended(plant)
    law, alpha = static.law(larger, np.array([[[p, i, d]]])), np.full(4, 0.25)
    A, B = plant.at(alpha)
    w = 2 * math.pi * 2
    law_tf = control.tf([p + d * w, p * w + i, i * w], [1, w, 0])
    loop = control.feedback(control.ss2tf(A, B, [[1, 0]], 0), law_tf, sign=1)
    large_A, large_B = larger.at(alpha)
    found = np.poly(np.linalg.eigvals(large_A + large_B @ law.gain(alpha)))
    wanted = loop.den[0][0]
    assert np.allclose(found, wanted / wanted[0], rtol=1e-6, atol=1e-6)


def test_a_spec_says_it(tmp_path):
    path = tmp_path / "car.toml"
    law = (
        '[law]\nmeasured = ["suspension deflection", "sprung-mass velocity"]\nschedule = ["m1"]\n'
        'degree = 2\norder = 1\nlargest_gain = 1.5e5\npattern = [["k", 0]]\n'
    )
    path.write_text(spec_text("quarter-car-ride") + law)
    assert load_structure(path) == Structure(MEASURED, ("m1",), 2, 150000.0, (("k", "0"),), 1)
    path.write_text('[law]\nkind = "pid"\nderivative_bandwidth = 12.5\nschedule = []\n')
    assert load_structure(path) == Structure(schedule=(), kind="pid", derivative_bandwidth=12.5)
    path.write_text('name = "no law"\n')
    assert load_structure(path) is None


WRONG = {
    "law = 3": "law must be a table",
    "[law]\nmesured = []": "unknown key mesured = a list; did you mean 'measured'?",
    "[law]\nmeasured = []": "measured is empty",
    '[law]\nmeasured = "x"': "measured = 'x' must be a list of names",
    "[law]\nmeasured = [1]": "measured must be names",
    '[law]\nmeasured = ["x", "x"]': "measured: 'x' is given twice",
    "[law]\norder = -1": "order = -1 must be 0 to 20",
    "[law]\norder = 1.5": "order = 1.5 must be a whole number",
    "[law]\norder = true": "order = true must be a whole number",
    "[law]\ndegree = 9": "degree = 9 must be 0 to 8",
    "[law]\ndegree = 1.5": "degree = 1.5 must be a whole number",
    "[law]\nlargest_gain = 0": "largest_gain = 0 must be a positive number",
    '[law]\nlargest_gain = "big"': "largest_gain = 'big' must be a positive number",
    "[law]\nlargest_gain = [[1, -1]]": "largest_gain = a list must be a positive number, or rows",
    "[law]\npattern = 3": "pattern must be rows of names and zeros",
    '[law]\npattern = ["k"]': "pattern must be rows of names and zeros",
    "[law]\npattern = [[1]]": "pattern must be rows of names and zeros",
    '[law]\nkind = "pdi"': "kind = 'pdi' is unknown; use 'pid'",
    '[law]\nkind = "pid"': "kind = 'pid' needs derivative_bandwidth",
    "[law]\nderivative_bandwidth = 3": "derivative_bandwidth belongs to kind = 'pid'",
    '[law]\nkind = "pid"\nderivative_bandwidth = -3': "derivative_bandwidth = -3 must be",
    '[law]\nkind = "pid"\nderivative_bandwidth = 3\norder = 1': "a PID has a fixed order",
}


@pytest.mark.parametrize(("text", "said"), WRONG.items())
def test_a_spec_that_says_what_cannot_be(text, said, tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(text)
    with pytest.raises(SpecError) as caught:
        load_structure(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


UNFIT = {
    "unknown": (Structure(("speed",)), "measured: no signal 'speed'"),
    "of cars": (Structure(("sprung-mass acceleration",)), "measured: no signal 'sprung-mass acc"),
    "input": (Structure(("force",)), "an input passes straight into 'force'; give its sensor or"),
    "output with D": (Structure(("rate of v",)), "an input passes straight into 'rate of v'"),
    "output with F": (Structure(("w",)), "measured: only disturbances; measure a signal of"),
    "dynamic all the same": (Structure(("rate of v",), order=1), "passes straight into"),
    "twice": (Structure(("x", "x [m]")), "measured: 'x' is given twice"),
    "schedule": (Structure(schedule=("n",)), "schedule: no parameter 'n'; known: 'k'"),
    "pattern": (Structure(("x",), pattern=[["a", "b"]]), "pattern must have 1 row of 1 entry"),
    "gains": (Structure(largest_gain=[[1], [2]]), "largest_gain must have 1 row of 2 entries"),
    "pattern of a PID": (
        Structure(("x",), kind="pid", derivative_bandwidth=1, pattern=[["a"]]),
        "pattern must have 1 row of 3 entries",
    ),
    "pattern of order 1": (
        Structure(("x",), order=1, pattern=[["a", "b"]]),
        "pattern must have 1 row of 1 entry",
    ),
    "nothing free": (Structure(("x",), pattern=[[0]]), "pattern: every entry is 0"),
    "too many": (Structure(order=15, degree=2), "free numbers; at most 500 are tuned"),
}  # fmt: skip


@pytest.mark.parametrize(("own", "said"), UNFIT.values(), ids=UNFIT)
def test_what_does_not_fit_the_plant_is_said(own, said):
    text = TWO_STATES + '[outputs]\n"rate of v [m/s2]" = {C = ["-k/m", 0], D = ["1/m"]}\n'
    plant = loads(text + '"w" = {F = [1]}\n')
    with pytest.raises(InputError) as caught:
        own.require_fit(plant)
    assert said.replace("known: 'k'", "known: k, m") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_sensor_makes_an_acceleration_measurable(car):
    own = Structure(("measured sprung-mass acceleration",))
    own.require_fit(with_sensor(car, "sprung-mass acceleration", 100))
    (signal,) = own.outputs(with_sensor(car, "sprung-mass acceleration", 100))
    assert signal == Output("measured sprung-mass acceleration", "m/s2", C=[0, 0, 0, 0, 1])
