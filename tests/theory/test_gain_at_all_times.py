"""Gains of sampled loops between samples: proved by a storage function, never below the truth.

The truth is from disturbances that are held for parts of a period; storage functions that files
hold are evaluated at random times, states and disturbances, in floats and without derivatives.
"""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from polefence import FixedGain, Gain, Parameter, UncertainPlant, at_sample_time
from polefence.certify.bounds import best_bound
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.ranges import Range
from polefence.proof.work import FormatError
from support.lifted import gain
from support.specs import SPRING

LAW = np.array([[-30.0, -12.0]])
LATE = {"prompt": 0, "late": 1, "half late": Fraction(1, 2)}
T = Fraction(1, 50)


def inside(count, corners=4):
    return np.random.default_rng(5).dirichlet(np.ones(corners) / 2, count)


def mixed(plant, alpha):
    A, B = (M[0] for M in plant.at(alpha[None]))
    return A, B, np.tensordot(alpha, np.stack([v.E for v in plant.vertices]), 1)


def truth(plant, K, late, points, force=False):
    """The largest gain to x, or to the force, over points of the family."""
    every = []
    for alpha in points:
        A, B, E = mixed(plant, alpha)
        outputs = np.eye(1, len(A)) * (not force), np.eye(1) * force
        every.append(gain((A, B, E), outputs, K, float(T), float(late)))
    return max(every)


@pytest.fixture(scope="module", params=LATE, ids=str)
def proved(request):
    late, spring = LATE[request.param], loads(SPRING)
    K = np.hstack([LAW, [[-0.2]]]) if late else LAW
    plant = at_sample_time(spring, T, late)
    return spring, K, late, best_bound(plant, FixedGain(K), Gain("x"))


def test_a_bound_is_no_less_than_the_truth_and_near_it(proved):
    spring, K, late, bound = proved
    corners = truth(spring, K, late, np.eye(4))
    assert truth(spring, K, late, inside(60)) <= bound.level
    assert corners <= bound.level <= corners * 1.005
    assert prove(bound.claim).proved
    assert "at all times, with inputs held for 20 ms" in bound.claim.time_text


@pytest.mark.parametrize("late", LATE.values(), ids=LATE)
def test_outputs_that_show_inputs_show_those_that_act(late):
    shown = '[outputs]\n"acceleration [m/s2]" = {C = ["-k/m", "-2/m"], D = ["1/m"]}\n'
    spring, asked = loads(SPRING + shown), Gain("acceleration")
    K = np.hstack([LAW, [[-0.2]]]) if late else LAW
    plant = at_sample_time(spring, T, late)
    found = asked.values(plant, FixedGain(K), np.eye(4))
    for alpha, value_ in zip(np.eye(4), found, strict=True):
        A, B, E = mixed(spring, alpha)
        own = gain((A, B, E), (A[1:], B[1:]), K, float(T), float(late), parts=32, points=2000)
        assert own <= value_ * (1 + 1e-5)
        assert value_ <= own * 1.002
    if late == Fraction(1, 2):
        bound = best_bound(plant, FixedGain(K), asked)
        assert found.max() <= bound.level <= found.max() * 1.01


def test_less_than_the_truth_is_never_proved(proved):
    spring, K, late, bound = proved
    level = Fraction(truth(spring, K, late, np.eye(4)) * 0.999)
    assert not prove(replace(bound.claim, level=level)).proved


def changed(claim, part, **values):
    """The claim with other evidence in its first part of the box."""
    evidence = claim.subject.evidence
    one = replace(evidence.per_cell[0], **values) if values else part
    if evidence.cells:
        cells = (replace(evidence.cells[0], evidence=one), *evidence.cells[1:])
        one = replace(evidence, cells=cells)
    return replace(claim, subject=replace(claim.subject, evidence=one))


def faults(part):
    """Evidence in which one thing is wrong, by name."""
    first, *rest = part.storage
    for k in (0, len(part.X) - 1):
        for factor in (Fraction(1, 2), Fraction(2)):
            X = [
                [[factor * x for x in row] for row in M] if j == k else M
                for j, M in enumerate(part.X)
            ]
            yield f"Q {k} times {factor}", replace(part, X=X)
    # of time coefficients in the middle, which no other stretch shares
    for i in range(len(first.form[0])):
        for sign in (-1, 1):
            form = [[list(row) for row in M] for M in first.form]
            form[2][i][i] += sign * max(abs(M[i][i]) for M in form)
            yield f"entry {i}, {sign}", replace(part, storage=(replace(first, form=form), *rest))


