"""Parameters that move: how fast a Lyapunov polynomial changes with them.

Along a motion p(t) the derivative of x' X^-1 x has -X^-1 (dX/dt) X^-1 in it, so that N + N' of a
condition on X becomes N + N' - dX/dt, dX/dt = sum_f dX/dp_f dp_f/dt. That is affine in the rates:
what holds at all extremes of them holds for every motion within (Wu, Yang, Packard & Becker, 1996).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import product

from polefence.proof.plant import ANY, Range
from polefence.proof.polynomials import Polynomial, Sizes
from polefence.proof.text import digits_down, name_text, rate_text, unit_text
from polefence.proof.work import FormatError


def change(X: Polynomial, f: int, own: Range) -> Polynomial:
    """Return dX/dp of parameter f: of X on the box of the parameters, by p's own unit."""
    found = X.derivative(2 * f + 1) - X.derivative(2 * f)
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


def extremes(ranges: Sequence[Range]) -> int:
    """Return at how many extremes of the rates an inequality is to hold, at most."""
    return 1 << sum(own.rate not in (None, ANY) for own in ranges)


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
    if not X.degrees[f]:
        return True
    return _is_zero(X.derivative(2 * f + 1) - X.derivative(2 * f))


def require_motion(X: Polynomial, ranges: Sequence[Range]) -> None:
    """Refuse a Lyapunov polynomial that is none along motions.

    Raises
    ------
    FormatError
        If it is not of the parameters' box, or depends on one that moves at any rate.
    """
    if is_constant(X):
        return
    if X.sizes != (2,) * len(ranges):
        raise FormatError("parameters that move need evidence on their box")
    for f, own in enumerate(ranges):
        if own.rate == ANY and not free_of(X, f):
            raise FormatError(f"X depends on {name_text(own.name)}, which moves at any rate")


def along(
    X: Polynomial, N: Polynomial, ranges: Sequence[Range]
) -> Iterator[tuple[str, Polynomial]]:
    """Yield N - (dX/dt) / 2 at every extreme of the rates, and which it is; N where X is constant.

    X is one that `require_motion` does not refuse.
    """
    if is_constant(X):
        yield "", N
        return
    moving = [
        (own.rate, change(X, f, own))
        for f, own in enumerate(ranges)
        if own.rate is not None and own.rate != ANY and not free_of(X, f)
    ]
    for ends in product(range(2), repeat=len(moving)):
        moved = N
        for end, (rate, P) in zip(ends, moving, strict=True):
            moved = moved - P.times(rate[end] / 2)
        yield f", rates {''.join('-+'[end] for end in ends)}" if moving else "", moved


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
