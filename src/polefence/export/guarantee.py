"""Guarantee of the region with the gain as the code computes it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf, nextafter

import numpy as np

from polefence.base.errors import InputError
from polefence.base.progress import stage
from polefence.certify.certificate import Check
from polefence.certify.design import Design
from polefence.certify.margins.bordered import GainQuestion
from polefence.certify.margins.breaks import breaks
from polefence.certify.margins.claims import Reached, above, claimed_design, firmer, subject_of
from polefence.certify.margins.gain_scales import Scales, gain_claim, gain_question
from polefence.export.program import (
    Exact,
    Fixed,
    Program,
    Scheduled,
    exactly,
    memory_of,
    scales_of,
)
from polefence.export.program import Memory as Kept
from polefence.law.coordinates import Coordinates
from polefence.law.laws import Law
from polefence.plant.exact import ranges_of
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, Polynomial, bernstein, binomial, elevated, times
from polefence.plant.system import Array
from polefence.proof.claims.base import prove
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.rounding import (
    Code,
    Memory,
    Rounded,
    Share,
    gain_errors,
    rounding_error,
    solving_of,
)
from polefence.proof.claims.solving import shifted
from polefence.proof.short import Short
from polefence.proof.work import FormatError, WorkError
from polefence.region.text import digits_down, digits_up

Columns = tuple[Fraction | tuple[Fraction, ...], ...]  # as `GainError` has them

SLACK = 1e-3  # of bounds found in floats, for the exact proof
TINY = 1e-30  # above zero, for a law that is zero
ALIKE = 1e-9  # of a gain, for one that hardly varies
BITS = 24  # of the scales of inputs and columns


@dataclass(frozen=True, eq=False)
class Guarantee(Short):
    """A design's claim with the rounding of its code.

    Attributes
    ----------
    design : Design
        The one whose matrices it is proved with; of the method "slack", another of the same gain.
    rounding : float
        Bound on the error of the gain as the code computes it, in the claim's scales.
    tolerated : float
        What the design's own matrices allow, found in floats; -1 where nothing is.
    claim : Rounded, optional
        What was proved; None where rounding may break the region.
    reason : str
        Why not, in one line; empty where it is proved.
    """

    design: Design
    rounding: float
    tolerated: float
    claim: Rounded | None
    reason: str = ""

    @property
    def proved(self) -> bool:
        """Whether the region is proved for the code."""
        return self.claim is not None

    @property
    def share(self) -> float:
        """Rounding as a share of what is tolerated."""
        return self.rounding / self.tolerated if self.tolerated > 0 else inf

    def bound(self, x: Array) -> Array:
        """Return the proved bound on the error of u, (count, m) for x, or y, (count, n)."""
        if self.claim is None:
            raise InputError("nothing is proved of the rounding of this code")
        gain = self.claim.gain
        if self.claim.code.T is None or self.claim.code.scales is not None:
            E = np.array(gain_errors(self.claim), dtype=float)
            return np.asarray(np.abs(x) @ E.T)
        size = np.linalg.norm(x @ np.array(gain.right, dtype=float).T, axis=-1)
        return np.asarray(self.rounding * size[:, None] * np.array(gain.rows, dtype=float))

    def check(self) -> Check:
        """Prove the claim afresh."""
        if self.claim is None:
            return Check("undecided", self.reason)
        verdict = prove(self.claim)
        return Check("proved" if verdict.proved else "undecided", verdict.reason)


def guarantee(design: Design, program: Program) -> Guarantee:
    """Prove that the region holds with the gain as the code computes it, or say why not."""
    claimed = claimed_design(design)
    if claimed is None:
        reason = "nothing is proved of errors of this gain; design with 'scheduled' or 'quadratic'"
        return Guarantee(design, inf, -1.0, None, reason)
    try:
        errors = roundings(claimed, program)
    except FormatError as problem:
        return Guarantee(claimed, inf, -1.0, None, str(problem))
    direct = best_guarantee(errors, claimed)
    others = (
        ()
        if direct.proved or all(error.breaks(claimed) for error in errors)
        else (best_guarantee(errors, other) for other in firmer(claimed, claimed.region))
    )
    return next((other for other in others if other.proved), direct)


def best_guarantee(scaled: Sequence[Rounding], design: Design) -> Guarantee:
    """Return the proof in the first scales that have one, else the reason of the first."""
    first, *others = scaled
    direct = first.guarantee(design)
    if direct.proved or not others:
        return direct
    other = best_guarantee(others, design)
    return other if other.proved else direct


@dataclass(frozen=True, eq=False)
class Rounding(Short):
    """The error of a law's gain by the rounding of its code, whatever is proved of its loop.

    Attributes
    ----------
    blank : Rounded
        The claim of the code, without an error of the gain.
    rows, columns
        Scales of the gain's errors.
    needed : float
        The largest error, in these.
    """

    blank: Rounded
    rows: Array
    columns: Columns
    needed: float

    def question(self, design: Design) -> GainQuestion | None:
        """Return what the design's matrices tolerate; None where floats have no such matrix."""
        with suppress(InputError, np.linalg.LinAlgError):
            return gain_question(design, self.rows, np.array(self.columns, dtype=float))
        return None

    def borne(self, question: GainQuestion) -> Reached | None:
        """Return how more than is needed is tolerated, in floats; None where it is not."""
        with suppress(np.linalg.LinAlgError):
            # a percent more in floats, for the exact proof
            return question.bears(self.needed * 1.01)
        return None

    @stage("rounding of the code")
    def proved(self, design: Design, question: GainQuestion, reached: Reached) -> Guarantee:
        """Prove that a design's region holds with it, as floats say."""
        subject, error = subject_of(design, design.region, reached), above(self.needed)
        gain = question.claim_of(subject, reached, error)
        if not isinstance(gain, GainError):
            raise TypeError(f"{type(gain).__name__} is no claim about the gain as a whole")
        return self._decided(design, gain, reached.value)

    def breaks(self, design: Design) -> bool:
        """Whether an error of its size is found that leaves the region: then nothing proves it."""
        scales = Scales(self.rows, np.array(self.columns, dtype=float))
        with suppress(np.linalg.LinAlgError):
            return breaks(design, design.region, scales.rows, scales.right, self.needed)
        return False

    @stage("rounding of the code")
    def guarantee(self, design: Design) -> Guarantee:
        """Prove that a design's region holds with it, by the design's own matrices."""
        needed, columns = self.needed, np.array(self.columns, dtype=float)
        # where it breaks, what is tolerated is said at once: no finer proof can have enough
        finest = 1 if self.breaks(design) else 4
        tolerated, gain = gain_claim(design, self.rows, columns, needed, finest)
        if gain is None:
            reason = _refusal(self.blank, needed, tolerated, design.method == "lyapunov")
            return Guarantee(design, needed, tolerated, None, reason)
        return self._decided(design, gain, tolerated)

    def _decided(self, design: Design, gain: GainError, tolerated: float) -> Guarantee:
        claim = replace(self.blank, gain=replace(gain, columns=self.columns))
        try:
            verdict = prove(claim)
        except WorkError as problem:
            return Guarantee(design, self.needed, tolerated, None, str(problem))
        proved = claim if verdict.proved else None
        reason = "" if verdict.proved else verdict.reason
        return Guarantee(design, self.needed, tolerated, proved, reason)


