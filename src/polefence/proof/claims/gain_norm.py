"""Norm of the gain K(alpha), in units of states and inputs.

[ H' H, V' ; V, g^2 I ] > 0 with H = diag(columns)^-1 W, V = diag(rows)^-1 Z, W = I and Z = K of a
fixed gain: V H^-1 = diag(rows)^-1 K diag(columns).

H' H of a law whose W varies much has coefficients that are not positive. With numbers s(alpha) > 0

    W - s diag(columns)^2 > 0   and   [ W, V' ; V, s g^2 I ] > 0

prove it too, though of a larger g: W^-1 diag(columns)^2 W^-1 < W^-1 / s, so V H^-1 H^-1' V' is less
than V W^-1 V' / s < g^2 I. Both are linear in W, Z and s.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, Inequality, require_law, require_work
from polefence.proof.claims.factor_margin import GainMargin
from polefence.proof.claims.signal import SignalClaim, Subject
from polefence.proof.laws import DOMAINS, Evidence
from polefence.proof.matrices import Rationals, least_work
from polefence.proof.plant import Output, Plant
from polefence.proof.polynomials import bernstein, count_of, diagonal
from polefence.proof.reading import Table, plain
from polefence.proof.short import Short
from polefence.proof.text import digits_down, digits_up
from polefence.proof.work import FormatError

LAW = "the law"  # what a claim about no signal is about


@dataclass(frozen=True)
class GainNorm(Short, Claim):
    """The spectral norm of diag(rows)^-1 K(alpha) diag(columns) is less than ``level``.

    ``rows`` holds one positive number an input, ``columns`` one a state. Of the subject's evidence
    only the elevation counts, and ``multiple``: the Bernstein coefficients of s, of the degree of a
    scheduled law. The subject has no step, remainder or motion: the law has none.
    """

    kind: ClassVar[str] = "gain norm"
    moves: ClassVar[bool] = True  # at every moment it is of one alpha

    subject: Subject
    level: Fraction
    rows: tuple[Fraction, ...]
    columns: tuple[Fraction, ...]

    @property
    def outputs(self) -> tuple[Output, ...]:
        """No signal, by the name of what is bounded."""
        return (Output([], [], LAW),)

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read level, units and elevation; of a gain the domain too."""
        law, below = require_law(law, cls.kind), table.table("evidence")
        on = plant.domain(below.word("on", DOMAINS, "simplex") if law.fixed else on)
        evidence = Evidence([], elevation=below.whole("elevation", 0))
        if "multiple" in below:
            multiple = below.numbers("multiple", most=len(law.W or law.K or []))
            evidence = replace(evidence, multiple=multiple)
        table.text("name", "")
        rows, columns = table.numbers("rows", plant.m), table.numbers("columns", plant.n)
        plant = plant.in_differences  # as all bounds have it
        subject = Subject(plant.A, plant.B, plant.E, law, evidence, on)
        return cls(subject, table.number("level"), rows, columns)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        evidence: dict[str, Any] = {"elevation": self.subject.evidence.elevation}
        if self.subject.evidence.multiple:
            evidence["multiple"] = plain(self.subject.evidence.multiple)
        return {
            "kind": self.kind,
            "name": LAW,
            "level": plain(self.level),
            "rows": plain(self.rows),
            "columns": plain(self.columns),
            "evidence": evidence | ({"on": self.subject.on} if self.subject.law.fixed else {}),
        }

    @property
    def bare(self) -> Self:
        """What is claimed, without what proves it."""
        return replace(self, subject=replace(self.subject, evidence=Evidence([])))

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say how large the gain is at most, in which units."""
        return f"{self.kind} of {LAW} <= {digits_up(self.level)}{self._units}"

    @property
    def _units(self) -> str:
        """Units of states and inputs, where they are not the plant's."""
        said = [
            f"{name} in units of {', '.join(digits(unit, 4) for unit in units)}"
            for name, units, digits in (
                ("states", self.columns, digits_down),
                ("inputs", self.rows, digits_up),
            )
            if any(unit != 1 for unit in units)
        ]
        return f", {' and '.join(said)}" if said else ""

    def require(self) -> None:
        """Refuse units that are none, evidence that does not belong here, too much work."""
        subject = self.subject
        evidence, law = subject.evidence, subject.law
        if replace(evidence, elevation=0, multiple=()) != Evidence([]):
            raise FormatError("a gain's norm is proved with nothing but an elevation and numbers s")
        if evidence.multiple and len(evidence.multiple) != len(law.W or []):
            raise FormatError("multiple must hold one number for each W of a scheduled law")
        evidence = replace(evidence, multiple=())
        if not subject.A or not subject.A[0] or not subject.B or not subject.B[0]:
            raise FormatError("vertices are missing")
        n, m = subject.n, subject.m
        if law.K is not None:  # any X of the right shape
            evidence = replace(evidence, X=[[[Fraction(0)] * n] * n])
        subject.require(evidence)
        if self.level < 0:
            raise FormatError("level must be zero or more")
        for key, units, count in (("rows", self.rows, m), ("columns", self.columns, n)):
            if len(units) != count or any(unit <= 0 for unit in units):
                raise FormatError(f"{key} must hold {count} positive numbers")
        degree = 2 * law.form_degree
        count = count_of(subject.sizes, degree + subject.evidence.elevation)
        require_work(least_work(count, n + m) * (2 if subject.evidence.multiple else 1))

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield W."""
        for k, W in enumerate(self.subject.law.W or []):
            yield f"W {k + 1}", W

    def inequalities(self) -> Iterator[Inequality]:
        """Yield the one inequality, or both."""
        n, m, sizes = len(self.columns), len(self.rows), self.subject.sizes
        form = self.subject.law.form(sizes)
        columns, rows = ([1 / unit for unit in units] for units in (self.columns, self.rows))
        V = diagonal(rows, sizes) * form.part(slice(n, n + m))
        corner, by = diagonal([self.level**2] * m, sizes), self.subject.evidence.elevation
        if self.subject.evidence.multiple:
            numbers = [[[multiple]] for multiple in self.subject.evidence.multiple]
            W, s = form.part(slice(n)), bernstein(numbers, sizes, self.subject.law.degree)
            less = W - s * diagonal([unit**2 for unit in self.columns], sizes)
            yield Inequality.raised("of W less a multiple", [[less]], by)
            yield Inequality.raised("of the gain's norm", [[W, V.T], [s * corner]], by)
            return
        H = diagonal(columns, sizes) * form.part(slice(n))
        square = H.T.half_times(H)
        yield Inequality.raised("of the gain's norm", [[square, V.T], [corner]], by)


BoundClaim = SignalClaim | GainNorm | GainMargin  # of a signal, the law, or a loop
