"""Chains of masses, whose Lyapunov matrices are far from any coordinates that one starts in."""

import runpy

import numpy as np
import pytest

from polefence import tightest
from polefence.base.kernel import kernel
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import interior_point, smallest
from polefence.lmi.solve.smallest import smallest as search
from support.paths import FAMILIES

masses = runpy.run_path(str(FAMILIES))["masses"]
ENGINES = ["numpy", pytest.param("compiled", marks=pytest.mark.skipif(not kernel(), reason="pure"))]
# What the last mass alone has at this centre, where springs are as good as nothing
ONE_MASS = 40 * np.sqrt(0.2)


@pytest.mark.parametrize(("count", "engine"), [(3, "numpy"), (3, None), (6, None), (7, None)])
def test_the_last_mass_alone_decides(count, engine):
    """Six masses ended at 30.6, where in its own coordinates the gap is zero."""
    plant = masses(count)
    found = search(plant.A, plant.B, Disks(-40.0), "quadratic", engine=engine)
    assert found.converged
    assert np.isclose(found.r, ONE_MASS, rtol=2e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_ends_where_its_coordinates_have_no_digits_left(engine):
    """The first run takes all its iterations in steps of nothing."""
    plant = masses(3)
    found = search(plant.A, plant.B, Disks(-10.0), "quadratic", engine=engine)
    assert found.converged
    assert len(found.trails) > 1
    assert all(len(own.r) <= interior_point.MAX_ITERATIONS for own in found.trails)


def test_an_end_far_from_its_coordinates_is_looked_at_again(monkeypatch):
    """With every end far, the second run finds no smaller radius, and the first one counts."""
    plant = masses(2)
    once = search(plant.A, plant.B, Disks(-10.0), "quadratic")
    assert len(once.trails) == 1
    monkeypatch.setattr(smallest, "FAR", 0.0)
    again = search(plant.A, plant.B, Disks(-10.0), "quadratic")
    assert len(again.trails) > 1
    assert np.isclose(again.r, once.r, rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_every_point_of_the_trail_is_one_at_its_radius(engine):
    """|T^-1 (A + B K + sigma I) T| < r for W = T T', at every vertex; the least r comes first."""
    plant = masses(3)
    found = search(plant.A, plant.B, Disks(-10.0), "quadratic", engine=engine)
    path = found.path()
    assert path[0].r == found.r
    assert [p.r for p in path] == sorted(p.r for p in path)
    assert path[-1].r > 1.5 * found.r
    for point in path:
        W, Z = point.values["W"], point.values["Z"]
        T = np.linalg.cholesky(W)
        for A, B in zip(plant.A, plant.B, strict=True):
            closed = A + 10.0 * np.eye(len(A)) + B @ np.linalg.solve(W, Z.T).T
            assert np.linalg.norm(np.linalg.solve(T, closed @ T), 2) < point.r * (1 + 1e-6)


def test_where_the_end_is_too_near_the_edge_a_point_on_the_way_is_proved():
    """The radius is below 0.2, where it was 0.47 from points for radii ten times as large."""
    design = tightest(masses(3), -10.0, "scheduled")
    assert design.certificate.prove().proved
    assert design.runs
    assert design.region.radius < 0.2
