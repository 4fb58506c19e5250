"""Questions about a law that is given: does it keep the region, and how far does it go."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.conditions.lyapunov import Loop
from polefence.conditions.target import Around, Decays, Disks, Goal, Sectors
from polefence.design import Design
from polefence.errors import InputError, SolverError
from polefence.law import FixedGain, Law, ScheduledGain
from polefence.placement import require_region
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.polynomial import Domain, bernstein, elevated, times
from polefence.proof import exact
from polefence.proof.certificate import Certificate
from polefence.proof.refute import counterexample, worst_points
from polefence.region import Disk, HalfPlane, Region, Sector, damping_of
from polefence.solve.given import Proof, least
from polefence.solve.radius import typical_rate

# Degree and elevation of the Lyapunov polynomial, one after the other.
LADDER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 1))
MOST_UNKNOWNS = 1500
INSIDE = (0.98, 0.0)
STEPS = (1e-6, 1e-5, 1e-4, 1e-3)
GAIN = 1e-4  # a proof within this share of the worst point is near enough


@dataclass(frozen=True, eq=False, repr=False)
class Analysis:
    """The answer to "does this law keep all poles in the region?".

    Attributes
    ----------
    answer : str
        "proved", "refuted" or "undecided".
    reason : str
    certificate : Certificate or None
        Of a proved answer: it saves and checks as a design's does.
    alpha : tuple of Fraction or None
        Of a refuted answer: where a pole is not in the region, exactly.
    pole : complex or None
        That pole, in floats.
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


@dataclass(frozen=True, eq=False, repr=False)
class WorstCase:
    """How far a law goes: the smallest region of a kind it is proved to keep, and what it fails.

    Attributes
    ----------
    region : Region or None
        Proved; None where nothing was.
    certificate : Certificate or None
    bound : float
        The measure (radius, decay rate or damping ratio) at the worst alpha found: no proof can
        pass it.
    alpha : tuple of float
        That alpha.
    """

    region: Region | None
    certificate: Certificate | None
    bound: float
    alpha: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<WorstCase: {self.region} proved, {self.bound:.6g} sampled>"


def analyse(plant: UncertainPlant, law: Any, region: Region, budget: float = 30.0) -> Analysis:
    """Prove or refute that a law keeps all poles of the whole family in a region.

    Lyapunov polynomials of growing degree are tried, one for each part of the region.

    Parameters
    ----------
    plant : UncertainPlant
    law : matrix, FixedGain, ScheduledGain, Design, or static python-control StateSpace
        u = K x. Of python-control's ``lqr``, whose u is -K x, give -K.
    region : Region
    budget : float
        Time after which no higher degree is begun [s].

    Raises
    ------
    InputError
        If the law does not fit the plant, or the region the plant's time.
    """
    law = given_law(plant, law)
    require_region(plant, region)
    certificate = _certificate(plant, law, region, [_nothing(plant, law)] * len(region.parts))
    alpha = counterexample(certificate.claim())
    if alpha is not None:
        return _refuted(plant, law, region, alpha)
    parts = []
    for part in region.parts:
        evidence = _part(plant, law, part, time.perf_counter() + budget)
        if evidence is None:
            reason = f"no Lyapunov polynomial was found for {part}, nor a counterexample"
            return Analysis(plant, law, region, "undecided", reason)
        parts.append(evidence)
    certificate = _certificate(plant, law, region, parts)
    verdict = certificate.prove()
    answer = "proved" if verdict.proved else "undecided"
    return Analysis(plant, law, region, answer, verdict.reason, certificate)


def _refuted(plant: UncertainPlant, law: Law, region: Region, alpha: list[Fraction]) -> Analysis:
    point = np.array([float(a) for a in alpha])
    A, B = plant.at(point)
    try:
        poles = np.linalg.eigvals(A + B @ law.gain(point))
        pole = complex(poles[np.argmax(region.distance(poles))])
    except np.linalg.LinAlgError:
        pole = complex("nan")
    weights = ", ".join(f"{float(a):.4g}" for a in alpha)
    reason = f"at alpha = ({weights}) the pole {pole:.6g} is not in the region"
    return Analysis(plant, law, region, "refuted", reason, None, tuple(alpha), pole)


