"""Closed loops of a family as python-control systems, for the plots and functions that it has."""

from __future__ import annotations

from typing import Any

import numpy as np

from polefence.base.explained import explained
from polefence.law.control import to_control, valid_names
from polefence.plant.family import UncertainPlant
from polefence.response.closed import gains, passing


@explained
def closed_loops(plant: UncertainPlant, law: Any = None, alpha: Any = None) -> list[Any]:
    """Return closed loops at points of a family as python-control systems.

    ``control.step_response``, ``control.bode_plot`` and ``control.pole_zero_map`` take such a list.

    Parameters
    ----------
    law : None, Law, Design, GainTable or (m, n) array
        u = K x, without a minus; none leaves the plant to itself.
    alpha : (count, N) or (N,) array, optional
        Points of the polytope, weights of the vertices; by default the vertices. Of a plant with
        parameters a scheduled law is taken at the parameters that they stand for.

    Returns
    -------
    list of control.StateSpace
        From [v, w], v added to what the law demands, to the states, the plant's outputs, and
        u = K x + v (or K y + v), which is called as its input with ``_of_law`` behind. Other names
        are those of `to_control`.

    Raises
    ------
    ParameterValueError
        If a point is none of the polytope.
    InputError
        If the law does not fit the plant.
    MissingExtraError
        If python-control is not installed.
    """
    points = np.eye(len(plant.vertices)) if alpha is None else np.atleast_2d(alpha)
    plants = [to_control(plant, weights, outputs=True) for weights in points]
    alpha = np.asarray(points, dtype=float)
    each = zip(plants, gains(plant, law, alpha), passing(plant, law, alpha), strict=True)
    return [_closed(plant_at, K, P, k) for k, (plant_at, K, P) in enumerate(each, 1)]


def _closed(plant: Any, K: Any, P: Any, number: int) -> Any:
    """Return one plant with u = K x + P w + v."""
    import control  # there, for the plant is one of its systems

    m = len(K)
    fed, through = plant.B[:, :m] @ K, plant.D[:, :m] @ K
    acting = np.eye(plant.ninputs)  # [u; w] of [v; w]
    acting[:m, m:] = P
    given, outputs = plant.input_labels, plant.output_labels
    demands = valid_names((*given, *outputs, *(f"{name}_of_law" for name in given[:m])))
    return control.ss(
        plant.A + fed,
        plant.B @ acting,
        np.vstack([plant.C + through, K]),
        np.vstack([plant.D @ acting, acting[:m]]),
        plant.dt,
        states=plant.state_labels,
        inputs=given,
        outputs=[*outputs, *demands[len(given) + len(outputs) :]],
        name=f"{plant.name}_{number}",
    )
