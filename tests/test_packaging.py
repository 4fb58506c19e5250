"""Files that stand beside the package say what it says: versions, dependencies, words."""

from __future__ import annotations

import json
import re
import tomllib

import yaml

from support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = (ROOT / "packaging/conda/meta.yaml").read_text()
PAPER = (ROOT / "packaging/joss/paper.md").read_text()
BIBLIOGRAPHY = (ROOT / "packaging/joss/paper.bib").read_text()
CITATION = (ROOT / "CITATION.cff").read_text()
WORKFLOW = (ROOT / ".github/workflows/release.yml").read_text()


def test_one_version_and_title_everywhere():
    assert f'version = "{PROJECT["version"]}"' in RECIPE
    assert f"version: {PROJECT['version']}" in CITATION
    archive = json.loads((ROOT / ".zenodo.json").read_text())
    assert f'title: "{archive["title"]}"' in CITATION
    assert f"title: '{archive['title']}'" in PAPER
    assert archive["license"] == PROJECT["license"]


def test_the_recipe_has_the_dependencies():
    run = re.search(r"  run:\n((?:    - .*\n)*)", RECIPE)[1]
    found = {
        line.split("- ")[1].replace("matplotlib-base", "matplotlib") for line in run.splitlines()
    }
    assert {own.replace(" ", "") for own in found} == {"python", *PROJECT["dependencies"]}
    least = PROJECT["requires-python"].removeprefix(">=").replace(".", "")
    assert f"[py<{least}]" in RECIPE


def test_the_paper_is_short_and_cites_what_is_there():
    assert len(PAPER.split()) <= 1000
    cited = set(re.findall(r"@([a-z]+\d{4})", PAPER))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", BIBLIOGRAPHY, re.MULTILINE))
    for heading in ("Summary", "Statement of need", "Comparison with other tools", "Tests"):
        assert f"\n# {heading}\n" in PAPER


def test_wheels_are_built_for_every_python_that_is_supported():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["cibuildwheel"]
    assert settings["build"].split() == ["cp311-*", "cp312-*", "cp313-*"]
    tested = re.search(r"python: \[(.*)\]", WORKFLOW)[1]
    assert re.findall(r"3\.\d+", tested) == ["3.11", "3.12", "3.13"]
    for path in re.findall(r"\{project\}/(\S+)", settings["test-command"]):
        assert (ROOT / path).is_dir()
        assert path in WORKFLOW


def test_the_workflow_is_one():
    jobs = yaml.safe_load(WORKFLOW)["jobs"]
    assert set(jobs) == {"pure", "compiled", "publish"}
    assert set(jobs["publish"]["needs"]) == {"pure", "compiled"}
