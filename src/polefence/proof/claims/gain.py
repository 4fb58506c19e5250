"""L2 gain from the disturbances to a signal, by the bounded real lemma.

X > 0 and, with z = C x + D u + F w of p rows and q disturbances,
[ -(N + N'), -E, -Y' ; *, g I_q, -F' ; *, *, g I_p ] > 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

from polefence.proof.claims.signal import MAX_ENTRIES, Rows, SignalClaim, scaled, stacked
from polefence.proof.polynomials import Polynomial, diagonal


@dataclass(frozen=True)
class Gain(SignalClaim):
    """The L2 gain from w to z = C x + D u + F w, its H-infinity norm, is less than ``level``."""

    kind: ClassVar[str] = "gain"
    direct: ClassVar[bool] = True
    most: ClassVar[int] = MAX_ENTRIES

    @property
    def least_degree(self) -> int:
        """None."""
        return 0

    @property
    def largest(self) -> int:
        """Rows of the lemma."""
        return self.subject.n + self.subject.q + len(self.outputs)

    def rows(self, X: Polynomial, minus: Polynomial, Y: Polynomial) -> Rows:
        """Return X, and the bounded real lemma."""
        sizes, q, N = X.sizes, self.subject.q, len(self.subject.A)
        none = [[[Fraction(0)] * q]] * N
        F = scaled(stacked([own.F or none for own in self.outputs]), self.scales, sizes)
        E = scaled(self.subject.E, self.scales, sizes)
        lemma = [
            [minus, E.times(-1), Y.T.times(-1)],
            [diagonal([self.level] * q, sizes), F.T.times(-1)],
            [diagonal([self.level] * len(self.outputs), sizes)],
        ]
        return {"of X": [[X]], "of the gain": lemma}

    @property
    def under(self) -> str:
        """Nothing: every disturbance."""
        return ""
