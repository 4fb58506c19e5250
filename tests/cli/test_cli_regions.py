"""Regions, degrees and the tightest question from the command line."""

import json
import re

import numpy as np
import pytest

from polefence import Design, Disk, HalfPlane, Sector, check, load
from polefence.cli.main import main
from polefence.examples import spec_text
from support.commands import ran, refused
from support.files import rewritten

STAGE = """
name = "stage"
region = "half_plane(3) & sector(0.7) & disk(-10, 9.5)"
[parameter.m]
range = [2.0, 3.2]
through = "1/m"
[parameter.k]
range = [40, 60]
[matrices]
A = [[0, 1, 0], ["-k/m", "-6/m", "1/m"], [0, 0, -20]]
B = [[0], [0], [20]]
"""
CART = """
name = "cart"
sample_time = "1/20"
region = "disk(0.6, 0.3)"
[parameter.m]
range = [2, 3]
through = "1/m"
[matrices]
A = [[1, 0.05], [0, 1]]
B = [["0.00125/m"], ["0.05/m"]]
"""


@pytest.fixture
def stage(tmp_path):
    path = tmp_path / "stage.toml"
    path.write_text(STAGE)
    return str(path)


@pytest.fixture
def cart(tmp_path):
    path = tmp_path / "cart.toml"
    path.write_text(CART)
    return str(path)


def worst(design, measure):
    """The largest value of a measure of the poles over a grid of the box."""
    alpha = [
        design.plant.alpha(m=m, k=k) for m in np.linspace(2, 3.2, 9) for k in np.linspace(40, 60, 9)
    ]
    return measure(design.poles(np.array(alpha))).max()


@pytest.mark.parametrize("options", [[], ["--degree", "2", "--on", "box"], ["--method", "slack"]])
def test_design_takes_the_specs_region(stage, tmp_path, capsys, options):
    words = ["design", stage, "-o", str(tmp_path / "d"), "--json", str(tmp_path / "s.json")]
    plot = [] if options else ["--plot", str(tmp_path / "p.svg")]
    assert main([*words, *plot, *options]) == 0
    design = Design.load(tmp_path / "d")
    assert design.region == HalfPlane(3) & Sector(0.7) & Disk(-10, 9.5)
    assert worst(design, lambda z: z.real) < -3
    assert worst(design, lambda z: np.abs(z.imag) / -z.real) < np.sqrt(1 - 0.7**2) / 0.7
    assert worst(design, lambda z: np.abs(z + 10)) < 9.5
    summary = json.loads((tmp_path / "s.json").read_text())
    assert summary["region"]["kind"] == "intersection"
    assert summary["method"] == design.label
    out = capsys.readouterr().out
    assert f"proved: {design.label} keeps all poles of 'stage' in half_plane(3) &" in out
    assert "note:" not in out
    assert (tmp_path / "p.svg").exists() == (not options)


def test_an_option_stands_above_the_specs_region(stage, tmp_path):
    for words, region in (
        (["--disk", "-10", "8"], Disk(-10, 8)),
        (["--region", "Half-Plane(2) & disk(-10, 9)"], HalfPlane(2) & Disk(-10, 9)),
    ):
        assert main(["design", stage, *words, "-o", str(tmp_path / "d")]) == 0
        assert Design.load(tmp_path / "d").region == region
    with pytest.raises(SystemExit) as stop:
        main(["design", stage, "--disk", "-10", "8", "--region", "disk(-10, 8)"])
    assert stop.value.code == 2


def test_degree_auto_climbs_and_says_where_it_came_to(stage, tmp_path, capsys):
    words = ["design", stage, "--degree", "auto", "--budget", "20", "-o", str(tmp_path / "d")]
    assert main(words) == 0
    label = Design.load(tmp_path / "d").label
    assert label == "quadratic" or label.startswith("scheduled")
    assert f"proved: {label} keeps" in capsys.readouterr().out


def test_a_region_out_of_reach_exits_1_and_writes_nothing(stage, tmp_path, capsys):
    words = ["design", stage, "--region", "half_plane(9) & disk(-10, 2)", "--method", "quadratic"]
    error = refused(capsys, *words, "-o", tmp_path / "d", "--plot", tmp_path / "p.png", status=1)
    assert error.startswith("not proved: quadratic")
    assert not (tmp_path / "d").exists()
    assert not (tmp_path / "p.png").exists()


def test_a_region_across_the_axis_is_noted(stage, capsys):
    assert main(["design", stage, "--region", "half_plane(-1) & disk(-10, 12)"]) == 0
    assert "this region reaches into the right half-plane" in capsys.readouterr().out


TIGHTEST = {
    "half_plane": (["--within", "disk(-10, 9)"], r"decay rate ([\d.]+) 1/s, within disk\(-10, 9\)"),
    "sector": (
        ["--within", "half_plane(2) & disk(-10, 9)"],
        r"damping ratio ([\d.]+), within half_plane\(2\) & disk\(-10, 9\)",
    ),
    "disk": (["--centre", "-10"], r"radius ([\d.]+) 1/s about -10 \(lower bound: [\d.]+\)"),
}


