"""Gain and phase margins: one loop times a constant number f of a set stays stable.

What arrives at an input u_i, or at a signal y_j that the law measures, is f times what was sent. Of
a gain margin g it is real, from 1 / g to g; of a phase margin it is exp(j phi), |phi| no more than
that. It multiplies the i-th column of B, or the j-th row of what is measured. All poles are to be
stable for every f and every plant of the family.

This is a claim about poles, of a family with more parameters, in which f is multi-affine. An arc
of the circle is in the quadrilateral of its ends and of the two points in which the tangents at the
ends meet that at a point between; a square is mapped onto it. Where f is complex, the loop of real
and imaginary parts is real, with twice as many states. Plant and law are real, so phases below zero
have the conjugate poles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Self

from polefence.proof import intervals
from polefence.proof.claims.base import (
    Claim,
    Inequality,
    Verdict,
    require_law,
    undecided,
)
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.signal import Subject
from polefence.proof.laws import Evidence, Law, read_cells, read_evidence, total_degree
from polefence.proof.matrices import ONE, ZERO, Rationals, identity, longest, mix
from polefence.proof.motion import is_moving
from polefence.proof.plant import WITHOUT, Output, Plant, split
from polefence.proof.polynomials import monomials
from polefence.proof.ranges import Range, corner_weights
from polefence.proof.reading import Table, plain
from polefence.proof.regions import Disk, HalfPlane, Part
from polefence.proof.remainder import Remainder, Rows
from polefence.proof.short import Short
from polefence.proof.text import digits_down, milliseconds_text, quoted
from polefence.proof.work import MAX_IN_PARTS, RATIONAL, FormatError, spend

MAX_ARCS = 200

Complex = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Place(Short):
    """Where a loop is opened: at an input, or at what the law measures, by its number from 0."""

    number: int
    measured: bool = False

    def text(self, plant: Plant, law: Law) -> str:
        """Say where that is."""
        labels = (law.measured or plant.states) if self.measured else plant.inputs
        known = labels if self.measured and law.measured else tuple(split(x)[0] for x in labels)
        name = f"{quoted(known[self.number])} = " if self.number < len(known) else ""
        return f"{name}{'y' if self.measured else 'u'}{self.number + 1}"


@dataclass(frozen=True)
class Patch(Short):
    """Numbers f at the corners of a box, multi-affine between; whether they are complex."""

    corners: tuple[Complex, ...]
    turned: bool = False

    def at(self, uppers: Sequence[Fraction]) -> Complex:
        """Return the factor at weights of each upper end."""
        pairs = list(zip(corner_weights(uppers), self.corners, strict=True))
        real, imaginary = (sum((w * f[k] for w, f in pairs), ZERO) for k in range(2))
        return real, imaginary

    def wide(self, M: Rationals) -> Rationals:
        """Return a matrix for real and imaginary parts, where the factors are complex."""
        return _turned(M, [[ZERO] * len(row) for row in M]) if self.turned else M

    def times(self, f: Complex, M: Rationals, number: int, row: bool) -> Rationals:
        """Return a matrix with a row or a column times a factor, for both parts likewise."""
        here = [[(i if row else j) == number for j in range(len(x))] for i, x in enumerate(M)]
        pairs = [list(zip(x, at, strict=True)) for x, at in zip(M, here, strict=True)]
        real = [[x * f[0] if at else x for x, at in pair] for pair in pairs]
        if not self.turned:
            return real
        return _turned(real, [[x * f[1] if at else ZERO for x, at in pair] for pair in pairs])


def of_gains(margin: Fraction) -> Patch:
    """Return the factors of a gain margin."""
    return Patch(((1 / margin, ZERO), (margin, ZERO)))


def of_arc(first: Fraction, last: Fraction) -> Patch:
    """Return a patch that holds an arc of the circle, which ends at tangents of half of a phase."""
    middle = (first + last) / 2
    outer = tangents_meet(first, middle), tangents_meet(middle, last)
    return Patch((on_circle(first), on_circle(last), *outer), turned=True)


def on_circle(t: Fraction) -> Complex:
    """Return exp(j phi) for t = tan(phi / 2)."""
    return tangents_meet(t, t)


def tangents_meet(s: Fraction, t: Fraction) -> Complex:
    """Return where the tangents at two points of the circle meet."""
    return (1 - s * t) / (1 + s * t), (s + t) / (1 + s * t)


def tangent_up(degrees: Fraction) -> Fraction:
    """Return a number that is no less than the tangent of half of an angle below 180 [deg]."""
    angle = intervals.times(intervals.pi(), intervals.enclosing(degrees / 360))
    sine, cosine = intervals.sine(angle)[1], intervals.cosine(angle)[0]
    if cosine <= 0:
        raise FormatError("a phase margin must be below 180 degrees")
    return Fraction(sine, cosine)


def grown(poles: Poles, place: Place, patch: Patch) -> Poles:
    """Return the claim about the poles of the loops with a factor, on a box of more parameters.

    The factor is multi-affine, as the plant is in its own: so a column of B times it is, and a row
    of what the law measures.
    """
    corners, law = patch.corners, poles.law
    axes, k = len(corners).bit_length() - 1, place.number
    length = max(longest(row for M in (*poles.A, *poles.B) for row in M), longest(corners))
    size, width = len(poles.A[0]), len(poles.A[0]) + len(poles.B[0][0])
    spend(RATIONAL * 4 * size * width * len(poles.A) * len(corners), length, length)
    A = [patch.wide(M) for M in poles.A for _ in corners]
    B = [
        patch.wide(M) if place.measured else patch.times(f, M, k, row=False)
        for M in poles.B
        for f in corners
    ]
    K = [patch.wide(M) for M in law.K or []]
    C: tuple[Rationals, ...] = ()
    if place.measured:
        rows = law.C or (identity(len(poles.A[0])),) * len(poles.A)
        C = tuple(patch.times(f, M, k, row=True) for M in rows for f in corners)
    elif law.C:
        C = tuple(patch.wide(M) for M in law.C for _ in corners)
    powers = law.powers or (((0,) * (len(poles.A).bit_length() - 1),) if C else ())
    if len(poles.A) == 1 and powers:  # of one plant powers of alpha are one
        K, powers = [mix([ONE] * len(K), K)], ((),)
    powers = tuple((*e, *(0,) * axes) for e in powers)
    return replace(
        poles,
        A=A,
        B=B,
        law=Law(K, degree=total_degree(powers), powers=powers, C=C),
        on="box",
        remainder=poles.remainder and _remainder(poles, place, patch),
        motion=poles.motion and (*poles.motion, *(Range(ZERO, ONE),) * axes),
    )


def _remainder(poles: Poles, place: Place, patch: Patch) -> Remainder | None:
    """Return what entries of the larger [A, B] are off by, and the curve between the vertices.

    Parts of the box have no nodes then.
    """
    known = poles.remainder
    if known is None:
        return None
    n, m = len(poles.A[0]), len(poles.B[0][0])

    def larger(M: Rows, f: Complex) -> Rows:
        A, B = ([list(row[a:b]) for row in M] for a, b in ((0, n), (n, n + m)))
        B = patch.wide(B) if place.measured else patch.times(f, B, place.number, row=False)
        return tuple((*a, *b) for a, b in zip(patch.wide(A), B, strict=True))

    real, imaginary = (max(abs(f[part]) for f in patch.corners) for part in range(2))
    entries = tuple(tuple(map(abs, row)) for row in larger(known.entries, (real, imaginary)))
    if not known.curve:
        return Remainder(entries)
    several = len(poles.A) > 1
    exponents = monomials(poles.sizes, known.degree) if several else [()]
    curve = dict(zip(exponents, known.curve, strict=True))
    sizes = (2,) * (len(poles.A) * len(patch.corners)).bit_length()
    cut = 2 * (len(poles.A).bit_length() - 1)
    at = (
        larger(curve[e[:cut]], patch.at([Fraction(k, known.degree) for k in e[cut + 1 :: 2]]))
        for e in monomials(sizes[1:], known.degree)
    )
    return Remainder(entries, tuple(at), known.degree)


def _turned(real: Rationals, imaginary: Rationals) -> Rationals:
    """Return a complex matrix as a real one of real and imaginary parts."""
    pairs = list(zip(real, imaginary, strict=True))
    return [*([*a, *(-x for x in b)] for a, b in pairs), *([*b, *a] for a, b in pairs)]


def require_factors(plant: Plant, law: Any, place: Place, what: str) -> None:
    """Refuse a plant or a law of which no such margin is proved.

    Raises
    ------
    FormatError
        Saying why.
    """
    law = require_law(law, what)
    remainder = plant.remainder
    why = ""
    if plant.late is not None:
        why = "a plant with a dead time"
    elif remainder is not None and remainder.source is not None:
        why = "a plant with functions of its parameters"
    elif law.K is None:
        why = "a law Z W^-1"
    elif len(plant.A) > 1 and len(plant.A) != 2 ** len(plant.ranges):
        why = "a plant that is given by its vertices"
    elif len(plant.A) > 1 and law.powers and len(law.powers[0]) != len(plant.ranges):
        why = "a law in the weights of the vertices"
    elif not law.powers and len(law.K) > 1:
        why = "a law of a gain at each corner"
    elif any(name.endswith(WITHOUT) for name in law.measured):
        why = "a law that measures what inputs pass into"
    if why:
        raise FormatError(f"{what}: not available for {why}; a disk margin implies it")
    count = len(law.C[0]) if law.C else plant.n
    if not 0 <= place.number < (count if place.measured else plant.m):
        raise FormatError(f"{what}: there is no such loop")


def closed_loop(plant: Plant, law: Law) -> Poles:
    """Return the claim that a loop is stable, without evidence."""
    part: Part = Disk(ZERO, ONE) if plant.sample_time is not None else HalfPlane(ZERO)
    motion = plant.ranges if is_moving(plant.ranges) else ()
    bare = replace(law, F=(), anti_windup=None)
    on = "box" if plant.ranges else "simplex"
    poles = Poles("lyapunov", plant.A, plant.B, (part,), bare, (), on)
    return replace(poles, remainder=plant.remainder, motion=motion, step=plant.step)


@dataclass(frozen=True)
class GainMargin(Short, Claim):
    """The loop at ``place`` is stable for every factor of its gain from ``level`` to 1 / level.

    ``evidence`` is one of poles. ``loop`` is the claim about poles that is made of the loop itself,
    whose evidence is empty.
    """

    kind: ClassVar[str] = "gain margin"
    moves: ClassVar[bool] = True
    unit: ClassVar[str] = ""

    loop: Poles
    place: Place
    level: Fraction
    evidence: tuple[Evidence, ...] = ()
    named_at: str = ""

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:  # noqa: ARG003
        """Read place, level and evidence."""
        keys = [key for key in ("input", "measured") if key in table]
        if len(keys) != 1:
            raise FormatError(f"{table.path('input')} or measured: give one, the loop's number")
        place = Place(table.whole(keys[0], None, 10**6, 1) - 1, keys[0] == "measured")
        require_factors(plant, law, place, cls.kind)
        claim = cls.of(plant, law, place, table.number("level"))
        claim.require_level()
        return claim.with_evidence(table.table("evidence"))

    @classmethod
    def of(cls, plant: Plant, law: Law, place: Place, level: Fraction) -> Self:
        """Return the claim without evidence."""
        return cls(closed_loop(plant, law), place, level, named_at=place.text(plant, law))

    def with_evidence(self, table: Table) -> Self:
        """Return it with the evidence that a table holds."""
        (poles,) = self.families
        return replace(self, evidence=(_read(table, poles),))

    def require_level(self) -> None:
        """Refuse a level that is none."""
        if not 0 < self.level < 1:
            raise FormatError("level must be above zero and below one: 1 over the gain margin")

    @property
    def margin(self) -> Fraction:
        """The margin."""
        return 1 / self.level

    @property
    def patches(self) -> tuple[Patch, ...]:
        """The factors, in parts."""
        return (of_gains(self.margin),)

    @cached_property
    def families(self) -> tuple[Poles, ...]:
        """Claims about the poles of the loops with factors, without evidence."""
        return tuple(grown(self.loop, self.place, patch) for patch in self.patches)

    @property
    def poles(self) -> tuple[Poles, ...]:
        """Claims about the poles of the loops with factors."""
        pairs = zip(self.families, self.evidence, strict=True)
        return tuple(replace(poles, evidence=(own,)) for poles, own in pairs)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        place = {"measured" if self.place.measured else "input": self.place.number + 1}
        head = {"kind": self.kind} | place | {"level": plain(self.level)}
        return head | {"evidence": self.evidence_table()}

    def evidence_table(self) -> dict[str, Any]:
        """Return the evidence as a file has it."""
        return self.evidence[0].write()

    def require(self) -> None:
        """Refuse evidence that is incomplete or inconsistent, or more work than is done."""
        self.require_level()
        if len(self.evidence) != len(self.patches):
            raise FormatError("evidence: each part of the factors has its own")
        for poles in self.poles:
            poles.require()

    @property
    def allowed(self) -> int | None:
        """The most work that it may take."""
        several = len(self.evidence) > 1 or any(own.cells for own in self.evidence)
        return MAX_IN_PARTS if several else None

    def symmetric(self) -> Iterator[tuple[str, Rationals]]:
        """Yield the Lyapunov matrices."""
        for poles in self.poles:
            yield from poles.symmetric()

    def inequalities(self) -> Iterator[Inequality]:
        """Yield those of the poles."""
        for poles in self.poles:
            yield from poles.inequalities()

    def decided(self) -> Verdict:
        """Prove it, part by part."""
        fault, count = self.uncovered(), 0
        if fault:
            return undecided(fault)
        for poles in self.poles:
            verdict = poles.decided()
            if not verdict.proved:
                return replace(verdict, count=count + verdict.count)
            count += verdict.count
        return replace(verdict, count=count, reason=_counted(count, len(self.evidence)))

    def uncovered(self) -> str:
        """Say which factors have no evidence; nothing where none is missing."""
        return ""

    # --- as bounds on signals have it ------------------------------------------------------------

    @property
    def subject(self) -> Subject:
        """The loop."""
        loop = self.loop
        return Subject(loop.A, loop.B, [], loop.law, Evidence([]), loop.on)

    @property
    def outputs(self) -> tuple[Output, ...]:
        """No signal, by the name of what is bounded."""
        return (Output([], [], self.named_at),)

    @property
    def degree(self) -> int:
        """The highest degree of its evidence."""
        return max(own.highest for own in self.evidence)

    @property
    def bare(self) -> Self:
        """What is claimed, without what proves it."""
        return replace(self, evidence=())

    def statement(self, plant: Plant) -> str:
        """Say which margin is proved, rounded down."""
        step = self.loop.step
        on = f", at samples every {milliseconds_text(step)} ms" if step else ""
        on += f", on the {self.loop.on}"
        return f"{self.named(plant)} >= {self.margin_text}{on}"

    def named(self, plant: Plant) -> str:  # noqa: ARG002
        """Say which margin of which loop it is."""
        return f"{self.kind} of the loop at {self.named_at}"

    @property
    def margin_text(self) -> str:
        """The margin, rounded down."""
        return f"{digits_down(self.margin)}{self.unit}"

    @property
    def worst_text(self) -> str:
        """Say how large it is at least."""
        return f"at least {self.margin_text}"


@dataclass(frozen=True)
class PhaseMargin(GainMargin):
    """The loop at ``place`` is stable for every phase up to 1 / ``level`` degrees, either way.

    ``evidence`` is one of poles for each arc from one of the numbers ``ends`` to the next, which
    are tangents of half of the phase and begin at zero.
    """

    kind: ClassVar[str] = "phase margin"
    unit: ClassVar[str] = " deg"

    ends: tuple[Fraction, ...] = (ZERO,)

    def with_evidence(self, table: Table) -> Self:
        """Return it with the evidence that a table holds."""
        arcs = table.tables("arcs", MAX_ARCS)
        claim = replace(self, ends=(ZERO, *(arc.number("to") for arc in arcs)))
        claim.require_ends()
        pairs = zip(arcs, claim.families, strict=True)
        return replace(claim, evidence=tuple(_read(arc, poles) for arc, poles in pairs))

    def require_level(self) -> None:
        """Refuse a level that is none."""
        if self.level <= Fraction(1, 180):
            raise FormatError("level must be above 1/180: 1 over the phase margin in degrees")

    def require_ends(self) -> None:
        """Refuse arcs that are none."""
        ends = self.ends
        if ends[0] or any(not a < b for a, b in pairwise(ends)):
            raise FormatError("arcs: their ends must rise from zero")
        if any(b - a > 1 + a * b for a, b in pairwise(ends)):
            raise FormatError("arcs: none may be longer than 90 degrees")

    def require(self) -> None:
        """Refuse arcs that are none too."""
        self.require_ends()
        super().require()

    @property
    def patches(self) -> tuple[Patch, ...]:
        """The factors, arc by arc."""
        return tuple(of_arc(a, b) for a, b in pairwise(self.ends))

    @property
    def bare(self) -> Self:
        """What is claimed, without what proves it."""
        return replace(self, evidence=(), ends=(ZERO,))

    def evidence_table(self) -> dict[str, Any]:
        """Return the evidence as a file has it."""
        pairs = zip(self.ends[1:], self.evidence, strict=True)
        return {"arcs": [{"to": plain(end)} | own.write() for end, own in pairs]}

    def uncovered(self) -> str:
        """Say that the last arc ends before the margin."""
        short = self.ends[-1] < tangent_up(self.margin)
        return "the arcs end before the phase margin" if short else ""


def _counted(count: int, parts: int) -> str:
    more = f", in {parts} arcs" if parts > 1 else ""
    return f"{count} inequalities positive definite in exact arithmetic{more}"


def _read(table: Table, poles: Poles) -> Evidence:
    """Return evidence of poles."""
    n, sizes = len(poles.A[0]), poles.sizes
    if "cells" in table:
        return read_cells(table, n, sizes, multiple=False)
    return read_evidence(table, n, sizes, multiple=False)
