r"""Targets of a search: regions that grow with one number r.

A part of a region is { z : L + M z + M' conj(z) < 0 }. Here L = L0 + r L1 and M = M0 + r M1, so
that the inequality F = -(L (x) X + M (x) N + M' (x) N') > 0 is affine in r, and the question for
the least r is a generalised eigenvalue problem, whatever the region.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from polefence.plant.boxes import Box
from polefence.plant.motion import STILL, Motion
from polefence.plant.system import Array
from polefence.region.regions import Region

# Decay rates are looked for up to this multiple of the rate that is typical of the region.
FASTEST = 2.5


@dataclass(frozen=True, eq=False)
class Side:
    """One inequality's L0, L1, M0, M1."""

    L0: Array
    L1: Array
    M0: Array
    M1: Array

    @property
    def is_half_plane(self) -> bool:
        """Whether it is Re z < -(decay)."""
        return len(self.L0) == 1 and bool(self.M0.any())

    def is_about(self, motion: Motion) -> bool:
        """Whether it says how fast motions decay: a half-plane, in discrete time a disk."""
        if motion.centre is None:
            return self.is_half_plane
        if len(self.L0) != 2 or self.M0.tolist() != [[0, 1], [0, 0]] or self.M1.any():
            return False
        # to rounding
        return bool(abs(self.L0[0, 1] - motion.centre) <= 1e-9 * max(motion.centre, 1e-300))


@dataclass(frozen=True, eq=False)
class Patch:
    """Values of the parameters beside estimates of them, the vertices of both in the same order.

    Attributes
    ----------
    plant : (N, N) array
        alpha of the plant at the patch's corners.
    box : Box
        Of the estimates, as a part of the box of the parameters.
    """

    plant: Array
    box: Box


@dataclass(frozen=True, eq=False)
class Target:
    """Inequalities that grow with r, in units of some rate.

    Attributes
    ----------
    sides : tuple of Side
    positive : bool
        Whether X > 0 has to be asked for besides.
    sigma : float, optional
        Of disks, minus their centre: they have layouts worked out once.
    motion : Motion
        Of the parameters, which half-planes, in discrete time disks, are to hold under; other
        parts are of each value of theirs.
    patches : tuple of Patch
        Where the law is given estimates of the parameters: pairs of these and of estimates.
    """

    sides: tuple[Side, ...]
    positive: bool = False
    sigma: float | None = None
    motion: Motion = STILL
    patches: tuple[Patch, ...] = ()

    def under(self, motion: Motion) -> Target:
        """Return it for parameters that move, if it is about motions."""
        moves = any(side.is_about(motion) for side in self.sides)
        return replace(self, motion=motion) if moves else self

    def named(self, name: str) -> Iterator[tuple[str, Side]]:
        """Yield the inequalities with the names of their blocks."""
        for number, side in enumerate(self.sides, 1):
            yield name if len(self.sides) == 1 else f"part {number}, {name}", side


NO_REGION = Target(())


class Goal:
    """What a search makes as good as it can be: inequalities that grow with r."""

    rated: ClassVar[bool] = True  # whether r is a rate [1/s]
    disks: ClassVar[bool] = False  # whether r is the radius of disks, which have starts and duals

    @property
    def scale(self) -> float:
        """A rate typical of the problem [1/s]; zero where it has none."""
        raise NotImplementedError

    @property
    def is_open(self) -> bool:
        """Whether its inequalities leave open that X > 0, as those of cones do."""
        return False

    def centre_of(self, scale: float) -> float:
        """Return the centre of disks from which a search starts, for rates of this scale."""
        return -scale

    def target(self, rate: float) -> Target:
        """Return the inequalities, rates measured in ``rate``."""
        raise NotImplementedError


@dataclass(frozen=True)
class Disks(Goal):
    """Disks with one centre; r is the radius less ``beyond`` [1/s]: a search resolves the rest."""

    centre: float
    beyond: float = 0.0
    disks = True

    @property
    def scale(self) -> float:
        return abs(self.centre)

    def centre_of(self, scale: float) -> float:  # noqa: ARG002
        return self.centre

    def target(self, rate: float) -> Target:
        return disks(-self.centre / rate, self.beyond / rate)


@dataclass(frozen=True)
class Around(Goal):
    """A region made wider: r = 1 is the region itself, less is inside."""

    region: Region
    rated = False

    @property
    def scale(self) -> float:
        return self.region.scale

    def centre_of(self, scale: float) -> float:  # noqa: ARG002
        """Return one on the left, or that of a disk that reaches over zero.

        Not of one about a point on the right, which other parts of the region keep on the left.
        """
        kept = self.region.stable
        circles = [part.circle for part in self.region.parts if part.circle]
        reaching = [c for c, radius in circles if c + radius > 0 and not (kept and c >= 0)]
        return reaching[0] if reaching else -self.scale

    @property
    def is_open(self) -> bool:
        return not any(part.definite for part in self.region.parts)

    def target(self, rate: float) -> Target:
        return Target(tuple(_wider(L, M) for L, M in self.region.pairs(rate)), self.is_open)


@dataclass(frozen=True)
class Decays(Goal):
    """Half-planes; r is ``fastest`` less the decay rate [1/s]. Optionally within a fixed region."""

    fastest: float
    within: Region | None = None

    @property
    def scale(self) -> float:
        return self.fastest / FASTEST

    def target(self, rate: float) -> Target:
        one, none = np.eye(1), np.zeros((1, 1))
        side = Side(2 * self.fastest / rate * one, -2 * one, one, none)
        return Target((side, *fixed(self.within, rate)), positive=True)


@dataclass(frozen=True)
class Sectors(Goal):
    """Sectors; r is the slope |Im z| / |Re z|. Optionally within a fixed region."""

    size: float
    within: Region | None = None
    rated = False

    @property
    def scale(self) -> float:
        return self.size

    def target(self, rate: float) -> Target:
        none, turn = np.zeros((2, 2)), np.array([[0.0, 1.0], [-1.0, 0.0]])
        side = Side(none, none, turn, np.eye(2))
        return Target((side, *fixed(self.within, rate)), positive=True)


def disks(sigma: float, beyond: float = 0.0) -> Target:
    """Return the disks about -sigma, r their radius less ``beyond``."""
    none = np.zeros((2, 2))
    L = np.array([[-beyond, sigma], [sigma, -beyond]])
    side = Side(L, -np.eye(2), np.array([[0.0, 1.0], [0.0, 0.0]]), none)
    return Target((side,), sigma=sigma)


def _wider(L: Array, M: Array) -> Side:
    size = max(float(np.abs(np.linalg.eigvalsh(L)).max()), float(np.linalg.norm(M, 2)))
    margin = size * np.eye(len(L))
    return Side(L + margin, -margin, M, np.zeros_like(M))


def fixed(region: Region | None, rate: float) -> tuple[Side, ...]:
    """Return the inequalities of a region that does not grow with r."""
    if region is None:
        return ()
    return tuple(Side(L, np.zeros_like(L), M, np.zeros_like(M)) for L, M in region.pairs(rate))
