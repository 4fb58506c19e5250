"""Lyapunov polynomials of a closed loop that is given: conditions of analysis.

The loop is A + B K = C(alpha) E(alpha)^-1 in polynomials of alpha. With an unknown symmetric
Q(alpha) the Lyapunov matrix X = E Q R and N = (A + B K) X = C Q R are polynomials too, if R = I
where E is a scalar polynomial times I, and R = W where E = W (sum of alpha) is that of a scheduled
law Z W^-1. There a scalar ``multiple`` times W itself, the law's own evidence, is added to X. What
is then asked for is as in `parameter_dependent`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from operator import add

import numpy as np

from polefence.lmi.conditions.coefficients import weighted
from polefence.lmi.conditions.motion import halves
from polefence.lmi.conditions.pencil import Block, Builder, Linear, Pencil, Term, put
from polefence.lmi.conditions.performance import Demands, Form, assembled, split_rows
from polefence.lmi.conditions.saturation import GAIN, HELD, Cut, Sought, cuts
from polefence.plant.boxes import Box
from polefence.plant.motion import STILL, Motion
from polefence.plant.polynomial import (
    Domain,
    Exponent,
    Polynomial,
    bernstein,
    binomial,
    degree_of,
    elevated,
    times,
)
from polefence.plant.system import Array


@dataclass(frozen=True, eq=False)
class Loop:
    """The closed loop C E^-1, with R where E is no multiple of the identity.

    Attributes
    ----------
    E, C : polynomials of one degree
        n x n; C may have rows of outputs below.
    R : polynomial, n x n, optional
    domain : Domain
    step : float
        Of a delta form [s]; zero in continuous time.
    motion : Motion
        Of the parameters.
    B, K : polynomials, optional
        Where inputs are cut off: how they enter, of degree one, and K E without its sum of alpha.
    pieces : tuple of int
        Of each parameter's interval, in each of which conditions are asked for.
    own : (n, k) array, optional
        Where the anti-windup gain is sought: it puts rows into the rates of the law's own states.
    fastest : (k, m) array, optional
        What none of its entries may exceed.
    """

    E: Polynomial
    C: Polynomial
    domain: Domain
    R: Polynomial | None = None
    step: float = 0.0
    motion: Motion = STILL
    B: Polynomial | None = None
    K: Polynomial | None = None
    pieces: tuple[int, ...] = ()
    own: Array | None = None
    fastest: Array | None = None

    @property
    def degree(self) -> int:
        """Degree of X in each simplex where Q is constant."""
        return degree_of(self.E, self.domain) + (degree_of(self.R, self.domain) if self.R else 0)

    @property
    def input_degree(self) -> int:
        """Degree of K X in each simplex where Q is constant; zero where K is not there."""
        degrees = [degree_of(P, self.domain) for P in (self.K, self.R) if P is not None]
        return sum(degrees) if self.K is not None else 0

    @property
    def middle(self) -> Array:
        """The closed loop at the middle of the domain, without outputs."""
        E = sum_of(self.E)
        return np.asarray(np.linalg.solve(E.T, sum_of(self.C)[: len(E)].T).T, dtype=float)

    def inside(self, box: Box) -> Loop:
        """Return the loop on a part of the box, in the part's coordinates."""
        E, C = (box.polynomial(P, self.domain) for P in (self.E, self.C))
        R = self.R and box.polynomial(self.R, self.domain)
        return replace(self, E=E, C=C, R=R)

    def without_outputs(self) -> Loop:
        """Return the loop alone."""
        C = {e: p[: p.shape[1]] for e, p in self.C.items()}
        return replace(self, C=C, B=None, K=None)

    @cached_property
    def rights(self) -> list[tuple[Exponent, Array | None]]:
        """Exponents of R and its coefficients transposed, as terms have them on the right."""
        if self.R is None:
            return [((0,) * sum(self.domain.sizes), None)]
        return [(e, p.T) for e, p in self.R.items()]

    def changed(self, T: Array, rate: float) -> Loop:
        """Return the loop in coordinates x = T x_s, rates in units of ``rate``; outputs stay."""
        inverse, n = np.linalg.inv(T), len(T)
        right = T if self.R is None else inverse.T
        E = {e: inverse @ p @ right for e, p in self.E.items()}
        C = {e: np.vstack([inverse @ p[:n] / rate, p[n:]]) @ right for e, p in self.C.items()}
        R = self.R and {e: inverse @ p @ inverse.T for e, p in self.R.items()}
        B = self.B and {e: inverse @ p / rate for e, p in self.B.items()}
        K = self.K and {e: p @ right for e, p in self.K.items()}
        timing = self.step * rate, self.motion.changed(rate), B, K
        own = None if self.own is None else inverse @ self.own / rate
        return Loop(E, C, self.domain, R, *timing, self.pieces, own, self.fastest)

    def restored(self, Q: Array, T: Array) -> Array:
        """Return Q in the original coordinates."""
        left = T if self.R is None else np.linalg.inv(T).T
        back = left @ Q @ left.T
        return np.asarray((back + back.T) / 2)


