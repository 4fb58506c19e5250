"""The point of a box of parameters whose image is nearest to an estimate."""

from __future__ import annotations

import numpy as np

from polefence.plant.system import Array


def point(corners: Array, shares: Array) -> Array:
    """Return the multi-affine image of shares (..., q), with values (2^q, r) at the corners.

    The first parameter varies slowest, each from its low to its high end.
    """
    return np.asarray(corner_weights(_pairs(shares)) @ corners)


def slopes(corners: Array, shares: Array) -> Array:
    """Return the derivatives of `point` by each share, (..., q, r)."""
    pairs, turned = _pairs(shares), np.array([-1.0, 1.0])
    found = []
    for i in range(shares.shape[-1]):
        own = [*pairs]
        own[i] = np.broadcast_to(turned, pairs[i].shape)
        found.append(corner_weights(own) @ corners)
    return np.stack(found, axis=-2)


def corner_weights(pairs: list[Array]) -> Array:
    """Return the Kronecker product of pairs (..., 2), the first slowest."""
    first, *others = pairs
    for pair in others:
        product = first[..., :, None] * pair[..., None, :]
        first = product.reshape(*first.shape[:-1], -1)
    return first


def nearest(corners: Array, weight: Array, target: Array, start: Array, steps: int) -> Array:
    """Return shares in [0, 1] that minimise |point - target| in the metric of ``weight``.

    Gauss-Newton steps; one that meets the box is cut off there and followed by exact minimisation
    along every coordinate. Neither ever goes up. A share that nothing depends on stays where it is.

    Parameters
    ----------
    corners : (2^q, r) array
    weight : (..., r, r) array
        Positive definite.
    target : (..., r) array
    start : (..., q) array
        In the box.
    steps : int
        Two are enough where the start is a sample old.
    """
    shares = start
    for _ in range(steps):
        wrong = target - point(corners, shares)
        J = slopes(corners, shares)
        left = J @ weight
        H = left @ np.swapaxes(J, -1, -2)
        ridge = 1e-9 * np.max(H, axis=(-1, -2))[..., None, None] + 1e-300
        step = np.linalg.solve(H + ridge * np.eye(shares.shape[-1]), left @ wrong[..., None])
        moved = np.minimum(np.maximum(shares + step[..., 0], 0.0), 1.0)
        better = cost(weight, target - point(corners, moved)) <= cost(weight, wrong)
        shares = np.where(better[..., None], moved, shares)
        if not ((moved > 0) & (moved < 1) & better[..., None]).all():
            shares = _sweep(corners, weight, target, shares)
    return shares


def cost(weight: Array, wrong: Array) -> Array:
    """Return the squared length that `nearest` minimises, (...)."""
    return np.asarray(((wrong[..., None, :] @ weight) @ wrong[..., None])[..., 0, 0])


def _pairs(shares: Array) -> list[Array]:
    both = np.stack([1 - shares, shares], axis=-1)
    return [both[..., i, :] for i in range(shares.shape[-1])]


def _sweep(corners: Array, weight: Array, target: Array, shares: Array) -> Array:
    """Minimise along one coordinate after the other."""
    found = shares.copy()
    for i in range(shares.shape[-1]):
        line = slopes(corners, found)[..., i, :]
        pull = (weight @ line[..., None])[..., 0]
        steep = np.sum(pull * line, axis=-1)
        wrong = target - point(corners, found)
        step = np.sum(pull * wrong, axis=-1) / np.where(steep > 0, steep, np.inf)
        found[..., i] = np.minimum(np.maximum(found[..., i] + step, 0.0), 1.0)
    return found
