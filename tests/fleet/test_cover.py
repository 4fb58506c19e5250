"""Few laws for many variants: no more than are needed, each proved of each of its variants."""

import re
import shutil
from collections import Counter
from fractions import Fraction

import numpy as np
import pytest

from polefence import UncertainPlant, check
from polefence.base.errors import PlantError
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.fleet import Store, Workers, judged, load_study, processes, run
from polefence.fleet.questions import LOST, NOT_PROVED, Answer, Cover
from polefence.plant.joined import joined
from polefence.plant.outputs import Output
from polefence.show.fleet import _laws, _ringed
from support.commands import ran
from support.studies import put_proof, put_rows, signed

pytest.importorskip("pyarrow")

BASE = """
states = ["x"]
inputs = ["u"]
constants = {b = 1}
[parameter.a]
range = [0.5, 1.5]
[matrices]
A = [["a"]]
B = [["b"]]
"""
STUDY = """
base = "plant.toml"
[variants]
grid = {b = [VALUES]}
[[question]]
ask = "cover"
region = "disk(-5, 4)"
"""


def study_of(folder, values, base=BASE):
    (folder / "plant.toml").write_text(base)
    path = folder / "study.toml"
    path.write_text(STUDY.replace("VALUES", ", ".join(map(str, values))))
    return load_study(path)


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """A study of values and its results, made once; not to change."""
    known = {}

    def of(*values):
        if values not in known:
            folder = tmp_path_factory.mktemp("answered")
            known[values] = study_of(folder, values), folder / "out"
            for _ in run(known[values][0], Store(folder / "out"), processes(1)):
                pass
        return known[values]

    return of


def least(values):
    """Return the least number of gains: points that meet all intervals -9 < a + b K < -1."""
    ends = []
    for b in values:
        low, high = sorted([(-9 - 0.5) / b, (-1 - 1.5) / b])
        ends.append((high, low))
    count, last = 0, -np.inf
    for high, low in sorted(ends):
        if low >= last:
            count, last = count + 1, high
    return count


@pytest.mark.parametrize(
    "values",
    [[1, 2, 3], [-2, -1, 1, 2], [1, 2, 3, 10, -1, -2], [0.1, 0.2, 0.5, 0.9, 1.7, 3, 5, 9, 16, 30]],
)
def test_as_few_gains_as_intervals_need(answered, values):
    store = Store(answered(*values)[1])
    rows = list(store.rows())
    assert [row["status"] for row in rows] == ["proved"] * len(values)
    assert len({row["law"] for row in rows}) == least(values)
    assert not [own.fault for own in judged(store, processes(1)) if own.fault]
    for row in rows:
        assert check(store.proof(row["proof"])).proved


def test_one_that_nothing_moves_is_a_row_with_its_reason(tmp_path, capsys):
    study_of(tmp_path, [0, 1, 2])
    path, out = tmp_path / "study.toml", tmp_path / "out"
    said = ran(capsys, "study", path, "-o", out, "--jobs", "1", status=1)
    assert "2 proved; by 1 law: of 2 variants" in said
    rows = {row["b"]: row for row in Store(out).rows()}
    assert rows[0]["status"] != "proved"
    assert rows[0]["reason"]
    assert rows[1]["law"] == rows[2]["law"] != ""


def test_the_page_has_a_table_and_a_map_of_the_laws(tmp_path, capsys):
    study, out, page = study_of(tmp_path, [-2, 0, 1, 2]), tmp_path / "out", tmp_path / "all.html"
    for _ in run(study, Store(out), processes(1)):
        pass
    assert main(["study", str(out), "--html", str(page)]) == 1
    text = page.read_text()
    assert "2 laws keep 3 of 4 variants, each proved." in text
    counts = Counter(row["law"] for row in Store(out).rows())
    cells = re.findall(r"<td>([0-9a-f]{8,})</td>\s*<td>(\d+)</td>\s*<td>(\d+)</td>", text)
    assert {law: int(count) for law, count, _ in cells} == {k: n for k, n in counts.items() if k}
    rows = [row | {"value": None} for row in Store(out).rows()]
    (axes,) = _laws("cover", ["b"], rows).figure.axes
    marks = {own.get_label(): len(own.get_offsets()) for own in axes.collections}
    assert marks == {law or "none": count for law, count in counts.items()}


def test_of_variants_at_one_place_of_a_map_the_first_is_a_ring_behind_the_others():
    order, sizes = _ringed([1, 2, 1, 1], [5, 5, 5, 5])
    assert sizes[0] > sizes[2] > sizes[3] == sizes[1]
    assert [k for k in order if k != 1] == [0, 2, 3]


def test_resuming_gives_a_law_to_those_that_have_none(answered, tmp_path):
    study, made = answered(-2, -1, 1, 2)
    out = shutil.copytree(made, tmp_path / "out")
    before = {row["variant"]: row for row in Store(out).rows()}
    next((out / "rows").iterdir()).unlink()
    kept = {row["variant"] for row in Store(out).rows()}
    assert len(kept) == 2
    fresh = [row for rows in run(study, Store(out), processes(1), True) for row in rows]
    assert {row["variant"] for row in fresh} == set(before) - kept
    assert all(row["law"] == before[row["variant"]]["law"] for row in fresh)


