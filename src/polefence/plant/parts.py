"""A family on a part of the box of its parameters: a family itself, of the same law and signals.

Of a plant that is sampled the corners of a part are sampled exactly, and its remainder is that of
the interpolation between them: with the square of the part's sides it goes to zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from operator import mul

import numpy as np

from polefence.plant.boxes import Box
from polefence.plant.family import SamplesOf, UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array, Exact, System
from polefence.proof.interpolation import ONE, held_sample
from polefence.proof.laws import add, on_corners
from polefence.proof.matrices import Rationals, beside, mix
from polefence.proof.plant import Node, held_columns, lattice
from polefence.proof.ranges import corner_weights, corners
from polefence.proof.remainder import LARGER, THIRD, Kinks, Remainder

Point = tuple[Fraction, ...]


def inside(plant: UncertainPlant, low: Point, high: Point) -> UncertainPlant:
    """Return the family on a part of the box; it moves no more, and is the samples of none.

    Parameters
    ----------
    low, high : tuple of Fraction
        Weights of each parameter's upper end, from 0 to 1.
    """
    if (low, high) not in plant.on_parts:
        plant.on_parts[low, high] = _part(plant, low, high)
    return plant.on_parts[low, high]


def _part(plant: UncertainPlant, low: Point, high: Point) -> UncertainPlant:
    points = lattice(low, high, plant.parts_degree if plant.noded else 1)
    nodes = [node(plant, at) for at in points]
    if plant.remainder is not None and plant.remainder.source is not None:
        nodes = _with_functions(plant, plant.remainder, low, high, nodes)
    values = [beside([M for M in (v.A, v.B, v.E) if M]) for v in nodes]
    outer = set(corners(low, high))
    vertices = tuple(
        System(
            _exact(vertex.A),
            _exact(vertex.B),
            _exact(vertex.E) if vertex.E else None,
            f"vertex {k + 1}",
        )
        for k, vertex in enumerate(v for v in nodes if v.at in outer)
    )
    remainder = plant.remainder and plant.remainder.inside(low, high, values)
    return replace(
        plant,
        vertices=vertices,
        parameters=tuple(map(_still, plant.parameters, low, high)),
        outputs=tuple(_inside(plant, output, low, high) for output in plant.every_output),
        vehicle=None,
        remainder=remainder,
        sampling=None,
        functions=None,
    )


def _with_functions(
    plant: UncertainPlant, remainder: Remainder, low: Point, high: Point, nodes: list[Node]
) -> list[Node]:
    """Return the corners of a part with what functions of the parameters add there."""
    widths = (*plant.shape, plant.disturbance_count)
    more = zip(*remainder.added(low, high, widths), strict=True)
    return [
        Node(v.at, add(v.A, A), add(v.B, B), add(v.E, E) if v.E else [])
        for v, (A, B, E) in zip(nodes, more, strict=True)
    ]


def off_along(plant: UncertainPlant, gain: Callable[[Array], Array], box: Box) -> Array | None:
    """Return what entries of a closed loop on a part are off by along each parameter, (k, n, n).

    None of a plant that is not sampled between nodes.

    Parameters
    ----------
    gain : callable
        From alpha to a law's gain; that in the middle is taken.
    """
    remainder, n = plant.remainder, plant.shape[0]
    if remainder is None or not remainder.bends:
        return None
    sides, domain = np.subtract(box.high, box.low), plant.domain
    kinks = _kinks_along(remainder.kinks, box)
    if remainder.third and kinks is None:
        grown = float(LARGER) ** np.arange(len(sides)) * sides**3 / THIRD
        bends = grown[:, None, None] * np.array(remainder.third, dtype=float)
    else:
        bends = sides[:, None, None] ** 2 / 8 * np.array(remainder.bends, dtype=float)
        bends = bends if kinks is None else bends + kinks
    K = gain(box.alpha(domain, np.full(domain.corners, 1 / domain.corners)))
    A, B = bends[..., :n], bends[..., n : n + len(K)]
    return np.asarray(A + B @ np.abs(K))


def _kinks_along(kinks: Kinks | None, box: Box) -> Array | None:
    """Return what tables with knots on a part add, for each parameter that they are of."""
    low, high = (tuple(map(Fraction, ends)) for ends in (box.low, box.high))
    each = kinks.inside(low, high) if kinks else []
    if kinks is None or not each:
        return None
    names = [tree.names for tree in kinks.functions.trees]
    used = [[float(r.name in of) for of in names] for r in kinks.functions.ranges]
    return np.tensordot(np.array(used), np.array(each, dtype=float), 1)


def ends(plant: UncertainPlant) -> tuple[Point, Point]:
    """Return the lower and the upper corner of the whole box."""
    count = len(plant.parameters)
    return (Fraction(0),) * count, (Fraction(1),) * count


def node(plant: UncertainPlant, at: Point) -> Node:
    """Return A, B and E at a point of the box.

    Of samples those columns and rows that are between samples are sampled there, to doubles.
    """
    if at not in plant.at_nodes:
        plant.at_nodes[at] = _node(plant, at)
    return plant.at_nodes[at]


def _node(plant: UncertainPlant, at: Point) -> Node:
    weights = corner_weights(at)
    A, B, E = (
        mix(weights, [list(map(list, M)) for v in plant.vertices if (M := getattr(v, key))])
        if getattr(plant.vertices[0], key)
        else []
        for key in ("exact_A", "exact_B", "exact_E")
    )
    sampling = plant.sampling
    if sampling is None or not plant.noded:
        return Node(at, A, B, E)
    opened = plant.opened
    if at not in sampling.known:
        sampling.known[at] = _sampled(sampling, plant.sample_time or plant.step, at, weights)
    F, (n, m) = sampling.known[at], sampling.plant.shape
    T, states = plant.step or Fraction(1), plant.shape[0]
    acting = held_columns(n, m, sampling.delay, sampling.early, states)
    for i, row in enumerate(F):
        for j in range(n):
            A[i][j] = (row[j] - (i == j)) / T if plant.step else row[j]
        for k, x in zip(acting, row[n:], strict=False):
            if k < states:
                A[i][k] = x / T
            else:
                B[i][k - states] = x / T
        if E:
            both = [*B[i], *(x / T for x in row[n + len(acting) :])]
            columns = opened or range(len(B[i]), len(both))
            E[i] = [Fraction(0) if k is None else both[k] for k in columns]
        for state, k, times in plant.driven_by:
            A[i][state] = times * E[i][k]
    return Node(at, A, B, E)


def _with_values(
    rows: Rationals, plant: UncertainPlant, at: Point, weights: list[Fraction]
) -> Rationals:
    """Return [A, B, E] at a point with what functions of the parameters are there."""
    source = plant.remainder and plant.remainder.source
    if not source:
        return rows
    values = [
        value - sum(map(mul, weights, f.corners), Fraction(0))
        for value, f in zip(source.functions.values(at), source.functions.on_box[1], strict=True)
    ]
    return add(rows, mix(values, [list(map(list, M)) for M in source.directions]))


def _sampled(sampling: SamplesOf, T: Fraction, at: Point, weights: list[Fraction]) -> Rationals:
    """Return [F, G, H] at a point, rounded to doubles of the units."""
    n, plant = sampling.plant.shape[0], sampling.plant
    none: Exact = ((),) * n
    rows = [
        [[*a, *b, *e] for a, b, e in zip(v.exact_A, v.exact_B, v.exact_E or none, strict=True)]
        for v in plant.vertices
    ]
    known = _with_values(mix(weights, rows), plant, at, weights)
    units = sampling.units
    M = [
        [x * T * u / unit for x, u in zip(row, units, strict=True)]
        for row, unit in zip(known, units, strict=False)
    ]
    m, early = plant.shape[1], sampling.early
    wide = (*units[: n + m], *units[n : n + m], *units[n + m :]) if early else units
    return [
        [Fraction((x + (i == j) * ONE) / ONE) * units[i] / wide[j] for j, x in enumerate(row)]
        for i, row in enumerate(held_sample(M, sampling.terms, early, m))
    ]


def narrowed(parameter: Parameter, low: Fraction, high: Fraction) -> Parameter:
    """Return a parameter on a part of its interval, as it moves; weights are of p, or of 1/p."""
    first, last = parameter.scheduling(parameter.low), parameter.scheduling(parameter.high)
    start, end = (parameter.scheduling(first + (last - first) * t) for t in (low, high))
    return replace(parameter, low=start, high=end)


def _still(parameter: Parameter, low: Fraction, high: Fraction) -> Parameter:
    return replace(narrowed(parameter, low, high), rate=None)


def _inside(plant: UncertainPlant, output: Output, low: Point, high: Point) -> Output:
    """Return an output whose rows are those at the corners of a part."""
    rows = [on_corners([[list(row)] for row in rows], low, high) for rows in output.exact(plant)]
    near = output.near
    if near is not None:
        more = near.added(low, high, (*plant.shape, plant.disturbance_count))
        rows = [list(map(add, M, extra)) for M, extra in zip(rows, more, strict=True)]
    C, D, F = (tuple(tuple(row) for (row,) in M) for M in rows)
    F = F if plant.disturbance_count else ()
    return replace(output, C=C, D=D, F=F, near=near and near.inside(low, high))


def _exact(M: Rationals) -> Exact:
    return tuple(map(tuple, M))
