"""Sweeps: order, executors, interruption, resumption."""

import json
import os
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from polefence import InputError, UncertainPlant, limits
from polefence.base.errors import RegionError
from polefence.base.workers import as_finished, processes
from polefence.search.limits import sweep
from support.commands import ran, refused
from support.files import rewritten

CENTRES, METHODS = [-2.0, -4.0, -3.0], ["slack", "quadratic"]


def rows_in(path):
    """The rows of a file, which have the old name of the answer too."""
    rows = json.loads(path.read_text())["rows"]
    assert all(row.pop("status") == row["answer"] for row in rows)
    return rows


@pytest.fixture(scope="module")
def plant(make_random):
    return make_random(8, 2, 1, 2)


@pytest.fixture(scope="module")
def rows(plant):
    return limits(plant, CENTRES, METHODS)


def test_rows_come_in_the_order_asked_for_and_are_proved(rows):
    assert [(r.centre, r.method) for r in rows] == [(c, m) for c in CENTRES for m in METHODS]
    for row in rows:
        assert row.answer == "proved"
        assert row.design.certificate.prove().proved
        assert row.radius == row.design.region.radius
        # at -4 the infimum is not attained: an uncontrollable mode between the vertices
        assert (row.lower is None) == (row.centre == -4)
        assert row.lower is None or row.lower < row.radius < row.lower * (1 + 1e-5)
        assert row.seconds > 0
        assert row.ratio == pytest.approx(100 * (1 - row.radius / -row.centre))


def test_executors_change_nothing_but_the_time(plant, rows):
    for pool in (ThreadPoolExecutor(2), processes(2)):
        with pool as executor:
            again = limits(plant, CENTRES, METHODS, executor)
        assert [r.radius for r in again] == [r.radius for r in rows]


def test_one_centre_and_one_method_need_no_list(plant, rows):
    (row,) = limits(plant, -2.0, "slack")
    assert row.radius == rows[0].radius


def test_unusable_requests_are_refused_before_any_work(plant):
    with pytest.raises(RegionError):
        limits(plant, [-2.0, 2.0])
    with pytest.raises(InputError, match="did you mean 'slack'"):
        limits(plant, [-2.0], ["slac"])
    with pytest.raises(InputError, match="uncontrollable"):
        limits(UncertainPlant.from_vertices([np.eye(2)], [[[0], [1]]]), [-2.0])


class Interrupt:
    def __init__(self, after):
        self.left = after

    def __call__(self, row):
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


def test_an_interrupted_sweep_keeps_its_rows_and_resumes(plant, rows, tmp_path):
    path = tmp_path / "rows.json"
    with pytest.raises(KeyboardInterrupt):
        sweep(plant, CENTRES, METHODS, path, on_row=Interrupt(after=4))
    kept = rows_in(path)
    assert len(kept) == 4
    fresh = []
    done = sweep(plant, CENTRES, METHODS, path, resume=True, on_row=fresh.append)
    assert len(fresh) == 2
    for row in kept:  # as it was, but for a bound whose proof the file does not have
        marked = {} if row["lower"] is None else {"lower_from_file": True}
        assert row | marked in done
    assert sum("lower_from_file" in row for row in done) == sum(bool(row["lower"]) for row in kept)
    # a row started from another neighbour ends at the same radius, to the solver's tolerance
    assert np.allclose([row["radius"] for row in done], [row.radius for row in rows], rtol=1e-6)
    assert rows_in(path) == done


def test_resuming_refuses_what_is_not_its_own(plant, make_random, tmp_path):
    path = tmp_path / "rows.json"
    sweep(plant, [-2.0], ["slack"], path)
    with pytest.raises(InputError, match="another plant"):
        sweep(make_random(9, 2, 1, 2), [-2.0], ["slack"], path, resume=True)
    document = json.loads(path.read_text())
    path.write_text(json.dumps(document | {"polefence": "0.0.1"}))
    with pytest.raises(InputError, match=r"by polefence 0\.0\.1"):
        sweep(plant, [-2.0], ["slack"], path, resume=True)
    path.write_text("{}")
    with pytest.raises(InputError, match="not a sweep to resume"):
        sweep(plant, [-2.0], ["slack"], path, resume=True)


def test_resuming_keeps_rows_that_were_not_asked_for(plant, tmp_path):
    path = tmp_path / "rows.json"
    sweep(plant, CENTRES, ["slack"], path)
    asked = sweep(plant, CENTRES[:1], ["slack"], path, resume=True)
    assert [row["centre"] for row in asked] == CENTRES[:1]
    assert len(json.loads(path.read_text())["rows"]) == len(CENTRES)


@pytest.mark.parametrize(
    "damage",
    [{"radius": -1.0}, {"radius": None}, {"radius": "x"}, {"centre": 2.0}, {"method": "x"}],
)
def test_a_damaged_row_is_refused(plant, tmp_path, damage):
    path = tmp_path / "rows.json"
    sweep(plant, [-2.0], ["slack"], path)
    with rewritten(path) as document:
        document["rows"][0].update(damage)
    with pytest.raises(InputError, match="damaged|no sweep"):
        sweep(plant, [-2.0], ["slack"], path, resume=True)


