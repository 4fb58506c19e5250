"""The compiled second prover: the checker's verdicts, also with one fault at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polefence import Disk, HalfPlane, PlantError, Scheduled, Sector, Slack, UncertainPlant, place
from polefence.certify import exact
from polefence.certify.certificate import Certificate
from polefence.certify.evaluation import rounding_share, surely_runs
from polefence.certify.given import analyse
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import engine
from polefence.lmi.solve.smallest import smallest
from polefence.proof.claims.poles import Poles
from polefence.search.by_lmi import rounded

compiled = pytest.mark.skipif(
    not hasattr(engine.kernel(), "poles"), reason="installed without a compiler: no second prover"
)
METHODS = [
    "quadratic",
    "slack",
    "scheduled",
    Scheduled(right_hand_sides=True),
    Scheduled(2, 1),
    Scheduled(0, 2),
    Slack(0, 1),
]
SHAPES = [(5, 2, 1, 2), (4, 3, 2, 3), (12, 4, 1, 4)]  # seed, n, m, N
BOXED = [Scheduled(1, 0, "box"), Scheduled(1, 2, "box"), Slack(2, 0, "box"), Slack(1, 1, "box")]


def claim_of(plant, method, centre=-3.0):
    """The search's point, and the certificate a share of its radius farther out."""
    found = smallest(plant.A, plant.B, Disks(centre), method)
    return lambda step: rounded(plant, Disk(centre, found.r * (1 + step)), method, found)


def agrees(certificate) -> bool:
    """Whether it knows, and says what the checker does; what that is."""
    known, verdict = exact.holds(certificate), certificate.prove()
    assert known is not None
    assert known is verdict.proved, verdict
    return known


@compiled
@pytest.mark.parametrize("method", METHODS, ids=str)
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_it_says_of_radii_on_both_sides_what_the_checker_says(shape, method, make_random):
    """What a point proves at 1e-4 above its radius it cannot at as much below that."""
    both_sides(claim_of(make_random(*shape), method))


@compiled
@pytest.mark.parametrize("method", BOXED, ids=str)
def test_it_does_so_on_boxes(method, physical):
    both_sides(claim_of(physical, method, -40.0))


def both_sides(at):
    assert agrees(at(1e-4))
    for step in (1e-6, 1e-8, -1e-9, -1e-7):
        agrees(at(step))
    assert not agrees(at(-1e-4))


@compiled
@pytest.mark.parametrize("method", [*METHODS[:5], *BOXED[2:]], ids=str)
def test_one_fault_at_a_time_is_seen(method, physical):
    """Every number of the law and of the evidence, of its sign or by a share; and an asymmetry."""
    good = claim_of(physical, method, -40.0)(1e-5)
    assert agrees(good)
    random, broken = np.random.default_rng(3), 0
    for name, change in changes(good):
        for matrices in (change(-1.0, random), change(1 + 1e-3, random)):
            faulty = spoiled(good, name, matrices)
            broken += not agrees(faulty)
    assert broken > 3
    for name, _ in changes(good):
        if name in ("W", "P"):
            matrices = matrix_of(good, name).copy()
            matrices[..., 0, 1] *= 1 + 2**-40
            assert not agrees(spoiled(good, name, matrices))


def matrix_of(certificate, name):
    return getattr(certificate.law, name, None) if name in "KZ" else held(certificate, name)


def held(certificate, name):
    own = certificate.evidence.get(name)
    return getattr(certificate.law, "W", None) if own is None and name == "W" else own


def changes(certificate):
    """Names of what a certificate has, and what multiplies one entry of it and its mirror."""
    for name in "KZWPG":
        matrices = matrix_of(certificate, name)
        if matrices is None:
            continue

        def change(factor, random, matrices=matrices, mirrored=name in "WP"):
            found = np.array(matrices)
            *lead, i, j = (int(random.integers(size)) for size in found.shape)
            found[*lead, i, j] *= factor
            if mirrored and i != j:
                found[*lead, j, i] *= factor
            return found

        yield name, change


def spoiled(certificate, name, matrices):
    law = certificate.law
    if name in "KZ" or (name == "W" and isinstance(law, ScheduledGain)):
        if isinstance(law, FixedGain):
            return replace(certificate, law=FixedGain(matrices))
        return replace(certificate, law=replace(law, **{name: matrices}))
    return replace(certificate, evidence={**certificate.evidence, name: matrices})


@compiled
def test_the_right_hand_sides_count(physical):
    """tau as large as the search's own is proved; ten times that, and a negative one, are not."""
    good = claim_of(physical, Scheduled(right_hand_sides=True), -40.0)(1e-5)
    tau = float(good.evidence["tau"])
    assert tau > 0
    assert agrees(good)
    much = float(np.trace(good.law.W[0]))
    for other in (0.0, tau / 3, tau * 1e-30, 1e4 * tau, 1e8 * tau):
        agrees(replace(good, evidence={**good.evidence, "tau": np.array(other)}))
    assert not agrees(replace(good, evidence={**good.evidence, "tau": np.array(100 * much)}))
    assert not agrees(replace(good, evidence={**good.evidence, "tau": np.array(-tau)}))


