"""Decay of a loop that is closed by samples, for every parameter value.

The law is computed every Ts seconds, its output held between; with a delay of one step it acts on
the sample before. The claim, |z| < exp(-a Ts) for all poles of the sampled loop:

1. Between the vertices e^(A Ts) is no convex combination of theirs; how far off it is, is bounded
   (`steps`), and with it the rounding of the vertices' own steps.
2. The loop with the combination tolerates such an error of its steps: a claim of kind "gain error",
   built here from the design and the law themselves.

With y = T x, u = S v and one step of delay the states are (y, v):

    y[k + 1] = F(alpha) y[k] + G(alpha) v[k] + r[k],    v[k + 1] = K'(alpha) y[k],

K' = S^-1 K T^-1 = Z' W'^-1 with W' = T W T', Z' = S^-1 Z T'. F and G are convex combinations of the
vertices' own; what these leave out is r = E (y, v), E small: an error of the gain of n inputs whose
gain is zero. Without delay the state is y, v = K' y, and r = E (y, K' y). Inputs that are rates of
states which the code keeps act at once, whatever the delay: of those, v = K' y, and of the others
the state is v.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar, Self

from polefence.proof.claims import steps
from polefence.proof.claims.base import Claim, Verdict, require_law
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rounding import Rounded, rounding_error
from polefence.proof.laws import Evidence, Law, read_evidence
from polefence.proof.matrices import MAX_BITS, ONE, ZERO, Rationals, common_denominator, identity
from polefence.proof.plant import Plant
from polefence.proof.ranges import Range
from polefence.proof.reading import MAX_VERTICES, Table, plain, require_shape
from polefence.proof.regions import Disk
from polefence.proof.short import Short
from polefence.proof.text import digits_down, milliseconds_text
from polefence.proof.work import FormatError

MAX_TERMS = 60
NUMBERS = ("sample_time", "decay", "radius", "error", "mu", "weight")


@dataclass(frozen=True)
class Off(Short):
    """The gain may besides be off by ``error`` S D C for any |D| <= 1.

    S is diagonal, of ``rows`` (a number an input); ``columns`` are the rows of C, n x n.
    """

    error: Fraction
    rows: tuple[Fraction, ...]
    columns: Rationals


@dataclass(frozen=True)
class Sampled(Short, Claim):
    """All poles of the sampled loop have |z| < radius <= exp(-decay sample_time).

    Attributes
    ----------
    design : Poles
        The plant, in continuous time, and the law.
    ranges : tuple of Range
        The intervals of the plant's parameters; empty where it has none.
    sample_time : Fraction
        [s], u held between samples.
    delay : int
        1: u[k] = K x[k - 1]; 0: u[k] = K x[k].
    decay : Fraction
        [1/s]
    radius : Fraction
    T : matrix
        Coordinates y = T x of what follows, any that are regular.
    scale : tuple of Fraction
        Units of the inputs there: u = diag(scale) v.
    steps : tuple of matrices
        For each vertex [F, G], n x (n + m), near [e^(A Ts), its integral times B].
    terms : int
        Of the exponential's series.
    evidence : Evidence
        A Lyapunov polynomial of the loop with these steps, in (y, v), or y where there is no delay.
    error : Fraction
        What is proved to be tolerated, of [F, G].
    mu : Fraction
    elevation : int
    smallest, energy : Fraction
        Without delay and for scheduled laws, bounds on the law in these coordinates, W > smallest I
        and Z W^-1 Z' < energy I; else not used.
    weight : Fraction
        Of the inputs' rows beside those of the states.
    off : Off, optional
    prompt : int
        How many inputs, the last ones, act at once in spite of the delay; of a law of gains.
    """

    kind: ClassVar[str] = "sampled"

    design: Poles
    ranges: tuple[Range, ...]
    sample_time: Fraction
    delay: int
    decay: Fraction
    radius: Fraction
    T: Rationals
    scale: tuple[Fraction, ...]
    steps: tuple[Rationals, ...]
    terms: int
    evidence: Evidence
    error: Fraction
    mu: Fraction
    elevation: int = 0
    smallest: Fraction = Fraction(0)
    energy: Fraction = Fraction(0)
    weight: Fraction = Fraction(1, 2**20)
    off: Off | None = None
    prompt: int = 0

    @property
    def late(self) -> int:
        """How many inputs, the first ones, act a step late."""
        return self.delay * (len(self.scale) - self.prompt)

    @classmethod
    def read(cls, table: Table, plant: Plant, law: Any, on: str) -> Self:
        """Read the steps, and what is proved with them."""
        law = require_law(law, cls.kind)
        plant.require_continuous(table.where)
        n, m = plant.n, plant.m
        domain = plant.domain(on or "simplex")
        claim = cls(
            design=Poles("lyapunov", plant.A, plant.B, (), law, (), domain),
            ranges=plant.ranges,
            delay=table.whole("delay", 1, 1),
            T=table.matrix("T", n, n),
            scale=table.numbers("scale"),
            steps=tuple(table.matrices("steps", n, n + m, MAX_VERTICES)),
            terms=table.whole("terms", None, MAX_TERMS, 1),
            evidence=Evidence([]),
            elevation=table.whole("elevation", 0),
            off=_read_off(table.table("off"), n) if "off" in table else None,
            prompt=table.whole("prompt", 0, m),
            **{key: table.number(key) for key in NUMBERS},
            **{key: table.number(key) for key in ("smallest", "energy") if key in table},
        )
        if len(claim.scale) != m:
            raise FormatError(f"scale must hold {m} positive numbers")
        sizes, width = replace(claim.design, on=claim.domain).sizes, n + claim.late
        evidence = read_evidence(table.table("evidence"), width, sizes, multiple=law.scheduled)
        return replace(claim, evidence=evidence)

    def write(self) -> dict[str, Any]:
        """Return what `read` reads."""
        keys = (*NUMBERS, "delay", "terms", "elevation", "T", "scale", "steps")
        table = {"kind": self.kind} | {key: plain(getattr(self, key)) for key in keys}
        if self.smallest:
            table |= {key: plain(getattr(self, key)) for key in ("smallest", "energy")}
        if self.off:
            off = self.off
            table["off"] = {key: plain(getattr(off, key)) for key in ("error", "rows", "columns")}
        if self.prompt:
            table["prompt"] = self.prompt
        return table | {"evidence": self.evidence.write()}

    def statement(self, plant: Plant) -> str:  # noqa: ARG002
        """Say how the loop is run, and how fast it decays."""
        late, time = ", u one step late" if self.delay else "", milliseconds_text(self.sample_time)
        if self.prompt:
            late += f" but its last {self.prompt}, at once"
        return f"run every {time} ms{late}, decay {digits_down(self.decay, 3)} 1/s"

    def fault_in(self, plant: Plant, claims: Sequence[Claim]) -> str:  # noqa: ARG002
        """Say that the code's rounding, where the file has a claim about it, is not covered."""
        for other in claims:
            if not isinstance(other, Rounded):
                continue
            other.require()
            if not self.covers(other):
                return "the sampled loop is not proved with the code's rounding"
        return ""

    def covers(self, rounded: Rounded) -> bool:
        """Whether the error of the gain that is allowed is at least that of the code's rounding.

        Raises
        ------
        FormatError
            If a bound that the claim about the code rests on does not hold.
        """
        off, gain, design = self.off, rounded.gain, rounded.gain.subject.design
        same = (self.design.A, self.design.B, self.design.law) == (design.A, design.B, design.law)
        if off is None or not same or off.rows != gain.rows or off.columns != gain.right:
            return False
        memory = rounded.code.memory
        kept = memory.states if memory and self.delay else 0
        if self.prompt != kept or (memory and memory.sample_time != self.sample_time):
            return False
        return off.error >= rounding_error(rounded)

    def require(self) -> None:
        """Refuse what is incomplete, of shapes that do not fit, or out of all proportion."""
        design = self.design
        n, m, law = len(design.A[0]), len(design.B[0][0]), design.law
        fixed = law.fixed and len(law.K or []) == 1
        if design.weights or not (law.scheduled or law.polynomial or fixed):
            raise FormatError("sampling is not proved for this kind of plant or law")
        if self.ranges and len(design.A) != 2 ** len(self.ranges):
            raise FormatError("the vertices are not those of the parameters")
        if design.on == "box" and len(design.A) > 1 and not self.ranges:
            raise FormatError("a law on a box needs the parameters' ranges")
        if self.delay not in (0, 1):
            raise FormatError("delay must be 0 or 1")
        if self.prompt and not (self.delay and 0 < self.prompt < m and law.W is None):
            raise FormatError("prompt inputs are some of a law of gains, where others are late")
        for key in ("sample_time", "radius", "error", "mu", "weight"):
            if getattr(self, key) <= 0:
                raise FormatError(f"{key} must be positive")
        if self.radius >= 1:
            raise FormatError("radius must be below one: a loop that decays")
        if not 1 <= self.terms <= MAX_TERMS:
            raise FormatError(f"terms must be 1 to {MAX_TERMS}")
        if self.decay < 0:
            raise FormatError("decay must be zero or more")
        _require_shapes(self, n, m)

    def decided(self) -> Verdict:
        """Prove that the loop tolerates the error of its steps, and that it is no larger."""
        if self.radius * steps.exponential(self.decay * self.sample_time) > 1:
            return Verdict("undecided", "the radius is not below exp(-decay sample_time)")
        whole = loop_claim(self)
        whole.require()
        verdict = whole.decided()
        if not verdict.proved:
            return verdict
        try:
            off = steps.step_error(self, whole.subject.design.sizes)
            off *= steps.held_size(self)
        except FormatError as problem:
            return verdict.unless(str(problem))
        needed = off**2 + steps.gain_error(self) ** 2
        if needed > self.error**2:
            return verdict.unless("the steps may be off by more than the error given")
        share = float(needed / self.error**2) ** 0.5 if needed else 0.0
        percent = math.ceil(1000 * share) / 10
        return verdict.noted(f"steps off by {percent:g} % of what these allow")

    # --- the loop --------------------------------------------------------------------------------

    @property
    def domain(self) -> str:
        """Domain of alpha: with parameters their box, where the law can be told there."""
        law = self.design.law
        if law.polynomial:
            return self.design.on
        if self.ranges and (law.K is not None or law.degree == 1):
            return "box"  # at products a law of degree one is multi-affine in the box's coordinates
        return self.design.on


