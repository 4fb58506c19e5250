"""Errors of each gain: the verifier's inequality against Petersen's lemma, and one fault each."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from polefence import (
    Disk,
    FixedGain,
    HalfPlane,
    Sector,
    UncertainPlant,
    VerticalStrip,
    analyse,
)
from polefence.certify.margins import gain_error, in_service
from polefence.law.laws import PolynomialGain
from polefence.plant.larger import with_states
from polefence.plant.spec import loads
from polefence.proof.__main__ import main as check_file
from polefence.proof.claims.base import prove
from polefence.proof.polynomials import basis
from polefence.proof.work import FormatError
from support.files import only_claim_in

REGIONS = {
    "half-plane": HalfPlane(0.1),
    "disk": Disk(-6, 5.95),
    "parts": HalfPlane(0.05) & Sector(0.05) & VerticalStrip(-40, -0.01),
}


SPRING = """
name = "spring"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
[parameter.m]
range = [1, 2]
unit = "kg"
through = "1/m"
[parameter.k]
range = [4, 9]
[matrices]
A = [[0, 1], ["-k/m", "-6/m"]]
B = [[0], ["1/m"]]
[outputs]
"pull [m/s2]" = {C = ["-k/m", "-6/m"]}
"""


def with_a_filter(region):
    """A law of order 1 of the position and the pull, which differs with the parameters."""
    plant = with_states(loads(SPRING), 1)
    y = tuple(map(plant.signal, ["x", "pull", "law state 1"]))
    # u = -2 x - 0.1 a - z, z' = -3 z + x
    gains = np.array([[[-2.0, -0.1, -1.0], [1.0, 0.0, -3.0]]])
    law = PolynomialGain(((0, 0),), gains, y, plant.parameters)
    return analyse(plant, law, region).design


@pytest.fixture(scope="module", params=REGIONS)
def design(request):
    return with_a_filter(REGIONS[request.param])


@pytest.fixture(scope="module")
def margins(design):
    return {own: gain_error(design, own_states=own) for own in (False, True)}


@pytest.mark.parametrize("own", [False, True])
def test_errors_of_what_is_measured_keep_the_region(design, margins, own):
    """Of every sign at the corners and between; the pull is of both states."""
    margin, random = margins[own], np.random.default_rng(1)
    assert margin.proved
    gains = design.law.gains[0]
    sizes = np.array(margin.claim.sizes, dtype=float)
    rows = slice(1, 2) if own else slice(0, 1)
    assert np.array_equal(sizes[rows], np.abs(gains[rows]))
    assert not np.delete(sizes, rows, axis=0).any()
    shares = [*product((0.0, 1.0), repeat=2), *random.uniform(size=(20, 2))]
    off = np.argwhere(sizes > 0)
    for s, t in shares:
        alpha = np.kron([1 - s, s], [1 - t, t])
        A, B = design.plant.at(alpha)
        C = np.tensordot(alpha, design.law.C, 1)
        for signs in product((-1, 1), repeat=len(off)):
            K = gains.copy()
            K[off[:, 0], off[:, 1]] *= 1 + margin.value * np.array(signs)
            assert design.region.contains(np.linalg.eigvals(A + B @ K @ C))
    assert margin.upper is None or margin.value < margin.upper < 3 * margin.value


@pytest.mark.parametrize("own", [False, True])
def test_the_inequality_is_petersens_lemma_for_each_gain(design, margins, own):
    """The Schur complement, with the multiplier of every gain by itself."""
    claim = margins[own].claim
    found = [one for one in claim.inequalities() if len(one.rows) == 3]
    pairs = design.region.pairs()
    assert len(found) == len(pairs) == len(claim.mu)
    plant, law, e = design.plant, design.law, float(claim.error)
    random = np.random.default_rng(2)
    s, t = random.uniform(size=2)
    at, alpha = [1 - s, s, 1 - t, t], np.kron([1 - s, s], [1 - t, t])
    A, B = plant.at(alpha)
    K, C = law.gain(alpha), np.tensordot(alpha, law.C, 1)
    parts = [k for k, part in enumerate(design.region.parts) for _ in part.pairs()]
    for k, ((L, M), one) in enumerate(zip(pairs, found, strict=True)):
        evidence = claim.subject.design.evidence[parts[k]]
        degree = evidence.degree
        weights = basis([Fraction(x) for x in at], (2, 2), degree)
        X = sum(
            float(w) * np.array(Q, dtype=float) for w, Q in zip(weights, evidence.X, strict=True)
        )
        N = (A + B @ K) @ X
        F = -(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T))
        kept = M.any(axis=0)
        M1, M2 = M[:, kept], np.eye(len(M))[kept]
        for i, j in np.argwhere(np.array(claim.sizes) > 0):
            mu, size = float(claim.mu[k][i][j]), float(claim.sizes[i][j])
            E = np.kron(M1, B[:, [i]])
            H = np.kron(M2.T, X @ C[[j]].T) * e * size
            F = F - mu * E @ E.T - H @ H.T / mu
        whole = value_of(one.rows, at)
        d = len(F)
        schur = whole[:d, :d] - whole[:d, d:] @ np.linalg.solve(whole[d:, d:], whole[d:, :d])
        assert np.allclose(schur, F, rtol=1e-8, atol=1e-10 * np.abs(F).max())


def value_of(blocks, at):
    """A symmetric block matrix of polynomials, each over the sums of its coordinates."""
    rows = [np.array(0.0)] * len(blocks)
    sizes = [row[0].shape[0] for row in blocks]
    cuts = np.cumsum([0, *sizes])
    whole = np.zeros((cuts[-1], cuts[-1]))
    for i, row in enumerate(blocks):
        for j, P in enumerate(row, i):
            value = np.zeros(P.shape)
            for exponent, matrix in P.terms.items():
                weight = np.prod(np.power(at, exponent))
                value = value + weight * np.array(matrix, dtype=float) / P.whole
            whole[cuts[i] : cuts[i + 1], cuts[j] : cuts[j + 1]] = value
            whole[cuts[j] : cuts[j + 1], cuts[i] : cuts[i + 1]] = value.T
    assert len(rows) == len(blocks)
    return whole


@pytest.mark.parametrize("own", [False, True])
def test_one_fault_at_a_time(design, margins, own, tmp_path):
    claim = margins[own].claim
    assert prove(claim).proved
    assert not prove(replace(claim, error=claim.error * Fraction(11, 10))).proved
    for i, j in np.argwhere(np.array(claim.sizes) > 0):
        sizes = [list(row) for row in claim.sizes]
        sizes[i][j] *= 3
        assert not prove(replace(claim, sizes=tuple(map(tuple, sizes)))).proved
    for k, mu in enumerate(claim.mu):
        for factor in (Fraction(1, 1000), 1000):
            moved = tuple(tuple(factor * x for x in row) for row in mu)
            every = (*claim.mu[:k], moved, *claim.mu[k + 1 :])
            assert not prove(replace(claim, mu=every)).proved
    path = tmp_path / "gain.json"
    document = json.loads(margins[own].file(design).dumps())
    path.write_text(json.dumps(document))
    assert check_file([str(path)]) == 0
    # what the law measures is part of the claim
    (pull,) = document["plant"]["outputs"]
    pull["C"] = [[4 * eval(str(x)) for x in row] for row in pull["C"]]
    assert not prove(only_claim_in(json.dumps(document))).proved


def test_what_does_not_fit_is_refused(design, margins):
    claim = margins[False].claim
    zero = tuple((Fraction(0),) * 3 for _ in range(2))
    for change, message in (
        ({"sizes": zero}, "not all zero"),
        ({"sizes": ((Fraction(1),) * 3,)}, "must be 2 x 3"),
        ({"mu": (zero,) * len(claim.mu)}, "mu must be positive"),
        ({"mu": claim.mu * 2}, "mu must hold"),
        ({"error": Fraction(-1)}, "error must be zero or more"),
    ):
        with pytest.raises(FormatError, match=message):
            prove(replace(claim, **change))


def test_zero_columns_and_dead_states_have_no_part(capsys):
    """One gain of two inputs that leaves out a state; the units of the states do not matter."""
    A, B = [[0, 1, 0], [-4, -1, 1], [0, 0, -2]], [[0, 0], [1, 0], [0, 1]]
    K = np.array([[-3.0, 0.0, 0.5], [0.0, 0.0, -1.0]])
    found = []
    for scale in (1.0, 1e5):
        T = np.diag([1.0, scale, 1 / scale])
        plant = UncertainPlant.from_vertices(
            [T @ np.array(A) @ np.linalg.inv(T)], [T @ np.array(B, dtype=float)]
        )
        made = analyse(plant, FixedGain(K @ np.linalg.inv(T)), HalfPlane(0)).design
        service = in_service(made)
        assert [own.name for own in service] == ["gain", "rate"]
        found.append(service["gain"])
    one, other = found
    assert np.count_nonzero(np.array(one.claim.sizes, dtype=float)) == 3
    assert one.value == pytest.approx(other.value, rel=0.05)
    assert one.upper == pytest.approx(other.upper, rel=0.01)
    assert one.value < one.upper < 3 * one.value


VAN = """
name = "van"
states = ["deflection [m]", "tyre [m]", "body [m/s]", "wheel [m/s]", "force [N]"]
inputs = ["demand [N]"]
[constants]
m2 = 48
c = 1400
w = 251
[parameter.m1]
range = [280, 620]
unit = "kg"
through = "1/m1"
[parameter.k]
range = [18700, 25300]
unit = "N/m"
[matrices]
A = [
    [0, 0, -1, 1, 0],
    [0, 0, 0, -1, 0],
    ["k/m1", 0, "-c/m1", "c/m1", "1/m1"],
    ["-k/m2", "210000/m2", "c/m2", "-c/m2", "-1/m2"],
    [0, 0, 0, 0, "-w"],
]
B = [[0], [0], [0], [0], ["w"]]
[outputs]
"acceleration [m/s2]" = {C = ["k/m1", 0, "-c/m1", "c/m1", "1/m1"]}
"""


def test_a_law_with_a_filter_of_an_acceleration_bears_half_of_every_gain():
    """In states its rows cancel one another: errors of the gains of signals are what matters."""
    plant = with_states(loads(VAN), 1)
    y = tuple(map(plant.signal, ["deflection", "acceleration", "law state 1"]))
    gains = np.array([[[13743.7, -826.763, -5720.96], [0.0, 1.58145, -1.58145]]])
    made = analyse(plant, PolynomialGain(((0, 0),), gains, y, plant.parameters), HalfPlane(0))
    service = in_service(made.design)
    for name, least in (("gain", 0.5), ("gain-law-states", 0.6)):
        margin = service[name]
        assert least < margin.value < margin.upper < 3 * margin.value
    random = np.random.default_rng(3)
    for name in ("gain", "gain-law-states"):
        sizes = np.array(service[name].claim.sizes, dtype=float)
        for v in range(4):
            A, B, C = plant.A[v], plant.B[v], made.law.C[v]
            off = random.uniform(-1, 1, (500, *sizes.shape)) * service[name].value * sizes
            assert np.linalg.eigvals(A + B @ (gains[0] + off) @ C).real.max() < 0
