"""Poles in a region with the gain as code computes it, in float32, float64 or fixed point.

The design tolerates an error of the gain (kind "gain error"); the rounding of the code, for every
parameter value and every state, stays below it.

The computed u is (K(alpha) + S D C) x for some D, which may depend on x, with S and C the scales of
the claim about the gain; here is a bound on the norm of D. Operations round to nearest with
relative errors of at most u, underflow apart; g(k) = k u / (1 - k u) bounds k of them in a row.

A fixed gain: each entry is off by its own rounding and by g(n) of itself. A polynomial one of terms
K_e c^e, |c| <= 1: by those of its t terms, g(n + t) of them, and by the errors of c^e. Of signals
that are measured, y = C x, the law is off by E y: where C is one matrix, the claim's own C has rows
that are multiples of its rows, else E y is at most |E| |C| |x|.

States that the code keeps itself are stepped by their rates v, the last rows of K y: of the
constant h for the time T between updates, x+ = fl(x + fl(h v)) = x + T v' with

    v' = r v + (d / T) x,    |d| <= u,    |r - 1| <= e = |h / T - 1| + (h / T) ((1 + u)^2 - 1),

so that a row of E grows by e (|K| + E), and by u / T in the column of its own state.

In fixed point errors of entries are those of `words`, of a scheduled law those of `solving`; what
is not an error of the gain is an absolute error of u, which no pole depends on, and is bounded
there.

A scheduled one, where C = T (and S is left out here): with W' = T W T', Z' = Z T', K' = Z' W'^-1,
so that K = K' T, the code computes

    u = (Z' + dZ) (W' + dW)^-1 (T + dT) x,

    |dW| <= g(3 n + 4) trace(W'), from L D L' (an error g(n + 2) of |L| D |L'|, whose entries are at
            most those of sqrt(w_ii w_jj)), its forward and its backward substitution, backwards;
            and the errors of the constants, of the polynomials' values and of their sums,
    |dZ|    likewise, and g(n) of the last product,
    |dT| <= g(n) |T|, entry by entry;

    D = (dZ - K' dW) (W' + dW)^-1 (I + dT T^-1) + K' dT T^-1.

Where the code has a gain L apart, u = (L + (Z' - L W') W'^-1) T x, Z' - L W' takes the place of Z',
and to K' in the last term, and to D, come L and the error of its product, g(2 n) of |L|.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import prod
from typing import Any, ClassVar, Self

from polefence.proof.claims import words
from polefence.proof.claims.base import Claim, Inequality, Verdict, require_work
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.solving import Solving, shifted
from polefence.proof.laws import Law, Point, is_alpha
from polefence.proof.matrices import (
    MAX_BITS,
    Rationals,
    identity,
    inverse,
    is_positive_definite,
    least_work,
    norm,
    product,
    right_divide,
    scaled,
)
from polefence.proof.plant import MAX_PARAMETERS, Plant
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Exponent,
    Polynomial,
    Sizes,
    bernstein,
    count_of,
    diagonal,
    monomials,
    multinomial,
)
from polefence.proof.ranges import Range
from polefence.proof.reading import Table, plain, require_shape
from polefence.proof.short import Short
from polefence.proof.text import region_text
from polefence.proof.work import FormatError

DIGITS = {32: 24, 64: 53}  # binary digits of a number
# Constants of the code, and how near W' and its bound are to one: far from underflow and overflow.
LEAST, MOST, SMALLEST = Fraction(1, 10**18), Fraction(10**18), Fraction(1, 10**6)
UNITS = {32: Fraction(1, 2**24), 64: Fraction(1, 2**53)}  # relative error of one operation


@dataclass(frozen=True)
class Share(Short):
    """The code's constants for a parameter p: scale (p - low), over p where it enters as 1/p."""

    low: Fraction
    high: Fraction
    scale: Fraction


@dataclass(frozen=True)
class Memory(Short):
    """States that the code keeps: the last of plant and signals, their rates the last inputs.

    Every ``sample_time`` each grows by ``step``, the code's constant for that, times its rate;
    ``discrete`` says that so does the plant's.
    """

    states: int
    step: Fraction
    sample_time: Fraction
    discrete: bool = False


