"""Sensors ticked on and off, with the ride that is proved beside each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import panel as pn

from polefence.base.errors import PolefenceError
from polefence.proof.text import visible
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
        self.boxes, self.texts = dict[str, Any](), dict[str, Any]()
        for name in subject.signals:
            box = pn.widgets.Checkbox(label=visible(name), value=name in subject.measured)
            box.param.watch(lambda _: self._changed(), "value")
            self.boxes[name], self.texts[name] = box, pn.pane.HTML("")

    @property
    def view(self) -> Any:
        """A row a signal."""
        rows = (
            pn.FlexBox(box, self.texts[name], justify_content="space-between")
            for name, box in self.boxes.items()
        )
        return pn.Column(*rows, sizing_mode="stretch_width")

    def look(self, question: Question) -> None:
        """Tick what a question has measured."""
        self._quiet = True
        try:
            for name, box in self.boxes.items():
                box.value = name in question.measured
        finally:
            self._quiet = False

    def say(self, name: str, text: str) -> None:
        """Say something beside a signal."""
        self.texts[name].object = safe(text)

    def clear(self) -> None:
        """Say nothing beside any."""
        for own in self.texts.values():
            own.object = ""

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
        """Work out the ride with each signal the other way; say it as it comes.

        Parameters
        ----------
        know : callable
            Told the law of each.
        """
        for name in self.subject.signals:
            other = set(question.measured) ^ {name}
            if not other:
                say(name, "nothing else is measured")
                continue
            asked = replace(question, ride=True, measured=self.ordered(other))
            word = "without" if name in question.measured else "with"
            say(name, f"{word} it: being searched")
            try:
                found = asked.found(self.subject)
            except PolefenceError:
                say(name, f"{word} it: none is proved")
                continue
            know(asked, found)
            level = found.bounds[0].rpartition("<=")[2].strip()
            say(name, f"{word} it: proved {level} {self._unit}".rstrip())

    @property
    def _unit(self) -> str:
        wanted = self.subject.wanted
        return "" if wanted is None else wanted.least.unit(self.subject.plant)

    def recipe(self, question: Question) -> tuple[str, str]:
        """Return the command line and the Python of the best ride of what is ticked."""
        asked = replace(question, ride=True)
        return asked.command(self.subject), asked.python(self.subject)
