"""The page of a session: poles, what is asked, what is answered, and what to take away."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, wraps
from pathlib import Path
from shlex import quote
from typing import Any

import panel as pn
from bokeh.models import PrintfTickFormatter
from tornado.ioloop import IOLoop

from polefence.base.errors import PolefenceError
from polefence.certify.checks import implies_stability
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.points import values_at, values_text
from polefence.proof.text import visible
from polefence.region.regions import Region
from polefence.region.text import parse_region
from polefence.search.rows import Row
from polefence.studio import taking
from polefence.studio.answers import Answer, Newest, in_background
from polefence.studio.car import Car
from polefence.studio.folders import Folders, TakenError
from polefence.studio.front import Front
from polefence.studio.map import SIDE, Map
from polefence.studio.palette import CHOSEN, DARK, FITTED, LIGHT, STYLE
from polefence.studio.poles import Poles
from polefence.studio.question import Question
from polefence.studio.rides import ROADS, rides
from polefence.studio.sensors import Sensors
from polefence.studio.service import Service, margins_of
from polefence.studio.state import LEAST_SPEED, MOST_SPEED, MOST_TRAVEL, History, State
from polefence.studio.subject import Subject
from polefence.studio.words import of_parameter, paragraph, safe, taken

WIDE = {"sizing_mode": "stretch_width"}
# Columns of a wide screen, which scroll by themselves; on others all stand one after the other.
COLUMNS = ("poles", "map"), ("car", "traces"), ("asked", "road", "front", "sensors", "service")
OFTEN = 1.0  # [s] between two words about how long a search or a proof takes
OWN = "as the spec has it", 0.0  # the limit that is nobody's choice


def _together(change: Callable[..., None]) -> Callable[..., None]:
    """Return a page's answer to what its user does, of which all changes are held."""

    @wraps(change)
    def held(self: Page, *given: Any, **more: Any) -> None:
        self._hold(lambda: change(self, *given, **more))

    return held


