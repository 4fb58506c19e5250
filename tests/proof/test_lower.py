"""Lower bounds: the dual equations against the conditions' pencils, repair, and the verifier."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import Scheduled
from polefence.certify import repair
from polefence.lmi.conditions.methods import build, method_name
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve.smallest import smallest
from polefence.proof import lower

RIGHT = Scheduled(right_hand_sides=True)
METHODS = ["quadratic", "slack", "scheduled", RIGHT]
NAMES = [str(method) for method in METHODS]
# Infima at centre -40 from a multiprecision reference, and half of the last digit shown.
REFERENCE = {
    ("as_printed", "quadratic"): (33.6439, 5e-5),
    ("as_printed", "slack"): (33.5019, 5e-5),
    ("as_printed", "scheduled"): (29.0992, 5e-5),
    ("physical", "quadratic"): (34.84241, 5e-6),
    ("physical", "slack"): (34.29901, 5e-6),
    ("physical", "scheduled"): (29.07548, 5e-6),
}


def rational(matrices):
    return [[[Fraction(float(e)) for e in row] for row in M] for M in matrices]


def infimum(method, A, B, sigma):
    """The radius that the solver finds, and its dual matrices in the plant's coordinates."""
    found = smallest(
        np.asarray(A, dtype=float),
        np.asarray(B, dtype=float),
        Disks(-sigma),
        method,
        engine="numpy",
    )
    return found.r, found.dual.matrices()


def bound(method, A, B, sigma, exact_A=None, exact_B=None):
    upper, Y = infimum(method, A, B, sigma)
    exact_A, exact_B = exact_A or rational(A), exact_B or rational(B)
    claim = repair.lower_bound(
        method_name(method), exact_A, exact_B, Fraction(sigma), upper, Y, method is RIGHT
    )
    return upper, claim


@pytest.fixture(scope="module")
def claims(make_random):
    """A proved claim of each kind for two-state plants with two inputs and three vertices."""
    plant = make_random(5, 2, 1, 3)
    found = {str(method): bound(method, plant.A, plant.B, 3.0)[1] for method in METHODS}
    assert all(lower.prove_infeasible(claim).proved for claim in found.values())
    return found


# --- theory --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize(("n", "m", "N"), [(2, 1, 3), (3, 2, 4), (1, 1, 1), (2, 2, 2)])
def test_the_equations_are_the_adjoint_of_the_condition(method, n, m, N):
    """<Y, F(x)> of the pencil is what the left-hand sides of the equations say, for random Y, x."""
    random = np.random.default_rng(n + 10 * m + 100 * N)
    name = method_name(method)
    A, B = random.integers(-4, 5, (N, n, n)), random.integers(-4, 5, (N, n, m))
    pencil = build(method, A.astype(float), B.astype(float), 3.0)
    values = {}
    for v in pencil.variables:
        X = random.normal(size=v.shape)
        values[v.name] = X + X.T if v.symmetric else X
    r = 2.5
    F = pencil.matrices(pencil.pack(values), r)
    F.pop("tau", None)
    pairs = lower.block_pairs(name, N)
    assert len(F) == len(pairs)
    Y = random.integers(-9, 10, (len(pairs), 2 * n, 2 * n))
    Y = Y + Y.swapaxes(1, 2)
    theirs = sum(np.vdot(y, f) for y, f in zip(Y, F.values(), strict=True))

    P, X, R = lower._parts(Y.tolist(), n)
    plant = lower._Plant.of(rational(A), rational(B), Fraction(3))
    products = [(np.array(v), np.array(z)) for v, z in lower._products(plant, pairs, X)]
    ours = -2 * sum(
        np.vdot(z, values[key])
        for key, (_, z) in zip([v for v in values if v[0] in "ZL"], products, strict=True)
    )
    if name == "slack":
        V = products[0][0]
        ours += np.vdot(2 * r * sum(np.array(x) for x in R) - 2 * V, values["G"])
        for j in range(N):
            ours += r * np.vdot(np.array(P[j]) - np.array(R[j]), values[f"P{j + 1}"])
    else:
        sums = lower._weights(pairs, [lower._plus(p, q) for p, q in zip(P, R, strict=True)])
        for key, (V, _), total in zip(
            [v for v in values if v[0] == "W"], products, sums, strict=True
        ):
            ours += np.vdot(r * np.array(total) - V - V.T, values[key])
    if "tau" in values:
        bracket = lower._bracket(N, [lower._trace(p) for p in P]) / max(N - 1, 1) ** 2
        ours -= bracket * values["tau"][0, 0]
    assert ours == pytest.approx(theirs, rel=1e-9)


def test_a_certificate_by_hand():
    """x' = a x + u, a = -1 or 3: r = 2, by Y_1, Y_2 with P = R = X = 1 or -1 at the limit."""
    A, B = [[[Fraction(-1)]], [[Fraction(3)]]], [[[Fraction(1)]]] * 2
    for r, proved in ((Fraction(19, 10), True), (Fraction(2), False), (Fraction(21, 10), False)):
        p = 2 / r  # r (2 p + 2 p) = 2 (3 + sigma) - 2 (-1 + sigma) = 8
        Y = [[[p, x], [x, p]] for x in (Fraction(-1), Fraction(1))]
        claim = lower.Infeasible("quadratic", A, B, Fraction(5), r, Y)
        assert lower.prove_infeasible(claim).proved is proved
        assert lower.prove_infeasible(replace(claim, method="slack")).proved is proved


