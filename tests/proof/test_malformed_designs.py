"""Files that no design makes: one clear refusal, or "not proved", from every reader, at once."""

from __future__ import annotations

import copy
import json
import time
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import (
    Design,
    Disk,
    NotProvedError,
    Parameter,
    PolefenceError,
    UncertainPlant,
    check,
    place,
)
from polefence.certify.certificate import check_claim
from polefence.cli.main import main
from polefence.lmi.conditions.methods import Scheduled, Slack
from polefence.proof import regions, work
from polefence.proof.__main__ import main as alone
from polefence.proof.claims.base import prove
from polefence.proof.claims.poles import Poles
from polefence.proof.document import Document, loads
from polefence.proof.laws import Evidence, Law
from polefence.proof.plant import Plant
from polefence.region.regions import HalfPlane, Sector
from support.files import poles_in

SECONDS = 3.0  # a second each, on a machine that is shared


@pytest.fixture(scope="module")
def documents():
    dice = np.random.default_rng(8)
    A, B = dice.normal(size=(2, 2)), dice.normal(size=(2, 1))
    As, Bs = ([X + 0.15 * dice.normal(size=X.shape) for _ in range(4)] for X in (A, B))
    box = (Parameter("p", 0, 1), Parameter("q", 1, 2))
    plant = replace(UncertainPlant.from_vertices(As, Bs), parameters=box)
    region = Disk(-20, 19.5) & HalfPlane(1) & Sector(0.5)
    made = {
        "scheduled": place(plant, region, Scheduled(2, 0, "box")),
        "theorem 1": place(plant, Disk(-3, 2), "scheduled"),
        "slack": place(plant, region, Slack(2, 0, "box")),
        "quadratic": place(plant, region, "quadratic"),
    }
    found = {name: json.loads(design.certificate.dumps()) for name, design in made.items()}
    W = made["quadratic"].certificate.evidence["W"]
    parts = ({"X": W[None], "degree": 0, "elevation": 0},) * 3
    given = replace(made["quadratic"].certificate, method="lyapunov", evidence={"parts": parts})
    found["lyapunov"] = json.loads(given.dumps())
    return found


def answers(path):
    """What each reader says: "proved", "not proved" or the refusal; nothing else may come out."""
    codes = {0: "proved", 1: "not proved", 2: "refused"}
    return [
        said(check, path),
        said(Design.load, path),
        codes[alone([str(path)])],
        codes[main(["check", str(path)])],
    ]


def said(reader, path):
    try:
        return "proved" if reader(path).proved else "not proved"
    except NotProvedError:
        return "not proved"
    except PolefenceError as error:
        return "refused" if "\n" not in str(error) else str(error)


def put(*keys, value):
    def edit(found):
        for key in keys[:-1]:
            found = found[key]
        found[keys[-1]] = value

    return edit


def drop(*keys):
    def edit(found):
        for key in keys[:-1]:
            found = found[key]
        del found[keys[-1]]

    return edit


def region(kind, **numbers):
    return put("claims", 0, "region", value={"kind": kind} | numbers)


def parts(count, **part):
    return put("claims", 0, "region", value={"kind": "intersection", "parts": [part] * count})


HALF = {"kind": "half_plane", "decay": 0}

