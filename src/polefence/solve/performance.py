"""The least bound on a signal that a law of a degree keeps, beside a region and other bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from polefence.conditions.gain_norm import Norm, tangents
from polefence.conditions.pencil import Pencil
from polefence.conditions.performance import Output, Source, design, unit_of
from polefence.conditions.target import Around, Target
from polefence.errors import SolverError
from polefence.plant.system import Array
from polefence.polynomial import Domain
from polefence.region import HalfPlane, Region
from polefence.solve.engine import run
from polefence.solve.found import lyapunov_mean
from polefence.solve.scaling import Scaling
from polefence.solve.smallest import TOLERANCE
from polefence.solve.stacked import Stacked, stack

ROUNDS = 4
NORM_ROUNDS, TANGENTS, WORTH = 30, 3, 1e-5  # of bounds on the law, tight near the last point only
MARGIN = 1e-5  # of the first inequality, in units of the search's own rate
INSIDE = 0.97  # how far within the limits a point is looked for, as a share of their squares
WIDE = 1.3
HALVINGS = 80


@dataclass(frozen=True, eq=False)
class Reached:
    """A point of a condition, in the original coordinates.

    Attributes
    ----------
    r : float
        At which it holds in floats.
    values : dict of str to array
        W and Z.
    t : dict of str to float
        For each source: W / t is its Lyapunov matrix.
    converged : bool
    iterations : int
    """

    r: float
    values: dict[str, Array]
    t: dict[str, float]
    converged: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of a family: see `polefence.conditions.performance.design`.

    Attributes
    ----------
    A, B : (N, n, n), (N, n, m) arrays
    sources : tuple of Source
    outputs : tuple of Output
    region : Region, optional
    domain : Domain
    degree, elevation : int
    norms : tuple of Norm
        Bounds on the law itself.
    """

    A: Array
    B: Array
    sources: tuple[Source, ...]
    outputs: tuple[Output, ...]
    region: Region | None
    domain: Domain
    degree: int
    elevation: int
    norms: tuple[Norm, ...] = ()

    def pencil(
        self,
        scaling: Scaling,
        outputs: tuple[Output, ...],
        norms: tuple[Norm, ...],
        values: dict[str, Array],
        tangent: int = 0,
    ) -> Pencil:
        """Return the condition in other coordinates; bounds on the law are tight near ``values``.

        ``tangent`` numbers those of `polefence.conditions.gain_norm.tangents`.
        """
        A, B = scaling.apply(self.A, self.B)
        inverse = np.asarray(np.linalg.inv(scaling.T), dtype=float)
        sources = tuple(s.changed(inverse, scaling.rate) for s in self.sources)
        changed = tuple(o.changed(scaling.T, scaling.S) for o in outputs)
        region = self.region
        if region is None and not sources:  # nothing else asks for stability
            region = HalfPlane(0)
        target = None if region is None else fixed(region, scaling.rate)
        W = np.stack([values[f"W{k + 1}"] for k in range(self.domain.count(self.degree))])
        near = inverse @ W @ inverse.T
        scaled = [norm.changed(scaling.T, scaling.S) for norm in norms]
        own = [(norm, tangents(norm, near)[tangent]) for norm in scaled]
        form = self.domain, self.degree, self.elevation
        return design(A, B, sources, changed, target, *form, MARGIN, own)


def fixed(region: Region, rate: float) -> Target:
    """Return a region that does not grow with r."""
    sides = (
        replace(side, L1=0 * side.L1, M1=0 * side.M1) for side in Around(region).target(rate).sides
    )
    found = []
    for side, (L, M) in zip(sides, region.pairs(rate), strict=True):
        found.append(replace(side, L0=L, M0=M))
    return Target(tuple(found))


def least(
    question: Question, start: dict[str, Array], scaling: Scaling, tolerance: float = TOLERANCE
) -> Reached:
    """Minimise the one output's bound that is not fixed, from a point within the region.

    Parameters
    ----------
    start : dict
        W and Z of the condition's degree, for which all poles lie in the region, in the original
        coordinates.

    Raises
    ------
    SolverError
        If there is no point to start from, or none that keeps the fixed bounds.
    """
    begin = Reached(np.inf, dict(start), {}, False, 0)
    outputs, norms = question.outputs, question.norms
    fixed_ones = [bound.fixed for bound in outputs] + [norm.fixed for norm in norms]
    if any(fixed_ones):
        # all bounds grow with r, until they are those that were asked for
        growing = tuple(replace(o, fixed=False) for o in outputs if o.fixed)
        laws = tuple(replace(norm, fixed=False) for norm in norms if norm.fixed)
        begin = _rounds(question, (growing, laws), begin, scaling, INSIDE, tolerance)
        if begin.r >= 1:
            raise SolverError("the limits contradict one another, or the region")
    if not all(fixed_ones):
        begin = _rounds(question, (outputs, norms), begin, scaling, 0.0, tolerance)
    units = {f"t {source.name}": unit_of(source, scaling.rate) for source in question.sources}
    return replace(begin, t={name: value / units[name] for name, value in begin.t.items()})


