"""Small Markdown tables with aligned columns, readable as plain text too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def number(value: Any) -> str:
    """Write a value for a table: floats to five digits, lists with spaces, words as they are."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list):
        return " x ".join(str(entry) for entry in value)
    return "-" if value is None else str(value)


def gain_cells(gain: Sequence[float]) -> tuple[str, ...]:
    """Write the entries of a gain in units of 1e5, as the paper does."""
    return tuple(f"{entry / 1e5:.4f}e5" for entry in gain)


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a Markdown table."""
    cells = [list(head), *([str(c) for c in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = [
        "| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    rule = "|" + "|".join("-" * (w + 2) for w in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])
