"""Inputs that are cut off: against exact limits, trajectories, published regions; faults."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    Disk,
    FixedGain,
    HalfPlane,
    InitialPeak,
    Rms,
    Saturation,
    Scheduled,
    Structure,
    UncertainPlant,
    at_sample_time,
    optimise,
    place,
)
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound, kept_bound
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from polefence.proof.work import FormatError


def pendulum(rate=None):
    """An inverted pendulum of unknown mass and stiffness, pushed."""

    def matrices(m, g):
        return [[0, 1], [g, 0]], [[0], [1 / m]], [[0], [1 / m]]

    parameters = [Parameter("m", 1, 2, "kg", "1/m", rate=rate), Parameter("g", 4, 6)]
    return UncertainPlant.from_function(
        matrices, parameters, states=("x", "v"), inputs=("u",), disturbances=("w",), name="pendulum"
    )


PUSH = FixedGain(np.array([[-30.0, -10.0]]))
START = Saturation("u", points=[(1.0, 0.0)])


def alone(A, B, **names):
    return UncertainPlant.from_vertices([A], [B], **names)


def runs(A, B, K, U, x, T=30.0, dt=0.002, w=None, E=None):
    """States (count, n) of the loop cut off at +-U, after a time; the largest on the way too."""
    most = np.abs(x)
    for k in range(int(T / dt)):
        u = np.clip(x @ K.T, -U, U)
        push = 0.0 if w is None else w[k][:, None] * E

        def slope(x, u=u, push=push):
            return x @ A.T + u @ B.T + push

        x = x + dt * slope(x + dt / 2 * slope(x))
        most = np.maximum(most, np.abs(x))
    return x, most


# --- exact limits --------------------------------------------------------------------------------


@pytest.mark.parametrize(("a", "b", "start"), [(1.0, 1.0, 1.0), (2.0, 4.0, 3.0)])
def test_the_least_limit_of_one_state_is_the_one_that_holds_it(a, b, start):
    plant = alone([[a]], [[b]], inputs=("u",))
    law, asked = FixedGain(np.array([[-(3 * a) / b]])), Saturation("u", points=[(start,)])
    bound = best_bound(plant, law, asked)
    exact = a * start / b
    assert exact < bound.level < exact * (1 + 1e-4)
    below = runs(plant.A[0], plant.B[0], law.K, 0.99 * exact, np.array([[start]]), T=8 / a)[0]
    above = runs(plant.A[0], plant.B[0], law.K, 1.01 * bound.level, np.array([[start]]), T=30 / a)[
        0
    ]
    assert abs(above) < 1e-3 * start < start < abs(below)


def test_a_pendulum_is_held_by_the_force_that_holds_it_still():
    # at x = 1 the heaviest and stiffest falls unless m g x = 12 N are there
    bound = best_bound(pendulum(), PUSH, START)
    assert 12 < bound.level < 12.01
    low = START.values(pendulum(), PUSH, np.eye(4)).max()
    assert 11.5 < low < 12


def test_what_nothing_cuts_off_asks_for_no_less():
    plant = pendulum()
    linear = best_bound(plant, PUSH, InitialPeak("u", points=[(1.0, 0.0)]))
    assert best_bound(plant, PUSH, START).level < 0.5 * linear.level


def test_a_stable_loop_needs_nothing():
    plant = alone([[0, 1], [-1, -1]], [[0], [1]], inputs=("u",))
    law = FixedGain(np.array([[-1.0, -1.0]]))
    bound = best_bound(plant, law, Saturation("u", points=[(1.0, 0.0)]))
    assert bound.level < 1e-2
    linear = best_bound(plant, law, InitialPeak("u", points=[(1.0, 0.0)]))
    assert linear.level > 0.9


# --- published -----------------------------------------------------------------------------------


def test_no_smaller_than_a_region_that_is_published():
    """YALMIP's example of determinant maximisation (Lofberg): an ellipsoid without saturation."""
    A, B, L = [[1, 0], [0.4, 1]], [[0.4], [0.08]], np.array([[1.9034, 1.1501]])
    plant = alone(A, B, inputs=("u",), sample_time=1)
    Y = [[2.9957, -4.1514], [-4.1514, 6.2918]]
    linear = best_bound(plant, FixedGain(-L), InitialPeak("u", ellipsoid=Y))
    assert linear.level == pytest.approx(1.0, abs=2e-4)  # the published one, of |u| <= 1
    cut = best_bound(plant, FixedGain(-L), Saturation("u", ellipsoid=Y))
    # so many times as large, the loop being cut off outside of the published one
    assert 1 / cut.level > 1.5
    size = 0.999 / cut.level
    angle = np.linspace(0, 2 * np.pi, 1000)
    x = size * (np.linalg.cholesky(Y) @ [np.cos(angle), np.sin(angle)]).T
    for _ in range(400):
        x = x @ np.array(A).T + np.clip(-x @ L.T, -1, 1) @ np.array(B).T
    assert np.abs(x).max() < 1e-6


