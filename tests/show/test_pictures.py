"""Pictures of a design: what they draw is what is computed; notebooks show them."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from polefence import (
    Design,
    DesignFileError,
    Disk,
    HalfPlane,
    InputError,
    Sector,
    analyse,
    observe,
    place,
)
from polefence.base.drawing import pictures
from polefence.examples import family


@pytest.fixture(scope="module")
def design():
    return place(family("quarter-car-physical"), Disk(-40, 33))


def test_a_plot_has_the_poles_of_the_vertices(design):
    ax = design.plot().figure.axes[0]
    (line,) = [own for own in ax.lines if own.get_label() == "poles of the vertices"]
    drawn = line.get_xdata() + 1j * line.get_ydata()
    wanted = design.poles(np.eye(4)).ravel()
    assert np.abs(drawn[:, None] - wanted[None, :]).min(axis=0).max() < 1e-9


def test_a_step_has_a_panel_for_each_signal(design):
    labels = [ax.get_ylabel().replace("\n", " ") for ax in design.step().figure.axes]
    assert "tyre deflection [m]" in labels
    assert len([label for label in labels if label]) == 9


def test_bode_opens_the_loop_that_is_named(design):
    assert "actuator force" in str(design.bode().figure._suptitle.get_text())
    assert "tyre deflection" in str(design.bode("tyre deflection").figure._suptitle.get_text())
    with pytest.raises(InputError, match="no loop 'nothing'"):
        design.bode("nothing")


@pytest.mark.parametrize(
    ("kind", "mark"), [("svg", b"<svg"), ("png", b"\x89PNG"), ("pdf", b"%PDF")]
)
def test_it_is_saved_as_its_name_says(design, tmp_path, kind, mark):
    path = design.plot().save(tmp_path / "new" / f"poles.{kind}")
    assert mark in path.read_bytes()[:2000]


def test_another_kind_is_refused_and_nothing_written(design, tmp_path):
    with pytest.raises(InputError, match=r"a picture ends in \.png, \.svg, \.pdf"):
        design.plot().save(tmp_path / "new" / "poles.jpg")
    assert not list(tmp_path.iterdir())


def test_a_notebook_shows_an_svg_and_a_card_with_a_picture(design):
    assert ElementTree.fromstring(design.plot()._repr_svg_()).tag.endswith("svg")
    analysis = analyse(design.plant, design.law, design.region)
    for own in (design, design.region, analysis, HalfPlane(1) & Sector(0.3)):
        assert own._repr_html_().count('<img src="data:image/svg+xml;base64,') == 1


def test_what_is_not_proved_has_no_picture(design):
    assert "<img" not in Design(design.certificate, proved=False)._repr_html_()
    refuted = analyse(design.plant, design.law, Disk(-40, 5))
    assert "<img" not in refuted._repr_html_()


def test_the_whole_boundary_of_a_disk_and_the_corner_of_a_sector_are_seen():
    (ax,) = pictures().region(Disk(-40, 33)).figure.axes
    assert ax.get_xlim()[0] < -73 < -7 < ax.get_xlim()[1]
    assert ax.get_ylim()[1] > 33
    (ax,) = pictures().region(HalfPlane(1) & Sector(0.3)).figure.axes
    assert ax.get_ylim()[1] > np.sqrt(1 / 0.3**2 - 1)
    for shapeless in (HalfPlane(0), Sector(0.3)):
        (ax,) = pictures().region(shapeless).figure.axes
        assert ax.get_xlim()[0] <= -4


def test_a_design_of_an_observer_has_none():
    seen = ("suspension deflection", "sprung-mass velocity", "integral of suspension deflection")
    own = observe(family("quarter-car-physical"), seen, Disk(-80, 60)).design
    with pytest.raises(DesignFileError):
        own.plot()
    assert "<img" not in own._repr_html_()
