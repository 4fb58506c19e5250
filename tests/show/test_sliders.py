"""Sliders of a report: what they show is what is computed, in a real browser too."""

from __future__ import annotations

import html
import json
import re

import numpy as np
import pytest

from polefence import Disk, Parameter, UncertainPlant, place
from polefence.examples import family
from polefence.plant.dead_time import with_dead_time
from polefence.response.linear import step
from polefence.show.plots import new_figure
from polefence.show.report import html_report
from polefence.show.sliders import UNITS, Grid, Panel, data_text, script
from support.browser import browser, complaints, require_browser, until


@pytest.fixture(scope="module")
def design():
    return place(family("quarter-car-physical"), Disk(-40, 33))


@pytest.fixture(scope="module")
def page(design):
    return str(html_report(design))


def data_of(page):
    return json.loads(re.search(r'id="family">(.*?)</script>', page, re.DOTALL)[1])


def boxes(page):
    """Share of the picture that each panel takes: left, top, width, height [%]."""
    styles = re.findall(r'class="chosen" style="(.*?)"', page)
    return [[float(x) for x in re.findall(r"([\d.]+)%", style)] for style in styles]


def test_each_step_of_the_sliders_has_the_poles_of_its_plant(design, page):
    data, plant = data_of(page), design.plant
    counts = [len(slider["texts"]) for slider in data["sliders"]]
    assert counts == [9, 9]
    assert [slider["texts"][0] for slider in data["sliders"]] == ["231.1 kg", "-10"]
    for at in ((0, 0), (8, 8), (2, 7)):
        low, high = np.array([[float(p.low), float(p.high)] for p in plant.parameters]).T
        m1, beta = low + (high - low) * np.array(at) / 8
        alpha = plant.alpha(m1=m1, beta=beta)
        A, B = plant.at(alpha)
        wanted = np.linalg.eigvals(A + B @ design.law.gain(alpha))
        dots = re.findall(r"M(-?\d+) (-?\d+)h0", data["panels"][0][at[0] * 9 + at[1]])
        x, y = np.array(dots, dtype=float).T
        assert len(x) == len(wanted)
        # of one panel: the scales are read off its outermost poles, the rest must agree
        real, height = np.sort(wanted.real), np.sort(wanted.imag)
        assert np.polyfit(real, np.sort(x), 1, full=True)[1] < 4
        assert np.polyfit(height, np.sort(-y), 1, full=True)[1] < 4


def test_a_curve_goes_through_the_response(design):
    grid = Grid.of(design.plant)
    chosen = step(design.plant, design, grid.alpha[-2:], None, None, 0.5)
    _, (ax,) = new_figure(1, 4, 3)
    ax.set_xlim(0, 0.5)
    ax.set_ylim(-2, 2)
    paths = Panel(ax, curves=(chosen.time, chosen.values[:, :, 0])).paths
    for path, row in zip(paths, chosen.values[:, :, 0], strict=True):
        start, steps = path.removeprefix("M").split("l")
        moves = np.array([start.split(), *np.reshape(steps.split(), (-1, 2))], dtype=float)
        x, y = moves.cumsum(axis=0).T
        at, value = 0.5 * x / UNITS, 2 - 4 * y / UNITS
        assert x[0] == 0
        assert x[-1] == UNITS
        # rounding of both, and a curve between two of its points
        assert np.abs(value - np.interp(at, chosen.time, row)).max() < 0.02


def test_what_is_beyond_a_panel_is_not_drawn():
    _, (ax,) = new_figure(1, 4, 3)
    ax.set_xlim(-2, 0)
    ax.set_ylim(-1, 1)
    paths = Panel(ax, [np.array([-1 + 0.5j, -3 + 0j, -1 - 1.5j])]).paths
    assert paths == [f"M{UNITS // 2} {UNITS // 4}h0"]


