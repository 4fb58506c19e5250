"""docs/many.md: its Python runs, and prints an answer for every car."""

from __future__ import annotations

import re

import polefence as pf
from support.paths import DOCS

PAGE = (DOCS / "many.md").read_text()


def test_the_python_runs(capsys):
    first, second = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names = {"__name__": "a page"}
    exec(compile(first, "many.md", "exec"), names)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(names["cars"]) == 16
    assert all(
        re.fullmatch(r"\d+ kg, \d+ N/m: radius [\d.]+, none below [\d.]+", own) for own in lines
    )
    compile(second, "many.md", "exec")
    laws = pf.many.place(names["cars"][:3], pf.HalfPlane(1) & pf.Sector(0.3))
    assert all(isinstance(own, pf.Design) for own in laws)
