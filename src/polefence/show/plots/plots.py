"""Figures of poles in regions, of sweeps and of analyses. Data in, Figure out; touches no file."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from polefence.base.errors import InputError
from polefence.design.design import Design
from polefence.design.given import Analysis
from polefence.design.table import TableAnalysis
from polefence.law.laws import domain_of
from polefence.plant.parameters import Parameter
from polefence.plant.points import sample, values_text
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.cells import ANSWERS
from polefence.proof.text import visible
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Region,
    Sector,
    VerticalStrip,
)
from polefence.region.text import digits_down, digits_up, short_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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

Curve = npt.NDArray[np.complex128]
View = tuple[float, float, float]  # least and largest real part, largest imaginary part

POINTS = 1441

# An unbounded region is shown out to this many times its own scale, or that of most poles.
FARTHEST = 12.0

# Told apart in grey: light and plain, hatched, dark and plain.
FILLS: dict[str, dict[str, Any]] = {
    "proved": {"facecolor": "#eaf3e6", "edgecolor": "0.72"},
    "refuted": {"facecolor": "#f9e1da", "edgecolor": "#d0958a", "hatch": "////"},
    "undecided": {"facecolor": "0.62", "edgecolor": "0.45"},
}
MOST_MARKS = 150  # more would hide the map
SAMPLES = 101  # along each side of the box, for the boundary
HEIGHT = 0.35  # of the band that a single parameter is drawn as


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


def curves(part: Region, view: View) -> list[Curve]:
    """Return the boundary of a region's part as complex points, unbounded curves as far as asked.

    Parameters
    ----------
    part : Region
        One of `Region.parts`.
    view : (low, high, height)
        What lines and rays must reach across.
    """
    return _CURVES[type(part)](part, view)


def _disk(part: Any, _: View) -> list[Curve]:
    return [part.centre + part.radius * np.exp(1j * np.linspace(0, 2 * np.pi, POINTS))]


def _ellipse(part: Any, _: View) -> list[Curve]:
    angle = np.linspace(0, 2 * np.pi, POINTS)
    return [part.centre + part.real * np.cos(angle) + 1j * part.imaginary * np.sin(angle)]


def _half_plane(part: Any, view: View) -> list[Curve]:
    return [_vertical(-part.decay, view)]


def _vertical_strip(part: Any, view: View) -> list[Curve]:
    return [_vertical(part.low, view), _vertical(part.high, view)]


def _horizontal_strip(part: Any, view: View) -> list[Curve]:
    x = np.linspace(view[0], view[1], POINTS)
    return [x + 1j * part.height, x - 1j * part.height]


def _sector(part: Any, view: View) -> list[Curve]:
    # one curve through the corner, as far as the view's farther side
    far = min(-view[0], view[2] / part.slope)
    x = np.linspace(far, -far, POINTS)
    return [-np.abs(x) + 1j * part.slope * x]


def _vertical(x: float, view: View) -> Curve:
    return np.asarray(x + 1j * np.linspace(-view[2], view[2], POINTS))


_CURVES: dict[type[Region], Callable[[Any, View], list[Curve]]] = {
    Disk: _disk,
    Ellipse: _ellipse,
    HalfPlane: _half_plane,
    VerticalStrip: _vertical_strip,
    HorizontalStrip: _horizontal_strip,
    Sector: _sector,
}


def view_of(region: Region, poles: Array) -> View:
    """Return a view of the poles, of the region's boundary and of the origin."""
    low, high, height = _extent(region)
    x, y = np.real(poles), np.abs(np.imag(poles))
    if np.isfinite(low):
        seen = np.ones(x.shape, dtype=bool)
    else:
        reach = FARTHEST * max(region.scale, float(np.median(np.abs(x))))
        seen = x >= -reach
        low = min(-1.3 * region.scale, float(x[seen].min(initial=0.0)))
    low, high = min(low, float(x[seen].min(initial=low))), max(high, float(x[seen].max(initial=0)))
    height = max(height, float(y[seen].max(initial=0.0)), 0.35 * (high - low))
    margin = 0.06 * max(high - low, 1e-9)
    return low - margin, high + margin, height + margin


def _extent(region: Region) -> View:
    """Return how far the boundary reaches: low is -infinity where no part bounds it."""
    low, high, height = -np.inf, 0.0, 0.0
    for part in region.parts:
        if isinstance(part, Disk | Ellipse):
            real, imaginary = (
                (part.radius, part.radius)
                if isinstance(part, Disk)
                else (part.real, part.imaginary)
            )
            low = max(low, part.centre - real)
            high, height = max(high, part.centre + real), max(height, imaginary)
        elif isinstance(part, VerticalStrip):
            low, high = max(low, part.low), max(high, part.high)
        elif isinstance(part, HorizontalStrip):
            height = max(height, part.height)
        elif isinstance(part, HalfPlane):
            high = max(high, -part.decay)
    return low, high, height


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
