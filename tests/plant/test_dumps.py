"""Specs that are written: what is read from them is the plant, with its parameters."""

import itertools
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence import Parameter, UncertainPlant
from polefence.base.errors import InputError
from polefence.examples import SPECS, family, spec_text
from polefence.plant import spec
from polefence.plant.outputs import Output
from polefence.plant.spec import dumps, load, loads
from polefence.plant.system import System
from support.specs import TWO_STATES

HARDWARE = """
[actuator.force]
bandwidth = 30
[sensor.x]
bandwidth = 100
noise = 0.01
"""
TRACKS = "height = 0.5\nroll_inertia"
P, Q, R = Parameter("p", 1, 3), Parameter("q", 2, "2.5", "kg", "1/q"), Parameter("r_", -2, -1)


def of_corners(parameters, *values):
    """Return x' = a x + u with these values of a at the vertices."""
    vertices = (System([[a]], [[1]], name=f"vertex {j + 1}") for j, a in enumerate(values))
    return UncertainPlant(tuple(vertices), tuple(parameters))


def under_tracks():
    text = re.sub(r"under = \[[^]]*\]", "[road.tracks]", spec_text("full-car"), count=1)
    return loads(text.replace("roll_inertia", TRACKS, 1))


PLANTS = {name: lambda name=name: family(name) for name in SPECS}
PLANTS |= {
    "hardware": lambda: loads(TWO_STATES + HARDWARE),
    "tracks": under_tracks,
    "discrete": lambda: replace(loads(TWO_STATES), sample_time=Fraction(1, 300)),
    "floats": lambda: of_corners([P, Q], *np.random.default_rng(0).normal(size=4)),
}


@pytest.mark.parametrize("name", PLANTS)
def test_a_plant_is_read_as_it_was_written(name):
    plant = PLANTS[name]()
    text = dumps(plant)
    assert loads(text) == plant
    assert loads(text).digest == plant.digest
    assert ("[[vertex]]" in text) == (not plant.parameters)


def test_what_is_written_is_a_file_that_loads(tmp_path):
    path = tmp_path / "car.toml"
    path.write_text(dumps(family("full-car")), encoding="utf-8")
    assert load(path) == family("full-car")


def test_expressions_are_those_that_people_write():
    text = dumps(loads(TWO_STATES))
    assert 'A = [[0, 1], ["-k/m", "-0.2/m"]]' in text
    assert 'B = [[0], ["1/m"]]' in text
    assert '[parameter.m]\nrange = [0.8, 1.25]\nthrough = "1/m"\n' in text
    text = dumps(family("quarter-car-physical"))
    assert '["10000/m1 + 200*beta/m1", 0, "-850/m1 - 17*beta/m1", ' in text


def test_numbers_are_written_as_short_as_they_are():
    values = [Fraction(x) for x in ("0.25", "1/3", "-7", "1e-30", "0.1", str(2**70))]
    values.append(Fraction(0.1))
    entries = [spec._entry(x) for x in values]
    assert entries[:5] == ["0.25", '"1/3"', "-7", "1e-30", "0.1"]
    assert entries[5:] == [f'"{2**70}"', '"3602879701896397/36028797018963968"']


@st.composite
def plants(draw):
    """Draw a plant of a box of parameters, of each of which an entry of A is a function."""
    numbers = st.one_of(
        st.just(Fraction(0)),
        st.integers(-5, 5).map(Fraction),
        st.decimals(-9, 9, allow_nan=False, places=3).map(Fraction),
        st.fractions(-20, 20, max_denominator=50),
        st.floats(-3, 3, allow_subnormal=False)
        .filter(lambda x: not 0 < abs(x) < 1e-9)
        .map(Fraction),
    )
    count, n, m, q = (draw(st.integers(*bounds)) for bounds in ((0, 3), (1, 3), (1, 2), (0, 2)))
    parameters = []
    for k in range(count):
        ends = draw(st.lists(st.decimals(1, 50, places=2), min_size=2, max_size=2, unique=True))
        low, high = sorted(map(Fraction, ends))
        unit, through = draw(st.sampled_from(["", "kg", 'in "', "\\\n\u2028"])), f"p{k}"
        if draw(st.booleans()):
            through = f"1/p{k}"
        elif draw(st.booleans()):
            low, high = -high, -low
        label = draw(st.sampled_from(["", "sprung mass", 'a "b"\\ ']))
        parameters.append(Parameter(f"p{k}", low, high, unit, through, label))
    N = 2**count

    def matrix(rows, columns):
        return [[draw(numbers) for _ in range(columns)] for _ in range(rows)]

    vertices = []
    for j, first in enumerate(draw(st.lists(numbers, min_size=N, max_size=N, unique=True))):
        A, B = matrix(n, n), matrix(n, m)
        A[0][0], B[0][0] = first, B[0][0] or Fraction(1)
        vertices.append(System(A, B, matrix(n, q) if q else None, f"vertex {j + 1}"))
    outputs = []
    for name, unit in (("y", "m"), ('of "a" [b]', ""), ("of.c [d]", "m/s")):
        rows = draw(st.sampled_from([0, 1, N]))
        if rows:
            C, D = matrix(rows, n), matrix(rows, m)
            C[0][0] = C[0][0] or Fraction(1, 7)
            outputs.append(Output(name, unit, C, D, matrix(rows, q) if q else ()))
    return UncertainPlant(
        tuple(vertices),
        tuple(parameters),
        draw(st.text(st.characters(codec="utf-8"), max_size=9)),
        tuple(f'x{i} "\\\t' for i in range(n)),
        outputs=tuple(outputs),
        sample_time=draw(st.sampled_from([None, Fraction(1, 3), Fraction("0.01"), Fraction(2)])),
        noise=("w2",) if q == 2 else (),
    )


