"""Evidence that a given law keeps a region: of the whole box, then of parts of it.

Lyapunov polynomials of growing degree are tried for the whole box. Where they prove nothing it is
halved, along the parameter that changes the loop most, until low degrees do in each part; a part in
which a pole is found to leave the region refutes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.candidates import Deadline, first
from polefence.certify.certificate import Certificate, part_of
from polefence.certify.counterexample import counterexample, refutes
from polefence.certify.interpolated import interpolated
from polefence.certify.rational import lyapunov_matrices
from polefence.law.laws import (
    Law,
)
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.solve.along_motions import falling
from polefence.lmi.solve.loops import loop_of
from polefence.lmi.solve.lyapunov import MOST_STATES, WELL, LyapunovPolynomial, points_inside
from polefence.lmi.solve.one_loop import modal
from polefence.lmi.solve.spread import spread_of
from polefence.plant.boxes import MOST_BENT, MOST_PARTS, Box, divided, widest
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.parts import inside, node, off_along
from polefence.plant.system import Array
from polefence.proof import matrices, work
from polefence.proof.claims.base import prove
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, Piece
from polefence.proof.plant import lattice
from polefence.proof.polynomials import coordinates
from polefence.proof.ranges import ANY
from polefence.proof.remainder import Spread
from polefence.region.regions import Region

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
# The same, and pieces of each interval, beyond: where parameters move; inequalities at most.
FINER, MOST_FINER = (((2, 0), 2), ((3, 0), 4), ((4, 0), 8), ((5, 0), 16)), 300
# What a step of the search may cost, beyond the first form [multiplications].
MOST_WORK = 1e10
# The same where a parameter moves at any rate: there are no parts of the box then. Of a van with a
# dead time, 11 states and 4 parameters, it is 3.5e10, and takes 7 s.
MOST_MOVING = 1e11
# The ladder of one part of the box among many, of a cell of a table, of a region that grows: the
# whole one takes 2 to 10 times as long there, for 1 %.
FORMS = LADDER[:2]
MOST_IN_PART = 1e9  # what a step may cost there, beyond the first form

Holds = Callable[[UncertainPlant, Law, dict[str, Any]], bool]


def forms(plant: UncertainPlant, law: Law, parts: int = 1) -> Iterator[tuple[int, int]]:
    """Yield degree and elevation of the Lyapunov polynomials worth trying, the first whatever.

    Raises
    ------
    InputError
        If the plant is so large that the exact checker does not take even the first.
    """
    n = plant.shape[0]
    for form in LADDER[:1] if plant.noded else LADDER:
        blocks = _blocks(plant, law, form)
        checked = matrices.least_work(blocks * parts**2, 2 * n) <= work.MAX_WORK
        if form == LADDER[0]:
            if not checked and n <= MOST_STATES:
                raise InputError(f"{plant.name}: {blocks} inequalities are too many to be checked")
        elif (
            n > MOST_STATES
            or not checked
            or work_of(plant, law, form) > (MOST_MOVING if free(plant) else MOST_WORK)
        ):
            return
        yield form


def _blocks(plant: UncertainPlant, law: Law, form: tuple[int, int]) -> int:
    """Return how many inequalities a Lyapunov polynomial of a form has for a part of a region."""
    of_law = law.degree + law.denominator_degree
    return law.domain_of(plant).count(form[0] + plant.parts_degree + of_law + form[1])


def work_of(plant: UncertainPlant, law: Law, form: tuple[int, int]) -> float:
    """Return about what a step of the search for one costs [multiplications]."""
    n = plant.shape[0]
    unknowns = law.domain_of(plant).count(form[0]) * n * (n + 1) // 2
    unknowns //= (form[0] + 1) ** free(plant)
    return float(_blocks(plant, law, form) * unknowns**2 * (2 * n) ** 2)


def free(plant: UncertainPlant) -> int:
    """Return how many parameters move at any rate, of which no Lyapunov polynomial depends."""
    return sum(parameter.rate == ANY for parameter in plant.parameters if not plant.period)


def evidence_at(
    plant: UncertainPlant,
    law: Law,
    part: Region,
    form: tuple[int, int],
    pieces: int = 1,
    enough: float = WELL,
) -> dict[str, Any] | None:
    """Return evidence of a form, proved for one part of a region in pieces of the intervals.

    Parameters
    ----------
    enough : float
        How far inside the first point is that is sought, see `points_inside`.
    """

    def proved(polynomial: LyapunovPolynomial) -> dict[str, Any] | None:
        evidence = whole_evidence(plant, law, polynomial, form)
        holds = certificate_of(plant, law, part, [evidence]).holds()
        return evidence if holds else None

    with suppress(np.linalg.LinAlgError):  # a law without a value somewhere
        loop = replace(loop_of(plant, law), pieces=pieces_of(plant, pieces))
        by_modes = modal(loop, part) if form == LADDER[0] else iter(())
        return first(map(proved, chain(by_modes, points_inside(loop, part, form, enough))))
    return None


def pieces_of(plant: UncertainPlant, pieces: int) -> tuple[int, ...]:
    """Return so many pieces of the interval of each parameter that moves, one of others."""
    if pieces < 2:
        return ()
    return tuple(1 if parameter.rate in (None, ANY) else pieces for parameter in plant.parameters)


def finer(plant: UncertainPlant, law: Law) -> Iterator[tuple[tuple[int, int], int]]:
    """Yield forms and pieces beyond the ladder, where parameters move: there are no cells then."""
    motion = Motion.of(plant)
    moves = motion.moves if motion.centre is None else ()  # in discrete time X is affine
    for form, pieces in FINER if moves else ():
        blocks = _blocks(plant, law, form) * 2 ** len(moves)
        if blocks * pieces ** len(moves) <= MOST_FINER:
            yield form, pieces


def _spread(plant: UncertainPlant, law: Law, evidence: dict[str, Any]) -> dict[str, Any]:
    """Return what a remainder asks for besides, as a certificate has it."""
    multiple = tuple(map(Fraction, evidence["multiple"].tolist())) if "multiple" in evidence else ()
    X = [[[Fraction(e) for e in row] for row in Q] for Q in evidence["X"].tolist()]
    polynomial = Evidence(X, evidence["degree"], evidence["elevation"], multiple)
    spread = spread_of(plant, law, polynomial, driven=False)
    bounds = {key: getattr(spread, key) for key in ("omega", "rows", "columns")}
    return {key: np.array(value, dtype=float) for key, value in bounds.items()}


class Search:
    """The search for evidence of one part of a region, beyond the lowest form.

    ``last`` is the form of the whole box tried last, ``halved`` whether parts of it were, ``cut``
    whether a deadline ended it; ``alpha``, where there is one, refutes the region. ``parts`` is of
    how many the region is made, ``most`` how many of the box are tried, ``enough`` how far inside
    the first point of each is that is sought. ``between`` is whether evidence of them is
    interpolated, without an LMI.
    """

    def __init__(
        self,
        plant: UncertainPlant,
        law: Law,
        part: Region,
        deadline: Deadline,
        parts: int = 1,
        most: int = MOST_BENT,
        enough: float = WELL,
        between: bool = False,
    ) -> None:
        self.plant, self.law, self.part, self.deadline = plant, law, part, deadline
        self.enough = enough
        # the rest of what is checked in a file is for what else it claims
        self.between = between or plant.bent
        self.most, self.share = min(most, _most_parts(plant, law, parts, self.between)), 0.8 / parts
        self.last, self.halved, self.cut = LADDER[0], False, False
        self.alpha: list[Fraction] | None = None

    @property
    def tried(self) -> str:
        """What was tried, in words."""
        degree, elevation = self.last
        words = f"Lyapunov polynomials up to degree {degree}, elevation {elevation}"
        return words + f", nor in {self.most} parts of the box" * self.halved

    def proof(self, ladder: Sequence[tuple[int, int]]) -> dict[str, Any] | None:
        """Return evidence of a form of the whole box, else in parts of it."""
        first = bool(self.plant.moving) and self.plant.functions is not None
        if first:  # enclosed anew in each cell
            evidence = self._along_motions()
            if evidence is not None:
                return evidence
        for form in ladder:
            if self._late():
                return None
            self.last = form
            evidence = evidence_at(self.plant, self.law, self.part, form)
            if evidence is not None:
                return evidence
        for X in () if self.plant.bent else lyapunov_matrices(self.plant, self.law, self.part):
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
        return None if first else self.in_parts()

    def in_parts(self, holds: Holds | None = None) -> dict[str, Any] | None:
        """Return evidence in parts of the box, None where they would be too many.

        Parameters
        ----------
        holds : callable, optional
            Whether evidence will do for a part of the box, from the plant and the law there; by
            default where it is proved.
        """
        if self.plant.moving and self.plant.dead_time is None and holds is None:
            return self._along_motions()
        if self.most < 2 or self._late():
            return None
        self.halved = True
        most = self.share * work.MAX_IN_PARTS
        inside = _Inside(self.plant, self.law, self.part, most, holds, self.enough, self.between)

        def along(box: Box) -> int | None:
            self.alpha = inside.leaving(box)
            return None if self.alpha or inside.full or self._late() else inside.widest(box)

        whole = Box.whole(self.law.domain_of(self.plant))
        with suppress(np.linalg.LinAlgError):  # a law without a value somewhere
            halves = list(whole.halves(inside.widest(whole)))
            parts = divided(halves, inside.proof, along, self.most)
            if parts is not None:
                pieces = (inside.piece(box, proof) for box, proof in parts)
                return part_of(Evidence([], cells=tuple(pieces)))
        return None

    def _along_motions(self) -> dict[str, Any] | None:
        """Return evidence on the cells of a grid, where parameters move."""
        if not self.law.in_parts:
            return None
        for along in falling(self.plant, self.law, self.part):
            pieces = list[Piece]()
            for ends, X in zip(along.cells, along.X, strict=True):
                plant, law = inside(self.plant, *ends), self.law.inside(self.plant, *ends)
                found = {"X": X, "degree": along.degree, "elevation": 0}
                evidence = in_rationals(with_remainder(plant, law, found))
                pieces.append(Piece(*ends, evidence))
            whole = part_of(Evidence([], cells=tuple(pieces)))
            if certificate_of(self.plant, self.law, self.part, [whole]).holds():
                return whole
            if self._late():
                return None
        return None

    def _late(self) -> bool:
        self.cut = self.cut or self.deadline.passed
        return self.cut


class _Inside:
    """A law and a part of a region in parts of the box.

    ``full`` is whether the proofs found take more work than they may.
    """

    def __init__(
        self,
        plant: UncertainPlant,
        law: Law,
        part: Region,
        most: float,
        holds: Holds | None = None,
        enough: float = WELL,
        between: bool = False,
    ) -> None:
        self.plant, self.law, self.part, self.most, self.holds = plant, law, part, most, holds
        self.enough, self.between = enough, between
        self.loop = loop_of(plant, law)
        self.claim = certificate_of(plant, law, part, [placeholder(plant, law)]).claim()
        first, *higher = FORMS
        cheap = (form for form in higher if work_of(plant, law, form) <= MOST_IN_PART)
        self.forms, self.spent = (first, *cheap), 0

    @property
    def full(self) -> bool:
        return self.spent > self.most

    def proof(self, box: Box) -> Evidence | None:
        """Return evidence of low degree, None where none is proved."""
        piece, plant, law = self.piece(box, self.claim.evidence[0]), self.plant, self.law
        loop = self.loop.inside(box)
        if plant.remainder is not None or self.holds is not None or self.between:
            plant = inside(plant, piece.low, piece.high)
            law = law.inside(plant, piece.low, piece.high)
            loop = loop_of(plant, law)
        if self.full:
            return None
        for candidate in self._candidates(plant, law, loop):
            evidence = with_remainder(plant, law, candidate)
            if self.holds is None:
                held = self._proved(piece, in_rationals(evidence))
            else:
                held = self.holds(plant, law, evidence)
            if held:
                return in_rationals(evidence)
        return None

    def _proved(self, piece: Piece, evidence: Evidence) -> bool:
        claim = self._claim(piece).inside(piece)
        with suppress(work.FormatError), work.counted() as count:
            if prove(replace(claim, evidence=(evidence,))).proved:
                self.spent += count.spent
                return True
        return False

    def _candidates(self, plant: UncertainPlant, law: Law, loop: Loop) -> Iterator[dict[str, Any]]:
        """Yield evidence of a part of the box: between nodes by interpolation, else by LMIs."""
        if self.between:
            evidence = interpolated(plant, law, self.part)
            if evidence is not None:  # else the part is too large, and so it is for an LMI
                yield evidence
            return
        for form in self.forms:
            for polynomial in points_inside(loop, self.part, form, self.enough):
                yield evidence_of(polynomial, form)

    def _claim(self, piece: Piece) -> Poles:
        """Return the claim with the nodes of a part."""
        if not self.plant.noded:
            return self.claim
        points = lattice(piece.low, piece.high, self.plant.parts_degree)
        nodes = tuple(node(self.plant, at) for at in sorted(points) if set(at) - {0, 1})
        return replace(self.claim, nodes=nodes)

    def leaving(self, box: Box) -> list[Fraction] | None:
        """Return an alpha at which a pole leaves the region, None if none was found."""
        domain = self.law.domain_of(self.plant)
        poles = np.linalg.eigvals(self._loops(box.alpha(domain, domain.nodes(2))))
        if self.part.distance(poles).max() < 0:  # else it shows as the part is halved
            return None
        piece = self.piece(box, self.claim.evidence[0])
        alpha = counterexample(self._claim(piece).inside(piece))
        if alpha is None:
            return None
        uppers, whole = coordinates(alpha, self.claim.sizes)[1::2], [Fraction(1)]
        for low, high, t in zip(piece.low, piece.high, uppers, strict=True):
            at = low + (high - low) * t
            whole = [a * w for a in whole for w in (1 - at, at)]
        if self.plant.functions is None:
            return whole
        with suppress(work.FormatError):  # of a part it was shown of what is near the functions
            return whole if refutes(self.claim, whole) else None
        return None

    def widest(self, box: Box) -> int:
        """Return the parameter along which the loop changes most."""
        domain = self.law.domain_of(self.plant)
        return widest(
            domain,
            lambda inner: self._loops(box.alpha(domain, inner)),
            lambda poles: -self.part.distance(poles),
            off_along(self.plant, self.law.gain, box),
            () if self.plant.dead_time is None else self.plant.dead_time[:1],
        )

    def _loops(self, alpha: Array) -> Array:
        """Return the closed loops at points of the box."""
        A, B = self.plant.at(alpha)
        return np.asarray(A + B @ self.law.gain(alpha))

    @staticmethod
    def piece(box: Box, evidence: Evidence) -> Piece:
        """Return a part with its evidence, in rationals."""
        low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
        return Piece(low, high, evidence)


def _most_parts(plant: UncertainPlant, law: Law, parts: int, between: bool = False) -> int:
    """Return in how many parts of the box, at most, a claim is searched for and checked."""
    if not law.divisible(plant):
        return 1
    blocks = _blocks(plant, law, FORMS[-1]) * parts**2
    checked = matrices.least_work(blocks, 2 * plant.shape[0])
    if between:
        return min(MOST_BENT, work.MAX_IN_PARTS // checked)
    affordable = MOST_PARTS * MOST_IN_PART / work_of(plant, law, FORMS[0])
    return min(MOST_PARTS, work.MAX_WORK // checked, int(affordable))


def placeholder(plant: UncertainPlant, law: Law) -> dict[str, Any]:
    """Return evidence that has the shape of some, for a claim whose poles are to be looked at."""
    n, count = plant.shape[0], law.domain_of(plant).count(0)
    evidence = {"X": np.tile(np.eye(n), (count, 1, 1)), "degree": 0, "elevation": 0}
    if plant.remainder is not None:
        size = float(sum(x * x for row in plant.remainder.entries for x in row)) ** 0.5 or 1.0
        width = len(plant.remainder.entries[0])
        remainder = {"omega": np.eye(n), "rows": np.full(n, 2 * size), "columns": np.ones(width)}
        evidence["remainder"] = remainder
    return evidence


def evidence_of(polynomial: LyapunovPolynomial, form: tuple[int, int]) -> dict[str, Any]:
    """Return what was found as a certificate has it."""
    evidence: dict[str, Any] = {"X": polynomial.Q, "degree": form[0], "elevation": form[1]}
    evidence |= {"pieces": polynomial.pieces} if polynomial.pieces else {}
    return evidence if polynomial.multiple is None else evidence | {"multiple": polynomial.multiple}


def whole_evidence(
    plant: UncertainPlant, law: Law, polynomial: LyapunovPolynomial, form: tuple[int, int]
) -> dict[str, Any]:
    """Return it with what a remainder of the plant asks for besides.

    Raises
    ------
    numpy.linalg.LinAlgError
        If what was found is no Lyapunov matrix, where there is a remainder.
    """
    return with_remainder(plant, law, evidence_of(polynomial, form))


def in_rationals(evidence: dict[str, Any]) -> Evidence:
    """Return evidence of a part of a region, whole, in rationals."""
    X = [[[Fraction(e) for e in row] for row in Q] for Q in evidence["X"].tolist()]
    multiple = tuple(map(Fraction, evidence["multiple"].tolist())) if "multiple" in evidence else ()
    spread = None
    if "remainder" in evidence:
        rest = evidence["remainder"]
        omega = [[Fraction(e) for e in row] for row in rest["omega"].tolist()]
        rows, columns = (tuple(map(Fraction, rest[key].tolist())) for key in ("rows", "columns"))
        spread = Spread(omega, rows, columns)
    return Evidence(X, evidence["degree"], evidence["elevation"], multiple, spread=spread)


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
    if law.K is not None and law.domain_of(plant).on == "box":
        evidence["on"] = "box"
    return Certificate(plant, region, "lyapunov", law, evidence)
