"""Prove that no law whatever keeps limits on gains at once, at one vertex.

For x' = A x + B u + E w and z = C x + D u + F w, the rows of all limits below one another, those of
limit i being z_i. Let Z = Z' >= 0, of (x, z), have

    Z [B; D] = 0,   N + N' >= 0,   N = [I, 0] Z [A; C].

With a = tr [E; F]'Z [E; F] and b_i the trace of the rows and columns of z_i in Z, every law has
a <= (sum g_i sqrt(b_i))^2 where it keeps ||z_i|| <= g_i ||w|| for every w of finite energy, from
rest. For Z = V V' and V = [P; Q], P'B + Q'D = 0, so s = P'x has, whatever u,

    s' = (P'A + Q'C) x + e,   e = (P'E + Q'F) w - Q'z.

Let P have full column rank. Where P'x = 0, N + N' >= 0 gives (P'A + Q'C) x = 0, so P'A + Q'C = L P'
and L + L' >= 0. For d > 0 let c' = -(L' + d) c from a random c(0) of covariance L + L' + 2 d I: it
fades, and the mean of the integral of c c' is I. As (c's)' = c'e - d c's is zero in the integral,
the disturbance w = (P'E + Q'F)'c has

    a = E ||w||^2 = E int c'Q'z + d E int c's <= sqrt(a) (sum g_i sqrt(b_i) + d k sqrt(r)),

r the columns of P and k a bound on ||s|| / ||w||. Let d tend to zero. Columns of V without x have
Q'D = 0 and Q'z = Q'C x + Q'F w: a constant w = F'Q c in a time h, c of covariance I / h, does the
same, for x is small then as h is; the sum of both is Minkowski's inequality.

So no law has these gains for which x and u have no more than some multiple of the energy of w: no
law of any order that stabilises the plant, linear or not, constant in time or not, that is told
anything: states, parameters, and w itself. With shares p_i > 0 of sum 1 or less,
(sum g_i sqrt(b_i))^2 <= sum g_i^2 b_i / p_i, which needs no root.

Integers and the standard library only.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Verdict, undecided
from polefence.proof.claims.refutation import (
    MAX_LIMITS,
    Refuted,
    require_driven,
)
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    acting_text,
    outputs_text,
    read_outputs,
    require_shapes,
    write_outputs,
)
from polefence.proof.claims.started import is_semidefinite
from polefence.proof.matrices import Rationals, common_denominator, is_symmetric, product
from polefence.proof.plant import Output, Plant
from polefence.proof.reading import MAX_SIZE, Table, plain
from polefence.proof.short import Short
from polefence.proof.text import digits_down, plural
from polefence.proof.work import FormatError, WorkError


@dataclass(frozen=True)
class GainLimit(Short):
    """The gain to the outputs, one or a vector, is at most ``level``."""

    outputs: tuple[Output, ...]
    level: Fraction

    @classmethod
    def read(cls, table: Table, plant: Plant) -> Self:
        """Read a limit."""
        return cls(read_outputs(table, plant, MAX_ENTRIES), table.number("level"))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        return write_outputs(self.outputs) | {"level": plain(self.level)}


@dataclass(frozen=True)
class GainRefutation(Short, Refuted):
    """At a vertex no law keeps the limits on gains, nor ``factor`` times each, with evidence.

    Attributes
    ----------
    A, B, E : list of matrices
        For each vertex.
    limits : tuple of GainLimit
    vertex : int
        Counted from zero.
    shares : tuple of Fraction
        One a limit, of sum 1 or less.
    Z : rationals
        Rows and columns of the states, then of the outputs of each limit.
    factor : Fraction
        At least 1.
    scales : tuple of Fraction
        How much of each disturbance acts; all of each where there are none.
    """

    kind: ClassVar[str] = "gain conflict"

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    limits: tuple[GainLimit, ...]
    vertex: int
    shares: tuple[Fraction, ...]
    Z: Rationals
    factor: Fraction = Fraction(1)
    scales: tuple[Fraction, ...] = ()

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:  # noqa: ARG003
        """Read the limits, the vertex and the evidence."""
        plant.require_noise(table.where)
        limits = tuple(GainLimit.read(row, plant) for row in table.tables("limits", MAX_LIMITS))
        size = plant.n + sum(len(limit.outputs) for limit in limits)
        return cls(
            plant.A,
            plant.B,
            plant.E,
            limits,
            table.whole("vertex", None, len(plant.A), 1) - 1,
            table.numbers("shares", len(limits), MAX_LIMITS),
            table.matrix("Z", size, size),
            table.number("factor", 1),
            table.numbers("disturbances", plant.q) if "disturbances" in table else (),
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind, "vertex": self.vertex + 1}
        table["limits"] = [limit.write() for limit in self.limits]
        table["factor"] = plain(self.factor)
        table |= {"disturbances": plain(self.scales)} if self.scales else {}
        return table | {"shares": plain(self.shares), "Z": plain(self.Z)}

    def statement(self, plant: Plant) -> str:
        """Say which limits no law keeps, each times the factor and rounded down."""
        said = [
            f"gain of {outputs_text(limit.outputs, plant)} <= "
            f"{digits_down(limit.level * self.factor)}"
            for limit in self.limits
        ]
        once = " at once" if len(said) > 1 else ""
        acting = acting_text(self.scales, plant)
        return f"at vertex {self.vertex + 1} no law keeps{once} {' and '.join(said)}{acting}"

    def decided(self) -> Verdict:
        """Prove a claim that is consistent; undecided does not say that there is a law."""
        if not is_symmetric(self.Z):
            return undecided("Z is not symmetric")
        if min(self.shares) <= 0 or sum(self.shares) > 1:
            return undecided("the shares are not positive, or more than 1")
        if not is_semidefinite(self.Z):
            return undecided("Z is not positive semidefinite")
        A, B = self.A[self.vertex], self.B[self.vertex]
        outputs = [output for limit in self.limits for output in limit.outputs]
        C, D = ([row for y in outputs for row in getattr(y, k)[self.vertex]] for k in "CD")
        if any(map(any, product(self.Z, [*B, *D]))):
            return undecided("Z [B; D] is not zero")
        N = product(self.Z[: len(A)], [*A, *C])
        both = [[x + y[i] for x, y in zip(row, N, strict=True)] for i, row in enumerate(N)]
        if not is_semidefinite(both):
            return undecided("N + N' is not positive semidefinite")
        if not self.driven > self.factor**2 * self.allowed_by(self.limits):
            return undecided("the limits allow as much as every law has")
        kept = plural(len(self.limits), "limit")
        return Verdict(
            "proved",
            f"at vertex {self.vertex + 1} no law keeps {kept} on gains: blocks of {len(self.Z)} "
            f"and {len(A)} rows positive semidefinite in exact arithmetic",
            2,
        )

    @property
    def driven(self) -> Fraction:
        """The trace of [E; F]'Z [E; F]."""
        E, q = self.E[self.vertex], len(self.E[self.vertex][0])
        none = [Fraction(0)] * q
        outputs = [output for limit in self.limits for output in limit.outputs]
        F = [y.F[self.vertex][0] if y.F else none for y in outputs]
        scales = self.scales or (Fraction(1),) * q
        both = [[x * s for x, s in zip(row, scales, strict=True)] for row in [*E, *F]]
        pairs = zip(both, product(self.Z, both), strict=True)
        return sum((x * y for rows in pairs for x, y in zip(*rows, strict=True)), Fraction(0))

    def allowed_by(self, limits: tuple[GainLimit, ...]) -> Fraction:
        """Return the sum of g_i^2 b_i / p_i."""
        total, first = Fraction(0), len(self.A[self.vertex])
        for limit, share in zip(limits, self.shares, strict=True):
            end = first + len(limit.outputs)
            total += limit.level**2 * sum(self.Z[i][i] for i in range(first, end)) / share
            first = end
        return total

    def require(self) -> None:
        """Refuse what is incomplete or inconsistent."""
        N, n, m = require_driven(self.A, self.B, self.E, self.scales)
        if not self.limits or len(self.shares) != len(self.limits):
            raise FormatError("there must be limits, and one share for each")
        outputs = [output for limit in self.limits for output in limit.outputs]
        size = n + len(outputs)
        if size + m > 2 * MAX_SIZE:
            raise WorkError(
                f"{n} states, {m} inputs and {len(outputs)} outputs are too many to be checked here"
            )
        require_shapes([self.Z], 1, size, size, "Z")
        if type(self.vertex) is not int or not 0 <= self.vertex < N:
            raise FormatError(f"vertex {self.vertex!r} is not one of 0 to {N - 1}")
        if self.factor < 1:
            raise FormatError("factor must be 1 or more")
        q = len(self.E[0][0])
        for limit in self.limits:
            if not limit.outputs or limit.level < 0:
                raise FormatError("a limit must be zero or more, of outputs")
        for output in outputs:
            require_shapes(output.C, N, 1, n, "C")
            require_shapes(output.D, N, 1, m, "D")
            if output.near is not None:
                raise FormatError("a limit on an output with functions of the parameters")
            if output.F:
                require_shapes(list(output.F), N, 1, q, "F")
        levels = [limit.level for limit in self.limits]
        numbers = [[[*self.shares, *self.scales, *levels, self.factor]], self.Z]
        numbers += [M for y in outputs for M in (*y.C, *y.D, *y.F)]
        common_denominator([*numbers, *self.A, *self.B, *self.E])