def test_two_inputs_reach_nearly_as_far_as_any_law_does():
    """The first example of SATAW-Tool (Queinnec, Tarbouriech and others): |u1| <= 5, |u2| <= 2.

    Beyond (+-1, +-1) times 250 the first input cannot turn x1 back, whatever the law.
    """
    limits = np.array([5.0, 2.0])
    A, B = [[0.1, -0.1], [0.1, -3]], np.array([[5.0, 0], [0, 1]]) @ np.diag(limits)
    K = np.diag(1 / limits) @ [[-0.7283, -0.0338], [-0.0135, -1.3583]]
    plant = alone(A, B.tolist(), inputs=("u1", "u2"))
    corners = [(1.0, 1.0), (1.0, -1.0)]
    bound = best_bound(plant, FixedGain(K), Saturation(["u1", "u2"], points=corners))
    size = 1 / bound.level
    assert 244 < size < 250
    x = size * np.array([np.cos(t) * np.array(corners[0]) + np.sin(t) * np.array(corners[1])
                         for t in np.linspace(0, np.pi / 2, 50)]) / np.sqrt(2)  # fmt: skip
    end, _ = runs(np.array(A), B, K, 1.0, x, T=150.0, dt=0.02)
    assert np.abs(end).max() < 1e-2


# --- trajectories --------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["one", "scheduled"])
def test_a_thousand_states_of_the_ellipsoid_come_to_rest(law):
    plant = pendulum()
    own = (
        PUSH
        if law == "one"
        else place(plant, HalfPlane(1) & Disk(-6, 6), Scheduled(1, 1, "box")).law
    )
    bound = best_bound(plant, own, Saturation("u", ellipsoid=[[1.0, 0.0], [0.0, 1.0]]))
    angle = np.linspace(0, 2 * np.pi, 250, endpoint=False)
    x = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for k, alpha in enumerate(np.eye(4)):
        A, B = (M[0] for M in plant.at(alpha[None]))
        end, _ = runs(A, B, np.atleast_2d(own.gain(alpha)), bound.level, x, T=40.0, dt=0.01)
        assert np.abs(end).max() < 1e-2, k
    A, B = (M[0] for M in plant.at(np.eye(4)[3][None]))
    lost, _ = runs(
        A, B, np.atleast_2d(own.gain(np.eye(4)[3])), 0.5 * bound.level, x, T=40.0, dt=0.01
    )
    assert np.abs(lost).max() > 10


def test_disturbances_of_bounded_energy_are_borne():
    plant, norm = pendulum(), 2.0
    bound = best_bound(plant, PUSH, Saturation("u", norm=norm))
    claim = bound.claim
    assert claim.norms == (2,)
    random, dt, T, count = np.random.default_rng(0), 0.005, 8.0, 1000
    t = np.arange(int(T / dt)) * dt
    for alpha in np.eye(4):
        A, B = (M[0] for M in plant.at(alpha[None]))
        E = np.tensordot(alpha, np.stack([v.E for v in plant.vertices]), 1)[:, 0]
        # single pushes of all lengths, to one side mostly
        length = random.uniform(0.05, 3.0, count)
        w = np.where(t[:, None] < length, 1.0 + random.normal(size=(len(t), count)) * 0.1, 0.0)
        w *= norm / np.sqrt(dt * (w**2).sum(axis=0))
        x, _ = runs(A, B, PUSH.K, bound.level, np.zeros((count, 2)), T, dt, w, E)
        rest, _ = runs(A, B, PUSH.K, bound.level, x, T=20.0, dt=0.01)
        assert np.abs(rest).max() < 1e-2
        lost, _ = runs(A, B, PUSH.K, 0.2 * bound.level, np.zeros((count, 2)), T, dt, w, E)
    assert np.abs(lost).max() > 10


