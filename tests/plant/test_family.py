"""Uncertain plants: vertices, alpha, the exact multi-affinity test, controllability."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence import Parameter, PlantError, UncertainPlant
from polefence.base.errors import ParameterValueError
from polefence.examples import family
from polefence.vehicle.vehicle import quarter_car

M1 = Parameter("m1", "231.12", "346.68", "kg", through="1/m1")
BETA = Parameter("beta", -10, 10)


def physical_car(m1, beta):
    return quarter_car(m1, Fraction("28.58"), 10000 + 200 * beta, 155900, 850 + 17 * beta)


def test_spec_expressions_and_function_give_the_same_exact_vertices():
    from_function = UncertainPlant.from_function(physical_car, [M1, BETA])
    assert from_function.vertices == family("quarter-car-physical").vertices


@given(
    st.fractions(min_value=Fraction("231.12"), max_value=Fraction("346.68")),
    st.fractions(min_value=-10, max_value=10),
)
def test_the_vertices_span_the_family_exactly(m1, beta):
    """A(m1, beta) equals sum_j alpha_j A_j with alpha(m1, beta), in rationals."""
    from polefence.plant.parameters import simplex_weights

    plant = family("quarter-car-physical")
    alpha = simplex_weights(plant.parameters, {"m1": m1, "beta": beta})
    assert sum(alpha) == 1
    A, B, _ = physical_car(m1, beta)
    for i in range(5):
        for j in range(5):
            assert A[i][j] == sum(
                a * v.exact_A[i][j] for a, v in zip(alpha, plant.vertices, strict=True)
            )
        assert B[i][0] == sum(
            a * v.exact_B[i][0] for a, v in zip(alpha, plant.vertices, strict=True)
        )


def test_alpha_at_corners_is_a_unit_vector(physical):
    for j, values in enumerate([(231.12, -10), (231.12, 10), (346.68, -10), (346.68, 10)]):
        alpha = physical.alpha(m1=values[0], beta=values[1])
        assert np.allclose(alpha, np.eye(4)[j], atol=1e-15)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"m1": 200, "beta": 0}, "outside"),
        ({"m1": 300}, "missing: beta"),
        ({"m1": 300, "bta": 0, "beta": 0}, "did you mean 'beta'"),
        ({"m1": float("nan"), "beta": 0}, "finite"),
    ],
)
def test_alpha_refuses(physical, values, message):
    with pytest.raises((ParameterValueError, PlantError), match=message):
        physical.alpha(**values)


def test_alpha_clamps_only_when_asked(physical):
    assert np.allclose(physical.alpha(m1=200, beta=0, clamp=True), [0.5, 0.5, 0, 0])


def test_alpha_of_a_plant_given_by_vertices_says_so(make_random):
    with pytest.raises(ParameterValueError, match="has no parameters"):
        make_random(0, 2, 1, 2).alpha(m1=1)


@pytest.mark.parametrize(("entry", "value"), [("m1**2", 90_000), ("beta*beta", 16), ("m1", 300)])
def test_what_is_not_multiaffine_is_a_function(entry, value):
    plant = UncertainPlant.from_expressions([M1, BETA], [[0, 1], [entry, "beta"]], [[0], ["1/m1"]])
    A, _ = plant.at(plant.alpha(m1=300, beta=-4))
    assert A[1, 0] == pytest.approx(value)
    assert [tree.text for tree in plant.functions.trees] == [entry]


def test_a_product_of_two_scheduling_variables_is_accepted():
    plant = UncertainPlant.from_expressions([M1, BETA], [[0, 1], ["beta/m1", 0]], [[0], ["1/m1"]])
    assert plant.vertices[0].exact_A[1][0] == Fraction(-10) / Fraction("231.12")


@pytest.mark.parametrize(
    ("As", "Bs", "message"),
    [
        ([[[0, 1], [2]]], [[[0], [1]]], "ragged: row 2"),
        ([[[float("nan")]]], [[[1]]], r"A\[1\]\[1\] = nan must be a finite"),
        ([[[float("inf")]]], [[[1]]], "finite"),
        ([[[0, 1]]], [[[1]]], "must be square"),
        ([[[0]]], [[[1], [1]]], "B has 2 rows"),
        ([[[0]]], [[[0]]], "B is zero"),
        ([[[0]], [[0, 1], [0, 0]]], [[[1]], [[0], [1]]], "must agree"),
        ([], [], "at least one vertex"),
        ([[[0]]], [], "1 matrices A, 0 B"),
        ([[]], [[]], "empty"),
        ([[["a"]]], [[[1]]], "not a number"),
        ([3], [[[1]]], "list of rows"),
    ],
)
def test_bad_vertices_are_named(As, Bs, message):
    with pytest.raises(PlantError, match=message):
        UncertainPlant.from_vertices(As, Bs)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda m1: ([[m1 if m1 > 3 else 0]], [[1]]), "failed on symbolic"),
        (lambda m1: [[m1]], "returns 1 matrices"),
        (lambda m1: 3, "failed on symbolic"),
        (lambda m1: ([[np.arctan(m1)]], [[1]]), "failed on symbolic"),
        (lambda m1: ([[math.sin(m1)]], [[1]]), "failed on symbolic|only"),
    ],
)
def test_functions_that_cannot_be_decided_are_refused(function, message):
    with pytest.raises(PlantError, match=message):
        UncertainPlant.from_function(function, [Parameter("m1", 1, 2)])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("m", 2, 1), "reversed"),
        (("m", 1, 1), "empty"),
        (("m", -1, 1, "kg", "1/m"), "touches zero"),
        (("m", 0, 1, "kg", "1/m"), "touches zero"),
        (("m", 0, float("nan")), "finite"),
        (("m", 0, 1, "kg", "m**2"), "through = 'm\\*\\*2' is unknown"),
        (("1m", 0, 1), "not a usable name"),
        (("lambda", 0, 1), "not a usable name"),
        (("clamp", 0, 1), "not a usable name"),
        (("µ", 0, 1), "not a usable name"),
        (("m", "1e350", "2e350"), "out of range"),
        (("m", "1e-350", 1), "out of range"),
    ],
)
def test_bad_parameters_are_refused(arguments, message):
    with pytest.raises(PlantError, match=message):
        Parameter(*arguments)


def test_arrays_of_a_plant_are_read_only(physical):
    with pytest.raises(ValueError, match="read-only"):
        physical.vertices[0].A[0, 0] = 1.0
