"""Errors of exported laws, of every kind of plant, law and time, held against exact arithmetic.

python benchmarks/exported_laws.py [--only TEXT] [--count 200000] [--designs FOLDER]

Designs are found by `polefence optimise`, or read where FOLDER has them from an earlier run. Each
is exported as float32 and in fixed point of 32 and 16 bits, compiled, and given so many inputs,
drawn over all that it may be given: sizes down to a thousandth, a fourth with all signals at their
ends or parameters at theirs, an eighth with an answer half between two integers or a product
between two floats. What it answers is compared with the law in integers of any length, without
rounding.

"stated" is the largest error of an input [N, of the half and full car kN] that the claim allows
while all signals are in their ranges, "seen" the largest that was found, "share" the largest part
that an error was of what is stated for its own input; "states" is that of steps of a law's own
states. "proved" says whether the export is, with that rounding in the loop. Prints Markdown. The
exit status is 1 where an error is larger than is stated.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from polefence import Design
from polefence.base.errors import InputError, NotProvedError
from polefence.certify.bounds import sampled
from polefence.certify.design import read_document
from polefence.examples import spec_text
from polefence.export import export_c99
from polefence.export.damper import damper_sources
from polefence.export.damper_words import in_words, scales_of
from polefence.export.exported import Exported
from polefence.export.guarantee import roundings
from polefence.export.program import Fixed
from polefence.export.sources import context
from polefence.plant.outputs import split
from polefence.plant.points import seeded
from polefence.proof.claims.clipped import Clipped
from polefence.proof.claims.rounding import (
    answer_errors,
    gain_errors,
    recovery_errors,
    rounding_error,
)
from polefence.proof.claims.words import largest
from polefence.region.text import digits_down, digits_up
from polefence.requirements.asked import wanted
from polefence.response.discrete import Sampling

LATE = ("--sample-time", "0.002", "--delay", "1")
ONE = ("--schedule", "none")
# Ranges of signals by their units: three times what rough roads need, and not a power of two.
RANGES = {
    "m": 0.15, "m/s": 5.0, "m/s2": 45.0, "N": 4500.0, "rad": 0.15, "rad/s": 3.0, "m s": 0.06,
    "kN": 4.5, "": 1.5,
}  # fmt: skip
OWN = "law state "  # begins the names of a law's own states
PID_RANGES = (("x", 1.5), ("pid integral of x", 0.6), ("pid filter of x", 6.0))
FORMATS = (("float", 32), ("fixed", 32), ("fixed", 16))
LIMIT = 1.4  # of the input of the law with anti-windup, as its spec has it
CHUNK = 20_000  # inputs at a time: integers of Python take room
FINE = 400  # bits behind the point of stated errors, which are rounded down
FLOAT = 149  # bits behind the point of which every float32 is a whole number

VAN = spec_text("van")
ALL_STATES = re.sub(r"\[law\].*?(?=\[\[specification)", "", VAN, flags=re.DOTALL)
BARE = re.sub(r"\[actuator.*?(?=\[road\])", "", ALL_STATES, flags=re.DOTALL)
WEIGHED = VAN.replace(
    'signal = "sprung-mass acceleration"', 'signal = "sprung-mass acceleration"\nweight = "Wk"'
)
PAGE = Path(__file__).parents[1] / "docs" / "input-limits.md"
WOUND = re.search(r"```toml\n(# An unstable lag.*?)```", PAGE.read_text(), re.DOTALL)[1]
MOVING = VAN.replace('unit = "kg"', 'unit = "kg"\nrate = [-50, 50]', 1)


@dataclass(frozen=True)
class Case:
    """A design: its name, its spec, options of `optimise`, and ranges that its spec cannot say."""

    name: str
    spec: str
    options: tuple[str, ...] = ()
    ranges: tuple[tuple[str, float], ...] = ()

    @property
    def folder(self) -> str:
        return re.sub(r"\W+", "-", self.name)


CASES = (
    Case("van, all states", BARE),
    Case("van, one gain", BARE, ONE),
    Case("van, one gain, 2 ms late", BARE, (*ONE, *LATE)),
    Case("van, scheduled, 2 ms late", BARE, LATE),
    Case("van, hardware, 2 ms late", ALL_STATES, (*ONE, *LATE)),
    Case("van, two sensors, order 2", VAN),
    Case("van, the same, 2 ms late", VAN, LATE),
    Case("van, the same, Wk", WEIGHED),
    Case("van, the same, load moves", MOVING),
    Case("lag, PID with anti-windup", WOUND, (), PID_RANGES),
    Case("half car", spec_text("half-car")),
    Case("half car, 5 ms late", spec_text("half-car"), ("--sample-time", "0.005", "--delay", "1")),
    Case("half car, one gain", spec_text("half-car"), ONE),
    Case("full car, one gain", spec_text("full-car"), ONE),
    Case("active suspension", spec_text("active-suspension-ride")),
    # a sample late its region has no law: it leaves out the pole at zero that lateness adds
    Case("active suspension, 2 ms", spec_text("active-suspension-ride"), LATE[:2]),
)


def found(case: Case, folder: Path, command: str = "optimise") -> Path:
    """Return the folder of the design, searched for where it is not there."""
    where, spec = folder / case.folder, folder / f"{case.folder}.toml"
    spec.write_text(case.spec)
    if not where.exists():
        words = [command, str(spec), *case.options, "-o", str(where)]
        subprocess.run([sys.executable, "-m", "polefence", *words], check=True, capture_output=True)
    return where


# --- the code ------------------------------------------------------------------------------------

CALLS = """#include "law.h"
void many(long count{given}, const {word} *x, {wide} *own, {word} *u)
{{
    for (long k = 0; k < count; k++) {{
        (void)law_update({memory}{take}x + k * {n}, u + k * {m});
    }}
}}
"""

CHECKS = """#include "law.h"
void many(long count, const law_real *x, law_real *c)
{
    for (long k = 0; k < count; k++) {
        (void)law_update(x + k * LAW_STATES, c + k * LAW_DAMPERS);
    }
}
"""


def compiled(calls: str, folder: Path) -> Any:
    """Return the function that calls law.c many times."""
    (folder / "many.c").write_text(calls)
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", "law.so"]
    subprocess.run(["gcc", *flags, "law.c", "many.c"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "law.so")).many


class Code:
    """The code as a library, which is given many inputs at a time."""

    def __init__(self, made: Exported, folder: Path) -> None:
        program = made.program
        bits, scales = program.number.bits, getattr(program, "scales", None)
        memory = getattr(program, "memory", None)
        self.order = memory.states if memory else 0
        self.n, self.m = (size - self.order for size in program.shape)
        parameters = len(getattr(program, "shares", ()))
        self.given = 0 if isinstance(program, Fixed) else parameters or program.domain.corners
        self.word = np.dtype(np.float32 if scales is None else f"int{bits}")
        self.exact = np.dtype(np.float32 if scales is None else np.int64)
        self.wide = np.dtype(np.float32 if scales is None else f"int{2 * bits}")
        made.save(folder)
        real = "law_real" if scales is None else "law_word"
        wide = real if scales is None else "law_wide"
        fields = {
            "word": real, "wide": wide, "n": self.n, "m": self.m,
            "given": f", const {real} *given" if self.given else "",
            "take": f"given + k * {self.given}, " if self.given else "",
            "memory": f"(law_memory *)(own + k * {self.order}), " if self.order else "",
        }  # fmt: skip
        self.many = compiled(CALLS.format(**fields), folder)

    def answers(self, given: Any, x: Any, own: Any) -> tuple[Any, Any]:
        """Return u, and the states after it."""
        given, x = (np.ascontiguousarray(v, dtype=self.word) for v in (given, x))
        own = np.array(own, dtype=self.wide, order="C")
        u = np.zeros((len(x), self.m), dtype=self.word)
        arrays = [v.ctypes.data_as(ctypes.c_void_p) for v in (given, x, own, u)]
        self.many(ctypes.c_long(len(x)), *arrays[not self.given :])
        return u, own


# --- the law without rounding --------------------------------------------------------------------


def whole(values: Any) -> tuple[Any, int]:
    """Return numbers as Python's integers over a power of two, and that power."""
    exact = [Fraction(v) for v in np.asarray(values).ravel().tolist()]
    unit = max((v.denominator for v in exact), default=1)
    integers = np.empty(len(exact), dtype=object)
    integers[:] = [int(v * unit) for v in exact]
    return integers.reshape(np.shape(values)), unit


