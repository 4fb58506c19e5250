"""Transfer functions that are given, and matrices of them: realised in exact rationals.

A realisation has no state that the inputs do not move or the outputs do not show. Common factors of
a numerator and its denominator are cancelled: of a transfer function nothing else is known.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, PlantError, SpecError, shown
from polefence.plant.expression import RationalFunction, counted, evaluate
from polefence.plant.larger import MOST_GIVEN
from polefence.plant.parameters import exact
from polefence.plant.system import Exact
from polefence.proof.matrices import ONE, ZERO

MOST_ENTRIES = 400
LETTERS = ("s", "z")
_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")

Coefficients = list[Fraction]  # of descending powers, the first not zero; none of zero
Quotient = tuple[Coefficients, Coefficients]


def letters_in(text: str) -> set[str]:
    """Return the names in an expression."""
    return set(_WORD.findall(text))


def read_quotient(entry: Any, what: str) -> tuple[Quotient, str]:
    """Return numerator and denominator of an entry, a number or a text, and its letter.

    The letter is "s", "z", or "" of a number.

    Raises
    ------
    InputError
        If it is neither, or has another name in it.
    """
    if not isinstance(entry, str):
        return ([*_trimmed([exact(entry, what)])], [ONE]), ""
    letter = next((letter for letter in LETTERS if letter in letters_in(entry)), "")
    variable = RationalFunction.variable(0, 1)
    try:
        with counted():
            value = evaluate(entry, {letter or "s": variable}, RationalFunction.constant(ONE, 1))
    except (SpecError, PlantError) as problem:
        raise type(problem)(f"{what}: {problem}") from problem
    return (_descending(value.numerator), _descending(value.denominator)), letter


def quotient(numerator: Any, denominator: Any, what: str) -> Quotient:
    """Return a quotient of coefficients of descending powers.

    Raises
    ------
    InputError
        If they are no numbers, or the denominator is zero.
    """
    top, bottom = (
        _trimmed([exact(x, f"{what}: {name}") for x in _row(value, f"{what}: {name}")])
        for name, value in (("numerator", numerator), ("denominator", denominator))
    )
    if not bottom:
        raise InputError(f"{what}: the denominator is zero; give its coefficients")
    return top, bottom


def of_roots(zeros: Any, poles: Any, gain: Any, what: str) -> Quotient:
    """Return the quotient of zeros, poles and a gain; complex ones in conjugate pairs.

    Raises
    ------
    InputError
        If they are no numbers, or a complex one has no conjugate.
    """
    k = exact(number(gain, f"{what}: gain"), f"{what}: gain")
    top, bottom = (
        _product_of_roots(value, f"{what}: {name}")
        for name, value in (("zeros", zeros), ("poles", poles))
    )
    return _trimmed([k * x for x in top]), bottom


def realised(rows: Sequence[Sequence[Quotient]], what: str) -> tuple[Exact, Exact, Exact, Exact]:
    """Return A, B, C and D of a matrix of quotients, with as few states as there can be.

    Raises
    ------
    InputError
        If one is improper, or there are too many states.
    """
    count = len(rows[0])
    if len(rows) * count > MOST_ENTRIES:
        raise InputError(f"{what}: {len(rows)} x {count} entries; at most {MOST_ENTRIES}")
    for i, row in enumerate(rows):
        for j, (top, bottom) in enumerate(row):
            if len(top) > len(bottom):
                where = f"{what}[{i + 1}][{j + 1}]" if len(rows) * count > 1 else what
                raise InputError(
                    f"{where}: the numerator has degree {len(top) - 1}, the denominator "
                    f"{len(bottom) - 1}; divide by a fast pole, such as (s/1000 + 1)"
                )
    blocks, D = list[tuple[int, list[Coefficients], Coefficients]](), [[ZERO] * count for _ in rows]
    for j in range(count):
        column = [row[j] for row in rows]
        common = [ONE]
        for _, bottom in column:
            _require_few(len(bottom) - 1, what)
            common = _least_common(common, bottom)
        _require_few(len(common) - 1 + sum(len(former) - 1 for _, _, former in blocks), what)
        remainders = []
        for i, (top, bottom) in enumerate(column):
            whole = _times(top, _divided(common, bottom)[0])
            (D[i][j], rest) = _constant_and_rest(whole, common)
            remainders.append(rest)
        blocks.append((j, remainders, common))
    k = sum(len(common) - 1 for _, _, common in blocks)
    A, B = [[ZERO] * k for _ in range(k)], [[ZERO] * count for _ in range(k)]
    C, at = [[ZERO] * k for _ in rows], 0
    for j, remainders, common in blocks:
        own = len(common) - 1
        for i in range(own - 1):
            A[at + i][at + i + 1] = ONE
        for i in range(own):
            A[at + own - 1][at + i] = -common[own - i]
        if own:
            B[at + own - 1][j] = ONE
        for i, rest in enumerate(remainders):
            for power, x in enumerate(reversed(rest)):
                C[i][at + power] = x
        at += own
    A, B, C = _seen(A, B, C)
    A, B, C = _evened(A, B, C)
    return _frozen(A), _frozen(B), _frozen(C), _frozen(D)


def _require_few(states: int, what: str) -> None:
    if states > MOST_GIVEN:
        raise InputError(f"{what}: {states} states or more; at most {MOST_GIVEN} are supported")


def _seen(A: Any, B: Any, C: Any) -> tuple[Any, Any, Any]:
    """Return the part of a system that its outputs show: rows R with R A = A' R and C = C' R."""
    n, rows, pivots = len(A), list[list[Fraction]](), list[int]()
    waiting = [list(row) for row in C]
    while waiting and len(rows) < n:
        row = _reduced(waiting.pop(0), rows, pivots)
        pivot = next((j for j, x in enumerate(row) if x), None)
        if pivot is None:
            continue
        row = [x / row[pivot] for x in row]
        for other in rows:
            factor = other[pivot]
            other[:] = [x - factor * y for x, y in zip(other, row, strict=True)]
        rows.append(row)
        pivots.append(pivot)
        waiting.append(_rowed(row, A))
    if len(rows) == n:
        return A, B, C
    # of a row in their span the coefficients stand where the pivots are
    taken = [[row[p] for p in pivots] for row in (_rowed(row, A) for row in rows)]
    moved = [[sum((x * b[j] for x, b in zip(row, B, strict=True)), ZERO) for j in range(len(B[0]))]
             for row in rows]  # fmt: skip
    return taken, moved, [[row[p] for p in pivots] for row in C]


def _reduced(row: list[Fraction], rows: list[list[Fraction]], pivots: list[int]) -> list[Fraction]:
    for other, pivot in zip(rows, pivots, strict=True):
        factor = row[pivot]
        if factor:
            row = [x - factor * y for x, y in zip(row, other, strict=True)]
    return row


def _rowed(row: Sequence[Fraction], A: Sequence[Sequence[Fraction]]) -> list[Fraction]:
    used = [(x, a) for x, a in zip(row, A, strict=True) if x]
    return [sum((x * a[j] for x, a in used), ZERO) for j in range(len(A))]


def _evened(A: Any, B: Any, C: Any) -> tuple[Any, Any, Any]:
    """Return the system with states in even units: powers of two, so that nothing is rounded."""
    if not A:
        return A, B, C
    from scipy.linalg import matrix_balance  # `check` starts without it

    floats = np.array([[float(x) for x in row] for row in A])
    _, (scale, _) = matrix_balance(floats, permute=False, separate=True)
    units = [Fraction(2) ** round(math.log2(x)) for x in scale]
    acts = max((abs(x) / u for row, u in zip(B, units, strict=True) for x in row), default=ZERO)
    shows = max((abs(x) * u for row in C for x, u in zip(row, units, strict=True)), default=ZERO)
    if acts and shows:
        whole = Fraction(2) ** round((math.log2(acts) - math.log2(shows)) / 2)
        units = [u * whole for u in units]
    A = [[x * v / u for x, v in zip(row, units, strict=True)]
         for row, u in zip(A, units, strict=True)]  # fmt: skip
    B = [[x / u for x in row] for row, u in zip(B, units, strict=True)]
    return A, B, [[x * u for x, u in zip(row, units, strict=True)] for row in C]


# --- polynomials of one variable -----------------------------------------------------------------


def _constant_and_rest(top: Coefficients, monic: Coefficients) -> tuple[Fraction, Coefficients]:
    """Return q and r of top / monic = q + r / monic, q a number."""
    whole, rest = _divided(top, monic)
    return (whole[0] if whole else ZERO), rest


def _divided(p: Coefficients, q: Coefficients) -> tuple[Coefficients, Coefficients]:
    """Return quotient and remainder."""
    rest, whole = list(p), list[Fraction]()
    while len(rest) >= len(q):
        factor = rest[0] / q[0]
        whole.append(factor)
        padded = [*q, *[ZERO] * (len(rest) - len(q))]
        rest = [x - factor * y for x, y in zip(rest, padded, strict=True)][1:]
    return _trimmed(whole), _trimmed(rest)


def _least_common(p: Coefficients, q: Coefficients) -> Coefficients:
    """Return the monic least common multiple."""
    a, b = p, q
    while b:
        a, b = b, _divided(a, b)[1]
        b = [x / b[0] for x in b] if b else b
    product = _times(p, _divided(q, a)[0])
    return [x / product[0] for x in product]


def _times(p: Coefficients, q: Coefficients) -> Coefficients:
    total = [ZERO] * (len(p) + len(q) - 1) if p and q else []
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            total[i + j] += x * y
    return total


def _trimmed(p: Iterable[Fraction]) -> Coefficients:
    coefficients = list(p)
    while coefficients and not coefficients[0]:
        coefficients.pop(0)
    return coefficients


def _descending(polynomial: dict[tuple[int, ...], Fraction]) -> Coefficients:
    degree = max((e[0] for e in polynomial), default=-1)
    return [polynomial.get((k,), ZERO) for k in range(degree, -1, -1)]


# --- what is given -------------------------------------------------------------------------------


def _row(value: Any, what: str) -> list[Any]:
    """Return numbers in a row: a list, an array of one row or column, one number."""
    array = np.asarray(value, dtype=object)
    if isinstance(value, str):
        raise InputError(f"{what} must be coefficients, [1, 50] of s + 50")
    if array.ndim > 2 or (array.ndim == 2 and 1 not in array.shape):
        raise InputError(f"{what} must be coefficients in one row, [1, 50] of s + 50")
    if array.size > MOST_GIVEN + 1:
        raise InputError(
            f"{what}: {array.size} coefficients; at most {MOST_GIVEN + 1} are supported"
        )
    return [number(x, what) for x in array.ravel()]


def number(value: Any, what: str) -> Any:
    """Return a number, of an array of one entry or of a text such as "1/3", as Python has it.

    Raises
    ------
    InputError
        If a text is no number.
    """
    value = _number(value)
    if not isinstance(value, str):
        return value
    fault = f'{what} = {shown(value)} is not a number; write 0.5, or "1/3"'
    try:
        (top, bottom), letter = read_quotient(value, what)
    except InputError as problem:
        raise InputError(fault) from problem
    if letter:
        raise InputError(fault)
    return top[0] / bottom[0] if top else ZERO


def _number(value: Any) -> Any:
    """Return a number of NumPy, or of an array of one entry, as Python has it."""
    array = np.asarray(value, dtype=object)
    inner = array.ravel()[0] if array.size == 1 else value
    return inner.item() if isinstance(inner, np.generic) else inner


def _product_of_roots(value: Any, what: str) -> Coefficients:
    product = [ONE]
    for factor in _factors(list(_roots(value, what)), what):
        product = _times(product, factor)
    return product


def _roots(value: Any, what: str) -> Iterator[tuple[Fraction, Fraction]]:
    """Yield roots: numbers, texts such as "-1+2j", or pairs [real, imaginary]."""
    array = np.asarray(value, dtype=object)
    if array.size > MOST_GIVEN:
        raise InputError(f"{what}: {array.size} numbers; at most {MOST_GIVEN} are supported")
    if array.ndim == 2 and array.shape[1] == 2 and isinstance(value, list):
        yield from ((exact(a, what), exact(b, what)) for a, b in value)
        return
    for entry in array.ravel():
        if isinstance(entry, Fraction) or (isinstance(entry, str) and "/" in entry):
            yield exact(number(entry, what), what), ZERO
            continue
        try:
            text = entry.replace(" ", "").replace("i", "j") if isinstance(entry, str) else entry
            root = complex(text)
        except (TypeError, ValueError, OverflowError) as problem:
            raise InputError(
                f"{what}: {shown(entry)} is no number; write -3, or -1+2j and -1-2j"
            ) from problem
        if not (math.isfinite(root.real) and math.isfinite(root.imag)):
            raise InputError(f"{what}: {shown(entry)} must be finite")
        yield Fraction(root.real), Fraction(root.imag)


def _factors(roots: list[tuple[Fraction, Fraction]], what: str) -> Iterator[Coefficients]:
    while roots:
        a, b = roots.pop()
        if not b:
            yield [ONE, -a]
            continue
        if (a, -b) not in roots:
            root = complex(float(a), float(b))
            raise InputError(f"{what}: {root:g} has no conjugate; give both")
        roots.remove((a, -b))
        yield [ONE, -2 * a, a * a + b * b]


def _frozen(matrix: Any) -> Exact:
    return tuple(tuple(row) for row in matrix)
