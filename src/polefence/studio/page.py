"""The page of a session: poles, what is asked, what is answered, and what to take away."""

from __future__ import annotations

import html
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import panel as pn

from polefence.base.errors import PolefenceError
from polefence.base.files import write_text
from polefence.design.design import Design
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.points import values_at, values_text
from polefence.proof.text import visible
from polefence.region.regions import Region
from polefence.region.text import parse_region
from polefence.studio.answers import Answer, Newest
from polefence.studio.car import Car
from polefence.studio.palette import DARK, LIGHT
from polefence.studio.poles import Poles
from polefence.studio.rides import ROADS, rides
from polefence.studio.state import PLANT, SESSION, History, Session

WIDE = {"sizing_mode": "stretch_width"}
LARGE, SMALL = {"flex": "3 1 520px"}, {"flex": "2 1 340px"}
STYLE = """
.badge { font-weight: 600; padding: 4px 10px; border-radius: 4px; border: 2px solid; }
.proved { border-color: #2b5c8a; }
.proved::before { content: "\\2713  "; }
.refuted { border-color: #d95f02; border-style: double; }
.refuted::before { content: "\\2717  "; }
.undecided, .working { border-color: #888888; border-style: dashed; }
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
        self.newest = Newest(self.plant, self._tell)
        palette = DARK if dark else LIGHT
        self.poles = Poles(self.plant, session.state, self._dragged, palette)
        self.car = Car(self.plant, palette) if rides(self.plant) else None
        self._before: Region | None = None
        self._quiet, self._number = False, 0
        self._widgets()
        if document is None:
            self._ask()
        else:  # what changes before the browser listens is lost
            pn.state.onload(self._ask)

    def _widgets(self) -> None:
        state = self.history.now
        self.region = pn.widgets.TextInput(name="Region", value=str(state.region), **WIDE)
        self.region.param.watch(self._typed, "value")
        self.method = pn.widgets.Select(
            name="Method", options=list(METHODS), value=state.method, **WIDE
        )
        self.method.param.watch(self._chosen, "value")
        self.sliders = []
        values = dict(state.values)
        for p in self.plant.parameters:
            unit = f" [{p.unit}]" if p.unit else ""
            low, high = float(p.low), float(p.high)
            own = pn.widgets.FloatSlider(
                name=visible(f"{p.name}{unit}"),
                start=low,
                end=high,
                step=(high - low) / 100,
                value=values[p.name],
                **WIDE,
            )
            own.param.watch(lambda event, name=p.name: self._slid(name, event.new), "value")
            self.sliders.append(own)
        self.road = pn.widgets.Select(name="Road", options=list(ROADS), value=state.road, **WIDE)
        self.speed = pn.widgets.FloatSlider(
            name="Speed [m/s]", start=5.0, end=40.0, step=1.0, value=state.speed, **WIDE
        )
        self.road.param.watch(lambda event: self._driven(road=event.new), "value")
        self.speed.param.watch(lambda event: self._driven(speed=event.new), "value")
        self.ride = pn.pane.HTML("", stylesheets=[STYLE])
        self.badge = pn.pane.HTML("", stylesheets=[STYLE])
        self.message = pn.pane.HTML("", stylesheets=[STYLE])
        self.take = pn.pane.HTML("", stylesheets=[STYLE])
        self.back, self.forward, self.fit, self.save = (
            pn.widgets.Button(name=name) for name in ("Undo", "Redo", "Fit view", "Save")
        )
        self.find = pn.widgets.Button(name="Show the car that fails", visible=False)
        self.back.on_click(lambda _: self._go(self.history.back()))
        self.forward.on_click(lambda _: self._go(self.history.forward()))
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
        return pn.FlexBox(*shown, **WIDE)

    def _tell(self, own: Answer) -> None:
        """Have an answer shown in the page's own thread."""
        if self._document is None:
            self._answered(own)
        else:
            self._document.add_next_tick_callback(partial(self._answered, own))

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
        if (now.region, now.method) != (before.region, before.method):
            self._ask()
        elif now != before:
            self._ride()

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
                    f"<p>{who}: {own.comfort:.3g} m/s², {_safe(own.words)}</p>" for who, own in both
                )
        except PolefenceError as error:
            self.ride.object = f"<p>{_safe(str(error))}</p>"

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
        commands = [now.command(self.name), now.python(self.name)]
        if self.car is not None:
            commands.insert(1, now.drive(self.name))
        self.take.object = "".join(f"<pre>{_safe(text)}</pre>" for text in commands)

    def _ask(self) -> None:
        now = self.history.now
        self._number = self.newest.ask(now.region, now.method)

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
            self.message.object = f"<p>{_safe(str(error))}</p>"
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
        if own.number != self._number:
            return
        self.answer = own
        with self._together():
            if own.design is not None and own.check is None:
                self.poles.show(own.design, own.region)
            word, text = _words(own)
            self.badge.object = f'<div role="status" class="badge {word}">{_safe(text)}</div>'
            if own.check is not None:
                self._ride()
            self.find.visible = own.check is not None and own.check.alpha is not None

    def _find(self) -> None:
        """Look at the car whose poles leave the region."""
        alpha = (
            None if self.answer is None or self.answer.check is None else self.answer.check.alpha
        )
        values = None if alpha is None else values_at(self.plant, alpha)
        if values is None:
            self.message.object = f"<p>{_safe(str(alpha))}</p>"
            return
        state = self.history.now
        for name, value in values.items():
            state = state.at(name, value)
        self.message.object = (
            f"<p>leaves the region at {_safe(values_text(self.plant, values))}</p>"
        )
        self._go(replace(self.history, now=state))

    def _save(self) -> None:
        """Write the session, and the design where it is proved, into the session's folder."""
        try:
            session = replace(self.session, state=self.history.now)
            saved = [self.folder / PLANT, self.folder / SESSION]
            for path, text in zip(saved, (session.spec, session.dumps()), strict=True):
                write_text(path, text)
            design = None if self.answer is None else self.answer.design
            if isinstance(design, Design) and design.proved:
                saved.append(design.save(self.folder / "design"))
        except PolefenceError as error:
            self.message.object = f"<p>{_safe(str(error))}</p>"
            return
        names = ", ".join(str(path) for path in saved)
        self.message.object = f"<p>saved: {_safe(names)}</p>"

    def close(self) -> None:
        """End what is under way."""
        self.newest.close()


def _words(own: Answer) -> tuple[str, str]:
    """Return the class of a badge, and what it says."""
    if own.design is None:
        return "undecided", own.reason
    if own.check is None:
        return "working", f"found, being proved: {own.region}"
    words = {
        "proved": f"proved: all poles in {own.region}",
        "refuted": f"refuted: poles leave {own.region}",
        "undecided": f"undecided: {own.check.reason}",
    }
    return own.check.answer, words[own.check.answer]


def _safe(text: str) -> str:
    """Return text to be put into a page: names are no markup, and have no control characters."""
    return "\n".join(html.escape(visible(line)) for line in text.split("\n"))
