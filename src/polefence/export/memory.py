"""States that the code of a law keeps itself: a dynamic law's, integrals and filters of a PID.

In the larger plant of `polefence.law.structure` a law's own states x_c are states with x_c' = v,
or x_c(t + T) = x_c + T v, and their rates v are inputs. A PID's have dynamics in A; `with_rates`
moves these into the law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from polefence.certify.design import Design
from polefence.law.stepped import stepped
from polefence.plant.larger import own_states


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
    plant, law = stepped(design.plant, design.law)
    if law is design.law:
        return design
    more, place = plant.shape[1] - design.plant.shape[1], sum(design.plant.shape)
    evidence = _with_inputs(design.certificate.evidence, more, place)
    certificate = replace(design.certificate, plant=plant, law=law, evidence=evidence)
    return replace(design, certificate=certificate)


def _with_inputs(evidence: Mapping[str, Any], more: int, place: int) -> dict[str, Any]:
    """Return evidence for a plant with more inputs, that its remainder has no part in."""
    wider = dict[str, Any](evidence)
    for key in ("parts", "cells"):
        if key in evidence:
            wider[key] = tuple(_with_inputs(part, more, place) for part in evidence[key])
    if "remainder" in evidence:
        spread = evidence["remainder"]
        columns = np.insert(spread["columns"], [place] * more, 0.0)
        wider["remainder"] = dict(spread) | {"columns": columns}
    return wider
