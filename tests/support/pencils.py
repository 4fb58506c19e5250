"""Pencils of discs as searches of laws pose them."""

import numpy as np

from polefence import build
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import common_point
from polefence.lmi.solve.starts import nominal_start


def start(plant, sigma, method):
    """A pencil in nominal coordinates, a point with D(x) > 0, and the unit of its radii."""
    plain = balanced(plant.A, plant.B, sigma)
    nominal = nominal_start(plant.A, plant.B, sigma, plain)
    scaling = plain.refined(nominal.W)
    pencil = build(method, *scaling.apply(plant.A, plant.B), sigma / scaling.rate, scaling.unit)
    K = np.linalg.solve(scaling.S, nominal.K @ scaling.T)
    x = pencil.pack(common_point(np.eye(len(scaling.T)), K, pencil.variables))
    return pencil, x, scaling.rate
