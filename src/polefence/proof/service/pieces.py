"""The plant and the law as polynomials in coordinates of pieces of the parameters' intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product

from polefence.proof.matrices import MAX_BITS, _denominator, _integers, _times, bits
from polefence.proof.placement import Claim, _fraction, _multiplier, simplices
from polefence.proof.polynomials import (
    COORDINATES,
    Exponent,
    Polynomial,
    _add,
    _bernstein,
    _multiple,
    _plus,
    _product,
    _spend_exponents,
    _weighted,
    monomials,
)
from polefence.proof.regions import Part
from polefence.proof.service.claims import Estimate, Range, Subject
from polefence.proof.work import FormatError, spend

_Ends = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Family:
    """[A, B] of degree 1 and [X; K X] of ``degree`` in each simplex, over whole numbers.

    X is W, and K X = Z, unless the law was given. They come times ``plant`` and ``law``.
    """

    sizes: tuple[int, ...]
    AB: Polynomial
    WZ: Polynomial
    states: int
    degree: int
    plant: int
    law: int

    @property
    def W(self) -> Polynomial:
        """W alone."""
        return {e: matrix[: self.states] for e, matrix in self.WZ.items()}


def degree_of(design: Claim, part: int = 0) -> int:
    """Return the degree of X."""
    if design.method == "scheduled":
        return design.law.degree
    if design.method == "lyapunov":
        own = 2 * design.law.degree if design.law.K is None else 0
        return design.evidence[part].degree + own
    return 0


def parts_of(design: Claim) -> Iterator[tuple[int, tuple[Part, ...]]]:
    """Yield each X by its number, with the parts of the region that it is for."""
    if design.method == "lyapunov":
        yield from ((k, (part,)) for k, part in enumerate(design.region))
    else:
        yield 0, design.region


def _law_of(design: Claim, part: int) -> tuple[Polynomial, int]:
    """Return [X; K X] as a polynomial of the law's own domain, and what it comes times."""
    sizes = simplices(design)
    if design.method == "scheduled":
        W, Z = design.law.W or [], design.law.Z or []
        law = _denominator([*W, *Z], 4 * MAX_BITS)
        return _fraction(design.law, sizes, law)[1], law
    if design.method not in ("quadratic", "lyapunov"):
        raise FormatError(f"the method {design.method} has no proofs for service")
    evidence = design.evidence[part]
    own = _denominator([*evidence.X, [list(evidence.multiple)]], 2 * MAX_BITS)
    Q = _bernstein([_integers(x, own) for x in evidence.X], sizes, evidence.degree)
    if design.law.K is None:
        D = _denominator([*(design.law.W or []), *(design.law.Z or [])], 2 * MAX_BITS)
        W_, WZ = _fraction(design.law, sizes, D)
        V = _multiplier(W_, Q, evidence, sizes, (design.law.degree, D, own))
        return _product(WZ, V), own * D**2
    (K,) = design.law.K
    D, n = _denominator([K], 2 * MAX_BITS), range(len(K[0]))
    eye = [[D * (i == j) for j in n] for i in n]
    return _product({(0,) * sum(sizes): eye + _integers(K, D)}, Q), own * D


def family_of(subject: Subject, part: int = 0) -> Family:
    """Return plant and law on the box of the parameters, or on the simplex without any."""
    design, N = subject.design, len(subject.design.A)
    sizes = (2,) * len(subject.ranges) or (N,)
    plant = _denominator([*design.A, *design.B])
    corners = monomials(sizes, 1)
    AB = {
        e: [a + b for a, b in zip(_integers(A, plant), _integers(B, plant), strict=True)]
        for e, A, B in zip(corners, design.A, design.B, strict=True)
    }
    WZ, law = _law_of(design, part)
    degree = degree_of(design, part)
    if simplices(design) != sizes:
        WZ = _on_products(WZ, corners) if degree else {(0,) * sum(sizes): next(iter(WZ.values()))}
    return Family(sizes, AB, WZ, len(design.A[0]), degree, plant, law)


