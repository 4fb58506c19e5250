"""Figures 3 to 10 and the report of the paper's reproduction, from its results as plain data."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polefence.base.files import write_bytes, write_text
from polefence.design.design import Design
from polefence.examples import family
from polefence.region.text import digits_down, digits_up
from polefence.response.bands import MOTION, RIDE
from polefence.show.paper import ride
from polefence.show.paper.study import DISK, FAMILIES, cloud, nominal_poles
from polefence.show.paper.tables import gain_cells, number, table
from polefence.show.plots.plots import FORMATS, limits_figure, poles_figure, render
from polefence.show.plots.response import bands_figure, frequency_figure, responses_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A disk deep in the right half-plane is no design: keep figure 4's scale for those that are.
FLOOR = -60.0
# Figures 7 and 8: the settling time that the paper states, and the last time shown [s].
SETTLED, SHOWN = 0.5, 0.8
ENTRIES = ("K1", "K2", "K3", "K4", "K5")
CAPTIONS = {
    "figure-3": "d/sigma over the centre, m1 alone uncertain (k, c of Table 1).",
    "figure-4": "d/sigma over the centre, m1, c and k uncertain; both families.",
    "figure-5": "Closed-loop poles under the nominal gain (27), over the polytope.",
    "figure-6": "Closed-loop poles under the scheduled gain K(alpha), over the polytope.",
    "figure-7": "States and sprung-mass acceleration after a unit step of road velocity.",
    "figure-8": "Tyre deflection, sprung-mass velocity and acceleration after a unit impulse of "
    "road velocity.",
    "figure-9": "Magnitude from road velocity to the states.",
    "figure-10": "Sprung-mass acceleration by one-third octaves on a class C road at 20 m/s, "
    "weighted by Wk (top) and Wf (bottom) of ISO 2631-1; least and greatest over the family, and "
    "without control; severe discomfort after 30 minutes by ISO 2631-3:1985.",
}


def figures(
    results: Mapping[str, Any], designs: Mapping[str, Design], rides: Mapping[str, ride.Ride]
) -> dict[str, Figure]:
    """Draw figures 3 to 10."""
    rows = results["limits"]
    plants = {name: family(f"quarter-car-{name}") for name in FAMILIES}
    columns = {f"{name} family": found for name, found in rides.items()}
    bands = {
        title: {f"scheduled, {DISK}": found.bands, "passive": found.passive_bands}
        for title, found in columns.items()
    }
    return {
        "figure-3": limits_figure({"m1 uncertain": rows["m1"]}),
        "figure-4": limits_figure({f"{name} family": rows[name] for name in FAMILIES}, FLOOR),
        "figure-5": poles_figure(
            {f"{n} family": cloud(p, nominal_poles(p)) for n, p in plants.items()}, DISK
        ),
        "figure-6": poles_figure(
            {f"{n} family": cloud(plants[n], d.poles) for n, d in designs.items()}, DISK
        ),
        "figure-7": responses_figure(
            {title: found.step for title, found in columns.items()}, SETTLED, SHOWN
        ),
        "figure-8": responses_figure(
            {title: found.impulse for title, found in columns.items()}, until=SHOWN
        ),
        "figure-9": frequency_figure({t: found.frequency for t, found in columns.items()}),
        "figure-10": bands_figure(bands, [RIDE.nominal, MOTION.nominal], ride.BOUNDARY),
    }


def write(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write ``paper.json``, ``report.md`` and the figures; return their paths.

    The designs are read from ``folder``, and so proved afresh.
    """
    designs = {name: Design.load(folder / f"design-{name}") for name in FAMILIES}
    rides = {name: ride.ride_of(design) for name, design in designs.items()}
    results = {**results, "ride": ride.summary(rides)}
    paths = [folder / "paper.json", folder / "report.md"]
    write_text(paths[0], json.dumps(results, indent=1, allow_nan=False) + "\n")
    for name, figure in figures(results, designs, rides).items():
        for kind in FORMATS:
            paths.append(folder / f"{name}.{kind}")
            write_bytes(paths[-1], render(figure, kind))
    write_text(paths[1], report(results))
    return paths


