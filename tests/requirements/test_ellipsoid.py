"""Peaks from every initial state of an ellipsoid: brackets, other computations, one fault each."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from polefence import FixedGain, HalfPlane, InputError, UncertainPlant
from polefence.base.errors import SpecError
from polefence.certify.bounds import best_bound, bounds_file, kept_bound, sampled
from polefence.certify.design import check
from polefence.lmi.conditions.methods import design
from polefence.lmi.conditions.performance import Demands, Output, Points
from polefence.plant import outputs
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.claims.started import is_semidefinite
from polefence.proof.work import FormatError
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.rms import Rms
from polefence.requirements.text import load_specifications, parse_specification
from polefence.requirements.weights import with_weights
from polefence.search.optimise import optimise
from support.files import bounds_in
from support.lmi_alone import lmi_alone

STAGE = """
name = "stage"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["shock [m/s2]"]
[parameter.k]
range = [1, 3]
[matrices]
A = [[0, 1], ["-k", -0.1]]
B = [[0], [1]]
E = [[0], [1]]
"""
X0 = ((0.04, -0.01), (-0.01, 0.09))
Y = outputs.Output("y", C=[2, -1])


@pytest.fixture(scope="module")
def stage():
    return loads(STAGE)


@pytest.fixture(scope="module")
def designed(stage):
    limits = [InitialPeak("force", 0.6, ellipsoid=X0), Rms("force", 3.0, 2.0)]
    with lmi_alone():
        return optimise(stage, Rms("x", None, 2.0), limits, HalfPlane(0.1), method="scheduled")


def turning(rate=3.0):
    """States that turn and shrink: x'x only falls, so that every peak of the ball is its start."""
    A = [[-0.5, rate], [-rate, -0.5]]
    return UncertainPlant.from_vertices([A], [[[0.0], [1.0]]])


# --- the condition --------------------------------------------------------------------------------


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize(("degree", "elevation"), [(0, 0), (1, 0), (1, 1), (2, 0)])
@pytest.mark.parametrize("points", [0, 1])
def test_blocks_are_the_inequality_at_alpha(on, degree, elevation, points):
    random = np.random.default_rng(1)
    domain = Domain.of(on, 4)
    A, B = random.normal(size=(4, 3, 3)), random.normal(size=(4, 3, 1))
    half = random.normal(size=(3, 2))
    ball = half @ half.T
    ball[2] = ball[:, 2] = 0  # zero columns are left out of the block's terms
    starts = tuple(random.normal(size=(points, 4, 3, 1)))
    source = Points("start", starts, ball)
    output = Output("y", "start", random.normal(size=(4, 1, 3)), random.normal(size=(4, 1, 1)), 2.0)
    T = random.normal(size=(3, 3))
    changed = source.changed(np.linalg.inv(T), 3.0)
    assert np.allclose(T @ changed.ellipsoid @ T.T, ball)
    pencil = design(A, B, Demands(sources=(source,), outputs=(output,)), domain, degree, elevation)
    x = random.normal(size=pencil.unknowns)
    values, blocks = pencil.unpack(x), pencil.matrices(x, 0.4)
    own = [M for name, M in blocks.items() if name.startswith("start of the ellipsoid, ")]
    order = domain.monomials(degree + 1 + elevation)
    assert len(own) == len(order)
    assert len([n for n in blocks if n.startswith("start 1, ")]) == points * len(order)
    coordinates = np.concatenate([random.dirichlet(np.ones(size)) for size in domain.sizes])
    W = np.array([values[f"W{k + 1}"] for k in range(domain.count(degree))])
    W = np.tensordot(domain.basis(domain.alpha(coordinates), degree), W, 1)
    total = sum(np.prod(coordinates ** np.array(e)) * M for e, M in zip(order, own, strict=True))
    assert np.allclose(total, W - values["t start"].item() * ball)


# --- bounds of a law ------------------------------------------------------------------------------


def test_where_no_state_grows_the_peak_is_the_start():
    law = FixedGain([[0.0, 0.0]])
    ball = InitialPeak(Y, None, ellipsoid=((1, 0), (0, 1)))
    expected = np.sqrt(5.0)
    assert expected < best_bound(turning(), law, ball).level < expected * (1 + 1e-5)
    kept = replace(ball, at_most=expected * (1 + 1e-4))
    assert kept_bound(turning(), law, kept) is not None
    for fault in (
        replace(kept, at_most=expected * (1 - 1e-4)),
        replace(kept, ellipsoid=((1, 0), (0, 1.01))),
        replace(kept, ellipsoid=((1.01, 0), (0, 1))),
        replace(kept, points=((0.0, 0.5), (0.91, -0.45))),
    ):
        assert kept_bound(turning(), law, fault) is None, fault


