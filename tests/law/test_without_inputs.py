"""Signals into which inputs pass, y = C x + D u + F w, and laws of what is left without D u."""

from __future__ import annotations

import json

import numpy as np
import pytest

import polefence as pf
from polefence.plant.spec import loads
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.work import FormatError
from support.commands import ran, refused

SPEC = """name = "mass"
states = ["x", "v"]
inputs = ["u"]
disturbances = ["push", "noise"]
[parameter.k]
range = [1, 2]
[matrices]
A = [[0, 1], ["-k", -0.2]]
B = [[0], [2]]
E = [[0, 0], [1, 0]]
[outputs]
"a [m/s2]" = {C = ["-k", -0.2], D = [2], F = [1, 0.3]}
"left [m/s2]" = {C = ["-k", -0.2], F = [1, 0.3]}
"share" = {C = [0, 1], D = ["k - 1.5"]}
"""
GAIN = [["0.2", "-1"]]


@pytest.fixture(scope="module")
def plant():
    return loads(SPEC)


def test_what_is_left_of_a_signal(plant):
    whole, left = plant.signal("a"), plant.signal("a without inputs")
    assert (left.C, left.F, left.unit) == (whole.C, whole.F, "m/s2")
    assert whole.D
    assert not left.D
    assert plant.signal("rate of v without inputs").C == plant.signal("rate of v").C
    with pytest.raises(pf.InputError, match="'u' is inputs alone"):
        plant.signal("u without inputs")
    with pytest.raises(pf.InputError, match="no signal 'b'"):
        plant.signal("b without inputs")


def by_hand(K, k, passed=2.0):
    """A, E, and C and F of [x, u], of u = K [a, v]: (1 - K_a D) u = K (C x + F w)."""
    C, F = np.array([[-k, -0.2], [0, 1]]), np.array([[1, 0.3], [0, 0]])
    M = K / (1 - K[0, 0] * passed)
    A, B = np.array([[0, 1], [-k, -0.2]]), np.array([[0], [2.0]])
    shown = np.vstack([[1.0, 0.0], M @ C])
    return A + B @ M @ C, np.array([[0, 0], [1, 0]]) + B @ M @ F, shown, np.vstack([[0, 0], M @ F])


def test_a_gain_of_what_inputs_pass_into_is_that_loop(plant):
    """Its poles, and what of the disturbances passes on."""
    law = pf.Compensator(D=GAIN, measured=["a", "v"])
    larger, own = law.beside(plant)
    K = np.array([[0.2, -1.0]])
    for alpha, k in (([1, 0], 1.0), ([0, 1], 2.0), ([0.5, 0.5], 1.5)):
        A, E, _, F = by_hand(K, k)
        loops = pf.response.closed.close(larger, own, np.array(alpha, dtype=float))
        assert loops.closed[0] == pytest.approx(A)
        assert loops.E[0] == pytest.approx(E)
        assert loops.passing[0] == pytest.approx(F[1:])
    bound = pf.certify.bounds.best_bound(larger, own, pf.Gain(["x", "u"]))
    w = np.concatenate([[0.0], np.geomspace(1e-2, 1e2, 400)])
    worst = 0.0
    for k in np.linspace(1, 2, 11):
        A, E, C, F = by_hand(K, k)
        away = 1j * w[:, None, None] * np.eye(2) - A
        worst = max(
            worst, np.linalg.norm(C @ np.linalg.solve(away, E[None] + 0j) + F, 2, (1, 2)).max()
        )
    assert worst * (1 - 1e-4) <= bound.level <= worst * 1.01


def test_a_compensator_of_what_inputs_pass_into_is_that_loop(plant):
    """x_c' = -5 x_c + y, u = 0.4 x_c + 0.1 y with y = C x + 2 u + F w, by its equations."""
    law = pf.Compensator(A=[[-5]], B=[[1]], C=[["0.4"]], D=[["0.1"]], measured=["a"])
    larger, own = law.beside(plant)
    k, share = 1.5, 1 / (1 - 0.1 * 2)
    C = np.array([-k, -0.2])
    u = share * np.array([*(0.1 * C), 0.4])  # of [x, v, x_c]
    y = np.array([*C, 0]) + 2 * u
    expected = np.array([[0, 1, 0], np.array([-k, -0.2, 0]) + 2 * u, y + [0, 0, -5]])
    loops = pf.response.closed.close(larger, own, np.array([0.5, 0.5]))
    assert loops.closed[0] == pytest.approx(expected)
    F = np.array([1, 0.3])
    of_u = share * 0.1 * F
    driven = np.array([[0, 0], np.array([1, 0]) + 2 * of_u, F + 2 * of_u])
    assert loops.E[0] == pytest.approx(driven)


def test_the_law_of_the_signal_itself_is_the_same_loop(plant):
    """M of what is left, and K = M (I + D M)^-1 of the signal, brought back."""
    M = np.array([[0.3, -1.0]])
    D = np.array([[2.0], [0.0]])
    K = M @ np.linalg.inv(np.eye(2) + D @ M)
    given = pf.Compensator(D=K.tolist(), measured=["a", "v"]).beside(plant)[1]
    assert given.gains[0] == pytest.approx(M)


