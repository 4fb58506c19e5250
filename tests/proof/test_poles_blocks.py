"""The checker's blocks against the pencil's, and for laws given against the matrices themselves.

Nothing here is feasible: every number is drawn, so that a wrong term shows.
"""

from __future__ import annotations

from fractions import Fraction
from math import factorial, prod

import numpy as np
import pytest

from polefence.lmi.conditions.methods import Scheduled, Slack, build, parameter_dependent
from polefence.lmi.conditions.target import Around
from polefence.plant.polynomial import Domain
from polefence.proof import polynomials
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, Law
from polefence.proof.regions import parts_of
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
)

RANDOM = np.random.default_rng(29)
n, m = 2, 1
ALL = (
    Disk(-3, 2)
    & HalfPlane(1.5)
    & Sector(0.6)
    & VerticalStrip(-4, -1)
    & HorizontalStrip(2.5)
    & Ellipse(-3, 2, 1)
)
# The regions whose inequalities imply X > 0: the checker asks for it all the same.
SHUT = Disk(-3, 2) & Ellipse(-2, 1, 3) & HorizontalStrip(1.5)


def rationals(matrix):
    return [[Fraction(float(e)) for e in row] for row in matrix]


def draw(count, rows, columns, symmetric=False):
    X = RANDOM.normal(size=(count, rows, columns)).round(6)
    return X + X.transpose(0, 2, 1) if symmetric else X


def floats(matrix):
    """An integer matrix in floats; what it is multiplied by does not matter."""
    top = max(abs(e) for row in matrix for e in row) or 1
    return np.array([[float(Fraction(e, top)) for e in row] for row in matrix])


def alike(mine, theirs):
    """Equal up to one positive factor."""
    mine, theirs = (np.asarray(X) / np.linalg.norm(X) for X in (mine, theirs))
    return np.allclose(mine, theirs, rtol=1e-9, atol=1e-11)


def claim(method, A, B, region, law, evidence, on, weights=()):
    parts = parts_of(region.document())
    As, Bs = ([rationals(X) for X in group] for group in (A, B))
    q = tuple(Fraction(float(w)) for w in weights)
    return Poles(method, As, Bs, parts, law, evidence, on, q)


def compared(pencil, values, claimed):
    """All of the pencil's blocks are among the checker's, and those besides are coefficients."""
    theirs = pencil.matrices(pencil.pack(values), 1.0)
    blocks = list(claimed.blocks())
    positive = [b for place, b in blocks if str(place).startswith("of ")]
    others = [b for place, b in blocks if not str(place).startswith("of ")]
    pairs = sum(len(part.pairs) for part in claimed.region)
    asked = [X for name, X in theirs.items() if " at " in name]
    wanted = [X for name, X in theirs.items() if " at " not in name]
    assert len(others) == len(wanted)
    # the pencil goes through its parts at each monomial, the checker the other way round
    in_order = [X for k in range(pairs) for X in wanted[k::pairs]]
    for mine, other in zip(others, in_order, strict=True):
        assert alike(floats(mine), other)
    if asked:
        assert all(alike(floats(a), b) for a, b in zip(positive, asked, strict=True))
    return positive


FORMS = [(1, 0, "simplex"), (1, 2, "box"), (2, 0, "simplex"), (2, 1, "box"), (3, 0, "box")]
CASES = [(ALL, *form) for form in FORMS[1:3]] + [(SHUT, *form) for form in FORMS[::2]]
CASES += [(region, *FORMS[3]) for region in (Disk(-3, 2), HalfPlane(1.5))]


@pytest.mark.parametrize(("region", "degree", "elevation", "on"), CASES)
def test_scheduled(region, degree, elevation, on):
    N = 4 if on == "box" else 3
    count = Domain.of(on, N).count(degree)
    A, B = draw(N, n, n), draw(N, n, m)
    W, Z = draw(count, n, n, symmetric=True), draw(count, m, n)
    pencil = build(Scheduled(degree, elevation, on), A, B, Around(region).target(1.0))
    values = {f"W{k + 1}": W[k] for k in range(count)} | {f"Z{k + 1}": Z[k] for k in range(count)}
    law = Law(None, [rationals(X) for X in W], [rationals(X) for X in Z], degree)
    claimed = claim("scheduled", A, B, region, law, (Evidence([], 0, elevation),), on)
    positive = compared(pencil, values, claimed)
    only_disks = all(part.kind == "disk" for part in region.parts)
    assert len(positive) == (0 if only_disks else Domain.of(on, N).count(degree + 1 + elevation))


