"""The linear matrix inequalities of each claim, one matrix a coefficient of its polynomial."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from itertools import permutations, product

from polefence.proof.matrices import Integers, _sum, _times
from polefence.proof.placement import _block, _integral
from polefence.proof.polynomials import (
    Exponent,
    Polynomial,
    _add,
    _elevated,
    _multiple,
    _plus,
    _weighted,
)
from polefence.proof.regions import Part, _characteristic_pairs
from polefence.proof.service.border import border_of
from polefence.proof.service.claims import Estimate, Gain, Rate, ServiceClaim, Subject
from polefence.proof.service.given import perturbed
from polefence.proof.service.pieces import (
    Cell,
    Family,
    cells,
    composed,
    estimates,
    family_of,
    loop,
    parts_of,
    total,
)

Named = Iterator[tuple[str, Integers]]


def blocks(claim: ServiceClaim) -> Named:
    """Yield each inequality's name and its matrix, times a positive integer."""
    if isinstance(claim, Gain) and claim.subject.design.method == "lyapunov":
        yield from perturbed(claim)
        return
    if isinstance(claim, Estimate):
        for number, parts in parts_of(claim.subject.design):
            family = family_of(claim.subject, number)
            for cell in estimates(claim, family.degree > 0):
                yield from _estimated(family, cell, claim, parts)
        return
    family = family_of(claim.subject, claim.part if isinstance(claim, Rate) else 0)
    for cell in cells(claim.subject):
        if isinstance(claim, Gain):
            yield from _perturbed(family, cell, claim)
        else:
            yield from _moving(family, cell, claim)


def _raised(P: Polynomial, cell: Cell, subject: Subject) -> Polynomial:
    return _elevated(P, cell.sizes[: cell.raised], subject.elevation)


def _order(family: Family, cell: Cell, subject: Subject) -> list[Exponent]:
    """Return the monomials of the inequalities: the law's own coordinates are not raised."""
    degree = family.degree + 1 + subject.elevation
    own = (family.degree,) * (len(cell.sizes) - cell.raised)
    return cell.order((degree,) * cell.raised + own)


def _name(what: str, e: Exponent, cell: Cell) -> str:
    powers = " ".join(f"c{j + 1}^{power}" for j, power in enumerate(e) if power)
    return f"{what} at {powers}{cell.name}"


def _positive(X: Polynomial, order: list[Exponent], cell: Cell, parts: tuple[Part, ...]) -> Named:
    """W > 0, which the inequality of a disk implies."""
    if any(part.kind != "disk" for part in parts):
        for e in order:
            yield _name("of W", e, cell), X[e]


def _estimated(family: Family, cell: Cell, claim: Estimate, parts: tuple[Part, ...]) -> Named:
    subject = claim.subject
    order = _order(family, cell, subject)
    X, N = (_raised(P, cell, subject) for P in loop(family, cell)[:2])
    yield from _positive(X, order, cell, parts)
    for part in parts:
        for L, M in _characteristic_pairs(part):
            L_, M_, _ = _integral(L, M, family.plant)
            for e in order:
                yield _name(part.kind, e, cell), _block(L_, M_, X[e], N[e])


def _perturbed(family: Family, cell: Cell, claim: Gain) -> Named:
    subject, order = claim.subject, _order(family, cell, claim.subject)
    X, N, AB = loop(family, cell)
    B: Polynomial = {e: [row[family.states :] for row in matrix] for e, matrix in AB.items()}
    one = unit = total(family.sizes, cell.plant)
    for _ in range(family.degree):
        B, one = _weighted(unit, B), _weighted(unit, one)
    X, N, B, one = (_raised(P, cell, subject) for P in (X, N, B, one))
    yield from _positive(X, order, cell, subject.design.region)
    numbers = iter(claim.mu)
    for part in subject.design.region:
        for L, M in _characteristic_pairs(part):
            L_, M_, common = _integral(L, M, family.plant)
            border = border_of(claim, next(numbers), M, (common, family.plant, family.law))
            for e in order:
                F = _block(L_, M_, X[e], N[e])
                yield _name(part.kind, e, cell), border.around(F, X[e], B[e], one[e][0][0])