def test_along_motions_of_the_mass():
    asked = Saturation("u", ellipsoid=[[1.0, 0.0], [0.0, 1.0]])
    levels = [best_bound(pendulum(rate), PUSH, asked).level for rate in (None, (-1, 1), "any")]
    assert levels[0] <= levels[1] * (1 + 1e-6) <= levels[2] * (1 + 1e-5)


def test_a_law_that_may_be_cut_off_is_better_than_one_that_may_not(lmi_alone):
    plant, region = pendulum(), Disk(-6, 6)
    least = Rms("x", density=2.0)
    cut, linear = (
        optimise(plant, least, [kind("u", 20.0, points=[(1.0, 0.0)])], region, "quadratic")
        for kind in (Saturation, InitialPeak)
    )
    assert cut.bounds[0].level < 0.6 * linear.bounds[0].level
    again = loads(cut.design.certificate.file([b.claim for b in cut.bounds]).dumps())
    assert all(prove(claim).proved for claim in again.claims)
    text = again.claims[1].said(again.plant)
    assert "'u' = u1 saturated at +-20: the loop comes to rest from x(0) = (1, 0)" in text


# --- at a sample time, and of laws with states of their own ---------------------------------------


def late_runs(T, law, U, x, p, steps):
    """States of the loop at samples, u one sample late, by SciPy's exponential at parameters p."""
    m, g = p
    both = expm(np.array([[0, 1, 0], [g, 0, 1 / m], [0, 0, 0]]) * T)
    F, G, K = both[:2, :2], both[:2, 2], np.atleast_2d(law.gain(np.full(4, 0.25)))[0]
    late = np.zeros(len(x))
    for _ in range(steps):
        u = np.clip(x @ K[:2] + late * K[2], -U, U)
        x, late = x @ F.T + late[:, None] * G, u
    return x


def test_a_short_sample_time_asks_for_what_holds_it_still():
    bound = best_bound(at_sample_time(pendulum(), 1e-3), PUSH, START)
    assert 12 < bound.level < 12.001


def test_a_sample_late_a_thousand_states_come_to_rest():
    T, law = 0.02, FixedGain(np.array([[-20.0, -7.0, -0.3]]))
    plant, round_ = at_sample_time(pendulum(), T, delay=1), np.diag([1.0, 1.0, 0.0]).tolist()
    bound = best_bound(plant, law, Saturation("u", ellipsoid=round_))
    angle = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    x = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for p in ((1, 4), (2, 4), (1, 6), (2, 6), (1.3, 5.1)):
        assert np.abs(late_runs(T, law, bound.level, x, p, 1500)).max() < 1e-2, p
    assert np.abs(late_runs(T, law, 0.5 * bound.level, x, (2, 6), 1500)).max() > 10


def test_at_a_sample_time_disturbances_are_borne():
    T, norm = 0.05, 2.0
    bound = best_bound(at_sample_time(pendulum(), T), PUSH, Saturation("u", norm=norm))
    assert bound.claim.norms == (2,)
    random, count = np.random.default_rng(0), 1000
    length = random.uniform(0.05, 3.0, count)
    t = np.arange(200) * T
    w = np.where(t[:, None] < length, 1.0 + random.normal(size=(200, count)) * 0.1, 0.0)
    w *= norm / np.sqrt(T * (w**2).sum(axis=0))
    for m, g in ((1, 4), (2, 4), (1, 6), (2, 6)):
        both = expm(np.array([[0, 1, 0], [g, 0, 1 / m], [0, 0, 0]]) * T)
        F, G = both[:2, :2], both[:2, 2]
        x = np.zeros((count, 2))
        for push in [*w, *np.zeros((400, count))]:
            u = np.clip(x @ PUSH.K[0], -bound.level, bound.level)
            x = x @ F.T + (u + push)[:, None] * G
        assert np.abs(x).max() < 1e-2


