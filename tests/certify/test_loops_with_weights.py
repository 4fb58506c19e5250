"""Loops with weights and references: mixed sensitivity, and poles that no law moves."""

from fractions import Fraction

import control
import numpy as np
import pytest

from polefence import (
    Compensator,
    Disk,
    Gain,
    HalfPlane,
    InputError,
    Structure,
    UncontrollableError,
    UnobservableError,
    analyse,
    optimise,
    place,
    with_reference,
    with_weight,
)
from polefence.plant.spec import loads

# Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, example 2.17: the least norm of
# [W_P S; K S] is 1.37.
PROCESS = """
[matrices]
A = [[-0.1, 20, 0], [0, -20, 20], [0, 0, -20]]
B = [[0], [0], [20]]
[reference.r]
signal = "x1"
[[weight]]
signal = "error of x1"
transfer = "(s/1.5 + 10)/(s + 0.001)"
"""
LEAST = 1.37
# What `optimise` finds with order = 4; it is of order 3.
FOUND = Compensator(
    [
        [-6.170603365222, 13.235239501968, 7.479643206123],
        [7.455238288817, -16.032993969942, -9.126618901552],
        [-29.368852452282, 31.394047323780, -36.433539729038],
    ],
    [[-0.198428904358], [0.242477131848], [-0.385317944696]],
    [[57.454907560732, -39.224062810563, 0.532885694860]],
    [[1.176645987750]],
    ["error of x1"],
)
STAGE = """
[parameter.m]
range = [0.8, 1.2]
through = "1/m"
[matrices]
A = [[0, 1], [0, "-0.5/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
"""


def test_mixed_sensitivity_has_the_norm_of_the_book():
    plant = loads(PROCESS)
    found = analyse(plant, FOUND, HalfPlane(0), limits=[Gain(["weighted error of x1", "u1"])])
    assert found.proved
    level = found.bounds[0].bound.level
    G = control.tf([200], np.polymul([10, 1], np.polymul([0.05, 1], [0.05, 1])))
    s = 1j * np.logspace(-5, 4, 20_000)
    K = control.ss(FOUND.A, FOUND.B, FOUND.C, FOUND.D)(s)
    S, W = 1 / (1 + G(s) * K), (s / 1.5 + 10) / (s + 0.001)
    truth = np.sqrt(abs(W * S) ** 2 + abs(K * S) ** 2).max()
    assert 0.9999 * truth <= level <= 1.001 * truth
    assert level == pytest.approx(LEAST, rel=0.005)


def test_a_weight_in_z_has_the_gain_of_the_loop_in_z():
    text = "sample_time = 0.1\n[[vertex]]\nA = [[0.9, 0.1], [0, 0.8]]\nB = [[0], [0.1]]\n"
    plant = with_reference(loads(text), "r", "x1")
    plant = with_weight(plant, "error of x1", "(0.5*z - 0.3)/(z - 0.95)")
    law = Compensator(D=[[1]], measured=["error of x1"])
    found = analyse(plant, law, Disk(0, 1), limits=[Gain("weighted error of x1")])
    assert found.proved
    z = np.exp(1j * np.linspace(0, np.pi, 20_000))
    S, W = 1 / (1 + 0.01 / ((z - 0.9) * (z - 0.8))), (0.5 * z - 0.3) / (z - 0.95)
    truth = abs(W * S).max()
    assert 0.9999 * truth <= found.bounds[0].bound.level <= 1.001 * truth


def test_a_gain_of_the_other_states_leaves_weights_alone():
    plant = with_weight(with_weight(loads(STAGE), "w1", "1/(s + 3)"), "x1", "2/(s + 4)")
    K = [[-2, -3]]
    short = analyse(plant, K, HalfPlane(0), limits=[Gain("weighted x1")])
    named = analyse(
        plant, Compensator(D=K, measured=["x1", "x2"]), HalfPlane(0), limits=[Gain("weighted x1")]
    )
    assert short.proved
    assert named.proved
    levels = [one.bounds[0].bound.level for one in (short, named)]
    assert levels[0] == pytest.approx(levels[1], rel=1e-3)
    # at rest the largest: 1/3 of the disturbance, over 2, times 2/4
    assert 1 / 12 <= levels[0] <= 1.001 / 12
    assert np.allclose(short.law.gain([0.5, 0.5]), [[-2, -3, 0, 0]])


