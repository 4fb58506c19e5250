"""A disturbance as the caller gives it, samples or a function, checked against the loops."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.plant.system import Array
from polefence.response import grid
from polefence.response.closed import Loops
from polefence.response.weighting import positive


def sampled(
    loops: Loops, w: Any, step: float | None, duration: float | None, signals: int
) -> tuple[float, Array]:
    """Return step [s] and samples (T, q) of a disturbance; arguments as `linear.simulate` has them.

    Raises
    ------
    InputError
        If the step is too long for the fastest pole, the samples do not fit or are not finite.
    """
    q = loops.E.shape[-1]
    if w is None:
        w = partial(_nothing, q)
    if callable(w):
        if duration is None:
            raise InputError("a disturbance that is a function, or none, needs a duration [s]")
        duration = positive(duration, "duration [s]")
        if step is None:
            step = min(grid.CHOSEN / grid.LONGEST * grid.longest_step(loops), duration)
        step = grid.require_step(loops, step)
        count = grid.samples(duration, step, len(loops.alpha), signals)
        w = _called(w, grid.every(step, count))
    elif step is None:
        raise InputError("samples of a disturbance need the time between them, step [s]")
    else:
        step = grid.require_step(loops, step)
        if duration is not None:
            raise InputError("samples of a disturbance say the duration themselves; leave it out")
    try:
        found = np.asarray(w, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    found = found[:, None] if found.ndim == 1 and q == 1 else found
    if found.ndim != 2 or found.shape[1] != q or not len(found):
        raise InputError(f"the disturbance has shape {np.shape(w)}; give (T, {q}) samples")
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
