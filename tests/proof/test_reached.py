"""What disturbances reach at all times: one fault at a time in every part of the claim."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import EnergyPeak, FixedGain, at_sample_time
from polefence.certify.bounds import best_bound
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from support.specs import SPRING
from support.stored import given, refused, stored, times

LATE = FixedGain(np.array([[-30.0, -12.0, -0.2]]))


@pytest.fixture(scope="module")
def claim():
    """A proved claim of two stretches, whose inputs act half a sample late."""
    plant = at_sample_time(loads(SPRING), 0.02, 0.5)
    found = best_bound(plant, LATE, EnergyPeak("x", norm=2.0)).claim
    assert len(found.subject.evidence.storage) >= 2
    assert not found.subject.evidence.cells
    return found


def test_it_is_proved_and_says_so(claim):
    verdict = prove(claim)
    assert verdict.proved
    names = [inequality.name for inequality in claim.inequalities()]
    for name in ("of X at vertex 1", "at a sample", "at the next", "of the output, stretch 2"):
        assert name in names
    assert claim.write()["evidence"].keys() >= {"X", "storage"}
    assert "Q" not in claim.write()["evidence"]


@pytest.mark.parametrize("factor", [0.5, 0.97, 1.03, 2, -1])
@pytest.mark.parametrize("place", ["begin", "middle", "end"])
def test_a_changed_coefficient_of_the_storage(claim, place, factor):
    stretch = claim.subject.evidence.storage[0]
    k = {"begin": 0, "end": 1, "middle": 2}[place]
    form = [times(M, factor) if j == k else M for j, M in enumerate(stretch.form)]
    assert refused(stored(claim, 0, form=form))


@pytest.mark.parametrize("factor", [0.9, 0.99, 1.01, 1.1, -1, 0])
def test_another_x(claim, factor):
    X = [times(M, factor) for M in claim.subject.evidence.X]
    assert refused(given(claim, X=X))


@pytest.mark.parametrize("k", [0, 1, 2])
def test_one_coefficient_of_x(claim, k):
    X = [times(M, 0.9) if j == k else M for j, M in enumerate(claim.subject.evidence.X)]
    assert refused(given(claim, X=X))


def test_ends_of_stretches(claim):
    half = claim.subject.evidence.storage[0].end
    for end in (half / 2, half + Fraction(1, 10), Fraction(1), Fraction(0), Fraction(2)):
        assert refused(stored(claim, 0, end=end)), end
    for end in (Fraction(9, 10), Fraction(11, 10)):
        assert refused(stored(claim, len(claim.subject.evidence.storage) - 1, end=end)), end


def test_a_broken_join(claim):
    form = list(claim.subject.evidence.storage[1].form)
    form[0] = times(form[0], 1 + Fraction(1, 10**9))
    with pytest.raises(FormatError, match="begins where"):
        prove(stored(claim, 1, form=form))


def test_levels_norms_and_disturbances(claim):
    plant = at_sample_time(loads(SPRING), 0.02, 0.5)
    worst = claim.norm * Fraction(EnergyPeak("x").values(plant, LATE, np.eye(4)).max())
    assert refused(replace(claim, level=worst * Fraction("0.9999")))
    assert refused(replace(claim, norm=claim.norm * Fraction("1.01")))
    assert refused(replace(claim, scales=(Fraction("1.01"),)))
    for key in "ABE":
        held = claim.held
        held = replace(held, **{key: [times(M, 1.05) for M in getattr(held, key)]})
        assert refused(replace(claim, held=held)), key
    assert refused(replace(claim, held=replace(claim.held, early=claim.held.early / 2)))
    assert prove(replace(claim, level=2 * claim.level)).proved
    assert prove(replace(claim, norm=claim.norm / 2)).proved


def test_evidence_of_another_form_is_refused(claim):
    storage = claim.subject.evidence.storage
    for changed, words in (
        ({"dual": True}, "needs X and a storage function"),
        ({"storage": ()}, "belongs to a bound at all times"),
        ({"storage": tuple(replace(s, inverse=True) for s in storage)}, "no inverse form"),
        ({"storage": storage[:1]}, "ends with the period"),
        ({"pieces": (2, 2)}, "no more"),
    ):
        with pytest.raises(FormatError, match=words):
            prove(given(claim, **changed))


def test_states_that_take_samples_of_x_are_refused(claim):
    """What x was at the last sample is not known when the period ends."""
    A = [[list(row) for row in M] for M in claim.subject.A]
    for M in A:
        M[2][0] = Fraction(1, 100)
    with pytest.raises(FormatError, match="take samples"):
        prove(replace(claim, subject=replace(claim.subject, A=A)))
    E = [[*M[:2], [Fraction(1, 100)]] for M in claim.subject.E]
    with pytest.raises(FormatError, match="take samples"):
        prove(replace(claim, subject=replace(claim.subject, E=E)))
