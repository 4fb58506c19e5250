"""Errors of the gain of any design: the verifier against numpy, truth, and one fault at a time."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import (
    Disk,
    Ellipse,
    HalfPlane,
    InputError,
    Parameter,
    Scheduled,
    Sector,
    UncertainPlant,
    VerticalStrip,
    analyse,
    check,
    place,
)
from polefence.certify.evidence import certificate_of
from polefence.certify.margins.claims import claimed_design
from polefence.certify.margins.gain_scales import Scales, gain_claim
from polefence.cli.main import main
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.polynomial import Domain
from polefence.proof.claims.base import prove
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.matrices import least_work
from polefence.proof.ranges import Range
from polefence.proof.work import FormatError
from support.changes import changed
from support.files import is_proved, only_claim_in

REGION = HalfPlane(0.5) & Sector(0.2) & VerticalStrip(-12, -0.4) & Ellipse(-4, 5, 4)


def plant_of() -> UncertainPlant:
    parameters = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 1, 9, "N/m")]
    return UncertainPlant.from_expressions(
        parameters, [["0", "1"], ["-k/m", "-1/m"]], [["0"], ["1/m"]]
    )


def random_vertices() -> UncertainPlant:
    random = np.random.default_rng(2)
    A, B = random.normal(size=(3, 3)), random.normal(size=(3, 2))
    As = [A + 0.1 * random.normal(size=(3, 3)) for _ in range(3)]
    return UncertainPlant.from_vertices(As, [B + 0.05 * random.normal(size=(3, 2)) for _ in As])


def spd(random, n: int = 2) -> np.ndarray:
    half = random.normal(size=(n, n))
    W = half @ half.T + np.eye(n)
    return (W + W.T) / 2


# --- the algebra ---------------------------------------------------------------------------------

# on, degree of the law (0: one gain), degree of the evidence, its elevation, that of the claim
FORMS = [
    ("simplex", 0, 0, 0, 0),
    ("box", 0, 1, 1, 1),
    ("simplex", 1, 1, 1, 0),
    ("box", 1, 0, 0, 2),
    ("box", 2, 1, 0, 0),
]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("full", [False, True])
def test_the_inequalities_are_those_of_petersen(form, full):
    """At a point, from numpy's own X, N, B: the Schur complement of every block, and its scale."""
    on, own, degree, elevation, extra = form
    parameters = [Parameter("p1", 1, 3, "kg", "1/p1"), Parameter("p2", -2, "-1/2", "", "1/p2")]
    plant = UncertainPlant.from_expressions(
        parameters, [["1", "2/p1"], ["1/p2", "-1 + 2/p1/p2"]], [["0", "1"], ["2/p1", "1/p2"]]
    )
    random, domain = np.random.default_rng(3), Domain.of(on, 4)
    count = domain.count(own)
    W, Z = np.array([spd(random) for _ in range(count)]), random.normal(size=(count, 2, 2))
    law = ScheduledGain(W, Z, (), own, domain.sizes) if own else FixedGain(Z[0])
    parts = []
    for _ in REGION.parts:
        Q = np.array([spd(random) for _ in range(domain.count(degree))])
        part = {"X": Q, "degree": degree, "elevation": elevation}
        multiple = {"multiple": random.uniform(0.5, 2, len(Q))} if own else {}
        parts.append(part | multiple)
    certificate = certificate_of(plant, law, REGION, parts)
    if not own:
        evidence = dict(certificate.evidence) | {"on": on}
        certificate = replace(certificate, evidence=evidence)
    rows, columns, mu = (1.0, 0.5), (3.0, 0.25), (0.5, 1.5, 2.5, 3.5, 4.5)
    T = np.array([[3.0, 1.0], [-0.5, 0.25]]) if full else np.diag(columns)
    right = tuple(tuple(map(Fraction, t)) for t in T) if full else tuple(map(Fraction, columns))
    ranges = tuple(Range(p.low, p.high, p.inverted) for p in parameters)
    subject = Subject(certificate.claim(), ranges, (1, 1), extra)
    claim = GainError(
        subject, Fraction(1, 8), tuple(map(Fraction, rows)), right, tuple(map(Fraction, mu))
    )
    coordinates = (
        np.array([0.1, 0.2, 0.3, 0.4]) if on == "simplex" else np.array([0.3, 0.7, 0.6, 0.4])
    )
    alpha = domain.alpha(coordinates)
    found = list(claim.blocks())
    A, B = plant.at(alpha)
    closed, numbers = A + B @ law.gain(alpha), iter(mu)
    for part, evidence in zip(REGION.parts, parts, strict=True):
        total = degree + 1 + 2 * own + elevation + extra
        weights = [np.prod(np.power(coordinates, e)) for e in domain.monomials(total)]
        basis = domain.basis(alpha, degree) if degree else np.ones(1)
        X = np.tensordot(basis, evidence["X"], 1)
        if own:
            w = np.tensordot(domain.basis(alpha, own), W, 1)
            X = w * (basis @ evidence["multiple"]) + w @ X @ w
        N = closed @ X

        def next_value(weights=weights):
            mine = [found.pop(0)[1] for _ in weights]
            return np.tensordot(weights, np.array(mine, dtype=float), 1)

        mine = next_value()
        assert np.allclose(mine / np.linalg.norm(mine), X / np.linalg.norm(X), atol=1e-12)
        for L, M in part.pairs():
            F = -(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T))
            number = next(numbers)
            E = np.kron(M, B @ np.diag(rows))  # M M1' ... : of full rank here, M1 = M, M2 = I
            H = np.kron(np.eye(len(M)), T @ X) / 8
            other = F - number * E @ E.T - H.T @ H / number
            block, d = next_value(), len(other)
            corner = block[d:, d:]
            assert np.allclose(corner, corner[0, 0] * np.eye(len(corner)), rtol=1e-12)
            schur = block[:d, :d] - block[:d, d:] @ np.linalg.solve(corner, block[d:, :d])
            scaled = schur * number / corner[0, 0]
            assert np.allclose(scaled, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())
    assert not found


