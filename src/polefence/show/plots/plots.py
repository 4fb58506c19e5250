"""Figures of sweeps and of closed-loop poles. Data in, Figure out; touches no file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.design.design import Design
from polefence.plant.points import sample
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.text import visible
from polefence.region.boundary import View, curves, view_of
from polefence.region.regions import Disk, Region
from polefence.region.text import short_text

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
# Of methods with other degrees, in the order in which they come; markers tell them apart in grey.
OTHERS: tuple[dict[str, Any], ...] = (
    {"ls": "-.", "color": "#1b7837", "marker": "^"},
    {"ls": (0, (6, 1.5)), "color": "#762a83", "marker": "s"},
    {"ls": (0, (3, 1, 1, 1, 1, 1)), "color": "#8c510a", "marker": "D"},
    {"ls": "-", "color": "0.55", "marker": "v"},
    {"ls": "--", "color": "0.35", "marker": "x"},
    {"ls": (0, (1, 1)), "color": "#35978f", "marker": "P"},
)
PANEL = 1.25  # width of a panel of poles over its height

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
    figure, axes = new_grid(1, columns, width, height, **options)
    return figure, axes[0]


def new_grid(
    rows: int, columns: int, width: float, height: float, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure with rows and columns of axes, as `new_figure` does."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes


def styles(labels: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return a line style for each method label; those of the paper's methods are fixed."""
    others = [label for label in dict.fromkeys(labels) if label not in STYLES]
    cycle = {
        label: {"label": label, "lw": 1.4, "ms": 4.5, "mfc": "none", **OTHERS[k % len(OTHERS)]}
        for k, label in enumerate(others)
    }
    return STYLES | cycle


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
    known = styles([row["method"] for rows in panels.values() for row in rows])
    for ax, (title, rows) in zip(axes, panels.items(), strict=True):
        for k, method in enumerate(dict.fromkeys(row["method"] for row in rows)):
            points = [
                (-r["centre"], 100 * (1 + r["radius"] / r["centre"]))
                for r in rows
                if r["method"] == method and r["radius"] is not None
            ]
            sigma, ratio = np.array(sorted(points)).reshape(-1, 2).T
            few = {"marker": "o", "ms": 3} if len(points) < 8 else {}
            # markers of different curves stand apart, where the curves do not
            every = {"markevery": (k, 8)} if len(points) >= 24 else {}
            ax.plot(sigma, ratio, **few | known[method] | every)
        ax.axhline(0, color="0.4", lw=0.8)
        ax.set_title(title)
        ax.set_xlabel("distance of the centre from the imaginary axis, σ [1/s]")
        if floor is not None:
            ax.set_ylim(bottom=max(ax.get_ylim()[0], floor))
    axes[0].set_ylabel("d/σ = 1 - r/σ [%]")
    axes[-1].legend(loc="lower right", fontsize=8.5)
    return figure


def sampled(design: Design) -> tuple[Array, Array]:
    """Return poles over a sample of the family that a design is about, and at its vertices.

    The sample is of the domain of the proof: product points where that is a box.
    """
    domain = Domain(design.certificate.claim().sizes)
    corners = np.eye(len(design.plant.vertices))
    return design.poles(domain.alpha(sample(domain))), design.poles(corners)


def poles_figure(
    panels: Mapping[str, tuple[Array, Array]], region: Region, view: View | None = None
) -> Figure:
    """Draw closed-loop poles over the family with the region; one panel a family.

    Parameters
    ----------
    panels : mapping
        Title to (poles of the sample, poles of the vertices), complex arrays.
    region : Region
        Its outside is shaded.
    view : (low, high, height), optional
        Real parts and largest imaginary part shown [1/s]; by default all poles, the boundary and
        the imaginary axis. Poles beyond it are counted in the panel.
    """
    lines = _folded(short_text(region))
    figure, axes = new_figure(len(panels), 1.0 + 4.4 * len(panels), 4.5 + 0.15 * lines.count("\n"))
    for ax, (title, (cloud, vertices)) in zip(axes, panels.items(), strict=True):
        cloud, vertices = np.ravel(cloud), np.ravel(vertices)
        ax.plot(
            cloud.real,
            cloud.imag,
            ".",
            ms=1.6,
            color="0.45",
            rasterized=True,
            label="poles over the family",
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
        shown = _fitted(view or view_of(region, np.concatenate([cloud, vertices])))
        _draw_region(ax, region, shown)
        _note_unseen(ax, cloud, shown)
        ax.set_title(title)
        ax.set_xlabel("real part [1/s]")
        ax.set_aspect("equal", adjustable="box")
        ax.axvline(0, color="0.3", lw=0.8)
    axes[0].set_ylabel("imaginary part [rad/s]")
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 3 if len(panels) > 1 or len(labels[-1]) < 22 else 2
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8.5)
    return figure


