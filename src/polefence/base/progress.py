"""Progress of long work in words: what is being done now, told to whoever listens.

Whoever works names its stages, and may note how far the innermost one is. Nothing that is told
depends on the clock, and no answer on whether anybody listens.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TypeVar

Listener = Callable[[str], object]
Item = TypeVar("Item")


@dataclass(eq=False)
class Stage:
    """Something that is being done, and how far it is."""

    words: str
    note: str = ""

    def now(self, words: str) -> None:
        """Change the words."""
        self.words, self.note = words, ""
        _tell()


@dataclass(eq=False)
class _Told:
    """A listener, and the stages that are under way, the outermost first.

    Once it has raised something the work is at its end: it is told of no stage that ends with it.
    """

    listener: Listener
    stages: list[Stage] = field(default_factory=lambda: [Stage("")])
    ended: bool = False

    def tell(self) -> None:
        if self.ended:
            return
        words = [text for stage in self.stages for text in (stage.words, stage.note) if text]
        try:
            self.listener(", ".join(words))
        except BaseException:
            self.ended = True
            raise


_TOLD: ContextVar[_Told | None] = ContextVar("told", default=None)


def _tell() -> None:
    told = _TOLD.get()
    if told is not None:
        told.tell()


@contextmanager
def told(listener: Listener) -> Iterator[None]:
    """Tell a listener what is being done in all that follows, in this thread.

    It is called with a line of text, the stages from the outermost on, whenever one begins, goes on
    or ends; with an empty text where none is left.
    """
    token = _TOLD.set(_Told(listener))
    try:
        yield
    finally:
        _TOLD.reset(token)


@contextmanager
def stage(words: str) -> Iterator[Stage]:
    """Name what is done inside."""
    begun, listened = Stage(words), _TOLD.get()
    if listened is None:
        yield begun
        return
    listened.stages.append(begun)
    listened.tell()
    try:
        yield begun
    finally:
        listened.stages.remove(begun)
        listened.stages[-1].note = ""
        listened.tell()


def note(words: str) -> None:
    """Say how far the innermost stage is."""
    listened = _TOLD.get()
    if listened is not None:
        listened.stages[-1].note = words
        listened.tell()


def counted(items: Iterable[Item], words: str) -> Iterator[Item]:
    """Yield items; what is done with each is a stage, "words 3 of 6"."""
    total = f" of {len(items)}" if isinstance(items, Sized) else ""
    for number, item in enumerate(items, 1):
        with stage(f"{words} {number}{total}"):
            yield item
