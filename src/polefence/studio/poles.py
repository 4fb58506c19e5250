"""The plane of the poles: region, cloud, trails; handles that are dragged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bokeh.events import Pan, PanEnd, PanStart
from bokeh.models import ColumnDataSource, CustomJS, Range1d, Span
from bokeh.plotting import figure

from polefence.base.errors import RegionError
from polefence.certify.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.points import seeded, weights_of
from polefence.plant.system import Array
from polefence.proof.text import visible
from polefence.region.regions import Curve, Region, View
from polefence.show.plots import PANEL, shaped, view_of
from polefence.studio.handles import Handle, handles, in_sight, moved, outline
from polefence.studio.palette import LIGHT, Palette, coloured
from polefence.studio.state import State
from polefence.studio.templates import template

ASKED = ("x", "y", "handle", "begin", "end", "number")  # of a place that is dragged to


class Poles:
    """The figure.

    Parameters
    ----------
    plant : UncertainPlant
    state : State
    drag : callable
        Called with the region that a handle was dragged to, and whether the drag is at its end.
    palette : Palette
    """

    def __init__(
        self,
        plant: UncertainPlant,
        state: State,
        drag: Callable[[Region, bool], object],
        palette: Palette = LIGHT,
    ) -> None:
        self.plant, self._drag, self._palette = plant, drag, palette
        self._alpha = seeded(plant, 250 + len(plant.vertices))
        self._design: Design | None = None
        self._handles: list[Handle] = []
        self._number = 0  # of the place that a handle was dragged to last
        self._held: tuple[Handle, Region] | None = None
        self._moving = False  # whether it is a drag that changes the region
        self.state = state
        self._sources()
        self.figure = self._figure()
        self.fit()

    def _sources(self) -> None:
        empty: dict[str, list[float]] = {"x": [], "y": []}
        self.region, self.cloud, self.corners, self.looked, self.handles = (
            ColumnDataSource(dict(empty)) for _ in range(5)
        )
        self.trails = [ColumnDataSource(dict(empty)) for _ in self.plant.parameters]
        self.asked = ColumnDataSource({key: [] for key in ASKED})
        self.seen = ColumnDataSource({"number": [0], "shown": [0]})
        self.asked.on_change("data", self._dragged)

    def _figure(self) -> Any:
        colour, discrete = self._palette, self.plant.sample_time is not None
        plot = figure(
            sizing_mode="scale_width",
            width=750,
            height=round(750 / PANEL),
            min_width=280,
            x_range=Range1d(-1, 1),
            y_range=Range1d(-1, 1),
            x_axis_label="real part" if discrete else "real part [1/s]",
            y_axis_label="imaginary part" if discrete else "imaginary part [rad/s]",
            tools="pan,wheel_zoom,reset,save",
            active_drag=None,
            toolbar_location="above",
            name="poles",
        )
        plot.toolbar.logo = None
        marks = {"source": self.region, "color": colour.inside, "line_color": colour.cars}
        plot.patch("x", "y", line_width=2, **marks)
        plot.add_layout(Span(location=0, dimension="height", line_color="#888888"))
        marks = {"source": self.cloud, "size": 3, "color": colour.cars, "alpha": 0.6}
        plot.scatter("x", "y", legend_label="the family", **marks)
        marks = {"source": self.corners, "size": 8, "marker": "square", "line_color": colour.ink}
        plot.scatter("x", "y", fill_alpha=0, legend_label="its vertices", **marks)
        for k, (trail, p) in enumerate(zip(self.trails, self.plant.parameters, strict=True)):
            label = f"as {visible(p.name)} varies"
            shade = colour.trails[k % len(colour.trails)]
            plot.scatter("x", "y", source=trail, size=4, color=shade, legend_label=label)
        marks = {"source": self.looked, "size": 12, "marker": "x", "color": colour.looked}
        plot.scatter("x", "y", line_width=3, legend_label="the one looked at", **marks)
        marks = {"source": self.handles, "size": 14, "marker": "diamond", "color": colour.paper}
        marks |= {"line_color": colour.ink, "line_width": 2, "legend_label": "handles: drag"}
        plot.scatter("x", "y", name="handles", **marks)
        if plot.legend:
            plot.legend.update(location="top_left", click_policy="hide", spacing=0, padding=4)
            plot.legend.label_text_font_size = "11px"
        coloured(plot, colour)
        self._draggable(plot)
        return plot

    def _draggable(self, plot: Any) -> None:
        """Have the browser tell where handles are dragged to."""
        models: dict[str, Any] = {
            "asked": self.asked,
            "seen": self.seen,
            "handles": self.handles,
            "plot": plot,
        }
        # [px] from a handle to where it can be grabbed
        models |= {"reach": 24}
        code = template("dragging.js")
        for event, what in ((PanStart, "begin"), (Pan, "move"), (PanEnd, "end")):
            plot.js_on_event(event, CustomJS(args=models | {"what": what}, code=code))
        self.seen.js_on_change("data", CustomJS(args=models | {"what": "seen"}, code=code))

    def fit(self) -> None:
        """Show all of the region and of the poles."""
        self._frame()
        self._draw()

    def look(self, state: State) -> None:
        """Show a state's region, and its car; fit the view to a region that is out of sight."""
        before, self.state = self.state, state
        new = state.region != before.region and not self._moving
        if new and not in_sight(state.region, self._seen):
            self._frame()
        self._draw()
        if state.values != before.values:
            self._trace()

    @property
    def _seen(self) -> View:
        """What the browser shows, be it panned or zoomed."""
        x, y = self.figure.x_range, self.figure.y_range
        return x.start, x.end, max(abs(y.start), abs(y.end))

    def _frame(self) -> None:
        poles = np.zeros(0) if self._design is None else self._design.poles(self._alpha)
        self.view, _ = shaped(view_of(self.state.region, np.ravel(poles)))
        low, high, height = self.view
        self.figure.x_range.update(start=low, end=high)
        self.figure.y_range.update(start=-height, end=height)

    def _draw(self) -> None:
        self.region.data = _columns(outline(self.state.region, self.view))
        self._handles = handles(self.state.region, self.view)
        self.handles.data = _columns(np.array([handle.place for handle in self._handles]))

    def show(self, design: Design | None, region: Region) -> None:
        """Show the poles of a law that was asked for a region; none where there is none."""
        self._design = design
        none = np.zeros((0, 0), dtype=complex)
        poles, corners = (
            none if design is None else design.poles(self._alpha),
            len(self.plant.vertices),
        )
        self.cloud.data = _columns(np.ravel(poles[corners:]))
        self.corners.data = _columns(np.ravel(poles[:corners]))
        self._trace()
        if region == self.state.region:
            self.seen.data = {"number": self.seen.data["number"], "shown": [self._number]}

    def _trace(self) -> None:
        """Show the poles of the car that is looked at, and as each parameter varies."""
        if self._design is None or not self.plant.parameters:
            for cloud in (self.looked, *self.trails):
                cloud.data = _columns(np.zeros(0))
            return
        names = [p.name for p in self.plant.parameters]
        here = np.array([dict(self.state.values)[name] for name in names])
        for k, (trail, p) in enumerate(zip(self.trails, self.plant.parameters, strict=True)):
            along = np.linspace(float(p.low), float(p.high), 40)
            values = np.tile(here, (len(along), 1))
            values[:, k] = along
            trail.data = _columns(np.ravel(self._poles(values)))
        self.looked.data = _columns(np.ravel(self._poles(here[None])))

    def _poles(self, values: Array) -> Array:
        if self._design is None:
            return np.zeros(0, dtype=complex)
        return self._design.poles(weights_of(self.plant.parameters, values))

    def _dragged(self, _: str, __: Any, new: dict[str, Any]) -> None:
        """Move the handle that is held to where it was dragged."""
        if not len(new["number"]):
            return
        which, place = int(new["handle"][0]), complex(new["x"][0], new["y"][0])
        if new["begin"][0]:
            self._held = None  # the last end is lost where the pointer was released elsewhere
        if self._held is None and 0 <= which < len(self._handles):
            self._held = self._handles[which], self.state.region
        try:
            if self._held is not None:
                self._move(*self._held, place, bool(new["end"][0]))
        finally:  # without which the browser would ask no more
            self._number = int(new["number"][0])
            self.seen.data = {"number": [self._number], "shown": self.seen.data["shown"]}

    def _move(self, handle: Handle, region: Region, place: complex, end: bool) -> None:
        try:
            region = moved(region, handle, place)
        except RegionError:  # nothing there is a region: it stays as it is
            region = self.state.region
        self._moving = True
        try:
            self._drag(region, end)
        finally:
            self._moving = False
            self._held = None if end else self._held


def _columns(points: Array | Curve) -> dict[str, Array]:
    points = np.asarray(points, dtype=complex)
    return {"x": points.real.copy(), "y": points.imag.copy()}
