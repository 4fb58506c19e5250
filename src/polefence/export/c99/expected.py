"""Answers of a law to given inputs: exact, to compare exported code with."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.export.c99.program import Fixed, Program, Scheduled
from polefence.law.laws import FixedGain, Law, ScheduledGain
from polefence.plant.parameters import simplex_weights
from polefence.plant.polynomial import binomial
from polefence.plant.system import Array

Rationals = Any  # an array of Fractions, which numpy does not type
Whole = tuple[Any, int]  # numerators, and their denominator
CORRECTIONS = 4  # each leaves a part of 1e-6 or less, of any law worth exporting


def expected(program: Program, law: Law, given: Array, x: Array) -> tuple[Array, Array]:
    """Return u of the law, exact to the rounding of the result, and sum_j |K_ij| |x_j|.

    `law.gain` alone would not do: where W is badly scaled it is less exact than the code.

    Parameters
    ----------
    given : (count, g) array
        Parameters, clamped to their intervals, or alpha, projected as by `law.gain` with ``clamp``.
    x : (count, n) array

    Returns
    -------
    u, scale : (count, m) arrays

    Raises
    ------
    InputError
        If the program is not that of a law of this kind and size.
    """
    fixed = isinstance(program, Fixed)
    shape = law.K.shape if isinstance(law, FixedGain) else law.Z.shape[1:]
    if fixed != isinstance(law, FixedGain) or shape != program.shape[::-1]:
        raise InputError(f"{law!r} is not the law of this code, which is {program.shape[::-1]}")
    if isinstance(law, FixedGain) or isinstance(program, Fixed):
        K = law.gain(None)
        answers = [(_float(_rationals(K) @ _rationals(v)), np.abs(K) @ np.abs(v)) for v in x]
    else:
        Z, W = _whole(_rationals(law.Z)), _whole(_rationals(law.W))
        alphas = [_alpha(program, values) for values in given]
        answers = [_at(law, Z, W, alpha, v) for alpha, v in zip(alphas, x, strict=True)]
    u, scale = (np.array(column) for column in zip(*answers, strict=True))
    return u, scale


def _at(law: ScheduledGain, Z: Whole, W: Whole, alpha: Rationals, x: Array) -> tuple[Array, Array]:
    """Return u and the scale of its error at one alpha and x."""
    c = law.domain.coordinates(alpha)
    basis = [
        math.prod((c[j] ** power for j, power in enumerate(e) if power), start=Fraction(many))
        for e in law.domain.monomials(law.degree)
        for many in [binomial(law.domain.sizes, e)]
    ]
    many, unit = _whole(np.array(basis))
    Z, W = ((np.tensordot(many, table, 1), unit * one) for table, one in (Z, W))
    K = law.gain(_float(alpha), clamp=True)
    return _float(_times(Z, _solved(W, _rationals(x)))), np.abs(K) @ np.abs(x)


def _whole(values: Rationals) -> Whole:
    """Return integers and their common denominator: many fractions take long to add."""
    denominator = math.lcm(*(value.denominator for value in values.flat))
    return np.vectorize(int, otypes=[object])(values * denominator), denominator


def _times(matrix: Whole, v: Rationals) -> Rationals:
    (left, unit), (right, other) = matrix, _whole(v)
    return (left @ right) * Fraction(1, unit * other)


def _solved(W: Whole, x: Rationals) -> Rationals:
    """Return W^-1 x: solved in doubles, corrected by the exact residual until nothing is left."""
    plain = _float(W[0] * Fraction(1, W[1]))
    size = np.sqrt(np.diagonal(plain))
    inverse = np.linalg.inv(plain / np.outer(size, size)) / np.outer(size, size)
    v = np.full(len(x), Fraction(0))
    for _ in range(CORRECTIONS):
        v = v + _rationals(inverse @ _float(x - _times(W, v)))
    return v


def _rationals(values: Array) -> Rationals:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(values, dtype=float))


def _float(values: Rationals) -> Array:
    return np.asarray(values, dtype=float)


def _alpha(program: Scheduled, given: Array) -> Rationals:
    """Return the vertices' weights as rationals: of parameters the product, the first slowest."""
    if not program.shares:
        weights = _rationals(np.maximum(given, 0.0))
        return np.asarray(weights / weights.sum())
    parameters = tuple(share.parameter for share in program.shares)
    values = {p.name: float(v) for p, v in zip(parameters, given, strict=True)}
    return np.array(simplex_weights(parameters, values, clamp=True))
