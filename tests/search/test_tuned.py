"""Laws of a structure: searched, proved, and never worse than their special cases."""

import re
from dataclasses import replace

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, NotProvedError
from polefence.certify.bounds import sampled
from polefence.cli.main import main
from polefence.examples import spec_path
from polefence.law.laws import FixedGain, PolynomialGain
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.region.regions import Disk, Ellipse, HalfPlane, Sector
from polefence.requirements.text import load_specifications
from polefence.search.tuned import _faster
from support.commands import ran, refused
from support.every_file import SPEC
from support.specs import ride_of_loads

CAR = HalfPlane(1) & Sector(0.15)
THREE = ("suspension deflection", "sprung-mass velocity", "unsprung-mass velocity")
NEAR = 1.01  # proved over sampled


@pytest.fixture(scope="module")
def study():
    plant = pf.load(spec_path("quarter-car-ride"))
    return plant, *load_specifications(spec_path("quarter-car-ride"))


@pytest.fixture(scope="module")
def loaded(study):
    """The same of a car whose load alone is uncertain."""
    return loads(ride_of_loads()), *study[1:]


def proves(done, minimise, limits, region):
    """Check everything of an answer against samples of its own plant and law."""
    level = done.bounds[0].level
    worst = sampled(done.plant, done.law, minimise).worst
    assert worst <= level <= NEAR * worst
    for own in limits:
        assert sampled(done.plant, done.law, own).worst <= own.at_most
    poles = done.design.poles(seeded(done.plant, 2000))
    assert np.all(region.distance(poles) < 0)
    assert done.design.certificate.prove().proved
    return level


@pytest.mark.parametrize(
    ("structure", "most"),
    [
        (pf.Structure(schedule=()), 1.05),
        (pf.Structure(measured=THREE, schedule=()), 1.05),
        (pf.Structure(), 1.025),
    ],
    ids=["one gain", "one gain, no tyre deflection", "affine"],
)
def test_the_study_is_proved_close_to_what_is_sampled(study, structure, most):
    plant, least, limits = study
    done = pf.optimise(plant, least, limits, CAR, structure=structure)
    assert proves(done, least, limits, CAR) <= most
    if structure.measured:
        assert np.all(done.law.K[:, 1] == 0)
    assert isinstance(done.law, FixedGain if structure.schedule == () else PolynomialGain)


def test_two_sensors_want_a_limit_on_the_gain(study):
    plant, least, limits = study
    two = pf.Structure(measured=THREE[:2], schedule=())
    free = pf.optimise(plant, least, limits, CAR, structure=two)
    assert "poles" in free.bounded_by
    bounded = pf.optimise(plant, least, limits, CAR, structure=replace(two, largest_gain=5e5))
    assert not bounded.bounded_by
    assert np.abs(bounded.law.K).max() <= 5e5
    assert bounded.bounds[0].level > free.bounds[0].level


def test_an_actuator_bounds_the_gain_itself(study):
    plant, least, limits = study
    slow = pf.with_actuator(plant, "actuator force", 30)
    two = pf.Structure(measured=THREE[:2], schedule=())
    done = pf.optimise(slow, least, limits, CAR, structure=two)
    assert not done.bounded_by
    assert proves(done, least, limits, CAR) < 1.08


def test_a_law_with_states_of_its_own_is_no_worse_than_one_without():
    A = [[[0, 1, 0], [-k, -0.2, k], [0, 0, -3]] for k in (1.0, 2.0)]
    plant = pf.UncertainPlant.from_vertices(
        A, [[[0], [0], [3]]] * 2, [[[0], [1], [0]]] * 2, states=("x", "v", "f"), inputs=("u",)
    )
    least, limits = pf.Rms("x", density=2.0), (pf.Rms("u", 1.0, density=2.0),)
    one = pf.Structure(measured=("x",), schedule=())
    static = pf.optimise(plant, least, limits, structure=one)
    done = pf.optimise(plant, least, limits, structure=replace(one, order=1))
    assert done.plant.shape == (4, 2)
    assert proves(done, least, limits, HalfPlane(0)) < 0.9 * static.bounds[0].level


def test_limits_that_no_law_was_found_for_come_with_the_nearest_that_one_keeps(loaded):
    plant, least, limits = loaded
    one = pf.Structure(measured=THREE[:2], schedule=())
    tight = (replace(limits[0], at_most=0.0038), replace(limits[2], at_most=158.0))
    with pytest.raises(NotProvedError, match="not a refutation") as error:
        pf.optimise(plant, least, tight, CAR, structure=one)
    near = dict(re.findall(r"rms of ([a-z ]+) <= ([0-9.e+-]+)", str(error.value)))
    assert near
    for own in tight:
        if own.name in near:
            wider = replace(own, at_most=1.001 * float(near[own.name]))
            kept = tuple(wider if other is own else other for other in tight)
            assert pf.optimise(plant, None, kept, CAR, structure=one).bounds