@pytest.mark.parametrize("of", TIGHTEST)
def test_tightest_prints_what_is_proved_rounded_to_the_safe_side(stage, tmp_path, capsys, of):
    options, pattern = TIGHTEST[of]
    words = ["tightest", stage, "--of", of.replace("_", "-"), *options, "--method", "quadratic"]
    words += ["-o", str(tmp_path / "d"), "--json", str(tmp_path / "s.json")]
    plot = ["--plot", str(tmp_path / "p.png")] if of == "sector" else []
    printed = float(re.search(pattern, ran(capsys, *words, *plot))[1])
    design = Design.load(tmp_path / "d")
    summary = json.loads((tmp_path / "s.json").read_text())
    value = summary["value"]
    assert list(design.region.parts[0].numbers.values())[of == "disk"] == value
    assert abs(printed - value) <= 1e-5 * value
    assert printed >= value if of == "disk" else printed <= value
    measured = {
        "half_plane": lambda: -worst(design, lambda z: z.real),
        "sector": lambda: -worst(design, lambda z: z.real / np.abs(z)),
        "disk": lambda: worst(design, lambda z: np.abs(z + 10)),
    }[of]()
    assert measured <= value if of == "disk" else measured >= value
    assert summary["answer"] == "proved"
    assert summary["of"] == of
    if plot:
        assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


def test_what_lies_beyond_the_tightest_is_not_proved(stage, tmp_path, capsys):
    words = ["tightest", stage, "--of", "half_plane", "--within", "disk(-10, 9)"]
    assert main([*words, "--method", "quadratic", "--json", str(tmp_path / "s.json")]) == 0
    decay = json.loads((tmp_path / "s.json").read_text())["value"]
    for share, status in ((0.995, 0), (1.005, 1)):
        region = f"half_plane({decay * share}) & disk(-10, 9)"
        assert main(["design", stage, "--region", region, "--method", "quadratic"]) == status


def test_speed_without_a_bound_is_noted(stage, capsys):
    said = ran(capsys, "tightest", stage, "--of", "half_plane", "--method", "quadratic")
    assert "note: a disk was added, or the gain would grow without bound" in said
    own = said.split("for example '")[1].split("'")[0]
    words = ["tightest", stage, "--of", "half_plane", "--method", "quadratic", "--within", own]
    said = ran(capsys, *words)
    assert f"within {own}," in said
    assert "note: a disk" not in said


def test_limits_names_degrees_and_resumes_by_them(tmp_path, capsys, monkeypatch):
    car, rows = tmp_path / "car.toml", tmp_path / "rows.json"
    car.write_text(spec_text("quarter-car-physical"))
    words = ["limits", str(car), "--centre", "-40", "--json", str(rows), "--gain"]
    words += ["--degree", "2", "--elevation", "1", "--on", "box"]
    assert main([*words, "--plot", str(tmp_path / "p.svg")]) == 0
    document = json.loads(rows.read_text())
    labels = [row["method"] for row in document["rows"]]
    assert labels == ["quadratic", "slack(2, 1, box)", "scheduled(2, 1, box)"]
    assert document["rows"][2]["radius"] == pytest.approx(26.62236, rel=1e-5)
    assert document["rows"][2]["law"]["on"] == "box"
    out = capsys.readouterr().out
    assert len({line.index("proved") for line in out.splitlines()[2:-2]}) == 1  # a straight column
    seconds = [row["seconds"] for row in document["rows"]]
    # the same command again computes nothing; another degree is another row, the old ones stay
    assert main([*words, "--resume"]) == 0
    assert [row["seconds"] for row in json.loads(rows.read_text())["rows"]] == seconds
    other = [*words[:6], "--method", "scheduled", "--degree", "1", "--elevation", "0", "--resume"]
    assert main(other) == 0
    kept = json.loads(rows.read_text())["rows"]
    assert [row["method"] for row in kept] == ["scheduled(1, 0)", *labels]
    assert [row["seconds"] for row in kept[1:]] == seconds


def test_a_row_of_no_method_is_no_row_to_resume(tmp_path, stage, capsys):
    rows = tmp_path / "rows.json"
    words = ["limits", stage, "--centre", "-10", "--method", "slack", "--json", str(rows)]
    assert main(words) == 0
    for label in ("slack(2, 1, sphere)", "scheduled(2)", "cubic", "slack "):
        document = json.loads(rows.read_text())
        document["rows"][0]["method"] = label
        (tmp_path / "bad.json").write_text(json.dumps(document))
        assert "a row is damaged" in refused(capsys, *words[:-1], tmp_path / "bad.json", "--resume")


