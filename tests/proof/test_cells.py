"""The verifier of analysed tables: exact identities, and one fault at a time in a file."""

from __future__ import annotations

import copy
import json
import random
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from polefence import GainTable, HalfPlane, Parameter, Sector, UncertainPlant, analyse
from polefence.certify.table import _exact_table
from polefence.proof import roots, work
from polefence.proof.claims import cells
from polefence.proof.claims.base import prove, untiled
from polefence.proof.claims.cells import Cell, cell_claim
from support.files import first, only_claim_in


def spring(low="1", high="4"):
    mass = Parameter("m", low, high, "kg", "1/m")
    k = Parameter("k", -1, 3, "N/m")
    sign = "" if float(low) > 0 else "-"
    A = [[0, 1], [f"-k/({sign}m)", 0]]
    return UncertainPlant.from_expressions([mass, k], A, [[0], [f"1/({sign}m)"]], name="spring")


def gains_for(plant):
    grid = {p.name: [p.low, (p.low + 2 * p.high) / 3, p.high] for p in plant.parameters}
    corners = product(*grid.values())
    rows = [[[-4 * abs(float(m)), -4 * abs(float(m)) + 0.1]] for m, _ in corners]
    return GainTable(plant.parameters, grid, np.array(rows).reshape(3, 3, 1, 2))


@pytest.fixture(scope="module")
def document():
    """A file with proved, refuted and undecided cells, of regions with two parts."""
    plant = spring()
    found = analyse(plant, gains_for(plant), HalfPlane(1.3) & Sector(0.88), depth=3)
    text = json.loads(found.file().dumps())
    refuted = next(c for c in first(text)["cells"] if c["answer"] == "refuted")
    refuted["answer"] = "undecided"
    del refuted["at"]
    refuted.pop("outside", None)
    assert {c["answer"] for c in first(text)["cells"]} == {"proved", "refuted", "undecided"}
    return text


def summary(document):
    return prove(only_claim_in(json.dumps(document)))


def claim_of(document):
    return only_claim_in(json.dumps(document))


def test_an_honest_file_is_checked(document):
    found, shares = summary(document), claim_of(document).shares
    assert found.answer == "refuted"
    assert found.note
    assert sum(shares.values()) == 1
    assert 0 < shares["proved"] < 1
    assert shares["refuted"] > 0 < shares["undecided"]


@pytest.mark.parametrize("bounds", [("1", "4"), ("-4", "-1")])
def test_a_cells_claim_is_the_loop_itself_exactly(bounds):
    """(q A + q B K) / q between the corners of a cell is the loop at the parameters, in rationals.

    The mass enters through 1/m, on either side of zero; no tolerance.
    """
    plant = spring(*bounds)
    table = _exact_table(plant, gains_for(plant))
    dice = random.Random(3)
    low = tuple(axis.knots[0] for axis in table.axes)
    high = tuple((axis.knots[0] + axis.knots[1]) / 2 for axis in table.axes)
    claim = cell_claim(table, (), low, high, ())
    assert all(q > 0 for q in claim.weights)
    for _ in range(10):
        t = [Fraction(dice.randrange(0, 101), 100) for _ in low]
        alpha = [
            Fraction(np.prod([x if bit else 1 - x for x, bit in zip(t, corner, strict=True)]))
            for corner in product((0, 1), repeat=len(t))
        ]
        p = tuple(a + x * (b - a) for a, x, b in zip(low, t, high, strict=True))
        assert claim.closed_loop(alpha) == table.loop(p)
    # and that loop is the physical one: m x'' = -k x + K
    m, k = (float(v) for v in p)
    (K,) = table.gain(p)
    physical = [[0, 1], [(-k + float(K[0])) / abs(m), float(K[1]) / abs(m)]]
    assert np.allclose(np.array(table.loop(p), dtype=float), physical, rtol=1e-12)


def test_a_point_on_a_knot_has_one_gain():
    """The cells on both sides of a knot see the same gain there."""
    table = _exact_table(spring(), gains_for(spring()))
    knot = table.axes[0].knots[1]
    tiny = Fraction(1, 10**30)
    near = [table.gain((knot + d, Fraction(0)))[0][0] for d in (-tiny, 0, tiny)]
    assert abs(near[0] - near[1]) < 100 * tiny > abs(near[2] - near[1])
    assert near[1] == table.gain((knot, Fraction(0)))[0][0]


def pick(document, answer, index=0):
    return [c for c in first(document)["cells"] if c["answer"] == answer][index]


def inner_edge(document):
    """A cell with an upper bound of its mass that is no knot, and the mass halfway beyond."""
    knots = document["law"]["grid"][0]
    for cell in first(document)["cells"]:
        if cell["high"][0] not in knots:
            beyond = min(k for k in knots if k > cell["high"][0])
            return cell, (cell["high"][0] + beyond) / 2
    raise LookupError


def grown(document):
    cell, further = inner_edge(document)
    cell["high"][0] = further


def shrunk(document):
    cell = pick(document, "undecided")
    cell["high"][0] = (cell["low"][0] + cell["high"][0]) / 2


