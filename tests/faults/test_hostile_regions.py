"""Regions, methods and plants that nobody should ask for: an error of the package's, or the truth.

"The truth" is that poles sampled over the domain lie in whatever region is called proved.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from polefence import (
    Design,
    Disk,
    InputError,
    NotProvedError,
    Parameter,
    PolefenceError,
    Scheduled,
    UncertainPlant,
    check,
    place,
    tightest,
)
from polefence.base.errors import RegionError
from polefence.lmi.conditions.methods import Slack
from polefence.plant.polynomial import Domain
from polefence.region.regions import (
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Intersection,
    Sector,
    VerticalStrip,
)

OSCILLATOR = [[[0, 1], [-1, -0.1]], [[0, 1], [-2, -0.1]]]


def oscillator(rate=1.0, unit=1.0):
    """Two springs, rates and the unit of length free."""
    As = [np.array([[0, unit], [a / unit, -0.1]]) * rate for a in (-1, -2)]
    return UncertainPlant.from_vertices(As, [[[0], [rate]]] * 2)


def family(seed, n, m, N, spread=0.2):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    As, Bs = ([X + spread * random.normal(size=X.shape) for _ in range(N)] for X in (A, B))
    return UncertainPlant.from_vertices(As, Bs)


def box_of(plant, count):
    names = (Parameter(f"p{k}", 0, 1) for k in range(count))
    return replace(plant, parameters=tuple(names))


def holds(design, on="simplex"):
    """Whether poles sampled over the domain lie in the region, but for rounding."""
    domain = Domain.of(on, len(design.plant.vertices))
    random = np.random.default_rng(0)
    own = np.hstack([random.dirichlet(np.full(size, 0.6), 200) for size in domain.sizes])
    corners = np.array(domain.monomials(1), dtype=float)
    poles = design.poles(domain.alpha(np.vstack([corners, own])))
    far = np.abs(poles).max()
    return bool(design.region.distance(poles).max() < 1e-9 * far)


def asked(plant, region, method="scheduled"):
    """Place the poles or say why not, within the package's errors; what is proved is true."""
    try:
        design = place(plant, region, method)
    except PolefenceError as error:
        return type(error) if "\n" not in str(error) else str(error)
    assert holds(design, getattr(method, "on", "simplex"))
    return "proved"


NO_REGION = [3, None, "disk(-40, 31)", Disk, (Disk(-40, 31),), {"kind": "disk"}, [], object()]


@pytest.mark.parametrize("region", NO_REGION, ids=lambda region: repr(region).split(" at ")[0])
def test_what_is_no_region_is_refused(region):
    with pytest.raises(InputError, match="region"):
        place(oscillator(), region)


def test_what_is_no_region_does_not_intersect_one():
    for other in (3, None, "sector(0.5)", Disk):
        with pytest.raises((InputError, TypeError), match="[Rr]egion|unsupported operand"):
            HalfPlane(0) & other


def test_what_is_no_region_holds_nothing_within():
    for other in (3, "sector(0.5)", Disk):
        with pytest.raises(InputError):
            tightest(oscillator(), of="half_plane", within=other)


def test_an_intersection_of_nothing_is_refused():
    with pytest.raises(RegionError):
        Intersection(())


@pytest.mark.parametrize(
    "make",
    [
        lambda: HalfPlane(float("nan")),
        lambda: HalfPlane("fast"),
        lambda: HalfPlane(1e101),
        lambda: HalfPlane(1e-101),
        lambda: Sector(0),
        lambda: Sector(1),
        lambda: Sector(-0.5),
        lambda: Sector(1e-9),
        lambda: VerticalStrip(-1, -1),
        lambda: VerticalStrip(-1, -2),
        lambda: HorizontalStrip(0),
        lambda: HorizontalStrip(float("inf")),
        lambda: Ellipse(-3, 0, 1),
        lambda: Ellipse(-3, 1, -1),
        lambda: Disk(None, 1),
    ],
)
def test_numbers_that_make_no_region(make):
    with pytest.raises(RegionError):
        make()


