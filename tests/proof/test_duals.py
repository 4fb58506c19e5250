"""Dual claims: matrices against numpy's, thresholds from both sides, one fault at a time; cells."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product
from math import prod

import numpy as np
import pytest

from polefence import Rms as RmsLimit
from polefence.certify.bounds import best_bound
from polefence.law.laws import given_law
from polefence.plant.spec import loads as loads_spec
from polefence.proof.claims import InitialPeak, Rms, prove
from polefence.proof.document import check, loads
from polefence.proof.laws import Evidence, Law, Piece
from polefence.proof.polynomials import bernstein
from polefence.proof.work import FormatError
from support.duals import FORMS, KINDS, Case, rationals

ABOVE = 0.1  # by which the least level of this evidence may exceed the worst sample
ALL = list(product(KINDS, FORMS))
ZERO, HALF, ONE = Fraction(0), Fraction(1, 2), Fraction(1)


def at(inequality, coordinates):
    """An inequality's matrix at a point, over its first entry; from its coefficients."""
    total = 0
    for place, matrix in inequality.blocks():
        total = total + np.prod(np.power(coordinates, place.powers)) * np.array(matrix, dtype=float)
    return total / total[0, 0]


@pytest.mark.parametrize(("kind", "form"), ALL)
def test_thresholds_from_both_sides_and_files(kind, form):
    """Proved a little above what samples show, and not below; the same once written and read."""
    case = Case(kind, form)
    document = case.document(case.worst * (1 + ABOVE))
    read = loads(document.dumps())
    assert read.claims == document.claims
    assert read.law == document.law
    for own in (document, read):
        assert check(own).proved
    assert loads(read.dumps()) == read
    assert not prove(
        case.claim(case.worst * (1 - 1e-9), document.claims[0].subject.evidence)
    ).proved


@pytest.mark.parametrize(("kind", "form"), ALL)
def test_the_least_square_is_where_a_proof_begins(kind, form):
    """Of what depends on the level in the noise alone: proved just above, and not at it."""
    case = Case(kind, form)
    claim = case.claim(case.worst * (1 + ABOVE))
    assert prove(claim).proved
    square = claim.least_square
    assert (square is None) == (kind == "gain")
    if square is not None:
        level = Fraction(float(square) ** 0.5)
        assert prove(replace(claim, level=level * (1 + Fraction(1, 10**12)))).proved
        assert not prove(replace(claim, level=level * (1 - Fraction(1, 10**12)))).proved
        assert prove(replace(claim, level=level * 9)).proved


