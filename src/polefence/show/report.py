"""One self-contained HTML page about a proved design: its sections of text, tables and figures."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base import VERSION
from polefence.base.errors import InputError, NotProvedError
from polefence.base.explained import explained
from polefence.base.progress import stage
from polefence.base.readable import people, sample_text
from polefence.certify.certificate import Check
from polefence.certify.checks import implies_stability
from polefence.certify.design import Design, check, require_kind
from polefence.export.memory import kept, with_rates
from polefence.law.laws import Law
from polefence.lmi.conditions.methods import METHODS
from polefence.plant.family import UncertainPlant
from polefence.plant.larger import INTEGRAL, own_states
from polefence.plant.outputs import Output, inputs, split, states
from polefence.plant.parameters import Parameter
from polefence.plant.system import Array
from polefence.proof.claims.disk_margin import DiskMargin
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.factor_margin import GainMargin
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.measured import RELATIVE, MeasuredResponse
from polefence.proof.claims.relative_rms import RelativeRms
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.signal import SignalClaim
from polefence.proof.claims.step import StepResponse
from polefence.proof.document import Document
from polefence.proof.ranges import ANY
from polefence.proof.text import rate_text, visible
from polefence.region.text import digits_down, digits_up, short_text
from polefence.response.linear import slowest_seen, step
from polefence.response.loop_margins import LoopMargins, margins
from polefence.response.opened import family_points, opened, places
from polefence.response.stationary import velocity_density
from polefence.search.limits import Limit, limits
from polefence.show.answer import Promise, picture, promise, sentences, shared
from polefence.show.answer import rows as table_rows
from polefence.show.loops import HEAD, loop_figure, margins_row
from polefence.show.plots import (
    address,
    limits_figure,
    poles_figure,
    responses_figure,
    sampled,
    typeset,
)
from polefence.show.sliders import (
    UNITS,
    Grid,
    Panel,
    data_text,
    of_poles,
    of_responses,
    script,
    script_digest,
)
from polefence.vehicle.comfort import comfort_reading
from polefence.vehicle.compare import Comparison, Row, compare, points
from polefence.vehicle.reference_laws import lqr, skyhook
from polefence.vehicle.rest import GRADE, is_grade, rests
from polefence.vehicle.suspensions import is_car

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS = "this design"
MOST_SIGNALS = 24  # of which responses are drawn
MOST_LOOPS, MOST_DRAWN, LOOP_POINTS = 12, 3, 100
SAMPLES = 300  # of the promises at the top
MARK = b'<meta name="generator" content="polefence">'  # in the head of every page


class Report(str):
    """The text of a page, which a notebook shows in a frame of its own."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Show it in a notebook, where its sliders are not: no script in it is run."""
        frame = 'style="width: 100%; height: 40em; border: 1px solid #888" sandbox=""'
        return f'<iframe srcdoc="{html.escape(self)}" title="report" {frame}></iframe>'


@explained
def html_report(
    design: Design,
    road: str = "C",
    speed: float = 20.0,
    bounds: Document | None = None,
    front: tuple[str, bytes] | None = None,
    date: str = "",
) -> Report:
    """Return a report about a design, one HTML page with its figures inside.

    A notebook shows it in a frame.

    The claim is proved afresh. For a quarter car, known by the names of its states, comfort, grip,
    travel and force on a road are set beside those of the passive car, skyhook damping and LQR.

    Parameters
    ----------
    road : str
        Class of ISO 8608, "A" to "H".
    speed : float
        [m/s]
    bounds : Document, optional
        The design's file, every claim of which has been proved: what it claims beside the region.
    front : (kind, bytes), optional
        A figure of a trade-off, "svg" or "png".
    date : str
        Printed at the top.

    Raises
    ------
    NotProvedError
        If the claim is not proved.
    InputError
        If the road or the speed cannot be used, or the design is an observer's.
    """
    require_kind(design.certificate)
    answer = check(design)
    if not answer.proved:
        raise NotProvedError(f"no report: {answer}")
    title = f"{design.plant.name} in {short_text(design.region)}"
    named = _named(design, bounds, (road, speed))
    grid = Grid.of(design.plant)
    parts = [_answer(design, named), *sections(design, answer, road, speed, named, front, grid)]
    return Report(page(title, answer.answer, parts, date, grid))


