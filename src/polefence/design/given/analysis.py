"""Analysis of a given law: all poles in a region, proved, refuted or undecided."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, overload

import numpy as np

from polefence.base.errors import InputError, require_type
from polefence.design.certificate import Certificate
from polefence.design.checks import require_region
from polefence.design.counterexample import counterexample
from polefence.design.design import Design
from polefence.design.given.table import TableAnalysis, analyse_table
from polefence.design.search import Deadline, first
from polefence.law.laws import FixedGain, Law, ScheduledGain, domain_of, given_law
from polefence.law.table import GainTable
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, points_inside
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at, values_text
from polefence.plant.polynomial import bernstein, elevated, times
from polefence.plant.system import Array
from polefence.proof import definite, work
from polefence.region.regions import Region

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
# What a step of the search may cost, beyond the first form [multiplications].
MOST_WORK = 1e10


@dataclass(frozen=True, eq=False, repr=False)
class Analysis:
    """The answer to "does this law keep all poles in the region?".

    Attributes
    ----------
    plant, law, region
        The question.
    answer : str
        "proved", "refuted" or "undecided".
    reason : str
    certificate : Certificate or None
        Of a proved answer: it saves and checks as a design's does.
    alpha : tuple of Fraction or None
        Of a refuted answer: where a pole is not in the region, exactly.
    pole : complex or None
        That pole, in floats [1/s].
    """

    plant: UncertainPlant
    law: Law
    region: Region
    answer: str
    reason: str
    certificate: Certificate | None = None
    alpha: tuple[Fraction, ...] | None = None
    pole: complex | None = None

    def __repr__(self) -> str:
        return f"<Analysis of {self.plant.name!r}: {self.region}, {self.answer}>"

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    @property
    def values(self) -> dict[str, float] | None:
        """The parameters' values at ``alpha``; None without, or where none have this alpha."""
        return None if self.alpha is None else values_at(self.plant, self.alpha)

    @property
    def design(self) -> Design:
        """The law, region and certificate as a design, to save or draw.

        Raises
        ------
        InputError
            If the answer is not "proved".
        """
        if self.certificate is None:
            raise InputError(f"the analysis is {self.answer}; only a proved one makes a design")
        return Design(self.certificate)

    def poles(self, alpha: Array) -> Array:
        """Closed-loop poles at points alpha (..., N) of the simplex, as (..., n) complex."""
        A, B = self.plant.at(alpha)
        return np.asarray(np.linalg.eigvals(A + B @ self.law.gain(alpha)))


@overload
def analyse(
    plant: UncertainPlant,
    law: GainTable,
    region: Region,
    budget: float | None = ...,
    depth: int = ...,
) -> TableAnalysis: ...


@overload
def analyse(
    plant: UncertainPlant, law: Any, region: Region, budget: float | None = ..., depth: int = ...
) -> Analysis: ...


def analyse(
    plant: UncertainPlant, law: Any, region: Region, budget: float | None = None, depth: int = 4
) -> Analysis | TableAnalysis:
    """Prove or refute that a given law keeps all poles of the whole family in a region.

    For one gain, or a law Z W^-1: Lyapunov polynomials of growing degree are tried, one for each
    part of the region. For a table of gains: cell by cell, see `TableAnalysis`. For a plant with
    parameters the family is that of the parameters' box.

    Parameters
    ----------
    plant : UncertainPlant
    law : (m, n) matrix, FixedGain, ScheduledGain, Design, GainTable or control.StateSpace
        u = K x. Of python-control's ``lqr``, whose u is -K x, give -K. A ``StateSpace`` must be a
        static gain.
    region : Region
    budget : float, optional
        Time after which no higher degree is begun, and no cell halved [s]; the answer then says
        so. Without one the counted size of the next step alone ends the search.
    depth : int
        How often a cell of a table may be halved.

    Returns
    -------
    Analysis or TableAnalysis
        The latter for a table.

    Raises
    ------
    InputError
        If the law does not fit the plant, or the region the plant's time.
    """
    if isinstance(law, GainTable):
        return analyse_table(plant, law, region, depth, budget)
    law = given_law(plant, law)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    require_region(plant, region)
    ladder = list(forms(plant, law, len(region.parts)))
    claim = certificate_of(plant, law, region, [placeholder(plant, law)] * len(region.parts))
    alpha = counterexample(claim.claim())
    if alpha is not None:
        return _refuted(plant, law, region, alpha)
    deadline = Deadline(budget)
    parts = []
    for part in region.parts:
        evidence, last = _part(plant, law, part, ladder, deadline)
        if evidence is None:
            reason = (
                f"no proof for {part} with Lyapunov polynomials up to degree {last[0]}, elevation "
                f"{last[1]}; no counterexample either"
            )
            if deadline.passed and last != ladder[-1]:
                reason += f"; {deadline}"
            return Analysis(plant, law, region, "undecided", reason)
        parts.append(evidence)
    certificate = certificate_of(plant, law, region, parts)
    verdict = certificate.prove()
    answer = "proved" if verdict.proved else "undecided"
    return Analysis(plant, law, region, answer, verdict.reason, certificate)


