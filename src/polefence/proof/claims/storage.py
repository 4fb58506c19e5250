"""Inequalities of a storage function: what a loop at samples does to a disturbance at all times.

How far disturbances take it is in `polefence.proof.claims.reached`.

Between samples y' = N y + E w and z = Y y + F w, as `polefence.proof.storage` says, and there
V = y'R y or V = (x - c k)'P^-1 (x - c k) + k'R k; at a sample V = s'Q s of all states s. For every
p and t, with derivatives by time,

    [ -(R' + R N + N'R), -R E, -Y' ; *, g I, -F' ; *, *, g I ] > 0

or, with T = [P, c; 0, I] and [A, B] the rows of N that are not zero, of which there are n,

    [ [P', c'; *, -R'] - (N T + T'N'), -E, -T'Y' ; *, g I, -F' ; *, *, g I ] > 0:

V rises by less than g |w|^2 - |z|^2 / g. A law makes y = L W^-1 s of s, L = [X; K], and s = G y
at the next sample. For every p

    W'Q W - L'R L > 0    or  [ W'Q W - K'R K, (X - c K)' ; *, P ] > 0    at t = 0,
    R - G'Q G > 0        or  [ diag(P, R), T'G'Q ; *, Q ] > 0            at t = T:

V never rises at a sample. P is positive definite at first, and later, since P' > A P + P A'. Q is
positive definite everywhere if it is at one vertex, since without w it falls from sample to sample.
No exponential is needed: the plant is that in continuous time, and all of this is polynomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

from polefence.proof.between import Held
from polefence.proof.claims.signal import Rows, Subject, require_shapes
from polefence.proof.matrices import ZERO, Rationals, identity, least_work
from polefence.proof.plant import Output
from polefence.proof.polynomials import (
    Polynomial,
    affine,
    below,
    bernstein,
    constant,
    count_of,
    diagonal,
)
from polefence.proof.storage import Stretch, require_stretches
from polefence.proof.work import FormatError


def require_storage(subject: Subject, held: Held | None) -> None:
    """Refuse a storage function where there is nothing between samples, or that does not fit.

    Raises
    ------
    FormatError
        Saying what does not.
    """
    evidence, size = subject.evidence, subject.n + subject.m
    if held is not None and held.clock is not None:
        raise FormatError("held: with a clock there is no bound at all times of this kind")
    if held is not None and subject.motion:
        raise FormatError("held: a bound at all times is proved for constant parameters only")
    for item in evidence.per_cell:
        if bool(item.storage) != (held is not None):
            raise FormatError("storage: belongs to a bound at all times, and to each of its parts")
        if held is not None and item.spread is not None:
            raise FormatError("storage: is of the plant itself, and has no remainder")
        for k, stretch in enumerate(item.storage):
            require_shapes(stretch.form, len(stretch.form), size, size, f"storage {k + 1}: form")


def least_of_storage(subject: Subject, more: int) -> int:
    """Return the least that it takes to prove inequalities of all stretches, of so many more rows.

    More than those of [x; k].
    """
    rows = subject.n + subject.m + more
    degrees = ((s.degree + 1, s.along) for s in subject.evidence.storage)
    sizes = (*subject.sizes, 2)
    counts = (count_of(sizes, (*(d,) * len(subject.sizes), along)) for d, along in degrees)
    return least_work(sum(counts), rows)


Blocks = list[list[Polynomial]]
DrivenLoop = tuple[Polynomial, Polynomial, Polynomial, Polynomial]  # N, E, [C, D] and F


class Stretched(NamedTuple):
    """A stretch, its length [s], and the loop in it."""

    stretch: Stretch
    length: Fraction
    loop: DrivenLoop


def rows_of_storage(
    subject: Subject,
    outputs: Sequence[Output],
    scales: Sequence[Fraction],
    held: Held,
    level: Fraction,
) -> Rows:
    """Return the blocks that bound the gain at all times.

    Raises
    ------
    FormatError
        If the stretches do not make up the period, or do not follow on one another.
    """
    parts, sizes = stretched(subject, outputs, scales, held), subject.sizes
    Q = bernstein(subject.evidence.X, sizes, subject.evidence.degree)
    begin, end = parts[0].stretch, parts[-1].stretch
    first = len(held.A[0]) if begin.inverse else 0
    rows: Rows = {
        "at a sample": _sampled(subject, Q, begin.at(sizes, end=False), first),
        "at the next": _arrived(subject, held, Q, end.at(sizes, end=True), first),
    }
    for k, part in enumerate(parts):
        rows[f"of the storage, stretch {k + 1}"] = _supplied(*part, level, first)
    return rows


def stretched(
    subject: Subject, outputs: Sequence[Output], scales: Sequence[Fraction], held: Held
) -> list[Stretched]:
    """Return the stretches of a period, each with its loop.

    Raises
    ------
    FormatError
        If they do not make up the period, or do not follow on one another.
    """
    stretches, begin, found = subject.evidence.storage, Fraction(0), list[Stretched]()
    require_stretches(stretches, (1 - held.early,) if held.early else ())
    require_joined(stretches, subject.sizes)
    for stretch in stretches:
        later = bool(held.early) and begin >= 1 - held.early
        loop = loop_of(subject, outputs, scales, held, later)
        found.append(Stretched(stretch, (stretch.end - begin) * subject.step, loop))
        begin = stretch.end
    return found


def _is_zero(P: Polynomial) -> bool:
    return not any(any(map(any, M)) for M in P.terms.values())


def require_joined(stretches: Sequence[Stretch], sizes: tuple[int, ...]) -> None:
    """Refuse stretches of which one begins at another S than the one before ends."""
    for k, (one, other) in enumerate(pairwise(stretches)):
        end, begin = one.at(sizes, end=True), other.at(sizes, end=False)
        if not _is_zero(end - begin):
            raise FormatError(f"storage: stretch {k + 2} begins where stretch {k + 1} ends")


def _sampled(subject: Subject, Q: Polynomial, form: Polynomial, first: int) -> Blocks:
    """Return the blocks that say that what is stored does not rise when the law acts."""
    law = subject.law.form(subject.sizes)
    W, moving, rest = law.part(slice(subject.n)), slice(first), slice(first, None)
    held = law.part(rest)
    before = W.T * Q * W - held.T * form.part(rest, rest) * held
    if not first:
        return [[before]]
    return [
        [before, (law.part(moving) - form.part(moving, rest) * held).T],
        [form.part(moving, moving)],
    ]


def _arrived(subject: Subject, held: Held, Q: Polynomial, form: Polynomial, first: int) -> Blocks:
    """Return the blocks that say that what is stored does not rise when the next sample comes."""
    G = arriving(subject, held)
    if not first:
        return [[form - G.T * Q * G]]
    moving, rest, T = *_chosen(form, first), _turned(form, first)
    return [[moving * form * moving + rest * form * rest, (Q * G * T).T], [Q]]


def _chosen(form: Polynomial, first: int) -> tuple[Polynomial, Polynomial]:
    """Return what leaves of rows those that move, and what leaves the others."""
    ones = [Fraction(k < first) for k in range(form.shape[0])]
    return diagonal(ones, form.sizes), diagonal([1 - x for x in ones], form.sizes)


def _turned(form: Polynomial, first: int) -> Polynomial:
    """Return T = [P, c; 0, I]."""
    moving, rest = _chosen(form, first)
    return moving * form + rest


def arriving(subject: Subject, held: Held) -> Polynomial:
    """Return G: the states at the next sample of [x; u] when the period ends.

    Raises
    ------
    FormatError
        If what moves between samples, or a disturbance, is sampled into the others: what either was
        at the last sample is not known when the period ends.
    """
    n, m, first, sizes = subject.n, subject.m, len(held.A[0]), subject.sizes
    eye = constant(identity(n + m)[:n], sizes)
    if n == first:
        return eye
    if subject.remainder is not None and any(map(any, subject.remainder.entries[first:])):
        raise FormatError("storage: what is held between samples has no remainder")
    moved = subject.plant_form.part(slice(first, None)).times(subject.step)
    driven = subject.driving((), sizes).part(slice(first, None))
    # these hang on the sample, and y at the end of the period is no more what it was then
    if not (_is_zero(moved.part(slice(None), slice(first))) and _is_zero(driven)):
        raise FormatError("storage: states that are held take samples of those that move, or of w")
    none = constant([[ZERO] * (n + m) for _ in range(first)], sizes)
    return eye + below(none, moved)


def loop_of(
    subject: Subject,
    outputs: Sequence[Output],
    scales: Sequence[Fraction],
    held: Held,
    later: bool,
) -> DrivenLoop:
    """Return the plant with held inputs, those of the next sample where they act already."""
    n, m, sizes, q = subject.n, subject.m, subject.sizes, subject.q
    acting = held.acting(n, later)
    N, E, Y = list[Rationals](), list[Rationals](), list[Rationals]()
    for k, (A, B, driven) in enumerate(zip(held.A, held.B, held.E, strict=True)):
        N.append(_placed(A, B, acting, n + m))
        rest: Rationals = [[ZERO] * q for _ in range(n + m - len(A))]
        E.append([*map(list, driven), *rest])
        Y.append([held.shown([*y.C[k][0], *y.D[k][0]], n, later) for y in outputs])
    none: list[Rationals] = [[[ZERO] * q]] * len(held.A)
    through = zip(*(y.F or none for y in outputs), strict=True)
    F = [[row for rows in vertex for row in rows] for vertex in through]
    loop = tuple(affine(M, sizes) for M in (N, E, Y, F))
    if scales:
        times = diagonal(scales, sizes)
        loop = (loop[0], loop[1] * times, loop[2], loop[3] * times)
    return loop[0].widened(), loop[1].widened(), loop[2].widened(), loop[3].widened()


def _placed(A: Rationals, B: Rationals, acting: Sequence[int], width: int) -> Rationals:
    """Return [A, B] with columns of inputs where they act, above rows of what does not change."""
    rows: Rationals = []
    for a, b in zip(A, B, strict=True):
        row = [*a, *[ZERO] * (width - len(a))]
        for k, x in zip(acting, b, strict=True):
            row[k] = x
        rows.append(row)
    return rows + [[ZERO] * width for _ in range(width - len(A))]


def _supplied(
    stretch: Stretch, length: Fraction, loop: DrivenLoop, level: Fraction, first: int
) -> Blocks:
    """Return the blocks that say that what is stored rises by less than the supply."""
    N, E, Y, F = loop
    form, last = stretch.polynomial(N.sizes[:-1]), sum(N.sizes[:-1])
    slope = (form.derivative(last + 1) - form.derivative(last)).times(1 / length)
    if first:
        rest, T = _chosen(form, first)[1], _turned(form, first)
        NT, Y = N * T, Y * T
        inner = slope - (rest * slope * rest).times(2) - (NT + NT.T)
    else:
        RN = form * N
        inner, E = -(slope + RN + RN.T), form * E
    q, p = E.shape[1], Y.shape[0]
    return [
        [inner, -E, -Y.T],
        [diagonal([level] * q, form.sizes), -F.T],
        [diagonal([level] * p, form.sizes)],
    ]