def floor_of(values: Any, bits: int) -> Any:
    """Return rationals times 2^bits, rounded down, as Python's integers."""
    return np.array([[math.floor(v * 2**bits) for v in row] for row in values], dtype=object)


class Law:
    """The law itself: u = numerators / denominators of many inputs, in integers.

    Coordinates of a parameter are a / d and b / d, from its lower and from its upper end, those of
    weights given alpha_j / sum.
    """

    def __init__(self, made: Exported) -> None:
        self.law, program = made.design.law, made.program
        self.parameters = [share.parameter for share in getattr(program, "shares", ())]
        claim = made.guarantee.claim or roundings(made.guarantee.design, program)[0].blank
        self.claim, self.code = claim, claim.code
        self.order = self.code.memory.states if self.code.memory else 0
        self.time = self.code.memory.sample_time if self.code.memory else Fraction(1)
        self.G, gain = [], self.law.anti_windup
        if gain is not None and self.order:
            rows = gain[-self.order :, : gain.shape[1] - self.order].tolist()
            self.G = [[self.time * Fraction(g) for g in row] for row in rows]

    def coordinates(self, given: Any, bits: Sequence[int]) -> tuple[list[Any], list[Any]]:
        """Return the numerators a and b of each parameter, or those of weights; and d of each."""
        if not self.parameters:
            weights = np.maximum(given, 0)
            return list(weights.T), [weights.sum(axis=1)]
        tops, bottoms = list[Any](), list[Any]()
        for p, column, s in zip(self.parameters, given.T, bits, strict=True):
            q = math.lcm(p.low.denominator, p.high.denominator, 2 ** max(s, 0))
            low, high = int(p.low * q), int(p.high * q)
            value = np.clip(column * int(Fraction(q) / Fraction(2) ** s), low, high)
            a, d = (value - low), np.full(len(value), high - low, dtype=object)
            if p.inverted:
                a, d = a * high, d * value
            sign = np.where(d < 0, -1, 1)
            a, d = a * sign, d * sign
            tops += [d - a, a]
            bottoms.append(d)
        return tops, bottoms

    def powers(self, tops: list[Any], bottoms: list[Any]) -> tuple[Any, Any]:
        """Return the numerators of a polynomial's c^e, (count, terms), and their denominator."""
        powers = self.law.powers
        signed = self.law.parameters and self.parameters
        if signed:  # c = (b - a) / d of each parameter
            c = [tops[2 * k + 1] - tops[2 * k] for k in range(len(bottoms))]
        else:
            c, bottoms = self.alpha(tops, bottoms)
        total = [max(e[k] for e in powers) for k in range(len(c))] if signed else [sum(powers[0])]
        terms = list[Any]()
        for e in powers:
            value = 1
            for k, power in enumerate(e):
                value = value * c[k] ** power
            if signed:
                for k, d in enumerate(bottoms):
                    value = value * d ** (total[k] - e[k])
            terms.append(value + 0 * c[0])
        below = 1
        for d, power in zip(bottoms, total, strict=True):
            below = below * d**power
        return np.stack(terms, axis=1), below + 0 * c[0]

    def alpha(self, tops: list[Any], bottoms: list[Any]) -> tuple[list[Any], list[Any]]:
        """Return weights of corners, of parameters' ends."""
        if not self.parameters:
            return tops, bottoms
        weights: list[Any] = [1]
        for k in range(len(bottoms)):
            weights = [w * end for w in weights for end in tops[2 * k : 2 * k + 2]]
        product = 1
        for d in bottoms:
            product = product * d
        return weights, [product]

    def bernstein(self, tops: list[Any], bottoms: list[Any]) -> Any:
        """Return the values of the Bernstein polynomials of Z and W, times one denominator."""
        domain = self.law.domain
        c = tops
        if domain.sizes == (domain.corners,):
            c, _ = self.alpha(tops, bottoms)
        elif not self.parameters:  # a box by weights: its marginals
            count = len(domain.sizes)
            bit = lambda j, k: j >> (count - 1 - k) & 1  # noqa: E731
            c = [
                sum(w for j, w in enumerate(tops) if bit(j, k) == end)
                for k in range(count)
                for end in (0, 1)
            ]
        values = list[Any]()
        for e in domain.monomials(self.law.degree):
            at, sizes = 0, domain.sizes
            value: Any = 1
            for size in sizes:
                part = e[at : at + size]
                value = value * (math.factorial(sum(part)) // math.prod(map(math.factorial, part)))
                at += size
            for k, power in enumerate(e):
                value = value * c[k] ** power
            values.append(value)
        return np.stack(values, axis=1)

    def answers(self, given: Any, bits: Sequence[int], y: Any) -> tuple[Any, Any]:
        """Return numerators (count, m) and positive denominators (count,) of K y, y integers.

        What is given is whole too, with so many bits behind the point.
        """
        law = self.law
        if law.W is not None:
            return self.solved(*self.coordinates(given, bits), y)
        K, unit = whole(law.own_gain(None)[None] if law.fixed else law.gains)
        if len(K) == 1:
            return y @ K[0].T, np.full(len(y), unit, dtype=object)
        c, below = self.powers(*self.coordinates(given, bits))
        top = 0
        for k, one in enumerate(K):
            top = top + c[:, k, None] * (y @ one.T)
        return top, below * unit

    def solved(self, tops: Sequence[Any], bottoms: Sequence[Any], y: Any) -> tuple[Any, Any]:
        """Return Z W^-1 y, by elimination without fractions (Bareiss)."""
        form, _ = whole(self.law.form)
        w, n = self.bernstein(tops, bottoms), self.law.W.shape[-1]
        both = (w @ form.reshape(len(form), -1)).reshape(-1, *form.shape[1:])
        rows, before = np.concatenate([both[:, :n], y[:, :, None]], axis=2), 1
        for k in range(n):
            pivot, row = rows[:, k, k].copy(), rows[:, k].copy()
            assert (pivot > 0).all()
            for i in range(n):
                if i != k:
                    rows[:, i] = pivot[:, None] * rows[:, i] - rows[:, i, k, None] * row
                    rows[:, i] //= np.reshape(before, (-1, 1))
            before = pivot
        return (both[:, n:] * rows[:, None, :, n]).sum(axis=2), before


# --- numbers of the code -------------------------------------------------------------------------


def integers(values: Any) -> Any:
    """Return numbers of numpy as Python's integers; floats in units of 2^-149, all exact."""
    if values.dtype.kind == "i":
        return values.astype(object)
    mantissa, exponent = np.frexp(values.astype(float))
    return (mantissa * 2.0**24).astype(np.int64).astype(object) * 2 ** (
        exponent.astype(object) - 24 + FLOAT
    )


class Numbers:
    """What the code is given: how it is drawn, and what it means.

    Bits behind the point are those of what is given, of signals and the law's own states, and of
    answers and these states again.
    """

    def __init__(self, made: Exported, law: Law, ranges: Sequence[float]) -> None:
        program, q = made.program, law.order
        self.law, self.shares = law, getattr(program, "shares", ())
        self.weights = 0 if self.shares or isinstance(program, Fixed) else program.domain.corners
        self.scales = getattr(program, "scales", None)
        (n, m), bits = program.shape, program.number.bits
        self.n, self.q, self.m = n - q, q, m - q
        if self.scales is None:
            self.given, self.signals, self.answers = (
                [FLOAT] * len(self.shares),
                [FLOAT] * n,
                [FLOAT] * m,
            )
            self.one, self.most = 1.0, list(ranges)
            held = (program.number.outward(Fraction(v), up=False) for v in made.texts.limits)
            self.tops = [int(Fraction(v) * 2**FLOAT) for v in held]
            self.ends = [(share.low, share.high) for share in self.shares]
            return
        scales, top = self.scales, largest(bits)
        self.cuts = context(program, made.texts)["cuts"]
        self.given, self.answers = scales.given, scales.answers
        self.signals = [*scales.signals[: self.n], *scales.answers[self.m :]]
        self.reads = [t - s for t, s in zip(self.signals, scales.signals, strict=True)]
        self.one, self.most = (top + 1) // 2, [top << r for r in self.reads]
        self.tops = [*self.cuts, *self.most[self.n :]]
        self.ends = [
            tuple(int(Fraction(end) * Fraction(2) ** s) for end in (share.low, share.high))
            for share, s in zip(self.shares, scales.given, strict=True)
        ]

    def draw(self, random: Any, count: int) -> tuple[Any, Any]:
        """Return what is given, and signals with the law's own states; in doubles, all exact."""
        real = np.float32 if self.scales is None else float
        rounded = (lambda v: v.astype(real).astype(float)) if self.scales is None else np.round
        kind, most = np.arange(count) % 8, np.array(self.most, dtype=float)
        size = 2.0 ** -random.integers(0, 11, (count, 1))
        y = rounded(random.uniform(-1, 1, (count, len(most))) * most * size)
        signs = random.choice([-1.0, 1.0], y.shape)
        y = np.where(kind[:, None] < 2, rounded(signs * most), y)
        given = np.empty((count, 0))
        if self.shares:
            low, high = np.array(self.ends, dtype=float).T
            part = random.uniform(size=(count, len(low)))
            at_ends = (kind % 4 == 1)[:, None] | (random.uniform(size=part.shape) < 0.1)
            given = low + np.where(at_ends, np.round(part), part) * (high - low)
            given = np.clip(rounded(given), low, high)
        elif self.weights:
            part = random.dirichlet(np.ones(self.weights), size=count)
            given = rounded(part * self.one)
        ties = np.flatnonzero(kind == 7)
        if self.scales is None:  # three halves of a power of two: products that lie between
            y[ties] = 1.5 * 2.0 ** np.floor(np.log2(np.abs(y[ties]) + 1e-6)) * signs[ties]
        else:
            self._halfway(given, y, ties)
        return given, y

    def _halfway(self, given: Any, y: Any, ties: Any) -> None:
        """Put a row's sum half between two answers, at the lower ends of the parameters."""
        tables, scales = self.law.code.gains, self.scales
        if self.law.law.W is not None:  # its gain is known to the code alone
            return
        if self.shares:
            given[ties] = [low for low, _ in self.ends]
        elif self.weights:
            given[ties] = [self.one] + [0] * (self.weights - 1)
        signed = self.law.law.parameters and self.shares
        ends = [(-1) ** sum(e) if signed else int(e[0] == sum(e)) for e in self.law.law.powers]
        K = [
            [
                sum(
                    c * int(k[i][j] * Fraction(2) ** (r - s))
                    for c, k in zip(ends or [1], tables, strict=True)
                )
                for j, s in enumerate(scales.signals)
            ]
            for i, r in enumerate(scales.rows)
        ]
        for count, k in enumerate(ties):
            i = count % len(K)
            shift = scales.rows[i] - scales.answers[i]
            places = [j for j in range(self.n) if K[i][j]]
            if not shift or not places:
                continue
            j = min(places, key=lambda j: K[i][j] & -K[i][j])
            y[k, self.n :] -= [v % 2**r for v, r in zip(y[k], self.reads, strict=True)][self.n :]
            whole_ = [int(v) >> r for v, r in zip(y[k], self.reads, strict=True)]
            rest = 2 ** (shift - 1) - sum(K[i][c] * v for c, v in enumerate(whole_) if c != j)
            even = K[i][j] & -K[i][j]
            unit = max(2**shift // even, 1)
            if rest % even == 0 and unit <= self.one:
                value = (rest // even) * pow(K[i][j] // even, -1, unit) % unit if unit > 1 else 0
                y[k, j] = (int(y[k, j]) // unit) * unit + value


class Stated:
    """Errors that are stated of answers, and of steps of the law's own states."""

    def __init__(self, law: Law, numbers: Numbers) -> None:
        self.claim, self.bits = law.claim, max(0, *numbers.signals)
        units = [Fraction(2) ** (t + FINE) for t in numbers.answers]
        times = [Fraction(1)] * numbers.m + [law.time] * numbers.q
        self.T, self.E, self.off = None, None, 0
        if law.code.scales is None and law.code.T is not None:
            (self.T, self.unit), error = whole(law.code.T), rounding_error(law.claim)
            rows = zip(law.claim.gain.rows, units, strict=True)
            self.rows = np.array([math.floor(error * s * u) for s, u in rows], dtype=object)
            return
        rows = zip(gain_errors(law.claim), units, times, strict=True)
        self.E = np.array(
            [[math.floor(e * u * t) for e in row] for row, u, t in rows], dtype=object
        )
        if law.code.scales is not None:
            pairs = zip(answer_errors(law.code), units, strict=True)
            self.off = np.array([math.floor(e * u) << self.bits for e, u in pairs], dtype=object)

        # of floats nothing is stated of anti-windup but that it is zero where nothing is cut
        self.more, self.G = [], []
        if law.code.G is not None:
            rows = zip(recovery_errors(law.claim), units[numbers.m :], strict=True)
            self.more = [math.floor(e * u) << self.bits for e, u in rows]
            units = [Fraction(2) ** t for t in numbers.answers]
            self.G = [
                [abs(g) * unit / own for g, own in zip(row, units, strict=False)]
                for row, unit in zip(law.code.G, units[numbers.m :], strict=True)
            ]

    def recovering(self, y: Any) -> list[Any]:
        """Return what they are more of each state while an input is cut."""
        of_gain = abs(y) @ self.E.T
        return [
            more + sum(of_gain[:, i] * g.numerator // g.denominator for i, g in enumerate(row))
            for more, row in zip(self.more, self.G, strict=True)
        ]

    def of(self, y: Any) -> Any:
        """Return them in units of 2^-(FINE + bits) of an answer's, rounded down."""
        if self.T is None:
            return abs(y) @ self.E.T + self.off
        squares = ((y @ self.T.T) ** 2).sum(axis=1)
        norms = np.array([math.isqrt(v) for v in squares.tolist()], dtype=object)
        return norms[:, None] * self.rows // self.unit


# --- a case --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """What was found of a law in one format."""

    stated: float
    seen: float
    share: float
    of_states: float


def measured(made: Exported, ranges: Sequence[float], count: int, folder: Path) -> Row:
    """Return the largest errors of the code."""
    code, law, random = Code(made, folder), Law(made), np.random.default_rng(0)
    numbers = Numbers(made, law, ranges)
    stated, n, m = Stated(law, numbers), numbers.n, numbers.m
    units = np.array([2.0**-t for t in numbers.answers])
    behind, least = stated.bits, min(0, *numbers.answers)
    up = np.array([2 ** (behind - s) for s in numbers.signals], dtype=object)
    scale = np.array([2 ** (t - least) for t in numbers.answers], dtype=object)
    most, seen, shares = 0.0, 0.0, np.zeros(len(units))
    for start in range(0, count, CHUNK):
        given, values = numbers.draw(random, min(CHUNK, count - start))
        taken, y = (integers(v.astype(t)) for v, t in ((given, code.word), (values, code.exact)))
        y = y * up
        u, after = code.answers(given, values[:, :n], values[:, n:])
        top, below = law.answers(taken, numbers.given, y)
        if numbers.q:
            time, per = law.time.numerator, law.time.denominator
            below = below * per
            steps = y[:, n:] * below[:, None] + time * top[:, m:]
            top = np.concatenate([per * top[:, :m], steps], axis=1)
        found = integers(np.concatenate([u, after], axis=1).astype(code.exact))
        unit = below[:, None] << (behind - least)
        exact, allowed = top * scale, stated.of(y)  # in units of the answer, times `unit`
        if law.G:
            exact, unit = recovered(law, stated, numbers, (exact, unit), (y, allowed))
        for i, edge in enumerate(numbers.tops):
            exact[:, i] = np.clip(exact[:, i], -edge * unit[:, 0], edge * unit[:, 0])
        error = abs(found * unit - exact)
        room = allowed * unit >> behind
        part = (error * 2**FINE / (room + (error == 0))).astype(float)
        shares = np.maximum(shares, part.max(axis=0))
        most = max(most, float((allowed / 2 ** (FINE + behind) * units)[:, :m].max()))
        seen = max(seen, float((error / unit * units)[:, :m].max()))
    return Row(most, seen, shares[:m].max(), shares[m:].max(initial=0.0))


def recovered(law: Law, stated: Stated, numbers: Numbers, answers: Any, errors: Any) -> Any:
    """Return the answers with what anti-windup makes of steps, and their unit; raise the errors."""
    (exact, unit), (y, allowed) = answers, errors
    units = [Fraction(2) ** t for t in numbers.answers]
    G = [
        [g * unit / own for g, own in zip(row, units, strict=False)]
        for row, unit in zip(law.G, units[numbers.m :], strict=True)
    ]
    per = math.lcm(*(g.denominator for row in G for g in row))
    exact, unit = exact * per, unit * per
    near, cut_off = np.zeros(len(exact), dtype=bool), list[Any]()
    for i, edge in enumerate(numbers.tops[: numbers.m]):
        most = edge * unit[:, 0]
        cut_off.append(np.clip(exact[:, i], -most, most) - exact[:, i])
        off = allowed[:, i] * unit[:, 0] >> stated.bits + FINE
        near |= (abs(exact[:, i]) + off + 1 > most).astype(bool)
    added = stated.recovering(y) or [10**9 * (1 + allowed[:, k]) for k in range(len(G))]
    for k, (row, more) in enumerate(zip(G, added, strict=True), numbers.m):
        if numbers.scales is not None:
            most = numbers.tops[k] * unit[:, 0]
            exact[:, k] = np.clip(exact[:, k], -most, most)
        exact[:, k] += sum(int(g * per) * off // per for g, off in zip(row, cut_off, strict=True))
        allowed[:, k] += np.where(near, more, 0)
    return exact, unit


def ranges_of(case: Case, design: Design, spec: Path) -> dict[str, float]:
    """Return the largest size of each signal: of a law's own states six times their rms."""
    law, plant = design.law, design.plant
    signals = law.measured or [plant.signal(name) for name in map(bare, plant.states)]
    if case.ranges:  # all of them, of a PID its states in code
        return dict(case.ranges)
    known = dict[str, float]()
    for signal in signals:
        if signal.name.startswith(OWN):
            rms, _ = wanted(plant, spec, f"rms of {signal.name}")
            known[signal.name] = 6 * float(sampled(plant, design, rms, seeded(plant)[:200]).worst)
        else:
            known[signal.name] = RANGES[signal.unit]
    return known


def bare(label: str) -> str:
    return label.partition(" [")[0]


def exported(design: Design, kind: str, bits: int, ranges: dict[str, float]) -> tuple[Any, str]:
    """Return the code of a design, None of none, and whether its loop is proved, or why not."""
    sampling = None if design.plant.sample_time is not None else Sampling(0.001, delay=1)
    asked: dict[str, Any] = {"sampling": sampling, "bits": 32}
    if design.law.anti_windup is not None:
        asked["limits"] = LIMIT
    asked |= {"fixed": bits, "ranges": ranges} if kind == "fixed" else {}
    try:
        return export_c99(design, **asked), "yes"
    except (NotProvedError, InputError) as refused:
        why = str(refused)
    if not any(name.startswith(OWN) for name in ranges):
        asked["sampling"] = None  # there is no proof of the loop at samples to look for
    try:
        return export_c99(design, allow_unproved=True, **asked), why
    except InputError:
        return None, why


def print_case(case: Case, folder: Path, count: int) -> bool:
    """Print the rows of a design; return whether an error is larger than is stated."""
    design, wrong = Design.load(found(case, folder)), False
    ranges = ranges_of(case, design, folder / f"{case.folder}.toml")
    for kind, bits in FORMATS:
        made, proved = exported(design, kind, bits, ranges)
        if made is None:
            print(f"| {case.name} | {kind} {bits} | | | | | {proved} |", flush=True)
            continue
        with tempfile.TemporaryDirectory() as code:
            row = measured(made, list(ranges.values()), count, Path(code) / "c")
        wrong = wrong or max(row.share, row.of_states) > 1
        cells = [digits_up(row.stated, 2), digits_down(row.seen, 2), digits_down(row.share, 3)]
        cells.append(digits_down(row.of_states, 3) if row.of_states else "")
        print(f"| {case.name} | {kind} {bits} | {' | '.join(cells)} | {proved} |", flush=True)
    return wrong


def print_dampers(folder: Path, count: int) -> bool:
    """Print the rows of a controllable damper; return whether a coefficient leaves its bounds.

    That it never does is what the proof of stability takes of the code: an error of it has no
    bound, for where the rate is next to zero any coefficient gives the force. In fixed point that
    of the force is stated.
    """
    case = Case("semi-active damper", spec_text("semi-active"))
    document = read_document(found(case, folder, "semi-active") / "law.json")
    wrong = print_float_damper(case, document, count)
    for bits in (32, 16):
        wrong = print_word_damper(case, document, bits, count) or wrong
    return wrong


def print_word_damper(case: Case, document: Any, bits: int, count: int) -> bool:
    """Print the row in fixed point, of forces; return whether one is off by more than is stated."""
    claim, top = document.first(Clipped), largest(bits)
    names, units = zip(*map(split, document.plant.states), strict=True)
    ranges = {name: RANGES[unit] for name, unit in zip(names, units, strict=True)}
    (damper,), (row,), n = claim.dampers, claim.K, len(names)
    signals = scales_of(names, ranges, bits)
    words = in_words(row[:n], damper, signals, bits)
    with tempfile.TemporaryDirectory() as code:
        for name, content in damper_sources(document, fixed=bits, ranges=ranges).items():
            (Path(code) / name).write_bytes(content)
        many = compiled(CHECKS.replace("real", "word"), Path(code))
    random, most, outside = np.random.default_rng(0), 0, 0
    K, unit = whole(row[:n])
    V, per = whole(damper.rate[0][0][:n])
    up = np.array([2 ** (max(signals) - s) for s in signals], dtype=object)
    below = 2 ** max(signals) * unit * per  # of forces, with what c has behind the point
    assert damper.straight
    low, high = (int(end * 2**words.of_c) for end in damper.ends)
    for start in range(0, count, CHUNK):
        size = 2.0 ** -random.integers(0, 11, (min(CHUNK, count - start), 1))
        x = np.round(random.uniform(-1, 1, (len(size), n)) * top * size).astype(f"int{bits}")
        c = np.zeros((len(x), 1), dtype=x.dtype)
        many(ctypes.c_long(len(x)), *(v.ctypes.data_as(ctypes.c_void_p) for v in (x, c)))
        y, chosen = x.astype(object) * up, c[:, 0].astype(object)
        u, v = (y @ K) * per << words.of_c, (y @ V) * unit
        bounds = np.minimum(low * v, high * v), np.maximum(low * v, high * v)
        off = abs(chosen * v - np.clip(u, *bounds))
        most = max(most, int(off.max()))
        outside += int(((chosen < low) | (chosen > high)).sum())
    seen = Fraction(most, below << words.of_c)
    cells = [digits_up(words.error, 2), digits_down(seen, 2), digits_down(seen / words.error, 3)]
    told = f"{outside} of {count} outside" if outside else "always within its bounds"
    print(f"| {case.name} | fixed {bits} | {' | '.join(cells)} | | {told} |", flush=True)
    return outside > 0 or seen > words.error


def print_float_damper(case: Case, document: Any, count: int) -> bool:
    """Print the row in floats; return whether a coefficient leaves its bounds."""
    claim, outside, most = document.first(Clipped), 0, 0.0
    files = damper_sources(document, 32)
    K, unit = whole(claim.K)
    V, per = whole([damper.rate[0][0] for damper in claim.dampers])
    with tempfile.TemporaryDirectory() as code:
        for name, content in files.items():
            (Path(code) / name).write_bytes(content)
        n = int(re.search(r"LAW_STATES (\d+)U", files["law.h"].decode())[1])
        many = compiled(CHECKS, Path(code))
    random = np.random.default_rng(0)
    for start in range(0, count, CHUNK):
        size = 2.0 ** -random.integers(0, 11, (min(CHUNK, count - start), 1))
        x = np.float32(random.uniform(-1, 1, (len(size), n)) * size)
        c = np.zeros((len(x), len(K)), dtype=np.float32)
        many(ctypes.c_long(len(x)), *(v.ctypes.data_as(ctypes.c_void_p) for v in (x, c)))
        y = integers(x)
        u, v = (y @ M[:, :n].T for M in (K, V))
        for k, damper in enumerate(claim.dampers):
            low, high = damper.ends
            exact = np.where(v[:, k] < 0, -u[:, k], u[:, k]) * per / (abs(v[:, k]) * unit)
            exact = np.clip(exact.astype(float), float(low), float(high))
            outside += sum(not low <= Fraction(float(value)) <= high for value in c[:, k])
            most = max(most, float(np.abs(c[:, k] - exact).max()))
    told = f"{outside} of {count} outside" if outside else "always within its bounds"
    print(f"| {case.name} | float 32 | | {digits_down(most, 2)} | | | {told} |", flush=True)
    return outside > 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="designs whose name has this text")
    parser.add_argument("--count", type=int, default=200_000, help="inputs of each export")
    parser.add_argument("--designs", type=Path, help="folder that keeps designs for another run")
    asked, wrong = parser.parse_args(), False
    print("| design | code | stated | seen | share | states | proved |")
    print("|---|---|--:|--:|--:|--:|---|")
    with tempfile.TemporaryDirectory() as kept:
        folder = asked.designs or Path(kept)
        folder.mkdir(parents=True, exist_ok=True)
        for case in CASES:
            if asked.only in case.name:
                wrong = print_case(case, folder, asked.count) or wrong
        if asked.only in "semi-active damper":
            wrong = print_dampers(folder, asked.count) or wrong
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
