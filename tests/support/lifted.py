"""Gains of sampled loops at all times, from below: disturbances held for parts of a period."""

import numpy as np
from scipy.linalg import expm


def gain(plant, outputs, K, T, late=0.0, parts=16, points=200):
    """The largest gain from w to z = C x + D u of x' = A x + B u + E w with u = K [x; past u].

    ``late`` is a share of a period, from 0 to 1, after which u acts; w is constant in each part,
    and the integral of z'z in it by Simpson's rule.
    """
    (A, B, E), (C, D) = plant, outputs
    (n, m), q, width = B.shape, E.shape[1], K.shape[1]
    past = np.eye(width)[n : n + m] if late else K
    phases = [(share, u) for share, u in ((late, past), (1 - late, K)) if share]
    x = np.eye(n, width + q * parts * len(phases))
    shown, begun = [], width
    for share, u in phases:
        step = share * T / parts
        half = expm(np.block([[A, B, E], [np.zeros((m + q, n + m + q))]]) * step / 2)[:n]
        for _ in range(parts):
            w, acting = np.zeros((q, x.shape[1])), np.zeros((m, x.shape[1]))
            w[:, begun : begun + q], acting[:, :width] = np.eye(q) / step**0.5, u
            begun += q
            for k, weight in enumerate((1, 4, 1)):
                shown.append((weight * step / 6) ** 0.5 * (C @ x + D @ acting))
                x = half @ np.vstack([x, acting, w]) if k < 2 else x
    moved = np.zeros((width, x.shape[1]))
    moved[:n] = x
    if late:
        moved[n:, :width] = K
    z, F = np.vstack(shown), moved[:, :width]
    if np.abs(np.linalg.eigvals(F)).max() >= 1:
        return np.inf
    circle = np.exp(1j * np.linspace(0, np.pi, points))[:, None, None]
    inner = np.linalg.solve(circle * np.eye(width) - F, moved[:, width:] + 0j)
    return float(np.linalg.norm(z[:, :width] @ inner + z[:, width:], 2, (1, 2)).max())
