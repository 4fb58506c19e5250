"""A line on the terminal that says what is being done, rewritten in place; and what is printed.

The line is there only where standard error is a terminal, and gone before anything is printed.
"""

from __future__ import annotations

import os
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import TextIO

from polefence.certify.progress import progress
from polefence.proof.text import visible

COLUMNS = 80  # of a terminal that does not say
COLOURS = {"proved": "1;32", "refuted": "1;31", "undecided": "1;33"}


class Line:
    """The line. A thread draws it, so that telling it costs nothing, whoever is busy."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.words, self.drawn, self.width = stream, "", "", 0
        self.begin = time.monotonic()
        self.lock, self.over = threading.RLock(), threading.Event()
        self.thread = threading.Thread(target=self._draw, daemon=True)
        self.thread.start()

    def tell(self, words: str) -> None:
        """Say what is being done."""
        self.words = words

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the line away, and keep it away while something is printed."""
        with self.lock:
            if self.width:
                self._put("")
            yield

    def close(self) -> None:
        """Take the line away for good."""
        self.over.set()
        self.thread.join()
        with self.aside():
            pass

    def _draw(self) -> None:
        while not self.over.wait(0.2):  # [s] between two drawings
            words = f"{self.words} ({time.monotonic() - self.begin:.0f} s)" if self.words else ""
            with self.lock:
                if words != self.drawn and not self.over.is_set():
                    self._put(words)

    def _put(self, words: str) -> None:
        """Write over what is there, as much as one row holds; of a long text its end."""
        room = _columns(self.stream) - 1
        code = self.stream.encoding or "utf-8"
        shown = visible(words).encode(code, "backslashreplace").decode(code)
        shown = shown if len(shown) <= room else "..." + shown[3 - room :]
        text = f"\r{shown:<{min(self.width, room)}}"
        self.drawn, self.width = words, len(shown)
        self.stream.write(text if shown else f"{text}\r")
        self.stream.flush()


def _columns(stream: TextIO) -> int:
    try:
        return os.get_terminal_size(stream.fileno()).columns or COLUMNS
    except (OSError, ValueError):
        return COLUMNS


_LINE: ContextVar[Line | None] = ContextVar("line", default=None)


@contextmanager
def shown_progress(wanted: bool = True) -> Iterator[None]:
    """Show what is being done in all that follows, where standard error is a terminal."""
    if not (wanted and sys.stderr.isatty()):
        yield
        return
    line = Line(sys.stderr)
    token = _LINE.set(line)
    try:
        with progress(line.tell):
            yield
    finally:
        _LINE.reset(token)
        line.close()


def aside() -> AbstractContextManager[None]:
    """Keep the line away, where there is one, while something is printed."""
    line = _LINE.get()
    return nullcontext() if line is None else line.aside()


def say(*lines: object, file: TextIO | None = None, verdict: str = "") -> None:
    """Print each of these as one line, whatever names and paths are in it.

    All that commands print goes this way: a newline or an escape in a name is shown, not obeyed,
    and what the terminal has no letter for does not stop the answer. On a terminal the verdict is
    coloured where the first line has it; the line alone does not tell, for names may be words.
    There a sentence that is too long is folded, and what follows is indented further.
    """
    stream = sys.stdout if file is None else file
    code = getattr(stream, "encoding", None) or "utf-8"
    with aside():
        for k, line in enumerate(lines):
            shown = visible(str(line)).encode(code, "backslashreplace").decode(code)
            shown = folded(shown, stream) if stream.isatty() else shown
            if k == 0 and verdict in COLOURS and coloured(stream):
                shown = shown.replace(verdict, f"\x1b[{COLOURS[verdict]}m{verdict}\x1b[0m", 1)
            print(shown, file=stream, flush=True)


def folded(text: str, stream: TextIO) -> str:
    """Fold a sentence for a terminal; a table's row and a file that was written stay one line."""
    start = len(text) - len(text.lstrip())
    width = min(_columns(stream), 100)
    if len(text) <= width or "   " in text[start:] or text.startswith("saved: "):
        return text
    further = " " * (start + 4)
    return textwrap.fill(
        text,
        width,
        subsequent_indent=further,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    )


def coloured(stream: TextIO) -> bool:
    """Whether a stream is a terminal that shows colours, and nobody has asked for none."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return not plain and stream.isatty()
