"""Error of the gain that code computes, for every parameter value and every state.

The computed u is (K(alpha) + S D C) x for some D, which may depend on x, with S and C the scales of
a claim about the gain; here is a bound on the norm of D. Operations round to nearest with
relative errors of at most u, underflow apart; g(k) = k u / (1 - k u) bounds k of them in a row.

A fixed gain: each entry is off by its own rounding and by g(n) of itself.

A scheduled one, where C = T (and S is left out here): with W' = T W T', Z' = Z T', K' = Z' W'^-1,
so that K = K' T, the code computes

    u = (Z' + dZ) (W' + dW)^-1 (T + dT) x,

    |dW| <= g(3 n + 4) trace(W'), from L D L' (an error g(n + 2) of |L| D |L'|, whose entries are at
            most those of sqrt(w_ii w_jj)), its forward and its backward substitution, backwards;
            and the errors of the constants, of the polynomials' values and of their sums,
    |dZ|    likewise, and g(n) of the last product,
    |dT| <= g(n) |T|, entry by entry;

    D = (dZ - K' dW) (W' + dW)^-1 (I + dT T^-1) + K' dT T^-1.

Rationals and the standard library only.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from math import prod

from polefence.proof.definite import is_positive_definite
from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    Rationals,
    _denominator,
    _integers,
    _times,
    norm,
    right_divide,
    scaled,
)
from polefence.proof.matrices import (
    rational_product as product,
)
from polefence.proof.placement import simplices
from polefence.proof.polynomials import _bernstein, _binomial, _elevated
from polefence.proof.polynomials import _product as _multiplied
from polefence.proof.rounding.claims import UNITS, Code, Rounded, Share
from polefence.proof.service.claims import Range
from polefence.proof.work import FormatError


def rounding_error(claim: Rounded) -> Fraction:
    """Return a bound on the norm of D.

    Raises
    ------
    FormatError
        If a bound that the claim rests on does not hold.
    """
    if claim.code.K is not None:
        return _fixed(claim)
    return _scheduled(claim)


def in_a_row(code: Code, k: int) -> Fraction:
    """Return the largest relative error of k operations."""
    u = UNITS[code.bits]
    if 2 * k * u >= 1:
        raise FormatError("code: too many operations for its numbers")
    return k * u / (1 - k * u)


def _fixed(claim: Rounded) -> Fraction:
    code, gain = claim.code, claim.gain
    K, own = _gain(claim), code.K or []
    gamma = in_a_row(code, len(K[0]))
    columns = [c for c in gain.columns if isinstance(c, Fraction)]
    return norm(
        [
            [(abs(a - b) + gamma * abs(b)) / s / t for a, b, t in zip(k, o, columns, strict=True)]
            for k, o, s in zip(K, own, gain.rows, strict=True)
        ]
    )


def _gain(claim: Rounded) -> Rationals:
    """Return the one gain of the design; of one vertex Z W^-1."""
    law = claim.gain.subject.design.law
    K = law.K[0] if law.K else right_divide((law.Z or [])[0], (law.W or [])[0])
    if K is None:
        raise FormatError("W is singular")
    return K


def _scheduled(claim: Rounded) -> Fraction:
    code, rows, T = claim.code, claim.gain.rows, claim.code.T or []
    n, u = len(T), UNITS[code.bits]
    W, Z = transformed(claim)
    own_Z = [scaled(z, rows) for z in code.Z]
    terms = in_a_row(code, len(W))
    formed = (1 + terms) * (1 + weight_error(claim)) - 1  # of sizes of the coefficients
    of_W = formed * _largest(code.W) + _largest(map(_difference, code.W, W))
    of_Z = formed * _largest(own_Z) + _largest(map(_difference, own_Z, Z))
    of_L = in_a_row(code, 3 * n + 4) / (1 - in_a_row(code, n + 2))
    of_W += of_L * (_require_bounds(claim, W, Z) + n * of_W)
    of_Z += in_a_row(code, n) * (1 + formed) * _largest(own_Z)
    if of_W >= claim.smallest:
        raise FormatError(f"rounding with u = {float(u):.0e} may make W singular")
    size = claim.size
    error = (of_Z + size * of_W) / (claim.smallest - of_W)
    of_T = in_a_row(code, n) * norm(product(_absolute(T), _absolute(_inverse(T))))
    return error * (1 + of_T) + size * of_T


def _require_bounds(claim: Rounded, W: list[Rationals], Z: list[Rationals]) -> Fraction:
    """Prove W' > smallest I and, by W'^2 > Z'^T Z' / size^2, |K'| < size; bound W's trace."""
    design = claim.gain.subject.design
    sizes, degree, times = simplices(design), design.law.degree, claim.elevation
    common = _denominator([*W, *Z], 8 * MAX_BITS)
    P, Q = (_bernstein([_integers(x, common) for x in each], sizes, degree) for each in (W, Z))
    trace = Fraction(0)
    for e, own in _elevated(P, sizes, times).items():
        count = _binomial(e, sizes)
        trace = max(trace, Fraction(sum(own[i][i] for i in range(len(own))), count * common))
        if not is_positive_definite(_above(own, claim.smallest * common * count)):
            raise FormatError("W' is not proved to be above the bound given")
    squares = _elevated(_multiplied(P, P), sizes, times)
    for e, below in _elevated(Q, sizes, degree + times).items():
        corner = claim.size**2 * _binomial(e, sizes)
        if not is_positive_definite(_bordered(squares[e], below, corner)):
            raise FormatError("Z' W'^-1 is not proved to be below the bound given")
    return trace


def _above(matrix: Integers, floor: Fraction) -> Integers:
    """Return the matrix less a multiple of I, times a positive integer."""
    return [
        [value * floor.denominator - floor.numerator * (i == j) for j, value in enumerate(row)]
        for i, row in enumerate(matrix)
    ]


def _bordered(square: Integers, below: Integers, corner: Fraction) -> Integers:
    """Return [ W'^2, Z'^T ; Z', corner I ] times a positive integer."""
    whole = corner.denominator
    lower = _times(whole, below)
    upper = [row + [z[i] for z in lower] for i, row in enumerate(_times(whole, square))]
    own = corner.numerator
    return upper + [
        row + [own * (i == j) for j in range(len(lower))] for i, row in enumerate(lower)
    ]


def transformed(claim: Rounded) -> tuple[list[Rationals], list[Rationals]]:
    """Return T W T' and S^-1 Z T' of the design's law."""
    law, T = claim.gain.subject.design.law, claim.code.T or []
    right = [list(column) for column in zip(*T, strict=True)]
    W = [product(product(T, w), right) for w in law.W or []]
    return W, [product(scaled(z, claim.gain.rows), right) for z in law.Z or []]


def weight_error(claim: Rounded) -> Fraction:
    """Return a bound on the sum of the errors of the Bernstein polynomials' values."""
    code, subject = claim.code, claim.gain.subject
    sizes, degree = simplices(subject.design), subject.design.law.degree
    corners = len(subject.design.A)
    products = in_a_row(code, len(sizes) * degree + 1)  # a large multinomial is rounded too
    if not code.shares:  # cut, summed, scaled, and for a box summed again
        own = in_a_row(code, 2 * corners + 2)
        return (1 + own) ** (degree * len(sizes)) * (1 + products) - 1
    pairs = zip(code.shares, subject.ranges, strict=True)
    each = [2 * share_error(code, share, given) + UNITS[code.bits] for share, given in pairs]
    total = prod((1 + error for error in each), start=Fraction(1))
    if len(sizes) == 1 < len(each):  # alpha, the product of the parameters' weights
        total *= 1 + in_a_row(code, len(each) - 1)
    return total**degree * (1 + products) - 1


def share_error(code: Code, share: Share, given: Range) -> Fraction:
    """Return how far the share of one parameter may be off."""
    width = given.high - given.low
    scale = given.high / width if given.inverted else 1 / width
    if not (share.low <= given.low < given.high <= share.high):
        raise FormatError("a parameter is clamped inside its interval")
    if given.inverted and share.low <= 0 <= share.high:
        raise FormatError("a parameter's bounds in the code touch zero")
    least = min(abs(share.low), abs(share.high)) if given.inverted else Fraction(1)
    own = share.high - share.low
    constants = abs(share.scale - scale) * own + abs(scale) * (given.low - share.low)
    return (constants + in_a_row(code, 3) * abs(share.scale) * own) / least


# --- matrices ------------------------------------------------------------------------------------


def _difference(left: Rationals, right: Rationals) -> Rationals:
    return [[a - b for a, b in zip(p, q, strict=True)] for p, q in zip(left, right, strict=True)]


def _absolute(matrix: Rationals) -> Rationals:
    return [[abs(value) for value in row] for row in matrix]


def _inverse(lower: Rationals) -> Rationals:
    """Return the inverse of a lower triangular matrix."""
    n = len(lower)
    if any(lower[i][j] for i in range(n) for j in range(i + 1, n)):
        raise FormatError("code.T must be lower triangular")
    if not all(lower[i][i] for i in range(n)):
        raise FormatError("code.T is singular")
    return right_divide([[Fraction(int(i == j)) for j in range(n)] for i in range(n)], lower) or []


def _largest(matrices: Iterable[Rationals]) -> Fraction:
    return max(map(norm, matrices))
