"""Tables of gains: interpolation, cells, answers against poles in floats, files, figures, page."""

import doctest
import importlib.util
import json
import re
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from polefence import (
    Disk,
    GainTable,
    HalfPlane,
    InputError,
    NotProvedError,
    Parameter,
    Sector,
    UncertainPlant,
    analyse,
    progress,
)
from polefence.base.errors import ParameterValueError
from polefence.certify.table import TableAnalysis, _exact_table
from polefence.cli.main import main
from polefence.examples import family
from polefence.law.laws import table_from
from polefence.plant.points import values_text
from polefence.show.plots import analysis_figure, render, table_figure
from support.commands import ran, refused
from support.console import blocks, follow
from support.files import rewritten
from support.paths import DOCS


def springs(masses=("1", "4"), through="1/m"):
    """A mass on a spring that varies: m x'' = -k x + u."""
    mass = Parameter("m", *masses, "kg", through)
    k = Parameter("k", -1, 3, "N/m")
    sign = "" if float(masses[0]) > 0 else "-"
    return UncertainPlant.from_expressions(
        [mass, k], [[0, 1], [f"-k/({sign}m)", 0]], [[0], [f"1/({sign}m)"]], name="spring"
    )


def table(plant, knots=(3, 3), seed=0):
    """Gains that would suit the knots, scattered."""
    random = np.random.default_rng(seed)
    grid = {
        p.name: np.linspace(float(p.low), float(p.high), count)
        for p, count in zip(plant.parameters, knots, strict=True)
    }
    m, k = np.meshgrid(*grid.values(), indexing="ij")
    gains = np.stack([-(4 * abs(m) - k), -(4 * abs(m))], axis=-1)[..., None, :]
    return GainTable(plant.parameters, grid, gains * random.uniform(0.9, 1.1, gains.shape))


def loops(plant, gains, points):
    """Closed loops from the physical parameters, by the public functions alone."""
    names = [p.name for p in plant.parameters]
    found = []
    for point in points:
        values = dict(zip(names, map(float, point), strict=True))
        A, B = plant.at(plant.alpha(**values))
        found.append(A + B @ gains.gain_at(**values))
    return np.array(found)


def test_interpolation_is_linear_between_knots_and_exact():
    plant = springs()
    gains = table(plant, (3, 4))
    exactly = _exact_table(plant, gains)
    names = [p.name for p in plant.parameters]
    for i, m in enumerate(gains.axes[0]):
        for j, k in enumerate(gains.axes[1]):
            assert np.allclose(gains.gain_at(m=m, k=k), gains.gains[i, j], rtol=1e-14)
    random = np.random.default_rng(1)
    points = np.stack([random.uniform(1, 4, 50), random.uniform(-1, 3, 50)], axis=1)
    K = gains.at(points)
    for point, found in zip(points, K, strict=True):
        p = tuple(Fraction(float(v)) for v in point)
        assert np.allclose(found, np.array(exactly.gain(p), dtype=float), rtol=1e-13)
        values = dict(zip(names, point, strict=True))
        A, B = plant.at(plant.alpha(**values))
        assert np.allclose(np.array(exactly.loop(p), dtype=float), A + B @ found, rtol=1e-12)
    # halfway along a row of knots: the mean
    middle = gains.gain_at(m=1.75, k=float(gains.axes[1][2]))
    assert np.allclose(middle, gains.gains[:2, 2].mean(axis=0))
    with pytest.raises(ParameterValueError, match="outside"):
        gains.gain_at(m=5, k=0)
    assert np.array_equal(gains.gain_at(m=5, k=0, clamp=True), gains.gain_at(m=4, k=0))
    with pytest.raises(ParameterValueError, match="every parameter: m, k"):
        gains.gain_at(m=2)


