"""Random families with static elements."""

import numpy as np

import polefence as pf
from polefence.plant.outputs import Output
from polefence.requirements.sector import SectorBound


def with_elements(seed, count=1, *, entering, **flags):
    """Return matrices and K, a stable family of two vertices, its sectors, and what drew them.

    Parameters
    ----------
    entering : bool
        Whether elements enter the rates of their signals.
    flags : bool
        Of the requirement.
    """
    random = np.random.default_rng(seed)
    n, m = 4 + count, 1
    S = random.normal(size=(n, n))
    A = 2 * (S - S.T) + 0.3 * random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + random.uniform(0.3, 0.6)) * np.eye(n)
    As = [A, A + 0.1 * random.normal(size=(n, n))]
    Bs = [random.normal(size=(n, m))] * 2
    E = random.normal(size=(n, count + 1))
    if not entering:
        E[:count, 1:] = 0
    K = 0.1 * random.normal(size=(m, n))
    plant = pf.UncertainPlant.from_vertices(As, Bs, [E, E])
    signals = [Output(f"y{k + 1}", "", C=np.eye(count, n)[k]) for k in range(count)]
    sectors = SectorBound(
        signals,
        disturbance=[f"w{k + 2}" for k in range(count)],
        sector=[[-0.5, 0.8], [-1.0, 0.2]][:count],
        **flags,
    )
    return (As, Bs, E, K), plant, sectors, random