REFUSED = {
    "unknown kind": ("quadratic", region("annulus", centre=-1, radius=1)),
    "kind is a list": ("quadratic", put("claims", 0, "region", "kind", value=["disk"])),
    "kind is a table": ("quadratic", put("claims", 0, "region", "kind", value={})),
    "no kind": ("quadratic", drop("claims", 0, "region", "kind")),
    "region is a list": ("quadratic", put("claims", 0, "region", value=[HALF])),
    "missing number": ("quadratic", region("ellipse", centre=-3, real=2)),
    "no slope": ("quadratic", region("sector", damping=0.5)),
    "extra number": ("quadratic", region("half_plane", decay=0, height=1)),
    "extra key in a part": ("quadratic", put("claims", 0, "region", "parts", 0, "name", value="x")),
    "extra key beside parts": ("quadratic", put("claims", 0, "region", "radius", value=1)),
    "part without kind": ("quadratic", drop("claims", 0, "region", "parts", 1, "kind")),
    "nested intersections": ("quadratic", parts(1, kind="intersection", parts=[HALF])),
    "no parts": ("quadratic", parts(0)),
    "too many parts": ("quadratic", parts(17, **HALF)),
    "parts are a table": ("quadratic", put("claims", 0, "region", "parts", value={"0": HALF})),
    "decay in words": ("quadratic", region("half_plane", decay="fast")),
    "decay of a true value": ("quadratic", region("half_plane", decay=True)),
    "decay is null": ("quadratic", region("half_plane", decay=None)),
    "decay too large": ("quadratic", region("half_plane", decay=1e300)),
    "decay is infinite": ("quadratic", region("half_plane", decay=float("inf"))),
    "empty strip": ("quadratic", region("vertical_strip", low=-1, high=-6)),
    "flat strip": ("quadratic", region("horizontal_strip", height=0)),
    "flat ellipse": ("quadratic", region("ellipse", centre=-3, real=2, imaginary=0)),
    "disk without radius": ("quadratic", region("disk", centre=-3, radius=-1)),
    "disk to the right": ("quadratic", region("disk", centre=3, radius=60)),
    "slope too steep": ("quadratic", region("sector", damping=0.5, slope=1.8)),
    "slope a little too steep": (
        "quadratic",
        region("sector", damping=0.5, slope=float(np.nextafter(np.sqrt(3), 2))),
    ),
    "slope without damping": ("quadratic", region("sector", damping=0, slope=1)),
    "negative damping": ("quadratic", region("sector", damping=-0.5, slope=-1.7)),
    "slope too flat": ("quadratic", region("sector", damping=0.5, slope=1.7)),
    "damping of one": ("quadratic", region("sector", damping=1, slope=0)),
    "ellipse to the right": ("quadratic", region("ellipse", centre=3, real=60, imaginary=60)),
    "tiny decay": ("quadratic", region("half_plane", decay=1e-200)),
    "no double": ("quadratic", region("half_plane", decay="1/3")),
    "a part twice": ("quadratic", parts(2, **HALF)),
    "on a ball": ("scheduled", put("law", "on", value="ball")),
    "on a list": ("scheduled", put("law", "on", value=["box"])),
    "on null": ("slack", put("claims", 0, "evidence", "on", value=None)),
    "on of a fixed law": ("quadratic", put("claims", 0, "evidence", "on", value="box")),
    "degree too low": ("scheduled", put("law", "degree", value=1)),
    "degree too high": ("scheduled", put("law", "degree", value=3)),
    "degree is gone": ("scheduled", drop("law", "degree")),
    "degree negative": ("scheduled", put("law", "degree", value=-1)),
    "degree in words": ("scheduled", put("law", "degree", value="2")),
    "degree in decimals": ("scheduled", put("law", "degree", value=2.0)),
    "degree true": ("scheduled", put("law", "degree", value=True)),
    "huge degree": ("scheduled", put("law", "degree", value=10**9)),
    "huge degree of P": ("slack", put("claims", 0, "evidence", "degree", value=10**30)),
    "degree of P": ("slack", put("claims", 0, "evidence", "degree", value=1)),
    "huge elevation": ("scheduled", put("claims", 0, "evidence", "elevation", value=17)),
    "elevation negative": ("slack", put("claims", 0, "evidence", "elevation", value=-1)),
    "simplex for a box": ("scheduled", drop("law", "on")),
    "one Z less": ("scheduled", lambda found: found["law"]["Z"].pop()),
    "one W and Z less": ("scheduled", lambda f: (f["law"]["Z"].pop(), f["law"]["W"].pop())),
    "one P less": ("slack", lambda found: found["claims"][0]["evidence"]["P"].pop()),
    "no G": ("slack", drop("claims", 0, "evidence", "G")),
    "epsilon in words": ("slack", put("claims", 0, "evidence", "epsilon", value="small")),
    "parts in quadratic": ("quadratic", put("claims", 0, "evidence", "parts", value=[])),
    "no parts of evidence": ("lyapunov", drop("claims", 0, "evidence", "parts")),
    "a part is no table": ("lyapunov", put("claims", 0, "evidence", "parts", 0, value=3)),
    "a part has another key": ("lyapunov", put("claims", 0, "evidence", "parts", 0, "P", value=1)),
    "degree of a part": ("lyapunov", put("claims", 0, "evidence", "parts", 1, "degree", value=1)),
    "too many multiples": (
        "lyapunov",
        put("claims", 0, "evidence", "parts", 1, "multiple", value=[1, 1]),
    ),
    "multiple is a number": (
        "lyapunov",
        put("claims", 0, "evidence", "parts", 1, "multiple", value=1),
    ),
    "method of another law": ("lyapunov", put("claims", 0, "method", value="scheduled")),
}

