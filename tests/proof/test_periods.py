"""A clock that is not perfect: bounds for periods of any length, against loops and drives."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound, kept_bound
from polefence.plant.spec import loads
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError
from polefence.response.between import held_of, means
from support.specs import SPRING

T = Fraction(1, 50)
LAW = pf.FixedGain(np.array([[-30.0, -12.0, -0.2]]))
ASKED = pf.Rms("x", density=1.0)
AT_PERIODS = pf.FixedGain(np.array([[-3.75, -11.5]]))  # of a plant that many have published


@pytest.fixture(scope="module")
def spring():
    return loads(SPRING)


@pytest.fixture(scope="module")
def published():
    """x' = A x + B u of the literature on sampling at irregular times, with a disturbance."""
    A, B, E = [[0, 1], [0, "-1/10"]], [[0], ["1/10"]], [[0], [1]]
    return pf.UncertainPlant.from_vertices([A], [B], [E])


def test_a_published_loop_is_stable_for_periods_of_any_length_up_to_1_72(published):
    """Its largest constant period is 1.7294."""
    asked = pf.Rms("x1", density=1.0)
    seen = pf.at_sample_time(published, Fraction("0.861"), 0, jitter=Fraction("0.998"))
    assert seen.sampling.clock.most * seen.sample_time > Fraction("1.72")
    assert best_bound(seen, AT_PERIODS, asked) is not None
    late = pf.at_sample_time(published, Fraction("1.5"), 0, jitter=Fraction("0.153"))
    assert late.sampling.clock.most * Fraction("1.5") > Fraction("1.7294")
    assert best_bound(late, AT_PERIODS, asked) is None
    assert np.isinf(asked.values(late, AT_PERIODS, np.eye(1))[0])


@pytest.mark.parametrize(("jitter", "delay"), [("0.05", 1), ("0.2", 1), ("0.1", 0.5)])
def test_a_bound_is_above_every_order_of_periods(spring, jitter, delay):
    seen = pf.at_sample_time(spring, T, delay, jitter=Fraction(jitter))
    bound = best_bound(seen, LAW, ASKED)
    assert bound is not None
    alike = best_bound(pf.at_sample_time(spring, T, delay), LAW, ASKED)
    assert alike.level < bound.level < alike.level * (1 + Fraction(jitter))
    rng, worst = np.random.default_rng(3), 0.0
    ends = [1 - float(Fraction(jitter)), 1 + float(Fraction(jitter))]
    for k in range(len(spring.vertices)):
        for order in ([ends[1]], ends, rng.choice(ends, 12), rng.uniform(*ends, 40)):
            worst = max(worst, over(seen, k, list(order)))
    assert worst < bound.level
    if jitter == "0.2":  # what the page says of it
        assert bound.level < alike.level * 1.15
        assert worst < alike.level * 1.02
    corners = np.eye(len(seen.vertices))
    assert ASKED.values(seen, LAW, corners).max() == pytest.approx(
        max(over(seen, k, [length]) for k in range(4) for length in (*ends, 1.0)), rel=1e-6
    )


def over(seen, vertex, lengths):
    """The rms of a loop at a corner, where these periods follow one another again and again.

    All but a last part of the sample time goes by before the next input acts; the last part is as
    long as the period has it.
    """
    held, plant = held_of(seen), seen.sampling.plant
    outputs, at = ASKED.exact_outputs(seen), np.eye(len(seen.vertices))[vertex : vertex + 1]
    A, B = (M[0] for M in plant.at(at))
    N, change = np.zeros((4, 4)), np.eye(4)[[0, 1, 3, 3]]
    N[:2, :2], N[:2, 2:3] = A, B
    first = float(1 - held.early)
    every = []
    for length in lengths:
        before, rest = (first, length - first) if held.early else (length, 0.0)
        F = expm(N * rest * float(T)) @ change @ expm(N * before * float(T))
        up = np.vstack([np.eye(3), LAW.K.reshape(1, 3)])  # x, the input that acts, and the next
        closed = np.vstack([F[:2], np.eye(4)[3]]) @ up
        mean = means(seen, held, outputs, (), 1.0, at, length)
        noise = np.zeros((3, 3))
        noise[:2, :2] = length * float(T) * mean.V[0]
        rows = up[mean.chosen]
        every.append((closed, noise, rows.T @ mean.M[0] @ rows, mean.c[0]))
    P, total, time = np.zeros((3, 3)), 0.0, 0.0
    rounds = 600 // len(lengths) + 2
    for k in range(rounds):
        for length, (closed, noise, M, c) in zip(lengths, every, strict=True):
            if k == rounds - 1:
                total, time = total + length * (np.trace(M @ P) + c), time + length
            P = closed @ P @ closed.T + noise
    return (total / time) ** 0.5


def is_proved(document):
    """Whether a file of a design is proved."""
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


