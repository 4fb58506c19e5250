"""What is proved holds at every pole, and a pole outside is never taken for one inside."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import NotProvedError, Parameter, UncertainPlant, place
from polefence.lmi.conditions.methods import Scheduled, Slack
from polefence.plant.polynomial import Domain
from polefence.proof import regions, roots
from polefence.proof.regions import parts_of
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
    Wedge,
    damping_of,
)

# Regions that grow with t > 0, one family a kind.
GROWING = {
    "disk": lambda t: Disk(-1.5, t),
    "half_plane": lambda t: HalfPlane(5 - 3 * t),
    "sector": lambda t: Sector(damping_of(t)),
    "vertical_strip": lambda t: VerticalStrip(-1 - 2 * t, -1 + t),
    "horizontal_strip": lambda t: HorizontalStrip(t),
    "ellipse": lambda t: Ellipse(-1.5, t, 2 * t),
    "wedge": lambda t: Wedge(-1.5 + t, 2 * t),
    "wedge to the right": lambda t: Wedge(-1.5 - t, -t),
    "wide ellipse": lambda t: Ellipse(-1.5, 3 * t, t / 2),
    "intersection": lambda t: Disk(-1.5, 2 * t) & HalfPlane(5 - 3 * t) & HorizontalStrip(t),
}
# A tangent's halves of the angle between its neighbours, of 32 in the upper half-plane.
CORNER = 1 / np.cos(1 / regions.TANGENTS)


def threshold(grow, poles):
    """The t at which the last pole enters, by bisection in floats; None if there is none."""
    low, high = 1e-3, 1e3
    if grow(low).contains(poles) or not grow(high).contains(poles):
        return None
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if grow(middle).contains(poles) else (middle, high)
    return high


def inside(matrix, region):
    rational = [[Fraction(float(e)) for e in row] for row in matrix]
    return roots.all_inside(rational, parts_of(region.document()))


def short(x):
    """Few digits make short rationals; the change is far smaller than any margin below."""
    return float(np.float32(x))


# an ellipse's 66 half-planes are slow, and slower the more poles there are
CASES = [(kind, n) for kind in GROWING for n in (1, 2, 3) if n < 3 or "ellipse" not in kind]


@pytest.mark.parametrize(("kind", "n"), CASES)
def test_poles_are_placed_exactly(kind, n):
    """Just inside is inside, just outside is not; an ellipse may be taken a little too wide."""
    random = np.random.default_rng(n)
    polygon = "ellipse" in kind
    grow, wider, seen = GROWING[kind], CORNER if polygon else 1.0, 0
    for _ in range(2 if polygon else 5):
        A = np.round(16 * random.normal(size=(n, n))) / 16 - 2 * np.eye(n)
        t = threshold(grow, np.linalg.eigvals(A))
        if t is None:
            continue
        seen += 1
        for step in (1e-5, 1e-3)[polygon:]:
            assert inside(A, grow(short(t * (1 + step))))
            assert not inside(A, grow(short(t / (wider * (1 + step)))))
    # real poles have no threshold of damping or frequency
    assert seen or n == 1


@pytest.mark.parametrize("kind", GROWING)
def test_poles_that_are_double_or_on_the_boundary(kind):
    """A Jordan block at -3/2 + 2 i (one pair, of ellipses): in, out, or on the boundary: out."""
    block = [[-1.5, 2.0], [-2.0, -1.5]]
    A = np.block([[np.array(block), np.eye(2)], [np.zeros((2, 2)), np.array(block)]])
    A = np.array(block) if "ellipse" in kind else A
    boundary = {
        "disk": Disk(-1.5, 2),
        "half_plane": HalfPlane(1.5),
        "vertical_strip": VerticalStrip(-1.5, 0),
        "horizontal_strip": HorizontalStrip(2),
        "intersection": Disk(-1.5, 3) & HorizontalStrip(2),
        "ellipse": Ellipse(-1.5, 1, 2),  # the tangent at its top is one of the polygon's
        "wide ellipse": Ellipse(-1.5, 3, 2),
    }
    if kind in boundary:
        assert not inside(A, boundary[kind])
    poles = [-1.5 + 2j, -1.5 - 2j]
    t = threshold(GROWING[kind], poles)
    assert inside(A, GROWING[kind](short(t * (1 + 1e-5))))
    wider = CORNER if "ellipse" in kind else 1
    assert not inside(A, GROWING[kind](short(t * (1 - 1e-5) / wider)))


def test_a_pole_at_the_origin_or_at_one_is_no_special_case():
    """The map to the unit disk has its pole at one."""
    assert not inside([[1.0]], HalfPlane(0))
    assert not inside([[0.0]], HalfPlane(0))
    assert inside([[-1.0]], HalfPlane(0))
    assert inside([[1.0, 0], [0, -2]], HalfPlane(-1.5))
    assert not inside([[0.0, 0], [0, -2]], Sector(0.5))
    assert inside([[0.0]], HorizontalStrip(1e-9))
    assert roots.all_inside([], parts_of(HalfPlane(0).document()))


# --- what is proved, holds -----------------------------------------------------------------------

METHODS = ["quadratic", "slack", "scheduled", Scheduled(2, 0, "box"), Slack(2, 0, "box")]
REGIONS = [
    Disk(-3, 2.5),
    HalfPlane(1),
    Sector(0.5),
    VerticalStrip(-6, -1),
    HorizontalStrip(2),
    Ellipse(-3, 2.5, 1.5),
    Disk(-3, 2.9) & Sector(0.6),
    Disk(-40, 39.5) & HalfPlane(1) & HorizontalStrip(2),
    Wedge(-0.5, 2) & Wedge(-6, -1.5),
]


def plant(seed):
    random = np.random.default_rng(seed)
    n, m = ((1, 1), (2, 1), (3, 1), (2, 2))[seed % 4]
    A, B = random.normal(size=(n, n)), random.normal(size=(n, m))
    As, Bs = ([X + 0.3 * random.normal(size=X.shape) for _ in range(4)] for X in (A, B))
    box = (Parameter("p", 0, 1), Parameter("q", 1, 2))
    return replace(UncertainPlant.from_vertices(As, Bs), parameters=box)


def everywhere(on, count=200):
    """Corners, edges' points and a sample of the domain, as alpha."""
    domain, random = Domain.of(on, 4), np.random.default_rng(3)
    corners = np.array(domain.monomials(1), dtype=float)
    parts = [random.dirichlet(np.full(size, 0.6), count) for size in domain.sizes]
    middles = (corners[:, None] + corners[None]).reshape(-1, corners.shape[1]) / 2
    return domain.alpha(np.vstack([corners, middles, np.hstack(parts)]))


