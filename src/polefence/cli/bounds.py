"""Tables and figures of proved bounds, beside sampled values and beside the plant left alone."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from polefence.base.errors import InputError, NotProvedError
from polefence.cli.common import ROUNDING, TOO_LARGE, every_alpha, gain_lines, gains_of
from polefence.design.rows import plant_summary
from polefence.design.signals.bounds import AGREED, Bound, Sampled, sampled
from polefence.design.signals.optimise import Optimised
from polefence.design.signals.search import Retreat
from polefence.plant.outputs import split
from polefence.plant.points import seeded, values_at
from polefence.region.regions import HalfPlane
from polefence.region.text import digits_down, digits_up
from polefence.vehicle.rest import Rest, held_words, rests


@dataclass(frozen=True, eq=False)
class Row:
    """One bound, and what was sampled of it.

    Attributes
    ----------
    bound : Bound
    unit : str
    own : Sampled
        With the law.
    passive : Sampled, optional
        A quarter car's without control, where that is stable in this signal.
    """

    bound: Bound
    unit: str
    own: Sampled
    passive: Sampled | None

    @property
    def label(self) -> str:
        """What is bounded, with its unit."""
        own = self.bound.specification
        text = f"{own.kind} of {own.name}"
        return f"{text} [{self.unit}]" if self.unit else text

    @property
    def minimised(self) -> bool:
        """Whether it has no limit."""
        return self.bound.specification.at_most is None

    @property
    def conservatism(self) -> float | None:
        """What is proved over the worst that was sampled; None where that is zero."""
        return self.bound.level / self.own.worst if self.own.worst > 0 else None


def rows_of(done: Optimised) -> list[Row]:
    """Sample every bound of a law."""
    plant, alpha, found = done.plant, seeded(done.plant), []
    for bound in done.bounds:
        own, passive = bound.specification, None
        if plant.vehicle is not None:
            with suppress(InputError):  # the plant alone is not stable: nothing to compare with
                passive = sampled(plant, None, own, alpha)
        unit = own.unit(plant)
        found.append(Row(bound, unit, sampled(plant, done.law, own, alpha), passive))
    return found


def require_agreement(rows: Sequence[Row]) -> None:
    """Refuse a law that doubles do not run as it was proved.

    Raises
    ------
    NotProvedError
        If a sample passes a bound by more than its own rounding.
    """
    for row in rows:
        if row.own.worst > row.bound.level * (1 + AGREED):
            raise NotProvedError(
                f"{row.bound} is proved of the law as a real matrix, but evaluated in doubles it "
                f"shows {row.own.worst:.6g}: doubles cannot run this law; limit the gain norm, or "
                "ask for a region that bounds the poles, such as a disk"
            )


def lines_of(done: Optimised, rows: Sequence[Row], label: str) -> list[str]:
    """Return what was proved, line by line; bounds rounded up and samples down."""
    count = len(rows[0].own.alpha)
    width = max(len(row.label) for row in rows)
    alone = any(row.passive is not None for row in rows)
    domains = {bound.claim.subject.on for bound in done.bounds}
    heads = ["proved", f"sampled {count}", "ratio", *(["passive"] if alone else [])]
    lines = [
        f"proved: {label} keeps all poles of {done.plant.name!r} in {done.design.region} and, for "
        f"{every_alpha(done.design, *domains)},",
        " ".join([" " * (width + 2), *(f"{head:>13}" for head in heads)]),
    ]
    for row in rows:
        ratio = row.conservatism
        cells = [digits_up(row.bound.level), digits_down(row.own.worst)]
        cells.append("-" if ratio is None else digits_up(ratio, 5))
        if alone:
            cells.append("-" if row.passive is None else digits_down(row.passive.worst))
        note = "minimised" if row.minimised else "limit"
        text = " ".join([f"  {row.label:<{width}}", *(f"{cell:>13}" for cell in cells), f" {note}"])
        lines.append(text)
    lines += _design_lines(done)
    if done.cut:
        lines.append(f"  the search was cut: {done.cut}")
    if done.design.note:
        lines.append(done.design.note)
    elif not _kept(done, rows[0].own.alpha):
        lines.append(TOO_LARGE)
    lines += _rest_lines(done, rows)
    gains = gains_of(done.law, len(done.plant.vertices))
    return lines + gain_lines(gains)


def _design_lines(done: Optimised) -> list[str]:
    """Say how the law came about."""
    lines = []
    if np.isfinite(done.shared) and done.bounds[0].specification.at_most is None:
        shared = digits_up(done.shared)
        lines.append(f"  one Lyapunov matrix for region and signals together proves {shared}")
    if done.designed != done.design.region:
        stable = done.designed in (None, HalfPlane(0))
        designed = "stability" if stable else str(done.designed)
        lines.append(
            f"  designed for {designed}; the whole region was proved of the law afterwards"
        )
    if done.retreat is not None:
        lines.append(f"  {_retreat_line(done.retreat)}")
    return lines


def _retreat_line(retreat: Retreat) -> str:
    """Say how far the law stands from an infimum that none attains."""
    where = "inside the region"
    if np.isfinite(retreat.speed):
        where = f"to poles of at most {digits_up(retreat.speed, 3)} 1/s"
    if not retreat.least > 0:
        return f"stepped back {where}: no faster law was proved"
    return (
        f"stepped back {where}: one Lyapunov matrix for everything then gives "
        f"{digits_up(100 * retreat.share, 3)} % more in floats than for faster poles, whose law "
        "could not be proved or built"
    )


def _rests(done: Optimised, rows: Sequence[Row]) -> tuple[Rest, ...]:
    """Return where constant disturbances leave the signals of the specifications."""
    known = [row.bound.specification for row in rows if row.bound.specification.of_signal]
    asked = {s.name: s.output(done.plant) for s in known}
    if not asked or any(v.E is None for v in done.plant.vertices):
        return ()
    return rests(done.plant, done.law, rows[0].own.alpha, tuple(asked.values()))


def _rest_lines(done: Optimised, rows: Sequence[Row]) -> list[str]:
    """Say where a disturbance that stays leaves the signals, and what is beyond its limit there."""
    lines, beyond = [], dict[str, float]()
    limits = {
        row.bound.specification.name: row.bound.specification.at_most
        for row in rows
        if row.bound.specification.kind == "rms"
    }
    found = _rests(done, rows)
    for source in dict.fromkeys(rest.source.label for rest in found):
        own = [rest for rest in found if rest.source.label == source]
        left = ", ".join(rest.words for rest in own if rest.size) or "0 of all these signals"
        held = held_words(done.plant, own[0].source)
        lines.append(f"  held at {held}, sampled, this leaves {left}")
        for rest in own:
            most = limits.get(rest.signal.name)
            if most is not None and rest.size > most:
                beyond[rest.signal.name] = max(rest.size, beyond.get(rest.signal.name, 0.0))
    if beyond:
        # an integral brings a state back, but what an input must hold it holds
        inputs = {split(name)[0] for name in done.plant.inputs}
        advice = "with a signal's integral among the states nothing of it is left"
        if set(beyond) <= inputs:
            advice = "an input that has to hold the disturbance needs that beside its rms"
        lines.append(
            f"  note: that is more than is allowed of the rms of {' and '.join(beyond)}, which is "
            f"about noise; {advice}"
        )
    return lines


def _kept(done: Optimised, alpha: Any) -> bool:
    region = done.design.region
    distance = region.distance(done.design.poles(alpha[:1000]))
    return bool(np.all(distance < ROUNDING * region.size))


def document_of(done: Optimised, rows: Sequence[Row], label: str) -> dict[str, Any]:
    """Return the summary as plain data."""
    return {
        "plant": plant_summary(done.plant),
        "region": done.design.region.document(),
        "method": label,
        "status": "proved",
        "sampled": len(rows[0].own.alpha),
        "bounds": [
            {
                "kind": row.bound.specification.kind,
                "signal": row.bound.specification.name,
                "unit": row.unit,
                "limit": row.bound.specification.at_most,
                "proved": row.bound.level,
                "degree": row.bound.degree,
                "worst sampled": row.own.worst,
                "conservatism": row.conservatism,
                "passive": None if row.passive is None else row.passive.worst,
            }
            for row in rows
        ],
        "held": [
            {
                "disturbance": rest.source.name,
                "at": 1.0,
                "signal": rest.signal.name,
                "unit": rest.signal.unit,
                "low": rest.low,
                "high": rest.high,
            }
            for rest in _rests(done, rows)
        ],
        "shared": done.shared if np.isfinite(done.shared) else None,
        "designed": None if done.designed is None else str(done.designed),
        "stepped back": None if done.retreat is None else _retreat_document(done.retreat),
        "gains": gains_of(done.law, len(done.plant.vertices)),
    }


def _retreat_document(retreat: Retreat) -> dict[str, Any]:
    speed = retreat.speed if np.isfinite(retreat.speed) else None
    return {"fastest pole allowed": speed, "found": retreat.level, "least found": retreat.least}


def figure_of(done: Optimised, rows: Sequence[Row]) -> Any:
    """Draw bounds and samples over the first parameter, or over the first vertex's weight."""
    from polefence.show.plots.performance import Panel, bounds_figure

    alpha, plant = rows[0].own.alpha, done.plant
    every = max(1, len(alpha) // 2000)
    some = alpha[::every]
    if plant.parameters:
        first = plant.parameters[0]
        x = np.array([(values_at(plant, a) or {first.name: np.nan})[first.name] for a in some])
        label = f"{first.name} [{first.unit}]" if first.unit else first.name
    else:
        x, label = some[:, 0], "weight of the first vertex"
    panels = [
        Panel(
            row.label.replace(" [", "\n["),
            row.bound.level,
            row.own.values[::every],
            None if row.passive is None else row.passive.values[::every],
        )
        for row in rows
    ]
    return bounds_figure(x, label, panels)
