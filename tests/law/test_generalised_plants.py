"""Generalised plants of python-control: channels by number or name, and the loops that they close.

The loops are compared with `control.StateSpace.lft`, which knows nothing of ours.
"""

import re

import control
import numpy as np
import pytest

from polefence import Compensator, Gain, HalfPlane, PlantError, analyse, from_control
from support.paths import DOCS

NW, NU, NZ, NY = 2, 1, 3, 2


def generalised(rng, n=3, dt=0, **names):
    """Return one with all blocks: with D22 u passes into y, and the law is well-posed or not."""
    A = rng.normal(size=(n, n)) - 2 * np.eye(n)
    if dt:
        A /= 4
    B, C = rng.normal(size=(n, NW + NU)), rng.normal(size=(NZ + NY, n))
    D = rng.normal(size=(NZ + NY, NW + NU))
    return control.ss(A, B, C, D, dt, **names)


def close(one, other):
    return np.allclose(np.poly(one), np.poly(other), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("dt", [0, 0.1])
@pytest.mark.parametrize("seed", range(6))
def test_loops_are_linear_fractional_transformations(seed, dt):
    rng = np.random.default_rng(seed)
    P = generalised(rng, dt=dt)
    K = control.ss(*(rng.normal(size=s) / 3 for s in ((2, 2), (2, NY), (NU, 2), (NU, NY))), dt)
    plant = from_control(P, controls=NU, measured=NY)
    assert [y.name for y in plant.outputs] == ["z1", "z2", "z3", "y1", "y2"]
    larger, law = Compensator.from_control(K, ["y1", "y2"]).beside(plant)
    ours = larger.A[0] + larger.B[0] @ law.gain([1.0])
    assert close(np.linalg.eigvals(ours), P.lft(K).poles())


@pytest.mark.parametrize("seed", range(4))
def test_gains_are_those_of_the_lower_linear_fractional_transformation(seed):
    """With D11, D12, D21 and D22: noise of y and u itself pass through the law into z."""
    rng = np.random.default_rng(seed)
    P = generalised(rng)
    P = control.ss(P.A - 2 * np.eye(3), P.B, P.C, P.D)
    K = control.ss(
        -np.diag([1.0, 2.0]), *(rng.normal(size=s) / 9 for s in ((2, NY), (NU, 2), (NU, NY)))
    )
    plant = from_control(P, controls=NU, measured=NY)
    limits = [Gain("z1"), Gain("z2"), Gain("z3")]
    law = Compensator.from_control(K, ["y1", "y2"])
    found = analyse(plant, law, HalfPlane(0), limits=limits)
    assert found.proved
    at = 1j * np.concatenate([[0], np.logspace(-3, 4, 3000)])
    H = P.lft(K)(at)
    for i, bound in enumerate(found.bounds):
        sampled = np.linalg.norm(H[i], axis=0).max()
        assert 0.9999 * sampled <= bound.bound.level <= 1.002 * sampled


def test_blocks_are_rows_of_outputs():
    """D11, D12, D21 and D22 are D and F of z and y."""
    rng = np.random.default_rng(1)
    P = generalised(rng)
    D = rng.normal(size=(NZ + NY, NW + NU))
    P = control.ss(P.A, P.B, P.C, D)
    plant = from_control(P, controls=NU, measured=NY)
    for i, output in enumerate(plant.outputs):
        C, own, F = output.arrays(plant)
        assert np.array_equal(C[0], P.C[i])
        assert np.array_equal(own[0], D[i, NW:])
        assert np.array_equal(F[0], D[i, :NW])
    assert np.array_equal(plant.vertices[0].E, P.B[:, :NW])


def test_names_say_the_same_as_numbers():
    names = {"inputs": ["w1", "w2", "f"], "outputs": ["e", "acc", "eff", "p", "q"]}
    P = generalised(np.random.default_rng(2), **names)
    by_number = from_control(P, controls=1, measured=2)
    by_name = from_control(P, controls=["f"], measured=["p", "q"])
    former = from_control(P, ["w1", "w2"])
    assert by_number == by_name
    assert by_name.inputs == former.inputs == ("f",)
    assert by_name.disturbances == ("w1", "w2")
    assert [y.name for y in by_name.outputs] == names["outputs"]
    mixed = from_control(P, controls="w2", measured=["q"])
    assert mixed.inputs == ("w2",)
    assert mixed.disturbances == ("w1", "f")


def test_outputs_that_are_states_are_kept_beside_what_is_measured():
    P = control.ss([[0, 1], [2, -1]], [[0, 0], [1, 1]], [[0, 1], [1, 0]], 0)
    assert from_control(P, controls=1).outputs == ()
    plant = from_control(P, controls=1, measured=1)
    assert [y.name for y in plant.outputs] == ["z1", "y1"]
    law = Compensator.from_control(control.tf([-60, -180], [1, 30]), ["y1"])
    found = analyse(plant, law, HalfPlane(0), limits=[Gain("x1")])
    assert found.proved
    truth = control.feedback(
        control.ss(P.A, P.B[:, 1:], [[1, 0]], 0), control.tf([-60, -180], [1, 30]), 1
    )
    assert close(loop(found), truth.poles())
    w = control.ss(P.A, P.B[:, :1], [[1, 0]], 0)
    H = control.feedback(w, control.tf([-60, -180], [1, 30]), 1)
    peak = np.abs(H(1j * np.logspace(-2, 3, 20_000))).max()
    assert 0.9999 * peak <= found.bounds[0].bound.level <= 1.001 * peak


def loop(found):
    return np.linalg.eigvals(found.plant.A[0] + found.plant.B[0] @ found.law.gain([1.0]))


def test_transfer_functions_are_plants_with_no_state_too_many():
    s = control.tf("s")
    G = 1 / (s * (s + 1))
    rows = [[G, G], [G, G]]  # [w; u] to [z; y], of two states
    num = [[g.num[0][0] for g in row] for row in rows]
    den = [[g.den[0][0] for g in row] for row in rows]
    P = control.tf(num, den, inputs=["w", "u"], outputs=["z", "y"])
    plant = from_control(P, controls=["u"], measured=["y"])
    assert plant.shape == (2, 1)
    K = control.tf([-9, -9], [1, 6])
    larger, law = Compensator.from_control(K, ["y"]).beside(plant)
    ours = np.linalg.eigvals(larger.A[0] + larger.B[0] @ law.gain([1.0]))
    assert close(ours, control.feedback(G, K, 1).poles())


def test_a_family_of_generalised_plants():
    rng = np.random.default_rng(3)
    family = [generalised(rng) for _ in range(3)]
    for P in family:
        P.D[NZ:, NW:] = [[0.3], [0]]  # the same everywhere
    plant = from_control(family, controls=NU, measured=NY)
    K = control.ss([[-3.0]], [[0.1, 0.2]], [[0.3]], [[0.1, 0.0]])
    larger, law = Compensator.from_control(K, ["y1", "y2"]).beside(plant)
    for j, P in enumerate(family):
        ours = larger.A[j] + larger.B[j] @ law.gain(np.eye(3)[j])
        assert close(np.linalg.eigvals(ours), P.lft(K).poles())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"controls": 4}, "controls = 4 of 3 inputs; give how many of the last ones"),
        ({"controls": 0}, "controls names no input"),
        ({"controls": ["v"]}, "controls: no input 'v'"),
        ({"controls": 1, "disturbances": 1}, "controls names the inputs already; leave out"),
        ({"controls": 1, "measured": 6}, "measured = 6 of 5 outputs"),
        ({"controls": 1, "measured": "x"}, "measured: no output 'x'"),
    ],
)
def test_wrong_channels_are_refused(words, message):
    with pytest.raises(PlantError, match=message.replace("[", r"\[")):
        from_control(generalised(np.random.default_rng(0)), **words)


def test_a_family_of_transfer_functions_is_refused():
    """Their hull would be that of whatever states they were given."""
    with pytest.raises(PlantError, match="is a TransferFunction, not a StateSpace; .* same states"):
        from_control([control.tf([1], [1, 1]), control.tf([1], [1, 2])])


def test_the_page_prints_what_it_shows(capsys):
    page = (DOCS / "gallery-python-control.md").read_text()
    code, shown = re.search(
        r"```python\n(import control\n.*?)```\n\n```text\n(.*?)```", page, re.S
    ).groups()
    names = {}
    exec(code, names)
    assert capsys.readouterr().out == shown
    at = 1j * np.logspace(-2, 3, 4000)
    for i in range(2):  # no bound is below what python-control has at a vertex
        sampled = max(np.abs(P.lft(-names["K"])(at)[i, 0]).max() for P in names["masses"])
        assert 0.999 * sampled <= names["found"].bounds[i].bound.level <= 1.01 * sampled
