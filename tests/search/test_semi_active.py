"""What no logic of a controllable damper goes below: brackets by dampers that stay, or switch."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from polefence import InputError, UncertainPlant
from polefence.certify.refutation import refute_limits
from polefence.examples import family
from polefence.plant.dampers import Damper
from polefence.plant.outputs import weighted_sum
from polefence.proof.claims.base import prove
from polefence.proof.dampers import Curve
from polefence.proof.work import FormatError
from polefence.requirements.rms import Rms
from polefence.vehicle import SIGNALS, quarter_car, velocity_density

DENSITY = velocity_density("C", 20)
LOW, HIGH = 300, 3000
SMALL = 1e-3  # a limit that every law exceeds: the factor says by how much
FORCE, DEFLECTION = "actuator force", "suspension deflection"
DAMPER = Damper(FORCE, DEFLECTION, LOW, HIGH)


def table_1(c=0):
    """The car of Table 1 with this damper, four states."""
    sizes = (Fraction("288.9"), Fraction("28.58"), 10000, 155900, Fraction(c))
    A, B, E = quarter_car(*sizes)
    names = SIGNALS | {"states": SIGNALS["states"][:4]}
    return UncertainPlant.from_vertices([[row[:4] for row in A[:4]]], [B[:4]], [E[:4]], **names)


@pytest.fixture(scope="module")
def car():
    return table_1()


def cost(plant, rho):
    """The limit on sqrt(acceleration^2 + rho tyre deflection^2)."""
    tyre = weighted_sum("tyre", "m", [(float(np.sqrt(rho)), plant.signal("tyre deflection"))])
    return Rms(["sprung-mass acceleration", tyre], SMALL, DENSITY)


def lowest(plant, rho, *dampers):
    found = refute_limits(plant, [cost(plant, rho)], dampers)
    assert found is not None
    assert prove(found.claim).proved
    return found.factor * SMALL


def rows(c):
    """A and the acceleration's row with this damper, of the car without one."""
    plant = table_1(c)
    return plant.A[0], plant.A[0][2]


def squares(rho, X, c):
    _, row = rows(c)
    return row @ X @ row + rho * X[1, 1]


def passive(rho, c):
    A, _ = rows(c)
    E = np.array(table_1().vertices[0].exact_E, float)
    return float(np.sqrt(squares(rho, solve_continuous_lyapunov(A, -DENSITY / 2 * E @ E.T), c)))


# best damper that stays, lower limits of semi-active and of any law [m/s2]
TABLE = [
    (1.0, 0.923, 0.567, 0.086),
    (4e3, 0.985, 0.705, 0.685),
    (1.5e4, 1.118, 0.961, 0.960),
    (4e4, 1.334, 1.247, 1.245),
    (1e5, 1.686, 1.619, 1.614),
]


@pytest.mark.parametrize(("rho", "fixed", "semi_active", "active"), TABLE)
def test_the_limits_of_a_known_car(car, rho, fixed, semi_active, active):
    best = minimize_scalar(lambda c: passive(rho, c), bounds=(LOW, HIGH), method="bounded").fun
    ours, any_law = lowest(car, rho, DAMPER), lowest(car, rho)
    assert [best, ours, any_law] == pytest.approx([fixed, semi_active, active], abs=6e-4)
    assert any_law < ours < best


@pytest.mark.parametrize("seed", range(20))
def test_no_random_switching_goes_below(car, seed):
    """A chain that switches between dampers, blindly: its second moments are exact."""
    source = np.random.default_rng(seed)
    states = int(source.integers(2, 5))
    c = source.uniform(LOW, HIGH, states)
    rates = source.uniform(0.1, 30, (states, states))
    np.fill_diagonal(rates, 0)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    share = np.linalg.svd(rates.T)[2][-1]
    share = share / share.sum()
    E = np.array(car.vertices[0].exact_E, float)
    eye = np.eye(4)
    whole = np.kron(rates.T, np.eye(16))
    for k, own in enumerate(c):
        A, _ = rows(own)
        part = slice(16 * k, 16 * k + 16)
        whole[part, part] += np.kron(A, eye) + np.kron(eye, A)
    noise = np.concatenate([p * DENSITY / 2 * (E @ E.T).ravel() for p in share])
    X = np.linalg.solve(whole, -noise).reshape(states, 4, 4)
    for rho, *_ in TABLE:
        reached = np.sqrt(sum(squares(rho, own, d) for own, d in zip(X, c, strict=True)))
        assert reached > lowest(car, rho, DAMPER)


