"""Prove a design file in exact arithmetic: ``python exact.py design.json`` needs nothing else.

This file uses integers and the standard library only, imports nothing of its project and may be
copied out of it. It reads the plant's vertices, the region, the law and the certificate; rebuilds
every linear matrix inequality of the theorem named; and tests each for positive definiteness (see
`is_positive_definite`). Numbers in the file are doubles, hence rationals; "p/q" is exact.

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

Exit status: 0 proved, 1 not proved, 2 the file cannot be read.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement, product
from operator import mul
from typing import Any

FORMAT, VERSION = "polefence-design", 1
METHODS = ("quadratic", "slack", "scheduled", "lyapunov")
MAX_BYTES, MAX_SIZE, MAX_VERTICES, MAX_PARTS = 32_000_000, 60, 256, 16
MAX_COEFFICIENTS = 20_000
# Lists, tables and keys of a file, which take up to 300 bytes each in memory, and how deep they go.
MAX_PIECES, MAX_DEPTH = 1_000_000, 50
MAX_ENTRIES = 2_000_000  # numbers among them, each of which becomes a rational
MAX_DEGREE = 16  # of any polynomial, in each simplex
LARGEST, MAX_BITS = 10**300, 20_000  # of numbers; of their common denominator
# Bounds on what a file can ask for: work, in products of two words of 30 bits, of which every
# operation takes `CALL` besides; and what polynomials hold at once [bytes].
MAX_WORK, CALL, MAX_HELD = 5 * 10**9, 120, 4 * 10**8
LEAST_WORK = 300 * CALL  # of an inequality of whatever size
COORDINATES = 2  # of an exponent, which are added at the cost of one operation
TOO_MUCH = (
    "its inequalities are more, or larger, or their numbers longer, than is checked here; round "
    "the numbers, or use a lower degree or elevation"
)

# Parts of regions: their kinds and the numbers that each has.
KINDS = {
    "disk": ("centre", "radius"),
    "half_plane": ("decay",),
    "sector": ("damping", "slope"),
    "vertical_strip": ("low", "high"),
    "horizontal_strip": ("height",),
    "ellipse": ("centre", "real", "imaginary"),
}

POSITIVE = ("radius", "height", "real", "imaginary")
LEAST_RATE, MOST_RATE, LEAST_DAMPING = map(Fraction, (1e-100, 1e100, 1e-8))

Rationals = list[list[Fraction]]
Integers = list[list[int]]
Exponent = tuple[int, ...]
Polynomial = dict[Exponent, Integers]  # homogeneous in each simplex, coefficients of monomials


class FormatError(ValueError):
    """The file is not a design file that this version reads; the message says where."""


@dataclass(frozen=True)
class Part:
    """One part of a region: its kind, and its numbers as `KINDS` names them."""

    kind: str
    numbers: tuple[Fraction, ...]


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


def _is_symmetric(X: Rationals) -> bool:
    return all(X[i][j] == X[j][i] for i in range(len(X)) for j in range(i))


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


# --- work ----------------------------------------------------------------------------------------


@dataclass
class Count:
    """Work that has begun, of the most that is allowed."""

    most: int
    spent: int = 0


_COUNT: ContextVar[Count | None] = ContextVar("count", default=None)


@contextmanager
def counted(most: int = MAX_WORK) -> Iterator[Count]:
    """Allow this much work in all that follows; inside another count, what that one allows."""
    outer = _COUNT.get()
    if outer is not None:
        yield outer
        return
    count = Count(most)
    token = _COUNT.set(count)
    try:
        yield count
    finally:
        _COUNT.reset(token)


def spend(operations: int, left: int, right: int = 0) -> None:
    """Count operations on numbers of so many bits, before they begin.

    Raises
    ------
    FormatError
        If they are more than the count allows.
    """
    count = _COUNT.get()
    if count is None:
        return
    amount = operations * cost(left, right)
    if count.spent + amount > count.most:
        raise FormatError(TOO_MUCH)
    count.spent += amount


def cost(left: int, right: int = 0) -> int:
    """Return what one operation on numbers of so many bits costs."""
    return CALL + (left // 30 + 1) * (right // 30 + 1)


def least_work(count: int, rows: int) -> int:
    """Return the least that so many inequalities of so many rows take, whatever their numbers."""
    return count * (rows * (rows + 1) * (rows + 2) // 6 * cost(RUNG, RUNG) + LEAST_WORK)


def bits(matrix: Integers) -> int:
    """Return the length of the longest entry."""
    return max((max(map(int.bit_length, row), default=0) for row in matrix), default=0)


def _longest(P: Polynomial) -> int:
    return max(map(bits, P.values()), default=0)


def _hold(matrices: int, entries: int, length: int) -> None:
    if matrices * entries * (36 + length // 7) > MAX_HELD:
        raise FormatError("its polynomials are larger than is checked here; use a lower degree")


# --- positive definite ---------------------------------------------------------------------------

RUNG, LAST_RUNG = 64, 4096  # bits of the first attempt and of the last


def is_positive_definite(matrix: Integers) -> bool:
    """Decide exactly whether a symmetric matrix is positive definite.

    By `_attempt` with numbers cut to 64, 256, 1024, 4096 bits, one after the other, until they are
    enough; where the matrix is too near to a singular one for that, by Sylvester's criterion.

    Raises
    ------
    FormatError
        If a count of the work says that it is too much.
    """
    n, length = len(matrix), bits(matrix)
    spend(LEAST_WORK // CALL, 0)
    spend(n * n, length)
    exponents = [(matrix[i][i].bit_length() + 1) // 2 for i in range(n)]
    if any(matrix[i][i] <= 0 for i in range(n)):
        return False
    p = RUNG
    while p <= min(max(RUNG, n * length), LAST_RUNG):
        spend(n * (n + 1) * (n + 2) // 3, p, p)
        answer = _attempt(matrix, exponents, p)
        if answer is not None:
            return answer
        p *= 4
    return _sylvester(matrix)


def _attempt(matrix: Integers, exponents: list[int], p: int) -> bool | None:
    """Decide with p bits, None where they are too few.

    S, the matrix scaled by powers of two to diagonal entries from 1/4 to 1, is S 2^p = s + E1 with
    whole s and entries of E1 from 0 to 1, so |E1| <= n. If Cholesky's recursion in whole numbers
    finds R for s - c I, then (s - c I) 2^p = R'R + E2, where E2 has the remainders of its divisions
    and roots: 0 <= E2 <= 2 (2^p + c) entry by entry, |E2| <= 2 n (2^p + c). So s - c I >=
    -2 n (1 + c / 2^p) I, and c > 3 n (1 + c / 2^p) makes S positive definite. If it meets a pivot
    that is not positive for s + c I, there is x with x'R'R x = 0, and x'S x < 0 by the same bounds.
    """
    n = len(matrix)
    s: Integers = []
    for i, row in enumerate(matrix):
        scaled = []
        for j in range(i, n):
            total = exponents[i] + exponents[j]
            if row[j].bit_length() > total:  # above the root of the two diagonal entries
                return False
            shift = p - total
            scaled.append(row[j] << shift if shift >= 0 else row[j] >> -shift)
        s.append(scaled)
    c = 4 * n + 4
    if _has_root(s, -c, p):
        return True
    return None if _has_root(s, c, p) else False


def _has_root(s: Integers, c: int, p: int) -> bool:
    """Whether all pivots of Cholesky's recursion for s + c I are positive; s is its upper half."""
    columns: Integers = [[] for _ in s]
    for i, row in enumerate(s):
        own = columns[i]
        square = ((row[0] + c) << p) - sum(map(mul, own, own))
        pivot = math.isqrt(square) if square > 0 else 0
        if not pivot:
            return False
        for entry, column in zip(row[1:], columns[i + 1 :], strict=True):
            column.append(((entry << p) - sum(map(mul, own, column))) // pivot)
    return True


def is_semidefinite(matrix: Integers) -> bool:
    """Decide exactly whether a symmetric matrix has no negative eigenvalue.

    Raises
    ------
    FormatError
        If a count of the work says that it is too much.
    """
    n = len(matrix)
    if any(matrix[i][i] < 0 for i in range(n)):
        return False
    spend(n * (n + 1) * (n + 2) // 3, RUNG, RUNG)
    exponents = [(matrix[i][i].bit_length() + 1) // 2 for i in range(n)]
    answer = _attempt(matrix, exponents, RUNG)
    return _sylvester(matrix, singular=True) if answer is None else answer


def _sylvester(matrix: Integers, singular: bool = False) -> bool:
    """Sylvester's criterion by fraction-free (Bareiss) elimination: all pivots are minors > 0.

    A pivot may be zero, with its row, where the matrix may be singular.
    """
    n, length = len(matrix), bits(matrix)
    spend(n * (n + 1) * (n + 2) // 3, n * length, n * length // 2)
    common = math.gcd(*(entry for row in matrix for entry in row)) or 1
    # Upper triangle only: the Schur complements stay symmetric.
    rows = [[entry // common for entry in row[i:]] for i, row in enumerate(matrix)]
    previous = 1
    while rows:
        first, *rest = rows
        pivot = first[0]
        if singular and not any(first):
            rows = rest
            continue
        if pivot <= 0:
            return False
        rows = [
            [
                (pivot * entry - first[i + 1] * first[i + 1 + j]) // previous
                for j, entry in enumerate(row)
            ]
            for i, row in enumerate(rest)
        ]
        previous = pivot
    return True


# --- polynomials on a product of simplices -------------------------------------------------------


def simplices(claim: Claim) -> tuple[int, ...]:
    """Return the number of corners of each simplex: one with all vertices, or two a parameter."""
    N = len(claim.A)
    return (N,) if claim.on == "simplex" or N == 1 else (2,) * (N.bit_length() - 1)


def monomials(sizes: tuple[int, ...], degree: int) -> list[Exponent]:
    """Return the exponents of the monomials of a degree in each simplex, in the file's order.

    Fewest corners first, then by exponents from the largest down, then by corners; in a product
    the first simplex varies slowest.
    """
    return [sum(parts, ()) for parts in product(*(_simplex(size, degree) for size in sizes))]


def _simplex(size: int, degree: int) -> list[Exponent]:
    spend(math.comb(size - 1 + degree, degree) * (size // COORDINATES + degree + 1), 0)

    def rank(chosen: Exponent) -> Any:
        order = sorted(set(chosen), key=lambda j: (-chosen.count(j), j))
        return len(order), [-chosen.count(j) for j in order], order

    powers = []
    for chosen in sorted(combinations_with_replacement(range(size), degree), key=rank):
        power = [0] * size
        for j in chosen:
            power[j] += 1
        powers.append(tuple(power))
    return powers


def _number(sizes: tuple[int, ...], degree: int) -> int:
    return math.prod(math.comb(size - 1 + degree, degree) for size in sizes)


def _binomial(exponent: Exponent, sizes: tuple[int, ...]) -> int:
    """Return the multinomial coefficient of a monomial, the product over the simplices."""
    value, start = 1, 0
    for size in sizes:
        powers = exponent[start : start + size]
        start += size
        value *= math.factorial(sum(powers))
        for power in powers:
            value //= math.factorial(power)
    return value


def _bernstein(coefficients: list[Integers], sizes: tuple[int, ...], degree: int) -> Polynomial:
    return {
        e: _times(_binomial(e, sizes), c)
        for e, c in zip(monomials(sizes, degree), coefficients, strict=True)
    }


def _product(P: Polynomial, Q: Polynomial) -> Polynomial:
    """Multiply matrix polynomials."""
    result: Polynomial = {}
    columns = {e: _transposed(q) for e, q in Q.items()}
    left, right = _longest(P), _longest(Q)
    none: Integers = [[]]
    one, other = next(iter(P.values()), none), next(iter(columns.values()), none)
    spend(len(P) * len(Q) * len(one) * len(other) * len(one[0]), left, right)
    _spend_exponents(len(P) * len(Q), P)
    for d, p in P.items():
        for e, c in columns.items():
            both = [[sum(map(int.__mul__, row, column)) for column in c] for row in p]
            _add(result, tuple(map(int.__add__, d, e)), both)
        _hold(len(result), len(one) * len(other), left + right)
    return result


def _spend_exponents(count: int, P: Polynomial) -> None:
    spend(count * len(next(iter(P), ())) // COORDINATES, 0)


def _add(P: Polynomial, exponent: Exponent, matrix: Integers) -> None:
    P[exponent] = _sum(P[exponent], matrix) if exponent in P else matrix


def _plus(P: Polynomial, Q: Polynomial) -> Polynomial:
    result = dict(P)
    for e, matrix in Q.items():
        _add(result, e, matrix)
    return result


def _multiple(factor: int, P: Polynomial) -> Polynomial:
    spend(
        sum(len(matrix) * len(matrix[0]) for matrix in P.values()), factor.bit_length(), _longest(P)
    )
    return P if factor == 1 else {e: _times(factor, matrix) for e, matrix in P.items()}


def _elevated(P: Polynomial, sizes: tuple[int, ...], times: int) -> Polynomial:
    """Multiply by (sum of a simplex's coordinates)^times, for every simplex."""
    for _ in range(times):
        start, length = 0, _longest(P)
        for size in sizes:
            one = next(iter(P.values()))
            spend(len(P) * size * len(one) * len(one[0]), length)
            _spend_exponents(len(P) * size, P)
            _hold(len(P) * size, len(one) * len(one[0]), length)
            result: Polynomial = {}
            for e, matrix in P.items():
                for j in range(start, start + size):
                    _add(result, (*e[:j], e[j] + 1, *e[j + 1 :]), matrix)
            P, start = result, start + size
    return P


def _times(factor: int, matrix: Integers) -> Integers:
    return matrix if factor == 1 else [[factor * entry for entry in row] for row in matrix]


def _sum(X: Integers, Y: Integers) -> Integers:
    return [list(map(int.__add__, x, y)) for x, y in zip(X, Y, strict=True)]


def _transposed(matrix: Integers) -> Integers:
    return [list(column) for column in zip(*matrix, strict=True)]


# --- the inequalities ----------------------------------------------------------------------------


def require_region(parts: tuple[Part, ...]) -> None:
    """Refuse numbers that make no region: no pole lies in one, nor outside.

    Raises
    ------
    FormatError
        Naming the first such part.
    """
    for k, part in enumerate(parts):
        fault = _fault(part)
        if fault:
            where = "region" if len(parts) == 1 else f"region.parts[{k + 1}]"
            raise FormatError(f"{where}.{fault}")


def _fault(part: Part) -> str:
    """Say which number of a part makes it no region, and what it must be."""
    v = dict(zip(KINDS[part.kind], part.numbers, strict=True))
    for key, value in v.items():
        if value and not LEAST_RATE <= abs(value) <= MOST_RATE:
            return f"{key} = {_short(value)} is out of range; use magnitudes 1e-100 to 1e100"
        if key in POSITIVE and value <= 0:
            return f"{key} = {_short(value)} must be positive"
    if part.kind == "disk" and v["centre"] >= 0 and v["centre"] + v["radius"] > 1:
        return f"centre = {_short(v['centre'])} must be negative, or the disk in the unit disk"
    if part.kind == "ellipse" and v["centre"] >= 0:
        return f"centre = {_short(v['centre'])} must be negative"
    if part.kind == "vertical_strip" and v["low"] >= v["high"]:
        return f"low = {_short(v['low'])} must be below high = {_short(v['high'])}"
    if part.kind == "sector":
        if not LEAST_DAMPING <= v["damping"] < 1:
            return f"damping = {_short(v['damping'])} must be a damping ratio between 0 and 1"
        if v["slope"] != _slope(v["damping"]):
            right = float(_slope(v["damping"]))
            return f"slope = {_short(v['slope'])} is not that of its damping, {right!r}"
    return ""


def _slope(damping: Fraction) -> Fraction:
    """Return the slope sqrt(1 - damping^2) / damping, rounded down: no pole is damped less."""
    ratio = float(damping)
    slope = math.sqrt((1 - ratio) * (1 + ratio)) / ratio
    while damping**2 * (1 + Fraction(slope) ** 2) > 1:
        slope = math.nextafter(slope, 0)
    return Fraction(slope)


def _short(value: Fraction) -> str:
    return repr(float(value)).removesuffix(".0")


def _characteristic_pairs(part: Part) -> list[tuple[Rationals, Rationals]]:
    """Return L and M of { z : L + M z + M' conj(z) < 0 }; a strip has two."""
    v, one = part.numbers, Fraction(1)
    zero = one - one
    if part.kind == "disk":
        return [([[-v[1], -v[0]], [-v[0], -v[1]]], [[zero, one], [zero, zero]])]
    if part.kind == "half_plane":
        return [([[2 * v[0]]], [[one]])]
    if part.kind == "sector":
        return [([[zero, zero], [zero, zero]], [[v[1], one], [-one, v[1]]])]
    if part.kind == "vertical_strip":
        return [([[-2 * v[1]]], [[one]]), ([[2 * v[0]]], [[-one]])]
    if part.kind == "horizontal_strip":
        return [([[-2 * v[0], zero], [zero, -2 * v[0]]], [[zero, one], [-one, zero]])]
    c, a, b = v
    M = [[zero, (1 + b / a) / 2], [(b / a - 1) / 2, zero]]
    return [([[-b, -c * b / a], [-c * b / a, -b]], M)]


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


def _weighted(weights: Polynomial, X: Polynomial) -> Polynomial:
    result: Polynomial = {}
    entries = sum(len(matrix) * len(matrix[0]) for matrix in X.values())
    spend(len(weights) * entries, _longest(weights), _longest(X))
    _spend_exponents(len(weights) * len(X), X)
    for d, q in weights.items():
        for e, matrix in X.items():
            _add(result, tuple(map(int.__add__, d, e)), _times(q[0][0], matrix))
    return result


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


def _starts(sizes: tuple[int, ...]) -> list[int]:
    return [sum(sizes[:f]) for f in range(len(sizes))]


def _denominator(matrices: list[Rationals], limit: int = MAX_BITS) -> int:
    common = 1
    for denominator in {entry.denominator for M in matrices for row in M for entry in row}:
        length = common.bit_length()
        spend(1, length, min(length, denominator.bit_length()) + 30)
        common = math.lcm(common, denominator)
        if common.bit_length() > limit:
            raise FormatError("the numbers' common denominator is out of all proportion")
    return common


def _integers(matrix: Rationals, denominator: int) -> Integers:
    length = denominator.bit_length()
    spend(2 * len(matrix) * len(matrix[0] if matrix else []), length, min(length, 1000))
    return [[e.numerator * (denominator // e.denominator) for e in row] for row in matrix]


# --- counterexamples -----------------------------------------------------------------------------

TANGENTS = 32  # of an ellipse, in the upper half-plane
LONGEST = 10**6  # bits of a common denominator there


@dataclass(frozen=True)
class Outside:
    """Evidence that a pole does not lie in the half-plane p x + q y < c, which holds the region.

    P = S + i T, S symmetric, T skew. If all poles did, R = (p - i q) A - c I would be stable, and
    every P with R* P + P R < 0 positive definite (Lyapunov). For a law K = Z W^-1 both sides come
    times W: W* P (A W + B Z), with which W is seen to be regular, too.
    """

    p: Fraction
    q: Fraction
    c: Fraction
    S: Rationals
    T: Rationals


def quotient(matrix: Rationals) -> tuple[Rationals, Rationals]:
    """Return a matrix as N W^-1: N and W = I."""
    n = len(matrix)
    return matrix, [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]


def is_outside(loop: tuple[Rationals, Rationals], region: tuple[Part, ...], by: Outside) -> bool:
    """Whether this proves that a pole of N W^-1 is outside, ``loop`` holding N and W.

    False says nothing.
    """
    n = len(loop[0])
    shapes = all(len(M) == n and all(len(row) == n for row in M) for M in (by.S, by.T))
    if not shapes or not any(_holds(part, by.p, by.q, by.c) for part in region):
        return False
    if not _is_symmetric(by.S) or any(
        by.T[i][j] != -by.T[j][i] for i in range(n) for j in range(i + 1)
    ):
        return False
    p, q, c = _integers([[by.p, by.q, by.c]], _denominator([[[by.p, by.q, by.c]]], LONGEST))[0]
    N, W = (_integers(M, _denominator(list(loop), LONGEST)) for M in loop)
    S, T = (_integers(M, _denominator([by.S, by.T], LONGEST)) for M in (by.S, by.T))
    left = _transposed(W)
    SN, TN, SW, TW = (
        _matrix_product(left, _matrix_product(*pair)) for pair in ((S, N), (T, N), (S, W), (T, W))
    )
    ahead = [
        [p * a + q * b for a, b in zip(*rows, strict=True)] for rows in zip(SN, TN, strict=True)
    ]
    aside = [
        [p * b - q * a for a, b in zip(*rows, strict=True)] for rows in zip(SN, TN, strict=True)
    ]
    real = [[2 * c * SW[i][j] - ahead[i][j] - ahead[j][i] for j in range(n)] for i in range(n)]
    skew = [[2 * c * TW[i][j] - aside[i][j] + aside[j][i] for j in range(n)] for i in range(n)]
    decreases = is_positive_definite(_embedded(real, skew))
    return decreases and not is_positive_definite(_embedded(S, T))


def _embedded(real: Integers, skew: Integers) -> Integers:
    """Return the symmetric matrix of a Hermitian one; the real part alone where that is all."""
    if not any(map(any, skew)):
        return real
    upper = [a + [-x for x in b] for a, b in zip(real, skew, strict=True)]
    return upper + [b + a for a, b in zip(real, skew, strict=True)]


def _matrix_product(P: Integers, Q: Integers) -> Integers:
    spend(len(P) * len(Q) * len(Q[0]), bits(P), bits(Q))
    columns = _transposed(Q)
    return [[sum(map(mul, row, column)) for column in columns] for row in P]


def _holds(part: Part, p: Fraction, q: Fraction, c: Fraction) -> bool:
    """Whether the part lies in the half-plane p x + q y <= c."""
    v, flat = part.numbers, not q
    if part.kind in ("disk", "ellipse"):
        a, b = v[1], v[-1]
        rest = c - p * v[0]
        return rest >= 0 and rest**2 >= (a * p) ** 2 + (b * q) ** 2
    if part.kind == "half_plane":
        return flat and p >= 0 and -v[0] * p <= c
    if part.kind == "sector":
        return c >= 0 and p >= v[1] * abs(q)
    if part.kind == "vertical_strip":
        return flat and max(p * v[0], p * v[1]) <= c
    return not p and abs(q) * v[0] <= c


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


def all_inside(matrix: Rationals, region: tuple[Part, ...]) -> bool:
    """Decide whether all eigenvalues lie in the region, as `poles_inside` does."""
    whole = _denominator([matrix], LONGEST)
    polynomial = characteristic(_integers(matrix, whole))
    return roots_inside(polynomial, region, whole)


def inside_work(matrix: Rationals) -> int:
    """Return about what `all_inside` costs."""
    n, length = len(matrix), bits(_integers(matrix, _denominator([matrix], LONGEST)))
    return n**4 * cost(n * length // 2, length)


def roots_inside(polynomial: list[int], region: tuple[Part, ...], whole: int = 1) -> bool:
    """Decide whether all roots, over ``whole``, lie in the region; the highest power comes first.

    An ellipse is replaced by the polygon of its `TANGENTS`, which contains it.
    """
    for part in region:
        if part.kind == "disk":
            own = _denominator([[list(part.numbers)]], LONGEST)
            centre, radius = (int(v * own) * whole for v in part.numbers)
            moved = _shifted(_scaled(polynomial, own), centre)
            if not _in_unit_disk([a * radius**k for k, a in enumerate(reversed(moved))][::-1]):
                return False
        elif not all(_in_half_plane(polynomial, whole, *side) for side in _sides(part)):
            return False
    return True


def _sides(part: Part) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    """Yield p, q, c of half-planes p x + q |y| < c of which the part is the intersection."""
    v, zero, one = part.numbers, Fraction(0), Fraction(1)
    if part.kind == "half_plane":
        yield one, zero, -v[0]
    elif part.kind == "sector":
        yield v[1], one, zero
    elif part.kind == "vertical_strip":
        yield one, zero, v[1]
        yield -one, zero, -v[0]
    elif part.kind == "horizontal_strip":
        yield zero, one, v[0]
    else:  # the ellipse ((x - c) / a)^2 + (y / b)^2 < 1, by tangents at rational points
        c, a, b = v
        for k in range(TANGENTS + 1):
            s = Fraction(k, TANGENTS)
            cosine, sine = (1 - s**2) / (1 + s**2), 2 * s / (1 + s**2)
            for sign in (1, -1):
                yield sign * cosine / a, sine / b, 1 + sign * cosine * c / a


def _coordinates(alpha: list[Fraction], sizes: tuple[int, ...]) -> list[Fraction]:
    """Return the point's coordinates in each simplex, one after the other."""
    if len(sizes) == 1:
        return alpha
    found: list[Fraction] = []
    for f in range(len(sizes)):
        bit = len(sizes) - 1 - f
        high = sum((a for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        found += [1 - high, high]
    for a, corner in zip(alpha, monomials(sizes, 1), strict=True):
        if a != math.prod(x for x, power in zip(found, corner, strict=True) if power):
            raise ValueError("alpha is no product of points of the parameters' intervals")
    return found


def _basis(coordinates: list[Fraction], sizes: tuple[int, ...], degree: int) -> list[Fraction]:
    """Return the values of the Bernstein polynomials."""
    return [
        math.prod((x**p for x, p in zip(coordinates, e, strict=True)), start=Fraction(1))
        * _binomial(e, sizes)
        for e in monomials(sizes, degree)
    ]


def mix(weights: list[Fraction], matrices: list[Rationals]) -> Rationals:
    """Return the sum of weights times matrices."""
    own, whole = _denominator([[weights]], LONGEST), _denominator(matrices, LONGEST)
    (factors,) = _integers([weights], own)
    integers = [_integers(M, whole) for M in matrices]
    spend(sum(len(M) * len(M[0]) for M in matrices), bits([factors]), max(map(bits, integers)))
    return [
        [
            Fraction(sum(map(mul, factors, entries)), own * whole)
            for entries in zip(*rows, strict=True)
        ]
        for rows in zip(*integers, strict=True)
    ]


def right_divide(Z: Rationals, W: Rationals) -> Rationals | None:
    """Return Z W^-1 by fraction-free Gauss-Jordan elimination on columns, None for a singular W."""
    n = len(W)
    common = _denominator([Z, W], LONGEST)
    table = _transposed(_integers(W, common) + _integers(Z, common))
    length = n * bits(table)
    spend(n * n * len(table[0]), length, length)
    previous = 1
    for p in range(n):
        pivot = next((i for i in range(p, n) if table[i][p]), None)
        if pivot is None:
            return None
        table[p], table[pivot] = table[pivot], table[p]
        own = table[p]
        for i in range(n):
            factor = table[i][p]
            if i != p:
                table[i] = [
                    (own[p] * a - factor * b) // previous
                    for a, b in zip(table[i], own, strict=True)
                ]
        previous = own[p]
    return [[Fraction(table[i][n + q], table[i][i]) for i in range(n)] for q in range(len(Z))]


def characteristic(matrix: Integers) -> list[int]:
    """Coefficients of det(z I - matrix), highest power first (Faddeev-LeVerrier)."""
    n, length = len(matrix), bits(matrix)
    spend(n**4, n * length // 2, length)
    coefficients = [1]
    power = [[int(i == j) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        columns = _transposed(power)
        power = [[sum(map(mul, row, column)) for column in columns] for row in matrix]
        coefficients.append(-sum(power[i][i] for i in range(n)) // k)  # divides exactly
        for i in range(n):
            power[i][i] += coefficients[-1]
    return coefficients


def rational_product(left: Rationals, right: Rationals) -> Rationals:
    """Return the product of two matrices."""
    one, other = (_denominator([M], LONGEST) for M in (left, right))
    both = _matrix_product(_integers(left, one), _integers(right, other))
    return [[Fraction(e, one * other) for e in row] for row in both]


def _shifted(polynomial: list[int], c: int) -> list[int]:
    """Return the polynomial in z of p(z + c), by Horner's scheme."""
    shifted = polynomial[:]
    longest = max(map(int.bit_length, polynomial)) + len(polynomial) * c.bit_length()
    spend(len(polynomial) ** 2, longest, c.bit_length())
    for end in range(len(shifted), 1, -1):
        for i in range(1, end):
            shifted[i] += c * shifted[i - 1]
    return shifted


def _scaled(polynomial: list[int], r: int) -> list[int]:
    """Return the polynomial whose roots are r times those of p."""
    return [c * r**k for k, c in enumerate(polynomial)]


def _in_unit_disk(polynomial: list[int]) -> bool:
    return is_positive_definite(_schur_cohn(polynomial))


def _in_half_plane(
    polynomial: list[int], whole: int, p: Fraction, q: Fraction, c: Fraction
) -> bool:
    """Decide whether all roots z, over ``whole``, of a real polynomial have p x + q |y| < c.

    The numbers z (p - i q) and their conjugates have real parts p x + q y and p x - q y; the left
    half-plane is the unit disk by s = (w + 1) / (w - 1).
    """
    own = _denominator([[[p, q, c]]], LONGEST)
    P, Q, C = int(p * own), int(q * own), int(c * own) * whole
    rotated = _scaled(polynomial, P)
    if Q:
        # of roots z (p - i q): coefficient k times (p - i q)^k; times the conjugate polynomial
        real, imaginary = [1], [0]
        for _ in polynomial[1:]:
            x, y = real[-1], imaginary[-1]
            real.append(P * x + Q * y)
            imaginary.append(P * y - Q * x)
        parts = [
            [a * b for a, b in zip(polynomial, powers, strict=True)] for powers in (real, imaginary)
        ]
        squares = [_convolved(part, part) for part in parts]
        rotated = [a + b for a, b in zip(*squares, strict=True)]
    s = _shifted(rotated, C)
    n = len(s) - 1
    # in a unit of about the size of the roots, 2^e; then s = 1 + 2 / v with v = w - 1
    e = (s[-1].bit_length() - s[0].bit_length()) // max(n, 1)
    s = [a << (-e * k if e < 0 else e * (n - k)) for k, a in enumerate(s)]
    around = [a << k for k, a in enumerate(reversed(_shifted(s, 1)))]
    mapped = _shifted(around, -1)
    return mapped[0] != 0 and _in_unit_disk(mapped)


def _convolved(a: list[int], b: list[int]) -> list[int]:
    longest = (max(map(int.bit_length, each)) for each in (a, b))
    spend(len(a) * len(b), *longest)
    result = [0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] += x * y
    return result


def _schur_cohn(a: list[int]) -> Integers:
    """T1 T1' - T2 T2' of the polynomial's triangular Toeplitz matrices."""
    n = len(a) - 1
    longest = max(map(int.bit_length, a))
    spend(n * n * (n + 1) * 2 // 3, longest, longest)
    return [
        [
            sum(a[i - k] * a[j - k] - a[n - i + k] * a[n - j + k] for k in range(min(i, j) + 1))
            for j in range(n)
        ]
        for i in range(n)
    ]


# --- reading -------------------------------------------------------------------------------------

_RATIONAL = re.compile(r"-?[0-9]{1,300}(/[1-9][0-9]{0,300})?")
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


def parse(text: str) -> Any:
    """Parse JSON within bounds of length, pieces and depth; no key twice, no number that is none.

    Raises
    ------
    FormatError
        If it is no such text.
    """
    if len(text) > MAX_BYTES or sum(map(text.count, "[{:")) > MAX_PIECES:
        raise FormatError(
            f"longer than {MAX_BYTES} characters, or more than {MAX_PIECES} lists, tables and "
            "keys; this is no file of ours"
        )
    if text.count(",") > MAX_ENTRIES:
        raise FormatError(f"more than {MAX_ENTRIES} entries of lists; this is no file of ours")
    try:
        document = json.loads(text, parse_constant=_refuse, object_pairs_hook=_unique)
    except FormatError:
        raise
    except (ValueError, RecursionError) as error:
        raise FormatError(f"not valid JSON, or cut short: {error}") from error
    level: list[Any] = [[document]]
    for _ in range(MAX_DEPTH):
        inner = (each.values() if isinstance(each, dict) else each for each in level)
        level = [value for values in inner for value in values if isinstance(value, list | dict)]
        if not level:
            return document
    raise FormatError(f"nested more than {MAX_DEPTH} deep; this is no file of ours")


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


def _integer(table: dict[str, Any], where: str, key: str, default: int) -> int:
    value = table.get(key, default)
    if type(value) is not int or not 0 <= value <= MAX_DEGREE:
        raise FormatError(f"{where}.{key} must be a whole number, 0 to {MAX_DEGREE}")
    return value


def _several(value: Any, where: str, rows: int, n: int) -> list[Rationals]:
    values = _list(value, where, MAX_COEFFICIENTS)
    found = [_matrix(v, f"{where}[{k + 1}]") for k, v in enumerate(values)]
    for k, each in enumerate(found):
        _shape(each, rows, n, f"{where}[{k + 1}]")
    return found


def read_matrix(value: Any, where: str, rows: int, columns: int) -> Rationals:
    """Return a matrix of this shape."""
    matrix = _matrix(value, where)
    _shape(matrix, rows, columns, where)
    return matrix


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


def _refuse(text: str) -> Any:
    raise FormatError(f"{text} is not a finite number")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise FormatError(f"a key is given twice among {', '.join(k for k, _ in pairs)[:80]}")
    return table


def _shown(value: Any) -> str:
    """Quote a value in a message: cut to a part of a line, a table or a list by its kind alone."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    return repr(value[:40]) if isinstance(value, str) else repr(value)[:40]


def _at(value: Any, *keys: str) -> Any:
    for i, key in enumerate(keys):
        if not isinstance(value, dict) or key not in value:
            raise FormatError(f"{'.'.join(keys[: i + 1])} is missing")
        value = value[key]
    return value


def _only(document: dict[str, Any], section: str, known: set[str]) -> None:
    table = document.get(section)
    for key in table if isinstance(table, dict) else ():
        if key not in known:
            raise FormatError(
                f"unknown key {section}.{key[:40]}; known: {', '.join(sorted(known))}"
            )


def _list(value: Any, where: str, limit: int) -> list[Any]:
    if not isinstance(value, list) or not 1 <= len(value) <= limit:
        raise FormatError(f"{where} must be a list of 1 to {limit} entries")
    return value


def _matrix(value: Any, where: str) -> Rationals:
    rows = [_list(row, where, MAX_SIZE) for row in _list(value, where, MAX_SIZE)]
    if any(len(row) != len(rows[0]) for row in rows):
        raise FormatError(f"{where} is ragged")
    return [
        [read_number(entry, f"{where}[{i + 1}][{j + 1}]") for j, entry in enumerate(row)]
        for i, row in enumerate(rows)
    ]


def _shape(matrix: Rationals, rows: int, columns: int, where: str) -> None:
    if (len(matrix), len(matrix[0])) != (rows, columns):
        raise FormatError(f"{where} is {len(matrix)} x {len(matrix[0])}, not {rows} x {columns}")


def read_number(value: Any, where: str) -> Fraction:
    """Return a number of the file: a double is the rational it is, a string "p/q" is exact."""
    if isinstance(value, str) and _RATIONAL.fullmatch(value):  # which is below `LARGEST`
        return Fraction(value)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST:
        return Fraction(value)  # nan fails the comparison; integers are compared exactly
    raise FormatError(f'{where} = {_shown(value)} is not a finite number or "p/q"')


def main(arguments: list[str]) -> int:
    """Check one design file; see the module's text."""
    if len(arguments) != 1:
        print("usage: python exact.py design.json", file=sys.stderr)
        return 2
    try:
        with open(arguments[0], encoding="utf-8") as file:
            claim, _ = read(file.read(MAX_BYTES + 1))
        verdict = prove(claim)
    except (OSError, UnicodeDecodeError, FormatError) as error:
        print(f"{arguments[0]}: {error}", file=sys.stderr)
        return 2
    region = " & ".join(
        f"{part.kind}({', '.join(f'{float(v):.17g}' for v in part.numbers)})"
        for part in claim.region
    )
    answer = "proved" if verdict.proved else "not proved"
    where = "simplex of the vertices" if claim.on == "simplex" else "box of the parameters"
    print(f"{answer}: {claim.method}, {region}, on the {where}: {verdict.reason}")
    return 0 if verdict.proved else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
