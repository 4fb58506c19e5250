"""Drives in the compiled kernel and in NumPy: the same motion, whatever stands beside the plant."""

import numpy as np
import pytest

from polefence import Disk, Scheduled, place
from polefence.examples import family, spec_path
from polefence.plant.family import UncertainPlant
from polefence.plant.spec import load_car
from polefence.response.discrete import Sampling
from polefence.vehicle import (
    Actuator,
    BumpStops,
    Damper,
    Estimated,
    Hardware,
    Jump,
    Measured,
    Sensors,
    Sine,
    disturbed,
    drive,
    excited,
    lqr,
    on_road,
    random_road,
)
from polefence.vehicle.driving import compiled
from polefence.vehicle.driving import drive as driving

pytestmark = pytest.mark.skipif(compiled.compiled() is None, reason="built without a compiler")

ARRAYS = ["states", "rates", "demanded", "applied", "stop_forces", "parameters", "used"]
LIMIT, STOPS = Actuator(limit=250.0), BumpStops(0.02, 0.015, 2e5, 300.0)
TIGHT = BumpStops(0.002, 0.0015, 2e5, 300.0)
CARS = [{"m1": m, "beta": b} for m in (240.0, 300.0, 340.0) for b in (-10.0, 0.0, 8.0)]
MOVING = [
    {"m1": Jump(0.2, 250.0, 330.0), "beta": Sine(0, 8, 1.0)},
    {"m1": 300.0, "beta": Sine(2, 7, 2.0, 0.3)},
]


@pytest.fixture(scope="module")
def scheduled(physical):
    return place(physical, Disk(-40, 31), Scheduled(1, 0, "box"))


@pytest.fixture(scope="module")
def road(physical):
    return on_road(physical, random_road("D", 100, seed=1), 20.0, 5e-4, 0.6)


def both(monkeypatch, *arguments):
    """The same drive by the kernel and by NumPy."""
    found = drive(*arguments)
    with monkeypatch.context() as patch:
        patch.setattr(driving, "compiled", lambda: None)
        return found, drive(*arguments)


def require_alike(found, other, rel=1e-9):
    for name in ARRAYS:
        own, theirs = (np.asarray(getattr(each, name)) for each in (found, other))
        assert own.shape == theirs.shape, name
        size = np.nanmax(np.abs(theirs), axis=(0, 1), initial=1e-9)
        assert np.array_equal(np.isnan(own), np.isnan(theirs)), name
        assert np.nanmax(np.abs(own - theirs) / size, initial=0.0) < rel, name
    assert np.array_equal(found.disturbance, other.disturbance)
    assert [(e.kind, e.car) for e in found.events] == [(e.kind, e.car) for e in other.events]


@pytest.mark.parametrize(
    "hardware",
    [
        Hardware(),
        Hardware(actuator=LIMIT),
        Hardware(stops=STOPS),
        Hardware(actuator=Actuator(15.0, 250.0), stops=STOPS, gravity=9.81),
        Hardware(sampling=Sampling(0.002), actuator=LIMIT, stops=STOPS),
        Hardware(sampling=Sampling(0.002, delay=1), actuator=Actuator(30.0)),
        Hardware(sampling=Sampling(0.002, delay=1.3), actuator=LIMIT, stops=STOPS),
        Hardware(sampling=Sampling(0.002, delay=0.5), actuator=Actuator(30.0)),
        Hardware(Measured(0.004, 0.01, {"m1": 5.0}, seed=2), actuator=LIMIT),
        Hardware(Measured(noise={"beta": 1.0}), Sampling(0.0015), LIMIT),
    ],
    ids=str,
)
@pytest.mark.parametrize("parameters", [CARS, MOVING], ids=["constant", "moving"])
def test_the_kernel_drives_as_numpy_does(
    physical, scheduled, road, hardware, parameters, monkeypatch
):
    found, other = both(monkeypatch, physical, scheduled, road, parameters, hardware)
    assert np.abs(other.states).max() > 1e-3
    require_alike(found, other)


@pytest.mark.parametrize(
    "sampling", [None, Sampling(0.003), Sampling(0.003, delay=0.5), Sampling(0.003, delay=0.45)]
)
def test_an_estimator_learns_the_same(physical, scheduled, road, sampling, monkeypatch):
    how = Estimated(period=0.002, sensors=Sensors(0.05, 1e-4, 1e-3, 5.0), seed=4)
    hardware = Hardware(how, sampling, LIMIT, STOPS)
    found, other = both(monkeypatch, physical, scheduled, road, CARS, hardware)
    require_alike(found, other, 1e-6)
    assert np.ptp(found.used[0, :, 0]) > 1
    assert found.estimate.parameters == pytest.approx(other.estimate.parameters, rel=1e-5)


@pytest.mark.parametrize("sampling", [None, *(Sampling(0.002, delay=d) for d in (0, 1, 0.7))])
def test_controllable_dampers_give_the_same(sampling, monkeypatch):
    plant, ends = family("half-car"), ("front", "rear")
    dampers = [Damper(f"{k} force", f"{k} suspension deflection", 300, 2000) for k in ends]
    K = np.random.default_rng(0).normal(size=(2, 8)) * 2000
    w = np.random.default_rng(1).normal(size=(400, 2))
    hardware = Hardware(sampling=sampling, dampers=dampers)
    found, other = both(monkeypatch, plant, K, disturbed(plant, w, 5e-4), None, hardware)
    require_alike(found, other)
    assert np.any(found.applied != found.demanded) or sampling is not None


