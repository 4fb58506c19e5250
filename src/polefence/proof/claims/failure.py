r"""A plant of the family that fails: at one point of it a pole is not in a region.

Loops may be off there, each by an error delta_k, a number c or the all-pass of first order

    delta(s) = c (s - a) / (s + a),  a > 0;    in discrete time  c (1 - a z) / (z - a),  |a| < 1,

which is stable, and of gain |c| at every frequency. It acts on what `disk_margin` bounds: on S +
(s - 1) / 2 of loops that are opened, or on W T where dynamics that no model has are of a shape W.
So a disk margin, or a multiple of W, is no more than the largest |c|.

Or elements of the loop, each between a signal y and a disturbance w, are numbers: w = k y. So a
sector of theirs that holds these numbers is not proved by anyone.

The closed loop is one matrix of rationals. That a pole of it is outside is decided by its
characteristic polynomial, or by a matrix P that shows it, see `roots.Outside`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims.base import Claim, Verdict, require_law, undecided
from polefence.proof.claims.disk_margin import (
    Loops,
    path_text,
    read_paths,
    through,
    write_paths,
)
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.sector import Elements, element_words, read_numbers
from polefence.proof.claims.signal import (
    MAX_ENTRIES,
    misnamed,
    read_filters,
    read_outputs,
    write_outputs,
)
from polefence.proof.filters import Filter, Filters
from polefence.proof.laws import Evidence, Law, add
from polefence.proof.matrices import ONE, ZERO, Rationals, identity, mix, product, right_divide
from polefence.proof.plant import Output, Plant, split
from polefence.proof.polynomials import basis, coordinates
from polefence.proof.ranges import corner_weights, narrowed
from polefence.proof.reading import Table, plain
from polefence.proof.regions import (
    Disk,
    HalfPlane,
    Region,
    read_whole,
    require_region,
    write_region,
)
from polefence.proof.roots import Outside, all_inside, is_outside
from polefence.proof.short import Short
from polefence.proof.text import digits_up, name_text, number_text, quoted, region_text, unit_text
from polefence.proof.work import FormatError


@dataclass(frozen=True)
class Error(Short):
    """A number ``gain``, or the all-pass of that gain with a ``pole``: a of the module's text."""

    gain: Fraction
    pole: Fraction | None = None

    @classmethod
    def read(cls, table: Table) -> Error:
        """Read an error."""
        return cls(table.number("gain"), table.number("pole") if "pole" in table else None)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table = {"gain": plain(self.gain)}
        return table if self.pole is None else table | {"pole": plain(self.pole)}

    def require(self, step: Fraction) -> None:
        """Refuse one that is not stable.

        Raises
        ------
        FormatError
        """
        if self.pole is None:
            return
        if not (abs(self.pole) < 1 if step else self.pole > 0):
            raise FormatError("pole of an error must be " + ("within 1" if step else "positive"))

    def filter(self, step: Fraction) -> Filter | Fraction:
        """Return it as q' = a q + b v, c q + d v; a number as it is."""
        p, g = self.pole, self.gain
        if p is None:
            return g
        if step:
            return Filter([[p]], [[ONE]], [[g * (1 - p * p)]], "", -g * p)
        return Filter([[-p]], [[p]], [[-2 * g]], "", g)

    def text(self, step: Fraction) -> str:
        """Say what it is."""
        gain = _short(self.gain)
        if self.pole is None:
            return gain
        a = _short(abs(self.pole))
        if not step:
            return f"{gain} (s - {a})/(s + {a})"
        minus = "+" if self.pole < 0 else "-"
        return f"{gain} (1 {minus} {a} z)/(z {minus} {a})"


def _short(value: Fraction) -> str:
    """Return a number in at most seven digits: the file has it exactly."""
    return f"{float(value):.7g}"


