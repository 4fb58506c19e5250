"""Bounds by the transfer function: Lyapunov equations, frequency sweeps, one fault each."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import scipy.linalg

from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.polynomial import Domain
from polefence.proof import claims
from polefence.proof.bands import Band
from polefence.proof.claims.base import prove
from polefence.proof.laws import Evidence, Law
from polefence.proof.plant import Output
from polefence.proof.polynomials import constant, form
from polefence.proof.remainder import Remainder
from polefence.proof.transfer import (
    Tensor,
    _degrees,
    _exponent,
    _value,
    gain_polynomial,
    positive,
    to_bernstein,
    transfer,
)
from polefence.proof.work import FormatError, counted

BY = Evidence([], transfer=True)
CLOSE = 1e-5  # around the worst value, as a share: proved above it and not below
SIZES = ((2, 1, 1), (5, 2, 1), (4, 1, 3), (3, 2, 2))  # states, outputs, disturbances


def rationals(M):
    return [[Fraction(x) for x in row] for row in np.asarray(M).tolist()]


class Family:
    """A random stable loop, whose rows depend on two parameters, and E, C and F besides."""

    def __init__(self, n, p, q, seed, step=0.0, through=False, scheduled=False):
        self.random, self.step = np.random.default_rng(seed), step
        draw = self.random.standard_normal
        A = draw((n, n)) / 2 - 1.5 * np.eye(n)
        rows = self.random.permutation(n)[:2]
        self.A, self.E, self.C, self.F, self.B = [], [], [], [], draw((n, 1))
        E, C, F = draw((n, q)), draw((p, n)), draw((p, q)) / 4 * through
        for one, other in product((-1, 1), repeat=2):
            own = A.copy()
            own[rows[0]] *= 1 + 0.2 * one
            own[rows[-1], 0] += 0.3 * other
            self.A.append(own)
            self.E.append(E * (1 + 0.5 * one))
            self.C.append(C * (1 + 0.1 * other + 0.5 * one))
            self.F.append(F * (1 + 0.3 * one))
        domain, count = Domain.of("box", 4), 4
        if scheduled:
            W = [np.eye(n) + 0.1 * (M + M.T) for M in draw((count, n, n)) / n]
            self.given = ScheduledGain(np.array(W), draw((count, 1, n)) / 9, domain)
        else:
            self.given = FixedGain(draw((1, n)) / 9)
        self.law: Law = self.given.exact

    def at(self, u, v):
        """A + B K, E, C and F at coordinates from 0 to 1."""
        w = [(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v]
        A, E, C, F = (np.tensordot(w, M, 1) for M in (self.A, self.E, self.C, self.F))
        return A + self.B @ self.given.gain(np.array([w]))[0], E, C, F

    def subject(self, evidence=BY):
        A, E = ([rationals(M) for M in own] for own in (self.A, self.E))
        B = [rationals(self.B)] * 4
        return claims.Subject(A, B, E, self.law, evidence, "box", Fraction(self.step))

    def outputs(self, direct=True):
        found = []
        for i in range(len(self.C[0])):
            C, F = ([rationals(M[i : i + 1]) for M in own] for own in (self.C, self.F))
            F = tuple(F) if direct and np.any(self.F) else ()
            found.append(Output(C, [[[Fraction(0)]]] * 4, f"y{i}", F))
        return tuple(found)

    def grid(self, value, turns=5):
        """The largest value on a grid that closes in on the worst point."""
        centre, width, best = np.array([0.5, 0.5]), 0.5, 0.0
        for _ in range(turns):
            axes = [np.clip(np.linspace(c - width, c + width, 7), 0, 1) for c in centre]
            each = {t: value(*self.at(*t)) for t in product(*axes)}
            centre = np.array(max(each, key=each.__getitem__))
            best, width = max(best, *each.values()), width / 4
        return best


def of_noise(step):
    """The variance, by SciPy's equations."""

    def value(A, E, C, _):
        if step:
            whole = np.eye(len(A)) + step * A
            X = scipy.linalg.solve_discrete_lyapunov(whole, step * E @ E.T)
        else:
            X = scipy.linalg.solve_continuous_lyapunov(A, -E @ E.T)
        return np.sqrt(np.trace(C @ X @ C.T))

    return value


