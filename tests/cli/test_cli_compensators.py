"""Compensators from files and from the command line: read, judged, saved, or refused in a line."""

import json

import control
import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import cont2discrete

from polefence import Design
from support.commands import ran, refused

SPEC = """
name = "arm"
states = ["x [m]", "v [m/s]"]
inputs = ["f [N]"]
[parameter.a]
range = [1, 3]
[matrices]
A = [[0, 1], ["a", -1]]
B = [[0], [1]]
[outputs]
"twice" = {C = [2, 0]}
"""
# u = -40 (s + 3)/(s + 30) x
TOP, BOTTOM = [-40.0, -120.0], [1.0, 30.0]
a, b, c, d = (np.atleast_2d(M) for M in (-30.0, 32.0, 33.75, -40.0))
ONE = {"A": a, "B": b, "C": c, "D": d}
LOWER = {letter.lower(): M for letter, M in ONE.items()}


def named(form):
    return {form.format(letter): M for letter, M in ONE.items()}


def cell(*rows):
    cells = np.empty((len(rows), len(rows[0])), dtype=object)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            cells[i, j] = np.atleast_2d(entry)
    return cells


FILES = {
    "struct": lambda path, **how: savemat(path, {"K": ONE, "other": np.eye(3)}, **how),
    "lower": lambda path, **how: savemat(path, {"ctrl": {**LOWER, "Ts": 0.0, "e": []}}, **how),
    "Ac": lambda path, **how: savemat(path, named("{}c") | {"gamma": 1.3}, **how),
    "Ak": lambda path, **how: savemat(path, named("{}k"), **how),
    "KA": lambda path, **how: savemat(path, named("K{}"), **how),
    "A": lambda path, **how: savemat(path, ONE, **how),
    "num": lambda path, **how: savemat(path, {"num": TOP, "den": BOTTOM}, **how),
    "cells": lambda path, **how: savemat(
        path, {"K": {"num": cell([TOP]), "den": cell([BOTTOM])}}, **how
    ),
    "zpk": lambda path, **how: savemat(path, {"K": {"z": -3.0, "p": -30.0, "k": -40.0}}, **how),
}
OLD = ("Ac", "Ak", "KA", "A", "num")  # without structures


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(SPEC)
    return tmp_path


def judged(capsys, *words):
    """Judge the law of a file, and return the gain that is proved."""
    said = ran(capsys, "verify", "arm.toml", "--measured", "x", *words, "-o", "out")
    assert said.startswith("proved: all poles of 'arm' in half_plane(0)")
    assert "law: order 1, u = K y of y = x [m]" in said
    design = Design.load("out")
    poles = np.sort(design.poles([0, 1]))
    own = control.ss([[0, 1], [3, -1]], [[0], [1]], [[1, 0]], 0)
    truth = control.feedback(own, control.tf(TOP, BOTTOM), 1).poles()
    assert np.allclose(poles, np.sort(truth))
    assert "proved" in ran(capsys, "check", "out", "--spec", "arm.toml")


def test_what_is_read_of_a_file_is_said(folder, capsys):
    FILES["KA"]("law.mat")
    said = ran(capsys, "verify", "arm.toml", "--measured", "x", "--gain", "law.mat")
    assert "law: order 1, u = K y of y = x [m]; KA, KB, KC, KD of law.mat" in said
    savemat("law.mat", {f"{letter}hat": M for letter, M in ONE.items()})
    names = [word for x in "ABCD" for word in ("--name", f"{x}c={x}hat")]
    said = ran(capsys, "verify", "arm.toml", "--measured", "x", "--gain", "law.mat", *names)
    assert said.startswith("proved: ")
    savemat("law.mat", {"lead": ONE, "other": ONE})
    line = refused(capsys, "verify", "arm.toml", "--measured", "x", "--gain", "law.mat")
    assert "holds neither a gain K nor W and Z" in line
    assert "name one of the systems lead, other K" in line
    named = ["--gain", "law.mat", "--name", "K=lead"]
    assert "lead of law.mat" in ran(capsys, "verify", "arm.toml", "--measured", "x", *named)


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("how", [{}, {"do_compression": True}, {"format": "4"}])
def test_files_of_matlab(folder, capsys, kind, how):
    if how.get("format") == "4" and kind not in OLD:
        pytest.skip("version 4 has no structures")
    FILES[kind]("law.mat", **how)
    judged(capsys, "--gain", "law.mat")


