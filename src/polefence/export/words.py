"""A law of gains in fixed point: its scales, its integers, and what the templates are given.

Each signal has the power of two with which its range just fits a word; each row of the gain the
one with which its integers and the sum of its products just do. See `proof.claims.words`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from math import ceil, floor
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.export.program import (
    Fixed,
    Memory,
    Polynomial,
    Program,
    Scheduled,
    Share,
    memory_of,
    word,
)
from polefence.law.laws import Law
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.words import Scales, largest, two

Exact = list[list[Fraction]]
SIZES = 1e-100, 1e100  # of ranges
STEPS = 20_000  # of the law's own states, that their range is looked for in
SMALL = 1e-9  # of what they reached, steps that are looked at no more


def in_words(
    law: Law,
    parameters: tuple[Parameter, ...],
    bits: int,
    signals: Sequence[str],
    ranges: Mapping[str, float],
    limits: Sequence[float] = (),
    memory: Memory | None = None,
) -> Program:
    """Return what the code of a law computes in integers of so many bits.

    Parameters
    ----------
    signals : sequence of str
        Names of what is measured and, last, of states of the law's own.
    ranges : mapping
        The largest absolute value of each signal, in its unit; of the law's own states by default
        the largest that signals in their ranges lead to, where the law alone is stable.
    limits : sequence of float
        Largest absolute values of the inputs, none for what the signals' ranges lead to.

    Raises
    ------
    InputError
        If a range is missing or unknown, or a number has no room.
    """
    gains = law.own_gain(None)[None] if law.K is not None else law.gains
    if not parameters and law.K is None and not law.fixed and law.parameters:
        raise InputError(
            "--fixed: a law of parameters is given these; leave out --given alpha, or use --float"
        )
    states = memory.states if memory else 0
    sizes = ranges_of(law, np.asarray(gains), signals, ranges, memory)
    terms = [[[Fraction(x) for x in row] for row in K] for K in np.asarray(gains).tolist()]
    if memory:
        first, time = len(terms[0]) - states, Fraction(memory.sample_time)
        terms = [[*K[:first], *([time * x for x in row] for row in K[first:])] for K in terms]
    of_signals = tuple(exponent_of(Fraction(size), bits) for size in sizes)
    cuts: list[Fraction | None] = [Fraction(limit) for limit in limits]
    cuts += [None] * (len(terms[0]) - len(cuts))
    m, first = len(cuts) - states, len(of_signals) - states
    entries = [
        [[K[i][j] * two(-s) for K in terms] for j, s in enumerate(of_signals)]
        for i in range(len(cuts))
    ]
    pairs = [row_of(row, cut, bits) for row, cut in zip(entries[:m], cuts, strict=False)]
    beyond, G = _recovering(law, memory, entries, pairs, bits)
    recovering = list[int]()
    for k, row in enumerate(entries[m:]):
        state = of_signals[first + k]
        adding = [[g * two(-b)] for g, b in zip(G[k], beyond, strict=True)] if G else [[]]
        _, finest = row_of(adding, None, bits, state + bits)
        r, t = row_of(row, None, bits, finest)
        if t < state:
            raise InputError(
                f"{signals[first + k]}: moves by more than its range in one sample; give a larger "
                "--range, or a shorter --sample-time"
            )
        pairs.append((r, t))
        recovering += [row_of(adding, None, bits, t)[0]] if G else []
    rows, answers = ([pair[end] for pair in pairs] for end in (0, 1))
    own_G = [
        [float(whole_of(g, r - b) * two(b - r)) for g, b in zip(row, beyond, strict=True)]
        for row, r in zip(G, recovering, strict=True)
    ]
    if memory and G:
        memory = replace(memory, anti_windup=np.array(own_G))
    shares, given = list[Share](), list[int]()
    for parameter in () if law.fixed else parameters:
        share, exponent = share_of(parameter, bits)
        shares.append(share)
        given.append(exponent)
    lists = (of_signals, given, rows, answers, (), (), beyond, recovering)
    scales = Scales(*map(tuple, lists))
    units = [[r - s for s in of_signals] for r in rows]
    own = np.array([[[float(whole_of(k, e) * two(-e)) for k, e in zip(*pair, strict=True)]
                     for pair in zip(K, units, strict=True)] for K in terms])  # fmt: skip
    measured, number = bool(law.measured), word(bits)
    if law.K is not None or law.fixed:
        return Fixed(number, own[0], measured, memory, scales)
    return Polynomial(number, tuple(shares), law.domain, law.powers, own, measured, memory, scales)


def _recovering(
    law: Law,
    memory: Memory | None,
    entries: Sequence[Sequence[Sequence[Fraction]]],
    pairs: Sequence[tuple[int, int]],
    bits: int,
) -> tuple[list[int], Exact]:
    """Return the exponents of what is cut off each input, and T G; none without anti-windup.

    What is cut off is no more than all that an input can be: so many bits are rounded off that this
    fits a word.
    """
    if memory is None or law.anti_windup is None:
        return [], []
    beyond, top, m = list[int](), largest(bits), len(pairs)
    for row, (r, t) in zip(entries, pairs, strict=False):
        most = sum(sum(abs(whole_of(k, r)) for k in terms) for terms in row) * (top + 1)
        most, shift = (most + (1 << (r - t) >> 1)) >> (r - t), 0
        while (most + (1 << shift >> 1)) >> shift > top:
            shift += 1
        beyond.append(t - shift)
    time, gain = Fraction(memory.sample_time), law.anti_windup[-memory.states :, :m]
    return beyond, [[time * Fraction(g) for g in row] for row in gain.tolist()]


def whole_of(value: Fraction, exponent: int) -> int:
    """Return the integer nearest to a value times a power of two."""
    return floor(value * two(exponent) + Fraction(1, 2))


def exponent_of(size: Fraction, bits: int) -> int:
    """Return the most bits behind the point with which a size fits a word."""
    top = largest(bits)
    ratio = top / size
    exponent = ratio.numerator.bit_length() - ratio.denominator.bit_length() + 1
    while size * two(exponent) > top:
        exponent -= 1
    return exponent


def row_of(
    entries: Sequence[Sequence[Fraction]],
    cut: Fraction | None,
    bits: int,
    finest: int | None = None,
) -> tuple[int, int]:
    """Return the exponents of a row's sum and of its answer; entries are of signals' integers.

    An answer that is kept is a wide one, with ``finest`` bits behind the point at most.
    """
    top, wide = largest(bits), largest(2 * bits)
    most = max(sum(map(abs, terms), Fraction(0)) for terms in entries)
    if not most:
        return (0, 0) if finest is None else (finest, finest)
    r = exponent_of(most, bits) + 1
    while True:
        r -= 1
        whole = [sum(abs(whole_of(k, r)) for k in terms) for terms in entries]
        reached = sum(whole) * (top + 1)
        if finest is None:
            size = reached * two(-r)
            size = size if cut is None or cut > size else cut
            t = min(exponent_of(size, bits), r)
        else:
            t = min(finest, r)
        if max(whole) <= top and reached + (1 << (r - t) >> 1) <= wide and r - t <= 2 * bits - 2:
            return r, t


def share_of(p: Parameter, bits: int) -> tuple[Share, int]:
    """Return a parameter's constants, and its exponent."""
    low, high = Fraction(p.low), Fraction(p.high)
    exponent = exponent_of(max(abs(low), abs(high)), bits)
    if max(abs(floor(low * two(exponent))), abs(ceil(high * two(exponent)))) > largest(bits):
        exponent -= 1
    ends = floor(low * two(exponent)), ceil(high * two(exponent))
    if p.inverted and ends[0] <= 0 <= ends[1]:
        raise InputError(
            f"{p.name}: {bits} bits cannot tell the ends of its interval from zero, by which the "
            f"code divides; {longer(bits)}"
        )
    width = ends[1] - ends[0]
    shift = bits - 2 if p.inverted else 2 * bits - 2
    whole = floor(Fraction((ends[1] if p.inverted else 1) << shift, width) + Fraction(1, 2))
    scale = Fraction(whole, 1 << shift)
    scale *= 1 if p.inverted else two(exponent)
    one = two(-exponent)
    share = Share(p, float(ends[0] * one), float(ends[1] * one), float(scale))
    return share, exponent