def page(
    title: str,
    answer: str,
    sections: Sequence[Section],
    date: str = "",
    grid: Grid | None = None,
) -> str:
    """Return one HTML page with its figures inside, which asks nothing of any other address.

    Parameters
    ----------
    grid : Grid, optional
        Of the plants that sliders choose, where sections have panels for them.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined  # deferred: slow to import

    environment = Environment(
        loader=PackageLoader("polefence.show"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_visible,
    )
    environment.filters["picture"] = address
    environment.filters["data"] = data_text
    template = environment.get_template("report.html")
    made = ", ".join(part for part in (f"polefence {VERSION}", date) if part)
    return template.render(
        title=title,
        answer=answer,
        sections=sections,
        made=made,
        grid=grid,
        panels=[panel for section in sections for panel in section.panels],
        script=script() if grid else "",
        digest=script_digest(),
        units=UNITS,
    )


def _visible(value: object) -> object:
    """Return what can be seen of a text; newlines stay, which are spaces but in our own code."""
    if not isinstance(value, str) or hasattr(value, "__html__"):  # our own script and its data
        return value
    return typeset("\n".join(map(visible, value.split("\n"))))


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of cells under their heads."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class Section:
    """A heading with what stands under it, in this order; what is empty is left out.

    ``picture`` is the address of an image that is drawn already; ``panels`` are over the figure.
    """

    title: str
    text: tuple[str, ...] = ()
    table: Table | None = None
    figure: Figure | None = None
    caption: str = ""
    picture: str = ""
    panels: tuple[Panel, ...] = ()
    code: str = ""
    notes: tuple[str, ...] = ()


def sections(
    design: Design,
    answer: Check,
    road: str,
    speed: float,
    bounds: Sequence[Bound] = (),
    front: tuple[str, bytes] | None = None,
    grid: Grid | None = None,
) -> list[Section]:
    """Return all that is to be said about a proved design.

    Parameters
    ----------
    road : str
        Class of ISO 8608, for a quarter car.
    speed : float
        [m/s]
    grid : Grid, optional
        Of the plants that sliders choose.

    Raises
    ------
    InputError
        If the road or the speed cannot be used.
    """
    parts: list[Section | None] = [_claim(design, answer, bounds), _plant(design.plant)]
    parts.append(_poles(design, grid))
    parts += [_limits(design), _bounds(bounds), responses(design, bounds, grid)]
    parts += [*loops(design, bounds)]
    parts += [comfort(design, road, speed), _front(front)]
    return [part for part in parts if part] + [
        _gain(design),
        _how_to_check(design),
    ]


def _claim(design: Design, answer: Check, besides: Sequence[Bound]) -> Section:
    rows = [
        ("plant", design.plant.name),
        ("region", short_text(design.region)),
        ("law", f"{design.law.title}; method {design.method}"),
        (
            "claim",
            "; ".join((*answer.claims, *(bound.what for bound in besides if not bound.level))),
        ),
        ("answer", f"{answer.answer}: {answer.reason}"),
    ]
    stable = implies_stability(design.plant, design.region)
    note = "" if stable else " The region does not imply stability."
    return Section(
        "What is claimed, and proved",
        (
            "For every value of the parameters below, each taken as constant, all closed-loop "
            "poles lie in the region. The proof was done afresh for this report, in integers."
            f"{note}",
            _left_out(design.plant, any(bound.kind == Estimate.kind for bound in besides)),
            *([] if design.plant.data is None else [design.plant.data.note]),
        ),
        Table(("", ""), tuple(rows)),
    )


def _left_out(plant: UncertainPlant, estimated: bool) -> str:
    """Say what the claims leave out, and where more is said of it.

    ``estimated`` is whether one is about errors of estimates.
    """
    sampled = plant.sample_time is not None
    between = "the time between samples but for each rms that is said to hold at all times"
    if plant.sampling is None:
        between = "the time between samples"
    if estimated:
        rest = between if sampled else "sampling"
        return f"Not in the claims: actuator limits, {rest}, and changes of the parameters."
    if sampled:
        return (
            f"Not in the claim: actuator limits, {between}, changes of the parameters and errors "
            "of their estimates; polefence service proves how large the errors may be."
        )
    if plant.moving and plant.dead_time is None:
        return (
            "Not in the claim about poles: actuator limits, sampling, and errors of estimates of "
            "the parameters; polefence service proves how large the errors may be. What holds "
            "while parameters move the claims say."
        )
    return (
        "Not in the claim: actuator limits, sampling, and changes and errors of the parameters; "
        "polefence service proves how large the last two may be."
    )


def _plant(plant: UncertainPlant) -> Section:
    labelled = any(p.label for p in plant.parameters)
    rows = [
        (
            p.name,
            *([p.label] if labelled else []),
            f"{digits_up(p.low)} to {digits_down(p.high)}",
            p.unit,
            p.through,
            *([_rate(p)] if plant.moving else []),
        )
        for p in plant.parameters
    ]
    text = [f"{plant.size_text}."]
    own = own_states(plant)
    for what, names in (("States", plant.states), ("Inputs", plant.inputs)):
        text += [f"{what}: {', '.join(names[: len(names) - own])}."] if names else []
    text += [f"States of the law itself: {', '.join(plant.states[-own:])}."] if own else []
    if not rows:
        text.append("The family is the convex hull of its vertices.")
        return Section("The plant", tuple(text))
    head = ("parameter", *([""] if labelled else []), "range", "unit", "enters as")
    head = (*head, *(["moves"] if plant.moving else []))
    return Section("The plant", tuple(text), Table(head, tuple(rows)))


def _rate(parameter: Parameter) -> str:
    if parameter.dead_time is not None:
        return "stands for a dead time"
    if parameter.rate is None:
        return "not"
    if parameter.rate == ANY:
        return "at any rate"
    low, high = parameter.rate
    return f"by {digits_up(low)} to {digits_down(high)} {rate_text(parameter.unit)}"


@stage("poles")
def _poles(design: Design, grid: Grid | None = None) -> Section:
    cloud, corners = sampled(design)
    margin = -float(design.region.distance(cloud).max())
    unit = " 1/s" if design.plant.sample_time is None else ""
    figure = poles_figure(
        {design.plant.name: (cloud, corners)},
        design.region,
        discrete=design.plant.sample_time is not None,
    )
    return Section(
        "Closed-loop poles",
        (
            f"At {len(cloud)} points of the family; the pole nearest to the boundary is "
            f"{margin:.3g}{unit} inside.",
        ),
        figure=figure,
        panels=of_poles(grid, design, figure.axes),
        caption="The region is white, its outside shaded. The sample is for the eye; the guarantee "
        "is the proof.",
    )


@stage("other disks")
def _limits(design: Design) -> Section | None:
    region, plant = design.region, design.plant
    if region.circle is None or plant.sample_time is not None:
        return None
    centre, radius = region.circle
    centres = (centre * np.geomspace(0.25, 2.5, 13)).tolist()
    rows = limits(plant, centres, METHODS, bounds=False)
    shown = [row.as_row() for row in rows if row.radius is not None and row.radius < -row.centre]
    here = 100 * (1 - radius / -centre)
    radii = limits(plant, centre, METHODS)
    figure = limits_figure({plant.name: shown}) if shown else None
    if figure is not None:
        ax = figure.axes[0]
        ax.plot(-centre, here, "o", mfc="white", mec="black", ms=7, zorder=4)
        ax.annotate(OURS, (-centre, here), (8, -4), textcoords="offset points", fontsize=9)
    return Section(
        "How far the methods go",
        ("The smallest disk about this centre that each method proves [1/s]:",),
        Table(("method", "radius, proved", "lower bound, proved"), tuple(map(_limit, radii))),
        figure,
        "The larger d/sigma, the smaller the disk, over the distance of its centre; every point "
        "proved.",
    )


def _limit(row: Limit) -> tuple[str, str, str]:
    radius = "-" if row.radius is None else digits_up(row.radius)
    return row.method, radius, "-" if row.lower is None else digits_down(row.lower)


@dataclass(frozen=True, eq=False)
class Bound:
    """A claim beside the region, as a reader wants it, and as the proof says it."""

    what: str
    level: str
    under: str
    statement: str
    kind: str = ""
    margin: tuple[str, float, float] | None = None  # of one loop: where, its skew, how much
    promise: Promise | None = None
    edges: tuple[str, Array] | None = None  # of a step response: the signal, see `responses_figure`


def _named(design: Design, document: Document | None, road: tuple[str, float]) -> tuple[Bound, ...]:
    """Return what a file claims beside the region, with the units of the plant's signals.

    Raises
    ------
    InputError
        If the road or the speed cannot be used.
    """
    density = velocity_density(*road)
    if document is None:
        return ()
    bounds, alpha = list[Bound](), family_points(design.plant, SAMPLES)
    for claim in document.claims[1:]:
        said, what, level, under = claim.said(document.plant), "", "", ""
        own = None
        if isinstance(claim, SignalClaim) and claim.kind != "decay":  # which is no upper bound
            what, most = claim.named(document.plant), claim.worst_text
            level = f"{most} {_unit(design.plant, claim)}".strip()
            under = claim.under
            if (
                isinstance(claim, Rms)
                and is_car(design.plant)
                and np.isclose(float(2 * claim.intensity), density, rtol=1e-9)
            ):
                under = f" on a road of class {road[0]} at {road[1]:g} m/s"
            own = promise(design, claim, (what, _unit(design.plant, claim), under.strip()), alpha)
            under = own.under
        elif isinstance(claim, GainMargin):
            what, level = claim.named(document.plant), claim.worst_text
            own = Promise(what, "", level)
        words = (what or said, level, under.strip(), said if what else "", claim.kind)
        bounds.append(Bound(*words, _margin(design, claim), own, _edges(claim)))
    return tuple(bounds)


def _edges(claim: Any) -> tuple[str, Array] | None:
    """Return between what a signal is proved to stay after a unit step of the first disturbance."""
    if not isinstance(claim, StepResponse) or list(claim.acting) != [0]:
        return None
    if claim.scales and claim.scales[0] != 1:
        return None
    if claim.envelope is not None:
        points = claim.envelope.stretched(claim.level).points
        return claim.outputs[0].name, np.array([[float(x) for x in row] for row in points])
    level = float(claim.level)
    edges = np.array([[0.0, -level, level]])
    return (claim.outputs[0].name, edges) if claim.measure == "peak" else None


def _margin(design: Design, claim: Any) -> tuple[str, float, float] | None:
    """Return where a proved disk margin of one loop is, its skew, and how much it is.

    None where the claim opens another loop than `polefence.response.opened`: in discrete time it
    lets the law read its own demands as they arrive, and a PID's integral is a signal of its own.
    """
    if not isinstance(claim, DiskMargin) or claim.filters or claim.loops.count > 1:
        return None  # behind a filter it is no disk of the loop itself
    pid = any(signal.name.startswith(INTEGRAL) for signal in design.law.measured)
    if design.plant.sample_time is not None or (pid and claim.loops.measured):
        return None
    known = inputs(design.plant) if claim.loops.inputs else design.law.measured
    (k,) = (*claim.loops.inputs, *claim.loops.measured)
    return known[k].name, float(claim.loops.skew), float(1 / claim.level)


def _unit(plant: UncertainPlant, claim: SignalClaim) -> str:
    """Return the unit of a bound; none where the entries of a vector have others."""
    if isinstance(claim, MeasuredResponse) and claim.measure in (*RELATIVE, "settling", "envelope"):
        return "s" if claim.measure in ("settling", "rise") else ""
    known = {signal.name: signal.unit for signal in plant.signals}
    units = {_short(known.get(output.name, output.unit)) for output in claim.outputs}
    if len(units) > 1 or isinstance(claim, RelativeRms):
        return ""
    (unit,) = units
    if isinstance(claim, Gain):
        per = {_short(split(disturbance)[1]) for disturbance in plant.disturbances}
        return f"{unit} per {per.pop()}" if unit and len(per) == 1 and all(per) else ""
    return unit


def _short(unit: str) -> str:
    """Return a unit that is no sentence: the file's text may be a stranger's."""
    return unit if len(unit) <= 12 else ""


def _bounds(bounds: Sequence[Bound]) -> Section | None:
    rows = [(bound.what, bound.level, bound.under) for bound in bounds if bound.level]
    if not rows:
        return None
    exact = tuple(bound.statement for bound in bounds if bound.statement)
    return Section(
        "Bounds on signals, proved",
        ("For the same values of the parameters, in the same arithmetic:",),
        Table(("", "", ""), tuple(rows)),
        notes=("As the proof has them, signals written out:", *exact) if exact else (),
    )


def _answer(design: Design, bounds: Sequence[Bound]) -> Section:
    """Return what stands first, without a heading."""
    promises = [bound.promise for bound in bounds if bound.promise is not None]
    head, *rows = table_rows(promises)
    motion = shared(promises)
    return Section(
        "",
        (*sentences(design, promises), *([f"All promises {motion}:"] if motion else [])),
        Table(head, tuple(rows)) if promises else None,
        picture(promises),
        "Grey: the worst of the same samples without control.",
    )


def _front(front: tuple[str, bytes] | None) -> Section | None:
    if front is None:
        return None
    kind, data = front
    mime = {"svg": "image/svg+xml", "png": "image/png"}[kind]
    address = f"data:{mime};base64,{base64.b64encode(data).decode()}"
    return Section("What it costs", picture=address, caption="A trade-off, from its own figure.")


def _gain(design: Design) -> Section:
    names = design.plant.states or tuple(f"x{i + 1}" for i in range(design.plant.shape[0]))
    if design.law.formula:
        return _terms(design, design.law, names)
    corners, fixed = np.eye(len(design.plant.vertices)), design.law.fixed
    gains = design.law.gain(corners)[: 1 if fixed else None]
    heads = [""] if fixed else [f"vertex {j + 1}" for j in range(len(gains))]
    rows = tuple(
        (f"{head} {_input(design, i)}".strip(), *(f"{k:.6g}" for k in row))
        for head, K in zip(heads, gains, strict=True)
        for i, row in enumerate(K)
    )
    text: Sequence[str] = ("Six digits; use the numbers of the file.",)
    if not fixed:
        degree = f"of degree {design.law.degree} in the weights alpha of the vertices"
        text = (*text, f"Between the vertices K(alpha) = Z(alpha) W(alpha)^-1, W and Z {degree}.")
    return Section("The gain", tuple(text), Table(("u = K x", *names), rows))


def _terms(design: Design, law: Law, states: Sequence[str]) -> Section:
    names = tuple(signal.label for signal in law.measured) or states
    rows = tuple(
        (f"{name} {_input(design, i)}".strip(), *(f"{k:.6g}" for k in row))
        for name, K in law.named_gains().items()
        for i, row in enumerate(K)
    )
    letter = "y" if law.measured else "x"
    text = ("Six digits; use the numbers of the file.", f"{law.formula}.", *law.definitions)
    return Section("The gain", text, Table((f"u = K {letter}", *names), rows))


def _input(design: Design, number: int) -> str:
    names = design.plant.inputs
    return names[number] if names else f"u{number + 1}" if design.plant.shape[1] > 1 else ""


def _how_to_check(design: Design) -> Section:
    # states that code keeps are stepped from sample to sample
    tick = " --sample-time 0.001" if kept(with_rates(design)) else ""
    return Section(
        "Check it, use it",
        (
            "The file design.json holds the plant (SHA-256 of its vertices "
            f"{design.plant.digest}), the region, the law and everything that the proof rests on. "
            "The first line below proves it; so does the second, with nothing installed but Python "
            "and the checker alone, which `polefence check --standalone polefence-check.pyz` "
            "writes. The third writes the law as C for a microprocessor and "
            "proves that its rounding leaves the poles in the region.",
        ),
        code="polefence check design.json --spec SPEC\n"
        "python -S polefence-check.pyz design.json\n"
        f"polefence export design.json --float 32{tick} -o CODE\n"
        "python -c \"import polefence; print(polefence.Design.load('design.json').law)\"",
    )


@stage("responses")
def responses(design: Design, bounds: Sequence[Bound] = (), grid: Grid | None = None) -> Section:
    """Return step responses, with the bounds on them that are proved."""
    plant = design.plant
    signals, count, fewer = _shown(plant), sum(map(len, _signals(plant))), ""
    if count > MOST_SIGNALS:
        fewer = f" Of {count} signals these are the first {MOST_SIGNALS}, outputs before others."
    source = None if all(v.E is not None for v in plant.vertices) else inputs(plant)[0].name
    alpha = points(plant)
    try:
        drawn = _drawn(design, alpha, signals, source)
        response = step(plant, design, alpha, signals, source, *drawn)
    except InputError as error:
        return Section("Responses", (f"None are drawn: {error}.",))
    name = (plant.disturbances or ("the disturbance",))[0] if source is None else source
    shares = (0.05, 0.02)
    heads = tuple(f"within {100 * share:g} % [s]" for share in shares)
    times = [response.settling(share).max(axis=0) for share in shares]
    left = _left(design, alpha, signals) if source is None else {}
    size = "" if source is not None else _size(plant)
    edges = {bound.edges[0]: bound.edges[1] for bound in bounds if bound.edges}
    figure = responses_figure({plant.name: response}, edges=edges)
    panels: tuple[Panel, ...] = ()
    if grid is not None:
        chosen = step(plant, design, grid.alpha, signals, source, *drawn)
        panels = of_responses(chosen, figure.axes)
    peaks = np.abs(response.peaks()[0]).max(axis=0)
    rows = tuple(
        (
            signal.label,
            sample_text(peak),
            left.get(signal.name, "-"),
            *(_seconds(t[i]) for t in times),
        )
        for i, (signal, peak) in enumerate(zip(response.signals, peaks, strict=True))
    )
    return Section(
        "Responses",
        (
            f"To a unit step of {name}{size}, over {len(alpha)} points of the family: the largest "
            "peak, what is left while the step stays, and the longest time until a signal is near "
            f"that for good (near zero: within that share of its peak).{fewer}",
        ),
        Table(("signal", "largest peak", "left", *heads), rows),
        figure,
        panels=panels,
    )


def _signals(plant: UncertainPlant) -> tuple[list[Output], ...]:
    """Return states, inputs and outputs but for a law's own states and their rates."""
    n, m = (size - own_states(plant) for size in plant.shape)
    return list(states(plant)[:n]), list(inputs(plant)[:m]), list(plant.every_output)


