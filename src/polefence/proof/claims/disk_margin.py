"""Disk margins of loops: gain and phase of several loops may vary at once, each in a disk.

A loop is opened at an input u_i, or at a signal y_j that the law measures: what arrives there is f
times what was sent, f = (1 + (1 - s) d / 2) / (1 - (1 + s) d / 2) with a skew s and |d| < alpha.
With w = (f - 1) u_i and the sensitivity S from what is added at the loops to what arrives there, d
acts on M = S + (s - 1) / 2. The loops stay stable for all such d, also for ones that vary in time
or with frequency, if the gain of D M D^-1 is at most 1 / alpha for a diagonal D > 0 (Seiler,
Packard & Gahinet, IEEE Control Systems 40(5), 2020).

So this is a gain: of the plant whose disturbances are those at the loops, B's columns or a column
of what the law reads, and whose outputs are what arrives there, less (1 - s) / 2 of it.

Where d does not vary in time, entries of D may be leads, d_k (s + a_k) / (s + b_k): stable, and so
are their inverses, and each commutes with what is in its loop alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
)
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    Subject,
    misnamed,
    outputs_text,
    read_filters,
    read_outputs,
    read_subject,
    write_evidence,
    write_outputs,
)
from polefence.proof.filters import Filter, Filters, before, in_series, in_turn, states_of
from polefence.proof.late import Late
from polefence.proof.laws import (
    DOMAINS,
    MAX_MEASURED,
    Evidence,
    Law,
    Lead,
    Piece,
    read_leads,
    write_leads,
)
from polefence.proof.matrices import ONE, ZERO, Rationals, identity
from polefence.proof.plant import WITHOUT, Node, Output, Plant, split
from polefence.proof.reading import Table, plain
from polefence.proof.remainder import Remainder, Rows
from polefence.proof.short import Short
from polefence.proof.text import digits_down, number_text, quoted
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Path(Short):
    """A loop that no model has: from an output of the plant to one of its disturbances.

    Attributes
    ----------
    output : Output
    disturbance : int
        Its number, from 0.
    """

    output: Output
    disturbance: int


@dataclass(frozen=True)
class Loops(Short):
    """Where loops are opened, and how what is added there is weighed.

    Attributes
    ----------
    inputs : tuple of int
        Numbers of inputs, from 0.
    measured : tuple of int
        Numbers of what the law measures, from 0; their loops come after those of the inputs.
    skew : Fraction
        s: 0 of a disk that is balanced, 1 of S alone, -1 of T = S - 1.
    weights : tuple of Fraction
        The diagonal of D, one a loop.
    through : tuple
        At each vertex, by how much inputs pass into each signal that the law measures (r x m), and
        that the code takes off again by what it sent; empty where none does.
    own : int
        How many disturbances of the plant itself act besides, before those at the loops.
    demands : tuple of int
        Numbers of states that are filters of what is sent: what is added at inputs is not in them.
    paths : tuple of Path
        Loops that are not of the law; they come last.
    leads : tuple of pairs
        a and b of each loop's lead, alike of one without; empty where no loop has one.
    """

    inputs: tuple[int, ...]
    measured: tuple[int, ...] = ()
    skew: Fraction = ZERO
    weights: tuple[Fraction, ...] = ()
    through: tuple[tuple[tuple[Fraction, ...], ...], ...] = ()
    own: int = 0
    demands: tuple[int, ...] = ()
    leads: tuple[Lead, ...] = ()
    paths: tuple[Path, ...] = ()

    @property
    def count(self) -> int:
        """How many loops there are."""
        return len(self.inputs) + len(self.measured) + len(self.paths)

    @property
    def scales(self) -> tuple[Fraction, ...]:
        """How many times each disturbance acts."""
        return tuple(1 / weight for weight in self.weights)

    @property
    def alike(self) -> Self:
        """The same loops, that weigh alike."""
        return replace(self, weights=(ONE,) * self.count, leads=())

    def require(self, m: int, r: int) -> None:
        """Refuse loops that a plant of m inputs, and a law of r signals, has not.

        Those of paths are refused where a file is read.

        Raises
        ------
        FormatError
        """
        for key, numbers, most in (("inputs", self.inputs, m), ("measured", self.measured, r)):
            if len(set(numbers)) < len(numbers) or not all(0 <= k < most for k in numbers):
                raise FormatError(f"{key} must be different numbers from 1 to {most}")
        if not 1 <= self.count <= MAX_ENTRIES:
            raise FormatError(f"inputs, measured: a margin is of 1 to {MAX_ENTRIES} loops")
        if self.measured and self.paths:
            raise FormatError("measured: beside paths there are inputs alone")
        self.require_scale()

    def require_scale(self) -> None:
        """Refuse a scale that is not one of these loops.

        Raises
        ------
        FormatError
        """
        if len(self.weights) != self.count or min(self.weights) <= 0:
            raise FormatError(f"weights must be {self.count} positive numbers, one a loop")
        if len(self.leads) not in (0, self.count):
            raise FormatError(f"zeros, poles: there must be {self.count}, one a loop")

    def require_leads(self, step: Fraction) -> None:
        """Refuse leads that are not stable both ways.

        Raises
        ------
        FormatError
        """
        self.require_scale()
        for x in (x for lead in self.leads for x in lead):
            if x <= 0 or step * x >= 2:
                below = f" and below {number_text(2 / step)}" if step else ""
                raise FormatError(f"zeros, poles: they are numbers above zero{below}")

    @property
    def before(self) -> Filters:
        """The inverse of each lead, before its disturbance."""
        own: Filters = (None,) * self.own
        return (*own, *(_lead(pole, zero) for zero, pole in self.leads))

    @property
    def behind(self) -> Filters:
        """Each lead, behind what arrives in its loop."""
        return tuple(_lead(*lead) for lead in self.leads)

    @property
    def lead_states(self) -> int:
        """How many states leads have, on both sides."""
        return states_of(self.before) + states_of(self.behind)

    def entering(self, B: Rationals, E: Rationals) -> Rationals:
        """Return E of the disturbances, those at the loops last."""
        none = [ZERO] * len(self.measured)
        rows: Rationals = []
        for k, (row, driven) in enumerate(zip(B, E or [[]] * len(B), strict=True)):
            at_inputs = (ZERO if k in self.demands else row[i] for i in self.inputs)
            own = driven if self.own else ()
            rows.append([*own, *at_inputs, *none, *(driven[p.disturbance] for p in self.paths)])
        return rows

    def columns(self, n: int, m: int) -> tuple[int | None, ...]:
        """Return which column of [A, B, E] each state, input and disturbance has; None: none."""
        known = range(n + m + self.own)
        none, first = (None for _ in self.measured), n + m
        last = (first + path.disturbance for path in self.paths)
        return (*known, *(n + i for i in self.inputs), *none, *last)

    def remainder(self, known: Remainder | None, n: int, m: int) -> Remainder | None:
        """Return a remainder of [A, B, E] as that of these disturbances."""
        columns = self.columns(n, m)

        def changed(M: Rows) -> Rows:
            return tuple(tuple(ZERO if k is None else row[k] for k in columns) for row in M)

        return known and known.mapped(changed)

    def plant(self, plant: Plant) -> Plant:
        """Return the plant with disturbances at the loops, in place of its own or beside."""
        n, m = plant.n, plant.m
        nodes = tuple(Node(v.at, v.A, v.B, self.entering(v.B, v.E)) for v in plant.nodes)
        E = plant.E or [[]] * len(plant.B)
        return replace(
            plant,
            E=list(map(self.entering, plant.B, E)),
            disturbances=(),
            outputs=(),
            noise=(),
            remainder=self.remainder(plant.remainder, n, m),
            nodes=nodes,
        )

    def law(self, law: Law, plant: Plant) -> Law:
        """Return a law into whose signals the disturbances at the loops pass, and no others.

        What is added at an input passes into a signal of which the code takes off what it sent.
        """
        if not (self.measured or self.through or ((self.own or self.paths) and law.F)):
            return replace(law, F=())
        if law.K is None:
            raise FormatError("measured: a law Z W^-1 measures all states; open it at inputs")
        if not law.powers:
            if len(law.K) > 1:
                raise FormatError("measured: a law of a gain at each corner is opened at inputs")
            names = tuple(split(label)[0] for label in plant.states)
            names = names or tuple(f"x{i + 1}" for i in range(plant.n))
            powers = ((0,) * (len(plant.ranges) or len(plant.A)),)
            law = replace(law, powers=powers, measured=names)
        C = law.C or (identity(plant.n),) * len(plant.A)
        most = max((self.own, *(path.disturbance + 1 for path in self.paths)))
        none: Rationals = [[ZERO] * most] * len(C[0])
        known = law.F or [none] * len(plant.A)
        return replace(law, C=C, F=tuple(self.passing(j, known[j]) for j in range(len(plant.A))))

    def passing(self, vertex: int, known: Rationals) -> Rationals:
        """Return what passes into measured signals, of what does of the plant's disturbances."""
        F, first = list[list[Fraction]](), len(self.inputs)
        for j, own in enumerate(known):
            row = [ZERO] * self.count
            for k, measured in enumerate(self.measured):
                row[first + k] = ONE * (measured == j)
            if self.through:
                row[:first] = [self.through[vertex][j][i] for i in self.inputs]
            row[self.count - len(self.paths) :] = [own[p.disturbance] for p in self.paths]
            F.append([*own[: self.own], *row])
        return F

    def outputs(self, law: Law, n: int, m: int, count: int) -> tuple[Output, ...]:
        """Return D (S + (s - 1) / 2) as outputs, of a law as `law` returns it."""
        outputs, passed, first = list[Output](), (1 + self.skew) / 2, len(self.inputs)
        paths = [_times(beside_loops(path.output, self), w) for path, w in self._weighed]
        for k, weight in enumerate(self.weights[: self.count - len(paths)]):
            alone = [ZERO] * (self.own + self.count)
            alone[self.own + k] = weight * passed
            if k < first:
                D = [[weight if j == self.inputs[k] else ZERO for j in range(m)]]
                outputs.append(Output([[[ZERO] * n]] * count, [D] * count, "", ([alone],) * count))
                continue
            j = self.measured[k - first]
            C = [[[weight * x for x in rows[j]]] for rows in law.C]
            straight = [rows[j] for rows in self.through] or [(ZERO,) * m] * count
            Ds = [[[weight * x for x in row]] for row in straight]
            F = [
                [[*alone[: self.own], *(D[0][i] for i in self.inputs), *alone[self.own + first :]]]
                for D in Ds
            ]
            outputs.append(Output(C, Ds, "", tuple(F)))
        return (*outputs, *paths)

    @property
    def _weighed(self) -> Iterator[tuple[Path, Fraction]]:
        """Each path with its weight."""
        return zip(self.paths, self.weights[self.count - len(self.paths) :], strict=True)


