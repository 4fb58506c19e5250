"""The trade-off: the least proved bound over limits on another signal, with a dot to drag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from shlex import quote
from typing import Any

from bokeh.events import Pan, PanStart, Tap
from bokeh.models import ColumnDataSource, CustomJS

from polefence.base.errors import NotProvedError
from polefence.certify.bounds import best_bound
from polefence.requirements.specification import Specification
from polefence.search.rows import Row
from polefence.search.tradeoff import TUNED, label_of, tradeoff
from polefence.studio.palette import Palette, coloured, small_figure
from polefence.studio.question import Found, Question, imported, made
from polefence.studio.subject import Subject
from polefence.studio.templates import template
from polefence.studio.words import plain

COUNT = 8  # limits that are tried


class Front:
    """The pane.

    Parameters
    ----------
    subject : Subject
        With something to be minimised.
    palette : Palette
    choose : callable
        Called with the limit whose law is chosen.
    """

    def __init__(
        self, subject: Subject, palette: Palette, choose: Callable[[float], object]
    ) -> None:
        self.subject, self._palette, self._choose = subject, palette, choose
        self.rows: tuple[Row, ...] = ()
        self.swept = self.over("")  # what their limits are on
        self.points = ColumnDataSource({"x": [], "y": []})
        self.failed = ColumnDataSource({"x": [], "y": []})
        self.dot = ColumnDataSource({"x": [], "y": []})
        self.picked = ColumnDataSource({"number": []})
        self.figure = self._figure()

    def _figure(self) -> Any:
        plot = small_figure("front", height=260)
        colour = self._palette
        plot.line("x", "y", source=self.points, color=colour.cars, line_width=1.5)
        plot.scatter("x", "y", source=self.points, color=colour.cars, size=7)
        marks = {"source": self.failed, "color": colour.looked, "size": 9}
        plot.scatter("x", "y", marker="x", **marks)
        style = {"fill_color": colour.looked, "line_color": colour.ink, "size": 15}
        plot.scatter("x", "y", source=self.dot, **style)
        plot.title.text_color, plot.title.text_font_size = colour.ink, "12px"
        plot.title.text_font_style = "normal"
        coloured(plot, colour)
        args = {"points": self.points, "dot": self.dot, "picked": self.picked, "plot": plot}
        picks = CustomJS(args=args, code=template("picking.js"))
        for event in (Tap, PanStart, Pan):
            plot.js_on_event(event, picks)
        self.picked.on_change("data", self._picked)
        return plot

    @property
    def count(self) -> int:
        """How many limits are tried."""
        return COUNT

    def _picked(self, _: str, __: Any, new: dict[str, Any]) -> None:
        proved = self._proved()
        if len(new["number"]) and 0 <= (which := int(new["number"][0])) < len(proved):
            self._choose(proved[which]["law_of"])

    def _proved(self) -> list[Row]:
        return [row for row in self.rows if row["answer"] == "proved"]

    def over(self, title: str) -> Specification:
        """Return what is limited, of a title; the first where there is none of it."""
        bare = [replace(limit, at_most=None) for limit in self.subject.overs]
        return next((limit for limit in bare if limit.title == title), bare[0])

    @property
    def limits(self) -> list[float]:
        """Limits whose law is of no other row."""
        return [row["value"] for row in self._proved() if row["law_of"] == row["value"]]

    def show(
        self, rows: Sequence[Row], question: Question, over: Specification | None = None
    ) -> None:
        """Show rows, and which of them a question asks for."""
        self.swept = self.swept if over is None else over
        self.rows = tuple(sorted(rows, key=lambda row: float(row["value"])))
        proved = self._proved()
        x, y = [row["value"] for row in proved], [row["proved"] for row in proved]
        self.points.data = {"x": x, "y": y}
        none = [row["value"] for row in self.rows if row["answer"] != "proved"]
        self.failed.data = {"x": none, "y": [min(y, default=0.0)] * len(none)}
        self.look(question)

    def look(self, question: Question) -> None:
        """Put the dot on what a question asks for, and name the axes."""
        plant, wanted = self.subject.plant, self.subject.wanted
        asked = question.ride and question.over == self.swept.title
        chosen = [row for row in self._proved() if asked and row["value"] == question.limit]
        self.dot.data = {
            key: [row[k] for row in chosen] for key, k in (("x", "value"), ("y", "proved"))
        }
        if wanted is not None:
            over, least = (label_of(plant, asked_for) for asked_for in (self.swept, wanted.least))
            self.figure.xaxis.axis_label = plain(f"limit on {over}")
            self.figure.title.text = plain(f"proved: least {least}") if self.rows else ""

    def rows_of(
        self,
        question: Question,
        over: Specification,
        show: Callable[[Sequence[Row]], object],
        know: Callable[[Question, Found], object],
    ) -> None:
        """Work rows out, and show them as they come.

        Parameters
        ----------
        know : callable
            Told the law of each row.

        Raises
        ------
        PolefenceError
            If there is no law without a limit on what is swept.
        """
        subject, rows = self.subject, list[Row]()
        if subject.wanted is None:
            return
        asked = replace(question.basis, over=over.title)

        def finished(row: Row) -> None:
            rows.append(row)
            show(rows)

        front = tradeoff(
            subject.plant,
            subject.wanted.least,
            over,
            self._limits(asked, over),
            asked.others(subject.wanted),
            asked.region,
            structure=asked.structure(subject),
            on_row=finished,
        )
        for row in front.rows:
            if row["answer"] == "proved" and row["law_of"] == row["value"]:
                law = front.design(row["value"], TUNED), front.file(row["value"], TUNED)
                kept = ((subject.wanted.least, row["proved"]), *_bounds(subject, over, row))
                texts = tuple(limit.bound_text(level) for limit, level in kept)
                know(replace(asked, limit=row["value"]), Found(*law, texts))
        show(front.rows)

    def _limits(self, asked: Question, over: Specification) -> list[float]:
        """Return limits up to what the law has that is free in this."""
        design = asked.search(self.subject).design
        bound = best_bound(design.plant, design.law, over)
        if bound is None or not bound.level > 0:
            raise NotProvedError(f"nothing is proved of {over.title} without a limit on it")
        shares = ((k + 1) / COUNT for k in range(COUNT))
        return list(dict.fromkeys(float(f"{bound.level * s:.3g}") for s in shares))

    def command(self, question: Question) -> str:
        """Return the command line that works the rows out."""
        subject = self.subject
        words = (
            "" if subject.wanted is None else "".join(f" {quote(w)}" for w in subject.wanted.words)
        )
        values = "".join(f" --value {row['value']!r}" for row in self.rows)
        over = quote(self.swept.title)
        options = question.basis.options(subject)
        return f"polefence tradeoff {quote(subject.name)} --over {over}{values} {options}{words}"

    def python(self, question: Question) -> str:
        """Return the Python that does."""
        wanted = self.subject.wanted
        if wanted is None:
            return ""
        over = self.swept
        asked = replace(question, ride=True, over=over.title, limit=None, given="")
        limits = ", ".join(map(made, asked.others(wanted)))
        structure = asked.structure(self.subject)
        lines = [
            "import polefence as pf",
            "",
            f"plant = pf.load({self.subject.name!r})",
            f"least, over = {made(wanted.least)}, {made(over)}",
            f"region = pf.parse_region({str(question.region)!r})",
            f"values = {[row['value'] for row in self.rows]}",
            f"structure = {'None' if structure is None else made(structure)}",
            f"front = pf.tradeoff(plant, least, over, values, [{limits}], region, "
            "structure=structure)",
        ]
        return imported(lines)


def _bounds(
    subject: Subject, over: Specification, row: Row
) -> Iterator[tuple[Specification, float]]:
    """Yield what else is proved of a row's law."""
    limits: Iterable[Specification] = () if subject.wanted is None else subject.wanted.limits
    known = {limit.title: limit for limit in (*limits, over)}
    for bound in row["bounds"]:
        if bound["specification"] in known:
            yield known[bound["specification"]], bound["proved"]
