"""States that the code of a law keeps itself: a dynamic law's, integrals and filters of a PID.

In the larger plant of `polefence.law.structure` a law's own states x_c are states with x_c' = v,
or x_c(t + T) = x_c + T v, and their rates v are inputs. A PID's have dynamics in A; `with_rates`
moves these into the law.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polefence.certify.design import Design
from polefence.law.laws import Law, PolynomialGain
from polefence.plant.delta import delta_form
from polefence.plant.larger import (
    DERIVATIVE,
    FILTER,
    INTEGRAL,
    own_states,
    with_rates_as_inputs,
)
from polefence.plant.outputs import states
from polefence.plant.system import Array


def kept(design: Design) -> int:
    """Return how many states, the last ones, the code of a law keeps itself."""
    return own_states(design.plant) if design.law.W is None else 0


def late_inputs(design: Design, delay: int) -> int:
    """Return how many inputs, the first ones, act a step late: not rates of the law's states."""
    return delay * (design.plant.shape[1] - kept(design))


def with_rates(design: Design) -> Design:
    """Return a PID as a law whose integrals and filters are stepped by rates of its own.

    The closed loop A + B K C is the same, up to the rounding of the gains, and so is its proof. Any
    other design is returned as it is.
    """
    law, plant = design.law, design.plant
    if law.gains is None or not law.measured:
        return design
    r, names = len(law.measured) // 3, [signal.name for signal in law.measured]
    known = [state.name for state in states(plant)[-2 * r :]] if r else []
    signals = names[:r]
    integrals, filters = ([before + name for name in signals] for before in (INTEGRAL, FILTER))
    pid = signals + integrals + [DERIVATIVE + name for name in signals]
    if not r or names != pid or known != integrals + filters:
        return design
    larger = with_rates_as_inputs(plant, 2 * r)
    measured = (*law.measured[:r], *states(larger)[-2 * r :])
    w = float(-delta_form(plant).vertices[0].exact_A[-1][-1])
    powers, gains = _terms(law, _of_states(law.gains, r, w), _rates(r, w))
    gain = None if law.anti_windup is None else np.pad(law.anti_windup, [(0, 0), (0, 2 * r)])
    stepped = PolynomialGain(powers, gains, measured, law.parameters, gain)
    certificate = replace(design.certificate, plant=larger, law=stepped)
    return replace(design, certificate=certificate)


def _of_states(gains: Array, r: int, w: float) -> Array:
    """Return gains of signals, integrals and filters z, of which w (y - z) are the derivatives."""
    of_y, of_integrals, of_rates = (gains[..., k * r : (k + 1) * r] for k in range(3))
    return np.concatenate([of_y + w * of_rates, of_integrals, -w * of_rates], axis=-1)


def _rates(r: int, w: float) -> Array:
    """Return the rates of integrals and filters: y, and w (y - z)."""
    eye, none = np.eye(r), np.zeros((r, r))
    return np.block([[eye, none, none], [w * eye, none, -w * eye]])


def _terms(law: Law, gains: Array, rates: Array) -> tuple[tuple[tuple[int, ...], ...], Array]:
    """Return powers and gains with the rates below, the same for all parameters."""
    powers, ones = law.powers, law.one
    every = (*powers, *(e for e in ones if e not in powers))
    upper = np.concatenate([gains, np.zeros((len(every) - len(powers), *gains.shape[1:]))])
    lower = np.array([ones.get(e, 0) * rates for e in every])
    return every, np.concatenate([upper, lower], axis=1)
