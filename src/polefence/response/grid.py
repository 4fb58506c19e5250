"""Times and frequencies of a response: the caller's, else those that fit."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.response.closed import Loops, point_text
from polefence.response.stationary import STABLE, Numbers, growth
from polefence.response.weighting import positive

# A disturbance that runs straight between samples has lost (1 - (sin(x/2) / (x/2))^2), x = step
# times rate, of a component at that rate [rad/s]. At the fastest pole's rate that is 8 % for the
# longest step, x = 1; 0.08 % for the one that is chosen, x = 0.1.
LONGEST = 1.0
CHOSEN = 0.1
MOST_CHOSEN = 20_000
EVEN = 1e-6  # by which instants may be off an even spacing, relative
# Of a result [bytes].
MOST_BYTES = 8e9


class Swept(Protocol):
    """Closed loops, or what is one but opened somewhere."""

    @property
    def plant(self) -> UncertainPlant:
        """The family."""

    @property
    def step(self) -> float:
        """The sample time of a delta form [s]; zero in continuous time."""

    def poles(self) -> Array:
        """Closed-loop poles, (count, n) complex."""


def longest_step(loops: Loops) -> float:
    """Return the longest step [s] at which samples of a disturbance represent it to these loops.

    It is 1 / |p|, p the fastest pole of all: straight lines between samples then pass at least
    92 % of what lies at that pole's rate. Infinite where all poles are zero.
    """
    if loops.step:
        return loops.step
    fastest = float(np.abs(loops.poles()).max(initial=0.0))
    return LONGEST / fastest if fastest else math.inf


def require_step(loops: Loops, step: float) -> float:
    """Refuse a step of samples [s] that is too long for the loops; return it.

    Raises
    ------
    InputError
        If it is not above zero, or longer than `longest_step`; the bound is named. In discrete
        time if it is not the plant's own.
    """
    step = positive(step, "step [s]")
    if loops.step:
        return _own_step(loops, step)
    bound = longest_step(loops)
    if step > bound:
        speeds = np.abs(loops.poles()).max(axis=1)
        row = int(np.argmax(speeds))
        raise InputError(
            f"step = {step:g} s is too long for the fastest pole, {speeds[row]:.4g} 1/s in size at "
            f"{point_text(loops.plant, loops.alpha[row])}; sample the disturbance at "
            f"{_below(bound):g} s or less"
        )
    return step


def times(
    loops: Loops,
    kept: Numbers,
    duration: float | None,
    step: float | None,
    signals: int,
    several: bool = False,
) -> Array:
    """Return the times of a response [s], 0 first; steps and duration are chosen where not given.

    Parameters
    ----------
    kept : (k,) array of int
        The states that matter: their poles say how long the response lasts.
    signals : int
        How many there will be, for the bound on memory.
    several : bool
        Whether a step in discrete time may be several samples.

    Raises
    ------
    InputError
        If a number is not above zero, none is given and none can be chosen, or the result would
        be too large.
    """
    poles = np.asarray(np.linalg.eigvals(loops.closed[:, kept][:, :, kept]), dtype=complex)
    fastest = float(np.abs(poles).max(initial=0.0))
    if duration is None:
        duration = _duration(loops, poles, fastest)
    duration = positive(duration, "duration [s]")
    if loops.step:
        step = _own_step(loops, loops.step if step is None else step, several)
    if step is None:
        step = max(CHOSEN / fastest if fastest else 0.0, duration / MOST_CHOSEN)
    step = positive(step, "step [s]")
    return every(step, samples(duration, step, len(loops.alpha), signals))


def _own_step(loops: Loops, step: float, several: bool = False) -> float:
    """Return the plant's sample time, which a step in discrete time is, or several of them."""
    count = max(1, round(step / loops.step)) if several and math.isfinite(step) else 1
    if not math.isclose(step, count * loops.step, rel_tol=EVEN):
        raise InputError(
            f"step = {step:g} s; {loops.plant.name} is in discrete time, its samples are "
            f"{loops.step:g} s apart"
        )
    return count * loops.step


