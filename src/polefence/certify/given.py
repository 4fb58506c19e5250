"""Laws that are given: their poles in a region proved or refuted, and how far they go."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, overload

import numpy as np

from polefence.base.errors import InputError, RegionError, SolverError, require_type
from polefence.base.explained import explained
from polefence.base.processors import small_matrices
from polefence.base.renamed import warn_renamed
from polefence.certify.candidates import TOLERANCES, Deadline, first
from polefence.certify.certificate import Certificate
from polefence.certify.checks import in_time_of, require_continuous, require_region
from polefence.certify.counterexample import counterexample, first_worst, worst_points
from polefence.certify.decays import proved_decay
from polefence.certify.design import Design
from polefence.certify.evaluation import lyapunovs
from polefence.certify.evidence import (
    LADDER,
    Search,
    certificate_of,
    evidence_at,
    forms,
    placeholder,
    whole_evidence,
)
from polefence.certify.promised import GivenLyapunov, VerifiedBound, bounded, matrices_given
from polefence.certify.table import TableAnalysis, analyse_table
from polefence.law.compensator import beside
from polefence.law.laws import GainTable, Law
from polefence.lmi.conditions.lyapunov import Loop
from polefence.lmi.conditions.target import Around, Decays, Disks, Goal, Sectors
from polefence.lmi.solve.loops import loop_of
from polefence.lmi.solve.lyapunov import LyapunovPolynomial, least
from polefence.lmi.solve.one_loop import modal
from polefence.lmi.solve.smallest import typical_rate
from polefence.plant.boxes import MOST_BENT
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at, values_text
from polefence.plant.system import Array
from polefence.plant.weights import weights_poles
from polefence.proof.claims.decay import Decay
from polefence.proof.short import Short
from polefence.region.regions import Disk, HalfPlane, Region, Sector, damping_of
from polefence.requirements.specification import Specification

# How far beyond the r that a point reaches in floats the exact proof is attempted.
STEPS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)

_Proved = tuple[float, Region, Certificate]  # with its r


@dataclass(frozen=True, eq=False, repr=False)
class Analysis(Short):
    """The answer to "does this law keep all poles in the region, and these limits?".

    Attributes
    ----------
    plant, law, region
        The question.
    kept : str
        Whether the region is kept: "proved", "refuted" or "undecided".
    reason : str
        Why that is so.
    certificate : Certificate or None
        Of a region that is proved: it saves and checks as a design's does.
    alpha : tuple of Fraction or None
        Of a region that is refuted: where a pole is not in it, exactly.
    pole : complex or None
        That pole, in floats [1/s].
    lyapunov : GivenLyapunov or None
        Of the matrices that came with the law.
    bounds : tuple of VerifiedBound
        Of each limit; none where the region is refuted.
    decay : Decay or None
        How fast the loop decays for periods in any order, of a clock that is not perfect, where an
        rms is proved for it.
    """

    plant: UncertainPlant
    law: Law
    region: Region
    kept: str
    reason: str
    certificate: Certificate | None = None
    alpha: tuple[Fraction, ...] | None = None
    pole: complex | None = None
    lyapunov: GivenLyapunov | None = None
    bounds: tuple[VerifiedBound, ...] = ()
    decay: Decay | None = None

    def __repr__(self) -> str:
        return f"<Analysis of {self.plant.name!r}: {self.region}, {self.answer}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        poles = f"{self.kept}: in {self.region}"
        bounds = (
            (
                limit.specification.title,
                limit.answer if limit.bound is None else f"{limit.answer}: {limit.bound}",
            )
            for limit in self.bounds
        )
        picture = self.design.plot().small if self.kept == "proved" else ""
        return card(self.plant.name, [("poles", poles), ("by", self.reason), *bounds], picture)

    @property
    def answer(self) -> str:
        """Say "proved" (all that was asked), "refuted" (some of it) or "undecided"."""
        answers = {self.kept, *(limit.answer for limit in self.bounds)}
        return next(answer for answer in ("refuted", "undecided", "proved") if answer in answers)

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
        """The law, region and certificate as a design, to save or draw, with the proved bounds.

        Raises
        ------
        InputError
            If the region is not proved.
        """
        if self.certificate is None:
            raise InputError(f"the region is {self.kept}; only a proved one makes a design")
        claims = tuple(limit.bound.claim for limit in self.bounds if limit.bound is not None)
        decay = () if self.decay is None else (self.decay,)
        return Design(self.certificate, more=(*claims, *decay))

    def save(self, directory: str | Path) -> Path:
        """Write ``design.json``, with region and proved bounds, into a folder; return its path.

        Raises
        ------
        InputError
            If the region is not proved.
        OutputError
            If the folder cannot be written.
        """
        return self.design.save(directory)

    @property
    def analysis(self) -> Analysis:
        """The old name of what is said of the poles."""
        warn_renamed("Verified.analysis", "Analysis")
        return replace(self, lyapunov=None, bounds=())

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
    plant: UncertainPlant,
    law: Any,
    region: Region,
    budget: float | None = ...,
    depth: int = ...,
    *,
    limits: Sequence[Specification] = ...,
    lyapunov: Sequence[Any] = ...,
) -> Analysis: ...


@explained
@small_matrices()
def analyse(
    plant: UncertainPlant,
    law: Any,
    region: Region,
    budget: float | None = None,
    depth: int = 4,
    *,
    limits: Sequence[Specification] = (),
    lyapunov: Sequence[Any] = (),
) -> Analysis | TableAnalysis:
    """Prove or refute that a given law keeps all poles in a region, and limits on signals.

    For one gain, or a law Z W^-1: Lyapunov polynomials of growing degree are tried, one for each
    part of the region; where those that are cheap do not prove it, one for each of some parts of
    the box. For a table of gains: cell by cell, see `TableAnalysis`. For a plant with parameters
    the family is that of the parameters' box.

    Lyapunov matrices that came with the law are decided on as they are, as V = x' P x and as
    V = x' P^-1 x. Whatever they prove, the answer on the poles is the best that is found here.

    Parameters
    ----------
    plant : UncertainPlant
    law : (m, n) matrix, any law of `polefence.law`, Design, Compensator, or of python-control
        u = K x, or u = K y of a `Compensator`, a ``StateSpace`` or a ``TransferFunction``, which
        may have states: `Analysis.plant` has them behind the plant's. Of python-control's ``lqr``,
        whose u is -K x, give -K. Rows of texts are a gain in the parameters,
        ``[["-3 - 2*L", "L**2"]]``, or transfer functions, ``[["(s + 50)/(s + 500)"]]``.
    region : Region
    budget : float, optional
        Time after which no higher degree is begun, and no cell halved [s]; the answer then says
        so. Without one the counted size of the next step alone ends the search.
    depth : int
        How often a cell of a table may be halved.
    limits : sequence of Specification
        Each with its limit, ``at_most``; without one the least bound that can be proved is asked
        for. None of a table.
    lyapunov : sequence of (n, n) matrices
        One, or one a vertex: P(alpha) is the sum of alpha_j P_j. Only for one gain K.

    Returns
    -------
    Analysis or TableAnalysis
        The latter for a table.

    Raises
    ------
    InputError
        If law, limits or matrices do not fit the plant, or the region the plant's time.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    plant, law = beside(plant, law)
    if isinstance(law, GainTable):
        if len(limits) or len(lyapunov):
            raise InputError("of a table of gains poles are proved alone: no limits, no lyapunov")
        return analyse_table(plant, law, region, depth, budget)
    require_type(region, Region, "region", "for example polefence.Disk(-40, 31)")
    region = in_time_of(plant, region)
    require_region(plant, region)
    for limit in limits:
        limit.require_fit(plant)
    given, certificate = None, None
    if len(lyapunov):
        given, certificate = matrices_given(plant, law, region, lyapunov)
    if certificate is None:
        analysis = analysed(plant, law, region, Deadline(budget))
    else:
        reason = certificate.prove().reason
        analysis = Analysis(plant, law, region, "proved", reason, certificate)
    asked = limits if analysis.kept != "refuted" else ()
    bounds = tuple(bounded(plant, law, limit) for limit in asked)
    proved = [one.bound for one in bounds if one.bound is not None]
    decay = proved_decay(plant, law, proved)
    analysis = replace(analysis, lyapunov=given, bounds=bounds, decay=decay)
    if analysis.certificate is not None:
        analysis.certificate.require_checkable(analysis.design.more)
    return analysis