@dataclass(frozen=True)
class Code(Short):
    """The constants of the code, with the bits of its numbers; ``L`` is a part of a scheduled gain.

    It is of T x, and in fixed point of x.

    One gain, that of one vertex too, has ``K`` alone. ``shares`` has one entry a parameter, none
    where the code is given alpha itself. W and Z are Bernstein coefficients; of a polynomial law
    ``terms`` has the gains. ``memory`` is of a law of gains with states of its own. ``scales`` are
    of code in fixed point; rows of such states then hold the gains times the sample time, and so
    does ``G``, of anti-windup.
    """

    bits: int
    K: Rationals | None = None
    T: Rationals | None = None
    W: tuple[Rationals, ...] = ()
    Z: tuple[Rationals, ...] = ()
    shares: tuple[Share, ...] = ()
    terms: tuple[Rationals, ...] = ()
    memory: Memory | None = None
    L: Rationals | None = None
    scales: words.Scales | None = None
    G: Rationals | None = None

    @property
    def numbers(self) -> str:
        """What it computes with, in a word."""
        return f"float{self.bits}" if self.scales is None else f"fixed{self.bits}"

    @property
    def gains(self) -> list[Rationals]:
        """The gains of a law of gains, one or one a term; of a scheduled law the part apart."""
        if self.T is not None:
            return [] if self.L is None else [self.L]
        return list(self.terms) if self.K is None else [self.K]