def _on_products(P: Polynomial, corners: list[Exponent]) -> Polynomial:
    """Return a polynomial on the simplex as one on the box, at alpha that are products."""
    result: Polynomial = {}
    for e, matrix in P.items():
        columns = zip(*corners, strict=True)
        both = tuple(sum(map(int.__mul__, e, column)) for column in columns)
        _add(result, both, matrix)
    return result


# --- pieces of the parameters' intervals ---------------------------------------------------------


@dataclass(frozen=True)
class Cell:
    """Coordinates of plant and law as forms (1 x 1) in a piece's own coordinates.

    The forms of each simplex of the plant have all keys between them, zero or not. The first
    ``raised`` simplices are elevated.
    """

    name: str
    sizes: tuple[int, ...]
    plant: list[Polynomial]
    law: list[Polynomial]
    raised: int

    def order(self, degrees: tuple[int, ...]) -> list[Exponent]:
        """Return all monomials of these degrees in the simplices."""
        each = [monomials((s,), d) for s, d in zip(self.sizes, degrees, strict=True)]
        return [sum(parts, ()) for parts in product(*each)]


def cells(subject: Subject) -> Iterator[Cell]:
    """Yield the pieces: equal parts of each scheduling variable's interval; or the one simplex."""
    if not subject.ranges:
        N = len(subject.design.A)
        forms = [_linear(0, tuple(int(j == k) for j in range(N)), (N,)) for k in range(N)]
        yield Cell("", (N,), forms, forms, 1)
        return
    pieces = [
        [((count - k, count - k - 1), (k, k + 1)) for k in range(count)] for count in subject.pieces
    ]
    sizes = (2,) * len(pieces)
    for numbers in product(*(range(len(each)) for each in pieces)):
        forms = [
            _linear(f, values, sizes) for f, k in enumerate(numbers) for values in pieces[f][k]
        ]
        yield Cell(f" in piece {_numbered(numbers)}", sizes, forms, forms, len(sizes))


def _numbered(numbers: tuple[int, ...]) -> str:
    return ", ".join(str(k + 1) for k in numbers)


def _linear(f: int, values: tuple[int, ...], sizes: tuple[int, ...]) -> Polynomial:
    """Return the form of these values at the corners of simplex f."""
    start, whole = sum(sizes[:f]), sum(sizes)
    return {
        tuple(int(j == start + c) for j in range(whole)): [[value]]
        for c, value in enumerate(values)
    }


def estimates(claim: Estimate, varies: bool = True) -> Iterator[Cell]:
    """Yield the pieces on which p is affine in its estimate, for all signs of the errors.

    ``varies`` is whether the law does.
    """
    subject = claim.subject
    if not subject.ranges:
        yield from _mislaid(len(subject.design.A), claim.errors[0], varies)
        return
    sizes = (2,) * len(subject.ranges)
    pieces = [
        [_forms(f, r, *ends, sizes) for ends in _segments(r, error, count)]
        for f, (r, error, count) in enumerate(
            zip(subject.ranges, claim.errors, subject.pieces, strict=True)
        )
    ]
    for numbers in product(*(range(len(each)) for each in pieces)):
        chosen = [pieces[f][k] for f, k in enumerate(numbers)]
        plant, law = ([form for each in chosen for form in each[side]] for side in (0, 1))
        yield Cell(f" in piece {_numbered(numbers)}", sizes, plant, law, len(sizes))


def _forms(
    f: int, r: Range, own: _Ends, estimated: _Ends, sizes: tuple[int, ...]
) -> tuple[list[Polynomial], list[Polynomial]]:
    """Return the coordinates of a parameter and of its estimate on one piece."""
    plant, law = (
        [_linear(f, values, sizes) for values in _at_ends(r, ends)] for ends in (own, estimated)
    )
    return plant, law


