"""Figures of analyses: the parameters' box by answer, and the poles of a given law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError
from polefence.design.given.analysis import Analysis
from polefence.design.given.table import TableAnalysis
from polefence.law.laws import domain_of
from polefence.plant.parameters import Parameter
from polefence.plant.points import sample, values_text
from polefence.proof.claims.cells import ANSWERS
from polefence.region.text import digits_down, digits_up
from polefence.show.plots.plots import new_figure, poles_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure  # imported where used: it is slow to import

# Told apart in grey: light and plain, hatched, dark and plain.
FILLS: dict[str, dict[str, Any]] = {
    "proved": {"facecolor": "#eaf3e6", "edgecolor": "0.72"},
    "refuted": {"facecolor": "#f9e1da", "edgecolor": "#d0958a", "hatch": "////"},
    "undecided": {"facecolor": "0.62", "edgecolor": "0.45"},
}
MOST_MARKS = 150  # more would hide the map
SAMPLES = 101  # along each side of the box, for the boundary
HEIGHT = 0.35  # of the band that a single parameter is drawn as


def table_figure(analysis: TableAnalysis) -> Figure:
    """Draw the box of one or two parameters, each cell by its answer.

    Raises
    ------
    InputError
        If the plant has more than two parameters.
    """
    parameters = analysis.plant.parameters
    if len(parameters) > 2:
        raise InputError(
            f"a map is of one or two parameters; {analysis.plant.name} has {len(parameters)}"
        )
    flat = len(parameters) == 1
    figure, (ax,) = new_figure(1, 6.2, 2.4 if flat else 4.9)
    handles = [_cells(ax, analysis, kind) for kind in ANSWERS if analysis.shares[kind] > 0]
    knots = np.meshgrid(*analysis.table.axes, indexing="ij")
    handles += ax.plot(
        knots[0].ravel(),
        np.full(knots[0].size, HEIGHT / 2) if flat else knots[1].ravel(),
        "o",
        ms=6,
        mfc="white",
        mec="black",
        label="knots of the table",
    )
    if not flat:
        handles.append(_sampled_boundary(ax, analysis))
    points = analysis.counterexamples[:MOST_MARKS]
    if points:
        name, *other = (p.name for p in parameters)
        y = [p[other[0]] for p in points] if other else [HEIGHT / 2] * len(points)
        label = "counterexamples"
        if len(analysis.counterexamples) > MOST_MARKS:
            label = f"the worst {MOST_MARKS} counterexamples"
        x = [p[name] for p in points]
        handles += ax.plot(x, y, "x", ms=4.5, mew=1.2, color="#67000d", label=label, zorder=3)
    ax.grid(visible=False)
    _limits(ax, parameters)
    ax.set_title(f"{analysis.plant.name}: {analysis.region}", fontsize=9.5)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def _cells(ax: Axes, analysis: TableAnalysis, kind: str) -> Any:
    """Draw the cells with an answer; return what stands for them in the legend."""
    from matplotlib.patches import Rectangle

    style = {"lw": 0.6, **FILLS[kind]}
    for cell in analysis.cells:
        if cell.answer == kind:
            low, high = ([float(v) for v in side] for side in (cell.low, cell.high))
            x, y, x1, y1 = [*low, 0.0, *high, HEIGHT] if len(low) == 1 else [*low, *high]
            ax.add_patch(Rectangle((x, y), x1 - x, y1 - y, **style))
    digits = digits_down if kind == "proved" else digits_up
    share = digits(100 * analysis.shares[kind], 3)
    return Rectangle((0, 0), 1, 1, label=f"{kind}, {share} %", **style)


def _sampled_boundary(ax: Axes, analysis: TableAnalysis) -> Any:
    """Draw where sampled poles reach the region's boundary; return its line for the legend."""
    from matplotlib.lines import Line2D

    sides = [np.linspace(float(p.low), float(p.high), SAMPLES) for p in analysis.plant.parameters]
    x, y = np.meshgrid(*sides, indexing="ij")
    poles = analysis.poles(np.stack([x.ravel(), y.ravel()], axis=1))
    distance = analysis.region.distance(poles).max(axis=1).reshape(x.shape)
    style: dict[str, Any] = {"linestyles": "--", "linewidths": 1.3, "colors": "black"}
    if distance.min() < 0 < distance.max():
        ax.contour(x, y, distance, levels=[0.0], **style)
    return Line2D([], [], ls="--", lw=1.3, color="black", label="boundary, sampled")


def _limits(ax: Axes, parameters: tuple[Parameter, ...]) -> None:
    setters: Any = ((ax.set_xlim, ax.set_xlabel), (ax.set_ylim, ax.set_ylabel))
    for p, (limit, label) in zip(parameters, setters, strict=False):
        low, high = float(p.low), float(p.high)
        margin = 0.03 * (high - low)
        limit(low - margin, high + margin)
        label(f"{p.name} [{p.unit}]" if p.unit else p.name)
    if len(parameters) == 1:
        ax.set_ylim(0, HEIGHT)
        ax.set_yticks([])


def analysis_figure(analysis: Analysis) -> Figure:
    """Draw the poles of a given law over the family with the region; and at a counterexample."""
    domain = domain_of(analysis.plant, analysis.law)
    corners = np.eye(len(analysis.plant.vertices))
    clouds = analysis.poles(domain.alpha(sample(domain))), analysis.poles(corners)
    title = analysis.plant.name
    if analysis.alpha is None or analysis.pole is None:
        return poles_figure({title: clouds}, analysis.region)
    where = "the counterexample"
    if analysis.values is not None:
        where = values_text(analysis.plant, analysis.values)
    figure = poles_figure({f"{title}\ncrosses: poles at {where}": clouds}, analysis.region)
    z = analysis.poles(np.array([float(a) for a in analysis.alpha]))
    figure.axes[0].plot(z.real, z.imag, "x", ms=8, mew=1.8, color="#67000d", zorder=4)
    return figure