@pytest.mark.parametrize("masses", [("1", "4"), ("-4", "-1")])
@pytest.mark.parametrize("region", [HalfPlane(0.9), HalfPlane(1.7) & Sector(0.9), Disk(-2, 1.2)])
def test_answers_agree_with_poles(masses, region):
    """Weights |p| of parameters through 1/p, on both sides of zero."""
    plant = springs(masses)
    gains = table(plant)
    found = analyse(plant, gains, region, depth=3)
    assert isinstance(found, TableAnalysis)
    random = np.random.default_rng(2)
    for cell in found.cells:
        low, high = (np.array(side, dtype=float) for side in (cell.low, cell.high))
        if cell.answer == "proved":
            corners = np.array(list(product(*zip(low, high, strict=True))))
            points = np.vstack([corners, random.uniform(low, high, (20, 2))])
            assert region.contains(np.linalg.eigvals(loops(plant, gains, points)))
        elif cell.answer == "refuted":
            z = np.linalg.eigvals(loops(plant, gains, [cell.point]))
            assert region.distance(z).max() >= -1e-9
            assert all(a <= p <= b for a, p, b in zip(cell.low, cell.point, cell.high, strict=True))
    tiles(plant, gains, found.cells)
    assert found.shares["undecided"] < 0.02
    worst = [
        region.distance(np.linalg.eigvals(loops(plant, gains, [list(v.values())]))).max()
        for v in found.counterexamples
    ]
    assert worst == sorted(worst, reverse=True)
    assert found.answer == ("proved" if found.proved else "refuted")


def tiles(plant, gains, cells):
    """Volumes add up, no two cells overlap, none reaches across a knot: exactly."""
    whole = 1
    for p in plant.parameters:
        whole *= p.high - p.low
    assert sum(cell.volume for cell in cells) == whole
    for i, one in enumerate(cells):
        for p, a, b in zip(plant.parameters, one.low, one.high, strict=True):
            assert p.low <= a < b <= p.high
            assert not any(a < knot < b for knot in gains.grid[p.name])
        for other in cells[:i]:
            sides = zip(one.low, one.high, other.low, other.high, strict=True)
            assert any(max(a, c) >= min(b, d) for a, b, c, d in sides)


def test_no_halving_and_no_time_leave_the_knots_cells():
    plant = springs()
    gains = table(plant)
    region = HalfPlane(1.75) & Sector(0.9)
    flat = analyse(plant, gains, region, depth=0)
    assert len(flat.cells) == 4
    hurried = analyse(plant, gains, region, budget=0)
    assert [c.answer for c in hurried.cells] == [c.answer for c in flat.cells]
    deep = analyse(plant, gains, region, depth=3)
    assert deep.shares["proved"] >= flat.shares["proved"]
    assert len(deep.cells) > 4


def test_more_than_two_parameters_and_knots_beyond_the_range():
    a, b, c = (Parameter(name, 1, 2, through=f"1/{name}") for name in "abc")
    plant = UncertainPlant.from_expressions([a, b, c], [["1/(a*b)"]], [["1/c"]])
    grid = {"a": [0.5, 1.5, 3], "b": [1, 2], "c": [1, 2]}
    gains = -4 * np.ones((3, 2, 2, 1, 1))
    found = analyse(plant, GainTable(plant.parameters, grid, gains), HalfPlane(0.9))
    assert found.proved  # 1/(a b) - 4/c <= -1
    assert len(found.cells) == 2
    assert (
        analyse(plant, GainTable(plant.parameters, grid, gains), HalfPlane(1)).answer == "refuted"
    )
    with pytest.raises(InputError, match="a map shows one or two parameters; plant has 3"):
        table_figure(found)


