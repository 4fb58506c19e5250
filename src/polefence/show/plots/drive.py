"""Figures of signals over time, of one car under one law or several. Data to Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.plant.system import Array
from polefence.show.plots.plots import new_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure  # imported where used: it is slow to import

# Told apart in grey by shade, width and dashes; the second lies below the first.
STYLES: tuple[dict[str, Any], ...] = (
    {"color": "black", "ls": "-", "lw": 0.9, "zorder": 3},
    {"color": "#e08070", "ls": "-", "lw": 1.9, "zorder": 2},
    {"color": "#2166ac", "ls": "--", "lw": 1.2, "zorder": 3.1},
    {"color": "#1b7837", "ls": ":", "lw": 1.7, "zorder": 3.2},
    {"color": "#762a83", "ls": "-.", "lw": 1.2, "zorder": 3.3},
    {"color": "0.6", "ls": "--", "lw": 1.6, "zorder": 2.1},
)
COMMON: dict[str, Any] = {"color": "0.45", "ls": "-", "lw": 1.2, "zorder": 1.9}
BESIDE = ", demanded"  # of a curve that goes with another: its colour, dotted
DOTTED: dict[str, Any] = {"ls": (0, (1, 1.2)), "lw": 1.2, "zorder": 3.5}
POINTS = 1500  # pieces that a curve is drawn in, each with its least and its largest value
BLOWN_UP = 1e30  # no more a picture


@dataclass(frozen=True, eq=False)
class Panel:
    """One quantity over time.

    Attributes
    ----------
    label : str
        "name [unit]".
    curves : mapping of str to (time,) array
        By what the legend calls them, a law or one with `BESIDE`; "" for what is true of all,
        such as the road.
    """

    label: str
    curves: Mapping[str, Array]


def signals_figure(
    time: Array, panels: Sequence[Panel], title: str = "", outside: Any = None
) -> Figure:
    """Draw signals over time, a panel each, two panels a row.

    Parameters
    ----------
    time : (time,) array
        [s]
    panels : sequence of Panel
    outside : (time,) array of bool, optional
        Times to shade, at which the guarantee does not hold.
    """
    styles = _styles(panels)
    columns = 1 if len(panels) == 1 else 2
    rows = ceil(len(panels) / columns)
    figure, axes = new_grid(rows, columns, 5.2 * columns, 0.7 + 1.55 * rows, sharex=True)
    for ax, panel in zip(axes.flat, panels, strict=False):
        for name, values in panel.curves.items():
            ax.plot(*_drawn(time, values), label=name, **styles[name])
        if outside is not None and np.any(outside):
            _shade(ax, time, outside)
        ax.set_ylabel("\n".join(wrap(panel.label, 22)), fontsize=8.5)
        ax.margins(x=0)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    for ax in axes.flat[max(0, len(panels) - columns) : len(panels)]:
        ax.xaxis.set_tick_params(labelbottom=True)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    figure.align_ylabels(axes)
    if title:
        figure.suptitle(title, fontsize=9.5)
    mixed = any("" in p.curves and len(p.curves) > 1 for p in panels)
    _legend(figure, styles, mixed, outside)
    return figure


def _styles(panels: Sequence[Panel]) -> dict[str, dict[str, Any]]:
    names = list(dict.fromkeys(name for p in panels for name in p.curves if name))
    laws = list(dict.fromkeys(name.removesuffix(BESIDE) for name in names))
    own = {law: STYLES[k % len(STYLES)] for k, law in enumerate(laws)}
    found = {
        name: own[name.removesuffix(BESIDE)] | (DOTTED if name.endswith(BESIDE) else {})
        for name in names
    }
    return found | {"": COMMON}


def _legend(figure: Figure, styles: Mapping[str, Any], mixed: bool, outside: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shown = {name or "true": style for name, style in styles.items() if name or mixed}
    handles: list[Any] = [Line2D([], [], label=name, **style) for name, style in shown.items()]
    if outside is not None and np.any(outside):
        handles.append(Patch(facecolor="0.85", label="outside of what is proved"))
    if len(handles) > 1:
        columns = min(4, len(handles))
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=8.5)


def _shade(ax: Axes, time: Array, outside: Any) -> None:
    across = ax.get_xaxis_transform()
    where = np.asarray(outside, dtype=bool)
    # what is so at a single instant lasts until the next
    where = where | np.concatenate([[False], where[:-1]])
    ax.fill_between(time, 0, 1, where=where, transform=across, color="0.85", lw=0, zorder=0.5)


def _drawn(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a long record with the extremes of every piece only."""
    values = np.where(np.abs(values) < BLOWN_UP, values, np.nan)
    size = len(time) // POINTS
    if size < 3:
        return time, values
    whole = len(time) // size * size
    pieces = values[:whole].reshape(-1, size)
    ends = np.stack([pieces.argmin(axis=1), pieces.argmax(axis=1)], axis=1)
    k = (np.sort(ends, axis=1) + size * np.arange(len(pieces))[:, None]).ravel()
    k = np.concatenate([[0], k, np.arange(whole, len(time)), [len(time) - 1]])
    return time[k], values[k]
