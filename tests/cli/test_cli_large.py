"""A structure of 70 states from a file of matrices, by the command line, against its modes."""

import json

import numpy as np
import pytest
import scipy.io

from polefence.cli.main import main

w = np.geomspace(0.5, 60, 35)
DAMPING = 0.005
DECAY = DAMPING * w[0]


@pytest.fixture
def matrices(tmp_path, monkeypatch):
    """Write the file in the folder that commands run in."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(5)
    turned = np.linalg.qr(random.normal(size=(35, 35)))[0]
    stiffness, viscous = (turned @ np.diag(x) @ turned.T for x in (w**2, 2 * DAMPING * w))
    none = np.zeros((35, 35))
    B = np.vstack([np.zeros((35, 2)), random.normal(size=(35, 2))])
    C = np.hstack([random.normal(size=(2, 35)), np.zeros((2, 35))])
    A = np.block([[none, np.eye(35)], [-stiffness, -viscous]])
    scipy.io.savemat("structure.mat", {"A": A, "B": B, "C": C})
    at = 1j * w[:, None, None] * np.eye(70) - A  # nearly at the peaks
    return np.linalg.norm(C @ np.linalg.solve(at, B), 2, axis=(1, 2)).max()


def run(capsys, *words):
    code = main(list(words))
    said = capsys.readouterr()
    return code, said.out + said.err


VERIFY = ("verify", "structure.mat", "--gain", "none", "--name", "E=B")


def test_a_file_of_matrices_is_proved_kept_checked_and_shown(matrices, capsys):
    gain = "gain of [y1, y2]"
    code, said = run(
        capsys, *VERIFY, "--region", "half_plane(0.0024)", "--limit", gain, "-o", "kept"
    )
    assert code == 0, said
    with open("kept/design.json") as file:
        claims = {claim["kind"]: claim for claim in json.load(file)["claims"]}
    # 1e-3: the peaks lie beside the frequencies of the modes
    assert matrices * (1 - 1e-9) < float(claims["gain"]["level"]) < matrices * (1 + 1e-3)
    assert run(capsys, "check", "kept")[0] == 0
    code, said = run(capsys, "report", "kept", "-o", "page.html")
    assert code == 0, said
    with open("page.html") as file:
        page = file.read()
    assert "Of 74 signals these are the first 24, outputs before others." in page


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_the_plant_alone_is_decided_on_both_sides_of_its_slowest_pole(matrices, capsys, share):
    code, said = run(capsys, *VERIFY, "--region", f"half_plane({share * DECAY:.6g})")
    assert (code, said.split(":")[0]) == ((0, "proved") if share < 1 else (1, "refuted"))


def test_what_a_large_plant_may_be_asked_is_said_in_one_line(matrices, capsys):
    code, said = run(capsys, *VERIFY, "--limit", "gain of z")
    assert (code, said.strip()) == (
        2,
        "polefence: no signal 'z'; known: u1, u2, x1 to x70, y1, y2",
    )
    code, said = run(capsys, "report", "structure.mat")
    assert code == 2
    assert "structure.mat: not UTF-8 text; polefence verify reads matrices of other tools" in said
    code, said = run(capsys, "verify", "structure.mat")
    assert code == 2
    assert "name a file that does, or write none" in said