@pytest.mark.parametrize("through", [False, True])
@pytest.mark.parametrize(("kind", "form"), ALL)
def test_the_coefficients_are_those_of_the_inequalities(kind, form, through):
    """At a point, from numpy's own W, Q, A + B K; whatever Q is."""
    case, random = Case(kind, form, 3, 1, through), np.random.default_rng(1)
    half = random.normal(size=(case.domain.count(case.degree), 2, 2))
    Qs = half + half.swapaxes(1, 2)
    evidence = Evidence([rationals(Q) for Q in Qs], case.degree, 1, dual=True)
    level = 7 / 3
    found = {own.name: own for own in case.claim(level, evidence).inequalities()}
    sizes = case.domain.sizes
    own = np.concatenate([random.dirichlet(np.ones(size)) for size in sizes])
    alpha = case.domain.alpha(own)
    A, Y, E, F = case.loop(alpha)
    Q, W = np.tensordot(case.domain.basis(alpha, case.degree), Qs, 1), np.eye(2)
    if case.form == "scheduled":
        W = np.tensordot(case.domain.basis(alpha, 1), np.array(case.law.W, dtype=float), 1)
    expected = {"of Q at vertex 1": Qs[0]}
    both = Q @ A + A.T @ Q
    if kind != "gain":
        expected["of the output"] = -W @ (both + Y.T @ Y) @ W
        expected["of the noise"] = np.array([[1.0]])
        values = [
            sum(np.prod(np.power(own, place.powers)) * matrix[0][0] for place, matrix in each)
            for each in ([*found["of the noise"].blocks()],)
        ]
        assert np.sign(values[0]) == np.sign(level**2 - np.trace(E.T @ Q @ E))
    elif np.any(F):
        side = np.hstack([-W @ Q @ E, -W @ Y.T])
        corner = np.block([[level * np.eye(2), -F.T], [-F, level * np.eye(len(F))]])
        expected["of the gain"] = np.block([[-W @ both @ W, side], [side.T, corner]])
    else:
        expected["of the gain"] = -W @ (both + (Q @ E @ E.T @ Q + Y.T @ Y) / level) @ W
    assert set(found) == set(expected)
    for name, matrix in expected.items():
        np.testing.assert_allclose(at(found[name], own), matrix / matrix[0, 0], atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_an_unstable_loop_has_a_negative_q(kind):
    """-Q of the loop that runs backwards keeps every inequality but the sign at a vertex."""
    case = Case(kind, ("fixed", 0))
    claim = case.claim(100.0)
    subject, F = claim.subject, Fraction
    K = np.array(subject.law.K[0], dtype=float)
    A = [
        rationals(-(np.array(A, dtype=float) + np.array(B, dtype=float) @ K))
        for A, B in zip(subject.A, subject.B, strict=True)
    ]
    C = [[[F(1), F(0)]]] * 3
    outputs = (replace(claim.outputs[0], C=C, D=[[[F(0)]]] * 3),)
    found = []
    for sign in (1, -1):
        own = [rationals(sign * np.array(A, dtype=float)) for A in A]
        Q = Evidence([rationals(-sign * 10 * np.eye(2))], dual=True)
        still = replace(subject, A=own, law=Law([rationals(np.zeros((1, 2)))]), evidence=Q)
        found.append(prove(replace(claim, subject=still, outputs=outputs, level=F(10**6))))
    backwards, forwards = found
    assert not backwards.proved
    assert "of Q at vertex 1" in str(backwards.place)
    assert forwards.proved == (
        np.linalg.eigvalsh([np.array(a, dtype=float) + np.array(a, dtype=float).T for a in A]).min()
        > 0
    )


def test_what_has_no_dual_form_is_refused():
    case = Case("rms", ("fixed", 2))
    claim = case.claim(10.0)
    evidence = claim.subject.evidence
    peak = InitialPeak(claim.subject, claim.outputs[:1], Fraction(10), ((ONE, ZERO),), ())
    with pytest.raises(FormatError, match="no dual form"):
        prove(peak)
    several = replace(evidence, multiple=(ONE,) * len(evidence.X))
    for bad in (several, replace(evidence, X=evidence.X[:-1]), replace(evidence, X=[])):
        with pytest.raises(FormatError):
            prove(replace(claim, subject=replace(claim.subject, evidence=bad)))
    poles = replace(claim.subject.as_poles, evidence=(evidence,))
    with pytest.raises(FormatError, match="no dual form"):
        prove(poles)


def turned(speed):
    """A loop that turns and grows, and a Q that is not symmetric: Q A + A'Q' < 0 all the same."""
    F = Fraction
    A = [[[F(1), F(speed)], [F(-speed), F(1)]]] * 2
    Q = [[F(2), F(1)], [F(-1), F(2)]]
    return A, Q


@pytest.mark.parametrize("cells", [False, True])
def test_a_q_that_is_not_symmetric_proves_nothing(cells):
    case = Case("rms", ("fixed", 0))
    A, Q = turned(10)
    own = Evidence([Q], dual=True)
    if cells:
        pairs = ((ZERO, HALF), (HALF, ONE))
        own = Evidence([], dual=True, cells=tuple(Piece((a,), (b,), own) for a, b in pairs))
    claim = case.claim(10.0)
    small, none = [rationals(np.eye(2) / 100)] * 2, [rationals(np.zeros((2, 1)))] * 2
    subject = replace(claim.subject, A=A, B=none, E=small, evidence=own)
    outputs = (replace(claim.outputs[0], C=[[[ONE, ZERO]]] * 2, D=[[[ZERO]]] * 2),)
    whole = Rms(subject, outputs, Fraction(10))
    assert all(np.linalg.eigvalsh(np.array(M, dtype=float)).min() > 0 for _, M in whole.blocks())
    answer = prove(whole)
    assert not answer.proved
    assert "is not symmetric" in answer.reason


# --- cells ---------------------------------------------------------------------------------------


def halves(case, claim):
    """Evidence for the lower and the upper half of the one parameter, each found for itself."""
    pieces = []
    for low, high in ((0.0, 0.5), (0.5, 1.0)):
        own = Case(case.kind, (case.form, 1))
        inner = case.domain.coordinates

        def loop(alpha, low=low, high=high, inner=inner):
            t = low + (high - low) * inner(alpha)[1]
            return case.loop(np.array([1 - t, t]))

        own.loop = loop
        own.worst = case.worst
        evidence = own.evidence()
        pieces.append(Piece((Fraction(low),), (Fraction(high),), evidence))
    return replace(
        claim, subject=replace(claim.subject, evidence=Evidence([], dual=True, cells=tuple(pieces)))
    )


@pytest.mark.parametrize("kind", KINDS)
def test_cells_are_proved_each_with_its_own(kind):
    case = Case(kind, ("polynomial", 1))
    level = case.worst * (1 + ABOVE)
    claim = halves(case, case.claim(level))
    assert prove(claim).proved
    assert not prove(replace(claim, level=Fraction(case.worst * (1 - 1e-9)))).proved
    document = replace(case.document(level), claims=(claim,))
    read = loads(document.dumps())
    assert read == document
    assert check(read).proved
    one, two = claim.subject.evidence.cells

    def of(*cells):
        return replace(
            claim, subject=replace(claim.subject, evidence=Evidence([], dual=True, cells=cells))
        )

    assert "do not fill" in prove(of(one)).reason
    assert "do not fill" in prove(of(one, replace(two, low=(Fraction(501, 1000),)))).reason
    assert "overlap" in prove(of(one, one)).reason
    assert "overlap" in prove(of(one, replace(two, low=(Fraction(499, 1000),)))).reason
    for bad in (replace(two, high=(Fraction(2),)), replace(two, low=two.high)):
        with pytest.raises(FormatError, match="empty, or not within"):
            prove(of(one, bad))
    with pytest.raises(FormatError):
        prove(of(one, replace(two, low=(HALF, HALF), high=(ONE, ONE))))


def test_a_law_in_a_cell_is_the_same_law():
    case, random = Case("rms", ("measured", 2)), np.random.default_rng(2)
    low, high = (Fraction(1, 3), Fraction(0)), (Fraction(3, 4), Fraction(1, 5))
    inside = case.law.inside(low, high)
    for _ in range(5):
        t = [Fraction(int(x), 97) for x in random.integers(0, 98, 2)]
        whole = [a + (b - a) * x for a, b, x in zip(low, high, t, strict=True)]
        gains = []
        for law, point in ((inside, t), (case.law, whole)):
            at_ = [w for x in point for w in (1 - x, x)]
            alpha = [a * b for a in at_[:2] for b in at_[2:]]
            gains.append(law.gain(alpha, at_))
        assert gains[0] == gains[1]


# --- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t["claims"][0]["evidence"].pop("Q"), "evidence.X is missing"),
        (lambda t: t["claims"][0]["evidence"].update(X=[[[1, 0], [0, 1]]]), "unknown key"),
        (lambda t: t["claims"][0]["evidence"].update(degree=3), "its degree needs"),
        (lambda t: t["claims"][0]["evidence"].update(own=True), "must be true, and the law"),
        (lambda t: t["claims"][0]["evidence"].update(cells=[]), "list of 1 to"),
        (lambda t: t["claims"][0]["evidence"]["Q"].pop(), "its degree needs"),
        (lambda t: t["claims"][0].update(level=-1), "level must be zero or more"),
    ],
)
def test_a_fault_in_a_file_is_named(change, words):
    case = Case("rms", ("measured", 2))
    table = json.loads(case.document(10.0).dumps())
    change(table)
    with pytest.raises(FormatError, match=words):
        check(loads(json.dumps(table)))


