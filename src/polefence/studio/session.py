"""Files of sessions: a spec, and what is looked at of it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from polefence.base.errors import InputError, SpecError, shown, suggest
from polefence.base.files import make_folder, read_text, write_documents, write_text
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.spec import MAX_BYTES
from polefence.proof.short import Short
from polefence.region.text import parse_region
from polefence.studio.question import Found
from polefence.studio.rides import ROADS
from polefence.studio.state import LEAST_SPEED, MOST_SPEED, MOST_TRAVEL, State
from polefence.studio.subject import Subject

FORMAT = "polefence studio"
SESSION = "session.json"
DESIGN = "design"  # the folder of the design beside a session
MOST_BYTES = 8 * MAX_BYTES  # of a session, in which a letter of its spec may take six
QUESTION = ("region", "method", "measured", "ride", "over", "limit", "given")
LOOKED_AT = ("road", "speed", "travel_limit", "beside", "values")


def is_session(path: Path) -> bool:
    """Whether a file says that it is one of a session; what cannot be read says nothing."""
    try:
        # a file says at its beginning what it is
        head = read_text(path, MOST_BYTES, SpecError)[:400]
    except SpecError:
        return False
    return re.search(rf'"format"\s*:\s*"{FORMAT}"', head) is not None


def put_spec(folder: Path, text: str) -> Path:
    """Write the spec of what has no file of its own into a folder; return its path.

    Raises
    ------
    OutputError
        If it cannot be written.
    InputError
        If another spec is there.
    """
    path = make_folder(folder) / "plant.toml"
    if path.is_symlink() or path.exists():
        if path.is_symlink() or read_text(path, MAX_BYTES, InputError) != text:
            raise InputError(f"{path}: the spec of something else; use -o with another folder")
    else:
        write_text(path, text)
    return path


@dataclass(frozen=True, eq=False)
class Session(Short):
    """A spec, and what is looked at of it.

    Attributes
    ----------
    text : str
        The spec.
    table : mapping
        What is looked at, as the file has it.
    """

    text: str
    table: Mapping[str, Any]

    @classmethod
    def of(cls, subject: Subject, state: State) -> Session:
        """Return that of a state."""
        asked = state.question
        table = {
            "region": str(asked.region),
            "method": asked.method,
            "measured": list(asked.measured),
            "ride": asked.ride,
            "over": asked.over,
            "limit": asked.limit,
            "given": bool(asked.given),
            **{key: getattr(state, key) for key in LOOKED_AT},
            "values": dict(state.values),
        }
        return cls(subject.text, table)

    def save(self, folder: Path) -> Path:
        """Write ``session.json`` into a folder; return its path.

        Raises
        ------
        OutputError
            If it cannot be written, or another's file is there.
        """
        return write_documents(folder, {SESSION: self.dumps()})[0]

    def dumps(self) -> str:
        """Return it as JSON."""
        return json.dumps({"format": FORMAT, "spec": self.text, **self.table}, indent=1) + "\n"

    @classmethod
    def read(cls, path: Path) -> Session:
        """Read the file of one; `state` says whether it makes sense.

        Raises
        ------
        SpecError
            If it is none.
        """
        try:
            table = json.loads(read_text(path, MOST_BYTES, SpecError))
        except (ValueError, RecursionError) as error:
            raise SpecError(f"{path}: no JSON: {error}") from error
        if not isinstance(table, dict) or table.pop("format", None) != FORMAT:
            raise SpecError(
                f"{path}: format is not {FORMAT!r}; `polefence studio` writes such files"
            )
        text, known = table.pop("spec", None), (*QUESTION, *LOOKED_AT)
        if not isinstance(text, str) or not _is_written(text):
            raise SpecError(f"{path}: spec is missing, or no text")
        for key in table:
            if key not in known:
                raise SpecError(f"{path}: unknown key {shown(key)}; {suggest(key, known)}")
        return cls(text, table)

    def state(self, subject: Subject, path: Path) -> State:
        """Return what is looked at.

        Raises
        ------
        SpecError
            Naming file, key, value and remedy.
        """
        try:
            state = self._state(subject)
            if self._given("given", _is_switch, "true or false", False):
                beside = path.parent / DESIGN
                if Found.read(beside).design.plant.digest != subject.plant.digest:
                    raise SpecError(f"given: {beside} is of another plant")
                state = state.asking(given=str(beside))
            return state
        except InputError as error:
            raise SpecError(f"{path}: {error}") from error

    def _state(self, subject: Subject) -> State:
        region = self._given("region", _is_text, "a region, 'disk(-40, 31)'")
        first = State.first(subject, parse_region(region))
        asked, limit = first.question, self.table.get("limit")
        known = {"method": METHODS, "over": ("", *(limit.title for limit in subject.overs))}
        words = {
            key: self._word(key, getattr(asked, key), choices) for key, choices in known.items()
        }
        if not (limit is None or (_is_number(limit) and limit > 0)):
            raise SpecError(f"limit = {shown(limit)} must be a positive number, or null")
        if (limit is None) != (not words["over"]):
            raise SpecError("over and limit go together; give both, or neither")
        state = first.asking(
            **words,
            limit=None if limit is None else float(limit),
            ride=self._given("ride", _is_switch, "true or false", asked.ride),
            measured=self._measured(subject),
        )
        state = replace(
            state,
            road=self._word("road", first.road, tuple(ROADS)),
            speed=self._number("speed", first.speed, LEAST_SPEED, MOST_SPEED),
            travel_limit=self._number("travel_limit", 0.0, 0.0, MOST_TRAVEL),
            beside=self._given("beside", _is_switch, "true or false", first.beside),
        )
        return self._valued(subject, state)

    def _given(self, key: str, fits: Callable[[Any], bool], what: str, default: Any = None) -> Any:
        value = self.table.get(key, default)
        if not fits(value):
            raise SpecError(f"{key} = {shown(value)} must be {what}")
        return value

    def _word(self, key: str, default: str, known: tuple[str, ...]) -> str:
        value = self.table.get(key, default)
        if not isinstance(value, str) or value not in known:
            raise SpecError(f"{key} = {shown(value)}: {suggest(str(value), known)}")
        return value

    def _number(self, key: str, default: float, low: float, high: float) -> float:
        value = self.table.get(key, default)
        if not _is_number(value) or not low <= value <= high:
            raise SpecError(f"{key} = {shown(value)} must be a number from {low:g} to {high:g}")
        return float(value)

    def _measured(self, subject: Subject) -> tuple[str, ...]:
        names = self.table.get("measured", list(subject.measured))
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise SpecError(f"measured = {shown(names)} must be a list of names")
        for name in names:
            if name not in subject.signals:
                raise SpecError(f"measured: no signal {name!r}; {suggest(name, subject.signals)}")
        if not names or len(set(names)) < len(names):
            raise SpecError("measured: give at least one signal, each once")
        return tuple(names)

    def _valued(self, subject: Subject, state: State) -> State:
        values = self.table.get("values", {})
        if not isinstance(values, dict):
            raise SpecError("values must be a table of numbers")
        known = {p.name: p for p in subject.plant.parameters}
        for name, value in values.items():
            if name not in known:
                raise SpecError(f"values: no parameter {shown(name)}; {suggest(name, known)}")
            low, high = float(known[name].low), float(known[name].high)
            if not _is_number(value) or not low <= value <= high:
                raise SpecError(
                    f"values: {name} = {shown(value)} must be a number from {low:g} to {high:g}"
                )
            state = state.at(name, float(value))
        return state


def _is_written(text: str) -> bool:
    """Whether a file can have a text as it is: half a pair of surrogates is no letter."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_switch(value: Any) -> bool:
    return isinstance(value, bool)


def _is_number(value: Any) -> bool:
    known = isinstance(value, int | float) and not isinstance(value, bool)
    return known and abs(value) < 1e300  # false of nan, and of what no double holds