def sum_of(P: Polynomial) -> Array:
    """Return a homogeneous polynomial's value at the middle, times a power of the sizes."""
    return np.asarray(sum(P.values()))


def given(loop: Loop, demands: Demands, degree: int = 0, elevation: int = 0) -> Pencil:
    """Build the condition for a Lyapunov polynomial of a loop that is given.

    Parameters
    ----------
    loop : Loop
        Its C has the rows of each output below the n of the dynamics.
    """
    domain, n = loop.domain, len(next(iter(loop.E.values())))
    pencil = Builder("lyapunov")
    like = demands.target.motion.like(domain, degree)
    Q = [pencil.symmetric(f"Q{k + 1}", n, f"Q{j + 1}") for k, j in enumerate(like)]
    natural = loop.degree + degree
    elevation += max(0, demands.degree(domain) - natural)
    E, C = (elevated(P, domain, elevation) for P in (loop.E, loop.C))
    X, NY = _products(E, Q, loop, degree), _products(C, Q, loop, degree)
    if loop.R is not None:
        scalars = [pencil.full(f"s{k + 1}", (1, 1), "", f"s{j + 1}") for k, j in enumerate(like)]
        extra = degree_of(loop.R, domain)
        for total, P in ((X, E), (NY, C)):
            for e, more in _multiples(elevated(P, domain, extra), scalars, domain, degree).items():
                total[e] = total.get(e, Linear()) + more
    parts = split_rows(n, demands.outputs)
    held = dict[str, dict[Exponent, Cut]]()
    for output in demands.outputs:
        if output.held and loop.K is not None and loop.B is not None:
            KX = _products(loop.K, Q, loop, degree)
            if loop.R is not None:
                more_KX = _multiples(elevated(loop.K, domain, extra), scalars, domain, degree)
                KX = {e: KX.get(e, Linear()) + more_KX.get(e, Linear()) for e in {**KX, **more_KX}}
            m, top = output.D.shape[2], loop.input_degree + degree
            names = (f"{HELD}{k + 1}" for k in range(domain.count(top)))
            Y = weighted([pencil.full(name, (m, n), "") for name in names], domain, top)
            sought = _anti_windup(pencil, loop, output.held)
            at = domain, natural + elevation, sought
            held[output.name] = cuts(loop.B, KX, Y, output.held, *at)
    motions = dict[Exponent, tuple[Linear, ...]]()
    if demands.target.motion.moves:
        bare = _products(loop.R or _one(loop), Q, loop, degree)
        if loop.R is not None:
            spread = _multiples(elevated(loop.R, domain, extra), scalars, domain, degree)
            bare = {e: bare.get(e, Linear()) + spread.get(e, Linear()) for e in {**bare, **spread}}
        motions = halves(demands.target.motion, bare, domain, natural + elevation)

    def forms() -> Iterator[Form]:
        for e in domain.monomials(natural + elevation):
            N, *Y = (part @ NY[e] for part in parts) if demands.outputs else (NY[e],)
            cut = {name: cuts[e] for name, cuts in held.items()}
            yield Form(e, X[e], N, tuple(Y), moved=motions.get(e, ()), cut=cut)

    return assembled(pencil, forms(), demands, domain, natural + elevation)


