"""Initial states: points, an ellipsoid of them, and what impulses leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from polefence.proof import matrices
from polefence.proof.claims.signal import Rows, SignalClaim, Subject, require_shapes, varies
from polefence.proof.matrices import (
    LONGEST,
    Rationals,
    common_denominator,
    is_symmetric,
    whole_numbers,
)
from polefence.proof.plant import Output
from polefence.proof.polynomials import Polynomial, constant, number
from polefence.proof.reading import Table, as_matrix, plain
from polefence.proof.text import ellipsoid_text, impulses_text, points_text
from polefence.proof.work import FormatError

MAX_POINTS = 64  # initial states of one claim, and impulses


@dataclass(frozen=True)
class StartedClaim(SignalClaim):
    """A bound from initial states, and from the convex hull of them and their negatives.

    They are ``points`` (n numbers each); s E_k, which an impulse of s in column k of w leaves:
    ``impulses`` holds one s a column, or nothing; and X0 v, v' X0 v <= 1, X0 = ``ellipsoid`` (n x
    n, positive semidefinite, or nothing), which are x0' X0^-1 x0 <= 1 where X0 has an inverse.
    """

    driven: ClassVar[bool] = False

    points: tuple[tuple[Fraction, ...], ...] = ()
    impulses: tuple[Fraction, ...] = ()
    ellipsoid: tuple[tuple[Fraction, ...], ...] = ()

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,
        outputs: tuple[Output, ...],
    ) -> dict[str, Any]:
        """Read the initial states."""
        n, states = subject.n, super().read_extra(table, subject, outputs)
        if "points" in table:
            rows, where = table.items("points", MAX_POINTS), table.path("points")
            states["points"] = tuple(tuple(as_matrix([row], where, 1, n)[0]) for row in rows)
        if "impulses" in table:
            if not subject.E:
                raise FormatError(f"{table.path('impulses')}: the plant has no E")
            states["impulses"] = table.numbers("impulses", subject.q)
        if "ellipsoid" in table:
            states["ellipsoid"] = tuple(map(tuple, table.matrix("ellipsoid", n, n)))
        return states

    def write_extra(self) -> dict[str, Any]:
        """Return the initial states."""
        keys = ("points", "impulses", "ellipsoid")
        states = {key: plain(getattr(self, key)) for key in keys if getattr(self, key)}
        return states | super().write_extra()

    def require_extra(self) -> None:
        """Refuse initial states that are none, or too many."""
        super().require_extra()
        n, q, ellipsoid = self.subject.n, self.subject.q, self.ellipsoid
        if ellipsoid:
            X0 = list(map(list, ellipsoid))
            require_shapes([X0], 1, n, n, "ellipsoid")
            if not is_symmetric(X0) or not is_semidefinite(X0):
                raise FormatError("ellipsoid must be symmetric, without negative eigenvalues")
        if self.subject.remainder is not None and self.impulses:
            raise FormatError("impulses: after one the state is only near what the vertices say")
        if not self.points and not any(self.impulses) and not any(map(any, ellipsoid)):
            raise FormatError("points and impulses are missing: there is no initial state")
        if any(len(point) != n for point in self.points):
            raise FormatError(f"points must hold {n} numbers each")
        if self.impulses and len(self.impulses) != q:
            raise FormatError(f"impulses must hold {q} numbers, one per column of E")
        if len(self.points) + len(self.impulses) > MAX_POINTS:
            raise FormatError(f"there are more than {MAX_POINTS} points and impulses")

    @property
    def acting(self) -> Sequence[int]:
        """Numbers of the disturbances that have an impulse."""
        return [k for k, size in enumerate(self.impulses) if size]

    @property
    def blocks_at_most(self) -> int:
        """Two, and one for each initial state."""
        return 2 + len(self.points) + len(self.impulses) + bool(self.ellipsoid)

    @property
    def least_degree(self) -> int:
        """None."""
        return 0

    def _started(self, X: Polynomial) -> Rows:
        """Return that X holds the initial states.

        In discrete time an impulse leaves its own a sample later, when parameters have moved; of an
        E that is the same everywhere it does not matter.
        """
        sizes, subject, rows = X.sizes, self.subject, Rows()
        one, later = number(1, sizes), X
        moves = varies(subject.E) or subject.law.F
        if subject.step and subject.change is not None and moves:
            later = X + subject.change
        for k, point in enumerate(self.points):
            x = constant([[x] for x in point], sizes)
            rows[f"of point {k + 1}"] = [[one, x.T], [X]]
        for k, size in enumerate(self.impulses):
            if size:
                x = subject.driving((), sizes).part(slice(None), slice(k, k + 1)).times(size)
                rows[f"of impulse {k + 1}"] = [[one, x.T], [later]]
        if self.ellipsoid:
            rows["of the ellipsoid"] = [[X - constant(list(map(list, self.ellipsoid)), sizes)]]
        return rows

    @property
    def under(self) -> str:
        """The initial states."""
        starts = [points_text(self.points)] * bool(self.points)
        starts += [impulses_text(self.impulses)] * any(self.impulses)
        starts += [ellipsoid_text(self.ellipsoid)] * bool(self.ellipsoid)
        return f" from {', or from '.join(starts)}"


def is_semidefinite(matrix: Rationals) -> bool:
    """Whether a symmetric matrix has no negative eigenvalue."""
    common = common_denominator([matrix], LONGEST)
    return matrices.is_semidefinite(whole_numbers(matrix, common))
