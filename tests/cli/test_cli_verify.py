"""`verify` from the command line: what is said, written and refused."""

from __future__ import annotations

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
        "exceeded: gain of x1 <= 0.1; sampled ",
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
    assert [own["answer"] for own in data["limits"]] == ["proved", "exceeded"]
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
        (["minus.npz"], "minus.npz: no gain K in it, nor W and Z"),
        (["car.toml"], "car.toml: a spec has no gain; name one by --gain"),
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