def _segments(r: Range, error: Fraction, pieces: int) -> list[tuple[_Ends, _Ends]]:
    """Return the ends of p and of its estimate, for every piece and both signs of the error."""
    found = []
    for sign in (-1, 1) if error else (0,):
        bend = r.low + error if sign < 0 else r.high - error  # a bound acts on one side of it
        cuts = {r.low + (r.high - r.low) * k / pieces for k in range(pieces + 1)}
        cuts |= {bend} if r.low < bend < r.high else set()
        for ends in pairwise(sorted(cuts)):
            low, high = (min(max(q + sign * error, r.low), r.high) for q in ends)
            found.append(((low, high), ends))
    return found


def _at_ends(r: Range, ends: _Ends) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the two coordinates at the ends of a piece, times one positive integer.

    Times |p| where they are affine in 1/p: with it they are affine in p.
    """
    low, high = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
    pairs = []
    for p in ends:
        share = ((1 / p if r.inverted else p) - low) / (high - low)
        factor = abs(p) if r.inverted else Fraction(1)
        pairs.append([factor * (1 - share), factor * share])
    whole = _integers(pairs, _denominator([pairs]))
    return (whole[0][0], whole[1][0]), (whole[0][1], whole[1][1])


def _mislaid(N: int, share: Fraction, varies: bool) -> Iterator[Cell]:
    """Yield p = (1 - e) a + e u, q = (1 - e) a + e v for the corners u, in coordinates a and v.

    A law that does not vary with alpha needs no coordinates of q.
    """
    e, rest = share.numerator, share.denominator - share.numerator
    spend(2 * N * (2 * N // COORDINATES), 0)
    unit = [tuple(int(j == k) for j in range(2 * N)) for k in range(2 * N)]
    sums: list[Polynomial] = [{own: [[1]] for own in half} for half in (unit[:N], unit[N:])]
    law = [
        _plus(_weighted(sums[1], {unit[c]: [[rest]]}), _weighted(sums[0], {unit[N + c]: [[e]]}))
        for c in range(N if varies else 0)
    ]
    for u in range(N):
        plant: list[Polynomial] = [{own: [[rest]]} for own in unit[:N]]
        plant[u] = _plus(plant[u], _multiple(e, sums[0]))
        yield Cell(f" towards vertex {u + 1}", (N, N), plant, law, 1)


def composed(P: Polynomial, forms: list[Polynomial], length: int) -> Polynomial:
    """Return P with the forms in place of its coordinates, a polynomial in ``length`` others."""
    products: dict[Exponent, Polynomial] = {(0,) * len(next(iter(P), ())): {(0,) * length: [[1]]}}
    # every key is met by other forms: not all coordinates are zero at any corner of a piece
    forms = [{e: value for e, value in form.items() if value[0][0]} for form in forms]

    def monomial(e: Exponent) -> Polynomial:
        if e not in products:
            j = next(j for j, power in enumerate(e) if power)
            products[e] = _product(forms[j], monomial((*e[:j], e[j] - 1, *e[j + 1 :])))
        return products[e]

    result: Polynomial = {}
    for e, matrix in P.items():
        values, entries = monomial(e), len(matrix) * len(matrix[0])
        spend(len(values) * entries, max(map(bits, values.values()), default=0), bits(matrix))
        _spend_exponents(len(values), values)
        for d, ((value,),) in values.items():
            _add(result, d, _times(value, matrix))
    return result


def loop(family: Family, cell: Cell) -> tuple[Polynomial, Polynomial, Polynomial]:
    """Return X, N, of one degree, and [A, B]; N and [A, B] come times ``family.plant`` besides."""
    length = sum(cell.sizes)
    AB = composed(family.AB, cell.plant, length)
    WZ = composed(family.WZ, cell.law, length)
    X: Polynomial = {e: matrix[: family.states] for e, matrix in WZ.items()}
    return _weighted(total(family.sizes, cell.plant), X), _product(AB, WZ), AB


def total(sizes: tuple[int, ...], forms: list[Polynomial]) -> Polynomial:
    """Return the product over the simplices of the sum of a simplex's forms."""
    result: Polynomial = {}
    start = 0
    for size in sizes:
        own: Polynomial = {}
        for form in forms[start : start + size]:
            _spend_exponents(len(form), form)
            for e, value in form.items():
                _add(own, e, value)
        result = _product(result, own) if result else own
        start += size
    return result
