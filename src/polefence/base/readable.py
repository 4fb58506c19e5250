"""Sampled numbers as people read them: few digits, no exponent of a usual size, usual units."""

from __future__ import annotations

from decimal import Decimal

# Units that people use of a size: of lengths below half a metre, of forces from a kilonewton on.
BELOW = {"m": (0.5, "mm", Decimal(1000))}
ABOVE = {"N": (1000.0, "kN", Decimal("0.001"))}

SAME = 0.005  # share of a size that people call the same


def compared(value: float, other: float, less: str = "less", more: str = "more") -> str:
    """Say how a positive size is beside another: "25 % less", "2.2 times", "the same"."""
    share = value / other - 1
    if abs(share) < SAME:
        return "the same"
    if share >= 1:
        return f"{1 + share:.2g} times"
    return f"{100 * abs(share):.0f} % {less if share < 0 else more}"


def people(size: float, unit: str) -> tuple[str, Decimal]:
    """Return the unit that people use of a size, and how many of it one of the unit is."""
    limit, finer, times = BELOW.get(unit, (0.0, unit, Decimal(1)))
    if abs(size) < limit:
        return finer, times
    limit, coarser, times = ABOVE.get(unit, (float("inf"), unit, Decimal(1)))
    return (coarser, times) if abs(size) >= limit else (unit, Decimal(1))


def sample_text(value: float, times: Decimal = Decimal(1), digits: int = 4) -> str:
    """Return a number with a few digits, times a power of ten."""
    return scaled_text(f"{value:.{digits}g}", times)


def scaled_text(text: str, times: Decimal = Decimal(1)) -> str:
    """Return a number that is written already, times a power of ten: its digits stay."""
    value = Decimal(text) * times
    if not value.is_finite():
        return text
    plain = value == 0 or -5 <= value.adjusted() < 9
    text = f"{value:f}" if plain else f"{value.normalize():e}"
    return text.rstrip("0").rstrip(".") if plain and "." in text else text
