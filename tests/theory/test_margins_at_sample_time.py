"""Margins of designs at a sample time: the verifier's matrices, true samples, one fault each."""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.linalg import expm

from polefence import (
    HalfPlane,
    Parameter,
    Structure,
    UncertainPlant,
    analyse,
    at_sample_time,
    in_service,
    place,
)
from polefence.base.errors import NotProvedError
from polefence.certify.margins import estimation_error, gain_error
from polefence.certify.margins import service as search
from polefence.certify.margins.breaks import Break
from polefence.certify.margins.claims import Reached, subject_of
from polefence.law.laws import FixedGain
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.claims.estimate import Estimate
from polefence.proof.document import check, from_plain
from polefence.proof.document import loads as read
from polefence.proof.work import FormatError
from polefence.region.regions import Disk
from polefence.search import driver, estimated
from support.specs import SPRING

T = 0.02
REGION = Disk(0.6, 0.1)


@pytest.fixture(scope="module")
def spring():
    return loads(SPRING)


@pytest.fixture(scope="module")
def plant(spring):
    return at_sample_time(spring, T)


@pytest.fixture(scope="module")
def design(plant):
    return place(plant, REGION, "scheduled")


@pytest.fixture(scope="module")
def service(design):
    return in_service(design)


def values(claim, coordinates):
    """The value of each inequality about the region there, by piece."""
    found = {}
    for own in claim.inequalities():
        if own.name != "of the remainder":
            blocks = list(own.blocks())
            weights = [np.prod(np.power(coordinates, place.powers)) for place, _ in blocks]
            matrices = np.array([M for _, M in blocks], dtype=float)
            found.setdefault(own.piece, []).append(np.tensordot(weights, matrices, 1))
    return found


def lyapunov(design, alpha):
    """X and K X of a scheduled law with its evidence."""
    law, (own,) = design.law, design.certificate.evidence["parts"]
    basis = law.domain.basis(alpha, law.degree)
    W, Z = (np.tensordot(basis, M, 1) for M in (law.W, law.Z))
    more = law.domain.basis(alpha, own["degree"])
    V = np.tensordot(more, own["multiple"], 1) * np.eye(2) + np.tensordot(more, own["X"], 1) @ W
    return W @ V, Z @ V


def lost(spread, M):
    """What a remainder takes of the inequality of M."""
    kept = M.any(axis=0)
    M1, M2 = M[:, kept], np.eye(len(M))[kept]
    H = np.diag([float(row) for row in spread.rows])
    omega = np.array(spread.omega, dtype=float)
    return np.kron(M1 @ M1.T, H @ H) + np.kron(M2.T @ M2, omega)


def same_direction(mine, other):
    mine, other = mine / np.linalg.norm(mine), other / np.linalg.norm(other)
    assert np.allclose(mine, other, atol=1e-12)


def test_between_the_extremes_all_parameters_count(design, plant):
    """On a curve an end of the error may not be the worst of it: each p between is looked at."""
    assert plant.curve_degree > 1
    errors, pieces = (Fraction(1, 20), Fraction(25)), (2, 1)
    subject = subject_of(design, design.region, Reached(1.0, 2, 1))
    claim = Estimate(replace(subject, pieces=pieces), errors)
    tau, across = np.array([0.3, 0.6]), np.array([0.35, 0.8])
    coordinates = np.stack([1 - np.r_[tau, across], np.r_[tau, across]], axis=1).ravel()
    each = []
    for p, error, count, t, s in zip(
        plant.parameters, (0.05, 25.0), pieces, tau, across, strict=True
    ):
        low, high, own = float(p.low), float(p.high), []
        cuts = {*np.linspace(low, high, count + 1), low + error, high - error}
        for u, v in pairwise(sorted(cuts)):
            ends = [np.clip(np.array([u, v]) + sign * error, low, high) for sign in (-1, 1)]
            least, most = (end[0] + t * (end[1] - end[0]) for end in ends)
            own.append((least + s * (most - least), u + t * (v - u)))
        each.append(own)
    found, spread = values(claim, coordinates), claim.subject.design.evidence[0].spread
    assert len(found) == 4 * 3
    for mine, (first, second) in zip(found.values(), product(*each), strict=True):
        A, B = plant.at(np.asarray(plant.alpha(m=first[0], k=second[0]), dtype=float))
        X, KX = lyapunov(design, np.asarray(plant.alpha(m=first[1], k=second[1]), dtype=float))
        N = A @ X + B @ KX
        for (L, M), one in zip(design.region.pairs(), mine, strict=True):
            F = -(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T))
            same_direction(one, F - lost(spread, M))


