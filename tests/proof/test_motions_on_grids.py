"""Poles and rms along motions on the cells of a grid: against motions; faults in the cells."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import HalfPlane, Rms, analyse
from polefence.certify.bounds import _Question, best_bound, kept_bound
from polefence.law.laws import given_law
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError

# A mass on a spring: a table of a parameter, whose knot is where it is softest.
SPEC = """
disturbances = ["w"]
[parameter.p]
range = [1, 3]
rate = [-RATE, RATE]
[parameter.d]
range = [0.8, 1]
[table.spring]
arguments = [1, 2, 3]
values = [4, LEAST, 6]
[matrices]
A = [[0, 1], ["-spring(p)", "-d"]]
B = [[0], [1]]
E = [[0], ["sqrt(p)"]]
"""
POSITION = Rms("x1", density=2)
WORST = np.sqrt(2 / (2 * 0.8 * 2))  # at rest, p = 2: E^2 / (2 d k)


def family(rate, least=2.0):
    return loads(SPEC.replace("RATE", str(rate)).replace("LEAST", str(least)))


def none(plant):
    return given_law(plant, [[0.0, 0.0]])


@pytest.fixture(scope="module")
def bound():
    plant = family(0.2)
    return best_bound(plant, none(plant), POSITION)


def test_a_bound_holds_of_the_covariance_along_motions_and_is_near_it(bound):
    largest = max(moved(0.2, end, turn) for end in (1.0, 3.0) for turn in (2.0, 2.4, 3.0))
    assert largest > 0.95 * WORST
    assert largest < bound.level < 1.2 * WORST
    assert len(bound.claim.subject.evidence.cells) > 1


def moved(rate, first, turn):
    """The largest deviation of x1 while p goes to and fro between an end and a turn."""
    P, p, way, largest, step = np.zeros((2, 2)), first, rate, 0.0, 0.01
    for _ in range(6000):
        A = np.array([[0, 1], [-np.interp(p, [1, 2, 3], [4, 2, 6]), -0.8]])
        half = np.linalg.inv(np.eye(2) - step / 2 * A)
        F = half @ (np.eye(2) + step / 2 * A)
        P = F @ P @ F.T + step * np.diag([0.0, p])  # intensity 1: of density 2
        largest = max(largest, P[0, 0])
        if not min(first, turn) <= p + way * step <= max(first, turn):
            way = -way
        p += way * step
    return np.sqrt(largest)


def test_the_slower_the_nearer_to_the_worst_at_rest(bound):
    levels = []
    for rate in (0.001, 0.05):
        plant = family(rate)
        question = _Question.of(plant, none(plant), POSITION)
        levels.append(min(along.level for along in question.along_motions))
    assert WORST < levels[0] < 1.003 * WORST
    assert levels[0] < levels[1] < bound.level
    kept = replace(POSITION, at_most=bound.level * 1.001)
    assert kept_bound(family(0.2), none(plant), kept) is not None


def test_a_lower_level_has_no_proof(bound):
    assert prove(bound.claim).proved
    assert not prove(replace(bound.claim, level=bound.claim.level * Fraction(99, 100))).proved


def changed(claim, what):
    """One fault in the cells of a proof that is good."""
    evidence = claim.subject.evidence
    first, *rest = evidence.cells
    if what == "step":
        X = [[[x * Fraction(1001, 1000) for x in row] for row in M] for M in first.evidence.X]
        first = replace(first, evidence=replace(first.evidence, X=X))
    elif what == "grid":  # a cell is cut in two along the parameter that stands still
        middle = (first.low[1] + first.high[1]) / 2
        rest = [replace(first, low=(first.low[0], middle)), *rest]
        first = replace(first, high=(first.high[0], middle))
    elif what == "gone":
        rest = rest[:-1]
    evidence = replace(evidence, cells=(first, *rest))
    return replace(claim, subject=replace(claim.subject, evidence=evidence))


@pytest.mark.parametrize(
    ("what", "why"), [("step", "not continuous"), ("grid", "of a grid"), ("gone", "of a grid")]
)
def test_one_fault_in_cells_is_seen(bound, what, why):
    with pytest.raises(FormatError, match=why):
        prove(changed(bound.claim, what))


def test_faster_rates_are_not_proved(bound):
    subject = bound.claim.subject
    p, d = subject.motion
    for rate, proved in ((Fraction(1, 5), True), (Fraction(1), False)):
        motion = (replace(p, rate=(-rate, rate)), d)
        claim = replace(bound.claim, subject=replace(subject, motion=motion))
        assert prove(claim).proved == proved


@pytest.mark.parametrize(("least", "rate", "proved"), [(0.5, 0.02, True), (-0.02, 0.02, False)])
def test_stability_while_a_table_moves(least, rate, proved):
    """At rest it is stable where the spring is above zero."""
    plant = family(rate, least)
    answer = analyse(plant, [[0.0, 0.0]], HalfPlane(0.0))
    assert answer.proved == proved
    if not proved:
        return
    assert answer.certificate.in_parts
    table = json.loads(answer.certificate.file().dumps())
    assert check(from_plain(table)).proved
    cells = table["claims"][0]["parts"][0]["cells"] if "parts" in table["claims"][0] else None
    for faster in ("3", "30"):
        again = json.loads(json.dumps(table))
        again["plant"]["parameters"][0]["rate"] = [f"-{faster}", faster]
        assert not check(from_plain(again)).proved
    assert cells is None or len(cells) > 1


def test_a_step_between_cells_of_a_region_is_refused():
    plant = family(0.02)
    claim = analyse(plant, [[0.0, 0.0]], HalfPlane(0.05)).certificate.claim()
    (proof,) = claim.evidence
    first, *rest = proof.cells
    X = [[[x * Fraction(1001, 1000) for x in row] for row in M] for M in first.evidence.X]
    cells = (replace(first, evidence=replace(first.evidence, X=X)), *rest)
    with pytest.raises(FormatError, match="not continuous"):
        prove(replace(claim, evidence=(replace(proof, cells=cells),)))
    still = replace(claim, motion=())
    assert prove(still).proved
