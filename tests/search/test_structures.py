"""Tables of structures: no row is worse than one below it, faults leave the others, files hold."""

import json

import numpy as np
import pytest

from polefence import InputError, Rms, Structure, UncertainPlant, check
from polefence.law.laws import FixedGain, PolynomialGain
from polefence.plant.spec import loads
from polefence.requirements.gain import Gain
from polefence.search.structures import asked_of, numbers_of, structures
from polefence.show.plots import structures_figure
from support.hasty import hasty
from support.specs import ONE_STATE, TWO_STATES

SENSED = TWO_STATES + "[sensor.x]\nbandwidth = 5\nnoise = 0.002\n"
LIMIT = [Rms("force", 2.0, 2.0)]
LEAST = Rms("x", None, 2.0)


@pytest.fixture(scope="module")
def plant():
    return loads(SENSED)


@pytest.fixture(scope="module")
def table(plant, tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "structures.json"
    structure = Structure(("measured x",))
    return structures(
        plant, LEAST, LIMIT, structure=structure, orders=(1, 0), degrees=(0, 1), path=path
    ), path


def below(table, row):
    return [table.rows[j] for j in table.asked.every_poorer(row["row"] - 1)]


def test_rows_go_from_the_poorest_on(table):
    table, _ = table
    assert [(row["degree"], row["order"]) for row in table.rows] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert [table.asked.every_poorer(k) for k in range(4)] == [[], [0], [0], [0, 1, 2]]
    assert table.asked.poorer(3) == [1, 2]


def test_no_row_is_worse_than_one_below_it(table):
    table, _ = table
    for row in table.rows:
        assert row["answer"] == "proved"
        assert all(row["level"] <= other["level"] for other in below(table, row))
        assert row["own"] >= row["proved"]
        assert row["sampled"] <= row["proved"] * (1 + 1e-9)


def test_an_order_more_than_halves_what_one_sensor_reaches(table):
    table, _ = table
    assert table.row(1)["proved"] < 0.2 * table.row(0)["proved"]
    assert table.recommended["order"] == 1
    assert table.recommended["degree"] == 0
    assert "fewest within 1 %" in table.reason or "the best" in table.reason


def test_no_law_goes_below_its_limit(table):
    table, _ = table
    least = table.limit_of_any_law.specifications[0].at_most
    assert 0 < least <= table.best["level"]


def test_the_figure_draws_each_row_and_what_no_law_goes_below(table):
    pytest.importorskip("matplotlib")

    table, _ = table
    (ax,) = structures_figure(table).axes
    drawn = {(x, y) for line in ax.lines for x, y in zip(*line.get_data(), strict=True)}
    assert {(row["numbers"], row["proved"]) for row in table.rows} <= drawn
    (dotted,) = (line for line in ax.lines if line.get_label() == "no law goes below, proved")
    assert set(dotted.get_ydata()) == {table.limit_of_any_law.specifications[0].at_most}


def test_each_law_is_of_its_row_and_proved_afresh(table):
    table, _ = table
    for row in table.rows:
        design = table.design(row)
        assert design.plant.shape[0] == 3 + table.asked.structures[row["law_of"] - 1].order
        assert numbers_of(design.law) == row["numbers"]
        assert design.certificate.prove().proved


def test_rows_are_resumed_and_proved_afresh(table, plant):
    table, path = table
    structure, seen = Structure(("measured x",)), []
    again = structures(
        plant,
        LEAST,
        LIMIT,
        structure=structure,
        orders=(0, 1),
        degrees=(0, 1),
        path=path,
        resume=True,
        on_row=seen.append,
    )
    assert not seen
    drop = ("seconds",)
    for one, other in zip(table.rows, again.rows, strict=True):
        assert {k: v for k, v in one.items() if k not in drop} == {
            k: v for k, v in other.items() if k not in drop
        }


@pytest.mark.parametrize(
    "fault", ["proved", "law_of", "performance", "limit", "row", "question", "text"]
)
def test_a_damaged_file_is_not_resumed(table, plant, tmp_path, fault):
    _, path = table
    document = json.loads(path.read_text())
    row = document["rows"][1]
    if fault == "proved":
        row["proved"] *= 0.99
    elif fault == "law_of":
        row["law_of"] = 4
    elif fault == "performance":
        row["performance"] = document["rows"][0]["performance"]
    elif fault == "limit":
        row["bounds"][0]["proved"] *= 0.5
    elif fault == "row":
        row["row"] = 9
    elif fault == "question":
        document["question"]["subject_to"] = []
    text = json.dumps(document)
    damaged = tmp_path / "structures.json"
    damaged.write_text(text[: len(text) // 2] if fault == "text" else text)
    with pytest.raises(InputError, match="remove the file to start anew"):
        structures(
            plant,
            LEAST,
            LIMIT,
            structure=Structure(("measured x",)),
            orders=(0, 1),
            degrees=(0, 1),
            path=damaged,
            resume=True,
        )


def test_a_law_of_more_signals_is_no_law_of_a_row(plant, tmp_path):
    """A file that calls a law of all states one of a single signal is not resumed."""
    path = tmp_path / "structures.json"
    ask = {"orders": (0,), "path": path}
    with hasty():
        structures(plant, LEAST, LIMIT, structure=Structure(("x", "v")), **ask)
    wide = json.loads(path.read_text())
    with hasty():
        structures(plant, LEAST, LIMIT, structure=Structure(("measured x",)), **ask)
    narrow = json.loads(path.read_text())
    narrow["rows"][0] |= {
        key: wide["rows"][0][key] for key in ("proved", "performance", "bounds", "own", "level")
    }
    path.write_text(json.dumps(narrow))
    with pytest.raises(InputError, match="remove the file to start anew"):
        structures(plant, LEAST, LIMIT, structure=Structure(("measured x",)), resume=True, **ask)


def test_files_of_a_table_are_those_of_its_laws(table, tmp_path):
    table, _ = table
    written = table.save(tmp_path)
    names = {str(path.relative_to(tmp_path)) for path in written}
    assert {"design.json", "structures.json", "limit.json"} <= names
    for row in table.rows:
        assert check(tmp_path / table.asked.folder(row["row"] - 1)).proved
    assert check(tmp_path / "design.json").proved
    assert check(tmp_path / "limit.json").proved
    assert (tmp_path / "design.json").read_text() == (
        tmp_path / table.asked.folder(table.recommended["row"] - 1) / "design.json"
    ).read_text()


# --- a row without a law --------------------------------------------------------------------------


def test_a_row_without_a_law_says_why_and_stops_nothing():
    # an unstable state needs it, the other signal does not show it
    plant = loads(ONE_STATE.replace('"x [m]"]', '"x [m]", "z [m]"]')
        .replace('[["a"]]', '[["a", 0], [0, -1]]')
        .replace("B = [[1]]", "B = [[1], [0]]")
        .replace("E = [[1]]", "E = [[1], [1]]"))  # fmt: skip
    with hasty():
        table = structures(
            plant, LEAST, [Rms("force", 5.0, 2.0)], measured=[["z"], ["x"]], orders=(0,)
        )
    assert [row["answer"] for row in table.rows] == ["undecided", "proved"]
    assert table.rows[0]["reason"]
    assert not table.proved
    assert table.recommended is table.rows[1]
    with pytest.raises(InputError, match="nothing is proved of z"):
        table.file(table.rows[0])


def test_a_worse_search_takes_the_law_below(table):
    table, _ = table
    asked, first = table.asked, table.rows[0]
    done = {asked.key(k): row for k, row in enumerate(table.rows)}
    worse = table.rows[1] | {"level": 9.0, "proved": 9.0, "own": 9.0}
    taken = asked.least(worse, done)
    assert taken["law_of"] == 1
    assert taken["own"] == 9.0
    assert (taken["row"], taken["order"]) == (2, 1)
    assert taken["proved"] == first["proved"]
    failed = worse | {"level": None, "answer": "undecided", "performance": None}
    assert asked.least(failed, done)["answer"] == "proved"


# --- random plants --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_tables_of_random_plants_never_rise(seed):
    random = np.random.default_rng(seed)
    n = 2
    A = random.normal(0, 1, (n, n)) - 0.5 * np.eye(n)
    vertices = [np.round(A + random.normal(0, 0.1, (n, n)), 3).tolist() for _ in range(2)]
    B, E = [[0.0], [1.0]], [[1.0], [0.5]]
    plant = UncertainPlant.from_vertices(vertices, [B] * 2, [E] * 2)
    with hasty():
        table = structures(
            plant,
            Rms("x1", None, 2.0),
            [Rms("u1", 3.0, 2.0)],
            orders=(0, 1),
            degrees=(0, 1),
            measured=[["x1"], ["x1", "x2"]],
        )
    assert len(table.rows) == 8
    for row in table.rows:
        levels = [other["level"] for other in below(table, row) if other["level"] is not None]
        assert not levels or row["level"] <= min(levels)
    if table.limit_of_any_law is not None:
        least = table.limit_of_any_law.specifications[0].at_most
        assert least <= table.best["level"] * (1 + 1e-9)


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"orders": range(5), "degrees": range(5)}, "25 structures: 1 to 24 can be asked for"),
        ({"orders": ()}, None),
        ({"orders": (21,)}, "order = 21 must be 0 to 20"),
        ({"orders": (-1,)}, "order = -1 must be 0 to 20"),
        ({"degrees": (9,)}, "degree = 9 must be 0 to 8"),
        ({"measured": ()}, "0 structures"),
        ({"measured": [["nothing"]]}, "no signal 'nothing'"),
        ({"measured": [["x"], []]}, "measured is empty"),
    ],
)
def test_what_is_out_of_range_is_refused_before_any_work(plant, tables, message):
    if message is None:
        assert len(asked_of(plant, LEAST, LIMIT, **tables).structures) == 1
        return
    with pytest.raises(InputError, match=message):
        asked_of(plant, LEAST, LIMIT, **tables)


def test_degrees_of_one_gain_are_refused(plant):
    with pytest.raises(InputError, match="a law of one gain has no degree"):
        asked_of(plant, LEAST, LIMIT, structure=Structure(schedule=()), degrees=(0, 1))


def test_laws_of_a_pid_have_no_orders(plant):
    pid = Structure(("x",), kind="pid", derivative_bandwidth=5.0)
    with pytest.raises(InputError, match="a PID has a fixed order"):
        asked_of(plant, LEAST, LIMIT, structure=pid, orders=(0, 1))


def test_numbers_are_those_that_are_not_zero():
    assert numbers_of(FixedGain(np.array([[1.0, 0.0, 2.0]]))) == 2
    law = PolynomialGain(((1, 0), (0, 1)), np.array([[[1.0, 0.0]], [[0.0, 0.0]]]), (), ())
    assert numbers_of(law) == 1


def test_a_gain_is_compared_too_without_a_limit_of_all_laws(plant):
    with hasty():
        table = structures(plant, Gain("x"), LIMIT, structure=Structure(("v",)), degrees=(0, 1))
    assert table.limit_of_any_law is None
    assert table.rows[1]["level"] <= table.rows[0]["level"]
