"""Conditions of any degree, domain and region: blocks times monomials against the matrix itself.

The matrix at alpha is built here from A(alpha), W(alpha), Z(alpha) and regions written out by hand.
"""

from math import factorial, prod

import numpy as np
import pytest

from polefence.lmi.conditions.methods import Scheduled, Slack, build, parameter_dependent
from polefence.lmi.conditions.target import Around, Decays, Sectors, Target, disks
from polefence.plant.polynomial import Domain
from polefence.region.regions import (
    Disk,
    Ellipse,
    HalfPlane,
    HorizontalStrip,
    Sector,
    VerticalStrip,
)

RANDOM = np.random.default_rng(23)
n, m = 2, 1
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
SLOPE = np.sqrt(1 - 0.6**2) / 0.6

# L and M of { z : L + M z + M' conj(z) < 0 }, by hand
BY_HAND = {
    Disk(-3, 2): [([[-2, 3], [3, -2]], [[0, 1], [0, 0]])],
    HalfPlane(1.5): [([[3]], [[1]])],
    Sector(0.6): [(np.zeros((2, 2)), SLOPE * np.eye(2) + TURN)],
    VerticalStrip(-4, -1): [([[2]], [[1]]), ([[-8]], [[-1]])],
    HorizontalStrip(2.5): [(-5 * np.eye(2), TURN)],
    Ellipse(-3, 2, 1): [([[-1, 1.5], [1.5, -1]], [[0, 0.75], [-0.25, 0]])],
}
BY_HAND[Disk(-3, 2) & Sector(0.6)] = BY_HAND[Disk(-3, 2)] + BY_HAND[Sector(0.6)]
# whose inequalities do not imply X > 0 of themselves
OPEN = {HalfPlane(1.5), Sector(0.6)}

FORMS = [(g, d) for g in range(4) for d in range(3) if g + d <= 3 or g == d == 2]
SLACK_FORMS = [(g, d) for g in range(3) for d in range(3) if g + d <= 2 or g == d == 2]


def plant(N):
    return RANDOM.normal(size=(N, n, n)), RANDOM.normal(size=(N, n, m))


def bernstein(domain, degree, matrices, c):
    """The polynomial at coordinates c, from multinomial coefficients."""
    total = np.zeros(np.shape(matrices[0]))
    for e, X in zip(domain.monomials(degree), matrices, strict=True):
        weight, start = np.prod(c ** np.array(e)), 0
        for size in domain.sizes:
            weight *= factorial(degree) / prod(factorial(p) for p in e[start : start + size])
            start += size
        total = total + weight * X
    return total


def chilali_gahinet(L, M, X, N):
    return -(np.kron(L, X) + np.kron(M, N) + np.kron(np.transpose(M), N.T))


def points(domain, count=2):
    c = np.hstack([RANDOM.dirichlet(np.ones(size), count) for size in domain.sizes])
    return list(zip(c, domain.alpha(c), strict=True))


def summed(pencil, x, r, domain, top, of_each):
    """Return for each kind of block its sum times monomials, a function of c."""
    blocks = list(pencil.matrices(x, r).values())
    exponents = domain.monomials(top)
    assert len(blocks) == len(exponents) * of_each

    def at(c):
        powers = [np.prod(c ** np.array(e)) for e in exponents]
        return [
            sum(p * b for p, b in zip(powers, blocks[k::of_each], strict=True))
            for k in range(of_each)
        ]

    return at


def point(pencil):
    x = RANDOM.normal(size=pencil.unknowns)
    return x, pencil.unpack(x)


def matrices(values, letter, degree, domain):
    if degree == 0 and letter in "WZ":
        return [values[letter]]
    return [values[f"{letter}{k + 1}"] for k in range(domain.count(degree))]


def domains(on):
    """The box of two parameters, and three vertices: enough for products of three."""
    N = 4 if on == "box" else 3
    return Domain.of(on, N), plant(N)


