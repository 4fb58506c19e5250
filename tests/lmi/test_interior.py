"""The first point of a search: the least power of two at which a pencil is positive definite."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from polefence import HalfPlane, Scheduled
from polefence.base.kernel import kernel
from polefence.examples import family
from polefence.lmi.conditions.pencil import Variable
from polefence.lmi.conditions.target import Around
from polefence.lmi.solve import inside, search
from polefence.lmi.solve.performance import Problem
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import coefficients
from polefence.lmi.solve.smallest import smallest, typical_rate
from polefence.plant.polynomial import Domain
from polefence.requirements.rms import Rms


def blocks(seed):
    """Blocks r D - M that hold from some r on, D of any rank, and M < 0 where D is zero."""
    source = np.random.default_rng(seed)
    U = np.linalg.qr(source.normal(size=(4, 4)))[0]
    rank = int(source.integers(0, 5))
    D = U[:, :rank] @ np.diag(2.0 ** source.uniform(-3, 3, rank)) @ U[:, :rank].T
    M = source.normal(size=(4, 4)) * 2.0 ** source.uniform(-10, 20)
    return [(D[None], (U[:, :rank] @ U[:, :rank].T @ (M + M.T) @ U[:, :rank] @ U[:, :rank].T
        - U[:, rank:] @ U[:, rank:].T)[None])]  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_the_least_power_is_the_first_of_all(seed):
    own = blocks(seed)
    holds = [inside._positive([r * D - M for D, M in own]) for r in inside.POWERS]
    first = next((r for r, yes in zip(inside.POWERS, holds, strict=True) if yes), None)
    assert first is not None
    assert inside.least_power(own) == first


class Line:
    """A pencil of one scalar t, whose only block is never positive: M has a direction without D."""

    variables = (Variable("t", (1, 1), rows=""),)

    def pack(self, values):
        return np.zeros(1)

    def at(self, x):
        return [(np.diag([1.0, 0.0])[None], np.diag([1.0, 1.0])[None])]


def test_where_there_is_no_point_few_are_tried(monkeypatch):
    """Five of six evaluations in a search of the least gain norm of a large law were these."""
    tried = []
    positive = inside._positive
    monkeypatch.setattr(inside, "_positive", lambda own: tried.append(1) or positive(own))
    monkeypatch.setattr("polefence.base.kernel._kernel", None)
    assert search.interior(Line(), Line(), {}, {}) == (None, 0.0)
    assert len(tried) < inside.HALVINGS * 12


# --- the kernel ----------------------------------------------------------------------------------


def ride(seed, degree):
    """The LMI of a ride: W and Z of a region's search, and a scalar of which much is too much."""
    source = np.random.default_rng(seed)
    plant, domain = family("quarter-car-ride"), Domain.of("box", 4)
    limits = [Rms("tyre deflection", 4.7e-3, 1e-3), Rms("actuator force", 700.0, 1e-3)]
    asked = [own.condition(plant, domain) for own in limits]
    asked.append(Rms("sprung-mass acceleration", None, 1e-3).condition(plant, domain, 1.0))
    outputs = tuple(output for _, output in asked)
    A, B, sources = plant.A, plant.B, (asked[0][0],)
    problem = Problem(A, B, sources, outputs, HalfPlane(1), domain, degree, 0)
    method = Scheduled(1, 0, "box") if degree else "quadratic"
    found = smallest(A, B, Around(HalfPlane(1)), method, enough=float(source.uniform(0.6, 0.95)))
    W, Z = (coefficients(found.values, name) for name in "WZ")
    values = {f"W{k + 1}": own for k, own in enumerate(W)}
    values |= {f"Z{k + 1}": own for k, own in enumerate(Z)}
    scaling = balanced(A, B, typical_rate(A)).refined(W.mean(axis=0))
    wide = [replace(o, level=o.level * 10 ** source.uniform(-1, 3)) for o in outputs]
    fixed = tuple(replace(o, fixed=bool(source.integers(2))) for o in wide)
    pencil, stacked = problem.pencil(scaling, fixed, (), values)
    scaled = scaling.scaled(values, tuple(v for v in pencil.variables if v.rows))
    zero = {v.name: np.zeros(v.shape) for v in pencil.variables}
    one = {v.name: np.ones((1, 1)) for v in pencil.variables if not v.rows}
    return stacked, pencil.pack(zero | scaled), 2.0 ** source.integers(20) * pencil.pack(zero | one)


def holds(stacked, x, r):
    return all(np.linalg.eigvalsh(r * D - M).min() > 0 for D, M in stacked.at(x))


@pytest.mark.skipif(kernel() is None, reason="installed without a compiler: no kernel")
@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("seed", range(8))
def test_the_kernel_begins_where_the_reference_does(seed, degree, plain):
    stacked, x, most = ride(seed, degree)
    ask = partial(kernel().inside, stacked.unknowns, stacked.entries, stacked.arrays)
    found = ask(x, most, plain)
    assert found == inside.inside(stacked, x, most)
    assert ask(x, None, plain) == inside.inside(stacked, x)
    if found is not None:
        share, r = found
        assert holds(stacked, x + share * most, r)
        assert not holds(stacked, x + share * most, r / 2)


def test_those_problems_are_of_every_kind():
    found = [inside.inside(*ride(seed, degree)) for seed in range(8) for degree in (0, 1)]
    assert None in found
    assert len({share for share, _ in filter(None, found)}) > 2
    assert len({r for _, r in filter(None, found)}) > 2


@pytest.mark.skipif(kernel() is None, reason="installed without a compiler: no kernel")
def test_vectors_that_do_not_fit_are_refused():
    rides = (ride(seed, 0) for seed in range(8))
    stacked, x, most = next(drawn for drawn in rides if inside.inside(*drawn))
    ask = partial(kernel().inside, stacked.unknowns, stacked.entries)
    assert ask(stacked.arrays, x, most)
    for few in ((x[:-1], most), (x, most[:-1]), (x[:0], None)):
        with pytest.raises(ValueError, match="does not fit"):
            ask(stacked.arrays, *few)
    with pytest.raises(ValueError, match="no blocks"):
        ask([], x, most)
    for wrong in (x.astype(np.float32), x[None], x[::2], None):
        with pytest.raises(TypeError):
            ask(stacked.arrays, wrong, most)
    assert ask(stacked.arrays, np.full_like(x, np.nan), most) is None
    assert ask(stacked.arrays, x, np.full_like(x, np.inf)) is None
