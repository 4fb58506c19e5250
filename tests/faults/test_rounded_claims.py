"""Numbers beside "proved": rounded to the side on which less is claimed, or as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from polefence.certify.design import Design
from polefence.cli.limits import _row_line
from polefence.cli.main import main
from polefence.requirements.rms import Rms
from polefence.requirements.specification import limit_text
from polefence.show.report import html_report

SPEC = """
name = "stage"
[parameter.k]
range = [1.0000004, 2.9999996]
unit = "N/m"
[matrices]
A = [[0, 1], ["-k", -0.1]]
B = [[0], [1]]
"""


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rounded")
    path = folder / "stage.toml"
    path.write_text(SPEC)
    assert main(["design", str(path), "--disk", "-3", "2.9", "-o", str(folder / "law")]) == 0
    return path


def said_by(capsys, *words, status=0):
    capsys.readouterr()
    assert main([str(word) for word in words]) == status
    return capsys.readouterr().out


def test_a_disk_is_about_the_centre_that_is_printed(spec, capsys):
    """About -3 the radius might be larger."""
    centre = "-3.00000049"
    out = said_by(capsys, "limits", spec, "--centre", centre, "--method", "quadratic")
    assert out.splitlines()[2].split()[0] == centre
    for method in ("quadratic", "scheduled"):
        words = ["--of", "disk", "--centre", centre, "--method", method]
        assert f" about {centre}" in said_by(capsys, "tightest", spec, *words)
    words = ["--gain", "[[-9, -6]]", "--of", "disk", "--centre", centre]
    assert f" about {centre} for every alpha" in said_by(capsys, "analyse", spec, *words)


def test_a_box_is_no_simplex(spec, capsys):
    """Of two parameters the simplex has points that no parameters have: nothing is said of them."""
    path = spec.parent / "two.toml"
    second = "[parameter.c]\nrange = [0.1, 0.2]\n[matrices]"
    text = SPEC.replace("[matrices]", second).replace("-0.1]]", '"-c"]]')
    path.write_text(text)
    box = "in disk(-3, 2.9) for every alpha of the box\n"
    words = ["design", path, "--disk", "-3", "2.9"]
    assert box in said_by(capsys, *words, "--on", "box")
    assert box.replace(" of the box", "") in said_by(capsys, *words)
    words = ["analyse", path, "--gain", "[[-9, -6]]", "--region", "half_plane(0.5)"]
    assert "half_plane(0.5) for every alpha of the box; " in said_by(capsys, *words)
    words = [*words[:4], "--of", "half_plane"]
    assert " for every alpha of the box of 'stage'" in said_by(capsys, *words)


def test_a_column_is_as_wide_as_its_numbers(spec, capsys):
    words = ["--centres", "-2", "-4", "4", "--method", "quadratic"]
    head, *rows = said_by(capsys, "limits", spec, *words).splitlines()[1:]
    at = head.index("method")
    assert [row[at:].split()[0] for row in rows] == ["quadratic"] * 4
    assert [float(row[:at]) for row in rows] == pytest.approx([-2, -8 / 3, -10 / 3, -4], rel=1e-15)


@pytest.mark.parametrize(("radius", "shown"), [(29.07204, "27.31 %"), (29.0755, "27.31 %")])
def test_the_share_of_a_centre_is_rounded_down(radius, shown):
    row = {"centre": -40.0, "method": "scheduled", "radius": radius, "answer": "proved"}
    assert f" {shown} " in _row_line(row | {"seconds": 0.1}, 10, 10, True)


def test_no_range_is_told_wider_than_it_is(spec, tmp_path):
    design = Design.load(spec.parent / "law")
    assert main(["export", str(spec.parent / "law"), "-o", str(tmp_path / "code")]) == 0
    for text in (Path(tmp_path / "code" / "law.h").read_text(), html_report(design)):
        ranges = re.findall(r"([\d.]+) to ([\d.]+)\b", text)
        assert ("1.00001", "2.99999") in ranges
        assert ("1", "3") not in ranges


def test_a_limit_reads_back_as_it_is():
    for value in (0.49999999, 660.0, 1e-7, 1 / 3):
        text = limit_text(Rms("x", value))
        assert float(text.removeprefix("rms of x <= ")) == value
    assert limit_text(Rms("x")) == "rms of x"
