"""Pages whose commands no test of their own runs: they print what is shown, to the last digit."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from polefence.examples import spec_text
from polefence.fleet import Study
from polefence.fleet.questions import Tightest
from polefence.fleet.variants import Variants
from support.console import alike, blocks, follow
from support.paths import DOCS
from support.scripts import docs_script

CAR = ("car.toml", spec_text("quarter-car-physical"))
STAGE = (
    "stage.toml",
    re.search(r"```toml\n(.*?)```", (DOCS / "tutorial.md").read_text(), re.DOTALL)[1],
)
STUDIES = re.findall(
    r"```toml\n(# (\S+\.toml)\n.*?)```", (DOCS / "fleet.md").read_text(), re.DOTALL
)
INTEGRATORS = re.search(
    r"```python\n# (\S+\.py)\n(.*?)```", (DOCS / "verify.md").read_text(), re.DOTALL
)
MASSES = (
    "masses.toml",
    re.search(r"```toml\n# masses.toml\n(.*?)```", (DOCS / "robust.md").read_text(), re.DOTALL)[1],
)
MOVING = (
    "moving.toml",
    spec_text("quarter-car-ride").replace('"1/m1"\n', '"1/m1"\nrate = [-50, 50]\n'),
)
STOP = re.search(r"```toml\n(.*?)```", (DOCS / "elements.md").read_text(), re.DOTALL)[1]
MASS = re.search(r"```toml\n(.*?)```", (DOCS / "steps.md").read_text(), re.DOTALL)[1]
ARM = re.search(r"```toml\n(.*?)```", (DOCS / "coming-from.md").read_text(), re.DOTALL)[1]
LATE = ("late.toml", docs_script("dead_time").SPEC)
MEASURED = list(docs_script("from_data").files().items())
PAGES = {  # with what a reader has before the first command
    "cli": [STAGE],
    "coming-from": [("arm.toml", ARM)],
    "dead-time": [LATE],
    "elements": [("stop.toml", STOP), ("free.toml", STOP.rpartition("[[specification]]")[0])],
    "from-data": MEASURED,
    "fleet": [(name, text) for text, name in STUDIES],
    "index": [],
    "loops": [],
    "moving": [MOVING],
    "not-proved": [],
    "observers": [],
    "proof": [STAGE],
    "reproduction": [],
    "robust": [MASSES],
    "sample-time": [CAR],
    "semi-active": [],
    "service": [CAR],
    "steps": [("mass.toml", MASS)],
    "tutorial": [STAGE],
    "verify": [INTEGRATORS.groups()],
}
ELSEWHERE = {
    "analysis", "export", "gallery-car-to-board", "input-limits", "regions", "ride", "simulate",
    "structures", "tradeoff", "vectors",
}  # fmt: skip
NOT_RUN = {"dependencies", "export-misra", "export-observer", "report"}  # installs, checks C, draws
INSTALLED = re.compile(r"^\$ (?:python3 -m venv|polefence --version)")


@pytest.fixture
def one_process(monkeypatch):
    """Have studies start no processes, and estimates, of which pages show no number, try little."""

    def one(study, question):
        own = study.variants
        return replace(
            study,
            variants=Variants(own.names, own.rows[:1], own.labels[:1]),
            questions=(question,),
        )

    monkeypatch.setattr("polefence.fleet.workers.processors", lambda: 1)
    monkeypatch.setattr(Study, "tried", one)


@pytest.fixture
def answered_once(monkeypatch):
    """Have a study's check, which asks once more what is out of reach, remember the answer."""
    known, search = {}, Tightest.answers

    def answers(question, specs):
        found = search(question, specs)
        known.update(((question, spec), own) for spec, own in zip(specs, found, strict=True))
        return found

    monkeypatch.setattr(Tightest, "answers", answers)
    monkeypatch.setattr(Tightest, "least", lambda question, spec: known[question, spec].least)


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.usefixtures("one_process", "answered_once")
def test_the_commands_print_what_the_page_shows(page, tmp_path, monkeypatch, capsys):
    for name, text in PAGES[page]:
        (tmp_path / name).write_text(text)
    for block in blocks((DOCS / f"{page}.md").read_text()):
        if not INSTALLED.match(block):
            follow(block, tmp_path, monkeypatch, capsys)


def test_every_page_with_commands_is_one_that_is_run():
    found = {page.stem for page in DOCS.glob("*.md") if blocks(page.read_text())}
    assert found == PAGES.keys() | ELSEWHERE | NOT_RUN


@pytest.mark.parametrize(
    "said",
    [
        "radius 1.235 proved     0.10\n  K = [1 2; 3 4]\n",
        "radius 1.237  proved     0.10\n  K = [1 2; 3 4]\n",
        "radius 1.2349  proved     0.10\n  K = [1 2; 3]\n",
        "radius 2.235  proved     0.10\n  K = [1 2; 3 4]\n",
        "radius 1.235  proved     0.10\n  K = [1 2; 3 4.1]\n",
        "radius 1.235  proved     0.10\n  K = [1 2; 3]\n",
        "radius 1.235  proved     0.10\n",
        "radius 1.235  proved     0.10\n  K = [1 2; 3 4]\nmore\n",
    ],
)
def test_a_difference_is_seen(said):
    shown = "radius 1.235  proved     0.22\n  K = [1 2; 3 4]\n"
    alike(shown, "radius 1.234  proved     9.10\n  K = [1 2; 3 4.0004]\n")
    with pytest.raises((AssertionError, ValueError)):
        alike(shown, said)
