"""Signals that are given as outputs, where a plant grows by the states of a law or of a filter."""

import pytest

from polefence import InputError, optimise
from polefence.examples import spec_text
from polefence.law.structure import Structure
from polefence.plant.outputs import Output, weighted_sum
from polefence.plant.spec import loads
from polefence.requirements.named import by_name
from polefence.requirements.rms import Rms


@pytest.fixture(scope="module")
def plant():
    return loads(spec_text("semi-active"))


def signals_of(plant):
    acceleration = plant.signal("sprung-mass acceleration")
    tyre = weighted_sum("tyre in decimetres", "dm", [(10, plant.signal("tyre deflection"))])
    return acceleration, tyre


def test_a_law_with_states_takes_outputs_as_it_takes_names(plant):
    acceleration, tyre = signals_of(plant)
    structure = Structure(order=1, measured=("suspension deflection",), schedule=())
    done = optimise(plant, Rms([acceleration, tyre], density=1e-4), structure=structure)
    larger, (asked,) = by_name(plant, (Rms([acceleration, tyre], density=1e-4),))
    named = optimise(larger, asked, structure=structure)
    assert done.plant.shape[0] == plant.shape[0] + 1
    assert done.bounds[0].level == named.bounds[0].level


def test_a_vector_may_have_an_output_behind_a_filter_and_one_without(plant):
    acceleration, tyre = signals_of(plant)
    asked = Rms([acceleration, tyre], density=1e-4, weight=["Wk", "none"])
    done = optimise(plant, asked, structure=Structure(order=1, schedule=()))
    assert done.bounds[0].level > 0


def test_an_output_with_the_name_of_another_signal_is_refused(plant):
    other = Output("tyre deflection", "m", [1, 0, 0, 0])
    with pytest.raises(InputError, match="has another signal 'tyre deflection'; give this output"):
        by_name(plant, (Rms(other, density=1.0),))


def test_names_and_known_signals_leave_the_plant_as_it_is(plant):
    known = plant.signal("tyre deflection")
    same, (one, other) = by_name(plant, (Rms("tyre deflection"), Rms(known, at_most=1.0)))
    assert same is plant
    assert (one.signal, other.signal, other.at_most) == ("tyre deflection", "tyre deflection", 1.0)