@dataclass(frozen=True)
class Rounded(Short, Claim):
    """All poles lie in the region with the gain that the code computes.

    ``gain`` is what the design tolerates. For scheduled laws ``smallest`` and ``size`` are bounds,
    W' > smallest I and |Z' W'^-1| < size, which the coefficients at ``elevation`` prove; with a
    part L of the gain apart, |Z' W'^-1 - L| < size.
    """

    kind: ClassVar[str] = "rounding"

    gain: GainError
    code: Code
    smallest: Fraction = Fraction(0)
    size: Fraction = Fraction(0)
    elevation: int = 0

    @property
    def inner_points(self) -> list[Point]:
        """Nodes of the parts of the box that the gain is proved in, but its corners."""
        return self.gain.inner_points

    @property
    def allowed(self) -> int | None:
        """Work that it may take; more in parts of the box."""
        return self.gain.allowed

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read what the gain tolerates, and the constants of the code."""
        gain_table, code_table = table.table("gain"), table.table("code")
        gain_table.word("kind", [GainError.kind])
        gain = GainError.read(gain_table, plant, law, on)
        K, T, L, G = (code_table.matrix(key) if key in code_table else None for key in "KTLG")
        keys = ("W", "Z", "terms")
        W, Z, terms = (
            tuple(code_table.matrices(key, None, None)) if key in code_table else () for key in keys
        )
        memory = _read_memory(code_table.table("memory"), plant) if "memory" in code_table else None
        fixed = code_table.table("scales") if "scales" in code_table else None
        scales = None if fixed is None else words.Scales.read(fixed)
        shares = _read_shares(code_table)
        code = Code(code_table.at("bits"), K, T, W, Z, shares, terms, memory, L, scales, G)
        smallest, size = (code_table.number(key, 0) for key in ("smallest", "size"))
        return cls(gain, code, smallest, size, code_table.whole("elevation", 0))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        code = self.code
        constants = ("K",) if code.K is not None else ("terms",) if code.terms else ("T", "W", "Z")
        table: dict[str, Any] = {"bits": code.bits}
        table |= {key: plain(getattr(code, key)) for key in constants}
        if code.shares:
            keys = ("low", "high", "scale")
            table["shares"] = [{key: plain(getattr(s, key)) for key in keys} for s in code.shares]
        if code.memory:
            keys = ("states", "step", "sample_time")
            table["memory"] = {key: plain(getattr(code.memory, key)) for key in keys}
        if code.scales is not None:
            table["scales"] = code.scales.write()
        table |= {} if code.G is None else {"G": plain(code.G)}
        if code.T is not None:
            table |= {} if code.L is None else {"L": plain(code.L)}
            table |= {"smallest": plain(self.smallest), "size": plain(self.size)}
            table["elevation"] = self.elevation
        return {"kind": self.kind, "gain": self.gain.write(), "code": table}

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say where the poles are, of which code."""
        region = region_text(self.gain.subject.design.region)
        return f"poles in {region} with the gain as the {self.code.numbers} code computes it"

    def require(self) -> None:
        """Refuse constants that do not fit, or lead out of the numbers' range."""
        self.gain.require()
        code, law = self.code, self.gain.subject.design.law
        fixed = code.scales is not None
        if type(code.bits) is not int or code.bits not in (words.BITS if fixed else DIGITS):
            raise FormatError("code.bits must be 32 or 64, in fixed point 16 or 32")
        if not fixed:
            _require_numbers(code)
            if code.G is not None:
                raise FormatError("code.G is of fixed point: in floats it is that of the law")
        if code.K is not None or code.terms:
            self._require_gains()
            return
        if law.W is None or law.Z is None or code.T is None or not law.degree:
            raise FormatError("code: the law and its constants do not belong together")
        self._require_scheduled()

    def _require_gains(self) -> None:
        """Refuse gains, one or one a term, that are not those of the law."""
        code, gain, law = self.code, self.gain, self.gain.subject.design.law
        gains = law.K if law.K is not None else law.W or []  # of one vertex K = Z W^-1
        count = len(code.terms) if code.K is None else 1
        one = code.K is None or not law.polynomial or _is_one(law, gain.subject.design.sizes)
        both = code.K is not None and (code.terms or code.shares)
        others = code.T is not None or code.L is not None or code.W or code.Z or both
        if len(gains) != count or others or not one or (code.terms and not law.polynomial):
            raise FormatError("code: the law and its constants do not belong together")
        if code.shares and len(code.shares) != len(gain.subject.ranges):
            raise FormatError("code.shares must hold one entry a parameter")
        m, r = len(gain.rows), len(gains[0][0])
        for matrix in code.terms or [code.K or []]:
            require_shape(matrix, m, r, "code.terms" if code.terms else "code.K")
        _signal_scales(self)
        if code.memory:
            _require_memory(code.memory, gain.subject.design)
        if code.scales is not None:
            _require_words(code, code.scales, gain.subject)

    def _require_scheduled(self) -> None:
        code, gain = self.code, self.gain
        design = gain.subject.design
        if code.memory or code.G is not None:
            raise FormatError("code.memory and code.G are of a law of gains")
        m, n, law, sizes = len(design.B[0][0]), len(design.A[0]), design.law, design.sizes
        count = count_of(sizes, law.degree)
        if len(code.W) != count or len(code.Z) != count:
            raise FormatError(f"code: {count} matrices W and Z are needed, one per coefficient")
        for name, rows, matrices in (("T", n, [code.T or []]), ("W", n, code.W), ("Z", m, code.Z)):
            for matrix in matrices:
                require_shape(matrix, rows, n, f"code.{name}")
        if code.L is not None:
            require_shape(code.L, m, n, "code.L")
        if any(w[i][j] != w[j][i] for w in code.W for i in range(n) for j in range(i)):
            raise FormatError("code.W is not symmetric")
        if code.shares and len(code.shares) != len(gain.subject.ranges):
            raise FormatError("code.shares must hold one entry a parameter")
        if not 0 <= self.elevation <= MAX_DEGREE or self.size <= 0:
            raise FormatError("size must be positive, elevation from 0")
        if (
            self.smallest < SMALLEST
            or max(abs(v) for w in code.W for r in w for v in r) > 1 / SMALLEST
        ):
            raise FormatError(
                f"smallest and code.W must lie between {float(SMALLEST):g} and its inverse"
            )
        if code.scales is None and gain.columns != tuple(map(tuple, code.T or [])):
            raise FormatError("the columns of the gain's error must be those of T")
        number = count_of(sizes, 2 * law.degree + self.elevation)
        require_work(least_work(number, n + m))
        if code.scales is None:
            return
        if code.L is None:
            raise FormatError("code.L is missing: in fixed point a part of the gain is apart")
        if not code.shares and len(sizes) > 1:
            raise FormatError("code.shares: in fixed point a law on the box is given parameters")
        words.require_counts(code.scales, n, m, len(code.shares))
        _require_shares(code, code.scales, gain.subject)
        solving_of(self).require()

    def decided(self) -> Verdict:
        """Prove what the gain tolerates, and that rounding is no more."""
        verdict = self.gain.decided()
        if not verdict.proved:
            return verdict
        try:
            error = rounding_error(self)
        except FormatError as problem:
            return verdict.unless(str(problem))
        if error > self.gain.error:
            return verdict.unless("rounding may be more than what is allowed")
        share = float(error / self.gain.error) if error else 0.0
        percent = math.ceil(1000 * share) / 10
        return verdict.noted(f"rounding at most {percent:g} % of what these allow")


