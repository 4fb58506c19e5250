"""Many plants in one call: what each is answered alone, wherever it is worked out."""

from __future__ import annotations

import threading
import time
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence import (
    Design,
    Disk,
    HalfPlane,
    InputError,
    NotProvedError,
    PolefenceError,
    Scheduled,
    Sector,
    UncertainPlant,
    UncontrollableError,
)
from polefence.base.progress import note
from polefence.base.workers import threads
from polefence.certify.evaluation import surely_run, surely_runs
from polefence.certify.lower_bound import lower_radii, lower_radius
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import engine
from polefence.lmi.solve.many import smallest_disks
from polefence.lmi.solve.scaling import factors
from polefence.lmi.solve.smallest import smallest
from polefence.search import disks
from polefence.search.place import rounded, smallest_disk

METHODS = ["quadratic", "slack", "scheduled"]


def chain(count: int) -> UncertainPlant:
    """Return masses pushed weakly at both ends, of which a search takes several runs."""
    As, Bs = [], []
    for load in (0.8, 1.2):
        weight = np.append(np.ones(count - 1), load)
        stretch = np.eye(count) - np.eye(count, k=-1)
        K = stretch.T @ stretch / weight[:, None]
        As.append(np.block([[np.zeros((count, count)), np.eye(count)], [-K, -0.01 * K]]))
        push = np.zeros((2 * count, 2))
        push[count, 0], push[-1, 1] = 0.1, 0.1 / load
        Bs.append(push)
    return UncertainPlant.from_vertices(As, Bs, name=f"{count} masses")


@pytest.fixture(scope="module")
def fleet(make_random):
    """Plants of two shapes, one that stalls, one with a fixed mode, a discrete one."""
    own = [make_random(seed, 3, 1, 3) for seed in range(6)]
    others = [make_random(seed, 2, 2, 2, 0.1) for seed in range(4)]
    fixed = UncertainPlant.from_vertices([np.diag([1.0, -2.0])] * 2, [[[0], [1]]] * 2, name="fixed")
    discrete = UncertainPlant.from_vertices(
        [[[1.1, 0.1], [0, 0.9]]], [[[0], [0.1]]], sample_time=0.1, name="discrete"
    )
    return [own[0], others[0], *own[1:], chain(4), fixed, discrete, *others[1:]]


def alone(call):
    try:
        return call()
    except PolefenceError as error:
        return error


def assert_same(many, single):
    assert type(many) is type(single)
    if not isinstance(single, Design):
        assert str(many) == str(single)
        return
    assert many.method == single.method
    assert many.proved
    assert many.region.radius == pytest.approx(single.region.radius, rel=1e-7)
    assert (many.lower is None) == (single.lower is None)
    assert single.lower is None or many.lower == pytest.approx(single.lower, rel=1e-6)
    assert many.certificate.prove().proved


@pytest.mark.parametrize("method", METHODS)
def test_each_smallest_disk_is_that_of_the_plant_alone(fleet, method):
    centres = [-2.0 - 0.1 * k for k in range(len(fleet))]
    found = pf.many.tightest(fleet, centres, method)
    for many, plant, centre in zip(found, fleet, centres, strict=True):
        assert_same(many, alone(lambda p=plant, c=centre: pf.tightest(p, c, method)))
    assert isinstance(found[8], UncontrollableError)
    assert isinstance(found[9], InputError)
    assert sum(isinstance(own, Design) for own in found) == len(fleet) - 2


def test_most_of_them_are_worked_out_together(fleet, monkeypatch):
    """Else this file would say nothing."""
    singles = []
    whole = disks.place.tightest

    def counted(plant, *own, **options):
        singles.append(plant.name)
        return whole(plant, *own, **options)

    monkeypatch.setattr(disks.place, "tightest", counted)
    disks.answers([disks.Asked(plant, -2.0, "scheduled") for plant in fleet])
    assert {"fixed", "discrete"} <= set(singles) <= {"4 masses", "fixed", "discrete"}


@pytest.mark.parametrize("method", METHODS)
def test_each_design_for_a_disk_is_that_of_the_plant_alone(fleet, method):
    """A radius between those that plants of one shape reach: some have a design, some have none."""
    reached = sorted(
        own.region.radius
        for own in pf.many.tightest(fleet[:7], -3, method)
        if isinstance(own, Design)
    )
    region = Disk(-3, (reached[2] + reached[3]) / 2)
    found = pf.many.place(fleet[:7], region, method)
    for many, plant in zip(found, fleet, strict=False):
        single = alone(lambda plant=plant: pf.place(plant, region, method))
        assert_same(many, single)
        assert not isinstance(many, Design) or many.region == region
    assert 1 <= sum(isinstance(own, NotProvedError) for own in found) < len(found)