def of_frequency(step, band=None):
    """The peak of the largest singular value, by a sweep that closes in; in a band [Hz] there."""

    def value(A, E, C, F):
        def height(w):
            z = (np.exp(1j * w * step) - 1) / step if step else 1j * w
            s = z[:, None, None] * np.eye(len(A))
            x = np.linalg.solve(s - A, np.broadcast_to(E, (len(w), *E.shape)))
            return np.linalg.norm(C @ x + F, 2, axis=(1, 2))

        low, high = 0.0, np.pi / step if step else 100.0
        if band is not None:
            low, high = (2 * np.pi * f for f in band)
        for _ in range(7):
            w = np.linspace(low, high, 150)
            k = height(w).argmax()
            low, high = w[max(k - 1, 0)], w[min(k + 1, 149)]
        return max(height(w).max(), np.linalg.norm(F, 2) if not step and band is None else 0.0)

    return value


@pytest.mark.parametrize("step", [0.0, 0.125])
@pytest.mark.parametrize(
    ("sizes", "scheduled"), [*((each, False) for each in SIZES), (SIZES[0], True)]
)
def test_the_rms_is_proved_just_above_the_worst_and_not_below(sizes, scheduled, step):
    own = Family(*sizes, 7, step, scheduled=scheduled)
    worst = own.grid(of_noise(step))
    claim = claims.Rms(own.subject(), own.outputs(), Fraction(worst * (1 + CLOSE)))
    assert prove(claim).proved
    assert not prove(replace(claim, level=Fraction(worst * (1 - CLOSE)))).proved
    assert not prove(replace(claim, intensity=Fraction(1 + 3 * CLOSE))).proved


@pytest.mark.parametrize("step", [0.0, 0.125])
@pytest.mark.parametrize(
    ("sizes", "through", "scheduled"),
    [*((each, way, False) for each in SIZES for way in (False, True)), (SIZES[0], False, True)],
)
def test_the_gain_is_proved_just_above_the_worst_and_not_below(sizes, through, scheduled, step):
    own = Family(*sizes, 3, step, through, scheduled)
    worst = own.grid(of_frequency(step))
    claim = claims.Gain(own.subject(), own.outputs(), Fraction(worst * (1 + CLOSE)))
    assert prove(claim).proved
    assert not prove(replace(claim, level=Fraction(worst * (1 - CLOSE)))).proved


BANDS = ((Fraction(1, 2), Fraction(1)), (Fraction(0), Fraction(1, 8)), (Fraction(2), Fraction(4)))


@pytest.mark.parametrize("step", [0.0, 0.125])
@pytest.mark.parametrize("ends", BANDS)
@pytest.mark.parametrize(("sizes", "through"), [(SIZES[0], True), *((x, False) for x in SIZES)])
def test_the_gain_in_a_band_is_proved_just_above_its_worst_and_not_below(
    sizes, through, ends, step
):
    own = Family(*sizes, 3, step, through)
    worst, whole = own.grid(of_frequency(step, ends)), own.grid(of_frequency(step), 2)
    levels = [Fraction(worst * (1 + share)) for share in (CLOSE, -CLOSE)]
    claim = claims.Gain(own.subject(), own.outputs(), levels[0], band=Band(*ends))
    assert prove(claim).proved
    assert not prove(replace(claim, level=levels[1])).proved
    if whole > worst * (1 + 1e-3):  # elsewhere it is more: the band counts
        assert not prove(replace(claim, band=None)).proved
        whole_band = Band(Fraction(0), Fraction(1, 2) / Fraction(step) if step else Fraction(1000))
        assert not prove(replace(claim, band=whole_band)).proved
    else:
        assert not ends[0] or through


