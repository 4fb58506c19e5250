"""The orchestrator: plant, region and method in; a proved design out."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np

from polefence.conditions.methods import Method, Scheduled, method_name
from polefence.design import Design, rounded_up
from polefence.errors import InputError, NotProvedError, SolverError
from polefence.law import FixedGain, Law, ScheduledGain, right_divide
from polefence.plant.family import UncertainPlant
from polefence.plant.system import Array
from polefence.proof.certificate import Certificate
from polefence.proof.repair import lower_bound
from polefence.region import Disk, check_centre
from polefence.solve import bisection
from polefence.solve.found import Found
from polefence.solve.radius import smallest_radius

# How far above the radius that a point reaches in floats the exact proof is attempted.
STEPS = (1e-7, 1e-6, 1e-5, 1e-4)

# A search that stopped before it converged, above this share of sigma, has a second opinion.
STALLED = 1e-3

# A lower bound farther off than this share of the radius is sought again, with this tolerance.
GAP, CLOSER = 3e-6, 1e-10

# Where nothing near the infimum is proved: points for radii this much larger.
RETREATS = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0)


def place(
    plant: UncertainPlant, region: Disk, method: Method = "scheduled", allow_unproved: bool = False
) -> Design:
    """Design a law that keeps all poles of the whole family in a disk, and prove it.

    Parameters
    ----------
    plant : UncertainPlant
    region : Disk
    method : str or Scheduled
        "quadratic" (Lemma 1), "slack" (Lemma 2), "scheduled" (Theorem 1).
    allow_unproved : bool
        Return the numerical answer even where its proof fails (``Design.proved`` tells).

    Raises
    ------
    NotProvedError
        If the disk is not proved; its ``best`` is the smallest disk of this centre that is.
    UncontrollableError
        If a vertex is uncontrollable.
    """
    name = method_name(method)
    _require(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    _require(region, Disk, "region", "for example polefence.Disk(-40, 31)")
    plant.require_controllable()
    inside = _inside(plant, region, method)
    if inside is not None:
        return inside
    best = _tightest(plant, region.centre, method)[0]
    wider = replace(best.certificate, region=region)
    if best.region.radius <= region.radius and wider.prove().proved:
        return Design(wider)
    if allow_unproved:
        return Design(wider, proved=False)
    raise NotProvedError(_refusal(name, region, best), best if best.proved else None)


def _inside(plant: UncertainPlant, region: Disk, method: Method) -> Design | None:
    """Return a proved design for this disk, from the first point found inside it."""
    try:
        found = smallest_radius(plant.A, plant.B, region.sigma, method, enough=region.radius)
        design = Design(_certificate(plant, region, method_name(method), found))
    except SolverError:
        return None
    return design if found.radius <= region.radius and design.certificate.prove().proved else None


def _refusal(name: str, region: Disk, best: Design) -> str:
    reached = (
        f"the smallest radius found there is {rounded_up(best.region.radius)} (proved)"
        if best.proved
        else "no radius was proved there"
    )
    if best.lower is not None and best.lower >= region.radius:
        answer = f"refuted for {name}: its inequalities have no solution for {region}"
    else:
        answer = f"not proved: {name} gives no proof for {region}"
    return f"{answer}; {reached}; try a larger disk or another method"


def tightest(
    plant: UncertainPlant,
    centre: float,
    method: Method = "scheduled",
    allow_unproved: bool = False,
) -> Design:
    """Design for the smallest disk with this centre that the method reaches, and prove it.

    Parameters
    ----------
    centre : float
        Real coordinate, negative (-40) [1/s].

    Returns
    -------
    Design
        ``design.region.radius`` is proved; where ``design.lower`` is not None, that radius is
        proved to be out of the method's reach.

    Raises
    ------
    NotProvedError
        If no radius could be proved (the solver failed on this problem).
    UncontrollableError
        If a vertex is uncontrollable.
    """
    name = method_name(method)
    centre = check_centre(centre)
    _require(plant, UncertainPlant, "plant", "polefence.load(path) reads one")
    plant.require_controllable()
    best, _ = _tightest(plant, centre, method)
    if not best.proved and not allow_unproved:
        raise NotProvedError(
            f"undecided: {name} at centre {centre:g} gave no point that could be proved; "
            "check the plant's units and try another centre"
        )
    return best


def _require(value: object, kind: type, name: str, remedy: str) -> None:
    if not isinstance(value, kind):
        given = type(value).__name__
        raise InputError(f"{name} must be of type {kind.__name__}, not {given}; {remedy}")


def tightest_near(
    plant: UncertainPlant, centre: float, method: Method, near: Found | None, bounds: bool = True
) -> tuple[Design, Found]:
    """`tightest`, started from a neighbouring centre's point; also the point for the next one.

    Raises
    ------
    NotProvedError
        If no radius could be proved.
    """
    best, found = _tightest(plant, centre, method, near, bounds)
    if not best.proved:
        raise NotProvedError(f"undecided: {method_name(method)} at centre {centre:g}")
    return best, found


def _tightest(
    plant: UncertainPlant,
    centre: float,
    method: Method,
    near: Found | None = None,
    bounds: bool = True,
) -> tuple[Design, Found]:
    """Return the design of the smallest radius, ``proved`` or not, and its point."""
    sigma, name = -centre, method_name(method)
    try:
        found = smallest_radius(plant.A, plant.B, sigma, method, near)
    except SolverError:
        found = _second_opinion(plant, centre, method)
    if not found.converged and found.radius > STALLED * sigma:
        with suppress(NotProvedError):
            second = _second_opinion(plant, centre, method)
            found = second if second.radius < found.radius else found
    design = _proved_near(plant, centre, name, found)
    for step in RETREATS if design is None else ():
        # The point lies too near the boundary for its rounding: look farther inside.
        radius = found.radius * (1 + step)
        with suppress(SolverError):
            inner = smallest_radius(plant.A, plant.B, sigma, method, enough=radius)
            design = _proved_near(plant, centre, name, inner)
        design = design or _proved_at(plant, radius, centre, name, found)
        if design is not None:
            break
    if design is None:
        try:
            unproved = _certificate(plant, Disk(centre, found.radius), name, found)
        except SolverError as error:
            raise NotProvedError(f"undecided: {name} at centre {centre:g}: {error}") from error
        return Design(unproved, proved=False), found
    return replace(design, lower=_bound(plant, sigma, method, found) if bounds else None), found


def _bound(plant: UncertainPlant, sigma: float, method: Method, found: Found) -> float | None:
    """Return a lower bound, from a closer run where the first one leaves a gap."""
    lower = _lower(plant, sigma, method, found)
    if found.radius > sigma or (lower is not None and lower > found.radius * (1 - GAP)):
        return lower
    with suppress(SolverError):
        closer = smallest_radius(plant.A, plant.B, sigma, method, found, tolerance=CLOSER)
        return max((b for b in (lower, _lower(plant, sigma, method, closer)) if b), default=None)
    return lower


def _second_opinion(plant: UncertainPlant, centre: float, method: Method) -> Found:
    try:
        return bisection.smallest_radius(plant.A, plant.B, -centre, method)
    except SolverError as error:
        where = f"{method_name(method)} at centre {centre:g}"
        raise NotProvedError(f"undecided: {where}: {error}") from error


def _lower(plant: UncertainPlant, sigma: float, method: Method, found: Found) -> float | None:
    """Return a radius proved infeasible for the method, None where no proof came of it."""
    if found.dual is None:
        return None
    A = [[list(row) for row in v.exact_A] for v in plant.vertices]
    B = [[list(row) for row in v.exact_B] for v in plant.vertices]
    rhs = isinstance(method, Scheduled) and method.right_hand_sides
    Y = found.dual.matrices()
    bound = lower_bound(method_name(method), A, B, Fraction(sigma), found.radius, Y, rhs)
    return None if bound is None else float(bound.r)


def _proved_near(plant: UncertainPlant, centre: float, name: str, found: Found) -> Design | None:
    for step in STEPS:
        design = _proved_at(plant, found.radius * (1 + step), centre, name, found)
        if design is not None:
            return design
    return None


def _proved_at(
    plant: UncertainPlant, radius: float, centre: float, name: str, found: Found
) -> Design | None:
    try:
        certificate = _certificate(plant, Disk(centre, radius), name, found)
    except SolverError:
        return None
    return Design(certificate) if certificate.prove().proved else None


def _certificate(plant: UncertainPlant, region: Disk, name: str, found: Found) -> Certificate:
    """Round a point to the law and evidence that ship; the proof is about these very numbers.

    Raises
    ------
    SolverError
        If a Lyapunov or slack matrix is singular in floats.
    """
    try:
        return _rounded(plant, region, name, found.values)
    except np.linalg.LinAlgError as error:
        raise SolverError("a Lyapunov matrix is numerically singular") from error


def _rounded(
    plant: UncertainPlant, region: Disk, name: str, values: dict[str, Array]
) -> Certificate:
    N = len(plant.vertices)
    law: Law
    if name == "scheduled":
        W = np.stack([values[f"W{j + 1}"] for j in range(N)])
        Z = np.stack([values[f"Z{j + 1}"] for j in range(N)])
        law = ScheduledGain(W, Z, plant.parameters)
        tau = values["tau"].item() if "tau" in values else 0.0
        return Certificate(plant, region, name, law, {"tau": np.array(tau)})
    if name == "quadratic":
        law = FixedGain(right_divide(values["Z"], values["W"]))
        return Certificate(plant, region, name, law, {"W": values["W"]})
    law = FixedGain(right_divide(values["L"], values["G"]))
    P = np.stack([values[f"P{j + 1}"] for j in range(N)])
    return Certificate(plant, region, name, law, {"P": P, "G": values["G"]})