def test_other_regions_methods_and_structures_go_plant_by_plant(make_random):
    plants = [make_random(seed, 2, 1, 2, 0.1) for seed in range(2)]
    region = HalfPlane(0.2) & Sector(0.1)
    asked = [
        (lambda own: pf.many.place(own, region), lambda own: pf.place(own, region)),
        (
            lambda own: pf.many.tightest(own, -3, Scheduled(2)),
            lambda own: pf.tightest(own, -3, Scheduled(2)),
        ),
        (
            lambda own: pf.many.tightest(own, of="half_plane", within=Disk(-3, 2.9)),
            lambda own: pf.tightest(own, of="half_plane", within=Disk(-3, 2.9)),
        ),
        (
            lambda own: pf.many.place(own, region, structure=pf.Structure(schedule=())),
            lambda own: pf.place(own, region, structure=pf.Structure(schedule=())),
        ),
    ]
    for together, single in asked:
        for many, plant in zip(together(plants), plants, strict=True):
            one = alone(lambda plant=plant, single=single: single(plant))
            assert type(many) is type(one)
            assert getattr(many, "region", None) == getattr(one, "region", None)


def test_proofs_come_in_order_with_what_cannot_be_read(make_random, tmp_path):
    design = pf.tightest(make_random(3, 2, 1, 2), -3, "quadratic")
    _, point = smallest_disk(design.plant, -3, "quadratic")
    tight = Design(rounded(design.plant, Disk(-3, 1e-3), "quadratic", point))
    answers = pf.many.check([design, tmp_path / "none.json", tight, design.save(tmp_path)])
    assert [getattr(own, "answer", type(own).__name__) for own in answers] == [
        "proved",
        "DesignFileError",
        "refuted",
        "proved",
    ]


def test_what_is_wrong_of_all_is_said_at_once(fleet):
    with pytest.raises(InputError, match="did you mean 'slack'"):
        pf.many.tightest(fleet, -3, "slac")
    with pytest.raises(InputError, match="there are 2 centres for 13 plants"):
        pf.many.tightest(fleet, [-3, -4])
    with pytest.raises(InputError, match="region must be"):
        pf.many.place(fleet, "disk(-3, 2)")
    with pytest.raises(InputError, match="belong to laws from an LMI"):
        pf.many.place(fleet, Disk(-3, 2), "slack", structure=pf.Structure())
    with pytest.raises(InputError, match="of = 'circle' is unknown"):
        pf.many.tightest(fleet, -3, of="circle")


def test_a_single_one_is_no_list(fleet):
    """Of a path's text each letter would be a path."""
    for call in (
        lambda: pf.many.tightest(fleet[0], -3),
        lambda: pf.many.place(fleet[0], Disk(-3, 2)),
        lambda: pf.many.check("design.json"),
    ):
        with pytest.raises(InputError, match="must be several, as in a list, not one"):
            call()


def test_any_iterable_is_a_list(fleet):
    """One that ends when it was read once, too."""
    listed = pf.many.tightest(fleet[2:5], [-3, -4, -5], "quadratic")
    read = pf.many.tightest(iter(fleet[2:5]), iter([-3, -4, -5]), "quadratic")
    assert [own.region for own in read] == [own.region for own in listed]
    answers = pf.many.check(iter(listed))
    assert [own.answer for own in answers] == ["proved"] * 3
    region = Disk(-3, 2.9)
    assert len(pf.many.place(iter(fleet[2:5]), region & HalfPlane(0.1), "quadratic")) == 3


def test_what_is_wrong_of_one_is_its_answer(fleet):
    found = pf.many.tightest([fleet[0], "plant", fleet[1]], [-3, -3, 3], "quadratic")
    assert isinstance(found[0], Design)
    assert "must be of type UncertainPlant" in str(found[1])
    assert isinstance(found[2], pf.PolefenceError)
    assert "left half-plane" in str(found[2]) or "negative" in str(found[2])


def test_no_plants_are_no_answers():
    assert pf.many.tightest([], -3) == pf.many.place([], Disk(-3, 2)) == pf.many.check([]) == []


def test_where_it_is_worked_out_changes_nothing(fleet):
    here = pf.many.tightest(fleet[:8], -3)
    with pf.processes(2) as executor:
        there = pf.many.tightest(fleet[:8], -3, executor=executor)
    for many, single in zip(there, here, strict=True):
        assert many.region == single.region
        assert many.lower == single.lower


def test_parts_depend_on_what_is_asked_alone(fleet, make_random):
    few = [disks.Asked(plant, -3.0, "quadratic") for plant in fleet]
    parts = disks.parts(few)
    assert sorted(k for own in parts for k in own) == list(range(len(few)))
    many = [disks.Asked(fleet[0], -3.0 - k, "quadratic") for k in range(1000)]
    assert {len(own) for own in disks.parts(many)} == {disks.MOST, 1000 % disks.MOST}
    large = make_random(0, 30, 1, 8)
    assert max(map(len, disks.parts([disks.Asked(large, -3.0, "scheduled")] * 64))) == 1