def across(document):
    cell = next(
        c for c in first(document)["cells"] if c["high"][0] == document["law"]["grid"][0][1]
    )
    cell["high"][0] += 0.1


def outside(document):
    """A false counterexample beyond the box: it would refute where nothing was asked."""
    cell = pick(document, "refuted")
    for key in ("low", "high", "at"):
        cell[key] = [str(Fraction(v) + 10) for v in cell[key]]


def reversed_corners(document):
    cell = pick(document, "undecided")
    cell["low"], cell["high"] = cell["high"], cell["low"]


def swapped(document):
    for cell in first(document)["cells"]:
        cell.get("parts", []).reverse()


def entry(path, value):
    def change(document):
        *keys, last = path
        place = document
        for key in keys:
            place = place[key]
        place[last] = value(place[last]) if callable(value) else value

    return change


def cell_entry(answer, path, value, index=0):
    return lambda document: entry(path, value)(pick(document, answer, index))


def renamed(answer, new):
    return lambda document: pick(document, answer).update(answer=new)


def removed(answer):
    return lambda document: first(document)["cells"].remove(pick(document, answer))


# What a fault is answered with: the words of an error of form, or of a fault of substance.
FORM = {
    "across a knot": (across, "reaches across a knot of m"),
    "outside the box": (outside, "outside the range of m"),
    "reversed corners": (reversed_corners, "outside the range of m, or is empty"),
    "range narrowed": (entry(["plant", "parameters", 0, "range", 1], 3.5), "outside the range"),
    "range beyond the knots": (entry(["plant", "parameters", 0, "range", 1], 5), "cover the range"),
    "range across zero": (entry(["plant", "parameters", 0, "range", 0], -1), "touches zero"),
    "knots not rising": (entry(["law", "grid", 0], lambda g: [g[0], g[2], g[1]]), "must rise"),
    "a knot less": (entry(["law", "grid", 0], lambda g: g[::2]), "9 gains; the grid needs 6"),
    "a grid less": (entry(["law", "grid"], lambda g: g[:1]), "one list of knots a parameter"),
    "a gain less": (entry(["law", "gains"], lambda g: g[1:]), "8 gains; the grid needs 9"),
    "gain of other shape": (entry(["law", "gains", 0], [[1]]), "is 1 x 1, not 1 x 2"),
    "gain not a number": (entry(["law", "gains", 0, 0, 0], float("nan")), "finite"),
    "vertex less": (entry(["plant", "vertices"], lambda v: v[:2]), "span the vertices"),
    "through nothing": (entry(["plant", "parameters", 0, "through"], "sqrt(m)"), "through must be"),
    "key of a cell": (cell_entry("proved", ["at"], [1, 1]), "unknown key .*at"),
    "key of the table": (entry(["law", "clamp"], True), "unknown key law.clamp"),
    "key of the region": (entry(["claims", 0, "region", "margin"], 1), "unknown key"),
    "key of evidence": (cell_entry("proved", ["parts", 0, "tau"], 1), "unknown key .*tau"),
    "proved for nothing": (renamed("refuted", "proved"), "parts is missing"),
    "refuted for nothing": (renamed("undecided", "refuted"), "at is missing"),
    "no such answer": (renamed("refuted", "safe"), "must be one of proved, refuted, undecided"),
    "an answer that is a list": (renamed("refuted", ["refuted"]), "must be one of proved, refuted"),
    "too many cells": (entry(["claims", 0, "cells"], lambda c: [c[0]] * 2001), "1 to 2000 entries"),
    "no cells": (entry(["claims", 0, "cells"], []), "1 to 2000 entries"),
    "a part less": (cell_entry("proved", ["parts"], lambda p: p[:1]), "do not belong to method"),
    "degree without matrices": (cell_entry("proved", ["parts", 0, "degree"], 3), "needs"),
    "short corner": (cell_entry("proved", ["low"], [1]), "2 numbers"),
    "version": (entry(["version"], 3), "version 3"),
    "format": (entry(["format"], "polefence-table"), "is a format of polefence 0.1"),
}
SUBSTANCE = {
    "a cell grown": (grown, "overlap|inequality|two cells"),
    "a cell shrunk": (shrunk, "do not fill the box"),
    "an undecided cell less": (removed("undecided"), "do not fill the box"),
    "a proved cell less": (removed("proved"), "do not fill the box"),
    "a cell twice": (entry(["claims", 0, "cells"], lambda c: [*c, c[0]]), "overlap"),
    "X changed": (cell_entry("proved", ["parts", 1, "X", 0, 0, 0], lambda x: -x), "not positive"),
    "X asymmetric": (cell_entry("proved", ["parts", 0, "X", 0, 0, 1], 0.123), "not symmetric"),
    "parts swapped": (swapped, "not positive definite"),
    "knot moved": (entry(["law", "grid", 0, 0], 0.2), "not positive definite|all in the region"),
    "gain changed": (entry(["law", "gains", 0, 0, 1], 9.0), "not positive definite"),
    "plant changed": (entry(["plant", "vertices", 0, "A", 1, 0], 50), "not positive definite"),
    "decay raised": (
        entry(["claims", 0, "region", "parts", 0, "decay"], 30),
        "not positive definite",
    ),
    "decay lowered": (entry(["claims", 0, "region"], HalfPlane(0).document()), ""),
    "through p": (entry(["plant", "parameters", 0, "through"], "m"), "positive|in the region"),
}


