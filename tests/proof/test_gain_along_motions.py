"""Gains along motions by a continuous Q on a grid: proved; refused with a step between cells."""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import islice

import numpy as np
import pytest

from polefence.certify.bounds import _Question
from polefence.law.laws import given_law
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from polefence.requirements.gain import Gain

SPEC = """
disturbances = ["w"]
[parameter.p]
range = [0.5, 2]
rate = [-1, 1]
[matrices]
A = [[0, 1], ["-4 - sin(p)", "-1 - p**3/4"]]
B = [[0], [1]]
E = [[0], ["sqrt(p)"]]
"""


@pytest.fixture(scope="module")
def bound():
    plant = loads(SPEC)
    question = _Question.of(plant, given_law(plant, [[0.0, 0.0]]), Gain(("x1",)))
    grids = list(islice(question.on_grids, 3))
    assert question.worst < grids[2].level < grids[1].level < grids[0].level
    return question.on_grid(grids[2], grids[2].level * (1 + 1e-4))


def test_a_continuous_Q_is_a_proof(bound):
    assert len(bound.claim.subject.evidence.cells) == 4
    assert prove(bound.claim).proved
    assert not prove(replace(bound.claim, level=bound.claim.level * Fraction(99, 100))).proved


def test_a_step_between_cells_is_none(bound):
    subject = bound.claim.subject
    first, *rest = subject.evidence.cells
    Q = [[[x * Fraction(1001, 1000) for x in row] for row in M] for M in first.evidence.X]
    cells = (replace(first, evidence=replace(first.evidence, X=Q)), *rest)
    changed = replace(subject, evidence=replace(subject.evidence, cells=cells))
    with pytest.raises(FormatError, match="not continuous"):
        prove(replace(bound.claim, subject=changed))


def random_plant(number, rate, states=3):
    """Return a plant that moves between two random loops, and is bent by sines."""
    rng = np.random.default_rng(number)
    loops = []
    for _ in range(2):
        A = rng.standard_normal((states, states))
        loops.append(A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(states))
    A = [
        [
            f"{a:.3f} + {b - a:.3f}*p + 0.2*sin({i + j + 1}*p)"
            for j, (a, b) in enumerate(zip(*rows, strict=True))
        ]
        for i, rows in enumerate(zip(*loops, strict=True))
    ]
    E = [[f"{x:.3f}"] for x in rng.standard_normal(states)]
    C = [round(x, 3) for x in rng.standard_normal(states)]
    head = f'disturbances = ["w"]\n[parameter.p]\nrange = [0, 0.5]\nrate = [-{rate}, {rate}]\n'
    return loads(
        f"{head}[matrices]\nA = {json.dumps(A)}\nB = {json.dumps([[1]] * states)}\n"
        f"E = {json.dumps(E)}\n[outputs]\ny = {{C = {json.dumps(C)}}}\n"
    )


@pytest.mark.parametrize("number", range(4))
def test_random_plants_gain_more_the_faster_they_move(number):
    """Nearly still the least level is the worst sample's; simulated motions gain no more."""
    levels = []
    for rate in ("0.001", "1"):
        plant = random_plant(number, rate)
        question = _Question.of(plant, given_law(plant, np.zeros((1, 3))), Gain(("y",)))
        levels.append(min(grid.level for grid in islice(question.on_grids, 3)))
    assert question.worst < levels[0] < 1.02 * question.worst
    assert levels[0] < levels[1] * (1 + 1e-5)
    assert 0.5 * question.worst < simulated(question) < levels[1]


def simulated(question):
    """Return the largest gain seen of slow pulses, while p goes to and fro, within its rate."""
    largest, step = 0.0, 0.02
    t = np.arange(0, 60, step)
    up = np.clip(np.abs(t % 40 - 20) - 9.5, 0, 1)  # 20 s near each end
    A, C, E, _ = question.moved.closed(np.stack([1 - up, up], axis=-1))
    implicit = np.linalg.inv(np.eye(3) - step / 2 * A)
    forward = implicit @ (np.eye(3) + step / 2 * A)
    for omega in np.linspace(0, 6, 25):
        w = np.cos(omega * t) * np.exp(-(((t - 30) / 12) ** 2))
        x, energy = np.zeros(3), 0.0
        for F, G, y, wk in zip(forward, step * implicit @ E, C, w, strict=True):
            energy += step * float((y @ x)[0]) ** 2
            x = F @ x + G[:, 0] * wk
        largest = max(largest, float(np.sqrt(energy / (step * np.sum(w**2)))))
    return largest


COMMUTATOR = """
disturbances = ["w"]
[parameter.d]
range = [-1, 1]
rate = RATE
[matrices]
A = [[-1, 0], [0, -1]]
B = [[0], [1]]
E = [[1], ["d"]]
[outputs]
e = {C = ["d", -1]}
"""


@pytest.mark.parametrize(("rate", "most"), [('"any"', 1.01), ("[-0.1, 0.1]", 0.25)])
def test_what_is_seen_of_motion_alone_has_a_bound(rate, most):
    """d G - G d, G = 1 / (s + 1), is zero for each constant d."""
    plant = loads(COMMUTATOR.replace("RATE", rate))
    question = _Question.of(plant, given_law(plant, np.zeros((1, 2))), Gain(("e",)))
    assert question.worst < 1e-9
    levels = [grid.level for grid in islice(question.on_grids, 3)]
    assert levels[-1] < most
