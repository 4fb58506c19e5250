"""Margins of opened loops: published ones, and against polynomials, poles and delays themselves."""

import math

import numpy as np
import pytest

from polefence import Compensator, InputError, UncertainPlant, at_sample_time
from polefence.requirements.disk_margin import DiskMargin
from polefence.response import (
    Output,
    disk_margin,
    disk_ranges,
    family_points,
    margins,
    opened,
    places,
)

CUBIC = UncertainPlant.from_vertices([[[0, 1, 0], [0, 0, 1], [-10, -10, -10]]], [[[0], [0], [1]]])
CUBIC_GAIN = [[-25, 0, 0]]  # L = 25 / (s^3 + 10 s^2 + 10 s + 10)


@pytest.mark.parametrize(
    ("sigma", "margin", "at"), [(0, 0.4581, 1.955), (1, 0.4021, 2.011), (-1, 0.4864, 1.876)]
)
def test_published_disk_margins_of_a_cubic(sigma, margin, at):
    found = disk_margin(CUBIC, CUBIC_GAIN, sigma=sigma)
    assert found.value[0] == pytest.approx(margin, abs=6e-5)
    assert 2 * np.pi * found.frequency[0] == pytest.approx(at, abs=6e-4)


def test_closed_forms_of_a_cubic():
    found = margins(opened(CUBIC, CUBIC_GAIN))
    # L is real at w^2 = 10, where it is 25 / (10 - 100)
    assert found.upper.value[0] == pytest.approx(3.6, rel=1e-12)
    assert 2 * np.pi * found.upper.frequency[0] == pytest.approx(math.sqrt(10), rel=1e-12)
    assert found.lower.value[0] == 0
    assert math.isnan(found.lower.frequency[0])
    w = 2 * np.pi * found.phase.frequency[0]
    L = 25 / np.polyval([1, 10, 10, 10], 1j * w)
    assert abs(L) == pytest.approx(1, rel=1e-12)
    behind = np.pi + np.angle(L)
    assert found.phase.value[0] == pytest.approx(np.degrees(behind), rel=1e-12)
    assert found.delay.value[0] == pytest.approx(behind / w, rel=1e-12)


def test_published_margins_of_a_spinning_satellite_one_loop_at_a_time():
    plant = UncertainPlant.from_vertices([[[0, 10], [-10, 0]]], [np.eye(2)])
    gain = [[-1, -10], [10, -1]]
    for here in places(plant, gain)[:2]:
        found = margins(opened(plant, gain, here.name))
        assert found.upper.value[0] == math.inf
        assert found.phase.value[0] == pytest.approx(90, abs=1e-9)
        assert found.disk.value[0] == pytest.approx(2, rel=1e-7)


def test_ranges_of_a_disk():
    a = 0.4581
    balanced = disk_ranges(a)
    assert balanced.lower == pytest.approx((2 - a) / (2 + a))
    assert balanced.upper == pytest.approx((2 + a) / (2 - a))
    assert balanced.phase == pytest.approx(math.degrees(2 * math.atan(a / 2)))
    half = disk_ranges(2.0)
    assert (half.lower, half.upper, half.phase) == (0, math.inf, 90)
    classical = disk_ranges(1.0, 1)  # of a regulator: half to infinity, 60 degrees
    assert (classical.lower, classical.upper) == (0.5, math.inf)
    assert classical.phase == pytest.approx(60)
    assert disk_ranges(0.5, -1).upper == pytest.approx(1.5)


@pytest.mark.parametrize("sigma", [-1.5, -1, -0.3, 0, 0.6, 1, 2])
@pytest.mark.parametrize("margin", [0.05, 0.4, 0.9, 1.7, 2.6])
def test_ranges_are_those_of_the_disk_itself(sigma, margin):
    """Of f = (1 + (1 - sigma)/2 d) / (1 - (1 + sigma)/2 d) the d is (f - 1) / (...)."""
    ranges = disk_ranges(margin, sigma)

    def inside(f):
        return abs((f - 1) / ((1 - sigma) / 2 + (1 + sigma) / 2 * f)) < margin

    for end, away in ((ranges.lower, -1), (ranges.upper, 1)):
        if math.isfinite(end):
            assert inside(end - away * 1e-6)
            assert not inside(end + away * 1e-6)
        else:
            assert all(inside(1 + away * x) for x in np.geomspace(1e-3, 1e6, 200))
    below = np.radians(min(ranges.phase, 180) - 1e-5)
    assert all(inside(np.exp(1j * x)) for x in np.linspace(-below, below, 199))
    if ranges.phase < 180:
        assert not inside(np.exp(1j * np.radians(ranges.phase + 1e-5)))