def _read_shares(table: Table) -> tuple[Share, ...]:
    rows = table.tables("shares", MAX_PARAMETERS) if "shares" in table else []
    return tuple(Share(*(row.number(key) for key in ("low", "high", "scale"))) for row in rows)


def _read_memory(table: Table, plant: Plant) -> Memory:
    step, sample_time = (table.number(key) for key in ("step", "sample_time"))
    if plant.sample_time not in (None, sample_time):
        raise FormatError(f"{table.path('sample_time')} must be the plant's")
    count, discrete = table.whole("states", None, 1000, 1), plant.sample_time is not None
    return Memory(count, step, sample_time, discrete)


def _require_memory(memory: Memory, design: Poles) -> None:
    """Refuse states that are not the code's alone: moved by v, and with no part in the plant."""
    q, (n, m) = memory.states, (len(design.A[0]), len(design.B[0][0]))
    if not 0 < q < min(n, m):
        raise FormatError("code.memory.states must leave states and inputs to the plant")
    if memory.step <= 0 or memory.sample_time <= 0:
        raise FormatError("code.memory: step and sample_time must be positive")
    zero, one = [[Fraction(0)] * q for _ in range(n - q)], identity(q)
    none = [[Fraction(0)] * q for _ in range(q)]
    stays, step = (one, memory.sample_time) if memory.discrete else (none, Fraction(1))
    for A, B in zip(design.A, design.B, strict=True):
        alone = [row[n - q :] for row in A] == zero + stays
        if not alone or any(any(row[: n - q]) for row in A[n - q :]):
            raise FormatError("code.memory: the last states must have no part in the plant")
        inputs, others = B[n - q :], [row[m - q :] for row in B[: n - q]]
        rates = [row[m - q :] for row in inputs]
        moved = [[step * x for x in row] for row in one]
        if others != zero or rates != moved or any(any(row[: m - q]) for row in inputs):
            raise FormatError("code.memory: the last inputs must be the rates of the last states")
    if design.remainder is not None:
        for M in design.remainder.curve:
            at_rest = [row[n - q : n] + row[n + m - q : n + m] for row in M]
            if any(map(any, at_rest)) or any(map(any, M[n - q :])):
                raise FormatError("code.memory: the plant's curve is not of the last states")
    for C in design.law.C:
        first, last = C[: len(C) - q], C[len(C) - q :]
        kept = [row[n - q :] for row in last] == one and not any(any(r[: n - q]) for r in last)
        if len(C) <= q or not kept or any(any(row[n - q :]) for row in first):
            raise FormatError("code.memory: the last signals must be the last states alone")


def _require_words(code: Code, scales: words.Scales, subject: Subject) -> None:
    """Refuse constants that are no integers of the code, or may lead to others it cannot hold."""
    states = code.memory.states if code.memory else 0
    words.require(code.bits, code.gains, scales, states, len(code.shares))
    _require_shares(code, scales, subject)
    if (code.G is None) != (subject.design.law.anti_windup is None):
        raise FormatError("code.G: the law and its constants do not belong together")
    if code.G is not None:
        require_shape(code.G, states, len(scales.rows) - states, "code.G")
        words.require_recovering(code.bits, code.gains, code.G, scales)
    if not code.shares and code.terms and not is_alpha(subject.design.law, subject.design.sizes):
        raise FormatError("code.shares: in fixed point a law of parameters is given these")


def _require_shares(code: Code, scales: words.Scales, subject: Subject) -> None:
    """Refuse constants of parameters that are no integers."""
    # of one gain there are no shares, whatever parameters the plant has
    for share, given, exponent in zip(code.shares, subject.ranges, scales.given, strict=False):
        ends = share.low, share.high, share.scale
        words.require_share(code.bits, *ends, exponent, given.inverted)


