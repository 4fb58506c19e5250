"""Linear responses of a family under a law: step, impulse, frequency, any sampled disturbance.

For all points of the family at once. Step and impulse responses are exact at the samples, and so
is the response to a disturbance that is held, or runs straight, between them (`discrete`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from polefence.base.errors import InputError, suggest
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import (
    Output,
    Signal,
    choose,
    disturbances,
    inputs,
    output_matrices,
    stacked,
)
from polefence.plant.system import Array
from polefence.response import grid
from polefence.response.closed import Loops, close, point_text
from polefence.response.discrete import (
    BUFFER,
    first_order_hold,
    forced_response,
    free_response,
    zero_order_hold,
)
from polefence.response.result import Frequency, Response
from polefence.response.stationary import needed, unstable
from polefence.response.weighting import positive

Wanted = Sequence[Output | str] | None

FAR = 1e-5  # of the state that goes farthest: what its rounding leaves in the others' scale


@dataclass(frozen=True, eq=False)
class _Path:
    """From some sources to signals: x' = closed x + E w, y = C x + D w, batched."""

    loops: Loops
    signals: tuple[Output, ...]
    sources: tuple[Signal, ...]
    E: Array
    C: Array
    D: Array


def step(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    signals: Wanted = None,
    source: str | None = None,
    duration: float | None = None,
    step: float | None = None,
) -> Response:
    """Return the responses to a unit step at time 0, from rest.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    alpha : (count, N) or (N,) array
    signals : sequence of Output or str, optional
        Outputs, or names of the plant's signals; all states and inputs by default.
    source : str, optional
        Where the step enters: name of a disturbance, or of an input u = K x + v for a step in
        v; the first disturbance by default.
    duration : float, optional
        [s]; by default 15 times the slowest time constant that the signals depend on.
    step : float, optional
        Time between samples [s]; by default a tenth over the size of the fastest pole, or more
        where that made over 20,000 samples. The samples are exact whatever it is.

    Raises
    ------
    InputError
        If a name is unknown, a number not above zero, or no duration is given and the response
        does not die away; and as `close` raises.
    """
    path = _path(plant, law, alpha, signals, source)
    loops, (count, n, _) = path.loops, path.E.shape
    time = grid.times(loops, needed(path.C, loops.closed), duration, step, len(path.signals))
    Phi, Gamma = zero_order_hold(loops.closed, path.E, time[1])
    # The step is a state that stays as it is.
    longer = np.zeros((count, n + 1, n + 1))
    longer[:, :n, :n], longer[:, :n, n:], longer[:, n, n] = Phi, Gamma, 1.0
    start = np.zeros((count, n + 1))
    start[:, n] = 1.0
    values = free_response(longer, np.concatenate([path.C, path.D], axis=2), start, len(time))
    return Response(plant, loops.alpha, time, path.signals, values, _final(path)[0][:, :, 0])


def impulse(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    signals: Wanted = None,
    source: str | None = None,
    duration: float | None = None,
    step: float | None = None,
) -> Response:
    """Return the responses to a unit impulse at time 0, from rest.

    Arguments and errors are those of `step`. The values at time 0 are those right after the
    impulse; where it passes straight into a signal, that impulse is not in them.
    """
    path = _path(plant, law, alpha, signals, source)
    loops = path.loops
    time = grid.times(loops, needed(path.C, loops.closed), duration, step, len(path.signals))
    Phi, _ = zero_order_hold(loops.closed, path.E, time[1])
    values = free_response(Phi, path.C, path.E[:, :, 0], len(time))
    final = np.where(np.isnan(_final(path)[0][:, :, 0]), np.nan, 0.0)
    return Response(plant, loops.alpha, time, path.signals, values, final)