# --- parts of it ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_the_search_is_that_of_a_plant_alone(make_random, method, engine, monkeypatch):
    if engine == "numpy":
        monkeypatch.setattr("polefence.lmi.solve.engine._kernel", None)
    plants = [make_random(seed, 3, 1, 3) for seed in range(5)]
    A, B = (np.array([getattr(own, name) for own in plants]) for name in ("A", "B"))
    sigma = np.array([2.0, 3.0, 4.0, 5.0, 6.0])
    enough = np.array([0.0, 0.0, 3.9, 0.0, 0.0])
    found = smallest_disks(A, B, sigma, method, enough)
    for plant, s, end, own in zip(plants, sigma, enough, found, strict=True):
        one = smallest(plant.A, plant.B, Disks(-s), method, enough=end, engine=engine)
        assert own.r == pytest.approx(one.r, rel=1e-6)
        assert own.iterations == one.iterations or engine == "numpy"
        for name, value in one.values.items():
            assert np.allclose(own.values[name], value, rtol=1e-4, atol=1e-6 * np.abs(value).max())


def test_a_run_that_stalls_goes_on_from_where_it_ended(monkeypatch):
    stalled, radii = chain(3), list[float]()
    run = engine.run
    monkeypatch.setattr(
        "polefence.lmi.solve.search.run", lambda *own: radii.append(own[2]) or run(*own)
    )
    one = smallest(stalled.A, stalled.B, Disks(-1.0), "quadratic")
    alone = radii.copy()
    radii.clear()
    A, B = stalled.A[None], stalled.B[None]
    found = smallest_disks(A, B, np.ones(1), "quadratic", np.zeros(1))[0]
    assert found.r == pytest.approx(one.r, rel=1e-6)
    assert len(alone) > 1
    assert radii == pytest.approx(alone, rel=1e-3)


def test_a_plant_that_floats_do_not_hold_takes_no_other_with_it(make_random):
    plants = [make_random(seed, 3, 1, 3) for seed in range(3)]
    A, B = (np.array([getattr(own, name) for own in plants]) for name in ("A", "B"))
    whole = [own.r for own in smallest_disks(A, B, np.full(3, 3.0), "quadratic", np.zeros(3))]
    A[1] *= 1e200
    found = smallest_disks(A, B, np.full(3, 3.0), "quadratic", np.zeros(3))
    assert [found[0].r, found[2].r] == [whole[0], whole[2]]
    alone = smallest(A[1], B[1], Disks(-3.0), "quadratic")
    assert not alone.converged
    assert not found[1].converged
    assert found[1].r == pytest.approx(alone.r)


def test_factors_of_some_are_found_though_others_have_none():
    W = np.array([np.eye(2), [[1, 2], [2, 1]], 4 * np.eye(2)])
    T = factors(W)
    assert np.isnan(T[1]).any()
    assert np.array_equal(T[[0, 2]], [np.eye(2), 2 * np.eye(2)])


@pytest.mark.parametrize("method", METHODS)
def test_bounds_and_laws_that_run_are_those_of_each_alone(make_random, method):
    plants = [make_random(seed, 3, 1, 3) for seed in range(5)]
    points = [smallest(own.A, own.B, Disks(-3.0), method) for own in plants]
    r, Y = (np.array(own) for own in zip(*((p.r, p.dual.matrices()) for p in points), strict=True))
    bounds = lower_radii(plants, method, np.full(5, 3.0), r, Y)
    for plant, own, radius, dual in zip(plants, bounds, r, Y, strict=True):
        assert own == lower_radius(plant, method, 3.0, float(radius), dual)
    assert sum(own is not None for own in bounds) >= 3
    certificates = [
        rounded(plant, Disk(-3.0, p.r * (1 + 1e-7)), method, p)
        for plant, p in zip(plants, points, strict=True)
    ]
    assert surely_run(certificates) == [surely_runs(own) for own in certificates]
    assert surely_run([]) == []


def test_threads_end_what_nobody_waits_for():
    """Left by an error, as Ctrl-C is one, wherever a thread tells how far it is."""
    begun = threading.Event()

    def endless() -> None:
        begun.set()
        while time.monotonic() < stop:
            note("on and on")
            time.sleep(0.001)

    stop = time.monotonic() + 60
    with pytest.raises(KeyboardInterrupt), threads(2) as pool:
        future, waiting = pool.submit(endless), [pool.submit(endless) for _ in range(8)]
        begun.wait(30)
        raise KeyboardInterrupt
    assert future.done()
    assert all(own.cancelled() or own.exception() is not None for own in waiting)
    assert time.monotonic() < stop - 30


def test_one_thread_is_none():
    with threads(1) as pool:
        assert pool is None


@pytest.mark.parametrize("words", [1, 2, 5])
def test_residues_are_those_of_the_numbers(words):
    prime = 2**31 - 1
    long = Fraction(3**37, 2 ** (60 * words - 30)) if words > 1 else Fraction(-7, 2)
    plant = UncertainPlant.from_vertices([[[long, -1], [-long, 3]]], [[[1], [-5]]])
    assert plant.words[2] >= words - 1
    common = int.from_bytes(plant.words[1], "little", signed=True)
    rows = [[long, -1, 1], [-long, 3, -5]]
    assert plant.residues.tolist() == [[[int(e * common) % prime for e in row] for row in rows]]
