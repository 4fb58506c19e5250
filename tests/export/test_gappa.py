"""What is stated of the rounding of exported laws, confirmed by Gappa: another program's proof."""

import ctypes
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from polefence import HalfPlane, Structure, UncertainPlant, analyse, at_sample_time, place
from polefence.export import export_c99
from polefence.law.laws import PolynomialGain
from polefence.plant.parameters import Parameter
from support import gappa, polynomials
from support.cortex import run
from support.hasty import hasty

DECAY, DRAWN = 0.3, 4000
KINDS = "one gain", "polynomial", "order 1"


def spring(m, k):
    return [[0, 1], [-k / m, -0.5 / m]], [[0], [1 / m]]


@cache
def exported(kind):
    """Return code in float32: one gain, a polynomial of two parameters, a law with a state."""
    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 20, "N/m")]
    plant = UncertainPlant.from_function(spring, bounds, states=["position", "speed"])
    with hasty():
        if kind == "one gain":
            return export_c99(place(plant, HalfPlane(DECAY), "quadratic"), 32)
        if kind == "polynomial":
            car, law = polynomials.made("measured")
            gains = 1.0001 * np.array(law.gains)  # no numbers of float32
            law = PolynomialGain(law.powers, gains, law.measured, law.parameters)
            return export_c99(analyse(car, law, polynomials.REGION).design, 32)
        law = Structure(measured=["position"], order=1, schedule=[])
        return export_c99(place(at_sample_time(plant, 0.02), HalfPlane(DECAY), structure=law), 32)


def rows_of(kind):
    """Return the claim, sizes of the signals that matter alike, and the rows with their bounds."""
    claim = exported(kind).guarantee.claim
    gains = [claim.code.K] if claim.code.K is not None else claim.code.terms
    largest = np.abs(np.array(gains, dtype=float)).max(axis=(0, 1))
    sizes = [Fraction(2.0 ** -np.round(np.log2(size))) for size in largest]
    stated = [gappa.bound(claim, row, sizes) for row in range(len(gains[0]))]
    return claim, sizes, stated


@pytest.mark.parametrize("kind", KINDS)
def test_gappa_confirms_the_stated_bound(kind):
    claim, sizes, stated = rows_of(kind)
    for row, most in enumerate(stated):
        script = gappa.row_script(claim, row, sizes, most)
        assert gappa.proved(script)
        assert 0 < gappa.reached(script) <= most
        # it can fail: with a few more binary digits the bound would be so
        assert not gappa.proved(gappa.row_script(claim, row, sizes, most / 16))


def test_gappa_confirms_where_a_parameter_is_in_its_interval():
    claim, _, _ = rows_of("polynomial")
    assert len(claim.code.shares) == 2
    for k in range(2):
        script = gappa.share_script(claim, k)
        assert gappa.proved(script)
        assert gappa.reached(script) > 0


@pytest.mark.parametrize("kind", KINDS)
def test_what_gappa_proves_is_more_than_the_code_is_off(kind, host_compiler, tmp_path):
    """A rounding that the scripts forgot would show: errors of the compiled C are as large."""
    claim, sizes, stated = rows_of(kind)
    made, random = exported(kind), np.random.default_rng(1)
    made.save(tmp_path)
    run("cc", "-std=c99", "-shared", "-fPIC", "-O1", "-o", "law.so", "law.c", cwd=tmp_path)
    law, worst = ctypes.CDLL(str(tmp_path / "law.so")), [Fraction(0)] * len(stated)
    for _ in range(DRAWN):
        y = (random.uniform(-1, 1, len(sizes)) * [float(size) for size in sizes]).astype(np.float32)
        p = np.array([random.uniform(float(s.low), float(s.high)) for s in claim.code.shares])
        found = updated(law, claim, p.astype(np.float32), y)
        for row, right in enumerate(exactly(claim, p.astype(np.float32), y)):
            worst[row] = max(worst[row], abs(Fraction(float(found[row])) - right))
    for row, seen in enumerate(worst):
        script = gappa.row_script(claim, row, sizes, stated[row])
        least = gappa.reached(script)
        assert least / 40 < seen <= least
        assert not gappa.proved(gappa.row_script(claim, row, sizes, seen * Fraction(9, 10)))
        if not claim.code.shares:  # the constants' own rounding is left then
            assert gappa.reached(script.replace(" rnd= ", " = ")) < seen


def updated(law, claim, p, y):
    """Return u, and the law's own states after an update of the compiled code."""
    order = claim.code.memory.states if claim.code.memory else 0
    signals = len(y) - order
    own, u = (ctypes.c_float * max(order, 1))(*y[signals:]), (ctypes.c_float * 1)()
    given = [own] if order else []
    given += [(ctypes.c_float * len(p))(*p)] if len(p) else []
    assert law.law_update(*given, (ctypes.c_float * signals)(*y[:signals]), u) == 0
    return [u[0], *list(own)[:order]]


def exactly(claim, p, y):
    """Return the same of the design's own law, in rational numbers."""
    law, code = claim.gain.subject.design.law, claim.code
    c = []
    for value, given in zip(p, claim.gain.subject.ranges, strict=False):
        exact = min(max(Fraction(float(value)), given.low), given.high)
        share = (exact - given.low) / (given.high - given.low)
        c.append(2 * (share * given.high / exact if given.inverted else share) - 1)
    powers = law.powers if code.terms else [()]
    weights = [np.prod([Fraction(1), *(x**k for x, k in zip(c, e, strict=True))]) for e in powers]
    y = [Fraction(float(value)) for value in y]
    gains = gappa.exact_gains(claim)
    rows = [
        sum(w * K[i][j] * x for w, K in zip(weights, gains, strict=True) for j, x in enumerate(y))
        for i in range(len(gains[0]))
    ]
    if code.memory:
        own, T = code.memory.states, code.memory.sample_time
        first = len(rows) - own
        rows[first:] = [x + T * v for x, v in zip(y[len(y) - own :], rows[first:], strict=True)]
    return rows
