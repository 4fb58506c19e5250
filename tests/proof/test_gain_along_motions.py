"""Gains along motions by a continuous Q on a grid: proved; refused with a step between cells."""

from dataclasses import replace
from fractions import Fraction
from itertools import islice

import pytest

from polefence.certify.bounds import _Question
from polefence.law.laws import given_law
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from polefence.requirements.gain import Gain

SPEC = """
disturbances = ["w"]
[parameter.p]
range = [0.5, 2]
rate = [-1, 1]
[matrices]
A = [[0, 1], ["-4 - sin(p)", "-1 - p**3/4"]]
B = [[0], [1]]
E = [[0], ["sqrt(p)"]]
"""


@pytest.fixture(scope="module")
def bound():
    plant = loads(SPEC)
    question = _Question.of(plant, given_law(plant, [[0.0, 0.0]]), Gain(("x1",)))
    grids = list(islice(question.on_grids, 3))
    assert question.worst < grids[2].level < grids[1].level < grids[0].level
    return question.on_grid(grids[2], grids[2].level * (1 + 1e-4))


def test_a_continuous_Q_is_a_proof(bound):
    assert len(bound.claim.subject.evidence.cells) == 4
    assert prove(bound.claim).proved
    assert not prove(replace(bound.claim, level=bound.claim.level * Fraction(99, 100))).proved


def test_a_step_between_cells_is_none(bound):
    subject = bound.claim.subject
    first, *rest = subject.evidence.cells
    Q = [[[x * Fraction(1001, 1000) for x in row] for row in M] for M in first.evidence.X]
    cells = (replace(first, evidence=replace(first.evidence, X=Q)), *rest)
    changed = replace(subject, evidence=replace(subject.evidence, cells=cells))
    with pytest.raises(FormatError, match="not continuous"):
        prove(replace(bound.claim, subject=changed))
