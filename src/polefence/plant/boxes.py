"""Parts of the box of parameters: the points in one, and the box halved until each part will do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any, TypeVar

import numpy as np

from polefence.plant.polynomial import Domain, Exponent, Polynomial, bernstein, degree_of, values
from polefence.plant.system import Array

T = TypeVar("T")

Point = tuple[float, ...]

MOST_PARTS = 64
# Of a plant that is sampled between nodes: the rms of a van's law of order 1 at 1 ms is proved
# within 5, 2 and 0.5 % in 30, 68 and 149 parts.
MOST_BENT = 400
# Side of a part that is halved: with its square, 2^-60, what samples bend is below the rounding of
# the nodes, 2^-51, and less of it helps no more. The narrowest part of a proof was 2^-14 wide.
NARROWEST = 2.0**-30
NIL = 1e-14  # of a weight that rounding left


@dataclass(frozen=True)
class Box:
    """A part of the box; ``low`` and ``high`` are weights of each parameter's upper end."""

    low: Point
    high: Point

    @classmethod
    def whole(cls, domain: Domain) -> Box:
        """Return all of it."""
        count = len(domain.sizes)
        return cls((0.0,) * count, (1.0,) * count)

    def halves(self, k: int) -> tuple[Box, Box]:
        """Return the part halved along a parameter."""
        low, high = self.low, self.high
        middle = (low[k] + high[k]) / 2
        return (
            Box(low, (*high[:k], middle, *high[k + 1 :])),
            Box((*low[:k], middle, *low[k + 1 :]), high),
        )

    def alpha(self, domain: Domain, weights: Array) -> Array:
        """Return alpha of points whose weights of the part's own corners are ``own``."""
        low, high = np.array(self.low), np.array(self.high)
        return _alpha(domain, low + (high - low) * domain.coordinates(weights)[..., 1::2])

    def polynomial(self, P: Polynomial, domain: Domain) -> Polynomial:
        """Return a polynomial in coordinates of the part."""
        degree = degree_of(P, domain)
        at = self.alpha(domain, domain.nodes(degree))
        return bernstein(domain, domain.interpolated(values(P, domain, at), degree), degree)


@lru_cache(maxsize=256)
def weights(box: Box, domain: Domain, degree: int) -> dict[Exponent, dict[Exponent, float]]:
    """Return the coefficients on a part as weights of those on the whole, of one degree."""
    exponents = domain.monomials(degree)
    units = {e: unit[:, None] for e, unit in zip(exponents, np.eye(len(exponents)), strict=True)}
    return {
        target: {e: float(w) for e, w in zip(exponents, column[:, 0], strict=True) if abs(w) > NIL}
        for target, column in box.polynomial(units, domain).items()
    }


def equal(pieces: tuple[int, ...]) -> tuple[Box, ...]:
    """Split each interval into the given number of parts; empty if there are no parameters."""
    if not pieces:
        return ()
    numbers = product(*(range(n) for n in pieces))
    return tuple(
        Box(
            tuple(k / n for k, n in zip(place, pieces, strict=True)),
            tuple((k + 1) / n for k, n in zip(place, pieces, strict=True)),
        )
        for place in numbers
    )


def _alpha(domain: Domain, t: Array) -> Array:
    return domain.alpha(np.stack([1 - t, t], axis=-1).reshape(*t.shape[:-1], -1))


def divided(
    open_: list[Box],
    prove: Callable[[Box], T | None],
    along: Callable[[Box], int | None],
    most: int = MOST_PARTS,
) -> list[tuple[Box, T]] | None:
    """Return parts that make up the open ones, each with what was found for it.

    Parameters
    ----------
    along : callable
        The parameter along which a part is halved for which nothing was found; None gives up.
    most : int
        How many parts there may be; None is returned where that is not enough.
    """
    done = list[tuple[Box, T]]()
    while open_:
        if len(open_) + len(done) > most:
            return None
        *open_, box = open_
        proof = prove(box)
        if proof is not None:
            done.append((box, proof))
            continue
        k = along(box)
        if k is None or box.high[k] - box.low[k] < NARROWEST:
            return None
        open_ = [*open_, *box.halves(k)]
    return done


def widest(
    domain: Domain,
    loops: Callable[[Array], Array],
    inside: Callable[[Any], Array],
    off: Array | None = None,
    never: Sequence[int] = (),
) -> int:
    """Return the number of the parameter along which closed loops at alpha change most.

    Each pole is moved beside how far it is inside: a slow one that comes near the edge changes a
    Lyapunov matrix more than a fast one that moves far. Between its corners a Lyapunov matrix is
    off by about a quarter of the square of that, and by twice what the loop itself is off by.

    Parameters
    ----------
    loops : callable
        From points alpha to the loops there.
    inside : callable
        From poles to how far each is inside of a region.
    off : (count, n, n), optional
        What entries of the loops are off by along each parameter, of samples between nodes.
    never : sequence of int
        Parameters that are not asked for.
    """
    count = len(domain.sizes)
    ends = np.full((2 * count + 1, count), 0.5)
    for k in range(count):
        ends[2 * k : 2 * k + 2, k] = 0.0, 1.0
    poles = np.linalg.eigvals(loops(_alpha(domain, ends)))
    depth = np.maximum(inside(poles), NIL * np.abs(poles) + np.finfo(float).tiny)
    low, high = (poles[:-1:2], depth[:-1:2]), (poles[1::2], depth[1::2])
    # both ends may be alike, and the middle another loop: where a parameter's cosine counts, say
    middle = np.repeat(poles[-1:], count, axis=0), np.repeat(depth[-1:], count, axis=0)
    pairs = ((low, high), (high, low), (low, middle), (high, middle))
    moved = np.max([_moved(*pair) for pair in pairs], axis=0) ** 2 / 4
    if off is not None:
        middle = loops(_alpha(domain, np.full((1, count), 0.5)))[0]
        moved = moved + 2 * _shifted(middle, inside, off)
    moved[list(never)] = -np.inf
    return int(moved.argmax())


def _shifted(loop: Array, inside: Callable[[Any], Array], off: Array) -> Array:
    """Return about how far poles of a loop go where its entries are off, the most of each."""
    poles, V = np.linalg.eig(loop)
    try:
        left = np.abs(np.linalg.inv(V))
    except np.linalg.LinAlgError:  # a pole of several that has one mode
        return np.full(len(off), np.inf)
    depth = np.maximum(inside(poles), NIL * np.abs(poles) + np.finfo(float).tiny)
    return np.asarray((np.einsum("pi,kij,jp->kp", left, off, np.abs(V)) / depth).max(axis=1))


def _moved(one: tuple[Any, Array], other: tuple[Any, Array]) -> Array:
    """Return how far poles are from the nearest ones of other loops, the most of each loop."""
    apart = np.abs(one[0][:, :, None] - other[0][:, None, :])
    nearest = apart.argmin(axis=-1)  # as sets: eigenvalues come in no order
    depth = np.minimum(one[1], np.take_along_axis(other[1], nearest, axis=-1))
    return np.asarray((apart.min(axis=-1) / depth).max(axis=-1))
