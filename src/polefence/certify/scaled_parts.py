"""Bounds of opened loops in parts of the box, each with a scale of its own.

Parameters that do not move are constants: what is proved of each plant may scale the loops as that
plant wants it. One scale of the whole box is a compromise of all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from polefence.base.errors import InputError, PolefenceError
from polefence.law.laws import Law
from polefence.plant.boxes import Box
from polefence.plant.family import UncertainPlant
from polefence.plant.parts import inside
from polefence.plant.points import seeded
from polefence.proof.claims.base import prove
from polefence.proof.claims.disk_margin import AtLoops
from polefence.proof.laws import Evidence, Piece
from polefence.proof.work import FormatError
from polefence.requirements.specification import Specification, claim_of

# Parts. Two crossed loops that have 2 at the worst plant are proved at 2.121, 2.062, 2.025, 2.007
# in 6, 12, 24 and 48, a worst-case gain of 5 at 6.38, 5.58, 5.22 and 5.09 in 2, 9, 13 and 14 s.
MOST = 12
# Points of a part, beside its corners, and how many of these are scaled alone: of a random family
# 20 points missed 2.6 % of the worst, and parts were looked for in vain for a minute.
POINTS, CLOSELY = 300, 12
# Share of a bound that parts are to gain, else they are not tried: one family took 100 s for 0.7 %.
WORTH = 1e-2
NEAR, PATIENCE = 2e-3, 2  # how near the worst is near enough; halvings that may gain nothing

Prove = Callable[[UncertainPlant, Law, Specification], Any]


class Found(NamedTuple):
    """What is proved in parts: the claim, and how."""

    claim: Any
    reason: str
    degree: int


@dataclass(frozen=True)
class _Part:
    """A part of the box with what is proved there."""

    box: Box
    claim: AtLoops

    @property
    def pieces(self) -> Iterator[Piece]:
        """The part with its evidence and its scale, or its own parts."""
        evidence, loops = self.claim.subject.evidence, self.claim.loops
        low, high = (tuple(map(Fraction, ends)) for ends in (self.box.low, self.box.high))
        zeros, ones = ((Fraction(k),) * len(low) for k in range(2))
        known = evidence.cells or (Piece(zeros, ones, evidence),)
        for piece in known:
            start, end = (
                tuple(a + (b - a) * t for a, b, t in zip(low, high, point, strict=True))
                for point in (piece.low, piece.high)
            )
            yield Piece(start, end, piece.evidence, loops.weights, loops.leads)


@dataclass(frozen=True, eq=False)
class InParts:
    """A search for parts of the box of a plant, in its delta form."""

    plant: UncertainPlant
    law: Law
    specification: Specification
    prove: Prove

    def least(self, known: float) -> Found | None:
        """Return the least bound in parts, None where it is no better than the known one."""
        whole = Box.whole(self.law.domain_of(self.plant))
        worst = self._worst(*self._inside(whole))
        if not worst * (1 + WORTH) < known:
            return None
        parts, levels = self._halves(whole), list[float]()
        while parts is not None and len(parts) < MOST:
            highest = max(parts, key=lambda part: part.claim.level)
            levels.append(float(highest.claim.level))
            done = levels[-1] <= worst * (1 + NEAR)
            if done or (len(levels) > PATIENCE and levels[-1] >= levels[-1 - PATIENCE]):
                break
            more = self._halves(highest.box)
            if more is None:
                break
            parts = [*(part for part in parts if part is not highest), *more]
        if parts is None:
            return None
        level = max(part.claim.level for part in parts)
        return self._joined(parts, level) if level < known else None

    def kept(self, level: float) -> Found | None:
        """Return the proof of a level in parts, None where there is none."""
        whole = Box.whole(self.law.domain_of(self.plant))
        if not self._worst(*self._inside(whole)) < level:
            return None
        open_, done = list(whole.halves(self._widest(whole))), list[_Part]()
        while open_:
            box = open_.pop()
            part = self._part(box)
            if part is not None:
                done.append(part)
                continue
            if len(open_) + len(done) + 2 > MOST or not self._worst(*self._inside(box)) < level:
                return None
            open_ += box.halves(self._widest(box))
        return self._joined(done, Fraction(level))

    def _inside(self, box: Box) -> tuple[UncertainPlant, Law]:
        low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
        plant = inside(self.plant, low, high)
        return plant, self.law.inside(plant, low, high)

    def _worst(self, plant: UncertainPlant, law: Law) -> float:
        """Return about the worst level of plants, each scaled as it is best."""
        specification, alpha = self.specification, seeded(plant, len(plant.vertices) + POINTS)
        with suppress(InputError):  # no scale is one for all
            opened, beside, gain = specification.posed(plant, law)
            alpha = alpha[np.argsort(-gain.values(opened, beside, alpha), kind="stable")]
        own = specification.best_scales(plant, law, alpha[:CLOSELY])
        return float(max(level for _, level in own))

    def _widest(self, box: Box) -> int:
        """Return the parameter along which the scale changes most."""
        plant, law = self._inside(box)
        domain = self.law.domain_of(plant)
        count = len(domain.sizes)
        ends = np.full((2 * count, count), 0.5)
        for k in range(count):
            ends[2 * k : 2 * k + 2, k] = 0.0, 1.0
        alpha = domain.alpha(np.stack([1 - ends, ends], axis=-1).reshape(2 * count, -1))
        theta = [theta for theta, _ in self.specification.best_scales(plant, law, alpha)]
        moved = [np.abs(a - b).max() for a, b in zip(theta[::2], theta[1::2], strict=True)]
        return int(np.argmax(moved))

    def _part(self, box: Box) -> _Part | None:
        plant, law = self._inside(box)
        try:
            bound = self.prove(plant, law, self.specification)
        except PolefenceError:  # no scale is one for all of it
            return None
        return None if bound is None else _Part(box, bound.claim)

    def _halves(self, box: Box) -> list[_Part] | None:
        parts = list(map(self._part, box.halves(self._widest(box))))
        return None if None in parts else [part for part in parts if part is not None]

    def _joined(self, parts: list[_Part], level: Fraction) -> Found | None:
        """Return the claim that the parts prove together."""
        pieces = tuple(piece for part in parts for piece in part.pieces)
        evidence = Evidence([], cells=pieces)
        on = self.law.domain_of(self.plant).on
        claim = claim_of(self.plant, self.law.exact, on, self.specification, evidence, level)
        try:
            verdict = prove(claim)
        except FormatError:  # more work than is checked
            return None
        return Found(claim, verdict.reason, evidence.highest) if verdict.proved else None
