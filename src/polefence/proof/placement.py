"""Claims that all poles lie in a region, and their inequalities, from a design file.

A file gives the plant's vertices, the region, the law and the certificate. Every linear matrix
inequality of the theorem named is built again and tested for positive definiteness. Numbers in the
file are doubles, hence rationals; "p/q" is exact. Integers and the standard library only.

What is proved: all eigenvalues of A(alpha) + B(alpha) K(alpha) lie in the region, for every alpha
of the simplex; or, where the file says "box", for every product alpha of points of the
parameters' own intervals. A region is an intersection of parts { z : L + M z + M' conj(z) < 0 }.
With X(alpha) > 0 and N(alpha) = (A + B K) X, both polynomials, it is enough (Chilali-Gahinet) that

    F(alpha) = -( L (x) X(alpha) + M (x) N(alpha) + M' (x) N(alpha)' ) > 0     for every part,

and for that, that every coefficient of F(alpha) (sum of alpha)^d is > 0 (Polya). The methods are

    quadratic   X constant, K constant
    scheduled   X = W(alpha), K = Z(alpha) W(alpha)^-1, of any degree; at degree 1 and d = 1 and
                for a disk this is Leite & Peres (2005), (15)-(17), there with tau times a form
                that is nonnegative on the simplex
    lyapunov    K given, constant or scheduled, and X for each part: a polynomial, for a scheduled
                law W (multiple + X W), so that N is a polynomial too
    slack       K constant, P(alpha) and one G (not symmetric): for the disk |z + sigma| < r
                [ r P, M ; M', r (G + G' - P) ] > 0 with M = (A + B K + sigma I) G; for other parts
                F + [ e ] bordered, see `_bordered`
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.proof.definite import is_positive_definite, least_work
from polefence.proof.matrices import (
    LONGEST,
    MAX_BITS,
    Integers,
    Rationals,
    _denominator,
    _integers,
    _is_symmetric,
    _matrix_product,
    _times,
    _transposed,
    bits,
    mix,
    right_divide,
)
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Exponent,
    Polynomial,
    _basis,
    _bernstein,
    _coordinates,
    _elevated,
    _longest,
    _multiple,
    _number,
    _plus,
    _product,
    _starts,
    _weighted,
    monomials,
)
from polefence.proof.reading import (
    MAX_VERTICES,
    _at,
    _integer,
    _list,
    _matrix,
    _only,
    _several,
    _shape,
    _shown,
    parse,
    read_matrix,
    read_number,
)
from polefence.proof.regions import KINDS, MAX_PARTS, Part, _characteristic_pairs, require_region
from polefence.proof.roots import all_inside
from polefence.proof.work import MAX_WORK, FormatError, counted, spend

FORMAT, VERSION = "polefence-design", 1
METHODS = ("quadratic", "slack", "scheduled", "lyapunov")


@dataclass(frozen=True)
class Law:
    """K constant (``K`` alone); one K a corner, multi-affine between; or Z(alpha) W(alpha)^-1.

    Coefficients of W and Z are those of Bernstein polynomials: of ``degree`` in each simplex, in
    the order of `monomials`.
    """

    K: list[Rationals] | None = None
    W: list[Rationals] | None = None
    Z: list[Rationals] | None = None
    degree: int = 0


@dataclass(frozen=True)
class Evidence:
    """What one part of the region (all of them but for "lyapunov") is proved with.

    ``X`` the Lyapunov polynomial's Bernstein coefficients (none where it is the law's own W),
    ``degree`` its degree, ``elevation`` the d of (sum of alpha)^d; ``multiple`` (as many as X) for
    scheduled laws given; ``G`` and ``epsilon`` for slack; ``tau`` for right-hand sides.
    """

    X: list[Rationals]
    degree: int = 0
    elevation: int = 0
    multiple: tuple[Fraction, ...] = ()
    G: Rationals | None = None
    epsilon: Fraction = Fraction(0)
    tau: Fraction = Fraction(0)


@dataclass(frozen=True)
class Claim:
    """All poles of every plant of the family lie in the region, by this law and evidence.

    ``on`` is "simplex" or "box". With ``weights`` the plant is A(alpha) / q(alpha), B(alpha) /
    q(alpha), q > 0 multi-affine with these values at the corners.
    """

    method: str
    A: list[Rationals]
    B: list[Rationals]
    region: tuple[Part, ...]
    law: Law
    evidence: tuple[Evidence, ...]
    on: str = "simplex"
    weights: tuple[Fraction, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """Whether the claim is proved; ``reason`` names the inequality that fails, or counts them."""

    proved: bool
    reason: str


def prove(claim: Claim) -> Verdict:
    """Decide whether the certificate proves the claim. False says nothing about the poles.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    _require_consistent(claim)
    with counted():
        return _proved(claim)


