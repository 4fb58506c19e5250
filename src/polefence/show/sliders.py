"""One plant of a family, chosen by sliders: its poles and responses, drawn over those of all.

What a page may show is computed before, at the points of a grid: the page asks no server, and its
script does nothing but put one of these curves in the place of another.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.readable import sample_text
from polefence.certify.design import Design
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter, simplex_weights
from polefence.plant.system import Array
from polefence.proof.text import visible
from polefence.response.linear import Response

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEPS = (33, 17, 9, 5, 3)  # of a slider, from few curves to many
MOST_PLANTS, MOST_CURVES = 250, 2500  # in a page: some 1.7 MB
UNITS, ACROSS = 4000, 125  # of a panel's width and height, and steps of a curve over it


@dataclass(frozen=True, eq=False)
class Grid:
    """Plants that sliders choose: every one of a grid over the box of the parameters."""

    plant: UncertainPlant
    steps: int

    @classmethod
    def of(cls, plant: UncertainPlant) -> Grid | None:
        """Return the finest grid that a page may have; None where there is none."""
        count = len(_chosen(plant))
        fine = [steps for steps in STEPS if steps**count <= MOST_PLANTS]
        return cls(plant, fine[0]) if count and fine else None

    @cached_property
    def values(self) -> list[Array]:
        """Values of each parameter, from its lowest to its highest."""
        ends = [(float(p.low), float(p.high)) for p in _chosen(self.plant)]
        return [np.linspace(*pair, self.steps) for pair in ends]

    @cached_property
    def alpha(self) -> Array:
        """Points of the family, the last parameter changing fastest."""
        names = [p.name for p in _chosen(self.plant)]
        rest = {p.name: 0.0 for p in self.plant.parameters if p.name not in names}
        every = product(*self.values)
        chosen = (rest | dict(zip(names, map(float, at), strict=True)) for at in every)
        weights = [simplex_weights(self.plant.parameters, one, False) for one in chosen]
        return np.array([[float(w) for w in row] for row in weights])

    @property
    def sliders(self) -> list[dict[str, Any]]:
        """What a page shows of each parameter."""
        pairs = zip(_chosen(self.plant), self.values, strict=True)
        return [{"name": _name(p), "texts": [_text(x, p) for x in own]} for p, own in pairs]


def _chosen(plant: UncertainPlant) -> list[Parameter]:
    """Return the parameters of the plant itself: what a dead time leaves out is zero."""
    return [p for p in plant.parameters if p.dead_time is None]


def _name(parameter: Parameter) -> str:
    return visible(f"{parameter.name} ({parameter.label})" if parameter.label else parameter.name)


def _text(value: float, parameter: Parameter) -> str:
    return visible(f"{sample_text(value)} {parameter.unit}".strip())


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes of a figure with what is drawn over them for each plant of a grid.

    Attributes
    ----------
    ax : matplotlib axes
        Where these are in the figure, and their limits, are read once the figure is rendered.
    dots : sequence of complex array, optional
    curves : (time, values) pair of (T,) and (count, T) array, optional
    """

    ax: Axes
    dots: Sequence[Array] = ()
    curves: tuple[Array, Array] | None = None

    @property
    def style(self) -> str:
        """Where it is over the picture."""
        box = self.ax.get_position()
        places = {"left": box.x0, "top": 1 - box.y1, "width": box.width, "height": box.height}
        return "; ".join(f"{name}: {100 * place:.3f}%" for name, place in places.items())

    @property
    def paths(self) -> list[str]:
        """Lines of an SVG of `UNITS` by `UNITS`, one for each plant."""
        if self.curves is None:
            return [self._dotted(poles) for poles in self.dots]
        time, values = self.curves
        low, high = self.ax.get_xlim()
        # responses are quick at first
        at = low + (high - low) * np.linspace(0, 1, ACROSS + 1) ** 2
        x = self._across(at)
        return [self._line(x, np.interp(at, time, row)) for row in values]

    def _dotted(self, poles: Array) -> str:
        x, y = self._across(np.real(poles)), self._down(np.imag(poles))
        seen = (x >= 0) & (x <= UNITS) & (y >= 0) & (y <= UNITS)
        return "".join(f"M{a} {b}h0" for a, b in zip(x[seen], y[seen], strict=True))

    def _line(self, x: Any, values: Array) -> str:
        y = np.clip(self._down(values), -UNITS, 2 * UNITS)
        steps = (f"{a} {b}" for a, b in zip(np.diff(x).tolist(), np.diff(y).tolist(), strict=True))
        return f"M{x[0]} {y[0]}l{' '.join(steps)}"

    def _across(self, x: Array) -> Any:
        low, high = self.ax.get_xlim()
        return np.rint(UNITS * (x - low) / (high - low)).astype(int)

    def _down(self, y: Array) -> Any:
        low, high = self.ax.get_ylim()
        return np.rint(UNITS * (high - y) / (high - low)).astype(int)


def of_poles(grid: Grid | None, design: Design, axes: Sequence[Axes]) -> tuple[Panel, ...]:
    """Return the panels of a figure of poles."""
    if grid is None:
        return ()
    poles = list(design.poles(grid.alpha))
    return tuple(Panel(ax, poles) for ax in axes)


def of_responses(response: Response, axes: Sequence[Axes]) -> tuple[Panel, ...]:
    """Return the panels of a figure of responses, which are those of a grid: the first signals."""
    time, values = response.time, response.values
    if response.plant.sample_time is not None:  # held from one sample to the next
        time, values = np.repeat(time, 2)[1:], np.repeat(values, 2, axis=1)[:, :-1]
    # of an odd number the last panel is empty
    shown = axes[: min(values.shape[2], MOST_CURVES // len(values))]
    return tuple(Panel(ax, curves=(time, values[:, :, i])) for i, ax in enumerate(shown))


def script() -> str:
    """Return the only script that a page runs."""
    return (files("polefence.show") / "templates" / "sliders.js").read_text(encoding="utf-8")


def script_digest() -> str:
    """Return what a page's own policy knows that script by."""
    return base64.b64encode(hashlib.sha256(script().encode()).digest()).decode()


def data_text(grid: Grid, panels: Sequence[Panel]) -> str:
    """Return all that the script reads, which leaves no element of a page."""
    table = {"sliders": grid.sliders, "panels": [panel.paths for panel in panels]}
    return json.dumps(table, separators=(",", ":")).replace("<", "\\u003c")