def loops(T=None, count=12):
    """Random stable loops: A, b and c of L = c (s - A)^-1 b, or of z, and them as a plant."""
    random = np.random.default_rng(3 if T is None else 4)
    while count:
        n = int(random.integers(2, 6))
        A, b, c = random.normal(size=(n, n)), random.normal(size=n), random.normal(size=n)
        if T is not None:
            A = 0.55 * A
        poles = np.linalg.eigvals(A - np.outer(b, c))
        if (poles.real if T is None else np.abs(poles) - 1).max() > -0.02:
            continue
        count -= 1
        yield A, b, c, UncertainPlant.from_vertices([A], [b[:, None]], sample_time=T)


def is_stable(A, T):
    poles = np.linalg.eigvals(A)
    return (poles.real.max() if T is None else np.abs(poles).max() - 1) < 0


@pytest.mark.parametrize("T", [None, 0.1])
def test_gains_keep_the_poles_up_to_their_margins_and_not_beyond(T):
    for A, b, c, plant in loops(T):
        found = margins(opened(plant, -c[None]))
        low, high = found.lower.value[0], found.upper.value[0]

        def stable(g, A=A, b=b, c=c):
            return is_stable(A - g * np.outer(b, c), T)

        last = high * (1 - 1e-7) if math.isfinite(high) else 1e4
        assert all(stable(g) for g in np.geomspace(1, last, 60))
        assert math.isinf(high) or not stable(high * (1 + 1e-7))
        assert all(stable(g) for g in np.linspace(1, low * (1 + 1e-7) + 1e-12, 60))
        assert low == 0 or not stable(low * (1 - 1e-7))
        assert np.isnan(found.upper.frequency[0]) == math.isinf(high)


def test_crossings_near_resonances_are_not_missed():
    """Four modes of a damping of 0.2 %, near each other: L turns around many times."""
    random = np.random.default_rng(11)
    for _ in range(6):
        w = 1 + np.sort(random.uniform(0, 0.4, 4))
        A = np.kron(np.diag(w), np.array([[0, 1], [-1, -0.004]]))
        b = np.kron(np.ones(4), [0, 1.0])
        c = np.kron(random.uniform(-1, 1, 4), [0, 1.0]) * 0.01
        plant = UncertainPlant.from_vertices([A], [b[:, None]])
        while not is_stable(A - np.outer(b, c), None):
            c = c / 2
        found = margins(opened(plant, -c[None]))
        sizes = np.geomspace(1e-3, 1e3, 4001)
        steady = np.array([is_stable(A - g * np.outer(b, c), None) for g in sizes])
        high = sizes[(sizes > 1) & ~steady].min(initial=np.inf)
        low = sizes[(sizes < 1) & ~steady].max(initial=0)
        assert found.upper.value[0] == pytest.approx(high, rel=4e-3)
        assert found.lower.value[0] == pytest.approx(low, rel=4e-3)


@pytest.mark.parametrize("far", [5.72568274, 5.7258, 5.8, 20, 100])
def test_a_loop_that_is_stable_only_between_two_gains(far):
    """Of L = k (s + 1)^2 / ((s + 1/100)^3 (s/far + 1)^2) two crossings meet as far falls."""
    top, bottom = np.poly([-1, -1]), np.poly([-0.01] * 3 + [-far] * 2) / far**2
    n = len(bottom) - 1
    # L is real where top(jw) bottom(-jw) is: at the roots of its odd part
    odd = np.polymul(top, bottom * (-1.0) ** np.arange(n, -1, -1))
    odd[-1::-2] = 0
    w = [abs(r.imag) for r in np.roots(odd) if abs(r.real) < 1e-6 * abs(r) and r.imag > 0]
    _, first, last = sorted(-(np.polyval(bottom, 1j * x) / np.polyval(top, 1j * x)).real for x in w)
    k = np.sqrt(first * last)
    A = np.diag(np.ones(n - 1), 1)
    A[-1] = -bottom[:0:-1] / bottom[0]
    c = np.append(k * top[::-1], np.zeros(n - len(top))) / bottom[0]
    found = margins(opened(UncertainPlant.from_vertices([A], [np.eye(n)[:, -1:]]), -c[None]))
    assert found.lower.value[0] == pytest.approx(first / k, rel=1e-6)
    assert found.upper.value[0] == pytest.approx(last / k, rel=1e-6)


