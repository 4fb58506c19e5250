"""More freedom or fewer limits never lead to a worse answer: random plants, each answer proved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import polefence as pf
from polefence.design.signals.bounds import sampled
from polefence.plant.points import seeded

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