def test_one_fault_at_a_time_in_what_is_stored(proved):
    claim = proved[3].claim
    part = claim.subject.evidence.per_cell[0]
    answers = {name: prove(changed(claim, fault)).proved for name, fault in faults(part)}
    assert not any(answers.values()), answers


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: (), "belongs to a bound at all times"),
        (lambda s: (*s, s[-1]), "each stretch ends later"),
        (lambda s: (*s[:-1], replace(s[-1], end=Fraction(9, 10))), "ends with the period"),
        (lambda s: (replace(s[0], end=s[0].end / 2), *s[1:], s[-1]), "ends later|begins where"),
        (lambda s: (replace(s[0], end=s[0].end / 2), replace(s[-1], inverse=True)), "one form"),
        (lambda s: (replace(s[0], form=[M[:-1] for M in s[0].form]), *s[1:]), "form"),
    ],
)
def test_stretches_that_do_not_fit_are_refused(proved, change, message):
    claim = proved[3].claim
    part = claim.subject.evidence.per_cell[0]
    with pytest.raises(FormatError, match=message):
        prove(changed(claim, part, storage=change(part.storage)))


def test_every_part_has_the_dual_form(proved):
    claim = proved[3].claim
    part = claim.subject.evidence.per_cell[0]
    for change in ({"dual": False}, {"dual": False, "X": []}, {"dual": False, "multiple": (1,)}):
        with pytest.raises(FormatError):
            prove(changed(claim, part, **change))


def test_parameters_that_move_are_refused(proved):
    claim = proved[3].claim
    motion = tuple(
        Range(p.low, p.high, (Fraction(-1), Fraction(1))) for p in loads(SPRING).parameters
    )
    with pytest.raises(FormatError):
        prove(replace(claim, subject=replace(claim.subject, motion=motion)))


def test_a_stretch_ends_where_late_inputs_act(proved):
    _, _, late, bound = proved
    part = bound.claim.subject.evidence.per_cell[0]
    own = [s for s in part.storage if s.end == late < 1]
    assert bool(own) == (late == Fraction(1, 2))
    if own:
        moved = tuple(replace(s, end=Fraction(3, 5)) if s in own else s for s in part.storage)
        with pytest.raises(FormatError, match="ends where inputs change"):
            prove(changed(bound.claim, part, storage=moved))


def test_a_claim_of_samples_of_the_same_plant_is_needed(proved):
    assert "no claim says" in proved[3].claim.fault_in(None, [])


# --- a storage function is one -------------------------------------------------------------------


def stored(stretch, weights, count, time):
    """[P, c; c', R], or R, by Bernstein polynomials."""
    from polefence.plant.polynomial import Domain

    forms = np.array([[[float(x) for x in row] for row in M] for M in stretch.form])
    degree, along = stretch.degree, stretch.along
    basis = Domain((2,) * count).basis(weights[None], degree)[0]
    in_time = Domain((2,)).basis(np.array([[1 - time, time]]), along)[0]
    return np.tensordot(np.kron(basis, in_time), forms, 1)


def value(form, inverse, first, y):
    if not inverse:
        return y @ form @ y
    P, c, R = form[:first, :first], form[:first, first:], form[first:, first:]
    off = y[:first] - c @ y[first:]
    return off @ np.linalg.solve(P, off) + y[first:] @ R @ y[first:]


def double_integrator():
    """A plant whose best law is one of which V is nearly singular: as tests of integrators know."""
    A, B, E = ([[0, 1], [0, 0]], [[0], [1]], [[1], [0]])
    plant = UncertainPlant.from_vertices(
        [np.array(A, float)], [np.array(B, float)], [np.array(E, float)],
        states=["x0", "x1"], inputs=["u"],
    )  # fmt: skip
    return plant, FixedGain(np.array([[-25.08, -20.627]])), Gain(("x0", "x1", "u"))


