"""The coefficients that miss measurements least, by Levenberg's and Marquardt's method.

Entries of matrices at a measurement are linear in the coefficients. So its slopes in the entries
are condensed to a triangle (QR) before they are spread over the coefficients.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from polefence.data.local import Model
from polefence.data.measured import Measurement
from polefence.data.residual import Residual
from polefence.data.shape import Basis, Shape
from polefence.plant.system import Array

TRIES = 60  # evaluations of one fit
SINGULAR = 1e-9  # of slopes of unit length: below that the data do not tell coefficients apart
# Noise moves coefficients so far from their true values that the sum of squares is above its least
# by a share of unknowns/numbers. A fit ends at 1e-4 of that, a hundredth of the coefficients' own
# uncertainty. Of 5 responses of 3000 samples with noise of 2 % that is after 3 slopes of all: the
# third lowers the sum of squares by 2e-5 of it.
SHARE = 1e-4
ROUNDING = 1e-11  # of an output: an rms below that is none
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e9


@dataclass(frozen=True, eq=False)
class Search:
    """What is fitted.

    Attributes
    ----------
    of : Residual
    shape : Shape
    basis : Basis
    measurements : sequence of Measurement
    """

    of: Residual
    shape: Shape
    basis: Basis
    measurements: Sequence[Measurement]

    def cost(self, theta: Array) -> float:
        """Return the sum of the squared residual at coefficients (entries, monomials)."""
        return sum(float((r**2).sum()) for _, r, _ in self._residuals(theta))

    def _residuals(self, theta: Array) -> Iterator[tuple[Model, Array, Array]]:
        for own in self.measurements:
            monomials = self.basis.at(own.at)
            model = self.shape.model(theta @ monomials)
            yield model, self.of.of(model, own), monomials

    def linear(self, theta: Array) -> tuple[Array, Array, int]:
        """Return condensed slopes (rows, unknowns) and residual, and how long the residual is."""
        rows, numbers = list[Array](), 0
        for own, (model, r, monomials) in zip(
            self.measurements, self._residuals(theta), strict=True
        ):
            both = np.column_stack([self.of.slopes(model, own), r])
            triangle = np.asarray(np.linalg.qr(both, mode="r"))
            J, rest = triangle[:, :-1], triangle[:, -1:]
            spread = (J[:, :, None] * monomials).reshape(len(J), -1)
            rows.append(np.hstack([spread, rest]))
            numbers += len(r)
        whole = np.concatenate(rows)
        return whole[:, :-1], whole[:, -1], numbers

    def answer(self, start: Array) -> tuple[Array, bool]:
        """Return the best coefficients near others, and whether the measurements tell them."""
        theta, cost, damping = start, self.cost(start), 1e-3
        told, tries = False, 0
        while tries < TRIES:
            J, r, numbers = self.linear(theta)
            size = np.linalg.norm(J, axis=0)
            if not (np.isfinite(J).all() and size.min() > 0):
                return theta, False
            U, s, V = np.linalg.svd(J / size, full_matrices=False)
            told, along = len(s) == theta.size and bool(s[-1] > SINGULAR * s[0]), U.T @ r
            enough = max(SHARE * theta.size / numbers * cost, ROUNDING**2 * numbers)
            while tries < TRIES:
                if (along**2).sum() <= enough or damping > MOST_DAMPING:
                    return theta, told
                short = s / (s**2 + damping)
                step = -(V.T @ (short * along)) / size
                hoped = float((along**2 * s * short * (2 - s * short)).sum())
                other = theta + step.reshape(theta.shape)
                found, tries = self.cost(other), tries + 1
                share = (cost - found) / hoped
                if share > 1e-3:
                    theta, cost = other, found
                    damping = max(damping * max(0.1, 1 - (2 * share - 1) ** 3), LEAST_DAMPING)
                    break
                damping *= 8
        return theta, told
