"""Laws u = K y of signals y = C x + D u + F w into which inputs pass, as laws of y less D u.

What is left, C x + F w, is a signal "NAME without inputs": u = M (C x + F w), with
M = (I - K D)^-1 K. Code has it by taking D u off what it measures, u what it sent last. Of such a
law K = M (I + D M)^-1 is the one of y itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.proof.matrices import Rationals, identity, product, right_divide
from polefence.proof.plant import WITHOUT

Matrices = tuple[Rationals, Rationals, Rationals, Rationals]


def taken_off(
    matrices: Sequence[Any], plant: UncertainPlant, signals: Sequence[Output]
) -> Matrices:
    """Return A, B, C and D of a law of signals without inputs.

    Parameters
    ----------
    matrices : (k, k), (k, r), (m, k) and (m, r) rows of Fraction
        Of x_c' = A x_c + B y, u = C x_c + D y; in discrete time x_c(t + T) in place of x_c'.
    signals : sequence of Output
        y.

    Raises
    ------
    InputError
        If the law is not well-posed, or this depends on the parameters.
    """
    direct = [signal for signal in signals if signal.D]
    names = " and ".join(repr(signal.name) for signal in direct)
    remedy = " and ".join(repr(f"{signal.name}{WITHOUT}") for signal in direct)
    if any(len(signal.D) > 1 or signal.near is not None for signal in direct):
        raise InputError(
            f"measured: by how much an input passes into {names} changes with the parameters; give "
            f"the law of {remedy}, from which the code takes its input off"
        )
    if not all(isinstance(x, Fraction) for M in matrices for row in M for x in row):
        raise InputError(
            f"measured: an input passes straight into {names}, and the law's numbers change; give "
            f"the law of {remedy}, from which the code takes its input off"
        )
    A, B, C, D = ([list(row) for row in M] for M in matrices)
    m, none = plant.shape[1], (Fraction(0),) * plant.shape[1]
    through = [list(signal.D[0]) if signal.D else list(none) for signal in signals]
    loop = [[-x for x in row] for row in product(D, through)]
    R = right_divide(identity(m), _sum(identity(m), loop))
    if R is None:
        raise InputError(
            f"the law is not well-posed: with what its input passes straight into {names}, I - K D "
            "is singular, at all parameters; take another gain of it"
        )
    D = product(R, D)
    if not A:
        return A, B, C, D
    C = product(R, C)
    BD = product(B, through)
    A, B = _sum(A, product(BD, C)), _sum(B, product(BD, D))
    return A, B, C, D


def _sum(one: Rationals, other: Rationals) -> Rationals:
    pairs = zip(one, other, strict=True)
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in pairs]
