"""Parameters that move in discrete time: against products of matrices, motions, and limits."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
from numpy.linalg import eigvals, multi_dot

from polefence import (
    Disk,
    EnergyPeak,
    FixedGain,
    Gain,
    HalfPlane,
    InitialPeak,
    Rms,
    Scheduled,
    Slack,
    UncertainPlant,
    at_sample_time,
    optimise,
    place,
    tightest,
)
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound
from polefence.certify.given import analyse
from polefence.plant.exact import ranges_of
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from polefence.proof.laws import Evidence
from polefence.proof.work import FormatError

T = Fraction(1, 2)  # s
NO_LAW = FixedGain(np.zeros((1, 2)))
BOX = Scheduled(1, 0, "box")
NAMES = {
    "name": "walk",
    "states": ("x [m]", "v [m/s]"),
    "inputs": ("u [N]",),
    "disturbances": ("w [N]",),
}


def walk(rate=None, low=0.4, high=1.2, other=None):
    """Two states, of which one feeds back on the other through p, or through 1/q as well."""

    def matrices(p, q=1):
        return [[0.9, 0.4], [-0.5 * p / q, 0.7]], [[0], [1]], [[0.1], [0.3]]

    parameters = [Parameter("p", low, high, rate=rate)]
    if other is not None:
        parameters.append(Parameter("q", 1, 2, "kg", "1/q", rate=other))
    return UncertainPlant.from_function(matrices, parameters, sample_time=T, **NAMES)


def motions(plant, count, steps, seed=0):
    """Values of the parameters at samples, (steps, count, parameters), at full speed or jumping."""
    random = np.random.default_rng(seed)
    low, high = (
        np.array([float(getattr(p, end)) for p in plant.parameters]) for end in ("low", "high")
    )
    p = random.uniform(low, high, (count, len(low)))
    turning = random.uniform(0.02, 0.6, (count, 1))
    sign, found = random.choice([-1.0, 1.0], size=p.shape), []
    for _ in range(steps):
        found.append(p.copy())
        sign = np.where(random.uniform(size=p.shape) < turning, -sign, sign)
        for f, own in enumerate(plant.parameters):
            if own.rate == "any":
                p[:, f] = np.where(sign[:, f] > 0, high[f], low[f])
            elif own.rate is not None:
                rate = np.where(sign[:, f] > 0, float(own.rate[1]), float(own.rate[0]))
                p[:, f] = p[:, f] + float(T) * rate
        p = np.clip(p, low, high)
    return np.stack(found)


def loops(plant, law, path):
    """Closed loops and alpha along motions."""
    steps, count, f = path.shape
    alpha = np.ones((steps * count, 1))
    for own, p in zip(plant.parameters, path.reshape(-1, f).T, strict=True):
        s = 1 / p if own.inverted else p
        low, high = (float(own.scheduling(end)) for end in (own.low, own.high))
        share = ((s - low) / (high - low))[:, None]
        alpha = (alpha[:, :, None] * np.hstack([1 - share, share])[:, None]).reshape(len(p), -1)
    A, B = plant.at(alpha)
    A = A + B @ law.gain(alpha)
    return A.reshape(steps, count, *A.shape[1:]), alpha.reshape(steps, count, -1)


def factor(plant):
    """The least factor a sample that is proved of the plant alone, to a thousandth."""
    low, high = 0.0, 1.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        if analyse(plant, NO_LAW, Disk(0, middle)).proved:
            high = middle
        else:
            low = middle
    return high


def words(length):
    """All sequences of the two ends of up to a length."""
    return (own for k in range(1, length + 1) for own in product((0, 1), repeat=k))


# --- limits --------------------------------------------------------------------------------------


def test_at_any_rate_it_is_what_switching_does():
    """The joint spectral radius of the two ends, from below by products of up to ten."""
    plant = walk("any")
    A = [v.A for v in plant.vertices]
    products = ((multi_dot([np.eye(2), *(A[i] for i in own)]), len(own)) for own in words(10))
    below = max(np.abs(eigvals(M)).max() ** (1 / length) for M, length in products)
    still = max(np.abs(eigvals(M)).max() for M in A)
    assert still < below - 0.02  # motions matter
    proved = factor(plant)
    assert below <= proved <= below * 1.01
    assert factor(walk(None)) == pytest.approx(still, abs=2e-3)


KINDS = [
    Rms("x", density=2.0),
    Gain("x"),
    EnergyPeak("x", norm=1.0),
    InitialPeak("x", points=[(1.0, 0.0)]),
]


@pytest.mark.parametrize("asked", KINDS, ids=lambda own: own.kind)
def test_slow_parameters_are_at_rest_and_fast_ones_anywhere(asked):
    rates = (None, (-1e-5, 1e-5), (-0.02, 0.02), (-0.2, 0.2), (-2, 2), "any")
    levels = [best_bound(walk(rate), NO_LAW, asked).level for rate in rates]
    assert levels[1] == pytest.approx(levels[0], rel=1e-3)
    assert levels[-2] == levels[-1]  # the whole interval in one sample
    assert all(a <= b * (1 + 1e-6) for a, b in pairwise(levels[:4]))


def test_a_rate_is_one_a_second():
    """Half the sample time and twice the rate are the same."""
    asked = Rms("x", density=2.0)
    twice = replace(walk((-0.2, 0.2)), sample_time=T / 2)
    one = best_bound(walk((-0.1, 0.1)), NO_LAW, asked).level
    # noise of this density has twice the variance at half the sample time
    assert best_bound(twice, NO_LAW, asked).level == pytest.approx(one * np.sqrt(2), rel=1e-6)


# --- trajectories --------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [(-0.05, 0.05), (-0.1, 0.02)])
@pytest.mark.parametrize("other", [None, (-0.05, 0.05)])
def test_no_motion_of_a_thousand_exceeds_the_rms(rate, other):
    plant, density = walk(rate, other=other), 2.0
    bound = best_bound(plant, NO_LAW, Rms("x", density=density))
    path = motions(plant, 1000, 200)
    A, _ = loops(plant, NO_LAW, path)
    E = np.array([[0.1], [0.3]])
    P, most, Q = np.zeros((1000, 2, 2)), 0.0, E @ E.T * density / (2 * float(T))
    for own in A:
        P = own @ P @ own.swapaxes(1, 2) + Q
        most = max(most, float(P[:, 0, 0].max()))
    assert 0.6 * bound.level < np.sqrt(most) <= bound.level


def test_no_sequence_of_jumps_exceeds_the_rms():
    plant = walk("any")
    bound = best_bound(plant, NO_LAW, Rms("x", density=2.0))
    A, E, most = [v.A for v in plant.vertices], np.array([[0.1], [0.3]]), 0.0
    for own in words(8):
        P = np.zeros((2, 2))
        for i in own * (100 // len(own)):
            P = A[i] @ P @ A[i].T + E @ E.T / float(T)
            most = max(most, P[0, 0])
    assert 0.6 * bound.level < np.sqrt(most) <= bound.level


@pytest.mark.parametrize("rate", [(-0.1, 0.1), "any"])
def test_no_motion_of_a_thousand_passes_peaks_and_gain(rate):
    plant = walk(rate)
    A, _ = loops(plant, NO_LAW, motions(plant, 1000, 200))
    E, x = np.array([0.1, 0.3]), np.tile([1.0, 0.0], (1000, 1))
    most = np.abs(x[:, 0]).max()
    for own in A:
        x = np.einsum("cij,cj->ci", own, x)
        most = max(most, np.abs(x[:, 0]).max())
    assert most <= best_bound(plant, NO_LAW, KINDS[3]).level
    w = np.random.default_rng(1).normal(size=(200, 1000)).cumsum(axis=0)
    w *= np.exp(-np.linspace(0, 6, 200))[:, None]
    x, y = np.zeros((1000, 2)), []
    for own, push in zip(A, w, strict=True):
        y.append(x[:, 0])
        x = np.einsum("cij,cj->ci", own, x) + push[:, None] * E
    seen = np.linalg.norm(np.array(y), axis=0) / np.linalg.norm(w, axis=0)
    assert seen.max() <= best_bound(plant, NO_LAW, KINDS[1]).level
    energy = np.sqrt(float(T)) * np.linalg.norm(w, axis=0)
    assert (np.abs(y).max(axis=0) / energy).max() <= best_bound(plant, NO_LAW, KINDS[2]).level


def exchanged(rate):
    """Two states that feed each other, one at a time: jumps drive them, no value at rest does."""

    def matrices(p):
        return [[0, 0.9 * (1 - p)], [0.9 * p, 0]], [[1], [1]], [[0.1], [0.1]]

    return UncertainPlant.from_function(
        matrices, [Parameter("p", 0, 1, rate=rate)], sample_time=1, **NAMES
    )


@pytest.mark.parametrize("plant", [walk("any"), exchanged("any")], ids=["walk", "exchanged"])
def test_no_sequence_of_jumps_exceeds_the_gain(plant):
    """The norm of what takes 60 samples of w to those of x, for every sequence repeated."""
    bound = best_bound(plant, NO_LAW, Gain("x"))
    A, E, most, count = [v.A for v in plant.vertices], plant.vertices[0].E, 0.0, 60
    for own in words(6):
        H, columns = np.zeros((count, count)), np.zeros((2, count))
        for k in range(count):
            H[k] = columns[0]
            columns = A[own[k % len(own)]] @ columns
            columns[:, k : k + 1] += E
        most = max(most, float(np.linalg.norm(H, 2)))
    assert 0.45 * bound.level < most <= bound.level  # X is affine


def test_an_impulse_leaves_its_state_when_parameters_have_moved():
    def matrices(p):
        return [[0, 0], [0, 0]], [[1], [1]], [[1 - p], [p]]

    plant = UncertainPlant.from_function(
        matrices, [Parameter("p", 0, 1, rate="any")], sample_time=1, **NAMES
    )
    asked = InitialPeak("x", impulse=1.0)
    with pytest.raises(InputError, match="when an impulse has acted, p has moved, and E varies"):
        best_bound(plant, NO_LAW, asked)
    # a matrix that would be enough at rest: p may jump, and the state is another than X holds
    still = replace(plant, parameters=(Parameter("p", 0, 1),))
    claim = best_bound(still, NO_LAW, asked).claim
    X = [[[[Fraction(9, 8), 0], [0, Fraction(1, 8)]], [[Fraction(1, 8), 0], [0, Fraction(9, 8)]]][k]
         for k in (0, 1)]  # fmt: skip
    evidence = Evidence(X, 1, 6)
    rows = [[[Fraction(0), Fraction(1)]], [[Fraction(1), Fraction(0)]]]
    output = replace(claim.outputs[0], C=rows)
    own = replace(claim.subject, evidence=evidence, on="box")
    peak = replace(claim, subject=own, outputs=(output,), level=Fraction(3, 4))
    assert prove(peak).proved  # at rest
    moving = replace(own, motion=ranges_of(plant))
    verdict = prove(replace(peak, subject=moving))
    assert not verdict.proved
    assert "of impulse 1, rates" in verdict.reason


@pytest.mark.parametrize("method", ["quadratic", BOX])
def test_a_design_decays_along_every_motion(method):
    plant, region = walk((-0.2, 0.2)), Disk(0, 0.6)
    design = place(plant, region, method)
    A, _ = loops(plant, design.law, motions(plant, 1000, 60))
    x = np.random.default_rng(0).normal(size=(1000, 2))
    sizes = []
    for own in A:
        sizes.append(np.linalg.norm(x, axis=1))
        x = np.einsum("cij,cj->ci", own, x)
    spread = np.array(sizes) / 0.6 ** np.arange(60)[:, None]
    assert spread.max() < 50 * spread[0].max()
    text = design.certificate.claim().said(design.certificate.file().plant)
    assert text.endswith("; decay by 0.6^k in k samples with p moving by up to 0.2 1/s")


def test_a_decay_rate_is_a_disk_about_zero():
    plant = walk((-0.2, 0.2))
    design = place(plant, HalfPlane(0.5), BOX)
    (part,) = design.region.parts
    assert part.centre == 0
    assert part.radius == pytest.approx(np.exp(-0.5 * float(T)), rel=1e-9)


def test_a_law_is_optimised_along_motions():
    plant = walk((-0.2, 0.2))
    done = optimise(plant, Rms("x", density=2.0), [Rms("u", 0.3, density=2.0)], None, BOX)
    again = loads(done.design.certificate.file([b.claim for b in done.bounds]).dumps())
    assert all(prove(claim).proved for claim in again.claims)
    assert "p moving by up to 0.2 1/s" in again.claims[1].said(again.plant)
    still = optimise(walk(None), *_asked(), None, BOX)
    assert still.bounds[0].level <= done.bounds[0].level * (1 + 1e-6)
    A, alpha = loops(plant, done.law, motions(plant, 1000, 200))
    K = done.law.gain(alpha.reshape(-1, alpha.shape[-1])).reshape(*A.shape[:2], 1, 2)
    E, P = np.array([[0.1], [0.3]]), np.zeros((1000, 2, 2))
    for own, k in zip(A, K, strict=True):
        assert np.sqrt(P[:, 0, 0].max()) <= done.bounds[0].level
        assert np.sqrt((k @ P @ k.swapaxes(1, 2)).max()) <= 0.3
        P = own @ P @ own.swapaxes(1, 2) + E @ E.T / float(T)


def _asked():
    return Rms("x", density=2.0), [Rms("u", 0.3, density=2.0)]


def test_the_smallest_disk_along_motions_is_no_smaller():
    found = [tightest(walk(rate), 0, "quadratic").region.radius for rate in (None, "any")]
    assert found[0] <= found[1] * (1 + 1e-6)


# --- the inequality itself, and one fault at a time ----------------------------------------------


@pytest.fixture(scope="module")
def bound():
    return best_bound(walk((-0.1, 0.1), other=(-0.2, 0.1)), NO_LAW, Rms("x", density=2.0))


def test_the_matrices_of_a_proof_are_those_of_motions(bound):
    """X(p+) > Phi X(p) Phi' + T S E E' for p+ within a sample of p, by values of the evidence."""
    plant, own = walk((-0.1, 0.1), other=(-0.2, 0.1)), bound.claim.subject
    X = np.array(own.evidence.X, dtype=float)
    assert own.evidence.degree == 1
    random, E = np.random.default_rng(0), np.array([[0.1], [0.3]])
    t = float(T)
    for _ in range(500):
        p, q = random.uniform(0.4, 1.2), random.uniform(1, 2)
        after = (
            np.clip(p + t * random.choice([-0.1, 0.1]), 0.4, 1.2),
            np.clip(q + t * random.choice([-0.2, 0.1]), 1, 2),
        )
        (A, _), (_, a) = (loops(plant, NO_LAW, np.array([[own]])) for own in ((p, q), after))
        _, b = loops(plant, NO_LAW, np.array([[(p, q)]]))
        now, then = (np.tensordot(w[0, 0], X, 1) for w in (b, a))
        left = then - A[0, 0] @ now @ A[0, 0].T - t * E @ E.T
        assert np.linalg.eigvalsh(left).min() > 0


def test_a_claim_does_not_hold_of_faster_motions(bound):
    own = bound.claim.subject
    assert prove(bound.claim).proved
    for number, rate in ((0, (-1, 1)), (0, (0, 1)), (1, (-2, 0)), (1, (0, 1))):
        ranges = list(own.motion)
        ranges[number] = replace(ranges[number], rate=tuple(map(Fraction, rate)))
        assert not prove(replace(bound.claim, subject=replace(own, motion=tuple(ranges)))).proved


def test_a_longer_sample_is_a_longer_step(bound):
    own = bound.claim.subject
    assert not prove(replace(bound.claim, subject=replace(own, step=10 * own.step))).proved


def test_evidence_that_is_not_affine_is_refused(bound):
    own = bound.claim.subject
    X = own.evidence.X
    more = replace(own.evidence, degree=2, X=[X[0], X[1], X[3], X[0], X[1], X[2], X[3], X[1], X[0]])
    with pytest.raises(FormatError, match="X is not affine in p, which moves"):
        prove(replace(bound.claim, subject=replace(own, evidence=more)))


def test_evidence_on_the_simplex_is_refused(bound):
    own = bound.claim.subject
    with pytest.raises(FormatError, match="need evidence on their box"):
        prove(replace(bound.claim, subject=replace(own, on="simplex")))


def test_samples_are_of_parameters_at_rest():
    def matrices(k):
        return [[0, 1], [-k, -1]], [[0], [1]]

    plant = UncertainPlant.from_function(matrices, [Parameter("k", 1, 2, rate=(-1, 1))])
    with pytest.raises(InputError, match="k: rate: samples are for constant parameters only"):
        at_sample_time(plant, 0.01)
    still = at_sample_time(replace(plant, parameters=(Parameter("k", 1, 2),)), 0.01)
    with pytest.raises(InputError, match="rate: samples of a plant"):
        replace(still, parameters=plant.parameters)


def test_slack_keeps_no_disk_along_motions():
    with pytest.raises(InputError, match="the method slack keeps no"):
        place(walk((-1, 1)), Disk(0, 0.9), Slack(1, 0, "box"))