def test_the_gain_in_a_band_is_less_than_elsewhere_in_most_of_these():
    own = Family(*SIZES[0], 3)
    for ends in BANDS[::2]:
        assert own.grid(of_frequency(0.0, ends), 2) < 0.9 * own.grid(of_frequency(0.0), 2)


@pytest.mark.parametrize("step", [Fraction(0), Fraction(1, 100)])
@pytest.mark.parametrize("f", [Fraction(0), Fraction(1, 10), Fraction(4), Fraction(4999, 100)])
def test_ends_of_a_band_enclose_it_and_are_within_it(f, step):
    band = Band(f, Fraction(50))
    outer, inner = band.outside(step), band.inside(step)
    turns = [math.pi * float(x) for x in (f, 50)]
    low, high = (2 * math.tan(x * float(step)) / float(step) if step else 2 * x for x in turns)
    assert outer[0] <= inner[0]
    assert inner[0] - outer[0] <= Fraction(1, 2**44) * inner[0]
    assert float(outer[0]) == pytest.approx(low, rel=1e-12)
    if step:
        assert outer[1] is inner[1] is None  # half the sample rate
    else:
        assert inner[1] < outer[1]
        assert float(outer[1]) == pytest.approx(high, rel=1e-12)
        assert (
            outer[1] ** 2
            > (100 * Fraction(314159265358979, 10**14)) ** 2
            > inner[1] ** 2 * (1 - Fraction(1, 10**13))
        )


def test_scales_of_disturbances_count():
    own = Family(3, 1, 2, 11)
    scales = (Fraction(3), Fraction(0))
    worst = own.grid(lambda A, E, C, F: of_noise(0.0)(A, 3 * E[:, :1], C, F))
    claim = claims.Rms(own.subject(), own.outputs(), Fraction(worst * (1 + CLOSE)), scales=scales)
    assert prove(claim).proved
    assert not prove(replace(claim, level=Fraction(worst * (1 - CLOSE)))).proved


def test_a_ratio_is_that_of_both_loops():
    own = Family(4, 1, 1, 5)

    def ratio(A, E, C, F):
        u = np.linalg.lstsq(own.B, A - self_without(A), rcond=None)[0]
        assert np.all(np.isfinite(u))
        return of_noise(0.0)(A, E, C, F) / of_noise(0.0)(self_without(A), E, C, F)

    def self_without(A):
        return A - own.B @ own.given.K

    worst = own.grid(ratio)
    subject, outputs = own.subject(), own.outputs()
    base = claims.baseline_loop(subject, outputs[0], None, tuple(range(4)))
    none = Evidence([])
    claim = claims.RelativeRms(
        subject, outputs, Fraction(worst * (1 + CLOSE)), claims.Baseline(*base, none, none)
    )
    assert prove(claim).proved
    assert not prove(replace(claim, level=Fraction(worst * (1 - CLOSE)))).proved


# --- stability is a part of the claim ------------------------------------------------------------


def crossing(low, high):
    """x1' of a damping that is -1 + t (low + high (1 - t)): a parabola in two equal parameters."""
    A = [[[Fraction(-1)]], [[Fraction(low)]], [[Fraction(low)]], [[Fraction(-1)]]]
    one = [[[Fraction(1)]]] * 4
    return claims.Subject(A, one, one, Law([[[Fraction(0)]]]), BY, "box")


@pytest.mark.parametrize("kind", [claims.Rms, claims.Gain])
def test_a_loop_that_is_stable_at_the_first_vertex_alone_is_not_proved(kind):
    y = (Output([[[Fraction(1)]]] * 4, [[[Fraction(0)]]] * 4, "y"),)
    assert prove(kind(crossing(Fraction(-1, 2), 0), y, Fraction(10**9))).proved
    for unstable in (0, Fraction(1, 2)):
        assert not prove(kind(crossing(unstable, 0), y, Fraction(10**9))).proved


