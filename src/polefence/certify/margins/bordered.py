"""Errors of the gain in floats: the largest that a border beside each inequality bears.

The twin of `polefence.proof.claims.bordered`, for every kind of error of the gain. An error comes
in through the inputs, B times ``left``, and takes X C' times ``right``; it is bounded by

    [ F, mu^1/2 M1 (x) B G, e mu^-1/2 M2' (x) X C' H' ; *, I, 0 ; *, 0, I ] > 0

with one multiplier mu for each L, M = M1 M2 of the region.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Protocol

import numpy as np

from polefence.certify.candidates import first, rising
from polefence.certify.margins.claims import BOX, GAIN, SIMPLEX, Ladder, Reached, below
from polefence.certify.margins.loops import (
    Balanced,
    are_positive,
    count_whole,
    factors,
    kron,
    largest_step,
    region_block,
    whole_points,
)
from polefence.plant.system import Array
from polefence.proof.claims.bordered import Bordered
from polefence.proof.claims.margins import Subject
from polefence.region.regions import Region

COVERS = (1.0, 1.1, 1.5, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4)  # times Omega
# Of these where an error is given, and of the multipliers that are then tried.
TRIED, SHARES = 4, (1.0, 0.1, 10.0, 0.01, 100.0, 1e-3, 1e3, 1e-4, 1e4)

Coefficients = tuple[Array, Array, Array, Array]  # of X, N, B and X C'


class GainErrors(Protocol):
    """A kind of error of the gain."""

    @property
    def C(self) -> Array | None:
        """What the error is times, (N, r, n) at the vertices; None where it is the state."""

    @property
    def most(self) -> float:
        """No larger error is looked for."""

    def border(self, pair: int) -> tuple[Array, Array]:
        """Return the diagonal of G, (m,), and H' (r, b), of one L, M."""

    def beside(self, inputs: Array) -> tuple[Array, Array]:
        """Return what an error does to V of a remainder, whose rows of inputs have these sizes.

        What it takes of V's own diagonal, (m,), and H', (r, b).
        """

    def claim(self, subject: Subject, error: Fraction, mu: Sequence[float]) -> Bordered:
        """Return the claim of an error, with a multiplier for each L, M."""


