"""The gallery's half car: bounds just above samples, and a drive with its tyres on the road."""

from __future__ import annotations

import re

import numpy as np
import pytest

import polefence as pf
from polefence.plant.points import seeded
from polefence.plant.spec import load_car
from polefence.vehicle.contact import static_loads
from support.gallery import alike, page
from support.scripts import docs_script

PROVED = re.compile(r"  (.*): driver (\S+) m/s2, pitch (over )?(\S+) rad/s2\n")


@pytest.fixture(scope="module")
def found():
    example = docs_script("half_car")
    plant = pf.load(example.SPEC)
    designs = {own: example.designed(plant, *own) for own in ((), (example.PITCH,))}
    laws = {"passive": example.PASSIVE, "law, pitch left free": designs[()].law}
    laws["law, pitch limited"] = designs[example.PITCH,].law
    example.designed = lambda _, *more: designs[more]  # when the script asks again
    return example, plant, laws


def test_the_page_shows_what_its_script_prints_and_draws(found, tmp_path, capsys):
    found[0].main(tmp_path)
    alike("half-car", capsys.readouterr().out, tmp_path)


def test_the_bounds_are_those_of_samples_and_little_more(found):
    example, plant, laws = found
    shown = {
        name: (float(driver), float(pitch), bool(over))
        for name, driver, over, pitch in PROVED.findall(page("half-car"))
    }
    assert shown.keys() == laws.keys()
    alpha = np.vstack([np.eye(4), seeded(plant, 300)])
    for name, law in laws.items():
        driver, pitch, over = shown[name]
        for level, signal in zip((driver, pitch), example.SIGNALS, strict=False):
            worst = pf.Rms(signal, density=example.DENSITY).values(plant, law, alpha).max()
            if over and level == pitch:  # what nothing asks for, from below
                assert level < worst < level + 0.5
                continue
            assert worst * (1 - 1e-3) < level < worst * 1.01


def test_the_drive_is_one_that_the_equations_know(found):
    example, plant, laws = found
    car = load_car(example.SPEC)
    alpha = np.array([plant.alpha(**own) for own in example.LOADS.values()])
    rest = static_loads(plant, car, alpha)
    for name in example.STYLES:
        time, drive = example.driven(plant, laws[name])
        names = [f"{own} tyre force variation" for own in ("front", "rear")]
        force = drive.response(names).values
        assert (rest + force.min(axis=1)).min() > 0
        # nothing comes before its wheel reaches the bump, the rear one by the wheelbase later
        late = 0.1 + (1.156 + 1.423) / example.SPEED
        for when, road in zip((0.1, late), drive.disturbance.T, strict=True):
            assert not road[time < when - 0.001].any()
            assert road[(time > when) & (time < when + 0.01)].all()