def test_a_segment_is_its_ends():
    """Of rank one, X0 = x0 x0' is the segment to x0: the points' own theorem."""
    plant = UncertainPlant.from_vertices([[[0, 1], [-2, -0.4]]], [[[0.0], [1.0]]])
    law, x0 = FixedGain([[-1.0, -0.5]]), (0.5, -0.25)
    segment = tuple(tuple(a * b for b in x0) for a in x0)
    one, other = (
        best_bound(plant, law, own).level
        for own in (InitialPeak(Y, None, (x0,)), InitialPeak(Y, None, ellipsoid=segment))
    )
    assert other == pytest.approx(one, rel=1e-5)


def largest(A, C, ball):
    """The largest root of c e^At X0 e^A't c', and an initial state that has it."""
    worst, start, step, row = 0.0, None, expm(0.004 * A), C
    for _ in range(5000):
        value = np.sqrt((row @ ball @ row.T).item())
        if value > worst:
            worst, start = value, (ball @ row.T / value)[:, 0]
        row = row @ step
    return worst, start


def test_everything_that_is_proved_is_met(designed):
    plant, ball = designed.plant, np.array(X0)
    alpha = seeded(plant, 12)
    own = designed.bound("force")
    assert own.specification.ellipsoid == X0
    found = sampled(plant, designed.law, own.specification, alpha)
    A, B = plant.at(alpha)
    K = designed.law.gain(alpha)
    for k, a in enumerate(alpha):
        closed = A[k] + B[k] @ K[k]
        worst, start = largest(closed, K[k], ball)
        assert found.values[k] == pytest.approx(worst, rel=5e-3), a
        # the state is on the ellipsoid, and its force reaches that value
        assert start @ np.linalg.solve(ball, start) == pytest.approx(1)
        times = np.linspace(0, 20, 2001)
        step, x, peak = expm(closed * times[1]), start, 0.0
        for _ in times:
            peak, x = max(peak, abs((K[k] @ x).item())), step @ x
        assert peak == pytest.approx(worst, rel=1e-3)
        assert worst < own.level
    assert found.worst > 0.5 * own.level
    # points on the ellipsoid ask for less
    inside = [np.linalg.cholesky(ball) @ [np.cos(v), np.sin(v)] for v in np.linspace(0, 3, 9)]
    fewer = InitialPeak("force", None, tuple(map(tuple, inside)))
    fewer = sampled(plant, designed.law, fewer, alpha).values
    assert np.all(fewer <= found.values * (1 + 1e-9))
    assert np.all(fewer > 0.9 * found.values)


def test_points_and_an_ellipsoid_are_both_kept(stage):
    law, alpha = FixedGain([[-2.0, -2.0]]), seeded(stage, 5)
    both = InitialPeak("x", None, ((0.5, 0.0),), 0.1, X0)
    parts = [replace(both, points=(), impulse=0.0), replace(both, ellipsoid=())]
    values = [sampled(stage, law, own, alpha).values for own in (both, *parts)]
    assert values[0] == pytest.approx(np.maximum(*values[1:]))
    levels = [best_bound(stage, law, own).level for own in (both, *parts)]
    assert levels[0] >= max(levels[1:]) * (1 - 1e-6)


# --- the claim and its file -----------------------------------------------------------------------


def document_of(designed):
    claims = [bound.claim for bound in designed.bounds]
    return json.loads(bounds_file(designed.design.certificate, claims).dumps()), claims


def test_a_file_holds_the_ellipsoid(designed, tmp_path):
    document, claims = document_of(designed)
    found = bounds_in(json.dumps(document))
    assert found == claims
    assert found[1].ellipsoid == tuple(tuple(map(Fraction, row)) for row in X0)
    designed.save(tmp_path)
    answer = check(tmp_path)
    assert answer.proved
    (said,) = (claim for claim in answer.claims if claim.startswith("initial peak of 'force' = "))
    assert " <= 0.6 from x(0)' X0^-1 x(0) <= 1, X0 = " in said


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([[0.04, 0.01], [-0.01, 0.09]], "symmetric"),
        ([[0.04, -0.1], [-0.1, 0.09]], "without negative eigenvalues"),
        ([[0.04, -0.01]], "ellipsoid is 1 x 2, not 2 x 2"),
        ([[0, 0], [0, 0]], "no initial state"),
        ("1", "ellipsoid"),
    ],
)
def test_what_is_no_ellipsoid_is_named(designed, value, message):
    document, _ = document_of(designed)
    document["claims"][2]["ellipsoid"] = value
    with pytest.raises(FormatError, match=message):
        [prove(claim) for claim in bounds_in(json.dumps(document))]


