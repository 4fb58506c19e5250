"""Linear responses of a family under a law: step, impulse, frequency, any sampled disturbance.

For all points of the family at once. Step and impulse responses are exact at the samples, and so
is the response to a disturbance that is held, or runs straight, between them (`discrete`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError, suggest
from polefence.base.explained import explained, explained_fields
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import (
    Output,
    Signal,
    choose,
    disturbances,
    inputs,
    output_matrices,
    pick,
    rows_at,
)
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.response import grid
from polefence.response.closed import Loops, close, point_text
from polefence.response.discrete import (
    BUFFER,
    first_order_hold,
    forced_response,
    free_response,
    zero_order_hold,
)
from polefence.response.stationary import growth, needed, unstable
from polefence.response.weighting import positive

Wanted = Sequence[Output | str] | None


Reference = Literal["final", "peak"]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Path:
    """From some sources to signals: x' = closed x + E w, y = C x + D w, batched."""

    loops: Loops
    signals: tuple[Output, ...]
    sources: tuple[Signal, ...]
    E: Array
    C: Array
    D: Array


@explained
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
        where that made over 20,000 samples. The samples are exact whatever it is. In discrete time
        a whole number of the plant's own.

    Raises
    ------
    InputError
        If a name is unknown, a number not above zero, or no duration is given and the response
        does not die away; and as `close` raises.
    """
    path = _path(plant, law, alpha, signals, source)
    loops, (count, n, _) = path.loops, path.E.shape
    kept = needed(path.C, loops.closed)
    time = grid.times(loops, kept, duration, step, len(path.signals), several=True)
    Phi, Gamma = _at_samples(loops, path.E, time[1])
    # The step is a state that stays as it is.
    longer = np.zeros((count, n + 1, n + 1))
    longer[:, :n, :n], longer[:, :n, n:], longer[:, n, n] = Phi, Gamma, 1.0
    if loops.step:
        longer = np.linalg.matrix_power(longer, round(time[1] / loops.step))
    start = np.zeros((count, n + 1))
    start[:, n] = 1.0
    values = free_response(longer, np.concatenate([path.C, path.D], axis=2), start, len(time))
    return Response(plant, loops.alpha, time, path.signals, values, _final(path)[0][:, :, 0])


@explained
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
    impulse; where it passes straight into a signal, that impulse is not in them. In discrete time
    it is a first sample of one over the sample time.
    """
    path = _path(plant, law, alpha, signals, source)
    loops = path.loops
    time = grid.times(loops, needed(path.C, loops.closed), duration, step, len(path.signals))
    Phi, Gamma = _at_samples(loops, path.E, time[1])
    if loops.step:
        once = np.zeros((len(time), 1))
        once[0] = 1 / loops.step
        values = forced_response(Phi, Gamma, path.C, path.D, once)
    else:
        values = free_response(Phi, path.C, path.E[:, :, 0], len(time))
    final = np.where(np.isnan(_final(path)[0][:, :, 0]), np.nan, 0.0)
    return Response(plant, loops.alpha, time, path.signals, values, final)


@explained
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
    C, D = output_matrices(plant, asked, loops.alpha, loops.K, loops.passed)
    first = started(start, *loops.closed.shape[:2])
    if hold == "held" or loops.step:
        Phi, Gamma = _at_samples(loops, loops.E, step)
        values = forced_response(Phi, Gamma, C, D, w, first)
    else:
        Phi, Gamma, Gamma1 = first_order_hold(loops.closed, loops.E, step)
        values = forced_response(Phi, Gamma, C, D, w, first, Gamma1)
    return Response(plant, loops.alpha, grid.every(step, len(w)), asked, values)


