"""One HTML page that needs nothing but itself, from its sections."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import TYPE_CHECKING

from polefence.base.errors import NotProvedError
from polefence.design.design import Design, check, require_kind
from polefence.proof.text import visible
from polefence.region.text import short_text
from polefence.show.plots.plots import render
from polefence.show.report.sections import sections

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def html_report(
    design: Design,
    road: str = "C",
    speed: float = 20.0,
    bounds: Sequence[str] = (),
    front: tuple[str, bytes] | None = None,
) -> str:
    """Return a report about a design, one HTML page with its figures inside.

    The claim is proved afresh. For a quarter car, known by the names of its states, comfort, grip,
    travel and force on a road are set beside those of the passive car, skyhook damping and LQR.

    Parameters
    ----------
    road : str
        Class of ISO 8608, "A" to "H".
    speed : float
        [m/s]
    bounds : sequence of str
        What else is proved of the design, a line each, see `performance_file.statements`.
    front : (kind, bytes), optional
        A figure of a trade-off, "svg" or "png".

    Raises
    ------
    NotProvedError
        If the claim is not proved.
    InputError
        If the road or the speed cannot be used, or the design is an observer's.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined  # deferred: slow to import

    require_kind(design.certificate)
    answer = check(design)
    if not answer.proved:
        raise NotProvedError(f"no report: {answer}")
    environment = Environment(
        loader=PackageLoader("polefence.show.report"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_visible,
    )
    environment.filters["picture"] = _picture
    return environment.get_template("report.html").render(
        title=f"{design.plant.name} in {short_text(design.region)}",
        answer=answer.answer,
        sections=sections(design, answer, road, speed, bounds, front),
    )


def _visible(value: object) -> object:
    """Return what can be seen of a text; newlines stay, which are spaces but in our own code."""
    return "\n".join(map(visible, value.split("\n"))) if isinstance(value, str) else value


def _picture(figure: Figure) -> str:
    """Return a figure as the address of an image: names inside one SVG do not meet another's."""
    return "data:image/svg+xml;base64," + base64.b64encode(render(figure, "svg")).decode()