@compiled
@pytest.mark.parametrize("region", [HalfPlane(1), Sector(0.4), HalfPlane(0.5) & Disk(-40, 39.9)])
@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_regions_of_other_kinds(physical, region, method):
    certificate = place(physical, region, method).certificate
    assert agrees(certificate)
    narrow = replace(certificate, region=HalfPlane(30) & region)
    assert not agrees(narrow)


@compiled
def test_gains_that_are_given(physical):
    """Evidence for each part, polynomials on simplex and box."""
    law = place(physical, Disk(-40, 36), "quadratic").law
    certificate = analyse(physical, law, region=Disk(-40, 39) & HalfPlane(0.2)).certificate
    assert agrees(certificate)
    assert not agrees(replace(certificate, region=Disk(-40, 20) & HalfPlane(0.2)))


@compiled
@pytest.mark.parametrize("method", ["quadratic", "scheduled", "slack"])
def test_units_far_apart_take_more_words(method, make_random):
    """Ten to fifteen decades between states: the same verdicts, of far longer numbers."""
    plant = make_random(3, 3, 1, 2)
    U = np.diag([1e-9, 1.0, 1e6])
    A, B = np.linalg.inv(U) @ plant.A @ U, np.linalg.inv(U) @ plant.B
    at = claim_of(UncertainPlant.from_vertices(A, B), method)
    assert agrees(at(1e-4))
    assert not agrees(at(-1e-4))


@compiled
def test_it_does_not_take_what_the_checker_would_refuse(physical, monkeypatch):
    good = claim_of(physical, "quadratic", -40.0)(1e-5)
    huge = replace(
        good, evidence={"W": good.evidence["W"] * (1e300 / np.abs(good.evidence["W"]).max())}
    )
    assert exact.holds(huge) is None
    monkeypatch.setattr(exact, "MAX_WORK", 10**4)
    assert exact.holds(good) is None
    assert good.holds()


def test_where_it_is_not_there_the_checker_proves(physical, monkeypatch):
    at = claim_of(physical, "quadratic", -40.0)
    monkeypatch.setattr(exact, "kernel", lambda: None)
    assert exact.holds(at(1e-5)) is None
    assert at(1e-5).holds()
    assert not at(-1e-5).holds()


@compiled
def test_it_proves_without_the_checker(physical, monkeypatch):
    at = claim_of(physical, "scheduled", -40.0)
    monkeypatch.setattr(Poles, "decided", lambda _: pytest.fail("the checker was asked"))
    assert at(1e-5).holds()
    assert not at(-1e-5).holds()


def refused(certificate) -> bool:
    """Whether it leaves evidence to the checker, which refuses that."""
    with pytest.raises(PlantError):
        certificate.holds()
    return exact.holds(certificate) is None


@compiled
@pytest.mark.parametrize(
    ("method", "change"),
    [
        ("quadratic", {"tau": 1.0}),
        ("quadratic", {"W": None}),
        ("quadratic", {"W": np.eye(3)}),
        ("quadratic", {"W": np.eye(2)[None]}),
        ("quadratic", {"W": np.zeros((0, 0))}),
        ("scheduled", {"on": "simplex"}),
        ("scheduled", {"elevation": 1.5}),
        ("scheduled", {"elevation": True}),
        ("scheduled", {"elevation": "1"}),
        ("scheduled", {"elevation": -1}),
        ("scheduled", {"tau": np.array(np.nan)}),
        ("scheduled", {"tau": np.zeros(1)}),
        ("slack", {"degree": 1.2}),
        ("slack", {"epsilon": np.nan}),
        ("slack", {"P": np.eye(2)[None]}),
    ],
)
def test_it_leaves_evidence_to_the_checker_that_this_refuses(method, change, make_random):
    good = claim_of(make_random(1, 2, 1, 3), method)(1e-3)
    assert agrees(good)
    assert refused(replace(good, evidence={**good.evidence, **change}))
    assert refused(replace(good, evidence={}))


@compiled
def test_it_leaves_evidence_of_given_gains_to_the_checker_that_this_refuses(make_random):
    good = claim_of(make_random(1, 2, 1, 3), "quadratic")(1e-3)
    own = {"X": good.evidence["W"][None], "degree": 0, "elevation": 0}
    good = replace(good, method="lyapunov", evidence={"on": "simplex", "parts": (own,)})
    assert agrees(good)
    for change in ({"tau": 0.0}, {"degree": 0.0}, {"multiple": np.ones(1)}):
        assert refused(replace(good, evidence={"on": "simplex", "parts": (own | change,)}))
    assert refused(replace(good, evidence={"on": "simplex", "parts": (own, own)}))


