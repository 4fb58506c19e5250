"""Rms of a signal under white noise.

-(N + N' + S E E') > 0 and [ g^2, Y ; Y', X ] > 0 for two-sided intensity S: X is more than the
stationary covariance, and Y X^-1 Y' < g^2. The rms of a vector z is the root of E z'z, that of the
sum of its entries' squares: with the rows Y_j of Y side by side and X once for each of them on the
diagonal, one inequality says sum_j Y_j X^-1 Y_j' < g^2, and no further evidence is needed.

The dual form: Q > 0 at a vertex, -(N + N' + Y'Y) > 0 with N = Q (A + B K), Y = C + D K, and
g^2 - S tr E'QE > 0: Q is more than the observability Gramian. The products are polynomials; in
blocks the coefficients of Y would stand squared in place of those of Y'Y, which proves less.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    Rows,
    SignalClaim,
    Subject,
    bounded,
    dual_of_noise,
    most_noise,
    moving,
)
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, number
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down
from polefence.proof.transfer import Tensor, Transfer, bernstein_of, combined


@dataclass(frozen=True)
class Rms(SignalClaim):
    """The rms of z is less than ``level`` for white noise w of two-sided ``intensity``.

    The stationary covariance P satisfies A P + P A' + intensity E E' = 0.
    """

    kind: ClassVar[str] = "rms"
    most: ClassVar[int] = MAX_ENTRIES
    has_dual: ClassVar[bool] = True
    has_transfer: ClassVar[bool] = True
    has_filters: ClassVar[bool] = True
    motion_note: ClassVar[str] = ", independently of w"

    intensity: Fraction = Fraction(1)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read the intensity."""
        return {"intensity": table.number("intensity", 1)}

    def write_extra(self) -> dict[str, Any]:
        """Return the intensity."""
        return {"intensity": plain(self.intensity)}

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
        return dual_of_noise(self, square, self.intensity)

    @property
    def least_square(self) -> Fraction | None:
        """Of the dual form: the largest coefficient of intensity tr E'QE."""
        return most_noise(self, self.intensity)

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