@pytest.mark.parametrize("kind", [claims.Rms, claims.Gain])
def test_an_unstable_loop_is_not_proved_though_nothing_crosses_the_axis(kind):
    one = [[[Fraction(1)]]]
    y = (Output(one, [[[Fraction(0)]]], "y"),)
    subject = claims.Subject(one, one, one, Law([[[Fraction(0)]]]), BY)
    assert not prove(kind(subject, y, Fraction(10**9))).proved


@pytest.mark.parametrize("pole", [0, 1])
@pytest.mark.parametrize("kind", [claims.Rms, claims.Gain])
def test_a_pole_that_the_output_does_not_show_counts(kind, pole):
    A = [rationals([[-1, 0], [0, pole]])]
    subject = claims.Subject(A, [rationals([[0], [0]])], [rationals([[1], [0]])],
                             Law([rationals([[0, 0]])]), BY)  # fmt: skip
    y = (Output([rationals([[1, 0]])], [[[Fraction(0)]]], "y"),)
    assert not prove(kind(subject, y, Fraction(10))).proved
    better = replace(subject, A=[rationals([[-1, 0], [0, -1]])])
    assert prove(kind(better, y, Fraction(10))).proved


def test_what_passes_straight_through_counts_where_two_disturbances_would_hide_it():
    """Both singular values above the level: the determinant is positive, the gain is not proved."""
    A, F = [rationals([[-1]])], [rationals([[3, 0]]), rationals([[0, 3]])]
    subject = claims.Subject(A, [rationals([[0]])], [rationals([[0, 0]])],
                             Law([rationals([[0]])]), BY)  # fmt: skip
    none = [[[Fraction(0)]]]
    y = tuple(Output(none, none, f"y{k}", (row,)) for k, row in enumerate(F))
    assert not prove(claims.Gain(subject, y, Fraction(2))).proved
    assert prove(claims.Gain(subject, y, Fraction(4))).proved


ANYWHERE = Band(Fraction(1, 10), Fraction(2, 10))


def test_in_a_band_poles_count_that_are_elsewhere():
    y = (Output([[[Fraction(1)]]] * 4, [[[Fraction(0)]]] * 4, "y"),)
    for unstable, proved in ((Fraction(-1, 2), True), (0, False), (Fraction(1, 2), False)):
        claim = claims.Gain(crossing(unstable, 0), y, Fraction(10**9), band=ANYWHERE)
        assert prove(claim).proved is proved
    one = [[[Fraction(1)]]]
    subject = claims.Subject(one, one, one, Law([[[Fraction(0)]]]), BY)
    y = (Output(one, [[[Fraction(0)]]], "y"),)
    assert not prove(claims.Gain(subject, y, Fraction(10**9), band=ANYWHERE)).proved


@pytest.mark.parametrize("f", [0, 1])
def test_in_a_band_two_singular_values_above_the_level_are_not_hidden(f):
    """The determinant is positive in all of the band; at infinity both are zero."""
    A = [rationals([[-1, 0], [0, -1]])]
    law = Law([rationals([[0, 0]])])
    subject = claims.Subject(A, [rationals([[0], [0]])], [rationals([[9, 0], [0, 9]])], law, BY)
    y = tuple(Output([rationals([row])], [[[Fraction(0)]]], "y") for row in ([1, 0], [0, 1]))
    band = Band(Fraction(f), Fraction(f) + Fraction(1, 10))
    most = 9 / math.hypot(1, 2 * math.pi * f)
    for share, proved in ((0.5, False), (1 - CLOSE, False), (1 + CLOSE, True)):
        claim = claims.Gain(subject, y, Fraction(most * share), band=band)
        assert prove(claim).proved is proved


