"""Peak of a signal from initial states.

-(N + N') > 0, [ 1, x0' ; x0, X ] > 0 for each initial state and [ g^2, Y ; Y', X ] > 0: x' X^-1 x
stays below 1. For all initial states of an ellipsoid x0' X0^-1 x0 <= 1, X - X0 > 0.

Of a plant that is sampled, with inputs held between samples, it is the peak at all times: see
`polefence.proof.claims.reached`, without disturbances. The initial states are those at a sample,
and X holds them. An impulse may come between samples: there is no such bound after one.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

from polefence.proof.claims.held import StoredClaim
from polefence.proof.claims.reached import outputs_of, require_reached, rows_of_reached
from polefence.proof.claims.signal import Rows, largest_coefficient
from polefence.proof.claims.started import StartedClaim
from polefence.proof.claims.storage import Stretched, least_of_storage, stretched
from polefence.proof.polynomials import Polynomial, bernstein, number
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class InitialPeak(StartedClaim, StoredClaim):
    """|y(t)| stays within ``level`` from each initial state, w = 0.

    With ``held`` y is that at all times, of the plant of which this one is the samples.
    """

    kind: ClassVar[str] = "initial peak"
    has_passing: ClassVar[bool] = True
    needs_dual: ClassVar[bool] = False

    def require_extra(self) -> None:
        """Refuse initial states, what is sampled, or what is reached, where it does not fit."""
        super().require_extra()
        if self.held is not None and any(self.impulses):
            raise FormatError("impulses: a peak at all times is one from states at a sample")
        require_reached(self.subject, self.held)

    @property
    def more_work(self) -> int:
        """Of what is reached between samples, the least that it takes."""
        return 0 if self.held is None else least_of_storage(self.subject, 0)

    @property
    def largest(self) -> int:
        """Rows of the largest inequality."""
        return super().largest if self.held is None else self.subject.n + self.subject.m

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return the decrease, the initial states, and the output."""
        rows = {"of the decrease": self.subject.falling(X, N)} | self._started(X)
        return rows | {"of the output": [[number(self.level**2, X.sizes), Y], [X]]}

    def dual_rows(self) -> Rows:
        """Return what bounds what is reached at all times, from all initial states."""
        if self.held is None:
            return super().dual_rows()
        subject, parts = self.subject, self._stretched
        rows = rows_of_reached(subject, self.held, parts, self.level**2)
        W = subject.law.form(subject.sizes).part(slice(subject.n))
        Q = bernstein(subject.evidence.X, subject.sizes, subject.evidence.degree)
        return rows | self._started((W * Q) * W.T)

    @property
    def _stretched(self) -> list[Stretched]:
        held = self.held
        return [] if held is None else stretched(self.subject, self.outputs, (), held)

    @property
    def least_square(self) -> Fraction | None:
        """At all times the largest coefficient of Y P Y'."""
        evidence, sizes = self.subject.evidence, self.subject.sizes
        if self.held is None or evidence.cells:
            return None
        shown = outputs_of(sizes, self._stretched)
        return max(largest_coefficient(P, evidence.elevation) for P in shown)
