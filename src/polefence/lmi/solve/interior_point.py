r"""The smallest radius of a pencil by one primal-dual interior-point run: the reference in NumPy.

    minimise r   subject to   F(x, r) = r D(x) - M(x) >= 0,   t'x = 1

is a generalised eigenvalue problem. With <.,.> summed over blocks, A_r x = r D(x) - M(x) at fixed
r and * for adjoints, its central path is

    A_r* Y = nu t,   <Y, D(x)> = 1,   F Y = mu I,   t'x = 1,

and (x, r) is optimal as mu tends to 0. One iteration, with Q = F^-1, d = D(x), P = sym(Y d Q):

    H_ij = sum tr(F_i Y F_j Q),   g = A_r* P - D* Y,   delta = <d, P>
    [ H  g  t ; g' delta 0 ; t' 0 0 ] [dx; dr; nu] = right-hand sides (HKM symmetrisation)
    dF = A_r dx + dr d,   dY = base - sym(Y dF Q).

The next point is sought on an arc z + v0 + theta v1 + theta^2 v2: v0 centres, v1 is the path's
tangent, v2 corrects both to second order, the bilinear terms dr D(dx), dr D* dY, <dY, D(dx)>
included. The path is no function of mu: where r hardly moves although x must go far (an unstable
open loop, say) mu falls, rises and falls again, and steps at a prescribed mu diverge at these
folds. There, told by the predicted dr, r is prescribed instead and mu left free; x is then the
analytic centre at that r, and the step one of the method of centres.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from polefence.base.progress import note
from polefence.lmi.solve.stacked import Blocks
from polefence.plant.system import Array

TOLERANCE = 1e-8  # of mu times the order of the pencil, relative to r
MAX_ITERATIONS = 100
WIDE = 1.3  # the first r over the least r of the first x
CENTRAL = 0.1  # least eigenvalue of F Y that a step may leave, as a share of mu
LOOSE = 0.02  # the same for damped steps
FOLD = 3.0  # a tangent that moves r by more than this share of the gap is near a fold
ORDER = 4  # of the arc
SHARES = (0.999, 0.99, 0.97, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02, 0)
LEAPS = (5.0, 3.0, 2.0, 1.4)  # tried first where r is prescribed, in units of the gap
SHIFTS = (0.0, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11)  # of H's scaled diagonal, until there is a step
DAMPING, LEAST_DAMPING = 0.7, 1e-4
# While a pivot of the scaled H is below ILL, steps with no more of the tangent than SHARES[POOR]
# count up, others down: after so many, these coordinates have no digits left and the run ends.
# Steps before the first longer one, far from the path, do not count.
POOR, PATIENCE, ILL = 14, 3, 1e-5
# Newton's decrement from which on whole steps converge quadratically, and at which the next step is
# the last: it leaves the square of it.
QUADRATIC, CENTRED = 0.25, 1e-5


class Newton(Protocol):
    """Factors of H, and what they solve."""

    @property
    def pivot(self) -> float:
        """The least pivot of the scaled H."""

    def solved(self, a: Array) -> Array:
        """Return H^-1 a."""


class Linear(Protocol):
    """D and M of a pencil, and what is made of them: see `polefence.lmi.solve.stacked.Stacked`."""

    @property
    def order(self) -> int:
        """Sum of the blocks' sizes."""

    def identity(self) -> Blocks:
        """Return the identity."""

    def parts(self, x: Array) -> tuple[Blocks, Blocks]:
        """Return D(x) and M(x)."""

    def adjoint(self, r: float, P: Blocks, only_D: bool = False) -> Array:
        """Return the gradient of <P, r D(x) - M(x)> in x; with ``only_D`` that of <P, D(x)>."""

    def newton(self, r: float, Y: Blocks, Q: Blocks, shift: float) -> Newton:
        """Return the factors of H_ij = sum of tr(F_i Y F_j Q), its scaled diagonal shifted.

        Raises
        ------
        numpy.linalg.LinAlgError
            If it is singular in floats.
        """


@dataclass(frozen=True, eq=False)
class Outcome:
    """End of a run.

    Attributes
    ----------
    x : (unknowns,) array
    r : float
        F(x, r) > 0, so the least r of x lies below.
    Y : list of arrays
        Dual matrices of the blocks, sorted as in `Stacked`, <Y, D(x)> = 1.
    gap : float
        mu times the order: about what r lies above the infimum.
    iterations : int
    converged : bool
        Whether the gap came down to the tolerance. Where it did not, the run may go on in other
        coordinates.
    trail : (iterations + 1, 1 + unknowns) array
        r and x of the start and after every step.
    """

    x: Array
    r: float
    Y: Blocks
    gap: float
    iterations: int
    converged: bool
    trail: Array


