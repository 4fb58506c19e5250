"""What is looked at: the question, the car on its road; and its history."""

from __future__ import annotations

from dataclasses import dataclass, replace
from shlex import quote
from typing import Any

from polefence.proof.short import Short
from polefence.region.regions import Region
from polefence.studio.question import Question
from polefence.studio.rides import ROADS, python
from polefence.studio.subject import Subject

LEAST_SPEED, MOST_SPEED = 5.0, 40.0  # [m/s]
MOST_TRAVEL = 0.2  # [m]
MOST_BACK = 200  # steps that are undone


@dataclass(frozen=True)
class State(Short):
    """What is looked at.

    Attributes
    ----------
    question : Question
    values : tuple of (str, float)
        Of each parameter, of the car that is looked at.
    road : str
        One of `rides.ROADS`, on which a car is looked at.
    speed : float
        [m/s]
    travel_limit : float
        Of the suspension either way, where bump stops are; 0 for none [m].
    beside : bool
        Whether cars at both ends of the first parameter are shown beside the one looked at.
    """

    question: Question
    values: tuple[tuple[str, float], ...] = ()
    road: str = "class C"
    speed: float = 20.0
    travel_limit: float = 0.0
    beside: bool = False

    @classmethod
    def first(cls, subject: Subject, region: Region, **asked: Any) -> State:
        """Return what a session begins with: the middle of all intervals."""
        middles = ((p.name, float((p.low + p.high) / 2)) for p in subject.plant.parameters)
        return cls(Question(region, subject.measured, **asked), tuple(middles))

    @property
    def region(self) -> Region:
        """Where the poles are to be."""
        return self.question.region

    def asking(self, **changed: Any) -> State:
        """Return it with another question, to which nothing is given."""
        return replace(self, question=replace(self.question, **{"given": ""} | changed))

    def at(self, name: str, value: float) -> State:
        """Return it with another value of a parameter."""
        return replace(self, values=tuple((k, value if k == name else v) for k, v in self.values))

    def drive(self, subject: Subject) -> str:
        """Return the command line that drives the car that is looked at, with its design."""
        values = "".join(f" --set {name}={value!r}" for name, value in self.values)
        road = f"{ROADS[self.road].option} --speed {self.speed!r}"
        stops = f" --travel-limit {self.travel_limit!r}" if self.travel_limit else ""
        laws = f"--law passive --law {quote(self.question.given or 'design')}"
        return f"polefence simulate {quote(subject.name)} {laws} {road}{stops}{values}"

    def drive_python(self, subject: Subject) -> str:
        """Return the Python that does, behind that of `python`."""
        values = dict(self.values), self.road, self.speed, self.travel_limit
        return python(subject.car, subject.name, *values, subject.dampers)

    def python(self, subject: Subject) -> str:
        """Return the Python that designs this, and its gain for the car that is looked at.

        For a plant without parameters that is the middle of its vertices.
        """
        N = len(subject.plant.vertices)
        values = ", ".join(f"{name}={value!r}" for name, value in self.values)
        gain = f"gain_at({values})" if values else f"gain([1 / {N}] * {N})"
        code = self.question.python(subject)
        save = "" if self.question.given else '\ndesign.save("design")'
        return f"{code}\nK = design.law.{gain}{save}"


@dataclass(frozen=True)
class History(Short):
    """A state, those before it, and those that were undone."""

    now: State
    past: tuple[State, ...] = ()
    future: tuple[State, ...] = ()

    def then(self, state: State) -> History:
        """Return it after a change."""
        if state == self.now:
            return self
        return History(state, (*self.past, self.now)[-MOST_BACK:])

    def back(self) -> History:
        """Return it with the last change undone; itself where there is none."""
        if not self.past:
            return self
        return History(self.past[-1], self.past[:-1], (self.now, *self.future))

    def forward(self) -> History:
        """Return it with what was undone last done again; itself where nothing was."""
        if not self.future:
            return self
        return History(self.future[0], (*self.past, self.now), self.future[1:])
