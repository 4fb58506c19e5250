"""Colours that red-green blind readers tell apart, as anybody does in grey."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bokeh.plotting import figure


@dataclass(frozen=True)
class Palette:
    """Colours of a page.

    Attributes
    ----------
    inside : str
        Of a region.
    cars, looked : str
        Of all cars, and of the one that is looked at.
    ghost : str
        Of what is there to compare with.
    ink, paper, faint : str
    trails : tuple of str
    """

    inside: str
    cars: str
    ink: str
    paper: str
    faint: str
    looked: str = "#e66101"
    ghost: str = "#8a8a8a"
    trails: tuple[str, ...] = ("#e66101", "#8073ac", "#009e73", "#cc79a7")


LIGHT = Palette("#c3dcf3", "#2b5c8a", "#111111", "#ffffff", "#e0e0e0")
DARK = Palette("#1d3a55", "#8ec1ee", "#f0f0f0", "#121212", "#3a3a3a")


def small_figure(name: str, **options: Any) -> Any:
    """Return a figure as wide as its column, without tools."""
    shared = {"min_width": 280, "sizing_mode": "stretch_width"}
    return figure(name=name, tools="", toolbar_location=None, **(shared | options))


def coloured(plot: Any, palette: Palette) -> None:
    """Give a figure the colours of a page."""
    plot.background_fill_color = plot.border_fill_color = palette.paper
    plot.outline_line_color = plot.grid.grid_line_color = palette.faint
    for axis in (*plot.xaxis, *plot.yaxis):
        axis.axis_label_text_color = axis.major_label_text_color = palette.ink
        axis.axis_line_color = axis.major_tick_line_color = palette.ink
        axis.minor_tick_line_color = None
    for legend in plot.legend:
        legend.label_text_color = palette.ink
        legend.background_fill_color, legend.background_fill_alpha = palette.paper, 0.7
        legend.border_line_color = palette.faint


# The button that is chosen of several, on light and on dark.
CHOSEN = ".bk-btn.bk-active { font-weight: 700; text-decoration: underline; }"

# Labels are no wider than the window, however long a name is.
FITTED = """
:host { min-width: 0; max-width: 100%; }
.bk-input-group, .bk-slider-title, .bk-label, .bk-slider-value, label, span {
  white-space: normal; overflow-wrap: anywhere; min-width: 0; max-width: 100%;
}
"""

# Of what is HTML. Words and marks say what colours say.
STYLE = """
:host { min-width: 0; max-width: 100%; overflow-wrap: anywhere; }
p { margin: 4px 0; }
.badge { font-weight: 600; font-size: 12px; padding: 3px 8px; border-radius: 4px; }
.badge { border: 2px solid; }
.badge { box-sizing: border-box; max-width: 100%; overflow-wrap: anywhere; }
.proved { border-color: #2b5c8a; }
.proved::before { content: "\\2713  "; }
.refuted { border-color: #d95f02; border-style: double; }
.refuted::before { content: "\\2717  "; }
.undecided, .working { border-color: #888888; border-style: dashed; }
.loops { border-collapse: collapse; margin-top: 12px; }
.loops th { text-align: left; font-weight: normal; }
.loops th, .loops td { padding: 2px 8px 2px 0; vertical-align: top; }
.loops + img { display: block; max-width: 460px; width: 100%; }
.margins { border-collapse: collapse; }
.margins th { text-align: left; font-weight: normal; }
.margins th, .margins td { padding: 2px 10px 2px 0; }
.bar { width: 110px; height: 12px; border: 1px solid #8a8a8a; }
.bar div { height: 100%; background: #2b5c8a; }
.copy { font: inherit; margin-top: 4px; }
summary { cursor: pointer; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; margin: 4px 0 8px; }
"""
