"""What public functions take, return and raise is reached from `polefence`, or from its rooms."""

from __future__ import annotations

import ast
import functools
import inspect
import re
import sys
import typing
from importlib import import_module
from pkgutil import resolve_name

import pytest

import polefence as pf
from support.api import API

ROOMS = ("conditions", "data", "export", "fleet", "response", "vehicle")
ENTRY = re.compile(r"^\.\. (currentmodule|autoclass):: (\S+)\n((?:   :.*\n)*)", re.MULTILINE)
MEMBERS = re.compile(r":members:(.*)")
WORD = re.compile(r"[A-Za-z_][\w.]*")
RAISED = re.compile(r"^(\w+Error)$", re.MULTILINE)
# The checker stands alone: its classes are reached in its own modules.
ALONE = "polefence.proof"


def names():
    """All public things, by identity, with the words that reach them."""
    found = {id(getattr(pf, name)): f"polefence.{name}" for name in pf.__all__}
    for room in ROOMS:
        for name in getattr(pf, room).__all__:
            found.setdefault(id(getattr(getattr(pf, room), name)), f"polefence.{room}.{name}")
    return found


@functools.cache
def entries():
    """The classes that the page about the API shows, each with its options there."""
    found, room = {}, "polefence"
    for what, name, options in ENTRY.findall(API):
        if what == "currentmodule":
            room = name
            continue
        found[resolve_name(name if "." in name else f"{room}.{name}")] = options
    return found


@functools.cache
def imported(module):
    """Where a module has its names from, those that it imports for types alone included."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {
        own.asname or own.name: (line.module, own.name)
        for line in ast.walk(tree)
        if isinstance(line, ast.ImportFrom) and line.module
        for own in line.names
    }


def meant(text, module):
    """The things of this package that are named in an annotation or a docstring."""
    for word in WORD.findall(text):
        head, *rest = word.split(".")
        thing = vars(sys.modules[module]).get(head)
        if thing is None and head in imported(module):
            where, name = imported(module)[head]
            thing = getattr(import_module(where), name, None)
        for own in rest:
            thing = getattr(thing, own, None)
        if thing is not None:
            yield thing


def ours(thing):
    """Whether it is a class of this package, or a union of such that has a name."""
    if isinstance(thing, type):
        return thing.__module__.startswith("polefence") and not thing.__module__.startswith(ALONE)
    return any(isinstance(own, type) and ours(own) for own in typing.get_args(thing))


def function_of(member):
    """The function that a member of a class calls, if it is one."""
    member = getattr(member, "fget", None) or getattr(member, "func", None) or member
    member = getattr(member, "__func__", member)
    return inspect.unwrap(member) if callable(member) else None


def documented(kind):
    """Names of the members of a class that the page about the API shows: all, some or none."""
    listed = MEMBERS.search(entries().get(kind, ""))
    if listed is None:
        return lambda name: False
    return (lambda name: name in listed[1].split(", ")) if listed[1].strip() else lambda name: True


def used(thing):
    """What a public function or class takes, returns and raises; each with where."""
    if not isinstance(thing, type):
        yield from used_by(inspect.unwrap(thing))
        return
    shown = documented(thing)
    for kind in thing.__mro__:
        if not kind.__module__.startswith("polefence"):
            continue
        for name, hint in inspect.get_annotations(kind).items():
            if not name.startswith("_") and "ClassVar" not in str(hint):
                text = getattr(hint, "__forward_arg__", str(hint))
                where = f"{kind.__name__}.{name}"
                yield from ((own, where) for own in meant(text, kind.__module__))
        for name, member in vars(kind).items():
            function = function_of(member)
            if inspect.isfunction(function) and not name.startswith("_") and shown(name):
                yield from used_by(function)


def used_by(function):
    texts = [str(own) for own in function.__annotations__.values()]
    texts += RAISED.findall((inspect.getdoc(function) or "").partition("Raises\n---")[2])
    for text in texts:
        yield from ((own, function.__qualname__) for own in meant(text, function.__module__))


def missing(things, found):
    return sorted(
        f"{getattr(own, '__name__', own)}, of {where}"
        for thing in things
        for own, where in used(thing)
        if ours(own) and id(own) not in found
    )


@pytest.mark.parametrize("room", ["", *ROOMS])
def test_every_type_that_is_taken_returned_or_raised_is_reached(room):
    place = getattr(pf, room) if room else pf
    things = [getattr(place, name) for name in place.__all__]
    things = [own for own in things if isinstance(own, type) or inspect.isfunction(own)]
    assert len(things) > 5
    assert not missing(things, names())


def test_what_is_not_reached_is_named():
    found = names()
    for own in (pf.Region, pf.RegionError, pf.Law):
        del found[id(own)]
    said = " ".join(missing([pf.place, pf.load_region, pf.Design], found))
    for text in ("Region, of place", "RegionError, of load_region", "of Design.law"):
        assert text in said


def test_the_page_shows_what_rooms_have():
    for room in ROOMS:
        for name in getattr(pf, room).__all__:
            assert re.search(rf"\b{name}\b", API), f"{room}.{name}"
