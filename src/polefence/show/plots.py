"""Figures. Data in, Figure out; no file is touched."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from textwrap import wrap
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError
from polefence.base.explained import explained
from polefence.certify.design import Design
from polefence.certify.given import Analysis
from polefence.certify.table import TableAnalysis
from polefence.plant.outputs import Signal
from polefence.plant.parameters import Parameter
from polefence.plant.points import sample, values_text
from polefence.plant.polynomial import Domain
from polefence.plant.system import Array
from polefence.proof.claims.cells import ANSWERS
from polefence.proof.text import visible
from polefence.region.regions import POINTS, Region, View, Wedge
from polefence.region.text import digits_down, digits_up, short_text

if TYPE_CHECKING:  # imported where used, or for signatures only
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from polefence.certify.margins import Margins
    from polefence.response.linear import Frequency, Response
    from polefence.search.structures import Structures
    from polefence.search.tradeoff import Front
    from polefence.vehicle.compare import Comparison
    from polefence.vehicle.concepts import Concepts

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
MOST_TITLE = 150  # letters below a figure
COMPARED = ("weighted acceleration", "tyre load variation", "suspension travel", "actuator force")
BELOW = "#f6d8c4"
FLOOR_LINE: Any = {"color": "0.3", "ls": "--", "lw": 0.9}
PANEL = 1.25  # width of a panel of poles over its height
NARROW = 4  # height over width from which a view of poles is stretched

_STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.grid": True,
    "grid.color": "0.88",
    "axes.axisbelow": True,
    "svg.hashsalt": "polefence",
    "legend.framealpha": 1.0,
    "figure.autolayout": False,
    "figure.constrained_layout.use": False,
}


# Told apart in grey: light and plain, hatched, dark and plain.
FILLS: dict[str, dict[str, Any]] = {
    "proved": {"facecolor": "#eaf3e6", "edgecolor": "0.72"},
    "refuted": {"facecolor": "#f9e1da", "edgecolor": "#d0958a", "hatch": "////"},
    "undecided": {"facecolor": "0.62", "edgecolor": "0.45"},
}
MOST_MARKS = 150  # more would hide the map
HEIGHT = 0.35  # of the band that a single parameter is drawn as

# Told apart in grey by shade, width and dashes; the second lies below the first.
LAW_STYLES: tuple[dict[str, Any], ...] = (
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

# Many curves, drawn one over the other; those of the vertices stand out, in grey too.
MANY: dict[str, Any] = {"color": "0.72", "lw": 0.5, "zorder": 1}
VERTEX: dict[str, Any] = {"color": "#b2182b", "lw": 1.1, "zorder": 2}

# Told apart in grey: filled and dark, open and light.
OWN: dict[str, Any] = {"color": "#2166ac", "marker": ".", "ms": 2.2, "ls": "", "mew": 0}
PASSIVE: dict[str, Any] = {"color": "0.65", "marker": ".", "ms": 2.2, "ls": "", "mew": 0}
BOUND: dict[str, Any] = {"color": "black", "ls": "--", "lw": 1.4}
SAMPLED_STYLE: dict[str, Any] = {"ls": "none", "marker": ".", "ms": 4, "zorder": 3}
REFERENCE: dict[str, Any] = {"ls": "none", "marker": "*", "ms": 9, "color": "black", "mfc": "white"}


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
    panels: Mapping[str, Sequence[Mapping[str, Any]]],
    floor: float = -60.0,
    published: Mapping[str, Sequence[Mapping[str, Any]]] = MappingProxyType({}),
) -> Figure:
    """Draw d / sigma over the centre for each method; one panel a sweep.

    Parameters
    ----------
    panels : mapping
        Title to rows with ``centre``, ``method``, ``radius`` (None is left out).
    floor : float
        Least d / sigma shown, in percent; where curves go below it the panel says so.
    published : mapping, optional
        Title to rows of others, which are points.
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
        hollow: Any = {"ls": "", "marker": "o", "ms": 5, "mfc": "none", "mew": 1.2}
        for row in published.get(title, ()):
            ratio = 100 * (1 + row["radius"] / row["centre"])
            ax.plot(-row["centre"], ratio, color=known[row["method"]]["color"], **hollow)
        if title in published:
            ax.plot([], [], color="0.4", label="published", **hollow)
        ax.axhline(0, color="0.4", lw=0.8)
        ax.set_title(title)
        ax.set_xlabel("distance of the centre from the imaginary axis, σ [1/s]")
    axes[0].set_ylabel("d/σ = 1 - r/σ [%]")
    if axes[0].get_ylim()[0] < floor:  # panels share it
        axes[0].set_ylim(bottom=floor)
        for ax in axes:
            words: Any = {"transform": ax.transAxes, "ha": "center", "color": "0.3", "fontsize": 8}
            ax.text(0.37, 0.03, f"cut at {floor:g} %", **words)
    axes[0 if published else -1].legend(loc="lower right", fontsize=8.5)
    return figure


