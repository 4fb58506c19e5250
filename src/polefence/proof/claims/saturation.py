"""Signals that saturate: a region of attraction, or disturbances that are borne.

Each signal is c x + d u_i, d not zero: an input, or its rate c x + d u_i = (u_i - x_k) / T where
x_k is the input a sample before, or w (u_i - x_k) where x_k follows it. Inputs are held back so
that all signals stay within +-g: u_i is moved to the nearest value at which those that it moves do.
Some may be of one input, as a limit and a rate limit are. In whatever order they are met: moved
into one interval, then into another that meets it, a number is in both, and no farther than it has
to be.

With s the inputs that are held back, and any H(alpha) with |c x + d H_i x| <= g for all signals
where x'X^-1 x <= 1, what acts lies there between K x and H x (Hu & Lin, 2001). So with Y = H X,
another polynomial, the loop's N = (A + B K) X becomes N + B_S (Y - K X)_S for every part S of s,
nothing among them, and [ g^2, c X + d Y_i ; ., X ] > 0 for each signal. If all of them fall, the
ellipsoid is kept and left by no motion in it: -(N + N') > 0 and [ 1, x0' ; x0, X ] > 0, or
X - X0 > 0, from initial states; -(N + N' + E s^2 E') > 0, s = diag(norms), from rest for all
w = diag(norms) v, v of unit norm in L2. A remainder of the plant asks for an Omega that is enough
for every part.

A law with an anti-windup gain G adds G (sat(u) - u) to the rates of its own states: the columns of
B_S are then those of B + G, in N that of S alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations
from typing import Any, ClassVar, Self

from polefence.proof.claims.signal import Rows, Subject, moving, outputs_text
from polefence.proof.claims.started import StartedClaim
from polefence.proof.laws import degree_of
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Output, Plant
from polefence.proof.polynomials import (
    MAX_DEGREE,
    Polynomial,
    bernstein,
    constant,
    count_of,
    joint,
    number,
)
from polefence.proof.reading import Table, plain
from polefence.proof.remainder import Spread
from polefence.proof.text import digits_down, digits_up, milliseconds_text, number_text
from polefence.proof.work import FormatError

MAX_INPUTS = 6  # that are held back, and signals


@dataclass(frozen=True)
class Saturation(StartedClaim):
    """The loop comes to rest though signals saturate at ``level``: from each initial state.

    Or, with ``norms`` (one a disturbance) in place of initial states, it stays in an ellipsoid from
    rest and comes to rest after. ``held`` has the Bernstein coefficients of Y = H X, a row for each
    of the ``inputs`` that are held back, of ``held_degree``.
    """

    kind: ClassVar[str] = "saturation"
    most: ClassVar[int] = MAX_INPUTS
    has_cells: ClassVar[bool] = False
    has_passing: ClassVar[bool] = True

    norms: tuple[Fraction, ...] = ()
    held: tuple[tuple[tuple[Fraction, ...], ...], ...] = ()
    held_degree: int = 0

    @classmethod
    def read_extra(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read initial states or norms, and Y."""
        fields = super().read_extra(table, subject, outputs)
        if "norms" in table:
            if not subject.E:
                raise FormatError(f"{table.path('norms')}: the plant has no E")
            fields["norms"] = table.numbers("norms", subject.q)
        rows = table.matrices("held", len(_inputs(outputs)), subject.n)
        held = tuple(tuple(map(tuple, matrix)) for matrix in rows)
        return fields | {"held": held, "held_degree": table.whole("held_degree", 0)}

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        norms = {"norms": plain(self.norms)} if self.norms else {}
        held = {"held": plain(self.held), "held_degree": self.held_degree}
        return super().write_extra() | norms | held

    def require_extra(self) -> None:
        """Refuse what no input moves, initial states beside norms, and a Y that does not fit."""
        chosen = self.inputs
        if not self.level:
            raise FormatError("level must be positive: nothing acts where it is zero")
        if not 0 <= self.held_degree <= MAX_DEGREE:
            raise FormatError(f"degrees must be 0 to {MAX_DEGREE}")
        if len(self.held) != count_of(self.subject.sizes, self.held_degree):
            raise FormatError("held: matrices are missing, one per coefficient")
        if any(
            len(Y) != len(chosen) or any(len(row) != self.subject.n for row in Y) for Y in self.held
        ):
            raise FormatError(f"held must be of {len(chosen)} rows and {self.subject.n} columns")
        pushes, loop = self.norms or self.impulses, self.subject
        if loop.law.F and pushes and loop.through(self.outputs, pushes) is not None:
            raise FormatError("F: a disturbance passes straight into an input that saturates")
        if not self.norms:
            super().require_extra()
        elif self.points or any(self.impulses) or self.ellipsoid:
            raise FormatError("norms: only for loops that begin at rest")
        elif len(self.norms) != self.subject.q or min(self.norms) < 0 or not any(self.norms):
            raise FormatError(f"norms must hold {self.subject.q} numbers, zero or more, not all 0")

    @property
    def bare(self) -> Self:
        """What is claimed, without what proves it."""
        return replace(super().bare, held=(), held_degree=0)

    @property
    def inputs(self) -> list[int]:
        """Numbers of the inputs that are held back."""
        return _inputs(self.outputs)

    @property
    def blocks_at_most(self) -> int:
        """One for each part of the inputs, or two, and those of initial states and of Y."""
        rows = 1 if self.subject.remainder is None else 2
        return super().blocks_at_most + (rows << len(self.inputs)) + len(self.outputs)

    @property
    def least_degree(self) -> int:
        """That of Y, and B Y."""
        degree = degree_of(self.subject.law, self.subject.evidence)
        near = self.subject.remainder
        return max(degree, self.held_degree) + (1 if near is None else near.degree)

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:  # noqa: ARG002
        """Return the decrease under every part of what saturates, the limits, and the starts."""
        subject, sizes = self.subject, X.sizes
        driven = moving(subject, self.norms, sizes) if self.norms else None
        B, KX = subject.entering(sizes), subject.lifted.part(slice(subject.n, None))
        if subject.law.anti_windup is not None:
            B = B + constant(subject.law.anti_windup, sizes)
        held = dict(zip(self.inputs, self._held, strict=True))
        rows: Rows = {"of X": [[X]]}
        for part in _parts(self.inputs):
            moved = N
            for i in part:
                row = slice(i, i + 1)
                moved = moved + B.part(slice(None), row) * (held[i] - KX.part(row))
            rows[f"of the decrease, {_name(part)}"] = subject.falling(X, moved, driven)
        square = number(self.level**2, sizes)
        for k, output in enumerate(self.outputs):
            C, D = (constant(matrices[0], sizes) for matrices in (output.C, output.D))
            acting = D.part(slice(0, 1), slice(i := _input_of(output), i + 1)) * held[i]
            rows[f"of limit {k + 1}"] = [[square, C * X + acting], [X]]
        return rows | self._started(X)

    @property
    def _held(self) -> list[Polynomial]:
        """The rows of Y = H X."""
        Y = bernstein([list(map(list, M)) for M in self.held], self.subject.sizes, self.held_degree)
        return [Y.part(slice(k, k + 1)) for k in range(len(self.inputs))]

    def remainder_rows(self, spread: Spread) -> Rows:
        """Return that Omega is enough whatever saturates."""
        rows = dict(zip(self.inputs, self._held, strict=True))
        return {
            f"of the remainder, {_name(part)}": spread.bounding(spread.moving(form))
            for part, form in cut_off(self.subject.lifted, self.subject.n, rows)
        }

    def statement(self, plant: Plant) -> str:
        """Say what saturates, and what the loop bears."""
        what, on = outputs_text(self.outputs, plant), f", on the {self.subject.on}"
        if self.subject.step:
            on = f", at samples every {milliseconds_text(self.subject.step)} ms{on}"
        cut = f"{what} saturated at +-{digits_up(self.level)}"
        held = list(dict.fromkeys(_input_of(y) for y in self.outputs if any(y.C[0][0])))
        if held:
            cut += f" by what acts in place of {' and '.join(f'u{i + 1}' for i in held)}"
        if self.subject.law.anti_windup is not None:
            cut += f", {self._anti_windup_text(self.subject.law.anti_windup)}"
        if not self.norms:
            return f"{cut}: the loop comes to rest{self.under}{on}"
        norms = ", ".join(digits_down(x, 4) for x in self.norms)
        return (
            f"{cut}: from rest the loop stays bounded, and comes to rest after w = diag({norms}) v "
            f"with v of L2 norm 1 at most{on}"
        )

    def _anti_windup_text(self, gain: Rationals) -> str:
        """Say what saturation adds to the rates of the law's own states."""
        said = []
        for k, row in enumerate(gain):
            acting = [(row[i], f"u{i + 1}") for i in self.inputs if row[i]]
            if acting:
                sums = " + ".join(f"{number_text(x)} (sat({u}) - {u})" for x, u in acting)
                said.append(f"{sums} added to the rate of x{k + 1}")
        return ", ".join(said) or "nothing added to the rates of the law's own states"