@dataclass(frozen=True)
class Failure(Short, Claim):
    """At one point of the family a pole is not in the region, with errors in loops or without.

    Attributes
    ----------
    plant : Plant
    law : Law
    on : str
        Domain of a law that is not fixed.
    region : tuple of parts
    at : tuple of Fraction
        Shares of the parameters' intervals, of 1/p where the plant is affine in that; of a plant
        without parameters the weights of its vertices.
    loops : Loops, optional
        Where loops are off; of weights of one.
    errors : tuple of Error
        One a loop.
    filters : tuple of Filter
        Of dynamics that no model has, one a loop; none of a disk margin.
    elements : Elements, optional
        Each a number, the centre of its sector.
    outside : Outside, optional
        What shows it; none where the characteristic polynomial is to.
    """

    kind: ClassVar[str] = "failure"

    plant: Plant
    law: Law
    on: str
    region: Region
    at: tuple[Fraction, ...]
    loops: Loops | None = None
    errors: tuple[Error, ...] = ()
    filters: Filters = ()
    outside: Outside | None = None
    elements: Elements | None = None

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read point, region, loops, errors, and what shows it."""
        law = require_law(law, cls.kind)
        region = read_whole(table.table("region"), plant.sample_time is not None)
        at = table.numbers("at", len(plant.ranges) or len(plant.A))
        claim = cls(plant, law, plant.domain(on or "simplex"), region, at)
        if "loops" in table:
            claim = claim._with_loops(table.table("loops"))
        if "elements" in table:
            claim = replace(claim, elements=_elements(table.table("elements"), plant))
        if "outside" in table:
            outside = Outside.read(table.table("outside"), claim.size)
            claim = replace(claim, outside=outside)
        return claim

    def _with_loops(self, table: Table) -> Self:
        inputs, measured = (
            tuple(k - 1 for k in table.wholes(key)) if key in table else ()
            for key in ("inputs", "measured")
        )
        paths = read_paths(table, self.plant)
        count = len(inputs) + len(measured) + len(paths)
        weights, straight = (ONE,) * count, through(self.plant, self.law.measured)
        loops = Loops(inputs, measured, table.number("skew", 0), weights, straight, paths=paths)
        loops.require(self.plant.m, len(self.law.C[0]) if self.law.C else self.plant.n)
        rows = table.tables("errors", count)
        filters = read_filters(table, count) if "filters" in table else ()
        return replace(self, loops=loops, errors=tuple(map(Error.read, rows)), filters=filters)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        table: dict[str, Any] = {"kind": self.kind, "region": write_region(self.region)}
        table["at"] = plain(self.at)
        if self.loops is not None:
            loops = self.loops
            below: dict[str, Any] = {}
            for key, numbers in (("inputs", loops.inputs), ("measured", loops.measured)):
                below |= {key: [k + 1 for k in numbers]} if numbers else {}
            below |= write_paths(loops)
            below |= {"skew": plain(loops.skew)} if loops.skew else {}
            below["errors"] = [error.write() for error in self.errors]
            if self.filters:
                below["filters"] = [{} if f is None else f.write() for f in self.filters]
            table["loops"] = below
        if self.elements is not None:
            table["elements"] = write_outputs(self.elements.signals) | {
                "disturbances": [k + 1 for k in self.elements.disturbances],
                "numbers": plain([low for low, _ in self.elements.sectors]),
            }
        return table | ({} if self.outside is None else {"outside": self.outside.write()})

    @property
    def size(self) -> int:
        """Number of rows of the closed loop."""
        own = sum(f.states for f in self.filters if f is not None)
        return self.plant.n + own + sum(error.pole is not None for error in self.errors)

    @property
    def alpha(self) -> list[Fraction]:
        """Weights of the vertices."""
        return corner_weights(self.at) if self.plant.ranges else list(self.at)

    @property
    def gain(self) -> Fraction:
        """The largest gain of an error."""
        return max((abs(error.gain) for error in self.errors), default=ZERO)

    def require(self) -> None:
        """Refuse a point that is none of the family, and errors that are not stable."""
        plant, spans = self.plant, 2 ** len(self.plant.ranges) == len(self.plant.A)
        require_region(self.region)
        if plant.ranges and not spans:
            raise FormatError("at: the parameters do not span the vertices")
        whole = plant.ranges or sum(self.at) == 1
        if not whole or not all(0 <= share <= 1 for share in self.at):
            raise FormatError("at is no point of the family")
        if self.elements is not None:
            self._require_elements(self.elements)
        if self.loops is None:
            return
        if not self._of_stability:
            raise FormatError("region: errors in loops are about stability alone")
        if plant.remainder is not None:
            raise FormatError("loops: of a plant with a remainder none is opened")
        if len(self.errors) != self.loops.count or len(self.filters) not in (0, self.loops.count):
            raise FormatError("loops: there must be one error a loop, and one filter or none")
        if self.loops.paths and not self.filters:
            raise FormatError("loops: errors of paths have filters")
        if any(f is None for f in self.filters) or (self.filters and self.loops.skew != -1):
            raise FormatError("loops: dynamics that no model has act on T, each with a filter")
        for error in self.errors:
            error.require(plant.step)

    @property
    def _of_stability(self) -> bool:
        return self.region == (Disk(ZERO, ONE) if self.plant.step else HalfPlane(ZERO),)

    def _require_elements(self, elements: Elements) -> None:
        plant = self.plant
        if self.loops is not None or not self._of_stability:
            raise FormatError("elements: they are about stability alone, of loops that are closed")
        if plant.remainder is not None:
            raise FormatError("elements: of a plant with a remainder none is closed")
        elements.require(plant.n, plant.m, plant.q)

    def decided(self) -> Verdict:
        """Decide it at the point."""
        N, W, off = self.loop()
        if self.outside is not None:
            if not is_outside((N, W), self.region, self.outside, off):
                return undecided("its P does not show that a pole is outside")
        elif off:
            return undecided("functions of the parameters need a P that shows it")
        else:
            closed = N if self.law.K is not None or self.loops else right_divide(N, W)
            if closed is not None and all_inside(closed, self.region):
                return undecided("all poles are in the region there")
        return Verdict("proved", "a pole is outside in exact arithmetic")

    def loop(self) -> tuple[Rationals, Rationals, Fraction]:
        """Return N and W of the closed loop N W^-1, and what entries of N may be off by.

        Raises
        ------
        FormatError
            If the loop has no value with the errors.
        """
        if self.loops is not None:
            closed = self._closed(self.loops)
            return closed, identity(len(closed)), ZERO
        if self.elements is not None:
            return self._with_elements(self.elements), identity(self.plant.n), ZERO
        plant, alpha = self.plant, self.alpha
        blank = (Evidence([]),) * len(self.region)
        on = "box" if plant.ranges else self.on
        poles = Poles(
            "lyapunov", plant.A, plant.B, self.region, self.law, blank, on, (), plant.remainder
        )
        N, W = poles.fraction_at(alpha)
        if self.law.K is not None:
            N, W = [[x / W[0][0] for x in row] for row in N], identity(len(N))
        return N, W, poles.off_at(alpha)

    def _closed(self, loops: Loops) -> Rationals:
        """Return the closed loop with the errors in its loops."""
        plant, alpha = self.plant, self.alpha
        opened = loops.plant(plant)
        law = loops.law(self.law, opened)
        A, B, E = (mix(alpha, M) for M in (opened.A, opened.B, opened.E))
        K, passed = _gains(law, alpha, coordinates(alpha, plant.sizes), plant, loops.count)
        outputs = loops.outputs(law, plant.n, plant.m, len(plant.A))
        C, D, F = (
            [row for y in outputs for row in mix(alpha, list(getattr(y, letter)))]
            for letter in "CDF"
        )
        A, E = add(A, product(B, K)), add(E, product(B, passed))
        C, F = add(C, product(D, K)), add(F, product(D, passed))
        for k in range(loops.count):
            behind = self.errors[k].filter(plant.step)
            own = self.filters[k] if self.filters else None
            for applied in (own and own.in_z(plant.step), behind):
                if applied is not None:
                    A, E, C, F = _behind(A, E, C, F, k, applied)
        # w = C x + F w
        straight = [[ONE * (i == j) - x for j, x in enumerate(row)] for i, row in enumerate(F)]
        entering = right_divide(E, straight)
        if entering is None:
            raise FormatError("loops: with these errors the loop has no value")
        return add(A, product(entering, C))

    def _with_elements(self, elements: Elements) -> Rationals:
        """Return the closed loop whose elements are numbers."""
        plant, law, alpha = self.plant, self.law, self.alpha
        here = replace(elements, signals=tuple(_at(y, alpha) for y in elements.signals))
        E = [mix(alpha, elements.of(plant.E))]
        (A,), (B,) = here.fed_back(([mix(alpha, plant.A)], [mix(alpha, plant.B)]), E)
        at = coordinates(alpha, plant.sizes)
        if not law.F:
            return add(A, product(B, _gains(law, alpha, at, plant, 0)[0]))
        C, F = ((mix(alpha, list(M)),) for M in (law.C, law.F))
        read = here.law(replace(law, C=C, F=F))
        K = replace(law, C=(), F=()).gain(alpha, at)
        return add(A, product(B, product(K, read.C[0])))

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that a signal has the name of another of the plant."""
        if self.elements is not None:
            return misnamed(self.elements.signals, plant)
        paths = () if self.loops is None else self.loops.paths
        return misnamed([path.output for path in paths], plant)

    def statement(self, plant: Plant) -> str:
        """Say where it fails, and with which errors."""
        text = f"a pole is not in {region_text(self.region)}{self.where(plant)}"
        if self.elements is not None:
            pairs = zip(element_words(self.elements, plant), self.elements.sectors, strict=True)
            said = "; ".join(f"{w} = {number_text(k)} y, {y}" for (w, y), (k, _) in pairs)
            return f"{text}, with {said}"
        if self.loops is None:
            return text
        what = "disk margin"
        if self.loops.skew:
            what += f" of skew {number_text(self.loops.skew)}"
        if self.filters:
            shapes = ", ".join(quoted(f.name) for f in self.filters if f is not None)
            what = f"multiple of {shapes} (as the file defines it)"
        one = f" in the loop {self.places[0]}" if len(self.errors) == 1 else ""
        most = digits_up(self.gain, 7)
        return f"{text}, with delta = {self.errors_text}{one}: the {what} is at most {most}"

    @property
    def names(self) -> list[str]:
        """The names of the loops that are opened, those of paths aside."""
        if self.loops is None:
            return []
        inputs, states = ([split(x)[0] for x in y] for y in (self.plant.inputs, self.plant.states))
        read = self.law.measured or states
        return [
            *(inputs[i] if i < len(inputs) else f"u{i + 1}" for i in self.loops.inputs),
            *(read[j] if j < len(read) else f"y{j + 1}" for j in self.loops.measured),
        ]

    @property
    def places(self) -> list[str]:
        """Where the loops are, in words."""
        paths = () if self.loops is None else self.loops.paths
        named = (f"at {quoted(name)}" for name in self.names)
        return [*named, *(path_text(path, self.plant) for path in paths)]

    @property
    def cause_text(self) -> str:
        """The errors, or the elements, in words."""
        elements, known = self.elements, self.plant.disturbances
        if elements is None:
            return f"delta = {self.errors_text}"
        said = list[str]()
        for y, k, (number, _) in zip(
            elements.signals, elements.disturbances, elements.sectors, strict=True
        ):
            w = split(known[k])[0] if k < len(known) else f"w{k + 1}"
            said.append(f"{w} = {_short(number)} {y.name}")
        return ", ".join(said)

    @property
    def errors_text(self) -> str:
        """The errors in words, each with its loop where there are several."""
        said = [error.text(self.plant.step) for error in self.errors]
        if len(said) == 1:
            return said[0]
        pairs = zip(said, self.places, strict=True)
        return ", ".join(f"{text} {place}" for text, place in pairs)

    def where(self, plant: Plant) -> str:
        """Say at which parameters."""
        if not plant.ranges:
            shares = ", ".join(_short(x) for x in self.at)
            return f" at alpha = ({shares})" if len(self.at) > 1 else ""
        said = list[str]()
        for k, (r, share) in enumerate(zip(plant.ranges, self.at, strict=True)):
            name = name_text(r.name) or f"parameter {k + 1}"
            said.append(f"{name} = {_short(narrowed(r, share, share).low)} {unit_text(r.unit)}")
        return f" at {', '.join(map(str.rstrip, said))}"


