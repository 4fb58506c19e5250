"""Designs for signals: closed forms, brackets on both sides, bounds against other computations."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from polefence import (
    FixedGain,
    HalfPlane,
    InputError,
    NotProvedError,
    PolynomialGain,
    Scheduled,
    Sector,
    UncertainPlant,
    check,
)
from polefence.certify.bounds import bounds_file, each_sampled, sampled
from polefence.cli.optimise import lines_of, rows_of
from polefence.plant.outputs import Output, rate_of
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.search.effort import is_too_fast
from polefence.search.optimise import optimise
from polefence.search.task import Missing, Task, level_of, together
from support.files import bounds_in
from support.hasty import hasty
from support.specs import DENSITY, ONE_STATE, rms

TWO = """
name = "two states"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["w1", "w2"]
[parameter.k]
range = [1, 3]
[parameter.m]
range = [0.8, 1.25]
unit = "kg"
through = "1/m"
[matrices]
A = [[0, 1], ["-k/m", "-0.2/m"]]
B = [[0], ["1/m"]]
E = [[0.1, 0], [0, "0.5/m"]]
"""


@pytest.fixture(scope="module")
def one():
    return loads(ONE_STATE)


@pytest.fixture(scope="module")
def two():
    return loads(TWO)


@pytest.fixture(scope="module")
def designed(two):
    """Every kind of specification."""
    limits = [
        rms("x", 0.6),
        EnergyPeak("v", 0.9, 1.1),
        InitialPeak("force", 3.0, points=((0.3, 0.0), (0.1, -0.4)), impulse=0.5),
        Gain(Output("speed and force", C=[0, 1], D=[0.125]), 3.0),
    ]
    with hasty():
        return optimise(two, rms("force"), limits, method="scheduled")


# --- closed forms: u = -k x has mean squares x^2 = S / (2 (k - a)), u^2 = k^2 x^2 ----------------


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
@pytest.mark.parametrize("limit", [None, 0.1, 0.4])
def test_the_least_force_is_that_of_the_closed_form(one, method, limit):
    a = 2.0  # the worst
    gain = 2 * a if limit is None else max(2 * a, a + 1 / (2 * limit**2))
    least = gain / math.sqrt(2 * (gain - a))
    limits = [] if limit is None else [rms("x", limit)]
    done = optimise(one, rms("force"), limits, method=method)
    assert least <= done.bounds[0].level * (1 + 1e-12)
    assert done.bounds[0].level == pytest.approx(least, rel=1e-5)
    assert done.bounds[0].level <= done.shared == pytest.approx(least, rel=1e-5)
    assert (done.designed, done.bound("force")) == (HalfPlane(0), done.bounds[0])
    assert [b.level for b in done.bounds[1:]] == [s.at_most for s in limits]


@pytest.mark.parametrize("method", ["quadratic", Scheduled(1, 0, "box")])
def test_what_one_matrix_proves_is_proved(two, method):
    """It is no less than the bound of the answer."""
    asked = two, rms("force"), [rms("x", 0.6)], HalfPlane(0.1), method
    done = optimise(*asked)
    assert done.bounds[0].level <= done.shared < math.inf
    task = Task(two, asked[1], tuple(asked[2]), asked[3], method)
    found = task.reached(asked[3])
    law = task.law(found)
    certificate, bounds = together(task, law, found)
    assert certificate.region == asked[3]
    assert [own.level for own in bounds] == [done.shared, 0.6]
    assert all(prove(own.claim).proved for own in bounds)


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
@pytest.mark.parametrize("nothing", [None, "known_bound", "Certificate"])
def test_where_one_matrix_has_no_proof_nothing_is_said_of_it(one, method, nothing, monkeypatch):
    if nothing is not None:
        bare = SimpleNamespace(holds=lambda: False)  # as a certificate; no bound
        nothing_of_it = bare if nothing == "Certificate" else None
        monkeypatch.setattr(f"polefence.search.task.{nothing}", lambda *_: nothing_of_it)
    done = optimise(one, rms("force"), [rms("x", 0.4)], HalfPlane(0.1), method)
    assert (done.shared < math.inf) is (nothing is None)
    said = any("one Lyapunov" in line for line in lines_of(done, rows_of(done), "law"))
    assert said is (nothing is None)


@pytest.mark.parametrize(("share", "reached"), [(1 + 1e-4, True), (1 - 1e-4, False)])
def test_limits_are_bracketed(one, share, reached):
    limits = [rms("x", 0.1), rms("force", 5.2 * share)]  # the least, by the closed form
    if reached:
        assert optimise(one, rms("x"), limits, method="scheduled").bounds[0].level <= 0.1
        return
    with pytest.raises(NotProvedError, match="no law keeps these at once") as answer:
        optimise(one, rms("x"), limits, method="scheduled")
    named = str(answer.value).partition("times each: ")[2]
    assert named == "rms of x <= 0.1; rms of force <= 5.19948"


def test_a_conflict_names_no_more_than_it_takes(one, lmi_alone):
    limits = [rms("x", 0.1), Gain("x", 50.0), rms("force", 1.9), EnergyPeak("x", 9.0)]
    with pytest.raises(NotProvedError) as answer:
        optimise(one, rms("x"), limits, HalfPlane(0.1), method="scheduled")
    # stable alone takes a force of 2
    assert str(answer.value).endswith("times it: rms of force <= 1.9")
    with pytest.raises(NotProvedError, match="finds no law for all of these limits") as answer:
        optimise(
            one,
            rms("x"),
            [Gain("x", 0.01), rms("force", 2.1), EnergyPeak("x", 9.0)],
            method="scheduled",
        )
    assert str(answer.value).endswith("dropped: gain of x <= 0.01; rms of force <= 2.1")


def test_a_region_out_of_reach_is_not_proved(one):
    with pytest.raises(NotProvedError, match="rms of force <= 3"):
        optimise(one, rms("force"), [rms("force", 3.0)], HalfPlane(50), method="scheduled")


# --- what is proved against other computations --------------------------------------------------


def loops(done, alpha):
    A, B = done.plant.at(alpha)
    E = np.tensordot(alpha, np.stack([v.E for v in done.plant.vertices]), 1)
    K = done.law.gain(alpha)
    return A + B @ K, E, K


def norm_below(A, E, C, level):
    """Whether the H-infinity norm is below a level: the Hamiltonian has no imaginary eigenvalue."""
    H = np.block([[A, E @ E.T / level**2], [-C.T @ C, -A.T]])
    return np.abs(np.linalg.eigvals(H).real).min() > 1e-9


def test_everything_that_is_proved_is_met(designed):
    alpha = seeded(designed.plant, 60)
    force, x, v, peak, gain = designed.bounds
    own = [sampled(designed.plant, designed.law, b.specification, alpha) for b in designed.bounds]
    for k, (A, E, K) in enumerate(zip(*loops(designed, alpha), strict=True)):
        assert designed.design.region.contains(np.linalg.eigvals(A)[None])
        P = solve_continuous_lyapunov(A, -E @ E.T)
        exactly = [math.sqrt((K @ P @ K.T).item()), math.sqrt(P[0, 0]), 1.1 * math.sqrt(P[1, 1])]
        for value, bound, sample in zip(exactly, (force, x, v), own, strict=False):
            assert sample.values[k] == pytest.approx(value, rel=1e-9)
            assert value < bound.level
        starts = np.array([[0.3, 0.0], [0.1, -0.4], *(0.5 * E.T)]).T
        step, state, largest = expm(A * 0.01), starts, 0.0
        for _ in range(1500):
            largest = max(largest, np.abs(K @ state).max())
            state = step @ state
        assert largest < peak.level
        assert own[3].values[k] == pytest.approx(largest, rel=2e-2)
        C = np.array([[0.0, 1.0]]) + 0.125 * K
        assert norm_below(A, E, C, gain.level)
        assert norm_below(A, E, C, own[4].values[k] * (1 + 1e-3) if k in worst(own[4]) else 3.0)
        assert not norm_below(A, E, C, own[4].values[k] * (1 - 1e-9))
    for bound, sample in zip(designed.bounds, own, strict=True):
        assert sample.worst <= bound.level


def test_the_ratio_to_no_control_is_met_point_by_point(two):
    least, limits = RelativeRms("v", density=DENSITY), [rms("force", 3.0)]
    done = optimise(two, least, limits, method="scheduled")
    alpha = seeded(two, 40)
    ratios = []
    for (A, E, _), bare in zip(
        zip(*loops(done, alpha), strict=True), two.at(alpha)[0], strict=True
    ):
        own, other = (solve_continuous_lyapunov(M, -E @ E.T)[1, 1] for M in (A, bare))
        ratios.append(math.sqrt(own / other))
    found = sampled(two, done.law, done.bounds[0].specification, alpha)
    assert found.values == pytest.approx(np.array(ratios), rel=1e-9)
    assert found.worst < done.bounds[0].level < 1
    claims = [bound.claim for bound in done.bounds]
    read = bounds_in(bounds_file(done.design.certificate, claims).dumps())
    assert read == claims


def worst(sample):
    return np.argsort(-sample.values)[:20]


def test_the_region_is_proved_as_it_was_asked(designed, one):
    parts = HalfPlane(0.3) & Sector(0.2)
    asked = (
        (HalfPlane(0), designed),
        (parts, optimise(one, rms("force"), [rms("x", 0.4)], parts, method="scheduled")),
    )
    for region, done in asked:
        assert done.design.region == region
        assert check(done.design).proved
    assert [b.specification.kind for b in designed.bounds] == [
        "rms", "rms", "energy peak", "initial peak", "gain",
    ]  # fmt: skip
    assert designed.bounds[0].level <= designed.shared


def test_samples_are_of_the_family(two):
    alpha = seeded(two, 500)
    assert np.array_equal(alpha, seeded(two, 500))
    assert alpha.shape == (500, 4)
    assert np.array_equal(alpha[:4], np.eye(4))
    assert np.allclose(alpha[:, 0] * alpha[:, 3], alpha[:, 1] * alpha[:, 2], atol=1e-15)  # products
    mass = 1 / (alpha[:, [0, 2]].sum(axis=1) / 0.8 + alpha[:, [1, 3]].sum(axis=1) / 1.25)
    assert (mass.min(), mass.max()) == pytest.approx((0.8, 1.25))
    assert mass.mean() == pytest.approx((0.8 + 1.25) / 2, abs=0.02)  # uniform in m, not in 1/m
    bare = UncertainPlant.from_vertices([[[1]], [[2]], [[3]]], [[[1]]] * 3)
    assert seeded(bare, 50).sum(axis=1) == pytest.approx(1)


def test_a_signal_may_be_minimised_and_limited(two):
    """Both are sampled from one covariance, which has the signal once."""
    alpha, law = seeded(two, 20), FixedGain([[-1.0, -2.0]])
    twice = each_sampled(two, law, [Rms("x"), Rms("force"), Rms("x", 5.0)], alpha)
    alone = each_sampled(two, law, [Rms("x"), Rms("force")], alpha)
    assert np.array_equal(twice[0].values, twice[2].values)
    for both, single in zip(twice, alone, strict=False):
        assert both.values == pytest.approx(single.values, rel=1e-12)


# --- the file -------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["quadratic", Scheduled(2, 0, "box"), Scheduled(1, 1)])
def test_a_file_holds_the_numbers_that_were_proved(one, method, tmp_path, lmi_alone):
    third = Output("a third", C=[1 / 3], D=[0.1])
    limits = [InitialPeak("x", 2.0, ((0.1,),), 1.0), Gain("x", 3.0), EnergyPeak(third, 3.0, 2.0)]
    done = optimise(one, rms("force"), limits, method=method)
    claims = [bound.claim for bound in done.bounds]
    found = bounds_in(bounds_file(done.design.certificate, claims).dumps())
    assert found == claims
    done.save(tmp_path / "new")
    answer = check(tmp_path / "new")
    assert answer.proved
    poles, force, initial, gain, peak = answer.claims
    assert poles.startswith("poles in half_plane(0), of A + B K with ")
    assert force.startswith("rms of 'force' = u1 <= 2.0")
    start = "x(0) = (0.1), or from an impulse 1 in w1"
    assert initial.startswith(f"initial peak of 'x' = x1 <= 2 from {start}, on the ")
    assert gain.startswith("gain of 'x' = x1 <= 3, on the ")
    third_text = "'a third' = ~0.333333 x1 + 0.1 u1"
    assert peak.startswith(f"energy peak of {third_text} <= 3 at norm 2, on the ")


# --- what is refused ------------------------------------------------------------------------------

REFUSED = {
    "signal": (rms("forze"), "no signal 'forze'; did you mean 'force'?"),
    "no limit": ([rms("x")], "the limit of 'x' is missing; give at_most"),
    "no specification": ("force", "minimise is 'force'; give a Specification"),
    "no such limit": (["x <= 2"], "subject_to is 'x <= 2'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused(one, case):
    asked, message = REFUSED[case]
    least, limits = (rms("force"), asked) if isinstance(asked, list) else (asked, [])
    with pytest.raises(InputError) as error:
        optimise(one, least, limits, method="scheduled")
    assert message in str(error.value) or case.startswith("no s")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, True, "1"])
def test_a_limit_is_a_positive_number(value):
    with pytest.raises(InputError, match=r"at_most = .* of 'x' must be a positive number"):
        Rms("x", value)
    with pytest.raises(InputError, match="must be a positive number"):
        Rms("x", density=value)
    with pytest.raises(InputError, match="must be a positive number"):
        EnergyPeak("x", norm=value)


def test_plants_that_say_too_little_are_refused(one):
    bare = loads(ONE_STATE.replace("E = [[1]]", "").replace('disturbances = ["w [m/s]"]', ""))
    with pytest.raises(InputError, match="has no E, so no disturbance enters; give E"):
        optimise(bare, rms("force"), method="scheduled")
    with pytest.raises(InputError, match="give points or an impulse"):
        InitialPeak("x", 1.0)
    with pytest.raises(InputError, match="state 1 of points has 2 numbers; .* has 1 states: x"):
        optimise(one, rms("force"), [InitialPeak("x", 1.0, ((1.0, 2.0),))], method="scheduled")
    with pytest.raises(InputError, match="a disturbance passes straight into 'rate'"):
        optimise(one, rms(rate_of(one, "x", "rate")), method="scheduled")
    with pytest.raises(InputError, match="optimise takes the methods 'quadratic' and Scheduled"):
        optimise(one, rms("force"), method="slack")


def test_unstable_loops_are_not_sampled(one):
    for own in (rms("x"), Gain("x"), EnergyPeak("x"), InitialPeak("x", impulse=1.0)):
        with pytest.raises(InputError, match="has a pole at"):
            sampled(one, None, own, seeded(one, 10))


def test_effort_that_nothing_limits_ends_at_a_law_to_be_built_and_says_so(two):
    limits, method = [rms("v", 0.5)], "quadratic"
    task = Task(two, rms("x"), tuple(limits), HalfPlane(0.2), method)
    wild = task.reached(task.region)
    assert is_too_fast(two, task.law(wild))
    found = optimise(two, rms("x"), limits, task.region, method)
    assert found.bounded_by.startswith("poles of at most")
    fastest = np.abs(np.linalg.eigvals(two.A)).max()
    assert np.abs(np.linalg.eigvals(two.A + two.B @ found.law.K)).max() < 200 * fastest
    assert level_of(task, wild) <= found.bounds[0].level <= level_of(task, wild) * 1.15
    assert check(found.design).proved


@pytest.mark.parametrize(
    ("method", "law"), [("quadratic", FixedGain), (Scheduled(2, 0, "box"), PolynomialGain)]
)
def test_a_method_names_the_freedom_of_a_law_that_may_be_tuned(two, method, law):
    """One matrix pays for the region and each limit, whether they bound the law or not."""
    limits, region = (rms("force", 2.0),), HalfPlane("0.4") & Sector("0.8")
    done = optimise(two, rms("x"), limits, region, method)
    assert isinstance(done.law, law)
    assert check(done.design).proved
    assert done.bounds[0].level < 0.95 * done.shared
    if law is PolynomialGain:
        assert done.law.degree <= 2
        one = optimise(two, rms("x"), limits, region, "quadratic")
        assert done.bounds[0].level < one.bounds[0].level


def test_a_law_that_no_search_tunes_is_that_of_the_method(one, monkeypatch, lmi_alone):
    asked = one, rms("force"), [rms("x", 0.4)], HalfPlane(0.1), "quadratic"
    whole = optimise(*asked)
    monkeypatch.setattr("polefence.search.optimise.together", lambda *_: None)
    done = optimise(*asked)
    assert np.array_equal(done.law.K, whole.law.K)
    assert whole.shared < math.inf == done.shared
    assert done.bounds[0].level == pytest.approx(whole.bounds[0].level, rel=1e-5)
    monkeypatch.setattr("polefence.search.optimise.candidate", lambda *_: Missing.REGION)
    with pytest.raises(NotProvedError, match="a bound or the region was not proved of the law"):
        optimise(*asked)
