"""Exponential stability while the parameters move.

x' X^-1 x decreases faster than exp(-2 a t) for all |dp_i/dt| <= r_i: -(N + N' + 2 a X) + dX/dt > 0,
X of one part of the region, all signs; d(1/p)/dt = -(1/p)^2 dp/dt. Without parameters
alpha' = r (u - v), u and v corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations, product
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Inequality
from polefence.proof.claims.margins import (
    Family,
    MarginClaim,
    Subject,
    cells,
    family_of,
    listed,
    require_numbers,
)
from polefence.proof.motion import change
from polefence.proof.plant import Plant
from polefence.proof.polynomials import Polynomial
from polefence.proof.reading import Table, plain
from polefence.proof.regions import lyapunov
from polefence.proof.text import digits_down, rate_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Rate(MarginClaim):
    """The loop decays faster than exp(-decay t) while no parameter moves faster than its rate.

    ``rates`` in the parameters' own units per second; without parameters one number, of weight per
    second; None: at any rate, which one W for all parameters proves. ``part`` is the part of the
    region, from 0 up, whose Lyapunov polynomial it is, of a law that was given.
    """

    kind: ClassVar[str] = "rate"

    decay: Fraction
    rates: tuple[Fraction, ...] | None
    part: int = 0

    @property
    def values(self) -> tuple[Fraction, ...] | None:
        """The rates."""
        return self.rates

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read it, of a plant in continuous time."""
        plant.require_continuous(table.where)
        return super().read(table, plant, law, on)

    @classmethod
    def read_own(cls, table: Table, subject: Subject) -> dict[str, Any]:
        """Read decay, rates and the part."""
        rates = None if table.at("rates") == "any" else table.numbers("rates")
        part = table.whole("part", 1, len(subject.design.evidence), 1) - 1
        return {"decay": table.number("decay"), "rates": rates, "part": part}

    def write_own(self) -> dict[str, Any]:
        """Return decay, rates and the part."""
        rates = "any" if self.rates is None else plain(self.rates)
        part = {"part": self.part + 1} if self.part else {}
        return {"decay": plain(self.decay), "rates": rates} | part

    def require_own(self, count: int) -> None:
        """Refuse rates that are none, and parts that are not there."""
        if not 0 <= self.part < len(self.subject.design.evidence):
            raise FormatError(f"part must be 1 to {len(self.subject.design.evidence)}")
        require_numbers((self.decay,), 1, "decay")
        if self.rates is not None:
            require_numbers(self.rates, count, "rates")
        elif not self._is_constant:
            raise FormatError("rates: only one W for all parameters holds at any rate")

    @property
    def _is_constant(self) -> bool:
        """Whether one W is that of all parameters, whatever the degree of the law."""
        design = self.subject.design
        degree = design.evidence[self.part].degree if design.law.polynomial else 1
        return not degree or not self.subject.degree(self.part)

    def work(self) -> tuple[int, int]:
        """Return how many inequalities there are, and half their size."""
        subject, design = self.subject, self.subject.design
        degree = subject.degree(self.part)
        signs = 1
        if degree and self.rates is not None:
            N, moving = len(design.A), sum(1 for r in self.rates or () if r)
            signs = 2**moving if subject.ranges else N * N
        return self.pieces_work(degree) * signs, len(design.A[0])

    def inequalities(self) -> Iterator[Inequality]:
        """Yield W, and -(N + N' + 2 a W) + dW/dt at every extreme of the rates."""
        subject, family = self.subject, family_of(self.subject, self.part)
        slopes = list(self._slopes(family))
        for cell in cells(subject):
            X, N, _ = cell.loop(family)
            degrees = cell.elevated(N.degrees, subject.elevation)
            yield Inequality("of W", [[X]], degrees, cell.name)
            still = lyapunov([[2 * self.decay]], [[Fraction(1)]], X, N).raised(degrees)
            moved = [P.composed(cell.law, cell.sizes).raised(degrees) for P in slopes]
            for signs in self._extremes(len(moved)):
                F = still
                for sign, P in zip(signs, moved, strict=True):
                    F = F + P.times(sign) if sign else F
                yield Inequality(f"signs {signs}", [[F]], degrees, cell.name)

    def _slopes(self, family: Family) -> Iterator[Polynomial]:
        """Yield for each parameter, or vertex, its rate times the change of W with it."""
        if self.rates is None or not family.varies:
            return
        W = family.X
        if not self.subject.ranges:
            for k in range(W.sizes[0]):
                yield W.derivative(k).times(self.rates[0])
            return
        for f, (interval, rate) in enumerate(zip(self.subject.ranges, self.rates, strict=True)):
            yield change(W, f, interval).times(rate)

    def _extremes(self, count: int) -> Iterator[tuple[int, ...]]:
        """Yield the signs of all rates; without parameters weight goes from vertex to vertex."""
        rates = self.rates
        if not count or rates is None or not any(rates):
            yield (0,) * count
        elif self.subject.ranges:
            yield from product(*((-1, 1) if rate else (0,) for rate in rates))
        elif count == 1:
            yield (0,)
        else:
            for to, off in permutations(range(count), 2):
                yield tuple(int(k == to) - int(k == off) for k in range(count))

    def said(self, plant: Plant) -> str:
        """Say at which rates of its own, whatever those of the plant."""
        return self.statement(plant)

    def statement(self, plant: Plant) -> str:
        """Say how fast the loop decays, at which rates."""
        decay = digits_down(self.decay, 4)
        stable = f"exponential stability, decay rate {decay} 1/s{self.within(plant)}"
        if self.rates is None:
            return f"parameters moving at any rate, {stable}"
        speeds = [(name, rate_text(unit)) for name, unit in self.names(plant)]
        weight = f"alpha moving by up to {digits_down(self.rates[0], 4)} 1/s"
        rates = listed("{} moving by up to {} {}", speeds, self.rates) if speeds else weight
        return f"{rates}, {stable}"
