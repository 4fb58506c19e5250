"""One HTML page about the rows of a study: how each question was answered over the variants."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.plant.system import Array
from polefence.region.text import digits_down, digits_up
from polefence.show.plots import new_figure
from polefence.show.report import Section, Table, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]
FAILED = "#b2182b"
MARKERS = "osD^v"


def fleet_page(
    name: str,
    names: Sequence[str],
    questions: Sequence[tuple[str, bool]],
    rows: Sequence[Row],
    failed: Sequence[tuple[Row, int]],
    note: str = "",
) -> str:
    """Return the page.

    Parameters
    ----------
    name : str
        Of the study.
    names : sequence of str
        Of the numbers that vary.
    questions : sequence of (str, bool)
        Their names, and whether a bound is the better the larger it is.
    rows : sequence of mapping
        As the store has them, with a "value" to be shown, or None.
    failed : sequence of (mapping, int)
        The first of rows that failed alike, and how many there are.
    note : str
        What is not proved of the variants.
    """
    rows = sorted(rows, key=lambda row: row["variant"])
    variants = len({row["variant"] for row in rows})
    proved = sum(row["status"] == "proved" for row in rows)
    sections = [_overview(questions, rows)]
    for question, largest in questions:
        asked = [row for row in rows if row["question"] == question]
        if any(_finite(row) for row in asked):
            sections.append(_question(question, largest, names, asked))
        elif asked and asked[0]["ask"] == "cover" and any(row["law"] for row in asked):
            sections.append(_laws(question, names, asked))
    if failed:
        sections.append(_failures(failed))
    title = f"{name}: {variants} variants"
    sampled = sum(row["status"] == "sampled" for row in rows)
    answer = f"{proved} of {len(rows)} answers proved"
    answer += f", {sampled} sampled" if sampled else ""
    return page(title, "; ".join(filter(None, (answer, note))), sections)


def _finite(row: Row) -> bool:
    return row["value"] is not None and bool(np.isfinite(row["value"]))


def _overview(questions: Sequence[tuple[str, bool]], rows: Sequence[Row]) -> Section:
    cells = []
    for question, largest in questions:
        asked = [row for row in rows if row["question"] == question]
        counts = Counter(row["status"] for row in asked)
        bounds = sorted(row["value"] for row in asked if _finite(row))
        digits, unit = (digits_down if largest else digits_up), asked[0]["unit"] if asked else ""
        span = ["-"] * 3
        if bounds:
            span = [digits(bounds[k]) for k in (0, len(bounds) // 2, -1)]
        seconds = sum(row["seconds"] for row in asked)
        said = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
        cells.append((question, said, *span, unit, f"{seconds:.3g} s"))
    head = ("question", "answers", "least", "middle", "largest", "unit", "worked")
    return Section("Questions", table=Table(head, tuple(cells)))


def _question(question: str, largest: bool, names: Sequence[str], rows: Sequence[Row]) -> Section:
    known = [row for row in rows if _finite(row)]
    better = "the larger the better" if largest else "the smaller the better"
    ratios = sorted(
        row["value"] / (row["worst"] or row["least"])
        for row in known
        if row["bound"] is not None and (row["worst"] or row["least"])
    )
    crosses = " Red crosses: variants without one." if len(known) < len(rows) else ""
    sampled = known[0]["status"] == "sampled"
    what = "Worst samples (not proved)" if sampled else "Proved bounds"
    text = [f"{what}; {better}.{crosses}"]
    if ratios:
        middle, last = (digits_up(ratios[k]) for k in (len(ratios) // 2, -1))
        beside = "the worst sample" if known[0]["worst"] else "the proved lower limit"
        text.append(f"The bound is {middle} times {beside} in the middle, {last} times at most.")
    figure = _figure(known, [row for row in rows if not _finite(row)], names)
    return Section(question, tuple(text), figure=figure)


def _figure(known: Sequence[Row], failed: Sequence[Row], names: Sequence[str]) -> Figure:
    """Return bounds sorted, and their map over the two numbers that vary in most steps."""
    varied = _most_varied(names, known)
    bounds = np.array([row["value"] for row in known])
    word = "worst sample" if known[0]["status"] == "sampled" else "bound"
    label = f"{word} [{known[0]['unit']}]" if known[0]["unit"] else word
    figure, axes = new_figure(2 if varied else 1, 10.0, 3.6)
    shares = (np.arange(len(bounds)) + 0.5) / len(bounds)
    axes[0].plot(np.sort(bounds), shares, ".-", ms=3, lw=0.8, color="#2166ac")
    axes[0].set(xlabel=label, ylabel="share of the variants up to it", ylim=(0, 1))
    if not varied:
        return figure
    x, y = ([_number(row, name) for row in known] for name in (varied[0], varied[-1]))
    if len(varied) == 1:
        axes[1].plot(x, bounds, ".", ms=4, color="#2166ac")
        axes[1].set(xlabel=varied[0], ylabel=label)
        return figure
    order, sizes = _ringed(x, y)
    map_ = axes[1].scatter(
        *np.array([x, y])[:, order], c=bounds[order], s=sizes[order], cmap="viridis"
    )
    figure.colorbar(map_, ax=axes[1], label=label)
    out = [[_number(row, name) for row in failed] for name in varied]
    axes[1].plot(*out, "x", color=FAILED, ms=5)
    axes[1].set(xlabel=varied[0], ylabel=varied[1])
    return figure


def _laws(question: str, names: Sequence[str], rows: Sequence[Row]) -> Section:
    """Return which variants have which law."""
    counts = Counter(row["law"] for row in rows if row["law"]).most_common()
    cells = [
        (law, str(count), str(next(row["variant"] for row in rows if row["law"] == law)))
        for law, count in counts[:20]
    ]
    without = sum(not row["law"] for row in rows)
    laws = "1 law keeps" if len(counts) == 1 else f"{len(counts)} laws keep"
    text = [f"{laws} {len(rows) - without} of {len(rows)} variants, each proved."]
    if len(counts) > len(cells):
        text.append(f"{len(counts) - len(cells)} more laws are in the rows.")
    varied = _most_varied(names, rows)
    figure = _map_of_laws([law for law, _ in counts], varied, rows) if varied else None
    return Section(question, tuple(text), Table(("law", "variants", "first"), tuple(cells)), figure)


def _map_of_laws(laws: Sequence[str], varied: Sequence[str], rows: Sequence[Row]) -> Figure:
    """Return the variants over the two numbers that vary in most steps: each law has its mark.

    Where one number varies, over that; each law has its height.
    """
    figure, (axes,) = new_figure(1, 6.0, 4.0)
    x, y = (np.array([_number(row, name) for row in rows]) for name in (varied[0], varied[-1]))
    if len(varied) == 1:
        y = np.array([float([*laws, ""].index(row["law"])) for row in rows])
    _, sizes = _ringed(x, y)
    for k, law in enumerate([*laws, ""]):
        under = np.array([row["law"] == law for row in rows])
        style: dict[str, Any] = {"color": FAILED, "marker": "x"}
        if law:
            style = {"color": f"C{k % 10}", "marker": MARKERS[k // 10 % len(MARKERS)]}
        label = (law or "none") if k < 12 or not law else None
        if under.any():
            # the larger of two at one place lies behind
            for size in sorted(set(sizes[under].tolist()), reverse=True):
                at = under & (sizes == size)
                own_label = label if size == sizes[under].max() else None
                axes.scatter(x[at], y[at], s=size, label=own_label, zorder=2 + 1 / size, **style)
    axes.set(xlabel=varied[0])
    if len(varied) == 1:
        axes.set(yticks=[])
    else:
        axes.set(ylabel=varied[1])
    axes.legend(title="law", fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _ringed(x: Sequence[float] | Array, y: Sequence[float] | Array) -> tuple[Any, Array]:
    """Return an order to draw points in, and their sizes: of several at one place all are seen."""
    places = list(zip(map(float, x), map(float, y), strict=True))
    left, behind = Counter(places), np.zeros(len(places))
    for k, place in enumerate(places):
        left[place] -= 1
        behind[k] = min(left[place], 3)
    # points that others cover are drawn larger, behind them
    return np.argsort(-behind, kind="stable"), 14.0 * (1 + behind) ** 2


def _most_varied(names: Sequence[str], rows: Sequence[Row]) -> list[str]:
    return sorted(names, key=lambda name: -len({row[name] for row in rows}))[:2]


def _number(row: Row, name: str) -> float:
    return np.nan if row[name] is None else float(row[name])


def _failures(failures: Sequence[tuple[Row, int]]) -> Section:
    cells = [
        (row["question"], row["status"], str(count), str(row["variant"]), row["reason"])
        for row, count in failures[:20]
    ]
    more = len(failures) - len(cells)
    text = (f"{more} more kinds of reasons are in the rows.",) if more else ()
    head = ("question", "status", "variants", "first", "its reason")
    return Section("Not proved", text, Table(head, tuple(cells)))