def test_an_impulse_is_simulated_from_the_state_that_it_leaves():
    """Of a mass of 1 kg twice the velocity of one of 2 kg."""
    plant, corners = pendulum(), np.eye(4)
    seen = Saturation("u", impulse=1.0).values(plant, PUSH, corners)
    fast, slow = (
        Saturation("u", points=[(0.0, v)]).values(plant, PUSH, corners) for v in (1.0, 0.5)
    )
    masses = np.array([vertex.E[1, 0] for vertex in plant.vertices])
    assert set(masses) == {1.0, 0.5}
    np.testing.assert_allclose(seen, np.where(masses == 1.0, fast, slow), rtol=1e-12)
    assert 0 < seen.min() < seen.max() <= best_bound(plant, PUSH, START).level


@pytest.mark.parametrize("kind", [Saturation, InitialPeak])
def test_an_impulse_at_a_sample_time_is_refused_before_any_work(kind):
    plant, asked = at_sample_time(pendulum(), 0.05), kind("u", impulse=0.5, at_most=20)
    told = "of u: impulse = 0.5: at a sample time .* points: E of the continuous plant times 0.5"
    for limits, least in (([asked], Rms("x", density=1)), ([], replace(asked, at_most=None))):
        with pytest.raises(InputError, match=told):
            optimise(plant, least, limits)
    with pytest.raises(InputError, match=told):
        best_bound(plant, PUSH, asked)
    state = kind("u", points=[(0.0, 0.5)])
    assert best_bound(plant, PUSH, state).level < 20


@pytest.fixture(scope="module")
def sampled_claim():
    asked = Saturation("u", points=[(1.0, 0.0)])
    return best_bound(at_sample_time(pendulum(), 0.05), PUSH, asked).claim


def test_the_remainder_is_in_every_part(sampled_claim):
    assert prove(sampled_claim).proved
    names = {own.name.split(" at ")[0] for own in sampled_claim.inequalities()}
    assert {f"of the remainder, {end}" for end in ("none saturated", "u1 saturated")} <= names


def test_a_larger_remainder_is_not_proved(sampled_claim):
    subject = sampled_claim.subject
    spread = subject.evidence.spread
    less = [[x * Fraction(9, 10) for x in row] for row in spread.omega]
    evidence = replace(subject.evidence, spread=replace(spread, omega=less))
    verdict = prove(replace(sampled_claim, subject=replace(subject, evidence=evidence)))
    assert not verdict.proved
    assert "of the remainder" in verdict.reason
    wider = tuple(tuple(2 * x for x in row) for row in subject.remainder.entries)
    near = replace(subject.remainder, entries=wider)
    with pytest.raises(FormatError, match="do not cover"):
        prove(replace(sampled_claim, subject=replace(subject, remainder=near)))


def test_what_is_held_counts_in_the_remainder(sampled_claim):
    """An Omega that is enough for K alone is not for a large H."""
    large = tuple(tuple(tuple(1000 * x for x in row) for row in Y) for Y in sampled_claim.held)
    reason = prove(replace(sampled_claim, held=large, level=Fraction(10**9))).reason
    assert "u1 saturated" in reason


def structured_pendulum():
    return Structure(measured=("x",), order=1).extended(pendulum())[0]


def test_a_law_with_a_state_of_its_own():
    """u = -80 x + 50 z, z' = 10 (x - z): a filtered derivative of what is measured."""
    plant, law = structured_pendulum(), FixedGain(np.array([[-80.0, 0, 50.0], [10.0, 0, -10.0]]))
    bound = best_bound(plant, law, START.extended(2, 1))
    assert bound.level > 12
    for alpha in np.eye(4):
        A, B = (M[0] for M in plant.at(alpha[None]))
        x = np.array([[1.0, 0, 0]])
        for _ in range(20000):
            u = x @ law.K.T
            u[:, 0] = np.clip(u[:, 0], -bound.level, bound.level)
            x = x + 0.002 * (x @ A.T + u @ B.T)
        assert np.abs(x).max() < 1e-3


def test_a_structure_is_searched_that_may_be_cut_off():
    def matrices(g):
        return [[0, 1], [g, 0]], [[0], [1]], [[0], [1]]

    plant = UncertainPlant.from_function(
        matrices, [Parameter("g", 4, 6)], states=("x", "v"), inputs=("u",), disturbances=("w",)
    )
    kept = Structure(measured=("x", "v"), schedule=())
    found = {
        kind: optimise(
            plant, Rms("x", density=2.0), [kind("u", 20.0, points=[(1.0, 0.0)])], Disk(-6, 6),
            structure=kept,
        ).bounds[0].level
        for kind in (Saturation, InitialPeak)
    }  # fmt: skip
    assert found[Saturation] < 0.6 * found[InitialPeak]


