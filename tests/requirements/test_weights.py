"""Weighted signals: against block matrices, Lyapunov equations, integrals over frequency."""

import json
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction
from operator import add, mul

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov

import polefence as pf
from polefence import InputError, optimise
from polefence.certify.bounds import best_bound, bounds_file, kept_bound, sampled
from polefence.certify.design import check_document
from polefence.certify.given import analyse
from polefence.examples import family
from polefence.law.laws import FixedGain, GainTable, PolynomialGain, ScheduledGain, given_law
from polefence.law.structure import Structure
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import loads as read
from polefence.proof.work import FormatError
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.text import parse_specification
from polefence.requirements.weights import WEIGHTS, behind, filter_of, wider, with_weights
from polefence.response.closed import close
from polefence.response.samples import at_sample_time
from polefence.response.weighting import WK
from polefence.search.tradeoff import tradeoff
from polefence.search.tune.tuner import tune
from polefence.vehicle.vehicle import ride

DENSITY = 1e-3
SKYHOOK = FixedGain([[0, 0, -1500.0, 0]])

MASS = """
states = ["x [m]", "v [m/s]"]
inputs = ["f [m/s2]"]
disturbances = ["w [m/s2]"]

[parameter.k]
range = [30, 50]

[matrices]
A = [[0, 1], ["-k", -2]]
B = [[0], [1]]
E = [[0], [1]]

[outputs]
"a [m/s2]" = {C = ["-k", -2], D = [1], F = [1]}
"""


@pytest.fixture(scope="module")
def car():
    return family("quarter-car-ride")


@pytest.fixture(scope="module")
def mass():
    return loads(MASS)


def series(plant, vertex, K, signal, weight):
    """Return A, E and c of a loop with a weighting behind a signal, from block matrices."""
    own = plant.vertices[vertex]
    C, D, F = (rows[vertex] for rows in signal.arrays(plant))
    a, b, c, _ = WEIGHTS[weight].state_space()
    A = np.block([[own.A + own.B @ K, np.zeros((len(own.A), len(a)))], [b @ (C + D @ K)[None], a]])
    return A, np.vstack([own.E, b @ F[None]]), np.concatenate([np.zeros(len(own.A)), c[0]])


def test_the_weighted_signal_is_an_output_of_the_series(car):
    a, b, c, _ = WK.state_space()
    larger, (own,) = with_weights(car, (Rms("sprung-mass acceleration", weight="Wk"),))
    assert own == Rms("sprung-mass acceleration, Wk")
    for vertex, bare in zip(larger.vertices, car.vertices, strict=True):
        assert np.array_equal(vertex.A[:4, :4], bare.A)
        assert not vertex.A[:4, 4:].any()
        assert np.allclose(vertex.A[4:, :4], b @ bare.A[2:3], rtol=1e-15)
        assert np.array_equal(vertex.A[4:, 4:], a)
        assert np.allclose(vertex.B[4:], b @ bare.B[2:3], rtol=1e-15)
        assert not vertex.E[4:].any()
    signal = larger.signal("sprung-mass acceleration, Wk")
    assert [float(x) for x in signal.C[0]] == [0.0] * 4 + c[0].tolist()
    assert ride(larger).places == ride(car).places
    with pytest.raises(InputError, match="has a signal 'sprung-mass acceleration, Wk' already"):
        with_weights(larger, (Rms("sprung-mass acceleration", weight="Wk"),))


@pytest.mark.parametrize("weight", WEIGHTS)
def test_a_weighted_rms_is_that_of_a_lyapunov_equation_and_of_an_integral(car, weight):
    own = Rms("sprung-mass acceleration", density=DENSITY, weight=weight)
    corners, signal = np.eye(4), car.signal("sprung-mass acceleration")
    found = sampled(car, SKYHOOK, own, corners).values
    for j in range(4):
        A, E, c = series(car, j, SKYHOOK.K, signal, weight)
        X = solve_continuous_lyapunov(A, -DENSITY / 2 * E @ E.T)
        assert found[j] == pytest.approx(np.sqrt(c @ X @ c), rel=1e-9)
    C, D, _ = (rows[0] for rows in signal.arrays(car))
    A, E, _ = (M[:4] for M in series(car, 0, SKYHOOK.K, signal, weight))
    row, eye = C + D @ SKYHOOK.K, np.eye(4)

    def power(log):
        f = np.exp(log)
        H = (row @ np.linalg.solve(2j * np.pi * f * eye - A[:, :4], E)).item()
        return f * abs(H * WEIGHTS[weight].gain(f)) ** 2

    square, _ = quad(power, np.log(1e-4), np.log(1e4), limit=500, epsrel=1e-8)
    assert found[0] == pytest.approx(np.sqrt(DENSITY * square), rel=1e-5)


