"""Result of a drive, as one value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output, choose, rate_place
from polefence.plant.system import Array
from polefence.region.text import digits_down
from polefence.response.result import Response
from polefence.vehicle.driving.events import Event, summary
from polefence.vehicle.driving.trajectories import Space
from polefence.vehicle.estimate import Estimate


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """What came of a drive, for ``count`` cars at equal instants.

    Attributes
    ----------
    plant : UncertainPlant
    time : (time,) array
        From 0 [s].
    states, rates : (count, time, n) arrays
        x and dx/dt; at an instant where something jumps, just after it.
    demanded, applied : (count, time, m) arrays
        What the law asked of the inputs, and what the actuators gave.
    disturbance : (time, q) array
        The road's velocity, or what else was given; over a step that begins there.
    stop_force : (count, time) array
        Of the bump stops, up on the sprung mass [N].
    parameters, used : (count, time, q) arrays
        The true ones, and what the law was told, cut off at the intervals; in their units. For a
        plant given by its vertices, weights alpha.
    events : tuple of Event
        In order of kind, then car.
    notes : tuple of str
        What is so throughout and in no claim, and what could not be compared.
    covered : (count, time) array of bool, optional
        Where the given margins cover what the parameters did and were taken for, with no limit
        met; None without margins. It says nothing of ``notes``.
    estimate : Estimate, optional
        What the estimator found.
    """

    plant: UncertainPlant
    time: Array
    states: Array
    rates: Array
    demanded: Array
    applied: Array
    disturbance: Array
    stop_force: Array
    parameters: Array
    used: Array
    events: tuple[Event, ...]
    notes: tuple[str, ...]
    covered: Any = None
    estimate: Estimate | None = None

    def __repr__(self) -> str:
        count, instants, _ = self.states.shape
        return (
            f"<Drive of {self.plant.name!r}: {count} cars, {self.time[-1]:g} s, {instants} "
            f"instants, {len(self.events)} events>"
        )

    def __str__(self) -> str:
        return "\n".join(self.report())

    def report(self) -> list[str]:
        """Return in plain lines where the guarantee does not hold, and what is in none."""
        count, end = len(self.states), self.time[-1]
        lines = [f"{self.plant.name}: {count} cars, {end:g} s"]
        if self.covered is not None:
            lasting = self.covered[:, :-1].mean(axis=1).min() * end
            lines.append(f"the margins cover {digits_down(lasting)} s of {end:g} s (the worst car)")
        lines += summary(self.events, count) or ["no limit was met"]
        return lines + [f"note: {note}" for note in self.notes]

    def of(self, name: str) -> Array:
        """Return one state or input as it was applied, by its name, (count, time)."""
        return self.response([name]).values[:, :, 0]

    def response(self, signals: Sequence[Output | str] | None = None) -> Response:
        """Return signals over time, states and inputs by default.

        Inputs are the applied ones. An output that is the rate of change of a state, such as an
        acceleration, has the force of stops and the weight of a changed load in it. The result's
        alpha is that of the first instant.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        asked = choose(self.plant, signals)
        values = np.stack([self._values(output) for output in asked], axis=-1)
        alpha = Space(self.plant).alpha(self.parameters[:, 0])
        return Response(self.plant, alpha, self.time, asked, values)

    def _values(self, output: Output) -> Array:
        """Return an output over time, (count, time)."""
        place = rate_place(self.plant, output)
        if place is not None:
            return self.rates[..., place]
        found, alpha = np.zeros(self.states.shape[:2]), None
        sources = self.states, self.applied, self.disturbance[None]
        for rows, own, source in zip(
            (output.C, output.D, output.F), output.arrays(self.plant), sources, strict=True
        ):
            if len(rows) == 1:
                found += source @ own[0]
            elif rows:
                alpha = Space(self.plant).alpha(self.parameters) if alpha is None else alpha
                found += np.einsum("...j,...j->...", alpha @ own, source)
        return found