def _require_numbers(code: Code) -> None:
    """Refuse constants that the code cannot hold, or that lead out of its numbers' range."""
    others = [[s.low, s.high, s.scale] for s in code.shares]
    others += [[code.memory.step]] if code.memory else []
    for matrix in [code.K or [], code.L or [], code.T or [], *code.W, *code.Z, *code.terms, others]:
        for row in matrix:
            for value in row:
                if value and not (LEAST <= abs(value) <= MOST and _is_held(value, code.bits)):
                    raise FormatError(
                        f"code: a constant is no float{code.bits} from {float(LEAST):g} to "
                        f"{float(MOST):g}"
                    )


def _is_held(value: Fraction, bits: int) -> bool:
    top, bottom = abs(value.numerator), value.denominator
    odd = top // (top & -top)
    return bottom & (bottom - 1) == 0 and odd.bit_length() <= DIGITS[bits]


def rounding_error(claim: Rounded) -> Fraction:
    """Return a bound on the norm of D.

    Raises
    ------
    FormatError
        If a bound that the claim rests on does not hold.
    """
    if claim.code.T is not None and claim.code.scales is None:
        return _scheduled(claim)
    E, rows, scales = gain_errors(claim), claim.gain.rows, _signal_scales(claim)
    if scales is None:  # of x, by the largest |C|
        E, scales = product(E, _largest_entries(claim)), _numbers(claim.gain)
    pairs = zip(E, rows, strict=True)
    return norm([[e / s / t for e, t in zip(row, scales, strict=True)] for row, s in pairs])


def in_a_row(code: Code, k: int) -> Fraction:
    """Return the largest relative error of k operations."""
    u = UNITS[code.bits]
    if 2 * k * u >= 1:
        raise FormatError("code: too many operations for its numbers")
    return k * u / (1 - k * u)


def gain_errors(claim: Rounded) -> Rationals:
    """Return bounds on the errors of the entries of the gain, of one gain or a polynomial.

    In fixed point of a scheduled law too.
    """
    code, law = claim.code, claim.gain.subject.design.law
    if code.T is not None:
        solving = solving_of(claim)
        _require_bounds(claim, solving.W, [solving.in_units(z) for z in solving.Z])
        return solving.gain_errors()
    gains = [code.K] if code.K is not None else list(code.terms)
    exact = [_gain(claim)] if code.K is not None else law.K or []
    if code.scales is not None:
        return _in_words(claim, code.scales, exact)
    off = [Fraction(0)] if code.K is not None else power_errors(claim)
    gamma = in_a_row(code, len(gains[0][0]) + len(code.terms))
    total = [[Fraction(0)] * len(row) for row in gains[0]]
    for a, b, t in zip(exact, gains, off, strict=True):
        part = t + gamma * (1 + t)
        for i, row in enumerate(total):
            for j in range(len(row)):
                row[j] += abs(a[i][j] - b[i][j]) + part * abs(b[i][j])
    return total if code.memory is None else _with_steps(total, exact, code.memory, code.bits)


def _in_words(claim: Rounded, scales: words.Scales, exact: Sequence[Rationals]) -> Rationals:
    """Return them in fixed point: the rows of own states are those of a step."""
    code, m = claim.code, len(scales.rows)
    first = m - (code.memory.states if code.memory else 0)
    time = code.memory.sample_time if code.memory else Fraction(1)
    times = [time if i >= first else Fraction(1) for i in range(m)]
    steps = [scaled(K, tuple(1 / t for t in times)) for K in exact]
    off = [Fraction(0)] if code.K is not None else word_errors(claim)
    errors = words.gain_errors(steps, code.gains, off, scales, code.K is None)
    return scaled(errors, tuple(times))


def word_errors(claim: Rounded) -> list[Fraction]:
    """Return bounds on the errors of c^e of each term, in fixed point."""
    law, sizes = claim.gain.subject.design.law, claim.gain.subject.design.sizes
    ends, alpha = _share_errors(claim)
    bases = [2 * end for end in ends]
    if is_alpha(law, sizes):
        bases = [alpha] * len(law.powers[0])
    return _power_errors(law.powers, bases, words.half(claim.code.bits))


