"""Rms of a signal under white noise.

-(N + N' + S E E') > 0 and [ g^2, Y ; Y', X ] > 0 for two-sided intensity S: X is more than the
stationary covariance, and Y X^-1 Y' < g^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.signal import Rows, SignalClaim, Subject, noise
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, number
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down


@dataclass(frozen=True)
class Rms(SignalClaim):
    """The rms of y is less than ``level`` for white noise w of two-sided ``intensity``.

    The stationary covariance P satisfies A P + P A' + intensity E E' = 0.
    """

    kind: ClassVar[str] = "rms"

    intensity: Fraction = Fraction(1)

    @classmethod
    def read_own(cls, table: Table, subject: Subject, output: Output) -> dict[str, Any]:  # noqa: ARG003
        """Read the intensity."""
        return {"intensity": table.number("intensity", 1)}

    def write_own(self) -> dict[str, Any]:
        """Return the intensity."""
        return {"intensity": plain(self.intensity)}

    def rows(self, X: Polynomial, minus: Polynomial, Y: Polynomial) -> Rows:
        """Return what bounds the covariance, and the output's variance."""
        driven = minus - noise(self.subject.E, self.intensity, X.sizes)
        return {
            "of the noise": [[driven]],
            "of the output": [[number(self.level**2, X.sizes), Y], [X]],
        }

    @property
    def under(self) -> str:
        """The noise."""
        return f" at density {digits_down(2 * self.intensity, 4)}"
