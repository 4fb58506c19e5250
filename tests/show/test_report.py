"""Reports: what they say is what was computed, and they ask nothing of the world outside."""

import html
import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser

import numpy as np
import pytest

from polefence import (
    Design,
    Disk,
    Gain,
    HalfPlane,
    InputError,
    NotProvedError,
    Rms,
    UncertainPlant,
    analyse,
    optimise,
    place,
)
from polefence.base import VERSION
from polefence.certify.design import proved_design
from polefence.cli.main import main
from polefence.cli.report import today
from polefence.examples import family
from polefence.plant.outputs import states
from polefence.response import family_points, margins, opened, places
from polefence.response.linear import step
from polefence.response.stationary import stationary, velocity_density, velocity_psd
from polefence.show import report
from polefence.show.loops import margins_row
from polefence.show.report import Report, _drawn, _how_to_check, comfort, html_report
from polefence.vehicle.vehicle import require_ride
from support.commands import refused
from support.files import rewritten
from support.memories import design as with_memory
from support.polynomials import design as polynomial
from support.questions import ROWS, commands_of, run_as_written
from support.specs import ONE_STATE


class Page(HTMLParser):
    """Tags with their attributes, and the text by heading."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.parts, self.current = [], {}, ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.heading = tag == "h2"

    def handle_data(self, data):
        if getattr(self, "heading", False) and data.strip():
            self.current, self.heading = data.strip(), False
        self.parts[self.current] = self.parts.get(self.current, "") + data + "|"


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    """A folder with a design, and the page that the line of "What it does" writes of it."""
    folder = tmp_path_factory.mktemp("questions")
    design = place(family("quarter-car-physical"), Disk(-40, 31))
    design.save(folder / "car")
    (row,) = [row for row in ROWS if "polefence report" in row]
    with pytest.MonkeyPatch.context() as own:
        own.setenv("SOURCE_DATE_EPOCH", "1")
        own.chdir(folder)
        run_as_written(commands_of(row))
    return folder / "car", design, (folder / "car" / "report.html").read_text()


@pytest.fixture
def undrawn(monkeypatch):
    """Leave figures undrawn, which takes the most of a page's time."""
    monkeypatch.setattr("polefence.show.report.address", lambda _: "data:image/svg+xml;base64,")


@pytest.fixture
def claims_alone(undrawn, monkeypatch):
    """Leave out what is simulated and sampled too."""
    for name in ("responses", "comfort"):
        monkeypatch.setattr(f"polefence.show.report.{name}", lambda *_: None)
    monkeypatch.setattr("polefence.show.report.loops", lambda *_: [])


def test_all_that_was_asked_for_is_there(car):
    _, _, text = car
    page = Page(text)
    assert list(page.parts)[1:] == [
        "What is claimed, and proved",
        "The plant",
        "Closed-loop poles",
        "How far the methods go",
        "Responses",
        "Loops",
        "The loop at actuator force",
        "The loop at tyre deflection",
        "Comfort, grip and force on a road",
        "The gain",
        "Check it, use it",
    ]
    assert sum(tag == "img" for tag, _ in page.tags) == 5
    assert "proved: 20 inequalities" in page.parts["What is claimed, and proved"]
    assert "29.0755" in page.parts["How far the methods go"]


def test_margins_of_loops_are_those_of_the_design(car):
    _, design, text = car
    own = [cell for cell in Page(text).parts["Loops"].split("|") if cell.strip()]
    known = places(design.plant, design)
    assert len(known) == 6
    for here in known:
        found = margins(opened(design.plant, design, here.name, family_points(design.plant, 100)))
        row = own.index(f"{here.label}, {here.kind}".replace("m/s2", "m/s\u00b2"))
        assert own[row : row + 6] == list(margins_row(found))