@pytest.mark.parametrize("region", [ALL, SHUT], ids=str)
def test_quadratic(region):
    A, B, (W,), (K,) = draw(3, n, n), draw(3, n, m), draw(1, n, n, symmetric=True), draw(1, m, n)
    pencil = build("quadratic", A, B, Around(region).target(1.0))
    law, evidence = Law([rationals(K)]), (Evidence([rationals(W)]),)
    compared(
        pencil, {"W": W, "Z": K @ W}, claim("quadratic", A, B, region, law, evidence, "simplex")
    )


@pytest.mark.parametrize("region", [ALL, SHUT, Disk(-3, 2)], ids=str)
@pytest.mark.parametrize(
    ("degree", "elevation", "on"),
    [(0, 0, "simplex"), (0, 1, "box"), (1, 0, "box"), (1, 1, "simplex"), (2, 0, "box")],
)
def test_slack(degree, elevation, on, region):
    N = 4 if on == "box" else 3
    count, epsilon = Domain.of(on, N).count(degree), 0.375
    A, B, P = draw(N, n, n), draw(N, n, m), draw(count, n, n, symmetric=True)
    (G,), (K,) = draw(1, n, n), draw(1, m, n)
    pencil = build(Slack(degree, elevation, on, epsilon), A, B, Around(region).target(1.0))
    values = {f"P{k + 1}": P[k] for k in range(count)} | {"G": G, "L": K @ G}
    evidence = Evidence(
        [rationals(X) for X in P], degree, elevation, G=rationals(G), epsilon=Fraction(epsilon)
    )
    law = Law([rationals(K)])
    compared(pencil, values, claim("slack", A, B, region, law, (evidence,), on))


@pytest.mark.parametrize("on", ["simplex", "box"])
def test_a_given_gain_is_analysis_of_its_closed_loop(on):
    """'lyapunov' with one K: the pencil without inputs, W of any degree, at A + B K."""
    N = 4 if on == "box" else 3
    domain = Domain.of(on, N)
    A, B, (K,) = draw(N, n, n), draw(N, n, m), draw(1, m, n)
    forms = [(0, 0), (1, 1), (2, 0), (1, 0), (0, 2), (2, 1)]  # one a part of the region
    evidence, Xs = [], []
    for degree, elevation in forms:
        Xs.append(draw(domain.count(degree), n, n, symmetric=True))
        evidence.append(Evidence([rationals(X) for X in Xs[-1]], degree, elevation))
    law = Law([rationals(K)])
    claimed = claim("lyapunov", A, B, ALL, law, tuple(evidence), on)
    blocks = list(claimed.blocks())
    for part, (degree, elevation), X in zip(ALL.parts, forms, Xs, strict=True):
        target = Around(part).target(1.0)
        pencil = parameter_dependent(A + B @ K, None, target, domain, degree, elevation)
        names = [f"W{k + 1}" for k in range(len(X))] if degree else ["W"]
        theirs = pencil.matrices(pencil.pack(dict(zip(names, X, strict=True))), 1.0)
        count = domain.count(degree + 1 + elevation)
        pairs = len(parts_of(part.document())[0].pairs)
        positive = 0 if part.kind == "disk" else count
        own, blocks = blocks[: positive + pairs * count], blocks[positive + pairs * count :]
        wanted = [X for name, X in theirs.items() if " at " not in name]
        in_order = [X for k in range(pairs) for X in wanted[k::pairs]]
        for (_, mine), other in zip(own[positive:], in_order, strict=True):
            assert alike(floats(mine), other)
    assert not blocks


# --- against the matrices themselves -------------------------------------------------------------


def polynomial(domain, degree, matrices, c):
    total = 0.0
    for e, X in zip(domain.monomials(degree), matrices, strict=True):
        weight, start = np.prod(c ** np.array(e)), 0
        for size in domain.sizes:
            weight *= factorial(degree) / prod(factorial(p) for p in e[start : start + size])
            start += size
        total = total + weight * X
    return total


def against_matrices(claimed, domain, expected):
    """Blocks times monomials are, up to one positive factor a part, what is expected at alpha.

    ``expected(number, c, alpha)`` is N and X of one part's evidence.
    """
    blocks = list(claimed.blocks())
    for number, (part, evidence) in enumerate(zip(claimed.region, claimed.evidence, strict=True)):
        exponents = np.array(polynomials.monomials(domain.sizes, claimed.degree(evidence)))
        pairs = part.pairs
        positive = [] if part.kind == "disk" else [None]
        for pair in (*positive, *pairs):
            own, blocks = blocks[: len(exponents)], blocks[len(exponents) :]
            top = max(abs(e) for _, matrix in own for row in matrix for e in row)
            own = [
                np.array([[float(Fraction(e, top)) for e in row] for row in matrix])
                for _, matrix in own
            ]
            factors = []
            for _ in range(4):
                c = np.hstack([RANDOM.dirichlet(np.ones(size)) for size in domain.sizes])
                powers = np.prod(c**exponents, axis=1)
                mine = sum(p * matrix for p, matrix in zip(powers, own, strict=True))
                X, N = expected(number, c, domain.alpha(c))
                theirs = X
                if pair is not None:
                    L, M = (np.array(each, dtype=float) for each in pair)
                    theirs = -(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T))
                assert alike(mine, theirs)
                factors.append(np.linalg.norm(mine) / np.linalg.norm(theirs))
            assert np.allclose(factors, factors[0])
    assert not blocks


