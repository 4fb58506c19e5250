"""Figures of responses over time, over frequency and by one-third octaves. Data to Figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.plant.outputs import Signal
from polefence.plant.system import Array
from polefence.response.result import Frequency, Response
from polefence.show.plots.plots import new_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Many curves, drawn one over the other; those of the vertices stand out, in grey too.
MANY: dict[str, Any] = {"color": "0.72", "lw": 0.5, "zorder": 1}
VERTEX: dict[str, Any] = {"color": "#b2182b", "lw": 1.1, "zorder": 2}
CURVES = 120  # drawn of the many
POINTS = 800  # drawn of each


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
