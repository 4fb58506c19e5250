"""Signals of plants in discrete time: against scipy, python-control, trajectories, continuous time.

The spring of two masses is sampled with zero-order hold at each vertex; its family is the hull of
these.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from polefence import (
    Disk,
    EnergyPeak,
    FixedGain,
    Gain,
    HalfPlane,
    InitialPeak,
    RelativeRms,
    Rms,
    Sector,
    Structure,
    UncertainPlant,
    optimise,
    place,
    tightest,
    tradeoff,
)
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.plant.delta import delta_form, sampled_form
from polefence.plant.exact import file_plant
from polefence.plant.points import seeded
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from polefence.response import frequency, impulse, simulate, stationary, step
from polefence.response.discrete import zero_order_hold
from polefence.response.modes import Modes

T = 0.02
MASSES = (0.8, 1.2)
LAW = FixedGain(np.array([[-30.0, -12.0]]))


def continuous():
    """Masses on a spring of 100 N/m and a damper of 2 N s/m, pushed."""
    A = [[[0, 1], [-100 / m, -2 / m]] for m in MASSES]
    B = [[[0], [1 / m]] for m in MASSES]
    return UncertainPlant.from_vertices(A, B, B, **NAMES)


NAMES = {
    "name": "spring",
    "states": ("x [m]", "v [m/s]"),
    "inputs": ("f [N]",),
    "disturbances": ("w [N]",),
}


def at_samples(T):
    """The same between samples T apart."""
    plant = continuous()
    pairs = [zero_order_hold(v.A, np.hstack([v.B, v.E]), T) for v in plant.vertices]
    A, B, E = ([own[k] for own in pairs] for k in (0, 1, 1))
    time = Fraction(T).limit_denominator(10**6)
    one = slice(0, 1)
    return UncertainPlant.from_vertices(
        A, [M[:, one] for M in B], [M[:, 1:] for M in E], sample_time=time, **NAMES
    )


@pytest.fixture(scope="module")
def plant():
    return at_samples(T)


ASKED = [
    Rms("x", density=2.0),
    Rms(["x", "f"], density=2.0),
    Gain("f"),
    Gain(["x", "f"]),
    EnergyPeak("x", norm=2.0),
    InitialPeak("x", impulse=1.5),
    InitialPeak("f", points=[[1, 0], [0, 2]]),
    InitialPeak("x", ellipsoid=[[1, 0], [0, 4]]),
    RelativeRms("x"),
]
IDS = [own.title for own in ASKED]
MOVED = [own for own in ASKED if own.title != "gain of f"]  # whose peak is at zero frequency


def loop_of(plant, own, alpha, law=LAW):
    """The loop's A, E and the signal's rows, in the z-plane."""
    A, B = plant.at(alpha)
    E = np.tensordot(alpha, np.stack([v.E for v in plant.vertices]), 1)
    K = np.zeros((1, 2)) if law is None else law.K
    rows = {"x": [[1.0, 0.0]], "v": [[0.0, 1.0]], "f": K}
    return A + B @ K, E, np.vstack([rows[y.name] for y in own.outputs(plant)])


def truth(plant, own, alpha, law=LAW, count=20001):
    """What is bounded, by equations that the project does not use; gains at so many frequencies."""
    A, E, C = loop_of(plant, own, alpha, law)
    if own.kind == "relative rms":
        return truth(plant, Rms("x"), alpha) / truth(plant, Rms("x"), alpha, None)
    if own.kind == "rms":  # the variance of a sample is the density over twice the sample time
        X = solve_discrete_lyapunov(A, E @ E.T * own.density / (2 * T))
        return np.sqrt(np.trace(C @ X @ C.T))
    if own.kind == "energy peak":  # T times the sum of squares is the energy
        X = solve_discrete_lyapunov(A, E @ E.T / T)
        return own.norm * np.sqrt((C @ X @ C.T).item())
    if own.kind == "gain":
        turns = np.exp(1j * np.linspace(0, np.pi, count))
        each = C @ np.linalg.solve(turns[:, None, None] * np.eye(2) - A, E + 0j)
        return np.linalg.norm(each, 2, axis=(1, 2)).max()
    if own.ellipsoid:
        start, groups = np.diag([1.0, 2.0]), [slice(0, 2)]
    else:
        start = own.impulse * E / T if own.impulse else np.array(own.points).T
        groups = [slice(k, k + 1) for k in range(start.shape[1])]
    found, states = 0.0, start
    for _ in range(2000):
        y = (C @ states)[0]
        found = max(found, *(np.linalg.norm(y[group]) for group in groups))
        states = A @ states
    return found


@pytest.mark.parametrize("own", ASKED, ids=IDS)
def test_values_are_those_of_other_equations(plant, own):
    alpha = seeded(plant, 5)
    expected = [truth(plant, own, a) for a in alpha]
    assert own.values(plant, LAW, alpha) == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("own", ASKED, ids=IDS)
def test_bounds_are_near_the_worst_and_never_below(plant, own):
    alpha = np.vstack([np.eye(2), seeded(plant, 50)])
    worst = max(truth(plant, own, a, count=2001) for a in alpha)
    found = best_bound(plant, LAW, own)
    # a Lyapunov matrix bounds a peak from given states by an ellipsoid
    loose = 1.6 if own.kind == "initial peak" else 1.01
    assert worst <= found.level * (1 + 1e-7)
    assert found.level <= loose * worst
    assert prove(found.claim).proved
    below = Fraction(worst) * Fraction(999, 1000)
    assert not prove(replace(found.claim, level=below)).proved
    limited = replace(own, at_most=float(below))
    assert kept_bound(plant, LAW, limited) is None


@pytest.mark.parametrize("own", [ASKED[0], ASKED[2], ASKED[4], ASKED[8]], ids=lambda o: o.kind)
def test_a_claim_does_not_hold_of_another_sample_time(plant, own):
    claim = best_bound(plant, LAW, own).claim
    # of less a step the same rates are calmer; of more they are not
    more = replace(claim.subject, step=claim.subject.step * 3)
    assert not prove(replace(claim, subject=more)).proved


@pytest.mark.parametrize("own", MOVED, ids=[own.title for own in MOVED])
def test_as_samples_come_close_the_bounds_are_those_of_continuous_time(own):
    known = best_bound(continuous(), LAW, own).level
    far, near = (best_bound(at_samples(T), LAW, own).level for T in (4e-3, 2e-4))
    assert near == pytest.approx(known, rel=5e-3)
    assert abs(near - known) <= abs(far - known) + 2e-3 * known


@pytest.mark.parametrize("own", ASKED, ids=IDS)
def test_slopes_are_those_of_differences(plant, own):
    alpha = np.array([[0.3, 0.7]])
    channel = own.channel(delta_form(plant), alpha)

    def measured(K):
        modes = Modes(channel.A + channel.B @ K, T)
        found = own.slopes(channel.closed(K, modes))
        return found.values, channel.slopes(found)

    K = LAW.K[None]
    values, slopes = measured(K)
    first = int(values.argmax())
    for j, h in enumerate(1e-6 * np.abs(LAW.K[0])):
        change = np.zeros_like(K)
        change[0, 0, j] = h
        above, below = (measured(K + sign * change)[0][first] for sign in (1, -1))
        size = np.abs(slopes[first]).max() + values[first] / 30
        assert slopes[first, 0, j] == pytest.approx((above - below) / (2 * h), abs=3e-4 * size)


def test_noise_and_pulses_stay_below_the_bounds(plant):
    rng = np.random.default_rng(5)
    alpha = seeded(plant, 40)
    time = T * np.arange(4000)
    rms = best_bound(plant, LAW, Rms("x", density=2.0)).level
    peak = best_bound(plant, LAW, EnergyPeak("x", norm=2.0)).level
    w = rng.normal(scale=np.sqrt(2.0 / (2 * T)), size=len(time))
    found = simulate(plant, LAW, alpha, w, time, ["x"])
    assert found.rms(1.0).max() <= rms * 1.1  # 4,000 samples of it
    for _ in range(25):
        w = np.zeros(400)
        w[: rng.integers(1, 400)] = 1.0
        w *= rng.normal(size=400)
        w *= 2.0 / np.sqrt(T * np.sum(w**2))
        found = simulate(plant, LAW, alpha, w, time[:400], ["x"])
        assert np.abs(found.values).max() <= peak


def test_the_worst_pulse_of_an_energy_nearly_reaches_its_bound(plant):
    bound = best_bound(plant, LAW, EnergyPeak("x", norm=2.0)).level
    reached = []
    for alpha in np.eye(2):
        A, E, C = loop_of(plant, Rms("x"), alpha)
        response = [(C @ np.linalg.matrix_power(A, k) @ E).item() for k in range(400)]
        w = np.array(response[::-1])
        w *= 2.0 / np.sqrt(T * np.sum(w**2))
        time = T * np.arange(401)
        one = simulate(plant, LAW, alpha, np.append(w, 0.0), time, ["x"])
        reached.append(np.abs(one.values).max())
    assert max(reached) == pytest.approx(bound, rel=2e-3)
    assert max(reached) <= bound


def test_responses_are_those_of_python_control(plant):
    control = pytest.importorskip("control")
    one = plant.vertices[0]
    system = control.ss(one.A, one.E, np.eye(2), np.zeros((2, 1)), T)
    alpha, names = [[1.0, 0.0]], ["x", "v"]
    for ours, theirs in ((step, control.step_response), (impulse, control.impulse_response)):
        found = ours(plant, None, alpha, names, duration=4.0)
        expected = theirs(system, found.time)
        values = np.asarray(expected.outputs).reshape(2, -1).T
        assert found.values[0] == pytest.approx(values, abs=1e-12)
        assert found.time[1] == T
    found = frequency(plant, None, alpha, signals=["x"])
    expected = [system(np.exp(2j * np.pi * f * T))[0] for f in found.frequency]
    assert found.gain[0, :, 0, 0] == pytest.approx(np.ravel(expected), rel=1e-9)
    assert found.frequency[-1] <= 1 / (2 * T) * (1 + 1e-12)


def test_the_delta_form_is_the_plant(plant):
    own = delta_form(plant)
    assert own.step == Fraction(1, 50)
    assert own.sample_time is None
    assert sampled_form(own).digest == plant.digest
    assert delta_form(own) is own
    A, B = continuous().at(np.array([1.0, 0.0]))
    close = delta_form(at_samples(1e-6)).at(np.array([1.0, 0.0]))
    assert close[0] == pytest.approx(A, abs=1e-3 * np.abs(A).max())
    assert close[1] == pytest.approx(B, abs=1e-3)


@pytest.mark.parametrize(
    ("least", "limit"),
    [
        (Rms("x"), Gain("f", 3.0)),
        (Gain("x"), Rms("f", 3.0)),
        (EnergyPeak("x"), EnergyPeak("f", 3.0)),
        (RelativeRms("x"), Rms("f", 3.0)),
    ],
    ids=lambda own: own.kind,
)
@pytest.mark.usefixtures("hasty")
def test_laws_are_optimised_and_their_files_proved(tmp_path, plant, least, limit):
    done = optimise(plant, least, [limit], HalfPlane(1.0))
    document = loads(done.save(tmp_path).read_text())
    assert document.plant.sample_time == plant.sample_time
    assert all(prove(claim).proved for claim in document.claims)
    assert all("every 20 ms" in own.statement(document.plant) for own in document.claims[1:])
    assert np.abs(done.design.poles(seeded(plant, 50))).max() < np.exp(-T)
    for own in done.bounds:
        worst = sampled(plant, done.law, own.specification).worst
        assert worst <= own.level <= 1.02 * worst
    # one gain is a law of this kind, so that this is no worse
    assert done.bounds[0].level <= optimise(
        plant, least, [limit], HalfPlane(1.0), "quadratic"
    ).bounds[0].level * (1 + 1e-6)


def test_a_wanted_wk_is_that_of_a_held_signal(plant):
    done = optimise(plant, Rms("x", weight="Wk"), [Rms("f", 3.0)], method="quadratic")
    assert done.plant.shape == plant.shape  # the law is one of the plant, without the filter
    assert "behind the filter 'Wk'" in done.bounds[0].claim.statement(file_plant(plant))
    assert done.plant.sample_time == plant.sample_time
    fine = optimise(continuous(), Rms("x", weight="Wk"), [Rms("f", 3.0)], method="quadratic")
    near = optimise(at_samples(1e-3), Rms("x", weight="Wk"), [Rms("f", 3.0)], method="quadratic")
    assert near.bounds[0].level == pytest.approx(fine.bounds[0].level, rel=0.03)


def test_tuned_laws_keep_regions_of_discrete_time(plant):
    structure = Structure(measured=("x", "v"))
    region = HalfPlane(2.0) & Sector(0.3)
    design = place(plant, region, structure=structure)
    assert design.plant.digest == plant.digest
    s = np.log(design.poles(seeded(plant, 200))) / T
    assert s.real.max() < -2
    assert (-s.real / np.abs(s)).min() > 0.3
    own = tightest(plant, 0.5, structure=structure).region.radius
    assert own <= tightest(plant, 0.5, "quadratic").region.radius * (1 + 1e-3)
    output = place(plant, HalfPlane(0.5), structure=Structure(measured=("v",)))
    assert np.abs(output.poles(np.eye(2))).max() < np.exp(-0.5 * T)


def test_a_tradeoff_has_rows_that_are_proved(plant):
    front = tradeoff(plant, Rms("x"), Rms("f"), [2.0, 3.0], methods=["quadratic"])
    assert front.proved
    assert front.rows[1]["proved"] < front.rows[0]["proved"]


def test_what_discrete_time_has_not_is_refused(plant):
    with pytest.raises(InputError, match="a half_plane has no region within"):
        tightest(plant, of="half_plane", structure=Structure(), within=Disk(0, 0.9))
    with pytest.raises(InputError, match=r"step = 0.03 s; spring is in discrete time, .* 0.02 s"):
        step(plant, None, np.eye(2), step=0.03, duration=1.0)
    with pytest.raises(InputError, match="up to half of the sampling rate, 25 Hz"):
        frequency(plant, None, np.eye(2), [26.0])
    with pytest.raises(InputError, match=r"has a pole at 1.* keeps its poles in the unit disk"):
        stationary(plant, FixedGain(np.array([[0.0, 20.0]])), np.eye(2), 1.0)
