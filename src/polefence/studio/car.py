"""The car on its road: animated, with a passive one as its ghost, and what both ride like."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, CustomJS, Range1d, Slider, Span, Toggle
from bokeh.plotting import figure

from polefence.design.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.studio.palette import Palette, coloured
from polefence.studio.rides import Motion, ridden
from polefence.studio.state import State
from polefence.studio.templates import template

LARGER = 5.0  # heights are drawn so many times as large
AHEAD = 2.0  # [m] of road either way
SPACING = 0.02  # [m] between points of the road that are drawn
SIGNALS = (
    ("acceleration", "body [m/s²]", 1.0),
    ("travel", "travel [mm]", 1e3),
    ("tyre", "tyre [N]", 1.0),
)
BODY, RADIUS = 1.3, 0.3  # heights of what is drawn
BOTTOM, TOP, WIDE, AXIS = -0.5, 2.2, 600, 50  # of the picture [m], [m], pixels, pixels
AWAY = [-99, -98]  # where what a legend explains is not seen


class Car:
    """The pane of a quarter car.

    Parameters
    ----------
    plant : UncertainPlant
    palette : Palette
    """

    def __init__(self, plant: UncertainPlant, palette: Palette) -> None:
        self.plant, self._palette = plant, palette
        self.frames = {who: ColumnDataSource(_frames(None, 0.0)) for who in ("law", "passive")}
        self.road = ColumnDataSource({"distance": [0.0, 1.0], "height": [0.0, 0.0]})
        self.drawn = {
            name: ColumnDataSource({"x": [], "y": []})
            for name in ("ground", "law", "passive", "spring", "force", "cursor", "lift")
        }
        self.words = ColumnDataSource({"x": [], "y": [], "text": []})
        self.traces = [self._trace(*own) for own in SIGNALS]
        self.scene = self._scene()
        self.play = Toggle(label="Play", width=90)
        self.at = Slider(
            title="time [s]", start=0, end=1, step=0.02, value=0, sizing_mode="stretch_width"
        )
        self._animated()

    @property
    def views(self) -> tuple[Any, Any]:
        """The car with its buttons, and its signals over time."""
        car = column(self.scene, self.play, self.at, sizing_mode="stretch_width")
        return car, column(*self.traces, sizing_mode="stretch_width")

    def show(self, design: Design | None, state: State) -> tuple[Motion | None, Motion]:
        """Drive the car of a state, with a law and without; return both."""
        values = dict(state.values)
        passive, distance, height = ridden(self.plant, None, values, state.road, state.speed)
        law = None
        if design is not None:
            law = ridden(self.plant, design, values, state.road, state.speed)[0]
        along = np.arange(-AHEAD, distance[-1], SPACING)
        self.at.update(end=float(passive.time[-1]), value=min(self.at.value, passive.time[-1]))
        self.road.data = {"distance": along, "height": np.interp(along, distance, height)}
        for who, own in (("law", law), ("passive", passive)):
            self.frames[who].data = _frames(own, state.speed)
        return law, passive

    def clear(self) -> None:
        """Show no car."""
        for own in (
            *self.frames.values(),
            *(self.drawn[who] for who in ("law", "spring", "force")),
        ):
            own.data = {key: [] for key in own.data}

    def _scene(self) -> Any:
        plot = self._plot(
            "car",
            sizing_mode="scale_width",
            width=WIDE,
            height=round(WIDE * (TOP - BOTTOM) / (2 * AHEAD)) + AXIS,
            x_range=Range1d(-AHEAD, AHEAD),
            y_range=Range1d(BOTTOM, TOP),
        )
        colour = self._palette
        plot.xaxis.axis_label = "along the road [m]"
        plot.yaxis.visible = False
        plot.grid.visible = False
        plot.line("x", "y", source=self.drawn["ground"], color=colour.ink, line_width=2)
        for who, label, shade, dash in (
            ("passive", "passive", colour.ghost, "dashed"),
            ("law", "with this law", colour.cars, "solid"),
        ):
            style = {"color": shade, "line_width": 2, "line_dash": dash}
            plot.line("x", "y", source=self.drawn[who], name=who, **style)
            plot.line(AWAY, AWAY, legend_label=label, **style)
        plot.line("x", "y", source=self.drawn["spring"], color=colour.cars, line_width=1.5)
        style = {"color": colour.looked, "line_width": 5}
        plot.line("x", "y", source=self.drawn["force"], **style)
        plot.line(AWAY, AWAY, legend_label="actuator force", **style)
        marks = {"source": self.drawn["lift"], "size": 22, "color": colour.looked}
        plot.scatter("x", "y", marker="inverted_triangle", **marks)
        plot.text("x", "y", "text", source=self.words, text_color=colour.ink, text_font_size="13px")
        plot.legend.location = "top_right"
        coloured(plot, colour)
        return plot

    def _trace(self, key: str, label: str, _: float) -> Any:
        plot = self._plot(key, height=130, sizing_mode="stretch_width")
        plot.yaxis.axis_label = label
        plot.yaxis.axis_label_text_font_size = "10px"
        colour = self._palette
        own = self.frames
        plot.line("time", key, source=own["passive"], color=colour.ghost, line_dash="dashed")
        plot.line("time", key, source=own["law"], color=colour.cars, line_width=1.5)
        if key == "tyre":
            plot.add_layout(Span(location=0, line_color=colour.looked, line_dash="dotted"))
        marks = {"source": self.drawn["cursor"], "color": colour.looked, "size": 9}
        plot.scatter("x", key, marker="triangle", **marks)
        coloured(plot, colour)
        return plot

    def _plot(self, name: str, **options: Any) -> Any:
        shared = {"min_width": 280, "tools": "", "toolbar_location": None, "name": name}
        return figure(**(shared | options))

    def _animated(self) -> None:
        """Have the browser draw one frame after the other, by itself."""
        self.drawn["cursor"].data = {"x": [], **{key: [] for key, _, _ in SIGNALS}}
        models = {"law": self.frames["law"], "passive": self.frames["passive"], "road": self.road}
        models |= {"drawn": self.drawn, "words": self.words, "play": self.play, "at": self.at}
        models |= {"larger": LARGER, "ahead": AHEAD, "spacing": SPACING}
        models |= {"body": BODY, "radius": RADIUS}
        code = template("riding.js")
        own = {what: CustomJS(args=models | {"what": what}, code=code) for what in ("play", "draw")}
        self.play.js_on_change("active", own["play"])
        self.at.js_on_change("value", own["draw"])
        self.frames["passive"].js_on_change("data", own["draw"])


def _frames(own: Motion | None, speed: float) -> dict[str, Array]:
    keys = ("time", "unsprung", "sprung", "force", "lifted", *(key for key, _, _ in SIGNALS))
    if own is None:  # two instants at which nothing moves
        return {key: np.zeros(2) for key in (*keys, "place")} | {"time": np.array([0.0, 1.0])}
    scales = {key: scale for key, _, scale in SIGNALS}
    found = {key: np.asarray(getattr(own, key), float) * scales.get(key, 1.0) for key in keys}
    return found | {"place": speed * own.time}
