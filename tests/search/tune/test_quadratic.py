"""Quadratic programs: their optimality conditions, both engines alike, and no way to misuse one."""

import numpy as np
import pytest

from polefence.base.kernel import kernel as built
from polefence.search.tune.quadratic import minimum, reference

kernel = built()
compiled = pytest.mark.skipif(kernel is None, reason="installed without a compiler: no kernel")
REACH = 0.3
ENGINES = {"numpy": reference}
if kernel is not None:
    ENGINES["compiled"] = kernel.minimum
    ENGINES["plain"] = lambda *own: kernel.minimum(*own, plain=True)


def program(seed, n, m):
    """As a descent asks it: the largest of some rows, and the excess of others, over x in reach."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, n))
    P, G = np.zeros((n + 2, n + 2)), np.zeros((m + 1, n + 2))
    P[:n, :n] = 0.1 * root @ root.T / n
    G[:m, :n] = random.normal(size=(m, n))
    G[: m // 2, n] = G[m // 2 :, n + 1] = -1.0
    q = np.append(np.zeros(n), [1.0, 10.0])
    return P, q, G, np.append(random.uniform(-0.5, 1.0, size=m), 0.0), REACH, n


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("seed", "n", "m"), [(1, 1, 2), (2, 2, 9), (3, 8, 40), (4, 25, 7), (5, 40, 90)]
)
def test_the_answer_is_optimal(engine, seed, n, m):
    P, q, G, h, reach, bounded = own = program(seed, n, m)
    x, z = ENGINES[engine](*own)
    assert np.all(G @ x <= h + 1e-8)
    assert np.abs(x[:bounded]).max() <= reach + 1e-8
    assert np.all(z >= 0)
    assert np.abs(z * (h - G @ x)).max() < 1e-6
    # what is left of the slope pushes against the reach, or is nothing
    slope = P @ x + q + G.T @ z
    inside = np.append(np.abs(x[:bounded]) < reach - 1e-5, [True, True])
    assert np.abs(slope[inside]).max() < 1e-6
    assert np.all(slope[~inside] * x[~inside] < 1e-6)


@pytest.mark.parametrize(("n", "m"), [(1, 2), (5, 40), (20, 200)])
def test_one_without_reach_is_optimal(n, m):
    random = np.random.default_rng(n)
    half = random.normal(size=(n, n))
    P, q, G = half @ half.T + 0.1 * np.eye(n), 5 * random.normal(size=n), random.normal(size=(m, n))
    h = random.uniform(0, 1, m)
    x, z = minimum(P, q, G, h)
    assert (G @ x - h).max() < 1e-8
    assert z.min() >= 0
    assert np.abs(P @ x + q + G.T @ z).max() < 1e-7
    assert abs(z @ (G @ x - h)) < 1e-7


def test_bounds_on_entries_are_rows_as_others_are():
    random = np.random.default_rng(3)
    half = random.normal(size=(6, 6))
    P, q, G = half @ half.T, 5 * random.normal(size=6), random.normal(size=(9, 6))
    h, some = random.uniform(0, 1, 9), np.eye(6)[:4]
    x, z = minimum(P, q, G, h, 0.2, 4)
    known, own = minimum(P, q, np.vstack([G, some, -some]), np.append(h, np.full(8, 0.2)))
    assert np.abs(x[:4]).max() == pytest.approx(0.2, abs=1e-8)
    assert x == pytest.approx(known, abs=1e-7)
    assert z == pytest.approx(own[:9], abs=1e-6)


@compiled
@pytest.mark.parametrize("seed", range(6))
def test_engines_agree(seed):
    own = program(seed, 3 + 4 * seed, 10 + 9 * seed)
    expected = reference(*own)
    for engine in ("compiled", "plain"):
        for ours, theirs in zip(ENGINES[engine](*own), expected, strict=True):
            assert np.allclose(ours, theirs, rtol=0, atol=1e-6)


def test_without_the_kernel_the_reference_runs(monkeypatch):
    own = program(7, 4, 12)
    usual = minimum(*own)
    monkeypatch.setattr("polefence.base.kernel._kernel", None)
    assert all(map(np.array_equal, minimum(*own), reference(*own)))
    assert np.allclose(usual[0], reference(*own)[0], rtol=0, atol=1e-7)


@compiled
@pytest.mark.parametrize("k", range(4))
def test_shapes_and_types_that_do_not_fit_are_refused(k):
    own = list(program(8, 3, 6))
    for change in (lambda a: a[:-1], lambda a: np.concatenate([a, a])):
        bad = [*own[:k], change(own[k]), *own[k + 1 :]]
        with pytest.raises(ValueError, match="fit"):
            kernel.minimum(*bad)
    for change in (np.ndarray.tolist, lambda a: a.astype(complex), lambda a: a[None]):
        with pytest.raises(TypeError):
            kernel.minimum(*own[:k], change(own[k]), *own[k + 1 :])
    for bounded in (-1, 6):
        with pytest.raises(ValueError, match="bounds"):
            kernel.minimum(*own[:5], bounded)


@compiled
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324])
@pytest.mark.parametrize("plain", [False, True])
def test_wild_numbers_end_the_program(value, plain):
    for k in range(4):
        own = list(program(9, 3, 6))
        own[k] = own[k].copy()
        own[k].flat[0] = value
        before = [np.array(a) for a in own[:4]]
        x, z = kernel.minimum(*own, plain=plain)
        assert (x.shape, z.shape) == ((5,), (7,))
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(own, before, strict=False))
