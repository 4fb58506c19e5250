"""Rms of a signal relative to that without control, which a polynomial bounds from below.

With A0 P + P A0' + S E E' > 0 for a stable A0, P(alpha) is less than the stationary covariance. P
goes through the covariances at a grid of points, less a little of X, which goes through those of
noise on every state: so little that the inequalities still hold. X proves that A0 is stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.requirements.rms import Rms
from polefence.design.requirements.slopes import Channel
from polefence.design.requirements.specification import disturbance
from polefence.law.laws import Law, domain_of
from polefence.lmi.conditions import performance as conditions
from polefence.lmi.solve.gramians import DualProblem
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, Polynomial, bernstein, elevated, times
from polefence.plant.system import Array
from polefence.proof import claims as proof
from polefence.proof.laws import Evidence
from polefence.response.stationary import growth, lyapunov

DEGREES = (2, 3, 4, 5, 6)  # of P and X
CLOSE = 2e-4  # of X taken off: closer is not worth a higher degree
# How much of X is taken off P.
SHARES = tuple(10.0**k for k in np.arange(-7, 0.1, 0.5))
MARGIN = 1e-9


@dataclass(frozen=True)
class RelativeRms(Rms):
    """The worst ratio of a signal's rms to its rms without control, at the same parameters.

    ``at_most`` is a number without unit. The plant without control must be stable.
    """

    kind = "relative rms"
    vector = False
    limits_rms = False

    def require_fit(self, plant: UncertainPlant) -> None:
        """Refuse a plant whose parameters move, too."""
        super().require_fit(plant)
        if plant.moving:
            raise InputError(
                f"{self.title}: {plant.moving[0].name} moves, and along a motion two loops have no "
                "ratio; ask for the rms"
            )

    @classmethod
    def without_density(cls, where: str) -> float:  # noqa: ARG003
        """Return one: the ratio is the same with any."""
        return 1.0

    def absolute(self) -> Rms:
        """Return the rms itself."""
        return Rms(self.signal, None, self.density, disturbances=self.disturbances)

    def unit(self, plant: UncertainPlant) -> str:  # noqa: ARG002
        """Return none: it is a ratio."""
        return ""

    def condition(
        self, plant: UncertainPlant, domain: Domain, unit: float | None = None
    ) -> tuple[conditions.Source, conditions.Output]:
        """Return it with the variance without control, from below, as the unit of its square."""
        source, own = super().condition(plant, domain, unit)
        return source, replace(own, square=self.square(plant, domain, own.C))

    def square(self, plant: UncertainPlant, domain: Domain, C: Array) -> Polynomial:
        """Return a polynomial that is less than the variance without control."""
        return self._baseline(plant, domain).variance(domain, C)

    def _baseline(self, plant: UncertainPlant, domain: Domain) -> Baseline:
        on = "box" if len(domain.sizes) > 1 else "simplex"
        disturbance(plant)
        return baseline(plant, on, self.density / 2, self.scales(plant))

    def dual(self, plant: UncertainPlant, law: Law) -> DualProblem | None:
        """Return the dual form of the rms, as a share of the variance without control."""
        own, domain = super().dual(plant, law), domain_of(plant, law)
        if own is None:
            return None
        return replace(own, share=self.square(plant, domain, own.C))

    def claim(
        self, subject: proof.Subject, level: Fraction, plant: UncertainPlant
    ) -> proof.BoundClaim:
        """Return the claim about the ratio."""
        domain = Domain.of(subject.on, len(subject.A))
        stability, covariance = self._baseline(plant, domain).evidence()
        n = len(subject.A[0])
        outputs, scales = self.exact_outputs(plant), tuple(map(Fraction, self.scales(plant)))
        A, E, C = proof.baseline_loop(subject, outputs[0], None, tuple(range(n)))
        base = proof.Baseline(A, E, C, stability, covariance)
        intensity = Fraction(self.density) / 2
        return proof.RelativeRms(subject, outputs, level, base, intensity, scales=scales)

    def values(self, plant: UncertainPlant, law: Any, alpha: Array) -> Array:
        """Return the ratio."""
        return super().values(plant, law, alpha) / super().values(plant, None, alpha)

    def channel(self, plant: UncertainPlant, alpha: Array) -> Channel:
        """Return it with the signal in units of its rms without control."""
        own = super().channel(plant, alpha)
        size = super().values(plant, None, alpha)[:, None, None]
        return replace(own, C=own.C / size, D=own.D / size)


@dataclass(frozen=True, eq=False)
class Baseline:
    """Covariances without control, from below.

    Attributes
    ----------
    P, X : (count, n, n) arrays
        Bernstein coefficients.
    degree : int
        Of both.
    """

    P: Array
    X: Array
    degree: int

    def evidence(self) -> tuple[Evidence, Evidence]:
        """Return the proofs of stability and of the covariance, as a claim has them."""
        return Evidence(_rationals(self.X), self.degree), Evidence(_rationals(self.P), self.degree)

    def variance(self, domain: Domain, C: Array) -> Polynomial:
        """Return C P C', C (N, 1, n) at the vertices."""
        rows = bernstein(domain, C, 1)
        columns = {e: c.T for e, c in rows.items()}
        return times(times(rows, bernstein(domain, self.P, self.degree)), columns)


