"""The proof that a law keeps its region as code computes it, held against arithmetic itself."""

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from polefence import Disk, Scheduled, place
from polefence.examples import family
from polefence.export.guarantee import code_of, guarantee, scales
from polefence.export.program import Scheduled as Code
from polefence.export.program import amid, number, program
from polefence.proof import regions
from polefence.proof.claims.base import prove
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rounding import Code as Constants
from polefence.proof.claims.rounding import Rounded, rounding_error
from polefence.proof.laws import Evidence, Law
from polefence.proof.work import FormatError

CASES = {
    "parameters": ("quarter-car-physical", Disk(-40, 31), "scheduled", True),
    "alpha": ("quarter-car-as-printed", Disk(-40, 31), "scheduled", False),
    "degree 2": ("quarter-car-physical", Disk(-40, 31), Scheduled(degree=2, on="box"), True),
    "box by alpha": ("quarter-car-physical", Disk(-40, 31), Scheduled(degree=2, on="box"), False),
    "one gain": ("quarter-car-physical", Disk(-40, 36), "quadratic", True),
    "slack": ("quarter-car-physical", Disk(-40, 35), "slack", True),
}


@cache
def made(case, bits=32, apart=False):
    plant, region, method, by_parameters = CASES[case]
    design = place(family(plant), region, method)
    code = program(design.law, design.plant.parameters if by_parameters else (), number(bits))
    code = amid(code, design.law) if apart else code
    return design, code, guarantee(design, code)


@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize("case", CASES)
def test_it_is_proved_with_room(case, bits):
    _, _, found = made(case, bits)
    assert found.proved
    assert found.check().proved
    assert found.rounding < (0.05 if bits == 32 else 1e-9) * found.tolerated


def single(code, weights, x):
    """u as the code computes it, in float32, in the code's order."""
    f = np.float32
    n, m = code.shape
    T, w = code.T.astype(f), weights.astype(f)

    def at(table, *index):
        total = f(table[(0, *index)]) * w[0]
        for k in range(1, len(w)):
            total = f(total + f(f(table[(k, *index)]) * w[k]))
        return total

    rows = np.zeros((n + 1, n), dtype=f)
    for i in range(n):
        y = f(0)
        for j in range(i + 1):
            rows[i, j] = at(code.W, i, j)
            y = f(y + f(T[i, j] * x[j]))
        rows[n, i] = y
    y = rows[n].copy()
    for j in range(n):
        for i in range(j, n + 1):
            for k in range(j):
                rows[i, j] = f(rows[i, j] - f(rows[i, k] * rows[k, j]))
        inverse = f(f(1) / rows[j, j])
        for i in range(j + 1, n):
            rows[j, i] = rows[i, j]
            rows[i, j] = f(rows[i, j] * inverse)
        rows[n, j] = f(rows[n, j] * inverse)
    v = np.zeros(n, dtype=f)
    for j in reversed(range(n)):
        v[j] = rows[n, j]
        for i in range(j + 1, n):
            v[j] = f(v[j] - f(rows[i, j] * v[i]))
    u = np.zeros(m, dtype=f)
    for i in range(m):
        for j in range(n):
            u[i] = f(u[i] + f(at(code.Z, i, j) * v[j]))
            if code.L is not None:
                u[i] = f(u[i] + f(f(code.L[i, j]) * y[j]))
    return u.astype(float)


@pytest.mark.parametrize("apart", [False, True])
def test_arithmetic_itself_stays_below_the_bound(apart):
    """For every x: |u - K x| <= bound |T x|, as D is bounded; and the bound is not absurd."""
    design, code, found = made("parameters", apart=apart)
    random = np.random.default_rng(1)
    worst = 0.0
    for _ in range(300):
        share = random.integers(0, 2**12, size=2) / 2**12  # exact in float32, and 1 - share too
        alpha = np.kron([1 - share[0], share[0]], [1 - share[1], share[1]])
        x = random.normal(size=5) * 10.0 ** random.uniform(-3, 1, size=5)
        if random.random() < 0.5:  # where T x is short beside |T| |x|
            x = np.linalg.solve(code.T, random.normal(size=5))
        x = x.astype(np.float32).astype(float)
        u = single(code, alpha, x.astype(np.float32))
        exact = design.law.gain(alpha) @ x
        worst = max(worst, float(np.abs(u - exact).max() / np.linalg.norm(code.T @ x)))
    assert worst < found.rounding
    assert worst > found.rounding / 1000


