"""Storage functions on parts of a period: polynomials of the parameters and of time.

Between samples x' = A x + B k + E w, z = C x + D k + F w: x are the states that move, k all other
states, and the inputs. With y = [x; k], y' = N y + E w and z = Y y + F w. A storage function V
bounds what a disturbance can still do: it rises by no more than the supply,

    d/dt V <= g |w|^2 - |z|^2 / g.

It is V = y'R y, or with more matrices that hang on the parameters and on time

    V = (x - c k)'P^-1 (x - c k) + k'R k.

Of a law that is nearly the best V is nearly singular just after a sample: R of the first form is
then large, P of the second small, and smooth. Where k matters little the first is the better one.

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
    """R, or [P, c; c', R], on a part of a period that ends at the share ``end`` of the period.

    The second where ``inverse`` is so. ``form`` holds Bernstein coefficients of a ``degree`` in the
    parameters and of ``along`` in time, which varies fastest, in the order of `monomials_of`.
    """

    end: Fraction
    form: list[Rationals]
    degree: int
    along: int
    inverse: bool = False

    @classmethod
    def read(cls, table: Table, sizes: Sizes) -> Stretch:
        """Read one; how many rows its matrices must have is asked later.

        Raises
        ------
        FormatError
            If it is malformed.
        """
        form, degree = table.matrices("form", None, None), table.whole("degree", None)
        along = table.whole("along", None, least=1)
        wanted = count_of(*cls._shape(sizes, degree, along))
        if len(form) != wanted:
            raise FormatError(
                f"{table.path('form')} holds {len(form)} matrices; its degrees need {wanted}"
            )
        return cls(table.number("end"), form, degree, along, table.flag("inverse"))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        return {
            "end": plain(self.end),
            "degree": self.degree,
            "along": self.along,
            "form": plain(self.form),
        } | ({"inverse": True} if self.inverse else {})

    @staticmethod
    def _shape(sizes: Sizes, degree: int, along: int) -> tuple[Sizes, tuple[int, ...]]:
        return (*sizes, 2), (*(degree,) * len(sizes), along)

    def polynomial(self, sizes: Sizes) -> Polynomial:
        """Return it on the box of the parameters, with time from begin to end as one more."""
        return bernstein(self.form, *self._shape(sizes, self.degree, self.along))

    def at(self, sizes: Sizes, end: bool) -> Polynomial:
        """Return it at its begin or its end, a polynomial of the parameters alone."""
        return self.polynomial(sizes).at_end(end)


def require_stretches(stretches: tuple[Stretch, ...], breaks: tuple[Fraction, ...]) -> None:
    """Refuse stretches that do not make up the period, or go on past one of its breaks.

    Raises
    ------
    FormatError
        Saying which.
    """
    if not 1 <= len(stretches) <= MOST_STRETCHES:
        raise FormatError(f"storage: there are 1 to {MOST_STRETCHES} stretches")
    if len({stretch.inverse for stretch in stretches}) > 1:
        raise FormatError("storage: all stretches are of one form, inverse or not")
    begin = Fraction(0)
    for stretch in stretches:
        if stretch.end <= begin:
            raise FormatError("storage: each stretch ends later than the one before")
        begin = stretch.end
    if begin != 1:
        raise FormatError("storage: the last stretch ends with the period, at 1")
    if not set(breaks) <= {stretch.end for stretch in stretches}:
        raise FormatError("storage: a stretch ends where inputs change")
