"""One gain for every parameter value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.explained import explained, explained_fields
from polefence.law.law import Law, frozen, gain_rows, more_columns, rationals
from polefence.plant.card import card
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof import laws as proof
from polefence.proof.laws import Point


@dataclass(frozen=True, eq=False, repr=False)
class FixedGain(Law):
    """u = K x for every parameter value.

    Parameters
    ----------
    K : (m, n) array
        [input unit / state unit]
    """

    K: Array
    W = None
    powers = ((0,),)

    @explained_fields
    def __post_init__(self) -> None:
        object.__setattr__(self, "K", frozen(self.K, 2, "K"))
        object.__setattr__(self, "gains", self.K[None])

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of inputs and states."""
        m, n = self.K.shape
        return m, n

    @property
    def fixed(self) -> bool:
        """Always true: the gain does not depend on the parameters."""
        return True

    @property
    def in_parts(self) -> bool:
        """Always true: the gain is the same on every part of a box."""
        return True

    @property
    def form(self) -> Array:
        """[I; K], (1, n + m, n)."""
        return np.vstack([np.eye(self.K.shape[1]), self.K])[None]

    @property
    def exact(self) -> proof.Law:
        """The law in rationals."""
        return proof.Law([rationals(self.K)])

    def document(self) -> dict[str, Any]:
        """Return it as plain data, as a proof file has it."""
        return {"kind": "fixed", "K": self.K.tolist()}

    def __repr__(self) -> str:
        return f"<FixedGain {self.K.shape[0]} x {self.K.shape[1]}: {self.K.tolist()}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook."""
        return card("u = K x", gain_rows("K", self.K))

    @explained
    def gain(self, alpha: Any = None, clamp: bool = False) -> Array:  # noqa: ARG002
        """Return K; alpha is accepted, and not needed. Batched alpha gives batched gains."""
        lead = () if alpha is None else np.shape(alpha)[:-1]
        return np.broadcast_to(self.K, (*lead, *self.K.shape))

    def gain_at(self, clamp: bool = False, **values: Any) -> Array:  # noqa: ARG002
        """Return K, whatever the physical parameters."""
        return self.K

    def fitted(self, plant: UncertainPlant) -> FixedGain:  # noqa: ARG002
        """Return the gain itself: it fits every family of its shape."""
        return self

    def domain_of(self, plant: UncertainPlant) -> Domain:
        """Return where claims about its loop are made: the box where there are parameters."""
        return Domain.of("box" if plant.parameters else "simplex", len(plant.vertices))

    def inside(self, plant: UncertainPlant, low: Point, high: Point) -> FixedGain:  # noqa: ARG002
        """Return it: it is the same on every part."""
        return self

    def negated(self) -> FixedGain:
        """Return it with the other sign."""
        return FixedGain(-self.K)

    def with_states(self, more: int) -> FixedGain:
        """Return it for a plant with more states behind its n, which are not fed back."""
        return FixedGain(more_columns(self.K, more))

    def late(self, n: int, more: int) -> FixedGain:
        """Return the gain with zeros for delayed inputs."""
        return FixedGain(np.insert(self.K, [n] * more, 0.0, axis=1))

    def with_filters(
        self,
        y: Sequence[Output],
        rates: Array,
        states: Sequence[Output],  # noqa: ARG002
        filters: Sequence[Output],  # noqa: ARG002
    ) -> FixedGain:
        """Return the law that also steps filters of signals, without using them."""
        (m, n), k = self.shape, len(rates)
        C = np.array([[float(x) for x in signal.C[0]] for signal in y])
        K = np.zeros((m + k, n + k))
        K[:m, :n] = self.K
        K[m:, :n] = rates[:, None] * C[np.arange(k) % len(C)]
        K[m:, n:] = -np.diag(rates)
        return FixedGain(K)

    @property
    def title(self) -> str:
        """The kind of law in words."""
        return "one gain, u = K x"

    def named_gains(self) -> dict[str, Array]:
        """Return K by its name."""
        return {"K": self.K}