def _times(output: Output, weight: Fraction) -> Output:
    """Return so many times an output, without a name."""

    def times(M: Rows) -> Rows:
        return tuple(tuple(weight * x for x in row) for row in M)

    C, D, F = (
        [[[weight * x for x in row] for row in rows] for rows in M]
        for M in (output.C, output.D, output.F)
    )
    return Output(C, D, "", tuple(F), near=output.near and output.near.mapped(times))


def beside_loops(output: Output, loops: Loops) -> Output:
    """Return an output of a plant as one of the plant with the disturbances at loops."""
    n, m = len(output.C[0][0]), len(output.D[0][0])
    sent = is_sent(output.C, output.near, loops)
    none = [ZERO] * len(loops.measured)

    def at_loops(of_u: Sequence[Fraction], of_w: Sequence[Fraction]) -> list[Fraction]:
        at_inputs = [ZERO if sent else of_u[i] for i in loops.inputs]
        return [*at_inputs, *none, *(of_w[path.disturbance] for path in loops.paths)]

    def wider(M: Rows) -> Rows:
        last = n + m + loops.own
        return tuple((*row[:last], *at_loops(row[n : n + m], row[n + m :])) for row in M)

    most = max((loops.own, *(path.disturbance + 1 for path in loops.paths)))
    known = output.F or [[[ZERO] * most]] * len(output.C)
    F = tuple(
        [[*f[: loops.own], *at_loops(d, f)]] for (f,), (d,) in zip(known, output.D, strict=True)
    )
    F = F if any(any(row) for (row,) in F) else ()
    return replace(output, F=F, near=output.near and output.near.mapped(wider))


