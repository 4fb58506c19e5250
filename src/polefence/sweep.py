"""A sweep kept in a JSON file, row by row, so that it can be interrupted and resumed."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from polefence import __version__
from polefence.errors import InputError
from polefence.files import read_text, write_text
from polefence.limits import Limit, as_finished
from polefence.plant.family import UncertainPlant

MAX_BYTES = 64_000_000

Row = dict[str, Any]


def plant_summary(plant: UncertainPlant) -> dict[str, Any]:
    """Return what identifies a plant in a result file."""
    n, m = plant.shape
    return {
        "name": plant.name,
        "states": n,
        "inputs": m,
        "vertices": len(plant.vertices),
        "digest": plant.digest,
    }


def sweep(
    plant: UncertainPlant,
    centres: Sequence[float],
    methods: Sequence[str],
    path: Path | None = None,
    resume: bool = False,
    gain: bool = False,
    executor: Executor | None = None,
    on_row: Callable[[Limit], None] | None = None,
) -> list[Row]:
    """Return rows as `limits` has them, as plain data, keeping ``path`` up to date after every row.

    With ``resume``, proved rows already in the file are kept and not computed again.

    Raises
    ------
    InputError
        If the file to resume from is unreadable, of another plant, or by another version.
    """
    done = _finished(path, plant, gain) if resume and path is not None else {}
    tasks = [(c, m) for c in centres for m in methods if (c, m) not in done]
    for _, row in as_finished(plant, tasks, executor):
        done[row.centre, row.method] = row.as_row(gain)
        if path is not None:
            write_text(path, _dumps(plant, _ordered(done, centres, methods)))
        if on_row is not None:
            on_row(row)
    rows = _ordered(done, centres, methods)
    if path is not None:
        write_text(path, _dumps(plant, rows))
    return rows


def _ordered(
    done: dict[tuple[float, str], Row], centres: Sequence[float], methods: Sequence[str]
) -> list[Row]:
    return [done[c, m] for c in centres for m in methods if (c, m) in done]


def _dumps(plant: UncertainPlant, rows: list[Row]) -> str:
    document = {"polefence": __version__, "plant": plant_summary(plant), "rows": rows}
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _finished(path: Path, plant: UncertainPlant, gain: bool) -> dict[tuple[float, str], Row]:
    if not path.exists():
        return {}
    try:
        document = json.loads(read_text(path, MAX_BYTES, InputError))
        version = document["polefence"]
        digest, rows = document["plant"]["digest"], document["rows"]
        table = {(float(row["centre"]), str(row["method"])): row for row in rows}
        usable = {k: r for k, r in table.items() if r["status"] == "proved" and "radius" in r}
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: no sweep to resume: {error}; remove it to start anew") from error
    if digest != plant.digest:
        raise InputError(f"{path}: a sweep of another plant; remove it, or name another file")
    if version != __version__:
        raise InputError(f"{path}: a sweep by polefence {version}; remove it to start anew")
    return {k: r for k, r in usable.items() if not gain or "law" in r}


@contextmanager
def processes(jobs: int | None = None) -> Iterator[Executor | None]:
    """Worker processes for a sweep, by default one a processor; None for a single job."""
    count = jobs or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    pool = ProcessPoolExecutor(count, get_context("spawn"), initializer=_leave_interrupts)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_interrupts() -> None:
    # Ctrl-C is the parent's to handle: it cancels what has not begun and keeps what is done.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
