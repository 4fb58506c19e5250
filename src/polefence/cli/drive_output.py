"""Results of `simulate`: columns, panels, a summary as plain data and as text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from polefence.base.errors import InputError
from polefence.cli.laws import Named
from polefence.plant.outputs import disturbances
from polefence.plant.system import Array

if TYPE_CHECKING:  # imported where used: with scipy behind them
    from polefence.response.columns import Table
    from polefence.show.plots.signals import Panel
    from polefence.vehicle.run import Run, Setup

DEMANDED, ESTIMATED = " demanded", " estimated"  # drawn into the panel of what they are of


def table_of(setup: Setup, runs: Mapping[str, Run]) -> Table:
    """Return time, disturbances and all signals, in that order; of several laws under its name."""
    from polefence.response.columns import Table

    moved = setup.excitation
    labels, columns = ["time [s]"], [setup.time]
    if moved.height is not None:
        labels.append("road height [m]")
        columns.append(moved.height)
    taken = {signal.label for signal in setup.plant.signals}
    for own, values in zip(disturbances(setup.plant), moved.samples.T, strict=True):
        labels.append(f"disturbance {own.label}" if own.label in taken else own.label)
        columns.append(values)
    for name, run in runs.items():
        before = f"{name}: " if len(runs) > 1 else ""
        for signal, unit, values in run.columns:
            labels.append(before + _label(signal, unit))
            columns.append(values)
    return Table(tuple(labels), np.stack(columns, axis=1))


def panels_of(setup: Setup, runs: Mapping[str, Run]) -> list[Panel]:
    """Return panels for what moves the plant, signals and moving parameters; laws in one panel."""
    from polefence.show.plots.signals import BESIDE, Panel

    moved, found = setup.excitation, dict[str, dict[str, Array]]()
    if moved.height is not None:
        found["road height [m]"] = {"": moved.height}
    else:
        pairs = zip(disturbances(setup.plant), moved.samples.T, strict=True)
        found |= {own.label: {"": values} for own, values in pairs if values.any()}
    for law, run in runs.items():
        for name, unit, values in run.columns:
            of = name.removesuffix(DEMANDED).removesuffix(ESTIMATED)
            common = name in setup.courses.space.names
            if setup.hardware.learns and (common or name.endswith(ESTIMATED)):
                of = f"{of}, true and estimated"
            own = found.setdefault(_label(of, unit), {})
            if name.endswith(DEMANDED):
                own[law + BESIDE] = values
            else:  # a parameter is the same for all laws, only its estimates are not
                own["" if common else law] = values
    return [Panel(label, curves) for label, curves in found.items()]


def summary_of(law: Named, run: Run) -> dict[str, Any]:
    """Return peaks, rms, comfort and what is outside of the guarantee, as plain data."""
    return {
        "law": law.name,
        "proved": law.proved,
        "exact": run.setup.exact,
        "signals": [_signal(run.setup.time, *column) for column in run.columns],
        "comfort": _comfort(run),
        "events": [asdict(event) for event in run.events],
        "notes": list(run.notes),
        "report": run.report(),
    }


def text_of(summary: Mapping[str, Any]) -> list[str]:
    """Return a summary in lines."""
    how = "exact at every instant" if summary["exact"] else "Runge-Kutta of order 4"
    head = f"{summary['law']} ({how})"
    lines = [f"{head:<46}{'peak':>12}{'at [s]':>10}{'rms':>12}"]
    for row in summary["signals"]:
        numbers = f"{_digits(row['peak']):>12}{_digits(row['at']):>10}{_digits(row['rms']):>12}"
        lines.append(f"  {_label(row['signal'], row['unit']):<44}{numbers}")
    lines += [f"  {line}" for line in _comfort_lines(summary["comfort"])]
    lines.append(f"  proved of this law: {summary['proved']}")
    return lines + [f"  {line}" for line in summary["report"]]


def _signal(time: Array, name: str, unit: str, values: Array) -> dict[str, Any]:
    """Peak with its sign, its time and rms; null where the loop ran away."""
    own = {"signal": name, "unit": unit, "peak": None, "at": None, "rms": None}
    if not np.all(np.isfinite(values)):
        return own
    k = int(np.argmax(np.abs(values)))
    size = float(np.abs(values[k])) or 1.0
    rms = size * math.sqrt(float(np.mean((values / size) ** 2)))
    return own | {"peak": float(values[k]), "at": float(time[k]), "rms": rms}


def _comfort(run: Run) -> dict[str, Any]:
    """Return what ISO 2631-1 makes of a car's acceleration, or why nothing; else no entry."""
    from polefence.vehicle.comfort import comfort, comfort_reading
    from polefence.vehicle.vehicle import ride

    known = ride(run.setup.plant)
    if known is None:
        return {}
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = comfort(run.response.of(known.acceleration.name)[0], run.setup.step)
        reading = comfort_reading(float(found.weighted_rms))
    except InputError as error:
        return {"not evaluated": str(error)}
    return {
        "weighted rms": float(found.weighted_rms),
        "mtvv": float(found.mtvv),
        "vdv": float(found.vdv),
        "msdv": float(found.msdv),
        "reading": list(reading),
        "shocks": bool(found.shocks),
    }


def _comfort_lines(found: Mapping[str, Any]) -> Sequence[str]:
    if not found:
        return ()
    if "not evaluated" in found:
        return [f"comfort: not evaluated ({found['not evaluated']})"]
    shocks = "; shocks: the rms says too little" if found["shocks"] else ""
    return (
        f"comfort (ISO 2631-1): weighted rms {found['weighted rms']:.4g} m/s2, "
        f"{' to '.join(found['reading'])}{shocks}",
        f"  MTVV {found['mtvv']:.4g} m/s2, VDV {found['vdv']:.4g} m/s1.75, "
        f"MSDV {found['msdv']:.4g} m/s1.5",
    )


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _digits(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
