"""Variants of a spec: the same TOML with some of its numbers changed, as text again."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from fractions import Fraction
from typing import Any

from polefence.base.errors import SpecError, shown, suggest
from polefence.plant.expression import decimal_text
from polefence.plant.spec import parse


def numbers_of(text: str, source: str = "spec") -> dict[str, Fraction]:
    """Return the numbers of a spec that a variant may change, by their names.

    Constants by their own name, ends of ranges as ``NAME.low`` and ``NAME.high``, any other number
    that has a key by its keys, ``car.wheel.front.mass``.

    Raises
    ------
    SpecError
        If it is no TOML.
    """
    return {name: table[key] for name, (table, key) in _places(parse(text, source)).items()}


def varied(text: str, values: Mapping[str, Fraction], source: str = "spec") -> str:
    """Return the spec with these numbers, exactly, as TOML.

    Raises
    ------
    SpecError
        If it has no such number.
    """
    data = parse(text, source)
    places = _places(data)
    for name, value in values.items():
        if name not in places:
            raise SpecError(
                f"{source}: has no number {shown(name)} that could vary, neither a constant nor "
                f"NAME.low or NAME.high of a range nor another key; {suggest(name, places)}"
            )
        table, key = places[name]
        table[key] = value
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in data.items())


def _places(data: dict[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Return where each number is: its table or list, and the key there."""
    places = dict[str, tuple[Any, Any]]()
    for name, place in _leaves(data, ()):
        places[name] = place
    for name, table in _tables(data.get("parameter")):
        ends = table.get("range")
        if isinstance(ends, list) and len(ends) == 2:
            places |= {
                f"{name}.{end}": (ends, k)
                for end, k in (("low", 0), ("high", 1))
                if _is_number(ends[k])
            }
    constants = data.get("constants")
    if isinstance(constants, dict):
        places |= {name: (constants, name) for name, x in constants.items() if _is_number(x)}
    return places


def _leaves(table: dict[str, Any], above: tuple[str, ...]) -> Iterable[tuple[str, tuple[Any, Any]]]:
    for key, value in table.items():
        path = (*above, key)
        if isinstance(value, dict):
            yield from _leaves(value, path)
        elif _is_number(value) and path[0] != "constants":
            yield ".".join(path), (table, key)


def _tables(value: Any) -> Iterable[tuple[str, dict[str, Any]]]:
    items = value.items() if isinstance(value, dict) else ()
    return ((name, table) for name, table in items if isinstance(table, dict))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | Fraction) and not isinstance(value, bool)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        entries = ", ".join(f"{_key(key)} = {_value(x)}" for key, x in value.items())
        return f"{{{entries}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Fraction):
        return decimal_text(value)
    if isinstance(value, int | Decimal):
        return str(value).lower()
    return str(value)  # a date, which is refused where its key is known


def _text(text: str) -> str:
    """Return a basic string of TOML."""
    escaped = []
    for c in text:
        if c in '"\\':
            escaped.append(f"\\{c}")
        elif ord(c) < 32 or ord(c) == 127:
            escaped.append(f"\\u{ord(c):04x}")
        else:
            escaped.append(c)
    return f'"{"".join(escaped)}"'
