"""The newest question answered: a law at once, its proof when it is there; the older ones end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from polefence.base.errors import PolefenceError
from polefence.design.certificate import Check
from polefence.design.design import Design, check
from polefence.design.progress import progress
from polefence.design.signals.placed import place, tightest
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.family import UncertainPlant
from polefence.region.regions import Disk, HalfPlane, Region

ROOM = 1.1  # times the smallest radius, that a session begins with
PAUSE = 0.1  # [s] before a proof begins
THREAD = "polefence studio"  # name of threads
AT_ONCE = 2  # one that ends where it next tells how far it is, and the newest


@dataclass(frozen=True, eq=False)
class Answer:
    """What is known of a question so far.

    Attributes
    ----------
    number : int
        Of the question.
    region : Region
    design : Design, optional
        What was found in floats; None where nothing was.
    check : Check, optional
        What the checker says of it; None while it is at work.
    reason : str
        Why nothing was found.
    """

    number: int
    region: Region
    design: Design | None = None
    check: Check | None = None
    reason: str = ""

    @property
    def final(self) -> bool:
        """Whether no more is to come."""
        return self.check is not None or self.design is None


def first_region(plant: UncertainPlant) -> Region:
    """Return a region that a plant can have: a disk a little larger than the smallest."""
    if plant.sample_time is not None:
        return Disk(0.0, 1.0)
    rate = float(f"{typical_rate(plant.A):.2g}")
    with suppress(PolefenceError):
        part = tightest(plant, -rate).region
        radius = ROOM * part.radius if isinstance(part, Disk) else rate
        if radius < rate:
            return Disk(-rate, float(f"{max(radius, rate / 2):.3g}"))
    return HalfPlane(0.0)


class SupersededError(Exception):
    """Ends work whose question is no longer the newest."""


class Newest:
    """Designs for what was asked last.

    Parameters
    ----------
    plant : UncertainPlant
    tell : callable
        Called with each `Answer` to the newest question, in another thread.
    """

    def __init__(self, plant: UncertainPlant, tell: Callable[[Answer], object]) -> None:
        self._plant, self._tell = plant, tell
        self._room = threading.Semaphore(AT_ONCE)
        self._lock, self._number = threading.Lock(), 0
        self._asked = threading.Condition(self._lock)

    @property
    def number(self) -> int:
        """That of the newest question."""
        return self._number

    def ask(self, region: Region, method: str) -> int:
        """Ask for a law; return the question's number. What was asked before is given up."""
        with self._lock:
            self._number += 1
            number = self._number
            self._asked.notify_all()
        # what is inside the kernel when the page is closed must not keep the process
        own = Answer(number, region)
        threading.Thread(target=self._answer, args=(own, method), name=THREAD, daemon=True).start()
        return number

    def close(self) -> None:
        """Give up what is asked, and take no more."""
        with self._lock:
            self._number += 1
            self._asked.notify_all()

    def _answer(self, own: Answer, method: str) -> None:
        def heed(_: str = "") -> None:
            if own.number != self._number:
                raise SupersededError

        try:
            with self._room, progress(heed):
                heed()
                try:
                    design = place(self._plant, own.region, method, allow_unproved=True)
                except PolefenceError as error:
                    self._say(replace(own, reason=" ".join(str(error).split())))
                    return
                own = replace(own, design=design)
                self._say(own)
                self._wait(own.number)
                heed()
                self._say(replace(own, check=check(design)))
        except SupersededError:
            return
        except Exception as error:
            self._say(replace(own, design=None, reason=f"a fault of ours: {error!r}"))
            raise

    def _wait(self, number: int) -> None:
        """Wait a little for a newer question, whose law a proof of this one would only delay."""
        with self._asked:
            self._asked.wait_for(lambda: number != self._number, PAUSE)

    def _say(self, own: Answer) -> None:
        with self._lock:
            if own.number == self._number:
                self._tell(own)