@dataclass(frozen=True, eq=False)
class _Direction:
    """dF = A_r dx + dr d is linear in the unknowns, dD = D(dx)."""

    dx: Array
    dr: float
    dF: Blocks
    dD: Blocks
    dY: Blocks

    def __add__(self, other: _Direction) -> _Direction:
        return _Direction(
            self.dx + other.dx,
            self.dr + other.dr,
            _sum(self.dF, other.dF),
            _sum(self.dD, other.dD),
            _sum(self.dY, other.dY),
        )


def run(
    stacked: Linear,
    x: Array,
    r: float | None = None,
    enough: float = 0.0,
    tolerance: float = TOLERANCE,
    central: bool = False,
) -> Outcome:
    """Run the interior point from a point with D(x) > 0.

    Parameters
    ----------
    x : (unknowns,) array
    r : float, optional
        With F(x, r) > 0; by default somewhat above the least r of x.
    enough : float
        Stop at the first r that is no larger.
    tolerance : float
        Of the gap, relative to r.
    central : bool
        Whether then to go to the analytic centre at r = ``enough``, if a step was taken. Where a
        run stops hangs on the last bits of floats, the centre does not.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the start is not interior.
    """
    t = stacked.adjoint(1.0, stacked.identity(), only_D=True)
    t = t / np.linalg.norm(t)
    x = x / (t @ x)
    D, M = stacked.parts(x)
    r = WIDE * least_radius(D, M) if r is None else r
    if not (r > 0 and np.all(np.isfinite(x))):
        raise np.linalg.LinAlgError("no radius to start from")
    Y = _inverses([r * d - m for d, m in zip(D, M, strict=True)])
    iterations, gap, number, poor, begun = 0, np.inf, 0, 0, False
    trail = list[Array]()
    for iterations in range(MAX_ITERATIONS + 1):
        tell(iterations)
        D, M = stacked.parts(x)
        Y = _scaled(Y, 1 / _inner(Y, D))
        F = [r * d - m for d, m in zip(D, M, strict=True)]
        gap = _inner(F, Y)
        trail.append(np.array([r, *x]))
        if not gap > tolerance * r or r <= enough or iterations == MAX_ITERATIONS:
            break
        if poor == PATIENCE:
            break
        step = None
        for shift in SHIFTS:
            with suppress(np.linalg.LinAlgError):  # H is singular in floats
                arc = _Arc(stacked, (x, r, Y), (F, D), gap / stacked.order, t, shift)
                number, step = arc.farthest(number)
            if step is not None:
                break
        if step is None:
            break
        x, r, Y = step
        begun = begun or number < POOR
        poor = max(0, poor + (1 if number >= POOR else -1)) if begun and arc.pivot < ILL else 0
    if central and iterations and r <= enough:
        x, r = _centre(stacked, x, enough, t), enough
        D, F = stacked.parts(x)[0], _slack(stacked, x, r)
        Y = _inverses(F)
        Y = _scaled(Y, 1 / _inner(Y, D))
        gap = _inner(F, Y)
    return Outcome(x, r, Y, gap, iterations, bool(gap <= tolerance * r), np.array(trail))


def _centre(stacked: Linear, x: Array, r: float, t: Array) -> Array:
    """Return the analytic centre at a fixed r: the x of largest det F(x, r), t'x as it is.

    By Newton's method, damped while its decrement is large. It is one point, which the last bits of
    floats do not move. Where they hold no step, x as it was.
    """
    start = x
    try:
        for _ in range(MAX_ITERATIONS):
            Q = _inverses(_slack(stacked, x, r))
            newton = _factors(stacked, r, Q)
            gradient = stacked.adjoint(r, Q)
            dx, Ht = newton.solved(gradient), newton.solved(t)
            dx = dx - Ht * (t @ dx) / (t @ Ht)
            decrement = math.sqrt(max(float(gradient @ dx), 0.0))
            x = x + dx / (1 if decrement < QUADRATIC else 1 + decrement)
            if decrement < CENTRED:
                break
        _inverses(_slack(stacked, x, r))
    except np.linalg.LinAlgError:
        return start
    return x


def _factors(stacked: Linear, r: float, Q: Blocks) -> Newton:
    """Return the factors of the barrier's Hessian, shifted by as little as makes them exist."""
    for shift in SHIFTS[:-1]:
        with suppress(np.linalg.LinAlgError):
            return stacked.newton(r, Q, Q, shift)
    return stacked.newton(r, Q, Q, SHIFTS[-1])