def _elements(table: Table, plant: Plant) -> Elements:
    """Read elements that are numbers."""
    signals = read_outputs(table, plant, MAX_ENTRIES)
    numbers = table.numbers("numbers", len(signals))
    sectors = tuple((k, k) for k in numbers)
    return Elements(signals, read_numbers(table), sectors, (ONE,) * len(signals))


def _at(signal: Output, alpha: list[Fraction]) -> Output:
    """Return a signal at one point, without what passes into it."""
    return Output([mix(alpha, signal.C)], [mix(alpha, signal.D)], signal.name)


def _gains(
    law: Law, alpha: list[Fraction], at: list[Fraction], plant: Plant, count: int
) -> tuple[Rationals, Rationals]:
    """Return the gain on the states, and what passes from the loops to the inputs."""
    none = [[ZERO] * count for _ in range(plant.m)]
    if law.K is None:
        values = basis(at, plant.sizes, law.degree)
        K = right_divide(mix(values, law.Z or []), mix(values, law.W or []))
        if K is None:
            raise FormatError("the law has no value at the point")
        return K, none
    if not law.F:
        return law.gain(alpha, at), none
    own = replace(law, C=())
    K = own.gain(alpha, at)
    return law.gain(alpha, at), product(K, mix(alpha, list(law.F)))


def _behind(
    A: Rationals, E: Rationals, C: Rationals, F: Rationals, k: int, applied: Filter | Fraction
) -> tuple[Rationals, Rationals, Rationals, Rationals]:
    """Return a loop whose k-th output goes through a filter, or is multiplied by a number."""
    if not isinstance(applied, Filter):
        applied = Filter([], [], [[]], "", applied)
    none, rows = (ZERO,) * applied.states, zip(applied.b, applied.a, strict=True)
    wide = [[*row, *none] for row in A]
    wide += [[*(b * x for x in C[k]), *own] for (b,), own in rows]
    E = [*E, *([b * x for x in F[k]] for (b,) in applied.b)]
    behind = [*(applied.d * x for x in C[k]), *applied.c[0]]
    C = [behind if i == k else [*row, *none] for i, row in enumerate(C)]
    F = [[applied.d * x for x in row] if i == k else row for i, row in enumerate(F)]
    return wide, E, C, F
