"""Parameters that move: proofs against motions, and the limits of slow and of fast ones.

A mass on a spring whose stiffness k moves, or whose mass m does, acting by 1/m.
"""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from polefence import (
    EnergyPeak,
    FixedGain,
    Gain,
    HalfPlane,
    InitialPeak,
    Rms,
    Scheduled,
    Sector,
    UncertainPlant,
    optimise,
    place,
    tightest,
)
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound
from polefence.certify.given import analyse
from polefence.plant.exact import file_plant
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from polefence.proof.laws import Evidence, Piece
from polefence.proof.work import FormatError

DAMPING = 1.0
NO_LAW = FixedGain(np.zeros((1, 2)))
SLOW, FAST = Fraction(1, 10), Fraction(20)
SCHEDULED = Scheduled(1, 0, "box")


def spring(rate=None, low=3, high=8):
    """x'' = -k x - c x' + u + w."""

    def matrices(k):
        return [[0, 1], [-k, -DAMPING]], [[0], [1]], [[0], [1]]

    return UncertainPlant.from_function(
        matrices, [Parameter("k", low, high, "N/m", rate=rate)], **NAMES
    )


def mass(rate=None, other=None):
    """m x'' = -k x - x' + u + w."""

    def matrices(m, k):
        return [[0, 1], [-k / m, -1 / m]], [[0], [1 / m]], [[0], [1 / m]]

    parameters = [
        Parameter("m", 1, 2, "kg", "1/m", rate=rate),
        Parameter("k", 3, 6, "N/m", rate=other),
    ]
    return UncertainPlant.from_function(matrices, parameters, **NAMES)


NAMES = {
    "name": "spring",
    "states": ("x [m]", "v [m/s]"),
    "inputs": ("f [N]",),
    "disturbances": ("w [N]",),
}


def both(rate):
    return -Fraction(rate), Fraction(rate)


def motions(plant, count, steps, dt, seed=0):
    """Values of the parameters at steps (steps, count, parameters), none faster than it may be.

    Each goes from end to end or turns at random, at its full speed; some beat at the frequencies
    that drive the loop most.
    """
    random = np.random.default_rng(seed)
    low, high = (
        np.array([float(getattr(p, e)) for p in plant.parameters]) for e in ("low", "high")
    )
    beat = np.pi / np.sqrt(random.uniform(low[-1], high[-1], (count, 1)))
    phase = random.uniform(0, 1, (count, len(low)))
    turns = random.uniform(size=(count, 1)) < 0.5
    p = random.uniform(low, high, (count, len(low)))
    sign = random.choice([-1.0, 1.0], size=p.shape)
    found = np.empty((steps, *p.shape))
    for k in range(steps):
        found[k] = p
        regular = np.where(np.mod(k * dt / beat / 2 + phase, 1.0) < 0.5, 1.0, -1.0)
        flip = random.uniform(size=p.shape) < dt
        sign = np.where(flip, -sign, sign)
        way = np.where(turns, regular, sign)
        for f, own in enumerate(plant.parameters):
            if own.rate == "any":
                p[:, f] = np.where(way[:, f] > 0, high[f], low[f])
            elif own.rate is not None:
                rate = np.where(way[:, f] > 0, float(own.rate[1]), float(own.rate[0]))
                p[:, f] = p[:, f] + dt * rate
        p = np.clip(p, low, high)
    return found


def weights(plant, values):
    """alpha at values of the parameters (count, parameters)."""
    alpha = np.ones((len(values), 1))
    for own, p in zip(plant.parameters, values.T, strict=True):
        low, high, s = (
            1 / np.asarray(x, dtype=float) if own.inverted else np.asarray(x, dtype=float)
            for x in (float(own.low), float(own.high), p)
        )
        share = ((s - low) / (high - low))[:, None]
        alpha = (alpha[:, :, None] * np.hstack([1 - share, share])[:, None]).reshape(len(p), -1)
    return alpha


def closed(plant, law, path):
    """Closed loops, E and alpha along motions."""
    steps, count, f = path.shape
    alpha = weights(plant, path.reshape(-1, f))
    A, B = plant.at(alpha)
    A = A + B @ law.gain(alpha)
    E = np.tensordot(alpha, np.stack([v.E for v in plant.vertices]), 1)
    return tuple(M.reshape(steps, count, *M.shape[1:]) for M in (A, E, alpha))