NOT_PROVED = {
    "epsilon zero": ("slack", put("claims", 0, "evidence", "epsilon", value=0)),
    "epsilon negative": ("slack", put("claims", 0, "evidence", "epsilon", value=-0.03)),
    "epsilon gone": ("slack", drop("claims", 0, "evidence", "epsilon")),
}

# Refused by the checker only after it has read the file.
INCONSISTENT = {
    "tau on a box": ("scheduled", put("claims", 0, "evidence", "tau", value=1)),
    "tau for other regions": ("theorem 1", region("half_plane", decay=0)),
    "tau and elevation": ("theorem 1", put("claims", 0, "evidence", "elevation", value=2)),
    "a part of evidence less": ("lyapunov", lambda f: f["claims"][0]["evidence"]["parts"].pop()),
    "multiples for one gain": (
        "lyapunov",
        put("claims", 0, "evidence", "parts", 0, "multiple", value=[1]),
    ),
    "work without end": (
        "theorem 1",
        lambda f: (
            f["claims"][0]["evidence"].update(elevation=16),
            f["plant"].update(vertices=f["plant"]["vertices"] * 8, parameters=[]),
            f["law"].update(W=f["law"]["W"] * 8, Z=f["law"]["Z"] * 8),
        ),
    ),
}


def written(documents, tmp_path, name, edit):
    found = copy.deepcopy(documents[name])
    edit(found)
    path = tmp_path / "design.json"
    path.write_text(json.dumps(found))
    return path


def test_the_files_are_proved_as_they_are(documents, tmp_path, capsys):
    for name in documents:
        path = written(documents, tmp_path, name, lambda found: None)
        assert set(answers(path)) == {"proved"}, name


@pytest.mark.parametrize("fault", REFUSED)
def test_what_is_no_design_is_refused(documents, tmp_path, capsys, fault):
    path = written(documents, tmp_path, *REFUSED[fault])
    begin = time.perf_counter()
    assert set(answers(path)) == {"refused"}
    assert time.perf_counter() - begin < SECONDS
    with pytest.raises(work.FormatError):
        loads(path.read_text())


@pytest.mark.parametrize("fault", NOT_PROVED)
def test_what_cannot_be_true_is_not_proved(documents, tmp_path, capsys, fault):
    path = written(documents, tmp_path, *NOT_PROVED[fault])
    begin = time.perf_counter()
    assert "proved" not in answers(path)
    assert time.perf_counter() - begin < SECONDS


def inconsistent(documents, tmp_path, fault):
    name, edit = INCONSISTENT[fault]

    def edited(found):
        if fault.startswith("tau"):
            found["claims"][0]["evidence"]["tau"] = 1
        edit(found)

    return written(documents, tmp_path, name, edited)


def test_what_the_checker_does_not_take_is_refused(documents, tmp_path, capsys):
    for fault in INCONSISTENT:
        assert "proved" not in answers(inconsistent(documents, tmp_path, fault)), fault


@pytest.mark.parametrize("fault", INCONSISTENT)
def test_and_is_never_proved(documents, tmp_path, fault):
    """The same files, of the checker itself: its own error and no other."""
    path = inconsistent(documents, tmp_path, fault)
    begin = time.perf_counter()
    with pytest.raises(work.FormatError):
        prove(poles_in(path.read_text()))
    assert time.perf_counter() - begin < SECONDS


def test_a_law_of_no_kind_is_refused(documents, tmp_path, capsys):
    for value in ([], {}, ["fixed"]):
        path = written(documents, tmp_path, "quadratic", put("law", "kind", value=value))
        assert set(answers(path)) == {"refused"}


