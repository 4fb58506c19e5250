"""docs/responses.md: its Python does what it shows; its example measures what it says."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys

import numpy as np
import pytest

from polefence import response, vehicle
from support.api import PAGES as API
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "responses.md").read_text()


@pytest.fixture(scope="module")
def example():
    return docs_script("estimation")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_page_does_what_it_shows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = doctest.testfile(
        str(DOCS / "responses.md"), module_relative=False, optionflags=doctest.ELLIPSIS
    )
    assert result.attempted == PAGE.count(">>> ")
    assert result.attempted > 50
    assert result.failed == 0


def test_every_python_block_is_one_that_is_run():
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(blocks) > 12
    assert all(block.startswith(">>> ") and block.endswith("\n\n") for block in blocks)


def test_the_page_says_what_the_example_measures(example, tmp_path, capsys, monkeypatch):
    found, margins = example.estimated()
    monkeypatch.setattr(example, "estimated", lambda: (found, margins))
    example.main(tmp_path)
    picture = (tmp_path / "estimation.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 20_000
    said = capsys.readouterr().out.splitlines()[:-1]
    shown = re.search(r"has converged:\n\n((?:    .*\n)+)", PAGE)[1]
    assert [line.strip() for line in shown.splitlines()] == said
    # what the example sums up, from the drive itself
    t, off = found.time, np.abs(found.used - found.parameters)[0]
    late = ((t >= 4) & (t < 6)) | (t >= 10)
    rms = np.sqrt((off[late] ** 2).mean(axis=0))
    assert f"error {rms[0]:.1f} kg rms" in said[0]
    assert f"error {rms[1]:.1f} rms" in said[1]
    # 2.361 % of each range is what docs/service.md has
    assert example.allowed(margins) == pytest.approx([0.02361 * 115.56, 0.02361 * 20], rel=1e-3)
    assert rms[0] < example.allowed(margins)[0]
    assert rms[1] > 2 * example.allowed(margins)[1]
    assert {"rate", "estimate"} <= {event.kind for event in found.events}
    assert np.abs(found.states).max() < 3  # nothing ran away


@pytest.mark.parametrize(("room", "least"), [(response, 5), (vehicle, 20)])
def test_the_page_names_functions_of_the_package(room, least):
    known, name = set(room.__all__), room.__name__.removeprefix("polefence.")
    used = set(re.findall(rf"\bpf\.{name}\.(\w+)", PAGE))
    assert used <= known, used - known
    assert len(used) > least
    for each in known:
        assert getattr(room, each).__class__.__name__ != "module", each
    api = API["responses"] + API["vehicle"]
    module = r"polefence\.response\." if name == "response" else r"(?:polefence\.vehicle\.)?"
    listed = set(re.findall(rf"^\.\. (?:auto\w+|py:data):: {module}(\w+)$", api, re.MULTILINE))
    assert listed == known, listed ^ known


def test_the_front_door_stays_light():
    code = (
        "import sys, polefence\n"
        "assert 'polefence.response' not in sys.modules\n"
        "import polefence.response\n"
        "assert not [m for m in sys.modules if m.split('.')[0] in ('scipy', 'matplotlib')]\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
