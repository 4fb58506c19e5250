"""Texts of the page, as HTML in which names are no markup."""

from __future__ import annotations

import html
from collections.abc import Iterable

from polefence.certify.margins import Margin
from polefence.plant.parameters import Parameter
from polefence.proof.text import digits_up, unit_text, visible

# what it copies is the text that stands after it
COPY = (
    '<button type="button" class="copy" onclick="'
    "navigator.clipboard.writeText(this.parentNode.querySelector('pre').textContent)"
    ".then(() => {{ this.textContent = 'Copied' }})"
    '">Copy {what}</button>'
)


def safe(text: str) -> str:
    """Return text to be put into a page: names are no markup, and have no control characters."""
    return "\n".join(html.escape(visible(line)) for line in text.split("\n"))


def of_parameter(p: Parameter) -> str:
    """Return what a parameter is called: its words in the spec, its name and its unit."""
    unit = unit_text(p.unit)
    return " ".join(filter(None, (p.label, p.name, unit and f"[{unit}]")))


def plain(text: str) -> str:
    """Return the label of an axis, in which names have nothing that is a formula."""
    return visible(text).replace("$", "$\u200b").replace("\\", "\\\u200b")


def paragraph(text: str) -> str:
    """Return text as a paragraph."""
    return f"<p>{safe(text)}</p>"


def code(text: str) -> str:
    """Return text as lines of code."""
    return f"<pre>{safe(text)}</pre>"


def taken(command: str, python: str) -> str:
    """Return a command line and Python, folded, each with a button that copies it."""
    blocks = "".join(
        f"<div>{COPY.format(what=what)}{code(text)}</div>"
        for what, text in (("the command line", command), ("the Python", python))
        if text
    )
    return f"<details><summary>Command line and Python</summary>{blocks}</details>"


def margins_table(margins: Iterable[Margin]) -> str:
    """Return margins as a table: what is proved, and as a bar its share of what breaks."""
    return f'<table class="margins">{"".join(map(_row, margins))}</table>'


def _row(margin: Margin) -> str:
    bar = breaks = ""
    if margin.upper is not None:
        share = 100 * min(margin.value / margin.upper, 1.0) if margin.upper > 0 else 0.0
        bar = f'<div class="bar"><div style="width: {share:.1f}%"></div></div>'
        breaks = f"breaks at {digits_up(margin.upper, 4)}"
    cells = f"<td>{safe(f'{margin.text} {margin.unit}')}</td><td>{bar}</td><td>{safe(breaks)}</td>"
    return f'<tr title="{safe(margin.example)}"><th>{safe(margin.subject)}</th>{cells}</tr>'