def _slack(stacked: Linear, x: Array, r: float) -> Blocks:
    D, M = stacked.parts(x)
    return [r * d - m for d, m in zip(D, M, strict=True)]


def tell(iterations: int) -> None:
    """Say which iteration is next."""
    note(f"iteration {iterations + 1}")


def least_radius(D: Blocks, M: Blocks) -> float:
    """Largest generalised eigenvalue of (M, D).

    Raises
    ------
    numpy.linalg.LinAlgError
        If D is not positive definite.
    """
    largest = 0.0
    for d, m in zip(D, M, strict=True):
        half = np.linalg.solve(np.linalg.cholesky(d), m)
        pulled = np.linalg.solve(np.linalg.cholesky(d), half.swapaxes(1, 2))
        largest = max(largest, float(np.linalg.eigvalsh(pulled).max()))
    return largest


class _Arc:
    """The arc at one point: its directions, and how far along it stays central."""

    def __init__(
        self,
        stacked: Linear,
        point: tuple[Array, float, Blocks],
        blocks: tuple[Blocks, Blocks],
        mu: float,
        t: Array,
        shift: float,
    ) -> None:
        self.stacked, self.mu, self.t = stacked, mu, t
        (self.x, self.r, self.Y), (self.F, self.D) = point, blocks
        self.Q = _inverses(self.F)
        P = self._sym(self.D)
        self.newton = stacked.newton(self.r, self.Y, self.Q, shift)
        self.pivot = self.newton.pivot
        self.g = stacked.adjoint(self.r, P) - stacked.adjoint(self.r, self.Y, only_D=True)
        self.Hg, self.Ht = self._solved(self.g), self._solved(t)
        self.delta = _inner(self.D, P)
        self.arc = self._directions()

    def _directions(self) -> list[_Direction]:
        gap = self.mu * self.stacked.order
        centring = [self.mu * q - y for q, y in zip(self.Q, self.Y, strict=True)]
        dual = self.stacked.adjoint(self.r, self.Y)
        # the tangent towards mu = 0, and the dr that it predicts
        tangent = self._at_mu(_scaled(self.Q, -self.mu))
        self.smooth = 0 < -tangent.dr < FOLD * gap
        if self.smooth:
            centre = self._at_mu(centring, dual)
        else:
            centre = self._at_r(centring, dual, 0.0)
            tangent = self._at_r(_scaled(self.Q, 0.0), 0 * dual, -gap)
        series = [centre + tangent]
        # F has coefficients dF + bent, bent the products dr D(dx) of lower orders; D* dY
        bent, duals = [_scaled(self.D, 0.0)], list[Array]()
        while len(series) < ORDER:
            bent.append(_products(series, [v.dD for v in series]))
            duals.append(self.stacked.adjoint(self.r, series[-1].dY, only_D=True))
            series.append(self._next(series, bent, duals))
        return [centre, tangent, *series[1:]]

    def _next(self, series: list[_Direction], bent: list[Blocks], duals: list[Array]) -> _Direction:
        """Next coefficient of the path's power series, from products of the earlier ones."""
        total = [y @ c for y, c in zip(self.Y, bent[-1], strict=True)]
        dual, norm = np.zeros_like(self.x), 0.0
        pairs = zip(series, reversed(series), reversed(bent[:-1]), reversed(duals), strict=True)
        for first, second, extra, D_dY in pairs:
            change = _sum(second.dF, extra)
            total = [t + y @ c for t, y, c in zip(total, first.dY, change, strict=True)]
            dual = dual + first.dr * D_dY
            norm += _inner(first.dY, second.dD)
        base = _scaled(_symmetric([t @ q for t, q in zip(total, self.Q, strict=True)]), -1.0)
        return self._at_mu(base, dual, norm) if self.smooth else self._at_r(base, dual, 0.0)

    def _at_mu(self, base: Blocks, dual: Array | float = 0.0, norm: float = 0.0) -> _Direction:
        """Newton's direction with dY = base - sym(Y dF Q); mu is prescribed by the base."""
        a = self.stacked.adjoint(self.r, base) + dual
        b = _inner(self.D, base) + norm
        Ha = self._solved(a)
        g, t, Hg, Ht = self.g, self.t, self.Hg, self.Ht
        small = np.array([[self.delta - g @ Hg, -g @ Ht], [-t @ Hg, -t @ Ht]])
        dr, nu = np.linalg.solve(small, np.array([b - g @ Ha, -t @ Ha]))
        return self._completed(Ha - dr * Hg - nu * Ht, float(dr), base)

    def _at_r(self, base: Blocks, dual: Array, dr: float) -> _Direction:
        """Newton's direction with dr prescribed; <Y, D(x)> = 1 is left to the next scaling."""
        Ha = self._solved(self.stacked.adjoint(self.r, base) + dual - dr * self.g)
        dx = Ha - self.Ht * (self.t @ Ha) / (self.t @ self.Ht)
        return self._completed(dx, dr, base)

    def _completed(self, dx: Array, dr: float, base: Blocks) -> _Direction:
        D, M = self.stacked.parts(dx)
        dF = [self.r * d - m + dr * c for d, m, c in zip(D, M, self.D, strict=True)]
        return _Direction(dx, dr, dF, D, _sum(base, self._sym(dF), -1.0))

    def _solved(self, a: Array) -> Array:
        return self.newton.solved(a)

    def _sym(self, X: Blocks) -> Blocks:
        """sym(Y X Q) in every block."""
        return _symmetric([y @ z @ q for y, z, q in zip(self.Y, X, self.Q, strict=True)])

    def farthest(self, first: int) -> tuple[int, tuple[Array, float, Blocks] | None]:
        """Return a farthest central point on the arc, or None, and the number of its share.

        Shares are tried from number ``first`` on: up while they succeed, else down.
        """
        number = max(first, 0 if self.smooth else -len(LEAPS))
        point = self._point(_share(number), 1.0)
        while point is not None and number > (0 if self.smooth else -len(LEAPS)):
            farther = self._point(_share(number - 1), 1.0)
            if farther is None:
                break
            number, point = number - 1, farther
        while point is None and number < len(SHARES) - 1:
            number += 1
            point = self._point(_share(number), 1.0)
        damping = DAMPING
        while point is None and damping > LEAST_DAMPING:
            point = self._point(0.5, damping) or self._point(0.0, damping)
            damping *= DAMPING
        return number, point

    def _point(self, share: float, damping: float) -> tuple[Array, float, Blocks] | None:
        """Return the point at a place of the arc if it is central."""
        x, r, Y = self.x, self.r, self.Y
        for order, v in enumerate(self.arc):
            factor = damping * share**order
            x, r, Y = x + factor * v.dx, r + factor * v.dr, _sum(Y, v.dY, factor)
        fine = r > 0 and self._central(x, r, Y, CENTRAL if damping > 0.3 else LOOSE)
        return (x, r, Y) if fine else None

    def _central(self, x: Array, r: float, Y: Blocks, share: float) -> bool:
        """Whether F > 0, Y > 0 and all eigenvalues of F Y are at least this share of their mean."""
        D, M = self.stacked.parts(x)
        F = [r * d - m for d, m in zip(D, M, strict=True)]
        mu = _inner(F, Y) / self.stacked.order
        if not mu > 0:
            return False
        try:
            for f, y in zip(F, Y, strict=True):
                L = np.linalg.cholesky(f)
                np.linalg.cholesky(L.swapaxes(1, 2) @ y @ L - share * mu * np.eye(f.shape[1]))
        except np.linalg.LinAlgError:
            return False
        return True


