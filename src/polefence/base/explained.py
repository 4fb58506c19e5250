"""Arguments of other kinds than a function takes: one line that names one, in place of what fails.

Whatever works is taken, annotated or not. Where a call fails with an error of Python's own, its
arguments are compared with the annotations: the first that does not fit is named, with a remedy.
Where all fit, the fault is ours, and the error is raised as it is.
"""

from __future__ import annotations

import inspect
import math
import types
import typing
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

from polefence.base.errors import InputError, PolefenceError, shown

P = ParamSpec("P")
R = TypeVar("R")

FAILURES = (TypeError, ValueError, AttributeError, LookupError, OverflowError)
REMEDIES = {
    "UncertainPlant": "polefence.load(path) reads one",
    "System": "UncertainPlant.from_vertices(As, Bs) takes matrices",
    "Parameter": 'for example polefence.Parameter("m1", 200, 300, "kg")',
    "Region": "for example polefence.Disk(-40, 31)",
    "Design": "polefence.place(plant, region) gives one",
    "Specification": 'for example polefence.Rms("suspension deflection")',
    "Structure": 'for example polefence.Structure(measured=("deflection",))',
    "Signal": "polefence.response.states(plant) has those of a plant",
    "Output": 'for example polefence.response.Output("y", "m", C=[[1, 0]])',
    "Damper": "polefence.vehicle.load_dampers(path) reads them",
    "Road": 'for example polefence.vehicle.random_road("C", 100)',
    "Workers": "polefence.fleet.processes(2) gives some",
    "Sampling": "for example polefence.vehicle.Sampling(0.005)",
}
WORDS = {
    float: "a finite number",
    complex: "a number",
    Fraction: "a finite number",
    int: "a whole number",
    str: "text",
    bool: "True or False",
    Path: "a path",
}


def explained(function: Callable[P, R]) -> Callable[P, R]:
    """Have a function name the argument that is of another kind than it takes, where it fails."""

    @wraps(function)
    def answer(*given: P.args, **named: P.kwargs) -> R:
        try:
            return function(*given, **named)
        except PolefenceError:
            raise
        except FAILURES as error:
            fault = _fault(function, given, named)
            if not fault:
                raise
            raise InputError(fault) from error

    return answer


def explained_fields(post_init: Callable[[Any], None]) -> Callable[[Any], None]:
    """Have a dataclass name the field that is of another kind than it takes, where it fails."""

    @wraps(post_init)
    def answer(self: Any) -> None:
        try:
            post_init(self)
        except PolefenceError:
            raise
        except FAILURES as error:
            hints, name = _hints(type(self)), type(self).__name__
            values = ((key, getattr(self, key, None), hint) for key, hint in hints.items())
            fault = _first(name, values)
            if not fault:
                raise
            raise InputError(fault) from error

    return answer


def _fault(function: Callable[..., Any], given: Any, named: Any) -> str:
    """Say which argument is of another kind; "" where all fit, or are not those of the function."""
    plain = inspect.unwrap(function)
    try:
        bound = inspect.signature(plain).bind(*given, **named)
    except TypeError:  # Python's own words are plain: an argument is missing, or unexpected
        return ""
    hints, kinds = _hints(plain), inspect.signature(plain).parameters
    single = [key for key in bound.arguments if kinds[key].kind not in (2, 4)]
    values = ((key, bound.arguments[key], hints[key]) for key in single if key in hints)
    return _first(plain.__qualname__.removesuffix(".__init__"), values)


def _first(name: str, values: Iterable[tuple[str, Any, Any]]) -> str:
    for key, value, hint in values:
        fault = _misfit(value, hint)
        if fault:
            return f"{name}: {key} {fault}"
    return ""


def _hints(subject: Any) -> dict[str, Any]:
    """Return the annotations of a function or a class, those that can be read."""
    hints = dict[str, Any]()
    for owner in reversed(subject.__mro__) if isinstance(subject, type) else [subject]:
        space = vars(inspect.getmodule(owner) or types) | {"Any": Any}
        for key, text in inspect.get_annotations(owner).items():
            one = types.SimpleNamespace(__annotations__={key: text})
            try:
                hints |= typing.get_type_hints(one, space)
            except (NameError, TypeError, AttributeError):  # a class that is not imported there
                hints[key] = text if str(text).isidentifier() else Any
    return {key: hint for key, hint in hints.items() if key != "return"}


