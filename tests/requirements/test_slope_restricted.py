"""Elements whose slope is in a sector: multipliers of Zames and Falb, against the criterion."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.law.structure import Structure
from polefence.plant.exact import file_plant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.work import FormatError
from polefence.requirements import multipliers
from polefence.requirements.sector import SectorBound
from polefence.requirements.text import parse_specification
from polefence.response.modes import Modes
from support.elements import with_elements
from support.files import is_accepted
from support.specs import MASS_ON_SPRING

GAIN = np.array([[-20.0, -4.0]])


def asked(signal="position", disturbance="push", sector=(-30, 50), at_least=1.0, restricted=True):
    own = {"slope_restricted": restricted}
    return SectorBound.least(signal, disturbance, sector, at_least, **own)


def rational(over, under):
    """The plant of y = over / under w, its own law zero."""
    n = len(under) - 1
    A, E, C = np.eye(n, k=1), np.eye(n)[:, -1:], np.zeros(n)
    A[-1], C[: len(over)] = -np.array(under[1:])[::-1], over[::-1]
    plant = pf.UncertainPlant.from_vertices([A], [E], [E])
    return plant, pf.FixedGain(np.zeros((1, n))), Output("y", "", C=C)


def is_kept(plant, law, y, k, restricted=True):
    own = SectorBound(y, 1.0, disturbance="w1", sector=[-k, 0], slope_restricted=restricted)
    return kept_bound(plant, law, own) is not None


# --- against theory ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("over", "under", "edge"),
    [
        ([1, -0.2, -0.1], [1, 2, 1, 1], 4.5894),
        ([-1, 0.2, 0.1], [1, 2, 1, 1], 1.0894),
    ],
)
def test_published_examples_are_proved_up_to_the_numbers_that_fail(over, under, edge):
    """Carrasco, Turner and Heath (European Journal of Control 28, 2016), the first two.

    The circle criterion has 1.24 and 0.76.
    """
    plant, law, y = rational(over, under)
    A, E = (np.array(M, float) for M in (plant.vertices[0].A, plant.vertices[0].E))
    C = np.zeros(len(A))
    C[:3] = over[::-1]
    for share, stable in ((0.999, True), (1.001, False)):
        poles = np.linalg.eigvals(A - share * edge * np.outer(E[:, 0], C))
        assert bool(poles.real.max() < 0) is stable
    assert is_kept(plant, law, y, 0.9995 * edge)
    assert not is_kept(plant, law, y, 1.0005 * edge)
    assert not is_kept(plant, law, y, 0.8 * edge, restricted=False)


def first_order_edge(G, s):
    """The largest k of slopes [0, k] of w = -phi(y) by a grid of first-order multipliers."""
    best = 0.0
    for B in np.geomspace(1e-2, 1e2, 81):
        for B, h in ((sign * B, h) for sign in (1, -1) for h in 1 - np.geomspace(1e-3, 1, 31)):
            M = 1 - h * B / (B + s)
            best = max(best, 1 / max(1e-9, (-(M * G).real / M.real).max()))
    return best


@pytest.mark.parametrize("seed", range(6))
def test_it_is_zames_and_falbs_criterion_of_first_order(seed):
    """No worse than a fine grid of multipliers, on random plants whose elements enter rates."""
    random = np.random.default_rng(seed)
    n = 3 + seed % 3
    S = random.normal(size=(n, n))
    A = 2 * (S - S.T) + 0.3 * random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.4) * np.eye(n)
    E, C = random.normal(size=(n, 1)), random.normal(size=n)
    w = np.concatenate([[0], np.geomspace(1e-3, 1e3, 4000), np.linspace(0.01, 12, 4000)])
    s = 1j * w
    G = (C @ np.linalg.solve(s[:, None, None] * np.eye(n) - A, E.astype(complex)))[:, 0]
    edge, circle = first_order_edge(G, s), 1 / max(1e-9, -(G.real).min())
    assert edge >= circle * (1 - 1e-6)
    edge = min(edge, 1e3)  # where no slope is too steep
    plant = pf.UncertainPlant.from_vertices([A], [np.ones((n, 1))], [E])
    law, y = pf.FixedGain(np.zeros((1, n))), Output("y", "", C=C)
    assert is_kept(plant, law, y, 0.998 * edge)
    assert edge == 1e3 or not is_kept(plant, law, y, 1.02 * edge)


def supplied(a, b, phi, rho, y, step):
    """The integral of yt^2 - zt^2 to each time, of a filter that only this test knows."""
    sign, fall, total = np.sign(b), 0.0, [0.0]
    for now in y:
        z = phi(now)
        zt = z - fall
        yt = rho * now - sign * fall
        total.append(total[-1] + step * (yt**2 - zt**2))
        fall += step * (-a * fall + b * rho * now + abs(b) * zt)
    return np.array(total)


@pytest.mark.parametrize("seed", range(20))
def test_no_curve_of_such_slopes_supplies_less_than_nothing(seed):
    """The integral by which the proof stands, to every time, for signals that nothing bounds."""
    random = np.random.default_rng(seed)
    rho, a, step = random.uniform(0.5, 3), random.uniform(0.3, 3), 2e-3
    t = np.arange(0, 12, step)
    y = (random.normal(size=(6, 1)) * np.sin(random.uniform(0.2, 6, (6, 1)) * t + 1)).sum(axis=0)
    knots = np.sort(random.uniform(-6, 6, 12))
    rise = random.uniform(-rho, rho, 13)  # slopes between knots
    at = np.concatenate([[-8.0], knots, [8.0]])
    values = np.concatenate([[0], np.cumsum(rise * np.diff(at))])
    values -= np.interp(0.0, at, values)
    least = {}
    for b in (a, -a, 2.5 * a, -2.5 * a):
        # the filter without l fed back is that of rate a + |b|
        total = supplied(a, b, lambda x: np.interp(x, at, values), rho, y, step)
        least[b / a] = total.min() / np.abs(total).max()
    assert min(least[1.0], least[-1.0]) > -5e-3  # of the steps
    switching = [
        supplied(a, b, lambda x: rho * x * np.sign(np.sin(7 * x)), rho, y, step) for b in (a, -a)
    ]
    assert min(total.min() / np.abs(total).max() for total in switching) < -5e-3


def made(seed, count=1):
    """A stable family of two vertices whose elements enter the rates of their signals."""
    return with_elements(seed, count, entering=True, slope_restricted=True)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_proved_is_nearer_to_the_numbers_that_fail(seed):
    """Never below what the circle criterion has, and no number in a proved sector fails."""
    (_, _, _, K), plant, own, _ = made(seed, 1 + seed % 2)
    law = pf.FixedGain(K)
    bound = best_bound(plant, law, own)
    circle = best_bound(plant, law, replace(own, slope_restricted=False))
    assert bound.level <= circle.level
    assert bound.level < 1.01 * sampled(plant, law, own, seeded(plant, 60)).worst
    fails = min(own.linear(plant, law, seeded(plant, 60))[0])
    assert 1 / bound.level <= fails * (1 + 1e-6)
    if any(bound.claim.elements.lags):
        assert bound.level < 0.9995 * circle.level


def test_most_random_families_gain():
    gains = []
    for seed in range(12):
        (*_, K), plant, own, _ = made(seed, 1 + seed % 2)
        levels = [
            sampled(plant, pf.FixedGain(K), replace(own, slope_restricted=x), seeded(plant, 20))
            for x in (False, True)
        ]
        gains.append(levels[0].worst / levels[1].worst)
    assert min(gains) > 0.999
    assert np.median(gains) > 1.02


@pytest.mark.parametrize("seed", range(3))
def test_a_level_is_the_gain_of_the_loop_that_is_accepted(seed):
    """Of d^-1 zt to d yt, by the transfer function of the multiplier, on a fine grid."""
    (*_, K), plant, own, _ = made(seed, 2)
    channel = own.channel(plant, np.eye(2))
    loops = channel.closed(np.stack([K, K]), Modes(channel.A + channel.B @ K))
    (best,) = multipliers.found(loops, (False, False), (True, True))
    m, L = best.multipliers, best.level
    assert m.h.any()
    w = np.concatenate([[0], np.geomspace(1e-2, 1e2, 4000)])
    s, highest, eye = 1j * w[:, None], -np.inf, np.eye(2)
    M = np.where(m.h > 0, 1 - m.h * m.B / (m.B + s + (m.h == 0)), 1.0)
    D = np.exp(2 * m.d)
    for A, own_E, C in zip(loops.A, loops.E, loops.C, strict=True):
        G = C @ np.linalg.solve(s[:, :, None] * np.eye(len(A)) - A, own_E.astype(complex))
        for x, weight in zip(G / L, D * M, strict=True):
            form = (x - eye).conj().T @ np.diag(weight) @ (x + eye)
            highest = max(highest, np.linalg.eigvalsh(form + form.conj().T).max())
    assert abs(highest) < 1e-4  # at the level it is just not positive any more


# --- every kind of plant -------------------------------------------------------------------------

FUNCTIONS = MASS_ON_SPRING.replace("range = [80, 120]", "range = [0, 1]").replace(
    '"-k"', '"-90*cos(k)"'
)
SENSED = MASS_ON_SPRING + (
    '[outputs]\n"mixed" = {C = [1, 0.5], F = [0.02]}\n"sent" = {C = [1, 0.2], D = [0.01]}\n'
    '"stretch" = {C = ["k/100", 0.1]}\naccelerometer = {C = ["-k", -2], D = [1], F = [1]}\n'
    '"backward" = {C = [1, -0.3]}\n'
)


@pytest.mark.parametrize("signal", ["sent", "stretch", "backward"])
@pytest.mark.parametrize(
    "more",
    ["", "rate = [-5, 5]\n", 'rate = "any"\n'],
)
def test_signals_without_popovs_multiplier_have_a_lag(signal, more):
    """Of rates that the force enters, with inputs or parameters in them."""
    plant = loads(SENSED.replace("range = [80, 120]\n", f"range = [80, 120]\n{more}"))
    law, own = pf.FixedGain(GAIN), asked(signal, "push", [-40, 40], None)
    bound = best_bound(plant, law, own)
    still = best_bound(plant, law, replace(own, slope_restricted=False, time_invariant=True))
    assert bound.level <= still.level
    if "any" not in more:
        assert any(b for _, b in bound.claim.elements.lags)
        assert bound.level < 0.97 * still.level
    fails = own.linear(plant, law, seeded(plant, 60))[0].min()
    assert 1 / bound.level <= fails * (1 + 1e-6)
    said = bound.claim.statement(file_plant(plant))
    assert "every phi with phi(0) = 0 and (phi(y1) - phi(y2)) / (y1 - y2) from a to b" in said
    assert "that does not depend on time" in said
    assert not bound.claim.bare.elements.lags
    assert bound.claim.bare.restricted


@pytest.mark.parametrize(
    "text",
    [
        MASS_ON_SPRING.replace("E = [[0], [1]]", "E = [[0.1], [1]]"),
        MASS_ON_SPRING.replace("E = [[0], [1]]", 'E = [[0.1], ["k/80"]]'),
        FUNCTIONS.replace("E = [[0], [1]]", "E = [[0.1], [1]]"),
        FUNCTIONS.replace("E = [[0], [1]]", 'E = [[0.1], ["2 + sin(k)"]]'),
        FUNCTIONS.replace("[0, 1], [", '["0.01*cos(k)", 1], ['),
    ],
)
def test_of_every_kind_of_plant_it_proves_more(text):
    plant, law = loads(text), pf.FixedGain(GAIN)
    bound = best_bound(plant, law, asked(at_least=None))
    still = best_bound(plant, law, replace(asked(at_least=None), slope_restricted=False))
    assert any(b for _, b in bound.claim.elements.lags)
    assert bound.level < 0.97 * still.level
    fails = asked().linear(plant, law, seeded(plant, 60))[0].min()
    assert 1 / bound.level < fails * (1 + 1e-6)


@pytest.mark.parametrize("measured", [("mixed", "velocity"), ("accelerometer without inputs",)])
def test_what_a_law_measures_has_the_force_of_the_element(measured):
    plant = loads(SENSED)
    K = np.array([[-5.0, -2.0][: len(measured)]]) / (1 if len(measured) > 1 else 50)
    law = Structure(measured=measured, schedule=()).law(plant, K[None])
    own = asked("velocity", sector=(-3, 1), at_least=None)
    bound = best_bound(plant, law, own)
    still = best_bound(plant, law, replace(own, slope_restricted=False))
    assert bound.level <= still.level
    own = asked("backward", sector=(-30, 30), at_least=None)
    bound = best_bound(plant, law, own)
    assert any(b for _, b in bound.claim.elements.lags)
    assert bound.level < 0.97 * best_bound(plant, law, replace(own, slope_restricted=False)).level
    fails = own.linear(plant, law, seeded(plant, 60))[0].min()
    assert 1 / bound.level < fails * (1 + 1e-6)


def test_a_position_has_what_popov_proves():
    plant, law = loads(MASS_ON_SPRING), pf.FixedGain(GAIN)
    popov = replace(asked(at_least=None), slope_restricted=False, time_invariant=True)
    bound = best_bound(plant, law, asked(at_least=None))
    assert bound.level <= best_bound(plant, law, popov).level * (1 + 1e-4)


def test_in_discrete_time_there_is_none():
    text = (
        SENSED.replace("[parameter.k]", "sample_time = 0.01\n[parameter.k]")
        .replace('A = [[0, 1], ["-k", -2]]', 'A = [[1, 0.01], ["-0.01*k", 0.98]]')
        .replace("B = [[0], [1]]", "B = [[0], [0.01]]")
        .replace("E = [[0], [1]]", "E = [[0], [0.01]]")
    )
    plant, law, own = loads(text), pf.FixedGain(GAIN), asked("backward", "push", [-4, 4], None)
    claim = best_bound(plant, law, own).claim
    assert not claim.elements.lags
    wrong = replace(claim, elements=replace(claim.elements, lags=((Fraction(1), Fraction(1)),)))
    with pytest.raises(FormatError, match="in discrete time there are none"):
        wrong.require()


# --- files ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(SENSED), tmp_path_factory.mktemp("file")
    law, limit = pf.FixedGain(GAIN), asked("backward", "push", [-40, 40], None)
    least = best_bound(plant, law, limit).level
    limit = replace(limit, at_most=least * 1.003)
    assert kept_bound(plant, law, replace(limit, slope_restricted=False)) is None
    pf.analyse(plant, law, pf.parse_region("half_plane(0)"), limits=[limit]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_accepted(document)
    return document


def pair(x):
    return [float(Fraction(y)) for y in x[0]]


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda x: float(Fraction(x)) * 0.97),
        ("level", lambda _: 0),
        ("lags", lambda x: [[pair(x)[0], -pair(x)[1]]]),
        ("lags", lambda x: [[pair(x)[0], 0]]),
        ("lags", lambda x: [[0.2 * y for y in pair(x)]]),
        ("lags", lambda x: [[0.9 * abs(pair(x)[1]), pair(x)[1]]]),
        ("lags", lambda x: [[-y for y in pair(x)]]),
        ("lags", lambda x: [x[0], x[0]]),
        ("lags", lambda x: [[*x[0], 1]]),
        ("lags", lambda _: [["nan", 1]]),
        ("lags", lambda _: None),
        ("restricted", lambda _: False),
        ("restricted", lambda _: None),
        ("restricted", lambda _: 1),
        ("invariant", lambda _: False),
        ("invariant", lambda _: None),
        ("multipliers", lambda _: [0.01]),
        ("weights", lambda _: [-1]),
        ("sectors", lambda _: [[-60, 40]]),
        ("sectors", lambda _: [[-40, 400]]),
        ("disturbances", lambda _: [2]),
        ("outputs", lambda x: [x[0] | {"C": [[1, -0.5]]}]),
        ("outputs", lambda x: [x[0] | {"C": [[-1, 0.3]]}]),
    ],
)
def test_one_fault_in_a_file_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document))
    claim = next(own for own in table["claims"] if own["kind"] == "sector")
    value = change(claim.get(key))
    claim[key] = value
    if value is None:
        del claim[key]
    assert not is_accepted(table)


def test_an_element_has_a_lag_or_a_multiplier():
    plant, law = loads(SENSED), pf.FixedGain(GAIN)
    claim = best_bound(plant, law, asked("backward", "push", [-40, 40], None)).claim
    both = replace(claim.elements, multipliers=(Fraction(1),))
    with pytest.raises(FormatError, match="one or the other"):
        replace(claim, elements=both).require()
    with pytest.raises(FormatError, match="from -a to a"):
        wide = replace(claim.elements, lags=((Fraction(1), Fraction(-2)),))
        replace(claim, elements=wide).require()


# --- how it is asked -----------------------------------------------------------------------------


def test_a_line_says_it():
    text = "sector of position >= 1 with disturbance [push] with sector [-1, 2]"
    own = parse_specification(f"{text} with slope_restricted true")
    assert own.slope_restricted
    assert own.stays
    assert "with slope_restricted true" in own.title
    with pytest.raises((InputError, SpecError), match="slope_restricted = 3"):
        parse_specification(f"{text} with slope_restricted 3")
