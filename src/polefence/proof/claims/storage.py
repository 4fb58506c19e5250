"""Inequalities of a storage function: what a loop at samples does to a disturbance at all times.

The states x at a sample, of which those of the plant move and others do not, and the inputs u
are y = [x; u]. Between samples y' = N y + E w, and V = y'S y with S(p, t); at a sample V = x'Q x.
With a law u = Z W^-1 x (W = I of gains), and x = G y at the next sample, there holds for every p

    W'Q W - [W; Z]'S(p, 0) [W; Z] > 0,  S(p, T) - G'Q G > 0,

so that V never rises at a sample, and for every t of the period, with S' by time,

    [ -(S' + N'S + S N), -S E, -[C, D]' ; *, g I, -F' ; *, *, g I ] > 0:

V rises by less than g |w|^2 - |z|^2 / g. Q is positive definite everywhere if it is at one vertex,
since without w it falls from sample to sample. No exponential is needed: the plant is that in
continuous time, and all of this is polynomial in p and t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

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
        raise FormatError("held: with a clock there is no bound on the gain at all times")
    for item in evidence.per_cell:
        if bool(item.storage) != (held is not None):
            raise FormatError("storage: belongs to a bound at all times, and to each of its parts")
        if held is not None and item.spread is not None:
            raise FormatError("storage: is of the plant itself, and has no remainder")
        for k, stretch in enumerate(item.storage):
            require_shapes(stretch.S, len(stretch.S), size, size, f"storage {k + 1}: S")


def least_of_storage(subject: Subject, outputs: int) -> int:
    """Return the least that it takes to prove the inequalities of all stretches."""
    rows = subject.n + subject.m + subject.q + outputs
    degrees = ((s.degree + 1, s.along) for s in subject.evidence.storage)
    sizes = (*subject.sizes, 2)
    counts = (count_of(sizes, (*(d,) * len(subject.sizes), along)) for d, along in degrees)
    return least_work(sum(counts), rows)


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
    stretches, sizes = subject.evidence.storage, subject.sizes
    require_stretches(stretches, (1 - held.early,) if held.early else ())
    _require_joined(stretches, sizes)
    Q = bernstein(subject.evidence.X, sizes, subject.evidence.degree)
    form, arriving = subject.law.form(sizes), _arriving(subject, held)
    W = form.part(slice(subject.n))
    rows: Rows = {
        "at a sample": [[W.T * Q * W - form.T * stretches[0].at(sizes, end=False) * form]],
        "at the next": [[stretches[-1].at(sizes, end=True) - arriving.T * Q * arriving]],
    }
    begin = Fraction(0)
    for k, stretch in enumerate(stretches):
        later = bool(held.early) and begin >= 1 - held.early
        length = (stretch.end - begin) * subject.step
        loop = _loop(subject, outputs, scales, held, later)
        rows[f"of the storage, stretch {k + 1}"] = _supplied(stretch, length, loop, level, sizes)
        begin = stretch.end
    return rows


def _require_joined(stretches: Sequence[Stretch], sizes: tuple[int, ...]) -> None:
    """Refuse stretches of which one begins at another S than the one before ends."""
    for k, (one, other) in enumerate(pairwise(stretches)):
        end, begin = one.at(sizes, end=True), other.at(sizes, end=False)
        if any(any(map(any, M)) for M in (end - begin).terms.values()):
            raise FormatError(f"storage: stretch {k + 2} begins where stretch {k + 1} ends")


def _arriving(subject: Subject, held: Held) -> Polynomial:
    """Return G: the states at the next sample of [x; u] when the period ends."""
    n, m, first, sizes = subject.n, subject.m, len(held.A[0]), subject.sizes
    eye = constant(identity(n + m)[:n], sizes)
    if n == first:
        return eye
    if subject.remainder is not None and any(map(any, subject.remainder.entries[first:])):
        raise FormatError("storage: what is held between samples has no remainder")
    moved = subject.plant_form.part(slice(first, None)).times(subject.step)
    none = constant([[ZERO] * (n + m) for _ in range(first)], sizes)
    return eye + below(none, moved)


_Loop = tuple[Polynomial, Polynomial, Polynomial, Polynomial]  # N, E, [C, D] and F


def _loop(
    subject: Subject,
    outputs: Sequence[Output],
    scales: Sequence[Fraction],
    held: Held,
    later: bool,
) -> _Loop:
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
    wide_N, wide_E, wide_Y, wide_F = map(_wide, loop)
    return wide_N, wide_E, wide_Y, wide_F


def _placed(A: Rationals, B: Rationals, acting: Sequence[int], width: int) -> Rationals:
    """Return [A, B] with columns of inputs where they act, above rows of what does not change."""
    rows: Rationals = []
    for a, b in zip(A, B, strict=True):
        row = [*a, *[ZERO] * (width - len(a))]
        for k, x in zip(acting, b, strict=True):
            row[k] = x
        rows.append(row)
    return rows + [[ZERO] * width for _ in range(width - len(A))]


def _wide(P: Polynomial) -> Polynomial:
    """Return a polynomial of the parameters as one of time too."""
    terms = {(*e, 0, 0): M for e, M in P.terms.items()}
    return replace(P, terms=terms, sizes=(*P.sizes, 2), degrees=(*P.degrees, 0))


def _supplied(
    stretch: Stretch, length: Fraction, loop: _Loop, level: Fraction, sizes: tuple[int, ...]
) -> list[list[Polynomial]]:
    """Return the blocks that say that what is stored rises by less than the supply."""
    N, E, Y, F = loop
    S = stretch.polynomial(sizes)
    last = sum(sizes)
    moved = (S.derivative(last + 1) - S.derivative(last)).times(1 / length)
    SN, wide = S * N, S.sizes
    q, p = E.shape[1], Y.shape[0]
    return [
        [-(moved + SN + SN.T), (S * E).times(-1), Y.T.times(-1)],
        [diagonal([level] * q, wide), F.T.times(-1)],
        [diagonal([level] * p, wide)],
    ]