def test_mislaid_weight_anywhere_in_the_simplex():
    """Of a plant given by its vertices, of which the samples are curved too."""
    A = [[["0", "1"], [-90 + 20 * k, "-2"]] for k in range(3)]
    plant = UncertainPlant.from_vertices(A, [[["0"], ["1"]]] * 3)
    seen = at_sample_time(plant, 0.05, degree=2)
    design = place(seen, HalfPlane(2), "scheduled")
    share = Fraction(1, 5)
    claim = Estimate(subject_of(design, design.region, Reached(1.0, 1, 1)), (share,))
    assert prove(claim).proved
    a, v, u = np.array([[0.2, 0.5, 0.3], [0.1, 0.3, 0.6], [0.5, 0.1, 0.4]])
    found = values(claim, np.concatenate([a, v, u]))
    (mine,) = found.values()
    A, B = seen.at(0.8 * a + 0.2 * u)
    X, KX = lyapunov(design, 0.8 * a + 0.2 * v)
    N, spread = A @ X + B @ KX, claim.subject.design.evidence[0].spread
    for (L, M), one in zip(design.region.pairs(), mine, strict=True):
        F = -(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T))
        same_direction(one, F - lost(spread, M))
    (margin,) = estimation_error(design)
    assert margin.proved
    assert prove(margin.claim).proved


def loop(spring, law, p, q):
    """The true samples' loop, its parameters p and the law's q."""
    A, B = spring.at(np.asarray(spring.alpha(m=p[0], k=p[1]), dtype=float))
    whole = expm(np.block([[A, B], [np.zeros((1, 3))]]) * T)
    K = law.gain(np.asarray(spring.alpha(m=q[0], k=q[1]), dtype=float))
    return whole[:2, :2], whole[:2, 2:], K


def keeps(loop):
    return np.abs(np.linalg.eigvals(loop) - REGION.centre).max() < REGION.radius


@pytest.mark.parametrize("name", ["estimate-m", "estimate-k", "estimate"])
def test_true_samples_stay_where_estimates_are_off(spring, design, service, name):
    margin = service[name]
    assert margin.proved
    assert margin.value < margin.upper < 2 * margin.value
    stays_where_off(spring, design, [float(e) for e in margin.claim.errors])


def stays_where_off(spring, design, errors):
    low, high = np.array([0.8, 80.0]), np.array([1.2, 120.0])
    errors, random = np.array(errors), np.random.default_rng(3)
    for _ in range(1500):
        q = low + (high - low) * random.choice([0.0, 1.0, random.random()], 2)
        p = np.clip(q + errors * random.choice([-1.0, 1.0, random.uniform(-1, 1)], 2), low, high)
        A, B, K = loop(spring, design.law, p, q)
        assert keeps(A + B @ K)


def test_a_curve_is_part_of_the_remainder_where_it_takes_too_many_inequalities(
    spring, design, service, monkeypatch
):
    monkeypatch.setattr(search, "MOST", 200)
    fewer = estimation_error(design)[-1]
    exact = service["estimate"]
    assert 0.8 * exact.value < fewer.value < exact.value
    curve, flat = exact.claim.subject.design.remainder, fewer.claim.subject.design.remainder
    assert not flat.curve
    document = read(fewer.file(design).dumps())
    assert check(document).proved
    stays_where_off(spring, design, [float(e) for e in fewer.claim.errors])
    # without the curve's share the entries are no bound on the samples
    table = fewer.file(design).write()
    for row, entries in zip(table["plant"]["remainder"], curve.entries, strict=True):
        row[:] = [str(x) for x in entries]
    assert not check(from_plain(table)).proved


def test_true_samples_stay_where_the_gain_is_off(spring, design, service):
    """And the error is not far below one at which a pole leaves."""
    margin = service["gain"]
    assert margin.value < margin.upper < 2 * margin.value
    claim, random = margin.claim, np.random.default_rng(4)
    sizes = np.array(claim.sizes, dtype=float)
    low, high = np.array([0.8, 80.0]), np.array([1.2, 120.0])
    for _ in range(1500):
        p = low + (high - low) * random.choice([0.0, 1.0, random.random()], 2)
        A, B, K = loop(spring, design.law, p, p)
        D = margin.value * sizes * random.choice([-1.0, 1.0, random.random()], (1, 2))
        assert keeps(A + B @ (K + D))


def test_short_samples_have_the_margins_of_continuous_time(spring):
    """Of one gain, whose errors are judged by a Lyapunov matrix of the same condition."""
    law = FixedGain(np.array([[-30.0, -12.0]]))
    whole = gain_error(analyse(spring, law, HalfPlane(2)).design).value
    short = at_sample_time(spring, 1e-4)
    own = gain_error(analyse(short, law, HalfPlane(2)).design).value
    assert 0.9 * whole < own < 1.2 * whole


def times(factor, rows):
    return [[str(factor * Fraction(x)) for x in row] for row in rows]


