"""Laws as systems of python-control; needs the extra ``polefence[control]``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from polefence.errors import InputError, MissingExtraError
from polefence.law import Law
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
    given = given or ("parameters" if plant.parameters else "alpha")
    if given not in GIVEN or (given == "parameters" and not plant.parameters):
        wanted = " or ".join(repr(g) for g in GIVEN) if plant.parameters else "'alpha'"
        raise InputError(f"given = {given!r} is not what {plant.name} has; use {wanted}")
    n, m = plant.shape
    keys = [p.name for p in plant.parameters]
    if given == "alpha":
        keys = [f"alpha{j + 1}" for j in range(len(plant.vertices))]
    states = plant.states or [f"x{j + 1}" for j in range(n)]
    outputs = plant.inputs or [f"u{j + 1}" for j in range(m)]
    # the names of what schedules the law stay as they are
    labels = valid_names((*keys, *states, *outputs))
    scheduled, x, u = labels[: len(keys)], labels[len(keys) :][:n], labels[len(keys) + n :]

    def output(_t: float, _x: Array, signals: Any, _params: Any) -> Array:
        """Return u; the first inputs are x."""
        values = np.asarray(signals, dtype=float)
        alpha: Any = values[n:]
        if given == "parameters":
            alpha = plant.alpha(clamp=clamp, **dict(zip(keys, values[n:].tolist(), strict=True)))
        return law.control(alpha, values[:n], clamp)

    return control.nlsys(
        None,
        output,
        inputs=[*x, *scheduled],
        outputs=u,
        dt=0 if plant.sample_time is None else float(plant.sample_time),
        name=name,
    )


def valid_names(names: Iterable[str]) -> list[str]:
    """Return names for python-control: without units, of letters, digits and _, no two the same."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"\W+", "_", re.sub(r"\[[^\]]*\]", "", name), flags=re.ASCII).strip("_")
        plain = plain if plain and not plain[0].isdigit() else f"signal_{plain}".rstrip("_")
        own, count = plain, 1
        while own in found:
            count += 1
            own = f"{plain}_{count}"
        found.append(own)
    return found
