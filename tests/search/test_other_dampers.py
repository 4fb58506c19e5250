"""Dampers of other cars than the example's: wide loads, two parameters, weights, two dampers.

What is claimed is compared with the true motion at points and parameters drawn at random: V falls
on average as the bound needs, and X along every damper, computed here from the claim's numbers.
"""

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import InputError, semi_active
from polefence.certify.refutation import lowest
from polefence.examples import spec_text
from polefence.plant.dampers import Damper
from polefence.plant.outputs import states, weighted_sum
from polefence.plant.spec import loads
from polefence.proof import squares
from polefence.proof.claims.base import prove
from polefence.proof.claims.clipped import groups_of
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.work import FormatError
from polefence.requirements.rms import Rms
from polefence.search.semi_active import DamperQuestion, unproved
from polefence.vehicle import velocity_density

DENSITY = velocity_density("C", 20)
TYRES = '[parameter.kt]\nlabel = "tyre"\nrange = [140000, 200000]\nunit = "N/m"\n\n[matrices]'


def quarter(
    masses=(280, 420), spring=10000, bounds=(300, 3000), tyres=False, weight=None, share=100
):
    """The example with other numbers; its plant, its rms and its damper."""
    text = spec_text("semi-active").replace("[288.9, 388.9]", str(list(masses)))
    text = text.replace("k = 10000", f"k = {spring}").replace(
        "[0, 100, 0, 0]", f"[0, {share}, 0, 0]"
    )
    if tyres:
        text = re.sub(r"\nkt = .*\n", "\n", text).replace("[matrices]", TYRES, 1)
    asked = Rms(["sprung-mass acceleration", "tyre share"], 1.0, DENSITY, weight=weight)
    return loads(text), asked, [Damper("damper force", "suspension deflection", *bounds)]


def half(weight=None, aged=True):
    """The half car without its dampers, its load uncertain, and its springs."""
    text = re.sub(r"\ndamper = .*", "\ndamper = 0", spec_text("half-car"))
    if not aged:
        text = re.sub(r"\[parameter.age\].*\nrange.*\n", "", text).replace("*(1 + age)", "")
    plant = loads(text)
    ends = ("front", "rear")
    shares = [weighted_sum(k, "m", [(60.0, plant.signal(f"{k} tyre deflection"))]) for k in ends]
    asked = Rms([plant.signal("driver acceleration"), *shares], 1.0, DENSITY, weight=weight)
    return (
        plant,
        asked,
        [Damper(f"{k} force", f"{k} suspension deflection", 300, 2500) for k in ends],
    )


class Truth:
    """A claim's own numbers in floats, at points that are drawn."""

    def __init__(self, law):
        claim = law.claim
        self.plant, self.claim, self.n = law.plant, claim, len(claim.A[0])
        self.A, self.B = (np.array(M, float) for M in (claim.A, claim.B))
        self.E = np.array(claim.E[0], float) * np.sqrt(float(claim.limit.intensity))
        outputs = claim.limit.outputs
        self.C, self.D = (
            np.array([[getattr(y, k)[j][0] for y in outputs] for j in range(len(self.A))], float)
            for k in "CD"
        )
        self.K, self.units = np.array(claim.K, float), np.array(claim.units, float)
        self.rates = np.array([own.rate[0][0] for own in claim.dampers], float)
        self.bounds = np.array([own.ends for own in claim.dampers], float)
        self.X, self.V = (np.array(M, float) for M in (claim.X, claim.V))
        self.powers = np.array(squares.monomials(self.n, claim.degree, 0)[1:])
        self.source = np.random.default_rng(8)

    def alpha(self):
        """Of parameters, as the plant has it."""
        ends = [(float(p.low), float(p.high)) for p in self.plant.parameters]
        shares = self.source.beta(0.6, 0.6, len(ends))
        each = zip(self.plant.parameters, ends, shares, strict=True)
        values = {p.name: low + t * (high - low) for p, (low, high), t in each}
        return self.plant.alpha(clamp=True, **values)

    def slack(self):
        """1 - z'z / g^2 less the mean derivative of V, at some state and parameters."""
        alpha = self.alpha()
        A, B, C, D, V = (
            np.tensordot(alpha, M, 1) for M in (self.A, self.B, self.C, self.D, self.V)
        )
        xi = self.source.standard_normal(self.n) * 10 ** self.source.uniform(-1.5, 1)
        x, v = self.units * xi, self.rates @ (self.units * xi)
        low, high = (np.sort(self.bounds * v[:, None], axis=1)).T
        u = np.clip(self.K @ x, low, high)
        z, moved = C @ x + D @ u, (A @ x + B @ u) / self.units
        noise = self.E / self.units[:, None]
        gradient, hessian = np.zeros(self.n), np.zeros((self.n, self.n))
        for i in range(self.n):
            once = self.powers - np.eye(self.n, dtype=int)[i]
            kept = once[:, i] >= 0
            values = V[kept] * self.powers[kept, i]
            gradient[i] = values @ np.prod(xi ** once[kept], axis=1)
            for k in range(self.n):
                twice = once[kept] - np.eye(self.n, dtype=int)[k]
                own = twice[:, k] >= 0
                more = values[own] * once[kept][own, k]
                hessian[i, k] = more @ np.prod(xi ** twice[own], axis=1)
        drift = gradient @ moved + np.trace(noise.T @ hessian @ noise) / 2
        left = 1 - z @ z / float(self.claim.limit.level) ** 2 - drift
        return left / (1 + abs(drift) + z @ z)

    def growth(self):
        """The largest eigenvalue of X A + A'X over that of X, dampers anywhere in their ranges."""
        alpha = self.alpha()
        A, B, X = (np.tensordot(alpha, M, 1) for M in (self.A, self.B, self.X))
        c = self.source.uniform(*self.bounds.T)
        S = np.diag(self.units)
        loop, X = A + B @ (c[:, None] * self.rates), S @ X @ S
        XA = X @ (loop * self.units / self.units[:, None])
        assert np.linalg.eigvalsh(X)[0] > 0
        return np.linalg.eigvalsh(XA + XA.T)[-1]


