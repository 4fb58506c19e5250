"""Files that stand beside the package say what it says: versions, dependencies, words."""

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import metadata

import pytest
import yaml
from packaging.requirements import Requirement

from polefence.base import VERSION
from support.api import API
from support.paths import DOCS, ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = (ROOT / "packaging/conda/meta.yaml").read_text()
PAPER = (ROOT / "packaging/joss/paper.md").read_text()
BIBLIOGRAPHY = (ROOT / "packaging/joss/paper.bib").read_text()
CHANGES = (ROOT / "CHANGELOG.md").read_text()
CITATION = (ROOT / "CITATION.cff").read_text()
WORKFLOW = (ROOT / ".github/workflows/release.yml").read_text()


def test_one_version_and_title_everywhere():
    assert PROJECT["dynamic"] == ["version"]  # that of the package, in base
    assert f'version = "{VERSION}"' in RECIPE
    assert f"\nversion: {VERSION}\n" in CITATION
    (released,) = re.findall(rf"^## {re.escape(VERSION)} \((\S+)\)$", CHANGES, re.MULTILINE)
    assert f"\ndate-released: {released}\n" in CITATION
    assert CHANGES.index("\n## Unreleased\n") < CHANGES.index(f"\n## {VERSION} ")
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


def _installed_by(requirements):
    """Names of the distributions that pip installs for these, dependencies of theirs included."""
    found, left = set(), [Requirement(own) for own in requirements]
    while left:
        own = left.pop()
        name = own.name.lower().replace("_", "-")
        if name in found or (own.marker and not own.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        left += map(Requirement, metadata.requires(name) or ())
    return found


# What Sphinx imports, where nothing else can be imported.
BUILT = """
import importlib, sys
from sphinx.ext.autodoc.mock import mock

class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {name!r}")

docs, hidden, names = sys.argv[1], set(sys.argv[2].split()), sys.argv[3].split()
sys.meta_path.insert(0, Refused())
sys.path.insert(0, docs)
import conf
for name in (*conf.extensions, conf.html_theme):
    importlib.import_module(name)
with mock(conf.autodoc_mock_imports):
    for name in names:
        module = name
        while module:
            try:
                found = importlib.import_module(module)
                break
            except ModuleNotFoundError as error:
                if not module.startswith(str(error.name)):
                    raise
                module = module.rpartition(".")[0]
        for part in name[len(module) + 1:].split("."):
            found = getattr(found, part) if part else found
"""


def test_the_extra_for_the_documentation_is_enough_to_build_it():
    there = _installed_by([*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["docs"]])
    hidden = {
        top
        for top, own in metadata.packages_distributions().items()
        if not {name.lower().replace("_", "-") for name in own} & {*there, "polefence"}
    } - set(sys.stdlib_module_names)
    assert {"panel", "control", "distributed"} <= hidden
    room, names = "polefence", list[str]()
    for line in API.splitlines():
        if own := re.match(r"\.\. (currentmodule|py:module|auto\w+):: (\S+)", line):
            kind, name = own.groups()
            if kind.startswith("auto"):
                names.append(name if name.startswith("polefence.") else f"{room}.{name}")
            else:
                room = name
    assert len(names) > 150
    words = [sys.executable, "-c", BUILT, str(DOCS), " ".join(sorted(hidden)), " ".join(names)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


MAKEFILE = (ROOT / "Makefile").read_text()
CHECKS = (ROOT / ".github/workflows/checks.yml").read_text()


def test_pull_requests_are_checked_on_every_system():
    document = yaml.safe_load(CHECKS)
    assert set(document[True]) == {"pull_request", "push"}  # YAML reads the key `on` as true
    linux, quick = (document["jobs"][name] for name in ("linux", "quick"))
    assert linux["steps"][-1] == {"run": ".ci/run"}
    assert os.access(ROOT / ".ci/run", os.X_OK)
    systems = {name.split("-")[0] for name in quick["strategy"]["matrix"]["system"]}
    assert systems == {"ubuntu", "macos", "windows"}
    assert f">={quick['strategy']['matrix']['python'][0]}" == PROJECT["requires-python"]
    # the same as `make quick`
    recipe = re.search(r"^quick:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)[
        1
    ]
    words = [line.strip().removeprefix("$(BIN)/") for line in recipe.splitlines()]
    runs = [step["run"] for step in quick["steps"] if "run" in step]
    assert runs[-len(words) : -1] == words[:-1]
    (parallel,) = re.findall(r"^PARALLEL := (.*)$", MAKEFILE, re.MULTILINE)
    assert runs[-1] == "python -m " + words[-1].replace("$(PARALLEL)", parallel)


@pytest.mark.parametrize("name", ["fault", "wish"])
def test_the_forms_of_issues_are_whole(name):
    form = yaml.safe_load((ROOT / f".github/ISSUE_TEMPLATE/{name}.yml").read_text())
    assert {"name", "description", "body"} <= set(form)
    asked = [own for own in form["body"] if own["type"] != "markdown"]
    assert len({own["id"] for own in asked}) == len(asked)
    assert all(own["type"] in ("input", "textarea") for own in asked)
    assert any(own.get("validations", {}).get("required") for own in asked)


@pytest.mark.parametrize("name", ["SECURITY.md", "README.md", "CONTRIBUTING.md"])
def test_links_lead_to_a_heading_that_is_there(name):
    targets = re.findall(r"\]\((?!http)([^)#]*)(?:#([^)]+))?\)", (ROOT / name).read_text())
    for path, heading in targets:
        assert (ROOT / path).exists(), path
        if heading:
            titles = re.findall(r"^#+ (.*)$", (ROOT / path).read_text(), re.MULTILINE)
            own = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
            labels = re.findall(r"^\((\S+)\)=$", (ROOT / path).read_text(), re.MULTILINE)
            assert heading in own | set(labels), f"{path}#{heading}"
