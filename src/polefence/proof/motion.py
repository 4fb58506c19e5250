"""Time-varying parameters: how a Lyapunov polynomial changes with them.

While p(t) varies, the derivative of x' X^-1 x contains -X^-1 (dX/dt) X^-1. A condition on N + N'
becomes one on N + N' - dX/dt, with dX/dt = sum_f dX/dp_f dp_f/dt. It is affine in the rates. If it
holds at all extremes of the rates, it holds for all rates between (Wu, Yang, Packard & Becker,
1996).

In discrete time X(p(t + T)) - X(p(t)) takes the place of T dX/dt. If X is affine in the scheduling
variable of every moving parameter, this difference is affine in their steps, and again the extremes
are enough (Daafouz & Bernussou, 2001, for any rate). For s = 1/p a step is s - s+ = s s+ dp, where
s s+ lies between 0 and |s| times the largest |s|.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import product
from typing import Literal, Protocol

from polefence.proof.dead_time import DeadTime
from polefence.proof.matrices import ZERO
from polefence.proof.polynomials import Polynomial, Sizes, number
from polefence.proof.ranges import ANY, Range
from polefence.proof.text import digits_down, digits_up, name_text, quoted, rate_text, unit_text
from polefence.proof.work import FormatError

Moving = Sequence[tuple[int, Range]]  # parameters that move, with their numbers


class Box(Protocol):
    """A part of the box of the parameters, with its lower and upper corner."""

    @property
    def low(self) -> tuple[Fraction, ...]:
        """The lower corner."""

    @property
    def high(self) -> tuple[Fraction, ...]:
        """The upper corner."""


def change(X: Polynomial, f: int, parameter: Range) -> Polynomial:
    """Return dX/dp of parameter f, per unit of p, for X on the box of the parameters."""
    slope = _slope(X, f)
    low, high = (
        (1 / parameter.low, 1 / parameter.high)
        if parameter.inverted
        else (parameter.low, parameter.high)
    )
    if parameter.inverted:  # the scheduling variable s = 1/p changes with s^2 dp/dt
        s = _variable(f, (low, high), X.sizes)
        slope = s * s * slope
    return slope.times(1 / abs(high - low))


def _variable(f: int, ends: tuple[Fraction, Fraction], sizes: Sizes) -> Polynomial:
    """Return a scheduling variable as a polynomial, from its values at both ends."""
    start, length = sum(sizes[:f]), sum(sizes)
    degrees = tuple(int(g == f) for g in range(len(sizes)))
    units = [tuple(int(j == start + c) for j in range(length)) for c in range(2)]
    one, other = (
        Polynomial({unit: [[end.numerator]]}, sizes, degrees, end.denominator)
        for unit, end in zip(units, ends, strict=True)
    )
    return one + other


def is_moving(ranges: Sequence[Range]) -> bool:
    """Whether any parameter moves."""
    return any(parameter.rate is not None for parameter in ranges)


def is_late(ranges: Sequence[Range]) -> bool:
    """Whether what moves stands for a dead time, and nothing else does."""
    moving = [parameter for parameter in ranges if parameter.rate is not None]
    return bool(moving) and all(parameter.dead_time is not None for parameter in moving)


def require_late_cells(ranges: Sequence[Range], cells: Sequence[Box]) -> None:
    """Refuse parts of the box that do not hold all of what stands for a dead time.

    All else is constant: each plant is in one part, and has an X of its own.
    """
    for f, parameter in enumerate(ranges):
        if parameter.rate is not None and any(c.low[f] or c.high[f] != 1 for c in cells):
            raise FormatError("cells: with a dead time each part has all of what stands for it")


def extremes(ranges: Sequence[Range], step: Fraction = ZERO) -> int:
    """Return a bound on the number of extremes of the rates where an inequality is checked."""
    still = (None,) if step else (None, ANY)
    return 1 << sum(parameter.rate not in still for parameter in ranges)


def is_constant(X: Polynomial) -> bool:
    """Whether a polynomial is the same everywhere, whatever its degree."""
    start = 0
    for size, degree in zip(X.sizes, X.degrees, strict=True):
        slopes = [X.derivative(start + k) for k in range(size)] if degree else []
        if any(not _is_zero(slope - slopes[0]) for slope in slopes[1:]):
            return False
        start += size
    return True


def _is_zero(X: Polynomial) -> bool:
    return not any(any(map(any, matrix)) for matrix in X.terms.values())


def free_of(X: Polynomial, f: int) -> bool:
    """Whether a polynomial does not depend on parameter f."""
    return not X.degrees[f] or _is_zero(_slope(X, f))


def _slope(X: Polynomial, f: int) -> Polynomial:
    """Return dX/dt, where t goes from 0 at the low end of parameter f to 1 at its high end."""
    return X.derivative(2 * f + 1) - X.derivative(2 * f)


def require_motion(X: Polynomial, ranges: Sequence[Range], step: Fraction = ZERO) -> None:
    """Refuse a Lyapunov polynomial that is not valid while the parameters move.

    Parameters
    ----------
    step : Fraction
        The sample time; zero in continuous time.

    Raises
    ------
    FormatError
        If X is not on the parameters' box. In continuous time: if X depends on a parameter that
        moves at any rate. In discrete time: if X is not affine in every moving parameter.
    """
    if is_constant(X):
        return
    if X.sizes != (2,) * len(ranges):
        raise FormatError("parameters that move need evidence on their box")
    for f, parameter in enumerate(ranges):
        if parameter.rate is None or free_of(X, f):
            continue
        if parameter.rate == ANY and not step:
            raise FormatError(f"X depends on {name_text(parameter.name)}, which moves at any rate")
        if step and not free_of(_slope(X, f), f):
            raise FormatError(f"X is not affine in {name_text(parameter.name)}, which moves")


def changes(
    X: Polynomial, ranges: Sequence[Range], step: Fraction = ZERO
) -> Iterator[tuple[str, Polynomial | None]]:
    """Yield the name of every extreme of the rates, and dX/dt or X(p(t + step)) - X(p(t)) there.

    Yield one None where X does not change.

    Raises
    ------
    FormatError
        As `require_motion` does.
    """
    moving: Moving = []
    if is_moving(ranges) and not is_constant(X):
        require_motion(X, ranges, step)
        numbered = enumerate(ranges)
        moving = [
            (f, parameter)
            for f, parameter in numbered
            if parameter.rate is not None and not free_of(X, f)
        ]
    if not moving:
        yield "", None
    elif step:
        yield from _stepped(X, moving, step)
    else:
        yield from _driven(X, moving)


def _driven(X: Polynomial, moving: Moving) -> Iterator[tuple[str, Polynomial]]:
    rates = [
        (parameter.rate, change(X, f, parameter))
        for f, parameter in moving
        if parameter.rate is not None and parameter.rate != ANY
    ]
    for ends in product(range(2), repeat=len(rates)):
        first, *others = (P.times(rate[end]) for end, (rate, P) in zip(ends, rates, strict=True))
        yield _name(ends), sum(others, first)


def _stepped(X: Polynomial, moving: Moving, step: Fraction) -> Iterator[tuple[str, Polynomial]]:
    for ends in product(range(2), repeat=len(moving)):
        moved = X
        for end, (f, parameter) in zip(ends, moving, strict=True):
            moved = moved + _shift(f, parameter, end, step, X.sizes) * _slope(moved, f)
        yield _name(ends), moved - X


def _shift(f: int, parameter: Range, end: int, step: Fraction, sizes: Sizes) -> Polynomial:
    """Return the largest step of parameter f, down or up, as a share of its interval."""
    if (
        parameter.rate is None
        or parameter.rate == ANY
        or anywhere(parameter.rate, parameter.high - parameter.low, step)
    ):
        ends = ((ZERO, Fraction(-1)), (Fraction(1), ZERO))[end]  # it may reach either end
        return _variable(f, ends, sizes)
    by = parameter.rate[end] * step
    if not parameter.inverted:
        return number(by / (parameter.high - parameter.low), sizes)
    low, high = 1 / parameter.low, 1 / parameter.high
    most = max(abs(low), abs(high))
    return _variable(f, (abs(low), abs(high)), sizes).times(-by * most / (high - low))


def anywhere(
    rate: tuple[Fraction, Fraction] | Literal["any"], width: Fraction, step: Fraction
) -> bool:
    """Whether a parameter can go from any value of its interval to any other in a step."""
    return rate == ANY or min(-rate[0], rate[1]) * step >= width


def _name(ends: Sequence[int]) -> str:
    return f", rates {''.join('-+'[end] for end in ends)}"


def motion_text(ranges: Sequence[Range]) -> str:
    """Say how the parameters move, rounded inwards; "" where none does."""
    said = []
    for parameter in ranges:
        name, unit = name_text(parameter.name), rate_text(unit_text(parameter.unit))
        if parameter.dead_time is not None:
            said.append(_late_text(parameter.dead_time, ranges))
        elif parameter.rate == ANY:
            said.append(f"{name} moving at any rate")
        elif parameter.rate is not None:
            low, high = parameter.rate
            speed = digits_down(high, 4)
            if low != -high:
                speed = f"-{digits_down(-low, 4)} to {speed}" if low else f"0 to {speed}"
            else:
                speed = f"up to {speed}"
            said.append(f"{name} moving by {speed} {unit}")
    return ", ".join(said)


def _late_text(dead_time: DeadTime, ranges: Sequence[Range]) -> str:
    """Say what is late, and by how much, rounded inwards."""
    named = [p for p in ranges if p.name == dead_time.time]
    if named:
        low, high = (1000 * x for x in (named[0].low, named[0].high))
        time = f"{digits_up(low)} to {digits_down(high)}"
    elif isinstance(dead_time.time, str):
        time = "some"
    else:
        time = digits_down(1000 * dead_time.time)
        time = time if Fraction(time) == 1000 * dead_time.time else f"~{time}"
    return f"{quoted(dead_time.signal)} {time} ms late"
