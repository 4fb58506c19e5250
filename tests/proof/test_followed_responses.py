"""Claims about responses: each false one that an omission in the verifier would let through."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.certify.followed import BITS, TERMS, Floats, short
from polefence.plant.outputs import Output
from polefence.proof.claims.base import prove
from polefence.proof.claims.followed import Following
from polefence.proof.claims.measured import Envelope
from polefence.proof.laws import Evidence
from polefence.proof.matrices import identity
from polefence.proof.work import FormatError
from polefence.requirements.specification import claim_of

# y'' + 1.8 y' + k y = k w: of k = 9 it overshoots by 37 % at 1.1 s, and is within 5 % from 2.9 s on
T = np.arange(0, 12, 1e-3)


def plant_of(spread, zero, sign):
    """k = 9 (1 + spread p), |p| <= 1, and y = x1 + zero x2, or less that."""
    p = pf.Parameter("p", -1, 1)
    k = f"9*(1 + {spread}*p)"
    plant = pf.UncertainPlant.from_expressions(
        [p], [[0, 1], [f"-{k}", -1.8]], [[0], [1]], E=[[0], [9]]
    )
    return plant, Output("y", "", C=[sign, sign * zero])


def response(kind, p=0.0, spread=0.0, zero=0.0):
    """y at times T of one plant, by its modes."""
    A, e = np.array([[0, 1], [-9 * (1 + spread * p), -1.8]]), np.array([0, 9.0])
    x0, end = {
        "step": (np.linalg.solve(A, e), -np.linalg.solve(A, e)),
        "impulse": (e, 0 * e),
        "initial": (np.array([1.0, 0]), 0 * e),
    }[kind]
    poles, V = np.linalg.eig(A)
    terms = np.exp(np.outer(T, poles)) * np.linalg.solve(V, x0 + 0j)
    return np.array([1, zero]) @ ((terms @ V.T).real + end).T


class Made:
    """Claims of one plant with evidence that errors fade, and steps as they are asked for."""

    def __init__(self, kind, spread=1e-4, zero=0.0, sign=1, known=None):
        plant, y = known or plant_of(spread, zero, sign)
        n = plant.shape[0]
        asked = {
            "step": pf.StepMeasure(y, 1.0),
            "impulse": pf.ImpulseMeasure(y, 1.0),
            "initial": pf.InitialMeasure(y, 1.0, start={"x1": 1.0}),
        }[kind]
        law, blank = pf.FixedGain([[0.0] * n]), Evidence([identity(n)])
        claim = claim_of(plant, law.exact, "box", asked, blank, Fraction(1))
        evidence, rate, reach = next(Floats.of(claim).fading())
        self.claim = replace(claim, subject=replace(claim.subject, evidence=evidence))
        self.own = {"bits": BITS + 14, "rate": short(rate), "reach": short(reach)}

    def of(self, measure, level, lengths, degree=4, unit="1/10", **own):
        following = Following(Fraction(unit), lengths, TERMS, degree, **self.own)
        own = {key: value if key == "envelope" else Fraction(value) for key, value in own.items()}
        return replace(
            self.claim, measure=measure, level=Fraction(level), following=(following,), **own
        )

    def proved(self, *words, **own):
        try:
            return prove(self.of(*words, **own)).proved
        except FormatError:
            return False


def envelope(*points):
    return Envelope(tuple((Fraction(t), Fraction(a), Fraction(b)) for t, a, b in points))


LONG = ((1, 80),)
STEP, PEAK = response("step"), float(response("step").max())


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("kind", ["step", "impulse", "initial"])
def test_a_peak_of_either_sign_is_bracketed(kind, sign):
    made, most = Made(kind, sign=sign), float(np.abs(response(kind)).max())
    assert made.proved("peak", most * 1.01, LONG)
    assert not made.proved("peak", most * 0.99, LONG)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_final_value_of_either_sign_is_bracketed(sign):
    made = Made("step", sign=sign)
    assert made.proved("final", "1.01", LONG)
    assert not made.proved("final", "0.99", LONG)


@pytest.mark.parametrize("sign", [1, -1])
def test_shares_of_a_final_value_are_bracketed(sign):
    made, behind = Made("step", sign=sign), Made("step", zero=-0.4, sign=sign)
    under = float(-response("step", zero=-0.4).min())
    for factor, kept in ((1.02, True), (0.98, False)):
        assert made.proved("overshoot", (PEAK - 1) * factor, LONG) is kept
        assert behind.proved("undershoot", under * factor, LONG) is kept
    assert not made.proved("overshoot", (PEAK - 1) / 2, LONG)
    assert not behind.proved("undershoot", under / 2, LONG)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("kind", ["step", "impulse", "initial"])
def test_a_settling_time_is_bracketed(kind, sign):
    made, y = Made(kind, sign=sign), response(kind)
    last = T[np.flatnonzero(np.abs(y - (kind == "step")) > 0.1)[-1]]
    after, before = (Fraction(int(np.floor(last * 50)) + k, 50) for k in (1, 0))
    lengths = ((1, 400),)
    assert made.proved("settling", after, lengths, unit="1/50", band="1/10")
    assert not made.proved("settling", before, lengths, unit="1/50", band="1/10")


def test_a_rise_is_at_its_time_and_to_its_band():
    made = Made("step")
    first = T[np.flatnonzero(STEP >= 0.9)[0]]
    after, before = (Fraction(int(np.floor(first * 50)) + k, 50) for k in (1, 0))
    assert made.proved("rise", after, ((1, 100),), unit="1/50", band="1/10")
    assert not made.proved("rise", before, ((1, 100),), unit="1/50", band="1/10")
    # at no end of a step, and a step later it has risen
    assert not made.proved("rise", "1/20", ((1, 2),), unit="4/5", band="1/10")


@pytest.mark.parametrize("sign", [1, -1])
def test_what_comes_after_the_last_step_counts(sign):
    """Steps that end while all is well, before it no longer is."""
    made, rest = Made("step", sign=sign), Made("initial", sign=sign)
    early = ((1, 6),)  # until 0.6 s
    assert STEP[:600].max() < 1
    assert not made.proved("peak", "1.2", early)
    assert not made.proved("overshoot", "1/5", early)
    assert not made.proved("settling", "6/10", early, band="3/10")
    y = response("initial")
    at = next(k for k in range(2, 40) if np.abs(y[100 * k]) < 0.15)
    assert np.abs(y[100 * at :]).max() > 0.2
    assert not rest.proved("settling", Fraction(at, 10), ((1, at),), band="3/20")
    assert not rest.proved("peak", "1/2", ((1, 0),))
    wide = envelope((0, -2, 2), ("0.3", "-0.3", "0.3"))
    assert not rest.proved("envelope", 1, ((1, 3),), envelope=wide)
    behind = Made("step", zero=-0.4, sign=sign)
    assert not behind.proved("undershoot", "1/50", ((1, 1),), unit="1/1000")


@pytest.mark.parametrize("kind", ["step", "initial"])
def test_what_is_followed_poorly_proves_what_is_true_alone(kind):
    """A series without parameters is that of the middle; the others are as far off as they are."""
    made = Made(kind, spread=0.3)
    middle, slow = response(kind), response(kind, -1, 0.3)
    assert np.abs(slow).max() > np.abs(middle).max() * 1.1 or kind == "initial"
    final = 1 / 0.7
    long = ((1, 150),)
    if kind == "step":
        assert not made.proved("final", "1.1", long, degree=0)
        assert made.proved("final", final * 1.001, long, degree=12)
        assert not made.proved("peak", PEAK * 1.1, long, degree=0)
        assert not made.proved("rise", "6/10", ((1, 6),), degree=0, band="3/10")
    end = np.flatnonzero(np.abs(middle - (kind == "step")) > 0.1)[-1] / 1000
    at = Fraction(int(np.ceil(end * 10)) + 1, 10)
    assert not made.proved("settling", at, ((1, int(at * 10)),), degree=0, band="1/5")
    if kind == "initial":
        low = envelope((0, "-0.75", "1.2"), (2, "-0.75", "1.2"))
        assert not made.proved("envelope", "0.9", long, degree=0, envelope=low)


def test_an_error_counts_after_steps_of_which_nothing_is_asked():
    """x' = (1 + 0.6 p) (w - x): a series without p is e^-t, and the slowest e^(-0.4 t)."""
    p = pf.Parameter("p", -1, 1)
    plant = pf.UncertainPlant.from_expressions([p], [["-1 - 0.6*p"]], [[1]], E=[["1 + 0.6*p"]])
    made, risen = (
        Made(kind, known=(plant, Output("y", "", C=[1]))) for kind in ("initial", "step")
    )
    late = ((1, 20),)  # until 2 s
    assert made.proved("settling", 2, late, degree=12, band=1.35 * np.exp(-0.8))
    assert not made.proved("settling", 2, late, degree=0, band=0.9 * np.exp(-0.8))
    assert not made.proved("settling", 2, late, degree=12, band=0.9 * np.exp(-0.8))
    assert risen.proved("rise", 2, late, degree=12, band=1.02 * np.exp(-0.8))
    for degree in (0, 12):
        assert not risen.proved("rise", 2, late, degree=degree, band=0.3)