def _share_errors(claim: Rounded) -> tuple[list[Fraction], Fraction]:
    """Return bounds on the errors of parameters' places in fixed point, and of alpha.

    That is given, or of parameters the products of their weights.
    """
    half = words.half(claim.code.bits)
    pairs = zip(claim.code.shares, claim.gain.subject.ranges, strict=False)  # none of alpha
    ends = [constants_error(share, given) + half for share, given in pairs]
    return ends, sum(ends, (len(ends) - 1) * half) if ends else half


def _power_errors(
    powers: Sequence[Exponent], bases: Sequence[Fraction], half: Fraction
) -> list[Fraction]:
    """Return bounds on the errors of products of numbers of size one at most."""
    return [
        sum((k * off for k, off in zip(e, bases, strict=True)), max(sum(e) - 1, 0) * half)
        for e in powers
    ]


def solving_of(claim: Rounded) -> Solving:
    """Return what the errors of a scheduled law in fixed point are made of."""
    code, design = claim.code, claim.gain.subject.design
    law, sizes, T, L = design.law, design.sizes, code.T or [], code.L or []
    if code.scales is None:
        raise FormatError("code.scales is missing")
    ends, alpha = _share_errors(claim)
    if len(sizes) == 1 and len(ends) != 1:
        bases = [alpha] * sizes[0]
    else:
        bases = [end for end in ends for _ in range(2)]
    powers = monomials(sizes, law.degree)
    each = _power_errors(powers, bases, words.half(code.bits))
    pairs = zip(powers, each, strict=True)
    formed = sum((multinomial(e, sizes) * off for e, off in pairs), Fraction(0))
    right = [list(column) for column in zip(*T, strict=True)]
    W = [product(product(T, w), right) for w in law.W or []]
    Z = shifted(law.Z or [], law.W or [], L, T)
    known = claim.smallest, claim.size
    return Solving(code.bits, code.scales, T, L, code.W, code.Z, W, Z, formed, *known)


def answer_errors(code: Code) -> list[Fraction]:
    """Return bounds on the absolute errors of u in fixed point, and of a step of the states."""
    if code.scales is None:
        return []
    return words.answer_errors(code.gains, code.scales, code.memory.states if code.memory else 0)


def recovery_errors(claim: Rounded) -> list[Fraction]:
    """Return bounds on what anti-windup adds to the errors of a step in fixed point, none without.

    Besides what T G makes of the error of u as one of the gain; zero while nothing is cut.
    """
    code, gain = claim.code, claim.gain.subject.design.law.anti_windup
    if code.G is None or code.scales is None or code.memory is None or gain is None:
        return []
    m, time = len(code.G[0]), code.memory.sample_time
    exact = [[time * g for g in row[:m]] for row in gain[len(gain) - len(code.G) :]]
    return words.step_errors(code.bits, code.gains, code.G, exact, code.scales)


def _with_steps(E: Rationals, terms: Sequence[Rationals], memory: Memory, bits: int) -> Rationals:
    """Return bounds on the errors of a gain whose last rows are the rates of the last signals."""
    unit, ratio, q = UNITS[bits], memory.step / memory.sample_time, memory.states
    grown = abs(ratio - 1) + ratio * ((1 + unit) ** 2 - 1)
    errors, first = [list(row) for row in E], len(E) - q
    for i in range(first, len(E)):
        sizes = [sum(abs(K[i][j]) for K in terms) for j in range(len(E[i]))]
        errors[i] = [e + grown * (size + e) for e, size in zip(E[i], sizes, strict=True)]
        errors[i][len(E[i]) - q + i - first] += unit / memory.sample_time
    return errors


def power_errors(claim: Rounded) -> list[Fraction]:
    """Return bounds on the errors of c^e of each term."""
    code, subject = claim.code, claim.gain.subject
    law, sizes, unit = subject.design.law, subject.design.sizes, UNITS[code.bits]
    in_alpha = is_alpha(law, sizes)
    if code.shares:  # of the weights of a parameter's two ends
        pairs = zip(code.shares, subject.ranges, strict=True)
        ends = [share_error(code, share, given) + unit for share, given in pairs]
        of_alpha = prod((1 + end for end in ends), start=1 + in_a_row(code, len(ends) - 1)) - 1
    else:  # cut, summed, scaled, and for a box summed again
        of_alpha = in_a_row(code, 2 * len(subject.design.A) + 2)
        ends = [of_alpha] * len(sizes)
    bases = [of_alpha] * sizes[0] if in_alpha else [2 * end + unit * (1 + end) for end in ends]
    return [
        prod(((1 + off) ** power for off, power in zip(bases, e, strict=True)), start=Fraction(1))
        * (1 + in_a_row(code, sum(e)))
        - 1
        for e in law.powers
    ]


