"""The newest question answered: a law at once, its proof when it is there; the older ones end."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from polefence.base.errors import PolefenceError
from polefence.certify.certificate import Check
from polefence.certify.design import FILE_NAME, Design, check_document
from polefence.certify.progress import progress
from polefence.lmi.solve.smallest import typical_rate
from polefence.proof.short import Short
from polefence.region.regions import Disk, HalfPlane, Region
from polefence.search.place import tightest
from polefence.studio.question import Found, Question
from polefence.studio.subject import Subject

THREAD = "polefence studio"  # name of threads
MOST_KNOWN = 100  # answers that are kept


@dataclass(frozen=True, eq=False)
class Answer(Short):
    """What is known of a question so far.

    Attributes
    ----------
    number : int
        Of the question.
    question : Question
    result : Found, optional
        What was found in floats; None where nothing was.
    check : Check, optional
        What the checker says of it; None while it is at work.
    reason : str
        Why nothing was found.
    refuted : bool
        Whether there is a proof that nothing can be.
    """

    number: int
    question: Question
    result: Found | None = None
    check: Check | None = None
    reason: str = ""
    refuted: bool = False

    @property
    def design(self) -> Design | None:
        """The law that was found."""
        return None if self.result is None else self.result.design

    @property
    def final(self) -> bool:
        """Whether no more is to come."""
        return self.check is not None or self.result is None

    @property
    def proved(self) -> bool:
        """Whether everything is that is claimed."""
        return self.check is not None and self.check.proved


def first_region(subject: Subject) -> Region:
    """Return a region that a law can keep: for one of all states, a disk little above the least."""
    plant = subject.plant
    if plant.sample_time is not None:
        return Disk(0.0, 1.0)
    if subject.wanted is not None and not subject.wanted.words:
        return HalfPlane(0.0)  # the spec asks for a ride: a tight region is not what it is about
    rate = float(f"{typical_rate(plant.A):.2g}")
    tuned = Question(HalfPlane(0.0), subject.measured).structure(subject) is not None
    with suppress(PolefenceError):
        part = HalfPlane(0.0) if tuned else tightest(plant, -rate).region
        # a little more room than the smallest radius
        radius = 1.1 * part.size if part.circle else rate
        if radius < rate:
            return Disk(-rate, float(f"{max(radius, rate / 2):.3g}"))
    return HalfPlane(0.0)


class SupersededError(Exception):
    """Ends work that nobody waits for any longer."""


def in_background(
    work: Callable[[], object],
    wanted: Callable[[], bool],
    fault: Callable[[str], object],
    going: Callable[[str], object] = str,
) -> None:
    """Do work in a thread of its own, which ends where it is no longer wanted.

    Parameters
    ----------
    work : callable
        Tells by itself what it finds.
    wanted : callable
    fault : callable
        Told what it raises, in one line.
    going : callable
        Told in words how far it is, from time to time.
    """
    told = [time.monotonic()]

    def heed(words: str = "") -> None:
        if not wanted():
            raise SupersededError
        if words and time.monotonic() > told[0] + 0.5:  # [s] between two reports
            told[0] = time.monotonic()
            going(words)

    def run() -> None:
        try:
            with progress(heed):
                heed()
                work()
        except SupersededError:
            return
        except PolefenceError as error:
            fault(" ".join(str(error).split()))
        except Exception as error:
            fault(f"a bug in Polefence: {error!r}")
            raise

    # what is inside the kernel when the page is closed must not keep the process
    threading.Thread(target=run, name=THREAD, daemon=True).start()


def settled(seconds: float) -> bool:
    """Wait for the end of all work in the background, so long [s]; return whether it came.

    A thread that is in the kernel while Python ends would abort the process.
    """
    end = time.monotonic() + seconds
    threads = [thread for thread in threading.enumerate() if thread.name == THREAD]
    for thread in threads:
        thread.join(max(end - time.monotonic(), 0.0))
    return not any(thread.is_alive() for thread in threads)


class Newest:
    """Laws for what was asked last.

    Parameters
    ----------
    subject : Subject
    tell : callable
        Called with each `Answer` to the newest question, in another thread.
    going : callable
        Called with its number and words about how far the search or the proof is.
    """

    def __init__(
        self,
        subject: Subject,
        tell: Callable[[Answer], object],
        going: Callable[[int, str], object] = lambda number, words: None,  # noqa: ARG005
    ) -> None:
        self._subject, self._tell, self._going = subject, tell, going
        # one search that ends at its next report of progress, and the newest
        self._room = threading.Semaphore(2)
        self._lock, self._number = threading.Lock(), 0
        self._asked = threading.Condition(self._lock)
        self._known = dict[Question, Answer]()

    @property
    def number(self) -> int:
        """That of the newest question."""
        return self._number

    def know(self, question: Question, result: Found) -> None:
        """Take over what was found elsewhere; it is proved when it is asked for."""
        with self._lock:
            self._keep(Answer(0, question, result))

    def ask(self, question: Question) -> int:
        """Ask for a law; return the question's number. What was asked before is given up."""
        with self._lock:
            self._number += 1
            answer = Answer(self._number, question)
            self._asked.notify_all()

        def fault(reason: str) -> None:
            self._say(replace(answer, reason=reason))

        in_background(
            lambda: self._answer(answer),
            lambda: answer.number == self._number,
            fault,
            lambda words: self._going(answer.number, words),
        )
        return answer.number

    def close(self) -> None:
        """Give up what is asked, and take no more."""
        with self._lock:
            self._number += 1
            self._asked.notify_all()

    def _answer(self, answer: Answer) -> None:
        with self._room:
            if answer.number != self._number:
                return
            known = self._known.get(answer.question)
            if known is not None:
                answer = replace(known, number=answer.number)
            if answer.result is None:
                answer = self._search(answer)
            else:
                self._say(replace(answer, check=None))
            if answer.result is not None and answer.check is None:
                self._wait(answer.number)
                if answer.number == self._number:
                    answer = replace(
                        answer, check=check_document(answer.result.document, Path(FILE_NAME))
                    )
            self._say(answer)

    def _search(self, answer: Answer) -> Answer:
        try:
            answer = replace(answer, result=answer.question.search(self._subject))
        except PolefenceError as error:
            refuted = getattr(error, "refutation", None) is not None
            return replace(answer, reason=" ".join(str(error).split()), refuted=refuted)
        self._say(answer)
        return answer

    def _wait(self, number: int) -> None:
        """Wait a little for a newer question, whose law a proof of this one would only delay."""
        with self._asked:
            # [s] in which a newer question may come, before a proof begins
            self._asked.wait_for(lambda: number != self._number, 0.1)

    def _say(self, answer: Answer) -> None:
        with self._lock:
            if answer.number == self._number:
                if answer.final:
                    self._keep(answer)
                self._tell(answer)

    def _keep(self, answer: Answer) -> None:
        if not answer.reason.startswith("a bug"):
            self._known.pop(answer.question, None)
            self._known[answer.question] = answer
            for question in list(self._known)[:-MOST_KNOWN]:
                del self._known[question]
