"""L2 gain from the disturbances to a signal, by the bounded real lemma.

X > 0 and, with y = C x + D u + F w, [ -(N + N'), -E, -Y' ; *, g I, -F' ; *, *, g ] > 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.claims.signal import Rows, SignalClaim, Subject, require_shapes
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, affine, diagonal, number
from polefence.proof.reading import Table, plain_rows


@dataclass(frozen=True)
class Gain(SignalClaim):
    """The L2 gain from w to y = C x + D u + F w is less than ``level``.

    ``F`` (1 x q at every vertex), zero if empty.
    """

    kind: ClassVar[str] = "gain"

    F: tuple[Rationals, ...] = ()

    @classmethod
    def read_own(cls, table: Table, subject: Subject, output: Output) -> dict[str, Any]:  # noqa: ARG003
        """Read F, which is beside C and D."""
        below = table.table("output")
        return {"F": tuple(below.rows("F", subject.q, len(subject.A)))} if "F" in below else {}

    def write_own(self) -> dict[str, Any]:
        """Return F."""
        return {"output": {"F": plain_rows(self.F)}} if self.F else {}

    def require_own(self) -> None:
        """Refuse F of another shape."""
        if self.F:
            require_shapes(list(self.F), len(self.subject.A), 1, self.subject.q, "F")

    @property
    def least_degree(self) -> int:
        """None."""
        return 0

    def rows(self, X: Polynomial, minus: Polynomial, Y: Polynomial) -> Rows:
        """Return X, and the bounded real lemma."""
        sizes, q = X.sizes, self.subject.q
        F = affine(list(self.F) or [[[Fraction(0)] * q]], sizes)
        lemma = [
            [minus, affine(self.subject.E, sizes).times(-1), Y.T.times(-1)],
            [diagonal([self.level] * q, sizes), F.T.times(-1)],
            [number(self.level, sizes)],
        ]
        return {"of X": [[X]], "of the gain": lemma}

    @property
    def under(self) -> str:
        """Nothing: every disturbance."""
        return ""
