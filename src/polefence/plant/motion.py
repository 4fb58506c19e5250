"""How the parameters of a plant move, in floats."""

from __future__ import annotations

from dataclasses import dataclass, replace

from polefence.base.errors import InputError
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain, Exponent
from polefence.proof.motion import anywhere
from polefence.proof.ranges import ANY


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
    rates : (low, high), optional
        Of p, in its unit per unit of time, or per sample in discrete time; None where it may go
        anywhere in a sample.
    """

    simplex: int
    ends: tuple[float, float]
    inverted: bool
    rates: tuple[float, float] | None


@dataclass(frozen=True)
class Motion:
    """Which parameters move.

    Attributes
    ----------
    moves : tuple of Move
        Those that move within bounds; in discrete time all.
    free : tuple of int
        The numbers of the simplices of those that move at any rate, of which X is independent.
    centre : float, optional
        In discrete time, minus the centre of the disks that are about motions.
    """

    moves: tuple[Move, ...] = ()
    free: tuple[int, ...] = ()
    centre: float | None = None

    def __bool__(self) -> bool:
        return bool(self.moves or self.free)

    @classmethod
    def of(cls, plant: UncertainPlant) -> Motion:
        """Return that of a plant, in its own units."""
        moves, free = list[Move](), list[int]()
        T = plant.period
        for f, p in enumerate(plant.parameters):
            low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
            if p.rate is None:
                continue
            rates: tuple[float, float] | None = None
            if p.rate != ANY and not (T and anywhere(p.rate, p.high - p.low, T)):
                slow, fast = (float(end * (T or 1)) for end in p.rate)
                rates = slow, fast
            if T or rates is not None:
                moves.append(Move(f, (low, high), p.inverted, rates))
            else:
                free.append(f)
        centre = None
        if T:
            centre = 1 / float(plant.step) if plant.step else 0.0
        return cls(tuple(moves), tuple(free), centre)

    def changed(self, rate: float) -> Motion:
        """Return it with time in units of 1 / rate."""
        if self.centre is not None:
            return replace(self, centre=self.centre / rate)
        moves = (
            replace(move, rates=(move.rates[0] / rate, move.rates[1] / rate))
            for move in self.moves
            if move.rates is not None
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
        like = []
        for k, e in enumerate(domain.monomials(degree)):
            rest = tuple(0 if i // 2 in self.free else power for i, power in enumerate(e))
            like.append(first.setdefault(rest, k))
        return like

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
