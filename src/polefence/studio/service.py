"""What errors a law bears in service: a bar for the share of the error that breaks it; loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn

from polefence.base.errors import PolefenceError
from polefence.certify.design import Design
from polefence.certify.margins import in_service
from polefence.studio.loops import loops_of
from polefence.studio.palette import STYLE
from polefence.studio.words import margins_table, paragraph


class Service:
    """The pane.

    Parameters
    ----------
    asked : callable
        Called when the button is pressed.
    """

    def __init__(self, asked: Callable[[], object]) -> None:
        self.button = pn.widgets.Button(label="Prove the margins in service", disabled=True)
        self.button.on_click(lambda _: asked())
        self.table = pn.pane.HTML("", stylesheets=[STYLE])

    @property
    def view(self) -> Any:
        """The button over its table."""
        return pn.Column(self.button, self.table, sizing_mode="stretch_width")

    def allow(self, proved: bool) -> None:
        """Let margins be asked for of a law that is proved, and forget another's."""
        self.table.object, self.button.disabled = "", not proved

    def wait(self) -> None:
        """Say that they are being proved."""
        self.table.object, self.button.disabled = paragraph("being proved ..."), True

    def show(self, text: str) -> None:
        """Show what was found."""
        self.table.object, self.button.disabled = text, False


def margins_of(design: Design) -> str:
    """Return margins of parameters and gains as a table, or why there are none, over the loops'."""
    try:
        found = margins_table(in_service(design))
    except PolefenceError as error:
        found = paragraph(str(error))
    return f"{found}{loops_of(design)}"