def test_a_row_that_names_another_law_is_found(tmp_path):
    study, out = study_of(tmp_path, [-1, 1]), tmp_path / "out"
    for _ in run(study, Store(out), processes(1)):
        pass
    one, other = Store(out).rows()
    put_rows(out, [signed(row, law=one["law"]) for row in (one, other)])
    faults = {own.variant: own.fault for own in judged(Store(out), processes(1))}
    assert faults == {one["variant"]: "", other["variant"]: "names another law than its file"}


def test_an_estimate_tries_the_first_group(tmp_path, capsys, monkeypatch):
    study_of(tmp_path, [1 + k / 100 for k in range(20)])
    tried = []
    monkeypatch.setattr(Cover, "proved", lambda *own: tried.append(own) or Answer("proved"))
    said = ran(capsys, "study", tmp_path / "study.toml", "--estimate")
    assert re.search(r"  cover: cover, region = disk\(-5, 4\): \S+ s a variant\n", said)
    assert re.search(r"  20 rows: about \S+ s of one processor", said)
    assert len(tried) == Cover.group


def test_a_proof_that_is_no_file_of_claims_is_found(tmp_path):
    study, out = study_of(tmp_path, [1]), tmp_path / "out"
    for _ in run(study, Store(out), processes(1)):
        pass
    for content in (b"[1]", b"{", b"\xff", b"{}"):
        digest = put_proof(out, content)
        put_rows(out, [signed(row, proof=digest) for row in Store(out).rows()])
        (own,) = judged(Store(out), processes(1))
        assert own.fault


class _Dead(Workers):
    def done(self, work, tasks):
        for task in tasks:
            yield task, None


def test_where_those_that_prove_die_rows_are_lost(tmp_path):
    study, dead = study_of(tmp_path, [1, 2]), _Dead(processes(1).places, 1)
    rows = [row for found in run(study, Store(tmp_path / "out"), dead) for row in found]
    assert [row["status"] for row in rows] == [LOST, LOST]


def test_a_law_that_no_proof_follows_ends_with_a_reason(tmp_path, monkeypatch):
    def refused(self, K, spec):
        return Answer(NOT_PROVED, reason="no")

    monkeypatch.setattr(Cover, "proved", refused)
    study = study_of(tmp_path, [1, 2])
    workers = processes(1)
    rows = [row for found in run(study, Store(tmp_path / "out"), workers) for row in found]
    assert sorted((row["variant"], row["status"], row["reason"]) for row in rows) == [
        (0, NOT_PROVED, "no"),
        (1, NOT_PROVED, "no"),
    ]


def test_limits_hold_for_each_car(tmp_path, capsys):
    (tmp_path / "ride.toml").write_text(spec_text("quarter-car-ride"))
    path, out = tmp_path / "study.toml", tmp_path / "out"
    path.write_text("""base = "ride.toml"
[variants]
grid = {m2 = [26, 31], "m1.high" = [330, 346]}
[[question]]
ask = "cover"
limits = ["rms of sprung-mass acceleration <= 1.2"]
""")
    assert main(["study", str(path), "-o", str(out), "--jobs", "1"]) == 0
    assert "4 proved; by 1 law: of 4 variants" in capsys.readouterr().out
    for row in Store(out).rows():
        assert "rms of 'sprung-mass acceleration' = " in row["claim"]
        assert "rms of 'actuator force' = u1 <= 660" in row["claim"]
    assert main(["study", str(out), "--check", "--jobs", "1"]) == 0


@pytest.mark.parametrize("region", ["", "half_plane(1)", "disk(0, 0.9)"])
def test_few_laws_are_found_in_discrete_time(region, tmp_path, capsys):
    """z = 1 + (a + b K) / 20, a from 0.5 to 1.5: one K for b = 1 and 2, another for b = -1."""
    base = BASE.replace("constants", "sample_time = 0.05\nconstants")
    base = base.replace('["a"]', '["1 + a/20"]').replace('["b"]', '["b/20"]')
    asked = f'region = "{region}"' if region else ""
    text = STUDY.replace('region = "disk(-5, 4)"', asked).replace("VALUES", "1, 2, -1")
    (tmp_path / "plant.toml").write_text(base)
    (tmp_path / "study.toml").write_text(text)
    out = tmp_path / "out"
    assert main(["study", str(tmp_path / "study.toml"), "-o", str(out), "--jobs", "1"]) == 0
    assert "3 proved; by 2 laws: of 2, 1 variants" in capsys.readouterr().out
    assert main(["study", str(out), "--check", "--jobs", "1"]) == 0


def test_joined_plants_have_the_vertices_and_outputs_of_each():
    y = [Output("y", "m", [k, 0]) for k in (1, 2)]
    plants = [
        UncertainPlant.from_vertices([[[0, 1], [-k, 0]]], [[[0], [k]]], outputs=(own,))
        for k, own in zip((1, 2), y, strict=True)
    ]
    both = joined(plants, ["y"])
    assert both.vertices == tuple(own.vertices[0] for own in plants)
    assert ((Fraction(1), 0), (Fraction(2), 0)) == both.signal("y").C
    other = UncertainPlant.from_vertices([[[0, 1], [-1, 0]]], [[[0], [1]]], states=("a", "b"))
    with pytest.raises(PlantError, match="need the same states"):
        joined([plants[0], other])
    smaller = UncertainPlant.from_vertices([[[1]]], [[[1]]])
    with pytest.raises(PlantError, match="same numbers of states and inputs"):
        joined([plants[0], smaller])
