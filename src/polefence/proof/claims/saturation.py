"""Inputs that are cut off at a limit: a region of attraction, or disturbances that are borne.

With s the inputs that are cut off at +-g, and any H(alpha) with |H_i x| <= g for i of s where
x'X^-1 x <= 1, what acts lies there between K x and H x (Hu & Lin, 2001). So with Y = H X, another
polynomial, the loop's N = (A + B K) X becomes N + B_S (Y - K X)_S for every part S of s, nothing
among them, and [ g^2, Y_i ; Y_i', X ] > 0 for each i. If all of them fall, the ellipsoid is kept
and left by no motion in it: -(N + N') > 0 and [ 1, x0' ; x0, X ] > 0, or X - X0 > 0, from initial
states; -(N + N' + E s^2 E') > 0, s = diag(norms), from rest for all w = diag(norms) v, v of unit
norm in L2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from typing import Any, ClassVar

from polefence.proof.claims.initial_peak import InitialPeak
from polefence.proof.claims.signal import Rows, Subject, outputs_text, scaled
from polefence.proof.laws import degree_of
from polefence.proof.plant import Output, Plant
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Polynomial,
    affine,
    bernstein,
    constant,
    count_of,
    number,
)
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down, digits_up, milliseconds_text
from polefence.proof.work import FormatError

MAX_INPUTS = 6  # of those that are cut off


@dataclass(frozen=True)
class Saturation(InitialPeak):
    """The loop comes to rest though inputs are cut off at ``level``: from each initial state.

    Or, with ``norms`` (one a disturbance) in place of initial states, it stays in an ellipsoid from
    rest and comes to rest after. ``held`` has the Bernstein coefficients of Y = H X, a row for each
    input that is cut off, of ``held_degree``.
    """

    kind: ClassVar[str] = "saturation"
    most: ClassVar[int] = MAX_INPUTS
    has_cells: ClassVar[bool] = False
    has_remainder: ClassVar[bool] = False

    norms: tuple[Fraction, ...] = ()
    held: tuple[tuple[tuple[Fraction, ...], ...], ...] = ()
    held_degree: int = 0

    @classmethod
    def read_own(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read initial states or norms, and Y."""
        found = super().read_own(table, subject, outputs)
        if "norms" in table:
            if not subject.E:
                raise FormatError(f"{table.path('norms')}: the plant has no E")
            found["norms"] = table.numbers("norms", subject.q)
        rows = table.matrices("held", len(outputs), subject.n)
        held = tuple(tuple(map(tuple, matrix)) for matrix in rows)
        return found | {"held": held, "held_degree": table.whole("held_degree", 0)}

    def write_own(self) -> dict[str, Any]:
        """Return what `read_own` reads."""
        norms = {"norms": plain(self.norms)} if self.norms else {}
        own = {"held": plain(self.held), "held_degree": self.held_degree}
        return super().write_own() | norms | own

    def require_own(self) -> None:
        """Refuse what is no input, initial states beside norms, and a Y that does not fit."""
        chosen = self._inputs
        if len(set(chosen)) < len(chosen):
            raise FormatError("an input is cut off twice")
        if not self.level:
            raise FormatError("level must be positive: nothing acts where it is zero")
        if not 0 <= self.held_degree <= MAX_DEGREE:
            raise FormatError(f"degrees must be 0 to {MAX_DEGREE}")
        if len(self.held) != count_of(self.subject.sizes, self.held_degree):
            raise FormatError("held: matrices are missing, one a coefficient")
        if any(
            len(Y) != len(chosen) or any(len(row) != self.subject.n for row in Y) for Y in self.held
        ):
            raise FormatError(f"held must be of {len(chosen)} rows and {self.subject.n} columns")
        if not self.norms:
            super().require_own()
        elif self.points or any(self.impulses) or self.ellipsoid:
            raise FormatError("norms: they are for loops that begin at rest")
        elif len(self.norms) != self.subject.q or min(self.norms) < 0 or not any(self.norms):
            raise FormatError(f"norms must hold {self.subject.q} numbers, zero or more, not all 0")

    @property
    def _inputs(self) -> list[int]:
        """Numbers of the inputs that are cut off."""
        found = []
        for own in self.outputs:
            places = [j for j, x in enumerate(own.D[0][0]) if x]
            unit = [[Fraction(int(j in places)) for j in range(self.subject.m)]]
            plain_input = len(places) == 1 and all(unit == D for D in own.D)
            if not plain_input or own.F or any(any(C[0]) for C in own.C):
                raise FormatError("saturation is of inputs, each as it is")
            found += places
        return found

    @property
    def blocks_at_most(self) -> int:
        """One for each part of the inputs, and those of initial states and of Y."""
        return super().blocks_at_most + (1 << len(self.outputs)) + len(self.outputs)

    @property
    def least_degree(self) -> int:
        """That of Y, and B Y."""
        own = degree_of(self.subject.law, self.subject.evidence)
        return max(own, self.held_degree) + 1

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:  # noqa: ARG002
        """Return the decrease under every part of what is cut off, the limits, and the starts."""
        subject, sizes = self.subject, X.sizes
        held = bernstein([list(map(list, M)) for M in self.held], sizes, self.held_degree)
        XKX, B = subject.lifted, affine(subject.B, sizes)
        driven = None
        if self.norms:
            E = scaled(subject.E, self.norms, sizes)
            driven = E * E.T
        found: Rows = {"of X": [[X]]}
        for chosen in _parts(len(self.outputs)):
            moved = N
            for k in chosen:
                i = self._inputs[k]
                at = slice(subject.n + i, subject.n + i + 1)
                cut = held.part(slice(k, k + 1)) - XKX.part(at)
                moved = moved + B.part(slice(None), slice(i, i + 1)) * cut
            name = f"of the decrease, {_name([self._inputs[k] for k in chosen])}"
            found[name] = subject.falling(X, moved, driven)
        one, square = number(1, sizes), number(self.level**2, sizes)
        for k in range(len(self.outputs)):
            found[f"of limit {k + 1}"] = [[square, held.part(slice(k, k + 1))], [X]]
        found |= {name: [[one, x.T], [X]] for name, x in self._starts(sizes)}
        if self.ellipsoid:
            found["of the ellipsoid"] = [[X - constant(list(map(list, self.ellipsoid)), sizes)]]
        return found

    def statement(self, plant: Plant) -> str:
        """Say which inputs are cut off, and what the loop bears."""
        what, on = outputs_text(self.outputs, plant), f", on the {self.subject.on}"
        if self.subject.step:
            on = f", at samples every {milliseconds_text(self.subject.step)} ms{on}"
        cut = f"{what} cut off at +-{digits_up(self.level)}"
        if not self.norms:
            return f"{cut}: the loop comes to rest{self.under}{on}"
        norms = ", ".join(digits_down(x, 4) for x in self.norms)
        return (
            f"{cut}: from rest the loop stays bounded, and comes to rest after w = diag({norms}) v "
            f"with v of L2 norm 1 at most{on}"
        )


def _parts(count: int) -> Iterator[tuple[int, ...]]:
    """Yield all parts of so many inputs, nothing first."""
    for size in range(count + 1):
        yield from combinations(range(count), size)


def _name(chosen: list[int]) -> str:
    """Name the inputs that are cut off."""
    return " and ".join(f"u{i + 1} cut off" for i in chosen) or "none cut off"