def _require_shapes(claim: Sampled, n: int, m: int) -> None:
    shaped: list[tuple[str, Rationals, int, int]] = [("T", claim.T, n, n)]
    shaped += [("steps", step, n, n + m) for step in claim.steps]
    width = n + claim.late
    shaped += [("evidence.X", X, width, width) for X in claim.evidence.X]
    shaped += [("off.columns", claim.off.columns, n, n)] if claim.off else []
    for key, matrix, rows, columns in shaped:
        require_shape(matrix, rows, columns, f"{key}")
    common_denominator([claim.T], 2048)  # inverted in rationals
    common_denominator([*claim.steps, *(matrix for _, matrix, *_ in shaped)], MAX_BITS)
    if len(claim.steps) != len(claim.design.A):
        raise FormatError("steps must hold a matrix for each vertex")
    named = [("scale", claim.scale)] + ([("off.rows", claim.off.rows)] if claim.off else [])
    for key, values in named:
        if len(values) != m or min(values) <= 0:
            raise FormatError(f"{key} must hold {m} positive numbers")
    if claim.off and claim.off.error < 0:
        raise FormatError("off.error must be zero or more")


def loop_claim(claim: Sampled) -> GainError:
    """Return the claim that the loop's poles lie in the disk, |E| being at most the error given.

    Raises
    ------
    FormatError
        If T is singular.
    """
    n, m = len(claim.T), len(claim.scale)
    disk = (Disk(ZERO, claim.radius),)
    family = Poles(
        "lyapunov",
        [_stacked(step, n, claim.late) for step in claim.steps],
        [_inputs(step, n, m, claim.late) for step in claim.steps],
        disk,
        _law(claim),
        (claim.evidence,),
        claim.domain,
    )
    pieces = (1,) * len(claim.ranges)
    subject = Subject(family, claim.ranges, pieces, claim.elevation)
    columns = (ONE,) * len(family.A[0])
    return GainError(subject, claim.error, steps.rows(claim) + (ONE,) * n, columns, (claim.mu,))


