"""Sampled loops: poles by other means, analytic limits, simulation, the document."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import Disk, FixedGain, HalfPlane, Sector, UncertainPlant, analyse, place
from polefence.base.errors import InputError
from polefence.certify.at_samples import at_samples
from polefence.examples import family
from polefence.export.decay import prove_decay
from polefence.export.program import number, program
from polefence.export.sampled import largest_sample_time, sampled_poles, sampling_effect
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import prove
from polefence.proof.claims.rounding import Rounded, rounding_error
from polefence.proof.document import check, from_plain, loads
from polefence.proof.work import FormatError
from polefence.response import samples

TIME = 0.002


@cache
def car(tight=False):
    region = Disk(-40, 31) if tight else HalfPlane(2) & Sector(0.3)
    return place(family("quarter-car-physical"), region, "scheduled")


@cache
def proof():
    return prove_decay(car(), TIME)


@cache
def integrator():
    plant = UncertainPlant.from_vertices([[[0]]], [[[1]]])
    return place(plant, Disk(-4, 1), "quadratic")


def stepped(design, alpha, time, delay):
    """The loop at the samples, from scipy's exponential."""
    A, B = design.plant.at(alpha)
    (n, m), K = design.plant.shape, design.law.gain(alpha)
    F = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)[:n]
    if not delay:
        return F[:, :n] + F[:, n:] @ K
    return np.block([[F], [K, np.zeros((m, m))]])


def some(design, count):
    values = np.random.default_rng(3).random((count, 2))
    low, width = [231.12, -10.0], [115.56, 20.0]
    m1, beta = (low + values * width).T
    return np.array([design.plant.alpha(m1=m, beta=b) for m, b in zip(m1, beta, strict=True)])


@pytest.mark.parametrize("delay", [0, 1])
def test_poles_are_those_of_scipys_loop(delay):
    alphas = some(car(), 12)
    found = sampled_poles(car(), alphas, TIME, delay)
    assert found.equivalent.shape == (12, 5)
    assert found.z.shape == (12, 5 + delay)
    for a, z, s in zip(alphas, found.z, found.equivalent, strict=True):
        own = np.linalg.eigvals(stepped(car(), a, TIME, delay))
        own = own[np.argsort(-np.abs(own))]
        assert np.allclose(np.poly(z), np.poly(own), atol=1e-9)
        assert np.allclose(np.abs(z), np.abs(own), atol=1e-7)
        assert np.allclose(np.exp(s * TIME), z[:5], atol=1e-12)


@pytest.mark.parametrize("delay", [0, 1])
def test_short_samples_have_the_poles_of_continuous_time(delay):
    alphas = some(car(), 5)
    own = np.sort_complex(car().poles(alphas))
    off = [
        np.abs(np.sort_complex(sampled_poles(car(), alphas, time, delay).equivalent) - own).max()
        for time in (1e-5, 1e-6)
    ]
    assert off[1] < 0.5
    assert 8 < off[0] / off[1] < 12  # of first order


def test_sampling_finds_what_leaves_the_region():
    good, bad = (sampling_effect(car(tight=True), time) for time in (1e-4, 1e-3))
    assert good.inside
    assert good.stable
    assert not bad.inside
    assert bad.stable
    assert good.points > 10_000
    K = stepped(car(tight=True), bad.alpha, 1e-3, 1)
    z = np.linalg.eigvals(K)
    s = np.log(z[np.argsort(-np.abs(z))][:5].astype(complex)) / 1e-3
    assert np.isclose(car(tight=True).region.distance(s).max(), bad.distance, rtol=1e-6)
    assert set(bad.values) == {"m1", "beta"}
    # no pole found by other means is slower
    slowest = max(
        np.abs(np.linalg.eigvals(stepped(car(tight=True), a, 1e-3, 1))).max()
        for a in some(car(tight=True), 50)
    )
    assert -math.log(slowest) / 1e-3 >= bad.decay - 1e-6


