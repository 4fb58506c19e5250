"""Stretches of a period on which searches have polynomials of time, and what these share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from polefence.lmi.solve.dual_problem import DualProblem
from polefence.plant.system import Array
from polefence.proof.polynomials import monomials_of
from polefence.response.held import Storing

# Degree in time. Within 0.1 % a van's gain takes 14,080 inequalities and 19 s; 64,680 and 51 s with
# 2, 12,360 and 13 s with 4, 14,448 and 14 s with 5. A spring at 20 ms: 5,024, 6,684, 5,440, 6,672.
ALONG = 3
STEPS = 4  # of a stretch
NODES = (0, 1, 3, 4)  # of those, at which values are interpolated: about Chebyshev's
MOST_STRETCHES = 32  # of a period
# Stretches are halved that miss at nodes this share of the most that is missed, and more.
LARGE = 0.25
DOUBLINGS = 30  # of periods; what does not settle in 2^30 never does
SETTLED = 1e-13  # change that ends them
SLACK = 1e-7  # of V, by which it may fall at a sample


@cache
def _powers() -> Array:
    """Return what takes values at the nodes of time to coefficients of powers."""
    at = np.array(NODES)[:, None] / STEPS
    return np.asarray(np.linalg.inv(at ** np.arange(ALONG + 1)), dtype=float)


@cache
def slopes() -> Array:
    """Return what takes values at the nodes of time to slopes there."""
    at, k = np.array(NODES)[:, None] / STEPS, np.arange(ALONG + 1)
    return np.asarray((k * at ** np.maximum(k - 1, 0)) @ _powers())


@cache
def _bernstein() -> Array:
    """Return what takes values at the nodes of time to Bernstein coefficients."""
    count = range(ALONG + 1)
    shares = [[math.comb(j, k) / math.comb(ALONG, k) for k in count] for j in count]
    known = np.array(shares) @ _powers()
    known[[0, -1]] = np.eye(ALONG + 1)[[0, -1]]  # exactly: where one stretch ends the next begins
    return known[[later for _, later in monomials_of((2,), (ALONG,))]]


def along(values: Array) -> Array:
    """Return Bernstein coefficients in time of values at its nodes, (count, times, ...)."""
    return np.asarray(np.einsum("st,pt...->ps...", _bernstein(), values))


# Stretches of each phase: how many times it is halved to make one of them.
Cuts = tuple[tuple[int, ...], ...]


def halved(cuts: Cuts, chosen: Sequence[bool]) -> Cuts:
    """Return the stretches with the chosen ones halved."""
    which = iter(chosen)
    return tuple(
        tuple(k for halvings in cut for k in ((halvings + 1,) * 2 if next(which) else (halvings,)))
        for cut in cuts
    )


@dataclass(frozen=True, eq=False)
class PeriodSearch:
    """What searches on stretches of a period share: a problem, and a degree in the parameters."""

    problem: DualProblem
    degree: int

    @property
    def storing(self) -> Storing:
        """The plant in continuous time."""
        if self.problem.storing is None:
            raise np.linalg.LinAlgError("nothing is held between samples")
        return self.problem.storing

    def _loops(self, alpha: Array) -> tuple[tuple[Array, Array, Array, Array], Array, Array, Array]:
        """Return N, E, Y and F of all phases, J = [W; Z], W and G at points."""
        problem, storing = self.problem, self.storing
        at = alpha if problem.box is None else problem.box.alpha(problem.domain, alpha)
        A, B = problem.plant.at(at)
        n, m = problem.plant.shape
        form = problem.form(alpha)
        G = np.zeros((len(alpha), n, n + m))
        G[:, :, :n] = np.eye(n)
        G[:, storing.first :] += problem.step * np.concatenate([A, B], axis=2)[:, storing.first :]
        return storing.at(alpha), form, form[:, :n], G

    @cached_property
    def _nodes(self) -> tuple[tuple[Array, Array, Array, Array], Array, Array, Array]:
        return self._loops(self.problem.domain.nodes(self.degree))

    @property
    def _spans(self) -> list[float]:
        """Lengths of the phases [s]."""
        return [float(x) for x in np.diff([0.0, *self.storing.ends]) * self.problem.step]

    def _places(self, cuts: Cuts) -> list[tuple[int, float]]:
        """Return of each stretch the phase in which it is, and its length [s]."""
        spans = self._spans
        return [(k, spans[k] / 2**halvings) for k, cut in enumerate(cuts) for halvings in cut]

    def _stretches(self, values: Array, cuts: Cuts) -> tuple[tuple[float, Array], ...]:
        """Return ends of stretches, and coefficients of what has these values at their nodes."""
        stretches, of, begin = list[tuple[float, Array]](), iter(values), 0.0
        for end, cut in zip(self.storing.ends, cuts, strict=True):
            for length in np.cumsum([0.5**halvings for halvings in cut]):
                one = self.problem.domain.interpolated(along(next(of)), self.degree)
                stretches.append((begin + (end - begin) * float(length), one))
            begin = end
        return tuple(stretches)

    def _known(
        self, degree: int, *known: Array
    ) -> tuple[Array, Array, Array, list[Array], Callable[[Array], Array]]:
        """Return L, W, G and values of coefficients at nodes of a degree, and what interpolates."""
        domain = self.problem.domain
        nodes = domain.nodes(degree)
        _, law, W, G = self._loops(nodes)
        basis = domain.basis(nodes, self.degree)
        every = [np.tensordot(basis, M, 1) for M in known]
        return law, W, G, every, lambda M: domain.interpolated(M, degree)
