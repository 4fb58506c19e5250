"""What is drawn of one car on its road: its wheels, from one side or from both, or from behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, Legend, Range1d
from bokeh.plotting import figure

from polefence.plant.cars import Car
from polefence.plant.system import Array
from polefence.proof.text import visible
from polefence.studio.palette import Palette, coloured
from polefence.studio.rides import Motion, seats_of, wheels_of

LARGER = 5.0  # heights are drawn so many times as large
BODY, RADIUS, NARROW = 1.3, 0.3, 0.11  # heights of what is drawn; a wheel from behind
BOTTOM, TOP, WIDE = -0.5, 2.2, 600  # of the picture [m], [m], pixels
AXIS, LINE = 45, 25  # what else there is, title and legend a line each: pixels
SIGNALS = ("unsprung", "sprung", "travel", "tyre", "force", "lifted", "stopped", "road", "twist")


@dataclass(frozen=True)
class Side:
    """Wheels of a car that are seen together.

    Attributes
    ----------
    title : str
    wheels : tuple of int
        Their numbers, from left to right.
    at : tuple of float
        Where each is drawn [m].
    ends : tuple of two (x, y)
        Of the body.
    along : bool
        Whether the road lies along the picture; else it is seen from behind.
    """

    title: str
    wheels: tuple[int, ...]
    at: tuple[float, ...]
    ends: tuple[tuple[float, float], tuple[float, float]]
    along: bool

    @property
    def span(self) -> tuple[float, float]:
        """What is seen [m]."""
        # [m] of road either way of the wheels: 2, or 1 behind the last of several
        more = max(2.0 - (self.at[-1] - self.at[0]) / 2, 1.0)
        return self.at[0] - more, self.at[-1] + more


def sides_of(places: Array) -> tuple[Side, ...]:
    """Return how a car is seen: from its side, of wheels left and right from both; or from behind.

    Parameters
    ----------
    places : (wheels, 2) array
        Ahead and to the left [m].
    """
    x, y = places.T
    left = y > 0
    if np.ptp(x) == 0 and np.ptp(y) > 0:
        return (_side("from behind", np.arange(len(y)), -y, x[0], along=False),)
    if left.all() or not left.any():
        return (_side("", np.arange(len(x)), x, y.mean(), along=True),)
    pair = (("left", np.flatnonzero(left)), ("right", np.flatnonzero(~left)))
    return tuple(
        _side(title, wheels, x[wheels], y[wheels].mean(), along=True) for title, wheels in pair
    )


def _side(title: str, wheels: Any, at: Array, aside: float, along: bool) -> Side:
    order = np.argsort(at)
    at = at[order]
    # [m] of the body either way of its wheels
    first, last = float(at[0]) - 0.7, float(at[-1]) + 0.7
    aside = float(aside)
    ends = ((first, aside), (last, aside)) if along else ((aside, -first), (aside, -last))
    return Side(title, tuple(map(int, wheels[order])), tuple(map(float, at)), ends, along)


class Scene:
    """One car with a law and without.

    Parameters
    ----------
    car : Car, optional
        None: a quarter car.
    roads : two ColumnDataSource
        Heights on the left and on the right.
    palette : Palette
    """

    def __init__(
        self, car: Car | None, roads: Sequence[ColumnDataSource], palette: Palette
    ) -> None:
        self._names, self._places = wheels_of(car)
        self._roads, self._palette = roads, palette
        self.sides = sides_of(self._places)
        self.frames = {who: ColumnDataSource({}) for who in ("law", "passive")}
        self.drawn = [
            {
                name: ColumnDataSource({"x": [], "y": []})
                for name in ("ground", "passive", "law", "spring", "force", "lift", "hit")
            }
            | {"words": ColumnDataSource({"x": [], "y": [], "text": [], "align": []})}
            for _ in self.sides
        ]
        self._keys = (
            "time",
            "place",
            *(f"{key} {i}" for key in SIGNALS for i in range(len(self._names))),
            *(f"end {j} {i}" for j in range(len(self.sides)) for i in range(2)),
            *(f"felt {i}" for i in range(len(seats_of(car)))),
        )
        self.figures = [self._figure(*panel) for panel in zip(self.sides, self.drawn, strict=True)]
        self.entitle("", 1)
        self.show(None, None, 0.0)

    @property
    def view(self) -> Any:
        """All its pictures, one above the other."""
        return column(*self.figures, sizing_mode="stretch_width")

    @property
    def models(self) -> dict[str, Any]:
        """What the browser draws it with."""
        views = [
            drawn
            | {
                "road": self._roads[0 if side.ends[0][1] > 0 else 1],
                "wheels": side.wheels,
                "at": side.at,
                "span": side.span,
                "names": [visible(self._names[i]) or "force" for i in side.wheels],
                "along": side.along,
            }
            for side, drawn in zip(self.sides, self.drawn, strict=True)
        ]
        return {**self.frames, "views": views, "foremost": float(self._places[:, 0].max())}

    def show(self, passive: Motion | None, law: Motion | None, speed: float) -> None:
        """Have other motions; the passive one last, at which it is drawn."""
        for who, motion in (("law", law), ("passive", passive)):
            self.frames[who].data = self._columns(motion, speed)

    def entitle(self, title: str, of: int) -> None:
        """Say which car it is, of so many beside each other; one alone has a legend."""
        for side, plot in zip(self.sides, self.figures, strict=True):
            plot.title.text = ", ".join(filter(None, (visible(title), side.title)))
            outside = LINE if plot.title.text else 0
            if side is self.sides[-1]:
                plot.legend.visible = of == 1
                outside += AXIS + (LINE if of == 1 else 0)
            low, high = side.span
            if of > 1:  # texts stay as high where the picture is smaller
                outside *= 2
            plot.height = round(WIDE * (TOP - BOTTOM) / (high - low)) + outside

    def _columns(self, motion: Motion | None, speed: float) -> dict[str, Any]:
        """Return a motion by columns: of each wheel, each end of the body, and each seat."""
        if motion is None:
            return dict.fromkeys(self._keys, np.zeros(0))
        # travel in mm
        wheels = [
            np.asarray(getattr(motion, key), float) * (1e3 if key == "travel" else 1.0)
            for key in SIGNALS
        ]
        ends = [motion.height(*end) for side in self.sides for end in side.ends]
        felt = [one.acceleration for one in motion.felt]
        rows = [*(row for values in wheels for row in values.T), *ends, *felt]
        rows = [motion.time, speed * motion.time, *rows]
        # half as much to be sent, and far more digits than are seen
        return {key: np.float32(row) for key, row in zip(self._keys, rows, strict=True)}

    def _figure(self, side: Side, drawn: dict[str, ColumnDataSource]) -> Any:
        plot = figure(
            name="car",
            tools="",
            toolbar_location=None,
            sizing_mode="scale_width",
            width=WIDE,
            x_range=Range1d(*side.span),
            y_range=Range1d(BOTTOM, TOP),
            min_width=200,
        )
        plot.xaxis.axis_label = "along the road [m]" if side.along else "to the right [m]"
        plot.xaxis.visible = last = side is self.sides[-1]
        plot.xaxis.ticker.desired_num_ticks = 5
        plot.yaxis.visible = False
        plot.grid.visible = False
        colour = self._palette
        lines = self._lines(plot, drawn)
        if last:
            plot.add_layout(Legend(items=lines, orientation="horizontal", padding=2), "below")
        for name, marker in (("lift", "inverted_triangle"), ("hit", "circle")):
            marks = {"source": drawn[name], "marker": marker, "size": 18}
            plot.scatter("x", "y", color=colour.looked, **marks)
        style = {"text_color": colour.ink, "text_font_size": "12px", "text_align": "align"}
        plot.text("x", "y", "text", source=drawn["words"], text_baseline="top", **style)
        coloured(plot, colour)
        plot.title.text_color = colour.ink
        return plot

    def _lines(self, plot: Any, drawn: dict[str, ColumnDataSource]) -> list[tuple[str, list[Any]]]:
        """Draw what moves; return what a legend says of it."""
        colour, legend = self._palette, []
        plot.line("x", "y", source=drawn["ground"], color=colour.ink, line_width=2)
        plot.line("x", "y", source=drawn["spring"], color=colour.cars, line_width=1.5)
        for who, label, shade, dash, wide in (
            ("passive", "passive", colour.ghost, "dashed", 2),
            ("law", "with this law", colour.cars, "solid", 2),
            ("force", "actuator force", colour.looked, "solid", 5),
        ):
            style = {"color": shade, "line_width": wide, "line_dash": dash}
            line = plot.line("x", "y", source=drawn[who], name=who, **style)
            legend.append((label, [line]))
        return legend
