"""Roads in tracks, against integrals over frequency with true delays and coherence."""

import re

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import solve_continuous_lyapunov

from polefence import InputError, Rms, SpecError, optimise
from polefence.examples import spec_text
from polefence.plant.spec import dumps, loads
from polefence.plant.tracks import STATE, Tracks, pade
from polefence.plant.weights import measurable
from support.paths import DOCS

SPEED = 20.0
PLACES = {
    "half-car": [(1.156, 0), (-1.423, 0)],
    "full-car": [(1.156, 0.6935), (1.156, -0.6935), (-1.423, 0.682), (-1.423, -0.682)],
}
UNDER = re.compile(r"under = \[[^\]]*\]\n")
WIDTH = 0.845 * (0.6935 + 0.682)


def stationary_covariance(A, W):
    return solve_continuous_lyapunov(A, -W)


def on_tracks(name, *lines):
    return loads(UNDER.sub("\n".join(["[road.tracks]", *lines, ""]), spec_text(name)))


def rows(plant, name, vertex):
    (own,) = [own for own in plant.every_output if own.name == name]
    return np.array(own.exact(plant)[0][vertex], float)


def entering(plant, vertex):
    return np.array(plant.vertices[vertex].exact_E, float)


def rms(plant, name, vertex=0):
    A, E, c = plant.A[vertex], entering(plant, vertex), rows(plant, name, vertex)
    return float(np.sqrt(c @ stationary_covariance(A, E @ E.T) @ c))


def with_true_delays(name, signal, vertex=0, width=WIDTH):
    """Each wheel by itself by a Lyapunov equation; pairs by an integral."""
    plant, places = loads(spec_text(name)), PLACES[name]
    A, E, c = plant.A[vertex], entering(plant, vertex), rows(plant, signal, vertex)
    w = np.linspace(0, 2500, 200_001)
    poles, vectors = np.linalg.eig(A)
    left, right = c @ vectors, np.linalg.solve(vectors, E.astype(complex))
    H = ((left / (1j * w[:, None] - poles)) @ right).T
    found = sum(c @ stationary_covariance(A, np.outer(e, e)) @ c for e in E.T)
    for i, (x, y) in enumerate(places):
        for j in range(i):
            later = np.exp(1j * w * (x - places[j][0]) / SPEED)
            apart = 1 + (w * width / SPEED) ** 2 if y * places[j][1] < 0 else 1
            pair = (H[i] * H[j].conj() * later / apart).real
            found += 2 * trapezoid(pair, w) / np.pi
    return float(np.sqrt(found))


PAGE = (DOCS / "cars.md").read_text()
SIGNALS = {
    "half-car": ["driver acceleration", "pitch acceleration", "rear tyre force variation"],
    "full-car": ["driver acceleration", "roll acceleration", "front left tyre force variation"],
}


@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("order", [2, 4, 6, 8])
def test_it_rides_as_with_true_delays(name, order):
    (percent,) = re.findall(rf"(?m)^\| {order} \|.*\| (\S+) % \|$", PAGE)
    plant = on_tracks(name, f"order = {order}")
    for signal in SIGNALS[name]:
        truly = with_true_delays(name, signal)
        assert rms(plant, signal) == pytest.approx(truly, rel=float(percent) / 100)


@pytest.mark.parametrize("name", SIGNALS)
def test_the_page_says_what_tracks_change(name):
    density = (2 * np.pi * 0.1) ** 2 * 256e-6 * SPEED / 2  # two-sided
    plain, tracked = loads(spec_text(name)), on_tracks(name)
    for signal in SIGNALS[name]:
        said = re.search(rf"\| {name}, {signal} \S+ \| (\S+) \| (\S+) \|", PAGE).groups()
        found = [rms(plant, signal) * np.sqrt(density) for plant in (plain, tracked)]
        assert [f"{own:.4g}" for own in found] == list(said)


@pytest.mark.parametrize("order", range(1, 9))
def test_a_delay_passes_all_frequencies_alike(order):
    a, b, c, d = (np.array(M, float) for M in pade(1, order))
    w = np.linspace(0, 40, 400)
    passed = np.array([d + c @ np.linalg.solve(1j * x * np.eye(order) - a, b) for x in w])
    assert np.abs(passed) == pytest.approx(1)
    assert np.linalg.eigvals(a).real.max() < 0
    off = np.abs(passed - np.exp(-1j * w))
    assert off[w <= order].max() < 0.09
    said = re.search(rf"(?m)^\| {order} \| (\S+) Hz", PAGE)
    if said:
        assert off[w <= 2 * np.pi * float(said[1]) * 2.579 / SPEED].max() < 0.1


def spectra(plant, w):
    """Of the roads under the wheels, by what they do to the tyres' deflections."""
    n, first = plant.shape[0], len(measurable(plant))
    A, E = plant.A[0], entering(plant, 0)
    a, b = A[first:, first:], E[first:]
    # G G+ = I where wheels are no more than motions: rates of the deflections but for the wheels
    at = [i for i, own in enumerate(plant.states) if "tyre deflection" in own]
    z = np.linalg.solve(1j * w * np.eye(n - first) - a, b)
    H = A[at, first:] @ z + E[at]
    return H @ H.conj().T