def report(results: Mapping[str, Any]) -> str:
    """Set every published number beside the computed one, as Markdown."""
    parts = [
        "# Leite & Peres (2005), computed afresh",
        "Published numbers beside computed ones for the family `as-printed`, the vertices "
        "(23)-(26) as the paper used them; computed ones alone for `physical`, Table 1 with 20 %, "
        "of which the paper has none. Every radius and every computed gain below was proved in "
        "exact arithmetic from the exact vertices; `polefence check` repeats the proof of the "
        "saved designs.",
        "## Smallest radius at centre -40",
        _radii(results["radii"]),
        "The paper's solver stopped early on Theorem 1: 31 is no limit of the method.",
        _sweeps(results["limits"]),
        *(_figure(name) for name in ("figure-3", "figure-4")),
        "## The nominal gain (27)",
        _nominal(results["nominal"]),
        _figure("figure-5"),
        "## Gains",
        _gains(results["gains"]),
        "LMI solutions are not unique: computed gains differ from published ones and hold the same "
        "disk. A dash: the method gives no proof at that radius on that family.",
        f"## The disk ({DISK.centre:g}, {DISK.radius:g}), scheduled",
        table(
            ("family", "alpha sampled", "farthest pole from the centre", "all in the disk"),
            [
                (
                    name,
                    s["sampled alpha"],
                    number(s["farthest pole from the centre"]),
                    _yes(s["all in the disk"]),
                )
                for name, s in results["disk design"].items()
            ],
        ),
        _figure("figure-6"),
        "## How the car responds",
        ride.text(results["ride"], results["published"]["claims"]["settling_time_below_s"]),
        *(_figure(f"figure-{k}") for k in (7, 8, 9, 10)),
        '## "Only Theorem 1 below sigma = 13"',
        _slow(results["slow centres"]),
        "A negative ratio: the disk reaches into the right half-plane, the method stabilises "
        "nothing there.",
        "## Where the paper contradicts itself",
        _inconsistencies(results["inconsistencies"]),
    ]
    return "\n\n".join(parts) + "\n"


def _radii(rows: Sequence[Mapping[str, Any]]) -> str:
    cells = [
        (
            r["family"],
            r["method"],
            "" if r["published"] is None else number(r["published"]),
            _radius(r["radius"]),
            r["status"],
        )
        for r in rows
    ]
    return table(("family", "method", "published", "computed, proved", "status"), cells)


def _slow(rows: Sequence[Mapping[str, Any]]) -> str:
    cells = [
        (
            r["family"],
            number(r["centre"]),
            r["method"],
            _radius(r["radius"]),
            digits_down(r["d/sigma"], 5),
        )
        for r in rows
    ]
    return table(("family", "centre", "method", "smallest radius, proved", "d/sigma [%]"), cells)


def _radius(value: float | None) -> str:
    return "-" if value is None else digits_up(value)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _figure(name: str) -> str:
    caption = f"Figure {name.split('-')[1]}. {CAPTIONS[name]}"
    return f"![{caption}]({name}.png)\n\n*{caption}*"


def _sweeps(sweeps: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    lines = []
    for name, rows in sweeps.items():
        proved = sum(row["status"] == "proved" for row in rows)
        seconds = sum(row["seconds"] for row in rows)
        lines.append(f"- {name}: {proved} of {len(rows)} radii proved, {seconds:.0f} s of work")
    return "\n".join(lines)


def _nominal(nominal: Mapping[str, Any]) -> str:
    rows = [
        ("published (27)", *gain_cells(nominal["published"])),
        ("computed from Table 1", *gain_cells(nominal["computed"])),
    ]
    spread = [
        (name, number(s["farthest pole from the centre"]), _yes(s["all in the disk"]))
        for name, s in nominal["poles over the family"].items()
    ]
    return "\n\n".join(
        [
            table(("", *ENTRIES), rows),
            f"Agrees to all printed digits: {_yes(nominal['agrees to all printed digits'])}.",
            table(("family", "farthest pole from -40", f"all within {DISK.radius:g}"), spread),
        ]
    )


def _gains(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = []
    for row in rows:
        ours = row["computed"]
        if ours is not None and not isinstance(ours[0], list):
            ours = [ours]
        printed = row["published"] or []
        for j in range(max(len(printed), len(ours or []), 1)):
            label = f"K_{j + 1}" if row["method"] == "scheduled" else row["gain"]
            head = [row["family"], label, row["method"], number(row["radius"])]
            if printed:
                lines.append((*head, "published", *gain_cells(printed[j])))
                head = [""] * len(head)
            mine = gain_cells(ours[j]) if ours is not None else ("-",) * len(ENTRIES)
            lines.append((*head, "computed", *mine))
    reach = [
        (
            row["gain"],
            row["family"],
            number(row["radius"]),
            number(row["farthest pole of the published gain"]),
            _yes(row["farthest pole of the published gain"] < row["radius"]),
        )
        for row in rows
    ]
    return "\n\n".join(
        [
            table(("family", "gain", "method", "radius", "", *ENTRIES), lines),
            "How far the poles of the published gains go at the vertices:",
            table(("gain", "family", "radius", "farthest pole from -40", "in its disk"), reach),
        ]
    )


def _inconsistencies(items: Sequence[Mapping[str, Any]]) -> str:
    parts = []
    for i, item in enumerate(items):
        cells = [(key, number(value)) for key, value in item["computed"].items()]
        parts.append(f"{i + 1}. {item['statement']}.\n\n" + table(("computed", "value"), cells))
    return "\n\n".join(parts)
