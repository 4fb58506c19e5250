"""Behaviour of the plant, for a report: step responses, and a car's ride on a road."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, inputs, states
from polefence.response.linear import step
from polefence.show.plots.response import responses_figure
from polefence.show.report.section import Section, Table
from polefence.vehicle.compare import Comparison, compare, points
from polefence.vehicle.labels import comfort_reading
from polefence.vehicle.reference_laws import lqr, skyhook
from polefence.vehicle.rest import GRADE, is_grade, rests

SHARES = (0.05, 0.02)
OURS = "this design"
TITLE = "Comfort, grip and force on a road"


def responses(design: Design) -> Section | None:
    """Return step responses; None for a plant in discrete time."""
    plant = design.plant
    if plant.sample_time is not None:
        return None
    signals = [*states(plant), *inputs(plant), *plant.every_output]
    source = None if all(v.E is not None for v in plant.vertices) else inputs(plant)[0].name
    alpha = points(plant)
    try:
        found = step(plant, design, alpha, signals, source, _drawn(design, alpha))
    except InputError as error:
        return Section("Responses", (f"None are drawn: {error}.",))
    name = (plant.disturbances or ("the disturbance",))[0] if source is None else source
    heads = tuple(f"within {100 * share:g} % [s]" for share in SHARES)
    times = [found.settling(share).max(axis=0) for share in SHARES]
    left = _left(design, alpha, signals) if source is None else {}
    size = "" if source is not None else _size(plant)
    peaks = np.abs(found.peaks()[0]).max(axis=0)
    rows = tuple(
        (signal.label, f"{peak:.4g}", left.get(signal.name, "-"), *(_seconds(t[i]) for t in times))
        for i, (signal, peak) in enumerate(zip(found.signals, peaks, strict=True))
    )
    return Section(
        "Responses",
        (
            f"To a unit step of {name}{size}, over {len(alpha)} points of the family: the largest "
            "peak, what is left while the step stays, and the longest time until a signal is near "
            "that for good (near zero: within that share of its peak).",
        ),
        Table(("signal", "largest peak", "left", *heads), rows),
        responses_figure({plant.name: found}),
    )


def _left(design: Design, alpha: Any, signals: Sequence[Output]) -> dict[str, str]:
    """Return what a unit of the first disturbance leaves of each signal, by name."""
    found = rests(design.plant, design, alpha, signals)
    return {rest.signal.name: rest.span for rest in found if rest.source == found[0].source}


def _size(plant: UncertainPlant) -> str:
    """Say what a unit of a car's road velocity is."""
    return f" ({GRADE})" if is_grade(plant) else ""


def _drawn(design: Design, alpha: Any) -> float:
    """Return how long a step response is worth drawing: ten of its slowest time constants [s]."""
    slowest = float(-design.poles(alpha).real.max())
    return 10 / slowest if slowest > 0 else 10 / design.region.size


def _seconds(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def comfort(design: Design, road: str, speed: float) -> Section | None:
    """Return the ride of a quarter car beside other laws; None for any other plant."""
    plant = design.plant
    if plant.vehicle is None or any(v.E is None for v in plant.vertices):
        return None
    laws = {"passive": None, "skyhook": skyhook(plant), "LQR": lqr(plant), OURS: design}
    found = compare(plant, laws, road, speed)
    if OURS in found.left_out:
        return Section(TITLE, (f"Nothing can be said of this design: {found.left_out[OURS]}.",))
    ours, passive = (found.row(name) for name in (OURS, "passive"))
    if ours.best > passive.worst:
        verdict = "rougher than without control for every car of the family"
    elif ours.worst > passive.worst:
        verdict = "rougher than without control in the worst case"
    else:
        verdict = "smoother than without control in the worst case"
    reading = " to ".join(comfort_reading(ours.worst))
    return Section(
        TITLE,
        (
            f"Stationary ride on a class {found.road} road of ISO 8608 at {speed:g} m/s, worst "
            f"case and best over {len(found.alpha)} points of the family. The ride is {verdict}: "
            f"weighted by ISO 2631-1, {ours.worst:.3g} m/s2 against {passive.worst:.3g} m/s2 in "
            f"the worst case, which people in public transport call {reading}.",
            "Pole location is no specification of comfort: a small disk far from the imaginary "
            "axis asks for speed.",
        ),
        _comfort_table(found),
    )


def _comfort_table(found: Comparison) -> Table:
    names = list(dict.fromkeys((row.quantity, row.unit) for row in found.rows))
    rows = tuple(
        (
            f"{quantity} [{unit}]",
            *(
                "{0.worst:.3g} ({0.best:.3g})".format(found.row(law, quantity))
                for law in found.laws
            ),
        )
        for quantity, unit in names
    )
    return Table(("worst (best)", *found.laws), rows)