@pytest.mark.parametrize("delay", [1, 0.5])
def test_what_a_file_says_of_its_clock_is_proved(published, tmp_path, delay):
    seen = pf.at_sample_time(published, Fraction(1, 5), delay, jitter=Fraction(1, 10), lost=1)
    done = pf.optimise(seen, pf.Rms("x1", density=1.0), [pf.Rms("u1", density=1.0, at_most=10.0)])
    done.save(tmp_path)
    document = json.loads((tmp_path / "design.json").read_text())
    assert is_proved(document)
    again = pf.Design.load(tmp_path / "design.json")
    assert again.plant.sampling.clock == seen.sampling.clock
    file = from_plain(document)
    said = next(one for one in file.claims if one.kind == "rms").statement(file.plant)
    changed = ", changed 100 ms after a sample" if delay == 0.5 else ""
    periods = "180 to 220 ms or 360 to 440 ms"
    assert f"inputs held for {periods} in any order{changed}, and the loop stable" in said
    claim = next(one for one in document["claims"] if one["kind"] == "rms")
    evidence = claim["evidence"]
    faults = [
        (claim["held"]["clock"]["spans"][-1], "most", "7/2"),
        (claim["held"]["clock"]["spans"][0], "least", "1/1000000000"),
        (evidence["remainder"], "rows", [0 for _ in evidence["remainder"]["rows"]]),
        (evidence["remainder"], "columns", [0 for _ in evidence["remainder"]["columns"]]),
        (evidence["remainder"], "kappa", "1e-30"),
        (evidence["Q"][0][0], 0, 0),
        (claim, "level", float(claim["level"]) * 0.99),
        (claim["held"], "delay", 0),
        (claim["held"], "early", "1/4"),
        (claim["held"], "early", "1/20"),  # later than the shortest period ends
    ]
    for table, key, other in faults:
        known = 0 if key == "early" and key not in table else table[key]
        table[key] = other
        assert not is_proved(document), key
        table[key] = known
    assert is_proved(document)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"jitter": 1.0}, "jitter = 1 must be at least 0 and below 1"),
        ({"jitter": -0.1}, "jitter = -0.1 must be at least 0"),
        ({"jitter": "much"}, "jitter = 'much' must be a number"),
        ({"lost": 17}, "lost = 17 must be 0 to 16"),
        ({"lost": 0.5}, "lost = 0.5 must be 0 to 16"),
        ({"jitter": 0.2, "delay": 0.8}, "before an input acts; give less than 0.8, or 1"),
        ({"jitter": 0.25, "delay": 1.8}, "before an input acts; give less than 1.75, or 2"),
    ],
)
def test_a_clock_that_cannot_be_is_refused_in_one_line(spring, given, words):
    with pytest.raises(InputError, match=words):
        pf.at_sample_time(spring, T, **({"delay": 1} | given))


def test_an_input_acts_before_the_shortest_period_ends(spring):
    for delay in (0.79, 1.79):
        assert pf.at_sample_time(spring, T, delay, jitter=0.2).sampling.late == Fraction(str(delay))
    assert pf.at_sample_time(spring, T, 0.99, lost=1).sampling.clock is not None


def spans(plant):
    """Where periods of a plant's clock lie."""
    return [(span.least, span.most) for span in plant.sampling.clock.spans]


def test_a_lost_sample_makes_a_period_of_two(spring):
    """Not of anything between: spans join only where jitter makes them meet."""
    assert spans(pf.at_sample_time(spring, T, 1, lost=2)) == [(1, 1), (2, 2), (3, 3)]
    fifth = pf.at_sample_time(spring, T, 1, jitter=0.2, lost=2)
    assert spans(fifth) == [(Fraction(4, 5), Fraction(6, 5)), (Fraction(8, 5), Fraction(18, 5))]
    third = pf.at_sample_time(spring, T, 1, jitter=Fraction(1, 3), lost=1)
    assert spans(third) == [(Fraction(2, 3), Fraction(8, 3))]


def test_a_bound_with_a_lost_sample_is_above_every_order(spring):
    seen = pf.at_sample_time(spring, T, 1, lost=1)
    alike = pf.at_sample_time(spring, T, 1)
    bound, least = (best_bound(plant, LAW, ASKED).level for plant in (seen, alike))
    rng, worst = np.random.default_rng(5), 0.0
    for k in range(len(spring.vertices)):
        for order in ([1], [2], [1, 2], [1, 1, 2], *rng.choice([1, 2], (10, 8)).tolist()):
            worst = max(worst, over(seen, k, order))
    assert least < worst < bound < 1.2 * worst


def test_a_clock_needs_parameters_and_a_disturbance(published):
    two = pf.UncertainPlant.from_vertices([[[0]], [[-1]]], [[[1]], [[1]]], [[[1]], [[1]]])
    with pytest.raises(InputError, match="is given by its vertices"):
        pf.at_sample_time(two, T, 0, lost=1)
    bare = pf.UncertainPlant.from_vertices([[[0]]], [[[1]]])
    with pytest.raises(InputError, match="names no disturbance"):
        pf.at_sample_time(bare, T, 0, jitter=0.1)


def test_more_lost_samples_than_the_loop_bears_prove_nothing(published):
    asked = pf.Rms("x1", density=1.0, at_most=100.0)
    kept = [
        kept_bound(pf.at_sample_time(published, Fraction("0.5"), 0, lost=lost), AT_PERIODS, asked)
        for lost in (0, 1, 2, 3)
    ]
    assert [bound is not None for bound in kept] == [True, True, True, False]
