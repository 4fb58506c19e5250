"""The studio in a real browser: what is dragged, typed and pressed does what it says."""

import json
import re
import signal
import sys
from urllib.parse import urlsplit

import pytest

from polefence import Design, Disk, parse_region
from polefence.examples import spec_text
from polefence.studio import Session, State
from support.browser import (
    PATIENCE,
    browser,
    complaints,
    element,
    named,
    requests,
    require_browser,
    resized,
    studio,
    text_of,
    until,
)
from support.studios import subject

pytest.importorskip("selenium")
require_browser()

REGION = "disk(-40, 31)"
MINE = "mine"
VIEW = """
const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name(arguments[0]))
"""
HANDLES = """
const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("poles"))
const box = view.el.getBoundingClientRect()
const {x, y} = view.model.renderers.find(own => own.name == "handles").data_source.data
return [...x].map((own, i) => [
  box.left + view.frame.x_scale.compute(own), box.top + view.frame.y_scale.compute(y[i])
])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    own = tmp_path_factory.mktemp("studio")
    (own / "car.toml").write_text(spec_text("quarter-car-physical"))
    return own


@pytest.fixture(scope="module")
def kept():
    """Addresses whose page stays open from test to test."""
    return set()


@pytest.fixture(scope="module")
def address(folder, kept):
    with studio(folder, "car.toml", "--region", REGION) as (own, _):
        kept.add(own)
        yield own


@pytest.fixture(scope="module")
def window():
    with browser() as own:
        yield own


@pytest.fixture(autouse=True)
def quiet(window, kept):
    """A console that says nothing of the test before, whose own server is left behind."""
    if window.current_url not in kept:
        window.get("about:blank")
    complaints(window), requests(window)


def opened(window, address, region=REGION):
    """Have a window show the page of an address, with its first proof."""
    window.get(address)
    assert until(lambda: f"proved: all poles in {region}" in text_of(window))
    return window


@pytest.fixture
def page(window, address):
    """The page with its first region, at which nobody has complained in the end, and which asked
    nobody else. It stays open from test to test: what else one changes, the later ones do not use.
    """
    if window.current_url != address:
        opened(window, address)
    elif region_of(window) != REGION:
        type_into(window, "Region", REGION)
        assert until(lambda: f"proved: all poles in {REGION}" in text_of(window))
    window.execute_script("scrollTo(0, 0)")
    yield window
    assert complaints(window) == []
    own = urlsplit(address).netloc
    for asked in requests(window):
        if urlsplit(asked).scheme not in ("data", "blob", "chrome", "about"):
            assert urlsplit(asked).netloc == own


def drag(page, start, *places):
    from selenium.webdriver import ActionChains

    chain = ActionChains(page, duration=10)
    pointer = chain.w3c_actions.pointer_action
    pointer.move_to_location(*map(round, start))
    pointer.pointer_down()
    for place in places:
        pointer.move_to_location(*map(round, place))
    pointer.pointer_up()
    chain.perform()


def type_into(page, name, text):
    from selenium.webdriver import ActionChains, Keys

    page.execute_script("arguments[0].focus(); arguments[0].select()", named(page, name))
    ActionChains(page).send_keys(text, Keys.ENTER).perform()


def region_of(page):
    return named(page, "Region").get_attribute("value")


def pixel(page, place):
    """Where a point of the plane is on the screen."""
    return page.execute_script(
        """
        const [x, y] = arguments
        const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("poles"))
        const box = view.el.getBoundingClientRect()
        return [box.left + view.frame.x_scale.compute(x), box.top + view.frame.y_scale.compute(y)]
        """,
        place.real,
        place.imag,
    )


def cloud(page):
    return page.execute_script(
        """
        const plot = Bokeh.documents[0].get_model_by_name("poles")
        const {x, y} = plot.renderers[1].data_source.data
        return [...x].map((own, i) => [own, y[i]])
        """
    )


def test_it_opens_with_a_proof_and_a_cloud_inside(page):
    poles = [complex(*own) for own in cloud(page)]
    assert len(poles) > 1000
    assert Disk(-40, 31).contains(poles)
    assert page.title == "quarter car, physical"


def test_an_edge_is_dragged_and_the_law_follows(page):
    top, _, _ = page.execute_script(HANDLES)
    ends = [pixel(page, -40 + height * 1j) for height in (31.3, 32, 33, 34)]
    drag(page, top, *ends)
    assert until(lambda: "proved: all poles in disk(-40, 3" in text_of(page))
    wanted = pytest.approx(34, abs=0.2)  # the last of what the page was told
    assert until(lambda: parse_region(region_of(page)).radius == wanted)
    region = parse_region(region_of(page))
    assert region.centre == -40
    assert until(lambda: f"proved: all poles in {region}" in text_of(page))
    assert f"--region '{region}'" in text_of(page)


def test_a_car_is_chosen_in_the_map(page):
    from selenium.webdriver import ActionChains

    assert until(lambda: "None of 576 plants leaves the region" in text_of(page))
    page.execute_script(VIEW + "view.el.scrollIntoView()", "map")
    box = page.execute_script(VIEW + "return view.el.getBoundingClientRect().toJSON()", "map")
    place = page.execute_script(
        VIEW + "return [view.frame.x_scale.compute(250), view.frame.y_scale.compute(-5)]", "map"
    )
    chain = ActionChains(page, duration=10)
    pointer = chain.w3c_actions.pointer_action
    pointer.move_to_location(round(box["left"] + place[0]), round(box["top"] + place[1]))
    pointer.click()
    chain.perform()
    assert until(lambda: "--set m1=2" in text_of(page) and "--set m1=288.9" not in text_of(page))
    said = re.search(r"--set m1=(\S+) --set beta=(\S+)", text_of(page))
    assert float(said[1]) == pytest.approx(250, abs=2)
    assert float(said[2]) == pytest.approx(-5, abs=0.5)


def test_what_is_out_of_reach_is_refuted_and_shows_the_car_that_fails(page):
    _, right, _ = page.execute_script(HANDLES)
    drag(page, right, pixel(page, -12 + 0j), pixel(page, -18 + 0j))
    assert until(lambda: f"refuted: poles of this law leave {region_of(page)}" in text_of(page))
    assert parse_region(region_of(page)).radius == pytest.approx(22, abs=0.2)
    named(page, "Show the car that fails").click()
    assert until(lambda: "leaves the region at m1 = " in text_of(page))
    said = re.search(r"leaves the region at m1 = (\S+) kg, beta = (\S+)", text_of(page))
    assert 231.12 <= float(said[1]) <= 346.68


def test_a_place_where_nothing_is_moves_nothing(page):
    drag(page, pixel(page, -60 + 30j), pixel(page, -50 + 20j))
    assert region_of(page) == REGION


def test_undo_and_redo(page):
    type_into(page, "Region", "half_plane(4)")
    assert until(lambda: "proved: all poles in half_plane(4)" in text_of(page))
    named(page, "Undo").click()
    assert until(lambda: region_of(page) == REGION)
    assert until(lambda: f"proved: all poles in {REGION}" in text_of(page))
    named(page, "Redo").click()
    assert until(lambda: region_of(page) == "half_plane(4)")


def test_what_is_no_region_is_said_and_changes_nothing(page):
    type_into(page, "Region", "circle(3) <img src=x onerror=alert(1)>")
    assert until(lambda: "region: " in text_of(page))
    assert element(page, "return all.filter(own => own.nodeName == 'IMG').length") == 0
    type_into(page, "Region", REGION)


def test_the_keyboard_alone_is_enough(page):
    from selenium.webdriver import ActionChains, Keys

    seen = set()
    for _ in range(40):
        ActionChains(page).send_keys(Keys.TAB).perform()
        seen.add(
            page.execute_script(
                """
                let own = document.activeElement
                while (own.shadowRoot && own.shadowRoot.activeElement) {
                  own = own.shadowRoot.activeElement
                }
                return own.className + own.nodeName + own.textContent.trim()
                """
            )
        )
    for name in ("INPUT", "SELECT", "BUTTON"):
        assert any(name in own for own in seen), seen
    for name in ("Fit view", "Save"):
        assert any(own.endswith(name) for own in seen), seen
    type_into(page, "Region", "disk(-40, 33)")
    assert until(lambda: "proved: all poles in disk(-40, 33)" in text_of(page))


def drawn(page):
    """Heights of the car's outline, and how many frames were drawn."""
    return page.execute_script(
        """
        const plot = Bokeh.documents[0].get_model_by_name("car")
        const models = [...Bokeh.documents[0]._all_models.values()]
        const toggle = models.find(own => own.type == "Toggle")
        const law = plot.renderers.find(own => own.name == "law")
        return [[...law.data_source.data.y], toggle.frames || 0]
        """
    )


