"""What a model misses measurements by: for a fit with its slopes, and in shares for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.data.linear import Modes, diverges, resolvent, transfer
from polefence.data.local import Model, Signals, weights
from polefence.data.measured import FrequencyResponse, Measurement, Response
from polefence.plant.system import Array
from polefence.proof.fitted import Misfit

FAR = 1e6  # the residual of a model whose response diverges
STEP = 1e-6  # of an entry's change, of its size

Entries = tuple[tuple[str, int, int], ...]


def rest(signals: Signals, model: Model, own: Response) -> Array | None:
    """Return (p, count): what is left of the outputs; None where the model's response diverges.

    Where the response begins, and by how much each output is off, are those that leave least.
    """
    if diverges(model.A, own.step * own.count):
        return None
    u, y = signals.sampled(own)
    modes = Modes(model.A, own.step)
    left = y - model.C @ modes.forced(model.B, u, own.hold) - model.D @ u
    Z, size = _nuisances(model, modes, own.count), _sizes(left)
    flat = (left / size).reshape(-1)
    Z = Z / np.repeat(size[:, 0], own.count)[:, None]
    Q = _orthonormal(Z)
    return np.asarray((flat - Q @ (Q.T @ flat)).reshape(left.shape) * size)


def _sizes(values: Array) -> Array:
    return np.asarray(np.maximum(np.sqrt((values**2).mean(axis=1, keepdims=True)), 1e-300))


def _nuisances(model: Model, modes: Modes, count: int) -> Array:
    """Return (p count, n + p): responses to initial states, and constants."""
    p = len(model.C)
    free = np.moveaxis(modes.free(model.C, count), 1, 0).reshape(p * count, -1)
    return np.hstack([free, np.kron(np.eye(p), np.ones((count, 1)))])


def _orthonormal(Z: Array) -> Array:
    size = np.linalg.norm(Z, axis=0)
    return np.asarray(np.linalg.qr(Z[:, size > 0] / size[size > 0])[0])


@dataclass(frozen=True, eq=False)
class Residual:
    """The weighted residual of measurements, a vector, and its slopes in entries of matrices.

    Attributes
    ----------
    signals : Signals
    places : tuple
        The free entries.
    scale : (p,) array, optional
        Sizes of the outputs, of responses in time.
    """

    signals: Signals
    places: Entries
    scale: Array | None

    def of(self, model: Model, own: Measurement) -> Array:
        """Return the residual of one measurement."""
        if isinstance(own, FrequencyResponse):
            G = self.signals.values(own)
            known = ~np.isnan(G)
            missed = transfer(model.A, model.B, model.C, model.D, own.frequency) - G
            flat = (missed * weights(G))[known]
            return np.concatenate([flat.real, flat.imag])
        left = rest(self.signals, model, own)
        if left is None:
            return np.full(len(self.signals.outputs) * own.count, FAR)
        return np.asarray((left / self._scale).reshape(-1))

    def slopes(self, model: Model, own: Measurement) -> Array:
        """Return the slopes (rows, entries) of one measurement."""
        if isinstance(own, FrequencyResponse):
            return self._of_frequencies(model, own)
        return self._in_time(model, own)

    @property
    def _scale(self) -> Array:
        return np.ones((1, 1)) if self.scale is None else self.scale[:, None]

    def _of_frequencies(self, model: Model, own: FrequencyResponse) -> Array:
        G = self.signals.values(own)
        known, w = ~np.isnan(G), weights(G)
        R = resolvent(model.A, own.frequency)
        X, Y = R @ model.B, model.C @ R  # (count, n, m) and (count, p, n)
        columns = list[Array]()
        for letter, i, j in self.places:
            slope = np.zeros((own.count, *G.shape[:2]), dtype=complex)
            if letter == "A":
                slope = Y[:, :, i, None] * X[:, None, j, :]
            elif letter == "B":
                slope[:, :, j] = Y[:, :, i]
            elif letter == "C":
                slope[:, i, :] = X[:, j, :]
            else:
                slope[:, i, j] = 1
            flat = (np.moveaxis(slope, 0, -1) * w)[known]
            columns.append(np.concatenate([flat.real, flat.imag]))
        return np.array(columns).T

    def _in_time(self, model: Model, own: Response) -> Array:
        """Return differences, without what initial states and constants explain (Kaufman)."""
        u, y = self.signals.sampled(own)
        modes = Modes(model.A, own.step)
        left = y - model.C @ modes.forced(model.B, u, own.hold) - model.D @ u
        spread = np.repeat(np.broadcast_to(self._scale[:, 0], (len(y),)), own.count)
        Z = _nuisances(model, modes, own.count) / spread[:, None]
        size = np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
        begin = np.linalg.lstsq(Z / size, left.reshape(-1) / spread, rcond=1e-12)[0] / size
        x0, Q = begin[: len(model.A)], _orthonormal(Z)

        def response(of: Model) -> Array:
            states = Modes(of.A, own.step).forced(of.B, u, own.hold, x0)
            return np.asarray((of.C @ states + of.D @ u).reshape(-1) / spread)

        columns = [-_difference(response, model, place) for place in self.places]
        J = np.array(columns).T
        return np.asarray(J - Q @ (Q.T @ J))


def _difference(response: Callable[[Model], Array], model: Model, place: Any) -> Array:
    letter, i, j = place
    sides = list[Array]()
    size = max(float(np.abs(getattr(model, letter)).max()), abs(getattr(model, letter)[i, j]), 1e-9)
    for sign in (1, -1):
        matrices = {key: getattr(model, key).copy() for key in "ABCD"}
        matrices[letter][i, j] += sign * STEP * size
        sides.append(response(Model(**matrices)))
    return np.asarray((sides[0] - sides[1]) / (2 * STEP * size))


# --- in shares ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Missed:
    """What a model misses one measurement by, in shares of what was measured.

    Attributes
    ----------
    shares : list of arrays
        For each output.
    places : list of str
        For each output, where the largest is.
    """

    shares: list[Array]
    places: list[str]


def missed(signals: Signals, model: Model, own: Measurement, scale: Array | None) -> Missed:
    """Return what a model misses one measurement by.

    In time the difference over the rms of the output about its mean, of all measurements; in
    frequency over the model's value, which counts as no smaller than a hundredth of its largest.

    Parameters
    ----------
    scale : (p,) array, optional
        These rms values, of responses in time.
    """
    if isinstance(own, FrequencyResponse):
        return _missed_frequencies(signals, model, own)
    left = rest(signals, model, own)
    size = np.ones((1, 1)) if scale is None else scale[:, None]
    shares = np.full((len(signals.outputs), own.count), FAR) if left is None else abs(left) / size
    instants = own.time[np.argmax(shares, axis=1)]
    places = [
        f"{own.name}, {output}, at {instant:.4g} s"
        for output, instant in zip(signals.outputs, instants, strict=True)
    ]
    return Missed(list(shares), places)


def _missed_frequencies(signals: Signals, model: Model, own: FrequencyResponse) -> Missed:
    G = signals.values(own)
    modelled = transfer(model.A, model.B, model.C, model.D, own.frequency)
    ratio = np.abs(G - modelled) * weights(modelled)
    shares, places = list[Array](), list[str]()
    for output, rows in zip(signals.outputs, ratio, strict=True):
        known = np.where(np.isnan(rows), -1, rows)
        j, k = np.unravel_index(int(np.argmax(known)), known.shape)
        hertz = own.frequency[k] / (2 * np.pi)
        places.append(f"{own.name}, {output} from {signals.inputs[j]}, at {hertz:.4g} Hz")
        shares.append(rows[~np.isnan(rows)])
    return Missed(shares, places)


def misfits(
    signals: Signals, found: Sequence[Missed]
) -> tuple[Misfit, tuple[tuple[str, Misfit], ...], str]:
    """Return the misfit of all, of each output, and where the largest is."""
    rows, place, worst = list[tuple[str, Misfit]](), "", -1.0
    for i, output in enumerate(signals.outputs):
        own = [(one.shares[i], one.places[i]) for one in found if len(one.shares[i])]
        if own:
            rows.append((output, _misfit([shares for shares, _ in own])))
            shares, where = max(own, key=lambda one: float(one[0].max()))
            if shares.max() > worst:
                worst, place = float(shares.max()), where
    return _misfit([shares for one in found for shares in one.shares]), tuple(rows), place


def _misfit(shares: Sequence[Array]) -> Misfit:
    whole = np.concatenate(list(shares))
    return Misfit(float(np.sqrt((whole**2).mean())), float(whole.max()))