def test_a_small_file_asks_for_no_more_than_seconds_of_work(tmp_path):
    """Eight scalar vertices and elevation 16: two kilobytes, within all limits there are."""
    one = [[[Fraction(1)]]] * 8
    law = Law(None, one, [[[Fraction(0)]]] * 8, 1)
    disk = (regions.Disk(Fraction(-3), Fraction(1)),)
    evidence = (Evidence([], elevation=16),)
    claim = Poles("scheduled", [[[Fraction(-3)]]] * 8, one, disk, law, evidence)
    begin = time.perf_counter()
    with pytest.raises(work.FormatError):
        prove(claim)
    assert time.perf_counter() - begin < SECONDS


# --- claims made without a file ------------------------------------------------------------------

ONE, ZERO = [[Fraction(1)]], [[Fraction(0)]]
HALF_PLANE = regions.HalfPlane(Fraction(1, 2))
FIXED = Law([ZERO])
SCHEDULED = Law(None, [ONE] * 3, [ZERO] * 3, 1)
EVIDENCE = Evidence([ONE])


def scalars(method="lyapunov", law=FIXED, evidence=(EVIDENCE,), N=3, **others):
    """x' = -x, N times: every pole is -1, every certificate that is one proves it."""
    A, B = [[[Fraction(-1)]]] * N, [ONE] * N
    return Poles(method, A, B, (HALF_PLANE,), law, tuple(evidence), **others)


SLACK = Evidence([ONE] * 3, 1, G=ONE, epsilon=Fraction(1, 10))
GOOD = {
    "one gain": scalars(),
    "one gain, quadratic": scalars("quadratic"),
    "gains at the corners": scalars(law=Law([ZERO] * 3)),
    "weights": scalars(weights=(Fraction(1), Fraction(1, 2), Fraction(3, 2))),
    "scheduled": scalars("scheduled", SCHEDULED, [Evidence([])]),
    "scheduled, given": scalars(
        law=SCHEDULED, evidence=[Evidence([ZERO], multiple=(Fraction(1),))]
    ),
    "slack": scalars("slack", evidence=[SLACK]),
    "a box": scalars(N=4, on="box"),
}
BAD = {
    "method": scalars("cubic"),
    "no vertices": scalars(N=0),
    "no region": replace(scalars(), region=()),
    "no evidence": scalars(evidence=[]),
    "evidence twice": scalars(evidence=[EVIDENCE] * 2),
    "vertices of B": replace(scalars(), B=[ONE]),
    "three corners of a box": scalars(on="box"),
    "a ball": scalars(on="ball"),
    "no law": scalars(law=Law()),
    "two laws": scalars(law=replace(SCHEDULED, K=[ZERO])),
    "two gains for three corners": scalars(law=Law([ZERO] * 2)),
    "no gain": scalars(law=Law([])),
    "gains at the corners, quadratic": scalars("quadratic", Law([ZERO] * 3)),
    "gains at the corners, slack": scalars("slack", Law([ZERO] * 3), [SLACK]),
    "scheduled law, quadratic": scalars("quadratic", SCHEDULED),
    "one gain, scheduled": scalars("scheduled", evidence=[Evidence([])]),
    "W too few": scalars("scheduled", replace(SCHEDULED, W=[ONE] * 2), [Evidence([])]),
    "Z too few": scalars("scheduled", replace(SCHEDULED, Z=[ZERO] * 2), [Evidence([])]),
    "degree of the law": scalars("scheduled", replace(SCHEDULED, degree=2), [Evidence([])]),
    "X of a scheduled law": scalars("scheduled", SCHEDULED),
    "degree of X": scalars(evidence=[Evidence([ONE], 1)]),
    "X too few": scalars(evidence=[Evidence([])]),
    "degree, quadratic": scalars("quadratic", evidence=[Evidence([ONE] * 3, 1)]),
    "negative elevation": scalars(evidence=[Evidence([ONE], elevation=-1)]),
    "huge elevation": scalars(evidence=[Evidence([ONE], elevation=17)]),
    "weights too few": scalars(weights=(Fraction(1),)),
    "weights, quadratic": scalars("quadratic", weights=(Fraction(1),) * 3),
    "weights, scheduled": replace(GOOD["scheduled, given"], weights=(Fraction(1),) * 3),
    "multiples too many": scalars(
        law=SCHEDULED, evidence=[Evidence([ZERO], multiple=(Fraction(1),) * 3)]
    ),
    "multiples of one gain": scalars(evidence=[Evidence([ONE], multiple=(Fraction(1),))]),
    "no G": scalars("slack", evidence=[replace(SLACK, G=None)]),
    "G, quadratic": scalars("quadratic", evidence=[Evidence([ONE], G=ONE)]),
    "tau": scalars(evidence=[Evidence([ONE], tau=Fraction(1))]),
}
WRONG = {
    "weight zero": scalars(weights=(Fraction(1), Fraction(0), Fraction(1))),
    "weight negative": scalars(weights=(Fraction(-1),) * 3),
    "X negative": scalars(evidence=[Evidence([[[Fraction(-1)]]])]),
    "X zero": scalars(evidence=[Evidence([ZERO])]),
    "W negative": scalars(
        "scheduled", replace(SCHEDULED, W=[[[Fraction(-1)]]] * 3), [Evidence([])]
    ),
    "multiple negative": scalars(
        law=SCHEDULED, evidence=[Evidence([ZERO], multiple=(Fraction(-1),))]
    ),
    "G negative": scalars("slack", evidence=[replace(SLACK, G=[[Fraction(-1)]])]),
    "gain of a corner": scalars(law=Law([ZERO, ZERO, ONE])),
}


