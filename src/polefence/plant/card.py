"""What a notebook shows of plants, designs and bounds: a small table in which no name is markup."""

from __future__ import annotations

import html
from collections.abc import Iterable

from polefence.proof.text import visible


def card(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a table of names and texts, as HTML."""
    lines = "".join(
        f'<tr><th style="text-align: left">{_safe(name)}</th>'
        f'<td style="text-align: left">{_safe(text)}</td></tr>'
        for name, text in rows
        if text
    )
    return f"<table><caption><b>{_safe(title)}</b></caption>{lines}</table>"


def _safe(text: str) -> str:
    return html.escape(visible(text))