def test_discrete_time_tables():
    p = Parameter("p", 0.5, 1.5)
    plant = UncertainPlant.from_expressions([p], [["p"]], [[1]], sample_time=1)
    gains = GainTable(plant.parameters, {"p": [0.5, 1.5]}, [[[-0.4]], [[-1.4]]])
    assert analyse(plant, gains, Disk(0.1, 0.001)).proved  # K = 0.1 - p
    assert analyse(plant, gains, Disk(0, 0.09)).answer == "refuted"
    assert analyse(plant, gains, HalfPlane(2)).proved  # exp(-2) is 0.135
    assert analyse(plant, gains, HalfPlane(2.4)).answer == "refuted"  # exp(-2.4) is 0.09
    with pytest.raises(InputError, match="is in discrete time: half_plane"):
        analyse(plant, gains, HalfPlane(-1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": [1, 4]}, "unknown parameter 'mass'; did you mean|unknown parameter 'mass'"),
        ({"k": None}, "the knots of k are missing"),
        ({"m": [1, 3, 2, 4]}, "knots of m must rise"),
        ({"m": [1, 2, 2, 4]}, "knots of m must rise"),
        ({"m": [1.5, 4]}, r"knots of m must cover \[1, 4\]"),
        ({"m": [1, 3.5]}, "must cover"),
        ({"m": [2]}, "1 given; use 2 to 200"),
        ({"m": list(np.linspace(1, 4, 201))}, "201 given"),
        ({"m": "14"}, "must be a list of numbers"),
        ({"m": 4}, "must be a list of numbers"),
        ({"m": [1, "four"]}, "is not a number"),
        ({"m": [1, float("nan")]}, "must be a finite number"),
        ({"m": [1, 2, 3, 4]}, r"shape \(3, 3, 1, 2\); the grid needs \(4, 3\)"),
        ({"gains": np.ones((3, 3, 2))}, "the grid needs"),
        ({"gains": [[1], [1, 2]]}, "all of one shape"),
        ({"gains": np.full((3, 3, 1, 2), np.nan)}, "gains must be finite"),
        ({"gains": np.full((3, 3, 1, 2), 1e101)}, "gains must be finite"),
        ({"gains": "none"}, "gains must be nested lists"),
    ],
)
def test_tables_that_do_not_fit(change, message):
    plant = springs()
    grid = {p.name: np.linspace(float(p.low), float(p.high), 3) for p in plant.parameters}
    gains = change.pop("gains", np.ones((3, 3, 1, 2)))
    grid = {k: v for k, v in (grid | change).items() if v is not None}
    with pytest.raises(InputError, match=message) as no:
        GainTable(plant.parameters, grid, gains)
    assert "\n" not in str(no.value)


