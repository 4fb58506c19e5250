"""Answers that do not hang on the last bits of floats, in which processors differ."""

import numpy as np
import pytest

import polefence as pf
from polefence.examples import spec_path
from polefence.law.structure import Structure
from polefence.plant.outputs import Output
from polefence.region.regions import HalfPlane
from polefence.requirements.rms import Rms
from polefence.search.tune import tuner

ROUNDED, SAME = 1e-12, 1e-4


def levels(monkeypatch, answer):
    """Return the levels of answers whose searches' starts differ by rounding."""
    begun = tuner._Search._starts
    found = []
    for seed in range(2):
        random = np.random.default_rng(seed)

        def starts(search, laws, random=random):
            return [
                theta * (1 + ROUNDED * random.normal(size=theta.size))
                for theta in begun(search, laws)
            ]

        monkeypatch.setattr(tuner._Search, "_starts", starts)
        found.append(answer())
    return found


@pytest.mark.parametrize("seed", [0, 2])
def test_of_random_plants_with_outputs(seed, monkeypatch):
    random = np.random.default_rng(seed)
    A, B, E = random.normal(size=(3, 3)), random.normal(size=(3, 1)), random.normal(size=(3, 2))
    d = 0.3 * random.normal(size=(3, 3))
    plant = pf.UncertainPlant.from_vertices([A - d, A + d], [B] * 2, [E] * 2)
    signal, effort = Output("z", "", C=random.normal(size=3)), Output("u", "", D=[1.0])
    least, limit = Rms([signal], density=1.0), Rms([effort], 5.0, density=1.0)

    def answer():
        own = tuner.tune(plant, Structure(schedule=()), least, [limit], HalfPlane(0.1))[0]
        assert own.kept
        return own.level

    found = levels(monkeypatch, answer)
    assert found[1] == pytest.approx(found[0], rel=SAME)


def test_of_a_car_whose_level_hardly_changes_along_its_way(monkeypatch):
    # steps are worth 1e-7 each for a while on the way, a thousandth above the least
    path = spec_path("quarter-car-level")
    plant, question = pf.load(path), (*pf.load_specifications(path), HalfPlane(0.5))
    found = levels(monkeypatch, lambda: pf.optimise(plant, *question).bounds[0].level)
    assert found[1] == pytest.approx(found[0], rel=SAME)
    assert max(found) <= 1.0210
