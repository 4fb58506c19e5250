"""python-control plants, there and back."""

from __future__ import annotations

import control
import numpy as np
import pytest

from polefence import Disk, Parameter, PlantError, UncertainPlant, place
from polefence.base.errors import ParameterValueError
from polefence.design.requirements.rms import Rms
from polefence.design.requirements.specification import rows
from polefence.plant.control import from_control, to_control
from polefence.plant.outputs import Output


def test_round_trip_keeps_matrices_and_names(physical):
    corners = np.eye(len(physical.vertices))
    systems = [to_control(physical, alpha) for alpha in corners]
    back = from_control(systems, disturbances=1)
    assert np.array_equal(back.A, physical.A)
    assert np.array_equal(back.B, physical.B)
    assert np.array_equal(back.vertices[0].E, physical.vertices[0].E)
    assert back.name == "quarter_car_physical"
    assert back.states[0] == "suspension_deflection"
    assert len(back.inputs) == len(back.disturbances) == 1
    bare = from_control([to_control(vertex) for vertex in physical.vertices], disturbances=1)
    assert np.array_equal(bare.A, physical.A)


def named(A=-1.0, dt=0, **names):
    return control.ss([[A]], [[1.0, 2.0]], [[3.0]], [[0.5, 0.0]], dt, **names)


def test_one_system_is_a_plant():
    names = {"states": ["h [m]"], "inputs": ["u [N]", "w"], "outputs": ["y [V]"], "name": "tank"}
    plant = from_control(named(**names), disturbances=1)
    assert (plant.name, plant.states, plant.inputs) == ("tank", ("h [m]",), ("u [N]",))
    assert plant.disturbances == ("w",)
    assert len(plant.vertices) == 1
    assert place(plant, Disk(-4, 2), "quadratic").proved
    plain = from_control(named())
    # numbered by python-control, not named: "[0]" would be read as a unit
    assert (plain.name, plain.states, plain.inputs) == ("plant", (), ())
    assert from_control(named(), name="mine").name == "mine"


def test_outputs_are_signals_that_specifications_take():
    names = {"states": ["h"], "inputs": ["u", "w"], "outputs": ["y [V]"]}
    plant = from_control(named(**names), disturbances=1)
    (output,) = plant.outputs
    assert output == Output("y", "V", C=[3], D=[0.5])
    C, D = rows(plant, Rms("y", density=1.0).output(plant))
    assert (C, D) == ([[[3]]], [[[0.5]]])
    assert from_control(named()).outputs[0].name == "output 0"


def test_outputs_come_and_go_with_rows_of_their_own_at_each_vertex():
    gains = ([[3.0]], [[4.0]])
    systems = [control.ss([[-1.0]], [[1.0, 2.0]], C, [[0.5, 0.25]], outputs=["y"]) for C in gains]
    plant = from_control(systems, disturbances=1)
    assert plant.outputs == (Output("y", C=[[3], [4]], D=[0.5], F=[0.25]),)
    assert to_control(plant, [0.25, 0.75]).output_labels == ["x1"]
    back = to_control(plant, [0.25, 0.75], outputs=True)
    assert back.output_labels == ["x1", "y"]
    assert np.array_equal(back.C, [[1.0], [3.75]])
    assert np.array_equal(back.D, [[0.0, 0.0], [0.5, 0.25]])
    assert np.array_equal(to_control(from_control(back, disturbances=1), outputs=True).C, back.C)


def test_an_output_that_is_a_state_is_that_state():
    twin = control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]], states=["h"], outputs=["h"])
    assert from_control(twin).outputs == ()
    other = control.ss([[-1.0]], [[1.0]], [[2.0]], [[0.0]], states=["h"], outputs=["h"])
    with pytest.raises(PlantError, match="output 'h' has the name of a state or an input"):
        from_control(other)


def test_discrete_time_comes_and_goes():
    plant = from_control([named(0.5, 0.125), named(0.6, 0.125)])
    assert float(plant.sample_time) == 0.125
    assert to_control(plant, [0.25, 0.75]).dt == 0.125
    assert np.allclose(to_control(plant, [0.25, 0.75]).A, 0.575)
    assert place(plant, Disk(0, 0.5), "quadratic").proved


@pytest.mark.parametrize(
    ("systems", "message"),
    [
        ([], "at least one vertex"),
        ([named(), control.tf([1], [1, 1])], "system 2 is a TransferFunction, no StateSpace"),
        ([named(0.5, True)], "without a sample time"),
        ([named(), named(0.5, 0.1)], "they must agree"),
        ([control.ss([], [], [], [[2.0]])], "no states"),
        ([named(states=["a"]), named(states=["b"])], "names other signals"),
    ],
)
def test_what_is_no_plant_is_refused(systems, message):
    with pytest.raises(PlantError, match=message):
        from_control(systems)


def test_no_input_left_is_refused():
    system = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(PlantError, match="no control input"):
        from_control([system], disturbances=1)


def test_a_family_needs_a_point():
    plant = UncertainPlant.from_expressions([Parameter("k", 1, 2)], [["-k"]], [[1]])
    with pytest.raises(ParameterValueError, match="give alpha"):
        to_control(plant)
    for alpha in ([1], [0.5, 0.6], [-1, 2], [[1, 0]]):
        with pytest.raises(ParameterValueError, match="sum to one"):
            to_control(plant, alpha)


@pytest.mark.parametrize("given", ["", "parameters"])
def test_plant_and_law_connect_by_name(given):
    plant = UncertainPlant.from_expressions(
        [Parameter("k", 1, 2)], [[0, 1], ["-k", "-1"]], [[0], [1]], [[0], [1]]
    )
    law = place(plant, Disk(-3, 2.9), "quadratic").to_control(given)
    assert isinstance(law, control.StateSpace)
    assert law.nstates == 0
    assert law.input_labels == ["x1", "x2", *(["k"] if given else [])]
    own = to_control(plant, plant.alpha(k=1.5))
    loop = control.interconnect([own, law], inputs=["w1", *law.input_labels[2:]], outputs=["x1"])
    A, B = plant.at(plant.alpha(k=1.5))
    expected = np.sort_complex(np.linalg.eigvals(A + B @ law.D[:, :2]))
    assert np.allclose(np.sort_complex(loop.poles()), expected)