def test_the_default_is_no_worse_than_the_law_of_an_lmi():
    A = [[[0, 1], [-k, -0.4]] for k in (1.0, 3.0)]
    B, E = [[[0], [b]] for b in (1.0, 2.0)], [[[0], [1]]] * 2
    plant = pf.UncertainPlant.from_vertices(A, B, E, states=("x", "v"), inputs=("u",))
    least, limits = pf.Rms("x", density=2.0), (pf.Rms("u", 1.0, density=2.0),)
    lmi = pf.optimise(plant, least, limits, method="scheduled")
    best = pf.optimise(plant, least, limits)
    assert best.bounds[0].level <= lmi.bounds[0].level * (1 + 1e-9)


def test_a_method_and_a_structure_are_two_questions(study):
    plant, least, limits = study
    with pytest.raises(InputError, match="method"):
        pf.optimise(plant, least, limits, method="quadratic", structure=pf.Structure())
    with pytest.raises(InputError, match="method"):
        pf.place(plant, CAR, "quadratic", structure=pf.Structure())


@pytest.mark.parametrize(
    "region", [Disk(-40, 31), HalfPlane(2), HalfPlane(-2), Sector(0.3), Ellipse(-5, 4, 2), CAR]
)
@pytest.mark.parametrize("share", [1e-3, 0.05])
def test_a_tighter_region_lies_inside(region, share):
    inner = region.tighter(share)
    random = np.random.default_rng(5)
    z = random.uniform(-90, 5, 4000) + 1j * random.uniform(-40, 40, 4000)
    within, outside = inner.distance(z) < 0, region.distance(z) > 0
    assert np.any(within)
    assert not np.any(within & outside)


def test_the_smallest_gain_for_a_region_is_small(study):
    plant, *_ = study
    one = pf.Structure(measured=THREE[:2], schedule=())
    design = pf.place(plant, CAR, structure=one)
    assert design.certificate.prove().proved
    assert np.all(CAR.distance(design.poles(seeded(plant, 2000))) < 0)
    # a part of the passive car's own damping will do; an LMI's law is thousands of times larger
    assert np.abs(design.law.K).max() < 1000 < np.abs(pf.place(plant, CAR, "quadratic").law.K).max()


def test_the_command_writes_what_check_proves(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    law = f"\n[law]\nmeasured = {list(THREE[:2])}\nlargest_gain = 4e5\n"
    (tmp_path / "car.toml").write_text(ride_of_loads() + law)
    out = ran(capsys, "optimise", "car.toml", "-o", "car", "--json", "car.json")
    assert "of suspension deflection, sprung-mass velocity keeps all poles" in out
    said = ran(capsys, "check", "car", "--spec", "car.toml")
    assert "poles in half_plane(0), of A + B K with " in said
    assert "no parameter 'load'" in refused(capsys, "optimise", "car.toml", "--schedule", "load")
    assert main(["optimise", "car.toml", "--elevation", "1"]) == 2


def test_where_parameters_move_poles_are_searched_for_that_are_faster():
    """Across its range of 2 in half a second; where no law is faster another one is proved."""
    load = pf.Parameter("k", 1, 3, rate=(-1, 4))
    fast = pf.UncertainPlant.from_expressions([load], [["-k", 0], [0, -1]], [[1], [1]], [[1], [1]])
    still = replace(fast, parameters=(replace(load, rate=None),))
    assert _faster(fast, HalfPlane(0.5)) == HalfPlane(0.5) & HalfPlane(2)
    assert _faster(still, HalfPlane(0.5)) is None
    slow = pf.UncertainPlant.from_expressions(
        [load], [["-k", 0], [1, -0.2]], [[1], [0]], [[1], [1]], states=("x", "y")
    )
    one = pf.Structure(measured=("x",), schedule=())
    asked = pf.Rms("x", density=1), [pf.Rms("u1", density=1, at_most=2)]
    done = pf.optimise(slow, *asked, structure=one)
    assert done.design.poles(np.eye(2)).real.max() == pytest.approx(-0.2)
    assert all(own.claim.subject.motion for own in done.bounds)
    assert sampled(slow, done.law, asked[0]).worst <= done.bounds[0].level
    assert done.design.certificate.prove().proved


@pytest.mark.parametrize(
    ("region", "edge", "inner"),
    [
        (HalfPlane(0), HalfPlane(0), HalfPlane(0.2)),
        (HalfPlane(1), HalfPlane(0), HalfPlane(1.1)),
        (Disk(-20, 20), Disk(-20, 20), Disk(-20, 19.8)),
        (Disk(-20, 10), Disk(-20, 20), Disk(-20, 9)),
    ],
)
def test_of_stability_alone_a_share_of_a_rate_is_asked(region, edge, inner):
    assert region.tighter(0.1, edge, 2.0) == inner
    alone = inner if region != edge else region
    assert region.tighter(0.1, edge) == alone


def test_a_pole_at_the_edge_of_stability_is_moved_in():
    """By the velocity of a mass whose spring the law takes away it is at the very edge."""
    plant = pf.at_sample_time(loads(SPEC), "0.05", 1)
    least = pf.Rms("x", density=1, weight="Wk")
    limits = [pf.Rms("u", density=1, at_most=50)]
    one = pf.Structure(measured=("x", "v"), schedule=())
    done = pf.optimise(plant, least, limits, Disk(0, 1), structure=one)
    assert done.bounds[0].level <= 1.01 * sampled(plant, done.law, least).worst
    assert done.design.certificate.prove().proved