def cases(total, every):
    """Targets, the r to ask at, regions by hand, and whether X > 0 is asked for besides.

    Disks about one centre; and regions side by side, each as wide as itself: all of them where
    asked, a few for total degrees up to 3, none above.
    """
    own = [([[-1.7, 3], [3, -1.7]], [[0, 1], [0, 0]])]
    yield disks(3.0), 1.7, own, False
    if every or total <= 1:
        chosen = list(BY_HAND) if every else [HalfPlane(1.5), Ellipse(-3, 2, 1)]
        sides = tuple(side for g in chosen for side in Around(g).target(1.0).sides)
        hand = [pair for g in chosen for pair in BY_HAND[g]]
        yield Target(sides, positive=True), 1.0, hand, True


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize(("degree", "elevation"), FORMS)
def test_disks_and_regions(degree, elevation, on):
    domain, (A, B) = domains(on)
    for target, r, hand, opened in cases(
        degree + elevation, (degree, elevation) in ((1, 1), (2, 0))
    ):
        pencil = parameter_dependent(A, B, target, domain, degree, elevation)
        x, values = point(pencil)
        at = summed(pencil, x, r, domain, degree + 1 + elevation, len(hand) + opened)
        for c, alpha in points(domain):
            W, Z = (bernstein(domain, degree, matrices(values, k, degree, domain), c) for k in "WZ")
            N = np.tensordot(alpha, A, 1) @ W + np.tensordot(alpha, B, 1) @ Z
            expected = [chilali_gahinet(L, M, W, N) for L, M in hand] + [W] * opened
            for mine, theirs in zip(at(c), expected, strict=True):
                assert np.allclose(mine, theirs)


def test_methods_name_their_conditions():
    """What `build` makes of a method is the condition tested above."""
    A, B = plant(4)
    for method, numbers in (
        ("quadratic", ("simplex", 0, 0)),
        (Scheduled(0, 2, "box"), ("simplex", 0, 0)),
        ("scheduled", ("simplex", 1, 1)),
        (Scheduled(2, 1, "box"), ("box", 2, 1)),
    ):
        on, degree, elevation = numbers
        mine = build(method, A, B, 3.0)
        theirs = parameter_dependent(A, B, disks(3.0), Domain.of(on, 4), degree, elevation)
        assert [b.name for b in mine.blocks] == [b.name for b in theirs.blocks]
        assert abs(mine.D - theirs.D).max() == abs(mine.M - theirs.M).max() == 0


def test_only_regions_that_do_not_imply_it_ask_for_a_positive_x():
    for region in BY_HAND:
        assert Around(region).target(1.0).positive == (region in OPEN)
    assert Around(HalfPlane(1.5) & Sector(0.6)).target(1.0).positive


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize("within", [None, Disk(-3, 2) & Sector(0.6)])
def test_decay_rates_and_damping_within_a_region(on, within):
    domain, (A, B) = domains(on)
    fixed = [] if within is None else BY_HAND[within]
    goals = [
        # the decay rate is 8 less r; r is the slope
        (Decays(8.0, within), 5.5, ([[5.0]], [[1]])),
        (Sectors(8.0, within), 0.7, (np.zeros((2, 2)), 0.7 * np.eye(2) + TURN)),
    ]
    for goal, r, own in goals:
        hand = [own, *fixed]
        pencil = build(Scheduled(2, 0, on), A, B, goal.target(1.0))
        x, values = point(pencil)
        at = summed(pencil, x, r, domain, 3, len(hand) + 1)
        for c, alpha in points(domain):
            W, Z = (bernstein(domain, 2, matrices(values, k, 2, domain), c) for k in "WZ")
            N = np.tensordot(alpha, A, 1) @ W + np.tensordot(alpha, B, 1) @ Z
            expected = [*(chilali_gahinet(L, M, W, N) for L, M in hand), W]
            for mine, theirs in zip(at(c), expected, strict=True):
                assert np.allclose(mine, theirs)


