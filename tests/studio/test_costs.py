"""What a ride costs: the trade-off and its dot, sensors, all by laws that are proved."""

import asyncio
import re
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from types import SimpleNamespace

import pytest

from polefence import Design, HalfPlane, check, load_specifications, optimise
from polefence.base.progress import stage
from polefence.examples import spec_path, spec_text
from polefence.studio import Page, State, front, settled
from polefence.studio.front import Front
from polefence.studio.palette import LIGHT
from support.browser import until
from support.once import searched_once  # noqa: F401
from support.studios import asked, subject, written

pytest.importorskip("panel")

REGION = HalfPlane(0.5)
COUNT = 3
FORCE = "rms of actuator force"


@pytest.fixture(scope="module", autouse=True)
def few():
    """Few limits: what is shown of a trade-off hangs on no number of them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(front, "COUNT", COUNT)
        yield


@pytest.fixture(scope="module")
def own():
    return subject("quarter-car-ride")


@pytest.fixture(scope="module")
def known(own):
    """Rows of the trade-off, and the laws that were told of."""
    pane, told, shown = Front(own, LIGHT, print), {}, []
    question = asked(REGION, own, method="quadratic")
    over = pane.over(FORCE)
    pane.rows_of(question, over, lambda rows: shown.append(list(rows)), told.__setitem__)
    return shown, told


def test_a_trade_off_falls_to_what_no_limit_holds(own, known):
    shown, _ = known
    assert [len(rows) for rows in shown] == [*range(1, COUNT + 1), COUNT]
    rows = sorted(shown[-1], key=lambda row: row["value"])
    assert all(row["answer"] == "proved" for row in rows)
    bounds = [row["proved"] for row in rows]
    assert bounds == sorted(bounds, reverse=True)
    least, limits = load_specifications(spec_path("quarter-car-ride"))
    others = [each for each in limits if each.title != FORCE]
    structure = asked(REGION, own, method="quadratic", ride=True).structure(own)
    free = optimise(own.plant, least, others, REGION, structure=structure)
    assert bounds[-1] == pytest.approx(free.bounds[0].level, rel=1e-3)
    assert bounds[0] > 1.1 * bounds[-1]


def test_the_law_of_each_row_is_known_with_its_proof(own, known):
    shown, told = known
    values = {row["value"] for row in shown[-1] if row["law_of"] == row["value"]}
    assert {question.limit for question in told} == values
    question, found = next(iter(told.items()))
    assert question.ride
    assert question.over == FORCE
    assert f"{FORCE} <= " in "; ".join(found.bounds)
    assert len(found.bounds) == 4
    assert check(found.design).proved


def test_the_command_and_the_python_work_the_same_rows_out(own, known):
    pane = Front(own, LIGHT, print)
    question = asked(REGION, own, method="quadratic")
    pane.show(known[0][-1][:2], question)
    found = {}
    text = pane.python(question)
    exec(text, found)
    for row, other in zip(pane.rows, found["front"].rows, strict=True):
        assert other["own"] == pytest.approx(row["own"], rel=1e-9)
    words = pane.command(question)
    assert f"--over '{FORCE}'" in words
    assert words.count("--value") == 2
    assert words.startswith("polefence tradeoff ")


def test_what_is_picked_is_the_limit_of_the_law(own, known):
    chosen = []
    pane = Front(own, LIGHT, chosen.append)
    pane.show(known[0][-1], asked(REGION, own))
    pane.picked.data = {"number": [1]}
    pane.picked.data = {"number": [99]}
    assert chosen == [pane.rows[1]["law_of"]]
    question = asked(REGION, own, ride=True, over=FORCE, limit=chosen[0])
    pane.look(question)
    assert pane.dot.data == {"x": [chosen[0]], "y": [pane.rows[1]["proved"]]}
    pane.look(replace(question, ride=False))
    assert pane.dot.data == {"x": [], "y": []}


@pytest.fixture
def page(own, tmp_path):
    state = State.first(own, REGION, method="quadratic").asking(ride=True)
    found = Page(own, state, tmp_path)
    assert until(lambda: "proved: all poles in half_plane(0.5); rms" in found.badge.object)
    yield found
    found.close()


def test_a_law_for_the_ride_is_proved_with_its_bounds_and_saved_with_them(page, tmp_path):
    for text in ("rms of sprung-mass acceleration &lt;= ", "rms of tyre deflection &lt;= 0.00472"):
        assert text in page.badge.object
    page.save.clicks += 1
    assert until(lambda: "design.json" in page.message.object)
    answer = check(tmp_path / "design")
    assert answer.proved
    assert len(answer.claims) == 5
    assert Design.load(tmp_path / "design").region == REGION


def test_a_sensor_is_ticked_off_and_on(page):
    box = page.sensors.boxes["suspension deflection"]
    box.value = False
    assert "suspension deflection" not in page.history.now.question.measured
    assert until(lambda: "proved: all poles in half_plane(0.5); rms" in page.badge.object)
    assert page.answer.design.law.K[0, 0] == 0
    box.value = True
    assert page.history.now.question.measured == page.subject.measured
    assert len(page.history.past) == 2


def test_a_law_measures_one_signal_at_least(page):
    for box in list(page.sensors.boxes.values()):
        box.value = False
    assert len(page.history.now.question.measured) == 1
    assert "one signal at least" in page.message.object
    assert sum(box.value for box in page.sensors.boxes.values()) == 1


def test_the_ride_is_proved_beside_each_sensor(page):
    page.worth.clicks += 1
    texts = page.sensors.texts
    done = lambda: all("it: proved" in own.object for own in texts.values())  # noqa: E731
    assert until(done, patience=60)
    level = float(texts["suspension deflection"].object.split()[3])
    now = page.sensors.head.object.split()
    assert now[:3] == ["as", "ticked:", "proved"]
    assert f"acceleration &lt;= {float(now[3]):g}" in page.badge.object
    assert float(now[3]) < level
    page.sensors.boxes["suspension deflection"].value = False
    assert until(lambda: f"acceleration &lt;= {level:g}" in page.badge.object)
    assert all(not own.object for own in texts.values())  # they were of another law


def proved_force(page):
    """The bound on the force that the badge says is proved; an error where it says none."""
    assert "proved: all poles" in page.badge.object
    return float(re.search(r"actuator force &lt;= ([^;<]*)", page.badge.object)[1])


def test_the_dot_is_dragged_to_a_law(page):
    page.draw.clicks += 1
    assert until(lambda: len(page.front.points.data["x"]) == COUNT, patience=60)
    assert until(lambda: f"{COUNT} of {COUNT}" in page.progress.object)
    assert settled(60)  # without a document its rows come in a thread of their own
    page.front.picked.data = {"number": [1]}
    limit = page.front.rows[1]["law_of"]
    assert page.history.now.question.limit == limit
    # what is proved of the law that was found, next to the limit or a little inside it
    assert until(lambda: 0.998 * limit < proved_force(page) <= limit)
    assert len(page.front.points.data["x"]) == COUNT  # it is the same trade-off
    assert page.limit.value == limit
    page.limit.value = 0.0
    assert page.history.now.question.limit is None
    page.region.value = "half_plane(0.6)"
    assert len(page.front.points.data["x"]) == 0


class Document:
    """Does what is asked for in the page's thread when it is told to, as a server does."""

    def __init__(self):
        self.works, self.later, self.roots = [], [], []

    def add_next_tick_callback(self, work):
        self.works.append(work)

    def add_callback(self, add, work):
        """As the server's loop."""
        add(work)

    def call_later(self, _seconds, work):
        """As the server's loop."""
        self.later.append(work)

    def go(self):
        while self.works:
            self.works.pop(0)()


