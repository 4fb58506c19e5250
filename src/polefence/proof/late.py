"""Where in a plant a dead time is, and which claims about it hold for the dead time itself.

With delta a parameter in [-1, 1], z the states of `dead_time.Covering`, T the dead time and e of
the rest x of the states, inputs and disturbances what is late, every row of [A, B, E] or [C, D, F]
but those of z is

    [ l, h c ] + delta h [ mu e, b ]    of [ x, z ],

and that of z is T z' = F z + g e x. Thus e x and h have to be affine in the parameters, and no
parameter may move both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

from polefence.proof.dead_time import Covering, DeadTime
from polefence.proof.matrices import ZERO
from polefence.proof.motion import free_of, is_constant
from polefence.proof.polynomials import Sizes
from polefence.proof.ranges import ANY, Range
from polefence.proof.short import Short
from polefence.proof.text import quoted
from polefence.proof.work import RATIONAL, FormatError, spend

if TYPE_CHECKING:
    from polefence.proof.laws import Law
    from polefence.proof.plant import Output, Plant

Row = Sequence[Fraction]


@dataclass(frozen=True)
class Late(Short):
    """A dead time in a plant.

    Attributes
    ----------
    ranges : tuple of Range
        All parameters.
    number : int
        Which of them is delta.
    entering : tuple of row
        e at each vertex, over states, inputs and disturbances.
    """

    ranges: tuple[Range, ...]
    number: int
    dead_time: DeadTime
    covering: Covering
    entering: tuple[tuple[Fraction, ...], ...]

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Vertices that differ in delta, that of -1 first."""
        return _pairs(len(self.ranges), self.number)

    @property
    def states(self) -> range:
        """Numbers of its states."""
        return self.dead_time.states

    def passing(self, rows: Sequence[Row], what: str) -> list[Fraction]:
        """Return h at each vertex, of one row [A, B, E] or [C, D, F] at each.

        Raises
        ------
        FormatError
            If the row is none of a plant with this dead time.
        """
        count = len(rows)
        found = [ZERO] * count
        _, _, c, b = self.covering.chain
        own = {k: i for i, k in enumerate(self.states)}
        spend(RATIONAL * 4 * count * len(rows[0]), 256, 256)
        for one, other in self.pairs:
            h = (rows[one][self.states[0]] + rows[other][self.states[0]]) / (2 * c[0])
            e = self.entering[one]
            for k, (x, y) in enumerate(zip(rows[one], rows[other], strict=True)):
                moved = b[own[k]] if k in own else self.covering.gain * e[k]
                if y - x != 2 * h * moved or (k in own and x + y != 2 * h * c[own[k]]):
                    raise FormatError(f"dead_time: {what} is not of a plant with this dead time")
            found[one] = found[other] = h
        varying = zip(self._varying(found), self._varying(self.entering), strict=True)
        if any(map(all, varying)):
            raise FormatError(f"dead_time: {what} varies with a parameter that moves what is late")
        return found

    def _varying(self, values: Sequence[object]) -> list[bool]:
        """Whether what there is at each vertex depends on each parameter."""
        count = len(self.ranges)
        return [any(values[j] != values[k] for j, k in _pairs(count, f)) for f in range(count)]

    def require_outputs(self, outputs: Sequence[Output], m: int, q: int) -> None:
        """Refuse outputs of a claim that are none of a plant with this dead time."""
        for y in outputs:
            self.passing(rows_of(y, m, q), f"output {quoted(y.name)}")

    def require_law(self, law: Law, sizes: Sizes, m: int, q: int) -> None:
        """Refuse a law that depends on delta other than by what it measures."""
        count = len(self.ranges)
        if law.powers:
            fits = all(len(e) == count and not e[self.number] for e in law.powers)
        else:
            form = law.form(sizes)
            fits = is_constant(form) or (len(sizes) == count and free_of(form, self.number))
        if not fits:
            raise FormatError("dead_time: the law depends on what stands for it")
        for i in range(len(law.C[0]) if law.C else 0):
            driven = [M[i] for M in law.F] if law.F else [[ZERO] * q] * len(law.C)
            rows = [[*C[i], *[ZERO] * m, *F] for C, F in zip(law.C, driven, strict=True)]
            self.passing(rows, "what the law measures")

    def alike(self, matrices: Sequence[object]) -> bool:
        """Whether what there is at each vertex does not depend on delta."""
        return all(matrices[j] == matrices[k] for j, k in self.pairs)


