"""Figures. Data in, Figure out; no file is touched."""

from polefence.show.plots.performance import bounds_figure, front_figure
from polefence.show.plots.plots import (
    analysis_figure,
    limits_figure,
    new_figure,
    new_grid,
    poles_figure,
    render,
    table_figure,
)
from polefence.show.plots.signals import (
    bands_figure,
    frequency_figure,
    responses_figure,
    signals_figure,
)

__all__ = [
    "analysis_figure",
    "bands_figure",
    "bounds_figure",
    "frequency_figure",
    "front_figure",
    "limits_figure",
    "new_figure",
    "new_grid",
    "poles_figure",
    "render",
    "responses_figure",
    "signals_figure",
    "table_figure",
]