@pytest.mark.parametrize(("delay", "limit"), [(0, 2.0), (1, 1.0)])
def test_the_largest_sample_time_of_an_integrator_is_known(delay, limit):
    # z = 1 - k T, and z^2 - z + k T = 0
    k = -float(integrator().law.K[0, 0])
    found = largest_sample_time(integrator(), delay)
    assert found.stable == pytest.approx(limit / k, rel=2e-3)
    assert found.stable <= limit / k
    assert found.region < found.stable < found.longest


def test_the_largest_sample_time_of_the_car_holds_and_hardly_more():
    found = largest_sample_time(car(tight=True), 1)
    assert 2e-4 < found.region < 4e-4 < 5e-3 < found.stable < 1e-2
    assert sampling_effect(car(tight=True), found.region).inside
    assert not sampling_effect(car(tight=True), 1.02 * found.region).inside
    assert sampling_effect(car(tight=True), found.stable).stable
    assert not sampling_effect(car(tight=True), 1.02 * found.stable).stable


def test_the_proved_decay_is_below_the_sampled_one_and_near():
    found = proof()
    assert found.proved
    assert 0.998 * found.sampled < found.decay < found.sampled
    assert found.reason == ""
    assert found.sampled == pytest.approx(sampling_effect(car(), TIME).decay, rel=1e-9)


def test_the_samples_and_their_law_are_proved_to_decay_no_slower():
    for delay in (0, 1):
        found = proof() if delay else prove_decay(car(), TIME, 0)
        held = found.rounded.design
        assert held.certificate.prove().proved
        assert held.region.radius <= math.exp(-found.decay * TIME)
        seen, law = at_samples(car().plant, car().law, TIME, delay)
        assert analyse(seen, law, Disk(0, math.exp(-0.99 * found.decay * TIME))).proved


def test_long_samples_of_a_fast_aircraft_are_proved_nearly_to_the_end():
    """A fifth of what keeps it stable: between the vertices its samples are far from affine."""
    region = HalfPlane(6) & Sector(0.7) & Disk(-13, 11)
    aircraft = place(family("f16"), region, "scheduled")
    for time, share in ((0.02, 0.998), (0.0455, 0.9)):
        found = prove_decay(
            aircraft, time, 1, program(aircraft.law, aircraft.plant.parameters, number(32))
        )
        assert share * found.sampled < found.decay < found.sampled


def test_a_simulation_decays_as_proved():
    """From many states, x and the input that is under way; over time, not by poles."""
    found, random = proof(), np.random.default_rng(4)
    assert found.proved
    for a in some(car(), 6):
        step = stepped(car(), a, TIME, 1)
        states = random.normal(size=(6, 20)) * np.array([[1.0]] * 5 + [[1e4]])
        sizes = [np.linalg.norm(states, axis=0).max()]
        for _ in range(1200):
            states = step @ states
            sizes.append(np.linalg.norm(states, axis=0).max())
        slope = (math.log(sizes[1200]) - math.log(sizes[200])) / (1000 * TIME)
        assert slope < -found.decay + 0.5
        scaled = np.array(sizes) * np.exp(found.decay * TIME * np.arange(1201))
        assert scaled[600:].max() < scaled[:600].max()


def test_rounding_and_sampling_are_proved_together():
    made = program(car().law, car().plant.parameters, number(32))
    found = prove_decay(car(), TIME, 1, made)
    assert found.proved
    assert 0.99 * found.sampled < found.decay <= proof().decay
    claim = found.rounded.claim
    assert prove(claim).proved
    assert prove(only_claim_of_code(found.file().dumps())).proved
    less = replace(claim, gain=replace(claim.gain, error=rounding_error(claim) / 2))
    assert not prove(less).proved
    with pytest.raises(InputError, match="not stable"):
        prove_decay(car(), 5e-3).file()


def only_claim_of_code(text):
    return loads(text).first(Rounded)


def test_an_unstable_loop_is_not_proved_and_said_so():
    found = prove_decay(car(), 5e-3)
    assert not found.proved
    assert found.decay == 0
    assert found.sampled < 0
    assert "not stable" in found.reason
    assert found.check().answer == "undecided"


