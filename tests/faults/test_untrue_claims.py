"""Files of every kind with a number changed: none is proved that samples in floats contradict."""

from __future__ import annotations

import copy
import json
import random

import numpy as np
import pytest

from polefence.proof.document import KINDS, check, from_plain
from polefence.proof.work import FormatError
from support.every_file import FILES
from support.truths import false

EACH = 40  # changes of each file; 450 were tried once


@pytest.fixture(scope="module")
def documents(every_file):
    """One file of every kind, each proved."""
    return {name: json.loads((every_file / name).read_text()) for name in FILES}


def places(document):
    """Paths of every number but those of the head and of what no proof reads."""
    found = []

    def walk(node, path):
        pairs = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in pairs if isinstance(node, dict | list) else ():
            if isinstance(value, dict | list):
                walk(value, (*path, key))
            elif (isinstance(value, int | float) and not isinstance(value, bool)) or (
                isinstance(value, str) and value.strip("-").replace("/", "").isdigit()
            ):
                found.append((*path, key))

    for key in ("plant", "law", "claims"):
        walk(document.get(key, {}), (key,))
    return found


def changed(document, path, dice):
    """A number larger, smaller, of other sign, or that of another place."""
    found = copy.deepcopy(document)
    place = found
    for key in path[:-1]:
        place = place[key]
    old = place[path[-1]]
    value = float(eval(old)) if isinstance(old, str) else old  # a "p/q" of our own
    size = 10.0 ** dice.uniform(-3, 1)
    new = dice.choice(
        [value * (1 + size), value / (1 + size), -value, 0, value + size, value - size]
    )
    whole = type(old) is int and path[-1] in ("degree", "elevation", "terms", "delay", "bits")
    place[path[-1]] = int(new) if whole else new
    return found


def touched(document, path):
    """The document with those claims alone that a change at a path may make false."""
    if path[0] != "claims":
        return document
    return document | {"claims": [document["claims"][path[1]]]}


def proved(document):
    """Whether the checker says so, or that it is refuted in the cells that say so."""
    try:
        answer = check(from_plain(document))
    except FormatError:
        return False
    return bool(answer.verdicts[-1].note) if answer.answer == "refuted" else answer.proved


def test_every_kind_is_among_them(documents):
    kinds = {claim["kind"] for document in documents.values() for claim in document["claims"]}
    assert kinds == set(KINDS)


@pytest.mark.parametrize("name", FILES)
def test_no_change_makes_a_false_claim_proved(documents, name):
    original, dice = documents[name], random.Random(name)
    assert proved(original)
    assert not false(original)
    every, answers = places(original), {True: 0, False: 0}
    for k in range(EACH):
        path = dice.choice(every)
        tried = changed(original, path, dice)
        answer = proved(tried)
        answers[answer] += 1
        if answer:
            assert not false(touched(tried, path), k), (name, k)
    assert answers[False], name  # some of them are wrong


@pytest.mark.parametrize(
    ("name", "path", "value"),
    [
        ("quadratic/design.json", ("region", "radius"), 0.5),
        ("observer/design.json", ("region", "centre"), -40.0),
        ("signals/design.json", ("level",), 1e-4),
        ("vectors/design.json", ("disturbances",), [900, 900]),
        ("vectors/design.json", ("level",), 1e-3),
        ("service/estimate-k.json", ("region", "radius"), 0.5),
        ("service/gain.json", ("error",), 1e4),
        ("whole/gain.json", ("error",), 1e4),
        ("service/rate-k.json", ("decay",), 1e3),
        ("code/guarantee.json", ("gain", "region", "radius"), 0.5),
        ("table/table.json", ("region", "decay"), 1e3),
        ("damper/law.json", ("limit", "level"), 0.1),
        ("damper/limit.json", ("factor",), 1e5),
        ("late/design.json", ("level",), 1e-2),
        ("late/design.json", ("region", "radius"), 0.3),
        ("discrete/design.json", ("level",), 1e-3),
    ],
)
def test_the_samples_see_what_is_false(documents, name, path, value):
    """Else nothing would be tested above."""
    document = copy.deepcopy(documents[name])
    for claim in document["claims"]:
        place = claim
        for key in path[:-1]:
            place = place.get(key, {})
        if path[-1] in place:
            place[path[-1]] = value
    assert false(document)
    assert not proved(document)


def test_a_sampled_loop_that_is_too_slow_is_seen(documents):
    document = copy.deepcopy(documents["code/guarantee.json"])
    document["claims"][1]["decay"] = 90.0
    assert false(document)
    assert not proved(document)
    assert np.isfinite(document["claims"][1]["sample_time"])


def test_samples_of_another_plant_are_seen(documents):
    document = copy.deepcopy(documents["late/design.json"])
    document["claims"][-1]["vertices"][0]["A"][1][0] = -2.5
    assert false(document)
    assert not proved(document)


@pytest.mark.parametrize("name", FILES)
def test_a_region_about_the_right_half_plane_is_refused(documents, name):
    """Wherever a claim has it: a slip of the sign, be it true or not."""
    document = copy.deepcopy(documents[name])

    def slip(node):
        """Put a large disk in place of every region; return how many there were."""
        nodes = list(node.values()) if isinstance(node, dict) else node
        count = sum(slip(each) for each in nodes if isinstance(each, dict | list))
        if isinstance(node, dict) and isinstance(node.get("region"), dict):
            node["region"] = {"kind": "disk", "centre": 40.0, "radius": 1e3}
            count += 1
        return count

    if slip(document["claims"]):
        with pytest.raises(FormatError, match="centre = 40"):
            from_plain(document)
    else:
        assert name.startswith("damper/")