class Page:
    """One view of a session: a tab of the browser.

    Parameters
    ----------
    subject : Subject
    state : State
        What it begins with.
    folder : Path or Folders
        Where files are saved; pages of one server share `Folders`, so that none saves where another
        does.
    document : bokeh.document.Document, optional
        What the page is shown in; without one, answers come in a thread of their own.
    dark : bool
        Whether it is dark.
    """

    def __init__(
        self,
        subject: Subject,
        state: State,
        folder: Path | Folders,
        document: Any = None,
        dark: bool = False,
    ) -> None:
        self.subject = subject
        self.folders = folder if isinstance(folder, Folders) else Folders(folder)
        self.plant = subject.plant
        self.history = History(state)
        self.answer: Answer | None = None
        self._document = document
        self._loop = None if document is None else IOLoop.current()
        self.newest = Newest(
            subject,
            lambda answer: self._soon(partial(self._answered, answer)),
            lambda number, words: self._soon(
                partial(self._if_newest, number, partial(self._going, words))
            ),
        )
        self._jobs, self._saved = dict[str, int](), dict[str, str]()
        self._before: Question | None = None
        self._quiet = self._closed = self._following = self._ticking = False
        self._fitted: bool | None = None  # to the poles of a ride, or of a region
        self._far, self._since = "", 0.0
        self._changes = 0
        self._panes(DARK if dark else LIGHT)
        self._widgets()
        if document is None:
            self._ask()
        else:  # what changes before the browser listens is lost
            pn.state.onload(partial(self._soon, self._ask))

    def _panes(self, palette: Any) -> None:
        subject, state = self.subject, self.history.now
        self.poles = Poles(self.plant, state, self._dragged, palette)
        self.car: Car | None = None
        if rides(self.plant, subject.car):
            self.car = Car(self.plant, subject.car, palette, subject.dampers)
        self.map: Map | None = None
        if len(self.plant.parameters) > 1:
            self.map = Map(self.plant, palette, self._pointed)
            self.map.look(state)
        self.sensors = Sensors(subject, self._ticked)
        self.front = Front(subject, palette, self._limited) if subject.overs else None
        self.service = Service(self._wrong)

    def _widgets(self) -> None:
        state = self.history.now
        self.region = pn.widgets.TextInput(label="Region", value=str(state.region), **WIDE)
        self.region.param.watch(self._typed, "value")
        self.aim = pn.widgets.RadioButtonGroup(
            label="Look for",
            options={"a law for the region": False, "the best ride": True},
            stylesheets=[CHOSEN],
        )
        self.aim.param.watch(lambda event: self._asked(ride=event.new), "value")
        self.method = pn.widgets.Select(label="Method", options=list(METHODS), **WIDE)
        self.method.param.watch(lambda event: self._asked(method=event.new), "value")
        self.sliders = [self._slider(p, dict(state.values)[p.name]) for p in self.plant.parameters]
        self._roads()
        html = partial(pn.pane.HTML, "", stylesheets=[STYLE])
        self.ride, self.count, self.badge, self.message = html(), html(), html(), html()
        self.takes = {key: html() for key in ("law", "drive", "service", "map", "front", "sensors")}
        button = pn.widgets.Button
        self.back, self.forward, self.fit = (button(label=x) for x in ("Undo", "Redo", "Fit view"))
        self.save, self.report, self.code = (button(label=x) for x in ("Save", "Report", "C code"))
        self.name = pn.widgets.TextInput(label="Save under the name", **WIDE)
        self.name.value = self.folders.begin(self)
        self.back.on_click(lambda _: self._asked_again(self.history.back()))
        self.forward.on_click(lambda _: self._asked_again(self.history.forward()))
        self.fit.on_click(lambda _: self.poles.fit())
        for button, name in ((self.save, "save"), (self.report, "report"), (self.code, "code")):
            button.on_click(lambda _, name=name: self._take(name))
        self.find = pn.widgets.Button(label="Show the car that fails", visible=False)
        self.find.on_click(lambda _: self._find())
        self.worth = pn.widgets.Button(label="What is each sensor worth?")
        self.worth.on_click(lambda _: self._compare())
        self._trade()
        self._shown()

    def _slider(self, parameter: Any, value: float) -> Any:
        low, high = float(parameter.low), float(parameter.high)
        slider = pn.widgets.FloatSlider(
            label=visible(of_parameter(parameter)),
            start=low,
            end=high,
            step=(high - low) / 100,
            value=value,
            format=PrintfTickFormatter(format="%.4g"),
            stylesheets=[FITTED],
            **WIDE,
        )
        slider.param.watch(lambda event: self._slid(parameter.name, event.new), "value")
        return slider

    def _roads(self) -> None:
        slider = pn.widgets.FloatSlider
        self.road = pn.widgets.Select(label="Road", options=list(ROADS), **WIDE)
        self.speed = slider(
            label="Speed [m/s]", start=LEAST_SPEED, end=MOST_SPEED, step=1.0, **WIDE
        )
        self.travel = slider(
            label="Bump stops at [mm]; 0: none", end=1e3 * MOST_TRAVEL, step=1.0, **WIDE
        )
        self.beside = pn.widgets.Checkbox(label="", stylesheets=[FITTED])
        self.road.param.watch(lambda event: self._driven(road=event.new), "value")
        self.speed.param.watch(lambda event: self._driven(speed=event.new), "value")
        self.travel.param.watch(lambda event: self._driven(travel_limit=event.new / 1e3), "value")
        self.beside.param.watch(lambda event: self._driven(beside=event.new), "value")
        if self.plant.parameters:
            first = self.plant.parameters[0]
            name = visible(f"{first.label} {first.name}".strip())
            self.beside.label = f"Also show the smallest and the largest {name}"

    def _trade(self) -> None:
        titles = {visible(limit.title): limit.title for limit in self.subject.overs} or {"": ""}
        self.over = pn.widgets.Select(label="Trade-off over", options=titles, **WIDE)
        self.over.param.watch(lambda _: self._swept(), "value")
        self.draw = pn.widgets.Button(label="Draw the trade-off")
        self.draw.on_click(lambda _: self._drawn_front())
        self.progress = pn.pane.HTML("", stylesheets=[STYLE])
        self.limit = pn.widgets.Select(label="Limit", options=dict([OWN]), **WIDE)
        self.limit.param.watch(lambda event: self._limited(event.new), "value")

    def panes(self) -> dict[str, Any]:
        """Return all panes of this session, by their names."""
        panes = {
            "head": self._head_pane(),
            "poles": pn.pane.Bokeh(self.poles.figure, sizing_mode="scale_width", min_width=280),
            "asked": self._asked_pane(),
        }
        if self.car is not None:
            panes |= self._car_panes(*self.car.views)
        if self.map is not None:
            plot = pn.pane.Bokeh(self.map.figure, min_width=280, **WIDE)
            panes["map"] = pn.Column(plot, self.count, self.takes["map"], **WIDE)
        if self.front is not None:
            plot = pn.pane.Bokeh(self.front.figure, min_width=280, **WIDE)
            front = (self.over, self.draw, self.progress, plot, self.limit, self.takes["front"])
            panes["front"] = pn.Column(*front, **WIDE)
        worth = (self.worth,) if self.subject.wanted is not None else ()
        sensors = (self.sensors.view, *worth, self.takes["sensors"])
        panes["sensors"] = pn.Column(*sensors, **WIDE)
        panes["service"] = pn.Column(self.service.view, self.takes["service"], **WIDE)
        return panes

    def _asked_pane(self) -> Any:
        aim = (self.aim,) if self.subject.wanted is not None else ()
        return pn.Column(
            *aim,
            self.region,
            self.method,
            *self.sliders,
            self.name,
            self.takes["law"],
            min_width=280,
            **WIDE,
        )

    def _head_pane(self) -> Any:
        """Return what is always in sight: the answer, and what is done with it."""
        buttons = (self.back, self.forward, self.fit, self.save, self.report, self.code)
        return pn.Column(
            pn.FlexBox(self.badge, self.find, *buttons, align_items="center"), self.message, **WIDE
        )

    def _car_panes(self, scene: Any, traces: Any) -> dict[str, Any]:
        drawn = [pn.pane.Bokeh(plot, min_width=280, **WIDE) for plot in (scene, traces)]
        beside = (self.beside,) if self.plant.parameters else ()
        asked = (self.road, self.speed, self.travel, *beside, self.takes["drive"])
        return {
            "car": drawn[0],
            "traces": pn.Column(self.ride, drawn[1], **WIDE),
            "road": pn.Column(*asked, **WIDE),
        }

    def _soon(self, work: Callable[[], object]) -> None:
        """Have something done in the page's own thread."""
        if self._loop is None:
            work()
        else:
            # In the server's loop nothing is held: a callback that is added then is not lost.
            work = partial(self._hold, work)
            self._loop.add_callback(self._document.add_next_tick_callback, work)

    def _hold(self, work: Callable[[], object]) -> None:
        """Have all changes that some work makes reach the browser in one message.

        All go this way: what Panel holds and what Bokeh sends at once may overtake one another, and
        a badge would stay behind its law. A change that nobody sees follows: a message that Panel
        schedules while another one is just leaving stays with it until the next.
        """
        if self._document is None or self._loop is None:
            work()
            return
        with pn.io.hold(self._document):
            work()
        if not self._following:
            self._following = True
            # [s] by which Panel has sent what it kept back
            self._loop.call_later(0.2, self._follow)

    def _follow(self) -> None:
        self._following = False
        if not self._closed:
            self._document.add_next_tick_callback(self._change_nothing)

    def _change_nothing(self) -> None:
        """Change a tag of what is there, which nobody looks at."""
        with pn.io.hold(self._document):
            for root in self._document.roots[:1]:
                self._changes += 1
                others = [tag for tag in root.tags if not isinstance(tag, int)]
                root.tags = [*others, self._changes]

    @_together
    def _go(self, history: History) -> None:
        """Show another state, and ask about it if it asks something else."""
        before, self.history = self.history.now, history
        now = history.now
        self._forget(before.question, now.question)
        self._shown()
        self.poles.look(now)
        if now.values != before.values:
            self._mapped()
        if now.question != before.question:
            self._ask()
        elif now != before:
            self._ride()

    def _forget(self, before: Question, now: Question) -> None:
        """Forget what was worked out of another question."""
        if _of_ride(before) != _of_ride(now):
            self.sensors.clear()
        if before.basis != now.basis:
            self._no_rows()

    def _no_rows(self) -> None:
        if self.front is not None:
            self.front.show((), self.history.now.question)
            self.progress.object = ""

    @_together
    def _swept(self) -> None:
        """Have the trade-off over another signal; a limit on the last one goes."""
        if self._quiet:
            return
        self._no_rows()
        if self.history.now.question.limit is not None:
            self._asked(over="", limit=None)

    def _asked_again(self, history: History) -> None:
        """Go to what was asked at another time, with the car that is looked at now."""
        self._before = None
        self._go(replace(history, now=replace(self.history.now, question=history.now.question)))

    def _asked(self, **changed: Any) -> None:
        """Ask something else; it is a step to undo."""
        if not self._quiet:
            self._settled()
            self._go(self.history.then(self.history.now.asking(**changed)))

    @_together
    def _ticked(self, measured: tuple[str, ...]) -> None:
        if measured:
            self._asked(measured=measured)
        else:
            self.message.object = paragraph("a law measures one signal at least")
            self.sensors.look(self.history.now.question)

    def _limited(self, limit: float) -> None:
        """Ask for the best ride within a limit of the trade-off; 0: within the spec's own."""
        if limit:
            self._asked(over=self.over.value, limit=limit, ride=True)
        else:
            self._asked(over="", limit=None)

    def _followed(self) -> None:
        """Have map and car follow a law of which all is known, once no handle is held."""
        if self._before is None and self.answer is not None and self.answer.final:
            self._mapped()
            self._ride()

    def _ride(self) -> None:
        """Drive the car that is looked at."""
        if self.car is None:
            return
        design = None if self.answer is None else self.answer.design
        try:
            lines = self.car.show(design, self.history.now)
            self.ride.object = "".join(paragraph(f"{who}: {text}") for who, text in lines)
        except PolefenceError as error:
            self.car.clear()
            self.ride.object = paragraph(str(error))

    def _pointed(self, values: dict[str, float]) -> None:
        """Look at the car that was pointed at in the map."""
        state, known = self.history.now, {p.name: p for p in self.plant.parameters}
        for name, value in values.items():
            low, high = float(known[name].low), float(known[name].high)
            state = state.at(name, min(max(float(f"{value:.4g}"), low), high))
        self._go(replace(self.history, now=state))

    def _driven(self, **changed: Any) -> None:
        if not self._quiet:
            self._settled()
            self._go(replace(self.history, now=replace(self.history.now, **changed)))

    def _shown(self) -> None:
        """Have the widgets say what the state is; of a region that is still dragged, it alone."""
        self._quiet = True
        try:
            self.region.value = str(self.history.now.region)
            if self._before is None:
                self._told()
        finally:
            self._quiet = False

    def _told(self) -> None:
        now, asked = self.history.now, self.history.now.question
        self.aim.value, self.method.value = asked.ride, asked.method
        structure = self.subject.structure
        self.method.disabled = structure is not None and structure.schedule is not None
        self.road.value, self.speed.value = now.road, now.speed
        self.travel.value, self.beside.value = 1e3 * now.travel_limit, now.beside
        self.sensors.look(asked)
        for slider, (_, value) in zip(self.sliders, now.values, strict=True):
            slider.value = value
        if self.front is not None:
            if asked.over:
                self.over.value = asked.over
            self.front.look(asked)
            self._limits()
        self.back.disabled, self.forward.disabled = not self.history.past, not self.history.future
        self._recipes()

    def _limits(self) -> None:
        """Offer the limits of the trade-off, and the one that is asked for."""
        now = self.history.now.question.limit or 0.0
        known = {now} - {0.0} | set(() if self.front is None else self.front.limits)
        options = dict([OWN]) | {f"{limit:g}": limit for limit in sorted(known)}
        if options != self.limit.options:
            self.limit.options = options
        self.limit.value = now

    def _recipes(self) -> None:
        """Have each view show the command line and the Python that give it."""
        now, subject = self.history.now, self.subject
        asked, python = now.question, now.python(subject)
        texts = {
            "law": (asked.command(subject), python),
            "service": (
                f"polefence service {quote(asked.given or 'design')}",
                f"{python}\nmargins = pf.in_service(design)",
            ),
            "sensors": self.sensors.recipe(asked),
        }
        if self.car is not None:
            texts["drive"] = (now.drive(subject), f"{python}\n{now.drive_python(subject)}")
        if self.map is not None:
            texts["map"] = ("", f"{python}\n{self.map.python(now)}")
        if self.front is not None and self.front.rows:
            texts["front"] = (self.front.command(asked), self.front.python(asked))
        for key, pair in texts.items():
            self.takes[key].object = taken(*pair)

    def _ask(self) -> None:
        now = self.history.now
        self.answer = None
        self._begun()
        self.find.visible = False
        self.service.allow(False)
        self._takeable(False)
        self.count.object = self.message.object = ""
        self._saved.clear()
        self.newest.ask(now.question)

    def _going(self, words: str) -> None:
        """Say how far a search or a proof is, in the badge that says that it is under way."""
        self._far = words
        self._at_work()

    def _begun(self) -> None:
        """Say that a search or a proof has begun, and from time to time that it goes on."""
        self._far, self._since = "", time.monotonic()
        self._at_work()
        if self._loop is not None and not self._ticking:
            self._ticking = True
            self._loop.call_later(OFTEN, self._tick)

    def _tick(self) -> None:
        """Say how long it takes: a proof may run for long without a word of its own."""
        self._ticking = not self._closed and (self.answer is None or not self.answer.final)
        if self._ticking and self._loop is not None:
            self._soon(self._at_work)
            self._loop.call_later(OFTEN, self._tick)

    def _at_work(self) -> None:
        if self.answer is not None and self.answer.final:
            return
        what = "being searched" if self.answer is None else "being proved"
        said, seconds = [f"{what}: {self.history.now.region}"], time.monotonic() - self._since
        said += [self._far] if self._far else []
        said += [f"for {seconds:.0f} s now"] if seconds >= 3.0 else []
        self._say("working", "; ".join(said))

    def _takeable(self, proved: bool) -> None:
        self.report.disabled = self.code.disabled = not proved

    def _say(self, word: str, text: str) -> None:
        """Have the badge say something."""
        self.badge.object = f'<div role="status" class="badge {word}">{safe(text)}</div>'

    @_together
    def _dragged(self, region: Region, end: bool) -> None:
        """Ask about a region that is being dragged; it is a step to undo once that ends."""
        now = self.history.now
        if self._before is None:
            self._before = now.question
        self._go(replace(self.history, now=now.asking(region=region)))
        if end:
            self._settled()
            self._shown()
            self._followed()

    def _settled(self) -> None:
        """Make of a drag a step to undo, whether or not the browser told its end."""
        if self._before is not None:
            first, self._before = replace(self.history.now, question=self._before), None
            self.history = replace(self.history, now=first).then(self.history.now)

    @_together
    def _typed(self, event: Any) -> None:
        if self._quiet:
            return
        try:
            region = parse_region(event.new)
        except PolefenceError as error:
            self.message.object = paragraph(str(error))
            return
        self.message.object = ""
        self._asked(region=region)

    def _slid(self, name: str, value: float) -> None:
        if not self._quiet:
            self._settled()
            self._go(replace(self.history, now=self.history.now.at(name, value)))

    def _answered(self, answer: Answer) -> None:
        """Show an answer, unless a newer question has been asked meanwhile."""
        if answer.number != self.newest.number:
            return
        self.answer = answer
        if answer.final:
            self._say(*_words(answer))
        else:
            self._begun()
        self.find.visible = answer.check is not None and answer.check.alpha is not None
        self.service.allow(answer.proved)
        self._takeable(answer.proved)
        if answer.check is None:
            self._drawn(answer)
        if answer.final:
            self._recipes()
            self._followed()

    def _drawn(self, answer: Answer) -> None:
        """Show the poles of a law, and none where there is none."""
        self.poles.show(answer.design, answer.question.region)
        if self._fitted != answer.question.ride:
            self._fitted = answer.question.ride
            self.poles.fit()

    def _mapped(self) -> None:
        """Show in the map where the poles are of the law that is known, and the car looked at."""
        if self.map is None:
            return
        self.map.look(self.history.now)
        if self.answer is not None:
            region = self.answer.question.region
            count = self.map.show(self.answer.design, region, self.history.now)
            words = {None: "There is no law", 0: f"None of {SIDE**2} plants leaves the region"}
            text = words.get(count, f"{count} of {SIDE**2} plants leave the region")
            self.count.object = paragraph(f"{text}.")

    @_together
    def _find(self) -> None:
        """Look at the plant whose poles leave the region."""
        check = None if self.answer is None else self.answer.check
        alpha = None if check is None else check.alpha
        values = None if alpha is None else values_at(self.plant, alpha)
        if values is None:
            weights = ", ".join(map(str, alpha or ()))
            self.message.object = paragraph(f"leaves the region at alpha = ({weights})")
            return
        state = self.history.now
        for name, value in values.items():
            state = state.at(name, value)
        self.message.object = paragraph(f"leaves the region at {values_text(self.plant, values)}")
        self._go(replace(self.history, now=state))

    @_together
    def _wrong(self) -> None:
        """Work out what errors the law bears in service; drop them for a newer law."""
        answer = self.answer
        if answer is None or answer.design is None:
            return
        self.service.wait()
        number, design = answer.number, answer.design

        def show(text: str) -> None:
            self._soon(partial(self._if_newest, number, partial(self.service.show, text)))

        self._background(
            "service",
            lambda: show(margins_of(design)),
            lambda: number == self.newest.number,
            lambda reason: show(paragraph(reason)),
        )

    def _if_newest(self, number: int, work: Callable[[], object]) -> None:
        if number == self.newest.number:
            work()

    def _background(
        self,
        job: str,
        work: Callable[[], object],
        wanted: Callable[[], bool],
        complain: Callable[[str], object],
    ) -> None:
        """Do a job in a thread of its own, in place of an older one of this name."""
        number = self._jobs[job] = self._jobs.get(job, 0) + 1

        def still() -> bool:
            return not self._closed and number == self._jobs[job] and wanted()

        in_background(work, still, lambda reason: self._soon(partial(complain, reason)))

    def _complain(self, reason: str) -> None:
        self.message.object = paragraph(reason)

    @_together
    def _compare(self) -> None:
        """Work out the ride of what is measured, and of each signal the other way."""
        asked = _of_ride(self.history.now.question)

        def wanted() -> bool:
            return _of_ride(self.history.now.question) == asked

        def say(name: str, text: str) -> None:
            self._soon(lambda: self.sensors.say(name, text) if wanted() else None)

        self.sensors.clear()
        know = self.newest.know
        self._background(
            "sensors",
            lambda: self.sensors.compare(asked, say, know),
            wanted,
            lambda reason: say("", reason),
        )

    @_together
    def _drawn_front(self) -> None:
        """Work the trade-off out, for the region and what is measured now."""
        front, asked = self.front, self.history.now.question
        if front is None:
            return
        over = front.over(self.over.value)

        def wanted() -> bool:
            same = self.history.now.question.basis == asked.basis
            return same and self.over.value == over.title

        def show(rows: Sequence[Row]) -> None:
            known = tuple(rows)
            self._soon(lambda: self._rows(known) if wanted() else None)

        def complain(reason: str) -> None:
            self.progress.object = paragraph(reason)

        front.show((), asked, over)
        self.progress.object = paragraph("the law without that limit is being searched")
        know = self.newest.know
        self._background("front", lambda: front.rows_of(asked, over, show, know), wanted, complain)

    def _rows(self, rows: Sequence[Row]) -> None:
        if self.front is None:
            return
        self.front.show(rows, self.history.now.question)
        self.progress.object = paragraph(f"{len(rows)} of {self.front.count} limits")
        self._shown()

    @_together
    def _take(self, what: str) -> None:
        """Write what is taken away into the folder of the page's name."""
        state, answer, name = self.history.now, self.answer, self.name.value.strip()
        works: dict[str, Callable[[Path], list[Path]]] = {
            "save": lambda folder: taking.save(folder, self.subject, state, answer),
            "report": lambda folder: taking.report(folder, state, answer) if answer else [],
            "code": lambda folder: taking.code(folder, answer) if answer else [],
        }

        def told(text: str) -> None:
            self._saved[what] = text
            self.message.object = "".join(map(paragraph, self._saved.values()))

        def work() -> None:
            try:
                with self.folders.writing(self, name) as folder:
                    paths = works[what](folder)
            except TakenError as error:
                self._soon(partial(setattr, self.name, "value", error.free))
                raise
            names = ", ".join(str(path) for path in paths)
            if what == "save" and len(paths) == 1:
                names += "; no design, for none is proved"
            self._soon(partial(told, f"saved: {names}"))

        told("being written ...")
        self._background(what, work, lambda: True, told)

    def close(self) -> None:
        """End what is under way."""
        self._closed = True
        self.folders.end(self)
        self.newest.close()


def _of_ride(question: Question) -> Question:
    """Return the question of the best ride, in all else the same."""
    return replace(question, ride=True, given="")


def _words(answer: Answer) -> tuple[str, str]:
    """Return the class of a badge, and what it says."""
    region = answer.question.region
    if answer.result is None:
        return "refuted" if answer.refuted else "undecided", answer.reason
    if answer.check is None:  # which says itself how far it is
        return "working", ""
    proved = "; ".join((f"proved: all poles in {region}", *answer.result.bounds))
    if answer.result.design.note:
        proved += f"; {answer.result.design.note}"
    plant = answer.result.design.plant
    if not implies_stability(plant, region):
        proved += "; note: this region does not imply stability"
    if plant.data is not None:
        proved += f"; {plant.data.note}"
    words = {
        "proved": proved,
        "refuted": f"refuted: poles of this law leave {region}",
        "undecided": f"undecided: {answer.check.reason}",
    }
    return answer.check.answer, words[answer.check.answer]
