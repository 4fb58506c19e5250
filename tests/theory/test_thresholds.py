"""Smallest radii known from theory, from both sides; each also proved by its design."""

from __future__ import annotations

import numpy as np
import pytest

from polefence import Disk, NotProvedError, Scheduled, UncertainPlant, check, place, tightest

# Infima at centre -40 from a multiprecision reference, to all digits shown.
REFERENCE = {
    ("as_printed", "quadratic"): 33.6439,
    ("as_printed", "slack"): 33.5019,
    ("as_printed", "scheduled"): 29.0992,
    ("physical", "quadratic"): 34.84241,
    ("physical", "slack"): 34.29901,
    ("physical", "scheduled"): 29.07548,
}


@pytest.mark.parametrize(("family", "method"), REFERENCE)
def test_the_car_at_centre_40(family, method, request):
    infimum = REFERENCE[family, method]
    design = tightest(request.getfixturevalue(family), -40, method)
    assert check(design).proved
    # below the infimum nothing is provable; 5e-6 is the last printed digit
    assert infimum * (1 - 5e-6) <= design.region.radius <= infimum * (1 + 2e-4)


def scalar(a, b):
    return UncertainPlant.from_vertices([[[v]] for v in a], [[[v]] for v in b])


def bracket(plant, centre, method, infimum, slack=2e-4):
    """The smallest radius is ``infimum``: reached from above, refused below."""
    assert tightest(plant, centre, method).region.radius <= infimum * (1 + slack)
    place(plant, Disk(centre, infimum * (1 + slack)), method)
    with pytest.raises(NotProvedError):
        place(plant, Disk(centre, infimum * (1 - slack)), method)


@pytest.mark.parametrize("method", ["quadratic", "slack"])
@pytest.mark.parametrize(("a", "centre"), [((-1, 3), -5), ((0.5, 0.75), -0.1), ((100, 300), -1)])
def test_scalar_pole_interval(method, a, centre):
    """x' = a x + u: a fixed gain shifts the interval of poles, so r = half its length."""
    bracket(scalar(a, (1, 1)), centre, method, (a[1] - a[0]) / 2)


@pytest.mark.parametrize("method", ["quadratic", "slack"])
@pytest.mark.parametrize(("b", "a", "centre"), [((1, 3), 2, -3), ((0.5, 0.6), -1, -4)])
def test_scalar_input_gain(method, b, a, centre):
    """x' = a x + b u: the best fixed gain leaves |a + sigma| (b2 - b1) / (b2 + b1)."""
    bracket(scalar((a, a), b), centre, method, abs(a - centre) * (b[1] - b[0]) / (b[1] + b[0]))


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_a_plant_whose_input_changes_sign_is_not_stabilisable(method):
    """x' = x + b u, b = -1 or 1: no fixed gain moves both poles, and at b = 0 none at all.

    The best disk leaves the pole where it is: r = 1 + sigma, never inside the left half-plane.
    """
    for sigma in (0.5, 4.0):
        bracket(scalar((1, 1), (-1, 1)), -sigma, method, 1 + sigma)


def test_a_plant_that_is_not_quadratically_stabilisable():
    """x' = [[1, 1], [0, 1]] x or its mirror image, input on x2 only where it does not reach.

    Both are controllable; between them the input vanishes, so at alpha = 1/2 the unstable pole
    stays: every disk holds a pole of real part >= 1, whatever the method.
    """
    A = [[[1, 1], [0, 1]]] * 2
    plant = UncertainPlant.from_vertices(A, [[[0], [1]], [[0], [-1]]])
    for method in ("quadratic", "slack", "scheduled"):
        for sigma in (1.0, 10.0):
            assert tightest(plant, -sigma, method).region.radius >= 1 + sigma


def test_scheduling_on_the_state_matrix_alone_cancels_it():
    """x' = a x + u with a scheduled gain: K(alpha) = centre - a(alpha), the radius tends to 0."""
    assert tightest(scalar((-1, 3), (1, 1)), -5, "scheduled").region.radius < 5 * 2e-3


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (3, 1), (3, 2)])
def test_one_vertex_is_pole_placement(method, n, m, make_random):
    """A known, controllable plant: every pole goes to the centre, the radius tends to 0."""
    plant = make_random(7, n, m, 1)
    assert tightest(plant, -2.0, method).region.radius < 0.05 * 2


