"""The largest damping ratio in discrete time, which is found by halving."""

import numpy as np

from polefence import Structure, UncertainPlant, check, tightest

T = 0.05


def test_the_largest_damping_ratio_is_bracketed(monkeypatch, hasty):
    """A feedback of the position alone cannot damp as one likes: each gain that it may have."""
    close = 0.05
    monkeypatch.setattr("polefence.search.place.DAMPINGS", 5)  # each failure takes long
    position = Structure(measured=("x1",), schedule=(), largest_gain=3.0)
    light = UncertainPlant.from_vertices(
        [[[1, T], [-T * k, 0.97]] for k in (1, 2)], [[[0], [T]]] * 2, sample_time="0.05"
    )
    found = tightest(light, of="sector", structure=position)
    assert check(found).proved
    A, B = light.at(np.stack([np.linspace(0, 1, 21), np.linspace(1, 0, 21)], axis=1))
    gains = np.stack([np.linspace(-3, 3, 600), np.zeros(600)], axis=1)[:, None, None]
    poles = np.linalg.eigvals(A + B * gains)
    best = np.where(np.abs(poles) > 1e-6, _damping(poles), 1.0).min(axis=(1, 2)).max()
    assert best - 0.1 * (1 - best) - close < found.asked.damping < best


def _damping(z):
    s = np.log(np.asarray(z, dtype=complex))
    return -s.real / np.abs(s)
