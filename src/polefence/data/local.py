"""A model of what was measured at one point of the parameters, from which a fit of all begins.

Vector fitting: sigma y = N u / d with sigma = 1 + c'phi(s), phi = (s - A)^-1 b over poles that are
known is linear in c and N; the zeros of sigma are better poles (Gustavsen & Semlyen, 1999). In time
phi filters the samples (Grivet-Talocia, 2003). A residue of one mode has the rank one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.data.linear import Modes, resolvent
from polefence.data.measured import FrequencyResponse, Measurement, Response
from polefence.plant.system import Array

ROUNDS = 30
ENOUGH = 1e-12  # by which poles move, of their size
FLOOR = 0.01  # of the largest value of a pair: what is smaller counts as no smaller
DAMPED = 1e-4  # damping ratio that a pole is given that lies nearer to the axis, or beyond it


@dataclass(frozen=True)
class Signals:
    """Which signals a model has, and what is asked of it.

    Attributes
    ----------
    inputs, outputs : tuple of str
        Names of what acts and of what is measured.
    direct : (p, m) array of bool
        Which inputs pass straight into which outputs.
    order : int
    unstable : bool
        Whether the plant itself may be.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    direct: Array
    order: int
    unstable: bool = False

    def values(self, own: FrequencyResponse) -> Array:
        """Return values (p, m, count) in the order of these signals; nan where none are."""
        found = np.full((len(self.outputs), len(self.inputs), own.count), np.nan, dtype=complex)
        for i, output in enumerate(self.outputs):
            for j, inside in enumerate(self.inputs):
                if output in own.output_names and inside in own.input_names:
                    k, m = own.output_names.index(output), own.input_names.index(inside)
                    found[i, j] = own.values[k, m]
        return found

    def sampled(self, own: Response) -> tuple[Array, Array]:
        """Return inputs (m, count) and outputs (p, count) in the order of these signals."""
        u = own.inputs[[own.input_names.index(name) for name in self.inputs]]
        y = own.outputs[[own.output_names.index(name) for name in self.outputs]]
        return u, y


@dataclass(frozen=True)
class Model:
    """x' = A x + B u, y = C x + D u."""

    A: Array
    B: Array
    C: Array
    D: Array


def weights(values: Array) -> Array:
    """Return weights (p, m, count) of frequency responses: 1 over the size, as far as it counts."""
    size = np.abs(values)
    largest = np.max(size, axis=2, keepdims=True)
    return np.asarray(1 / np.maximum(np.maximum(size, FLOOR * largest), 1e-300))


def sizes(signals: Signals, measurements: Sequence[Measurement]) -> Array:
    """Return the rms (p,) of outputs about their means, over all responses in time."""
    rows = [signals.sampled(own)[1] for own in measurements if isinstance(own, Response)]
    power = sum(((y - y.mean(axis=1, keepdims=True)) ** 2).sum(axis=1) for y in rows)
    count = sum(y.shape[1] for y in rows)
    return np.asarray(np.sqrt(power / count))


def band(signals: Signals, measurements: Sequence[Measurement]) -> tuple[float, float]:
    """Return the frequencies [rad/s] between which measurements say most."""
    ends = list[tuple[float, float]]()
    for own in measurements:
        if isinstance(own, FrequencyResponse):
            ends.append((float(own.frequency[0]), float(own.frequency[-1])))
            continue
        y = signals.sampled(own)[1]
        y = y - y.mean(axis=1, keepdims=True)
        spectrum = (np.abs(np.fft.rfft(y / np.sqrt((y**2).mean(axis=1, keepdims=True)))) ** 2).sum(
            0
        )
        share = np.cumsum(spectrum) / spectrum.sum()
        grid = 2 * np.pi * np.fft.rfftfreq(own.count, own.step)
        low, high = (float(grid[np.searchsorted(share, part)]) for part in (0.1, 0.95))
        ends.append((max(low, float(grid[1])), max(high, 2 * float(grid[1]))))
    return min(low for low, _ in ends), max(high for _, high in ends)