def _proved(claim: Claim) -> Verdict:
    for evidence in claim.evidence:
        if evidence.tau < 0:
            return Verdict(False, "tau is negative")
        for k, X in enumerate(evidence.X or claim.law.W or []):
            if not _is_symmetric(X):
                return Verdict(False, f"Lyapunov matrix {k + 1} is not symmetric")
    for k, W in enumerate(claim.law.W or []):
        if not _is_symmetric(W):
            return Verdict(False, f"W {k + 1} is not symmetric")
    if any(q <= 0 for q in claim.weights):
        return Verdict(False, "a weight is not positive")
    count = 0
    for name, matrix in blocks(claim):
        if not is_positive_definite(matrix):
            return Verdict(False, f"inequality {name} is not positive definite")
        count += 1
    return Verdict(True, f"{count} inequalities positive definite in exact arithmetic")


def _require_consistent(claim: Claim) -> None:
    N, law, evidence = len(claim.A), claim.law, claim.evidence
    if claim.method not in METHODS:
        raise FormatError(f"method {claim.method!r} is not one of {', '.join(METHODS)}")
    if not claim.A or len(claim.B) != N or not claim.region:
        raise FormatError("vertices or the region are missing")
    require_region(claim.region)
    if claim.on not in ("simplex", "box") or (claim.on == "box" and N & (N - 1)):
        raise FormatError(f"{N} vertices do not make a {claim.on}")
    scheduled = law.W is not None and law.Z is not None and law.K is None
    fixed = law.K is not None and law.W is None and law.Z is None
    kinds = {"scheduled": scheduled, "lyapunov": scheduled or fixed}
    wanted = len(claim.region) if claim.method == "lyapunov" else 1
    if not kinds.get(claim.method, fixed) or len(evidence) != wanted:
        raise FormatError(f"law and evidence do not belong to method {claim.method!r}")
    if any((e.G is not None) != (claim.method == "slack") for e in evidence):
        raise FormatError(f"G does not belong to method {claim.method!r}")
    if claim.weights and (len(claim.weights) != N or claim.method != "lyapunov" or scheduled):
        raise FormatError("weights do not belong here")
    if fixed and len(law.K or []) not in ((1, N) if claim.method == "lyapunov" else (1,)):
        raise FormatError("a fixed law has one K")
    sizes = simplices(claim)
    counts = [(law.degree, len(law.W or [])), (law.degree, len(law.Z or []))] if scheduled else []
    counts += [(e.degree, len(e.X)) for e in evidence if claim.method != "scheduled"]
    counts += [(e.degree, len(e.multiple)) for e in evidence if e.multiple]
    degrees = [law.degree, *(d for e in evidence for d in (e.degree, e.elevation))]
    if any(not 0 <= degree <= MAX_DEGREE for degree in degrees):
        raise FormatError(f"degrees must be 0 to {MAX_DEGREE}")
    if any(count != _number(sizes, degree) for degree, count in counts):
        raise FormatError("matrices are missing: one W, Z, P or X a coefficient")
    if claim.method == "quadratic" and evidence[0].degree:
        raise FormatError("one Lyapunov matrix is what the method quadratic has")
    if claim.method == "scheduled" and (evidence[0].X or evidence[0].multiple):
        raise FormatError("the method scheduled has no Lyapunov matrices but W")
    if any(e.multiple and not (scheduled and claim.method == "lyapunov") for e in evidence):
        raise FormatError("multiples belong to scheduled laws given")
    if any(e.tau for e in evidence) and not _is_theorem_1(claim):
        raise FormatError("tau belongs to the right-hand sides of Theorem 1")
    if least(claim) > MAX_WORK:
        count = _count(claim)
        raise FormatError(f"{count} inequalities of this size are more than is checked here")


