"""Bands of frequency as people write them: two numbers in Hz."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError, shown
from polefence.plant.family import UncertainPlant
from polefence.proof.bands import Band
from polefence.proof.text import exactly
from polefence.proof.work import FormatError
from polefence.requirements.specification import is_number

Pair = tuple[float, float]


def frequencies(value: Any) -> Pair:
    """Return a band as two numbers [Hz].

    Raises
    ------
    InputError
        If it is none.
    """
    ends = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else []
    ends = [float(x) if isinstance(x, Fraction) else x for x in ends]
    try:
        Band.of([Fraction(x) for x in ends] if all(map(is_number, ends)) else [])
    except FormatError as error:
        several = f"[{', '.join(map(shown, ends))}]" if 0 < len(ends) < 5 else shown(value)
        raise InputError(
            f"band = {several} must be two numbers in Hz, the smaller first, that differ in six "
            "digits; write band = [4, 8]"
        ) from error
    return float(ends[0]), float(ends[1])


def with_band(title: str, band: Pair | None) -> str:
    """Return a title with its band, as a line has it."""
    return title if band is None else f"{title} with band [{', '.join(map(exactly, band))}]"


def require_below_half_the_rate(title: str, band: Pair, plant: UncertainPlant) -> None:
    """Refuse a band that samples cannot have."""
    if 2 * Fraction(band[1]) * plant.period > 1:
        raise InputError(
            f"{title}: samples have no frequency above "
            f"{float(1 / (2 * plant.period)):g} Hz, half the sample rate; end the band there"
        )