def worst_rms(plant, law, density, count=1000, T=10.0, dt=0.02):
    """The largest rms of x at any time, over motions that begin at rest."""
    path = motions(plant, count, int(T / dt), dt)
    A, E, _ = closed(plant, law, path)
    P = np.zeros((count, *A.shape[2:]))
    most = 0.0
    for k in range(len(path)):
        W = density / 2 * E[k] @ E[k].swapaxes(-1, -2)

        def rate(P, A=A[k], W=W):
            return A @ P + P @ A.swapaxes(-1, -2) + W

        first = rate(P)
        P = P + dt * rate(P + dt / 2 * first)
        most = max(most, float(P[:, 0, 0].max()))
    return np.sqrt(most)


def residual(plant, bound, law, rates):
    """The least eigenvalue of -(N + N' + S E E') + dX/dt of a claim about noise, by differences."""
    claim = bound.claim
    domain, own = law.domain_of(plant), claim.subject.evidence
    X = np.array(own.X, dtype=float)
    random, least = np.random.default_rng(1), np.inf
    names = plant.parameters
    lows, highs = (
        np.array([float(getattr(p, e)) for p in plant.parameters]) for e in ("low", "high")
    )

    def at(p):
        return np.tensordot(domain.basis(weights(plant, p[None]), own.degree)[0], X, 1)

    for _ in range(200):
        p = lows + (highs - lows) * random.uniform(0.01, 0.99, len(lows))
        A, E, _ = (M[0] for M in closed(plant, law, p[None, None]))
        for signs in np.ndindex(*(2,) * len(names)):
            speed = np.array([rates[f][s] for f, s in enumerate(signs)])
            h = 1e-6
            slope = (at(p + h * speed) - at(p - h * speed)) / (2 * h)
            N = A[0] @ at(p)
            F = -(N + N.T + float(claim.intensity) * E[0] @ E[0].T) + slope
            least = min(least, np.linalg.eigvalsh(F).min() / np.abs(F).max())
    return least


@pytest.mark.parametrize(
    "rate", [both(SLOW), both(2), (Fraction(-1), Fraction(4)), both(FAST), "any"]
)
def test_no_motion_of_a_thousand_passes_a_bound(rate):
    plant = spring(rate, 3, 4)
    bound = best_bound(plant, NO_LAW, Rms("x", density=2.0))
    worst = worst_rms(plant, NO_LAW, 2.0)
    assert 0.7 * bound.level < worst < bound.level


def test_two_parameters_one_by_its_inverse_and_one_at_any_rate():
    plant = mass(both(Fraction(1, 2)), "any")
    law = FixedGain(np.array([[-1.0, -2.0]]))
    bound = best_bound(plant, law, Rms("x", density=2.0))
    worst = worst_rms(plant, law, 2.0)
    assert 0.6 * bound.level < worst < bound.level
    # X is one of k, and is not one of m
    X = np.array(bound.claim.subject.evidence.X, dtype=float)
    d = bound.claim.subject.evidence.degree
    table = X.reshape(d + 1, d + 1, 2, 2) if d == 1 else None
    if table is not None:
        assert np.array_equal(table[:, 0], table[:, 1])


@pytest.mark.parametrize("which", ["mass", "spring"])
def test_the_inequality_holds_by_differences(which):
    plant = mass(both(Fraction(1, 2)), both(1)) if which == "mass" else spring(both(2), 3, 4)
    law = FixedGain(np.array([[-1.0, -2.0]])) if which == "mass" else NO_LAW
    bound = best_bound(plant, law, Rms("x", density=2.0))
    assert bound.claim.subject.evidence.degree > 0
    rates = [tuple(map(float, p.rate)) for p in plant.parameters]
    assert residual(plant, bound, law, rates) > 0
    # and twice as fast it does not: the rate is in it
    assert residual(plant, bound, law, [(4 * a, 4 * b) for a, b in rates]) < 0