@pytest.mark.parametrize("w", [0.1, 3.0, 30.0, 1e4])
def test_each_wheel_has_the_spectrum_of_the_road(w):
    S = spectra(on_tracks("half-car", "order = 5"), w)
    assert np.diag(S) == pytest.approx(1)
    later = np.exp(-1j * w * (1.156 + 1.423) / SPEED)
    assert w > 40 or S[1, 0] == pytest.approx(later, abs=2e-3)


ROLL = """
[car.body]
mass = 500
roll_inertia = 110
[car.wheel.left]
y = 0.7
mass = 32
spring = 20000
damper = "c"
tyre = 158000
[car.wheel.right]
y = -0.7
mass = 32
spring = 20000
damper = "c"
tyre = 158000
[parameter.c]
range = [1000, 2000]
[road]
class = "C"
speed = 20
"""


@pytest.mark.parametrize("w", [0.1, 3.0, 30.0, 1e4])
def test_sides_are_as_coherent_as_it_says(w):
    S = spectra(loads(ROLL + "[road.tracks]"), w)
    assert np.diag(S) == pytest.approx(1, rel=1e-12)
    x = w * 0.845 * 1.4 / 20
    assert S[0, 1] == pytest.approx(1 / (1 + x**2), abs=1.5e-3)
    t = np.linspace(0, 15, 20_001)
    y = w * 1.4 / 20
    bessel = trapezoid(np.exp(-y * np.cosh(t)) * np.cosh(t), t)
    assert S[0, 1] == pytest.approx(y * bessel, abs=0.035)


def test_narrow_tracks_do_not_roll_and_wide_ones_are_independent():
    roll, heave = "roll acceleration", "heave acceleration"
    narrow, wide = (loads(f"{ROLL}[road.tracks]\nwidth = {b}") for b in ("1e-6", "1e6"))
    plain = loads(ROLL)
    assert rms(narrow, roll) < 1e-2 * rms(plain, roll)
    assert rms(narrow, heave) == pytest.approx(np.sqrt(2) * rms(plain, heave), rel=1e-3)
    for signal in (roll, heave):
        assert rms(wide, signal) == pytest.approx(rms(plain, signal), rel=1e-3)


def test_its_states_are_behind_and_manoeuvres_stay():
    text = UNDER.sub("[road.tracks]\n", spec_text("full-car"))
    plant = loads(text.replace("roll_inertia", "height = 0.5\nroll_inertia"))
    assert plant.shape == (24, 4)
    assert len(measurable(plant)) == 14
    assert all(own.startswith(STATE) for own in plant.states[14:])
    names = ("road velocity [m/s]", "road velocity across [m/s]")
    assert plant.disturbances == (*names, "braking [m/s2]", "cornering [m/s2]")
    (own,) = [own for own in plant.every_output if own.name == "driver acceleration"]
    assert not any(own.exact(plant)[2][0][:2])
    assert any(own.exact(plant)[2][0][2:])
    again = loads(dumps(plant))
    assert [v.exact_E for v in again.vertices] == [v.exact_E for v in plant.vertices]


FAULTS = [
    ("[road.tracks]\norder = 0", "tracks: order = 0 must be 1 to 8"),
    ("[road.tracks]\norder = 2.5", "must be 1 to 8"),
    ("[road.tracks]\nwidth = 0", "width = 0 must be a positive number"),
    ("[road.tracks]\nlength = 3", "road.tracks: unknown key 'length'"),
    ("tracks = true", "road.tracks must be a table"),
]


@pytest.mark.parametrize(("new", "words"), FAULTS)
def test_tracks_that_are_none_are_refused(new, words):
    with pytest.raises((SpecError, InputError), match=words) as caught:
        loads(UNDER.sub(f"{new}\n", spec_text("half-car")), "car.toml")
    assert str(caught.value).startswith("car.toml: ")


def test_tracks_need_a_car_a_speed_and_two_wheels():
    with pytest.raises(SpecError, match=r"road: speed is missing"):
        loads(ROLL.replace("speed = 20", "") + "[road.tracks]")
    with pytest.raises(SpecError, match=r"without \[car\]"):
        loads(spec_text("quarter-car-m1") + "\n[road.tracks]\n")
    one = re.sub(r"(?s)\[car.wheel.right\].*?\[par", "[par", ROLL)
    one = one.replace("roll_inertia = 110\n", "").replace("y = 0.7\n", "")
    with pytest.raises(InputError, match="all wheels are in one place"):
        loads(one + "[road.tracks]")
    with pytest.raises(InputError, match="no disturbance 'front road'; did you mean"):
        Tracks(20).under(loads(spec_text("half-car")), {"front road": (1, 0)})


def test_odd_orders_are_worse_where_wheels_hop():
    truly = with_true_delays("full-car", "roll acceleration")
    assert rms(on_tracks("full-car", "order = 3"), "roll acceleration") > 1.2 * truly


@pytest.mark.usefixtures("hasty")
def test_no_law_measures_the_road_unless_told():
    plant = loads(ROLL + "[road.tracks]")
    limits = [Rms(f"{side} force", 500, 2e-3) for side in ("left", "right")]
    found = optimise(plant, Rms("heave acceleration", density=2e-3), limits)
    assert [own.name for own in found.law.measured] == list(measurable(plant))