def simulate(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    w: Any,
    time: Any,
    signals: Wanted = None,
    hold: Literal["linear", "held"] = "linear",
    start: Any = None,
) -> Response:
    """Return the responses to a disturbance, the same at all points.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    alpha : (count, N) or (N,) array
    w : (T,) or (T, q) array, function or None
        Samples; a function of times (T,) [s] that returns them is sampled. None: no disturbance.
    time : (T,) array or float
        Instants [s], evenly spaced from 0. Where there are no samples a float will do: the last
        instant, the step being a tenth over the size of the fastest pole.
    signals : sequence of Output or str, optional
        Outputs, or names of the plant's signals; all states and inputs by default.
    hold : "linear" or "held"
        Between samples w runs straight to the next one, or stays as it was at the last.
    start : (n,) or (count, n) array, optional
        State at time 0; zero by default.

    Raises
    ------
    InputError
        If the times are not even, their step is too long for the fastest pole (the bound is
        named), w is not finite or of another shape, the response outgrows floating point; and as
        `close` raises.
    """
    if hold not in ("linear", "held"):
        raise InputError(f"hold = {hold!r}; use 'linear' or 'held'")
    loops = close(plant, law, alpha, disturbed=w is not None)
    asked = choose(plant, signals)
    step, w = sampled(loops, w, time, len(asked))
    grid.require_size(len(w), len(loops.alpha), len(asked))
    C, D = output_matrices(plant, asked, loops.alpha, loops.K)
    first = started(start, *loops.closed.shape[:2])
    if hold == "held":
        Phi, Gamma = zero_order_hold(loops.closed, loops.E, step)
        values = forced_response(Phi, Gamma, C, D, w, first)
    else:
        Phi, Gamma, Gamma1 = first_order_hold(loops.closed, loops.E, step)
        values = forced_response(Phi, Gamma, C, D, w, first, Gamma1)
    return Response(plant, loops.alpha, grid.every(step, len(w)), asked, values)


