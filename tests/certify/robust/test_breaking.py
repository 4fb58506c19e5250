"""Errors of loops that break them: beside proved margins, closed forms and poles in floats."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence import (
    DiskMargin,
    Gain,
    HalfPlane,
    InputError,
    Parameter,
    UncertainPlant,
    Unmodelled,
)
from polefence.certify.robust.breaking import broken, decided, document_of, failure_at
from polefence.law.laws import given_law
from polefence.plant.outputs import Output
from polefence.plant.points import joint
from polefence.proof.claims.base import prove
from polefence.proof.claims.failure import Error
from polefence.proof.document import Document, check, loads
from polefence.proof.regions import parts_of
from polefence.proof.work import FormatError

PUBLISHED = [[-10, -10, -10], [1, 0, 0], [0, 1, 0]], [[1], [0], [0]], [[0, 0, -25.0]]


def plant_of(A, B, **more):
    return UncertainPlant.from_vertices([np.asarray(A).tolist()], [np.asarray(B).tolist()], **more)


def sides(plant, law, margin, **more):
    """What is proved of a margin, and what fails; the claim of it."""
    (worst,) = pf.robust(plant, law, limits=[margin], **more).worst
    assert worst.exact
    return 1 / worst.bound.level, float(worst.failure.gain), worst.failure


def factor(error, skew, s):
    """What a loop is multiplied by at s, in floats."""
    c = float(error.gain)
    if error.pole is not None:
        a = float(error.pole)
        c *= (s - a) / (s + a)
    return (1 + (1 - skew) / 2 * c) / (1 - (1 + skew) / 2 * c)


@pytest.mark.parametrize(("skew", "published"), [(0, 0.46), (1, 0.402), (-1, 0.486)])
def test_a_published_margin_has_both_sides(skew, published):
    """Seiler, Packard and Gahinet 2020; in floats a return difference of zero on the axis."""
    A, B, K = PUBLISHED
    proved, fails, claim = sides(plant_of(A, B), K, DiskMargin("u1", sigma=skew))
    assert proved == pytest.approx(published, abs=3e-3)
    assert proved < fails < proved * (1 + 3e-6)
    w = np.linspace(1, 4, 300_001)
    L = 25 / ((1j * w) ** 3 + 10 * (1j * w) ** 2 + 10j * w + 10)
    off = np.abs(1 + L * factor(claim.errors[0], skew, 1j * w)).min()
    assert off < 1e-4


@pytest.mark.parametrize(
    ("loops", "published"), [(["u1", "u2"], 0.0998), (["u1", "u2", "y1", "y2"], 0.0499)]
)
def test_published_margins_of_a_satellite_have_both_sides(loops, published):
    """The same: both inputs at once, and both inputs and both outputs."""
    outputs = [Output(f"y{k + 1}", "", C=row) for k, row in enumerate([[1, 10], [-10, 1]])]
    plant = plant_of([[0, 10], [-10, 0]], np.eye(2), outputs=outputs)
    law = pf.PolynomialGain(((0,),), -np.eye(2)[None], outputs)
    proved, fails, claim = sides(plant, law, DiskMargin(loops))
    assert proved == pytest.approx(published, rel=2e-3)
    assert proved < fails < proved * (1 + 3e-6)
    assert len(claim.errors) == len(loops)


def test_an_integrator_with_a_dynamic_gain_bears_a_known_multiple():
    """1/s + 0.4 delta behind 2/(0.02 s + 1): the peak of 0.4 C S is 0.8, at 10 rad/s, and real."""
    plant = plant_of([[0, 1], [-100, -10]], [[0], [-40]])
    proved, fails, claim = sides(plant, [[0.0, 1.0]], DiskMargin("u1", sigma=-1))
    assert proved < 1.25 < fails < proved * (1 + 3e-6)
    assert claim.errors == (Error(-Fraction("1.250001")),)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("weight", ["", "(s + 0.2)/(0.5*s + 1)"])
def test_two_loops_at_once_fail_near_what_is_proved(seed, weight):
    random = np.random.default_rng(seed)
    A = random.standard_normal((4, 4)) - 3 * np.eye(4)
    B, K = random.standard_normal((4, 2)), -0.5 * random.standard_normal((2, 4))
    names = ["u1", "u2"]
    asked = Unmodelled(names, weight=weight) if weight else DiskMargin(names)
    proved, fails, claim = sides(plant_of(A, B), K, asked)
    assert proved < fails < proved * 1.001
    assert len({abs(error.gain) for error in claim.errors}) == 1
    # smaller errors of the same phases leave it stable
    less = tuple(replace(error, gain=error.gain * Fraction(999, 1000)) for error in claim.errors)
    assert prove(replace(claim, errors=less)).answer == "undecided"


@pytest.mark.parametrize("loops", ["u1", ["u1", "x2"]])
def test_in_discrete_time_too(loops):
    plant = plant_of([[1, 0.1], [0, 1]], [[0.005], [0.1]], sample_time=Fraction(1, 10))
    proved, fails, claim = sides(plant, [[-2.0, -3.0]], DiskMargin(loops))
    assert proved < fails < proved * (1 + 1e-4)
    assert all(error.pole is None or abs(error.pole) < 1 for error in claim.errors)
    assert check(document_of([claim])).proved


def oscillator(**more):
    return UncertainPlant.from_expressions(
        [Parameter("k", 1, 3), Parameter("c", 1, 2)],
        [[0, 1], ["-k", "-c"]],
        [[0], [1]],
        [[0], [1]],
        outputs={"a": {"C": ["-k", "-c"], "D": [1]}, "x": {"C": [1, 0]}},
        **more,
    )


def test_a_margin_ends_the_growth_exactly_and_the_file_says_so(tmp_path):
    # L = 1 / (s^2 + c s + k), delta acts on T: the peak is 1 / (k + 1) where c is large enough
    limit = DiskMargin.least("u1", 1.5, sigma=-1.0)
    found = pf.robust(oscillator(), [[-1.0, 0.0]], limits=[limit])
    reach = found.alone["k"]
    assert reach.exact
    assert found.largest.exact
    assert "disk margin of u1" in found.largest.reason
    assert float(reach.refuted) <= float(reach.proved) * (1 + 2e-5)
    c, k = (float(found.largest.values[key]) for key in "ck")
    w = np.linspace(0, 6, 60_001)
    peak = np.abs(1 / (-(w**2) + 1j * c * w + k + 1)).max()
    assert peak == pytest.approx(1 / 1.5, rel=1e-4)
    assert pf.check(found.save(tmp_path)).proved
    for name in ("refuted.json", "margins.json"):
        document = loads((tmp_path / name).read_text())
        assert check(document).proved, name
    (claim,) = loads((tmp_path / "refuted.json").read_text()).claims
    assert claim.gain < Fraction(3, 2)
    assert "the disk margin of skew -1 is at most 1.5" in claim.statement(claim.plant)


def test_poles_that_leave_a_region_are_written_too(tmp_path):
    found = pf.robust(oscillator(), [[0.0, 0.0]], HalfPlane(0.1))
    found.save(tmp_path)
    (claim,) = loads((tmp_path / "refuted.json").read_text()).claims
    assert prove(claim).proved
    assert claim.loops is None
    inside = replace(claim, at=tuple(Fraction(1, 2) for _ in claim.at))
    assert prove(inside).answer == "undecided"
    assert not (tmp_path / "margins.json").exists()


def test_a_signal_that_a_force_passes_into_is_cut_as_the_law_reads_it():
    plant = oscillator()
    law = pf.Compensator([[-1.0]], [[1.0]], [[-0.3]], [[-0.2]], measured=["a"])
    (worst,) = pf.robust(plant, law, limits=[DiskMargin("a")]).worst
    assert worst.exact
    assert 1 / worst.bound.level < float(worst.failure.gain) < 1.0001 / worst.bound.level


def test_of_a_scheduled_quotient_too():
    plant = oscillator()
    design = pf.place(plant, pf.Disk(-3, 2.5))
    law = given_law(plant, design)
    alpha = joint([p.weights(Fraction(3, 2)) for p in plant.parameters])
    claim = broken(plant, law, DiskMargin("u1"), alpha)
    assert claim is not None
    assert check(loads(document_of([claim]).dumps())).proved


def test_a_larger_loop_has_a_matrix_that_shows_it():
    random = np.random.default_rng(5)
    A = random.standard_normal((11, 11)) - 4 * np.eye(11)
    plant = plant_of(A, random.standard_normal((11, 1)))
    K = -0.3 * random.standard_normal((1, 11))
    claim = broken(plant, given_law(plant, K), DiskMargin("u1"), [Fraction(1)])
    assert claim.outside is not None
    assert check(loads(document_of([claim]).dumps())).proved
    less = replace(claim, errors=tuple(replace(e, gain=e.gain * 9 / 10) for e in claim.errors))
    assert not prove(less).proved


def test_functions_of_the_parameters_are_outside_to_within_their_error():
    plant = UncertainPlant.from_expressions(
        [Parameter("p", 0, 1)], [[0, 1], ["-1 - sin(p)", "-0.5 + p"]], [[0], [1]]
    )
    law = given_law(plant, [[0.0, 0.0]])
    region = parts_of(HalfPlane(0).document())
    for share, fails in ((Fraction(1, 4), False), (Fraction(3, 4), True)):
        alpha = joint([p.weights(share) for p in plant.parameters])
        claim = decided(failure_at(plant, law, region, alpha))
        assert (claim is not None) is fails


def test_a_plant_without_parameters_has_worst_cases_alone():
    plant = plant_of([[0, 1], [-1, -1]], [[0], [1]])
    found = pf.robust(plant, [[0.0, 0.0]], limits=[DiskMargin.least("u1", 0.5)])
    assert found.proved
    assert found.largest.names == ()
    assert not pf.robust(plant, [[-9.0, 0.0]], limits=[DiskMargin.least("u1", 0.5)]).proved
    with pytest.raises(InputError, match="one vertex, without parameters"):
        pf.robust(plant, [[0.0, 0.0]])


CLAIM = broken(
    plant_of(*PUBLISHED[:2]),
    given_law(plant_of(*PUBLISHED[:2]), PUBLISHED[2]),
    DiskMargin("u1"),
    [Fraction(1)],
)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"errors": (Error(Fraction(1), Fraction(-1)),)}, "positive"),
        ({"errors": ()}, "one error a loop"),
        ({"at": (Fraction(1, 2),)}, "no point"),
        ({"at": (Fraction(2),)}, "no point"),
        ({"region": parts_of(HalfPlane(1).document())}, "stability alone"),
        ({"filters": (None,)}, "with a filter"),
    ],
)
def test_a_claim_that_is_none_is_refused(change, said):
    with pytest.raises(FormatError, match=said):
        prove(replace(CLAIM, **change))


def test_an_error_that_takes_the_value_of_the_loop_is_refused():
    # with skew 1 the error acts on S, which is 1 where nothing comes back
    one = replace(CLAIM, loops=replace(CLAIM.loops, skew=Fraction(1)), errors=(Error(Fraction(1)),))
    with pytest.raises(FormatError, match="no value"):
        prove(one)


def test_smaller_errors_prove_nothing():
    small = replace(CLAIM, errors=(replace(CLAIM.errors[0], gain=Fraction("-0.458")),))
    assert prove(small).answer == "undecided"
    document = Document(CLAIM.plant, CLAIM.law, (small,), CLAIM.on)
    assert check(document).answer == "undecided"


def test_a_gain_alone_leaves_no_file(tmp_path):
    found = pf.robust(oscillator(), [[0.0, 0.0]], limits=[Gain("x", at_most=1.2)])
    found.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["design.json"]
