"""A PID as a law that steps its integrals and filters itself, by rates that are its own inputs."""

from __future__ import annotations

import numpy as np

from polefence.law.law import Law
from polefence.law.polynomial import PolynomialGain
from polefence.plant.delta import delta_form
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import DERIVATIVE, FILTER, INTEGRAL, with_rates_as_inputs
from polefence.plant.outputs import states
from polefence.plant.system import Array


def stepped(plant: UncertainPlant, law: Law) -> tuple[UncertainPlant, Law]:
    """Return a PID as a law of rates of its integrals and filters, beside the plant of these.

    Any other law is returned as it is.
    """
    if law.gains is None or not law.measured:
        return plant, law
    r, names = len(law.measured) // 3, [signal.name for signal in law.measured]
    known = [state.name for state in states(plant)[-2 * r :]] if r else []
    signals = names[:r]
    integrals, filters = ([before + name for name in signals] for before in (INTEGRAL, FILTER))
    pid = signals + integrals + [DERIVATIVE + name for name in signals]
    if not r or names != pid or known != integrals + filters:
        return plant, law
    larger = with_rates_as_inputs(plant, 2 * r)
    measured = (*law.measured[:r], *states(larger)[-2 * r :])
    w = float(-delta_form(plant).vertices[0].exact_A[-1][-1])
    powers, gains = _terms(law, _of_states(law.gains, r, w), _rates(r, w))
    gain = None if law.anti_windup is None else np.pad(law.anti_windup, [(0, 0), (0, 2 * r)])
    return larger, PolynomialGain(powers, gains, measured, law.parameters, gain)


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
