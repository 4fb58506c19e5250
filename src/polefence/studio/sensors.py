"""Sensors ticked on and off, with the ride that is proved beside each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import panel as pn

from polefence.base.errors import PolefenceError
from polefence.proof.text import visible
from polefence.studio.palette import FITTED
from polefence.studio.question import Found, Question
from polefence.studio.subject import Subject
from polefence.studio.words import safe


class Sensors:
    """The pane.

    Parameters
    ----------
    subject : Subject
    ticked : callable
        Called with the signals that are measured, once that changes.
    """

    def __init__(self, subject: Subject, ticked: Callable[[tuple[str, ...]], object]) -> None:
        self.subject, self._ticked, self._quiet = subject, ticked, False
        self.head = pn.pane.HTML("")
        self.boxes, self.texts = dict[str, Any](), dict[str, Any]()
        for name in subject.signals:
            first = name in subject.measured
            box = pn.widgets.Checkbox(label=visible(name), value=first, stylesheets=[FITTED])
            box.param.watch(lambda _: self._changed(), "value")
            self.boxes[name], self.texts[name] = box, pn.pane.HTML("")

    @property
    def view(self) -> Any:
        """A row a signal."""
        rows = (
            pn.FlexBox(box, self.texts[name], justify_content="space-between")
            for name, box in self.boxes.items()
        )
        return pn.Column(self.head, *rows, sizing_mode="stretch_width")

    def look(self, question: Question) -> None:
        """Tick what a question has measured."""
        self._quiet = True
        try:
            for name, box in self.boxes.items():
                box.value = name in question.measured
        finally:
            self._quiet = False

    def say(self, name: str, text: str) -> None:
        """Say something beside a signal, or above all."""
        note = self.texts.get(name, self.head)
        note.object = safe(text)

    def clear(self) -> None:
        """Say nothing beside any."""
        for note in (self.head, *self.texts.values()):
            note.object = ""

    def _changed(self) -> None:
        if not self._quiet:
            self._ticked(self.ordered({name for name, box in self.boxes.items() if box.value}))

    def ordered(self, names: set[str]) -> tuple[str, ...]:
        """Return signals in the order of the law of the spec, or of the list."""
        if names == set(self.subject.measured):
            return self.subject.measured
        return tuple(name for name in self.subject.signals if name in names)

    def compare(
        self,
        question: Question,
        say: Callable[[str, str], object],
        know: Callable[[Question, Found], object],
    ) -> None:
        """Work out the ride of a question, and with each signal the other way, as it comes.

        Parameters
        ----------
        say : callable
            Told a signal, and what stands beside it; of none what stands above all.
        know : callable
            Told the law of each.

        Raises
        ------
        PolefenceError
            If there is no law for what is ticked.
        """
        say("", "as ticked: being searched")
        result = question.search(self.subject)
        know(question, result)
        say("", f"as ticked: {self._level(result)}")
        for name in self.subject.signals:
            other = set(question.measured) ^ {name}
            if not other:
                say(name, "nothing else is measured")
                continue
            asked = replace(question, measured=self.ordered(other))
            word = "without" if name in question.measured else "with"
            say(name, f"{word} it: being searched")
            try:
                result = asked.search(self.subject)
            except PolefenceError:
                say(name, f"{word} it: none is proved")
                continue
            know(asked, result)
            say(name, f"{word} it: {self._level(result)}")

    def _level(self, result: Found) -> str:
        """Return the least that is proved, of what is minimised."""
        wanted = self.subject.wanted
        unit = "" if wanted is None else wanted.least.unit(self.subject.plant)
        level = result.bounds[0].replace(">=", "<=").rpartition("<=")[2]
        return f"proved {level.strip()} {unit}".rstrip()

    def recipe(self, question: Question) -> tuple[str, str]:
        """Return the command line and the Python of the best ride of what is ticked."""
        asked = replace(question, ride=True, given="")
        return asked.command(self.subject), asked.python(self.subject)