def test_the_car_rides_and_the_time_can_be_chosen(page):
    assert until(lambda: "passive: 0." in text_of(page))
    still, none = drawn(page)
    assert none == 0
    named(page, "Play").click()
    assert until(lambda: drawn(page)[1] > 20)
    assert drawn(page)[0] != still
    named(page, "Pause").click()
    paused = drawn(page)
    assert paused[1] == drawn(page)[1]
    assert until(lambda: named(page, "Play"))


def test_another_road_is_another_ride(page):
    from selenium.webdriver.support.select import Select

    assert until(lambda: "passive: 0." in text_of(page))
    said = re.search(r"passive: (\S+) m/s²", text_of(page))[1]
    Select(named(page, "Road")).select_by_visible_text("class A")
    assert until(lambda: f"passive: {said} m/s²" not in text_of(page))
    assert "--road A" in text_of(page)
    assert float(re.search(r"passive: (\S+) m/s²", text_of(page))[1]) < float(said)


def test_margins_in_service_are_proved(page):
    named(page, "Prove the margins in service").click()
    assert until(lambda: "error of each gain" in text_of(page))
    said = re.search(r"error of the estimate, m1 (\S+) kg\s+breaks at (\S+)", text_of(page))
    assert 2 < float(said[1]) < float(said[2]) < 20
    assert until(lambda: re.search(r"actuator force.*input.*; \S+ proved", text_of(page), re.S))
    type_into(page, "Region", "disk(-40, 32)")
    assert until(lambda: "error of each gain" not in text_of(page))


