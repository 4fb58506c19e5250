"""Outputs y = C x + D u + F w: read, written, refused; exactly what they say."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import InputError, Parameter, PlantError, UncertainPlant
from polefence.examples import family, spec_text
from polefence.plant.outputs import (
    Output,
    choose,
    output_matrices,
    rate_of,
    rates_in,
    stacked,
    weighted_sum,
)
from polefence.plant.spec import dumps, loads
from polefence.plant.vehicle import Vehicle

SPEC = """
states = ["x [m]", "v [m/s]"]
inputs = ["pull [N]"]
disturbances = ["push [N]"]
[constants]
d = 0.4
[parameter.m]
range = [2, 4]
through = "1/m"
[parameter.k]
range = [1, 3]
[definitions]
stiff = "k/m"
[matrices]
A = [[0, 1], ["-stiff", "-d/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
[outputs]
"acceleration [m/s2]" = {C = ["-stiff", "-d/m"], D = ["1/m"], F = ["1/m"]}
"spring force [N]" = {C = ["k", 0]}
"gauge" = {C = ["1/3", 0.1], D = [2]}
"""


@pytest.fixture(scope="module")
def plant():
    return loads(SPEC)


def test_outputs_are_exact_at_every_vertex(plant):
    acceleration, spring, gauge = plant.outputs
    assert (spring.name, spring.unit, spring.label) == ("spring force", "N", "spring force [N]")
    assert spring.C == ((1, 0), (3, 0), (1, 0), (3, 0))
    assert gauge == Output("gauge", C=["1/3", "0.1"], D=[2])
    C, D, F = acceleration.exact(plant)
    for vertex, c, d, f in zip(plant.vertices, C, D, F, strict=True):
        assert (c, d, f) == (vertex.exact_A[1], vertex.exact_B[1], vertex.exact_E[1])
    assert rates_in(plant, acceleration) == pytest.approx([0, 1], abs=1e-12)
    share = weighted_sum("share", "", [(Fraction(1, 4), acceleration)])
    assert rates_in(plant, share) == pytest.approx([0, 0.25], abs=1e-12)
    assert rates_in(plant, spring) is None
    force = Output("force", C=acceleration.C, D=acceleration.D)  # not that of a gust
    assert rates_in(plant, force) is None
    assert rate_of(plant, "v", "acceleration") == acceleration


def test_outputs_may_be_sums_of_signals():
    more = """"both [m/s2]" = {sum = {"acceleration" = 0.5, "spring force" = "-1/3"}}
"of both" = {sum = {"both" = 2, "v" = 1}}
"""
    plant = loads(SPEC + more)
    acceleration, spring, _, both, of_both = plant.outputs
    terms = [(Fraction(1, 2), acceleration), (Fraction(-1, 3), spring)]
    assert both == weighted_sum("both", "m/s2", terms)
    assert of_both == weighted_sum("of both", "", [(2, both), (1, plant.signal("v"))])
    assert loads(dumps(plant)).outputs == plant.outputs


@pytest.mark.parametrize("point", [(2.0, 1.0), (3.0, 1.7), (3.7, 2.9)])
def test_between_the_vertices_they_are_those_of_the_parameters(plant, point):
    m, k = point
    alpha, K = plant.alpha(m=m, k=k), np.array([[-1.5, 0.5]])
    C, F = output_matrices(plant, plant.outputs, alpha, K)
    expected = [
        np.array([-k / m, -0.4 / m]) + K[0] / m,
        np.array([k, 0]),
        np.array([1 / 3, 0.1]) + 2 * K[0],
    ]
    assert pytest.approx(np.array(expected), rel=1e-12) == C
    assert pytest.approx(np.array([[1 / m], [0], [0]]), rel=1e-12) == F


def test_states_and_inputs_are_outputs_of_themselves(plant):
    assert [s.label for s in plant.signals] == [
        "x [m]", "v [m/s]", "pull [N]", "acceleration [m/s2]", "spring force [N]", "gauge",
    ]  # fmt: skip
    assert plant.signal("v") == Output("v", "m/s", C=[0, 1])
    assert plant.signal("pull") == Output("pull", "N", D=[1])
    assert choose(plant, ["gauge", "x"]) == (plant.outputs[2], plant.signal("x"))
    assert [s.name for s in choose(plant)] == ["x", "v", "pull"]
    with pytest.raises(InputError, match="no signal 'gage'; did you mean 'gauge'"):
        plant.signal("gage")


def test_a_design_file_keeps_outputs_and_vehicle(plant, tmp_path):
    from polefence import Design, HalfPlane, place

    for own in (plant, family("quarter-car-physical")):
        place(own, HalfPlane(0.1)).save(tmp_path / "d")
        back = Design.load(tmp_path / "d").plant
        assert back.signals == own.signals
        assert back.vehicle == own.vehicle


def test_functions_give_outputs_too():
    def function(m, k):
        A, B = [[0, 1], [-k / m, 0]], [[0], [1 / m]]
        return A, B, None, {"force [N]": {"C": [k, 0], "D": [1]}}

    made = UncertainPlant.from_function(function, [Parameter("m", 2, 4, through="1/m"),
                                                   Parameter("k", 1, 3)])  # fmt: skip
    assert made.outputs == (Output("force", "N", C=[[1, 0], [3, 0], [1, 0], [3, 0]], D=[1]),)


def test_a_parameter_of_an_output_alone_is_used():
    text = SPEC.replace('"gauge" = {C = ["1/3", 0.1]', '"gauge" = {C = ["s", 0.1]')
    made = loads(text.replace("[definitions]", "[parameter.s]\nrange = [1, 2]\n[definitions]"))
    assert len(made.vertices) == 8
    assert {row[0] for row in made.outputs[2].C} == {1, 2}


def test_sums_are_exact(plant):
    a, b = plant.outputs[:2]
    total = weighted_sum("sum", "", [("1/3", a), (-2, b)])
    (C,), (Ca,), (Cb,) = ([o.exact(plant)[0]] for o in (total, a, b))
    for own, first, second in zip(C, Ca, Cb, strict=True):
        assert own == tuple(Fraction(1, 3) * x - 2 * y for x, y in zip(first, second, strict=True))
    assert tuple((d[0] / 3,) for d in a.D) == total.D
    shapes = [M.shape for M in stacked(plant, (a, b, total))]
    assert shapes == [(4, 3, 2), (4, 3, 1), (4, 3, 1)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('{C = ["k", 0]}', '{C = ["k/(m - m)", 0]}', r"force .N..C\[1\]\[1\]: an expression div"),
        ('{C = ["k", 0]}', '{C = ["q", 0]}', "unknown name 'q'"),
        ('{C = ["k", 0]}', '{C = ["k"]}', "'spring force': C has 1 columns; the plant has 2"),
        ('{C = ["k", 0]}', "{D = [1, 2]}", "'spring force': D has 2 columns; the plant has 1"),
        ('{C = ["k", 0]}', "{C = [0, 0]}", "output 'spring force' is zero"),
        ('{C = ["k", 0]}', "{}", "is empty; give a row C, D or F"),
        ('{C = ["k", 0]}', '{G = ["k", 0]}', "unknown key 'G'"),
        ('{C = ["k", 0]}', "{C = [[1, 0], [2, 0]]}", "has 2 rows; an output is one row"),
        ('{C = ["k", 0]}', "{C = 3}", "must be a list of rows"),
        ('{C = ["k", 0]}', "3", "must be a table"),
        ('"gauge"', '"spring force [kN]"', "two outputs have one name"),
        ('{C = ["1/3", 0.1], D = [2]}', "{sum = {vv = 1}}", "outputs.'gauge': no signal 'vv'"),
        ('{C = ["1/3", 0.1], D = [2]}', "{sum = 1}", "outputs.'gauge': write {sum = {"),
        ('{C = ["1/3", 0.1], D = [2]}', "{sum = {}}", "outputs.'gauge': write {sum = {"),
        ('{C = ["1/3", 0.1], D = [2]}', "{sum = {v = 1}, D = [2]}", "and nothing beside it"),
        ('{C = ["1/3", 0.1], D = [2]}', '{sum = {v = "k"}}', "outputs.'gauge': "),
        ('{C = ["1/3", 0.1], D = [2]}', "{sum = {v = inf}}", "must be a finite number"),
        ('"gauge"', '"x"', "output 'x' is the name of a state or input"),
        ("[outputs]", "[outputs]\nx = 1\n[others]", "unknown key 'others'"),
    ],
)
def test_outputs_that_cannot_be_used_are_refused(old, new, message):
    with pytest.raises(InputError, match=message) as caught:
        loads(SPEC.replace(old, new))
    assert "\n" not in str(caught.value)


def test_rows_differ_by_vertex_or_are_one(plant):
    bare = replace(plant, parameters=(), outputs=())
    assert replace(bare, outputs=(Output("y", C=[1, 2]),)).outputs[0].C == ((1, 2),)
    with pytest.raises(InputError, match="C has 2 rows; give one, or 4: one per vertex"):
        replace(bare, outputs=(Output("y", C=[[1, 2], [2, 3]]),))
    with pytest.raises(PlantError, match="must be a row of numbers"):
        Output("y", C="12")
    with pytest.raises(PlantError, match=r"C\[1\]\[2\] = nan must be a finite number"):
        Output("y", C=[1, float("nan")])


def test_outputs_of_a_vehicle_are_its_own():
    car = family("quarter-car-ride")
    names = ["sprung-mass acceleration", "unsprung-mass acceleration", "tyre force variation"]
    assert [o.name for o in car.every_output] == names
    assert car.outputs == ()
    same = replace(car, outputs=(car.every_output[0],))
    assert same == car
    with pytest.raises(PlantError, match="differs from that of the vehicle"):
        replace(car, outputs=(Output("sprung-mass acceleration", C=[1, 0, 0, 0]),))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("", "vehicle: model is missing"),
        ('model = "half car"', "vehicle.model = 'half car' is unknown; use 'quarter car'"),
        ('model = "quarter car"\nforces = "u"', "vehicle: unknown key 'forces'"),
        ('model = "quarter car"\nforce = 1', "vehicle.force must be a string"),
        ('model = "quarter car"\nroad = "track"', "road: no disturbance 'track'"),
    ],
)
def test_a_vehicle_that_cannot_be_read_is_refused(table, message):
    text = spec_text("quarter-car-ride").replace('model = "quarter car"', table)
    with pytest.raises(InputError, match=message):
        loads(text)
    assert loads(spec_text("quarter-car-ride")).vehicle == Vehicle()