def test_disks_of_discrete_time_are_refused_for_a_continuous_plant():
    plant = oscillator()
    astray = (Disk(0.5, 0.51), Disk(2, 0.1), Ellipse(3, 1, 1), Disk(0.5, 0.2) & HalfPlane(-1))
    for region in (Disk(0.5, 0.2), Disk(0, 0.9), *astray):
        with pytest.raises(RegionError, match="left half-plane"):
            place(plant, region)
    with pytest.raises(RegionError, match="left half-plane"):
        tightest(plant, 0.5)
    for region in (Disk(0.5, 0.2), Ellipse(3, 1, 1)):  # that no pole on the left is in
        with pytest.raises(NotProvedError):
            place(plant, region & HalfPlane(0))


BOX = Scheduled(on="box")


def test_a_box_needs_parameters():
    """Vertices alone are a polytope, of which products are a part only."""
    for N in (1, 2, 3, 4):
        for method in (BOX, Slack(on="box"), Scheduled(degree="auto", on="box")):
            with pytest.raises(InputError, match="parameters"):
                place(family(1, 2, 1, N), Disk(-3, 2.9), method)


@pytest.mark.parametrize("of", ["disc", None, 3, "horizontal_strip"])
def test_kinds_that_tightest_does_not_know(of):
    with pytest.raises(InputError, match="of = "):
        tightest(oscillator(), of=of)


def test_what_tightest_cannot_take_together():
    plant = oscillator()
    for given in (
        {"centre": -3, "of": "sector"},
        {"centre": -3, "within": HalfPlane(0)},
        {"of": "disk"},
        {"of": "half_plane", "method": "slack"},
        {"of": "half_plane", "method": Scheduled(degree="auto")},
        {"centre": "left"},
        {"centre": float("nan")},
    ):
        with pytest.raises(InputError):
            tightest(plant, **given)


@pytest.mark.parametrize(
    "given",
    [
        {"degree": np.int64(2)},
        {"degree": "2"},
        {"degree": [2]},
        {"elevation": None},
        {"elevation": 9},
        {"on": ["box"]},
        {"on": None},
        {"degree": "auto", "right_hand_sides": True},
    ],
    ids=str,
)
def test_methods_that_there_are_not(given):
    with pytest.raises(InputError):
        Scheduled(**given)


@pytest.mark.parametrize("epsilon", [0, -1, 101, float("nan"), float("inf")])
def test_epsilons_that_there_are_not(epsilon):
    with pytest.raises(InputError, match="epsilon"):
        Slack(epsilon=epsilon)


def test_options_of_the_wrong_type():
    for value in ("small", None):
        with pytest.raises(InputError):
            Slack(epsilon=value)


def test_budgets_of_the_wrong_type():
    for value in ("long", [], -1.0):
        with pytest.raises(InputError):
            place(oscillator(), Disk(-3, 0.1), Scheduled(degree="auto", budget=value))


@pytest.mark.parametrize(
    "region", [HalfPlane(1), Disk(-3, 2) & HalfPlane(1), Disk(-3, 2) & Disk(-4, 3)], ids=str
)
def test_right_hand_sides_are_for_one_disk(region):
    with pytest.raises(InputError):
        place(oscillator(), region, Scheduled(right_hand_sides=True))


PLANTS = {
    "one vertex": (family(1, 2, 1, 1), 0),
    "three vertices": (family(2, 2, 1, 3), 0),
    "more inputs than states": (family(3, 2, 3, 2), 0),
    "scalar": (family(4, 1, 1, 2), 0),
    "one parameter": (box_of(UncertainPlant((*family(1, 2, 1, 1).vertices,) * 2), 1), 1),
    "two parameters": (box_of(family(7, 2, 2, 4), 2), 2),
}
EXTREME = [
    HalfPlane(1e9),
    HalfPlane(-1e100),
    Sector(0.999999),
    Sector(1e-8),
    VerticalStrip(-1 - 1e-7, -1),
    HorizontalStrip(1e-6),
    Ellipse(-1, 1e-9, 1e9),
    Disk(-40, 1) & Disk(-10, 1),
    HalfPlane(50) & VerticalStrip(-40, -1),
    VerticalStrip(-80, 5) & HorizontalStrip(3),
]


