"""Peaks from initial states at all times: one fault at a time in every part of the claim."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import FixedGain, InitialPeak, at_sample_time
from polefence.certify.bounds import best_bound
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from support.specs import SPRING
from support.stored import given, refused, stored, times

LATE = FixedGain(np.array([[-30.0, -12.0, -0.2]]))
ASKED = InitialPeak("x", points=((1.0, 0.0, 0.0),), ellipsoid=((0.5, 0, 0), (0, 1, 0), (0, 0, 0)))


@pytest.fixture(scope="module")
def claim():
    """A proved claim of two stretches, whose inputs act half a sample late."""
    plant = at_sample_time(loads(SPRING), 0.02, 0.5)
    found = best_bound(plant, LATE, ASKED).claim
    assert len(found.subject.evidence.storage) >= 2
    assert not found.subject.evidence.cells
    return found


def test_it_is_proved_and_says_so(claim):
    assert prove(claim).proved
    names = [inequality.name for inequality in claim.inequalities()]
    for name in ("of X at vertex 1", "at a sample", "at the next", "of the output, stretch 2"):
        assert name in names
    assert {"of point 1", "of the ellipsoid"} <= set(names)
    assert claim.write()["evidence"].keys() >= {"X", "storage"}


@pytest.mark.parametrize("factor", [0.5, 0.97, 1.03, 2, -1])
@pytest.mark.parametrize("place", ["begin", "middle", "end"])
def test_a_changed_coefficient_of_the_storage(claim, place, factor):
    stretch = claim.subject.evidence.storage[0]
    k = {"begin": 0, "end": stretch.along, "middle": 1}[place]
    form = [times(M, factor) if j == k else M for j, M in enumerate(stretch.form)]
    assert refused(stored(claim, 0, form=form))


@pytest.mark.parametrize("factor", [0.9, 0.99, 1.05, 1.2, -1, 0])
def test_another_x(claim, factor):
    X = [times(M, factor) for M in claim.subject.evidence.X]
    assert refused(given(claim, X=X))


def test_all_of_it_times_a_factor(claim):
    """Less holds the initial states no more, more is seen too much."""
    evidence = claim.subject.evidence
    for factor, proved in ((0.999, False), (1, True), (1.01, False)):
        X = [times(M, factor) for M in evidence.X]
        storage = [replace(s, form=[times(M, factor) for M in s.form]) for s in evidence.storage]
        assert refused(given(claim, X=X, storage=tuple(storage))) is not proved


def test_more_initial_states(claim):
    one, X0 = Fraction(1), claim.ellipsoid
    for point in ((one * 101 / 100, 0, 0), (one, one / 2, 0), (0, 0, one * 10**5)):
        assert refused(replace(claim, points=(*claim.points, tuple(map(Fraction, point)))))
    assert refused(replace(claim, ellipsoid=tuple(tuple(3 * x for x in row) for row in X0)))
    late = [[*row[:2], Fraction(10**10 * (i == 2))] for i, row in enumerate(X0)]
    assert refused(replace(claim, ellipsoid=tuple(map(tuple, late))))
    assert prove(replace(claim, points=(tuple(-x for x in claim.points[0]),))).proved
    assert prove(replace(claim, points=())).proved
    assert prove(replace(claim, ellipsoid=())).proved


def test_ends_of_stretches(claim):
    half = claim.subject.evidence.storage[0].end
    for end in (half / 2, half + Fraction(1, 10), Fraction(1), Fraction(0), Fraction(2)):
        assert refused(stored(claim, 0, end=end)), end


def test_a_broken_join(claim):
    form = list(claim.subject.evidence.storage[1].form)
    form[0] = times(form[0], 1 + Fraction(1, 10**9))
    with pytest.raises(FormatError, match="begins where"):
        prove(stored(claim, 1, form=form))


def test_levels_and_what_is_held(claim):
    plant = at_sample_time(loads(SPRING), 0.02, 0.5)
    worst = Fraction(float(ASKED.values(plant, LATE, np.eye(4)).max()))
    assert refused(replace(claim, level=worst * Fraction("0.9999")))
    assert prove(replace(claim, level=2 * claim.level)).proved
    for key in "AB":
        held = claim.held
        held = replace(held, **{key: [times(M, 1.1) for M in getattr(held, key)]})
        assert refused(replace(claim, held=held)), key
    assert refused(replace(claim, held=replace(claim.held, early=claim.held.early / 2)))


def test_evidence_of_another_form_is_refused(claim):
    storage = claim.subject.evidence.storage
    for changed, words in (
        ({"dual": True}, "no dual form|needs X and a storage function"),
        ({"storage": ()}, "belongs to a bound at all times"),
        ({"storage": tuple(replace(s, inverse=True) for s in storage)}, "no inverse form"),
        ({"storage": storage[:1]}, "ends with the period"),
        ({"pieces": (2, 2)}, "no more"),
    ):
        with pytest.raises(FormatError, match=words):
            prove(given(claim, **changed))


def test_impulses_and_samples_of_x_are_refused(claim):
    with pytest.raises(FormatError, match="impulses"):
        prove(replace(claim, impulses=(Fraction(1),)))
    exact = replace(claim.subject, remainder=None)
    with pytest.raises(FormatError, match="from states at a sample"):
        prove(replace(claim, subject=exact, impulses=(Fraction(1),)))
    A = [[list(row) for row in M] for M in claim.subject.A]
    for M in A:
        M[2][0] = Fraction(1, 100)
    with pytest.raises(FormatError, match="take samples"):
        prove(replace(claim, subject=replace(claim.subject, A=A)))