def test_rates_are_measured_in_the_unit_given():
    """In units of a rate, A over it: the same blocks times one positive number, part by part."""
    A, B = plant(3)
    for goal, r, unit in (
        (Around(Disk(-3, 2) & Ellipse(-3, 2, 1)), 1.0, 1.0),
        (Decays(8.0, HalfPlane(1.5)), 5.5, 4.0),
        (Sectors(8.0, Disk(-3, 2)), 0.7, 1.0),
    ):
        plain = build("quadratic", A, B, goal.target(1.0))
        scaled = build("quadratic", A / 4, B / 4, goal.target(4.0))
        x, _ = point(plain)
        pairs = zip(
            plain.matrices(x, r).items(), scaled.matrices(x, r / unit).values(), strict=True
        )
        for (name, one), other in pairs:
            if name.startswith("X at"):
                assert np.allclose(one, other)
                continue
            ratio = np.vdot(one, other) / np.vdot(one, one)
            assert ratio > 0
            assert np.allclose(ratio * one, other, atol=1e-8 * np.abs(other).max()), (goal, name)


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize(("degree", "elevation"), SLACK_FORMS)
def test_slack(degree, elevation, on):
    domain, (A, B) = domains(on)
    for target, r, hand, opened in cases(degree + elevation, (degree, elevation) == (1, 1)):
        pencil = build(Slack(degree, elevation, on, 0.3), A, B, target)
        x, values = point(pencil)
        at = summed(pencil, x, r, domain, max(degree, 1) + elevation, len(hand) + opened)
        G, K_G = values["G"], values["L"]
        for c, alpha in points(domain):
            P = bernstein(domain, degree, matrices(values, "P", degree, domain), c)
            N = np.tensordot(alpha, A, 1) @ G + np.tensordot(alpha, B, 1) @ K_G
            expected = [slack_by_hand(L, M, P, N, G, 0.3) for L, M in hand] + [P] * opened
            for mine, theirs in zip(at(c), expected, strict=True):
                assert np.allclose(mine, theirs)


def slack_by_hand(L, M, P, N, G, epsilon):
    """(10) of Leite & Peres for a disk; else as `polefence.lmi.conditions.methods` displays it."""
    L, M = np.array(L, dtype=float), np.array(M, dtype=float)
    if M.shape == (2, 2) and np.array_equal(M, [[0, 1], [0, 0]]):
        r, sigma = -L[0, 0], L[0, 1]
        corner = -(N + sigma * G)
        return np.block([[r * P, corner], [corner.T, r * (G + G.T - P)]])
    one = np.eye(len(M))
    first = np.kron(L, P) + np.kron(M.T, N) + np.kron(M, N.T)
    corner = np.kron(M, P - G.T) + epsilon * np.kron(one, N)
    return -np.block([[first, corner], [corner.T, -epsilon * np.kron(one, G + G.T)]])


@pytest.mark.parametrize("region", BY_HAND, ids=str)
def test_the_slack_form_implies_the_lyapunov_form(region):
    """[I, I (x) A_c] S [I, I (x) A_c]' is the Lyapunov form with M' in place of M, whatever e."""
    for L, M in BY_HAND[region]:
        L, M = np.array(L, dtype=float), np.array(M, dtype=float)
        if np.array_equal(M, [[0, 1], [0, 0]]):
            continue
        A_c, G, P = (RANDOM.normal(size=(n, n)) for _ in range(3))
        P = P + P.T
        S = slack_by_hand(L, M, P, A_c @ G, G, 0.3)
        T = np.hstack([np.eye(n * len(M)), np.kron(np.eye(len(M)), A_c)])
        assert np.allclose(T @ S @ T.T, chilali_gahinet(L, M.T, P, A_c @ P))


@pytest.mark.parametrize("region", BY_HAND, ids=str)
def test_the_pairs_say_what_lies_in_the_region(region):
    """L + M z + M' conj(z) < 0 for z inside, by the distance, and not outside."""
    z = RANDOM.normal(-3, 2, 400) + 2j * RANDOM.normal(size=400)
    z = z[np.abs(region.distance(z)) > 1e-6]
    forms = [
        [L + np.multiply(M, value) + np.transpose(M) * np.conj(value) for L, M in BY_HAND[region]]
        for value in z
    ]
    inside = [all(np.linalg.eigvalsh(F)[-1] < 0 for F in own) for own in forms]
    assert inside == (region.distance(z) < 0).tolist()
    assert len(set(inside)) == 2


@pytest.mark.parametrize("region", BY_HAND, ids=str)
def test_wider_regions_are_nested(region):
    """What is in the region made r times as wide is in it for every larger r."""
    z = RANDOM.normal(-3, 2, 60) + 2j * RANDOM.normal(size=60)
    held = []
    for r in (0.5, 1.0, 1.5):
        sides = Around(region).target(1.0).sides
        held.append(
            [
                all(
                    np.linalg.eigvalsh(s.L0 + r * s.L1 + s.M0 * v + s.M0.T * np.conj(v))[-1] < 0
                    for s in sides
                )
                for v in z
            ]
        )
    assert held[1] == (region.distance(z) < 0).tolist()
    assert all(a <= b <= c for a, b, c in zip(*held, strict=True))
