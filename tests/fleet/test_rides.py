"""Questions about rides, of every method, and of several values: what they ask, and their rows."""

import pytest

import polefence
from polefence import METHODS, limits
from polefence.cli.main import main
from polefence.examples import spec_text
from polefence.fleet import Store, Study, load_study, processes
from polefence.fleet.questions import MOST, Ride, Tightest, read_questions
from polefence.plant.spec import loads
from polefence.vehicle.compare import QUANTITIES, compare, standard_laws
from support.commands import ran, refused
from support.paths import DOCS

pytest.importorskip("pyarrow")

STUDY = """
base = "car.toml"
[variants]
grid = {m2 = [24, 32]}
[[question]]
ask = "compare"
law = ["passive", "quadratic"]
quantity = "suspension travel"
road = "D"
disk = [-40, 37]
[[question]]
ask = "limits"
centre = -40
[[question]]
name = "ours"
ask = "design"
region = ["disk(-40, 34)", "disk(-40, 3)"]
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rides")
    (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def results(written):
    """Rows by question and variant, from Python."""
    out = written.parent / "out"
    rows = list(polefence.study(written, out, workers=processes(1)))
    return out, {(row["question"], row["variant"]): row for row in rows}


def test_a_list_asks_one_question_for_each_value(written):
    study = load_study(written)
    assert [own.name for own in study.questions] == [
        "compare passive",
        "compare quadratic",
        *(f"limits {method}" for method in METHODS),
        "ours disk(-40, 34)",
        "ours disk(-40, 3)",
    ]
    assert study.questions[3] == Tightest("limits slack", method="slack", centre=-40.0)


def test_a_study_is_read_back_from_what_is_written_of_it(written):
    study = load_study(written)
    again = Study.of(study.document())
    assert again.questions == study.questions
    assert again.digest == study.digest
    assert [again.spec(k) for k in range(2)] == [study.spec(k) for k in range(2)]


def test_two_lists_ask_all_pairs():
    table = {"ask": "tightest", "centre": [-40, -60], "method": ["quadratic", "slack"]}
    names = [own.name for own in read_questions([table])]
    assert names == [f"tightest {c} {m}" for c in (-40, -60) for m in ("quadratic", "slack")]


def test_limits_are_those_of_each_method(written, results):
    for k in range(2):
        plant = loads(load_study(written).spec(k))
        for one in limits(plant, -40):
            row = results[1][f"limits {one.method}", k]
            assert row["bound"] == pytest.approx(one.radius, rel=1e-6)
            assert row["status"] == "proved"


def test_rides_are_those_of_the_comparison(written, results):
    for k in range(2):
        plant = loads(load_study(written).spec(k))
        laws = standard_laws(plant, (-40, 37), ("passive", "quadratic"))
        for own in compare(plant, laws, "D", 20.0).rows:
            if own.quantity == "suspension travel":
                row = results[1][f"compare {own.law}", k]
                assert (row["worst"], row["unit"]) == (own.worst, "m")
                assert (row["status"], row["bound"], row["proof"]) == ("sampled", None, "")
                assert row["claim"] == ""
                assert "nothing is proved" in row["reason"]


def test_sampled_rows_are_said_to_be_that(results, capsys, tmp_path):
    out, rows = results
    page = tmp_path / "page.html"
    assert main(["study", str(out), "--html", str(page)]) == 1  # a disk that is too small
    said = capsys.readouterr().out
    worst = [rows["compare passive", k]["worst"] for k in range(2)]
    assert f"compare passive: 2 sampled; {polefence.region.text.digits_up(min(worst))} to" in said
    assert "compare" not in said.split("ours disk(-40, 3): ")[1]  # among what is not proved
    html = page.read_text()
    assert "Worst samples (not proved)" in html
    assert html.count("<td>2 sampled</td>") == 2
    head, first, *_ = ran(capsys, "study", out, "--best", "compare passive").splitlines()
    assert "sample" in head
    assert "bound" not in head
    assert int(first.split()[0]) == worst.index(min(worst))
    assert main(["study", str(out), "--check", "--jobs", "1"]) == 0


def test_a_law_that_has_no_proof_does_not_ride(written):
    (answer,) = Ride("r", law="quadratic", disk=(-40.0, 3.0)).answers([load_study(written).spec(0)])
    assert answer.status == "not proved"
    assert answer.worst is None


def test_rides_without_failures_end_well(written, capsys):
    text = STUDY.split("[[question]]")
    path = written.with_name("rides.toml")
    path.write_text("[[question]]".join(text[:2]))
    out = written.with_name("alone")
    assert "compare quadratic: 2 sampled" in ran(capsys, "study", path, "-o", out, "--jobs", "1")
    assert {row["status"] for row in Store(out).rows()} == {"sampled"}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('law = ["passive", "quadratic"]', "law = []", "question 1: law = [] is empty"),
        (
            'law = ["passive", "quadratic"]',
            'law = "lqg"',
            "law = 'lqg' is unknown; did you mean 'lqr'",
        ),
        ("suspension travel", "travel", "quantity = 'travel' is unknown"),
        ('road = "D"', 'road = "Z"', "question 1: "),
        ('road = "D"', "speed = 0", "question 1: "),
        ("[-40, 37]", "35", "disk = 35 must be [CENTRE, RADIUS]"),
        ("[-40, 37]", "[40, 35]", "question 1: "),
        ("centre = -40", "centre = []", "question 2: centre = [] is empty"),
        ("centre = -40", "", "centre is missing"),
        ('ask = "limits"', 'ask = "limit"', "did you mean 'limits'"),
        ("centre = -40", f"centre = {[-k for k in range(1, MOST + 2)]}", f"more than {MOST}"),
        ("disk(-40, 3)", "disk(-40, 34)", "two questions are called 'ours disk(-40, 34)'"),
    ],
)
def test_bad_questions_are_one_line(old, new, said, written, tmp_path, capsys):
    assert old in STUDY
    path = written.with_name("bad.toml")
    path.write_text(STUDY.replace(old, new, 1))
    assert said in refused(capsys, "study", str(path), "-o", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_every_quantity_has_its_unit(written):
    spec = load_study(written).spec(0)
    for name, unit in QUANTITIES:
        (answer,) = Ride("r", law="skyhook", quantity=name).answers([spec])
        assert (answer.status, answer.unit) == ("sampled", unit)


def test_the_page_shows_the_example(capsys):
    page = (DOCS / "fleet.md").read_text()
    assert f"```toml\n{spec_text('fleet')}```" in page
    assert ran(capsys, "example", "fleet") == spec_text("fleet")
    assert "\nfleet  " in ran(capsys, "example")