def observed(page):
    """Have the page keep all that its badge says."""
    page.execute_script(
        """
        window.said = []
        const walk = (node) => {
          if (node.shadowRoot) walk(node.shadowRoot)
          if (node.classList && node.classList.contains("badge")) badge = node
          node.childNodes.forEach(walk)
        }
        let badge = null
        setInterval(() => {
          badge = null
          walk(document.body)
          if (badge && badge.textContent != window.said.at(-1)) window.said.push(badge.textContent)
        }, 20)
        """
    )


def test_a_slow_search_ends_with_a_newer_drag_and_is_never_shown(page):
    type_into(page, "Region", "half_plane(1)")
    assert until(lambda: "proved: all poles in half_plane(1)" in text_of(page))
    observed(page)
    named(page, "the best ride").click()  # which takes a minute, of five states and two parameters
    assert until(lambda: "being searched" in text_of(page))
    named(page, "a law for the region").click()
    edge, *_ = page.execute_script(HANDLES)
    drag(page, edge, pixel(page, -2 + 0j), pixel(page, -3 + 0j))
    # regions on the way may be proved first
    assert until(lambda: parse_region(region_of(page)).decay == pytest.approx(3, abs=0.2))
    assert until(lambda: f"proved: all poles in {region_of(page)}" in text_of(page))
    said = page.execute_script("return window.said")
    assert said[-1].endswith(f"proved: all poles in {region_of(page)}")
    assert not any("rms" in own for own in said)


def test_the_command_line_is_copied(page, address):
    own = urlsplit(address)
    page.execute_cdp_cmd(
        "Browser.grantPermissions",
        {
            "origin": f"{own.scheme}://{own.netloc}",
            "permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"],
        },
    )
    law = "own.nodeName == 'SUMMARY' && own.parentNode.textContent.includes('--region')"
    element(page, f"return all.find(own => {law})").click()
    named(page, "Copy the command line").click()
    assert until(lambda: named(page, "Copied"))
    read = "const done = arguments[0]; navigator.clipboard.readText().then(done, done)"
    text = page.execute_async_script(read)
    assert text == f"polefence design car.toml --region '{REGION}' --method scheduled -o design"