# --- designs -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def designs(small_designs, make_random):
    plant, vertices = plant_of(), random_vertices()
    law = place(plant, Disk(-3, 2.2), Scheduled(1, 1, "box")).law
    flat = place(vertices, Disk(-3, 2.5), "scheduled").law
    fixed = place(vertices, Disk(-3, 2.9), "quadratic").law
    found = {
        "parts": analyse(plant, law, HalfPlane(0.3) & Sector(0.2) & VerticalStrip(-12, -0.2)),
        "disk": analyse(plant, law, Disk(-3, 2.3)),
        "vertices": analyse(vertices, flat, Disk(-3, 2.7)),
        "one gain": analyse(vertices, fixed, HalfPlane(0.05) & Disk(-3, 2.95)),
    }
    assert {a.design.method for a in found.values()} == {"lyapunov"}
    return {name: a.design for name, a in found.items()} | {
        "slack": place(make_random(5, 2, 2, 3, 0.1), Disk(-3, 0.4), "slack"),
        "quadratic": small_designs["quadratic"],
        "scheduled": small_designs["scheduled"],
    }


def scales_of(design):
    """The largest entry of each column at the corners, and the rows' largest share of it."""
    size = np.abs(design.law.gain(np.eye(len(design.plant.vertices)))).max(axis=0)
    columns = size.max(axis=0)
    return Scales((size / columns).max(axis=1), columns)


def breaking(design, scales):
    """An error at which a pole is outside, in the directions in which one moves there fastest."""
    alpha = points(design, 60)
    A, B = design.plant.at(alpha)
    closed, left = A + B @ design.law.gain(alpha), B * scales.rows
    X = np.linalg.eig(closed)[1]
    rows, right = np.linalg.inv(X) @ left, scales.columns[:, None] * X
    moves = []
    for turn in np.exp(2j * np.pi * np.arange(8) / 8):
        G = np.real(turn * rows[..., :, None] * right.swapaxes(-1, -2)[..., None, :])
        U, _, V = np.linalg.svd(G, full_matrices=False)
        moves.append(left[:, None] @ (U @ V * scales.columns))
    moves = np.concatenate(moves, axis=1)
    for error in np.geomspace(1e-4, 1e4, 400):
        if not design.region.contains(np.linalg.eigvals(closed[:, None] + error * moves)):
            return error
    return None