@lru_cache(maxsize=16)
def baseline(
    plant: UncertainPlant, on: str, intensity: float, scales: tuple[float, ...] = ()
) -> Baseline:
    """Return covariances of the plant under no control, from below.

    Parameters
    ----------
    scales : tuple of float, optional
        How many times each disturbance acts.

    Raises
    ------
    InputError
        If the plant without control is unstable somewhere, or no polynomial of `DEGREES` will do.
    """
    domain = Domain.of(on, len(plant.vertices))
    E = disturbance(plant) * (np.array(scales) if scales else 1.0)
    best: Baseline | None = None
    for degree in DEGREES:
        share, found = _at_degree(plant, domain, E, intensity, degree)
        if found is not None:
            best = found
            if share <= CLOSE:
                break
    if best is None:
        raise InputError(
            f"{plant.name}: its covariance without control has no bound of degree {DEGREES[-1]}"
        )
    return best


def _at_degree(
    plant: UncertainPlant, domain: Domain, E: Array, intensity: float, degree: int
) -> tuple[float, Baseline | None]:
    points = np.array(
        [np.concatenate(p) for p in product(*(_grid(s, degree) for s in domain.sizes))]
    )
    alpha = domain.alpha(points)
    A, _ = plant.at(alpha)
    step = float(plant.step)
    if growth(np.linalg.eigvals(A), step).max() >= 0:
        raise InputError(f"{plant.name} is not stable without control: its rms there is no measure")
    Es = np.tensordot(alpha, E, 1)
    own = lyapunov(A, intensity * Es @ Es.swapaxes(1, 2), step)
    sizes = np.diagonal(own, axis1=1, axis2=2).max(axis=0)
    every = np.diag(np.maximum(sizes, 1e-12 * sizes.max())) * np.abs(np.linalg.eigvals(A)).max()
    basis = domain.basis(alpha, degree)
    fit, X = (_fitted(basis, c) for c in (own, lyapunov(A, np.tile(every, (len(A), 1, 1)), step)))
    more = bernstein(domain, E, 1)
    noise = times(more, {e: intensity * p.T for e, p in more.items()})
    plants = bernstein(domain, plant.A, 1)
    if not _falls(plants, bernstein(domain, X, degree), domain, step):
        return np.inf, None
    for share in SHARES:
        P = bernstein(domain, fit - share * X, degree)
        if _holds(plants, P, noise, domain, degree, step):
            # as much again, for the rounding
            return share, Baseline(fit - 1.5 * share * X, X, degree)
    return np.inf, None


def _fitted(basis: Array, values: Array) -> Array:
    """Return Bernstein coefficients of the polynomial nearest to symmetric values."""
    scale = np.sqrt(np.diagonal(values, axis1=1, axis2=2).max(axis=0))
    scale = np.where(scale > 0, scale, 1.0)  # a state that nothing moves
    even = values / np.outer(scale, scale)
    found = np.linalg.lstsq(basis, even.reshape(len(even), -1), rcond=None)[0]
    both = found.reshape(-1, *even.shape[1:])
    symmetric = (both + both.swapaxes(1, 2)) / 2 * np.outer(scale, scale)
    return np.asarray((symmetric + symmetric.swapaxes(1, 2)) / 2)


def _grid(size: int, degree: int) -> list[Array]:
    """Return points of a simplex, more than a polynomial has coefficients."""
    steps = 2 * degree
    return [np.array(p) / steps for p in product(range(steps + 1), repeat=size) if sum(p) == steps]


def _holds(
    A: Polynomial, P: Polynomial, noise: Polynomial, domain: Domain, degree: int, step: float
) -> bool:
    """Whether A P + P A' + step A P A' + noise > 0 coefficient by coefficient, with a margin."""
    once = times(A, P)
    more = elevated(noise, domain, degree + bool(step) - 1)
    blocks = elevated({e: N + N.T for e, N in once.items()}, domain, int(bool(step)))
    if step:
        for e, N in times(once, {e: step * a.T for e, a in A.items()}).items():
            blocks[e] = blocks[e] + N
    return all(_is_positive(own + more.get(e, np.zeros_like(own))) for e, own in blocks.items())


def _falls(A: Polynomial, X: Polynomial, domain: Domain, step: float) -> bool:
    """Whether the blocks of -(A X + X A' + step A X A') are positive, with a margin."""
    above = elevated(X, domain, 1)
    for e, N in times(A, X).items():
        block = -(N + N.T)
        if step:
            block = np.block([[block, N], [N.T, above[e] / step]])
        if not _is_positive(block):
            return False
    return True


def _is_positive(block: Array) -> bool:
    if np.diag(block).min() <= 0:
        return False
    scale = 1 / np.sqrt(np.diag(block))
    return bool(np.linalg.eigvalsh(block * np.outer(scale, scale))[0] > MARGIN)


def _rationals(matrices: Array) -> list[list[list[Fraction]]]:
    return [[[Fraction(x) for x in row] for row in M] for M in matrices.tolist()]