def saved(page):
    """Press Save; return the page's name for what is saved, when it is."""
    named(page, "Save").click()
    name = named(page, "Save under the name").get_attribute("value")
    assert until(lambda: re.search(rf"saved: \S*{name}/session.json", text_of(page)))
    return name


def test_two_tabs_are_two_views_and_save_beside_each_other(page, address, folder):
    first = page.current_window_handle
    page.switch_to.new_window("tab")
    opened(page, address)
    type_into(page, "Region", "disk(-40, 35)")
    assert until(lambda: "proved: all poles in disk(-40, 35)" in text_of(page))
    other = saved(page)
    page.close()
    page.switch_to.window(first)
    assert region_of(page) == REGION
    own = saved(page)
    assert own != other
    for name, region in ((other, Disk(-40, 35)), (own, Disk(-40, 31))):
        session = folder / name / "session.json"
        assert Session.read(session).state(subject(), session).region == region


def paper(page):
    """The page's background, as the browser says it."""
    return page.execute_script("return getComputedStyle(document.body).backgroundColor")


def width(page):
    return page.execute_script("return document.documentElement.scrollWidth")


def brightness(colour):
    return sum(map(int, re.findall(r"\d+", colour)[:3]))


def test_a_phone_shows_all_of_it(page, window, address):
    """Of a page that was as wide as a screen, and of one that is opened there in the dark."""
    try:
        resized(window, 390, 800)
        assert until(lambda: width(window) <= 390)
        own = paper(window)
        assert brightness(own) >= 3 * 60 or own == "rgba(0, 0, 0, 0)"
        resized(window, 390, 800, dark=True)
        opened(window, address)
        assert width(window) <= 390
        assert brightness(paper(window)) < 3 * 60
    finally:
        resized(window)


@pytest.mark.parametrize("size", [(1366, 768), (1920, 1080)])
def test_one_screen_shows_poles_car_and_signals_without_scrolling(page, window, size):
    """Of the last signal half is seen at least; the answer stays where a column is scrolled."""
    ends = """
    return ["poles", "car", "traces"].map(name => {
      const own = document.querySelector(`[data-pane=${name}]`).getBoundingClientRect()
      return [own.left, own.right, own.bottom]
    })
    """
    try:
        resized(window, *size)
        high = "return document.documentElement.scrollHeight"
        assert until(lambda: window.execute_script(high) <= size[1])
        assert until(lambda: all(e[2] <= size[1] + 45 for e in window.execute_script(ends)))
        (_, right, _), (left, *_), (below, *_) = window.execute_script(ends)
        assert right <= min(left, below)  # beside one another
        named(window, "Prove the margins in service")  # the last of the right column
        badge = 'const own = all.find(e => String(e.className || "").startsWith("badge"))\n'
        badge += "return own.getBoundingClientRect().top"
        assert 0 <= element(window, badge) < 60
    finally:
        resized(window)


def test_no_name_and_no_answer_is_wider_than_the_window(folder, window):
    own = spec_text("quarter-car-ride").replace('label = "sprung mass"', f'label = "{"L" * 150}"')
    (folder / "long.toml").write_text(own.replace("quarter car, ride", "N" * 180))
    region = "disk(-40, 3) & sector(0.123456789123) & vertical_strip(-1000.123456789, -0.123456789)"
    try:
        with studio(folder, "long.toml", "--region", region, "-o", "long") as (address, _):
            window.get(address)
            assert until(lambda: "refuted: poles of this law leave" in text_of(window))
            assert "LLL m1 [kg]" in text_of(window)
            for size in (1366, 390):
                resized(window, size, 900)
                assert until(lambda size=size: width(window) <= size)
                badge = element(
                    window,
                    """
                    const own = all.find(e => String(e.className || "").startsWith("badge"))
                    return own.getBoundingClientRect().right
                    """,
                )
                assert badge <= size
    finally:
        resized(window)


@pytest.fixture(scope="module")
def again(folder, kept):
    """Address and process of a server of a session that was saved; the test of Ctrl-C ends it."""
    session = folder / MINE / "session.json"
    if not session.is_file():  # the test that saves it is left out
        Session.of(subject(), State.first(subject(), Disk(-40, 32))).save(session.parent)
    with studio(folder, str(session), "-o", "again") as own:
        kept.add(own[0])
        yield own