@explained
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
    asked, T = grid.frequencies(path.loops, frequency), path.loops.step
    keep = needed(path.C, path.loops.closed)
    A, E, C = path.loops.closed[:, keep][:, :, keep], path.E[:, keep], path.C[:, :, keep]
    grid.require_size(2.0 * len(asked) * len(path.sources), len(A), len(path.signals))
    gain = np.empty((len(A), len(asked), *path.D.shape[1:]), dtype=complex)
    some = max(1, BUFFER // (16 * len(asked) * max(1, len(keep)) ** 2))
    s = 2j * np.pi * asked
    s = (np.expm1(s * T) / T if T else s)[:, None, None] * np.eye(len(keep))
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
    """Return the steady value of each signal under a unit step of each disturbance.

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


def slowest_seen(
    plant: UncertainPlant,
    law: Any,
    alpha: Any,
    signals: Wanted = None,
    source: str | None = None,
    share: float = 0.02,
) -> float:
    """Return the slowest decay rate [1/s] of modes that are seen in step responses.

    A mode is seen that makes at least a share of what all modes make of some signal, as a law's
    own slow state often does not. Arguments and errors are those of `step`.

    Returns
    -------
    float
        Zero or less where a mode that is seen does not die away.
    """
    path = _path(plant, law, alpha, signals, source)
    rates, modes = np.linalg.eig(path.loops.closed)
    decay = -growth(rates, path.loops.step)
    with np.errstate(divide="ignore", invalid="ignore"):
        try:
            entering = np.abs(np.linalg.solve(modes, path.E.astype(complex)))[:, :, 0]
        except np.linalg.LinAlgError:  # too few modes: all count
            return float(decay.min())
        makes = np.abs(path.C @ modes) * (entering / np.abs(rates))[:, None]
        unseen = np.all(makes < share * makes.sum(axis=2, keepdims=True), axis=1)
    return float(np.where(unseen, np.inf, decay).min())


def _at_samples(loops: Loops, E: Array, step: float) -> tuple[Array, Array]:
    """Return Phi, Gamma of x(t + step) = Phi x(t) + Gamma w(t); w held between in continuous time.

    In discrete time the step is the plant's own.
    """
    if loops.step:
        return np.eye(E.shape[-2]) + loops.step * loops.closed, loops.step * E
    return zero_order_hold(loops.closed, E, step)


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
    C, D = output_matrices(plant, asked, loops.alpha, loops.K, loops.passed)
    if source in pushes:
        j = pushes.index(source)
        B = loops.B[:, :, j : j + 1]
        D = rows_at(plant, asked, loops.alpha)[1][..., j : j + 1]
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
    """Return the limits of the step responses (count, p, q), NaN without one, and their scale."""
    (count, p, q), closed = path.D.shape, path.loops.closed
    values, scale = np.full((count, p, q), np.nan), np.zeros((p, q))
    alike = dict[tuple[int, ...], list[int]]()  # signals that follow the same states
    for i in range(p):
        alike.setdefault(tuple(needed(path.C[:, i : i + 1], closed).tolist()), []).append(i)
    for states, same in alike.items():
        keep = np.array(states, dtype=int)
        A = closed[:, keep][:, :, keep]
        good = np.setdiff1d(np.arange(len(A)), unstable(A, path.loops.step))
        reached = np.linalg.solve(A[good], -path.E[good][:, keep])
        rows = path.C[good][:, same][:, :, keep]
        values[good[:, None], same] = rows @ reached + path.D[good][:, same]
        if len(good) and len(keep):
            # by state: one that goes far says little of how exact the others are (Skeel)
            moved = np.abs(np.linalg.inv(A[good])) @ (np.abs(A[good]) @ np.abs(reached))
            # what rounding of a state that goes far leaves in the others' scale
            moved += 1e-5 * np.abs(reached).max(axis=1, keepdims=True)
            scale[same] = (np.abs(rows) @ moved).max(axis=0)
    return values, scale


def _pole_text(path: _Path, A: Array, asked: Array) -> str:
    poles = np.linalg.eigvals(A)
    T, s = path.loops.step, 2j * np.pi * asked[:, None]
    away = np.abs(poles[:, None, :] - (np.expm1(s * T) / T if T else s)).min(axis=-1)
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
        samples = np.asarray(w, dtype=float)
    except (TypeError, ValueError, OverflowError):
        samples = np.zeros(0)
    samples = samples[:, None] if samples.ndim == 1 and q == 1 else samples
    if samples.shape != (count, q):
        raise InputError(f"the disturbance has shape {np.shape(w)}; give ({count}, {q}) samples")
    bad = np.flatnonzero(~np.all(np.isfinite(samples), axis=1))
    if len(bad):
        raise InputError(f"the disturbance is not a finite number at sample {bad[0] + 1}; mend it")
    return step, samples


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


@dataclass(frozen=True, eq=False)
class Response(Short):
    """Signals over time, at many points of a family.

    Attributes
    ----------
    plant : UncertainPlant
    alpha : (count, N) array
    time : (T,) array
        From 0 in equal steps [s].
    signals : tuple of Output
        p of them.
    values : (count, T, p) array
        In the signals' units.
    final : (count, p) array, optional
        What each signal tends to, where that is known: NaN where it tends to nothing.
    """

    plant: UncertainPlant
    alpha: Array
    time: Array
    signals: tuple[Output, ...]
    values: Array
    final: Array | None = None

    @explained_fields
    def __post_init__(self) -> None:
        _read_only(self)

    def __repr__(self) -> str:
        count, T, p = self.values.shape
        return f"<Response of {self.plant.name!r}: {count} points, {T} samples, {p} signals>"

    def of(self, name: str) -> Array:
        """Return one signal, (count, T)."""
        return np.asarray(self.values[:, :, self.signals.index(pick(self.signals, name))])

    def settling(self, share: float = 0.02, of: Reference | None = None) -> Array:
        """Return settling times [s], (count, p); see the function."""
        return settling(self.time, self.values, self.final, share, of)

    def overshoot(self) -> Array:
        """Return overshoot as a share of the final value, (count, p); see the function."""
        return overshoot(self.values, self.final)

    def peaks(self) -> tuple[Array, Array]:
        """Return peaks and their times [s], two (count, p); see the function."""
        return peaks(self.time, self.values)

    def rms(self, since: float = 0.0) -> Array:
        """Return rms values from a time [s] on, (count, p)."""
        return rms(self.time, self.values, since)


@dataclass(frozen=True, eq=False)
class Frequency(Short):
    """Transfer functions from disturbances or an input to signals, at many points of a family.

    Attributes
    ----------
    plant : UncertainPlant
    alpha : (count, N) array
    frequency : (F,) array
        [Hz].
    signals : tuple of Output
        p of them.
    sources : tuple of Signal
        q of them: names and units of what is exciting.
    gain : (count, F, p, q) complex array
        [signal's unit / source's unit].
    """

    plant: UncertainPlant
    alpha: Array
    frequency: Array
    signals: tuple[Output, ...]
    sources: tuple[Signal, ...]
    gain: npt.NDArray[np.complex128]

    @explained_fields
    def __post_init__(self) -> None:
        _read_only(self)

    def __repr__(self) -> str:
        count, F, p, q = self.gain.shape
        return (
            f"<Frequency of {self.plant.name!r}: {count} points, {F} frequencies, {p} signals, "
            f"{q} sources>"
        )

    def of(self, name: str) -> npt.NDArray[np.complex128]:
        """Return the gains to one signal, (count, F, q)."""
        return np.asarray(self.gain[:, :, self.signals.index(pick(self.signals, name))])


def _read_only(result: Any) -> None:
    """Make the arrays of a frozen result read-only, as seen through it."""
    for entry in fields(result):
        value = getattr(result, entry.name)
        if isinstance(value, np.ndarray):
            value = value.view()
            value.flags.writeable = False
            object.__setattr__(result, entry.name, value)


def settling(
    time: Array,
    values: Array,
    final: Array | None = None,
    share: float = 0.02,
    of: Reference | None = None,
) -> Array:
    """Return the settling time [s] of each signal, within a share of its final value, (count, p).

    The band is that share of the final value; of the largest absolute value for responses that
    return to zero. Between samples the response is taken as straight: what it does there is not
    seen. NaN where a signal is outside the band at the last sample, or its final value is NaN.

    Parameters
    ----------
    time : (T,) array
        [s].
    values : (count, T, p) array
    final : (count, p) array, optional
        What the signals tend to; zero by default, and NaN for those that tend to nothing.
    share : float
        Of the final value (or peak), above 0 and below 1.
    of : "final" or "peak", optional
        What the band is a share of; by default as above.

    Raises
    ------
    InputError
        If share or ``of`` is none of these, or ``of`` is "final" and no final value is known.
    """
    if not 0 < share < 1:
        raise InputError(f"share = {share!r} of the final value; use one in 0 < share < 1")
    if of not in (None, "final", "peak"):
        raise InputError(f"of = {of!r}; use 'final' or 'peak'")
    if of == "final" and final is None:
        raise InputError("of = 'final': no final value of this response is known; use 'peak'")
    count, _, p = values.shape
    end = np.zeros((count, p)) if final is None else np.asarray(final, dtype=float)
    times = np.empty((count, p))
    for part, rows in _chunks(values):
        size = np.abs(rows).max(axis=-1)
        to = end[part]
        goes = np.abs(to) if of == "final" else np.where(_returns(to, size), size, np.abs(to))
        band = share * (size if of == "peak" else goes)
        rows -= to[..., None]
        times[part] = _last_crossing(time, rows, band)
    return times


def _last_crossing(time: Array, rows: Array, band: Array) -> Array:
    """Return when |rows| (count, p, T) last falls to the band (count, p), NaN where it has not."""
    T = len(time)
    # What is no number is outside.
    outside: Flags = np.logical_not(np.abs(rows) <= band[..., None])
    last = T - 1 - np.argmax(outside[..., ::-1], axis=-1)
    never = np.logical_not(outside.any(axis=-1))
    k = np.minimum(last, max(T - 2, 0))[..., None]
    next_k = np.minimum(k + 1, T - 1)
    here, there = (np.take_along_axis(rows, i, axis=-1)[..., 0] for i in (k, next_k))
    side = np.sign(here)
    drop = side * (here - there)
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.where(drop > 0, (side * here - band) / drop, 0.0)
    at = time[k[..., 0]] + part * (time[next_k[..., 0]] - time[k[..., 0]])
    return np.where(never, time[0], np.where(last == T - 1, np.nan, at))


def overshoot(values: Array, final: Array | None = None) -> Array:
    """Return the overshoot of each signal as a share of its final value, (count, p).

    0.1 is 10 %. NaN where the final value is zero or not known: then see the function.

    Parameters
    ----------
    values : (count, T, p) array
    final : (count, p) array, optional
        What the signals tend to.
    """
    count, _, p = values.shape
    shares = np.full((count, p), np.nan)
    if final is None:
        return shares
    for part, rows in _chunks(values):
        size, to = np.abs(rows).max(axis=-1), np.asarray(final, dtype=float)[part]
        beyond = np.where(to > 0, rows.max(axis=-1), -rows.min(axis=-1))
        usable = ~_returns(to, size) & np.isfinite(to)
        known = np.where(usable, np.abs(to), 1.0)
        shares[part] = np.where(usable, np.maximum(beyond / known - 1, 0.0), np.nan)
    return shares


def peaks(time: Array, values: Array) -> tuple[Array, Array]:
    """Return each signal's sample of largest absolute value, with its sign, and its time [s].

    Returns
    -------
    peak, at : (count, p) arrays
    """
    count, _, p = values.shape
    peak, at = np.empty((count, p)), np.empty((count, p))
    for part, rows in _chunks(values):
        k = np.argmax(np.abs(rows), axis=-1)
        peak[part] = np.take_along_axis(rows, k[..., None], axis=-1)[..., 0]
        at[part] = time[k]
    return peak, at


def rms(time: Array, values: Array, since: float = 0.0) -> Array:
    """Return the root of each signal's mean square from ``since`` [s] on, (count, p).

    Raises
    ------
    InputError
        If no sample is that late.
    """
    first = int(np.searchsorted(time, since))
    if first >= len(time):
        raise InputError(f"since = {since:g} s; the response ends at {time[-1]:g} s")
    late = values[:, first:]
    return np.asarray(np.sqrt(np.einsum("atp,atp->ap", late, late) / late.shape[1]))


def _returns(final: Array, size: Array) -> Flags:
    # a final value below this share of the peak is zero but for rounding
    return np.asarray(np.abs(final) <= 1e-9 * size, dtype=np.bool_)


def _chunks(values: Array) -> Iterator[tuple[slice, Array]]:
    """Yield slices of the batch with their values as (some, p, T), the caller's to change."""
    count, T, p = values.shape
    some = max(1, BUFFER // (8 * max(1, T * p)))
    for first in range(0, count, some):
        part = slice(first, min(first + some, count))
        yield part, np.array(np.swapaxes(values[part], 1, 2), order="C")