def test_slow_motions_cost_nothing_and_the_fastest_what_one_matrix_does():
    asked = Rms("x", density=2.0)
    levels = [
        best_bound(spring(rate, 3, 4), NO_LAW, asked).level
        for rate in (
            None,
            both(Fraction(1, 10**4)),
            both(Fraction(1, 2)),
            both(2),
            both(10**6),
            "any",
        )
    ]
    still, slowest, *_, fastest, anyhow = levels
    assert slowest == pytest.approx(still, rel=1e-3)
    assert fastest == pytest.approx(anyhow, rel=1e-3)
    assert all(a <= b * (1 + 1e-6) for a, b in pairwise(levels))
    # of one X for all k
    one = quadratic_level(spring(None, 3, 4))
    assert anyhow == pytest.approx(one, rel=1e-3)


def quadratic_level(plant):
    """The least rms of x that one X of all k proves, by a grid over its two free numbers.

    With v free of x at the optimum X is diagonal but for x12; solved as a small problem in floats.
    """
    from scipy.optimize import minimize

    A = plant.A

    def level(z):
        L = np.array([[np.exp(z[0]), 0.0], [z[1], np.exp(z[2])]])
        X = L @ L.T
        worst = max(np.linalg.eigvalsh(M @ X + X @ M.T)[-1] for M in A)
        if worst >= 0:
            return 1e3 + worst
        # scale X until -(A X + X A') = E E' fits below at every vertex
        E = np.array([[0.0], [1.0]])
        t = max((E.T @ np.linalg.solve(-(M @ X + X @ M.T), E)).item() for M in A)
        return t * X[0, 0]

    best = np.inf
    for start in ([-1, 0, -0.5], [-1.0, -0.1, 0.0], [0, 0, 0.5], [-0.5, -0.3, 0.3]):
        x = np.array(start, dtype=float)
        for _ in range(4):
            x = minimize(
                level,
                x,
                method="Nelder-Mead",
                options={"maxiter": 4000, "xatol": 1e-10, "fatol": 1e-12},
            ).x
        best = min(best, level(x))
    return np.sqrt(best)


def growth(low, high, rate):
    """The largest spectral radius of a period of motions k(t) that go up and down at full speed."""
    period, steps = np.linspace(0.6, 8.0, 150)[:, None, None], 400
    half, eye = period / steps / 2, np.eye(2)
    swing, middle = np.minimum((high - low) / 2, rate * period / 4), (low + high) / 2
    Phi = np.tile(eye, (len(period), 1, 1))
    for share in np.arange(steps) / steps:
        k = middle + swing * (4 * abs(share - 0.5) - 1)
        A = k * np.array([[0.0, 0.0], [-1.0, 0.0]]) + np.array([[0.0, 1.0], [0.0, -DAMPING]])
        Phi = np.linalg.solve(eye - half * A, (eye + half * A) @ Phi)
    return np.abs(np.linalg.eigvals(Phi)).max()


def test_what_moves_too_fast_is_not_proved():
    low, high = 2, 30  # stable at rest, and driven without bound by fast motions
    assert analyse(spring(None, low, high), NO_LAW, HalfPlane(0)).proved
    slow, fast = Fraction(1, 2), Fraction(60)
    assert growth(low, high, float(slow)) < 1 < growth(low, high, float(fast))
    assert analyse(spring(both(slow), low, high), NO_LAW, HalfPlane(0)).proved
    assert not analyse(spring(both(fast), low, high), NO_LAW, HalfPlane(0)).proved
    assert not analyse(spring("any", low, high), NO_LAW, HalfPlane(0)).proved
    # but at each value it keeps a region that is about poles alone
    assert analyse(spring("any", low, high), NO_LAW, Sector(0.05)).proved