def _shown(plant: UncertainPlant) -> list[Output]:
    """Return the signals whose responses are drawn: of many outputs and inputs first."""
    plain, demands, outputs = _signals(plant)
    if len(plain) + len(demands) + len(outputs) <= MOST_SIGNALS:
        return [*plain, *demands, *outputs]
    return [*outputs, *demands, *plain][:MOST_SIGNALS]


def _left(design: Design, alpha: Any, signals: Sequence[Output]) -> dict[str, str]:
    """Return what a unit of the first disturbance leaves of each signal, by name."""
    left = rests(design.plant, design, alpha, signals)
    return {rest.signal.name: rest.span for rest in left if rest.source == left[0].source}


def _size(plant: UncertainPlant) -> str:
    """Say what a unit of a car's road velocity is."""
    return f" ({GRADE})" if is_grade(plant) else ""


def _drawn(
    design: Design, alpha: Any, signals: Sequence[Output], source: str | None
) -> tuple[float, float | None]:
    """Return how long a step response is worth drawing, and the time between samples [s].

    Ten of the slowest time constants that are seen in it, in 1,000 samples at most: a figure has
    fewer points, and a settling time of three of them is told to 0.3 %.
    """
    plant = design.plant
    slowest = slowest_seen(plant, design, alpha, signals, source)
    T = float(plant.sample_time or 0)
    duration = 10 / slowest if slowest > 0 else 10 / design.region.size * (T or 1.0)
    if T:
        return duration, T * max(1, math.ceil(duration / T / 1000))
    fastest = float(np.abs(design.poles(alpha)).max())
    return duration, max(0.1 / fastest, duration / 1000)