def longer(bits: int) -> str:
    """Return what to take in place of so many bits."""
    return "take --fixed 32, or --float" if bits == 16 else "take --float"


def ranges_of(
    law: Law,
    gains: Array,
    signals: Sequence[str],
    ranges: Mapping[str, float],
    memory: Memory | None,
) -> list[float]:
    """Return the range of each signal."""
    known = [name.split(" [")[0] for name in signals]
    for name, value in ranges.items():
        if name not in known:
            raise InputError(f"range {name!r} is of no signal of the law; these are: "
                             f"{', '.join(known)}")  # fmt: skip
        if not SIZES[0] < value < SIZES[1]:
            raise InputError(f"range of {name!r} = {value!r} must be a positive number")
    first = len(known) - (memory.states if memory else 0)
    missing = [name for name in known[:first] if name not in ranges]
    sizes = [float(ranges.get(name, 0.0)) for name in known]
    if not missing and memory and not all(sizes):
        found = _own_ranges(law, gains, np.array(sizes[:first]), memory)
        sizes = [
            size or float(more) for size, more in zip(sizes, [*sizes[:first], *found], strict=True)
        ]
        missing = [name for name, size in zip(known, sizes, strict=True) if not size]
    if missing:
        own = missing[0] in known[first:]
        raise InputError(
            f"--fixed needs the range of {', '.join(missing)}"
            + (
                "; the law alone is not stable, so that none follows from the signals"
                if own
                else ""
            )
            + ": give the largest absolute value of each in its unit, such as "
            f"--range '{missing[0]} = 0.1'"
        )
    return sizes


