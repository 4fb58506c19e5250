"""Small files that once cost minutes or gigabytes, and values of another type than ours."""

from __future__ import annotations

import json
import tracemalloc
from fractions import Fraction

import pytest

from polefence import InputError, Parameter, PlantError, SpecError, UncertainPlant
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.plant.expression import decimal
from polefence.plant.parameters import MAX_NAME, exact
from polefence.plant.spec import loads
from polefence.proof.reading import MAX_DEPTH, MAX_PIECES, parse
from polefence.proof.work import FormatError
from polefence.vehicle.roads import MOST_UNASKED, measured_road

FAR = [
    "1e000000000999999999",
    "1e-0000000000999999999",
    "1e999999999",
    "1E+٠٠٠٠٠٠٠٠٠٩٩٩٩٩٩٩",
    "1e4_0_1",
]


@pytest.mark.parametrize("number", FAR)
def test_no_writing_of_a_huge_exponent_is_computed(number):
    with pytest.raises(SpecError, match="out of range"):
        decimal(number)
    with pytest.raises(PlantError, match="out of range"):
        exact(number, "A")
    with pytest.raises(PlantError, match="out of range"):
        UncertainPlant.from_vertices([[[-1]]], [[[1]]], [[[number]]])
    assert decimal("1e0000000000000400") == 10**400
    assert decimal("25e-0001") == Fraction(5, 2)


def test_a_huge_exponent_of_a_spec(tmp_path, capsys):
    path = tmp_path / "spec.toml"
    path.write_text(f"[[vertex]]\nA = [[{FAR[0]}]]\nB = [[1]]\n")
    assert main(["limits", str(path), "--centre", "-1"]) == 2
    assert "out of range" in capsys.readouterr().err


def test_a_huge_exponent_of_a_disturbance(small_designs, tmp_path, capsys):
    document = json.loads(small_designs["quadratic"].certificate.dumps())
    for vertex in document["plant"]["vertices"]:
        vertex["E"] = [["1e999999999"], [1]]
    path = tmp_path / "design.json"
    path.write_text(json.dumps(document))
    spec = tmp_path / "spec.toml"
    spec.write_text("[[vertex]]\nA = [[1]]\nB = [[1]]\n")
    assert main(["check", str(path), "--spec", str(spec)]) == 2
    assert "not a finite number" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "[" + "[]," * MAX_PIECES + "[]]",
        "[" + '{"":0},' * (MAX_PIECES // 2) + "0]",
        "{" + ",".join(f'"{i:x}":0' for i in range(MAX_PIECES)) + "}",
    ],
)
def test_many_pieces_are_refused_before_they_are_read(text):
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match="lists, tables and keys"):
            parse(text)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_depth_is_bounded_on_both_sides():
    def nested(depth):
        return "[" * depth + "]" * depth

    assert parse(nested(MAX_DEPTH - 1)) is not None
    for depth in (MAX_DEPTH + 1, 900, 100_000):
        with pytest.raises(FormatError, match="nested more|not valid"):
            parse(nested(depth))
    assert parse("3") == 3
    with pytest.raises(FormatError, match="given twice"):
        parse('{"a": 1, "a": 2}')


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 100_000) + " = 1",
        "x = {" + " . ".join("a" * 100_000) + " = 1}",
        ".".join(['"a b"'] * 50_000) + " = 1",
        ".".join(["a", "'b c'"] * 50_000) + " = 1",
        "".join(f"[{'.'.join('a' * 200)}.b{i}]\n" for i in range(2000)),
    ],
)
def test_keys_of_many_parts_are_refused_before_they_are_read(text):
    with pytest.raises(SpecError, match="more than 16 parts"):
        loads(text)


def test_specs_with_dots_are_read():
    for name in ("quarter-car-physical", "quarter-car-as-printed"):
        assert loads(spec_text(name)).vertices
    numbers = ", ".join(["0.1"] * 40)
    rows = ", ".join([f"[{numbers}]"] * 40)
    text = f"[[vertex]]\nA = [{rows}]\nB = [{', '.join(['[1.5]'] * 40)}]\n"
    assert loads('name = "a. b. c... e.g. v1.2"\n' + text).shape == (40, 1)


LONG = "x" * (MAX_NAME + 1)
VERTEX = "[[vertex]]\nA = [[1]]\nB = [[1]]\n"


@pytest.mark.parametrize("key", ["name", "states", "inputs", "disturbances"])
def test_names_are_text_of_some_length(key):
    def plant(label):
        return UncertainPlant.from_vertices(
            [[[-1]]], [[[1]]], [[[1]]], **{key: label if key == "name" else (label,)}
        )

    assert plant(LONG[1:])
    with pytest.raises(PlantError, match="at most 200"):
        plant(LONG)
    for other in (3, None, ["x"], {}):
        with pytest.raises(PlantError, match="must be text"):
            plant(other)


def test_parameters_have_names_of_some_length():
    with pytest.raises(PlantError, match="no? usable name|not a usable name"):
        Parameter(LONG, 0, 1)
    for key in ("unit", "through"):
        with pytest.raises(PlantError, match="at most 200|must be text"):
            Parameter("p", 0, 1, **{key: LONG})
        with pytest.raises(PlantError, match="must be text"):
            Parameter("p", 0, 1, **{key: None})


@pytest.mark.parametrize(
    "text",
    [
        f'name = "{"x" * 200_000}"\n{VERTEX}',
        f'region = "{"x" * 200_000}"\n{VERTEX}',
        f"{VERTEX}[{'k' * 200_000}]\n",
        f'[[vertex]]\nA = [["{"x" * 200_000}"]]\nB = [[1]]\n',
        f'[constants]\nc = 0x{"f" * 5000}\n[matrices]\nA = [["c"]]\nB = [[1]]\n',
        f"[[vertex]]\nA = [[{{x = 0x{'f' * 5000}}}]]\nB = [[1]]\n",
    ],
)
def test_what_is_refused_is_not_quoted_at_length(text, tmp_path, capsys):
    path = tmp_path / "spec.toml"
    path.write_text(text)
    assert main(["design", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert len(error) < 1500


def test_two_points_far_apart_are_no_long_drive(tmp_path):
    path = tmp_path / "far.csv"
    path.write_text(f"0,0\n{MOST_UNASKED * 0.02:.17g},1\n")
    road = measured_road(path)
    time, w = road.velocity(20, 1e-3)
    assert len(time) == len(w) == MOST_UNASKED
    with pytest.raises(InputError, match="give a duration"):
        road.velocity(20.001, 0.9999e-3 / 1.1)
    assert len(road.velocity(20, 0.5e-3, 2.0)[0]) == 4000


def test_rows_of_a_profile_are_refused_as_before(tmp_path):
    path = tmp_path / "bad.csv"
    for text, message in (
        ("0,0\n1,\n", "row 2: no height"),
        ("0,0\n,1\n", "row 2: no distance"),
        ("0,0\n1,2,3\n", "row 2: 3 cells"),
        ("0,0\n\n1,2\n", "row 2: empty"),
        ("0,0\n1,nan\n", "row 2: height nan is not a finite number"),
        (f"0,0\n1,{'x' * 10**5}\n", "row 2: height 'xxx"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message) as found:
            measured_road(path)
        assert len(str(found.value)) < 400