def test_files_of_numpy_json_and_csv(folder, capsys):
    np.savez("law.npz", **ONE)
    judged(capsys, "--gain", "law.npz")
    np.savez("law2.npz", **named("{}c"))
    judged(capsys, "--gain", "law2.npz")
    plain = {letter: M.tolist() for letter, M in ONE.items()}
    for data in (
        plain,
        {"K": plain},
        {"numerator": TOP, "denominator": BOTTOM},
        {"numerator": [[TOP]], "denominator": [[BOTTOM]]},
        {"zeros": [-3], "poles": [-30], "gain": -40},
        [["-40*(s + 3)/(s + 30)"]],
        "-40*(s + 3)/(s + 30)",
    ):
        (folder / "law.json").write_text(json.dumps(data))
        judged(capsys, "--gain", "law.json")
    (folder / "csv").mkdir()
    for letter, M in ONE.items():
        np.savetxt(folder / "csv" / f"{letter}.csv", M, delimiter=",")
    judged(capsys, "--gain", "csv")


def test_texts_of_the_command_line(folder, capsys):
    judged(capsys, "--gain=-40*(s + 3)/(s + 30)")
    judged(capsys, "--gain", "-40*(s+3)/(s+30)")
    judged(capsys, "--gain", "-(s+3)*40/(s+30)")
    judged(capsys, "--gain", "[['-40*(s + 3)/(s + 30)']]")
    judged(capsys, "--gain", json.dumps({"numerator": TOP, "denominator": BOTTOM}))
    said = ran(capsys, "verify", "arm.toml", "--gain", "[['-3 - 2*a', '-1 + a**2/8']]", "-o", "p")
    assert said.startswith("proved: ")
    assert len(Design.load("p").law.powers) == 3


def test_the_other_sign_is_offered_and_taken(folder, capsys):
    words = ["verify", "arm.toml", "--measured", "x", "--gain", "40*(s + 3)/(s + 30)"]
    said = ran(capsys, *words, status=1)
    assert said.startswith("refuted: ")
    assert "-K keeps the poles" in said
    assert "add --minus" in said
    said = ran(capsys, *words, "--minus", "-o", "out")
    assert said.startswith("proved: ")
    assert "law: order 1, u = -K y of y = x [m]" in said
    gains = Design.load("out").law.gains[0]
    truth = np.block([[d, c], [b, a]])
    at = 1j * np.array([0.1, 1, 10])
    for M in (gains, truth):  # of one transfer function, whatever its states' units
        assert np.allclose(
            M[0, 0] + M[0, 1] * M[1, 0] / (at - M[1, 1]),
            np.polyval(TOP, at) / np.polyval(BOTTOM, at),
        )


def test_one_file_with_plant_and_compensator(folder, capsys):
    A = np.stack([[[0, 1], [1, -1]], [[0, 1], [3, -1]]], axis=2)
    plant = {"A": A, "B": [[0.0], [1.0]], "C": [[1.0, 0.0]]}
    for more in (named("{}c"), {"K": ONE}):
        savemat("both.mat", plant | more)
        said = ran(capsys, "verify", "both.mat")
        assert said.startswith("proved: ")
        assert "law: order 1, u = K y of y = y1" in said
        assert "read: A of 2 vertices, B, C" in said
    savemat("both.mat", {"G": plant, "K": ONE})
    assert "law: order 1, u = K y of y = y1" in ran(capsys, "verify", "both.mat")
    savemat("both.mat", plant | {"Ac": a, "Bc": b, "Cc": -c, "Dc": -d})
    assert "u = -K y of y = y1" in ran(capsys, "verify", "both.mat", "--minus")


def test_a_gain_of_signals(folder, capsys):
    """Twice x and v, in another order than the states."""
    for law in ("[[-1, -5]]", "[-1 -5]", "law.json", "law.npz"):
        (folder / "law.json").write_text('{"K": [[-1, -5]]}')
        np.savez("law.npz", K=[[-1.0, -5.0]])
        said = ran(
            capsys, "verify", "arm.toml", "--gain", law, "--measured", "v, twice", "-o", "out"
        )
        assert said.startswith("proved: ")
        assert "law: gains, u = K y of y = v [m/s], twice" in said
        poles = Design.load("out").poles([0, 1])
        assert np.allclose(np.poly(poles), np.poly(np.array([[0, 1], [3 - 10, -1 - 1]])))
    A = np.stack([[[0, 1], [1, -1]], [[0, 1], [3, -1]]], axis=2)
    plant = {
        "A": A,
        "B": [[0.0], [1.0]],
        "C": [[2.0, 0.0]],
        "K": np.stack([[[-2]], [[-5]]], axis=2),
    }
    savemat("both.mat", plant)
    said = ran(capsys, "verify", "both.mat", "--measured", "y1", "-o", "out")
    poles = Design.load("out").poles([0.5, 0.5])
    assert np.allclose(np.poly(poles), np.poly(np.array([[0, 1], [2 - 7, -1]])))
    line = refused(capsys, "verify", "both.mat")
    assert "1 x 1; both needs 1 x 2" in line


