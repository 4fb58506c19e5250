"""Where the inputs of a law end: the limits and rates with which its saturation is proved."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from polefence.certify.design import Design
from polefence.plant.larger import own_states
from polefence.plant.outputs import LATE, inputs, states
from polefence.proof.claims import Saturation
from polefence.proof.claims.base import Claim
from polefence.proof.plant import Output
from polefence.proof.short import Short


@dataclass(frozen=True)
class Proved(Short):
    """A limit of each input, and how fast it may move; empty where one has none.

    Attributes
    ----------
    limits, rates : tuple of float
        In the inputs' units, and a second.
    """

    limits: tuple[float, ...] = ()
    rates: tuple[float, ...] = ()


def proved_ends(design: Design, claims: Iterable[Claim]) -> Proved:
    """Return the limits and rates of a design's saturation, for its code to keep.

    Of several claims the largest: what is held back less is held back as each of them has it.
    Rates are those of a design at a sample time, of inputs that are late.
    """
    plant = design.plant
    count, known = plant.shape[1] - own_states(plant), [state.name for state in states(plant)]
    late = {
        j: known.index(signal.name + LATE)
        for j, signal in enumerate(inputs(plant))
        if signal.name + LATE in known
    }
    limits, rates = dict[int, Fraction](), dict[int, Fraction]()
    for claim in (one for one in claims if isinstance(one, Saturation)):
        for output in claim.outputs:
            j, state, size = _of(output)
            if state is None:
                limits[j] = max(limits.get(j, Fraction(0)), claim.level / size)
            elif late.get(j) == state and plant.sample_time is not None:
                rate = claim.level / size / plant.sample_time
                rates[j] = max(rates.get(j, Fraction(0)), rate)
    ends = [
        tuple(float(table[j]) for j in range(count)) if len(table) == count else ()
        for table in (limits, rates)
    ]
    return Proved(*ends)


def _of(output: Output) -> tuple[int, int | None, Fraction]:
    """Return i, j or none, and |d| of a signal d u_i, or d (u_i - x_j); -1 for j of any other."""
    (c,), (d,) = output.C[0], output.D[0]
    i = next(i for i, x in enumerate(d) if x)
    moved = [j for j, x in enumerate(c) if x]
    if not moved:
        return i, None, abs(d[i])
    alone = len(moved) == 1 and c[moved[0]] == -d[i]
    return i, moved[0] if alone else -1, abs(d[i])
