"""The map: cells where poles leave the region are those where they do."""

from dataclasses import replace

import numpy as np
import pytest

from polefence import Disk, HalfPlane, place
from polefence.studio import State
from polefence.studio.map import SIDE, Map
from polefence.studio.palette import LIGHT
from support.studios import subject, written


@pytest.fixture
def chosen():
    return []


@pytest.fixture
def own(physical, chosen):
    return Map(physical, LIGHT, chosen.append)


def test_of_a_proved_law_no_car_leaves_the_region(physical, own):
    design = place(physical, Disk(-40, 31))
    assert own.show(design, design.region, State.first(subject(), design.region)) == 0


def test_cells_are_marked_where_the_poles_of_their_cars_are_outside(physical, own):
    design = place(physical, Disk(-40, 31))
    region = Disk(-40, 28.5)
    count = own.show(design, region, State.first(subject(), region))
    assert 0 < count < SIDE**2
    cells = own.cells.data
    for x, y, colour in zip(cells["x"], cells["y"], cells["colour"], strict=True):
        poles = design.poles(physical.alpha(m1=x, beta=y))
        assert (colour == LIGHT.looked) == (not region.contains(poles))


def test_the_python_counts_the_cells_of_the_map(physical, own):
    design, region = place(physical, Disk(-40, 31)), Disk(-40, 28.5)
    count = own.show(design, region, State.first(subject(), region))
    found = {"plant": physical, "design": design, "region": region}
    exec(own.python(State.first(subject(), region)), found)
    assert found["inside"].shape == (SIDE**2,)
    assert 0 < (~found["inside"]).sum() == count


THREE = """
states = ["x", "v"]
inputs = ["u"]
[parameter.plant]
range = [1, 2]
[parameter.np]
range = [1, 2]
[parameter.design]
range = [0.1, 2]
[matrices]
A = [[0, 1], ["-plant", "-np"]]
B = [[0], ["design"]]
"""


def test_the_python_has_the_values_of_what_is_not_in_the_map(tmp_path):
    whole = written(tmp_path, THREE)
    law = place(whole.plant, HalfPlane(0.7))
    pane = Map(whole.plant, LIGHT, print)
    worst = [law.poles(whole.plant.alpha(plant=1.5, np=1.5, design=d)).real.max() for d in (0.1, 2)]
    region = HalfPlane(-sum(worst) / 2)
    counts = []
    for value in (0.1, 2.0):
        state = State.first(whole, region).at("design", value)
        counts.append(pane.show(law, region, state))
        found = {"plant": whole.plant, "design": law, "region": region}
        exec(pane.python(state), found)
        assert (~found["inside"]).sum() == counts[-1]
    assert counts[0] != counts[1]


def test_the_cells_fill_the_box(physical, own):
    m1, beta = physical.parameters
    for key, p in (("x", m1), ("y", beta)):
        values = np.unique(own.cells.data[key])
        half = (float(p.high) - float(p.low)) / SIDE / 2
        assert values[0] - half == pytest.approx(float(p.low))
        assert values[-1] + half == pytest.approx(float(p.high))


def test_units_are_no_formulas(physical):
    m1, beta = physical.parameters
    hostile = replace(physical, parameters=(replace(m1, unit=r"$$\text{kg}$$ \(x\)"), beta))
    label = Map(hostile, LIGHT, print).figure.xaxis[0].axis_label
    assert not any(own in label for own in ("$$", r"\(", r"\)", r"\["))
    assert "kg" in label


def test_what_is_pointed_at_is_chosen_within_the_box(own, chosen):
    class Event:
        x, y = 250.0, -5.0

    own._tapped(Event)
    Event.x, Event.y = 1e9, -1e9
    own._tapped(Event)
    assert chosen[0] == {"m1": 250.0, "beta": -5.0}
    assert chosen[1] == {"m1": pytest.approx(346.68), "beta": -10.0}
