"""Numbers that the exported code computes with: scaled so that single precision suffices.

A scheduled law u = Z(alpha) W(alpha)^-1 x becomes Z' W'^-1 (T x) with W' = T W T', Z' = Z T',
where T is chosen so that W' is the identity at the centre of the family: whatever the units of the
states, its entries are near one.

Near the centre that is a gain, which needs no solution of equations: with L, a gain amid those of
the corners, it becomes (L + (Z' - L W') W'^-1) (T x), and what the solution in floats is off by
weighs as much as the gain varies, not as much as it is.

A polynomial law has no such scaling: all powers c^e are found once, then each entry of the gain is
a sum of as many products as there are terms; Horner's scheme would take no fewer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from polefence.base.errors import InputError
from polefence.law.coordinates import Coordinates
from polefence.law.laws import FixedGain, Law
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain, Exponent, binomial
from polefence.plant.system import Array
from polefence.proof.claims.words import Scales
from polefence.proof.short import Short

Exact = list[list[Fraction]]
MAX_TERMS = 512  # polynomials' coefficients, which the code computes one by one
# Constants whose products stay in the format's range; smaller ones are zero.
LEAST, MOST = 1e-18, 1e18


@dataclass(frozen=True)
class Share(Short):
    """A parameter's place in its interval, 0 at low and 1 at high, as the code finds it.

    scale (p - low) where the plant is affine in p, scale (p - low) / p where it is in 1/p.

    Attributes
    ----------
    parameter : Parameter
    low, high : float
        What p is clamped to: the interval, rounded outwards.
    scale : float
    """

    parameter: Parameter
    low: float
    high: float
    scale: float


@dataclass(frozen=True, eq=False)
class Memory(Short):
    """States that the code keeps, the last signals; each grows by ``step`` times its rate.

    Attributes
    ----------
    states : int
        Their rates are as many inputs, the last ones.
    step, sample_time : float
        From one update to the next [s]: a number of the format, and what it is to be.
    anti_windup : (states, inputs) array, optional
        What the part of u that is cut off adds to their rates, as the code has it; in fixed point
        to their steps.
    """

    states: int
    step: float
    sample_time: float
    anti_windup: Array | None = None


@dataclass(frozen=True, eq=False)
class Fixed(Short):
    """u = K x, or K y of signals that are measured.

    Attributes
    ----------
    number : Number
    K : (m, n) array
        As the code has it: every entry a number of the format.
    measured : bool
        Whether it is given y.
    memory : Memory, optional
        Of a law with states of its own.
    scales : Scales, optional
        In fixed point.
    """

    number: Number
    K: Array
    measured: bool = False
    memory: Memory | None = None
    scales: Scales | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """States, or signals, and inputs."""
        m, n = self.K.shape
        return n, m

    @property
    def sizes(self) -> Array:
        """Largest sizes of the gain's entries, (m, n)."""
        return np.abs(self.K)


@dataclass(frozen=True, eq=False)
class Polynomial(Short):
    """u = K(c) x, or K(c) y of signals that are measured, K the sum of its terms' gains times c^e.

    c are alpha, or the coordinates of parameters from -1 to 1: see `PolynomialGain`.

    Attributes
    ----------
    number : Number
    shares : tuple of Share
        Empty where the code is given alpha itself.
    domain : Domain
    powers : tuple of exponents
    gains : (terms, m, n) array
        As the code has them: every entry a number of the format.
    measured : bool
        Whether it is given y.
    memory : Memory, optional
        Of a law with states of its own.
    scales : Scales, optional
        In fixed point.
    """

    number: Number
    shares: tuple[Share, ...]
    domain: Domain
    powers: tuple[Exponent, ...]
    gains: Array
    measured: bool = False
    memory: Memory | None = None
    scales: Scales | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """States, or signals, and inputs."""
        _, m, n = self.gains.shape
        return n, m

    @property
    def sizes(self) -> Array:
        """Largest sizes of the gain's entries, (m, n)."""
        return np.asarray(np.abs(self.gains).sum(axis=0))

    @property
    def signed(self) -> bool:
        """Whether c are coordinates of parameters."""
        return self.domain.sizes != (len(self.powers[0]),)

    def weights(self) -> list[tuple[int, Exponent]]:
        """Return for each term its factor, one, and its exponents of c."""
        return [(1, e) for e in self.powers]


