"""Conditions stacked at once against the same conditions written one inequality at a time."""

import numpy as np
import pytest

from polefence.lmi.conditions.methods import design
from polefence.lmi.conditions.performance import Demands, Noise, Output, Points, Through, noise
from polefence.lmi.conditions.target import NO_REGION, Target, fixed
from polefence.lmi.solve.assembly import stacked_design
from polefence.lmi.solve.stacked import stack
from polefence.plant.polynomial import Domain
from polefence.region.regions import Disk, HalfPlane, Sector

REGION = HalfPlane(0.3) & Sector(0.2) & Disk(-2, 5)
# domain, vertices, degree, elevation
FORMS = [("box", 4, 0, 0), ("box", 4, 1, 0), ("box", 2, 2, 1), ("simplex", 3, 1, 1)]


def constant_noise(source, domain, N, n):
    return noise("w", domain, np.tile(source.normal(size=(n, 2)), (N, 1, 1)), 0.7)


def noise_without_root(source, domain, N, n):
    own = constant_noise(source, domain, N, n)
    return Noise(own.name, own.EE)


def uncertain_noise(source, domain, N, n):
    E = source.normal(size=(N, n, 2))
    E[:, -1] = 0
    return noise("w", domain, E, 0.7)


def points(source, domain, N, n):
    X0 = source.normal(size=(n, n))
    return Points("w", tuple(source.normal(size=(2, N, n, 1))), X0 @ X0.T)


def ellipsoid(source, domain, N, n):
    return Points("w", (), np.diag([1.0, *(n - 2) * [0.0], 2.0]))


def through(source, domain, N, n):
    return Through("w", source.normal(size=(N, n, 2)))


SOURCES = [constant_noise, noise_without_root, uncertain_noise, points, ellipsoid, through]


def of(kind, form, target, margin):
    """Return the condition written both ways, of three states and two inputs."""
    on, N, degree, elevation = form
    source, domain, n, m = np.random.default_rng(7), Domain.of(on, N), 3, 2
    A, B = source.normal(size=(N, n, n)), source.normal(size=(N, n, m))
    moved = () if kind is None else (kind(source, domain, N, n),)
    outputs = []
    for rows, is_fixed in ((1, True), (2, False)) if moved else ():
        C, D = source.normal(size=(N, rows, n)), source.normal(size=(N, rows, m))
        F = source.normal(size=(N, rows, 2)) if kind is through and is_fixed else None
        outputs.append(Output(f"y{rows}", "w", C, D, 1.7, is_fixed, F))
    demands = Demands(target, moved, tuple(outputs), (), margin)
    arguments = A, B, demands, domain, degree, elevation
    return design(*arguments), *stacked_design(*arguments)


def sorted_blocks(pairs):
    """Blocks of each size in one order, whichever they were written in."""
    found = []
    for D, M in pairs:
        both = np.concatenate([D.reshape(len(D), -1), M.reshape(len(M), -1)], axis=1)
        found.append(both[np.lexsort(both.round(9).T)])
    return found


@pytest.mark.parametrize("form", FORMS, ids=str)
@pytest.mark.parametrize("kind", SOURCES)
@pytest.mark.parametrize("region", [False, True])
def test_both_ways_are_one_condition(kind, form, region):
    target = Target(fixed(REGION, 2.0)) if region else NO_REGION
    pencil, variables, stacked = of(kind, form, target, 1e-3 if region else 0.0)
    assert variables.variables == pencil.variables
    assert stacked.unknowns == pencil.unknowns
    x = np.random.default_rng(3).normal(size=pencil.unknowns)
    theirs, ours = stack(pencil), stacked
    assert ours.sizes == theirs.sizes
    for mine, other in zip(sorted_blocks(ours.at(x)), sorted_blocks(theirs.at(x)), strict=True):
        assert np.allclose(mine, other, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_region_alone_is_one_condition(form):
    target = Target(fixed(REGION, 2.0), positive=True)
    pencil, _, stacked = of(None, form, target, 0.0)
    x = np.random.default_rng(3).normal(size=pencil.unknowns)
    pairs = zip(sorted_blocks(stacked.at(x)), sorted_blocks(stack(pencil).at(x)), strict=True)
    for mine, other in pairs:
        assert np.allclose(mine, other, rtol=1e-12, atol=1e-12)


def test_gradients_are_those_of_the_blocks():
    """<P, r D(x) - M(x)> is linear in x; written without sparse matrices it is the same."""
    _, _, stacked = of(uncertain_noise, FORMS[1], NO_REGION, 0.0)
    source = np.random.default_rng(5)
    P = [X + X.swapaxes(1, 2) for X in (source.normal(size=D.shape) for D, _ in stacked.at(
        np.zeros(stacked.unknowns)))]  # fmt: skip
    x = source.normal(size=stacked.unknowns)
    expected = sum(np.vdot(p, 1.3 * D - M) for p, (D, M) in zip(P, stacked.at(x), strict=True))
    assert np.isclose(stacked.gradient(P, 1.3, -1.0) @ x, expected, rtol=1e-10)
    assert np.allclose(stacked.gradient(P, 1.3, -1.0), stacked.adjoint(1.3, P))
