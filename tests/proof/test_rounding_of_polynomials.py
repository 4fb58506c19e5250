"""The proof that a polynomial law keeps its region as code computes it; of signals too."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from polefence.export.guarantee import code_of, guarantee
from polefence.export.program import Fixed, Polynomial, number, program
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import gain_errors, rounding_error
from polefence.proof.work import FormatError
from support.polynomials import KINDS, design


@cache
def made(kind, bits=32, given="parameters"):
    own = design(kind)
    code = program(own.law, own.plant.parameters if given == "parameters" else (), number(bits))
    return own, code, guarantee(own, code)


@pytest.mark.parametrize("given", ["parameters", "alpha"])
@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize("kind", KINDS)
def test_it_is_proved_with_room(kind, bits, given):
    own, code, found = made(kind, bits, given)
    assert isinstance(code, Fixed if kind == "one gain" else Polynomial)
    assert code.shape[0] == own.law.gains.shape[2]
    assert found.proved
    assert found.check().proved
    assert found.rounding < (1e-3 if bits == 32 else 1e-11) * found.tolerated
    assert code_of(code, own.plant) == found.claim.code


def single(code, given, y):
    """u as the code computes it, in float32, in the code's order."""
    f = np.float32
    if code.shares:
        ends = []
        for share, value in zip(code.shares, given, strict=True):
            part = f(f(share.scale) * f(f(value) - f(share.low)))
            part = f(part / f(value)) if share.parameter.inverted else part
            part = min(max(part, f(0)), f(1))
            ends.append((f(f(1) - part), part))
    else:
        total = f(0)
        for weight in given:
            total = f(total + f(weight))
        a = [f(f(weight) * f(f(1) / total)) for weight in given]
        ends = [(f(a[0] + a[1]), f(a[2] + a[3])), (f(a[0] + a[2]), f(a[1] + a[3]))]
    c = [f(high - low) for low, high in ends] if code.signed else a
    w = []
    for e in code.powers:
        factors = [c[j] for j, power in enumerate(e) for _ in range(power)] or [f(1)]
        value = factors[0]
        for factor in factors[1:]:
            value = f(value * factor)
        w.append(value)
    u = np.zeros(code.shape[1], dtype=f)
    for i in range(len(u)):
        for j in range(len(y)):
            value = f(code.gains[0, i, j]) * w[0]
            for k in range(1, len(w)):
                value = f(value + f(f(code.gains[k, i, j]) * w[k]))
            u[i] = f(u[i] + f(value * f(y[j])))
    return u.astype(float)


@pytest.mark.parametrize("given", ["parameters", "alpha"])
@pytest.mark.parametrize("kind", ["square", "measured", "varying", "alpha"])
def test_arithmetic_itself_stays_below_the_bound(kind, given):
    """For every signal: |u - K y| <= E |y|; and the bound is not absurd."""
    own, code, found = made(kind, 32, given)
    random, worst = np.random.default_rng(1), 0.0
    for _ in range(200):
        y = (random.normal(size=code.shape[0]) * 10.0 ** random.uniform(-3, 1)).astype(np.float32)
        if code.shares:
            share = random.uniform(size=len(code.shares))
            ends = [(float(s.parameter.low), float(s.parameter.high)) for s in code.shares]
            taken = [low + t * (high - low) for t, (low, high) in zip(share, ends, strict=True)]
            taken = np.clip(np.float32(taken).astype(float), *np.array(ends).T)
            names = [s.parameter.name for s in code.shares]
            alpha = own.plant.alpha(**dict(zip(names, taken, strict=True)))
        else:
            taken = random.dirichlet(np.ones(4))
            if own.plant.parameters:  # a point of the box
                s, t = random.uniform(size=2)
                taken = np.kron([1 - s, s], [1 - t, t])
            taken = np.float32(taken).astype(float)
            alpha = taken / taken.sum()
        exact = own.law.own_gain(alpha) @ y.astype(float)
        error = np.abs(single(code, taken, y) - exact)
        bound = found.bound(y[None].astype(float))[0]
        worst = max(worst, float((error / bound).max()))
    assert 1e-3 < worst < 1