def _part(plant: UncertainPlant, law: Law, part: Region, deadline: float) -> dict[str, Any] | None:
    """Return evidence that is proved for one part of a region."""
    for form in _forms(plant, law, deadline):
        for enough in INSIDE:
            with suppress(SolverError):
                found = least(_loop(plant, law), Around(part), *form, enough=enough)
                if found.r < 1:
                    evidence = _evidence(found, form)
                    if _certificate(plant, law, part, [evidence]).prove().proved:
                        return evidence
    return None


def _forms(plant: UncertainPlant, law: Law, deadline: float) -> Iterator[tuple[int, int]]:
    n, domain = plant.shape[0], _domain(plant, law)
    for degree, elevation in LADDER:
        few = domain.count(degree) * n * (n + 1) // 2 <= MOST_UNKNOWNS
        if (degree, elevation) == LADDER[0] or (few and time.perf_counter() < deadline):
            yield degree, elevation


def worst_case(
    plant: UncertainPlant,
    law: Any,
    of: str = "half_plane",
    centre: float | None = None,
    budget: float = 30.0,
) -> WorstCase:
    """Return the smallest region of a kind that a given law is proved to keep.

    Parameters
    ----------
    law
        As for `analyse`.
    of : str
        "half_plane" (the largest decay rate), "sector" (the largest damping ratio) or "disk".
    centre : float
        Of the disks [1/s].
    budget : float
        Time after which no higher degree is begun [s].

    Raises
    ------
    InputError
        If the law does not fit the plant, or the question is incomplete.
    """
    law = given_law(plant, law)
    if (of == "disk") != (centre is not None):
        raise InputError("of = 'disk' needs a centre (centre=-40, say), other questions have none")
    widest = HalfPlane(0) if centre is None else Disk(centre, 1e-6)
    require_region(plant, widest)
    claim = _certificate(plant, law, widest, [_nothing(plant, law)]).claim()
    measure = _measure(of, centre)
    point, worst = max(worst_points(claim, measure), key=lambda pair: pair[1])
    where = tuple(float(a) for a in Domain(exact.simplices(claim)).alpha(point))
    question = _question(of, centre, worst, typical_rate(plant.A))
    best: tuple[float, Region, Certificate] | None = None
    for form in _forms(plant, law, time.perf_counter() + budget):
        found = _tried(plant, law, question, form)
        if found is not None and (best is None or found[0] < best[0]):
            best = found
        if best is not None and best[0] <= question.bound * (1 + GAIN):
            break
    bound = worst if of == "disk" else -worst
    if best is None:
        return WorstCase(None, None, bound, where)
    return WorstCase(best[1], best[2], bound, where)


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
    """What grows with r, the region of an r, the r at the worst point found; where to begin."""

    goal: Goal
    region: Callable[[float], Region | None]
    bound: float
    first: Goal | None = None


def _question(of: str, centre: float | None, worst: float, rate: float) -> _Question:
    if centre is not None:
        c = float(centre)
        return _Question(Disks(c), lambda r: Disk(c, r), worst)
    if of == "half_plane":
        # just beyond the decay rate at the worst point, so that r is small
        fastest = -worst + max(abs(worst), 1e-3 * rate)
        return _Question(Decays(fastest), lambda r: HalfPlane(fastest - r), fastest + worst)
    slope = np.sqrt(max(1 / worst**2 - 1, 0.0)) if worst < 0 else np.inf
    return _Question(Sectors(rate), _sector, float(slope), Around(HalfPlane(0)))


def _sector(slope: float) -> Region | None:
    damping = damping_of(slope)
    return Sector(damping) if 1e-8 <= damping < 1 else None