def test_a_larger_ellipsoid_is_not_proved(designed):
    claim = designed.bounds[1].claim
    assert prove(claim).proved
    for i in range(2):
        larger = [list(row) for row in claim.ellipsoid]
        larger[i][i] *= 20
        verdict = prove(replace(claim, ellipsoid=tuple(map(tuple, larger))))
        assert not verdict.proved
        assert "of the ellipsoid" in verdict.reason
    smaller = tuple(tuple(x / 2 for x in row) for row in claim.ellipsoid)
    assert prove(replace(claim, ellipsoid=smaller)).proved


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.integers(0, 4), st.integers(0, 10**6))
def test_semidefinite_is_what_no_negative_eigenvalue_is(n, rank, seed):
    random = np.random.default_rng(seed)
    half = random.integers(-3, 4, size=(n, rank))
    square = half @ half.T
    assert is_semidefinite([[Fraction(int(x)) for x in row] for row in square])
    # a little less, in a direction that it has not: negative, if only just
    values, vectors = np.linalg.eigh(square)
    if values[0] < 1e-9:
        less = square - 1e-6 * np.outer(vectors[:, 0], vectors[:, 0])
        less = (less + less.T) / 2
        assert not is_semidefinite([[Fraction(x) for x in row] for row in less.tolist()])


# --- as people write it ---------------------------------------------------------------------------


def test_tables_hold_exact_numbers(tmp_path):
    spec = tmp_path / "s.toml"
    table = '[[specification]]\nkind = "initial peak"\nsignal = "force"\nat_most = 2\n'
    spec.write_text(STAGE + table + "ellipsoid = [[0.01, 0], [0, 1]]\n")
    (own,) = load_specifications(spec)[1]
    assert own == InitialPeak("force", 2.0, ellipsoid=((Fraction(1, 100), 0), (0, 1)))
    for text, message in {
        "3": "must be a list of rows of a matrix",
        "[[1, 0], [0]]": "must be a square matrix",
        "[[1, 2], [2, 1]]": "without negative eigenvalues",
        '[["x", 0], [0, 1]]': "must be a finite number",
    }.items():
        spec.write_text(STAGE + table + f"ellipsoid = {text}\n")
        with pytest.raises(SpecError, match=message):
            load_specifications(spec)
    with pytest.raises(InputError, match="ellipsoid is for a spec's tables"):
        parse_specification("initial peak of v <= 1 with ellipsoid 2")


def test_what_does_not_fit_is_refused(stage):
    with pytest.raises(InputError, match="the ellipsoid is 1 x 1; stage has 2 states: x, v"):
        optimise(
            stage,
            Rms("x", None, 2.0),
            [InitialPeak("x", 1.0, ellipsoid=((1,),))],
            method="scheduled",
        )
    for value, message in {
        ((0.0,),): "give points or an impulse, or an ellipsoid",
        ((float("nan"),),): "finite numbers",
        (1, 2): "must be a square matrix",
    }.items():
        with pytest.raises(InputError, match=message):
            InitialPeak("x", 1.0, ellipsoid=value)
    assert InitialPeak("x", 1.0, ellipsoid=np.eye(2)).ellipsoid == ((1, 0), (0, 1))


def test_filters_are_at_rest_at_first(stage):
    asked = (Rms("v", None, 2.0, "Wk"), InitialPeak("x", 1.0, ((1.0, 2.0),), 0.0, X0))
    plant, (_, peak) = with_weights(stage, asked)
    n = plant.shape[0]
    assert n > 2
    assert peak.points == ((1.0, 2.0, *[0.0] * (n - 2)),)
    ball = np.array(peak.ellipsoid)
    assert ball.shape == (n, n)
    assert np.array_equal(ball[:2, :2], X0)
    assert np.count_nonzero(ball) == 4
