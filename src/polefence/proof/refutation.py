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

from polefence.proof.claims.base import Verdict, undecided
from polefence.proof.claims.initial_peak import is_semidefinite
from polefence.proof.claims.signal import require_shapes
from polefence.proof.matrices import Rationals, common_denominator, is_symmetric, product
from polefence.proof.plant import Output
from polefence.proof.reading import MAX_SIZE
from polefence.proof.work import FormatError, counted


@dataclass(frozen=True)
class RmsLimit:
    """The rms of the outputs, one or a vector, is at most ``level``.

    For white noise of two-sided ``intensity``.
    """

    outputs: tuple[Output, ...]
    level: Fraction
    intensity: Fraction = Fraction(1)


@dataclass(frozen=True)
class SemiActive:
    """An input that is c times a rate, c from ``low`` to ``high`` at any time.

    Attributes
    ----------
    number : int
        Of the input, counted from zero.
    rate : list of matrices
        Of one row, at every vertex: the rate by the state.
    low, high : Fraction
    """

    number: int
    rate: list[Rationals]
    low: Fraction
    high: Fraction

    def rows(self, vertex: int, m: int) -> tuple[list[Fraction], list[Fraction]]:
        """Return u - low v and u - high v by (x, u)."""
        rate, push = self.rate[vertex][0], [Fraction(int(k == self.number)) for k in range(m)]
        first, second = ([*(-c * x for x in rate), *push] for c in (self.low, self.high))
        return first, second


@dataclass(frozen=True)
class RmsRefutation:
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
    """

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

    @property
    def of_laws(self) -> str:
        """What laws are meant, in words."""
        return "semi-active law" if self.dampers else "law"


def prove_refutation(claim: RmsRefutation) -> Verdict:
    """Decide whether the evidence proves the claim; False does not say that there is a law.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent.
    """
    _require_consistent(claim)
    with counted():
        return _proved(claim)


def _proved(claim: RmsRefutation) -> Verdict:
    if not is_symmetric(claim.P):
        return undecided("P is not symmetric")
    if min(claim.weights) < 0:
        return undecided("a weight is negative")
    if min(claim.multipliers, default=Fraction(0)) < 0:
        return undecided("a multiplier is negative")
    block = _block(claim)
    if not is_semidefinite(block):
        return undecided("the block is not positive semidefinite")
    E = claim.E[claim.vertex]
    least = sum(_form(claim.P, column) for column in zip(*E, strict=True))
    allowed = sum(
        a * limit.level**2 / limit.intensity
        for a, limit in zip(claim.weights, claim.limits, strict=True)
    )
    if not least > claim.factor**2 * allowed:
        return undecided("the limits allow as much as every law has")
    return Verdict(
        "proved",
        f"at vertex {claim.vertex + 1} no {claim.of_laws} keeps {len(claim.limits)} limits at "
        f"once: a block of {len(block)} rows positive semidefinite in exact arithmetic",
    )


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


def _require_consistent(claim: RmsRefutation) -> None:
    if not claim.A or not claim.A[0] or not claim.B or not claim.B[0] or not claim.E:
        raise FormatError("vertices, or how the disturbance enters, are missing")
    N, n, m = len(claim.A), len(claim.A[0]), len(claim.B[0][0])
    if n + m > 2 * MAX_SIZE:
        raise FormatError(f"{n} states and {m} inputs are more than is checked here")
    require_shapes(claim.A, N, n, n, "A")
    require_shapes(claim.B, N, n, m, "B")
    require_shapes(claim.E, N, n, len(claim.E[0][0]) if claim.E[0] else 0, "E")
    require_shapes([claim.P], 1, n, n, "P")
    if type(claim.vertex) is not int or not 0 <= claim.vertex < N:
        raise FormatError(f"vertex {claim.vertex!r} is not one of 0 to {N - 1}")
    if not claim.limits or len(claim.weights) != len(claim.limits):
        raise FormatError("there must be limits, and one weight for each")
    for limit in claim.limits:
        for output in limit.outputs:
            require_shapes(output.C, N, 1, n, "C")
            require_shapes(output.D, N, 1, m, "D")
        if limit.level < 0 or limit.intensity <= 0:
            raise FormatError("a limit must be zero or more, an intensity more than zero")
    if claim.factor < 1:
        raise FormatError("factor must be 1 or more")
    _require_dampers(claim)
    numbers = [[[*claim.weights, *claim.multipliers, claim.factor]], claim.P]
    outputs = [output for limit in claim.limits for output in limit.outputs]
    numbers += [M for own in outputs for M in (*own.C, *own.D)]
    numbers += [M for own in claim.dampers for M in (*own.rate, [[own.low, own.high]])]
    common_denominator([*numbers, *claim.A, *claim.B, *claim.E])


def _require_dampers(claim: RmsRefutation) -> None:
    N, n, m = len(claim.A), len(claim.A[0]), len(claim.B[0][0])
    if len(claim.multipliers) != len(claim.dampers):
        raise FormatError("there must be one multiplier for each damper")
    for damper in claim.dampers:
        if type(damper.number) is not int or not 0 <= damper.number < m:
            raise FormatError(f"damper: input {damper.number!r} is not one of 0 to {m - 1}")
        require_shapes(damper.rate, N, 1, n, "rate")
        if damper.low > damper.high:
            raise FormatError("damper: low must not be above high")