def late_in(plant: Plant) -> Late | None:
    """Return the dead time of a plant, None where it has none.

    Raises
    ------
    FormatError
        If it does not stand in the plant as it is said to.
    """
    ranges = plant.ranges
    numbers = [f for f, parameter in enumerate(ranges) if parameter.dead_time is not None]
    if not numbers:
        return None
    (f, *more), where = numbers, "dead_time"
    delta = ranges[f]
    dead_time = delta.dead_time
    if more or dead_time is None:
        raise FormatError(f"{where}: two in one plant are not provided for")
    if delta.low != -1 or delta.high != 1 or delta.rate != ANY or delta.inverted:
        raise FormatError(f'{where}: its parameter must have the range -1 to 1 and the rate "any"')
    if any(p.rate is not None for g, p in enumerate(ranges) if g != f):
        raise FormatError(f"{where}: all other parameters must be constant")
    plain = plant.sample_time is None and plant.remainder is None and plant.functions is None
    if not plain or len(plant.A) != 2 ** len(ranges):
        raise FormatError(f"{where}: the plant must be in continuous time, its parameters on a box")
    if dead_time.first + dead_time.order > plant.n:
        raise FormatError(f"{where}: its states are not the plant's")
    times = _times(ranges, dead_time)
    covering = dead_time.covering(max(times))
    covering.require_covered()
    late = Late(ranges, f, dead_time, covering, _entering(plant, dead_time, covering, times))
    for i in range(plant.n):
        if i not in late.states:
            rows = [_row(plant, j, i) for j in range(len(plant.A))]
            late.passing(rows, f"state {i + 1}")
    late.require_outputs(plant.outputs, plant.m, plant.q)
    _require_named(plant, late)
    return late


def _times(ranges: Sequence[Range], dead_time: DeadTime) -> list[Fraction]:
    """Return the dead time at each vertex."""
    if not isinstance(dead_time.time, str):
        return [dead_time.time] * 2 ** len(ranges)
    known = [g for g, p in enumerate(ranges) if p.name == dead_time.time]
    if not known or not ranges[known[0]].inverted or ranges[known[0]].low <= 0:
        raise FormatError(
            f"dead_time: {quoted(dead_time.time)} must be a parameter of positive numbers, through "
            "1 over it"
        )
    times = [ZERO] * 2 ** len(ranges)
    for low, high in _pairs(len(ranges), known[0]):
        times[low], times[high] = ranges[known[0]].low, ranges[known[0]].high
    return times


def _entering(
    plant: Plant, dead_time: DeadTime, covering: Covering, times: Sequence[Fraction]
) -> tuple[tuple[Fraction, ...], ...]:
    """Return e at each vertex; refuse rows of other states than those of the chain."""
    F, g, _, _ = covering.chain
    first, n = dead_time.first, dead_time.order
    found = []
    for j, T in enumerate(times):
        for i in range(n):
            row = [T * x for x in _row(plant, j, first + i)]
            own, rest = row[first : first + n], [*row[:first], *row[first + n :]]
            if own != F[i] or (i < n - 1 and any(rest)):
                raise FormatError("dead_time: its states are not those of the approximation")
        entry = [x / g[-1] for x in row]
        entry[first : first + n] = [ZERO] * n
        found.append(tuple(entry))
    for f in range(len(plant.ranges)):  # e / T is affine in 1 / T only where e is constant
        pairs = _pairs(len(plant.ranges), f)
        if any(times[j] != times[k] and found[j] != found[k] for j, k in pairs):
            raise FormatError("dead_time: what is late varies with the dead time")
    return tuple(found)


def _require_named(plant: Plant, late: Late) -> None:
    """Refuse a name of another signal than what is late."""
    signal = plant.signal(late.dead_time.signal)
    rows = None if signal is None else rows_of(signal, plant.m, plant.q)
    if rows is None or any(tuple(row) != e for row, e in zip(rows, late.entering, strict=True)):
        raise FormatError(f"dead_time: what is late is not {quoted(late.dead_time.signal)}")


def rows_of(output: Output, m: int, q: int) -> list[list[Fraction]]:
    """Return [C, D, F] at each vertex."""
    none = [[[ZERO] * q]] * len(output.C)
    D = output.D or [[[ZERO] * m]] * len(output.C)
    parts = zip(output.C, D, output.F or none, strict=True)
    return [[*C[0], *d[0], *F[0]] for C, d, F in parts]


def _row(plant: Plant, j: int, i: int) -> list[Fraction]:
    return [*plant.A[j][i], *plant.B[j][i], *(plant.E[j][i] if plant.E else ())]


def _pairs(count: int, f: int) -> list[tuple[int, int]]:
    """Return the corners of a box that differ in parameter f alone, its low end first."""
    bit = 1 << (count - 1 - f)
    return [(j, j | bit) for j in range(2**count) if not j & bit]
