"""The page of the cart and pole: its lines are those of its script, its carts come back."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-cart-pole.md").read_text()


@pytest.fixture(scope="module")
def example():
    return vars(docs_script("cart_pole"))


@pytest.fixture(scope="module")
def design(example):
    return pf.place(example["linearised"]().plant, example["REGION"], "quadratic")


def test_the_page_prints_what_the_script_does(example):
    number = r"\d\.?\d*e-16"
    for through, shown in zip(("l", "1/l"), re.findall(r"```text\n(.*)\n", PAGE), strict=True):
        said = str(example["linearised"](through))
        assert re.sub(number, "#", said) == re.sub(number, "#", shown)
    assert str(example["REGION"]) in PAGE


def test_the_code_of_the_page_is_the_script(example):
    code = "\n".join(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL))
    own = {}
    exec(compile(code, "page", "exec"), own)
    np.testing.assert_array_equal(own["found"].plant.A, example["linearised"]().plant.A)
    assert own["design"].proved


def test_the_law_is_proved_and_inside(design):
    assert design.proved
    assert design.certificate.prove().count == 16
    alpha = np.random.default_rng(2).dirichlet(np.ones(4), 1000)
    assert design.region.distance(design.poles(alpha)).max() <= 0


@pytest.mark.parametrize("angle", [10, 40])
def test_carts_come_back(example, design, angle):
    _, found = example["swings"](design.law, 5, np.radians(angle))
    assert np.abs(found[:, 0] - angle).max() < 1e-9
    assert np.abs(found[:, -1]).max() < 0.02 * angle
    left = example["swings"](pf.FixedGain(0 * design.law.K), 1, np.radians(angle))[1]
    assert np.abs(left).max() > 90


def test_figures_are_drawn(example, design, tmp_path):
    example["draw"](design, tmp_path)
    for name in ("cart-pole.png", "cart-pole-poles.png"):
        assert (tmp_path / name).stat().st_size > 10_000
