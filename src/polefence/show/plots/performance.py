"""Figures of proved bounds beside sampled values, and of trade-offs. Data in, Figure out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from polefence.design.signals.tradeoff import Front
from polefence.plant.system import Array
from polefence.show.plots.plots import new_figure, new_grid, styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Told apart in grey: filled and dark, open and light.
OWN: dict[str, Any] = {"color": "#2166ac", "marker": ".", "ms": 2.2, "ls": "", "mew": 0}
PASSIVE: dict[str, Any] = {"color": "0.65", "marker": ".", "ms": 2.2, "ls": "", "mew": 0}
BOUND: dict[str, Any] = {"color": "black", "ls": "--", "lw": 1.4}
SHOWN = 2000  # points of each cloud
SAMPLED: dict[str, Any] = {"ls": "none", "marker": ".", "ms": 4, "zorder": 3}
SAMPLED_LABEL = "the same laws, worst of a sample"
REFERENCE: dict[str, Any] = {"ls": "none", "marker": "*", "ms": 9, "color": "black", "mfc": "white"}


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


def front_figure(front: Front) -> Figure:
    """Draw the least bound on one signal over the bound on another, a line a method.

    Marks are laws: what is proved of each, in both signals. A law that does not use up its limit
    is drawn at what it keeps; the line goes on, level, to the largest limit that was asked for.
    Lines between marks are for the eye. Dots are where the same laws come out at sampled
    parameters, stars are reference laws there, in brackets where one exceeds another limit: about
    those nothing is proved.

    Parameters
    ----------
    front : Front
    """
    figure, (ax,) = new_figure(1, 6.4, 4.2)
    known = styles(front.methods)
    for k, method in enumerate(front.methods):
        rows = [r for r in front.rows if r["method"] == method and r["status"] == "proved"]
        pairs = sorted({(r["bounds"][0]["proved"], r["proved"]) for r in rows})
        line = [*pairs, (max(r["value"] for r in rows), pairs[-1][1])] if pairs else []
        style: dict[str, Any] = {"marker": "os^D"[k % 4]} | known[method]
        style |= {"ms": 6.5, "mfc": "none", "markevery": list(range(len(pairs)))}
        style["label"] = f"{style['label'].partition(' (Lemma')[0]}, proved"
        ax.plot([x for x, _ in line], [y for _, y in line], **style)
        dots = {(r["bounds"][0]["sampled"], r["sampled"]) for r in rows}
        seen = sorted(pair for pair in dots if None not in pair)
        x, y = [x for x, _ in seen], [y for _, y in seen]
        ax.plot(x, y, color=known[method]["color"], **SAMPLED)
    ax.plot([], [], color="0.3", label=SAMPLED_LABEL, **SAMPLED)
    for k, row in enumerate(front.references):
        ax.plot(row["over"], row["minimise"], **REFERENCE)
        place: dict[str, Any] = (
            {"xytext": (7, 4)} if k < 2 else {"xytext": (-7, -11), "ha": "right"}
        )
        at = (row["over"], row["minimise"])
        ax.annotate(row["name"], at, textcoords="offset points", fontsize=8.5, **place)
    ax.margins(0.06, 0.1)
    ax.set_xlabel(f"worst {front.labels[0]}")
    ax.set_ylabel(f"worst {front.labels[1]}")
    ax.legend(loc="best", fontsize=8.5)
    return figure
