"""Responses of a linear system to what was measured: at frequencies, and to sampled inputs."""

from __future__ import annotations

from collections.abc import Iterator
from math import factorial
from typing import Any

import numpy as np

from polefence.plant.system import Array

WORST = 1e9  # condition of the modes; beyond, they are moved apart
DIVERGED = 30.0  # nepers by which a response may grow
SMALL = 0.5  # below which series are used
GONE = 1e-20  # share of a state of which nothing is left
NEAR = 1e-5  # below which a divided difference is a derivative: of both the error is then least

_ONE, _TWO = ([1 / factorial(k + more) for k in range(13, -1, -1)] for more in (1, 2))


def phi(z: Array) -> tuple[Array, Array]:
    """Return (e^z - 1)/z and (e^z - 1 - z)/z^2."""
    small = np.abs(z) < SMALL
    safe = np.where(small, 1.0, z)
    one = np.where(small, np.polyval(_ONE, z), np.expm1(safe) / safe)
    return one, np.where(small, np.polyval(_TWO, z), (one - 1) / safe)


def _steps(z: Array, hold: str) -> tuple[Array, Array, Array]:
    """Return what a step makes of the state, of the input before it, and of that behind it."""
    one, two = phi(z)
    return (np.exp(z), one, 0 * one) if hold == "held" else (np.exp(z), one - two, two)


def _derivatives(z: Array, hold: str) -> tuple[Array, Array, Array]:
    """Return the derivatives of `_steps`."""
    one, two = phi(z)
    small = np.abs(z) < SMALL
    of_two = np.where(small, np.polyval(np.polyder(_TWO), z), (one - 2 * two) / np.where(z, z, 1))
    if hold == "held":
        return np.exp(z), one - two, 0 * one
    return np.exp(z), one - two - of_two, of_two


def _divided(z: Array, hold: str) -> Array:
    """Return the divided differences (3, n, n) of `_steps` between all of z."""
    apart = z[:, None] - z
    near = np.abs(apart) < NEAR
    middle = _derivatives((z[:, None] + z) / 2, hold)
    steps = _steps(z, hold)
    safe = np.where(near, 1.0, apart)
    return np.array([np.where(near, mean, (f[:, None] - f) / safe)
                     for f, mean in zip(steps, middle, strict=True)])  # fmt: skip


class Modes:
    """A real system's modes, for samples this far apart [s]."""

    def __init__(self, A: Array, step: float) -> None:
        self.step = step
        poles, self.V = np.linalg.eig(A)
        if np.linalg.cond(self.V) > WORST:  # nearly defective: moved by less than what is measured
            size = np.abs(A).max() or 1.0
            spread = np.diag(np.linspace(-1, 1, len(A))) * 1e-7 * size
            poles, self.V = np.linalg.eig(A + spread)
        self.W = np.linalg.inv(self.V)
        self.z = poles * step
        # of a pair one speaks for both
        self.chosen = [int(k) for k in np.flatnonzero(poles.imag >= 0)]
        self.weights = np.where(poles.imag[self.chosen] > 0, 2.0, 1.0)

    @classmethod
    def of(cls, A: Array, step: float, count: int) -> Modes | None:
        """Return a system's modes; None where so many samples grow beyond what numbers tell."""
        modes = cls(A, step) if np.isfinite(A).all() else None
        return modes if modes is not None and modes.z.real.max() * count <= DIVERGED else None

    def _driven(self, k: int, acting: Array, begin: Any = 0.0) -> Array:
        """Return a mode (..., count) that is moved at each step by (..., count - 1)."""
        states = np.empty((*acting.shape[:-1], acting.shape[-1] + 1), dtype=complex)
        states[..., 0], states[..., 1:] = begin, acting
        count, power = 1, np.exp(self.z[k])  # sums over count samples are doubled
        while count < states.shape[-1] and abs(power) > GONE:
            states[..., count:] += power * states[..., :-count]
            count, power = 2 * count, power * power
        return states

    def _modes(self, B: Array, u: Array, hold: str, x0: Array | None) -> tuple[Array, Array]:
        """Return the modes (n, count) at samples of inputs (m, count), and what drives them."""
        _, now, next_ = _steps(self.z, hold)
        drive = (self.W @ B) @ u
        begin = np.zeros(len(self.z)) if x0 is None else self.W @ x0
        modes = np.empty(drive.shape, dtype=complex)
        for k in self.chosen:
            acting = self.step * (now[k] * drive[k, :-1] + next_[k] * drive[k, 1:])
            modes[k] = self._driven(k, acting, begin[k])
        for other in np.flatnonzero(self.z.imag < 0):
            pair = int(np.argmin(np.abs(self.z - self.z[other].conj())))
            modes[other] = modes[pair].conj()
        return modes, drive

    def forced(self, B: Array, u: Array, hold: str, x0: Array | None = None) -> Array:
        """Return the states (n, count) at samples of inputs (m, count)."""
        return np.asarray((self.V @ self._modes(B, u, hold, x0)[0]).real)

    def free(self, C: Array, count: int) -> Array:
        """Return C e^(A t) at samples, (count, p, n)."""
        powers = np.exp(np.outer(np.arange(count), self.z[self.chosen])) * self.weights
        left, right = C @ self.V[:, self.chosen], self.W[self.chosen]
        return np.asarray(((powers[:, None, :] * left) @ right).real)

    def slopes(
        self, B: Array, C: Array, u: Array, hold: str, x0: Array
    ) -> Iterator[tuple[Array, Array, Array]]:
        """Yield g (p, n), a (n, count) and b (m, count), complex, of each mode.

        The slope of C x in A[i, j] is the real part of the sum of g[:, i] a[j], in B[i, j] that of
        g[:, i] b[j]: exact, as the response is.
        """
        modes, drive = self._modes(B, u, hold, x0)
        h, (_, now, next_) = self.step, _steps(self.z, hold)
        of_state, of_now, of_next = _divided(self.z, hold)
        for k, weight in zip(self.chosen, self.weights, strict=True):
            acting = h * (of_state[k, :, None] * modes[:, :-1])
            acting += h * h * (of_now[k, :, None] * drive[:, :-1])
            acting += h * h * (of_next[k, :, None] * drive[:, 1:])
            gain = weight * np.outer(C @ self.V[:, k], self.W[k])
            inputs = self._driven(k, h * (now[k] * u[:, :-1] + next_[k] * u[:, 1:]))
            yield gain, self._driven(k, self.V @ acting), inputs


def resolvent(A: Array, frequency: Array) -> Any:
    """Return (j w I - A)^-1 at frequencies, (count, n, n)."""
    n = len(A)
    return np.linalg.inv(1j * frequency[:, None, None] * np.eye(n) - A)


def transfer(A: Array, B: Array, C: Array, D: Array, frequency: Array) -> Any:
    """Return C (j w I - A)^-1 B + D at frequencies, (p, m, count)."""
    s = 1j * frequency[:, None, None] * np.eye(len(A)) - A
    return np.moveaxis(C @ np.linalg.solve(s, np.broadcast_to(B, (len(frequency), *B.shape))) + D,
                       0, -1)  # fmt: skip
