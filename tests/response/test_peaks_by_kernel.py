"""The kernel climbs the peaks of singular values as NumPy does."""

import numpy as np
import pytest

from polefence.base.kernel import kernel
from polefence.response import peaks as module
from polefence.response.modes import Modes
from polefence.response.peaks import peaks

SHAPES = [(1, 1), (1, 3), (3, 1), (2, 2), (2, 3), (4, 3), (5, 5)]


def drawn(seed: int, p: int, q: int, n: int = 6, count: int = 4) -> tuple[Modes, ...]:
    random = np.random.default_rng([71, seed, p, q])
    A = random.normal(size=(count, n, n))
    A -= (np.linalg.eigvals(A).real.max(axis=1) + 0.05)[:, None, None] * np.eye(n)
    E, C, F = (random.normal(size=(count, *s)) for s in ((n, q), (p, n), (p, q)))
    return Modes(A, 0.0), E, C, 0.3 * F


@pytest.mark.skipif(kernel() is None, reason="installed without a compiler: no kernel")
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("p", "q"), SHAPES)
def test_the_kernel_finds_the_same_peaks(p, q, seed, monkeypatch):
    loops = drawn(seed, p, q)
    found = peaks(*loops)
    with monkeypatch.context() as patch:
        patch.setattr(module, "kernel", lambda: None)
        expected = peaks(*loops)
    assert found[0].tolist() == expected[0].tolist()
    assert found[1] == pytest.approx(expected[1], rel=1e-3, abs=1e-3)
    assert found[2] == pytest.approx(expected[2], rel=module.CLOSE)


@pytest.mark.skipif(kernel() is None, reason="installed without a compiler: no kernel")
@pytest.mark.parametrize(("p", "q"), SHAPES)
def test_heights_are_singular_values_there(p, q):
    modes, E, C, F = drawn(9, p, q)
    loops, w, top = peaks(modes, E, C, F)
    for k, own, height in zip(loops, w, top, strict=True):
        G = C[k] @ np.linalg.solve(1j * own * np.eye(6) - modes.A[k], E[k]) + F[k]
        assert height == pytest.approx(np.linalg.norm(G, 2), rel=1e-9)


@pytest.mark.skipif(kernel() is None, reason="installed without a compiler: no kernel")
@pytest.mark.parametrize(
    ("spoilt", "shape"),
    [(0, (4, 5)), (1, (4, 2, 5)), (2, (3, 6, 2)), (3, (4, 2, 3)), (4, (4, 0)), (4, (3, 9))],
)
def test_arrays_that_do_not_fit_are_refused(spoilt, shape):
    complexes = [np.ones((4, 6), complex), np.ones((4, 2, 6), complex), np.ones((4, 6, 2), complex)]
    given = [*complexes, np.ones((4, 2, 2)), np.ones((4, 9))]
    given[spoilt] = np.ones(shape, complex if spoilt < 3 else float)
    with pytest.raises(ValueError, match="loops do not fit"):
        kernel().climbed(*given, 9)
