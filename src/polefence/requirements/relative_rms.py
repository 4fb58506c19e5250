"""Rms of a signal relative to that without control, which a polynomial bounds from below.

With A0 P + P A0' + S E E' > 0 for a stable A0, P(alpha) is less than the stationary covariance. P
goes through the covariances at a grid of points, less a little of X, which goes through those of
noise on every state: so little that the inequalities still hold. X proves that A0 is stable. With a
remainder what that costs is taken off besides.

What the signal does not depend on without control, the states of a law, of sensors and of integrals
among it, is no part of the baseline: it need not be stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.law.laws import FixedGain, Law
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.dual_problem import DualProblem
from polefence.lmi.solve.gramians import cheapest
from polefence.lmi.solve.loops import polynomial_of
from polefence.lmi.solve.spread import more_than, spread_of
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, Polynomial, bernstein, binomial, elevated, times
from polefence.plant.system import Array, System
from polefence.proof import claims as proof
from polefence.proof.filters import in_series
from polefence.proof.laws import Evidence
from polefence.proof.remainder import SHARE, Spread
from polefence.requirements.rms import Rms
from polefence.requirements.slopes import Channel
from polefence.requirements.specification import disturbance, floats
from polefence.requirements.weights import behind, filters_of
from polefence.response.discrete import balancing
from polefence.response.stationary import growth, lyapunov, needed

DEGREES = (2, 3, 4, 5, 6)  # of P and X
ABOVE = 1.01  # kappa over what it has to exceed


@dataclass(frozen=True)
class RelativeRms(Rms):
    """The worst ratio of a signal's rms to its rms without control, at the same parameters.

    ``at_most`` is a number without unit. What the signal depends on without control must be stable.
    """

    kind = "relative rms"
    vector = False
    limits_rms = False
    late_as = None
    at_all_times = False

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant whose parameters move, too."""
        super().require_fit(plant)
        if plant.moving:
            raise InputError(
                f"{self.title}: {plant.moving[0].name} moves, and a relative rms needs constant "
                "parameters; ask for the rms"
            )

    @classmethod
    def without_density(cls, where: str) -> float:  # noqa: ARG003
        """Return one: the ratio is the same with any."""
        return 1.0

    def unit(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Return none: it is a ratio."""
        return ""

    def condition(
        self,
        plant: UncertainPlant,
        domain: Domain,
        unit: float | None = None,
        law: Law | None = None,
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return the condition with the passive variance, from below, as the unit of its square."""
        source, output = super().condition(plant, domain, unit, law)
        return source, replace(output, square=self.square(plant, domain, output.C))

    def square(self, plant: UncertainPlant, domain: Domain, C: Array) -> Polynomial:
        """Return a polynomial that is less than the variance without control."""
        states = passive_states(plant, C)
        return self._baseline(plant, domain, states).variance(domain, C[:, :, list(states)])

    def _baseline(self, plant: UncertainPlant, domain: Domain, states: tuple[int, ...]) -> Baseline:
        disturbance(plant)
        return baseline(plant, domain.on, self.density / 2, self.scales(plant), states)

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the dual form of the rms, as a share of the variance without control."""
        dual, domain = super().dual(plant, law), law.domain_of(plant)
        if dual is None:
            return None
        return replace(dual, share=self.square(plant, domain, dual.C))

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about the ratio."""
        domain, wide = Domain.of(subject.on, len(subject.A)), behind(plant, None, self)
        outputs, scales = self.exact_outputs(plant), tuple(map(Fraction, self.scales(plant)))
        filters = filters_of(plant, self)
        whole = in_series(subject, outputs, filters) if filters else (subject, outputs)
        states = passive_states(wide.plant, floats(whole[1][0].C))
        A, E, C = proof.baseline_loop(whole[0], whole[1][0], None, states)
        stability = covariance = Evidence([])
        if not subject.evidence.transfer:
            stability, covariance = self._baseline(wide.plant, domain, states).evidence()
        kept = states if len(states) < whole[0].n else ()
        base = proof.Baseline(A, E, C, stability, covariance, kept)
        intensity = Fraction(self.density) / 2
        more = (level, base, intensity)
        return proof.RelativeRms(subject, outputs, *more, scales=scales, filters=filters)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the ratio."""
        return super().values(plant, law, alpha) / super().values(plant, None, alpha)

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with the signal in units of its rms without control."""
        channel = super().channel(plant, alpha)
        size = super().values(plant, None, alpha)[:, None, None]
        return replace(channel, C=channel.C / size, D=channel.D / size)


@dataclass(frozen=True, eq=False)
class Baseline:
    """Covariances without control, from below.

    Attributes
    ----------
    P, X : (count, n, n) arrays
        Bernstein coefficients.
    degree : int
        Of both.
    spreads : pair of Spread, optional
        Of X and of P, where the plant has a remainder.
    """

    P: Array
    X: Array
    degree: int
    spreads: tuple[Spread | None, Spread | None] = (None, None)

    def evidence(self) -> tuple[Evidence, Evidence]:
        """Return the proofs of stability and of the covariance, as a claim has them."""
        one, other = (
            Evidence(_rationals(P), self.degree, spread=spread)
            for P, spread in zip((self.X, self.P), self.spreads, strict=True)
        )
        return one, other

    def variance(self, domain: Domain, C: Array) -> Polynomial:
        """Return C P C', C (N, 1, n) at the vertices."""
        rows = bernstein(domain, C, 1)
        columns = {e: c.T for e, c in rows.items()}
        return times(times(rows, bernstein(domain, self.P, self.degree)), columns)


def passive_states(plant: UncertainPlant, C: Array) -> tuple[int, ...]:
    """Return the states that C x depends on without control, C (N, 1, n) at the vertices.

    By structure, of what a remainder may hold too. All of them where it depends on none.
    """
    n = plant.shape[0]
    A = [plant.A]
    if plant.remainder is not None:
        rows = [plant.remainder.entries, *plant.remainder.curve]
        A.append(np.array(rows, dtype=float)[:, :, :n])
    kept = needed(C, np.concatenate(A))
    return tuple(kept.tolist()) or tuple(range(n))


def _passive(plant: UncertainPlant, states: tuple[int, ...]) -> UncertainPlant:
    """Return the plant of some states alone, with zero inputs."""
    (n, m), vertices = plant.shape, list[System]()
    if len(states) == n:
        return plant
    for vertex in plant.vertices:
        A = tuple(tuple(vertex.exact_A[i][j] for j in states) for i in states)
        E = None if vertex.exact_E is None else tuple(vertex.exact_E[i] for i in states)
        vertices.append(System(A, ((Fraction(1),) * m,) * len(states), E, vertex.name))
    remainder = plant.remainder and plant.remainder.kept(states)
    return UncertainPlant(
        tuple(vertices),
        plant.parameters,
        plant.name,
        sample_time=plant.sample_time,
        step=plant.step,
        remainder=remainder,
    )


@lru_cache(maxsize=16)
def baseline(
    plant: UncertainPlant,
    on: str,
    intensity: float,
    scales: tuple[float, ...],
    states: tuple[int, ...],
) -> Baseline:
    """Return covariances of some states of the plant under no control, from below.

    Parameters
    ----------
    scales : tuple of float
        How many times each disturbance acts; once where there are none.
    states : tuple of int
        Those that depend on no other, see `passive_states`.

    Raises
    ------
    InputError
        If the plant without control is unstable somewhere, or no polynomial of `DEGREES` will do.
    """
    plant = _passive(plant, states)
    domain, q = Domain.of(on, len(plant.vertices)), disturbance(plant).shape[2]
    acting = np.array(scales) if scales else np.ones(q)
    best, least = None, np.inf
    for degree in DEGREES:
        share, covariance = _at_degree(plant, domain, acting, intensity, degree)
        if share < least:
            best, least = covariance, share
        elif best is not None and plant.remainder is not None:
            break  # it takes its share whatever the degree
        # closer is not worth a higher degree
        if least <= 2e-4:
            break
    if best is None:
        raise InputError(
            f"{plant.name}: its covariance without control has no bound of degree {DEGREES[-1]}"
        )
    return best


def _at_degree(
    plant: UncertainPlant, domain: Domain, scales: Array, intensity: float, degree: int
) -> tuple[float, Baseline | None]:
    points = np.array(
        [np.concatenate(p) for p in product(*(_grid(s, degree) for s in domain.sizes))]
    )
    alpha = domain.alpha(points)
    A, _ = plant.at(alpha)
    step = float(plant.step)
    if growth(np.linalg.eigvals(A), step).max() >= 0:
        raise InputError(f"{plant.name} is not stable without control: its rms there is no measure")
    E = plant.driven(alpha) * scales
    covariances = lyapunov(A, intensity * E @ E.swapaxes(1, 2), step)
    d = balancing(A)  # a state that nothing moves has a size in the units of the others
    sizes = np.diagonal(covariances, axis1=1, axis2=2).max(axis=0) / d**2
    sizes = np.maximum(sizes, 1e-12 * sizes.max()) * d**2
    every = np.diag(sizes) * np.abs(np.linalg.eigvals(A)).max()
    basis = domain.basis(alpha, degree)
    fit, X = (
        _fitted(basis, c) for c in (covariances, lyapunov(A, np.tile(every, (len(A), 1, 1)), step))
    )
    loop = _Uncontrolled.of(plant, domain, scales, intensity, degree)
    falling = loop.spread_of_decrease(X)
    if not loop.falls(X, falling):
        return np.inf, None
    # how much of X is taken off P
    for share in (10.0**k for k in np.arange(-7, 0.1, 0.5)):
        P = fit - 1.5 * share * X  # half of it for the rounding
        below = loop.spread_of_covariance(P, X)
        if loop.holds(fit - share * X, below):
            return share, Baseline(P, X, degree, (falling, below))
    return np.inf, None


def _fitted(basis: Array, values: Array) -> Array:
    """Return Bernstein coefficients of the polynomial nearest to symmetric values."""
    scale = np.sqrt(np.diagonal(values, axis1=1, axis2=2).max(axis=0))
    scale = np.where(scale > 0, scale, 1.0)  # a state that nothing moves
    even = values / np.outer(scale, scale)
    fitted = np.linalg.lstsq(basis, even.reshape(len(even), -1), rcond=None)[0]
    both = fitted.reshape(-1, *even.shape[1:])
    symmetric = (both + both.swapaxes(1, 2)) / 2 * np.outer(scale, scale)
    return np.asarray((symmetric + symmetric.swapaxes(1, 2)) / 2)


def _grid(size: int, degree: int) -> list[Array]:
    """Return points of a simplex, more than a polynomial has coefficients."""
    steps = 2 * degree
    return [np.array(p) / steps for p in product(range(steps + 1), repeat=size) if sum(p) == steps]


@dataclass(frozen=True, eq=False)
class _Uncontrolled:
    """The plant without control: A, and E as much as it acts, on a domain; X and P of a degree."""

    plant: UncertainPlant
    domain: Domain
    A: Polynomial
    E: Polynomial
    scales: Array
    intensity: float
    degree: int

    @classmethod
    def of(
        cls, plant: UncertainPlant, domain: Domain, scales: Array, intensity: float, degree: int
    ) -> _Uncontrolled:
        """Return the plant without control, with its interpolation curve if it is sampled."""
        E = polynomial_of(plant, domain, disturbance(plant), sum(plant.shape))
        driven = {e: coefficient * scales for e, coefficient in E.items()}
        A = polynomial_of(plant, domain, plant.A)
        return cls(plant, domain, A, driven, scales, intensity, degree)

    @property
    def step(self) -> float:
        return float(self.plant.step)

    def form(self, coefficients: Array) -> Polynomial:
        """Return the polynomial of these coefficients."""
        return bernstein(self.domain, coefficients, self.degree)

    def constant(self, matrix: Array, degree: int) -> Polynomial:
        """Return a matrix as a polynomial of a degree."""
        return elevated(bernstein(self.domain, matrix[None], 0), self.domain, degree)

    def falls(self, X: Array, spread: Spread | None) -> bool:
        """Whether the blocks of -(A X + X A' + step A X A') are positive, with a margin."""
        form, d = self.form(X), self.plant.curve_degree
        above, entering = elevated(form, self.domain, d), np.zeros_like(X[0])
        omega = entering
        if spread is not None:
            entering, omega = _entering(spread), np.array(spread.omega, dtype=float)
        losses, lefts = (self.constant(M, self.degree + d) for M in (entering + omega, omega))
        for e, N in times(self.A, form).items():
            block = -(N + N.T) - losses[e]
            if self.step:
                N = N + lefts[e]
                block = np.block([[block, N], [N.T, above[e] / self.step - lefts[e]]])
            if not _is_positive(block):
                return False
        return True

    def holds(self, P: Array, spread: Spread | None) -> bool:
        """Whether A P + P A' + step A P A' + noise > 0 by its coefficients, with a margin."""
        d, step, domain = self.plant.curve_degree, self.step, self.domain
        once, total = times(self.A, self.form(P)), self.degree + d * (1 + bool(step))
        noise = times(self.E, {e: self.intensity * p.T for e, p in self.E.items()})
        blocks = elevated({e: N + N.T for e, N in once.items()}, domain, d * bool(step))
        if step:
            for e, N in times(once, {e: step * a.T for e, a in self.A.items()}).items():
                blocks[e] = blocks[e] + N
        more, lost = elevated(noise, domain, total - 2 * d), self.lost(spread)
        losses = self.constant(lost, total)
        kept = 1.0 if spread is None else 1 - float(SHARE)
        none = np.zeros_like(lost)
        left = (block + kept * more.get(e, none) - losses[e] for e, block in blocks.items())
        return all(map(_is_positive, left))

    def lost(self, spread: Spread | None) -> Array:
        """Return the loss of the covariance inequality to the remainder."""
        n = self.plant.shape[0]
        if spread is None:
            return np.zeros((n, n))
        driving = np.array(spread.columns[sum(self.plant.shape) :], dtype=float) * self.scales
        most = float(np.max(driving, initial=0.0))
        times = 1 + self.step * float(spread.kappa)
        times += (1 / float(SHARE) - 1) * self.intensity * most**2
        return np.asarray(times * _entering(spread) + np.array(spread.omega, dtype=float))

    def spread_of_decrease(self, X: Array) -> Spread | None:
        """Return the multipliers of the remainder for X."""
        if self.plant.remainder is None:
            return None
        n, m = self.plant.shape
        none = FixedGain(np.zeros((m, n)))
        return spread_of(self.plant, none, Evidence(_rationals(X), self.degree), driven=False)

    def spread_of_covariance(self, P: Array, X: Array) -> Spread | None:
        """Return the multipliers of the remainder for P, in coordinates in which X is about one."""
        remainder, (n, m) = self.plant.remainder, self.plant.shape
        if remainder is None:
            return None
        T = np.linalg.cholesky(X.mean(axis=0))
        inverse, form = np.linalg.inv(T), self.form(P)
        once, d = times(self.A, form), self.plant.curve_degree
        MP = {e: M + self.step * once[e] for e, M in elevated(form, self.domain, d).items()}
        coefficients = [MP[e] / binomial(self.domain.sizes, e) for e in MP]
        moved = np.array(coefficients).swapaxes(1, 2) @ inverse.T
        R = np.array(remainder.entries, dtype=float)
        a, b = (inverse**2).sum(axis=0), (moved**2).sum(axis=2).max(axis=0)
        rows, _ = cheapest(R[:, :n], a, b)  # then what is off in E, and in B, which costs nothing
        driven = self.intensity * self.scales**2 * float(a @ rows**2) / float(SHARE)
        every = np.concatenate([b, np.zeros(m), driven])
        # smaller costs count as none
        rows, columns = cheapest(R, a, np.maximum(every, 1e-6 * b.max()))
        V = columns[:n, None]
        values = np.linalg.eigvalsh(V * P * V.T)
        kappa = max(-float(values.min()) * ABOVE, float(values.max()) * (ABOVE - 1))
        sides = [tuple(map(Fraction, side.tolist())) for side in (rows, columns)]
        return Spread(more_than(V * moved, T), sides[0], sides[1], Fraction(kappa))


def _entering(spread: Spread) -> Array:
    """Return H H'."""
    return np.diag(np.square(np.array(spread.rows, dtype=float)))


def _is_positive(block: Array) -> bool:
    if np.diag(block).min() <= 0:
        return False
    scale = 1 / np.sqrt(np.diag(block))
    return bool(np.linalg.eigvalsh(block * np.outer(scale, scale))[0] > 1e-9)


def _rationals(matrices: Array) -> list[list[list[Fraction]]]:
    return [[[Fraction(x) for x in row] for row in M] for M in matrices.tolist()]
