"""Figures 1 and 2 of Leite & Peres (2005), drawn afresh: the quarter car, the circular region."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.region.regions import Disk
from polefence.show.plots import draw_region, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARROW: Any = {"arrowstyle": "->", "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
LINE: Any = {"color": "black", "lw": 1.3, "solid_capstyle": "round"}


def quarter_car_figure(values: Mapping[str, str]) -> Figure:
    """Draw the quarter car: two masses, spring, damper and actuator between them, a tyre.

    Parameters
    ----------
    values : mapping
        Texts for ``m1``, ``m2``, ``k``, ``c`` and ``kt``.
    """
    from matplotlib.patches import Rectangle

    figure, (ax,) = new_figure(1, 6.0, 4.2)
    for y, name in ((6.2, "m1"), (2.6, "m2")):
        ax.add_patch(Rectangle((0, y), 5, 1.0, fc="0.9", ec="black", lw=1.3))
        ax.text(
            2.5,
            y + 0.5,
            f"{name.replace('1', '₁').replace('2', '₂')} = {values[name]}",
            ha="center",
            va="center",
        )
    _spring(ax, 0.7, 3.6, 6.2)
    ax.text(0.2, 4.9, f"k = {values['k']}", ha="right", va="center")
    _damper(ax, 3.1, 3.6, 6.2)
    ax.text(1.9, 4.9, f"c =\n{values['c']}", ha="center", va="center", fontsize=9)
    ax.add_patch(Rectangle((3.9, 4.4), 0.8, 1.0, fc="white", ec="black", lw=1.3))
    ax.plot([4.3, 4.3], [3.6, 4.4], **LINE)
    ax.plot([4.3, 4.3], [5.4, 6.2], **LINE)
    ax.text(4.3, 4.9, "u", ha="center", va="center")
    _spring(ax, 2.5, 0.6, 2.6)
    ax.text(2.05, 1.6, f"kₜ = {values['kt']}", ha="right", va="center")
    ax.plot([0, 5], [0.6, 0.6], **LINE)
    for x in np.arange(0.0, 5.0, 0.4):
        ax.plot([x, x + 0.25], [0.25, 0.6], color="0.5", lw=0.8)
    for y, text in (
        (6.2, "x₃, velocity of m₁"),
        (2.6, "x₄, velocity of m₂"),
        (0.6, "w, velocity of the road"),
    ):
        ax.annotate("", (5.5, y + 1.0), (5.5, y), arrowprops=ARROW)
        ax.text(5.65, y + 0.5, text, va="center", fontsize=9)
    for low, high, text in ((3.6, 6.2, "x₁, suspension"), (0.6, 2.6, "x₂, tyre")):
        ax.annotate("", (5.2, low), (5.2, high), arrowprops={**ARROW, "arrowstyle": "<->"})
        ax.text(5.35, (low + high) / 2 + 0.35, text, va="center", fontsize=9)
    ax.set(xlim=(-2.6, 9.3), ylim=(0, 7.5), aspect="equal")
    ax.set_axis_off()
    return figure


def disk_figure(disk: Disk) -> Figure:
    """Draw a circular region with its centre, its radius, and its distance from the axis."""
    figure, (ax,) = new_figure(1, 5.2, 4.0)
    centre, radius = float(disk.centre), float(disk.radius)
    draw_region(ax, disk, (centre - 1.25 * radius, 0.35 * radius, 1.2 * radius))
    ax.axvline(0, color="0.3", lw=0.8)
    ax.axhline(0, color="0.3", lw=0.8)
    edge = centre + radius * np.exp(0.75j * np.pi)
    ax.annotate("", (edge.real, edge.imag), (centre, 0), arrowprops=ARROW)
    ax.text(centre - 0.48 * radius, 0.3 * radius, "r", fontsize=12)
    ax.text(centre, -0.13 * radius, "−σ", ha="center", fontsize=12)
    end = centre + radius
    if end < 0:
        y = -0.55 * radius
        ax.plot([end, end], [y, 0], ls=":", color="black", lw=1)
        ax.annotate("", (end, y), (0, y), arrowprops={**ARROW, "arrowstyle": "<->"})
        ax.text(end / 2, y - 0.14 * radius, "d", ha="center", fontsize=12)
    ax.set(xlabel="real part [1/s]", ylabel="imaginary part [rad/s]", aspect="equal")
    return figure


def _spring(ax: Axes, x: float, low: float, high: float) -> None:
    """Draw a spring that stands upright."""
    ends = 0.15 * (high - low)
    turns = np.linspace(low + ends, high - ends, 13)
    across = x + np.where(np.arange(13) % 2, 0.3, -0.3)
    across[[0, -1]] = x
    ax.plot([x, *across, x], [low, *turns, high], **LINE)


def _damper(ax: Axes, x: float, low: float, high: float) -> None:
    """Draw a damper that stands upright."""
    middle, half = (low + high) / 2, 0.18 * (high - low)
    ax.plot([x, x], [low, middle - half], **LINE)
    ax.plot([x, x], [middle, high], **LINE)
    ax.plot(
        [x - 0.4, x - 0.4, x + 0.4, x + 0.4],
        [middle + half, *[middle - half] * 2, middle + half],
        **LINE,
    )
    ax.plot([x - 0.33, x + 0.33], [middle, middle], **LINE)