def roundings(design: Design, program: Program) -> tuple[Rounding, ...]:
    """Return the error of a design's gain by rounding, in the scales to be tried.

    Where the code keeps states, the gain's errors may be of other sizes than its entries: then
    other scales are tried too.

    Raises
    ------
    FormatError
        If rounding may make the code fail.
    """
    measures, memory = [scales(program, design.law)], memory_of(program)
    if scales_of(program) is not None:
        # errors are of the sizes of units, not of entries
        return (_in_words(design, program),)
    if memory is not None and not isinstance(program, Scheduled):
        measures.append(scales(program, design.law, balanced(program.sizes, memory)))
    code, errors = code_of(program, design.plant), list[Rounding]()
    for rows, columns in measures:
        blank = _with_bounds(design, program, Rounded(_blank(design, rows, columns), code))
        errors.append(Rounding(blank, rows, columns, _needed(blank)))
    return tuple(errors)


def _in_words(design: Design, program: Program) -> Rounding:
    """Return the error in fixed point, in the scales of its own entries.

    Raises
    ------
    FormatError
        If a number that the code computes may have no room.
    """
    rows, columns = scales(program, design.law)
    code = code_of(program, design.plant)
    first = _with_bounds(design, program, Rounded(_blank(design, rows, columns), code))
    if isinstance(program, Scheduled):
        solving_of(first).require()
    sizes = np.array(gain_errors(first), dtype=float)
    rows, columns = scales(
        program, design.law, balanced_to(np.maximum(sizes, max(sizes.max() * 2.0**-20, TINY)))
    )
    blank = replace(first, gain=_blank(design, rows, columns))
    return Rounding(blank, rows, columns, _needed(blank))


