"""What integrals of followed responses will be bounded by, in floats: a hundredth of the time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import comb

from polefence.certify.followed import tau
from polefence.plant.system import Array
from polefence.proof.claims.followed import Following
from polefence.proof.claims.peak_to_peak import HALVINGS, PeakToPeak
from polefence.proof.response import Centred, norms, variables

Exponent = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Foreseen:
    """The motion of one part of the box, as polynomials in its parameters.

    Attributes
    ----------
    A, C, E, F : dict of exponents and arrays
    most : (variables,) array
        The largest size of each.
    """

    A: dict[Exponent, Array]
    C: dict[Exponent, Array]
    E: dict[Exponent, Array]
    F: dict[Exponent, Array]
    most: Array

    @classmethod
    def of(cls, claim: PeakToPeak) -> Foreseen:
        """Return that of a claim about a part."""
        subject, run = claim.subject, claim.run
        E = Centred.of(subject.driving(claim.scales, subject.sizes))
        F = subject.through(claim.outputs, claim.scales)
        through = {} if F is None else _arrays(Centred.of(F))
        most = np.array([float(x) for x in variables(subject.sizes)])
        return cls(_arrays(run.A), _arrays(run.C), _arrays(E), through, most)

    def bound(self, following: Following, Q: Any) -> tuple[float, float]:
        """Return about what the bound will be, and what is off, with Q in the norm."""
        series = _Series.of(self, following.degree, following.terms)
        weights = np.array([float(x) for x in norms(Q)])
        reach, rate = float(following.reach), float(following.rate)
        starts = series.starts
        error, off, totals = np.zeros(len(starts)), 0.0, series.passing
        steps = dict[int, _Step]()
        for units, count in following.lengths:
            step = steps.setdefault(units, _Step.of(series, float(units * following.unit)))
            for _ in range(count):
                X = step.solved(starts)
                left = 2 * step.residual(X) @ weights
                off += step.h * reach * float((error + left).sum())
                x = rate * step.h
                error = error / (1 + x + x * x / 2 + x**3 / 6) + left
                totals = totals + step.h * series.sizes(X)
                starts = X.sum(axis=1)
        far = (np.abs(starts) * series.scales[:, None]).sum(axis=1) @ weights + error
        return float(totals.max()), off + reach / rate * float(far.sum())


@dataclass(frozen=True, eq=False)
class _Series:
    """Monomials, and what they are multiplied by."""

    loop: Foreseen
    monomials: list[Exponent]
    wider: list[Exponent]
    terms: int

    @classmethod
    def of(cls, loop: Foreseen, degree: int, terms: int) -> _Series:
        """Return that of so high a degree."""
        count = len(loop.most)

        def up_to(most: int) -> list[Exponent]:
            every = product(range(most + 1), repeat=count)
            return sorted((e for e in every if sum(e) <= most), key=sum)

        more = max((sum(e) for e in (*loop.A, *loop.C)), default=0)
        return cls(loop, up_to(degree), up_to(degree + more), terms)

    @cached_property
    def index(self) -> dict[Exponent, int]:
        """Where a monomial is."""
        return {e: k for k, e in enumerate(self.wider)}

    @cached_property
    def moved(self) -> dict[Exponent, Array]:
        """Where each monomial times one of A or C is."""
        return {
            f: np.array([self.index[tuple(map(int.__add__, e, f))] for e in self.monomials])
            for f in {*self.loop.A, *self.loop.C}
        }

    @cached_property
    def scales(self) -> Array:
        """The largest size of each monomial."""
        return self.wide_scales[: len(self.monomials)]

    @cached_property
    def wide_scales(self) -> Array:
        """That of all."""
        return np.array([np.prod(self.loop.most ** np.array(e)) for e in self.wider])

    @property
    def starts(self) -> Array:
        """Where motions begin, (disturbances, monomials, n)."""
        n, q = next(iter(self.loop.E.values())).shape
        x = np.zeros((q, len(self.monomials), n))
        for e, M in self.loop.E.items():
            if self.index[e] < len(self.monomials):
                x[:, self.index[e]] = M.T
        acts = np.any([np.any(M, axis=0) for M in self.loop.E.values()], axis=0)
        return x[acts]

    @cached_property
    def degrees(self) -> tuple[int, ...]:
        """Degree of the signal in each variable."""
        every = [*self.loop.F, *self.loop.C]
        own = sum(self.monomials[-1])
        return tuple(own + max(e[k] for e in every) for k in range(len(self.loop.most)))

    @cached_property
    def in_time(self) -> Array:
        """From Chebyshev polynomials to Bernstein coefficients on the shortest intervals."""
        n = self.terms
        powers = [chebyshev.cheb2poly(row) for row in np.eye(n + 1)]
        on = np.zeros((n + 1, n + 1))
        for i, row in enumerate(powers):
            for k, x in enumerate(row):  # of s = 2 u - 1
                for j in range(k + 1):
                    on[j, i] += x * comb(k, j) * 2.0**j * (-1.0) ** (k - j)
        T = _bernstein(n) @ on
        leaves = [np.eye(n + 1)]
        left = np.array([[comb(i, j) / 2.0**i for j in range(n + 1)] for i in range(n + 1)])
        right = left[::-1, ::-1]
        for _ in range(HALVINGS):
            leaves = [half @ leaf for leaf in leaves for half in (left, right)]
        return np.concatenate(leaves) @ T

    def in_parameters(self, values: Array) -> Array:
        """Return Bernstein coefficients in the variables of (..., wider) coefficients of powers."""
        shape = [degree + 1 for degree in self.degrees]
        spread: Any = np.zeros((*values.shape[:-1], *shape))
        for k, e in enumerate(self.wider):
            if all(map(int.__lt__, e, shape)):
                spread[(..., *e)] = values[..., k]
        first = values.ndim - 1
        for k, degree in enumerate(self.degrees):
            on = np.zeros((degree + 1, degree + 1))
            for i in range(degree + 1):  # of g = most (2 u - 1)
                for j in range(i + 1):
                    on[j, i] = self.loop.most[k] ** i * comb(i, j) * 2.0**j * (-1.0) ** (i - j)
            T = _bernstein(degree) @ on
            spread = np.moveaxis(np.tensordot(T, spread, (1, first + k)), 0, first + k)
        return np.asarray(spread.reshape(*values.shape[:-1], -1))

    @property
    def passing(self) -> Array:
        """The sizes of what passes straight through, in all, at each coefficient."""
        total = np.zeros(math.prod(degree + 1 for degree in self.degrees))
        if not self.loop.F:
            return total
        q = next(iter(self.loop.F.values())).shape[1]
        values = np.zeros((q, len(self.wider)))
        for e, M in self.loop.F.items():
            values[:, self.index[e]] = M[0]
        return np.asarray(total + np.abs(self.in_parameters(values)).sum(axis=0))

    def sizes(self, X: Array) -> Array:
        """Return the mean of |h| over a step, of all disturbances together, at each coefficient."""
        y = np.zeros((*X.shape[:2], len(self.wider)))
        for f, M in self.loop.C.items():
            y[..., self.moved[f]] += X @ M[0]
        every = self.in_time @ self.in_parameters(y)
        return np.asarray(np.abs(every).sum(axis=(0, 1)) / self.in_time.shape[0])


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of a length: with the inverse that solves for X."""

    series: _Series
    h: float
    inverse: Array

    @classmethod
    def of(cls, series: _Series, h: float) -> _Step:
        """Return it."""
        A = series.loop.A[(0,) * len(series.loop.most)]
        return cls(series, h, tau(A[None], h)[0])

    def solved(self, starts: Array) -> Array:
        """Return X (disturbances, terms + 1, monomials, n)."""
        series, m = self.series, self.series.terms
        q, count, n = starts.shape
        X, right = np.zeros((q, m + 1, count, n)), np.zeros((q, m + 1, count, n))
        right[:, m] = starts
        sums = np.array([sum(e) for e in series.monomials])
        for total in range(sums[-1] + 1):
            (own,) = np.nonzero(sums == total)
            flat = np.moveaxis(right[:, :, own], 2, 3).reshape(q, -1, len(own))
            found = (self.inverse @ flat).reshape(q, m + 1, n, len(own))
            X[:, :, own] = np.moveaxis(found, 3, 2)
            for f, M in series.loop.A.items():
                to = series.moved[f][own]
                kept = to < count
                if any(f) and np.any(kept):
                    right[:, :m, to[kept]] += self.h / 2 * X[:, :m, own[kept]] @ M.T
        return X

    def residual(self, X: Array) -> Array:
        """Return the sizes of the residual, (disturbances, n)."""
        series = self.series
        R = np.zeros((*X.shape[:2], len(series.wider), X.shape[3]))
        for f, M in series.loop.A.items():
            R[:, :, series.moved[f]] -= self.h / 2 * X @ M.T
        slope = chebyshev.chebder(X, axis=1)
        R[:, : slope.shape[1], : X.shape[2]] += slope
        return np.asarray((np.abs(R) * series.wide_scales[:, None]).sum(axis=(1, 2)))


def _bernstein(degree: int) -> Array:
    """Return what makes Bernstein coefficients of powers of u."""
    every = range(degree + 1)
    return np.array([[comb(j, i) / comb(degree, i) for i in every] for j in every])


def _arrays(P: Centred) -> dict[Exponent, Array]:
    """Return coefficients in floats."""
    return {
        e: np.array([[float(Fraction(x, P.whole)) for x in row] for row in M])
        for e, M in P.terms.items()
    }