def _is_one(law: Law, sizes: Sizes) -> bool:
    """Whether the only term of a polynomial law is one."""
    return len(law.powers) == 1 and (not any(law.powers[0]) or sizes == (1,))


def _numbers(gain: GainError) -> tuple[Fraction, ...]:
    columns = tuple(c for c in gain.columns if isinstance(c, Fraction))
    if len(columns) != len(gain.columns):
        raise FormatError("columns must be numbers for a law of states")
    return columns


def _signal_scales(claim: Rounded) -> tuple[Fraction, ...] | None:
    """Return the scales of the errors' columns: of the signals; None where those are of states."""
    gain, C = claim.gain, claim.gain.subject.design.law.C
    if not C:
        return _numbers(gain)
    if all(isinstance(column, Fraction) for column in gain.columns):
        return None
    scales, right = list[Fraction](), gain.right
    if len(C[0]) > len(right) or any(other != C[0] for other in C):
        raise FormatError(
            "columns must be numbers for this number of measured signals, or where C varies"
        )
    for signal, row in zip(C[0], right, strict=False):
        k = next((k for k, value in enumerate(signal) if value), 0)
        scale = row[k] / signal[k] if signal[k] else Fraction(1)
        if scale <= 0 or row != [scale * value for value in signal]:
            raise FormatError("columns must be multiples of the rows of what is measured")
        scales.append(scale)
    return tuple(scales)


def _largest_entries(claim: Rounded) -> Rationals:
    """Return the largest absolute values of the entries of what is measured."""
    C = claim.gain.subject.design.law.C
    return [[max(map(abs, xs)) for xs in zip(*rows, strict=True)] for rows in zip(*C, strict=True)]


def _gain(claim: Rounded) -> Rationals:
    """Return the one gain of the design; of one vertex Z W^-1."""
    law = claim.gain.subject.design.law
    K = law.K[0] if law.K else right_divide((law.Z or [])[0], (law.W or [])[0])
    if K is None:
        raise FormatError("W is singular")
    return K


def _scheduled(claim: Rounded) -> Fraction:
    code, rows, T = claim.code, claim.gain.rows, claim.code.T or []
    n, u = len(T), UNITS[code.bits]
    W, Z = transformed(claim)
    L = None if code.L is None else scaled(code.L, rows)
    if L is not None:
        Z = [_difference(z, product(L, w)) for z, w in zip(Z, W, strict=True)]
    own_Z = [scaled(z, rows) for z in code.Z]
    terms = in_a_row(code, len(W))
    formed = (1 + terms) * (1 + weight_error(claim)) - 1  # of sizes of the coefficients
    of_W = formed * _largest(code.W) + _largest(map(_difference, code.W, W))
    of_Z = formed * _largest(own_Z) + _largest(map(_difference, own_Z, Z))
    of_L = in_a_row(code, 3 * n + 4) / (1 - in_a_row(code, n + 2))
    of_W += of_L * (_require_bounds(claim, W, Z) + n * of_W)
    products = in_a_row(code, n if L is None else 2 * n)
    of_Z += products * (1 + formed) * _largest(own_Z)
    if of_W >= claim.smallest:
        raise FormatError(f"rounding with u = {float(u):.0e} may make W singular")
    size = claim.size
    error = (of_Z + size * of_W) / (claim.smallest - of_W)
    if L is not None:
        apart = norm(_absolute(L))
        error, size = error + products * apart, size + apart
    of_T = in_a_row(code, n) * norm(product(_absolute(T), _absolute(_inverse(T))))
    return error * (1 + of_T) + size * of_T


