"""Rounding of states that code keeps: the bound from the other side, and one fault at a time."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from polefence.export.guarantee import guarantee, roundings
from polefence.export.memory import kept, with_rates
from polefence.export.program import number, program
from polefence.export.program import with_memory as with_memory_of
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import UNITS, Rounded, gain_errors, rounding_error
from polefence.proof.claims.sampled import Sampled
from polefence.proof.document import check, loads
from polefence.proof.work import FormatError
from support.memories import TIME, design, exactly, exported

EXPORTED = Path(__file__).parent / "format2" / "export" / "guarantee.json"


@pytest.fixture(scope="module")
def rounded():
    return exported("affine", 32).guarantee.claim


@pytest.fixture(scope="module")
def sampled():
    return loads(EXPORTED.read_text()).first(Sampled)


def with_memory(claim, **changes):
    code = claim.code
    return replace(claim, code=replace(code, memory=replace(code.memory, **changes)))


def in_design(claim, **changes):
    design = replace(claim.gain.subject.design, **changes)
    subject = replace(claim.gain.subject, design=design)
    return replace(claim, gain=replace(claim.gain, subject=subject))


@pytest.mark.parametrize("step", [None, Fraction(10486, 2**20)])
def test_no_rounding_of_a_step_is_beyond_the_bound_and_some_comes_near(rounded, step):
    """x+ = (x + (1 + d1) h (K + D) s) (1 + d2), at the ends of d1, d2 and D; another h too."""
    claim = with_memory(rounded, step=step) if step else rounded
    memory, unit = claim.code.memory, UNITS[32]
    assert memory.sample_time == Fraction(TIME)
    plain = exactly(gain_errors(replace(claim, code=replace(claim.code, memory=None)))[-1])
    bound, random, worst = exactly(gain_errors(claim)[-1]), np.random.default_rng(1), 0.0
    K = claim.gain.subject.design.law.K
    for signs in product((-1, 1), repeat=2):  # of the parameters' coordinates
        row = sum(exactly(k[-1]) * c for k, c in zip(K, (1, *signs), strict=True))
        for d1, d2, d in product((-unit, unit), (-unit, unit), (-1, 1)):
            s = exactly(random.normal(size=2) * 10.0 ** random.uniform(-3, 3, size=2))
            off = sum(d * a * abs(b) for a, b in zip(plain, s, strict=True))
            step_ = (1 + d1) * memory.step * (row @ s + off)
            after = (s[-1] + step_) * (1 + d2)
            wrong = abs((after - s[-1]) / memory.sample_time - row @ s)
            most = bound @ np.abs(s)
            assert wrong <= most
            worst = max(worst, float(wrong / most))
    assert worst > 0.3


def test_the_bound_grows_as_samples_get_shorter(rounded):
    """By u / T in the column of the state itself, and in no other row."""
    code = rounded.code
    half = with_memory(rounded, sample_time=code.memory.sample_time / 2, step=code.memory.step / 2)
    one, other = (np.array(gain_errors(claim), dtype=object) for claim in (rounded, half))
    assert (other - one)[1, 1] == UNITS[32] / code.memory.sample_time
    assert not np.any((other - one)[0])
    assert (other - one)[1, 0] == 0
    without = np.array(gain_errors(replace(rounded, code=replace(code, memory=None))), dtype=object)
    assert np.array_equal(without[0], one[0])
    assert np.all(without[1] < one[1])


def test_scales_of_the_steps_prove_what_those_of_the_gain_do_not():
    """Of short samples u / T is the error, of no size that an entry of the gain has."""
    own = with_rates(design("pid"))
    code = with_memory_of(program(own.law, own.plant.parameters, number(32)), kept(own), 5e-6)
    plain = roundings(own, code)[0].guarantee(own)
    assert not plain.proved
    assert plain.rounding > plain.tolerated > 0
    found = guarantee(own, code)
    assert found.proved
    assert found.check().proved
    assert rounding_error(found.claim) <= found.claim.gain.error


FAULTS = {
    "a smaller error": lambda c: replace(
        c, gain=replace(c.gain, error=rounding_error(c) * Fraction(999, 1000))
    ),
    "another step": lambda c: with_memory(c, step=Fraction(1, 64)),
    "a much shorter time": lambda c: with_memory(c, sample_time=Fraction(1, 10**9)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_not_proved(rounded, fault):
    assert prove(rounded).proved
    assert not prove(FAULTS[fault](rounded)).proved


def changed(matrices, i, j):
    first = [list(row) for row in matrices[0]]
    first[i][j] += Fraction(1, 10**6)
    return [first, *matrices[1:]]


def of_law(claim, i, j):
    law = claim.gain.subject.design.law
    C = [[list(row) for row in each] for each in law.C]
    for each in C:
        each[i][j] += Fraction(1, 10**6)
    return in_design(claim, law=replace(law, C=tuple(C)))


REFUSED = {
    "no state": lambda c: with_memory(c, states=0),
    "all inputs": lambda c: with_memory(c, states=2),
    "no time": lambda c: with_memory(c, sample_time=Fraction(0)),
    "a negative step": lambda c: with_memory(c, step=-c.code.memory.step),
    "no float32": lambda c: with_memory(c, step=c.code.memory.step + Fraction(1, 2**60)),
    "dynamics of its own": lambda c: in_design(c, A=changed(c.gain.subject.design.A, 2, 2)),
    "driven by the plant": lambda c: in_design(c, A=changed(c.gain.subject.design.A, 2, 0)),
    "drives the plant": lambda c: in_design(c, A=changed(c.gain.subject.design.A, 0, 2)),
    "another rate": lambda c: in_design(c, B=changed(c.gain.subject.design.B, 2, 1)),
    "driven by the input": lambda c: in_design(c, B=changed(c.gain.subject.design.B, 2, 0)),
    "a rate into the plant": lambda c: in_design(c, B=changed(c.gain.subject.design.B, 1, 1)),
    "half of the state": lambda c: of_law(c, 1, 2),
    "a part of the plant": lambda c: of_law(c, 1, 0),
    "measured with the plant": lambda c: of_law(c, 0, 2),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_states_that_are_not_the_codes_own_are_refused(rounded, fault):
    with pytest.raises(FormatError):
        prove(REFUSED[fault](rounded))


OF_LOOPS = {
    "all late": lambda c: replace(c, prompt=0),
    "none late": lambda c: replace(c, delay=0),
    "all at once": lambda c: replace(c, prompt=2),
    "another time": lambda c: replace(c, sample_time=c.sample_time * Fraction(21, 20)),
    "a smaller error": lambda c: replace(c, error=c.error / 2, mu=c.mu / 2),
    "faster": lambda c: replace(c, decay=c.decay * 2),
}


@pytest.mark.parametrize("fault", OF_LOOPS)
def test_a_fault_of_the_sampled_loop_is_found(sampled, fault):
    assert prove(sampled).proved
    try:
        assert not prove(OF_LOOPS[fault](sampled)).proved
    except FormatError:
        assert fault != "faster"


def test_a_loop_covers_the_code_with_its_own_time_and_states_alone(sampled):
    rounded = loads(EXPORTED.read_text()).first(Rounded)
    assert sampled.covers(rounded)
    without = replace(rounded, code=replace(rounded.code, memory=None))
    other = with_memory(rounded, sample_time=rounded.code.memory.sample_time * 2)
    assert not any(sampled.covers(claim) for claim in (without, other))
    assert not replace(sampled, prompt=0).covers(rounded)


def test_files_have_the_fields_of_a_memory_where_there_is_one():
    found = loads(EXPORTED.read_text())
    assert check(found).proved
    loop = found.first(Sampled)
    assert (loop.prompt, loop.late) == (1, 1)
    table = found.write()
    assert table["claims"][0]["code"]["memory"]["states"] == 1
    assert Fraction(table["claims"][0]["code"]["memory"]["sample_time"]) == Fraction(TIME)
    assert table["claims"][1]["prompt"] == 1
