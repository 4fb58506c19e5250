"""A message names no option that the command which prints it lacks."""

import argparse
import ast
import re
from functools import cache
from pathlib import Path

import pytest

import polefence
from polefence.cli.main import COMMANDS, _parser
from polefence.cli.main import command as loaded

SOURCE = Path(polefence.__file__).parent
OPTION = re.compile(r"--[a-z][a-z-]*[a-z]")
# "polefence export --sample-time" in a message of another command
OTHER = re.compile(r"polefence ([a-z-]+)")
# Rooms whose messages one command prints; and those that write down commands, piece by piece.
OWNERS = {"export": "export", "fleet": "study"}
WRITERS = ("studio", "show")
NOT_OURS = {"--install"}  # xcode-select's


@cache
def options_of(command):
    (listed,) = (a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction))
    return frozenset(listed.choices[command]._option_string_actions)


class Module:
    """A module of the command line: its functions, and what its names stand for."""

    def __init__(self, name):
        self.name = name
        self.tree = ast.parse((SOURCE / "cli" / f"{name}.py").read_text(encoding="utf-8"))
        self.own = {
            node.name: node
            for node in self.tree.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef)
        }
        self.texts = {
            target.id: node.value
            for node in self.tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        self.imported = {
            alias.asname or alias.name: node.module.rsplit(".", 1)[1]
            for node in ast.walk(self.tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("polefence.cli.")
            for alias in node.names
        }


@cache
def module(name):
    return Module(name)


def reached(name, start):
    """Yield functions, and values of constants, that a command's function may come to."""
    left, seen = [(name, start)], set()
    while left:
        where, word = left.pop()
        if (where, word) in seen:
            continue
        seen.add((where, word))
        own = module(where)
        node = own.own.get(word) or own.texts.get(word)
        if node is None:
            continue
        yield node
        names = (inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name))
        left += [(own.imported.get(name, where), name) for name in names]


def texts_in(node):
    """Yield what a function says: its constants of text that are no docstring."""
    documented = {
        id(own.body[0].value)
        for own in ast.walk(node)
        if isinstance(own, ast.FunctionDef | ast.ClassDef) and isinstance(own.body[0], ast.Expr)
    }
    functions = (own for own in ast.walk(node) if isinstance(own, ast.FunctionDef))
    defaults = (value for own in functions for value in own.args.defaults)
    silent = documented | {id(own) for value in defaults for own in ast.walk(value)}
    for own in ast.walk(node):
        if isinstance(own, ast.Constant) and isinstance(own.value, str) and id(own) not in silent:
            yield own.value


def asked_for(node):
    """Return the options that a function looks at: of one that is given it may speak."""
    names = {own.attr for own in ast.walk(node) if isinstance(own, ast.Attribute)}
    return {f"--{name.replace('_', '-')}" for name in names | set(texts_in(node))}


def strangers(text, command):
    """Yield options in a text that neither its command nor one that the text names has."""
    known = set(options_of(command)) | NOT_OURS
    for other in OTHER.findall(text):
        if other in COMMANDS:
            known |= options_of(other)
    yield from (option for option in OPTION.findall(text) if option not in known)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_names_its_own_options(command):
    run, _ = loaded(command)
    name, run = run.__module__.rsplit(".", 1)[1], run.__name__
    found = {
        (option, text)
        for node in reached(name, run)
        for text in texts_in(node)
        for option in strangers(text, command)
        if option not in asked_for(node)
    }
    assert not found


def rooms():
    return [path for path in sorted(SOURCE.rglob("*.py")) if "cli" not in path.parts]


def test_what_several_commands_use_names_no_option():
    """A room below the commands says a remedy in words of a spec; one of one command, its own."""
    found = dict[str, list[str]]()
    for path in rooms():
        room = path.relative_to(SOURCE).parts[0]
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for text in texts_in(tree):
            named = OPTION.findall(text)
            if room in OWNERS:
                named = list(strangers(text, OWNERS[room]))
            elif room in WRITERS:
                every = set().union(*map(options_of, COMMANDS))
                named = [option for option in named if option not in every]
            else:
                others = {o for name in OTHER.findall(text) for o in _options(name)}
                named = [option for option in named if option not in others]
            if named:
                found.setdefault(str(path.relative_to(SOURCE)), []).append(text)
    assert found == {}


def _options(command):
    return options_of(command) if command in COMMANDS else frozenset()


def test_the_search_finds_what_is_wrong():
    assert list(strangers("give --road C", "verify")) == ["--road"]
    assert not list(strangers("give --limit X", "verify"))
    assert not list(strangers("polefence export --sample-time says", "analyse"))
