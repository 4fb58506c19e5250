"""Claims of which motions are followed over steps of time: how, and how far errors reach.

How far what is followed is off is measured by |e|_Q = sqrt(e'Q e), of which is proved

    -(Q A + A'Q) - 2 beta Q > 0,    [ kappa^2, C; C', Q ] > 0,    so |C e| <= kappa |e|_Q.

See `polefence.proof.response`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Verdict, undecided
from polefence.proof.claims.signal import Rows, SignalClaim, Subject
from polefence.proof.plant import Output
from polefence.proof.polynomials import number
from polefence.proof.reading import Table, plain
from polefence.proof.short import Short
from polefence.proof.work import FormatError

MAX_STEPS, MAX_TERMS, MAX_FORM, MAX_BITS = 20_000, 40, 16, 400


def _whole_pairs(table: Table) -> tuple[tuple[int, int], ...]:
    pairs = table.matrix("lengths", None, 2)
    if any(x.denominator != 1 for pair in pairs for x in pair):
        raise FormatError("lengths must be pairs of whole numbers")
    return tuple((int(a), int(b)) for a, b in pairs)


@dataclass(frozen=True)
class Following(Short):
    """How the response is followed in one part of the box.

    Attributes
    ----------
    unit : Fraction
        Of lengths [s].
    lengths : tuple of (int, int)
        Of how many units a step is, and how many steps of that length follow one another.
    terms, degree, bits : int
    rate, reach : Fraction
        beta [1/s] and kappa.
    """

    unit: Fraction
    lengths: tuple[tuple[int, int], ...]
    terms: int
    degree: int
    bits: int
    rate: Fraction
    reach: Fraction

    @classmethod
    def read(cls, table: Table) -> Following:
        """Read it."""
        return cls(
            table.number("unit"),
            _whole_pairs(table),
            table.whole("terms", None, MAX_TERMS, 1),
            table.whole("degree", None, MAX_FORM),
            table.whole("bits", None, MAX_BITS, 1),
            table.number("rate"),
            table.number("reach"),
        )

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        whole = {key: getattr(self, key) for key in ("terms", "degree", "bits")}
        whole |= {"lengths": [list(pair) for pair in self.lengths]}
        return whole | {key: plain(getattr(self, key)) for key in ("unit", "rate", "reach")}

    def require(self) -> None:
        """Refuse numbers that are not positive."""
        if min(self.unit, self.rate, self.reach) <= 0:
            raise FormatError("following: unit, rate and reach must be positive")
        if any(min(pair) < 1 for pair in self.lengths) or not 1 <= self.steps <= MAX_STEPS:
            raise FormatError(f"lengths must be whole numbers, of 1 to {MAX_STEPS} steps")

    @property
    def steps(self) -> int:
        """How many steps there are."""
        return sum(count for _, count in self.lengths)

    @property
    def every(self) -> list[Fraction]:
        """The length of each step [s]."""
        return [units * self.unit for units, count in self.lengths for _ in range(count)]


@dataclass(frozen=True)
class Followed(SignalClaim):
    """A bound on what motions make of an output, which are followed in each part of the box."""

    direct: ClassVar[bool] = True
    has_dual: ClassVar[bool] = True
    has_motion: ClassVar[bool] = False
    has_passing: ClassVar[bool] = True

    following: tuple[Following, ...] = field(default=(), kw_only=True)

    @classmethod
    def read_extra(
        cls,
        table: Table,
        subject: Subject,  # noqa: ARG003
        outputs: tuple[Output, ...],  # noqa: ARG003
    ) -> dict[str, Any]:
        """Read how it is followed in each part."""
        return {"following": tuple(map(Following.read, table.tables("following", 20_000)))}

    def write_extra(self) -> dict[str, Any]:
        """Return what `read_extra` reads."""
        return {"following": [own.write() for own in self.following]}

    def require_extra(self) -> None:
        """Refuse a series that does not fit."""
        evidence, kind = self.subject.evidence, self.kind
        if self.subject.step:
            raise FormatError(f"{kind}: of a plant in continuous time")
        if self.subject.remainder is not None or self.subject.law.W is not None:
            raise FormatError(
                f"{kind}: of a plant that is known exactly, and a law that is no Z W^-1"
            )
        if not evidence.dual:
            raise FormatError(f"{kind}: its evidence is a Q in each part of the box")
        if len(self.following) != 1:
            raise FormatError("following: there must be one for each part of the box")
        self.following[0].require()

    def inside(self, piece: Any) -> Self:
        """Return the claim about a part of the box, with its own series."""
        if len(self.following) != len(self.subject.evidence.cells):
            raise FormatError("following: there must be one for each part of the box")
        return self.part(piece, self.following[self.subject.evidence.cells.index(piece)])

    def part(self, piece: Any, following: Following | None) -> Self:
        """Return the claim about a part of the box that is followed so."""
        own = () if following is None else (following,)
        return replace(super().inside(piece), following=own)

    def _with(self, piece: Any) -> Self:
        return replace(super()._with(piece), following=self.following[:1])

    def dual_rows(self) -> Rows:
        """Return that errors fade, and how far they reach."""
        own, loop = self.following[0], self.subject.dual_loop(self.outputs)
        falling = (loop.QM + loop.QM.T + loop.Q.times(2 * own.rate)).times(-1)
        reach = [[number(own.reach**2, loop.Q.sizes), loop.Y], [loop.Q]]
        return {"of the decrease": [[falling]], "of the output": reach}

    @property
    def largest(self) -> int:
        """Rows of the largest inequality."""
        return self.subject.n + 1

    def decided(self) -> Verdict:
        """Prove that errors fade, and then the measure, in each part of the box."""
        verdict = self.fades()
        if not verdict.proved:
            return verdict
        cells, steps = self.subject.evidence.cells, 0
        for k, one in enumerate(map(self.inside, cells) if cells else [self]):
            fault = one._missed()
            if fault:
                place = f"cell {k + 1}: " if cells else ""
                return undecided(place + fault)
            steps += one.following[0].steps
        return verdict.noted(f"followed over {steps} steps")

    def fades(self) -> Verdict:
        """Prove that errors fade, and how far they reach."""
        return super().decided()

    def _missed(self) -> str:
        """Say what is not proved; "" where all is."""
        raise NotImplementedError
