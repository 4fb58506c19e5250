"""Parameters that move: how a Lyapunov polynomial changes with them.

Along a motion p(t) the derivative of x' X^-1 x has -X^-1 (dX/dt) X^-1 in it, so that N + N' of a
condition on X becomes N + N' - dX/dt, dX/dt = sum_f dX/dp_f dp_f/dt. That is affine in the rates:
what holds at all extremes of them holds for every motion within (Wu, Yang, Packard & Becker, 1996).

In discrete time X(p(t + T)) - X(p(t)) takes the place of T dX/dt. Of an X that is affine in the
scheduling variable of each parameter that moves it is affine in each of their steps: again the
extremes are enough (Daafouz & Bernussou, 2001, of any rate). A step of s = 1/p is s - s+ = s s+ dp,
of which s s+ lies between 0 and |s| times the largest |s|.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import product
from typing import Literal

from polefence.proof.plant import ANY, Range
from polefence.proof.polynomials import Polynomial, Sizes, number
from polefence.proof.text import digits_down, name_text, rate_text, unit_text
from polefence.proof.work import FormatError

NONE = Fraction(0)

Moving = Sequence[tuple[int, Range]]  # parameters that move, with their numbers


def change(X: Polynomial, f: int, own: Range) -> Polynomial:
    """Return dX/dp of parameter f: of X on the box of the parameters, by p's own unit."""
    found = _slope(X, f)
    low, high = (1 / own.low, 1 / own.high) if own.inverted else (own.low, own.high)
    if own.inverted:  # the scheduling variable s = 1/p changes with s^2 dp/dt
        s = _variable(f, (low, high), X.sizes)
        found = s * s * found
    return found.times(1 / abs(high - low))


def _variable(f: int, ends: tuple[Fraction, Fraction], sizes: Sizes) -> Polynomial:
    """Return a scheduling variable as the form of its values at its two ends."""
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
    return any(own.rate is not None for own in ranges)


def extremes(ranges: Sequence[Range], step: Fraction = NONE) -> int:
    """Return at how many extremes of the rates an inequality is to hold, at most."""
    still = (None,) if step else (None, ANY)
    return 1 << sum(own.rate not in still for own in ranges)


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
    """Return dX/dt, t the share of the way from the low end of parameter f to its high end."""
    return X.derivative(2 * f + 1) - X.derivative(2 * f)


def require_motion(X: Polynomial, ranges: Sequence[Range], step: Fraction = NONE) -> None:
    """Refuse a Lyapunov polynomial that is none along motions.

    Parameters
    ----------
    step : Fraction
        The sample time; zero in continuous time.

    Raises
    ------
    FormatError
        If it is not of the parameters' box; in continuous time if it depends on one that moves at
        any rate; in discrete time if it is not affine in each that moves.
    """
    if is_constant(X):
        return
    if X.sizes != (2,) * len(ranges):
        raise FormatError("parameters that move need evidence on their box")
    for f, own in enumerate(ranges):
        if own.rate is None or free_of(X, f):
            continue
        if own.rate == ANY and not step:
            raise FormatError(f"X depends on {name_text(own.name)}, which moves at any rate")
        if step and not free_of(_slope(X, f), f):
            raise FormatError(f"X is not affine in {name_text(own.name)}, which moves")


def changes(
    X: Polynomial, ranges: Sequence[Range], step: Fraction = NONE
) -> Iterator[tuple[str, Polynomial | None]]:
    """Yield dX/dt, or X(p(t + step)) - X(p(t)), at every extreme of the rates, and which it is.

    None where X does not change.

    Raises
    ------
    FormatError
        As `require_motion` does.
    """
    moving: Moving = []
    if is_moving(ranges) and not is_constant(X):
        require_motion(X, ranges, step)
        numbered = enumerate(ranges)
        moving = [(f, own) for f, own in numbered if own.rate is not None and not free_of(X, f)]
    if not moving:
        yield "", None
    elif step:
        yield from _stepped(X, moving, step)
    else:
        yield from _driven(X, moving)


def _driven(X: Polynomial, moving: Moving) -> Iterator[tuple[str, Polynomial]]:
    each = [
        (own.rate, change(X, f, own))
        for f, own in moving
        if own.rate is not None and own.rate != ANY
    ]
    for ends in product(range(2), repeat=len(each)):
        first, *others = (P.times(rate[end]) for end, (rate, P) in zip(ends, each, strict=True))
        yield _name(ends), sum(others, first)


def _stepped(X: Polynomial, moving: Moving, step: Fraction) -> Iterator[tuple[str, Polynomial]]:
    for ends in product(range(2), repeat=len(moving)):
        moved = X
        for end, (f, own) in zip(ends, moving, strict=True):
            moved = moved + _shift(f, own, end, step, X.sizes) * _slope(moved, f)
        yield _name(ends), moved - X


def _shift(f: int, own: Range, end: int, step: Fraction, sizes: Sizes) -> Polynomial:
    """Return how much of its way parameter f goes in a step, at an extreme: below 0 or above."""
    if own.rate is None or own.rate == ANY or anywhere(own.rate, own.high - own.low, step):
        ends = ((NONE, Fraction(-1)), (Fraction(1), NONE))[end]  # to either end
        return _variable(f, ends, sizes)
    by = own.rate[end] * step
    if not own.inverted:
        return number(by / (own.high - own.low), sizes)
    low, high = 1 / own.low, 1 / own.high
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
    for own in ranges:
        name, unit = name_text(own.name), rate_text(unit_text(own.unit))
        if own.rate == ANY:
            said.append(f"{name} moving at any rate")
        elif own.rate is not None:
            low, high = own.rate
            speed = digits_down(high, 4)
            if low != -high:
                speed = f"-{digits_down(-low, 4)} to {speed}" if low else f"0 to {speed}"
            else:
                speed = f"up to {speed}"
            said.append(f"{name} moving by {speed} {unit}")
    return ", ".join(said)
