"""What a design of another tool comes with: Lyapunov matrices, and promised bounds on signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import islice
from math import inf
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.certify.bounds import Bound, best_bound, kept_bound, sampled, worst_of
from polefence.certify.by_transfer import ByTransfer
from polefence.certify.certificate import Certificate
from polefence.certify.evidence import certificate_of, placeholder
from polefence.law.laws import Law
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.points import values_at
from polefence.plant.system import read_matrix
from polefence.proof import laws
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.poles import Poles
from polefence.proof.matrices import Rationals
from polefence.proof.short import Short
from polefence.proof.work import FormatError
from polefence.region.regions import Region
from polefence.requirements.specification import Specification

ELEVATIONS = (0, 1, 2, 3)  # of (sum of alpha)^d, one after the other


@dataclass(frozen=True)
class GivenLyapunov(Short):
    """Whether Lyapunov matrices that were given prove that a law keeps a region.

    Attributes
    ----------
    form : str
        "primal", V = x' P x, or "dual", V = x' P^-1 x, where it is proved; else "".
    count : int
        How many matrices: one, or one a vertex.
    reason : str
    """

    form: str
    count: int
    reason: str

    @property
    def proved(self) -> bool:
        """Whether they prove it."""
        return bool(self.form)

    @property
    def words(self) -> str:
        """The Lyapunov function that they are."""
        return {"primal": "V = x' P x", "dual": "V = x' P^-1 x"}.get(self.form, "")


@dataclass(frozen=True, eq=False)
class VerifiedBound(Short):
    """A limit on a signal, and what is proved of it.

    Attributes
    ----------
    specification : Specification
    answer : str
        "proved", "refuted" (at a point, computed in floats) or "undecided".
    bound : Bound or None
        The least bound that was proved, below the limit or not; None where the limit is refuted.
    worst : float
        The largest of some samples, in the signal's unit.
    alpha : tuple of float
        Where that is.
    values : dict or None
        The parameters' values there.
    """

    specification: Specification
    answer: str
    bound: Bound | None
    worst: float
    alpha: tuple[float, ...]
    values: dict[str, float] | None = None

    @property
    def limit(self) -> float | None:
        """The limit as people read it."""
        return self.specification.limit

    @property
    def proved(self) -> bool:
        """Whether the answer is "proved"."""
        return self.answer == "proved"

    def __repr__(self) -> str:
        level = "none" if self.bound is None else f"{self.bound.level:.6g}"
        name = self.specification.title
        return f"<VerifiedBound: {name}, {self.answer}; {level} proved, {self.worst:.6g} sampled>"


def matrices_given(
    plant: UncertainPlant, law: Law, region: Region, lyapunov: Sequence[Any]
) -> tuple[GivenLyapunov, Certificate | None]:
    """Decide whether Lyapunov matrices prove a region; and the certificate, if they are one.

    Raises
    ------
    InputError
        If they do not fit the plant, or the law is not one gain.
    """
    if law.K is None:
        raise InputError("Lyapunov matrices are verified for one gain K; this law has several")
    return _given(plant, law, region, _matrices(plant, lyapunov))


def _matrices(plant: UncertainPlant, given: Sequence[Any]) -> list[Rationals]:
    """Return Lyapunov matrices in rationals."""
    n, N = plant.shape[0], len(plant.vertices)
    if len(given) not in (1, N):
        raise InputError(f"{len(given)} Lyapunov matrices; give one, or {N}, one per vertex")
    symmetric = list[Rationals]()
    for k, matrix in enumerate(given):
        what = "the Lyapunov matrix" if len(given) == 1 else f"Lyapunov matrix {k + 1}"
        P = read_matrix(matrix, what)
        if len(P) != n or len(P[0]) != n:
            raise InputError(f"{what} is {len(P)} x {len(P[0])}; {plant.name} has {n} states")
        # solvers leave the last bits of one half unlike the other's
        symmetric.append([[(P[i][j] + P[j][i]) / 2 for j in range(n)] for i in range(n)])
    return symmetric


def _given(
    plant: UncertainPlant, law: Law, region: Region, P: list[Rationals]
) -> tuple[GivenLyapunov, Certificate | None]:
    """Decide whether Lyapunov matrices prove a claim; and its certificate, if they are one."""
    blank = [placeholder(plant, law)] * len(region.parts)
    reasons = list[str]()
    for on in _domains(plant, len(P)):
        claim = replace(certificate_of(plant, law, region, blank).claim(), on=on)
        for form, subject in (("primal", _transposed(claim)), ("dual", claim)):
            for evidence in _evidence(P):
                try:
                    verdict = prove(replace(subject, evidence=(evidence,) * len(region.parts)))
                except FormatError as problem:
                    reasons.append(str(problem))
                    break
                if verdict.proved:
                    given = GivenLyapunov(form, len(P), verdict.reason)
                    return given, _certificate(plant, law, region, form, on, evidence)
                reasons.append(_missed(subject, evidence, region, verdict))
    return GivenLyapunov("", len(P), reasons[0]), None


def _domains(plant: UncertainPlant, count: int) -> tuple[str, ...]:
    """Where matrices, one a vertex, may be weighed: P(alpha), or multi-affine in parameters."""
    return ("simplex", "box") if count > 1 and len(plant.parameters) > 1 else ("simplex",)


def _evidence(P: list[Rationals]) -> Iterator[laws.Evidence]:
    degree = int(len(P) > 1)
    for elevation in ELEVATIONS if degree else ELEVATIONS[:1]:
        yield laws.Evidence(P, degree, elevation)


def _transposed(claim: Poles) -> Poles:
    """Return the claim about the transposed closed loops, which have the same poles.

    Its Lyapunov inequalities in X are those of the loops themselves in P = X.
    """
    vertices = np.eye(len(claim.A), dtype=int).tolist()
    loops = [claim.closed_loop([Fraction(a) for a in alpha]) for alpha in vertices]
    A = [[list(row) for row in zip(*loop, strict=True)] for loop in loops if loop is not None]
    n = len(A[0])
    nothing = laws.Law(K=[[[Fraction(0)] * n]])
    return replace(claim, A=A, B=[[[Fraction(0)] for _ in range(n)] for _ in A], law=nothing)


def _missed(claim: Poles, evidence: laws.Evidence, region: Region, verdict: Verdict) -> str:
    """Say which inequality fails, and by how much."""
    whole = replace(claim, evidence=(evidence,) * len(region.parts))
    block = next(islice((matrix for _, matrix in whole.blocks()), verdict.count, None), None)
    if verdict.place is None or block is None:
        return verdict.reason
    largest = max(abs(entry) for row in block for entry in row) or 1
    M = np.array([[float(Fraction(entry, largest)) for entry in row] for row in block])
    values = np.linalg.eigvalsh(M)
    share = values[0] / max(abs(values[-1]), abs(values[0]), np.finfo(float).tiny)
    return f"{verdict.reason}: its least eigenvalue is about {share:.2g} times its largest"


def _certificate(
    plant: UncertainPlant,
    law: Law,
    region: Region,
    form: str,
    on: str,
    evidence: laws.Evidence,
) -> Certificate | None:
    """Return the matrices as a certificate that holds, None where in doubles they are none."""
    X = np.array([[[float(e) for e in row] for row in matrix] for matrix in evidence.X])
    if form == "primal":
        if len(X) > 1:
            return None  # the inverse of P(alpha) is no polynomial
        with suppress(np.linalg.LinAlgError):
            X = np.linalg.inv(X)
        X = (X + X.swapaxes(1, 2)) / 2
    part = {"X": X, "degree": evidence.degree, "elevation": evidence.elevation}
    parts: dict[str, Any] = {"parts": (part,) * len(region.parts)}
    parts |= {"on": on} if on != "simplex" else {}
    certificate = Certificate(plant, region, "lyapunov", law, parts)
    return certificate if certificate.holds() else None


def bounded(plant: UncertainPlant, law: Law, limit: Specification) -> VerifiedBound:
    """Return what is proved of a limit; sampled first, for no proof passes a sample."""
    most = inf if limit.at_most is None else limit.at_most
    free = replace(limit, at_most=None)
    samples = sampled(plant, law, free)
    worst, k = worst_of(samples, ByTransfer.of(delta_form(plant), law, free))
    alpha = tuple(float(a) for a in samples.alpha[k])
    facts = limit, None, worst, alpha, values_at(plant, alpha)
    if worst > most and free.surely == free:
        return VerifiedBound(limit, "refuted", *facts[1:])
    if worst > most:
        sure = sampled(plant, law, free.surely, samples.alpha).values
        k = int(sure.argmax())
        if sure[k] > most:
            alpha = tuple(float(a) for a in samples.alpha[k])
            return VerifiedBound(
                limit, "refuted", None, float(sure[k]), alpha, values_at(plant, alpha)
            )
    bound = best_bound(plant, law, free)
    if limit.at_most is not None and (bound is None or bound.level > most):
        # the least level is not looked for as near the worst sample as a limit may be
        bound = kept_bound(plant, law, limit) or bound
    answer = "proved" if bound is not None and bound.level <= most else "undecided"
    return VerifiedBound(limit, answer, bound, *facts[2:])
