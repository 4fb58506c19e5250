"""Distance of convex combinations of the vertices' steps from the plant's step between them.

With M(alpha) = [A, B] Ts in the claim's coordinates the exact step is

    [I, 0] + sum of A^(k - 1) M / k!  over k >= 1,    A the square part of M,

and its first p terms are a polynomial in alpha of degree p. So is the combination of the vertices'
steps; a polynomial is at most as large as the largest of its Bernstein coefficients, and these are
whole numbers over a known one. The entries of M are first rounded to multiples of 2^-48: with
|M|_F <= b after and d more before, that changes the step by at most d exp(b + d); and the terms
left out sum to at most b^(p + 1) / (p + 1)! / (1 - b / (p + 2)).
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from polefence.proof.laws import Law
from polefence.proof.matrices import (
    MAX_BITS,
    Integers,
    Rationals,
    common_denominator,
    identity,
    inverse,
    is_positive_definite,
    norm,
    product,
    root,
    scaled,
    whole_numbers,
)
from polefence.proof.polynomials import (
    Polynomial,
    Sizes,
    bernstein,
    constant,
    count_of,
    multinomial,
)
from polefence.proof.reading import MAX_COEFFICIENTS
from polefence.proof.work import RATIONAL, FormatError, WorkError, spend

if TYPE_CHECKING:
    from polefence.proof.claims.sampled import Sampled

BITS = 48  # of entries of M after the point
FURTHER = 30  # terms that are bounded one by one, after those that are summed
EXP_TERMS = 40
SHORT = 256  # bits after the point


def step_error(claim: Sampled, sizes: Sizes) -> Fraction:
    """Return a bound on the Frobenius norm of the error of [F, G], over the whole family.

    Raises
    ------
    FormatError
        If the series has too few terms for this sample time, or would take too long.
    """
    exact = [[[x * claim.sample_time for x in row] for row in M] for M in vertices(claim)]
    series, rounded, tail = series_error(exact, claim.terms, sizes)
    n, width = len(exact[0]), len(exact[0][0])
    eye = [row + [Fraction(0)] * (width - n) for row in identity(n)]
    steps = bernstein(claim.steps, sizes, 1) - constant(eye, sizes)
    return root(_largest_square(steps - series)) + tail + rounded


def series_error(
    M: list[Rationals], terms: int, sizes: Sizes
) -> tuple[Polynomial, Fraction, Fraction]:
    """Return the sum of so many A^(k - 1) M / k!, and what rounding and the others make at most.

    Parameters
    ----------
    M : list of (n, n + m) rationals
        At every vertex, times the step.

    Raises
    ------
    FormatError
        If the series has too few terms for this sample time, or would take too long.
    """
    n, width = len(M[0]), len(M[0][0])
    require_moderate(len(M), n, width, terms, sizes)
    short = [[[Fraction(round(x * 2**BITS), 2**BITS) for x in row] for row in V] for V in M]
    size = max(map(norm, short))
    off = root(Fraction(n * width)) / (1 << (BITS + 1))
    if 2 * size >= terms + 2:
        raise FormatError("the sample time is too long for these rates")
    power: Fraction = size ** (terms + 1)
    tail = power / math.factorial(terms + 1) / (1 - size / (terms + 2))
    return _series(bernstein(short, sizes, 1), terms), off * exponential(size + off), tail


def series_by_entries(
    M: list[Rationals], terms: int, sizes: Sizes
) -> tuple[Polynomial, Rationals, Fraction]:
    """Return what `series_error` does, with what is left out bounded entry by entry.

    With |M| <= M' at the vertices, and so everywhere, A^(k - 1) M / k! is at most
    A'^(k - 1) M' / k!.
    The last number is added to every entry: what rounding makes, and all terms further on.
    """
    n, width = len(M[0]), len(M[0][0])
    require_moderate(len(M), n, width, terms, sizes)
    unit = 2**80  # of entries that are compared one by one
    short = [[[Fraction(round(x * unit), unit) for x in row] for row in matrix] for matrix in M]
    size, last = max(map(norm, short)), terms + FURTHER
    if 2 * size >= last + 2:
        raise FormatError("the sample time is too long for these rates")
    most = [
        [max(map(abs, entries)) for entries in zip(*rows, strict=True)]
        for rows in zip(*short, strict=True)
    ]
    spend(RATIONAL * last * n * n * width, SHORT, SHORT)
    power, left = most, [[Fraction(0)] * width for _ in range(n)]
    for k in range(2, last + 1):
        power = [[_short(x / k) for x in row] for row in product([r[:n] for r in most], power)]
        if k > terms:
            left = [
                [a + b for a, b in zip(*rows, strict=True)]
                for rows in zip(left, power, strict=True)
            ]
    tail = _short(size) ** (last + 1) / math.factorial(last + 1) / (1 - size / (last + 2))
    off = root(Fraction(n * width)) / (2 * unit)
    rest = _short(off * exponential(size + off) + tail)
    return _series(bernstein(short, sizes, 1), terms), left, rest


def exponential(x: Fraction) -> Fraction:
    """Return a little more than e^x, for x from 0 to 20."""
    if not 0 <= x <= EXP_TERMS // 2:
        raise FormatError("the sample time is too long for these rates")
    term = total = Fraction(1)
    for k in range(1, EXP_TERMS + 1):
        term = _short(term * x / k)
        total += term
    return total + term  # what is left is below a geometric series of ratio 1/2


def _short(value: Fraction) -> Fraction:
    """Round up to a number of few digits."""
    whole = 2**SHORT
    return Fraction(-(-value.numerator * whole // value.denominator), whole)


def _largest_square(P: Polynomial) -> Fraction:
    """Return the largest square of the Frobenius norm of a Bernstein coefficient."""
    largest = Fraction(0)
    for e, matrix in P.terms.items():
        square = sum(x * x for row in matrix for x in row)
        largest = max(largest, Fraction(square, (P.whole * multinomial(e, P.sizes)) ** 2))
    return largest


def _series(M: Polynomial, p: int) -> Polynomial:
    """Return the sum of A^(k - 1) M / k! for k from 1 to p.

    By Horner's scheme: R_p = M, R_k = M + A R_(k + 1) / (k + 1).
    """
    A, R, first = M.part(slice(None), slice(M.shape[0])), M, M
    for k in range(p - 1, 0, -1):
        first = first.elevated(1)  # M, of the degree of A R
        R = first + (A * R).times(Fraction(1, k + 1))
    return R


def require_moderate(vertices: int, n: int, width: int, p: int, sizes: Sizes) -> None:
    """Refuse a series of more terms, or larger ones, than are computed here."""
    work = products_of_series(vertices, n, width, p, sizes)
    if count_of(sizes, p) > MAX_COEFFICIENTS or work > 2 * 10**7:
        raise WorkError("the series has too many terms to be computed here")


def products_of_series(vertices: int, n: int, width: int, p: int, sizes: Sizes) -> int:
    """Return how many products of two entries a series of so many terms takes."""
    return sum(count_of(sizes, k) for k in range(1, p)) * vertices * n * n * width


def gain_error(claim: Sampled) -> Fraction:
    """Return the size of an error of v that the claim allows, over its rows' scales."""
    off = claim.off
    if off is None or not off.error:
        return Fraction(0)
    same = off.columns == claim.T
    return (
        off.error
        * (1 if same else norm(product(off.columns, inverse(claim.T, "T"))))
        / claim.weight
    )