def least(claim: Claim) -> int:
    """Return the least that a claim takes to prove, whatever its numbers."""
    sides = 2 * len(claim.A[0]) * (2 if claim.method == "slack" else 1)
    return least_work(_count(claim) * len(claim.region), sides)


def _count(claim: Claim) -> int:
    sizes = simplices(claim)
    return sum(_number(sizes, _degree(claim, each)) for each in claim.evidence)


def _is_theorem_1(claim: Claim) -> bool:
    return (
        claim.method == "scheduled"
        and (claim.law.degree, claim.evidence[0].elevation, claim.on) == (1, 1, "simplex")
        and [part.kind for part in claim.region] == ["disk"]
    )


def _degree(claim: Claim, evidence: Evidence) -> int:
    """Return the degree of the inequalities' polynomials in each simplex."""
    law = claim.law
    if claim.method == "scheduled":
        natural = law.degree + 1
    elif claim.method == "slack":
        natural = max(evidence.degree, 1)
    elif law.W is not None:
        natural = evidence.degree + 2 * law.degree + 1
    else:
        natural = evidence.degree + 1 + (len(law.K or []) > 1)
    return natural + evidence.elevation


def simplices(claim: Claim) -> tuple[int, ...]:
    """Return the number of corners of each simplex: one with all vertices, or two a parameter."""
    N = len(claim.A)
    return (N,) if claim.on == "simplex" or N == 1 else (2,) * (N.bit_length() - 1)


def blocks(claim: Claim) -> Iterator[tuple[str, Integers]]:
    """Yield each inequality's name and its matrix, times a positive integer."""
    sizes = simplices(claim)
    plant = _plant(claim)
    for number, evidence in enumerate(claim.evidence):
        mine = claim.region if claim.method != "lyapunov" else claim.region[number : number + 1]
        if claim.method == "slack":
            yield from _slack(claim, plant, sizes, mine)
            continue
        X, N = _loop(claim, plant, sizes, evidence)
        X, N = (_elevated(P, sizes, evidence.elevation) for P in (X, N))
        order = monomials(sizes, _degree(claim, evidence))
        if any(part.kind != "disk" for part in mine):
            for e in order:
                yield f"of X at {_name(e, sizes, claim)}", X[e]
        for part in mine:
            for L, M in _characteristic_pairs(part):
                L_, M_, _ = _integral(L, M, plant.denominator)
                for e in order:
                    F = _block(L_, M_, X[e], N[e])
                    if evidence.tau:
                        F = _floored(F, e, evidence.tau, claim, plant)
                    yield _name(e, sizes, claim, part), F


@dataclass(frozen=True)
class _Plant:
    """[A, B] (and the weights) as polynomials of degree 1, over one denominator."""

    AB: Polynomial
    weights: Polynomial
    denominator: int
    law: int


def _plant(claim: Claim) -> _Plant:
    weights = [[[q]] for q in claim.weights]
    common = _denominator([*claim.A, *claim.B, *weights])
    corners = monomials(simplices(claim), 1)
    both = [
        [a + b for a, b in zip(_integers(A, common), _integers(B, common), strict=True)]
        for A, B in zip(claim.A, claim.B, strict=True)
    ]
    q = [_integers(w, common) for w in weights]
    law = claim.law
    matrices = [*(law.K or []), *(law.W or []), *(law.Z or [])]
    return _Plant(
        dict(zip(corners, both, strict=True)),
        dict(zip(corners, q, strict=True)) if q else {},
        common,
        _denominator(matrices, 2 * MAX_BITS),
    )