@compiled
def test_a_law_of_another_plant_proves_nothing():
    """Three vertices of two inputs have as many numbers as four of one."""
    vertices = np.tile([[-3.0, 0, 0], [0, -3, 1]], (4, 1, 1)).reshape(3, 2, 4)
    plant = UncertainPlant.from_vertices(vertices[..., :2], vertices[..., 2:])
    law = ScheduledGain(np.tile(np.eye(2), (4, 1, 1)), np.full((4, 1, 2), -1e-3), (), 1, (4,))
    assert refused(Certificate(plant, Disk(-3, 2), "scheduled", law, {"tau": np.array(0.0)}))


@compiled
def test_numbers_are_read_as_they_are_or_not_at_all(make_random):
    """Of whole numbers that no double holds the checker proves, in place of what is close."""
    good = claim_of(make_random(1, 2, 1, 3), "quadratic")(1e-3)
    whole = np.rint(good.evidence["W"] * 2**59 / np.abs(good.evidence["W"]).max()).astype(np.int64)
    assert exact.holds(replace(good, evidence={"W": whole})) is None


# --- misuse of its doors -------------------------------------------------------------------------


def poles_arguments(plant):
    """What the kernel takes for one matrix W = I and no gain: sizes, plant, forms, and the rest."""
    own = claim_of(plant, "quadratic")(1.0)
    law = FixedGain(np.zeros_like(own.law.K))
    certificate = Certificate(plant, own.region, "quadratic", law, {"W": np.eye(plant.shape[0])})
    taken = []

    class Spy:
        def poles(self, *arguments):
            taken.append(arguments)
            return 0

    exact._quadratic(Spy(), certificate)
    return list(taken[0])


@compiled
def test_its_doors_refuse_what_does_not_fit(make_random):
    door = engine.kernel().poles
    sizes, plant, form, V, pairs, tau, elevation, count, positive = poles_arguments(
        make_random(1, 2, 1, 2)
    )
    powers, multinomials, values = form
    P, data, denominator, n, words = plant
    rest = (pairs, tau, elevation, count, positive)
    assert door(sizes, plant, form, V, *rest) in (0, 1)
    wrong_plants = [
        (P, data[:-8], denominator, n, words),
        (P, data, denominator + b"\0", n, words),
        (P[:, :1].copy(), data, denominator, n, words),
        (P - 1, data, denominator, n, words),
        (P, data, denominator, n + 1, words),
        (P, data, denominator, n, 0),
        (P, b"", denominator, n, words),
    ]
    wrong_forms = [
        (powers, multinomials, values * np.nan),
        (powers, multinomials[:0], values),
        (powers, multinomials * 0, values),
        (powers + 17, multinomials, values),
        (powers, multinomials, values[:, :, :1].copy()),
        (powers, multinomials, values[:0]),
    ]
    calls = [(sizes, own, form, V, *rest) for own in wrong_plants]
    calls += [(sizes, plant, own, V, *rest) for own in wrong_forms]
    calls += [(sizes, plant, form, own, *rest) for own in wrong_forms]
    calls += [
        ((), plant, form, V, *rest),
        ((0,), plant, form, V, *rest),
        ((3,), plant, form, V, *rest),
        (sizes, plant, form, V, [], tau, elevation, count, positive),
        (sizes, plant, form, V, [(pairs[0][0], pairs[0][1][:, :1])], tau, 0, count, positive),
        (sizes, plant, form, V, pairs, np.nan, 1, count, positive),
        (sizes, plant, form, V, pairs, 1.0, 0, count, positive),
        (sizes, plant, form, V, pairs, tau, 17, count, positive),
        (sizes, plant, form, V, pairs, tau, elevation, 0, positive),
    ]
    for call in calls:
        with pytest.raises((ValueError, TypeError)):
            door(*call)
    assert door(sizes, plant, form, V, pairs, tau, elevation, count + 1, positive) == 0


# --- laws that run -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled", Scheduled(1, 0, "box")])
def test_the_cheap_bound_of_the_share_of_rounding_is_none_too_low(
    method, physical, make_random, monkeypatch
):
    """F^-1 is no more than the room left, so the bound no less than the share, at every limit."""
    own = isinstance(method, Scheduled)
    cases = [(physical, -40.0)] if own else [(make_random(k, 3, 1, 4), -3.0) for k in (1, 4)]
    for plant, centre in cases:
        certificate = claim_of(plant, method, centre)(1e-3)
        share = rounding_share(certificate)
        for limit in (share / 2, share * 0.999):
            monkeypatch.setattr("polefence.certify.evaluation.SURE", limit)
            assert not surely_runs(certificate)
