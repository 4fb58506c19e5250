"""Closed loops as systems of python-control: poles and responses are those of our own."""

import numpy as np
import pytest

from polefence import (
    Disk,
    InputError,
    Structure,
    UncertainPlant,
    closed_loops,
    load,
    parse_region,
    place,
)
from polefence.base.errors import ParameterValueError
from polefence.examples import family, spec_path
from polefence.response.linear import step

control = pytest.importorskip("control")
# Weights of parameters: elsewhere a scheduled law is another on the box than on the simplex.
ALPHA = np.einsum("ki,kj->kij", *np.random.default_rng(3).dirichlet([1, 1], (2, 5))).reshape(5, 4)


def channel(own, output: str, given: str):
    """From one input to one output; names as indices came with python-control 0.10.2."""
    return own[own.output_labels.index(output), own.input_labels.index(given)]


@pytest.fixture(scope="module")
def car():
    return family("quarter-car-physical")


@pytest.fixture(scope="module")
def design(car):
    return place(car, Disk(-40, 31), "scheduled")


def test_poles_are_those_of_the_design(car, design):
    for own, poles in zip(closed_loops(car, design, ALPHA), design.poles(ALPHA), strict=True):
        np.testing.assert_allclose(
            np.sort_complex(control.poles(own)), np.sort_complex(poles), rtol=1e-8
        )
    assert len(closed_loops(car, design)) == 4
    (one,) = closed_loops(car, design, ALPHA[0])
    np.testing.assert_allclose(one.A, closed_loops(car, design, ALPHA)[0].A)


def test_steps_are_those_of_the_family(car, design):
    names = ("sprung-mass acceleration", "tyre force variation", "actuator force")
    signals = [car.signal(name) for name in names]
    ours = step(car, design, ALPHA, signals, duration=1.0, step=1e-3)
    named = ("sprung_mass_acceleration", "tyre_force_variation", "actuator_force_of_law")
    for k, own in enumerate(closed_loops(car, design, ALPHA)):
        for i, name in enumerate(named):
            found = control.step_response(channel(own, name, "road_velocity"), ours.time)
            size = np.abs(ours.values[k, :, i]).max()
            np.testing.assert_allclose(
                found.outputs.ravel(), ours.values[k, :, i], atol=1e-6 * size
            )


def test_what_is_added_to_the_demand_reaches_the_input_at_once(car, design):
    own = closed_loops(car, design)[2]
    K = design.law.gain(np.eye(4)[2])
    v = channel(own, "actuator_force_of_law", "actuator_force")
    np.testing.assert_array_equal(v.D, [[1]])
    np.testing.assert_allclose(v.C, K)
    w = channel(own, "actuator_force_of_law", "road_velocity")
    np.testing.assert_array_equal(w.D, [[0]])


def test_without_a_law_and_with_matrices(car, design):
    corner = closed_loops(car)[1]
    np.testing.assert_array_equal(corner.A, car.A[1])
    K = design.law.gain(np.eye(4)[1])
    np.testing.assert_allclose(closed_loops(car, K)[1].A, car.A[1] + car.B[1] @ K)


@pytest.mark.usefixtures("hasty")
def test_a_law_of_measured_signals_with_states_of_its_own():
    plant = load(spec_path("two-masses"))
    structure = Structure(measured=["position 2"], schedule=(), order=2)
    design = place(plant, parse_region("half_plane(0.05) & disk(-20, 20)"), structure=structure)
    for own in closed_loops(design.plant, design):
        assert own.nstates == 6
        assert control.poles(own).real.max() < -0.05


def test_discrete_time_and_two_inputs_with_one_name():
    plant = UncertainPlant.from_vertices(
        [[[0.5, 0.1], [0, 0.7]], [[0.5, 0.2], [0, 0.7]]],
        [np.eye(2)] * 2,
        inputs=("force [N]", "force [kN]"),
        sample_time="1/10",
    )
    own = closed_loops(plant, [[-0.1, 0], [0, -0.2]])[1]
    assert own.dt == 0.1
    assert own.input_labels == ["force", "force_2"]
    assert own.output_labels == ["x1", "x2", "force_of_law", "force_2_of_law"]
    np.testing.assert_allclose(own.A, [[0.4, 0.2], [0, 0.5]])


def test_what_does_not_fit_is_refused(car):
    with pytest.raises(InputError):
        closed_loops(car, [[1, 2]])
    with pytest.raises(ParameterValueError, match="weights"):
        closed_loops(car, None, [[0.5, 0.6, 0, 0]])