NAMES = ["parts", "disk", "vertices", "one gain", "slack", "quadratic", "scheduled"]
GIVEN = NAMES[:4]


@pytest.fixture(scope="module")
def claims(designs):
    """For each design the largest error, and a claim that is nearly of so much."""
    found = {}
    for name, design in designs.items():
        scales = scales_of(design)
        largest, _ = gain_claim(design, scales.rows, scales.columns, 0.0)
        _, claim = gain_claim(design, scales.rows, scales.columns, 0.99 * largest)
        found[name] = design, scales, largest, claim
    return found


def points(design, count):
    random = np.random.default_rng(4)
    q, N = len(design.plant.parameters), len(design.plant.vertices)
    if not q:
        return np.vstack([np.eye(N), random.dirichlet(np.full(N, 0.5), count)])
    share = np.vstack([np.array([[0, 0], [0, 1], [1, 0], [1, 1]]), random.uniform(size=(count, 2))])
    return Domain((2,) * q).alpha(np.stack([1 - share, share], -1).reshape(len(share), -1))


@pytest.mark.parametrize("name", NAMES)
def test_what_is_proved_is_true(claims, name):
    design, scales, largest, claim = claims[name]
    assert 0.99 * largest <= claim.error <= largest * (1 + 1e-3)
    assert prove(claim).proved
    random, alpha = np.random.default_rng(5), points(design, 60)
    A, B = design.plant.at(alpha)
    closed, left = A + B @ design.law.gain(alpha), B * scales.rows
    m, n = len(scales.rows), len(scales.columns)
    D = random.normal(size=(40, m, n))
    D /= np.linalg.norm(D, 2, axis=(1, 2))[:, None, None]
    error = float(claim.error)
    off = closed[:, None] + error * left[:, None] @ (D * scales.columns)
    assert design.region.contains(np.linalg.eigvals(off))
    # the directions in which some pole moves outwards fastest, and their neighbours
    poles, X = np.linalg.eig(closed)
    rows, right = np.linalg.inv(X) @ left, scales.columns[:, None] * X
    for turn in np.exp(2j * np.pi * np.arange(8) / 8):
        G = np.real(turn * rows[..., :, None] * right.swapaxes(-1, -2)[..., None, :])
        U, _, V = np.linalg.svd(G, full_matrices=False)
        off = closed[:, None] + error * left[:, None] @ (U @ V * scales.columns)
        assert design.region.contains(np.linalg.eigvals(off))
    assert poles.shape == (len(alpha), n)


@pytest.mark.parametrize("name", NAMES)
def test_nearly_all_is_proved_and_nothing_that_breaks(claims, name):
    design, scales, largest, claim = claims[name]
    broken = breaking(design, scales)
    assert broken > largest
    for error in (largest * 1.02, broken):
        for factor in np.geomspace(0.05, 20, 9):
            mu = tuple(Fraction(float(m) * factor) for m in claim.mu)
            assert not prove(replace(claim, error=Fraction(error), mu=mu)).proved
    # and so says the search
    assert gain_claim(design, scales.rows, scales.columns, largest * 1.02) == (largest, None)


@pytest.mark.parametrize("needed", [1e-3, 1e-9, 1e-14, 1e-30, 0.0])
@pytest.mark.parametrize("name", NAMES)
def test_a_tiny_error_is_proved_where_there_is_room(claims, name, needed):
    design, scales, largest, _ = claims[name]
    again, claim = gain_claim(design, scales.rows, scales.columns, needed * largest)
    assert again == largest
    assert needed * largest <= claim.error <= 1.001 * max(np.sqrt(needed), 1e-12) * largest
    assert prove(claim).proved
    for factor in (1 / 3, 3):  # far from where it fails
        mu = tuple(m * Fraction(factor) for m in claim.mu)
        assert prove(replace(claim, mu=mu)).proved


