"""Storage functions: S(p, t) of [x; u] on parts of a period, polynomials of parameters and time.

Between samples the signals of a computer are constant, x' = A x + B u + E w, z = C x + D u + F w.
With y = [x; u] of the states at a sample and the inputs, y' = N y + E w. A storage function bounds
what a disturbance can still do: V = y'S y rises by no more than the supply, at any time,

    d/dt V <= g |w|^2 - |z|^2 / g.

Source: Willems (1972); its form for sampled loops is Sun, Nagpal & Khargonekar (1993).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import Rationals
from polefence.proof.polynomials import Polynomial, Sizes, bernstein, count_of
from polefence.proof.reading import Table, plain
from polefence.proof.short import Short
from polefence.proof.work import FormatError

MOST_STRETCHES = 64


@dataclass(frozen=True)
class Stretch(Short):
    """S on a part of a period, which is the share ``end`` of the period at its end.

    ``S`` holds Bernstein coefficients of a ``degree`` in the parameters and of ``along`` in time,
    which varies fastest, in the order of `monomials_of`.
    """

    end: Fraction
    S: list[Rationals]
    degree: int
    along: int

    @classmethod
    def read(cls, table: Table, sizes: Sizes) -> Stretch:
        """Read one; how many rows its matrices must have is asked later.

        Raises
        ------
        FormatError
            If it is malformed.
        """
        S, degree = table.matrices("S", None, None), table.whole("degree", None)
        along = table.whole("along", None, least=1)
        wanted = count_of(*cls._shape(sizes, degree, along))
        if len(S) != wanted:
            raise FormatError(
                f"{table.path('S')} holds {len(S)} matrices; its degrees need {wanted}"
            )
        return cls(table.number("end"), S, degree, along)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        return {
            "end": plain(self.end),
            "degree": self.degree,
            "along": self.along,
            "S": plain(self.S),
        }

    @staticmethod
    def _shape(sizes: Sizes, degree: int, along: int) -> tuple[Sizes, tuple[int, ...]]:
        return (*sizes, 2), (*(degree,) * len(sizes), along)

    def polynomial(self, sizes: Sizes) -> Polynomial:
        """Return S on the box of the parameters, with time from begin to end as one more."""
        return bernstein(self.S, *self._shape(sizes, self.degree, self.along))

    def at(self, sizes: Sizes, end: bool) -> Polynomial:
        """Return S at its begin or its end, a polynomial of the parameters alone."""
        whole = self.polynomial(sizes)
        kept = (0, self.along) if end else (self.along, 0)
        terms = {e[:-2]: M for e, M in whole.terms.items() if e[-2:] == kept}
        none = [[0] * len(self.S[0])] * len(self.S[0])
        terms = terms or {next(iter(whole.terms))[:-2]: none}
        return Polynomial(terms, sizes, (self.degree,) * len(sizes), whole.whole)


def require_stretches(stretches: tuple[Stretch, ...], breaks: tuple[Fraction, ...]) -> None:
    """Refuse stretches that do not make up the period, or go on past one of its breaks.

    Raises
    ------
    FormatError
        Saying which.
    """
    if not 1 <= len(stretches) <= MOST_STRETCHES:
        raise FormatError(f"storage: there are 1 to {MOST_STRETCHES} stretches")
    begin = Fraction(0)
    for stretch in stretches:
        if stretch.end <= begin:
            raise FormatError("storage: each stretch ends later than the one before")
        begin = stretch.end
    if begin != 1:
        raise FormatError("storage: the last stretch ends with the period, at 1")
    if not set(breaks) <= {stretch.end for stretch in stretches}:
        raise FormatError("storage: a stretch ends where inputs change")