def _own_ranges(law: Law, gains: Array, sizes: Array, memory: Memory) -> Array:
    """Return what states of the law reach while its signals stay in their ranges.

    The sum of the sizes of their responses, at corners of the family; zero where none is found. A
    scale needs no proof: beyond it the code's states are cut.
    """
    q, T, r = memory.states, memory.sample_time, len(sizes)
    corners = np.eye(law.domain.corners)
    rates = np.atleast_3d(law.own_gain(corners))[:, -q:] if law.K is None else gains[:, -q:]
    most = np.zeros(q)
    for K in rates:
        A, state = np.eye(q) + T * K[:, r:], T * K[:, :r] * sizes
        if np.abs(np.linalg.eigvals(A)).max() >= 1 - 1e-9:
            return np.zeros(q)
        reached = np.zeros(q)
        for _ in range(STEPS):
            reached += np.abs(state).sum(axis=1)
            state = A @ state
            if np.abs(state).max() <= SMALL * reached.max():
                break
        # what is left is bounded by its own size, as modes that are left decay slowest
        most = np.maximum(most, 1.5 * reached)
    return np.where(most > 0, most, 1.0)


# --- what the templates are given ----------------------------------------------------------------


def constants(program: Program, limits: Sequence[float]) -> dict[str, Any]:
    """Return the integers of the code; of a scheduled law its gain apart in the table."""
    scales, bits = _scales(program), program.number.bits
    memory = memory_of(program)
    states = memory.states if memory else 0
    m = len(scales.rows) - states
    if isinstance(program, Polynomial):
        gains = program.gains
    else:
        gains = np.asarray(program.L if isinstance(program, Scheduled) else program.K)[None]
    table = [
        [
            [whole_of(Fraction(float(K[i, j])), r - s) for K in gains]
            for j, s in enumerate(scales.signals)
        ]
        for i, r in enumerate(scales.rows)
    ]
    top = largest(bits)
    cuts = [
        min(top, floor(Fraction(v) * two(t))) for v, t in zip(limits, scales.answers, strict=False)
    ]
    kept = list(
        zip(scales.signals[len(scales.signals) - states :], scales.answers[m:], strict=True)
    )
    return {
        "bits": bits,
        "wide": f"int{2 * bits}_t",
        "one_bits": bits - 2,
        "table": table,
        "shifts": [r - t for r, t in zip(scales.rows, scales.answers, strict=True)],
        "cuts": cuts or [top] * m,
        "reads": [t - s for s, t in kept],
        "tops": [top << (t - s) for s, t in kept],
        **_recovery(memory, scales, m),
        "scales": scales,
        "own": states,
    }


def _scales(program: Program) -> Scales:
    """Return the exponents of a program, which is one of fixed point."""
    if program.scales is None:
        raise InputError("the program is one of floats")
    return program.scales


def _recovery(memory: Memory | None, scales: Scales, m: int) -> dict[str, Any]:
    """Return the integers of anti-windup, none without."""
    if memory is None or memory.anti_windup is None:
        return {"G": []}
    ends = zip(scales.recovering, scales.answers[m:], strict=True)
    return {
        "G": [
            [_integer(g, r - b) for g, b in zip(row, scales.beyond, strict=True)]
            for row, r in zip(memory.anti_windup, scales.recovering, strict=True)
        ],
        "beyond": [t - b for t, b in zip(scales.answers, scales.beyond, strict=False)],
        "recovering": [r - t for r, t in ends],
    }


