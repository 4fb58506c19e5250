"""Changed files of every kind: none is proved that samples in floats contradict."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from polefence.proof.document import KINDS, from_plain
from polefence.proof.work import FormatError
from support.every_file import FILES
from support.motions import false_decay
from support.truths import Law, Plant, false, number
from support.untrue import Run, proved

EACH = 25  # changes of each file; benchmarks/untrue.py tries hundreds


@pytest.fixture(scope="module")
def documents(every_file):
    """One file of every kind, each proved."""
    return {name: json.loads((every_file / name).read_text()) for name in FILES}


def test_every_kind_is_among_them(documents):
    kinds = {claim["kind"] for document in documents.values() for claim in document["claims"]}
    assert kinds == set(KINDS)


@pytest.mark.parametrize("name", FILES)
def test_no_change_makes_a_false_claim_proved(documents, name):
    run = Run(documents)
    counts = run.of(name, EACH)
    assert not run.faults, run.faults[0][0]
    assert counts["refused"], name  # some of them are wrong
    assert counts["accepted"], name


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
        ("margins/design.json", ("level",), 0.3),
        ("margins/design.json", ("filters",), [{"name": "W", "a": [[-5]], "b": [[9]], "c": [[9]]}]),
        ("margins/design.json", ("sectors",), [[-9, 2]]),
        ("margins/design.json", ("band",), [0, 2]),
        ("passing/design.json", ("sectors",), [[-4, 5]]),
        ("late/design.json", ("region", "radius"), 0.3),
        ("discrete/design.json", ("level",), 1e-3),
        ("moving/design.json", ("level",), 1e-2),
        ("half/design.json", ("early",), 0.4),
        ("half/design.json", ("level",), 0.1),
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


@pytest.mark.parametrize(
    ("rate", "grows"), [("any", True), ([-20, 20], True), ([-0.01, 0.01], False)]
)
def test_the_samples_see_that_a_motion_grows(rate, grows):
    """A spring that changes twice an oscillation feeds it, though each constant one is damped."""
    spring = {"name": "k", "range": [0.2, 6], "rate": rate}
    vertices = [{"A": [[0, 1], [-k, -0.1]], "B": [[0], [1]]} for k in spring["range"]]
    plant = Plant({"vertices": vertices, "parameters": [spring]})
    law = Law({"kind": "fixed", "K": [[0, 0]]}, 2)
    assert false_decay(plant, law, decay=0.0) is grows


def test_a_gain_that_some_law_has_is_seen(documents):
    document = copy.deepcopy(documents["least/limit.json"])
    for limit in document["claims"][0]["limits"]:
        limit["level"] = 1.01 * number(limit["level"])
    assert false(document)
    assert not proved(document)


def test_a_sampled_loop_that_is_too_slow_is_seen(documents):
    document = copy.deepcopy(documents["earlier/sampled.json"])
    document["claims"][0]["decay"] = 90.0
    assert false(document)
    assert not proved(document)
    assert np.isfinite(document["claims"][0]["sample_time"])


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
        assert name.startswith(("damper/", "earlier/", "least/"))
