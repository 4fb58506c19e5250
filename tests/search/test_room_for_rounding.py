"""Designs leave their region room for the rounding of their code in float32."""

import pytest

from polefence.certify.design import Design
from polefence.examples import spec_text
from support.commands import ran

CASES = {
    "quarter-car-level": 1.0210,
    "active-suspension-ride": 1.1161,
}


@pytest.mark.parametrize("name", CASES)
def test_a_law_at_the_edge_of_its_region_is_exported_in_float32(
    name, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(spec_text(name))
    said = ran(capsys, "optimise", "car.toml", "-o", "d")
    level = float(
        next(line for line in said.splitlines() if "minimised" in line).split("]")[1].split()[0]
    )
    assert level <= CASES[name]
    said = ran(capsys, "export", "d", "--float", "32", "--sample-time", "0.001", "-o", "c")
    assert "with the gain as this code computes it" in said
    design = Design.load("d")
    assert f"lie in {design.region}" in " ".join(said.split())
