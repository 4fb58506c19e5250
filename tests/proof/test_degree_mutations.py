"""One fault at a time into design files of every newer kind, as `test_mutations` does for disks.

The truth is decided in floats from the eigenvalues of the blocks; what is too close to call is
left out.
"""

from __future__ import annotations

import copy
import json
import random
from dataclasses import replace

import numpy as np
import pytest

from polefence import Certificate, Disk, Parameter, UncertainPlant, check, place
from polefence.base.errors import RegionError
from polefence.lmi.conditions.methods import Scheduled, Slack
from polefence.proof import regions, work
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from polefence.region.regions import (
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    region_of,
    require_left,
)
from support.changes import entries, least_eigenvalue, scaled
from support.files import first, poles_in

CHANGES = 20
ENTRIES = 6  # of a file, in turn spoiled for good
BOUND = Disk(-20, 19.5)

# kind: region, method
KINDS = {
    "degree 2, box": (Disk(-3, 2), Scheduled(2, 1, "box")),
    "slack, degree 2, box": (Disk(-3, 2), Slack(2, 0, "box")),
    "half_plane": (HalfPlane(1), "quadratic"),
    "sector": (Sector(0.5), Scheduled(1, 0, "box")),
    "vertical_strip": (VerticalStrip(-6, -1), Scheduled(1, 0)),
    "horizontal_strip": (HorizontalStrip(2), "slack"),
    "ellipse": (Ellipse(-3, 2.5, 1.5), Scheduled(1, 0, "box")),
    "intersection": (BOUND & HalfPlane(1) & Sector(0.5), Scheduled(2, 0, "box")),
    "slack, intersection": (BOUND & HalfPlane(1) & Sector(0.5), Slack(1, 0, "box")),
    "lyapunov, fixed": (BOUND & HalfPlane(1), "quadratic"),
    "lyapunov, scheduled": (BOUND & HalfPlane(1), Scheduled(1, 0, "box")),
}


@pytest.fixture(scope="module")
def plant():
    dice = np.random.default_rng(8)
    A, B = dice.normal(size=(2, 2)), dice.normal(size=(2, 1))
    As, Bs = ([X + 0.15 * dice.normal(size=X.shape) for _ in range(4)] for X in (A, B))
    box = (Parameter("p", 0, 1), Parameter("q", 1, 2))
    return replace(UncertainPlant.from_vertices(As, Bs), parameters=box)


@pytest.fixture(scope="module")
def documents(plant):
    return {kind: document(plant, kind) for kind in KINDS}


def document(plant, kind):
    region, method = KINDS[kind]
    # placed in a disk besides, then claimed for the region alone: any point of it will do
    certificate = place(plant, region & BOUND, method).certificate
    certificate = replace(certificate, region=region)
    if kind == "lyapunov, fixed":
        W = certificate.evidence["W"]
        # as polynomials: constant of degree 0 and, with equal coefficients, of degree 1
        parts = (
            {"X": W[None], "degree": 0, "elevation": 0},
            {"X": np.stack([W] * 4), "degree": 1, "elevation": 1},
        )
        evidence = {"on": "box", "parts": parts}
        certificate = replace(certificate, method="lyapunov", evidence=evidence)
    elif kind == "lyapunov, scheduled":
        W = certificate.law.W.mean(axis=0)
        small = 1e-3 * np.linalg.inv(W)
        small = small + small.T
        parts = (
            {"X": small[None], "degree": 0, "elevation": 0, "multiple": np.ones(1)},
            {"X": np.stack([small] * 4), "degree": 1, "elevation": 0, "multiple": np.ones(4)},
        )
        certificate = replace(certificate, method="lyapunov", evidence={"parts": parts})
    assert certificate.prove().proved, kind
    return json.loads(certificate.dumps())


def is_proved(found):
    """What the checker says; where it refuses the claim as inconsistent, it is not proved."""
    try:
        return prove(poles_in(json.dumps(found))).proved
    except work.FormatError:
        return False