def _seconds(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


@stage("loops")
def loops(design: Design, bounds: Sequence[Bound] = ()) -> list[Section]:
    """Return the margins of the loop, opened at each place in turn, and what it looks like there.

    Drawn are the loops at the inputs, and of the others the one with the least disk margin. Of a
    loop with a margin that is proved the disk is that, with its skew.
    """
    plant, known = design.plant, places(design.plant, design)
    some = known[:MOST_LOOPS]
    alpha = family_points(plant, LOOP_POINTS)
    proved = {bound.margin[0]: bound.margin[1:] for bound in bounds if bound.margin}
    loops = [opened(plant, design, place.name, alpha) for place in some]
    every = [margins(loop, proved.get(loop.place.name, (0.0,))[0]) for loop in loops]
    fewer = f" Of {len(known)} loops these are the first {MOST_LOOPS}." * (len(some) < len(known))
    inside = [found for found in every if found.opened.place.kind != "input"]
    drawn = [found for found in every if found.opened.place.kind == "input"][:MOST_DRAWN]
    if inside and len(drawn) < MOST_DRAWN:
        drawn.append(min(inside, key=lambda found: found.least[-1].value))
    table = Section(
        "Loops",
        (
            "The loop is opened at one place, between the law and an input or between a sensor "
            "and the law, all others closed: by which factors its gain may be multiplied there, "
            "and how much its phase may turn or it may be late besides, before it is unstable. A "
            "disk margin is of gain and phase at once.",
            f"The least over {len(alpha)} points of the family, sampled and not proved.{fewer}",
        ),
        Table(HEAD, tuple(margins_row(one, *proved.get(_name(one), ())[1:]) for one in every)),
    )
    return [table] + [
        Section(
            f"The loop at {found.opened.place.name}",
            figure=loop_figure(found, *proved.get(_name(found), ())[1:]),
            caption="Nyquist, Bode and Nichols plots of what goes once round the loop, of negative "
            "feedback, for positive frequencies. A curve through the cross is one on the verge of "
            "instability; through the shaded disk, one of a smaller disk margin.",
        )
        for found in drawn
    ]


def _name(found: LoopMargins) -> str:
    return found.opened.place.name


@stage("comfort")
def comfort(design: Design, road: str, speed: float) -> Section | None:
    """Return the ride of a car beside other laws; None for any other plant."""
    plant, title = design.plant, "Comfort, grip and force on a road"
    if not is_car(plant) or any(v.E is None for v in plant.vertices):
        return None
    laws = {"passive": None, "skyhook": skyhook(plant), "LQR": lqr(plant), OURS: design}
    compared = compare(plant, laws, road, speed)
    if OURS in compared.left_out:
        return Section(title, (f"Nothing can be said of this design: {compared.left_out[OURS]}.",))
    ours = compared.row(OURS)
    reading = " to ".join(comfort_reading(ours.worst))
    rms, beside = f"{ours.worst:.3g} m/s2 in the worst case", "Weighted"
    if "passive" in compared.laws:
        passive = compared.row("passive")
        beside = f"The ride is {_beside(ours, passive)}: weighted"
        rms = f"{ours.worst:.3g} m/s2 against {passive.worst:.3g} m/s2 in the worst case"
    return Section(
        title,
        (
            f"Stationary ride on a class {compared.road} road of ISO 8608 at {speed:g} m/s"
            f"{compared.when}, worst case and best over {len(compared.alpha)} points of the "
            f"family. {beside} by ISO 2631-1, {rms}, which people in public transport call "
            f"{reading}.",
            "Pole location is no specification of comfort: a small disk far from the imaginary "
            "axis asks for speed.",
        ),
        _comfort_table(compared),
    )


def _beside(ours: Row, passive: Row) -> str:
    """Say how a law rides beside none."""
    if ours.best > passive.worst:
        return "rougher than without control for every car of the family"
    if ours.worst > passive.worst:
        return "rougher than without control in the worst case"
    return "smoother than without control in the worst case"


def _comfort_table(compared: Comparison) -> Table:
    names = list(dict.fromkeys((row.quantity, row.unit) for row in compared.rows))
    rows = []
    for quantity, unit in names:
        own = [compared.row(law, quantity) for law in compared.laws]
        read, times = people(max(row.worst for row in own), unit)
        ends = ([sample_text(x, times, 3) for x in (row.best, row.worst)] for row in own)
        rows.append((f"{quantity} [{read}]", *(" to ".join(dict.fromkeys(e)) for e in ends)))
    return Table(("best to worst", *compared.laws), tuple(rows))
