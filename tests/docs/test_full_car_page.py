"""The gallery's full car: the gain is a skyhook at each corner, and keeps what the page says."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from support.paths import DOCS
from support.scripts import docs_script

PAGE = (DOCS / "gallery-full-car.md").read_text()


@pytest.fixture(scope="module")
def found():
    example = docs_script("full_car")
    plant = pf.load(example.SPEC)
    return example, plant, example.skyhook(plant)


def test_each_force_is_that_of_its_own_corner(found):
    example, plant, K = found
    x = np.random.default_rng(0).normal(size=14)
    rate = dict(zip((own.split(" [")[0] for own in plant.states), x, strict=True))
    A, _ = plant.at(np.full(4, 0.25))
    for name, force in zip(plant.inputs, K @ x, strict=True):
        corner = name.removesuffix(" force [N]")
        # compressed by the wheel's velocity less the body's, at this corner
        deflection = np.tensordot(
            np.full(4, 0.25), plant.signal(f"{corner} suspension deflection").arrays(plant)[0], 1
        )
        body = rate[f"{corner} wheel velocity"] - np.ravel(deflection) @ (A @ x)
        assert force == pytest.approx(-example.DAMPING * body)


def test_what_is_proved_is_just_above_samples(found):
    example, plant, K = found
    alpha = np.vstack([np.eye(4), example.cars(plant)[1]])
    A, B = plant.at(alpha)
    poles = np.linalg.eigvals(A + B @ K)
    decay, damping = map(
        float, re.search(r"skyhook: decay rate (\S+) .*ratio (\S+) proved", PAGE).groups()
    )
    assert -poles.real.max() == pytest.approx(decay, rel=1e-3)
    assert (-poles.real / np.abs(poles)).min() == pytest.approx(damping, rel=1e-3)
    level = float(re.search(r"acceleration at most (\S+) m/s2", PAGE)[1])
    passive, law = (
        pf.Rms("driver acceleration", density=example.DENSITY).values(plant, own, alpha).max()
        for own in (np.zeros((4, 14)), K)
    )
    assert law * (1 - 1e-3) < level < law * 1.01
    assert level < passive
