"""Designs leave their region room for the rounding of their code in float32."""

import pytest

from polefence.examples import spec_text
from support.commands import ran

CASES = {
    ("quarter-car-level",): 1.0210,
    ("active-suspension-ride",): 1.1161,
    ("active-suspension-ride", "--sample-time", "0.002"): 1.1190,
}


@pytest.mark.parametrize("asked", CASES)
def test_a_law_at_the_edge_of_its_region_is_exported_in_float32(
    asked, tmp_path, monkeypatch, capsys
):
    name, *options = asked
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(spec_text(name))
    said = ran(capsys, "optimise", "car.toml", "-o", "d", *options)
    level = float(
        next(line for line in said.splitlines() if "minimised" in line).split("]")[1].split()[0]
    )
    assert level <= CASES[asked]
    run = () if options else ("--sample-time", "0.001")
    said = ran(capsys, "export", "d", "--float", "32", *run, "-o", "c")
    assert "with the gain as this code computes it" in " ".join(said.split())
    assert "proved" in ran(capsys, "check", "c")
