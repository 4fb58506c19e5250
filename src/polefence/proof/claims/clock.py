"""Inequalities of the dual form for a clock that is not perfect.

The states at the next sample are those that a period of theta T leaves, for every theta of the
clock's interval. On the box of the parameters and of theta, with Q(p) that does not depend on theta
and F of the loop in its difference form, F = (exp(N theta T) - 1) / T in the rows that move,

    -(Q F + F'Q + T F'Q F + theta [I; K]'M [I; K]) > 0,  theta (g^2 - c - tr Q V) > 0.

So Q never rises by more in a period than what is lost in it, whatever the periods before it were:
over any sequence of them the mean of z'z is below g^2. See `polefence.proof.between`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from polefence.proof.between import Held, Period, Point, Step
from polefence.proof.claims.signal import (
    DualLoop,
    Rows,
    Subject,
    below_kappa,
    with_remainder,
)
from polefence.proof.matrices import ZERO, Rationals
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, below, bernstein, joint
from polefence.proof.remainder import Remainder, Spread
from polefence.proof.work import FormatError


def steps_of(period: Period, held: Held, low: Point, high: Point, subject: Subject) -> list[Step]:
    """Return what periods of the clock make of x on a part of the box, in parts of their lengths.

    Raises
    ------
    FormatError
        If there is no clock, or its periods are too long for these rates.
    """
    if held.clock is None:
        raise FormatError("clock: the period is one")
    sizes = (*subject.sizes, 2)
    return [period.between(ends).step_on(low, high, sizes) for ends in held.clock.lengths]


def rows_of_clock(
    subject: Subject,
    outputs: Sequence[Output],
    held: Held,
    steps: Sequence[Step],
    level: Fraction,
) -> Rows:
    """Return the blocks that bound the mean square of outputs over periods of any length.

    Raises
    ------
    FormatError
        If the evidence does not cover what interpolation may miss.
    """
    law, evidence, spread = subject.law, subject.evidence, subject.evidence.spread
    plain = law.form(subject.sizes)
    form, shown = plain.widened(), held.chosen(outputs, plain).widened()
    Q = bernstein(evidence.X, subject.sizes, evidence.degree).widened()
    rows: Rows = {}
    for k, step in enumerate(steps):
        loop = _loop(subject, outputs, held, step, Q, form)
        energy = shown.T.half_times(step.whole.M * shown)
        inner = -(loop.falling + energy)
        blocks = [[inner]]
        if spread is not None:
            _require_cover(spread, _missed(subject, outputs, held, step))
            blocks = with_remainder(inner, loop, spread, form)
        moved = step.whole.noise(Q)
        rows[f"of the output, periods {k + 1}"] = blocks
        rows[f"of the noise, periods {k + 1}"] = [[step.theta.times(level**2) - moved]]
    return rows if spread is None else rows | below_kappa(Q, spread)


def falling_of(
    subject: Subject, outputs: Sequence[Output], held: Held, step: Step, left: Polynomial
) -> tuple[list[list[Polynomial]], Rows]:
    """Return the blocks of ``left`` Q - (Q F + F'Q + T F'Q F), and that kappa is enough.

    Raises
    ------
    FormatError
        If the evidence does not cover what interpolation may miss.
    """
    evidence, spread = subject.evidence, subject.evidence.spread
    form = subject.law.form(subject.sizes).widened()
    Q = bernstein(evidence.X, subject.sizes, evidence.degree).widened()
    loop = _loop(subject, outputs, held, step, Q, form)
    weight = loop.WQ if subject.law.K is not None else loop.WQ * form.part(slice(subject.n))
    inner = left * weight - loop.falling
    if spread is None:
        return [[inner]], {}
    _require_cover(spread, _missed(subject, outputs, held, step))
    return with_remainder(inner, loop, spread, form), below_kappa(Q, spread)


def least_square(Q: Polynomial, steps: Sequence[Step], elevation: int) -> Fraction:
    """Return what the square of the level must exceed for what the noise adds, of all periods."""
    least = ZERO
    for step in steps:
        moved = step.whole.noise(Q.widened())
        moved, theta = (P.raised(joint([moved, step.theta])) for P in (moved, step.theta))
        terms, whole = moved.elevated(elevation).terms, Fraction(theta.whole, moved.whole)
        for e, length in theta.elevated(elevation).terms.items():
            if e in terms:
                least = max(least, whole * terms[e][0][0] / length[0][0])
    return least


def _loop(
    subject: Subject,
    outputs: Sequence[Output],
    held: Held,
    step: Step,
    Q: Polynomial,
    form: Polynomial,
) -> DualLoop:
    """Return the loop over a period in the dual form."""
    n, first = subject.n, len(held.A[0])
    AB = _placed(step.moved, held.chosen_of(outputs), n + subject.m)
    if n > first:  # inputs on their way, and states of the law's own
        AB = below(AB, subject.plant_form.part(slice(first, None)).widened())
    M = AB * form
    QM = Q * M
    if subject.law.K is not None:
        return DualLoop(Q, Q, M, QM, QM, M, subject.step)
    WQ = form.part(slice(n)) * Q
    return DualLoop(Q, WQ, M, QM, WQ * M, M, subject.step)


def _placed(P: Polynomial, columns: Sequence[int], width: int) -> Polynomial:
    """Return a polynomial with its columns among others, that are zero."""

    def wider(M: list[list[int]]) -> list[list[int]]:
        rows = []
        for row in M:
            whole = [0] * width
            for k, x in zip(columns, row, strict=True):
                whole[k] = x
            rows.append(whole)
        return rows

    return replace(P, terms={e: wider(M) for e, M in P.terms.items()})


def _missed(subject: Subject, outputs: Sequence[Output], held: Held, step: Step) -> Remainder:
    """Return what each entry of [A, B, E] may be off by."""
    n, m, first = subject.n, subject.m, len(held.A[0])
    columns = held.chosen_of(outputs)
    entries: Rationals = []
    for row in step.off:
        whole = [ZERO] * (n + m + subject.q)
        for k, x in zip(columns, row, strict=True):
            whole[k] = x
        entries.append(whole)
    known = subject.remainder
    rest = [(ZERO,) * (n + m + subject.q)] * n if known is None else known.entries
    return Remainder(tuple(map(tuple, [*entries, *rest[first:]])))


def _require_cover(spread: Spread, remainder: Remainder) -> None:
    """Refuse rows and columns that do not cover what interpolation may miss."""
    spread.require(remainder, omega=False, kappa=True)
