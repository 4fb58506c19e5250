"""A gain scheduled on the parameters, a quotient of polynomials in alpha."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained_fields
from polefence.law.law import (
    Law,
    check_alpha,
    frozen,
    gain_rows,
    more_columns,
    rationals,
    right_divide,
)
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import laws as proof
from polefence.proof.laws import Point


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledGain(Law):
    """u = K(alpha) x with K(alpha) = Z(alpha) W(alpha)^-1, Z and W polynomials in alpha.

    Leite & Peres (2005), equations (18), (19), of degree 1 on the simplex. It is evaluated as
    Z' W'^-1 T with W' = T W T' and Z' = Z T', near to the identity in the middle of the family:
    W itself spans more decades than doubles have digits.

    Parameters
    ----------
    W : (count, n, n) array
        Bernstein coefficients, in the order of `Domain.monomials`; of degree 1 the positive
        definite vertex matrices.
    Z : (count, m, n) array
    parameters : tuple of Parameter
        Lets `gain_at` find alpha from physical values.
    degree : int
    sizes : tuple of int, optional
        Corners of each simplex; by default one simplex, of as many corners as the degree says.

    Raises
    ------
    InputError
        If the shapes do not fit together.
    """

    K = gains = None
    powers = ()
    W: Array
    Z: Array
    parameters: tuple[Parameter, ...] = ()
    degree: int = 1
    sizes: tuple[int, ...] = ()

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "W", frozen(self.W, 3, "W"))
        object.__setattr__(self, "Z", frozen(self.Z, 3, "Z"))
        count, n, _ = self.W.shape
        if self.W.shape[2] != n or self.Z.shape[0] != count or self.Z.shape[2] != n:
            raise InputError(f"W {self.W.shape} and Z {self.Z.shape} do not fit together")
        object.__setattr__(self, "sizes", tuple(self.sizes) or (count,))
        if self.domain.count(self.degree) != count:
            raise InputError(
                f"{count} matrices W; degree {self.degree} needs {self.domain.count(self.degree)}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of inputs and states."""
        _, m, n = self.Z.shape
        return m, n

    @property
    def domain(self) -> Domain:
        """The simplices in which alpha lives."""
        return Domain(self.sizes)

    @property
    def form(self) -> Array:
        """Bernstein coefficients of [W; Z], (count, n + m, n), of the law's degree."""
        return np.concatenate([self.W, self.Z], axis=1)

    @property
    def exact(self) -> proof.Law:
        """The law in rationals."""
        W, Z = ([rationals(M) for M in matrices] for matrices in (self.W, self.Z))
        return proof.Law(None, W, Z, self.degree)

    def document(self) -> dict[str, Any]:
        """Return it as plain data, as a proof file has it."""
        table = {"kind": "scheduled", "W": self.W.tolist(), "Z": self.Z.tolist()}
        return table | {"degree": self.degree, "on": self.domain.on}

    def __repr__(self) -> str:
        m, n = self.shape
        kind = f", degree {self.degree}" if self.degree != 1 else ""
        return f"<ScheduledGain {m} x {n}, {self.domain.corners} vertices{kind}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        known = [("degree", str(self.degree)), *map(_range_row, self.parameters)]
        corners = self.domain.corners
        middle = self.gain(np.full(corners, 1 / corners))
        return card("u = Z W^-1 x", [*known, *gain_rows("K in the middle", middle)])

    def gain(self, alpha: Any, clamp: bool = False) -> Array:
        """Return K(alpha), (..., m, n) for alpha (..., N); on a box, at alpha's marginals.

        Raises
        ------
        ParameterValueError
            If alpha lies off the simplex by more than rounding, unless ``clamp``.
        """
        a = check_alpha(alpha, self.domain.corners, clamp)
        weights = self.domain.basis(a, self.degree)
        W, Z = self.even
        even = right_divide(np.tensordot(weights, Z, 1), np.tensordot(weights, W, 1))
        return even @ self.coordinates.T

    def parts(self, alpha: Array) -> tuple[Array, Array]:
        """Return W and Z at points alpha (count, N)."""
        basis = self.domain.basis(alpha, self.degree)
        return np.tensordot(basis, self.W, 1), np.tensordot(basis, self.Z, 1)

    def fitted(self, plant: UncertainPlant) -> ScheduledGain:
        """Return the law, one of degree 1 on the box of the plant's parameters."""
        super().fitted(plant)
        if plant.parameters and self.degree == 1:
            return replace(self, sizes=Domain.of("box", len(plant.vertices)).sizes)
        return self

    def of(self, parameters: tuple[Parameter, ...]) -> ScheduledGain:
        """Return it with the parameters that alpha comes from."""
        return replace(self, parameters=parameters)

    def inside(self, plant: UncertainPlant, low: Point, high: Point) -> ScheduledGain:
        """Return the same law on a part of the box, to rounding."""
        part = self.exact.inside(low, high)
        W, Z = (np.array(M, dtype=float) for M in (part.W, part.Z))
        return replace(self, W=W, Z=Z, parameters=plant.parameters)

    def negated(self) -> ScheduledGain:
        """Return it with the other sign."""
        return replace(self, Z=-self.Z)

    def with_states(self, more: int) -> ScheduledGain:
        """Return it with a multiple of the identity in W, the same as `proof.filters` takes."""
        n = self.W.shape[1]
        W = np.pad(self.W, ((0, 0), (0, more), (0, more)))
        W[:, range(n, n + more), range(n, n + more)] = self.W[0, 0, 0]
        return replace(self, W=W, Z=more_columns(self.Z, more))

    def late(self, n: int, more: int) -> ScheduledGain:
        """Return it with a diagonal of W in the inputs' own units, Z W^-1 Z' in the middle."""
        middle, Z = self.W.mean(axis=0), self.Z.mean(axis=0)
        size = np.diag(Z @ np.linalg.solve(middle, Z.T))
        size = 2.0 ** np.round(np.log2(np.where(size > 0, size, 1.0)))  # short numbers
        W = np.zeros((len(self.W), n + more, n + more))
        W[:, :n, :n] = self.W
        added = np.arange(n, n + more)
        W[:, added, added] = np.tile(size, more // len(size))
        return replace(self, W=W, Z=np.insert(self.Z, [n] * more, 0.0, axis=2))

    def named_gains(self) -> dict[str, Array]:
        """Return K at every vertex, by its name."""
        corners = np.eye(self.domain.corners)
        return {f"K at vertex {j + 1}": self.gain(alpha) for j, alpha in enumerate(corners)}


def _range_row(p: Parameter) -> tuple[str, str]:
    return p.name, f"{float(p.low):g} to {float(p.high):g} {p.unit}"