@pytest.mark.parametrize("name", NAMES)
def test_scales_only_scale(claims, name):
    """Twice the rows is half the error; a diagonal matrix is its diagonal; units do not matter."""
    design, scales, largest, _ = claims[name]
    rows, columns = scales.rows, scales.columns
    half, claim = gain_claim(design, 2 * rows, 1e3 * columns, largest / 4000)
    assert half == pytest.approx(largest / 2000, rel=1e-4)
    assert claim is not None
    same, claim = gain_claim(design, rows, np.diag(columns), largest / 2)
    assert same == pytest.approx(largest, rel=1e-9)
    assert claim.columns == tuple(
        tuple(Fraction(float(c) * (i == j)) for j in range(len(columns)))
        for i, c in enumerate(columns)
    )


@pytest.mark.parametrize("name", ["parts", "one gain", "scheduled"])
def test_any_matrix_may_stand_on_the_right(claims, name):
    design, scales, _, _ = claims[name]
    n = len(scales.columns)
    T = np.tril(np.random.default_rng(6).normal(size=(n, n))) * scales.columns
    largest, claim = gain_claim(design, scales.rows, T, 0.0)
    _, claim = gain_claim(design, scales.rows, T, 0.98 * largest)
    alpha, random = points(design, 50), np.random.default_rng(7)
    D = random.normal(size=(60, len(scales.rows), n))
    D /= np.linalg.norm(D, 2, axis=(1, 2))[:, None, None]
    A, B = design.plant.at(alpha)
    closed, left = A + B @ design.law.gain(alpha), B * scales.rows
    off = closed[:, None] + float(claim.error) * left[:, None] @ (D @ T)
    assert design.region.contains(np.linalg.eigvals(off))
    turned = np.linalg.qr(random.normal(size=(n, n)))[0] @ T  # D Q is a D
    assert gain_claim(design, scales.rows, turned, 0.0)[0] == pytest.approx(largest, rel=1e-6)
    document = json.loads(claimed_design(design).certificate.file([claim]).dumps())
    assert only_claim_in(json.dumps(document)) == claim
    larger = [[1.1 * value for value in row] for row in T.tolist()]
    assert not is_proved(changed(document, "claims", 0, "columns", value=larger))


def test_slack_designs_are_proved_anew(designs):
    design = designs["slack"]
    given = claimed_design(design)
    assert given.method == "lyapunov"
    assert given.law is design.law
    assert given.region == design.region
    assert check(given).proved
    assert claimed_design(given) is given
    # a gain that no polynomial proves: the region is that of another plant
    narrow = replace(design.certificate, region=Disk(-3, design.region.radius / 4))
    assert gain_claim(replace(design, certificate=narrow), [1, 1], [1, 1], 0) == (0.0, None)


# --- faults --------------------------------------------------------------------------------------


def document_of(claims, name):
    design, _, _, claim = claims[name]
    return json.loads(claimed_design(design).certificate.file([claim]).dumps())


EVIDENCE = ("claims", 0, "evidence", "parts", 0)