def is_sent(C: Sequence[Rationals], near: Remainder | None, loops: Loops) -> bool:
    """Whether an output is of demands alone, and not of what arrives."""
    others = (x for (row,) in C for j, x in enumerate(row) if j not in loops.demands)
    return near is None and not any(others)


def _lead(zero: Fraction, pole: Fraction) -> Filter | None:
    """Return (s + zero) / (s + pole); none where it is one."""
    if zero == pole:
        return None
    return Filter([[-pole]], [[pole]], [[(zero - pole) / pole]], "lead", ONE)


@dataclass(frozen=True)
class AtLoops(Gain):
    """A gain that disturbances at opened loops have a part in.

    ``invariant``: of what is in the loops that does not vary in time.
    """

    loops: Loops = field(kw_only=True)
    invariant: bool = field(default=False, kw_only=True)

    @property
    def filtered(self) -> bool:
        """Whether the evidence is of a larger loop than the subject."""
        return bool(self.filters or self.loops.leads)

    @property
    def series(self) -> Self:
        """The same claim about the loop with leads and filters, which has none."""
        loops, outputs = self.loops, self.outputs
        if not loops.leads:
            return super().series
        filters = self.filters or (None,) * len(outputs)
        filters = (
            *filters[: -loops.count],
            *map(in_turn, filters[-loops.count :], loops.behind),
        )
        subject, outputs = in_series(*before(self.subject, outputs, loops.before), filters)
        bare = replace(loops, leads=())
        return replace(self, subject=subject, outputs=outputs, filters=(), loops=bare)

    @property
    def each(self) -> tuple[Self, ...]:
        """A claim for each part of the box alone, where they have scales of their own."""
        if not self.scaled_apart:
            return ()
        return tuple(map(self._alone, self.subject.evidence.cells))

    @property
    def scaled_apart(self) -> bool:
        """Whether parts of the box have scales of their own."""
        return any(piece.weights for piece in self.subject.evidence.cells)

    def _alone(self, piece: Piece) -> Self:
        loops = replace(self.loops, weights=piece.weights, leads=piece.leads)
        whole = self.scaled(replace(self.subject, evidence=piece.evidence), loops)
        whole.require_loops()
        return whole.series.inside(piece)

    def scaled(self, subject: Subject, loops: Loops) -> Self:
        """Return the same claim with other evidence, and loops of another scale."""
        raise NotImplementedError

    @property
    def bare(self) -> Self:
        """What is claimed: scales of loops are a part of what proves it."""
        return self.scaled(super().bare.subject, self.loops.alike)

    def inequalities(self) -> Iterator[Inequality]:
        """Yield what proves the claim, in each part of the box with its scale."""
        for k, one in enumerate(self.each):
            for inequality in () if one.subject.evidence.transfer else one.inequalities():
                yield replace(inequality, piece=f", cell {k + 1}")
        if not self.scaled_apart:
            yield from super().inequalities()

    def decided(self) -> Verdict:
        """Prove it; parts with scales of their own must make up the box."""
        if self.scaled_apart:
            return in_cells([self.subject.evidence], self._decided_each)
        return super().decided()

    def _decided_each(self) -> Verdict:
        count = 0
        for k, one in enumerate(self.each):
            verdict = one.decided()
            if not verdict.proved:
                return replace(verdict, reason=f"cell {k + 1}: {verdict.reason}", place=None)
            count += verdict.count
        return Verdict("proved", f"{count} inequalities hold in exact arithmetic", count)

    @property
    def whole_work(self) -> int:
        """About what it takes to prove it, at least."""
        if self.scaled_apart:
            return sum(one.whole_work for one in self.each)
        return super().whole_work

    def _require_each(self) -> None:
        evidence, motion = self.subject.evidence, self.subject.motion
        if self.loops.leads or not all(piece.weights for piece in evidence.cells):
            raise FormatError("cells: all have weights, and the claim no leads, or none has any")
        for piece in evidence.cells:
            replace(self.loops, weights=piece.weights, leads=piece.leads).require_scale()
        if motion:
            raise FormatError("cells: weights of their own are for parameters that do not move")
        bare = (Piece(piece.low, piece.high, Evidence([])) for piece in evidence.cells)
        replace(evidence, cells=tuple(bare)).require_cells(self.subject.sizes)
        for one in self.each:
            one.require()
        require_work(self.whole_work, self.allowed)

    def require_loops(self) -> None:
        """Refuse leads that do not fit."""
        self.loops.require_leads(self.subject.step)
        if self.loops.leads and not self.invariant:
            raise FormatError("leads: they are for what does not vary in time; say invariant")

    def require(self) -> None:
        """Refuse leads that do not fit; then as any other claim."""
        if self.scaled_apart:
            self._require_each()
            return
        self.require_loops()
        super().require()

    def write_leads(self) -> dict[str, Any]:
        """Return what `read_leads` reads."""
        flag: dict[str, Any] = {"invariant": True} if self.invariant else {}
        return flag | write_leads(self.loops.leads)

    @property
    def invariant_text(self) -> str:
        """Say that what is in the loops does not vary in time, where it may not."""
        return " (errors that do not vary in time)" if self.invariant else ""

    def require_late(self, late: Late) -> None:
        """Refuse what does not hold for a dead time: what is added at an input is late as it is."""
        if self.loops.leads:
            raise FormatError("leads: with a dead time there are none")
        n, m = self.subject.n, self.subject.m
        columns = self.loops.columns(n, m)
        entering = tuple(
            tuple(ZERO if k is None else row[k] for k in columns) for row in late.entering
        )
        law = self.subject.law
        if law.C:  # rows of states that no gain is of are not read
            gained = [
                j for j in range(len(law.C[0])) if any(row[j] for K in law.K or [] for row in K)
            ]
            C, F = (tuple([M[j] for j in gained] for M in rows) for rows in (law.C, law.F))
            law = replace(law, C=C, F=F)
        known = replace(self, subject=replace(self.subject, law=law))
        super(AtLoops, known).require_late(replace(late, entering=entering))

    def loops_text(self, plant: Plant) -> str:
        """Say where loops are opened."""
        names, known = list[str](), plant.inputs
        for i in self.loops.inputs:
            name = f"{quoted(split(known[i])[0])} = " if i < len(known) else ""
            names.append(f"{name}u{i + 1}")
        read = self.subject.law.measured
        for j in self.loops.measured:
            name = f"{quoted(read[j])} = " if j < len(read) else ""
            names.append(f"{name}y{j + 1}, as the law reads it")
        names += (path_text(path, plant) for path in self.loops.paths)
        at = "" if names[0].startswith("from ") else "at "
        if len(names) == 1:
            return f"of the loop {at}{names[0]}"
        return f"of the loops {at}{', '.join(names)}, all at once,"