@pytest.mark.parametrize(("parameters", "steps"), [(1, 33), (2, 9), (3, 5), (4, 3), (5, 3)])
def test_grids_are_as_fine_as_the_page_allows(parameters, steps):
    own = [Parameter(f"p{k}", 1, 2) for k in range(parameters)]
    entry = " - ".join(["-1", *(p.name for p in own)])
    plant = UncertainPlant.from_expressions(own, [[entry]], [[1]])
    grid = Grid.of(plant)
    assert grid.steps == steps
    assert grid.alpha.shape == (steps**parameters, 2**parameters)


def test_there_are_no_sliders_without_parameters_or_with_too_many():
    assert Grid.of(UncertainPlant.from_vertices([[[-1]]], [[[1]]])) is None
    own = [Parameter(f"p{k}", 1, 2) for k in range(6)]
    entry = " - ".join(["-1", *(p.name for p in own)])
    assert Grid.of(UncertainPlant.from_expressions(own, [[entry]], [[1]])) is None


def test_a_file_s_text_ends_no_element():
    nasty = "</script><script>alert(1)</script>"
    own = Parameter("p", 1, 2, label=nasty)
    plant = UncertainPlant.from_expressions([own], [["-p"]], [[1]])
    text = data_text(Grid.of(plant), [])
    assert "<" not in text
    assert nasty in json.loads(text)["sliders"][0]["name"]


def test_the_page_allows_no_other_script(page):
    policy = html.unescape(re.search(r'Security-Policy" content="(.*?)"', page)[1])
    assert policy.startswith("default-src 'none'; img-src data:; ")
    assert "'unsafe-inline'; script-src 'sha256-" in policy
    assert page.count("<script") == 2  # data, which no browser runs, and what moves it
    assert script() in page


def test_in_a_browser_a_slider_moves_poles_and_responses(design, page, tmp_path):
    pytest.importorskip("selenium")
    require_browser()
    path = tmp_path / "report.html"
    nasty = '<script>document.title = "run"</script>'
    path.write_text(page.replace("</body>", f"{nasty}</body>"))
    data = data_of(page)
    move = """
    const input = document.querySelectorAll("#sliders input")[arguments[0]];
    input.value = arguments[1];
    input.dispatchEvent(new Event("input", {bubbles: true}));
    """
    drawn = 'return [...document.querySelectorAll("svg.chosen path")].map(p => p.getAttribute("d"))'
    with browser() as own:
        own.get(path.as_uri())
        until(lambda: own.execute_script('return !document.getElementById("sliders").hidden'))
        assert own.execute_script(drawn) == [panel[4 * 9 + 4] for panel in data["panels"]]
        own.execute_script(move, 0, 8)
        own.execute_script(move, 1, 2)
        assert own.execute_script(drawn) == [panel[8 * 9 + 2] for panel in data["panels"]]
        said = own.execute_script('return document.querySelector("#sliders output").textContent')
        assert said == "346.7 kg"
        shares = """
        return [...document.querySelectorAll("svg.chosen")].map(svg => {
          const own = svg.getBoundingClientRect();
          const all = svg.parentElement.querySelector("img").getBoundingClientRect();
          return [(own.left - all.left) / all.width, (own.top - all.top) / all.height,
                  own.width / all.width, own.height / all.height];
        })"""
        seen = np.array(own.execute_script(shares))
        np.testing.assert_allclose(100 * seen, boxes(page), atol=0.1)
        assert own.title != "run"  # a script that is not ours was refused
        refused = [line for line in complaints(own) if "Content Security Policy" in line]
        assert len(refused) == 1


def test_what_a_dead_time_leaves_out_is_no_slider():
    one = UncertainPlant.from_expressions([Parameter("k", 1, 3)], [[0, 1], ["-k", -1]], [[0], [1]])
    late = with_dead_time(one, "u1", 0.1)
    assert len(late.parameters) == 2
    grid = Grid.of(late)
    assert [slider["name"] for slider in grid.sliders] == ["k"]
    assert len(grid.alpha) == 33
    with_delta = grid.alpha.reshape(33, *(2,) * 2)
    halves = [with_delta.take(k, axis=axis) for axis in (1, 2) for k in (0, 1)]
    # along one of the axes both ends have the same weight: delta is in the middle
    assert any(np.allclose(halves[i], halves[i + 1]) for i in (0, 2))
