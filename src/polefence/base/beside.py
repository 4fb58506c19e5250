"""What has to be said beside every answer about something that was read.

Whoever reads it says so once, and whoever prints answers collects: no command can forget it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_BESIDE: ContextVar[dict[str, None] | None] = ContextVar("beside", default=None)


def say_beside(note: str) -> None:
    """Have a line said beside the answers to come, once."""
    notes = _BESIDE.get()
    if notes is not None:
        notes[note] = None


@contextmanager
def collected() -> Iterator[dict[str, None]]:
    """Collect such lines in all that follows, in this thread: the keys, in their order."""
    notes = dict[str, None]()
    token = _BESIDE.set(notes)
    try:
        yield notes
    finally:
        _BESIDE.reset(token)