def _misfit(value: Any, hint: Any) -> str:
    """Say how a value is none of a kind; "" where it is."""
    if _fits(value, hint):
        return ""
    what = "None" if value is None else shown(value)
    if isinstance(value, list | tuple):
        what = f"a {type(value).__name__} of other values"
    elif value is not None and not isinstance(value, str | Real) and not hasattr(value, "dtype"):
        what = f"a value of type {type(value).__name__}"
    remedies = (REMEDIES[name] for name in _names(hint) if name in REMEDIES)
    return f"must be {_words(hint)}, not {what}; {next(remedies, 'give one')}"


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is of a kind, its entries included, as far as an annotation says."""
    if isinstance(hint, str):
        return any(base.__name__ == hint for base in type(value).__mro__)
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is None or hint is types.NoneType:
        return value is None
    if origin is typing.Union or origin is types.UnionType:
        return any(_fits(value, option) for option in inner)
    if origin is Literal:
        return any(
            value is literal or (type(value) is type(literal) and value == literal)
            for literal in inner
        )
    kind = origin or hint
    if not isinstance(kind, type) or kind in (object, type):
        return True
    if kind.__name__ == "ndarray":
        return _is_array(value)
    if issubclass(kind, Mapping):
        pairs = value.items() if isinstance(value, Mapping) else ()
        fitting = (_fits(k, inner[0]) and _fits(v, inner[1]) for k, v in pairs if inner)
        return isinstance(value, Mapping) and all(fitting)
    if kind in (Sequence, Iterable, Iterator, Collection, list, tuple, set, frozenset):
        return _are(value, kind, inner)
    return _is(value, kind)


def _is(value: Any, kind: type) -> bool:
    if kind in (float, Fraction, complex):
        try:
            real = isinstance(value, Real) and not isinstance(value, bool)
            return (real and math.isfinite(value)) or (
                kind is complex and isinstance(value, complex)
            )
        except OverflowError:
            return False
    if kind is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if kind is Path:
        return isinstance(value, str | Path)
    try:
        return isinstance(value, kind)
    except TypeError:  # a protocol that is not looked at when it runs
        return True


def _are(value: Any, kind: Any, inner: tuple[Any, ...]) -> bool:
    """Whether a value holds several of a kind; what can be gone through once only is taken."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return False
    if getattr(value, "shape", None) == ():  # an array of one number, which has no entries
        return False
    if isinstance(value, Iterator) or not inner:
        return True
    if kind is tuple and inner[-1] is not Ellipsis:
        entries = list(value)
        return len(entries) == len(inner) and all(map(_fits, entries, inner))
    return all(_fits(entry, inner[0]) for entry in value)


def _is_array(value: Any) -> bool:
    import numpy as np  # deferred: nothing has failed yet where this is imported

    try:
        array = np.asarray(value, dtype=float)
    except FAILURES:
        return False
    return bool(array.size) and bool(np.all(np.isfinite(array)))


def _words(hint: Any) -> str:
    """Say what a value is to be."""
    if isinstance(hint, str):
        return f"of type {hint}"
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is None or hint is types.NoneType:
        return "None"
    if origin is typing.Union or origin is types.UnionType:
        return " or ".join(dict.fromkeys(map(_words, inner)))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    kind = origin or hint
    name = getattr(kind, "__name__", str(kind))
    if name == "ndarray":
        return "finite numbers, in nested lists of one shape or an array"
    if isinstance(kind, type) and issubclass(kind, Mapping):
        return "a table"
    if kind in (Sequence, Iterable, Iterator, Collection, list, tuple):
        entries = [entry for entry in inner if entry is not Ellipsis]
        return f"a sequence, each entry {_words(entries[0])}" if entries else "a sequence"
    if name == "Callable":
        return "a function"
    return WORDS.get(kind, f"of type {name}")


def _names(hint: Any) -> Iterator[str]:
    """Yield the names of all kinds in an annotation."""
    kind = typing.get_origin(hint) or hint
    yield hint if isinstance(hint, str) else getattr(kind, "__name__", "")
    for part in typing.get_args(hint):
        yield from _names(part)
