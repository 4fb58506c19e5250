"""Distance of convex combinations of the vertices' steps from the plant's step between them.

With M(alpha) = [A, B] Ts in the claim's coordinates the exact step is

    [I, 0] + sum of A^(k - 1) M / k!  over k >= 1,    A the square part of M,

and its first p terms are a polynomial in alpha of degree p. So is the combination of the vertices'
steps; a polynomial is at most as large as the largest of its Bernstein coefficients, and these are
whole numbers over a known one. The entries of M are first rounded to multiples of 2^-48: with
|M|_F <= b after and d more before, that changes the step by at most d exp(b + d); and the terms
left out sum to at most b^(p + 1) / (p + 1)! / (1 - b / (p + 2)).

Rationals and the standard library only.
"""

from __future__ import annotations

import math
from fractions import Fraction

from polefence.proof.definite import is_positive_definite
from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    _denominator,
    _integers,
    _times,
    norm,
    root,
)
from polefence.proof.matrices import (
    rational_product as product,
)
from polefence.proof.polynomials import (
    MAX_COEFFICIENTS,
    Polynomial,
    _binomial,
    _elevated,
    _number,
    _plus,
    _product,
    monomials,
)
from polefence.proof.sampling.claims import Sampled
from polefence.proof.sampling.loop import (
    identity,
    inverse,
    rows,
    transformed,
    transformed_gain,
    vertices,
)
from polefence.proof.work import FormatError

BITS = 48  # of entries of M after the point
MAX_TERMS = 60
MAX_PRODUCTS = 2 * 10**7  # of two entries
EXP_TERMS = 40
SHORT = 256  # bits after the point


def step_error(claim: Sampled, sizes: tuple[int, ...]) -> Fraction:
    """Return a bound on the Frobenius norm of the error of [F, G], over the whole family.

    Raises
    ------
    FormatError
        If the series has too few terms for this sample time, or would take too long.
    """
    _require_moderate(claim, sizes)
    exact = [[[x * claim.sample_time for x in row] for row in M] for M in vertices(claim)]
    whole = [[[round(x * 2**BITS) for x in row] for row in M] for M in exact]
    n, width = len(whole[0]), len(whole[0][0])
    size = max(norm([[Fraction(x, 2**BITS) for x in row] for row in M]) for M in whole)
    off = root(Fraction(n * width)) / (1 << (BITS + 1))
    p = claim.terms
    if 2 * size >= p + 2:
        raise FormatError("sampling.terms are too few for this sample time")
    power: Fraction = size ** (p + 1)
    tail = power / math.factorial(p + 1) / (1 - size / (p + 2))
    return _largest(claim, sizes, whole) + tail + off * exponential(size + off)


def exponential(x: Fraction) -> Fraction:
    """Return a little more than e^x, for x from 0 to 20."""
    if not 0 <= x <= EXP_TERMS // 2:
        raise FormatError("sampling: the sample time is too long for these rates")
    term = total = Fraction(1)
    for k in range(1, EXP_TERMS + 1):
        term = _short(term * x / k)
        total += term
    return total + term  # what is left is below a geometric series of ratio 1/2


def _short(value: Fraction) -> Fraction:
    """Round up to a number of few digits."""
    whole = 2**SHORT
    return Fraction(-(-value.numerator * whole // value.denominator), whole)


def _largest(claim: Sampled, sizes: tuple[int, ...], M: list[Integers]) -> Fraction:
    """Return a bound on the combination of steps less the terms of the series."""
    p, n = claim.terms, len(M[0])
    eye = [row + [Fraction(0)] * (len(M[0][0]) - n) for row in identity(n)]
    moved = [
        [[a - b for a, b in zip(*pair, strict=True)] for pair in zip(step, eye, strict=True)]
        for step in claim.steps
    ]
    common = _denominator(moved, 2 * MAX_BITS)
    corners = monomials(sizes, 1)
    own: Polynomial = {e: _integers(F, common) for e, F in zip(corners, moved, strict=True)}
    own = _elevated(own, sizes, p - 1)
    series, unit = _series(dict(zip(corners, M, strict=True)), sizes, p)
    largest = Fraction(0)
    for e, value in series.items():
        over = _binomial(e, sizes)
        square = sum(
            (a * unit - b * common) ** 2
            for pair in zip(own[e], value, strict=True)
            for a, b in zip(*pair, strict=True)
        )
        largest = max(largest, Fraction(square, (common * unit * over) ** 2))
    return root(largest)


def _series(M: Polynomial, sizes: tuple[int, ...], p: int) -> tuple[Polynomial, int]:
    """Return the sum of A^(k - 1) M / k! for k from 1 to p, times the whole number returned.

    By Horner's scheme: R_p = M, R_k = M + A R_(k + 1) / (k + 1).
    """
    n = len(next(iter(M.values())))
    A: Polynomial = {e: [row[:n] for row in matrix] for e, matrix in M.items()}
    R, unit = M, 1  # R comes times unit 2^BITS
    lead = M
    for k in range(p - 1, 0, -1):
        unit *= (k + 1) << BITS
        lead = _elevated(lead, sizes, 1)
        R = _plus({e: _times(unit, matrix) for e, matrix in lead.items()}, _product(A, R))
    return R, unit << BITS


def _require_moderate(claim: Sampled, sizes: tuple[int, ...]) -> None:
    p, n = claim.terms, len(claim.T)
    each = len(claim.steps) * n * n * (n + len(claim.scale))
    work = sum(_number(sizes, k) for k in range(1, p)) * each
    if _number(sizes, p) > MAX_COEFFICIENTS or work > MAX_PRODUCTS:
        raise FormatError("sampling: these are more terms than are computed here")


def gain_error(claim: Sampled) -> Fraction:
    """Return the size of an error of v that the claim allows, over its rows' scales."""
    off = claim.off
    if off is None or not off.error:
        return Fraction(0)
    same = off.columns == claim.T
    return off.error * (1 if same else norm(product(off.columns, inverse(claim.T)))) / claim.weight


def held_size(claim: Sampled) -> Fraction:
    """Return a bound on |(I, K')|, by which an error of [F, G] acts on y where there is no delay.

    Raises
    ------
    FormatError
        If the bounds on the law that the claim gives do not hold.
    """
    if claim.design.law.K is not None:
        gain = norm(transformed_gain(claim))
    else:
        _require_bounds(claim)
        gain = root(claim.energy / claim.smallest)
    gain += gain_error(claim) * max(rows(claim))
    return root(1 + gain * gain)


def _require_bounds(claim: Sampled) -> None:
    W, Z = transformed(claim)
    if claim.smallest <= 0 or claim.energy <= 0:
        raise FormatError("sampling.smallest and sampling.energy must be positive")
    common = _denominator([*W, *Z, [[claim.smallest, claim.energy]]], 8 * MAX_BITS)
    low, high = int(claim.smallest * common), int(claim.energy * common)
    for w, z in zip(W, Z, strict=True):
        own, below = _integers(w, common), _integers(z, common)
        if not is_positive_definite(_less(own, low)):
            raise FormatError("sampling: W is not above the bound given")
        corner = [[high * (i == j) for j in range(len(below))] for i in range(len(below))]
        whole = [
            row + list(column) for row, column in zip(own, zip(*below, strict=True), strict=True)
        ]
        whole += [row + unit for row, unit in zip(below, corner, strict=True)]
        if not is_positive_definite(whole):
            raise FormatError("sampling: Z W^-1 Z' is not below the bound given")


def _less(matrix: Integers, low: int) -> Integers:
    return [[value - low * (i == j) for j, value in enumerate(row)] for i, row in enumerate(matrix)]