def test_white_noise_may_pass_straight_into_a_weighted_signal(mass):
    own = Rms("a", density=2.0, weight="Wk")
    found = sampled(mass, None, own, np.eye(2)).values
    for j in range(2):
        A, E, c = series(mass, j, np.zeros((1, 2)), mass.signal("a"), "Wk")
        X = solve_continuous_lyapunov(A, -E @ E.T)
        assert found[j] == pytest.approx(np.sqrt(c @ X @ c), rel=1e-9)
    bound = best_bound(mass, FixedGain([[0, 0]]), own)
    worst = sampled(mass, None, own).worst
    assert worst * (1 - 1e-9) <= bound.level < 1.01 * worst
    with pytest.raises(InputError, match="passes straight into 'a'"):
        best_bound(mass, FixedGain([[0, 0]]), own.unweighted())


def laws(car):
    W = np.stack([np.diag([1, 2, 3, 4.0]) * (1 + k) for k in range(4)])
    gains = np.tile(SKYHOOK.K, (3, 3, 1, 1)) * np.linspace(0.5, 1, 3)[:, None, None, None]
    p = car.parameters
    grid = {own.name: [own.low, (own.low + own.high) / 2, own.high] for own in p}
    speed = (car.signal("sprung-mass velocity"),)
    yield SKYHOOK
    yield SKYHOOK.K
    yield ScheduledGain(W, SKYHOOK.K @ W, p)
    yield PolynomialGain(((0, 0), (1, 0)), [SKYHOOK.K, 0.1 * SKYHOOK.K], (), p)
    yield PolynomialGain(((0, 0), (0, 1)), [[[-1500.0]], [[100.0]]], speed, p)
    yield GainTable(p, grid, gains)


def test_every_form_of_law_leaves_the_filters_alone(car):
    larger, _ = with_weights(car, (Rms("sprung-mass acceleration", weight="Wf"),))
    alpha = seeded(car, 6)
    for law in laws(car):
        own = wider(law, car, larger)
        before, after = (close(plant, each, alpha).K for plant, each in ((car, law), (larger, own)))
        assert np.allclose(after[..., :4], before, rtol=1e-12)
        assert after.shape[-1] == larger.shape[0]
        assert not after[..., 4:].any()
    assert wider(None, car, larger) is None


@pytest.mark.parametrize("k", range(3))
def test_bounds_of_every_law_are_proved_of_the_plant_itself(car, k):
    law = given_law(car, [SKYHOOK, *list(laws(car))[2:4]][k])
    own = Rms("sprung-mass acceleration", density=DENSITY, weight="Wk")
    bound = best_bound(car, law, own)
    worst = sampled(car, law, own, seeded(car, 500)).worst
    assert worst * (1 - 1e-9) <= bound.level < worst * 1.02
    assert bound.specification == own
    assert len(bound.claim.subject.A[0]) == 4
    assert kept_bound(car, law, replace(own, at_most=0.999 * worst)) is None
    certificate = analyse(car, law, pf.HalfPlane(0)).certificate
    document = read(bounds_file(certificate, [bound.claim]).dumps())
    again = document.claims[1]
    assert again == bound.claim
    assert prove(again).proved
    assert "behind the filter 'Wk' (as the file defines it)" in again.statement(document.plant)
    assert not prove(replace(again, level=Fraction(0.999 * worst))).proved


def changed(claim, change):
    filters = tuple(replace(own, **change(own)) for own in claim.filters)
    return replace(claim, filters=filters)


def test_a_claim_is_about_its_own_filter(car):
    own = Rms("sprung-mass acceleration", density=DENSITY, weight="Wk")
    claim = best_bound(car, SKYHOOK, own).claim
    assert prove(claim).proved
    louder = changed(claim, lambda f: {"c": [[x * Fraction(21, 20) for x in row] for row in f.c]})
    assert not prove(louder).proved
    unstable = changed(claim, lambda f: {"a": [[-x for x in row] for row in f.a]})
    assert not prove(unstable).proved
    with pytest.raises(FormatError, match="filters of 2"):
        prove(replace(claim, filters=claim.filters * 2))
    # without it more of the signal is left
    assert not prove(replace(claim, filters=())).proved
    shorter = changed(claim, lambda f: {"a": f.a[:-1], "b": f.b[:-1]})
    with pytest.raises((FormatError, ValueError)):
        prove(shorter)