def verify(
    plant: UncertainPlant,
    law: Any,
    region: Region,
    lyapunov: Sequence[Any] = (),
    limits: Sequence[Specification] = (),
    budget: float | None = None,
) -> Analysis:
    """Call `analyse` by its old name."""
    warn_renamed("verify", "analyse")
    if isinstance(law, GainTable):
        raise InputError("a table of gains is analysed, not verified: polefence.analyse")
    return analyse(plant, law, region, budget, limits=limits, lyapunov=lyapunov)


def analysed(
    plant: UncertainPlant,
    law: Law,
    region: Region,
    deadline: Deadline,
    like: Certificate | None = None,
) -> Analysis:
    """Return what is proved of one law.

    With ``like``, a certificate of the law, as little is tried as proved that one: no higher form,
    at most twice the parts of the box.
    """
    ladder = list(forms(plant, law, len(region.parts)))
    most = MOST_BENT
    if like is not None:
        proofs = [proof for _, proof in lyapunovs(like)]
        form = max((proof.degree, proof.elevation or 0) for proof in proofs)
        ladder = [*ladder[:1], *(higher for higher in ladder[1:] if higher <= form)]
        most = 2 * len(proofs) if like.in_parts else 1
    claim = certificate_of(plant, law, region, [placeholder(plant, law)] * len(region.parts))
    parts = list[dict[str, Any]]()
    # of the lowest degree first: most laws that keep a region need no other
    pieces = [evidence_at(plant, law, part, ladder[0]) for part in region.parts]
    if None in pieces:
        alpha = counterexample(claim.claim())
        if alpha is not None:
            return _refuted(plant, law, region, alpha)
    for part, evidence in zip(region.parts, pieces, strict=True):
        search = Search(plant, law, part, deadline, len(region.parts), most)
        proof = evidence or search.proof(ladder[1:])
        if search.alpha is not None:
            return _refuted(plant, law, region, search.alpha)
        if proof is None:
            reason = f"no proof for {part} with {search.tried}; no counterexample either"
            reason += f"; {deadline}" if search.cut else ""
            return Analysis(plant, law, region, "undecided", reason)
        parts.append(proof)
    certificate = certificate_of(plant, law, region, parts)
    verdict = certificate.prove()
    if not verdict.proved:
        return Analysis(plant, law, region, "undecided", verdict.reason)
    return Analysis(plant, law, region, "proved", verdict.reason, certificate)


