"""Lower bounds by the compiled prover: dual matrices close to ones that are exactly feasible.

`polefence.design.repair` makes dual matrices exactly feasible in rationals. Here nothing is solved
exactly: the kernel proves, in whole numbers, that the equations of `polefence.proof.lower` have a
solution close by, and that all matrices so close are positive definite. What it needs besides the
matrices is how to change them: X_b by Psi_b Theta, Psi nearly a right inverse of the equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from polefence.design.repair import IDLE, SHORTFALLS
from polefence.lmi.solve.engine import kernel
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.lower import METHODS, block_pairs
from polefence.proof.work import FormatError

# Nearer to the radius than this its answer is taken; else rationals are tried too.
CLOSE = 1e-6
ROUNDS = 2  # of corrections in floats


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
    own, dual = kernel(), np.asarray(Y, dtype=float)
    if own is None or not hasattr(own, "lower") or method not in METHODS:
        return None
    layout = _layout(method, len(plant.vertices))
    n = plant.shape[0]
    radii = [upper * (1 - shortfall) for shortfall in SHORTFALLS if shortfall <= CLOSE]
    if dual.shape != (layout.blocks, 2 * n, 2 * n) or not min(radii) > 0:
        return None
    best = len(radii)
    with np.errstate(all="ignore"):
        for kept in _kept(dual, layout):
            try:
                found = _asked(own, plant, layout, sigma, kept, radii[:best], right_hand_sides)
            except (np.linalg.LinAlgError, FormatError):
                continue
            best = found if found >= 0 else best
            if not best:
                break
    return radii[best] if best < len(radii) else None


@dataclass(frozen=True, eq=False)
class _Layout:
    """Which products S_j W_k are in which block.

    Attributes
    ----------
    b, j, k : arrays of int
        Of each product its block and its indices.
    count : (kinds, blocks) array
        How often W_k is in each block.
    """

    method: str
    b: Any
    j: Any
    k: Any
    count: Array

    @property
    def blocks(self) -> int:
        return int(self.count.shape[1])

    @property
    def joint(self) -> bool:
        return self.method != "scheduled"


@lru_cache(maxsize=32)
def _layout(method: str, N: int) -> _Layout:
    pairs = block_pairs(method, N)
    triples = np.array([(b, j, k) for b, own in enumerate(pairs) for j, k in own], dtype=np.int64)
    b, j, k = triples.T
    count = np.zeros((k.max() + 1, len(pairs)))
    np.add.at(count, (k, b), 1.0)
    return _Layout(method, b, j, k, count)


def _kept(dual: Array, layout: _Layout) -> Iterator[Array]:
    """Yield the matrices, symmetric, and without the blocks that touch idle vertices."""
    diagonal = np.einsum("bii->bi", dual)
    if not np.all(np.isfinite(dual)) or not np.all(diagonal > 0):
        return
    dual = (dual + dual.swapaxes(1, 2)) / (2 * diagonal.max())
    if layout.method == "slack":
        n = dual.shape[1] // 2
        dual[:, :n, :n] = dual[:, n:, n:] = (dual[:, :n, :n] + dual[:, n:, n:]) / 2
    part = layout.count @ diagonal
    share, tried = (part / part.max(axis=0)).max(axis=1), list[tuple[int, ...]]()
    for least in IDLE:
        idle = tuple(np.flatnonzero(share < least).tolist())
        if idle not in tried:
            tried.append(idle)
            touched = np.asarray(layout.count[list(idle)].any(axis=0), dtype=bool)
            yield np.where(touched[:, None, None], 0.0, dual)


def _asked(
    own: Any,
    plant: UncertainPlant,
    layout: _Layout,
    sigma: float,
    dual: Array,
    radii: list[float],
    right_hand_sides: bool,
) -> int:
    """Return which radius is the first that is proved; negative where none is."""
    n, N, slack = plant.shape[0], len(plant.vertices), layout.method == "slack"
    S, B, dual = plant.A + sigma * np.eye(n), plant.B, dual.copy()
    weight = np.tensordot(layout.count, dual[:, :n, :n] + dual[:, n:, n:], 1)  # P + R of each W
    forms = np.concatenate([S, B], axis=2) if slack else B
    weighed = weight @ forms
    H = forms.swapaxes(1, 2) @ weighed
    H = H.sum(axis=0)[None] if layout.joint else H
    used = np.einsum("kii->ki", weight).any(axis=1)
    H[~used] = np.eye(H.shape[1])
    rho = np.sqrt(np.einsum("kii->ki", H))
    units = rho[:, :, None] * rho[:, None, :]
    inverse = np.linalg.inv(H / units) / units
    Psi = weighed @ inverse
    for _ in range(ROUNDS):
        wanted = _residuals(layout, S, B, dual[:, :n, n:])
        if slack:
            wanted[0, :n] += _free(inverse[0], weight[0], wanted[0])
        change = -Psi @ wanted
        dual[:N, :n, n:] += change
        dual[:N, n:, :n] += change.swapaxes(1, 2)
    scale = 2.0 ** np.round(np.log2(np.einsum("kii->i", weight)) / 2)
    data, denominator, words = plant.words
    exponents = np.eye(N, dtype=np.int64)
    return int(
        own.lower(
            slack,
            right_hand_sides,
            layout.joint,
            (exponents, data, denominator, n, words),
            sigma,
            dual,
            np.ascontiguousarray(Psi),
            scale,
            rho,
            np.array(radii),
        )
    )


def _residuals(layout: _Layout, S: Array, B: Array, X: Array) -> Array:
    """Return what the equations of Z or L, and before them of the skew part of G, leave."""
    if layout.joint:
        left: Array = np.einsum("jiq,jic->qc", B, X)
        if layout.method == "quadratic":
            return left[None]
        V = np.einsum("jia,jic->ac", S, X)
        return np.asarray(np.vstack([(V - V.T) / 2, left]))[None]
    products = B[layout.j].swapaxes(1, 2) @ X[layout.b]
    found = np.zeros((len(layout.count), *products.shape[1:]))
    np.add.at(found, layout.k, products)
    return np.asarray(found)


def _free(inverse: Array, weight: Array, wanted: Array) -> Array:
    """Return the symmetric part of S'X's change, which is free, with which X changes least.

    The change is weight Phi Theta, its square tr(t' inverse t weight^-1) for t = wanted + [U; 0].
    """
    n, size = len(weight), np.sqrt(np.diag(weight))
    L = size[:, None] * np.linalg.cholesky(weight / np.outer(size, size))
    values, vectors = np.linalg.eigh(L.T @ inverse[:n, :n] @ L)
    Q, back = L @ vectors, np.linalg.solve(L.T, vectors)
    slope = Q.T @ inverse[:n] @ wanted @ back
    part = (slope + slope.T) / (values[:, None] + values)
    return np.asarray(-Q @ part @ Q.T)