@given(plants())
def test_any_plant_is_read_as_it_was_written(plant):
    text = dumps(plant)
    assert loads(text) == plant
    assert ("[[vertex]]" in text) == (not plant.parameters)


def test_so_many_parameters_as_there_may_be():
    own = [Parameter(f"p{k}", 1, 2) for k in range(8)]
    plant = of_corners(own, *(sum(corner) for corner in itertools.product((1, 2), repeat=8)))
    assert '"p7 + p6 + p5 + p4 + p3 + p2 + p1 + p0"' in dumps(plant)
    assert loads(dumps(plant)) == plant


CHANGES = {
    "an end": ("range = [0.8, 1.25]", "range = [0.8, 1.3]"),
    "through": ('through = "1/m"\n', ""),
    "a sign": ("-k/m", "k/m"),
    "a coefficient": ("0.2/m", "0.3/m"),
    "the order": ('[parameter.m]\nrange = [0.8, 1.25]\nthrough = "1/m"\n\n', ""),
    "a name": ('"v [m/s]"', '"w [m/s]"'),
}


@pytest.mark.parametrize("key", CHANGES)
def test_each_thing_that_is_written_tells(key):
    """Were it written otherwise, another plant would be read, or none."""
    plant, (old, new) = loads(TWO_STATES), CHANGES[key]
    text = dumps(plant)
    assert text.count(old) == 1
    text = text.replace(old, new)
    if key == "the order":
        text += old
    try:
        assert loads(text) != plant
    except InputError:
        assert key == "through"  # k/m is then no more affine


ROUGH = [Fraction(10**40 + k, 10**40 + 3 * k) for k in range(1, 9)]
LONG = [Fraction(2**980 + 3 * k, 2**980 + 2 * k + 1) for k in range(16)]
# What no spec says of a box of parameters, and beside it what one does, in the same manner.
CANNOT = {
    "an end that is no decimal": ([Parameter("p", Fraction(1, 3), 1)], [1, 2]),
    "a parameter that changes nothing": ([P, Q], [1, 1, 2, 2]),
    "a long expression": ([P, Q, R], ROUGH),
    "a number that Python does not write": ([P, Q, R, Parameter("s", 1, 2)], LONG),
}
CAN = {
    "an end that is no decimal": ([Parameter("p", "0.333", 1)], [1, 2]),
    "a parameter that changes nothing": ([P, Q], [1, 1, 2, 3]),
    "a long expression": ([P, Q, R], [0] * 7 + ROUGH[:1]),
    "a number that Python does not write": ([P], LONG[:2]),
}


@pytest.mark.parametrize("key", CANNOT)
def test_what_cannot_be_said_of_parameters_is_said_of_vertices(key):
    plant = of_corners(CANNOT[key][0], *CANNOT[key][1])
    assert loads(dumps(plant)) == replace(plant, parameters=())
    plant = of_corners(CAN[key][0], *CAN[key][1])
    assert loads(dumps(plant)) == plant


def test_a_text_that_no_file_may_hold_is_said_of_vertices(monkeypatch):
    plant = loads(TWO_STATES)
    size = len(dumps(plant).encode())
    monkeypatch.setattr(spec, "MAX_BYTES", size)
    assert loads(dumps(plant)) == plant
    monkeypatch.setattr(spec, "MAX_BYTES", size - 1)
    assert loads(dumps(plant)) == replace(plant, parameters=())
