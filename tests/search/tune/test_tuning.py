"""The search against what is known: Riccati equations, special cases, bounds on gains, regions."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

import polefence as pf
from polefence.base.errors import InputError
from polefence.law.laws import FixedGain, PolynomialGain
from polefence.law.structure import Structure
from polefence.lmi.conditions.target import Decays, Disks, Sectors
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
)
from polefence.requirements.gain import Gain
from polefence.requirements.gain_norm import GainNorm
from polefence.requirements.rms import Rms
from polefence.search.tune.tuner import tune, tune_region
from support.specs import TWO_STATES, rms

FIXED = Structure(schedule=())


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "two.toml"
    path.write_text(TWO_STATES)
    return pf.load(path)


def poles(plant, law, count=1000):
    alpha = seeded(plant, count)
    A, B = plant.at(alpha)
    return np.linalg.eigvals(A + B @ law.gain(alpha))


def effort(plant, at_most):
    return rms("force", at_most)


def test_of_one_plant_and_all_states_it_is_the_riccati_equations_law():
    random = np.random.default_rng(4)
    A, B = random.normal(size=(4, 4)), random.normal(size=(4, 2))
    E = random.normal(size=(4, 2))
    plant = pf.UncertainPlant.from_vertices([A], [B], [E])
    signals = [Output(f"x{k}", "", C=np.eye(4)[k]) for k in range(4)]
    signals += [Output(f"u{k}", "", D=np.eye(2)[k]) for k in range(2)]
    own = tune(plant, FIXED, Rms(signals, density=2.0))[0]
    P = solve_continuous_are(A, B, np.eye(4), np.eye(2))
    assert own.kept
    assert isinstance(own.law, FixedGain)
    least = float(np.sqrt(np.trace(E.T @ P @ E)))
    assert least * (1 - 1e-9) <= own.level <= least * 1.002
    assert own.bounded_by == ""


def test_a_gain_comes_near_its_known_least():
    # x' = x + u + w, z = (x, u): the least gain is the root of 2, of no law's; K runs off
    plant = pf.UncertainPlant.from_vertices([[[1.0]]], [[[1.0]]], [[[1.0]]])
    signals = [Output("x", "", C=[1.0]), Output("u", "", D=[1.0])]
    own = tune(plant, FIXED, Gain(signals))[0]

    def gain(K):  # largest at zero frequency
        return np.sqrt(1 + K * K) / (-K - 1)

    (K,) = own.law.K[0]
    assert own.level == pytest.approx(gain(K), rel=1e-6)
    assert own.level <= 1.05


def test_fewer_limits_and_more_freedom_are_never_worse(plant):
    ride, limits = rms("x"), [rms("force", 1.2), rms("v", 0.9)]
    both = tune(plant, FIXED, ride, limits)[0]
    one = tune(plant, FIXED, ride, limits[:1], starts=[both.law])[0]
    none = tune(plant, FIXED, ride, [rms("force", 1.5)], starts=[one.law])[0]
    assert both.kept
    assert one.kept
    assert one.level <= both.level * (1 + 1e-9)
    assert none.level <= one.level * (1 + 1e-9)
    speed = Structure(measured=("v",), schedule=())
    less = tune(plant, speed, ride, limits[:1])[0]
    more = tune(plant, FIXED, ride, limits[:1], starts=[less.law])[0]
    affine = tune(plant, Structure(), ride, limits[:1], starts=[more.law])[0]
    assert less.level >= more.level * (1 - 1e-9)
    assert affine.level <= more.level * (1 + 1e-9)


def test_limits_are_kept_where_nothing_was_looked_at(plant):
    limit = rms("force", 1.2)
    found = tune(plant, Structure(), rms("x"), [limit], HalfPlane(0.2))
    assert any(isinstance(each.law, PolynomialGain) for each in found)
    own = found[0]
    alpha = seeded(plant, 500)
    assert own.kept
    assert limit.values(plant, own.law, alpha).max() <= 1.2 * (1 + 1e-6)
    worst = rms("x").values(plant, own.law, alpha).max()
    assert worst <= own.level * (1 + 2e-4)
    assert poles(plant, own.law).real.max() < -0.2
    at = rms("x").values(plant, own.law, own.alpha[None])
    assert at[0] == pytest.approx(own.level, rel=1e-6)


def test_without_anything_to_minimise_the_law_is_small(plant):
    (nothing,) = tune(plant, FIXED, None)
    assert nothing.kept
    assert not nothing.law.K.any()
    some = tune(plant, FIXED, None, region=HalfPlane(0.5))[0]
    more = tune(plant, FIXED, None, region=HalfPlane(1))[0]
    assert some.kept
    assert more.kept
    assert 0 < some.level < more.level


def test_a_gain_that_runs_off_is_stopped_and_says_so(plant):
    free = tune(plant, FIXED, rms("x"))[0]
    assert "poles of at most" in free.bounded_by
    own = tune(plant, Structure(schedule=(), largest_gain=5.0), rms("x"))[0]
    assert own.bounded_by == ""
    assert np.abs(own.law.K).max() <= 5 * (1 + 1e-6)
    assert free.level < own.level
    norm = tune(plant, FIXED, rms("x"), [GainNorm(4.0)])[0]
    assert np.linalg.norm(norm.law.K, 2) <= 4 * (1 + 1e-6)


REGIONS = [
    Disk(-2, 1.5),
    HalfPlane(1) & Sector(0.7),
    VerticalStrip(-4, -0.5),
    HorizontalStrip(1.5) & HalfPlane(0.3),
    Ellipse(-2, 1.9, 1),
]


@pytest.mark.parametrize("region", REGIONS, ids=str)
def test_a_region_of_every_part_is_kept(region, plant):
    own = tune(plant, FIXED, None, region=region)[0]
    assert own.kept
    assert region.distance(poles(plant, own.law)).max() < 0


GOALS = [
    (Disks(-2), lambda z: np.abs(z + 2)),
    (Decays(3), lambda z: 3 + z.real),
    (Decays(0), lambda z: z.real),
    (Sectors(1), lambda z: np.where(z.real < 0, np.abs(z.imag) / np.abs(z.real - 1e-30), np.inf)),
]


@pytest.mark.parametrize(("goal", "r"), GOALS, ids=lambda own: type(own).__name__)
def test_regions_are_smaller_than_any_gain_of_a_grid_has_them(goal, r, plant):
    own = tune_region(plant, Structure(schedule=(), largest_gain=12.0), goal)[0]
    assert own.kept
    assert own.level == pytest.approx(r(poles(plant, own.law)).max(), rel=2e-3, abs=1e-6)
    alpha = seeded(plant, 40)
    A, B = plant.at(alpha)
    each = np.linspace(-12, 12, 49)
    gains = np.array([[[a, b]] for a in each for b in each])
    loops = A + B @ gains[:, None]
    least = r(np.linalg.eigvals(loops)).max(axis=(1, 2)).min()
    assert own.level <= least + 1e-3 * abs(least) + 1e-6


def test_a_decay_rate_is_found_in_any_unit_of_time(plant):
    slow = pf.UncertainPlant.from_vertices(plant.A / 1024, plant.B / 1024)
    own = [
        tune_region(each, Structure(schedule=(), largest_gain=12.0), Decays(0))[0].level
        for each in (plant, slow)
    ]
    assert own[1] * 1024 == pytest.approx(own[0], rel=5e-3)


def test_a_pattern_holds():
    A = np.array([[0.0, 1.0, 0.3, 0.0], [-1, -0.1, 0, 0], [0.3, 0, 0, 1], [0, 0, -1, -0.1]])
    B = np.array([[0.0, 0], [1, 0], [0, 0], [0, 1]])
    plant = pf.UncertainPlant.from_vertices([A, 1.1 * A], [B, B], [np.eye(4)] * 2)
    sides = Structure(schedule=(), pattern=(("a", "b", "0", "0"), ("0", "0", "a", "b")))
    own = tune(plant, sides, None, region=HalfPlane(0.3))[0]
    assert own.kept
    assert own.law.K[0, :2] == pytest.approx(own.law.K[1, 2:])
    assert not own.law.K[0, 2:].any()
    assert not own.law.K[1, :2].any()


def test_of_a_plant_in_discrete_time_regions_are_kept():
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    plant = pf.UncertainPlant.from_vertices([A, A], [B, 1.2 * B], sample_time=0.1)
    own = tune(plant, FIXED, None, region=Disk(0.4, 0.55))[0]
    assert own.kept
    assert np.abs(poles(plant, own.law) - 0.4).max() < 0.55


def test_what_does_not_fit_is_refused(plant):
    with pytest.raises(InputError, match="no signal"):
        tune(plant, Structure(measured=("nothing",)), rms("x"))
    with pytest.raises(InputError, match="limit of 'v' is missing"):
        tune(plant, FIXED, rms("x"), [rms("v")])


def test_limits_that_nothing_keeps_leave_the_nearest(plant):
    found = tune(plant, FIXED, rms("x"), [rms("v", 1e-3), rms("force", 1e-2)])
    assert found
    assert not any(own.kept for own in found)


def test_the_same_question_has_the_same_answer(plant):
    one, two = (tune(plant, FIXED, rms("x"), [rms("force", 1.2)]) for _ in range(2))
    assert [own.level for own in one] == [own.level for own in two]


def test_a_pole_on_the_edge_is_not_in_the_region():
    # no law is needed but for the pole at zero
    plant = pf.UncertainPlant.from_vertices([np.diag([0.0, -1])], [np.eye(2)])
    own = tune(plant, FIXED, None)[0]
    assert own.kept
    assert own.law.K[0, 0] < 0
    assert poles(plant, own.law).real.max() < 0


def test_what_a_law_cannot_move_is_not_kept():
    plant = pf.UncertainPlant.from_vertices([np.diag([0.5, -1])], [[[0.0], [1.0]]])
    assert not any(own.kept for own in tune(plant, FIXED, None))
