"""`verify` from the command line: what is said, written and refused."""

import json

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import check
from polefence.cli.main import main
from polefence.examples import spec_text
from support.commands import refused

A = np.array([[[0.0, 1.0], [-1.0, -1.0]], [[0.0, 1.0], [-2.0, -1.0]]])
B = np.array([[0.0], [1.0]])
K = np.array([[-1.0, -1.0]])
P = solve_continuous_lyapunov((A[0] + B @ K).T, -np.eye(2))


@pytest.fixture
def mine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("mine.npz", A=A, B=B, E=B, K=K, P=P)
    np.savez("minus.npz", A=A, B=B, gain=-K, Xopt=np.linalg.inv(P))
    return tmp_path


def lines(capsys, *words, status=0):
    assert main(["verify", *words]) == status
    return capsys.readouterr().out.splitlines()


def test_poles_matrices_and_bounds_are_said_and_saved(mine, capsys):
    limits = ["--limit", "gain of x1 <= 1", "--limit", "gain of x1 <= 0.1"]
    said = lines(capsys, "mine.npz", *limits, "-o", "out", "--json", "all.json", status=1)
    starts = ["proved: all poles of 'mine' in half_plane(0)", "given P: proves it, as V = x' P x"]
    starts += [
        "proved: gain of x1 <= 1; ",
        "refuted: gain of x1 <= 0.1; sampled ",
        "read: A of 2 vertices, B, E, K, P from mine.npz",
        "saved: out/design.json",
    ]
    starts += ["saved: all.json"]
    for line, start in zip(said, starts, strict=True):
        assert line.startswith(start)
    found = check("out")
    assert found.proved
    assert [own[:5] for own in found.claims] == ["poles", "gain "]
    data = json.loads((mine / "all.json").read_text())
    assert data["answer"] == "refuted"
    assert data["lyapunov"]["form"] == "primal"
    assert [own["answer"] for own in data["limits"]] == ["proved", "refuted"]
    level = data["limits"][0]["proved"]
    assert f"; {level:.5f}" in said[2] or f"; {level:.6f}" in said[2]


def test_other_names_and_the_other_sign(mine, capsys):
    words = ["--name", "K=gain", "--name", "P=Xopt", "--region", "half_plane(0)"]
    said = lines(capsys, "minus.npz", "--minus", *words)
    assert said[1].startswith("given P: proves it, as V = x' P^-1 x")
    assert said[2] == (
        "read: A of 2 vertices, B, K (called 'gain'), P (called 'Xopt') from minus.npz; u = -K x"
    )
    said = lines(capsys, "minus.npz", *words, status=1)
    assert said[0].startswith("refuted: at alpha = ")
    assert said[1].startswith("note: -K keeps the poles of all vertices there")
    assert said[2].startswith("given P: does not prove it; ")


def test_parts_may_be_in_other_files(mine, capsys):
    (mine / "car.toml").write_text(spec_text("quarter-car-physical"))
    gain = np.array([[52930, 59680, -5150, 2560, 181210.0]])
    np.savetxt("gain.csv", gain, delimiter=",")
    np.savez("p.npz", anything=np.eye(5))
    said = lines(capsys, "car.toml", "--gain", "gain.csv", "--lyapunov", "p.npz")
    assert said[0].startswith("proved: all poles of 'quarter car, physical'")
    assert said[1].startswith("given P: does not prove it; ")
    (mine / "k.json").write_text(json.dumps({"K": gain.tolist()}))
    assert lines(capsys, "car.toml", "--gain", "k.json")[0] == said[0]
    np.save("k.npy", gain)
    assert lines(capsys, "car.toml", "--gain", "k.npy") == said[:1]
    main(["analyse", "car.toml", "--gain", "gain.csv", "--region", "half_plane(0)"])
    assert capsys.readouterr().out.startswith("proved: ")


def test_nothing_is_saved_where_nothing_is_proved(mine, capsys):
    said = lines(capsys, "mine.npz", "--region", "half_plane(9)", "-o", "out", status=1)
    assert said[-1] == "not saved: nothing was proved"
    assert not (mine / "out").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.mat"], "none.mat: cannot be read"),
        (["mine.npz", "--name", "P"], "--name 'P' is not of the form NEW=OLD"),
        (["mine.npz", "--name", "P=Q", "--lyapunov", "mine.npz"], "no matrix 'Q'"),
        (["mine.npz", "--name", "P=Q"], "no matrix 'Q'"),
        (["mine.npz", "--name", "B=Bu"], "no matrix 'Bu'"),
        (["mine.npz", "--name", "E=Bw"], "no matrix 'Bw'"),
        (["mine.npz", "--limit", "rms"], "--limit 'rms': "),
        (["mine.npz", "--gain", "[1 2 3]"], "--gain: the gain is 1 x 3; mine needs 1 x 2"),
        (["mine.npz", "--region", "disc(1, 2)"], "disc"),
        (["minus.npz"], "minus.npz: holds neither a gain K nor W and Z"),
        (["car.toml"], "car.toml: a spec has no gain; name one by --gain, or none by --gain none"),
        (["out"], "out: a file of claims; polefence check proves it afresh"),
        (["mine.npz", "--lyapunov", "mine.npz", "--gain", "two.npz"], "for one gain K"),
        (["mine.npz", "--limit", "gain of x1 <= 1", "-o", "mine.npz"], "mine.npz"),
        (["mine.npz", "--gain", "gain.csv"], "polefence: gain.csv: gain[1][2] = nan must be"),
        (["mine.npz", "--gain", "column.csv"], "polefence: column.csv: the gain is 2 x 1; mine"),
    ],
)
def test_what_cannot_be_used_is_one_line(mine, capsys, words, said):
    (mine / "car.toml").write_text(spec_text("quarter-car-physical"))
    np.savez("two.npz", K=np.stack([K, K]))
    np.savetxt("gain.csv", [[1, np.nan]])
    np.savetxt("column.csv", K.T)
    main(["verify", "mine.npz", "-o", "out"])
    capsys.readouterr()
    assert said in refused(capsys, "verify", *words)