@pytest.mark.parametrize(
    "hardware", [Hardware(stops=TIGHT), Hardware(actuator=Actuator(20, 500), stops=TIGHT)]
)
@pytest.mark.parametrize("name", ["half-car", "full-car"])
def test_stops_of_every_wheel_are_the_same(name, hardware, monkeypatch):
    plant, car = family(name), load_car(spec_path(name))
    (n, m), random = plant.shape, np.random.default_rng(3)
    K, w = random.normal(size=(m, n)) * 300, random.normal(size=(900, m))
    low, high = (float(getattr(plant.parameters[0], end)) for end in ("low", "high"))
    loads = [{"felt": low, "age": 0.1}, {"felt": high, "age": Jump(0.2, -0.1, 0.1)}]
    words = [plant, K, disturbed(plant, w, 5e-4), loads, hardware, None, False, False, car]
    found, other = both(monkeypatch, *words)
    require_alike(found, other)
    hit = np.abs(found.stop_forces).max(axis=(0, 1)) > 10
    assert len(hit) == m
    assert hit.all()
    assert found.stop_force == pytest.approx(found.stop_forces.sum(axis=-1))


def test_lost_cars_are_lost_at_the_same_instant(physical, road, monkeypatch):
    K = np.array([[0, 0, 3e4, 0, 0.0]])  # pushes the body where it goes
    found, other = both(monkeypatch, physical, K, road, CARS, Hardware(stops=STOPS))
    lost = np.isnan(other.states).any(axis=2)
    assert 0 < lost[:, -1].sum() < len(CARS)
    assert np.array_equal(np.isnan(found.states).any(axis=2), lost)
    assert found.states[~lost] == pytest.approx(other.states[~lost], rel=1e-6)


def test_a_plant_without_inputs_that_act_or_disturbances(monkeypatch):
    A = [[[0, 1], [-40, -2]], [[0, 1], [-50, -1]]]
    plant = UncertainPlant.from_vertices(A, [[[0], [1]]] * 2)
    moved = disturbed(plant, None, 1e-3, 0.3, start=[1.0, 0.0])
    found, other = both(monkeypatch, plant, None, moved, [[0.3, 0.7]], Hardware())
    require_alike(found, other)
    exact = np.exp(-0.5 * 1.3 * 0.3)
    assert np.abs(found.states[0, -1, 0]) < exact


def test_bits_hang_on_no_threads_and_nothing_else_on_stretches(
    physical, scheduled, road, monkeypatch
):
    hardware = Hardware(sampling=Sampling(0.0015), actuator=LIMIT, stops=STOPS)
    runs = []
    for threads, chunk in ((1, 2_000_000), (3, 2_000_000), (2, 20_000)):
        monkeypatch.setattr(compiled, "spare_processors", lambda threads=threads: threads)
        monkeypatch.setattr(compiled, "CHUNK", chunk)
        runs.append([drive(physical, scheduled, road, own, hardware) for own in (CARS, MOVING)])
    for one, two in zip(*runs[:2], strict=True):
        for name in ARRAYS:
            assert np.array_equal(getattr(one, name), getattr(two, name)), name
    for one, two in zip(runs[0], runs[2], strict=True):  # gains are computed for other stretches
        require_alike(one, two, 1e-11)


def test_a_car_among_many_goes_as_it_does_alone(physical, road):
    hardware, law = Hardware(actuator=LIMIT, stops=STOPS), lqr(physical)
    found = drive(physical, law, road, CARS, hardware)
    for k in (0, 7, 8):
        alone = drive(physical, law, road, CARS[k], hardware)
        assert np.array_equal(found.states[k], alone.states[0])


def test_what_does_not_fit_is_refused(physical, monkeypatch):
    calls, kernel = [], compiled.compiled()
    monkeypatch.setattr(compiled, "compiled", lambda: lambda **words: calls.append(words))
    moved = excited(physical, 0.01, 1e-3, {"road velocity": 1.0})
    hardware = Hardware(sampling=Sampling(0.002), stops=STOPS)
    drive(physical, lqr(physical), moved, CARS[:2], hardware)
    words = calls[0]
    kernel(**words)
    for name, own in words.items():
        if not isinstance(own, np.ndarray) or name in ("dampers", "damper_rates", "first_load"):
            continue
        for axis in range(own.ndim):
            if (name, axis) in (("K", 0), ("underway", 1)):
                continue
            more = np.ascontiguousarray(np.repeat(own, 2, axis=axis))
            if own.shape[axis]:
                with pytest.raises(ValueError, match=r"fit|stops"):
                    kernel(**words | {name: more})
    wrong = {"mode": 3, "every": 0, "threads": 0, "driven": 7, "first": 10, "steps": 9}
    wrong |= {"change": 1, "share": 0.5}
    for name, own in wrong.items():
        with pytest.raises(ValueError, match=r"fit|law|threads"):
            kernel(**words | {name: own})
