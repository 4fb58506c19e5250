"""A map of two parameters: where the poles of a law are in the region, any car to be chosen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bokeh.events import Tap
from bokeh.models import ColumnDataSource, Range1d

from polefence.certify.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.points import weights_of
from polefence.region.regions import Region
from polefence.studio.palette import Palette, coloured, small_figure
from polefence.studio.state import State
from polefence.studio.words import of_parameter, plain

SIDE = 24  # cars either way


class Map:
    """The pane.

    Parameters
    ----------
    plant : UncertainPlant
        Of two parameters or more: the first two span the map.
    palette : Palette
    choose : callable
        Called with the values of the two parameters that were pointed at.
    """

    def __init__(
        self, plant: UncertainPlant, palette: Palette, choose: Callable[[dict[str, float]], object]
    ) -> None:
        self.plant, self._palette, self._choose = plant, palette, choose
        self._ranges = [(float(p.low), float(p.high)) for p in plant.parameters[:2]]
        x, y = (low + (high - low) * (np.arange(SIDE) + 0.5) / SIDE for low, high in self._ranges)
        self._x, self._y = (axis.ravel() for axis in np.meshgrid(x, y))
        empty = np.full(SIDE**2, palette.paper)
        self.cells = ColumnDataSource({"x": self._x, "y": self._y, "colour": empty})
        self.here = ColumnDataSource({"x": [], "y": []})
        self.figure = self._figure()

    def _figure(self) -> Any:
        first, second = self.plant.parameters[:2]
        (left, right), (low, high) = self._ranges
        plot = small_figure(
            "map",
            height=260,
            x_range=Range1d(left, right),
            y_range=Range1d(low, high),
            x_axis_label=plain(of_parameter(first)),
            y_axis_label=plain(of_parameter(second)),
        )
        size = {"width": (right - left) / SIDE, "height": (high - low) / SIDE}
        plot.rect("x", "y", source=self.cells, fill_color="colour", line_color=None, **size)
        mark = {"source": self.here, "size": 14, "marker": "x", "color": self._palette.ink}
        plot.scatter("x", "y", line_width=3, **mark)
        coloured(plot, self._palette)
        plot.on_event(Tap, self._tapped)
        return plot

    def show(self, design: Design | None, region: Region, state: State) -> int | None:
        """Show where the poles of a law are in a region; return in how many cells they are not.

        Without a law nothing is shown, and None returned.

        Parameters that are not in the map have the values of the state.
        """
        if design is None:
            colours = np.full(SIDE**2, self._palette.paper)
            self.cells.data = {"x": self._x, "y": self._y, "colour": colours}
            return None
        names = [p.name for p in self.plant.parameters]
        values = np.tile([dict(state.values)[name] for name in names], (SIDE**2, 1))
        values[:, 0], values[:, 1] = self._x, self._y
        poles = design.poles(weights_of(self.plant.parameters, values))
        outside = region.distance(poles).max(axis=-1) >= 0
        colours = np.where(outside, self._palette.looked, self._palette.inside)
        self.cells.data = {"x": self._x, "y": self._y, "colour": colours}
        return int(outside.sum())

    def python(self, state: State) -> str:
        """Return the Python that finds the cells in which a design keeps the region."""
        values, (x, y) = dict(state.values), (p.name for p in self.plant.parameters[:2])
        (left, right), (low, high) = ((axis[0], axis[-1]) for axis in (self._x, self._y))
        rest = "".join(f", {p.name!r}: {values[p.name]!r}" for p in self.plant.parameters[2:])
        lines = [
            "import numpy as np",
            "",
            "alpha = [",
            f"    plant.alpha(**{{{x!r}: a, {y!r}: b{rest}}})",
            f"    for a in np.linspace({float(left)!r}, {float(right)!r}, {SIDE})",
            f"    for b in np.linspace({float(low)!r}, {float(high)!r}, {SIDE})",
            "]",
            "inside = region.distance(design.poles(np.array(alpha))).max(axis=-1) < 0",
        ]
        return "\n".join(lines)

    def look(self, state: State) -> None:
        """Mark the car of a state."""
        first, second = (dict(state.values)[p.name] for p in self.plant.parameters[:2])
        self.here.data = {"x": [first], "y": [second]}

    def _tapped(self, event: Any) -> None:
        """Choose the car that is pointed at."""
        places = ((event.x, *self._ranges[0]), (event.y, *self._ranges[1]))
        values = [min(max(float(place), low), high) for place, low, high in places]
        names = (p.name for p in self.plant.parameters[:2])
        self._choose(dict(zip(names, values, strict=True)))
