"""Where a box that grows first loses what is asked: found in floats, along rays from its centre."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import numpy as np

from polefence.base.errors import InputError
from polefence.base.progress import note
from polefence.certify.candidates import edge
from polefence.certify.robust.family import Family, Growth, centre_of, loops_of, short
from polefence.plant.family import UncertainPlant
from polefence.plant.points import SEED, weights_of
from polefence.plant.system import Array
from polefence.region.regions import Region
from polefence.requirements.specification import Specification

# Factors that are looked at: these, and from the last of them on in steps.
FIRST = (2.0**-10, 2.0**-7, 2.0**-5, 2.0**-4, 2.0**-3, 2.0**-2)
STEP = 2.0**0.25
MOST_RAYS, MOST_OF_LIMITS = 96, 24
MOST_CUBES = 2e7  # states cubed, times points of one factor
WIDER = 1.02  # a box in which a point that was found is looked at again
CLOSE = 1e-9  # of a factor, to which it is halved
NEARER = 1e-7  # a nearer point is nearer by this share
ROUNDS, TRIED = 40, 16  # of a climb, and points of each
# The same where proofs begin far below, for one near the edge takes long: a limit of samples takes
# 0.1 s for these points.
ROUGH, NEARER_ROUGH, FEWER_ROUNDS = 1e-5, 1e-4, 10
BEYOND = Fraction(10001, 10000)  # times a factor, where the plant has ended
HALVINGS = 20  # between a factor at which the plant exists and one at which it does not


@dataclass(frozen=True, eq=False)
class Lost:
    """Where something is lost, in floats.

    Attributes
    ----------
    factor : float
        Times the half-widths.
    shares : (k,) array
        Of the half-width of each parameter, from -1 to 1.
    """

    factor: float
    shares: Array


@dataclass(frozen=True, eq=False)
class Rays:
    """What is asked of a plant whose ranges grow, at points of the grown box.

    Attributes
    ----------
    growth : Growth
    names : tuple of str
        The parameters that grow together.
    region : Region
    limits : tuple of Specification
        Each with its ``at_most``.
    rough : bool
        Whether a proof begins so far below that the point need not be the nearest to all digits.
    """

    growth: Growth
    names: tuple[str, ...]
    region: Region
    limits: tuple[Specification, ...]
    rough: bool = False

    def factors(self, factor: Fraction) -> dict[str, Fraction]:
        """Return the factor of each parameter that grows."""
        return dict.fromkeys(self.names, factor)

    def first(self, most: Fraction) -> tuple[Lost | None, Fraction, str]:
        """Return the nearest point that was found at which something is lost, up to a factor.

        Also up to where was looked, and why no farther where the plant ends before.
        """
        rays, last, top, why = self._rays(), 0.0, 1.0, ""
        while True:
            top = min(top, float(most))
            family, ended = self._family(Fraction(top))
            if family is None:
                most = self._last(Fraction(last), Fraction(top))
                why = self._family(most * BEYOND)[1] or ended
                if most <= last:
                    return None, most, why
                continue
            for before, factor in self._steps(last, top):
                note(f"ranges {factor:.3g} times as wide")
                gone = self.lost(family, np.full(len(rays), factor), rays)
                if gone.any():
                    return self._nearest(family, rays[gone], before, factor), most, why
            if top >= float(most):
                return None, most, why
            last, top = top, 2 * top

    @staticmethod
    def _steps(last: float, top: float) -> Iterator[tuple[float, float]]:
        """Yield factors from one on, each with the one before."""
        for factor in (*FIRST, top):
            while last < factor:
                following = min(factor, last * STEP if last >= FIRST[-1] else factor)
                yield last, following
                last = following

    def _last(self, there: Fraction, ended: Fraction) -> Fraction:
        """Return nearly the last factor at which the plant exists."""
        low, _ = edge(
            lambda f: self._family(short(f, up=False))[0] is not None,
            float(there),
            float(ended),
            HALVINGS,
            close=1e-5,
        )
        return short(low, up=False)

    def lost(self, family: Family, factors: Array, shares: Array) -> Array:
        """Return whether something is lost at points of a family's box, (count,)."""
        alpha = self._alpha(family.plant, factors, shares)
        try:
            poles = np.linalg.eigvals(loops_of(family.plant, family.law, alpha))
        except np.linalg.LinAlgError:
            if len(alpha) == 1:  # the law has no value
                return np.ones(1, dtype=bool)
            single = [self.lost(family, factors[[k]], shares[[k]]) for k in range(len(alpha))]
            return np.concatenate(single)
        gone = np.asarray(self.region.distance(poles).max(axis=-1) >= 0)
        for limit in self.limits:
            kept = np.flatnonzero(~gone)
            if len(kept):
                gone[kept] = exceeded(family, limit, alpha[kept])
        return gone

    def _family(self, factor: Fraction) -> tuple[Family | None, str]:
        """Return the family that holds all points up to a factor; else None, and why."""
        try:
            return self.growth.at(self.factors(factor)), ""
        except InputError as error:
            return None, str(error)

    def _alpha(self, plant: UncertainPlant, factors: Array, shares: Array) -> Array:
        """Return the weights of points in a larger box."""
        values = []
        for k, p in enumerate(self.growth.plant.parameters):
            centre, half = map(float, centre_of(p))
            values.append(centre + half * shares[:, k] * (factors if p.name in self.names else 1.0))
        return weights_of(plant.parameters, np.stack(values, axis=1))

    def _rays(self) -> Array:
        """Return directions, of which some growing parameter is at an end: corners first."""
        parameters = self.growth.plant.parameters
        count, states = len(parameters), self.growth.plant.shape[0]
        most = MOST_OF_LIMITS if self.limits else MOST_RAYS
        most = max(min(2**count, 16), int(min(most, MOST_CUBES / states**3)))
        corners = np.array(list(product((-1.0, 1.0), repeat=count)))
        random = np.random.default_rng(SEED)
        if len(corners) > most:
            corners = corners[random.permutation(len(corners))[:most]]
        inner = random.uniform(-1, 1, (most - len(corners), count))
        grows = [k for k, p in enumerate(parameters) if p.name in self.names]
        inner[np.arange(len(inner)), random.choice(grows, len(inner))] = random.choice(
            [-1.0, 1.0], len(inner)
        )
        return np.vstack([corners, inner])

    def _nearest(self, family: Family, rays: Array, below: float, factor: float) -> Lost:
        """Return the point where the first of some rays loses something, and those about it."""
        rays = rays[:TRIED]
        found = self._crossings(family, rays, below, factor)
        k = int(found.argmin())
        best, shares = float(found[k]), rays[k]
        random, step = np.random.default_rng(SEED), 0.5
        nearer = NEARER_ROUGH if self.rough else NEARER
        for _ in range(FEWER_ROUNDS if self.rough else ROUNDS):
            moved = np.clip(shares + step * random.normal(size=(TRIED, len(shares))), -1, 1)
            stays = random.random(moved.shape) < 0.3
            moved = np.where(stays, shares, moved)
            gone = self.lost(family, np.full(TRIED, best * (1 - nearer)), moved)
            if not gone.any():
                step *= 0.6
                if step < 1e-4:
                    break
                continue
            found = self._crossings(family, moved[gone], best / 2, best)
            k = int(found.argmin())
            best, shares = float(found[k]), moved[gone][k]
        return self._polished(Lost(best, shares))

    def _polished(self, found: Lost) -> Lost:
        """Return it in a box that is hardly larger: samples are interpolated over the box."""
        if self.growth.plant.sampling is None:
            return found
        family, _ = self._family(short(found.factor * WIDER, up=True))
        if family is None:
            return found
        ray = found.shares[None]
        near = self._crossings(family, ray, found.factor / WIDER, found.factor * WIDER)
        return Lost(float(near[0]), found.shares)

    def _crossings(self, family: Family, rays: Array, below: float, above: float) -> Array:
        """Return the factor at which each ray loses something, closely."""
        low, high = np.full(len(rays), below), np.full(len(rays), above)
        close = ROUGH if self.rough else CLOSE
        for _ in range(60):
            if np.all(high - low <= close * high):
                break
            middle = (low + high) / 2
            gone = self.lost(family, middle, rays)
            low, high = np.where(gone, low, middle), np.where(gone, middle, high)
        return high


def exceeded(family: Family, limit: Specification, alpha: Array) -> Array:
    """Return whether a limit is exceeded at points of a family, as it is where a loop is unstable.

    In floats.
    """
    try:
        values = family.values(limit, alpha)
    except (InputError, np.linalg.LinAlgError):
        if len(alpha) == 1:
            return np.ones(1, dtype=bool)
        middle = len(alpha) // 2
        halves: Sequence[Array] = (alpha[:middle], alpha[middle:])
        return np.concatenate([exceeded(family, limit, half) for half in halves])
    return np.asarray(values > (limit.at_most or np.inf))