def test_a_pole_of_a_weight_is_named_where_a_law_leaves_it():
    plant = with_weight(loads(STAGE), "x1", "2/(s + 4)")
    assert analyse(plant, [[-100, -16]], HalfPlane(3.9)).proved
    refuted = analyse(plant, [[-100, -16]], HalfPlane(4.1))
    assert refuted.kept == "refuted"
    assert "the pole -4 of the weight of 'x1' is not in half_plane(4.1)" in refuted.reason


def test_a_region_without_a_weights_pole_is_refused_in_a_line():
    structure = Structure(measured=["x1", "x2"], schedule=[])
    behind, before = (with_weight(loads(STAGE), name, "1/(s + 0.5)") for name in ("x1", "w1"))
    with pytest.raises(UnobservableError) as caught:
        place(behind, HalfPlane(0.6), structure=structure)
    assert "the weight of 'x1' has the pole -0.5, not in half_plane(0.6), and a law that" in str(
        caught.value
    )
    assert "or measure 'weight state 1 of x1'" in str(caught.value)
    with pytest.raises(UncontrollableError) as refused:
        place(before, HalfPlane(0.6), structure=structure)
    assert "the weight of 'w1' has the pole -0.5, not in half_plane(0.6), and no gain" in str(
        refused.value
    )


def test_a_law_of_all_states_is_of_all_but_weights():
    plant = with_weight(with_reference(loads(STAGE), "r", "x1"), "x1", "1/(s + 2)")
    found = optimise(plant, None, [Gain("weighted x1", at_most=1.0, disturbances={"w1": 1})])
    gain = found.law.gain([0.5, 0.5])
    assert gain.shape == (1, 3)
    assert gain[0, :2].any()
    assert not gain[0, 2]


def test_a_law_may_integrate_by_a_weight():
    plant = with_weight(with_reference(loads(STAGE), "r", "x1"), "error of x1", "1/s")
    names = ["error of x1", "x2"]
    with pytest.raises(UnobservableError, match="of 'error of x1' has the pole 0, not stable"):
        place(plant, HalfPlane(0), structure=Structure(measured=names, schedule=[]))
    law = Compensator(D=[[3, -3, 1]], measured=[*names, "weight state 1 of error of x1"])
    found = analyse(plant, law, HalfPlane(0.1), limits=[Gain("error of x1")])
    assert found.proved
    closed = plant.A[0] + plant.B[0] @ found.law.gain([1, 0])
    E = plant.vertices[0].E + plant.vertices[0].B @ [[0, 3]]
    at_rest = -np.linalg.solve(closed, E)  # of x1, x2 and the integral, for a load and a command
    assert np.allclose(at_rest[0], [0, 1])


@pytest.mark.parametrize(
    "weight",
    [
        {"numerator": ["2/3", 1], "denominator": [1, "1/1000"]},
        {"zeros": ["-3/2"], "poles": ["-1/1000"], "gain": "2/3"},
        "(2*s/3 + 1)/(s + 1/1000)",
    ],
    ids=["coefficients", "roots", "text"],
)
def test_numbers_of_a_weight_may_be_texts(weight):
    made = with_weight(loads(STAGE), "x1", weight)
    assert made.vertices[0].exact_A[2][2] == Fraction(-1, 1000)
    s = 1j * np.array([1e-4, 1e-2, 1, 100])
    A, B = made.vertices[0].A[2, 2], made.vertices[0].A[2, 0]
    row = np.array(made.signal("weighted x1").C, dtype=float).ravel()
    answer = row[0] + row[2] * B / (s - A)
    assert np.allclose(answer, (2 * s / 3 + 1) / (s + 1e-3), rtol=1e-9)


def test_a_text_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="numerator = 's' is not a number; write 0.5"):
        with_weight(loads(STAGE), "x1", {"numerator": ["s"], "denominator": [1, 1]})