def fixed(law, alpha, c):
    """The rms with dampers that stay, by a Lyapunov equation."""
    own = Truth(law)
    A, B, C, D = (np.tensordot(alpha, M, 1) for M in (own.A, own.B, own.C, own.D))
    gain = np.array(c)[:, None] * own.rates
    X = solve_continuous_lyapunov(A + B @ gain, -own.E @ own.E.T)
    return np.sqrt(np.trace((C + D @ gain) @ X @ (C + D @ gain).T))


CARS = {
    "loads of 280 to 420 kg": {},
    "loads of 288.9 to 500 kg": {"masses": (288.9, 500)},
    "a spring of 20000 N/m": {"masses": (288.9, 388.9), "spring": 20000},
    "a damper of 100 to 2000 N s/m": {"masses": (288.9, 388.9), "bounds": (100, 2000)},
    "loads and tyres": {"tyres": True},
    "Wk": {"weight": ["Wk", "none"]},
}


@pytest.fixture(scope="module")
def laws():
    found = {}
    for name, numbers in CARS.items():
        plant, asked, dampers = quarter(**numbers)
        found[name] = semi_active(plant, asked, dampers, 2 if "weight" in numbers else 4)
    plant, asked, dampers = half()
    return found | {"half car": semi_active(plant, asked, dampers)}


@pytest.mark.parametrize("name", [*CARS, "half car"])
def test_each_has_a_bound_between_the_least_of_all_logics_and_the_best_damper(laws, name):
    law = laws[name]
    assert check(read(law.file().dumps())).proved
    low = lowest(law.plant, law.specification, law.passive, law.dampers)
    # of a weighted signal the demand leaves the filter's states out, which costs a little
    assert low[1] < law.level < law.passive * (1.01 if name == "Wk" else 1.0001)
    assert law.K.shape == law.plant.shape[::-1]


@pytest.mark.parametrize("name", [*CARS, "half car"])
def test_the_mean_falls_at_random_points_and_no_choice_of_dampers_grows(laws, name):
    own = Truth(laws[name])
    assert min(own.slack() for _ in range(400)) > -1e-9
    assert max(own.growth() for _ in range(100)) < 0


@pytest.mark.parametrize("name", [*CARS, "half car"])
def test_the_best_damper_that_stays_has_its_rms_at_the_worst_vertex(laws, name):
    law = laws[name]
    corners = np.eye(len(law.claim.A))
    found = [fixed(law, alpha, law.coefficients) for alpha in corners]
    assert max(found) == pytest.approx(law.passive, rel=1e-6)


def test_random_cars_have_bounds():
    source = np.random.default_rng(3)
    for _ in range(4):
        empty = source.uniform(200, 500)
        plant, asked, dampers = quarter(
            masses=(round(empty, 1), round(empty * source.uniform(1.2, 2), 1)),
            spring=round(source.uniform(10000, 45000)),
            bounds=(round(source.uniform(100, 600)), round(source.uniform(1500, 6000))),
            share=round(source.uniform(30, 250)),
        )
        law = semi_active(plant, asked, dampers, 4)
        assert prove(law.claim).proved
        assert law.level < law.passive