def narrower(region, t):
    """The region's parts with their sizes times t; a sector more damped."""
    parts = []
    for part in region.parts:
        match part:
            case Disk():
                parts.append(Disk(part.centre, part.radius * t))
            case HalfPlane():
                parts.append(HalfPlane(part.decay / t))
            case Sector():
                parts.append(Sector(damping_of(part.slope * t)))
            case VerticalStrip():
                middle, half = (part.low + part.high) / 2, t * (part.high - part.low) / 2
                parts.append(VerticalStrip(middle - half, middle + half))
            case HorizontalStrip():
                parts.append(HorizontalStrip(part.height * t))
            case Wedge():
                parts.append(Wedge(part.apex, part.slope * t))
            case Ellipse():
                parts.append(Ellipse(part.centre, part.real * t, part.imaginary * t))
    result = parts[0]
    for part in parts[1:]:
        result = result & part
    return result


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_whatever_is_proved_holds_at_every_sampled_point(method):
    """Claims are made narrower until they fail: no proved one has a pole outside."""
    on = getattr(method, "on", "simplex")
    alpha, answers = everywhere(on), {True: 0, False: 0}
    for seed in (1, 2):
        family = plant(seed)
        for region in REGIONS[seed % 2 :: 2]:
            try:
                design = place(family, region, method)
            except NotProvedError:
                continue
            poles = design.poles(alpha)
            for t in (1.0, 0.97, 0.85, 0.65, 0.4, 0.2, 0.05):
                claimed = narrower(region, t) if t < 1 else region
                proved = replace(design.certificate, region=claimed).prove().proved
                answers[proved] += 1
                worst = claimed.distance(poles).max()
                assert not proved or worst < 1e-9 * max(1.0, claimed.size), (seed, region, t)
                if not proved:
                    break
    assert min(answers.values()) >= 3, answers


@pytest.mark.parametrize("on", ["simplex", "box"])
def test_poles_inside_of_a_claim_agrees_with_its_sampled_poles(on):
    """The law at a rational alpha, exactly, against floats: on both sides of the boundary."""
    domain, random = Domain.of(on, 4), np.random.default_rng(4)
    design = place(plant(1), Disk(-3, 2.9), Scheduled(2, 0, on))
    law = design.law
    # few digits: another law, which is as good here
    rounded = replace(law, W=law.W.astype(np.float32), Z=law.Z.astype(np.float32))
    claim = replace(design.certificate, law=rounded).claim()
    own = [np.diff([0, *sorted(random.integers(0, 9, size - 1)), 8]) for size in domain.sizes]
    alpha = [Fraction(1)]
    for e in own:
        alpha = [a * Fraction(int(w), 8) for a in alpha for w in e]
    A, B = design.plant.at(np.array(alpha, dtype=float))
    poles = np.linalg.eigvals(A + B @ rounded.gain(np.array(alpha, dtype=float)))
    for kind in ("disk", "half_plane", "sector", "ellipse"):
        grow = GROWING[kind]
        t = threshold(grow, poles)
        wider = CORNER if "ellipse" in kind else 1.0
        for factor, answer in ((1 + 1e-4, True), (1 / (wider * (1 + 1e-4)), False)):
            if t is not None:
                parts = parts_of(grow(short(t * factor)).document())
                assert replace(claim, region=parts).poles_inside(alpha) is answer
