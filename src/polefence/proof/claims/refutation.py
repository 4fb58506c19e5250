"""Prove that no law whatever keeps limits on rms values at once, at one vertex.

For x' = A x + B u + E w with white w of two-sided intensity S, and y_i = C_i x + D_i u, of one row
or, a vector whose mean square is E[y_i'y_i], of more. Let P = P' and weights a_i >= 0 have

    [ A'P + P A + sum a_i C_i'C_i,  P B + sum a_i C_i'D_i ]
    [ *,                            sum a_i D_i'D_i       ]  >= 0.

In the stationary state E[2 x'P (A x + B u)] + S tr E'P E = 0, the mean of the derivative of x'P x,
for every u of finite variance that is no function of the noise to come and has none in it that is
white: every stabilising law, static or dynamic, linear or not, told the parameters or not. The
block's mean with (x, u) is sum a_i E[y_i^2] - S tr E'P E, and is not negative. So limits g_i with
S sum a_i g_i^2 / S_i < S tr E'P E cannot be kept together, where limit i is for noise of intensity
S_i. P need not be positive.

Where some inputs are forces of controllable dampers, u_k = c v with v = r x and c from c1 to c2 as
any logic chooses, (u_k - c1 v)(u_k - c2 v) <= 0 at all times. Added to the block with multipliers
of zero or more, whose mean can only lower it, the same conclusion holds for every such logic.
Integers and the standard library only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, Verdict, undecided
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    acting_text,
    misnamed,
    outputs_text,
    read_outputs,
    require_scales,
    require_shapes,
    write_outputs,
)
from polefence.proof.claims.started import is_semidefinite
from polefence.proof.dampers import SemiActive, dampers_text, read_dampers
from polefence.proof.matrices import Rationals, common_denominator, is_symmetric, product
from polefence.proof.plant import Output, Plant
from polefence.proof.reading import MAX_SIZE, Table, plain
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up
from polefence.proof.work import FormatError, WorkError

MAX_LIMITS = 100


@dataclass(frozen=True)
class RmsLimit(Short):
    """The rms of the outputs, one or a vector, is at most ``level``.

    For white noise of two-sided ``intensity``.
    """

    outputs: tuple[Output, ...]
    level: Fraction
    intensity: Fraction = Fraction(1)

    @classmethod
    def read(cls, table: Table, plant: Plant) -> Self:
        """Read a limit."""
        outputs = read_outputs(table, plant, MAX_ENTRIES)
        return cls(outputs, table.number("level"), table.number("intensity", 1))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        numbers = {"level": plain(self.level), "intensity": plain(self.intensity)}
        return write_outputs(self.outputs) | numbers


class Refuted(Claim):
    """No law keeps limits at once, at a vertex."""

    letters: ClassVar[str] = "ABE"
    of_law: ClassVar[bool] = False

    limits: tuple[Any, ...]  # each with its outputs
    vertex: int
    factor: Fraction = Fraction(1)
    dampers: tuple[SemiActive, ...] = ()

    @property
    def of_laws(self) -> str:
        """What laws are meant, in words."""
        return "semi-active law" if self.dampers else "law"

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that an output has the name of another signal of the plant."""
        return misnamed([output for limit in self.limits for output in limit.outputs], plant)