@pytest.mark.parametrize(
    "asked",
    [Gain("x"), EnergyPeak("x", norm=2.0), InitialPeak("x", points=[(1.0, 0.0)])],
    ids=lambda own: own.kind,
)
def test_other_bounds_hold_along_motions(asked):
    rate, count, T, dt = both(4), 1000, 12.0, 0.02
    plant = spring(rate, 3, 4)
    bound = best_bound(plant, NO_LAW, asked)
    path = motions(plant, count, int(T / dt), dt)
    A, E, _ = closed(plant, NO_LAW, path)
    x = np.zeros((count, 2))
    if asked.kind == "initial peak":
        x[:, 0] = 1.0
    w = np.random.default_rng(3).normal(size=(len(path), count))
    if asked.kind == "gain":  # near resonance
        t = np.arange(len(path)) * dt
        w = np.sin(np.outer(t, np.linspace(1.6, 2.1, count)))
    if asked.kind == "energy peak":  # the worst of the frozen loop, backwards
        t = np.arange(len(path)) * dt
        h = np.exp(-0.5 * t) * np.sin(np.sqrt(3.5 - 0.25) * t)
        w = np.repeat(h[::-1][:, None], count, axis=1)
    if asked.kind == "initial peak":
        w = 0 * w
    size = np.sqrt(dt * (w**2).sum(axis=0)).max()
    most, energy = 0.0, np.zeros(count)
    for k in range(len(path)):

        def rate_of(x, A=A[k], E=E[k], w=w[k]):
            return np.einsum("cij,cj->ci", A, x) + E[:, :, 0] * w[:, None]

        x = x + dt * rate_of(x + dt / 2 * rate_of(x))
        most = max(most, np.abs(x[:, 0]).max())
        energy += dt * x[:, 0] ** 2
    if asked.kind == "gain":
        found = np.sqrt(energy / (dt * (w**2).sum(axis=0))).max()
    elif asked.kind == "energy peak":
        found = 2.0 * most / size
    else:
        found = most
    assert 0.5 * bound.level < found < bound.level
    assert prove(bound.claim).proved


def test_a_law_is_designed_for_its_motions():
    """The scheduled law keeps its decay along motions; one X and its derivative prove it."""
    levels = []
    for rate in (None, both(1), "any"):
        plant = mass(rate, rate)
        design = tightest(plant, of="half_plane", within=HalfPlane(0.1))
        levels.append(design.region.parts[0].decay)
        if rate is not None:
            assert loads(design.certificate.dumps()).claims[0].motion
            assert design.certificate.prove().proved
    assert levels[0] >= levels[1] * (1 - 1e-6) >= levels[2] * (1 - 2e-6)


def test_decay_of_a_design_along_motions():
    plant = mass(both(1), both(2))
    design = place(plant, HalfPlane(1.0))
    T, dt, count = 4.0, 0.005, 1000
    path = motions(plant, count, int(T / dt), dt)
    A, _, alpha = closed(plant, design.law, path)
    W = np.tensordot(
        design.law.domain.basis(alpha.reshape(-1, 4), design.law.degree), design.law.W, 1
    )
    W = W.reshape(*alpha.shape[:2], 2, 2)
    x = np.random.default_rng(0).normal(size=(count, 2))
    first = None
    for k in range(len(path)):
        V = np.einsum("ci,ci->c", x, np.linalg.solve(W[k], x[:, :, None])[:, :, 0])
        first = V if first is None else first
        assert np.all(first * np.exp(-2 * 1.0 * k * dt) * (1 + 1e-3) >= V)
        step = np.einsum("cij,cj->ci", A[k], x)
        x = x + dt * np.einsum("cij,cj->ci", A[k], x + dt / 2 * step)


def test_a_ride_costs_more_the_faster_the_load_moves(lmi_alone):
    asked, limit = Rms("x", density=2.0), Rms("f", 1.0, density=2.0)
    levels = [
        optimise(mass(rate), asked, [limit], method=SCHEDULED).bounds[0].level
        for rate in (None, both(3), "any")
    ]
    assert all(a <= b * (1 + 1e-4) for a, b in pairwise(levels))
    assert levels[0] < levels[-1]


# --- one fault at a time -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bound():
    return best_bound(spring(both(2), 3, 4), NO_LAW, Rms("x", density=2.0))


def test_a_claim_does_not_hold_of_faster_motions(bound):
    own = bound.claim.subject
    (moved,) = own.motion
    assert prove(bound.claim).proved
    slower = replace(own, motion=(replace(moved, rate=both(1)),))
    assert prove(replace(bound.claim, subject=slower)).proved
    for rate in (both(8), (Fraction(-8), Fraction(0)), (Fraction(0), Fraction(8))):
        faster = replace(own, motion=(replace(moved, rate=rate),))
        assert not prove(replace(bound.claim, subject=faster)).proved
    # the same speed in a narrower interval is another slope of X
    narrow = replace(own, motion=(replace(moved, low=Fraction(3), high=Fraction(13, 4)),))
    assert not prove(replace(bound.claim, subject=narrow)).proved


