"""Many plants in one call: what each is answered alone, wherever it is worked out."""

import numpy as np
import pytest

import polefence as pf
from polefence.search.by_lmi import rounded, smallest_disk


def chain(count: int) -> pf.UncertainPlant:
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
    return pf.UncertainPlant.from_vertices(As, Bs, name=f"{count} masses")


@pytest.fixture(scope="module")
def fleet(make_random):
    """Plants of two shapes, one that stalls, one with a fixed mode, a discrete one."""
    own = [make_random(seed, 3, 1, 3) for seed in range(6)]
    others = [make_random(seed, 2, 2, 2, 0.1) for seed in range(4)]
    fixed = pf.UncertainPlant.from_vertices(
        [np.diag([1.0, -2.0])] * 2, [[[0], [1]]] * 2, name="fixed"
    )
    discrete = pf.UncertainPlant.from_vertices(
        [[[1.1, 0.1], [0, 0.9]]], [[[0], [0.1]]], sample_time=0.1, name="discrete"
    )
    return [own[0], others[0], *own[1:], chain(4), fixed, discrete, *others[1:]]


def alone(call):
    try:
        return call()
    except pf.PolefenceError as error:
        return error


def assert_same(many, single):
    assert type(many) is type(single)
    if not isinstance(single, pf.Design):
        assert str(many) == str(single)
        return
    assert (many.method, many.region, many.lower) == (single.method, single.region, single.lower)
    assert many.proved


def test_each_smallest_disk_is_that_of_the_plant_alone(fleet):
    centres = [-2.0 - 0.1 * k for k in range(len(fleet))]
    found = pf.many.tightest(fleet, centres, "slack")
    for many, plant, centre in zip(found, fleet, centres, strict=True):
        assert_same(many, alone(lambda p=plant, c=centre: pf.tightest(p, c, "slack")))
    assert isinstance(found[8], pf.UncontrollableError)
    assert isinstance(found[9], pf.InputError)
    assert sum(isinstance(own, pf.Design) for own in found) == len(fleet) - 2


def test_without_bounds_there_are_none(fleet):
    bounded = pf.many.tightest(fleet[:3], -3, "quadratic")
    bare = pf.many.tightest(fleet[:3], -3, "quadratic", bounds=False)
    assert all(own.lower is not None for own in bounded)
    assert [own.lower for own in bare] == [None] * 3
    assert [own.region for own in bare] == [own.region for own in bounded]


def test_a_plant_at_a_sample_time_is_one_of_them(make_random):
    sampled = pf.at_sample_time(make_random(0, 2, 1, 2, 0.1), 0.05)
    region = pf.Disk(0.8, 0.15)
    asked = [
        (pf.many.place([sampled], region), lambda: pf.place(sampled, region)),
        (pf.many.tightest([sampled], 0.8), lambda: pf.tightest(sampled, 0.8)),
    ]
    for (many,), single in asked:
        assert_same(many, alone(single))
        assert isinstance(many, pf.Design)


REGION, DISK = pf.HalfPlane(0.2) & pf.Sector(0.1), pf.Disk(-3, 2.9)
ASKED = {
    "region": ("place", (REGION,), {}),
    "disk": ("place", (DISK,), {}),
    "method": ("tightest", (-3, pf.Scheduled(2)), {}),
    "decay": ("tightest", (), {"of": "half_plane", "within": DISK}),
    "structure": ("place", (REGION,), {"structure": pf.Structure(schedule=())}),
}


@pytest.mark.parametrize("key", ASKED)
def test_regions_methods_and_structures_are_those_of_each_alone(key, make_random):
    verb, given, more = ASKED[key]
    plants = [make_random(seed, 2, 1, 2, 0.1) for seed in range(2)]
    together = getattr(pf.many, verb)(plants, *given, **more)
    for many, plant in zip(together, plants, strict=True):
        one = alone(lambda plant=plant: getattr(pf, verb)(plant, *given, **more))
        assert type(many) is type(one)
        assert getattr(many, "region", None) == getattr(one, "region", None)


def test_proofs_come_in_order_with_what_cannot_be_read(make_random, tmp_path):
    design = pf.tightest(make_random(3, 2, 1, 2), -3, "quadratic")
    _, point = smallest_disk(design.plant, -3, "quadratic")
    tight = pf.Design(rounded(design.plant, pf.Disk(-3, 1e-3), "quadratic", point))
    answers = pf.many.check([design, tmp_path / "none.json", tight, design.save(tmp_path)])
    assert [getattr(own, "answer", type(own).__name__) for own in answers] == [
        "proved",
        "DesignFileError",
        "refuted",
        "proved",
    ]


WRONG = {
    "did you mean 'slack'": ("tightest", (-3, "slac"), {}),
    "there are 2 centres for 13 plants": ("tightest", ([-3, -4],), {}),
    "region must be": ("place", ("disk(-3, 2)",), {}),
    "belong to laws from an LMI": ("place", (DISK, "slack"), {"structure": pf.Structure()}),
    "of = 'circle' is unknown": ("tightest", (-3,), {"of": "circle"}),
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_of_all_is_said_at_once(message, fleet):
    verb, given, more = WRONG[message]
    with pytest.raises(pf.InputError, match=message):
        getattr(pf.many, verb)(fleet, *given, **more)


def test_a_single_one_is_no_list(fleet):
    """Of a path's text each letter would be a path."""
    for call in (
        lambda: pf.many.tightest(fleet[0], -3),
        lambda: pf.many.place(fleet[0], pf.Disk(-3, 2)),
        lambda: pf.many.check("design.json"),
    ):
        with pytest.raises(pf.InputError, match="must be several, as in a list, not one"):
            call()


def test_any_iterable_is_a_list(fleet):
    """One that ends when it was read once, too."""
    listed = pf.many.tightest(fleet[2:5], [-3, -4, -5], "quadratic")
    read = pf.many.tightest(iter(fleet[2:5]), iter([-3, -4, -5]), "quadratic")
    assert [own.region for own in read] == [own.region for own in listed]
    answers = pf.many.check(iter(listed))
    assert [own.answer for own in answers] == ["proved"] * 3
    region = pf.Disk(-3, 2.9)
    assert len(pf.many.place(iter(fleet[2:5]), region & pf.HalfPlane(0.1), "quadratic")) == 3


def test_what_is_wrong_of_one_is_its_answer(fleet):
    found = pf.many.tightest([fleet[0], "plant", fleet[1]], [-3, -3, 3], "quadratic")
    assert isinstance(found[0], pf.Design)
    assert "must be of type UncertainPlant" in str(found[1])
    assert isinstance(found[2], pf.PolefenceError)
    assert "left half-plane" in str(found[2]) or "negative" in str(found[2])


def test_no_plants_are_no_answers():
    assert pf.many.tightest([], -3) == pf.many.place([], pf.Disk(-3, 2)) == pf.many.check([]) == []


def test_where_it_is_worked_out_changes_nothing(fleet):
    here = pf.many.tightest(fleet[:8], -3)
    with pf.processes(2) as executor:
        there = pf.many.tightest(fleet[:8], -3, executor=executor)
    for many, single in zip(there, here, strict=True):
        assert many.region == single.region
        assert many.lower == single.lower
