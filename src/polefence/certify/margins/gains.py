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
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError, SolverError
from polefence.certify.candidates import first, rising
from polefence.certify.design import Design
from polefence.certify.evidence import certificate_of, forms, whole_evidence, work_of
from polefence.certify.margins.claims import (
    BOX,
    GAIN,
    SIMPLEX,
    Balanced,
    Ladder,
    Reached,
    above,
    are_positive,
    at_rest,
    balanced,
    below,
    claimed_design,
    climb,
    count_whole,
    holds,
    largest_step,
    region_block,
    subject_of,
    whole_points,
)
from polefence.certify.margins.kinds import COVERS, GIVEN, largest_bordered
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
from polefence.region.regions import HalfPlane, Region

MOST = 10.0  # times its size: no larger error is looked for
BETWEEN = 500  # points between the vertices at which gains are looked at for their sizes
FORMS, MOST_WORK = ((0, 0), (1, 0)), 6e9  # degree and elevation; of a step [multiplications]
CORNERS, POINTS, TURNS = 24, 40, 8  # of the family, of the boundary: where responses are taken
SHARP = (4.0, 16.0, 64.0)  # powers of the mean that stands for the largest, one after the other
STEPS = 4  # of a multiplier from one power of two to the next: short numbers
RETREATS = (0.995, 0.97, 0.9, 0.7, 0.4)  # of what floats say, until a proof succeeds


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

    sizes: Array
    C: Array | None

    @classmethod
    def of(cls, design: Design, own: bool = False) -> Gains:
        """Return the gains of the inputs; with ``own`` those of the rates of the law's states."""
        law, N, C = design.law, len(design.plant.vertices), None
        if law.measured:
            C = np.broadcast_to(law.C, (N, *law.C.shape[1:]))
        if law.W is None:  # coefficients bound what points only show
            at = law.domain.nodes(law.degree)
            found = law.domain.interpolated(law.own_gain(at), law.degree)
        else:
            found = law.own_gain(seeded(design.plant, N + BETWEEN))
        sizes = np.abs(found).max(axis=0)
        rates = np.arange(len(sizes)) >= len(sizes) - own_states(design.plant)
        return cls(np.where(rates[:, None] == own, sizes, 0.0), C)

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
        each = [
            C[k] @ np.linalg.solve(z * np.eye(n) - closed[k], B[k].astype(complex))
            for k in range(len(alpha))
            for z in _boundary(part, poles[k])
        ]
        own = _balanced(np.array(each), gains)
        yield from [own] * len(part.pairs())


def _boundary(part: Region, poles: Array) -> list[complex]:
    """Return points of the boundary of a part, or near it, where the poles are near."""
    if isinstance(part, HalfPlane):
        z = poles + part.decay
        own = np.abs(z)
        grid = np.geomspace(0.1 * max(own.min(), 1e-6 * own.max()), 10 * own.max(), POINTS)
        return [complex(-part.decay, y) for y in (0.0, *grid, *np.abs(z.imag))]
    if part.circle is not None:
        centre, radius = part.circle
        near = np.abs(np.angle(poles - centre))
        turns = (0.0, *np.geomspace(1e-4, np.pi, POINTS), *near)
        return [centre + radius * complex(np.exp(1j * t)) for t in turns]
    apart = np.abs(np.array([part.distance(np.array([pole])).item() for pole in poles]))
    turns = np.exp(1j * np.linspace(0, np.pi, TURNS))
    return [complex(z) for z in (poles[:, None] + apart[:, None] * turns).ravel()]


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
        of_q, of_p = (share @ np.abs(each) ** 2 / 2 for each in (U[:, :, 0], V[:, 0, :]))
        slope = of_p[rows] * mu[off] / p[rows] - of_q[columns] * sizes**2 / mu[off] / q[columns]
        return float(value), slope

    found = np.zeros(len(sizes))
    for power in SHARP if len(G) else ():
        found = minimize(size, found, (power,), jac=True, method="L-BFGS-B").x
    mu = np.zeros_like(gains.sizes)
    mu[off] = sizes * 2.0 ** (np.round(STEPS * found / np.log(2)) / STEPS)
    return mu