def test_what_is_saved_is_proved_and_opens_again(page, folder, request):
    type_into(page, "Region", "disk(-40, 32)")
    assert until(lambda: "proved: all poles in disk(-40, 32)" in text_of(page))
    type_into(page, "Save under the name", MINE)  # pages before this one may have kept another
    assert saved(page) == MINE
    assert Design.load(folder / MINE / "design").region == Disk(-40, 32)
    session = folder / MINE / "session.json"
    assert Session.read(session).state(subject(), session).region == Disk(-40, 32)
    assert json.loads(session.read_text())["method"] == "scheduled"
    page.refresh()
    assert until(lambda: region_of(page) == REGION)
    opened(page, request.getfixturevalue("again")[0], "disk(-40, 32)")
    requests(page)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_long_search_and_an_open_tab_looks_anew_at_the_next_server(
    again, folder, window
):
    first, process = again
    if window.current_url != first:
        opened(window, first, "disk(-40, 32)")
    named(window, "the best ride").click()  # which takes longer than is waited for below
    assert until(lambda: "being searched" in text_of(window))
    process.send_signal(signal.SIGINT)
    said = process.stdout.read()
    assert process.wait(PATIENCE) == 0
    assert said == "whoever has this address can use it; Ctrl-C ends it\n"
    assert "proved: all poles in disk(-40, 32); rms" not in text_of(window)
    assert until(lambda: "has ended; start it again" in text_of(window))
    port = urlsplit(first).port
    with studio(folder, "car.toml", "--region", "disk(-40, 33)", port=port) as (second, process):
        opened(window, second, "disk(-40, 33)")
        process.kill()
        assert until(lambda: "has ended; start it again" in text_of(window))


HOSTILE = '<img src=x onerror="window.harmed = 1"><script>window.harmed = 1</script>'
BEGIN = "half_plane(0.5)"


@pytest.fixture(scope="module")
def hostile(folder, kept):
    """The address of a car for the ride, with markup in its names."""
    text = spec_text("quarter-car-ride").replace('"quarter car, ride"', repr(HOSTILE))
    text = text.replace('unit = "kg"', f"unit = {HOSTILE!r}")
    assert text.count(HOSTILE) == 2
    (folder / "ride.toml").write_text(text)
    with studio(folder, "ride.toml", "--region", BEGIN, "-o", "rides") as (own, _):
        kept.add(own)
        yield own


@pytest.fixture
def ride(window, hostile):
    """Its page, which stays open from test to test."""
    if window.current_url != hostile:
        opened(window, hostile, BEGIN)
    yield window
    assert complaints(window) == []


def test_names_are_no_markup(ride):
    assert ride.execute_script("return window.harmed") is None
    assert element(ride, "return all.filter(own => own.nodeName == 'IMG').length") == 0
    assert HOSTILE in text_of(ride)


def test_sensors_are_ticked_and_the_dot_is_dragged(ride):
    from selenium.webdriver.support.select import Select

    Select(named(ride, "Method")).select_by_visible_text("quadratic")
    named(ride, "the best ride").click()
    assert until(lambda: f"proved: all poles in {BEGIN}; rms" in text_of(ride))
    named(ride, "suspension deflection").click()
    assert until(lambda: "--measured 'tyre deflection, sprung" in text_of(ride))
    assert until(lambda: f"proved: all poles in {BEGIN}; rms" in text_of(ride))
    named(ride, "Draw the trade-off").click()
    assert until(lambda: "8 of 8 limits" in text_of(ride), patience=60)
    ends = ride.execute_script(
        VIEW
        + """
        view.el.scrollIntoView()
        const box = view.el.getBoundingClientRect()
        const {x, y} = view.model.renderers[0].data_source.data
        const {x_scale, y_scale} = view.frame
        return [1, 3].map(i => [
          box.left + x_scale.compute(x[i]), box.top + y_scale.compute(y[i])
        ])
        """,
        "front",
    )
    drag(ride, *ends)

    def limit():
        return float(named(ride, "Limit").get_attribute("value"))

    assert until(limit)
    assert until(lambda: f"rms of actuator force <= {limit():g}" in text_of(ride))