def test_one_gain_of_degree_zero_is_one_row(stage, capsys):
    words = ["limits", stage, "--centre", "-10", "--degree", "0", "--method"]
    assert len(ran(capsys, *words, "scheduled", "--method", "quadratic").splitlines()) == 3


def test_discrete_time_goes_all_the_way(cart, tmp_path, capsys):
    folder = tmp_path / "d"
    assert main(["design", cart, "--method", "quadratic", "-o", str(folder)]) == 0
    assert "note:" not in capsys.readouterr().out  # nothing about half-planes
    design = Design.load(folder)
    assert design.plant.sample_time == load(cart).sample_time
    assert check(folder).proved
    assert main(["check", str(folder), "--spec", cart]) == 0
    assert main(["limits", cart, "--centre", "0.6", "--centre", "0", "--method", "slack"]) == 0
    assert main(["limits", cart, "--centre", "0.6", "--plot", str(tmp_path / "p.png")]) == 2
    assert "d/sigma has no meaning" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["design", "--disk", "0.5", "0.6"], "discrete-time plant; give a disk in the unit"),
        (["tightest", "--of", "sector", "--within", "disk(-4, 3)"], "--within is of continuous"),
        (["tightest", "--of", "disk", "--centre", "-2"], "not inside the unit circle"),
        (["limits", "--centre", "-40"], "not inside the unit circle"),
        (["limits"], "use --centre 0.5, or --centres 0 0.8 9"),
        (["tightest", "--of", "disk"], "for example --centre 0.5"),
        (["analyse", "--gain", "[[-1, -1]]", "--of", "disk"], "(--centre 0.5, say)"),
        (["design", "--disk", "0", "1.0000001"], "for example disk(0.5, 0.4)"),
    ],
)
def test_discrete_time_refuses_what_is_of_continuous_time(cart, capsys, words, message):
    error = refused(capsys, words[0], cart, *words[1:])
    assert message in error


@pytest.mark.parametrize("disk", [("0", "1"), ("0.5", "0.5"), ("-0.25", "0.75")])
def test_a_disk_that_touches_the_unit_circle_goes_all_the_way(cart, tmp_path, capsys, disk):
    folder, text = str(tmp_path / "d"), f"disk({', '.join(disk)})"
    assert main(["design", cart, "--disk", *disk, "-o", folder]) == 0
    assert main(["check", folder, "--spec", cart]) == 0
    assert main(["design", cart, "--region", text, "--method", "quadratic"]) == 0
    assert main(["analyse", cart, "--gain", f"{folder}/design.json", "--region", text]) == 0
    ran(capsys, "observe", cart, "--measured", "x1", "--disk", *disk)
    main(["service", folder, "--region", "disk(0, 1)"])
    said = capsys.readouterr()
    assert said.err == ""
    assert "at these rates" not in said.out
    assert main(["report", folder]) == 0
    page = (tmp_path / "d" / "report.html").read_text()
    assert "does not imply stability" not in page


def test_service_in_discrete_time_refuses_what_is_of_continuous_time(cart, tmp_path, capsys):
    assert main(["design", cart, "--disk", "0", "1", "-o", str(tmp_path / "d")]) == 0
    for words, message in (
        (["--region", "half_plane(0) & disk(0, 31)"], "disk(0, 1) for stability alone"),
        (["--decay", "0.1"], "is in discrete time, where no rates of change are proved"),
    ):
        assert message in refused(capsys, "service", tmp_path / "d", *words)


def test_a_spec_without_region_is_told_one_of_its_kind_of_time(cart, tmp_path, capsys):
    spec = tmp_path / "bare.toml"
    spec.write_text("\n".join(x for x in CART.splitlines() if not x.startswith("region")))
    assert "write region = 'disk(0.5, 0.4)'" in refused(capsys, "design", spec)


def test_check_compares_the_sample_time(cart, tmp_path, capsys):
    assert main(["design", cart, "--method", "quadratic", "-o", str(tmp_path / "d")]) == 0
    for change, says in (
        (
            lambda text: text.replace("1/20", "1/25"),
            "sample_time = 0.05 s, spec sample_time = 0.04",
        ),
        (lambda text: text.replace('sample_time = "1/20"', ""), "spec continuous"),
    ):
        other = tmp_path / "other.toml"
        other.write_text(change(CART))
        out = ran(capsys, "check", tmp_path / "d", "--spec", other, status=1)
        assert "other time" in out
        assert says in out


@pytest.mark.parametrize("time", [0, -0.1, "x", None, [1]])
def test_a_design_file_with_no_sensible_sample_time_is_refused(cart, tmp_path, capsys, time):
    assert main(["design", cart, "--method", "quadratic", "-o", str(tmp_path)]) == 0
    path = tmp_path / "design.json"
    with rewritten(path) as document:
        document["plant"]["sample_time"] = time
    assert main(["check", str(path), "--spec", cart]) == 2
    assert str(path) in capsys.readouterr().err