def solving(program: Scheduled) -> dict[str, Any]:
    """Return the integers of a scheduled law besides: its tables row by row, and its shifts."""
    scales, n = _scales(program), len(program.T)
    w, factors, *of_rows = scales.solving
    lower = np.tril_indices(n)
    columns = list(zip(program.T.T, scales.columns, strict=True))
    rows = zip(program.Z.transpose(1, 2, 0), of_rows, strict=True)
    return {
        "T": [[_integer(column[i], t) for column, t in columns] for i in range(n)],
        "W": [[_integer(x, w) for x in row] for row in program.W[:, lower[0], lower[1]].T],
        "Z": [[_integer(x, v) for x in entry] for row, v in rows for entry in row],
        "back": [
            [v + t - r + s for t, s in zip(scales.columns, scales.signals, strict=True)]
            for r, v in zip(scales.rows, of_rows, strict=True)
        ],
        "pivot": 1 << w,
        "factor": 1 << factors,
        "factor_bits": factors,
    }


def _integer(value: float, exponent: int) -> int:
    return whole_of(Fraction(float(value)), exponent)


def weighing(program: Polynomial | Scheduled, ok: str) -> list[str]:
    """Return the lines of C that find c, each -1 to 1 or 0 to 1, of parameters or alpha."""
    scales, bits = _scales(program), program.number.bits
    count = sum(program.domain.sizes)
    if isinstance(program, Polynomial):
        count = len(program.powers[0])
    box = isinstance(program, Scheduled) and program.domain.sizes == (2,) * len(program.shares)
    if not program.shares:
        return [f"word c[{count}];", "const uint32_t flags = onto_simplex(alpha, c);"]
    lines = [f"word c[{count}];", f"wide m[{len(program.shares)}];", f"uint32_t flags = {ok};"]
    for k, (share, s) in enumerate(zip(program.shares, scales.given, strict=True)):
        low, high, factor = share_integers(share, s, bits)
        how = f"(p{k} - {literal(low, bits)}) * {literal(factor, bits)}"
        value = f"quotient({how}, p{k})" if share.parameter.inverted else f"rounded({how}, {bits}U)"
        interval = f"{literal(low, bits)}, {literal(high, bits)}"
        lines += [f"const wide p{k} = inside(p[{k}], {interval}, &flags);"]
        lines += [f"m[{k}] = fraction({value});"]
    # declarations before statements are C99's to mix; here they come first
    declared = [line for line in lines if line.startswith(("const", "word", "wide", "uint32"))]
    done = [line for line in lines if line and line not in declared]
    if box:
        for k in range(len(program.shares)):
            both = f"ONE - m[{k}]", f"m[{k}]"
            done += [f"c[{2 * k + j}] = narrowed({end});" for j, end in enumerate(both)]
    elif isinstance(program, Polynomial) and program.signed:
        done += [f"c[{k}] = narrowed((2 * m[{k}]) - ONE);" for k in range(count)]
    else:
        for j in range(count):
            ends = [
                f"m[{k}]" if (j >> (len(program.shares) - 1 - k)) & 1 else f"(ONE - m[{k}])"
                for k in range(len(program.shares))
            ]
            value = ends[0]
            for end in ends[1:]:
                value = f"times({value}, {end})"
            done.append(f"c[{j}] = narrowed({value});")
    return [*declared, "", *done]


def powers(program: Polynomial | Scheduled) -> list[str]:
    """Return for each term how its power of c is found, times its factor."""
    terms, bits = [], program.number.bits
    for many, e in program.weights():
        factors = [f"c[{j}]" for j, power in enumerate(e) for _ in range(power)]
        value = factors[0] if factors else "ONE"
        for factor in factors[1:]:
            value = f"times({value}, {factor})"
        terms.append(value if many == 1 else f"narrowed({literal(many, bits)} * {value})")
    return terms


def share_integers(share: Share, exponent: int, bits: int) -> tuple[int, int, int]:
    """Return the integers of a parameter's ends and of its scale."""
    one = two(exponent)
    shift = bits - 2 if share.parameter.inverted else 2 * bits - 2 - exponent
    values = (
        Fraction(share.low) * one,
        Fraction(share.high) * one,
        Fraction(share.scale) * two(shift),
    )
    low, high, scale = (int(v) for v in values)
    return low, high, scale


def literal(value: int, bits: int) -> str:
    """Return an integer as a C constant of the wide type."""
    text = f"INT{2 * bits}_C({abs(value)})"
    return f"(-{text})" if value < 0 else text


def with_late(program: Program, n: int, late: int) -> Program:
    """Return fixed-point code that reads inputs on their way with gains of zero."""
    scales = program.scales
    if scales is None or (not isinstance(program, Scheduled) and program.measured):
        return program
    signals = scales.signals
    wider = (*signals[:n], *[0] * late, *signals[n:])
    return replace(program, scales=replace(scales, signals=wider))
