"""Bounds on signals of a closed loop: what all kinds of them have in common.

For x' = (A + B K) x + E w, y = C x + D u with one row y, or with some the vector z of several, and
for every alpha of the simplex or the box. With a Lyapunov polynomial X, N = (A + B K) X and
Y = (C + D K) X are polynomials too; what each kind asks of them is from Boyd et al. (1994),
chapters 6 and 10, and Scherer, Gahinet & Chilali (1997); some have a dual form too, with Q(alpha)
about as large as the observability Gramian. Every inequality is a polynomial,
homogeneous in each simplex; it holds if all of its coefficients, times (sum of alpha)^elevation,
are positive definite. All that is about one loop is raised to one degree, the least that they need.

In discrete time all this is of the loop's delta form, (x(t + T) - x(t)) / T = (A + B K) x + E w,
in which -(N + N') loses T N X^-1 N' (in the dual form T N'Q N, both zero as T is), and sums over
samples, times T, are what integrals are: noise of intensity S has a variance of S / T a sample, and
the L2 norm of w is the root of T times the sum of |w|^2.

Disturbances w = diag(s) v have ``scales`` s, zero of one that does not act: E and F are then
E diag(s) and F diag(s), and what is claimed is of v.

Signals may be bounded behind ``filters``; the evidence is then of the loop with these in series.

Of a law u = K (C x + F w), into whose signals disturbances pass, the loop has E + B K F in place of
E, and outputs have F + D K F in place of F: see `Subject.driving` and `Subject.through`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import (
    Claim,
    Inequality,
    Verdict,
    in_cells,
    require_law,
    require_work,
    undecided,
)
from polefence.proof.claims.poles import Poles
from polefence.proof.filters import Filter, Filters, in_series, states_of
from polefence.proof.late import Late
from polefence.proof.laws import (
    DOMAINS,
    MAX_CELLS,
    Evidence,
    Law,
    Piece,
    Point,
    add,
    inner_points,
    lifted,
    on_corners,
    on_part,
    read_cells,
    read_evidence,
    require_continuous,
    used_nodes,
)
from polefence.proof.matrices import MAX_BITS, Rationals, beside, identity, least_work, root_above
from polefence.proof.motion import (
    changes,
    extremes,
    is_late,
    is_moving,
    require_late_cells,
    require_motion,
)
from polefence.proof.pieces import in_pieces, require_pieces
from polefence.proof.plant import Node, Output, Plant, sizes_of, split
from polefence.proof.polynomials import (
    Polynomial,
    Sizes,
    affine,
    below,
    bernstein,
    constant,
    count_of,
    diagonal,
    joint,
    multinomial,
    number,
)
from polefence.proof.ranges import Range, narrowed
from polefence.proof.reading import Table, plain, plain_rows
from polefence.proof.regions import HalfPlane
from polefence.proof.remainder import SHARE, Remainder, Spread
from polefence.proof.short import Short
from polefence.proof.text import (
    digits_down,
    digits_up,
    milliseconds_text,
    output_text,
    quoted,
)
from polefence.proof.transfer import Tensor, Transfer, positive, transfer
from polefence.proof.work import LARGE, MAX_IN_PARTS, FormatError, tell

MAX_ENTRIES = 16  # of a vector of outputs
# The least share for what outputs are off by, see `outputs_share`; half of it is lost of a bound.
OUTPUTS_SHARE = Fraction(1, 2**16)

Rows = dict[str, list[list[Polynomial]]]  # blocks of inequalities, by their names


@dataclass(frozen=True)
class DualLoop(Short):
    """A loop in the dual form: Q, W Q, M = A W + B Z, Q M, W Q M and Y = C W + D Z.

    In continuous time ``step`` is zero.
    """

    Q: Polynomial
    WQ: Polynomial
    M: Polynomial
    QM: Polynomial
    WQM: Polynomial
    Y: Polynomial
    step: Fraction

    @property
    def falling(self) -> Polynomial:
        """Return W Q M + M'Q W + step M'Q M."""
        both = self.WQM + self.WQM.T
        return both + self.M.T.half_times(self.QM).times(self.step) if self.step else both

    def loss(self, spread: Spread, form: Polynomial) -> tuple[Polynomial, Polynomial]:
        """Return what a remainder costs: (1 + step kappa) V'V, and P H, with a law's [W; Z].

        With M off by H Delta V, P H Delta V and its transpose are at most P H H'P' + V'V, with
        P = W Q + step M'Q, and step V'Delta'H'Q H Delta V at most step kappa V'V.
        """
        V = spread.moving(form)
        P = self.WQ + self.QM.T.times(self.step)
        loss = V.T.half_times(V).times(1 + self.step * spread.kappa)
        return loss, P * diagonal(spread.rows, self.Q.sizes)


@dataclass(frozen=True)
class Subject(Short):
    """The loop, and the Lyapunov polynomial X(alpha) with which a claim about it is proved.

    ``E`` (n x q at every vertex) may be empty where no disturbance acts. ``law`` is one K, one K
    at every vertex, or scheduled. ``evidence.X`` holds the coefficients of X, and for a scheduled
    law those of Q in X = W (multiple + Q W), as for the method "lyapunov" of designs; empty: X is
    the law's own W, times ``evidence.multiple`` if that holds one number. Where ``step`` is not
    zero it is the sample time, and A, B, E and the ``remainder`` are those of the delta form.
    ``motion`` holds the parameters where some of them move, on whose box X then is, and ``change``
    at an extreme of their rates dX/dt, or what X changes by in a step.
    """

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    law: Law
    evidence: Evidence
    on: str = "simplex"
    step: Fraction = Fraction(0)
    remainder: Remainder | None = None
    motion: tuple[Range, ...] = ()
    change: Polynomial | None = None
    nodes: tuple[Node, ...] = ()

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

    def loop(self, outputs: Sequence[Output]) -> tuple[Polynomial, Polynomial, Polynomial]:
        """Return X, N = (A + B K) X and Y = (C + D K) X, all of one degree."""
        n, XKX = self.n, self.lifted
        NY = self._plant(outputs) * XKX
        X = XKX.part(slice(n)).raised(NY.degrees)
        return X, NY.part(slice(n)), NY.part(slice(n, None))

    @property
    def motions(self) -> Iterator[tuple[str, Self]]:
        """It at every extreme of the rates, and which that is; as it is where nothing moves."""
        for name, change in changes(self.lifted.part(slice(self.n)), self.motion, self.step):
            yield name, replace(self, change=change)

    def minus(self, N: Polynomial) -> Polynomial:
        """Return -(N + N') + dX/dt, or with what X changes by in a step over the step."""
        falling, slope = (N + N.T).times(-1), self.slope
        return falling if slope is None else falling + slope

    @property
    def slope(self) -> Polynomial | None:
        """dX/dt, or what X changes by in a step over the step."""
        if self.change is None or not self.step:
            return self.change
        return self.change.times(1 / self.step)

    @property
    def lifted(self) -> Polynomial:
        """[X; K X]."""
        return lifted(self.law, self.evidence, self.sizes)

    @property
    def plant_form(self) -> Polynomial:
        """[A, B], with the curve of a remainder."""
        rows = [
            [left + right for left, right in zip(*AB, strict=True)]
            for AB in zip(self.A, self.B, strict=True)
        ]
        both = bernstein(rows, self.sizes, 1, MAX_BITS)
        return both if self.remainder is None else self.remainder.curved(both)

    def _plant(self, outputs: Sequence[Output]) -> Polynomial:
        """Return [A, B; C, D]."""
        C, D = stacked([y.C for y in outputs]), stacked([y.D for y in outputs])
        rows = [
            [left + right for left, right in zip([*A, *c], [*B, *d], strict=True)]
            for A, B, c, d in zip(self.A, self.B, C, D, strict=True)
        ]
        both = bernstein(rows, self.sizes, 1, MAX_BITS)
        curved = self.remainder is not None and self.remainder.curve
        if not curved and not any(y.near for y in outputs):
            return both
        AB, CD = (both.part(rows) for rows in (slice(self.n), slice(self.n, None)))
        AB = AB if self.remainder is None else self.remainder.curved(AB)
        return below(AB, curved_rows(outputs, CD)) if outputs else AB

    def _outputs(self, outputs: Sequence[Output]) -> Polynomial:
        """Return [C, D]."""
        C, D = stacked([y.C for y in outputs]), stacked([y.D for y in outputs])
        both = affine([beside(pair) for pair in zip(C, D, strict=True)], self.sizes)
        return curved_rows(outputs, both)

    @property
    def as_poles(self) -> Poles:
        """A claim of the same loop and evidence about the half-plane Re z < 0."""
        evidence, method = replace(self.evidence, dual=False, spread=None, storage=()), "lyapunov"
        if not evidence.X and self.law.W is not None:
            evidence, method = replace(evidence, multiple=()), "scheduled"
        region = (HalfPlane(Fraction(0)),)
        return Poles(method, self.A, self.B, region, self.law, (evidence,), self.on)

    def falling(
        self, X: Polynomial, N: Polynomial, noise: Polynomial | None = None
    ) -> list[list[Polynomial]]:
        """Return the blocks of -(N + N' + noise + step N X^-1 N'), less what a remainder costs."""
        minus = self.minus(N)
        if noise is not None:
            minus = minus - noise
        return decreasing(minus, X, N, self.step, self.evidence.spread)

    def driving(self, scales: Sequence[Fraction], sizes: Sizes) -> Polynomial:
        """Return E of the loop, with the curve of a remainder, each column times its scale."""
        E = affine(self.E, sizes)
        if self.remainder is not None:
            E = self.remainder.curved(E, self.n + self.m)
        if self.law.F:
            E = E + self.entering(sizes) * self.law.passing(sizes)
        return E * diagonal(scales, sizes) if scales else E

    def through(self, outputs: Sequence[Output], scales: Sequence[Fraction]) -> Polynomial | None:
        """Return F of outputs of the loop, each column times its scale; None where it is zero."""
        none: list[Rationals] = [[[Fraction(0)] * self.q]] * len(self.A)
        total: Polynomial | None = None
        if any(output.F or output.near for output in outputs):
            F = affine(stacked([output.F or none for output in outputs]), self.sizes)
            total = curved_rows(outputs, F, self.n + self.m)
        if self.law.F:
            D = curved_rows(outputs, affine(stacked([y.D for y in outputs]), self.sizes), self.n)
            passed = D * self.law.passing(self.sizes)
            total = passed if total is None else total + passed
        if total is None:
            return None
        total = total * diagonal(scales, self.sizes) if scales else total
        return total if any(any(map(any, M)) for M in total.terms.values()) else None

    def off(self, scales: Sequence[Fraction]) -> tuple[Fraction, ...]:
        """Return d, one a disturbance: a remainder moves E w by H Delta G w with G'G <= diag(d)^2.

        G = diag(columns) [K F; I] diag(scales), whose columns of K F are no longer at any alpha
        than the longest of their coefficients; |sum of q columns|^2 <= q times the sum of squares.
        """
        spread = self.evidence.spread
        if spread is None:
            return ()
        columns = spread.driving(scales, self.q)
        if not self.law.F:
            return columns
        own = spread.columns[self.n : self.n + self.m]
        V = diagonal(own, self.sizes) * self.law.passing(self.sizes)
        V = V * diagonal(scales, self.sizes) if scales else V
        longest = [Fraction(0)] * self.q
        for e, M in V.terms.items():
            whole = V.whole * multinomial(e, V.sizes)
            for k, column in enumerate(zip(*M, strict=True)):
                longest[k] = max(longest[k], Fraction(sum(x * x for x in column), whole**2))
        count = sum(map(bool, longest))
        return tuple(
            root_above(x * x + count * more) if more else x
            for x, more in zip(columns, longest, strict=True)
        )

    def entering(self, sizes: Sizes) -> Polynomial:
        """Return B, with the curve of a remainder."""
        B = affine(self.B, sizes)
        return B if self.remainder is None else self.remainder.curved(B, self.n)

    def dual_loop(self, outputs: Sequence[Output]) -> DualLoop:
        """Return the loop in the dual form; W = I of laws that are no Z W^-1."""
        n, evidence, form = self.n, self.evidence, self.law.form(self.sizes)
        if self.law.K is not None and self.remainder and self.remainder.same_inputs(self.B):
            A = self.remainder.curved(affine(self.A, self.sizes))
            M = A + constant(self.B[0], self.sizes) * form.part(slice(n, None))
            Y = self._outputs(outputs) * form
        else:
            both = self._plant(outputs) * form
            M, Y = both.part(slice(n)), both.part(slice(n, None))
        Q = bernstein(evidence.X, self.sizes, evidence.degree)
        QM = Q * M
        if self.law.K is not None:
            return DualLoop(Q, Q, M, QM, QM, Y, self.step)
        WQ = form.part(slice(n)) * Q
        return DualLoop(Q, WQ, M, QM, WQ * M, Y, self.step)

    @property
    def turning(self) -> Polynomial | None:
        """W of a law Z W^-1; None of other laws."""
        return None if self.law.K is not None else self.law.form(self.sizes).part(slice(self.n))

    def require(self, evidence: Evidence | None = None) -> None:
        """Refuse a plant, a law and evidence that do not fit."""
        if not self.A or not self.A[0] or not self.B or not self.B[0]:
            raise FormatError("vertices are missing")
        N, n, m = len(self.A), self.n, self.m
        require_shapes(self.A, N, n, n, "A")
        require_shapes(self.B, N, n, m, "B")
        if self.q:
            require_shapes(self.E, N, n, self.q, "E")
        proof, law = self.evidence if evidence is None else evidence, self.law
        if proof.transfer:
            proof = self._without_matrices(proof)
        r = len(law.C[0]) if law.C else n
        shapes = ((law.K, m, r, "K"), (law.W, n, n, "W"), (law.Z, m, n, "Z"), (proof.X, n, n, "X"))
        for matrices, rows, columns, where in shapes:
            require_shapes(matrices or [], len(matrices or []), rows, columns, where)
        if law.C:
            require_shapes(list(law.C), N, r, n, "the measured rows")
        require_pieces(proof.pieces, self.sizes)
        if proof.pieces and (proof.dual or proof.cells):
            raise FormatError("pieces belong to one X of the whole box")
        if proof.epsilon:
            raise FormatError("epsilon belongs to designs of the method slack")
        if not proof.X and (proof.degree or len(proof.multiple) > 1):
            raise FormatError("the law's own W has its own degree, and at most one multiple")
        replace(self, evidence=proof).as_poles.require()
        self._require_motion(proof)

    def _without_matrices(self, evidence: Evidence) -> Evidence:
        """Return evidence of the shape that the loop asks for, where the proof needs none."""
        if replace(evidence, transfer=False) != Evidence([]):
            raise FormatError("a proof by the transfer function has no other evidence")
        if self.motion or self.remainder is not None:
            raise FormatError(
                "a proof by the transfer function is for constant parameters, without a remainder"
            )
        if set(self.sizes) != {2} and self.sizes != (1,):
            raise FormatError("a proof by the transfer function is for parameters on a box")
        return Evidence([identity(self.n)])

    def transfer(
        self, outputs: Sequence[Output], scales: Sequence[Fraction], power: int
    ) -> Transfer:
        """Return the transfer function from the disturbances, times their scales, to outputs."""
        n, form = self.n, self.law.form(self.sizes)
        both = self._plant(outputs) * form
        W, N, Y = form.part(slice(n)), both.part(slice(n)), both.part(slice(n, None))
        E, F = self.driving(scales, self.sizes), self.through(outputs, scales)
        return transfer(W, N, Y, E, F, power).bilinear(self.step)

    def _require_motion(self, evidence: Evidence) -> None:
        """Refuse evidence that does not hold while parameters move."""
        if not self.motion:
            return
        if self.step and (self.remainder is not None or evidence.dual):
            raise FormatError("samples with a remainder need constant parameters")
        if evidence.dual and self.law.K is None:
            raise FormatError("Z W^-1 has no dual form while parameters move")
        if evidence.dual:
            Q = bernstein(evidence.X, self.sizes, evidence.degree)
            require_motion(Q, self.motion, self.step)
            return
        X = lifted(self.law, evidence, self.sizes).part(slice(self.n))
        require_motion(X, self.motion, self.step)


def decreasing(
    minus: Polynomial, X: Polynomial, N: Polynomial, step: Fraction, spread: Spread | None
) -> list[list[Polynomial]]:
    """Return the blocks of minus - step N X^-1 N', less what a remainder costs.

    [ -H; 0 ] Delta [ V, -V ] and its transpose are at most [ H H', 0; 0, 0 ] and
    [ V'V, -V'V; -V'V, V'V ].
    """
    last = X.times(1 / step) if step else None
    if spread is not None:
        left = constant(spread.omega, X.sizes)
        minus = minus - constant(spread.entering(), X.sizes) - left
        if last is not None:
            N, last = N + left, last - left
    return [[minus]] if last is None else [[minus, N], [last]]


def stacked(outputs: Sequence[Sequence[Rationals]]) -> list[Rationals]:
    """Return the rows of outputs below one another, at every vertex."""
    return [[row for rows in vertex for row in rows] for vertex in zip(*outputs, strict=True)]


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
class SignalClaim(Short, Claim):
    """An output of the loop, or a vector of them, bounded by ``level``."""

    letters: ClassVar[str] = "ABE"
    driven: ClassVar[bool] = True  # whether it is about a disturbance
    direct: ClassVar[bool] = False  # whether one may pass straight into the output
    has_dual: ClassVar[bool] = False  # whether there is a dual form of its inequalities
    has_cells: ClassVar[bool] = True  # whether it can be proved in parts of the box
    has_transfer: ClassVar[bool] = False  # whether the transfer function can be the proof
    moves: ClassVar[bool] = True
    has_motion: ClassVar[bool] = True  # whether parameters of the plant may move
    has_storage: ClassVar[bool] = False  # whether a storage function can be a part of the proof
    has_filters: ClassVar[bool] = False  # whether the outputs may be bounded behind filters
    has_passing: ClassVar[bool] = False  # whether disturbances may pass into what a law measures
    most: ClassVar[int] = 1  # entries of a vector
    late_as: ClassVar[str | None] = None  # with a dead time it is as one of "gain" or "rms"
    along_motions: ClassVar[bool] = False  # whether its dual form holds while parameters move

    subject: Subject
    outputs: tuple[Output, ...]
    level: Fraction
    scales: tuple[Fraction, ...] = field(default=(), kw_only=True)
    filters: Filters = field(default=(), kw_only=True)  # one an output; none where none has one

    # --- what each kind has of its own -----------------------------------------------------------

    @classmethod
    def read_extra(
        cls,
        table: Table,  # noqa: ARG003
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read the fields of this kind."""
        return {}

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        return {}

    def require_extra(self) -> None:
        """Refuse fields of this kind that do not fit."""

    def rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return the blocks of X, N and Y that are to be positive."""
        raise NotImplementedError

    def remainder_rows(self, spread: Spread) -> Rows:
        """Return that Omega of a remainder is enough, for all that is moved."""
        return {"of the remainder": spread.bounding(spread.moving(self.subject.lifted))}

    def dual_rows(self) -> Rows:
        """Return the blocks of the dual form, Q > 0 aside, or those of what is held.

        They imply Q A + A'Q + step A'Q A < 0 on all of a connected domain. Q is positive definite
        everywhere if it is at one vertex, that of its first coefficient: where it first had a null
        vector v, v'Q A v would be zero, and v'A'Q A v not negative.
        """
        raise NotImplementedError

    @property
    def least_square(self) -> Fraction | None:
        """What the square of the level must exceed, where nothing else depends on the level."""
        return None

    def transfer(self) -> Transfer:
        """Return the transfer function from the disturbances as they are scaled to the outputs."""
        return self.subject.transfer(self.outputs, self.scales, self.power)

    @property
    def power(self) -> int:
        """Degree of what is to be positive in the coefficients of the transfer function."""
        return self.subject.n + 1 + bool(self.subject.step)  # of a variance

    def polynomials(self, loop: Transfer) -> Iterator[tuple[str, Tensor]]:
        """Yield what is to be positive of the transfer function, with its name."""
        raise NotImplementedError

    def value(self, loop: Transfer) -> Fraction | None:  # noqa: ARG002
        """Return the square of what is bounded, exactly, at the first node; None of some kinds."""
        return None

    @property
    def under(self) -> str:
        """The motion that the bound is about, in words."""
        raise NotImplementedError

    @property
    def acting(self) -> Sequence[int]:
        """Numbers of the disturbances that act."""
        scales = self.scales
        return [k for k in range(self.subject.q) if not scales or scales[k]]

    @property
    def blocks_at_most(self) -> int:
        """Number of inequalities about the loop, of so many rows as `largest` at most."""
        return 2

    @property
    def largest(self) -> int:
        """Rows of the largest inequality about the loop, or somewhat more."""
        n = self.subject.n
        return (2 * n if self.subject.step else n) + self.subject.q + 1

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
        if cls.driven and not plant.E:
            raise FormatError(f"{table.where}: the plant has no E: no disturbance acts on it")
        outputs = cls._read_outputs(table, plant)
        filters = read_filters(table, len(outputs)) if cls.has_filters else ()
        subject = read_subject(table.table("evidence"), plant, law, on, states_of(filters))
        level = table.number("level")
        scales = cls.driven and "disturbances" in table
        whole = in_series(subject, outputs, filters) if filters else (subject, outputs)
        return cls(
            subject,
            outputs,
            level,
            scales=table.numbers("disturbances", plant.q) if scales else (),
            filters=filters,
            **cls.read_extra(table, *whole),
        )

    @property
    def inner_points(self) -> list[Point]:
        """Corners of the parts of the box that it is proved in, but those of the box."""
        return inner_points([self.subject.evidence], self.subject.remainder)

    @classmethod
    def _read_outputs(cls, table: Table, plant: Plant) -> tuple[Output, ...]:
        """Read one output with its name, or a list of them, each with its own."""
        if cls.most > 1 and "outputs" in table:
            return read_outputs(table, plant, cls.most)
        return (_read_output(table.table("output"), plant, table),)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind}
        if len(self.outputs) == 1:
            table |= {"name": self.outputs[0].name, "output": _rows_of(self.outputs[0])}
        else:
            table |= write_outputs(self.outputs)
        if self.filters:
            table["filters"] = [
                {} if applied is None else applied.write() for applied in self.filters
            ]
        table |= {"level": plain(self.level)} | self.write_extra()
        table |= {"disturbances": plain(self.scales)} if self.scales else {}
        return table | {"evidence": write_evidence(self.subject)}

    def statement(self, plant: Plant) -> str:
        """Say what is bounded; outputs are written out, for their names are the file's own.

        One that is none of the plant's signals is said to be defined by the file.
        """
        what, acting = outputs_text(self.outputs, plant, self.filters), self.acting_words(plant)
        level, on = digits_up(self.level), f"{self.time_text}, on the {self.subject.on}"
        return f"{self.kind} of {what} <= {level}{self.under}{acting}{on}"

    def named(self, plant: Plant) -> str:  # noqa: ARG002
        """Say in a few words what is bounded, by the names that the file has."""
        return f"{self.kind} of {', '.join(self.names)}"

    @property
    def worst_text(self) -> str:
        """Say what it is at worst, without its unit."""
        return f"at most {digits_up(self.level)}"

    @property
    def time_text(self) -> str:
        """At which times the bound holds, where that is not at all of them."""
        step = self.subject.step
        return f", at samples every {milliseconds_text(step)} ms" if step else ""

    def acting_words(self, plant: Plant) -> str:
        """Say which disturbances act, and how much of each."""
        return acting_text(self.scales, plant, self.scale_text)

    def scale_text(self, scale: Fraction) -> str:
        """Return how much of a disturbance acts, rounded down: less moves the signal less."""
        return digits_down(scale)

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that an output has the name of another signal of the plant."""
        return misnamed(self.outputs, plant)

    def require_late(self, late: Late) -> None:
        """Refuse what does not hold for the dead time itself: see `proof.dead_time`."""
        if self.late_as is None or self.subject.evidence.transfer:
            super().require_late(late)
        m, q, law = self.subject.m, self.subject.q, self.subject.law
        late.require_law(law, self.subject.sizes, m, q)
        late.require_outputs(self.outputs, m, q)
        if self.late_as == "gain":
            return
        # of the dual loop, whose impulse enters by the output
        rows = [rows for y in self.outputs for rows in (y.C, y.D)]
        dual = any(item.dual for item in self.subject.evidence.per_cell)
        if dual or not all(map(late.alike, (*rows, *([law.C] if law.C else [])))):
            raise FormatError(
                f"{self.kind}: with a dead time it is proved by X, of what is not late itself"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """The outputs' names, with the filters that they are behind."""
        filters = self.filters or (None,) * len(self.outputs)
        return tuple(
            quoted(output.name) + ("" if behind is None else f" ({behind.name})")
            for output, behind in zip(self.outputs, filters, strict=True)
        )

    @property
    def filtered(self) -> bool:
        """Whether the evidence is of a larger loop than the subject: of ``series``."""
        return bool(self.filters)

    @property
    def series(self) -> Self:
        """The same claim about the loop with its filters, which has none."""
        if not self.filters:
            return self
        subject, outputs = in_series(self.subject, self.outputs, self.filters)
        return replace(self, subject=subject, outputs=outputs, filters=())

    def require(self) -> None:
        """Refuse what is incomplete, of shapes that do not fit, or out of all proportion."""
        if self.filtered:
            self.series.require()
            return
        evidence = self.subject.evidence
        if is_late(self.subject.motion):
            require_late_cells(self.subject.motion, evidence.cells)
        elif self.subject.motion and evidence.cells:
            if self.subject.step or self.subject.law.K is None:
                raise FormatError("cells: moving parameters need one X for the whole box")
            require_continuous(evidence.cells, self.subject.motion)
        pieces = [self._with(evidence.cells[0])] if evidence.cells else [self]
        pieces[0]._require_parts()
        evidence.require_cells(self.subject.sizes)
        if evidence.cells:
            pieces = [self.inside(piece) for piece in evidence.cells]
        for claim in pieces:
            claim._require_parts()
        require_work(sum(claim.least for claim in pieces), self.allowed)

    @property
    def whole_work(self) -> int:
        """About what it takes to prove it, at least, in all parts of the box."""
        if self.filtered:
            return self.series.whole_work
        cells = self.subject.evidence.cells
        return sum(self.inside(piece).least for piece in cells) if cells else self.least

    def _with(self, piece: Piece) -> Self:
        rest = self.subject.remainder
        rest = rest and rest.inside_alone(piece.low, piece.high)
        return replace(
            self, subject=replace(self.subject, evidence=piece.evidence, remainder=rest, nodes=())
        )

    def _require_parts(self) -> None:
        subject = self.subject
        if not subject.A or not subject.A[0] or not subject.B or not subject.B[0]:
            raise FormatError("vertices are missing")
        N, n, m = len(subject.A), subject.n, subject.m
        if not 1 <= len(self.outputs) <= self.most:
            raise FormatError(f"a bound on {self.kind} is of 1 to {self.most} outputs")
        for output in self.outputs:
            require_shapes(output.C, N, 1, n, "C")
            require_shapes(output.D, N, 1, m, "D")
            if output.F:
                require_shapes(list(output.F), N, 1, subject.q, "F")
        subject.require()
        evidence = subject.evidence
        self._require_remainder()
        if subject.motion and evidence.dual and not self.along_motions:
            raise FormatError(f"{self.kind}: parameters that move need X, not a dual form")
        if subject.motion and not self.has_motion:
            raise FormatError(f"{self.kind} bounds are proved for constant parameters only")
        if evidence.transfer and not self.has_transfer:
            raise FormatError(f"a bound on {self.kind} is not proved by the transfer function")
        if evidence.dual and (not self.has_dual or evidence.multiple or not evidence.X):
            raise FormatError(f"a bound on {self.kind} has no dual form of this kind")
        self._require_passing()
        if evidence.storage and not self.has_storage:
            raise FormatError(f"a bound on {self.kind} has no storage function")
        for key in ("level", "intensity", "norm"):
            if getattr(self, key, 0) < 0:
                raise FormatError(f"{key} must be zero or more")
        if self.driven and not subject.q:
            raise FormatError("E is missing: no disturbance acts on the loop")
        self.require_extra()
        self._require_disturbances()

    def _require_passing(self) -> None:
        """Refuse a law into whose signals disturbances pass, where it is not provided for."""
        subject = self.subject
        if not subject.law.F:
            return
        N, r = len(subject.A), len(subject.law.C[0])
        require_shapes(list(subject.law.F), N, r, subject.q, "F of what is measured")
        if not self.has_passing:
            raise FormatError(
                "law.measured: a disturbance passes straight into what is measured; no bound on "
                f"{self.kind} of this kind is proved with that"
            )

    def _require_remainder(self) -> None:
        loop, spread = self.subject, self.subject.evidence.spread
        if (spread is None) != (loop.remainder is None):
            raise FormatError("a remainder has evidence of its own")
        if loop.remainder is None or spread is None:
            return
        loop.remainder.require(loop.n, loop.m, loop.q, loop.sizes)
        dual = loop.evidence.dual
        spread.require(loop.remainder, omega=not dual, kappa=dual)

    @property
    def allowed(self) -> int | None:
        """The most work that it may take: more in parts of the box, and of large plants."""
        large = any(len(A) > LARGE for A in self.subject.A[:1])
        more = large or self.subject.evidence.cells
        return MAX_IN_PARTS if more else None

    @property
    def least(self) -> int:
        """The least that it takes to prove without cells, whatever its numbers."""
        subject, law, evidence = self.subject, self.subject.law, self.subject.evidence
        if evidence.transfer:  # what it takes is counted as it is done
            return 0
        poles = subject.as_poles
        more = 0 if subject.remainder is None else subject.remainder.degree - 1
        degrees = [poles.degree(replace(poles.evidence[0], elevation=0)) + more, self.least_degree]
        if evidence.dual:  # of Y'Y, and Q E E'Q
            degrees = [degrees[0], 2 * (law.form_degree + 1)]
        count = count_of(subject.sizes, max(degrees) + evidence.elevation) * math.prod(
            evidence.pieces
        )
        moving = extremes(subject.motion, subject.step) - 1 if evidence.degree else 0
        return least_work(count * (self.blocks_at_most + moving), self.largest) + self.more_work

    def _require_disturbances(self) -> None:
        """Refuse scales that do not fit, and noise that is in the output itself."""
        require_scales(self.scales, self.subject.q)
        if self.direct:
            return
        acts = tuple(Fraction(k in self.acting) for k in range(self.subject.q))
        if self.subject.through(self.outputs, acts) is not None:
            raise FormatError(f"F: a disturbance passes straight into the output of {self.kind}")

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield W and the Lyapunov matrices."""
        evidence = self.subject.evidence
        families = {
            "W": self.subject.law.W or [],
            "Lyapunov matrix": [X for whole in evidence.per_cell for X in whole.X],
            "storage": [S for whole in evidence.per_cell for s in whole.storage for S in s.form],
        }
        for name, matrices in families.items():
            for k, matrix in enumerate(matrices):
                yield f"{name} {k + 1}", matrix

    def inequalities(self) -> Iterator[Inequality]:
        """Yield what proves the claim; all that is about its loop is raised to one degree."""
        if self.filtered:
            yield from self.series.inequalities()
            return
        for k, piece in enumerate(self.subject.evidence.cells):
            for inequality in self.inside(piece).inequalities():
                yield replace(inequality, piece=f", cell {k + 1}")
        if not self.subject.evidence.cells:
            yield from self._of_loop()

    def decided(self) -> Verdict:
        """Prove it; cells must make up the box."""
        if self.filtered:
            return self.series.decided()
        if self.subject.evidence.transfer:
            return self._by_transfer()
        return in_cells([self.subject.evidence], super().decided)

    def _by_transfer(self) -> Verdict:
        """Prove it by the transfer function."""
        loop, parts = self.transfer(), 0
        if not loop.is_stable:
            return undecided("the loop is not stable at the first vertex")
        for k, (name, coefficients) in enumerate(self.polynomials(loop)):
            tell(k + 1)
            answer = positive(coefficients)
            if not answer.proved:
                return undecided(f"the polynomial {name} is not positive everywhere")
            parts += answer.parts
        note = f"polynomials of the transfer function positive in {parts} parts, exactly"
        return Verdict("proved", note, parts, note=note)

    @property
    def bare(self) -> Self:
        """What is claimed, without what proves it."""
        return replace(self, subject=replace(self.subject, evidence=Evidence([])))

    def inside(self, piece: Piece) -> Self:
        """Return the claim about a part of the box."""
        loop, low, high = self.subject, piece.low, piece.high
        if not self.has_cells:
            raise FormatError(f"cells: a bound on {self.kind} has none here")
        law = loop.law.inside(low, high)
        vertices = (loop.A, loop.B, loop.E)
        (A, B, E), remainder = on_part(vertices, loop.nodes, loop.remainder, low, high)
        subject = replace(loop, A=A, B=B, E=E, law=law, evidence=piece.evidence)
        motion = tuple(map(narrowed, loop.motion, low, high)) if loop.motion else ()
        subject = replace(subject, remainder=remainder, nodes=(), motion=motion)
        outputs = tuple(_inside(y, low, high, loop.q) for y in self.outputs)
        return replace(self, subject=subject, outputs=outputs)

    @property
    def widened(self) -> Self:
        """The same claim with what the outputs are off by as outputs behind them.

        With z off by d, |d_j| <= sum e_jk |v_k| of v = [x; u; w], |z + d|^2 is at most
        (1 + s) |z|^2 + (1 + 1/s) |d|^2, of which the last is a sum of squares of all v_k.
        """
        off = [y.near.entries[0] for y in self.outputs if y.near is not None]
        if not any(map(any, off)):
            return self
        subject, share = self.subject, outputs_share(self.outputs)
        outputs = [_times(y, 1 + share) for y in self.outputs]
        squares = [(1 + 1 / share) * total for total in _sums_of_squares(off)]
        for k, square in enumerate(squares):
            if square:
                outputs.append(_alone(subject, k, root_above(square)))
        return replace(self, outputs=tuple(outputs))

    def _of_loop(self) -> Iterator[Inequality]:
        widened = self.widened
        if widened is not self:
            yield from widened._of_loop()
            return
        evidence, sizes = self.subject.evidence, self.subject.sizes
        if evidence.dual or evidence.storage:
            letter = "Q" if evidence.dual else "X"
            Q = {f"of {letter} at vertex 1": [[constant(evidence.X[0], sizes)]]}
            for name, blocks in (Q | self._moving_dual_rows()).items():
                yield Inequality.raised(name, blocks, evidence.elevation)
            return
        X, N, Y = self.subject.loop(self.outputs)
        rows = self._moving_rows(X, N, Y)
        if evidence.spread is not None:
            rows |= self.remainder_rows(evidence.spread)
        least = joint([form for blocks in rows.values() for row in blocks for form in row])
        degrees = tuple(degree + evidence.elevation for degree in least)
        for name, blocks in rows.items():
            yield from in_pieces(Inequality(name, blocks, degrees), evidence.pieces)

    def _moving_dual_rows(self) -> Rows:
        """Return the rows of the dual form at every extreme of the rates."""
        subject, rows = self.subject, Rows()
        Q = bernstein(subject.evidence.X, subject.sizes, subject.evidence.degree)
        for name, change in changes(Q, subject.motion, subject.step):
            moved = replace(self, subject=replace(subject, change=change))
            rows |= {f"{key}{name}": blocks for key, blocks in moved.dual_rows().items()}
        return rows

    def _moving_rows(self, X: Polynomial, N: Polynomial, Y: Polynomial) -> Rows:
        """Return the rows at every extreme of the rates, those that are the same once."""
        rows: Rows = {}
        for name, moved in self.subject.motions:
            for key, blocks in replace(self, subject=moved).rows(X, N, Y).items():
                if blocks not in rows.values():
                    rows[f"{key}{name}"] = blocks
        return rows


def read_subject(table: Table, plant: Plant, law: Law, on: str, more: int = 0) -> Subject:
    """Read the evidence of a claim, of so many more states; of a gain the domain too."""
    if law.fixed:
        on = table.word("on", DOMAINS, "simplex")
    on, step, plant = plant.domain(on), plant.step, plant.in_differences
    motion = plant.ranges if is_moving(plant.ranges) else ()
    if "transfer" in table:
        if not table.flag("transfer"):
            raise FormatError(f"{table.path('transfer')} must be true")
        evidence = Evidence([], transfer=True)
    elif "own" in table:
        if not law.scheduled or not table.flag("own"):
            raise FormatError(f"{table.path('own')} must be true, and the law scheduled")
        elevation = table.whole("elevation", 0)
        evidence = Evidence([], elevation=elevation, multiple=(table.number("scale", 1),))
    else:
        sizes = sizes_of(len(plant.A), on)
        cells = table.tables("cells", MAX_CELLS) if "cells" in table else []
        dual = "Q" in (cells[0] if cells else table)
        if cells:
            evidence = read_cells(table, plant.n + more, sizes, dual, law.scheduled and not dual)
            subject = Subject(plant.A, plant.B, plant.E, law, evidence, on, step, plant.remainder)
            return replace(subject, motion=motion, nodes=used_nodes(plant, [evidence]))
        letter = "Q" if dual else "X"
        multiple = law.scheduled and not dual
        evidence = read_evidence(table, plant.n + more, sizes, letter, multiple=multiple)
        evidence = replace(evidence, dual=dual)
    return Subject(plant.A, plant.B, plant.E, law, evidence, on, step, plant.remainder, motion)


def write_evidence(subject: Subject) -> dict[str, Any]:
    """Return what `read_subject` reads."""
    evidence, on = subject.evidence, {"on": subject.on} if subject.law.fixed else {}
    if evidence.X or evidence.cells or evidence.transfer:
        return evidence.write() | on
    table: dict[str, Any] = {"own": True}
    if evidence.multiple:
        table["scale"] = plain(evidence.multiple[0])
    return table | {"elevation": evidence.elevation} | on


def bounded(corner: Polynomial, X: Polynomial, Y: Polynomial) -> list[list[Polynomial]]:
    """Return [ corner, Y_1, ..., Y_p; Y_1', X, 0; ...; Y_p', 0, X ], Y_j the rows of Y.

    It is positive if X is, and the sum of Y_j X^-1 Y_j' is less than the corner.
    """
    p, n = Y.shape
    none = constant([[Fraction(0)] * n for _ in range(n)], X.sizes)
    first = [corner, *(Y.part(slice(j, j + 1)) for j in range(p))]
    return [first, *([X] + [none] * (p - 1 - j) for j in range(p))]


def read_outputs(table: Table, plant: Plant, most: int) -> tuple[Output, ...]:
    """Read a list of outputs with their names."""
    return tuple(_read_output(row, plant, row) for row in table.tables("outputs", most))


def _read_output(table: Table, plant: Plant, named: Table) -> Output:
    count = len(plant.A)
    C = table.rows("C", plant.n, count)
    D = table.rows("D", plant.m, count) if "D" in table else [[[Fraction(0)] * plant.m]] * count
    F = table.rows("F", plant.q, count) if "F" in table else []
    driven = tuple(F) if any(any(f[0]) for f in F) else ()
    output = Output(C, D, named.text("name", ""), driven)
    signal = plant.signal(output.name)
    # one of the plant's own has the functions that this one has
    return output if signal is None else replace(output, near=signal.near)


def write_outputs(outputs: Sequence[Output]) -> dict[str, Any]:
    """Return what `read_outputs` reads."""
    return {"outputs": [{"name": output.name} | _rows_of(output) for output in outputs]}


def _rows_of(output: Output) -> dict[str, Any]:
    return {key: plain_rows(getattr(output, key)) for key in "CDF" if getattr(output, key)}


def curved_rows(outputs: Sequence[Output], rows: Polynomial, first: int = 0) -> Polynomial:
    """Return rows of outputs, a row each, with what is added to the combination of the vertices.

    Parameters
    ----------
    first : int
        Which column of [C, D, F] is their first.
    """
    if not any(y.near is not None and y.near.curve for y in outputs):
        return rows
    curved = list[Polynomial]()
    for k, output in enumerate(outputs):
        row = rows.part(slice(k, k + 1))
        curved.append(row if output.near is None else output.near.curved(row, first))
    total = curved[0]
    for row in curved[1:]:
        total = below(total, row)
    return total


def _inside(output: Output, low: Point, high: Point, q: int) -> Output:
    """Return an output on a part of the box."""
    C, D = (on_corners(rows, low, high) for rows in (output.C, output.D))
    F = on_corners(list(output.F), low, high) if output.F else []
    near = output.near
    if near is None:
        return replace(output, C=C, D=D, F=tuple(F))
    F = F or [[[Fraction(0)] * q]] * len(C)
    n, m = len(C[0][0]), len(D[0][0])
    C, D, F = (
        list(map(add, rows, more))
        for rows, more in zip((C, D, F), near.added(low, high, (n, m, q)), strict=True)
    )
    driven = tuple(F) if any(any(f[0]) for f in F) else ()
    return replace(output, C=C, D=D, F=driven, near=near.inside(low, high))


def _times(output: Output, factor: Fraction) -> Output:
    """Return more than the root of a factor times an output, which is exact."""
    root = root_above(factor)
    C, D, F = (
        [[[root * x for x in row] for row in M] for M in rows]
        for rows in (output.C, output.D, output.F)
    )
    near = output.near and output.near.mapped(
        lambda M: tuple(tuple(root * x for x in row) for row in M)
    )
    return replace(output, C=C, D=D, F=tuple(F), near=near and replace(near, entries=_none(near)))


def outputs_share(outputs: Sequence[Output]) -> Fraction:
    """Return s of `SignalClaim.widened`: about what entries are off by, as share of their size."""
    ratios = [OUTPUTS_SHARE]
    for y in outputs:
        if y.near is not None:
            rows = [[*c[0], *d[0]] for c, d in zip(y.C, y.D, strict=True)]
            sizes = [max(map(abs, column)) for column in zip(*rows, strict=True)]
            off = zip(y.near.entries[0], sizes, strict=False)
            ratios += [e / size for e, size in off if size]
    share = max(ratios)
    # the least power of two that is no less, and at most one
    bits = share.numerator.bit_length() - share.denominator.bit_length() - 1
    while Fraction(2) ** bits < share:
        bits += 1
    return min(Fraction(2) ** bits, Fraction(1))


def _none(near: Remainder) -> tuple[tuple[Fraction, ...], ...]:
    return tuple((Fraction(0),) * len(row) for row in near.entries)


def _sums_of_squares(off: Sequence[Sequence[Fraction]]) -> list[Fraction]:
    """Return c of sum_j (sum_k e_jk |v_k|)^2 <= sum_k c_k v_k^2: of r columns r sum_j e_jk^2."""
    size = [max(column) for column in zip(*off, strict=True)]
    count = sum(map(bool, size))
    return [count * sum((row[k] ** 2 for row in off), Fraction(0)) for k in range(len(size))]


def _alone(subject: Subject, k: int, factor: Fraction) -> Output:
    """Return so many times the k-th of the states, inputs and disturbances as an output."""
    n, m, q = subject.n, subject.m, subject.q
    row = [factor if j == k else Fraction(0) for j in range(n + m + q)]
    count = len(subject.A)
    driven = row[n + m :]
    F = ([[driven]] * count) if any(driven) else []
    return Output([[row[:n]]] * count, [[row[n : n + m]]] * count, "", tuple(F))


def misnamed(outputs: Sequence[Output], plant: Plant) -> str:
    """Say that an output has the name of another signal of the plant; "" where none has."""
    for output in outputs:
        signal = plant.signal(output.name)
        if signal and signal.rows != output.rows:
            return f"the output called {quoted(output.name)} is another of the plant's"
    return ""


def require_scales(scales: Sequence[Fraction], q: int) -> None:
    """Refuse scales of disturbances that do not fit, are negative, or let none act."""
    if scales and (len(scales) != q or min(scales) < 0 or not any(scales)):
        raise FormatError(f"disturbances must hold {q} numbers, zero or more, not all zero")


def acting_text(
    scales: Sequence[Fraction], plant: Plant, text: Callable[[Fraction], str] = digits_down
) -> str:
    """Say which disturbances act, and how much of each."""
    said, labels = [], plant.disturbances
    for k, scale in enumerate(scales):
        if scale:
            name = f"{quoted(split(labels[k])[0])} = " if k < len(labels) else ""
            times = "" if scale == 1 else f" times {text(scale)}"
            said.append(f"{name}w{k + 1}{times}")
    alone = "" if all(scales) else " alone"
    return f" from {' and '.join(said)}{alone}" if said or scales else ""


def read_filters(table: Table, count: int) -> Filters:
    """Read a filter for each output, an empty table for one without."""
    if "filters" not in table:
        return ()
    rows = table.tables("filters", count)
    if len(rows) != count:
        raise FormatError(f"{table.path('filters')} holds {len(rows)} filters of {count} outputs")
    filters = tuple(Filter.read(row) if row.entries else None for row in rows)
    return filters if any(filters) else ()


def outputs_text(outputs: Sequence[Output], plant: Plant, filters: Filters = ()) -> str:
    """Say what an output is, or each entry of a vector, and what filter is behind it."""
    named = [_output_words(output, plant) for output in outputs]
    for k, output in enumerate(filters):
        if output is not None:
            named[k] += f" behind the filter {quoted(output.name)} (as the file defines it)"
    return named[0] if len(named) == 1 else f"[{', '.join(named)}]"


def _output_words(output: Output, plant: Plant) -> str:
    name = quoted(output.name) if output.name else "an output"
    if plant.signal(output.name) is None:
        name = f"{name} (as the file defines it)"
    source = None if output.near is None else output.near.source
    names = [] if source is None else source.names
    bent = f", by functions of {' and '.join(names)} between" if names else ""
    return f"{name} = {output_text(output.C, output.D, output.F)}{bent}"


def scaled(matrices: Sequence[Rationals], scales: Sequence[Fraction], sizes: Sizes) -> Polynomial:
    """Return E, or F, times the diagonal matrix of the scales; as it is where there are none."""
    form = affine(matrices, sizes)
    return form * diagonal(scales, sizes) if scales else form


def noise(
    E: list[Rationals], intensity: Fraction, sizes: Sizes, scales: Sequence[Fraction] = ()
) -> Polynomial:
    """Return the intensity times E E', each column of E times its scale."""
    form = scaled(E, scales, sizes)
    return form.half_times(form.T).times(intensity)


def moving(
    subject: Subject, scales: Sequence[Fraction], sizes: Sizes, intensity: Fraction = Fraction(1)
) -> Polynomial:
    """Return the intensity times E E', or more where E is only near that of the vertices."""
    E = subject.driving(scales, sizes)
    square, spread = E.half_times(E.T).times(intensity), subject.evidence.spread
    most = max(subject.off(scales), default=0)
    if spread is None or not most:
        return square
    more = spread.entering((1 + 1 / SHARE) * intensity * most**2)
    return square.times(1 + SHARE) + constant(more, sizes)


def dual_of_noise(
    claim: SignalClaim,
    square: Polynomial,
    intensity: Fraction,
    energy: Polynomial | None = None,
    driven: Callable[[Polynomial], Polynomial] | None = None,
) -> Rows:
    """Return that Q is more than the observability Gramian, and intensity tr E'QE < the square.

    Parameters
    ----------
    energy : Polynomial, optional
        In place of Y'Y.
    driven : callable, optional
        From Q to what is in place of intensity tr E'QE.
    """
    loop = claim.subject.dual_loop(claim.outputs)
    Q, Y, spread = loop.Q, loop.Y, claim.subject.evidence.spread
    inner = -(loop.falling + (Y.T.half_times(Y) if energy is None else energy))
    moved = _driven(claim, Q, intensity) if driven is None else driven(Q)
    noise: Rows = {"of the noise": [[square - moved]]}
    if spread is None:
        return {"of the output": [[inner]]} | noise
    bordered = with_remainder(inner, loop, spread, claim.subject.law.form(Q.sizes))
    return {"of the output": bordered} | noise | below_kappa(Q, spread)


def with_remainder(
    inner: Polynomial, loop: DualLoop, spread: Spread, form: Polynomial
) -> list[list[Polynomial]]:
    """Return the blocks of an inequality of the dual form, less what a remainder costs."""
    loss, PH = loop.loss(spread, form)
    return [[inner - loss, PH], [constant(identity(inner.shape[0]), inner.sizes)]]


def _driven(claim: SignalClaim, Q: Polynomial, intensity: Fraction) -> Polynomial:
    """Return intensity tr E'QE, or more where E is only near that of the vertices."""
    E, spread = claim.subject.driving(claim.scales, Q.sizes), claim.subject.evidence.spread
    total = (E.T * Q).inner(E.T).times(intensity)
    driving = [] if spread is None else claim.subject.off(claim.scales)
    for k, off in enumerate(driving):
        if spread is not None and off:
            column = E.part(slice(None), slice(k, k + 1))
            more = (column.T * Q * column).times(SHARE * intensity)
            most = (1 + 1 / SHARE) * intensity * spread.kappa * off**2
            total = total + more + number(most, Q.sizes)
    return total


def most_noise(claim: SignalClaim, intensity: Fraction) -> Fraction | None:
    """Return what the square of the level must exceed in `dual_of_noise`; None of other forms."""
    series = claim.series
    evidence, sizes = series.subject.evidence, series.subject.sizes
    if not evidence.dual or evidence.cells:
        return None
    Q = bernstein(evidence.X, sizes, evidence.degree)
    return largest_coefficient(_driven(series, Q, intensity), evidence.elevation)


def largest_coefficient(P: Polynomial, elevation: int) -> Fraction:
    """Return the largest Bernstein coefficient of a polynomial of one entry, zero at least."""
    P = P.elevated(elevation)
    values = (Fraction(M[0][0], P.whole * multinomial(e, P.sizes)) for e, M in P.terms.items())
    return max(Fraction(0), *values)


def below_kappa(Q: Polynomial, spread: Spread) -> Rows:
    """Return that kappa is more than H'Q H."""
    H = diagonal(spread.rows, Q.sizes)
    return {"of kappa": [[diagonal([spread.kappa] * Q.shape[0], Q.sizes) - H * Q * H]]}


def varies(matrices: list[Rationals]) -> bool:
    """Whether the matrices are not all the same."""
    return any(matrix != matrices[0] for matrix in matrices)
