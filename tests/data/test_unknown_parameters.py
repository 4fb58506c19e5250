"""Unknown parameters of a spec: values that are known come back, and ranges hold them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import polefence as pf
from polefence.cli.main import main
from polefence.data import FrequencyResponse, Response, refined_ranges
from support.measurements import exactly, gains

SPEC = """name = "cart"
states = ["x [m]", "v [m/s]"]
inputs = ["u [N]"]
disturbances = ["w [N]"]
region = "half_plane(1)"

[parameter.m]
range = [1, 3]
unit = "kg"
through = "1/m"

[parameter.k]
unit = "N/m"
range = [1, 20]        # not known

[parameter.c]
range = [0.1, 4]

[matrices]
A = [[0, 1], ["-k/m", "-c/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]

[outputs]
"a [m/s2]" = {C = ["-k/m", "-c/m"], D = ["1/m"], F = ["1/m"]}

[[specification]]
kind = "rms"
signal = "x"
minimise = true
density = 1
"""
BAND = np.geomspace(0.3, 20, 60)
VALUES = {1.0: (8.0, 1.0), 1.7: (8.5, 1.2), 2.6: (7.5, 0.9)}  # of each mass: k and c
ASKED = {"unknown": ["k", "c"], "inputs": ["w"], "outputs": ["x", "a"]}


def matrices(m, k, c):
    A, B = np.array([[0, 1], [-k / m, -c / m]]), np.array([[0], [1 / m]])
    return A, B, np.array([[1, 0], [-k / m, -c / m]]), np.array([[0], [1 / m]])


def response(m, k, c, noise=0.0, source=None):
    A, B, C, D = matrices(m, k, c)
    G = gains(A, B, C, BAND, D)
    if noise:
        G = G * (1 + noise * source.standard_normal(G.shape))
    named = {"input_names": ["w"], "output_names": ["x", "a"]}
    return FrequencyResponse(BAND, G, {"m": m}, name=f"m = {m:g}", **named)


def three(noise=0.0, source=None):
    return [response(m, *own, noise, source) for m, own in VALUES.items()]


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "cart.toml"
    path.write_text(SPEC)
    return path


def ranges(plant):
    return {p.name: (float(p.low), float(p.high)) for p in plant.parameters}


def test_values_come_back_and_ranges_are_their_intervals(spec):
    found = refined_ranges(spec, three(), **ASKED)
    for values, (k, c) in zip(found.values, VALUES.values(), strict=True):
        assert values["k"] == pytest.approx(k, rel=1e-6)
        assert values["c"] == pytest.approx(c, rel=1e-6)
    own = ranges(found.plant)
    assert own["m"] == (1, 3)
    assert own["k"] == pytest.approx((7.5, 8.5), rel=1e-5)
    assert own["c"] == pytest.approx((0.9, 1.2), rel=1e-5)
    for values in found.values:
        assert all(own[name][0] <= value <= own[name][1] for name, value in values.items())
    assert found.data.all.largest < 1e-5


@settings(max_examples=15)
@given(k=st.floats(1.5, 19), c=st.floats(0.2, 3.8), m=st.floats(1, 3))
def test_any_value_comes_back(k, c, m, tmp_path_factory):
    path = tmp_path_factory.mktemp("grey") / "cart.toml"
    path.write_text(SPEC)
    found = refined_ranges(path, [response(m, k, c)], margin=0.01, **ASKED)
    assert found.values[0]["k"] == pytest.approx(k, rel=1e-6)
    assert found.values[0]["c"] == pytest.approx(c, rel=1e-6)


def test_the_margin_moves_each_end(spec):
    own = ranges(refined_ranges(spec, three(), margin=0.1, **ASKED).plant)
    assert own["k"] == pytest.approx((7.5 * 0.9, 8.5 * 1.1), rel=1e-5)
    assert own["c"] == pytest.approx((0.9 * 0.9, 1.2 * 1.1), rel=1e-5)
    wide = ranges(refined_ranges(spec, three(), margin=0.95, **ASKED).plant)
    assert wide["k"] == pytest.approx((1, 8.5 * 1.95), rel=1e-5)  # no wider than it was sought in


def test_all_else_of_the_spec_stays_as_it_is(spec):
    text = refined_ranges(spec, three(), **ASKED).text
    head, data = text.split("\n[data]\n")
    assert data
    pattern = re.compile(r"range = \[[^\]]*\]")
    assert pattern.sub("#", head).strip() == pattern.sub("#", SPEC).strip()
    assert "# not known" in head
    assert "range = [1, 3]" in head


def test_responses_in_time_tell_them_too(spec):
    source, responses = np.random.default_rng(2), []
    for m, own in VALUES.items():
        A, B, C, D = matrices(m, *own)
        time, w = np.arange(500) * 0.05, source.standard_normal((1, 500))
        y = exactly(A, B, C, time, w, [0.5, 0]) + D @ w + np.array([[3.0], [-1.0]])
        named = {"input_names": ["w"], "output_names": ["x", "a"], "name": f"m = {m:g}"}
        responses.append(Response(time, w, y, {"m": m}, **named))
    found = refined_ranges(spec, responses, **ASKED)
    for values, (k, c) in zip(found.values, VALUES.values(), strict=True):
        assert values["k"] == pytest.approx(k, rel=1e-5)
        assert values["c"] == pytest.approx(c, rel=1e-5)


def test_a_measurement_left_out_is_missed_by_the_ranges_of_the_others(spec):
    """Without the least and the greatest value the ranges are too narrow."""
    found = refined_ranges(spec, three(), **ASKED)
    assert found.data.left_out.rms > 1e-3
    shares = []
    for k, (m, (own_k, own_c)) in enumerate(VALUES.items()):
        others = [values for j, values in enumerate(VALUES.values()) if j != k]
        box = [(min(v), max(v)) for v in zip(*others, strict=True)]
        grid = [np.linspace(*ends, 41) for ends in box]
        best = None
        G = response(m, own_k, own_c).values
        w = 1 / np.maximum(np.abs(G), 0.01 * np.abs(G).max(axis=2, keepdims=True))
        for a in grid[0]:
            for b in grid[1]:
                A, B, C, D = matrices(m, a, b)
                H = gains(A, B, C, BAND, D)
                cost = np.linalg.norm((G - H) * w)
                if best is None or cost < best[0]:
                    best = cost, H
        H = best[1]
        size = np.maximum(np.abs(H), 0.01 * np.abs(H).max(axis=2, keepdims=True))
        shares.append(np.abs(G - H) / size)
    assert found.data.left_out.rms == pytest.approx(np.sqrt(np.mean(np.square(shares))), rel=0.05)
    assert found.data.left_out.largest == pytest.approx(np.max(shares), rel=0.05)


CSV = "frequency [rad/s],real part of x from w,imaginary part of x from w\n"
FILE = """spec = "cart.toml"
unknown = ["k", "c"]
margin = 0.02
inputs = ["w"]
outputs = ["x"]
"""


def test_the_command_takes_a_spec(spec, monkeypatch, capsys):
    folder = spec.parent
    monkeypatch.chdir(folder)
    text = FILE
    for own in three(0.01, np.random.default_rng(3)):
        m, G = own.at["m"], own.values[0, 0]
        rows = zip(BAND, G.real, G.imag, strict=True)
        body = "\n".join(",".join(f"{x:.12g}" for x in row) for row in rows)
        (folder / f"{m:g}.csv").write_text(CSV + body + "\n")
        text += f'[[measurement]]\nfile = "{m:g}.csv"\nat = {{m = {m:g}}}\n'
    (folder / "m.toml").write_text(text)
    assert main(["identify", "m.toml", "-o", "family.toml"]) == 0
    assert (
        main(["optimise", "family.toml", "--limit", "rms of u <= 3 with density 1", "-o", "made"])
        == 0
    )
    said = capsys.readouterr().out
    note = pf.load("family.toml").data.note
    assert said.splitlines().count(note) == 2
    assert main(["check", "made", "--spec", "family.toml"]) == 0
    assert note in capsys.readouterr().out.splitlines()


FAULTS = {
    "no unknown": ({"unknown": []}, "unknown must name 1 to 6"),
    "another": ({"unknown": ["k", "d"]}, "no parameter 'd'"),
    "not unknown": ({"unknown": ["k"]}, "at has no value of c, which is not unknown"),
    "known": ({"unknown": ["k", "c", "m"]}, "at.m is no known parameter"),
    "input": ({"inputs": ["f"]}, "from 'f'"),
    "output": ({"outputs": ["y"]}, "'y'"),
    "margin": ({"margin": -0.1}, "margin = -0.1 must be a share"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_does_not_fit_the_spec_is_one_line(name, spec):
    change, said = FAULTS[name]
    with pytest.raises(pf.InputError) as refused:
        refined_ranges(spec, three(), **(ASKED | change))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_value_at_the_end_of_its_range_is_not_found(spec):
    responses = [response(1.0, 25.0, 1.0)]
    with pytest.raises(pf.InputError, match="k = 20 is at the end of its range"):
        refined_ranges(spec, responses, margin=0.1, **ASKED)


def test_one_measurement_needs_a_margin(spec):
    refined_ranges(spec, three()[:1], margin=0.01, **ASKED)
    with pytest.raises(pf.InputError, match="one measurement is one value"):
        refined_ranges(spec, three()[:1], **ASKED)


def test_what_measurements_do_not_tell_apart_is_refused(spec):
    text = SPEC.replace('"-c/m"', '"-c/m - d/m"').replace(
        "[matrices]", "[parameter.d]\nrange = [0.1, 1]\n[matrices]"
    )
    spec.write_text(text)
    with pytest.raises(pf.InputError, match="does not determine k, c, d"):
        refined_ranges(spec, three(), **(ASKED | {"unknown": ["k", "c", "d"]}))


def test_a_range_that_cannot_be_replaced_is_refused(spec):
    spec.write_text(SPEC.replace("[parameter.c]\nrange = [0.1, 4]\n", "").replace(
        "[parameter.m]", "[parameter]\nc = {range = [0.1, 4]}\n[parameter.m]"))  # fmt: skip
    with pytest.raises(pf.InputError, match="parameter c: its range is not found"):
        refined_ranges(spec, three(), **ASKED)
