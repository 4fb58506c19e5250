"""Responses of a linear system to what was measured: at frequencies, and to sampled inputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.plant.system import Array

WORST = 1e9  # condition of the modes; beyond, samples are stepped one by one
DIVERGED = 30.0  # nepers by which a response may grow
SMALL = 1e-3  # below which series are used


def phi(z: Array) -> tuple[Array, Array]:
    """Return (e^z - 1)/z and (e^z - 1 - z)/z^2."""
    small = np.abs(z) < SMALL
    safe = np.where(small, 1.0, z)
    one = np.where(small, 1 + z / 2 + z**2 / 6 + z**3 / 24, np.expm1(safe) / safe)
    two = np.where(small, 0.5 + z / 6 + z**2 / 24 + z**3 / 120, (one - 1) / safe)
    return one, two


def diverges(A: Array, span: float) -> bool:
    """Whether a response grows beyond what numbers tell in this time [s]."""
    return bool(not np.isfinite(A).all() or np.linalg.eigvals(A).real.max() * span > DIVERGED)


class Modes:
    """A system's modes, for samples this far apart [s]."""

    def __init__(self, A: Array, step: float) -> None:
        self.step = step
        poles, self.V = np.linalg.eig(A)
        if np.linalg.cond(self.V) > WORST:  # nearly defective: moved by less than what is measured
            size = np.abs(A).max() or 1.0
            spread = np.diag(np.linspace(-1, 1, len(A))) * 1e-7 * size
            poles, self.V = np.linalg.eig(A + spread)
        self.z = poles * step

    def forced(self, B: Array, u: Array, hold: str, x0: Array | None = None) -> Array:
        """Return the states (n, count) at samples of inputs (m, count)."""
        from scipy.signal import lfilter  # deferred: slow to import

        one, two = phi(self.z)
        drive = np.linalg.solve(self.V, B.astype(complex)) @ u
        now, next_ = (one, 0 * one) if hold == "held" else (one - two, two)
        acting = self.step * (now[:, None] * drive[:, :-1] + next_[:, None] * drive[:, 1:])
        begin = np.zeros(len(self.z), dtype=complex)
        if x0 is not None:
            begin = np.linalg.solve(self.V, x0.astype(complex))
        modes = np.empty((len(self.z), u.shape[1]), dtype=complex)
        modes[:, 0] = begin
        for k, e in enumerate(np.exp(self.z)):
            modes[k, 1:] = lfilter([1.0], [1.0, -e], acting[k], zi=[e * begin[k]])[0]
        return np.asarray((self.V @ modes).real)

    def free(self, C: Array, count: int) -> Array:
        """Return C e^(A t) at samples, (count, p, n)."""
        powers = np.exp(np.outer(np.arange(count), self.z))
        left, right = C @ self.V, np.linalg.inv(self.V)
        return np.asarray(np.einsum("pl,tl,ln->tpn", left, powers, right).real)


def resolvent(A: Array, frequency: Array) -> Any:
    """Return (j w I - A)^-1 at frequencies, (count, n, n)."""
    n = len(A)
    return np.linalg.inv(1j * frequency[:, None, None] * np.eye(n) - A)


def transfer(A: Array, B: Array, C: Array, D: Array, frequency: Array) -> Any:
    """Return C (j w I - A)^-1 B + D at frequencies, (p, m, count)."""
    s = 1j * frequency[:, None, None] * np.eye(len(A)) - A
    return np.moveaxis(C @ np.linalg.solve(s, np.broadcast_to(B, (len(frequency), *B.shape))) + D,
                       0, -1)  # fmt: skip
