"""Gains at samples of held disturbances, also of such that pass straight into what a law measures.

The truth is a sweep of frequencies over samples by SciPy's exponential.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    Compensator,
    Disk,
    Gain,
    InputError,
    NotProvedError,
    Structure,
    analyse,
    at_sample_time,
    with_reference,
    with_weight,
)
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.remainder import Remainder
from polefence.proof.work import FormatError
from polefence.requirements.specification import limit_text
from polefence.requirements.text import parse_specification
from polefence.search import optimise as search
from support.specs import SPRING

HELD = Gain(["weighted error of x", "f"], disturbances={"r": 1}, at="samples")
QUICK, SLOW = "(s + 40)/(s/20 + 1)", "(s + 6)/(2*s + 0.02)"
GAINS = {"prompt": 20.0, "late": 5.0}
LATE = {"prompt": 0, "late": 1}
PERIODS = {"50 ms": Fraction(1, 20), "100 ms": Fraction(1, 10)}


def tracking(weight):
    """A reference for x of a mass on a spring, and a weight of its error."""
    return with_weight(with_reference(loads(SPRING), "r", "x"), "error of x", weight)


def proportional(gain):
    return Compensator(D=[[gain]], measured=["error of x"])


def truth(m, k, gain, late, T, count=2000):
    """The largest norm of [W S; K S] over the frequencies of samples, of a mass on a spring."""
    own, given = np.zeros((3, 3)), np.zeros((3, 2))  # the last is z' = r - x - 20 z
    own[:2, :2], own[2] = [[0, 1], [-k / m, -2 / m]], [-1, 0, -20]
    given[1, 0], given[2, 1] = 1 / m, 1
    moved = expm(np.block([[own, given], [np.zeros((2, 5))]]) * T)
    z = np.exp(1j * np.linspace(0, np.pi, count))
    of = np.linalg.solve(z[:, None, None] * np.eye(3) - moved[:3, :3], moved[:3, 3:] + 0j)
    K = gain * z ** (-late)
    u = K * (1 - of[:, 0, 1]) / (1 + K * of[:, 0, 0])  # K (r - x), x of u and of r
    x, own = (of[:, i, 0] * u + of[:, i, 1] for i in (0, 2))
    # (s + 40)/(s/20 + 1) = 20 + 400/(s + 20)
    return np.hypot(abs(20 * (1 - x) + 400 * own), abs(u)).max()


@pytest.fixture(scope="module", params=[(a, b) for a in LATE for b in PERIODS], ids="-".join)
def proved(request):
    late, T = LATE[request.param[0]], PERIODS[request.param[1]]
    gain = GAINS[request.param[0]]
    sampled = at_sample_time(tracking(QUICK), T, late)
    found = analyse(sampled, proportional(gain), Disk(0, 1), limits=[HELD])
    corners = [(m, k) for m in (0.8, 1.0, 1.2) for k in (80.0, 100.0, 120.0)]
    return found, max(truth(m, k, gain, late, float(T)) for m, k in corners)


def test_a_bound_is_no_less_than_the_truth_and_near_it(proved):
    found, worst = proved
    assert found.proved
    assert worst * (1 - 1e-4) <= found.bounds[0].bound.level <= worst * 1.02
    assert found.bounds[0].worst == pytest.approx(worst, rel=0.01)


def test_less_than_the_truth_is_never_proved(proved):
    found, worst = proved
    limited = Gain(HELD.signal, 0.995 * worst, disturbances={"r": 1}, at="samples")
    assert analyse(found.plant, found.law, Disk(0, 1), limits=[limited]).bounds[0].bound is None


@pytest.mark.parametrize(("T", "dual"), [(Fraction(1, 50), False), (Fraction(1, 20), True)])
def test_plants_within_a_large_remainder_stay_below_the_bound(T, dual):
    """Samples that are off by as much as the interpolation may be, in the second degree."""
    sampled = at_sample_time(tracking(QUICK), T, degree=2)
    found = analyse(sampled, proportional(GAINS["prompt"]), Disk(0, 1), limits=[HELD])
    claim = found.bounds[0].bound.claim
    assert prove(claim).proved
    assert claim.subject.evidence.per_cell[0].dual is dual
    plant, random, most = found.plant, np.random.default_rng(1), 0.0
    n, m = plant.shape
    z = np.exp(1j * np.concatenate([[0], np.geomspace(1e-3, np.pi, 400)]))
    K = np.asarray(found.law.gain(np.eye(4)))
    (C, D, F) = (
        np.stack([y.arrays(plant)[i] for y in HELD.outputs(plant)], axis=1) for i in range(3)
    )
    passing = found.law.passing(np.eye(4))
    R = np.array(plant.remainder.entries, dtype=float)
    assert R.max() > 1e-6  # else nothing is tested
    for j in (0, 3):
        for _ in range(20):
            off = R * random.choice([-1.0, 1.0], R.shape)
            v = plant.vertices[j]
            A, B, E = v.A + off[:, :n], v.B + off[:, n : n + m], v.E + off[:, n + m :]
            loop, driven = A + B @ K[j], E + B @ passing[j]
            shown, through = C[j] + D[j] @ K[j], F[j] + D[j] @ passing[j]
            G = [shown @ np.linalg.solve(at * np.eye(n) - loop, driven) + through for at in z]
            most = max(most, *(np.linalg.norm(g[:, -1]) for g in G))
    assert most <= float(claim.level)


SCALAR = """
sample_time = 1
disturbances = ["w"]
[matrices]
A = [[0.2]]
B = [[1]]
E = [[0]]
[outputs]
y = {C = [1], F = [1]}
"""


def test_what_is_off_in_the_input_adds_up_of_the_state_and_the_disturbance():
    """x+ = 0.2 x + (1 + d) u, u = 0.3 (x + w): both are moved by d, in phase at rest.

    Counted as squares that are not in both, less than the truth would be proved.
    """
    off = Fraction(1, 20)
    plant = replace(loads(SCALAR), remainder=Remainder(((Fraction(0), off, Fraction(0)),)))
    law, worst = Compensator(D=[[0.3]], measured=["y"]), 0.3 * 1.05 / (1 - 0.2 - 0.3 * 1.05)
    limited = Gain("x1", 1.2 * worst, at="samples")
    (found,) = analyse(plant, law, Disk(0, 1), limits=[limited]).bounds
    assert found.proved
    assert found.bound.level > worst
    claim, evidence = found.bound.claim, found.bound.claim.subject.evidence
    spread, ((first,),) = evidence.spread, evidence.X[0]

    def proved(level, of_Q, of_rows):
        rows, Q = (spread.rows[0] * of_rows,), first * of_Q
        columns = tuple(x / of_rows for x in spread.columns)
        kappa = rows[0] ** 2 * Q * Fraction(1001, 1000)
        tried = replace(spread, rows=rows, columns=columns, kappa=kappa)
        subject = replace(claim.subject, evidence=replace(evidence, X=[[[Q]]], spread=tried))
        try:
            return prove(replace(claim, level=Fraction(level * worst), subject=subject)).proved
        except FormatError:
            return False

    shares = [Fraction(float(x)) for x in np.geomspace(0.25, 4, 17)]
    every = [(Q, rows) for Q in shares for rows in shares]
    assert not any(proved(0.99, *pair) for pair in every)
    assert any(proved(1.02, *pair) for pair in every)


def test_a_command_between_samples_is_seen_as_one_at_rest():
    """Why the gain at all times of a weight that nearly integrates is large, whatever the law.

    Commands of multiples of 1/T look constant to samples. Of r = c_0 + sum c_k cos(2 pi k t/T),
    filtered, that is zero at samples a law knows nothing, and the error at rest is c_0 W(0).
    """
    T, b, rest = 0.05, 20.0, 3 / 0.01
    plant = with_weight(tracking(SLOW), "r", f"1/(s/{b:g} + 1)")
    sampled = at_sample_time(plant, PERIODS["50 ms"])
    asked = {"signal": "weighted error of x", "disturbances": {"r": 1}}
    law = Compensator([[1]], [[T]], [[60]], [[10]], ["error of x"], sample_time=T)
    found = analyse(sampled, law, Disk(0, 1), limits=[Gain(**asked, at="samples", at_most=60)])
    assert found.proved
    squares = b * T / 2 / np.tanh(b * T / 2) - 1  # the sum of |1/(j w/b + 1)|^2, but for w = 0
    least = rest * np.sqrt(squares / (1 + squares))
    at_all_times = Gain(**asked).values(found.plant, found.law, np.full((1, 4), 0.25))[0]
    assert at_all_times > least * (1 - 1e-3)
    assert found.bounds[0].worst < least / 3


def test_it_reads_back_and_is_another_requirement():
    one = parse_specification("gain of [a, b] from [r] <= 2 with at samples")
    assert one.at == "samples"
    assert parse_specification(limit_text(one)) == one
    assert one.title != Gain(["a", "b"], disturbances={"r": 1}).title
    with pytest.raises(InputError, match='at = \'never\' must be "samples" or "all times"'):
        Gain("x", at="never")
    with pytest.raises(InputError, match="at = 3 must be"):
        Gain("x", at=3)


def test_what_passes_straight_through_is_taken_at_samples_alone():
    sampled = at_sample_time(tracking(QUICK), PERIODS["50 ms"])
    asked = Gain("weighted error of x", disturbances={"r": 1})
    with pytest.raises(InputError, match='or ask for it at = "samples"'):
        analyse(sampled, proportional(GAINS["prompt"]), Disk(0, 1), limits=[asked])


@pytest.mark.parametrize("at", ["all times", "samples"])
def test_where_no_law_is_found_at_all_times_samples_are_named(at, monkeypatch):
    monkeypatch.setattr(search, "orders_below", lambda structure: [structure.order])
    monkeypatch.setattr(search, "_best_tuned", lambda *_: None)
    monkeypatch.setattr(search, "_attainable", lambda *_: ())
    monkeypatch.setattr(search, "_refute", lambda _: None)
    sampled = at_sample_time(with_weight(tracking(SLOW), "r", "1/(s/20 + 1)"), PERIODS["50 ms"])
    asked = Gain("weighted error of x", at_most=1, disturbances={"r": 1}, at=at)
    structure = Structure(measured=["error of x"], schedule=[])
    with pytest.raises(NotProvedError) as caught:
        search.optimise(sampled, None, [asked], structure=structure)
    named = 'where they are held, ask for it at = "samples"' in str(caught.value)
    assert named is (at == "all times")
