"""Figures of sweeps and of closed-loop poles. Data in, Figure out; touches no file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.plant.system import Array
from polefence.region import Disk

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure  # imported where used: it is slow to import

FORMATS = ("png", "svg", "pdf")
# The paper's line styles: dotted, dashed, solid. Told apart in grey by style and shade.
STYLES: dict[str, dict[str, Any]] = {
    "quadratic": {"label": "quadratic (Lemma 1)", "ls": ":", "color": "#b2182b", "lw": 2.2},
    "slack": {"label": "slack variable (Lemma 2)", "ls": "--", "color": "#2166ac", "lw": 1.6},
    "scheduled": {"label": "scheduled (Theorem 1)", "ls": "-", "color": "black", "lw": 1.6},
}
_STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.grid": True,
    "grid.color": "0.88",
    "axes.axisbelow": True,
    "svg.hashsalt": "polefence",
    "legend.framealpha": 1.0,
}


def new_figure(columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """Return a figure with a row of axes, in the package's style; no window, no global state."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1, columns, squeeze=False, **options)[0]
    return figure, axes


def limits_figure(
    panels: Mapping[str, Sequence[Mapping[str, Any]]], floor: float | None = None
) -> Figure:
    """Draw d / sigma over the centre for each method; one panel a sweep.

    Parameters
    ----------
    panels : mapping
        Title to rows with ``centre``, ``method``, ``radius`` (None is left out).
    floor : float, optional
        Least d / sigma shown, in percent; curves below it leave the picture.
    """
    figure, axes = new_figure(len(panels), 1.2 + 4.4 * len(panels), 3.6, sharey=True)
    for ax, (title, rows) in zip(axes, panels.items(), strict=True):
        for method in dict.fromkeys(row["method"] for row in rows):
            points = [
                (-r["centre"], 100 * (1 + r["radius"] / r["centre"]))
                for r in rows
                if r["method"] == method and r["radius"] is not None
            ]
            sigma, ratio = np.array(sorted(points)).reshape(-1, 2).T
            marker = {"marker": "o", "ms": 3} if len(points) < 8 else {}
            ax.plot(sigma, ratio, **STYLES[method], **marker)
        ax.axhline(0, color="0.4", lw=0.8)
        ax.set_title(title)
        ax.set_xlabel(r"distance of the centre from the imaginary axis, $\sigma$ [1/s]")
        if floor is not None:
            ax.set_ylim(bottom=max(ax.get_ylim()[0], floor))
    axes[0].set_ylabel(r"$d/\sigma = 1 - r/\sigma$ [%]")
    axes[-1].legend(loc="lower right", fontsize=8.5)
    return figure


def poles_figure(panels: Mapping[str, tuple[Array, Array]], disk: Disk) -> Figure:
    """Draw closed-loop poles over the polytope with the disk; one panel a family.

    Parameters
    ----------
    panels : mapping
        Title to (poles of the sample, poles of the vertices), complex arrays.
    disk : Disk
    """
    figure, axes = new_figure(len(panels), 1.0 + 4.4 * len(panels), 4.4)
    for ax, (title, (cloud, vertices)) in zip(axes, panels.items(), strict=True):
        cloud, vertices = np.ravel(cloud), np.ravel(vertices)
        ax.plot(
            cloud.real,
            cloud.imag,
            ".",
            ms=1.6,
            color="0.55",
            rasterized=True,
            label="poles over the polytope",
        )
        ax.plot(
            vertices.real,
            vertices.imag,
            "s",
            ms=5,
            mfc="none",
            mec="#b2182b",
            mew=1.2,
            label="poles of the vertices",
        )
        _draw_disk(ax, disk)
        ax.set_title(title)
        ax.set_xlabel("real part [1/s]")
        ax.set_aspect("equal", adjustable="datalim")
        ax.axvline(0, color="0.3", lw=0.8)
    axes[0].set_ylabel("imaginary part [rad/s]")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8.5
    )
    return figure


def _draw_disk(ax: Axes, disk: Disk) -> None:
    angle = np.linspace(0, 2 * np.pi, 361)
    ax.plot(
        disk.centre + disk.radius * np.cos(angle),
        disk.radius * np.sin(angle),
        "k-",
        lw=1.3,
        label=f"disk: centre {disk.centre:g}, radius {disk.radius:g}",
    )
    ax.plot(disk.centre, 0, "k+", ms=7)


def render(figure: Figure, kind: str) -> bytes:
    """Return the figure as the bytes of a PNG, SVG or PDF, the same for the same data."""
    from matplotlib import rc_context

    dates: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with rc_context(_STYLE):
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind, dpi=160, metadata=dates.get(kind))
    return buffer.getvalue()