def test_a_band_that_does_not_fit_is_refused():
    own = Family(2, 1, 1, 2, 0.125)
    claim = claims.Gain(own.subject(), own.outputs(), Fraction(100), band=ANYWHERE)
    by_matrix = own.subject(Evidence([rationals(np.eye(2))]))
    with pytest.raises(FormatError, match="band: a gain in a band is proved by the transfer"):
        prove(replace(claim, subject=by_matrix))
    with pytest.raises(FormatError, match="no frequency above"):
        prove(replace(claim, band=Band(Fraction(1), Fraction(401, 100))))
    for ends in ((1, 1), (2, 1), (-1, 1), (1,), (1, 10**10)):
        with pytest.raises(FormatError, match="band must hold two numbers"):
            Band.of(tuple(map(Fraction, ends)))


def varying(E, C, F):
    """x' = -x + E(t) w, y = C(t) x + F(t) w of two equal channels, at both ends of t."""
    zero, two = Fraction(0), range(2)

    def scaled(e):
        return [[Fraction(e) * (i == j) for j in two] for i in two]

    A = [scaled(-1)] * 2
    law = Law([[[zero] * 2]])
    subject = claims.Subject(A, [[[zero], [zero]]] * 2, [scaled(e) for e in E], law, BY, "box")
    rows = [
        Output(
            [[scaled(c)[i]] for c in C], [[[zero]]] * 2, f"y{i}", tuple([scaled(f)[i]] for f in F)
        )
        for i in two
    ]
    return subject, tuple(rows)


@pytest.mark.parametrize(
    ("E", "C", "F", "gain"),
    [
        ((1, 1), (0, 0), ("1/10", "14/10"), "14/10"),
        (("3/10", "6/10"), (2, "3/10"), (0, 0), "603969/1000000"),  # the worst is between nodes
        (("3/2", 1), ("1/2", "9/10"), (0, 0), "903125/1000000"),
    ],
)
def test_several_channels_that_vary_alike_have_the_degree_of_all_their_minors(E, C, F, gain):
    subject, outputs = varying(E, C, F)
    worst = Fraction(gain)
    for share, proved in ((-3, False), (-1, False), (1, True)):
        level = worst * (1 + Fraction(share, 10**4))
        assert prove(claims.Gain(subject, outputs, level)).proved is proved