# --- bounds --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("family", ["as_printed", "physical"])
def test_the_car_at_centre_40(family, method, request):
    plant = request.getfixturevalue(family)
    exact_A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    exact_B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    upper, claim = bound(method, plant.A, plant.B, 40.0, exact_A, exact_B)
    infimum, digit = REFERENCE[family, method_name(method)]
    assert upper * (1 - 1e-5) <= claim.r < upper
    assert claim.r <= infimum + digit
    assert lower.prove_infeasible(claim).proved


SCALARS = [
    ((-1, 3), (1, 1), 5.0, 2.0),  # half the interval of poles
    ((0.5, 0.75), (1, 1), 0.125, 0.125),
    ((2, 2), (1, 3), 3.0, 2.5),  # |a + sigma| (b2 - b1) / (b2 + b1)
    ((1, 2), (0, 1), 3.0, 4.0),  # no input at one vertex
]


@pytest.mark.parametrize("method", ["quadratic", "slack"])
@pytest.mark.parametrize(("a", "b", "sigma", "infimum"), SCALARS)
def test_scalar_plants_are_bracketed(method, a, b, sigma, infimum):
    upper, claim = bound(method, [[[v]] for v in a], [[[v]] for v in b], sigma)
    assert infimum * (1 - 1e-6) <= claim.r < infimum <= upper <= infimum * (1 + 1e-6)


CASES = [(1, 3, 2, 2), (3, 3, 1, 3), (4, 2, 1, 5), (5, 3, 2, 4), (7, 4, 3, 3)]


@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize(("seed", "n", "m", "N"), CASES)
def test_random_plants(seed, n, m, N, method, make_random):
    plant = make_random(seed, n, m, N)
    upper, claim = bound(method, plant.A, plant.B, 3.0)
    assert upper * (1 - 2e-3) <= claim.r < upper
    assert lower.prove_infeasible(claim).proved


def test_dependent_inputs_and_a_vertex_without_input(make_random):
    plant = make_random(3, 3, 1, 3)
    for method in METHODS:
        upper, claim = bound(method, plant.A, np.repeat(plant.B, 2, axis=2), 3.0)
        assert claim.r > upper * (1 - 1e-4)


def test_units_change_nothing(make_random):
    plant = make_random(3, 3, 1, 3)
    U = np.diag([2.0**-10, 1.0, 2.0**13])
    A, B = np.linalg.inv(U) @ plant.A @ U, np.linalg.inv(U) @ plant.B
    for method in METHODS:
        upper, claim = bound(method, A, B, 3.0)
        assert claim.r > upper * (1 - 1e-5)


def test_what_cannot_be_repaired_is_none(make_random):
    plant = make_random(2, 2, 1, 3)
    A, B, sigma = rational(plant.A), rational(plant.B), Fraction(3)
    upper, Y = infimum("quadratic", plant.A, plant.B, 3.0)
    r = Fraction(upper)
    assert repair.repaired("quadratic", A, B, sigma, r * Fraction(99999, 100000), Y) is not None
    assert repair.repaired("quadratic", A, B, sigma, r * Fraction(101, 100), Y) is None
    assert repair.repaired("quadratic", A, B, sigma, Fraction(0), Y) is None
    for wrong in (Y[:2], Y[:, :3, :3], -Y, 0 * Y, Y * np.nan, np.roll(Y, 1, axis=1)):
        assert repair.repaired("quadratic", A, B, sigma, r * Fraction(999, 1000), wrong) is None
        assert repair.lower_bound("quadratic", A, B, sigma, upper, wrong) is None


# --- one fault at a time into the verifier -------------------------------------------------------


def edited(matrices, b, i, j, value, symmetric=True):
    matrices = [[row[:] for row in M] for M in matrices]
    matrices[b][i][j] += value
    if symmetric and i != j:
        matrices[b][j][i] += value
    return matrices


@pytest.mark.parametrize("method", NAMES)
def test_every_entry_of_the_evidence_and_of_the_plant_counts(claims, method):
    claim = claims[method]
    step = Fraction(1, 10**30)
    for b in range(len(claim.Y)):
        if not any(map(any, claim.Y[b])):
            continue
        for i in range(4):
            for j in range(i, 4):
                tried = replace(claim, Y=edited(claim.Y, b, i, j, claim.Y[b][i][i] * step))
                assert not lower.prove_infeasible(tried).proved
    for name in "AB":
        for j in range(3):
            for i in range(2):
                for c in range(2 if name == "A" else 1):
                    matrices = edited(getattr(claim, name), j, i, c, step, symmetric=False)
                    assert not lower.prove_infeasible(replace(claim, **{name: matrices})).proved


