"""What was measured, and what a family that was fitted to it says in its place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.explained import explained
from polefence.data.identified import Identified
from polefence.data.measured import FrequencyResponse
from polefence.plant.outputs import disturbances, inputs
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


def _units(found: Identified) -> dict[str, str]:
    """Return the units of all signals, "" of one that has none."""
    acting = (*inputs(found.plant), *disturbances(found.plant))
    seen = (found.plant.signal(name) for name in found.outputs)
    return {signal.name: signal.unit for signal in (*acting, *seen)}


def _ratio(output: str, inside: str) -> str:
    """Return the unit of a gain, in brackets: "" where neither signal has one."""
    if not inside or output == inside:
        return f" [{output}]" if output and not inside else ""
    return f" [{output or '1'}/{f'({inside})' if set('/ ') & set(inside) else inside}]"


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
    units = _units(found)
    for i, j in np.ndindex(p, m):
        output, inside = found.outputs[i], found.inputs[j]
        axes[i][j].set_title(typeset(visible(f"{output} from {inside}")))
        axes[i][j].set_ylabel(typeset(visible(f"magnitude{_ratio(units[output], units[inside])}")))
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
    units = _units(found)
    for i, output in enumerate(found.outputs):
        unit = f" [{units[output]}]" if units[output] else ""
        axes[i][0].set_ylabel(typeset(visible(f"{output}{unit}")))
    _legend(axes[0][0])
    return figure


def _legend(ax: Axes) -> None:
    ax.legend(fontsize=8, loc="best")