def frequency(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    frequency: Any = None,
    signals: Wanted = None,
    source: str | None = None,
) -> Frequency:
    """Return transfer functions at frequencies.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        None leaves the plant to itself.
    alpha : (count, N) or (N,) array
    frequency : (F,) array, optional
        [Hz]; by default 400 from a decade below the slowest pole to one above the fastest.
    signals : sequence of Output or str, optional
        Outputs, or names of the plant's signals; all states and inputs by default.
    source : str, optional
        Name of a disturbance or of an input, as `step` has it; all disturbances by default.

    Raises
    ------
    InputError
        If a name is unknown, a frequency negative or not finite, or a pole lies at one; and as
        `close` raises.
    """
    path = _path(plant, law, alpha, signals, source, every=True)
    asked = grid.frequencies(path.loops, frequency)
    keep = needed(path.C, path.loops.closed)
    A, E, C = path.loops.closed[:, keep][:, :, keep], path.E[:, keep], path.C[:, :, keep]
    grid.require_size(2.0 * len(asked) * len(path.sources), len(A), len(path.signals))
    gain = np.empty((len(A), len(asked), *path.D.shape[1:]), dtype=complex)
    some = max(1, BUFFER // (16 * len(asked) * max(1, len(keep)) ** 2))
    s = 2j * np.pi * asked[:, None, None] * np.eye(len(keep))
    for first in range(0, len(A), some):
        part = slice(first, first + some)
        try:
            X = np.linalg.solve(s - A[part, None], E[part, None].astype(complex))
        except np.linalg.LinAlgError:
            raise InputError(_pole_text(path, A, asked)) from None
        gain[part] = C[part, None] @ X + path.D[part, None]
    return Frequency(plant, path.loops.alpha, asked, path.signals, path.sources, gain)


def final(
    plant: UncertainPlant, law: Any, alpha: Any, signals: Wanted = None
) -> tuple[tuple[Signal, ...], tuple[Output, ...], Array, Array]:
    """Return what a unit step of each disturbance leaves in each signal.

    Returns
    -------
    sources : tuple of Signal
        q disturbances.
    signals : tuple of Output
        p of them.
    values : (count, p, q) array
        NaN where the signal tends to nothing.
    scale : (p, q) array
        Of what the values are sums: they are no more exact than a rounding of it.

    Raises
    ------
    InputError
        If a name is unknown; and as `close` raises.
    """
    path = _path(plant, law, alpha, signals, None, every=True)
    return path.sources, path.signals, *_final(path)


def _path(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    signals: Wanted,
    source: str | None,
    every: bool = False,
) -> _Path:
    """Close the loops and say how one source (``every``: each disturbance) reaches the signals."""
    pushes = [s.name for s in inputs(plant)]
    loops = close(plant, law, alpha, disturbed=source not in pushes)
    asked = choose(plant, signals)
    winds = disturbances(plant)
    C, D = output_matrices(plant, asked, loops.alpha, loops.K)
    if source in pushes:
        j = pushes.index(source)
        B = loops.B[:, :, j : j + 1]
        D = np.tensordot(loops.alpha, stacked(plant, asked)[1][:, :, j : j + 1], 1)
        return _Path(loops, asked, (inputs(plant)[j],), B, C, D)
    known = [wind.name for wind in winds]
    if source is not None and source not in known:
        hint = suggest(str(source), [*known, *pushes])
        raise InputError(f"no disturbance or input {source!r} of {plant.name}; {hint}")
    if every and source is None:
        return _Path(loops, asked, winds, loops.E, C, D)
    i = 0 if source is None else known.index(source)
    one = slice(i, i + 1)
    return _Path(loops, asked, winds[one], loops.E[:, :, one], C, D[:, :, one])


def _final(path: _Path) -> tuple[Array, Array]:
    """Return what the step responses tend to (count, p, q), NaN for nothing; and their scale."""
    (count, p, q), closed = path.D.shape, path.loops.closed
    values, scale = np.full((count, p, q), np.nan), np.zeros((p, q))
    for i in range(p):
        C = path.C[:, i : i + 1]
        keep = needed(C, closed)
        A = closed[:, keep][:, :, keep]
        good = np.setdiff1d(np.arange(len(A)), unstable(A))
        reached = np.linalg.solve(A[good], -path.E[good][:, keep])
        row = C[good][:, :, keep]
        values[good, i] = (row @ reached + path.D[good, i : i + 1])[:, 0]
        if len(good) and len(keep):
            # by state: one that goes far says little of how exact the others are (Skeel)
            moved = np.abs(np.linalg.inv(A[good])) @ (np.abs(A[good]) @ np.abs(reached))
            moved += FAR * np.abs(reached).max(axis=1, keepdims=True)
            scale[i] = (np.abs(row) @ moved)[:, 0].max(axis=0)
    return values, scale


def _pole_text(path: _Path, A: Array, asked: Array) -> str:
    poles = np.linalg.eigvals(A)
    away = np.abs(poles[:, None, :] - 2j * np.pi * asked[:, None]).min(axis=-1)
    row, at = np.unravel_index(np.argmin(away), away.shape)
    where = point_text(path.loops.plant, path.loops.alpha[row])
    return f"there is a pole at the frequency {asked[at]:g} Hz at {where}; leave that out"


def sampled(loops: Loops, w: Any, time: Any, signals: int) -> tuple[float, Array]:
    """Return step [s] and samples (T, q) of a disturbance; arguments as `linear.simulate` has them.

    Raises
    ------
    InputError
        If the times are not even, their step is too long for the fastest pole, or the samples do
        not fit them or are not finite.
    """
    q = loops.E.shape[-1]
    if w is None:
        w = partial(_nothing, q)
    if np.ndim(time) or not callable(w):
        step, count = grid.evenly(time)
        grid.require_step(loops, step)
    else:
        last = positive(time, "time [s]")
        step = min(grid.CHOSEN / grid.LONGEST * grid.longest_step(loops), last)
        count = grid.samples(last, step, len(loops.alpha), signals)
    if callable(w):
        w = _called(w, grid.every(step, count))
    try:
        found = np.asarray(w, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    found = found[:, None] if found.ndim == 1 and q == 1 else found
    if found.shape != (count, q):
        raise InputError(f"the disturbance has shape {np.shape(w)}; give ({count}, {q}) samples")
    bad = np.flatnonzero(~np.all(np.isfinite(found), axis=1))
    if len(bad):
        raise InputError(f"the disturbance is no finite number at sample {bad[0] + 1}; mend it")
    return step, found


def _nothing(q: int, time: Array) -> Array:
    return np.zeros((len(time), q))


def _called(w: Callable[[Array], Any], time: Array) -> Any:
    value = np.asarray(w(time))
    # A constant is one for all times.
    return np.broadcast_to(value, (len(time), *value.shape)) if value.ndim == 0 else value


def started(start: Any, count: int, n: int) -> Array | None:
    """Return the state at time 0, (n,) or (count, n), if one is given.

    Raises
    ------
    InputError
        If it does not fit, or is not finite.
    """
    if start is None:
        return None
    x = np.asarray(start, dtype=float)
    if x.shape not in ((n,), (count, n)) or not np.all(np.isfinite(x)):
        raise InputError(f"start has shape {x.shape}; give {n} finite states, or (count, {n})")
    return x
