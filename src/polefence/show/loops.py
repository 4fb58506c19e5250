"""Nyquist, Bode and Nichols plots of loops that are opened at one place, over a family."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.explained import explained
from polefence.plant.system import Array
from polefence.proof.text import visible
from polefence.region.text import digits_down
from polefence.response.loop_margins import LeastMargin, LoopMargins, disk_ranges
from polefence.show.plots import MANY, VERTEX, new_figure, new_grid, typeset

if TYPE_CHECKING:  # imported where used
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 16  # points of a family that are drawn beside its vertices
EVEN = 320  # frequencies, even in their logarithm; others are near poles
RESOLVED = 8  # vertices of which the poles have frequencies near them
CLOSE = 1e-3  # of frequencies that are one, relative
LOUD = 400.0  # size [dB] of what is infinite, or zero
FAR, LEAP = 270.0, 60.0  # [deg] from the middle's phase; of a line that is broken
# Told apart in grey: solid, dashed.
MIDDLE: dict[str, Any] = {"color": "black", "lw": 1.4, "zorder": 3}
LEAST: dict[str, Any] = {"color": "#2166ac", "lw": 1.5, "ls": (0, (4, 1.5)), "zorder": 3.2}
CRITICAL: dict[str, Any] = {"color": "black", "marker": "+", "ms": 9, "mew": 1.8, "ls": ""}
DISK: dict[str, Any] = {"facecolor": "#f6d8c4", "edgecolor": "0.3"}
MARK: dict[str, Any] = {"marker": "o", "ms": 5, "mfc": "white", "mec": "black", "zorder": 5}
SPAN: dict[str, Any] = {"color": "black", "lw": 1.1, "zorder": 4}
LABEL: dict[str, Any] = {"fontsize": 8, "zorder": 6}
BOX: dict[str, Any] = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85}
GRID = 241  # points a side, on which the edge of a disk is drawn


@explained
def nyquist_figure(found: LoopMargins, proved: float | None = None) -> Figure:
    """Draw L in the complex plane over the family, for frequencies of zero and above.

    The disk holds what no L may be for its margin: the least one of the points, or one that is
    proved. Margins are marked on the curve that they are of.

    Parameters
    ----------
    proved : float, optional
        A disk margin of this skew that is proved, in place of the sampled one.
    """
    curves = _curves(found, proved)
    figure, (ax,) = new_figure(1, 5.6, 5.9)
    _nyquist(ax, curves)
    _finished(figure, curves, 2)
    return figure


@explained
def bode_figure(found: LoopMargins, proved: float | None = None) -> Figure:
    """Draw size and phase of L over the frequency, over the family; as `nyquist_figure` does."""
    curves = _curves(found, proved)
    figure, axes = new_grid(2, 1, 6.4, 6.2, sharex=True)
    _bode(axes[:, 0], curves)
    _finished(figure, curves, 2, disk=False)
    return figure


@explained
def nichols_figure(found: LoopMargins, proved: float | None = None) -> Figure:
    """Draw the size of L over its phase, over the family; as `nyquist_figure` does."""
    curves = _curves(found, proved)
    figure, (ax,) = new_figure(1, 5.8, 5.6)
    _nichols(ax, curves)
    _finished(figure, curves, 2)
    return figure


@explained
def loop_figure(found: LoopMargins, proved: float | None = None) -> Figure:
    """Draw Nyquist, Bode and Nichols plots of L over the family, as `nyquist_figure` does."""
    curves = _curves(found, proved)
    figure, axes = new_grid(2, 2, 9.6, 8.8)
    _nyquist(axes[0, 0], curves)
    _nichols(axes[1, 0], curves)
    axes[0, 1].sharex(axes[1, 1])
    _bode(axes[:, 1], curves)
    _finished(figure, curves, 3)
    return figure


HEAD = ("loop", "gain", "phase", "delay", "disk margin", "the disk margin is least at")


def margins_row(found: LoopMargins, proved: float | None = None) -> tuple[str, ...]:
    """Return the least margins of a loop in words, under `HEAD`: sampled but for what is proved."""
    place = found.opened.place
    lower, upper, phase, delay, disk = found.least
    name = f"{place.label}, {'input' if place.kind == 'input' else 'measured'}"
    if not found.stable.all():
        return (name, *("none",) * 4, f"not stable{_at(found, disk)}")
    gain = f"{lower.value:.4g} to {'any' if math.isinf(upper.value) else f'{upper.value:.4g}'}"
    late = "any" if math.isinf(delay.value) else f"{_text(delay)}{_hertz(delay)}"
    where = f"{_hertz(disk)}{_at(found, disk)}".lstrip(", ") or "any frequency"
    least = f"{disk.value:.3g}" + (f", skew {found.sigma:g}" if found.sigma else "")
    least += "" if proved is None else f"; {digits_down(proved, 4)} proved"
    return name, gain, f"{_text(phase)}{_hertz(phase)}", late, least, where


def _at(found: LoopMargins, least: LeastMargin) -> str:
    return "" if len(found.opened.plant.vertices) == 1 else f", {found.where(least)}"


def _hertz(least: LeastMargin) -> str:
    return f", {least.frequency:.3g} Hz" if math.isfinite(least.frequency) else ""


@dataclass(frozen=True, eq=False)
class _Curves:
    """L over the frequency [Hz] at some of the points, its size [dB] and phase [deg]."""

    found: LoopMargins
    frequency: Array
    rows: Any
    L: Any
    size: Array
    phase: Array
    middle: int
    disk: LeastMargin
    proved: float | None

    @property
    def margin(self) -> float:
        """Of the disk that is drawn."""
        return self.disk.value if self.proved is None else self.proved

    def drawn(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield curves by their number, in the order in which they are drawn, and their looks."""
        alpha = self.found.opened.alpha[self.rows]
        vertex = alpha.max(axis=1) == 1
        single = len(self.rows) == 1
        for k in [*np.flatnonzero(~vertex).tolist(), *np.flatnonzero(vertex).tolist()]:
            if not single:
                yield k, VERTEX if vertex[k] else {**MANY, "rasterized": True}
        yield self.number(self.middle), MIDDLE
        if not single:
            yield self.number(self.disk.number), LEAST

    def number(self, row: int) -> int:
        """Return the number of the curve of a point."""
        return int(np.flatnonzero(self.rows == row)[0])

    def marks(self) -> Iterator[tuple[LeastMargin, float, complex, float]]:
        """Yield the margins that are marked, with frequency, L and its phase [deg] there."""
        for least in self.found.least:
            if least.name == "disk" or not math.isfinite(least.frequency):
                continue
            L = self.found.opened.take([least.number]).loop([least.frequency])[0, 0]
            at_one = abs(abs(L) - 1) < 1e-3 or least.name in ("lower", "upper")
            if np.isfinite(L) and abs(L) > 0 and at_one:
                k = self.number(least.number)
                near = np.interp(least.frequency, self.frequency, self.phase[k])
                turn = math.degrees(np.angle(L))
                yield least, least.frequency, complex(L), turn + 360 * round((near - turn) / 360)