@dataclass(frozen=True)
class RmsRefutation(Short, Refuted):
    """At a vertex no law keeps the limits, nor ``factor`` times each: the claim and its evidence.

    Attributes
    ----------
    A, B, E : list of matrices
        For each vertex.
    limits : tuple of RmsLimit
    vertex : int
        Counted from zero.
    weights : tuple of Fraction
        One a limit, for mean squares over the intensity.
    P : n x n rationals
    factor : Fraction
        At least 1.
    dampers : tuple of SemiActive
        The laws meant are those in which these inputs are forces of dampers.
    multipliers : tuple of Fraction
        One a damper.
    scales : tuple of Fraction
        How much of each disturbance acts; all of each where there are none.
    """

    kind: ClassVar[str] = "conflict"

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    limits: tuple[RmsLimit, ...]
    vertex: int
    weights: tuple[Fraction, ...]
    P: Rationals
    factor: Fraction = Fraction(1)
    dampers: tuple[SemiActive, ...] = ()
    multipliers: tuple[Fraction, ...] = ()
    scales: tuple[Fraction, ...] = ()

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:  # noqa: ARG003
        """Read the limits, the vertex and the evidence."""
        plant.require_noise(table.where)
        rows = table.tables("limits", MAX_LIMITS)
        dampers = read_dampers(table, plant)
        return cls(
            plant.A,
            plant.B,
            plant.E,
            tuple(RmsLimit.read(row, plant) for row in rows),
            table.whole("vertex", None, len(plant.A), 1) - 1,
            table.numbers("weights", len(rows), MAX_LIMITS),
            table.matrix("P", plant.n, plant.n),
            table.number("factor", 1),
            dampers,
            table.numbers("multipliers", len(dampers)) if dampers else (),
            table.numbers("disturbances", plant.q) if "disturbances" in table else (),
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind, "vertex": self.vertex + 1}
        table["limits"] = [limit.write() for limit in self.limits]
        table["factor"] = plain(self.factor)
        table |= {"disturbances": plain(self.scales)} if self.scales else {}
        table |= {"weights": plain(self.weights), "P": plain(self.P)}
        if not self.dampers:
            return table
        dampers = [damper.write() for damper in self.dampers]
        return table | {"dampers": dampers, "multipliers": plain(self.multipliers)}

    def statement(self, plant: Plant) -> str:
        """Say which limits no law keeps, each times the factor and rounded down."""
        said = [
            f"rms of {outputs_text(limit.outputs, plant)} <= "
            f"{digits_down(limit.level * self.factor)} at density "
            f"{digits_up(2 * limit.intensity, 4)}"
            for limit in self.limits
        ]
        meant = f", {dampers_text(self.dampers)}," if self.dampers else ""
        once = " at once" if len(said) > 1 else ""
        acting = acting_text(self.scales, plant)
        return f"at vertex {self.vertex + 1} no {self.of_laws}{meant} keeps{once} " + (
            f"{' and '.join(said)}{acting}"
        )

    def decided(self) -> Verdict:
        """Prove a claim that is consistent; undecided does not say that there is a law."""
        if not is_symmetric(self.P):
            return undecided("P is not symmetric")
        if min(self.weights) < 0:
            return undecided("a weight is negative")
        if min(self.multipliers, default=Fraction(0)) < 0:
            return undecided("a multiplier is negative")
        block = _block(self)
        if not is_semidefinite(block):
            return undecided("the block is not positive semidefinite")
        scales = self.scales or (Fraction(1),) * len(self.E[0][0])
        columns = zip(zip(*self.E[self.vertex], strict=True), scales, strict=True)
        least = sum(s**2 * _form(self.P, column) for column, s in columns)
        allowed = sum(
            a * limit.level**2 / limit.intensity
            for a, limit in zip(self.weights, self.limits, strict=True)
        )
        if not least > self.factor**2 * allowed:
            return undecided("the limits allow as much as every law has")
        return Verdict(
            "proved",
            f"at vertex {self.vertex + 1} no {self.of_laws} keeps {len(self.limits)} limits at "
            f"once: a block of {len(block)} rows positive semidefinite in exact arithmetic",
            1,
        )

    def require(self) -> None:
        """Refuse what is incomplete or inconsistent."""
        N, n, m = require_driven(self.A, self.B, self.E, self.scales)
        if n + m > 2 * MAX_SIZE:
            raise WorkError(f"{n} states and {m} inputs are too many to be checked here")
        require_shapes([self.P], 1, n, n, "P")
        if type(self.vertex) is not int or not 0 <= self.vertex < N:
            raise FormatError(f"vertex {self.vertex!r} is not one of 0 to {N - 1}")
        if not self.limits or len(self.weights) != len(self.limits):
            raise FormatError("there must be limits, and one weight for each")
        for limit in self.limits:
            require_limit(limit, N, n, m)
        if self.factor < 1:
            raise FormatError("factor must be 1 or more")
        if len(self.multipliers) != len(self.dampers):
            raise FormatError("there must be one multiplier for each damper")
        for damper in self.dampers:
            damper.require(N, n, m)
        numbers = [[[*self.weights, *self.multipliers, *self.scales, self.factor]], self.P]
        outputs = [output for limit in self.limits for output in limit.outputs]
        numbers += [M for z in outputs for M in (*z.C, *z.D)]
        numbers += [M for damper in self.dampers for M in damper.numbers]
        common_denominator([*numbers, *self.A, *self.B, *self.E])


def require_driven(
    A: list[Rationals], B: list[Rationals], E: list[Rationals], scales: Sequence[Fraction]
) -> tuple[int, int, int]:
    """Refuse a plant that is none, or without noise; return its vertices, states and inputs.

    Raises
    ------
    FormatError
    """
    if not A or not A[0] or not B or not B[0] or not E:
        raise FormatError("vertices, or how the disturbance enters, are missing")
    N, n, m, q = len(A), len(A[0]), len(B[0][0]), len(E[0][0]) if E[0] else 0
    require_shapes(A, N, n, n, "A")
    require_shapes(B, N, n, m, "B")
    require_shapes(E, N, n, q, "E")
    require_scales(scales, q)
    return N, n, m


def require_limit(limit: RmsLimit, N: int, n: int, m: int) -> None:
    """Refuse a limit that does not fit a plant, or is none.

    Raises
    ------
    FormatError
    """
    for output in limit.outputs:
        require_shapes(output.C, N, 1, n, "C")
        require_shapes(output.D, N, 1, m, "D")
        if output.F:
            raise FormatError("F: a disturbance passes straight into the output")
        if output.near is not None:
            raise FormatError("a limit on an output with functions of the parameters")
    if not limit.outputs or limit.level < 0 or limit.intensity <= 0:
        raise FormatError("a limit must be zero or more, of outputs, an intensity more than zero")


def _block(claim: RmsRefutation) -> Rationals:
    """Return the symmetric block of (x, u)."""
    A, B, P = claim.A[claim.vertex], claim.B[claim.vertex], claim.P
    n, m = len(A), len(B[0])
    F = [[*a, *b] for a, b in zip(A, B, strict=True)]
    PF = product(P, F)
    PF += [[Fraction(0)] * (n + m) for _ in range(m)]
    block = [[PF[i][j] + PF[j][i] for j in range(n + m)] for i in range(n + m)]
    for a, limit in zip(claim.weights, claim.limits, strict=True):
        for output in limit.outputs:
            y = [*output.C[claim.vertex][0], *output.D[claim.vertex][0]]
            for i, j in ((i, j) for i in range(n + m) for j in range(n + m)):
                block[i][j] += a * y[i] * y[j]
    for tau, damper in zip(claim.multipliers, claim.dampers, strict=True):
        first, second = damper.rows(claim.vertex, m)
        for i, j in ((i, j) for i in range(n + m) for j in range(n + m)):
            block[i][j] += tau * (first[i] * second[j] + second[i] * first[j]) / 2
    return block


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def _form(P: Rationals, x: Sequence[Fraction]) -> Fraction:
    return _dot(x, [_dot(row, x) for row in P])