def _tried(
    plant: UncertainPlant, law: Law, question: _Question, form: tuple[int, int]
) -> tuple[float, Region, Certificate] | None:
    loop, near = _loop(plant, law), None
    if question.first is not None:
        with suppress(SolverError):
            near = least(loop, question.first, *form, enough=INSIDE[0])
    for tolerance in (1e-8, 1e-6, 1e-4, 1e-2):
        with suppress(SolverError):
            found = least(loop, question.goal, *form, tolerance=tolerance, near=near)
            for step in (*STEPS, 1e-2):
                r = found.r * (1 + step)
                region = question.region(r)
                if region is not None:
                    certificate = _certificate(plant, law, region, [_evidence(found, form)])
                    if certificate.prove().proved:
                        return r, region, certificate
    return None


def given_law(plant: UncertainPlant, law: Any) -> FixedGain | ScheduledGain:
    """Return a law in any of the forms that users have it in, checked against the plant.

    Raises
    ------
    InputError
        If it is none, or does not fit.
    """
    if isinstance(law, Design):
        law = law.law
    if hasattr(law, "D") and hasattr(law, "nstates"):  # python-control
        if law.nstates:
            raise InputError(
                f"the controller has {law.nstates} states; give a static gain, or put its states "
                "into the plant"
            )
        law = law.D
    n, m = plant.shape
    if not isinstance(law, FixedGain | ScheduledGain):
        try:
            matrix = np.asarray(law, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"the gain is no {m} x {n} matrix of finite numbers") from error
        return given_law(plant, FixedGain(matrix))
    shape = law.K.shape if isinstance(law, FixedGain) else law.Z.shape[1:]
    if shape != (m, n):
        raise InputError(f"the gain is {shape[0]} x {shape[1]}; {plant.name} needs {m} x {n}")
    if isinstance(law, ScheduledGain) and law.domain.corners != len(plant.vertices):
        raise InputError(
            f"the law has {law.domain.corners} vertices; {plant.name} has {len(plant.vertices)}"
        )
    return law


def _domain(plant: UncertainPlant, law: Law) -> Domain:
    """Return where the claim is made: the law's own domain; the box where there are parameters."""
    if isinstance(law, ScheduledGain):
        return law.domain
    return Domain.of("box" if plant.parameters else "simplex", len(plant.vertices))


def _loop(plant: UncertainPlant, law: Law) -> Loop:
    n, domain = plant.shape[0], _domain(plant, law)
    AB = bernstein(domain, np.concatenate([plant.A, plant.B], axis=2), 1)
    if isinstance(law, FixedGain):
        eye = {(0,) * sum(domain.sizes): np.eye(n)}
        both = {(0,) * sum(domain.sizes): np.vstack([np.eye(n), law.K])}
        return Loop(elevated(eye, domain, 1), times(AB, both), domain)
    W = bernstein(domain, law.W, law.degree)
    both = bernstein(domain, np.concatenate([law.W, law.Z], axis=1), law.degree)
    return Loop(elevated(W, domain, 1), times(AB, both), domain, W)


def _evidence(found: Proof, form: tuple[int, int]) -> dict[str, Any]:
    evidence = {"X": found.Q, "degree": form[0], "elevation": form[1]}
    return evidence if found.multiple is None else evidence | {"multiple": found.multiple}


def _nothing(plant: UncertainPlant, law: Law) -> dict[str, Any]:
    """Return evidence that has the shape of some, for a claim to be looked at."""
    n, count = plant.shape[0], _domain(plant, law).count(0)
    return {"X": np.tile(np.eye(n), (count, 1, 1)), "degree": 0, "elevation": 0}


def _certificate(
    plant: UncertainPlant, law: Law, region: Region, parts: list[dict[str, Any]]
) -> Certificate:
    evidence: dict[str, Any] = {"parts": tuple(parts)}
    if isinstance(law, FixedGain) and len(_domain(plant, law).sizes) > 1:
        evidence["on"] = "box"
    return Certificate(plant, region, "lyapunov", law, evidence)
