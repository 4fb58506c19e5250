"""Coming from another tool: its Python runs, and conventions are those of the package."""

from __future__ import annotations

import re
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pytest

import polefence as pf
from support.paths import DOCS

PAGE = (DOCS / "coming-from.md").read_text()
CONVENTIONS = (DOCS / "conventions.md").read_text()


def block(language, holds):
    (own,) = [x for x in re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL) if holds in x]
    return own


def test_the_lines_of_python_control_print_what_is_shown(tmp_path, monkeypatch):
    pytest.importorskip("control")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(block("toml", "arm"))
    with redirect_stdout(StringIO()) as said:
        exec(block("python", "import control"), {})
    assert said.getvalue() == block("text", "refuted")


def test_vertices_and_alpha_are_in_the_order_that_the_page_says(physical):
    assert "(low, low), (low, high), (high, low), (high, high)" in CONVENTIONS
    (m1, beta), corners = physical.parameters, np.eye(4)
    for corner, (m, b) in zip(
        corners, [(x, y) for x in (m1.low, m1.high) for y in (beta.low, beta.high)], strict=True
    ):
        assert np.allclose(physical.alpha(m1=m, beta=b), corner)
    share = (1 / 300 - 1 / float(m1.low)) / (1 / float(m1.high) - 1 / float(m1.low))
    assert physical.alpha(m1=300, beta=0)[2:].sum() == pytest.approx(share)


def test_the_sign_of_a_gain_is_in_it(physical):
    K = pf.place(physical, pf.Disk(-40, 35), "quadratic").law.K
    A, B = physical.at([0.25] * 4)
    assert pf.Disk(-40, 35).contains(np.linalg.eigvals(A + B @ K))