def test_a_vector_has_weights_of_its_own(car):
    names = ("sprung-mass acceleration", "suspension deflection")
    vector = Rms(names, density=DENSITY, weight=["Wk", "none"])
    one, two = (Rms(y, density=DENSITY, weight=w) for y, w in zip(names, ("Wk", None), strict=True))
    corners = np.eye(4)
    squares = (sampled(car, SKYHOOK, own, corners).values ** 2 for own in (one, two))
    assert sampled(car, SKYHOOK, vector, corners).values == pytest.approx(np.sqrt(sum(squares)))
    assert vector.title == (
        "rms of [sprung-mass acceleration, suspension deflection] with weight [Wk, none]"
    )
    assert parse_specification(f"{vector.title} <= 2 with density 0.001") == replace(
        vector, at_most=2.0
    )


def test_a_relative_rms_is_of_two_weighted_loops(mass):
    law, plain = FixedGain([[0.0, -1.0]]), Rms("v", weight="Wd")
    bound = best_bound(mass, law, RelativeRms("v", weight="Wd"))
    each = (sampled(mass, own, plain, seeded(mass, 300)).values for own in (law, None))
    worst = np.divide(*each).max()
    assert worst * (1 - 1e-9) <= bound.level < 1.001 * worst
    document = bounds_file(analyse(mass, law, pf.HalfPlane(0)).certificate, [bound.claim])
    assert check_document(read(document.dumps()), None).answer == "proved"