def _input_of(output: Output) -> int:
    """Return the number of the input that moves a signal, and is held back for it."""
    places = [j for j, x in enumerate(output.D[0][0]) if x]
    same = all(rows[0] == M for rows in (output.C, output.D) for M in rows)
    if len(places) != 1 or not same or any(any(map(any, M)) for M in output.F):
        raise FormatError(
            "saturation applies to signals that one input moves directly, by constants, and no "
            "disturbance"
        )
    return places[0]


def _inputs(outputs: Sequence[Output]) -> list[int]:
    """Return the numbers of the inputs that are held back for signals, each once."""
    return list(dict.fromkeys(map(_input_of, outputs)))


def cut_off(
    XKX: Polynomial, n: int, held: Mapping[int, Polynomial]
) -> Iterator[tuple[tuple[int, ...], Polynomial]]:
    """Yield every part of the inputs, and [X; K X] with rows of H X in place of theirs.

    Parameters
    ----------
    held : mapping
        The rows of H X, by the numbers of the inputs.
    """
    height = XKX.shape[0]
    for part in _parts(list(held)):
        moved = XKX.raised(joint([XKX, *held.values()]))
        for i in part:
            unit = constant([[Fraction(int(j == n + i))] for j in range(height)], XKX.sizes)
            moved = moved + unit * (held[i] - XKX.part(slice(n + i, n + i + 1)))
        yield part, moved


def _parts(inputs: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield all parts of these inputs, nothing first."""
    for size in range(len(inputs) + 1):
        yield from combinations(inputs, size)


def _name(part: Sequence[int]) -> str:
    """Name the inputs that are cut off."""
    return " and ".join(f"u{i + 1} saturated" for i in part) or "none saturated"
