"""Figures: boundaries lie on the boundary, every region draws, styles differ."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from polefence import Design, Disk, parse_region, place, tightest
from polefence.certify.margins import Margin, Margins
from polefence.cli.main import main
from polefence.examples import family, spec_text
from polefence.lmi.conditions.methods import Scheduled
from polefence.show.plots import (
    COMPARED,
    STYLES,
    BoundsPanel,
    bounds_figure,
    comparison_figure,
    limits_figure,
    margins_figure,
    poles_figure,
    render,
    sampled,
    styles,
    typeset,
    view_of,
)
from polefence.vehicle.compare import compare
from polefence.vehicle.reference_laws import skyhook

REGIONS = [
    "disk(-40, 31)",
    "disk(0.5, 0.4)",
    "half_plane(3)",
    "half_plane(-3)",
    "sector(0.3)",
    "sector(0.99)",
    "vertical_strip(-30, -2)",
    "horizontal_strip(12)",
    "ellipse(-20, 15, 4)",
    "wedge(-2, 1.5)",
    "wedge(-30, -0.5)",
    "half_plane(3) & sector(0.5) & disk(-20, 19)",
    "horizontal_strip(5) & ellipse(-9, 8, 7) & half_plane(2)",
]
POLES = np.array([-5, -20 + 8j, -20 - 8j, -2.5 + 1j, -2.5 - 1j])


@pytest.mark.parametrize("text", REGIONS)
def test_curves_lie_on_the_boundary_and_cross_the_view(text):
    region = parse_region(text)
    view = low, high, height = view_of(region, POLES)
    assert low < min(POLES.real.min(), 0) < 0 < high
    assert height > np.abs(POLES.imag).max()
    for part in region.parts:
        drawn = np.concatenate(part.boundary(view))
        assert np.abs(part.distance(drawn)).max() < 1e-9 * max(part.size, high - low, height)
        # both halves of the plane are reached
        assert drawn.imag.min() < 0 < drawn.imag.max()


def test_poles_of_discrete_time_have_no_unit_and_the_unit_circle():
    region = parse_region("disk(0, 0.95) & wedge(2, 0.3)")
    poles = np.array([0.2, 0.5 + 0.2j, 0.5 - 0.2j])
    (ax,) = poles_figure({"sampled": (poles, poles)}, region, discrete=True).axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("real part of z", "imaginary part of z")
    circles = [own for own in ax.lines if np.allclose(np.hypot(*own.get_data()), 1)]
    assert len(circles) == 1
    assert ax.get_xlim()[1] < 1.7  # the wedge's apex lies outside the disk


@pytest.mark.parametrize("text", REGIONS)
def test_every_region_draws(text):
    region = parse_region(text)
    figure = poles_figure({"plant": (POLES, POLES[:2])}, region)
    ax = figure.axes[0]
    solid = [line for line in ax.lines if line.get_linewidth() == 1.3]
    assert solid, "no part of the boundary is drawn"
    for line in solid:
        z = line.get_xdata() + 1j * np.asarray(line.get_ydata())
        z = z[np.isfinite(z)]
        assert np.abs(region.distance(z)).max() < 1e-5 * max(region.size, 50)
    labels = [text.get_text().replace("\n", " ") for text in figure.legends[0].get_texts()]
    assert parse_region(labels[-1]) == region


def test_slow_poles_beside_fast_ones_have_a_panel_of_their_own():
    fast, slow = np.array([-12 + 76j, -12 - 76j]), np.array([-1.5 + 3j, -1.5 - 3j, -0.8])
    region = parse_region("half_plane(0.1)")
    whole, near = poles_figure({"a": (np.append(fast, slow), slow)}, region).axes
    for ax, poles in ((whole, np.append(fast, slow)), (near, slow)):
        (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
        assert low < 1.02 * poles.real.min() < poles.real.max() < 0 < high
        assert 1.02 * np.abs(poles.imag).max() < top == -bottom
    assert near.get_ylim()[1] < 10
    # a plant may be called as a panel is
    same = poles_figure({"near the origin": (np.append(fast, slow), slow)}, region).axes
    assert [ax.get_ylim() for ax in same] == [ax.get_ylim() for ax in (whole, near)]
    assert near.get_title() == "near the origin"
    assert whole.get_aspect() == "auto"  # narrow and high: a circle would be none
    assert len(poles_figure({"a": (slow, slow)}, region).axes) == 1
    assert len(poles_figure({"a": (fast, fast)}, region).axes) == 1


def test_poles_far_out_are_counted_and_not_shown():
    region = parse_region("half_plane(1)")
    poles = np.array([-2, -3, -2.5, -1e6])
    low, _, _ = view_of(region, poles)
    assert -100 < low < -3
    (ax,) = poles_figure({"plant": (poles, poles)}, region).axes
    (note,) = [text.get_text() for text in ax.texts]
    assert "25 % of the poles lie outside the picture" in note
    assert "-1e+06" in note


@pytest.mark.parametrize("on", ["simplex", "box"])
def test_the_sample_is_of_the_domain_of_the_proof(physical, monkeypatch, on):
    design = tightest(physical, -40, Scheduled(1, 0, on))
    seen = []
    poles = Design.poles
    monkeypatch.setattr(Design, "poles", lambda self, a: (seen.append(a), poles(self, a))[1])
    cloud, corners = sampled(design)
    assert cloud.shape[1] == corners.shape[1] == 5
    assert len(corners) == 4
    assert np.abs(cloud + 40).max() < design.region.radius
    # products of two parameters' coordinates are of rank one
    determinants = np.linalg.det(seen[0].reshape(-1, 2, 2))
    assert (np.abs(determinants).max() < 1e-12) == (on == "box")


LABELS = [
    "quadratic",
    "slack",
    "scheduled",
    "scheduled(2, 1)",
    "scheduled(2, 1, box)",
    "slack(2, 0)",
]


def test_styles_of_methods_are_told_apart_without_colour():
    known = styles(LABELS)
    looks = {
        label: (str(known[label]["ls"]), known[label].get("marker"), known[label]["lw"])
        for label in LABELS
    }
    for one, other in itertools.combinations(LABELS, 2):
        assert looks[one] != looks[other]
    assert all(known[label] == STYLES[label] for label in LABELS[:3])


@pytest.mark.parametrize("count", [2, 30])
def test_a_sweep_of_other_degrees_draws(count):
    rows = [
        {"centre": -c, "method": label, "radius": c * (0.9 - 0.05 * k)}
        for k, label in enumerate(LABELS)
        for c in np.linspace(5, 60, count)
    ]
    rows.append({"centre": -70.0, "method": "slack", "radius": None})
    figure = limits_figure({"plant": rows}, floor=20)
    drawn = [line.get_label() for line in figure.axes[0].lines if line.get_label()[0] != "_"]
    assert len(drawn) == len(LABELS)
    assert "scheduled(2, 1, box)" in drawn
    assert [text.get_text() for text in figure.axes[0].texts] == ["cut at 20 %"]
    if count == 2:
        assert b"<svg" in render(figure, "svg")


def test_what_others_published_is_drawn_where_it_belongs():
    rows = [{"centre": -40.0, "method": "slack", "radius": r} for r in (34.0, 35.0)]
    others = [{"centre": -40.0, "method": "slack", "radius": 30.0}]
    first, second = limits_figure({"a": rows, "b": rows}, published={"b": others}).axes
    points = [(line.get_xdata(), line.get_ydata()) for line in second.lines]
    assert ([40.0], [25.0]) in [(list(x), list(y)) for x, y in points]
    assert len(first.lines) == len(second.lines) - 2  # the point, and one for the legend
    assert not first.texts


def test_panels_of_poles_have_one_scale_and_another_law_its_marks():
    near, far = POLES, 3 * POLES
    own = {"a": (near, near[:2]), "b": (far, far[:2])}
    figure = poles_figure(own, Disk(-40, 31), others={"a": ("published", near[:2])})
    first, second = figure.axes
    assert first.get_xlim() == second.get_xlim()
    assert first.get_ylim() == second.get_ylim()
    assert "published" in [line.get_label() for line in first.lines]
    assert "published" not in [line.get_label() for line in second.lines]


def test_the_papers_figure_is_the_same_twice():
    """The same data, the same bytes."""
    cloud = -40 + 20 * np.exp(1j * np.linspace(0, 6, 50))
    first, second = (
        render(
            poles_figure({"a": (cloud, cloud[:3]), "b": (cloud, cloud[:3])}, Disk(-40, 31)), kind
        )
        for kind in ("svg", "svg")
    )
    assert first == second


def test_labels_of_vectors_stay_within_the_figure():
    long = "rms of [deflection over 1 mm, force over 10 N] from [ground velocity * 0.001]\n[N]"
    x = np.linspace(0, 1, 9)
    figure = bounds_figure(
        x, "m [kg]", [BoundsPanel(label, 2.0, 1 + x, None) for label in (long, "a")]
    )
    figure.canvas.draw()
    for ax in figure.axes:
        box = ax.yaxis.label.get_window_extent()
        assert box.y0 >= 0
        assert box.y1 <= figure.bbox.y1


def test_a_comparison_shows_worst_median_and_best():
    car = family("quarter-car-physical")
    found = compare(car, {"passive": None, "skyhook": skyhook(car)}, "C", 20.0)
    figure = comparison_figure(found)
    for ax in figure.axes:
        name = ax.get_xlabel().split(" [")[0]
        (spans,), (marks, dots) = ax.collections, ax.lines
        if ax.get_subplotspec().is_first_col():  # the others share it
            assert [own.get_text() for own in ax.get_yticklabels()] == ["passive", "skyhook"]
        for k, law in enumerate(found.laws):
            row = found.row(law, name)
            assert tuple(spans.get_segments()[k][:, 0]) == (row.best, row.worst)
            assert marks.get_xdata()[k] == row.worst
            assert dots.get_xdata()[k] == row.median
    assert {ax.get_xlabel().split(" [")[0] for ax in figure.axes} == set(COMPARED)


def test_margins_are_shares_of_what_breaks_them():
    design = place(family("quarter-car-physical"), Disk(-40, 31))
    proved = {"claim": SimpleNamespace(value=lambda _: None)}  # any: as the text below has it
    rows = [
        Margin("estimate", "m1", 2.0, "kg", 8.0, **proved),
        Margin("gain", "", 0.25, "of its size", **proved),
        Margin("rate", "m1", 30.0, "kg/s", **proved),
        Margin("rate", "beta", math.inf, "1/s", **proved),
        Margin("estimate", "beta", 0.0, "", 0.0),
    ]
    figure = margins_figure(Margins(design, design.region, 0, tuple(rows)))
    (ax,) = figure.axes
    assert [bar.get_width() for bar in ax.patches] == [25, 100, 100, 100, 0]
    assert [bar.get_facecolor()[3] for bar in ax.patches] == [1, 0, 0, 0, 1]  # hollow: no break
    said = [own.get_text() for own in ax.texts]
    assert said[0].endswith("kg proved, breaks at 8")
    assert said[1].endswith("proved, no break was found")
    assert said[2].endswith("proved, no break is sought")
    assert said[3] == f"{rows[3].text} 1/s proved, no break is sought"
    assert said[4] == "undecided, breaks at 0"


def test_commands_draw_what_they_found(tmp_path, capsys):
    spec = tmp_path / "car.toml"
    spec.write_text(spec_text("quarter-car-physical"))
    design = place(family("quarter-car-physical"), Disk(-40, 31))
    design.save(tmp_path / "car")
    measured = ["--measured", "suspension deflection", "--measured", "sprung-mass velocity"]
    integral = ["--measured", "integral of suspension deflection"]
    for name, words in (
        ("compare", [str(spec), "--law", "passive"]),
        ("observe", [str(spec), *measured, *integral, "--disk", "-80", "60"]),
        ("service", [str(tmp_path / "car")]),
    ):
        assert main([name, *words, "--plot", str(tmp_path / f"{name}.svg")]) == 0
        assert f"saved: {tmp_path / name}.svg" in capsys.readouterr().out
        assert (tmp_path / f"{name}.svg").stat().st_size > 5_000
        assert main([name, *words, "--plot", "x.csv"]) == 2
        assert "x.csv: a figure ends in .png, .svg or .pdf" in capsys.readouterr().err


def test_squares_of_seconds_are_typeset():
    panel = "acceleration [m/s2], roll [rad/s2], N s2, m/s2x, class_m/s2"
    said = typeset(panel)
    assert said == "acceleration [m/s²], roll [rad/s²], N s2, m/s2x, class_m/s2"