# --- one fault at a time -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def claim():
    bound = best_bound(pendulum(), PUSH, Saturation("u", ellipsoid=[[1.0, 0.0], [0.0, 1.0]]))
    assert prove(bound.claim).proved
    return bound.claim


def test_less_of_anything_is_not_proved(claim):
    F = Fraction
    assert not prove(replace(claim, level=claim.level * F(99, 100))).proved
    wider = tuple(tuple(F(102, 100) * x for x in row) for row in claim.ellipsoid)
    assert not prove(replace(claim, ellipsoid=wider)).proved
    nothing = tuple(tuple(tuple(0 * x for x in row) for row in M) for M in claim.held)
    assert not prove(replace(claim, held=nothing)).proved
    larger = tuple(tuple(tuple(F(102, 100) * x for x in row) for row in M) for M in claim.held)
    assert not prove(replace(claim, held=larger)).proved
    weak = replace(claim.subject, B=[[[x / 2 for x in row] for row in M] for M in claim.subject.B])
    assert not prove(replace(claim, subject=weak)).proved


def test_the_linear_loop_counts_too(claim):
    """Where nothing is cut off the gain acts: one that is unstable there is not proved."""
    K = [[Fraction(30), Fraction(10)]]
    law = replace(claim.subject.law, K=[K])
    verdict = prove(replace(claim, subject=replace(claim.subject, law=law)))
    assert not verdict.proved
    assert "none saturated" in verdict.reason


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"level": Fraction(0)}, "level must be positive"),
        ({"held": ()}, "matrices are missing"),
        ({"held_degree": 99}, "degrees must be 0 to"),
        ({"norms": (Fraction(1),)}, "begin at rest"),
        ({"norms": (Fraction(-1),), "ellipsoid": ()}, "norms must hold 1 numbers"),
        ({"ellipsoid": ()}, "there is no initial state"),
    ],
)
def test_claims_that_are_none(claim, changes, says):
    with pytest.raises(FormatError, match=says):
        prove(replace(claim, **changes))


def test_a_signal_that_no_input_or_a_parameter_moves_is_none(claim):
    (own,) = claim.outputs
    one, zero = Fraction(1), Fraction(0)
    for other in (
        replace(own, C=[[[one, zero]]] * 4, D=[[[zero]]] * 4),
        replace(own, D=[[[one]]] * 3 + [[[2 * one]]]),
        replace(own, C=[[[zero, zero]]] * 3 + [[[zero, one]]]),
        replace(own, F=([[one]],) * 4),
    ):
        with pytest.raises(FormatError, match="saturation applies to signals that one input"):
            prove(replace(claim, outputs=(other,)))
    # half as large a signal, and half the limit
    half = replace(own, D=[[[one / 2]]] * 4)
    assert prove(replace(claim, outputs=(half,), level=claim.level / 2)).proved
    assert not prove(replace(claim, outputs=(half,), level=claim.level * Fraction(49, 100))).proved
    # with part of a state in it another limit is none
    assert not prove(replace(claim, outputs=(replace(own, C=[[[9 * one, zero]]] * 4),))).proved


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (lambda: Saturation("u", 0.0, points=[(1.0, 0.0)]), "must be a positive number"),
        (lambda: Saturation("u", -1.0, points=[(1.0, 0.0)]), "must be a positive number"),
        (lambda: Saturation("u"), "give points or an impulse"),
        (lambda: Saturation("u", points=[(1.0, 0.0)], norm=1.0), "give initial states, or a norm"),
        (lambda: Saturation("u", norm=-1.0), "norm = -1.0 must be"),
        (
            lambda: Saturation("x", points=[(1.0, 0)]).require_fit(pendulum()),
            "'x': none of u moves",
        ),
    ],
)
def test_questions_that_are_none(asked, says):
    with pytest.raises(InputError, match=says):
        asked()


def test_a_limit_below_what_holds_it_is_not_kept():
    assert kept_bound(pendulum(), PUSH, replace(START, at_most=12.1)) is not None
    assert kept_bound(pendulum(), PUSH, replace(START, at_most=11.5)) is None