@pytest.fixture
def queued(own, tmp_path, monkeypatch):
    """A page whose answers wait for its thread."""
    import panel

    monkeypatch.setattr(panel.io, "hold", lambda document: nullcontext())
    monkeypatch.setattr(panel.state, "onload", lambda work: work())
    document = Document()
    monkeypatch.setattr("polefence.studio.page.IOLoop.current", lambda: document)
    found = Page(own, State.first(own, REGION, method="quadratic"), tmp_path, document)
    yield found, document
    found.close()


def test_all_that_the_page_changes_is_held_and_sent_together(queued, monkeypatch):
    page, document = queued
    inside, held = [], []

    @contextmanager
    def hold(_):
        inside.append(1)
        yield
        inside.pop()

    monkeypatch.setattr("panel.io.hold", hold)
    for pane in (page.badge, page.message):
        pane.param.watch(lambda _: held.append(bool(inside)), "object")
    page._soon(lambda: page._going("proof, inequality 3"))
    document.go()
    page.region.value = "no region"
    page.region.value = "half_plane(0.6)"
    assert len(held) >= 3
    assert all(held)


def test_one_change_that_nobody_sees_follows_what_changes(queued):
    """Panel may keep a message until the next one: see the test below."""
    page, document = queued
    root = SimpleNamespace(tags=["own"])
    document.roots.append(root)
    document.go()
    document.later.clear()
    page._following = False
    for number in range(3):
        page._soon(lambda number=number: page._going(f"proof, inequality {number}"))
    document.go()
    assert len(document.later) == 1
    for times in (1, 2):
        before = root.tags
        document.later.pop()()
        document.go()
        assert root.tags != before
        assert len(root.tags) == 2
        assert root.tags[0] == "own"
        page._soon(lambda: None)
        document.go()
        assert len(document.later) == 1, times
    page.close()
    document.later.pop()()
    assert document.works == []


