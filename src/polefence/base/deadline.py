"""Time limits that a user asked for: without one, no answer depends on the clock."""

from __future__ import annotations

import time
from dataclasses import dataclass, field


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