def held_size(claim: Sampled) -> Fraction:
    """Return a bound on |(I, K')|, by which an error of [F, G] acts on the loop's state.

    K' has the rows of inputs that act at once; of none this is one.

    Raises
    ------
    FormatError
        If the bounds on the law that the claim gives do not hold.
    """
    law, late = claim.design.law, claim.late
    if late == len(claim.scale):
        return Fraction(1)
    if law.polynomial:
        sizes = replace(claim.design, on=claim.domain).sizes
        gain = root(
            _largest_square(
                transformed_terms(claim).form(sizes).part(slice(len(claim.T) + late, None))
            )
        )
    elif law.K is not None:
        gain = norm(transformed_gain(claim)[late:])
    else:
        _require_bounds(claim)
        gain = root(claim.energy / claim.smallest)
    gain += gain_error(claim) * max(rows(claim)[late:])
    return root(1 + gain * gain)


def _require_bounds(claim: Sampled) -> None:
    W, Z = transformed(claim)
    if claim.smallest <= 0 or claim.energy <= 0:
        raise FormatError("smallest and energy must be positive")
    common = common_denominator([*W, *Z, [[claim.smallest, claim.energy]]], 8 * MAX_BITS)
    low, high = int(claim.smallest * common), int(claim.energy * common)
    for w, z in zip(W, Z, strict=True):
        upper, below = whole_numbers(w, common), whole_numbers(z, common)
        if not is_positive_definite(_less(upper, low)):
            raise FormatError("W is not above the bound given")
        corner = [[high * (i == j) for j in range(len(below))] for i in range(len(below))]
        whole = [
            row + list(column) for row, column in zip(upper, zip(*below, strict=True), strict=True)
        ]
        whole += [row + unit for row, unit in zip(below, corner, strict=True)]
        if not is_positive_definite(whole):
            raise FormatError("Z W^-1 Z' is not below the bound given")


def _less(matrix: Integers, low: int) -> Integers:
    return [[value - low * (i == j) for j, value in enumerate(row)] for i, row in enumerate(matrix)]


# --- in the claim's coordinates ------------------------------------------------------------------


def rows(claim: Sampled) -> tuple[Fraction, ...]:
    """Return the scales of errors of v."""
    scales = claim.off.rows if claim.off else claim.scale
    return tuple(claim.weight * row / s for row, s in zip(scales, claim.scale, strict=True))


def transformed(claim: Sampled) -> tuple[list[Rationals], list[Rationals]]:
    """Return W' and Z'."""
    law, T = claim.design.law, claim.T
    right = [list(column) for column in zip(*T, strict=True)]
    W = [product(product(T, w), right) for w in law.W or []]
    return W, [scaled(product(z, right), claim.scale) for z in law.Z or []]


def transformed_gain(claim: Sampled) -> Rationals:
    """Return K' of a fixed gain."""
    (K,) = claim.design.law.K or [[]]
    return scaled(product(K, inverse(claim.T, "T")), claim.scale)


def transformed_terms(claim: Sampled) -> Law:
    """Return a polynomial law: S^-1 K of its terms, and C T^-1 of what is measured, or the states.

    The names of what is measured are left out.
    """
    law, back = claim.design.law, inverse(claim.T, "T")
    K = [scaled(k, claim.scale) for k in law.K or []]
    C = law.C or (identity(len(back)),) * len(claim.design.A)
    return replace(law, K=K, measured=(), C=tuple(product(rows, back) for rows in C))


def vertices(claim: Sampled) -> list[Rationals]:
    """Return [T A T^-1, T B S] of every vertex."""
    back, loops = inverse(claim.T, "T"), list[Rationals]()
    for A, B in zip(claim.design.A, claim.design.B, strict=True):
        left, right = product(product(claim.T, A), back), product(claim.T, B)
        loops.append(
            [
                a + [x * s for x, s in zip(b, claim.scale, strict=True)]
                for a, b in zip(left, right, strict=True)
            ]
        )
    return loops
