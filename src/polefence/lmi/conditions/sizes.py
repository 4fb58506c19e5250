"""Work of a method's inequalities for a plant: counted before it is begun."""

from __future__ import annotations

from math import comb

from polefence.lmi.conditions.methods import Method, Scheduled, Slack, options
from polefence.plant.family import UncertainPlant
from polefence.plant.polynomial import Domain

# Inequalities, and multiplications of one step of the search, of which there are some dozens.
MOST_BLOCKS, MOST_STEP = 20_000, 2e11
# Beyond this a step takes many seconds: a plain "scheduled" is then asked for on the box.
LONG_STEP = 3e10


def blocks(plant: UncertainPlant, method: Method) -> int:
    """Return the number of inequalities that a method has for one part of a region."""
    o, domain = options(method), Domain.of(options(method).on, len(plant.vertices))
    return domain.count(_natural(o) + o.elevation)


def step_work(plant: UncertainPlant, method: Method) -> float:
    """Return about how many multiplications one step of the interior point takes.

    Factoring the Newton matrix, and adding up its entries: each inequality has one for every two
    unknowns in it. Of a polynomial's coefficients only those are in an inequality whose exponents
    are no larger than its own.
    """
    o, (n, m) = options(method), plant.shape
    domain = Domain.of(o.on, len(plant.vertices))
    degree, total = int(o.degree), _natural(o) + o.elevation
    each = n * (n + 1) // 2
    extra = n * (n + m) if isinstance(o, Slack) else 0
    each += 0 if isinstance(o, Slack) else m * n
    unknowns = domain.count(degree) * each + extra
    together = 1.0
    for size in domain.sizes:
        if size == 2:
            inside = [min(e, degree) - max(0, e - total + degree) + 1 for e in range(total + 1)]
            together *= sum(k * k for k in inside) / (total + 1)
        else:
            together *= min(comb(total, degree), comb(size + degree - 1, degree)) ** 2
    entries = blocks(plant, method) * (together * each**2 + extra**2)
    return unknowns**3 / 3 + entries * (4 * n + 50)


def is_searchable(plant: UncertainPlant, method: Method, most: float = MOST_STEP) -> bool:
    """Whether the search takes on as much."""
    return blocks(plant, method) <= MOST_BLOCKS and step_work(plant, method) <= most


def fitting(plant: UncertainPlant, method: Method) -> Method:
    """Return the method; for a plain "scheduled" that is too large, one on the box that is not."""
    if method != "scheduled" or is_searchable(plant, method, LONG_STEP):
        return method
    for elevation in (1, 0) if plant.parameters else ():
        box = Scheduled(1, elevation, "box")
        if is_searchable(plant, box, LONG_STEP):
            return box
    return method


def _natural(o: Scheduled | Slack) -> int:
    """Return the degree of the inequality before elevation."""
    return max(int(o.degree), 1) if isinstance(o, Slack) else int(o.degree) + 1
