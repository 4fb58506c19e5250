"""Margins of a law's loops, sampled and proved, with the loop that has the least in a picture."""

from __future__ import annotations

import base64
from collections.abc import Sequence

from polefence.base.errors import PolefenceError
from polefence.certify.bounds import best_bound
from polefence.certify.design import Design
from polefence.requirements.disk_margin import DiskMargin
from polefence.response.loop_margins import LoopMargins, margins
from polefence.response.opened import family_points, opened, places
from polefence.studio.words import paragraph, safe

MOST = 8  # loops
POINTS = 100  # of the family, beside its vertices, at which margins are sampled


def loops_of(design: Design) -> str:
    """Return each loop's margins as a table over its picture, or why there are none.

    The disk margin of each is proved where that can be; the other margins are sampled.
    """
    from polefence.show.loops import HEAD, margins_row, nyquist_figure  # deferred: slow to import
    from polefence.show.plots import render

    try:
        alpha = family_points(design.plant, POINTS)
        every = [
            margins(opened(design.plant, design, here.name, alpha))
            for here in places(design.plant, design)[:MOST]
        ]
    except PolefenceError as error:
        return paragraph(str(error))
    proved = [_proved(design, found) for found in every]
    pairs = list(zip(every, proved, strict=True))
    rows = [margins_row(found, level) for found, level in pairs]
    found, level = min(pairs, key=lambda pair: pair[0].least[-1].value)
    picture = base64.b64encode(render(nyquist_figure(found, level), "svg")).decode()
    name = safe(f"Nyquist plot of the loop at {found.opened.place.label}, over the family")
    image = f'<img alt="{name}" title="{name}" src="data:image/svg+xml;base64,{picture}">'
    return f"{_table(HEAD, rows)}{image}"


def _proved(design: Design, found: LoopMargins) -> float | None:
    """Return the disk margin that is proved of a loop; None where none is, or of no such loop."""
    try:
        name = found.opened.place.name
        bound = best_bound(design.plant, design.law, DiskMargin(name))
    except PolefenceError:
        return None
    return None if bound is None or not bound.level else 1 / bound.level


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["".join(f"<th>{safe(cell)}</th>" for cell in head)]
    for first, *rest in rows:
        cells = "".join(f"<td>{safe(cell)}</td>" for cell in rest)
        lines.append(f"<th>{safe(first)}</th>{cells}")
    return f'<table class="loops">{"".join(f"<tr>{line}</tr>" for line in lines)}</table>'
