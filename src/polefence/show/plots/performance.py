"""Figure of proved bounds beside sampled values. Data in, Figure out; touches no file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from polefence.plant.system import Array
from polefence.show.plots.plots import new_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Told apart in grey: filled and dark, open and light.
OWN: dict[str, Any] = {"color": "#2166ac", "marker": ".", "ms": 2.2, "ls": "", "mew": 0}
PASSIVE: dict[str, Any] = {"color": "0.65", "marker": ".", "ms": 2.2, "ls": "", "mew": 0}
BOUND: dict[str, Any] = {"color": "black", "ls": "--", "lw": 1.4}
SHOWN = 2000  # points of each cloud


@dataclass(frozen=True, eq=False)
class Panel:
    """One specification.

    Attributes
    ----------
    label : str
        Of the vertical axis, with its unit.
    bound : float
        What is proved.
    values : (count,) array
        At the sampled parameters.
    passive : (count,) array, optional
        Without control.
    """

    label: str
    bound: float
    values: Array
    passive: Array | None = None


def bounds_figure(x: Array, x_label: str, panels: Sequence[Panel]) -> Figure:
    """Draw sampled values over one parameter, and the proved bound above them; a panel each.

    Parameters
    ----------
    x : (count,) array
        The parameter's values.
    x_label : str
        Its name and unit.
    panels : sequence of Panel
    """
    columns = min(2, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure, axes = new_grid(rows, columns, 0.6 + 4.3 * columns, 0.7 + 2.5 * rows, sharex=True)
    every = max(1, len(x) // SHOWN)
    for k, (ax, panel) in enumerate(zip(axes.flat, panels, strict=False)):
        if panel.passive is not None and panel.passive.any():
            ax.plot(x[::every], panel.passive[::every], **PASSIVE)
        ax.plot(x[::every], panel.values[::every], **OWN)
        ax.axhline(panel.bound, **BOUND)
        ax.set_ylabel(panel.label)
        ax.set_ylim(bottom=0, top=1.08 * max(ax.get_ylim()[1] / 1.05, panel.bound))
        if k >= len(panels) - columns:
            ax.set_xlabel(x_label)
            ax.xaxis.set_tick_params(labelbottom=True)
    for ax in list(axes.flat)[len(panels) :]:
        ax.set_axis_off()
    figure.legend(handles=_handles(panels), loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def _handles(panels: Sequence[Panel]) -> list[Any]:
    from matplotlib.lines import Line2D

    large = {"ms": 8}
    found = [
        Line2D([], [], label="proved for all parameters", **BOUND),
        Line2D([], [], label="with the law, sampled", **{**OWN, **large}),
    ]
    if any(panel.passive is not None and panel.passive.any() for panel in panels):
        found.append(Line2D([], [], label="without control, sampled", **{**PASSIVE, **large}))
    return found
