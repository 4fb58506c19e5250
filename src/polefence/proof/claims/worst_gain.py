"""Worst-case gain: from disturbances to a signal, whatever dynamics that no model has are added.

At inputs u_k becomes (1 + delta_k W_k) u_k, each delta_k any stable system of L2 gain at most one,
constant or not. With v_k = W_k u_k, and w_k = delta_k v_k beside u_k, the gain from w to z is less
than ``level`` if for positive numbers a_k that of

    [ z; a_1 v_1; ... ]    from    [ w; (a_1 / level) w_1; ... ]

is: of the two sums of squares those at loops leave, as |w_k| <= |v_k|, those of z and level w.
Stability is a part of it: where w is zero this is the small gain theorem. Of delta_k that do not
vary in time a_k may be a lead, as of a disk margin.

w_k is beside u_k wherever the plant's input is: in the rates of states, and in outputs of states.
Not so in what is of the law's demand alone: an output of inputs, or of states of their weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, require_law
from polefence.proof.claims.disk_margin import (
    AtLoops,
    Loops,
    beside_loops,
    read_paths,
    through,
    write_paths,
)
from polefence.proof.claims.signal import (
    Subject,
    acting_text,
    misnamed,
    outputs_text,
    read_filters,
    read_outputs,
    read_subject,
    require_scales,
    write_evidence,
    write_outputs,
)
from polefence.proof.filters import Filters, states_of
from polefence.proof.laws import MAX_MEASURED, read_leads
from polefence.proof.matrices import ONE
from polefence.proof.plant import OF_WEIGHT, Output, Plant
from polefence.proof.reading import Table, plain
from polefence.proof.remainder import Rows
from polefence.proof.text import digits_up, quoted
from polefence.proof.work import FormatError

SKEW = Fraction(-1)  # what comes back is all of u


@dataclass(frozen=True)
class WorstCaseGain(AtLoops):
    """The gain from w to z is less than ``level`` for all dynamics at the inputs of ``loops``.

    The last outputs are those at the loops, behind their filters W; z has none. ``chosen`` has how
    many times each disturbance of the plant acts, nothing where each does as it is.
    """

    kind: ClassVar[str] = "worst-case gain"
    has_filters: ClassVar[bool] = True

    chosen: tuple[Fraction, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        own = self.chosen or (ONE,) * self.loops.own
        at_loops = (self.level / weight for weight in self.loops.weights if weight)
        object.__setattr__(self, "scales", (*own, *at_loops))  # it is frozen

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read outputs, disturbances, inputs with weights and filters, level and evidence."""
        law = require_law(law, cls.kind)
        if not plant.E:
            raise FormatError(f"{table.where}: the plant has no E: no disturbance acts on it")
        inputs = read_inputs(table)
        known, paths = demands(plant), read_paths(table, plant)
        loops = Loops(inputs, (), SKEW, table.numbers("weights"), own=plant.q, demands=known)
        loops = replace(loops, paths=paths)
        loops.require(plant.m, 0)
        invariant, leads = table.flag("invariant"), read_leads(table, loops.count)
        loops = replace(loops, through=through(plant, law.measured), leads=leads)
        loops.require_leads(plant.step)
        signals, filters = read_outputs(table, plant, cls.most), read_filters(table, loops.count)
        if not filters or None in filters:
            raise FormatError(
                f"{table.path('filters')}: each input has one, that of its unmodelled dynamics"
            )
        opened = loops.law(law, plant)
        evidence = table.table("evidence")
        more = states_of(filters) + loops.lead_states
        subject = read_subject(evidence, loops.plant(plant), opened, on, more)
        chosen = table.numbers("disturbances", plant.q) if "disturbances" in table else ()
        level = table.number("level")
        return cls.of(subject, signals, loops, level, filters, chosen, invariant=invariant)

    @classmethod
    def of(
        cls,
        subject: Subject,
        signals: Sequence[Output],
        loops: Loops,
        level: Fraction,
        filters: Filters,
        chosen: tuple[Fraction, ...] = (),
        *,
        invariant: bool = False,
    ) -> Self:
        """Return the claim about a loop whose E and law are those of opened loops.

        Parameters
        ----------
        signals : sequence of Output
            z, of the plant before its loops are opened.
        filters : tuple of Filter
            One a loop.
        """
        shape = subject.n, subject.m, len(subject.A)
        outputs = (
            *(beside_loops(signal, loops) for signal in signals),
            *loops.outputs(subject.law, *shape),
        )
        behind = (*(None for _ in signals), *filters)
        known: dict[str, Any] = {"loops": loops, "chosen": chosen, "invariant": invariant}
        return cls(subject, outputs, level, filters=behind, **known)

    @property
    def signals(self) -> tuple[Output, ...]:
        """Z."""
        return self.outputs[: -self.loops.count]

    def scaled(self, subject: Subject, loops: Loops) -> Self:
        """Return the same claim with other evidence, and loops of another scale."""
        outputs = (*self.signals, *loops.outputs(subject.law, subject.n, subject.m, len(subject.A)))
        return replace(self, subject=subject, outputs=outputs, loops=loops)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind}
        table |= write_outputs([alone(signal, self.loops.own) for signal in self.signals])
        inputs = [k + 1 for k in self.loops.inputs]
        table |= ({"inputs": inputs} if inputs else {}) | write_paths(self.loops)
        table |= {"weights": plain(self.loops.weights), "level": plain(self.level)}
        table |= self.write_leads()
        at_loops = self.filters[len(self.signals) :]
        table["filters"] = [{} if shape is None else shape.write() for shape in at_loops]
        table |= {"disturbances": plain(self.chosen)} if self.chosen else {}
        return table | {"evidence": write_evidence(self.subject)}

    def require_extra(self) -> None:
        """Refuse loops that the plant has not, and numbers that do not fit."""
        super().require_extra()
        self.loops.require(self.subject.m, 0)
        if self.loops.skew != SKEW or self.loops.measured:
            raise FormatError("unmodelled dynamics are of inputs, and act on all of what is sent")
        if not self.level:
            raise FormatError("level must be positive")
        require_scales(self.chosen, self.loops.own)

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that an output has the name of another signal of the plant."""
        signals = [alone(signal, self.loops.own) for signal in self.signals]
        return misnamed([*signals, *(path.output for path in self.loops.paths)], plant)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of z."""
        return tuple(quoted(signal.name) for signal in self.signals)

    def acting_words(self, plant: Plant) -> str:
        """Say which disturbances act, and how much of each."""
        return acting_text(self.chosen, plant, self.scale_text)

    def dynamics_text(self, plant: Plant) -> str:
        """Say where dynamics that no model has act, and within which weights."""
        shapes = ", ".join(quoted(shape.name) for shape in self.filters if shape is not None)
        return (
            f"for all unmodelled dynamics {self.loops_text(plant)} within {shapes} (as the file "
            f"defines it){self.invariant_text}"
        )

    def statement(self, plant: Plant) -> str:
        """Say what is bounded, and for which dynamics."""
        signals = [alone(signal, self.loops.own) for signal in self.signals]
        what, acting = outputs_text(signals, plant), self.acting_words(plant)
        level, on = digits_up(self.level), f"{self.time_text}, on the {self.subject.on}"
        return f"{self.kind} of {what} <= {level}{acting}, {self.dynamics_text(plant)}{on}"


