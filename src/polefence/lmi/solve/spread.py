"""What a plant's remainder asks for beside a Lyapunov polynomial: Omega, and sizes of its sides."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from polefence.base.errors import InputError
from polefence.law.laws import Law
from polefence.lmi.solve.gramians import cheapest, majorant
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof import polynomials
from polefence.proof.claims.saturation import cut_off
from polefence.proof.laws import Evidence, lifted
from polefence.proof.polynomials import Polynomial, multinomial
from polefence.proof.remainder import Spread

# Omega over what it has to exceed, and besides, as a share of that.
OVER, SLIGHT = 1.001, 1e-9


def spread_of(
    plant: UncertainPlant,
    law: Law,
    evidence: Evidence,
    driven: bool = True,
    cut: Sequence[int] = (),
) -> Spread:
    """Return the multipliers of a plant's remainder for a Lyapunov polynomial.

    Rows and columns follow the sizes that the Lyapunov matrix gives to states and inputs; Omega is
    little more than all coefficients of V'V.

    Parameters
    ----------
    driven : bool
        Whether disturbances count; of poles they do not.
    cut : sequence of int
        Inputs that are cut off: Omega is enough for every part of them.
    """
    remainder = plant.remainder
    if remainder is None:
        raise InputError(f"{plant.name} has no remainder")
    n = plant.shape[0]
    XKX = lifted(law.exact, evidence, law.domain_of(plant).sizes)
    entries = _coefficients(XKX)
    if cut:
        Y = polynomials.bernstein([*evidence.held], XKX.sizes, evidence.held_degree)
        parts = cut_off(XKX, n, {i: Y.part(slice(i, i + 1)) for i in cut})
        entries = np.concatenate([_coefficients(part) for _, part in parts])
    return covering(np.array(remainder.entries, dtype=float), entries, driven)


def covering(R: Array, entries: Array, driven: bool = True) -> Spread:
    """Return multipliers of a remainder R (n, n + m + q) for coefficients of [X; K X]."""
    X = entries[:, : len(R)].mean(axis=0)
    T = np.linalg.cholesky((X + X.T) / 2)
    inverse = np.linalg.inv(T)
    moved = entries @ inverse.T  # in coordinates in which X is about one
    a, b = (inverse**2).sum(axis=0), (moved**2).sum(axis=2).max(axis=0)
    known = len(b)
    if driven:
        rows, columns = cheapest(R, a, b)
    else:  # any column of a disturbance will do that is large enough
        ends = R[:, known:]
        rows, columns = cheapest(R * (np.arange(R.shape[1]) < known), a, b)
        rows = np.where(ends.any(axis=1) & (rows <= 0), rows.max(), rows)
        # a column that costs nothing may be large
        columns[known:] = 1e4 * (ends / np.where(rows > 0, rows, np.inf)[:, None]).max(axis=0)
    omega = more_than(columns[: entries.shape[1], None] * moved, T)
    sides = [tuple(map(Fraction, squares.tolist())) for squares in (rows, columns)]
    return Spread(omega, sides[0], sides[1])


def more_than(V: Array, T: Array) -> list[list[Fraction]]:
    """Return Omega, a little more than all T V'V T' (count, r, n)."""
    squares = V.swapaxes(1, 2) @ V
    size = max(float(np.linalg.eigvalsh(squares).max()), SLIGHT)
    omega = T @ (majorant(squares) * OVER + SLIGHT * size * np.eye(len(T))) @ T.T
    return [[Fraction(x) for x in row] for row in ((omega + omega.T) / 2).tolist()]


def _coefficients(P: Polynomial) -> Array:
    """Return the Bernstein coefficients of an exact polynomial, (count, ., .)."""
    matrices = [
        np.array(M, dtype=object) / Fraction(P.whole * multinomial(e, P.sizes))
        for e, M in P.terms.items()
    ]
    return np.array(matrices).astype(float)