def sampled(design: Design) -> tuple[Array, Array]:
    """Return poles over a sample of the family that a design is about, and at its vertices.

    The sample is of the domain of the proof: product points where that is a box.
    """
    domain = Domain(design.certificate.claim().sizes)
    corners = np.eye(len(design.plant.vertices))
    return design.poles(domain.alpha(sample(domain))), design.poles(corners)


def poles_figure(
    panels: Mapping[str, tuple[Array, Array]],
    region: Region,
    view: View | None = None,
    others: Mapping[str, tuple[str, Array]] = MappingProxyType({}),
    *,
    discrete: bool = False,
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
        the imaginary axis, the same in all panels; of one panel alone also a second one of the
        slow poles, where these would be one dot. Poles beyond a view are counted in the panel.
    others : mapping, optional
        Title to (label, poles) of another law.
    discrete : bool, optional
        Poles are of the z-plane: they have no unit, and the unit circle takes the place of the
        imaginary axis.
    """
    every = [np.ravel(poles) for pair in panels.values() for poles in pair]
    every += [np.ravel(poles) for _, poles in others.values()]
    whole = view or view_of(region, np.concatenate(every))
    alone = len(panels) == 1 and view is None and not discrete
    near = _near_origin(every[0], whole) if alone else None
    drawn = [(title, title, whole) for title in panels]
    drawn += [(title, "near the origin", near) for title in panels if near is not None]
    lines = _folded(short_text(region))
    figure, axes = new_figure(len(drawn), 1.0 + 4.4 * len(drawn), 4.5 + 0.2 * lines.count("\n"))
    for ax, (title, heading, seen) in zip(axes, drawn, strict=True):
        cloud, vertices = map(np.ravel, panels[title])
        _draw_poles(ax, cloud, vertices, others.get(title))
        window, aspect = shaped(seen)
        draw_region(ax, region, window)
        if seen is whole:
            _note_unseen(ax, cloud, window)
        ax.set_title(heading)
        ax.set_xlabel("real part of z" if discrete else "real part [1/s]")
        ax.set_aspect(aspect, adjustable="box")
        if discrete:
            circle = np.exp(1j * np.linspace(0, 2 * np.pi, POINTS))
            ax.plot(circle.real, circle.imag, color="0.3", lw=0.8, label="unit circle")
        else:
            ax.axvline(0, color="0.3", lw=0.8)
    axes[0].set_ylabel("imaginary part of z" if discrete else "imaginary part [rad/s]")
    handles, labels = axes[0].get_legend_handles_labels()
    columns = 4 if len(drawn) > 1 else 3 if len(labels[-1]) < 22 else 2
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8.5)
    return figure


def _draw_poles(ax: Axes, cloud: Array, vertices: Array, other: tuple[str, Array] | None) -> None:
    """Draw the poles of a family, of its vertices, and of another law."""
    style: Any = {"ms": 1.6, "color": "0.45", "rasterized": True, "label": "poles over the family"}
    ax.plot(cloud.real, cloud.imag, ".", **style)
    style = {"ms": 5, "mfc": "none", "mec": "#b2182b", "mew": 1.2}
    ax.plot(vertices.real, vertices.imag, "s", label="poles of the vertices", **style)
    if other is not None:
        label, poles = other
        style = {"ms": 5, "mew": 1.2, "color": "#2166ac", "label": label}
        ax.plot(np.real(poles).ravel(), np.imag(poles).ravel(), "x", **style)


def shaped(view: View) -> tuple[View, str]:
    """Return the view that is drawn, and its aspect: equal, but where that hides what is narrow."""
    low, high, height = view
    if 2 * height > NARROW * (high - low):
        return view, "auto"
    return fitted(view), "equal"


def _near_origin(poles: Array, view: View) -> View | None:
    """Return a view of the slow poles, where there are fast ones that make them one dot."""
    low, _, height = view
    slow = poles[np.abs(poles) < max(-low, height) / 8]
    if not slow.size or slow.size == poles.size:
        return None
    width, height = -float(slow.real.min()), float(np.abs(slow.imag).max())
    width = max(width, height / NARROW)
    return -1.2 * width, 0.2 * width, max(1.2 * height, 0.5 * width)


def fitted(view: View) -> View:
    """Return a view widened to the shape of a panel, so that one unit is as long either way."""
    low, high, height = view
    missing = max(PANEL * 2 * height - (high - low), 0.0) / 2
    return low - missing, high + missing, max(height, (high - low) / (2 * PANEL))


def draw_region(ax: Axes, region: Region, view: View) -> None:
    """Shade what is outside a region, and draw its boundary, on axes of your own.

    Parameters
    ----------
    ax : matplotlib axes
        Its limits become those of the view.
    region : Region
        Boundaries of its parts that are not boundaries of the region are dotted.
    view : (low, high, height)
        Real parts and largest imaginary part shown [1/s].
    """
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
        for curve in part.boundary(view):
            edge = region.distance(curve) <= close
            for shown, style in ((edge, {"lw": 1.3}), (~edge, {"lw": 0.8, "ls": ":"})):
                line = np.where(shown, curve, np.nan)
                if shown.any():
                    name = label if shown is edge else None
                    ax.plot(line.real, line.imag, color="black", zorder=2.5, label=name, **style)
                    label = label if shown is not edge else None
    if region.circle is not None:
        ax.plot(region.circle[0], 0, "k+", ms=7)


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
            bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.5},
        )


def render(figure: Figure, kind: str) -> bytes:
    """Return the figure as the bytes of a PNG, SVG or PDF, the same for the same data."""
    from matplotlib import rc_context

    _as_written(figure)
    dates: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with rc_context(_STYLE):
        layout = figure.get_layout_engine()
        if layout is not None:  # laid out once, for files of all kinds
            layout.execute(figure)
            figure.set_layout_engine(None)  # "none" would lay it out, and draw it, every time
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind, dpi=160, metadata=dates.get(kind))
    return buffer.getvalue()


def address(figure: Figure) -> str:
    """Return a figure as the address of an image: names inside one SVG do not meet another's."""
    return "data:image/svg+xml;base64," + base64.b64encode(render(figure, "svg")).decode()


def _as_written(figure: Figure) -> None:
    """Show texts as they are: names are no formulas, and have no control characters."""
    for text in _texts(figure):
        text.set_parse_math(False)
        text.set_text(typeset("\n".join(map(visible, text.get_text().split("\n")))))


def _texts(artist: Artist) -> Iterator[Text]:
    """Yield all texts but those of ticks: powers of ten are formulas, and take long to make."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    if isinstance(artist, Text):
        yield artist
    if isinstance(artist, Axis):
        yield from (artist.label, artist.offsetText)
    else:
        for child in artist.get_children():
            yield from _texts(child)


def typeset(text: str) -> str:
    """Return a text with m/s² and rad/s² for the m/s2 and rad/s2 of specs and terminals."""
    return re.sub(r"\b(m|rad)/s2\b", r"\1/s²", text)


def view_of(region: Region, poles: Array) -> View:
    """Return a view of the poles, if there are any, of the region's boundary and of the origin."""
    low, high, height = _extent(region)
    x, y = np.real(poles), np.abs(np.imag(poles))
    scale, typical = region.size, 0.0  # where nothing else tells, some width is better than none
    if x.size:
        scale, typical = region.scale, float(np.median(np.abs(x)))
    if np.isfinite(low):
        seen = np.ones(x.shape, dtype=bool)
    else:
        # an unbounded region is shown out to so many times its own scale, or that of most poles
        seen = x >= -12.0 * max(scale, typical)
        low = min(-1.3 * scale, float(x[seen].min(initial=0.0)))
    low, high = min(low, float(x[seen].min(initial=low))), max(high, float(x[seen].max(initial=0)))
    height = max(height, float(y[seen].max(initial=0.0)), 0.35 * (high - low))
    margin = 0.06 * max(high - low, 1e-9)
    return low - margin, high + margin, height + max(margin, 0.06 * height)


def _extent(region: Region) -> View:
    """Return how far the boundary reaches: low is -infinity where no part bounds it."""
    round_parts = [part for part in region.parts if part.half_axes is not None]
    seen = [part for part in region.parts if not round_parts or not isinstance(part, Wedge)]
    ends = np.array([part.ends for part in seen])
    low = ends[:, 0].max()
    high = max(0.0, ends[np.isfinite(ends[:, 1]), 1].max(initial=0.0))
    height = max(part.highest for part in region.parts)
    return low, high, height


@explained
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
            f"a map shows one or two parameters; {analysis.plant.name} has {len(parameters)}"
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

    sides = [np.linspace(float(p.low), float(p.high), 101) for p in analysis.plant.parameters]
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


@explained
def analysis_figure(analysis: Analysis) -> Figure:
    """Draw the poles of a given law over the family with the region; and at a counterexample."""
    domain = analysis.law.domain_of(analysis.plant)
    corners = np.eye(len(analysis.plant.vertices))
    clouds = analysis.poles(domain.alpha(sample(domain))), analysis.poles(corners)
    title, discrete = analysis.plant.name, analysis.plant.sample_time is not None
    if analysis.alpha is None or analysis.pole is None:
        return poles_figure({title: clouds}, analysis.region, discrete=discrete)
    where = "the counterexample"
    if analysis.values is not None:
        where = values_text(analysis.plant, analysis.values)
    figure = poles_figure(
        {f"{title}\ncrosses: poles at {where}": clouds}, analysis.region, discrete=discrete
    )
    z = analysis.poles(np.array([float(a) for a in analysis.alpha]))
    figure.axes[0].plot(z.real, z.imag, "x", ms=8, mew=1.8, color="#67000d", zorder=4)
    return figure


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
    floors : mapping of str to (time,) array
        Levels below which a curve means something else, by what the legend calls that.
    """

    label: str
    curves: Mapping[str, Array]
    floors: Mapping[str, Array] = field(default_factory=dict)


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
        for level in panel.floors.values():
            _floor(ax, time, level)
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
    below = dict.fromkeys(name for panel in panels for name in panel.floors)
    _legend(figure, styles, mixed, outside, tuple(below))
    return figure


def _styles(panels: Sequence[Panel]) -> dict[str, dict[str, Any]]:
    names = list(dict.fromkeys(name for p in panels for name in p.curves if name))
    laws = list(dict.fromkeys(name.removesuffix(BESIDE) for name in names))
    of_law = {law: LAW_STYLES[k % len(LAW_STYLES)] for k, law in enumerate(laws)}
    styles = {
        name: of_law[name.removesuffix(BESIDE)] | (DOTTED if name.endswith(BESIDE) else {})
        for name in names
    }
    return styles | {"": COMMON}


def _floor(ax: Axes, time: Array, level: Array) -> None:
    """Draw a level, and shade what is below it."""
    bottom, top = ax.get_ylim()
    bottom = min(bottom, float(level.min()) - 0.08 * (top - bottom))
    ax.plot(time, level, **FLOOR_LINE)
    ax.fill_between(time, bottom, level, color=BELOW, lw=0, zorder=0.4)
    ax.set_ylim(bottom, top)


def _legend(
    figure: Figure, styles: Mapping[str, Any], mixed: bool, outside: Any, below: tuple[str, ...]
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shown = {name or "true": style for name, style in styles.items() if name or mixed}
    handles: list[Any] = [Line2D([], [], label=name, **style) for name, style in shown.items()]
    if outside is not None and np.any(outside):
        handles.append(Patch(facecolor="0.85", label="outside of what is proved"))
    handles += [Patch(facecolor=BELOW, edgecolor="0.3", ls="--", label=name) for name in below]
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
    values = np.where(np.abs(values) < 1e30, values, np.nan)  # larger ones make no picture
    size = len(time) // 1500  # each piece shows its least and its largest value
    if size < 3:
        return time, values
    whole = len(time) // size * size
    pieces = values[:whole].reshape(-1, size)
    ends = np.stack([pieces.argmin(axis=1), pieces.argmax(axis=1)], axis=1)
    k = (np.sort(ends, axis=1) + size * np.arange(len(pieces))[:, None]).ravel()
    k = np.concatenate([[0], k, np.arange(whole, len(time)), [len(time) - 1]])
    return time[k], values[k]


def responses_figure(
    columns: Mapping[str, Response],
    mark: float | None = None,
    until: float | None = None,
    edges: Mapping[str, Array] | None = None,
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
    edges : mapping, optional
        By name of a signal, (count, 3): times, and numbers between which it is proved to stay.
    """
    first, edges = next(iter(columns.values())), edges or {}
    if len(columns) == 1:
        figure, panels = _pairs(len(first.signals))
        axes = panels[:, None]
    else:
        figure, axes = _grid(first.signals, len(columns), sharey="row")
    for column, (title, response) in zip(axes.T, columns.items(), strict=True):
        shown = response.time <= (response.time[-1] if until is None else until)
        every = max(1, int(shown.sum()) // 800)
        time = response.time[shown][::every]
        for i, (ax, signal) in enumerate(zip(column, response.signals, strict=True)):
            rows = response.values[:, shown, i][:, ::every]
            x = time
            if response.plant.sample_time is not None:  # nothing is known in between
                x, rows = np.repeat(time, 2)[1:], np.repeat(rows, 2, axis=1)[:, :-1]
            _curves(ax, x, rows, response.alpha)
            if signal.name in edges:
                _edges(ax, edges[signal.name], float(time[-1]))
            if mark is not None:
                ax.axvline(mark, color="0.2", lw=0.8, ls="--")
            if ax is axes[i, 0]:
                ax.set_ylabel(_axis_label(signal))
        if len(columns) > 1:
            column[0].set_title(title)
        for ax in column[-2:] if len(columns) == 1 else column[-1:]:
            ax.set_xlabel("time [s]")
            ax.xaxis.set_tick_params(labelbottom=True)
            ax.set_xlim(0, time[-1])
    handles = _response_handles()
    if mark is not None:
        handles.append(_line("--", f"{mark:g} s"))
    if any(signal.name in edges for signal in first.signals):
        handles.append(_line(":", "proved"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def _edges(ax: Axes, points: Array, last: float) -> None:
    """Draw between which numbers a signal stays, the last ones until a time."""
    ends = np.vstack([points, [max(last, points[-1, 0]), *points[-1, 1:]]])
    for column in (1, 2):
        ax.plot(ends[:, 0], ends[:, column], color="0.2", lw=0.8, ls=":")


def frequency_figure(columns: Mapping[str, Frequency]) -> Figure:
    """Draw magnitudes from the first source to each signal; one column a family."""
    first = next(iter(columns.values()))
    figure, axes = _grid(first.signals, len(columns), sharey="row")
    for column, (title, response) in zip(axes.T, columns.items(), strict=True):
        for i, (ax, signal) in enumerate(zip(column, response.signals, strict=True)):
            ax.set_xscale("log")
            ax.set_yscale("log")
            _curves(ax, response.frequency, np.abs(response.gain[:, :, i, 0]), response.alpha)
            if ax is axes[i, 0]:
                ax.set_ylabel(_axis_label(signal, response.sources[0].unit))
        column[0].set_title(title)
        column[-1].set_xlabel(f"frequency of {response.sources[0].name} [Hz]")
        column[-1].set_xlim(response.frequency[0], response.frequency[-1])
    figure.legend(handles=_response_handles(), loc="outside lower center", ncols=2, fontsize=8.5)
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
    others = others[:: max(1, len(others) // 120)]
    lines = [np.column_stack([x, row]) for row in rows[others]]
    ax.add_collection(LineCollection(lines, rasterized=True, **MANY), autolim=True)
    for row in rows[vertices]:
        ax.plot(x, row, **VERTEX)
    ax.autoscale_view()


def _response_handles() -> list[Any]:
    from matplotlib.lines import Line2D

    named = ((MANY, "points of the family"), (VERTEX, "vertices"))
    return [Line2D([], [], label=text, **look) for look, text in named]


def _line(style: str, label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color="0.2", lw=0.8, ls=style, label=label)


def _axis_label(signal: Signal, per: str = "") -> str:
    """Name over unit, so that narrow panels have room."""
    unit = signal.unit.replace("m/s2", "m/s²")
    if per:
        unit = f"{unit} per {per.replace('m/s2', 'm/s²')}"
    name = "\n".join(wrap(signal.name, 16, break_on_hyphens=False))
    return f"{name}\n[{unit}]" if unit else name


@dataclass(frozen=True, eq=False)
class BoundsPanel:
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


def bounds_figure(x: Array, x_label: str, panels: Sequence[BoundsPanel]) -> Figure:
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
    every = max(1, len(x) // 2000)
    for k, (ax, panel) in enumerate(zip(axes.flat, panels, strict=False)):
        if panel.passive is not None and panel.passive.any():
            ax.plot(x[::every], panel.passive[::every], **PASSIVE)
        ax.plot(x[::every], panel.values[::every], **OWN)
        ax.axhline(panel.bound, **BOUND)
        label = _wrapped(panel.label, 32)
        ax.set_ylabel(label, fontsize="medium" if label.count("\n") < 2 else 8)
        ax.set_ylim(bottom=0, top=1.08 * max(ax.get_ylim()[1] / 1.05, panel.bound))
        if k >= len(panels) - columns:
            ax.set_xlabel(x_label)
            ax.xaxis.set_tick_params(labelbottom=True)
    for ax in list(axes.flat)[len(panels) :]:
        ax.set_axis_off()
    figure.legend(handles=_cloud_handles(panels), loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


def _wrapped(label: str, width: int) -> str:
    """Return a label in lines that are no longer, as those of vectors would be."""
    lines = (wrap(line, width, break_on_hyphens=False) for line in label.splitlines())
    return "\n".join(part for line in lines for part in line)


def _cloud_handles(panels: Sequence[BoundsPanel]) -> list[Any]:
    from matplotlib.lines import Line2D

    large = {"ms": 8}
    handles = [
        Line2D([], [], label="proved for all parameters", **BOUND),
        Line2D([], [], label="with the law, at points of the family", **{**OWN, **large}),
    ]
    if any(panel.passive is not None and panel.passive.any() for panel in panels):
        handles.append(Line2D([], [], label="without control, sampled", **{**PASSIVE, **large}))
    return handles


@explained
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
        rows = [r for r in front.rows if r["method"] == method and r["answer"] == "proved"]
        pairs = sorted({(r["bounds"][0]["proved"], r["proved"]) for r in rows})
        line = [*pairs, (max(r["value"] for r in rows), pairs[-1][1])] if pairs else []
        style: dict[str, Any] = {"marker": "os^D"[k % 4]} | known[method]
        style |= {"ms": 6.5, "mfc": "none", "markevery": list(range(len(pairs)))}
        style["label"] = f"{style['label'].partition(' (Lemma')[0]}, proved"
        ax.plot([x for x, _ in line], [y for _, y in line], **style)
        dots = {(r["bounds"][0]["sampled"], r["sampled"]) for r in rows}
        seen = sorted(pair for pair in dots if None not in pair)
        x, y = [x for x, _ in seen], [y for _, y in seen]
        ax.plot(x, y, color=known[method]["color"], **SAMPLED_STYLE)
    ax.plot([], [], color="0.3", label="the same laws, worst of a sample", **SAMPLED_STYLE)
    for k, row in enumerate(front.references):
        ax.plot(row["over"], row["minimise"], **REFERENCE)
        place: dict[str, Any] = (
            {"xytext": (7, 4)} if k < 2 else {"xytext": (-7, -11), "ha": "right"}
        )
        at = (row["over"], row["minimise"])
        ax.annotate(row["name"], at, textcoords="offset points", fontsize=8.5, **place)
    ax.margins(0.06, 0.1)
    ax.set_xlabel(f"worst {front.labels[0]}")
    ax.set_ylabel(_wrapped(f"worst {front.labels[1]}", 56))
    ax.legend(loc="best", fontsize=8.5)
    return figure


def structures_figure(table: Structures) -> Figure:
    """Draw the least bound of each structure over how many numbers its law has.

    Marks of one degree and set of signals are joined in the order of their orders; the ring is the
    law that is recommended. Dots are the same laws at sampled parameters. No law goes below the
    dotted line.

    Parameters
    ----------
    table : Structures
    """
    figure, (ax,) = new_figure(1, 6.4, 4.2)
    rows = [row for row in table.rows if row["answer"] == "proved"]
    kinds = list(dict.fromkeys((row["degree"], tuple(row["measured"] or ())) for row in rows))
    alone = len(kinds) == 1
    for k, (degree, signals) in enumerate(kinds):
        of_kind = [
            r for r in rows if (r["degree"], tuple(r["measured"] or ())) == (degree, signals)
        ]
        named = ", ".join(signals) or "all states"
        label = "proved" if alone else _wrapped(f"degree {degree}, {named}", 40)
        x, y = [r["numbers"] for r in of_kind], [r["proved"] for r in of_kind]
        (line,) = ax.plot(x, y, marker="os^D"[k % 4], ms=6.5, mfc="none", label=label)
        dots = [(r["numbers"], r["sampled"]) for r in of_kind if r["sampled"] is not None]
        ax.plot(*zip(*dots, strict=True), color=line.get_color(), **SAMPLED_STYLE)
        for row in of_kind:
            ax.annotate(
                f"order {row['order']}",
                (row["numbers"], row["proved"]),
                xytext=(6, 9),
                textcoords="offset points",
                fontsize=8.5,
            )
    limit = table.limit_of_any_law
    if limit is not None:
        least = float(limit.specifications[0].at_most or 0.0)
        ax.axhline(least, color="0.3", ls=":", label="no law goes below, proved")
    chosen = table.recommended
    if chosen is not None:
        at = ([chosen["numbers"]], [chosen["proved"]])
        ax.plot(*at, "o", ms=14, mfc="none", color="0.3", label="recommended")
    ax.plot([], [], color="0.3", label="the same laws, worst of a sample", **SAMPLED_STYLE)
    ax.margins(0.15, 0.15)
    ax.set_xlabel("numbers in the law")
    ax.set_ylabel(_wrapped(f"worst {table.label}", 56))
    ax.legend(loc="best", fontsize=8.5)
    return figure


def comparison_figure(compared: Comparison) -> Figure:
    """Draw comfort, grip, travel and force of each law: worst, median and best of the family.

    Seats and wheels of a car that has several are drawn one below the other, by their names.
    """
    alike = {what: [q for q in compared.quantities if q.what == what] for what in COMPARED}
    most = max(map(len, alike.values()))
    height = 1.2 + (0.5 if most == 1 else 0.2 + 0.22 * most) * len(compared.laws)
    figure, axes = new_grid(2, 2, 9.5, 2 * height, sharey=True)
    places = np.arange(len(compared.laws))[::-1]
    for ax, (what, columns) in zip(axes.flat, alike.items(), strict=True):
        apart = 0.8 / len(columns)
        for i, column in enumerate(columns):
            rows = [compared.row(law, column.name) for law in compared.laws]
            best, worst, middle = zip(*((r.best, r.worst, r.median) for r in rows), strict=True)
            at = places + ((len(columns) - 1) / 2 - i) * apart
            label = None if i else "over the family"
            ax.hlines(at, best, worst, color="#2166ac", lw=5 if most == 1 else 3.5, label=label)
            size = 14 if most == 1 else 9
            ax.plot(worst, at, "|", color="#b2182b", ms=size, mew=2.2, label="worst")
            ax.plot(middle, at, "o", color="white", mec="#2166ac", ms=0.35 * size, label="median")
            if len(columns) > 1:
                for x, y in zip(worst, at, strict=True):
                    ax.annotate(
                        column.place, (x, y), (5, 0), textcoords="offset points", fontsize=7,
                        va="center", color="0.35",
                    )  # fmt: skip
        ax.set(xlabel=f"{what} [{columns[0].unit}]", ylim=(-0.6, len(places) - 0.4))
        ax.set_yticks(places, compared.laws)
        ax.set_xlim(left=0)
        if len(columns) > 1:
            ax.set_xlim(right=1.2 * ax.get_xlim()[1])  # room for the names
        ax.locator_params(axis="x", nbins=6)
    handles, _ = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles=handles[:3], loc="outside lower center", ncols=3, fontsize=8.5)
    figure.suptitle(
        f"{compared.plant.name}: class {compared.road} at {compared.speed:g} m/s{compared.when}",
        fontsize=9.5,
    )
    return figure


def margins_figure(margins: Margins) -> Figure:
    """Draw each margin in service as a share of the error that breaks it.

    Dashed: no error that breaks it is known.
    """
    rows = list(margins)
    figure, (ax,) = new_figure(1, 8.5, 1.1 + 0.42 * len(rows))
    places = np.arange(len(rows))[::-1]
    for y, margin in zip(places, rows, strict=True):
        said = f"{margin.text} {margin.unit} proved" if margin.proved else "undecided"
        share, style = 100.0, {"fc": "none", "ec": "#2166ac", "ls": "--"}
        if margin.upper is not None:
            said += f", breaks at {digits_up(margin.upper, 4)}"
            share, style = (
                100 * margin.value / margin.upper if margin.upper else 0.0,
                {"color": "#2166ac"},
            )
        else:
            said += ", no break is sought" if margin.kind == "rate" else ", no break was found"
        ax.barh(y, share, height=0.6, **style)
        ax.text(102, y, " ".join(said.split()), va="center", fontsize=8.5)
    ax.set_yticks(places, [margin.subject for margin in rows], fontsize=8.5)
    ax.set(xlim=(0, 100), xlabel="proved, as a share of the error that breaks it [%]")
    ax.set_title(
        f"{margins.design.plant.name}: all poles in {short_text(margins.region)}", fontsize=9.5
    )
    return figure


def concepts_figure(results: Concepts) -> Figure:
    """Draw what is proved of suspension concepts and what they have in drives, beside the limits.

    On the right their tyre load over their acceleration, in drives.

    Parameters
    ----------
    found : Concepts
    """
    figure, (left, right) = new_figure(2, 9.6, 3.9, width_ratios=[1.25, 1])
    names = [one.name for one, _ in results.rows]
    y = np.arange(len(names))[::-1]
    costs = [ridden.cost for _, ridden in results.rows]
    levels = [np.nan if one.level is None else one.level for one, _ in results.rows]
    edge = 1.6 * np.nanmin(costs)  # farther bounds are told, not drawn
    for k, level in zip(y, levels, strict=True):
        if level > edge:
            left.annotate(f"{level:.2f} \u2192", (edge, k), ha="right", va="center", fontsize=8.5)
    drawn = [level if level <= edge else np.nan for level in levels]
    left.hlines(y, costs, np.minimum(levels, edge * 0.93), color="0.8", zorder=1)
    left.plot(
        drawn, y, ls="", marker="|", ms=15, mew=2.2, color="black", label="proved, every load"
    )
    left.plot(costs, y, ls="", marker="o", ms=5.5, color="#2166ac", label="drives, worst load")
    lowest = {"no semi-active law below": (results.semi_active, "--")}
    lowest["no law below"] = (results.active, ":")
    # limits that are nearer than a thousandth are drawn as one
    if results.active and results.semi_active and results.semi_active < 1.001 * results.active:
        del lowest["no semi-active law below"]
    for label, (limit, dashes) in lowest.items():
        if limit is not None:
            left.axvline(limit, color="#b2182b", ls=dashes, lw=1.3, label=label, zorder=0.9)
    left.set_yticks(y, names)
    left.set_xlim(0.97 * np.nanmin([*costs, results.active or np.nan]), edge)
    title, entries = results.specification.title, results.specification.entries
    if len(title) > MOST_TITLE:
        title = f"{results.specification.kind} of {len(entries)} signals that are asked for"
    left.set_xlabel(_wrapped(title, 48))
    driven = (row for row in results.rows if math.isfinite(row[1].cost))
    across = sorted(driven, key=lambda row: row[1].acceleration)
    for k, (one, ridden) in enumerate(across):
        damped, x = bool(one.dampers) or not one.sensors, ridden.acceleration
        colour = "#2166ac" if damped else "#b2182b"
        right.plot(x, ridden.tyre, ls="", ms=6, marker="o" if damped else "s", color=colour)
        first = k <= len(across) // 2
        offset = (6 if first else -6, 5 if k % 2 else -12)
        where: dict[str, Any] = {"xytext": offset, "ha": "left" if first else "right"}
        at = (x, ridden.tyre)
        right.annotate(one.name, at, textcoords="offset points", fontsize=8.5, **where)
    several = results.plant.shape[1] > 1
    seat, wheel = "sprung-mass acceleration", "tyre load variation, "
    if several:
        seat, wheel = "acceleration, worst seat", "tyre load variation,\nworst wheel, "
    right.set_xlabel(f"{seat}, rms [m/s2]")
    right.set_ylabel(f"{wheel}rms [N]")
    right.margins(0.14)
    figure.legend(
        *left.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8.5
    )
    return figure
