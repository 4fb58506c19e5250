"""The gallery's fleet: cars keep the disk with the law that is theirs, radii are just enough."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from polefence.plant.spec import loads
from support.gallery import alike, page
from support.scripts import docs_script


@pytest.fixture(scope="module")
def example():
    return docs_script("fleet")


@pytest.fixture(scope="module")
def found(example, tmp_path_factory):
    """Rows and laws of the study, asked once."""
    return example.answers(tmp_path_factory.mktemp("fleet"))


def test_the_page_shows_what_its_script_prints_and_draws(
    example, found, monkeypatch, tmp_path, capsys
):
    monkeypatch.setattr(example, "answers", lambda _: found)
    example.main(tmp_path)
    alike("fleet", capsys.readouterr().out, tmp_path)


def test_laws_keep_their_cars_and_radii_are_just_enough(example, found):
    rows, laws = found
    alpha = np.linspace([1, 0], [0, 1], 500)
    assert len(laws) == 2
    assert len(rows["cover"]) == sum(map(len, laws)) == 12
    for row, design in (one for own in laws for one in own):
        assert design.region == example.REGION
        assert pf.check(design).proved
        assert np.abs(design.poles(alpha) + 40).max() < 38.5
        A, _ = design.plant.at(alpha)
        assert A[:, 3, 1] == pytest.approx(row["kt"] / row["m2"])
    least, most = map(float, re.search(r"radius (\S+) to (\S+) 1/s", page("fleet")).groups())
    for row in rows["tightest"].values():
        assert least <= round(row["bound"], 2) <= most
        text = example.CAR.replace("kt = 155900", f"kt = {row['kt']}")
        car = loads(text.replace("m2 = 28.58", f"m2 = {row['m2']}"))
        design = pf.tightest(car, of="disk", centre=-40)
        assert float(design.region.radius) == pytest.approx(row["bound"], rel=1e-3)
        reached = np.abs(design.poles(alpha) + 40).max()
        assert 0.99 * row["bound"] < reached < row["bound"] * (1 + 1e-6)