def mixed(c, weights, matrices):
    return np.tensordot(weights, matrices, 1)


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize("weighted", [False, True])
def test_gains_at_the_corners_and_a_common_denominator(on, weighted):
    """K multi-affine between its corners, and A / q, B / q with q multi-affine too."""
    N = 4 if on == "box" else 3
    domain = Domain.of(on, N)
    A, B, K = draw(N, n, n), draw(N, n, m), draw(N, m, n)
    q = RANDOM.uniform(0.5, 2, N).round(6)
    forms = [(0, 0), (1, 1), (2, 0), (1, 0), (0, 1), (1, 0)]
    Xs = [draw(domain.count(degree), n, n, symmetric=True) for degree, _ in forms]
    evidence = tuple(
        Evidence([rationals(x) for x in X], *form) for X, form in zip(Xs, forms, strict=True)
    )
    law = Law([rationals(k) for k in K])
    weights = q if weighted else ()
    claimed = claim("lyapunov", A, B, ALL, law, evidence, on, weights)

    def expected(number, c, alpha):
        closed = mixed(c, alpha, A) + mixed(c, alpha, B) @ mixed(c, alpha, K)
        X = polynomial(domain, forms[number][0], Xs[number], c)
        return X * (alpha @ q if weighted else 1.0), closed @ X

    against_matrices(claimed, domain, expected)


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize("weighted", [False, True])
def test_one_gain(on, weighted):
    N = 4 if on == "box" else 3
    domain = Domain.of(on, N)
    A, B, (K,) = draw(N, n, n), draw(N, n, m), draw(1, m, n)
    q = RANDOM.uniform(0.5, 2, N).round(6)
    forms = [(2, 0), (0, 0), (1, 1)]
    region = HalfPlane(1.5) & Disk(-3, 2) & VerticalStrip(-4, -1)
    Xs = [draw(domain.count(degree), n, n, symmetric=True) for degree, _ in forms]
    evidence = tuple(
        Evidence([rationals(x) for x in X], *form) for X, form in zip(Xs, forms, strict=True)
    )
    weights = q if weighted else ()
    claimed = claim("lyapunov", A, B, region, Law([rationals(K)]), evidence, on, weights)

    def expected(number, c, alpha):
        X = polynomial(domain, forms[number][0], Xs[number], c)
        closed = mixed(c, alpha, A) + mixed(c, alpha, B) @ K
        return X * (alpha @ q if weighted else 1.0), closed @ X

    against_matrices(claimed, domain, expected)


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("multiple", [False, True])
def test_a_scheduled_law_given(on, degree, multiple):
    """X = W (s I + Q W) and N = (A W + B Z) (s I + Q W), polynomials both."""
    N = 4 if on == "box" else 3
    domain = Domain.of(on, N)
    A, B = draw(N, n, n), draw(N, n, m)
    W = draw(domain.count(degree), n, n, symmetric=True)
    Z = draw(domain.count(degree), m, n)
    forms = [(0, 0), (1, 0), (0, 1)]
    region = Sector(0.6) & Disk(-3, 2) & VerticalStrip(-4, -1)
    Qs = [draw(domain.count(g), n, n, symmetric=True) for g, _ in forms]
    s = [RANDOM.normal(size=domain.count(g)).round(6) for g, _ in forms]
    evidence = tuple(
        Evidence(
            [rationals(q) for q in Q],
            *form,
            tuple(Fraction(float(v)) for v in own) if multiple else (),
        )
        for Q, own, form in zip(Qs, s, forms, strict=True)
    )
    law = Law(None, [rationals(X) for X in W], [rationals(X) for X in Z], degree)
    claimed = claim("lyapunov", A, B, region, law, evidence, on)

    def expected(number, c, alpha):
        W_, Z_ = polynomial(domain, degree, W, c), polynomial(domain, degree, Z, c)
        g = forms[number][0]
        V = polynomial(domain, g, Qs[number], c) @ W_
        if multiple:
            V = V + polynomial(domain, g, s[number], c) * np.eye(n)
        return W_ @ V, (mixed(c, alpha, A) @ W_ + mixed(c, alpha, B) @ Z_) @ V

    against_matrices(claimed, domain, expected)
