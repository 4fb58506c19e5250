"""How far each gain of a law may be off by itself, all at once.

A gain that is zero is not off; the others are measured by their own sizes. The multipliers of the
claim come from responses of the loop, from what the errors put in to what they take: the largest
singular value of diag(q)^1/2 G diag(p)^1/2 is made least over the boundary of the region and the
family. They make a gain of the loop of these errors, and a Lyapunov polynomial is looked for that
makes that the least; the law's own proof may have one that is good for stability alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.certify.design import Design
from polefence.certify.evidence import FORMS, certificate_of, forms, whole_evidence, work_of
from polefence.certify.margins.bordered import GainQuestion
from polefence.certify.margins.claims import (
    Reached,
    above,
    at_rest,
    claimed_design,
    climb,
    proved_at,
)
from polefence.certify.margins.loops import balanced
from polefence.law.laws import Law
from polefence.lmi.conditions.performance import Output, Through
from polefence.lmi.solve.loops import loop_with, polynomial_of
from polefence.lmi.solve.lyapunov import kept_whatever, points_inside
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import own_states
from polefence.plant.points import seeded
from polefence.plant.polynomial import binomial
from polefence.plant.system import Array
from polefence.proof.claims.each_gain import EachGain
from polefence.proof.claims.margins import Subject
from polefence.proof.remainder import SHARE
from polefence.region.regions import Region

BETWEEN = 500  # points between the vertices at which gains are looked at for their sizes
# Of the family, and of a curve of the boundary: where responses are taken. Circles about the poles
# instead prove as little as a quarter of what is proved with these, of an ellipse a third; with 30
# points a car's disk loses 1 %.
CORNERS, POINTS = 24, 40
STEPS = 4  # of a multiplier from one power of two to the next: short numbers


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains of a law that may be off: how much each, in multiples of ``sizes``.

    Attributes
    ----------
    sizes : (m, r) array
        Of each the largest value of the family: no less than any of a law that is polynomial in
        the parameters (its Bernstein coefficients), of others that at the vertices and at `BETWEEN`
        points between. Zero for those that are not off.
    C : (N, r, n) array, optional
        Of what the law measures; None where it feeds back the states.
    """

    most: ClassVar[float] = 10.0  # times its size: no larger error is looked for

    sizes: Array
    C: Array | None

    @classmethod
    def of(cls, design: Design, of_states: bool = False) -> Gains:
        """Return the gains of the inputs; or, ``of_states``, of the rates of the law's states."""
        law, N, C = design.law, len(design.plant.vertices), None
        if law.measured:
            C = np.broadcast_to(law.C, (N, *law.C.shape[1:]))
        if law.W is None:  # coefficients bound what points only show
            nodes = law.domain.nodes(law.degree)
            gains = law.domain.interpolated(law.own_gain(nodes), law.degree)
        else:
            gains = law.own_gain(seeded(design.plant, N + BETWEEN))
        sizes = np.abs(gains).max(axis=0)
        rates = np.arange(len(sizes)) >= len(sizes) - own_states(design.plant)
        return cls(np.where(rates[:, None] == of_states, sizes, 0.0), C)

    @property
    def some(self) -> bool:
        """Whether there are any."""
        return bool(self.sizes.any())

    def rows(self, alpha: Array, n: int) -> Array:
        """Return C at points alpha, (points, r, n)."""
        if self.C is None:
            return np.broadcast_to(np.eye(n), (len(alpha), n, n))
        return np.asarray(np.tensordot(alpha, self.C, 1))

    def sums(self, mu: Array) -> tuple[Array, Array]:
        """Return p and q of multipliers, see `polefence.proof.claims.each_gain`."""
        off = self.sizes > 0
        over = np.divide(self.sizes**2, mu, out=np.zeros_like(mu), where=off)
        return np.where(off, mu, 0.0).sum(axis=1), over.sum(axis=0)


