"""Claims about a sampled loop, as frozen values."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.matrices import Rationals
from polefence.proof.placement import Claim, Evidence
from polefence.proof.service.claims import Range


@dataclass(frozen=True)
class Off:
    """The gain may besides be off by ``error`` S D C for any |D| <= 1.

    S is diagonal, of ``rows`` (a number an input); ``columns`` are the rows of C, n x n.
    """

    error: Fraction
    rows: tuple[Fraction, ...]
    columns: Rationals


@dataclass(frozen=True)
class Sampled:
    """All poles of the sampled loop have |z| < radius <= exp(-decay sample_time).

    Attributes
    ----------
    design : Claim
        The plant, in continuous time, and the law.
    ranges : tuple of Range
        The intervals of the plant's parameters; empty where it has none.
    sample_time : Fraction
        [s], u held between samples.
    delay : int
        1: u[k] = K x[k - 1]; 0: u[k] = K x[k].
    decay : Fraction
        [1/s]
    radius : Fraction
    T : matrix
        Coordinates y = T x of what follows, any that are regular.
    scale : tuple of Fraction
        Units of the inputs there: u = diag(scale) v.
    steps : tuple of matrices
        For each vertex [F, G], n x (n + m), near [e^(A Ts), its integral times B].
    terms : int
        Of the exponential's series.
    evidence : Evidence
        A Lyapunov polynomial of the loop with these steps, in (y, v), or y where there is no delay.
    error : Fraction
        What is proved to be tolerated, of [F, G].
    mu : Fraction
    elevation : int
    smallest, energy : Fraction
        Without delay and for scheduled laws, bounds on the law in these coordinates, W > smallest I
        and Z W^-1 Z' < energy I; else not used.
    weight : Fraction
        Of the inputs' rows beside those of the states.
    off : Off, optional
    """

    design: Claim
    ranges: tuple[Range, ...]
    sample_time: Fraction
    delay: int
    decay: Fraction
    radius: Fraction
    T: Rationals
    scale: tuple[Fraction, ...]
    steps: tuple[Rationals, ...]
    terms: int
    evidence: Evidence
    error: Fraction
    mu: Fraction
    elevation: int = 0
    smallest: Fraction = Fraction(0)
    energy: Fraction = Fraction(0)
    weight: Fraction = Fraction(1, 2**20)
    off: Off | None = None