# A mass on a spring on a rough road, damped by the law: x'' = -k x - c v + w', say; white noise of
# one-sided density D in w has the spectrum D / 2, so that the rms is in closed form.
ROADS = """
name = "mass"
states = ["x [m]", "v [m/s]"]
inputs = ["f"]
disturbances = ["road [m/s]"]
region = "half_plane(0.1)"
[parameter.k]
range = [4, 9]
[matrices]
A = [[0, 1], ["-k", 0]]
B = [[0], [1]]
E = [[0], [1]]
[road]
class = "C"
speed = 20
[[specification]]
kind = "rms"
signal = "x"
at_most = {most}
[[specification]]
kind = "gain"
signal = "x"
minimise = true
"""
DAMPING = 2.0


def rms_of_x(density):
    """Return it at the softest spring: E x^2 = (D / 2) / (2 c k)."""
    return (density / 2 / (2 * DAMPING * 4)) ** 0.5


def density():
    """Return that of a class C road's velocity at 20 m/s, ISO 8608: G = 256e-6 m3 at 0.1 per m."""
    return 256e-6 * (2 * np.pi * 0.1) ** 2 * 20


@pytest.mark.parametrize(("share", "answer"), [(1.01, "proved"), (0.99, "refuted")])
def test_a_spec_is_verified_on_its_road_within_its_limits(mine, capsys, share, answer):
    most = float(f"{share * rms_of_x(density()):.4g}")
    (mine / "s.toml").write_text(ROADS.format(most=most))
    status = 0 if answer == "proved" else 1
    words = ["s.toml", "--gain", f"[0 -{DAMPING}]"]
    said = lines(capsys, *words, status=status)
    assert "in half_plane(0.1)" in said[0]
    assert said[1].startswith(f"{answer}: rms of x <= {most:g}")
    assert said[2].startswith("proved: gain of x; ")
    assert len(said) == 3
    level = float(said[2].split("; ")[1].split()[0])
    # of x at the resonance of the softest spring, 1 / (c sqrt(k - c^2 / 4))
    assert level == pytest.approx(1 / (DAMPING * (4 - DAMPING**2 / 4) ** 0.5), rel=1e-3)
    own = lines(capsys, *words, "--limit", "rms of x <= 1")
    assert own[1].startswith("proved: rms of x <= 1; ")
    assert len(own) == 2
    sampled = float(own[1].split("sampled ")[1].split()[0])
    assert sampled == pytest.approx(rms_of_x(density()), rel=1e-3)


def test_a_road_that_is_missing_is_asked_for_in_words_of_a_spec(mine, capsys):
    text = ROADS.format(most=1).replace("[road]", "[road_]").split("[road_]")[0]
    (mine / "s.toml").write_text(text)
    error = refused(capsys, "verify", "s.toml", "--gain", "[0 -2]", "--limit", "rms of x <= 1")
    assert "[road] with class and speed" in error
    assert "--road" not in error


SIGN = "note: -K keeps the poles of all vertices there, and of 200 points between; if the law is"


def test_the_note_on_the_sign_is_there_only_where_it_is_right(mine, capsys):
    region = ["--region", "half_plane(0)"]
    said = lines(capsys, "minus.npz", "--name", "K=gain", *region, status=1)
    assert said[1] == f"{SIGN} u = -K x, add --minus"
    said = lines(capsys, "mine.npz", "--minus", *region, status=1)
    assert said[1] == f"{SIGN.replace('-K', 'K')} u = K x, leave out --minus"
    # with neither sign the poles are there
    said = lines(capsys, "mine.npz", "--minus", "--region", "half_plane(40)", status=1)
    assert not any(line.startswith("note:") for line in said)


def test_no_note_where_the_other_sign_keeps_the_vertices_alone(mine, capsys):
    """Two stable vertices whose middle is not: [[-1, 5], [0, -1]] and its transpose."""
    corners = np.array([[[-1.0, 5.0], [0.0, -1.0]], [[-1.0, 0.0], [5.0, -1.0]]])
    np.savez("two.npz", A=corners + np.eye(2), B=np.eye(2), K=np.eye(2))
    said = lines(capsys, "two.npz", status=1)
    assert said[0].startswith("refuted: at alpha = ")
    assert not any(line.startswith("note:") for line in said)


def test_no_note_on_the_sign_of_a_design(mine, capsys):
    """Its file says it."""
    (mine / "s.toml").write_text(ROADS.format(most=1))
    assert main(["verify", "s.toml", "--gain", "[0 -2]", "-o", "d"]) == 0
    other = ROADS.format(most=1).replace("B = [[0], [1]]", "B = [[0], [-1]]")
    (mine / "other.toml").write_text(other)
    capsys.readouterr()
    said = lines(capsys, "other.toml", "--gain", "[0 -2]", status=1)
    assert any(line.startswith("note: -K keeps") for line in said)
    said = lines(capsys, "other.toml", "--gain", "d", status=1)
    assert not any(line.startswith("note:") for line in said)


def test_one_plant_has_no_alpha(mine, capsys):
    np.savez("one.npz", A=A[0], B=B, E=B, K=K)
    said = lines(capsys, "one.npz", "--limit", "gain of x1 <= 1")
    assert said[1].startswith("proved: gain of x1 <= 1; ")
    assert "alpha =" not in "".join(said)
    said = lines(capsys, "one.npz", "--region", "half_plane(9)", status=1)
    assert said[0].startswith("refuted: the pole ")
