"""Lower bounds by the compiled prover: dual matrices close to ones that are exactly feasible.

`polefence.certify.repair` makes dual matrices exactly feasible in rationals. Here nothing is solved
exactly: the kernel proves, in whole numbers, that the equations of `polefence.proof.lower` have a
solution close by, and that all matrices so close are positive definite. What it needs besides the
matrices is how to change them: X_b by Psi_b Theta, Psi nearly a right inverse of the equations.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.base.kernel import kernel
from polefence.certify.repair import IDLE, SHORTFALLS
from polefence.lmi.solve.scaling import summed, transposed
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.lower import METHODS, block_pairs

SHARES = [1 - shortfall for shortfall in SHORTFALLS]  # of a radius that are tried
SMALL, LARGE = 1e-60, 1e60  # between which the kernel takes scales and radii


def is_there() -> bool:
    """Whether this prover was compiled."""
    return hasattr(kernel(), "lower")


def lower_radius(
    plant: UncertainPlant,
    method: str,
    sigma: float,
    upper: float,
    Y: npt.ArrayLike,
    right_hand_sides: bool = False,
) -> float | None:
    """Return a radius closely below ``upper`` that the method cannot reach, proved; else None.

    Parameters
    ----------
    method : str
        "quadratic", "slack" or "scheduled".
    sigma : float
        The centre is -sigma.
    upper : float
        A radius just above the infimum, at which Y solves the dual problem approximately.
    Y : (blocks, 2n, 2n) array
        In the order of `polefence.proof.lower.block_pairs`.
    """
    dual = np.asarray(Y, dtype=float)
    if not _askable(plant, method, dual):
        return None
    layout = _layout(method, len(plant.vertices))
    best, tried = len(SHARES), set[bytes]()
    with np.errstate(all="ignore"):
        dual, share = _even(dual, layout)
        for least in IDLE:
            idle = np.asarray(share < least)
            if not best or idle.tobytes() in tried:
                continue
            tried.add(idle.tobytes())
            kept = np.where((idle @ layout.count > 0)[:, None, None], 0.0, dual)
            with suppress(np.linalg.LinAlgError):
                sought = _sought(layout, plant.A, plant.B, sigma, kept)
                radius = _first(plant, layout, sigma, upper, sought, best, right_hand_sides)
                best = radius if radius >= 0 else best
    return upper * SHARES[best] if best < len(SHARES) else None


def _askable(plant: UncertainPlant, method: str, dual: Array) -> bool:
    """Whether the kernel is there, and has such bounds."""
    n = plant.shape[0]
    if not is_there() or method not in METHODS:
        return False
    return dual.shape == (_layout(method, len(plant.vertices)).blocks, 2 * n, 2 * n)


@dataclass(frozen=True, eq=False)
class _Layout:
    """Which products S_j W_k are in which block.

    Attributes
    ----------
    b, j, k : arrays of int
        Of each product its block and its indices.
    count : (kinds, blocks) array
        How often W_k is in each block.
    sums : (kinds, products) array
        Which products are of W_k.
    """

    method: str
    b: Any
    j: Any
    k: Any
    count: Array
    sums: Array

    @property
    def blocks(self) -> int:
        return int(self.count.shape[1])

    @property
    def joint(self) -> bool:
        return self.method != "scheduled"

    @property
    def slack(self) -> bool:
        return self.method == "slack"


@lru_cache(maxsize=32)
def _layout(method: str, N: int) -> _Layout:
    pairs = block_pairs(method, N)
    triples = np.array(
        [(b, j, k) for b, entries in enumerate(pairs) for j, k in entries], dtype=np.int64
    )
    b, j, k = triples.T
    count = np.zeros((k.max() + 1, len(pairs)))
    np.add.at(count, (k, b), 1.0)
    return _Layout(method, b, j, k, count, (np.arange(len(count))[:, None] == k).astype(float))


def _even(dual: Array, layout: _Layout) -> tuple[Array, Array]:
    """Return the matrices, symmetric and of one size, and each vertex's share of their weight."""
    diagonal = np.diagonal(dual, axis1=-2, axis2=-1)
    diagonal = diagonal if (diagonal > 0).all() else np.full(diagonal.shape, np.nan)
    dual = (dual + transposed(dual)) / (2 * diagonal.max())
    if layout.slack:
        n = dual.shape[-1] // 2
        both = (dual[..., :n, :n] + dual[..., n:, n:]) / 2
        dual[..., :n, :n] = dual[..., n:, n:] = both
    part = layout.count @ diagonal
    return dual, np.asarray((part / part.max(axis=0)).max(axis=-1))