@pytest.mark.parametrize("case", ["parameters", "alpha", "degree 2", "box by alpha"])
def test_a_part_of_the_gain_apart_is_the_same_law_and_rounds_less(case):
    _, _, whole = made(case)
    _, code, found = made(case, apart=True)
    assert found.proved
    assert found.check().proved
    assert found.rounding < whole.rounding
    claim = found.claim
    other = [[value * 2 for value in row] for row in claim.code.L]
    for L in (None, other):  # the code's Z is then not the law's beside it
        assert not prove(replace(claim, code=replace(claim.code, L=L))).proved
    wide = [[*row, Fraction(0)] for row in claim.code.L]
    with pytest.raises(FormatError, match=r"code\.L"):
        replace(claim, code=replace(claim.code, L=wide)).require()
    assert np.array_equal(np.array(claim.code.L, dtype=float), code.L)


def test_the_bound_grows_with_what_it_is_made_of():
    """Each constant that is off, by more than its own rounding, is seen."""
    _, _, found = made("parameters")
    claim = found.claim
    base = rounding_error(claim)
    off = Fraction(1, 1000)

    def changed(**parts):
        return rounding_error(replace(claim, code=replace(claim.code, **parts)))

    def nudged(matrices):
        first = [list(row) for row in matrices[0]]
        first[0][0] += off
        return (first, *matrices[1:])

    code = claim.code
    assert changed(W=nudged(code.W)) > base
    assert changed(Z=nudged(code.Z)) > base
    # the constants stay those of float32, the operations are finer
    assert changed(bits=64) < base / 2
    wide = replace(code.shares[0], low=code.shares[0].low - 1)
    assert changed(shares=(wide, *code.shares[1:])) > base
    steep = replace(code.shares[1], scale=code.shares[1].scale * (1 + off))
    assert changed(shares=(code.shares[0], steep)) > base


def faults():
    """One fault at a time."""
    half = Fraction(1, 2)

    def of_code(**parts):
        return lambda c: replace(c, code=replace(c.code, **parts(c.code)))

    yield "gain error", lambda c: replace(c, gain=replace(c.gain, error=c.gain.error / 10**4))
    yield "no error", lambda c: replace(c, gain=replace(c.gain, error=Fraction(0)))
    yield "gain too large", lambda c: replace(c, gain=replace(c.gain, error=c.gain.error * 10**3))
    yield "smallest", lambda c: replace(c, smallest=c.smallest * 2)
    yield "size", lambda c: replace(c, size=c.size * half)
    yield "W", lambda c: replace(c, code=replace(c.code, W=c.code.W[1:] + c.code.W[:1]))
    yield "Z", lambda c: replace(c, code=replace(c.code, Z=c.code.Z[1:] + c.code.Z[:1]))
    yield (
        "scale",
        lambda c: replace(
            c, code=replace(c.code, shares=(replace(c.code.shares[0], scale=half),) * 2)
        ),
    )


@pytest.mark.parametrize("fault", dict(faults()))
def test_a_fault_is_not_proved(fault):
    _, _, found = made("parameters")
    assert not prove(dict(faults())[fault](found.claim)).proved


