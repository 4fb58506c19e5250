"""Measures of laws by the kernel: those of the reference, whatever is asked; no misuse of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import polefence as pf
from polefence.law.structure import Structure
from polefence.lmi.conditions.target import Decays, Disks, Sectors
from polefence.lmi.solve import engine
from polefence.plant.delta import delta_form
from polefence.plant.spec import loads
from polefence.requirements.text import parse_specification
from polefence.search.tune import compiled, measures
from polefence.search.tune.measures import LEVEL, LIMITS, REGION, SMALL, WORST, Ask
from polefence.search.tune.tuner import _of_region, _Search, _task
from support.specs import TWO_MASSES

kernel = engine.kernel()
pytestmark = pytest.mark.skipif(kernel is None, reason="installed without a compiler: no kernel")

PLANT = (
    TWO_MASSES
    + """
[outputs]
push = {C = [0, 1, 0, 0], D = [2, 0]}
"""
)
LINES = (
    "rms of [x1, u, h] <= 2 with density 1",
    "rms of push <= 3 with density 1",
    "rms of [x1, v2] <= 2 with density 1 with weight Wk",
    "energy peak of push <= 2 with norm 1",
    "relative rms of push <= 0.9",
)
OTHERS = ("gain of [x1, u] <= 4", "initial peak of u <= 3 with impulse 1")
REGIONS = {
    "stability": None,
    "two": pf.HalfPlane(0.02) & pf.Sector(0.05),
    "disk": pf.Disk(-2, 1.99),
}
STRUCTURES = {
    "states": Structure(),
    "sensors": Structure(measured=("x1", "v2"), schedule=("m",)),
    "bounded": Structure(
        schedule=(), largest_gain=((1.0, np.inf, 2.0, 3.0), (1.0, 1.0, np.inf, 0.1))
    ),
}


def search(lines, plant=None, structure=None, region=None, minimise=0):
    plant = loads(PLANT) if plant is None else plant
    limits = tuple(map(parse_specification, lines))
    least = None if minimise is None else replace(limits[minimise], at_most=None)
    return _Search(_task(plant, structure or Structure(), least, limits, region))


def asks(own, phase, seed=1, size=0.02, kappa=None):
    random = np.random.default_rng(seed)
    laws = [size * random.normal(size=own.task.unknowns.size) for _ in range(6)]
    laws[1][:] = 1e200  # overflows
    laws[3] *= 1e4  # unstable
    return [
        Ask(theta, phase, unit=0.1 + k, kappa=kappa, most=0.5 + 0.3 * k)
        for k, theta in enumerate(laws)
    ]


def agree(own, monkeypatch, phase, seed=1, size=0.02, kappa=None):
    """Check that both give the same rows, in any order; return those of the kernel."""
    questions = asks(own, phase, seed, size, kappa)
    ours = own.first.answers(questions)
    with monkeypatch.context() as patch:
        patch.setattr(measures, "kernel", lambda: None)
        theirs = own.first.answers(questions)
    assert any(rows is not None for rows in theirs)
    for one, other in zip(ours, theirs, strict=True):
        if phase == WORST:
            assert np.allclose(one, other, rtol=1e-8, atol=1e-10)
            continue
        assert (one is None) == (other is None)
        if one is None:
            continue
        orders = [np.lexsort((rows.values.round(7), rows.groups)) for rows in (one, other)]
        for key in ("values", "slopes", "groups", "objective"):
            left, right = (getattr(r, key)[k] for r, k in zip((one, other), orders, strict=True))
            assert left.dtype == right.dtype
            assert np.allclose(left, right, rtol=1e-6, atol=1e-8), key
    return ours


PHASES = (REGION, LIMITS, LEVEL, SMALL, WORST)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("structure", STRUCTURES)
def test_rows_are_those_of_the_reference(phase, region, structure, monkeypatch):
    own = search(LINES, structure=STRUCTURES[structure], region=REGIONS[region])
    plan = own.first.plan(Ask(np.zeros(0), phase))
    assert plan.rest == ()
    agree(own, monkeypatch, phase)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("first", [0, 1])
def test_what_the_kernel_does_not_know_stands_beside(phase, first, monkeypatch):
    lines = (LINES[0], *OTHERS) if first else (*OTHERS, LINES[0])
    own = search(lines)
    plan = own.first.plan(Ask(np.zeros(0), phase))
    assert len(plan.rest) == (0 if phase == REGION else 2 + (not first and phase != LIMITS))
    agree(own, monkeypatch, phase)


@pytest.mark.parametrize("phase", PHASES)
def test_rows_at_samples_are_those_of_the_reference(phase, monkeypatch):
    plant = delta_form(pf.at_sample_time(loads(PLANT), 0.05, 1))
    lines = ("rms of [x1, v2] <= 9 with density 1", LINES[2])
    agree(search(lines, plant), monkeypatch, phase, size=1e-4)


@pytest.mark.parametrize("kappa", [None, 10.0, 1e4])
@pytest.mark.parametrize("phase", [REGION, LEVEL, WORST])
@pytest.mark.parametrize("goal", [Sectors(1.0), Disks(-2.0), Decays(1.0, pf.Disk(-5, 5))], ids=str)
def test_regions_that_grow_are_measured_too(goal, phase, kappa, monkeypatch):
    own = _Search(_of_region(loads(PLANT), Structure(), goal, ()))
    agree(own, monkeypatch, phase, kappa=kappa)


@pytest.mark.parametrize("kappa", [10.0, 300.0, 1e4])
@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("structure", STRUCTURES)
def test_smooth_regions_are_those_of_the_reference(structure, region, kappa, monkeypatch):
    own = search(LINES[:1], structure=STRUCTURES[structure], region=REGIONS[region])
    agree(own, monkeypatch, REGION, kappa=kappa)


def test_the_size_of_a_law_is_measured_too(monkeypatch):
    agree(search(LINES[:2], minimise=None), monkeypatch, LEVEL)


@pytest.mark.parametrize("seed", range(8))
def test_rows_of_random_plants_are_those_of_the_reference(seed, make_random, monkeypatch):
    n, m = 2 + seed % 5, 1 + seed % 3
    plant = make_random(seed, n, m, 1 + seed % 4)
    E = np.random.default_rng(seed).normal(size=(n, 2))
    stable = [A - (0.5 + np.linalg.eigvals(A).real.max()) * np.eye(n) for A in plant.A]
    plant = pf.UncertainPlant.from_vertices(stable, list(plant.B), Es=[E] * len(stable))
    lines = ("rms of [x1, u1] <= 2 with density 1", "energy peak of x1 <= 2 with norm 1")
    own = search(lines, plant, region=pf.HalfPlane(0.01) & pf.Sector(0.01))
    for phase in PHASES:
        agree(own, monkeypatch, phase, seed)
    agree(own, monkeypatch, REGION, seed, kappa=300.0)


def test_a_point_without_modes_is_left_to_the_reference(monkeypatch):
    """Four poles in one place, of one eigenvector: no equation can be solved by modes."""
    chain = np.diag([1e3] * 3, 1) - np.eye(4)
    plant = pf.UncertainPlant.from_vertices([chain], [np.eye(4)[:, 3:]], Es=[np.eye(4)[:, 3:]])
    own = search(("rms of x1 <= 2 with density 1",), plant, Structure(schedule=()))
    asked = [Ask(np.zeros(own.task.unknowns.size), LIMITS)]
    plan = own.first.plan(asked[0])
    modes, one = own.first.modes(np.zeros((1, 1, 4))), np.ones(1)
    rows, hard = plan.rows(1, np.zeros((1, 1, 4)), modes, one, one)
    assert (rows, hard) == ([None], [0])
    ours = own.first.answers(asked)[0]
    monkeypatch.setattr(measures, "kernel", lambda: None)
    theirs = own.first.answers(asked)[0]
    assert np.array_equal(ours.values, theirs.values)
    assert ours.level > 0


def test_rows_do_not_depend_on_the_laws_beside():
    own = search(LINES)
    questions = asks(own, LEVEL)
    together = own.first.answers(questions)
    for question, rows in zip(questions, together, strict=True):
        alone = own.first.answers([question])[0]
        if rows is not None:
            assert np.allclose(alone.slopes, rows.slopes, rtol=1e-12, atol=1e-14)


def arguments():
    """What the kernel takes of one law at the four corners, as `Plan` asks it."""
    own, kept = search(LINES[:3], region=REGIONS["two"]), {}

    def listen(*args):
        kept["args"] = args
        return kernel.rows(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "kernel", lambda: SimpleNamespace(rows=listen))
        own.first.answers([asks(own, REGION, kappa=10.0)[0]])
        curves = kept["args"][-3]
        own.first.answers([asks(own, LEVEL)[0]])
    kept["args"] = (*kept["args"][:-3], curves, *kept["args"][-2:])
    names = "laws step fastest needs_decay first slopes K C term pattern largest weight unit most"
    names += " modes sources noises sides curves measures bends"
    return dict(zip(names.split(), kept["args"], strict=True))


def other(array, axis):
    """An array that is one longer along an axis."""
    return np.concatenate([array, array.take([0], axis=axis)], axis=axis)


def spoilt():
    given = arguments()
    yield "laws", {"laws": 0}
    yield "laws", {"laws": 3}
    yield "laws", {"modes": []}
    for key in ("C", "term", "pattern", "largest", "weight", "unit", "most"):
        yield "the law does not fit", {key: other(given[key], 0)}
    for key in ("modes", "sources", "noises", "sides"):
        own = list(given[key])
        for part, value in enumerate(own[0]):
            axes = value.ndim if isinstance(value, np.ndarray) else 0
            for axis in range(axes):
                if (key, part, axis) == ("sources", 1, 2):  # there may be any number of them
                    continue
                changed = list(own[0])
                changed[part] = other(value, axis)
                yield "fit|one row or two", {key: [tuple(changed), *own[1:]]}
            if not axes:
                for number in (-1, 99):
                    yield "fit", {key: [(number, *own[0][1:]), *own[1:]]}
    yield "a curve does not fit", {"curves": other(given["curves"], 1)}
    for number in (-1.0, 99.0):
        curves = given["curves"].copy()
        curves[0, 0] = number
        yield "a curve does not fit", {"curves": curves}
    for column, values in ((0, (-1, 6)), (1, (-1, 99)), (3, (-1, 3))):
        for value in values:
            measures = given["measures"].copy()
            measures[:, column] = value
            yield "no such measure", {"measures": measures}
    yield "measures", {"bends": other(given["bends"], 0)}
    yield "measures", {"measures": other(given["measures"], 1)}


@pytest.mark.parametrize("number", range(len(list(spoilt())) if kernel else 0))
def test_what_does_not_fit_is_refused(number):
    said, changes = list(spoilt())[number]
    kernel.rows(**arguments())
    with pytest.raises(ValueError, match=said):
        kernel.rows(**(arguments() | changes))