def _anti_windup(pencil: Builder, loop: Loop, chosen: Sequence[int]) -> Sought | None:
    """Declare what an anti-windup gain G is found from, |G| <= ``fastest``; None of a given one."""
    if loop.own is None or loop.fastest is None:
        return None
    k = loop.own.shape[1]
    S = tuple(pencil.full(f"{GAIN}, S{i + 1}", (1, 1), "") for i in chosen)
    GS = pencil.full(GAIN, (k, len(chosen)), "")
    one = np.ones((1, 1))
    for i, (S_i, column) in enumerate(zip(S, np.eye(len(chosen))[:, :, None], strict=True)):
        for row, limit in zip(np.eye(k)[:, None], loop.fastest[:, chosen[i]], strict=True):
            for sign in (-1.0, 1.0):
                half = put(sign / 2 * (row @ GS), one, column.T) + put(-limit / 2 * S_i, one, one)
                pencil.blocks.append(Block(f"gain {sign}", 1, (), half))
    return Sought(S, GS, loop.own)


def gain_of(values: Mapping[str, Array], chosen: Sequence[int], m: int) -> Array | None:
    """Return the anti-windup gain (k, m) of a point, None where none is sought."""
    if GAIN not in values:
        return None
    GS = values[GAIN]
    gain = np.zeros((len(GS), m))
    for k, i in enumerate(chosen):
        gain[:, i] = GS[:, k] / values[f"{GAIN}, S{i + 1}"].item()
    return gain


def fed(loop: Loop, Q: Array, s: Array, degree: int) -> Array:
    """Return the Bernstein coefficients of K X for those of Q (count, n, n) and the multiples."""
    domain = loop.domain
    P = times(loop.K or {}, bernstein(domain, Q, degree))
    if loop.R is not None:
        P = times(P, loop.R)
        eye = np.eye(Q.shape[1])
        scalars = bernstein(domain, s[:, None, None] * eye, degree)
        more = times(elevated(loop.K or {}, domain, degree_of(loop.R, domain)), scalars)
        none = np.zeros_like(next(iter(P.values())))
        P = {e: P.get(e, none) + more.get(e, none) for e in {**P, **more}}
    exponents = domain.monomials(loop.input_degree + degree)
    return np.stack([P[e] / binomial(domain.sizes, e) for e in exponents])


def _one(loop: Loop) -> Polynomial:
    """Return I, of degree zero."""
    return {(0,) * sum(loop.domain.sizes): np.eye(len(next(iter(loop.E.values()))))}


def _products(P: Polynomial, Q: list[Linear], loop: Loop, degree: int) -> dict[Exponent, Linear]:
    """Return the coefficients of P Q R, linear in Q."""
    lefts: dict[tuple[Exponent, int, int], Array] = {}
    right = loop.rights
    weights = [binomial(loop.domain.sizes, e) for e in loop.domain.monomials(degree)]
    for d, p in P.items():
        for k, f in enumerate(loop.domain.monomials(degree)):
            for i, (e, _) in enumerate(right):
                key = tuple(a + b + c for a, b, c in zip(d, f, e, strict=True)), k, i
                lefts[key] = lefts[key] + weights[k] * p if key in lefts else weights[k] * p
    result: dict[Exponent, Linear] = {}
    for (e, k, i), left in lefts.items():
        term = Term(Q[k].terms[0].name, left, right[i][1])
        result[e] = result.get(e, Linear()) + Linear((term,))
    return result


def _multiples(
    P: Polynomial, scalars: list[Linear], domain: Domain, degree: int
) -> dict[Exponent, Linear]:
    """Return the coefficients of P times a scalar polynomial of these unknowns."""
    result: dict[Exponent, Linear] = {}
    units = _units(next(iter(P.values())).shape[1])
    for scalar, f in zip(scalars, domain.monomials(degree), strict=True):
        weight = binomial(domain.sizes, f)
        for d, p in P.items():
            e = tuple(map(add, d, f))
            terms = (
                Term(scalar.terms[0].name, weight * column[:, None], unit)
                for column, unit in zip(p.T, units, strict=True)
            )
            result[e] = result.get(e, Linear()) + Linear(tuple(terms))
    return result


@cache
def _units(n: int) -> tuple[Array, ...]:
    return tuple(np.eye(n)[:, k : k + 1] for k in range(n))
