"""Weightings against the standard's table, an integration of their states, and each other."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from polefence.base.errors import InputError
from polefence.response import weighting as of_weighting
from polefence.response.bands import Bands
from polefence.response.weighting import WD, WE, WF, WK

# ISO 2631-1:1997, table 3: factors times 1000 at the nominal one-third octaves, band limits
# among them. Wk from 0.1 to 400 Hz, Wf from 0.02 to 4 Hz. Figures, as several public programs
# and papers repeat them. Wd at 10 Hz, printed as 212, is 202, as We has it an octave below.
TABLE_WK = """31.2 48.6 79.0 121 182 263 352 418 459 477 482 484 494 531 631 804 967 1039 1054 1036
988 902 768 636 513 405 314 246 186 132 88.7 54.0 28.5 15.2 7.90 3.98 1.95"""
TABLE_WD = """62.4 97.3 158 243 365 530 713 853 944 992 1011 1008 968 890 776 642 512 409 323 253
202 161 125 100 80.0 63.2 49.4 38.8 29.5 21.1"""
TABLE_WE = """62.5 97.5 159 245 368 536 723 862 939 941 880 772 632 512 409 323 253 202 160 125
100 80.1 62.5 50.0 39.9 31.6 24.7 19.4 14.8 10.5"""
TABLE_WF = """24.2 37.7 59.7 97.1 157 267 461 695 895 1006 992 854 619 384 224 116 53.0 23.5 9.98
3.77 1.55 0.64 0.25 0.097"""


def table(text, first):
    factors = np.array([float(v) for v in text.split()]) / 1000
    return Bands(first, first + len(factors) - 1).nominal, factors


@pytest.mark.parametrize(
    ("weighting", "text", "first", "ends"),
    [
        (WK, TABLE_WK, -10, (0.1, 400.0)),
        (WD, TABLE_WD, -10, (0.1, 80.0)),
        (WE, TABLE_WE, -10, (0.1, 80.0)),
        (WF, TABLE_WF, -17, (0.02, 4.0)),
    ],
    ids=["Wk", "Wd", "We", "Wf"],
)
def test_gain_meets_the_whole_table(weighting, text, first, ends):
    frequency, factors = table(text, first)
    assert (frequency[0], frequency[-1]) == ends
    np.testing.assert_allclose(np.abs(weighting.gain(frequency)), factors, rtol=0.01)


def test_the_table_would_show_a_wrong_band_limit():
    frequency, factors = table(TABLE_WK, -10)
    wrong = np.abs(replace(WK, low_pass=110.0).gain(frequency))
    assert np.abs(wrong / factors - 1).max() > 0.02


def test_known_figures_of_the_standard():
    found = np.abs(WK.gain([1, 6.3, 31.5, 80]))
    np.testing.assert_allclose(found, [0.482, 1.054, 0.405, 0.132], rtol=0.01)
    np.testing.assert_allclose(np.abs(WF.gain([0.2, 0.4])), [0.992, 0.384], rtol=0.01)
    # ISO 8041: at its reference frequency, 100 rad/s
    found = [abs(own.gain(50 / np.pi)) for own in (WK, WD, WE)]
    np.testing.assert_allclose(found, [0.7718, 0.1261, 0.06287], rtol=4e-4)


@pytest.mark.parametrize("weighting", [WK, WD, WE, WF])
def test_three_forms_are_one_filter(weighting):
    s = 2j * np.pi * np.geomspace(0.01, 500, 40)
    above, below = weighting.transfer_function()
    A, B, C, D = weighting.state_space()
    by_state = [(C @ np.linalg.solve(p * np.eye(len(A)) - A, B) + D).item() for p in s]
    gain = weighting.gain(s.imag / (2 * np.pi))
    np.testing.assert_allclose(np.polyval(above, s) / np.polyval(below, s), gain, rtol=1e-9)
    np.testing.assert_allclose(by_state, gain, rtol=1e-9, atol=1e-14)
    slowest = -np.linalg.eigvals(A).real.max()
    assert weighting.settling == pytest.approx(20 / slowest)


def test_sampled_sines_meet_the_table_up_to_80_hz():
    """200 samples a second: a bilinear filter would pass an eighth of the table's factor at 80."""
    frequency, factors = table(TABLE_WK, -10)
    keep = (frequency >= 0.5) & (frequency <= 80)
    time = np.arange(0, 40, 0.005)
    out = WK.apply(np.sin(2 * np.pi * frequency[keep, None] * time), 0.005)
    steady = (time >= 15) & (time < 35)
    amplitude = np.sqrt(2 * np.mean(out[:, steady] ** 2, axis=-1))
    np.testing.assert_allclose(amplitude, factors[keep], rtol=0.01)


@pytest.mark.parametrize(("weighting", "step", "span"), [(WK, 0.004, 4.0), (WF, 0.05, 60.0)])
def test_apply_meets_an_integration_of_the_states(weighting, step, span):
    """A pulse that fades in and out smoothly, against solve_ivp on the analogue filter."""
    time = np.arange(0, span, step)

    def pulse(t):
        hill = math.sin(math.pi * 2 * t / span) ** 6 if t < span / 2 else 0.0
        return hill * math.sin(2 * math.pi * weighting.top / 4 * t)

    A, B, C, D = weighting.state_space()
    B0 = B[:, 0]
    states = integrate.solve_ivp(
        lambda t, x: A @ x + B0 * pulse(t),
        (0, span),
        np.zeros(8),
        method="DOP853",
        t_eval=time,
        rtol=1e-8,
        atol=1e-11,
        max_step=span / 100,
    ).y
    record = np.array([pulse(t) for t in time])
    exact = (C @ states)[0] + D[0, 0] * record
    assert weighting.apply(record, step) == pytest.approx(exact, abs=2e-6 * abs(exact).max())


def test_rows_are_weighted_alone_whatever_the_block(monkeypatch):
    rows = np.random.default_rng(1).normal(size=(2, 3, 400))
    whole = WK.apply(rows, 0.005)
    monkeypatch.setattr(of_weighting, "BLOCK", 1)
    np.testing.assert_allclose(WK.apply(rows, 0.005), whole, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(WK.apply(rows[1, 2], 0.005), whole[1, 2], rtol=1e-12, atol=1e-14)


def test_the_end_of_a_record_does_not_come_back_at_its_start():
    time = np.arange(0, 4, 0.004)
    late = np.where(time > 3.5, np.sin(2 * np.pi * (time - 3.5)) ** 4, 0.0)
    out = WK.apply(late, 0.004)
    assert np.abs(out[time < 3]).max() < 1e-6 * np.abs(out).max()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: WK.apply(np.zeros(900), 0.01), "weighting Wk: a sampling step of 0.01 s .*0.0056"),
        (lambda: WK.apply(np.zeros(9), 0.0), r"sampling step \[s\] = 0.0"),
        (lambda: WK.apply([1.0, 2.0, math.nan], 0.001), "sample 3 is not a finite number"),
        (lambda: WK.apply([1.0], 0.001), "two samples"),
    ],
)
def test_bad_input_is_named_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
