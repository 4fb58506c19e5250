"""Every command takes designs of another car, a winch and a converter.

Here are some of each; `benchmarks/compose.py` has all.
"""

from __future__ import annotations

import pytest

from support.commands import ran
from support.every_command import PLANTS
from support.hasty import hasty

DESIGNS = {f"{plant.name}, {own.name}": own for plant in PLANTS for own in plant.designs()}
TRIED = (
    "city car, scheduled, late",
    "city car, moving",
    "winch, sensors, late",
    "converter, scheduled",
    "converter, sensors, late",
)


@pytest.mark.parametrize("name", TRIED)
def test_every_command_takes_it(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plant.toml").write_text(DESIGNS[name].spec)
    commands = list(DESIGNS[name].commands("plant.toml", "design"))
    assert len(commands) >= 6
    for words in commands:
        with hasty():
            assert ran(capsys, *words), words