def faults(claim):
    Y = claim.Y
    upper_left = [[[-e for e in row] for row in Y[0]], *Y[1:]]
    zero = [[[0 * e for e in row] for row in block] for block in Y]
    yield "asymmetric", {"Y": edited(Y, 0, 0, 1, Fraction(1), symmetric=False)}, "not symmetric"
    yield "negative", {"Y": upper_left}, "not positive definite"
    yield "all negative", {"Y": [[[-e for e in row] for row in y] for y in Y]}, "not positive"
    yield "all zero", {"Y": zero}, "all dual matrices are zero"
    yield "one missing", {"Y": Y[:-1]}, "not one for each"
    yield "one too many", {"Y": [*Y, Y[0]]}, "not one for each"
    yield "shape", {"Y": [[row[:-1] for row in Y[0]], *Y[1:]]}, "fit together"
    yield "rows", {"Y": [Y[0][:-1], *Y[1:]]}, "fit together"
    yield "plant", {"A": [[row[:1] for row in claim.A[0]], *claim.A[1:]]}, "fit together"
    yield "no plant", {"A": [], "B": [], "Y": []}, "vertices are missing"
    yield "one B missing", {"B": claim.B[1:]}, "vertices are missing"
    yield "larger radius", {"r": claim.r * Fraction(1001, 1000)}, "does not hold"
    yield "smaller radius", {"r": claim.r * Fraction(999, 1000)}, "does not hold"
    yield "no radius", {"r": Fraction(0)}, "not positive"
    yield "negative radius", {"r": -claim.r}, "not positive"
    yield "centre", {"sigma": claim.sigma + 1}, "does not hold"
    yield "vertices in another order", {"A": claim.A[::-1]}, "does not hold"
    yield "unknown method", {"method": "cubic"}, "is not one of"
    for other in lower.METHODS:
        # what the slack condition cannot reach, the quadratic one cannot either
        implied = (claim.method, other) == ("slack", "quadratic")
        if other != claim.method and not claim.right_hand_sides and not implied:
            yield f"method {other}", {"method": other}, "equation|not one for each"
    if claim.method != "scheduled":
        yield "right-hand sides", {"right_hand_sides": True}, "belong to the scheduled"


@pytest.mark.parametrize("method", NAMES)
def test_faults_are_refused_by_name(claims, method):
    for name, change, reason in faults(claims[method]):
        verdict = lower.prove_infeasible(replace(claims[method], **change))
        assert not verdict.proved, name
        assert re.search(reason, verdict.reason), (name, verdict.reason)


def test_equal_diagonal_blocks_matter_to_the_slack_condition(claims):
    """The equation of P alone: P + e, R - e keeps every sum."""
    claim = claims["slack"]
    e = claim.Y[0][0][0] / 10**20
    tried = replace(claim, Y=edited(edited(claim.Y, 0, 0, 0, e), 0, 2, 2, -e))
    assert "of a P" in lower.prove_infeasible(tried).reason
    assert lower.prove_infeasible(replace(tried, method="quadratic")).proved
    assert "of W" in lower.prove_infeasible(replace(claims["quadratic"], r=Fraction(1))).reason


def test_the_skew_part_matters_to_the_slack_condition():
    """For one vertex G asks r R = S'X, W only for twice the symmetric part of S'X."""
    S = [[Fraction(0), Fraction(1)], [Fraction(-1), Fraction(0)]]
    half, none = Fraction(1, 2), [[Fraction(0)], [Fraction(0)]]
    for skew, proved in ((Fraction(0), True), (Fraction(1, 4), False)):
        X = [[-skew, half], [-half, -skew]]  # S'X = I / 2 + skew S
        Y = [[Fraction(int(i == j)) for j in range(4)] for i in range(4)]
        for i in range(2):
            for j in range(2):
                Y[i][2 + j] = Y[2 + j][i] = X[i][j]
        claim = lower.Infeasible("slack", [S], [none], Fraction(0), half, [Y])
        assert lower.prove_infeasible(claim).proved is proved
        assert lower.prove_infeasible(replace(claim, method="quadratic")).proved


def test_the_sign_of_taus_inequality(claims):
    """Without right-hand sides tau has no equation; with them a negative bracket is refused."""
    claim = claims[str(RIGHT)]
    N, n = 3, 2
    traces = [sum(y[i][i] for i in range(n)) for y in claim.Y]
    assert lower._bracket(N, traces) >= 0
    assert lower._bracket(2, [1, 1, 3, 0]) == -1
    assert lower._bracket(3, [1, 1, 1, *[0] * 6, 3]) == -6
    assert lower.prove_infeasible(replace(claim, right_hand_sides=False)).proved


def test_work_out_of_proportion_is_refused(claims):
    claim = claims["scheduled"]
    tried = replace(claim, A=claim.A[:1] * 400, B=claim.B[:1] * 400)
    assert "too many to be checked" in lower.prove_infeasible(tried).reason
    tried = replace(claim, sigma=Fraction(1, 10**7000 + 1))
    assert "common denominator is too large" in lower.prove_infeasible(tried).reason