DRIVEN = """
disturbances = ["v", "w"]
[parameter.p]
range = [0.5, 2]
[matrices]
A = [[0, 1], ["-4 - 0.1*sqrt(p)", -1]]
B = [[0], [1]]
E = [[0, 0], [1, "0.3*sqrt((p - 1)**2 + 1e-3)"]]
"""


def test_a_column_that_is_a_function_costs_what_its_remainder_may_add():
    """Of (e + h)' Q (e + h), |h| <= d: at most (1 + s) e'Qe + (1 + 1/s) kappa d^2, of any s > 0."""
    plant = loads_spec(DRIVEN)
    found = best_bound(plant, given_law(plant, np.zeros((1, 2))), RmsLimit(("x1",)))
    alpha, s = (Fraction(1, 3), Fraction(2, 3)), Fraction(1, 4096)
    for piece in found.claim.subject.evidence.cells:
        claim = found.claim.inside(piece)
        own, sizes = claim.subject.evidence, claim.subject.sizes
        Q = value(bernstein(own.X, sizes, own.degree), alpha)
        E = value(claim.subject.driving((), sizes), alpha)
        total = Fraction(0)
        for e, d in zip(zip(*E, strict=True), claim.subject.off(()), strict=True):
            moved = sum(e[i] * Q[i][k] * e[k] for i in range(2) for k in range(2))
            total += (1 + s) * moved + (1 + 1 / s) * own.spread.kappa * d**2 if d else moved
        rows = {row.name: row.rows for row in claim.inequalities()}
        (((left,),),) = (value(rows["of the noise"][0][0], alpha),)
        assert left == claim.level**2 - claim.intensity * total
    assert any(claim.subject.off(()))


def value(P, alpha):
    """A polynomial's matrix at a point."""
    rows, columns = P.shape
    total = [[Fraction(0)] * columns for _ in range(rows)]
    for powers, M in P.terms.items():
        weight = prod((a**k for a, k in zip(alpha, powers, strict=True)), start=Fraction(1))
        for i, k in product(range(rows), range(columns)):
            total[i][k] += weight * M[i][k] / P.whole
    return total