def _needed(blank: Rounded) -> float:
    """Return a bound on the error, not below it: the nearest float may be."""
    error = rounding_error(blank)
    nearest = float(error)
    return nextafter(nearest, inf) if Fraction(nearest) < error else nearest


def _refusal(claim: Rounded, needed: float, tolerated: float, given: bool) -> str:
    bits = claim.code.bits
    fixed = claim.code.scales is not None
    wider = "export with --float 64, or " if bits == 32 and not fixed else ""
    wider = "export with --float 32, or " if fixed else wider
    wider = "export with --fixed 32, or " if fixed and bits == 16 else wider
    if claim.code.memory and not fixed:
        # what it would be if its own states were kept exactly
        gain = rounding_error(replace(claim, code=replace(claim.code, memory=None)))
        wider += "with a longer --sample-time, or " if float(gain) < tolerated else ""
    allowed = digits_down(tolerated, 2) if tolerated > 0 else "none"
    return (
        f"rounding in {claim.code.numbers} may change the gain by {digits_up(needed, 2)}, and "
        f"{allowed} is proved to leave the poles in the region; {wider}design for a slightly "
        f"larger region{'' if given else ', or by the method quadratic'}"
    )


def code_of(program: Program, plant: UncertainPlant) -> Code:
    """Return the code's constants as rationals."""
    bits = program.number.bits
    held, scales = memory_of(program), scales_of(program)
    memory, G = None, None
    if held is not None:
        T = plant.sample_time
        time = Fraction(held.sample_time) if T is None else T
        memory = Memory(held.states, Fraction(held.step), time, T is not None)
        if scales is not None and held.anti_windup is not None:
            G = exactly(held.anti_windup)
    if isinstance(program, Fixed):
        return Code(bits, K=exactly(program.K), memory=memory, scales=scales, G=G)
    shares = tuple(
        Share(Fraction(s.low), Fraction(s.high), Fraction(s.scale)) for s in program.shares
    )
    if not isinstance(program, Scheduled):
        terms = tuple(map(exactly, program.gains))
        return Code(bits, shares=shares, terms=terms, memory=memory, scales=scales, G=G)
    W, Z = (tuple(map(exactly, rows)) for rows in (program.W, program.Z))
    L = None if program.L is None else exactly(program.L)
    return Code(bits, None, exactly(program.T), W, Z, shares, L=L, scales=scales)


def balanced(sizes: Array, memory: Kept) -> Array:
    """Return products s_i t_j near to the sizes of a gain's errors, the steps of states included.

    Relative to the unit of rounding, times an entry's operations.
    """
    sizes, r = np.maximum(sizes, TINY), sizes.shape[1]
    steps = np.arange(-memory.states, 0)
    sizes[steps, steps] += 1 / (r * memory.sample_time)
    return balanced_to(sizes)


def balanced_to(sizes: Array) -> Array:
    """Return products s_i t_j that are no smaller than positive sizes, and near to them."""
    columns = np.ones(sizes.shape[1])
    for _ in range(30):  # steps towards products of rows' and columns' sizes
        rows = (sizes / columns).max(axis=1)
        columns = (sizes / rows[:, None]).max(axis=0)
    return np.outer(rows, columns)


def scales(program: Program, law: Law, sizes: Array | None = None) -> tuple[Array, Columns]:
    """Return the scales of an error of the gain: those of the rows, and C of S D C.

    For a fixed gain and a polynomial one the largest entry of each column, else T. Of signals that
    are measured with the same rows everywhere, no more of them than states, multiples of those.
    """
    if isinstance(program, Scheduled) and program.scales is None:
        Z = program.Z if program.L is None else program.Z + program.L @ program.W
        size = np.linalg.norm(Z, axis=-1).max(axis=0)
        return _rows(size), tuple(map(tuple, exactly(program.T)))
    if sizes is None:
        sizes = np.ones(program.shape[::-1]) if isinstance(program, Scheduled) else program.sizes
    rows, columns = _rows(sizes.max(axis=1)), _filled(sizes.max(axis=0))
    if not law.measured:
        return rows, columns
    count, n = law.C.shape[1:]
    if len(law.C) > 1 or count > n:
        return rows, _filled((sizes @ np.abs(law.C).max(axis=0)).max(axis=0))
    matrix = [tuple(t * c for c in y.C[0]) for t, y in zip(columns, law.measured, strict=True)]
    return rows, (*matrix, *[(Fraction(0),) * n] * (n - count))