@pytest.mark.parametrize("T", [None, 0.1])
@pytest.mark.parametrize("sigma", [0, 1, -1, 0.4])
def test_peaks_and_crossings_are_those_of_a_dense_sweep(T, sigma):
    w = np.concatenate([[0], np.geomspace(1e-3, 1e3 if T is None else np.pi / T, 100_000)])
    s = 1j * w if T is None else np.exp(1j * w * T)
    for A, b, c, plant in loops(T, 4):
        den = np.poly(A)
        L = (np.poly(A - np.outer(b, c)) - den) @ s ** np.arange(len(A), -1, -1)[:, None]
        L = L / np.polyval(den, s)
        found = margins(opened(plant, -c[None]), sigma)
        peak = np.abs(1 / (1 + L) + (sigma - 1) / 2).max()
        assert found.disk.value[0] <= (1 + 1e-6) / peak
        assert found.disk.value[0] == pytest.approx(1 / peak, rel=1e-4)
        crossed = np.flatnonzero(np.diff(np.abs(L) > 1))
        phase = np.abs(np.degrees(np.angle(-L[crossed]))).min(initial=180)
        assert found.phase.value[0] == pytest.approx(phase, abs=0.1)


def test_the_least_perturbation_of_the_disk_puts_a_pole_on_the_axis():
    for A, b, c, plant in loops():
        for sigma in (0, 0.7):
            found = disk_margin(plant, -c[None], sigma=sigma)
            w = 2 * np.pi * found.frequency[0]
            if not math.isfinite(w):
                continue
            L = c @ np.linalg.solve(1j * w * np.eye(len(A)) - A, b)
            d = 1 / (1 / (1 + L) + (sigma - 1) / 2)  # which is as large as the margin
            assert abs(d) == pytest.approx(found.value[0], rel=1e-6)
            factor = (1 + (1 - sigma) / 2 * d) / (1 - (1 + sigma) / 2 * d)
            assert abs(1 + L * factor) < 1e-6 * abs(1 + L)


def late(A, b, c, delay, order=8):
    """The closed loop of L e^(-s delay), by a Pade approximation of that order."""
    coefficients = [
        math.factorial(2 * order - k) / math.factorial(k) / math.factorial(order - k)
        for k in range(order + 1)
    ]
    scaled = [x * delay**k / delay**order for k, x in enumerate(coefficients)]
    bottom = np.array(scaled[::-1]) / scaled[-1]
    top = np.array([x * (-1) ** k for k, x in enumerate(scaled)][::-1]) / scaled[-1]
    own = np.diag(np.ones(order - 1), 1)
    own[-1] = -bottom[:0:-1]
    passed = top[0]
    row = (top - passed * bottom)[:0:-1]
    into = np.eye(order)[-1]
    # u = -c x goes through it into b
    return np.block([[A - passed * np.outer(b, c), np.outer(b, row)], [-np.outer(into, c), own]])


def test_a_delay_breaks_the_loop_at_its_margin():
    seen = 0
    for A, b, c, plant in loops():
        delay = margins(opened(plant, -c[None])).delay.value[0]
        if math.isinf(delay):
            assert all(is_stable(late(A, b, c, x), None) for x in (0.01, 0.1, 1))
            continue
        seen += 1
        assert all(is_stable(late(A, b, c, x * delay), None) for x in (0.1, 0.5, 0.9, 0.999))
        assert not is_stable(late(A, b, c, 1.001 * delay), None)
    assert seen > 5


def test_whole_samples_of_delay_break_a_sampled_loop_at_its_margin():
    T, seen = 0.1, 0
    for A, b, c, plant in loops(T, 25):
        found = margins(opened(plant, -c[None])).delay.value[0] / T
        n, stands = len(A), 0
        while stands < 40:
            k = stands + 1
            late = np.zeros((n + k, n + k))
            late[:n, :n], late[:n, n] = A, b
            late[n : n + k - 1, n + 1 :] = np.eye(k - 1)
            late[-1, :n] = -c
            if not is_stable(late, T):
                break
            stands += 1
        below = math.ceil(min(found, 41)) - 1  # whole samples
        assert below <= stands
        seen += below == stands
    assert seen >= 20  # beyond a margin a few are stable again