@dataclass(frozen=True, eq=False)
class GainQuestion:
    """The largest error of the gain of a kind, for the loops of a design.

    ``finest`` is the number of finenesses that are tried; all where it is None.
    """

    loops: tuple[Balanced, ...]
    errors: GainErrors
    finest: int | None = None

    @property
    def ladder(self) -> Ladder:
        """Pieces and elevation that are tried; a law that was given is proved on its own domain."""
        first = self.loops[0]
        in_pieces = first.elevation is None and first.q
        return (BOX if in_pieces else SIMPLEX)[: self.finest]

    def count(self, pieces: int, elevation: int) -> float:
        """Return how many inequalities there are at most."""
        return sum(
            count_whole(loop, pieces, elevation)
            if loop.elevation is None
            else 2.0 * loop.domain.count(sum(loop.degrees) + loop.elevation + elevation)
            for loop in self.loops
        )

    def reach(self, pieces: int, elevation: int) -> Reached:
        """Return the largest error that is proved in floats, -1 where none is."""
        every = [self._coefficients(loop, pieces, elevation) for loop in self.loops]
        covers = COVERS if any(loop.spread is not None for loop in self.loops) else (1.0,)
        reached = (self._reach(every, pieces, elevation, cover) for cover in covers)
        return max(rising(reached, lambda at: at.value, GAIN), key=lambda at: at.value)

    def bears(self, error: float) -> Reached | None:
        """Return how an error is proved in floats, at the first fineness; None where it is not.

        Of each multiplier some are tried, near that of which both sides of the border take the
        same.
        """
        every = [self._coefficients(loop, 1, 0) for loop in self.loops]
        covers = COVERS if any(loop.spread is not None for loop in self.loops) else (1.0,)
        return first(self._bears(every, error, cover) for cover in covers[:TRIED])

    def _bears(self, every: Sequence[Coefficients], error: float, cover: float) -> Reached | None:
        """Return it for so many times Omega."""
        largest = list[tuple[float, float]]()
        for loop, (X, N, B, Y) in zip(self.loops, every, strict=True):
            if not loop.disks and not are_positive(X):
                return None
            for L, M in loop.pairs:
                left, right = self.errors.border(len(largest))
                (M1, M2), F = factors(M), region_block((L, M), X, N) - loop.lost(M, cover)
                E, H = kron(M1, B * left), error * kron(M2.T, Y @ right)
                mu = float(np.linalg.norm(H)) / max(float(np.linalg.norm(E)), np.finfo(float).tiny)
                one, other = E @ E.swapaxes(-1, -2), H @ H.swapaxes(-1, -2)
                near = (mu * share for share in SHARES)
                held = (at for at in near if are_positive(F - at * one - other / at))
                taken = next(held, None)
                if taken is None:
                    return None
                largest.append((error, taken))
            if loop.spread is not None and error > self._covered(loop, loop.elevation or 0, cover):
                return None
        return Reached(error, 1, 0, tuple(largest), cover)

    def of(self, region: Region) -> GainQuestion:
        """Return that of another region of one part."""
        return replace(
            self, loops=tuple(replace(loop, pairs=region.pairs()) for loop in self.loops)
        )

    def claim(self, subject: Subject, reached: Reached) -> Bordered:
        """Return the claim of an error, or a little less."""
        return self.claim_of(subject, reached, below(reached.value))

    def claim_of(self, subject: Subject, reached: Reached, error: Fraction) -> Bordered:
        """Return the claim of an error, with the multipliers that leave the most room.

        F - mu E E' - error^2 H H' / mu is positive definite at the largest error for its mu. With
        both times a share s < 1, F - s (...) is left: mu belongs to the error in proportion.
        """
        mu = [mu * float(error) / largest for largest, mu in reached.largest]
        return self.errors.claim(subject, error, mu)

    def _coefficients(self, loop: Balanced, pieces: int, elevation: int) -> Coefficients:
        if loop.elevation is None:
            X, N, B = loop.loop(whole_points(loop, pieces, elevation))
            return X, N, B, X @ loop.T.T
        total, C = loop.elevation + elevation, self.errors.C
        X, N, B = loop.raised(total)
        return X, N, B, X @ loop.T.T if C is None else loop.seen(C, total)[None]

    def _reach(
        self, every: Sequence[Coefficients], pieces: int, elevation: int, cover: float
    ) -> Reached:
        """Return it for so many times Omega."""
        largest, most = list[tuple[float, float]](), self.errors.most
        for loop, (X, N, B, Y) in zip(self.loops, every, strict=True):
            if not loop.disks and not are_positive(X):
                return Reached(-1.0, pieces, elevation)
            for L, M in loop.pairs:
                F = region_block((L, M), X, N) - loop.lost(M, cover)
                if not are_positive(F):
                    return Reached(-1.0, pieces, elevation)
                left, right = self.errors.border(len(largest))
                largest.append(largest_bordered(F, M, B * left, Y @ right))
            if loop.spread is not None:
                most = min(most, self._covered(loop, (loop.elevation or 0) + elevation, cover))
        value = min(most, *(error for error, _ in largest))
        return Reached(value, pieces, elevation, tuple(largest), cover)

    def _covered(self, loop: Balanced, elevation: int, cover: float) -> float:
        """Return the largest error up to which Omega, so many times, is more than V'V."""
        spread, C, n = loop.spread, self.errors.C, len(loop.T)
        if spread is None:
            return math.inf
        X, V = loop.covered(elevation if C is None else elevation + loop.plant_degree)
        Y = X @ loop.T.T if C is None else loop.seen(C, elevation)
        less, right = self.errors.beside(np.diag(spread.inputs))
        H, w = Y @ right, V.shape[-2]
        size = n + w + H.shape[-1]
        base, slope = (np.zeros((len(X), size, size)) for _ in range(2))
        base[:, :n, :n], base[:, n:, n:] = cover * spread.omega, np.eye(size - n)
        base[:, n : n + w, n : n + w] -= np.diag(np.concatenate([np.zeros(w - len(less)), less]))
        base[:, n : n + w, :n], base[:, :n, n : n + w] = V, V.swapaxes(1, 2)
        slope[:, :n, n + w :], slope[:, n + w :, :n] = H, H.swapaxes(1, 2)
        return largest_step(base, slope)


def largest_bordered(F: Array, M: Array, left: Array, right: Array) -> tuple[float, float]:
    """Return the largest error for one L, M, and its mu.

    For a given mu it is a generalised eigenvalue of
    [ F, mu M1 (x) B S, 0 ; *, mu I, 0 ; 0, 0, mu I ] and [ 0, 0, M2' (x) W T ; 0, 0, 0 ; *, 0, 0 ],
    and concave in mu.
    """
    M1, M2 = factors(M)
    E, H = kron(M1, left), kron(M2.T, right)
    d, inner = F.shape[-1], F.shape[-1] + E.shape[-1]
    whole = inner + H.shape[-1]
    base, slope = (np.zeros((*F.shape[:-2], whole, whole)) for _ in range(2))
    base[..., :d, :d] = F
    slope[..., :d, inner:], slope[..., inner:, :d] = H, H.swapaxes(-1, -2)
    diagonal = range(d, whole)

    def error(log_mu: float) -> float:
        root = math.exp(log_mu / 2)  # the border's rows over root(mu): the same signs
        base[..., :d, d:inner], base[..., d:inner, :d] = root * E, root * E.swapaxes(-1, -2)
        base[..., diagonal, diagonal] = 1.0
        return largest_step(base, slope / root)

    size = float(np.linalg.norm(E, axis=(-2, -1)).max()) ** 2
    top = math.log(float(np.linalg.eigvalsh(F).max()) / size) if size else 0.0
    best = _golden(error, top - 9.0 * math.log(10), top + math.log(10))  # nine decades of mu
    return error(best), math.exp(best)


def _golden(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function that rises, then falls, is largest."""
    ratio = (math.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = function(a), function(b)
    for _ in range(30):
        if at_a >= at_b:  # where neither holds, mu is too large
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = function(b)
    return (low + high) / 2
