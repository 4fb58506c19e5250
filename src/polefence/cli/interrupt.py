"""Ctrl-C: it ends a command in order, and where that takes too long at once.

Python hears of a signal between two of its own instructions. A factorisation of a large matrix or
a solver is one instruction, which may take minutes; so a thread hears of the signal too.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from functools import partial

PATIENCE = 1.0  # [s] that a command has to end by itself


@contextmanager
def cut_off(end: Callable[[], None]) -> Iterator[None]:
    """Call a function that ends the process some time after Ctrl-C, unless all is over by then."""
    posix = os.name == "posix"  # elsewhere a pipe may not be what hears of signals
    if not posix or threading.current_thread() is not threading.main_thread():
        yield
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    over, here = threading.Event(), copy_context()
    watch = partial(_wait, read, over, partial(here.run, end))
    threading.Thread(target=watch, daemon=True).start()
    before = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    try:
        yield
    finally:
        over.set()
        signal.set_wakeup_fd(before)
        os.close(write)


def _wait(read: int, over: threading.Event, end: Callable[[], None]) -> None:
    with open(read, "rb", buffering=0) as pipe:
        while (heard := pipe.read(1)) and heard[0] != signal.SIGINT:
            pass
    if heard and not over.wait(PATIENCE):
        end()
