"""What a model misses measurements by: for a fit with its slopes, and in shares for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from polefence.data.linear import Modes, resolvent, transfer
from polefence.data.local import Model, Signals, weights
from polefence.data.measured import FrequencyResponse, Measurement, Response
from polefence.plant.system import Array
from polefence.proof.fitted import Misfit

FAR = 1e6  # the residual of a model whose response diverges

Entries = tuple[tuple[str, int, int], ...]


def rest(signals: Signals, model: Model, own: Response, scale: Array) -> Array | None:
    """Return (p, count): what is left of the outputs; None where the model's response diverges.

    Where the response begins, and by how much each output is off, are those that leave least, each
    output in shares of its size.
    """
    u, y = signals.sampled(own)
    modes = Modes.of(model.A, own.step, own.count)
    if modes is None:
        return None
    left = y - model.C @ modes.forced(model.B, u, own.hold) - model.D @ u
    Q, flat = _orthonormal(_nuisances(model, modes, own.count, scale)), left / scale[:, None]
    flat = flat.reshape(-1)
    return np.asarray((flat - Q @ (Q.T @ flat)).reshape(left.shape) * scale[:, None])


def _nuisances(model: Model, modes: Modes, count: int, scale: Array) -> Array:
    """Return (p count, n + p): responses to initial states, and constants, in shares of sizes."""
    free = np.moveaxis(modes.free(model.C, count), 1, 0) / scale[:, None, None]
    constants = np.kron(np.diag(1 / scale), np.ones((count, 1)))
    return np.hstack([free.reshape(len(constants), -1), constants])


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
        scale = self.sizes
        left = rest(self.signals, model, own, scale)
        if left is None:
            return np.full(len(scale) * own.count, FAR)
        return np.asarray((left / scale[:, None]).reshape(-1))

    def slopes(self, model: Model, own: Measurement) -> Array:
        """Return the slopes (rows, entries) of one measurement."""
        if isinstance(own, FrequencyResponse):
            return self._of_frequencies(model, own)
        return self._in_time(model, own)

    @property
    def sizes(self) -> Array:
        """Sizes of the outputs."""
        return np.ones(len(self.signals.outputs)) if self.scale is None else self.scale

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
        """Return slopes without what initial states and constants explain (Kaufman).

        Where the model's response diverges there are none.
        """
        u, y = self.signals.sampled(own)
        modes, scale = Modes.of(model.A, own.step, own.count), self.sizes
        if modes is None:
            return np.zeros((y.size, len(self.places)))
        left = y - model.C @ modes.forced(model.B, u, own.hold) - model.D @ u
        Z = _nuisances(model, modes, own.count, scale)
        size = np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
        flat = (left / scale[:, None]).reshape(-1)
        begin = np.linalg.lstsq(Z / size, flat, rcond=1e-12)[0] / size
        x0 = begin[: len(model.A)]
        states = modes.forced(model.B, u, own.hold, x0)
        at = {letter: [k for k, place in enumerate(self.places) if place[0] == letter]
              for letter in "ABCD"}  # fmt: skip
        row, column = (np.array([place[k] for place in self.places], dtype=int) for k in (1, 2))
        slopes = np.zeros((len(y), len(self.places), own.count))
        for gain, *moved in modes.slopes(model.B, model.C, u, own.hold, x0):
            for letter, along in zip("AB", moved, strict=True):
                k = at[letter]
                slopes[:, k] += (gain[:, row[k], None] * along[column[k]]).real
        for letter, along in (("C", states), ("D", u)):
            k = at[letter]
            slopes[row[k], k] = along[column[k]]
        J = -np.moveaxis(slopes / scale[:, None, None], 1, 2).reshape(len(flat), -1)
        Q = _orthonormal(Z)
        return np.asarray(J - Q @ (Q.T @ J))


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
    size = np.ones(len(signals.outputs)) if scale is None else scale
    left = rest(signals, model, own, size)
    shares = np.full((len(size), own.count), FAR) if left is None else abs(left) / size[:, None]
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