def moved_inside(document):
    """The counterexample moved to a point of its cell where all poles are in the region."""
    claim = claim_of(document)
    for cell, plain in zip(claim.cells, first(document)["cells"], strict=True):
        for corner in product(*zip(cell.low, cell.high, strict=True)):
            inside = roots.all_inside(claim.table.loop(corner), claim.region)
            if cell.answer == "refuted" and inside:
                plain["at"] = [str(v) for v in corner]
                return plain
    raise LookupError


def moved_inside_alone(document):
    """The same without evidence: the characteristic polynomial is to say it."""
    del moved_inside(document)["outside"]


def changed(**entries):
    """Other evidence that a pole is outside."""

    def change(document):
        own = pick(document, "refuted")["outside"]
        for key, value in entries.items():
            own[key] = value(own[key])

    return change


def positive(S):
    """A P that is positive definite shows nothing."""
    return [[9e9 * (i == j) for j in range(len(S))] for i in range(len(S))]


def moved_outside(document):
    cell = pick(document, "refuted")
    cell["at"][0] = 1 if cell["low"][0] > 1 else 4


SUBSTANCE["counterexample moved inside"] = moved_inside, "does not show that a pole is outside"
SUBSTANCE["and has no evidence"] = moved_inside_alone, "poles are all in the region"
SHOWS = "does not show that a pole is outside"
SUBSTANCE["evidence of the wrong sign"] = changed(S=lambda S: [[-x for x in r] for r in S]), SHOWS
SUBSTANCE["evidence positive"] = changed(S=positive), SHOWS
SUBSTANCE["evidence not symmetric"] = changed(S=lambda S: [[1, 2], [3, *S[1][1:]]]), SHOWS
SUBSTANCE["a line that cuts the region"] = changed(line=lambda v: [v[0], v[1], -50]), SHOWS
SUBSTANCE["a line upside down"] = changed(line=lambda v: [-v[0], -v[1], v[2]]), SHOWS
FORM["evidence of another shape"] = changed(S=lambda S: S[:1]), "outside.S is 1 x 2"
FORM["a line of two numbers"] = changed(line=lambda v: v[:2]), "line must hold 3 numbers"
FORM["a key of the evidence"] = changed(line=lambda v: {"a": v}), "line must be a list"
SUBSTANCE["counterexample moved away"] = moved_outside, "outside its cell"


@pytest.mark.parametrize("name", FORM)
def test_a_fault_of_form_is_refused(document, name):
    change, message = FORM[name]
    broken = copy.deepcopy(document)
    change(broken)
    with pytest.raises(work.FormatError, match=message):
        summary(broken)


@pytest.mark.parametrize("name", SUBSTANCE)
def test_a_fault_of_substance_is_named(document, name):
    change, message = SUBSTANCE[name]
    broken = copy.deepcopy(document)
    change(broken)
    if name == "decay lowered":  # one part less in the region: evidence for two does not belong
        with pytest.raises(work.FormatError, match="do not belong"):
            summary(broken)
        return
    verdict = summary(broken)
    fault = verdict.reason
    assert verdict.answer == "undecided"
    assert not verdict.note
    assert any(word in fault for word in message.split("|")), fault


def test_what_only_weakens_a_claim_is_let_through_and_reported(document):
    """A refuted cell called undecided: nothing false is said, and the shares say it."""
    weaker = copy.deepcopy(document)
    cell = pick(weaker, "refuted")
    cell["answer"] = "undecided"
    del cell["at"]
    cell.pop("outside", None)
    before, after = claim_of(document).shares, claim_of(weaker).shares
    assert summary(weaker).note
    assert after["refuted"] < before["refuted"]
    assert after["proved"] == before["proved"]


def test_work_is_bounded(document, monkeypatch):
    monkeypatch.setattr(cells, "MAX_WORK", 1000)
    with pytest.raises(work.FormatError, match="to be checked"):
        summary(document)


def work_of(call):
    with work.counted() as count:
        call()
    return count.spent


def test_many_cells_are_compared_in_reasonable_time():
    """2000 cells: overlap is looked for along one side, not in all pairs."""
    sides = [Fraction(k, 40) for k in range(41)]
    tiles = [
        Cell((sides[i], sides[j]), (sides[i + 1], sides[j + 1]), "undecided")
        for i in range(40)
        for j in range(40)
    ]
    assert not untiled(tiles, 1)
    assert work_of(lambda: untiled(tiles, 1)) > 1600 * work.CALL
    wide = Cell(tiles[5].low, (sides[3], tiles[5].high[1]), "undecided")
    assert untiled([*tiles[:5], wide, *tiles[6:]], 1) == "two cells overlap"