def _curves(found: LoopMargins, proved: float | None) -> _Curves:
    loop, least = found.opened, found.least
    middle = int(np.abs(loop.alpha - 1 / loop.alpha.shape[1]).max(axis=1).argmin())
    vertices = np.flatnonzero(loop.alpha.max(axis=1) == 1)
    others = np.setdiff1d(np.arange(len(loop.alpha)), vertices)
    named = [middle, *(one.number for one in least)]
    rows = np.unique([*vertices, *others[:: max(1, len(others) // MOST)], *named])
    marked = [one.frequency for one in least if 0 < one.frequency < math.inf]
    resolved = loop.take(np.unique([*named, *vertices[:RESOLVED]]))
    frequency = _frequencies(resolved, np.array(marked))
    L = loop.take(rows).loop(frequency)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.nan_to_num(20 * np.log10(np.abs(L)), nan=LOUD, posinf=LOUD, neginf=-LOUD)
    phase = _phases(L, int(np.flatnonzero(rows == middle)[0]))
    return _Curves(found, frequency, rows, L, size, phase, middle, least[-1], proved)


def _frequencies(loop: Any, marked: Array) -> Array:
    """Return frequencies [Hz]: a range about all poles, and near each pole of L and of the loop."""
    open_loop = loop.A - loop.E @ loop.C / np.where(loop.F == 0, 1, loop.F)
    poles = np.concatenate([loop.poles(), np.linalg.eigvals(open_loop)]).ravel()
    T = loop.step
    if T:  # as rates of continuous time
        poles = np.log(1 + T * poles + 1e-12) / T
    size, swing = np.abs(poles), np.abs(poles.imag)
    some = size[size > 1e-6 * size.max(initial=0)]
    low, high = (some.min(), some.max()) if len(some) else (1.0, 1.0)
    marked = 2 * np.pi * marked
    last = np.pi / T if T else float(np.max([5 * high, *(3 * marked)]))
    low = float(np.min([low / 5, last / 10, *(marked / 3)]))
    sharp = (np.abs(poles.real) < 0.2 * swing) & (swing > 0)
    widths = np.maximum(np.abs(poles.real[sharp]), 1e-3 * swing[sharp])[:, None]
    near = swing[sharp][:, None] + widths * np.array(
        [-30, -15, -8, -4, -2, -1, -0.5, 0, 0.5, 1, 2, 4, 8]
    )
    w = np.unique(np.concatenate([np.geomspace(low, last, EVEN), near.ravel()]))
    w = w[np.append(True, np.diff(w) > CLOSE * w[1:]) & (w >= low) & (w <= last)]
    return np.unique(np.concatenate([w, marked])) / (2 * np.pi)


def _phases(L: Any, middle: int) -> Array:
    """Return phases [deg] that begin between -270 and 90, as those of loops without a delay do.

    One that has gone far from the middle's, by a pole or a zero on the other side of the axis, goes
    on a whole turn nearer.
    """
    with np.errstate(invalid="ignore"):
        phase = np.degrees(np.unwrap(np.where(np.isfinite(L), np.angle(L), 0.0), axis=1))
    phase -= 360 * np.ceil((phase[:, :1] - 90) / 360)
    apart = phase[middle] - phase
    turns = np.zeros(len(phase))
    for k, column in enumerate(apart.T):
        far = np.abs(column - 360 * turns) > FAR
        turns = np.where(far, np.round(column / 360), turns)
        apart[:, k] = 360 * turns
    return np.asarray(phase + apart)


def _nyquist(ax: Axes, curves: _Curves) -> None:
    L = curves.L[np.abs(curves.L) < 2.4]
    edge = disk_ranges(curves.margin, curves.found.sigma).lower  # the disk's is at -1 over it
    left = min(-1.7, float(L.real.min(initial=0)) - 0.2, -1 / max(edge, 0.3) - 0.2)
    right = max(0.7, float(L.real.max(initial=0)) + 0.2)
    half = max(1.25, float(np.abs(L.imag).max(initial=0)) + 0.2, (right - left) / 2.4)
    middle, half = (left + right) / 2, max(half, (right - left) / 2)
    left, right = middle - half, middle + half
    x, y = np.linspace(left, right, GRID), np.linspace(-half, half, GRID)
    _shade(ax, curves, x, y, x[None, :] + 1j * y[:, None])
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 361))
    ax.plot(circle.real, circle.imag, color="0.55", lw=0.8, ls=":", zorder=0.9)
    for spine in (ax.axhline, ax.axvline):
        spine(0, color="0.6", lw=0.7, zorder=0.8)
    for k, look in curves.drawn():
        values = np.where(np.abs(curves.L[k]) < 50, curves.L[k], np.nan)
        ax.plot(values.real, values.imag, **look)
    ax.plot(-1, 0, zorder=4, **CRITICAL)
    for least, _, at, _ in curves.marks():
        if abs(at.real - middle) < half and abs(at.imag) < half and least.name != "delay":
            ax.plot(at.real, at.imag, **MARK)
            _said(ax, _text(least), at.real, at.imag, ASIDE[least.name])
    ax.set_xlim(left, right)
    ax.set_ylim(-half, half)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("Re L")
    ax.set_ylabel("Im L")


def _bode(axes: Any, curves: _Curves) -> None:
    sizes, phases = axes
    for ax in axes:
        ax.set_xscale("log")
        ax.set_xlim(curves.frequency[0], curves.frequency[-1])
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter("")
    for k, look in curves.drawn():
        sizes.plot(curves.frequency, curves.size[k], **look)
        phases.plot(curves.frequency, _broken(curves.phase[k], 200.0), **look)
    sizes.axhline(0, color="0.4", lw=0.8)
    for turn in _turns(curves.phase):
        phases.axhline(turn, color="0.4", lw=0.8)
    turned, late = curves.found.least[2:4]
    one = turned.number == late.number and math.isclose(turned.frequency, late.frequency)
    for least, frequency, L, phase in curves.marks():
        if least.name in ("lower", "upper"):
            size = 20 * math.log10(abs(L))
            sizes.plot([frequency] * 2, [0, size], **SPAN)
            sizes.plot(frequency, size, **MARK)
            _said(sizes, _text(least), frequency, size, BESIDE[least.name == "upper"])
        elif not (one and least.name == "delay"):
            turn = -180.0 + 360 * round((phase + 180) / 360)
            if least.name == "delay" and turn > phase:  # which a lag makes
                turn -= 360
            phases.plot([frequency] * 2, [turn, phase], **SPAN)
            phases.plot(frequency, phase, **MARK)
            text = f"{_text(turned)}, {_text(late)}" if one else _text(least)
            _said(phases, text, frequency, (phase + turn) / 2, BESIDE[2])
    low, high = float(curves.size.min()), float(curves.size.max())
    sizes.set_ylim(max(low, -60) - 5, max(min(high, 60), 0) + 5)
    sizes.xaxis.set_tick_params(labelbottom=False)
    sizes.set_ylabel("|L| [dB]")
    phases.set_ylabel("arg L [deg]")
    phases.yaxis.set_major_locator(_steps(curves.phase, 45))
    phases.set_xlabel("frequency [Hz]")


def _nichols(ax: Axes, curves: _Curves) -> None:
    size, phase = curves.size, curves.phase
    shown = (size > -30) & (size < 30)
    ends = phase[shown] if shown.any() else phase
    left, right = min(float(ends.min()), -270.0) - 10, max(float(ends.max()), -90.0) + 10
    low, high = -32.0, 32.0
    x, y = np.linspace(left, right, GRID), np.linspace(low, high, GRID)
    L = 10 ** (y[:, None] / 20) * np.exp(1j * np.radians(x[None, :]))
    _shade(ax, curves, x, y, L)
    ax.axhline(0, color="0.6", lw=0.7, zorder=0.8)
    for turn in _turns(np.array([left, right])):
        ax.axvline(turn, color="0.6", lw=0.7, zorder=0.8)
        ax.plot(turn, 0, **CRITICAL, zorder=4)
    for k, look in curves.drawn():
        ax.plot(_broken(phase[k]), size[k], **look)
    for least, _, at, turn in curves.marks():
        if least.name != "delay" and low < 20 * math.log10(abs(at)) < high:
            ax.plot(turn, 20 * math.log10(abs(at)), **MARK)
            _said(ax, _text(least), turn, 20 * math.log10(abs(at)), ASIDE[least.name])
    ax.set_xlim(left, right)
    ax.set_ylim(low, high)
    ax.xaxis.set_major_locator(_steps(np.array([left, right]), 45))
    ax.set_xlabel("arg L [deg]")
    ax.set_ylabel("|L| [dB]")


def _broken(phase: Array, leap: float = LEAP) -> Array:
    """Return a phase without what a line would leap over: zeros, and whole turns."""
    return np.where(np.abs(np.diff(phase, prepend=phase[0])) > leap, np.nan, phase)


def _shade(ax: Axes, curves: _Curves, x: Array, y: Array, L: Any) -> None:
    """Shade what L may not be: where |S + (sigma - 1)/2| is above 1 over the margin."""
    margin = curves.margin
    if not margin > 0:
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.abs(1 / (1 + L) + (curves.found.sigma - 1) / 2) * margin
    height = np.nan_to_num(height, nan=1e6, posinf=1e6)
    top = max(float(height.max()), 2.0)
    ax.contourf(x, y, height, levels=[1.0, 2 * top], colors=[DISK["facecolor"]], zorder=0.4)
    if height.min() < 1 < height.max():
        ax.contour(
            x, y, height, levels=[1.0], colors=[DISK["edgecolor"]], linewidths=0.9, zorder=0.5
        )


def _turns(phase: Array) -> list[float]:
    """Return phases of -1 [deg] within a range."""
    first = math.ceil((float(phase.min()) - 180) / 360)
    last = math.floor((float(phase.max()) - 180) / 360)
    return [180.0 + 360 * k for k in range(first, last + 1)] or [-180.0]


def _steps(phase: Array, step: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    while float(np.ptp(phase)) > 9 * step:
        step *= 2
    return MultipleLocator(step)


# Where the text of a margin stands, beside its mark: offset [points], alignment.
ASIDE: dict[str, tuple[tuple[int, int], str]] = {
    "lower": ((0, 8), "center"),
    "upper": ((0, -15), "center"),
    "phase": ((8, -4), "left"),
    "delay": ((6, -3), "left"),
}
BESIDE = (((6, 5), "left"), ((6, -11), "left"), ((6, -3), "left"))


def _said(ax: Axes, text: str, x: float, y: float, where: tuple[tuple[int, int], str]) -> None:
    offset, side = where
    across = ax.transAxes.inverted().transform(ax.transData.transform((x, y)))[0]
    if across > (0.8 if side == "left" else 0.85):  # room for the text
        offset, side = (-offset[0], offset[1]), "right"
    elif across < 0.15 and side == "center":
        side = "left"
    ax.annotate(text, (x, y), offset, textcoords="offset points", ha=side, bbox=BOX, **LABEL)


def _text(least: LeastMargin) -> str:
    """Say a margin with its unit."""
    if least.name in ("lower", "upper"):
        if least.value <= 0:
            return "\u00d7 0"
        decibels = 20 * math.log10(least.value)
        return f"\u00d7 {least.value:.4g} ({decibels:+.{3 if abs(decibels) >= 1 else 2}g} dB)"
    if least.name == "phase":
        return f"{least.value:.3g}\u00b0"
    return f"{least.value:.3g} s" if least.value >= 1 else f"{1000 * least.value:.3g} ms"


def _folded(text: str, width: int = 44) -> str:
    """Return a text in lines that end between its parts."""
    parts = ", ".join(part.replace(" ", "\u00a0") for part in text.split(", "))
    return fill(parts, width).replace("\u00a0", " ")


def _finished(figure: Figure, curves: _Curves, columns: int, disk: bool = True) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found, place = curves.found, curves.found.opened.place
    named: list[tuple[dict[str, Any], str]] = [(MIDDLE, "L")]
    if len(curves.rows) > 1:
        named = [(MIDDLE, "middle of the family"), (VERTEX, "vertices"), (MANY, "other points")]
        named.append((LEAST, _folded(f"least disk margin{_at(found, curves.disk)}")))
    handles: list[Any] = [Line2D([], [], label=text, **look) for look, text in named]
    how = "sampled" if curves.proved is None else "proved"
    if disk and curves.margin > 0:
        handles.append(
            Patch(label=f"disk of margin {digits_down(curves.margin, 4)}, {how}", **DISK)
        )
    handles.append(Line2D([], [], ls="", label="least margins, sampled", **MARK))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=8.5)
    where = "at the input" if place.kind == "input" else "at the measured"
    skew = f", skew {found.sigma:g}" if found.sigma else ""
    figure.suptitle(
        typeset(visible(f"{found.opened.plant.name}: loop opened {where} {place.name!r}{skew}")),
        fontsize=9.5,
    )
