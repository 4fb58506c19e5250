"""Outputs that do not see enough: which pole no law moves that feeds them back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polefence import HalfPlane, Structure, UncertainPlant
from polefence.base.errors import UnobservableError
from polefence.certify.measured import require_detectable
from polefence.examples import family
from polefence.plant.outputs import Output

# Both are upper triangular with 1 unseen by x2, in the middle at 1 too; x1 sees everything.
HIDDEN = [[[1, 2], [0, -3]], [[1, 1], [0, -4]]]


def plant_of(As, **more):
    return UncertainPlant.from_vertices(As, [[[1], [1]]] * len(As), name="two", **more)


def test_an_unstable_pole_that_is_not_seen_is_named():
    plant = plant_of(HIDDEN)
    x1, x2 = Structure(("x1",)).outputs(plant), Structure(("x2",)).outputs(plant)
    require_detectable(plant, x1)
    with pytest.raises(UnobservableError) as caught:
        require_detectable(plant, x2)
    text = str(caught.value)
    assert (
        "two, vertex 1: not detectable: the measured signals "
        "('x2') do not show the pole 1, " in text
    )
    assert "not stable" in text
    assert text.endswith("measure more, for example also 'x1'")


def test_a_stable_one_is_refused_for_a_region_it_is_not_in():
    plant = plant_of([[[-1, 2], [0, -3]]])
    measured = Structure(("x2",)).outputs(plant)
    require_detectable(plant, measured)
    require_detectable(plant, measured, HalfPlane(0.5))
    with pytest.raises(UnobservableError, match=r"the pole -1, not in half_plane\(2\)"):
        require_detectable(plant, measured, HalfPlane(2))


def test_the_middle_of_the_vertices_is_looked_at_too():
    """The two outputs see all at each vertex, and nothing of x1 in the middle."""
    plant = plant_of([[[1, 0], [0, -2]]] * 2, outputs=(Output("y", C=[[1, 1], [-1, 1]]),))
    with pytest.raises(UnobservableError, match="the middle of its vertices: not detectable"):
        require_detectable(plant, Structure(("y",)).outputs(plant))


def test_a_discrete_plant_is_stable_in_the_unit_circle():
    plant = plant_of([[["1/2", 1], [0, "1/4"]]], sample_time=1)
    require_detectable(plant, Structure(("x2",)).outputs(plant))
    unstable = plant_of([[[-2, 1], [0, "1/4"]]], sample_time=1)
    with pytest.raises(UnobservableError, match="the pole -2"):
        require_detectable(unstable, Structure(("x2",)).outputs(unstable))


def test_the_integral_of_a_car_must_be_measured():
    car = family("quarter-car-level")
    with pytest.raises(UnobservableError, match="the pole 0, not stable"):
        require_detectable(car, Structure(("suspension deflection",)).outputs(car))
    names = ("integral of suspension deflection",)
    require_detectable(car, Structure(names).outputs(car))


@given(st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_what_is_refused_no_output_feedback_moves(seed):
    """A random change of coordinates hides a pole at 1; random gains leave it where it is."""
    random = np.random.default_rng(seed)
    T = random.integers(-3, 4, size=(3, 3)).astype(float)
    if abs(np.linalg.det(T)) < 1:
        T = np.eye(3) + np.triu(T, 1)
    det = round(np.linalg.det(T))
    adjugate = np.round(det * np.linalg.inv(T))
    A = T @ np.diag([1.0, -2.0, -5.0]) @ adjugate  # det times what is similar to the diagonal
    C = (np.array([[0.0, 1.0, 1.0]]) @ adjugate)[0]
    A, C = A * np.sign(det), C
    plant = UncertainPlant.from_vertices(
        [A], [random.normal(size=(3, 1)).round(2) + 1], outputs=(Output("y", C=C),)
    )
    with pytest.raises(UnobservableError, match=f"the pole {abs(det)}, not stable"):
        require_detectable(plant, Structure(("y",)).outputs(plant))
    for gain in random.normal(size=5):
        poles = np.linalg.eigvals(plant.A[0] + gain * plant.B[0] @ C[None])
        assert np.abs(poles - abs(det)).min() < 1e-6 * np.abs(poles).max()