def test_panel_keeps_a_message_until_the_next_one(monkeypatch):
    """Why a change follows. Where this fails, Panel is mended, and `Page._follow` may go."""
    from bokeh.document import Document as Real
    from panel.io import document as own

    sent, conn, real = [], Document(), Real()  # any object is a connection here
    conn._socket = object()

    def dispatched(_conn, msg):
        sent.append(msg)
        leaving = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().call_soon(leaving.set_result, None)
        return [leaving]

    def schedule(msg):  # as schedule_write_events does
        own._WRITE_BLOCK[real] = True
        own._WRITE_MSGS.setdefault(real, {}).setdefault(conn, []).append(msg)
        own._dispatch_write_task(real, own._dispatch_msgs, real)

    async def play():
        schedule("first")
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        schedule("last")
        await asyncio.sleep(0.1)
        kept = list(sent)
        schedule("next")
        await asyncio.sleep(0.1)
        return kept

    monkeypatch.setattr(own, "dispatch_django", dispatched)
    assert asyncio.run(play()) == ["first"]
    assert sent == ["first", "last", "next"]


ROW = {
    "value": 0.0047,
    "method": "tuned",
    "answer": "proved",
    "proved": 1.1,
    "law_of": 0.0047,
    "bounds": [],
}


def test_rows_of_an_older_region_are_not_shown(queued, monkeypatch):
    page, document = queued
    told = []

    def rows_of(question, over, show, know):
        show([ROW])
        told.append(question.region)

    monkeypatch.setattr(page.front, "rows_of", rows_of)
    page.draw.clicks += 1
    assert until(lambda: told)
    page._asked(region=HalfPlane(0.7))
    document.go()
    assert page.front.rows == ()
    page.draw.clicks += 1
    assert until(lambda: len(told) == 2)
    document.go()
    assert page.front.rows == (ROW,)


def test_a_trade_off_over_another_signal_says_so(queued, monkeypatch):
    page, document = queued
    monkeypatch.setattr(page.front, "rows_of", lambda asked, over, show, know: show([ROW]))
    page.over.value = "rms of tyre deflection"
    page.draw.clicks += 1
    assert until(lambda: document.works)
    document.go()
    assert "tyre deflection" in page.front.figure.xaxis[0].axis_label
    assert "--over &#x27;rms of tyre deflection&#x27; --value 0.0047" in page.takes["front"].object
    page.limit.value = 0.0047
    assert page.history.now.question.over == "rms of tyre deflection"
    page.over.value = FORCE
    assert page.history.now.question.limit is None
    assert page.front.rows == ()
    page.back.clicks += 1
    assert page.history.now.question.limit == 0.0047
    assert page.over.value == "rms of tyre deflection"
    assert page.limit.value == 0.0047


def test_a_limit_whose_law_is_another_s_is_not_offered(queued, monkeypatch):
    page, document = queued
    rows = [ROW, ROW | {"value": 0.006}]
    monkeypatch.setattr(page.front, "rows_of", lambda asked, over, show, know: show(rows))
    page.draw.clicks += 1
    assert until(lambda: document.works)
    document.go()
    assert len(page.front.points.data["x"]) == 2
    assert list(page.limit.options.values()) == [0.0, 0.0047]
    page.front.picked.data = {"number": [1]}
    assert page.history.now.question.limit == 0.0047


def test_rides_beside_sensors_are_of_the_limit_that_is_asked(queued, monkeypatch):
    page, document = queued
    asked = []

    def compare(question, say, know):
        asked.append(question)
        say("tyre deflection", "without it: proved 1.1")

    monkeypatch.setattr(page.sensors, "compare", compare)
    page._asked(ride=True, over=FORCE, limit=200.0)
    page.worth.clicks += 1
    assert until(lambda: asked)
    assert asked[0].limit == 200.0
    document.go()
    assert page.sensors.texts["tyre deflection"].object
    page._asked(limit=300.0)
    assert not page.sensors.texts["tyre deflection"].object


def test_a_button_that_is_pressed_again_begins_anew(queued, monkeypatch):
    page, _ = queued
    going, ended = [], []

    def compare(question, say, know):
        going.append(question)
        try:
            while True:
                with stage("for ever"):
                    pass
        finally:
            ended.append(question)

    monkeypatch.setattr(page.sensors, "compare", compare)
    page.worth.clicks += 1
    assert until(lambda: len(going) == 1)
    page.worth.clicks += 1
    assert until(lambda: len(ended) == 1)
    page.close()
    assert until(lambda: len(ended) == 2)


def test_a_spec_that_says_its_law_keeps_it(tmp_path):
    text = (
        spec_text("quarter-car-ride")
        + """
[law]
measured = ["suspension deflection", "sprung-mass velocity", "unsprung-mass velocity"]
schedule = []
"""
    )
    own = written(tmp_path, text)
    page = Page(own, State.first(own, HalfPlane(0.0)), tmp_path)
    assert until(lambda: "proved: all poles in half_plane(0)" in page.badge.object)
    assert page.answer.design.law.K[0, 1] == 0  # the deflection of the tyre, which it names not
    assert page.method.disabled
    page.close()


def test_a_plant_without_a_ride_has_no_trade_off(tmp_path):
    own = subject("f16")
    assert own.wanted is None
    page = Page(own, State.first(own, HalfPlane(0.5)), tmp_path)
    assert page.front is None
    assert "front" not in page.panes()
    assert {"poles", "asked", "sensors", "service"} <= set(page.panes())
    page.close()