def resumed(plant, path, change, **options):
    """Change the one row of a file and resume; return the row and how many were computed."""
    with rewritten(path) as document:
        change(document["rows"][0])
    fresh = []
    (row,) = sweep(plant, [-2.0], ["scheduled"], path, resume=True, on_row=fresh.append, **options)
    return row, len(fresh)


@pytest.fixture
def swept(plant, tmp_path):
    path = tmp_path / "rows.json"
    sweep(plant, [-2.0], ["scheduled"], path, gain=True)
    return path


EDITED = {
    "a smaller radius": lambda row: row.update(radius=0.9 * row["radius"], lower=None),
    "another method": lambda row: row.update(method="slack"),
    "another degree": lambda row: row.update(method="scheduled(2, 1)"),
    "another centre": lambda row: row.update(centre=-2.5, lower=None),
    "another law": lambda row: row["proof"]["law"]["Z"][0][0].__setitem__(0, 9.0),
    "another certificate": lambda row: row["proof"].update(evidence={"tau": 0, "elevation": 9}),
    "no certificate": lambda row: row["proof"].pop("evidence"),
    "no table": lambda row: row.update(proof=[1]),
    "numbers without end": lambda row: row["proof"].update(evidence={"tau": "1" * 400}),
}


@pytest.mark.parametrize("edit", EDITED)
def test_an_edited_row_is_never_taken_as_proved(plant, swept, edit):
    with pytest.raises(InputError, match=r"rows\.json: the row of centre .*; remove the file"):
        resumed(plant, swept, EDITED[edit])


def test_a_row_that_is_proved_again_says_no_more_than_that(plant, swept):
    """A wider disk is proved by the same law; laws printed are those that were proved."""
    original = json.loads(swept.read_text())["rows"][0]

    def edit(row):
        row.update(radius=1.01 * row["radius"], law={"kind": "fixed", "K": [[0, 0]]}, note="best")

    row, computed = resumed(plant, swept, edit, gain=True)
    assert computed == 0
    assert row["radius"] == 1.01 * original["radius"]
    assert row["law"] == original["law"] == row["proof"]["law"]
    assert "note" not in row
    assert row["lower_from_file"] is True
    assert rows_in(swept) == [row]


def test_a_row_without_a_proof_is_computed_anew(plant, swept):
    original = json.loads(swept.read_text())["rows"][0]

    def edit(row):
        del row["proof"]
        row.update(radius=1e-3, lower=None)

    row, computed = resumed(plant, swept, edit)
    assert computed == 1
    assert row["radius"] == original["radius"]
    assert "lower_from_file" not in row


def test_the_command_marks_what_it_takes_from_the_file(tmp_path, capsys):
    spec, rows = tmp_path / "spring.toml", tmp_path / "rows.json"
    spec.write_text(
        '[parameter.k]\nrange = [1, 2]\n[matrices]\nA = [[0, 1], ["-k", "-0.1"]]\nB = [[0], [1]]\n'
    )
    words = ["limits", str(spec), "--centre", "-2", "--method", "slack", "--json", str(rows)]
    first = ran(capsys, *words)
    assert "*" not in first
    again = ran(capsys, *words, "--resume").splitlines()
    assert again[-2] == f"* from {rows}, not proved again; every radius is"
    assert again[-1] == f"saved: {rows}"
    plain = [line.replace("* ", "  ") for line in again]
    assert plain[:-2] + plain[-1:] == first.splitlines()
    with rewritten(rows) as document:
        document["rows"][0]["radius"] *= 0.99
        document["rows"][0]["lower"] = None
    said = refused(capsys, *words, "--resume")
    assert "the row of centre -2 and slack is not proved by what it holds" in said


def test_a_killed_worker_costs_no_row(plant, rows):
    with processes(2) as executor:
        for worker in executor._processes.values():
            worker.kill()
        again = limits(plant, CENTRES, METHODS, executor)
    assert [r.radius for r in again] == [r.radius for r in rows]


@pytest.mark.parametrize("until", range(4))
def test_a_pool_may_break_before_all_is_submitted(until):
    class Breaking(ThreadPoolExecutor):
        left = until

        def submit(self, fn, /, *args):
            if not self.left:
                raise BrokenExecutor
            self.left -= 1
            return super().submit(fn, *args)

    with Breaking() as executor:
        assert sorted(as_finished(executor, abs, [-1, -2, -3])) == [1, 2, 3]


WORKERS = """
import os, time
from polefence.base.workers import processes

if __name__ == "__main__":
    with processes(2) as executor:
        print(*{f.result() for f in [executor.submit(os.getpid) for _ in range(8)]}, flush=True)
        executor.submit(time.sleep, 600)
        time.sleep(600)
"""


def gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text()


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked up in /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(WORKERS)
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    try:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert workers
        assert not any(gone(pid) for pid in workers)
    finally:
        parent.kill()
        parent.communicate()
    for _ in range(600):
        if all(gone(pid) for pid in workers):
            return
        time.sleep(0.1)
    pytest.fail(f"processes {workers} live on")
