"""The page on measured data: its files are its script's, its numbers come back."""

from __future__ import annotations

import re

import control
import numpy as np
import pytest

import polefence as pf
from polefence.data import FrequencyResponse
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "from-data.md").read_text()


@pytest.fixture(scope="module")
def script():
    return docs_script("from_data")


def test_the_files_of_the_page_are_those_of_the_script(script):
    own, unknown = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert script.MEASUREMENTS.startswith(own)
    assert script.UNKNOWN.startswith(unknown)
    (head,) = re.findall(r"```text\n(.*),\.\.\.\n```", PAGE)
    assert script.measured(290, np.random.default_rng(0)).startswith(head)


def test_the_choice_of_through_is_as_the_page_says(script):
    """Of data without noise, at the page's masses."""
    source = type("Quiet", (), {"standard_normal": staticmethod(np.zeros)})()
    responses = []
    for m1 in script.MASSES:
        rows = np.loadtxt(script.measured(m1, source).splitlines()[1:], delimiter=",").T
        G = rows[1::2] * np.exp(1j * np.radians(rows[2::2]))
        outputs, acting = script.SIGNALS
        responses.append(FrequencyResponse(2 * np.pi * rows[0], G.reshape(3, 2, -1), {"m1": m1},
                                           acting, outputs, f"{m1}"))  # fmt: skip
    asked = {"inputs": acting[:1], "disturbances": acting[1:], "outputs": outputs}
    asked |= {"direct": ["body acceleration from force"]}
    shares = {}
    for through in ("1/m1", "m1"):
        box = [pf.Parameter("m1", 290, 530, through=through)]
        shares[through] = 100 * pf.identify(responses, 4, parameters=box, **asked).data.all.rms
    said = re.search(r"through `1/m1` misses data without noise by ([\d.]+) %, through `m1` by "
                     r"([\d.]+) %", PAGE)  # fmt: skip
    assert shares["1/m1"] == pytest.approx(float(said[1]), rel=0.1)
    assert shares["m1"] == pytest.approx(float(said[2]), rel=0.4)


def test_the_code_of_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    m2, k, c, kt = 36, 17000, 1200, 170000
    frds = {}
    for m1 in (290, 410, 530):
        A = [[0, 0, -1, 1], [0, 0, 0, -1], [k / m1, 0, -c / m1, c / m1],
             [-k / m2, kt / m2, c / m2, -c / m2]]  # fmt: skip
        B = [[0, 0], [0, 1], [1 / m1, 0], [-1 / m2, 0]]
        system = control.ss(A, B, [[1, 0, 0, 0]], [[0, 0]], inputs=["force", "road velocity"],
                            outputs=["deflection"])  # fmt: skip
        frds[m1] = control.frequency_response(system, np.geomspace(3, 160, 100))
    exec(compile(code, "page", "exec"), {"measured": frds})
    assert capsys.readouterr().out.startswith("unproved, from data: ")
    assert pf.load("family.toml").data.kind == "frequency"
