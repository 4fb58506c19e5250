"""Pictures of a design, as a notebook shows them and a file keeps them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from polefence.base.errors import InputError
from polefence.base.files import make_folder, write_bytes
from polefence.certify.design import Design
from polefence.region.regions import Region
from polefence.response.loop_margins import margins
from polefence.response.opened import family_points, opened, places
from polefence.show.loops import loop_figure
from polefence.show.plots import (
    FORMATS,
    address,
    draw_region,
    fitted,
    new_figure,
    poles_figure,
    render,
    view_of,
)
from polefence.show.plots import sampled as poles_of
from polefence.show.report import LOOP_POINTS, responses

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = "max-width: 44em; display: block"  # beside a table of a notebook


class Picture:
    """A figure that a notebook shows.

    Attributes
    ----------
    figure : matplotlib figure
        To add to, or to draw elsewhere.
    """

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        return f"<Picture {width:g} x {height:g} in: show it in a notebook, or save it>"

    def _repr_svg_(self) -> str:
        """Show it in a notebook."""
        return render(self.figure, "svg").decode()

    def save(self, path: str | Path) -> Path:
        """Write it as PNG, SVG or PDF, as the path ends; return the path.

        Raises
        ------
        InputError
            If the path ends otherwise.
        OutputError
            If the file cannot be written.
        """
        target = Path(path)
        if target.suffix[1:] not in FORMATS:
            raise InputError(f"{target}: a picture ends in {', '.join(f'.{k}' for k in FORMATS)}")
        make_folder(target.parent)
        write_bytes(target, render(self.figure, target.suffix[1:]))
        return target

    @property
    def small(self) -> str:
        """An element of a page, of the size that stands beside a table."""
        return f'<img src="{address(self.figure)}" alt="" style="{SMALL}"/>'


def poles(design: Design) -> Picture:
    """Return the poles over the family, with the region."""
    plant = design.plant
    drawn = {plant.name: poles_of(design)}
    return Picture(poles_figure(drawn, design.region, discrete=plant.sample_time is not None))


def step(design: Design) -> Picture:
    """Return the responses to a unit step of the first disturbance, or of the first input.

    Raises
    ------
    InputError
        If none can be drawn.
    """
    section = responses(design)
    if section.figure is None:
        raise InputError(section.text[0])
    return Picture(section.figure)


def bode(design: Design, place: str = "") -> Picture:
    """Return Nyquist, Bode and Nichols plots of the loop, opened at an input or a signal.

    Parameters
    ----------
    place : str
        Its name; by default the first input.

    Raises
    ------
    InputError
        If there is no loop of that name.
    """
    name = place or places(design.plant, design)[0].name
    alpha = family_points(design.plant, LOOP_POINTS)
    return Picture(loop_figure(margins(opened(design.plant, design, name, alpha))))


def region(own: Region) -> Picture:
    """Return a region: its boundary, its outside shaded; of an unbounded one some of it."""
    size = own.scale or 1.0  # stability alone has no size
    far = np.array([0j] if own.bounds_speed else [-4 * size * (1 + 1j)])
    figure, (ax,) = new_figure(1, 3.8, 2.9)
    draw_region(ax, own, fitted(view_of(own, far)))
    ax.set_aspect("equal", adjustable="box")
    ax.axvline(0, color="0.3", lw=0.8)
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    return Picture(figure)