def local_model(
    signals: Signals, group: Sequence[Measurement], scale: Array | None
) -> Model | None:
    """Return a model of measurements at one point; None where they tell of none.

    Parameters
    ----------
    scale : (p,) array, optional
        Sizes of the outputs, of responses in time.
    """
    poles = _first(signals.order, *band(signals, group))
    for _ in range(ROUNDS):
        A, b = _basis(poles)
        rows = [_projected(*block[1:]) for block in _blocks(signals, group, scale, A, b)]
        P = np.concatenate([row[0] for row in rows])
        y = np.concatenate([row[1] for row in rows])
        if not (np.isfinite(P).all() and np.isfinite(y).all()):
            return None
        c = _solved(P, -y)
        moved = _kept(np.linalg.eigvals(A - np.outer(b, c)), signals.unstable)
        still = _apart(moved, poles) <= ENOUGH
        poles = moved
        if still:
            break
    return _realised(signals, group, scale, poles)


def _first(order: int, low: float, high: float) -> Array:
    pairs = np.geomspace(low, high, order // 2 + 2)[1:-1] if order > 1 else np.array([])
    poles = [w * (-0.1 + sign * 1j) for w in pairs for sign in (1, -1)]
    return np.array(poles + ([-np.sqrt(low * high) + 0j] if order % 2 else []))


def _apart(one: Array, other: Array) -> float:
    sorted_ = (np.sort_complex(poles) for poles in (one, other))
    a, b = sorted_
    return float(np.max(np.abs(a - b) / np.abs(a)))


def _kept(poles: Any, unstable: bool) -> Array:
    """Return poles in pairs, in the left half-plane unless they may lie beyond."""
    poles = np.where(poles == 0, -1e-9, poles)
    if not unstable:
        size = np.abs(poles)
        real = -np.maximum(np.abs(poles.real), DAMPED * size)
        poles = real + 1j * poles.imag
    upper = poles[poles.imag > 0]
    alone = poles[poles.imag == 0]
    return np.concatenate([upper, upper.conj(), alone])


def _basis(poles: Array) -> tuple[Array, Array]:
    """Return A (n, n), real, and b (n,) of phi = (s - A)^-1 b."""
    upper, alone = poles[poles.imag > 0], poles[poles.imag == 0].real
    n = len(poles)
    A, b = np.zeros((n, n)), np.zeros(n)
    for k, pole in enumerate(upper):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
        b[2 * k] = np.sqrt(2) * np.abs(pole)
    for k, value in enumerate(alone, 2 * len(upper)):
        A[k, k], b[k] = value * (1 + 1e-9 * k), np.abs(value)  # two alike would be one
    return A, b


Block = tuple[Any, Array, Array, Array]


def _blocks(
    signals: Signals, group: Sequence[Measurement], scale: Array | None, A: Array, b: Array
) -> Iterator[Block]:
    """Yield what is linear: whose, the columns of N and what else, those of c, and y."""
    if scale is None:
        yield from _of_frequencies(signals, group, A, b)
        return
    parts = [_filtered(signals, own, A, b) for own in group if isinstance(own, Response)]
    for i in range(len(signals.outputs)):
        M = np.concatenate(
            [np.hstack([acting, u[:, signals.direct[i]]]) for u, acting, *_ in parts]
        )
        P = np.concatenate([seen[:, i] for _, _, seen, _ in parts])
        y = np.concatenate([own[:, i] for *_, own in parts])
        yield i, M / scale[i], P / scale[i], y / scale[i]


def _filtered(
    signals: Signals, own: Response, A: Array, b: Array
) -> tuple[Array, Array, Array, Array]:
    """Return u (count, m), phi u (count, m n), phi y (count, p, n) and y (count, p).

    Without what explains that a response begins anywhere, and is off by a constant.
    """
    modes, (u, y) = Modes(A, own.step), signals.sampled(own)
    y = y - y.mean(axis=1, keepdims=True)
    acting = np.concatenate([modes.forced(b[:, None], row[None], own.hold) for row in u])
    seen = np.concatenate([modes.forced(b[:, None], row[None], "linear") for row in y])
    free = modes.free(np.eye(len(A)), own.count) @ b
    columns = np.concatenate([u, acting, seen, y]).T
    left = _without(np.column_stack([free, np.ones(own.count)]), columns)
    ends = np.cumsum([len(u), len(acting), len(seen)])
    u, acting, seen, y = np.split(left, ends, axis=1)
    return u, acting, seen.reshape(own.count, y.shape[1], -1), y


def _of_frequencies(
    signals: Signals, group: Sequence[Measurement], A: Array, b: Array
) -> Iterator[Block]:
    responses = [own for own in group if isinstance(own, FrequencyResponse)]
    for i in range(len(signals.outputs)):
        for j in range(len(signals.inputs)):
            found = list[tuple[Array, Array, Array]]()
            for own in responses:
                G = signals.values(own)
                if np.isnan(G[i, j]).any():
                    continue
                phi = resolvent(A, own.frequency) @ b
                w = weights(G)[i, j]
                M = np.hstack([phi, np.ones((len(phi), 1))]) if signals.direct[i, j] else phi
                found.append((M * w[:, None], phi * (G[i, j] * w)[:, None], G[i, j] * w))
            M, P, y = (np.concatenate(parts) for parts in zip(*found, strict=True))
            yield (i, j), _real(M), _real(P), _real(y)


def _real(values: Array) -> Array:
    return np.concatenate([values.real, values.imag])


def _projected(M: Array, P: Array, y: Array) -> tuple[Array, Array]:
    """Return P and y without what M explains."""
    left = _without(M, np.column_stack([P, y]))
    return left[:, :-1], left[:, -1]


def _without(M: Array, columns: Array) -> Array:
    """Return columns without what M explains."""
    Q = np.linalg.qr(M / np.maximum(np.linalg.norm(M, axis=0), 1e-300))[0]
    return np.asarray(columns - Q @ (Q.T @ columns))


def _solved(M: Array, y: Array) -> Array:
    size = np.maximum(np.linalg.norm(M, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(M / size, y, rcond=1e-13)[0] / size)


def _realised(
    signals: Signals, group: Sequence[Measurement], scale: Array | None, poles: Array
) -> Model | None:
    """Return the model with these poles, each of whose residues has the rank one."""
    A, b = _basis(poles)
    n, p, m = len(A), len(signals.outputs), len(signals.inputs)
    rows, D = np.zeros((p, m, n)), np.zeros((p, m))
    for key, M, _, y in _blocks(signals, group, scale, A, b):
        found = _solved(M, y)
        if scale is None:
            i, j = key
            rows[i, j] = found[:n]
            D[i, j] = found[n] if signals.direct[i, j] else 0
        else:
            rows[key] = found[: n * m].reshape(m, n)
            straight = np.flatnonzero(signals.direct[key])
            D[key, straight] = found[n * m : n * m + len(straight)]
    values, V = np.linalg.eig(A)
    into = np.linalg.solve(V, b.astype(complex))
    B, C = np.zeros((n, m), dtype=complex), np.zeros((p, n), dtype=complex)
    # each output counts as much as any other
    size = np.maximum(np.abs(rows).max(axis=(1, 2)), 1e-300)
    for k in range(n):
        residue = (rows @ V[:, k]) * into[k]
        left, s, right = np.linalg.svd(residue / size[:, None])
        B[k], C[:, k] = np.sqrt(s[0]) * right[0], np.sqrt(s[0]) * left[:, 0] * size
    # of a pair of modes one is the conjugate of the other
    for k in range(n):
        pair = int(np.argmin(np.abs(values - values[k].conj())))
        if values[k].imag > 0:
            B[pair], C[:, pair] = B[k].conj(), C[:, k].conj()
    model = Model(np.diag(values), B, C, D)
    good = all(np.isfinite(M).all() for M in (B, C, D))
    return model if good else None