def test_nothing_outside_is_asked_for(car):
    _, _, text = car
    for tag, attributes in Page(text).tags:
        assert tag not in ("link", "iframe", "object", "form")
        assert tag != "script" or "src" not in attributes
        for name, value in attributes.items():
            assert name not in ("href", "srcset", "action")
            assert name != "src" or value.startswith("data:image/svg+xml;base64,")
    style = text[text.index("<style>") : text.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style


def test_the_comfort_is_that_of_the_stationary_answer(car):
    _, design, text = car
    plant = design.plant
    known = require_ride(plant)
    cell = Page(text).parts["Comfort, grip and force on a road"].replace("\n", "")
    assert "rougher than without control for every car" in cell
    density = velocity_psd(256e-6, 20.0)
    corners = np.eye(4)
    for law in (None, design):
        own = stationary(plant, law, corners, density, [known.acceleration]).rms[:, 0]
        row = re.search(r"\|acceleration \[m/s²\]\|(.*?)tyre deflection", cell).group(1)
        cells = [cell for cell in row.split("|") if " to " in cell]
        best, worst = map(float, cells[0 if law is None else -1].split(" to "))
        assert best * (1 - 1e-2) <= own.min()
        assert own.max() <= worst * (1 + 1e-2)


def test_a_report_of_the_same_design_is_the_same(car):
    _, design, text = car
    assert html_report(design, date="1970-01-01") == text


def test_a_report_without_a_date_has_none(car, claims_alone):
    dated, plain = (html_report(car[1], date=date) for date in ("1970-01-01", ""))
    assert dated != plain == dated.replace(", 1970-01-01", "")


def test_the_top_says_what_is_proved_of_which_cars_and_when(car):
    top = Page(car[2]).parts[""]
    assert f"polefence {VERSION}, 1970-01-01" in top
    assert (
        "For every m1 (sprung mass) from 231.12 to 346.68 kg and beta (age) from -10 to 10 all "
        "closed-loop poles are in disk(-40, 31), so that the loop is stable." in top
    )
    assert "This is proved in exact arithmetic, not for samples alone; " in top


def test_the_table_says_what_the_parameters_are(car):
    rows = Page(car[2]).parts["The plant"]
    assert "|m1|sprung mass|231.12 to 346.68|kg|1/m1|" in rows.replace("\n", "").replace("||", "|")


def test_the_date_is_todays(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(86400 * 366))
    assert today() == "1971-01-02"
    for text in ("soon", "²", "9" * 30):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", text)
        with pytest.raises(InputError, match="give seconds since 1970"):
            today()
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    before = datetime.now(UTC).date().isoformat()
    assert before <= today() <= datetime.now(UTC).date().isoformat()


def test_a_notebook_shows_the_page_in_a_frame(car):
    shown = Report(car[2])._repr_html_()
    assert shown.startswith("<iframe ")
    inner = re.search('srcdoc="([^"]*)"', shown)[1]
    assert html.unescape(inner) == car[2]
    assert "<" not in inner


def test_names_are_text_not_markup():
    hostile = '<script>alert("1")</script>'
    plant = UncertainPlant.from_vertices(
        [[[0, 1], [-2, -1]], [[0, 1], [-3, -1]]],
        [[[0], [1]]] * 2,
        name=hostile,
        states=(hostile, "b & c"),
        inputs=("<b>",),
    )
    text = html_report(place(plant, Disk(-3, 2), "quadratic"))
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "<b>" not in text


def test_other_plants_have_what_there_is_of_them():
    """No disturbance: a step at the input. No disk, or discrete time: no limits."""
    As, Bs = [[[0, 1], [-2, -1]], [[0, 1], [-3, -1]]], [[[0], [1]]] * 2
    found = Page(html_report(place(UncertainPlant.from_vertices(As, Bs), HalfPlane(1))))
    assert "unit step of u1" in found.parts["Responses"]
    assert "How far the methods go" not in found.parts
    sampled = UncertainPlant.from_vertices(
        [[[1, 0.1], [0, 1]], [[1, 0.1], [0, 0.9]]], [[[0], [1]]] * 2, sample_time="1/10"
    )
    found = Page(html_report(place(sampled, Disk(0.5, 0.4), "quadratic")))
    assert "unit step of u1" in found.parts["Responses"]
    assert "How far the methods go" not in found.parts
    assert "Comfort, grip and force on a road" not in found.parts


def test_a_region_that_implies_no_stability_has_no_comfort():
    design = analyse(family("quarter-car-physical"), [[0, 0, 1000, 0, 0]], Disk(-1, 400)).design
    found = comfort(design, "C", 20.0)
    assert found.title == "Comfort, grip and force on a road"
    assert "Nothing can be said of this design" in found.text[0]


def test_bad_input(car, tmp_path, capsys):
    folder, _, _ = car
    cases = [
        (["--speed", "0"], "speed"),
        (["--road", "Z"], "class"),
        (["-o", str(tmp_path / "page.pdf")], "ends in .html"),
    ]
    for words, named in cases:
        error = refused(capsys, "report", folder, *words)
        assert named in error
    assert main(["report", str(tmp_path)]) == 2
    document = json.loads((folder / "design.json").read_text())
    document["claims"][0]["region"]["radius"] = 28.0
    (tmp_path / "design.json").write_text(json.dumps(document))
    assert main(["report", str(tmp_path)]) == 1
    assert not (tmp_path / "report.html").exists()
    unproved = Design.load(tmp_path, allow_unproved=True)
    with pytest.raises(NotProvedError, match="no report"):
        html_report(unproved)


def test_bounds_and_a_front_are_put_in(tmp_path, capsys):
    spec, folder = tmp_path / "car.toml", tmp_path / "law"
    table = '[[specification]]\nkind = "rms"\nsignal = "{}"\ndensity = 2\n{}\n'
    least, limit = table.format("x", "minimise = true"), table.format("force", "at_most = 3")
    spec.write_text(ONE_STATE + least + limit)
    assert main(["optimise", str(spec), "--method", "quadratic", "-o", str(folder)]) == 0
    picture = tmp_path / "front.svg"
    picture.write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    assert main(["report", str(folder), "--front", str(picture)]) == 0
    page = Page((folder / "report.html").read_text())
    own = cells(page)
    assert any("rms of 'force' = u1 <= 3" in cell for cell in own)
    place = own.index("rms of 'force'")  # this is no car, and has no road
    assert own[place + 1 : place + 3] == ["at most 3 N", "at density 2"]
    assert "191 mm at density 2; without control the plant is not stable." in page.parts[""]
    top = [cell.strip() for cell in page.parts[""].split("|") if cell.strip()]
    place = top.index("rms of force")
    assert top[place + 1 : place + 4] == ["at most 3 N", "3", "0"]  # sampled, without control
    assert top[top.index("rms of x") + 3] == "unstable"
    assert sum(tag == "img" for tag, _ in page.tags) == 5
    assert main(["report", str(folder), "--front", str(spec)]) == 2
    with rewritten(folder / "design.json") as document:
        document["claims"][-1]["level"] = 1.0  # newton, of 3
    capsys.readouterr()
    assert "undecided" in refused(capsys, "report", folder, status=1)


@pytest.mark.parametrize("kind", ["affine", "measured"])
def test_a_polynomial_law_is_said_by_its_terms(kind, tmp_path, undrawn):
    own = polynomial(kind)
    own.save(tmp_path)
    assert main(["report", str(tmp_path)]) == 0
    page = Page((tmp_path / "report.html").read_text())
    claim, gain = page.parts["What is claimed, and proved"], page.parts["The gain"]
    assert own.law.formula in claim
    assert own.law.formula in gain
    for line in own.law.definitions:
        assert line in gain
    for K in own.law.gains + 0.0:  # no -0
        assert all(f"|{k:.6g}|" in gain for k in K[0])
    assert ("tyre deflection" in gain) is (kind == "affine")


@pytest.mark.parametrize("kind", ["affine", "pid"])
def test_code_that_keeps_states_is_exported_with_a_sample_time(kind, placed):
    line = "polefence export design.json --float 32 --sample-time"
    assert line in _how_to_check(with_memory(kind)).code
    assert line not in _how_to_check(placed).code


def test_bounds_have_their_units_and_the_road_that_is_theirs(tmp_path, claims_alone, hasty):
    car, gust = family("quarter-car-ride"), Rms("sprung-mass acceleration", at_most=2)
    road = velocity_density("D", 15)
    found = optimise(
        car,
        None,
        [replace(gust, density=road), Gain("tyre deflection", at_most=1)],
        method="quadratic",
    )
    found.save(tmp_path)
    _, proved = proved_design(tmp_path)
    for speed, said in ((15.0, "on a road of class D at 15 m/s"), (16.0, "at density ")):
        own = Page(html_report(found.design, "D", speed, proved))
        shown = cells(own)
        rms = shown.index("rms of 'sprung-mass acceleration'")
        gain = shown.index("gain of 'tyre deflection'")
        assert re.fullmatch(r"at most [\d.]+ m/s²", shown[rms + 1])
        assert shown[rms + 2].startswith(said)
        assert f"m/s\u00b2 {shown[rms + 2]}: " in own.parts[""]
        assert re.fullmatch(r"at most [\d.]+ m per m/s", shown[gain + 1])


def cells(page):
    return [own for own in page.parts["Bounds on signals, proved"].split("|") if own.strip()]


def test_a_proved_disk_margin_is_said_beside_its_loop(tmp_path, undrawn, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "polefence.show.report.loop_figure", lambda found, *proved: drawn.append((found, *proved))
    )
    spec = tmp_path / "plant.toml"
    table = '[[specification]]\nkind = "rms"\nsignal = "x"\ndensity = 2\nminimise = true\n'
    table += '[[specification]]\nkind = "disk margin"\nloops = "force"\nat_least = 1.5\n'
    table += '[[specification]]\nkind = "rms"\nsignal = "force"\ndensity = 2\nat_most = 3\n'
    spec.write_text(ONE_STATE + table)
    folder = tmp_path / "law"
    assert main(["optimise", str(spec), "--method", "quadratic", "-o", str(folder)]) == 0
    assert main(["report", str(folder)]) == 0
    text = Page((folder / "report.html").read_text()).parts["Loops"]
    (found, proved), *others = drawn
    assert found.opened.place.name == "force"
    assert proved == pytest.approx(1.5, rel=1e-3)
    assert found.least[-1].value >= proved
    assert f"{found.least[-1].value:.3g}; 1.5 proved" in text
    assert text.count("proved") == 2  # and that the others are not
    assert all(len(one) == 1 for one in others)


def test_unmodelled_dynamics_are_no_disk_and_no_disturbance_acts(tmp_path, undrawn, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "polefence.show.report.loop_figure", lambda found, *proved: drawn.append((found, *proved))
    )
    spec, folder = tmp_path / "plant.toml", tmp_path / "law"
    table = '[[specification]]\nkind = "rms"\nsignal = "x"\ndensity = 2\nat_most = 0.8\n'
    table += '[[specification]]\nkind = "unmodelled dynamics"\nloops = ["force"]\n'
    table += 'weight = "(s + 1)/(s + 9)"\nat_least = 0.5\n'
    spec.write_text(ONE_STATE + table)
    assert main(["optimise", str(spec), "-o", str(folder)]) == 0
    assert main(["report", str(folder)]) == 0
    page = Page((folder / "report.html").read_text())
    assert all(len(one) == 1 or one[1] is None for one in drawn)
    assert page.parts["Loops"].count("proved") == 1  # that nothing is
    shown = cells(page)
    row = next(k for k, cell in enumerate(shown) if cell.strip().startswith("unmodelled dynamics"))
    assert shown[row + 1].strip() == "at least 0.5"
    assert "from" not in page.parts[""].partition("unmodelled dynamics")[2].partition(".")[0]
    assert not shown[row + 2].strip().startswith("from")


def test_gain_and_phase_margins_are_among_what_is_proved(tmp_path, undrawn):
    spec, folder = tmp_path / "plant.toml", tmp_path / "law"
    spec.write_text(ONE_STATE)
    limits = ["--limit", "gain margin of force >= 3", "--limit", "phase margin of force >= 40"]
    words = ["verify", str(spec), "--gain", "[[-8]]", *limits, "-o", str(folder)]
    assert main(words) == 0
    assert main(["report", str(folder)]) == 0
    page = Page((folder / "report.html").read_text())
    shown = [cell.strip() for cell in cells(page)]
    for kind, unit in (("gain", ""), ("phase", " deg")):
        row = next(k for k, cell in enumerate(shown) if cell.startswith(f"{kind} margin"))
        said, least, number, *rest = shown[row + 1].split()
        assert (said, least) == ("at", "least")
        assert float(number) >= {"gain": 3, "phase": 40}[kind]
        assert "".join(rest) == unit.strip()
        assert f"{kind} margin of the loop at" in page.parts[""]


def test_measures_of_responses_have_their_words_units_and_edges(tmp_path, monkeypatch):
    spec, folder, drawn = tmp_path / "plant.toml", tmp_path / "law", []
    spec.write_text(ONE_STATE)
    limits = ["settling with band 0.05 <= 1", "peak <= 0.2", "overshoot <= 0.1"]
    words = [word for x in limits for word in ("--limit", f"step of x with measure {x}")]
    assert main(["verify", str(spec), "--gain", "[[-8]]", *words, "-o", str(folder)]) == 0
    draw = report.responses_figure
    monkeypatch.setattr(
        report, "responses_figure", lambda *a, edges: drawn.append(edges) or draw(*a, edges=edges)
    )
    assert main(["report", str(folder)]) == 0
    shown = " ".join(cell.strip() for cell in cells(Page((folder / "report.html").read_text())))
    assert re.search(
        r"settling time to within 0.05 of its final value of 'x' at most \S+ s ", shown
    )
    assert re.search(r"overshoot of 'x' at most \S+ ", shown)
    (edges,) = drawn
    (name,), ((t, low, high),) = edges.keys(), *edges.values()
    assert (name, t) == ("x", 0)
    assert -0.2 <= low == -high < -1 / 7.5  # the slowest one of 1 / (8 - a) at a = 0.5 to 2
    assert high <= 0.2


def test_errors_of_estimates_that_are_proved_are_no_bounds_on_signals(tmp_path, claims_alone):
    own = place(family("quarter-car-physical"), Disk(-40, 33), errors={"m1": 20})
    own.save(tmp_path)
    page = Page(html_report(own, bounds=proved_design(tmp_path)[1]))
    claims = page.parts["What is claimed, and proved"]
    assert "m1 wrong by up to 20 kg" in claims
    assert "Not in the claims: actuator limits, sampling, and changes of the parameters." in claims
    assert "Bounds on signals, proved" not in page.parts


def test_a_unit_that_is_a_sentence_is_left_out(tmp_path, claims_alone):
    plant = UncertainPlant.from_vertices(
        [[[-1]], [[-2]]], [[[1]]] * 2, [[[1]]] * 2, states=("x [m; all poles in half_plane(99)]",)
    )
    found = optimise(plant, None, [Rms("x", at_most=3)], method="quadratic")
    found.save(tmp_path)
    top = Page(html_report(found.design, bounds=proved_design(tmp_path)[1])).parts[""]
    assert "Rms of 'x' is at most 3 at density 1: 6 times that without control, 0.5." in top
    assert "99" not in top


def test_what_is_drawn_of_a_slow_loop_at_a_sample_time_is_a_thousand_samples():
    plant = UncertainPlant.from_vertices([[[1]]], [[[1]]], [[[1]]], sample_time=0.01)
    own = analyse(plant, [[-1e-4]], Disk(0, 1)).design
    duration, every = _drawn(own, [1.0], states(plant), None)
    assert duration == pytest.approx(10 / (-np.log(1 - 1e-4) / 0.01), rel=1e-2)
    assert every / 0.01 == pytest.approx(round(every / 0.01))
    assert 900 < len(step(plant, own, [1.0], None, None, duration, every).time) <= 1001
