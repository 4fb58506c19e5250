"""Work of searches in counted operations: what they may take, whatever the machine and its clock.

A search counts what it does, and asks whether it has come to its bound. Then it takes no further
step, and the best that it has is the answer, which says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass(eq=False)
class Effort:
    """Work that was done, of the most that is.

    Attributes
    ----------
    most : float
        Operations, of which a processor does about 1e9 a second.
    spent : float
    evaluations : int
        Of loops, at all points that a step looks at.
    """

    most: float
    spent: float = 0.0
    evaluations: int = 0

    @property
    def ended(self) -> bool:
        """Whether the bound is reached."""
        return self.spent >= self.most

    def __str__(self) -> str:
        count = f"{self.evaluations} evaluation{'s' * (self.evaluations != 1)} of the loop"
        return f"it stopped at its bound of work, after {count}"


MOST_WORK = 1e11  # of one search for a tuned law: some 100 s
# Of the proofs of the laws that it finds. The nine limits of a full car with 25 states, at samples
# every 5 ms, take 1.13e11.
MOST_PROVING = 2e11

_EFFORT: ContextVar[Effort | None] = ContextVar("effort", default=None)


@contextmanager
def bounded(most: float) -> Iterator[Effort]:
    """Bound the work of all that follows; inside another bound, by what that one leaves."""
    outer = _EFFORT.get()
    effort = Effort(most if outer is None else min(most, outer.most - outer.spent))
    token = _EFFORT.set(effort)
    try:
        yield effort
    finally:
        _EFFORT.reset(token)
        if outer is not None:
            outer.spent += effort.spent
            outer.evaluations += effort.evaluations


def spend(operations: float, evaluations: int = 0) -> None:
    """Count operations, about as many as a step took."""
    effort = _EFFORT.get()
    if effort is not None:
        effort.spent += operations
        effort.evaluations += evaluations


def ended() -> bool:
    """Whether the search is to end: its bound of work is reached."""
    effort = _EFFORT.get()
    return effort is not None and effort.ended


def stopped() -> str:
    """Return that the search stopped at its bound, to end a sentence; empty where it did not."""
    effort = _EFFORT.get()
    return f"; {effort}" if effort is not None and effort.ended else ""
