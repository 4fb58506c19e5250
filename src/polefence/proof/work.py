"""Work that a file may ask for, in counted operations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

# Bounds on what a claim can ask for: work, in products of two words of 30 bits, of which every
# operation takes `CALL` besides; and what polynomials hold at once [bytes].
MAX_WORK, CALL, MAX_HELD = 5 * 10**9, 120, 4 * 10**8
# Of a claim that is proved in parts of the box: a van's law of order 1 at 1 ms takes 36 parts for
# its poles, of 4e8 each, 2.8 times MAX_WORK together. A limit of its force with no states of the
# law at 2 ms, for periods 20 % longer and shorter, takes 11 parts, 14 times MAX_WORK together; its
# acceleration 18 times.
MAX_IN_PARTS = 24 * MAX_WORK
# A plant of more states than these may take as much: of 270 states poles take 7e9, a gain 8e9.
LARGE = 60
FULL = 60  # claims at that bound which one file may hold
MAX_FILE = FULL * MAX_WORK
RATIONAL = 20  # operations on integers that one on rationals is
LEAST_WORK = 300 * CALL  # of an inequality of whatever size
TOO_MUCH = (
    "its inequalities are too many or too large, or their numbers "
    "too long, to be checked here; take "
    "fewer parameters, or round the numbers"
)


class FormatError(ValueError):
    """The file is not a design file that this version reads; the message says where."""


class WorkError(FormatError):
    """It asks for more work than is done, whatever it says."""


@dataclass
class Count:
    """Work that has begun, of the most that is allowed; what results that are kept it has had."""

    most: int
    spent: int = 0
    had: dict[tuple[int, Any], object] = field(default_factory=dict)


_COUNT: ContextVar[Count | None] = ContextVar("count", default=None)


@contextmanager
def counted(most: int | None = None) -> Iterator[Count]:
    """Allow this much work in all that follows; inside another count, what that one leaves of it.

    So a claim gets `MAX_WORK` wherever it is proved, alone or in a file.
    """
    outer, most = _COUNT.get(), MAX_WORK if most is None else most
    count = Count(most)
    if outer is not None:
        count = Count(min(most, outer.most - outer.spent), had=outer.had)
    token = _COUNT.set(count)
    try:
        yield count
    finally:
        _COUNT.reset(token)
        if outer is not None:
            outer.spent += count.spent


_FOLLOWER: ContextVar[Callable[[int], object] | None] = ContextVar("follower", default=None)


@contextmanager
def followed(follower: Callable[[int], object]) -> Iterator[None]:
    """Call a function with the number of each inequality of a claim, before it is proved.

    With 0 where the claim is decided.
    """
    token = _FOLLOWER.set(follower)
    try:
        yield
    finally:
        _FOLLOWER.reset(token)


def tell(inequality: int) -> None:
    """Tell the follower, where there is one, which inequality is next; 0 where none is."""
    follower = _FOLLOWER.get()
    if follower is not None:
        follower(inequality)


def spend(operations: int, left: int, right: int = 0) -> None:
    """Count operations on numbers of so many bits, before they begin.

    Raises
    ------
    WorkError
        If they are more than the count allows.
    """
    count = _COUNT.get()
    if count is None:
        return
    amount = operations * cost(left, right)
    if count.spent + amount > count.most:
        raise WorkError(TOO_MUCH)
    count.spent += amount


def spend_once(kept: object, key: Any, amount: int) -> None:
    """Count the work on a result that is kept, where it is had for the first time in a count.

    It is counted there whether it is done then, or was done in another count.

    Parameters
    ----------
    kept : object
        Where the result is kept under the key; it lives as long as the count.

    Raises
    ------
    WorkError
        If it is more than the count allows.
    """
    count = _COUNT.get()
    if count is None or (id(kept), key) in count.had:
        return
    if count.spent + amount > count.most:
        raise WorkError(TOO_MUCH)
    count.spent += amount
    count.had[id(kept), key] = kept


def cost(left: int, right: int = 0) -> int:
    """Return what one operation on numbers of so many bits costs."""
    return CALL + (left // 30 + 1) * (right // 30 + 1)