@dataclass(frozen=True, eq=False)
class GainsApart:
    """Errors of gains with their multipliers: a matrix of them for each L, M of the loops in turn.

    The lemma's multiplier of a border is a factor of all of these.
    """

    gains: Gains
    mu: tuple[Array, ...]

    @property
    def C(self) -> Array | None:
        """What the errors are times."""
        return self.gains.C

    @property
    def most(self) -> float:
        """No larger error is looked for."""
        return self.gains.most

    def border(self, pair: int) -> tuple[Array, Array]:
        """Return the roots of p and q."""
        p, q = self.gains.sums(self.mu[pair])
        return np.sqrt(p), np.diag(np.sqrt(q))

    def beside(self, inputs: Array) -> tuple[Array, Array]:
        """Return what the errors do to V of a remainder: each row gives up its share of one."""
        sizes = self.gains.sizes
        count = (sizes > 0).sum(axis=1) * (inputs > 0)
        q = ((sizes * inputs[:, None]) ** 2 * count[:, None]).sum(axis=0) / float(SHARE)
        return float(SHARE) * (count > 0), np.diag(np.sqrt(q))

    def claim(self, subject: Subject, error: Fraction, mu: Sequence[float]) -> EachGain:
        """Return the claim of an error and its multipliers, short numbers."""
        every = [
            [[above(factor * x) if x else Fraction(0) for x in row] for row in matrix.tolist()]
            for factor, matrix in zip(mu, self.mu, strict=True)
        ]
        sizes = tuple(tuple(map(Fraction, row)) for row in self.gains.sizes.tolist())
        return EachGain(subject, error, sizes, tuple(tuple(map(tuple, M)) for M in every))


# --- multipliers from responses ------------------------------------------------------------------


def multipliers(design: Design, region: Region, gains: Gains) -> Iterator[Array]:
    """Yield multipliers (m, r) for each L, M of each part of the region."""
    plant, law = design.plant, design.law
    N, n = len(plant.vertices), plant.shape[0]
    alpha = np.vstack([np.eye(N)[:CORNERS], np.full((1, N), 1 / N)])
    A, B = plant.at(alpha)
    closed, C = A + B @ law.gain(alpha), gains.rows(alpha, n)
    poles = np.linalg.eigvals(closed)
    for part in region.parts:
        responses = [
            C[k] @ np.linalg.solve(z * np.eye(n) - closed[k], B[k].astype(complex))
            for k in range(len(alpha))
            for z in _boundary(part, poles[k])
        ]
        yield from [_balanced(np.array(responses), gains)] * len(part.pairs())


def _boundary(part: Region, poles: Array) -> list[complex]:
    """Return points of the boundary of a part, as far out as each pole and nearest to it.

    Of each curve even places, and others closer and closer to its beginning: on the real axis.
    """
    # a pole at zero is seen from as far out
    points, least = set[complex](), 1e-6 * float(np.abs(poles).max())
    for pole in poles:
        reach = 2 * max(abs(pole), least)
        for curve in part.boundary((-reach, reach, reach)):
            half, nearest = len(curve) // 2, int(np.abs(curve - pole).argmin())
            close = np.geomspace(0.2, half, POINTS)  # places between the curve's points
            even = np.linspace(0, half, POINTS)
            places = np.concatenate([[0, nearest], close, even, 2 * half - even])
            points |= set(np.interp(places, np.arange(len(curve)), curve).tolist())
    return sorted((z for z in points if z.imag >= 0), key=lambda z: (z.real, z.imag))


def _balanced(G: Array, gains: Gains) -> Array:
    """Return the multipliers that make the largest response least, a convex question.

    Parameters
    ----------
    G : (points, r, m) array
    """
    from scipy.optimize import minimize  # deferred: slow to import

    off = gains.sizes > 0
    sizes, (rows, columns) = gains.sizes[off], np.nonzero(off)
    G = G[np.isfinite(G).all(axis=(1, 2))]

    def size(log_mu: Array, power: float) -> tuple[float, Array]:
        """Return the logarithm of about the largest singular value, and its slopes."""
        mu = np.ones_like(gains.sizes)
        mu[off] = sizes * np.exp(log_mu)
        p, q = gains.sums(mu)
        U, s, V = np.linalg.svd(np.sqrt(q)[:, None] * G * np.sqrt(p), full_matrices=False)
        top = max(float(s[:, 0].max()), np.finfo(float).tiny)
        share = (s[:, 0] / top) ** power
        value = np.log(top) + np.log(share.sum()) / power
        share = share / share.sum()
        of_q, of_p = (share @ np.abs(vectors) ** 2 / 2 for vectors in (U[:, :, 0], V[:, 0, :]))
        slope = of_p[rows] * mu[off] / p[rows] - of_q[columns] * sizes**2 / mu[off] / q[columns]
        return float(value), slope

    log_mu = np.zeros(len(sizes))
    # powers of the mean that stands for the largest
    for power in (4.0, 16.0, 64.0) if len(G) else ():
        log_mu = minimize(size, log_mu, (power,), jac=True, method="L-BFGS-B").x
    mu = np.zeros_like(gains.sizes)
    mu[off] = sizes * 2.0 ** (np.round(STEPS * log_mu / np.log(2)) / STEPS)
    return mu


