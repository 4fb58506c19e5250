"""The Lyapunov matrix of a proof at one point of the family: V = x' P(alpha) x."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.law.laws import ROUNDING, check_alpha
from polefence.plant.parameters import Parameter, simplex_weights
from polefence.plant.system import Array
from polefence.proof import laws
from polefence.proof.laws import Evidence
from polefence.proof.matrices import Rationals, identity, inverse, mix, product
from polefence.proof.polynomials import Sizes, basis, monomials


def weights_at(
    parameters: Sequence[Parameter], count: int, alpha: Any, values: Mapping[str, Any]
) -> list[Fraction]:
    """Return the exact weights of the vertices at a point, given by weights or by parameters.

    Raises
    ------
    ParameterValueError
        If it is no point of the family, or is given both ways.
    """
    if alpha is None:
        return list(simplex_weights(tuple(parameters), dict(values)))
    if values:
        raise InputError("give the weights of the vertices or the parameters' values, not both")
    weights = [Fraction(float(weight)) for weight in check_alpha(alpha, count).ravel()]
    return [weight / sum(weights) for weight in weights]


def lyapunov_matrix(
    law: laws.Law, sizes: Sizes, evidence: Evidence, alpha: Sequence[Fraction]
) -> Array:
    """Return P(alpha) (n, n) of the evidence: X(alpha)^-1, or Q(alpha) of the dual form.

    Raises
    ------
    InputError
        If alpha is no product of the parameters' weights where the evidence is about those.
    """
    at = _coordinates(list(alpha), sizes)
    for piece in evidence.cells:
        sides = list(zip(at[1::2], piece.low, piece.high, strict=True))
        if all(low <= high_weight <= high for high_weight, low, high in sides):
            inner = [(weight - low) / (high - low) for weight, low, high in sides]
            at, evidence = [x for upper in inner for x in (1 - upper, upper)], piece.evidence
            break
    if evidence.transfer:
        raise InputError(
            "this bound is proved by the transfer function, without a Lyapunov matrix; "
            "design.lyapunov_at gives that of the poles"
        )
    X = _of(law, sizes, evidence, at)
    exact = X if evidence.dual else inverse(X, "the Lyapunov matrix")
    P: Array = np.array([[float(x) for x in row] for row in exact])
    P = (P + P.T) / 2
    P.flags.writeable = False
    return P


def _coordinates(alpha: list[Fraction], sizes: Sizes) -> list[Fraction]:
    """Return the coordinates in each simplex, of weights that may be rounded."""
    if len(sizes) == 1:
        return alpha
    coordinates = list[Fraction]()
    for bit in reversed(range(len(sizes))):
        high = sum((a for j, a in enumerate(alpha) if j >> bit & 1), Fraction(0))
        coordinates += [1 - high, high]
    for a, corner in zip(alpha, monomials(sizes, 1), strict=True):
        if (
            abs(a - math.prod(x for x, power in zip(coordinates, corner, strict=True) if power))
            > ROUNDING
        ):
            raise InputError(
                "alpha is not a product of weights of the parameters, as this proof needs; "
                "give the parameters' values"
            )
    return coordinates


def _of(law: laws.Law, sizes: Sizes, evidence: Evidence, at: list[Fraction]) -> Rationals:
    """Return X: that of the evidence, the law's own W, or W (multiple + Q W)."""
    Q = mix(basis(at, sizes, evidence.degree), evidence.X) if evidence.X else []
    if law.W is None or (evidence.X and evidence.dual):
        return Q
    W = mix(basis(at, sizes, law.degree), law.W)
    if not Q:
        factor = evidence.multiple[0] if evidence.multiple else Fraction(1)
        return [[factor * x for x in row] for row in W]
    factor = Fraction(0)
    if evidence.multiple:
        weights = basis(at, sizes, evidence.degree)
        factor = sum((w * m for w, m in zip(weights, evidence.multiple, strict=True)), factor)
    scaled = [[factor * x for x in row] for row in identity(len(W))]
    return product(W, laws.add(scaled, product(Q, W)))