@dataclass(frozen=True, eq=False)
class Scheduled(Short):
    """u = (L + Z(w) W(w)^-1) T x, w the Bernstein polynomials' values.

    In fixed point u = (L + Z(w) W(w)^-1 T) x.

    Attributes
    ----------
    number : Number
    shares : tuple of Share
        Empty where the code is given alpha itself.
    domain, degree
        Of the polynomials.
    T : (n, n) array, lower triangular
    W : (count, n, n) array, symmetric
    Z : (count, m, n) array
        As the code has them: every entry a number of the format.
    L : (m, n) array, optional
        None is zero.
    scales : Scales, optional
        In fixed point.
    """

    number: Number
    shares: tuple[Share, ...]
    domain: Domain
    degree: int
    T: Array
    W: Array
    Z: Array
    L: Array | None = None
    scales: Scales | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """States and inputs."""
        _, m, n = self.Z.shape
        return n, m

    def weights(self) -> list[tuple[int, Exponent]]:
        """Return for each coefficient its multinomial and its exponents of the coordinates."""
        return [(binomial(self.domain.sizes, e), e) for e in self.domain.monomials(self.degree)]


Program = Fixed | Polynomial | Scheduled


def program(law: Law, parameters: tuple[Parameter, ...], number: Number) -> Program:
    """Return what the code of a law computes in a number format.

    Parameters
    ----------
    parameters : tuple of Parameter
        What the code is given; empty for alpha itself.

    Raises
    ------
    InputError
        If the law has too many coefficients, or numbers out of the format's range.
    """
    if law.K is not None:
        return Fixed(number, _held(number.nearest(law.K), "K"))
    count = len(law.form if law.gains is None else law.gains)
    if count > MAX_TERMS:
        raise InputError(f"a law of {count} coefficients is not exported; at most {MAX_TERMS}")
    if parameters and 2 ** len(parameters) != law.domain.corners:
        raise InputError("the plant's vertices are not those of its parameters; export with alpha")
    shares = tuple(_share(p, number) for p in parameters)
    if law.gains is not None:
        gains, measured = _held(number.nearest(law.gains), "K"), bool(law.measured)
        if law.fixed:
            return Fixed(number, gains[0], measured)
        return Polynomial(number, shares, law.domain, law.powers, gains, measured)
    if not law.degree:
        raise InputError("a law of degree 0 is one gain; export FixedGain(law.gain(alpha))")
    T = _held(number.nearest(_whitening(law)), "T")
    coordinates = Coordinates(T)
    W, Z = np.split(law.form, [len(T)], axis=1)
    return Scheduled(
        number,
        shares,
        law.domain,
        law.degree,
        T,
        _held(number.nearest(coordinates.forms(W)), "W"),
        _held(number.nearest(coordinates.gains(Z)), "Z"),
    )


def code_law(law: Law) -> Law:
    """Return the law as code computes it: that of one vertex is one gain."""
    if law.W is not None and law.domain.corners == 1:
        return FixedGain(law.gain([1.0]))
    return law


def amid(program: Program, law: Law) -> Program:
    """Return the program of a scheduled law with the part of its gain that does not vary apart."""
    if not isinstance(program, Scheduled):
        return program
    coordinates, nearest = Coordinates(program.T), program.number.nearest
    gains = law.gain(np.eye(program.domain.corners)) @ np.linalg.inv(program.T)
    L = _held(nearest((gains.min(axis=0) + gains.max(axis=0)) / 2), "L")
    W, Z = np.split(law.form, [len(program.T)], axis=1)
    Z = coordinates.gains(Z) - L @ coordinates.forms(W)
    return replace(program, L=L, Z=_held(nearest(Z), "Z"))


def scales_of(program: Program) -> Scales | None:
    """Return the exponents of fixed-point code, None of floats."""
    return program.scales


def memory_of(program: Program) -> Memory | None:
    """Return the states that the code keeps, where it does."""
    return None if isinstance(program, Scheduled) else program.memory


def with_memory(program: Program, states: int, sample_time: float) -> Program:
    """Return the program of a law of gains whose last states the code keeps.

    Raises
    ------
    InputError
        If the sample time is out of the format's range.
    """
    if not states or isinstance(program, Scheduled):
        return program
    step = _held(program.number.nearest(np.array([sample_time])), "sample time")
    if not step[0]:
        raise InputError(f"sample time = {sample_time:g} s is too short for the code")
    return replace(program, memory=Memory(states, float(step[0]), sample_time))