@pytest.mark.parametrize("sign", [1, -1])
def test_an_envelope_holds_on_both_sides_at_all_times(sign):
    made, y = Made("initial", sign=sign), response("initial")
    at = {t: float(sign * y[int(1000 * t)]) for t in (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)}

    def kept(half, *times, level=1, lengths=LONG, **moved):
        points = [(t, at[t] - half.get(t, 0.6), at[t] + half.get(t, 0.6)) for t in times]
        for t, (low, high) in moved.items():
            points = [(s, low, high) if f"t{s}".replace(".", "_") == t else (s, a, b)
                      for s, a, b in points]  # fmt: skip
        return made.proved("envelope", level, lengths, envelope=envelope(*points))

    every = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
    assert kept({}, *every)
    assert not kept({}, *every, level="1/10")
    for side in ((at[1.0] - 0.6, at[1.0] - 0.05), (at[1.0] + 0.05, at[1.0] + 0.6)):
        assert not kept({}, *every, t1_0=side)
    for side in ((at[0.5] - 2, at[0.5] - 0.05), (at[0.5] + 0.05, at[0.5] + 2)):
        assert not kept({}, 0.5, 2.0, t0_5=side)  # the first, later than zero
        assert kept({}, 1.0, 2.0)
    # between points a chord: x1 at 1 s is far below that of 0.2 s and 2 s
    straight = envelope((0, sign * 1 - 0.2, sign * 1 + 0.2), (2, at[2.0] - 0.2, at[2.0] + 0.2))
    assert not made.proved("envelope", 1, LONG, envelope=straight)
    # a point inside a step, at which alone it is narrow
    narrow = envelope((0, -2, 2), (0.5, at[0.5] + 0.01, at[0.5] + 0.02), (1, -2, 2))
    assert not made.proved("envelope", 1, ((10, 8),), envelope=narrow)
    assert not made.proved("envelope", 1, LONG, envelope=narrow)
    # narrow after the last step, and wide in the end
    later = envelope((0, -2, 2), (0.1, -2, 2), (0.5, at[0.5] + 0.01, at[0.5] + 0.02), (1, -9, 9))
    assert not made.proved("envelope", 1, ((1, 1),), envelope=later)
    tight = envelope((0, -2, 2), (8, 0.01, 2))
    assert not made.proved("envelope", 1, LONG, envelope=tight)


def test_a_final_value_that_has_no_sign_has_no_shares():
    made = Made("step")
    none = [[[Fraction(0), Fraction(1)]]] * len(made.claim.subject.A)
    output = replace(made.claim.outputs[0], C=none)
    made.claim = replace(made.claim, outputs=(output,))  # of x2, which ends at zero
    for measure in ("overshoot", "undershoot"):
        assert not made.proved(measure, 100, LONG)
    assert not made.proved("settling", 8, LONG, band="1/2")
