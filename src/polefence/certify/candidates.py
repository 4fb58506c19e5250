"""Search and prove: candidates in order of promise; the first that is proved, or the best.

A search works in floats and comes close to the edge of what there is; a proof is exact, holds a
step inside it, and decides. Every ladder of this room is a sequence of candidates, found and proved
as they are asked for. It ends with its candidates or with the first that will do: by counted work,
never by the clock, unless a user asks for a `Deadline`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

T = TypeVar("T")

# How near its end a search in floats comes, one after the other: what is on the very edge may not
# survive its rounding.
TOLERANCES = (1e-8, 1e-6, 1e-4, 1e-2)


def first(candidates: Iterable[T]) -> T | None:
    """Return the first that is proved, None where none is."""
    return next((candidate for candidate in candidates if candidate is not None), None)


def preferred(
    candidates: Iterable[T | None], wanted: Callable[[T], bool]
) -> tuple[T | None, T | None]:
    """Return the first that is wanted, or else the first found; and the first found."""
    kept: T | None = None
    for candidate in candidates:
        if candidate is None:
            continue
        kept = candidate if kept is None else kept
        if wanted(candidate):
            return candidate, kept
    return kept, kept


def rising(candidates: Iterable[T], value: Callable[[T], float], gain: float) -> Iterator[T]:
    """Yield what is found while each value is larger than the last one by a share."""
    last: float | None = None
    for candidate in candidates:
        reached = value(candidate)
        if last is not None and reached <= last * (1 + gain):
            return
        yield candidate
        last = reached


def edge(
    holds: Callable[[float], bool],
    low: float,
    high: float,
    rounds: int,
    *,
    close: float = 0.0,
    geometric: bool = False,
) -> tuple[float, float]:
    """Halve the interval between what holds and what does not.

    Parameters
    ----------
    low, high : float
        What holds and what does not; neither is tried.
    rounds : int
        Halvings at most.
    close : float
        Share of ``high`` that is close enough.
    geometric : bool
        Whether the middle is the root of the product, for positive numbers of unknown magnitude.
    """
    for _ in range(rounds):
        if high - low <= close * abs(high):
            break
        middle = math.sqrt(low * high) if geometric else (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low, high


def gallop(count: int, holds: Callable[[int], bool], close: int = 1) -> None:
    """Try places from 0 on in growing strides until one holds, then halve back from it.

    Parameters
    ----------
    close : int
        How many of the first are all tried.
    """
    failed, place, stride = -1, 0, 1
    while place < count and not holds(place):
        stride = 1 if place + 1 < close else 2 * stride
        failed, place = place, min(place + stride, max(count - 1, place + 1))
    while place < count and place - failed > 1:
        middle = (failed + place) // 2
        failed, place = (failed, middle) if holds(middle) else (middle, place)


@dataclass(frozen=True)
class Deadline:
    """A number of seconds from now; None for no limit.

    Searches are bounded by counted work. A limit in seconds is for those who would rather have an
    answer that was cut; the answer then says so.
    """

    seconds: float | None = None
    begin: float = field(default_factory=time.perf_counter)

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return self.seconds is not None and time.perf_counter() - self.begin >= self.seconds

    def __str__(self) -> str:
        return f"the budget of {self.seconds:g} s is spent"