def _require_bounds(claim: Rounded, W: list[Rationals], Z: list[Rationals]) -> Fraction:
    """Prove W' > smallest I and, by W'^2 > Z'^T Z' / size^2, |K'| < size; bound W's trace."""
    design, n, m = claim.gain.subject.design, len(W[0]), len(Z[0])
    sizes, degree, by = design.sizes, design.law.degree, claim.elevation
    limit = 8 * MAX_BITS
    P, Q = (bernstein(matrices, sizes, degree, limit) for matrices in (W, Z))
    raised = P.elevated(by)
    trace = Fraction(0)
    for e, coefficient in raised.terms.items():
        count = multinomial(e, sizes)
        trace = max(trace, Fraction(sum(coefficient[i][i] for i in range(n)), count * raised.whole))
    above = P - diagonal([claim.smallest] * n, sizes)
    _require_positive([[above]], by, "W' is not proved to be above the bound given")
    corner = diagonal([claim.size**2] * m, sizes)
    _require_positive(
        [[P * P, Q.T], [corner]], by, "Z' W'^-1 is not proved to be below the bound given"
    )
    return trace


def _require_positive(rows: list[list[Polynomial]], by: int, fault: str) -> None:
    for _, matrix in Inequality.raised("", rows, by).blocks():
        if not is_positive_definite(matrix):
            raise FormatError(fault)


def transformed(claim: Rounded) -> tuple[list[Rationals], list[Rationals]]:
    """Return T W T' and S^-1 Z T' of the design's law."""
    law, T = claim.gain.subject.design.law, claim.code.T or []
    right = [list(column) for column in zip(*T, strict=True)]
    W = [product(product(T, w), right) for w in law.W or []]
    return W, [product(scaled(z, claim.gain.rows), right) for z in law.Z or []]


def weight_error(claim: Rounded) -> Fraction:
    """Return a bound on the sum of the errors of the Bernstein polynomials' values."""
    code, subject = claim.code, claim.gain.subject
    sizes, degree = subject.design.sizes, subject.design.law.degree
    corners = len(subject.design.A)
    products = in_a_row(code, len(sizes) * degree + 1)  # a large multinomial is rounded too
    if not code.shares:  # cut, summed, scaled, and for a box summed again
        cut = in_a_row(code, 2 * corners + 2)
        return (1 + cut) ** (degree * len(sizes)) * (1 + products) - 1
    pairs = zip(code.shares, subject.ranges, strict=True)
    errors = [2 * share_error(code, share, given) + UNITS[code.bits] for share, given in pairs]
    total = prod((1 + error for error in errors), start=Fraction(1))
    if len(sizes) == 1 < len(errors):  # alpha, the product of the parameters' weights
        total *= 1 + in_a_row(code, len(errors) - 1)
    return total**degree * (1 + products) - 1


def share_error(code: Code, share: Share, given: Range) -> Fraction:
    """Return how far the share of one parameter may be off."""
    least = min(abs(share.low), abs(share.high)) if given.inverted else Fraction(1)
    rounded = in_a_row(code, 3) * abs(share.scale) * (share.high - share.low)
    return constants_error(share, given) + rounded / least


def constants_error(share: Share, given: Range) -> Fraction:
    """Return how far it may be off by its constants alone."""
    width = given.high - given.low
    scale = given.high / width if given.inverted else 1 / width
    if not (share.low <= given.low < given.high <= share.high):
        raise FormatError("a parameter is clamped inside its interval")
    if given.inverted and share.low <= 0 <= share.high:
        raise FormatError("a parameter's bounds in the code touch zero")
    least = min(abs(share.low), abs(share.high)) if given.inverted else Fraction(1)
    clamped = share.high - share.low
    return (abs(share.scale - scale) * clamped + abs(scale) * (given.low - share.low)) / least


# --- matrices ------------------------------------------------------------------------------------


def _difference(left: Rationals, right: Rationals) -> Rationals:
    return [[a - b for a, b in zip(p, q, strict=True)] for p, q in zip(left, right, strict=True)]


def _absolute(matrix: Rationals) -> Rationals:
    return [[abs(value) for value in row] for row in matrix]


def _inverse(lower: Rationals) -> Rationals:
    """Return the inverse of a lower triangular matrix."""
    n = len(lower)
    if any(lower[i][j] for i in range(n) for j in range(i + 1, n)):
        raise FormatError("code.T must be lower triangular")
    return inverse(lower, "code.T")


def _largest(matrices: Iterable[Rationals]) -> Fraction:
    return max(map(norm, matrices))