CASES = [
    (seed, n, m, N)
    for seed, (n, m, N) in enumerate(
        [(2, 1, 2), (3, 2, 2), (2, 2, 3), (3, 1, 3), (2, 1, 5), (3, 2, 5), (2, 2, 8)]
    )
]


@pytest.mark.parametrize(("seed", "n", "m", "N"), CASES)
def test_orderings_that_theory_implies(seed, n, m, N, make_random):
    """Lemma 1 >= Lemma 2, Lemma 1 >= Theorem 1; all proved. (Lemma 2, Theorem 1: no order.)"""
    plant = make_random(seed, n, m, N)
    r = {method: tightest(plant, -3.0, method) for method in ("quadratic", "slack", "scheduled")}
    assert all(check(design).proved for design in r.values())
    radius = {method: design.region.radius for method, design in r.items()}
    assert radius["slack"] <= radius["quadratic"] * (1 + 2e-4)
    assert radius["scheduled"] <= radius["quadratic"] * (1 + 2e-4)
    alpha = np.random.default_rng(seed).dirichlet(np.ones(N), 500)
    for design in r.values():
        assert design.region.contains(design.poles(alpha))


def test_a_plant_where_the_slack_variable_beats_scheduling():
    """Observed orderings of Lemma 2 and Theorem 1 are no law: here Lemma 2 goes farther."""
    A = [[[0, 0], [-1, -4]], [[0, -4], [1, -1]], [[-1, 0], [1, -3]]]
    B = [[[-6], [-3]], [[-2], [-3]], [[-3], [-4]]]
    plant = UncertainPlant.from_vertices(A, B)
    slack = tightest(plant, -3, "slack").region.radius
    assert slack < 0.995 * tightest(plant, -3, "scheduled").region.radius


def test_right_hand_sides_change_little_and_never_for_the_worse(physical, make_random):
    """They relax the conditions: the infimum cannot grow, and at the car's it hardly moves."""
    with_them = tightest(physical, -40, Scheduled(right_hand_sides=True))
    assert check(with_them).proved
    infimum = REFERENCE["physical", "scheduled"]
    assert infimum * (1 - 1e-4) <= with_them.region.radius <= infimum * (1 + 2e-4)


def transformed(plant, T, S, rate):
    inverse = np.linalg.inv(T)
    return UncertainPlant.from_vertices(
        [rate * inverse @ A @ T for A in plant.A], [rate * inverse @ B @ S for B in plant.B]
    )


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_units_and_coordinates_change_no_radius(method, make_random):
    """States and inputs in other units or coordinates: the same r. Time: A, sigma, r together."""
    plant = make_random(2, 3, 2, 2)
    random = np.random.default_rng(5)
    plain = tightest(plant, -3.0, method).region.radius
    units = np.diag([1e-3, 1.0, 1e4])
    turned = np.linalg.qr(random.normal(size=(3, 3)))[0] @ np.diag([1.0, 2.0, 0.3])
    inputs = np.array([[1e3, 0.0], [5.0, 1e-2]])
    for T, S, rate in ((units, np.eye(2), 1.0), (turned, inputs, 1.0), (np.eye(3), np.eye(2), 7.0)):
        other = tightest(transformed(plant, T, S, rate), -3.0 * rate, method).region.radius
        assert np.isclose(other, rate * plain, rtol=2e-4)


def test_radius_is_lipschitz_in_the_centre(as_printed):
    """A disk holds every disk inside it: |r(c1) - r(c2)| <= |c1 - c2|, a check on any sweep."""
    centres = np.arange(-70, -55, 1.5)
    radii = [tightest(as_printed, c, "slack").region.radius for c in centres]
    assert np.all(np.abs(np.diff(radii)) <= 1.5 * (1 + 1e-3))


def test_more_vertices_never_help(make_random):
    plant = make_random(3, 2, 1, 4)
    part = UncertainPlant(plant.vertices[:3])
    for method in ("quadratic", "slack", "scheduled"):
        smaller = tightest(part, -3.0, method).region.radius
        assert smaller <= tightest(plant, -3.0, method).region.radius * (1 + 2e-4)
