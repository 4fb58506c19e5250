"""Files of every kind with one value of another type: one clear line or an answer, no traceback."""

from __future__ import annotations

import copy
import json
import shutil
import tomllib

import numpy as np
import pytest

from support.every_file import ASKED, LIMITS, SPEC, TRADEOFF, TWO, quiet
from support.once import searched_once  # noqa: F401

VALUES = (
    None, [], {}, "", True, -1, 0, float("inf"), 1e300, 10**400, "1e999999999", "1/0",
    "x" * 20_000, [[[[[]]]]], {"a": []}, "\n\x1b[2J\ud800",
)  # fmt: skip
EVERY = 60  # of all mutations one in so many is tried, so that the test is quick; 1 for all


@pytest.fixture(scope="module")
def folder(every_file, tmp_path_factory):
    """One file of every kind, each proved."""
    made = tmp_path_factory.mktemp("files") / "made"
    shutil.copytree(every_file, made)
    return made


ANALYSE = ["analyse", "plain.toml", "--gain", "FILE", "--region", "half_plane(0.3)"]
CHECK = ["check", "FILE", "--spec", "plain.toml"]
# The file, and the commands that read it.
KINDS = {
    "quadratic": ("quadratic/design.json", [CHECK, ANALYSE]),
    "scheduled": ("scheduled/design.json", [CHECK, ANALYSE]),
    "slack": ("slack/design.json", [CHECK]),
    "lyapunov": ("lyapunov/design.json", [CHECK]),
    "table": ("table/table.json", [CHECK]),
    "gains": ("gains.json", [[*ANALYSE, "--depth", "0"]]),
    "estimate": ("service/estimate-k.json", [CHECK]),
    "gain margin": ("service/gain.json", [CHECK]),
    "gain error": ("whole/gain.json", [CHECK]),
    "rate": ("service/rate-k.json", [CHECK]),
    "margins": ("margins/design.json", [["check", "FILE"]]),
    "failing": ("failing/margins.json", [["check", "FILE"]]),
    "performance": ("performance/design.json", [["check", "FILE", "--spec", "spec.toml"]]),
    "vectors": ("vectors/design.json", [["check", "FILE", "--spec", "two.toml"]]),
    "guarantee": ("code/guarantee.json", [CHECK]),
    "observer": ("observer/design.json", [CHECK]),
    "observed": ("observed/guarantee.json", [CHECK]),
    "tuned": ("tuned/design.json", [CHECK]),
    "parts": ("parts/design.json", [CHECK]),
    "cells": ("cells/design.json", [CHECK]),
    "limits": ("limits.json", [LIMITS]),
    "tradeoff": ("tradeoff.json", [TRADEOFF]),
}


def places(node, path=()):
    """Every place; of a list its first entry and its last alone, which stand for the others."""
    yield path
    if isinstance(node, dict):
        for key in node:
            yield from places(node[key], (*path, key))
    elif isinstance(node, list) and node:
        for i in sorted({0, len(node) - 1}):
            yield from places(node[i], (*path, i))


def mutations(document, every=EVERY):
    """One in so many places and values, the same in every run."""
    found = [(path, value) for path in places(document) for value in VALUES]
    order = np.random.default_rng(3).permutation(len(found))
    return [found[k] for k in order[::every]]


def mutated(document, path, value):
    if not path:
        return value
    whole = copy.deepcopy(document)
    node = whole
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return whole


def judge(words, what):
    try:
        status, out, err = quiet(words)
    except Exception as error:
        error.add_note(f"{what} under {words}")
        raise
    assert status in (0, 1, 2), what
    assert len(out) < 20_000, what
    if status == 2:
        assert err.count("\n") == 1, (what, err)
        assert len(err) < 3_000, (what, len(err))
        assert err.isprintable() or err[:-1].isprintable(), (what, err)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_with_one_value_of_another_type(kind, folder, monkeypatch):
    monkeypatch.chdir(folder)
    name, commands = KINDS[kind]
    path = folder / name
    text = path.read_text()
    document = json.loads(text)
    try:
        for place, value in mutations(document, EVERY):
            for words in commands:
                path.write_text(json.dumps(mutated(document, place, value)))
                judge([name if word == "FILE" else word for word in words], (kind, place, value))
    finally:
        path.write_text(text)