def test_a_compensator_a_vertex(folder, capsys):
    """A stronger law where the plant is less stable; its file has the vertices last."""
    A = np.stack([[[0, 1], [1, -1]], [[0, 1], [3, -1]]], axis=2)
    plant = {"A": A, "B": [[0.0], [1.0]], "C": [[1.0, 0.0]]}
    each = {letter: np.stack([M, M], axis=2) for letter, M in ONE.items()}
    each["D"] = np.stack([d, 2 * d], axis=2)
    for more in ({f"{letter}c": M for letter, M in each.items()}, {"K": each}):
        savemat("both.mat", plant | more)
        said = ran(capsys, "verify", "both.mat", "-o", "out")
        assert said.startswith("proved: ")
        poles = Design.load("out").poles([0.25, 0.75])
        own = control.ss([[0, 1], [2.5, -1]], [[0], [1]], [[1, 0]], 0)
        law = control.ss(a, b, c, 1.75 * d)
        assert np.allclose(np.poly(poles), np.poly(control.feedback(own, law, 1).poles()))


def test_what_is_measured_comes_from_the_spec(folder, capsys):
    (folder / "arm.toml").write_text(SPEC + '[law]\nmeasured = ["x"]\n')
    assert "of y = x [m]" in ran(capsys, "verify", "arm.toml", "--gain=-40*(s + 3)/(s + 30)")
    said = ran(capsys, "verify", "arm.toml", "--gain=-20*(s+3)/(s+30)", "--measured", "twice")
    assert "of y = twice" in said


def test_at_a_sample_time(folder, capsys):
    num, den, _ = cont2discrete((TOP, BOTTOM), 0.01, method="bilinear")
    data = {"num": num[0].tolist(), "den": den.tolist(), "Ts": 0.01, "measured": ["x"]}
    (folder / "law.json").write_text(json.dumps(data))
    said = ran(capsys, "verify", "arm.toml", "--gain", "law.json", "--sample-time", "0.01")
    assert said.startswith("proved: all poles of 'arm' in disk(0, 1)")
    said = ran(
        capsys, "verify", "arm.toml", "--gain", "law.json", "--sample-time", "0.01", "--delay", "1",
        "-o", "out",
    )  # fmt: skip
    assert "proved" in said
    plant = control.ss([[0, 1], [3, -1]], [[0], [1]], [[1, 0]], 0)
    held = control.sample_system(plant, 0.01)
    late = control.tf([1], [1, 0], 0.01)
    law = control.tf(num[0], den, 0.01)
    loop = control.feedback(control.ss(late) * control.ss(law), held, 1)
    ours = Design.load("out").poles([0, 1])
    assert np.allclose(np.poly(ours), np.poly(loop.poles()), atol=1e-9)
    line = refused(capsys, "verify", "arm.toml", "--gain", "law.json")
    assert (
        "moves every 10 ms, and arm in continuous time; sample the plant by --sample-time, every "
        "0.01 s" in line
    )
    line = refused(capsys, "verify", "arm.toml", "--gain", "law.json", "--sample-time", "0.02")
    assert "law.json: the law moves every 10 ms, and arm every 20 ms" in line


