"""Functions of the parameters in floats, at points of a family."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.approximation import Functions
from polefence.proof.functions import Table, Tree


def beyond(functions: Functions, alpha: Array) -> Array:
    """Return functions less the combination of their values at the corners, (..., count).

    Parameters
    ----------
    alpha : (..., N) array
        Weights of the corners of the box.
    """
    count, names = len(functions.ranges), [r.name for r in functions.ranges]
    upper = Domain.of("box", 2**count).coordinates(alpha)[..., 1::2]
    values = dict[str, Array]()
    for k, (name, r) in enumerate(zip(names, functions.ranges, strict=True)):
        low, high = (1 / float(x) if r.inverted else float(x) for x in (r.low, r.high))
        s = low + (high - low) * upper[..., k]
        values[name] = 1 / s if r.inverted else s
    corners = np.array([f.corners for f in functions.on_box[1]], dtype=float)
    tables, shape = functions.by_name, alpha.shape[:-1]
    known = (value_of(tree, values, tables) for tree in functions.trees)
    rows = [np.broadcast_to(value, shape) for value in known]
    return np.asarray(np.stack(rows, axis=-1) - alpha @ corners.T)


def value_of(tree: Tree, values: Mapping[str, Array], tables: Mapping[str, Table]) -> Array:
    """Return a function at values of the parameters."""
    if tree.kind == "number":
        return np.asarray(float(tree.number))
    if tree.kind == "name":
        return values[tree.word]
    parts = [value_of(part, values, tables) for part in tree.of]
    if tree.kind == "**":
        return np.asarray(parts[0] ** float(tree.number))
    if tree.kind == "call" and tree.word in tables:
        return _interpolated(tables[tree.word], parts[0])
    if tree.kind == "call":
        return np.asarray(getattr(np, tree.word)(parts[0]))
    join = {"+": np.add, "*": np.multiply, "/": np.divide}[tree.kind]
    return np.asarray(join(*parts))


def _interpolated(table: Table, x: Array) -> Array:
    """Return a table's values."""
    starts = np.array([float(a) for a, _, _ in table.pieces])
    widest = max(len(polynomial) for _, _, polynomial in table.pieces)
    rows = np.array([[*map(float, p), *[0.0] * (widest - len(p))] for _, _, p in table.pieces])
    piece = np.clip(np.searchsorted(starts, x, side="right") - 1, 0, len(starts) - 1)
    h, total = x - starts[piece], np.zeros(np.shape(x))
    for column in rows.T[::-1]:
        total = total * h + column[piece]
    return total
