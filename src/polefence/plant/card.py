"""What a notebook shows of plants, designs and bounds: a small table in which no name is markup."""

from __future__ import annotations

import html
from collections.abc import Iterable

from polefence.proof.text import visible


def card(title: str, rows: Iterable[tuple[str, str]], picture: str = "") -> str:
    """Return a table of names and texts, as HTML; under it a picture, an element of our own."""
    lines = "".join(
        f'<tr><th style="text-align: left">{_safe(name)}</th>'
        f'<td style="text-align: left">{_safe(text)}</td></tr>'
        for name, text in rows
        if text
    )
    return f"<table><caption><b>{_safe(title)}</b></caption>{lines}</table>{picture}"


def _safe(text: str) -> str:
    return html.escape(visible(text))
