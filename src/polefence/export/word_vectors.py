"""Test of fixed-point code: integers in, and what the law makes of them in exact arithmetic.

Expected answers are integers too, of 1/1024 of a unit of u, and units of states: the test of a code
without floats needs none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import ceil

import numpy as np

from polefence.export.program import Fixed, Program, memory_of, scales_of
from polefence.export.sources import Texts, context, environment
from polefence.export.vectors import CLAMPED, LIMITED, OK, exact_gains
from polefence.law.laws import Law
from polefence.proof.claims.rounding import (
    Rounded,
    answer_errors,
    gain_errors,
    recovery_errors,
)
from polefence.proof.claims.words import largest, two

FINE = 10  # bits of a unit of u
SATURATED = 16


@dataclass(frozen=True)
class WordVector:
    """Integers given, and expected in `FINE` parts of the units of u, in units of states.

    ``allowed`` are the errors that are proved; ``flags`` the sum of what happens, of which ``sure``
    are those that rounding does not decide.
    """

    given: tuple[int, ...]
    x: tuple[int, ...]
    own: tuple[int, ...]
    u: tuple[int, ...]
    allowed: tuple[int, ...]
    flags: int
    sure: int


def word_vectors(
    program: Program, law: Law, claim: Rounded, cuts: list[int], count: int = 200, seed: int = 0
) -> Iterator[WordVector]:
    """Yield random vectors, of all sizes that words have, ends among them.

    Parameters
    ----------
    claim : Rounded
        What errors are proved of.
    cuts : list of int
        Where the code cuts u.
    """
    scales = scales_of(program)
    if scales is None:
        return
    top = largest(program.number.bits)
    memory = memory_of(program)
    q = memory.states if memory else 0
    m, n = len(scales.rows) - q, len(scales.signals) - q
    E, off = gain_errors(claim), answer_errors(claim.code)
    time = claim.code.memory.sample_time if claim.code.memory else Fraction(1)
    recovery, G, own_G = recovery_errors(claim), _anti_windup(law, q, m), claim.code.G or []
    ranges = [top << (t - s) for s, t in zip(scales.signals[n:], scales.answers[m:], strict=True)]
    random = np.random.default_rng(seed)
    for k in range(count):
        given, taken, flags = _given(program, random, top, k)
        x = _integers(random, [top + 1] * n, k)
        own = _integers(random, ranges, k + 1)
        values = [Fraction(v) * two(-s) for v, s in zip(x, scales.signals, strict=False)]
        values += [Fraction(v) * two(-t) for v, t in zip(own, scales.answers[m:], strict=True)]
        (K,) = exact_gains(program, law, np.array([taken], dtype=float))
        seen, cut_off, u, allowed = _Flags(flags), list[Fraction](), list[int](), list[int]()
        of_gain = [
            sum((e * abs(v) for e, v in zip(row, values, strict=True)), Fraction(0)) for row in E
        ]
        for i, t in enumerate(scales.answers):
            exact = sum((Fraction(g) * v for g, v in zip(K[i], values, strict=True)), Fraction(0))
            error, unit = of_gain[i] + off[i], two(t)
            if i < m:
                cut = seen.cut(exact * unit, error * unit, cuts[i], LIMITED)
                if abs(exact) * unit + error * unit + 1 <= cuts[i]:
                    of_gain[i] = Fraction(0)  # nothing is cut off, and nothing of it is off
                cut_off.append(cut / unit - exact)
                u.append(round(cut * (1 << FINE)))
                allowed.append(ceil(error * unit * (1 << FINE)) + 1)
                continue
            exact, error = values[n + i - m] + time * exact, time * of_gain[i] + off[i]
            cut = seen.cut(exact * unit, error * unit, ranges[i - m], SATURATED)
            if G and any((*cut_off, *of_gain[:m])):
                row = zip(G[i - m], cut_off, strict=True)
                added = time * sum((g * v for g, v in row), Fraction(0))
                error += recovery[i - m]
                row = zip(own_G[i - m], of_gain, strict=False)
                error += sum((abs(g) * e for g, e in row), Fraction(0))
                cut = seen.cut(cut + added * unit, error * unit, ranges[i - m], SATURATED)
            u.append(round(cut))
            allowed.append(ceil(error * unit) + 1)
        known = CLAMPED | LIMITED | SATURATED
        yield WordVector(
            given,
            x,
            own,
            tuple(u),
            tuple(allowed),
            seen.flags & seen.sure,
            seen.sure & known,
        )


@dataclass
class _Flags:
    """What happens to a vector, and which of it rounding does not decide."""

    flags: int
    sure: int = ~0

    def cut(self, exact: Fraction, error: Fraction, most: int, flag: int) -> Fraction:
        """Return a number cut to the largest; all in units of its answer."""
        if abs(abs(exact) - most) <= error + 1:
            self.sure &= ~flag
        elif abs(exact) > most:
            self.flags |= flag
        return max(-Fraction(most), min(Fraction(most), exact))


def _anti_windup(law: Law, states: int, inputs: int) -> list[list[Fraction]]:
    """Return the anti-windup gain, a row a state; none without."""
    if law.anti_windup is None or not states:
        return []
    return [[Fraction(g) for g in row[:inputs]] for row in law.anti_windup[-states:].tolist()]


def _integers(random: np.random.Generator, most: list[int], k: int) -> tuple[int, ...]:
    """Return integers of one size, every eighth time the largest of either sign."""
    if k % 8 == 0:
        return tuple(int(random.choice([-1, 1])) * (m - (m & 1 == 0)) for m in most)
    size = 2.0 ** -random.integers(0, 8)
    return tuple(
        int(v * m * size) for v, m in zip(random.uniform(-1, 1, len(most)), most, strict=True)
    )


def _given(
    program: Program, random: np.random.Generator, top: int, k: int
) -> tuple[tuple[int, ...], list[float], int]:
    """Return integers of parameters or alpha, what the code takes for them, and its flag."""
    scales = program.scales
    if scales is None or isinstance(program, Fixed):
        return (), [], OK
    if not program.shares:
        one = (top + 1) >> 1
        weights = random.dirichlet(np.ones(program.domain.corners))
        whole = [int(w) for w in np.floor(weights * one)]
        whole[0] += one - sum(whole)
        return tuple(whole), [float(w) for w in whole], OK
    integers, taken, flags = list[int](), list[float](), OK
    for share, s in zip(program.shares, scales.given, strict=True):
        low, high = (int(Fraction(end) * two(s)) for end in (share.low, share.high))
        # below the interval, at its end, inside
        inside = int(random.integers(low, high + 1))
        value = {3: max(-top - 1, low - 1), 5: high}.get(k % 16, inside)
        flags |= CLAMPED if value < low else OK
        integers.append(value)
        taken.append(float(Fraction(max(value, low)) * two(-s)))
    return tuple(integers), taken, flags


def word_harness(program: Program, texts: Texts, law: Law, claim: Rounded) -> str:
    """Return the text of <name>_test.c: a program that compares the code with the law."""
    given = context(program, texts)
    given |= {"vectors": list(word_vectors(program, law, claim, given["cuts"])), "fine": FINE}
    return environment().get_template("fixed_test.c.j2").render(given)