@pytest.mark.parametrize("name", PLANTS)
def test_odd_plants_and_extreme_regions(name):
    """Whatever is proved is true, whatever is not has a reason of the package's."""
    plant, parameters = PLANTS[name]
    methods = ["quadratic", "slack", Scheduled(2, 0, "box") if parameters else "scheduled"]
    for region in EXTREME:
        answers = [asked(plant, region, method) for method in methods]
        assert all(a in ("proved", NotProvedError) for a in answers), (region, answers)
    for region in EXTREME[-3:-1]:  # nothing lies in two places at once
        assert asked(plant, region, "quadratic") is NotProvedError
    assert asked(plant, Disk(-3, 2.99), methods[-1]) in ("proved", NotProvedError)


@pytest.mark.parametrize("rate", [1e-30, 1e30])
def test_units_of_time_do_not_matter(rate):
    plant = oscillator(rate)
    regions = (
        Disk(-3 * rate, 2.9 * rate),
        HalfPlane(rate),
        Sector(0.5),
        HorizontalStrip(rate),
        VerticalStrip(-9 * rate, -rate),
        Ellipse(-3 * rate, 2 * rate, rate),
    )
    for region in regions:
        for method in ("scheduled", "slack"):
            assert asked(plant, region, method) == "proved", (region, method)
    design = tightest(plant, of="sector", within=Disk(-3 * rate, 2.9 * rate))
    assert holds(design)


@pytest.mark.parametrize("unit", [1e-60, 1e-12, 1e12])
def test_units_of_length_do_not_matter(unit):
    plant = oscillator(unit=unit)
    for region in (Disk(-3, 2.9), HalfPlane(1) & Disk(-50, 49), Sector(0.5), Ellipse(-3, 2, 1)):
        assert asked(plant, region, "quadratic") == "proved"


def test_a_unit_of_length_beyond_all_scales():
    assert asked(oscillator(unit=1e60), Disk(-3, 2.9), "quadratic") in ("proved", NotProvedError)


def test_a_strip_that_is_as_good_as_empty():
    for method in ("quadratic", "slack", "scheduled"):
        assert asked(oscillator(), HorizontalStrip(1e-90), method) is NotProvedError


@pytest.mark.parametrize("size", [1e-50, 1e50])
def test_disks_beyond_all_proportion(size):
    assert asked(oscillator(), Disk(-size, size / 10), "quadratic") is NotProvedError


def test_too_many_parts_are_refused():
    many = Intersection(tuple(Disk(-40 - k / 10, 39) for k in range(17)))
    with pytest.raises(InputError):
        place(oscillator(), many, "quadratic")


# --- a box's proof is none of the polytope -------------------------------------------------------


@pytest.fixture(scope="module")
def on_a_box():
    """A design proved on the box of two parameters, some of whose simplex it does not hold on."""
    random = np.random.default_rng(1)
    A = random.normal(size=(2, 2))
    As = [A + 0.6 * random.normal(size=(2, 2)) for _ in range(4)]
    plant = box_of(UncertainPlant.from_vertices(As, [[[0], [1]]] * 4), 2)
    return tightest(plant, -3, Scheduled(2, 1, "box"))


def off_the_box(design):
    """The farthest pole over the polytope of all weights."""
    alpha = np.random.default_rng(1).dirichlet(np.full(4, 0.3), 2000)
    return design.region.distance(design.poles(alpha)).max()


def test_a_box_is_less_than_the_polytope(on_a_box):
    assert check(on_a_box).proved
    assert holds(on_a_box, "box")
    assert off_the_box(on_a_box) > 0.1 * on_a_box.region.radius


def test_a_design_file_without_parameters_is_about_the_polytope(on_a_box, tmp_path):
    """Without parameters the family is the hull of the vertices: there the claim is false."""
    document = json.loads(on_a_box.certificate.dumps())
    document["plant"]["parameters"] = []
    path = tmp_path / "design.json"
    path.write_text(json.dumps(document))
    try:
        answer, loaded = check(path).answer, Design.load(path, allow_unproved=True)
    except InputError:
        return
    assert answer != "proved"
    assert not loaded.proved
