"""A decay rate of a loop whose clock is not perfect.

With Q > 0 on the box of the parameters and F(theta) what a period of theta T makes of the states at
a sample, F = 1 + T A_theta in the difference form,

    e^(-2 sigma theta T) Q - F'Q F > 0

says that the root of x'Q x falls by e^(-sigma t) over any sequence of periods. The power is convex:
with that at the begin a of a part of the periods, rounded down to l, it is no less there than
l (1 - 2 sigma T (theta - a)). In the difference form, divided by T,

    (l (1 - 2 sigma T (theta - a)) - 1) / T Q - (Q A_theta + A_theta'Q + T A_theta'Q A_theta) > 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.between import Held
from polefence.proof.claims.base import require_law
from polefence.proof.claims.clock import falling_of
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.signal import Rows, read_subject
from polefence.proof.matrices import ZERO
from polefence.proof.plant import Output, Plant
from polefence.proof.polynomials import number
from polefence.proof.reading import Table
from polefence.proof.text import digits_down
from polefence.proof.work import FormatError

TERMS, BITS = 40, 128
MOST = 64  # of 2 sigma times a period: e^-64 is less than any loop leaves


@dataclass(frozen=True)
class Decay(Rms):
    """All states at samples fall by exp(-``level`` t), whatever the periods of the clock."""

    kind: ClassVar[str] = "decay"
    late_as: ClassVar[str | None] = None

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read the rate, the clock and the evidence."""
        law = require_law(law, cls.kind)
        if not plant.E:
            raise FormatError(f"{table.where}: the plant has no E")
        subject = read_subject(table.table("evidence"), plant, law, on)
        held = Held.read(table.table("held"))
        return cls(
            subject, (none(plant.n, plant.m, len(plant.A)),), table.number("level"), held=held
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table = super().write()
        for key in ("name", "output", "intensity"):
            table.pop(key, None)
        return table

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say how fast states fall."""
        return (
            f"decay by exp(-{digits_down(self.level)} t){self.time_text}, on the {self.subject.on}"
        )

    @property
    def time_text(self) -> str:
        """At samples, where Q falls."""
        return super().time_text.replace("at all times", "at samples", 1)

    @property
    def under(self) -> str:
        """No motion is meant."""
        return ""

    @property
    def names(self) -> tuple[str, ...]:
        """All states."""
        return ("all states",)

    def require_extra(self) -> None:
        """Refuse what has no clock."""
        if self.held is None or self.held.clock is None:
            raise FormatError("decay: a claim for a clock that is not perfect")
        if 2 * self.level * self.held.clock.most * self.subject.step > MOST:
            raise FormatError("decay: faster than is proved of any loop")
        super().require_extra()

    def dual_rows(self) -> Rows:
        """Return the inequality of each part of the periods."""
        held, subject = self.held, self.subject
        if held is None or held.clock is None:
            raise FormatError("decay: a claim for a clock that is not perfect")
        T, rows = subject.step, Rows()
        for k, (step, (begin, _)) in enumerate(zip(self._steps(), held.clock.lengths, strict=True)):
            least = power_below(2 * self.level * begin * T)
            slope = 2 * self.level * T
            left = number(least * (1 + slope * begin) - 1, step.theta.sizes)
            left = (left - step.theta.times(least * slope)).times(1 / T)
            blocks, kappa = falling_of(subject, self.outputs, held, step, left)
            rows[f"of the decay, periods {k + 1}"] = blocks
            rows |= kappa
        return rows

    @property
    def least_square(self) -> Fraction | None:
        """Nothing is a square here."""
        return None


def none(n: int, m: int, count: int) -> Output:
    """Return an output that is zero."""
    return Output([[[ZERO] * n]] * count, [[[ZERO] * m]] * count, "")


def power_below(x: Fraction) -> Fraction:
    """Return a number that is no more than e^-x, x not negative: one over more than e^x.

    e^(x / 2^j), x / 2^j at most 1, is its series and at most twice the next term, rounded up.
    """
    halvings = max(0, x.__ceil__()).bit_length()
    y = -((-x.numerator << BITS) // (x.denominator << halvings))
    one = 1 << BITS
    total = term = one
    for k in range(1, TERMS + 1):
        term = -((-term * y) // (k << BITS))
        total += term
    total += 2 * term
    for _ in range(halvings):
        total = -((-total * total) >> BITS)
    return Fraction(one, total)