def test_evidence_that_varies_is_none_at_any_rate(bound):
    own = bound.claim.subject
    anyhow = replace(own, motion=(replace(own.motion[0], rate="any"),))
    with pytest.raises(FormatError, match="X depends on k, which moves at any rate"):
        prove(replace(bound.claim, subject=anyhow))
    X = list(own.evidence.X)
    one = replace(own.evidence, X=[X[0]] * len(X))
    free = replace(anyhow, evidence=one)
    prove(replace(bound.claim, subject=free))  # a question that can be asked


def test_dual_forms_and_cells_are_none_along_motions(bound):
    own = bound.claim.subject
    with pytest.raises(FormatError, match="one X of the whole box"):
        prove(replace(bound.claim, subject=replace(own, evidence=replace(own.evidence, dual=True))))


def test_parts_of_the_box_with_matrices_of_their_own_prove_nothing_along_motions(bound):
    """X would jump between them, and a loop that fast motions drive without bound be proved."""
    own = bound.claim.subject
    X = own.evidence.X[0]
    own_each = [[[[factor * x for x in row] for row in X]] for factor in (1, 2)]
    each = [replace(own.evidence, X=matrices, degree=0) for matrices in own_each]
    ends = pairwise((Fraction(0), Fraction(1, 2), Fraction(1)))
    cells = tuple(Piece((a,), (b,), one) for (a, b), one in zip(ends, each, strict=True))
    parts = replace(own, evidence=Evidence([], cells=cells))
    with pytest.raises(FormatError, match="not continuous"):
        prove(replace(bound.claim, subject=parts))
    at_rest = replace(parts, motion=())
    prove(replace(bound.claim, subject=at_rest))  # a question that can be asked


def test_laws_without_all_of_their_matrices_are_one_line(bound):
    own = bound.claim.subject
    eye, none = [[Fraction(1), Fraction(0)], [Fraction(0), Fraction(1)]], [[Fraction(0)] * 2]
    law = replace(own.law, K=None, W=[eye], Z=[none], degree=1)
    plain = replace(own.evidence, pieces=())
    for evidence in (plain, replace(plain, X=[], degree=0, multiple=(Fraction(2),))):
        with pytest.raises(FormatError, match="matrices are missing"):
            prove(replace(bound.claim, subject=replace(own, law=law, evidence=evidence)))


def test_one_matrix_may_be_written_as_a_polynomial():
    plant = mass("any", "any")
    law = FixedGain(np.array([[-1.0, -2.0]]))
    bound = best_bound(plant, law, Rms("x", density=2.0))
    own = bound.claim.subject
    assert own.evidence.degree == 0
    many = replace(
        own, on="simplex", evidence=replace(own.evidence, X=own.evidence.X * 4, degree=1)
    )
    assert prove(replace(bound.claim, subject=many)).proved


def test_what_is_said_of_motions(bound):
    plant = file_plant(spring(both(2), 3, 4))
    assert bound.claim.said(plant).endswith("k moving by up to 2 (N/m)/s, independently of w")
    gain = best_bound(spring((-1, 0), 3, 4), NO_LAW, Gain("x")).claim
    assert gain.said(file_plant(spring((-1, 0), 3, 4))).endswith("k moving by -1 to 0 (N/m)/s")


@pytest.mark.parametrize(
    ("rate", "says"),
    [
        ((1, 2), r"rate = \[1, 2\] does not contain 0.*write \[0, 2\]"),
        ((-2, -1), r"write \[-2, 0\]"),
        ("fast", "must be two numbers"),
        ((1,), "must be two numbers"),
        ((-1, float("inf")), "must be a finite number"),
    ],
)
def test_rates_that_are_none(rate, says):
    with pytest.raises(InputError, match=says):
        Parameter("k", 1, 2, rate=rate)


def test_a_rate_of_zero_is_none():
    assert Parameter("k", 1, 2, rate=(0, 0)).rate is None
