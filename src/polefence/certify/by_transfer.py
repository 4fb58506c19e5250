"""Bounds by the transfer function: the least level at which its polynomials are positive."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

from polefence.law.laws import Law
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.base import Verdict, prove
from polefence.proof.claims.signal import SignalClaim
from polefence.proof.laws import Evidence
from polefence.proof.transfer import Transfer, positive
from polefence.proof.work import MAX_WORK, FormatError, counted
from polefence.requirements.specification import Specification, claim_of

# Over the worst value known, levels that are tried until one is proved.
ABOVE = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 5e-2)
# Of one loop: of 20 states it takes 1 s, of 30 ten; one Riccati equation 10 ms.
MOST_STATES = 20
BELOW = (1e-5, 1e-3, 0.1, 0.9)  # below it, until one is not: floats may be more than the truth
NEAR = 1e-6  # between a level that is proved and one that is not; so much is added to the least


@dataclass(frozen=True, eq=False)
class ByTransfer:
    """A bound that the transfer function is to prove.

    Attributes
    ----------
    claim : SignalClaim
        At some level.
    transfer : Transfer
    domain : Domain
        Of alpha.
    """

    claim: SignalClaim
    transfer: Transfer
    domain: Domain

    @classmethod
    def of(cls, plant: UncertainPlant, law: Law, specification: Specification) -> ByTransfer | None:
        """Return it for a plant in its delta form; None where there is no such proof."""
        plant, law, specification = specification.posed(plant, law)
        domain = law.domain_of(plant)
        large = domain.corners == 1 and plant.shape[0] > MOST_STATES
        if large and not specification.by_transfer_alone:
            return None
        box = domain.corners in (1, 2 ** len(domain.sizes))
        if plant.moving or plant.remainder is not None or not box or not specification.of_signal:
            return None
        on, evidence = domain.on, Evidence([], transfer=True)
        level = Fraction(specification.at_most or 1.0)
        claim = claim_of(plant, law.exact, on, specification, evidence, level)
        if not isinstance(claim, SignalClaim) or not claim.has_transfer:
            return None
        with suppress(FormatError), counted():
            claim.require()
            transfer = claim.series.transfer()  # with its filters
            return cls(claim, transfer, domain) if transfer.is_stable else None
        return None

    def proved(self, level: float) -> tuple[SignalClaim, Verdict] | None:
        """Return the claim of a level and its verdict, if it is proved."""
        claim = replace(self.claim, level=Fraction(level))
        with suppress(FormatError):
            verdict = prove(claim)
            return (claim, verdict) if verdict.proved else None
        return None

    def least(self, worst: float) -> tuple[SignalClaim, Verdict] | None:
        """Return the claim of nearly the least level that is proved, and its verdict.

        Parameters
        ----------
        worst : float
            About the worst value.
        """
        if not self._fits:
            return None
        high = next((level for s in ABOVE if self._holds(level := worst * (1 + s))), None)
        if high is None:
            return None
        low = worst
        if high <= worst * (1 + ABOVE[0]):
            if not self._holds(worst * (1 - BELOW[0])):
                return self.proved(high)
            lower = (worst * (1 - s) for s in BELOW[1:])
            low = next((level for level in lower if not self._holds(level)), 0.0)
        while high - low > NEAR * high:
            middle = (low + high) / 2
            low, high = (low, middle) if self._holds(middle) else (middle, high)
        return self.proved(high * (1 + NEAR))

    def worst(self, alpha: Array, values: Array) -> tuple[float, int]:
        """Return the worst of some values, and its number; exact where floats do not agree with it.

        Parameters
        ----------
        alpha : (count, N) array
        values : (count,) array
            In floats.
        """
        values, exact = values.copy(), dict[int, float]()
        for _ in range(min(40, len(values))):  # so many that do not agree are evaluated exactly
            k = int(values.argmax())
            if k in exact:
                return exact[k], k
            value = self._value(alpha[k])
            if value is None or abs(value - values[k]) <= 1e-6 * value:
                return float(values[k]), k
            if not exact:  # floats say little: the vertices are often the worst
                values = values + values.max() * (alpha.max(axis=1) == 1)
            values[k] = exact[k] = value
        k = max(exact, key=exact.__getitem__)
        return exact[k], k

    def largest(self, alpha: Array) -> float:
        """Return the largest exact value at some points; zero where there is none."""
        values = (self._value(row) for row in alpha)
        return max((x for x in values if x is not None), default=0.0)

    def _value(self, alpha: Array) -> float | None:
        """Return what is bounded at a point, None of a kind that is not evaluated exactly."""
        t = [Fraction(x) for x in self.domain.coordinates(alpha)[1::2].tolist()]
        with suppress(FormatError):
            square = self.claim.value(self.transfer.inside(t if self.transfer.degrees else ()))
            return None if square is None else float(square) ** 0.5
        return None

    @cached_property
    def _fits(self) -> bool:
        """Whether the polynomials can be written down in the work that is allowed."""
        with suppress(FormatError), counted():
            self.claim.value(self.transfer)  # of an rms what takes longest, which is kept
            return True
        return False

    def _holds(self, level: float) -> bool:
        """Whether all polynomials of a level are positive, as far as its share of the work goes."""
        claim = replace(self.claim, level=Fraction(level))
        with suppress(FormatError), counted(MAX_WORK // 4):
            return all(positive(P).proved for _, P in claim.polynomials(self.transfer))
        return False
