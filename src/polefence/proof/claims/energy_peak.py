"""Peak of a signal from rest, under disturbances of bounded energy.

-(N + N' + E E') > 0 and [ g^2, e Y ; e Y', X ] > 0: x' X^-1 x is at most the integral of |w|^2 so
far. The dual form is that of the rms: g^2 - e^2 tr E' Q E > 0.

Of a plant that is sampled, with inputs held between samples, it is the peak at all times, with
disturbances of continuous time: see `polefence.proof.claims.reached`.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof.between import Held
from polefence.proof.claims.held import StoredClaim
from polefence.proof.claims.reached import (
    outputs_of,
    require_reached,
    rows_of_reached,
)
from polefence.proof.claims.signal import (
    Rows,
    Subject,
    dual_of_noise,
    largest_coefficient,
    most_noise,
    moving,
)
from polefence.proof.claims.storage import Stretched, least_of_storage, stretched
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, number
from polefence.proof.reading import Table, plain
from polefence.proof.text import digits_down


@dataclass(frozen=True)
class EnergyPeak(StoredClaim):
    """|y(t)| stays within ``level``, from rest, for all w whose L2 norm is at most ``norm``.

    With ``held`` y and w are those at all times, of the plant of which this one is the samples.
    """

    kind: ClassVar[str] = "energy peak"
    late_as: ClassVar[str | None] = "rms"
    has_dual: ClassVar[bool] = True
    has_passing: ClassVar[bool] = True
    needs_dual: ClassVar[bool] = False

    norm: Fraction = Fraction(1)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,
        outputs: tuple[Output, ...],
    ) -> dict[str, Any]:
        """Read the norm, and what is sampled."""
        held = super().read_extra(table, subject, outputs)
        return {"norm": table.number("norm", 1)} | held

    def write_extra(self) -> dict[str, Any]:
        """Return the norm, and what is sampled."""
        return {"norm": plain(self.norm)} | super().write_extra()

    def require_extra(self) -> None:
        """Refuse what is sampled, or what is reached between samples, where it does not fit."""
        super().require_extra()
        require_reached(self.subject, self.held)

    @property
    def more_work(self) -> int:
        """Of what is reached between samples, the least that it takes."""
        return 0 if self.held is None else least_of_storage(self.subject, 0)

    @property
    def largest(self) -> int:
        """Rows of the largest inequality."""
        return super().largest if self.held is None else self.subject.n + self.subject.m

    def _stretched(self, held: Held) -> list[Stretched]:
        return stretched(self.subject, self.outputs, self.scales, held)

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
        """Return what bounds the observability Gramian, or what is reached at all times."""
        if self.held is not None:
            parts, squares = self._stretched(self.held), (self.level**2, self.norm**2)
            return rows_of_reached(self.subject, self.held, parts, *squares)
        square = number(self.level**2, self.subject.sizes)
        return dual_of_noise(self, square, self.norm**2)

    @property
    def least_square(self) -> Fraction | None:
        """Of the dual form the largest coefficient of norm^2 tr E'QE; at all times of Y P Y'."""
        if self.held is None:
            return most_noise(self, self.norm**2)
        evidence, sizes = self.subject.evidence, self.subject.sizes
        if evidence.cells:
            return None
        shown = outputs_of(sizes, self._stretched(self.held))
        return max(largest_coefficient(P, evidence.elevation) for P in shown)

    @property
    def under(self) -> str:
        """The disturbances."""
        return f" at norm {digits_down(self.norm, 4)}"