def is_region(found):
    """Whether the numbers make one; what is none is bad input."""
    parts = first(found)["region"].get("parts", [first(found)["region"]])
    try:
        names = {kind: part.names() for kind, part in regions.KINDS.items()}
        require_left(region_of([(p["kind"], [p[key] for key in names[p["kind"]]]) for p in parts]))
    except RegionError:
        return False
    return True


def truth(found):
    """Least eigenvalue of all blocks, each scaled to unit diagonal; -1 where it is malformed."""
    if first(found)["evidence"].get("tau"):  # of Theorem 1 alone is there one, and not here
        return -1.0
    if not is_region(found):
        with pytest.raises(work.FormatError, match="region"):
            loads(json.dumps(found))
        return -1.0
    return least_eigenvalue(poles_in(json.dumps(found)))


@pytest.mark.parametrize("kind", KINDS)
def test_seeded_changes(documents, kind):
    original, dice = documents[kind], random.Random(kind)
    places, answers = entries(original), {True: 0, False: 0}
    for _ in range(CHANGES):
        size = 10.0 ** dice.uniform(-5, 2) * dice.choice([-1, 1])
        tried = scaled(original, dice.choice(places), 1 + size, dice.choice([0, size]))
        least = truth(tried)
        if abs(least) < 1e-9:
            continue
        assert is_proved(tried) is bool(least > 0)
        answers[bool(least > 0)] += 1
    assert min(answers.values()) >= 1, answers


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_matters(documents, kind):
    """Each entry can be changed so that the claim breaks, and is refused then."""
    original = documents[kind]
    places = entries(original)
    # the region's and the evidence's few, and some of the many of law and plant
    few = [path for path in places if path[2] == "region" or len(path) < 5]
    for path in few + random.Random(kind).sample(places, ENTRIES):
        for factor, shift in ((1, 1e4), (1, -1e4), (0, -50), (-1, 0)):
            tried = scaled(original, path, factor, shift)
            if truth(tried) < -1e-9:
                assert not is_proved(tried), path
                break
        else:
            # a disk alone has no use for it
            assert (path[-1], kind) == ("epsilon", "slack, degree 2, box"), path


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_says_the_same_when_written_again(documents, kind):
    original = documents[kind]
    certificate = Certificate.loads(json.dumps(original))
    assert json.loads(certificate.dumps()) == original
    assert check(certificate).proved


@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_claim_is_refuted_only_where_a_pole_is_out(documents, kind):
    """Narrower regions: whatever is called refuted has a pole that floats find outside too."""
    original = documents[kind]
    for factor in (0.9, 0.5, 0.1):
        tried = copy.deepcopy(original)
        for part in first(tried)["region"].get("parts", [first(tried)["region"]]):
            narrow(part, factor)
        verdict = check(Certificate.loads(json.dumps(tried)))
        if verdict.answer == "refuted":
            design = Certificate.loads(json.dumps(tried))
            alpha = np.array(verdict.alpha, dtype=float)
            A, B = design.plant.at(alpha)
            poles = np.linalg.eigvals(A + B @ design.law.gain(alpha))
            assert design.region.distance(poles).max() > -1e-9 * design.region.size
            assert sum(verdict.alpha) == 1
            assert min(verdict.alpha) >= 0
    # poles that are real never leave a horizontal strip
    assert verdict.answer == ("undecided" if kind == "horizontal_strip" else "refuted")


def narrow(part, factor):
    match part["kind"]:
        case "disk":
            part["radius"] *= factor
        case "half_plane":
            part["decay"] /= factor
        case "sector":
            sector = Sector(1 - (1 - part["damping"]) * factor**4)
            part.update(sector.numbers)
        case "vertical_strip":
            part["low"] = part["high"] + factor * (part["low"] - part["high"])
        case "horizontal_strip":
            part["height"] *= factor
        case "ellipse":
            part["real"], part["imaginary"] = factor * part["real"], factor * part["imaginary"]
