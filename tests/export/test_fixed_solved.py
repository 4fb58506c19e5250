"""Scheduled laws in fixed point: elimination in integers, and each term of its error."""

from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import InputError
from polefence.export import export_c99
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import gain_errors, rounding_error, solving_of
from polefence.proof.claims.solving import Solving
from polefence.proof.work import FormatError
from polefence.response.discrete import Sampling
from support.fixed_points import RANGES, SOLVED, Exact, WordCode, exported, law_design


def pivots(made, weights):
    """Return D of the code's W at weights of its coefficients, in Python's integers."""
    w, factors = made.program.scales.solving[:2]
    n = len(made.program.T)

    def nearest(value):
        return (1 if value >= 0 else -1) * int(abs(value) + Fraction(1, 2))

    pairs = zip(map(Fraction, weights), made.program.W, strict=True)
    whole = sum(a * np.vectorize(Fraction)(M) for a, M in pairs)
    table = [[nearest(x * 2**w) for x in row] for row in whole]
    for j in range(n):
        for i in range(j, n):
            products = sum(table[i][k] * table[k][j] for k in range(j))
            table[i][j] = nearest(table[i][j] - Fraction(products, 2**factors))
        for i in range(j + 1, n):
            table[j][i] = table[i][j]
            table[i][j] = nearest(Fraction(table[i][j] * 2**factors, table[j][j]))
    return [table[j][j] for j in range(n)]


@pytest.mark.parametrize("kind", ["scheduled", "scheduled, of weights"])
@pytest.mark.parametrize("bits", [16, 32])
def test_pivots_stay_between_the_bounds(kind, bits):
    made = exported(kind, bits)
    solving, (w, *_) = solving_of(made.guarantee.claim), made.program.scales.solving
    random = np.random.default_rng(0)
    for _ in range(20):
        found = pivots(made, random.dirichlet(np.ones(len(made.program.W))))
        assert min(found) > (solving.smallest - solving.of_W) * 2**w
        assert max(found) < solving.diagonal * 2**w


@pytest.mark.parametrize("kind", SOLVED)
def test_nothing_overflows_whatever_is_given(host_compiler, kind, tmp_path):
    made = exported(kind, 16)
    code, exact = WordCode(made, tmp_path), Exact(made)
    least, top = -exact.top - 1, exact.top
    count = len(made.program.shares) or made.program.domain.corners
    for ends in (least, -1, 0, 1, top):
        for other in (least, 0, top):
            given = [ends, *[other] * (count - 1)]
            for x in ([least, least], [top, least], [0, top]):
                (u,), _ = code.update(given, x, [])
                assert abs(u) <= exact.top


FAULTS = {
    "of what is solved for": ("off", lambda solving: Fraction(0)),
    "of W": ("of_W", lambda solving: Fraction(0)),
    "of Z": ("of_Z", lambda solving: Fraction(0)),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bound_without_one_of_its_terms_is_less(fault, monkeypatch):
    claim = exported("scheduled", 16).guarantee.claim
    whole = rounding_error(claim)
    monkeypatch.setattr(Solving, FAULTS[fault][0], property(FAULTS[fault][1]))
    assert rounding_error(claim) < whole


def test_a_bound_of_last_bits_alone_is_exceeded(host_compiler, tmp_path, monkeypatch):
    made = exported("scheduled", 16)
    monkeypatch.setattr(Solving, "off", property(lambda solving: Fraction(0)))
    code, exact, random = WordCode(made, tmp_path), Exact(made), np.random.default_rng(0)
    most = 0
    for k in range(400):
        given, x, own = exact.random(random, k)
        (u,), _ = code.update(given, x, own)
        ((wanted, error),) = exact.answers(given, x, own)
        most = max(most, abs(u - wanted) / error)
    assert most > 1


def test_a_file_that_says_more_of_its_equations_is_refused():
    claim = exported("scheduled", 16).guarantee.claim
    assert prove(claim).proved
    code = claim.code
    more = [
        replace(claim, smallest=claim.smallest * 2),
        replace(claim, size=claim.size / 2),
        replace(claim, code=replace(code, L=[[x * 2 for x in row] for row in code.L])),
        replace(claim, code=replace(code, L=None)),
        replace(claim, code=replace(code, shares=())),
        replace(claim, code=replace(code, T=[[x * 3 / 2 for x in row] for row in code.T])),
    ]
    scales = code.scales
    for k in range(len(scales.solving)):
        # finer units take more room
        solving = tuple(v + 9 * (j == k) for j, v in enumerate(scales.solving))
        more.append(replace(claim, code=replace(code, scales=replace(scales, solving=solving))))
    for other in more:
        with suppress(FormatError):
            assert not prove(other).proved


def test_the_loop_at_samples_reads_inputs_on_their_way_exactly():
    made = export_c99(
        law_design("scheduled"), fixed=32, ranges=RANGES, sampling=Sampling(0.01, delay=1)
    )
    assert made.proved
    held = made.timing.proof.rounded.claim
    errors = gain_errors(held)
    assert [e > 0 for e in errors[0]] == [True, True, False]
    assert errors[0][:2] >= gain_errors(made.guarantee.claim)[0]


def test_more_bits_are_named_where_few_have_no_room(physical):
    design = law_design("scheduled")
    with pytest.raises(InputError, match="range of speed"):
        export_c99(design, fixed=16, ranges={"position": 0.3})
    with pytest.raises(InputError, match="leave out --given alpha"):
        export_c99(law_design("degree 2"), fixed=16, ranges=RANGES, given="alpha")


def test_the_exact_gain_is_that_of_the_law():
    """The twin of other tests, against the law in doubles."""
    made = exported("degree 2", 32)
    exact, random = Exact(made), np.random.default_rng(0)
    for k in range(5):
        given, _, _ = exact.random(random, k)
        pairs = zip(made.program.shares, made.program.scales.given, strict=True)
        values = {
            share.parameter.name: v * 2.0**-s for (share, s), v in zip(pairs, given, strict=True)
        }
        alpha = made.design.plant.alpha(**values)
        assert np.allclose(np.array(exact.gain(given), dtype=float), made.design.law.gain(alpha))
