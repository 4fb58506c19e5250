"""A law that was designed at a sample time, as a computer runs it beside the plant itself.

What the law keeps from sample to sample, the inputs on their way among it, are states of the law of
the plant in continuous time: a state that is to be v at the next sample has the rate (v - x) / T in
between, held as all rates of a law's states are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.certify.design import Design
from polefence.law.laws import FixedGain, Law, PolynomialGain, ScheduledGain
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import MOST_STATES, own_states, with_states
from polefence.plant.outputs import Output, states
from polefence.plant.system import Array
from polefence.proof.short import Short
from polefence.proof.text import late_text
from polefence.response.discrete import Sampling


@dataclass(frozen=True, eq=False)
class Running(Short):
    """A plant in continuous time with the states that a law's computer keeps, and that law.

    Attributes
    ----------
    plant : UncertainPlant
        Its last states are the law's, their rates its last inputs.
    law : Law
    sampling : Sampling
        When it is run, and how late its inputs act.
    """

    plant: UncertainPlant
    law: Law
    sampling: Sampling


@explained
def running(plant: UncertainPlant, design: Design) -> Running:
    """Return a design at a sample time as its computer runs it beside a plant.

    Parameters
    ----------
    plant : UncertainPlant
        In continuous time, of the states, inputs and parameters that the design's is the samples
        of.
    design : Design
        Of a plant that `polefence.at_sample_time` returned.

    Raises
    ------
    InputError
        If it is no such design, the plant has another shape, too many inputs are on their way, or
        the law cannot be written so.
    """
    sampling = design.plant.sampling
    if sampling is None or design.plant.sample_time is None:
        raise InputError(f"{design.plant.name}: the design has no sample time")
    if plant.sample_time is not None or sampling.plant.shape != plant.shape:
        raise InputError(f"{plant.name} is not the plant that the design samples")
    late, T = sampling.delay * plant.shape[1], float(design.plant.sample_time)
    kept = own_states(design.plant)
    if late + kept > MOST_STATES:
        raise InputError(
            f"inputs {late_text(sampling.late)}: with the law's own states, {late + kept} numbers "
            f"are kept from sample to sample; at most {MOST_STATES} can be driven"
        )
    law = _law(design, plant, late, kept, T) if late or kept else design.law
    return Running(with_states(plant, late + kept), law, Sampling(T, sampling.late, True))


def _law(design: Design, plant: UncertainPlant, late: int, kept: int, T: float) -> Law:
    """Return the law of the larger plant."""
    law, (n, m) = design.law, plant.shape
    total = design.plant.shape[0]
    columns = [*range(n + late), *range(total - kept, total)]  # filters are between
    if law.K is not None:
        K = law.K[:, columns]
        if np.any(np.delete(law.K, columns, axis=1)):
            raise InputError("the law feeds back states of filters; such a law cannot be simulated")
        return FixedGain(_rows(K, n, m, late, T, 1.0))
    if law.gains is None:
        if total != len(columns):
            raise InputError("the law feeds back states of filters; such a law cannot be simulated")
        W, Z = np.split(law.form, [total], axis=1)
        own = W[:, n : n + late]
        following = np.concatenate([Z[:, :m], own], axis=1)[:, :late]
        rates = (following - own) / T  # (K - [0, I]) W, of what is late
        Z = np.concatenate([Z[:, :m], rates, Z[:, m:]], axis=1)
        return ScheduledGain(W, Z, law.parameters, law.degree, law.domain.sizes)
    measured = tuple(_picked(y, columns) for y in law.measured or states(design.plant))
    late_states = states(with_states(plant, late + kept))[n : n + late]
    r = len(measured)
    powers, ones = list(law.powers), law.one
    powers += [e for e in ones if e not in powers]
    gains = np.zeros((len(powers), m + late + kept, r + late))
    for k, e in enumerate(powers):
        G = law.gains[k] if k < len(law.gains) else np.zeros((m + kept, r))
        wide = np.hstack([G, np.zeros((m + kept, late))])
        gains[k] = _rows(wide, r, m, late, T, ones.get(e, 0))
    gain = None
    if law.anti_windup is not None:
        gain = np.zeros((n + late + kept, m + late + kept))
        gain[:, :m] = law.anti_windup[columns, :m]
    return PolynomialGain(tuple(powers), gains, (*measured, *late_states), law.parameters, gain)


def _rows(K: Array, first: int, m: int, late: int, T: float, one: float) -> Array:
    """Return K with the rates of the late inputs below those of the inputs: (u - x) / T.

    Of one that is a sample later it is what is x then that follows.

    Parameters
    ----------
    first : int
        Column of the first of them.
    one : float
        How many times the identity is in this term.
    """
    own = np.zeros((late, K.shape[1]))
    own[:, first : first + late] = one * np.eye(late)
    rates = np.vstack([K[:m], own])[:late] - own
    return np.vstack([K[:m], rates / T, K[m:]])


def _picked(y: Output, columns: list[int]) -> Output:
    """Return a signal with some columns alone."""
    if any(x for row in y.C for k, x in enumerate(row) if k not in columns):
        raise InputError(f"the law measures a filter's {y.name!r}; it is not driven")
    return replace(y, C=[[row[k] for k in columns] for row in y.C])
