"""The car on its road: animated, with a passive one as its ghost, and what both ride like."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, CustomJS, Legend, Slider, Span, Toggle

from polefence.certify.design import Design
from polefence.plant import cars
from polefence.plant.dampers import Damper
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.proof.text import visible
from polefence.studio.palette import Palette, coloured, small_figure
from polefence.studio.rides import Motion, ridden, seats_of, under, wheels_of
from polefence.studio.scene import BODY, LARGER, NARROW, RADIUS, Scene
from polefence.studio.state import State
from polefence.studio.templates import template

BEFORE, SPACING = 12.0, 0.02  # [m] of level road that is drawn before it begins; of its points
DASHES = ("solid", "dashed", "dotted", "dotdash")
PASSIVE, LAW = "passive", "with this law"


class Car:
    """The pane of a car.

    Parameters
    ----------
    plant : UncertainPlant
    car : polefence.plant.cars.Car or None
        What the plant is where it has several wheels; None for a quarter car.
    palette : Palette
    dampers : tuple of Damper
        Controllable ones, that give what a law demands of them.
    """

    def __init__(
        self,
        plant: UncertainPlant,
        car: cars.Car | None,
        palette: Palette,
        dampers: tuple[Damper, ...] = (),
    ) -> None:
        self.plant, self.car, self._palette, self._dampers = plant, car, palette, dampers
        self.roads = tuple(ColumnDataSource({"height": []}) for _ in range(2))
        loads = 3 if plant.parameters else 1
        self.scenes = [Scene(car, self.roads, palette) for _ in range(loads)]
        self.looked = self.scenes[loads // 2]
        self.cursor = ColumnDataSource({"x": []})
        self.limits = ColumnDataSource({"x": [], "y": []})
        self.traces = self._traces()
        self.play = Toggle(label="Play", width=90)
        self.at = Slider(
            title="time [s]", start=0, end=1, step=0.02, value=0, sizing_mode="stretch_width"
        )
        self._shown = row(self.looked.view, sizing_mode="stretch_width")
        self._animated()

    @property
    def views(self) -> tuple[Any, Any]:
        """The car with its buttons, and its signals over time."""
        buttons = row(self.play, self.at, sizing_mode="stretch_width")
        car = column(self._shown, buttons, sizing_mode="stretch_width")
        return car, column(*self.traces, sizing_mode="stretch_width")

    def show(self, design: Design | None, state: State) -> tuple[tuple[str, str], ...]:
        """Drive the car of a state, with a law and without; return who rides how, in words."""
        loads = self._loads(state)
        shown = self.scenes if len(loads) > 1 else [self.looked]
        rides = [self._driven(design, values, state) for _, values in loads]
        self._arranged(shown, state, float(rides[0][0].time[-1]))
        for scene, (title, _) in zip(shown, loads, strict=True):
            scene.entitle(title, len(loads))
        self.traces[0].title.text = visible(loads[len(loads) // 2][0])
        self._put(dict(zip(shown, rides, strict=True)), state.speed)
        pairs = zip(loads, rides, strict=True)
        return tuple(line for (title, _), both in pairs for line in self._said(title, both))

    def clear(self) -> None:
        """Show no car."""
        self._put({}, 0.0)

    def _loads(self, state: State) -> list[tuple[str, dict[str, float]]]:
        """Return title and values of each car that is shown, the one looked at in the middle."""
        values = dict(state.values)
        if not state.beside or not self.plant.parameters:
            return [("", values)]
        first = self.plant.parameters[0]
        three = (float(first.low), values[first.name], float(first.high))
        return [(_title(first, value), values | {first.name: value}) for value in three]

    def _driven(
        self, design: Design | None, values: dict[str, float], state: State
    ) -> tuple[Motion, Motion | None]:
        drive = (values, state.road, state.speed, state.travel_limit, self._dampers)
        passive = ridden(self.plant, self.car, None, *drive)
        return passive, None if design is None else ridden(self.plant, self.car, design, *drive)

    def _arranged(self, shown: list[Scene], state: State, end: float) -> None:
        """Have these scenes beside each other, on the roads of a state."""
        if len(self._shown.children) != len(shown):
            self._shown.children = [scene.view for scene in shown]
        self.at.update(end=end, value=min(self.at.value, end))
        limit = 1e3 * state.travel_limit
        ends = [0.0, end, np.nan, 0.0, end]
        self.limits.data = {"x": ends, "y": [limit, limit, np.nan, -limit, -limit]}
        if not limit:
            self.limits.data = {"x": [], "y": []}
        for source, road in zip(self.roads, under(self.car, state.road, state.speed), strict=True):
            along = np.arange(-BEFORE, road.length, SPACING)
            height = np.interp(along + road.distance[0], road.distance, road.height)
            source.data = {"height": np.float32(height - road.height[0])}

    def _put(self, motions: dict[Scene, tuple[Motion, Motion | None]], speed: float) -> None:
        """Have motions in the scenes; the one looked at comes last, at which all are drawn."""
        for scene in sorted(self.scenes, key=lambda scene: scene is self.looked):
            passive, law = motions.get(scene, (None, None))
            scene.show(passive, law, speed)

    def _said(self, title: str, both: tuple[Motion, Motion | None]) -> list[tuple[str, str]]:
        """Say how a car rides, without a law and with it, at each seat."""
        texts = []
        for who, ride in zip((PASSIVE, LAW), both, strict=True):
            for felt, passive in () if ride is None else zip(ride.felt, both[0].felt, strict=True):
                seat = "" if self.car is None else visible(felt.name)
                beside = "" if who == PASSIVE else felt.beside(passive)
                said = "; ".join(filter(None, (felt.text, beside)))
                texts.append((", ".join(filter(None, (title, who, seat))), said))
        return texts

    def _traces(self) -> list[Any]:
        wheels = [visible(name) for name in wheels_of(self.car)[0]]
        seats = [visible(name) for name in seats_of(self.car)][:3]
        felt = seats[0] if len(seats) == 1 else "acceleration"
        plots = [
            self._trace("felt", f"{felt} [m/s²]", seats),
            self._trace("travel", "travel [mm]", wheels),
            self._trace("tyre", "tyre [N]", wheels),
        ]
        _, travel, tyre = plots
        for plot in plots[:-1]:  # one axis of time is enough
            plot.xaxis.visible = False
            plot.height -= 20
        colour = self._palette.looked
        travel.line("x", "y", source=self.limits, color=colour, line_dash="dashed")
        tyre.add_layout(Span(location=0, line_color=colour, line_dash="dotted"))
        return plots

    def _trace(self, key: str, label: str, names: list[str]) -> Any:
        """Draw a signal over time: of each wheel or seat with a law, and grey without."""
        # [px] for one wheel, for several
        plot = small_figure(key, height=110 if len(names) == 1 else 160)
        plot.yaxis.axis_label = label
        plot.title.text_color = self._palette.ink
        plot.yaxis.axis_label_text_font_size = "10px"
        colour, lines = self._palette, []
        shades = (colour.cars, *colour.trails[1:])
        for who, columns in reversed(self.looked.frames.items()):
            for i, name in enumerate(names):
                style: dict[str, Any] = {"color": colour.ghost, "line_dash": "dashed"}
                if who == "law":
                    dash = DASHES[(i + i // len(shades)) % len(DASHES)]
                    style = {"color": shades[i % len(shades)], "line_dash": dash}
                elif len(names) > 1:
                    # several wheels' ghosts are faint
                    style |= {"line_alpha": 0.6}
                style["line_width"] = 1.5
                # a legend shows no line that has no points when it is drawn
                both = [
                    plot.line("time", f"{key} {i}", source=columns, **style),
                    _unseen(plot, style),
                ]
                lines.append((who, name, both))
        plot.vspan("x", source=self.cursor, color=colour.looked)
        if len(names) > 1 or key == "felt":
            _explain(plot, lines, len(names))
        coloured(plot, colour)
        return plot

    def _animated(self) -> None:
        """Have the browser draw one frame after the other, by itself."""
        models: dict[str, Any] = {
            "cars": [scene.models for scene in self.scenes],
            "looked": self.looked.models,
        }
        models |= {"cursor": self.cursor, "play": self.play, "at": self.at}
        models |= {"larger": LARGER, "spacing": SPACING, "before": BEFORE}
        models |= {"body": BODY, "radius": RADIUS, "narrow": NARROW}
        code = template("riding.js")
        callbacks = {
            what: CustomJS(args=models | {"what": what}, code=code) for what in ("play", "draw")
        }
        self.play.js_on_change("active", callbacks["play"])
        self.at.js_on_change("value", callbacks["draw"])
        self.looked.frames["passive"].js_on_change("data", callbacks["draw"])


def _title(first: Parameter, value: float) -> str:
    return f"{first.name} = {value:.4g} {first.unit}".rstrip()


def _unseen(plot: Any, style: dict[str, Any]) -> Any:
    """Return a line of this style that is nowhere."""
    return plot.line([np.nan, np.nan], [np.nan, np.nan], **style)


def _explain(plot: Any, lines: list[tuple[str, str, list[Any]]], many: int) -> None:
    """Say above a plot what its lines are; a click on a word hides them."""
    ghosts = [line for who, _, its_lines in lines for line in its_lines if who == PASSIVE]
    items: list[Any] = [(PASSIVE, ghosts)]
    items += [
        (LAW if many == 1 else name, its_lines) for who, name, its_lines in lines if who != PASSIVE
    ]
    legend = Legend(items=items, orientation="horizontal", click_policy="hide", padding=2, margin=2)
    legend.label_text_font_size = "11px"
    plot.add_layout(legend, "above")
    plot.height += 30  # [px] a legend
