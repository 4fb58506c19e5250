"""Documents are tested: README's commands and snippet, the tutorial's doctests, the layer names."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

import polefence
from polefence.cli.main import main
from polefence.examples import spec_text
from support import console
from support.paths import DOCS, ROOT
from support.readme import README, ROWS, commands_of, run_as_written


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # its last folder
def test_the_tutorial_does_what_it_shows(monkeypatch):
    monkeypatch.chdir(ROOT)
    result = doctest.testfile(
        str(ROOT / "docs" / "tutorial.md"),
        module_relative=False,
        optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE,
    )
    assert result.attempted > 10
    assert result.failed == 0


# Run by vehicle/test_concepts.py, show/test_report.py and, with its page, docs/test_consoles.py.
ELSEWHERE = ("polefence concepts", "polefence report", "polefence study")


@pytest.fixture(scope="module")
def after_the_readme(tmp_path_factory):
    """The folder in which the README's own lines were run."""
    folder = tmp_path_factory.mktemp("readme")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (folder / "car.toml").write_text(spec_text("quarter-car-physical"))
        words = ["design", "car.toml", "--disk", "-40", "31", "--method", "scheduled"]
        assert main([*words, "-o", "car"]) == 0
    return folder


def test_the_table_has_commands_for_every_command_but_these():
    used = {command.split()[1] for row in ROWS for command in commands_of(row)}
    assert len(ROWS) == 20
    assert used >= {
        "design", "limits", "analyse", "service", "optimise", "compare", "simulate", "report",
        "observe", "export", "concepts", "studio", "study", "verify", "loops", "robust",
    }  # fmt: skip


@pytest.mark.parametrize(
    "row",
    [row for row in ROWS if not any(own in row for own in ELSEWHERE)],
    ids=lambda row: commands_of(row)[-1].split()[1],
)
def test_every_row_of_the_readme_runs_as_it_is_written(row, after_the_readme, monkeypatch):
    monkeypatch.chdir(after_the_readme)
    assert commands_of(row)
    run_as_written(commands_of(row))


def test_the_row_of_studies_is_run_with_its_page():
    (row,) = [row for row in ROWS if "polefence study" in row]
    shown = [command for block in console.blocks((DOCS / "fleet.md").read_text())
             for command, _ in console.COMMAND.findall(block)]  # fmt: skip
    assert commands_of(row)
    assert set(commands_of(row)) <= set(shown)


def test_the_readmes_region_has_a_gain_that_can_be_built(physical):
    """Kilonewtons a metre, as springs and tyres have, not meganewtons."""
    (row,) = [row for row in ROWS if "half_plane(4)" in row]
    region = polefence.parse_region(re.search(r'--region "([^"]*)"', row)[1])
    K = polefence.place(physical, region).law.gain(np.eye(4))
    (said,) = re.findall(r"gains are (\d+) kN/m at most on the deflection\)", row)
    assert np.abs(K[:, 0, 0]).max() == pytest.approx(1e3 * float(said), rel=0.05)
    assert np.abs(K[:, 0, 1]).max() < 155900  # the tyre's own stiffness


def test_readme_commands_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = [line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    commands = [line for line in lines if line.startswith("polefence")]
    assert len(commands) == 4
    run_as_written(commands)


def test_readme_make_targets_exist():
    targets = re.findall(r"^make (\w+)", "\n".join(blocks("sh")), re.MULTILINE)
    assert targets == ["paper", "test"]
    makefile = (ROOT / "Makefile").read_text()
    for target in targets:
        assert f"\n{target}:" in makefile


def test_readme_spec_is_that_of_the_tutorial():
    """Which tests follow to a proved design."""
    (own,) = blocks("toml")
    assert f"```toml\n{own}```" in (ROOT / "docs" / "tutorial.md").read_text()


def test_readme_snippet_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("car.toml").write_text(spec_text("quarter-car-physical"))
    (snippet,) = blocks("python")
    names: dict[str, object] = {}
    exec(snippet, names)
    assert names["K"].shape == (1, 5)
    assert polefence.check("car").proved


def test_readme_names_files_that_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("name", polefence.__all__)
def test_the_facade_is_documented(name):
    thing = getattr(polefence, name)
    assert name == "METHODS" or thing.__doc__
    assert name in (ROOT / "docs" / "api.md").read_text()


def test_all_that_the_package_names_is_there():
    assert len(set(polefence.__all__)) == len(polefence.__all__)
    for name in polefence.__all__:
        assert getattr(polefence, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = polefence.nothing


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.stem)
def test_pages_import_the_package_itself_or_one_room(page):
    for code in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        assert not re.search(r"(?:from|import) polefence\.\w+\.", code)
