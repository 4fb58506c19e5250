"""Of laws nearly as good as the best one is returned whose gain is smaller: what that may cost."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

import polefence as pf
from polefence.plant.outputs import Output
from polefence.requirements.gain import Gain
from polefence.search.effort import Closer, gain_of, least
from polefence.search.tune.worth import up_to
from support.commands import ran

A, B, E = np.array([[0.0, 1.0], [-1.0, -0.1]]), np.array([[0.0], [1.0]]), np.array([[0.0], [1.0]])
EFFORT = 1e-3  # of the input beside the position
FREQUENCIES = np.geomspace(1e-2, 1e4, 400)


def test_the_least_gain_is_taken_among_those_as_good():
    each = [Closer(level, gain, gain) for level, gain in ((1.0, 9.0), (1.0005, 3.0), (1.1, 1.0))]
    k, best = least(each, ())
    assert k == 1
    assert best == Closer(1.0, 9.0, 3.0)
    # a level that is not to be exceeded, and a best law that is known from elsewhere
    assert least(each, (), most=1.0002) == (0, None)
    assert least(each[1:], [Closer(0.9999, 20.0, 0.0)]) == (0, Closer(0.9999, 20.0, 3.0))


@pytest.mark.parametrize(
    ("gains", "chosen"),
    [
        ((1.0, 0.81), 0),  # a fall of less than a fifth is not worth its level
        ((1.0, 0.8), 1),
        ((1.0, 0.79, 0.7), 1),  # nor is one from a law that was worth it
        ((1.0, 0.9, 0.6), 2),
        ((1.0, 0.85, 0.75), 2),
        ((0.0, 0.0), 0),
    ],
)
def test_a_law_that_is_worse_has_a_gain_smaller_by_a_fifth(gains, chosen):
    each = [Closer(1 + 3e-4 * k, gain, gain) for k, gain in enumerate(gains)]
    for turn in (1, -1):  # whatever came first
        k, best = least(each[::turn], ())
        assert each[::turn][k] is each[chosen]
        assert best == (replace(each[0], smaller=gains[chosen]) if chosen else None)
    # of the same level the smaller one
    assert least([Closer(1.0, 3.0, 3.0), Closer(1.0, 2.9, 2.9)], ()) == (1, None)


@pytest.mark.parametrize(
    ("times", "worth"),  # by what the gain falls, and what that may cost
    [
        (1.3, 1e-3),
        (7.9, 1e-3),
        (8.0, 1.5e-3),
        (16.0, 2e-3),
        (64.0, 3e-3),
        (1e9, 3e-3),
        (np.inf, 3e-3),
    ],
)
def test_several_halvings_of_the_gain_are_worth_half_a_thousandth_each(times, worth):
    for level in (1.0, 40.0):
        for share, k in ((worth * 0.99, 1), (worth * 1.01, 0)):
            each = [Closer(level, 1.0, 1.0), Closer(level * (1 + share), 1 / times, 1 / times)]
            assert least(each, ())[0] == k
            # a search looks at laws up to that level, of a gain that is worth one, and no others
            assert (each[1].level < up_to(level, 1.0, 1 / times)) == bool(k)
        assert up_to(level, 1.0, 0.81) == up_to(level, 1.0, 5.0) == level


def gain_by_frequencies(K):
    loops = 1j * FREQUENCIES[:, None, None] * np.eye(2) - A - B @ K
    x = np.linalg.solve(loops, np.broadcast_to(E, (len(loops), 2, 1)))[:, :, 0]
    return np.sqrt(np.abs(x[:, 0]) ** 2 + np.abs(EFFORT * (x @ K[0])) ** 2).max()


def least_gain():
    """The least gain of all laws, by Riccati equations."""
    low, high = 1e-6, 10.0
    for _ in range(60):
        gamma = np.sqrt(low * high)
        R = np.diag([EFFORT**2, -(gamma**2)])
        try:
            P = solve_continuous_are(A, np.hstack([B, E]), np.diag([1.0, 0.0]), R)
            works = np.linalg.eigvalsh(P).min() > -1e-9
        except np.linalg.LinAlgError:
            works = False
        low, high = (low, gamma) if works else (gamma, high)
    return high


@pytest.mark.parametrize("method", ["quadratic", None], ids=str)
def test_a_gain_near_its_least_takes_no_more_effort_than_that_needs(method, tmp_path, capsys):
    signals = (Output("x", "", C=[1.0, 0.0]), Output("u", "", D=[EFFORT]))
    plant = pf.UncertainPlant.from_vertices([A], [B], [E])
    done = pf.optimise(plant, Gain(signals), method=method)
    (K,) = done.law.K
    gamma, level = least_gain(), done.bounds[0].level
    assert gamma * (1 - 1e-6) <= level <= gamma * (1 + 2e-3)
    assert gain_by_frequencies(done.law.K) <= level
    # no law of a grid is as good with two thirds of the gain
    size = gain_of(plant, done.law)
    for scale in np.geomspace(0.05, 2 / 3, 12):
        for turn in np.linspace(-0.5, 0.5, 11):
            other = scale * np.array([[K[0], K[1] * (1 + turn)]])
            if gain_of(plant, pf.FixedGain(other)) <= 2 / 3 * size:
                assert gain_by_frequencies(other) > level * (1 - 1e-4)


def test_what_the_last_thousandth_costs_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = {"A": A.tolist(), "B": B.tolist(), "E": E.tolist()}
    text = "[matrices]\n" + "".join(f"{key} = {value}\n" for key, value in rows.items())
    text += f"[outputs]\nz = {{C = [1, 0]}}\nw = {{D = [{EFFORT}]}}\n"
    (tmp_path / "p.toml").write_text(text)
    asked = ["optimise", "p.toml", "--minimise", "gain of [z, w]", "--method", "quadratic"]
    said = ran(capsys, *asked)
    assert said.count("% less would take a gain") == 1