@dataclass(frozen=True)
class DiskMargin(AtLoops):
    """The gain of D (S + (s - 1) / 2) D^-1 at some loops is less than ``level``: 1 / alpha."""

    kind: ClassVar[str] = "disk margin"
    letters: ClassVar[str] = "AB"

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read loops, skew, weights, level and evidence."""
        law = require_law(law, cls.kind)
        inputs, measured = (
            tuple(k - 1 for k in table.wholes(key, MAX_MEASURED)) if key in table else ()
            for key in ("inputs", "measured")
        )
        loops = Loops(inputs, measured, table.number("skew", 0), table.numbers("weights"))
        loops = replace(loops, paths=read_paths(table, plant))
        loops.require(plant.m, len(law.C[0]) if law.C else plant.n)
        invariant, leads = table.flag("invariant"), read_leads(table, loops.count)
        loops = replace(loops, through=through(plant, law.measured), leads=leads)
        loops.require_leads(plant.step)
        evidence, opened = table.table("evidence"), loops.law(law, plant)
        if loops.measured:
            on, known = evidence.word("on", DOMAINS), on
            if on != known and not law.fixed:
                raise FormatError(f'{evidence.path("on")} must be "{known}", as that of the law')
        filters = read_filters(table, loops.count) if cls.has_filters else ()
        more = states_of(filters) + loops.lead_states + cls.states_in(table, plant)
        subject = read_subject(evidence, loops.plant(plant), opened, on, more)
        return cls.of(subject, loops, table.number("level"), filters, invariant=invariant)

    @classmethod
    def states_in(cls, table: Table, plant: Plant) -> int:  # noqa: ARG003
        """Return how many states there are besides those of the plant and of filters."""
        return 0

    @classmethod
    def of(
        cls,
        subject: Subject,
        loops: Loops,
        level: Fraction,
        filters: Filters = (),
        *,
        invariant: bool = False,
    ) -> Self:
        """Return the claim about a loop whose E and law are those of opened loops."""
        outputs = loops.outputs(subject.law, subject.n, subject.m, len(subject.A))
        known: dict[str, Any] = {"scales": loops.scales, "filters": filters}
        return cls(subject, outputs, level, **known, loops=loops, invariant=invariant)

    def scaled(self, subject: Subject, loops: Loops) -> Self:
        """Return the same claim with other evidence, and loops of another scale."""
        return self.of(subject, loops, self.level, self.filters, invariant=self.invariant)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        loops = self.loops
        table: dict[str, Any] = {"kind": self.kind}
        for key, numbers in (("inputs", loops.inputs), ("measured", loops.measured)):
            table |= {key: [k + 1 for k in numbers]} if numbers else {}
        table |= write_paths(loops)
        table |= {"skew": plain(loops.skew)} if loops.skew else {}
        table |= {"weights": plain(loops.weights), "level": plain(self.level)}
        table |= self.write_leads()
        if self.filters:
            table["filters"] = [
                {} if applied is None else applied.write() for applied in self.filters
            ]
        on = {"on": self.subject.on} if loops.measured else {}
        return table | {"evidence": write_evidence(self.subject) | on}

    def require_extra(self) -> None:
        """Refuse loops that the plant and the law have not."""
        super().require_extra()
        subject = self.subject
        self.loops.require(subject.m, len(subject.law.C[0]) if subject.law.C else subject.n)
        if not self.level:
            raise FormatError("level must be positive")
        if self.loops.paths and not self.has_filters:
            raise FormatError("paths: no factor acts on them")

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that an output of a path has the name of another signal of the plant."""
        return misnamed([path.output for path in self.loops.paths], plant)

    def named(self, plant: Plant) -> str:
        """Say which margin of which loops it is."""
        skew = f" of skew {number_text(self.loops.skew)}" if self.loops.skew else ""
        return f"{self.kind}{skew} {self.loops_text(plant)}{self.invariant_text}"

    def acting_words(self, plant: Plant) -> str:  # noqa: ARG002
        """Nothing: no disturbance of the plant acts."""
        return ""

    @property
    def worst_text(self) -> str:
        """Say how large the margin is at least, rounded down."""
        return f"at least {digits_down(1 / self.level)}"

    def statement(self, plant: Plant) -> str:
        """Say what margin of which loops is proved."""
        on = f"{self.time_text}, on the {self.subject.on}"
        return f"{self.named(plant)} >= {digits_down(1 / self.level)}{on}"


