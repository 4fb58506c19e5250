"""Peak of a signal from rest, under disturbances of bounded energy.

-(N + N' + E E') > 0 and [ g^2, e Y ; e Y', X ] > 0: x' X^-1 x is at most the integral of |w|^2 so
far. The dual form is that of the rms: g^2 - e^2 tr E' Q E > 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.signal import (
    Rows,
    SignalClaim,
    Subject,
    dual_of_noise,
    most_noise,
    moving,
)
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, number
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down


@dataclass(frozen=True)
class EnergyPeak(SignalClaim):
    """|y(t)| stays within ``level``, from rest, for all w whose L2 norm is at most ``norm``."""

    kind: ClassVar[str] = "energy peak"
    has_dual: ClassVar[bool] = True

    norm: Fraction = Fraction(1)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read the norm."""
        return {"norm": table.number("norm", 1)}

    def write_extra(self) -> dict[str, Any]:
        """Return the norm."""
        return {"norm": plain(self.norm)}

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return what bounds the state, and the output in it."""
        driven = moving(self.subject, self.scales, X.sizes)
        # the norm times Y: level / norm would not be there for a norm of zero
        corner = number(self.level**2, X.sizes)
        return {
            "of the noise": self.subject.falling(X, N, driven),
            "of the output": [[corner, Y.times(self.norm)], [X]],
        }

    def dual_rows(self) -> Rows:
        """Return what bounds the observability Gramian, and the disturbances in it."""
        square = number(self.level**2, self.subject.sizes)
        return dual_of_noise(self, square, self.norm**2)

    @property
    def least_square(self) -> Fraction | None:
        """Of the dual form: the largest coefficient of norm^2 tr E'QE."""
        return most_noise(self, self.norm**2)

    @property
    def under(self) -> str:
        """The disturbances."""
        return f" at norm {digits_down(self.norm, 4)}"
