"""How the parameters of a plant move, in floats."""

from __future__ import annotations

from dataclasses import dataclass, replace

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, Exponent
from polefence.proof.plant import ANY


@dataclass(frozen=True)
class Move:
    """A parameter that moves within bounds.

    Attributes
    ----------
    simplex : int
        Its own, of the box.
    ends : (low, high)
        Of its scheduling variable, s at the parameter's low end first.
    inverted : bool
        Whether s is 1/p.
    rates : (low, high)
        Of p, in its unit per unit of time.
    """

    simplex: int
    ends: tuple[float, float]
    inverted: bool
    rates: tuple[float, float]


@dataclass(frozen=True)
class Motion:
    """Which parameters move: within bounds, or at any rate (the numbers of their simplices)."""

    moves: tuple[Move, ...] = ()
    free: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.moves or self.free)

    @classmethod
    def of(cls, plant: UncertainPlant) -> Motion:
        """Return that of a plant, in its own units."""
        moves, free = list[Move](), list[int]()
        for f, own in enumerate(plant.parameters):
            if own.rate == ANY:
                free.append(f)
            elif own.rate is not None:
                low, high = (float(own.scheduling(end)) for end in (own.low, own.high))
                rates = float(own.rate[0]), float(own.rate[1])
                moves.append(Move(f, (low, high), own.inverted, rates))
        return cls(tuple(moves), tuple(free))

    def changed(self, rate: float) -> Motion:
        """Return it with time in units of 1 / rate."""
        moves = (
            replace(own, rates=(own.rates[0] / rate, own.rates[1] / rate)) for own in self.moves
        )
        return replace(self, moves=tuple(moves))

    def like(self, domain: Domain, degree: int) -> list[int]:
        """Return for each Bernstein coefficient of X the first that it has to equal.

        X does not depend on parameters that move at any rate.
        """
        if not degree:
            return [0]
        self.require(domain)
        first: dict[Exponent, int] = {}
        found = []
        for k, e in enumerate(domain.monomials(degree)):
            own = tuple(0 if i // 2 in self.free else power for i, power in enumerate(e))
            found.append(first.setdefault(own, k))
        return found

    def require(self, domain: Domain) -> None:
        """Refuse a domain on which parameters do not move.

        Raises
        ------
        InputError
        """
        if self and set(domain.sizes) != {2}:
            raise InputError(
                "parameters that move need a method on their box; write Scheduled(1, 1, 'box')"
            )


STILL = Motion()
