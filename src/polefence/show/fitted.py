"""What was measured, and what a family that was fitted to it says in its place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.explained import explained
from polefence.data.fit import Identified
from polefence.data.measured import FrequencyResponse
from polefence.proof.text import visible
from polefence.show.plots import LAW_STYLES, new_grid, typeset

if TYPE_CHECKING:  # imported where used
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 4  # measurements that are drawn, evenly chosen
INSTANTS = 400  # of a response in time, from the first one on
POINTS: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 2.6, "mfc": "none", "mew": 0.7}


@explained
def fit_figure(found: Identified) -> Figure:
    """Draw measurements as points, and what the family says in their place as curves."""
    chosen = np.unique(np.linspace(0, len(found.measurements) - 1, MOST).round().astype(int))
    in_frequency = isinstance(found.measurements[0], FrequencyResponse)
    draw = _frequencies if in_frequency else _instants
    return draw(found, [int(k) for k in chosen])


def _label(found: Identified, k: int) -> str:
    own = found.measurements[k]
    units = {p.name: p.unit for p in found.plant.parameters}
    at = (f"{key} = {value:.4g} {units.get(key, '')}".strip() for key, value in own.at.items())
    return typeset(visible(", ".join(at) or own.name))


def _frequencies(found: Identified, chosen: list[int]) -> Figure:
    """Draw the size of each pair over the frequency."""
    p, m = len(found.outputs), len(found.inputs)
    figure, axes = new_grid(p, m, 3.6 * m + 0.6, 2.3 * p + 0.5, sharex=True)
    for style, k in zip(LAW_STYLES, chosen, strict=False):
        own = found.measurements[k]
        if not isinstance(own, FrequencyResponse):
            continue
        hertz = own.frequency / (2 * np.pi)
        for i, j in np.ndindex(p, m):
            ax, colour = axes[i][j], style["color"]
            ax.loglog(hertz, np.abs(found.measured(k)[i, j]), color=colour, **POINTS)
            ax.loglog(hertz, np.abs(found.response(k)[i, j]), color=colour, lw=1.0,
                      label=_label(found, k))  # fmt: skip
    for i, j in np.ndindex(p, m):
        axes[i][j].set_title(typeset(visible(f"{found.outputs[i]} from {found.inputs[j]}")))
        for axis in (axes[i][j].xaxis, axes[i][j].yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
    for ax in axes[-1]:
        ax.set_xlabel("frequency [Hz]")
    _legend(axes[0][0])
    return figure


def _instants(found: Identified, chosen: list[int]) -> Figure:
    """Draw each output of each measurement over time."""
    p, columns = len(found.outputs), len(chosen)
    figure, axes = new_grid(
        p, columns, 2.9 * columns + 0.8, 1.9 * p + 0.6, sharex="col", sharey="row"
    )
    for column, k in enumerate(chosen):
        own = found.measurements[k]
        if isinstance(own, FrequencyResponse):
            continue
        time, y, modelled = own.time[:INSTANTS], found.measured(k), found.response(k)
        for i in range(p):
            ax = axes[i][column]
            ax.plot(time, y[i, :INSTANTS], color="#2166ac", label="measured", **POINTS)
            ax.plot(time, modelled[i, :INSTANTS], color="black", lw=1.0, label="family")
        axes[0][column].set_title(_label(found, k))
        axes[-1][column].set_xlabel("time [s]")
    for i, output in enumerate(found.outputs):
        axes[i][0].set_ylabel(typeset(visible(output)))
    _legend(axes[0][0])
    return figure


def _legend(ax: Axes) -> None:
    ax.legend(fontsize=8, loc="best")
