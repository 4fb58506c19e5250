"""Plots of opened loops: what is drawn is L, and what is shaded is what its margin leaves out."""

import numpy as np
import pytest

from polefence import Parameter, UncertainPlant
from polefence.region.text import digits_down
from polefence.response import family_points, margins, opened, places
from polefence.show.loops import (
    bode_figure,
    loop_figure,
    margins_row,
    nichols_figure,
    nyquist_figure,
)
from polefence.show.plots import render

GAIN = [[-25, 0, 0]]


def cubic(w):
    return 25 / np.polyval([1, 10, 10, 10], 1j * w)


@pytest.fixture(scope="module")
def single():
    plant = UncertainPlant.from_vertices(
        [[[0, 1, 0], [0, 0, 1], [-10, -10, -10]]], [[[0], [0], [1]]]
    )
    return margins(opened(plant, GAIN))


@pytest.fixture(scope="module")
def several():
    plant = UncertainPlant.from_expressions(
        [Parameter("k", 8, 12, "N/m")],
        [[0, 1, 0], [0, 0, 1], ["-k", -10, -10]],
        [[0], [0], [1]],
        name="cart",
        states=("position [m]", "speed [m/s]", "x3"),
        inputs=("force [N]",),
    )
    return margins(opened(plant, GAIN, alpha=family_points(plant, 40)))


def worst_spring():
    """The end of the range of k with the larger peak of S - 1/2, over frequencies swept."""
    s = 1j * np.geomspace(0.1, 10, 5000)
    peak = {k: np.abs(1 / (1 + 25 / np.polyval([1, 10, 10, k], s)) - 0.5).max() for k in (8, 12)}
    return max(peak, key=peak.get)


def curve(ax):
    """The one that is drawn thickest in black."""
    (line,) = [x for x in ax.lines if x.get_color() == "black" and x.get_linewidth() == 1.4]
    return line.get_data()


def test_curves_are_the_loop_itself(single):
    frequency, size = curve(bode_figure(single).axes[0])
    w = 2 * np.pi * frequency
    np.testing.assert_allclose(size, 20 * np.log10(np.abs(cubic(w))), atol=1e-9)
    _, phase = curve(bode_figure(single).axes[1])
    np.testing.assert_allclose(np.exp(1j * np.radians(phase)), cubic(w) / np.abs(cubic(w)))
    assert -10 > phase.max() > phase.min() > -270  # begun at zero, not at a whole turn
    np.testing.assert_allclose(curve(nyquist_figure(single).axes[0])[0], cubic(w).real)
    np.testing.assert_allclose(curve(nyquist_figure(single).axes[0])[1], cubic(w).imag, atol=1e-12)
    x, y = curve(nichols_figure(single).axes[0])
    np.testing.assert_allclose((x, y), (phase, size))
    # its margins lie within what is shown
    assert frequency[0] < 1.784 / 2 / np.pi < 3.16 / 2 / np.pi < frequency[-1]


def edge(ax):
    """The line around what is shaded."""
    (drawn,) = [c for c in ax.collections if len(c.get_paths()) and not np.size(c.get_facecolor())]
    return np.concatenate([path.vertices for path in drawn.get_paths()])


@pytest.mark.parametrize("sigma", [0, 1, -1])
def test_the_disk_is_that_of_the_margin_and_the_loop_touches_it(single, sigma):
    found = margins(single.opened, sigma)
    margin = found.disk.value[0]
    x, y = edge(nyquist_figure(found).axes[0]).T
    S = 1 / (1 + x + 1j * y)
    np.testing.assert_allclose(np.abs(S + (sigma - 1) / 2), 1 / margin, rtol=5e-3)
    # its real diameter, of the factors of the gain that the margin leaves
    ends = [-(1 + m * (1 + sigma) / 2) / (1 - m * (1 - sigma) / 2) for m in (margin, -margin)]
    np.testing.assert_allclose((x.min(), x.max()), ends, atol=0.02)
    x, y = edge(nichols_figure(found).axes[0]).T
    L = 10 ** (y / 20) * np.exp(1j * np.radians(x))
    np.testing.assert_allclose(np.abs(1 / (1 + L) + (sigma - 1) / 2), 1 / margin, rtol=5e-3)
    # a margin that is proved is drawn in its place
    smaller = nyquist_figure(found, 0.2)
    x, y = edge(smaller.axes[0]).T
    S = 1 / (1 + x + 1j * y)
    np.testing.assert_allclose(np.abs(S + (sigma - 1) / 2), 5, rtol=5e-3)
    said = [text.get_text() for text in smaller.legends[0].get_texts()]
    assert "disk of margin 0.2, proved" in said
    assert f"disk of margin {digits_down(margin, 4)}, sampled" not in said