@pytest.mark.parametrize("seed", range(6))
def test_the_polynomial_of_a_gain_is_the_determinant(seed):
    """At a point of s and t that is no node, from a determinant of its own."""
    own = Family(2, 2, 2, seed, through=bool(seed % 2), scheduled=seed % 3 == 2)
    claim = claims.Gain(own.subject(), own.outputs(), Fraction(3, 2))
    found = gain_polynomial(claim.transfer(), claim.level)
    each = []
    for u, v, w in ((0.3, 0.8, 0.7), (0.55, 0.15, 2.0)):
        A, E, C, F = own.at(u, v)
        G = C @ np.linalg.solve(1j * w * np.eye(2) - A, E) + F
        W = np.eye(2)
        if own.law.W is not None:
            W = sum(
                x * np.array(M, dtype=float)
                for x, M in zip(
                    [(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v], own.law.W, strict=True
                )
            )
        a = np.linalg.det(W) * np.linalg.det(1j * w * np.eye(2) - A)
        wanted = np.linalg.det(2.25 * np.eye(2) - G.conj().T @ G).real * abs(a) ** 2
        x = (Fraction(w) * claim.transfer().unit) ** 2
        e = _exponent(claim.transfer().first[0])
        z = float(x / (x + Fraction(4) ** e))
        largest = max(map(abs, found.values))
        value = np.array([float(Fraction(c, largest)) for c in found.values])
        value = value.reshape(found.shape)
        for t in (z, u, v):
            d = value.shape[0] - 1
            basis = [math.comb(d, k) * t**k * (1 - t) ** (d - k) for k in range(d + 1)]
            value = np.tensordot(basis, value, 1)
        each.append(wanted * (1 - z) ** 2 / value)
    assert each[0] == pytest.approx(each[1], rel=1e-9)


@pytest.mark.parametrize("step", [0, Fraction(1, 4)])
def test_a_law_whose_w_is_negative_is_proved_as_one_whose_w_is_positive(step):
    """K = Z W^-1 does not change; the sign of a(s) does, where the number of poles is odd."""
    one, zero = [[Fraction(1)]], [[Fraction(0)]]
    answers = []
    for sign in (1, -1):
        law = Law(None, [[[Fraction(sign)]], [[Fraction(2 * sign)]]], [zero, zero], 1)
        subject = claims.Subject([[[Fraction(-1)]]] * 2, [zero] * 2, [one] * 2, law, BY, "box",
                                 Fraction(step))  # fmt: skip
        y = (Output([one] * 2, [zero] * 2, "y"),)
        variance = 1 / (2 - Fraction(step))
        levels = [Fraction(float(variance) ** 0.5 * (1 + share)) for share in (CLOSE, -CLOSE)]
        answers.append([prove(claims.Rms(subject, y, level)).proved for level in levels])
    assert answers == [[True, False]] * 2


# --- what is refused -----------------------------------------------------------------------------


def test_evidence_beside_it_a_remainder_and_other_kinds_are_refused():
    own = Family(3, 1, 1, 2)
    claim = claims.Rms(own.subject(), own.outputs(), Fraction(100))
    assert prove(claim).proved
    eye = rationals(np.eye(3))
    for evidence in (replace(BY, X=[eye]), replace(BY, elevation=1), replace(BY, dual=True)):
        with pytest.raises(FormatError):
            prove(replace(claim, subject=replace(claim.subject, evidence=evidence)))
    with pytest.raises(FormatError, match="remainder"):
        entries = rationals(np.full((3, 5), 1e-9))
        remainder = Remainder(tuple(map(tuple, entries)))
        prove(replace(claim, subject=replace(claim.subject, remainder=remainder)))
    peak = claims.EnergyPeak(own.subject(), own.outputs(), Fraction(100))
    with pytest.raises(FormatError, match="transfer"):
        prove(peak)


def test_a_simplex_of_three_is_refused():
    own = Family(2, 1, 1, 2)
    subject = replace(own.subject(), A=own.subject().A[:3], B=own.subject().B[:3],
                      E=own.subject().E[:3], on="simplex")  # fmt: skip
    y = own.outputs()[0]
    three = replace(y, C=y.C[:3], D=y.D[:3])
    with pytest.raises(FormatError, match="box"):
        prove(claims.Rms(subject, (three,), Fraction(100)))


def test_work_is_bounded():
    own = Family(5, 2, 1, 2)
    claim = claims.Rms(own.subject(), own.outputs(), Fraction(100))
    with pytest.raises(FormatError), counted(10**5):
        prove(claim)


# --- positive on a box ---------------------------------------------------------------------------


def coefficients(values, shape):
    found = Tensor.of([Fraction(v) for v in values], shape)
    for axis, size in enumerate(shape):
        found = found.along(axis, to_bernstein(size - 1))
    return found


@pytest.mark.parametrize("room", [Fraction(1, 10**6), Fraction(0), Fraction(-1, 10**6)])
def test_a_parabola_that_just_touches_zero(room):
    """(x - 1/3)^2 + (y - x)^2 + room, of which the least value is between all corners."""
    nodes = [Fraction(0), Fraction(1, 2), Fraction(1)]
    values = [(x - Fraction(1, 3)) ** 2 + (y - x) ** 2 + room for x in nodes for y in nodes]
    own = coefficients(values, (3, 3))
    if room > 0:
        found = positive(own)
        assert found.proved
        assert found.parts > 1
        return
    try:
        with counted(10**8):
            assert not positive(own).proved
    except FormatError:
        assert room == 0  # never decided: halving does not meet a third


def test_coefficients_cut_to_fewer_bits_prove_no_more():
    own = coefficients([Fraction(10) ** 200, Fraction(-1), Fraction(10) ** 200], (3,))
    assert not positive(own).proved


def test_ill_conditioned_coordinates_change_nothing():
    """States mixed by a matrix of condition 1e8: the gain is proved to the same digits."""
    own = Family(4, 1, 1, 9)
    worst = own.grid(of_frequency(0.0))
    T = np.diag([1.0, 1e-3, 1e-6, 1e-8]) + np.triu(np.ones((4, 4)), 1)
    exact = [rationals(M) for M in (T, np.linalg.inv(T))]
    mixed = own.subject()
    from polefence.proof.matrices import inverse
    from polefence.proof.matrices import product as times

    back = inverse(exact[0], "T")
    A = [times(times(back, M), exact[0]) for M in mixed.A]
    B = [times(back, M) for M in mixed.B]
    E = [times(back, M) for M in mixed.E]
    K = [times(M, exact[0]) for M in mixed.law.K]
    y = own.outputs()[0]
    C = [times(M, exact[0]) for M in y.C]
    subject = replace(mixed, A=A, B=B, E=E, law=replace(mixed.law, K=K))
    claim = claims.Gain(subject, (replace(y, C=C),), Fraction(worst * (1 + CLOSE)))
    assert prove(claim).proved
    assert not prove(replace(claim, level=Fraction(worst * (1 - CLOSE)))).proved


# --- degrees -------------------------------------------------------------------------------------


def drawn(random, shape, ranks, sizes):
    """A polynomial on a box: the coefficient of t^k of a parameter has rank ranks[axis][k - 1]."""
    total = constant(rationals(random.integers(-5, 6, shape)), sizes)
    for axis, each in enumerate(ranks):
        t = form(axis, (0, 1), sizes)
        for k, rank in enumerate(each, 1):
            M = random.integers(-3, 4, (shape[0], rank)) @ random.integers(-3, 4, (rank, shape[1]))
            own = constant(rationals(M), sizes)
            for _ in range(k):
                own = t * own
            total = total + own
    return total


@pytest.mark.parametrize("seed", range(6))
def test_degrees_are_bounded_by_the_ranks_of_coefficients(seed):
    """The bound is what values on a finer grid show: never below it, and here as a rule equal."""
    random, sizes = np.random.default_rng(seed), (2, 2)
    n, p, q = 4, 1 + seed % 2, 1 + seed // 3
    ranks = [((1,), (2, 1)), ((1, 1), (0, 1)), ((2,), (1,))][seed % 3]
    N = drawn(random, (n, n), ranks, sizes)
    Y, E = drawn(random, (p, n), [(), ()], sizes), drawn(random, (n, q), [(), ()], sizes)
    W = constant(rationals(np.eye(n)), sizes)
    bound = _degrees(W, N, Y, E, None)
    assert bound == tuple(sum(sum(each[k:]) for k in range(len(each))) for each in ranks)
    own = transfer(W, N, Y, E, None)
    assert own.degrees == bound
    # exactly what the matrices give at a point that is no node
    t = Fraction(3, 7), Fraction(5, 11)
    value, whole = _value(N, t)
    A = np.array([[Fraction(x, whole) for x in row] for row in value], dtype=float)
    a = [float(x) for x in own.inside(t).first[0]]
    unit = [float(own.unit) ** k for k in range(n + 1)]
    poly = np.poly(A)
    assert np.allclose(np.array(a) / unit / a[0], poly, rtol=1e-9, atol=1e-9)


def test_what_is_too_much_is_refused_before_it_is_computed():
    """Eleven states and degree 18: a variance has degree 198 in the parameter."""
    random, sizes = np.random.default_rng(1), (2,)
    W = constant(rationals(np.eye(10)), sizes)
    N = drawn(random, (10, 10), ((9, 9),), sizes)
    Y, E = drawn(random, (1, 10), [()], sizes), drawn(random, (10, 1), [()], sizes)
    with counted() as count, pytest.raises(FormatError, match="too many coefficients"):
        transfer(W, N, Y, E, None, 11)
    spent = count.spent
    with counted() as count:
        transfer(W, N, Y, E, None)
    assert spent < count.spent / 4