def _fitted(view: View) -> View:
    """Widen a view to the shape of a panel, so that one unit is as long either way."""
    low, high, height = view
    missing = max(PANEL * 2 * height - (high - low), 0.0) / 2
    return low - missing, high + missing, max(height, (high - low) / (2 * PANEL))


def _draw_region(ax: Axes, region: Region, view: View) -> None:
    """Shade the outside, draw the boundary, and what of the parts' boundaries is not of it."""
    low, high, height = view
    ax.set_xlim(low, high)
    ax.set_ylim(-height, height)
    x, y = np.linspace(low, high, 401), np.linspace(-height, height, 401)
    distance = region.distance(x[None, :] + 1j * y[:, None])
    top = max(float(distance.max()), 1.0)
    ax.contourf(x, y, distance, levels=[0.0, 2 * top], colors=["0.93"], zorder=0.1)
    label: str | None = _folded(short_text(region))
    close = 1e-6 * max(high - low, height)
    for part in region.parts:
        for curve in curves(part, view):
            edge = region.distance(curve) <= close
            for shown, style in ((edge, {"lw": 1.3}), (~edge, {"lw": 0.8, "ls": ":"})):
                line = np.where(shown, curve, np.nan)
                if shown.any():
                    name = label if shown is edge else None
                    ax.plot(line.real, line.imag, color="black", zorder=2.5, label=name, **style)
                    label = label if shown is not edge else None
    if isinstance(region, Disk):
        ax.plot(region.centre, 0, "k+", ms=7)


def _folded(text: str) -> str:
    """Break a long region into lines, before an '&'."""
    lines = [""]
    for part in text.split(" & "):
        room = len(lines[-1]) + len(part) < 36
        if lines == [""] or room:
            lines[-1] += (" & " if lines[-1] else "") + part
        else:
            lines.append("& " + part)
    return "\n".join(lines)


def _note_unseen(ax: Axes, cloud: Array, view: View) -> None:
    """Say how many poles lie beyond the view."""
    low, high, height = view
    beyond = (cloud.real < low) | (cloud.real > high) | (np.abs(cloud.imag) > height)
    if beyond.any():
        ax.annotate(
            f"{100 * beyond.mean():.2g} % of the poles lie outside the picture,\n"
            f"real parts down to {cloud.real.min():.3g}",
            (0.02, 0.02),
            xycoords="axes fraction",
            fontsize=8,
        )


def render(figure: Figure, kind: str) -> bytes:
    """Return the figure as the bytes of a PNG, SVG or PDF, the same for the same data."""
    from matplotlib import rc_context

    _as_written(figure)
    dates: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with rc_context(_STYLE):
        if figure.get_layout_engine() is not None:  # laid out once, for files of all kinds
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind, dpi=160, metadata=dates.get(kind))
    return buffer.getvalue()


def _as_written(figure: Figure) -> None:
    """Show texts as they are: names are no formulas, and have no control characters."""
    from matplotlib.axis import Tick
    from matplotlib.text import Text

    ticks = {id(text) for tick in figure.findobj(Tick) for text in (tick.label1, tick.label2)}
    for text in figure.findobj(Text):
        if id(text) not in ticks:  # powers of ten are formulas
            text.set_parse_math(False)
            text.set_text("\n".join(map(visible, text.get_text().split("\n"))))
