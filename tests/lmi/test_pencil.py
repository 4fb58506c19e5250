"""Each condition's pencil against the paper's own displays, built here by hand."""

from itertools import combinations, permutations

import numpy as np
import pytest

from polefence import InputError, Scheduled, build
from polefence.lmi.conditions.pencil import Variable, smat, svec

RANDOM = np.random.default_rng(11)
SIGMA, R = 3.0, 1.7
D_ = SIGMA - R  # the paper's d


def symmetric(n):
    X = RANDOM.normal(size=(n, n))
    return X @ X.T + np.eye(n)


def case(n, m, N):
    return RANDOM.normal(size=(N, n, n)), RANDOM.normal(size=(N, n, m))


def paper_form(block, n):
    """From [[rW, -M], [-M', rW]] > 0, M = X + rW, to the paper's [[X + X', X], [X', -rW]] < 0.

    The congruence is p = u, q = u + v; the theory page derives it.
    """
    T = np.block([[np.eye(n), np.zeros((n, n))], [np.eye(n), np.eye(n)]])
    return -(T.T @ block @ T)


SHAPES = [(1, 1, 1), (2, 1, 2), (3, 2, 3), (2, 2, 5)]


@pytest.mark.parametrize(("n", "m", "N"), SHAPES)
def test_quadratic_is_equation_8(n, m, N):
    A, B = case(n, m, N)
    pencil = build("quadratic", A, B, SIGMA)
    W, Z = symmetric(n), RANDOM.normal(size=(m, n))
    blocks = pencil.matrices(pencil.pack({"W": W, "Z": Z}), R)
    assert len(blocks) == N
    for j in range(N):
        X = A[j] @ W + B[j] @ Z + D_ * W
        expected = np.block([[X + X.T, X], [X.T, -R * W]])
        assert np.allclose(paper_form(blocks[f"(8) j={j + 1}"], n), expected)


@pytest.mark.parametrize(("n", "m", "N"), SHAPES)
def test_slack_is_equation_10(n, m, N):
    A, B = case(n, m, N)
    pencil = build("slack", A, B, SIGMA)
    P = [symmetric(n) for _ in range(N)]
    G, L = RANDOM.normal(size=(n, n)), RANDOM.normal(size=(m, n))
    values = {f"P{j + 1}": P[j] for j in range(N)} | {"G": G, "L": L}
    blocks = pencil.matrices(pencil.pack(values), R)
    for j in range(N):
        M = A[j] @ G + B[j] @ L + SIGMA * G
        paper = np.block([[-R * P[j], M], [M.T, R * (P[j] - G - G.T)]])
        assert np.allclose(-blocks[f"(10) j={j + 1}"], paper)


@pytest.mark.parametrize("rhs", [False, True])
@pytest.mark.parametrize(("n", "m", "N"), SHAPES)
def test_scheduled_is_equations_15_to_17(n, m, N, rhs):
    A, B = case(n, m, N)
    Ad = A + D_ * np.eye(n)
    W = [symmetric(n) for _ in range(N)]
    Z = [RANDOM.normal(size=(m, n)) for _ in range(N)]
    pencil = build(Scheduled(right_hand_sides=rhs), A, B, SIGMA)
    values = {f"W{j + 1}": W[j] for j in range(N)} | {f"Z{j + 1}": Z[j] for j in range(N)}
    if rhs:
        values["tau"] = np.array([[1.0]])
    blocks = pencil.matrices(pencil.pack(values), R)
    assert len(blocks) == N + N * (N - 1) + N * (N - 1) * (N - 2) // 6 + rhs
    one = np.zeros((2 * n, 2 * n))
    one[:n, :n] = rhs * np.eye(n)
    square = max(N - 1, 1) ** 2

    def part(j, k):
        return Ad[j] @ W[k] + B[j] @ Z[k]

    def left(corner, lower):
        return np.block([[corner + corner.T, corner], [corner.T, -R * lower]])

    for j in range(N):
        expected = left(part(j, j), W[j]) + one
        assert np.allclose(paper_form(blocks[f"(15) j={j + 1}"], n), expected)
    for j, k in permutations(range(N), 2):
        corner = part(j, j) + part(j, k) + part(k, j)
        expected = left(corner, 2 * W[j] + W[k]) - one / square
        assert np.allclose(paper_form(blocks[f"(16) j={j + 1} k={k + 1}"], n), expected)
    for j, k, l in combinations(range(N), 3):  # noqa: E741
        corner = sum(part(p, q) for p, q in permutations((j, k, l), 2))
        expected = left(corner, 2 * (W[j] + W[k] + W[l])) - 6 * one / square
        name = f"(17) j={j + 1} k={k + 1} l={l + 1}"
        assert np.allclose(paper_form(blocks[name], n), expected)