@dataclass(frozen=True)
class Unmodelled(DiskMargin):
    """The gain of D W T D^-1 at some loops is less than ``level``, T = 1 - S, W their filters.

    What arrives there is u + delta v, v what W makes of u, delta any stable system, also one that
    varies in time, of L2 gain at most 1 / level: by the small gain theorem the loops stay stable.
    """

    kind: ClassVar[str] = "unmodelled dynamics"
    has_filters: ClassVar[bool] = True

    def require_extra(self) -> None:
        """Refuse another skew."""
        super().require_extra()
        if self.loops.skew != -1:
            raise FormatError("skew must be -1: unmodelled dynamics act on T")

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read it with a filter of each loop."""
        claim = super().read(table, plant, law, on)
        if len(claim.filters) != claim.loops.count or None in claim.filters:
            raise FormatError(
                f"{table.path('filters')}: each loop has one, that of its unmodelled dynamics"
            )
        return claim

    def named(self, plant: Plant) -> str:
        """Say which dynamics at which loops it is about."""
        shapes = ", ".join(quoted(shape.name) for shape in self.filters if shape is not None)
        of = f"{self.kind} {self.loops_text(plant)}{self.invariant_text}"
        return f"{of} in multiples of {shapes} (as the file defines it),"


def path_text(path: Path, plant: Plant) -> str:
    """Say from where to where a path goes."""
    w, acting = path.disturbance, plant.disturbances
    to = f"{quoted(split(acting[w])[0])} = " if w < len(acting) else ""
    return f"from {outputs_text([path.output], plant)} to {to}w{w + 1}"


def read_paths(table: Table, plant: Plant) -> tuple[Path, ...]:
    """Read loops from outputs to disturbances."""
    if "paths" not in table:
        return ()
    rows = table.table("paths")
    outputs = read_outputs(rows, plant, MAX_ENTRIES)
    numbers = rows.wholes("disturbances", MAX_MEASURED)
    if len(numbers) != len(outputs) or not all(1 <= k <= plant.q for k in numbers):
        raise FormatError(
            f"{rows.path('disturbances')} must be {len(outputs)} numbers from 1 to {plant.q}"
        )
    return tuple(Path(y, k - 1) for y, k in zip(outputs, numbers, strict=True))


def write_paths(loops: Loops) -> dict[str, Any]:
    """Return what `read_paths` reads."""
    if not loops.paths:
        return {}
    numbers = [path.disturbance + 1 for path in loops.paths]
    return {"paths": write_outputs([p.output for p in loops.paths]) | {"disturbances": numbers}}


def through(plant: Plant, measured: Sequence[str]) -> tuple[tuple[tuple[Fraction, ...], ...], ...]:
    """Return D of what is measured "without inputs", (r x m) at each vertex; () without any.

    Raises
    ------
    FormatError
        If there is no such signal.
    """
    if not any(name.endswith(WITHOUT) for name in measured):
        return ()
    none = [[[ZERO] * plant.m]] * len(plant.A)
    columns = []
    for name in measured:
        whole = plant.signal(name.removesuffix(WITHOUT)) if name.endswith(WITHOUT) else None
        columns.append(none if whole is None else whole.D)
    return tuple(tuple(tuple(M[0]) for M in row) for row in zip(*columns, strict=True))
