"""Values in one short line: what `repr` says of them, arrays and tables by their size alone."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from fractions import Fraction
from functools import wraps
from typing import Any

MOST = 200  # characters of a value
INNER = 60  # of a value in another


class Short:
    """A dataclass whose `repr` is one short line.

    Fields that have their defaults are left out, and those that are too long for the line named
    without their values. A class may say it in words of its own, which are cut.
    """

    def __init_subclass__(cls, **more: Any) -> None:
        """Give the class its `repr`, or that of a base, cut: `dataclass` replaces none it has."""
        super().__init_subclass__(**more)
        said = cls.__repr__

        @wraps(said)
        def cut(self: Any) -> str:
            return within(said(self))

        cls.__repr__ = cut  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return _of_fields(self, MOST)


def within(text: str, most: int = MOST) -> str:
    """Return a text of so many characters at most; one of ``<...>`` keeps its end."""
    if len(text) <= most:
        return text
    end = "...>" if text.startswith("<") else "..."
    return text[: most - len(end)] + end


def short(value: Any, most: int = MOST) -> str:
    """Return a value in so many characters at most, without writing out what is larger."""
    if isinstance(value, str):
        return repr(value) if len(value) + 2 <= most else repr(value[: most - 5]) + "..."
    if isinstance(value, Fraction) and len(str(value)) + 10 > most // 2:
        return f"<Fraction {_rounded(value)}>"
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        size = " x ".join(map(str, value.shape))
        return f"<array {size}>" if size else f"<array of one: {value}>"
    if is_dataclass(value) and not isinstance(value, Short | type):
        return _of_fields(value, most)
    if isinstance(value, Collection) and not isinstance(value, Short | bytes):
        return _of_several(value, most)
    text = value.__name__ if isinstance(value, type) else " ".join(repr(value).split())
    return text if len(text) <= most else f"<{type(value).__name__}>"


def _rounded(value: Fraction) -> str:
    try:
        return f"{float(value):.6g}"
    except OverflowError:
        return "beyond 1e308"


def _of_several(value: Collection[Any], most: int) -> str:
    kind, count = type(value).__name__, len(value)
    size = f"<{kind} of {count}>"  # of more entries than six
    if count > 6 or not isinstance(value, Mapping | list | tuple):
        return size
    if isinstance(value, Mapping):
        inner = (f"{short(k, INNER)}: {short(v, INNER)}" for k, v in value.items())
        text = f"{{{', '.join(inner)}}}"
    else:
        inner = (short(item, INNER) for item in value)
        left, right = ("[", "]") if isinstance(value, list) else ("(", ")")
        text = f"{left}{', '.join(inner)}{',' if count == 1 and left == '(' else ''}{right}"
    return text if len(text) <= most else size


def _of_fields(value: Any, most: int) -> str:
    """Return what a dataclass is made of; of fields too long for the line their names alone."""
    name = type(value).__qualname__
    said = [
        (f.name, getattr(value, f.name)) for f in fields(value) if f.repr and _is_said(value, f)
    ]
    parts = [f"{key}={short(item, INNER)}" for key, item in said]
    for k in sorted(range(len(parts)), key=lambda k: -len(parts[k])):
        if len(name) + 2 + sum(map(len, parts)) + 2 * len(parts) <= most:
            break
        parts[k] = f"{said[k][0]}=..."
    return within(f"{name}({', '.join(parts)})", most)


def _is_said(value: Any, field: Field[Any]) -> bool:
    """Whether a field has another value than its default."""
    given = getattr(value, field.name, field.default)
    default = field.default
    if default is MISSING and field.default_factory is not MISSING:
        default = field.default_factory()
    if default is MISSING or given is default:
        return default is MISSING
    return type(given) is not type(default) or hasattr(given, "shape") or bool(given != default)