@pytest.mark.parametrize("claim", GOOD)
def test_claims_without_a_file_are_proved(claim):
    assert prove(GOOD[claim]).proved


@pytest.mark.parametrize("claim", BAD)
def test_claims_that_do_not_fit_together_are_refused(claim):
    with pytest.raises(work.FormatError):
        prove(BAD[claim])


@pytest.mark.parametrize("claim", WRONG)
def test_claims_whose_numbers_are_wrong_are_not_proved(claim):
    assert not prove(WRONG[claim]).proved


NO_REGIONS = [
    regions.Disk(Fraction(-3), Fraction(-3)),
    regions.Ellipse(Fraction(1, 2), Fraction(3), Fraction(0)),
    regions.Sector(Fraction(1, 2), Fraction(1)),
    regions.Sector(Fraction(1, 10**9), Fraction(1)),
    regions.HalfPlane(Fraction(1, 10**200)),
]


@pytest.mark.parametrize("part", NO_REGIONS)
def test_numbers_that_make_no_region_are_neither_proved_nor_refuted(part):
    for W in (1, -1):
        claim = certified(part, W)
        for decide in (
            prove,
            check_claim,
            lambda c: c.poles_inside([Fraction(1)]),
        ):
            with pytest.raises(work.FormatError, match=r"region\.(radius|imaginary|slope|d)"):
                decide(claim)


# Of the right half-plane, and whether -1 lies in it.
SLIPS = [
    (regions.Disk(Fraction(5), Fraction(3)), False),
    (regions.Disk(Fraction(3), Fraction(60)), True),
    (regions.Ellipse(Fraction(1, 2), Fraction(3), Fraction(1)), True),
]


@pytest.mark.parametrize(("part", "inside"), SLIPS)
def test_slips_of_the_sign_are_refused_in_a_file(part, inside):
    """A claim of one alone is a true statement or none; a file of it is refused as a whole."""
    for W in (1, -1):
        claim = certified(part, W)
        assert prove(claim).proved is (inside and W > 0)
        assert check_claim(claim).proved is (inside and W > 0)
        assert claim.poles_inside([Fraction(1)]) is inside
        document = Document(Plant(claim.A, claim.B, []), claim.law, (claim,))
        with pytest.raises(work.FormatError, match=r"region\.centre = \S+ must be negative"):
            loads(document.dumps())
        kept = replace(claim, region=(part, regions.HalfPlane(Fraction(0))))
        assert loads(replace(document, claims=(kept,)).dumps()).claims == (kept,)


def certified(part, W):
    """x' = -x with no gain at all and the Lyapunov matrix W."""
    law, evidence = Law([[[Fraction(0)]]]), Evidence([[[Fraction(W)]]])
    A, B = [[[Fraction(-1)]]], [[[Fraction(1)]]]
    return Poles("quadratic", A, B, (part,), law, (evidence,))