def with_anti_windup(program: Program, law: Law) -> Program:
    """Return the program of code that cuts its inputs, with the law's anti-windup gain."""
    memory, gain = memory_of(program), law.anti_windup
    if memory is None or gain is None or isinstance(program, Scheduled):
        return program
    if program.scales is not None:  # made with it
        return program
    inputs = program.shape[1] - memory.states
    own = program.number.nearest(gain[-memory.states :, :inputs])
    return replace(program, memory=replace(memory, anti_windup=_held(own, "anti-windup")))


def exactly(matrix: Array) -> Exact:
    """Return a matrix of doubles as the rationals that they are."""
    return [[Fraction(float(value)) for value in row] for row in matrix]


def _whitening(law: Law) -> Array:
    """Return T with T W T' = I at the centre of the family."""
    if law.coordinates.whitens:
        return law.coordinates.T
    raise InputError("W is not positive definite at the centre of the family")


def _share(p: Parameter, number: Number) -> Share:
    width = p.high - p.low
    scale = p.high / width if p.inverted else 1 / width
    _held(np.array([float(abs(p.low)), float(abs(p.high)), abs(float(scale))]), p.name)
    low, high = number.outward(p.low, up=False), number.outward(p.high, up=True)
    if p.inverted and min(abs(low), abs(high)) < LEAST:
        raise InputError(
            f"{p.name}: its interval begins too near to zero for code that divides by it; choose a "
            "unit in which it is nearer to one"
        )
    return Share(p, low, high, float(number.nearest(np.array(float(scale)))))


def _held(values: Array, what: str) -> Array:
    """Refuse numbers near the ends of the format's range."""
    size = np.abs(values[values != 0])
    if not np.all(np.isfinite(values)) or (size.size and size.max() > MOST):
        raise InputError(
            f"{what}: numbers of the law reach {size.max():.3g}, too large for the code; choose "
            "units in which states and inputs are nearer to one"
        )
    return np.where(np.abs(values) < LEAST, 0.0, values)  # a rounding like any other


@dataclass(frozen=True)
class Number(Short):
    """One of the two formats of floats.

    Attributes
    ----------
    bits : int
        32 or 64.
    unit : Fraction
        Unit roundoff, the largest relative error of one operation.
    """

    bits: int
    unit: Fraction

    @property
    def kind(self) -> str:
        """What code of it is called."""
        return f"{self.c_type} code"

    @property
    def c_type(self) -> str:
        """The type in C."""
        return "float" if self.bits == 32 else "double"

    @property
    def largest(self) -> str:
        """The macro of <float.h> with the largest finite number."""
        return "FLT_MAX" if self.bits == 32 else "DBL_MAX"

    def nearest(self, values: Array) -> Array:
        """Return the nearest numbers of the format, as doubles, which hold both."""
        if self.bits == 64:
            return np.asarray(values, dtype=float)
        with np.errstate(over="ignore"):
            return np.asarray(values, dtype=np.float32).astype(float)

    def outward(self, value: Fraction, up: bool) -> float:
        """Return the nearest number of the format that is not below (not above) a rational."""
        nearest = float(self.nearest(np.array(float(value))))
        wrong = Fraction(nearest) < value if up else Fraction(nearest) > value
        if not wrong:
            return nearest
        towards = np.inf if up else -np.inf
        if self.bits == 32:
            return float(np.nextafter(np.float32(nearest), np.float32(towards)))
        return float(np.nextafter(nearest, towards))

    def text(self, value: float) -> str:
        """Write a number as a C constant that reads back as the same number."""
        digits = f"{value:.9g}" if self.bits == 32 else repr(float(value))
        if not any(c in digits for c in ".e"):
            digits += ".0"
        return digits + ("F" if self.bits == 32 else "")


class Word(Number):
    """Integers of so many bits, scaled by powers of two: fixed point."""

    @property
    def kind(self) -> str:
        """What code of it is called."""
        return f"fixed-point code, {self.bits} bits"

    @property
    def c_type(self) -> str:
        """The type in C."""
        return f"int{self.bits}_t"


def word(bits: int) -> Word:
    """Return integers of so many bits."""
    return Word(bits, Fraction(1, 2**bits))


WORDS = {bits: word(bits) for bits in (16, 32)}
NUMBERS = {32: Number(32, Fraction(1, 2**24)), 64: Number(64, Fraction(1, 2**53))}


def number(bits: int) -> Number:
    """Return the format of so many bits.

    Raises
    ------
    InputError
        If it is neither 32 nor 64.
    """
    if bits not in NUMBERS:
        raise InputError(f"float = {bits!r} is not supported; use 32 or 64")
    return NUMBERS[bits]