def test_the_proof_reaches_near_to_the_limit_of_stability():
    k = -float(integrator().law.K[0, 0])
    found = prove_decay(integrator(), 0.95 / k, 1)
    assert found.proved
    assert 0 < found.decay <= found.sampled
    assert not prove_decay(integrator(), 1.05 / k, 1).proved


def springs():
    def at(m, k):
        return [[0, 1], [-k / m, -2 / m]], [[0], [1 / m]]

    bounds = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 4, 9, "N/m")]
    return UncertainPlant.from_function(at, bounds)


@pytest.fixture
def at_nodes(monkeypatch):
    """Samples known at nodes, as those of many parameters and states are."""

    def refused(*_):
        raise FormatError("as of more parameters and states")

    monkeypatch.setattr(samples, "_with_remainder", refused)


@pytest.mark.usefixtures("at_nodes")
def test_a_loop_whose_samples_are_known_at_nodes_is_proved_in_parts():
    plant = springs()
    design = analyse(plant, FixedGain([[-2.0, -1.0]]), HalfPlane(0)).design
    found = prove_decay(design, 0.1, 1, program(design.law, plant.parameters, number(32)))
    assert found.rounded.design.plant.bent
    assert found.proved
    assert 0.5 * found.sampled < found.decay < found.sampled
    document = loads(found.file().dumps())
    assert len(document.first(Rounded).gain.subject.design.evidence[0].cells) > 1
    assert check(document).proved
    table = found.file().write()
    del table["plant"]["nodes"][0]
    with pytest.raises(FormatError, match="no node"):
        from_plain(table)


@pytest.mark.usefixtures("at_nodes")
def test_parts_of_the_box_reach_near_to_the_limit_of_stability():
    plant = springs()
    design = analyse(plant, FixedGain([[-40.0, -8.0]]), HalfPlane(0)).design
    limit = largest_sample_time(design).stable
    code = program(design.law, plant.parameters, number(32))
    near, beyond = (prove_decay(design, share * limit, 1, code) for share in (0.95, 1.02))
    assert 0 < near.decay <= near.sampled
    assert not beyond.proved
    rounded = near.rounded.claim
    assert prove(rounded).proved
    # a hundred thousand times the rounding error is more than these parts bear
    off = replace(rounded.gain, error=rounded.gain.error * 10**5)
    assert not prove(replace(rounded, gain=off)).proved


def test_a_claim_may_have_a_multiplier_for_each_of_many_parts():
    rounded = proof().rounded.claim
    table = proof().file().write()
    (claim,) = [c for c in table["claims"] if c["kind"] == Rounded.kind]
    claim["gain"]["mu"] = claim["gain"]["mu"] * 300
    with pytest.raises(FormatError, match=f"mu must hold {len(rounded.gain.mu)} numbers"):
        check(from_plain(table))


@pytest.mark.parametrize("time", [0, -1.0, math.nan, math.inf, "fast", None])
def test_a_sample_time_is_a_positive_number(time):
    for function in (sampling_effect, prove_decay):
        with pytest.raises(InputError, match="sample_time"):
            function(car(), time)


def test_delays_are_none_or_one():
    for function in (lambda d: sampling_effect(d, TIME, 2), lambda d: largest_sample_time(d, -1)):
        with pytest.raises(InputError, match="delay"):
            function(car())


def test_a_discrete_time_plant_is_sampled_already():
    plant = UncertainPlant.from_vertices([[[1.2]]], [[[1]]], sample_time=0.01)
    design = place(plant, Disk(0, 0.5), "quadratic")
    for function in (lambda: sampling_effect(design, TIME), lambda: largest_sample_time(design)):
        with pytest.raises(InputError, match="discrete-time plant"):
            function()


def test_samples_too_long_for_floating_point_are_refused():
    plant = UncertainPlant.from_vertices([[[2.0]]], [[[1]]])
    design = place(plant, Disk(-4, 1), "quadratic")
    assert isinstance(design.law, FixedGain)
    with pytest.raises(InputError, match="outgrows"):
        sampling_effect(design, 1000.0)
