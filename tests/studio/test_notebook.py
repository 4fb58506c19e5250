"""The studio in a notebook: frames of one page, all in step, and what Python sees of it."""

import urllib.error
import urllib.request

import pytest

from polefence import Disk, parse_region
from polefence.base.errors import InputError
from polefence.examples import spec_path
from polefence.studio import notebook
from support.browser import browser, complaints, named, require_browser, text_of, until

pytest.importorskip("panel")

REGION = "disk(-40, 31)"
PIXELS = """
const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("poles"))
const box = view.el.getBoundingClientRect()
return arguments[0].map(([x, y]) => [
  box.left + view.frame.x_scale.compute(x), box.top + view.frame.y_scale.compute(y)
])
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    found = notebook(spec_path("quarter-car-physical"), REGION, tmp_path_factory.mktemp("studio"))
    yield found
    found.close()


@pytest.fixture(scope="module")
def cells(own, tmp_path_factory):
    """A browser with what three cells show, each of which has said what is proved."""
    pytest.importorskip("selenium")
    require_browser()
    shown = [own, *map(own.pane, ("poles", "asked"))]
    file = tmp_path_factory.mktemp("cells") / "cells.html"
    file.write_text("".join(each._repr_html_() for each in shown))
    with browser(1300, 900) as page:
        page.get(file.as_uri())
        for cell in range(len(shown)):
            look(page, cell)
        yield page


def look(page, cell):
    """Go into the frame of a cell, and wait until it is drawn."""
    page.switch_to.default_content()
    frame = page.find_elements("tag name", "iframe")[cell]
    page.execute_script("arguments[0].scrollIntoView()", frame)
    page.switch_to.frame(frame)
    assert until(lambda: "proved: all poles in" in text_of(page)), " ".join(text_of(page).split())


def status(address):
    try:
        with urllib.request.urlopen(address) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_frames_are_of_the_page_and_of_its_panes(own):
    whole, pane = own._repr_html_(), own.pane("poles", height=333)._repr_html_()
    assert 'title="quarter car, physical"' in whole
    assert "pane=" not in whole
    assert "pane=poles" in pane
    assert "height: 333px" in pane
    assert status(own.address) == 200
    assert {"poles", "asked", "car", "traces", "map", "sensors", "service"} <= set(own.names)


def test_a_pane_that_is_not_there_is_named_with_one_that_is(own):
    with pytest.raises(InputError, match="no pane 'pole'; did you mean 'poles'"):
        own.pane("pole")


def test_nothing_is_there_without_the_token_or_the_session(own):
    assert own._token in own.address
    assert status(own.address.replace(own._token, "x")) in (403, 404)
    assert status(own.address.split("?")[0]) == 403


def test_what_cannot_be_opened_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="no.toml"):
        notebook(tmp_path / "no.toml")
    with pytest.raises(InputError, match="region"):
        notebook(spec_path("quarter-car-physical"), "circle(3)")


def test_there_is_no_law_before_anybody_looks(own):
    assert own.design is None
    assert own.region == Disk(-40, 31)


def test_what_is_done_in_one_cell_is_seen_in_all_and_in_python(own, cells):
    from selenium.webdriver import ActionChains, Keys

    assert until(lambda: own.design is not None and own.page.answer.proved)
    assert own.design.region == Disk(-40, 31)
    look(cells, 2)
    field = named(cells, "Region")
    cells.execute_script("arguments[0].focus(); arguments[0].select()", field)
    ActionChains(cells).send_keys("disk(-40, 32)", Keys.ENTER).perform()
    for cell in range(3):
        look(cells, cell)
        assert until(lambda: "proved: all poles in disk(-40, 32)" in text_of(cells))
    assert own.design.region == Disk(-40, 32)
    assert complaints(cells) == []


def test_a_handle_is_dragged_in_a_frame_that_is_not_the_only_one(own, cells):
    from selenium.webdriver import ActionChains

    look(cells, 1)
    pointer = ActionChains(cells, duration=10)
    top = own.region.radius
    start, end = cells.execute_script(PIXELS, [[-40, top], [-40, top + 1.5]])
    pointer.w3c_actions.pointer_action.move_to_location(*map(round, start)).pointer_down()
    pointer.w3c_actions.pointer_action.move_to_location(*map(round, end)).pointer_up()
    pointer.perform()
    assert until(lambda: own.region.radius == pytest.approx(top + 1.5, abs=0.2))
    assert own.region.centre == -40
    look(cells, 0)
    assert until(lambda: parse_region(named(cells, "Region").get_attribute("value")) == own.region)
    assert until(lambda: f"proved: all poles in {own.region}" in text_of(cells))


def test_a_pane_alone_is_alone_and_as_large_as_its_own_frame(cells):
    sizes = []
    for cell, names in ((0, 10), (1, 1), (2, 2)):  # what is asked has the answer over it
        look(cells, cell)
        count = "return [...document.querySelectorAll('section')].filter(x => !x.hidden).length"
        assert cells.execute_script(count) == names
        width = 'return Bokeh.documents[0].get_model_by_name("poles").inner_width'
        sizes.append(cells.execute_script(width))
    assert sizes[2] == 0
    assert sizes[0] > 300
    assert sizes[1] > 300
    assert sizes[0] != sizes[1]


def test_a_cell_that_is_shown_again_is_as_it_was_left(own, cells):
    look(cells, 0)
    own.page._document.add_next_tick_callback(lambda: own.page._asked(region=Disk(-40, 35)))
    assert until(lambda: "proved: all poles in disk(-40, 35)" in text_of(cells))
    look(cells, 1)
    cells.execute_script("window.old = true; location.reload()")
    assert until(lambda: cells.execute_script("return !window.old"))
    look(cells, 1)
    assert "proved: all poles in disk(-40, 35)" in text_of(cells)


def test_a_frame_says_that_its_page_has_ended(own, cells):
    look(cells, 1)
    own.close()
    assert until(lambda: "run the cell again" in text_of(cells))
