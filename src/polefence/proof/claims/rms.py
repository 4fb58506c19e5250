"""Rms of a signal under white noise.

-(N + N' + S E E') > 0 and [ g^2, Y ; Y', X ] > 0 for two-sided intensity S: X is more than the
stationary covariance, and Y X^-1 Y' < g^2. The rms of a vector z is the root of E z'z, that of the
sum of its entries' squares: with the rows Y_j of Y side by side and X once for each of them on the
diagonal, one inequality says sum_j Y_j X^-1 Y_j' < g^2, and no further evidence is needed.

The dual form: Q > 0 at a vertex, -(N + N' + Y'Y) > 0 with N = Q (A + B K), Y = C + D K, and
g^2 - S tr E'QE > 0: Q is more than the observability Gramian. The products are polynomials; in
blocks the coefficients of Y would stand squared in place of those of Y'Y, which proves less.

Of a plant that is sampled, x' = A x + B u + E w with u held between samples, the rms is the root of
the mean of E z'z over all of the time. The dual form then has [I; K]'M [I; K] in place of Y'Y, V in
place of S E E', and g^2 - c of g^2: see `polefence.proof.between`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, ClassVar, Self

from polefence.proof.between import Mean, Period, Step
from polefence.proof.claims.clock import least_square, rows_of_clock, steps_of
from polefence.proof.claims.held import HeldClaim
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    Rows,
    Subject,
    bounded,
    dual_of_noise,
    largest_coefficient,
    most_noise,
    moving,
)
from polefence.proof.laws import Piece, Point
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, bernstein, number
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down
from polefence.proof.transfer import Tensor, Transfer, bernstein_of, combined
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Rms(HeldClaim):
    """The rms of z is less than ``level`` for white noise w of two-sided ``intensity``.

    The stationary covariance P satisfies A P + P A' + intensity E E' = 0. With ``held`` the plant
    is the samples of that one, and the rms is that of the signal at all times; ``part`` is the part
    of its box that the claim is about, with the period there.
    """

    kind: ClassVar[str] = "rms"
    late_as: ClassVar[str | None] = "rms"
    most: ClassVar[int] = MAX_ENTRIES
    has_dual: ClassVar[bool] = True
    has_transfer: ClassVar[bool] = True
    has_filters: ClassVar[bool] = True
    has_passing: ClassVar[bool] = True
    motion_note: ClassVar[str] = ", independently of w"

    intensity: Fraction = Fraction(1)
    part: tuple[Period, Point, Point] | None = field(
        default=None, kw_only=True, repr=False, compare=False
    )

    @classmethod
    def read_extra(
        cls, table: Table, subject: Subject, outputs: tuple[Output, ...]
    ) -> dict[str, Any]:
        """Read the intensity, and what is sampled."""
        held = super().read_extra(table, subject, outputs)
        return {"intensity": table.number("intensity", 1)} | held

    def write_extra(self) -> dict[str, Any]:
        """Return the intensity, and what is sampled."""
        return {"intensity": plain(self.intensity)} | super().write_extra()

    def require(self) -> None:
        """Refuse what does not fit, or is too much."""
        super().require()
        if self.held is not None:
            clock = self.held.clock
            periods = [self._period] if clock is None else map(self._period.between, clock.lengths)
            for period in periods:
                period.require_moderate()

    def inside(self, piece: Piece) -> Self:
        """Return the claim about a part of the box."""
        inner = super().inside(piece)
        return replace(inner, part=(self._period, piece.low, piece.high)) if self.held else inner

    @cached_property
    def _period(self) -> Period:
        if self.held is None:
            raise FormatError("held: the plant is no samples")
        return self.held.period(self.outputs, self.scales, self.subject.step, self.intensity)

    @property
    def _part(self) -> tuple[Period, Point, Point]:
        """What goes on in a period, and the part of the box that it is about."""
        if self.part is not None:
            return self.part
        count = self._period.parameters
        return self._period, (Fraction(0),) * count, (Fraction(1),) * count

    def _mean(self) -> Mean:
        """Return what bounds the mean over a period, in the part that it is about."""
        period, low, high = self._part
        return period.on_part(low, high, self.subject.sizes)

    def _steps(self) -> list[Step]:
        """Return the same for periods of any length."""
        period, low, high = self._part
        if self.held is None:
            raise FormatError("held: the plant is no samples")
        return steps_of(period, self.held, low, high, self.subject)

    def _require_remainder(self) -> None:
        """Refuse evidence that does not cover a remainder: with a clock that is not the plant's."""
        if self.held is None or self.held.clock is None:
            super()._require_remainder()
        elif self.subject.evidence.spread is None and not self.subject.evidence.cells:
            raise FormatError("a clock has evidence of what its periods may be off by")

    @property
    def largest(self) -> int:
        """Rows of the output's inequality, where that is the largest."""
        return max(super().largest, 1 + len(self.outputs) * self.subject.n)

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return what bounds the covariance, and the sum of the outputs' variances."""
        driven = moving(self.subject, self.scales, X.sizes, self.intensity)
        falling, corner = self.subject.falling(X, N, driven), number(self.level**2, X.sizes)
        return {"of the noise": falling, "of the output": bounded(corner, X, Y)}

    def dual_rows(self) -> Rows:
        """Return what bounds the observability Gramian, and the noise in it."""
        square = number(self.level**2, self.subject.sizes)
        if self.held is None:
            return dual_of_noise(self, square, self.intensity)
        if self.held.clock is not None:
            return rows_of_clock(self.subject, self.outputs, self.held, self._steps(), self.level)
        form = self.held.chosen(self.outputs, self.subject.law.form(self.subject.sizes))
        mean = self._mean()
        energy = form.T.half_times(mean.M * form)
        return dual_of_noise(self, square, self.intensity, energy, mean.noise)

    @property
    def least_square(self) -> Fraction | None:
        """Of the dual form: the largest coefficient of intensity tr E'QE, or of c + tr Q V."""
        if self.held is None:
            return most_noise(self, self.intensity)
        evidence = self.subject.evidence
        if not evidence.dual or evidence.cells:
            return None
        Q = bernstein(evidence.X, self.subject.sizes, evidence.degree)
        if self.held.clock is not None:
            return least_square(Q, self._steps(), evidence.elevation)
        return largest_coefficient(self._mean().noise(Q), evidence.elevation)

    def polynomials(self, transfer: Transfer) -> Iterator[tuple[str, Tensor]]:
        """Yield D, and g^2 D - S N, where the variance is S N / D."""
        D, N = transfer.variance
        yield "of the poles", bernstein_of(D)
        yield "of the variance", bernstein_of(combined(D, self.level**2, N, -self.intensity))

    def value(self, transfer: Transfer) -> Fraction:
        """Return the square of the rms at the first node."""
        return self.intensity * transfer.square

    @property
    def under(self) -> str:
        """The noise."""
        return f" at density {digits_down(2 * self.intensity, 4)}"