# Words of which the reader asks whether they are among some that it knows.
WORDS = {
    "quadratic": [
        ("format",),
        ("claims", 0, "kind"),
        ("claims", 0, "region", "kind"),
        ("claims", 0, "method"),
        ("law", "kind"),
    ],
    "slack": [("claims", 0, "evidence", "on")],
    "table": [
        ("format",),
        ("claims", 0, "cells", 0, "answer"),
        ("plant", "parameters", 0, "through"),
    ],
    "estimate": [("claims", 0, "kind"), ("claims", 0, "method")],
    "performance": [("claims", 1, "kind"), ("claims", 1, "evidence", "on")],
    "guarantee": [
        ("claims", 0, "kind"),
        ("claims", 0, "gain", "kind"),
        ("claims", 0, "code", "bits"),
        ("export", "text", "given"),
    ],
    "limits": [("rows", 0, "answer"), ("rows", 0, "method"), ("polefence",)],
    "tradeoff": [("rows", 0, "answer"), ("rows", 0, "method"), ("polefence",)],
}


@pytest.mark.parametrize("kind", WORDS)
def test_a_file_with_no_word_where_one_belongs(kind, folder, monkeypatch):
    monkeypatch.chdir(folder)
    name, (words, *_) = KINDS[kind]
    path = folder / name
    text = path.read_text()
    try:
        for place in WORDS[kind]:
            for value in ([], {}, None, "x" * 20_000):
                path.write_text(json.dumps(mutated(json.loads(text), place, value)))
                judge([name if word == "FILE" else word for word in words], (place, value))
                path.write_text(text)
    finally:
        path.write_text(text)


def toml(value):
    """Write a value as TOML; what has no writing there as text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + "}"
    return json.dumps(str(value).encode("utf-8", "replace").decode())


@pytest.mark.parametrize(
    "words",
    [
        ["limits", "FILE", "--centre", "-3", "--method", "quadratic"],
        ["optimise", "FILE", "--method", "quadratic"],
        ["check", "performance", "--spec", "FILE"],
        ["check", "vectors", "--spec", "FILE"],
    ],
)
def test_a_spec_with_one_value_of_another_type(words, folder, monkeypatch):
    monkeypatch.chdir(folder)
    document = tomllib.loads(TWO if "vectors" in words else SPEC + ASKED)
    path = folder / "mutated.toml"
    for place, value in mutations(document, EVERY):
        whole = mutated(document, place, value)
        tables = whole if isinstance(whole, dict) else {"name": whole}
        path.write_text("".join(f"{json.dumps(k)} = {toml(v)}\n" for k, v in tables.items()))
        judge([path.name if word == "FILE" else word for word in words], (place, value))


@pytest.mark.parametrize(
    "rows",
    ["", "0", "0,0", "0,0\n1", "0,0\n1,x\n", "0,0\n1,inf\n", "0,0\n1e999,1\n", "0,0\n-1,1\n",
     "0,0\n1,[]\n", "a,b\n0,0\n", '"0\n0",1\n2,2', "0,0\n1e300,1\n", "0,0\n1e9,1\n", "\x00,\x00",
     "0,0\n" + "9" * 9999 + ",1", "0;0\n1;1\n", "0,0\n1e-300,1"],
)  # fmt: skip
def test_a_profile_of_another_kind(rows, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    car = quiet(["example", "quarter-car-physical"])[1]
    (tmp_path / "car.toml").write_text(car)
    (tmp_path / "road.csv").write_text(rows)
    words = ["simulate", "car.toml", "--profile", "road.csv", "--speed", "20"]
    assert quiet(words)[0] == 2
    judge(words, rows[:40])


def test_the_files_are_good_as_they_are(folder, monkeypatch):
    """Else every mutation would be refused for another reason."""
    monkeypatch.chdir(folder)
    for name, commands in KINDS.values():
        for words in commands:
            assert quiet([name if word == "FILE" else word for word in words])[0] == 0, name