@pytest.mark.parametrize("c", [400, 1500])
def test_a_damper_that_may_hardly_change_is_one_that_stays(car, c):
    near = Damper(FORCE, DEFLECTION, c, c * (1 + Fraction(1, 10**4)))
    assert lowest(car, 1e4, near) == pytest.approx(passive(1e4, c), rel=1e-3)
    assert lowest(car, 1e4, near) < passive(1e4, c)


def test_wider_bounds_allow_more(car):
    reached = [
        lowest(car, 4e3, Damper(FORCE, DEFLECTION, low, high))
        for low, high in ((1000, 1500), (600, 2000), (300, 3000), (0, 1e5))
    ]
    assert reached == sorted(reached, reverse=True)
    assert reached[-1] > lowest(car, 4e3)


def test_a_damper_beside_one_that_stays_is_the_same(car):
    """c from 300 to 3000 is 300 in the matrices and 0 to 2700."""
    beside = lowest(table_1(LOW), 4e3, Damper(FORCE, DEFLECTION, 0, HIGH - LOW))
    assert beside == pytest.approx(lowest(car, 4e3, DAMPER), rel=1e-6)


def test_four_dampers_of_a_full_car():
    plant = family("full-car")
    corners = [f"{side} {hand}" for side in ("front", "rear") for hand in ("left", "right")]
    dampers = [Damper(f"{k} force", f"{k} suspension deflection", 0, 2000) for k in corners]
    own = plant.signal("driver acceleration")
    tyres = [weighted_sum(k, "m", [(60.0, plant.signal(f"{k} tyre deflection"))]) for k in corners]
    limit = Rms([own, *tyres], SMALL, DENSITY)
    semi_active, active = refute_limits(plant, [limit], dampers), refute_limits(plant, [limit])
    assert prove(semi_active.claim).proved
    assert semi_active.factor > active.factor
    assert "no semi-active law keeps this" in str(semi_active)
    assert "no law keeps this" in str(active)


# --- faults --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def claim(car):
    return refute_limits(car, [cost(car, 4e3)], [DAMPER]).claim


def spoiled(claim, **changes):
    return replace(claim, dampers=(replace(claim.dampers[0], **changes),))


def test_what_proves_too_much_is_undecided(claim):
    (tau,) = claim.multipliers
    assert tau > 0
    for wrong in (
        replace(claim, multipliers=(-tau,)),
        replace(claim, multipliers=(Fraction(0),)),
        replace(claim, multipliers=(tau * 2,)),
        replace(claim, factor=claim.factor * (1 + Fraction(1, 10**6))),
        replace(claim, dampers=(), multipliers=()),
        spoiled(claim, low=Curve.line(Fraction(290))),
        spoiled(claim, high=Curve.line(Fraction(3100))),
        spoiled(claim, low=Curve.line(Fraction(-HIGH)), high=Curve.line(Fraction(-LOW))),
        spoiled(claim, rate=[[[-x for x in claim.dampers[0].rate[0][0]]]]),
    ):
        assert not prove(wrong).proved
    # narrower bounds are kept by fewer logics
    assert prove(spoiled(claim, low=Curve.line(Fraction(LOW)))).proved


def test_what_does_not_fit_is_refused(claim):
    for wrong, words in (
        (replace(claim, multipliers=()), "one multiplier for each damper"),
        (spoiled(claim, number=1), "input 1 is not one of 0 to 0"),
        (spoiled(claim, number=-1), "input -1 is not"),
        (spoiled(claim, number=True), "input True is not"),
        (spoiled(claim, rate=[[[Fraction(1)] * 3]]), "rate"),
        (spoiled(claim, rate=[]), "rate"),
        (spoiled(claim, low=Curve.line(Fraction(3001))), "low must not be above high"),
    ):
        with pytest.raises(FormatError, match=words):
            prove(wrong)


@pytest.mark.parametrize(
    ("damper", "words"),
    [
        (("force", DEFLECTION, 1, 2), "no signal 'force'"),
        ((FORCE, "travel", 1, 2), "no signal 'travel'"),
        ((FORCE, "tyre deflection", 1, 2), "passes straight into the rate of tyre deflection"),
        ((FORCE, "sprung-mass velocity", 1, 2), "passes straight into the rate"),
        ((FORCE, "sprung-mass acceleration", 1, 2), "is not a fixed sum of states"),
    ],
)
def test_dampers_that_are_none_are_refused(car, damper, words):
    with pytest.raises(InputError, match=words):
        refute_limits(car, [cost(car, 4e3)], [Damper(*damper)])


@pytest.mark.parametrize(("low", "high"), [(-1, 2), (2, 2), (3, 2), ("x", 2), (0, float("inf"))])
def test_bounds_that_are_none_are_refused(low, high):
    with pytest.raises(InputError, match="damper actuator force: (low|high)"):
        Damper(FORCE, DEFLECTION, low, high)
