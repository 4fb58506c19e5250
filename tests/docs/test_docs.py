"""Documents are tested: README's commands and snippet, the tutorial's doctests, the layer names."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest

import polefence
from polefence.examples import spec_text
from support.api import API, PAGES
from support.paths import DOCS, ROOT
from support.questions import run_as_written

README = (ROOT / "README.md").read_text()


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
    assert name in API


def test_all_that_the_package_names_is_there():
    assert len(set(polefence.__all__)) == len(polefence.__all__)
    for name in polefence.__all__:
        assert getattr(polefence, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = polefence.nothing


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.stem)
def test_pages_import_the_package_itself_or_one_room(page):
    for code in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        assert not re.search(r"(?:from|import) polefence\.\w+\.", code)


def test_the_index_of_the_api_leads_to_every_page_once():
    listed = re.findall(r"^\| \[[^\]]+\]\((\w+)\.md\)", PAGES["index"], re.MULTILINE)
    assert sorted([*listed, "index"]) == list(PAGES)
    assert PAGES["index"].partition("{toctree}")[2].split()[1:-1] == listed
