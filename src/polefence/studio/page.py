"""The page of a session: poles, what is asked, what is answered, and what to take away."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import panel as pn

from polefence.base.errors import PolefenceError
from polefence.base.files import write_text
from polefence.design.checks import implies_stability
from polefence.design.design import FILE_NAME, Design
from polefence.design.margins import in_service
from polefence.design.progress import progress
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.points import values_at, values_text
from polefence.proof.text import visible
from polefence.region.regions import Region
from polefence.region.text import parse_region
from polefence.studio.answers import Answer, Newest, SupersededError
from polefence.studio.car import Car
from polefence.studio.map import SIDE, Map
from polefence.studio.palette import DARK, LIGHT
from polefence.studio.poles import Poles
from polefence.studio.rides import ROADS, rides
from polefence.studio.state import LEAST_SPEED, MOST_SPEED, PLANT, SESSION, History, Session
from polefence.studio.words import code, margins_table, paragraph, safe

WIDE = {"sizing_mode": "stretch_width"}
LARGE, SMALL = {"flex": "3 1 520px"}, {"flex": "2 1 340px"}
STYLE = """
.badge { font-weight: 600; padding: 4px 10px; border-radius: 4px; border: 2px solid; }
.proved { border-color: #2b5c8a; }
.proved::before { content: "\\2713  "; }
.refuted { border-color: #d95f02; border-style: double; }
.refuted::before { content: "\\2717  "; }
.undecided, .working { border-color: #888888; border-style: dashed; }
.margins { border-collapse: collapse; }
.margins th { text-align: left; font-weight: normal; }
.margins th, .margins td { padding: 2px 10px 2px 0; }
.bar { width: 110px; height: 12px; border: 1px solid #8a8a8a; }
.bar div { height: 100%; background: #2b5c8a; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; }
"""


class Page:
    """One view of a session: a tab of the browser.

    Parameters
    ----------
    session : Session
    name : str
        How the spec is called in commands.
    folder : Path
        Where files are saved.
    document : bokeh.document.Document, optional
        What the page is shown in; without one, answers come in a thread of their own.
    dark : bool
        Whether it is dark.
    """

    def __init__(
        self,
        session: Session,
        name: str,
        folder: Path,
        document: Any = None,
        dark: bool = False,
    ) -> None:
        self.session, self.name, self.folder = session, name, folder
        self.plant = session.plant
        self.history = History(session.state)
        self.answer: Answer | None = None
        self._document = document
        self.newest = Newest(self.plant, lambda own: self._soon(partial(self._answered, own)))
        palette = DARK if dark else LIGHT
        self.poles = Poles(self.plant, session.state, self._dragged, palette)
        self.car = Car(self.plant, palette) if rides(self.plant) else None
        self.map: Map | None = None
        if len(self.plant.parameters) > 1:
            self.map = Map(self.plant, palette, self._pointed)
            self.map.look(session.state)
        self._before: Region | None = None
        self._quiet = self._fitted = False
        self._widgets()
        if document is None:
            self._ask()
        else:  # what changes before the browser listens is lost
            pn.state.onload(self._ask)

    def _widgets(self) -> None:
        state = self.history.now
        self.region = pn.widgets.TextInput(label="Region", value=str(state.region), **WIDE)
        self.region.param.watch(self._typed, "value")
        self.method = pn.widgets.Select(
            label="Method", options=list(METHODS), value=state.method, **WIDE
        )
        self.method.param.watch(self._chosen, "value")
        self.sliders = []
        values = dict(state.values)
        for p in self.plant.parameters:
            unit = f" [{p.unit}]" if p.unit else ""
            low, high = float(p.low), float(p.high)
            own = pn.widgets.FloatSlider(
                label=visible(f"{p.name}{unit}"),
                start=low,
                end=high,
                step=(high - low) / 100,
                value=values[p.name],
                **WIDE,
            )
            own.param.watch(lambda event, name=p.name: self._slid(name, event.new), "value")
            self.sliders.append(own)
        self.road = pn.widgets.Select(label="Road", options=list(ROADS), value=state.road, **WIDE)
        self.speed = pn.widgets.FloatSlider(
            label="Speed [m/s]",
            start=LEAST_SPEED,
            end=MOST_SPEED,
            step=1.0,
            value=state.speed,
            **WIDE,
        )
        self.road.param.watch(lambda event: self._driven(road=event.new), "value")
        self.speed.param.watch(lambda event: self._driven(speed=event.new), "value")
        self.ride = pn.pane.HTML("", stylesheets=[STYLE])
        self.count = pn.pane.HTML("", stylesheets=[STYLE])
        self.badge = pn.pane.HTML("", stylesheets=[STYLE])
        self.message = pn.pane.HTML("", stylesheets=[STYLE])
        self.take = pn.pane.HTML("", stylesheets=[STYLE])
        self.back, self.forward, self.fit, self.save = (
            pn.widgets.Button(label=label) for label in ("Undo", "Redo", "Fit view", "Save")
        )
        self.wrong = pn.widgets.Button(label="How wrong may it be?", disabled=True)
        self.wrong.on_click(lambda _: self._wrong())
        self.margins = pn.pane.HTML("", stylesheets=[STYLE])
        self.find = pn.widgets.Button(label="Show the car that fails", visible=False)
        self.back.on_click(lambda _: self._asked_again(self.history.back()))
        self.forward.on_click(lambda _: self._asked_again(self.history.forward()))
        self.fit.on_click(lambda _: self.poles.fit())
        self.save.on_click(lambda _: self._save())
        self.find.on_click(lambda _: self._find())
        self._shown()

    def view(self) -> Any:
        """Return what the page shows."""
        asked = pn.Column(
            pn.Row(self.badge, self.find),
            self.region,
            self.method,
            *self.sliders,
            *((self.road, self.speed, self.ride) if self.car is not None else ()),
            pn.FlexBox(self.back, self.forward, self.fit, self.save),
            self.message,
            self.wrong,
            self.margins,
            self.take,
            min_width=280,
            sizing_mode="stretch_width",
        )
        own = pn.pane.Bokeh(self.poles.figure, sizing_mode="scale_width", min_width=280)
        shown = [pn.Column(own, styles=LARGE), pn.Column(asked, styles=SMALL)]
        if self.car is not None:
            for part, styles in zip(self.car.views, (LARGE, SMALL), strict=True):
                own = pn.pane.Bokeh(part, min_width=280, **WIDE)
                shown.append(pn.Column(own, styles=styles))
        if self.map is not None:
            own = pn.pane.Bokeh(self.map.figure, min_width=280, **WIDE)
            shown.append(pn.Column(own, self.count, styles=SMALL))
        return pn.FlexBox(*shown, **WIDE)

    def _soon(self, work: Callable[[], object]) -> None:
        """Have something done in the page's own thread."""
        if self._document is None:
            work()
        else:
            self._document.add_next_tick_callback(work)

    def _together(self) -> AbstractContextManager[Any]:
        """Have all changes inside reach the browser in one message."""
        return nullcontext() if self._document is None else pn.io.hold(self._document)

    def _go(self, history: History) -> None:
        """Show another state, and ask about it if it asks something else."""
        before, self.history = self.history.now, history
        now = history.now
        with self._together():
            self._shown()
            self.poles.look(now)
            self._mapped()
            if (now.region, now.method) != (before.region, before.method):
                self._ask()
            elif now != before:
                self._ride()

    def _asked_again(self, history: History) -> None:
        """Go to what was asked at another time, with the car that is looked at now."""
        asked, now = history.now, self.history.now
        self._go(replace(history, now=replace(now, region=asked.region, method=asked.method)))

    def _ride(self) -> None:
        """Drive the car that is looked at."""
        if self.car is None:
            return
        design = None if self.answer is None else self.answer.design
        try:
            with self._together():
                law, passive = self.car.show(design, self.history.now)
                both = [("passive", passive), *([("with this law", law)] if law else [])]
                self.ride.object = "".join(
                    paragraph(f"{who}: {own.comfort:.3g} m/s², {own.words}") for who, own in both
                )
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
            self._go(replace(self.history, now=replace(self.history.now, **changed)))

    def _shown(self) -> None:
        """Have the widgets say what the state is."""
        now = self.history.now
        self._quiet = True
        try:
            self.region.value = str(now.region)
            self.method.value = now.method
            self.road.value, self.speed.value = now.road, now.speed
            for own, (_, value) in zip(self.sliders, now.values, strict=True):
                own.value = value
        finally:
            self._quiet = False
        self.back.disabled, self.forward.disabled = not self.history.past, not self.history.future
        commands = [now.command(self.name), now.python(self.name, len(self.plant.vertices))]
        if self.car is not None:
            commands.insert(1, now.drive(self.name))
        self.take.object = "".join(code(text) for text in commands)

    def _ask(self) -> None:
        now = self.history.now
        self.answer = None
        self._say("working", f"being searched: {now.region}")
        self.find.visible, self.wrong.disabled = False, True
        self.margins.object = self.count.object = self.message.object = ""
        self.newest.ask(now.region, now.method)

    def _say(self, word: str, text: str) -> None:
        """Have the badge say something."""
        self.badge.object = f'<div role="status" class="badge {word}">{safe(text)}</div>'

    def _dragged(self, region: Region, end: bool) -> None:
        """Ask about a region that is being dragged; it is a step to undo once that ends."""
        now = self.history.now
        if self._before is None:
            self._before = now.region
        self._go(replace(self.history, now=replace(now, region=region)))
        if end:
            first, self._before = replace(self.history.now, region=self._before), None
            self.history = replace(self.history, now=first).then(self.history.now)
            self._shown()

    def _typed(self, event: Any) -> None:
        if self._quiet:
            return
        try:
            region = parse_region(event.new)
        except PolefenceError as error:
            self.message.object = paragraph(str(error))
            return
        self.message.object = ""
        self._go(self.history.then(replace(self.history.now, region=region)))

    def _chosen(self, event: Any) -> None:
        if not self._quiet:
            self._go(self.history.then(replace(self.history.now, method=event.new)))

    def _slid(self, name: str, value: float) -> None:
        if not self._quiet:
            self._go(replace(self.history, now=self.history.now.at(name, value)))

    def _answered(self, own: Answer) -> None:
        """Show an answer, unless a newer question has been asked meanwhile."""
        if own.number != self.newest.number:
            return
        self.answer = own
        with self._together():
            self._say(*_words(own))
            self.find.visible = own.check is not None and own.check.alpha is not None
            self.wrong.disabled = own.check is None or not own.check.proved
            if own.check is None:
                self.margins.object = ""
                self._drawn(own)
            if own.final:
                self._ride()

    def _drawn(self, own: Answer) -> None:
        """Show the poles of a law, and none where there is none."""
        self.poles.show(own.design, own.region)
        if not self._fitted:
            self._fitted = True
            self.poles.fit()
        self._mapped()

    def _mapped(self) -> None:
        """Show in the map where the poles are of the law that is known, and the car looked at."""
        if self.map is None:
            return
        self.map.look(self.history.now)
        if self.answer is not None:
            count = self.map.show(self.answer.design, self.answer.region, self.history.now)
            words = {None: "There is no law", 0: f"None of {SIDE**2} cars leaves the region"}
            text = words.get(count, f"{count} of {SIDE**2} cars leave the region")
            self.count.object = paragraph(f"{text}.")

    def _find(self) -> None:
        """Look at the car whose poles leave the region."""
        alpha = (
            None if self.answer is None or self.answer.check is None else self.answer.check.alpha
        )
        values = None if alpha is None else values_at(self.plant, alpha)
        if values is None:
            weights = ", ".join(str(own) for own in alpha or ())
            self.message.object = paragraph(f"leaves the region at alpha = ({weights})")
            return
        state = self.history.now
        for name, value in values.items():
            state = state.at(name, value)
        self.message.object = paragraph(f"leaves the region at {values_text(self.plant, values)}")
        self._go(replace(self.history, now=state))

    def _wrong(self) -> None:
        """Work out what errors the law bears in service; drop them for a newer law."""
        own = self.answer
        if own is None or own.design is None:
            return
        self.margins.object, self.wrong.disabled = paragraph("being proved ..."), True
        threading.Thread(target=self._serviced, args=(own.number, own.design), daemon=True).start()

    def _serviced(self, number: int, design: Design) -> None:
        def heed(_: str) -> None:
            if number != self.newest.number:
                raise SupersededError

        try:
            with progress(heed):
                text = margins_table(in_service(design))
        except SupersededError:
            return
        except PolefenceError as error:
            text = paragraph(str(error))
        except Exception as error:
            self._soon(partial(self._margins, number, paragraph(f"a fault of ours: {error!r}")))
            raise
        self._soon(partial(self._margins, number, text))

    def _margins(self, number: int, text: str) -> None:
        if number == self.newest.number:
            self.margins.object, self.wrong.disabled = text, False

    def _save(self) -> None:
        """Write the session, and the design where it is proved, into the session's folder."""
        try:
            session = replace(self.session, state=self.history.now)
            saved = [self.folder / PLANT, self.folder / SESSION]
            for path, text in zip(saved, (session.spec, session.dumps()), strict=True):
                write_text(path, text)
            own = self.answer
            if own is not None and own.design is not None and own.check and own.check.proved:
                saved.append(own.design.save(self.folder / "design"))
            else:
                (self.folder / "design" / FILE_NAME).unlink(missing_ok=True)
        except PolefenceError as error:
            self.message.object = paragraph(str(error))
            return
        names = ", ".join(str(path) for path in saved)
        names += "" if len(saved) > 2 else "; no design, for none is proved"
        self.message.object = paragraph(f"saved: {names}")

    def close(self) -> None:
        """End what is under way."""
        self.newest.close()


def _words(own: Answer) -> tuple[str, str]:
    """Return the class of a badge, and what it says."""
    if own.design is None:
        return "undecided", own.reason
    if own.check is None:
        return "working", f"being proved: {own.region}"
    proved = f"proved: all poles in {own.region}"
    if own.design.note:
        proved += f"; {own.design.note}"
    if not implies_stability(own.design.plant, own.region):
        proved += "; note: this region does not imply stability"
    words = {
        "proved": proved,
        "refuted": f"refuted: poles of this law leave {own.region}",
        "undecided": f"undecided: {own.check.reason}",
    }
    return own.check.answer, words[own.check.answer]
