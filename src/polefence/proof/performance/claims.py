"""Claims about the signals of a loop, as frozen values.

Every claim is about x' = (A + B K) x + E w, y = C x + D u with u = K x and one row y, for every
alpha of the simplex or the box. A, B, E, C, D are given at the vertices and affine in their
weights, which on a box are products of the parameters' own.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.matrices import Rationals
from polefence.proof.placement import Evidence, Law

MAX_POINTS = 64  # initial states of one claim, and impulses
LAW = "the law"  # what a claim about no signal is about


@dataclass(frozen=True)
class Subject:
    """The loop, and the Lyapunov polynomial X(alpha) with which a claim about it is proved.

    ``E`` (n x q at every vertex) may be empty where no disturbance acts. ``law`` is one K, one K
    at every vertex, or scheduled. ``evidence.X`` holds the coefficients of X, and for a scheduled
    law those of Q in X = W (multiple + Q W), as for the method "lyapunov" of designs; empty: X is
    the law's own W, times ``evidence.multiple`` if that holds one number.
    """

    A: list[Rationals]
    B: list[Rationals]
    E: list[Rationals]
    law: Law
    evidence: Evidence
    on: str = "simplex"


@dataclass(frozen=True)
class Output:
    """y = C x + D u: at every vertex C (1 x n) and D (1 x m)."""

    C: list[Rationals]
    D: list[Rationals]
    name: str = ""


@dataclass(frozen=True)
class Rms:
    """The rms of y is less than ``level`` for white noise w of two-sided ``intensity``.

    The stationary covariance P satisfies A P + P A' + intensity E E' = 0.
    """

    subject: Subject
    output: Output
    level: Fraction
    intensity: Fraction = Fraction(1)


@dataclass(frozen=True)
class EnergyPeak:
    """|y(t)| stays within ``level``, from rest, for all w whose L2 norm is at most ``norm``."""

    subject: Subject
    output: Output
    level: Fraction
    norm: Fraction = Fraction(1)


@dataclass(frozen=True)
class InitialPeak:
    """|y(t)| stays within ``level`` from each initial state, w = 0.

    And so from the convex hull of the initial states and their negatives. They are ``points`` (n
    numbers each); s E_k, which an impulse of s in column k of w leaves: ``impulses`` holds one
    s a column, or nothing; and X0 v, v' X0 v <= 1, X0 = ``ellipsoid`` (n x n, positive
    semidefinite, or nothing), which are x0' X0^-1 x0 <= 1 where X0 has an inverse.
    """

    subject: Subject
    output: Output
    level: Fraction
    points: tuple[tuple[Fraction, ...], ...] = ()
    impulses: tuple[Fraction, ...] = ()
    ellipsoid: tuple[tuple[Fraction, ...], ...] = ()


@dataclass(frozen=True)
class Gain:
    """The L2 gain from w to y = C x + D u + F w is less than ``level``.

    ``F`` (1 x q at every vertex), zero if empty.
    """

    subject: Subject
    output: Output
    level: Fraction
    F: tuple[Rationals, ...] = ()


@dataclass(frozen=True)
class Baseline:
    """Another loop x' = A x + E w, y = C x on the same domain, under the same noise.

    ``stability`` holds X(alpha) > 0 with -(A X + X A') > 0; ``covariance`` in its X a symmetric
    P(alpha) with A P + P A' + intensity E E' > 0, which is less than the loop's covariance.
    """

    A: list[Rationals]
    E: list[Rationals]
    C: list[Rationals]
    stability: Evidence
    covariance: Evidence


@dataclass(frozen=True)
class RelativeRms:
    """The rms of y is less than ``level`` times that of the baseline, at every alpha."""

    subject: Subject
    output: Output
    level: Fraction
    baseline: Baseline
    intensity: Fraction = Fraction(1)


@dataclass(frozen=True)
class GainNorm:
    """The spectral norm of diag(rows)^-1 K(alpha) diag(columns) is less than ``level``.

    ``rows`` holds one positive number an input, ``columns`` one a state. Of the subject's evidence
    only the elevation counts.
    """

    subject: Subject
    level: Fraction
    rows: tuple[Fraction, ...]
    columns: tuple[Fraction, ...]

    @property
    def output(self) -> Output:
        """No signal, by the name of what is bounded."""
        return Output([], [], LAW)


PerformanceClaim = Rms | EnergyPeak | InitialPeak | Gain | RelativeRms | GainNorm