def every(step: float, samples: int) -> Array:
    """Return 0, step, 2 step, ..., (samples,)."""
    return np.asarray(step * np.arange(samples), dtype=float)


def evenly(time: Any) -> tuple[float, int]:
    """Return the step [s] and the number of instants that are evenly spaced from 0.

    Raises
    ------
    InputError
        If they are not.
    """
    try:
        times = np.asarray(time, dtype=float)
    except (TypeError, ValueError, OverflowError):
        times = np.zeros(0)
    if times.ndim != 1 or len(times) < 2:
        raise InputError("time [s] must be an array of two instants or more")
    step = positive(times[1], "second instant of time [s]")
    if not np.allclose(times, every(step, len(times)), rtol=EVEN, atol=EVEN * step):
        raise InputError("time [s] must be evenly spaced from 0")
    return step, len(times)


def samples(duration: float, step: float, count: int, signals: int) -> int:
    """Return how many samples a duration has, both ends among them.

    Raises
    ------
    InputError
        If there is not even one step, or count x samples x signals would be too large.
    """
    steps = duration / step * (1 + 1e-12)
    if steps < 1:
        raise InputError(f"step = {step:g} s is longer than the duration, {duration:g} s")
    require_size(steps + 1, count, signals)
    return math.floor(steps) + 1


def require_size(samples: float, count: int, signals: int) -> None:
    """Refuse a result that takes more than `MOST_BYTES`."""
    size = 8 * samples * count * signals
    if size > MOST_BYTES:
        raise InputError(
            f"{count} points, {samples:.4g} samples and {signals} signals make {size / 1e9:.3g} GB;"
            f" at most {MOST_BYTES / 1e9:g} GB (ask for fewer of one of them)"
        )


def frequencies(loops: Swept, given: object) -> Array:
    """Return frequencies [Hz]; by default 400 from a decade below all poles to one above.

    Raises
    ------
    InputError
        If they are not finite numbers of zero or more.
    """
    if given is None:
        sizes = np.abs(loops.poles())
        top = sizes.max(initial=0.0)
        some = sizes[sizes > STABLE * top]
        low, high = (some.min(), top) if len(some) else (1.0, 1.0)
        last = min(high * 10, math.pi / loops.step) if loops.step else high * 10
        return np.geomspace(min(low / 10, last / 10), last, 400) / (2 * math.pi)
    try:
        hertz = np.atleast_1d(np.array(given, dtype=float))
    except (TypeError, ValueError, OverflowError):
        hertz = np.array([math.nan])
    if hertz.ndim != 1 or not len(hertz) or not np.all(np.isfinite(hertz)) or np.any(hertz < 0):
        raise InputError("frequency [Hz] must be a list of finite numbers, zero or more")
    if loops.step and hertz.max() > (1 + EVEN) / (2 * loops.step):
        raise InputError(
            f"frequency [Hz]: {loops.plant.name} is in discrete time, with frequencies up to half "
            f"of the sampling rate, {0.5 / loops.step:g} Hz"
        )
    return hertz


def _duration(loops: Loops, poles: npt.NDArray[np.complex128], fastest: float) -> float:
    rates = -growth(poles, loops.step)
    slowest = rates.min(axis=1, initial=math.inf)
    bad = np.flatnonzero(slowest <= STABLE * fastest)
    if len(bad) or not poles.size:
        where = point_text(loops.plant, loops.alpha[bad[0] if len(bad) else 0])
        raise InputError(f"the response does not die away at {where}; give a duration [s]")
    return 15 / float(slowest.min())  # fifteen of the slowest time constants


def _below(value: float) -> float:
    """Round down to three digits, so that the number that is named is accepted."""
    digits = 10.0 ** (2 - math.floor(math.log10(value)))
    return math.floor(value * digits) / digits
