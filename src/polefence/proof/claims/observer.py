"""All poles of an observer's error in a region: those of A - L C, by the dual plant.

x^' = A x^ + B u + L (y - C x^) has the error e = x - x^ with e' = (A - L C) e. A - L C and its
transpose A' - C' L' have one spectrum: the claim is that of a law K = -L' of the plant (A', C').
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, Inequality, Verdict
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import read_law
from polefence.proof.matrices import Rationals
from polefence.proof.plant import Plant
from polefence.proof.reading import MAX_VERTICES, Table, plain, require_shape
from polefence.proof.short import Short
from polefence.proof.text import quoted, region_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Observer(Short, Claim):
    """All poles of A(alpha) - L(alpha) C(alpha) lie in a region.

    ``dual`` is the claim about the law K = -L' of the plant (A', C'); ``measured`` names the rows
    of C, where they have names.
    """

    kind: ClassVar[str] = "observer"
    letters: ClassVar[str] = "A"
    of_law: ClassVar[bool] = False

    dual: Poles
    measured: tuple[str, ...] = ()

    @property
    def C(self) -> list[Rationals]:
        """Rows of the measured outputs, at every vertex."""
        return [_transposed(B) for B in self.dual.B]

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read what is measured, the law of the dual plant, and the claim about it."""
        C = table.matrices("C", None, plant.n, MAX_VERTICES)
        C = C * len(plant.A) if len(C) == 1 else C
        if len(C) != len(plant.A):
            raise FormatError(f"{table.path('C')} must hold one matrix, or one per vertex")
        for matrix in C:
            require_shape(matrix, len(C[0]), plant.n, table.path("C"))
        measured = table.texts("measured")
        if measured and len(measured) != len(C[0]):
            raise FormatError(f"{table.path('measured')} must name each row of C")
        A, B = (list(map(_transposed, matrices)) for matrices in (plant.A, C))
        remainder = plant.remainder and plant.remainder.transposed(plant.n, len(C[0]))
        dual = replace(plant.at_rest, A=A, B=B, E=[], remainder=remainder, nodes=())
        law, on = read_law(table.table("law"), dual)
        if law.polynomial:
            raise FormatError(f"{table.path('law')} must be fixed or scheduled, of an observer")
        return cls(Poles.read(table, dual, law, on), measured)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        C, claim = self.C, self.dual.write()
        table: dict[str, Any] = {"kind": self.kind}
        table["C"] = plain(C[:1] if all(matrix == C[0] for matrix in C) else C)
        table |= {"measured": list(self.measured)} if self.measured else {}
        table["law"] = self.dual.law.write(self.dual.on)
        return table | {key: claim[key] for key in ("region", "method", "evidence")}

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say where the poles of the error are, and what is measured."""
        dual = self.dual
        by = dual.under.replace("one gain K", "one gain L").replace("K(alpha) =", "-L(alpha)' =")
        measured = ", ".join(map(quoted, self.measured)) or "C as in the file"
        region = region_text(dual.region)
        return f"poles in {region}, of A - L C with {by}; an observer, measured {measured}"

    def require(self) -> None:
        """Refuse what the dual's claim refuses."""
        self.dual.require()

    def decided(self) -> Verdict:
        """Prove the dual's claim."""
        return self.dual.decided()

    def inequalities(self) -> Iterator[Inequality]:
        """Yield the dual's."""
        return self.dual.inequalities()


def _transposed(matrix: Rationals) -> Rationals:
    return [list(column) for column in zip(*matrix, strict=True)]