@pytest.mark.parametrize("name", GIVEN)
def test_one_fault_at_a_time(claims, name):
    document = document_of(claims, name)
    assert is_proved(document)
    assert not is_proved(changed(document, "claims", 0, "error", value=lambda v: v * 1.05))
    for key in ("rows", "columns"):
        wider = changed(document, "claims", 0, key, value=lambda v: [x * 1.1 for x in v])
        assert not is_proved(wider)
    for factor in (0.01, 100):
        worse = changed(document, "claims", 0, "mu", value=lambda v, f=factor: [x * f for x in v])
        assert not is_proved(worse)
    tilted = changed(document, *EVIDENCE, "X", 0, 0, 1, value=lambda v: v * (1 + 1e-12) + 1e-300)
    assert not is_proved(tilted)  # not symmetric
    faults = []
    for factor in (-1e9, 1e9):
        other = changed(document, *EVIDENCE, "X", 0, 0, 0, value=lambda v, f=factor: v * f)
        faults.append(not is_proved(other))
    assert any(faults)
    vertex = ("plant", "vertices", 1)
    for place_ in ((*vertex, "A", 1, 1), (*vertex, "B", 1, 0)):
        faults = [
            not is_proved(changed(document, *place_, value=lambda v, f=f: float(Fraction(v)) * f))
            for f in (-40, 40)
        ]
        assert any(faults), place_
    for index in range(len(document["claims"][0]["mu"])):
        fewer = changed(document, "claims", 0, "mu", value=lambda v, i=index: v[:i] + v[i + 1 :])
        with pytest.raises(FormatError, match="mu must"):
            is_proved(fewer)


@pytest.mark.parametrize("name", GIVEN[:3])
def test_faults_of_scheduled_laws(claims, name):
    document = document_of(claims, name)
    for keys in (("law", "W", 0, 0, 0), ("law", "Z", 1, 0, 1)):
        faults = [
            not is_proved(changed(document, *keys, value=lambda v, f=f: v * f))
            for f in (-30, 0.1, 30)
        ]
        assert any(faults), keys
    for factor in (-1, 0):
        none = changed(
            document, *EVIDENCE, "multiple", value=lambda v, f=factor: [f * x for x in v]
        )
        assert not is_proved(none)
    asymmetric = changed(document, "law", "W", 0, 0, 1, value=lambda v: v * (1 + 1e-12))
    assert not is_proved(asymmetric)


SHAPES = {
    "degree": ((*EVIDENCE, "degree"), 1, "its degree needs"),
    "elevation of the evidence": ((*EVIDENCE, "elevation"), 17, "0 to 16"),
    "elevation": (("claims", 0, "elevation"), 17, "0 to 16"),
    "pieces": (("claims", 0, "pieces"), [2, 1], "pieces must be 1"),
    "no rows": (("claims", 0, "rows"), [1, 1], "rows must hold 1"),
    "zero row": (("claims", 0, "rows"), [0], "rows must be positive"),
    "mu": (("claims", 0, "mu"), [1, 1, 1, -1], "mu must be positive"),
    "error": (("claims", 0, "error"), -1, "error must be zero or more"),
    "columns": (("claims", 0, "columns"), [1, 2, 3], "columns must hold 2"),
    "columns of a matrix": (("claims", 0, "columns"), [[1, 2]], "columns"),
    "mixed columns": (("claims", 0, "columns"), [[1, 2], 3], "columns"),
    "parts": (("claims", 0, "evidence", "parts"), lambda v: v[:2], "law and evidence"),
    "region": (("claims", 0, "region"), {"kind": "half_plane", "decay": 0}, "law and evidence"),
    "multiple": ((*EVIDENCE, "multiple"), [1, 1], "one number a matrix|1 entries"),
}


@pytest.mark.parametrize("fault", SHAPES)
def test_shapes_are_refused(claims, fault):
    keys, value, message = SHAPES[fault]
    document = document_of(claims, "parts")
    document = changed(
        document,
        *keys[:-1],
        value=lambda table: dict(
            table, **{keys[-1]: (value(table[keys[-1]]) if callable(value) else value)}
        ),
    )
    with pytest.raises(FormatError, match=message):
        is_proved(document)


def test_the_elevation_counts():
    """What is proved at one elevation is at higher ones, and here not at lower ones."""
    plant = plant_of()
    law = place(plant, Disk(-3, 2.2), Scheduled(2, 1, "box")).law
    design = analyse(plant, law, HalfPlane(0.5)).design
    scales = scales_of(design)
    largest, claim = gain_claim(design, scales.rows, scales.columns, 0.0)
    assert claim.subject.elevation == 0  # where there is room the short proof is taken
    _, claim = gain_claim(design, scales.rows, scales.columns, 0.99 * largest)
    document = json.loads(design.certificate.file([claim]).dumps())
    own = document["claims"][0]["elevation"]
    assert own > 0
    assert is_proved(document)
    assert is_proved(changed(document, "claims", 0, "elevation", value=own + 1))
    assert not is_proved(changed(document, "claims", 0, "elevation", value=0))