# --- Lyapunov polynomials for the errors ---------------------------------------------------------


def each_gain_claim(design: Design, region: Region, gains: Gains) -> tuple[EachGain, Design] | None:
    """Return what is proved of how far each gain may be off, and of which design; None if nothing.

    Parameters
    ----------
    design : Design
        Of any method.
    region : Region
        What is to be kept.
    """
    mu = tuple(multipliers(design, region, gains))
    candidates = list[tuple[Reached, GainQuestion, Design]]()
    for claimed in _designs(design, region, gains, mu):
        loops, errors = balanced(claimed, region), GainsApart(gains, _of_cells(claimed, region, mu))
        question = GainQuestion(loops, errors, 2 if loops[0].elevation is not None else None)
        *_, best = (None, *(at for at in climb(question) if at.value > 0))
        candidates += [(best, question, claimed)] if best else []
    for reached, question, claimed in sorted(candidates, key=lambda one: -one[0].value):
        claim = proved_at(question, reached, claimed, region)
        if isinstance(claim, EachGain):
            return claim, claimed
    return None


def _of_cells(design: Design, region: Region, mu: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return the multipliers of each part again for each cell that it is proved in."""
    if design.method != "lyapunov":
        return mu
    repeated, given = list[Array](), iter(mu)
    claim = design.certificate.at_rest.claim()
    for part, evidence in zip(region.parts, claim.evidence, strict=True):
        repeated += [next(given) for _ in part.pairs()] * len(evidence.per_cell)
    return tuple(repeated)


def _designs(
    design: Design, region: Region, gains: Gains, mu: tuple[Array, ...]
) -> Iterator[Design]:
    """Yield the law with its own proof, and with proofs that are for these errors."""
    claimed = claimed_design(design, region)
    if claimed is not None:
        yield claimed
        if claimed.certificate.in_parts:
            return
    plant, law = design.plant.at_rest, design.law
    allowed = list(forms(plant, law, len(region.parts)))
    for form in FORMS:
        if form not in allowed or work_of(plant, law, form) > 6e9:
            continue
        given = iter(mu)
        with suppress(SolverError, InputError, np.linalg.LinAlgError):
            parts = [
                _evidence(plant, law, part, gains, [next(given) for _ in part.pairs()], form)
                for part in region.parts
            ]
            yield at_rest(certificate_of(plant, law, region, parts), design.plant)


def _evidence(
    plant: UncertainPlant,
    law: Law,
    part: Region,
    gains: Gains,
    mu: Sequence[Array],
    form: tuple[int, int],
) -> dict[str, Any]:
    """Return evidence of a part that is for these errors.

    Raises
    ------
    SolverError
        If there is none of this form.
    """
    domain = law.domain_of(plant)
    N, (n, m), degree = len(plant.vertices), plant.shape, plant.curve_degree
    B = polynomial_of(plant, domain, plant.B, n)
    inputs = np.array([B[e] / binomial(domain.sizes, e) for e in domain.monomials(degree)])
    measured = gains.rows(np.eye(N), n)
    sources, outputs = list[Through](), list[Output]()
    for k, multiplier in enumerate(mu):
        p, q = gains.sums(multiplier)
        sources.append(Through(f"errors {k + 1}", inputs * np.sqrt(p), degree, part, k))
        C = (np.sqrt(q)[:, None] * measured)[:, q > 0]
        none = np.zeros((*C.shape[:2], m))
        outputs.append(Output(f"gains {k + 1}", sources[-1].name, C, none, 1.0, fixed=False))
    C, D = (np.concatenate([getattr(o, key) for o in outputs], axis=1) for key in "CD")
    loop = loop_with(plant, law, C, D)
    near = next(points_inside(loop.without_outputs(), part, form), None)
    if near is None:
        raise SolverError("no Lyapunov polynomial of this form")
    matrices = kept_whatever(loop, tuple(sources), tuple(outputs), near, form)
    return whole_evidence(plant, law, matrices, form)