def _stacked(step: Rationals, n: int, late: int) -> Rationals:
    zeros = ([ZERO] * (n + late) for _ in range(late))
    return [*(row[: n + late] for row in step), *zeros]


def _inputs(step: Rationals, n: int, m: int, late: int) -> Rationals:
    """Return B: of v first, of the remainder r after it."""
    pairs = zip(step, identity(n), strict=True)
    upper = [[ZERO] * late + row[n + late :] + unit for row, unit in pairs]
    return upper + [row + [ZERO] * n for row in identity(m)[:late]]


def _law(claim: Sampled) -> Law:
    n, late = len(claim.T), claim.late
    law = claim.design.law
    if law.polynomial:
        terms, none = steps.transformed_terms(claim), [ZERO] * late
        K = [k + [[ZERO] * len(k[0]) for _ in range(n)] for k in terms.K or []]
        return replace(terms, K=K, C=tuple([row + none for row in rows] for rows in terms.C))
    if law.K is not None:
        return Law([_widened(steps.transformed_gain(claim), n, late)])
    W, Z = steps.transformed(claim)
    if late:
        eye = identity(late)
        W = [[row + [ZERO] * late for row in w] + [[ZERO] * n + row for row in eye] for w in W]
    return Law(None, W, [_widened(z, n, late) for z in Z], law.degree)


def _widened(gain: Rationals, n: int, late: int) -> Rationals:
    """Add no gain of v, and of none the remainder."""
    return [row + [ZERO] * late for row in gain] + [[ZERO] * (n + late) for _ in range(n)]


def _read_off(table: Table, n: int) -> Off:
    error, columns = table.number("error"), table.matrix("columns", n, n)
    return Off(error, table.numbers("rows"), columns)