def test_margins_are_marked_with_their_units_where_the_loop_is(single):
    ax = nyquist_figure(single).axes[0]
    marks = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "o"]
    assert any(np.allclose(mark, (-1 / 3.6, 0), atol=1e-9) for mark in marks)
    assert any(np.hypot(*mark) == pytest.approx(1) and mark[1] < 0 for mark in marks)
    assert any(tuple(line.get_xydata()[0]) == (-1, 0) for line in ax.lines)
    texts = [text.get_text() for text in ax.texts]
    assert texts == ["\u00d7 3.6 (+11.1 dB)", "29.1\u00b0"]
    sizes, phases = bode_figure(single).axes
    assert [text.get_text() for text in sizes.texts] == ["\u00d7 3.6 (+11.1 dB)"]
    assert [text.get_text() for text in phases.texts] == ["29.1\u00b0, 285 ms"]


def test_a_family_shows_its_middle_its_vertices_and_its_least(several):
    figure = loop_figure(several)
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert said[:3] == ["middle of the family", "vertices", "other points"]
    assert said[3] == f"least disk margin, k = {worst_spring()} N/m"
    reds = [line for line in figure.axes[0].lines if line.get_color() == "#b2182b"]
    assert len(reds) == 2
    (blue,) = [line for line in figure.axes[0].lines if line.get_color() == "#2166ac"]
    k = several.least[-1].number
    L = several.opened.take([k]).loop([0.3])[0]
    points = blue.get_xydata()
    assert np.abs(points[:, 0] + 1j * points[:, 1] - L).min() < 0.05
    # none of the points enters the shaded disk
    lines = [x for x in figure.axes[0].lines if len(x.get_xdata()) > 99 and x.get_color() != "0.55"]
    assert len(lines) > 20
    x, y = np.hstack([line.get_data() for line in lines])
    S = 1 / (1 + x + 1j * y)
    assert np.nanmax(np.abs(S - 0.5)) <= (1 + 1e-6) / several.least[-1].value
    assert np.nanmax(np.abs(S - 0.5)) >= 0.99 / several.least[-1].value


def test_a_row_says_what_the_margins_are(several):
    row = margins_row(several)
    least = dict(zip(("lower", "upper", "phase", "delay", "disk"), several.least, strict=True))
    assert row[0] == "force [N], input"
    assert row[1] == f"0 to {least['upper'].value:.4g}"
    assert row[2].startswith(f"{least['phase'].value:.3g}\u00b0, ")
    assert row[4] == f"{least['disk'].value:.3g}"
    assert row[5].endswith(f" Hz, k = {worst_spring()} N/m")


def test_loops_without_margins_are_drawn_all_the_same(several):
    plant = several.opened.plant
    beyond = margins(opened(plant, [[-95, 0, 0]], alpha=family_points(plant, 5)))
    assert not beyond.stable.all()
    row = margins_row(beyond)
    assert row[1:5] == ("none",) * 4
    assert "not stable, k = " in row[5]
    assert render(loop_figure(beyond), "png")
    # and one in which nothing goes round
    nothing = margins(opened(plant, [[-25, 0, 0]], "position", np.eye(2)).take([0]))
    assert render(loop_figure(nothing), "png")
    still = margins(opened(plant, [[0, 0, 0]], alpha=family_points(plant, 5)))
    assert margins_row(still)[1:4] == ("0 to any", "180\u00b0", "any")
    assert render(loop_figure(still), "svg")


def test_at_samples_the_curves_end_at_half_of_their_frequency():
    plant = UncertainPlant.from_vertices([[[0.9, 0.1], [0, 0.5]]], [[[0], [1]]], sample_time=0.01)
    found = margins(opened(plant, [[-0.5, -0.2]]))
    assert len(places(plant, [[-0.5, -0.2]])) == 3
    ax = bode_figure(found).axes[0]
    assert ax.get_xlim()[1] == pytest.approx(50)
    assert curve(ax)[0][-1] == pytest.approx(50)
