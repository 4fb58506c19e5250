"""More freedom or fewer limits never lead to a worse answer: random plants, each answer proved."""

from dataclasses import replace

import numpy as np
import pytest

import polefence as pf
from polefence.certify.bounds import sampled
from polefence.plant.points import seeded
from polefence.search import structured

ROUNDING = 1 + 1e-3  # searches and proofs end that near to their end


def drawn(seed):
    """A stable plant with two parameters, and limits that a gain of zero keeps."""
    random = np.random.default_rng([7, seed])
    n, names = 2 + seed % 2, ("p", "q")
    middle, *more = np.round(random.normal(size=(3, n, n)), 3)
    more = [0.3 * M for M in more]
    signs = [(a, b) for a in (-1, 1) for b in (-1, 1)]
    corners = np.array([middle + a * more[0] + b * more[1] for a, b in signs])
    middle -= np.eye(n) * round(np.linalg.eigvals(corners).real.max() + 0.4, 3)
    terms = list(zip(("1", *names), (middle, *more), strict=True))
    A = [[" + ".join(f"({M[i, j]:.5f})*{p}" for p, M in terms) for j in range(n)] for i in range(n)]
    B, E = (np.round(random.normal(size=(n, 1)), 3).tolist() for _ in "BE")
    plant = pf.UncertainPlant.from_expressions(
        [pf.Parameter(p, -1, 1) for p in names],
        A,
        B,
        E,
        states=tuple(f"x{k + 1}" for k in range(n)),
        inputs=("u",),
    )
    alpha = seeded(plant, 50)
    least = pf.Rms("x1", density=2.0)
    free = sampled(plant, pf.FixedGain(np.zeros((1, n))), pf.Rms("x2", density=2.0), alpha).worst
    own = sampled(plant, pf.FixedGain(np.zeros((1, n))), least, alpha).worst
    limits = pf.Rms("u", float(f"{own:.3g}"), density=2.0), pf.Rms("x2", 1.2 * free, density=2.0)
    return plant, least, limits


ONE = pf.Structure(schedule=())


@pytest.mark.parametrize("seed", [1, 2])  # 0 to 3 were tried
def test_more_freedom_or_fewer_limits_are_never_worse(seed):
    plant, least, limits = drawn(seed)

    def level(structure, limits=limits):
        done = pf.optimise(plant, least, limits, structure=structure)
        worst = sampled(done.plant, done.law, least, seeded(plant, 500)).worst
        assert worst <= done.bounds[0].level * (1 + 1e-6)
        return done.bounds[0].level

    one = level(ONE)
    assert level(ONE, limits[:1]) <= one * ROUNDING
    assert one <= level(replace(ONE, measured=("x1",))) * ROUNDING
    affine = level(pf.Structure())
    assert affine <= one
    assert affine <= level(pf.Structure(schedule=("p",))) * ROUNDING
    if seed == 2:
        assert level(pf.Structure(degree=2)) <= affine


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_limits_that_do_not_bind_change_nothing(method):
    plant, least, limits = drawn(1)
    own = pf.optimise(plant, least, limits, method=method)
    wide = [pf.Rms("x1", 50 * own.bounds[0].level, density=2.0)]
    if method == "quadratic":  # of a law Z W^-1 whose W is nearly singular no norm is proved
        wide.append(pf.GainNorm(1e12))
    for more in wide:
        found = pf.optimise(plant, least, (*limits, more), method=method)
        assert found.bounds[0].level == pytest.approx(own.bounds[0].level, rel=1e-3)


def test_a_higher_order_is_never_worse_and_leaves_out_states_that_do_nothing():
    plant, least, limits = drawn(1)
    levels, count = [], []
    for order in (0, 1, 2):
        done = pf.optimise(
            plant, least, limits, structure=replace(ONE, measured=("x1",), order=order)
        )
        levels.append(done.bounds[0].level)
        count.append(done.plant.shape[0] - plant.shape[0])
    assert np.all(np.diff(levels) <= 1e-3 * levels[0])
    for k in (1, 2):  # a state is worth a thousandth, or is not there
        assert count[k] == 0 or levels[k] < levels[k - 1] * (1 - 5e-4) or count[k] == count[k - 1]
    assert count[2] < 2 or levels[2] < levels[1]


UNITS = [((1e5, 1e-5), 1.0), ((1e-5, 1e5), 1e-3), ((1.0, 1.0), 1e4)]


@pytest.mark.parametrize("how", ["quadratic", "scheduled", ONE], ids=str)
def test_the_same_plant_in_other_units_has_the_same_answer(how):
    plant, _, limits = drawn(2)
    asked = {"structure": how} if isinstance(how, pf.Structure) else {"method": how}

    def level(sizes, u):
        d = np.array(sizes)
        each = [
            (v.A * d / d[:, None], v.B * u / d[:, None], v.E / d[:, None]) for v in plant.vertices
        ]
        own = pf.UncertainPlant.from_vertices(*map(list, zip(*each, strict=True)))
        force = pf.Rms("u1", limits[0].at_most / u, density=2.0)
        second = pf.Rms("x2", limits[1].at_most / d[1], density=2.0)
        return pf.optimise(own, pf.Rms("x1", density=2.0), [force, second], **asked).bounds[0].level

    same = level((1.0, 1.0), 1.0)
    for sizes, u in UNITS:
        assert level(sizes, u) * sizes[0] == pytest.approx(same, rel=1e-3), (sizes, u)


# --- the smallest region -------------------------------------------------------------------------


def loop(seed):
    """Two states of which one is measured, a row of A uncertain by 20 %."""
    random = np.random.default_rng(seed)
    A, B = random.standard_normal((2, 2)).round(3), random.standard_normal((2, 1)).round(3)
    other = A * [[1.2], [1]]
    names = {"states": ["x0", "x1"], "inputs": ["u"]}
    return pf.UncertainPlant.from_vertices([A, other], [B, B], **names)


def smallest(plant, order):
    structure = pf.Structure(measured=("x0",), order=order, schedule=(), largest_gain=20)
    return pf.tightest(plant, -2.0, structure=structure)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_disk_of_a_higher_order_is_no_larger(seed):
    plant = loop(seed)
    radii = [smallest(plant, order).region.radius for order in (0, 1)]
    assert radii[1] <= radii[0]


def test_a_disk_is_that_of_the_lower_order_where_no_higher_is_better(monkeypatch):
    plant, search = loop(1), structured.Sought.tightest
    lower = smallest(plant, 0)
    for found in (None, lower):
        monkeypatch.setattr(
            structured.Sought,
            "tightest",
            lambda own, *rest, found=found: found if own.structure.order else search(own, *rest),
        )
        done = smallest(plant, 2)
        assert done.region == lower.region
        assert done.plant.shape == plant.shape