@dataclass(frozen=True, eq=False)
class _Sought:
    """What the kernel is asked with: dual matrices, how to change them, and scales."""

    dual: Array
    Psi: Array
    scale: Array
    rho: Array

    @property
    def is_usable(self) -> bool:
        """Whether the kernel takes it: units may be too far apart."""
        scales = np.append(self.scale, self.rho)
        finite = np.isfinite(self.dual).all() and np.isfinite(self.Psi).all()
        return bool(finite and scales.min() > SMALL and scales.max() < LARGE)


def _sought(layout: _Layout, A: Array, B: Array, sigma: float, dual: Array) -> _Sought:
    """Bring dual matrices close to ones that satisfy the equations."""
    n, N = A.shape[-1], A.shape[-3]
    S, dual = A + sigma * np.eye(n), dual.copy()
    blocks = dual[..., :n, :n] + dual[..., n:, n:]
    weight = summed(layout.count, blocks)  # P + R of each W
    forms = np.concatenate([S, B], axis=-1) if layout.slack else B
    weighed = weight @ forms
    H = transposed(forms) @ weighed
    H = H.sum(axis=-3, keepdims=True) if layout.joint else H
    used = np.asarray(np.diagonal(weight, axis1=-2, axis2=-1).any(axis=-1))
    H = np.where(used[..., None, None], H, np.eye(H.shape[-1]))
    rho = np.sqrt(np.diagonal(H, axis1=-2, axis2=-1))
    units = rho[..., :, None] * rho[..., None, :]
    inverse = np.linalg.inv(H / units) / units
    Psi = weighed @ inverse
    free = _free(inverse, weight) if layout.slack else None
    for _ in range(2):
        wanted = _residuals(layout, S, B, dual[..., :n, n:])
        if free is not None:
            wanted[..., :n, :] += free(wanted)
        change = -Psi @ wanted
        dual[..., :N, :n, n:] += change
        dual[..., :N, n:, :n] += transposed(change)
    size = np.diagonal(weight, axis1=-2, axis2=-1).sum(axis=-2)
    return _Sought(dual, np.ascontiguousarray(Psi), 2.0 ** np.round(np.log2(size) / 2), rho)


def _first(
    plant: UncertainPlant,
    layout: _Layout,
    sigma: float,
    upper: float,
    sought: _Sought,
    count: int,
    right_hand_sides: bool,
) -> int:
    """Return which of the nearest ``count`` radii is the first that is proved; else negative."""
    radii = upper * np.array(SHARES[:count])
    if not sought.is_usable or not (radii.min() > SMALL and radii.max() < LARGE):
        return -1
    data, denominator, words = plant.words
    exponents = np.eye(len(plant.vertices), dtype=np.int64)
    return int(
        kernel().lower(
            layout.slack,
            right_hand_sides,
            layout.joint,
            (exponents, data, denominator, plant.shape[0], words),
            sigma,
            sought.dual,
            sought.Psi,
            sought.scale,
            sought.rho,
            radii,
        )
    )


def _residuals(layout: _Layout, S: Array, B: Array, X: Array) -> Array:
    """Return what the equations of Z or L, and before them of the skew part of G, leave."""
    if layout.joint:
        left = np.asarray((transposed(B) @ X).sum(axis=-3, keepdims=True))
        if not layout.slack:
            return left
        V = (transposed(S) @ X).sum(axis=-3, keepdims=True)
        return np.concatenate([(V - transposed(V)) / 2, left], axis=-2)
    products = transposed(B)[..., layout.j, :, :] @ X[..., layout.b, :, :]
    return summed(layout.sums, products)


def _free(inverse: Array, weight: Array) -> Callable[[Array], Array]:
    """Return what finds the symmetric part of S'X's change, which is free, where X changes least.

    The change is weight Phi Theta, its square tr(t' inverse t weight^-1) for t = wanted + [U; 0].
    """
    n, T = weight.shape[-1], transposed
    size = np.sqrt(np.diagonal(weight, axis1=-2, axis2=-1))
    L = size[..., None] * np.linalg.cholesky(weight / (size[..., :, None] * size[..., None, :]))
    values, vectors = np.linalg.eigh(T(L) @ inverse[..., :n, :n] @ L)
    Q, back = L @ vectors, np.linalg.solve(T(L), vectors)
    left, sums = T(Q) @ inverse[..., :n, :], values[..., :, None] + values[..., None, :]

    def part(wanted: Array) -> Array:
        slope = left @ wanted @ back
        return np.asarray(-Q @ ((slope + T(slope)) / sums) @ T(Q))

    return part
