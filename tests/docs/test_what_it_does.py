"""The page "What it does": each row of its tables runs as it is written."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence
from support import console
from support.paths import DOCS
from support.questions import PAGE, ROWS, commands_of, run_as_written

FIRST = re.search(r"```sh\n(.*?)```", PAGE, re.DOTALL)[1]
QUESTIONS = 27

# Run by vehicle/test_concepts.py, show/test_report.py and, with its page, docs/test_consoles.py.
ELSEWHERE = ("polefence concepts", "polefence report", "polefence study")


@pytest.fixture(scope="module")
def after_the_design(tmp_path_factory):
    """The folder in which the page's first lines were run."""
    folder = tmp_path_factory.mktemp("questions")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run_as_written(FIRST.splitlines())
    return folder


def test_the_page_has_a_row_for_every_question_and_the_index_leads_to_it():
    rows = re.findall(r"^\| (?!question)[^|]+\|[^|]+\|([^|]+)\|$", PAGE, re.MULTILINE)
    assert len(rows) == QUESTIONS
    assert all(re.search(r"\]\([\w-]+\.md", own) for own in rows)
    for page in ("README.md", "docs/index.md"):
        assert "what-it-does" in (DOCS.parent / page).read_text()


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
def test_every_row_runs_as_it_is_written(row, after_the_design, monkeypatch):
    monkeypatch.chdir(after_the_design)
    assert commands_of(row)
    run_as_written(commands_of(row))


def test_the_row_of_studies_is_run_with_its_page():
    (row,) = [row for row in ROWS if "polefence study" in row]
    shown = [command for block in console.blocks((DOCS / "fleet.md").read_text())
             for command, _ in console.COMMAND.findall(block)]  # fmt: skip
    assert commands_of(row)
    assert set(commands_of(row)) <= set(shown)


def test_the_region_has_a_gain_that_can_be_built(physical):
    """Kilonewtons a metre, as springs and tyres have, not meganewtons."""
    (row,) = [row for row in ROWS if "half_plane(4)" in row]
    region = polefence.parse_region(re.search(r'--region "([^"]*)"', row)[1])
    K = polefence.place(physical, region).law.gain(np.eye(4))
    (said,) = re.findall(r"gains are (\d+) kN/m at most on the deflection\)", row)
    assert np.abs(K[:, 0, 0]).max() == pytest.approx(1e3 * float(said), rel=0.05)
    assert np.abs(K[:, 0, 1]).max() < 155900  # the tyre's own stiffness
