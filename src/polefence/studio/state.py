"""What a session is about: region, method and the car that is looked at; its history."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any

from polefence.base.errors import InputError, SpecError, suggest
from polefence.base.files import read_text
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import MAX_BYTES, loads
from polefence.region.regions import Region
from polefence.region.text import parse_region
from polefence.studio.rides import ROADS

FORMAT = "polefence studio"
PLANT, SESSION = "plant.toml", "session.json"  # files that a page saves
HEAD = 400  # characters in which a file says what it is
KEYS = ("format", "spec", "region", "method", "road", "speed", "values")
LEAST_SPEED, MOST_SPEED = 5.0, 40.0  # [m/s]
MOST_BACK = 200  # steps that are undone


@dataclass(frozen=True)
class State:
    """What is looked at.

    Attributes
    ----------
    region : Region
    method : str
        One of `METHODS`.
    road : str
        One of `rides.ROADS`, on which a car is looked at.
    speed : float
        [m/s]
    values : tuple of (str, float)
        Of each parameter, of the car that is looked at.
    """

    region: Region
    method: str = METHODS[-1]
    road: str = "class C"
    speed: float = 20.0
    values: tuple[tuple[str, float], ...] = ()

    @classmethod
    def first(cls, plant: UncertainPlant, region: Region, method: str = METHODS[-1]) -> State:
        """Return what a session begins with: the middle of all intervals."""
        middles = ((p.name, float((p.low + p.high) / 2)) for p in plant.parameters)
        return cls(region, method, values=tuple(middles))

    def at(self, name: str, value: float) -> State:
        """Return it with another value of a parameter."""
        return replace(self, values=tuple((k, value if k == name else v) for k, v in self.values))

    def command(self, spec: str) -> str:
        """Return the command line that designs this."""
        words = f"polefence design {quote(spec)} --region {quote(str(self.region))}"
        return f"{words} --method {self.method} -o design"

    def drive(self, spec: str) -> str:
        """Return the command line that drives the car that is looked at, with that design."""
        values = "".join(f" --set {name}={value!r}" for name, value in self.values)
        road = f"{ROADS[self.road].option} --speed {self.speed:g}"
        return f"polefence simulate {quote(spec)} --law passive --law design {road}{values}"

    def python(self, spec: str, vertices: int) -> str:
        """Return the Python that designs this, and its gain for the car that is looked at.

        For a plant without parameters that is the middle of its so many vertices.
        """
        values = ", ".join(f"{name}={value!r}" for name, value in self.values)
        gain = f"gain_at({values})" if values else f"gain([1 / {vertices}] * {vertices})"
        return "\n".join(
            (
                "import polefence as pf",
                "",
                f"plant = pf.load({spec!r})",
                f"region = pf.parse_region({str(self.region)!r})",
                f"design = pf.place(plant, region, {self.method!r})",
                f"K = design.law.{gain}",
                'design.save("design")',
            )
        )


@dataclass(frozen=True)
class History:
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


@dataclass(frozen=True, eq=False)
class Session:
    """A spec and what is looked at of it, as a file keeps them.

    Attributes
    ----------
    spec : str
        The text.
    plant : UncertainPlant
    state : State
    """

    spec: str
    plant: UncertainPlant
    state: State

    def dumps(self) -> str:
        """Return it as JSON."""
        own = self.state
        table = {
            "format": FORMAT,
            "spec": self.spec,
            "region": str(own.region),
            "method": own.method,
            "road": own.road,
            "speed": own.speed,
            "values": dict(own.values),
        }
        return json.dumps(table, indent=1) + "\n"


def is_session(path: Path) -> bool:
    """Whether a file says that it is one of a session; what cannot be read says nothing."""
    try:
        head = read_text(path, MAX_BYTES, SpecError)[:HEAD]
    except SpecError:
        return False
    return re.search(rf'"format"\s*:\s*"{FORMAT}"', head) is not None


def read_session(path: Path) -> Session:
    """Read a session's file.

    Raises
    ------
    InputError
        Naming file, key, value and remedy.
    """
    try:
        table = json.loads(read_text(path, MAX_BYTES, SpecError))
    except (ValueError, RecursionError) as error:
        raise SpecError(f"{path}: no JSON: {error}") from error
    try:
        return _session(table)
    except InputError as error:
        raise SpecError(f"{path}: {error}") from error


def _session(table: Any) -> Session:
    if not isinstance(table, dict) or table.get("format") != FORMAT:
        raise SpecError(f"format is not {FORMAT!r}; `polefence studio` writes such files")
    for key in table:
        if key not in KEYS:
            raise SpecError(f"unknown key {key!r}; {suggest(key, KEYS)}")
    for key in ("spec", "region", "method"):
        if not isinstance(table.get(key), str):
            raise SpecError(f"{key} is missing, or no text")
    if table["method"] not in METHODS:
        raise SpecError(f"method = {table['method']!r}: {suggest(table['method'], METHODS)}")
    road, speed = table.get("road", "class C"), table.get("speed", 20.0)
    if not isinstance(road, str) or road not in ROADS:
        raise SpecError(f"road = {road!r}: {suggest(str(road), ROADS)}")
    if not _is_number(speed) or not LEAST_SPEED <= speed <= MOST_SPEED:
        limits = f"from {LEAST_SPEED:g} to {MOST_SPEED:g} m/s"
        raise SpecError(f"speed = {speed!r} must be a number {limits}")
    plant = loads(table["spec"], "its spec")
    state = State.first(plant, parse_region(table["region"]), table["method"])
    state = replace(state, road=road, speed=float(speed))
    return Session(table["spec"], plant, _valued(plant, state, table.get("values", {})))


def _valued(plant: UncertainPlant, state: State, values: Any) -> State:
    if not isinstance(values, Mapping):
        raise SpecError("values must be a table of numbers")
    known = {p.name: p for p in plant.parameters}
    for name, value in values.items():
        if name not in known:
            raise SpecError(f"values: no parameter {name!r}; {suggest(name, known)}")
        own = known[name]
        if not _is_number(value) or not float(own.low) <= value <= float(own.high):
            low, high = float(own.low), float(own.high)
            raise SpecError(f"values: {name} = {value!r} must be a number from {low:g} to {high:g}")
        state = state.at(name, float(value))
    return state


def _is_number(value: Any) -> bool:
    known = isinstance(value, int | float) and not isinstance(value, bool)
    return known and abs(value) < 1e300  # false of nan, and of what no double holds