def _loop(
    claim: Claim, plant: _Plant, sizes: tuple[int, ...], evidence: Evidence
) -> tuple[Polynomial, Polynomial]:
    """Return X and N, of one degree, times a positive integer; N times ``denominator`` too."""
    law, D = claim.law, plant.law
    if claim.method == "scheduled":
        W, WZ = _fraction(law, sizes, D)
        return _elevated(W, sizes, 1), _product(plant.AB, WZ)
    own = _denominator([*evidence.X, [list(evidence.multiple)]], 2 * MAX_BITS)
    Q = _bernstein([_integers(x, own) for x in evidence.X], sizes, evidence.degree)
    if law.K is not None:
        n, degree = len(claim.A[0]), int(len(law.K) > 1)
        K = [_integers(k, D) for k in law.K]
        eye = [[D * (i == j) for j in range(n)] for i in range(n)]
        closed = _product(plant.AB, _bernstein([eye + k for k in K], sizes, degree))
        N = _product(closed, Q)
        X = _multiple(D, _elevated(Q, sizes, degree))
        if plant.weights:
            # both times the plant's denominator, which the weights have too
            return _weighted(plant.weights, X), _multiple(plant.denominator, N)
        return _elevated(X, sizes, 1), N
    # X = W V, N = (A W + B Z) V
    W, WZ = _fraction(law, sizes, D)
    V = _multiplier(W, Q, evidence, sizes, (law.degree, D, own))
    return _elevated(_product(W, V), sizes, 1), _product(_product(plant.AB, WZ), V)


def _multiplier(
    W: Polynomial,
    Q: Polynomial,
    evidence: Evidence,
    sizes: tuple[int, ...],
    units: tuple[int, int, int],
) -> Polynomial:
    """Return V = multiple + Q W of a scheduled law given, times the denominators of both.

    The units are W's degree, and the denominators of W and of the evidence.
    """
    V, (degree, D, own) = _product(Q, W), units
    if not evidence.multiple:
        return V
    n = range(len(evidence.X[0]))
    scalars = [[[int(s * own) * D * (i == j) for j in n] for i in n] for s in evidence.multiple]
    multiple = _bernstein(scalars, sizes, evidence.degree)
    return _plus(V, _elevated(multiple, sizes, degree))


def _fraction(law: Law, sizes: tuple[int, ...], D: int) -> tuple[Polynomial, Polynomial]:
    """Return W and [W; Z] of a scheduled law, times D."""
    W = [_integers(w, D) for w in law.W or []]
    both = [w + _integers(z, D) for w, z in zip(W, law.Z or [], strict=True)]
    return _bernstein(W, sizes, law.degree), _bernstein(both, sizes, law.degree)


def _integral(L: Rationals, M: Rationals, denominator: int) -> tuple[Integers, Integers, int]:
    """Return L times ``denominator`` and M, both times the positive integer that comes third."""
    common = _denominator([L, M])
    return _times(denominator, _integers(L, common)), _integers(M, common), common


def _block(L: Integers, M: Integers, X: Integers, N: Integers) -> Integers:
    """Return -(L (x) X + M (x) N + M' (x) N')."""
    T = _transposed(N)
    rows: Integers = []
    spend(3 * (len(L) * len(X)) ** 2, max(bits(L), bits(M)), max(bits(X), bits(N)))
    for a in range(len(L)):
        for i in range(len(X)):
            row: list[int] = []
            for b in range(len(L)):
                p, q, r = L[a][b], M[a][b], M[b][a]
                row += [-(p * x + q * y + r * z) for x, y, z in zip(X[i], N[i], T[i], strict=True)]
            rows.append(row)
    return rows