# --- the largest error in floats -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class EachQuestion:
    """Error of each gain, with multipliers for each L, M of the loops' pairs in turn."""

    loops: tuple[Balanced, ...]
    gains: Gains
    mu: tuple[Array, ...]

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried."""
        given = self.loops[0].elevation is not None
        return GIVEN[:2] if given else BOX if self.loops[0].q else SIMPLEX

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        return sum(
            count_whole(own, pieces, elevation)
            if own.elevation is None
            else 2.0 * own.domain.count(own.degree + own.plant_degree + own.elevation + elevation)
            for own in self.loops
        )

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest error that is proved in floats, -1 where none is."""
        loops = [self._loop(own, pieces, elevation) for own in self.loops]
        covers = COVERS if any(own.spread is not None for own in self.loops) else (1.0,)
        each = (self._reach(loops, (pieces, elevation), cover) for cover in covers)
        return max(rising(each, lambda own: own.value, GAIN), key=lambda own: own.value)

    def _loop(
        self, own: Balanced, pieces: int, elevation: int
    ) -> tuple[Array, Array, Array, Array]:
        """Return the coefficients of X, N and B, and of X C'."""
        if own.elevation is None:
            X, N, B = own.loop(whole_points(own, pieces, elevation))
            return X, N, B, X @ own.T.T
        total = own.elevation + elevation
        X, N, B = own.raised(total)
        C = self.gains.C
        return X, N, B, X @ own.T.T if C is None else own.seen(C, total)[None]

    def _reach(
        self,
        loops: Sequence[tuple[Array, Array, Array, Array]],
        fineness: tuple[int, int],
        cover: float,
    ) -> Reached:
        found, most, mu = list[tuple[float, float]](), MOST, iter(self.mu)
        for own, (X, N, B, Y) in zip(self.loops, loops, strict=True):
            if not own.disks and not are_positive(X):
                return Reached(-1.0, *fineness)
            for L, M in own.pairs:
                F = region_block((L, M), X, N) - own.lost(M, cover)
                if not are_positive(F):
                    return Reached(-1.0, *fineness)
                p, q = self.gains.sums(next(mu))
                found.append(largest_bordered(F, M, B * np.sqrt(p), Y * np.sqrt(q)))
            if own.spread is not None:
                most = min(most, self._covered(own, (own.elevation or 0) + fineness[1], cover))
        return Reached(min(most, *(e for e, _ in found)), *fineness, tuple(found), cover)

    def _covered(self, own: Balanced, elevation: int, cover: float) -> float:
        """Return the largest error up to which Omega, so many times, is more than V'V."""
        spread, C, n = own.spread, self.gains.C, len(own.T)
        if spread is None:
            return MOST
        X, V = own.covered(elevation if C is None else elevation + own.plant_degree)
        Y = X @ own.T.T if C is None else own.seen(C, elevation)
        inputs, sizes = np.diag(spread.inputs), self.gains.sizes
        count = (sizes > 0).sum(axis=1) * (inputs > 0)
        q = ((sizes * inputs[:, None]) ** 2 * count[:, None]).sum(axis=0) / float(SHARE)
        w, r = V.shape[-2], Y.shape[-1]
        base, slope = (np.zeros((len(X), n + w + r, n + w + r)) for _ in range(2))
        less = np.concatenate([np.zeros(w - len(inputs)), float(SHARE) * (count > 0)])
        base[:, :n, :n], base[:, n:, n:] = cover * spread.omega, np.eye(w + r)
        base[:, n : n + w, n : n + w] -= np.diag(less)
        base[:, n : n + w, :n], base[:, :n, n : n + w] = V, V.swapaxes(1, 2)
        right = Y * np.sqrt(q)
        slope[:, :n, n + w :], slope[:, n + w :, :n] = right, right.swapaxes(1, 2)
        return largest_step(base, slope)

    def claim(self, subject: Subject, reached: Reached) -> EachGain:
        """Return the claim of an error, or a little less."""
        error, every = reached.value, []
        for (largest, tau), own in zip(reached.each, self.mu, strict=True):
            # at a smaller error, the middle of what the multipliers may be
            scale = tau * error / largest
            rows = [[above(scale * x) if x else Fraction(0) for x in row] for row in own.tolist()]
            every.append(tuple(map(tuple, rows)))
        sizes = tuple(tuple(map(Fraction, row)) for row in self.gains.sizes.tolist())
        return EachGain(subject, below(error), sizes, tuple(every))


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
    mu, found = tuple(multipliers(design, region, gains)), []
    for own in _designs(design, region, gains, mu):
        loops = balanced(own, region)
        question = EachQuestion(loops, gains, _of_cells(own, region, mu))
        reached = [one for one in climb(question) if one.value > 0]
        found += [(reached[-1], question, own)] if reached else []
    for best, question, own in sorted(found, key=lambda one: -one[0].value):
        subject = subject_of(own, region, best)
        each = (replace(best, value=best.value * share) for share in RETREATS)
        claims = (question.claim(subject, one) for one in each)
        claim = first(one if holds(one) else None for one in claims)
        if claim is not None:
            return claim, own
    return None


def _of_cells(own: Design, region: Region, mu: tuple[Array, ...]) -> tuple[Array, ...]:
    """Return the multipliers of each part again for each cell that it is proved in."""
    if own.method != "lyapunov":
        return mu
    found, each = list[Array](), iter(mu)
    for part, evidence in zip(region.parts, own.certificate.at_rest.claim().evidence, strict=True):
        found += [next(each) for _ in part.pairs()] * len(evidence.per_cell)
    return tuple(found)


def _designs(
    design: Design, region: Region, gains: Gains, mu: tuple[Array, ...]
) -> Iterator[Design]:
    """Yield the law with its own proof, and with proofs that are for these errors."""
    own = claimed_design(design, region)
    if own is not None:
        yield own
        if own.certificate.in_parts:
            return
    plant, law = design.plant.at_rest, design.law
    allowed = list(forms(plant, law, len(region.parts)))
    for form in FORMS:
        if form not in allowed or work_of(plant, law, form) > MOST_WORK:
            continue
        each = iter(mu)
        with suppress(SolverError, InputError, np.linalg.LinAlgError):
            parts = [
                _evidence(plant, law, part, gains, [next(each) for _ in part.pairs()], form)
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
    every = gains.rows(np.eye(N), n)
    sources, outputs = list[Through](), list[Output]()
    for k, own in enumerate(mu):
        p, q = gains.sums(own)
        sources.append(Through(f"errors {k + 1}", inputs * np.sqrt(p), degree, part, k))
        C = (np.sqrt(q)[:, None] * every)[:, q > 0]
        none = np.zeros((*C.shape[:2], m))
        outputs.append(Output(f"gains {k + 1}", sources[-1].name, C, none, 1.0, fixed=False))
    C, D = (np.concatenate([getattr(o, key) for o in outputs], axis=1) for key in "CD")
    loop = loop_with(plant, law, C, D)
    near = next(points_inside(loop.without_outputs(), part, form), None)
    if near is None:
        raise SolverError("no Lyapunov polynomial of this form")
    found = kept_whatever(loop, tuple(sources), tuple(outputs), near, form)
    return whole_evidence(plant, law, found, form)