def test_weights_and_tables_are_refused(claims):
    _, _, _, claim = claims["one gain"]
    design = replace(claim.subject.design, weights=(Fraction(1),) * 3)
    with pytest.raises(FormatError, match="weights"):
        prove(replace(claim, subject=replace(claim.subject, design=design)))
    design = claim.subject.design
    several = replace(design, law=replace(design.law, K=[*(design.law.K or [])] * 3))
    with pytest.raises(FormatError, match="tables of gains"):
        prove(replace(claim, subject=replace(claim.subject, design=several)))


def test_a_region_kept_may_be_another(claims):
    """Of as many parts: a wider one is proved by the same evidence, a narrower one is not."""
    document = document_of(claims, "disk")
    for radius, proved in ((2.4, True), (2.2, False)):
        region = {"kind": "disk", "centre": -3, "radius": radius}
        kept = changed(document, "claims", 0, value=lambda t, r=region: t | {"region": r})
        assert is_proved(kept) is proved


@pytest.mark.parametrize("name", [*GIVEN, "slack"])
def test_files_are_checked_afresh(claims, name, tmp_path, capsys):
    document = document_of(claims, name)
    path = tmp_path / "gain.json"
    path.write_text(json.dumps(document))
    claim = only_claim_in(path.read_text())
    assert claim == claims[name][3]
    assert main(["check", str(path)]) == 0
    assert "K off by " in capsys.readouterr().out
    path.write_text(json.dumps(changed(document, "claims", 0, "error", value=lambda v: v * 1.1)))
    assert main(["check", str(path)]) == 1
    path.write_text(json.dumps(changed(document, "claims", 0, "mu", value=[])))
    assert main(["check", str(path)]) == 2


@pytest.mark.parametrize(
    ("rows", "columns", "needed", "message"),
    [
        ([0.0], [1, 1], 0, "rows"),
        ([1, 1], [1, 1], 0, "rows"),
        ([1], [1, np.nan], 0, "columns"),
        ([1], [1, 1, 1], 0, "columns"),
        ([1], np.ones((2, 3)), 0, "columns"),
        ([1], np.zeros((2, 2)), 0, "columns"),
        ([1], [1, 1], -1e-9, "needed"),
        ([1], [1, 1], np.nan, "needed"),
        ([1], [1, 1], np.inf, "needed"),
    ],
)
def test_bad_scales_are_refused(designs, rows, columns, needed, message):
    with pytest.raises(InputError, match=message):
        gain_claim(designs["disk"], rows, columns, needed)


def test_scales_across_a_change_of_coordinates():
    T, c = np.random.default_rng(8).normal(size=(2, 3, 3)), np.array([1.0, 2.0, 3.0])
    assert np.allclose(T[0].T @ Scales(np.ones(1), c).right, (np.diag(c) @ T[0]).T)
    assert np.allclose(T[0].T @ Scales(np.ones(1), T[1]).right, (T[1] @ T[0]).T)


def test_work_is_bounded(claims, monkeypatch):
    design, scales, _, claim = claims["parts"]
    degree = 1 + 2 + claim.subject.elevation  # with those of the evidence, both zero
    assert all(e.degree + e.elevation == 0 for e in claim.subject.design.evidence)
    work = least_work(4 * (degree + 1) ** 2, 2 * (2 * 2 + 1))
    monkeypatch.setattr("polefence.proof.claims.base.MAX_WORK", work)
    assert prove(claim).proved
    monkeypatch.setattr("polefence.proof.claims.base.MAX_WORK", work - 1)
    with pytest.raises(FormatError, match="too many, or too large"):
        prove(claim)
    largest, claim = gain_claim(design, scales.rows, scales.columns, 0.0)
    assert largest > 0
    assert claim is None
