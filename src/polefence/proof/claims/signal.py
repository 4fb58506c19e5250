"""Bounds on a signal of a closed loop: what all kinds of them have in common.

For x' = (A + B K) x + E w, y = C x + D u with one row y, and for every alpha of the simplex or the
box. With a Lyapunov polynomial X, N = (A + B K) X and Y = (C + D K) X are polynomials too; what
each kind asks of them is from Boyd et al. (1994), chapters 6 and 10, and Scherer, Gahinet & Chilali
(1997). Every inequality is a polynomial, homogeneous in each simplex; it holds if all of its
coefficients, times (sum of alpha)^elevation, are positive definite. All that is about one loop is
raised to one degree, the least that they need.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, Inequality, require_law, require_work
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import DOMAINS, Evidence, Law, lifted, read_evidence
from polefence.proof.matrices import MAX_BITS, Rationals, least_work
from polefence.proof.plant import Output, Plant, sizes_of
from polefence.proof.polynomials import Polynomial, Sizes, affine, bernstein, count_of, joint
from polefence.proof.reading import Table, plain, plain_rows
from polefence.proof.regions import HalfPlane
from polefence.proof.text import digits_up, output_text, quoted
from polefence.proof.work import FormatError

Rows = dict[str, list[list[Polynomial]]]  # blocks of inequalities, by their names


@dataclass(frozen=True)
class Subject:
    """The loop, and the Lyapunov polynomial X(alpha) with which a claim about it is proved.

    ``E`` (n x q at every vertex) may be empty where no disturbance acts. ``law`` is one K, one K
    at every vertex, or scheduled. ``evidence.X`` holds the coefficients of X, and for a scheduled
    law those of Q in X = W (multiple + Q W), as for the method "lyapunov" of designs; empty: X is
    the law's own W, times ``evidence.multiple`` if that holds one number.
    """

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    law: Law
    evidence: Evidence
    on: str = "simplex"

    @property
    def sizes(self) -> Sizes:
        """Corners of each simplex."""
        return sizes_of(len(self.A), self.on)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A[0])

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.B[0][0])

    @property
    def q(self) -> int:
        """Number of disturbances."""
        return len(self.E[0][0]) if self.E and self.E[0] else 0

    def loop(self, output: Output) -> tuple[Polynomial, Polynomial, Polynomial]:
        """Return X, N = (A + B K) X and Y = (C + D K) X, all of one degree."""
        n, vertices = self.n, zip(self.A, self.B, output.C, output.D, strict=True)
        plant = bernstein(  # [A, B; C, D]
            [
                [left + right for left, right in zip([*A, *C], [*B, *D], strict=True)]
                for A, B, C, D in vertices
            ],
            self.sizes,
            1,
            MAX_BITS,
        )
        XKX = lifted(self.law, self.evidence, self.sizes)
        NY = plant * XKX
        X = XKX.part(slice(n)).raised(NY.degrees)
        return X, NY.part(slice(n)), NY.part(slice(n, None))

    @property
    def as_poles(self) -> Poles:
        """A claim of the same loop and evidence about the half-plane Re z < 0."""
        evidence, method = self.evidence, "lyapunov"
        if not evidence.X and self.law.W is not None:
            evidence, method = replace(evidence, multiple=()), "scheduled"
        region = (HalfPlane(Fraction(0)),)
        return Poles(method, self.A, self.B, region, self.law, (evidence,), self.on)

    def require(self, evidence: Evidence | None = None) -> None:
        """Refuse a plant, a law and evidence that do not fit."""
        if not self.A or not self.A[0] or not self.B or not self.B[0]:
            raise FormatError("vertices are missing")
        N, n, m = len(self.A), self.n, self.m
        require_shapes(self.A, N, n, n, "A")
        require_shapes(self.B, N, n, m, "B")
        if self.q:
            require_shapes(self.E, N, n, self.q, "E")
        own, law = self.evidence if evidence is None else evidence, self.law
        each = ((law.K, m, "K"), (law.W, n, "W"), (law.Z, m, "Z"), (own.X, n, "X"))
        for matrices, rows, where in each:
            require_shapes(matrices or [], len(matrices or []), rows, n, where)
        if own.epsilon:
            raise FormatError("epsilon belongs to designs of the method slack")
        if not own.X and (own.degree or len(own.multiple) > 1):
            raise FormatError("the law's own W has its own degree, and at most one multiple")
        replace(self, evidence=own).as_poles.require()


def require_shapes(
    matrices: list[Rationals], count: int, rows: int, columns: int, where: str
) -> None:
    """Refuse other than so many matrices of this shape."""
    if len(matrices) != count:
        raise FormatError(f"{where} holds {len(matrices)} matrices, not {count}")
    for k, matrix in enumerate(matrices):
        if not columns or len(matrix) != rows or any(len(row) != columns for row in matrix):
            raise FormatError(f"{where} {k + 1} is not {rows} x {columns}")


@dataclass(frozen=True)
class SignalClaim(Claim):
    """An output of the loop, bounded by ``level``."""

    letters: ClassVar[str] = "ABE"
    driven: ClassVar[bool] = True  # whether it is about a disturbance

    subject: Subject
    output: Output
    level: Fraction

    # --- what each kind has of its own -----------------------------------------------------------

    @classmethod
    def read_own(cls, table: Table, subject: Subject, output: Output) -> dict[str, Any]:  # noqa: ARG003
        """Read the fields of this kind."""
        return {}

    def write_own(self) -> dict[str, Any]:
        """Return what `read_own` reads."""
        return {}

    def require_own(self) -> None:
        """Refuse fields of this kind that do not fit."""

    def rows(self, X: Polynomial, minus: Polynomial, Y: Polynomial) -> Rows:
        """Return the blocks of X, -(N + N') and Y that are to be positive."""
        raise NotImplementedError

    @property
    def under(self) -> str:
        """What moves the signal, in words."""
        raise NotImplementedError

    @property
    def blocks_at_most(self) -> int:
        """Number of inequalities about the loop, of n + q + 1 rows at most."""
        return 2

    @property
    def least_degree(self) -> int:
        """The degree of what is beside X, N and Y."""
        return 2 * varies(self.subject.E)

    @property
    def more_work(self) -> int:
        """Work besides that about the loop."""
        return 0

    # --- the claim -------------------------------------------------------------------------------

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read output, level and evidence, and what the kind has of its own."""
        law = require_law(law, cls.kind)
        plant.require_continuous(table.where)
        if cls.driven and not plant.E:
            raise FormatError(f"{table.where}: the plant has no E: no disturbance acts on it")
        subject = read_subject(table.table("evidence"), plant, law, on)
        below, count = table.table("output"), len(plant.A)
        C = below.rows("C", plant.n, count)
        D = below.rows("D", plant.m, count) if "D" in below else [[[Fraction(0)] * plant.m]] * count
        output = Output(C, D, table.text("name", ""))
        return cls(subject, output, table.number("level"), **cls.read_own(table, subject, output))

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        output = {key: plain_rows(getattr(self.output, key)) for key in "CD"}
        table = {"kind": self.kind, "name": self.output.name, "output": output}
        own = self.write_own()
        output |= own.pop("output", {})
        table |= {"level": plain(self.level)} | own
        return table | {"evidence": write_evidence(self.subject)}

    def statement(self, plant: Plant) -> str:
        """Say what is bounded; the output is written out, for its name is the file's own.

        One that is none of the plant's signals is said to be defined by the file.
        """
        own = self.output
        name = quoted(own.name) if own.name else "an output"
        if plant.signal(own.name) is None:
            name = f"{name} (as the file defines it)"
        what = output_text(own.C, own.D, getattr(self, "F", ()))
        level = digits_up(self.level)
        return f"{self.kind} of {name} = {what} <= {level}{self.under}, on the {self.subject.on}"

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that the output has the name of another signal of the plant."""
        signal, own = plant.signal(self.output.name), self.output
        F = tuple(getattr(self, "F", ()))
        if signal is None or (signal.C, signal.D, signal.F) == (own.C, own.D, F):
            return ""
        return f"the output called {quoted(own.name)} is another of the plant's"

    def require(self) -> None:
        """Refuse what is incomplete, of shapes that do not fit, or out of all proportion."""
        subject = self.subject
        if not subject.A or not subject.A[0] or not subject.B or not subject.B[0]:
            raise FormatError("vertices are missing")
        N, n, m = len(subject.A), subject.n, subject.m
        require_shapes(self.output.C, N, 1, n, "C")
        require_shapes(self.output.D, N, 1, m, "D")
        subject.require()
        for key in ("level", "intensity", "norm"):
            if getattr(self, key, 0) < 0:
                raise FormatError(f"{key} must be zero or more")
        if self.driven and not subject.q:
            raise FormatError("E is missing: no disturbance acts on the loop")
        self.require_own()
        poles = subject.as_poles
        natural = poles.degree(replace(poles.evidence[0], elevation=0))
        count = count_of(
            subject.sizes, max(natural, self.least_degree) + subject.evidence.elevation
        )
        require_work(least_work(count * self.blocks_at_most, n + subject.q + 1) + self.more_work)

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield W and the Lyapunov matrices."""
        families = {"W": self.subject.law.W or [], "Lyapunov matrix": self.subject.evidence.X}
        for name, matrices in families.items():
            for k, matrix in enumerate(matrices):
                yield f"{name} {k + 1}", matrix

    def inequalities(self) -> Iterator[Inequality]:
        """Yield what proves the claim; all that is about its loop is raised to one degree."""
        X, N, Y = self.subject.loop(self.output)
        rows = self.rows(X, (N + N.T).times(-1), Y)
        least = joint([form for blocks in rows.values() for row in blocks for form in row])
        degrees = tuple(degree + self.subject.evidence.elevation for degree in least)
        for name, blocks in rows.items():
            yield Inequality(name, blocks, degrees)


def read_subject(table: Table, plant: Plant, law: Law, on: str) -> Subject:
    """Read the evidence of a claim; of a gain the domain too."""
    if law.fixed:
        on = table.word("on", DOMAINS, "simplex")
    on = plant.domain(on)
    if "own" in table:
        if not law.scheduled or not table.flag("own"):
            raise FormatError(f"{table.path('own')} must be true, and the law scheduled")
        elevation = table.whole("elevation", 0)
        evidence = Evidence([], elevation=elevation, multiple=(table.number("scale", 1),))
    else:
        sizes = sizes_of(len(plant.A), on)
        evidence = read_evidence(table, plant.n, sizes, multiple=law.scheduled)
    return Subject(plant.A, plant.B, plant.E, law, evidence, on)


def write_evidence(subject: Subject) -> dict[str, Any]:
    """Return what `read_subject` reads."""
    evidence, on = subject.evidence, {"on": subject.on} if subject.law.fixed else {}
    if evidence.X:
        return evidence.write() | on
    table: dict[str, Any] = {"own": True}
    if evidence.multiple:
        table["scale"] = plain(evidence.multiple[0])
    return table | {"elevation": evidence.elevation} | on


def noise(E: list[Rationals], intensity: Fraction, sizes: Sizes) -> Polynomial:
    """Return the intensity times E E'."""
    form = affine(E, sizes)
    return (form * form.T).times(intensity)


def varies(matrices: list[Rationals]) -> bool:
    """Whether the matrices are not all the same."""
    return any(matrix != matrices[0] for matrix in matrices)
