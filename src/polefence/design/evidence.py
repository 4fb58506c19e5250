"""Evidence that a given law keeps a region: of the whole box, then of parts of it.

Lyapunov polynomials of growing degree are tried for the whole box. Where they prove nothing it is
halved, along the parameter that changes the loop most, until low degrees do in each part; a part in
which a pole is found to leave the region refutes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.certificate import Certificate, exact_law, part_of
from polefence.design.counterexample import counterexample
from polefence.design.rational import lyapunov_matrices
from polefence.design.search import Deadline, first
from polefence.law.laws import (
    FixedGain,
    Law,
    PolynomialGain,
    ScheduledGain,
    divisible,
    domain_of,
)
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.solve.gramians import cheapest, majorant
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, points_inside
from polefence.plant.boxes import MOST_PARTS, Box, divided, widest
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.polynomial import Domain, bernstein, elevated, times
from polefence.plant.polynomial import Polynomial as Floats
from polefence.plant.system import Array
from polefence.proof import matrices, polynomials, work
from polefence.proof.claims.base import prove
from polefence.proof.claims.saturation import cut_off
from polefence.proof.laws import Evidence, Piece, lifted
from polefence.proof.plant import ANY
from polefence.proof.polynomials import Polynomial, coordinates, multinomial
from polefence.proof.remainder import Spread
from polefence.region.regions import Region

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
# The same, and pieces of each interval, beyond: where parameters move; inequalities at most.
FINER, MOST_FINER = (((2, 0), 2), ((3, 0), 4), ((4, 0), 8), ((5, 0), 16)), 300
# What a step of the search may cost, beyond the first form [multiplications].
MOST_WORK = 1e10
# Degree and elevation in parts of the box, and what a step may cost there beyond the first form.
IN_PARTS, MOST_IN_PART = ((0, 0), (1, 0)), 1e9
# Omega over what it has to exceed, and besides, as a share of that.
OVER, SLIGHT = 1.001, 1e-9
FREE = 1e4  # times what a column is that nothing costs
SHARE = 0.8  # of what is checked in a file, after which no more parts are proved


def loop_of(plant: UncertainPlant, law: Law) -> Loop:
    """Return the closed loop as a quotient of polynomials."""
    return _loop(plant, law, np.concatenate([plant.A, plant.B], axis=2))


def loop_with(plant: UncertainPlant, law: Law, C: Array, D: Array) -> Loop:
    """Return the closed loop with the rows of y = C x + D u, (N, p, n) and (N, p, m), below it."""
    rows = [np.concatenate([plant.A, C], axis=1), np.concatenate([plant.B, D], axis=1)]
    return _loop(plant, law, np.concatenate(rows, axis=2))


def with_inputs(plant: UncertainPlant, law: Law, loop: Loop) -> Loop:
    """Return a loop with how its inputs enter, and what they are: they are cut off."""
    n, domain = plant.shape[0], loop.domain
    if isinstance(law, FixedGain):
        K = {(0,) * sum(domain.sizes): law.K}
    elif isinstance(law, PolynomialGain):
        K = {e: p[n:] for e, p in bernstein(domain, law.form, law.degree).items()}
    else:
        K = bernstein(domain, law.Z, law.degree)
    return replace(loop, B=polynomial_of(plant, domain, plant.B, n), K=K)


def _loop(plant: UncertainPlant, law: Law, rows: Array) -> Loop:
    n, domain, step = plant.shape[0], domain_of(plant, law), float(plant.step)
    AB, motion, d = polynomial_of(plant, domain, rows), Motion.of(plant), plant.curve_degree
    if isinstance(law, FixedGain):
        eye = {(0,) * sum(domain.sizes): np.eye(n)}
        both = {(0,) * sum(domain.sizes): np.vstack([np.eye(n), law.K])}
        return Loop(elevated(eye, domain, d), times(AB, both), domain, step=step, motion=motion)
    if isinstance(law, PolynomialGain):
        both = bernstein(domain, law.form, law.degree)
        eye = elevated({(0,) * sum(domain.sizes): np.eye(n)}, domain, law.degree + d)
        return Loop(eye, times(AB, both), domain, step=step, motion=motion)
    W = bernstein(domain, law.W, law.degree)
    both = bernstein(domain, np.concatenate([law.W, law.Z], axis=1), law.degree)
    return Loop(elevated(W, domain, d), times(AB, both), domain, W, step, motion)


def polynomial_of(plant: UncertainPlant, domain: Domain, rows: Array, column: int = 0) -> Floats:
    """Return rows at the vertices as a polynomial; a plant's curve is added to the first n.

    Of the curve's columns it begins with ``column``.
    """
    found, d = bernstein(domain, rows, 1), plant.curve_degree
    if d == 1:
        return found
    if domain != plant.domain:
        raise InputError(
            f"{plant.name}: its samples are polynomials of the parameters; ask for a law on the "
            "box of these (on = 'box')"
        )
    more = np.zeros((len(plant.curve), *rows.shape[1:]))
    more[:, : plant.shape[0]] = plant.curve[:, :, column : column + rows.shape[2]]
    found, curve = elevated(found, domain, d - 1), bernstein(domain, more, d)
    return {e: found[e] + curve[e] for e in found}


def forms(plant: UncertainPlant, law: Law, parts: int = 1) -> Iterator[tuple[int, int]]:
    """Yield degree and elevation of the Lyapunov polynomials worth trying, the first whatever.

    Raises
    ------
    InputError
        If the plant is so large that the exact checker does not take even the first.
    """
    n = plant.shape[0]
    for form in LADDER:
        blocks = _blocks(plant, law, form)
        checked = matrices.least_work(blocks * parts**2, 2 * n) <= work.MAX_WORK
        if form == LADDER[0]:
            if not checked:
                raise InputError(f"{plant.name}: {blocks} inequalities are more than is checked")
        elif not checked or work_of(plant, law, form) > MOST_WORK:
            return
        yield form


def _blocks(plant: UncertainPlant, law: Law, form: tuple[int, int]) -> int:
    """Return how many inequalities a Lyapunov polynomial of a form has for a part of a region."""
    own = 0 if isinstance(law, FixedGain) else law.degree
    own *= 2 if isinstance(law, ScheduledGain) else 1
    return domain_of(plant, law).count(form[0] + plant.curve_degree + own + form[1])


def work_of(plant: UncertainPlant, law: Law, form: tuple[int, int]) -> float:
    """Return about what a step of the search for one costs [multiplications]."""
    n = plant.shape[0]
    unknowns = domain_of(plant, law).count(form[0]) * n * (n + 1) // 2
    return float(_blocks(plant, law, form) * unknowns**2 * (2 * n) ** 2)


def evidence_at(
    plant: UncertainPlant, law: Law, part: Region, form: tuple[int, int], pieces: int = 1
) -> dict[str, Any] | None:
    """Return evidence of a form, proved for one part of a region in pieces of the intervals."""

    def proved(found: LyapunovPolynomial) -> dict[str, Any] | None:
        evidence = whole_evidence(plant, law, found, form)
        holds = certificate_of(plant, law, part, [evidence]).holds()
        return evidence if holds else None

    with suppress(np.linalg.LinAlgError):  # a law without a value somewhere
        loop = replace(loop_of(plant, law), pieces=pieces_of(plant, pieces))
        return first(map(proved, points_inside(loop, part, form)))
    return None


def pieces_of(plant: UncertainPlant, pieces: int) -> tuple[int, ...]:
    """Return so many pieces of the interval of each parameter that moves, one of others."""
    if pieces < 2:
        return ()
    return tuple(1 if own.rate in (None, ANY) else pieces for own in plant.parameters)


def finer(plant: UncertainPlant, law: Law) -> Iterator[tuple[tuple[int, int], int]]:
    """Yield forms and pieces beyond the ladder, where parameters move: there are no cells then."""
    motion = Motion.of(plant)
    moves = motion.moves if motion.centre is None else ()  # in discrete time X is affine
    for form, pieces in FINER if moves else ():
        each = _blocks(plant, law, form) * 2 ** len(moves)
        if each * pieces ** len(moves) <= MOST_FINER:
            yield form, pieces


def _spread(plant: UncertainPlant, law: Law, evidence: dict[str, Any]) -> dict[str, Any]:
    """Return what a remainder asks for besides, as a certificate has it."""
    multiple = tuple(map(Fraction, evidence["multiple"].tolist())) if "multiple" in evidence else ()
    X = [[[Fraction(e) for e in row] for row in Q] for Q in evidence["X"].tolist()]
    found = Evidence(X, evidence["degree"], evidence["elevation"], multiple)
    own = spread_of(plant, law, found, driven=False)
    each = {key: getattr(own, key) for key in ("omega", "rows", "columns")}
    return {key: np.array(value, dtype=float) for key, value in each.items()}


def spread_of(
    plant: UncertainPlant,
    law: Law,
    evidence: Evidence,
    driven: bool = True,
    cut: Sequence[int] = (),
) -> Spread:
    """Return what a plant's remainder asks for beside a Lyapunov polynomial.

    Rows and columns follow the sizes that the Lyapunov matrix gives to states and inputs; Omega is
    little more than all coefficients of V'V.

    Parameters
    ----------
    driven : bool
        Whether disturbances count; of poles they do not.
    cut : sequence of int
        Inputs that are cut off: Omega is enough for every part of them.
    """
    remainder = plant.remainder
    if remainder is None:
        raise InputError(f"{plant.name} has no remainder")
    n = plant.shape[0]
    XKX = lifted(exact_law(law), evidence, domain_of(plant, law).sizes)
    each = _coefficients(XKX)
    if cut:
        Y = polynomials.bernstein([*evidence.held], XKX.sizes, evidence.held_degree)
        parts = cut_off(XKX, n, {i: Y.part(slice(i, i + 1)) for i in cut})
        each = np.concatenate([_coefficients(own) for _, own in parts])
    X = each[:, :n].mean(axis=0)
    T = np.linalg.cholesky((X + X.T) / 2)
    inverse = np.linalg.inv(T)
    moved = each @ inverse.T  # in coordinates in which X is about one
    a, b = (inverse**2).sum(axis=0), (moved**2).sum(axis=2).max(axis=0)
    R, known = np.array(remainder.entries, dtype=float), len(b)
    if driven:
        rows, columns = cheapest(R, a, b)
    else:  # any column of a disturbance will do that is large enough
        ends = R[:, known:]
        rows, columns = cheapest(R * (np.arange(R.shape[1]) < known), a, b)
        rows = np.where(ends.any(axis=1) & (rows <= 0), rows.max(), rows)
        columns[known:] = FREE * (ends / np.where(rows > 0, rows, np.inf)[:, None]).max(axis=0)
    omega = more_than(columns[: each.shape[1], None] * moved, T)
    sides = [tuple(map(Fraction, own.tolist())) for own in (rows, columns)]
    return Spread(omega, sides[0], sides[1])


def more_than(V: Array, T: Array) -> list[list[Fraction]]:
    """Return Omega, a little more than all T V'V T' (count, r, n)."""
    squares = V.swapaxes(1, 2) @ V
    size = max(float(np.linalg.eigvalsh(squares).max()), SLIGHT)
    omega = T @ (majorant(squares) * OVER + SLIGHT * size * np.eye(len(T))) @ T.T
    return [[Fraction(x) for x in row] for row in ((omega + omega.T) / 2).tolist()]


def _coefficients(P: Polynomial) -> Array:
    """Return the Bernstein coefficients of an exact polynomial, (count, ., .)."""
    each = [
        np.array(M, dtype=object) / Fraction(P.whole * multinomial(e, P.sizes))
        for e, M in P.terms.items()
    ]
    return np.array(each).astype(float)


class Search:
    """The search for evidence of one part of a region, beyond the lowest form.

    ``last`` is the form of the whole box tried last, ``halved`` whether parts of it were, ``cut``
    whether a deadline ended it; ``alpha``, where there is one, refutes the region. ``parts`` is of
    how many the region is made.
    """

    def __init__(
        self, plant: UncertainPlant, law: Law, part: Region, deadline: Deadline, parts: int = 1
    ) -> None:
        self.plant, self.law, self.part, self.deadline = plant, law, part, deadline
        self.most, self.share = _most_parts(plant, law, parts), SHARE / parts
        self.last, self.halved, self.cut = LADDER[0], False, False
        self.alpha: list[Fraction] | None = None

    @property
    def tried(self) -> str:
        """What was tried, in words."""
        degree, elevation = self.last
        found = f"Lyapunov polynomials up to degree {degree}, elevation {elevation}"
        return found + f", nor in {self.most} parts of the box" * self.halved

    def proof(
        self, ladder: Sequence[tuple[int, int]], halved: bool = True
    ) -> dict[str, Any] | None:
        """Return evidence of a form of the whole box, else, with ``halved``, in parts of it."""
        for form in ladder:
            if self._late():
                return None
            self.last = form
            evidence = evidence_at(self.plant, self.law, self.part, form)
            if evidence is not None:
                return evidence
        for X in lyapunov_matrices(self.plant, self.law, self.part):
            evidence = {"X": X, "degree": 0, "elevation": 0}
            if certificate_of(self.plant, self.law, self.part, [evidence]).holds():
                return evidence
        for form, pieces in finer(self.plant, self.law):
            if self._late():
                return None
            self.last = form
            evidence = evidence_at(self.plant, self.law, self.part, form, pieces)
            if evidence is not None:
                return evidence
        return self.in_parts() if halved else None

    def in_parts(self) -> dict[str, Any] | None:
        """Return evidence in parts of the box, None where they would be too many."""
        if self.most < 2 or self._late():
            return None
        self.halved = True
        inside = _Inside(self.plant, self.law, self.part, self.share * work.MAX_WORK)

        def along(box: Box) -> int | None:
            self.alpha = inside.leaving(box)
            return None if self.alpha or inside.full or self._late() else inside.widest(box)

        whole = Box.whole(domain_of(self.plant, self.law))
        with suppress(np.linalg.LinAlgError):  # a law without a value somewhere
            halves = list(whole.halves(inside.widest(whole)))
            parts = divided(halves, inside.proof, along, self.most)
            if parts is not None:
                pieces = (inside.piece(box, own) for box, own in parts)
                return part_of(Evidence([], cells=tuple(pieces)))
        return None

    def _late(self) -> bool:
        self.cut = self.cut or self.deadline.passed
        return self.cut


class _Inside:
    """A law and a part of a region in parts of the box.

    ``full`` is whether the proofs found take more work than they may.
    """

    def __init__(self, plant: UncertainPlant, law: Law, part: Region, most: float) -> None:
        self.plant, self.law, self.part, self.most = plant, law, part, most
        self.loop = loop_of(plant, law)
        self.claim = certificate_of(plant, law, part, [placeholder(plant, law)]).claim()
        first, *higher = IN_PARTS
        cheap = (form for form in higher if work_of(plant, law, form) <= MOST_IN_PART)
        self.forms, self.spent = (first, *cheap), 0

    @property
    def full(self) -> bool:
        return self.spent > self.most

    def proof(self, box: Box) -> Evidence | None:
        """Return evidence of low degree, None where none is proved."""
        claim = self.claim.inside(self.piece(box, self.claim.evidence[0]))
        own = self.loop.inside(box)
        for form in () if self.full else self.forms:
            for found in points_inside(own, self.part, form):
                X = [[[Fraction(e) for e in row] for row in Q] for Q in found.Q.tolist()]
                evidence = Evidence(X, *form)
                with suppress(work.FormatError), work.counted() as count:
                    if prove(replace(claim, evidence=(evidence,))).proved:
                        self.spent += count.spent
                        return evidence
        return None

    def leaving(self, box: Box) -> list[Fraction] | None:
        """Return an alpha at which a pole leaves the region, None if none was found."""
        piece = self.piece(box, self.claim.evidence[0])
        alpha = counterexample(self.claim.inside(piece))
        if alpha is None:
            return None
        own, whole = coordinates(alpha, self.claim.sizes)[1::2], [Fraction(1)]
        for low, high, t in zip(piece.low, piece.high, own, strict=True):
            at = low + (high - low) * t
            whole = [a * w for a in whole for w in (1 - at, at)]
        return whole

    def widest(self, box: Box) -> int:
        """Return the parameter along which the loop changes most."""
        domain = domain_of(self.plant, self.law)

        def loops(own: Array) -> Array:
            alpha = box.alpha(domain, own)
            A, B = self.plant.at(alpha)
            return np.asarray(A + B @ self.law.gain(alpha))

        return widest(domain, loops, lambda poles: -self.part.distance(poles))

    @staticmethod
    def piece(box: Box, own: Evidence) -> Piece:
        """Return a part with its evidence, in rationals."""
        low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
        return Piece(low, high, own)


def _most_parts(plant: UncertainPlant, law: Law, parts: int) -> int:
    """Return in how many parts of the box, at most, a claim is searched for and checked."""
    if not divisible(plant, law) or plant.remainder is not None:
        return 1
    blocks = _blocks(plant, law, IN_PARTS[-1]) * parts**2
    checked = matrices.least_work(blocks, 2 * plant.shape[0])
    found = MOST_PARTS * MOST_IN_PART / work_of(plant, law, IN_PARTS[0])
    return min(MOST_PARTS, work.MAX_WORK // checked, int(found))


def placeholder(plant: UncertainPlant, law: Law) -> dict[str, Any]:
    """Return evidence that has the shape of some, for a claim whose poles are to be looked at."""
    n, count = plant.shape[0], domain_of(plant, law).count(0)
    found = {"X": np.tile(np.eye(n), (count, 1, 1)), "degree": 0, "elevation": 0}
    if plant.remainder is not None:
        size = float(sum(x * x for row in plant.remainder.entries for x in row)) ** 0.5 or 1.0
        width = len(plant.remainder.entries[0])
        own = {"omega": np.eye(n), "rows": np.full(n, 2 * size), "columns": np.ones(width)}
        found["remainder"] = own
    return found


def evidence_of(found: LyapunovPolynomial, form: tuple[int, int]) -> dict[str, Any]:
    """Return what was found as a certificate has it."""
    evidence: dict[str, Any] = {"X": found.Q, "degree": form[0], "elevation": form[1]}
    evidence |= {"pieces": found.pieces} if found.pieces else {}
    return evidence if found.multiple is None else evidence | {"multiple": found.multiple}


def whole_evidence(
    plant: UncertainPlant, law: Law, found: LyapunovPolynomial, form: tuple[int, int]
) -> dict[str, Any]:
    """Return it with what a remainder of the plant asks for besides.

    Raises
    ------
    numpy.linalg.LinAlgError
        If what was found is no Lyapunov matrix, where there is a remainder.
    """
    return with_remainder(plant, law, evidence_of(found, form))


def with_remainder(plant: UncertainPlant, law: Law, evidence: dict[str, Any]) -> dict[str, Any]:
    """Return evidence with what a remainder of the plant asks for besides, as `whole_evidence`."""
    if plant.remainder is None:
        return evidence
    return evidence | {"remainder": _spread(plant, law, evidence)}


def certificate_of(
    plant: UncertainPlant, law: Law, region: Region, parts: Sequence[dict[str, Any]]
) -> Certificate:
    """Return the claim with its evidence, one for each part of the region."""
    evidence: dict[str, Any] = {"parts": tuple(parts)}
    if isinstance(law, FixedGain) and len(domain_of(plant, law).sizes) > 1:
        evidence["on"] = "box"
    return Certificate(plant, region, "lyapunov", law, evidence)