def _rounds(
    question: Question,
    bounds: tuple[tuple[Output, ...], tuple[Norm, ...]],
    begin: Reached,
    scaling: Scaling,
    enough: float,
    tolerance: float,
) -> Reached:
    found: Reached | None = None
    iterations = 0
    rounds, worth = (NORM_ROUNDS, WORTH) if bounds[1] else (ROUNDS, 1e-7)
    for _ in range(rounds):
        own = scaling.refined(lyapunov_mean(begin.values))
        again: Reached | None = None
        for tangent in range(TANGENTS if bounds[1] else 1):
            pencil = question.pencil(own, *bounds, begin.values, tangent)
            again = _run(pencil, begin, own, enough, tolerance)
            if again is not None:
                break
        if again is None or (found is not None and again.r >= found.r * (1 - worth)):
            break
        iterations += again.iterations
        found = begin = again
        if (found.converged and not bounds[1]) or found.r <= enough:
            break
    if found is None:
        raise SolverError("no point to start from: the numbers are too far apart for doubles")
    return replace(found, iterations=iterations)


def _run(
    pencil: Pencil, begin: Reached, scaling: Scaling, enough: float, tolerance: float
) -> Reached | None:
    stacked = stack(pencil)
    matrices = tuple(v for v in pencil.variables if v.rows)
    scalars = [v.name for v in pencil.variables if not v.rows]
    x, r = interior(pencil, stacked, scaling.scaled(begin.values, matrices), begin.t)
    if x is None:
        return None
    try:
        outcome = run(stacked, x, WIDE * r, enough, tolerance)
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(outcome.r) and np.all(np.isfinite(outcome.x))):
        return None
    back = pencil.unpack(outcome.x)
    t = {name: back.pop(name).item() for name in scalars}
    # those of bounds on the law are one again, beside the W that was found
    t = {name: value for name, value in t.items() if name.startswith("t ")}
    size = max(t.values(), default=float(np.abs(back["W1"]).max()))
    values = scaling.restore({k: v / size for k, v in back.items()}, matrices)
    t = {name: value / size for name, value in t.items()}
    return Reached(outcome.r, values, t, outcome.converged, outcome.iterations)


def interior(
    pencil: Pencil, stacked: Stacked, values: dict[str, Array], t: dict[str, float]
) -> tuple[Array | None, float]:
    """Return x and an r at which it is interior, with the largest scalars t that make it so."""
    names = [v.name for v in pencil.variables if v.name not in values]
    x = pencil.pack(values | {name: np.zeros((1, 1)) for name in names})
    most = pencil.pack(
        {name: np.zeros_like(X) for name, X in values.items()}
        | {name: np.full((1, 1), t.get(name, 1.0)) for name in names}
    )
    alone, rising = stacked.at(x), stacked.at(most)
    fixed = [
        ~np.any([D, dD], axis=(0, 2, 3)) for (D, _), (dD, _) in zip(alone, rising, strict=True)
    ]
    pairs = list(zip(alone, rising, fixed, strict=True))
    plain = [(M[own], dM[own]) for (_, M), (_, dM), own in pairs if own.any()]
    grown = [
        (D[~own], dD[~own], M[~own], dM[~own]) for (D, M), (dD, dM), own in pairs if not own.all()
    ]
    share = 1.0
    for _ in range(HALVINGS):
        if _positive([-M - share * dM for M, dM in plain]):
            blocks = [(D + share * dD, M + share * dM) for D, dD, M, dM in grown]
            # D >= 0, so that r D - M only grows with r
            for r in 2.0 ** np.arange(-14, 60):
                if _positive([r * D - M for D, M in blocks]):
                    return x + share * most, float(r)
        share /= 2
    return None, 0.0


def _positive(blocks: list[Array]) -> bool:
    try:
        for block in blocks:
            np.linalg.cholesky(block)
    except np.linalg.LinAlgError:
        return False
    return True
