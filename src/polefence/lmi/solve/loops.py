"""Closed loops as polynomials: a family under a law, with signals and saturated inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polefence.base.errors import InputError
from polefence.law.laws import Law
from polefence.lmi.conditions.lyapunov import Loop
from polefence.plant.family import UncertainPlant
from polefence.plant.motion import Motion
from polefence.plant.polynomial import Domain, Polynomial, bernstein, elevated, times
from polefence.plant.system import Array


def loop_of(plant: UncertainPlant, law: Law) -> Loop:
    """Return the closed loop as a quotient of polynomials."""
    return _loop(plant, law, np.concatenate([plant.A, plant.B], axis=2))


def loop_degree(plant: UncertainPlant, law: Law) -> int:
    """Return the degree of A W + B Z, or of A + B K: less where inputs are the same everywhere."""
    remainder = plant.remainder
    if law.W is None and remainder and remainder.same_inputs(plant.B.tolist()):
        return max(plant.curve_degree, law.degree + 1)
    return law.degree + plant.curve_degree


def loop_with(plant: UncertainPlant, law: Law, C: Array, D: Array) -> Loop:
    """Return the closed loop with the rows of y = C x + D u, (N, p, n) and (N, p, m), below it."""
    rows = [np.concatenate([plant.A, C], axis=1), np.concatenate([plant.B, D], axis=1)]
    return _loop(plant, law, np.concatenate(rows, axis=2))


def with_inputs(plant: UncertainPlant, law: Law, loop: Loop) -> Loop:
    """Return the loop with its input matrix and its law, for saturated inputs."""
    n, domain = plant.shape[0], loop.domain
    K = bernstein(domain, law.form[:, n:], law.degree)
    B = plant.B if law.anti_windup is None else plant.B + law.anti_windup
    return replace(loop, B=polynomial_of(plant, domain, B, n), K=K)


def _loop(plant: UncertainPlant, law: Law, rows: Array) -> Loop:
    n, domain, step = plant.shape[0], law.domain_of(plant), float(plant.step)
    AB, motion, d = polynomial_of(plant, domain, rows), Motion.of(plant), plant.curve_degree
    closed = times(AB, bernstein(domain, law.form, law.degree))
    if law.W is None:
        eye = elevated({(0,) * sum(domain.sizes): np.eye(n)}, domain, law.degree + d)
        return Loop(eye, closed, domain, step=step, motion=motion)
    W = bernstein(domain, law.W, law.degree)
    return Loop(elevated(W, domain, d), closed, domain, W, step, motion)


def polynomial_of(
    plant: UncertainPlant, domain: Domain, rows: Array, column: int = 0
) -> Polynomial:
    """Return rows at the vertices as a polynomial; a plant's curve is added to the first n.

    Of the curve's columns it begins with ``column``.
    """
    P, d = bernstein(domain, rows, 1), plant.curve_degree
    if d == 1:
        return P
    if domain != plant.domain:
        raise InputError(
            f"{plant.name}: its samples are polynomials of the parameters; ask for a law on the "
            "box of these (on = 'box')"
        )
    more = np.zeros((len(plant.curve), *rows.shape[1:]))
    more[:, : plant.shape[0]] = plant.curve[:, :, column : column + rows.shape[2]]
    P, curve = elevated(P, domain, d - 1), bernstein(domain, more, d)
    return {e: P[e] + curve[e] for e in P}
