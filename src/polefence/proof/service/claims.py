"""Claims about a design in service, as frozen values."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.placement import Claim

MAX_PIECES = 64  # of one parameter's interval
MAX_BLOCKS = 200_000  # inequalities of one claim


@dataclass(frozen=True)
class Range:
    """A parameter's interval; ``inverted`` where the plant is affine in 1/p."""

    low: Fraction
    high: Fraction
    inverted: bool = False


@dataclass(frozen=True)
class Subject:
    """The design that a claim is about, and how finely the claim is proved.

    ``ranges`` and ``pieces`` (equal parts of each interval) have one entry a parameter, none for a
    plant given by its vertices; ``elevation`` is the power of (sum of coordinates).
    """

    design: Claim
    ranges: tuple[Range, ...] = ()
    pieces: tuple[int, ...] = ()
    elevation: int = 0


@dataclass(frozen=True)
class Estimate:
    """The poles stay in the region while each parameter is known to within its error.

    ``errors`` in the parameters' own units; without parameters one number, the share of weight
    that is mislaid.
    """

    subject: Subject
    errors: tuple[Fraction, ...]


@dataclass(frozen=True)
class Gain:
    """The poles stay in the region while the gain is off by ``error`` S D T, |D| <= 1.

    S is diagonal, of ``rows`` (a number an input); T too, of ``columns`` (a number a state), or it
    is any matrix, with ``columns`` its rows. ``mu`` has one number for each L, M of the region.
    """

    subject: Subject
    error: Fraction
    rows: tuple[Fraction, ...]
    columns: tuple[Fraction | tuple[Fraction, ...], ...]
    mu: tuple[Fraction, ...]

    @property
    def right(self) -> list[list[Fraction]]:
        """T in full."""
        n, zero, full = len(self.columns), Fraction(0), list[list[Fraction]]()
        for i, own in enumerate(self.columns):
            if isinstance(own, tuple):
                full.append(list(own))
            else:
                full.append([own if i == j else zero for j in range(n)])
        return full


@dataclass(frozen=True)
class Rate:
    """The loop decays faster than exp(-decay t) while no parameter moves faster than its rate.

    ``rates`` in the parameters' own units per second; without parameters one number, of weight per
    second; None: at any rate, which one W for all parameters proves. ``part`` is the part of the
    region, from 0 up, whose Lyapunov polynomial it is, of a law that was given.
    """

    subject: Subject
    decay: Fraction
    rates: tuple[Fraction, ...] | None
    part: int = 0


ServiceClaim = Estimate | Gain | Rate
