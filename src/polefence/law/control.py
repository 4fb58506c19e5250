"""Laws as systems of python-control; needs the extra ``polefence[control]``."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.base.errors import InputError, MissingExtraError
from polefence.law.laws import FixedGain, Law
from polefence.plant.control import signal_names
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array

GIVEN = ("parameters", "alpha")


def to_control(
    plant: UncertainPlant, law: Law, given: str = "", name: str = "law", clamp: bool = True
) -> Any:
    """Return u = K(alpha) x as a system of python-control without states; see `Design.to_control`.

    Raises
    ------
    InputError
        If ``given`` is neither "parameters" nor "alpha", or the plant has no parameters.
    MissingExtraError
        If python-control is not installed.
    """
    try:
        import control
    except ImportError as error:
        raise MissingExtraError(
            "python-control is not installed; pip install 'polefence[control]'"
        ) from error
    keys = _scheduled_by(plant, law, given)
    x, u, _ = signal_names(plant, keys)
    common = {
        "inputs": [*x, *keys],
        "outputs": u,
        "dt": 0 if plant.sample_time is None else float(plant.sample_time),
        "name": name,
    }
    if isinstance(law, FixedGain):
        D = np.hstack([law.K, np.zeros((len(law.K), len(keys)))])
        return control.ss([], [], [], D, **common)
    n, by_alpha = plant.shape[0], given == "alpha" or not plant.parameters

    def output(_t: float, _x: Array, signals: Any, _params: Any) -> Array:
        """Return u; the first inputs are x."""
        values = np.asarray(signals, dtype=float)
        alpha: Any = values[n:]
        if not by_alpha:
            alpha = plant.alpha(clamp=clamp, **dict(zip(keys, values[n:].tolist(), strict=True)))
        return law.control(alpha, values[:n], clamp)

    return control.nlsys(None, output, **common)


def _scheduled_by(plant: UncertainPlant, law: Law, given: str) -> list[str]:
    """Return the names of what schedules the law; of one gain only those that are asked for."""
    wanted = " or ".join(repr(g) for g in GIVEN) if plant.parameters else "'alpha'"
    if given not in ("", *GIVEN) or (given == "parameters" and not plant.parameters):
        raise InputError(f"given = {given!r} is not what {plant.name} has; use {wanted}")
    if isinstance(law, FixedGain) and not given:
        return []
    if given == "alpha" or not plant.parameters:
        return [f"alpha{j + 1}" for j in range(len(plant.vertices))]
    return [p.name for p in plant.parameters]