def test_slopes_are_those_of_differences(car):
    own = Rms("sprung-mass acceleration", density=DENSITY, weight="Wk")
    alpha, step = np.eye(4)[:1], 1e-4
    channel = own.channel(car, alpha).in_units(np.array([0.02, 0.005, 0.5, 1.0]))
    assert channel.A.shape[-1] == 12
    d = np.array([0.02, 0.005, 0.5, 1.0])

    def value(K):
        return sampled(car, K, own, alpha).values[0]

    K = np.array([[500.0, 100.0, -1500.0, 200.0]])
    from polefence.response.modes import Modes

    A, B = car.at(alpha)
    modes = Modes((A / d[:, None] * d) + (B / d[:, None]) @ (K * d)[None])
    loops = channel.closed((K * d)[None], modes)
    found = own.slopes(loops)
    assert found.values[0] == pytest.approx(value(K), rel=1e-9)
    slopes = channel.slopes(found)[0, 0]
    for j in range(4):
        moved = K.copy()
        moved[0, j] += step * 1000
        back = K.copy()
        back[0, j] -= step * 1000
        by = (value(moved) - value(back)) / (2 * step * 1000)
        assert slopes[j] * d[j] == pytest.approx(by, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.usefixtures("hasty")
def test_a_law_is_one_of_the_plant_and_its_file_stands_alone(mass, order, tmp_path):
    structure = Structure(measured=("x",), schedule=(), order=order, largest_gain=1e3)
    own = Rms("v", weight="Wd")
    done = optimise(mass, own, [Rms("f", 4.0)], structure=structure)
    assert done.plant.shape[0] == 2 + order
    assert done.bounds[0].specification == own
    worst = sampled(done.plant, done.law, own).worst
    assert worst * (1 - 1e-9) <= done.bounds[0].level < 1.01 * worst
    data = json.loads(done.save(tmp_path).read_text())
    assert [len(v["A"]) for v in data["plant"]["vertices"]] == [2 + order] * 2
    design = pf.Design.load(tmp_path)
    assert design.proved
    assert design.plant.shape == done.plant.shape


def test_a_region_is_not_about_the_poles_of_filters(mass):
    # Wd has poles at 0.4 Hz to 100 Hz, far outside of this disk
    region = pf.Disk(-8, 7.5)
    done = optimise(mass, Rms("a", weight="Wd"), [], region, structure=Structure(schedule=()))
    assert done.design.proved
    assert np.abs(close(mass, done.law, np.eye(2)).poles() + 8).max() < 7.5


def test_samples_have_the_filter_of_a_held_signal(mass):
    own = Rms("v", density=2.0, weight="Wk")
    late = at_sample_time(mass, 0.01, 0)
    fine = sampled(mass, None, own).worst
    assert sampled(late, None, own).worst == pytest.approx(fine, rel=0.02)
    bound = best_bound(late, FixedGain([[0.0, 0.0]]), own)
    assert fine * 0.98 < bound.level < fine * 1.03
    assert bound.claim.filters[0] == behind_filter(late)


def behind_filter(plant):
    from polefence.requirements.weights import filters_of

    (own,) = filters_of(plant, Rms("v", weight="Wk"))
    return own


@pytest.mark.parametrize(("name", "T"), [("Wk", "1/20"), ("Wk", "1/200"), ("Wf", "1/3")])
def test_a_held_filter_has_the_doubles_nearest_to_its_exponential(name, T):
    """By the series as it is, in 150 decimal digits: so the same on every machine."""
    T = Fraction(T)
    A, B, C, _ = WEIGHTS[name].state_space()
    n = len(A)
    with localcontext(prec=150):
        step = Decimal(T.numerator) / T.denominator
        rows = [[Decimal(float(x)) * step for x in row] for row in np.hstack([A, B])]
        rows.append([Decimal(0)] * (n + 1))
        found = term = [[Decimal(int(i == j)) for j in range(n + 1)] for i in range(n + 1)]
        for k in range(1, 700):
            columns = list(zip(*rows, strict=True))
            term = [[sum(map(mul, row, own)) / k for own in columns] for row in term]
            found = [list(map(add, row, own)) for row, own in zip(found, term, strict=True)]
        assert max(abs(x) for row in term for x in row) < Decimal("1e-100")
    own = filter_of(WEIGHTS[name], T)
    for i in range(n):
        assert [float(x * T + (i == j)) for j, x in enumerate(own.a[i])] == [
            float(x) for x in found[i][:n]
        ]
        assert float(own.b[i][0] * T) == float(found[i][n])
    assert np.array_equal(np.array(own.c, dtype=float), C)


def test_parameters_may_move():
    moving = loads(MASS.replace("range = [30, 50]", "range = [30, 50]\nrate = [-5, 5]"))
    own = Rms("v", density=2.0, weight="Wk")
    bound = best_bound(moving, FixedGain([[0.0, -1.0]]), own)
    worst = sampled(moving, FixedGain([[0.0, -1.0]]), own).worst
    assert worst * (1 - 1e-9) <= bound.level < 1.3 * worst


def test_searches_know_the_weight(mass):
    own, limit = Rms("v", weight="Wd"), Rms("f", 4.0)
    structure = Structure(schedule=())
    found = tune(mass, structure, own, (limit,), pf.HalfPlane(0), ())[0]
    larger = behind(mass, found.law, own)
    assert found.level == pytest.approx(
        sampled(larger.plant, larger.law, larger.specification).worst, rel=1e-3
    )
    plain = tune(mass, structure, own.unweighted(), (limit,), pf.HalfPlane(0), ())[0]
    assert found.level <= sampled(mass, plain.law, own).worst * (1 + 1e-3)


def test_a_trade_off_writes_its_question_in_numbers(mass, tmp_path):
    own = Output("speed", "m/s", C=[0, Fraction(1, 3)])
    least, over = Rms("v", weight="Wd"), Rms(own, weight=None)
    structure = Structure(schedule=(), largest_gain=1e3)
    path = tmp_path / "front.json"
    front = tradeoff(mass, least, over, [0.2], structure=structure, path=path)
    assert front.proved
    text = path.read_text()
    assert "Fraction" not in text
    data = json.loads(text)["question"]
    assert data["minimise"]["weight"] == "Wd"
    assert data["over"]["signal"] == "speed"
    assert front.rows[0]["bounds"][0]["proved"] <= 0.2
    assert "with weight Wd" in front.labels[1]
    again = tradeoff(mass, least, over, [0.2], structure=structure, path=path, resume=True)
    assert again.rows == front.rows
    other = replace(over, signal=replace(own, C=[0, Fraction(1, 4)]))
    with pytest.raises(InputError, match="remove the file to start anew"):
        tradeoff(mass, least, other, [0.2], structure=structure, path=path, resume=True)