def _part(
    plant: UncertainPlant,
    law: Law,
    part: Region,
    ladder: list[tuple[int, int]],
    deadline: Deadline,
) -> tuple[dict[str, Any] | None, tuple[int, int]]:
    """Return evidence that is proved for one part of a region, and the form tried last."""
    last, loop = ladder[0], loop_of(plant, law)

    def proved(found: LyapunovPolynomial) -> dict[str, Any] | None:
        evidence = evidence_of(found, last)
        holds = certificate_of(plant, law, part, [evidence]).prove().proved
        return evidence if holds else None

    for form in ladder:
        if form != ladder[0] and deadline.passed:
            break
        last = form
        evidence = first(map(proved, points_inside(loop, part, form)))
        if evidence is not None:
            return evidence, form
    return None, last


def _refuted(plant: UncertainPlant, law: Law, region: Region, alpha: list[Fraction]) -> Analysis:
    point = np.array([float(a) for a in alpha])
    A, B = plant.at(point)
    try:
        poles = np.linalg.eigvals(A + B @ law.gain(point))
        pole = complex(poles[np.argmax(region.distance(poles))])
        shown = f"{pole:.6g}" if pole.imag else f"{pole.real:.6g}"
        what = f"the pole {shown} is not in {region}"
    except np.linalg.LinAlgError:
        pole, what = None, "the law has no value"
    weights = f"alpha = ({', '.join(f'{a:.6g}' for a in point)})"
    values = values_at(plant, alpha)
    if values is not None:
        weights = f"{values_text(plant, values)}, {weights}"
    elif plant.parameters:
        weights += ", which no parameter values have,"
    reason = f"at {weights} {what}"
    return Analysis(plant, law, region, "refuted", reason, None, tuple(alpha), pole)


def loop_of(plant: UncertainPlant, law: Law) -> Loop:
    """Return the closed loop as a quotient of polynomials."""
    return _loop(plant, law, np.concatenate([plant.A, plant.B], axis=2))


def loop_with(plant: UncertainPlant, law: Law, C: Array, D: Array) -> Loop:
    """Return the closed loop with the rows of y = C x + D u, (N, p, n) and (N, p, m), below it."""
    rows = [np.concatenate([plant.A, C], axis=1), np.concatenate([plant.B, D], axis=1)]
    return _loop(plant, law, np.concatenate(rows, axis=2))


def _loop(plant: UncertainPlant, law: Law, rows: Array) -> Loop:
    n, domain = plant.shape[0], domain_of(plant, law)
    AB = bernstein(domain, rows, 1)
    if isinstance(law, FixedGain):
        eye = {(0,) * sum(domain.sizes): np.eye(n)}
        both = {(0,) * sum(domain.sizes): np.vstack([np.eye(n), law.K])}
        return Loop(elevated(eye, domain, 1), times(AB, both), domain)
    W = bernstein(domain, law.W, law.degree)
    both = bernstein(domain, np.concatenate([law.W, law.Z], axis=1), law.degree)
    return Loop(elevated(W, domain, 1), times(AB, both), domain, W)


def forms(plant: UncertainPlant, law: Law, parts: int = 1) -> Iterator[tuple[int, int]]:
    """Yield degree and elevation of the Lyapunov polynomials worth trying, the first whatever.

    Raises
    ------
    InputError
        If the plant is so large that the exact checker does not take even the first.
    """
    n, domain = plant.shape[0], domain_of(plant, law)
    own = 2 * law.degree if isinstance(law, ScheduledGain) else 0
    for degree, elevation in LADDER:
        blocks = domain.count(degree + 1 + own + elevation)
        unknowns = domain.count(degree) * n * (n + 1) // 2
        checked = definite.least_work(blocks * parts**2, 2 * n) <= work.MAX_WORK
        if (degree, elevation) == LADDER[0]:
            if not checked:
                raise InputError(f"{plant.name}: {blocks} inequalities are more than is checked")
        elif not checked or blocks * unknowns**2 * (2 * n) ** 2 > MOST_WORK:
            return
        yield degree, elevation


def placeholder(plant: UncertainPlant, law: Law) -> dict[str, Any]:
    """Return evidence that has the shape of some, for a claim whose poles are to be looked at."""
    n, count = plant.shape[0], domain_of(plant, law).count(0)
    return {"X": np.tile(np.eye(n), (count, 1, 1)), "degree": 0, "elevation": 0}


def evidence_of(found: LyapunovPolynomial, form: tuple[int, int]) -> dict[str, Any]:
    """Return what was found as a certificate has it."""
    evidence = {"X": found.Q, "degree": form[0], "elevation": form[1]}
    return evidence if found.multiple is None else evidence | {"multiple": found.multiple}


def certificate_of(
    plant: UncertainPlant, law: Law, region: Region, parts: Sequence[dict[str, Any]]
) -> Certificate:
    """Return the claim with its evidence, one for each part of the region."""
    evidence: dict[str, Any] = {"parts": tuple(parts)}
    if isinstance(law, FixedGain) and len(domain_of(plant, law).sizes) > 1:
        evidence["on"] = "box"
    return Certificate(plant, region, "lyapunov", law, evidence)
