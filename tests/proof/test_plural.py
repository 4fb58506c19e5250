"""One and many in words."""

from __future__ import annotations

import pytest

from polefence.plant.spec import loads
from polefence.proof.text import plural


@pytest.mark.parametrize(
    ("noun", "many"),
    [
        ("vertex", "vertices"),
        ("matrix", "matrices"),
        ("dual matrix", "dual matrices"),
        ("inequality", "inequalities"),
        ("array", "arrays"),
        ("sample", "samples"),
        ("axis", "axes"),
        ("input", "inputs"),
    ],
)
def test_one_and_many(noun, many):
    assert plural(1, noun) == f"1 {noun}"
    for count in (0, 2, 17):
        assert plural(count, noun) == f"{count} {many}"


def test_a_plant_of_one():
    plant = loads("[matrices]\nA = [[-1]]\nB = [[1]]\n")
    assert plant.size_text == "1 vertex, 1 state, 1 input"
    assert "1 vertex, 1 state, 1 input" in repr(plant)