def read_inputs(table: Table) -> tuple[int, ...]:
    """Return the inputs of loops; none where they are paths alone."""
    if "inputs" not in table and "paths" in table:
        return ()
    return tuple(k - 1 for k in table.wholes("inputs", MAX_MEASURED))


def demands(plant: Plant) -> tuple[int, ...]:
    """Return the numbers of the states of weights of inputs: they move no others."""
    n, off = plant.n, plant.remainder
    own = {
        i
        for i, name in enumerate(plant.states)
        if name.startswith(OF_WEIGHT)
        and not any(any(E[i]) for E in plant.E)
        and not (off and any(map(any, off.rows_of(i))))
    }
    moved = [{j for j in range(n) if any(A[i][j] for A in plant.A)} for i in range(n)]
    for _ in range(n):
        outside = {j for i in range(n) if i not in own for j in moved[i]}
        own = {i for i in own if moved[i] <= own and i not in outside}
    return tuple(sorted(own))


def alone(output: Output, own: int) -> Output:
    """Return an output of opened loops as one of the plant itself, of so many disturbances."""
    n, m = len(output.C[0][0]), len(output.D[0][0])

    def narrower(M: Rows) -> Rows:
        return tuple(row[: n + m + own] for row in M)

    F = tuple([row[:own] for row in rows] for rows in output.F)
    F = F if any(any(row) for (row,) in F) else ()
    return replace(output, F=F, near=output.near and output.near.mapped(narrower))
