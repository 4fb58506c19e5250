"""Grids of the box of the parameters, on whose cells a Lyapunov polynomial is continuous.

Cells that touch share the coefficients of their face. Knots of tables are among the cuts, as
functions are smooth between them alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np

from polefence.plant.boxes import Box
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.parts import Point, narrowed
from polefence.plant.polynomial import Domain

MOST_KNOTS = 16  # of a parameter's tables, at which cells may end
ENDS = (Fraction(0), Fraction(1))

Cuts = tuple[Point, ...]  # of each parameter's interval, weights of its upper end
Corners = tuple[Point, Point]  # the lower and the upper one of a cell


def whole_box(plant: UncertainPlant) -> Cuts:
    """Return the grid of one cell."""
    return (ENDS,) * len(plant.parameters)


def finer(plant: UncertainPlant, divided: set[int], count: int) -> Cuts:
    """Return a grid of about so many cells along the parameters that are divided."""
    knots = _knots(plant)
    return tuple(
        cut_finer(knots[f], count) if f in divided else ENDS for f in range(len(plant.parameters))
    )


def _knots(plant: UncertainPlant) -> list[Point]:
    """Return the ends of each parameter's interval, and knots of tables of it between them."""
    source = plant.remainder and plant.remainder.source
    known: list[Point] = [ENDS] * len(plant.parameters)
    for f, p in enumerate(plant.parameters if source else ()):
        tables, trees = (source.functions.by_name, source.functions.trees) if source else ({}, ())
        knots = {x for tree in trees for x in tree.knots(p.name, tables) if p.low < x < p.high}
        first, last = (p.scheduling(x) for x in (p.low, p.high))
        if len(knots) <= MOST_KNOTS:
            between = sorted((p.scheduling(x) - first) / (last - first) for x in knots)
            known[f] = (ENDS[0], *between, ENDS[1])
    return known


def cut_finer(cuts: Point, count: int) -> Point:
    """Return these cuts of an interval and more, no two of which are farther apart than 1/count."""
    every = [cuts[0]]
    for a, b in pairwise(cuts):
        parts = math.ceil((b - a) * count)
        every += [a + (b - a) * Fraction(k, parts) for k in range(1, parts + 1)]
    return tuple(every)


def count_of(cuts: Sequence[Point]) -> int:
    """Return how many cells a grid has."""
    return math.prod(len(own) - 1 for own in cuts)


def nodes_of(cuts: Sequence[Point], degree: int) -> list[int]:
    """Return how many coefficients there are along each parameter, of a degree in each cell."""
    return [(len(own) - 1) * degree + 1 for own in cuts]


def cells_of(
    cuts: Sequence[Point], degree: int, domain: Domain
) -> Iterator[tuple[Corners, list[int]]]:
    """Yield the cells, and the places of their coefficients among all, the last axis fastest."""
    whole = nodes_of(cuts, degree)
    exponents = [e[1::2] for e in domain.monomials(degree)]
    for first in product(*(range(len(own) - 1) for own in cuts)):
        low, high = (
            tuple(own[k + more] for own, k in zip(cuts, first, strict=True)) for more in (0, 1)
        )
        nodes = ([degree * k + e for k, e in zip(first, own, strict=True)] for own in exponents)
        yield (low, high), [int(np.ravel_multi_index(node, whole)) for node in nodes]


def box_of(corners: Corners) -> Box:
    """Return a cell to doubles."""
    return Box(*(tuple(map(float, corner)) for corner in corners))


def motion_in(plant: UncertainPlant, corners: Corners) -> Motion:
    """Return how the parameters move in a cell, in its coordinates."""
    parameters = tuple(map(narrowed, plant.parameters, *corners))
    return Motion.of(replace(plant, parameters=parameters))