def test_a_table_of_compensators(folder, capsys):
    knots = {"grid": {"a": [1, 2, 3]}, **{x: [M.tolist()] * 3 for x, M in ONE.items()}}
    (folder / "law.json").write_text(json.dumps(knots | {"measured": ["x"]}))
    said = ran(capsys, "verify", "arm.toml", "--gain", "law.json", "--limit", "none", "-o", "out")
    assert said.startswith("proved: 100 % of the parameters' box proved")
    assert "law: a table of order 1, u = K y of y = x [m]" in said
    assert "proved" in ran(capsys, "check", "out", "--spec", "arm.toml")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--gain", "40*(s+3)/(s+30)"],
            "--gain: the law measures 1 signal; arm has 2 states and 0 o",
        ),
        (
            ["--gain", "(s+3)/(s+30", "--measured", "x"],
            "--gain: transfer: cannot read the expression",
        ),
        (["--gain", "(s+3)^2/(s+30)", "--measured", "x"], "^ (write ** for powers)"),
        (["--gain", "s + 3", "--measured", "x"], "--gain: transfer: the numerator has degree 1"),
        (
            ["--gain", "1/(z - 0.5)", "--measured", "x"],
            "in z, and no sample time; sample the plant by --sample-time",
        ),
        (["--gain", "[['1/b', 2]]"], "unknown name 'b' in the law; known are the parameters (a)"),
        (["--gain", "[['1/(a - 2)', 2]]"], "--gain: the denominator of the gains is not seen to"),
        (
            ["--gain", "[[1, 2]]", "--measured", "x"],
            "1 signal measured by name, and the law takes 2",
        ),
        (
            ["--gain", '{"grid": {"a": [1, 3]}, "gains": [[[1, 2]], [[1, 2]]]}', "--measured", "x"],
            "--measured is for a gain, or a compensator; a design, or a table of gains",
        ),
        (["--gain", "1/(s+1)", "--measured", "q"], "no signal 'q'"),
        (["--gain", "1/(s+1)", "--measured", "f"], "an input passes straight into 'f'"),
        (["--gain", "law.json", "--measured", "x"], "law.json: names what it measures itself"),
        (["--gain", "short.json"], "short.json: C is 1 x 2; beside the others it must be 1 x 1"),
        (["--gain", "no.json"], "no.json"),
    ],
)
def test_bad_laws_are_refused_and_nothing_is_written(folder, capsys, words, message):
    plain = {letter: M.tolist() for letter, M in ONE.items()}
    (folder / "law.json").write_text(json.dumps(plain | {"measured": ["x"]}))
    (folder / "short.json").write_text(json.dumps(plain | {"C": [[1, 2]]}))
    line = refused(capsys, "verify", "arm.toml", *words, "-o", "out")
    assert message in line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    "law",
    [
        '[["1/s"', "{}", "[[]]", '{"A": 1}', '{"A": [[1]], "B": [[1]], "C": [["x"]]}',
        '{"numerator": {}, "denominator": []}', '{"numerator": [1], "denominator": [1, "x"]}',
        '{"zeros": [1e400], "poles": [1], "gain": 1}', '{"A": [[1e300]], "B": [[1]], "C": [[1]]}',
        '{"A": "[[1]]", "B": [[1]], "C": [[1]]}', '{"A": [], "B": [[]], "C": [1]}',
        '{"numerator": [[[1]], [[1, 2]]], "denominator": [1, 2]}',
        "1/z", "s", "(s", '{"D": [["s"]]}',
        '{"A": [[1]], "B": [[1]], "C": [[1]], "measured": [1]}',
        '{"A": [[1]], "B": [[1]], "C": [[1]], "measured": {}}',
        '{"A": [[1]], "B": [[1]], "C": [[1]], "sample_time": "x"}',
        '{"A": [[1]], "B": [[1]], "C": [[1]], "grid": {"a": [1, 3]}}',
        '{"A": [[[1]], [[1]]], "B": [[1]], "C": [[1]], "grid": 3}',
        '{"A": [[[1]], [[1]]], "B": [[1]], "C": [[1]], "grid": {"b": [1, 3]}}',
        '{"A": [[[1]], [[[1]]]], "B": [[1]], "C": [[1]]}',
        '{"A": [[null]], "B": [[1]], "C": [[1]]}', '{"A": {"A": 1}, "B": [[1]], "C": [[1]]}',
        '{"zeros": 1, "poles": [[1, 2, 3]], "gain": [1, 2]}',
        '{"K": {"A": 1, "B": 2, "C": 3, "D": "s"}}',
    ],
)  # fmt: skip
def test_hostile_words_are_refused_in_one_line(folder, capsys, law):
    refused(capsys, "verify", "arm.toml", "--measured", "x", "--gain", law)


def test_other_commands_say_what_to_do(folder, capsys):
    for law in ("[['1/(s + 1)', 0]]", "-1/(s+1)"):
        line = refused(capsys, "simulate", "arm.toml", "--law", law)
        assert "--law: a law with states of its own; prove it by polefence verify --gain" in line