@pytest.mark.parametrize("inverse", [False, True])
def test_what_is_stored_never_rises_by_more_than_the_supply(inverse):
    if inverse:
        plant, law, asked = double_integrator()
        sampled = at_sample_time(plant, Fraction(1, 20), 0)
    else:
        plant, law, asked = loads(SPRING), FixedGain(LAW), Gain("x")
        sampled = at_sample_time(plant, T, 0)
    bound = best_bound(sampled, law, asked)
    claim, random = bound.claim, np.random.default_rng(1)
    evidence = claim.subject.evidence.per_cell[0]
    assert all(stretch.inverse == inverse for stretch in evidence.storage)
    cells = claim.subject.evidence.cells
    low, high = (cells[0].low, cells[0].high) if cells else ((), ())
    K, g, period = law.K if law.K.ndim == 2 else law.K[0], bound.level, float(sampled.period)
    ends = [0.0, *(float(s.end) for s in evidence.storage)]
    for _ in range(200):
        own = random.uniform(size=len(low))
        alpha, weights = np.ones(1), np.ones(1)
        for a, b, share in zip(low, high, own, strict=True):
            place = float(a) + float(b - a) * share
            alpha = np.kron(alpha, [1 - place, place])
            weights = np.kron(weights, [1 - share, share])
        A, B, E = mixed(plant, alpha)
        n, m = B.shape
        k = random.integers(len(evidence.storage))
        stretch, time = evidence.storage[k], random.uniform(0.1, 0.9)
        y, w = random.normal(size=n + m), random.normal(size=E.shape[1])
        h = 1e-4 * period * (ends[k + 1] - ends[k])
        move = np.concatenate([A @ y[:n] + B @ y[n:] + E @ w, np.zeros(m)])
        sides = [
            value(
                stored(stretch, weights, max(len(low), 1), time + s * 1e-4),
                inverse,
                n,
                y + s * h * move,
            )
            for s in (-1, 1)
        ]
        slope = (sides[1] - sides[0]) / (2 * h)
        rows = np.eye(1, n + m) if asked.name == "x" or not inverse else np.eye(n + m)
        z = rows @ y
        assert slope <= g * w @ w - z @ z / g + 1e-4 * (abs(slope) + w @ w + z @ z / g)
        s = y[:n]
        Q = np.tensordot(
            np.ones(1) if not len(low) else _basis(weights, len(low), evidence.degree),
            np.array([[[float(x) for x in row] for row in M] for M in evidence.X]), 1,
        )  # fmt: skip
        start = stored(evidence.storage[0], weights, max(len(low), 1), 0.0)
        end = stored(evidence.storage[-1], weights, max(len(low), 1), 1.0)
        assert value(start, inverse, n, np.concatenate([s, K @ s])) <= s @ Q @ s * (1 + 1e-9)
        assert s @ Q @ s <= value(end, inverse, n, y) * (1 + 1e-9)


def _basis(weights, count, degree):
    from polefence.plant.polynomial import Domain

    return Domain((2,) * count).basis(weights[None], degree)[0]


# --- random plants -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_random_plants_are_bounded_within_a_percent(seed):
    random = np.random.default_rng(seed)
    n, m, late = 2 + seed % 2, 1 + seed % 2, (0, Fraction(1, 2), 1)[seed % 3]
    A, B, E = random.normal(size=(n, n)), random.normal(size=(n, m)), random.normal(size=(n, 1))
    step = Fraction(1, int(2 * np.abs(np.linalg.eigvals(A)).max() + 2) * 5)
    other = A + 0.2 * random.normal(size=(n, n))
    plant = UncertainPlant.from_vertices(
        [A, other], [B, B], [E, E], parameters=[Parameter("p", 0, 1)]
    )
    sampled = at_sample_time(plant, step, late)
    one, two = (M.mean(axis=0) for M in sampled.at(np.eye(2)))
    X = solve_discrete_are(one, two, np.eye(len(one)), np.eye(m))
    K = -np.linalg.solve(np.eye(m) + two.T @ X @ two, two.T @ X @ one)
    asked = Gain(tuple(f"x{k + 1}" for k in range(n)))
    bound = best_bound(sampled, FixedGain(K), asked)
    outputs, timing = (np.eye(n), np.zeros((n, m))), (float(step), float(late))
    true = max(
        gain((a * A + (1 - a) * other, B, E), outputs, K, *timing) for a in np.linspace(0, 1, 21)
    )
    assert "at all times" in bound.claim.time_text
    assert true <= bound.level <= true * 1.01
    assert prove(bound.claim).proved


def test_a_short_period_is_the_limit_of_continuous_time():
    spring = loads(SPRING)
    of_loop = best_bound(spring, FixedGain(LAW), Gain("x")).level
    short = best_bound(at_sample_time(spring, Fraction(1, 1000), 0), FixedGain(LAW), Gain("x"))
    assert abs(short.level / of_loop - 1) < 2e-3


def test_a_file_holds_what_is_stored_and_is_read_back(proved):
    claim = proved[3].claim
    text = json.dumps(claim.write())
    assert '"storage"' in text
    for one, other in pairwise(claim.subject.evidence.per_cell[0].storage):
        assert one.end < other.end
