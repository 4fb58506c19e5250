"""Sweeps: order, executors, interruption, resumption."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from polefence import InputError, UncertainPlant, limits
from polefence.errors import RegionError
from polefence.sweep import processes, sweep

CENTRES, METHODS = [-2.0, -4.0, -3.0], ["slack", "quadratic"]


@pytest.fixture(scope="module")
def plant(make_random):
    return make_random(8, 2, 1, 2)


@pytest.fixture(scope="module")
def rows(plant):
    return limits(plant, CENTRES, METHODS)


def test_rows_come_in_the_order_asked_for_and_are_proved(rows):
    assert [(r.centre, r.method) for r in rows] == [(c, m) for c in CENTRES for m in METHODS]
    for row in rows:
        assert row.status == "proved"
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
    kept = json.loads(path.read_text())["rows"]
    assert len(kept) == 4
    fresh = []
    done = sweep(plant, CENTRES, METHODS, path, resume=True, on_row=fresh.append)
    assert len(fresh) == 2
    assert all(row in done for row in kept)
    # a row started from another neighbour ends at the same radius, to the solver's tolerance
    assert np.allclose([row["radius"] for row in done], [row.radius for row in rows], rtol=1e-6)
    assert json.loads(path.read_text())["rows"] == done


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
    with pytest.raises(InputError, match="no sweep to resume"):
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
    document = json.loads(path.read_text())
    document["rows"][0].update(damage)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="damaged|no sweep"):
        sweep(plant, [-2.0], ["slack"], path, resume=True)


def test_a_killed_worker_costs_no_row(plant, rows):
    with processes(2) as executor:
        for worker in executor._processes.values():
            worker.kill()
        again = limits(plant, CENTRES, METHODS, executor)
    assert [r.radius for r in again] == [r.radius for r in rows]
