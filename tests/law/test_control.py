"""Plants and laws as systems of python-control: the loops that they close, and how they refuse."""

import sys
from fractions import Fraction

import control
import numpy as np
import pytest

from polefence import Disk, InputError, Parameter, PlantError, Scheduled, UncertainPlant, place
from polefence.base.errors import MissingExtraError, ParameterValueError
from polefence.law.control import from_control, to_control, valid_names
from polefence.plant.outputs import Output
from polefence.requirements.rms import Rms
from polefence.requirements.specification import rows
from polefence.response.linear import step
from support.polynomials import design as polynomial

HERE = {"m1": 300.0, "beta": 2.0}


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
    C, D = rows(plant, *Rms("y", density=1.0).outputs(plant))
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
        ([named(), control.tf([1], [1, 1])], "system 2 is a TransferFunction, not a StateSpace"),
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


@pytest.fixture(scope="module")
def design(physical):
    return place(physical, Disk(-40, 31), "scheduled")


def plant_at(design, law, alpha):
    plant = design.plant
    n, _ = plant.shape
    A, B = plant.at(alpha)
    E = np.tensordot(alpha, [v.E for v in plant.vertices], 1)
    both = np.hstack([B, E])
    return control.ss(
        A,
        both,
        np.eye(n),
        np.zeros((n, both.shape[1])),
        inputs=[*law.output_labels, "road"],
        outputs=law.input_labels[:n],
        name="car",
    )


def same_poles(found, expected):
    remaining = list(expected)
    for pole in found:
        nearest = min(remaining, key=lambda other: abs(other - pole))
        assert abs(nearest - pole) < 1e-4 * abs(pole)
        remaining.remove(nearest)
    assert not remaining


@pytest.mark.parametrize("given", ["parameters", "alpha"])
def test_the_loop_has_the_poles_of_the_design(design, given):
    alpha = design.plant.alpha(**HERE)
    law = design.to_control(given)
    scheduled = list(HERE) if given == "parameters" else [f"alpha{j + 1}" for j in range(4)]
    assert law.input_labels[5:] == scheduled
    loop = control.interconnect(
        [plant_at(design, law, alpha), law], inputs=["road", *scheduled], outputs=law.output_labels
    )
    here = list(HERE.values()) if given == "parameters" else list(alpha)
    linear = loop.linearize(np.zeros(5), [0, *here])
    same_poles(np.linalg.eigvals(linear.A), design.poles(alpha))
    # the law's input is x, not -x
    u = law.output(0, [], [*np.arange(1.0, 6.0), *here])
    assert np.allclose(u, design.law.gain(alpha) @ np.arange(1.0, 6.0), rtol=1e-12)
    # other values, other poles: the inputs do schedule
    other = design.plant.alpha(m1=250, beta=-9)
    away = [250, -9] if given == "parameters" else list(other)
    linear = loop.linearize(np.zeros(5), [0, *away])
    A, B = design.plant.at(alpha)
    same_poles(np.linalg.eigvals(linear.A), np.linalg.eigvals(A + B @ design.law.gain(other)))


def test_the_step_response_is_that_of_the_response_module(design):
    alpha = design.plant.alpha(**HERE)
    law = design.to_control()
    loop = control.interconnect(
        [plant_at(design, law, alpha), law],
        inputs=["road", *HERE],
        outputs=[*law.output_labels, *law.input_labels[:5]],
    )
    expected = step(design.plant, design, alpha, duration=0.4, step=0.005)
    time = expected.time
    given = np.vstack([np.ones_like(time), *(np.full_like(time, v) for v in HERE.values())])
    tight = {"method": "RK45", "rtol": 1e-8, "atol": 1e-11}
    found = control.input_output_response(loop, time, given, solve_ivp_kwargs=tight)
    names = [signal.name for signal in expected.signals]
    assert names[:5] == ["suspension deflection", *names[1:5]]
    values = expected.values[0]
    values = values if values.shape[0] == len(names) else values.T
    mine = np.vstack([found.outputs[1:], found.outputs[:1]])
    for k in range(6):
        assert np.abs(mine[k] - values[k]).max() < 1e-6 * np.abs(values[k]).max(), names[k]


def test_names_are_valid_and_apart(design):
    law = design.to_control(name="mine")
    assert law.name == "mine"
    assert law.nstates == 0
    assert law.input_labels == [
        "suspension_deflection",
        "tyre_deflection",
        "sprung_mass_velocity",
        "unsprung_mass_velocity",
        "integral_of_suspension_deflection",
        "m1",
        "beta",
    ]
    assert law.output_labels == ["actuator_force"]
    assert valid_names(["a.b [m]", "a b", "1st", "[m]", "é", "a_b_2"]) == [
        "a_b",
        "a_b_2",
        "signal_1st",
        "signal",
        "signal_2",
        "a_b_2_2",
    ]