@pytest.mark.parametrize("name", ["estimate-m", "estimate-k", "estimate", "gain"])
def test_one_fault_at_a_time(service, name):
    document = json.loads(service.file(service[name]).dumps())
    assert check(read(json.dumps(document))).proved
    kinds = [table["kind"] for table in document["claims"]]
    assert kinds == ["error of each gain" if name == "gain" else "estimate", "samples"]

    def fails(change):
        own = json.loads(json.dumps(document))
        table = own["claims"][0]
        change(own, table, table["evidence"]["parts"][0]["remainder"])
        try:
            return not check(read(json.dumps(own))).proved
        except FormatError:
            return True

    key = "error" if name == "gain" else "errors"
    larger = 1.05 * np.array(document["claims"][0][key])
    assert fails(lambda _, table, __: table.update({key: larger.tolist()}))
    for factor in (Fraction(1, 2), 10**6):
        assert fails(lambda _, __, own, f=factor: own.update(omega=times(f, own["omega"])))
    for side in ("rows", "columns"):  # which then do not cover what the samples are off by
        assert fails(lambda _, __, own, s=side: own.update({s: (np.array(own[s]) / 2).tolist()}))
    assert fails(lambda _, table, __: table["evidence"]["parts"][0].pop("remainder"))
    assert fails(lambda own, _, __: own["plant"].pop("curve"))


def test_what_is_not_covered_is_not_proved(service):
    """The claim of an estimate reads the curve, and the remainder, of the plant."""
    claim = service["estimate-k"].claim
    own = claim.subject.design
    assert prove(claim).proved

    def answer(remainder):
        subject = replace(claim.subject, design=replace(own, remainder=remainder))
        try:
            return prove(replace(claim, subject=subject)).proved
        except FormatError:
            return False

    curve = tuple(tuple(tuple(x * 100 for x in row) for row in M) for M in own.remainder.curve)
    assert not answer(replace(own.remainder, curve=curve))
    more = tuple(tuple(2 * x for x in row) for row in own.remainder.entries)
    assert not answer(replace(own.remainder, entries=more))


ERRORS = {"m": Fraction(3, 100), "k": 3}


def test_laws_designed_for_errors_of_the_estimate(spring, plant):
    """More than those that a law bears that was not designed for them."""
    own = place(plant, REGION, errors=ERRORS)
    assert [claim.kind for claim in own.more] == ["estimate"]
    assert all(prove(claim).proved for claim in (own.certificate.claim(), *own.more))
    random, low, high = np.random.default_rng(5), np.array([0.8, 80.0]), np.array([1.2, 120.0])
    for _ in range(1500):
        q = low + (high - low) * random.choice([0.0, 1.0, random.random()], 2)
        p = np.clip(q + [0.03, 3] * random.choice([-1.0, 1.0, random.random()], 2), low, high)
        A, B, K = loop(spring, own.law, p, q)
        assert keeps(A + B @ K)


def test_errors_that_no_law_bears(plant):
    with pytest.raises(NotProvedError, match="with m off by 0.4, k off by 40; try smaller"):
        place(plant, REGION, errors={"m": 0.4, "k": 40})


def test_samples_of_a_lower_degree_where_the_proof_would_be_too_large(spring, monkeypatch):
    monkeypatch.setattr(estimated, "MOST", 500)
    own = place(at_sample_time(spring, T, degree=4), HalfPlane(2), errors={"m": 0.05})
    assert 1 < own.plant.curve_degree < 4
    assert all(prove(claim).proved for claim in (own.certificate.claim(), *own.more))
    many = UncertainPlant.from_expressions(
        [Parameter(f"p{k}", 1, 2) for k in range(6)],
        [["p0 - p1 + p2", "1"], ["p3", "-p4"]],
        [["0"], ["p5"]],
    )
    with pytest.raises(NotProvedError, match="more than the 500 that are tried; name fewer"):
        place(many, HalfPlane(1), errors={f"p{k}": 0.1 for k in range(6)})


def test_what_breaks_by_one_error_alone_breaks_by_all_at_once(design, monkeypatch):
    shares = iter([0.1, 0.3, 0.2])
    monkeypatch.setattr(
        search, "estimate_break", lambda *_: Break(share := next(shares), f"at {share}")
    )
    *single, joint = estimation_error(design)
    assert [own.upper for own in single] == pytest.approx([0.04, 12])
    assert (joint.upper, joint.example) == (pytest.approx(0.1), "at 0.1")


def test_one_gain_is_kept_where_no_scheduled_one_is_proved(plant, monkeypatch):
    def kept(whole, law, region):
        calls.append(law.fixed)
        return driver.kept(whole, law, region) if law.fixed and one_gain else None

    calls, one_gain = [], True
    monkeypatch.setattr("polefence.search.place.kept", kept)
    design = place(plant, HalfPlane(2), structure=Structure(schedule=("k",)))
    assert design.law.fixed
    assert prove(design.certificate.claim()).proved
    assert not calls[0]
    one_gain = False
    with pytest.raises(NotProvedError, match="not within the interpolation-error bound"):
        place(plant, HalfPlane(2), structure=Structure(schedule=()))