def pole_at(
    plant: UncertainPlant, law: Law, region: Region, alpha: Sequence[Fraction]
) -> tuple[complex | None, str]:
    """Return the pole farthest outside a region at alpha, and a sentence; None where none is."""
    point = np.array([float(a) for a in alpha])
    A, B = plant.at(point)
    try:
        poles = np.linalg.eigvals(A + B @ law.gain(point))
    except np.linalg.LinAlgError:
        return None, "the law has no value"
    pole = complex(poles[np.argmax(region.distance(poles))])
    shown = f"{pole:.6g}" if pole.imag else f"{pole.real:.6g}"
    return pole, f"the pole {shown}{_of_weight(plant, pole)} is not in {region}"


def _refuted(plant: UncertainPlant, law: Law, region: Region, alpha: list[Fraction]) -> Analysis:
    pole, what = pole_at(plant, law, region, alpha)
    point = [float(a) for a in alpha]
    weights = f"alpha = ({', '.join(f'{a:.6g}' for a in point)})"
    values = values_at(plant, alpha)
    if values is not None:
        weights = f"{values_text(plant, values)}, {weights}"
    elif plant.parameters:
        weights += ", which no parameter values have,"
    reason = what if len(plant.vertices) == 1 else f"at {weights} {what}"
    if plant.remainder is not None and plant.functions is None:
        reason += ", of the samples to within their interpolation error"
    return Analysis(plant, law, region, "refuted", reason, None, tuple(alpha), pole)