def test_the_scheduled_blocks_are_the_coefficients_of_the_cubic_form():
    """Sum of blocks times monomials equals the condition at alpha itself, for random alpha."""
    n, m, N = 3, 2, 4
    A, B = case(n, m, N)
    pencil = build("scheduled", A, B, SIGMA)
    x = RANDOM.normal(size=pencil.unknowns)
    v, blocks = pencil.unpack(x), pencil.matrices(x, R)
    for a in RANDOM.dirichlet(np.ones(N), 10):
        total = sum(a[j] ** 3 * blocks[f"(15) j={j + 1}"] for j in range(N))
        total = total + sum(
            a[j] ** 2 * a[k] * blocks[f"(16) j={j + 1} k={k + 1}"]
            for j, k in permutations(range(N), 2)
        )
        total = total + sum(
            a[j] * a[k] * a[l] * blocks[f"(17) j={j + 1} k={k + 1} l={l + 1}"]
            for j, k, l in combinations(range(N), 3)  # noqa: E741
        )
        W = sum(a[j] * v[f"W{j + 1}"] for j in range(N))
        Z = sum(a[j] * v[f"Z{j + 1}"] for j in range(N))
        M = np.tensordot(a, A, 1) @ W + np.tensordot(a, B, 1) @ Z + SIGMA * W
        assert np.allclose(total, np.block([[R * W, -M], [-M.T, R * W]]))


def test_pack_and_unpack_are_inverse():
    A, B = case(3, 2, 2)
    for method in ("quadratic", "slack", "scheduled"):
        pencil = build(method, A, B, SIGMA)
        x = RANDOM.normal(size=pencil.unknowns)
        assert np.array_equal(pencil.pack(pencil.unpack(x)), x)


def test_svec_keeps_inner_products_and_smat_undoes_it():
    X, Y = symmetric(4), symmetric(4)
    assert np.isclose(svec(X) @ svec(Y), np.trace(X @ Y))
    assert np.allclose(smat(svec(X)), X)


def test_a_pencil_prints_its_variables_and_blocks():
    text = str(build("scheduled", *case(2, 1, 3), SIGMA))
    for words in ("15 unknowns", "variable Z3: 1 x 2", "block (17) j=1 k=2 l=3: 4 x 4"):
        assert words in text


def test_symmetric_variables_count_their_triangle():
    assert Variable("W", (4, 4), symmetric=True).size == 10
    assert Variable("G", (4, 4)).size == 16


@pytest.mark.parametrize("method", ["quadratc", "", None, 3])
def test_unknown_methods_are_refused_with_a_suggestion(method):
    with pytest.raises(InputError, match="unknown"):
        build(method, *case(2, 1, 2), SIGMA)


@pytest.mark.parametrize(
    "given",
    [
        {"degree": -1},
        {"degree": 1.0},
        {"degree": 99},
        {"elevation": "auto"},
        {"on": "ball"},
        {"degree": 2, "right_hand_sides": True},
    ],
)
def test_forms_that_there_are_not_are_refused(given):
    with pytest.raises(InputError):
        Scheduled(**given)
