"""MATLAB files: what they hold, and K(alpha) by the very formula that the documentation shows."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from scipy.io import loadmat

from polefence import Disk, OutputError, Parameter, Scheduled, UncertainPlant, place, tightest
from polefence.certify.design import Design
from polefence.export.matlab import mat, statement
from polefence.proof.matrices import mix, right_divide
from support.memories import CORNER
from support.memories import design as dynamic

METHODS = {
    "paper": Scheduled(1, 1, "simplex"),
    "degree 2 on the box": Scheduled(2, 1, "box"),
    "degree 2 on the simplex": Scheduled(2, 1, "simplex"),
    "one gain": "quadratic",
}


@pytest.fixture(scope="module")
def designs(physical):
    return {name: place(physical, Disk(-40, 36), method) for name, method in METHODS.items()}


def law_gain(law, alpha):
    """The function of that name in the documentation, line by line."""
    if "K" in law:
        return law["K"]
    sizes = law["sizes"].ravel()
    N, q = len(alpha), len(sizes)
    if q > 1:
        c = np.zeros(2 * q)
        for f in range(1, q + 1):
            high = np.arange(N) >> (q - f) & 1 == 1  # bitget(0:N-1, q + 1 - f) == 1
            c[2 * f - 2 : 2 * f] = alpha[~high].sum(), alpha[high].sum()
    else:
        c = alpha
    w = law["multinomials"].ravel() * np.prod(c ** law["exponents"], axis=1)
    W = np.sum(law["W"] * w.reshape(1, 1, -1), axis=2)
    Z = np.sum(law["Z"] * w.reshape(1, 1, -1), axis=2)
    return np.linalg.solve(W.T, Z.T).T @ law["T"]


def law_alpha(law, p):
    alpha = np.ones(1)
    for value, r in zip(p, law["parameters"][0], strict=True):
        low, high = r["low"].item(), r["high"].item()
        s = (value - low) / (high - low)
        if r["inverted"].item():
            s = s * high / value
        s = min(max(s, 0), 1)
        alpha = np.kron(alpha, [1 - s, s])
    return alpha


@pytest.mark.parametrize("name", METHODS)
def test_the_file_gives_the_gain_of_the_law(designs, name, tmp_path):
    design, random = designs[name], np.random.default_rng(1)
    law = loadmat(mat(design, tmp_path / "law.mat"))
    for _ in range(50):
        m1, beta = random.uniform(232, 346), random.uniform(-10, 10)
        own = design.plant.alpha(m1=m1, beta=beta)
        alpha = law_alpha(law, (m1, beta))
        assert np.allclose(alpha, own, rtol=0, atol=1e-14)
        K = law_gain(law, alpha)
        assert np.allclose(K, design.law.gain(own), rtol=1e-10, atol=0)
        A, B = (np.sum(law[M] * alpha, axis=2) for M in "AB")
        assert design.region.contains(np.linalg.eigvals(A + B @ K))
    outside = law_alpha(law, (1000, -99))
    assert np.allclose(outside, design.plant.alpha(clamp=True, m1=1000, beta=-99), atol=1e-15)


def test_what_the_file_holds(designs, physical, tmp_path):
    design = designs["degree 2 on the box"]
    law = loadmat(mat(design, tmp_path / "law.mat"))
    for key, matrices in (("A", physical.A), ("B", physical.B)):
        assert law[key].shape == (*matrices.shape[1:], 4)
        assert all(np.array_equal(law[key][:, :, j], matrices[j]) for j in range(4))
    assert law["E"].shape == (5, 1, 4)
    assert np.array_equal(law["E"][:, :, 3], physical.vertices[3].E)
    T = law["T"]
    for k, W in enumerate(design.law.W):
        assert np.allclose(law["W"][:, :, k], T @ W @ T.T, rtol=0, atol=1e-9)
    middle = np.tensordot(law["multinomials"].ravel() / 16, law["W"], (0, 2))
    assert np.allclose(middle, np.eye(5), rtol=0, atol=1e-9)
    assert law["Z"].shape == (1, 5, 9)
    assert law["degree"].item() == 2
    assert law["sizes"].tolist() == [[2, 2]]
    assert law["exponents"].shape == (9, 4)
    assert law["multinomials"].shape == (9, 1)
    for e, count in zip(law["exponents"], law["multinomials"].ravel(), strict=True):
        assert count == comb(2, int(e[0])) * comb(2, int(e[2]))
    assert [cell.item() for cell in law["states"][0]] == list(physical.states)
    assert [cell.item() for cell in law["inputs"][0]] == ["actuator force [N]"]
    assert law["disturbances"].shape == (1, 1)
    first = law["parameters"][0, 0]
    assert (first["name"].item(), first["unit"].item()) == ("m1", "kg")
    assert first["inverted"].item() == 1
    assert first["low"].item() == float(physical.parameters[0].low)
    assert law["parameters"][0, 1]["inverted"].item() == 0
    assert law["region"].item() == "disk(-40, 36)"
    assert law["statement"].item().startswith("Proved in exact arithmetic: all poles")
    assert "K" not in law
    assert "sample_time" not in law
    fixed = loadmat(mat(designs["one gain"], tmp_path / "fixed.mat"))
    assert np.array_equal(fixed["K"], designs["one gain"].law.K)
    assert not {"W", "Z", "degree"} & set(fixed)


def test_plants_without_names_and_in_discrete_time(tmp_path):
    vertices = [np.diag([0.9, 1.1]) + 0.01 * k for k in range(3)]
    plant = UncertainPlant.from_vertices(
        vertices, [np.eye(2)] * 3, name="é", sample_time=Fraction(1, 8)
    )
    design = place(plant, Disk(0, 0.5), Scheduled(3, 1))
    law = loadmat(mat(design, tmp_path / "law.mat"))
    alpha = np.array([0.2, 0.5, 0.3])
    assert np.allclose(law_gain(law, alpha), design.law.gain(alpha), rtol=1e-12)
    assert law["sizes"].tolist() == [[3]]
    assert law["parameters"].size == law["states"].size == 0
    assert law["sample_time"].item() == 0.125
    assert law["name"].item() == "é"
    assert "E" not in law


def test_laws_whose_lyapunov_matrix_is_nearly_singular(tmp_path):
    """Double integrators with 2 % uncertainty, poles within 0.4 % of -1: cond W above 1e7."""
    random = np.random.default_rng(0)
    A = np.kron(np.array([[0, 1.0], [0, 0]]), np.eye(2)) - 0.1 * np.eye(4, k=-2)
    B = np.vstack([np.zeros((2, 3)), [[0.118, 0.144, 0.148], [0.144, 1.706, -0.756]]])
    As = [A * (1 + 0.02 * random.uniform(-1, 1, A.shape)) for _ in range(2)]
    Bs = [B * (1 + 0.02 * random.uniform(-1, 1, B.shape)) for _ in range(2)]
    design = tightest(UncertainPlant.from_vertices(As, Bs), -1)
    law = loadmat(mat(design, tmp_path / "law.mat"))
    assert np.linalg.cond(design.law.W).max() > 1e7
    assert "NOT" not in law["statement"].item()
    for share in (0, 1, 12, 64):
        alpha = [Fraction(64 - share, 64), Fraction(share, 64)]
        W, Z = (
            mix(alpha, [[[Fraction(e) for e in row] for row in m] for m in each.tolist()])
            for each in (design.law.W, design.law.Z)
        )
        K = np.array(right_divide(Z, W), dtype=float)
        assert np.allclose(law_gain(law, np.array(alpha, dtype=float)), K, rtol=1e-10, atol=0)


def test_what_is_not_proved_says_so(designs):
    design = designs["paper"]
    assert statement(Design(design.certificate, proved=False)).startswith("NOT PROVED")


def test_the_same_design_makes_the_same_file(designs, tmp_path):
    one, two = (mat(designs["paper"], tmp_path / name) for name in ("a.mat", "b.mat"))
    assert one.read_bytes() == two.read_bytes()
    assert one.read_bytes()[:124].startswith(b"MATLAB 5.0 MAT-file, written by polefence ")
    with pytest.raises(OutputError, match="cannot be written"):
        mat(designs["paper"], tmp_path / "nowhere" / "law.mat")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mat", "b.mat"]


def test_a_negative_parameter_through_its_inverse(tmp_path):
    parameters = [Parameter("p", -2, "-1/2", "", "1/p"), Parameter("k", 1, 2)]
    plant = UncertainPlant.from_expressions(parameters, [["1/p", "k"], [0, 1]], [[0], ["k"]])
    design = place(plant, Disk(-3, 2.5), "scheduled")
    law = loadmat(mat(design, tmp_path / "law.mat"))
    for p in (-2, -1.3, -0.5):
        own = plant.alpha(p=p, k=1.25)
        assert np.allclose(law_alpha(law, (p, 1.25)), own, atol=1e-15)
        assert np.allclose(law_gain(law, own), design.law.gain(own), rtol=1e-12)


@pytest.mark.parametrize(("kind", "order"), [("affine", 1), ("one gain", 1), ("pid", 2)])
def test_a_law_with_states_of_its_own_says_how_many(kind, order, tmp_path):
    """And its rates are the last inputs, those of a PID too: A + B K is the design's loop."""
    own = dynamic(kind)
    law = loadmat(mat(own, tmp_path / "law.mat"))
    assert law["order"].item() == order
    alpha = own.plant.alpha(**CORNER)
    A, B = own.plant.at(alpha)
    larger, rates = (np.tensordot(law[key], alpha, 1) for key in "AB")
    assert not np.any(larger[-order:])
    assert np.array_equal(rates[-order:, -order:], np.eye(order))
    if kind == "one gain":
        K = law["K"]
    else:  # at a corner all coordinates are -1 or 1
        assert law["gains"].shape[2] == 3
        c = own.law.domain.coordinates(np.array(alpha, dtype=float))
        terms = np.prod((c[1::2] - c[::2]) ** law["powers"], axis=1)
        K = np.tensordot(law["gains"], terms, 1) @ np.atleast_3d(law["C"])[:, :, 0]
    assert np.allclose(larger + rates @ K, A + B @ own.law.gain(alpha))