def _filled(columns: Array) -> tuple[Fraction, ...]:
    """Return positive scales; that of a column of zeros is small, for its products are exact."""
    # a column of zeros takes no room
    least = columns[columns > 0].min(initial=columns.max() or 1.0) * 2.0**-20
    return _exact(_short(np.where(columns > 0, columns, least)))


def _rows(size: Array) -> Array:
    """Return the inputs' sizes relative to the largest."""
    top = size.max()
    return _short(np.where(size > 0, size, top) / top) if top > 0 else np.ones(len(size))


def _short(values: Array) -> Array:
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(mantissa * 2.0**BITS), exponent - BITS))


def _blank(design: Design, rows: Array, columns: Columns) -> GainError:
    """Return a claim of no error, for what of it the bound on rounding needs."""
    ranges = ranges_of(design.plant)
    subject = Subject(design.certificate.claim(), ranges, (1,) * len(ranges))
    return GainError(subject, Fraction(0), _exact(rows), columns, ())


def _exact(values: Array) -> tuple[Fraction, ...]:
    return tuple(Fraction(float(v)) for v in values)


def _with_bounds(design: Design, program: Program, claim: Rounded) -> Rounded:
    """Find bounds on W' and on Z' W'^-1, at the elevation that makes them sharpest."""
    if not isinstance(program, Scheduled):
        return claim
    coordinates, law, L = Coordinates(program.T), design.law, program.L
    left, right = np.split(law.form, [len(program.T)], axis=1)
    W, more = coordinates.forms(left), TINY
    if program.scales is not None and L is not None:
        rows = 2.0 ** -np.array(program.scales.solving[2:], dtype=float)
        gains = np.array(moved_apart(law, exactly(program.T), exactly(L)), dtype=float)
    else:
        rows, gains = scales(program, law)[0], coordinates.gains(right)
        if L is not None:
            gains = gains - L @ W
            # floats know of what varies no more than a share of the gain
            more += ALIKE * float(np.linalg.norm(L / rows[:, None]))
    bounds = sharpest(program.domain, program.degree, W, gains / rows[:, None])
    smallest, size, elevation = bounds
    values = np.array([smallest * (1 - SLACK), (size + more) * (1 + SLACK)])
    low, high = _exact(_short(values))
    return replace(claim, smallest=low, size=high, elevation=elevation)


def moved_apart(law: Law, T: Exact, L: Exact) -> list[Exact]:
    """Return (Z - L W) T' of the coefficients of a scheduled law, exactly."""
    n = len(T)
    return shifted([exactly(M[n:]) for M in law.form], [exactly(M[:n]) for M in law.form], L, T)


def sharpest(domain: Domain, degree: int, W: Array, Z: Array) -> tuple[float, float, int]:
    """Return bounds, W > smallest I and |Z W^-1| < size, and the elevation that proves these.

    Raises
    ------
    FormatError
        If W is not found to be positive definite.
    """
    left, right = (bernstein(domain, coefficients, degree) for coefficients in (W, Z))
    square, best = times(left, left), (inf, 0.0, 0.0, 0)
    for elevation in range(9):
        if domain.count(2 * degree + elevation) > 3000:
            break
        smallest = float(np.linalg.eigvalsh(_raised(domain, left, degree, elevation)).min())
        s = _raised(domain, square, 2 * degree, elevation)
        if smallest <= 0 or np.linalg.eigvalsh(s).min() <= 0:
            continue
        z = _raised(domain, right, degree, degree + elevation)
        energy = np.linalg.eigvalsh(z @ np.linalg.solve(s, z.swapaxes(-1, -2))).max()
        size = float(np.sqrt(max(energy, 0.0)))
        # a higher elevation must gain 5 %
        if size / smallest < 0.95 * best[0]:
            best = size / smallest, smallest, size, elevation
    if not best[1]:
        raise FormatError("W of the law is not proved to be positive definite by its coefficients")
    _, smallest, size, elevation = best
    return smallest, size, elevation


def _raised(domain: Domain, P: Polynomial, degree: int, times: int) -> Array:
    """Return the Bernstein coefficients of a polynomial at a higher degree."""
    higher = elevated(P, domain, times)
    return np.array(
        [higher[e] / binomial(domain.sizes, e) for e in domain.monomials(degree + times)]
    )