def _share(number: int) -> float:
    """Shares by number; the leaps lie before the first."""
    return SHARES[number] if number >= 0 else LEAPS[number]


def _sum(X: Blocks, Y: Blocks, factor: float = 1.0) -> Blocks:
    return [x + factor * y for x, y in zip(X, Y, strict=True)]


def _products(series: list[_Direction], factors: list[Blocks]) -> Blocks:
    """Sum of dr times a factor over the pairs whose orders add up to one more than there are."""
    total = _scaled(factors[0], series[-1].dr)
    for v, factor in zip(series[-2::-1], factors[1:], strict=True):
        total = _sum(total, factor, v.dr)
    return total


def _symmetric(X: Blocks) -> Blocks:
    return [(x + x.swapaxes(1, 2)) / 2 for x in X]


def _inner(X: Blocks, Y: Blocks) -> float:
    return float(sum(np.vdot(x, y) for x, y in zip(X, Y, strict=True)))


def _scaled(X: Blocks, factor: float) -> Blocks:
    return [factor * x for x in X]


def _inverses(X: Blocks) -> Blocks:
    """Inverses of positive definite blocks."""
    inverses = []
    for x in X:
        half = np.linalg.inv(np.linalg.cholesky(x))
        inverses.append(half.swapaxes(1, 2) @ half)
    return inverses