def _of_weight(plant: UncertainPlant, pole: complex) -> str:
    """Say of which weight a pole is: one that the law does not move."""
    for name, own in weights_poles(plant).items():
        if np.abs(own - pole).min() <= 1e-7 * (np.abs(own).max() or 1.0):
            return f" of the weight of {name!r}"
    return ""


@dataclass(frozen=True, eq=False, repr=False)
class WorstCase(Short):
    """Reach of a law: the smallest region of a kind it is proved to keep, and what it fails.

    Attributes
    ----------
    region : Region or None
        Proved; None where nothing was.
    certificate : Certificate or None
        That of the region: ``Design(certificate)`` saves and checks.
    bound : float
        The radius or decay rate [1/s], or the damping ratio, at the worst alpha found: no proof
        can pass it.
    alpha : tuple of float
        That alpha.
    values : dict or None
        The parameters' values there.
    cut : bool
        Whether the budget in seconds ended the search.
    """

    region: Region | None
    certificate: Certificate | None
    bound: float
    alpha: tuple[float, ...]
    values: dict[str, float] | None = None
    cut: bool = False

    def __repr__(self) -> str:
        return f"<WorstCase: {self.region} proved, {self.bound:.6g} sampled>"


@explained
@small_matrices()
def worst_case(
    plant: UncertainPlant,
    law: Any,
    of: str = "half_plane",
    centre: float | None = None,
    budget: float | None = None,
) -> WorstCase:
    """Return the smallest region of a kind that a given law is proved to keep.

    Parameters
    ----------
    plant : UncertainPlant
    law
        As for `analyse`, but no table.
    of : str
        "half_plane" (the largest decay rate), "sector" (the largest damping ratio) or "disk".
    centre : float
        Of the disks [1/s].
    budget : float, optional
        Time after which no higher degree is begun [s]; ``cut`` then says so.

    Raises
    ------
    InputError
        If the law does not fit the plant, or the question is incomplete.
    """
    require_type(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    plant, law = beside(plant, law)
    plant.require_on_time("with which no smallest region is sought", "ask about half_plane(a)")
    if isinstance(law, GainTable):
        raise InputError("worst_case is for one law; analyse a table with a region")
    if (of == "disk") != (centre is not None):
        raise InputError("of = 'disk' needs a centre (centre=-40, say), other questions take none")
    measure = _measure(of, centre)
    if centre is None:
        require_continuous(plant, of)
    widest = HalfPlane(0) if centre is None else Disk(centre, 1e-6)
    require_region(plant, widest)
    ladder = forms(plant, law)
    deadline = Deadline(budget)
    claim = certificate_of(plant, law, widest, [placeholder(plant, law)]).claim()
    point, worst = first_worst(worst_points(claim, measure))
    alpha = tuple(float(a) for a in law.domain_of(plant).alpha(point))
    question = _question(of, centre, worst, typical_rate(plant.A), plant.sample_time is not None)
    best: _Proved | None = None
    cut = False
    for form in ladder if np.isfinite(question.bound) else ():
        by_modes = _by_modes(plant, law, question) if form == LADDER[0] else None
        reached = by_modes or _tried(plant, law, question, form)
        if reached is not None and (best is None or reached[0] < best[0]):
            best = reached
        near = best is not None and best[0] <= question.bound * (1 + 1e-4)
        cut = not near and deadline.passed
        if near or cut:
            break
    else:
        best, cut = _beyond(plant, law, question, best, deadline)
    bound, values = worst if of == "disk" else 0.0 - worst, values_at(plant, alpha)
    if best is None:
        return WorstCase(None, None, bound, alpha, values, cut)
    best[2].require_checkable()
    return WorstCase(best[1], best[2], bound, alpha, values, cut)


def _measure(of: str, centre: float | None) -> Callable[[Any], Array]:
    """Return how bad poles are: distance from the centre, or minus decay rate or damping ratio."""
    if centre is not None:
        return lambda z: np.asarray(np.abs(z - centre).max(axis=-1))
    if of == "half_plane":
        return lambda z: np.asarray(np.real(z).max(axis=-1))
    if of == "sector":
        return lambda z: np.asarray((np.real(z) / np.maximum(np.abs(z), 1e-300)).max(axis=-1))
    raise InputError(f"of = {of!r} is unknown; use 'disk', 'half_plane' or 'sector'")


@dataclass(frozen=True, eq=False)
class _Question:
    """A region that grows with r, the r at the worst point found, and where to begin."""

    goal: Goal
    region: Callable[[float], Region | None]
    bound: float
    first: Goal | None = None


def _question(
    of: str, centre: float | None, worst: float, rate: float, discrete: bool
) -> _Question:
    if centre is not None:
        c = float(centre)
        return _Question(Disks(c), lambda r: _disk(c, r, discrete), worst)
    if of == "half_plane":
        # just beyond the decay rate at the worst point, so that r is small
        fastest = -worst + max(abs(worst), 1e-3 * rate)
        return _Question(Decays(fastest), lambda r: HalfPlane(fastest - r), fastest + worst)
    slope = np.sqrt(max(1 / worst**2 - 1, 0.0)) if worst < 0 else np.inf
    return _Question(Sectors(rate), _sector, float(slope), Around(HalfPlane(0)))


def _disk(centre: float, radius: float, discrete: bool) -> Region | None:
    with suppress(RegionError):  # in discrete time, a disk that leaves the unit circle
        disk = Disk(centre, radius)
        return disk if disk.discrete or not discrete else None
    return None


def _sector(slope: float) -> Region | None:
    damping = damping_of(slope)
    return Sector(damping) if 1e-8 <= damping < 1 else None


def _tried(
    plant: UncertainPlant, law: Law, question: _Question, form: tuple[int, int]
) -> _Proved | None:
    """Return the least r that is proved with polynomials of one form, with its region."""

    def proved(polynomial: LyapunovPolynomial, r: float) -> _Proved | None:
        region = question.region(r)
        if region is None:
            return None
        with suppress(np.linalg.LinAlgError):
            evidence = whole_evidence(plant, law, polynomial, form)
            certificate = certificate_of(plant, law, region, [evidence])
            return (r, region, certificate) if certificate.holds() else None
        return None

    points = _points(loop_of(plant, law), question, form)
    steps = STEPS if plant.remainder is None else (*STEPS, 3e-2, 1e-1)
    return first(proved(point, point.r * (1 + step)) for point in points for step in steps)


def _by_modes(plant: UncertainPlant, law: Law, question: _Question) -> _Proved | None:
    """Return the least r that the modes of one loop prove, with its region; also of many states."""
    with suppress(np.linalg.LinAlgError):
        loop = loop_of(plant, law)
        for r in (question.bound * (1 + step) for step in STEPS):
            region = question.region(r)
            if region is None:
                continue
            for polynomial in modal(loop, region):
                evidence = whole_evidence(plant, law, polynomial, LADDER[0])
                certificate = certificate_of(plant, law, region, [evidence])
                if certificate.holds():
                    return r, region, certificate
    return None


def _beyond(
    plant: UncertainPlant, law: Law, question: _Question, best: _Proved | None, deadline: Deadline
) -> tuple[_Proved | None, bool]:
    """Return the least r that is proved in parts of the box, else the best; whether it was cut."""
    # beyond the worst point
    for step in (1e-4, 1e-3, 1e-2) if np.isfinite(question.bound) else ():
        r = question.bound * (1 + step)
        region = question.region(r)
        if region is None or (best is not None and best[0] <= r):
            continue
        search = Search(plant, law, region, deadline)
        evidence = search.in_parts()
        if evidence is not None:
            certificate = certificate_of(plant, law, region, [evidence])
            if certificate.holds():
                return (r, region, certificate), False
        if search.cut:
            return best, True
    return best, False


def _points(loop: Loop, question: _Question, form: tuple[int, int]) -> Iterator[LyapunovPolynomial]:
    """Yield points farther and farther from the edge."""
    near = None
    if question.first is not None:
        with suppress(SolverError):
            near = least(loop, question.first, *form, enough=0.98)
    for tolerance in TOLERANCES:
        with suppress(SolverError):
            yield least(loop, question.goal, *form, tolerance=tolerance, near=near)
