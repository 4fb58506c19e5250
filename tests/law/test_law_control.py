"""Laws as systems of python-control: the loops that they close, and how they refuse."""

from __future__ import annotations

import sys
from fractions import Fraction

import control
import numpy as np
import pytest

from polefence import Disk, InputError, Scheduled, UncertainPlant, place
from polefence.base.errors import MissingExtraError, ParameterValueError
from polefence.plant.control import valid_names
from polefence.response.linear import step

HERE = {"m1": 300.0, "beta": 2.0}


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
        [plant_at(design, law, alpha), law],
        inputs=["road", *scheduled],
        outputs=law.output_labels,
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
