"""A scheduled law Z W^-1 in fixed point: its scales, and its integers.

T makes W near to the identity, so that its factors and what is solved for have one scale each; of
what is solved for one a row. See `proof.claims.solving`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import sqrt

import numpy as np

from polefence.base.errors import InputError
from polefence.export.guarantee import moved_apart, sharpest
from polefence.export.program import MAX_TERMS, Exact, Scheduled, Share, exactly, word
from polefence.export.words import exponent_of, ranges_of, row_of, share_of, whole_of
from polefence.law.coordinates import Coordinates
from polefence.law.laws import Law
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.words import Scales, largest, two
from polefence.proof.work import FormatError

# Of the smallest eigenvalue, what rounding is taken to spend; where a proof of that has no room,
# the next, with another bit of room in all sums.
SPENT = (0.1, 0.5, 0.9)
ROOM = 1.05  # of bounds that are known before the integers are


def solved_in_words(
    law: Law,
    parameters: tuple[Parameter, ...],
    bits: int,
    signals: Sequence[str],
    ranges: Mapping[str, float],
    limits: Sequence[float] = (),
    attempt: int = 0,
) -> Scheduled:
    """Return what the code of a scheduled law computes in integers of so many bits.

    Parameters
    ----------
    signals : sequence of str
        Names of the states.
    ranges : mapping
        The largest absolute value of each, in its unit.
    limits : sequence of float
        Largest absolute values of the inputs, none for what the states' ranges lead to.
    attempt : int
        Which of `SPENT`.

    Raises
    ------
    InputError
        If a range is missing or unknown.
    FormatError
        If a number has no room.
    """
    domain, degree, n = law.domain, law.degree, law.shape[1]
    if not parameters and len(domain.sizes) > 1:
        raise InputError(
            "--fixed: this law is one of the parameters, not of weights; leave out --given alpha"
        )
    if len(law.form) > MAX_TERMS:
        raise InputError(
            f"a law of {len(law.form)} coefficients is not exported; at most {MAX_TERMS}"
        )
    sizes = ranges_of(law, np.zeros((1, *law.shape)), signals, ranges, None)
    of_signals = tuple(exponent_of(Fraction(size), bits) for size in sizes)
    T, of_columns = _columns(law.coordinates.T, bits)
    corners = law.gain(np.eye(domain.corners))
    L = exactly((corners.min(axis=0) + corners.max(axis=0)) / 2)
    left = Coordinates(np.array(T, dtype=float)).forms(law.form[:, :n])
    Z = np.array(moved_apart(law, T, L), dtype=float)
    rows = np.maximum(np.linalg.norm(Z, axis=-1).max(axis=0), 1e-30)
    smallest, size, _ = sharpest(domain, degree, left, Z / rows[:, None])
    b = float(left[:, range(n), range(n)].max()) + smallest
    most = max(min(np.abs(left).sum(axis=-1).max(), _norms(left)), b) + smallest
    least, top = smallest * (1 - SPENT[attempt]), largest(bits) * ROOM**-attempt
    # what is solved for makes up for the rounding of the part apart
    span = np.array(sizes) * np.abs(np.array(L, dtype=float))
    moved = np.outer(span.sum(axis=1), 2.0 ** (3 - bits) / np.array(sizes))
    moved = np.linalg.norm(moved @ np.abs(np.linalg.inv(np.array(T, dtype=float))), axis=1)
    reach = [ROOM * float(value) for value in size * rows + moved]
    w = min(exponent_of(Fraction(b * ROOM), bits), bits - 2)
    factors = min(exponent_of(Fraction(sqrt(b / least) * ROOM), bits), bits - 2)
    grown = max(1.0, most, sqrt(most / least)) * ROOM + (most + 2) / top
    of_rows = [exponent_of(Fraction(r * grown), bits) - attempt for r in reach]
    entries = np.abs(np.array(L, dtype=float)) + np.outer(reach, _sizes(T))
    cuts: list[Fraction | None] = [Fraction(limit) for limit in limits] or [None] * len(L)
    sums, answers = list[int](), list[int]()
    for i, cut in enumerate(cuts):
        row = [[Fraction(entries[i, j] * ROOM) * two(-s)] for j, s in enumerate(of_signals)]
        r, t = row_of(row, cut, bits)
        # no finer than what it is made of
        r = min(r - attempt, of_rows[i] + min(map(int.__add__, of_columns, of_signals)))
        sums.append(r)
        answers.append(min(t, r))
    shares, given = list[Share](), list[int]()
    for parameter in parameters:
        share, exponent = share_of(parameter, bits)
        shares.append(share)
        given.append(exponent)
    solving = w, factors, *of_rows
    scales = Scales(of_signals, tuple(given), tuple(sums), tuple(answers), of_columns, solving)
    return _rounded(law, T, L, tuple(shares), scales, bits)


def _rounded(
    law: Law, T: Exact, L: Exact, shares: tuple[Share, ...], scales: Scales, bits: int
) -> Scheduled:
    """Return the program with these scales: each number rounded to its last bit."""
    w, _, *of_rows = scales.solving
    L = [
        [_nearest(x, r - s) for x, s in zip(row, scales.signals, strict=True)]
        for row, r in zip(L, scales.rows, strict=True)
    ]
    n, right = len(T), np.array(T, dtype=object)
    W = [right @ np.array(exactly(M[:n]), dtype=object) @ right.T for M in law.form]
    Z = moved_apart(law, T, L)
    own_W = np.array([[[float(_nearest(x, w)) for x in row] for row in M] for M in W])
    rows = [zip(M, of_rows, strict=True) for M in Z]
    own_Z = np.array([[[float(_nearest(x, v)) for x in row] for row, v in M] for M in rows])
    own_L, own_T = np.array(L, dtype=float), np.array(T, dtype=float)
    made = word(bits), shares, law.domain, law.degree
    return Scheduled(*made, own_T, own_W, own_Z, own_L, scales)


def _columns(T: Array, bits: int) -> tuple[Exact, tuple[int, ...]]:
    """Return T in integers, each column with the most bits behind the point."""
    exact = exactly(T)
    of_columns = tuple(
        exponent_of(max(map(abs, column)), bits) for column in zip(*exact, strict=True)
    )
    T_ = [[_nearest(x, t) for x, t in zip(row, of_columns, strict=True)] for row in exact]
    if any(not row[i] for i, row in enumerate(T_)):
        raise FormatError(f"the coordinates of its states have no room in {bits} bits")
    return T_, of_columns


def _nearest(value: Fraction, exponent: int) -> Fraction:
    return whole_of(value, exponent) * two(-exponent)


def _norms(W: Array) -> float:
    return float(np.linalg.norm(W, axis=(1, 2)).max())


def _sizes(T: Exact) -> Array:
    return np.asarray(np.linalg.norm(np.array(T, dtype=float), axis=0))