@pytest.mark.parametrize(("gain", "good"), [("0.5", False), ("0.4999", True), ("0.5001", True)])
def test_a_law_that_is_not_well_posed_is_refused(tmp_path, capsys, gain, good):
    """1 - 2 K is to be no zero."""
    spec = tmp_path / "mass.toml"
    spec.write_text(SPEC)
    words = ["verify", str(spec), "--gain", f'[["{gain}", "-1"]]', "--measured", "a, v"]
    words += ["--region", "half_plane(0)"]
    if good:
        ran(capsys, *words, status=0 if gain < "0.5" else 1)
        return
    said = refused(capsys, *words)
    assert "not well-posed" in said
    assert "'a'" in said
    assert "at all parameters" in said


def test_what_changes_with_the_parameters_is_to_be_taken_off(tmp_path, capsys):
    spec = tmp_path / "mass.toml"
    spec.write_text(SPEC)
    words = ["verify", str(spec), "--region", "half_plane(0)", "--gain"]
    said = refused(capsys, *words, '[["0.2", "-1"]]', "--measured", "share, v")
    assert "changes with the parameters" in said
    assert "'share without inputs'" in said
    said = refused(capsys, *words, '[["0.2*k", "-1"]]', "--measured", "a, v")
    assert "the law's numbers change" in said
    ran(capsys, *words, '[["-0.2", "-1"]]', "--measured", "share without inputs, v")
    ran(capsys, *words, '[["0.02*k", "-1"]]', "--measured", "a without inputs, v")


def test_a_search_is_that_of_the_same_rows_by_another_name(tmp_path, capsys):
    """With the file, and what check says of another plant."""
    spec, made = tmp_path / "mass.toml", tmp_path / "made"
    spec.write_text(SPEC)
    asked = ["--schedule", "none", "--minimise", "gain of [x, u]"]
    levels = {}
    for name in ("a without inputs", "left"):
        ran(capsys, "optimise", str(spec), "--measured", f"{name}, v", *asked, "-o", str(made))
        table = json.loads((made / "design.json").read_text())
        levels[name] = table["claims"][1]["level"]
    assert levels["a without inputs"] == pytest.approx(levels["left"], rel=1e-9)
    said = refused(capsys, "optimise", str(spec), "--measured", "a, v", *asked)
    assert "measure 'a without inputs', by code that takes its input off" in said
    ran(capsys, "optimise", str(spec), "--measured", "a without inputs, v", *asked, "-o", str(made))
    ran(capsys, "check", str(made), "--spec", str(spec))
    other = tmp_path / "other.toml"
    other.write_text(SPEC.replace("F = [1, 0.3]}", "F = [1, 0.4]}", 1))
    said = ran(capsys, "check", str(made), "--spec", str(other), status=1)
    assert "NOT about" in said
    table = json.loads((made / "design.json").read_text())
    own = next(y for y in table["plant"]["outputs"] if y["name"].startswith("a"))
    for key, rows in (("F", [[-9, 0.3]]), ("F", [[1, 30]]), ("C", [[-60, 0]])):
        changed = json.loads(json.dumps(table))
        next(y for y in changed["plant"]["outputs"] if y["name"] == own["name"])[key] = rows
        assert not check(read(json.dumps(changed))).proved
    changed = json.loads(json.dumps(table))
    changed["law"]["measured"][0] = "b without inputs"
    with pytest.raises(FormatError, match="not a state or output of the plant"):
        read(json.dumps(changed))


def test_what_inputs_pass_into_by_functions_wants_a_sensor(tmp_path, capsys):
    spec = tmp_path / "mass.toml"
    outputs = '[outputs]\nlift = {C = ["sqrt(k)", 0], D = [1]}\n'
    spec.write_text(SPEC.replace("[outputs]\n", outputs, 1))
    asked = ["--measured", "lift, v", "--minimise", "gain of v"]
    said = refused(capsys, "optimise", str(spec), *asked)
    assert "give its sensor or the actuator a bandwidth" in said
    assert "without inputs" not in said


def test_code_says_what_is_to_be_taken_off(tmp_path, capsys):
    spec, made, code = tmp_path / "mass.toml", tmp_path / "made", tmp_path / "code"
    spec.write_text(SPEC)
    for name, said in (("a without inputs", True), ("left", False)):
        words = ["--measured", f"{name}, v", "--schedule", "none", "--minimise", "gain of [x, u]"]
        ran(capsys, "optimise", str(spec), *words, "-o", str(made))
        ran(capsys, "export", str(made), "-o", str(code), "--sample-time", "0.001")
        for file in ("law.h", "README.md"):
            text = (code / file).read_text()
            assert name in text
            assert ("less what u, as it acts while y is measured" in text) is said