def test_questions_that_do_not_fit(physical):
    plant = springs()
    gains = table(plant)
    wide = GainTable(plant.parameters, gains.grid, np.ones((3, 3, 2, 2)))
    fine = {"m": np.linspace(1, 4, 60), "k": np.linspace(-1, 3, 60)}
    many = GainTable(plant.parameters, fine, np.ones((60, 60, 1, 2)))
    for call, message in (
        (lambda: analyse(physical, gains, HalfPlane(1)), "not those of quarter car, physical"),
        (lambda: analyse(plant, wide, HalfPlane(1)), "gains are 2 x 2; spring needs 1 x 2"),
        (lambda: analyse(plant, many, HalfPlane(1)), "3481 cells; at most 2000"),
        (lambda: analyse("car", gains, HalfPlane(1)), "must be of type UncertainPlant"),
        (lambda: analyse(plant, gains, 4), "must be of type Region"),
        (lambda: GainTable((), {}, [[1]]), "needs a plant with parameters"),
        (lambda: table_from(plant.parameters, [[1]]), "a table of gains is"),
        (lambda: table_from(plant.parameters, {"grid": [], "gains": []}), "grid must name"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_a_saved_analysis_is_checked_and_loaded(tmp_path, capsys):
    plant = springs()
    found = analyse(plant, table(plant), HalfPlane(1.7) & Sector(0.9), depth=2)
    assert 0 < found.shares["proved"] < 1
    path = found.save(tmp_path / "spring")
    again = TableAnalysis.load(tmp_path / "spring")
    assert again.cells == found.cells
    assert again.region == found.region
    assert np.array_equal(again.table.gains, found.table.gains)
    assert again.summary == found.summary
    assert found.summary in ran(capsys, "check", path, "--json", tmp_path / "a.json", status=1)
    assert json.loads((tmp_path / "a.json").read_text())["answer"] == "refuted"
    spec = '[parameter.m]\nrange = [1, {}]\nunit = "kg"\nthrough = "1/m"\n'
    spec += '[parameter.k]\nrange = [-1, 3]\nunit = "N/m"\n'
    spec += '[matrices]\nA = [[0, 1], ["-k/m", 0]]\nB = [[0], ["1/m"]]\n'
    proved = analyse(plant, table(plant), HalfPlane(0.5))
    assert proved.proved
    proved.save(tmp_path)
    for high, status in ((4, 0), (5, 1)):
        (tmp_path / "spec.toml").write_text(spec.format(high))
        assert main(["check", str(tmp_path), "--spec", str(tmp_path / "spec.toml")]) == status
        assert ("but NOT about" in capsys.readouterr().out) is bool(status)
    text = path.read_text().replace('"undecided"', '"proved"').replace('"refuted"', '"undecided"')
    path.write_text(text)
    assert "unknown key" in refused(capsys, "check", path)
    with rewritten(tmp_path / "table.json") as document:
        document["claims"][0]["cells"][0]["parts"][0]["X"][0][0][0] *= -1
    assert "undecided: cell 1: inequality" in ran(capsys, "check", tmp_path, status=1)
    with pytest.raises(NotProvedError, match="not proved: cell 1"):
        TableAnalysis.load(tmp_path)


def test_the_command_analyses_a_table(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spec = '[parameter.m]\nrange = [1, 4]\nunit = "kg"\nthrough = "1/m"\n'
    spec += "[parameter.k]\nrange = [-1, 3]\n"
    spec += '[matrices]\nA = [[0, 1], ["-k/m", 0]]\nB = [[0], ["1/m"]]\n'
    (tmp_path / "spring.toml").write_text(spec)
    gains = table(springs())
    grid = {name: [float(v) for v in knots] for name, knots in gains.grid.items()}
    (tmp_path / "gains.json").write_text(json.dumps({"grid": grid, "gains": gains.gains.tolist()}))
    command = ["analyse", "spring.toml", "--gain", "gains.json", "--depth", "2"]
    command += ["--region", "half_plane(1.7) & sector(0.9)"]
    results = ["-o", "out", "--json", "answer.json", "--plot", "map.svg"]
    assert main([*command, *results]) == 1
    out, err = capsys.readouterr()
    assert not err
    answer = json.loads((tmp_path / "answer.json").read_text())
    found = TableAnalysis.load(tmp_path / "out")
    assert f"refuted: {found.summary}" in out
    assert answer["shares"] == found.shares
    assert (answer["answer"], answer["cells"]) == ("refuted", len(found.cells))
    worst = answer["counterexamples"][0]
    assert f"at m = {worst['m']:.6g} kg, k = {worst['k']:.6g}\n" in out
    assert "more cells" in out
    assert "<svg" in (tmp_path / "map.svg").read_text()
    told = list[str]()
    with progress(told.append):
        assert main(command) == 1
    assert told[-1] == ""
    assert [text for text in told if text][-1].endswith("cells, 100 % of the box")
    assert not capsys.readouterr().err
    assert main(["analyse", "spring.toml", "--gain", "gains.json", "--of", "sector"]) == 2
    assert "analyse a table with --region" in capsys.readouterr().err
    grid["mass"] = grid.pop("m")
    (tmp_path / "gains.json").write_text(json.dumps({"grid": grid, "gains": [[1]]}))
    assert "gains.json: grid: unknown parameter 'mass'" in refused(capsys, *command)


def test_figures_have_their_axes_and_legend():
    plant = springs()
    found = analyse(plant, table(plant), HalfPlane(1.7) & Sector(0.9), depth=2)
    figure = table_figure(found)
    (ax,) = figure.axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("m [kg]", "k [N/m]")
    (legend,) = figure.legends
    words = " ".join(text.get_text() for text in legend.get_texts())
    for word in ("proved", "refuted", "counterexamples", "knots", "boundary"):
        assert word in words
    assert len(ax.patches) == len(found.cells)
    assert render(figure, "png").startswith(b"\x89PNG")
    one = UncertainPlant.from_expressions([Parameter("p", 1, 2)], [["p"]], [[1]])
    flat = analyse(one, GainTable(one.parameters, {"p": [1, 2]}, [[[-2]], [[-4]]]), HalfPlane(1.5))
    assert flat.answer == "refuted"
    (ax,) = table_figure(flat).axes
    assert (ax.get_xlabel(), list(ax.get_yticks())) == ("p", [])
    refuted = analyse(one, [[-4]], HalfPlane(2.5))
    (ax,) = analysis_figure(refuted).axes
    assert f"crosses: poles at {values_text(one, refuted.values)}" in ax.get_title()
    (ax,) = analysis_figure(analyse(one, [[-4]], HalfPlane(1.5))).axes
    assert ax.get_title() == "plant"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("analysis", DOCS / "examples" / "analysis.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


def test_the_page_says_what_the_example_does(example, tmp_path, capsys, monkeypatch):
    page = (DOCS / "analysis.md").read_text()
    plain = re.sub(r"\s+", " ", page.replace("−", "-"))
    whole, part = example.tables()
    monkeypatch.setattr(example, "tables", lambda: (whole, part))
    example.main(tmp_path)
    out = capsys.readouterr().out
    for name in ("table", "f4e"):
        picture = (tmp_path / f"analysis-{name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert len(picture) > 20_000
        assert f"images/analysis-{name}.png" in page
    assert whole.proved
    assert f"{part.region}: {part.summary}" in page
    assert part.shares["proved"] == pytest.approx(0.59, abs=0.01)
    assert part.shares["refuted"] == pytest.approx(0.41, abs=0.01)
    rows = [line for line in out.splitlines() if line.startswith("Mach")]
    for line in rows:
        name, rest = line.split(": K = [[")
        gain = ", ".join(f"{float(k):.4f}" for k in rest.split("]]")[0].split(","))
        decay, damping = re.findall(r"'([^']+)'", rest.split("proved")[1])[:2]
        sampled = re.findall(r"'([^']+)'", rest.split("sampled")[1])
        last = "unstable" if damping == "none" else sampled[1]
        assert f"| {name} | {gain} | {decay} | {sampled[0]} | {damping} | {last} |" in plain
    assert "the pole is $-108.856" in plain
    # on the right the decay rate fails and the damping does not, along the lower edge the converse
    for point, region, other in (
        ([340, 0], *part.region.parts),
        ([250, -10], *reversed(part.region.parts)),
    ):
        z = part.poles(np.array([point]))
        assert not region.contains(z)
        assert other.contains(z)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_pages_python_and_commands_do_what_they_show(example, tmp_path, capsys, monkeypatch):
    page = DOCS / "analysis.md"
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    result = doctest.testfile(str(page), module_relative=False, optionflags=flags)
    assert result.attempted >= 5
    assert result.failed == 0
    car = family("quarter-car-physical")
    gains = analyse(car, example.table(car), HalfPlane(0), depth=0)
    (tmp_path / "car-gains.json").write_text(example.plain(gains))
    for block in blocks(page.read_text()):
        follow(block, tmp_path, monkeypatch, capsys)


def test_the_gains_of_a_table_may_be_called_K(tmp_path):
    """It is a table all the same, and no law of the vertices: between knots it is interpolated."""
    from polefence.cli.given import read_gain

    parameter = Parameter("k", 1, 3)
    plant = UncertainPlant.from_expressions([parameter], [[0, 1], ["-k", 0]], [[0], [1]])
    grid, gains = {"k": [1, 2, 3]}, [[[-9, -6]], [[-4, -6]], [[-8, -6]]]
    for key in ("gains", "K"):
        (tmp_path / f"{key}.json").write_text(json.dumps({"grid": grid, key: gains}))
    one, other = (read_gain(plant, str(tmp_path / f"{key}.json")) for key in ("gains", "K"))
    assert isinstance(other, GainTable)
    assert np.array_equal(one.gains, other.gains)
    (tmp_path / "both.json").write_text(json.dumps({"grid": grid, "K": gains, "gains": gains}))
    with pytest.raises(InputError, match="a table of gains is"):
        read_gain(plant, str(tmp_path / "both.json"))