def _moving(family: Family, cell: Cell, claim: Rate) -> Named:
    """Yield W, and -(N + N' + 2 a W) + dW/dt at every extreme of the rates."""
    subject, length = claim.subject, sum(cell.sizes)
    order = _order(family, cell, subject)
    X, N = (_raised(P, cell, subject) for P in loop(family, cell)[:2])
    for e in order:
        yield _name("of W", e, cell), X[e]
    slopes = [
        (scale, _raised(composed(P, cell.law, length), cell, subject) if scale else {})
        for scale, P in _slopes(family, claim)
    ]
    whole = math.lcm((2 * claim.decay).denominator, *(scale.denominator for scale, _ in slopes))
    decay = int(2 * claim.decay * whole) * family.plant
    still = {e: _block([[decay]], [[whole]], X[e], N[e]) for e in order}
    moved = [_multiple(int(scale * whole) * family.plant, P) for scale, P in slopes]
    for signs in _extremes(claim, len(moved)):
        for e in order:
            F = still[e]
            for sign, P in zip(signs, moved, strict=True):
                F = _sum(F, _times(sign, P[e])) if sign else F
            yield _name(f"signs {signs}", e, cell), F


def _slopes(family: Family, claim: Rate) -> list[tuple[Fraction, Polynomial]]:
    """Return for each parameter, or vertex, its rate times the change of W with it.

    As a rational factor and a polynomial of degree ``family.degree`` + 1, times ``family.law``.
    """
    if claim.rates is None or family.degree == 0:
        return []
    sizes, length = family.sizes, sum(family.sizes)
    unit = [tuple(int(j == k) for j in range(length)) for k in range(length)]
    sums: list[Polynomial] = [
        {unit[j]: [[1]] for j in range(sum(sizes[:f]), sum(sizes[: f + 1]))}
        for f in range(len(sizes))
    ]
    if not claim.subject.ranges:
        ones = (sums[0], sums[0])
        return [
            (claim.rates[0], _weighted(ones[1], _weighted(ones[0], _derivative(family.W, k))))
            for k in range(length)
        ]
    found = []
    for f, (r, rate) in enumerate(zip(claim.subject.ranges, claim.rates, strict=True)):
        P = _plus(_derivative(family.W, 2 * f + 1), _multiple(-1, _derivative(family.W, 2 * f)))
        low, high = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
        scale, factor = rate / abs(high - low), sums[f]
        if r.inverted:  # the scheduling variable s = 1/p changes with s^2 dp/dt
            common = math.lcm(low.denominator, high.denominator)
            ends = (low * common, high * common)
            factor = {unit[2 * f + c]: [[int(end)]] for c, end in enumerate(ends)}
            scale /= common**2
        for form in (factor, factor, *(s for g, s in enumerate(sums) if g != f)):
            P = _weighted(form, P)
        found.append((scale, P))
    return found


def _derivative(P: Polynomial, k: int) -> Polynomial:
    """Return the derivative by coordinate k, of one degree less in its simplex."""
    result: Polynomial = {}
    for e, matrix in P.items():
        if e[k]:
            _add(result, (*e[:k], e[k] - 1, *e[k + 1 :]), _times(e[k], matrix))
    return result


def _extremes(claim: Rate, count: int) -> Iterator[tuple[int, ...]]:
    """Yield the signs of all rates; without parameters weight goes from one vertex to another."""
    rates = claim.rates
    if not count or rates is None or not any(rates):
        yield (0,) * count
    elif claim.subject.ranges:
        yield from product(*((-1, 1) if rate else (0,) for rate in rates))
    elif count == 1:
        yield (0,)
    else:
        for to, off in permutations(range(count), 2):
            yield tuple(int(k == to) - int(k == off) for k in range(count))