def malformed():
    def with_code(**parts):
        return lambda c: replace(c, code=replace(c.code, **parts))

    yield "bits", with_code(bits=16)
    yield "no T", with_code(T=None)
    yield "K besides", with_code(K=[[Fraction(1)] * 5])
    yield "a W missing", lambda c: replace(c, code=replace(c.code, W=c.code.W[1:]))
    yield "a share missing", lambda c: replace(c, code=replace(c.code, shares=c.code.shares[1:]))
    yield "other columns", lambda c: replace(c, gain=replace(c.gain, columns=(Fraction(1),) * 5))
    yield "bits no number", with_code(bits=[])

    def scaled(power):
        """Numbers that no float32 arithmetic survives, but that fit together."""

        def change(c):
            by, code = Fraction(2) ** power, c.code

            def times(f, matrix):
                return [[f * v for v in row] for row in matrix]

            return replace(
                c,
                gain=replace(
                    c.gain,
                    columns=tuple(tuple(v * by for v in row) for row in c.gain.columns),
                    error=c.gain.error / by,
                ),
                code=replace(
                    code,
                    T=times(by, code.T),
                    W=tuple(times(by**2, w) for w in code.W),
                    Z=tuple(times(by, z) for z in code.Z),
                ),
                smallest=c.smallest * by**2,
                size=c.size / by,
            )

        return change

    yield "underflow", scaled(-70)
    yield "overflow", scaled(70)
    yield (
        "no float32",
        lambda c: replace(
            c,
            code=replace(
                c.code,
                Z=tuple([[v * (1 + Fraction(1, 2**26)) for v in r] for r in z] for z in c.code.Z),
            ),
        ),
    )
    yield "negative bound", lambda c: replace(c, smallest=Fraction(-1))
    yield "elevation", lambda c: replace(c, elevation=99)
    yield (
        "W not symmetric",
        lambda c: replace(
            c,
            code=replace(
                c.code,
                W=([[w + (i < j) for j, w in enumerate(r)] for i, r in enumerate(c.code.W[0])],)
                + c.code.W[1:],
            ),
        ),
    )


@pytest.mark.parametrize("fault", dict(malformed()))
def test_what_does_not_fit_together_is_refused(fault):
    _, _, found = made("parameters")
    with pytest.raises(FormatError):
        prove(dict(malformed())[fault](found.claim))


def test_an_error_a_trifle_too_small_is_not_proved():
    """Decided in rationals: in floats their quotient is one."""
    _, _, found = made("parameters")
    error = rounding_error(found.claim)
    for share, proved in ((1, True), (1 - Fraction(1, 2**70), False)):
        gain = replace(found.claim.gain, error=error * share)
        assert prove(replace(found.claim, gain=gain)).proved is proved


def test_a_small_file_cannot_ask_for_hours():
    many = [[[Fraction(-1)]]] * 16

    one = [[Fraction(1)]]
    law = Law(W=[one] * 16, Z=[one] * 16, degree=1)
    disk = regions.Disk(Fraction(-3), Fraction(2))
    design = Poles("scheduled", many, [one] * 16, (disk,), law, (Evidence([]),))
    gain = GainError(
        Subject(design), Fraction(1, 10), (Fraction(1),), ((Fraction(1),),), (Fraction(1),)
    )
    code = Constants(32, None, one, (one,) * 16, (one,) * 16)
    with pytest.raises(FormatError, match="too many, or too large"):
        prove(Rounded(gain, code, Fraction(1, 2), Fraction(2), 16))


def test_a_share_clamped_inside_its_interval_is_not_proved():
    _, _, found = made("parameters")
    code = found.claim.code
    inside = replace(code.shares[0], low=code.shares[0].low + 1)
    claim = replace(found.claim, code=replace(code, shares=(inside, code.shares[1])))
    assert "clamped inside" in prove(claim).reason


def test_too_little_margin_is_refused_for_float32_and_proved_for_float64():
    """The smallest disk, a little enlarged: its margin is below the rounding of float32 alone."""
    design = place(family("quarter-car-physical"), Disk(-40, 29.08), "scheduled")
    parameters = design.plant.parameters
    narrow = guarantee(design, program(design.law, parameters, number(32)))
    wide = guarantee(design, program(design.law, parameters, number(64)))
    assert not narrow.proved
    assert narrow.rounding > narrow.tolerated
    assert "export with --float 64" in narrow.reason
    assert wide.proved


def test_code_of_a_law_that_is_zero():
    """K = 0 is a law as well; an open loop that is stable."""
    from polefence import FixedGain, UncertainPlant, analyse

    plant = UncertainPlant.from_vertices([[[-2.0]], [[-3.0]]], [[[1.0]], [[1.0]]])
    design = analyse(plant, FixedGain(np.zeros((1, 1))), Disk(-3, 2)).design
    assert guarantee(design, program(design.law, (), number(32))).proved


def test_scales_are_those_of_the_claim():
    design, code, found = made("parameters")
    assert isinstance(code, Code)
    rows, columns = scales(code, design.law)
    assert found.claim.gain.columns == columns
    assert [list(map(float, row)) for row in columns] == code.T.tolist()
    assert list(map(float, found.claim.gain.rows)) == rows.tolist()
    assert code_of(code, design.plant) == found.claim.code
