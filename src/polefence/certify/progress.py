"""Progress of a search and of its proofs, for those who call from Python."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from polefence.base.explained import explained
from polefence.base.progress import Listener, note, told
from polefence.proof.work import followed


@explained
@contextmanager
def progress(listener: Listener) -> Iterator[None]:
    """Tell a listener what is being done in all that follows, in this thread.

    Parameters
    ----------
    listener : callable
        Called with a line of text whenever a stage of the work begins, goes on or ends:
        ``with polefence.progress(print): polefence.tightest(plant, -40)``. The text is empty where
        nothing is under way. What it raises ends the work.
    """
    with told(listener), followed(lambda k: note(f"proof, inequality {k}" if k else "")):
        yield