def test_errors_of_the_gain_are_those_of_states_where_what_is_measured_varies():
    """|E C(alpha) x| for any error within the bounds stays below what the claim allows."""
    for kind in ("measured", "third", "many", "varying"):
        own, _, found = made(kind)
        E = np.array(gain_errors(found.claim), dtype=float)
        rows, right = (
            np.array(v, dtype=float) for v in (found.claim.gain.rows, found.claim.gain.right)
        )
        random = np.random.default_rng(2)
        for _ in range(100):
            x, alpha = random.normal(size=4), random.dirichlet(np.ones(4))
            C = own.law.C[0] if len(own.law.C) == 1 else np.tensordot(alpha, own.law.C, 1)
            off = (E * random.choice([-1, 1], E.shape)) @ C @ x
            size = found.rounding * np.linalg.norm(right @ x)
            assert np.all(np.abs(off) <= (1 + 1e-9) * size * rows)


def test_the_bound_grows_with_what_it_is_made_of():
    """Each constant that is off, by more than its own rounding, is seen."""
    claim = made("square")[2].claim
    code, base, off = claim.code, rounding_error(claim), Fraction(1, 1000)

    def changed(**parts):
        return rounding_error(replace(claim, code=replace(code, **parts)))

    for k in range(len(code.terms)):
        first = [list(row) for row in code.terms[k]]
        first[0][0] += off * abs(first[0][0])
        assert changed(terms=(*code.terms[:k], first, *code.terms[k + 1 :])) > base
    assert changed(bits=64) < base / 2
    wide = replace(code.shares[0], low=code.shares[0].low - 1)
    assert changed(shares=(wide, code.shares[1])) > base
    steep = replace(code.shares[1], scale=code.shares[1].scale * (1 + off))
    assert changed(shares=(code.shares[0], steep)) > base


def of_code(**parts):
    return lambda c: replace(c, code=replace(c.code, **parts))


def of_gain(**parts):
    return lambda c: replace(c, gain=replace(c.gain, **parts))


FAULTS = {
    "gain error": lambda c: replace(c, gain=replace(c.gain, error=c.gain.error / 10**9)),
    "gain too large": lambda c: replace(c, gain=replace(c.gain, error=c.gain.error * 10**5)),
    "terms": lambda c: replace(c, code=replace(c.code, terms=c.code.terms[1:] + c.code.terms[:1])),
    "scale": lambda c: of_code(
        shares=(replace(c.code.shares[0], scale=Fraction(1, 2)), c.code.shares[1])
    )(c),
}
MALFORMED = {
    "bits": of_code(bits=16),
    "one gain": lambda c: of_code(K=c.code.terms[0], terms=(), shares=())(c),
    "a gain besides": lambda c: of_code(K=c.code.terms[0])(c),
    "no terms": of_code(terms=()),
    "a term missing": lambda c: of_code(terms=c.code.terms[1:])(c),
    "a share missing": lambda c: of_code(shares=c.code.shares[1:])(c),
    "another shape": lambda c: of_code(terms=tuple([row[1:] for row in k] for k in c.code.terms))(
        c
    ),
    "no float32": lambda c: of_code(
        terms=tuple([[v + Fraction(1, 2**40) for v in r] for r in k] for k in c.code.terms)
    )(c),
    "other rows": lambda c: of_gain(columns=((Fraction(1),) * 4,) * 4)(c),
    "rows turned": lambda c: of_gain(columns=tuple(tuple(-v for v in row) for row in c.gain.right))(
        c
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_not_proved(fault):
    claim = made("measured")[2].claim
    assert not prove(FAULTS[fault](claim)).proved


@pytest.mark.parametrize("fault", MALFORMED)
def test_what_does_not_fit_together_is_refused(fault):
    claim = made("measured")[2].claim
    with pytest.raises(FormatError):
        prove(MALFORMED[fault](claim))


@pytest.mark.parametrize("kind", ["many", "varying"])
def test_rows_of_signals_must_be_one_for_all_parameters_and_no_more_than_states(kind):
    claim, other = (made(own)[2].claim for own in (kind, "measured"))
    with pytest.raises(FormatError, match="columns must be numbers"):
        prove(of_gain(columns=other.gain.columns)(claim))


def test_the_code_of_another_law_is_not_taken():
    """A scheduled code of a polynomial law, and terms of one gain."""
    claim, one = made("affine")[2].claim, made("one gain")[2].claim
    with pytest.raises(FormatError, match="do not belong together"):
        prove(of_code(terms=(), T=[[Fraction(1)] * 4] * 4)(claim))
    with pytest.raises(FormatError):
        prove(of_code(K=claim.code.terms[0])(one))