def test_forms_of_each_damper_find_what_pieces_of_degree_two_find():
    """The regions of two dampers are added up, the pieces multiplied."""
    for asked in (quarter(masses=(288.9, 388.9)), half(aged=False)):
        question = DamperQuestion.of(*asked)
        K = question.rounded
        found = question.quadratic(K)(1e-6).level
        assert found == pytest.approx(question.polynomial(K, 2)(1e-6).level, rel=1e-5)


def test_pairs_of_one_monomial_are_one_inequality():
    assert groups_of((3,)) == [
        ((0, 0),),
        ((0, 1), (1, 0)),
        ((0, 2), (2, 0)),
        ((1, 1),),
        ((1, 2), (2, 1)),
        ((2, 2),),
    ]
    box = groups_of((2, 2))
    assert len(box) == 9
    assert set(box[4]) == {(0, 3), (3, 0), (1, 2), (2, 1)}
    assert sum(map(len, box)) == 16


def test_each_fault_in_two_parameters_is_found(laws):
    claim = laws["loads and tyres"].claim
    limit = claim.limit
    rows = [list(row) for row in claim.X[2][:]]
    rows[0][0] *= 100
    wrong = [
        replace(claim, limit=replace(limit, level=limit.level * Fraction("0.999"))),
        replace(claim, V=claim.V[::-1]),
        replace(claim, V=(claim.V[0], claim.V[2], claim.V[1], claim.V[3])),
        replace(claim, X=[*claim.X[:2], rows, claim.X[3]]),
        replace(claim, X=[[[-x for x in row] for row in claim.X[0]], *claim.X[1:]]),
        replace(claim, A=[claim.A[0], claim.A[2], claim.A[1], claim.A[3]]),
        replace(claim, pieces=claim.pieces[3:] + claim.pieces[:3]),
    ]
    assert prove(claim).proved
    for own in wrong:
        assert not prove(own).proved
    for own, words in (
        (replace(claim, sizes=()), "pieces must be 30"),  # of the simplex
        (replace(claim, sizes=(2,)), "alpha has 2 corners, not 4"),
        (replace(claim, X=claim.X[:1]), "X holds 1 matrices, not 4"),
    ):
        with pytest.raises(FormatError, match=words):
            prove(own)


def test_a_file_about_parameters_that_move_is_refused(laws):
    text = laws["loads of 280 to 420 kg"].file().dumps()
    moved = text.replace('"through": "1/m1"', '"through": "1/m1", "rate": [-1, 1]')
    assert moved != text
    with pytest.raises(FormatError, match="needs constant parameters"):
        read(moved)


def test_a_weighted_signal_has_a_limit_for_dampers_above_that_of_any_force():
    plant, asked, dampers = quarter(weight=["Wk", "none"])
    near = unproved(plant, asked, dampers).passive
    found = [lowest(plant, asked, near, own)[1] for own in (dampers, ())]
    assert 0.85 * near < found[1] < found[0] < near


def test_a_half_car_has_a_bound_of_a_weighted_signal():
    law = semi_active(*half(weight=["Wk", "none", "none"], aged=False))
    assert prove(law.claim).proved
    own = Truth(law)
    assert min(own.slack() for _ in range(300)) > -1e-9


@pytest.mark.parametrize(
    ("measured", "zero", "most"),
    [
        (("sprung-mass velocity",), [0, 1], 1.0),
        (("suspension deflection", "sprung-mass velocity"), [1], 1.0),
        (("suspension deflection",), [1], 1.02),  # of the whole demand 1.43 is proved
    ],
)
def test_a_law_of_a_few_signals_is_made_of_these_and_the_rate(measured, zero, most):
    plant, asked, dampers = quarter(masses=(288.9, 388.9))
    law = semi_active(plant, asked, dampers, 4, measured=measured)
    assert prove(law.claim).proved
    assert law.level < most * law.passive
    assert not law.K[0][zero].any()
    names = [state.name for state in states(plant)]
    seen = np.array([*(np.eye(4)[names.index(name)] for name in measured), [0, 0, -1, 1]])
    left = law.K[0] - np.linalg.lstsq(seen.T, law.K[0], rcond=None)[0] @ seen
    assert np.abs(left).max() < 1e-6 * np.abs(law.K).max()


def test_all_states_measured_are_all_states():
    plant, asked, dampers = quarter()
    known = [state.name for state in states(plant)]
    found = [DamperQuestion.of(plant, asked, dampers, own).rounded for own in (None, known)]
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_what_a_force_passes_into_is_not_measured():
    plant, asked, dampers = quarter()
    with pytest.raises(InputError, match="sprung-mass acceleration is not a fixed sum of states"):
        semi_active(plant, asked, dampers, measured=["sprung-mass acceleration"])