def test_one_gain_and_plants_without_names():
    plant = UncertainPlant.from_vertices(
        [np.diag([0.9, 1.1])] * 2, [np.eye(2)] * 2, sample_time=Fraction(1, 8)
    )
    design = place(plant, Disk(0, 0.5), "quadratic")
    assert design.to_control().input_labels == ["x1", "x2"]
    assert np.array_equal(design.to_control().D, design.law.K)
    law = design.to_control("alpha")
    assert isinstance(law, control.StateSpace)
    assert law.input_labels == ["x1", "x2", "alpha1", "alpha2"]
    assert law.output_labels == ["u1", "u2"]
    assert law.dt == 0.125
    assert np.allclose(law.D @ [3, 4, 0.5, 0.5], design.law.K @ [3, 4])
    car = control.ss(
        plant.A[0], np.eye(2), np.eye(2), 0 * np.eye(2), 0.125,
        inputs=law.output_labels, outputs=law.input_labels[:2],
    )  # fmt: skip
    loop = control.interconnect([car, law], inputs=["alpha1", "alpha2"], outputs=["x1"])
    linear = loop.linearize(np.zeros(2), [0.5, 0.5])
    assert linear.dt == 0.125
    same_poles(np.linalg.eigvals(linear.A), design.poles(np.array([0.5, 0.5])))


def test_outside_the_family_is_clamped_or_refused(design):
    x = np.ones(5)
    near = design.law.gain(design.plant.alpha(clamp=True, m1=1e4, beta=-99)) @ x
    assert np.allclose(design.to_control().output(0, [], [*x, 1e4, -99]), near)
    with pytest.raises(ParameterValueError, match="m1"):
        design.to_control(clamp=False).output(0, [], [*x, 1e4, -99])
    off = [0.5, 0.6, 0, -0.05]
    assert np.allclose(
        design.to_control("alpha").output(0, [], [*x, *off]), design.law.gain(off, clamp=True) @ x
    )
    with pytest.raises(ParameterValueError, match="off the simplex"):
        design.to_control("alpha", clamp=False).output(0, [], [*x, *off])


def test_what_it_refuses(design, monkeypatch):
    with pytest.raises(InputError, match="use 'parameters' or 'alpha'"):
        design.to_control("load")
    plant = UncertainPlant.from_vertices([np.eye(1)], [np.eye(1)])
    with pytest.raises(InputError, match="use 'alpha'"):
        place(plant, Disk(-2, 1), Scheduled()).to_control("parameters")
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingExtraError, match=r"polefence\[control\]"):
        design.to_control()


@pytest.mark.parametrize("kind", ["measured", "varying", "many"])
@pytest.mark.parametrize("given", ["parameters", "alpha"])
def test_a_polynomial_law_of_signals_is_given_the_plants_outputs(kind, given):
    own = polynomial(kind)
    alpha, law = own.plant.alpha(**HERE), own.to_control(given)
    car = to_control(own.plant, alpha, outputs=True)
    r = len(own.law.measured)
    assert set(law.input_labels[:r]) <= set(car.output_labels)
    keys = law.input_labels[r:]
    loop = control.interconnect(
        [car, law], inputs=["road_velocity", *keys], outputs=car.output_labels
    )
    here = list(HERE.values()) if given == "parameters" else list(alpha)
    linear = loop.linearize(np.zeros(4), [0, *here])
    same_poles(np.linalg.eigvals(linear.A), own.poles(alpha))


def test_one_gain_of_signals_is_a_system_of_signals():
    own = polynomial("one gain")
    law = own.to_control()
    assert isinstance(law, control.StateSpace)
    assert np.array_equal(law.D, own.law.gains[0])
    assert law.input_labels == [
        "suspension_deflection",
        "sprung_mass_velocity",
        "unsprung_mass_velocity",
    ]


def test_disturbances_are_named_wherever_they_are():
    """The wind first, a control, then the road: a model as it was put together elsewhere."""
    A, B = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.arange(6.0).reshape(2, 3)
    C, D = np.array([[1.0, 2.0]]), np.array([[0.5, 0.25, 0.125]])
    labels = {"inputs": ["wind", "force", "road"], "outputs": ["y"], "states": ["p", "v"]}
    system = control.ss(A, B, C, D, **labels)
    for given in (("road", "wind"), ["road", "wind", "road"]):
        plant = from_control(system, disturbances=given)
        assert plant.inputs == ("force",)
        assert plant.disturbances == ("road", "wind")
        assert np.array_equal(plant.B[0], B[:, [1]])
        assert np.array_equal(plant.vertices[0].E, B[:, [2, 0]])
        (output,) = plant.outputs
        assert ((((Fraction(1, 4),),)), ((Fraction(1, 8), Fraction(1, 2)),)) == (output.D, output.F)
    one = from_control(system, disturbances="wind")
    assert (one.inputs, one.disturbances) == (("force", "road"), ("wind",))
    assert np.array_equal(from_control(system, disturbances=np.int64(1)).B[0], B[:, :2])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["wind", "force", "road"], "names every input"),
        (["winde"], "no input 'winde'; did you mean 'wind'"),
        (3, "disturbances = 3 of 3 inputs leaves no control input"),
        (-1, "leaves no control input"),
    ],
)
def test_disturbances_that_there_are_not(given, said):
    system = control.ss(-1, np.ones((1, 3)), 1, np.zeros((1, 3)), inputs=["wind", "force", "road"])
    with pytest.raises(PlantError, match=said):
        from_control(system, disturbances=given)
