"""The gallery's fleet: cars keep the disk with the law that is theirs, radii are just enough."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from polefence.plant.spec import loads
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-fleet.md").read_text()


def test_laws_keep_their_cars_and_radii_are_just_enough(tmp_path, monkeypatch):
    example = docs_script("fleet")
    tyres = re.search(r"kt = (\[.*?\])", example.STUDY)[1]
    text = example.STUDY.replace(tyres, "[110000, 250000]").replace("[25, 35]", "[25]")
    monkeypatch.setattr(example, "STUDY", text)
    rows, laws = example.answers(tmp_path)
    alpha = np.linspace([1, 0], [0, 1], 500)
    assert len(laws) == len(rows["cover"]) == 2
    for row, design in (one for own in laws for one in own):
        assert design.region == example.REGION
        assert pf.check(design).proved
        assert np.abs(design.poles(alpha) + 40).max() < 38.5
        A, _ = design.plant.at(alpha)
        assert A[:, 3, 1] == pytest.approx(row["kt"] / row["m2"])
    least, most = map(float, re.search(r"radius (\S+) to (\S+) 1/s", PAGE).groups())
    for row in rows["tightest"].values():
        assert least <= round(row["bound"], 2) <= most
        text = example.CAR.replace("kt = 155900", f"kt = {row['kt']}")
        car = loads(text.replace("m2 = 28.58", f"m2 = {row['m2']}"))
        design = pf.tightest(car, of="disk", centre=-40)
        assert float(design.region.radius) == pytest.approx(row["bound"], rel=1e-3)
        reached = np.abs(design.poles(alpha) + 40).max()
        assert 0.99 * row["bound"] < reached < row["bound"] * (1 + 1e-6)