def _floored(F: Integers, e: Exponent, tau: Fraction, claim: Claim, plant: _Plant) -> Integers:
    """Take tau I from (15); give tau I / (N-1)^2 to (16) and 6 tau I / (N-1)^2 to (17).

    In the first block, and together tau times
    sum a_j^3 - (sum a_j^2 a_k + 6 sum a_j a_k a_l) / (N-1)^2 >= 0.
    """
    square = max(len(e) - 1, 1) ** 2
    share = {3: Fraction(1), 2: Fraction(-1, square), 1: Fraction(-6, square)}[max(e)]
    L, M = _characteristic_pairs(claim.region[0])[0]
    floor = tau * share * plant.denominator * plant.law * _denominator([L, M])
    spend(len(F) ** 2, floor.denominator.bit_length(), bits(F))
    scaled = [[floor.denominator * entry for entry in row] for row in F]
    for i in range(len(F) // 2):
        scaled[i][i] -= floor.numerator
    return scaled


def _slack(
    claim: Claim, plant: _Plant, sizes: tuple[int, ...], parts: tuple[Part, ...]
) -> Iterator[tuple[str, Integers]]:
    (evidence,) = claim.evidence
    G, own = evidence.G or [], _denominator([*evidence.X, evidence.G or []], 2 * MAX_BITS)
    D, degree = plant.law, _degree(claim, evidence)
    g = _integers(G, own)
    (K,) = (_integers(k, D) for k in claim.law.K or [])
    L_ = [[sum(map(int.__mul__, k, column)) for column in _transposed(g)] for k in K]
    zero = (0,) * sum(sizes)
    # all over the denominators of the law and the evidence; N over the plant's too
    N = _elevated(_product(plant.AB, {zero: _times(D, g) + L_}), sizes, degree - 1)
    P = _multiple(D, _bernstein([_integers(x, own) for x in evidence.X], sizes, evidence.degree))
    P = _elevated(P, sizes, degree - evidence.degree)
    slack = _elevated({zero: _times(D, g)}, sizes, degree)
    for part in parts:
        for L, M in _characteristic_pairs(part):
            L_, M_, common = _integral(L, M, plant.denominator)
            units = plant.denominator, common, evidence.epsilon
            entries, long = 8 * (len(M) * len(g)) ** 2, max(_longest(P), _longest(N))
            for e in monomials(sizes, degree):
                spend(entries, max(bits(L_), bits(M_)), long)
                name = _name(e, sizes, claim, part)
                if len(M) == 2 and not (M[0][0] or M[1][0] or M[1][1]):
                    yield name, _disk_slack(L_, M_, P[e], N[e], slack[e])
                else:
                    yield name, _bordered(L_, M_, P[e], N[e], slack[e], units)
    if any(part.kind != "disk" for part in parts):
        for e in monomials(sizes, degree):
            yield f"of P at {_name(e, sizes, claim)}", P[e]


def _disk_slack(L: Integers, M: Integers, P: Integers, N: Integers, G: Integers) -> Integers:
    """Return [ r P, -(N + sigma G) ; *, r (G + G' - P) ], Leite & Peres (2005), (10)."""
    r, sigma, one = -L[0][0], L[0][1], M[0][1]
    both = [
        [-one * x - sigma * g for x, g in zip(xs, gs, strict=True)]
        for xs, gs in zip(N, G, strict=True)
    ]
    right = [
        [r * (g + h - p) for g, h, p in zip(gs, hs, ps, strict=True)]
        for gs, hs, ps in zip(G, _transposed(G), P, strict=True)
    ]
    upper = [[r * p for p in ps] + row for ps, row in zip(P, both, strict=True)]
    return upper + [a + b for a, b in zip(_transposed(both), right, strict=True)]


def _bordered(
    L: Integers,
    M: Integers,
    P: Integers,
    N: Integers,
    G: Integers,
    units: tuple[int, int, Fraction],
) -> Integers:
    """Return -[ L (x) P + M' (x) N + *, M (x) (P - G') + e I (x) N ; *, -e I (x) (G + G') ].

    It implies L (x) P + M' (x) A_c P + M (x) P A_c' < 0, of which the region is the same as with
    M and M' exchanged: multiply by [ I, I (x) A_c ] from the left and by its transpose. N comes
    times the first of the units, L times the first two, M times the second; the third is e.
    """
    denominator, common, epsilon = units
    top, bottom = epsilon.numerator, epsilon.denominator
    d, n, T = range(len(L)), range(len(P)), _transposed(G)
    first = _times(bottom, _block(L, _transposed(M), P, N))
    corner = [
        [
            -bottom * denominator * M[a][b] * (P[i][j] - T[i][j])
            - top * common * (a == b) * N[i][j]
            for b in d
            for j in n
        ]
        for a in d
        for i in n
    ]
    unit = top * common * denominator
    last = [[unit * (a == b) * (G[i][j] + T[i][j]) for b in d for j in n] for a in d for i in n]
    upper = [f + row for f, row in zip(first, corner, strict=True)]
    return upper + [a + b for a, b in zip(_transposed(corner), last, strict=True)]


def _name(
    exponent: Exponent, sizes: tuple[int, ...], claim: Claim, part: Part | None = None
) -> str:
    support = sorted((j for j, p in enumerate(exponent) if p), key=lambda j: (-exponent[j], j))
    where = f"{part.kind}: " if part is not None and len(claim.region) > 1 else ""
    if _is_theorem_1(claim) and part is not None:
        number = 14 + len(support)
        return f"({number}) " + " ".join(
            f"{letter}={j + 1}" for letter, j in zip("jkl", support, strict=False)
        )
    if len(sizes) == 1 and len(support) == 1 and exponent[support[0]] == 1:
        return f"{where}at vertex {support[0] + 1}"
    powers = [
        f"{'abcdefgh'[f]}{j + 1}^{p}"
        for f, start in enumerate(_starts(sizes))
        for j, p in enumerate(exponent[start : start + sizes[f]])
        if p
    ]
    return (
        f"{where}at {' '.join(powers)}"
        if len(sizes) > 1
        else where + "at " + " ".join(f"alpha{j + 1}^{exponent[j]}" for j in support)
    )


def poles_inside(claim: Claim, alpha: list[Fraction]) -> bool:
    """Decide exactly whether all poles at one alpha lie in the region; False is always right.

    An ellipse is replaced by the polygon of its `TANGENTS`, which contains it. A law that is
    undefined at alpha keeps no pole anywhere.

    Raises
    ------
    ValueError
        If alpha is not a point of the simplex, or for a box no product; or the numbers of the
        region make none.
    FormatError
        If a count of the work says that it is too much.
    """
    require_region(claim.region)
    closed = closed_loop(claim, alpha)
    return closed is not None and all_inside(closed, claim.region)


def fraction_at(claim: Claim, alpha: list[Fraction]) -> tuple[Rationals, Rationals]:
    """Return N and W of the closed loop N W^-1 at one alpha; W = I for a fixed law.

    Raises
    ------
    ValueError
        If alpha is not a point of the simplex, or for a box no product.
    """
    if len(alpha) != len(claim.A) or min(alpha) < 0 or sum(alpha) != 1:
        raise ValueError("alpha is not a point of the simplex")
    A, B = mix(alpha, claim.A), mix(alpha, claim.B)
    sizes, law, n = simplices(claim), claim.law, len(A)
    coordinates = _coordinates(alpha, sizes)
    if law.K is not None:
        W = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
        Z = law.K[0] if len(law.K) == 1 else mix(alpha, law.K)
    else:
        basis = _basis(coordinates, sizes, law.degree)
        W, Z = mix(basis, law.W or []), mix(basis, law.Z or [])
    weights = claim.weights or (Fraction(1),) * len(alpha)
    q = sum((a * w for a, w in zip(alpha, weights, strict=True)), Fraction(0))
    whole = _denominator([A, B], LONGEST)
    own = _denominator([W, Z], LONGEST)
    AB = [a + b for a, b in zip(_integers(A, whole), _integers(B, whole), strict=True)]
    N = _matrix_product(AB, _integers(W, own) + _integers(Z, own))
    return [[Fraction(e, whole * own) for e in row] for row in N], [[q * e for e in r] for r in W]


def closed_loop(claim: Claim, alpha: list[Fraction]) -> Rationals | None:
    """Return A + B K at one alpha, None where the law is undefined."""
    N, W = fraction_at(claim, alpha)
    if claim.law.K is None:
        return right_divide(N, W)
    return [[e / W[0][0] for e in row] for row in N]


_EVIDENCE = {
    "quadratic": {"W"},
    "slack": {"P", "G", "degree", "elevation", "epsilon", "on"},
    "scheduled": {"tau", "elevation"},
    "lyapunov": {"parts", "on"},
}


def read(text: str) -> tuple[Claim, dict[str, Any]]:
    """Parse a design file; return its claim and the whole document.

    Raises
    ------
    FormatError
        If it is no JSON, cut short, of another format or version, or its shapes do not fit.
    """
    document = read_document(text, FORMAT)
    claim = claim_of(document, *read_vertices(document))
    require_box(claim, _at(document, "plant").get("parameters"))
    _require_consistent(claim)
    return claim, document


def require_box(claim: Claim, parameters: Any) -> None:
    """Refuse a claim about a box where the plant does not have its intervals."""
    count = len(parameters) if isinstance(parameters, list | tuple) else 0
    if claim.on == "box" and 2**count != len(claim.A):
        raise FormatError(
            f'"box" belongs to plants whose parameters span the vertices: plant.parameters holds '
            f"{count}, for {len(claim.A)} vertices"
        )


def read_document(text: str, kind: str) -> dict[str, Any]:
    """Parse a JSON document of a format, of this version."""
    document = parse(text)
    if not isinstance(document, dict) or document.get("format") != kind:
        found = document.get("format") if isinstance(document, dict) else None
        other = f", not {_shown(found)}" if isinstance(found, str) else ""
        raise FormatError(f'not a design file: "format" must be "{kind}"{other}')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise FormatError(
            f"format version {_shown(document.get('version'))} is not {VERSION}, the one read "
            "here; use a later release of polefence"
        )
    return document


def claim_of(document: dict[str, Any], A: list[Rationals], B: list[Rationals]) -> Claim:
    """Return the claim of a document about these vertices."""
    n, m = len(A[0]), len(B[0][0])
    region = read_region(_at(document, "region"))
    method, kind = _at(document, "method"), _at(document, "law", "kind")
    if method not in METHODS:
        raise FormatError(f"method {_shown(method)} is not one of {', '.join(METHODS)}")
    kinds = {"scheduled": ["scheduled"], "lyapunov": ["fixed", "scheduled"]}.get(method, ["fixed"])
    if kind not in kinds:
        raise FormatError(f"law.kind {_shown(kind)} does not belong to method {method!r}")
    _only(document, "certificate", _EVIDENCE[method])
    law, on = _law(document, n, m)
    claim = Claim(method, A, B, region, law, (), on)
    sizes = simplices(claim)
    if kind == "scheduled" and len(law.W or []) != _number(sizes, law.degree):
        count = _number(sizes, law.degree)
        raise FormatError(f"law.W holds {len(law.W or [])} matrices; the plant needs {count}")
    certificate = _at(document, "certificate")
    if method == "lyapunov":
        tables = _list(_at(document, "certificate", "parts"), "certificate.parts", MAX_PARTS)
        evidence = tuple(
            read_evidence(table, f"certificate.parts[{k + 1}]", "X", n, sizes)
            for k, table in enumerate(tables)
        )
        for table in tables:
            _only({"part": table}, "part", {"X", "degree", "elevation", "multiple"})
    elif method == "scheduled":
        tau = read_number(_at(document, "certificate", "tau"), "certificate.tau")
        elevation = _integer(certificate, "certificate", "elevation", 1)
        evidence = (Evidence([], elevation=elevation, tau=tau),)
    elif method == "quadratic":
        W = read_matrix(_at(document, "certificate", "W"), "certificate.W", n, n)
        evidence = (Evidence([W]),)
    else:
        own = read_evidence(certificate, "certificate", "P", n, sizes, 1)
        G = read_matrix(_at(document, "certificate", "G"), "certificate.G", n, n)
        epsilon = read_number(certificate.get("epsilon", 0), "certificate.epsilon")
        evidence = (Evidence(own.X, own.degree, own.elevation, G=G, epsilon=epsilon),)
    return Claim(method, A, B, region, law, evidence, on)


def read_vertices(document: dict[str, Any]) -> tuple[list[Rationals], list[Rationals]]:
    """Return A and B of all vertices, of shapes that fit."""
    vertices = _list(_at(document, "plant", "vertices"), "plant.vertices", MAX_VERTICES)
    A = [_matrix(_at(v, "A"), f"vertex {j + 1}: A") for j, v in enumerate(vertices)]
    B = [_matrix(_at(v, "B"), f"vertex {j + 1}: B") for j, v in enumerate(vertices)]
    n, m = len(A[0]), len(B[0][0])
    for j in range(len(A)):
        _shape(A[j], n, n, f"vertex {j + 1}: A")
        _shape(B[j], n, m, f"vertex {j + 1}: B")
    _denominator([*A, *B])
    return A, B


def read_region(table: Any) -> tuple[Part, ...]:
    """Return the parts of a region."""
    kind = _at({"region": table}, "region", "kind")
    if kind == "intersection":
        _only({"region": table}, "region", {"kind", "parts"})
        parts = _list(_at({"region": table}, "region", "parts"), "region.parts", MAX_PARTS)
        found = tuple(_part(part, f"region.parts[{k + 1}]") for k, part in enumerate(parts))
        for k, part in enumerate(found):
            if part in found[:k]:
                raise FormatError(f"region.parts[{k + 1}] stands there twice; leave one out")
    else:
        found = (_part(table, "region"),)
    require_region(found)
    return found


def _part(table: Any, where: str) -> Part:
    kind = _at({where: table}, where, "kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise FormatError(f"{where}.kind must be one of {', '.join(KINDS)}")
    _only({where: table}, where, {"kind", *KINDS[kind]})
    return Part(kind, tuple(_double(table, where, key) for key in KINDS[kind]))


def _double(table: Any, where: str, key: str) -> Fraction:
    """Return a number of a region: a double, so that what is printed of it is what is proved."""
    value = read_number(_at({where: table}, where, key), f"{where}.{key}")
    if Fraction(float(value)) != value:
        raise FormatError(f"{where}.{key} = {_shown(table[key])} is no double; give a decimal")
    return value


def _law(document: dict[str, Any], n: int, m: int) -> tuple[Law, str]:
    """Return the law, and whether alpha is a point of the simplex or of a box."""
    table = _at(document, "law")
    if table["kind"] == "fixed":
        _only(document, "law", {"kind", "K"})
        K = read_matrix(_at(document, "law", "K"), "law.K", m, n)
        certificate = _at(document, "certificate")
        on = certificate.get("on", "simplex") if isinstance(certificate, dict) else None
        return Law([K]), _domain(on, "certificate.on")
    _only(document, "law", {"kind", "W", "Z", "degree", "on"})
    W, Z = (
        _several(_at(document, "law", key), f"law.{key}", rows, n)
        for key, rows in (("W", n), ("Z", m))
    )
    if len(W) != len(Z):
        raise FormatError(f"law.Z holds {len(Z)} matrices; W holds {len(W)}")
    return Law(None, W, Z, _integer(table, "law", "degree", 1)), _domain(
        table.get("on", "simplex"), "law.on"
    )


def _domain(on: Any, where: str) -> str:
    if on not in ("simplex", "box"):
        raise FormatError(f'{where} must be "simplex" or "box"')
    return str(on)


def read_evidence(
    table: Any, where: str, key: str, n: int, sizes: tuple[int, ...], degree: int = 0
) -> Evidence:
    """Read a Lyapunov polynomial, of this degree where the file does not say."""
    X = _several(_at({where: table}, where, key), f"{where}.{key}", n, n)
    degree = _integer(table, where, "degree", degree)
    if len(X) != _number(sizes, degree):
        count = _number(sizes, degree)
        raise FormatError(f"{where}.{key} holds {len(X)} matrices; its degree needs {count}")
    values = table.get("multiple", [])
    if not isinstance(values, list) or len(values) not in (0, len(X)):
        raise FormatError(f"{where}.multiple must hold one number a matrix")
    multiple = tuple(read_number(v, f"{where}.multiple") for v in values)
    return Evidence(X, degree, _integer(table, where, "elevation", 0), multiple)
