"""One step of the compiled interior point against one of the reference's, for many shapes."""

import re

import numpy as np
import pytest

from polefence.base.kernel import kernel
from polefence.lmi.conditions.methods import build
from polefence.lmi.conditions.target import Disks
from polefence.lmi.solve import engine, interior_point
from polefence.lmi.solve.scaling import balanced
from polefence.lmi.solve.search import common_point
from polefence.lmi.solve.smallest import smallest
from polefence.lmi.solve.stacked import stack
from polefence.lmi.solve.starts import nominal_start
from support.paths import ROOT

SHAPES = [
    (n, m, N) for n in (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11) for m, N in ((1, 3), (2, 2), (3, 3))
]


def test_the_kernel_has_the_constants_of_the_reference():
    source = (ROOT / "src" / "kernel" / "dense.inc").read_text()

    def numbers(name):
        text = re.search(rf"\b{name}(?:\[\])? = ({{[^}}]*}}|[^,;]*)", source).group(1)
        return tuple(float(n) for n in re.findall(r"[0-9.e+-]+", text))

    for ours, theirs in (
        ("shares", interior_point.SHARES),
        ("leaps", interior_point.LEAPS),
        ("shifts", interior_point.SHIFTS),
        ("central_share", (interior_point.CENTRAL,)),
        ("loose_share", (interior_point.LOOSE,)),
        ("fold", (interior_point.FOLD,)),
        ("damping_factor", (interior_point.DAMPING,)),
        ("least_damping", (interior_point.LEAST_DAMPING,)),
    ):
        assert numbers(ours) == theirs, ours


@pytest.mark.skipif(kernel() is None, reason="installed without a compiler: no kernel")
@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
@pytest.mark.parametrize(("n", "m", "N"), SHAPES)
def test_one_step_is_the_same_step(monkeypatch, make_random, n, m, N, method):
    plant = make_random(n + 20 * m, n, m, N)
    scaling = balanced(plant.A, plant.B, 3.0)
    start = nominal_start(plant.A, plant.B, 3.0, scaling)
    scaling = scaling.refined(start.W)
    pencil = build(method, *scaling.apply(plant.A, plant.B), 3.0 / scaling.rate)
    values = common_point(start.W, start.K @ start.W, pencil.variables)
    x = pencil.pack(scaling.scaled(values, pencil.variables))
    r = 1.3 * start.radius / scaling.rate
    monkeypatch.setattr(interior_point, "MAX_ITERATIONS", 1)
    reference = engine.run(stack(pencil), x, r, engine="numpy")
    compiled = engine.run(stack(pencil), x, r, engine="compiled")
    assert reference.iterations == compiled.iterations
    if n > 1:  # with one state and several inputs H is singular: any step along its kernel will do
        assert reference.iterations == 1
        assert np.isclose(compiled.r, reference.r, rtol=1e-6)
        assert np.allclose(compiled.x, reference.x, rtol=1e-5, atol=1e-5 * np.abs(x).max())
    moved = stack(pencil).parts(compiled.x)
    assert interior_point.least_radius(*moved) < compiled.r


@pytest.mark.parametrize("name", engine.ENGINES)
def test_inputs_without_effect_or_twice_change_nothing(make_random, name):
    """A zero column of B, or a column twice: unknowns that appear nowhere, or twice."""
    if name == "compiled" and kernel() is None:
        pytest.skip("installed without a compiler: no kernel")
    plant = make_random(3, 3, 1, 3)
    A, B = plant.A, plant.B
    for method in ("quadratic", "slack", "scheduled"):
        plain = smallest(A, B, Disks(-3.0), method, engine=name)
        for extra in (0 * B, B):
            twice = np.concatenate([B, extra], axis=2)
            found = smallest(A, twice, Disks(-3.0), method, engine=name)
            assert found.converged
            assert np.isclose(found.r, plain.r, rtol=1e-6)


def test_more_inputs_than_states(make_random):
    """Theorem 1 goes below Lemma 1, and nothing stops at the start."""
    plant = make_random(2, 1, 2, 3)
    for name in ENGINES_HERE:
        lemma, theorem = (
            smallest(plant.A, plant.B, Disks(-3.0), m, engine=name)
            for m in ("quadratic", "scheduled")
        )
        assert lemma.converged
        assert theorem.r < 0.01 * lemma.r


ENGINES_HERE = engine.ENGINES if kernel() is not None else ("numpy",)
