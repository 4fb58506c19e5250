"""Figures of signals over time, of one car or many, over frequency and by thirds of octaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.plant.outputs import Signal
from polefence.plant.system import Array
from polefence.response.linear import Frequency, Response
from polefence.show.plots.plots import new_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
PIECES = 1500  # pieces that a curve is drawn in, each with its least and its largest value
BLOWN_UP = 1e30  # no more a picture

# Many curves, drawn one over the other; those of the vertices stand out, in grey too.
MANY: dict[str, Any] = {"color": "0.72", "lw": 0.5, "zorder": 1}
VERTEX: dict[str, Any] = {"color": "#b2182b", "lw": 1.1, "zorder": 2}
CURVES = 120  # drawn of the many
POINTS = 800  # drawn of each


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
    size = len(time) // PIECES
    if size < 3:
        return time, values
    whole = len(time) // size * size
    pieces = values[:whole].reshape(-1, size)
    ends = np.stack([pieces.argmin(axis=1), pieces.argmax(axis=1)], axis=1)
    k = (np.sort(ends, axis=1) + size * np.arange(len(pieces))[:, None]).ravel()
    k = np.concatenate([[0], k, np.arange(whole, len(time)), [len(time) - 1]])
    return time[k], values[k]


def responses_figure(
    columns: Mapping[str, Response], mark: float | None = None, until: float | None = None
) -> Figure:
    """Draw signals over time, a row each; one column a response, or two for one alone.

    Parameters
    ----------
    columns : mapping
        Title to response, all of the same signals.
    mark : float, optional
        A time to mark [s].
    until : float, optional
        The last time that is shown [s].
    """
    first = next(iter(columns.values()))
    if len(columns) == 1:
        figure, panels = _pairs(len(first.signals))
        axes = panels[:, None]
    else:
        figure, axes = _grid(first.signals, len(columns), sharey="row")
    for column, (title, response) in zip(axes.T, columns.items(), strict=True):
        shown = response.time <= (response.time[-1] if until is None else until)
        every = max(1, int(shown.sum()) // POINTS)
        time = response.time[shown][::every]
        for i, (ax, signal) in enumerate(zip(column, response.signals, strict=True)):
            _curves(ax, time, response.values[:, shown, i][:, ::every], response.alpha)
            if mark is not None:
                ax.axvline(mark, color="0.2", lw=0.8, ls="--")
            if ax is axes[i, 0]:
                ax.set_ylabel(_folded(signal))
        if len(columns) > 1:
            column[0].set_title(title)
        for ax in column[-2:] if len(columns) == 1 else column[-1:]:
            ax.set_xlabel("time [s]")
            ax.xaxis.set_tick_params(labelbottom=True)
            ax.set_xlim(0, time[-1])
    handles = _handles() if mark is None else [*_handles(), _line("--", f"{mark:g} s")]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def frequency_figure(columns: Mapping[str, Frequency]) -> Figure:
    """Draw magnitudes from the first source to each signal; one column a family."""
    first = next(iter(columns.values()))
    figure, axes = _grid(first.signals, len(columns), sharey="row")
    for column, (title, found) in zip(axes.T, columns.items(), strict=True):
        for i, (ax, signal) in enumerate(zip(column, found.signals, strict=True)):
            ax.set_xscale("log")
            ax.set_yscale("log")
            _curves(ax, found.frequency, np.abs(found.gain[:, :, i, 0]), found.alpha)
            if ax is axes[i, 0]:
                ax.set_ylabel(_folded(signal, found.sources[0].unit))
        column[0].set_title(title)
        column[-1].set_xlabel(f"frequency of {found.sources[0].name} [Hz]")
        column[-1].set_xlim(found.frequency[0], found.frequency[-1])
    figure.legend(handles=_handles(), loc="outside lower center", ncols=2, fontsize=8.5)
    return figure


def bands_figure(
    columns: Mapping[str, Mapping[str, Sequence[Array]]],
    frequencies: Sequence[Array],
    boundary: Array | None = None,
) -> Figure:
    """Draw rms by one-third octaves, least and greatest over the family; one row a set of bands.

    Parameters
    ----------
    columns : mapping
        Title to law's label to arrays (count, bands), one for each set of bands; at most two laws.
    frequencies : sequence of (bands,) array
        Nominal centres [Hz] of each set.
    boundary : (bands,) array, optional
        Drawn beside the last set [m/s2].
    """
    figure, axes = new_grid(
        len(frequencies), len(columns), 1.0 + 4.2 * len(columns), 5.6, sharey="row", sharex="row"
    )
    looks: tuple[dict[str, Any], ...] = (
        {"color": "black", "hatch": "", "ls": "-"},
        {"color": "#2166ac", "hatch": "//", "ls": "--"},
    )
    for column, (title, laws) in zip(axes.T, columns.items(), strict=True):
        for k, (ax, frequency) in enumerate(zip(column, frequencies, strict=True)):
            for look, (label, sets) in zip(looks, laws.items(), strict=False):
                low, high = sets[k].min(axis=0), sets[k].max(axis=0)
                ax.fill_between(frequency, low, high, fc=look["color"], alpha=0.18, lw=0)
                ax.plot(frequency, high, color=look["color"], ls=look["ls"], lw=1.3, label=label)
                ax.plot(frequency, low, color=look["color"], ls=look["ls"], lw=0.6)
            if boundary is not None and frequency is frequencies[-1]:
                ax.plot(
                    frequency, boundary, color="#b2182b", ls=":", lw=2, label="severe discomfort"
                )
            ax.set_xscale("log")
            ax.set_yscale("log")
            ticks = frequency[:: 3 if len(frequency) > 12 else 1]
            ax.set_xticks(ticks, [f"{f:g}" for f in ticks])
            ax.minorticks_off()
            ax.set_xlabel("centre of the one-third octave [Hz]")
            if ax is axes[k, 0]:
                ax.set_ylabel("weighted rms in the band [m/s²]")
        column[0].set_title(title)
    handles, labels = axes[-1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def _grid(signals: Sequence[Signal], columns: int, **options: Any) -> tuple[Figure, Any]:
    return new_grid(
        len(signals),
        columns,
        1.2 + 3.9 * columns,
        0.8 + 1.35 * len(signals),
        sharex=True,
        **options,
    )


def _pairs(count: int) -> tuple[Figure, Any]:
    """Return panels two in a row, as one list."""
    rows, columns = (count + 1) // 2, min(count, 2)
    figure, axes = new_grid(rows, columns, 1.0 + 4.2 * columns, 0.8 + 1.5 * rows, sharex=True)
    for ax in axes.ravel()[count:]:
        ax.set_axis_off()
    return figure, axes.ravel()[:count]


def _curves(ax: Axes, x: Array, rows: Array, alpha: Array) -> None:
    """Draw some of the rows, and over them those of the vertices."""
    from matplotlib.collections import LineCollection

    vertices = np.flatnonzero(alpha.max(axis=1) == 1)
    others = np.setdiff1d(np.arange(len(rows)), vertices)
    others = others[:: max(1, len(others) // CURVES)]
    lines = [np.column_stack([x, row]) for row in rows[others]]
    ax.add_collection(LineCollection(lines, rasterized=True, **MANY), autolim=True)
    for row in rows[vertices]:
        ax.plot(x, row, **VERTEX)
    ax.autoscale_view()


def _handles() -> list[Any]:
    from matplotlib.lines import Line2D

    named = ((MANY, "points of the family"), (VERTEX, "vertices"))
    return [Line2D([], [], label=text, **look) for look, text in named]


def _line(style: str, label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color="0.2", lw=0.8, ls=style, label=label)


def _folded(signal: Signal, per: str = "") -> str:
    """Name over unit, so that narrow panels have room."""
    unit = signal.unit.replace("m/s2", "m/s²")
    if per:
        unit = f"{unit} per {per.replace('m/s2', 'm/s²')}"
    name = "\n".join(wrap(signal.name, 16, break_on_hyphens=False))
    return f"{name}\n[{unit}]" if unit else name