@pytest.mark.parametrize(("D", "samples"), [(1.6, 1), (-0.5, math.inf), (0.45, math.inf)])
def test_a_loop_that_passes_straight_may_be_less_late_than_its_phase_says(D, samples):
    y = Output("y", C=[1, 0], D=[D])
    one = UncertainPlant.from_vertices(
        [[[0.3, 0.1], [0, -0.2]]], [[[0.1], [0.2]]], sample_time=0.1, outputs=(y,)
    )
    found = margins(opened(one, Compensator(D=[[-1]], measured=("y",)), "y"))
    assert found.stable[0]
    # D z^-1 alone is stable where D is below one; in continuous time no delay is
    assert found.delay.value[0] == pytest.approx(0.1 * samples)
    rates = UncertainPlant.from_vertices([[[-3, 1], [0, -2]]], [[[1], [2]]], outputs=(y,))
    late = margins(opened(rates, Compensator(D=[[-1]], measured=("y",)), "y")).delay.value[0]
    assert (late == 0) == (abs(D) >= 1)


def test_of_an_unstable_loop_no_margin_is_left():
    found = margins(opened(CUBIC, [[-91, 0, 0]]))  # 91 / 25 > 3.6
    assert not found.stable[0]
    assert (found.lower.value[0], found.upper.value[0]) == (1, 1)
    assert (found.phase.value[0], found.delay.value[0], found.disk.value[0]) == (0, 0, 0)
    assert margins(opened(CUBIC, [[-89, 0, 0]])).stable[0]


def test_the_worst_of_a_family_is_one_of_its_points():
    plant = UncertainPlant.from_vertices(
        [[[0, 1], [-k, -0.4]] for k in (1.0, 4.0)], [[[0], [1]], [[0], [1.5]]]
    )
    gain = [[-2.0, -0.3]]
    every = margins(opened(plant, gain, alpha=family_points(plant, 40)))
    alone = [margins(opened(plant, gain, alpha=alpha)) for alpha in every.opened.alpha]
    for worst in every.least:
        values = [getattr(one, worst.name).value[0] for one in alone]
        least = max(values) if worst.name == "lower" else min(values)
        assert worst.value == pytest.approx(least, rel=1e-9)
        assert values[worst.number] == pytest.approx(least, rel=1e-9)
    assert "alpha" in every.where(every.least[-1])


def test_a_sampled_loop_tends_to_that_in_continuous_time():
    fine = margins(opened(at_sample_time(CUBIC, 1e-4), CUBIC_GAIN))
    slow = margins(opened(CUBIC, CUBIC_GAIN))
    for name in ("upper", "phase", "delay", "disk"):
        a, b = getattr(fine, name), getattr(slow, name)
        assert a.value[0] == pytest.approx(b.value[0], rel=1e-3)
        assert a.frequency[0] == pytest.approx(b.frequency[0], rel=1e-3)


@pytest.mark.parametrize("T", [None, 0.02])
def test_disk_margins_are_those_of_the_requirement_which_is_written_otherwise(T):
    random = np.random.default_rng(8)
    As = [[[0, 1, 0], [-k, -0.8, 1], [0, 0, -5]] for k in (1.0, 3.0)]
    plant = UncertainPlant.from_vertices(As, [np.array([[0, 0], [1, 0.3], [0.2, 5]])] * 2)
    plant = plant if T is None else at_sample_time(plant, T)
    law = Compensator(
        random.normal(size=(2, 2)) - 3 * np.eye(2) if T is None else 0.3 * np.eye(2),
        *(
            random.normal(size=(2, 2)) * x
            for x in ((1, 0.4, 0.3) if T is None else (0.1, 0.2, 0.1))
        ),
        measured=("x1", "x3"),
        sample_time=T,
    )
    larger, gain = law.beside(plant)
    alpha = family_points(larger, 6)
    for here in places(plant, law):
        for sigma in (0, 1, -1):
            found = disk_margin(plant, law, here.name, sigma, alpha)
            other = 1 / DiskMargin(here.name, sigma=float(sigma)).values(larger, gain, alpha)
            np.testing.assert_allclose(found.value, other, rtol=1e-6)
            assert found.value.min() > 0


@pytest.mark.parametrize("sigma", [math.nan, math.inf, "S"])
def test_a_skew_that_is_no_number_is_refused(sigma):
    with pytest.raises(InputError, match="sigma"):
        disk_margin(CUBIC, CUBIC_GAIN, sigma=sigma)
    with pytest.raises(InputError, match="zero or more"):
        disk_ranges(-0.1)
