"""Claims about the code of a law, as frozen values."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.matrices import Rationals
from polefence.proof.service.claims import Gain

UNITS = {32: Fraction(1, 2**24), 64: Fraction(1, 2**53)}  # relative error of one operation


@dataclass(frozen=True)
class Share:
    """The code's constants for a parameter p: scale (p - low), over p where it enters as 1/p."""

    low: Fraction
    high: Fraction
    scale: Fraction


@dataclass(frozen=True)
class Code:
    """The constants of the code, with the bits of its numbers.

    One gain, that of one vertex too, has ``K`` alone. ``shares`` has one entry a parameter, none
    where the code is given alpha itself. W and Z are Bernstein coefficients.
    """

    bits: int
    K: Rationals | None = None
    T: Rationals | None = None
    W: tuple[Rationals, ...] = ()
    Z: tuple[Rationals, ...] = ()
    shares: tuple[Share, ...] = ()


@dataclass(frozen=True)
class Rounded:
    """All poles lie in the region with the gain that the code computes.

    ``gain`` is what the design tolerates. For scheduled laws ``smallest`` and ``size`` are bounds,
    W' > smallest I and |Z' W'^-1| < size, which the coefficients at ``elevation`` prove.
    """

    gain: Gain
    code: Code
    smallest: Fraction = Fraction(0)
    size: Fraction = Fraction(0)
    elevation: int = 0
