"""degree="auto" in its three answers, and four independent parameters at once."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import (
    Disk,
    InputError,
    NotProvedError,
    Parameter,
    Scheduled,
    UncertainPlant,
    build,
    check,
    place,
    tightest,
)
from polefence.region.regions import HalfPlane, Sector
from support.paths import ROOT

AUTO = Scheduled(degree="auto")


def mirrored():
    """x' = [[1, 1], [0, 1]] x + b u, b = [0, 1]' or its opposite: at one half there is no input."""
    A = [[1, 1], [0, 1]]
    return UncertainPlant.from_vertices([A, A], [[[0], [1]], [[0], [-1]]])


def turning():
    """A spiral whose input turns from e1 by e2 to -e1: gone on the diagonal, never on the box."""
    B = [[[1], [0]], [[0], [1]], [[0], [1]], [[-1], [0]]]
    box = (Parameter("p", 0, 1), Parameter("q", 0, 1))
    return replace(UncertainPlant.from_vertices([[[1, -2], [2, 1]]] * 4, B), parameters=box)


def test_a_disk_that_only_degree_2_reaches(as_printed):
    """(1, 1) gets to 29.10, (2, 0) to 27.22: the first that proves it is degree 2."""
    design = place(as_printed, Disk(-40, 28.5), AUTO)
    assert check(design).proved
    assert design.law.degree == 2


def test_the_lowest_degree_is_tried_first(as_printed):
    assert place(as_printed, Disk(-40, 34), AUTO).method == "quadratic"
    assert place(as_printed, Disk(-40, 30), AUTO).law.degree == 1


def test_a_mode_that_no_gain_moves_refutes(make_random):
    plant = mirrored()
    assert not any(vertex.fixed.count for vertex in plant.vertices)
    for region in (Disk(-3, 2.9), HalfPlane(0), Sector(0.1), Disk(-3, 4)):
        with pytest.raises(NotProvedError, match=r"refuted: at alpha = \(1/2, 1/2\)") as caught:
            place(plant, region, AUTO)
        assert caught.value.best is None
    # it is true: there A + B K = A for every K
    A, B = plant.at([0.5, 0.5])
    assert not B.any()
    assert np.allclose(np.linalg.eigvals(A), 1)


@pytest.mark.parametrize("region", [Disk(-3, 4.5), HalfPlane(-2)], ids=str)
def test_a_mode_that_no_gain_moves_does_no_harm_inside_the_region(region):
    assert place(mirrored(), region, AUTO).proved


def test_the_mode_lies_at_an_irrational_point_or_off_the_box():
    """What is refuted on the simplex need not be so on the box, which is smaller."""
    plant, region = turning(), Disk(-3, 3.9)
    with pytest.raises(NotProvedError, match=r"refuted: at alpha = \(1/2, 0, 0, 1/2\)"):
        place(plant, region, AUTO)
    design = place(plant, region, replace(AUTO, on="box"))
    assert check(design).proved
    assert design.law.sizes == (2, 2)


def test_an_input_that_vanishes_at_an_irrational_alpha_is_not_refuted():
    """b = -1 to 2 vanishes at 1/3, found; sqrt(2) - 1 is met by no fraction: then undecided."""
    third = UncertainPlant.from_vertices([[[1]], [[1]]], [[[-1]], [[2]]])
    with pytest.raises(NotProvedError, match=r"refuted: at alpha = \(2/3, 1/3\)"):
        place(third, HalfPlane(0), AUTO)
    root = Fraction(2**0.5)
    never = UncertainPlant.from_vertices([[[1]], [[1]]], [[[-1]], [[root]]])
    with pytest.raises(NotProvedError, match="undecided"):
        place(never, HalfPlane(0), AUTO)


def test_a_small_budget_leaves_it_undecided_with_the_best_so_far(as_printed):
    with pytest.raises(NotProvedError, match="undecided: not proved for disk") as caught:
        place(as_printed, Disk(-40, 28), replace(AUTO, budget=1e-6))
    message, best = str(caught.value), caught.value.best
    assert "(0, 0); the budget" in message  # one step is always made
    assert best.proved
    assert 33.6 < best.region.radius < 33.7


def test_auto_is_for_place():
    plant = mirrored()
    with pytest.raises(InputError, match="auto"):
        tightest(plant, -3, AUTO)
    with pytest.raises(InputError, match="auto"):
        build(AUTO, plant.A, plant.B, 3.0)


# --- four parameters -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two_masses():
    """The plant of the benchmark, from the benchmark."""
    path = ROOT / "benchmarks" / "degrees.py"
    spec = importlib.util.spec_from_file_location("degrees", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.two_masses()


def test_the_corners_are_the_two_masses(two_masses):
    """Against Newton's law at random parameters, through alpha."""
    random = np.random.default_rng(1)
    for _ in range(5):
        m1, k, c, e = random.uniform([0.8, 0.5, 0.01, 0.8], [1.2, 2, 0.1, 1])
        A, B = two_masses.at(two_masses.alpha(m1=m1, k=k, c=c, e=e))
        force = np.array([k, -k, c, -c])
        assert np.allclose(A, [[0, 0, 1, 0], [0, 0, 0, 1], -force / m1, force])
        assert np.allclose(B.ravel(), [0, 0, e / m1, 0])


def test_four_parameters_at_once(two_masses):
    """16 vertices; on the box 81 blocks place the poles in a stable disk that one gain misses."""
    method = Scheduled(1, 0, "box")
    design = tightest(two_masses, -1.5, method)
    assert check(design).proved
    assert len(build(method, two_masses.A, two_masses.B, 1.5).blocks) == 3**4
    assert 1.24 < design.region.radius < 1.2502
    assert design.region.stable
    for fixed, radius in (("quadratic", 1.80), ("slack", 1.67)):
        assert tightest(two_masses, -1.5, fixed).region.radius > radius
    random = np.random.default_rng(2)
    values = random.uniform([0.8, 0.5, 0.01, 0.8], [1.2, 2, 0.1, 1], (300, 4))
    for m1, k, c, e in values:
        own = {"m1": m1, "k": k, "c": c, "e": e}
        A, B = two_masses.at(two_masses.alpha(**own))
        poles = np.linalg.eigvals(A + B @ design.law.gain_at(**own))
        assert design.region.contains(poles)
