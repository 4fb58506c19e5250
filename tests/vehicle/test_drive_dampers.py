"""Drives with controllable dampers: limits of the force, a coefficient held, a bound kept."""

import numpy as np
import pytest

from polefence import InputError, semi_active
from polefence.examples import family
from polefence.requirements.rms import Rms
from polefence.response.discrete import Sampling
from polefence.vehicle import (
    Actuator,
    Damper,
    Hardware,
    Measured,
    disturbed,
    drive,
    excited,
    on_road,
    random_road,
    velocity_density,
)

DAMPER = Damper("damper force", "suspension deflection", 300, 3000)
SIGNALS = ["sprung-mass acceleration", "tyre share"]


@pytest.fixture(scope="module")
def plant():
    return family("semi-active")


@pytest.fixture(scope="module")
def road(plant):
    return on_road(plant, random_road("C", 200, seed=3), 20.0, 0.001)


def rate_of(found):
    x = found.states
    return x[..., 3] - x[..., 2]


def test_a_law_gets_what_the_damper_can_give(plant, road):
    K = np.array([[-5000.0, -3800, -3300, 450]])
    found = drive(plant, K, road, hardware=Hardware(dampers=(DAMPER,)))
    v, u = rate_of(found), found.applied[..., 0]
    wanted = (found.states @ K.T)[..., 0]
    assert found.demanded[..., 0] == pytest.approx(wanted)
    assert u == pytest.approx(
        np.clip(wanted, np.minimum(300 * v, 3000 * v), np.maximum(300 * v, 3000 * v))
    )
    assert 0.1 < np.mean(np.isclose(u, wanted)) < 0.9
    assert any("the damper gives what is demanded" in note for note in found.notes)


@pytest.mark.parametrize(("c", "demand"), [(300, -1e4), (3000, 1e4), (1200, 1200)])
def test_a_damper_that_is_told_one_thing_is_one_that_stays(plant, road, c, demand):
    """Against the same damper as a linear law, by another way through the drive."""
    rate = np.array([[0.0, 0, -1, 1]])
    found = drive(plant, demand * rate, road, hardware=Hardware(dampers=(DAMPER,)))
    linear = drive(plant, c * rate, road)
    assert found.states == pytest.approx(linear.states, rel=1e-7, abs=1e-10)


def test_no_law_is_the_lowest_coefficient(plant, road):
    found = drive(plant, None, road, hardware=Hardware(dampers=(DAMPER,)))
    linear = drive(plant, np.array([[0.0, 0, -300, 300]]), road)
    assert found.states == pytest.approx(linear.states, rel=1e-7, abs=1e-10)


def test_a_sampled_controller_holds_the_coefficient(plant, road):
    K = np.array([[-5000.0, -3800, -3300, 450]])
    hardware = Hardware(sampling=Sampling(0.005), dampers=(DAMPER,))
    found = drive(plant, K, road, hardware=hardware)
    v, u = rate_of(found)[0], found.applied[0, :, 0]
    moving = np.abs(v) > 1e-3
    c = np.where(moving, u / np.where(moving, v, 1), np.nan)
    assert np.nanmin(c) >= 300 * (1 - 1e-9)
    assert np.nanmax(c) <= 3000 * (1 + 1e-9)
    for k in range(0, len(c) - 5, 5):
        own = c[k : k + 5]
        assert np.nanmax(own) - np.nanmin(own) < 1e-6 * 3000 or np.isnan(own).all()
    short = drive(plant, K, road, hardware=Hardware(sampling=Sampling(0.001), dampers=(DAMPER,)))
    free = drive(plant, K, road, hardware=Hardware(dampers=(DAMPER,)))
    size = np.abs(free.states).max()
    errors = [np.abs(own.states - free.states).max() / size for own in (short, found)]
    assert errors[0] < errors[1] < 0.3
    assert errors[0] < 0.05


def test_a_proved_bound_holds_on_a_long_road(plant):
    density = velocity_density("C", 20)
    law = semi_active(plant, Rms(SIGNALS, density=density), [DAMPER], 4)
    long = on_road(plant, random_road("C", 4000, seed=1), 20.0, 0.002)
    masses = [{"m1": m} for m in (288.9, 330.0, 388.9)]
    found = drive(plant, law.K, long, masses, Hardware(dampers=(DAMPER,)))
    values = found.response(SIGNALS).values
    rms = np.sqrt(np.mean(np.sum(values**2, axis=2), axis=1))
    assert np.all(rms < law.level)


def test_the_step_is_short_enough_for_all_dampers_at_their_bounds():
    plant, ends = family("half-car"), ("front", "rear")
    dampers = [Damper(f"{own} force", f"{own} suspension deflection", 300, 9000) for own in ends]
    alpha = np.full(len(plant.A), 1 / len(plant.A))
    A, B = plant.at(alpha)
    rates = np.array([[float(x) for x in own.of(plant).rate[0][0]] for own in dampers])

    def fastest(c):
        return np.abs(np.linalg.eigvals(A + B @ (np.array(c)[:, None] * rates))).max()

    bound = 1 / fastest([9000, 9000])
    assert bound < min(1 / fastest([9000, 0]), 1 / fastest([0, 9000]))
    for share, fits in ((1.01, False), (0.99, True)):
        moved = excited(plant, 10 * bound, share * bound, {"front road velocity": 1.0})
        hardware = Hardware(dampers=dampers)
        if fits:
            drive(plant, None, moved, hardware=hardware)
        else:
            with pytest.raises(InputError, match="step"):
                drive(plant, None, moved, hardware=hardware)


def test_lost_cars_do_not_count_among_what_a_damper_gave(plant, road):
    push = np.array([[0.0, 0, -1500, 1500]])
    found = drive(plant, push, road, hardware=Hardware(dampers=(DAMPER,)))
    assert "damper force: the damper gives what is demanded 100% of the time" in found.notes
    for start, said in (([[1e10, 0, 0, 0], [0.01, 0, 0, 0]], 1), ([[1e10, 0, 0, 0]], 0)):
        moved = disturbed(plant, np.zeros((200, 1)), 0.001, start=start)
        masses = [{"m1": 300.0}] * len(start)
        found = drive(plant, push, moved, masses, Hardware(dampers=(DAMPER,)))
        assert np.isnan(found.states[0, -1]).all()
        notes = [own for own in found.notes if own.startswith("damper force")]
        assert len(notes) == said
        assert all("100%" in own for own in notes)


def test_what_does_not_go_together_is_refused(plant, road):
    with pytest.raises(InputError, match="controllable dampers go without an actuator's bandwidth"):
        Hardware(actuator=Actuator(bandwidth=10), dampers=(DAMPER,))
    with pytest.raises(InputError, match="no signal 'force'"):
        wrong = Damper("force", "suspension deflection", 1, 2)
        drive(plant, None, road, hardware=Hardware(dampers=(wrong,)))
    assert Hardware(scheduling=Measured(delay=0.1), dampers=[DAMPER]).dampers == (DAMPER,)
